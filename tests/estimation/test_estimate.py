"""Estimate: intervals, parts, names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from seaid._arrays import Array
from seaid.errors import IdentificationError, SeaidError
from seaid.estimation.estimate import (
    Estimate,
    independent_rows,
    poorly_determined,
    term_test,
    whiteness,
)
from seaid.estimation.least_squares import ordinary
from seaid.estimation.qr_factor import directions, qr_factor_of
from seaid.regressor.regression import Regression
from tests.plants import regression

COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 2.0], [0.0, 2.0, 1.0]])
FOUND = Estimate(
    names=("a", "b", "c"),
    values=np.array([10.0, -3.0, 0.0]),
    covariance=COVARIANCE,
    units=("kg", "m", "s"),
    residual_std=0.1,
    condition_number=3.0,
)


def test_standard_errors_are_roots_of_the_diagonal() -> None:
    assert FOUND.standard_errors == pytest.approx([2.0, 3.0, 1.0])
    assert FOUND.relative_standard_errors == pytest.approx([0.2, 1.0, np.inf])


@pytest.mark.parametrize(("level", "half_width"), [(0.95, 1.959964), (0.5, 0.674490)])
def test_intervals_are_those_of_the_normal_distribution(level: float, half_width: float) -> None:
    interval = FOUND.interval(level)
    assert interval.shape == (3, 2)
    assert interval.mean(axis=1) == pytest.approx(FOUND.values)
    assert interval[:, 1] - FOUND.values == pytest.approx(half_width * FOUND.standard_errors)


def test_few_degrees_of_freedom_make_intervals_wider_and_errors_not() -> None:
    few = replace(FOUND, degrees_of_freedom=np.array([4.0, 30.0, np.inf]))
    half = few.interval()[:, 1] - few.values
    assert half / few.standard_errors == pytest.approx([2.7764, 2.0423, 1.9600], abs=1e-4)
    assert few.part([2, 0], ["c", "a"]).degrees_of_freedom == pytest.approx([np.inf, 4.0])
    assert few.standard_errors == pytest.approx(FOUND.standard_errors)


def test_further_values_have_the_errors_of_those_that_they_contain() -> None:
    """d = 2 a - c + e: its covariance with all is that of the linear function, plus that of e."""
    further = Estimate(("d",), np.array([20.0]), np.array([[0.25]]), ("kg",), 0.2, 1.0)
    whole = FOUND.with_further(further, ["a", "c"], np.array([[2.0, -1.0]]))
    J = np.vstack([np.eye(3), [2.0, 0.0, -1.0]])
    own = np.diag([0.0, 0.0, 0.0, 0.25])
    assert whole.names == ("a", "b", "c", "d")
    assert whole.covariance == pytest.approx(J @ COVARIANCE @ J.T + own)
    assert whole.values == pytest.approx([10.0, -3.0, 0.0, 20.0])


def test_functions_of_values_have_their_errors_by_the_slopes() -> None:
    """(a, b, c) -> (a b, b, c - b), with the noise of white errors apart from that of all."""
    white = replace(FOUND, white_standard_errors=np.array([1.0, 2.0, 0.5]))
    slopes = np.array([[-3.0, 10.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    changed = white.transformed(np.array([-30.0, -3.0, 3.0]), slopes)
    assert changed.values == pytest.approx([-30.0, -3.0, 3.0])
    assert changed.covariance == pytest.approx(slopes @ COVARIANCE @ slopes.T)
    assert changed.white_standard_errors == pytest.approx(
        [np.hypot(3.0, 20.0), 2.0, np.hypot(2.0, 0.5)]
    )


@pytest.mark.parametrize("level", [0.0, 1.0, -0.5, 95.0])
def test_impossible_level_is_refused(level: float) -> None:
    with pytest.raises(SeaidError, match="level must be between 0 and 1"):
        FOUND.interval(level)


def test_part_keeps_values_units_and_their_covariance() -> None:
    part = FOUND.part([2, 1], ["z", "y"])
    assert part.names == ("z", "y")
    assert part.units == ("s", "m")
    assert part.values.tolist() == [0.0, -3.0]
    assert part.covariance.tolist() == [[1.0, 2.0], [2.0, 9.0]]


def test_value_and_standard_error_by_name() -> None:
    assert FOUND.value("b") == -3.0
    assert FOUND.standard_error("b") == 3.0


def test_unknown_name_lists_what_is_there() -> None:
    with pytest.raises(SeaidError, match="no parameter is named 'd'; allowed: a, b, c"):
        FOUND.value("d")


def test_shapes_are_checked_and_arrays_read_only() -> None:
    with pytest.raises(SeaidError, match="values must have shape"):
        Estimate(("a",), np.zeros(2), np.eye(1), ("kg",), 0.0, 1.0)
    with pytest.raises(SeaidError, match="covariance must have shape"):
        Estimate(("a",), np.zeros(1), np.eye(2), ("kg",), 0.0, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        FOUND.values[0] = 1.0


# Checks of an estimate against textbook formulas and known truth

ONE = np.ones(1)


def noisy(seed: int, truth: tuple[float, ...] = (2.0, -1.0, 0.0), count: int = 200) -> Regression:
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(count, len(truth)))
    return regression(H, H @ truth + rng.normal(size=count))


def slow(rng: np.random.Generator, count: int) -> Array:
    return np.asarray(lfilter([1.0], [1.0, -0.8], rng.normal(size=(count, 1)), axis=0))


@pytest.mark.rounding
def test_f_and_bic_are_those_of_two_fits() -> None:
    rows = noisy(0)
    squares = [
        float(np.linalg.lstsq(H, rows.y, rcond=None)[1][0]) for H in (rows.H, rows.H[:, [0]])
    ]
    found = term_test(qr_factor_of(rows), ONE, ["b", "c"])
    assert found.growth == pytest.approx(squares[1] / squares[0], rel=1e-10)
    assert pytest.approx((squares[1] - squares[0]) / 2 / (squares[0] / 197), rel=1e-9) == found.F
    bic = [
        200 * np.log(square / 200) + p * np.log(200)
        for square, p in zip(squares, (3, 1), strict=True)
    ]
    assert found.bic == pytest.approx(bic[1] - bic[0], rel=1e-9)
    assert found.terms == ("b", "c")


def test_superfluous_term_is_rejected_at_the_rate_of_the_test() -> None:
    p_values = [term_test(qr_factor_of(noisy(seed)), ONE, ["c"]).p_value for seed in range(900)]
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=0.03)
    needed = term_test(qr_factor_of(noisy(0)), ONE, ["b"])
    assert needed.p_value < 1e-9
    assert (
        needed.bic
        > 10
        > 0
        > np.median([term_test(qr_factor_of(noisy(seed)), ONE, ["c"]).bic for seed in range(20)])
    )


@pytest.mark.slow  # 600 estimates
def test_effective_rows_keep_the_rate_under_autocorrelation() -> None:
    """Taken as independent, correlated rows find terms that are not there."""
    naive, corrected = [], []
    for seed in range(600):
        rng = np.random.default_rng(seed)
        rows = regression(slow(rng, 2000), slow(rng, 2000)[:, 0])
        qr_factor = qr_factor_of(rows)
        independent = independent_rows(qr_factor, ordinary(rows))
        naive.append(term_test(qr_factor, ONE, ["a"]).p_value < 0.05)
        corrected.append(term_test(qr_factor, ONE, ["a"], independent).p_value < 0.05)
    assert np.mean(naive) > 0.25
    assert np.mean(corrected) == pytest.approx(0.06, abs=0.04)


def test_white_rows_are_all_independent() -> None:
    rows = noisy(1, count=4000)
    found = independent_rows(qr_factor_of(rows), ordinary(rows))
    assert 0.75 * 4000 < found <= 4000
    exact = regression(rows.H, rows.H @ [1.0, 2.0, 3.0])
    without = replace(ordinary(rows), white_standard_errors=None)
    assert independent_rows(qr_factor_of(exact), without) == 4000


@pytest.mark.rounding
def test_terms_that_cannot_be_tested() -> None:
    qr_factor = qr_factor_of(noisy(0))
    with pytest.raises(IdentificationError, match="terms=: no parameter is named 'z'"):
        term_test(qr_factor, ONE, ["z"])
    with pytest.raises(IdentificationError, match=r"found 1 terms, 2\.5 rows and 3 parameters"):
        term_test(qr_factor, ONE, ["a"], independent=2.5)
    with pytest.raises(IdentificationError, match="found 0 terms"):
        term_test(qr_factor, ONE, [])


@pytest.mark.parametrize("phi", [0.0, 0.6])
def test_whiteness_of_a_known_process(phi: float) -> None:
    noise = lfilter([1.0], [1.0, -phi], np.random.default_rng(1).normal(size=5000))
    found = whiteness(regression(np.ones((5000, 1)), noise), np.zeros(1))[0]
    assert found.first == pytest.approx(phi, abs=0.03)
    assert found.durbin_watson == pytest.approx(2 - 2 * phi, abs=0.06)
    assert (found.p_value > 0.01) == (phi == 0)


def test_rows_left_out_do_not_look_correlated() -> None:
    rows = noisy(2, count=3000)
    kept = np.random.default_rng(3).random(3000) < 0.7
    fewer = replace(
        rows,
        **{name: getattr(rows, name)[kept] for name in ("H", "y", "joint", "time", "run")},
        propagated=rows.propagated[kept],
    )
    found = whiteness(fewer, np.array([2.0, -1.0, 0.0]))[0]
    assert abs(found.first) < 0.06
    assert found.p_value > 0.001


def test_runs_shorter_than_the_lags_are_taken_as_they_are() -> None:
    rows = regression(np.ones((60, 1)), np.random.default_rng(4).normal(size=60))
    short = replace(rows, run=np.repeat(np.arange(30), 2))
    products = rows.y[:-1:2] * rows.y[1::2]
    found = whiteness(short, np.zeros(1))[0]
    assert found.first == pytest.approx(np.sum(products) / np.sum(rows.y**2))


@pytest.mark.parametrize("length", [12, 240])
def test_white_noise_of_many_logs_is_rejected_at_the_rate_of_the_test(length: int) -> None:
    """Pairs of rows were once counted as if all logs were one: hardly any was rejected."""
    rng, logs, p_values = np.random.default_rng(5), 240 // length, []
    times = np.tile(np.arange(length) / 20, logs)
    for _ in range(200):
        rows = regression(np.ones((240, 1)), rng.normal(size=240))
        rows = replace(rows, run=np.repeat(np.arange(logs), length), time=times)
        p_values.append(whiteness(rows, np.zeros(1))[0].p_value)
    # A rate of 0.1 has the standard deviation 0.02 over 200 draws.
    assert 0.05 < np.mean(np.array(p_values) < 0.1) < 0.15


def test_residual_of_nothing_is_white() -> None:
    rows = regression(np.ones((50, 1)), np.zeros(50))
    found = whiteness(rows, np.zeros(1))[0]
    assert (found.first, found.durbin_watson, found.p_value) == (0.0, 2.0, 1.0)


@pytest.mark.rounding
def test_poorly_told_combination_is_named_with_its_size() -> None:
    rng = np.random.default_rng(4)
    H = rng.normal(size=(1000, 3))
    H[:, 2] = 2 * H[:, 1] + 2e-3 * rng.normal(size=1000)
    qr_factor = qr_factor_of(regression(H, np.zeros(1000)))
    sentence = poorly_determined(qr_factor)
    assert len(sentence) == 1
    assert sentence[0].startswith("scaled singular value ")
    assert "of the combination " in sentence[0]
    found = directions(qr_factor.weighted_factor(), qr_factor.names)
    assert found.shares[-1] == pytest.approx(np.sqrt(0.5) * 1e-3 / np.sqrt(2), rel=0.1)
    assert f"{found.shares[-1]:.1e}" in sentence[0]
    assert found.text(2) in ("b - 2 c", "c - 0.5 b")
    assert not poorly_determined(qr_factor, share=1e-6)


def test_long_combinations_are_cut() -> None:
    H = np.random.default_rng(5).normal(size=(200, 6))
    H[:, 5] = np.sum(H[:, :5], axis=1) + 1e-4 * H[:, 5]
    found = directions(
        qr_factor_of(regression(H, np.zeros(200))).weighted_factor(), tuple("abcdef")
    )
    assert found.text(5).endswith(" and 2 more")
    assert found.text(5).startswith("f - ")
    H[:, 4] = 0.0
    H[:, 5] = np.sum(H[:, :4], axis=1) + 1e-4 * H[:, 5]
    of_five = qr_factor_of(regression(H[:, [0, 1, 2, 3, 5]], np.zeros(200))).weighted_factor()
    assert directions(of_five, tuple("abcdf")).text(4).endswith(" and 1 more")


def test_correlation_has_ones_on_its_diagonal() -> None:
    found = ordinary(noisy(6)).correlation
    assert np.allclose(np.diag(found), 1.0)
    assert np.allclose(found, found.T)
    assert np.max(np.abs(found)) <= 1.0
