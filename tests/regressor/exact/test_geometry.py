"""The exact geometry: orthogonal over the rationals, and the doubles of the file."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from flint import fmpq, fmpq_mat
from hypothesis import given
from hypothesis import strategies as st

from seaid.legged import load_robot
from seaid.regressor.exact.geometry import (
    as_floats,
    exact_number,
    exact_rotation,
    exact_tree,
    inertia_transform,
    joint_axis,
    number,
    twist_transform,
)
from seaid.robot.inertia import in_parent_frame
from seaid.robot.robot import Robot

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


def test_quarter_turns_are_integers() -> None:
    quarters = np.arange(-2, 3) * np.pi / 2
    for roll in quarters:
        for pitch in quarters:
            for yaw in quarters:
                rotation = pin.rpy.rpyToMatrix(roll, pitch, yaw)
                exact = exact_rotation(rotation)
                assert all(x.q == 1 for x in exact.entries())
                assert np.array_equal(as_floats(exact), np.round(rotation))


@pytest.mark.parametrize("tilt", [1e-6, 1e-9, 3e-13])
def test_small_tilt_stays_a_tilt(tilt: float) -> None:
    rotation = pin.rpy.rpyToMatrix(tilt, 0.3 * tilt, 1.0)
    exact = exact_rotation(rotation)
    assert exact[2, 2] != 1
    np.testing.assert_allclose(as_floats(exact), rotation, rtol=0, atol=1e-15)


def test_example_robot_has_its_own_geometry(
    example_urdf: Path, load_quietly: Callable[..., Robot]
) -> None:
    robot = load_quietly(example_urdf)
    tree = exact_tree(robot)
    for place, joint in enumerate(tree.joints):
        above = IDENTITY if joint.parent < 0 else tree.joints[joint.parent].alignment
        placement = robot.model.jointPlacements[place + 1]
        rotation = above * joint.rotation * joint.alignment.transpose()
        assert rotation * rotation.transpose() == IDENTITY
        np.testing.assert_allclose(as_floats(rotation), placement.rotation, rtol=0, atol=1e-14)
        np.testing.assert_allclose(
            as_floats(above * joint.translation)[:, 0], placement.translation, rtol=0, atol=1e-15
        )
        axis = joint.alignment * fmpq_mat(3, 1, [0, 0, 1])
        np.testing.assert_allclose(
            as_floats(axis)[:, 0], joint_axis(robot.model.joints[place + 1]), rtol=0, atol=1e-15
        )


def test_bodies_are_those_of_the_robot_when_joints_are_asked_for_in_another_order(
    tulip_urdf: Path,
) -> None:
    robot = load_robot(tulip_urdf, joints=["knee_pitch", "hip_pitch", "hip_yaw"])
    tree = exact_tree(robot)
    assert tree.bodies == robot.model_order
    assert [joint.parent for joint in tree.joints] == [-1, 0, 1]


def test_transforms_are_those_of_pinocchio() -> None:
    pin.seed(0)
    placement = pin.SE3.Random()
    rng = np.random.default_rng(0)
    rotation = exact_rotation(placement.rotation)
    translation = fmpq_mat([[exact_number(x)] for x in placement.translation])
    parameters = rng.normal(size=10)
    np.testing.assert_allclose(
        as_floats(inertia_transform(rotation, translation)) @ parameters,
        in_parent_frame(parameters, placement),
        atol=1e-14,
    )
    np.testing.assert_allclose(
        as_floats(twist_transform(rotation, translation)), placement.inverse().action, atol=1e-14
    )
    assert number(fmpq(1, 3)) == 1 / 3
