"""Command compare: two identifications side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

import seaid
from seaid.cli.kinds import Page, ResultFile
from seaid.cli.messages import written
from seaid.cli.options import ResultOptions


def compare(
    first: ResultFile,
    second: ResultFile,
    *,
    output: Page | None = None,
    result: ResultOptions,
) -> None:
    """Compare two identifications: which parameters differ significantly.

    For instance cold and warm, or before and after a repair. A difference is significant if it
    would be rare without one, in any of all parameters. Runs have covariances, so that drives and
    base parameters are also tested as a whole; files of parameters have none, and no page.

    Parameters
    ----------
    first, second
        Folder of a run, or parameters of seaid identify.
    output
        A page with the comparison.

    Examples
    --------
    seaid compare runs/cold runs/latest -o comparison.html
    seaid compare cold.json warm.json
    """
    from seaid._files import followed

    result.check(output, read=())
    names = (first.stem, second.stem) if first.is_file() else (first.name, second.name)
    if names[0] == names[1]:
        names = str(first), str(second)
    first, second = followed(first), followed(second)
    runs = [path.is_dir() or path.suffix.lower() == ".npz" for path in (first, second)]
    if all(runs):
        robot, comparison = _compare_runs(first, second, names, output)
    elif output is None and not any(runs):
        robot = seaid.export.parameters_content(first)["robot"]
        comparison = seaid.report.comparison_of_parameters(first, second, names=names)
    else:
        wanted = "two runs, or two files of parameters" if any(runs) else "runs, for a page"
        raise typer.BadParameter(f"give {wanted}", param_hint="RUN")
    result.show(comparison.summary(), _content(comparison), output, robot=robot)


def _compare_runs(
    first: Path, second: Path, names: tuple[str, str], output: Path | None
) -> tuple[str, seaid.report.Comparison]:
    load, save = seaid.project.load_run, seaid.report.write_comparison
    fits = load(first).identification, load(second).identification
    written(output, ".html", lambda file: save(*fits, file, names=names))
    return fits[0].robot.name, seaid.report.comparison_of(*fits, names=names)


def _content(comparison: seaid.report.Comparison) -> dict[str, Any]:
    keys = (
        *("joint", "name", "unit", "first", "second", "first_error", "second_error"),
        *("change", "error", "significance", "p_value", "is_significant"),
    )
    return {
        "differences": [{key: getattr(row, key) for key in keys} for row in comparison.differences],
        **{key: getattr(comparison, key) for key in ("names", "only", "groups", "dependence")},
    }
