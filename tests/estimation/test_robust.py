"""Robust estimates against truth, with and without outliers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from seaid._arrays import Array
from seaid.errors import ExcitationError, IdentificationError
from seaid.estimation.estimate import Estimate
from seaid.estimation.fitting import (
    ESTIMATORS,
    LinearEstimator,
    huber,
    huber_weights,
    tukey,
    tukey_weights,
)
from seaid.estimation.least_squares import ordinary, weighted
from seaid.identification.identification import identify
from seaid.regressor.regression import Regression
from tests.experiments import arm, arm_log, true_value
from tests.standard_errors import check_scores

Solver = Callable[[Regression], Estimate]

TRUTH = np.array([2.0, -1.0, 0.5])
ROBUST = pytest.mark.parametrize("estimator", [huber, tukey])


def experiment(
    seed: int, count: int = 1000, stds: tuple[float, ...] = (1.0,), phi: float = 0.0
) -> Regression:
    """Return rows of several joints with Gaussian noise, correlated in time with the columns."""
    rng = np.random.default_rng(seed)
    shape = (count, 4, len(stds))
    drawn = lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.normal(size=shape), axis=0)
    H = np.concatenate([drawn[:, :3, place] for place in range(len(stds))])
    noise = np.concatenate([std * drawn[:, 3, place] for place, std in enumerate(stds)])
    return Regression(
        names=("a", "b", "c"),
        units=("kg",) * 3,
        H=H,
        y=H @ TRUTH + noise,
        joint=np.repeat(np.arange(len(stds)), count),
        time=np.tile(0.05 * np.arange(count), len(stds)),
        run=np.zeros(len(H)),
        excluded=0,
        propagated=np.empty((len(H), 0)),
        joint_names=("hip", "knee", "ankle")[: len(stds)],
    )


def spoiled(data: Regression, share: float, seed: int = 0) -> Regression:
    """Return the rows with some of the targets gone off by thousands, mostly to one side."""
    rng = np.random.default_rng(seed)
    y = data.y.copy()
    bad = np.flatnonzero(rng.random(len(y)) < share)
    y[bad] += rng.uniform(-200.0, 1000.0, len(bad))
    return replace(data, y=y)


def scatter(estimator: Solver, runs: int, **setting: float) -> Array:
    return np.array([estimator(experiment(seed, **setting)).values for seed in range(runs)])  # type: ignore[arg-type]


@pytest.mark.slow  # 3.8 s
@ROBUST
def test_five_of_a_hundred_gaussian_rows_are_lost(estimator: Solver) -> None:
    """95 % efficiency: errors grow by 1 / sqrt(0.95)."""
    plain, robust = (np.std(scatter(one, 200, count=200) - TRUTH) for one in (ordinary, estimator))
    assert robust == pytest.approx(plain / np.sqrt(0.95), rel=0.025)


@pytest.mark.slow  # 10.6 s
@ROBUST
@pytest.mark.parametrize(("phi", "share"), [(0.0, 0.0), (0.8, 0.2)])
def test_errors_are_as_large_as_the_standard_errors_say(
    estimator: Solver, phi: float, share: float
) -> None:
    scores = []
    for seed in range(250):
        found = estimator(spoiled(experiment(seed, 2000, phi=phi), share, seed))
        scores.append((found.values - TRUTH) / found.standard_errors)
    check_scores(scores)


@ROBUST
def test_a_fifth_of_gross_outliers_by_the_thousand_does_little(estimator: Solver) -> None:
    data = spoiled(experiment(0, 10_000), 0.2)
    found = estimator(data)
    assert np.max(np.abs(ordinary(data).values - TRUTH)) > 2.0
    assert np.max(np.abs(weighted(data).values - TRUTH)) > 2.0
    assert np.all(np.abs(found.values - TRUTH) < 0.05)
    assert found.residual_std == pytest.approx(1.0, rel=0.4)  # that of the good rows


def test_tukey_forgets_what_huber_still_follows() -> None:
    """A saturated stretch: the torque stays low just where the motion asks for most."""
    data = experiment(1, 2000, phi=0.9)
    H = data.H + np.array([3.0, 0.0, 0.0])
    exact = H @ TRUTH
    y = np.minimum(exact, np.quantile(exact, 0.85)) + 0.1 * (data.y - data.H @ TRUTH)
    data = replace(data, H=H, y=y)
    errors = [np.max(np.abs(one(data).values - TRUTH)) for one in (ordinary, huber, tukey)]
    assert errors[0] > 0.05
    assert errors[1] < 0.3 * errors[0]
    assert errors[2] < 0.02


@pytest.mark.rounding
@ROBUST
def test_weights_solve_the_estimating_equation(estimator: Solver) -> None:
    """Sum of psi(u) / scale times row is zero, with the median of |residual| as scale."""
    data = spoiled(experiment(2, stds=(0.1, 5.0)), 0.1)
    at_huber = data.y - data.H @ huber(data).values
    of_joint = [1.4826 * np.median(np.abs(at_huber[data.joint == j])) for j in range(2)]
    scale = np.array(of_joint)[data.joint.astype(int)]
    u = (data.y - data.H @ estimator(data).values) / scale
    psi = u * (huber_weights if estimator is huber else tukey_weights)(u)
    size = np.linalg.norm(data.H / scale[:, None], axis=0)
    assert np.all(np.abs(data.H.T @ (psi / scale)) < 1e-3 * size)


@pytest.mark.slow  # 0.8 s
@ROBUST
def test_equations_have_their_own_scales(estimator: Solver) -> None:
    good = np.array([estimator(experiment(seed, 300, (0.1, 5.0))).values for seed in range(20)])
    alone = np.array([estimator(experiment(seed, 300, (0.1,))).values for seed in range(20)])
    assert np.std(good - TRUTH) < 1.1 * np.std(alone - TRUTH)


@pytest.mark.rounding
@ROBUST
@given(exponent=st.lists(st.integers(-6, 6), min_size=3, max_size=3))
def test_units_do_not_matter(estimator: Solver, exponent: list[int]) -> None:
    data, scale = spoiled(experiment(3, 200), 0.1), 10.0 ** np.array(exponent)
    plain, scaled = estimator(data), estimator(replace(data, H=data.H * scale))
    assert scaled.values * scale == pytest.approx(plain.values, rel=1e-5)
    assert scaled.standard_errors * scale == pytest.approx(plain.standard_errors, rel=1e-3)


@pytest.mark.rounding
@ROBUST
def test_exact_data_with_outliers_give_the_exact_answer(estimator: Solver) -> None:
    data = experiment(4)
    y = data.H @ TRUTH
    assert estimator(replace(data, y=y)).values == pytest.approx(TRUTH, rel=1e-10)
    y[::7] += 50.0
    assert estimator(replace(data, y=y)).values == pytest.approx(TRUTH, rel=1e-6)


@ROBUST
def test_what_is_carried_adds_what_targets_really_do(estimator: Solver) -> None:
    """Against the estimate from targets that are off by one standard deviation."""
    data = spoiled(experiment(5, 3000), 0.1)
    direction = data.H[:, :1] + 0.3 * data.H[:, 1:2] ** 2
    plain = estimator(data)
    once, carrying = (
        estimator(replace(data, propagated=direction), np.array([[size]]))  # type: ignore[call-arg]
        for size in (1e-4, 2e-4)
    )
    moved = estimator(replace(data, y=data.y + 0.01 * direction[:, 0])).values - plain.values
    added = carrying.covariance - once.covariance
    assert added == pytest.approx(np.outer(moved, moved), abs=0.08 * float(moved @ moved))
    assert np.all(carrying.white_standard_errors > plain.white_standard_errors)  # type: ignore[operator]


@ROBUST
def test_errors_are_those_of_least_squares(estimator: Solver) -> None:
    data = experiment(6)
    twice = replace(data, H=np.column_stack([data.H[:, :2], data.H[:, 0]]))
    with pytest.raises(ExcitationError, match=r"combination of .* is unidentifiable"):
        estimator(twice)
    with pytest.raises(IdentificationError, match="2 rows cannot determine 3 parameters"):
        estimator(replace(experiment(6, 2), joint_names=()))
    H = data.H.copy()
    H[5, 1] = np.nan
    with pytest.raises(IdentificationError, match="not finite: b"):
        estimator(replace(data, H=H))


def test_what_does_not_settle_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seaid.estimation.fitting._MOST_ITERATIONS", 2)
    with pytest.raises(IdentificationError, match=r"did not converge in 2 iterations: at .* s the"):
        huber(spoiled(experiment(7), 0.2))


@pytest.mark.slow  # 2.4 s
@pytest.mark.parametrize("name", ["huber", "tukey"])
def test_a_saturated_amplifier_in_a_log(name: LinearEstimator) -> None:
    """The torque sensor of one joint stands at a wrong value for a tenth of the log."""
    assert name in ESTIMATORS
    log = arm_log(0)
    torque = log.motor_torque.copy()
    torque[3000:3600, 1] = 3 * np.max(np.abs(torque[:, 1]))
    log, known = replace(log, motor_torque=torque), arm().without_nominal()
    joint = arm().joint_names[1]
    truth = true_value(arm(), joint, "stiffness")
    pair: tuple[LinearEstimator, LinearEstimator] = ("wls", name)
    plain, robust = (
        abs(estimate.drives[joint].value("stiffness") / truth - 1)
        for estimate in (identify(known, log, method="two-step", estimator=x) for x in pair)
    )
    assert plain > 0.1
    assert robust < 0.01


@pytest.mark.parametrize("name", ["huber", "tukey"])
def test_spikes_in_a_log(name: LinearEstimator) -> None:
    """One of a thousand samples of torque is a spike; the low pass smears it over its rows."""
    log = arm_log(0)
    torque, rng = log.motor_torque.copy(), np.random.default_rng(0)
    bad = rng.random(torque.shape) < 1e-3
    torque[bad] += (10 * np.std(torque, axis=0) * rng.choice([-1.0, 1.0], torque.shape))[bad]
    known = arm().without_nominal()
    spiky, clean = (
        identify(known, recorded, method="two-step", estimator=name)
        for recorded in (replace(log, motor_torque=torque), log)
    )
    for joint in known.elastic_joints:
        off = spiky.drives[joint].value("stiffness") / true_value(arm(), joint, "stiffness")
        assert off == pytest.approx(1.0, abs=0.05)
        assert spiky.checks[joint].condition_number < 3 * clean.checks[joint].condition_number
