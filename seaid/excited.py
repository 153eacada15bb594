"""Does the robot move at all in a log? Asked before any regression is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seaid.arrays import Array
from seaid.errors import ExcitationError
from seaid.log import Log
from seaid.robot import Robot

_LEAST_RANGE = 20.0
"""A position moves if its range is so many times the noise between samples."""


def check_excitation(robot: Robot, logs: Sequence[Log]) -> None:
    """Raise ExcitationError if an elastic joint's motor, or the whole robot, stands still."""
    for joint in robot.elastic_joints:
        positions = [log.motor_position[:, log.joint_names.index(joint)] for log in logs]
        if not any(map(_moves, positions)):
            widest = max(float(np.ptp(position)) for position in positions)
            raise ExcitationError(
                f"the motor of '{joint}' stands still (it moves {widest:.3g} rad, noise "
                f"{_noise(positions[0]):.2g} rad): the log tells nothing about its friction and "
                "spring; move the joint, or leave it out with joints=[...] of load_robot"
            )
    every = [
        column
        for log in logs
        for side in (log.joint_position, log.motor_position)
        for column in side.T
        if np.all(np.isfinite(column))
    ]
    if not any(map(_moves, every)):
        raise ExcitationError("no joint moves in the log: the motion does not excite the robot")


def _moves(position: Array) -> bool:
    return bool(np.ptp(position) > _LEAST_RANGE * _noise(position))


def _noise(position: Array) -> float:
    """Return the standard deviation of white noise that second differences show."""
    return float(np.std(np.diff(position, 2)) / np.sqrt(6))
