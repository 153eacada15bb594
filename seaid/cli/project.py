"""Values of commands that are not on the line: those of the project file, and its newest run."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

import seaid
from seaid.cli.messages import note
from seaid.errors import SeaidWarning, listed

if TYPE_CHECKING:
    from seaid.project import Project

PROJECT_FILE = "seaid.toml"


def project_here() -> Project | None:
    """Return the project whose values are the defaults of the running command."""
    project: Project | None = click.get_current_context().meta.get("project")
    return project


def is_typed(*names: str) -> bool:
    """Return whether one of these parameters is on the command line."""
    return not click.get_current_context().meta["typed"].isdisjoint(names)


def with_project(
    context: click.Context, values: dict[str, Any], positional: Sequence[str]
) -> dict[str, Any]:
    """Return the arguments of a command, with those of its project where the line has none.

    The project is that of the working folder, for a line without a robot. `seaid identify run.csv`
    has the log where `seaid identify leg.urdf run.csv` has the robot: what is no robot moves on by
    one place.
    """
    name, typed = str(context.info_name), _typed(context, values)
    context.meta["typed"] = typed
    if "urdf" not in positional or name == "init":
        return values
    has_project = os.path.isfile(PROJECT_FILE)
    if "urdf" in typed and len(positional) > 1 and (has_project or values.get("run")):
        values = _moved(values, positional[1], typed)
    if "urdf" not in typed and has_project:
        project = context.meta["project"] = seaid.load_project(PROJECT_FILE)
        of_project = _of_command(name, project, values)
        values |= {key: of_project[key] for key in of_project.keys() - typed & values.keys()}
        note(f"robot, logs and options that the line does not have are from '{PROJECT_FILE}'")
    return values


def _typed(context: click.Context, names: Iterable[str]) -> set[str]:
    """Return the parameters that are on the command line."""
    sources = {name: context.get_parameter_source(name) for name in names}
    return {name for name, source in sources.items() if source and source.name == "COMMANDLINE"}


def _moved(values: dict[str, Any], after: str, typed: set[str]) -> dict[str, Any]:
    """Return the arguments with what is no robot, in its place, in that of `after`."""
    first, later = values["urdf"], values[after]
    is_name = not first.suffix and not os.path.exists(first)
    if first.suffix.lower() in seaid.robot.ROBOT_SUFFIXES or is_name:
        return values
    if not isinstance(later, tuple) and after in typed:
        return values
    typed.remove("urdf")
    typed.add(after)
    return {**values, "urdf": None, after: (first, *later) if isinstance(later, tuple) else first}


def _of_command(name: str, project: Project, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that a command has of the project."""
    from seaid._files import LATEST, followed

    defaults = _defaults(project)
    if name == "validate" and not values["cross"]:
        defaults["logs"] = defaults["validation"][:1]
    latest = project.folder / LATEST
    if (followed(latest) / seaid.project.FILE).exists() and not values.get("cross"):
        defaults["run"] = latest
    return {key: value for key, value in defaults.items() if value or value is False}


def _defaults(project: Project) -> dict[str, Any]:
    """Return {parameter of commands: its value in the project}."""
    names = ("drives", "joints", "locked", "gravity", "independent_mimics", "base", "imu_link")
    choices = ("torque_joints", "cutoff_hz", "method", "estimator", "encoder_offset_std")
    defaults: dict[str, Any] = {
        **{key: getattr(project, key) for key in (*names, "fail_on")},
        **{key: getattr(project.options, key) for key in (*choices, "known_std", "feasible")},
        "urdf": Path(project.urdf),
        "payload": project.payloads.get("", ()),
        "known_body": project.known_bodies,
        "contact": (project.contacts,) if project.contacts else (),
        "as_estimated": not project.options.feasible,
        "validation": _logs(project, "validate"),
    }
    if len(project.conditions) == 1:  # logs of several conditions are for seaid run
        defaults |= dict.fromkeys(("logs", "from_logs"), _logs(project, "identify"))
    return defaults


def _logs(project: Project, use: Literal["identify", "validate"]) -> tuple[Path, ...]:
    """Return the paths of the logs of a use."""
    return tuple(log.path for log in project.logs_for(use))


def warn_of_changes(run: Path, provenance: Mapping[str, Any]) -> None:
    """Warn if an input of a run has changed since."""
    if changed := seaid.report.changed_inputs(provenance):
        warnings.warn(
            f"{listed(changed)} changed since '{run}' was made: repeat seaid run, or give --from",
            SeaidWarning,
            stacklevel=2,
        )
