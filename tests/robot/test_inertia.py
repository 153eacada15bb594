"""The ten inertial parameters, each law against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.robot import PARAMETERS, inconsistency, inertia, is_physical

seeds = st.integers(0, 2**32 - 1)


def random_body(seed: int) -> tuple[pin.Inertia, Array]:
    """Return a possible body, as Pinocchio's inertia and as ten parameters."""
    rng = np.random.default_rng(seed)
    spread = rng.normal(size=(3, 3))
    second = spread @ spread.T
    tensor = np.trace(second) * np.eye(3) - second
    body = pin.Inertia(rng.uniform(0.1, 5), rng.normal(size=3), tensor)
    return body, np.asarray(body.toDynamicParameters())


def random_placement(seed: int) -> pin.SE3:
    rng = np.random.default_rng(seed)
    rotation = pin.exp3(rng.uniform(-2, 2, 3))
    return pin.SE3(rotation, rng.normal(size=3))


def test_names_and_units_stand_in_pinocchios_order() -> None:
    names = inertia.parameter_names(["thigh", "foot"])
    assert len(PARAMETERS) == len(inertia.UNITS) == 10
    assert names[:3] == ("m_thigh", "mx_thigh", "my_thigh")
    assert names[16] == "Iyy_foot"
    body = pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 2.0, 3.0]))
    named = dict(zip(PARAMETERS, body.toDynamicParameters(), strict=True))
    assert named["m"] == 2.0
    assert named["my"] == pytest.approx(0.4)
    assert named["Iyy"] == pytest.approx(2.0 + 2.0 * (0.1**2 + 0.3**2))
    assert named["Ixz"] == pytest.approx(-2.0 * 0.1 * 0.3)


@given(seeds, st.floats(1.001, 3))
def test_a_body_is_possible_until_a_moment_exceeds_the_other_two(seed: int, excess: float) -> None:
    """In any frame, and no reason is found against a possible body."""
    body, parameters = random_body(seed)
    assert is_physical(inertia.in_parent_frame(parameters, random_placement(seed)))
    assert inconsistency(parameters) is None
    moments, axes = np.linalg.eigh(body.inertia)
    moments[2] = excess * (moments[0] + moments[1])
    tensor = axes @ np.diag(moments) @ axes.T
    assert not is_physical(inertia.from_center_of_mass(body.mass, body.lever, tensor))


def test_point_mass_and_nothing_are_possible_negative_mass_is_not() -> None:
    point = inertia.from_center_of_mass(2.0, np.array([0.1, -0.4, 0.3]), np.zeros((3, 3)))
    assert is_physical(point)
    assert is_physical(np.zeros(10))
    assert not is_physical(-point)
    assert inconsistency(np.zeros(10)) is None
    assert inconsistency(np.eye(10)[4]) == "inertia without mass"
    assert inconsistency(-np.eye(10)[0]) == "a negative mass, -1 kg"


@pytest.mark.parametrize(
    ("moments", "reason"),
    [
        ((1.0, 2.0, 3.0), None),
        ((1.0, 2.0, 3.002), None),  # a plate, its digits rounded
        ((0.0, 0.0, 0.0), None),
        ((1.0, 2.0, 3.1), "above the sum of the other two: 1, 2, 3.1 kg m^2"),
        ((0.0, 0.0, 1.0), "above the sum of the other two: 0, 0, 1 kg m^2"),
        ((-0.1, 2.0, 2.0), "a negative principal moment of inertia: -0.1, 2, 2 kg m^2"),
    ],
)
@given(seed=seeds)
def test_an_impossible_tensor_is_named_wherever_the_body_is(
    moments: tuple[float, float, float], reason: str | None, seed: int
) -> None:
    body = inertia.from_center_of_mass(2.0, np.zeros(3), np.diag(moments))
    found = inconsistency(inertia.in_parent_frame(body, random_placement(seed)))
    assert found is None if reason is None else found is not None and reason in found
