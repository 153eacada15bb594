"""Information against the rows it stands for."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import sqrtm

from seaid._arrays import Array
from seaid.drives import ParameterName
from seaid.errors import IdentificationError
from seaid.estimation.qr_factor import (
    QRFactor,
    combined,
    deleted_residual,
    explained_apart,
    explained_squares,
    fitted_slope,
    posterior,
    qr_factor_of,
    scaled_svd,
    triangle,
    whitened,
)
from seaid.regressor import Regression
from tests.plants import regression

WEIGHTS = np.array([1.0, 3.0, 0.2])


def some_rows(count: int = 300, seed: int = 0) -> Regression:
    """Return rows of joints 0, 2 and 3, in no order."""
    rng = np.random.default_rng(seed)
    return regression(
        *(rng.normal(size=(count, 4)) * [1.0, 1e6, 1e-6, 1.0], rng.normal(size=count)),
        units=("kg", "m", "s", "N"),
        joint=rng.choice([0, 2, 3], count),
        time=np.arange(count) / 20,
        excluded=count // 10,
        propagated=rng.normal(size=(count, 2)),
        joint_names=("hip", "fixed", "knee", "ankle"),
    )


def gram(qr_factor: QRFactor) -> Array:
    R = qr_factor.factors
    return np.asarray(np.swapaxes(R, 1, 2) @ R)


def assert_same(found: QRFactor, expected: QRFactor) -> None:
    norms = np.linalg.norm(expected.factors, axis=1)
    scale = norms[:, :, None] * norms[:, None, :]
    assert np.max(np.abs(gram(found) - gram(expected)) / scale) < 1e-13
    assert np.allclose(found.propagated, expected.propagated, rtol=1e-11, atol=1e-9)
    for name in ("names", "units", "equations", "counts", "excluded", "joint_names"):
        assert getattr(found, name) == getattr(expected, name)


@pytest.mark.rounding
@pytest.mark.parametrize("count", [300, 9000])
def test_factors_have_the_second_moments_of_each_equation(count: int) -> None:
    """Of a short regression, and of a long one that is factored in blocks."""
    rows = some_rows(count)
    found = qr_factor_of(rows)
    assert found.equations == (0, 2, 3)
    assert found.count == sum(found.counts) == count
    for place, equation in enumerate(found.equations):
        mine = rows.joint == equation
        both = np.column_stack([rows.H, rows.y])[mine]
        assert found.counts[place] == np.sum(mine)
        assert np.allclose(gram(found)[place], both.T @ both, rtol=1e-11, atol=1e-7)
        assert np.allclose(found.propagated[place], rows.H[mine].T @ rows.propagated[mine])
        assert np.array_equal(found.factors[place], np.triu(found.factors[place]))
    few = np.arange(6.0).reshape(2, 3)  # fewer rows than columns
    R = triangle(few.copy())
    assert R.shape == (2, 3)
    assert np.allclose(R.T @ R, few.T @ few)
    assert np.array_equal(triangle(np.empty((0, 3))), np.zeros((0, 3)))


@pytest.mark.rounding
@given(cuts=st.lists(st.integers(0, 300), max_size=5))
def test_parts_add_up_to_the_whole(cuts: list[int]) -> None:
    """Some parts are shorter than the parameters, some empty, some lack an equation."""
    rows = some_rows()
    ends = [0, *sorted(cuts), 300]
    parts = [replace(qr_factor_of(rows.at(slice(*pair))), excluded=0) for pair in pairwise(ends)]
    whole = replace(qr_factor_of(rows), excluded=0)
    assert_same(combined(parts), whole)


@pytest.mark.rounding
def test_weights_residual_norms_and_fewer_columns_are_those_of_the_rows() -> None:
    rows = some_rows()
    weight = WEIGHTS[np.searchsorted([0, 2, 3], rows.joint)]
    both = np.column_stack([rows.H, rows.y]) * weight[:, None]
    found = qr_factor_of(rows).weighted_factor(WEIGHTS)
    assert np.allclose(found.T @ found, both.T @ both, rtol=1e-11, atol=1e-9)
    plain = qr_factor_of(rows).weighted_factor()
    assert np.allclose(plain, qr_factor_of(rows).weighted_factor(np.ones(3)))
    theta = np.array([1.0, 2e-6, 3e6, -1.0])
    residual = rows.y - rows.H @ theta
    expected = [np.linalg.norm(residual[rows.joint == joint]) for joint in (0, 2, 3)]
    assert qr_factor_of(rows).residual_norms(theta) == pytest.approx(expected, rel=1e-12)
    fewer = replace(rows, names=ParameterName.all_of("bd"), units=("m", "N"), H=rows.H[:, [1, 3]])
    assert_same(qr_factor_of(rows).without(["a", "c"]), qr_factor_of(fewer))


@pytest.mark.rounding
def test_rows_that_cannot_be_added_or_factored_are_refused() -> None:
    """Other columns, none at all, and numbers that are not finite."""
    rows = some_rows()
    factor = qr_factor_of(rows)
    with pytest.raises(IdentificationError, match=r"columns are the same: one has a, b, c, d .*b"):
        combined([factor, factor.without(["a"])])
    with pytest.raises(IdentificationError, match="found none"):
        combined([])
    H, y = rows.H.copy(), rows.y.copy()
    H[5, 1], y[7] = np.nan, np.inf
    with pytest.raises(IdentificationError, match="rows that are not finite: b, the torque"):
        qr_factor_of(replace(rows, H=H, y=y))


def test_a_decomposition_without_convergence_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Divide and conquer did not converge for the columns of a Go2, QR iterations did."""
    columns = np.random.default_rng(3).normal(size=(30, 4)) * [1.0, 1e3, 1e-3, 0.0]
    y, tried = columns @ [1.0, 2.0, 3.0, 0.0], []
    expected = scaled_svd(columns).solve(y, 1e-9)

    def fails(matrix: Any, **options: Any) -> Any:
        tried.append(matrix.shape)
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    np.testing.assert_allclose(scaled_svd(columns).solve(y, 1e-9), expected, rtol=1e-9)
    assert tried == [columns.shape]
    with pytest.raises(IdentificationError, match="it cannot be solved: 3 numbers"):
        scaled_svd(np.diag([np.nan, 1.0, 1.0]), "it")


def test_posterior_whitening_and_explained_part_are_those_of_dense_matrices() -> None:
    """By normal equations, by the symmetric root of a covariance, and by a projection."""
    rng = np.random.default_rng(4)
    effects, y, widths = (
        rng.normal(size=(9, 3)) * [1, 50, 0.1],
        rng.normal(size=9),
        np.eye(2, 3) * 7,
    )
    mean, root = posterior(effects, y, widths)
    of_errors = np.linalg.inv(effects.T @ effects + np.eye(3))
    np.testing.assert_allclose(mean, widths @ of_errors @ effects.T @ y)
    np.testing.assert_allclose(root @ root.T, widths @ of_errors @ widths.T)
    U, sizes = np.linalg.qr(effects)[0], np.array([0.3, 2.0, 40.0])
    common = U * sizes
    expected = sqrtm(np.linalg.inv(np.eye(9) + common @ common.T)) @ y
    np.testing.assert_allclose(whitened(y, U, [(np.eye(3), sizes)]), expected)
    parts = np.array([0, 0, 1, 1])
    columns, basis = np.hstack([effects, effects[:, :1] + U[:, :1]]), U[:, :1]
    rest = y - basis @ (basis.T @ y)
    explained = explained_squares(columns, basis, rest, parts)
    for part, squares in enumerate(explained):
        larger = np.hstack([basis, columns[:, parts == part]])
        residual = rest - larger @ np.linalg.lstsq(larger, rest)[0]
        assert squares == pytest.approx(rest @ rest - residual @ residual)
    X, half = np.column_stack([effects, y]), [np.arange(9) < 5]
    shares = [*explained_apart(X, X[:0], half), *explained_apart(1e-6 * X, X[:0], half)]
    assert shares[0] == pytest.approx(shares[1])  # in any unit


def test_what_a_fit_leaves_of_rows_apart_is_in_errors_of_their_prediction() -> None:
    """By normal equations: of a row h the variance is 1 + c h (H^T H)^-1 h^T."""
    rng = np.random.default_rng(6)
    H, y, apart = rng.normal(size=(30, 3)) * [1, 50, 0.1], rng.normal(size=30), np.arange(30) > 23
    residual, noise = deleted_residual(H, y, apart, 2.0)
    of_errors = np.linalg.inv(H[~apart].T @ H[~apart])
    variance = 1 + 2.0 * apart * np.sum(H @ of_errors * H, axis=1)
    expected = y - H @ of_errors @ H[~apart].T @ y[~apart]
    np.testing.assert_allclose(residual, expected / np.sqrt(variance))
    assert noise == pytest.approx(np.linalg.norm(residual[~apart]) / np.sqrt(24 - 3))


def test_a_slope_in_any_unit_has_the_difference_of_the_halves_of_enough_rows() -> None:
    """Of more than six rows per parameter, whose two halves have the slopes 1 and 1.2 here."""
    rng = np.random.default_rng(3)
    for count, is_enough in ((12, False), (13, True), (400, True)):
        columns, turned = rng.normal(size=(count, 2)), np.arange(count) >= count // 2
        torque = columns[:, 0] - (1 + 0.2 * turned) * columns[:, 1]
        torque += 0.01 * rng.normal(size=count)
        torque += 0.3 * (count > 100) * np.sin(np.arange(count) / 20)  # that of a gear
        slope, error = fitted_slope(columns, torque, 1.0)
        assert (error > 0.08) == is_enough
        for unit in (1e-3, 1e3):
            changed = fitted_slope(columns * [1, unit], torque, 1.0)
            assert changed == pytest.approx((slope / unit, error / unit))
