"""One Gauss-Newton step: linear problems have it exactly; noise, priors and lost parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from seaid._arrays import Array
from seaid.errors import ExcitationError
from seaid.estimation.nonlinear_least_squares import (
    Residuals,
    _autocorrelation,
    fisher_covariance,
    gauss_newton_step,
    information,
    nuisance_draw,
    without_information,
)
from tests.standard_errors import check_scores

WINDOWS, BLOCKS, CHANNELS, P, OWN = 8, 50, 2, 3, 2
NAMES = ("a", "b", "c")
STDS = np.array([1.0, 0.01])
TRUTH = np.array([1.0, -2.0, 0.5])
NOTHING = np.zeros(P)


def problem(
    seed: int = 0, noise: float = 1.0, correlation: float = 0.0, blocks: int = BLOCKS
) -> Residuals:
    """Return residuals of a linear model at parameters zero: noise - J truth - nuisance."""
    rng = np.random.default_rng(seed)
    shape = (WINDOWS, blocks, CHANNELS)
    smooth = np.cumsum(rng.normal(size=(*shape, P)), axis=1) / 5
    nuisance = rng.normal(size=(*shape, OWN))
    own = rng.normal(size=(WINDOWS, OWN))
    white = rng.normal(size=(WINDOWS * blocks, CHANNELS))
    white[1:] *= np.sqrt(1 - correlation**2)
    coloured = lfilter([1.0], [1.0, -correlation], white, axis=0)
    residual = noise * STDS * coloured.reshape(shape)
    residual = residual - smooth @ TRUTH - np.einsum("wbcs,ws->wbc", nuisance, own)
    return Residuals(
        residual=residual,
        jacobian=smooth,
        nuisance=nuisance,
        kept=np.ones(shape, dtype=bool),
        time=np.linspace(0.0, 8.0, WINDOWS * blocks).reshape(WINDOWS, blocks),
        channels=range(CHANNELS),
    )


def whole(log: Residuals, stds: Array) -> tuple[Array, Array]:
    """Return the weighted regressor with every window's own columns written out, and residual."""
    weights = log.kept / stds
    columns = np.zeros((*log.residual.shape, P + WINDOWS * OWN))
    columns[..., :P] = log.jacobian
    for window in range(WINDOWS):
        start = P + window * OWN
        columns[window, ..., start : start + OWN] = log.nuisance[window]
    return (columns * weights[..., None]).reshape(-1, columns.shape[-1]), (
        log.residual * weights
    ).ravel()


@pytest.mark.rounding
def test_without_noise_the_step_goes_to_the_truth() -> None:
    step = gauss_newton_step([problem(noise=0.0)], NAMES, NOTHING, NOTHING)
    assert -step.change == pytest.approx(-TRUTH, rel=1e-9)


@pytest.mark.rounding
def test_step_is_that_of_the_whole_problem_weighted_by_the_noise_it_finds() -> None:
    log = problem()
    step = gauss_newton_step([log], NAMES, NOTHING, NOTHING)
    assert step.stds == pytest.approx(STDS, rel=0.1)
    H, r = whole(log, step.stds)
    expected = -np.linalg.lstsq(H, r, rcond=None)[0]
    assert step.change == pytest.approx(expected[:P], rel=1e-9)
    assert step.nuisance[0].ravel() == pytest.approx(expected[P:], rel=1e-9)


def test_bound_is_that_of_the_whole_problem() -> None:
    log = problem()
    H, _ = whole(log, STDS)
    expected = np.linalg.inv(H.T @ H)[:P, :P]
    assert fisher_covariance([log], NAMES, STDS, NOTHING) == pytest.approx(expected, rel=1e-8)


def test_rows_that_do_not_count_do_not_matter() -> None:
    log = problem()
    kept = log.kept.copy()
    kept[2, 10:20] = False
    wild = np.where(kept, log.residual, 1e3)
    one = gauss_newton_step([replace(log, kept=kept)], NAMES, NOTHING, NOTHING)
    other = gauss_newton_step([replace(log, kept=kept, residual=wild)], NAMES, NOTHING, NOTHING)
    assert np.array_equal(one.change, other.change)
    assert not np.array_equal(one.change, gauss_newton_step([log], NAMES, NOTHING, NOTHING).change)


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_a_nuisance_column_that_adds_nothing_takes_no_information(factor: float) -> None:
    """The QR factor of a column of zeros, or of a copy, once projected out some direction."""
    log = problem(blocks=5)
    wider = np.concatenate([log.nuisance, factor * log.nuisance[..., :1]], axis=3)
    wider = replace(log, nuisance=wider)
    bounds = [fisher_covariance([x], NAMES, STDS, NOTHING) for x in (log, wider)]
    np.testing.assert_allclose(bounds[1], bounds[0], rtol=1e-9)
    steps = [gauss_newton_step([x], NAMES, NOTHING, NOTHING) for x in (log, wider)]
    np.testing.assert_allclose(steps[1].change, steps[0].change, rtol=1e-6)
    np.testing.assert_allclose(steps[1].white_covariance, steps[0].white_covariance, rtol=1e-6)


def test_two_logs_know_more_than_one() -> None:
    logs = [problem(0), problem(1)]
    both = gauss_newton_step(logs, NAMES, NOTHING, NOTHING)
    for log in logs:
        alone = gauss_newton_step([log], NAMES, NOTHING, NOTHING)
        assert np.all(np.diag(both.white_covariance) < np.diag(alone.white_covariance))


def test_sharp_prior_holds_a_parameter_and_a_vague_one_does_not() -> None:
    log, distance = problem(), np.array([0.0, 0.3, 0.0])
    sharp = gauss_newton_step([log], NAMES, distance, np.array([0.0, 1e9, 0.0]))
    vague = gauss_newton_step([log], NAMES, distance, np.array([0.0, 1e-9, 0.0]))
    free = gauss_newton_step([log], NAMES, NOTHING, NOTHING)
    assert sharp.change[1] == pytest.approx(-0.3)
    assert np.sqrt(sharp.covariance[1, 1]) == pytest.approx(1e-9, rel=0.2)
    assert vague.change == pytest.approx(free.change, rel=1e-9)


def test_a_prior_alone_has_its_own_standard_deviation() -> None:
    """It was once enlarged by the degrees of freedom of the rows, which say nothing of it."""
    log = problem(blocks=5)
    blind = log.jacobian.copy()
    blind[..., 1] *= 1e-9
    step = gauss_newton_step([replace(log, jacobian=blind)], NAMES, NOTHING, np.array([0, 4.0, 0]))
    assert np.sqrt(step.covariance[1, 1]) == pytest.approx(0.25, rel=1e-6)


def test_rows_that_do_not_count_are_no_pairs() -> None:
    """The autocorrelation was once too small by the share of pairs that a gap takes."""
    noise = lfilter([0.6], [1.0, -0.8], np.random.default_rng(0).normal(size=40_000))
    gaps = np.where(np.arange(len(noise)) % 20 < 10, noise, 0.0)
    correlation = _autocorrelation(gaps, 6)
    whole = _autocorrelation(noise, 6)
    assert correlation == pytest.approx(whole, abs=0.03)
    assert correlation[2] == pytest.approx(0.8**3, abs=0.03)


def test_merit_counts_the_prior() -> None:
    log, precision = problem(), np.array([0.0, 2.0, 0.0])
    here = gauss_newton_step([log], NAMES, NOTHING, precision)
    away = gauss_newton_step([log], NAMES, np.array([0.0, 3.0, 0.0]), precision)
    assert away.merit - here.merit == pytest.approx(0.5 * (2.0 * 3.0) ** 2)


@pytest.mark.slow  # 250 searches
@pytest.mark.parametrize(("correlation", "blocks", "expected"), [(0.0, 50, 1.0), (0.6, 200, 1.05)])
def test_errors_are_as_large_as_the_standard_errors_say(
    correlation: float, blocks: int, expected: float
) -> None:
    """In correlated noise they are 5 % too small here, and right for ever longer windows."""
    scores, white = [], []
    for seed in range(250):
        log = problem(seed, correlation=correlation, blocks=blocks)
        step = gauss_newton_step([log], NAMES, NOTHING, NOTHING)
        scores.append((step.change - TRUTH) / np.sqrt(np.diag(step.covariance)))
        white.append((step.change - TRUTH) / np.sqrt(np.diag(step.white_covariance)))
    check_scores(scores, expected)
    assert (np.sqrt(np.mean(np.square(white))) > 1.5) == (correlation > 0)


@pytest.mark.rounding
def test_dead_column_and_lost_combination_are_named() -> None:
    log = problem()
    dead = log.jacobian.copy()
    dead[..., 1] = 0.0
    with pytest.raises(ExcitationError, match="does not excite b: move these joints"):
        gauss_newton_step([replace(log, jacobian=dead)], NAMES, NOTHING, NOTHING)
    lost = log.jacobian.copy()
    lost[..., 2] = -3 * lost[..., 0]
    with pytest.raises(ExcitationError, match="combination of a, c is unidentifiable"):
        gauss_newton_step([replace(log, jacobian=lost)], NAMES, NOTHING, NOTHING)


# Derivatives that contain estimated nuisance parameters.

RATE, SWINGS = 12.0, np.array([0.5, 0.3])


def swinging(seed: int, rate: float, swings: Array) -> Residuals:
    """Return free oscillations in white noise minus those at a rate and amplitudes (W, 2)."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, 50)
    noise = rng.normal(size=(len(swings), len(t)))
    waves, there = (np.stack([np.cos(x * t), np.sin(x * t)], axis=1) for x in (rate, RATE))
    slopes = t[:, None] * np.stack([-waves[:, 1], waves[:, 0]], axis=1)
    return Residuals(
        residual=(noise + there @ SWINGS - swings @ waves.T)[..., None],
        jacobian=-(swings @ slopes.T)[..., None, None],
        nuisance=np.broadcast_to(-waves[:, None], (len(swings), len(t), 1, 2)),
        kept=np.ones((len(swings), len(t), 1), dtype=bool),
        time=np.broadcast_to(t, (len(swings), len(t))),
        channels=range(1),
    )


@pytest.mark.slow  # 2400 steps: enough draws for a factor of 1.25
def test_noise_of_nuisance_parameters_in_the_derivatives_is_no_information() -> None:
    scores, before = [], []
    for seed in range(200):
        rate, swings = RATE, np.tile(SWINGS, (60, 1))
        for _ in range(12):
            log = swinging(seed, rate, swings)
            step = gauss_newton_step([log], ("rate",), np.zeros(1), np.zeros(1))
            rate, swings = rate + float(step.change[0]), swings + step.nuisance[0]
        log, noise = swinging(seed, rate, swings), np.zeros((1, 1))
        rng = np.random.default_rng(seed)
        for _ in range(4):
            moved = swinging(seed, rate, swings + nuisance_draw(log, step.stds, rng))
            random = replace(log, jacobian=moved.jacobian - log.jacobian)
            noise += information([random], step.stds) / 4
        right = without_information(step, noise)
        scores.append((rate - RATE) / np.sqrt(np.diag(right.covariance)))
        before.append((rate - RATE) / np.sqrt(np.diag(step.covariance)))
    check_scores(scores, band=1.25)
    assert np.sqrt(np.mean(np.square(before))) > 1.25


def test_some_information_always_counts() -> None:
    step = gauss_newton_step([problem()], NAMES, NOTHING, NOTHING)
    all_noise: Array = np.asarray(np.linalg.inv(step.white_covariance), dtype=float)
    right = without_information(step, 2 * all_noise)
    assert right.white_covariance == pytest.approx(100 * step.white_covariance, rel=1e-6)
    same = without_information(step, np.zeros((P, P)))
    assert same.covariance == pytest.approx(step.covariance, rel=1e-9)
