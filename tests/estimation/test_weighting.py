"""Weights of equations by cheap turns: their residuals are those of the whole solution."""

from __future__ import annotations

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.estimation.least_squares import equal_weights, orthonormal, settled_weights, solve
from seaid.estimation.qr_factor import QRFactor, qr_factor_of
from seaid.regressor.regression import Regression


def qr_factor(seed: int, badly: float = 1.0) -> QRFactor:
    """Return what four equations of 40 rows tell of six columns; the noise of each is its own."""
    rng = np.random.default_rng(seed)
    joint = np.repeat(np.arange(4), 40)
    H = rng.normal(size=(160, 6)) * np.logspace(0, 6, 6)
    H[:, 5] = 1e6 * H[:, 0] + badly * rng.normal(size=160)
    noise = np.array([0.1, 1.0, 10.0, 300.0])[joint] * rng.normal(size=160)
    return qr_factor_of(
        Regression(
            names=tuple("abcdef"),
            units=("",) * 6,
            H=H,
            y=H @ rng.normal(size=6) / np.logspace(0, 6, 6).sum() + noise,
            joint=joint.astype(float),
            time=np.tile(np.arange(40) * 0.1, 4),
            run=np.zeros(160),
            excluded=0,
            propagated=np.empty((160, 0)),
        )
    )


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
    monkeypatch.setattr("seaid.estimation.least_squares._LARGEST_PRODUCTS", 0)
    large = orthonormal(found, solve(found, equal_weights(found)).values)
    assert large.products is None
    assert large.residual_norms(weights) == pytest.approx(norms, rel=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_weights_settle_where_they_did(seed: int) -> None:
    found = qr_factor(seed)
    assert settled_weights(found) == pytest.approx(weights_one_by_one(found), rel=1e-8)


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
    return qr_factor_of(
        Regression(
            names=tuple("abc"),
            units=("",) * 3,
            H=H,
            y=y + 1e-3 * rng.normal(size=800),
            joint=np.repeat([0.0, 1.0], 400),
            time=np.tile(np.arange(400) * 0.1, 2),
            run=np.zeros(800),
            excluded=0,
            propagated=np.empty((800, 0)),
        )
    )


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
