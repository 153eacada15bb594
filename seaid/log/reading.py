"""Reading a log of any supported format, with the column names of seaid or custom columns."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from seaid._arrays import Array, is_constant
from seaid.errors import LogError, SeaidWarning, checked
from seaid.log.custom_columns import both_sides, channels_of
from seaid.log.description import Described, LogDescription, description_for
from seaid.log.log import (
    WRITTEN,
    Column,
    Log,
    column_names,
    log_of,
    sorted_log,
    wanted_columns,
    write_log,
)
from seaid.log.readers.opening import open_tables
from seaid.log.readers.table import Table, check_lengths
from seaid.log.repair.data import Channel, Repair, Repairs
from seaid.log.repair.repair import repaired
from seaid.log.repair.resampling import on_time
from seaid.robot import Robot

__all__ = ["WRITTEN", "Log", "read_log", "write_log"]

_FAR, _SLACK = 1.0, 0.2
"""Angles count as degrees if they exceed the limits by this multiple of the range, and if their
values in degrees are within the limits by this slack [rad]."""


@checked(LogError)
def read_log(
    path: str | Path | Sequence[str | Path],
    robot: Robot,
    *,
    columns: Mapping[str, Column] | None = None,
    description: Described | None = None,
    repair: Repairs | None = None,
) -> Log:
    """Read a log of a robot.

    Parameters
    ----------
    path : str, Path or a list of them
        CSV and other tables of text, NPZ, Parquet, HDF5, JSON, MATLAB, ROS bag (file or folder) or
        HEBI log. A file with the column names of `Log.columns` and `time_s` needs no further
        arguments. A list has the files of one log, each with its own time: they are resampled to
        one. A description (.toml) with `files` may stand for them.
    robot : Robot
        The robot; the log must have the sensors that its drives need.
    columns : mapping, optional
        {column of seaid: column of the file}; the latter may be (name, unit) with a unit such as
        "deg", "mNm" or "ms", or (name, factor to SI).
    description : LogDescription, mapping, str or Path, optional
        The meaning of custom columns, see docs/logs.md; default: the TOML file with the name of
        the log in the same folder (run.toml for run.csv), if it exists. What it does not describe
        is read from seaid's own columns.
    repair : Repairs, optional
        Limits of the repair of faults; default: those of the description, without one no repair.

    Returns
    -------
    Log
        The samples in SI units.

    Raises
    ------
    LogError
        Naming file and column, with the most similar name.

    Warns
    -----
    SeaidWarning
        If positions exceed the joint limits by far, as angles in degrees do.

    Examples
    --------
    >>> log = seaid.read_log("run.csv", robot)
    >>> names = {"time_s": ("t", "ms"), "knee.joint_position_rad": ("pos_2", "deg")}
    >>> log = seaid.read_log("custom.csv", robot, columns=names, repair=seaid.Repairs())
    """
    paths = [Path(path)] if isinstance(path, str | Path) else [Path(one) for one in path]
    if not paths:
        raise LogError("path= is an empty list: name the files of the log")
    if columns and description is not None:
        raise LogError(
            "give columns= or description=, not both: a description names the columns",
            "description=",
        )
    if paths[0].suffix.lower() == ".toml" and description is None:
        description = paths[0]
    described = description_for(paths[0], None if columns else description)
    if described is not None and described.files and len(paths) == 1:
        folder = (description if isinstance(description, str | Path) else None) or paths[0]
        paths = [Path(folder).parent / one for one in described.files]
    path, table = Path(" + ".join(map(str, paths))), open_tables(paths)
    if columns and table.files:
        raise LogError("columns= is for a log of one file: give a description=", "description=")
    if described is not None or table.files:
        described = described or LogDescription()
        channels = channels_of(path, table, described, robot)
        log = _repaired(path, channels, repair or described.repair, robot, table.names, described)
        log = replace(log, description=described.to_dict())
    else:
        log = _by_names(path, table, robot, columns or {}, repair)
    _warn_of_degrees(path, log, robot)
    return log


def _by_names(
    path: Path, table: Table, robot: Robot, columns: Mapping[str, Column], repair: Repairs | None
) -> Log:
    """Return the log of a file with the column names of seaid, or with `columns` for them."""
    wanted = wanted_columns(path, table, robot, columns)
    data = table.load(list(dict.fromkeys(custom for custom, _ in wanted.values())))
    check_lengths(path, {name: len(values) for name, values in data.items()})
    if repair is None:
        return log_of(path, data, wanted, robot, table.names)
    picked = {name: data[custom] * factor for name, (custom, factor) in wanted.items()}
    time = picked.pop("time_s")
    channels = [Channel(name, time, values) for name, values in picked.items()]
    return _repaired(path, channels, repair, robot, table.names, None)


def _repaired(
    path: Path,
    channels: Sequence[Channel],
    limits: Repairs,
    robot: Robot,
    file_names: Sequence[str],
    described: LogDescription | None,
) -> Log:
    """Return the log of channels, each with its own clock, repaired within limits."""
    try:
        time, picked, report = repaired(channels, limits)
        if described is not None:
            delays_s = {one.name: one.delay_s for one in channels if one.delay_s}
            time, picked, more = _as_described(time, picked, delays_s, described.exclude_s)
            report += more
            picked = both_sides(picked, robot)
            _check_alive(picked, robot)
        return replace(sorted_log({"time_s": time, **picked}, robot, file_names), report=report)
    except LogError as problem:
        raise LogError(f"'{path}': {problem}", *problem.arguments) from None


def _as_described(
    time: Array,
    picked: dict[str, Array],
    delays_s: Mapping[str, float],
    intervals: Sequence[tuple[float, float]],
) -> tuple[Array, dict[str, Array], tuple[Repair, ...]]:
    """Return time, samples and repairs without the described delays and excluded intervals."""
    covered, moved = on_time(time, picked, delays_s)
    picked = {name: values[covered] for name, values in picked.items()} | moved
    report = [
        Repair(name, "delay", 1, float(time[0]), f"{1e3 * delay:.6g} ms, as described; corrected")
        for name, delay in delays_s.items()
    ]
    time = time[covered]
    bad = np.zeros(len(time), dtype=bool)
    for start_s, end_s in intervals:
        bad |= (time >= start_s) & (time < end_s)
    if np.all(bad):
        raise LogError("the delays and exclude_s of the description leave no sample of the log")
    if np.any(bad):
        first, action = float(time[np.argmax(bad)]), f"{np.mean(bad):.1%} of the samples"
        report.append(Repair("time_s", "excluded intervals", len(intervals), first, action))
    return time[~bad], {name: values[~bad] for name, values in picked.items()}, tuple(report)


def _check_alive(picked: Mapping[str, Array], robot: Robot) -> None:
    """Raise LogError for a constant position of a joint whose other position moves."""
    for index, joint in enumerate(robot.joint_names):
        names = [name for name in column_names(joint, robot.is_prismatic[index]) if name in picked]
        positions = [name for name in names if "_position_" in name]
        still = [name for name in positions if is_constant(picked[name])]
        if len(positions) == 2 and len(still) == 1:
            value = picked[still[0]][0]
            raise LogError(
                f"'{still[0]}' is {value:.6g} all the time while the other side of the joint "
                "moves: the sensor is broken, or the drive was off; name another column"
            )


def _warn_of_degrees(path: Path, log: Log, robot: Robot) -> None:
    """Warn of joints whose positions exceed the limits in rad, but would not in degrees."""
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
                f"'{path}': the position of joint '{joint}' ranges from {np.min(values):.4g} to "
                f"{np.max(values):.4g} rad, its limits are {lower:.4g} and {upper:.4g} rad: "
                "if the angles are in degrees, give the unit 'deg'",
                SeaidWarning,
                stacklevel=4,
            )
