"""Defaults of the commands: the project file of their robot, and its newest run."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from seaid.cli.messages import note

if TYPE_CHECKING:
    from seaid.project import Project
    from seaid.robot import Contact, Payload

PROJECT_FILE = "seaid.toml"

_CONTEXT: ContextVar[typer.Context | None] = ContextVar("the running command", default=None)


def project_here() -> Project | None:
    """Return the project whose values are the defaults of the running command."""
    context = _CONTEXT.get()
    project: Project | None = None if context is None else context.obj
    return project


def _defaults(project: Project) -> dict[str, Any]:
    """Return {parameter of a command: default}, in the form of the command line."""
    from seaid._files import LATEST, followed
    from seaid.project import FILE

    options = project.options
    defaults: dict[str, Any] = {
        "urdf": str(project.urdf),
        "drives": _text(project.drives),
        "joints": _list(project.joints),
        "locked": _assigned(project.locked),
        "payload": [payload_text(payload) for payload in project.payloads.get("", ())],
        "gravity": ",".join(f"{component:.17g}" for component in project.gravity),
        "known_body": list(project.known_bodies),
        "independent_mimics": project.independent_mimics or None,
        "base": project.base,
        "contact": [contact_text(contact) for contact in project.contacts],
        "imu_link": project.imu_link,
        "torque_joints": _list(options.torque_joints),
        "cutoff_hz": options.cutoff_hz,
        "method": options.method,
        "estimator": options.estimator,
        "encoder_offset_std": options.encoder_offset_std,
        "known_std": _assigned(options.known_std),
        "feasible": options.feasible,
        "fail_on": project.fail_on,
        "validation": _logs(project, "validate"),
    }
    if len(project.conditions) == 1:  # logs of several conditions are for seaid run
        defaults |= dict.fromkeys(("logs", "from_logs"), _logs(project, "identify"))
    latest = project.folder / LATEST
    if (followed(latest) / FILE).exists():
        defaults["run"] = str(latest)
    return {name: value for name, value in defaults.items() if value not in (None, "", [])}


def _of_command(name: str, project: Project, values: Mapping[str, Any]) -> dict[str, Any]:
    unseen = _logs(project, "validate")
    return {**values, "log": unseen[0]} if name == "validate" and unseen else dict(values)


def _logs(project: Project, use: Literal["identify", "validate"]) -> list[str]:
    """Return the paths of the logs of a use."""
    return [str(log.path) for log in project.logs_for(use)]


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _list(names: Sequence[str] | None) -> str | None:
    return None if names is None else ",".join(names)


def _assigned(numbers: Mapping[str, float]) -> str:
    """Return {name: number} as the command line has it, as in torso=0.3,head=0.1."""
    return ",".join(f"{name}={number:.17g}" for name, number in numbers.items())


def payload_text(payload: Payload) -> str:
    """Return a payload as the command line has it."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = payload.inertia
    numbers = [",".join(f"{number:.17g}" for number in payload.com)]
    if any((xx, yy, zz)):
        numbers.append(",".join(f"{number:.17g}" for number in (xx, yy, zz, xy, xz, yz)))
    return ":".join([payload.link, f"{payload.mass:.17g}", *numbers])


def contact_text(contact: Contact) -> str:
    """Return a contact as the command line has it."""
    place = ",".join(f"{coordinate:.17g}" for coordinate in contact.position_m)
    more = ["flat"] * contact.is_flat
    more += [f"radius={contact.radius_m:.17g}"] if contact.radius_m else []
    return ":".join([contact.link, place, *more])


def with_project(
    context: typer.Context, values: dict[str, Any], positional: Sequence[str]
) -> dict[str, Any] | None:
    """Return the arguments of a command; None if it ran with those of its project.

    `seaid identify run.csv` has the log where `seaid identify leg.urdf run.csv` has the robot: what
    is no robot moves on by one place. `seaid check FOLDER` has a project in that place.
    """
    _CONTEXT.set(context)
    project = context.obj
    if project is not None and "urdf" in positional:
        _note_of_project(context, project)
    elif project is None and _ran_with_project(context, values):
        return None
    first = values.get("urdf")
    if first is None or not is_typed("urdf"):
        return values
    if project is not None and _project_file(first):
        return {**values, "urdf": Path(project.urdf)}
    if len(positional) > 1 and not _is_robot(first) and (project or values.get("run")):
        return _moved(values, positional[1], project)
    return values


def _ran_with_project(context: typer.Context, values: Mapping[str, Any]) -> bool:
    """Run the command with the values of its project as defaults; return False without one."""
    if context.command.name in ("init", "run"):
        return False
    project, parent = _project_of(values), context.parent
    if project is None or parent is None:
        return False
    name = str(context.info_name)
    parent.obj = project
    parent.default_map = {name: _of_command(name, project, _defaults(project))}
    with context.command.make_context(name, [*parent.meta[ARGUMENTS]], parent=parent) as again:
        context.command.invoke(again)
    return True


ARGUMENTS = "seaid.arguments"
"""Where the context has the words that follow the command."""


def _note_of_project(context: typer.Context, project: Project) -> None:
    """Say in one line what a command has from a project file."""
    from seaid.project import Project

    usual = _defaults(Project(project.file, "")) | {"feasible": False}
    words = _defaults(project)
    names = []
    for parameter in context.command.params:
        source = context.get_parameter_source(str(parameter.name))
        is_usual = words.get(str(parameter.name)) == usual.get(str(parameter.name))
        if source is not None and source.name == "DEFAULT_MAP" and not is_usual:
            is_option = parameter.opts[0].startswith("-")
            names.append(parameter.opts[0] if is_option else str(parameter.metavar))
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


def _project_file(first: Path | None) -> bool:
    """Return whether a path in the place of the robot is a project file or its folder."""
    if first is None:
        return False
    return first.name == PROJECT_FILE or (first / PROJECT_FILE).is_file()


def _project_of(values: Mapping[str, Any]) -> Project | None:
    """Return the project in the place of the robot, else that of the working folder.

    The latter only if its robot is that of the line, or the line names none.
    """
    from seaid.project import load_project

    first = values.get("urdf") if is_typed("urdf") else None
    if first is not None and _project_file(first):
        return load_project(first)
    if not os.path.isfile(PROJECT_FILE):
        return None
    project = load_project(PROJECT_FILE)
    robot = first if first is not None and _is_robot(first) else _robot_of_run(project, values)
    if robot is None or _is_same(robot, project.urdf):
        return project
    note(f"{PROJECT_FILE} is of another robot, '{project.urdf}', and is not used")
    return None


def _robot_of_run(project: Project, values: Mapping[str, Any]) -> Path | None:
    """Return the robot of the saved run on the line, None for one of the project."""
    from seaid._files import real_path
    from seaid.project import load_run

    if not is_typed("run") or real_path(values["run"]).is_relative_to(real_path(project.folder)):
        return None
    return load_run(values["run"]).identification.robot.urdf


def _is_same(robot: Path, urdf: Path | str) -> bool:
    from seaid._files import real_path

    return str(robot) == str(urdf) or real_path(robot) == real_path(urdf)


def _is_robot(path: Path) -> bool:
    from seaid.robot import ROBOT_SUFFIXES

    is_name = not path.suffix and not path.exists()
    return path.suffix.lower() in ROBOT_SUFFIXES or is_name


def is_typed(*names: str) -> bool:
    """Return whether one of these parameters is on the command line."""
    context = _CONTEXT.get()
    sources = (context.get_parameter_source(name) for name in names) if context else ()
    return any(source is not None and source.name == "COMMANDLINE" for source in sources)


def warn_of_changes(run: Path, provenance: Mapping[str, Any]) -> None:
    """Warn if an input of a run has changed since."""
    from seaid.errors import SeaidWarning, listed
    from seaid.project import changed_inputs

    if changed := changed_inputs(provenance):
        warnings.warn(
            f"{listed(changed)} changed since '{run}' was made: repeat seaid run, or give --from",
            SeaidWarning,
            stacklevel=2,
        )
