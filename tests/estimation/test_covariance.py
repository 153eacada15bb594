"""Newey-West against processes whose long-run variance is known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.stats import t as student_t

from seaid._arrays import Array
from seaid.estimation.covariance import (
    automatic_lags,
    bartlett,
    correlated_rows,
    fixed_b,
    fixed_b_freedom,
    left_by_fit,
    left_of_mean,
    long_run_of,
)
from tests.representatives import quick_first

STEP_S = 0.05


def times(count: int) -> Array:
    return STEP_S * np.arange(count, dtype=np.float64)


def autoregressive(phi: float, count: int, seed: int) -> Array:
    """Return x[t] = phi x[t-1] + white noise of variance one, (count, 1)."""
    noise = np.random.default_rng(seed).normal(size=(count, 1))
    return np.asarray(lfilter([1.0], [1.0, -phi], noise, axis=0), dtype=np.float64)


def pairwise_sum(x: Array, time: Array, run: Array, lags: int) -> Array:
    """Return the Bartlett sum over all pairs of rows of a run, by how far apart they are."""
    apart = np.abs(time[:, None] - time) / STEP_S
    weights = np.maximum(1 - apart / (lags + 1), 0) * (run[:, None] == run)
    return np.asarray(x.T @ weights @ x)


@pytest.mark.rounding
@given(cuts=st.lists(st.integers(0, 100), max_size=6), lags=st.integers(0, 150))
@settings(max_examples=30)
def test_sums_of_chunks_are_the_textbook_formula(cuts: list[int], lags: int) -> None:
    """Of the whole, however it is cut."""
    x = np.random.default_rng(0).normal(size=(100, 3))
    parts = [x[begin:end] for begin, end in pairwise([0, *sorted(cuts), 100])]
    weighted, white = bartlett(parts, lags)
    expected = pairwise_sum(x, times(100), np.zeros(100), lags)
    assert np.allclose(weighted, expected, rtol=1e-10, atol=1e-10)
    assert np.allclose(white, x.T @ x, rtol=1e-12)


def test_fixed_b_is_normal_for_a_short_bandwidth_and_known_for_a_long_one() -> None:
    assert fixed_b(1e-9) == pytest.approx(1.96, abs=1e-6)
    assert fixed_b(1.0) == pytest.approx(4.814, abs=0.01)  # 1.96 + 2.97 + ...
    for b in (0.03, 0.1, 0.4):
        quantile = student_t.ppf(0.975, fixed_b_freedom(b)) / np.sqrt(left_of_mean(b))
        assert quantile == pytest.approx(fixed_b(b), rel=1e-6)
    assert fixed_b_freedom(1e-9) == 1e4
    # the bandwidth grows with the root of the length
    assert [automatic_lags(count) for count in (1, 2, 100, 10_000)] == [0, 1, 13, 130]


@pytest.mark.parametrize("bandwidth", [0.1, 0.3])
def test_corrected_intervals_of_a_mean_hold_the_truth_in_95_of_100(bandwidth: float) -> None:
    """The mean of white noise: without the correction too many of them miss."""
    x = np.random.default_rng(2).normal(size=(2000, 200))
    lags = round(bandwidth * 200) - 1
    held = {1.96: 0, fixed_b(bandwidth): 0}
    for sample in x:
        deviation = sample - sample.mean()
        variance = bartlett([deviation[:, None]], lags)[0][0, 0]
        for quantile in held:
            held[quantile] += abs(sample.sum()) < quantile * np.sqrt(variance)
    plain, corrected = (count / 2000 for count in held.values())
    assert 0.93 < corrected < 0.965
    assert plain < 0.93


@pytest.mark.parametrize("p", quick_first([5, 1]))
def test_the_fit_removes_its_part_of_the_variance(p: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """White noise behind slow columns: Bartlett sums of its residuals."""
    # of 125 instants the bandwidth has 15 lags, and of fewer ones 14
    H = np.hstack([autoregressive(0.9, 125, seed) for seed in range(p)])
    Q, _ = np.linalg.qr(H)
    x = H @ np.linalg.inv(H.T @ H)
    left = left_by_fit(x, Q, times(125), np.zeros(125))
    # the expected Bartlett sum of residuals, whose covariance is 1 - Q Q^T
    weights = toeplitz(np.maximum(1 - np.arange(125) / (automatic_lags(125) + 1), 0))
    sums = np.einsum("sp,st,tp->p", x, weights * (np.eye(125) - Q @ Q.T), x)
    assert left == pytest.approx(sums / np.sum(x**2, axis=0), rel=1e-9)
    assert np.all(left < 0.9)
    monkeypatch.setattr("seaid.estimation.covariance._NUMBERS", 20 * p**2)
    np.testing.assert_allclose(left_by_fit(x, Q, times(125), np.zeros(125)), left, rtol=1e-9)


@pytest.mark.parametrize("phi", [-0.4, 0.0, 0.5, 0.8])
def test_long_run_variance_of_an_autoregressive_process(phi: float) -> None:
    count = 1_000_000
    scores = autoregressive(phi, count, seed=1)
    found = long_run_of(scores, np.ones(count), times(count), np.zeros(count))
    assert found.lags == 1300
    assert found.covariance[0, 0] / count == pytest.approx(1 / (1 - phi) ** 2, rel=0.1)
    assert found.white[0, 0] / count == pytest.approx(1 / (1 - phi**2), rel=0.02)
    ratio = (1 + phi) / (1 - phi)
    assert found.inflation(np.eye(1)) == pytest.approx(ratio, rel=0.1)


def test_rows_in_any_order_are_paired_by_their_instants_within_a_run() -> None:
    """Two joints share each instant, two runs have the same times, and a gap is in both runs."""
    time, run = np.tile(times(100), 4), np.repeat([0.0, 1.0, 0.0, 1.0], 100)
    rows = np.random.default_rng(5).permutation(np.flatnonzero((time < 2.0) | (time > 2.9)))
    scores, time, run = autoregressive(0.5, 400, seed=6)[rows], time[rows], run[rows]
    expected = pairwise_sum(scores, time, run, 18) / left_of_mean(19 / 200)
    found = long_run_of(scores, np.ones(len(scores)), time, run)
    assert np.allclose(found.covariance / left_of_mean(found.bandwidth), expected, rtol=1e-12)
    weights = toeplitz(np.maximum(1 - np.arange(2000) / (0.3 * 2000), 0))
    assert left_of_mean(0.3) == pytest.approx(1 - np.mean(weights), rel=1e-4)


@pytest.mark.rounding
def test_one_row_and_no_residual_at_all() -> None:
    """Nothing is correlated with a single row, and noise that is not there inflates nothing."""
    found = long_run_of(np.array([[1.0, 0.5]]), np.full(1, 2.0), np.array([0.3]), np.zeros(1))
    assert found.lags == 0
    assert replace(found, lags=2).bandwidth == 1.0  # no part of a log is longer than it
    assert np.allclose(found.white, [[4.0, 2.0], [2.0, 1.0]])
    exact = long_run_of(np.ones((50, 2)), np.zeros(50), times(50), np.zeros(50))
    assert exact.inflation(np.eye(2)) == 1.0


@pytest.mark.parametrize(("phi", "bound"), [(0.0, 0.1), (0.6, 0.5), (-0.4, 0.1)])
def test_rows_per_independent_one_are_those_of_an_autoregression(phi: float, bound: float) -> None:
    """The long-run variance of x_t = phi x_t-1 + e_t over its variance is (1 + phi) / (1 - phi)."""
    errors = np.random.default_rng(0).normal(size=40_000)
    residual = lfilter([1.0], [1.0, -phi], errors)
    assert correlated_rows(residual) == pytest.approx((1 + phi) / (1 - phi), abs=bound)
    assert correlated_rows(residual + 3) == pytest.approx(correlated_rows(residual))
    assert correlated_rows(np.full(100, 3.0)) == 1.0
