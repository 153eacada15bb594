"""Log: what the sensors of a robot said; read_log, write_log."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seaid.arrays import Array, frozen
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.errors import LogError, SeaidWarning
from seaid.files import whole_file, write_csv
from seaid.formats.hdf5_file import write_hdf5
from seaid.formats.opening import open_table
from seaid.formats.parquet_file import write_parquet
from seaid.formats.table import check_lengths
from seaid.logs.channels import Channel
from seaid.logs.described import both_sides, channels_of
from seaid.logs.description_file import Described, description_for
from seaid.logs.log_columns import SENSORS, Column, column_names, near_names, wanted_columns
from seaid.logs.log_description import LogDescription
from seaid.logs.mending import repaired
from seaid.logs.repair import Repair, Repairs
from seaid.robot import Robot

__all__ = ["MINIMUM_SAMPLES", "SENSORS", "Log", "column_names", "log_of", "read_log", "write_log"]

MINIMUM_SAMPLES = 50

_FAR, _SLACK = 1.0, 0.2
"""Parts of the range of a joint beyond its limits, and rad, that make angles look like degrees."""

_NEEDED = SENSORS[:4]
"""Those that a log from a file has in any case, all NaN where there is no such sensor."""


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of n joints at `time` (T,) [s], each array (T, n); NaN columns where no sensor is.

    Motor side in rad and N m. Joint side in rad and N m, at prismatic joints m and N. Motor current
    [A] or voltage [V] where the torque constant is not known. `report`: what was found in the file
    and mended. Raises LogError for wrong shapes, too few samples, time that does not grow, single
    NaN.
    """

    time: Array
    joint_names: tuple[str, ...]
    motor_position: Array
    joint_position: Array
    motor_torque: Array
    joint_torque: Array | None = None
    is_prismatic: tuple[bool, ...] = ()
    motor_current: Array | None = None
    motor_voltage: Array | None = None
    report: tuple[Repair, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(np.atleast_1d(self.time)), len(self.joint_names))
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        if len(set(self.joint_names)) < shape[1]:
            raise LogError(f"joint_names has a joint twice: {', '.join(self.joint_names)}")
        object.__setattr__(self, "time", frozen("time", self.time, (None,), LogError))
        for field, value in self.sensors().items():
            object.__setattr__(self, field, frozen(field, value, shape, LogError))
        if not self.is_prismatic:
            object.__setattr__(self, "is_prismatic", (False,) * shape[1])
        if len(self.is_prismatic) != shape[1]:
            raise LogError(
                f"is_prismatic needs one entry a joint, {shape[1]}, found {len(self.is_prismatic)}"
            )
        _check_time(self.time)
        for name, column in self.columns().items():
            _check_column(name, column, self.time)

    def sensors(self) -> dict[str, Array]:
        """Return {field: samples (T, n)} of all fields that are there."""
        found = {field: getattr(self, field) for field in SENSORS}
        return {field: values for field, values in found.items() if values is not None}

    def between(self, start_s: float, end_s: float) -> Log:
        """Return the samples with start_s <= time < end_s."""
        kept = (self.time >= start_s) & (self.time < end_s)
        parts: dict[str, Any] = {field: values[kept] for field, values in self.sensors().items()}
        return replace(self, time=self.time[kept], **parts)

    def columns(self) -> dict[str, Array]:
        """Return {file column name: samples} of all sensors that are there."""
        found = {}
        for index, joint in enumerate(self.joint_names):
            for name, field in column_names(joint, self.is_prismatic[index]).items():
                values = getattr(self, field)
                if values is not None and not np.all(np.isnan(values[:, index])):
                    found[name] = values[:, index]
        return found


def read_log(
    path: str | Path,
    robot: Robot,
    *,
    columns: Mapping[str, Column] | None = None,
    description: Described | None = None,
    repair: Repairs | None = None,
) -> Log:
    """Read a log of a robot: CSV, NPZ, Parquet, HDF5, JSON, ROS bag (file or folder), HEBI log.

    A file with the names of `Log.columns` and `time_s` is read as it is; `columns` maps such a name
    to a foreign one, alone or with its unit ("deg", "mNm", "ms", ...) or factor:
    {"elbow.joint_position_rad": ("pos_2", "deg"), "time_s": "t"}. Any other log needs a
    `description` (see docs/logs.md): a LogDescription, a mapping, or a TOML file, by itself the one
    beside the log (run.csv, run.toml). A described log is repaired within the description's limits,
    others within those of `repair` or not at all. Raises LogError naming file and column, with the
    nearest name; warns of positions far beyond the robot's limits, as degrees are.
    """
    path = Path(path)
    described = description_for(path, None if columns else description)
    if columns and description is not None:
        raise LogError("give columns= or description=, not both: a description names the columns")
    table = open_table(path)
    if described is not None:
        channels = channels_of(path, table, described, robot)
        log = _mended(path, channels, repair or described.repair, robot, table.names, described)
    else:
        wanted = wanted_columns(path, table, robot, columns or {})
        data = table.load(list(dict.fromkeys(foreign for foreign, _ in wanted.values())))
        check_lengths(path, data)
        if repair is None:
            log = log_of(path, data, wanted, robot, table.names)
        else:
            picked = {name: data[foreign] * factor for name, (foreign, factor) in wanted.items()}
            time = picked.pop("time_s")
            channels = [Channel(name, time, values) for name, values in picked.items()]
            log = _mended(path, channels, repair, robot, table.names, None)
    _suspect_degrees(path, log, robot)
    return log


def write_log(log: Log, path: str | Path) -> None:
    """Write a log as CSV, NPZ, Parquet or HDF5 (by the ending), whole or not at all.

    Raises LogError for another ending, SeaidError where the file cannot be written.
    """
    path = Path(path)
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise LogError(
            f"'{path}': cannot write '{path.suffix}' logs; allowed: {', '.join(_WRITERS)}"
        )
    write(path, {"time_s": log.time, **log.columns()})


def _write_npz(path: Path, data: Mapping[str, Array]) -> None:
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **data)  # type: ignore[arg-type]


_WRITERS: dict[str, Callable[[Path, Mapping[str, Array]], None]] = {
    ".csv": write_csv,
    ".npz": _write_npz,
    ".parquet": write_parquet,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
}

WRITTEN = tuple(_WRITERS)
"""Endings of the files that `write_log` writes."""


def _mended(
    path: Path,
    channels: Sequence[Channel],
    limits: Repairs,
    robot: Robot,
    file_names: Sequence[str],
    described: LogDescription | None,
) -> Log:
    """Return the log of channels on clocks of their own, repaired within limits."""
    try:
        time, picked, report = repaired(channels, limits)
        if described is not None:
            picked = both_sides(picked, robot)
            _check_alive(picked, robot)
        return replace(_log({"time_s": time, **picked}, robot, file_names), report=report)
    except LogError as problem:
        raise LogError(f"'{path}': {problem}") from None


def _check_alive(picked: Mapping[str, Array], robot: Robot) -> None:
    """Refuse a position that stands still while the other one of the joint moves."""
    for index, joint in enumerate(robot.joint_names):
        names = [name for name in column_names(joint, robot.is_prismatic[index]) if name in picked]
        positions = [name for name in names if "_position_" in name]
        still = [name for name in positions if np.ptp(picked[name]) == 0]
        if len(positions) == 2 and len(still) == 1:
            value = picked[still[0]][0]
            raise LogError(
                f"'{still[0]}' is {value:.6g} all the time while the other side of the joint "
                "moves: the sensor is dead, or the drive was not powered; name another column"
            )


def _suspect_degrees(path: Path, log: Log, robot: Robot) -> None:
    """Warn of joints that leave their limits by far, but would not if the angles were degrees."""
    for index, joint in enumerate(robot.joint_names):
        lower, upper = robot.lower_limits[index], robot.upper_limits[index]
        values = log.joint_position[:, index]
        if log.is_prismatic[index] or not upper - lower < 20.0 or np.all(np.isnan(values)):
            continue
        outside = max(float(np.max(values)) - upper, lower - float(np.min(values)))
        as_degrees = np.deg2rad(values)
        fits = np.max(as_degrees) <= upper + _SLACK and np.min(as_degrees) >= lower - _SLACK
        if outside > _FAR * (upper - lower) and fits:
            warnings.warn(
                f"'{path}': the position of joint '{joint}' goes from {np.min(values):.4g} to "
                f"{np.max(values):.4g} rad, its limits are {lower:.4g} and {upper:.4g} rad: "
                "degrees? Then say so: unit 'deg'",
                SeaidWarning,
                stacklevel=3,
            )


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
        return _log(picked, robot, file_names)
    except LogError as problem:
        raise LogError(f"'{path}': {problem}") from None


def _log(picked: dict[str, Array], robot: Robot, file_names: Sequence[str]) -> Log:
    """Sort the columns into a Log; each joint needs enough sensors for its drive."""
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


def _check_time(time: Array) -> None:
    if len(time) < MINIMUM_SAMPLES:
        raise LogError(f"a log needs {MINIMUM_SAMPLES} samples or more, found {len(time)}")
    if not np.all(np.isfinite(time)):
        row = int(np.flatnonzero(~np.isfinite(time))[0])
        raise LogError(f"time_s has a value that is not finite in sample {row}")
    steps = np.diff(time)
    for word, bad in (("goes backwards", steps < 0), ("repeats", steps == 0)):
        if np.any(bad):
            row = int(np.flatnonzero(bad)[0]) + 1
            raise LogError(
                f"time_s {word} at sample {row} ({time[row - 1]:.9g} s, then {time[row]:.9g} s; "
                f"{int(bad.sum())} such places); it must grow: sort or drop these samples, "
                "or let read_log mend them with repair=seaid.Repairs()"
            )


def _check_column(name: str, column: Array, time: Array) -> None:
    bad = ~np.isfinite(column)
    if np.any(bad):
        row = int(np.flatnonzero(bad)[0])
        raise LogError(
            f"column '{name}' has {int(bad.sum())} values that are not finite, the first in sample "
            f"{row} (t = {time[row]:.6g} s); repair them, or leave the whole column NaN if there "
            "is no such sensor; read_log mends single places with repair=seaid.Repairs()"
        )
