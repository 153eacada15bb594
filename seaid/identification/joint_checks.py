"""What the logs show of each joint, in numbers: its motion, its encoders and its torques."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import FrozenMapping
from seaid.checks import Experiment, encoder_slope
from seaid.log import Motion


@dataclass(frozen=True)
class JointCheck:
    """What the logs say of one joint, NaN where they cannot.

    Attributes
    ----------
    swing : float
        Range of the position [rad or m].
    encoder_slope : float
        Motor angle per joint angle over the gear ratio: 1 for a right set-up.
    nominal, bodies, motor : float
        Share (rms) of the torque that is left by the bodies of the robot file, by any bodies, and
        by the motor equation (7) of a spring joint, where the motor moves: its friction at
        standstill is anything up to that of Coulomb.
    gear_ratio, gear_ratio_error : float
        Gear ratio between both encoders, without the deflection of a spring, and standard error.
    delay_s, delay_error_s : float
        Delay of the motor torque against the motion and its standard error.
    """

    swing: float
    encoder_slope: float
    nominal: float
    bodies: float
    motor: float
    gear_ratio: float = float("nan")
    gear_ratio_error: float = float("nan")
    delay_s: float = float("nan")
    delay_error_s: float = float("nan")


def joint_checks(experiment: Experiment, motions: Sequence[Motion]) -> Mapping[str, JointCheck]:
    """Return what the motions of an experiment say of each joint."""
    swings = np.max([np.ptp(motion.joint_position, axis=0) for motion in motions], axis=0)
    nothing, moving = (float("nan"), float("nan")), experiment.in_motion
    checks = {
        joint: JointCheck(
            float(swings[j]),
            encoder_slope(experiment, j) if experiment.both[j] else float("nan"),
            float(moving.nominal[j]),
            float(moving.free[j]),
            float(moving.of_motors[j]),
            *experiment.encoder_ratios.get(j, nothing),
            *experiment.torque_delays.get(j, nothing),
        )
        for j, joint in enumerate(experiment.robot.joint_names)
    }
    return FrozenMapping(checks, "joint")
