"""Nested models: what a term is worth by BIC and by prediction of what was left out."""

from dataclasses import replace

import numpy as np
import pytest

from seaid.errors import IdentificationError
from seaid.estimation.diagnostics import compare_models, term_test, time_blocks
from seaid.estimation.qr_factor import qr_factor_of
from seaid.regressor.regression import Regression

pytestmark = pytest.mark.rounding

NAMES = ("a", "b", "c", "d")


def rows(
    values: tuple[float, ...], noise: float = 0.1, seed: int = 0, count: int = 400
) -> Regression:
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(count, 4))
    return Regression(
        names=NAMES,
        units=("1",) * 4,
        H=H,
        y=H @ values + 0.1 * rng.normal(size=count),
        joint=np.arange(count, dtype=float) % 2,
        time=np.arange(count, dtype=float) // 2 * 0.01,
        run=np.zeros(count),
        excluded=0,
        propagated=np.empty((count, 0)),
    )


def test_a_term_that_is_there_is_worth_it_and_one_that_is_not_is_not() -> None:
    data = rows((1.0, -2.0, 0.05, 0.0))
    there = compare_models(data, np.ones(2), NAMES[:2], NAMES[:3], 400.0, 2)
    missing = compare_models(data, np.ones(2), NAMES[:2], ("a", "b", "d"), 400.0, 2)
    assert there.is_supported
    assert there.F > 40
    assert there.better >= 7
    assert not missing.is_supported


def test_what_is_not_there_is_seldom_found() -> None:
    """The rate of false alarms of one question of six, 400 draws."""
    alarms = [
        compare_models(
            rows((1.0, -2.0, 0.0, 0.0), seed=seed), np.ones(2), NAMES[:2], NAMES[:3], 400.0, 6
        )
        for seed in range(400)
    ]
    assert np.mean([one.is_supported for one in alarms]) < 0.01


def test_improvement_is_that_of_refitting_without_each_block() -> None:
    data = rows((1.0, -2.0, 0.3, 0.2))
    found = compare_models(data, np.ones(2), ("a",), ("a", "b", "c"), 400.0, 1)
    errors = np.zeros((2, 8))
    for place, block in enumerate(time_blocks(data)):
        for model, columns in enumerate(([0], [0, 1, 2])):
            H = data.H[:, columns]
            theta = np.linalg.lstsq(H[~block], data.y[~block], rcond=None)[0]
            errors[model, place] = np.sum((data.y[block] - H[block] @ theta) ** 2)
    assert found.improvement == pytest.approx(1 - errors[1].sum() / errors[0].sum())
    assert found.better == np.sum(errors[1] < errors[0])


def test_the_criterion_is_that_of_a_term_test_less_what_asking_costs() -> None:
    data = rows((1.0, -2.0, 0.05, 0.0))
    found = compare_models(data, np.ones(2), NAMES[:2], NAMES[:3], 400.0, 5)
    less = replace(data, names=NAMES[:3], units=("1",) * 3, H=data.H[:, :3])
    test = term_test(qr_factor_of(less), np.ones(2), ["c"], 400.0)
    assert pytest.approx(test.F) == found.F
    assert found.bic == pytest.approx(test.bic - 2 * np.log(5))


def test_a_model_that_is_not_larger_is_refused() -> None:
    data = rows((1.0, -2.0, 0.05, 0.0))
    with pytest.raises(IdentificationError, match=r"found 0 more parameters and 400\.0 rows"):
        compare_models(data, np.ones(2), NAMES[:2], NAMES[:2], 400.0, 1)


def test_blocks_are_equal_parts_in_time_over_the_runs() -> None:
    blocks = time_blocks(rows((1.0, 0.0, 0.0, 0.0)))
    assert [int(block.sum()) for block in blocks] == [50] * 8
    assert np.all(np.sum(blocks, axis=0) == 1)


def test_too_few_rows_are_refused() -> None:
    with pytest.raises(IdentificationError, match="4 rows are too few to exclude one of 8"):
        time_blocks(rows((1.0, 0.0, 0.0, 0.0), count=4))
