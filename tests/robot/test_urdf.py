"""Reading a URDF: what is wrong is named, what is rounded is snapped."""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from seaid.errors import RobotError, SeaidWarning
from seaid.legged import load_robot
from seaid.robot import reread_urdf
from seaid.robot.robot_file import read_urdf
from tests.one_joint import BODY

Write = Callable[[str], Path]
Chain = Callable[..., Path]

ELBOW = '<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/></joint>'
ARM = f'<link name="base"/><link name="arm">{BODY}</link>{ELBOW}'


def load_error(path: Path) -> str:
    with pytest.raises(RobotError) as caught:
        load_robot(path)
    return str(caught.value)


@pytest.mark.parametrize("content", [b"", b"<robot", b"\x00\xff\x01", b"name: robot", b"<robot>"])
def test_broken_xml_is_said_with_file_and_place(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.urdf"
    path.write_bytes(content)
    text = load_error(path)
    assert text.startswith(f"URDF '{path}' is not well-formed XML: ")
    assert "line 1" in text or not content


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f'<r:robot xmlns:r="urn:a" name="a">{ARM}</r:robot>', "its root tag is <r:robot>, not"),
        (f'<?xml version="3.7"?><robot name="a">{ARM}</robot>', "write version 1.0"),
        (f'<sdf version="1.9" xmlns="urn:a"><robot>{ARM}</robot></sdf>', "is SDF"),
        (f"<scene><robot>{ARM}</robot></scene>", "its root tag is <scene>, not <robot>"),
        ("<!-- <robot> --><mujoco><worldbody/></mujoco>", "has no joint that moves"),
    ],
)
def test_the_root_alone_says_what_a_file_is(tmp_path: Path, text: str, words: str) -> None:
    if "mujoco" in text:
        pytest.importorskip("mujoco")
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    assert words in load_error(path)


TURNING = ARM.replace("revolute", "continuous")
MUJOCO = '<mujoco><compiler meshdir="none" fusestatic="true"/></mujoco>'
READ_AS_THEY_STAND = {
    "mujoco first": f'<robot name="a">{MUJOCO}{TURNING}</robot>',
    "mujoco last": f'<robot name="a">{TURNING}{MUJOCO}</robot>',
    "sdf inside": f'<robot name="a"><gazebo><sdf version="1.9"/></gazebo>{TURNING}</robot>',
    "long comment": f'<!--{"x" * 5000}<mujoco>--><robot name="a">{TURNING}</robot>',
    "ROS": f'<robot xmlns="http://www.ros.org" name="a">{TURNING}</robot>',
    "Drake": f"""<robot name="a"
 xmlns = 'http://drake.mit.edu' xmlns:x="urn:x" x:schemaLocation="a b">{TURNING}</robot>""",
    "xacro": '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a">'
    f"<!-- <xacro:include/> -->{TURNING}</robot>",
    "link": '<robot name="a">' + TURNING.replace("<link", '<link xmlns="urn:a"') + "</robot>",
    "version": f'<?xml version="0.0" ?>\n<robot name="a">{TURNING}</robot>',
    "both": f"""\ufeff<?xml version='0.0' encoding='utf-8'?>
<robot xmlns="" name="a">{TURNING}</robot>""",
}


@pytest.mark.parametrize("kind", READ_AS_THEY_STAND)
def test_blocks_of_mujoco_default_namespaces_and_version_0_are_read(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Pinocchio and MuJoCo read them; neither MuJoCo nor xacro is asked."""
    for module in ("mujoco", "xacro"):
        monkeypatch.setitem(sys.modules, module, None)
    path = tmp_path / "arm.xml"
    path.write_text(READ_AS_THEY_STAND[kind], encoding="utf-8")
    robot = load_robot(path)
    assert (robot.name, robot.joint_names, robot.body_names) == ("a", ("elbow",), ("arm",))
    assert robot.parameters[0] == pin.buildModelFromUrdf(str(path)).inertias[1].mass
    assert len(reread_urdf(path).elements.links) == 2


def test_negative_moments_of_inertia_are_named(tmp_path: Path) -> None:
    """Negative masses are refused; these are not, since a forced export may have them."""
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="a">{ARM}</robot>'.replace('iyy="1"', 'iyy="-1"'))
    with pytest.warns(SeaidWarning, match="negative moments of inertia of arm: correct ixx"):
        assert load_robot(path).n == 1


# One table of refused robots: trees that are none, numbers that are none, elements twice


def changed(good: str, bad: str) -> str:
    """Return the arm with the first occurrence of a text replaced."""
    assert good in ARM
    return ARM.replace(good, bad, 1)


def with_element(element: str) -> str:
    """Return the arm with a further element of its joint."""
    return changed("</joint>", f"{element}</joint>")


CAMERA = '<joint name="b" type="fixed"><parent link="arm"/><child link="base"/></joint>'
ROUND = """<link name="x"/><link name="y"/>
<joint name="there" type="fixed"><parent link="x"/><child link="y"/></joint>
<joint name="back" type="fixed"><parent link="y"/><child link="x"/></joint>"""
SECOND = ELBOW.replace("base", "x").replace("elbow", "second")
ONCE = {
    "axis": '<axis xyz="1 0 0"/>',
    "origin": "<origin/>",
    "limit": "<limit/>",
    "mimic": '<mimic joint="elbow"/>',
    "dynamics": "<dynamics/>",
}
MASS, THREE = 'mass value="1"', "must be 3 finite numbers, found"
ONE = "value of <mass> must be 1 finite number"
REFUSED = [
    (f'{ARM}<link name="arm"/>', "link name used twice: arm"),
    (f'{ARM}<link name="x"/>{ELBOW.replace("arm", "x")}', "joint name used twice: elbow"),
    (f"{ARM}<link/>", "a <link> has no name"),
    (changed(' name="elbow"', ""), "a <joint> has no name"),
    (changed("<parent", "<xparent"), """joint 'elbow' has no <parent link="...">"""),
    (changed('<child link="arm"/>', "<child/>"), "joint 'elbow' has no <child link="),
    (
        changed('parent link="base"', 'parent link="bse"'),
        "no link is named 'bse'; did you mean 'base'",
    ),
    (f'{ARM}<link name="x"/>', "not one tree: links without parent: ['base', 'x']; join all b"),
    (f"{ARM}{CAMERA}", "is not a tree: loop through links base, arm: remove a joint of it"),
    (f'{ARM}<link name="x"/>{SECOND}', "link 'arm' has two parent joints, and a URDF is a tr"),
    (f"{ARM}{ROUND}", "is not a tree: loop through links x, y: remove a joint of it"),
    ("", "has no links"),
    (changed("revolute", "revolut"), "named 'revolut'; did you mean 'revolute'?"),
    (changed(' type="revolute"', ""), "joint 'elbow': no joint type is named ''; allowed:"),
    (with_element('<origin xyz="0 1"/>'), f"'elbow': xyz of <origin> {THREE} '0 1'"),
    (with_element('<origin rpy="0 nan 1"/>'), f"'elbow': rpy of <origin> {THREE} '0 nan 1'"),
    (with_element('<axis xyz="a b c"/>'), f"'elbow': xyz of <axis> {THREE} 'a b c'"),
    (with_element('<axis xyz="0 inf 0"/>'), f"xyz of <axis> {THREE} '0 inf 0'"),
    (with_element('<axis xyz="0 0 0"/>'), "joint 'elbow' has no axis, found [0.0, 0.0, 0.0]"),
    (with_element('<axis xyz="0 ١ 0"/>'), f"xyz of <axis> {THREE} '0 ١ 0'"),  # as other readers
    (with_element('<axis xyz="0\u00a01 0"/>'), "xyz of <axis> must be 3 finite numbers"),
    (with_element('<limit lower="-1_0"/>'), "lower of <limit> must be 1 finite number, found '-"),
    (with_element('<limit lower="1" upper="-1"/>'), "limit 1.0 is above its upper limit -1"),
    (with_element('<limit velocity="-2" effort="1"/>'), "its velocity limit is negative, -2"),
    (with_element('<limit velocity="2" effort="-1"/>'), "its effort limit is negative, -1"),
    (changed(MASS, 'mass value="-1"'), "link 'arm' has a negative mass, -1.0 kg"),
    (changed(MASS, 'mass value="inf"'), f"{ONE}, found 'inf'"),
    (changed(MASS, "mass"), "link 'arm': <mass> has no value"),
    (changed(MASS, 'mass value="0"'), "has inertia but zero mass; give it"),
    (changed(f"<{MASS}/>", ""), "link 'arm' (moved by 'elbow') has inertia but zero mass"),
    (changed('ixx="1"', 'ixx="${i}"'), "ixx of <inertia> must be 1 finite number, found '${i}'"),
    (changed('iyy="1" ', ""), "link 'arm': <inertia> has no iyy"),
    (changed("<mass", '<origin xyz="0 1e200 0"/><mass'), "link 'arm': xyz of <origin> is out of r"),
    (changed("<parent", '<origin xyz="-2e4 0 0"/><parent'), "'-2e4 0 0': allowed are -1000"),
    (changed("<parent", '<origin rpy="1e5 0 0"/><parent'), "allowed are -10000 to 10000 rad"),
    (changed(MASS, 'mass value="1e10"'), "found '1e10': allowed are -1e+09 to 1e+09 kg"),
    (changed(MASS, 'mass value="1e-320"'), "has inertia but zero mass; give it"),
    (changed(MASS, f'mass value="{"1" * 400}"'), f"found '{'1' * 78} …'"),
    (changed('ixx="1"', 'ixx="1e16"'), "found '1e16': allowed are -1e+15 to 1e+15 kg m^2"),
    (changed(BODY, BODY * 2), "link 'arm' has 2 elements <inertial>: keep one of"),
    (changed("<mass", '<mass value="2"/><mass'), "2 elements <mass>: keep one"),
    (changed("<mass", "<origin/><origin/><mass"), "2 elements <origin>: keep one"),
    (changed("<child", '<parent link="arm"/><child'), "'elbow' has 2 elements <parent>"),
    (changed("<child", '<child link="base"/><child'), "elements <child>: keep one"),
    *((with_element(x * 3), f"joint 'elbow' has 3 elements <{tag}>") for tag, x in ONCE.items()),
]


@pytest.mark.parametrize(("inside", "words"), REFUSED)
def test_what_is_no_robot_is_refused(write_urdf: Write, inside: str, words: str) -> None:
    path = write_urdf(inside)
    text = load_error(path)
    assert text.startswith(f"URDF '{path}'")
    assert words in text


def test_axis_is_x_where_none_is_given_and_of_unit_length_always(write_chain: Chain) -> None:
    axes = ("0 3 4", "1e308 1e308 0", "1e-320 1e-320 0", "1e-200 1e-200 0")
    others = {f"b{axis[:4]}": f'revolute <axis xyz="{axis}"/>' for axis in axes}
    joints = read_urdf(write_chain({"a": "revolute", **others}), 0.0).joints
    assert joints["a"].axis.tolist() == [1.0, 0.0, 0.0]
    expected = ([0.0, 0.6, 0.8], *[[math.sqrt(0.5), math.sqrt(0.5), 0.0]] * 3)
    for joint, axis in zip(others, expected, strict=True):
        np.testing.assert_allclose(joints[joint].axis, axis, rtol=1e-12)


def test_rounded_axes_are_coordinate_axes_with_a_warning(write_chain: Chain) -> None:
    rounded = {"a": "0 0.00005 1", "b": "-2 0.0001 0", "c": "0 1 0.0002", "d": "0 1 1e-9"}
    path = write_chain({name: f'revolute <axis xyz="{xyz}"/>' for name, xyz in rounded.items()})
    with pytest.warns(SeaidWarning, match=r"2 rounded axes .* \(0 0.00005 1, -2 0.0001 0\); snap_"):
        joints = read_urdf(path, 2e-3).joints
    assert joints["a"].axis.tolist() == [0.0, 0.0, 1.0]
    assert joints["b"].axis.tolist() == [-1.0, 0.0, 0.0]
    assert joints["c"].axis[2] == pytest.approx(2e-4, rel=1e-6)
    assert joints["d"].axis.tolist() == [0.0, 1.0, 0.0]
    assert read_urdf(path, 0.0).joints["a"].axis[1] == pytest.approx(5e-5, rel=1e-6)


def test_too_large_a_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "big.urdf"
    path.write_text("<robot>" + "<joint/>" * 10_000 + "</robot>")
    assert load_error(path) == f"URDF '{path}' has more than the 5,000 joints that are allowed"
    path.write_text("<robot>" + "<link/>" * 10_000 + "</robot>")
    assert load_error(path) == f"URDF '{path}' has more than the 5,001 links that are allowed"
    with path.open("wb") as file:
        file.truncate(10**12)  # a hole on the disk
    words = f"URDF '{path}' is too large: 1,000,000,000,000 bytes, allowed are 16,000,000"
    assert load_error(path) == words


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "iso-8859-1"])
def test_encodings_are_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.urdf"
    head = "" if encoding == "utf-8-sig" else f'<?xml version="1.0" encoding="{encoding}"?>'
    path.write_bytes(f"{head}<robot>{ARM.replace('elbow', 'é')}</robot>".encode(encoding))
    assert load_robot(path).joint_names == ("é",)


@pytest.mark.parametrize("name", ["leg_a.urdf", "\udcff.urdf", "a\nb\x01.urdf"])
def test_robot_without_name_is_named_after_its_file(tmp_path: Path, name: str) -> None:
    """Letters that no terminal shows are left out."""
    path = tmp_path / name
    path.write_text(f"<robot>{ARM}</robot>")
    robot = load_robot(path)
    assert robot.name.isprintable()
    assert robot.name == "leg_a" or not path.stem.isprintable()


SNAPPED = {
    "1.5708": 1,
    "3.14159": 2,
    "1.57": 1,
    "-1.5707963259": -1,
    "-3.1416": -2,
    "4.71239": 3,
    "1e-7": 0,
}
KEPT = ("0.0050", "5.4949E-05", "1.5703", "0", "0.7854", "1.5", "3.1", "-1.5688", "1e-5")


@pytest.mark.parametrize(("text", "quarters"), SNAPPED.items())
def test_rounded_angle_is_snapped_to_the_quarter_turn_it_means(
    write_chain: Chain, text: str, quarters: int
) -> None:
    path = write_chain({"elbow": f'revolute <origin rpy="{text} 0 0"/>'})
    words = rf"'test\.urdf': 1 rounded angles .*\({text}\); snap_tolerance_rad=0 leaves"
    with pytest.warns(SeaidWarning, match=words):
        rotation = read_urdf(path, 2e-3).joints["elbow"].placement.rotation
    cos, sin = round(math.cos(quarters * math.pi / 2)), round(math.sin(quarters * math.pi / 2))
    assert rotation.tolist() == [[1, 0, 0], [0, cos, -sin], [0, sin, cos]]


@pytest.mark.parametrize("text", [*KEPT, str(math.pi / 2), str(-math.pi), "1.5707963267948966"])
def test_angle_that_means_itself_is_kept(write_chain: Chain, text: str) -> None:
    """One in full precision is a quarter turn without a warning."""
    path = write_chain({"elbow": f'revolute <origin rpy="{text} 0 0"/>'})
    rotation = read_urdf(path, 2e-3).joints["elbow"].placement.rotation
    angle = math.atan2(rotation[2, 1], rotation[2, 2])
    assert math.sin(angle) == pytest.approx(math.sin(float(text)), abs=1e-15)
    if text not in KEPT:
        assert set(np.abs(rotation).ravel()) == {0.0, 1.0}


def test_one_warning_lists_all_and_points_to_the_caller(write_chain: Chain) -> None:
    path = write_chain(
        {
            "a": 'revolute <origin rpy="1.5708 0 -1.57"/>',
            "b": 'fixed <origin rpy="0 3.14159 1.5703"/>',
            "c": 'revolute <origin rpy="1.5708 0.0050 5.4949E-05"/>',
        }
    )
    words = r"4 rounded angles .*\(1\.5708, -1\.57, 3\.14159\)"
    with pytest.warns(SeaidWarning, match=words) as caught:
        load_robot(path)
    assert [warning.filename for warning in caught] == [__file__]


def test_a_smaller_tolerance_snaps_less(write_chain: Chain) -> None:
    path = write_chain({"elbow": 'revolute <origin rpy="1.57 0 1.5708"/>'})
    with pytest.warns(SeaidWarning, match=r"1 rounded angles .*\(1\.5708\)"):
        read_urdf(path, 1e-5)


@pytest.mark.parametrize("tolerance", [-1e-3, math.nan, 1.0, math.inf])
def test_tolerance_that_is_none_is_refused(write_urdf: Write, tolerance: float) -> None:
    with pytest.raises(RobotError, match="snap_tolerance_rad must be between 0 and pi/4, found"):
        load_robot(write_urdf(ARM), snap_tolerance_rad=tolerance)
