"""Arrays: float64, shape-checked, read-only copies; and what is solved with them."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy import linalg

from seaid._arrays import Array, check_rate, finite, frozen, safely, white_noise
from seaid.errors import RobotError, SeaidError
from seaid.estimation.qr_factor import directions
from seaid.estimation.sdp import covariance_root, floored_covariance
from seaid.excitation.criteria import CRITERIA, singular_values
from seaid.regressor.base import left_to_right
from seaid.robot import inconsistency, is_physical


def test_result_is_a_read_only_copy_in_float64() -> None:
    source = np.array([[1, 2], [3, 4]], dtype=np.int32)
    array = frozen("q", source, (None, 2))
    source[0, 0] = 9
    assert array.dtype == np.float64
    assert array.flags.c_contiguous
    assert array[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 5.0


NO_VECTORS: tuple[Any, ...] = ("abc", ["1", "x"], [[1.0], [1.0, 2.0]], None, {})


@pytest.mark.parametrize(
    ("refuse", "words"),
    [
        (lambda: finite("q", [1.0, np.nan], (2,)), r"q must be finite, found \[1.0, nan\]"),
        (lambda: finite("gravity", np.inf, ()), "gravity must be finite, found inf"),
        *(
            (partial(frozen, "q", np.zeros((4, 5)), shape), r"q must have shape .*, found \(4, 5\)")
            for shape in ((3,), (2, 3), (None,), (None, 2, None), ())
        ),
        *((partial(frozen, "com", value, (3,)), "^com must ") for value in NO_VECTORS),
        *(
            (partial(check_rate, rate, 4.0), f"rate_hz must be {kind}, found {rate}")
            for rate, kind in (
                (math.nan, "finite and more than 0"),
                (0, "finite and more than 0"),
                (True, "a number"),
            )
        ),
        (lambda: check_rate("10", 4.0), "rate_hz must be a number, found '10'"),
        (lambda: check_rate(1e-320, 4.0, 0.1), r"finite and more than 0\.1, found 1e-320"),
        (
            lambda: check_rate(1e15, 4.0),
            r"rate_hz must be at most 2.5e\+06, .* 10,000,000 samples, found 1e\+15",
        ),
    ],
)
def test_what_is_no_array_or_rate_is_refused_by_name(
    refuse: Callable[[], object], words: str
) -> None:
    """NaN is a value where a channel may have none."""
    with pytest.raises(SeaidError, match=words):
        refuse()
    assert np.isnan(frozen("q", [1.0, np.nan], (2,))[1])
    check_rate(2.5e6, 4.0)


def test_the_noise_of_a_channel_is_found_below_its_motion_and_its_jumps() -> None:
    time = np.linspace(0.0, 10.0, 10_000)
    noisy = np.sin(time) + np.random.default_rng(0).normal(0.0, 1e-3, len(time))
    assert white_noise(noisy) == pytest.approx(1e-3, rel=0.05)
    assert white_noise(noisy, robust=True) == pytest.approx(1e-3, rel=0.05)
    noisy[::500] += 1.0
    assert white_noise(noisy, robust=True) == pytest.approx(1e-3, rel=0.05)
    assert white_noise(noisy) > 0.03


# No LinAlgError of numpy or scipy leaves seaid: what cannot be solved is said in words.

NAN, INFINITE = np.full((3, 3), np.nan), np.diag([1.0, np.inf, 2.0])
SINGULAR = np.ones((3, 3))


@pytest.mark.parametrize(
    ("function", "matrix", "found"),
    [
        (np.linalg.inv, SINGULAR, "singular matrix, in sizes up to 1"),
        (np.linalg.cholesky, -np.eye(3), "matrix is not positive definite, in sizes up to 1"),
        (np.linalg.svd, NAN, "9 numbers that are not finite"),
        (np.linalg.pinv, INFINITE, "1 numbers that are not finite, in sizes up to 2"),
        (np.linalg.eigvalsh, NAN, "9 numbers that are not finite"),
        (linalg.svd, INFINITE, "1 numbers that are not finite"),
        (linalg.orth, NAN, "9 numbers that are not finite"),
    ],
)
def test_failures_are_said_in_words(
    function: Callable[[Array], Any], matrix: Array, found: str
) -> None:
    with pytest.raises(RobotError, match=f"the mass matrix cannot be solved: {found}"):
        safely(function, matrix, what="the mass matrix", error=RobotError)
    np.testing.assert_array_equal(safely(np.diag, np.eye(2), what="it"), [1.0, 1.0])
    with pytest.raises(ValueError, match=r"mismatch|dimension|shape") as caught:
        safely(linalg.solve_triangular, np.eye(2), np.ones(3), what="it")
    assert type(caught.value) is ValueError  # a mistake of ours


@pytest.mark.parametrize(
    ("solve", "words"),
    [
        (lambda: is_physical(np.full(10, np.nan)), "the inertia of a body"),
        (lambda: inconsistency(np.append(1.0, np.full(9, np.nan))), "the inertia of a body"),
        (lambda: left_to_right(np.full((20, 3), np.inf)), "torques of unit parameters are not"),
        (lambda: directions(NAN, ("a", "b")), "the equations cannot be solved"),
        (lambda: covariance_root(INFINITE, np.ones(3)), "covariance must be finite"),
        (lambda: floored_covariance(np.eye(3), NAN), "covariance must be finite"),
        (lambda: singular_values(NAN), "the regressor of the motion"),
        *(
            (partial(criterion.smooth, NAN), "the regressor of the motion")
            for criterion in CRITERIA.values()
        ),
    ],
)
def test_places_where_numbers_of_a_user_arrive(solve: Callable[[], Any], words: str) -> None:
    with pytest.raises(SeaidError, match=words):
        solve()
