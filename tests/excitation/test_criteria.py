"""The criteria on the triangular factor: what they are, and their slopes against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.excitation.criteria import (
    CRITERIA,
    CriterionName,
    has_full_rank,
    singular_values,
    triangular_factor,
)


@pytest.mark.rounding
@settings(derandomize=True, max_examples=25, deadline=None)
@given(
    name=st.sampled_from(sorted(CRITERIA)),
    columns=st.integers(1, 12),
    previous_logs=st.integers(0, 4),
    seed=st.integers(0, 10**6),
)
def test_slope_equals_central_differences(
    name: CriterionName, columns: int, previous_logs: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    sizes = 10 ** rng.uniform(-2, 0, columns)
    H = rng.normal(size=(40, columns)) * sizes
    known = rng.normal(size=(previous_logs, columns)) * sizes
    smooth = CRITERIA[name].smooth
    value, slope = smooth(triangular_factor(H, known))
    direction = rng.normal(size=H.shape) * sizes
    step = 1e-5
    plus, minus = (
        smooth(triangular_factor(H + sign * step * direction, known))[0] for sign in (1, -1)
    )
    by_slope = float(np.sum((H @ slope) * direction))
    scale = float(np.linalg.norm(H @ slope / sizes) * np.linalg.norm(direction / sizes))
    assert by_slope == pytest.approx((plus - minus) / (2 * step), rel=1e-6, abs=1e-7 * scale)
    assert np.isfinite(value)


def test_what_the_criteria_are() -> None:
    rng = np.random.default_rng(3)
    H = rng.normal(size=(50, 6)) * np.logspace(0, 1, 6)
    R = triangular_factor(H, np.empty((0, 6)))
    covariance = np.linalg.inv(H.T @ H)
    found = {name: np.exp(criterion.log_value(R)) for name, criterion in CRITERIA.items()}
    assert found["condition_number"] == pytest.approx(np.linalg.cond(H), rel=1e-10)
    assert found["d_optimality"] == pytest.approx(np.linalg.det(covariance) ** (1 / 12), rel=1e-9)
    worst = np.sqrt(np.diag(covariance).max())
    assert found["relative_error"] == pytest.approx(worst, rel=1e-10)
    np.testing.assert_allclose(singular_values(R), np.linalg.svd(H, compute_uv=False))


@pytest.mark.rounding
def test_smooth_criteria_are_little_above_the_plain_ones() -> None:
    rng = np.random.default_rng(4)
    R = triangular_factor(rng.normal(size=(50, 8)), np.empty((0, 8)))
    for criterion in CRITERIA.values():
        plain, smooth = criterion.log_value(R), criterion.smooth(R)[0]
        assert plain <= smooth + 1e-12 <= plain + 2 * np.log(8) / 32


def test_what_was_recorded_counts() -> None:
    rng = np.random.default_rng(5)
    H, before = rng.normal(size=(20, 4)), rng.normal(size=(30, 4))
    R = triangular_factor(H, np.asarray(np.linalg.qr(before, mode="r")))
    np.testing.assert_allclose(R.T @ R, H.T @ H + before.T @ before, atol=1e-12)


@pytest.mark.rounding
def test_a_lost_column_is_seen() -> None:
    H = np.random.default_rng(6).normal(size=(30, 4))
    H[:, 3] = H[:, 0] - 2 * H[:, 1]
    assert not has_full_rank(triangular_factor(H, np.empty((0, 4))))
    assert not has_full_rank(triangular_factor(H[:3], np.empty((0, 4))))
