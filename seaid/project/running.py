"""A run of a project: identify, validate, report and export, into a folder of its own.

Several projects run in processes. Those of this machine are of loky, as for the starts of a search:
they need no main guard in a script, and it is noticed when one dies. Each has one thread of linear
algebra, so that results do not depend on who computes them.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar, get_args

from seaid._arrays import FrozenMapping
from seaid._files import (
    PROJECT_FILE,
    owned_folder,
    plain,
    point_latest,
    result_folder,
    write_json,
    write_whole,
)
from seaid._progress import Display, value_text
from seaid.checks.verdict import Level
from seaid.errors import (
    Finding,
    SeaidError,
    SeaidWarning,
    Severity,
    by_severity,
    checked,
    listed,
    reason_of,
)
from seaid.excitation.search import run_all
from seaid.identification import (
    Conditions,
    Identification,
    Validation,
    identify,
    identify_conditions,
    validate,
    verdict_with,
)
from seaid.identification.conditions import CONDITION_SPECIFIC
from seaid.log import Log
from seaid.project.project import Options, Project, check_logs, load_project, refusal
from seaid.project.saved import FILE, Run, save_run
from seaid.report import facts_of, provenance_of
from seaid.report.provenance import package_versions
from seaid.simulation import ReplayComparison, compare_replays

Test = TypeVar("Test", Validation, ReplayComparison)

_INPUTS = "inputs"
"""The folder of the copies of the inputs in that of a run."""


@dataclass(frozen=True, eq=False, repr=False)
class ProjectRun(Display):
    """A finished run of a project.

    Attributes
    ----------
    folder : Path
        The folder with all results.
    runs : mapping {condition: Run}
        One run if the project has no conditions, by "".
    conditions : Conditions or None
        The comparison of the conditions, where there are several.
    files : tuple of Path
        The results.
    notes : tuple of str
        Results that could not be written, and logs that do not validate, with the reason.
    """

    folder: Path
    runs: Mapping[str, Run]
    conditions: Conditions | None
    files: tuple[Path, ...]
    notes: tuple[str, ...]

    def _in_short(self) -> str:
        return f"'{self.folder}': {', '.join(repr(run) for run in self.runs.values())}"

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """The warnings of all conditions, the worst first."""
        parts = chain(*([run.identification, *run.tests] for run in self.runs.values()))
        return by_severity([finding for part in parts for finding in part.warnings])


@checked(SeaidError)
def run_project(
    project: Project | str | Path = ".", *, command: Sequence[str] = (), progress: bool = False
) -> ProjectRun:
    """Identify, validate, report and export a project, into a new folder of its runs.

    The folder has the name of the time; the link `latest` points to the newest. The folder appears
    when it is complete; folders that killed runs have left are removed first. Logs of several
    conditions are identified together, and each condition has a folder of its own.

    Parameters
    ----------
    project : Project, str or Path
        A project of `load_project`, its file, or the folder of the file.
    command : sequence of str
        The command line, for the provenance.
    progress : bool
        Show progress bars.

    Returns
    -------
    ProjectRun

    Raises
    ------
    SeaidError
        As `load_robot`, `read_log` and `identify`, and if the folder cannot be written.

    Examples
    --------
    >>> done = seaid.run_project("seaid.toml")  # or its folder
    >>> print(done.runs[""].identification.summary())
    """
    project = project if isinstance(project, Project) else load_project(project)
    check_logs(project)
    result_folder(project.folder)
    fits, together = _identified(project, progress)
    notes: list[str] = []
    provenance = provenance_of(project.files, _options(project), command)
    places = dict(zip(fits, map(_file_name, fits) if together else [""], strict=True))
    with owned_folder(project.folder) as folder:
        runs: dict[str, Run] = {}
        for name, fit in fits.items():
            refusals: list[str] = []
            unseen = _unseen_logs(project, name)
            validations = _results(unseen, partial(validate, fit), "validated", refusals)
            moved = unseen if fit.robot.has_controllers else {}
            replay = partial(compare_replays, fit.known, fit.robot, held_joints=fit.unusable_joints)
            replays = _results(moved, replay, "replayed", refusals)
            # Without a folder: it has its name only after the rename.
            runs[name] = Run(fit, validations, {**provenance, "notes": refusals}, None, replays)
            notes += refusals
            notes += _write(project, runs[name], result_folder(folder / places[name]))
        files = [path.relative_to(folder) for path in sorted(folder.rglob("*")) if path.is_file()]
        _copy_inputs(project, folder)
        # A rename is atomic: nobody sees a folder of a run that is half written.
        target = _renamed(folder, project.folder)
    try:
        point_latest(target)
    except SeaidError as problem:  # the results are there
        notes.append(str(problem))
    runs = {name: replace(run, folder=target / places[name]) for name, run in runs.items()}
    results = tuple(target / file for file in files)
    return ProjectRun(target, FrozenMapping(runs), together, results, tuple(notes))


@dataclass(frozen=True, repr=False)
class Outcome(Display):
    """How the run of a project ended.

    Attributes
    ----------
    project : Path
        The folder of the project.
    verdict : {"good", "usable with care", "do not use", "failed"}
        The worst one of all conditions.
    place : Path or None
        The report, or the folder of a run without one; None after an error.
    error : str
        Why the project has no results, empty if it has.
    warnings : tuple of Finding
    notes : tuple of str
        Those of `ProjectRun`, and warnings of the process.
    fail_on : {"wrong", "doubtful", "note"} or None
        That of the project.
    """

    project: Path
    verdict: str = "failed"
    place: Path | None = None
    error: str = ""
    warnings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    fail_on: Severity | None = None


def find_projects(folder: str | Path) -> tuple[Path, ...]:
    """Return the folders below one that have a project file, none if it has one itself.

    Projects within projects do not count, nor do copies of project files in the folders of runs.
    """
    projects: list[Path] = []
    for place, folders, files in os.walk(folder):
        if PROJECT_FILE in files:
            projects.append(Path(place))
            folders.clear()
        if _INPUTS in folders and any(Path(place).glob(f"**/{FILE}")):
            folders.remove(_INPUTS)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
    return () if projects == [Path(folder)] else tuple(projects)


@checked(SeaidError)
def run_projects(
    folder: str | Path,
    *,
    executor: str | None = None,
    command: Sequence[str] = (),
    progress: bool = False,
) -> tuple[Outcome, ...]:
    """Run all projects below a folder, each in a process with one thread.

    The results of each are those of `run_project`, wherever it runs. What is wrong with a project
    is in its outcome, and the others are run. A project whose process is killed is run again, into
    another folder if its first run was complete by then.

    Parameters
    ----------
    folder : str or Path
        The folder; with a cluster all its machines must have it at the same place.
    executor : str, optional
        "dask:ADDRESS" of the scheduler of a Dask cluster (`pip install 'seaid[dask]'`), whose
        workers have one thread each. Default: processes of this machine, one per core.
    command : sequence of str
        The command line, for the provenance.
    progress : bool
        Print a line on stderr when a project has ended.

    Returns
    -------
    tuple of Outcome
        In the order of the names of their folders.

    Raises
    ------
    SeaidError
        If there is no project below the folder, and for a cluster that does not answer, or has
        other versions of seaid or its libraries.

    Examples
    --------
    >>> for outcome in seaid.project.run_projects("robots"):
    ...     print(outcome.project, outcome.verdict, outcome.place, outcome.error)
    """
    projects = find_projects(folder)
    if not projects:
        raise SeaidError(f"no folder below '{folder}' has a {PROJECT_FILE}: seaid init writes one")

    def done(number: int, x: Outcome) -> None:
        if progress:
            print(f"{number} of {len(projects)}: {x.project}: {x.verdict}", file=sys.stderr)

    def lost(number: int, problem: BaseException) -> Outcome:
        # TerminatedWorkerError, KilledWorker: a process was ended from outside each time.
        return Outcome(projects[number], error=f"{type(problem).__name__}: {reason_of(problem)}")

    # Processes have working folders of their own.
    tasks = [(project, project.absolute(), tuple(command)) for project in projects]
    with nullcontext() if executor is None else _cluster(executor) as machines:
        outcomes, _ = run_all(_outcome, tasks, machines, done, lost)
    ended = {outcome.project: outcome for outcome in outcomes}
    return tuple(ended.get(x, Outcome(x, error="interrupted before its end")) for x in projects)


def _outcome(name: Path, place: Path, command: Sequence[str]) -> Outcome:
    """Run a project at its place, and return how that ended."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SeaidWarning)
        try:
            project = load_project(place)
            done = run_project(project, command=command)
        except SeaidError as problem:
            return Outcome(name, error=str(problem))
    notes = [str(each.message) for each in caught if issubclass(each.category, SeaidWarning)]
    levels = [verdict_with(x.identification, x.tests).level for x in done.runs.values()]
    report = done.folder / "report.html"
    return Outcome(
        name,
        verdict=max(levels, key=get_args(Level).index),
        place=report if report.exists() else done.folder,
        warnings=done.warnings,
        notes=(*done.notes, *notes),
        fail_on=project.fail_on,
    )


@contextmanager
def _cluster(executor: str, patience_s: float = 5.0) -> Iterator[Executor]:
    """Yield the executor of a cluster whose workers have what is installed here.

    Its scheduler has to answer within `patience_s`; one in a local network takes milliseconds.
    """
    kind, _, address = executor.partition(":")
    if kind != "dask" or not address:
        raise refusal("no_executor", executor=value_text(executor))
    try:
        client = import_module("distributed").Client(address, timeout=patience_s)
    except ImportError:
        raise refusal("no_dask", executor=executor) from None
    except (OSError, ValueError) as problem:
        reason = reason_of(problem)
        raise refusal("silent", address=address, patience=patience_s, reason=reason) from None
    with client:
        if set(client.nthreads().values()) != {1}:
            raise refusal("many_threads", address=address)
        installed = client.run(package_versions, on_error="return")
        others = [worker for worker in installed if installed[worker] != package_versions()]
        if others:
            raise refusal("other_versions", worker=others[0], versions=package_versions())
        yield client.get_executor()


def _file_name(name: str) -> str:
    """Return the name of a condition or a robot as that of a folder or file."""
    return re.sub(r"[^\w.-]", "_", name).strip(".")[:_LONGEST_NAME] or "without_name"


_LONGEST_NAME = 50
"""Letters of a file's name before its suffixes, of up to four bytes; file systems have 255."""


def _identified(
    project: Project, progress: bool
) -> tuple[dict[str, Identification], Conditions | None]:
    """Return the identification of each condition, and their comparison if there are several."""
    options = project.options
    if len(project.conditions) > 1:
        _check_together(project)
    read = {
        name: (robot, [log.read(robot) for log in project.logs_for("identify", name)])
        for name in project.conditions
        for robot in [project.robot(name)]
    }
    alone = ("method", "refine", "condition_specific")
    shared = {name: x for name, x in vars(options).items() if name not in alone}
    shared["progress"] = progress
    if len(read) > 1:
        specific = options.condition_specific or CONDITION_SPECIFIC
        together = identify_conditions(read, condition_specific=specific, **shared)
        return dict(together.identifications), together
    ((name, (robot, logs)),) = read.items()
    fit = identify(robot, logs, method=options.method, **shared)
    if options.refine:
        from seaid.identification import refine

        fit = refine(fit, logs, encoder_offset_std=options.encoder_offset_std, progress=progress)
    return {name: fit}, None


def _check_together(project: Project) -> None:
    """Raise SeaidError for options that are for logs of one condition."""
    options, default = project.options, Options()
    alone = [x for x in ("method", "refine") if getattr(options, x) != getattr(default, x)]
    for name in [*alone, *['estimator = "iv"'] * (options.estimator == "iv")]:
        raise refusal("of_one_condition", file=project.file, name=name)
    folders = {_file_name(condition).casefold() for condition in project.conditions}
    if len({*folders, _INPUTS}) <= len(project.conditions):
        names = listed(project.conditions)
        raise refusal("no_folder_names", file=project.file, names=names, inputs=_INPUTS)


def _unseen_logs(project: Project, condition: str) -> dict[str, Log]:
    """Return {path: log} of the logs that validate a condition."""
    robot = project.robot(condition)
    # A log without a condition validates every one.
    sources = [x for x in project.logs_for("validate") if x.condition in (condition, "")]
    return {os.path.relpath(x.path, project.file.parent): x.read(robot) for x in sources}


def _results(
    logs: Mapping[str, Log], test: Callable[[Log], Test], done: str, notes: list[str]
) -> dict[str, Test]:
    """Return {log: result} of a test; adds a note for each log that gives none."""
    results = {}
    for name, log in logs.items():
        try:
            results[name] = test(log)
        except SeaidError as problem:
            notes.append(f"{name} was not {done}: {problem}")
    return results


def _options(project: Project) -> dict[str, Any]:
    """Return the options that differ from their defaults, with payloads and gravity."""
    default = vars(Options())
    changed = {name: x for name, x in vars(project.options).items() if x != default[name]}
    by_condition = project.payloads.items()
    changed |= {f"payloads {name}".strip(): plain(loads) for name, loads in by_condition}
    return {**changed, "gravity": plain(project.gravity)}


def _write(project: Project, run: Run, folder: Path) -> list[str]:
    """Write the results of one condition, and return what could not be written."""
    from seaid.export import write_model, write_parameters
    from seaid.report import write_report

    fit, robot = run.identification, run.identification.robot
    tests: dict[str, Any] = {"validations": run.validations, "replays": run.replays}
    save_run(fit, folder / FILE, provenance=run.provenance, **tests)
    write_json(folder / "provenance.json", run.provenance)
    write_whole(folder / "summary.txt", summary_of(run) + "\n")
    if "parameters" in project.write:
        # parameters.json has one validation, the first of the project file.
        first = next(iter(run.validations.values()), None)
        write_parameters(fit, folder / "parameters.json", first)
    if "report" in project.write:
        facts = {**project.experiment, **facts_of(run.provenance)}
        moved, results = list(run.replays.values()), list(run.validations.values())
        page, unread = folder / "report.html", run.provenance["notes"]
        write_report(fit, page, results, facts=facts, replays=moved, notes=unread)
    stem, notes = _file_name(robot.name), []
    for kind, name in (("urdf", f"{stem}.urdf"), ("mjcf", f"{stem}.xml")):
        if kind in project.write:
            try:
                write_model(robot, folder / name)
            except SeaidError as problem:
                notes.append(f"{name} was not written: {problem}")
    return notes


def summary_of(run: Run, details: bool = True) -> str:
    """Return an identification and its validations as text, with all tables or the first ones."""
    from seaid.report import short_text

    fit = run.identification
    parts = [str(short_text(fit, fit.nominal or fit.known, details))]
    for tests in (run.validations, run.replays):
        parts += [f"Log {name}\n{test.summary()}" for name, test in tests.items()]
    return "\n\n".join(parts)


def _copy_inputs(project: Project, folder: Path) -> None:
    """Copy the project file, the robot and its drives: small texts that a run rests on."""
    inputs = result_folder(folder / _INPUTS)
    for path in (project.file, project.urdf, project.drives):
        if isinstance(path, Path) and path.is_file():
            shutil.copyfile(path, inputs / path.name)


def _renamed(folder: Path, parent: Path) -> Path:
    """Give a complete folder the name of the time, and return it."""
    stamp = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    for number in range(1, 1000):
        target = parent / (stamp if number == 1 else f"{stamp}_{number}")
        # Another process may take the name of the same second: a rename replaces no run.
        with suppress(OSError):
            os.rename(folder, target)
            return target
    raise SeaidError(f"'{parent}' can have no further run of this second")
