"""Drives with estimated values, what several share, and what gives the constants of their motors.

Commands of all drives of a bus have one delay, and only where the log determines it. With one gain
set a delay T adds (K_d + F_v) T to the rotor inertia at the joint and K_p T to the viscous
friction, to first order. What is left to tell them apart is often less than the errors of the
model; the delay is then as stated, and its uncertainty in all intervals.

A current, a voltage or a gain in units of the drive is torque only up to a constant. Least squares
finds it only if something known fixes the scale of the equations: a stiffness or a rotor inertia in
the motor equation, a torque sensor behind the gear in (4b), or known bodies in (8).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, safely
from seaid._files import toml_table
from seaid.drives import Drive, ParameterName, unit_of
from seaid.drives.controller import DELAY_PARAMETER, NORMAL_95
from seaid.drives.terms import parameter_named
from seaid.errors import IdentificationError
from seaid.estimation import Estimate, Estimator, FittedRows, fit
from seaid.estimation.estimate import independent_rows
from seaid.estimation.fitting import Rows
from seaid.estimation.least_squares import equal_weights, solve
from seaid.estimation.parameters import (
    Bus,
    Constraints,
    buses_of,
    delay_std_s,
    is_stated,
    shared_columns,
    shared_parameters,
)
from seaid.estimation.qr_factor import RANK_TOLERANCE, QRFactor, scaled_svd
from seaid.log.filtering import periodogram, without_trend
from seaid.regressor import Regression
from seaid.regressor.regression import actuator_equation, sensed_torque, signals, spring_regressor
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.log import Motion

_BAND = (2.5, 4.0)
"""Band for the noise in units of the cutoff; positions are filtered at five times the cutoff: the
spectra there contain only noise and vibration of a spring."""


def without_torque(robot: Robot, springs: Collection[str]) -> dict[str, Array]:
    """Return springs {joint: parameters} without torque, for rows before the fit of the springs."""
    return {joint: np.zeros(len(spring_regressor(robot, joint).names)) for joint in springs}


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
    return float(np.median([_noise_ratio(robot, motion, joint) for motion in motions]))


def _noise_ratio(robot: Robot, motion: Motion, joint: str) -> float:
    index = robot.index(joint)
    by_name = signals(robot, motion, index)
    by_name["tau_L"] = sensed_torque(robot, motion, index)
    regressor = spring_regressor(robot, joint)
    torque, columns = regressor.evaluate(by_name)
    noises = []
    for samples in (torque, columns[:, regressor.names.index("stiffness")]):
        frequency, power = periodogram(without_trend(samples), motion.rate_hz)
        seen = (frequency > _BAND[0] * motion.cutoff_hz) & (frequency < _BAND[1] * motion.cutoff_hz)
        # The median over the lines, which the few peaks of vibration do not move.
        noises.append(float(np.median(power[seen])) if np.any(seen) else 0.0)
    of_torque, of_deflection = noises
    return of_torque / of_deflection if of_deflection > 0 else float("inf")


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
    equal = [*(bus.places for bus in buses), *groups.values()]
    constraints = Constraints.of(p, equal)
    estimate = constraints.applied(free, white)
    P, _ = constraints.solution(white)
    stated = _undetermined(buses, estimate, P @ white @ P.T, fitted.qr_factor.count)
    if stated:
        constraints = Constraints.of(p, equal, stated)
        estimate = constraints.applied(free, white)
    rows = independent_rows(fitted.qr_factor, free)
    P, G = constraints.solution(white)
    firsts = {free.names[bus.places[0]]: bus for bus in buses if len(bus.places) > 1}
    of_buses = {name.at(f"bus of {name.owner}"): [*x.places] for name, x in firsts.items()}
    shared = shared_parameters(free, {**groups, **of_buses}, rows)
    return replace(fitted, estimate=estimate, constraint=(P, G @ constraints.b), shared=shared)


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
    equal = [*(bus.places for bus in buses), *groups.values()]
    constraints = Constraints.of(len(white), equal, exact)
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


def with_estimated_delays(robot: Robot, identified: Robot) -> Robot | None:
    """Return the robot with the delays of an estimate as nominal ones, None if they converged.

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
    return robot.with_drives(drives) if drives else None


def _estimated_delay(joint: str, drive: Drive, identified: Drive) -> tuple[Drive, float]:
    """Return a drive with the estimated scale of its gains, if that moved, and its delay [s]."""
    delay, near = identified.values[DELAY_PARAMETER], drive.command_delay_s or 0.0
    if drive.is_up_to_scale and "gain_scale" not in drive.known:
        # The slope by the delay was that of the nominal scale.
        scale, before = (max(x.scale_of_gains, 1e-9) for x in (identified, drive))
        delay = near + (delay - near) * before / scale
        if abs(scale / before - 1) > _SCALE:
            drive = drive.with_values({"gain_scale": scale})
    if abs(delay - near) > NORMAL_95 * delay_std_s(drive):
        # The log contradicts the stated deviation, which is then none of the estimate.
        kept = {name: std for name, std in drive.std.items() if name != "command_delay_s"}
        drive = replace(drive, std=kept)
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


# The unknown constant of a motor

CONSTANTS = {
    "torque_constant": "only the current of its motor was logged",
    "voltage_constant": "only the voltage of its motor was logged",
    "gain_scale": "the gains of its controller are in units of the drive",
}
"""Factors that convert a logged input to torque, and why they are unknown."""

_HOMOGENEOUS = 1e-9
"""Part of the known torque below which what the columns contribute is rounding: the equations are
homogeneous."""

_PART = 0.01
"""Least share of a constant in a lost combination."""

_LOAD_SIDE = "known bodies (known_bodies=), logs with and without a payload (identify_conditions), "
_SPRING = (
    "the stiffness of its spring (known = ['stiffness']), known bodies (known_bodies=), logs with "
    "and without a payload (identify_conditions), a torque sensor behind the gear (joint_torque), "
    "its rotor inertia, "
)


class UnknownScaleError(IdentificationError):
    """Equations that the unknown constant `parameter` of a `joint` makes homogeneous."""

    joint: str
    parameter: str


def check_scale(qr_factor: QRFactor) -> None:
    """Raise UnknownScaleError if an unknown motor constant makes the equations homogeneous.

    All torques are then known only up to scale, and least squares gives zero. A payload in all logs
    does not help, since it could be part of its body.
    """
    places = [place for place, name in enumerate(qr_factor.names) if name.quantity in CONSTANTS]
    if not places or not qr_factor.count:  # without rows `solve` raises
        return
    R, p = qr_factor.weighted_factor(), len(qr_factor.names)
    svd = scaled_svd(R[:p, :p], "the scale of the torques")
    # |column| theta is the norm of the torque that each column contributes. If the equations are
    # homogeneous, least squares makes all of them, and so the constant, zero but for rounding.
    torques = svd.norms * svd.solve(R[:p, p], RANK_TOLERANCE)
    least = _HOMOGENEOUS * float(np.linalg.norm(R[:, p]))
    # The rows of `vectors` beyond the rank span the null space: a constant that has a part in one
    # of them can be changed, together with the bodies or the spring, without changing any torque.
    open_part = np.max(np.abs(svd.vectors[svd.rank(RANK_TOLERANCE) :]), axis=0, initial=0.0)
    for place in places:
        if abs(torques[place]) <= least or open_part[place] > _PART:
            column, remedy = qr_factor.names[place], _SPRING
            name = column.quantity
            joint = qr_factor.joint_names[qr_factor.equations[0]]
            if column.owner:
                joint, remedy = column.owner, _LOAD_SIDE
            message = (
                f"the {name.replace('_', ' ')} of {joint} is unidentifiable: {CONSTANTS[name]}, "
                f"so all torques are known only up to scale. Give one of: {remedy}or the constant "
                f"itself (known = ['{name}'])"
            )
            error = UnknownScaleError(message, "known_bodies=")
            error.joint, error.parameter = joint, name
            raise error


def with_unit_scale(robot: Robot, problem: UnknownScaleError) -> Robot:
    """Return the robot with the nominal scale of the gains at fault as known, 1 without one.

    Raises the problem if it is another one: gains in units of the drive still give ratios.
    """
    drive = robot.drives.get(problem.joint)
    if drive is None or problem.parameter != "gain_scale":
        raise problem
    fixed = drive.with_values({"gain_scale": drive.scale_of_gains})
    return robot.with_drives({problem.joint: replace(fixed, known=(*drive.known, "gain_scale"))})


def with_free_scale(robot: Robot, joints: Collection[str]) -> Robot:
    """Return the robot with unknown scales of the gains of some joints, as they were given."""
    drives = {}
    for joint in joints:
        drive = robot.drives[joint]
        known = tuple(name for name in drive.known if name != "gain_scale")
        drives[joint] = replace(drive, known=known)
    return robot.with_drives(drives) if drives else robot


def with_unit_constant(rows: Regression) -> Regression:
    """Return the rows of (10) of a motor whose unknown constant is 1."""
    constants = [k for k, name in enumerate(rows.names) if name.quantity in CONSTANTS]
    others = rows.of_columns(k for k in range(len(rows.names)) if k not in constants)
    return replace(others, y=rows.y - rows.H[:, constants].sum(axis=1))


def fit_constants(
    robot: Robot,
    springs: Mapping[str, Array],
    rows: Rows,
    estimator: Estimator,
    unscaled: Mapping[str, UnknownScaleError],
) -> FittedRows:
    """Return the fit of (8) with the motor constants of `unscaled` joints as parameters.

    `springs` {joint: values} are those whose torque is that on the load. The torque for a constant
    of 1 is a column, whose parameter is the constant: known bodies give its scale. Raises
    UnknownScaleError if they do not.
    """
    constants = {x: ParameterName(scale.parameter, x) for x, scale in unscaled.items()}
    change = partial(with_constant_columns, robot, springs, constants=constants)
    try:
        fitted = fit(rows, estimator, None, change, check_scale)
    except UnknownScaleError:
        raise next(iter(unscaled.values())) from None
    # An equation without a known torque is homogeneous. With a little less of everything in it its
    # residual is smaller and its weight larger, and so on, until the weights have made it zero.
    equal = solve(fitted.qr_factor, equal_weights(fitted.qr_factor)).values
    for joint, name in constants.items():
        place = fitted.qr_factor.names.index(name)
        if abs(fitted.estimate.values[place]) < _RUN_AWAY * abs(equal[place]):
            raise unscaled[joint]
    return fitted


_RUN_AWAY = 1e-6
"""Part of the constant of equal weights below which that of settled ones is none."""


def with_constant_columns(
    robot: Robot,
    springs: Mapping[str, Array],
    rows: Regression,
    constants: Mapping[str, ParameterName],
) -> Regression:
    """Return (8) with the torques of the springs: for a constant of 1 as the column of it.

    The propagated columns of `rows` are those of the springs.
    """
    # y + K T s = H theta with an unknown constant K and T s for a constant of 1: K has the column
    # -T s, next to those of the bodies.
    ends = np.cumsum([0, *map(len, springs.values())])
    y, columns = rows.y, []
    for k, (joint, values) in enumerate(springs.items()):
        torque = rows.propagated[:, ends[k] : ends[k + 1]] @ values
        if joint in constants:
            columns.append(-torque)
        else:
            y = y + torque
    names = tuple(constants[joint] for joint in springs if joint in constants)
    units = tuple(unit_of(robot.drives[name.owner], name.quantity) for name in names)
    return replace(rows, y=y).with_columns(names, units, np.column_stack(columns))
