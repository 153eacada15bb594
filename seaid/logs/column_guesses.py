"""Guesses of what the columns of one joint are, from names and values, with the doubts noted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.errors import in_one_line, listed
from seaid.formats.table import Block
from seaid.logs.column_words import Meaning
from seaid.robot import Robot

_SAME = 0.99
"""Correlation from which one channel is computed from another."""

_STIFF = 0.999
"""Squared correlation from which the slope of two positions is a gear ratio."""

_LISTED = 100
"""Columns named in a doubt."""

Sources = dict[str, dict[str, Any]]
"""Arguments of the Source of each quantity of a joint."""


@dataclass(eq=False)
class Look:
    """The columns looked at: samples, what their names say, and the doubts so far."""

    data: Block
    meanings: dict[str, Meaning]
    doubts: dict[str, list[str]] = field(default_factory=dict)

    def having(self, quantity: str, joint: str) -> list[str]:
        """Return the columns with a quantity of a joint, without commanded and derived ones."""
        return [name for name in self._raw.get((quantity, joint), ()) if name in self.data]

    @cached_property
    def _raw(self) -> dict[tuple[str, str], list[str]]:
        """The columns by quantity and joint."""
        found: dict[tuple[str, str], list[str]] = {}
        for name, meaning in self.meanings.items():
            if meaning.is_raw:
                found.setdefault((meaning.quantity, meaning.joint), []).append(name)
        return found

    def doubt(self, about: str, text: str) -> None:
        """Note a doubt; those with the same text become one sentence."""
        self.doubts.setdefault(text, []).append(about)

    def unsure(self) -> tuple[str, ...]:
        """Return the doubts as sentences."""
        sentences = (f"{listed(about, _LISTED)}: {text}" for text, about in self.doubts.items())
        return tuple(map(in_one_line, sentences))


def quantities_of(look: Look, tag: str, joint: str, robot: Robot | None) -> Sources:
    """Return {quantity: arguments of its Source} of the joint with this label."""
    found = _positions(look, tag, joint)
    for quantity, source in reversed(found.items()):
        source |= _position_unit(look, str(source["column"]), quantity, joint, robot)
    units = [source.get("unit") for source in found.values()]
    if units == [None, "deg"]:
        found["motor_position"]["unit"] = "deg"
        look.doubt(str(found["motor_position"]["column"]), "taken for degrees, as the joint's")
    _add_deflection(look, tag, found)
    _add_torques(look, tag, found)
    _add_electric(look, tag, found)
    if not any(name.startswith("motor_") or name.endswith("torque") for name in found):
        look.doubt(joint, "no torque, current or voltage found")
    return found


def _positions(look: Look, tag: str, joint: str) -> Sources:
    names = look.having("position", tag)
    sides = {name: look.meanings[name].side for name in names}
    motor = [name for name in names if sides[name] == "motor"]
    load = [name for name in names if sides[name] != "motor"]
    if not motor and len(load) == 2:
        ranges = {
            name: float(np.nanmax(look.data[name]) - np.nanmin(look.data[name])) for name in load
        }
        large, small = sorted(load, key=lambda name: -ranges[name])
        if ranges[large] > 5 * ranges[small] and sides[large] == "":
            motor, load = [large], [small]
            look.doubt(large, f"moves much farther than {small}: taken for the motor side")
    if not motor and load and sides[load[0]] == "":
        look.doubt(load[0], "taken for the joint side of the gear: or is it the motor's?")
    for group in (motor, load):
        if len(group) > 1:
            look.doubt(group[0], f"taken of the positions {', '.join(group)}")
    found: Sources = {}
    if motor:
        found["motor_position"] = {"column": motor[0]}
    if load:
        found["joint_position"] = {"column": load[0]}
    if motor and load:
        _note_ratio(look, tag, joint, look.data[motor[0]], look.data[load[0]])
    return found


def _note_ratio(look: Look, tag: str, joint: str, motor: Array, load: Array) -> None:
    """Note the gear ratio, where motor and joint (with the deflection between) go together."""
    twists = [look.data[name] for name in look.having("deflection", tag)]
    sides = [load] + [load + sign * twist for twist in twists for sign in (1.0, -1.0)]
    best = max(sides, key=lambda side: _correlation(motor, side) ** 2)
    if _correlation(motor, best) ** 2 > _STIFF:
        good = np.isfinite(motor) & np.isfinite(best)
        ratio = np.cov(motor[good], best[good])[0, 1] / np.var(best[good], ddof=1)
        look.doubt(joint, f"the motor turns {ratio:.5g} times as far: is that the gear ratio?")


def _position_unit(
    look: Look, column: str, quantity: str, joint: str, robot: Robot | None
) -> dict[str, Any]:
    values = look.data[column][np.isfinite(look.data[column])]
    unit, moves = look.meanings[column].unit, float(np.ptp(values))
    if unit == "counts" or (unit is None and moves > 100 and np.all(values == np.round(values))):
        power = 2 ** math.ceil(math.log2(max(float(np.max(np.abs(values))), 2.0)))
        look.doubt(column, f"in counts: {power} a turn is a guess")
        return {"unit": "counts", "counts_per_turn": float(power)}
    if unit is not None:
        return {"unit": unit}
    if quantity != "joint_position":
        return {}
    reach = 4 * np.pi
    if robot is not None and joint in robot.joint_names:
        index = robot.index(joint)
        if robot.is_prismatic[index]:
            return {}
        reach = min(2 * float(robot.upper_limits[index] - robot.lower_limits[index]), reach)
    if moves > reach:
        look.doubt(f"{column} (moves by {moves:.4g})", "taken for degrees")
        return {"unit": "deg"}
    look.doubt(f"{column} (moves by {moves:.3g})", "taken for rad")
    return {}


def _add_deflection(look: Look, tag: str, found: Sources) -> None:
    names = look.having("deflection", tag)
    if not names:
        return
    if len(found) == 2:
        look.doubt(names[0], "not needed beside both positions")
    elif found:
        torques = look.having("torque", tag)
        pulls = _correlation(look.data[torques[0]], look.data[names[0]]) if torques else 0.0
        found["deflection"] = {"column": names[0], "sign": -1 if pulls < 0 else 1}
        seen = f", taken from {torques[0]}" if pulls else ""
        look.doubt(names[0], f"its sign (+ where the motor side is ahead of the joint's){seen}")


def _add_torques(look: Look, tag: str, found: Sources) -> None:
    twists = look.having("deflection", tag)
    for name in look.having("torque", tag):
        meaning = look.meanings[name]
        side: str = meaning.side
        arguments: dict[str, Any] = {"column": name}
        if meaning.unit in ("A", "mA"):
            continue
        if twists and abs(_correlation(look.data[name], look.data[twists[0]])) > _SAME:
            side = "joint"
            look.doubt(name, f"follows {twists[0]}: it is computed from it, or the other way round")
        elif not side and "motor_position" in found:
            side = "motor"
            look.doubt(name, "taken for the motor's torque, at the motor")
        elif not side:
            side, arguments["side"] = "motor", "joint"
            look.doubt(
                name,
                "taken for the motor's torque as seen at the joint, friction in it: name it "
                "joint_torque if a sensor behind the gear measures it",
            )
        if meaning.unit in ("mNm", "N"):
            arguments["unit"] = meaning.unit
        if f"{side}_torque" in found:
            look.doubt(name, f"a second {side}_torque: left out")
            continue
        found[f"{side}_torque"] = arguments


def _correlation(one: Array, other: Array) -> float:
    """Return the correlation of two channels, 0 where they cannot be compared."""
    if len(one) != len(other):
        return 0.0
    good = np.isfinite(one) & np.isfinite(other)
    if np.sum(good) < 3 or np.ptp(one[good]) == 0 or np.ptp(other[good]) == 0:
        return 0.0
    return float(np.corrcoef(one[good], other[good])[0, 1])


def _add_electric(look: Look, tag: str, found: Sources) -> None:
    currents = sorted(look.having("current", tag), key=lambda name: "w" not in name.lower())
    if currents:
        unit = look.meanings[currents[0]].unit
        found["motor_current"] = {"column": currents[0], **({"unit": unit} if unit == "mA" else {})}
        if len(currents) > 1:
            look.doubt(currents[0], f"taken for the winding's current, of {len(currents)} currents")
    voltages, duties = look.having("voltage", tag), look.having("duty", tag)
    for name in voltages:
        values = look.data[name][np.isfinite(look.data[name])]
        if np.min(values) < 0 < np.max(values):
            found["motor_voltage"] = {"column": name}
        elif duties and "motor_voltage" not in found:
            found["motor_voltage"] = {"column": duties[0], "times": name}
            look.doubt(f"{duties[0]} times {name}", "taken for the voltage of the motor")
        else:
            look.doubt(name, "has one sign: a supply, not the voltage of the motor")
            continue
        break
