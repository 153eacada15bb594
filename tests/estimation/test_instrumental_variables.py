"""Instrumental variables against noise in the columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.checks.values import noise_findings
from seaid.errors import ExcitationError, IdentificationError
from seaid.estimation.instrumental_variables import (
    instrumental,
    unattenuated,
    with_predicted_columns,
)
from seaid.estimation.least_squares import equal_weights, ordinary, settled_weights, weighted
from seaid.estimation.qr_factor import qr_factor_of
from seaid.regressor import Regression
from tests.estimation.rows import TRUTH
from tests.plants import regression
from tests.standard_errors import check_scores


def experiment(
    seed: int, count: int = 1000, noise: float = 0.5, stds: tuple[float, ...] = (0.5,)
) -> tuple[Regression, Array]:
    """Return rows with noise in the second column, and instruments with noise of their own."""
    rng = np.random.default_rng(seed)
    exact = rng.normal(size=(count * len(stds), 3)) @ np.array(
        [[1.0, 0.3, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]]
    )
    H = exact.copy()
    H[:, 1] += noise * rng.normal(size=len(H))
    Z = exact + 0.5 * noise * rng.normal(size=exact.shape)
    joint = np.repeat(np.arange(float(len(stds))), count)
    y = exact @ TRUTH + np.repeat(stds, count) * rng.normal(size=len(H))
    rows = regression(H, y, joint=joint)
    return rows, Z


@pytest.mark.slow  # 2.0 s
def test_noise_in_a_column_biases_least_squares_and_not_instruments() -> None:
    """Instruments are inside their intervals, far from the mean of least squares."""
    scores, biases = [], []
    for seed in range(300):
        rows, Z = experiment(seed, stds=(0.2, 1.0))
        found = instrumental(rows, Z)
        scores.append((found.values - TRUTH) / found.standard_errors)
        if seed < 20:
            biases.append((ordinary(rows).values - TRUTH)[1] / found.standard_errors[1])
    check_scores(scores)
    assert abs(np.mean(biases)) > 4


@pytest.mark.rounding
def test_it_is_the_textbook_with_the_weights_of_least_squares() -> None:
    rows, Z = experiment(0, stds=(0.1, 1.0))
    residual = rows.y - rows.H @ weighted(rows).values
    std = np.array([np.sqrt(np.mean(residual[rows.joint == j] ** 2)) for j in range(2)])
    squared = (1 / std[rows.joint.astype(int)] ** 2)[:, None]
    expected = np.linalg.solve(Z.T @ (squared * rows.H), Z.T @ (squared[:, 0] * rows.y))
    assert instrumental(rows, Z).values == pytest.approx(expected, rel=1e-5)


@pytest.mark.rounding
def test_columns_as_their_own_instruments_are_weighted_least_squares() -> None:
    rows, _ = experiment(1, stds=(0.1, 1.0))
    found, expected = instrumental(rows, rows.H), weighted(rows)
    assert found.values == pytest.approx(expected.values, rel=1e-9)
    assert np.allclose(found.covariance, expected.covariance, rtol=1e-8)
    assert found.residual_std == pytest.approx(expected.residual_std, rel=1e-9)
    assert noise_findings(found) == []


@pytest.mark.rounding
@given(exponent=st.lists(st.integers(-8, 8), min_size=6, max_size=6))
def test_units_do_not_matter(exponent: list[int]) -> None:
    rows, Z = experiment(2, 200)
    of_rows, of_instruments = 10.0 ** np.array(exponent[:3]), 10.0 ** np.array(exponent[3:])
    plain = instrumental(rows, Z)
    scaled = instrumental(replace(rows, H=rows.H * of_rows), Z * of_instruments)
    assert scaled.values * of_rows == pytest.approx(plain.values, rel=1e-8)
    assert scaled.standard_errors * of_rows == pytest.approx(plain.standard_errors, rel=1e-8)


def test_what_is_carried_adds_what_targets_really_do() -> None:
    rows, Z = experiment(3)
    direction = rows.H[:, :1] + Z[:, 1:2] ** 2
    plain = instrumental(rows, Z)
    noise = (rows.y - rows.H @ plain.values)[:, None]
    direction -= noise * (noise.T @ direction) / (noise.T @ noise)  # none of it is explained
    rows = replace(rows, propagated=direction)
    carrying = instrumental(rows, Z, np.array([[1e-8]]))
    moved = instrumental(replace(rows, y=rows.y + 1e-4 * direction[:, 0]), Z).values - plain.values
    added = instrumental(rows, Z, np.array([[2e-8]])).covariance - carrying.covariance
    assert np.allclose(added, np.outer(moved, moved), rtol=1e-2, atol=1e-3 * moved @ moved)


def test_weak_instruments_are_flagged_by_name() -> None:
    rows, Z = experiment(4)
    rng = np.random.default_rng(0)
    Z = Z.copy()
    Z[:, 1] = 0.1 * Z[:, 1] + rng.normal(size=len(Z))
    flags = [str(one) for one in noise_findings(instrumental(rows, Z))]
    assert any(flag.startswith("the instruments of b are weak (partial") for flag in flags)
    assert not any("instruments of c" in str(flag) for flag in flags)


def test_instruments_that_determine_nothing_are_refused() -> None:
    """Of a wrong shape, not finite, zero, or alike; and columns that are alike."""
    rows, Z = experiment(5)
    alike = replace(rows, H=rows.H[:, [0, 1, 0]])
    refused = [
        (rows, Z[:-1], r"each of the 3 parameters and the 1000 rows"),
        (rows, np.where(Z > 3, np.nan, Z), "instruments must be finite"),
        (rows, Z * [1, 0, 1], "the instruments of b are zero"),
        (rows, Z[:, [0, 1, 0]], "identify only 2 of 3 parameters"),
        (alike, Z, r"combination of .* is unidentifiable"),
    ]
    for data, instruments, words in refused:
        with pytest.raises((IdentificationError, ExcitationError), match=words):
            instrumental(data, instruments)


def currents(seed: int, noise: tuple[float, ...], count: int = 400) -> tuple[Regression, Array]:
    """Return rows k_e i_e - f_e v_e = y_e, with noise in the currents i_e only, and the truth."""
    rng, n = np.random.default_rng(seed), len(noise)
    k, f = np.arange(2.0, 2 + n), 0.3 * np.arange(1.0, 1 + n)
    y, v = rng.normal(size=(n, count)), rng.normal(size=(n, count))
    measured = (y + f[:, None] * v) / k[:, None] + np.array(noise)[:, None] * rng.normal(
        size=y.shape
    )
    H = np.zeros((n, count, 2 * n))
    for e in range(n):
        H[e, :, e], H[e, :, n + e] = measured[e], -v[e]
    joint = np.repeat(np.arange(n), count)
    rows = regression(H.reshape(-1, 2 * n), y.ravel(), unit="N m", joint=joint)
    return rows, np.concatenate([k, f])


def test_noise_of_one_equation_in_one_column_is_regressed_the_other_way_round() -> None:
    rows, _ = currents(0, (0.4,))
    qr_factor = qr_factor_of(rows)
    theta = unattenuated(qr_factor, equal_weights(qr_factor), [0], False)
    # i = y / k + (f / k) v
    inverse = np.linalg.lstsq(np.column_stack([rows.y, -rows.H[:, 1]]), rows.H[:, 0])[0]
    assert theta == pytest.approx([1 / inverse[0], inverse[1] / inverse[0]], rel=1e-9)
    again = ordinary(with_predicted_columns(rows, np.asarray(theta), [0]))
    assert again.values == pytest.approx(theta, rel=1e-9)
    assert again.residual_std == pytest.approx(np.std(rows.y - rows.H @ theta), rel=0.01)


@pytest.mark.slow  # 2.8 s
def test_noise_of_logged_currents_biases_least_squares_only() -> None:
    noisy, scores, plain, truth = [0, 1, 2], [], [], np.empty(0)
    for seed in range(250):
        rows, truth = currents(seed, (0.0, 0.1, 0.3))
        qr_factor = qr_factor_of(rows)
        theta = unattenuated(qr_factor, settled_weights(qr_factor), noisy, True)
        assert theta is not None
        found = weighted(with_predicted_columns(rows, theta, noisy))
        scores.append((found.values - truth)[[1, 2, 4, 5]] / found.standard_errors[[1, 2, 4, 5]])
        plain.append(weighted(rows).values)
        assert found.values[[0, 3]] == pytest.approx(truth[[0, 3]], rel=1e-6)
    check_scores(scores)
    assert np.mean(plain, axis=0)[2] < 0.6 * truth[2]


def test_without_convergence_there_is_no_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seaid.estimation.instrumental_variables._MOST_ROUNDS", 1)
    qr_factor = qr_factor_of(currents(0, (0.1, 0.3))[0])
    assert unattenuated(qr_factor, settled_weights(qr_factor), [0, 1], True) is None
