"""Validation: what another motion says of a result."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import seaid
from seaid.identification.identification import identify, validate
from seaid.identification.result import Identification, Validation
from seaid.identification.validation import verdict_with
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, TEST_MASS, leg, leg_motion

pytestmark = pytest.mark.slow  # simulates the leg twice


@cache
def identified() -> Identification:
    robot = leg(TEST_MASS)
    return identify(robot, measure(robot, leg_motion(TEST_MASS), LEG_SENSORS, 0))


def validated(change: float = 1.0) -> Validation:
    """Validate on another motion, with the torques of one joint multiplied."""
    robot = leg(TEST_MASS)
    log = measure(robot, leg_motion(TEST_MASS, seed=1), LEG_SENSORS, 1)
    torque = np.array(log.motor_torque)
    torque[:, 0] *= change
    return validate(identified(), replace(log, motor_torque=torque))


def test_a_motion_that_is_predicted_changes_no_verdict() -> None:
    result = validated()
    assert result.warnings == ()
    assert str(verdict_with(identified(), [result])) == str(identified().verdict)


@pytest.mark.parametrize(
    ("change", "severity", "level"),
    [(-1.0, "wrong", "do not use"), (0.6, "doubtful", "usable with care")],
)
def test_a_motion_that_contradicts_does(change: float, severity: str, level: str) -> None:
    result = validated(change)
    (one,) = result.warnings
    assert (one.code, one.joint, one.severity) == ("unseen-motion", "hip_yaw", severity)
    expected = abs(1 - change) / abs(change)
    assert one.evidence["error"] == pytest.approx(expected, rel=0.1)
    assert verdict_with(identified(), [result]).level == level
    assert "unseen-motion" in result.summary()
    assert seaid.identification.verdict_with(identified(), [validated(), result]).level == level


def test_what_the_own_logs_do_not_explain_either_is_no_contradiction() -> None:
    robot = leg(TEST_MASS)
    log = measure(robot, leg_motion(TEST_MASS), LEG_SENSORS, 0)
    torque = np.array(log.motor_torque)
    torque[:, 0] = np.random.default_rng(0).permutation(torque[:, 0])
    noisy = replace(log, motor_torque=torque)
    found = identify(robot, noisy, torque_joints=robot.joint_names)
    assert all(one.joint != "hip_yaw" for one in validate(found, noisy).warnings)
