"""Channels in SI units from the custom columns of a file and its log description.

Each quantity of a joint, and each vector of the base or of a contact, has a source in the
description; those that are not described are read from seaid's own columns. Vectors of other frames
are turned to those of `BaseLog` by the orientation of the base.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from seaid._arrays import Array
from seaid.drives import total_ratio
from seaid.errors import LogError, check_name, listed
from seaid.log.base_log import continuous, matrices, moving_base, needed_columns, with_guided
from seaid.log.channels import (
    CHANNELS,
    OF_BASE,
    OF_CONTACTS,
    OF_JOINTS,
    TEMPERATURES,
    UNIT_FACTORS,
    Quantity,
    column_names,
    refusal,
    short_name,
)
from seaid.log.description import Clock, Key, LogDescription, Servo, Source, unit_size
from seaid.log.log import Log, columns_by_joint, near_names, own_names, sorted_log
from seaid.log.readers.table import Block, Table, check_lengths
from seaid.log.repair import Channel, Repair
from seaid.robot import FloatingBase, Robot, coupled_names


@dataclass(frozen=True)
class Selection:
    """The quantities that a log has of a robot, and their columns in a file.

    Samples at which the column `where` is zero are excluded.
    """

    path: Path
    table: Table
    robot: Robot
    quantities: tuple[_Described, ...]
    where: str | None = None

    @property
    def columns(self) -> list[str]:
        """The columns that are loaded. Raises LogError for a missing one."""
        shared, names = [] if self.where is None else [self.where], dict[str, None]()
        for spec in self.quantities:
            used = [*shared, *spec.source.used, *spec.clock.columns()]
            names |= _checked_columns(spec.where, used, self.table)
        return list(names)

    @property
    def is_own(self) -> bool:
        """Whether all columns have the names of seaid."""
        return all(spec.names == spec.source.columns for spec in self.quantities)

    @property
    def has_one_clock(self) -> bool:
        """Whether all columns are of one file, with the time of seaid's name."""
        clocks = {spec.clock for spec in self.quantities}
        return not self.table.files and clocks == {Clock("time_s")}

    @contextmanager
    def named(self) -> Iterator[None]:
        """Put the file before what is wrong with its log."""
        try:
            yield
        except LogError as problem:
            raise problem.at(f"'{self.path}'") from None

    def channels(self, data: Block) -> list[Channel]:
        """Return the channels of loaded columns, in SI units and with the names of seaid.

        A described deflection is that of the spring, which `both_sides` converts, and vectors of
        other frames have names of their own, which `in_own_frames` converts. Raises LogError naming
        joint and quantity.
        """
        kept = data[self.where] != 0 if self.where else None
        return [
            _selected(spec.where, channel, kept, self.table.sparse)
            for spec in self.quantities
            for channel in spec.channels(data, self.robot)
        ]

    def composed(self, time: Array, picked: Block, report: tuple[Repair, ...] = ()) -> Log:
        """Return the log of channels at the same instants, in quantities and frames of `Log`."""
        deflections = (spec for spec in self.quantities if spec.quantity == "deflection")
        springs = [x.names[0] for x in deflections if x.source != Source(x.names)]
        picked = in_own_frames(both_sides(picked, self.robot, springs), self.robot)
        log = sorted_log({"time_s": time, **picked}, self.robot, self.table.names)
        return replace(log, report=report) if report else log

    def log(self, data: Block) -> Log:
        """Return the log of loaded columns with one clock, which are not repaired."""
        check_lengths(self.path, {name: len(values) for name, values in data.items()})
        channels = self.channels(data)
        with self.named():
            picked = {channel.name: channel.values for channel in channels}
            return self.composed(channels[0].time, picked)


def selected(path: Path, table: Table, description: LogDescription, robot: Robot) -> Selection:
    """Return the quantities of a complete description.

    Raises LogError for a file without any quantity of a joint.
    """
    if not description.joints:
        names = [name for names in columns_by_joint(robot).values() for name in names.values()]
        found = "; ".join(filter(None, [listed(table.names), table.notice]))
        near = near_names(names, (), table.names)
        raise refusal("no_own_column", path=path, name=names[0], columns=found, near=near)
    _check_owners(path, description, robot)
    described = tuple(_quantities(path, table, description, robot))
    where = description.where and table.in_file_of(description.where, described[0].source.used)
    return Selection(path, table, robot, described, where)


def _quantities(
    path: Path, table: Table, description: LogDescription, robot: Robot
) -> Iterator[_Described]:
    """Yield the quantities of a complete description, in its order."""
    rows = _rows_of(robot, description.contacts)
    for key, sources in description.tables.items():
        for quantity, source in sources.items():
            where = f"'{path}': [{'.'.join(key)}] {quantity}"
            clock = _clock_of(where, table, description, source)
            names = _names(where, key, rows[key][quantity], source, robot)
            yield _Described(where, key[-1], quantity, names, source, clock)


def _checked_columns(where: str, names: Sequence[str], table: Table) -> dict[str, None]:
    """Return names as keys. Raises LogError, which begins with `where`, for a missing column."""
    for name in names:
        if name not in table.names:
            raise LogError(f"{where}: {table.missing(name)}")
    return dict.fromkeys(names)


@dataclass(frozen=True)
class _Described:
    """A described quantity of a joint, or a vector of the base or of a contact.

    `where` names it in messages, `names` are those of its channels.
    """

    where: str
    owner: str
    quantity: str
    names: tuple[str, ...]
    source: Source
    clock: Clock

    def channels(self, data: Block, robot: Robot) -> list[Channel]:
        """Return the channels of the columns of a file; a quaternion is without jumps of sign."""
        source = self.source
        try:
            factor, offset = self._factor_and_offset(robot)
            if source.servo:
                logged = _servo_voltage(data, source.servo)[None]
            else:
                logged = np.array([data[name] for name in source.columns])
                logged = logged * _number(data, source.times)
            time = self.clock.seconds(data, logged.shape[1])
        except (LogError, ValueError) as problem:
            text = str(problem)
            text = text if text.startswith(self.where) else f"{self.where}: {text}"
            raise LogError(text) from None
        times = source.times if isinstance(source.times, int | float) else 1.0
        period = None if source.wraps is None else abs(factor * times) * source.wraps
        # x + -0.0 is x bit by bit, also of x = -0.0.
        values = self._as_vector(factor * logged + (offset or -0.0), logged)
        return [
            Channel(name, time, channel, period, source.delay_s)
            for name, channel in zip(self.names, values, strict=True)
        ]

    def _as_vector(self, values: Array, logged: Array) -> Array:
        """Return values (k, T) without jumps of sign of a quaternion, and 0 or 1 of a contact."""
        source = self.source
        if self.quantity == "orientation":
            # Before gaps and other clocks are interpolated: between p and -p an interpolation
            # passes zero.
            return continuous((values[[3, 0, 1, 2]] if source.order == "xyzw" else values).T).T
        if self.quantity == "contact" and source != Source(self.names):  # its own is 0 or 1
            limit = 0.5 if source.above is None else source.above
            is_known = np.isfinite(values) & (logged != source.unknown)
            return np.where(is_known, values > limit, np.nan)
        return values

    def _factor_and_offset(self, robot: Robot) -> tuple[float, float]:
        """Return factor and offset [SI] of the columns."""
        source, factor = self.source, self.source.sign * self.source.scale
        if self.quantity != "motor_temperature":
            return factor * self._unit_factor(robot), source.offset
        # sign scale (degree T + zero) + offset: the zero of the unit is scaled too, the offset is
        # not.
        degree, zero = TEMPERATURES[source.unit or "degC"]
        return factor * degree, source.offset + factor * zero

    def _unit_factor(self, robot: Robot) -> float:
        """Return the factor from the column to the quantity: unit, torque constant, gear."""
        source, factor, quantity = self.source, 1.0, self.quantity
        own_side, _, kind = quantity.partition("_")
        if source.side not in (None, own_side):
            factor, quantity = self._gear_factor(robot), f"{source.side}_{kind}"
        if source.unit is not None and source.torque_constant_Nm_per_A is None:
            unit = _unit_of(robot, self.owner, quantity)
            counts = {"rad": source.counts_per_turn, "m": source.counts_per_m}
            units = [*UNIT_FACTORS[unit], *["counts"] * (counts.get(unit) is not None)]
            check_name("unit of this quantity", source.unit, units, LogError)
        return factor if source.unit is None else factor * unit_size(vars(source))

    def _gear_factor(self, robot: Robot) -> float:
        """Return the factor from the other side of the gear to that of the quantity."""
        side = self.source.side
        _check_own_drive(robot, self.owner, f"its {side} side does not determine the other")
        ratio = total_ratio(robot.drives[self.owner])
        # The motor moves N times as far, and the joint has N times the torque.
        grows = self.quantity in ("motor_position", "joint_torque")  # with the ratio
        return ratio if grows else 1.0 / ratio


def completed(table: Table, description: LogDescription, robot: Robot) -> LogDescription:
    """Return a description with the columns of seaid for what it does not describe."""
    rows, tables = _rows_of(robot, description.contacts), description.tables
    still = {("joints", joint) for joint in robot.standing_joints}
    keys = [key for key in dict.fromkeys([*tables, *rows]) if key not in still]
    complete = {}
    for key in keys:
        sources = tables.get(key, {})
        used = {column for source in sources.values() for column in source.used}
        logged = _own_sources(table, robot, key, rows.get(key, {}), used)
        complete[key] = {**sources, **logged, **sources}
    return description.with_tables(complete)


def _own_sources(
    table: Table, robot: Robot, key: Key, rows: Mapping[str, Quantity], used: Collection[str]
) -> dict[str, Source]:
    """Return the sources of a table by seaid's own names of their columns, which `Log` checks.

    A short name is one of seaid's unless a description uses it.
    """
    sources = dict[str, Source]()
    for name, row in rows.items():
        if key[0] == "joints":
            # The long name first: a file with both has the joint's own under it.
            (long,) = row.columns(key[1], _is_prismatic(robot, key[1]))
            columns = [long] if long in table.names else [*{short_name(long)}.difference(used)]
        else:
            is_own = name != "angle" or moving_base(robot).normal is not None
            columns = [*row.columns(key[-1])] if is_own and name != "acceleration" else []
        if logged := tuple(filter(table.names.__contains__, columns)):
            sources[name] = Source(logged)
    return sources


def _rows_of(robot: Robot, links: Iterable[str] = ()) -> dict[Key, Mapping[str, Quantity]]:
    """Return {table of a description: the quantities that it may have} of a robot.

    Other links than those of contacts may have wrenches.
    """
    rows = dict[Key, Mapping[str, Quantity]]()
    rows |= {("joints", joint): OF_JOINTS for joint in robot.joint_names}
    if not robot.base_is_held:
        rows["base",] = OF_BASE
        links = dict.fromkeys([*links, *moving_base(robot).contact_links])
        rows |= {("contacts", link): OF_CONTACTS for link in links}
    return rows


def of_other_names(description: LogDescription, robot: Robot) -> LogDescription:
    """Return what a description says of columns with other names than seaid's, as `completed` adds.

    Those are read without a description, unless it has another source of the quantity.
    """
    vectors = {key: rows for key, rows in _rows_of(robot).items() if key[0] != "joints"}
    own = own_names(robot).union(
        *(row.columns(key[-1]) for key, rows in vectors.items() for row in rows.values())
    )
    return description.with_tables(
        {
            key: {x: y for x, y in sources.items() if not own.issuperset(y.used)}
            for key, sources in description.tables.items()
        }
    )


def _check_owners(path: Path, description: LogDescription, robot: Robot) -> None:
    """Raise LogError for unknown joints and links, and a base that the robot has not."""
    allowed: dict[str, Collection[str]] = {"joints": robot.joint_names}
    if not robot.base_is_held or description.base or description.contacts:
        allowed["contacts"] = moving_base(robot).frames
    for kind, names in allowed.items():
        for owner in getattr(description, kind):
            check_name(kind[:-1], owner, names, LogError, f"'{path}': [{kind}.{owner}]")


def _names(where: str, key: Key, row: Quantity, source: Source, robot: Robot) -> tuple[str, ...]:
    """Return the names of the channels of a quantity, also of the part that a planar base needs.

    Those of a vector that is to be turned into the frame of `BaseLog`, and of the deflection of a
    spring, have names of their own.
    """
    if key[0] != "joints":
        return _names_of_vector(where, row.columns(key[-1]), row, source, moving_base(robot))
    own = row.columns(key[1], _is_prismatic(robot, key[1]))
    if row.name != "deflection" or source == Source(own):
        return own
    return (f"{key[1]}.deflection_{_unit_of(robot, key[1], row.name)}",)


def _names_of_vector(
    where: str, names: tuple[str, ...], row: Quantity, source: Source, base: FloatingBase
) -> tuple[str, ...]:
    """Return the names of the channels of a vector, whose own columns have `names`."""
    if row.name == "angle" and base.normal is None:
        raise LogError(f"{where}: angle is that of a planar base, and this one is floating")
    if source == Source(source.columns) and {*source.columns} <= {*names}:
        return source.columns
    frame = source.frame or row.frame
    if frame != _FRAMES.get(row.name):
        names = tuple(f"base.{row.name}_in_{frame}_{x}" for x in row.axes)
    is_own = names == CHANNELS.get(row.name)
    needed = needed_columns(base, row.name) if is_own else names
    by_count = {len(needed): needed, len(names): names}
    if len(source.columns) not in by_count:
        raise LogError(f"{where}: needs {len(needed)} columns, has {len(source.columns)}")
    return by_count[len(source.columns)]


_FRAMES = {name: OF_BASE[name].frame for name in CHANNELS}
"""{field of `BaseLog`: the frame of its vector}."""


def _is_prismatic(robot: Robot, joint: str) -> bool:
    return robot.is_prismatic[robot.index(joint)]


def _unit_of(robot: Robot, joint: str, quantity: str) -> str:
    """Return the SI unit of a quantity of a joint; a deflection is that of the spring."""
    drive = robot.drives[joint]
    if quantity == "deflection":
        return drive.spring_units[1] if drive.is_elastic else "rad"
    return OF_JOINTS[quantity].unit_of(_is_prismatic(robot, joint))


def both_sides(picked: Block, robot: Robot, of_springs: Collection[str] = ()) -> Block:
    """Return the samples with deflections converted to the position of a side without encoder.

    The deflection of (7) and (8) is d = r_M/N theta_M - r_L theta_L, at the same instants. With
    both positions it stays, as a motion of the joint, which all are but those `of_springs`. Raises
    LogError for a described deflection of a rigid drive, and for one without a position.
    """
    samples = dict(picked)
    for index, joint in enumerate(robot.joint_names):
        drive, columns = robot.drives[joint], column_names(joint, robot.is_prismatic[index])
        motor, load, own = map(
            columns.__getitem__, ("motor_position", "joint_position", "deflection")
        )
        has_both = {motor, load} <= samples.keys()
        deflection = _of_spring(samples, robot, joint, own, has_both, of_springs)
        behind_gear = drive.motor_radius / drive.ratio
        if deflection is None:
            continue
        if has_both:
            samples[own] = deflection / drive.load_radius
        elif load in samples:
            # d = (r_M / N) theta_M - r_L theta_L, solved for theta_M, and below for theta_L.
            samples[motor] = (deflection + drive.load_radius * samples[load]) / behind_gear
        elif motor in samples:
            samples[load] = (behind_gear * samples[motor] - deflection) / drive.load_radius
        else:
            raise refusal("deflection_alone", joint=joint)
    return samples


def _of_spring(
    samples: Block, robot: Robot, joint: str, own: str, has_both: bool, of_springs: Collection[str]
) -> Array | None:
    """Return the deflection of a spring that is to be converted, which is taken out of the samples.

    One that is the joint's already stays next to both positions, and without a spring.
    """
    drive = robot.drives[joint]
    if name := next((x for x in of_springs if x.startswith(f"{joint}.deflection_")), ""):
        if not drive.is_elastic:
            raise LogError(f"joint '{joint}' has a stiff drive, which has no deflection")
    elif has_both or own not in samples or not drive.is_elastic:
        return None
    _check_own_drive(robot, joint, "a deflection does not determine its position")
    return samples.pop(name) if name else drive.load_radius * samples.pop(own)


def _check_own_drive(robot: Robot, joint: str, consequence: str) -> None:
    """Raise LogError for a joint whose drive is coupled with other joints."""
    is_coupled = joint in coupled_names(robot.joint_names, robot.transmission)
    if is_coupled or robot.drives[joint].angle_ratio is not None:
        raise refusal("coupled_drive", joint=joint, consequence=consequence)


def _clock_of(where: str, table: Table, description: LogDescription, source: Source) -> Clock:
    columns = source.used
    times = [table.clocks[column] for column in columns if column in table.clocks]
    times.append(table.in_file_of("time_s", columns))
    of_file = next((Clock(column) for column in times if column in table.names), None)
    clock = source.time or description.time or of_file
    if clock is None:
        _checked_columns(where, columns, table)
        raise refusal("no_time", where=where, missing=table.missing("time_s"))
    if clock.column is None:
        return clock
    rest = clock.nanoseconds and table.in_file_of(clock.nanoseconds, columns)
    return replace(clock, column=table.in_file_of(clock.column, columns), nanoseconds=rest)


def _servo_voltage(data: Block, servo: Servo) -> Array:
    """Return the voltage [V] of a position servo, see `Servo`.

    A goal holds until the next one, so at a sample the voltage is the mean of those before and
    after the step of the goal.
    """
    goal, gain = data[servo.goal], servo.gain_factor * _number(data, servo.gain)
    goals = np.array([np.append(goal[:1], goal[:-1]), goal])  # before and after each step
    duties = np.clip(gain * (goals - data[servo.position]), -servo.limit, servo.limit)
    return np.asarray(0.5 * (duties[0] + duties[1]) * _number(data, servo.supply))


def _number(data: Block, value: str | float | None) -> Array | float:
    """Return a column, or the number itself; None is 1."""
    return data[value] if isinstance(value, str) else 1.0 if value is None else float(value)


def _selected(where: str, channel: Channel, kept: Array | None, sparse: bool) -> Channel:
    """Return a channel without samples that are excluded, or missing in a message."""
    use = np.ones(len(channel.time), dtype=bool)
    if kept is not None:
        if len(kept) != len(use):
            raise LogError(f"{where}: has {len(use)} samples, the column of 'where' {len(kept)}")
        use &= kept.astype(bool)
        if not np.any(use):
            raise LogError(f"{where}: the column of 'where' is zero at all samples")
    if sparse and not np.all(np.isnan(channel.values)):
        # A message may lack what another sender of its topic has, so that NaN is no fault in a bag.
        use &= ~np.isnan(channel.values)
    return replace(channel, time=channel.time[use], values=channel.values[use])


_TURNED = re.compile(r"base\..*_in_")
"""The name of a channel of a vector in another frame than that of `BaseLog`."""


def in_own_frames(picked: Mapping[str, Array], robot: Robot) -> dict[str, Array]:
    """Return the samples with vectors of other frames turned to those of `BaseLog`.

    f = R^T (a - g) with R from the base to the world. Raises LogError without an orientation.
    """
    samples = with_guided(picked, robot)
    turned = [name for name in picked if _TURNED.match(name)]
    if not turned:
        return samples
    _check_turnable(turned, picked, robot)
    quaternions = np.column_stack([picked[name] for name in CHANNELS["orientation"]])
    R = matrices(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))
    for stem in dict.fromkeys(name[:-2] for name in turned):
        values = np.column_stack([samples.pop(f"{stem}_{x}") for x in "xyz"])
        quantity, frame = stem.removeprefix("base.").rsplit("_in_", 1)
        channel = "specific_force" if quantity == "acceleration" else quantity
        # What was logged in its own frame has precedence over what was turned to it.
        if CHANNELS[channel][0] not in samples:
            values = _in_own_frame(quantity, frame, values, R, robot)
            samples.update(zip(CHANNELS[channel], values.T, strict=True))
    return samples


def _in_own_frame(quantity: str, frame: str, values: Array, R: Array, robot: Robot) -> Array:
    """Return a vector (T, 3) in the frame of `BaseLog`; R (T, 3, 3) turns the base to the world."""
    base, gravity = moving_base(robot), robot.model.gravity.linear
    if quantity == "velocity":
        return np.asarray(np.einsum("tij,tj->ti", R, values))
    # f = R^T (a - g) = R^T a - R^T g: `tji` transposes R, and gravity as a row times R is R^T g.
    turned = np.einsum("tji,tj->ti", R, values) if frame == "world" else values
    down = gravity @ R if quantity == "acceleration" else 0.0
    # `@ imu` is imu^T, into the axes of the IMU.
    return np.asarray((turned - down) @ base.imu_placement[0])


def _check_turnable(turned: Sequence[str], picked: Mapping[str, Array], robot: Robot) -> None:
    """Raise LogError if vectors of other frames lack an orientation, or their IMU moves."""
    base = moving_base(robot)
    if not set(CHANNELS["orientation"]) <= set(picked):
        kind = turned[0].removeprefix("base.").rsplit("_in_", 1)
        raise refusal("no_orientation", quantity=kind[0], frame=kind[1][:-2])
    if not base.imu_is_fixed and any("velocity_in_base" not in name for name in turned):
        raise refusal("imu_moves", link=base.imu_link)
