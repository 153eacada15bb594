"""write_model: the identified robot in the format of a simulator, and what that format lacks.

`FORMATS` is the one table of formats: a format is a function and the effects that its files hold.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from seaid._files import from_template, write_whole
from seaid._progress import Display
from seaid.drives import total_ratio
from seaid.errors import Finding, RobotError, by_severity, checked, in_one_line
from seaid.export.joint_actuators import (
    JointActuator,
    actuators_of,
    limited_offsets,
    lost_effects,
    rounded_delays,
)
from seaid.export.mjcf import write_mjcf
from seaid.export.urdf import (
    Edit,
    Element,
    MoreEdits,
    with_content,
    with_start,
    without,
    write_edited,
)
from seaid.identification import Identification
from seaid.robot import Robot

FormatName = Literal["mjcf", "urdf", "isaaclab", "usd", "newton", "drake"]

_PER_DEGREE = math.pi / 180.0
"""USD has angles of joints in degrees: N m/rad times this is N m/degree."""


@dataclass(frozen=True)
class _Request:
    """What is written where.

    The robot is at its own temperature, because `write_mjcf` and `write_urdf` convert it; the
    actuators are those at `temperature_degC`.
    """

    robot: Robot
    actuators: tuple[JointActuator, ...]
    path: Path
    step_s: float
    force: bool
    temperature_degC: float | None


@dataclass(frozen=True, repr=False)
class WrittenModel(Display):
    """The file of a simulator.

    Attributes
    ----------
    path : Path
        The file.
    drives : Path or None
        The TOML of the drives next to a URDF.
    warnings : tuple of Finding
        What the format cannot hold, with what replaces it.
    notes : tuple of str
        How the file differs from the identified model otherwise.
    """

    path: Path
    drives: Path | None
    warnings: tuple[Finding, ...]
    notes: tuple[str, ...]


_Written = tuple[Path | None, tuple[str, ...]]
"""The TOML of the drives, or None, and the notes."""


@dataclass(frozen=True)
class Format:
    """A format: its title, the suffix of its files, its writer, and the `EFFECTS` it can hold.

    Where it `has_bodies`, these are in the file too. A delay `in_steps` is a whole number of time
    steps. Where it `limits_offsets`, its torque limit cuts off a friction offset too.
    """

    title: str
    suffix: str
    write: Callable[[_Request], _Written]
    holds: frozenset[str]
    has_bodies: bool = False
    in_steps: bool = False
    limits_offsets: bool = False


@checked(RobotError)
def write_model(
    identified: Identification | Robot,
    path: str | Path,
    format: FormatName | None = None,  # noqa: A002
    *,
    time_step_s: float = 0.005,
    force: bool = False,
    at_temperature_degC: float | None = None,
) -> WrittenModel:
    """Write a robot, or the actuators of its joints, for a simulator.

    Parameters
    ----------
    identified : Identification or Robot
    path : path
        The file to write.
    format : str, optional
        "mjcf" and "urdf" are `write_mjcf` and `write_urdf`. "drake" is the URDF with rotor
        inertias, gear ratios and gains for Drake. "isaaclab" is a Python file with a configuration
        per joint. "usd" and "newton" are layers over the USD stage of the robot, whose joints are
        at /<robot>/joints/<joint>. Default: by the suffix, mjcf for .xml, usd for .usda, urdf for
        others.
    time_step_s : float
        Time step [s] of the simulation, for formats in which delays are numbers of steps.
    force, at_temperature_degC
        As in `write_mjcf` and `write_urdf`.

    Returns
    -------
    WrittenModel
        Its `warnings` list what the format cannot hold, with what replaces it.

    Raises
    ------
    RobotError
        For values that are unknown, and as `write_mjcf` and `write_urdf` do.
    SeaidError
        If the file cannot be written.

    Examples
    --------
    >>> result = seaid.identify(robot, log, feasible=True)
    >>> written = seaid.write_model(result, "actuators.py", "isaaclab", time_step_s=0.005)
    >>> for finding in written.warnings:
    ...     print(finding.message, finding.remedy)
    """
    path = Path(path)
    if not (math.isfinite(time_step_s) and time_step_s > 0):
        raise RobotError(
            f"time_step_s= must be more than zero and finite, found {time_step_s}", "time_step_s="
        )
    reference = identified.robot if isinstance(identified, Identification) else identified
    robot = reference.at_temperature(at_temperature_degC)
    kind = FORMATS[format or by_suffix(path)]
    # The TOML has drives with unknown values as they are; every other format needs numbers.
    actuators = actuators_of(robot, is_complete=kind.write is not _urdf)
    request = _Request(reference, actuators, path, time_step_s, force, at_temperature_degC)
    drives, notes = kind.write(request)
    lost = lost_effects(robot, actuators, kind.title, kind.holds)
    if kind.limits_offsets:
        lost += limited_offsets(actuators)
    if kind.in_steps:
        lost += rounded_delays(actuators, time_step_s)
    if not kind.has_bodies:
        notes = (*notes, "the bodies are not in the file: --format urdf or mjcf has them")
    return WrittenModel(path, drives, by_severity(lost), notes)


def by_suffix(path: Path) -> FormatName:
    """Return the format that the suffix of a path stands for."""
    suffixes: Mapping[str, FormatName] = {".xml": "mjcf", ".usda": "usd"}
    return suffixes.get(path.suffix.lower(), "urdf")


def _number(value: float) -> str:
    """Return a number as text of Python, USD and JSON."""
    return f"{value:.9g}"


def _by_template(template: str) -> Callable[[_Request], _Written]:
    """Return the writer of a file that one of the templates in `seaid/export/files` has."""

    def write(request: _Request) -> _Written:
        text = from_template(
            "seaid.export",
            f"files/{template}",
            _FILTERS,
            robot=in_one_line(request.robot.name),
            actuators=request.actuators,
            step_s=request.step_s,
        )
        write_whole(request.path, text)
        return None, ()

    return write


def _per_angle(value: float, actuator: JointActuator) -> str:
    """Return what is per angle of a joint as USD has it, in degrees."""
    return _number(value if actuator.slides else value * _PER_DEGREE)


def _identifier(name: str) -> str:
    """Return a name as USD allows it: letters, digits and _, no digit first."""
    identifier = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return identifier if identifier and not identifier[0].isdigit() else f"_{identifier}"


_FILTERS: Mapping[str, Callable[..., str]] = {
    "number": _number,
    "per_angle": _per_angle,
    "identifier": _identifier,
    "pattern": re.escape,  # names are regular expressions in Isaac Lab
    "python": repr,
    "json": json.dumps,
}
"""How the templates write values."""


def _urdf(request: _Request, more: MoreEdits = None) -> _Written:
    r = request
    files = write_edited(r.robot, r.path, None, r.force, r.temperature_degC, more)
    return files.drives, files.notes


def _mjcf(request: _Request) -> _Written:
    r = request
    written = write_mjcf(r.robot, r.path, force=r.force, at_temperature_degC=r.temperature_degC)
    return None, written.notes


def _drake(request: _Request) -> _Written:
    """Write the URDF with the transmissions of Drake: gear ratio, rotor inertia, gains."""

    def more(text: bytes, root: Element) -> list[Edit]:
        names = {actuator.joint for actuator in request.actuators}
        transmissions = [child for child in root.children if child.tag == "transmission"]
        # A second transmission of a joint would be a second actuator.
        edits = [without(text, x) for x in transmissions if x.named("joint").keys() & names]
        # expat resolves namespaces and reports no xmlns attributes: only the text has them.
        if "xmlns:drake" not in root.attributes and b"xmlns:drake" not in text[: root.inside]:
            edits.append(with_start(text, root, {"xmlns:drake": "http://drake.mit.edu"}))
        return [*edits, with_content(text, root, map(_drake_transmission, request.actuators))]

    return _urdf(request, more)


def _drake_transmission(actuator: JointActuator) -> bytes:
    from xml.sax.saxutils import quoteattr  # which imports HTTP

    name = quoteattr(actuator.joint)
    inertia, ratio = actuator.drive.values["motor_inertia"], total_ratio(actuator.drive)
    p, d = _number(actuator.position_gain), _number(actuator.velocity_gain)
    has_gains = actuator.drive.controller is not None  # else its command is a force
    gains = f'<drake:controller_gains p="{p}" d="{d}"/>' if has_gains else ""
    return (
        f'<transmission type="SimpleTransmission" name={name}><joint name={name}/>'
        f'<actuator name={name}><drake:gear_ratio value="{_number(ratio)}"/>'
        f'<drake:rotor_inertia value="{_number(inertia)}"/>{gains}</actuator></transmission>'
    ).encode()


_PASSIVE = frozenset({"armature", "viscous friction", "dry friction"})
_ACTIVE = _PASSIVE | {"gains", "torque limit"}
_CONSTANT = frozenset({"friction offset", "feed-forward"})
_IN_MJCF = _ACTIVE | _CONSTANT | {"delay", "spring", "parallel spring", "coupled drives"}
_IN_TOML = _IN_MJCF | {"Stribeck friction", "other terms"}
"""Effects of a URDF together with the TOML of its drives, which seaid reads."""

_OF_DRAKE = frozenset({"armature", "viscous friction", "gains"})

FORMATS: Mapping[FormatName, Format] = {
    "mjcf": Format("MuJoCo", ".xml", _mjcf, _IN_MJCF, has_bodies=True),
    "urdf": Format("URDF with the TOML of its drives", ".urdf", _urdf, _IN_TOML, has_bodies=True),
    "isaaclab": Format(
        "Isaac Lab", ".py", _by_template("isaaclab.py.j2"), _ACTIVE | {"delay"}, in_steps=True
    ),
    "usd": Format("USD for PhysX", ".usda", _by_template("usd.usda.j2"), _ACTIVE),
    "newton": Format(
        "Newton",
        ".usda",
        _by_template("newton.usda.j2"),
        _ACTIVE | _CONSTANT | {"delay"},
        in_steps=True,
        limits_offsets=True,
    ),
    "drake": Format("Drake", ".urdf", _drake, _OF_DRAKE, has_bodies=True),
}
"""{name of a format: the format}."""
