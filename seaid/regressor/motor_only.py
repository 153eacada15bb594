"""What motor angle and motor torque determine of an elastic joint with their time derivatives.

By (7) the torque on the load follows from the motor, tau = n (tau_M - sum c_i phi_i) with
n = N r_L / r_M and the columns c_i of inertia and friction; by (4b) the deflection, and so the
angle of the joint, with its derivatives. (8) is then an equation in measured signals, nonlinear in
the parameters. Its rows are its derivatives by all parameters, at random motions that satisfy the
equations: their rank is the number of locally identifiable combinations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from seaid._arrays import Array, safely
from seaid.drives import Drive, ParameterName
from seaid.regressor.base import (
    BaseParameters,
    base_of_columns,
    grouped_by,
    joint_torques,
    left_to_right,
    rigid_body_regressor,
    torque_slopes,
    with_base_columns,
)
from seaid.robot import Robot

_FRICTION = ("viscous", "coulomb", "offset", "quadratic", "asymmetric")
"""Terms of friction whose columns have derivatives here."""

_POINTS, _STEP_S = np.arange(-6, 7), 0.03
"""Samples about an instant; a polynomial through them gives four derivatives of a torque."""

_ORDERS = 5
"""Number of the derivatives of positions and torques at an instant: the orders 0 to 4."""

ROWS_PER_PARAMETER = 2
"""Rows at random instants for each parameter, of a body or of all, whose rank is decided."""

_ZERO, _ROUNDED = 1e-9, 1e-6
"""Norm of a column that is zero, and part of a column below which another one in it is rounding:
the fourth derivatives have errors of 1e-8."""


def is_motor_only(drive: Drive, sensors: frozenset[str]) -> bool:
    """Return whether an elastic joint has motor angle and motor torque, and nothing behind."""
    behind = {"joint_position", "deflection", "joint_torque"} & sensors
    return drive.is_elastic and {"motor_position", "motor_torque"} <= sensors and not behind


def base_by_derivatives(
    robot: Robot, sensors: Mapping[str, frozenset[str]], names: Sequence[str], seed: int
) -> BaseParameters | None:
    """Return the combinations of `names` that sensors determine with their derivatives.

    None without an elastic joint that has motor angle and motor torque only, and for robots with
    sensors or terms that have no columns here: coupled drives, nonlinear springs, other friction,
    joints whose position or torque is not measured.
    """
    joints = robot.joint_names
    alone = (is_motor_only(robot.drives[joint], sensors[joint]) for joint in joints)
    if not any(alone) or not all(_is_covered(robot, joint, sensors[joint]) for joint in joints):
        return None
    rng = np.random.default_rng(seed)
    bodies = rng.normal(size=robot.parameters.size)
    plausible = _plausible(robot) if np.all(np.isfinite(robot.parameters)) else bodies
    plausible_robot = robot.with_values(plausible, robot.drives)
    stiffness = rng.uniform(50.0, 200.0, robot.n)
    for index, joint in enumerate(joints):
        stiffness[index] = robot.drives[joint].values.get("stiffness", stiffness[index])
    # A stiff drive has no deflection: tau / (r_L k) is zero.
    stiffness[~np.isin(joints, robot.elastic_joints)] = np.inf
    places = {name: place for place, name in enumerate(names)}
    count = max(20, -(-ROWS_PER_PARAMETER * len(names) // robot.n))
    rows = (_rows(plausible_robot, stiffness, sensors, places, rng) for _ in range(count))
    H = np.vstack(list(rows))
    H[:, : robot.parameters.size][:, robot.is_known] = 0.0
    kept, by_kept, _ = with_base_columns(robot, len(names))
    zero = np.linalg.norm(H[:, kept], axis=0) < _ZERO
    chosen, grouping, gap = left_to_right(H[:, kept], zero, rounding=_ROUNDED)
    columns, grouping = [kept[k] for k in chosen], grouped_by(grouping, by_kept, _ROUNDED)
    return base_of_columns(names, columns, grouping, gap)


def _plausible(robot: Robot) -> Array:
    """Return the standard parameters of the robot, with masses where it has none."""
    bodies = robot.parameters.reshape(-1, 10).copy()
    bodies[bodies[:, 0] <= 0] = [1.0, 0.1, 0.05, 0.08, 0.05, 0.0, 0.06, 0.0, 0.0, 0.04]
    return bodies.ravel()


def _is_covered(robot: Robot, joint: str, sensors: frozenset[str]) -> bool:
    drive = robot.drives[joint]
    if {*drive.friction} - {*_FRICTION} or drive.motor_input != "torque":
        return False
    if any((drive.parallel_spring, drive.joint_friction, drive.extra_terms, drive.transmission)):
        return False
    if not drive.is_elastic:
        position = {"joint_position", "motor_position"} & sensors
        return bool(position and {"motor_torque", "joint_torque"} & sensors)
    seen = {"joint_position", "motor_position", "motor_torque"} <= sensors
    return drive.spring == ("linear",) and (seen or is_motor_only(drive, sensors))


def _instant(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return derivatives (5, n) of order 0 to 4 of joint positions, and of torques on the joints.

    They are those of a random motion at an instant, by sums of two sines per joint.
    """
    amplitude = rng.uniform(0.3, 1.0, (2, robot.n))
    frequency, phase = rng.uniform(1.0, 3.0, (2, robot.n)), rng.uniform(0, 6.3, (2, robot.n))

    def moved(time: Array, order: int) -> Array:
        angle = frequency * time[:, None, None] + phase + order * np.pi / 2
        return np.asarray(np.sum(amplitude * frequency**order * np.sin(angle), axis=1))

    time: Array = _STEP_S * _POINTS.astype(np.float64)
    torques = joint_torques(robot, *(moved(time, order) for order in range(3)))
    # weights of derivatives by the polynomial through the points
    powers = np.vander(_POINTS.astype(float), increasing=True)
    weights = safely(np.linalg.inv, powers, what="the samples about an instant")[:_ORDERS]
    factorials = np.cumprod([1.0, *range(1, _ORDERS)])
    # The k-th derivative of a polynomial at 0 is k! times its coefficient of t^k.
    scale = factorials / _STEP_S ** np.arange(_ORDERS)
    position = np.array([moved(np.zeros(1), order)[0] for order in range(_ORDERS)])
    return position, scale[:, None] * (weights @ torques)


def _rows(
    robot: Robot,
    stiffness: Array,
    sensors: Mapping[str, frozenset[str]],
    places: Mapping[str, int],
    rng: np.random.Generator,
) -> Array:
    """Return the derivatives of (8), and of (7) where it is used, by all parameters at an instant.

    The drive of a joint with a torque sensor is not in (8). `places` {parameter: column}.
    """
    position, torque = _instant(robot, rng)
    rows, further = np.zeros((robot.n, len(places))), []
    rows[:, : robot.parameters.size] = -rigid_body_regressor(robot, *position[:3, None])[0]
    slopes = torque_slopes(robot, *position[:3, None])
    for index, joint in enumerate(robot.joint_names):
        if "joint_torque" in sensors[joint]:
            continue
        drive, k = robot.drives[joint], stiffness[index]
        is_alone = is_motor_only(drive, sensors[joint])
        reach, lever = drive.load_radius, drive.ratio / drive.motor_radius
        # (4b) and (3): d = tau / (r_L k), theta_M = N / r_M (r_L q + d), and so their derivatives.
        d = torque[:, index] / (reach * k)
        columns = _columns(drive, lever * (reach * position[:, index] + d))
        if is_alone or not drive.is_elastic:  # r_L f = r_L N / r_M (tau_M - c phi)
            load = {name: -lever * reach * column[0] for name, column in columns.items()}
        else:
            load = {"stiffness": reach * d[0], "spring_offset": reach}
            further.append(np.zeros(len(places)))
            motor = {name: column[0] for name, column in columns.items()}
            # (7): r_M / N (k d + f_0) at the motor.
            motor |= {"stiffness": d[0] / lever, "spring_offset": 1.0 / lever}
            _add(further[-1], places, joint, motor)
        if is_alone:  # q = (r_M / N theta_M - d) / r_L
            changes = {name: -lever / k * column for name, column in columns.items()}
            changes |= {"stiffness": -d[:3] / k, "spring_offset": np.array([-1.0 / k, 0.0, 0.0])}
            felt = slopes[:, 0, :, index].T
            torques = {name: felt @ change / reach for name, change in changes.items()}
            # The angle of this joint is in the torques of all joints: by the chain rule.
            _add(rows.T, places, joint, torques)
        _add(rows[index], places, joint, load)
    return np.vstack([rows, *further])


def _add(row: Array, places: Mapping[str, int], joint: str, values: Mapping[str, Any]) -> None:
    """Add {parameter of a drive: value} to a row, or columns to the transpose of rows.

    Known parameters have no place.
    """
    for name, value in values.items():
        if (place := places.get(ParameterName(name, joint))) is not None:
            row[place] += value


def _columns(drive: Drive, motor: Array) -> dict[str, Array]:
    """Return the columns of (7) and their first two derivatives, by those of the motor angle."""
    w, rate, jerk, snap = motor[1:5]
    sign = np.sign(w)
    square = [w**2, 2 * w * rate, 2 * (rate**2 + w * jerk)]
    of_terms = {
        "viscous": ("viscous_friction", [w, rate, jerk]),
        "coulomb": ("coulomb_friction", [sign, 0.0, 0.0]),
        "offset": ("friction_offset", [1.0, 0.0, 0.0]),
        "quadratic": ("quadratic_friction", [sign * x for x in square]),
        "asymmetric": ("asymmetric_friction", [sign * x for x in (w, rate, jerk)]),
    }
    pairs = (of_terms[term] for term in drive.friction)
    columns = {name: np.array(column) for name, column in pairs}
    return columns | {"motor_inertia": np.array([rate, jerk, snap])}
