"""Checks of what columns were taken for: by all words of their names, and by their samples.

A meaning is sure if each word is understood and the samples agree: a position is the integral of
the velocity of its joint and stays within its limits, a current has two signs, a raw value is not
in whole numbers. Everything else becomes a doubt; usual conventions become assumptions.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np

from seaid._arrays import Array, safely
from seaid._files import read_toml
from seaid.errors import LogError, in_one_line, listed
from seaid.log.channels import UNIT_FACTORS
from seaid.log.describe.names import Meaning, Role, is_of_another_part
from seaid.log.description import Source, Sources
from seaid.log.readers.table import Block
from seaid.robot import Robot

_FILE = Path(__file__).with_name("doubts.toml")
DOUBTS: Mapping[str, str] = read_toml(_FILE, "the texts of doubts", LogError)
"""{name of a doubt: its text, with braces for values of the log}."""


class Doubt(str):
    """What is uncertain, in words, and the `code` by which a table of texts names it."""

    code: str

    def __new__(cls, text: str, code: str = "") -> Self:
        """Return the text as a doubt."""
        doubt = super().__new__(cls, text)
        doubt.code = code
        return doubt

    @classmethod
    def of(cls, code: str, texts: Mapping[str, str] = DOUBTS, /, **values: Any) -> Self:
        """Return the doubt of a table {code: text}, with values of the log for its braces."""
        return cls(texts[code].format(**values), code)

    def about(self, names: Iterable[str], most: int = 20) -> Self:
        """Return the doubt behind the columns, joints or files that it is about."""
        return type(self)(in_one_line(f"{listed(names, most)}: {self}"), self.code)


_LISTED = 100
"""Most columns named in one note."""

_EQUAL = 1e-9
"""Largest difference of a measurement from a command, over its range, for a copy of it."""

_ALIKE = 0.995
"""Correlation with a signal of a joint above which an unknown column is named for it."""

_FOLLOWS, _UNRELATED = 0.95, 0.5
"""Shares of the variance of a position that the integral of a velocity explains: it is its
velocity, or it is something else."""

_LOOP_SLOPE, _SMOOTH, _FEWEST = 1.6, 5, 100
"""Most slope of a position command over the position, next to its derivatives (measured on loops of
ten robots: 0.95 to 1.11; a weight adds its stiffness over the gain); samples of the moving averages
before derivatives; fewest samples of what is compared."""

SCALE_SPREAD = 0.05
"""Relative error of the scale between a position and an integrated velocity, by noise, or between
two encoders, by the deflection of a spring."""

_LEAST_RANGE = 0.5
"""Range of the numbers of a position that is a motion: a smaller one, in degrees, would be so small
that nobody identifies a robot from it."""

_BEYOND = 0.2
"""Share of the range of a joint by which encoders exceed the limits in its file."""

_FEW, _WHOLE = 8, 20.0
"""Most distinct whole numbers of a state such as a mode; range from which whole numbers without a
unit are raw values of a drive."""

POSITION_FACTORS = {**UNIT_FACTORS["rad"], **UNIT_FACTORS["m"]}
"""Factors of the units of positions to rad or m; counts have none that is known."""

_RATES = {**UNIT_FACTORS["rad_per_s"], **UNIT_FACTORS["m_per_s"]}
_DRIVE = re.compile(r"(?<![a-z])(iq|q_?current|odrive|moteus)(?![a-z])", re.IGNORECASE)
"""Names of drives, which have turns of the motor for angles of the joint."""


@dataclass(eq=False)
class Inference:
    """The columns of a log: samples, meanings of their names, and notes on uncertain choices.

    `assumed` are conventions that nothing contradicts; `time` are the samples of the clock of all
    columns in seconds, None if there is none.
    """

    data: Block
    meanings: dict[str, Meaning]
    robot: Robot | None = None
    notes: dict[Doubt, list[str]] = field(default_factory=dict)
    assumed: dict[Doubt, list[str]] = field(default_factory=dict)
    time: Array | None = None
    tables: defaultdict[tuple[str, ...], dict[str, Source]] = field(
        default_factory=partial(defaultdict, dict)
    )

    @property
    def joints(self) -> dict[str, dict[str, Source]]:
        """The sources of joints: {joint: {quantity: source}}."""
        return {key[1]: x for key, x in self.tables.items() if key[0] == "joints"}

    def having(self, quantity: str, joint: str, *sides: str, role: Role = "measured") -> list[str]:
        """Return the columns with a quantity of a joint, in one role.

        `sides` selects those whose names state one of these sides, or none if it contains "".
        Those that say "measured" are first.
        """
        columns = [
            name
            for name in self._by_meaning.get((quantity, joint, role), ())
            if name in self.data and (not sides or self.meanings[name].side in sides)
        ]
        return sorted(columns, key=lambda name: not self.meanings[name].is_said)

    def logged(self, quantity: str) -> dict[str, Meaning]:
        """Return the columns with samples whose names say a quantity, and their meanings."""
        meanings = self.meanings
        return {x: meanings[x] for x in self.data if meanings[x].quantity == quantity}

    def commands(self, joint: str, quantity: str = "position") -> list[str]:
        """Return the columns with a commanded quantity of a joint.

        A column whose name has only "command" is a position command if a position of the joint
        follows it.
        """
        label = joint.removesuffix("_joint")
        unnamed = self.logged("") if quantity == "position" else {}
        return [
            name
            for name, meaning in {**self.logged(quantity), **unnamed}.items()
            if meaning.role == "command" and meaning.joint.removesuffix("_joint") == label
            if meaning.quantity or self._leads(name, joint)
        ]

    def _leads(self, name: str, joint: str) -> bool:
        """Return whether a position of a joint follows a column, in the same unit."""
        return any(
            follows(self.data[position], self.data[name])
            for position in self.having("position", joint)
        )

    def take(self, name: str, doubt: str = "", /, **changes: Any) -> None:
        """Change the meaning of a column, and note why."""
        self.meanings[name] = replace(self.meanings[name], **changes)
        self.__dict__.pop("_by_meaning", None)  # computed anew with the next question
        self.note(name, doubt, **changes)

    def alike(self, name: str) -> list[str]:
        """Return the columns of other joints that have the name of a column but for one word.

        They are those of the same sensor: "hip_position_inc" and "knee_position_inc".
        """
        meaning, forms = self.meanings[name], {*_forms(name)}
        others = (x for x, m in self.logged(meaning.quantity).items() if m.joint != meaning.joint)
        return [x for x in others if not forms.isdisjoint(_forms(x))]

    def finite(self, name: str) -> Array:
        """Return the samples of a column that are finite."""
        values = self.data[name]
        return values[np.isfinite(values)]

    def least_counts(self, name: str) -> float:
        """Return the least counts per turn of an encoder that counts within one turn.

        With them the position of a joint stays within its range, too.
        """
        values, limits = self.finite(name), self.limits(self.meanings[name].joint)
        turns = 0.0
        if limits is not None and limits[0] < limits[1] and self.meanings[name].side != "motor":
            # 2 pi range / counts <= upper - lower, but for an offset of the encoder
            turns = 2 * np.pi / ((1 + _BEYOND) * (limits[1] - limits[0]))
        return float(max(np.max(np.abs(values)), turns * np.ptp(values)))

    def has_one_sign(self, name: str) -> bool:
        """Return whether the samples of a voltage or a duty cycle have one sign.

        The voltage of a motor that moves has both signs; that of a supply has one, and so have the
        pulses of a servo.
        """
        return not np.min(self.finite(name)) < 0 < np.max(self.finite(name))

    @property
    def supply(self) -> str:
        """The voltage of the supply that all motors have, an empty text if it is not logged."""
        joints = () if self.robot is None else self.robot.joint_names
        logged = self.logged("voltage").items()
        voltages = (x for x, m in logged if m.joint not in joints and m.role != "command")
        return next(filter(self.has_one_sign, voltages), "")

    def limits(self, joint: str) -> tuple[float, float] | None:
        """Return the lowest and the highest position of a joint, None if it is not known."""
        robot = self.robot
        return robot.position_range(joint) if robot and joint in robot.joint_names else None

    def is_prismatic(self, joint: str) -> bool:
        """Return whether a joint is known to be prismatic."""
        robot = self.robot
        return bool(robot and self.limits(joint) and robot.is_prismatic[robot.index(joint)])

    def is_within(self, column: str, factor: float, joint: str, offset: float = 0.0) -> bool:
        """Return whether factor x position + offset stays about within the limits of a joint."""
        limits = self.limits(joint)
        if limits is None:
            return False
        values, more = factor * self.finite(column) + offset, _BEYOND * (limits[1] - limits[0])
        return bool(limits[0] - more <= np.min(values) and np.max(values) <= limits[1] + more)

    def is_far(self, column: str) -> bool:
        """Return whether a position moves by half a unit or more: in degrees less is hardly any."""
        return float(np.ptp(self.finite(column))) >= _LEAST_RANGE

    @cached_property
    def _by_meaning(self) -> dict[tuple[str, str, Role], list[str]]:
        """The columns by quantity, joint and role, once all meanings are those of joints."""
        columns: dict[tuple[str, str, Role], list[str]] = {}
        for name, meaning in self.meanings.items():
            key = meaning.quantity, meaning.joint, meaning.role
            columns.setdefault(key, []).append(name)
        return columns

    @cached_property
    def is_of_a_drive(self) -> bool:
        """Whether names of the log are those of drives that have turns for angles."""
        return any(_DRIVE.search(name) for name in self.meanings)

    def note(self, about: str, doubt: str, /, *, is_usual: bool = False, **values: Any) -> None:
        """Note a choice by a doubt of `doubts.toml`, if any, with values of the log.

        A usual choice that the samples allow is assumed, any other one is uncertain. Notes with the
        same text become one sentence.
        """
        if doubt:
            text = Doubt.of(doubt, **values)
            (self.assumed if is_usual else self.notes).setdefault(text, []).append(about)


def follows(position: Array, command: Array) -> bool:
    """Return whether a position (T,) follows a command (T,) in the same unit, or its loop does.

    A soft or fast loop is far from its command, u = a q + b q' + c q'' + d with a near 1: its
    weight, friction and inertia over its gain. Velocities and torques have another a, or no such
    sum.
    """
    if len(position) != len(command):
        return False
    used = np.isfinite(position) & np.isfinite(command)
    q, u = position[used], command[used]
    # The position alone explains half of the variance of the command; an offset does not count.
    if np.var(q - u) < (1 - _UNRELATED) * np.var(u):
        return True
    if len(q) < _FEWEST or np.ptp(q) == 0 or np.ptp(u) == 0:
        return False
    smooth = np.ones(_SMOOTH) / _SMOOTH
    # Two moving averages, because two derivatives amplify the noise; q and u alike, so that the sum
    # u = a q + b q' + c q'' + d still holds.
    q, u = (np.convolve(np.convolve(x, smooth, "valid"), smooth, "valid") for x in (q, u))
    rate = np.gradient(q)
    columns = np.column_stack([q, rate, np.gradient(rate), np.ones(len(q))])
    sizes = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    # q'' per sample squared is smaller than q by orders of magnitude: unit norms keep its rank.
    columns = columns / sizes
    fit = safely(np.linalg.lstsq, columns, u, rcond=None, what="a command", error=LogError)[0]
    is_sum = np.var(u - columns @ fit) < (1 - _FOLLOWS) * np.var(u)
    return bool(is_sum and 1 / _LOOP_SLOPE < fit[0] / sizes[0] < _LOOP_SLOPE)


def sentences(notes: Mapping[Doubt, list[str]]) -> tuple[Doubt, ...]:
    """Return notes {doubt: what it is about} as sentences."""
    return tuple(doubt.about(names, _LISTED) for doubt, names in notes.items())


def correlation(first: Array, second: Array) -> float:
    """Return the correlation of two channels, 0 where they cannot be compared."""
    if len(first) != len(second):
        return 0.0
    good = np.isfinite(first) & np.isfinite(second)
    if np.sum(good) < 3 or np.ptp(first[good]) == 0 or np.ptp(second[good]) == 0:
        return 0.0
    return float(np.corrcoef(first[good], second[good])[0, 1])


def is_state(values: Array) -> bool:
    """Return whether samples are a few whole numbers, as of a mode or a flag."""
    is_whole = bool(np.all(values == np.round(values)))
    return len(values) >= _FEWEST and is_whole and len(np.unique(values)) <= _FEW


def unit_by_velocity(inference: Inference, column: str, joint: str) -> str | None:
    """Return the unit of an angle that a velocity with a unit gives, None if there is none."""
    for name, share, scale in _velocities(inference, column, joint):
        rate = _RATES.get(inference.meanings[name].unit or "")
        if rate is None or share < _FOLLOWS:
            continue
        for unit in ("rad", "deg", "turn", "mrad"):
            # q = scale x integral, in the numbers of the file: in SI units the scale is 1.
            if abs(abs(scale) * UNIT_FACTORS["rad"][unit] / rate - 1) < SCALE_SPREAD:
                return unit
    return None


def _velocities(
    inference: Inference, column: str, joint: str
) -> Iterator[tuple[str, float, float]]:
    """Yield velocities of a joint, how much of a position their integral explains, and its scale.

    position = scale * (integral of the velocity) + a + b t, where b is an offset of the velocity.
    """
    time, position = inference.time, inference.data[column]
    side = inference.meanings[column].side
    sides = {side, ""} if side else {"", "motor", "joint"}
    for name in inference.having("velocity", joint, *sides):
        speed = inference.data[name]
        if time is None or not len(time) == len(position) == len(speed):
            return
        good = np.isfinite(time) & np.isfinite(position) & np.isfinite(speed)
        if np.sum(good) < 20 or np.ptp(speed[good]) == 0:
            continue
        t, v, q = time[good] - time[good][0], speed[good], position[good]
        # The integral and not the derivative is compared: it averages noise, the derivative
        # amplifies it.
        path = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])
        t -= np.mean(t)
        # Without mean and line in time, which an unknown start and an offset of the velocity add.
        path, q = (signal - np.mean(signal) - t * (t @ signal) / (t @ t) for signal in (path, q))
        power = float(path @ path)
        if power > 0 and np.var(q) > 0:
            # Squared correlation, and the slope of q over the path.
            yield name, float((path @ q) ** 2 / (power * (q @ q))), float(path @ q) / power


def check_used(inference: Inference, clocks: Collection[str]) -> None:
    """Note what words or samples of the columns leave in doubt; `clocks` are those of the time."""
    joints = inference.joints
    sources = [source for of_joint in joints.values() for source in of_joint.values()]
    used = {name for source in sources for name in source.used} & inference.meanings.keys()
    _note_unknown_words(inference, used)
    for joint, of_joint in joints.items():
        for quantity, source in of_joint.items():
            column, kind = source.column, quantity.rpartition("_")[2]
            if kind == "position":
                _check_position(inference, source, joint, quantity)
            elif kind in ("torque", "current"):
                _check_effort(inference, column)
            _check_commands(inference, column, joint)
    _note_excluded(inference, used)
    _note_unknown_columns(inference, joints, {*used, *clocks})


def _note_unknown_words(inference: Inference, used: set[str]) -> None:
    """Note words of used columns that no table has, unless most names have them: a prefix."""
    count = Counter(word for m in inference.meanings.values() for word in set(m.unknown))
    # The prefix of a program or a robot is in most names and distinguishes none of them.
    rare = {word for word, times in count.items() if times < 0.5 * len(inference.meanings)}
    for name in sorted(used):
        words = [word for word in inference.meanings[name].unknown if word in rare]
        if words:
            inference.note(name, "unknown_words", words=listed(words))


def _check_position(inference: Inference, source: Source, joint: str, quantity: str) -> None:
    """Note a position that its velocities, the type or the limits of its joint contradict."""
    column, unit = source.column, source.unit or "rad"
    _check_velocities(inference, column, joint, UNIT_FACTORS["rad"].get(unit, 0.0))
    if quantity == "motor_position" or inference.limits(joint) is None:
        return
    slides, factor = inference.is_prismatic(joint), POSITION_FACTORS.get(unit)
    if source.unit not in (None, "counts") and (unit in UNIT_FACTORS["m"]) != slides:
        inference.note(column, "other_type", unit=unit, joint=joint)
    elif unit in ("deg", "mdeg") and not inference.is_far(column):
        inference.note(column, "hardly_moves", unit=unit)
    if factor is not None and not inference.is_within(column, factor, joint):
        inference.note(column, "beyond_limits", joint=joint)


def _check_velocities(inference: Inference, column: str, joint: str, factor: float) -> None:
    """Note the velocities that contradict a position; `factor` to rad is 0 if it is not known."""
    for name, share, scale in _velocities(inference, column, joint):
        rate = _RATES.get(inference.meanings[name].unit or "")
        if share < _UNRELATED:
            inference.note(f"{column}, {name}", "no_velocity")
        elif share > _FOLLOWS and scale < 0:
            inference.note(f"{column}, {name}", "opposite_signs")
        elif share > _FOLLOWS and rate and factor and abs(scale * factor / rate - 1) > 0.1:
            inference.note(column, "other_scale", times=scale * factor / rate, velocity=name)


def _check_effort(inference: Inference, column: str) -> None:
    """Note a current with one sign, and whole numbers without a unit."""
    values, meaning = inference.finite(column), inference.meanings[column]
    if np.min(values) * np.max(values) >= 0 and meaning.quantity == "current":
        inference.note(column, "one_sign")
    if meaning.unit is None and np.ptp(values) > _WHOLE and np.all(values == np.round(values)):
        inference.note(column, "raw_values")


def _check_commands(inference: Inference, column: str, joint: str) -> None:
    """Note a measurement that equals a command of its joint."""
    kind, values = inference.meanings[column].quantity, inference.data[column]
    names = chain(*(inference.having(kind, joint, role=role) for role in _NOT_MEASURED))
    for command in (x for x in names if x != column and len(inference.data[x]) == len(values)):
        apart = np.abs(inference.data[command] - values)
        good = np.isfinite(apart)
        if np.any(good) and np.max(apart[good]) <= _EQUAL * np.ptp(values[good]):
            inference.note(column, "copy", command=command)


_NOT_MEASURED: tuple[Role, ...] = ("command", "estimated", "derived")


def _note_excluded(inference: Inference, used: set[str]) -> None:
    """Note columns with the name of a measurement that are not used."""
    said = used.union(*inference.notes.values())
    forms = {(inference.meanings[name].quantity, *form) for name in used for form in _forms(name)}
    for name, meaning in inference.meanings.items():
        is_measured = meaning.quantity in ("position", "torque", "deflection", "current")
        if is_of_another_part(name):
            is_measured &= any((meaning.quantity, *form) in forms for form in _forms(name))
        else:
            is_measured &= meaning.role in ("measured", "estimated")
        if is_measured and name in inference.data and name not in said:
            inference.note(name, "unused", quantity=meaning.quantity)


def _forms(name: str) -> Iterator[tuple[str, str]]:
    """Yield what stands before and behind each word of a name but the last."""
    for word in re.finditer(r"[^\W_]+(?=[\W_])", name):
        yield name[: word.start()], name[word.end() :]


def _note_unknown_columns(
    inference: Inference, joints: Mapping[str, Sources], used: set[str]
) -> None:
    """Note columns of no known quantity that move like a joint, or may be what one lacks."""
    unknown = inference.logged("").keys() - used
    names = [x for x, y in inference.data.items() if x in unknown and not is_state(y)]
    signals, is_lacking = [*_signals(inference, joints)], not all(map(efforts_of, joints.values()))
    like = {x: _signal_like(inference.data[x], signals) for x in names[:1000]}
    for name in names:
        if like.get(name):
            inference.note(name, "moves_like", signal=like[name])
        elif is_lacking and _is_one_per_joint(name, names, len(joints)):
            inference.note(name, "maybe_lacking")


def _signal_like(values: Array, signals: list[tuple[str, Array]]) -> str:
    """Return the name of the signal to which a channel is proportional, an empty text if none."""
    return next((x for x, signal in signals if abs(correlation(signal, values)) > _ALIKE), "")


def efforts_of(sources: Sources) -> list[Source]:
    """Return the sources of what drives a joint: torques, currents and voltages."""
    kinds = ("torque", "current", "voltage")
    return [source for name, source in sources.items() if name.endswith(kinds)]


def _is_one_per_joint(name: str, names: list[str], count: int) -> bool:
    """Return whether as many names as joints differ in their numbers only."""
    family = re.sub(r"\d+", "#", name)
    return count == 1 or sum(re.sub(r"\d+", "#", column) == family for column in names) == count


def _signals(inference: Inference, joints: Mapping[str, Sources]) -> Iterator[tuple[str, Array]]:
    """Yield the motion of each joint and its derivatives by time, with their names."""
    for joint, sources in joints.items():
        for quantity in ("joint_position", "motor_position"):
            if quantity in sources:
                values, time = inference.data[sources[quantity].column], inference.time
                if time is None or len(time) != len(values) or np.any(np.diff(time) <= 0):
                    time = np.arange(len(values), dtype=float)
                if len(values) < _FEWEST:
                    return
                yield f"the position of {joint}", values
                yield f"the velocity of {joint}", np.gradient(values, time)
                break
