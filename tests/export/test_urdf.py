"""write_urdf: the same torques, every tag still there, impossible bodies refused."""

import re
import string
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from seaid.drives import StiffDrive
from seaid.errors import RobotError, SeaidError, SeaidWarning
from seaid.export import write_mjcf, write_urdf
from seaid.export.urdf import (
    Element,
    edited,
    is_empty,
    new_element,
    parse_positions,
    with_children,
    with_content,
    without,
)
from seaid.legged import load_robot
from seaid.robot import Payload, Robot
from seaid.robot.inertia import from_center_of_mass
from tests.experiments import MODELS

FIXED = """<?xml version="1.0"?>
<!-- a leg with a camera -->
<robot name="leg" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <link name="base"/>
  <joint name="hip" type="revolute">
    <parent link="base"/><child link="thigh"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="5" effort="20"/>
    <dynamics damping="1"/>
  </joint>
  <link name="thigh">
    <!-- weighed in March -->
    <inertial><mass value="3"/><origin xyz="0 0 -0.2" rpy="0.1 0 0"/>
      <inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://leg/thigh.stl"/></geometry></visual>
  </link>
  <joint name="mount" type="fixed">
    <origin xyz="0.1 0 -0.1" rpy="0 0.3 0"/><parent link="thigh"/><child link="camera"/>
  </joint>
  <link name="camera"><inertial><mass value="0.2"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <gazebo reference="thigh"><mu1>0.2</mu1></gazebo>
  <transmission name="t"><type>SimpleTransmission</type></transmission>
  <ros2_control name="c" type="system"><hardware/></ros2_control>
</robot>
"""


def loaded(folder: Path, text: str = FIXED, **options: Any) -> Robot:
    """Return the robot of a file leg.urdf that is written into a folder."""
    (folder / "leg.urdf").write_text(text)
    return load_robot(folder / "leg.urdf", **options)


def torques(robot: Robot, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    states = rng.uniform(-1, 1, (20, 3, robot.model.nv))
    data = robot.model.createData()
    return np.array([pin.rnea(robot.model, data, *state) for state in states])


def changed(robot: Robot, seed: int = 0) -> Robot:
    """Return the robot with other possible bodies: a little more of everything, and a lump more."""
    rng = np.random.default_rng(seed)
    bodies = robot.parameters.reshape(-1, 10).copy()
    for body in bodies:
        turned = np.diag(rng.uniform(1e-3, 2e-3, 3))
        body[:] = 1.1 * body + from_center_of_mass(0.1, rng.uniform(-0.1, 0.1, 3), turned)
    return robot.with_values(bodies.ravel(), robot.drives)


def outside_of_inertials(path: Path) -> bytes:
    """Return the bytes of a file without its <inertial>; a link with nothing else is one tag."""
    text = re.sub(rb"\s*<inertial\b.*?</inertial>", b"", path.read_bytes(), flags=re.DOTALL)
    return re.sub(rb"(<link\s[^>]*?)\s*>\s*</link>", rb"\1/>", re.sub(rb"\s+/>", b"/>", text))


def test_reloaded_torques_are_equal_and_all_else_in_the_file_is_as_it_was(
    example_urdf: Path, tmp_path: Path
) -> None:
    urdf = example_urdf
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = changed(load_robot(urdf))
        written = write_urdf(robot, tmp_path / urdf.name, force=True)  # two files have such bodies
        again = load_robot(written.urdf)
    expected = torques(robot)
    scale = np.max(np.abs(expected), axis=0) + 1e-12
    assert np.max(np.abs(torques(again) - expected) / scale) < 1e-9
    assert outside_of_inertials(written.urdf) == outside_of_inertials(urdf)


def fixed_robot(tmp_path: Path) -> Robot:
    friction = {"viscous_friction": 2e-3, "coulomb_friction": 0.05}
    drive = StiffDrive(gear_ratio=10.0, motor_inertia_kg_m2=1e-4).with_values(friction)
    return loaded(tmp_path, drives={"hip": drive})


def test_stiff_friction_stands_at_the_joint_and_all_drives_beside_the_file(tmp_path: Path) -> None:
    """Fixed children keep their inertia, and the moving link has the rest."""
    robot = changed(fixed_robot(tmp_path))
    written = write_urdf(robot, tmp_path / "out.urdf")
    assert not written.notes
    assert '<mass value="0.2"/>' in written.urdf.read_text()
    assert '<dynamics damping="0.2" friction="0.5"/>' in written.urdf.read_text()
    assert written.drives == tmp_path / "out.toml"
    again = load_robot(written.urdf, written.drives)
    assert again.drives == robot.drives
    np.testing.assert_allclose(again.parameters, robot.parameters, rtol=1e-12)


WHOLE = "link 'thigh' has the inertia of all links fixed to it (camera)"


def test_a_rest_that_no_urdf_can_hold_goes_to_the_moving_link_whole(tmp_path: Path) -> None:
    """A lump lighter than what is fixed, and a thigh with an inertia and no mass."""
    robot = fixed_robot(tmp_path)
    lump = from_center_of_mass(0.1, np.array([0, 0, -0.1]), 1e-4 * np.eye(3))
    light = robot.with_values(lump, robot.drives)
    text = FIXED.replace('<mass value="3"/>', "").replace('xyz="0 0 -0.2"', 'xyz="0 0 0"')
    for each in (light, loaded(tmp_path, text)):
        written = write_urdf(each, tmp_path / "out.urdf")
        assert WHOLE in written.notes[0]
        again = load_robot(written.urdf).parameters
        np.testing.assert_allclose(again, each.parameters, rtol=1e-9, atol=1e-15)


def test_impossible_bodies_are_refused_unless_forced(tmp_path: Path) -> None:
    robot = fixed_robot(tmp_path)
    parameters = robot.parameters.copy()
    parameters[4] = -1.0
    wrong = robot.with_values(parameters, robot.drives)
    words = r"'thigh' would be physically inconsistent .*feasible=True"
    for write, name in ((write_urdf, "out.urdf"), (write_mjcf, "out.xml")):
        with pytest.raises(RobotError, match=words):
            write(wrong, tmp_path / name)
        assert not (tmp_path / name).exists()
        notes = write(wrong, tmp_path / name, force=True).notes
        assert any("physically inconsistent" in note for note in notes)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml")).nv == 1
    with pytest.warns(SeaidWarning, match="negative moments of inertia of thigh"):
        again = load_robot(tmp_path / "out.urdf")
    np.testing.assert_allclose(again.parameters, parameters, rtol=1e-12)
    parameters[0] = -0.1
    with pytest.raises(RobotError, match=r"force=True needs a mass of more than zero"):
        write_mjcf(robot.with_values(parameters, robot.drives), tmp_path / "o.xml", force=True)


MESHES: dict[tuple[str, ...], str] = {
    ("/meshes/thigh.stl",): "",
    ("file:///thigh.stl",): "",
    ("a.stl",): "'a.stl' is relative to its folder",
    ("a.stl", "b.stl"): "'a.stl' and 1 other file are relative to its folder",
    ("a.stl", "b.stl", "c.stl"): "'a.stl' and 2 other files are relative to its folder",
}


@pytest.mark.parametrize("files", MESHES)
def test_meshes_that_would_be_lost_are_counted(tmp_path: Path, files: tuple[str, ...]) -> None:
    """They are named relative to a file that is written into another folder."""
    visual = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    shapes = "".join(map(visual.format, files))
    robot = loaded(tmp_path, FIXED.replace(visual.format("package://leg/thigh.stl"), shapes))
    assert not write_urdf(robot, tmp_path / "beside it.urdf").notes
    notes = write_urdf(robot, tmp_path / "another folder" / "out.urdf").notes
    if not MESHES[files]:
        assert notes == ()
        return
    assert notes[0].startswith(f"{MESHES[files]}: write it into '{tmp_path}', or copy them")


def moved(folder: Path, text: str | None = None, name: str = "leg.urdf") -> dict[str, Any]:
    """Put another file in the place of the robot's own, or beside it; return it as source=."""
    (folder / name).unlink(missing_ok=True)
    if text is not None:
        (folder / name).write_text(text)
    return {} if name == "leg.urdf" else {"source": folder / name}


@pytest.mark.parametrize(
    ("change", "name", "out", "words"),
    [
        (('"hip"', '"hop"'), "other.urdf", "out.urdf", "named 'hip'; did you mean 'hop'"),
        (('"thigh"', '"femur"'), "o.urdf", "out.urdf", "moves link 'femur', in the robot it moves"),
        (
            ('<child link="camera"/>', '<child link="eye"/>'),
            "leg.urdf",
            "out.urdf",
            "link is named 'eye'",
        ),
        (None, "leg.urdf", "out.urdf", r"no URDF file at '.*leg\.urdf'"),
        ((FIXED[700:], ""), "leg.urdf", "out.urdf", r"leg\.urdf' is not well-formed XML"),
        (("", ""), "leg.urdf", "./leg.urdf", r"leg.urdf' is the source URDF: name another file"),
        (("", ""), "out.toml", "out.urdf", r"out\.toml' is the source URDF"),
        (("", ""), "leg.urdf", "out.toml", r"no name for a URDF: name a file that ends in \.urdf"),
        (("", ""), "leg.urdf", "OUT.TOML", "is no name for a URDF"),
        (("", ""), "leg.urdf", "", "is no name for a URDF"),
    ],
)
def test_files_that_do_not_fit_are_named_and_left(
    change: tuple[str, str] | None, name: str, out: str, words: str, tmp_path: Path
) -> None:
    robot = fixed_robot(tmp_path)
    options = moved(tmp_path, FIXED.replace(*change) if change else None, name)
    before = {path: path.read_text() for path in tmp_path.iterdir()}
    with pytest.raises(RobotError, match=words):
        write_urdf(robot, tmp_path / out if out else "", **options)
    assert {path: path.read_text() for path in tmp_path.iterdir()} == before


def test_a_full_disk_leaves_both_old_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = fixed_robot(tmp_path)
    for name in ("out.urdf", "out.toml"):
        (tmp_path / name).write_text("old")
    write = Path.write_bytes
    for full_at in (".urdf", ".toml"):  # of the URDF, and of the drives after it

        def full(path: Path, content: bytes, full_at: str = full_at) -> int:
            if path.suffix == full_at:
                raise OSError(28, "No space left on device")
            return write(path, content)

        with monkeypatch.context() as patched:
            patched.setattr(Path, "write_bytes", full)
            with pytest.raises(SeaidError, match=r"out\.\w+': No space left on device; make room"):
                write_urdf(robot, tmp_path / "out.urdf")
        assert [(tmp_path / f"out.{end}").read_text() for end in ("urdf", "toml")] == ["old"] * 2
        assert len(list(tmp_path.iterdir())) == 3


def test_friction_of_drives_that_move_other_joints_is_left_to_the_file_of_drives(
    tmp_path: Path,
) -> None:
    """The known payload is no part of the file either."""
    urdf = MODELS / "differential_wrist.urdf"
    robot = load_robot(urdf, MODELS / "differential_wrist.toml", payloads=[Payload("hand", 1.0)])
    stiff = {
        joint: StiffDrive(gear_ratio=5.0, coulomb_friction_Nm=0.1, transmission=drive.transmission)
        for joint, drive in robot.drives.items()
    }
    written = write_urdf(robot.with_drives(stiff), tmp_path / "out.urdf")
    coupled = [joint for joint, drive in stiff.items() if drive.transmission]
    assert len(coupled) == 2
    assert written.urdf.read_text().count("<dynamics") == len(stiff) - len(coupled)
    payload, *notes = written.notes
    for joint, note in zip(coupled, notes, strict=True):
        assert note.startswith(f"joint '{joint}': its drive moves other joints")
    assert payload == "the known payload is not in the file: give it with payloads="
    again = load_robot(urdf, written.drives)
    assert again.drives == stiff
    np.testing.assert_allclose(again.parameters, robot.parameters, rtol=1e-12)


def test_a_link_that_has_only_what_is_fixed_to_it_gets_nothing_but_rounding(tmp_path: Path) -> None:
    """2.7 + 0.2 - 2.7 - 0.2 is no zero: what is left must not be written as a body."""
    robot = loaded(tmp_path, re.sub(r"<inertial>.*?</inertial>", "", FIXED, count=1, flags=re.S))
    jitter = 1 + 1e-15 * np.random.default_rng(0).uniform(-1, 1, 10)
    noisy = robot.with_values(robot.parameters * jitter, robot.drives)
    written = write_urdf(noisy, tmp_path / "o.urdf")
    assert written.urdf.read_text().count("<inertial>") == 1
    again = load_robot(written.urdf).parameters
    np.testing.assert_allclose(again, robot.parameters, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (0, 1e10, r"'thigh' would have a mass of 1e\+10 kg \(at most 1e\+09 kg\)"),
        (1, 1e6, "'thigh' would have its centre of mass further than 10000 m away"),
        (4, 1e16, r"'thigh' would have an inertia of 1e\+16 kg m\^2"),
        (0, 1e300, "'thigh' would have a mass"),
    ],
)
def test_absurd_bodies_and_robots_without_bodies_are_refused_even_by_force(
    tmp_path: Path, place: int, value: float, words: str
) -> None:
    robot = fixed_robot(tmp_path)
    parameters = robot.parameters.copy()
    parameters[place] = value
    absurd = robot.with_values(parameters, robot.drives)
    for write in (write_urdf, write_mjcf):
        with pytest.raises(RobotError, match=words):
            write(absurd, tmp_path / "out.urdf", force=True)
        with pytest.raises(RobotError, match="no inertial parameters to write"):
            write(robot.without_nominal(), tmp_path / "out.urdf")
    with pytest.raises(RobotError, match="name its URDF with source="):
        write_urdf(replace(robot, urdf=None), tmp_path / "out.urdf")
    assert [path.name for path in tmp_path.iterdir()] == ["leg.urdf"]


def test_exports_of_files_with_namespaces_and_version_0_are_read_by_others(tmp_path: Path) -> None:
    """yourdfpy finds no links in a default namespace, and XML has no version 0.0.

    Elements of other namespaces are left alone.
    """
    other = '<o:link xmlns:o="urn:o" name="thigh"><inertial><mass value="9"/></inertial></o:link>'
    text = FIXED.replace('version="1.0"', 'version="0.0"', 1)
    text = text.replace("<robot ", '<robot xmlns="http://www.ros.org" ')
    robot = changed(loaded(tmp_path, text.replace("<link", f"<mujoco/>{other}<link", 1)))
    path = write_urdf(robot, tmp_path / "out.urdf").urdf
    again, lines = load_robot(path), path.read_text().splitlines()
    np.testing.assert_allclose(again.parameters, robot.parameters, rtol=1e-12)
    model = pin.buildModelFromUrdf(str(path))
    assert model.inertias[1].mass == pytest.approx(robot.parameters[0], rel=1e-12)
    read = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot
    assert {link.name for link in read.links} >= {"base", *robot.body_names}
    assert lines[0] == '<?xml version="1.0"?>'
    assert any(f"<mujoco/>{other}" in line for line in lines)


# XML as text: what changes is changed in its place, all else stays byte by byte

STRANGE = """<?xml version='1.0' encoding='ISO-8859-1' standalone="yes"?>
<!DOCTYPE robot [<!ENTITY maker "caf\u00e9">]>
<?editor keep="this"?>
<!-- before <inertial> -->
<robot name='arm' xmlns:xacro="http://ros.org/xacro" xacro:note="&maker;" z='1' a='2'>
  <gazebo><link name="upper"><inertial><mass value="9"/></inertial></link></gazebo>
  <link  name = 'base' />
\t<link
     name="upper"   >
    <inertial  >
      <!-- weighed > in March -->
      <mass unit='kg' value='3'></mass><custom><![CDATA[a < b & c]]></custom>
      <inertia iyy="0.03" ixx="0.03"   izz='0.01' ixy="0" ixz="0"
               iyz="0"/>
    </inertial>
    <visual><geometry><mesh scale="1 1 1" filename="package://arm/&maker;.stl"/></geometry></visual>
  </link >
  <link name="hand"/>
  <joint type="revolute" name="wrist"><child link="hand"/><parent link="upper"/>
    <limit lower="-1" upper="1" velocity="5" effort="20"/></joint>
  <joint type="continuous" name="elbow"><parent link="base"/><child link="upper"/></joint>
  <joint type="fixed" name="palm_joint"><parent link="hand"/><child link="palm"/></joint>
  <link name="palm"><inertial><mass value="0.1"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
<!-- after -->
"""


def test_a_strange_file_stays_as_it_is_but_for_its_bodies(tmp_path: Path) -> None:
    text = STRANGE.replace("\n", "\r\n").encode("iso-8859-1")
    path = tmp_path / "strange arm.urdf"
    path.write_bytes(text)
    robot = load_robot(path)
    bodies = 1.5 * robot.parameters
    written = write_urdf(robot.with_values(bodies, robot.drives), tmp_path / "out.urdf").urdf
    np.testing.assert_allclose(load_robot(written).parameters, bodies, rtol=1e-12, atol=1e-18)
    found = written.read_bytes()
    assert outside_of_inertials(written) == outside_of_inertials(path)
    assert found.count(b"\n") == found.count(b"\r\n")
    new = [line for line in found.split(b"\r\n") if line not in text.split(b"\r\n")]
    origin, mass, *inertia, start, inside, end = new
    assert origin.startswith(b"      <origin xyz=")
    assert b"<mass unit='kg' value=\"4.5\"></mass><custom><![CDATA[a < b & c]]></custom>" in mass
    assert [line.partition(b'="')[0] for line in inertia] == [
        b"      <inertia iyy",
        b"               iyz",
    ]
    assert (start, end) == (b'  <link name="hand">', b"  </link>")
    assert inside.startswith(b'    <inertial><origin xyz="0.0 0.0 0.0" rpy="0 0 0"/><mass value=')


def test_what_is_new_is_indented_as_its_neighbours() -> None:
    text = b"<a>\n  <b>\n    <c/>\n  </b>\n  <d x='1' />\n  <e></e>\n</a>"
    root = parse_positions(text)
    places = [root.find(tag) for tag in "bde"]
    edits = [
        with_content(text, one, [new_element("n", {"m": {"k": "2"}})]) for one in places if one
    ]
    assert edited(text, edits) == (
        b'<a>\n  <b>\n    <n><m k="2"/></n>\n    <c/>\n  </b>\n  <d x=\'1\'>\n    <n><m k="2"/></n>'
        b'\n  </d>\n  <e>\n    <n><m k="2"/></n></e>\n</a>'
    )
    # an element goes with the space before it
    assert edited(text, [without(text, one) for one in root.children]) == b"<a>\n</a>"
    with pytest.raises(ValueError, match="its encoding is not one of single bytes or UTF-8"):
        parse_positions("<a/>".encode("utf-16"))


TAGS, NAMES = st.sampled_from("abc"), st.sampled_from(["k", "kk", "ns:k"])
VALUES = st.text(string.ascii_letters + " /=>'", max_size=5)
ATTRIBUTES = st.dictionaries(NAMES, VALUES, max_size=3)
SPACES = st.sampled_from(["", " ", "\n  ", "<!-- <a k='9'/> -->", "<![CDATA[<b>]]>", "<?p a?>"])


@st.composite
def elements(draw: st.DrawFn, depth: int = 3) -> str:
    """Return the text of an element with others inside, comments and odd spaces."""
    tag, space = draw(TAGS), draw(st.sampled_from([" ", "\n\t", "  "]))
    attributes = "".join(
        f'{space}{name}{draw(st.sampled_from(["=", " = "]))}"{value}"'
        for name, value in draw(ATTRIBUTES).items()
    )
    if draw(st.booleans()):
        return f"<{tag}{attributes}{draw(st.sampled_from(['', ' ']))}/>"
    inside = draw(st.lists(elements(depth - 1), max_size=3)) if depth else []
    content = "".join(draw(SPACES) + one for one in inside) + draw(SPACES)
    return f"<{tag}{attributes}>{content}</{tag}>"


@given(inside=elements(), children=st.dictionaries(TAGS, ATTRIBUTES, min_size=1))
def test_places_and_edits_are_what_a_parser_of_the_whole_file_sees(
    inside: str, children: dict[str, dict[str, str]]
) -> None:
    text = f'<r xmlns:ns="n">{inside}</r>'.encode()
    tree, root = etree.fromstring(text), parse_positions(text)
    seen = [(one.tag.replace("{n}", "n "), len(one.attrib)) for one in tree.iter(etree.Element)]
    assert [(one.tag, len(one.attributes)) for one in root.all()][1:] == seen[1:]
    for one in root.all():
        tag = one.tag.replace("n ", "ns:")
        assert text[one.start : one.end].startswith(b"<" + tag.encode())
        closing = b"/>" if is_empty(text, one) else f"</{tag}>".encode()
        assert text[one.start : one.end].endswith(closing)
        assert not with_children(text, one, {})
    assert edited(text, []) == text
    parent = root.children[0]
    found = parse_positions(edited(text, with_children(text, parent, children))).children[0]
    before = {tag: parent.find(tag) for tag in children}
    for tag, attributes in children.items():
        child, old = found.find(tag), before[tag]
        assert isinstance(child, Element)
        written = {name.replace("ns:", "n "): value for name, value in attributes.items()}
        assert child.attributes == {**(old.attributes if old else {}), **written}
    assert len(found.children) == len(parent.children) + sum(old is None for old in before.values())
