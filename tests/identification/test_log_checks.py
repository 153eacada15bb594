"""Torques with the wrong sign are said in words; right ones are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from seaid.identification.log_checks import sign_warnings, unused_findings

import seaid
from seaid.identification.identification import Identification
from seaid.log.reading import Log
from seaid.robot.robot import Robot
from seaid.simulation.simulation import measure
from tests.experiments import ARM_SENSORS, LEG_SENSORS, arm, arm_motion, leg, leg_motion


def identified(robot: Robot, log: Log, *flipped: str) -> Identification:
    torque = log.motor_torque.copy()
    for joint in flipped:
        torque[:, robot.index(joint)] *= -1
    return seaid.identify(robot, replace(log, motor_torque=torque))


def leg_log(seed: int = 1) -> Log:
    return measure(leg(), leg_motion(), LEG_SENSORS, seed)


def arm_log(seed: int = 1) -> Log:
    return measure(arm(), arm_motion(), ARM_SENSORS, seed)


@pytest.mark.parametrize("seed", range(3))
def test_right_signs_are_not_flagged(seed: int) -> None:
    for robot, log in ((leg(), leg_log(seed)), (arm(), arm_log(seed))):
        assert sign_warnings(identified(robot, log)) == ()
        assert sign_warnings(identified(robot.without_nominal(), log)) == ()


@pytest.mark.parametrize("joint", ["hip_pitch", "knee_pitch", "ankle_pitch"])
def test_one_flipped_torque_at_a_spring_is_flagged(joint: str) -> None:
    flags = sign_warnings(identified(leg().without_nominal(), leg_log(), joint))
    assert [str(flag).split(" looks")[0] for flag in flags] == [f"the torque of {joint}"]


def test_friction_and_gravity_with_a_minus_are_said() -> None:
    found = identified(leg(), leg_log(), *leg().joint_names)
    flags = sign_warnings(found)
    assert len(flags) == 5
    assert str(flags[0]) == (
        "the torque of hip_yaw looks flipped: the estimates of viscous friction, Coulomb friction, "
        "inertia and gravity are all negative; compare the sign of its torque column with that of "
        "its position"
    )
    assert set(flags) < set(found.warnings)


def test_without_masses_inertia_tells_instead_of_gravity() -> None:
    flags = sign_warnings(identified(arm().without_nominal(), arm_log(), *arm().joint_names))
    assert len(flags) == 4
    assert "inertia" in str(flags[0])
    assert not any("gravity" in str(flag) for flag in flags)


def with_sensed_torque(joint: str, *, only: bool) -> Log:
    """Return the leg's log with the measured torque of a joint too, or `only` with this."""
    log, motion, index = leg_log(), leg_motion(), leg().index(joint)
    sensed, motor = np.full_like(log.joint_position, np.nan), log.motor_torque.copy()
    noise = 0.1 * np.random.default_rng(0).normal(size=len(log.time))
    sensed[:, index] = motion.joint_torque[:, leg().index("knee_pitch")] + noise
    if only:
        motor[:, index] = np.nan
    return replace(log, joint_torque=sensed, motor_torque=motor)


def test_friction_that_a_log_cannot_identify_is_said() -> None:
    found = seaid.identify(leg(), with_sensed_torque("knee_pitch", only=True))
    assert [str(one) for one in unused_findings(found)] == [
        "the log has the joint torque of knee_pitch and not its motor torque, which alone would "
        "identify viscous friction, coulomb friction"
    ]
    assert set(unused_findings(found)) < set(found.warnings)
    assert found.drives["knee_pitch"].names == ("stiffness", "spring_offset")


def test_a_channel_in_no_equation_is_said() -> None:
    assert unused_findings(seaid.identify(leg(), leg_log())) == ()
    assert (
        unused_findings(seaid.identify(leg(), with_sensed_torque("knee_pitch", only=False))) == ()
    )
    log = with_sensed_torque("hip_roll", only=False)
    log = replace(log, motor_current=20.0 * log.motor_torque)
    names = "hip_yaw, hip_roll, hip_pitch, knee_pitch, ankle_pitch"
    findings = unused_findings(seaid.identify(leg(), log))
    assert [(one.code, one.joint, str(one)) for one in findings] == [
        ("unused-channel", "", f"the motor current of {names} is in the log and in no equation"),
        (
            "unused-channel",
            "hip_roll",
            "the joint torque of hip_roll is in the log and in no equation",
        ),
    ]
