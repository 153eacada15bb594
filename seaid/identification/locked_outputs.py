"""Locked outputs: the load of a spring is held from outside, as on a test bench.

Its motor equation (7), and (4b) of a torque sensor, hold as always, and determine motor, friction
and spring. Its load side (8) has the torque of what holds it, which is unknown.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from seaid._arrays import is_constant
from seaid.errors import Finding
from seaid.log import Log
from seaid.robot import Robot

_LARGEST_DEFLECTION_RAD = 0.5
"""Motion of the motor at the joint that may be the deflection of a spring. An encoder that does not
change while the motor moves further is a dead channel."""

_HELD = 0.02
"""Motion of a locked output over that of its motor at the joint: what holds it yields too."""


def locked_outputs(robot: Robot, logs: Sequence[Log]) -> tuple[str, ...]:
    """Return the elastic joints whose output does not move in any log while their motor does."""
    if not logs or not np.array_equal(robot.transmission, np.eye(robot.n)):
        return ()
    joints = [joint for joint in robot.elastic_joints if not robot.is_prismatic[robot.index(joint)]]
    return tuple(joint for joint in joints if all(_is_locked(robot, log, joint) for log in logs))


def _is_locked(robot: Robot, log: Log, joint: str) -> bool:
    if joint not in log.joint_names:
        return False
    index, drive = log.joint_names.index(joint), robot.drives[joint]
    motor, output = log.motor_position[:, index], log.joint_position[:, index]
    if not (np.all(np.isfinite(motor)) and np.all(np.isfinite(output))) or is_constant(motor):
        return False
    moved = float(np.ptp(motor)) * drive.motor_radius / (drive.ratio * drive.load_radius)
    return moved < _LARGEST_DEFLECTION_RAD and float(np.ptp(output)) < _HELD * moved


def locked_findings(joints: Collection[str]) -> Iterator[Finding]:
    """Yield a note for each joint with a locked output."""
    for joint in joints:
        yield Finding(
            "locked-output",
            f"the output of {joint} does not move while its motor deflects the spring: it counts "
            "as locked, so that its motor, friction and spring are identified and the torque on "
            "its load is not used. If it did move, its encoder is dead: exclude its column",
            joint,
            "note",
            certainty="likely",
        )


def without_locked_loads(
    robot: Robot, used: Sequence[str], locked: Collection[str]
) -> tuple[Robot, tuple[str, ...]]:
    """Return the robot and the joints whose load side is used, those that are not locked.

    If all are locked, nothing is known of the bodies, which then count as given.
    """
    free = tuple(joint for joint in used if joint not in locked)
    if free or not used:
        return robot, free
    bodies = np.nan_to_num(robot.parameters)
    given = robot.with_values(bodies, robot.drives)
    return replace(given, known_bodies=robot.body_names), tuple(used)
