"""Joints that stand still elsewhere than at zero: the robot is that of the whole model there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

import seaid
from seaid._arrays import Array
from seaid.cli.commands import app
from seaid.errors import LogError, RobotError
from seaid.excitation.collision import collision_geometry
from seaid.project import load_project, write_first_project
from seaid.project.saved import _plain, _restored
from seaid.view.picture import link_places
from tests.one_joint import BODY

LOCKED = {"lift": 0.4, "elbow": -0.9}
MOVING = ("shoulder", "wrist")


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    """A lift, a shoulder, an elbow with a finger that follows it, and a wrist."""
    kinds = {
        "lift": ("prismatic", "base", "column", "0 0 1"),
        "shoulder": ("revolute", "column", "upper", "0 1 0"),
        "elbow": ("revolute", "upper", "lower", "1 0 0"),
        "follower": ("revolute", "lower", "flap", "0 1 0"),
        "wrist": ("continuous", "lower", "hand", "0 0.6 0.8"),
    }
    links = "".join(
        f'<link name="{one}">{BODY}<collision><geometry><sphere radius="0.02"/></geometry>'
        "</collision></link>"
        for one in ("base", *(child for _, _, child, _ in kinds.values()))
    )
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0.3" rpy="0 0.2 0"/><axis xyz="{axis}"/>'
        + ('<mimic joint="elbow" multiplier="0.5" offset="0.1"/>' if name == "follower" else "")
        + '<limit lower="-2" upper="2" effort="50" velocity="5"/></joint>'
        for name, (kind, parent, child, axis) in kinds.items()
    )
    path = tmp_path / "crane.urdf"
    path.write_text(f'<robot name="crane">{links}{joints}</robot>')
    return path


def whole(urdf: Path) -> tuple[pin.Model, dict[str, float]]:
    """Return the model with all joints, and the positions of those that stand still."""
    model = pin.buildModelFromUrdf(str(urdf), False)
    return model, {**LOCKED, "follower": 0.5 * LOCKED["elbow"] + 0.1}


def configuration(model: pin.Model, positions: dict[str, float]) -> Array:
    q = pin.neutral(model)
    for name, at in positions.items():
        joint = model.joints[model.getJointId(name)]
        values = [at] if joint.nq == 1 else [np.cos(at), np.sin(at)]
        q[joint.idx_q : joint.idx_q + joint.nq] = values
    return np.asarray(q)


def test_torques_are_those_of_the_whole_model(urdf: Path) -> None:
    robot = seaid.load_robot(urdf, locked=LOCKED)
    assert set(robot.joint_names) == set(MOVING)
    model, still = whole(urdf)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, v, a = rng.uniform(-1, 1, (3, 2))
        places = still | dict(zip(robot.joint_names, q.tolist(), strict=True))
        rows = [model.joints[model.getJointId(name)].idx_v for name in robot.joint_names]
        speed, rate = np.zeros((2, model.nv))
        speed[rows], rate[rows] = v, a
        torque = pin.rnea(model, model.createData(), configuration(model, places), speed, rate)
        regressor = seaid.regressor.rigid_body_regressor(robot, q[None], v[None], a[None])
        own = regressor[0] @ robot.parameters
        np.testing.assert_allclose(own, torque[rows], atol=1e-12)


def test_links_stand_where_those_of_the_whole_model_do(urdf: Path) -> None:
    robot = seaid.load_robot(urdf, locked=LOCKED)
    model, still = whole(urdf)
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration(model, still))
    own = robot.model.createData()
    pin.forwardKinematics(robot.model, own, np.zeros(2))
    tree = seaid.robot.reread_urdf(urdf).locked_at(robot.locked)
    for link, (joint, place) in link_places(tree, robot).items():
        at = own.oMi[joint] * place
        there = data.oMf[model.getFrameId(link)]
        np.testing.assert_allclose(at.homogeneous, there.homogeneous, atol=1e-12)


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
    ],
)
def test_what_cannot_be_locked(urdf: Path, locked: dict[str, float], message: str) -> None:
    with pytest.raises(RobotError, match=message):
        seaid.load_robot(urdf, locked=locked)


def test_a_joint_is_locked_or_moves(urdf: Path) -> None:
    with pytest.raises(RobotError, match="joint 'lift' is locked; leave it out of joints="):
        seaid.load_robot(urdf, joints=["lift", "shoulder"], locked=LOCKED)


def test_the_command_line_wants_positions_by_joint(urdf: Path) -> None:
    said = CliRunner().invoke(app, ["inspect", str(urdf), "--locked", "0.3"])
    assert "'0.3' names no joint: write it as torso=0.3,head=0.1" in said.stderr
    assert CliRunner().invoke(app, ["inspect", str(urdf), "--locked", "lift=0.3"]).exit_code == 0


def test_a_project_and_a_saved_run_keep_what_is_locked(urdf: Path, tmp_path: Path) -> None:
    (tmp_path / "seaid.toml").write_text(
        'urdf = "crane.urdf"\nlocked = { lift = 0.4, elbow = -0.9 }\n[[log]]\nfile = "run.csv"\n'
    )
    robot = load_project(tmp_path).robot()
    assert dict(robot.locked) == LOCKED
    arrays = dict[str, Array]()
    assert dict(_restored(_plain(robot, arrays), arrays).locked) == LOCKED


def test_init_says_how_to_lock_what_stands_still(urdf: Path, tmp_path: Path) -> None:
    time = np.arange(2000) / 200
    columns = {"time_s": time}
    for number, name in enumerate(("lift", "shoulder", "elbow", "wrist")):
        moves = name in MOVING
        still = 0.4 + 1e-5 * np.sin(70 * time)
        columns[f"{name}.position"] = np.sin((1 + number) * time) if moves else still
        columns[f"{name}.effort"] = np.cos((1 + number) * time)
    np.savez(tmp_path / "run.npz", **columns)  # type: ignore[arg-type]
    made = write_first_project(urdf, [tmp_path / "run.npz"], folder=tmp_path / "p")
    said = "lift, elbow: no motion in any log; lock what stands still: --locked lift=0.4,elbow=0.4"
    assert said in made.doubts
    made = write_first_project(
        urdf, [tmp_path / "run.npz"], locked={"lift": 0.4, "elbow": 0.4}, folder=tmp_path / "q"
    )
    assert "locked = { lift = 0.4, elbow = 0.4 }" in made.files[0].read_text()
    assert load_project(tmp_path / "q").robot().joint_names == MOVING
    (tmp_path / "seaid.toml").unlink(missing_ok=True)
    columns["lift.position"] = np.full_like(time, 0.4)
    np.savez(tmp_path / "run.npz", **columns)  # type: ignore[arg-type]
    with pytest.raises(LogError, match="joints that stand still, or that no column has, are lock"):
        write_first_project(urdf, [tmp_path / "run.npz"], folder=tmp_path / "r")


def test_what_belongs_to_a_locked_joint_is_ignored(urdf: Path, tmp_path: Path) -> None:
    drive = {"type": "stiff", "gear_ratio": 10.0}
    joints = ("lift", "shoulder", "elbow", "wrist")
    drives = {joint: drive for joint in joints if joint != "lift"}
    robot = seaid.load_robot(urdf, drives, locked=LOCKED, known_bodies=["lower", "hand"])
    assert robot.known_bodies == ("hand",)
    assert robot.standing_joints == ("lift", "elbow")
    assert robot.selected(joints) == MOVING
    t = np.arange(0, 3, 0.01)
    table = {"t": t}
    for place, joint in enumerate(joints):
        table |= {f"{joint}_pos": np.sin(t + place), f"{joint}_torque": np.cos(t + place)}
    path = tmp_path / "run.csv"
    np.savetxt(path, np.column_stack([*table.values()]), delimiter=",", header=",".join(table))
    path.write_text(path.read_text().removeprefix("# "))
    described = {
        joint: {"joint_position": f"{joint}_pos", "motor_torque": f"{joint}_torque"}
        for joint in joints
    }
    log = seaid.read_log(path, robot, description={"time": "t", "joints": described})
    np.testing.assert_allclose(log.joint_position[:, 1], table["wrist_pos"])
    columns = {"time_s": "t"}
    for joint in joints:
        columns[f"{joint}.joint_position_rad"] = f"{joint}_pos"
        columns[f"{joint}.motor_torque_Nm"] = f"{joint}_torque"
    again = seaid.read_log(path, robot, columns=columns)
    np.testing.assert_array_equal(again.joint_position, log.joint_position)
    assert {*seaid.describe_log(path, robot).description.joints} == {*MOVING}
    made = write_first_project(urdf, [path], folder=tmp_path, locked=LOCKED)
    assert load_project(tmp_path).robot().joint_names == MOVING
    assert not any("elbow" in one for one in made.doubts)
