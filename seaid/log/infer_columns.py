"""What the name of a foreign column says: quantity, side of the gear, joint, unit.

Guesses of what the columns of one joint are, from names and values, with the doubts noted.

describe_log: a log description guessed from names and values, and what is unsure about it.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, in_one_line, listed, shortened
from seaid.log.description import Clock, LogDescription, Source
from seaid.log.readers.opening import log_path, open_table
from seaid.log.readers.table import Block, Table
from seaid.log.repair.data import LARGEST
from seaid.robot import Robot

_QUANTITIES = {
    "time": "t time stamp timestamp ts clock seconds sec nanosec",
    "position": "pos position angle q theta phi ang enc encoder positions qpos",
    "velocity": "vel velocity speed dq qd qdot omega dtheta velocities rpm qvel",
    "acceleration": "acc accel acceleration ddq qdd qddot",
    "deflection": "defl deflection twist",
    "torque": "tau torque eff effort trq moment force torques frc",
    "current": "cur current amps iq curr currents i",
    "voltage": "volt volts voltage u voltages",
    "duty": "pwm duty",
    "temperature": "temp temperature wtemp",
}
_WORDS = {word: kind for kind, words in _QUANTITIES.items() for word in words.split()}
_ORDER = ("acceleration", "velocity", "temperature", "duty", "voltage", "current", "deflection")
_MOTOR = {"m", "motor", "mot", "rotor", "drive", "winding"}
_JOINT = {"joint", "link", "load", "out", "output", "l", "arm", "sensor", "external"}
_ROLES = {
    "commanded": "cmd command commanded goal target des desired ref reference setpoint con",
    "derived": "filt filtered fric friction est estimated model ff error err",
    "filler": "meas measured raw state states header actual act value data of the w bus",
}
_COMMANDED, _DERIVED, _FILLER = (set(words.split()) for words in _ROLES.values())
_UNITS = {
    **dict.fromkeys(("rad", "rads", "radians"), "rad"),
    **dict.fromkeys(("deg", "degs", "degree", "degrees"), "deg"),
    **dict.fromkeys(("turn", "turns", "rev", "revs"), "turn"),
    **dict.fromkeys(("count", "counts", "ticks", "inc"), "counts"),
    **{"nm": "Nm", "mnm": "mNm", "n": "N", "a": "A", "ma": "mA", "v": "V", "mv": "mV", "mm": "mm"},
    **{"s": "s", "ms": "ms", "us": "us", "ns": "ns", "nsec": "ns", "usec": "us", "msec": "ms"},
}
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^\W\d_]+")
_GREEK = {"θ": "theta", "φ": "phi", "ω": "omega", "τ": "tau", "μ": "u"}
_DOTS = (
    (re.compile("[qθφ]\N{COMBINING DOT ABOVE}"), "velocity"),
    (re.compile("[qθφ]\N{COMBINING DIAERESIS}"), "acceleration"),
)
"""Letters with the dots of a derivative, and the words for them."""


@dataclass(frozen=True)
class Meaning:
    """What a column name says: `quantity` ("position", ..., "" unknown), `side` ("motor", "joint",
    ""), `joint` (what is left of the name), `unit` or None; `is_raw` False for commands and what is
    filtered or computed.
    """

    quantity: str
    side: str
    joint: str
    unit: str | None
    is_raw: bool


def meaning_of(name: str) -> Meaning:
    """Read a column name: "mpos_0", "/joint_states/position[elbow]", "tau_meas1", "qd2"."""
    head, label = name, ""
    if bracket := re.fullmatch(r"(.*)\[([^\[\]]*)\]", name):
        head, label = bracket[1], bracket[2]
    if head.startswith("/"):  # a topic: the field counts
        head = head.rsplit("/", 1)[1]
    words = [word for one in _SPLIT.findall(_in_latin(head)) for word in _split(one.lower())]
    found = [_WORDS[word] for word in words if word in _WORDS]
    quantity = next((kind for kind in _ORDER if kind in found), found[0] if found else "")
    unit = next((_UNITS[word] for word in words[-1:] if word in _UNITS), None)
    if quantity == "time" and len(found) > 1:
        quantity = next((kind for kind in found if kind != "time"), "time")
    motor, joint = bool(_MOTOR & set(words)), _is_at_joint(words)
    side = "motor" if motor and not joint else "joint" if joint and not motor else ""
    if motor and joint:  # "joint_position_m" is in metres, "motor_elbow_joint" of the motor
        unit, side = ("m", "joint") if words[-1] == "m" else (unit, "motor")
    known = {*_WORDS, *_MOTOR, *_COMMANDED, *_DERIVED, *_FILLER}
    rest = [
        word
        for word, following in zip(words, [*words[1:], ""], strict=False)
        if word not in known
        and (word not in _UNITS or word.isdigit())
        and not (word in _JOINT and following in _WORDS)
    ]
    if set(rest) <= _JOINT | {"1"} and not any(word.isdigit() for word in rest):
        rest = []
    tag = label or "_".join(word for word in _named(rest))
    is_raw = not (_COMMANDED | _DERIVED) & set(words)
    return Meaning(quantity, side, tag, unit, is_raw)


def _in_latin(name: str) -> str:
    """Return a name with Greek letters as the words for them, without accents: θ is theta."""
    if name.isascii():
        return name
    text = unicodedata.normalize("NFKD", name)
    for dotted, word in _DOTS:
        text = dotted.sub(f" {word} ", text)
    for letter, word in _GREEK.items():
        text = text.replace(letter, f" {word} " if len(word) > 1 else word)
    return "".join(one for one in text if not unicodedata.combining(one))


def _is_at_joint(words: list[str]) -> bool:
    """Tell "joint_position" and "pos_link", a side of the gear, from "pos_elbow_joint", a name."""
    others = [word for word in words if not word.isdigit() and word not in _UNITS]
    for place, word in enumerate(others):
        before_quantity = others[place + 1 : place + 2]
        if word in _JOINT and before_quantity and before_quantity[0] in _WORDS:
            return True
    named = [word for word in others if word not in {*_WORDS, *_MOTOR, *_FILLER, *_JOINT}]
    return not named and bool(_JOINT & set(others))


def _named(rest: list[str]) -> list[str]:
    """Return the words of a joint's name: with a number alone, the number."""
    digits = [word for word in rest if word.isdigit()]
    return digits if digits and set(rest) <= {*digits, *_JOINT} else rest


def _split(word: str) -> list[str]:
    """Split a word into known ones: "mpos" into m and pos, "wcur" into w and cur."""
    if word in _WORDS or word in _UNITS or len(word) < 2:
        return [word]
    if word[0] in "mlw" and word[1:] in _WORDS:
        return [word[0], word[1:]]
    if word[-1] in "ml" and word[:-1] in _WORDS:
        return [word[:-1], word[-1]]
    return [word]


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


_TOLD = ("position", "torque", "deflection", "current", "voltage")

LOOKED_AT = 20_000
"""Samples from the start of a file that are looked at, where it can be read in pieces."""

_MOST_LISTED = 500_000
"""Columns that refused reads list anew in all, a few seconds of an NPZ file; then no more halves
are tried."""

_SHOWN = 100
"""Columns that are not used and shown."""

_STEPS_S = {"s": 5e-5, "ms": 5e-2, "us": 50.0, "ns": 5e4}
"""Smallest step that a clock in this unit shows at 20 kHz; the largest is a thousand times that."""


@dataclass(frozen=True, eq=False)
class Description:
    """A guessed `description`, what is `unsure` about it in words, and `unused` columns."""

    description: LogDescription
    unsure: tuple[str, ...]
    unused: tuple[str, ...]

    def to_toml(self) -> str:
        """Return the TOML of the description, with what is unsure as comments on top."""
        comments = "".join(f"# unsure: {shortened(one, 500)}\n" for one in self.unsure)
        return comments + self.description.to_toml()

    def __str__(self) -> str:
        rows = [("joint", "quantity", "column", "unit", "time")]
        for joint, sources in self.description.joints.items():
            for name, source in sources.items():
                clock = source.time or self.description.time
                column = ("-" if source.sign < 0 else "") + (source.column or "")
                column += f" * {source.times}" if source.times else ""
                unit = source.unit or "SI"
                unit += f", at the {source.side}" if source.side else ""
                rows.append((joint, name, column, unit, (clock and clock.column) or "of the file"))
        cells = [list(map(in_one_line, row)) for row in rows]
        widths = [max(len(row[place]) for row in cells) for place in range(5)]
        lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
        lines += [f"unsure: {one}" for one in self.unsure]
        return "\n".join([*lines, f"not used: {listed(self.unused, _SHOWN) or 'none'}"])


def describe_log(path: str | Path, robot: Robot | None = None) -> Description:
    """Guess what the columns of a foreign log are, from their names and values.

    With a robot its joints are named and its limits tell degrees from radians. Look at the result
    (`print(...)`), above all at what is unsure, save `to_toml()` beside the log, and correct it by
    hand. Raises LogError where the file cannot be read or no column looks like a position.
    """
    path = log_path(path)
    table = open_table(path)
    look = Look({}, {name: meaning_of(name) for name in table.names})
    look.data |= _alive(_all_samples(table, look), look)
    clocks = {} if table.clocks else _clocks(look)
    tags = _joints(look)
    if not tags:
        raise LogError(
            f"'{path}': no column looks like the position of a joint; columns are "
            f"{listed(table.names)}"
        )
    names = _joint_names(tags, robot, look)
    joints = {}
    for tag in tags:
        own = clocks.get(tag) if tag else None
        sources = quantities_of(look, tag, names[tag], robot)
        joints[names[tag]] = {name: Source(**one, time=own) for name, one in sources.items()}
    common = clocks.get("")
    if all(tag in clocks for tag in tags) and "" not in tags:
        beside = f"; {common.column} would be one for all" if common else ""
        look.doubt("time", f"every joint has a clock of its own, and these are used{beside}")
        common = None
    elif common is None and not table.clocks:
        look.doubt("time", "no column looks like it: name it, or say time = { rate_hz = ... }")
    used = {name for group in joints.values() for one in group.values() for name in one.columns()}
    used |= {
        one.time.column or "" for group in joints.values() for one in group.values() if one.time
    }
    used |= {common.column or ""} if common else set()
    unused = tuple(name for name in table.names if name not in used)
    return Description(LogDescription(joints, common), look.unsure(), unused)


def _all_samples(table: Table, look: Look) -> Block:
    """Return all columns that are numbers, of long files the beginning.

    Where they cannot be read together, the two halves are tried, down to the columns to blame.
    """
    counts = Counter(table.names)
    unique = [name for name, count in counts.items() if count == 1]
    found: Block = {}
    waiting, whole, refused = [unique], "", 0
    while waiting:
        names = waiting.pop()
        try:
            found |= next(table.blocks(names, LOOKED_AT)) if table.blocks else table.load(names)
        except LogError as problem:
            whole, refused = whole or str(problem), refused + 1
            if len(names) > 1 and refused * len(counts) < _MOST_LISTED:
                half = len(names) // 2
                waiting += [names[half:], names[:half]]
                continue
            if (
                len(names) == 1
                and str(problem) == whole
                and f"'{shortened(names[0])}'" not in whole
            ):
                raise  # it is the file, not this column
            for name in names:
                look.doubt(name, "no column of numbers: left out")
    return found


def _alive(data: Block, look: Look) -> Block:
    """Return the columns that say something; dead ones are left out."""
    found = {}
    for name, values in data.items():
        finite = values[np.isfinite(values)]
        meaning = look.meanings[name]
        if np.any(np.abs(finite) > LARGEST):
            look.doubt(name, f"has values beyond {LARGEST:g}: no sensor, left out")
        elif len(finite) and (np.ptp(finite) > 0 or meaning.quantity == "voltage"):
            found[name] = values
        elif meaning.quantity in _TOLD and meaning.is_raw:
            what = f"{finite[0]:.6g} all the time" if len(finite) else "without a number"
            look.doubt(name, f"{what}: a dead sensor, left out")
    return found


def _clocks(look: Look) -> dict[str, Clock]:
    """Return {joint, or "" for all: clock}."""
    found: dict[str, Clock] = {}
    for name, values in look.data.items():
        meaning, steps = look.meanings[name], np.diff(values[np.isfinite(values)])
        grows = len(steps) > 0 and np.mean(steps >= 0) > 0.95 and np.median(steps) > 0
        if meaning.quantity != "time" or not grows:
            continue
        tag = meaning.joint if re.fullmatch(r"(tx_|rx_)?\d+", meaning.joint) else ""
        tag = tag.rsplit("_", 1)[-1]
        if tag in found:
            look.doubt(name, f"may be the time instead of {found[tag].column}")
            continue
        found[tag] = Clock(name, _time_unit(name, meaning, steps, look))
    if not found:
        return _nameless_clock(look)
    return found


def _nameless_clock(look: Look) -> dict[str, Clock]:
    """Return the first column without a quantity in its name that grows evenly, as clock."""
    for name, values in look.data.items():
        steps = np.diff(values)
        if look.meanings[name].quantity or len(steps) < 2 or not np.all(steps > 0):
            continue
        if np.std(steps) < 0.5 * np.mean(steps):
            look.doubt(name, "grows evenly: taken for the time")
            return {"": Clock(name, _time_unit(name, look.meanings[name], steps, look))}
    return {}


def _time_unit(name: str, meaning: Meaning, steps: Array, look: Look) -> str:
    if meaning.unit in _STEPS_S:
        return str(meaning.unit)
    step = float(np.median(steps))
    unit = next((one for one, least in _STEPS_S.items() if least <= step < 1000 * least), "s")
    if unit != "s" or step > 0.05:
        look.doubt(name, f"has steps of {step:.4g}: taken for {unit}")
    return unit


def _joints(look: Look) -> list[str]:
    """Return the labels of joints whose positions move: numbers sorted, others as found."""
    tags = dict.fromkeys(
        meaning.joint
        for name, meaning in look.meanings.items()
        if meaning.quantity == "position" and meaning.is_raw and name in look.data
    )
    return sorted(tags, key=int) if all(_is_number(tag) for tag in tags) else list(tags)


def _is_number(tag: str) -> bool:
    return tag.isascii() and tag.isdecimal()


def _joint_names(tags: Sequence[str], robot: Robot | None, look: Look) -> dict[str, str]:
    """Return {label: joint name}: the robot's, by name or by order."""
    if robot is None:
        return {tag: f"joint_{tag}" if _is_number(tag) else tag or "joint" for tag in tags}
    near = {tag: get_close_matches(tag, robot.joint_names, 1, 0.7) for tag in tags if tag}
    if len({one[0] for one in near.values() if one}) == len(tags):
        return {tag: one[0] for tag, one in near.items()}
    if len(tags) > robot.n:
        look.doubt(", ".join(tags), f"{len(tags)} joints in the log, {robot.n} in the robot")
    look.doubt(", ".join(tags), "taken for the robot's joints in their order")
    extra = [f"joint_{tag}" for tag in tags[robot.n :]]
    return dict(zip(tags, [*robot.joint_names[: len(tags)], *extra], strict=True))
