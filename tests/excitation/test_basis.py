from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from seaid.errors import ExcitationError
from seaid.excitation.basis import (
    BasisName,
    FourierBasis,
    SplineBasis,
    _refinement,
    bernstein_from_powers,
    make_basis,
)

BASES: list[tuple[BasisName, int]]
BASES = [("bspline", 7), ("bspline", 30), ("polynomial", 7), ("polynomial", 18), ("polynomial", 30)]
FOURIER: list[tuple[BasisName, int]] = [("fourier", 7), ("fourier", 31)]


@pytest.mark.parametrize(("name", "count"), BASES + FOURIER)
def test_velocity_and_acceleration_are_the_derivatives(name: BasisName, count: int) -> None:
    basis = make_basis(name, 4.0, count)
    assert (basis.size, basis.duration) == (count, 4.0)
    time, step = np.linspace(0.3, 3.7, 41), 1e-5
    _, velocity, acceleration = basis.matrices(time)
    before, after = basis.matrices(time - step), basis.matrices(time + step)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * step), velocity, atol=1e-6)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * step), acceleration, atol=1e-4)


@pytest.mark.parametrize(("name", "count"), BASES + FOURIER)
def test_constant_is_one_at_all_times(name: BasisName, count: int) -> None:
    basis = make_basis(name, 4.0, count)
    position, velocity, _ = basis.matrices(np.linspace(0.0, 4.0, 11))
    np.testing.assert_allclose(position @ basis.constant, 1.0, rtol=1e-13)
    np.testing.assert_allclose(velocity @ basis.constant, 0.0, atol=1e-12)


@settings(derandomize=True, max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    case=st.sampled_from(BASES + FOURIER),
    order=st.sampled_from([0, 1, 2]),
    density=st.sampled_from([0, 2, 5]),
)
def test_hull_is_never_exceeded_and_closes_in(
    seed: int, case: tuple[BasisName, int], order: int, density: int
) -> None:
    basis = make_basis(case[0], 3.0, case[1])
    coefficients = np.random.default_rng(seed).normal(size=basis.size)
    curve = basis.matrices(np.linspace(0.0, 3.0, 3001))[order] @ coefficients
    hull, fine = (basis.hull(order, much) @ coefficients for much in (density, 40))
    assert np.abs(curve).max() <= np.abs(hull).max() * (1 + 1e-9)
    assert np.abs(curve).max() <= np.abs(fine).max() * (1 + 1e-9)
    assert np.abs(fine).max() <= np.abs(curve).max() * 1.02
    if case[0] != "fourier":  # control points enclose the curve on either side
        tolerance = 1e-9 * np.abs(hull).max()
        assert hull.min() <= fine.min() + tolerance <= curve.min() + 2 * tolerance
        assert hull.max() >= fine.max() - tolerance >= curve.max() - 2 * tolerance


def test_a_fourier_series_goes_on_without_a_jump() -> None:
    basis = FourierBasis(5, 2.0)
    first, second = basis.matrices(np.array([0.3])), basis.matrices(np.array([2.3]))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)


def test_a_shifted_fourier_series_is_the_same_motion_begun_later() -> None:
    basis = FourierBasis(4, 2.0)
    values = np.random.default_rng(0).normal(size=(9, 2))
    time = np.linspace(0.0, 2.0, 21)
    begun_later = basis.states(time, basis.shifted(values, 0.7))
    for one, other in zip(begun_later, basis.states(time + 0.7, values), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)


@pytest.mark.rounding
def test_refined_control_points_come_close_to_the_curve() -> None:
    basis = make_basis("bspline", 10.0, 20)
    coefficients = np.random.default_rng(0).normal(size=20)
    coefficients[[0, -1]] = 0.0
    curve = basis.matrices(np.linspace(0.0, 10.0, 20001))[0] @ coefficients
    gaps = [
        (basis.hull(0, density) @ coefficients).max() - curve.max() for density in (3, 6, 12, 24)
    ]
    assert gaps[3] < 0.01 * np.ptp(curve)
    assert all(wide / close > 3 for wide, close in pairwise(gaps))  # quadratic


@pytest.mark.parametrize(("degree", "times"), [(3, 2), (3, 3), (4, 4), (5, 4), (8, 6)])
def test_a_curve_with_repeated_knots_is_the_same_on_finer_knots(degree: int, times: int) -> None:
    ends = np.repeat([0.0, 1.0], degree + 1)
    knots = np.sort([*ends, 0.3, *np.repeat(0.5, times), 0.8])
    finer = np.sort([*knots, 0.1, 0.4, 0.45, 0.55, 0.9])
    points = np.random.default_rng(0).normal(size=len(knots) - degree - 1)
    matrix, time = _refinement(knots, finer, degree), np.linspace(0.0, 1.0, 501)
    curve = BSpline(finer, matrix @ points, degree)(time)
    np.testing.assert_allclose(curve, BSpline(knots, points, degree)(time), atol=1e-13)
    assert matrix.min() > -1e-13  # convex combinations: the finer points stay within the others


def test_bernstein_form_is_the_power_form_of_equation_18() -> None:
    powers = np.random.default_rng(3).normal(size=(6, 2))
    basis = SplineBasis(5, np.repeat([0.0, 2.5], 6))
    time = np.linspace(0.0, 2.5, 11)
    position, velocity, _ = basis.matrices(time)
    coefficients = bernstein_from_powers(powers, 2.5)
    expected = sum(np.outer(time**i, powers[i]) for i in range(6))
    slope = sum(np.outer(i * time ** (i - 1), powers[i]) for i in range(1, 6))
    np.testing.assert_allclose(position @ coefficients, expected, rtol=1e-10)
    np.testing.assert_allclose(velocity @ coefficients, slope, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "duration", "count", "words"),
    [
        ("bsplin", 1.0, 20, "no basis is named 'bsplin'; did you mean 'bspline'"),
        ("bspline", 0.0, 20, "duration must be more than zero seconds, found 0.0"),
        ("bspline", float("nan"), 20, "duration must be more than zero seconds, found nan"),
        ("bspline", 1e308, 20, r"duration must be from 0\.001 to 1e\+06 s, found 1e\+308"),
        ("fourier", 1e-320, 21, r"duration must be from 0\.001 to 1e\+06 s, found 9\.99"),
        ("bspline", 1.0, 5, "a bspline needs at least 6 coefficients per joint, .* found 5"),
        ("bspline", 1.0, 7.5, "a whole number, found 7.5"),
        ("polynomial", 1.0, 3, "a polynomial needs at least 4 coefficients per joint, .* found 3"),
        ("fourier", 1.0, 1, "a fourier needs at least 3 coefficients per joint, .* found 1"),
        ("fourier", 1.0, 8, "odd number of coefficients per joint, .* found 8"),
    ],
)
def test_bad_requests_say_what_is_wrong(name: Any, duration: float, count: int, words: str) -> None:
    with pytest.raises(ExcitationError, match=words):
        make_basis(name, duration, count)


@pytest.mark.parametrize(
    ("degree", "knots", "words"),
    [
        (2, [0, 0, 0, 1, 1, 1], "at least 3, found 2"),
        (3, [0, 0, 0, 1, 1, 1, 1], "must be 4 zeros"),
        (3, [0, 0, 0, 0, 2, 1, 1, 1, 1], "must be 4 zeros"),
        (3, [0, 0, 0, 0, np.nan, 1, 1, 1, 1], "must be 4 zeros"),
        (3, [0, 0, 0, 0, 0.5, 0.5, 1, 1, 1, 1], "the acceleration would jump"),
        (5, [0] * 6 + [5e-301] + [1] * 6, "1e-12 of the duration apart, found 0 and 5e-301 s"),
    ],
)
def test_bad_knots_say_what_is_wrong(degree: int, knots: list[float], words: str) -> None:
    with pytest.raises(ExcitationError, match=words):
        SplineBasis(degree, np.array(knots, dtype=float))


def test_bad_series_say_what_is_wrong() -> None:
    with pytest.raises(ExcitationError, match="harmonics must be a whole number of at least 1"):
        FourierBasis(0, 1.0)
    with pytest.raises(ExcitationError, match="duration must be more than zero"):
        FourierBasis(3, float("nan"))
