"""Estimate: intervals, parts, names."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t as student_t

from seaid._arrays import Array
from seaid.drives import ParameterName
from seaid.errors import IdentificationError, SeaidError
from seaid.estimation import Estimate
from seaid.estimation.estimate import independent_rows, poorly_determined, term_test, whiteness
from seaid.estimation.least_squares import ordinary
from seaid.estimation.qr_factor import directions, qr_factor_of
from seaid.regressor import Regression
from tests.estimation.rows import experiment
from tests.plants import regression

COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 2.0], [0.0, 2.0, 1.0]])
FOUND = Estimate(
    names=ParameterName.all_of("abc"),
    values=np.array([10.0, -3.0, 0.0]),
    covariance=COVARIANCE,
    units=("kg", "m", "s"),
    residual_std=0.1,
    condition_number=3.0,
)


def test_standard_errors_parts_and_names_are_those_of_the_covariance() -> None:
    """Roots of its diagonal, rows of a part, and correlations with ones on the diagonal."""
    assert FOUND.standard_errors == pytest.approx([2.0, 3.0, 1.0])
    assert FOUND.relative_standard_errors == pytest.approx([0.2, 1.0, np.inf])
    assert (FOUND.value("b"), FOUND.standard_error("b")) == (-3.0, 3.0)
    sizes = np.outer(FOUND.standard_errors, FOUND.standard_errors)
    np.testing.assert_allclose(FOUND.correlation * sizes, COVARIANCE)
    part = FOUND.part([2, 1], ["z", "y"])
    assert (part.names, part.units) == (("z", "y"), ("s", "m"))
    assert part.values.tolist() == [0.0, -3.0]
    assert part.covariance.tolist() == [[1.0, 2.0], [2.0, 9.0]]


def of_shapes(values: Array, covariance: Array) -> Estimate:
    return Estimate(ParameterName.all_of("a"), values, covariance, ("kg",), 0.0, 1.0)


REFUSED: list[tuple[Callable[[], object], str]] = [
    *(
        (partial(FOUND.interval, level), "level must be between 0 and 1")
        for level in (0.0, 1.0, 95)
    ),
    (lambda: FOUND.interval("a"), "level= must be a number, found the text 'a'"),  # type: ignore[arg-type]
    (partial(FOUND.value, "d"), "no parameter is named 'd'; allowed: a, b, c"),
    (partial(of_shapes, np.zeros(2), np.eye(1)), "values must have shape"),
    (partial(of_shapes, np.zeros(1), np.eye(2)), "covariance must have shape"),
]


@pytest.mark.parametrize(("call", "words"), REFUSED)
def test_levels_names_and_shapes_are_checked(call: Callable[[], object], words: str) -> None:
    """Arrays of an estimate cannot be changed either."""
    with pytest.raises(SeaidError, match=words):
        call()
    assert not FOUND.values.flags.writeable


@pytest.mark.parametrize("level", [0.95, 0.5])
def test_intervals_are_those_of_students_t_and_errors_are_not_wider(level: float) -> None:
    few = replace(FOUND, degrees_of_freedom=np.array([4.0, 30.0, np.inf]))
    for estimate, freedom in ((few, [4.0, 30.0, 1e12]), (FOUND, [1e12] * 3)):
        interval, half = estimate.interval(level), student_t.ppf((1 + level) / 2, freedom)
        assert interval.mean(axis=1) == pytest.approx(FOUND.values)
        assert interval[:, 1] - FOUND.values == pytest.approx(half * FOUND.standard_errors)
    assert few.part([2, 0], ["c", "a"]).degrees_of_freedom == pytest.approx([np.inf, 4.0])
    assert few.standard_errors == pytest.approx(FOUND.standard_errors)


def test_further_values_have_the_errors_of_those_that_they_contain() -> None:
    """d = 2 a - c + e: its covariance with all is that of the linear function, plus that of e."""
    further = Estimate(
        ParameterName.all_of("d"), np.array([20.0]), np.array([[0.25]]), ("kg",), 0.2, 1.0
    )
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


ONE = np.ones(1)


def noisy(seed: int, count: int = 200) -> Regression:
    """Return rows of white noise to which the third column adds nothing."""
    rows = experiment(seed, count=count)
    return replace(rows, y=rows.y - 0.5 * rows.H[:, 2])


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
    superfluous = [term_test(qr_factor_of(noisy(seed)), ONE, ["c"]).bic for seed in range(20)]
    assert needed.bic > 10 > 0 > np.median(superfluous)


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


def test_white_rows_are_all_independent_and_others_by_their_variances() -> None:
    rows = noisy(1, count=4000)
    found = independent_rows(qr_factor_of(rows), ordinary(rows))
    assert 0.75 * 4000 < found <= 4000
    exact = regression(rows.H, rows.H @ [1.0, 2.0, 3.0])
    without = replace(ordinary(rows), white_standard_errors=None)
    assert independent_rows(qr_factor_of(exact), without) == 4000
    third = replace(ordinary(rows), white_standard_errors=ordinary(rows).standard_errors / 3)
    assert independent_rows(qr_factor_of(rows), third) == pytest.approx(4000 / 3**2)


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


def test_rows_left_out_and_ends_of_runs_are_no_pairs() -> None:
    """A third of the rows is missing; and runs are shorter than the lags."""
    rows = noisy(2, count=3000)
    found = whiteness(rows.at(np.random.default_rng(3).random(3000) < 0.7), np.array([2, -1, 0.0]))
    assert abs(found[0].first) < 0.06
    assert found[0].p_value > 0.001
    rows = regression(np.ones((60, 1)), np.random.default_rng(4).normal(size=60))
    short = whiteness(replace(rows, run=np.repeat(np.arange(30), 2)), np.zeros(1))[0]
    assert short.first == pytest.approx(np.sum(rows.y[:-1:2] * rows.y[1::2]) / np.sum(rows.y**2))
    exact = whiteness(replace(rows, y=np.zeros(60)), np.zeros(1))[0]
    assert (exact.first, exact.durbin_watson, exact.p_value) == (0.0, 2.0, 1.0)


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
