"""No LinAlgError of numpy or scipy leaves seaid: what cannot be solved is said in words."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy import linalg

from seaid._arrays import Array, safely
from seaid.errors import RobotError, SeaidError
from seaid.estimation.qr_factor import directions
from seaid.estimation.sdp import covariance_root, floored_covariance
from seaid.excitation.criteria import CRITERIA, singular_values
from seaid.regressor.base import left_to_right
from seaid.robot.inertia import inconsistency, is_physical

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
    """Each names what was to be solved."""
    with pytest.raises(SeaidError, match=words):
        solve()
