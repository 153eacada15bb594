"""Inertia ellipsoids: the ellipsoid of a body that is an ellipsoid, against sampled mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

from seaid._arrays import Array
from seaid.robot.inertia import from_center_of_mass, in_parent_frame
from seaid.robot.robot import Robot
from seaid.view.picture import Ellipsoid, ellipsoids_of


def bodies_of(leg: Robot, *parameters: Array) -> list[Ellipsoid]:
    """Return the ellipsoids of the first bodies of a robot with these ten parameters each."""
    values = np.array(leg.parameters)
    values[: 10 * len(parameters)] = np.concatenate(parameters)
    return list(ellipsoids_of(leg.with_values(values, leg.drives)))[: len(parameters)]


@dataclass(frozen=True)
class Solid:
    """A uniform ellipsoid: mass [kg], semi-axes [m], and where it is."""

    mass: float
    semi_axes: tuple[float, float, float]
    placement: pin.SE3

    @property
    def parameters(self) -> Array:
        """The ten parameters, by the sum over points of equal mass."""
        grid = np.linspace(-1.0, 1.0, 81)
        points = np.array(np.meshgrid(grid, grid, grid)).reshape(3, -1).T
        points = points[np.sum(points**2, axis=1) <= 1.0] * self.semi_axes
        second = self.mass * points.T @ points / len(points)
        inertia = np.trace(second) * np.eye(3) - second
        centered = from_center_of_mass(self.mass, np.zeros(3), inertia)
        return in_parent_frame(centered, self.placement)


def test_ellipsoid_of_a_uniform_ellipsoid_is_itself(tulip_leg: Robot) -> None:
    turn = pin.exp3(np.array([0.3, -0.8, 0.5]))
    solid = Solid(3.2, (0.05, 0.11, 0.30), pin.SE3(turn, np.array([0.1, -0.2, 0.4])))
    (found,) = bodies_of(tulip_leg, solid.parameters)
    assert found.mass == pytest.approx(3.2)
    np.testing.assert_allclose(found.center, [0.1, -0.2, 0.4])
    np.testing.assert_allclose(found.semi_axes, solid.semi_axes, rtol=2e-3)  # of the grid
    np.testing.assert_allclose(np.abs(found.rotation.T @ turn), np.eye(3), atol=1e-9)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


def test_semi_axes_are_those_of_the_principal_moments(tulip_leg: Robot) -> None:
    moments = np.array([0.02, 0.05, 0.06])
    (found,) = bodies_of(tulip_leg, from_center_of_mass(2.0, np.zeros(3), np.diag(moments)))
    squares = [5 / (2 * 2.0) * (np.sum(moments) - 2 * one) for one in moments]
    np.testing.assert_allclose(found.semi_axes, np.sort(np.sqrt(squares)))


def test_point_mass_has_no_extent(tulip_leg: Robot) -> None:
    (found,) = bodies_of(tulip_leg, from_center_of_mass(2.0, np.ones(3), np.zeros((3, 3))))
    assert found.problem is None
    np.testing.assert_allclose(found.semi_axes, 0.0, atol=1e-7)


def test_inconsistent_bodies_have_a_reason_in_place_of_an_ellipsoid(tulip_leg: Robot) -> None:
    long = from_center_of_mass(2.0, np.array([0.0, 0.0, 0.3]), np.diag([0.01, 0.01, 0.03]))
    light = from_center_of_mass(-1.0, np.array([0.0, 0.0, 0.3]), np.diag([0.01, 0.01, 0.01]))
    found = bodies_of(tulip_leg, long, light)
    assert found[0].problem is not None
    assert "above the sum of the other two" in found[0].problem
    np.testing.assert_allclose(found[0].center, [0.0, 0.0, 0.3])
    assert found[1].problem == "a negative mass, -1 kg"
    for one in found:
        np.testing.assert_array_equal(one.semi_axes, 0.0)
    np.testing.assert_array_equal(found[1].center, 0.0)


def test_bodies_without_values_have_no_ellipsoid(tulip_leg: Robot) -> None:
    values = np.array(tulip_leg.parameters)
    values[:10], values[10:20] = 0.0, np.nan
    names = [one.name for one in ellipsoids_of(tulip_leg.with_values(values, tulip_leg.drives))]
    assert names == list(tulip_leg.body_names[2:])
