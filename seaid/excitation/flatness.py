"""What a planned joint motion asks of the drives: a series elastic robot is flat in its joints.

With the joint torque tau of the nominal model, (3) and (8) give the deflection, the motor angle and
its derivatives, and (7) the motor torque. The derivatives of the deflection are those of a quintic
spline through its samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from seaid._arrays import Array
from seaid.drives import (
    PARAMETERS_OF,
    Drive,
    DriveCurve,
    NonlinearSpring,
    SeriesElasticDrive,
    joint_curve,
    joint_term_parameters,
    missing_value,
    nonlinear_spring,
)
from seaid.errors import ExcitationError
from seaid.excitation.criteria import States, torque_derivatives
from seaid.regressor import joint_torques
from seaid.robot import Robot, at_drives, group_of, torques_at_joints

SIGN_WIDTH = 0.02
"""Coulomb friction turns within this part of the largest motor speed, so that it has a slope."""


Besides = tuple[tuple[int, DriveCurve, float], ...]
"""What acts beside the drives: joint, curve, and the speed within which dry friction turns."""


@dataclass(frozen=True, eq=False)
class Transmission:
    """From joints to motors, each (n,): motor angle = ratio phi + give tau.

    phi = C q is what the drives turn, C the `matrix` (n, n), and tau the torque on it. `ratio` is
    N r_L / r_M, `lever` N / r_M and `compliance` 1 / (r_L k), the deflection a unit of torque; the
    last two are zero where the drive is stiff. Springs that are no straight lines are in
    `nonlinear`, by index, with their r_L.
    """

    ratio: Array
    lever: Array
    compliance: Array
    matrix: Array
    nonlinear: tuple[tuple[int, float, NonlinearSpring], ...] = ()

    @property
    def is_elastic(self) -> bool:
        """True where some motor does not turn with the joints alone."""
        return bool(np.any(self.lever))

    def stretch(self, torque: Array) -> tuple[Array, Array]:
        """Return the deflection of the springs (T, n) under torques on the drives, and its slope.

        From the springs' zeros, in rad or m, and a unit of torque.
        """
        deflection = self.compliance * torque
        slope = np.broadcast_to(self.compliance, torque.shape)
        if self.nonlinear:
            slope = slope.copy()
        for index, radius, spring in self.nonlinear:
            deflection[:, index], by_force = spring.stretch(torque[:, index] / radius)
            slope[:, index] = by_force / radius
        return deflection, slope

    @property
    def zero(self) -> Array:
        """Where the springs are not stretched (n,), in rad or m."""
        zeros = np.zeros(len(self.ratio))
        for index, _, spring in self.nonlinear:
            zeros[index] = spring.zero
        return zeros


def transmission(robot: Robot) -> Transmission:
    """Return every joint's transmission. Raises ExcitationError where a spring has no value."""
    ratio, lever, compliance = np.zeros((3, robot.n))
    nonlinear = []
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        ratio[index] = drive.ratio
        if not isinstance(drive, SeriesElasticDrive):
            continue
        ratio[index] *= drive.load_radius / drive.motor_radius
        lever[index] = drive.ratio / drive.motor_radius
        check_spring(joint, drive)
        if set(drive.spring) <= {"linear", "damping"}:
            compliance[index] = 1.0 / (drive.load_radius * drive.values["stiffness"])
        else:
            nonlinear.append((index, drive.load_radius, nonlinear_spring(joint, drive)))
    return Transmission(ratio, lever, compliance, robot.transmission, tuple(nonlinear))


def rigid_transmission(robot: Robot) -> Transmission:
    """Return a transmission in which motors are the joints: for what does not ask for motors."""
    nothing = np.zeros(robot.n)
    return Transmission(np.ones(robot.n), nothing, nothing, robot.transmission)


def motor_speeds(drives: Transmission, top_speed: Array) -> Array:
    """Return how fast motors turn at most (n,) [rad/s] if joints move at `top_speed` (n,)."""
    return np.asarray(drives.ratio * (np.abs(drives.matrix) @ top_speed))


def check_spring(joint: str, drive: SeriesElasticDrive) -> None:
    """Raise ExcitationError where a value of a drive's spring is missing."""
    for term in drive.spring:
        for name in PARAMETERS_OF["spring"][term]:
            if term != "damping" and name not in drive.values:
                raise missing_value(joint, name)


def besides(robot: Robot, top_speed: Array, joints: Sequence[str]) -> Besides:
    """Return what acts beside the drives of joints, and of those that are coupled with them.

    `top_speed` (n,) sets where dry friction turns.

    Raises ExcitationError where a nominal value is missing.
    """
    wanted = {i for joint in joints for i in group_of(robot.transmission, robot.index(joint))}
    return tuple(
        (index, joint_curve(joint, drive), SIGN_WIDTH * float(top_speed[index]))
        for index, joint in enumerate(robot.joint_names)
        if index in wanted and joint_term_parameters(drive := robot.drives[joint])
    )


def load_torques(robot: Robot, beside: Besides, states: States) -> Array:
    """Return what the drives together put on every joint (T, n): (8) and what acts beside them."""
    torque = joint_torques(robot, *states)
    for index, curve, width in beside:
        torque[:, index] += curve.evaluate(states[0][:, index], states[1][:, index], width)[0]
    return torque


def load_derivatives(robot: Robot, beside: Besides, states: States) -> Array:
    """Return d tau_i / d (q, v, a)_j of `load_torques`, (3, T, n, n)."""
    tables = torque_derivatives(robot, states)
    for index, curve, width in beside:
        _, by_q, by_v = curve.evaluate(states[0][:, index], states[1][:, index], width)
        tables[0, :, index, index] += by_q
        tables[1, :, index, index] += by_v
    return tables


def nominal(joint: str, drive: Drive, name: str) -> float:
    """Return a nominal value of a drive. Raises ExcitationError where it is not given."""
    if name not in drive.values:
        raise missing_value(joint, name)
    return drive.values[name]


def check_nominal_bodies(robot: Robot) -> None:
    """Raise ExcitationError where the robot has no nominal inertial parameters."""
    missing = [
        robot.body_names[body]
        for body, values in enumerate(robot.parameters.reshape(robot.n, 10))
        if not np.all(np.isfinite(values))
    ]
    if missing:
        raise ExcitationError(
            f"'{robot.name}' has no nominal inertial parameters of {', '.join(missing)} (NaN), and "
            "this criterion or limit computes torques from them: load a URDF that has them, or ask "
            "for the condition number of the base parameters within position, velocity and "
            "acceleration limits"
        )


def differentiation(time: Array) -> tuple[Array, Array]:
    """Return the matrices (T, T) of the first and second derivative at equally spaced times."""
    first, second = _unit_differentiation(len(time))
    step = (time[-1] - time[0]) / (len(time) - 1)
    return first / step, second / step**2


@lru_cache(maxsize=4)
def _unit_differentiation(samples: int) -> tuple[Array, Array]:
    from scipy.interpolate import make_interp_spline

    time = np.arange(samples, dtype=np.float64)
    spline = make_interp_spline(time, np.eye(samples), k=5)
    return spline(time, nu=1), spline(time, nu=2)


def motor_signals(
    drives: Transmission, states: States, torque: Array, derivative: tuple[Array, Array]
) -> Array:
    """Return motor angle, speed, acceleration, those of phi, tau: (7, T, n), as `smooth.SIGNALS`.

    `torque` (T, n) is that on phi. Damping of a spring does not count in its deflection.
    """
    q, v, a = (at_drives(drives.matrix, state) for state in states)
    first, second = derivative
    sagging = drives.lever * drives.stretch(torque)[0]
    return np.stack(
        [
            drives.ratio * q + sagging + drives.lever * drives.zero,
            drives.ratio * v + first @ sagging,
            drives.ratio * a + second @ sagging,
            q,
            v,
            a,
            torque,
        ]
    )


def motor_signals_gradient(
    drives: Transmission, weights: Array, torque: Array, derivative: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the gradient by (q, v, a) (3, T, n) and by tau (T, n) of sum weights * signals."""
    first, second = derivative
    by_state = torques_at_joints(drives.matrix, drives.ratio * weights[:3] + weights[3:6])
    through = weights[0] + first.T @ weights[1] + second.T @ weights[2]
    by_torque = weights[6] + drives.lever * drives.stretch(torque)[1] * through
    return by_state, by_torque
