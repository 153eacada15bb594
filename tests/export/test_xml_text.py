"""XML as text: what changes is changed in its place, all else stays byte by byte."""

from __future__ import annotations

import string
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from seaid.export.urdf import (
    Element,
    edited,
    is_empty,
    new_element,
    parse_positions,
    with_children,
    with_content,
    without,
    write_urdf,
)
from seaid.robot.robot import load_robot

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
    bodies = robot.parameters.copy()
    bodies *= 1.5
    written = write_urdf(robot.with_values(bodies, robot.drives), tmp_path / "out.urdf")
    found = written.urdf.read_bytes()
    np.testing.assert_allclose(load_robot(written.urdf).parameters, bodies, rtol=1e-12, atol=1e-18)
    lines = [line for line in found.split(b"\r\n") if line not in text.split(b"\r\n")]
    assert found.count(b"\n") == found.count(b"\r\n")
    assert len(lines) == 7
    assert lines[0].startswith(b"      <origin xyz=")
    assert (
        b"<mass unit='kg' value=\"4.5\"></mass><custom><![CDATA[a < b & c]]></custom>" in lines[1]
    )
    assert lines[2].startswith(b'      <inertia iyy="')
    assert lines[3].startswith(b'               iyz="')
    assert lines[4] == b'  <link name="hand">'
    assert lines[5].startswith(
        b'    <inertial><origin xyz="0.0 0.0 0.0" rpy="0 0 0"/><mass value="0.05'
    )
    assert lines[6] == b"  </link>"


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


def test_an_element_goes_with_the_space_before_it() -> None:
    text = b"<a>\n  <b>x</b>\n  <c/>\n</a>"
    root = parse_positions(text)
    assert edited(text, [without(text, one) for one in root.children]) == b"<a>\n</a>"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"<a><b></a>", "mismatched tag"),
        ("<a/>".encode("utf-16"), "its encoding is not one of single bytes or UTF-8"),
    ],
)
def test_what_cannot_be_read_is_said(text: bytes, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse_positions(text)


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


def canonical(text: bytes) -> str:
    return str(etree.canonicalize(text.decode()))


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
    parent = root.children[0]
    found = parse_positions(edited(text, with_children(text, parent, children))).children[0]
    before = {tag: parent.find(tag) for tag in children}
    for tag, attributes in children.items():
        child, old = found.find(tag), before[tag]
        assert isinstance(child, Element)
        written = {name.replace("ns:", "n "): value for name, value in attributes.items()}
        assert child.attributes == {**(old.attributes if old else {}), **written}
    assert len(found.children) == len(parent.children) + sum(old is None for old in before.values())


@given(inside=elements())
def test_no_edit_changes_nothing(inside: str) -> None:
    text = inside.replace("ns:", "ns_").encode()
    assert edited(text, []) == text
    same = [with_children(text, one, {}) for one in parse_positions(text).all()]
    assert not any(same)
