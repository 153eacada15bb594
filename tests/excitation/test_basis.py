from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid.errors import ExcitationError
from seaid.excitation import FourierBasis, JoinedBasis, make_basis
from seaid.excitation.basis import Basis, SplineBasis, matrices

PARTS = (make_basis("bspline", 1.3, 8), make_basis("fourier", 2.0, 7))
JOINED = JoinedBasis((*PARTS, make_basis("polynomial", 0.1, 6)))
BASES: dict[str, Basis] = {
    **{f"bspline {count}": make_basis("bspline", 3.4, count) for count in (7, 30)},
    **{f"polynomial {count}": make_basis("polynomial", 3.4, count) for count in (7, 18, 30)},
    **{f"fourier {count}": make_basis("fourier", 3.4, count) for count in (7, 31)},
    "repeated knots": SplineBasis(5, np.sort([*[0] * 6, 0.5, *[1.7] * 3, 2.1, *[3.4] * 6])),
    "joined": JOINED,
}


@pytest.mark.parametrize("name", BASES)
def test_velocity_and_acceleration_are_the_derivatives(name: str) -> None:
    """And the constant one has none; states are the matrices times coefficients."""
    basis = BASES[name]
    assert basis.duration == 3.4
    # the parts of a joined one meet at 1.3 and 3.3 s
    time, step = np.random.default_rng(1).permutation(np.linspace(1.31, 3.29, 41)), 1e-5
    position, velocity, acceleration = tables = matrices(basis, time)
    before, after = matrices(basis, time - step), matrices(basis, time + step)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * step), velocity, atol=1e-6)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * step), acceleration, atol=1e-4)
    np.testing.assert_allclose(position @ basis.constant, 1.0, rtol=1e-13)
    np.testing.assert_allclose(velocity @ basis.constant, 0.0, atol=1e-12)
    c = np.random.default_rng(0).normal(size=(basis.size, 2))
    for states, matrix in zip(basis.states(time, c), tables, strict=True):
        np.testing.assert_allclose(states, matrix @ c, rtol=1e-12, atol=1e-9)


@given(
    seed=st.integers(0, 2**32 - 1),
    name=st.sampled_from(sorted(BASES)),
    order=st.sampled_from([0, 1, 2]),
    density=st.sampled_from([0, 2, 5]),
)
def test_hull_is_never_exceeded_and_closes_in(
    seed: int, name: str, order: int, density: int
) -> None:
    """Control points enclose the curve, the more closely the more there are."""
    basis = BASES[name]
    coefficients = np.random.default_rng(seed).normal(size=basis.size)
    curve = matrices(basis, np.linspace(0.0, 3.4, 3401))[order] @ coefficients
    hull, fine = (basis.hull(order, much) @ coefficients for much in (density, 40))
    assert np.abs(curve).max() <= np.abs(hull).max() * (1 + 1e-9)
    assert np.abs(curve).max() <= np.abs(fine).max() * (1 + 1e-9)
    assert np.abs(fine).max() <= np.abs(curve).max() * 1.02
    if "fourier" not in name and name != "joined":  # they enclose it on either side
        tolerance = 1e-9 * np.abs(hull).max()
        assert hull.min() <= fine.min() + tolerance <= curve.min() + 2 * tolerance
        assert hull.max() >= fine.max() - tolerance >= curve.max() - 2 * tolerance


def test_a_shifted_fourier_series_is_the_same_motion_begun_later() -> None:
    """It goes on beyond its end without a jump."""
    basis = FourierBasis(4, 2.0)
    values = np.random.default_rng(0).normal(size=(9, 2))
    time = np.linspace(0.0, 2.0, 21)
    begun_later = basis.states(time, basis.shifted(values, 0.7))
    np.testing.assert_allclose(begun_later, basis.states(time + 0.7, values), atol=1e-10)


@pytest.mark.parametrize(
    ("make", "arguments", "words"),
    [
        (make_basis, ("bsplin", 1.0, 20), "no basis is named 'bsplin'; did you mean 'bspline'"),
        (make_basis, ("bspline", 0.0, 20), r"duration must be from 0\.001 to 1e\+06 s, found 0"),
        (make_basis, ("bspline", np.nan, 20), r"must be from 0\.001 to 1e\+06 s, found nan"),
        (make_basis, ("bspline", 1e308, 20), r"must be from 0\.001 to 1e\+06 s, found 1e\+308"),
        (make_basis, ("fourier", 1e-320, 21), r"must be from 0\.001 to 1e\+06 s, found 9\.99"),
        (make_basis, ("bspline", 1.0, 5), "a bspline needs at least 6 coefficients .* found 5"),
        (make_basis, ("bspline", 1.0, 7.5), "a whole number, found 7.5"),
        (make_basis, ("polynomial", 1.0, 3), "a polynomial needs at least 4 coef.* found 3"),
        (make_basis, ("fourier", 1.0, 1), "a fourier needs at least 3 coefficients .* found 1"),
        (make_basis, ("fourier", 1.0, 8), "odd number of coefficients per joint, .* found 8"),
        (SplineBasis, (2, [0, 0, 0, 1, 1, 1]), "at least 3, found 2"),
        (SplineBasis, (3, [0, 0, 0, 1, 1, 1, 1]), "must be 4 zeros"),
        (SplineBasis, (3, [0, 0, 0, 0, 2, 1, 1, 1, 1]), "must be 4 zeros"),
        (SplineBasis, (3, [0, 0, 0, 0, np.nan, 1, 1, 1, 1]), "must be 4 zeros"),
        (SplineBasis, (3, [0, 0, 0, 0, 0.5, 0.5, 1, 1, 1, 1]), "the acceleration would jump"),
        (SplineBasis, (5, [*[0] * 6, 5e-301, *[1] * 6]), "apart, found 0 and 5e-301 s"),
        (FourierBasis, (0, 1.0), "harmonics must be a whole number of at least 1"),
        (FourierBasis, (3, np.nan), "duration must be more than zero"),
        (FourierBasis, (3, 1.0, 0), "periods must be a whole number"),
        (JoinedBasis, ((),), "at least one part"),
    ],
)
def test_bad_requests_say_what_is_wrong(
    make: Callable[..., object], arguments: tuple[Any, ...], words: str
) -> None:
    if make is SplineBasis:
        arguments = (arguments[0], np.array(arguments[1], dtype=float))
    with pytest.raises(ExcitationError, match=words):
        make(*arguments)


def test_each_part_keeps_its_interval_and_its_coefficients() -> None:
    """Where two parts meet the later one counts."""
    assert (JOINED.size, JOINED.starts) == (21, (0.0, 1.3, 3.3, 3.4))
    c = np.random.default_rng(0).normal(size=(JOINED.size, 2))
    for part, first, start in zip(JOINED.parts, (0, 8, 15), JOINED.starts, strict=False):
        local = np.linspace(0.0, part.duration, 9)[:-1] + 1e-12
        alone = part.states(local, c[first : first + part.size])
        np.testing.assert_allclose(JOINED.states(local + start, c), alone, rtol=1e-8, atol=1e-8)
    at_start = PARTS[1].states(np.array([0.0]), c[8:15])
    np.testing.assert_array_equal(JOINED.states(np.array([1.3]), c), at_start)
    np.testing.assert_array_equal(JOINED.scaling[8:15, 8:15], PARTS[1].scaling)
    assert np.count_nonzero(JOINED.scaling) == JOINED.size
