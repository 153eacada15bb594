"""Log: the samples of a robot's sensors; its column names and units, its checks and its files."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from difflib import get_close_matches
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, BoolArray, frozen
from seaid._files import toml_table, write_csv, write_whole
from seaid._progress import Display, sampled_text
from seaid.errors import LogError, checked, listed
from seaid.log import channels
from seaid.log.base_log import BaseLog, base_log
from seaid.log.channels import refusal
from seaid.log.readers.array_files import write_hdf5, write_parquet
from seaid.log.readers.table import Block
from seaid.log.repair import Repair

if TYPE_CHECKING:
    from seaid.robot import Robot


def columns_by_joint(system: Robot | Log) -> dict[str, dict[str, str]]:
    """Return {joint: {field of `Log`: column name in a file}} of a robot or of a log."""
    names = system.joint_names
    return dict(zip(names, map(channels.column_names, names, system.is_prismatic), strict=True))


def own_names(robot: Robot) -> set[str]:
    """Return the names of the columns that a log has of a robot's joints, the short ones too."""
    names = {*chain(*(columns.values() for columns in columns_by_joint(robot).values()))}
    return names | {channels.short_name(name) for name in names}


_COMPARED = 1_000
"""Most names of a file that are compared with missing names."""


def near_names(missing: list[str], picked: Iterable[str], file_names: Sequence[str]) -> str:
    """Return a hint on columns of the file whose names are similar to missing names."""
    free = [name for name in file_names if name not in picked][:_COMPARED]
    # Reversed, so that of names that differ in capitals only the first one stays.
    small = {name.lower(): name for name in reversed(free)}
    pairs = [
        (name, small[near])
        for name in missing
        for near in get_close_matches(name.lower(), small, 1, 0.9)
    ]
    text = "".join(f"; '{near}' in the file is similar to '{name}'" for name, near in pairs)
    for name, near in pairs[:1]:
        joint, field = name.rpartition(".")[0], channels.quantity_of(name).name
        text += f"; in the description of the log: {toml_table('joints', joint)} "
        text += f'{field} = "{near}"'
    return text


def unread_columns(robot: Robot, file_names: Sequence[str]) -> list[str]:
    """Return what is wrong with names of a file that are nearly those of a joint's columns."""
    columns, expected = columns_by_joint(robot), own_names(robot)
    quantities = {*chain(*(channels.column_names("", x).values() for x in (False, True)))}
    still = {*robot.standing_joints, *(joint.name for joint in robot.dependent_joints)}
    missing, faults = expected - {*file_names}, []
    for name in file_names[:_COMPARED]:
        joint, dot, quantity = name.rpartition(".")
        if not joint or name in expected or joint in still:
            continue
        is_unknown = joint not in columns and dot + quantity in quantities
        why = f", as the robot has no joint '{joint}'" * is_unknown
        near = get_close_matches(name, missing, 1, 0.9)
        why += "".join(f": the nearest name is '{nearest}'" for nearest in near)
        if why:
            faults.append(f"'{name}' is not read{why}")
    return faults


MINIMUM_SAMPLES = 50
"""Fewest samples of a log, or of what is read of one at a time."""

LARGEST, _LATEST_S = 1e12, 1e15
"""Largest magnitude of a sample in SI units, which no sensor measures, and of a time."""


_UNMEASURED: Array = np.empty((0, 0))
"""Stands for the samples of a sensor that there is not."""


@dataclass(frozen=True, eq=False, repr=False)
class Log(Display):
    """Samples of the sensors of n joints at T instants; the column of a missing sensor is NaN.

    What no joint has may be absent: `Log(time, names, motor_position=q, motor_torque=tau)`.

    Attributes
    ----------
    time : array (T,)
        Strictly increasing time stamps [s], at least 50.
    joint_names : tuple of str
        Names of the n joints, in the order of the columns.
    motor_position, joint_position : array (T, n)
        Motor angle [rad]; joint position [rad], of a prismatic joint [m].
    motor_torque, joint_torque : array (T, n), joint_torque or None
        Motor torque [N m]; torque behind the spring [N m], of a prismatic joint force [N].
    motor_current, motor_voltage : array (T, n) or None
        Current [A] or voltage [V] of motors whose torque constant is unknown.
    deflection : array (T, n) or None
        Deflection of the spring by a sensor of its own, motor side less joint side, as a motion of
        the joint [rad, or m]: that of a spring between pulleys over the load pulley's radius.
    motor_temperature : array (T, n) or None
        Temperature of the motor [degC], for friction that depends on it.
    position_command : array (T, n) or None
        Commanded position of a drive with a position controller, behind its gear [rad or m].
    velocity_command, torque_command : array (T, n) or None
        Commanded velocity [rad/s or m/s] and feed-forward torque [N m or N] behind the gear, which
        the controller of the drive gets, too.
    supply_voltage : array (T, n) or None
        Supply voltage of the drive [V].
    is_prismatic : tuple of bool
        One entry per joint; default: all revolute.
    base : BaseLog or None
        The base of a robot that nothing holds, and its contacts.
    report : tuple of Repair
        Faults found in the file, and their repairs.
    description : mapping or None
        The description by which the file was read, with all columns of joints that were, as plain
        data; None for a file with the column names of seaid.

    Raises
    ------
    LogError
        For wrong shapes, too few samples, time that does not increase, single NaN values and
        values above 1e12.

    Examples
    --------
    >>> log = seaid.read_log("run.csv", robot)
    >>> log.between(2.0, 5.0).motor_position.shape
    """

    table_name = "log_table"

    time: Array
    joint_names: tuple[str, ...]
    motor_position: Array = dataclasses.field(default_factory=lambda: _UNMEASURED)
    joint_position: Array = dataclasses.field(default_factory=lambda: _UNMEASURED)
    motor_torque: Array = dataclasses.field(default_factory=lambda: _UNMEASURED)
    joint_torque: Array | None = None
    is_prismatic: tuple[bool, ...] = ()
    motor_current: Array | None = None
    motor_voltage: Array | None = None
    deflection: Array | None = None
    motor_temperature: Array | None = None
    position_command: Array | None = None
    velocity_command: Array | None = None
    torque_command: Array | None = None
    supply_voltage: Array | None = None
    base: BaseLog | None = None
    report: tuple[Repair, ...] = ()
    description: Mapping[str, Any] | None = None

    def _in_short(self) -> str:
        logged = [name for name, x in self.sensors().items() if not np.all(np.isnan(x))]
        kinds = ", ".join(name.replace("_", " ") for name in logged)
        return f"{sampled_text(self.time, self.joint_names)}: {kinds}"

    def __post_init__(self) -> None:
        shape = (len(np.atleast_1d(self.time)), len(self.joint_names))
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        if len(set(self.joint_names)) < shape[1]:
            raise LogError(f"joint_names has a joint twice: {', '.join(self.joint_names)}")
        object.__setattr__(self, "time", frozen("time", self.time, (None,), LogError))
        for name, value in self.sensors().items():
            value = np.full(shape, np.nan) if value is _UNMEASURED else value
            object.__setattr__(self, name, frozen(name, value, shape, LogError))
        if not self.is_prismatic:
            object.__setattr__(self, "is_prismatic", (False,) * shape[1])
        if len(self.is_prismatic) != shape[1]:
            raise refusal("other_is_prismatic", count=shape[1], given=len(self.is_prismatic))
        if self.base is not None:
            for name, column in self.base.columns().items():
                if len(column) != shape[0]:
                    raise LogError(f"{name} has {len(column)} samples, time has {shape[0]}")
        _check_time(self.time)
        advice = "leave the whole column NaN if there is no such sensor"
        for name, column in self.columns().items():
            channels.check_finite(f"column '{name}'", column, advice)
            channels.check_size(f"column '{name}'", column, LARGEST)

    def sensors(self, joints: Sequence[str] | None = None) -> dict[str, Array]:
        """Return {field: samples (T, n)} of all fields that are not None, of `joints` if given."""
        samples = {field: getattr(self, field) for field in channels.SENSORS}
        samples = {field: values for field, values in samples.items() if values is not None}
        if joints is None:
            return samples
        columns = [self.joint_names.index(joint) for joint in joints]
        return {field: values[:, columns] for field, values in samples.items()}

    def logged(self, joint: str) -> dict[str, Array]:
        """Return {field: samples (T,)} of the sensors that the log has of a joint."""
        samples = {x: y[:, self.joint_names.index(joint)] for x, y in self.sensors().items()}
        # Of most columns the first sample decides.
        return {x: y for x, y in samples.items() if not (np.isnan(y[0]) and np.all(np.isnan(y)))}

    def between(self, start_s: float, end_s: float) -> Log:
        """Return the samples with start_s <= time < end_s."""
        return self.at((self.time >= start_s) & (self.time < end_s))

    def at(self, kept: BoolArray) -> Log:
        """Return the samples of a mask (T,)."""
        parts: dict[str, Any] = {field: values[kept] for field, values in self.sensors().items()}
        if self.base is not None:
            parts["base"] = self.base.each(lambda values: values[kept])
        return replace(self, time=self.time[kept], **parts)

    def columns(self) -> dict[str, Array]:
        """Return {column name in a file: samples (T,)} of all sensors that the log has."""
        return {
            columns[field]: samples
            for joint, columns in columns_by_joint(self).items()
            for field, samples in self.logged(joint).items()
        }

    def sources(self) -> dict[str, dict[str, Any]]:
        """Return {joint: {quantity: its column, or its entry in the description}} of the log."""
        if self.description is not None:
            described = self.description["joints"]
            return {joint: dict(described.get(joint, {})) for joint in self.joint_names}
        return {
            joint: {field: columns[field] for field in self.logged(joint)}
            for joint, columns in columns_by_joint(self).items()
        }


_COARSE = 0.1
"""Share of repeated stamps above which they are said to have too few digits."""


def _check_time(time: Array) -> None:
    if len(time) < MINIMUM_SAMPLES:
        raise LogError(f"a log needs {MINIMUM_SAMPLES} samples or more, found {len(time)}")
    channels.check_finite("time_s", time)
    if np.max(np.abs(time)) > _LATEST_S:
        raise refusal("time_too_large", start=time[0], end=time[-1], most=_LATEST_S)
    steps = np.diff(time)
    for word, bad in (("goes backwards", steps < 0), ("repeats", steps == 0)):
        if np.any(bad):
            row = int(np.flatnonzero(bad)[0]) + 1
            is_coarse = word == "repeats" and np.mean(bad) > _COARSE
            remedy = "sort or drop these samples, or repair them with repair=seaid.Repairs()"
            remedy = "it is constant" if np.all(steps == 0) else remedy
            stamps = {"before": time[row - 1], "time": time[row], "count": int(bad.sum())}
            hint = str(refusal("too_few_digits")) if is_coarse else ""
            raise refusal("no_increase", word=word, row=row, remedy=remedy, hint=hint, **stamps)


_NEEDED = channels.SENSORS[:4]
"""Fields that a log from a file always has, all NaN if there is no such sensor."""


def sorted_log(picked: dict[str, Array], robot: Robot, file_names: Sequence[str]) -> Log:
    """Return the log of columns {name of seaid: samples (T,)}; `file_names` serve for hints."""
    time = picked["time_s"]
    nothing = np.full((len(time), robot.n), np.nan)
    sensors: dict[str, Any] = {field: nothing.copy() for field in _NEEDED}
    seen = {name: values for name, values in picked.items() if not np.all(np.isnan(values))}
    logged = {
        joint: {field: seen[name] for field, name in names.items() if name in seen}
        for joint, names in columns_by_joint(robot).items()
    }
    _check_sensors(robot, logged, picked, file_names)
    for index, samples in enumerate(logged.values()):
        for field, values in samples.items():
            sensors.setdefault(field, nothing.copy())[:, index] = values
    if not robot.base_is_held:
        sensors["base"] = base_log(seen, robot)
    return Log(time=time, joint_names=robot.joint_names, is_prismatic=robot.is_prismatic, **sensors)


_NO_TORQUES = {"motor_position", "joint_position", "deflection", "motor_temperature"}
_NO_TORQUES |= {"torque_command", "supply_voltage"}


def _are_enough(fields: Set[str], is_elastic: bool, may_lack_torque: bool) -> bool:
    """Return whether the sensors of a joint are enough for its drive."""
    # An elastic joint without its own encoder is identified from the motor's side alone.
    needs_both = is_elastic and not {"motor_position", "motor_torque"} <= fields
    has_positions = len(fields & {"motor_position", "joint_position"}) > needs_both
    return has_positions and bool(may_lack_torque or fields - _NO_TORQUES)


def _check_sensors(
    robot: Robot, logged: Mapping[str, Block], picked: Iterable[str], names: Sequence[str]
) -> None:
    """Raise LogError for the first joint of which {joint: {field: samples}} has too few fields."""
    has_torque = any(fields.keys() - _NO_TORQUES for fields in logged.values())
    for joint, columns in columns_by_joint(robot).items():
        fields, elastic = logged[joint].keys(), robot.drives[joint].is_elastic
        # The six equations of a floating base have no motor torque, and a joint next to those that
        # are driven may have no motor: motion alone is of use.
        if _are_enough(fields, elastic, not robot.base_is_held or (has_torque and not elastic)):
            continue
        missing = [column for field, column in columns.items() if field not in fields]
        known = ", ".join(columns.values())
        advice = f"its columns are {known}{near_names(missing, picked, names)}"
        if own_names(robot).isdisjoint(names):
            advice = f"its description names columns of the file, which are {listed(names)}"
        code = ("too_few_of_stiff", "too_few_of_elastic")[elastic]
        reason = refusal(code, joint=joint, found=listed(fields) or "none")
        raise LogError(reason, advice=advice)


@checked(LogError)
def write_log(log: Log, path: str | Path) -> None:
    """Write a log to a file, completely or not at all.

    Parameters
    ----------
    log : Log
        The log; a sensor without samples gets no column.
    path : str or Path
        The file, with the suffix .csv, .npz, .parquet, .h5 or .hdf5.

    Raises
    ------
    LogError
        For another suffix.
    SeaidError
        If the file cannot be written.

    Examples
    --------
    >>> seaid.write_log(log, "run.parquet")
    """
    path = Path(path)
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise refusal("no_writer", path=path, suffix=path.suffix, allowed=", ".join(_WRITERS))
    base = log.base.columns() if log.base is not None else {}
    write(path, {"time_s": log.time, **log.columns(), **base})


def _write_npz(path: Path, data: Mapping[str, Array]) -> None:
    content = BytesIO()
    np.savez_compressed(content, **data)  # type: ignore[arg-type]
    write_whole(path, content.getvalue())


_WRITERS: dict[str, Callable[[Path, Mapping[str, Array]], None]] = {
    ".csv": write_csv,
    ".npz": _write_npz,
    ".parquet": write_parquet,
    **dict.fromkeys((".h5", ".hdf5"), write_hdf5),
}

WRITTEN = tuple(_WRITERS)
"""Suffixes of the files that `write_log` writes."""
