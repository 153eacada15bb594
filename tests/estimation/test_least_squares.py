"""Least squares against the textbook."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.checks.values import noise_findings
from seaid.errors import ExcitationError, IdentificationError
from seaid.estimation.fitting import ESTIMATORS, LinearEstimator
from seaid.estimation.least_squares import (
    equal_weights,
    extrapolated,
    ordinary,
    orthonormal,
    settled_weights,
    solve,
    weighted,
)
from seaid.estimation.qr_factor import QRFactor, qr_factor_of
from tests.estimation.rows import TRUTH, experiment, spoiled
from tests.plants import regression
from tests.standard_errors import check_scores


@pytest.mark.rounding
def test_ordinary_is_least_squares_with_the_condition_number_of_unit_columns() -> None:
    data = experiment(0)
    expected, squares = np.linalg.lstsq(data.H, data.y, rcond=None)[:2]
    found = ordinary(data)
    assert found.values == pytest.approx(expected, rel=1e-10)
    assert found.residual_std == pytest.approx(np.sqrt(squares[0] / len(data.y)))
    assert (found.names, found.units) == (("a", "b", "c"), ("kg",) * 3)
    # that of unit columns, by the angle between them
    H = np.array([[1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]) * [7.0, 1e-3]
    sine = np.sqrt(0.5)
    expected = np.sqrt((1 + sine) / (1 - sine))
    assert ordinary(regression(H, np.ones(3))).condition_number == pytest.approx(expected)


@pytest.mark.rounding
@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_is_exact_without_noise(name: LinearEstimator) -> None:
    H = experiment(0).H
    exact = ESTIMATORS[name].solve(regression(H, H @ TRUTH), None)
    assert exact.values == pytest.approx(TRUTH, rel=1e-12)


NOISE = [(name, 0.0, 0.0) for name in ESTIMATORS]
NOISE += [("ols", 0.8, 0.0), ("huber", 0.8, 0.2), ("tukey", 0.8, 0.2)]


@pytest.mark.slow  # 1,750 estimates
@pytest.mark.parametrize(("name", "phi", "share"), NOISE)
def test_every_estimator_is_inside_its_intervals_with_noise(
    name: LinearEstimator, phi: float, share: float
) -> None:
    """White noise, and noise that is correlated with outliers, which white errors do not cover."""
    scores, white = [], []
    for seed in range(250):
        rows = experiment(seed, (1.0,) if phi else (1.0, 3.0), 2000 if phi else 300, phi)
        found = ESTIMATORS[name].solve(spoiled(rows, share, seed), None)
        scores.append((found.values - TRUTH) / found.standard_errors)
        assert found.white_standard_errors is not None
        white.append((found.values - TRUTH) / found.white_standard_errors)
    check_scores(scores)
    assert (np.sqrt(np.mean(np.square(white))) > 1 / 0.75) == (phi > 0)


@pytest.mark.rounding
@pytest.mark.parametrize("name", ESTIMATORS)
@given(exponent=st.lists(st.integers(-6, 6), min_size=3, max_size=3))
def test_units_of_the_columns_do_not_matter(name: LinearEstimator, exponent: list[int]) -> None:
    """Values and errors of scaled columns are scaled; to what iterations of outliers reach."""
    data, scale = spoiled(experiment(1, count=200), 0.1), 10.0 ** np.array(exponent)
    solve_rows, is_iterated = ESTIMATORS[name].solve, name in ("huber", "tukey")
    plain, scaled = solve_rows(data, None), solve_rows(replace(data, H=data.H * scale), None)
    assert scaled.values * scale == pytest.approx(plain.values, rel=1e-5 if is_iterated else 1e-9)
    errors = pytest.approx(plain.standard_errors, rel=1e-3 if is_iterated else 1e-9)
    assert scaled.standard_errors * scale == errors
    assert scaled.condition_number == pytest.approx(plain.condition_number, rel=1e-3)


def test_weighted_is_the_textbook_with_the_weights_of_its_own_residuals() -> None:
    data = experiment(2, stds=(0.1, 1.0, 5.0))
    found = weighted(data)
    residual = data.y - data.H @ found.values
    std = np.array([np.sqrt(np.mean(residual[data.joint == j] ** 2)) for j in range(3)])
    whitened = 1 / std[data.joint.astype(int)]
    expected = np.linalg.lstsq(data.H * whitened[:, None], data.y * whitened, rcond=None)[0]
    assert found.values == pytest.approx(expected, rel=1e-6)
    assert std == pytest.approx([0.1, 1.0, 5.0], rel=0.15)


def test_errors_of_white_noise_are_those_of_the_textbook() -> None:
    """Of one joint, whose weighted estimate is the ordinary one."""
    ratios = []
    for seed in range(40):
        data = experiment(seed, count=2000)
        textbook = np.diag(np.linalg.inv(data.H.T @ data.H))
        found, equal = weighted(data), ordinary(data)
        assert found.white_standard_errors == pytest.approx(np.sqrt(textbook), rel=0.06)
        assert found.values == pytest.approx(equal.values, rel=1e-12)
        np.testing.assert_allclose(found.covariance, equal.covariance, rtol=1e-9)
        ratios.append(np.diag(found.covariance) / textbook)
    assert np.mean(ratios, axis=0) == pytest.approx(np.ones(3), abs=0.12)


def test_white_errors_know_that_joints_differ() -> None:
    """Unweighted rows of different noise: the textbook's sandwich, joint by joint."""
    data = experiment(2, stds=(0.1, 5.0))
    inverse = np.linalg.inv(data.H.T @ data.H)
    noise = np.where(data.joint == 0, 0.1, 5.0)
    expected = inverse @ (data.H.T * noise**2) @ data.H @ inverse
    found = ordinary(data).white_standard_errors
    assert found == pytest.approx(np.sqrt(np.diag(expected)), rel=0.1)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_what_is_carried_adds_what_targets_really_do(name: LinearEstimator) -> None:
    """Against the estimate from targets that are off by one standard deviation."""
    solve_rows, share = ESTIMATORS[name].solve, 0.1 * (name in ("huber", "tukey"))
    data = spoiled(experiment(5, count=3000), share)
    direction = data.H[:, :1] + 0.3 * data.H[:, 1:2] ** 2
    plain, moved = (
        solve_rows(replace(data, y=data.y + size * direction[:, 0]), None) for size in (0.0, 0.01)
    )
    once, carrying = (
        solve_rows(replace(data, propagated=direction), np.array([[size]])) for size in (1e-4, 2e-4)
    )
    change, added = moved.values - plain.values, carrying.covariance - once.covariance
    assert added == pytest.approx(np.outer(change, change), abs=0.08 * float(change @ change))
    assert plain.white_standard_errors is not None
    assert carrying.white_standard_errors is not None
    assert np.all(carrying.white_standard_errors > plain.white_standard_errors)


def test_what_propagated_columns_explain_is_not_noise_too() -> None:
    """A target that is off along a column has the errors of that column, and is noise once."""
    data = experiment(5)
    direction = np.sin(np.arange(len(data.y)) / 7.0)[:, None]
    rows_of = replace(data, propagated=direction, y=data.y + 10.0 * direction[:, 0])
    exact = ordinary(data).standard_errors
    slopes = 10.0 * np.linalg.lstsq(rows_of.H, direction[:, 0], rcond=None)[0]
    variances = np.diag(ordinary(rows_of, np.array([[100.0]])).covariance) - slopes**2
    assert np.sqrt(variances) == pytest.approx(exact, rel=0.05)
    noisy = ordinary(rows_of).standard_errors
    assert np.all(noisy > 2 * exact)
    # beyond three of its standard deviations, here 0.03 of 10, it is noise all the same
    sure = ordinary(rows_of, np.array([[1e-4]])).standard_errors
    assert sure == pytest.approx(noisy, rel=0.02)


def test_columns_with_noise_of_their_own_do_not_take_it_away() -> None:
    """y = k d with noise in d: the column d explains all of it, with a k of zero."""
    data = experiment(5)
    rows_of = replace(data, propagated=data.y[:, None] / 50.0)
    noise = ordinary(data).standard_errors
    found = ordinary(rows_of, np.array([[25.0]]))
    assert np.all(found.standard_errors > 0.9 * noise)


def test_few_independent_rows_are_flagged() -> None:
    rng = np.random.default_rng(0)
    data = regression(rng.normal(size=(7, 5)), rng.normal(size=7))
    (warning,) = noise_findings(ordinary(data))
    assert (warning.code, warning.severity) == ("few-rows", "doubtful")
    assert "5 parameters were estimated from" in warning.message
    assert not list(noise_findings(ordinary(experiment(5))))
    correlated = ordinary(experiment(5, count=3000, phi=0.7)).diagnostics
    assert correlated.independent_rows < 1500


@pytest.mark.rounding
def test_lost_columns_name_the_joint_whose_torque_they_are_in() -> None:
    """Joint 0 sees all columns, joint 1 those of the outer body, which look alike."""
    data = experiment(8, stds=(1.0, 1.0))
    H = data.H.copy()
    H[data.joint == 1, 0] = 0.0
    H[:, 2] = -H[:, 1]
    named = replace(data, H=H, joint_names=("hip", "knee"))
    with pytest.raises(ExcitationError, match=r"of b, c .* on the torque of knee; move"):
        ordinary(named)
    with pytest.raises(ExcitationError, match="on the torque of joint 1; move"):
        ordinary(replace(named, joint_names=()))
    # where motors and loads are solved at once, the motor's equation of joint i is number n + i
    with pytest.raises(ExcitationError, match="on the torque of motor of knee; move"):
        ordinary(replace(named, joint=named.joint + 2))


def test_joint_with_few_rows_gets_finite_errors() -> None:
    """Its weight grows with every turn, but not without bound."""
    data = experiment(10, stds=(1.0, 1.0))
    few = np.flatnonzero((data.joint == 0) | (data.time < 0.06))
    H = data.H[few].copy()
    H[data.joint[few] == 0, 0] = 0.0  # two rows of joint 1 are all that tells this parameter
    H[data.joint[few] == 1, 1:] = 0.0
    found = weighted(regression(H, data.y[few], joint=data.joint[few]))
    assert np.all(np.isfinite(found.covariance))


# Weights of equations by cheap turns: their residuals are those of the whole solution


def qr_factor(seed: int, badly: float = 1.0) -> QRFactor:
    """Return what four equations of 40 rows tell of six columns; the noise of each is its own."""
    rng = np.random.default_rng(seed)
    joint = np.repeat(np.arange(4), 40)
    H = rng.normal(size=(160, 6)) * np.logspace(0, 6, 6)
    H[:, 5] = 1e6 * H[:, 0] + badly * rng.normal(size=160)
    noise = np.array([0.1, 1.0, 10.0, 300.0])[joint] * rng.normal(size=160)
    y = H @ rng.normal(size=6) / np.logspace(0, 6, 6).sum() + noise
    return qr_factor_of(regression(H, y, joint=joint))


def weights_one_by_one(found: QRFactor) -> Array:
    weights = equal_weights(found)
    for _ in range(1000):
        std = found.residual_norms(solve(found, weights).values) / np.sqrt(found.counts)
        new = np.max(std) / std
        if np.allclose(new, weights, rtol=1e-6):
            return new
        weights = new
    raise AssertionError("not settled")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("badly", [1e6, 1.0])
def test_residuals_are_those_of_the_whole_solution(
    monkeypatch: pytest.MonkeyPatch, seed: int, badly: float
) -> None:
    found = qr_factor(seed, badly)
    cheap = orthonormal(found, solve(found, equal_weights(found)).values)
    assert cheap.products is not None
    assert np.sum(cheap.products, axis=0) == pytest.approx(np.eye(6), abs=1e-8)
    weights = np.random.default_rng(seed).uniform(1, 1000, 4)
    norms = cheap.residual_norms(weights)
    assert norms == pytest.approx(found.residual_norms(solve(found, weights).values), rel=1e-8)
    assert cheap.residual_norms(np.array([1.0, 1.0, 1.0, 1e5])) is None
    monkeypatch.setattr("seaid.estimation.least_squares._LARGEST_PRODUCTS", 4 * 6**2 - 1)
    large = orthonormal(found, solve(found, equal_weights(found)).values)
    assert large.products is None
    assert large.residual_norms(weights) == pytest.approx(norms, rel=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_weights_settle_where_they_did(seed: int) -> None:
    found = qr_factor(seed)
    assert settled_weights(found) == pytest.approx(weights_one_by_one(found), rel=1e-8)


def test_values_that_approach_an_end_geometrically_are_extrapolated_to_it() -> None:
    end, way = np.array([1.0, -2.0, 3.0]), np.array([0.5, 0.1, -2.0])
    assert extrapolated([end + way * 0.9**k for k in range(3)]) == pytest.approx(end, rel=1e-9)


def undriven(noise: float, seed: int = 0) -> QRFactor:
    """Return a driven equation, and one without a torque whose columns are noisy.

    The true parameters are ones; zero parameters satisfy the second equation exactly.
    """
    rng = np.random.default_rng(seed)
    own, shared = rng.normal(size=(2, 400))
    driven = np.column_stack([own, 0.3 * shared, np.zeros(400)])
    free = np.column_stack([np.zeros(400), shared, -shared])
    y = np.append(driven.sum(axis=1), np.zeros(400))
    H = np.vstack([driven, free]) + noise * rng.normal(size=(800, 3))
    joint = np.repeat([0.0, 1.0], 400)
    return qr_factor_of(regression(H, y + 1e-3 * rng.normal(size=800), joint=joint))


@pytest.mark.parametrize("noise", [0.01, 0.1, 0.3, 0.45])
def test_equation_without_a_torque_does_not_get_all_weight(noise: float) -> None:
    """Its weight made all parameters zero at noise of 0.3."""
    found = undriven(noise)
    weights = settled_weights(found)
    assert np.max(weights) < 2.5
    unweighted = solve(found, equal_weights(found)).values
    assert np.all(solve(found, weights).values > 0.4 * unweighted)
    if noise < 0.2:  # it does no harm: the weights are those of the residuals
        assert weights == pytest.approx(weights_one_by_one(found), rel=1e-8)


@pytest.mark.rounding
@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize(
    ("H", "words"),
    [
        (np.ones((2, 3)), "2 rows cannot determine 3 parameters: record"),
        (experiment(6).H * [1, 0, 1], "the motion does not excite b: move these joints"),
        (np.zeros((50, 3)), "does not excite a, b, c: move these joints"),
        (np.tile([1.0, 2.0, 3.0], (100, 1)), "combination of a, b, c is unidentifiable"),
        (
            experiment(6).H[:, [0, 1, 0]] * [1, 1, 3],
            r"of a, c is unidentifiable .*(a - 3 c|c - 0\.33 a); .*needed 1e-07.*torque_joints=",
        ),
        (np.where(np.arange(300)[:, None] == 5, [1, np.nan, 1], 0.0), "not finite: b"),
    ],
)
def test_every_estimator_names_what_rows_lack(name: LinearEstimator, H: Array, words: str) -> None:
    with pytest.raises((IdentificationError, ExcitationError), match=words):
        ESTIMATORS[name].solve(regression(H, np.linspace(1.0, 2.0, len(H))), None)
