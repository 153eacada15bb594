"""Motor motion and torque of a planned joint motion: a series elastic robot is flat in its joints.

With the joint torque tau of the nominal model, (3) and (8) give the deflection and the motor angle,
and (7) the motor torque. The deflection is differentiated through a quintic interpolating spline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from seaid._arrays import Array
from seaid.drives import PARAMETERS_OF, Drive, total_ratio
from seaid.drives.functions import (
    SmoothColumns,
    SpringInverse,
    joint_curve,
    joint_term_parameters,
    missing_value,
    spring_inverse,
)
from seaid.errors import ExcitationError
from seaid.excitation.criteria import States
from seaid.regressor import joint_torques
from seaid.regressor.base import torque_slopes
from seaid.robot import Robot, at_drives, torques_at_joints
from seaid.robot.transmission import group_of

SIGN_WIDTH = 0.02
"""Coulomb friction changes sign over this share of the top speed, so that it is differentiable."""

ParallelElements = tuple[tuple[int, SmoothColumns, float], ...]
"""Elements parallel to the drives: joint, torque curve, and the speed width of dry friction."""


@dataclass(frozen=True, eq=False)
class Transmission:
    """The map from joints to motors, each (n,): theta_M = ratio phi + lever * deflection(tau).

    phi = C q are the output angles of the drives, C the `matrix` (n, n), tau the torques on them.
    `ratio` is N r_L / r_M, `lever` N / r_M, and `compliance` 1 / (r_L k) the deflection per torque;
    the last two are zero for a stiff drive. `unloaded` is the measured deflection of the unloaded
    springs [m or rad]. `nonlinear` lists springs by index, with their r_L.
    """

    ratio: Array
    lever: Array
    compliance: Array
    matrix: Array
    unloaded: Array
    nonlinear: tuple[tuple[int, float, SpringInverse], ...] = ()

    @property
    def is_elastic(self) -> bool:
        """True if any drive is elastic."""
        return bool(np.any(self.lever))

    def spring_deflection(self, torque: Array) -> tuple[Array, Array]:
        """Return the deflection of the springs (T, n) under torques, and its slope by the torque.

        It is counted from the unloaded springs [m or rad].
        """
        deflection = self.compliance * torque
        slope = np.broadcast_to(self.compliance, torque.shape)
        if self.nonlinear:
            slope = slope.copy()
        for index, radius, spring in self.nonlinear:
            # (4b): the force of the spring is tau / r_L, so d deflection / d tau = by_force / r_L
            deflection[:, index], by_force = spring.stretch(torque[:, index] / radius)
            slope[:, index] = by_force / radius
        return deflection, slope


def transmission(robot: Robot) -> Transmission:
    """Return the transmission of a robot. Raises ExcitationError if a spring has no value."""
    ratio, lever, compliance, unloaded = np.zeros((4, robot.n))
    nonlinear = []
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        ratio[index] = total_ratio(drive)
        if not drive.is_elastic:
            continue
        lever[index] = drive.ratio / drive.motor_radius
        check_spring(joint, drive)
        if set(drive.spring) <= {"linear", "damping"}:
            # (4b): tau = r_L k deflection
            compliance[index] = 1.0 / (drive.load_radius * drive.values["stiffness"])
        else:
            if "linear" not in drive.spring or drive.values["stiffness"] <= 0:
                raise ExcitationError(
                    f"joint '{joint}': its spring has no linear stiffness, so that the motor "
                    "motion along a plan is undetermined at zero spring force",
                    advice="plan for the base parameters, without parameters and limits of its "
                    "drive",
                )
            if drive.is_nonlinear_spring:
                unloaded[index] = drive.values.get("deflection_zero", 0.0)
            nonlinear.append((index, drive.load_radius, spring_inverse(drive)))
    return Transmission(ratio, lever, compliance, robot.transmission, unloaded, tuple(nonlinear))


def rigid_transmission(robot: Robot) -> Transmission:
    """Return a transmission with motors directly on the joints, if motor motions are not needed."""
    nothing = np.zeros(robot.n)
    return Transmission(np.ones(robot.n), nothing, nothing, robot.transmission, nothing)


def motor_speeds(drives: Transmission, top_speed: Array) -> Array:
    """Return the largest motor speeds (n,) [rad/s] for joint speeds up to `top_speed` (n,)."""
    return np.asarray(drives.ratio * (np.abs(drives.matrix) @ top_speed))


def check_spring(joint: str, drive: Drive) -> None:
    """Raise ExcitationError if a value of a drive's spring is missing."""
    for term in drive.spring:
        for name in PARAMETERS_OF["spring"][term]:
            if term not in ("damping", "dahl") and name not in drive.values:
                raise missing_value(joint, name)


def parallel_elements(robot: Robot, top_speed: Array, joints: Sequence[str]) -> ParallelElements:
    """Return the elements parallel to drives; `top_speed` (n,) scales dry friction's width."""
    # the drives of a group share the torques of all its joints, so all elements there count
    wanted = {i for joint in joints for i in group_of(robot.transmission, robot.index(joint))}
    return tuple(
        (index, joint_curve(joint, drive), SIGN_WIDTH * float(top_speed[index]))
        for index, joint in enumerate(robot.joint_names)
        if index in wanted and joint_term_parameters(drive := robot.drives[joint])
    )


def load_torques(robot: Robot, parallel: ParallelElements, states: States) -> Array:
    """Return the torques of the drives at the joints (T, n): (8) with the parallel elements."""
    torque = joint_torques(robot, *states)
    for index, curve, width in parallel:
        q, v = states[0][:, index], states[1][:, index]
        torque[:, index] += curve.torque(q, v, sign_width=width)[0]
    return torque


def load_derivatives(robot: Robot, parallel: ParallelElements, states: States) -> Array:
    """Return d tau_i / d (q, v, a)_j of `load_torques`, (3, T, n, n)."""
    tables = torque_slopes(robot, *states)
    for index, curve, width in parallel:
        q, v = states[0][:, index], states[1][:, index]
        _, (by_q, by_v) = curve.torque(q, v, sign_width=width)
        tables[0, :, index, index] += by_q
        tables[1, :, index, index] += by_v
    return tables


def nominal_value(joint: str, drive: Drive, name: str) -> float:
    """Return a nominal value of a drive. Raises ExcitationError if it is not given."""
    if name not in drive.values:
        raise missing_value(joint, name)
    return drive.values[name]


def check_nominal_bodies(robot: Robot) -> None:
    """Raise ExcitationError if the robot lacks nominal inertial parameters."""
    missing = [
        robot.body_names[body]
        for body, values in enumerate(robot.parameters.reshape(-1, 10))
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
    """Return the differentiation matrices (T, T), first and second, at equally spaced times."""
    first, second = _unit_differentiation(len(time))
    step = (time[-1] - time[0]) / (len(time) - 1)
    return first / step, second / step**2


@lru_cache(maxsize=4)
def _unit_differentiation(samples: int) -> tuple[Array, Array]:
    from scipy.interpolate import make_interp_spline

    time = np.arange(samples, dtype=np.float64)
    # a spline is linear in its samples: column j has the derivatives of that through 1 at sample j
    # and 0 at the others
    spline = make_interp_spline(time, np.eye(samples), k=5)
    return spline(time, nu=1), spline(time, nu=2)


def motor_signals(
    drives: Transmission, states: States, torque: Array, derivative: tuple[Array, Array]
) -> Array:
    """Return theta_M, its speed and acceleration, those of phi, and tau: (7, T, n).

    The order is that of `seaid.drives.functions.SMOOTH_SIGNALS`; `torque` (T, n) is tau. The
    deflection neglects the damping of a spring.
    """
    q, v, a = (at_drives(drives.matrix, state) for state in states)
    first, second = derivative
    # (3), (4b): theta_M = N / r_M (r_L phi + deflection(tau)); the spring's part is differentiated
    spring_angle = drives.lever * drives.spring_deflection(torque)[0]
    return np.stack(
        [
            drives.ratio * q + spring_angle + drives.lever * drives.unloaded,
            drives.ratio * v + first @ spring_angle,
            drives.ratio * a + second @ spring_angle,
            q,
            v,
            a,
            torque,
        ]
    )


def motor_signals_gradient(
    drives: Transmission, weights: Array, torque: Array, derivative: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the gradient by (q, v, a) (3, T, n) and by tau (T, n) of sum(weights * signals)."""
    first, second = derivative
    # the transpose of `motor_signals`: phi = C q gives C^T, the differentiation matrices D^T
    by_state = torques_at_joints(drives.matrix, drives.ratio * weights[:3] + weights[3:6])
    through = weights[0] + first.T @ weights[1] + second.T @ weights[2]
    # tau acts through the deflection in theta_M and its derivatives, and is itself signal 6
    by_torque = weights[6] + drives.lever * drives.spring_deflection(torque)[1] * through
    return by_state, by_torque
