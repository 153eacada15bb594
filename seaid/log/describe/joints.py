"""Which columns are those of which joint: labels of names to joints, and columns to quantities.

`joint_names` matches the labels in the names of columns with the joints of a robot, and
`quantities_of` selects the columns of one joint by their meanings and samples. What is selected
without being said is noted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.drives import total_ratio
from seaid.errors import listed
from seaid.log.channels import OF_JOINTS, UNIT_FACTORS
from seaid.log.describe.inference import (
    POSITION_FACTORS,
    SCALE_SPREAD,
    Inference,
    correlation,
    efforts_of,
    follows,
    unit_by_velocity,
)
from seaid.log.describe.names import Meaning, Role, joint_alone, nearest, vocabulary, words_of
from seaid.log.description import Source
from seaid.robot import Robot

MEASURED = ("position", "torque", "deflection", "current", "voltage", "duty")
"""Quantities of the sensors of a joint that are read."""

_SAME = 0.99
"""Correlation above which one channel counts as computed from another."""

_STIFF = 0.999
"""Squared correlation above which the slope of two positions is a gear ratio."""

_FAR = 0.5
"""Range of a deflection without a unit above which it may be in degrees or mm."""

_KELVIN = 200.0
"""A temperature above this is in kelvin: no motor of a robot is as hot, or as cold."""

_MOTOR_SIDE = ("motor_position", "motor_torque", "motor_current", "motor_voltage")

_COMMANDS = ("position", "velocity", "torque")
"""Quantities of commands."""


def every_joint(robot: Robot | None) -> tuple[str, ...]:
    """Return the joints of a robot's file, those that stand still too."""
    return () if robot is None else robot.joints_of_file or robot.joint_names


def is_sensor(meaning: Meaning) -> bool:
    """Return whether a name is that of a raw measurement."""
    return meaning.is_raw and meaning.quantity in MEASURED


def take_bare_names(inference: Inference) -> None:
    """Take columns with nothing but the name of a joint for its position, if it has no other."""
    meanings, joints = inference.meanings, every_joint(inference.robot)
    located = {m.joint for m in meanings.values() if m.quantity == "position" and m.is_raw}
    for name, meaning in meanings.items():
        joint = joint_alone(name, joints)
        if joint and joint not in located and not meaning.quantity:
            inference.take(name, "bare_name", quantity="position", joint=joint)


def joint_names(inference: Inference) -> dict[str, str]:
    """Return {label of columns: joint} of the positions that move, and label all columns by joint.

    The labels are those of joints by exact name, by number, or by order; without a robot they are
    the names. A log with more labels than joints that move has those of the robot's file. The
    columns of joints that stand still are dropped.
    """
    _take_estimates(inference)
    labels = _assign_motor(inference, _labels(inference) or _measured_next_to_commands(inference))
    if inference.robot is None:
        names = {x: f"joint_{x}" if _is_number(x) else x or "joint" for x in labels}
    else:
        names = _names_of_robot(inference, inference.robot, labels)
    _label_by_joint(inference, names)
    return names


def _names_of_robot(inference: Inference, robot: Robot, labels: list[str]) -> dict[str, str]:
    """Return {label: joint} of the joints that move, and drop the columns of those that do not."""
    every = _labels_with_still_ones(inference, labels, len(every_joint(robot)))
    matches = _matches(every, robot, inference)
    for label in filter(labels.__contains__, every):
        if label not in matches:
            inference.note(label, "no_such_joint")
    names = {x: joint for x, joint in matches.items() if joint in robot.joint_names}
    still, meanings = matches.keys() - names.keys(), inference.meanings
    inference.data = {x: y for x, y in inference.data.items() if meanings[x].joint not in still}
    return {x: joint for x, joint in names.items() if x in labels}


def _take_estimates(inference: Inference) -> None:
    """Take positions that a drive calls estimated for measured, if there are no others."""
    positions = inference.logged("position")
    if any(meaning.is_raw for meaning in positions.values()):
        return
    for name, meaning in positions.items():
        if meaning.role == "estimated":
            inference.take(name, "only_estimated", role="measured")


def _labels(inference: Inference) -> list[str]:
    """Return the labels of joints whose positions move: numbers sorted, others in file order."""
    positions = inference.logged("position").values()
    labels = dict.fromkeys(meaning.joint for meaning in positions if meaning.is_raw)
    return sorted(labels, key=int) if all(map(_is_number, labels)) else list(labels)


_LED = {"": "", "position": "current"}
"""{quantity of a command: that in the name of what may follow it}: "current_q" is a current, or the
present q."""


def _measured_next_to_commands(inference: Inference) -> list[str]:
    """Return the labels of "actual_1" next to "target_1", which are taken for positions."""
    for of_command, of_measured in _LED.items():
        logged = inference.logged(of_command).items()
        commands = {meaning.joint: name for name, meaning in logged if meaning.role == "command"}
        for name, meaning in inference.logged(of_measured).items():
            leads = commands.get(meaning.joint, "") if meaning.is_raw else ""
            is_free = meaning.is_said or of_measured != ""
            if leads and is_free and follows(inference.data[name], inference.data[leads]):
                inference.take(name, "measured", quantity="position")
    return _labels(inference)


def _is_number(label: str) -> bool:
    return label.isascii() and label.isdecimal()


def _assign_motor(inference: Inference, labels: list[str]) -> list[str]:
    """Return the labels of joints; a motor without a label is that of the only one with a label."""
    sensors = {x: m for x, m in inference.meanings.items() if is_sensor(m) and not m.joint}
    # Exactly one label, and no position of a joint without one: "mpos" or "motor_current" next to
    # "elbow_pos".
    label, *others = [*filter(None, labels), ""]
    if others != [""] or any(map(_is_at_joint, sensors.values())):
        return labels
    for name, meaning in sensors.items():
        # A voltage next to a motor that has no other column is as likely that of the supply.
        if "" in labels or meaning.quantity != "voltage":
            inference.take(name, "only_motor", joint=label)
    return [label]


def _is_at_joint(meaning: Meaning) -> bool:
    """Return whether a name is that of a position which may be the joint's."""
    return meaning.quantity == "position" and meaning.side != "motor"


def _labels_with_still_ones(inference: Inference, labels: list[str], count: int) -> list[str]:
    """Return the labels of all positions, of constant ones too, if they are as many as joints."""
    logged = dict.fromkeys(
        meaning.joint
        for name, meaning in inference.meanings.items()
        if meaning.quantity == "position" and f"{name}[0]" not in inference.meanings
    )
    return list(logged) if len(logged) == count and {*labels} <= logged.keys() else labels


def _label_by_joint(inference: Inference, names: Mapping[str, str]) -> None:
    """Replace the labels of columns by the names of joints.

    A column with a number and unknown words is one of the joint with this number, if that has none
    of its quantity.
    """
    meanings = inference.meanings
    labelled = {
        (m.quantity, names[m.joint]) for m in meanings.values() if m.joint in names and m.is_raw
    }
    numbers = _by_own_number(names)
    for name, meaning in meanings.items():
        is_signal = meaning.role in ("measured", "estimated") and meaning.quantity in MEASURED
        number = _number_in(meaning.joint) if is_signal else ""
        if meaning.joint in names:
            inference.take(name, joint=names[meaning.joint])
        elif number in numbers and (meaning.quantity, numbers[number]) not in labelled:
            inference.take(name, "by_number", joint=numbers[number])


def _by_own_number(names: Mapping[str, str]) -> dict[str, str]:
    """Return {number: joint} of {label: joint}, nothing if labels have the same number."""
    numbers = {_number_in(label): joint for label, joint in names.items()}
    return {x: joint for x, joint in numbers.items() if x and len(numbers) == len(names)}


def _matches(labels: Sequence[str], robot: Robot, inference: Inference) -> dict[str, str]:
    """Return {label: joint}: by name and by number, or, if none has these, by part or by order."""
    every = every_joint(robot)
    matches = {x: x for x in labels if x in every}
    rest = [x for x in labels if x not in matches]
    joints = robot.joint_names if len(rest) <= robot.n else every
    matches |= _by_number(rest, [joint for joint in joints if joint not in matches])
    # By order only if no name matches, since a mixture of both could exchange joints.
    return matches or _by_part(labels, joints, inference) or _in_order(labels, joints, inference)


def _by_part(labels: Sequence[str], joints: Sequence[str], inference: Inference) -> dict[str, str]:
    """Return {label: joint} if the words of each label are in the name of one joint alone."""
    fitting = {label: nearest(label, joints) for label in labels}
    matches = {x: joint for x, (joint, count) in fitting.items() if count == len({*words_of(x)})}
    if len({*matches.values()} - {""}) < len(labels):
        return {}
    for label in filter(None, labels):
        inference.note(label, "by_part", joint=matches[label])
    return matches


def _by_number(labels: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """Return {label: joint} if the labels with numbers, such as j1, have those of the joints."""
    numbers = {number: joint for joint in joints if (number := _number_in(joint))}
    wanted = {x: number for x in labels if (number := _number_in(x))}
    if len(numbers) < len(joints) or not {*wanted.values()} <= numbers.keys():
        return {}
    return {x: numbers[number] for x, number in wanted.items()}


def _number_in(name: str) -> str:
    """Return the number at the end of a joint's name, an empty text if there is another one."""
    match = re.fullmatch(r"\D*?0*(\d+)(?:_joint)?", name, re.ASCII)
    return match[1] if match else ""


def _sorted(labels: list[str]) -> list[str]:
    """Return labels that differ in a number, as axis_2 and axis_10, in the order of the numbers."""
    stems = {label.rstrip("0123456789") for label in labels}
    is_counted = len(stems) == 1 and all(map(_number_in, labels))
    return sorted(labels, key=lambda label: int(_number_in(label))) if is_counted else labels


def _in_order(labels: Sequence[str], joints: Sequence[str], inference: Inference) -> dict[str, str]:
    """Return {label: joint} in the order of the robot: of the labels that are numbers, if any."""
    labels = _sorted(list(filter(_is_number, labels)) or list(labels))
    if len(labels) > len(joints):
        inference.note(", ".join(labels), "more_joints", logged=len(labels), known=len(joints))
    if labels != [""] or len(joints) > 1:
        names = (x or "columns without a joint" for x in labels[: len(joints)])
        inference.note(", ".join(names), "in_order")
    if not all(map(_number_in, labels)) and not len(labels) == len(joints) == 1:
        _note_guesses(labels, inference)
    return dict(zip(labels, joints, strict=False))


def _note_guesses(labels: Sequence[str], inference: Inference) -> None:
    """Note the sensors of joints whose labels say nothing of their order."""
    for name, meaning in inference.meanings.items():
        if meaning.joint in labels and is_sensor(meaning):
            inference.note(name, "guessed_joint")


def take_sides(inference: Inference, joints: Sequence[str]) -> None:
    """Take of two positions of a joint that which moves much farther for the motor's.

    It may be an estimate of the drive, next to an encoder of the joint. So are positions of other
    joints that have such a name.
    """
    for joint in joints:
        measured = inference.having("position", joint)
        names = [*measured, *inference.having("position", joint, role="estimated")]
        if not measured or any(inference.meanings[x].side == "motor" for x in names):
            continue
        ranges = _ranges(inference, names)
        small, large = min(names, key=ranges.__getitem__), max(names, key=ranges.__getitem__)
        # Gears of robots reduce, so that the motor moves farther than the joint.
        is_far = len(names) == 2 and ranges[large] > 5 * ranges[small]
        if is_far and not inference.meanings[large].side:
            inference.take(small, role="measured")
            _take_for_motor(inference, large, "moves_farther", small)
            for name in inference.alike(large):
                if not inference.meanings[name].side:
                    _take_for_motor(inference, name, "like_motor", large)


def _take_for_motor(inference: Inference, name: str, doubt: str, column: str) -> None:
    """Take a position for that of the motor, because of another column."""
    inference.take(name, role="measured", side="motor")
    inference.note(name, doubt, column=column)


def _ranges(inference: Inference, names: Sequence[str]) -> dict[str, float]:
    """Return the ranges of positions: in rad if the units of all are known, else as they are."""
    factors = [POSITION_FACTORS.get(inference.meanings[name].unit or "") for name in names]
    known = [1.0 if None in factors or x is None else x for x in factors]
    pairs = zip(names, known, strict=True)
    return {name: factor * float(np.ptp(inference.finite(name))) for name, factor in pairs}


def take_positions(inference: Inference, joints: Sequence[str]) -> None:
    """Take the positions of joints and their motors, with the counts of their encoders."""
    take_sides(inference, joints)
    columns = [_Columns(inference, joint) for joint in joints]
    for of_joint in columns:
        of_joint.add_positions()
    by_ratio = {x: counts for of_joint in columns for x, counts in of_joint.counts_by_ratio()}
    for of_joint in columns:
        of_joint.settle_counts(by_ratio)


def _slope(motor: Array, load: Array) -> float:
    """Return the slope of the motor's position over the joint's, by least squares."""
    good = np.isfinite(motor) & np.isfinite(load)
    return float(np.cov(motor[good], load[good])[0, 1] / np.var(load[good], ddof=1))


def take_quantities(inference: Inference, joint: str) -> None:
    """Take the other columns of a joint, whose positions are taken, for its quantities."""
    columns = _Columns(inference, joint)
    has_both = len(columns.sources) == 2
    columns.add_deflection()
    columns.add_torques()
    columns.add_electric()
    if has_both:
        columns.turn_motor_side()
    columns.add_commands()
    columns.add_temperature()


_USUAL_UNITS = {
    name: next(iter(UNIT_FACTORS[row.unit]))
    for name, row in OF_JOINTS.items()
    if row.kind not in ("position", "deflection")
}
"""{quantity: the unit of its columns that a description need not state}."""


_PLAIN = Source()
"""A source in SI units, of no column yet."""


@dataclass(frozen=True)
class _Columns:
    """The columns of one joint, and the sources that were selected of them."""

    inference: Inference
    joint: str

    @property
    def sources(self) -> dict[str, Source]:
        """The sources of the joint."""
        return self.inference.tables["joints", self.joint]

    def having(self, quantity: str, *sides: str, role: Role = "measured") -> list[str]:
        """Return the columns of a quantity of the joint, by default the measured ones."""
        return self.inference.having(quantity, self.joint, *sides, role=role)

    def meaning(self, column: str) -> Meaning:
        """Return the meaning of a column."""
        return self.inference.meanings[column]

    def note(self, about: str, doubt: str, /, *, is_usual: bool = False, **values: Any) -> None:
        """Note what is in doubt about a column."""
        self.inference.note(about, doubt, is_usual=is_usual, **values)

    def take(
        self, quantity: str, column: str, doubt: str = "", /, like: Source = _PLAIN, **more: Any
    ) -> None:
        """Take a column, in the unit of its name, for a quantity; note what is in doubt."""
        unit = self.meaning(column).unit
        if unit in UNIT_FACTORS["1"]:
            more["scale"] = more.get("scale", 1.0) * UNIT_FACTORS["1"][unit]
        elif unit not in (None, _USUAL_UNITS.get(quantity)):
            more["unit"] = unit
        self.sources[quantity] = replace(like, columns=(column,), **more)
        self.note(column, doubt)

    def first(self, what: str, columns: Sequence[str]) -> list[str]:
        """Return the first of several columns, if any; note the others."""
        if len(columns) > 1:
            self.note(columns[0], "several", what=what, columns=", ".join(columns))
        return [*columns[:1]]

    def add_positions(self) -> None:
        """Add the positions of motor and joint, with their units."""
        motor, load = self.having("position", "motor"), self.having("position", "joint", "")
        for quantity, columns in (("motor_position", motor), ("joint_position", load)):
            for column in self.first("positions", columns):
                self.take(quantity, column, **self._position_unit(column, quantity))
        if [source.unit for source in self.sources.values()] == [None, "deg"]:
            self.sources["motor_position"] = replace(self.sources["motor_position"], unit="deg")
            self.note(motor[0], "also_degrees")
        if [*self.sources] == ["joint_position"] and not self.meaning(load[0]).side:
            self._note_side(self.sources["joint_position"])

    def _note_side(self, source: Source) -> None:
        """Note the side of an only position: usual is that of the joint, within its limits."""
        factor = POSITION_FACTORS.get(source.unit or "rad", np.nan)
        fits = self.inference.is_within(source.column, factor, self.joint)
        self.note(source.column, "joint_side", is_usual=fits and not self.inference.is_of_a_drive)

    def _position_unit(self, column: str, quantity: str) -> dict[str, Any]:
        """Return the arguments for the unit of a position, none for rad."""
        values, unit = self.inference.finite(column), self.meaning(column).unit
        is_whole = np.ptp(values) > 100 and np.all(values == np.round(values))
        if unit == "counts" or (unit is None and is_whole):
            return self._counts(column, quantity)
        if unit is not None:
            return {}
        if unit := unit_by_velocity(self.inference, column, self.joint):
            self.note(column, "by_velocity", is_usual=True, unit=unit)
        elif quantity == "joint_position":
            unit = self._unit_by_range(column)
        return {} if unit in (None, "rad") else {"unit": unit}

    def _counts(self, column: str, quantity: str) -> dict[str, Any]:
        """Return the unit of an encoder with the guessed size of its counts, and its zero.

        Encoders have 2^k counts per turn: the least power above all counts, if they reach a whole
        turn, of all encoders with such a name.
        """
        names = [column, *self.inference.alike(column)]
        power = 2.0 ** math.ceil(math.log2(max(2.0, *map(self.inference.least_counts, names))))
        is_of_joint, slides = quantity == "joint_position", self.inference.is_prismatic(self.joint)
        per = "m" if is_of_joint and slides else "turn"
        counts: dict[str, Any] = {"unit": "counts", f"counts_per_{per}": power}
        is_within = partial(self.inference.is_within, column, 2 * np.pi / power, self.joint)
        # A servo in the middle of its range reads half a turn, which is the zero of its joint.
        if is_of_joint and not slides and not is_within() and is_within(-np.pi):
            self.note(column, "half_a_turn", middle=power / 2)
            counts["offset"] = -np.pi
        return counts

    def counts_by_ratio(self) -> Iterator[tuple[str, tuple[float, str]]]:
        """Yield the motor's column with its counts by those of the joint, and the latter's column.

        The slope of the counts of the motor over those of the joint is N c_M / c_L. A motor turns
        several times, so that the size of its counts says nothing of c_M.
        """
        motor, load = (self.sources.get(x, _PLAIN) for x in ("motor_position", "joint_position"))
        robot = self.inference.robot
        if robot is None or motor.counts_per_turn is None or load.counts_per_turn is None:
            return
        slope = _slope(*(self.inference.data[x.column] for x in (motor, load)))
        counts = load.counts_per_turn * abs(slope / total_ratio(robot.drives[self.joint]))
        power = 2.0 ** round(math.log2(max(counts, 2.0)))
        if abs(counts / power - 1) < SCALE_SPREAD:
            yield motor.column, (power, load.column)

    def settle_counts(self, by_ratio: Mapping[str, tuple[float, str]]) -> None:
        """Set the counts of the motor {column: counts, column of the joint}, or those of its like.

        What is a guess is noted.
        """
        for quantity, source in [*self.sources.items()]:
            like = [
                x for x in (source.column, *self.inference.alike(source.column)) if x in by_ratio
            ]
            if source.unit != "counts":
                continue
            if like and quantity == "motor_position":
                power, column = by_ratio[like[0]]
                self.sources[quantity] = replace(source, counts_per_turn=power)
                self.note(source.column, "counts_by_ratio", power=power, column=column)
            else:
                per = "m" if source.counts_per_turn is None else "turn"
                counts = source.counts_per_turn or source.counts_per_m
                self.note(source.column, "counts", power=counts, per=per)

    def _unit_by_range(self, column: str) -> str | None:
        """Return the unit of an angle by how far it moves, None for a prismatic joint."""
        inference, moves = self.inference, float(np.ptp(self.inference.finite(column)))
        if inference.is_prismatic(self.joint):
            return None
        lower, upper = inference.limits(self.joint) or (-np.inf, np.inf)
        # In degrees the same motion is 57 times as large a number, beyond any range in rad.
        unit = "deg" if moves > min(2 * (upper - lower), 4 * np.pi) else "rad"
        fits = inference.is_within(column, UNIT_FACTORS["rad"][unit], self.joint)
        if fits and inference.is_far(column) and not inference.is_of_a_drive:
            self.note(column, "unit", is_usual=True, unit=unit)
        elif unit == "deg":
            self.note(f"{column} (moves by {moves:.4g})", "degrees")
        else:
            doubt = "turns" if inference.is_of_a_drive else "radians"
            self.note(f"{column} (moves by {moves:.3g})", doubt)
        return unit

    def add_deflection(self) -> None:
        """Add the deflection of the spring, if only one side has an encoder.

        By (4a) the torque of the spring grows with its deflection, motor side less joint side.
        """
        for name in self.having("deflection")[:1] if self.sources else ():
            if len(self.sources) == 2:
                self.note(name, "redundant")
                continue
            data, drives = self.inference.data, self.having("torque") or self.having("current")
            pulls = sum(correlation(data[drive], data[name]) for drive in drives[:1])
            if self.meaning(name).unit is None and np.ptp(self.inference.finite(name)) > _FAR:
                self.note(name, "far_deflection")
            self.take("deflection", name, sign=-1 if pulls < 0 else 1)
            doubt = "deflection_by" if pulls else "deflection_sign"
            self.note(name, doubt, drive=listed(drives[:1]))

    def add_torques(self) -> None:
        """Add the torque of each side; estimates, or else commands, of a drive if that is all."""
        names = self.having("torque")
        others: dict[Role, str] = {"estimated": "only_estimate"}
        if not any(map(self._commands, ("position", "velocity"))):
            others["command"] = "only_command"
        for role, doubt in others.items():
            if not names and not self.having("current"):
                names = self.having("torque", role=role)
                for name in names:
                    self.note(name, doubt)
        for name in names:
            if self.meaning(name).unit in UNIT_FACTORS["A"]:
                self.note(name, "in_amperes")
                continue
            if self._is_share(name):
                continue
            side, where = self._side_of_torque(name)
            if f"{side}_torque" in self.sources:
                self.note(name, "second", quantity=f"{side}_torque")
            else:
                self.take(f"{side}_torque", name, side=where)

    def _is_share(self, name: str) -> bool:
        """Return whether a column is a share of a rated value."""
        return self.meaning(name).unit in UNIT_FACTORS["1"]

    def _side_of_torque(self, name: str) -> tuple[str, str | None]:
        """Return the side at which a torque acts, and where it is measured; note what is unsure."""
        data, twists = self.inference.data, self.having("deflection")
        if twists and abs(correlation(data[name], data[twists[0]])) > _SAME:
            self.note(name, "of_deflection", deflection=twists[0])
            return "joint", None
        if side := self.meaning(name).side:
            return side, None
        is_at_motor = "motor_position" in self.sources
        self.note(name, "at_motor" if is_at_motor else "at_joint")
        return "motor", None if is_at_motor else "joint"

    def add_electric(self) -> None:
        """Add the current and the voltage of the motor, the latter of a duty cycle too."""
        currents = self._currents()
        for name in currents[:1]:
            self.take("motor_current", name, "winding" if len(currents) > 1 else "")
            if self._is_share(name):
                self.note(name, "of_rated", quantity=self.meaning(name).quantity)
        duty = next(iter(self.having("duty")), "")
        for name in self.having("voltage"):
            if "motor_voltage" not in self.sources:
                self._add_voltage(name, duty)
        # Pulses of one sign are the commands of a servo, or a magnitude.
        if duty and not (efforts_of(self.sources) or self.inference.has_one_sign(duty)):
            self._take_duty(duty, self.inference.supply)

    def _currents(self) -> list[str]:
        """Return the currents of the motor, or torques as a share of the rated one if that is all.

        A w stands for the winding, as in HEBI's "motor_winding_current": that gives the torque.
        """
        currents = sorted(self.having("current"), key=lambda name: "w" not in name.lower())
        if currents or efforts_of(self.sources):
            return currents
        return [name for name in self.having("torque") if self._is_share(name)]

    def _add_voltage(self, name: str, duty: str) -> None:
        """Add a voltage with two signs, or a duty cycle times that of a supply."""
        is_of_motor = self.meaning(name).side == "motor"
        if not self.inference.has_one_sign(name):
            self.take("motor_voltage", name, "" if is_of_motor else "voltage_or_command")
        elif duty:
            self._take_duty(duty, name)
        else:
            self.note(name, "supply", is_usual=not is_of_motor)

    def _take_duty(self, duty: str, supply: str) -> None:
        """Take a duty cycle times the voltage of a supply, if that is logged, for the motor's."""
        more: dict[str, Any] = {}
        if supply:
            more = {"times": supply, "scale": UNIT_FACTORS["V"][self.meaning(supply).unit or "V"]}
        self.take("motor_voltage", duty, **more)
        self.note(f"{duty} times {supply}" if supply else duty, "voltage" if supply else "duty")

    def turn_motor_side(self) -> None:
        """Note a ratio of positions (plus deflection) in proportion that is not that of the drive.

        Where it is negative, the motor's side of the gear gets the opposite sign.
        """
        motor, load = (self._in_si(self.sources[x]) for x in ("motor_position", "joint_position"))
        # theta_M / N = q + d with the deflection d, whose sign is not known yet: without it the
        # positions of a soft spring are not proportional.
        sides = [load]
        for name in self.having("deflection"):
            twist = self._in_si(Source((name,), unit=self.meaning(name).unit))
            sides += [load + twist, load - twist]
        best = max(sides, key=lambda side: correlation(motor, side) ** 2)
        if not correlation(motor, best) ** 2 > _STIFF:
            return
        # The slope is N, and is negative for encoders that count against each other.
        ratio = _slope(motor, best)
        robot = self.inference.robot
        known = 1.0 if robot is None else total_ratio(robot.drives[self.joint])
        if abs(abs(ratio / known) - 1) > SCALE_SPREAD:
            self.note(self.joint, "gear_ratio", ratio=ratio)
        if ratio < 0:
            self._turn()

    def _turn(self) -> None:
        """Negate what is on the motor's side of the gear."""
        # Position and effort of the motor turn together, so that their power keeps its sign; a
        # torque that was converted to the joint has the joint's sign already.
        sides = {x: y for x, y in self.sources.items() if x in _MOTOR_SIDE and y.side != "joint"}
        self.sources.update({x: replace(source, sign=-source.sign) for x, source in sides.items()})
        self.note(listed(source.column for source in sides.values()), "turns_against")

    def _in_si(self, source: Source) -> Array:
        """Return the samples of a position in rad or m, NaN for an unknown unit."""
        factor = POSITION_FACTORS.get(source.unit or "rad", np.nan)
        if source.counts_per_turn is not None:
            factor = 2 * np.pi / source.counts_per_turn
        return np.asarray(factor * self.inference.data[source.column])

    def add_commands(self) -> None:
        """Add the commands of a joint without a torque that has both signs."""
        names = {kind: self._commands(kind) for kind in _COMMANDS}
        if "motor_position" in self.sources or self._is_driven(may_be=not names["position"]):
            return
        leading = next((kind for kind in ("position", "velocity") if names[kind]), "")
        if leading and self.sources:
            self._add_commands(names, leading)
            return
        unknown = self.having("", role="command")
        doubt = "unknown_command" if unknown else "no_effort"
        self.note(self.joint, doubt, columns=listed(unknown))

    def _commands(self, kind: str) -> list[str]:
        """Return the commands of a quantity; those of many drives but positions are all zero."""
        names = self.inference.commands(self.joint, kind)
        return [x for x in names if kind == "position" or np.any(self.inference.finite(x))]

    def _is_driven(self, *, may_be: bool) -> bool:
        """Return whether an effort of the joint has both signs, or whether there may be one."""
        efforts = [self.inference.finite(source.column) for source in efforts_of(self.sources)]
        # Efforts that are never negative are magnitudes or limits: no joint is driven one way only.
        return any(np.any(values < 0) for values in efforts) or (may_be and bool(efforts))

    def _add_commands(self, names: Mapping[str, list[str]], leading: str) -> None:
        """Add the first command of each quantity, the position in the unit of the measured one."""
        for kind, columns in names.items():
            for column in self.first("commands", columns):
                like = self.sources["joint_position"] if kind == "position" else _PLAIN
                self.take(f"{kind}_command", column, like=like)
        self.note(names[leading][0], "command", kind=leading)
        computed = self.having("torque", role="derived")
        for name in names["torque"][:1] or computed:
            self.note(name, "computed_torque" if name in computed else "feedforward")

    def add_temperature(self) -> None:
        """Add the temperature of the motor: one that says so, else the first of the joint."""
        electronics = "|".join(vocabulary().roles["electronics"])
        names = [x for x in self.having("temperature") if not re.search(electronics, x.lower())]
        for name in sorted(names, key=lambda x: self.meaning(x).side != "motor")[:1]:
            is_hot = bool(np.median(self.inference.finite(name)) > _KELVIN)
            if self.meaning(name).unit is None and is_hot:
                self.take("motor_temperature", name, "kelvin", unit="K")
            else:
                self.take("motor_temperature", name)
            if self.meaning(name).side != "motor":
                self.note(name, "temperature", is_usual=len(names) == 1)
