"""The rows of a floating base: Newton-Euler with contact forces, and what stances determine."""

import copy
import pickle
import re
import subprocess
import sys
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.errors import ExcitationError, RobotError, SeaidWarning
from seaid.legged import FloatingRobot
from seaid.legged.floating import (
    BaseStates,
    contact_equations,
    floating_regressor,
    measured_wrenches,
    without_contact_forces,
)
from seaid.legged.load_side import stances_of
from seaid.log import BaseLog
from seaid.log.base_log import moving_base
from seaid.robot import Contact, Robot
from seaid.robot.pinocchio_model import floating_model
from tests.regressor.stances import columns_of_stances

DOWN = np.array([0.0, 0.0, -9.81])
FEET: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("a1.urdf", "go2.urdf"), ("FL_foot", "FR_foot", "RL_foot", "RR_foot")),
    "b1-z1.urdf": ("FL_foot", "FR_foot", "RL_foot", "RR_foot"),
    "anymal.urdf": ("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"),
    "hyq_no_sensors.urdf": ("lf_foot", "rf_foot", "lh_foot", "rh_foot"),
    "solo12.urdf": ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
    "bolt.urdf": ("FL_FOOT", "FR_FOOT"),
    "centauro.urdf": ("wheel_1", "wheel_2", "wheel_3", "wheel_4"),
}
"""Links of feet that are points, of robots of example-robot-data."""
SOLES: dict[str, tuple[str, ...]] = {
    "alexander_v1.lowerBodyOnly.urdf": ("LEFT_FOOT", "RIGHT_FOOT"),
    "g1_29dof_rev_1_0.urdf": ("left_ankle_roll_link", "right_ankle_roll_link"),
    "human.urdf": ("left_foot", "right_foot"),
    **dict.fromkeys(("icub.urdf", "romeo.urdf"), ("l_sole", "r_sole")),
    "simple_humanoid.urdf": ("l_ankle", "r_ankle"),
    "talos_reduced.urdf": ("left_sole_link", "right_sole_link"),
}
"""Links of feet that are flat."""
FREE_FLYERS = (*FEET, *SOLES, "borinot_flying_arm_2.urdf", "iris.urdf", "alex_nub_hands.urdf")
"""Robots on feet or in the air, with one or more of each kind."""
QUICK = ("go2.urdf", "bolt.urdf", "alexander_v1.lowerBodyOnly.urdf", "iris.urdf")


def of_robots(names: Iterable[str]) -> list[Any]:
    """Return robots as parameters of a test: all slow but for one with each kind of feet."""
    return [pytest.param(x, marks=() if x in QUICK else pytest.mark.slow) for x in names]


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


@pytest.mark.parametrize("name", of_robots(FREE_FLYERS))
def test_rows_of_base_and_joints_are_inverse_dynamics_at_any_pose(name: str) -> None:
    robot, rng = floating(name), np.random.default_rng(1)
    for _ in range(2):
        joints, base, rows, _, _ = states_in_the_world(robot, rng)
        Y = floating_regressor(robot, *joints, base)[0]
        scale = np.max(np.abs(rows))
        np.testing.assert_allclose(Y @ robot.parameters, rows, rtol=0, atol=1e-9 * scale)


GO2 = FEET["go2.urdf"]


HOLLOW = (
    '<robot name="hollow"><link name="base"/><link name="arm"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="one" type="continuous"><parent link="base"/><child link="arm"/></joint></robot>'
)

REFUSED: dict[str, dict[str, Any]] = {
    "contacts=: no link is named 'FL_fot'; did you mean 'FL_foot'?": {"contacts": ["FL_fot"]},
    "contacts= names 'FL_foot' twice": {"contacts": ["FL_foot", "FL_foot"]},
    "imu_link=: no link is named 'imo'": {"imu_link": "imo"},
    "give base='floating' with them": {"contacts": ["FL_foot"], "base": "fixed"},
    "hollow.urdf' and what is fixed to it have no mass": {"path": "hollow.urdf"},
}


@pytest.mark.parametrize("words", REFUSED)
def test_wrong_links_and_a_base_without_mass_are_refused(words: str, tmp_path: Path) -> None:
    (tmp_path / "hollow.urdf").write_text(HOLLOW)
    options = {"base": "floating", **REFUSED[words]}
    file = options.pop("path", None)
    path = tmp_path / file if file else example_urdf("go2.urdf")
    with pytest.raises(RobotError, match=re.escape(words)):
        seaid.load_robot(path, **options)


@pytest.mark.slow  # 1.6 s: a process that imports seaid
def test_a_robot_in_another_process_has_its_additions(tmp_path: Path) -> None:
    """Its type knows nothing of what is registered for it, so that the pickle must load that."""
    (tmp_path / "robot.pkl").write_bytes(pickle.dumps(standing("go2.urdf")))
    code = (
        "import pickle, sys; robot = pickle.load(open(sys.argv[1], 'rb'));"
        "from seaid.regressor.load import load_side; print(type(load_side(robot)).__name__)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "robot.pkl")]
    assert subprocess.check_output(command, text=True).strip() == "FloatingLoadSide"


def test_floating_joint_of_the_file_is_that_of_the_base(tmp_path: Path) -> None:
    """A robot on a fixed base has the same joints, and bodies but for that of the base."""
    urdf = example_urdf("double_pendulum.urdf")
    fixed, free = seaid.load_robot(urdf), _freed(urdf)
    path = tmp_path / "free.urdf"
    joint = '<joint name="free" type="floating"><parent link="ground"/><child link="base_link"/>'
    text = urdf.read_text()
    path.write_text(text.replace("</robot>", f'<link name="ground"/>{joint}</joint></robot>'))
    for robot in (_freed(path), free, copy.deepcopy(free)):
        assert isinstance(robot, FloatingRobot)
        assert robot.joint_names == fixed.joint_names
        assert robot.body_names == (*fixed.body_names, "base_link")
        np.testing.assert_array_equal(robot.parameters, free.parameters)
        np.testing.assert_array_equal(robot.parameters[:-10], fixed.parameters)


def _freed(path: Path) -> Robot:
    return seaid.load_robot(path, base="floating")


def standing(name: str) -> Robot:
    """Return a robot with its feet as contacts."""
    links, flat = ({**FEET, **SOLES}.get(name, ()), name in SOLES)
    return floating(name, contacts=[Contact(x, is_flat=flat) for x in links])


def stances_of_feet(links: tuple[str, ...]) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Return (standing, measured): flight, one to all feet, and wrenches of one and of all feet."""
    unmeasured = [(links[:count], ()) for count in range(len(links) + 1)]
    return [*unmeasured, *([(links, links[:1]), (links, links)] if links else [])]


@pytest.mark.parametrize("name", of_robots(FREE_FLYERS))
def test_exact_columns_of_stances_are_the_numeric_ones(name: str) -> None:
    robot, links = standing(name), {**FEET, **SOLES}.get(name, ())
    all_stances = stances_of_feet(links)
    # those between with robots of each kind
    stances = all_stances if name in QUICK else [*all_stances[:1], *all_stances[-3:-1]]
    for touching, measured in stances:
        exact = columns_of_stances(robot, [touching], measured=measured)
        if not exact:
            with pytest.raises(ExcitationError, match="is identifiable from"):
                seaid.base_parameters(robot, stances=[touching], measured=measured)
            continue
        found = seaid.base_parameters(robot, stances=[touching], measured=measured)
        assert exact == found.columns, (touching, measured)
    apart = [[link] for link in links]
    if apart and name in QUICK:
        assert columns_of_stances(robot, apart) == columns_of_stances(robot, [[]])


def test_exact_columns_of_other_contacts_are_the_numeric_ones() -> None:
    """With few known torques; of balls, whose stances determine what points do; and of nothing."""
    points, known = standing("go2.urdf"), standing("go2.urdf").joint_names[:5]
    stances = [GO2[:1], GO2[2:3]]
    exact = columns_of_stances(points, stances, torque_joints=known)
    found = seaid.base_parameters(points, stances=stances, torque_joints=known)
    assert exact == found.columns
    balls = floating("go2.urdf", contacts=[Contact(foot, radius_m=0.02) for foot in GO2])
    for stances in ([GO2], [GO2[:2], GO2[2:]]):
        exact = columns_of_stances(balls, stances)
        for robot in (points, balls):
            assert seaid.base_parameters(robot, stances=stances).columns == exact
    # two flat feet of three joints each leave nothing
    feet = FEET["bolt.urdf"]
    robot = floating("bolt.urdf", contacts=[Contact(x, is_flat=True) for x in feet])
    assert columns_of_stances(robot, [feet]) == ()
    with pytest.raises(ExcitationError, match="no parameter of 'bolt' is identifiable"):
        seaid.base_parameters(robot, stances=[feet])


@pytest.mark.parametrize("name", of_robots([*FEET, *SOLES]))
def test_rows_of_each_stance_are_inverse_dynamics_with_contact_forces(name: str) -> None:
    robot, rng, links = standing(name), np.random.default_rng(5), {**FEET, **SOLES}[name]
    joints, base, rows, model, q = states_in_the_world(robot, rng)
    contacts = moving_base(robot).contacts
    known = [*range(0, robot.n, 2), *range(1, robot.n, 4)]  # others have no torque in the log
    kept = [*range(6), *(6 + joint for joint in known)]
    width = 6 if name in SOLES else 3
    Y, torques, wrenches = floating_regressor(robot, *joints, base), rows.copy(), {}
    for contact in contacts:
        own = 100 * rng.normal(size=width)
        wrenches[contact.link] = own[None]
        torques -= pushed(robot, model, q, contact, own)
    scale = np.max(np.abs(rows)) + np.max(np.abs(torques))
    for touching, measured in stances_of_feet(links):
        away = {x: y for x, y in wrenches.items() if x not in touching or x in measured}
        felt = measured_wrenches(robot, joints[0], away, known)
        left = (Y @ robot.parameters - torques)[:, kept] - felt
        hidden = {x: np.ones(1, dtype=bool) for x in touching if x not in measured}
        if hidden:
            left = without_contact_forces(robot, joints[0], hidden, known, left[:, :, None])
        assert np.max(np.abs(left)) < 1e-9 * scale, (touching, measured)


def pushed(robot: Robot, model: pin.Model, q: Array, contact: Contact, own: Array) -> Array:
    """Return the rows (6 + n,) of a wrench at a contact in the axes of its link, by Pinocchio."""
    body, rotation, position = moving_base(robot).frame(contact.link)
    joint = 1 if body < 0 else 2 + robot.model_order.index(body)
    still = np.zeros(model.nv)
    forces = pin.StdVec_Force()
    for _ in range(model.njoints):
        forces.append(pin.Force.Zero())
    place = pin.SE3(rotation, position + rotation @ np.array(contact.position_m))
    forces[joint] = place.act(pin.Force(own[:3], np.append(own[3:], np.zeros(6 - len(own)))))
    data = model.createData()
    moved = pin.rnea(model, data, q, still, still) - pin.rnea(model, data, q, still, still, forces)
    return np.concatenate([moved[:6], robot.from_model(moved[6:])])


def test_stances_of_a_log_have_the_flat_feet_whose_wrench_is_measured() -> None:
    name, count = "alexander_v1.lowerBodyOnly.urdf", 2001
    robot, soles, time = standing(name), SOLES[name], np.linspace(0, 10, count)
    stand = np.tile([0.0, 0, 100, 1, 0, 0], (count, 1))
    lifted = stand * (np.abs(time - 5) > 2)[:, None]
    q = 0.1 * np.sin(np.outer(2 * np.pi * time, np.linspace(0.2, 0.5, robot.n)))

    def stances(**wrenches: Array) -> tuple[object, object]:
        held = dict(zip(soles, wrenches.values(), strict=False))
        flags = {x: np.ones(count) for x in soles if x not in held}
        base = BaseLog(
            orientation=np.tile([1.0, 0, 0, 0], (count, 1)),
            position=np.zeros((count, 3)),
            contacts=flags,
            wrenches=held,
        )
        log = seaid.Log(time, robot.joint_names, q, q, q, base=base)
        assert isinstance(robot, FloatingRobot)
        return stances_of(robot, [seaid.reconstruct_motion(robot, log, cutoff_hz=3.0)])

    assert stances(left=stand, right=stand) == ((soles,), soles)
    assert stances(left=stand, right=lifted) == ((soles[:1], soles), soles)
    touching, measured = stances(left=stand)
    assert (set(*touching), measured) == ({*soles}, soles[:1])  # type: ignore[misc]


def test_contact_forces_are_determined_as_far_as_statics_allows() -> None:
    feet = FEET["solo12.urdf"]
    robot = floating("solo12.urdf", contacts=feet)
    contacts = moving_base(robot).contacts
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
