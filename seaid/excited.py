"""Does the robot move at all in a log, and is every channel alive? Asked before any regression."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seaid.arrays import Array
from seaid.errors import ExcitationError, LogError
from seaid.log import Log
from seaid.logs.dropouts import is_constant
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


def check_channels(logs: Sequence[Log]) -> None:
    """Raise LogError where a sensor says the same all the time while the other side of it moves."""
    for log in logs:
        for index, joint in enumerate(log.joint_names):
            sides = {
                "motor position": log.motor_position[:, index],
                "joint position": log.joint_position[:, index],
            }
            for dead, other in (tuple(sides), tuple(sides)[::-1]):
                _check_alive(joint, dead, sides[dead], other, sides[other])
            torques = {"motor torque": log.motor_torque[:, index]}
            if log.joint_torque is not None:
                torques["joint torque"] = log.joint_torque[:, index]
            for name, torque in torques.items():
                for side, position in sides.items():
                    _check_alive(joint, name, torque, side, position)


def _check_alive(joint: str, name: str, values: Array, other: str, moved: Array) -> None:
    if is_constant(values) and np.all(np.isfinite(moved)) and _moves(moved):
        raise LogError(
            f"the {name} of '{joint}' is {values[0]:.6g} all the time, while its {other} moves: a "
            "dead channel? Leave its column out of the log, or the joint out with joints=[...] of "
            "load_robot"
        )


def _moves(position: Array) -> bool:
    return bool(np.ptp(position) > _LEAST_RANGE * _noise(position))


def _noise(position: Array) -> float:
    """Return the standard deviation of white noise that second differences show."""
    return float(np.std(np.diff(position, 2)) / np.sqrt(6))
