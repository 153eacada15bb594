"""Columns under our names, sorted into a Log; each joint needs the sensors of its drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.errors import LogError
from seaid.logs.log_columns import SENSORS, column_names, near_names
from seaid.logs.log_data import Log
from seaid.robot import Robot

_NEEDED = SENSORS[:4]
"""Those that a log from a file has in any case, all NaN where there is no such sensor."""


def log_of(
    path: Path,
    data: Mapping[str, Array],
    wanted: Mapping[str, tuple[str, float]],
    robot: Robot,
    file_names: Sequence[str],
) -> Log:
    """Return the log of columns of a file, under our names and in SI units."""
    picked = {name: data[foreign] * factor for name, (foreign, factor) in wanted.items()}
    try:
        return sorted_log(picked, robot, file_names)
    except LogError as problem:
        raise LogError(f"'{path}': {problem}") from None


def sorted_log(picked: dict[str, Array], robot: Robot, file_names: Sequence[str]) -> Log:
    """Return the log of columns {our name: samples (T,)}; `file_names` are those of a hint.

    Raises LogError for a joint without the sensors that its drive needs.
    """
    time = picked["time_s"]
    fields = {field: np.full((len(time), robot.n), np.nan) for field in SENSORS}
    for index, joint in enumerate(robot.joint_names):
        names = column_names(joint, robot.is_prismatic[index])
        found = {
            name: field
            for name, field in names.items()
            if name in picked and not np.all(np.isnan(picked[name]))
        }
        for name, field in found.items():
            fields[field][:, index] = picked[name]
        missing = [name for name in names if name not in found]
        _check_sensors(robot, joint, list(found.values()), near_names(missing, picked, file_names))
    sensors: dict[str, Any] = {
        field: values
        for field, values in fields.items()
        if field in _NEEDED or not np.all(np.isnan(values))
    }
    return Log(time=time, joint_names=robot.joint_names, is_prismatic=robot.is_prismatic, **sensors)


def _check_sensors(robot: Robot, joint: str, found: list[str], hint: str) -> None:
    elastic = isinstance(robot.drivetrains[joint], SeriesElasticDrive)
    positions = [field for field in found if field.endswith("position")]
    torques = [field for field in found if not field.endswith("position")]
    if len(positions) < (2 if elastic else 1) or not torques:
        need = "both positions" if elastic else "one position"
        names = ", ".join(column_names(joint, robot.is_prismatic[robot.index(joint)]))
        raise LogError(
            f"joint '{joint}' needs {need} and one torque, found {', '.join(found) or 'none'}; "
            f"its columns are {names}{hint}"
        )
