"""Laws that hold at every state of every robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from seaid._arrays import Array
from seaid.errors import SeaidError
from seaid.regressor import base_parameters, rigid_body_regressor
from seaid.regressor.base import random_states
from seaid.robot import Robot

STATES = 6


def few_states(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    q, v, a = random_states(robot, seed)
    return q[:STATES], v[:STATES], a[:STATES]


def rnea(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return pin.rnea in the robot's joint order, mapped by joint name."""
    data = robot.model.createData()
    where = [robot.joint_names.index(name) for name in list(robot.model.names)[1:]]
    torques = np.empty_like(q)
    for t in range(len(q)):
        torques[t, where] = pin.rnea(robot.model, data, q[t, where], v[t, where], a[t, where])
    return torques


def assert_same(found: Array, expected: Array, relative: float) -> None:
    assert np.max(np.abs(found - expected)) <= relative * np.max(np.abs(expected))


@pytest.mark.rounding
def test_regressor_times_parameters_is_rnea_on_every_robot(
    example_urdf: Path, load_quietly: Callable[..., Robot]
) -> None:
    """So is that of base parameters, whose grouping is one of columns: it holds for any values."""
    robot = load_quietly(example_urdf)
    states = few_states(robot, seed=3)
    Y, torques = rigid_body_regressor(robot, *states), rnea(robot, *states)
    assert np.max(np.abs(torques)) > 1e-6
    assert_same(Y @ robot.parameters, torques, 1e-9)
    if robot.n > 60:
        pytest.skip("tiago_dual: 1010 columns take 10 s; test_base has it, marked slow")
    base = base_parameters(robot)
    assert_same(base.reduce(Y) @ base.project(robot.parameters), torques, 1e-9)
    assert_same(base.reduce(Y) @ base.grouping, Y, 1e-9)


def test_regressor_has_neither_values_of_bodies_nor_rotors_in_it(tulip_leg: Robot) -> None:
    """And states of another shape are refused."""
    q, v, a = few_states(tulip_leg, seed=7)
    Y, unknown = rigid_body_regressor(tulip_leg, q, v, a), tulip_leg.without_nominal()
    geared = tulip_leg.with_values(tulip_leg.parameters, tulip_leg.drives)
    geared.model.armature = np.full(geared.n, 0.1)
    for robot in (unknown, geared):
        assert np.array_equal(Y, rigid_body_regressor(robot, q, v, a))
    assert base_parameters(unknown).columns == base_parameters(tulip_leg).columns
    with pytest.raises(SeaidError, match=r"v must have shape \(any, 5\), found \(6, 4\)"):
        rigid_body_regressor(tulip_leg, q, v[:, :4], a)
    with pytest.raises(SeaidError, match="as many rows, found 6, 5, 6"):
        rigid_body_regressor(tulip_leg, q, v[:5], a)
