"""Log descriptions: the meaning of custom columns as plain data or TOML, checked on reading.

What a log was read by is what a remedy changes: a `LogChannel` has its entry in the description,
`changed_source` and `moved_zeros` write entries anew.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from seaid._arrays import Array, FrozenMapping, is_constant
from seaid._files import MOST_TOML_BYTES, from_template, read_toml, toml_key, toml_text
from seaid._progress import MOST_NAMES, Display, counted
from seaid.drives import total_ratio
from seaid.errors import LogError, listed, shortened, shown, unknown_name
from seaid.log.channels import (
    OF_BASE,
    OF_CONTACTS,
    OF_JOINTS,
    UNIT_FACTORS,
    Frame,
    Quantity,
    refusal,
    units_of,
)
from seaid.log.readers.table import MOST_COLUMNS, Block
from seaid.log.repair import Repairs
from seaid.log.tables import Interval, Reader, Within, types_of

if TYPE_CHECKING:
    from seaid.log.log import Log
    from seaid.log.motion import Motion
    from seaid.robot import Robot

_LEAST, _MOST = 1e-30, 1e30
"""Least divisor and largest magnitude, so that products and quotients stay finite."""

_NUMBER = f"a finite number (at most {_MOST:g} in size)"
Number = Annotated[float, Within(_NUMBER, lambda x: abs(x) <= _MOST)]
Factor = Annotated[float, Within(f"{_NUMBER} that is not zero", lambda x: x and abs(x) <= _MOST)]
Divisor = Annotated[
    float, Within(f"a number above zero ({_LEAST:g} to {_MOST:g})", lambda x: _LEAST <= x <= _MOST)
]
ColumnName = Annotated[str, Within("the name of a column", lambda name: True, whole=True)]
FileName = Annotated[str, Within("the name of a file", lambda name: name != "")]


@dataclass(frozen=True)
class Clock:
    """The time of samples: a column and its unit (s, ms, us, ns), or a constant rate [Hz].

    `nanoseconds` is a second column, of what is added to whole seconds.
    """

    column: ColumnName | None = None
    unit: Annotated[str, Within("s, ms, us or ns", UNIT_FACTORS["s"].__contains__)] = "s"
    rate_hz: Divisor | None = None
    nanoseconds: ColumnName | None = None

    def __post_init__(self) -> None:
        if (self.column is None) == (self.rate_hz is None):
            raise LogError("a time needs either column or rate_hz")
        if self.nanoseconds is not None and (self.column is None or self.unit != "s"):
            raise LogError("nanoseconds are added to a column of seconds")

    def columns(self) -> list[str]:
        """Return the columns of the time."""
        return [column for column in (self.column, self.nanoseconds) if column is not None]

    def seconds(self, data: Block, count: int) -> Array:
        """Return the stamps [s] of `count` samples."""
        if self.column is None:
            return np.arange(count) / float(self.rate_hz or 1.0)
        time = data[self.column] * UNIT_FACTORS["s"][self.unit]
        return time if self.nanoseconds is None else time + 1e-9 * data[self.nanoseconds]


@dataclass(frozen=True)
class Servo:
    """A proportional position servo: voltage = clip(g (goal - position), -limit, limit) supply.

    `goal` and `position` are columns in the same unit; a goal holds until the next sample.
    g = `gain` times `gain_factor` is a duty cycle per unit; `gain` and `supply` [V] are columns or
    numbers.
    """

    goal: ColumnName
    position: ColumnName
    gain: Number | ColumnName
    supply: Number | ColumnName
    gain_factor: Number = 1.0
    limit: Number = 1.0

    def columns(self) -> list[str]:
        """Return the columns that the servo uses."""
        used = (self.goal, self.position, self.gain, self.supply)
        return [column for column in used if isinstance(column, str)]


Side = Literal["motor", "joint"]
Order = Literal["wxyz", "xyzw"]

_PLANAR = ("position", "velocity", "angular_velocity", "specific_force")
"""Vectors of which a planar base needs a part only."""

_SLICE = re.compile(r"(.*)\[(\d+):(\d+)\]")


@dataclass(frozen=True)
class Source:
    """The source of a quantity: value = sign scale (unit in SI) times column + offset.

    That of a vector of the base or of a contact is scale times its columns.

    Attributes
    ----------
    columns : tuple of str
        The column, in a file without header its number from 1 on, or those of a vector.
    unit : str or None
        Unit of the column; None: SI, "counts" with `counts_per_turn` or `counts_per_m`, "A" or "mA"
        for a torque with `torque_constant_Nm_per_A`.
    sign, scale, offset : int, float, float
        1 or -1, a factor, and an offset in SI units.
    wraps : float or None
        Period of an encoder that wraps around, in the unit of the column.
    times : str, float or None
        A column or number to multiply with, as the supply voltage of a duty cycle.
    side : str or None
        "motor" or "joint", if the column holds the value at the other side of the gear.
    frame : {"base", "world"} or None
        Of a velocity, an angular velocity or an acceleration (without gravity); None: velocity and
        acceleration in the world, angular velocity in the base.
    order : {"wxyz", "xyzw"} or None
        Of the columns of an orientation, None: wxyz.
    above : float or None
        Value of a contact, such as a force, above which it touches the ground; None: 0.5.
    unknown : float or None
        Value in the columns of a contact that is no measurement, such as a code for "unknown".
    delay_s : float
        Delay of the columns [s]: their samples show the state `delay_s` before their time.
    time : Clock or None
        Clock of the columns, if they have their own.
    servo : Servo or None
        Model of a voltage that is not logged, in place of a column.
    """

    columns: tuple[str, ...] = ()
    unit: str | None = None
    sign: Annotated[int, Within("1 or -1", lambda x: x in (1, -1))] = 1
    frame: Frame | None = None
    order: Order | None = None
    scale: Factor = 1.0
    offset: Number = 0.0
    wraps: Divisor | None = None
    counts_per_turn: Divisor | None = None
    counts_per_m: Divisor | None = None
    torque_constant_Nm_per_A: Divisor | None = None
    times: Number | ColumnName | None = None
    side: Side | None = None
    above: Number | None = None
    unknown: Number | None = None
    delay_s: Number = 0.0
    time: Clock | None = None
    servo: Servo | None = None

    @property
    def column(self) -> str:
        """The column, the first one of a vector, an empty text for a servo."""
        return self.columns[0] if self.columns else ""

    @property
    def used(self) -> list[str]:
        """The columns that the source uses, except that of its clock."""
        times = [self.times] if isinstance(self.times, str) else []
        return [*self.columns, *times, *(self.servo.columns() if self.servo else [])]

    def plain(self, key: str = "column") -> Any:
        """Return the source as TOML has it, without default values, with its columns as `key`."""
        table = _changed(self)
        if table.pop("columns", ()):
            table = {key: _in_short(self.columns), **table}
        return _short(table, key)


def _in_short(columns: Sequence[str]) -> Any:
    """Return columns as a slice of an array if they are one, a name if there is only one."""
    parts = [*filter(None, (re.fullmatch(r"(.*)\[(\d+)\]", column) for column in columns))]
    if len(columns) > 1 and len(parts) == len(columns):
        first, stems = int(parts[0][2]), {part[1] for part in parts}
        if len(stems) == 1 and [int(part[2]) - first for part in parts] == [*range(len(parts))]:
            return f"{stems.pop()}[{first}:{first + len(parts)}]"
    return columns[0] if len(columns) == 1 else list(columns)


Sources = Mapping[str, Source]
"""{quantity of a joint, of the base or of a contact: its source}."""

Key = tuple[str, ...]
"""The keys of a table of a description: ("joints", joint), ("base",) or ("contacts", link)."""

Tables = dict[Key, Sources]
"""{keys of a table of a description: its sources}."""


@dataclass(frozen=True, eq=False, repr=False)
class LogDescription(Display):
    """The meaning of the columns of a log, for `read_log`.

    Quantities, joints and a time that are not described are read from seaid's own columns, if the
    file has them.

    Attributes
    ----------
    joints : mapping
        {joint: {quantity: Source}}, with the quantities motor_position, joint_position,
        motor_torque, joint_torque, motor_current, motor_voltage, deflection, motor_temperature,
        position_command, velocity_command, torque_command and supply_voltage.
    time : Clock or None
        Clock of all sources without their own; None: that of the file (ROS bags and HEBI logs), or
        its column "time_s".
    where : str or None
        A column; samples at which it is zero are excluded.
    exclude_s : tuple of (float, float)
        Intervals [start, end) of the log's time [s] that are excluded.
    repair : Repairs
        Limits of the repair.
    base : mapping {quantity: Source}
        Of a floating base: position, orientation, velocity, angular_velocity, acceleration (without
        gravity) and specific_force (with it); of a planar one angle, too.
    contacts : mapping {link: mapping {quantity: Source}}
        Of its contacts: contact, force and moment.
    files : tuple of str
        The files of the log, if it has several, in the folder of the description or of the first.

    Examples
    --------
    >>> from seaid.log.description import Clock, Source
    >>> source = Source(("pos_2",), unit="deg")
    >>> description = seaid.log.LogDescription({"elbow": {"joint_position": source}}, Clock("t"))
    >>> print(description.to_toml())
    """

    joints: Mapping[str, Mapping[str, Source]] = field(default_factory=dict)
    time: Clock | None = None
    where: ColumnName | None = None
    exclude_s: tuple[Interval, ...] = ()
    repair: Repairs = field(default_factory=Repairs)
    base: Mapping[str, Source] = field(default_factory=dict)
    contacts: Mapping[str, Mapping[str, Source]] = field(default_factory=dict)
    files: tuple[FileName, ...] = ()

    def _in_short(self) -> str:
        columns = counted(sum(map(len, self.joints.values())), "column")
        return f"joints {listed(self.joints, MOST_NAMES)}: {columns}"

    def __post_init__(self) -> None:
        for name in ("joints", "contacts"):
            tables = {owner: FrozenMapping(x) for owner, x in getattr(self, name).items()}
            object.__setattr__(self, name, FrozenMapping(tables))
        object.__setattr__(self, "base", FrozenMapping(self.base))

    @property
    def tables(self) -> Tables:
        """The sources of each table: of ("joints", joint), ("base",) and ("contacts", link)."""
        tables: Tables = {("joints", joint): sources for joint, sources in self.joints.items()}
        tables |= {("base",): self.base} if self.base else {}
        return tables | {("contacts", link): sources for link, sources in self.contacts.items()}

    def with_tables(self, tables: Mapping[Key, Sources]) -> LogDescription:
        """Return the description with the tables that have sources in place of its own."""

        def of(kind: str) -> dict[str, Sources]:
            return {key[-1]: table for key, table in tables.items() if key[0] == kind and table}

        base = of("base").get("base", {})
        return replace(self, joints=of("joints"), base=base, contacts=of("contacts"))

    def columns(self) -> set[str]:
        """Return the columns that the description uses, those of clocks too."""
        sources = [*chain.from_iterable(table.values() for table in self.tables.values())]
        clocks = filter(None, [self.time, *(source.time for source in sources)])
        columns = [x.used for x in sources] + [x.columns() for x in clocks]
        return set(() if self.where is None else [self.where]).union(*columns)

    def to_dict(self) -> dict[str, Any]:
        """Return the description as mappings of plain data without default values."""
        values = {name: _plain(getattr(self, name)) for name in ("files", *types_of(type(self)))}
        feet = {link: _vectors(foot) for link, foot in self.contacts.items()}
        values |= {"base": _vectors(self.base), "contacts": feet}
        return {key: x for key, x in values.items() if x not in (None, [], {}) or key == "joints"}

    def to_toml(self) -> str:
        """Return the description as the text of a TOML file."""
        filters = {"toml": as_toml, "key": toml_key}
        text = from_template("seaid.log", "description.toml.j2", filters, content=self.to_dict())
        return text.lstrip("\n")


def _vectors(sources: Mapping[str, Source]) -> dict[str, Any]:
    """Return a table of vectors as plain data, with their clock, which is that of the table."""
    clock = next((source.time for source in sources.values() if source.time), None)
    table = {name: replace(x, time=None).plain("columns") for name, x in sources.items()}
    return table if clock is None else {"time": _plain(clock), **table}


def _plain(value: Any) -> Any:
    """Return a value as plain data; a dataclass is a mapping without default values, or short."""
    if isinstance(value, Source):
        return value.plain()
    if is_dataclass(value):
        return _short(_changed(value))
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    return [*map(_plain, value)] if isinstance(value, tuple) else value


def _changed(instance: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that differ from their defaults, as plain data."""
    values = ((each, getattr(instance, each.name)) for each in fields(instance))
    return {each.name: _plain(value) for each, value in values if value != each.default}


def _short(table: dict[str, Any], key: str = "column") -> Any:
    """Return the column, or columns, for a table with nothing else, else the table."""
    return table[key] if list(table) == [key] else table


def changed_source(
    source: str | Mapping[str, Any],
    *,
    factor: float = 1.0,
    offset: float = 0.0,
    delay_s: float = 0.0,
    wraps: float | None = None,
) -> dict[str, Any]:
    """Return the source whose values become factor * value + offset, `delay_s` earlier.

    What the source has already is multiplied or added, so that the new one replaces it. Its values
    wrap around every `wraps`, in SI units; the source has it in the unit of the column.
    """
    table: dict[str, Any] = {"column": source} if isinstance(source, str) else dict(source)
    if factor < 0:
        table["sign"] = -table.get("sign", 1)
    if abs(factor) != 1:
        table["scale"] = _rounded(abs(factor) * table.get("scale", 1.0))
    old = table.get("offset", 0.0)
    # factor (sign scale x + old) + offset: the old offset takes the factor too.
    if factor * old + offset != old:
        table["offset"] = _rounded(factor * old + offset)
    if delay_s:
        table["delay_s"] = _rounded(table.get("delay_s", 0.0) + delay_s)
    if wraps is not None:
        size = table.get("times", 1.0) * table.get("scale", 1.0) * unit_size(table)
        table["wraps"] = _rounded(wraps / size)
    return table


def unit_size(table: Mapping[str, Any]) -> float:
    """Return the unit of the column of a source in SI units, without the ratio of a gear."""
    if per_turn := table.get("counts_per_turn"):
        return 2 * math.pi / float(per_turn)
    if per_m := table.get("counts_per_m"):
        return 1 / float(per_m)
    sizes = {unit: size for units in UNIT_FACTORS.values() for unit, size in units.items()}
    # A torque from a current has the unit of the current, and N m per A.
    size = sizes.get(str(table.get("unit")), 1.0)
    return float(size * (table.get("torque_constant_Nm_per_A") or 1.0))


def _rounded(value: float) -> float | int:
    """Return a number with ten digits, an integer if it is one."""
    rounded = float(f"{value:.10g}")
    return int(rounded) if rounded.is_integer() else rounded


def as_toml(value: Any) -> str:
    """Return a value of a description as the text after `key =`."""
    if isinstance(value, Mapping):
        pairs = [f"{toml_key(key)} = {as_toml(entry)}" for key, entry in value.items()]
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_toml, value))}]"
    return toml_text(value)


Described = LogDescription | Mapping[str, Any] | str | Path
"""A log description, the same as plain data, or its TOML file."""


def description_for(path: Path, description: Described | None) -> LogDescription | None:
    """Return the description given for a log, or in the TOML file next to it, or None."""
    description = description.to_dict() if isinstance(description, LogDescription) else description
    if isinstance(description, Mapping):
        return _described("description=", description)
    if description is None:
        return _described_next_to(path)
    try:
        return _described(f"'{description}'", read_toml(description, "the description", LogError))
    except LogError as problem:
        raise problem.at("description=", "description=") from None


def _described_next_to(path: Path) -> LogDescription | None:
    """Return the description in the TOML file of a log's name; None if it is something else."""
    sibling = path.with_suffix(".toml") if path.name else path  # no name: '.' or '/'
    if sibling == path or not os.path.isfile(sibling):  # False also for invalid file names
        return None
    try:
        content = read_toml(sibling, "the description", LogError)
    except LogError:
        if _names_joints(sibling):
            raise
        return None
    return _described(f"'{sibling}'", content) if _is_description(content) else None


def _is_description(content: Mapping[str, Any]) -> bool:
    """Return whether a valid TOML file is meant as a description, and not as drives."""
    joints = content.get("joints", {})
    if not isinstance(joints, Mapping) or "type" in joints:
        return False
    return bool(joints or (content and set(content) <= {*_TOP_LEVEL}))


def _names_joints(path: Path) -> bool:
    """Return whether an invalid TOML file was meant as a description."""
    try:
        with path.open("rb") as file:
            return b"[joints" in file.read(MOST_TOML_BYTES)
    except OSError:
        return True


_ROWS = {"joints": OF_JOINTS, "base": OF_BASE, "contacts": OF_CONTACTS}
"""{kind of a table of a description: its quantities}."""

_TOP_LEVEL = types_of(LogDescription) | dict.fromkeys(_ROWS, Mapping[str, Any])
"""{key: type} of a description; what its tables have depends on the quantities."""

_READER = Reader(LogError, short={Clock: "column"})


def _described(where: str, content: Mapping[str, Any]) -> LogDescription:
    values = _READER.table(_TOP_LEVEL, content, where)
    tables: dict[Key, Any] = {("base",): values.pop("base", {})}
    for kind in ("joints", "contacts"):
        tables |= {(kind, owner): table for owner, table in values.pop(kind, {}).items()}
    read = {
        key: _sources(f"{where} [{'.'.join(map(shortened, key))}]", table, _ROWS[key[0]])
        for key, table in tables.items()
    }
    _check_columns(where, {key[1]: sources for key, sources in read.items() if key[0] == "joints"})
    return LogDescription(**values).with_tables(read)


def _check_columns(where: str, joints: Mapping[str, Sources]) -> None:
    """Raise LogError for a column that is named for two quantities of joints.

    Joints may share a column of one quantity, as a supply, or the encoder of coupled joints.
    """
    uses: dict[str, tuple[str, str]] = {}
    for joint, sources in joints.items():
        for quantity, source in sources.items():
            use = f"[joints.{shortened(joint)}] {quantity}"
            before, first = uses.setdefault(source.column, (quantity, use))
            if source.columns and before != quantity:  # a servo has no column of its own
                names = {"column": shortened(source.column), "first": first, "second": use}
                raise refusal("two_quantities", where=where, **names)


_LONG_NAMES = {row.short_name: name for name, row in OF_JOINTS.items() if row.short_name}


def _check_joint(where: str, table: Any) -> None:
    """Raise LogError for a joint without a quantity, with short names, and with velocities."""
    for key in table if isinstance(table, Mapping) else ():
        if key in _LONG_NAMES:
            raise LogError(f"{where}: '{key}' is named '{_LONG_NAMES[key]}' in a description")
        if "velocity" in str(key) and key not in OF_JOINTS:
            name = unknown_name("key", key, OF_JOINTS)
            raise LogError(f"{where}: {name}; velocities are differentiated from positions")
    if isinstance(table, Mapping) and not table.keys() - {"time"}:
        raise LogError(f"{where}: names no quantity; allowed: {', '.join(OF_JOINTS)}")


def _sources(where: str, table: Any, rows: Mapping[str, Quantity]) -> dict[str, Source]:
    """Return the sources of a table by quantity, with the clock that they share."""
    if rows is OF_JOINTS:
        _check_joint(where, table)
    values = _READER.table({"time": Clock | None, **dict.fromkeys(rows, Any)}, table, where)
    clock = values.pop("time", None)
    sources = {x: _source(f"{where} {x}", rows[x], value) for x, value in values.items()}
    return {name: replace(x, time=x.time or clock) for name, x in sources.items()}


_KEYS = {"column": Any} | types_of(Source) | {"columns": Any}
"""{key: type} of all sources."""

_VECTORS = OF_BASE | OF_CONTACTS

_QUANTITIES: dict[str, Collection[str]] = {
    **dict.fromkeys(("scale", "delay_s"), OF_JOINTS | _VECTORS),
    "columns": _VECTORS,
    "frame": [name for name, row in OF_BASE.items() if row.frame],
    **{"order": ("orientation",), "above": ("contact",), "unknown": ("contact",)},
    "side": [x for x, row in OF_JOINTS.items() if row.is_position or x.endswith("_torque")],
    "servo": ("motor_voltage",),
}
"""{key: the quantities whose sources have it}, of keys that those of joints do not all have."""


def _source(where: str, row: Quantity, value: Any) -> Source:
    """Return the source of a quantity of a joint, or of a vector of the base or of a contact."""
    if isinstance(value, Source):
        return value
    keys = {x: kind for x, kind in _KEYS.items() if row.name in _QUANTITIES.get(x, OF_JOINTS)}
    key = "column" if row.name in OF_JOINTS else "columns"
    values = _READER.table(keys, value if isinstance(value, Mapping) else {key: value}, where)
    source = Source(_expanded(f"{where}: '{key}'", values.pop(key, ())), **values)
    _check_source(where, row, source)
    return source


def _expanded(where: str, value: Any) -> tuple[str, ...]:
    """Return the names of columns: 'q[3:7]' stands for four, and a number for itself."""
    columns: list[str] = []
    for entry in value if isinstance(value, list | tuple) else [value]:
        if type(entry) is not int and not isinstance(entry, str):
            raise LogError(f"{where} must be the name of a column, found {shown(entry)}")
        if part := _SLICE.fullmatch(str(entry)):
            places = range(int(part[2]), min(int(part[3]), MOST_COLUMNS))
            columns += [f"{part[1]}[{place}]" for place in places]
        else:
            columns.append(str(entry))
    return tuple(columns)


def _check_source(where: str, row: Quantity, source: Source) -> None:
    """Raise LogError for keys that do not fit together or do not fit the quantity."""
    unit, units = source.unit, sorted(units_of(row.kind))
    counts = (source.counts_per_turn, source.counts_per_m)
    is_current = row.kind == "torque" and unit in UNIT_FACTORS["A"]
    count, is_whole = len(source.columns), row.name not in _PLANAR
    faults = {
        "column_or_servo": bool(count) == bool(source.servo),
        # How many of them a planar base needs is known with the robot, see `sources`.
        "other_count": count > row.width or 0 < count * is_whole < row.width,
        "no_unit": unit not in (None, *units),
        "counts": (unit == "counts") != (counts.count(None) == 1),
        "torque_constant": is_current != (source.torque_constant_Nm_per_A is not None),
        "no_period": source.wraps is not None and isinstance(source.times, str),
    }
    for code in (code for code, is_there in faults.items() if is_there):
        unknown = unknown_name("unit of this quantity", unit, units)
        values = {"columns": counted(count, "column"), "width": row.width, "unknown": unknown}
        raise refusal(code, where=where, **values)


Entry = str | Mapping[str, Any]
"""How a quantity was read, as plain data: its column, or its entry in the description of a log."""

Entries = Mapping[str, Mapping[str, Entry]]
"""{joint: {quantity: its entry}}."""


@dataclass(frozen=True, eq=False)
class LogChannel:
    """The samples (T,) of a quantity of a joint, and the `source` in which the log has them."""

    joint: str
    quantity: str
    values: Array
    source: Entry | None

    @property
    def words(self) -> str:
        """The quantity in words."""
        return self.quantity.replace("_", " ")

    @property
    def entry(self) -> Mapping[str, Any]:
        """The entry of the description, empty for a column alone."""
        return self.source if isinstance(self.source, Mapping) else {}

    def changed(self, **changes: float) -> Entry:
        """Return the source with the changes of `changed_source`."""
        return changed_source(self.source or "", **changes)

    @property
    def scale(self) -> float:
        """The factor on the column."""
        return float(self.entry.get("scale", 1.0))

    @property
    def largest(self) -> float:
        """The largest size of a sample."""
        return float(np.max(np.abs(self.values)))


def channels_of(log: Log, joints: Collection[str], *quantities: str) -> Iterator[LogChannel]:
    """Yield the channels of joints whose samples are all known, and change."""
    sources = log.sources()
    for quantity in (name for name in quantities if getattr(log, name) is not None):
        for joint, values in zip(log.joint_names, getattr(log, quantity).T, strict=True):
            if joint in joints and np.all(np.isfinite(values)) and not is_constant(values):
                yield LogChannel(joint, quantity, values, sources[joint].get(quantity))


def sources_of(motions: Sequence[Motion]) -> Entries:
    """Return the sources of the channels of a log {joint: {quantity: source}}."""
    processing = motions[0].processing
    return {} if processing is None else processing.sources or {}


def moved_zeros(
    robot: Robot, angles: Mapping[str, float], sources: Entries, reverses: Collection[str] = ()
) -> Entries:
    """Return the `sources` that change if angles are added to the zeros of joints.

    The zeros of the motors that turn these joints, and commands, move along; the positions and
    commands of joints that are `reverses` change their sign.
    """
    added = [angles.get(joint, 0.0) for joint in robot.joint_names]
    # theta_M = N r_L / r_M phi, phi = C q: the zero of a joint moves all motors that turn it.
    turned = robot.transmission @ added * [total_ratio(drive) for drive in robot.drives.values()]
    entries: dict[str, dict[str, Entry]] = {}
    for joint, angle, of_motor in zip(robot.joint_names, added, turned.tolist(), strict=True):
        factor = -1.0 if joint in reverses else 1.0
        offsets = dict.fromkeys(("joint_position", "position_command"), angle)
        offsets |= {"motor_position": of_motor, "velocity_command": 0.0, "torque_command": 0.0}
        for quantity, offset in offsets.items():
            source = sources.get(joint, {}).get(quantity)
            if source and (offset or factor < 0):
                changed = changed_source(source, factor=factor, offset=round(offset, 5))
                entries.setdefault(joint, {})[quantity] = changed
    return entries


def changed_sources(changes: Mapping[LogChannel, Mapping[str, float]]) -> Entries:
    """Return {joint: {quantity: source}} of channels with their changes."""
    sources = dict[str, dict[str, Entry]]()
    for channel, change in changes.items():
        sources.setdefault(channel.joint, {})[channel.quantity] = channel.changed(**change)
    return sources


@dataclass(frozen=True, eq=False)
class Logged:
    """The logs of a robot, and its joints whose torques are used."""

    robot: Robot
    logs: Sequence[Log]
    used: Collection[str]

    @property
    def named(self) -> list[tuple[str, Log]]:
        """Each log with its name, "log 2", "the log" for a single one."""
        if len(self.logs) == 1:
            return [("the log", self.logs[0])]
        return [(f"log {number}", log) for number, log in enumerate(self.logs, 1)]
