"""Variable projection: known curves recovered, gradient against differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.estimation.nonlinear_least_squares import separable_least_squares

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
    found = separable_least_squares(
        columns, slopes, [np.array([0.5])], np.array([0.01]), np.array([10.0])
    )
    np.testing.assert_allclose(found.nonlinear, [v], rtol=1e-6)
    np.testing.assert_allclose(found.linear, [a, b], rtol=1e-5, atol=1e-6)
    assert found.residual < 1e-6


@pytest.mark.rounding
def test_the_best_of_several_starts_is_taken_on() -> None:
    columns, slopes = two_decays((1.0, 2.0, 4.0), noise=0.05)
    bounds = np.array([1e-3]), np.array([50.0])
    far = [np.array([1e-3]), np.array([3.0]), np.array([50.0])]
    found = separable_least_squares(columns, slopes, far, *bounds)
    near = separable_least_squares(columns, slopes, [np.array([4.0])], *bounds)
    assert found.nonlinear == pytest.approx(near.nonlinear, rel=1e-6)
    assert found.nonlinear[0] == pytest.approx(4.0, rel=0.1)


@pytest.mark.rounding
def test_a_parameter_without_effect_stays_inside_its_bounds() -> None:
    columns, slopes = two_decays((1.0, 0.0, 1.0))
    found = separable_least_squares(
        columns, slopes, [np.array([0.5])], np.array([0.01]), np.array([10.0])
    )
    assert 0.01 <= found.nonlinear[0] <= 10.0
    assert np.all(np.isfinite(found.linear))
