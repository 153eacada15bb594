"""Channels in SI units from the custom columns of a file and its log description."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seaid._arrays import Array
from seaid.drives import total_ratio
from seaid.errors import LogError, listed, unknown_name
from seaid.log.base_columns import VectorSource, described_vectors, vector_channels
from seaid.log.description import Clock, LogDescription, Servo, Source
from seaid.log.log import (
    TEMPERATURES,
    UNIT_FACTORS,
    column_name,
    column_names,
    short_name,
    unit_of_column,
)
from seaid.log.readers.table import Block, Table
from seaid.log.repair import Channel
from seaid.robot import Robot, coupled_names


def channels_of(
    path: Path, table: Table, description: LogDescription, robot: Robot
) -> list[Channel]:
    """Return the channels of a file by a complete description, with seaid's names, in SI units.

    A deflection is the channel "<joint>.deflection_rad" or "_m", which `both_sides` converts.
    Raises LogError naming joint and quantity.
    """
    described = list(_described_quantities(path, table, description))
    if not described:
        raise LogError(
            f"'{path}' has no column with a name of seaid's for a joint of this robot, and the "
            f"description names none, found: {listed(table.names)}"
        )
    vectors = list(
        described_vectors(f"'{path}'", description.base, description.contacts, table, robot)
    )
    where = description.where and table.in_file_of(description.where, described[0].source.columns())
    shared = [] if where is None else [where]
    wanted = dict[str, None]()
    for spec in described:
        names = [*shared, *spec.source.columns(), *spec.clock.columns()]
        wanted |= _checked_columns(spec.where, names, table)
    clocks = [_clock_of(vector.where, table, description, vector.source) for vector in vectors]
    for vector, clock in zip(vectors, clocks, strict=True):
        names = [*vector.source.columns, *clock.columns()]
        wanted |= _checked_columns(vector.where, names, table)
    data = table.load(list(wanted))
    kept = data[where] != 0 if where else None
    channels = [(spec.where, _channel(data, robot, spec)) for spec in described]
    for vector, clock in zip(vectors, clocks, strict=True):
        time = clock.seconds(data, len(data[vector.source.columns[0]]))
        channels += [(vector.where, channel) for channel in vector_channels(vector, data, time)]
    return [_selected(place, channel, kept, table.sparse) for place, channel in channels]


def _checked_columns(where: str, names: Sequence[str], table: Table) -> dict[str, None]:
    """Return names as keys. Raises LogError, which begins with `where`, for a missing column."""
    for name in names:
        if name not in table.names:
            raise LogError(f"{where}: {table.missing(name)}")
    return dict.fromkeys(names)


class _Described(NamedTuple):
    """A described quantity of a joint; `where` names it in messages."""

    where: str
    joint: str
    quantity: str
    source: Source
    clock: Clock


def completed(table: Table, description: LogDescription, robot: Robot) -> LogDescription:
    """Return a description with the columns of seaid for what it does not describe of joints."""
    described = [joint for joint in description.joints if joint not in robot.standing_joints]
    for joint in described:
        if joint not in robot.joint_names:
            raise LogError("description: " + unknown_name("joint", joint, robot.joint_names))
    joints = {}
    for joint in dict.fromkeys([*described, *robot.joint_names]):
        sources = dict(description.joints.get(joint, {}))
        joints[joint] = sources | _sources_by_name(table, robot, joint, sources)
    return replace(description, joints={joint: entry for joint, entry in joints.items() if entry})


def _described_quantities(
    path: Path, table: Table, description: LogDescription
) -> Iterator[_Described]:
    for joint, sources in description.joints.items():
        for quantity, source in sources.items():
            where = f"'{path}': [joints.{joint}] {quantity}"
            clock = _clock_of(where, table, description, source)
            yield _Described(where, joint, quantity, source, clock)


def _sources_by_name(
    table: Table, robot: Robot, joint: str, described: Mapping[str, Source]
) -> dict[str, Source]:
    """Return the columns with seaid's names for the quantities that are not described."""
    names = column_names(joint, robot.is_prismatic[robot.index(joint)])
    used = {column for source in described.values() for column in source.columns()}
    logged = {
        field: Source(column)
        for name, field in names.items()
        for column in (short_name(name), name)
        # The long name comes last and replaces the short one, if a file has both.
        if column in table.names and (column == name or column not in used)
    }
    if "deflection" in logged:  # as a motion of the joint; a described one is that of the spring
        logged["deflection"] = replace(logged["deflection"], scale=robot.drives[joint].load_radius)
    return {field: source for field, source in logged.items() if field not in described}


def both_sides(picked: Mapping[str, Array], robot: Robot) -> dict[str, Array]:
    """Return the samples with deflections converted to the position of a side without encoder.

    The deflection of (7) and (8) is d = r_M/N theta_M - r_L theta_L, at the same instants. With
    both positions it stays, as a motion of the joint. Raises LogError for a deflection of a rigid
    drive, or without a position.
    """
    samples = dict(picked)
    for index, joint in enumerate(robot.joint_names):
        name = next((name for name in picked if name.startswith(f"{joint}.deflection_")), None)
        if name is None:
            continue
        deflection, drive = samples.pop(name), robot.drives[joint]
        if not drive.is_elastic:
            raise LogError(f"joint '{joint}' has a stiff drive, which has no deflection")
        _check_own_drive(robot, joint, "a deflection does not determine its position")
        name_of = partial(column_name, joint, robot.is_prismatic[index])
        motor, load = name_of("motor_position"), name_of("joint_position")
        behind_gear = drive.motor_radius / drive.ratio
        if {motor, load} <= set(samples):
            samples[name_of("deflection")] = deflection / drive.load_radius
        elif load in samples:
            # d = (r_M / N) theta_M - r_L theta_L, solved for theta_M, and below for theta_L.
            samples[motor] = (deflection + drive.load_radius * samples[load]) / behind_gear
        elif motor in samples:
            samples[load] = (behind_gear * samples[motor] - deflection) / drive.load_radius
        else:
            raise LogError(
                f"joint '{joint}': a deflection determines the other side of the spring only "
                "together with motor_position or joint_position"
            )
    return samples


def _check_own_drive(robot: Robot, joint: str, consequence: str) -> None:
    """Raise LogError for a joint whose drive is coupled with other joints."""
    if joint in coupled_names(robot.joint_names, robot.transmission):
        raise LogError(
            f"the drive of joint '{joint}' moves several joints or moves it by a factor: "
            f"{consequence}; give motor_position and joint_position as measured"
        )


def _clock_of(
    where: str, table: Table, description: LogDescription, source: Source | VectorSource
) -> Clock:
    columns = source.columns() if isinstance(source, Source) else source.columns
    time_column = next((table.clocks[column] for column in columns if column in table.clocks), None)
    time_s = table.in_file_of("time_s", columns)
    time_column = time_column or (time_s if time_s in table.names else None)
    clock = source.time or description.time or (Clock(column=time_column) if time_column else None)
    if clock is not None and clock.column is not None:
        rest = clock.nanoseconds and table.in_file_of(clock.nanoseconds, columns)
        clock = replace(clock, column=table.in_file_of(clock.column, columns), nanoseconds=rest)
    if clock is None:
        _checked_columns(where, columns, table)
        raise LogError(
            f'{where}: no time is given; name its column, time = "...", or a constant rate, time = '
            "{ rate_hz = ... }"
        )
    return clock


def _channel(data: Block, robot: Robot, spec: _Described) -> Channel:
    source, clock, where = spec.source, spec.clock, spec.where
    name, unit = _name_of(robot, spec.joint, spec.quantity)
    factor, offset = source.sign * source.scale, source.offset
    try:
        if source.servo:
            values = _servo_voltage(data, source.servo)
        else:
            if unit == "degC":
                degree, zero = TEMPERATURES[source.unit or unit]
                # sign scale (degree T + zero) + offset: the zero of the unit is scaled too, the
                # offset is not.
                factor, offset = factor * degree, offset + factor * zero
            else:
                factor *= _unit_factor(robot, spec, unit)
            values = data[str(source.column)] * _number(data, source.times)
        time = clock.seconds(data, len(values))
        times = source.times if isinstance(source.times, int | float) else 1.0
        period = None if source.wraps is None else abs(factor * times) * source.wraps
        return Channel(name, time, factor * values + offset, period, source.delay_s)
    except (LogError, ValueError) as problem:
        text = str(problem)
        raise LogError(text if text.startswith(where) else f"{where}: {text}") from None


def _name_of(robot: Robot, joint: str, quantity: str) -> tuple[str, str]:
    """Return the name of a channel, and the SI unit at its end."""
    is_prismatic = robot.is_prismatic[robot.index(joint)]
    drive = robot.drives[joint]
    if quantity == "deflection":
        unit = drive.spring_units[1] if drive.is_elastic else "rad"
        return f"{joint}.deflection_{unit}", unit
    name = column_name(joint, is_prismatic, quantity)
    return name, unit_of_column(name)


def _unit_factor(robot: Robot, spec: _Described, unit: str) -> float:
    """Return the factor from the column to the quantity: unit, torque constant, gear."""
    source, factor = spec.source, 1.0
    own_side, _, kind = spec.quantity.partition("_")
    if source.side not in (None, own_side):
        factor = _gear_factor(robot, spec)
        _, unit = _name_of(robot, spec.joint, f"{source.side}_{kind}")
    if source.unit is None:
        return factor
    if source.torque_constant_Nm_per_A is not None:
        return factor * UNIT_FACTORS["A"][source.unit] * source.torque_constant_Nm_per_A
    units = dict(UNIT_FACTORS[unit])
    if source.counts_per_turn is not None and unit == "rad":
        units["counts"] = 2 * np.pi / source.counts_per_turn
    if source.counts_per_m is not None and unit == "m":
        units["counts"] = 1.0 / source.counts_per_m
    if source.unit not in units:
        raise LogError(f"{spec.where}: {unknown_name('unit of this quantity', source.unit, units)}")
    return factor * units[source.unit]


def _gear_factor(robot: Robot, spec: _Described) -> float:
    """Return the factor from the other side of the gear to that of the quantity."""
    _check_own_drive(robot, spec.joint, f"its {spec.source.side} side does not determine the other")
    drive = robot.drives[spec.joint]
    ratio = total_ratio(drive)
    # The motor moves N times as far, and the joint has N times the torque.
    grows = spec.quantity in ("motor_position", "joint_torque")  # with the ratio
    return ratio if grows else 1.0 / ratio


def _servo_voltage(data: Block, servo: Servo) -> Array:
    """Return the voltage [V] of a position servo, see `Servo`.

    A goal holds until the next one, so at a sample the voltage is the mean of those before and
    after the step of the goal.
    """
    goal, gain = data[servo.goal], servo.gain_factor * _number(data, servo.gain)
    before = np.concatenate([goal[:1], goal[:-1]])
    duties = [
        np.clip(gain * (target - data[servo.position]), -servo.limit, servo.limit)
        for target in (before, goal)
    ]
    voltage: Array = 0.5 * (duties[0] + duties[1]) * _number(data, servo.supply)
    return voltage


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
