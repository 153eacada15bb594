"""What a shifted zero of a joint encoder does to the load side (8)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from seaid.arrays import Array
from seaid.errors import IdentificationError
from seaid.motion import Motion
from seaid.regression import Regression
from seaid.robot import Robot
from seaid.sides.load_model import LoadModel
from seaid.sides.load_side import load_regression

ZERO_STEP = 1e-4
"""Shift [rad or m] of an encoder's zero for a difference quotient."""


_LARGEST_STD = 1e3
"""Of a zero [rad or m]: beyond it nothing is known of it, and its square may be no number."""


def check_zero_std(joint_zero_std: float) -> None:
    """Raise IdentificationError for a standard deviation of encoder zeros that is none."""
    if not 0 <= joint_zero_std <= _LARGEST_STD:
        raise IdentificationError(
            f"joint_zero_std must be from 0 to {_LARGEST_STD:g} rad or m, found {joint_zero_std}"
        )


def zero_sensitivity(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array], theta: Array
) -> Regression:
    """Return the load side with `carried` (R, n): what a shifted zero of each joint encoder does.

    It is minus the change of the computed torque, at the parameters `theta`, a unit of shift.
    """
    reference, changes = load_regression(robot, motion, model, springs), []
    for index in range(robot.n):
        shifted = load_regression(robot, shifted_zero(robot, motion, index), model, springs)
        change = (shifted.y - shifted.H @ theta) - (reference.y - reference.H @ theta)
        changes.append(change / ZERO_STEP)
    return replace(reference, carried=np.column_stack(changes))


def shifted_zero(robot: Robot, motion: Motion, index: int) -> Motion:
    """Return the motion with the zero of one joint's encoder shifted by a small step.

    The motors of springs go along: the deflection's own zero takes what the shift does to it.
    """
    joint, motor = motion.joint_position.copy(), motion.motor_position.copy()
    joint[:, index] += ZERO_STEP
    for name in robot.elastic_joints:
        other, drive = robot.index(name), robot.drivetrains[name]
        lever = drive.ratio * getattr(drive, "load_radius", 1.0) / getattr(drive, "motor_radius", 1)
        motor[:, other] += lever * robot.transmission[other, index] * ZERO_STEP
    return replace(motion, joint_position=joint, motor_position=motor)
