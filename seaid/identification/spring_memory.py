"""Hysteresis of springs in `refine`: its states are those along the measured deflections.

The simulated deflection has the noise of the inputs, which a spring and its load amplify, and a law
adds up what its argument travels: on an arm with a stiff and an elastic joint, widths along the
simulated deflections were 1 % large, twice to four times their standard errors, and half of the
iterations did not end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from seaid._arrays import Array, white_noise
from seaid.drives import MEMORY, states
from seaid.log import POSITION_BAND, Log, Motion, low_pass
from seaid.robot import Robot


def with_hysteresis(robot: Robot, joints: Sequence[str]) -> list[str]:
    """Return those of the joints whose spring has a law of hysteresis."""
    return [joint for joint in joints if {*robot.drives[joint].spring} & {*MEMORY}]


def deflections(robot: Robot, motion: Motion, joints: Sequence[str]) -> dict[str, Array]:
    """Return the deflection (T,) of each spring with hysteresis."""
    found = {}
    for joint in with_hysteresis(robot, joints):
        index, drive = robot.index(joint), robot.drives[joint]
        turned = drive.motor_radius / drive.ratio * motion.motor_position[:, index]
        found[joint] = turned - drive.load_radius * motion.joint_position[:, index]
    return found


def with_noise(
    robot: Robot,
    logs: Sequence[Log],
    motion: Motion,
    measured: Mapping[str, Array],
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return the measured deflections with noise as they have, that of the encoders, once more."""
    found, band_hz = {}, POSITION_BAND * motion.cutoff_hz
    for joint, own in measured.items():
        index, drive = robot.index(joint), robot.drives[joint]
        noise = max(
            np.hypot(
                drive.motor_radius / drive.ratio * white_noise(log.motor_position[:, index]),
                drive.load_radius * white_noise(log.joint_position[:, index]),
            )
            for log in logs
        )
        white = noise * rng.normal(size=(len(own), 1))
        found[joint] = own + low_pass(white, motion.rate_hz, band_hz)[:, 0]
    return found


def corrections(
    robot: Robot,
    motion: Motion,
    measured: Mapping[str, Array],
    columns: Mapping[str, int],
    x: Array,
) -> dict[str, Array]:
    """Return {joint: (T, 1 + p)}: torque at the joint and its derivatives by the parameters x.

    They are those by the states along the `measured` deflections, which begin before the motion and
    end with it, less those by the states along the motion, from zero at its first sample, which
    the equations of the drives have. `columns` {"parameter of joint": its place in x (p,)}.
    """
    found, length = {}, len(motion.time)
    for joint, own in deflections(robot, motion, list(measured)).items():
        drive = robot.drives[joint]
        law = next(term for term in drive.spring if term in MEMORY)
        places = [columns.get(f"hysteresis_{what} of {joint}") for what in ("force", "deflection")]
        width = drive.values["hysteresis_deflection"]
        force = drive.values["hysteresis_force"] if places[0] is None else x[places[0]]
        change = [
            there[-length:] - here
            for there, here in zip(
                states(law, measured[joint], width), states(law, own, width), strict=True
            )
        ]
        found[joint] = np.zeros((length, 1 + len(x)))
        found[joint][:, 0] = drive.load_radius * force * change[0]
        for place, slope in zip(places, (change[0], force * change[1]), strict=True):
            if place is not None:
                found[joint][:, 1 + place] = drive.load_radius * slope
    return found
