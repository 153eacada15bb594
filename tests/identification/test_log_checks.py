"""Torques with the wrong sign are said in words; right ones are not."""

from __future__ import annotations

from dataclasses import replace

import pytest

import seaid
from seaid.identification.identification import Identification
from seaid.identification.log_checks import sign_warnings
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
