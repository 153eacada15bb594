"""Inference of a log description from the names and values of custom columns.

In: the files of a log. Out: a `Description`, with the choices that names and samples leave in
doubt. `names` reads the words of a name, `joints` and `base` assign the columns to joints, to the
base and to contacts, `inference` compares them with their samples, and `describe_log` finds the
clocks and composes the description.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain, combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid._progress import Display, counted
from seaid.drives import COMMANDS, Controller
from seaid.errors import Hertz, LogError, abridged, checked, in_one_line, listed, shortened
from seaid.log.channels import UNIT_FACTORS, refusal
from seaid.log.describe.base import infer_base
from seaid.log.describe.inference import Doubt, Inference, check_used, is_state, sentences
from seaid.log.describe.joints import (
    every_joint,
    is_sensor,
    joint_names,
    take_bare_names,
    take_positions,
    take_quantities,
)
from seaid.log.describe.names import Meaning, in_file, is_of_commands, meaning_of
from seaid.log.description import Clock, LogDescription, Source
from seaid.log.readers.csv_file import UNNAMED
from seaid.log.readers.opening import files_of, open_tables
from seaid.log.readers.table import Block, Table
from seaid.log.repair import LARGEST
from seaid.robot import Robot

_EXAMINED = 20_000
"""Samples at the start of a file that are examined, if it can be read in pieces."""

_MOST_LISTED = 500_000
"""Limit of failed reads times columns, a few seconds of an NPZ file, for the bisection of columns
that cannot be read."""

_SHOWN = 100
"""Most columns that are shown: unused ones, and those of a log without positions."""

_STEPS_S = {"s": 5e-5, "ms": 5e-2, "us": 50.0, "ns": 5e4}
"""Smallest step of a clock in this unit (20 kHz); the largest is a thousand times that."""


@dataclass(frozen=True, eq=False, repr=False)
class Description(Display):
    """An inferred log description, as `describe_log` returns it; str() is a table.

    Attributes
    ----------
    description : LogDescription
        The inferred description.
    unsure : tuple of Doubt
        The uncertain choices: sentences, each with the code of its doubt.
    unused : tuple of str
        Columns of the file that are not used.
    assumed : tuple of Doubt
        Usual choices that neither names nor samples contradict.
    gains : mapping {joint: Controller}
        Controllers with the gains of columns "kp" and "kd" next to the command of the joint. They
        are up to scale where the log has the supply of a motor and no torque: then they are in
        V per rad.
    """

    description: LogDescription
    unsure: tuple[Doubt, ...]
    unused: tuple[str, ...]
    assumed: tuple[Doubt, ...] = ()
    gains: Mapping[str, Controller] = field(default_factory=dict)

    def _in_short(self) -> str:
        more = f"{len(self.unsure)} unsure, {counted(len(self.unused), 'unused column')}"
        return f"{self.description._in_short()}, {more}"

    def to_toml(self) -> str:
        """Return the TOML of the description, with the uncertain choices as comments on top."""
        comments = "".join(f"# unsure: {abridged(choice)}\n" for choice in self.unsure)
        comments += "".join(f"# assumed: {abridged(choice)}\n" for choice in self.assumed)
        return comments + self.description.to_toml()

    def __str__(self) -> str:
        rows = [("joint", "quantity", "column", "unit", "time"), *self._rows()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        lines += [f"unsure: {choice}" for choice in self.unsure]
        lines += [f"assumed: {choice}" for choice in self.assumed]
        return "\n".join([*lines, f"not used: {listed(self.unused, _SHOWN) or 'none'}"])

    def _rows(self) -> Iterator[tuple[str, ...]]:
        """Yield a row of texts for each quantity of a joint, of the base and of a contact."""
        for (*_, owner), sources in self.description.tables.items():
            for name, source in sources.items():
                yield tuple(map(in_one_line, (owner, name, *self._cells(source))))

    def _cells(self, source: Source) -> tuple[str, str, str]:
        """Return columns, unit (or frame, or order) and time of a source."""
        plain = source.plain()
        columns = plain.get("column", "") if isinstance(plain, dict) else plain
        columns = columns if isinstance(columns, str) else ", ".join(columns)
        sign, times = "-" * (source.sign < 0), f" * {source.times}" * bool(source.times)
        above = "SI" if source.above is None else f"> {source.above:g}"
        unit = source.unit or source.frame or source.order or above
        side = f", at the {source.side}" * bool(source.side)
        clock = source.time or self.description.time or Clock("of the file")
        return f"{sign}{columns}{times}", unit + side, clock.column or "of the file"


@checked(LogError)
def describe_log(
    path: str | Path | Sequence[str | Path] | Mapping[str, Any],
    robot: Robot | None = None,
    *,
    rate_hz: Hertz | None = None,
    columns: Sequence[str] = (),
) -> Description:
    """Infer a log description from the names and values of the columns of a log.

    Print the result, check the uncertain choices, save `to_toml()` next to the log, and correct it
    by hand.

    Parameters
    ----------
    path : str, Path or a list of them, mapping or data frame
        The log, with custom columns, or the files of one log; or its columns.
    robot : Robot, optional
        Its joints name those of the log, and its limits distinguish degrees from radians. With a
        floating base, columns of the base and of its contacts are sought too.
    rate_hz : float, optional
        Sampling rate of a log that has no column of time.
    columns : sequence of str, optional
        Names in place of those of the file, or for a file without a header: one for each column, or
        time and arrays in the order of the joints, ["t", "q", "qd", "tau"].

    Returns
    -------
    Description
        The description, its uncertain choices and the unused columns.

    Raises
    ------
    LogError
        If the file cannot be read, no column looks like a position, or `columns` are too many or
        too few.

    Examples
    --------
    >>> guess = seaid.describe_log("run.csv", robot)
    >>> print(guess)
    >>> Path("run.toml").write_text(guess.to_toml())
    >>> seaid.describe_log("no_header.csv", robot, columns=["t", "q", "qd", "tau"])
    """
    paths, held = files_of(path)
    table = held or open_tables(paths)
    if columns:
        table = replace(table, labels=_labels(table, columns, robot))
    samples, inference = _understood(table, robot)
    clocks = _file_clocks(table, inference)
    inference.time = _time_of(inference, clocks.get(""))
    names = joint_names(inference)
    if not names:
        about = "; ".join(filter(None, [listed(table.names, _SHOWN), table.notice]))
        raise refusal("no_position", files=" + ".join(map(str, paths)), columns=about)
    joints = [*dict.fromkeys(names.values())]
    take_positions(inference, joints)
    for joint in joints:
        take_quantities(inference, joint)
    _set_clocks(inference, clocks, names, table.files)
    gains = _gains(samples, inference)
    check_used(inference, {x for clock in clocks.values() for x in clock.columns()})
    clock = _common_clock(table, inference, clocks, [*names], rate_hz)
    description = LogDescription(time=clock, files=_file_names(paths))
    description = description.with_tables(inference.tables)
    used = description.columns()
    unused = tuple(name for name in table.names if not used & {name, table.bare(name)})
    unsure, assumed = sentences(inference.notes), sentences(inference.assumed)
    return Description(description, unsure, unused, assumed, gains)


def _understood(table: Table, robot: Robot | None) -> tuple[Block, Inference]:
    """Return all samples, and the columns with a signal and what they mean."""
    inference = Inference({}, _meanings(table, robot), robot)
    take_bare_names(inference)
    samples = _all_samples(table, inference)
    if robot is not None and not robot.base_is_held:
        infer_base(table, replace(inference, data=samples), robot)
    inference.data |= _signal_columns(samples, inference)
    for name, values in samples.items():
        # In front of all others it has the numbers of the lines, and without a number it is none.
        if table.label(name) == UNNAMED and name != table.names[0] and np.isfinite(values).any():
            inference.note(name, "last_unnamed")
    return samples, inference


def _meanings(table: Table, robot: Robot | None) -> dict[str, Meaning]:
    """Return {column: its meaning} of the columns of one or several files."""
    joints, files = every_joint(robot), table.files
    return {x: in_file(meaning_of(table.label(x), joints), files.get(x, "")) for x in table.names}


def _labels(table: Table, names: Sequence[str], robot: Robot | None) -> dict[str, str]:
    """Return {column: name given by the user}; arrays have a column per joint of the robot."""
    # A matrix of an archive has a name of its own, under which it is no column.
    columns = [name for name in table.names if f"{name}[0]" not in table.names]
    if len(names) != len(columns):
        arrays = {name for name in names if meaning_of(name).quantity != "time"}
        places = _places(len(columns) - len(names) + len(arrays), len(arrays), robot)
        spelled = ([f"{x}[{place}]" for place in places] if x in arrays else [x] for x in names)
        names = [*chain.from_iterable(spelled)]
    if len(names) != len(columns):
        raise refusal("other_columns", columns=counted(len(columns), "column"))
    return dict(zip(columns, names, strict=True))


def _places(columns: int, arrays: int, robot: Robot | None) -> Sequence[str]:
    """Return the joints, or places, of each of several arrays that share columns equally."""
    width = columns // max(arrays, 1)
    if robot is None:
        return [*map(str, range(width))]
    sets = (robot.joint_names, every_joint(robot))
    return next((joints for joints in sets if len(joints) == width), ())


Clocks = Mapping[str, Clock]
"""{joint, or file, or "" for all joints: its clock}."""


def _set_clocks(
    inference: Inference, clocks: Clocks, names: Mapping[str, str], files: Mapping[str, str]
) -> None:
    """Give the sources of each joint its own clock, or that of the file of the column."""
    of_joints = {joint: clocks[tag] for tag, joint in names.items() if tag and tag in clocks}
    for joint, sources in inference.joints.items():
        for name, source in sources.items():
            clock = of_joints.get(joint) or clocks.get(files.get(source.column, joint))
            sources[name] = replace(source, time=clock)


def _file_names(paths: Sequence[Path]) -> tuple[str, ...]:
    """Return the names of several files in the folder of the first, the whole paths of others."""
    if len(paths) == 1:
        return ()
    folder = paths[0].parent
    return tuple(file.name if file.parent == folder else str(file.resolve()) for file in paths)


_GAINS = ("position_gain_Nm_per_rad", "velocity_gain_Nms_per_rad")
"""Quantities of columns that are gains of a `Controller`."""


def _gains(samples: Block, inference: Inference) -> dict[str, Controller]:
    """Return the controllers of commanded joints with columns of gains, and note each of these."""
    supplies = [name for name in samples if inference.meanings[name].quantity == "voltage"]
    unit = "N m at the joint"
    if supplies:
        unit = f"V per rad, as the motor has the supply '{supplies[0]}': is_up_to_scale = true"
    gains: dict[str, dict[str, Any]] = {}
    for name, values in samples.items():
        meaning = inference.meanings[name]
        is_commanded = not inference.joints.get(meaning.joint, {}).keys().isdisjoint(COMMANDS)
        if meaning.quantity in _GAINS and is_commanded:
            gain = _constant(values)
            inference.note(name, "gain_changes" if gain is None else "gain", unit=unit)
            if gain is not None:
                gains.setdefault(meaning.joint, {})[meaning.quantity] = gain
    return {joint: Controller(**x, is_up_to_scale=bool(supplies)) for joint, x in gains.items()}


def _constant(values: Array) -> float | None:
    """Return the only value of a gain, None if it changes or is negative."""
    finite = values[np.isfinite(values)]
    return float(finite[0]) if len({*finite}) == 1 and finite[0] >= 0 else None


def _common_clock(
    table: Table, inference: Inference, clocks: Clocks, labels: Sequence[str], rate_hz: float | None
) -> Clock | None:
    """Return the clock of all joints, None if each has its own or no column looks like one."""
    if table.clocks or not clocks.keys().isdisjoint(table.files.values()):
        return None
    common = clocks.get("")
    if clocks and clocks.keys() >= {*labels} and "" not in labels:
        doubt, column = ("own_clocks_beside", common.column) if common else ("own_clocks", "")
        inference.note("time", doubt, column=column)
        return None
    if not clocks and rate_hz:
        return Clock(rate_hz=rate_hz)
    if common is None:
        inference.note("time", "no_clock")
    return common


_OVERLAP = 0.8
"""Part of the shorter file's time from which two files are simultaneous."""

_TORQUES = {"torque", "current", "voltage"}


class _File:
    """A file: its columns but the time, the quantities of these, and its time span [s].

    It has none of these if its clock is not found.
    """

    def __init__(self, path: Path, robot: Robot) -> None:
        self.path, self.start_s, self.end_s = path, math.nan, math.nan
        self.columns = self.quantities = frozenset[str]()
        with suppress(LogError):
            self._read(robot)

    def _read(self, robot: Robot) -> None:
        table = open_tables([self.path])
        inference = Inference({}, _meanings(table, robot))
        inference.data |= _all_samples(table, inference)
        clock = None if table.clocks else _clocks(inference).get("")
        if clock is not None and clock.column is not None:
            time = clock.seconds(table.load(clock.columns()), 0)
            self.columns = frozenset(table.names) - {*clock.columns()}
            self.quantities = frozenset(inference.meanings[name].quantity for name in self.columns)
            self.start_s, self.end_s = float(np.nanmin(time)), float(np.nanmax(time))

    @property
    def is_complete(self) -> bool:
        """Whether it has both positions and torques."""
        return "position" in self.quantities and not _TORQUES.isdisjoint(self.quantities)

    def is_of_log(self, file: _File) -> bool:
        """Return whether files are of one log: of about the same time."""
        common = min(self.end_s, file.end_s) - max(self.start_s, file.start_s)
        shorter = min(self.end_s - self.start_s, file.end_s - file.start_s)
        return self.complements(file) and common > _OVERLAP * shorter

    def complements(self, file: _File) -> bool:
        """Return whether files share no column, and one at least lacks positions or torques.

        "run.state.csv" and "run.control.csv" share names: the latter has the commands.
        """
        if not (self.columns and file.columns):
            return False
        names = [x.path.name.split(".") for x in (self, file)]
        roles = {is_of_commands(x.path.name) for x in (self, file)}
        if names[0][0] == names[1][0] and min(map(len, names)) > 2 and len(roles) == 2:
            return True
        are_complete = self.is_complete and file.is_complete
        return self.columns.isdisjoint(file.columns) and not are_complete


def logs_of_files(
    paths: Sequence[Path], robot: Robot
) -> tuple[list[tuple[Path, ...]], tuple[Doubt, ...]]:
    """Return the files of each log, and what is doubtful about it.

    Files are of one log if none of their columns is in two of them, their times overlap, and not
    each has both positions and torques. Clocks that begin at zero overlap in files of different
    motions too, so that each such log is a doubt.
    """
    groups: list[list[_File]] = []
    for path in paths:
        file = _File(path, robot)
        group = next((group for group in groups if all(map(file.is_of_log, group))), [])
        if not group:
            groups.append(group)
        group.append(file)
    return [tuple(file.path for file in group) for group in groups], tuple(_doubts(groups))


def _doubts(groups: Sequence[Sequence[_File]]) -> Iterator[Doubt]:
    """Yield what is doubtful about the files of each log, and about logs that may be one."""
    for group in groups:
        if len(group) > 1:
            common = min(file.end_s for file in group) - max(file.start_s for file in group)
            yield Doubt.of("one_log", common=common).about(file.path.name for file in group)
    for earlier, file in combinations([group[0] for group in groups], 2):
        if file.complements(earlier):
            yield Doubt.of("no_common_time", first=earlier.path.name, second=file.path.name)


def _all_samples(table: Table, inference: Inference) -> Block:
    """Return all readable columns of numbers, from the start of long files; note the others."""
    names = [name for name, count in Counter(table.names).items() if count == 1]
    return _readable(table, inference, names, [])


def _readable(table: Table, inference: Inference, names: list[str], refusals: list[str]) -> Block:
    """Return the readable ones of columns by bisection; `refusals` are those of all attempts."""
    # A read of all columns is fast, but one bad column refuses it: halves find that in
    # log2(columns) reads.
    try:
        return table.start(names, _EXAMINED)
    except LogError as problem:
        refusals.append(str(problem))
        # All columns alone are refused alike: the file is invalid, and not this column.
        is_of_file = refusals[-1] == refusals[0] and f"'{shortened(names[0])}'" not in refusals[0]
        if len(names) == 1 and is_of_file:
            raise
    if len(names) > 1 and len(refusals) * len(table.names) < _MOST_LISTED:
        halves = names[: len(names) // 2], names[len(names) // 2 :]
        first, second = (_readable(table, inference, half, refusals) for half in halves)
        return first | second
    for name in names:
        if f"{name}[0]" not in table.names:  # a matrix, whose columns are read
            inference.note(name, "no_numbers")
    return {}


def _signal_columns(data: Block, inference: Inference) -> Block:
    """Return the columns with a signal; note sensors without one."""
    signals = {}
    for name, values in data.items():
        finite = values[np.isfinite(values)]
        doubt = _without_signal(finite, inference.meanings[name])
        if doubt is None:
            signals[name] = values
        else:
            inference.note(name, doubt, largest=LARGEST, value=finite[0] if len(finite) else 0.0)
    return signals


def _without_signal(finite: Array, meaning: Meaning) -> str | None:
    """Return the doubt about a column without a signal, "" if it needs none; None for a signal."""
    moves = bool(np.any(finite != finite[:1]))
    may_stand = not {"voltage", "command"}.isdisjoint((meaning.quantity, meaning.role))
    if np.any(np.abs(finite) > LARGEST):
        return "too_large"
    if is_sensor(meaning) and moves and is_state(finite):
        return "state"
    if moves or (may_stand and len(finite)):
        return None
    return ("dead" if len(finite) else "empty") * is_sensor(meaning)


def _time_of(inference: Inference, clock: Clock | None) -> Array | None:
    """Return the samples of a clock in seconds since the first."""
    if clock is None or not clock.columns() or not inference.data.keys() >= {*clock.columns()}:
        return None
    seconds = clock.seconds(inference.data, 0)
    return np.asarray(seconds - seconds[0], dtype=float)


def _file_clocks(table: Table, inference: Inference) -> dict[str, Clock]:
    """Return {joint, or "" for all: clock}; {file: clock} if names differ in several files.

    A file that defines the clocks of its columns needs none.
    """
    if table.clocks:
        return {}
    if not table.files:
        return _clocks(inference)
    clocks, files = dict[str, Clock](), dict.fromkeys(table.files.values())
    for file in files:
        data = {x: values for x, values in inference.data.items() if table.files[x] == file}
        clock = _clocks(replace(inference, data=data)).get("")
        clocks |= {file: clock} if clock else {}
    names = {(table.bare(str(clock.column)), clock.unit) for clock in clocks.values()}
    if len(names) == 1 and len(clocks) == len(files):
        ((column, unit),) = names
        return {"": Clock(column, unit)}
    return clocks


def _clocks(inference: Inference) -> dict[str, Clock]:
    """Return {joint, or "" for all joints: clock}."""
    clocks: dict[str, Clock] = {}
    if split := _clock_of_two_columns(inference):
        return {"": split}
    for name, meaning in inference.logged("time").items():
        steps = np.diff(inference.finite(name))
        # Not all steps: stamps may come late or be repeated, which a repair corrects afterwards.
        grows = len(steps) > 0 and np.mean(steps >= 0) > 0.95 and np.median(steps) > 0
        if not grows:
            continue
        tag = meaning.joint if re.fullmatch(r"(tx_|rx_)?\d+", meaning.joint) else ""
        tag = tag.rsplit("_", 1)[-1]
        if tag in clocks:
            inference.note(name, "second_clock", column=clocks[tag].column)
            continue
        clocks[tag] = Clock(name, _time_unit(name, meaning, steps, inference))
    # The names decide first, because a position in slow motion may increase evenly, too.
    return clocks or _nameless_clock(inference)


_WHOLE = 1e9
"""Nanoseconds of a second."""


def _clock_of_two_columns(inference: Inference) -> Clock | None:
    """Return the clock of whole seconds and nanoseconds, as in the header of a ROS message."""
    for seconds, rest in permutations(inference.logged("time"), 2):
        s, ns = inference.data[seconds], inference.data[rest]
        is_split = np.all(s == np.round(s)) and np.all((ns >= 0) & (ns < _WHOLE))
        # Nanoseconds of a split clock fall back to zero within the log, after half a second at
        # least.
        if not is_split or not np.any(np.diff(ns) < 0) or np.max(ns) < _WHOLE / 2:
            continue
        steps = np.diff(s) + np.diff(ns) / _WHOLE
        # Columns of different clocks are a second apart wherever only one of them turns over.
        if np.all(steps >= 0) and np.max(steps) < 1.0 + np.median(steps):
            return Clock(seconds, nanoseconds=rest)
    return None


def _nameless_clock(inference: Inference) -> dict[str, Clock]:
    """Return as clock the first evenly increasing column whose name has no quantity."""
    for name, meaning in inference.logged("").items():
        steps = np.diff(inference.data[name])
        is_growing = len(steps) > 1 and bool(np.all(steps > 0))
        if is_growing and np.std(steps) < 0.5 * np.mean(steps):
            inference.note(name, "nameless_clock")
            return {"": Clock(name, _time_unit(name, meaning, steps, inference))}
    return {}


def _time_unit(name: str, meaning: Meaning, steps: Array, inference: Inference) -> str:
    step, stated = float(np.median(steps)), meaning.unit
    # Steps of 20 kHz to 20 Hz: 50 us to 50 ms. In s, ms, us and ns these ranges do not overlap.
    unit = next((unit for unit, least in _STEPS_S.items() if least <= step < 1000 * least), "s")
    if stated not in _STEPS_S:
        if unit != "s" or step > 0.05:
            inference.note(name, "time_unit", step=step, unit=unit)
        return unit
    # By its name a clock may be slower, but with less than 2 Hz no motion of a joint is followed.
    if not _STEPS_S[stated] <= step < 10_000 * _STEPS_S[stated]:
        rate_hz = 1 / (step * UNIT_FACTORS["s"][stated])
        inference.note(name, "time_rate", column=name, stated=stated, rate=rate_hz, unit=unit)
    return str(stated)
