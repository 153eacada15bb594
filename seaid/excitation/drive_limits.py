"""Limits on what a motion asks of the drives: joint and motor torque, motor speed, deflection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array, BoolArray, IndexArray
from seaid.drivetrain.curves import DriveCurve, beside_names, friction_curve
from seaid.errors import ExcitationError
from seaid.excitation.flatness import (
    SIGN_WIDTH,
    Besides,
    Transmission,
    besides,
    check_nominal_bodies,
    differentiation,
    load_derivatives,
    load_torques,
    motor_signals,
    motor_speeds,
    nominal,
    rigid_transmission,
    transmission,
)
from seaid.excitation.gradient import States
from seaid.excitation.limits import Limits, positive_values
from seaid.robot import Robot
from seaid.transmission import torques_at_drives

DRIVE_KINDS = ("joint_torque", "motor_torque", "motor_speed", "deflection")


_DEFLECTION = DRIVE_KINDS.index("deflection")

_NOT_FLAT = {
    "dead_zone": ("motor_torque", "motor_speed"),
    "damping": ("motor_torque", "motor_speed", "deflection"),
}
"""{spring term: kinds that do not follow from the joint's motion at each instant}: across a dead
zone a motor jumps, a damped spring remembers."""


@dataclass(frozen=True, eq=False)
class DriveLimits:
    """Largest values (4, n) of `DRIVE_KINDS`, inf where not limited, and the nominal motors (n,).

    `friction` is that of motors limited in torque, by index; `beside` acts beside the drives.
    """

    robot: Robot
    most: Array
    drives: Transmission
    motor_inertia: Array
    friction: tuple[tuple[int, DriveCurve], ...]
    beside: Besides
    sign_width: Array


def drive_limits(robot: Robot, limits: Limits, top_speed: Array) -> DriveLimits | None:
    """Return the limits on the drives, None where there are none.

    The joint torque is limited by the URDF's effort where the nominal bodies and what acts beside
    the drive are known, unless given. Raises ExcitationError where a limit needs a nominal value
    that is not there, and for motors that do not follow from the joint's motion.
    """
    nothing = np.full(robot.n, np.inf)
    effort = robot.effort_limits
    known = _knows_beside(robot) & np.all(np.isfinite(robot.parameters))
    usable = np.isfinite(effort) & (effort > 0) & known
    elastic = np.array([joint in robot.elastic_joints for joint in robot.joint_names])
    defaults = {"joint_torque": np.where(usable, effort, np.inf)}
    given = {
        kind: positive_values(
            robot, kind, getattr(limits, kind), defaults.get(kind, nothing), unlimited=True
        )
        for kind in DRIVE_KINDS
    }
    most = np.array([given[kind] for kind in DRIVE_KINDS])
    most[DRIVE_KINDS.index("deflection"), ~elastic] = np.inf
    limited = np.isfinite(most)
    if not np.any(limited):
        return None
    check_nominal_bodies(robot)
    _check_flat(robot, limited)
    motors = np.flatnonzero(limited[DRIVE_KINDS.index("motor_torque")])
    drives = transmission(robot) if np.any(limited[1:]) else rigid_transmission(robot)
    asked = [robot.joint_names[index] for index in np.flatnonzero(limited.any(axis=0))]
    inertia = np.zeros(robot.n)
    for index in motors:
        joint = robot.joint_names[index]
        inertia[index] = nominal(joint, robot.drivetrains[joint], "motor_inertia")
    names = [robot.joint_names[index] for index in motors]
    curves = [friction_curve(joint, robot.drivetrains[joint]) for joint in names]
    return DriveLimits(
        robot=robot,
        most=most,
        drives=drives,
        motor_inertia=inertia,
        friction=tuple(zip(motors.tolist(), curves, strict=True)),
        beside=besides(robot, top_speed, asked),
        sign_width=SIGN_WIDTH * motor_speeds(drives, top_speed),
    )


def _knows_beside(robot: Robot) -> BoolArray:
    """Tell for each joint (n,) whether what acts beside its drive has values."""
    drives = [robot.drivetrains[joint] for joint in robot.joint_names]
    return np.array([set(beside_names(drive)) <= set(drive.values) for drive in drives])


def _check_flat(robot: Robot, limited: BoolArray) -> None:
    """Raise ExcitationError for limits on what jumps, or remembers."""
    for index, joint in enumerate(robot.joint_names):
        for term in getattr(robot.drivetrains[joint], "spring", ()):
            kinds = [kind for kind in _NOT_FLAT.get(term, ()) if limited[DRIVE_KINDS.index(kind), index]]
            if kinds:
                raise ExcitationError(
                    f"joint '{joint}' has a spring with {term.replace('_', ' ')}: its "
                    f"{' and '.join(kinds)} do not follow from the motion of the joint, so that a "
                    "plan cannot limit them; leave these limits out"
                )


def drive_loads(limits: DriveLimits, time: Array, states: States) -> Array:
    """Return the `DRIVE_KINDS` along a motion, (4, T, n) [N m or N, N m, rad/s, rad or m].

    The first is at the joints, the others are at what the drives turn.
    """
    torque = load_torques(limits.robot, limits.beside, states)
    through = torques_at_drives(limits.drives.matrix, torque)
    signals = motor_signals(limits.drives, states, through, differentiation(time))
    speed, acceleration = signals[1], signals[2]
    motor = limits.motor_inertia * acceleration + through / limits.drives.ratio  # (7) with (8)
    for index, curve in limits.friction:
        width = float(limits.sign_width[index])
        motor[:, index] += curve.evaluate(speed[:, index], through[:, index], width)[0]
    return np.stack([torque, motor, speed, limits.drives.stretch(through)[0]])


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
    matrix = limits.drives.matrix
    tables = load_derivatives(limits.robot, limits.beside, states)
    at_drives = np.moveaxis(torques_at_drives(matrix, np.moveaxis(tables, 2, -1)), -1, 2)
    through = torques_at_drives(matrix, loads[0])
    by_force = limits.drives.stretch(through)[1]
    give = limits.drives.lever * by_force
    first, second = differentiation(time)
    by_state = np.stack(maps)
    gradient = np.zeros((len(kinds), limits.robot.n, by_state.shape[2]))
    for joint in np.unique(joints):
        for table, mine in (
            (tables, np.flatnonzero((joints == joint) & (kinds == 0))),
            (at_drives, np.flatnonzero((joints == joint) & (kinds > 0))),
        ):
            t = instants[mine]
            by_acceleration, by_speed, by_torque = _slopes(
                limits, int(joint), kinds[mine], loads[2, t, joint], through[t, joint]
            )
            by_torque[kinds[mine] == _DEFLECTION] = by_force[t, joint][kinds[mine] == _DEFLECTION]
            weights = give[:, joint] * (
                by_speed[:, None] * first[t] + by_acceleration[:, None] * second[t]
            )
            weights[np.arange(len(mine)), t] += by_torque
            chain = np.einsum("xti,xtk->tik", table[:, :, joint], by_state)
            gradient[mine] = np.tensordot(weights, chain, axes=1)
            turning = limits.drives.ratio[joint] * (
                by_speed[:, None] * by_state[1, t] + by_acceleration[:, None] * by_state[2, t]
            )
            gradient[mine] += matrix[joint][:, None] * turning[:, None, :]
    return gradient


def _slopes(
    limits: DriveLimits, joint: int, kinds: IndexArray, speed: Array, torque: Array
) -> tuple[Array, Array, Array]:
    """Return the derivatives (m,) of loads by motor acceleration, motor speed, torque.

    That of the deflection is left at zero.
    """
    slopes = np.zeros((3, len(kinds)))
    at_joint, motor, fast = (kinds == number for number in range(3))
    slopes[2, at_joint] = 1.0
    slopes[0, motor] = limits.motor_inertia[joint]
    slopes[2, motor] = 1.0 / limits.drives.ratio[joint]
    for index, curve in limits.friction:
        if index == joint:
            width = float(limits.sign_width[joint])
            _, by_speed, by_torque = curve.evaluate(speed[motor], torque[motor], width)
            slopes[1, motor] += by_speed
            slopes[2, motor] += by_torque
    slopes[1, fast] = 1.0
    return slopes[0], slopes[1], slopes[2]
