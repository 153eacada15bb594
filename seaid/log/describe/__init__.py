"""Inference of a log description from the names and values of custom columns.

`quantities_of` selects the columns of one joint by their meanings and samples, and `describe_log`
composes the description and notes the uncertain choices.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid._progress import Display, counted
from seaid.drives import COMMANDS, Controller
from seaid.errors import LogError, abridged, checked, in_one_line, listed, shortened
from seaid.log.base_columns import VectorSource
from seaid.log.describe.base import BaseGuess, infer_base
from seaid.log.describe.inference import (
    Inference,
    Sources,
    check_used,
    correlation,
    follows,
    is_far,
    is_state,
    is_within,
    unit_by_velocity,
)
from seaid.log.describe.names import Meaning, in_file, is_of_commands, joint_alone, meaning_of
from seaid.log.description import Clock, LogDescription, Source
from seaid.log.log import UNIT_FACTORS
from seaid.log.readers.opening import files_of, open_tables
from seaid.log.readers.table import Block, Table
from seaid.log.repair import LARGEST
from seaid.robot import Robot

_SAME = 0.99
"""Correlation above which one channel counts as computed from another."""

_STIFF = 0.999
"""Squared correlation above which the slope of two positions is a gear ratio."""

_POSITION_FACTORS = {"": 1.0, **UNIT_FACTORS["rad"], **UNIT_FACTORS["m"]}
"""Factors of the units of positions to rad or m; counts have none that is known."""

_LISTED = 100
"""Most columns named in the message of a log without positions."""


def quantities_of(inference: Inference, joint: str, robot: Robot | None) -> Sources:
    """Return {quantity: arguments of its Source} of a joint."""
    sources = _positions(inference, joint)
    for quantity, source in reversed(sources.items()):
        source |= _position_unit(inference, source["column"], quantity, joint, robot)
    units = [source.get("unit") for source in sources.values()]
    if units == [None, "deg"]:
        sources["motor_position"]["unit"] = "deg"
        inference.note(sources["motor_position"]["column"], "taken for degrees, like the joint's")
    has_both = len(sources) == 2
    if not has_both and "joint_position" in sources:
        _note_side(inference, joint, sources["joint_position"], robot)
    _add_deflection(inference, joint, sources)
    _add_torques(inference, joint, sources)
    _add_electric(inference, joint, sources)
    if has_both:
        _turn_motor_side(inference, joint, sources)
    drives = [name for name in sources if name.endswith(("torque", "current", "voltage"))]
    # Efforts that are never negative are magnitudes or limits: no joint is driven one way only.
    is_signed = any(np.any(inference.finite(sources[name]["column"]) < 0) for name in drives)
    may_be_commanded = not drives or bool(inference.commands(joint))
    if may_be_commanded and not is_signed and "motor_position" not in sources:
        _add_command(inference, joint, sources)
    _add_temperature(inference, joint, sources)
    return sources


def _positions(inference: Inference, joint: str) -> Sources:
    motor = inference.having("position", joint, "motor")
    load = inference.having("position", joint, "joint", "")
    if load and not motor:
        motor, load = _sides_by_range(inference, load)
    sources: Sources = {}
    for quantity, group in (("motor_position", motor), ("joint_position", load)):
        if group:
            sources[quantity] = {"column": group[0]}
        if len(group) > 1:
            inference.note(group[0], f"selected from the positions {', '.join(group)}")
    return sources


def _sides_by_range(inference: Inference, names: list[str]) -> tuple[list[str], list[str]]:
    """Return motor positions and joint positions, if no name states the motor's side."""
    ranges = {name: float(np.ptp(inference.finite(name))) for name in names}
    small, large = min(names, key=ranges.__getitem__), max(names, key=ranges.__getitem__)
    unnamed = [name for name in names if not inference.meanings[name].side]
    # Gears of robots reduce, so that the motor moves farther than the joint, in the same unit.
    if len(names) == 2 and ranges[large] > 5 * ranges[small] and large in unnamed:
        inference.note(large, f"moves much farther than {small}: taken for the motor side")
        return [large], [small]
    return [], names


def _note_side(
    inference: Inference, joint: str, source: Mapping[str, Any], robot: Robot | None
) -> None:
    """Note the side of an only position: usual is that of the joint, within its limits."""
    column, factor = source["column"], _POSITION_FACTORS.get(source.get("unit", ""), np.nan)
    if not inference.meanings[column].side:
        fits = is_within(inference, column, factor, joint, robot)
        is_usual = fits and not inference.is_of_a_drive
        text = "taken for the joint side of the gear; it may be the motor side"
        inference.choose(column, text, is_usual=is_usual)


def _turn_motor_side(inference: Inference, joint: str, sources: Sources) -> None:
    """Note the gear ratio if motor position and joint position (plus deflection) correlate.

    Where it is negative, the motor's side of the gear gets the opposite sign.
    """
    motor, load = (
        inference.data[source["column"]] * _position_factor(source)
        for source in (sources["motor_position"], sources["joint_position"])
    )
    twists = [
        inference.data[name] * _POSITION_FACTORS.get(inference.meanings[name].unit or "rad", np.nan)
        for name in inference.having("deflection", joint)
    ]
    # theta_M / N = q + d with the deflection d, whose sign is not known yet: without it the
    # positions of a soft spring are not proportional.
    sides = [load] + [load + sign * twist for twist in twists for sign in (1.0, -1.0)]
    best = max(sides, key=lambda side: correlation(motor, side) ** 2)
    if not correlation(motor, best) ** 2 > _STIFF:
        return
    good = np.isfinite(motor) & np.isfinite(best)
    # Least squares of the motor's position over the joint's: the slope is N, and is negative for
    # encoders that count against each other.
    ratio = np.cov(motor[good], best[good])[0, 1] / np.var(best[good], ddof=1)
    inference.note(joint, f"the motor turns {ratio:.5g} times as far: check the gear ratio")
    if ratio < 0:
        # Position and effort of the motor turn together, so that their power keeps its sign; a
        # torque that was converted to the joint has the joint's sign already.
        turned = [x for x in sources if x in _MOTOR_SIDE and sources[x].get("side") != "joint"]
        for quantity in turned:
            sources[quantity]["sign"] = -int(sources[quantity].get("sign", 1))
        columns = listed(str(sources[quantity]["column"]) for quantity in turned)
        inference.note(columns, "turns against the joint encoder: sign = -1 on the motor's side")


_MOTOR_SIDE = ("motor_position", "motor_torque", "motor_current", "motor_voltage")


def _position_factor(source: Mapping[str, Any]) -> float:
    """Return the factor of a position to rad or m, of counts with their number per turn."""
    if "counts_per_turn" in source:
        return 2 * np.pi / float(source["counts_per_turn"])
    return _POSITION_FACTORS.get(source.get("unit", ""), np.nan)


def _position_unit(
    inference: Inference, column: str, quantity: str, joint: str, robot: Robot | None
) -> dict[str, Any]:
    """Return the arguments for the unit of a position, none for rad."""
    values, unit = inference.finite(column), inference.meanings[column].unit
    is_whole = np.ptp(values) > 100 and np.all(values == np.round(values))
    if unit == "counts" or (unit is None and is_whole):
        # Encoders have 2^k counts per turn: the least power above all counts, if they reach a whole
        # turn.
        power = 2 ** math.ceil(math.log2(max(float(np.max(np.abs(values))), 2.0)))
        inference.note(column, f"in counts: {power} per turn is a guess")
        return {"unit": "counts", "counts_per_turn": float(power)}
    if unit is not None:
        return {"unit": unit}
    if unit := unit_by_velocity(inference, column, joint):
        inference.choose(column, f"{unit} by its velocity", is_usual=True)
    elif quantity == "joint_position":
        unit = _unit_by_range(inference, column, joint, robot)
    return {} if unit in (None, "rad") else {"unit": unit}


def _unit_by_range(
    inference: Inference, column: str, joint: str, robot: Robot | None
) -> str | None:
    """Return the unit of an angle by how far it moves, None for a prismatic joint."""
    farthest, moves = _farthest_rad(joint, robot), float(np.ptp(inference.finite(column)))
    if farthest is None:
        return None
    # In degrees the same motion is 57 times as large a number, beyond any range in rad.
    unit = "deg" if moves > farthest else "rad"
    fits = is_within(inference, column, UNIT_FACTORS["rad"][unit], joint, robot)
    if fits and is_far(inference, column) and not inference.is_of_a_drive:
        inference.choose(column, f"taken for {unit}", is_usual=True)
    elif unit == "deg":
        inference.note(f"{column} (moves by {moves:.4g})", "taken for degrees")
    else:
        more = "; turns are usual of such drives" if inference.is_of_a_drive else ""
        inference.note(f"{column} (moves by {moves:.3g})", f"taken for rad{more}")
    return unit


def _farthest_rad(joint: str, robot: Robot | None) -> float | None:
    """Return the range that the angle of a joint hardly exceeds, None for a prismatic joint."""
    if robot is None or joint not in robot.joint_names:
        return 4 * np.pi
    if robot.is_prismatic[robot.index(joint)]:
        return None
    lower, upper = robot.position_range(joint)
    return min(2 * (upper - lower), 4 * np.pi)


_FAR_FOR_A_SPRING = 0.5
"""Range of a deflection without a unit above which it may be in degrees or mm."""


def _add_deflection(inference: Inference, joint: str, sources: Sources) -> None:
    names = inference.having("deflection", joint)
    if not names:
        return
    if len(sources) == 2:
        inference.note(names[0], "redundant, because both positions are there")
    elif sources:
        drives = inference.having("torque", joint) or inference.having("current", joint)
        twist = inference.data[names[0]]
        # By (4a) the torque of the spring grows with its deflection, motor side less joint side.
        pulls = sum(correlation(inference.data[name], twist) for name in drives[:1])
        sources["deflection"] = {"column": names[0], "sign": -1 if pulls < 0 else 1}
        if unit := inference.meanings[names[0]].unit:
            sources["deflection"]["unit"] = unit
        elif np.ptp(inference.finite(names[0])) > _FAR_FOR_A_SPRING:
            inference.note(names[0], "its unit is not said, and it moves far for rad or m")
        origin = f", inferred from {drives[0]}" if pulls else ""
        inference.note(names[0], f"check its sign (motor side minus joint side){origin}")


def _add_torques(inference: Inference, joint: str, sources: Sources) -> None:
    twists = inference.having("deflection", joint)
    names = inference.having("torque", joint)
    if not names and not inference.having("current", joint):
        estimates = inference.named("torque", joint).items()
        # a column that never changes is no signal: it is not among the data
        names = [x for x, m in estimates if m.is_estimate and x in inference.data]
        for name in names:
            inference.note(name, "an estimate of the drive, taken as there is no other torque")
    for name in names:
        meaning = inference.meanings[name]
        side, arguments = meaning.side, {"column": name}
        if meaning.unit in UNIT_FACTORS["A"]:
            inference.note(name, "a torque in amperes: describe it with torque_constant_Nm_per_A")
            continue
        if twists and abs(correlation(inference.data[name], inference.data[twists[0]])) > _SAME:
            side = "joint"
            inference.note(name, f"proportional to {twists[0]}: one is computed from the other")
        elif not side and "motor_position" in sources:
            side = "motor"
            inference.note(name, "taken for the motor's torque, at the motor")
        elif not side:
            side, arguments["side"] = "motor", "joint"
            inference.note(
                name,
                "taken for the motor's torque converted to the joint, which includes friction: "
                "name it joint_torque if a sensor behind the gear measures it",
            )
        arguments |= _unit(meaning, "Nm")
        if f"{side}_torque" in sources:
            inference.note(name, f"a second {side}_torque: excluded")
            continue
        sources[f"{side}_torque"] = arguments


def _no_torque(inference: Inference, joint: str) -> str:
    """Return the note of a joint without torques and commands, with commands of unknown kind."""
    commands = [x for x, m in inference.named("", joint).items() if m.is_command]
    what = (
        f"; {listed(commands)}: a command of what is unknown, as the position does not follow it: "
        "name it position_command, velocity_command or torque_command in a description"
    )
    return f"no torque, current or voltage found{what if commands else ''}"


def _add_command(inference: Inference, joint: str, sources: Sources) -> None:
    """Add the commands of a joint without torque, its position in the unit of the measured one."""
    names = {kind: inference.commands(joint, kind) for kind in _COMMAND_UNITS}
    for kind in ("velocity", "torque"):  # of many drives they are zero all the time
        names[kind] = [name for name in names[kind] if np.any(inference.finite(name))]
    leading = next((kind for kind in ("position", "velocity") if names[kind]), "")
    if not leading or not sources:
        inference.note(joint, _no_torque(inference, joint))
        return
    position = sources.get("motor_position") or sources["joint_position"]
    sources |= _command_sources(inference, names, position)
    inference.note(
        names[leading][0],
        f"a {leading} command of a joint without a torque that has both signs: its drive needs "
        f'motor_input = "{leading}_command" and the gains of its controller',
    )
    if names["torque"]:
        inference.note(
            names["torque"][0],
            "taken for a feed-forward torque that the drive adds to that of its gains; if it is "
            'the whole torque, describe it as motor_torque with side = "joint"',
        )
    else:
        _note_computed_torques(inference, joint)


_COMMAND_UNITS = {"position": "", "velocity": "rad/s", "torque": "Nm"}
"""{quantity of a command: its usual unit}; that of a position is the unit of the measured one."""


def _command_sources(
    inference: Inference, names: Mapping[str, list[str]], position: Mapping[str, Any]
) -> Sources:
    """Return the sources of the first command of each quantity."""
    commands: Sources = {}
    for kind, columns in names.items():
        if not columns:
            continue
        source = commands[f"{kind}_command"] = {"column": columns[0]}
        if kind == "position":
            source |= {x: position[x] for x in ("unit", "counts_per_turn") if x in position}
        source |= _unit(inference.meanings[columns[0]], _COMMAND_UNITS[kind])
        if len(columns) > 1:
            inference.note(columns[0], f"selected from the commands {', '.join(columns)}")
    return commands


def _note_computed_torques(inference: Inference, joint: str) -> None:
    """Note the computed torques of a joint, which its drive may add to that of its gains."""
    for name, meaning in inference.named("torque", joint).items():
        is_computed = not (meaning.is_raw or meaning.is_command or meaning.is_estimate)
        if is_computed and name in inference.data:
            inference.note(
                name,
                "computed, and not used: if the drive adds it to the torque of its gains, describe "
                "it as torque_command",
            )


def _unit(meaning: Meaning, usual: str) -> dict[str, str]:
    """Return the argument for the unit of a source, none for the usual one."""
    return {} if meaning.unit in (None, usual) else {"unit": meaning.unit}


def _add_electric(inference: Inference, joint: str, sources: Sources) -> None:
    # A w stands for the winding, as in HEBI's "motor_winding_current": that gives the torque.
    currents = sorted(inference.having("current", joint), key=lambda name: "w" not in name.lower())
    if currents:
        unit = _unit(inference.meanings[currents[0]], "A")
        sources["motor_current"] = {"column": currents[0], **unit}
        if len(currents) > 1:
            inference.note(currents[0], f"selected from {len(currents)} currents as the winding's")
    duties = inference.having("duty", joint)
    for name in inference.having("voltage", joint):
        values = inference.finite(name)
        # The voltage of a motor needs both signs; a supply has one, and its duty cycle the other
        # part.
        if np.min(values) < 0 < np.max(values):
            sources["motor_voltage"] = {"column": name, **_unit(inference.meanings[name], "V")}
            if inference.meanings[name].side != "motor":
                inference.note(name, "taken for the voltage of the motor; it may be a command")
            return
        if duties:
            factor = UNIT_FACTORS["V"][inference.meanings[name].unit or "V"]
            scale = {} if factor == 1 else {"scale": factor}
            sources["motor_voltage"] = {"column": duties[0], "times": name, **scale}
            inference.note(f"{duties[0]} times {name}", "taken for the voltage of the motor")
            return
        text = "has one sign: a supply, not the voltage of the motor"
        inference.choose(name, text, is_usual=inference.meanings[name].side != "motor")


_OF_ELECTRONICS = re.compile("controller|board|pcb|fet|driver|mcu|cpu|ambient")
"""Parts of names of temperatures that are not the motor's."""

_KELVIN = 200.0
"""A temperature above this is in kelvin: no motor of a robot is as hot, or as cold."""


def _add_temperature(inference: Inference, joint: str, sources: Sources) -> None:
    """Add the temperature of the motor: one that says so, else the first of the joint."""
    having = inference.having("temperature", joint)
    names = [name for name in having if not _OF_ELECTRONICS.search(name.lower())]
    if not names:
        return
    name = next((name for name in names if inference.meanings[name].side == "motor"), names[0])
    unit = inference.meanings[name].unit
    if unit is None and np.median(inference.finite(name)) > _KELVIN:
        unit = "K"
        inference.note(name, "taken for kelvin")
    sources["motor_temperature"] = {"column": name}
    if unit not in (None, "degC"):
        sources["motor_temperature"]["unit"] = unit
    if inference.meanings[name].side != "motor":
        text = "taken for the temperature of the motor"
        inference.choose(name, text, is_usual=len(names) == 1)


_MEASURED = ("position", "torque", "deflection", "current", "voltage")

_EXAMINED = 20_000
"""Samples at the start of a file that are examined, if it can be read in pieces."""

_MOST_LISTED = 500_000
"""Limit of failed reads times columns, a few seconds of an NPZ file, for the bisection of columns
that cannot be read."""

_SHOWN = 100
"""Most unused columns that are shown."""


_STEPS_S = {"s": 5e-5, "ms": 5e-2, "us": 50.0, "ns": 5e4}
"""Smallest step of a clock in this unit (20 kHz); the largest is a thousand times that."""


@dataclass(frozen=True, eq=False, repr=False)
class Description(Display):
    """An inferred log description, as `describe_log` returns it; str() is a table.

    Attributes
    ----------
    description : LogDescription
        The inferred description.
    unsure : tuple of str
        The uncertain choices, as sentences.
    unused : tuple of str
        Columns of the file that are not used.
    assumed : tuple of str
        Usual choices that neither names nor samples contradict, as sentences.
    gains : mapping {joint: Controller}
        Controllers with the gains of columns "kp" and "kd" next to the command of the joint. They
        are up to scale where the log has the supply of a motor and no torque: then they are in
        V per rad.
    """

    description: LogDescription
    unsure: tuple[str, ...]
    unused: tuple[str, ...]
    assumed: tuple[str, ...] = ()
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
        rows = [("joint", "quantity", "column", "unit", "time")]
        for joint, sources in self.description.joints.items():
            rows += [(joint, name, *self._cells(source)) for name, source in sources.items()]
        vectors = {"base": self.description.base, **self.description.contacts}
        for place, by_quantity in vectors.items():
            rows += [(place, name, *_vector_cells(vector)) for name, vector in by_quantity.items()]
        cells = [list(map(in_one_line, row)) for row in rows]
        widths = [max(len(row[place]) for row in cells) for place in range(5)]
        lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
        lines += [f"unsure: {choice}" for choice in self.unsure]
        lines += [f"assumed: {choice}" for choice in self.assumed]
        return "\n".join([*lines, f"not used: {listed(self.unused, _SHOWN) or 'none'}"])

    def _cells(self, source: Source) -> tuple[str, str, str]:
        """Return column, unit and time of a source."""
        column = f"{'-' if source.sign < 0 else ''}{source.column or ''}"
        times = f" * {source.times}" if source.times else ""
        side = f", at the {source.side}" if source.side else ""
        clock = source.time or self.description.time
        time = (clock and clock.column) or "of the file"
        return column + times, (source.unit or "SI") + side, time


def _vector_cells(source: VectorSource) -> tuple[str, str, str]:
    """Return columns, frame or order, and time of a vector of the base."""
    plain = source.plain()
    columns = plain["columns"] if isinstance(plain, dict) else plain
    more = source.frame or source.order or ("SI" if source.above is None else f"> {source.above:g}")
    return columns if isinstance(columns, str) else ", ".join(columns), more, "of the file"


@checked(LogError)
def describe_log(
    path: str | Path | Sequence[str | Path] | Mapping[str, Any],
    robot: Robot | None = None,
    *,
    rate_hz: float | None = None,
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

    Returns
    -------
    Description
        The description, its uncertain choices and the unused columns.

    Raises
    ------
    LogError
        If the file cannot be read or no column looks like a position.

    Examples
    --------
    >>> guess = seaid.describe_log("run.csv", robot)
    >>> print(guess)
    >>> Path("run.toml").write_text(guess.to_toml())
    """
    paths, held = files_of(path)
    table = held or open_tables(paths)
    samples, inference, guess = _understood(table, robot)
    clocks = {} if table.clocks else _file_clocks(table, inference)
    _take_estimates(inference)
    inference.time = _time_of(inference, clocks.get(""))
    tags = _assign_motor(inference, _joints(inference) or _measured_next_to_commands(inference))
    names = _joint_names(tags, robot, inference)
    if not names:
        raise LogError(
            f"'{' + '.join(map(str, paths))}': no column looks like the position of a joint; "
            f"columns are {listed(table.names, _LISTED)}{'; ' if table.notice else ''}"
            f"{table.notice}"
        )
    _label_by_joint(inference, names)
    drafts = {x: quantities_of(inference, x, robot) for x in dict.fromkeys(names.values())}
    joints = _sources(drafts, clocks, names, table.files)
    gains = _gains(samples, inference, joints)
    check_used(inference, drafts, robot, {x for clock in clocks.values() for x in clock.columns()})
    description = LogDescription(
        joints,
        _common_clock(table, inference, clocks, tags, rate_hz),
        base=guess.base,
        contacts=guess.contacts,
        files=_file_names(paths) if table.files else (),
    )
    used = description.columns()
    unused = tuple(name for name in table.names if not used & {name, table.bare(name)})
    return Description(description, inference.unsure(), unused, inference.assumptions(), gains)


def _understood(table: Table, robot: Robot | None) -> tuple[Block, Inference, BaseGuess]:
    """Return all samples, the columns with a signal and what they mean, and those of the base."""
    joints = _every_joint(robot) if robot is not None else ()
    meanings = {
        name: in_file(meaning_of(table.bare(name), joints), table.files.get(name, ""))
        for name in table.names
    }
    inference = Inference({}, meanings)
    _take_bare_names(inference, joints)
    samples, guess = _all_samples(table, inference), BaseGuess()
    if robot is not None and robot.floating_base is not None:
        guess = infer_base(table, replace(inference, data=samples), robot)
        inference.meanings |= guess.meanings
    inference.data |= _signal_columns(samples, inference)
    return samples, inference, guess


def _sources(
    drafts: Mapping[str, Sources],
    clocks: Mapping[str, Clock],
    names: Mapping[str, str],
    files: Mapping[str, str],
) -> dict[str, dict[str, Source]]:
    """Return the sources of each joint, with its own clock or that of the file of the column."""
    own = {joint: clocks[tag] for tag, joint in names.items() if tag and tag in clocks}
    return {
        joint: {
            name: Source(**x, time=own.get(joint) or clocks.get(files.get(x["column"], joint)))
            for name, x in draft.items()
        }
        for joint, draft in drafts.items()
    }


def _file_names(paths: Sequence[Path]) -> tuple[str, ...]:
    """Return the names of files in the folder of the first, and the whole paths of others."""
    folder = paths[0].parent
    return tuple(file.name if file.parent == folder else str(file.resolve()) for file in paths)


_GAIN = re.compile(r"(?<![a-z])k_?([pd])(?![a-z])", re.IGNORECASE)
"""A gain in the name of a column: "motor_cmd[0].kp"."""


def _gains(
    samples: Block, inference: Inference, joints: Mapping[str, Mapping[str, Source]]
) -> dict[str, Controller]:
    """Return the controllers with gains of columns named as the command but for the quantity."""
    supplies = [name for name in samples if inference.meanings[name].quantity == "voltage"]
    unit = "N m at the joint"
    if supplies:
        unit = f"V per rad, as the motor has the supply '{supplies[0]}': is_up_to_scale = true"
    controllers: dict[str, Controller] = {}
    for joint, sources in joints.items():
        command = next((str(sources[x].column) for x in COMMANDS if x in sources), "")
        gains: dict[str, float] = {}
        for name, letter in _gain_columns(samples, command):
            values = samples[name][np.isfinite(samples[name])]
            if len(values) == 0 or np.ptp(values) > 0 or values[0] < 0:
                inference.note(
                    name,
                    "a gain that changes: give each part of the log with one gain set as a log of "
                    "its own (between_s in the project)",
                )
                continue
            gains[letter] = float(values[0])
            inference.note(name, f"taken for a gain of the controller, in {unit}")
        if gains:
            controllers[joint] = Controller(
                position_gain_Nm_per_rad=gains.get("p", 0.0),
                velocity_gain_Nms_per_rad=gains.get("d", 0.0),
                is_up_to_scale=bool(supplies),
            )
    return controllers


def _gain_columns(names: Iterable[str], command: str) -> Iterator[tuple[str, str]]:
    """Yield the columns named as a command but for the quantity, and the letter of their gain."""
    for name in names:
        if word := _GAIN.search(name):
            head, tail = name[: word.start()], name[word.end() :]
            # Of "motor_cmd[0].kp" and the command "motor_cmd[0].q" the middle is "q": any word may
            # be there.
            middle = command.removeprefix(head).removesuffix(tail)
            if head + middle + tail == command and middle.replace("_", "").isalpha():
                yield name, word[1].lower()


def _take_estimates(inference: Inference) -> None:
    """Take positions that a drive calls estimated for measured, if there are no others."""
    kinds = {name: m for name, m in inference.meanings.items() if m.quantity == "position"}
    if not any(meaning.is_raw and name in inference.data for name, meaning in kinds.items()):
        for name, meaning in kinds.items():
            if meaning.is_estimate and name in inference.data:
                inference.meanings[name] = replace(meaning, is_raw=True, is_estimate=False)
                inference.note(name, "an estimate of the drive, as there is no other position")


def _common_clock(
    table: Table,
    inference: Inference,
    clocks: Mapping[str, Clock],
    tags: Sequence[str],
    rate_hz: float | None,
) -> Clock | None:
    """Return the clock of all joints, None if each has its own or no column looks like one."""
    if table.clocks or not clocks.keys().isdisjoint(table.files.values()):
        return None
    common = clocks.get("")
    if clocks and clocks.keys() >= {*tags} and "" not in tags:
        hint = f"; {common.column} would be a common clock" if common else ""
        inference.note("time", f"every joint has its own clock, and these are used{hint}")
        return None
    if not clocks and rate_hz:
        return Clock(rate_hz=rate_hz)
    if common is None:
        inference.note("time", "no column looks like it: name it, or give time = { rate_hz = ... }")
    return common


@dataclass(frozen=True)
class _File:
    """A file: its columns but the time, the quantities of these, and its time span [s]."""

    path: Path
    columns: frozenset[str]
    quantities: frozenset[str]
    start_s: float
    end_s: float


def logs_of_files(
    paths: Sequence[Path], robot: Robot
) -> tuple[list[tuple[Path, ...]], tuple[str, ...]]:
    """Return the files of each log, and what is doubtful about it.

    Files are of one log if none of their columns is in two of them, their times overlap, and not
    each has both positions and torques. Clocks that begin at zero overlap in files of different
    motions too, so that each such log is a doubt.
    """
    groups: list[list[_File]] = []
    for file in (_file_of(path, robot) for path in paths):
        fitting = (group for group in groups if all(_are_of_one_log(file, each) for each in group))
        group = next(fitting, [])
        if not group:
            groups.append(group)
        group.append(file)
    return [tuple(file.path for file in group) for group in groups], tuple(_doubts(groups))


def _doubts(groups: Sequence[Sequence[_File]]) -> Iterator[str]:
    """Yield what is doubtful about the files of each log, and about logs that may be one."""
    for group in groups:
        if len(group) > 1:
            common = min(file.end_s for file in group) - max(file.start_s for file in group)
            yield (
                f"{listed(file.path.name for file in group)} have different columns over the same "
                f"time ({common:.4g} s): taken for the files of one log; if they are not, give "
                "each a [[log]] of its own"
            )
    firsts = [group[0] for group in groups]
    for earlier, file in ((x, y) for place, y in enumerate(firsts) for x in firsts[:place]):
        if _complement(file, earlier):
            yield (
                f"{earlier.path.name} and {file.path.name} have different columns, and one lacks "
                "positions or torques, but their times do not overlap: if they are of one motion, "
                "repair a clock and list both in one [[log]], "
                f'files = ["{earlier.path.name}", "{file.path.name}"]'
            )


_OVERLAP = 0.8
"""Part of the shorter file's time from which two files are simultaneous."""

_TORQUES = {"torque", "current", "voltage"}


def _are_of_one_log(first: _File, second: _File) -> bool:
    return _complement(first, second) and _overlap(first, second)


def _complement(first: _File, second: _File) -> bool:
    """Whether files share no column, and one at least lacks positions or torques."""
    complete = [
        "position" in each.quantities and not _TORQUES.isdisjoint(each.quantities)
        for each in (first, second)
    ]
    known = bool(first.columns and second.columns)
    if _is_with_commands(first, second) or _is_with_commands(second, first):
        return known
    return known and first.columns.isdisjoint(second.columns) and not all(complete)


def _is_with_commands(first: _File, second: _File) -> bool:
    """Whether the second of "run.state.csv" and "run.control.csv" has the commands of the first."""
    names = first.path.name.split("."), second.path.name.split(".")
    is_command = [is_of_commands(path.name) for path in (first.path, second.path)]
    return names[0][0] == names[1][0] and min(map(len, names)) > 2 and is_command == [False, True]


def _overlap(first: _File, second: _File) -> bool:
    common = min(first.end_s, second.end_s) - max(first.start_s, second.start_s)
    shorter = min(first.end_s - first.start_s, second.end_s - second.start_s)
    return common > _OVERLAP * shorter


def _file_of(path: Path, robot: Robot) -> _File:
    """Return the columns and times of a file; nothing if its clock is not found."""
    nothing = _File(path, frozenset(), frozenset(), math.nan, math.nan)
    try:
        table = open_tables([path])
        meanings = {name: meaning_of(name, _every_joint(robot)) for name in table.names}
        inference = Inference({}, meanings)
        inference.data |= _all_samples(table, inference)
        clock = None if table.clocks else _clocks(inference).get("")
        if clock is None or clock.column is None:
            return nothing
        time = clock.seconds(table.load(clock.columns()), 0)
    except LogError:
        return nothing
    columns = frozenset(table.names) - {*clock.columns()}
    quantities = frozenset(meanings[name].quantity for name in columns)
    return _File(path, columns, quantities, float(np.nanmin(time)), float(np.nanmax(time)))


def _all_samples(table: Table, inference: Inference) -> Block:
    """Return all readable columns of numbers, found by bisection, from the start of long files."""
    # A read of all columns is fast, but one bad column refuses it: halves find that in
    # log2(columns) reads.
    waiting = [[name for name, count in Counter(table.names).items() if count == 1]]
    samples: Block = {}
    first, refused = "", 0
    while waiting:
        names = waiting.pop()
        try:
            samples |= table.start(names, _EXAMINED)
        except LogError as problem:
            text = str(problem)
            first, refused = first or text, refused + 1
            if len(names) > 1 and refused * len(table.names) < _MOST_LISTED:
                half = len(names) // 2
                waiting += [names[half:], names[:half]]
            elif len(names) == 1 and text == first and f"'{shortened(names[0])}'" not in text:
                raise  # the file is invalid, not this column
            else:
                for name in names:
                    if f"{name}[0]" not in table.names:  # a matrix, whose columns are read
                        inference.note(name, "no column of numbers: excluded")
    return samples


def _signal_columns(data: Block, inference: Inference) -> Block:
    """Return the columns with a signal; constant ones are excluded."""
    signals = {}
    for name, values in data.items():
        finite, meaning = values[np.isfinite(values)], inference.meanings[name]
        moves = bool(np.any(finite != finite[:1]))
        is_sensor = _is_sensor(meaning)
        may_stand = len(finite) > 0 and (meaning.quantity == "voltage" or meaning.is_command)
        if np.any(np.abs(finite) > LARGEST):
            inference.note(name, f"has values beyond {LARGEST:g}: no sensor, excluded")
        elif is_sensor and moves and is_state(finite):
            inference.note(name, "has a few whole numbers only: a state, excluded")
        elif moves or may_stand:
            signals[name] = values
        elif is_sensor:
            what = f"{finite[0]:.6g} all the time" if len(finite) else "without a number"
            inference.note(name, f"{what}: a dead sensor, excluded")
    return signals


def _is_sensor(meaning: Meaning) -> bool:
    """Return whether a name is that of a raw measurement."""
    return meaning.is_raw and meaning.quantity in _MEASURED


def _time_of(inference: Inference, clock: Clock | None) -> Array | None:
    """Return the samples of a clock in seconds since the first."""
    if clock is None or not clock.columns() or not inference.data.keys() >= {*clock.columns()}:
        return None
    seconds = clock.seconds(inference.data, 0)
    return np.asarray(seconds - seconds[0], dtype=float)


def _file_clocks(table: Table, inference: Inference) -> dict[str, Clock]:
    """Return {joint, or "" for all: clock}; {file: clock} if names differ in several files."""
    if not table.files:
        return _clocks(inference)
    clocks, files = dict[str, Clock](), dict.fromkeys(table.files.values())
    for file in files:
        data = {x: values for x, values in inference.data.items() if table.files[x] == file}
        clock = _clocks(replace(inference, data=data)).get("")
        clocks |= {file: clock} if clock else {}
    names = {(table.bare(clock.column or ""), clock.unit) for clock in clocks.values()}
    if len(names) == 1 and len(clocks) == len(files):
        ((column, unit),) = names
        return {"": Clock(column, unit)}
    return clocks


def _clocks(inference: Inference) -> dict[str, Clock]:
    """Return {joint, or "" for all joints: clock}."""
    clocks: dict[str, Clock] = {}
    if split := _clock_of_two_columns(inference):
        return {"": split}
    for name, values in inference.data.items():
        meaning, steps = inference.meanings[name], np.diff(values[np.isfinite(values)])
        # Not all steps: stamps may come late or be repeated, which a repair corrects afterwards.
        grows = len(steps) > 0 and np.mean(steps >= 0) > 0.95 and np.median(steps) > 0
        if meaning.quantity != "time" or not grows:
            continue
        tag = meaning.joint if re.fullmatch(r"(tx_|rx_)?\d+", meaning.joint) else ""
        tag = tag.rsplit("_", 1)[-1]
        if tag in clocks:
            inference.note(name, f"may be the time instead of {clocks[tag].column}")
            continue
        clocks[tag] = Clock(name, _time_unit(name, meaning, steps, inference))
    # The names decide first, because a position in slow motion may increase evenly, too.
    return clocks or _nameless_clock(inference)


_WHOLE = 1e9
"""Nanoseconds of a second."""


def _clock_of_two_columns(inference: Inference) -> Clock | None:
    """Return the clock of whole seconds and nanoseconds, as in the header of a ROS message."""
    named = [name for name in inference.data if inference.meanings[name].quantity == "time"]
    for seconds, rest in permutations(named, 2):
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
    for name, values in inference.data.items():
        steps = np.diff(values)
        if inference.meanings[name].quantity or len(steps) < 2 or not np.all(steps > 0):
            continue
        if np.std(steps) < 0.5 * np.mean(steps):
            inference.note(name, "increases evenly: taken for the time")
            return {"": Clock(name, _time_unit(name, inference.meanings[name], steps, inference))}
    return {}


def _time_unit(name: str, meaning: Meaning, steps: Array, inference: Inference) -> str:
    if meaning.unit in _STEPS_S:
        return str(meaning.unit)
    step = float(np.median(steps))
    # Steps of 20 kHz to 20 Hz: 50 us to 50 ms. In s, ms, us and ns these ranges do not overlap.
    unit = next((unit for unit, least in _STEPS_S.items() if least <= step < 1000 * least), "s")
    if unit != "s" or step > 0.05:
        inference.note(name, f"has steps of {step:.4g}: taken for {unit}")
    return unit


def _joints(inference: Inference) -> list[str]:
    """Return the labels of joints whose positions move: numbers sorted, others in file order."""
    tags = dict.fromkeys(
        meaning.joint
        for name, meaning in inference.meanings.items()
        if meaning.quantity == "position" and meaning.is_raw and name in inference.data
    )
    return sorted(tags, key=int) if all(_is_number(tag) for tag in tags) else list(tags)


def _measured_next_to_commands(inference: Inference) -> list[str]:
    """Return the labels of "actual_1" next to "target_1", which are taken for positions."""
    commands = {
        meaning.joint: name
        for name, meaning in inference.meanings.items()
        if meaning.is_command and not meaning.quantity and name in inference.data
    }
    for name, meaning in inference.meanings.items():
        leads = commands.get(meaning.joint)
        is_unnamed = (
            meaning.is_raw and meaning.is_said and not meaning.quantity and name in inference.data
        )
        if is_unnamed and leads and follows(inference.data[name], inference.data[leads]):
            inference.meanings[name] = replace(meaning, quantity="position")
            inference.note(name, "measured, without a quantity: taken for the position")
    return _joints(inference)


def _is_number(tag: str) -> bool:
    return tag.isascii() and tag.isdecimal()


def _assign_motor(inference: Inference, tags: list[str]) -> list[str]:
    """Return the labels of joints; a motor without a label is that of the only one with a label."""
    nameless = {x: m for x, m in inference.meanings.items() if not m.joint and _is_sensor(m)}
    sides = {m.side for m in nameless.values() if m.quantity == "position"}
    # Exactly one label, and columns without one that are all of a motor: "mpos" next to
    # "elbow_pos".
    if len(tags) != 2 or "" not in tags or not sides <= {"motor"}:
        return tags
    label = next(filter(None, tags))
    for name, meaning in nameless.items():
        inference.meanings[name] = replace(meaning, joint=label)
        inference.note(name, f"taken for the motor of {label}")
    return [label]


def _take_bare_names(inference: Inference, joints: Sequence[str]) -> None:
    """Take columns with nothing but the name of a joint for its position, if it has no other."""
    located = {
        meaning.joint
        for meaning in inference.meanings.values()
        if meaning.quantity == "position" and meaning.is_raw
    }
    for name, meaning in inference.meanings.items():
        joint = joint_alone(name, joints)
        if joint and joint not in located and not meaning.quantity:
            inference.meanings[name] = replace(meaning, quantity="position", joint=joint)
            inference.note(name, "has the name of a joint and no quantity: taken for its position")


def _label_by_joint(inference: Inference, names: Mapping[str, str]) -> None:
    """Replace the labels of columns by the names of joints.

    A column with a number and unknown words is one of the joint with this number, if that has none
    of its quantity.
    """
    labelled = {
        (meaning.quantity, names[meaning.joint])
        for meaning in inference.meanings.values()
        if meaning.joint in names and meaning.is_raw
    }
    numbers = {_number_in(tag): joint for tag, joint in names.items()}
    for name, meaning in inference.meanings.items():
        number, joint = _number_in(meaning.joint), names.get(meaning.joint)
        is_sensor = meaning.is_raw or meaning.is_estimate
        if joint is None and number and is_sensor and meaning.quantity in _MEASURED:
            joint = numbers.get(number) if len(numbers) == len(names) else None
            if joint is None or (meaning.quantity, joint) in labelled:
                continue
            inference.note(name, f"taken for joint {joint} by its number")
        if joint is not None:
            inference.meanings[name] = replace(meaning, joint=joint)


def _every_joint(robot: Robot) -> tuple[str, ...]:
    """Return the joints of a robot's file, those that stand still too."""
    return robot.joints_of_file or robot.joint_names


def _joint_names(tags: Sequence[str], robot: Robot | None, inference: Inference) -> dict[str, str]:
    """Return {label: joint name} by exact name, by number, or by order.

    A log with more labels than joints that move has those of the robot's file. The columns of
    joints that stand still are dropped.
    """
    if robot is None:
        return {tag: f"joint_{tag}" if _is_number(tag) else tag or "joint" for tag in tags}
    labels = _labels(tags, len(_every_joint(robot)), inference)
    matches = _matches(labels, robot, inference)
    for tag in [x for x in labels if x in tags and x not in matches]:
        inference.note(tag, "no joint of the robot has such a name: excluded")
    still = {tag for tag, joint in matches.items() if joint not in robot.joint_names}
    inference.data = _without_joints(inference, still)
    return {tag: joint for tag, joint in matches.items() if tag in {*tags} - still}


def _without_joints(inference: Inference, labels: Set[str]) -> Block:
    """Return the samples without the columns with some labels of joints."""
    joints = {name: inference.meanings[name].joint for name in inference.data}
    return {name: x for name, x in inference.data.items() if joints[name] not in labels}


def _labels(tags: Sequence[str], count: int, inference: Inference) -> list[str]:
    """Return the labels of all positions, of constant ones too, if they are as many as joints."""
    logged = dict.fromkeys(
        meaning.joint
        for name, meaning in inference.meanings.items()
        if meaning.quantity == "position" and f"{name}[0]" not in inference.meanings
    )
    return list(logged if len(logged) == count and {*tags} <= logged.keys() else tags)


def _matches(labels: Sequence[str], robot: Robot, inference: Inference) -> dict[str, str]:
    """Return {label: joint}: by name and by number, or, if none has these, by order."""
    every = _every_joint(robot)
    matches = {tag: tag for tag in labels if tag in every}
    others = [tag for tag in labels if tag not in matches]
    joints = robot.joint_names if len(others) <= robot.n else every
    matches |= _numbered(others, [joint for joint in joints if joint not in matches])
    # By order only if no name matches, since a mixture of both could exchange joints.
    return matches or _in_order(labels, joints, inference)


def _numbered(tags: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """Return {label: joint} if the labels with numbers, such as j1, have those of the joints."""
    numbers = {number: joint for joint in joints if (number := _number_in(joint))}
    wanted = {tag: number for tag in tags if (number := _number_in(tag))}
    if len(numbers) < len(joints) or not set(wanted.values()) <= set(numbers):
        return {}
    return {tag: numbers[number] for tag, number in wanted.items()}


def _number_in(name: str) -> str:
    """Return the number at the end of a joint's name, an empty text if there is another one."""
    match = re.fullmatch(r"\D*?0*(\d+)(?:_joint)?", name, re.ASCII)
    return match[1] if match else ""


def _by_number(tags: list[str]) -> list[str]:
    """Return labels that differ in a number, as axis_2 and axis_10, in the order of the numbers."""
    stems = {tag.rstrip("0123456789") for tag in tags}
    if len(stems) > 1 or not all(map(_number_in, tags)):
        return tags
    return sorted(tags, key=lambda tag: int(_number_in(tag)))


def _in_order(tags: Sequence[str], joints: Sequence[str], inference: Inference) -> dict[str, str]:
    """Return {label: joint} in the order of the robot: of the labels that are numbers, if any."""
    tags = _by_number(list(filter(_is_number, tags)) or list(tags))
    if len(tags) > len(joints):
        inference.note(
            ", ".join(tags), f"{len(tags)} joints in the log, {len(joints)} in the robot"
        )
    if tags != [""] or len(joints) > 1:
        about = ", ".join(tag or "columns without a joint" for tag in tags[: len(joints)])
        inference.note(about, "taken for the robot's joints in their order")
    if not all(map(_number_in, tags)) and not len(tags) == len(joints) == 1:
        for name, meaning in inference.meanings.items():
            if meaning.joint in tags and _is_sensor(meaning):
                inference.note(name, "its joint is a guess, by the order of the columns")
    return dict(zip(tags, joints, strict=False))
