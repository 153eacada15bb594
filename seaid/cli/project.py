"""Values of commands that are not on the line: those of the project file, and its newest run."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

import seaid
from seaid.cli.messages import note
from seaid.errors import SeaidWarning, listed

if TYPE_CHECKING:
    from seaid.project import Project

PROJECT_FILE = "seaid.toml"

_CONTEXT: ContextVar[typer.Context | None] = ContextVar("the running command", default=None)


def project_here() -> Project | None:
    """Return the project whose values are the defaults of the running command."""
    context = _CONTEXT.get()
    return context.obj if context is not None else None


def _defaults(project: Project) -> dict[str, Any]:
    """Return {parameter of a command: default}."""
    from seaid._files import LATEST, followed

    names = ("drives", "joints", "locked", "gravity", "independent_mimics", "base", "imu_link")
    choices = ("torque_joints", "cutoff_hz", "method", "estimator", "encoder_offset_std")
    defaults: dict[str, Any] = {
        **{name: getattr(project, name) for name in (*names, "fail_on")},
        **{name: getattr(project.options, name) for name in (*choices, "known_std", "feasible")},
        "urdf": Path(project.urdf),
        "payload": project.payloads.get("", ()),
        "known_body": project.known_bodies,
        "contact": [project.contacts] if project.contacts else (),
        "as_estimated": not project.options.feasible,
        "validation": _logs(project, "validate"),
    }
    if len(project.conditions) == 1:  # logs of several conditions are for seaid run
        defaults |= dict.fromkeys(("logs", "from_logs"), _logs(project, "identify"))
    latest = project.folder / LATEST
    if (followed(latest) / seaid.project.FILE).exists():
        defaults["run"] = latest
    return {name: value for name, value in defaults.items() if value or value is False}


def _of_command(name: str, project: Project, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the defaults of a command, without those that it does not use."""
    defaults = _defaults(project)
    if name == "validate" and not values.get("cross"):
        defaults["logs"] = defaults.get("validation", [])[:1]
    if (name == "identify" and not values.get("refine")) or values.get("cross"):
        defaults.pop("run", None)
    if values.get("condition"):
        defaults.pop("logs", None)
    return {key: value for key, value in defaults.items() if key in values and not is_typed(key)}


def _logs(project: Project, use: Literal["identify", "validate"]) -> list[Path]:
    """Return the paths of the logs of a use."""
    return [log.path for log in project.logs_for(use)]


def with_project(
    context: typer.Context, values: dict[str, Any], positional: Sequence[str]
) -> dict[str, Any]:
    """Return the arguments of a command, with those of its project where the line has none.

    `seaid identify run.csv` has the log where `seaid identify leg.urdf run.csv` has the robot: what
    is no robot moves on by one place. `seaid check FOLDER` has a project in that place.
    """
    _CONTEXT.set(context)
    name = str(context.info_name)
    project = context.obj = _project_of(name, values)
    first = values.get("urdf")
    if project is not None:
        defaults = _of_command(name, project, values)
        values = {**values, **defaults}
        if "urdf" in positional:
            _note_of_project(context, project, defaults)
    if first is None or _is_robot(first) or not (project or values.get("run")):
        return values
    if project is not None and _project_file(first):
        return {**values, "urdf": Path(project.urdf)}
    return values if len(positional) < 2 else _moved(values, positional[1], project)


def _note_of_project(context: typer.Context, project: Project, defaults: Mapping[str, Any]) -> None:
    """Print in one line what a command has from a project file."""
    usual = {**_defaults(seaid.project.Project(project.file, "")), "feasible": False}
    names = [
        parameter.opts[0] if parameter.opts[0].startswith("-") else str(parameter.metavar)
        for parameter in context.command.params
        if defaults.get(str(parameter.name)) != usual.get(str(parameter.name))
        and parameter.name in defaults
    ]
    if names:
        note(f"from '{project.file}': {', '.join(names)}")


def _moved(values: dict[str, Any], after: str, project: Project | None) -> dict[str, Any]:
    """Return the arguments with what is in the place of the robot in that of `after`."""
    first, later = values["urdf"], values[after] if is_typed(after) else None
    if isinstance(later, list | tuple) or after.endswith("s"):
        later = [first, *(later or ())]
    elif later is None:
        later = first
    else:
        return values
    return {**values, "urdf": project and Path(project.urdf), after: later}


def _project_file(first: Path) -> bool:
    """Return whether a path in the place of the robot is a project file or its folder."""
    # Of names that are too long `os.path` says that they are no files; those of `Path` raise.
    return first.name == PROJECT_FILE or os.path.isfile(first / PROJECT_FILE)


def _project_of(name: str, values: Mapping[str, Any]) -> Project | None:
    """Return the project in the place of the robot of a command, else that of the working folder.

    The latter only if its robot is that of the line, or the line names none.
    """
    from seaid._files import real_path

    if name in ("init", "run"):
        return None
    first = values.get("urdf") if is_typed("urdf") else None
    if first is not None and _project_file(first):
        return seaid.load_project(first)
    if not os.path.isfile(PROJECT_FILE):
        return None
    project = seaid.load_project(PROJECT_FILE)
    robot = first if first is not None and _is_robot(first) else _robot_of_run(project, values)
    if robot is None or real_path(robot) == real_path(project.urdf):
        return project
    note(f"{PROJECT_FILE} is of another robot, '{project.urdf}', and is not used")
    return None


def _robot_of_run(project: Project, values: Mapping[str, Any]) -> Path | None:
    """Return the robot of the saved run on the line, None for one of the project."""
    from seaid._files import real_path

    if not is_typed("run") or real_path(values["run"]).is_relative_to(real_path(project.folder)):
        return None
    return seaid.project.load_run(values["run"]).identification.robot.urdf


def _is_robot(path: Path) -> bool:
    is_name = not path.suffix and not os.path.exists(path)
    return path.suffix.lower() in seaid.robot.ROBOT_SUFFIXES or is_name


def is_typed(*names: str) -> bool:
    """Return whether one of these parameters is on the command line."""
    context = _CONTEXT.get()
    sources = (context.get_parameter_source(name) for name in names) if context else ()
    return any(source is not None and source.name == "COMMANDLINE" for source in sources)


def warn_of_changes(run: Path, provenance: Mapping[str, Any]) -> None:
    """Warn if an input of a run has changed since."""
    if changed := seaid.project.changed_inputs(provenance):
        warnings.warn(
            f"{listed(changed)} changed since '{run}' was made: repeat seaid run, or give --from",
            SeaidWarning,
            stacklevel=2,
        )
