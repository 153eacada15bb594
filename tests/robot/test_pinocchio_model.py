"""Mimic joints move with their leaders: independent routes, recovery of known truth, refusals."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner

import seaid
from scripts.example_robots import example_urdfs
from seaid._arrays import Array
from seaid.cli.commands import app
from seaid.errors import LogError, RobotError, SeaidWarning
from seaid.excitation.collision import collision_geometry
from seaid.project import load_project, write_first_project
from seaid.project.saved import _plain, _restored
from seaid.regressor import joint_torques, rigid_body_regressor
from seaid.regressor.base import torque_slopes
from seaid.robot import Robot
from seaid.simulation.plant import inertia, inverse_dynamics, plant_of
from tests.one_joint import BODY
from tests.plants import states, torque_slopes_by_steps, tree, write_columns, write_robot
from tests.view.test_picture import frames_by_pinocchio, link_placements

Write = Callable[[str], Path]


def _body(mass: float, com: str) -> str:
    return (
        f'<inertial><origin xyz="{com}"/><mass value="{mass}"/><inertia ixx="{0.004 * mass}" '
        f'iyy="{0.006 * mass}" izz="{0.005 * mass}" ixy="0.0002" ixz="0" iyz="0.0001"/></inertial>'
    )


_LINKS = {
    "upper": _body(2.0, "0.15 0.01 0"),
    "table": _body(1.2, "0.05 0 0.02"),
    "wrist": _body(0.8, "0.03 0.02 0.01"),
    "left": _body(0.3, "0.02 0.01 0"),
    "right": _body(0.25, "0.02 -0.01 0"),
    "cam": _body(0.4, "0.01 0.03 0.01"),
}
_LIMIT = '<limit lower="-2" upper="2" velocity="3" effort="50"/>'


def _at(place: str, axis: str, *mimic: object) -> str:
    text = f'<origin xyz="{place}"/><axis xyz="{axis}"/>{_LIMIT}'
    if mimic:
        text += '<mimic joint="{}" multiplier="{}" offset="{}"/>'.format(*mimic)
    return text


_JOINTS = {
    "shoulder": "revolute base upper " + _at("0 0 0.5", "0 1 0"),
    # a parallelogram keeps the table level but for a constant angle
    "level": "revolute upper table " + _at("0.3 0 0", "0 1 0", "shoulder", -1, 0.2),
    "turn": "revolute table wrist " + _at("0.1 0 0", "1 0 0"),
    "squeeze": "prismatic wrist left " + _at("0.1 0.02 0", "0 1 0"),
    "mirror": "prismatic wrist right " + _at("0.1 -0.02 0", "0 -1 0", "squeeze", 1, 0.01),
    # in depth-first order the follower comes before its leader; it follows through another one
    "cam_turn": "revolute wrist cam " + _at("0.05 0 0.05", "0 1 0", "mirror", -12, 0.3),
}
LEADERS = ("shoulder", "turn", "squeeze")


def gripper_text() -> str:
    return tree(_JOINTS, _LINKS)


VALUES = ("motor_inertia_kg_m2", "viscous_friction_Nms_per_rad", "coulomb_friction_Nm")
DRIVES: dict[str, Any] = {
    joint: {"type": "stiff", ratio: value, **dict(zip(VALUES, values, strict=True))}
    for joint, ratio, value, *values in (
        ("shoulder", "gear_ratio", 50.0, 2e-5, 2e-4, 0.01),
        ("turn", "gear_ratio", 30.0, 1e-5, 1e-4, 0.004),
        ("squeeze", "gear_ratio_rad_per_m", 400.0, 5e-6, 5e-5, 0.003),
    )
}
DRIVES["shoulder"] |= {"type": "series_elastic", "stiffness_Nm_per_rad": 300.0}


@pytest.fixture
def gripper(write_urdf: Write) -> Robot:
    return seaid.load_robot(write_urdf(gripper_text()), DRIVES)


def test_leaders_are_the_joints_and_followers_have_bodies_only(gripper: Robot) -> None:
    """The limits of a leader keep those of its followers."""
    assert gripper.joint_names == LEADERS
    followers = {
        one.name: (one.leader, one.multiplier, one.offset) for one in gripper.dependent_joints
    }
    assert followers == {
        "level": ("shoulder", -1.0, 0.2),
        "mirror": ("squeeze", 1.0, 0.01),
        "cam_turn": ("squeeze", -12.0, pytest.approx(0.18)),
    }
    assert gripper.body_names[:3] == ("upper", "wrist", "left")
    assert set(gripper.body_names[3:]) == {"table", "right", "cam"}
    assert gripper.parameters.shape == (60,)
    assert list(gripper.drives) == list(LEADERS)
    # -2 <= -12 q + 0.18 <= 2 and 12 |v| <= 3 for the cam; -2 <= 0.2 - q <= 2 for the level
    np.testing.assert_allclose(gripper.lower_limits, [-1.8, -2, -1.82 / 12])
    np.testing.assert_allclose(gripper.upper_limits, [2.0, 2, 2.18 / 12])
    np.testing.assert_allclose(gripper.velocity_limits, [3, 3, 0.25])


MIMICS = [path for path in example_urdfs() if b"<mimic" in path.read_bytes()]


@pytest.mark.parametrize("path", MIMICS, ids=lambda path: path.stem)
def test_torques_are_those_of_pinocchios_own_mimic_joints(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)
        robot = seaid.load_robot(path, snap_tolerance_rad=0)
    try:
        theirs = pin.buildModelFromUrdf(str(path), mimic=True)
    except (ValueError, RuntimeError) as problem:
        pytest.skip(f"pinocchio refuses it: {problem}"[:80])
    if theirs.nv != robot.n or theirs.nq != robot.n:
        pytest.skip("with continuous joints, or mimics of joints that are not there")
    data, names = theirs.createData(), list(theirs.names)
    order = [theirs.joints[names.index(joint)].idx_v for joint in robot.joint_names]
    ours, expected = [], []
    for q, v, a in zip(*states(robot.n), strict=True):
        full = np.empty((3, robot.n))
        full[:, order] = q, v, a
        expected.append(pin.rnea(theirs, data, *full)[order])
        ours.append(joint_torques(robot, q[None], v[None], a[None])[0])
    np.testing.assert_allclose(ours, expected, atol=1e-9 * np.max(np.abs(expected)))


def test_regressor_and_slopes_are_those_of_the_torques(gripper: Robot) -> None:
    q, v, a = states(3)
    torque = joint_torques(gripper, q, v, a)
    Y = rigid_body_regressor(gripper, q, v, a)
    np.testing.assert_allclose(Y @ gripper.parameters, torque, atol=1e-11)
    by_steps = torque_slopes_by_steps(gripper, (q, v, a), 1e-6)
    np.testing.assert_allclose(torque_slopes(gripper, q, v, a), by_steps, atol=2e-6)


def test_mujoco_has_the_same_inertia_and_torques(gripper: Robot, tmp_path: Path) -> None:
    """Its equality constraints are read again as mimic joints."""
    mujoco: Any = pytest.importorskip("mujoco")
    stiff = {joint: table for joint, table in DRIVES.items() if joint != "shoulder"}
    assert gripper.urdf is not None
    robot = seaid.load_robot(gripper.urdf, stiff)
    seaid.write_mjcf(robot, tmp_path / "gripper.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "gripper.xml"))
    data, n = mujoco.MjData(model), robot.n
    place = [model.joint(name).dofadr[0] for name in robot.all_joint_names]
    q, v, a = (state[0] for state in states(n))
    columns = robot.expand(q), robot.expand(v, 1), robot.expand(a, 1)
    data.qpos[place], data.qvel[place], data.qacc[place] = columns
    mujoco.mj_inverse(model, data)
    moving = data.qfrc_inverse + data.qfrc_passive + data.qfrc_constraint  # without friction
    expected = robot.expand(np.eye(n), 1) @ moving[place]
    plant, order, rest = plant_of(robot), robot.joint_order, np.zeros(n)
    of_plant = plant.model.createData()
    bias = inverse_dynamics(plant, of_plant, (q[order], v[order], rest))
    torque = inertia(plant, of_plant, q[order]) @ a[order] + bias
    np.testing.assert_allclose(torque, expected[order], rtol=1e-9, atol=1e-12)
    by_robot = joint_torques(robot, q[None], v[None], rest[None])[0]
    np.testing.assert_allclose(by_robot[order], bias, rtol=1e-9, atol=1e-12)
    again = seaid.load_robot(tmp_path / "gripper.xml")  # the equality is read as mimic
    assert again.joint_names == robot.joint_names
    np.testing.assert_allclose(
        joint_torques(again, *states(n)), joint_torques(robot, *states(n)), atol=1e-9
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"joints": ["shoulder", "level"]}, "mimics 'shoulder', whose drive moves both: name"),
        ({"joints": ["turn"]}, "joint 'level' mimics 'shoulder', which does not move it here, and"),
        ({"drives": {"mirror": DRIVES["squeeze"]}}, "whose drive moves both: name 'squeeze' on"),
    ],
)
def test_what_a_follower_cannot_be_is_said(
    write_urdf: Write, options: dict[str, Any], words: str
) -> None:
    """Each refusal names the option that makes followers independent."""
    with pytest.raises(RobotError, match=words) as caught:
        seaid.load_robot(write_urdf(gripper_text()), **options)
    assert "independent_mimics=True" in str(caught.value)


def test_mimics_in_a_circle_are_refused_and_lost_ones_named(write_urdf: Write) -> None:
    text = gripper_text()
    circle = text.replace('joint="squeeze"', 'joint="cam_turn"')
    with pytest.raises(RobotError, match="mimic joints follow each other: mirror, cam_turn"):
        seaid.load_robot(write_urdf(circle))
    lost = write_urdf(text.replace('joint="squeeze"', 'joint="sqeeze"'))
    with pytest.warns(SeaidWarning, match=r"<mimic> of mirror names joints that are not there"):
        robot = seaid.load_robot(lost)
    assert "mirror" in robot.joint_names
    wrong = write_urdf(text.replace('multiplier="-12"', 'multiplier="fast"'))
    with pytest.raises(RobotError, match="multiplier of <mimic> must be 1 finite number"):
        seaid.load_robot(wrong)


def test_inspect_shows_what_follows(gripper: Robot) -> None:
    """Through another follower, with the product of both."""
    shown = CliRunner().invoke(app, ["inspect", str(gripper.urdf)])
    assert shown.exit_code == 0, shown.output
    assert "cam_turn: mimics squeeze, times -12 plus 0.18" in shown.output


def test_symbolic_equations_name_the_ways_out(gripper: Robot) -> None:
    with pytest.raises(RobotError, match=r"has mimic joints \(.*\), which symbolic equations"):
        seaid.symbolic.rigid_body(gripper)


def check_same_base(robot: Robot) -> None:
    exact, numeric = seaid.symbolic.base_parameters(robot), seaid.base_parameters(robot)
    assert exact.columns == numeric.columns
    np.testing.assert_allclose(exact.grouping, numeric.grouping, atol=1e-9)


@pytest.mark.parametrize("multiplier", [-1, 2, 0.5, -1.5, 0.37, 1.13446, -12])
@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_any_multiplier_and_offset_has_exact_base_parameters(
    write_urdf: Write, multiplier: float, offset: float
) -> None:
    """A parallelogram and a finger in series: between them a joint that moves by itself."""
    text = gripper_text().replace(
        '<mimic joint="shoulder" multiplier="-1" offset="0.2"/>',
        f'<mimic joint="shoulder" multiplier="{multiplier}" offset="{offset}"/>',
    )
    text = text.replace(
        'joint="mirror" multiplier="-12"', f'joint="turn" multiplier="{multiplier}"'
    )
    robot = seaid.load_robot(write_urdf(text))
    check_same_base(robot)
    found = seaid.identifiability(robot, ["joint_position", "motor_torque"])
    assert found.agree
    assert found.body_count == len(seaid.base_parameters(robot).columns)


def test_followers_behind_joints_of_each_other_have_exact_base_parameters(
    write_chain: Callable[..., Path],
) -> None:
    axes, leaders = ("0 1 0", "0.6 0 0.8", "0 1 0", "1 0 0", "0 0 1"), {"c": "a", "d": "b"}
    joints = {x: f'continuous <axis xyz="{axis}"/>' for x, axis in zip("abcde", axes, strict=True)}
    for follower, leader in leaders.items():
        joints[follower] += f'<mimic joint="{leader}" multiplier="-2"/>'
    check_same_base(seaid.load_robot(write_chain(joints)))


# Joints that stand still elsewhere than at zero: the robot is that of the whole model there

LOCKED = {"lift": 0.4, "elbow": -0.9}
MOVING = ("shoulder", "wrist")


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    """A lift, a shoulder, an elbow with a finger that follows it, and a wrist."""
    joints = {
        "lift": 'prismatic base column <axis xyz="0 0 1"/>',
        "shoulder": 'revolute column upper <axis xyz="0 1 0"/>',
        "elbow": 'revolute upper lower <axis xyz="1 0 0"/>',
        "follower": 'revolute lower flap <axis xyz="0 1 0"/>'
        '<mimic joint="elbow" multiplier="0.5" offset="0.1"/>',
        "wrist": 'continuous lower hand <axis xyz="0 0.6 0.8"/>',
    }
    place = '<origin xyz="0.1 0 0.3" rpy="0 0.2 0"/>'
    limit = '<limit lower="-2" upper="2" effort="50" velocity="5"/>'
    whole = {name: text + place + limit for name, text in joints.items()}
    body = f'{BODY}<collision><geometry><sphere radius="0.02"/></geometry></collision>'
    links = ("base", "column", "upper", "lower", "flap", "hand")
    return write_robot(tmp_path / "crane.urdf", whole, dict.fromkeys(links, body))


def test_links_stand_where_those_of_the_whole_model_do(gripper: Robot, urdf: Path) -> None:
    """Links of followers, and links behind joints that stand still elsewhere than at zero."""
    crane = seaid.load_robot(urdf, locked=LOCKED)
    followers = {"level": 0.2 - 0.7, "mirror": 0.06, "cam_turn": 0.3 - 12 * 0.06}
    for robot, q, others in (
        (gripper, [0.7, 0.2, 0.05], followers),
        (crane, [0.3, -0.4], {**LOCKED, "follower": 0.5 * LOCKED["elbow"] + 0.1}),
    ):
        assert robot.urdf is not None
        found = link_placements(robot, np.array(q))
        positions = dict(zip(robot.joint_names, q, strict=True)) | others
        for link, expected in frames_by_pinocchio(robot.urdf, positions).items():
            if link != "universe":
                np.testing.assert_allclose(
                    found[link].homogeneous, expected.homogeneous, atol=1e-12
                )


def test_the_written_file_has_the_same_robot(urdf: Path, tmp_path: Path) -> None:
    robot = seaid.load_robot(urdf, locked=LOCKED)
    changed = robot.with_values(1.1 * robot.parameters, robot.drives)
    written = seaid.write_urdf(changed, tmp_path / "heavy.urdf").urdf
    again = seaid.load_robot(written, locked=LOCKED)
    base = seaid.regressor.base_parameters(robot)
    np.testing.assert_allclose(
        base.project(again.parameters), base.project(changed.parameters), rtol=1e-9, atol=1e-12
    )


def test_shapes_of_locked_links_are_where_they_stand(urdf: Path) -> None:
    """The scene checks its placements against the robot."""
    geometry, links = collision_geometry(urdf, seaid.load_robot(urdf, locked=LOCKED), ())
    assert len(geometry.geometryObjects) == len(links) == 6


@pytest.mark.parametrize(
    ("locked", "message"),
    [
        ({"torso": 0.1}, "locked=: 'crane': no joint is named 'torso'"),
        ({"follower": 0.1}, "joint 'follower' is moved by 'elbow'; name revolute, continuous or"),
        ({"lift": float("nan")}, "locked=: position of 'lift'"),
        ({"shoulder": 0.1}, "joint 'shoulder' is fixed, or locked by locked=; seaid moves"),
    ],
)
def test_what_cannot_be_locked(urdf: Path, locked: dict[str, float], message: str) -> None:
    with pytest.raises(RobotError, match=message):
        seaid.load_robot(urdf, joints=["shoulder", "wrist"], locked=locked)


def test_a_project_has_the_joints_that_are_locked(urdf: Path, tmp_path: Path) -> None:
    """With that option the project and a saved run have the robot whose other joints move."""
    time = np.arange(2000) / 200
    columns = {"time_s": time}
    for number, name in enumerate(("lift", "shoulder", "elbow", "wrist")):
        still = 0.4 + 1e-5 * np.sin(70 * time)
        columns[f"{name}.position"] = np.sin((1 + number) * time) if name in MOVING else still
        columns[f"{name}.effort"] = np.cos((1 + number) * time)
    run = write_columns(tmp_path / "run.npz", columns)
    locked = {"lift": 0.4, "elbow": 0.4}
    made = write_first_project(urdf, [run], locked=locked, folder=tmp_path / "q")
    assert "locked = { lift = 0.4, elbow = 0.4 }" in made.files[0].read_text()
    robot, arrays = load_project(tmp_path / "q").robot(), dict[str, Array]()
    assert robot.joint_names == MOVING
    assert dict(_restored(_plain(robot, arrays), arrays).locked) == dict(robot.locked) == locked
    said = CliRunner().invoke(app, ["inspect", str(urdf), "--locked", "0.3"])
    assert "'0.3' names no joint: write it as torso=0.3,head=0.1" in said.stderr
    assert not any("elbow" in doubt for doubt in made.doubts)
    write_columns(run, columns | {"lift.position": np.full_like(time, 0.4)})
    with pytest.raises(LogError, match="joints that stand still, or that no column has, are lock"):
        write_first_project(urdf, [run], folder=tmp_path / "r")


def test_what_belongs_to_a_locked_joint_is_ignored(urdf: Path, tmp_path: Path) -> None:
    """Its drive, its known body, and its columns, named by a description or one by one."""
    joints = ("lift", "shoulder", "elbow", "wrist")
    drives = {joint: {"type": "stiff", "gear_ratio": 10.0} for joint in joints[1:]}
    robot = seaid.load_robot(urdf, drives, locked=LOCKED, known_bodies=["lower", "hand"])
    assert robot.known_bodies == ("hand",)
    assert robot.standing_joints == ("lift", "elbow")
    assert robot.selected(joints) == MOVING
    t = np.arange(0, 3, 0.01)
    table, described = {"t": t}, {}
    for place, joint in enumerate(joints):
        table |= {f"{joint}_pos": np.sin(t + place), f"{joint}_torque": np.cos(t + place)}
        described[joint] = {"joint_position": f"{joint}_pos", "motor_torque": f"{joint}_torque"}
    path = write_columns(tmp_path / "run.csv", table, "%.18e")
    log = seaid.read_log(path, robot, description={"time": "t", "joints": described})
    np.testing.assert_allclose(log.joint_position[:, 1], table["wrist_pos"])
    assert {*seaid.describe_log(path, robot).description.joints} == {*MOVING}
