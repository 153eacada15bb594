"""What the shell offers on TAB: values of options, joints and links of the URDF, files by suffix.

Nothing heavy is imported here, since it runs with every TAB.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from seaid.errors import SEVERITIES

Completer = Callable[[Any, str], list[str]]

LOGS = (
    *(".csv", ".txt", ".tsv", ".dat", ".npy", ".npz", ".parquet", ".h5", ".hdf5", ".json", ".mat"),
    *(".db3", ".mcap", ".bag", ".hebilog"),
)
CHOICES = {
    "estimator": ("ols", "wls", "huber", "tukey", "iv"),
    "method": ("two-step", "simultaneous"),
    "basis": ("bspline", "polynomial", "fourier", "multisine"),
    "criterion": ("condition_number", "d_optimality", "relative_error"),
    "fail_on": SEVERITIES,
}
"""Values of the options with few values, which are those of the types of the library."""

SENSORS = (
    *("motor_position", "joint_position", "motor_torque", "motor_current", "motor_voltage"),
    *("joint_torque", "deflection"),
)
FILES = {
    "urdf": (".urdf",),
    "drives": (".toml",),
    "nominal": (".toml", ".urdf", ".xml"),
    "description": (".toml",),
    **dict.fromkeys(("logs", "log", "from_logs", "validation", "multisine"), LOGS),
    **dict.fromkeys(("trajectory", "parameters", "plan", "plans"), (".json",)),
    **dict.fromkeys(("first", "second"), (".json", ".npz")),
    "randomization": (".json", ".yaml"),
    "previous_logs": LOGS,
    "project": (".toml",),
    "table": LOGS,
    "run": (".npz",),
    "package_dir": (),
}
"""{argument: suffixes of its files}; folders are offered too."""

JOINT_LISTS = ("joints", "torque_joints", "of")
BY_JOINT = (
    *("lower", "upper", "velocity", "acceleration", "joint_torque", "motor_torque", "motor_speed"),
    *("deflection", "torque_std", "motor_resolution", "joint_resolution", "motor_offset"),
    *("joint_offset", "position_gain", "velocity_gain"),
)
"""Options of the form knee=2,hip=1."""


def completer_of(name: str) -> Completer | None:
    """Return what completes an argument or option of this name, None for the shell's own way."""
    if name in CHOICES:
        return _from(lambda context: CHOICES[name])
    if name in FILES:
        return lambda ctx, incomplete: files(incomplete, FILES[name])
    if name in JOINT_LISTS:
        return _from(lambda context: _names(context, "joint"), commas=True)
    if name in BY_JOINT:
        return _from(lambda context: [f"{one}=" for one in _names(context, "joint")], commas=True)
    if name == "sensors":
        return _from(lambda context: SENSORS, commas=True)
    if name == "known_body":
        return _from(lambda context: _names(context, "link"))
    if name == "payload":
        return _from(lambda context: [f"{one}:" for one in _names(context, "link")])
    return None


def _from(values: Callable[[Any], Iterable[str]], commas: bool = False) -> Completer:
    """Return what completes a value, or with `commas` the last one of a list."""

    def complete(ctx: Any, incomplete: str) -> list[str]:  # Typer looks at these names
        before, comma, _ = incomplete.rpartition(",") if commas else ("", "", incomplete)
        taken = before.split(",")
        return [before + comma + one for one in values(ctx) if one not in taken]

    return complete


def _names(context: Any, kind: str) -> list[str]:
    """Return the joints that may move, or the links, of the URDF on the line."""
    from xml.etree import ElementTree

    # the parser leaves positional arguments in `args` where the last option has no value yet
    path = context.params.get("urdf") or next(iter(context.args), "")
    try:
        found = ElementTree.parse(path).getroot().findall(kind)
    except (OSError, ValueError, ElementTree.ParseError):
        return []
    return [one.get("name", "") for one in found if one.get("type") != "fixed"]


def files(text: str, suffixes: tuple[str, ...]) -> list[str]:
    """Return folders and files with these suffixes that begin with a text.

    The content of a folder comes with it if nothing else matches, so that no shell adds a space.
    """
    folder, start = os.path.split(text)
    try:
        there = sorted(os.scandir(Path(folder).expanduser()), key=lambda one: one.name)
    except OSError:
        return []
    found = [
        os.path.join(folder, one.name) + ("/" if one.is_dir() else "")
        for one in there
        if one.name.startswith(start) and (start or not one.name.startswith("."))
        if one.is_dir() or Path(one.name).suffix.lower() in suffixes
    ]
    if len(found) == 1 and found[0].endswith("/"):
        return [found[0], *files(found[0], suffixes)]
    return found
