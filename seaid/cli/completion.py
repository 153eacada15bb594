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
    "method": ("auto", "two-step", "simultaneous"),
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
        return _completer(lambda context: CHOICES[name])
    if name in FILES:
        return lambda ctx, incomplete: files(incomplete, FILES[name])
    if name in JOINT_LISTS:
        return _completer(lambda context: _names(context, "joint"), commas=True)
    if name in BY_JOINT:
        return _completer(lambda context: [f"{x}=" for x in _names(context, "joint")], commas=True)
    if name == "sensors":
        return _completer(lambda context: SENSORS, commas=True)
    if name == "known_body":
        return _completer(lambda context: _names(context, "link"))
    if name == "payload":
        return _completer(lambda context: [f"{x}:" for x in _names(context, "link")])
    return None


def _completer(values: Callable[[Any], Iterable[str]], commas: bool = False) -> Completer:
    """Return what completes a value, or with `commas` the last one of a list."""

    def complete(ctx: Any, incomplete: str) -> list[str]:  # Typer looks at these names
        before, comma, _ = incomplete.rpartition(",") if commas else ("", "", incomplete)
        taken = before.split(",")
        return [before + comma + value for value in values(ctx) if value not in taken]

    return complete


def _names(context: Any, kind: str) -> list[str]:
    """Return the joints that may move, or the links, of the URDF on the line."""
    from xml.etree import ElementTree

    # the parser leaves positional arguments in `args` where the last option has no value yet
    path = context.params.get("urdf") or next(iter(context.args), "")
    try:
        elements = ElementTree.parse(path).getroot().findall(kind)
    except (OSError, ValueError, ElementTree.ParseError):
        return []
    return [element.get("name", "") for element in elements if element.get("type") != "fixed"]


def files(text: str, suffixes: tuple[str, ...]) -> list[str]:
    """Return folders and files with these suffixes that begin with a text.

    The content of a folder comes with it if nothing else matches, so that no shell adds a space.
    """
    folder, start = os.path.split(text)
    try:
        entries = sorted(os.scandir(Path(folder).expanduser()), key=lambda entry: entry.name)
    except OSError:
        return []
    matches = [
        os.path.join(folder, entry.name) + "/" * entry.is_dir()
        for entry in entries
        if entry.name.startswith(start) and (start or not entry.name.startswith("."))
        if entry.is_dir() or Path(entry.name).suffix.lower() in suffixes
    ]
    if len(matches) == 1 and matches[0].endswith("/"):
        return [matches[0], *files(matches[0], suffixes)]
    return matches
