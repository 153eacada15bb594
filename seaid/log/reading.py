"""Logs of a robot read from files of many kinds; Log and write_log from here as well."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, SeaidWarning, shown
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
from seaid.log.readers.opening import log_path, open_table
from seaid.log.readers.table import check_lengths
from seaid.log.repair.data import Channel, Repairs
from seaid.log.repair.repair import repaired
from seaid.robot import Robot

__all__ = ["WRITTEN", "Log", "read_log", "write_log"]

_FAR, _SLACK = 1.0, 0.2
"""Parts of the range of a joint beyond its limits, and rad, that make angles look like degrees."""


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
    path = log_path(path)
    if not isinstance(repair, Repairs | None):
        raise LogError(f"repair must be seaid.Repairs(...), found {shown(repair)}")
    described = description_for(path, None if columns else description)
    if columns and description is not None:
        raise LogError("give columns= or description=, not both: a description names the columns")
    table = open_table(path)
    if described is not None:
        channels = channels_of(path, table, described, robot)
        log = _repaired(path, channels, repair or described.repair, robot, table.names, described)
    else:
        wanted = wanted_columns(path, table, robot, columns or {})
        data = table.load(list(dict.fromkeys(foreign for foreign, _ in wanted.values())))
        check_lengths(path, {name: len(values) for name, values in data.items()})
        if repair is None:
            log = log_of(path, data, wanted, robot, table.names)
        else:
            picked = {name: data[foreign] * factor for name, (foreign, factor) in wanted.items()}
            time = picked.pop("time_s")
            channels = [Channel(name, time, values) for name, values in picked.items()]
            log = _repaired(path, channels, repair, robot, table.names, None)
    _suspect_degrees(path, log, robot)
    return log


def _repaired(
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
        return replace(sorted_log({"time_s": time, **picked}, robot, file_names), report=report)
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
