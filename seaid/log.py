"""Log: what the sensors of a robot said; read_log, write_log."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from seaid.arrays import Array, frozen
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.errors import LogError, unknown_name
from seaid.files import whole_file
from seaid.robot import Robot

MINIMUM_SAMPLES = 50

Column = str | tuple[str, float | str]
"""A foreign column: its name, or its name with the unit it is in or the factor to the SI unit."""

UNIT_FACTORS = {
    "rad": 1.0,
    "deg": np.pi / 180,
    "turn": 2 * np.pi,
    "m": 1.0,
    "mm": 1e-3,
    "Nm": 1.0,
    "mNm": 1e-3,
    "N": 1.0,
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
}


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of n joints at `time` (T,) [s], each array (T, n); NaN columns where no sensor is.

    Motor side in rad and N m. Joint side in rad and N m, at prismatic joints m and N. Raises
    LogError for wrong shapes, too few samples, time that does not grow, single NaN.
    """

    time: Array
    joint_names: tuple[str, ...]
    motor_position: Array
    joint_position: Array
    motor_torque: Array
    joint_torque: Array | None = None
    is_prismatic: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(np.atleast_1d(self.time)), len(self.joint_names))
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        object.__setattr__(self, "time", frozen("time", self.time, (None,), LogError))
        for field in ("motor_position", "joint_position", "motor_torque", "joint_torque"):
            value = getattr(self, field)
            if value is not None:
                object.__setattr__(self, field, frozen(field, value, shape, LogError))
        if not self.is_prismatic:
            object.__setattr__(self, "is_prismatic", (False,) * shape[1])
        _check_time(self.time)
        for name, column in self.columns().items():
            _check_column(name, column, self.time)

    def between(self, start_s: float, end_s: float) -> Log:
        """Return the samples with start_s <= time < end_s."""
        kept = (self.time >= start_s) & (self.time < end_s)
        torque = self.joint_torque
        return replace(
            self,
            time=self.time[kept],
            motor_position=self.motor_position[kept],
            joint_position=self.joint_position[kept],
            motor_torque=self.motor_torque[kept],
            joint_torque=None if torque is None else torque[kept],
        )

    def columns(self) -> dict[str, Array]:
        """Return {file column name: samples} of all sensors that are there."""
        found = {}
        for index, joint in enumerate(self.joint_names):
            for name, field in column_names(joint, self.is_prismatic[index]).items():
                values = getattr(self, field)
                if values is not None and not np.all(np.isnan(values[:, index])):
                    found[name] = values[:, index]
        return found


def column_names(joint: str, is_prismatic: bool) -> dict[str, str]:
    """Return {file column name: field of Log} of one joint."""
    position, torque = ("m", "joint_force_N") if is_prismatic else ("rad", "joint_torque_Nm")
    return {
        f"{joint}.motor_position_rad": "motor_position",
        f"{joint}.joint_position_{position}": "joint_position",
        f"{joint}.motor_torque_Nm": "motor_torque",
        f"{joint}.{torque}": "joint_torque",
    }


def read_log(path: str | Path, robot: Robot, *, columns: Mapping[str, Column] | None = None) -> Log:
    """Read a log file (.csv or .npz) of a robot; columns as in `Log.columns`, and `time_s`.

    `columns` maps such a name to a foreign one, alone or with its unit ("deg", "mNm", "ms", ...) or
    factor: {"elbow.joint_position_rad": ("pos_2", "deg"), "time_s": "t"}. Columns not asked for are
    left alone. Raises LogError naming file and column, with the nearest name.
    """
    path = Path(path)
    readers: dict[str, Callable[[Path], dict[str, Array]]] = {".csv": _read_csv, ".npz": _read_npz}
    if path.suffix.lower() not in readers:
        raise LogError(f"'{path}': cannot read '{path.suffix}' logs; allowed: {', '.join(readers)}")
    if not path.is_file():
        raise LogError(f"no log file at '{path}' (working folder {Path.cwd()})")
    data = readers[path.suffix.lower()](path)
    allowed = ["time_s"]
    for joint, is_prismatic in zip(robot.joint_names, robot.is_prismatic, strict=True):
        allowed += column_names(joint, is_prismatic)
    picked = _pick(path, data, columns or {}, allowed)
    try:
        return _log(picked, robot)
    except LogError as problem:
        raise LogError(f"'{path}': {problem}") from None


def write_log(log: Log, path: str | Path) -> None:
    """Write a log as CSV or NPZ (by the ending), whole or not at all."""
    path = Path(path)
    data = {"time_s": log.time, **log.columns()}
    if path.suffix.lower() == ".npz":
        with whole_file(path) as temporary:
            np.savez_compressed(temporary, **data)  # type: ignore[arg-type]
    elif path.suffix.lower() == ".csv":
        write_csv(path, data)
    else:
        raise LogError(f"'{path}': cannot write '{path.suffix}' logs; allowed: .csv, .npz")


def write_csv(path: str | Path, data: Mapping[str, Array]) -> None:
    """Write equally long columns with a header line, in full precision, whole or not at all."""
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(data)
        np.savetxt(file, np.column_stack(list(data.values())), fmt="%.17g", delimiter=",")


def _read_csv(path: Path) -> dict[str, Array]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        header = file.readline()
        delimiter = max(",;\t", key=header.count)
        names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter), [])]
        if not names:
            raise LogError(f"'{path}' is empty; a log starts with a line of column names")
        if len(set(names)) < len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise LogError(f"'{path}': column named twice: {', '.join(twice)}")
        start = file.tell()
        try:
            try:
                values = np.loadtxt(file, delimiter=delimiter, ndmin=2)
            except ValueError:  # empty cells: slower, as NaN
                file.seek(start)
                values = np.loadtxt(file, delimiter=delimiter, ndmin=2, converters=_number)
        except (ValueError, UnicodeDecodeError) as problem:
            raise LogError(f"'{path}' is not a table of numbers: {problem}") from None
    if values.shape[1] != len(names) or not len(values):
        raise LogError(f"'{path}': {len(names)} column names but data of shape {values.shape}")
    return dict(zip(names, values.T, strict=True))


def _number(text: str) -> float:
    return float(text) if text.strip() else float("nan")


def _read_npz(path: Path) -> dict[str, Array]:
    try:
        with np.load(path) as archive:
            return {name: np.asarray(archive[name], dtype=np.float64) for name in archive.files}
    except (OSError, ValueError) as problem:
        raise LogError(f"'{path}' is not a NumPy archive of numbers: {problem}") from None


def _pick(
    path: Path, data: dict[str, Array], columns: Mapping[str, Column], allowed: list[str]
) -> dict[str, Array]:
    """Return the columns under our names and in SI units."""
    for name in columns:
        if name not in allowed:
            raise LogError("columns=: " + unknown_name("column of this robot's log", name, allowed))
    picked = {}
    for name in allowed:
        foreign, factor = _foreign(name, columns.get(name, name))
        if foreign in data:
            picked[name] = data[foreign] * factor
        elif name in columns or name == "time_s":
            raise LogError(f"'{path}': " + unknown_name("column", foreign, data))
    if len(picked) == 1:
        raise LogError(
            f"'{path}' has no column of this robot; expected names as '{allowed[1]}' (or map "
            f"foreign ones with columns=), found: {', '.join(data)}"
        )
    return picked


def _foreign(name: str, column: Column) -> tuple[str, float]:
    if isinstance(column, str):
        return column, 1.0
    foreign, factor = column
    if isinstance(factor, str):
        if factor not in UNIT_FACTORS:
            raise LogError(f"columns= '{name}': " + unknown_name("unit", factor, UNIT_FACTORS))
        factor = UNIT_FACTORS[factor]
    return foreign, float(factor)


def _log(picked: dict[str, Array], robot: Robot) -> Log:
    """Sort the columns into a Log; each joint needs enough sensors for its drive."""
    time = picked["time_s"]
    fields = {
        field: np.full((len(time), robot.n), np.nan)
        for field in ("motor_position", "joint_position", "motor_torque", "joint_torque")
    }
    for index, joint in enumerate(robot.joint_names):
        names = column_names(joint, robot.is_prismatic[index])
        for name, field in names.items():
            if name in picked:
                fields[field][:, index] = picked[name]
        _check_sensors(robot, joint, [field for name, field in names.items() if name in picked])
    return Log(time=time, joint_names=robot.joint_names, is_prismatic=robot.is_prismatic, **fields)


def _check_sensors(robot: Robot, joint: str, found: list[str]) -> None:
    elastic = isinstance(robot.drivetrains[joint], SeriesElasticDrive)
    positions = [field for field in found if field.endswith("position")]
    torques = [field for field in found if field.endswith("torque")]
    if len(positions) < (2 if elastic else 1) or not torques:
        need = "both positions" if elastic else "one position"
        names = ", ".join(column_names(joint, robot.is_prismatic[robot.index(joint)]))
        raise LogError(
            f"joint '{joint}' needs {need} and one torque, found {', '.join(found) or 'none'}; "
            f"its columns are {names}"
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
                f"{int(bad.sum())} such places); it must grow: sort or drop these samples"
            )


def _check_column(name: str, column: Array, time: Array) -> None:
    bad = ~np.isfinite(column)
    if np.any(bad):
        row = int(np.flatnonzero(bad)[0])
        raise LogError(
            f"column '{name}' has {int(bad.sum())} values that are not finite, the first in sample "
            f"{row} (t = {time[row]:.6g} s); repair them, or leave the whole column NaN if there "
            "is no such sensor"
        )
