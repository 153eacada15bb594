"""Sharp terms behind the motors in `refine`: hysteresis of springs, and dry friction of joints.

Both are corrections {joint: (T, 1 + p)} of what the equations of the drives have at the samples of
the simulated motion: of the torque at the joint, and of its derivatives by the parameters.

States of hysteresis are those along the measured motion. The simulated joint has the noise of the
inputs, which a spring and its load amplify, and a law adds up what its argument travels: along the
simulated motion, widths were 1 % large on an arm with a stiff and an elastic joint, two to four
standard errors, and a third of the iterations did not end.

Dry friction is the mean about a sample of c sign(v), with the speed v linear in time. Its slope by
the speed lets a reversal move; with the sign at the samples alone bodies were 1.5 to 5 times worse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seaid._arrays import Array, white_noise
from seaid.drives import MEMORY, states
from seaid.log import POSITION_BAND, Log, Motion, low_pass
from seaid.robot import Robot


def with_hysteresis(robot: Robot, joints: Sequence[str]) -> list[str]:
    """Return those of the joints whose spring has a law of hysteresis."""
    return [joint for joint in joints if {*robot.drives[joint].spring} & {*MEMORY}]


def hysteresis_corrections(
    robot: Robot,
    joints: Sequence[str],
    motion: Motion,
    measured: Motion,
    columns: Mapping[str, int],
    x: Array,
) -> dict[str, Array]:
    """Return the corrections of springs at parameters x (p,).

    The states are those along the `measured` motion, which begins before the simulated one and ends
    with it, in place of those along the simulated `motion`, which are zero at its first sample.
    `columns` {"parameter of joint": place in x}.
    """
    found, length = {}, len(motion.time)
    for joint in with_hysteresis(robot, joints):
        drive = robot.drives[joint]
        law = next(term for term in drive.spring if term in MEMORY)
        place = columns.get(f"hysteresis_deflection of {joint}")
        width = drive.values["hysteresis_deflection"]
        there, here = (
            np.array(states(law, _deflection(robot, one, joint), width))[:, -length:]
            for one in (measured, motion)
        )
        state, by_width = drive.load_radius * (there - here)
        force, found[joint] = _linear(robot, joint, "hysteresis_force", state, columns, x)
        if place is not None:
            found[joint][:, 1 + place] = force * by_width
    return found


def friction_corrections(
    robot: Robot, joints: Sequence[str], motion: Motion, columns: Mapping[str, int], x: Array
) -> tuple[dict[str, Array], Array]:
    """Return the corrections of dry friction, and its slopes (T, joints) by the joint's speed."""
    found, slopes = {}, np.zeros((len(motion.time), len(joints)))
    for row, joint in enumerate(joints):
        if "coulomb" not in robot.drives[joint].joint_friction:
            continue
        index = robot.index(joint)
        speed = motion.joint_velocity[:, index]
        swept = 0.5 * np.abs(motion.joint_acceleration[:, index]) / motion.rate_hz
        swept = np.maximum(swept, _LEAST_RAD_S)
        change = np.sign(speed) - np.clip(speed / swept, -1.0, 1.0)
        friction, found[joint] = _linear(robot, joint, "joint_coulomb_friction", change, columns, x)
        slopes[:, row] = np.where(np.abs(speed) < swept, friction / swept, 0.0)
    return found, slopes


_LEAST_RAD_S = 1e-12
"""Change of speed from a sample to the next that counts as none."""


def _linear(
    robot: Robot, joint: str, name: str, unit: Array, columns: Mapping[str, int], x: Array
) -> tuple[float, Array]:
    """Return the value of a parameter, and the corrections by the torque (T,) of a `unit` of it."""
    place = columns.get(f"{name} of {joint}")
    value = robot.drives[joint].values[name] if place is None else float(x[place])
    found = np.zeros((len(unit), 1 + len(x)))
    found[:, 0] = value * unit
    if place is not None:
        found[:, 1 + place] = unit
    return value, found


def _deflection(robot: Robot, motion: Motion, joint: str) -> Array:
    index, drive = robot.index(joint), robot.drives[joint]
    turned = drive.motor_radius / drive.ratio * motion.motor_position[:, index]
    return np.asarray(turned - drive.load_radius * motion.joint_position[:, index])


def with_encoder_noise(
    robot: Robot, motion: Motion, logs: Sequence[Log], rng: np.random.Generator
) -> Motion:
    """Return a measured motion whose joint positions have the noise of both encoders once more."""
    noise = np.zeros_like(motion.joint_position)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        at_joint = drive.motor_radius / drive.ratio / drive.load_radius
        noise[:, index] = max(
            np.hypot(
                at_joint * white_noise(log.motor_position[:, index]),
                white_noise(log.joint_position[:, index]),
            )
            for log in logs
        )
    noise = noise * rng.normal(size=noise.shape)
    noise = low_pass(noise, motion.rate_hz, POSITION_BAND * motion.cutoff_hz)
    return replace(motion, joint_position=motion.joint_position + noise)
