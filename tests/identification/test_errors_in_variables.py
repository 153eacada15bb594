"""The spring from its measured torque: noise in torque and deflection, neither forgotten."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.drives import SeriesElasticDrive
from seaid.estimation import Estimate
from seaid.estimation.instrumental_variables import deflection_instruments, deming, instrumental
from seaid.estimation.least_squares import ordinary
from seaid.identification.drive_estimates import noise_ratio
from seaid.log import reconstruct_motion
from seaid.regressor import Regression
from tests.experiments import leg, leg_motion, perfect_log
from tests.plants import regression
from tests.representatives import quick_first
from tests.standard_errors import check_scores

STIFFNESS, OFFSET = 70.0, 1.5


def rows(torque_std: float, deflection_std: float, seed: int = 0, count: int = 2000) -> Regression:
    """Return (4b) of a spring under white noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(count, dtype=float) * 0.02
    d = 0.05 * np.sin(time) + 0.02 * np.sin(2.7 * time)
    torque = STIFFNESS * d + OFFSET + torque_std * rng.normal(size=count)
    H = np.column_stack([d + deflection_std * rng.normal(size=count), np.ones(count)])
    return regression(H, torque, names=("stiffness", "spring_offset"), time=time)


def spring_estimate(noisy: Regression, ratio: float) -> Estimate:
    """Return the estimate of (4b) with both noises."""
    return instrumental(noisy, deflection_instruments(noisy, ratio))


@given(st.integers(0, 2**32 - 1), st.floats(-3, 3), st.floats(0.01, 100.0))
@settings(derandomize=True, deadline=None)
def test_the_line_lies_between_both_regressions(seed: int, slope: float, ratio: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=50)
    y = slope * x + 0.5 * rng.normal(size=50)
    x, y = x - x.mean(), y - y.mean()
    ways = sorted([x @ y / (x @ x), y @ y / (x @ y)])
    assert ways[0] - 1e-9 <= deming(x, y, ratio) <= ways[1] + 1e-9
    assert deming(x, y, np.inf) == pytest.approx(x @ y / (x @ x))
    # The torque has much more noise, which once cancelled to a slope of zero.
    assert deming(x, y, 1e18) == pytest.approx(x @ y / (x @ x))
    assert deming(x, y, 1e-12) == pytest.approx(y @ y / (x @ y), rel=1e-6)
    assert deming(y, x, 1 / ratio) == pytest.approx(1 / deming(x, y, ratio))  # neither is special


@pytest.mark.slow  # 2.3 s
@pytest.mark.parametrize(
    ("torque_std", "deflection_std"), quick_first([(0.3, 0.02), (1.0, 0.005), (0.05, 0.03)])
)
def test_noise_in_both_leaves_the_stiffness_unbiased(
    torque_std: float, deflection_std: float
) -> None:
    ratio = (torque_std / deflection_std) ** 2
    found = [spring_estimate(rows(torque_std, deflection_std, seed), ratio) for seed in range(400)]
    values = np.array([one.value("stiffness") for one in found])
    error = np.std(values) / np.sqrt(len(values))
    assert abs(np.mean(values) - STIFFNESS) < 3.5 * error
    truth = np.array([STIFFNESS, OFFSET])
    check_scores([(one.values - truth) / one.standard_errors for one in found])
    offsets = [one.value("spring_offset") for one in found]
    assert np.mean(offsets) == pytest.approx(OFFSET, abs=0.05)


def test_an_exact_deflection_is_plain_least_squares() -> None:
    noisy = rows(0.5, 0.0)
    plain, both = ordinary(noisy), spring_estimate(noisy, np.inf)
    np.testing.assert_allclose(both.values, plain.values, rtol=1e-9)


@pytest.mark.slow  # a hundred estimates
def test_the_ratio_is_read_from_the_spectra_above_the_pass_band() -> None:
    robot, motion = leg(), leg_motion()
    joint, rng = "knee_pitch", np.random.default_rng(3)
    drive = robot.drives[joint]
    assert isinstance(drive, SeriesElasticDrive)
    shape = motion.joint_torque.shape
    steps = rng.normal(size=shape) * 1e-3
    log = perfect_log(robot, motion)
    torque = motion.joint_torque + 0.5 * rng.normal(size=shape)
    sensed = replace(log, joint_torque=torque, joint_position=log.joint_position + steps)
    dataset = reconstruct_motion(robot, sensed, 6.0)
    force_noise = 0.5 / drive.load_radius
    deflection_noise = 1e-3 * drive.load_radius
    expected = (force_noise / deflection_noise) ** 2
    assert noise_ratio(robot, [dataset], joint) == pytest.approx(expected, rel=0.4)
