"""Command report: identification and validation as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from seaid.cli.messages import written
from seaid.cli.options import (
    FEASIBLE,
    FromLogs,
    IdentifyOptions,
    ResultOptions,
    check_validation_logs,
    checked_suffix,
    facts_of,
)

_DIGEST = 12


def report(
    given: IdentifyOptions,
    from_logs: FromLogs,
    *,
    output: Annotated[
        Path, Option("--output", "-o", help="The page to write.", metavar="HTML")
    ] = Path("report.html"),
    validation: Annotated[
        list[Path] | None,
        Option("--validate", help="Another log, to validate on. May be repeated.", metavar="LOG"),
    ] = None,
    feasible: Annotated[bool, Option("--feasible", help=FEASIBLE)] = False,
    result: ResultOptions,
) -> None:
    """Identify, validate, and write the results with their reliability as one HTML page.

    The page opens offline in any browser: verdict and flags, tables with confidence intervals,
    zoomable traces, checks, and the conditions of the experiment. Without --validate the report has
    no validation section and says so.

    seaid report leg.urdf --from run.csv --validate other.csv --drives leg.toml -o report.html
    seaid report arm.urdf --from a.csv --from b.csv --validate c.csv --feasible
    """
    from seaid.identification import validate as validated
    from seaid.report import warning_lines, write_report

    checked_suffix(output, ".html", ".htm")
    unseen = validation or []
    check_validation_logs(unseen, from_logs)
    result.check(output, read=(*given.files, *from_logs, *unseen))
    robot = given.robot(given.known_body or ())
    own, others = (given.logs(paths, robot) for paths in (from_logs, unseen))
    found = given.identify(robot, own, feasible=feasible)
    results = [validated(found, log) for log in others]
    facts = _facts(given, from_logs, unseen)
    offsets = f"{given.encoder_offset_std:g} rad or m"
    options = {"Estimator": given.estimator, "Standard deviation of encoder offsets": offsets}
    with written(output, ".html") as file:
        write_report(found, results, file, facts={**facts, **options})
    content = {"validations": [one.to_dict() for one in results]}
    text = [f"{robot.name}: {len(found.load.values)} base parameters and its drives reported"]
    text += warning_lines(found.warnings)
    result.show("\n".join(text), content, output, **facts_of(found))


def _facts(given: IdentifyOptions, from_logs: list[Path], unseen: list[Path]) -> dict[str, str]:
    """Return {kind of file: name, size and digest} of the files that were read."""
    named: dict[str, list[Path | None]] = {
        "Robot": [given.urdf],
        "Drives": [given.drives],
        "Description of logs": [given.description],
        "Identified from": [*from_logs],
        "Validated on": [*unseen],
    }
    found = {}
    for what, paths in named.items():
        there = [path for path in paths if path is not None]
        for place, path in enumerate(there):
            name = f"{what}, {place + 1}" if len(there) > 1 else what
            found[name] = _file_text(path)
    return found


def _file_text(path: Path) -> str:
    """Return a file's name with size and SHA-256; for a folder (a bag) its path only."""
    import hashlib

    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        return f"{path.name}, {path.stat().st_size} bytes, SHA-256 {digest[:_DIGEST]}…"
    except OSError:  # a folder, or removed since it was read
        return str(path)
