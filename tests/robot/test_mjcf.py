"""A MuJoCo model is read as the robot that MuJoCo makes of it."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from seaid.drives import StiffDrive
from seaid.errors import RobotError, SeaidWarning
from seaid.legged import load_robot
from seaid.regressor import joint_torques
from seaid.robot import nominal_model

mujoco = pytest.importorskip("mujoco")

ARM = """<mujoco model="arm"><compiler angle="degree"/>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="base" pos="0 0 .5" euler="0 90 0"><geom size=".05" mass="1"/>
 <body name="upper" pos="0.1 0 0" quat="0.707107 0 0.707107 0">
  <joint name="yaw" axis="0 0 1" range="-90 90" pos="0 .02 0"/>
  <joint name="pitch" axis="0 1 0" pos="0.01 0 0.03"/>
  <inertial pos=".1 .02 0" mass="2" diaginertia=".01 .02 .015"/>
  <body name="fore" pos=".3 0 .02" euler="10 20 30">
   <joint name="slide" type="slide" axis="1 0 1" range="0 .2" ref="0.05"/>
   <geom type="capsule" size=".02 .1" mass=".7"/>
   <body pos=".1 0 0"><joint name="left" axis="0 1 0" ref="20"/>
    <geom type="box" size=".02 .03 .04" mass=".2"/></body>
   <body name="tip" pos="-.1 0 0"><joint axis="0 1 0"/>
    <geom type="box" size=".02 .03 .04" mass=".2"/></body>
  </body></body></body></worldbody>
<!-- more --></mujoco>"""


def write(path: Path, text: str = ARM) -> Path:
    path.write_text(text)
    return path


def test_torques_are_those_of_mujoco(tmp_path: Path) -> None:
    """Two joints on a body, joints off its origin, references, shapes for inertias, no names."""
    path = write(tmp_path / "arm.xml")
    robot = load_robot(path)
    assert robot.joint_names == ("yaw", "pitch", "slide", "joint_4", "left")
    assert robot.body_names == ("upper_yaw", "upper", "fore", "tip", "body_4")
    np.testing.assert_allclose(robot.upper_limits[[0, 2]], [np.pi / 2, 0.2])
    model = mujoco.MjModel.from_xml_path(str(path))
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_CONTACT | off.mjDSBL_LIMIT)
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    order = [0, 1, 2, 4, 3]
    for q, v, a in rng.normal(size=(5, 3, robot.n)):
        data.qpos[order], data.qvel[order], data.qacc[order] = q, v, a
        mujoco.mj_inverse(model, data)
        ours = joint_torques(robot, q[None], v[None], a[None])[0]
        np.testing.assert_allclose(ours, data.qfrc_inverse[order], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("<!-- more -->", '<equality><connect body1="upper" body2="tip" anchor="0 0 0"/>'
          "</equality>"), "has a closed loop"),
        (("<!-- more -->", '<equality><joint joint1="left" joint2="pitch" polycoef="0 1 2 0 0"/>'
          "</equality>"), "joint 'left' follows 'pitch' by a polynomial of higher degree than 1"),
        (('type="slide"', 'type="glide"'), "MuJoCo cannot compile '"),
    ],
)  # fmt: skip
def test_what_is_no_tree_is_refused(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    path = write(tmp_path / "arm.xml", ARM.replace(*change))
    with pytest.raises(RobotError, match=words) as caught:
        load_robot(path)
    assert f"'{path}'" in str(caught.value)


def test_a_joint_that_follows_another_is_a_mimic_from_both_references(tmp_path: Path) -> None:
    """MuJoCo: left - 20 deg = 0.1 + 2 (slide - 0.05 m)."""
    follows = '<equality><joint joint1="left" joint2="slide" polycoef="0.1 2 0 0 0"/></equality>'
    robot = load_robot(write(tmp_path / "arm.xml", ARM.replace("<!-- more -->", follows)))
    ((name, leader, multiplier, offset),) = (
        (x.name, x.leader, x.multiplier, x.offset) for x in robot.dependent_joints
    )
    assert (name, leader, multiplier) == ("left", "slide", 2.0)
    assert offset == pytest.approx(np.deg2rad(20))


def test_other_gravity_is_named_and_a_free_base_is_locked(tmp_path: Path) -> None:
    """A warning gives the gravity; the joints that are asked for leave the free joint out."""
    moon = ARM.replace("<worldbody>", '<option gravity="0 0 -1.6"/><worldbody>', 1)
    with pytest.warns(SeaidWarning, match=r"gravity is \(0, 0, -1.6\) m/s\^2, which gravity= must"):
        load_robot(write(tmp_path / "moon.xml", moon))
    shape = '<geom size=".05" mass="1"/>'
    path = write(tmp_path / "arm.xml", ARM.replace(shape, f'<freejoint name="base_free"/>{shape}'))
    with pytest.raises(RobotError, match=r"'base_free' is floating; .* joints=\[...\]"):
        load_robot(path)
    assert load_robot(path, joints=["pitch"]).joint_names == ("pitch",)


def test_without_mujoco_the_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        RobotError, match=r"is a MuJoCo model, not a URDF: .*\(pip install mujoco\)"
    ):
        load_robot(write(tmp_path / "arm.xml"))


def test_the_root_of_a_nominal_model_says_whether_it_has_dynamics(tmp_path: Path) -> None:
    """Not the ending of its file, and it may be a name of a known robot."""
    body = '<inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/>'
    path = write(
        tmp_path / "arm.urdf",
        f'<mujoco><worldbody><body name="a"><joint name="j" damping="2"/>{body}</body></worldbody>'
        "</mujoco>",
    )
    robot = load_robot(path, {"j": StiffDrive()})
    assert nominal_model(path, robot).drives["j"].values["viscous_friction"] == 2.0
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    path = write(
        tmp_path / "arm.xml",
        f'<robot name="a"><mujoco/><link name="base"/><link name="a">{inertial}</link>'
        '<joint name="j" type="continuous"><parent link="base"/><child link="a"/>'
        '<dynamics damping="2"/></joint></robot>',
    )
    assert nominal_model(path, robot).drives == robot.drives
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)
        robot = load_robot("ur5")
        assert nominal_model(Path("ur5"), robot).urdf == robot.urdf
