"""Estimates of a robot and of its drives: the spring's part and its noise, and drives with values.

(7) has the sum of a constant error of the motor torque b_0 and the spring offset f_0 as one column,
s = f_0 + b_0 N/r_M. (4b) with s instead of f_0 would put r_L N/r_M b_0 on the load. So (8) gets a
column for b_0 per spring: r_L (k d + s) = Y beta + r_L N/r_M b_0, and f_0 is the difference.

The motor equations are fitted by joint; what drives of a group share is then one value for all of
them, with the covariance between joints that this makes.

Commands of all drives of a bus have one delay, and only where the log determines it. With one gain
set a delay T adds (K_d + F_v) T to the rotor inertia at the joint and K_p T to the viscous
friction, to first order. What is left to tell them apart is often less than the errors of the
model; the delay is then as stated, and its uncertainty in all intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import polynomial
from scipy import linalg

from seaid._arrays import Array, safely
from seaid._files import toml_table
from seaid.drives import (
    DELAY_PARAMETER,
    NORMAL_95,
    Bus,
    Drive,
    ParameterName,
    buses_of,
    is_stated,
    parameter_named,
    parameter_of,
    shared_columns,
)
from seaid.errors import Finding, IdentificationError
from seaid.estimation import (
    Constraints,
    Estimate,
    FittedRows,
    ModelChecks,
    QRFactor,
    SharedParameter,
    independent_rows,
    shared_parameters,
    triangle,
)
from seaid.regressor import Regression, actuator_equation, sensed_torque, signals, spring_regressor
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.log import Motion

_BAND = (2.5, 4.0)
"""Band for the noise in units of the cutoff; positions are filtered at five times the cutoff: the
spectra there contain only noise and vibration of a spring."""


LOAD = ""
"""Key of the load side among equations named by joint."""


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """Estimates of both sides of the springs.

    `springs` {joint: parameters} are those whose torque is that on the load; `checks` and
    `excluded` by joint, and "load" for the load side. `whole` is the estimate of both sides if they
    were estimated at once, `fit` the fit of that, or of `load_side`; `actuators` {joint: fit of its
    motor equation} if they were estimated in turn. `scaling` {joint: fit that gives its unknown
    motor constant}: of its spring by a torque sensor, or of the load side. `findings` are about
    the way to the estimates, and `not_shared` is why the data do not support an estimate of both
    sides at once, whose rows `regress` returns; `shared` are the parameters that drives share.
    """

    drives: Mapping[str, Estimate]
    load: Estimate
    load_side: Estimate
    springs: Mapping[str, Array]
    excluded: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    fit: FittedRows
    whole: Estimate | None = None
    actuators: Mapping[str, FittedRows] = field(default_factory=dict)
    scaling: Mapping[str, FittedRows] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    not_shared: str = ""
    shared: tuple[SharedParameter, ...] = ()
    regress: Callable[[Robot, Motion], Regression] | None = None


def without_torque(robot: Robot, springs: Collection[str]) -> dict[str, Array]:
    """Return springs {joint: parameters} without torque, for rows before the fit of the springs."""
    return {joint: np.zeros(len(spring_regressor(robot, joint).names)) for joint in springs}


def sensed_spring(joint: str) -> ParameterName:
    """Return the key of (4b) of a joint among equations named by joint."""
    return ParameterName("spring", joint)


def spring_of(robot: Robot, estimate: Estimate, joint: str) -> Estimate:
    """Return the estimate of a joint's spring, in the order of its regressor.

    A parameter that several conditions have for themselves is there once for each.
    """
    names = spring_regressor(robot, joint).names
    return estimate.of_names(x for name in names for x in estimate.names if parameter_of(x) == name)


def offset_places(spring: Estimate) -> list[int]:
    """Return the places of the offset of a spring, one for each condition that has its own."""
    return [place for place, name in enumerate(spring.names) if parameter_of(name) == _OFFSET]


_OFFSET = "spring_offset"


def merged_estimates(
    drives: Mapping[str, Estimate], load_side: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the drives' estimates of both sides by joint, without correlation between them."""
    both = drives.keys() & load_side.keys()
    joined = {joint: Estimate.joined([drives[joint], load_side[joint]]) for joint in both}
    return {**load_side, **drives, **joined}


def with_estimate(drive: Drive, estimate: Estimate) -> Drive:
    """Return the drive with its estimated values."""
    return with_values(drive, estimate.by_name)


def with_values(drive: Drive, values: Mapping[str, float]) -> Drive:
    """Return the drive with those of the values that are its own and have their proper sign."""
    return drive.with_values(
        {
            name: max(float(value), 0.0) if parameter_named(name).is_positive else float(value)
            for name, value in values.items()
            if name in drive.parameter_names and (value > 0 or name != "stiffness")
        }
    )


def has_only_spring_torque(robot: Robot, motions: Sequence[Motion], joint: str) -> bool:
    """Return whether an elastic joint has the equation (4b) only, without a logged motor torque."""
    used = [actuator_equation(robot, motion, joint)[0] for motion in motions]
    return all(regressor is spring_regressor(robot, joint) for regressor in used)


def noise_ratio(robot: Robot, motions: Sequence[Motion], joint: str) -> float:
    """Return the noise variance of a joint's torque over that of its deflection in (4b).

    It is the median ratio of the spectra between 2.5 and 4 times the cutoff; inf, so that the
    deflection counts as exact, if the deflection has no noise there.
    """
    ratios = [_spectra(robot, motion, joint) for motion in motions]
    return float(np.median(ratios))


def _spectra(robot: Robot, motion: Motion, joint: str) -> float:
    index = robot.index(joint)
    by_name = signals(robot, motion, index)
    by_name["tau_L"] = sensed_torque(robot, motion, index)
    regressor = spring_regressor(robot, joint)
    torque, columns = regressor.evaluate(by_name)
    both = np.column_stack([torque, columns[:, regressor.names.index("stiffness")]])
    # Without the line through the samples, and with a Hann window: of a ratio the scale cancels.
    phase = np.linspace(-1.0, 1.0, len(both), endpoint=False)
    both -= polynomial.polyval(phase, polynomial.polyfit(phase, both, 1)).T
    power = np.abs(np.fft.rfft(both * (1 + np.cos(np.pi * phase))[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(both), 1 / motion.rate_hz)
    seen = (frequency > _BAND[0] * motion.cutoff_hz) & (frequency < _BAND[1] * motion.cutoff_hz)
    # The median over the lines, which the few peaks of vibration do not move.
    torque_noise, deflection_noise = np.median(power[seen], axis=0) if np.any(seen) else (0.0, 0.0)
    return float(torque_noise / deflection_noise) if deflection_noise > 0 else float("inf")


TORQUE_OFFSET = "torque_offset"

LEAST_SHARE = 0.02
"""Least part of the column of a torque offset that the other columns do not explain.

Below it a joint moves so little that its gravity torque is nearly constant, and the errors of the
gravity parameters would grow by the inverse: the offset then counts as zero."""


def with_spring_torque(springs: Sequence[Estimate], rows: Regression) -> Regression:
    """Return rows of the load side with the torque of the springs (4b), from rows without it."""
    if not springs:
        return rows
    values = np.concatenate([spring.values for spring in springs])
    return replace(rows, y=rows.y + rows.propagated[:, : len(values)] @ values)


def with_torque_columns(
    robot: Robot, springs: Mapping[str, Estimate], joints: Sequence[str], rows: Regression
) -> Regression:
    """Return the rows with the torque of the springs and columns of the torque offsets."""
    rows = with_spring_torque(list(springs.values()), rows)
    # `propagated` has the columns of the parameters of each spring in turn.
    places: dict[str, list[int]] = {}
    start = 0
    for joint, spring in springs.items():
        places[joint] = [start + place for place in offset_places(spring)]
        start += len(spring.names)
    # r_L (k d + s) = Y beta + r_L N/r_M b_0: the column of s is r_L, in the rows of any condition.
    lever = [offset_lever(robot, joint) for joint in joints]
    columns = (
        np.column_stack(
            [
                np.empty((len(rows.y), 0)),
                *(rows.propagated[:, places[x]].sum(axis=1) for x in joints),
            ]
        )
        * lever
    )
    names = [ParameterName(TORQUE_OFFSET, joint) for joint in joints]
    return rows.with_columns(names, len(joints) * ["N m"], columns)


def offset_lever(robot: Robot, joint: str) -> float:
    """Return N / r_M: the spring force per motor torque."""
    drive = robot.drives[joint]
    return drive.ratio / drive.motor_radius


def identifiable_offsets(qr_factor: QRFactor, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the joints whose torque offset, among the last columns, the load side determines."""
    R, p = qr_factor.weighted_factor(), len(qr_factor.names)
    kept = list(range(p - len(joints)))
    identifiable: list[str] = []
    for joint, place in zip(joints, range(len(kept), p), strict=True):
        # The last entry of the triangle is the norm of the column without the part in the others.
        remainder = abs(triangle(R[:, [*kept, place]])[-1, -1])
        if remainder > LEAST_SHARE * np.linalg.norm(R[:, place]):
            kept, identifiable = [*kept, place], [*identifiable, joint]
    return tuple(identifiable)


def with_torque_offsets(
    robot: Robot,
    load: FittedRows,
    drives: Mapping[str, Estimate],
    springs: Mapping[str, Estimate],
    whole: Estimate | None,
) -> dict[str, Estimate]:
    """Return the drives {joint: Estimate} with the spring offset and the torque offset separated.

    The error of s is in both the fit of (7) and b_0, so that f_0 does not contain it. `whole` is
    the estimate of all drives as one.
    """
    split = dict(drives)
    if whole is None:
        return split
    of_springs = places_in(whole, springs)
    for joint in springs:
        name = ParameterName(TORQUE_OFFSET, joint)
        if name in load.estimate.names:
            place = load.estimate.names.index(name)
            # b_0 = slopes^T x + noise of (8), with the values x of the springs: the covariance
            # with b_0 is C slopes.
            slopes = load.sensitivity[place, : len(of_springs)]
            of_drive = places_in(whole, {joint: drives[joint]})
            common = whole.covariance[np.ix_(of_drive, of_springs)] @ slopes
            split[joint] = _separated(robot, load, joint, drives[joint], place, common)
    return split


def places_in(whole: Estimate, drives: Mapping[str, Estimate]) -> list[int]:
    """Return the places of the parameters of drives {joint: Estimate} in that of all drives."""
    names = [name for joint, drive in drives.items() for name in drive.at(joint).names]
    return [whole.names.index(name) for name in names]


def _separated(
    robot: Robot, load: FittedRows, joint: str, drive: Estimate, place: int, common: Array
) -> Estimate:
    """Return a drive with f_0 = s - b_0 N/r_M and b_0, the load side's column `place`.

    `common` (q,) is the covariance of the drive's parameters with b_0.
    """
    side, q = load.estimate, len(drive.names)
    joined = np.vstack(
        [
            np.column_stack([drive.covariance, common]),
            np.append(common, side.covariance[place, place]),
        ]
    )
    # (x, b_0) -> (x with f_0 = s - b_0 N/r_M, b_0).
    change = np.eye(q + 1)
    change[offset_places(drive), q] = -offset_lever(robot, joint)
    covariance = change @ joined @ change.T
    white, freedom = (
        None if of_side is None or of_drive is None else np.append(of_drive, of_side[place])
        for of_side, of_drive in (
            (side.white_standard_errors, drive.white_standard_errors),
            (side.degrees_of_freedom, drive.degrees_of_freedom),
        )
    )
    return replace(
        drive,
        names=(*drive.names, TORQUE_OFFSET),
        units=(*drive.units, "N m"),
        values=change @ np.append(drive.values, side.values[place]),
        covariance=covariance,
        white_standard_errors=white,
        degrees_of_freedom=freedom,
    )


def with_shared_drives(
    robot: Robot, actuators: dict[str, FittedRows], estimates: dict[str, Estimate]
) -> tuple[dict[str, FittedRows], dict[str, Estimate], Estimate | None]:
    """Return fits and estimates of drives with shared parameters, and all estimates as one."""
    if not estimates:
        return actuators, estimates, None
    whole = Estimate.joined(estimate.at(joint) for joint, estimate in estimates.items())
    groups = shared_columns(robot.drives, whole.names)
    if not groups:
        return actuators, estimates, whole
    fits = actuators.values()
    rows = sum(independent_rows(fit.qr_factor, fit.estimate) for fit in fits)
    tested = shared_parameters(whole, groups, rows)
    white = linalg.block_diag(*(fit.white_covariance for fit in fits))
    whole = Constraints.of(len(whole.names), groups.values()).applied(whole, white)
    changed = {}
    for joint, part in whole.by_owner().items():
        own = ("residual_std", "condition_number", "diagnostics")
        changed[joint] = replace(part, **{name: getattr(estimates[joint], name) for name in own})
    shared = {
        joint: replace(fit, estimate=changed[joint], shared=tested)
        for joint, fit in actuators.items()
    }
    return shared, changed, whole


def shared_slopes(
    robot: Robot, actuators: Mapping[str, FittedRows], own: dict[str, dict[str, Array]]
) -> None:
    """Make derivatives {joint: {parameter: (k,)}} of drives fitted alone those of shared ones."""
    keys = [(joint, name) for joint, slopes in own.items() for name in slopes]
    groups = shared_columns(robot.drives, [ParameterName.of(x).at(joint) for joint, x in keys])
    if groups:
        white = linalg.block_diag(*(actuators[joint].white_covariance for joint in own))
        P, _ = Constraints.of(len(keys), groups.values()).solution(white)
        changed = P @ np.array([own[joint][name] for joint, name in keys])
        for (joint, name), slopes in zip(keys, changed, strict=True):
            own[joint][name] = slopes


# What drives share: one delay for each bus, one value for each group

MOST_DELAY_ROUNDS = 3
"""Most repetitions with commands delayed by the estimate: the error of one is of its square."""

_DELAY_S = 2e-4
"""Change of a delay [s] below which its linearisation has converged."""

_ROUNDING_S = 1e-7
"""Difference [s] of the delays of one bus by rounding; drives stay on one by equal delays."""

_SCALE = 0.01
"""Relative change of the scale of gains below which the slope by the delay has converged."""

LARGEST_DELAY_S = 0.25
"""Largest delay of a command [s] for which the linearisation is tried."""

_FREE = 1e-8
"""Part of a variance that stays to a direction with a fixed value, so that matrices have roots."""


def with_shared_parameters(
    drives: Mapping[str, Drive], fitted: FittedRows, joint: str = ""
) -> FittedRows:
    """Return a fit with one value for what drives share, and one delay per bus.

    The delay is the stated one where the rows do not determine it.
    """
    free = fitted.estimate
    buses, groups = buses_of(drives, free.names, joint), shared_columns(drives, free.names, joint)
    if not buses and not groups:
        return fitted
    white, p = fitted.white_covariance, len(free.names)
    equal = _equal(buses, groups)
    constraints = Constraints.of(p, equal)
    estimate = constraints.applied(free, white)
    P, _ = constraints.solution(white)
    stated = _undetermined(buses, estimate, P @ white @ P.T, fitted.qr_factor.count)
    if stated:
        constraints = Constraints.of(p, equal, stated)
        estimate = constraints.applied(free, white)
    rows = independent_rows(fitted.qr_factor, free)
    return replace(
        fitted,
        estimate=estimate,
        constraint=constraints.solution(white)[0],
        shared=shared_parameters(free, groups, rows),
    )


def _equal(
    buses: Iterable[Bus], groups: Mapping[ParameterName, Sequence[int]]
) -> list[Sequence[int]]:
    """Return the places of the columns of each parameter that several drives have."""
    return [*(bus.places for bus in buses), *groups.values()]


def _undetermined(buses: Sequence[Bus], estimate: Estimate, white: Array, count: int) -> list[Bus]:
    """Return the buses whose delay `count` rows do not determine, with a covariance (p, p).

    They do not if the effect of the stated range, beyond that of all other parameters, is less than
    the residual: errors of the model may then hide it. An estimate farther beyond that range than
    such errors explain is one to linearise at.
    """
    free, stated = sum(len(bus.places) for bus in buses), []
    for bus in buses:
        place, range_s = bus.places[0], NORMAL_95 * bus.std_s
        # |column| of the delay, orthogonal to all others, is 1 / error for a residual of 1.
        as_residual = np.sqrt(white[place, place] * count * len(bus.places) / free)
        is_far = abs(estimate.values[place] - bus.nominal_s) > range_s + as_residual
        if as_residual > range_s and not is_far:
            stated.append(bus)
    return stated


def with_fixed_delays(
    drives: Mapping[str, Drive], estimate: Estimate, white: Array, joint: str = ""
) -> tuple[Estimate, Array]:
    """Return an estimate and its covariance `white` (p, p) for delays that stay where they are.

    A physically consistent robot is looked for near the estimate. What drives share stays equal
    then, as delays of one bus do, and those that are as stated keep their value: both have a
    distance from no other value.
    """
    buses = buses_of(drives, estimate.names, joint)
    groups = shared_columns(drives, estimate.names, joint)
    exact = [bus for bus in buses if is_stated(estimate.standard_errors[bus.places[0]], bus.std_s)]
    constraints = Constraints.of(len(white), _equal(buses, groups), exact)
    if not len(constraints.A):
        return estimate, white
    P, _ = constraints.solution(white)
    stated = [place for bus in exact for place in bus.places]
    covariance, across = estimate.covariance, estimate.covariance[:, stated]
    if stated:
        # C - C_xs C_ss^-1 C_sx, the covariance of the others if the stated delays s are exact.
        inner = safely(np.linalg.pinv, across[stated], what="the delays of the commands")
        covariance = covariance - across @ inner @ across.T
    return replace(estimate, covariance=covariance), P @ white @ P.T + _FREE * white


def with_merged_columns(
    drives: Mapping[str, Drive], rows: Regression, estimate: Estimate, joint: str = ""
) -> Regression:
    """Return rows with one column for what drives share, themselves without such columns.

    Their fit is the constrained one of `with_shared_parameters`. Delays that are as stated in an
    estimate have no column: their torque is known.
    """
    buses, groups = buses_of(drives, rows.names, joint), shared_columns(drives, rows.names, joint)
    if not buses and not groups:
        return rows
    H, y = rows.H.copy(), rows.y.copy()
    gone: list[int] = []
    for first, *others in _equal(buses, groups):
        # One value for all: its column is the sum.
        H[:, first] += H[:, others].sum(axis=1)
        gone += others
    for bus in buses:
        first = bus.places[0]
        if is_stated(estimate.standard_errors[first], bus.std_s):
            y -= bus.nominal_s * H[:, first]
            gone.append(first)
    kept = np.setdiff1d(np.arange(len(rows.names)), gone)
    return replace(rows, H=H, y=y).of_columns(kept.tolist())


def with_estimated_delays(robot: Robot, identified: Robot) -> Robot:
    """Return the robot with the delays of an estimate as nominal ones; itself if they converged.

    Raises IdentificationError for a delay that is far beyond the range of the linearisation.
    """
    drives: dict[str, Drive] = {}
    of_buses: dict[float, list[float]] = {}
    for joint, drive in robot.drives.items():
        if drive.controller is None or DELAY_PARAMETER in drive.known:
            continue
        near = drive.command_delay_s or 0.0
        scaled, delay = _estimated_delay(joint, drive, identified.drives[joint])
        seen = of_buses.setdefault(near, [])
        delay = next((known for known in seen if abs(known - delay) < _ROUNDING_S), delay)
        seen.append(delay)
        if abs(delay - near) > _DELAY_S:
            scaled = replace(scaled, command_delay_s=delay)
        if scaled is not drive:
            drives[joint] = scaled
    return robot.with_drives(drives) if drives else robot


def _estimated_delay(joint: str, drive: Drive, identified: Drive) -> tuple[Drive, float]:
    """Return a drive with the estimated scale of its gains, if that moved, and its delay [s]."""
    delay, near = identified.values[DELAY_PARAMETER], drive.command_delay_s or 0.0
    if drive.is_up_to_scale and "gain_scale" not in drive.known:
        # The slope by the delay was that of the nominal scale.
        scale, before = (max(x.scale_of_gains, 1e-9) for x in (identified, drive))
        delay = near + (delay - near) * before / scale
        if abs(scale / before - 1) > _SCALE:
            drive = drive.with_values({"gain_scale": scale})
    if abs(delay) > LARGEST_DELAY_S:
        raise IdentificationError(
            f"the command of {joint} seems delayed by {delay * 1e3:.3g} ms, more than "
            f"{LARGEST_DELAY_S * 1e3:g} ms either way, where the search ends: check the gains "
            "of its controller, and the signs and clocks of commands and positions; commands "
            "that act so late are shifted in the description of the log:\n"
            f"{toml_table('joints', joint)}\n"
            f'position_command = {{ column = "...", delay_s = {-delay:.3g} }}'
        )
    return drive, delay
