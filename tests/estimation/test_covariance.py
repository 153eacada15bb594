"""Newey-West against processes whose long-run variance is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from seaid.arrays import Array
from seaid.estimation.covariance import LAG_S, newey_west

STEP_S = 0.05


def times(count: int) -> Array:
    return STEP_S * np.arange(count, dtype=np.float64)


def autoregressive(phi: float, count: int, seed: int) -> Array:
    """Return x[t] = phi x[t-1] + white noise of variance one, (count, 1)."""
    noise = np.random.default_rng(seed).normal(size=(count, 1))
    return np.asarray(lfilter([1.0], [1.0, -phi], noise, axis=0), dtype=np.float64)


def test_zero_lag_is_the_white_noise_formula() -> None:
    scores = np.random.default_rng(0).normal(size=(500, 3))
    found = newey_west(scores, times(500), np.zeros(500), lag_s=0.0)
    assert np.allclose(found, scores.T @ scores, rtol=1e-12)


def test_bartlett_sum_by_hand() -> None:
    x = np.array([1.0, 2.0, -1.0, 3.0])
    lag_0, lag_1, lag_2 = (float(x[lag:] @ x[: len(x) - lag]) for lag in range(3))
    expected = lag_0 + 2 * (2 / 3 * lag_1 + 1 / 3 * lag_2)
    found = newey_west(x[:, None], times(4), np.zeros(4), lag_s=2.01 * STEP_S)
    assert found == pytest.approx(np.array([[expected]]))


def test_result_is_symmetric_and_positive_semidefinite() -> None:
    scores = np.hstack([autoregressive(0.7, 400, seed) for seed in range(4)])
    found = newey_west(scores, times(400), np.zeros(400))
    assert np.array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > 0


@pytest.mark.parametrize("phi", [-0.4, 0.0, 0.5, 0.8])
def test_long_run_variance_of_an_autoregressive_process(phi: float) -> None:
    count, lags = 1_000_000, 60
    scores = autoregressive(phi, count, seed=1)
    found = newey_west(scores, times(count), np.zeros(count), lags * STEP_S + 1e-9)
    lag = np.arange(1, lags + 1)
    bartlett = 1 + 2 * np.sum((1 - lag / (lags + 1)) * phi**lag)
    assert found[0, 0] / count == pytest.approx(bartlett / (1 - phi**2), rel=0.03)
    assert found[0, 0] / count == pytest.approx(1 / (1 - phi) ** 2, rel=0.1)


def test_usual_lag_sees_most_of_a_correlation_of_a_tenth_of_a_second() -> None:
    count, phi = 100_000, np.exp(-STEP_S / 0.1)
    scores = autoregressive(phi, count, seed=2)
    exact = 1 / (1 - phi) ** 2
    white, corrected = (
        newey_west(scores, times(count), np.zeros(count), lag)[0, 0] / count for lag in (0.0, LAG_S)
    )
    assert white < 0.3 * exact
    assert 0.6 * exact < corrected < 1.05 * exact


def test_joints_of_one_instant_belong_together() -> None:
    common = np.random.default_rng(3).normal(size=(300, 1))
    both = np.vstack([common, common])
    found = newey_west(both, np.tile(times(300), 2), np.zeros(600), lag_s=0.0)
    assert found[0, 0] == pytest.approx(4 * float(common[:, 0] @ common[:, 0]))
    opposite = newey_west(
        np.vstack([common, -common]), np.tile(times(300), 2), np.zeros(600), lag_s=0.2
    )
    assert opposite[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_order_of_the_rows_does_not_matter() -> None:
    scores, run = autoregressive(0.5, 200, seed=4), np.repeat([0.0, 1.0], 100)
    time = np.tile(times(100), 2)
    shuffled = np.random.default_rng(5).permutation(200)
    expected = newey_west(scores, time, run)
    assert np.allclose(newey_west(scores[shuffled], time[shuffled], run[shuffled]), expected)


def test_runs_at_the_same_times_are_kept_apart() -> None:
    scores = autoregressive(0.5, 200, seed=6)
    time = np.tile(times(100), 2)
    halves = [
        newey_west(scores[part], times(100), np.zeros(100))
        for part in (slice(100), slice(100, 200))
    ]
    together = newey_west(scores, time, np.repeat([0.0, 1.0], 100))
    assert np.allclose(together, halves[0] + halves[1], rtol=1e-12)
    assert not np.allclose(newey_west(scores, time, np.zeros(200)), together, rtol=1e-3)


def test_instants_left_out_leave_a_gap_in_time() -> None:
    scores = autoregressive(0.5, 100, seed=7)
    kept = np.r_[0:40, 60:100]
    blanked = scores.copy()
    blanked[40:60] = 0.0
    expected = newey_west(blanked, times(100), np.zeros(100))
    found = newey_west(scores[kept], times(100)[kept], np.zeros(80))
    assert np.allclose(found, expected, rtol=1e-12)


def test_one_row_alone() -> None:
    found = newey_west(np.array([[2.0, 1.0]]), np.array([0.3]), np.zeros(1))
    assert np.allclose(found, [[4.0, 2.0], [2.0, 1.0]])
