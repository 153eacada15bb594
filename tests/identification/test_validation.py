"""validate: errors of torques that a second motion measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.identification.identification import identify
from seaid.identification.repeated_identification import validate
from seaid.log.filtering import low_pass
from seaid.simulation.simulation import Noise, measure
from tests.experiments import (
    ARM_SENSORS,
    arm,
    arm_found,
    arm_log,
    arm_motion,
    arm_result,
    perfect_log,
)


def inside() -> slice:
    trim = round(1000.0 / arm_found().cutoff_hz)
    return slice(trim, -trim)


def test_unseen_motion_is_predicted() -> None:
    assert np.nanmax(arm_result().load.relative_error) < 0.05
    assert np.nanmax(arm_result().actuator.relative_error) < 0.10
    assert np.nanmin(arm_result().load.r_squared) > 0.995


def test_elastic_joints_have_an_actuator_side_and_stiff_ones_do_not() -> None:
    assert np.isfinite(arm_result().actuator.relative_error).tolist() == [False, True, True, False]
    assert np.all(np.isnan(arm_result().actuator.measured[:, [0, 3]]))
    assert np.all(np.isfinite(arm_result().load.relative_error))


def test_numbers_are_those_of_the_traces() -> None:
    for fit, joints in ((arm_result().actuator, (1, 2)), (arm_result().load, (0, 1, 2, 3))):
        for joint in joints:
            measured, computed = (x[inside(), joint] for x in (fit.measured, fit.computed))
            error = measured - computed
            rms = np.sqrt(np.mean(error**2))
            assert fit.rms_error[joint] == pytest.approx(rms)
            relative = rms / np.sqrt(np.mean(measured**2))
            assert fit.relative_error[joint] == pytest.approx(relative)
            assert fit.r_squared[joint] == pytest.approx(
                1 - np.var(error) / np.var(measured), abs=1e-3
            )


def test_measured_motor_torque_is_the_logs_in_the_pass_band() -> None:
    log = arm_log(2, motion_seed=5)
    smooth = low_pass(log.motor_torque, 1000.0, arm_found().cutoff_hz)
    assert arm_result().actuator.measured[inside(), 1] == pytest.approx(
        smooth[inside(), 1], abs=1e-12
    )


def test_ends_where_filters_swing_in_are_not_drawn_or_counted() -> None:
    trim = inside().start
    for trace in (arm_result().load.measured, arm_result().load.computed):
        assert np.all(np.isnan(trace[:trim]))
        assert np.all(np.isnan(trace[-trim:]))
        assert np.all(np.isfinite(trace[inside()]))


def test_raw_error_has_the_noise_that_the_pass_band_leaves_out() -> None:
    elastic = [1, 2]
    raw, smooth = arm_result().actuator.raw_relative_error, arm_result().actuator.relative_error
    assert np.all(raw[elastic] > smooth[elastic])
    quiet = replace(ARM_SENSORS, torque_std_Nm=0.0)
    silent = validate(arm_found(), measure(arm(), arm_motion(seed=5), quiet))
    assert np.all(silent.actuator.raw_relative_error[elastic] < raw[elastic])


def test_moving_error_leaves_standstill_out() -> None:
    for fit in (arm_result().actuator, arm_result().load):
        there = np.isfinite(fit.relative_error)
        assert np.all(fit.moving_relative_error[there] < 1.2 * fit.relative_error[there])
        assert np.array_equal(np.isfinite(fit.moving_relative_error), there)


def test_perfect_model_and_sensors_leave_almost_nothing() -> None:
    exact = identify(arm().without_nominal(), perfect_log(arm(), arm_motion()), cutoff_hz=20.0)
    fit = validate(exact, perfect_log(arm(), arm_motion(seed=5))).load
    assert np.max(fit.moving_relative_error) < 0.01


def test_wrong_parameters_show() -> None:
    wrong = replace(
        arm_found(),
        load_side=replace(arm_found().load_side, values=1.5 * arm_found().load_side.values),
    )
    log = arm_log(2, motion_seed=5)
    assert np.max(validate(wrong, log).load.relative_error) > 0.3


def test_other_encoder_zeros_of_the_motor_are_not_forgiven() -> None:
    """The offset belongs to one mounting: a log with other zeros is another robot."""
    log = measure(arm(), arm_motion(seed=5), Noise(motor_offset_rad=(0.0, 50.0, 0.0, 0.0)))
    assert validate(arm_found(), log).load.relative_error[1] > 0.3


def test_to_dict_has_null_where_there_is_no_equation() -> None:
    content = arm_result().to_dict()
    assert content["actuator"]["rail"]["relative_error"] is None
    assert content["load"]["rail"]["relative_error"] == float(arm_result().load.relative_error[0])
    assert list(content["load"]) == list(arm().joint_names)
    assert {"rms_error", "relative_error", "r_squared", "raw_relative_error"} <= set(
        content["load"]["wrist"]
    )


def test_log_that_does_not_fit_is_refused() -> None:
    log = perfect_log(arm(), arm_motion())
    with pytest.raises(LogError, match="the log has no joint rail"):
        validate(arm_found(), replace(log, joint_names=("a", "b", "c", "d")))
    nothing = np.full_like(log.motor_torque, np.nan)
    with pytest.raises(LogError, match="elastic joint 'shoulder' has no torque in the log"):
        validate(arm_found(), replace(log, motor_torque=nothing))
    with pytest.raises(LogError, match="too short"):
        validate(arm_found(), log.between(0.0, 0.5))
