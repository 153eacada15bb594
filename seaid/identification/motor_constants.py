"""The unknown constant of a motor: what determines it, and the drive that follows from it.

A current, a voltage or a gain in units of the drive is torque only up to a constant. Least squares
finds it only if something known fixes the scale of the equations: a stiffness or a rotor inertia in
the motor equation, a torque sensor behind the gear in (4b), or known bodies in (8).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid.drives import (
    DELAY_PARAMETER,
    ParameterName,
    parameter_of,
    unit_of,
)
from seaid.errors import IdentificationError
from seaid.estimation import (
    RANK_TOLERANCE,
    Estimate,
    Estimator,
    FittedRows,
    QRFactor,
    Rows,
    equal_weights,
    fit,
    scaled_svd,
    solve,
)
from seaid.regressor import Regression
from seaid.robot import Robot

CONSTANTS = {
    "torque_constant": "only the current of its motor was logged",
    "voltage_constant": "only the voltage of its motor was logged",
    "gain_scale": "the gains of its controller are in units of the drive",
}
"""Factors that convert a logged input to torque, and why they are unknown."""

STIFFNESS = "stiffness"

_ROUNDING = 1e-9

_PART = 0.01
"""Least share of a constant in a lost combination."""

_LOAD_SIDE = "known bodies (known_bodies=), logs with and without a payload (identify_conditions), "
_SPRING = (
    "the stiffness of its spring (known = ['stiffness']), known bodies (known_bodies=), logs with "
    "and without a payload (identify_conditions), a torque sensor behind the gear (joint_torque), "
    "its rotor inertia, "
)


class UnknownScaleError(IdentificationError):
    """Equations that an unknown constant `parameter` of a `joint` makes homogeneous."""

    joint = parameter = ""


def check_scale(qr_factor: QRFactor) -> None:
    """Raise UnknownScaleError if an unknown motor constant makes the equations homogeneous.

    All torques are then known only up to scale, and least squares gives zero. A payload in all logs
    does not help, since it could be part of its body.
    """
    places = [
        place for place, name in enumerate(qr_factor.names) if parameter_of(name) in CONSTANTS
    ]
    if not places or not qr_factor.count:  # without rows `solve` raises
        return
    R, p = qr_factor.weighted_factor(), len(qr_factor.names)
    svd = scaled_svd(R[:p, :p], "the scale of the torques")
    # |column| theta is the norm of the torque that each column contributes. If the equations are
    # homogeneous, least squares makes all of them, and so the constant, zero but for rounding.
    torques = svd.norms * svd.solve(R[:p, p], RANK_TOLERANCE)
    least = _ROUNDING * float(np.linalg.norm(R[:, p]))
    # The rows of `vectors` beyond the rank span the null space: a constant that has a part in one
    # of them can be changed, together with the bodies or the spring, without changing any torque.
    open_part = np.max(np.abs(svd.vectors[svd.rank(RANK_TOLERANCE) :]), axis=0, initial=0.0)
    for place in places:
        if abs(torques[place]) <= least or open_part[place] > _PART:
            column, remedy = ParameterName.of(qr_factor.names[place]), _SPRING
            name = column.quantity
            joint = qr_factor.joint_names[qr_factor.equations[0]]
            if column.owner:
                joint, remedy = column.owner, _LOAD_SIDE
            problem = UnknownScaleError(
                f"the {name.replace('_', ' ')} of {joint} is unidentifiable: {CONSTANTS[name]}, "
                f"so all torques are known only up to scale. Give one of: {remedy}or the constant "
                f"itself (known = ['{name}'])",
                "known_bodies=",
            )
            problem.joint, problem.parameter = joint, name
            raise problem


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
    constants = [k for k, name in enumerate(rows.names) if parameter_of(name) in CONSTANTS]
    others = rows.of_columns(k for k in range(len(rows.names)) if k not in constants)
    return replace(others, y=rows.y - rows.H[:, constants].sum(axis=1))


def scaled_by_load(
    robot: Robot,
    estimates: Mapping[str, Estimate],
    springs: Mapping[str, Estimate],
    rows: Rows,
    estimator: Estimator,
    unscaled: Mapping[str, UnknownScaleError],
) -> tuple[dict[str, Estimate], FittedRows]:
    """Return the estimates of `unscaled` joints with the motor constants that (8) determines.

    The second result is the fit of these. `springs` are those whose torque is that on the load. The
    torque for a constant of 1 is a column of (8), whose parameter is the constant: known bodies
    give its scale. Raises UnknownScaleError if they do not.
    """
    constants = {x: ParameterName(problem.parameter, x) for x, problem in unscaled.items()}
    change = partial(with_constant_columns, robot, springs, constants=constants)
    try:
        fitted = fit(rows, estimator, None, change, check_scale)
    except UnknownScaleError:
        raise next(iter(unscaled.values())) from None
    for joint in _without_scale(fitted, constants):
        raise unscaled[joint]
    scaled = {
        joint: scaled_with_springs(robot, estimates[joint], name, fitted, springs)
        for joint, name in constants.items()
    }
    return scaled, fitted


_RUN_AWAY = 1e-6
"""Part of the constant of equal weights below which that of settled ones is none."""


def _without_scale(fitted: FittedRows, constants: Mapping[str, ParameterName]) -> Iterator[str]:
    """Yield the joints {joint: its constant} whose equations the weights have made zero.

    An equation without a known torque is homogeneous. With a little less of everything in it its
    residual is smaller and its weight larger, and so on, until all of it is zero.
    """
    equal = solve(fitted.qr_factor, equal_weights(fitted.qr_factor)).values
    for joint, name in constants.items():
        place = fitted.qr_factor.names.index(name)
        if abs(fitted.estimate.values[place]) < _RUN_AWAY * abs(equal[place]):
            yield joint


def with_constant_columns(
    robot: Robot,
    springs: Mapping[str, Estimate],
    rows: Regression,
    constants: Mapping[str, ParameterName],
) -> Regression:
    """Return (8) with the torques of the springs: for a constant of 1 as the column of it.

    The propagated columns of `rows` are those of the springs.
    """
    # y + K T s = H theta with an unknown constant K and T s for a constant of 1: K has the column
    # -T s, next to those of the bodies.
    ends = np.cumsum([0, *(len(spring.values) for spring in springs.values())])
    y, columns = rows.y, []
    for k, (joint, spring) in enumerate(springs.items()):
        torque = rows.propagated[:, ends[k] : ends[k + 1]] @ spring.values
        if joint in constants:
            columns.append(-torque)
        else:
            y = y + torque
    names = tuple(constants[joint] for joint in springs if joint in constants)
    units = tuple(unit_of(robot.drives[name.owner], name.quantity) for name in names)
    return replace(rows, y=y).with_columns(names, units, np.column_stack(columns))


def scaled_with_springs(
    robot: Robot,
    unit: Estimate,
    name: ParameterName,
    fitted: FittedRows,
    springs: Mapping[str, Estimate],
) -> Estimate:
    """Return the estimate `unit` with its constant in `fitted`, which the springs' errors move.

    The torque of a spring of values s in (8), K T s with the constant K of its motor, changes by
    K T ds: the constant by K times the derivative of the fit by that torque.
    """
    load = fitted.estimate
    row = fitted.sensitivity[load.names.index(name)]
    ends = np.cumsum([0, *(len(spring.values) for spring in springs.values())])
    variance, slopes = load.standard_error(name) ** 2, np.zeros(len(unit.names))
    for k, (joint, spring) in enumerate(springs.items()):
        same = ParameterName(name.quantity, joint)
        # Errors of the own spring are in `unit` too, so that their part of the error is correlated
        # with it and goes through `slopes`; those of other springs are independent of it.
        slope = (load.value(same) if same in load.names else 1.0) * row[ends[k] : ends[k + 1]]
        if joint == name.owner:
            slopes[[unit.names.index(x) for x in spring.names]] = slope
        else:
            variance += float(slope @ spring.covariance @ slope)
    error = float(np.sqrt(variance))
    return _scaled(robot, unit, name.owner, name.quantity, load.value(name), error, slopes)


def scaled_by_sensor(
    robot: Robot, unit: Estimate, joint: str, name: str, spring: Estimate
) -> Estimate:
    """Return the estimate `unit` for a motor constant of 1 with the constant that a sensor gives.

    It is K = k / k_1: the stiffness by the torque sensor in (4b) over that of (7) for a constant of
    1. The errors of both count, so that K k_1 has that of k.
    """
    of_unit, of_sensor = unit.value(STIFFNESS), spring.value(STIFFNESS)
    slopes = np.where(np.array(unit.names) == STIFFNESS, -of_sensor / of_unit**2, 0.0)
    error = spring.standard_error(STIFFNESS) / abs(of_unit)
    return _scaled(robot, unit, joint, name, of_sensor / of_unit, error, slopes)


def scales_with_torque(estimate: Estimate) -> BoolArray:
    """Return which parameters (p,) of a drive scale with its torque: all but a delay [s]."""
    return np.array([parameter_of(name) != DELAY_PARAMETER for name in estimate.names])


def _scaled(
    robot: Robot,
    unit: Estimate,
    joint: str,
    name: str,
    constant: float,
    error: float,
    by_unit: Array | float = 0.0,
) -> Estimate:
    """Return the estimate for a motor constant with an error, from that for a constant of 1.

    The constant has the derivative `by_unit` by the values of the latter.
    """
    is_scaled = scales_with_torque(unit)
    factors = np.where(is_scaled, constant, 1.0)
    values = np.append(factors * unit.values, constant)
    # The values are (K x, K), with dK = by_unit^T dx + an error that is independent of x:
    # d(K x, K) = (diag(K); 0) dx + (x, 1) dK. A delay [s] does not scale with torque.
    by_constant = np.append(np.where(is_scaled, unit.values, 0.0), 1.0)
    change = np.vstack([np.diag(factors), np.zeros(len(factors))])
    change += np.outer(by_constant, np.broadcast_to(by_unit, len(factors)))
    covariance = change @ unit.covariance @ change.T + error**2 * np.outer(by_constant, by_constant)
    white, freedom = unit.white_standard_errors, unit.degrees_of_freedom
    return replace(
        unit,
        names=(*unit.names, name),
        values=values,
        covariance=covariance,
        units=(*unit.units, unit_of(robot.drives[joint], name)),
        white_standard_errors=None if white is None else np.append(factors * white, error),
        degrees_of_freedom=None if freedom is None else np.append(freedom, np.min(freedom)),
    )
