"""Reading a log of any supported format, with the column names of seaid or custom columns.

`repaired` detects and counts the faults of channels, and repairs or refuses them. Every channel may
have its own clock; the result has one uniform time grid.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array, is_constant
from seaid.errors import LogError, SeaidWarning, checked
from seaid.log.channels import quantity_of, refusal
from seaid.log.describe import Description
from seaid.log.description import Described, LogDescription, description_for
from seaid.log.log import WRITTEN, Log, columns_by_joint, unread_columns, write_log
from seaid.log.readers.opening import files_of, open_tables
from seaid.log.readers.table import Block
from seaid.log.repair import FEWEST, Channel, Repair, Repairs, Report
from seaid.log.repair.channels import bridged_s, in_gap, on_time, repaired_channel, resampled
from seaid.log.repair.clocks import (
    clock_lines,
    clocks_of,
    irregular_steps,
    repaired_group,
    typical_step,
    with_regular_clock,
)
from seaid.log.sources import Selection, completed, of_other_names, selected
from seaid.log.tables import Interval
from seaid.robot import Robot

__all__ = ["WRITTEN", "Log", "read_log", "write_log"]

Stamped = dict[str, tuple[Array, Array]]
"""{channel: its times and its samples}."""

Repaired = tuple[Array, Block, tuple[Repair, ...]]
"""Time, {channel: samples at these times}, and what was repaired."""


@checked(LogError)
def read_log(
    path: str | Path | Sequence[str | Path] | Mapping[str, Any],
    robot: Robot,
    *,
    description: Described | Description | None = None,
    repair: Repairs | None = None,
) -> Log:
    """Read a log of a robot.

    Parameters
    ----------
    path : str, Path or a list of them, mapping or data frame
        CSV and other tables of text, NPZ, Parquet, HDF5, JSON, MATLAB, ROS bag (file or folder) or
        HEBI log. A file with the column names of `Log.columns` and `time_s` needs no further
        arguments. A list has the files of one log, each with its own time: they are resampled to
        one. A description (.toml) with `files` may stand for them. A mapping {column: samples} and
        a data frame are read as a file with these columns.
    robot : Robot
        The robot; the log must have the sensors that its drives need.
    description : LogDescription, Description of `describe_log`, mapping, str or Path, optional
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
        Of columns that are NaN throughout, and of those that are named as seaid's but are of no
        joint of the robot. Angles in degrees are found by `seaid.check`.

    Examples
    --------
    >>> log = seaid.read_log("run.csv", robot)
    >>> knee = {"joint_position": {"column": "pos_2", "unit": "deg"}}
    >>> custom = {"time": {"column": "t", "unit": "ms"}, "joints": {"knee": knee}}
    >>> log = seaid.read_log("custom.csv", robot, description=custom, repair=seaid.Repairs())
    """
    paths, held = files_of(path)
    if not paths:
        raise LogError("path= is an empty list: name the files of the log")
    described, paths = _described_files(paths, description)
    # For messages only; it names all files of the log.
    path, table = Path(" + ".join(map(str, paths))), held or open_tables(paths)
    complete = completed(table, described or LogDescription(), robot)
    selection = selected(path, table, complete, robot)
    data = table.load(selection.columns)
    if described is None and selection.has_one_clock and repair is None:
        log = selection.log(data)
    else:
        log = _as_described(selection, data, complete, repair or complete.repair)
    if described is not None or not selection.is_own:
        log = replace(log, description=complete.to_dict())
    _warn_of_columns(path, log, robot, table.names, complete)
    return log


def _as_described(
    selection: Selection, data: Block, description: LogDescription, limits: Repairs
) -> Log:
    """Return the log of columns, each with its own clock, without delays and excluded intervals."""
    channels = selection.channels(data)
    with selection.named():
        time, picked, report = repaired(channels, limits)
        delays_s = {channel.name: channel.delay_s for channel in channels if channel.delay_s}
        time, picked, more = _on_time(time, picked, delays_s, description.exclude_s)
        log = selection.composed(time, picked, report + more)
        _check_alive(log)
        return log


_OWN_NAMES = ("_position_rad", "_position_m", "_torque_Nm", "_force_N")
"""Ends of seaid's names of positions and torques."""


def read_or_describe(
    files: Sequence[Path], robot: Robot, describe: Callable[..., Description]
) -> Log | Description:
    """Return a log that needs no more description, or what columns without seaid's names may mean.

    `describe` is `describe_log` with its options. Without an answer raise LogError for seaid's own
    names, if the files have any.
    """
    is_described = files[0].with_suffix(".toml").is_file()
    try:
        log = read_log(files, robot)
    except LogError as problem:
        if is_described or not files[0].exists():
            raise
        try:
            return describe(files, robot)
        except LogError as unnamed:
            has_own = any(name.endswith(_OWN_NAMES) for name in open_tables(files).names)
            raise problem if has_own else unnamed from None
    with suppress(LogError):
        guess = describe(files, robot)
        rest = of_other_names(guess.description, robot)
        if not is_described and any((rest.joints, rest.base, rest.contacts)):
            read_log(files, robot, description=rest)
            return replace(guess, description=rest)
    return log


def _described_files(
    paths: list[Path], description: Described | Description | None
) -> tuple[LogDescription | None, list[Path]]:
    """Return the description of a log, if it has one, and the files that it names, if any."""
    if isinstance(description, Description):
        description = description.description
    if paths[0].suffix.lower() == ".toml" and description is None:
        description = paths[0]
    described = description_for(paths[0], description)
    if described is not None and described.files and len(paths) == 1:
        folder = description if isinstance(description, str | Path) else paths[0]
        paths = [Path(folder).parent / file for file in described.files]
    return described, paths


def _on_time(
    time: Array, picked: Block, delays_s: Mapping[str, float], intervals: Sequence[Interval]
) -> Repaired:
    """Return time, samples and repairs without the described delays and excluded intervals."""
    # Delays before everything that combines channels: deflections and rotations need one instant.
    covered, moved = on_time(time, picked, delays_s)
    picked = {name: values[covered] for name, values in picked.items()} | moved
    report = [
        Repair.of(name, "delay", 1, time[0], delay_ms=1e3 * delay)
        for name, delay in delays_s.items()
    ]
    time = time[covered]
    bad = np.zeros(len(time), dtype=bool)
    for start_s, end_s in intervals:
        bad |= (time >= start_s) & (time < end_s)
    if np.all(bad):
        raise LogError("the delays and exclude_s of the description leave no sample of the log")
    if np.any(bad):
        first, count, share = time[np.argmax(bad)], len(intervals), np.mean(bad)
        report.append(Repair.of("time_s", "excluded intervals", count, first, share=share))
    return time[~bad], {name: values[~bad] for name, values in picked.items()}, tuple(report)


def _check_alive(log: Log) -> None:
    """Raise LogError for a constant position of a joint whose other position moves."""
    logged = log.columns()
    for names in columns_by_joint(log).values():
        positions = [names[x] for x in ("motor_position", "joint_position") if names[x] in logged]
        still = [name for name in positions if is_constant(logged[name])]
        if len(positions) == 2 and len(still) == 1:
            value = logged[still[0]][0]
            raise refusal("dead_sensor", column=still[0], value=value)


def _warn_of_columns(
    path: Path, log: Log, robot: Robot, names: Sequence[str], described: LogDescription
) -> None:
    """Warn of columns without a number, and of those that are nearly named as seaid's."""
    logged, used = log.columns(), described.columns()
    faults = [
        f"'{name}' is NaN throughout and counts as not logged"
        for joint, columns in columns_by_joint(robot).items()
        for field, name in columns.items()
        if field != "deflection" and field in described.joints.get(joint, {}) and name not in logged
    ]
    faults += unread_columns(robot, [name for name in names if name not in used])
    if faults:
        text = "; ".join(faults[:_MOST_NAMED])
        more = f"; and {len(faults) - _MOST_NAMED} more" if len(faults) > _MOST_NAMED else ""
        warnings.warn(f"'{path}': {text}{more}", SeaidWarning, stacklevel=4)


_MOST_NAMED = 5
"""Most columns that one warning names."""


def repaired(channels: Sequence[Channel], limits: Repairs | None = None) -> Repaired:
    """Return a uniform time grid (T,) [s], {channel: samples (T,)}, and the report of repairs.

    The grid is on the clock of the first channel and covers the time that all channels share,
    without the holes of any channel. Channels without any number are all NaN. A log of one regular
    clock without faults is returned unchanged. Raises LogError, naming channel and place, beyond
    the limits.
    """
    report = Report(Repairs() if limits is None else limits)
    if not channels:
        raise LogError("no channels to repair: a log needs one at least")
    clocks = clocks_of(channels)
    if len(clocks) == 1:
        clocks = [channels := with_regular_clock(channels, report)]
    usable = _repaired_channels(clocks, report)
    # Bit by bit as logged: a resampling that nothing needs would still round.
    if len(clocks) == 1 and report.limits.rate_hz is None and not _changed(channels, usable):
        time, sampled = channels[0].time, {channel.name: channel.values for channel in channels}
    else:
        time, sampled = _on_grid(usable, report)
    nothing = np.full(len(time), np.nan)
    return time, {x.name: sampled.get(x.name, nothing) for x in channels}, tuple(report.repairs)


def _repaired_channels(clocks: Sequence[Sequence[Channel]], report: Report) -> Stamped:
    """Return the channels with enough samples, on the first clock."""
    usable: Stamped = {}
    for group, line in zip(clocks, clock_lines(clocks, report), strict=True):
        clock = repaired_group(group, report)
        for channel in group:
            time, values = repaired_channel(channel, clock, report)
            if len(time) >= FEWEST:
                usable[channel.name] = line.to_reference(time) if line else time, values
    if not usable:
        raise LogError("no channel of the log has as many as four samples that are numbers")
    return usable


def _changed(channels: Sequence[Channel], usable: Stamped) -> bool:
    """Return whether samples were removed or moved, or the steps are irregular."""

    def is_changed(channel: Channel) -> bool:
        if channel.name not in usable:
            return bool(np.any(np.isfinite(channel.values)))
        pairs = zip(usable[channel.name], (channel.time, channel.values), strict=True)
        return not all(np.array_equal(*pair) for pair in pairs)

    return bool(np.any(irregular_steps(channels[0].time))) or any(map(is_changed, channels))


def _on_grid(usable: Stamped, report: Report) -> tuple[Array, Block]:
    """Return the channels on a uniform grid over their common time, without their holes.

    The last command of a channel holds to the end, and between commands there is no hole.
    """
    times = {name: time for name, (time, _) in usable.items()}
    measured = [name for name in usable if not quantity_of(name).is_command] or list(usable)
    start, end = _common_time(times, measured, report)
    rates = {name: 1.0 / typical_step(time) for name, time in times.items()}
    rate_hz = report.limits.rate_hz or max(rates.values())
    grid = start + np.arange(math.floor((end - start) * rate_hz + 1e-6) + 1) / rate_hz
    # Rounding may put the last instant behind `end`, where a spline would extrapolate.
    grid = np.minimum(grid, end)
    sampled = {
        name: resampled(time, values, grid, rate_hz, rates[name], quantity_of(name).interpolation)
        for name, (time, values) in usable.items()
    }
    in_hole = np.zeros(len(grid), dtype=bool)
    for name in measured:
        # By the stamps of the channel itself: what is a hole for a fast sensor is a step of a slow
        # one.
        in_hole |= in_gap(times[name], grid, bridged_s(times[name], report.limits))
    return grid[~in_hole], {name: values[~in_hole] for name, values in sampled.items()}


def _common_time(times: Block, measured: Sequence[str], report: Report) -> tuple[float, float]:
    """Return start and end of what all channels share. Raises LogError if that is too little."""
    late = max(times, key=lambda name: times[name][0])
    early = min(measured, key=lambda name: times[name][-1])
    start, end = float(times[late][0]), float(times[early][-1])
    longest = max(time[-1] - time[0] for time in times.values())
    ends = {"late": late, "start": start, "early": early, "end": end}
    common = {"common_s": max(end - start, 0.0), "longest_s": longest}
    report.check("common_time", 1.0 - (end - start) / longest, **ends, **common)
    return start, end
