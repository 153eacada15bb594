"""Laws that hold at every state of every robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.errors import SeaidError
from seaid.legged import load_robot
from seaid.regressor import base_parameters, joint_torques, rigid_body_regressor
from seaid.regressor.base import random_states
from seaid.robot import Payload, Robot
from seaid.robot.inertia import parameter_names

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


@given(seed=st.integers(0, 10**6))
def test_joints_in_the_users_order(tulip_urdf: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    usual = _leg(tulip_urdf, None)
    shuffled = rng.permutation(usual.n)
    robot = _leg(tulip_urdf, [usual.joint_names[index] for index in shuffled])
    q, v, a = few_states(usual, seed)
    expected = rnea(usual, q, v, a)[:, shuffled]
    picked = q[:, shuffled], v[:, shuffled], a[:, shuffled]
    assert_same(rigid_body_regressor(robot, *picked) @ robot.parameters, expected, 1e-12)
    assert_same(joint_torques(robot, *picked), expected, 1e-12)
    assert robot.parameter_names == parameter_names(robot.body_names)
    assert robot.body_names == tuple(usual.body_names[index] for index in shuffled)


def test_payload_is_added_on_the_known_side(tulip_urdf: Path) -> None:
    inertia = ((0.01, 0.001, 0.0), (0.001, 0.02, 0.0), (0.0, 0.0, 0.03))
    payload = Payload("foot", 2.0, (0.15, 0.02, -0.01), inertia)
    bare, loaded = _leg(tulip_urdf, None), _leg(tulip_urdf, None, payload)
    assert np.array_equal(bare.parameters, loaded.parameters)
    states = few_states(loaded, seed=6)
    Y = rigid_body_regressor(loaded, *states)
    torques = rnea(loaded, *states)
    assert_same(Y @ (loaded.parameters + loaded.payload_parameters), torques, 1e-12)
    assert np.max(np.abs(torques - rnea(bare, *states))) > 1.0
    assert_same(joint_torques(loaded, *states), torques, 1e-12)


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


def _leg(urdf: Path, joints: list[str] | None, *payloads: Payload) -> Robot:
    return load_robot(urdf, joints=joints, payloads=payloads)
