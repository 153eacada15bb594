"""describe_log: a log description guessed from names and values, and what is unsure about it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError, in_one_line, listed, shortened
from seaid.formats.opening import log_path, open_table
from seaid.formats.table import Block, Table
from seaid.logs.channels import LARGEST
from seaid.logs.column_guesses import Look, quantities_of
from seaid.logs.column_words import Meaning, meaning_of
from seaid.logs.log_description import Clock, LogDescription, Source
from seaid.robot import Robot

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
