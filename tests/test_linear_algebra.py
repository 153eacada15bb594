"""No LinAlgError of numpy or scipy leaves seaid: what cannot be solved is said in words."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import linalg

from seaid._arrays import Array, safely
from seaid.errors import ExcitationError, IdentificationError, RobotError
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


def test_what_succeeds_is_handed_on() -> None:
    values = safely(np.linalg.svd, np.eye(2), what="it", compute_uv=False)
    np.testing.assert_array_equal(values, [1.0, 1.0])


def test_mistakes_of_ours_stay_what_they_are() -> None:
    with pytest.raises(ValueError, match=r"mismatch|dimension|shape") as caught:
        safely(linalg.solve_triangular, np.eye(2), np.ones(3), what="it")
    assert type(caught.value) is ValueError


def test_places_where_numbers_of_a_user_arrive() -> None:
    body = np.full(10, np.nan)
    with pytest.raises(RobotError, match="the inertia of a body"):
        is_physical(body)
    with pytest.raises(RobotError, match="the inertia of a body"):
        inconsistency(np.append(1.0, body[1:]))
    with pytest.raises(RobotError, match="torques of unit parameters are not finite"):
        left_to_right(np.full((20, 3), np.inf))
    with pytest.raises(IdentificationError, match="the equations cannot be solved"):
        directions(np.full((3, 3), np.nan), ("a", "b"))
    with pytest.raises(IdentificationError, match="covariance must be finite"):
        covariance_root(np.full((2, 2), np.inf), np.ones(2))
    with pytest.raises(IdentificationError, match="covariance must be finite"):
        floored_covariance(np.eye(2), np.full((2, 2), np.nan))
    with pytest.raises(ExcitationError, match="the regressor of the motion"):
        singular_values(np.full((3, 3), np.nan))
    for criterion in CRITERIA.values():
        with pytest.raises(ExcitationError, match="the regressor of the motion"):
            criterion.smooth(np.full((3, 3), np.nan))
