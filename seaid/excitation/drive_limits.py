"""Limits on what a motion asks of the drives: joint and motor torque, motor speed, deflection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array, IndexArray
from seaid.excitation.flatness import (
    SIGN_WIDTH,
    Transmission,
    check_nominal_bodies,
    differentiation,
    motor_signals,
    nominal,
    transmission,
)
from seaid.excitation.gradient import States, torque_derivatives
from seaid.excitation.limits import Limits, positive_values
from seaid.rigid_body import joint_torques
from seaid.robot import Robot

KINDS = ("joint_torque", "motor_torque", "motor_speed", "deflection")


@dataclass(frozen=True, eq=False)
class DriveLimits:
    """Largest values (4, n) of `KINDS`, inf where not limited, and the nominal motors (n,)."""

    robot: Robot
    most: Array
    drives: Transmission
    motor_inertia: Array
    viscous: Array
    coulomb: Array
    sign_width: Array


def drive_limits(robot: Robot, limits: Limits, top_speed: Array) -> DriveLimits | None:
    """Return the limits on the drives, None where there are none.

    The joint torque is limited by the URDF's effort where the nominal bodies are known, unless
    given. Raises ExcitationError where a limit needs a nominal value that is not there.
    """
    nothing = np.full(robot.n, np.inf)
    effort = robot.effort_limits
    known = np.all(np.isfinite(robot.parameters))
    usable = np.isfinite(effort) & (effort > 0) & known
    elastic = np.array([joint in robot.elastic_joints for joint in robot.joint_names])
    defaults = {"joint_torque": np.where(usable, effort, np.inf)}
    given = {
        kind: positive_values(
            robot, kind, getattr(limits, kind), defaults.get(kind, nothing), unlimited=True
        )
        for kind in KINDS
    }
    most = np.array([given[kind] for kind in KINDS])
    most[KINDS.index("deflection"), ~elastic] = np.inf
    if not np.any(np.isfinite(most)):
        return None
    check_nominal_bodies(robot)
    motors = np.isfinite(most[KINDS.index("motor_torque")])
    drives = (
        transmission(robot)
        if np.any(np.isfinite(most[1:]))
        else Transmission(np.ones(robot.n), np.zeros(robot.n), np.zeros(robot.n))
    )
    return DriveLimits(
        robot=robot,
        most=most,
        drives=drives,
        motor_inertia=_of_motors(robot, motors, "motor_inertia_kg_m2", None),
        viscous=_of_motors(robot, motors, "viscous_friction_Nms_per_rad", "viscous"),
        coulomb=_of_motors(robot, motors, "coulomb_friction_Nm", "coulomb"),
        sign_width=SIGN_WIDTH * drives.ratio * top_speed,
    )


def drive_loads(limits: DriveLimits, time: Array, states: States) -> Array:
    """Return the `KINDS` along a motion, (4, T, n) [N m or N, N m, rad/s, rad or m]."""
    torque = joint_torques(limits.robot, *states)
    signals = motor_signals(limits.drives, states, torque, differentiation(time))
    speed, acceleration = signals[1], signals[2]
    motor = (
        limits.motor_inertia * acceleration
        + limits.viscous * speed
        + limits.coulomb * np.tanh(speed / limits.sign_width)
        + torque / limits.drives.ratio
    )  # (7), with the spring's force from (8)
    return np.stack([torque, motor, speed, limits.drives.compliance * torque])


def drive_load_gradient(
    limits: DriveLimits,
    time: Array,
    states: States,
    loads: Array,
    picked: tuple[IndexArray, IndexArray, IndexArray],
    maps: tuple[Array, Array, Array],
) -> Array:
    """Return the derivatives (m, n, k) of loads[kind, t, j] for `picked` (kind, t, j), each (m,).

    They are by variables x (n, k) with q = half range times (maps[0] @ x.T) and so on; `maps` are
    (3) of (T, k), for joints of unit range. `loads` are those of `drive_loads`.
    """
    kinds, instants, joints = picked
    tables = torque_derivatives(limits.robot, states)
    first, second = differentiation(time)
    by_state = np.stack(maps)
    gradient = np.zeros((len(kinds), limits.robot.n, by_state.shape[2]))
    for joint in np.unique(joints):
        mine = np.flatnonzero(joints == joint)
        t = instants[mine]
        by_acceleration, by_speed, by_torque = _slopes(
            limits, int(joint), kinds[mine], loads[2, t, joint]
        )
        weights = limits.drives.give[joint] * (
            by_speed[:, None] * first[t] + by_acceleration[:, None] * second[t]
        )
        weights[np.arange(len(mine)), t] += by_torque
        chain = np.einsum("xti,xtk->tik", tables[:, :, joint], by_state)
        gradient[mine] = np.tensordot(weights, chain, axes=1)
        gradient[mine, joint] += limits.drives.ratio[joint] * (
            by_speed[:, None] * by_state[1, t] + by_acceleration[:, None] * by_state[2, t]
        )
    return gradient


def _slopes(
    limits: DriveLimits, joint: int, kinds: IndexArray, speed: Array
) -> tuple[Array, Array, Array]:
    """Return the derivatives (m,) of loads by motor acceleration, motor speed, joint torque."""
    width = limits.sign_width[joint]
    turning = limits.coulomb[joint] / np.cosh(np.clip(speed / width, -300, 300)) ** 2 / width
    slopes = np.zeros((3, len(kinds)))
    torque, motor, fast, deflected = (kinds == number for number in range(len(KINDS)))
    slopes[2, torque] = 1.0
    slopes[0, motor] = limits.motor_inertia[joint]
    slopes[1, motor] = limits.viscous[joint] + turning[motor]
    slopes[2, motor] = 1.0 / limits.drives.ratio[joint]
    slopes[1, fast] = 1.0
    slopes[2, deflected] = limits.drives.compliance[joint]
    return slopes[0], slopes[1], slopes[2]


def _of_motors(robot: Robot, wanted: Array, name: str, term: str | None) -> Array:
    """Return a nominal value of the motors (n,) that are limited in torque, zero at the others."""
    values = np.zeros(robot.n)
    for index in np.flatnonzero(wanted):
        joint = robot.joint_names[index]
        drive = robot.drivetrains[joint]
        if term is None or term in drive.friction:
            values[index] = nominal(joint, drive, name)
    return values
