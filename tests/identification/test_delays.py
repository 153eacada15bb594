"""Delays put into simulated logs: found again, and none found where there is none."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from seaid.checks.experiment import experiment_of
from seaid.errors import LogError
from seaid.identification import correct_delays, estimate_delays
from seaid.identification.delays import Delay
from seaid.log import Log
from seaid.log.motion import reconstruct_motions
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, leg, leg_motion
from tests.mistakes import with_channels
from tests.representatives import quick_first
from tests.standard_errors import check_scores


@cache
def known() -> Robot:
    return leg().without_nominal()


def late_log(late: dict[tuple[str, str], float], torque_std: float = 5e-4) -> Log:
    """Return a log of the leg at 500 Hz whose channels {(joint, field): s} are late."""
    motion = leg_motion()
    for (joint, field), delay in late.items():
        time = motion.time
        late_by = {field: lambda x, t=time, d=delay: CubicSpline(t, x)(t - d)}
        motion = with_channels(motion, joint, **late_by)
    log = measure(leg(), motion, replace(LEG_SENSORS, torque_std_Nm=torque_std), 0)
    if "joint_torque" in {field for _, field in late}:
        log = replace(log, joint_torque=motion.joint_torque)
    return at_500_hz(log)


def at_500_hz(log: Log) -> Log:
    """Return every second sample, after the first ones."""
    samples = np.arange(len(log.time))
    return log.at((samples >= 20) & (samples % 2 == 0))


def of(delays: tuple[Delay, ...], joint: str, channel: str) -> Delay:
    return next(one for one in delays if (one.joint, one.channel) == (joint, channel))


@pytest.mark.parametrize(
    ("joint", "delay"),
    quick_first([("knee_pitch", 0.0017), ("hip_roll", 0.008), ("ankle_pitch", -0.008)]),
)
def test_a_late_motor_position_is_found(joint: str, delay: float) -> None:
    found = estimate_delays(known(), late_log({(joint, "motor_position"): delay}))
    for one in found:
        if one.channel == "motor_position":
            expected = delay if one.joint == joint else 0.0
            assert one.delay_s == pytest.approx(expected, abs=5e-5)
            assert one.is_significant == (one.joint == joint)


@pytest.mark.parametrize(
    ("joint", "delay"),
    quick_first([("knee_pitch", 0.005), ("hip_pitch", 0.001), ("hip_roll", 0.02)]),
)
def test_a_late_torque_is_found_within_two_standard_errors(joint: str, delay: float) -> None:
    log = late_log({(joint, "motor_torque"): delay}, torque_std=5e-3)
    found = of(estimate_delays(known(), log), joint, "motor_torque")
    assert found.delay_s == pytest.approx(delay, abs=2 * found.standard_error_s)
    assert found.standard_error_s < 0.005
    experiment = experiment_of(known(), [reconstruct_motions(known(), log)])
    first, error = experiment.torque_delays[leg().index(joint)]
    assert first == pytest.approx(delay, abs=2 * error)
    assert error < 0.006


@pytest.mark.slow  # estimates of delays in long logs
def test_a_relation_that_explains_little_determines_no_delay() -> None:
    log = late_log({})
    noise = np.random.default_rng(0).normal(0.0, 5.0, log.motor_torque.shape)
    found = estimate_delays(known(), replace(log, motor_torque=log.motor_torque + noise))
    torques = [one for one in found if one.channel == "motor_torque"]
    assert [math.isinf(one.standard_error_s) for one in torques] == [True] * 5
    assert "not determined" in str(torques[0])


@pytest.mark.slow  # 60 estimates of ten delays
def test_errors_are_as_large_as_the_standard_errors_say() -> None:
    """Those of six seconds are a quarter too small."""
    scores = []
    for seed in range(60):
        plain = measure(leg(), leg_motion(), Noise(torque_std_Nm=5e-3), seed)
        noise = np.random.default_rng(seed).normal(size=(2, *plain.motor_position.shape))
        log = replace(
            plain,
            motor_position=plain.motor_position + 1e-3 * noise[0],
            joint_position=plain.joint_position + 1e-4 * noise[1],
        )
        found = estimate_delays(known(), at_500_hz(log))
        scores.append(np.array([one.delay_s / one.standard_error_s for one in found]))
    check_scores(scores, 1.3, band=1.2)


def test_a_torque_sensor_at_the_spring_tells_both() -> None:
    late = {("knee_pitch", "joint_torque"): 0.008}
    found = estimate_delays(known(), late_log(late))
    torque = of(found, "knee_pitch", "joint_torque")
    assert torque.delay_s == pytest.approx(0.008, abs=2e-4)
    motor = of(found, "knee_pitch", "motor_position")
    assert motor.against == "joint torque"
    assert not motor.is_significant
    assert not of(found, "ankle_pitch", "joint_torque").is_significant


@pytest.mark.slow  # estimates of delays in long logs
def test_the_corrected_log_is_shorter_and_says_why() -> None:
    late = late_log({("knee_pitch", "motor_position"): 0.008})
    repaired = correct_delays(late, estimate_delays(known(), late))
    true = late_log({})
    index = leg().index("knee_pitch")
    kept = np.isin(np.round(true.time, 6), np.round(repaired.time, 6))
    error = repaired.motor_position[:, index] - true.motor_position[kept, index]
    assert np.max(np.abs(error)) < 3 * 2 * np.pi / 2000
    assert 0.008 <= late.time[-1] - repaired.time[-1] < 0.011
    assert repaired.time[0] == late.time[0]
    assert len(repaired.report) == 1
    assert str(repaired.report[0]).startswith("knee_pitch.motor_position_rad: delay, 1 found")
    assert "8 ms late against the load on its spring" in str(repaired.report[0])
    assert np.array_equal(repaired.joint_position, late.joint_position[: len(repaired.time)])


@pytest.mark.slow  # estimates of delays in long logs
def test_a_delay_beyond_the_range_is_not_told() -> None:
    late = late_log({("knee_pitch", "motor_position"): 0.008})
    found = estimate_delays(known(), late, largest_s=0.005)
    assert math.isinf(of(found, "knee_pitch", "motor_position").standard_error_s)


def test_what_cannot_be_asked() -> None:
    log = late_log({})
    with pytest.raises(LogError, match="largest_s must be above 0 and below a tenth of the log"):
        estimate_delays(known(), log, largest_s=2.0)
    with pytest.raises(LogError, match="no joint of the log is named 'knee'; did you mean"):
        correct_delays(log, [Delay("knee", "motor_torque", "the motion", 0.01, 0.001)])
    with pytest.raises(LogError, match="no channel is named 'joint_torque'"):
        correct_delays(log, [Delay("knee_pitch", "joint_torque", "the motion", 0.01, 0.001)])
