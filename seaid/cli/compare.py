"""Command compare: two identifications side by side."""

from __future__ import annotations

from typing import Any

import seaid
from seaid.cli.kinds import Page, RunFile
from seaid.cli.messages import written
from seaid.cli.options import ResultOptions


def compare(
    first: RunFile,
    second: RunFile,
    *,
    output: Page | None = None,
    result: ResultOptions,
) -> None:
    """Compare two identifications: which parameters differ significantly.

    For instance cold and warm, or before and after a repair. A difference is significant if it
    would be rare without one, in any of all parameters. Drives and base parameters are also tested
    as a whole.

    Parameters
    ----------
    first, second
        Folder of a run, or file of seaid identify -o run.npz.
    output
        A page with the comparison.

    Examples
    --------
    seaid compare runs/cold runs/latest -o comparison.html
    seaid compare cold.npz warm.npz
    """
    result.check(output, read=())
    names = (first.stem, second.stem) if first.is_file() else (first.name, second.name)
    if names[0] == names[1]:
        names = str(first), str(second)
    before, after = (seaid.project.load_run(path).identification for path in (first, second))
    comparison = seaid.report.comparison_of(before, after, names=names)
    save = seaid.report.write_comparison
    written(output, ".html", lambda file: save(before, after, file, names=names))
    result.show(comparison.summary(), _content(comparison), output, robot=before.robot.name)


def _content(comparison: seaid.report.Comparison) -> dict[str, Any]:
    keys = (
        *("joint", "name", "unit", "first", "second", "first_error", "second_error"),
        *("change", "error", "significance", "p_value", "is_significant"),
    )
    return {
        "differences": [{key: getattr(row, key) for key in keys} for row in comparison.differences],
        **{key: getattr(comparison, key) for key in ("names", "only", "groups")},
    }
