"""Command run: everything that a project file asks for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from seaid.cli.defaults import PROJECT_FILE
from seaid.cli.messages import is_terminal, note, show
from seaid.cli.options import (
    VERBOSE,
    AsJson,
    FailOn,
    check_fail_on,
    command_line,
    facts_of,
    fail_on_warnings,
)

if TYPE_CHECKING:
    from seaid.project import ProjectRun


def run(
    project: Annotated[
        Path, Argument(help="The project file, or its folder.", metavar="[PROJECT]")
    ] = Path(PROJECT_FILE),
    *,
    fail_on: FailOn = None,
    open_report: Annotated[bool, Option("--open", help="Open the report in the browser.")] = False,
    verbose: Annotated[bool, Option("--verbose", "-v", help=VERBOSE)] = False,
    as_json: AsJson = False,
) -> None:
    """Identify, validate, report and export the project of the working folder.

    The results go into a new folder of runs/, to which runs/latest points: report.html, parameters,
    robot files, and the saved run, from which `validate`, `report`, `export` and `compare` start.

    seaid run --open
    seaid run leg/seaid.toml --fail-on wrong
    """
    from seaid.log import FOUND_CONTACT
    from seaid.project import load_project, run_project

    check_fail_on(fail_on)
    loaded = load_project(project)
    done = run_project(loaded, command=command_line(), progress=is_terminal())
    logs = (log for run in done.runs.values() for log in run.identification.processing)
    texts = [str(x) for log in logs for x in log.repairs if x.kind == FOUND_CONTACT]
    for text in [*done.notes, *texts]:
        note(text)
    show(_text(done, verbose), _content(done), as_json, done.folder, **_facts(done))
    report = done.folder / "report.html"
    if open_report and report.exists():
        typer.launch(report.resolve().as_uri())
    fail_on_warnings(done.warnings, fail_on or loaded.fail_on)


def _text(done: ProjectRun, verbose: bool) -> str:
    from seaid.project import summary_of

    parts = [
        f"Condition {name}\n" * bool(name) + summary_of(run, verbose)
        for name, run in done.runs.items()
    ]
    return "\n\n".join(parts + ([] if done.conditions is None else [done.conditions.summary()]))


def _facts(done: ProjectRun) -> dict[str, Any]:
    """Return robot and warnings, and the verdict of a project without conditions."""
    first, *others = done.runs.values()
    facts = facts_of(first.identification, *first.validations.values(), *first.replays.values())
    return facts if not others else {**facts, "verdict": None, "warnings": done.warnings}


def _content(done: ProjectRun) -> dict[str, Any]:
    return {
        "folder": done.folder,
        "files": done.files,
        "not_written": done.notes,
        "conditions": {
            name: {
                "parameters": run.identification.to_dict(),
                "validations": {log: each.to_dict() for log, each in run.validations.items()},
                "replays": {log: each.to_dict() for log, each in run.replays.items()},
            }
            for name, run in done.runs.items()
        },
    }
