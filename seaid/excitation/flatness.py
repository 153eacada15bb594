"""What a planned joint motion asks of the drives: a series elastic robot is flat in its joints.

With the joint torque tau of the nominal model, (3) and (8) give the deflection, the motor angle and
its derivatives, and (7) the motor torque. All is linear in (q, v, a, tau) but Coulomb friction; the
derivatives of tau are those of a quintic spline through its samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from seaid.arrays import Array
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.errors import ExcitationError
from seaid.robot import Robot
from seaid.transmission import coupled_names

SIGN_WIDTH = 0.02
"""Coulomb friction turns within this part of the largest motor speed, so that it has a slope."""


@dataclass(frozen=True, eq=False)
class Transmission:
    """From joints to motors, each (n,): motor angle = ratio q + give tau.

    `ratio` is N r_L / r_M, `give` N / (r_M r_L k) [rad/(N m)], `compliance` 1 / (r_L k), the
    deflection a unit of joint torque; the last two are zero where the drive is stiff.
    """

    ratio: Array
    give: Array
    compliance: Array


def transmission(robot: Robot) -> Transmission:
    """Return every joint's transmission.

    Raises ExcitationError where no stiffness is given, and for drives that move several joints.
    """
    coupled = coupled_names(robot.joint_names, robot.transmission)
    if coupled:
        raise ExcitationError(
            f"the drives of {', '.join(coupled)} move several joints: motions are planned for the "
            "base parameters of such a robot, without parameters and limits of its drives"
        )

    def values(value_of: Callable[[SeriesElasticDrive, float], float], stiff: bool) -> Array:
        found = np.zeros(robot.n)
        for index, joint in enumerate(robot.joint_names):
            drive = robot.drivetrains[joint]
            if isinstance(drive, SeriesElasticDrive):
                found[index] = value_of(drive, nominal(joint, drive, "stiffness"))
            elif stiff:
                found[index] = drive.ratio
        return found

    return Transmission(
        values(lambda drive, _: drive.ratio * drive.load_radius / drive.motor_radius, True),
        values(lambda drive, k: drive.ratio / (drive.motor_radius * drive.load_radius * k), False),
        values(lambda drive, k: 1.0 / (drive.load_radius * k), False),
    )


def nominal(joint: str, drive: Drive, name: str) -> float:
    """Return a nominal value of a drive. Raises ExcitationError where it is not given."""
    value = getattr(drive, name, None)
    if value is None:
        raise ExcitationError(
            f"joint '{joint}': its drive has no nominal {name.split('_N')[0].replace('_', ' ')}; "
            "this criterion or limit needs one: give it in the drivetrains of load_robot"
        )
    return float(value)


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
    drives: Transmission,
    states: tuple[Array, Array, Array],
    torque: Array,
    derivative: tuple[Array, Array],
) -> Array:
    """Return motor angle, speed, acceleration, then q, v, a: (6, T, n), as `smooth.SIGNALS`."""
    q, v, a = states
    first, second = derivative
    sagging = drives.give * torque
    return np.stack(
        [
            drives.ratio * q + sagging,
            drives.ratio * v + first @ sagging,
            drives.ratio * a + second @ sagging,
            q,
            v,
            a,
        ]
    )


def motor_signals_gradient(
    drives: Transmission, weights: Array, derivative: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the gradient by (q, v, a) (3, T, n) and by tau (T, n) of sum weights * signals."""
    first, second = derivative
    by_state = drives.ratio * weights[:3] + weights[3:]
    by_torque = drives.give * (weights[0] + first.T @ weights[1] + second.T @ weights[2])
    return by_state, by_torque
