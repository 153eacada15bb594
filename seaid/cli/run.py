"""Command run: everything that a project file asks for."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Any

import click

import seaid
from seaid.cli.kinds import ProjectFile
from seaid.cli.messages import is_terminal, note
from seaid.cli.options import FailOptions, JsonOptions, command_line, judgement_of, refuse
from seaid.cli.project import PROJECT_FILE
from seaid.errors import abridged


def run(
    project: ProjectFile = Path(PROJECT_FILE),
    *,
    fail: FailOptions,
    executor: str | None = None,
    open_browser: bool = False,
    verbose: bool = False,
    result: JsonOptions,
) -> None:
    """Identify, validate, report and export the project of the working folder.

    The results go into a new folder of runs/, to which runs/latest points: report.html, parameters,
    robot files, and the saved run, from which `validate`, `report`, `export` and `compare` start.
    All projects below a folder that has none itself are run in processes, one per core, or on a
    cluster. The exit code is then the worst: 1 if one has no results, else 3 for --fail-on.

    Parameters
    ----------
    project
        The project file, its folder, or a folder with projects below it.
    executor
        Of several projects: dask:ADDRESS of the scheduler of a Dask cluster.
    open_browser
        Open the report in the browser.

    Examples
    --------
    seaid run --open
    seaid run leg/seaid.toml --fail-on wrong
    seaid run robots
    seaid run robots --executor dask:tcp://10.0.0.1:8786
    """
    if seaid.project.find_projects(project):
        refuse("it is for one project", "open_browser", "verbose")
        _run_all(project, executor, fail, result)
        return
    refuse("it is for a folder with several projects", "executor")
    loaded = seaid.load_project(project)
    done = seaid.run_project(loaded, command=command_line(), progress=is_terminal())
    logs = (log for run in done.runs.values() for log in run.identification.processing)
    texts = [str(x) for log in logs for x in log.repairs if x.kind == seaid.log.FOUND_CONTACT]
    for text in [*done.notes, *texts]:
        note(text)
    result.show(_text(done, verbose), _content(done), done.folder, **_facts(done))
    report = done.folder / "report.html"
    if open_browser and report.exists():
        click.launch(report.resolve().as_uri())
    fail.check(done.warnings, default=loaded.fail_on)


def _run_all(folder: Path, executor: str | None, fail: FailOptions, result: JsonOptions) -> None:
    """Run the projects below a folder, print how each ended, and exit with the worst code."""
    outcomes = seaid.project.run_projects(
        folder, executor=executor, command=command_line(), progress=is_terminal()
    )
    for text in chain(*([f"{x.project}: {text}" for text in x.notes] for x in outcomes)):
        note(text)
    rows = [(str(x.project), x.verdict, str(x.place or abridged(x.error))) for x in outcomes]
    result.show(seaid.report.named_table("projects", rows), {"projects": outcomes})
    if any(outcome.error for outcome in outcomes):
        click.get_current_context().exit(1)
    for outcome in outcomes:
        fail.check(outcome.warnings, default=outcome.fail_on)


def _text(done: seaid.project.ProjectRun, verbose: bool) -> str:

    parts = [
        f"Condition {name}\n" * bool(name) + seaid.project.summary_of(run, verbose)
        for name, run in done.runs.items()
    ]
    return "\n\n".join(parts + ([] if done.conditions is None else [done.conditions.summary()]))


def _facts(done: seaid.project.ProjectRun) -> dict[str, Any]:
    """Return robot and warnings, and the verdict of a project without conditions."""
    first, *others = done.runs.values()
    facts = judgement_of(first.identification, *first.tests)
    return facts if not others else {**facts, "verdict": None, "warnings": done.warnings}


def _content(done: seaid.project.ProjectRun) -> dict[str, Any]:
    return {
        "folder": done.folder,
        "files": done.files,
        "not_written": done.notes,
        "conditions": {
            name: {
                "parameters": seaid.export.content_of(run.identification),
                "validations": {log: each.to_dict() for log, each in run.validations.items()},
                "replays": {log: each.to_dict() for log, each in run.replays.items()},
            }
            for name, run in done.runs.items()
        },
    }
