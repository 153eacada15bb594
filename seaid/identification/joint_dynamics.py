"""What pulls at joints that are simulated along a motion, and the motions that their forces give.

At the joints pull the bodies and, against their motion, the drives: (8) is linearised along the
motion. A force on the joints, such as the residual of (8) or its derivative by a parameter, gives
their response (`response_to` of the plant), to which free motions from the initial states of each
window are added. The two simulators of `refine`, `motor_driven` and `command_driven`, are made of
this.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.log import Motion, low_pass
from seaid.log.filtering import spline_derivatives
from seaid.regressor.load import LoadModel, drive_torques
from seaid.robot import Robot, at_drives, at_joints
from seaid.simulation.plant import with_joints


def displaced(motion: Motion, joints: list[int], response: Array, weights: Array) -> Motion:
    """Return a motion with the columns of a response of its joints added, by weights (W, columns).

    There is a row of weights for each of the windows, which are equally long.
    """
    by_sample = np.repeat(weights, len(motion.time) // len(weights), axis=0)
    states = [
        state[:, joints] + np.einsum("tjc,tc->tj", part, by_sample)
        for state, part in zip(motion.joint_states, response, strict=True)
    ]
    return with_joints(motion, joints, states)


NUDGE = 1e-6
"""Change of a position [rad or m] and its derivatives for the slopes of torques of drives."""


def nudged(motion: Motion, order: int, motor: Array | float = 0.0) -> Motion:
    """Return a motion with a derivative of all joint positions changed by `NUDGE`.

    That of the motors changes by `motor` (n,) times as much. The torque of a drive depends on its
    own joint, so that one change of all joints at once gives all slopes, unless drives are coupled.
    """
    name = ("position", "velocity", "acceleration")[order]
    joint, turned = f"joint_{name}", f"motor_{name}"
    changes: dict[str, Any] = {
        joint: getattr(motion, joint) + NUDGE,
        turned: getattr(motion, turned) + NUDGE * np.asarray(motor),
    }
    return replace(motion, **changes)


def drive_slopes(
    known: Robot,
    motion: Motion,
    changed: Iterable[Motion],
    model: LoadModel,
    springs: Mapping[str, Array],
    load_side: Array,
) -> list[Array]:
    """Return minus the slopes (T, joints) of the torques of drives, by `nudged` motions."""
    unchanged = drive_torques(known, motion, model, springs, load_side)
    moved = (drive_torques(known, x, model, springs, load_side) for x in changed)
    return [(unchanged - torque) / NUDGE for torque in moved]


def finer_side(robot: Robot, motion: Motion) -> Motion:
    """Return the motion with stiff joints from the encoder with less acceleration noise."""
    q, v, a = (at_drives(robot.transmission, state).copy() for state in motion.joint_states)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if drive.is_elastic:
            continue
        if np.std(motion.motor_acceleration[:, index]) < drive.ratio * np.std(a[:, index]):
            turned = motion.motor_position[:, index] / drive.ratio
            # The encoder of the joint gives the mean, that of the motor the motion.
            q[:, index] = turned + np.mean(q[:, index] - turned)
            v[:, index] = motion.motor_velocity[:, index] / drive.ratio
            a[:, index] = motion.motor_acceleration[:, index] / drive.ratio
    q, v, a = (at_joints(robot.transmission, state) for state in (q, v, a))
    return replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a)


_START_BAND = 0.5
"""The first linearisation is about joint positions with this part of the cutoff."""


def smoothed(motion: Motion, joints: list[int]) -> Motion:
    """Return the motion with some joints low-passed, for the linearisation."""
    band = _START_BAND * motion.cutoff_hz
    smooth = low_pass(motion.joint_position[:, joints], motion.rate_hz, band)
    return with_joints(motion, joints, spline_derivatives(motion.time, smooth))
