"""One Gauss-Newton step: linear problems have it exactly; noise, priors and lost parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from seaid._arrays import Array
from seaid.errors import ExcitationError, IdentificationError
from seaid.estimation import Parameter, Prior
from seaid.estimation.nonlinear_least_squares import (
    LAG_S,
    Point,
    Residuals,
    _autocorrelated_covariance,
    _autocorrelation,
    error_growth,
    gauss_newton_search,
    gauss_newton_step,
    information,
    nuisance_draw,
    separable_least_squares,
    without_information,
)
from tests.estimation.cramer_rao import fisher_covariance
from tests.standard_errors import check_scores

WINDOWS, BLOCKS, CHANNELS, P, OWN = 8, 50, 2, 3, 2
FREE = tuple(map(Parameter, "abc"))
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


def test_the_covariance_is_that_of_stationary_noise_in_each_channel() -> None:
    """By another route: x^T T x with the Toeplitz matrix of the autocorrelation of a channel."""
    log, rng = problem(), np.random.default_rng(0)
    t = np.arange(WINDOWS * BLOCKS)
    influence = np.column_stack([np.cos(0.05 * t), np.sin(0.3 * t)])
    noise = lfilter([1.0], [1.0, -0.8], rng.normal(size=(len(t), CHANNELS)), axis=0)
    step = float(np.median(np.diff(log.time.ravel())))
    expected = 0.0
    for x, of_channel in zip(influence.T, noise.T, strict=True):
        lags = _autocorrelation(of_channel, LAG_S / step)
        column = np.zeros(len(t))
        column[: len(lags) + 1] = [1.0, *lags]
        expected += x @ toeplitz(column) @ x
    found = _autocorrelated_covariance([log], influence.reshape(-1, 1), noise.ravel())
    assert expected > 2 * np.sum(influence**2)
    assert found.item() == pytest.approx(expected, rel=1e-9)


@pytest.mark.rounding
def test_step_is_that_of_the_whole_problem_weighted_by_the_noise_it_finds() -> None:
    """Its change, the states of the windows, and the bound; without noise it ends at the truth."""
    exact = gauss_newton_step([problem(noise=0.0)], FREE, NOTHING)
    assert exact.change == pytest.approx(TRUTH, rel=1e-9)
    log = problem()
    step = gauss_newton_step([log], FREE, NOTHING)
    assert step.stds == pytest.approx(STDS, rel=0.1)
    H, r = whole(log, step.stds)
    expected = -np.linalg.lstsq(H, r, rcond=None)[0]
    assert step.change == pytest.approx(expected[:P], rel=1e-9)
    assert step.nuisance[0].ravel() == pytest.approx(expected[P:], rel=1e-9)
    own = H[:, :P] - H[:, P:] @ np.linalg.lstsq(H[:, P:], H[:, :P], rcond=None)[0]
    condition = np.linalg.cond(own / np.linalg.norm(own, axis=0))
    assert step.condition_number == pytest.approx(condition, rel=1e-9)
    bound = np.linalg.inv(H.T @ H)[:P, :P]
    assert fisher_covariance([log], FREE, step.stds) == pytest.approx(bound, rel=1e-8)
    count, width = H.shape  # residuals are smaller than the noise: n / (n - p)
    assert step.white_covariance == pytest.approx(bound * count / (count - width), rel=1e-8)


def test_rows_that_do_not_count_do_not_matter_and_are_no_pairs() -> None:
    """The autocorrelation was once too small by the share of pairs that a gap takes."""
    log = problem()
    kept = log.kept.copy()
    kept[2, 10:20] = False
    wild = np.where(kept, log.residual, 1e3)
    one = gauss_newton_step([replace(log, kept=kept)], FREE, NOTHING)
    other = gauss_newton_step([replace(log, kept=kept, residual=wild)], FREE, NOTHING)
    assert np.array_equal(one.change, other.change)
    assert not np.array_equal(one.change, gauss_newton_step([log], FREE, NOTHING).change)
    noise = lfilter([0.6], [1.0, -0.8], np.random.default_rng(0).normal(size=40_000))
    gaps = np.where(np.arange(len(noise)) % 20 < 10, noise, 0.0)
    assert _autocorrelation(gaps, 6) == pytest.approx(_autocorrelation(noise, 6), abs=0.03)
    assert _autocorrelation(gaps, 6)[2] == pytest.approx(0.8**3, abs=0.03)


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_a_nuisance_column_that_adds_nothing_takes_no_information(factor: float) -> None:
    """The QR factor of a column of zeros, or of a copy, once projected out some direction."""
    log = problem(blocks=5)
    nuisance = np.concatenate([log.nuisance, factor * log.nuisance[..., :1]], axis=3)
    wider = replace(log, nuisance=nuisance)
    bounds = [fisher_covariance([x], FREE, STDS) for x in (log, wider)]
    np.testing.assert_allclose(bounds[1], bounds[0], rtol=1e-9)
    steps = [gauss_newton_step([x], FREE, NOTHING) for x in (log, wider)]
    np.testing.assert_allclose(steps[1].change, steps[0].change, rtol=1e-6)
    np.testing.assert_allclose(steps[1].white_covariance, steps[0].white_covariance, rtol=1e-6)


def with_prior(value: float, std: float) -> tuple[Parameter, ...]:
    """Return the parameters with a prior of the second one."""
    return (FREE[0], replace(FREE[1], prior=Prior(value, std)), FREE[2])


def test_sharp_prior_holds_a_parameter_and_a_vague_one_does_not() -> None:
    log = problem()
    sharp = gauss_newton_step([log], with_prior(-0.3, 1e-9), NOTHING)
    vague = gauss_newton_step([log], with_prior(-0.3, 1e9), NOTHING)
    free = gauss_newton_step([log], FREE, NOTHING)
    assert sharp.change[1] == pytest.approx(-0.3)
    assert np.sqrt(sharp.covariance[1, 1]) == pytest.approx(1e-9, rel=0.2)
    assert vague.change == pytest.approx(free.change, rel=1e-9)
    # alone it has its own standard deviation, whatever the degrees of freedom of the rows
    blind = log.jacobian * [1.0, 1e-9, 1.0]
    alone = gauss_newton_step([replace(log, jacobian=blind)], with_prior(0.0, 0.25), NOTHING)
    assert np.sqrt(alone.covariance[1, 1]) == pytest.approx(0.25, rel=1e-6)
    # the merit counts it
    near, away = (
        gauss_newton_step([log], with_prior(value, 0.5), NOTHING).merit for value in (0.0, -3.0)
    )
    assert away - near == pytest.approx(0.5 * (2.0 * 3.0) ** 2)


def test_a_parameter_at_its_bound_is_held_and_the_others_are_those_without_it() -> None:
    log = problem()
    bounded = (FREE[0], replace(FREE[1], lower=0.0), FREE[2])  # its true value is -2
    step = gauss_newton_step([log], bounded, NOTHING)
    alone = replace(log, jacobian=log.jacobian[..., [0, 2]])
    others = gauss_newton_step([alone], (FREE[0], FREE[2]), np.zeros(2))
    np.testing.assert_array_equal(step.change[[0, 2]], others.change)
    np.testing.assert_array_equal(step.covariance[np.ix_([0, 2], [0, 2])], others.covariance)
    assert step.change[1] == step.covariance[1, 1] == step.sizes[1] == 0.0


def test_errors_of_a_constant_are_those_of_a_change_of_it() -> None:
    log = problem()
    known = (FREE[0], replace(FREE[1], prior=Prior(0.0, 0.1), is_fixed=True), FREE[2])
    exact = (FREE[0], replace(FREE[1], is_fixed=True), FREE[2])
    step = gauss_newton_step([log], known, NOTHING)
    plain = gauss_newton_step([log], exact, NOTHING)
    H, _ = whole(log, step.stds)
    slope = -np.linalg.lstsq(np.delete(H, 1, axis=1), H[:, 1], rcond=None)[0]
    slope = np.array([slope[0], 1.0, slope[1]])
    expected = plain.covariance + 0.1**2 * np.outer(slope, slope)
    np.testing.assert_allclose(step.covariance, expected, rtol=1e-9)
    np.testing.assert_array_equal(step.change, plain.change)


@pytest.mark.slow  # 250 searches
@pytest.mark.parametrize(("correlation", "blocks", "expected"), [(0.0, 50, 1.0), (0.6, 200, 1.05)])
def test_errors_are_as_large_as_the_standard_errors_say(
    correlation: float, blocks: int, expected: float
) -> None:
    """In correlated noise they are 5 % too small here, and right for ever longer windows."""
    scores, white = [], []
    for seed in range(250):
        log = problem(seed, correlation=correlation, blocks=blocks)
        step = gauss_newton_step([log], FREE, NOTHING)
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
        gauss_newton_step([replace(log, jacobian=dead)], FREE, NOTHING)
    lost = log.jacobian.copy()
    lost[..., 2] = -3 * lost[..., 0]
    with pytest.raises(ExcitationError, match="combination of a, c is unidentifiable"):
        gauss_newton_step([replace(log, jacobian=lost)], FREE, NOTHING)


RATE, SWINGS = 12.0, np.array([0.5, 0.3])
RATE_ALONE = (Parameter("rate"),)


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


@pytest.mark.slow  # 1000 steps: enough draws for a factor of 1.25
def test_noise_of_nuisance_parameters_in_the_derivatives_is_no_information() -> None:
    scores, before = [], []
    for seed in range(200):
        rate, swings = RATE, np.tile(SWINGS, (60, 1))
        for _ in range(5):  # it starts from the truth
            log = swinging(seed, rate, swings)
            step = gauss_newton_step([log], RATE_ALONE, np.zeros(1))
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
    step = gauss_newton_step([problem()], FREE, NOTHING)
    all_noise: Array = np.asarray(np.linalg.inv(step.white_covariance), dtype=float)
    right = without_information(step, 2 * all_noise)
    assert right.white_covariance == pytest.approx(100 * step.white_covariance, rel=1e-6)
    same = without_information(step, np.zeros((P, P)))
    assert same.covariance == pytest.approx(step.covariance, rel=1e-9)


@pytest.mark.parametrize(
    ("value", "std"), [(math.nan, 1.0), (0.0, -1.0), (0.0, 0.0), (0.0, math.inf)]
)
def test_priors_and_bounds_without_a_meaning_are_refused(value: float, std: float) -> None:
    """A standard deviation that is not above zero, and bounds that leave no value."""
    with pytest.raises(IdentificationError, match="a standard deviation above zero, found"):
        Prior(value, std)
    with pytest.raises(IdentificationError, match="speed of knee leave no value"):
        Parameter("speed", "knee", lower=2.0, upper=1.0)


@dataclass(frozen=True, eq=False)
class Swings:
    """Free oscillations, whose rate is a parameter and whose amplitudes are those of windows."""

    rate: float
    swings: Array

    @cached_property
    def residuals(self) -> Residuals:
        if self.rate < 0:
            raise IdentificationError("a rate below zero diverges")
        return swinging(0, self.rate, self.swings)

    def moved(self, x: Array, part: float, nuisance: Array) -> Swings:
        return Swings(float(x[0]), self.swings + part * nuisance)


def swings_at(rate: float) -> Point[Swings]:
    log = Swings(rate, np.tile(0.5 * SWINGS, (60, 1)))
    return Point(RATE_ALONE, np.array([rate]), (log,)).settled()


@pytest.mark.slow  # 0.6 s
def test_a_search_ends_at_the_optimum_with_the_states_of_the_windows() -> None:
    end, is_stuck = gauss_newton_search(swings_at(10.5), 20, 1e-6)
    near, _ = gauss_newton_search(swings_at(RATE), 20, 1e-6)
    assert not is_stuck
    assert end.x == pytest.approx(near.x, abs=1e-5)
    assert end.size < 1e-6
    assert abs(end.x[0] - RATE) < 4 * np.sqrt(end.step.covariance[0, 0])


@dataclass(frozen=True, eq=False)
class Line:
    """The linear problem at parameters x, with a Jacobian of this sign."""

    x: Array
    sign: float = 1.0

    @property
    def residuals(self) -> Residuals:
        log = problem()
        return replace(
            log, residual=log.residual + log.jacobian @ self.x, jacobian=self.sign * log.jacobian
        )

    def moved(self, x: Array, part: float, nuisance: Array) -> Line:
        return replace(self, x=x)


def test_a_search_stays_within_its_bounds_and_stops_where_steps_do_not_improve() -> None:
    """A bound that excludes the true value of -2, and a Jacobian of the wrong sign."""
    bounded = (FREE[0], replace(FREE[1], lower=-1.0), FREE[2])
    end, is_stuck = gauss_newton_search(Point(bounded, NOTHING, (Line(NOTHING),)), 20, 1e-6)
    assert not is_stuck
    assert end.x[1] == -1.0
    assert end.size < 1e-6
    start = Point(FREE, NOTHING, (Line(NOTHING, sign=-1.0),))
    assert gauss_newton_search(start, 20, 1e-6) == (start, True)


# Variable projection: known curves recovered, gradient against differences

TIME = np.linspace(0.0, 10.0, 400)


def two_decays(truth: tuple[float, float, float], noise: float = 0.0, seed: int = 0):  # type: ignore[no-untyped-def]
    """Return columns and slopes of a + b exp(-v t), and the target."""
    a, b, v_0 = truth
    rng = np.random.default_rng(seed)
    target = a + b * np.exp(-v_0 * TIME) + noise * rng.normal(size=len(TIME))

    def columns(v: Array) -> tuple[Array, Array]:
        return target, np.column_stack([np.ones_like(TIME), np.exp(-v[0] * TIME)])

    def slopes(v: Array, theta: Array) -> Array:
        return np.asarray((-theta[1] * TIME * np.exp(-v[0] * TIME))[:, None])

    return columns, slopes


@pytest.mark.rounding
@given(st.floats(-2, 2), st.floats(0.5, 2), st.floats(0.1, 3.0))
@settings(derandomize=True, deadline=None)
def test_without_noise_the_truth_is_found(a: float, b: float, v: float) -> None:
    columns, slopes = two_decays((a, b, v))
    ((nonlinear, linear),) = separable_least_squares(
        columns, slopes, [np.array([0.5])], np.array([0.01]), np.array([10.0])
    )
    np.testing.assert_allclose(nonlinear, [v], rtol=1e-6)
    np.testing.assert_allclose(linear, [a, b], rtol=1e-5, atol=1e-6)


@pytest.mark.rounding
def test_the_best_of_several_starts_is_taken_on() -> None:
    """The optimum is that of a near start; a parameter without effect stays inside its bounds."""
    columns, slopes = two_decays((1.0, 2.0, 4.0), noise=0.05)
    bounds = np.array([1e-3]), np.array([50.0])
    far = [np.array([1e-3]), np.array([3.0]), np.array([50.0])]
    ((found, _),) = separable_least_squares(columns, slopes, far, *bounds)
    ((near, _),) = separable_least_squares(columns, slopes, [np.array([4.0])], *bounds)
    assert found == pytest.approx(near, rel=1e-6)
    assert found[0] == pytest.approx(4.0, rel=0.1)
    columns, slopes = two_decays((1.0, 0.0, 1.0))
    starts = [np.array([0.5])]
    (((without,), linear),) = separable_least_squares(columns, slopes, starts, *bounds)
    assert 1e-3 <= without <= 50.0
    assert np.all(np.isfinite(linear))


@pytest.mark.parametrize(("size", "growth"), [(2.0, (1.0, 1.1)), (0.02, (10.0, 100.0))])
def test_errors_are_those_of_tangents_where_the_misfit_is_a_parabola(
    size: float, growth: tuple[float, float]
) -> None:
    """That of the size of a decay in the noise, whose rate may be anything, is larger."""
    columns, slopes = two_decays((1.0, size, 1.0), noise=0.02)
    bounds = np.array([1e-3]), np.array([50.0])
    ((best, _),) = separable_least_squares(columns, slopes, [np.array([1.0])], *bounds)
    larger = error_growth(columns, slopes, [best, np.array([0.1]), np.array([5.0])], *bounds)
    assert growth[0] <= larger[1] < growth[1]


@pytest.mark.parametrize(("size", "rates"), [(2.0, [8.0]), (1.0, [5.0, 8.0])])
def test_the_optima_that_the_data_do_not_distinguish_are_returned(
    size: float, rates: list[float]
) -> None:
    """One of two waves in a target is the better optimum if it is larger; the best comes first."""
    rng = np.random.default_rng(0)
    target = size * np.sin(8.0 * TIME) + np.sin(5.0 * TIME) + 0.02 * rng.normal(size=len(TIME))

    def columns(v: Array) -> tuple[Array, Array]:
        return target, np.sin(v[0] * TIME)[:, None]

    def slopes(v: Array, theta: Array) -> Array:
        return np.asarray((theta[0] * TIME * np.cos(v[0] * TIME))[:, None])

    starts, bounds = [np.array([v]) for v in (4.9, 5.1, 7.9, 8.1)], np.array([[1.0], [20.0]])
    optima = separable_least_squares(columns, slopes, starts, *bounds)
    assert sorted(v[0] for v, _ in optima) == pytest.approx(rates, rel=0.05)
    misfits = [float(np.sum((target - np.sin(v[0] * TIME) * theta) ** 2)) for v, theta in optima]
    assert misfits == sorted(misfits)
