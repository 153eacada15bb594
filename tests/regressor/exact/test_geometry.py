"""The exact geometry: orthogonal over the rationals, and the doubles of the file."""

from fractions import Fraction
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from flint import fmpq, fmpq_mat
from hypothesis import given
from hypothesis import strategies as st

from seaid.regressor.exact.geometry import as_floats, exact_number, exact_rotation

IDENTITY = fmpq_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
angles = st.floats(-3.2, 3.2)


def as_fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))


@pytest.mark.parametrize(
    ("value", "meant"),
    [
        (0.1, "1/10"),
        (-0.056600000000000004, "-0.0566"),
        (0.22317499999999998, "0.223175"),
        (1.7436510745838653e-19, "0"),
        (4.65661e-10, "4.65661e-10"),
        (1 / 3, "0.333333333333333"),
        (-9.81, "-9.81"),
        (1234.5678, "1234.5678"),
    ],
)
def test_number_is_the_decimal_that_was_meant(value: float, meant: str) -> None:
    assert as_fraction(exact_number(value)) == Fraction(meant)


@given(roll=angles, pitch=angles, yaw=angles)
def test_any_rotation_is_orthogonal_and_within_float_noise(
    roll: float, pitch: float, yaw: float
) -> None:
    rotation = pin.rpy.rpyToMatrix(roll, pitch, yaw)
    exact = exact_rotation(rotation)
    assert exact * exact.transpose() == IDENTITY
    assert exact.det() == 1
    # An angle within 1e-14 of a multiple of 90 degrees is taken as that multiple.
    np.testing.assert_allclose(as_floats(exact), rotation, rtol=0, atol=3e-14)


def test_quarter_turns_are_integers_and_a_small_tilt_stays_a_tilt() -> None:
    """All quarter turns about three axes, and tilts down to 3e-13."""
    for angles in product(np.arange(-2, 3) * np.pi / 2, repeat=3):
        rotation = pin.rpy.rpyToMatrix(*angles)
        exact = exact_rotation(rotation)
        assert all(x.q == 1 for x in exact.entries())
        assert np.array_equal(as_floats(exact), np.round(rotation))
    for tilt in (1e-6, 1e-9, 3e-13):
        rotation = pin.rpy.rpyToMatrix(tilt, 0.3 * tilt, 1.0)
        exact = exact_rotation(rotation)
        assert exact[2, 2] != 1
        np.testing.assert_allclose(as_floats(exact), rotation, rtol=0, atol=1e-15)
