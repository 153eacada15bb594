"""Nested models: what a term is worth by BIC and by prediction of what was left out."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg

from seaid._arrays import Array
from seaid.checks.engine import (
    Alternative,
    Candidate,
    Equation,
    ModelComparison,
    Selection,
    _changes,
    compared_candidates,
    equation_of,
    forward_selection,
    linear_candidate,
)
from seaid.drives import ParameterName
from seaid.errors import IdentificationError
from seaid.estimation import fit
from seaid.estimation.estimate import term_test
from seaid.estimation.fitting import ESTIMATORS
from seaid.estimation.qr_factor import SEGMENTS, explained_apart, qr_factor_of, time_blocks
from seaid.log.filtering import ROWS_PER_PERIOD
from seaid.regressor import Regression
from tests.plants import regression

NAMES = ("a", "b", "c", "d")


def rows(
    values: tuple[float, ...], noise: float = 0.1, seed: int = 0, count: int = 400
) -> Regression:
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(count, 4))
    y = H @ values + 0.1 * rng.normal(size=count)
    instants = np.arange(count, dtype=float)
    return regression(H, y, unit="1", joint=instants % 2, time=instants // 2 * 0.01)


def test_an_equation_without_rows_takes_its_weight_with_it() -> None:
    """The weights of the others once moved up by one place."""
    data = rows((1.0, -2.0, 0.0, 0.0), count=600)
    joint = np.arange(600.0) % 3
    data = replace(data, joint=joint, y=data.y * np.array([1.0, 5.0, 25.0])[joint.astype(int)])
    fitted = fit(data, ESTIMATORS["wls"])
    without = replace(fitted, rows=data.at(joint != 1))
    expected = equation_of(fitted).weight[joint != 1]
    assert len(np.unique(expected)) == 2
    np.testing.assert_array_equal(equation_of(without).weight, expected)


def test_what_an_error_of_a_spring_leaves_is_no_missing_term() -> None:
    """The torque of a spring whose stiffness was estimated before is off by what it may be."""
    springs = np.array([[0.04, -0.01], [-0.01, 0.01]])
    alone, with_errors = 0, 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        data = rows((1.0, -2.0, 0.0, 0.0), seed=seed)
        # The candidate resembles what the errors of the springs leave.
        of_springs = rng.normal(size=(400, 2)) + 2 * data.H[:, [2, 2]]
        errors = rng.multivariate_normal([0.0, 0.0], springs)
        data = replace(data, y=data.y + of_springs @ errors, propagated=of_springs)
        fitted = fit(first(data, 2), ESTIMATORS["wls"], springs)
        larger = [Alternative(data.H[:, [2]], 1)]
        equation = equation_of(fitted)
        with_errors += compare(equation, larger, 20)[0].is_supported_overall
        alone += compare(Equation(equation.rows, equation.weights), larger, 20)[
            0
        ].is_supported_overall
    assert alone > 40
    assert with_errors <= 3


def test_rows_are_weighted_by_the_root_of_the_covariance_of_their_residual() -> None:
    """That is noise, with the information of its independent rows, and the errors of springs."""
    data = rows((1.0, -2.0, 0.0, 0.0))
    data = replace(data, propagated=np.random.default_rng(1).normal(size=(400, 2)))
    springs = np.array([[0.4, -0.1], [-0.1, 0.1]])
    equation = equation_of(fit(data, ESTIMATORS["wls"], springs))
    plain = Equation(equation.rows, equation.weights)
    W, columns = np.diag(plain.weight), data.propagated
    Q = np.linalg.qr(W @ columns)[0]
    left = plain.residual - Q @ (Q.T @ plain.residual)
    noise = np.mean(left**2) * ROWS_PER_PERIOD / 2
    covariance = np.eye(400) + W @ columns @ springs @ columns.T @ W / noise
    expected = linalg.inv(linalg.sqrtm(covariance)) @ W
    np.testing.assert_allclose(equation.weighted(np.eye(400)), expected, atol=1e-9)


def first(data: Regression, count: int) -> Regression:
    """Return the rows with their first columns only."""
    return replace(
        data, names=ParameterName.all_of(NAMES[:count]), units=("1",) * count, H=data.H[:, :count]
    )


def compare(equation: Equation, larger: Sequence[Alternative], asked: int) -> list[ModelComparison]:
    """Compare the model of an equation with each of several larger ones."""
    candidates = [Candidate("", "", str(k), (x,)) for k, x in enumerate(larger)]
    return [trial.comparison for trial in compared_candidates(equation, candidates, asked)]


def compared(data: Regression, base: int, *more: Array, asked: int = 1) -> ModelComparison:
    """Compare the model of the first columns with one that has more columns."""
    larger = [Alternative(np.column_stack(more), len(more))]
    return compare(Equation(first(data, base), np.ones(2)), larger, asked)[0]


def test_a_term_that_is_there_is_worth_it_and_one_that_is_not_is_not() -> None:
    data = rows((1.0, -2.0, 0.05, 0.0))
    there, missing = (compared(data, 2, data.H[:, place], asked=2) for place in (2, 3))
    assert there.is_supported_overall
    assert there.F > 40
    assert there.better >= 7
    assert not missing.is_supported_overall


@pytest.mark.slow  # 0.9 s
def test_what_is_not_there_is_seldom_found() -> None:
    """The rate of false alarms of one question of six, 400 draws."""
    draws = (rows((1.0, -2.0, 0.0, 0.0), seed=seed) for seed in range(400))
    alarms = [compared(data, 2, data.H[:, 2], asked=6) for data in draws]
    assert np.mean([one.is_supported_overall for one in alarms]) < 0.01


@pytest.mark.rounding
def test_improvement_is_that_of_refitting_without_each_block() -> None:
    data = rows((1.0, -2.0, 0.3, 0.2))
    found = compared(data, 1, data.H[:, 1], data.H[:, 2])
    errors = np.zeros((2, 8))
    for place, block in enumerate(time_blocks(data, segments=SEGMENTS)):
        for model, columns in enumerate(([0], [0, 1, 2])):
            H = data.H[:, columns]
            theta = np.linalg.lstsq(H[~block], data.y[~block], rcond=None)[0]
            errors[model, place] = np.sum((data.y[block] - H[block] @ theta) ** 2)
    assert found.improvement == pytest.approx(1 - errors[1].sum() / errors[0].sum())
    assert found.better == np.sum(errors[1] < errors[0])


@pytest.mark.rounding
def test_a_column_may_take_the_place_of_another_one() -> None:
    data = rows((1.0, -2.0, 0.0, 0.5))
    larger = [Alternative(data.H[:, [3]], 1, (2,)), Alternative(data.H[:, [3]], 1)]
    instead, both = compare(Equation(first(data, 3), np.ones(2)), larger, 1)
    columns = data.H[:, [0, 1, 3]]
    left = [
        float(np.sum((data.y - H @ np.linalg.lstsq(H, data.y, rcond=None)[0]) ** 2))
        for H in (data.H[:, :3], columns, data.H)
    ]
    assert instead.explained == pytest.approx(1 - left[1] / left[0])
    assert both.explained == pytest.approx(1 - left[2] / left[0])


def test_the_criterion_is_that_of_a_term_test_less_what_asking_costs() -> None:
    data = rows((1.0, -2.0, 0.05, 0.0))
    found, once = (compared(data, 2, data.H[:, 2], asked=asked) for asked in (5, 1))
    # white noise below a low pass: two independent rows for each period of four
    test = term_test(qr_factor_of(first(data, 3)), np.ones(2), ["c"], 400.0 / 2)
    assert found.bic == pytest.approx(once.bic - 2 * np.log(5))
    assert found.explained == pytest.approx(1 - 1 / test.growth)
    assert pytest.approx(test.F) == found.F


def test_autocorrelated_rows_count_less() -> None:
    data = rows((1.0, -2.0, 0.05, 0.0))
    rng = np.random.default_rng(3)
    slow = np.repeat(rng.normal(size=(50, 5)), 8, axis=0)
    same = replace(data, H=slow[:, :4], y=slow[:, :4] @ [1.0, -2.0, 0.05, 0.0] + 0.1 * slow[:, 4])
    # eight rows in a row are one, where two of four are independent
    assert compared(same, 2, same.H[:, 2]).F < 0.45 * compared(data, 2, data.H[:, 2]).F


@pytest.mark.parametrize(("size", "least"), [(3, 10), (30, 25)])
def test_one_block_does_not_decide(size: float, least: float) -> None:
    """A column that is almost zero outside of one segment explains a burst there."""
    data = rows((1.0, -2.0, 0.0, 0.0))
    burst = np.where((data.time > 0.5) & (data.time < 0.52), data.H[:, 3], 0.0)
    found = compared(replace(data, y=data.y + size * burst), 2, burst + 0.01 * data.H[:, 3])
    assert found.bic > least
    assert not found.is_supported_overall
    assert not found.is_clear_in_few


@pytest.mark.parametrize("segments", [1, SEGMENTS])
def test_blocks_are_equal_parts_in_time_over_the_runs(segments: int) -> None:
    blocks = time_blocks(rows((1.0, 0.0, 0.0, 0.0)), segments=segments)
    assert [int(block.sum()) for block in blocks] == pytest.approx([50] * 8, abs=segments)
    assert np.all(np.sum(blocks, axis=0) == 1)
    assert all(np.sum(np.diff(block.astype(int)) == 1) <= segments for block in blocks)


@pytest.mark.parametrize(("count", "width"), [(4, 4), (15, 4), (16, 14)])
def test_too_few_rows_are_refused(count: int, width: int) -> None:
    """Each block needs two rows, and what is left more rows than parameters."""
    data = rows((1.0, 0.0, 0.0, 0.0), count=count)
    names = ParameterName.all_of("abcdefghijklmn"[:width])
    data = replace(data, H=np.ones((count, width)), names=names, units=("1",) * width)
    with pytest.raises(IdentificationError, match=f"{count} rows are too few to exclude one of 8"):
        time_blocks(data)


def test_the_last_parameters_have_the_errors_of_white_noise_in_any_units() -> None:
    data = rows((1.0, -2.0, 0.5, 0.3), count=4000)
    equation = equation_of(fit(replace(data, H=data.H * [1, 1e3, 1e-2, 10]), ESTIMATORS["wls"]))
    X = equation.weight[:, None] * equation.rows.H
    y = equation.weight * equation.rows.y
    theta = np.linalg.lstsq(X, y)[0]
    std = np.std(y - X @ theta)
    values, errors = equation.last(2)
    np.testing.assert_allclose(equation.values, theta, rtol=1e-9)
    np.testing.assert_allclose(values, theta[2:], rtol=1e-9)
    white = std * np.sqrt(np.diag(np.linalg.inv(X.T @ X))[2:])
    np.testing.assert_allclose(errors, white, rtol=0.15)


def test_errors_are_those_of_blocks_that_differ_by_more() -> None:
    """One slope in the first half and twice as much in the second: eight blocks show that."""
    x, n = np.random.default_rng(9).standard_normal(1600), 8
    y = np.where(np.arange(1600) < 800, 1.0, 2.0) * x
    equation = Equation(regression(x[:, None], y), np.ones(1))
    (slope,), (error,) = equation.last_of_blocks(1)
    assert abs(slope - 1.5) < 0.05
    # the slopes of the blocks have a standard deviation of 0.5 n / (n - 1), and their mean this
    assert error == pytest.approx(0.5 / np.sqrt(n - 1), rel=0.1)


def selected(*columns: Array) -> Selection:
    """Return what is selected among columns of different checks, of which the first is true."""

    candidates = [
        replace(linear_candidate("j", str(place), "", np.reshape(x, (-1, 1))), about=place)
        for place, x in enumerate(columns)
    ]
    data = rows((1.0, -2.0, 1.0, 0.0))
    return forward_selection(Equation(first(data, 2), np.ones(2)), candidates, 3, 6.0)


def test_a_cause_that_explains_as_much_is_a_rival_and_one_that_is_there_too_is_not() -> None:
    data = rows((1.0, -2.0, 1.0, 0.0))
    true, noise = data.H[:, 2], np.random.default_rng(5).normal(size=len(data.y))
    (alone,) = selected(true).accepted
    (beside,) = selected(true, true + 5e-4 * noise).accepted
    (better,) = selected(true, true + noise).accepted
    assert [len(one.rivals) for one in (alone, beside, better)] == [0, 1, 0]
    assert {x.candidate.field for x in (beside.trial, *beside.rivals)} == {"0", "1"}
    both = selected(true - 0.5 * data.H[:, 3], data.H[:, 3])
    assert len(both.accepted) == 2
    assert all(not one.rivals for one in both.accepted)


@pytest.mark.parametrize(
    ("bic", "spread", "is_clear"), [(33.0, 0.25, True), (20.0, 0.25, False), (33.0, 0.4, False)]
)
def test_what_few_blocks_show_needs_a_criterion_beyond_chance(
    bic: float, spread: float, is_clear: bool
) -> None:
    """Large deflections of a hardening spring are in some blocks: t is 2.0, and 2.36 is needed."""
    comparison = ModelComparison(bic, 57.8, 0.39, 0.39, spread, 6, 8, 2.0, 120.0, 1)
    assert comparison.is_clear_in_few == is_clear
    assert not comparison.is_better
    # a single block that improves has its whole improvement as the standard error
    alone = np.array([1.0, *7 * [0.0]])
    improvement, std, *_ = _changes(np.ones(8), np.ones(8) - 0.4 * alone)
    assert improvement == pytest.approx(std)


def test_logs_of_the_same_set_up_are_left_out_without_their_columns() -> None:
    """Forty logs have forty times the columns of the fit, which took two gigabytes."""
    data, logs = rows((1.0, -2.0, 0.5, 0.0), count=4_000), np.repeat(np.arange(40.0), 100)
    parts = [logs == log for log in range(40)]
    other = data.y + parts[7] * (data.H @ [0.0, 1.0, 0.0, 0.0])
    data = replace(data, y=other, run=logs)
    candidates = [
        Candidate("", "log", str(log), (Alternative(data.H, 4, own=own),))
        for log, own in enumerate(parts)
    ]
    equation = equation_of(fit(data, ESTIMATORS["wls"]))
    compared = compared_candidates(equation, candidates, 1, least_bic=0.0)
    assert [trial.candidate.term for trial in compared] == ["7"]
    # The columns of the others are as good as without the bound.
    (expected,) = compare(equation, [Alternative(data.H * parts[7][:, None], 4)], 1)
    assert compared[0].comparison.bic == pytest.approx(expected.bic)


def test_what_values_of_its_own_explain_of_a_part() -> None:
    """It is that of a fit with the columns of the part next to all, and a bound with a prior."""
    data, part = rows((1.0, -2.0, 0.5, 0.0)), np.arange(400) < 100
    data = replace(data, y=data.y + part * data.H[:, 0])
    directions = np.linalg.qr(np.random.default_rng(1).normal(size=(400, 2)))[0]
    for sizes in (np.empty(0), np.array([1.0, 8.0])):
        Q = directions[:, : len(sizes)]
        equation = Equation(data, np.ones(2), (Q, ((np.eye(len(sizes)), sizes),)))
        (found,) = compare(equation, [Alternative(data.H, 4, own=part)], 1)
        X = np.column_stack([data.H, Q * sizes, data.y])
        prior = np.eye(X.shape[1])[4:-1]
        (share,) = explained_apart(X, prior, [part])
        assert share >= found.explained - 1e-12
        assert share == pytest.approx(found.explained, rel=0.1 if len(sizes) else 1e-9)
