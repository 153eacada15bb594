"""Command compare: two identifications side by side."""

from __future__ import annotations

import seaid
from seaid.cli.kinds import Page, RunFile
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
        Folder of a run, or an .npz of seaid identify.
    output
        A page with the comparison.

    Examples
    --------
    seaid compare runs/cold runs/latest -o comparison.html
    seaid compare cold.npz warm.npz
    """
    result.check(output, read=())
    names = str(first), str(second)
    before, after = (seaid.project.load_run(path).identification for path in (first, second))
    comparison = seaid.report.comparison_of(before, after, names=names)
    if output is not None:
        seaid.report.write_comparison(before, after, output, names=names)
    result.show(comparison.summary(), comparison, output, robot=before.robot.name)
