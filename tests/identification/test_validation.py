"""validate: errors of torques that a second motion measures."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.identification import Identification, Validation, identify, validate, verdict_with
from seaid.identification.validation import compared
from seaid.log import row_samples
from seaid.regressor import motor_regressor
from seaid.regressor.regression import known_friction, known_load_friction
from seaid.simulation import Noise
from seaid.simulation.simulation import measure
from tests.experiments import (
    TEST_MASS,
    arm,
    arm_found,
    arm_motion,
    arm_result,
    leg,
    leg_log,
    perfect_log,
)
from tests.mistakes import with_channels


def test_unseen_motion_is_predicted() -> None:
    assert np.nanmax(arm_result().load.relative_error) < 0.05
    assert np.nanmax(arm_result().actuator.relative_error) < 0.10
    assert np.nanmin(arm_result().load.r_squared) > 0.995
    assert np.isfinite(arm_result().actuator.relative_error).tolist() == [False, True, True, False]
    assert np.all(np.isfinite(arm_result().load.relative_error))
    raw, elastic = arm_result().actuator.raw_relative_error, [1, 2]  # the noise is in it
    assert np.all(raw[elastic] > arm_result().actuator.relative_error[elastic])


def test_numbers_are_those_of_the_traces() -> None:
    """Without the ends of the log, where filters swing in."""
    trim = round(1000.0 / arm_found().cutoff_hz)
    inside = slice(trim, -trim)
    for fit, joints in ((arm_result().actuator, (1, 2)), (arm_result().load, (0, 1, 2, 3))):
        for joint in joints:
            counted = fit.counted[:, joint]
            measured, computed = (x[counted, joint] for x in (fit.measured, fit.computed))
            error = measured - computed
            rms = np.sqrt(np.mean(error**2))
            assert fit.rms_error[joint] == pytest.approx(rms)
            relative = rms / np.sqrt(np.mean(measured**2))
            assert fit.relative_error[joint] == pytest.approx(relative)
            assert fit.r_squared[joint] == pytest.approx(
                1 - np.var(error) / np.var(measured), abs=1e-3
            )
            measured, computed = (x[inside, joint] for x in (fit.measured, fit.computed))
            relative = np.linalg.norm(measured - computed) / np.linalg.norm(measured)
            assert fit.relative_error_with_standstill[joint] == pytest.approx(relative)
            assert fit.counted_share[joint] == pytest.approx(np.mean(counted[inside]))


def test_errors_count_the_samples_that_identification_uses() -> None:
    (motion,) = arm_found().motions
    rows, fits = row_samples(motion), compared(arm_found(), motion)
    # A row needs a fifth of its window only, so that fewer rows are excluded than samples.
    for joint in arm().elastic_joints:
        counted = fits.actuator.counted[rows, arm().index(joint)]
        known = known_friction(arm(), motion, joint, motor_regressor(arm(), joint))[rows]
        assert np.array_equal(counted, known == 1)
        assert 0 < arm_found().excluded[joint] <= np.sum(~counted)
    for joint in arm().joint_names:
        counted = fits.load.counted[rows, arm().index(joint)]
        known = known_load_friction(arm(), motion, arm().index(joint))
        assert np.all(known == 1) == (joint in arm().elastic_joints)
        assert np.array_equal(counted, known[rows] == 1)
    assert 0 < arm_found().excluded["load"] <= np.sum(~fits.load.counted[rows])
    for fit in (arm_result().actuator, arm_result().load):
        there = np.isfinite(fit.relative_error)
        assert np.all(fit.relative_error[there] < 1.2 * fit.relative_error_with_standstill[there])
        assert np.all(fit.counted_share[there] > 0.5)
        assert np.array_equal(np.isfinite(fit.counted_share), there)


def test_a_motor_that_never_moves_has_no_error() -> None:
    (motion,) = arm_found().motions
    velocity = motion.motor_velocity.copy()
    velocity[:, [1, 3]] = 0.0
    still = compared(arm_found(), replace(motion, motor_velocity=velocity))
    assert still.actuator.counted_share[1] == still.load.counted_share[3] == 0
    for fit, joint in ((still.actuator, 1), (still.load, 3)):
        for errors in (fit.relative_error, fit.rms_error, fit.r_squared, fit.raw_relative_error):
            assert np.isnan(errors[joint])
        assert fit.relative_error_with_standstill[joint] > 0
        assert np.isfinite(fit.whole_relative_error)


def test_other_encoder_zeros_of_the_motor_are_not_forgiven() -> None:
    """The offset belongs to one mounting: a log with other zeros is another robot."""
    log = measure(arm(), arm_motion(seed=5), Noise(motor_offset_rad=(0.0, 50.0, 0.0, 0.0)))
    assert validate(arm_found(), log).load.relative_error[1] > 0.3


def test_log_that_does_not_fit_is_refused() -> None:
    log = perfect_log(arm(), arm_motion())
    with pytest.raises(LogError, match="the log has no joint rail"):
        validate(arm_found(), replace(log, joint_names=("a", "b", "c", "d")))
    nothing = np.full_like(log.motor_torque, np.nan)
    with pytest.raises(LogError, match="elastic joint 'shoulder' has no torque in the log"):
        validate(arm_found(), replace(log, motor_torque=nothing))
    with pytest.raises(LogError, match="too short"):
        validate(arm_found(), log.between(0.0, 0.5))


# Validation: what another motion says of a result.


@cache
def identified() -> Identification:
    return identify(leg(TEST_MASS), leg_log(0))


def validated(change: float = 1.0) -> Validation:
    """Validate on another motion, with the torques of one joint multiplied."""
    log = with_channels(leg_log(motion_seed=1), "hip_yaw", motor_torque=lambda x: change * x)
    return validate(identified(), log)


@pytest.mark.slow  # simulates the leg twice
@pytest.mark.parametrize(
    ("change", "severity", "level"),
    [(-1.0, "wrong", "do not use"), (0.6, "doubtful", "usable with care")],
)
def test_a_motion_that_contradicts_does(change: float, severity: str, level: str) -> None:
    predicted, result = validated(), validated(change)
    assert predicted.warnings == ()
    assert str(verdict_with(identified(), [predicted])) == str(identified().verdict)
    (one,) = result.warnings
    assert (one.code, one.joint, one.severity) == ("unseen-motion", "hip_yaw", severity)
    expected = abs(1 - change) / abs(change)
    assert one.evidence["error"] == pytest.approx(expected, rel=0.1)
    assert verdict_with(identified(), [result]).level == level
    assert "unseen-motion" in result.summary()
    assert verdict_with(identified(), [predicted, result]).level == level


@pytest.mark.slow  # simulates the leg twice
def test_what_the_own_logs_do_not_explain_either_is_no_contradiction() -> None:
    noisy = with_channels(leg_log(0), "hip_yaw", motor_torque=np.random.default_rng(0).permutation)
    found = identify(leg(TEST_MASS), noisy, torque_joints=leg().joint_names)
    assert all(one.joint != "hip_yaw" for one in validate(found, noisy).warnings)
