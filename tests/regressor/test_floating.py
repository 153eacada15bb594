"""The rows of a floating base: Newton-Euler with contact forces, and what stances determine."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import seaid
from scripts.example_robots import example_urdf, example_urdfs
from seaid._arrays import Array
from seaid.errors import ExcitationError, RobotError, SeaidWarning
from seaid.regressor.floating import (
    BaseStates,
    contact_equations,
    contact_map,
    floating_regressor,
    floating_rows,
    stance_states,
    without_contact_forces,
)
from seaid.regressor.structural.stances import columns_of_stances
from seaid.robot import Contact, Robot, floating_model

DOWN = np.array([0.0, 0.0, -9.81])
FEET = {
    "go2.urdf": ("FL_foot", "FR_foot", "RL_foot", "RR_foot"),
    "solo12.urdf": ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
    "b1-z1.urdf": ("FL_foot", "FR_foot", "RL_foot", "RR_foot"),
}
FLOATING = (
    *("a1.urdf", "anymal-kinova.urdf", "b1.urdf", "b1-z1.urdf", "bolt.urdf", "go1.urdf"),
    *("go2.urdf", "g1_29dof_rev_1_0.urdf", "hyq_no_sensors.urdf", "icub_reduced.urdf"),
    *("laikago.urdf", "romeo_small.urdf", "simple_humanoid.urdf", "solo12.urdf"),
    *("talos_reduced.urdf", "borinot_flying_arm_2.urdf", "tiago_pro.urdf"),
)


def floating(name: str, **options: object) -> Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)
        return seaid.load_robot(example_urdf(name), base="floating", **options)  # type: ignore[arg-type]


def states_in_the_world(
    robot: Robot, rng: np.random.Generator
) -> tuple[BaseStates, BaseStates, Array, pin.Model, Array]:
    """Random states, the wrench and torques of Pinocchio's rnea at any pose, and the pose."""
    q_j, v_j, a_j = rng.normal(size=(3, 1, robot.n)) * np.array([1, 2, 5])[:, None, None]
    joints = (q_j, v_j, a_j)
    w, e, v, place = rng.normal(size=(4, 3)) * np.array([[1], [3], [2], [1]])
    R = pin.exp3(rng.normal(size=3))
    f = rng.normal(size=3) * 8
    classical = f + R.T @ DOWN  # f = R^T (a - g)
    model = floating_model(robot.model, robot.parameters[-10:])
    model.gravity.linear = DOWN
    q = np.concatenate([place, pin.Quaternion(R).coeffs(), robot.to_model(joints[0])[0]])
    speed = np.concatenate([v, w, robot.to_model(joints[1], 1)[0]])
    rate = np.concatenate([classical - np.cross(w, v), e, robot.to_model(joints[2], 2)[0]])
    forces = pin.rnea(model, model.createData(), q, speed, rate)
    rows = np.concatenate([forces[:6], robot.from_model(forces[6:])])
    return joints, (w[None], e[None], f[None]), rows, model, q


@pytest.mark.parametrize("name", FLOATING)
def test_rows_of_base_and_joints_are_inverse_dynamics_at_any_pose(name: str) -> None:
    robot, rng = floating(name), np.random.default_rng(1)
    for _ in range(4):
        joints, base, rows, _, _ = states_in_the_world(robot, rng)
        Y = floating_regressor(robot, *joints, base)[0]
        scale = np.max(np.abs(rows))
        np.testing.assert_allclose(Y @ robot.parameters, rows, rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("name", FEET)
def test_map_of_contact_forces_is_the_transposed_jacobian_of_pinocchio(name: str) -> None:
    robot, rng = floating(name, contacts=FEET[name]), np.random.default_rng(2)
    joints, _, _, _, q = states_in_the_world(robot, rng)
    tree = pin.buildModelFromUrdf(str(robot.urdf), pin.JointModelFreeFlyer())
    data, theirs = tree.createData(), pin.neutral(tree)
    theirs[:7] = q[:7]
    for joint, angle in zip(robot.joint_names, joints[0][0], strict=True):
        place = tree.joints[tree.getJointId(joint)].idx_q
        theirs[place] = angle
    A = contact_map(robot, joints[0], robot.floating_base.contacts)[0]  # type: ignore[union-attr]
    R = pin.Quaternion(q[3:7]).toRotationMatrix()
    order = [tree.joints[tree.getJointId(joint)].idx_v for joint in robot.joint_names]
    for place, foot in enumerate(FEET[name]):
        frame = tree.getFrameId(foot)
        J = pin.computeFrameJacobian(tree, data, theirs, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        expected = (R.T @ J)[:, [*range(6), *order]].T  # forces in the frame of the base
        np.testing.assert_allclose(A[:, 3 * place : 3 * place + 3], expected, atol=1e-12)


def test_rows_without_contact_forces_hold_whatever_the_forces_are() -> None:
    name = "go2.urdf"
    contacts = [Contact(foot, radius_m=0.02) for foot in FEET[name]]
    robot, rng = floating(name, contacts=contacts), np.random.default_rng(3)
    joints, base = stance_states(robot, FEET[name], 1, 20)
    up = rng.normal(size=(20, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    known = [0, 1, 2, 4, 5, 8, 9, 10, 11]  # three joints have no torque in the log
    A = contact_map(robot, joints[0], contacts, up)
    forces = 100 * rng.normal(size=A.shape[::2])
    Y = floating_regressor(robot, *joints, base)
    torques = Y @ robot.parameters - np.einsum("trk,tk->tr", A, forces)
    rows = np.concatenate([Y, (Y @ robot.parameters - torques)[:, :, None]], axis=2)
    touching = {foot: np.ones(20, dtype=bool) for foot in FEET[name]}
    left = without_contact_forces(
        robot, joints[0], touching, known, floating_rows(robot, rows, known), up=up
    )
    assert np.max(np.abs(left[:, :, -1])) < 1e-10 * np.max(np.abs(forces))
    assert np.linalg.matrix_rank(left[0, :, :-1]) == 6 + len(known) - 12


def test_stances_stand_still() -> None:
    name = "solo12.urdf"
    contacts = [Contact(foot) for foot in FEET[name]]
    robot = floating(name, contacts=contacts)
    (q, v, _), (w, _, _) = stance_states(robot, FEET[name][:2], 4, 5)
    J = contact_map(robot, q, contacts[:2]).swapaxes(1, 2)
    # the velocity of the base that keeps both feet at rest exists: J_v v = -J_w w - J_q q'
    moved = np.einsum("tij,tj->ti", J[:, :, 3:], np.hstack([w, v]))
    for now, speed in zip(J[:, :, :3], moved, strict=True):
        base = np.linalg.lstsq(now, -speed, rcond=None)[0]
        np.testing.assert_allclose(now @ base, -speed, atol=1e-10)


def union(robot: Robot, *stances: tuple[str, ...]) -> int:
    return len(seaid.base_parameters(robot, stances=stances).columns)


@pytest.mark.parametrize("name", ["go2.urdf", "solo12.urdf"])
def test_each_foot_that_always_stands_hides_one_parameter(name: str) -> None:
    feet = FEET[name]
    robot = floating(name, contacts=feet)
    in_flight = len(
        seaid.symbolic.base_parameters(
            seaid.load_robot(example_urdf(name)), through="recursion", floating_base=True
        ).columns
    )
    assert union(robot, ()) == in_flight == 94
    for count in range(1, 5):  # a point mass at the foot is carried by the ground
        assert union(robot, feet[:count]) == in_flight - count
    assert union(robot, (feet[0], feet[3]), (feet[1], feet[2])) == in_flight  # a trot


def test_flat_feet_hide_the_bodies_of_the_feet() -> None:
    soles = ("left_sole_link", "right_sole_link")
    robot = floating("talos_reduced.urdf", contacts=[Contact(x, is_flat=True) for x in soles])
    assert union(robot, ()) == 234
    assert union(robot, soles[:1]) == 220
    assert union(robot, soles) == 206
    assert union(robot, soles[:1], soles[1:]) == 234


def is_determined(robot: Robot, direction: Array, *stances: tuple[str, ...]) -> bool:
    grouping = seaid.base_parameters(robot, stances=stances).grouping
    left = direction - grouping.T @ np.linalg.lstsq(grouping.T, direction, rcond=None)[0]
    return bool(np.linalg.norm(left) < 1e-9 * np.linalg.norm(direction))


def test_total_mass_needs_feet_that_leave_the_ground() -> None:
    feet = FEET["go2.urdf"]
    robot = floating("go2.urdf", contacts=feet)
    mass = np.zeros(len(robot.parameters))
    mass[::10] = 1.0
    assert is_determined(robot, mass, ())
    assert is_determined(robot, mass, (feet[0], feet[3]), (feet[1], feet[2]))
    # the ground carries a point mass at a foot that always stands
    assert not is_determined(robot, mass, feet)


MESSAGES = (
    ({"contacts": ["FL_fot"]}, "contacts=: no link is named 'FL_fot'; did you mean 'FL_foot'?"),
    ({"contacts": ["FL_foot", "FL_foot"]}, "contacts= names 'FL_foot' twice"),
    ({"imu_link": "imo"}, "imu_link=: no link is named 'imo'"),
)


@pytest.mark.parametrize(("options", "message"), MESSAGES)
def test_message_of_wrong_links(options: dict[str, object], message: str) -> None:
    with pytest.raises(RobotError) as problem:
        floating("go2.urdf", **options)
    assert message in str(problem.value)


def test_message_of_contacts_without_floating_base() -> None:
    with pytest.raises(RobotError, match="give base='floating' with them"):
        seaid.load_robot(example_urdf("go2.urdf"), contacts=["FL_foot"])


def test_message_of_base_without_mass(tmp_path: Path) -> None:
    path = tmp_path / "hollow.urdf"
    path.write_text(
        '<robot name="hollow"><link name="base"/><link name="arm"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="one" type="continuous"><parent link="base"/><child link="arm"/></joint>'
        "</robot>"
    )
    with pytest.raises(RobotError, match="the link 'base' and what is fixed to it have no mass"):
        seaid.load_robot(path, base="floating")


def test_floating_joint_of_the_file_is_that_of_the_base(tmp_path: Path) -> None:
    text = example_urdf("double_pendulum.urdf").read_text()
    free = (
        '<link name="ground"/><joint name="free" type="floating"><parent link="ground"/>'
        '<child link="base_link"/></joint></robot>'
    )
    path = tmp_path / "free.urdf"
    path.write_text(text.replace("</robot>", free))
    robot = seaid.load_robot(path, base="floating")
    same = seaid.load_robot(example_urdf("double_pendulum.urdf"), base="floating")
    assert robot.body_names == same.body_names
    np.testing.assert_array_equal(robot.parameters, same.parameters)


def test_robot_on_fixed_base_has_the_same_joints_and_bodies() -> None:
    names = {path.name for path in example_urdfs()}
    for name in ("go2.urdf", "solo12.urdf"):
        assert name in names
        fixed, free = seaid.load_robot(example_urdf(name)), floating(name)
        assert free.joint_names == fixed.joint_names
        assert free.body_names == (*fixed.body_names, free.floating_base.link)  # type: ignore[union-attr]
        np.testing.assert_array_equal(free.parameters[:-10], fixed.parameters)


STANDING = {
    **FEET,
    **dict.fromkeys(("a1.urdf", "go1.urdf", "b1.urdf", "laikago.urdf"), FEET["go2.urdf"]),
    "anymal-kinova.urdf": ("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"),
    "hyq_no_sensors.urdf": ("lf_foot", "rf_foot", "lh_foot", "rh_foot"),
    "bolt.urdf": ("FL_FOOT", "FR_FOOT"),
    "talos_reduced.urdf": ("left_sole_link", "right_sole_link"),
    "icub_reduced.urdf": ("l_sole", "r_sole"),
    "g1_29dof_rev_1_0.urdf": ("left_ankle_roll_link", "right_ankle_roll_link"),
    "romeo_small.urdf": ("l_sole", "r_sole"),
}
"""Robots of example-robot-data and the links of their feet; those of two are flat, but Bolt's."""


@pytest.mark.parametrize("name", STANDING)
def test_exact_columns_of_stances_are_the_numeric_ones(name: str) -> None:
    links = [x for x in STANDING[name] if x in floating(name).floating_base.frames]  # type: ignore[union-attr]
    is_flat = len(links) == 2 and name != "bolt.urdf"
    contacts = [Contact(x, is_flat=is_flat) for x in links]
    robot = floating(name, contacts=contacts)
    assert len(links) == len(STANDING[name])
    for count in range(len(links) + 1):
        exact = columns_of_stances(robot, [links[:count]])
        assert exact == seaid.base_parameters(robot, stances=[links[:count]]).columns
    apart = [[link] for link in links]
    assert columns_of_stances(robot, apart) == columns_of_stances(robot, [[]])


def test_exact_columns_with_few_known_torques_are_the_numeric_ones() -> None:
    feet = FEET["go2.urdf"]
    robot = floating("go2.urdf", contacts=feet)
    known = robot.joint_names[:5]
    stances = [feet[:1], feet[2:3]]
    exact = columns_of_stances(robot, stances, torque_joints=known)
    assert exact == seaid.base_parameters(robot, stances=stances, torque_joints=known).columns


def test_two_flat_feet_of_three_joints_each_leave_nothing() -> None:
    contacts = [Contact(x, is_flat=True) for x in STANDING["bolt.urdf"]]
    robot = floating("bolt.urdf", contacts=contacts)
    assert columns_of_stances(robot, [STANDING["bolt.urdf"]]) == ()
    with pytest.raises(ExcitationError, match="no parameter of 'bolt' is identifiable"):
        seaid.base_parameters(robot, stances=[STANDING["bolt.urdf"]])


def test_balls_that_stand_determine_what_points_do() -> None:
    feet = FEET["go2.urdf"]
    balls = floating("go2.urdf", contacts=[Contact(foot, radius_m=0.02) for foot in feet])
    points = floating("go2.urdf", contacts=feet)
    for stances in ([feet], [feet, feet[1:]], [feet[:2], feet[2:]]):
        columns = seaid.base_parameters(points, stances=stances).columns
        assert seaid.base_parameters(balls, stances=stances).columns == columns
        assert columns_of_stances(balls, stances) == columns


def test_contact_forces_are_determined_as_far_as_statics_allows() -> None:
    feet = FEET["solo12.urdf"]
    robot = floating("solo12.urdf", contacts=feet)
    assert robot.floating_base is not None
    contacts = robot.floating_base.contacts
    q = np.random.default_rng(4).uniform(-1, 1, (5, 12))
    touching = dict.fromkeys(feet, np.ones(5, dtype=bool))
    of_sum = np.tile(np.eye(3), 4)
    for joints, rank in ((range(12), 12), (range(3), 9), ((), 6)):
        A, inverse = contact_equations(robot, q, contacts, touching, list(joints))
        determined = inverse @ A
        np.testing.assert_allclose(np.trace(determined, axis1=1, axis2=2), rank, atol=1e-9)
        # without torques the base determines the sum of the forces and of their moments
        np.testing.assert_allclose(of_sum @ determined, np.tile(of_sum, (5, 1, 1)), atol=1e-9)
    A, inverse = contact_equations(robot, q, contacts, touching, range(3))
    front = np.diagonal(np.mean(inverse @ A, axis=0))
    np.testing.assert_allclose(front[:3], 1.0, atol=1e-9)
    assert np.all(front[3:] < 1 - 1e-3)
