"""Log: what the sensors of a robot said; read_log, write_log."""

from __future__ import annotations

import csv
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from seaid.arrays import Array, frozen
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.errors import LogError, unknown_name
from seaid.files import whole_file, write_csv
from seaid.robot import Robot

MINIMUM_SAMPLES = 50

_FORMATS = (".csv", ".npz")

Column = str | tuple[str, float | str]
"""A foreign column: its name, or its name with the unit it is in or the factor to the SI unit."""

UNIT_FACTORS = {
    "rad": {"rad": 1.0, "deg": np.pi / 180, "turn": 2 * np.pi},
    "m": {"m": 1.0, "mm": 1e-3},
    "Nm": {"Nm": 1.0, "mNm": 1e-3},
    "N": {"N": 1.0},
    "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "mV": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
"""Factors to the SI unit with which a column name ends."""


SENSORS = (
    "motor_position",
    "joint_position",
    "motor_torque",
    "joint_torque",
    "motor_current",
    "motor_voltage",
)
"""Fields of a Log with samples of sensors, each (T, n)."""

_NEEDED = SENSORS[:4]
"""Those that a log from a file has in any case, all NaN where there is no such sensor."""


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of n joints at `time` (T,) [s], each array (T, n); NaN columns where no sensor is.

    Motor side in rad and N m. Joint side in rad and N m, at prismatic joints m and N. Motor current
    [A] or voltage [V] where the torque constant is not known. Raises LogError for wrong shapes, too
    few samples, time that does not grow, single NaN.
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


def column_names(joint: str, is_prismatic: bool) -> dict[str, str]:
    """Return {file column name: field of Log} of one joint."""
    position, torque = ("m", "joint_force_N") if is_prismatic else ("rad", "joint_torque_Nm")
    return {
        f"{joint}.motor_position_rad": "motor_position",
        f"{joint}.joint_position_{position}": "joint_position",
        f"{joint}.motor_torque_Nm": "motor_torque",
        f"{joint}.{torque}": "joint_torque",
        f"{joint}.motor_current_A": "motor_current",
        f"{joint}.motor_voltage_V": "motor_voltage",
    }


def read_log(path: str | Path, robot: Robot, *, columns: Mapping[str, Column] | None = None) -> Log:
    """Read a log file (.csv or .npz) of a robot; columns as in `Log.columns`, and `time_s`.

    `columns` maps such a name to a foreign one, alone or with its unit ("deg", "mNm", "ms", ...) or
    factor: {"elbow.joint_position_rad": ("pos_2", "deg"), "time_s": "t"}. Columns not asked for are
    left alone. Raises LogError naming file and column, with the nearest name.
    """
    path = Path(path)
    readers: dict[str, Callable[[Path], Table]] = {".csv": _read_csv, ".npz": _read_npz}
    table = readers[log_format(path)](path)
    wanted = wanted_columns(path, table.names, robot, columns or {})
    data = table.load(list(dict.fromkeys(foreign for foreign, _ in wanted.values())))
    return log_of(path, data, wanted, robot, table.names)


def log_format(path: Path) -> str:
    """Return the ending of a log file that is there and can be read. Raises LogError otherwise."""
    if path.suffix.lower() not in _FORMATS:
        raise LogError(
            f"'{path}': cannot read '{path.suffix}' logs; allowed: {', '.join(_FORMATS)}"
        )
    if not path.is_file():
        raise LogError(f"no log file at '{path}' (working folder {Path.cwd()})")
    return path.suffix.lower()


def write_log(log: Log, path: str | Path) -> None:
    """Write a log as CSV or NPZ (by the ending), whole or not at all.

    Raises LogError for another ending, SeaidError where the file cannot be written.
    """
    path = Path(path)
    data = {"time_s": log.time, **log.columns()}
    if path.suffix.lower() == ".npz":
        with whole_file(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **data)  # type: ignore[arg-type]
    elif path.suffix.lower() == ".csv":
        write_csv(path, data)
    else:
        raise LogError(f"'{path}': cannot write '{path.suffix}' logs; allowed: .csv, .npz")


@dataclass(frozen=True, eq=False)
class Table:
    """The columns of a file: their names, and how to get the samples of some of them."""

    names: list[str]
    load: Callable[[list[str]], dict[str, Array]]


def _read_csv(path: Path) -> Table:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as problem:
        raise LogError(f"'{path}' is not a text file in UTF-8: {problem}") from None
    except OSError as problem:
        raise LogError(f"cannot read '{path}': {problem.strerror}") from None
    names, delimiter = csv_header(path, lines[0] if lines else "")
    return Table(names, lambda wanted: csv_columns(path, names, lines[1:], delimiter, wanted))


def csv_header(path: Path, header: str) -> tuple[list[str], str]:
    """Return the column names in the first line of a file, and its delimiter."""
    delimiter = max(",;\t", key=header.count)
    names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter), [])]
    if not any(names):
        raise LogError(f"'{path}' is empty; a log starts with a line of column names")
    return names, delimiter


def csv_columns(
    path: Path,
    names: list[str],
    lines: list[str],
    delimiter: str,
    wanted: list[str],
    first_line: int = 2,
) -> dict[str, Array]:
    """Return the wanted columns of lines of samples, the first of which is `first_line`.

    Only a table with more than numbers in it takes the slow way.
    """
    if not any(line.strip() for line in lines):
        raise LogError(f"'{path}' has column names but no samples")
    twice = sorted({name for name in wanted if names.count(name) > 1})
    if twice:
        raise LogError(f"'{path}': column named twice: {', '.join(twice)}")
    places = [names.index(name) for name in wanted]
    try:
        values = np.loadtxt(lines, delimiter=delimiter, ndmin=2)
        if values.shape[1] == len(names):
            return dict(zip(wanted, values.T[places], strict=True))
    except ValueError:
        pass
    rows = []
    for line, cells in enumerate(csv.reader(lines, delimiter=delimiter), first_line):
        if not cells:
            continue
        if len(cells) != len(names):
            raise LogError(
                f"'{path}' is not a table: line {line} has {len(cells)} cells, the first line "
                f"{len(names)} column names"
            )
        rows.append([_number(path, line, names[place], cells[place]) for place in places])
    return dict(zip(wanted, np.array(rows).T, strict=True))


def _number(path: Path, line: int, column: str, cell: str) -> float:
    """Return the number in a cell; an empty one is NaN."""
    try:
        return float(cell) if cell.strip() else float("nan")
    except ValueError:
        raise LogError(
            f"'{path}', line {line}: column '{column}' has '{cell}', which is no number"
        ) from None


def _read_npz(path: Path) -> Table:
    try:
        with path.open("rb") as file, np.load(file) as archive:
            names = list(archive.files)
    except (OSError, ValueError, EOFError, BadZipFile, AttributeError, TypeError):
        raise LogError(f"'{path}' is not a NumPy archive (.npz), or a damaged one") from None
    return Table(names, lambda wanted: _npz_columns(path, wanted))


def _npz_columns(path: Path, wanted: list[str]) -> dict[str, Array]:
    found: dict[str, Array] = {}
    with np.load(path) as archive:
        for name in wanted:
            try:
                values = archive[name]
            except (OSError, ValueError, EOFError, BadZipFile, zlib.error) as problem:
                raise LogError(f"'{path}': column '{name}' cannot be read: {problem}") from None
            if values.dtype.kind not in "iuf" or values.ndim != 1:
                raise LogError(
                    f"'{path}': column '{name}' must be a row of numbers, found {values.dtype} "
                    f"of shape {values.shape}"
                )
            found[name] = values.astype(np.float64)
    lengths = {name: len(values) for name, values in found.items()}
    if len(set(lengths.values())) > 1:
        raise LogError(f"'{path}': columns are not equally long: {lengths}")
    return found


def wanted_columns(
    path: Path, names: Sequence[str], robot: Robot, columns: Mapping[str, Column]
) -> dict[str, tuple[str, float]]:
    """Return {our column: (column of the file, factor to our unit)} of all that the file has."""
    allowed = ["time_s"]
    for joint, is_prismatic in zip(robot.joint_names, robot.is_prismatic, strict=True):
        allowed += column_names(joint, is_prismatic)
    for name in columns:
        if name not in allowed:
            raise LogError("columns=: " + unknown_name("column of this robot's log", name, allowed))
    wanted: dict[str, tuple[str, float]] = {}
    for name in allowed:
        foreign, factor = _foreign(name, columns.get(name, name))
        if foreign in names:
            wanted[name] = (foreign, factor)
        elif name in columns or name == "time_s":
            raise LogError(f"'{path}': " + unknown_name("column", foreign, names))
    if len(wanted) == 1:
        raise LogError(
            f"'{path}' has no column of this robot; expected names as '{allowed[1]}' (or map "
            f"foreign ones with columns=), found: {', '.join(names)}"
        )
    return wanted


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


def _foreign(name: str, column: Column) -> tuple[str, float]:
    if isinstance(column, str):
        return column, 1.0
    if not (isinstance(column, tuple | list) and len(column) == 2):
        raise LogError(
            f"columns= '{name}' must be a column name or (name, unit or factor), found {column!r}"
        )
    foreign, factor = column
    if isinstance(factor, str):
        units = UNIT_FACTORS[name.rsplit("_", 1)[1]]
        if factor not in units:
            raise LogError(f"columns= '{name}': " + unknown_name("unit for it", factor, units))
        factor = units[factor]
    if not (np.isfinite(factor) and factor != 0):
        raise LogError(f"columns= '{name}': the factor must be finite and not zero, found {factor}")
    return foreign, float(factor)


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
        _check_sensors(robot, joint, list(found.values()), _near(missing, picked, file_names))
    sensors: dict[str, Any] = {
        field: values
        for field, values in fields.items()
        if field in _NEEDED or not np.all(np.isnan(values))
    }
    return Log(time=time, joint_names=robot.joint_names, is_prismatic=robot.is_prismatic, **sensors)


def _near(missing: list[str], picked: Iterable[str], file_names: Sequence[str]) -> str:
    """Return a hint for columns of the file whose names are nearly those of missing ones."""
    free = [name for name in file_names if name not in picked]
    pairs = [(name, near) for name in missing for near in get_close_matches(name, free, 1, 0.9)]
    return "".join(f"; '{near}' in the file is near '{name}'" for name, near in pairs)


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
