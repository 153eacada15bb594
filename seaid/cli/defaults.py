"""Defaults of the commands: the project file of the working folder, and its newest run."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from seaid.project import Project
    from seaid.robot import Contact, Payload

PROJECT_FILE = "seaid.toml"

_CONTEXT: ContextVar[typer.Context | None] = ContextVar("the running command", default=None)


def set_defaults(context: typer.Context, commands: Sequence[str]) -> None:
    """Take the project file of the working folder as defaults, if there is one."""
    from seaid.project import load_project

    project = load_project(PROJECT_FILE)
    values = _defaults(project)
    context.obj = project
    context.default_map = {name: _of_command(name, project, values) for name in commands}


def project_here() -> Project | None:
    """Return the project whose values are the defaults of the running command."""
    context = _CONTEXT.get()
    found: Project | None = None if context is None else context.obj
    return found


def _defaults(project: Project) -> dict[str, Any]:
    """Return {parameter of a command: default}, in the form of the command line."""
    from seaid._files import LATEST, followed
    from seaid.project import FILE

    given = project.options
    found: dict[str, Any] = {
        "urdf": str(project.urdf),
        "drives": _text(project.drives),
        "joints": _list(project.joints),
        "payload": [payload_text(one) for one in project.payloads.get("", ())],
        "gravity": ",".join(f"{one:.17g}" for one in project.gravity),
        "known_body": list(project.known_bodies),
        "independent_mimics": project.independent_mimics or None,
        "base": project.base,
        "contact": [contact_text(one) for one in project.contacts],
        "imu_link": project.imu_link,
        "torque_joints": _list(given.torque_joints),
        "cutoff_hz": given.cutoff_hz,
        "method": given.method,
        "estimator": given.estimator,
        "encoder_offset_std": given.encoder_offset_std,
        "known_std": ",".join(f"{name}={std:.17g}" for name, std in given.known_std.items()),
        "feasible": given.feasible,
        "fail_on": project.fail_on,
        "validation": [str(one.path) for one in project.logs_for("validate")],
    }
    if len(project.conditions) == 1:  # logs of several conditions are for seaid run
        logs = [str(one.path) for one in project.logs_for("identify")]
        found |= {"logs": logs, "from_logs": logs}
    latest = project.folder / LATEST
    if (followed(latest) / FILE).exists():
        found["run"] = str(latest)
    return {name: value for name, value in found.items() if value not in (None, "", [])}


def _of_command(name: str, project: Project, values: Mapping[str, Any]) -> dict[str, Any]:
    unseen = project.logs_for("validate")
    return {**values, "log": str(unseen[0].path)} if name == "validate" and unseen else dict(values)


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _list(names: Sequence[str] | None) -> str | None:
    return None if names is None else ",".join(names)


def payload_text(payload: Payload) -> str:
    """Return a payload as the command line has it."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = payload.inertia
    numbers = [",".join(f"{one:.17g}" for one in payload.com)]
    if any((xx, yy, zz)):
        numbers.append(",".join(f"{one:.17g}" for one in (xx, yy, zz, xy, xz, yz)))
    return ":".join([payload.link, f"{payload.mass:.17g}", *numbers])


def contact_text(contact: Contact) -> str:
    """Return a contact as the command line has it."""
    place = ",".join(f"{one:.17g}" for one in contact.position_m)
    more = ["flat"] * contact.is_flat
    more += [f"radius={contact.radius_m:.17g}"] if contact.radius_m else []
    return ":".join([contact.link, place, *more])


def with_project(
    context: typer.Context, values: dict[str, Any], positional: Sequence[str]
) -> dict[str, Any]:
    """Return the arguments of a command with the robot of the project, if the line names none.

    `seaid identify run.csv` has the log where `seaid identify leg.urdf run.csv` has the robot: what
    is no robot moves on by one place.
    """
    _CONTEXT.set(context)
    first = values.get("urdf")
    moves = is_typed("urdf") and first is not None and len(positional) > 1 and not _is_robot(first)
    if not moves or not (context.obj or values.get("run")):
        return values
    after = positional[1]
    later = values[after]
    if not is_typed(after):
        later = None
    if isinstance(later, list | tuple) or after.endswith("s"):
        later = [first, *(later or ())]
    elif later is None:
        later = first
    else:
        return values
    return {**values, "urdf": context.obj and Path(context.obj.urdf), after: later}


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
