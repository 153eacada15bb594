"""write_urdf: the source URDF with the identified bodies, otherwise unchanged byte by byte.

Comments, order, quotes, line ends, entities and encoding of the user's file are preserved: the text
is edited at the byte positions of elements that expat reports.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, spaced
from seaid._files import real_path, whole_file
from seaid._progress import Display, counted
from seaid.drives import IDEAL_DRIVE, write_drives
from seaid.errors import RobotError, checked, unknown_name
from seaid.export.joint_actuators import actuators_of, has_plain_gear
from seaid.export.mjcf_drives import temperature_notes
from seaid.identification import Identification
from seaid.robot import Robot, UrdfTree, is_physical, reread_urdf
from seaid.robot.inertia import (
    SMALLEST_KG,
    THIN,
    in_parent_frame,
    inconsistent_link,
    out_of_range,
    second_moments,
)
from seaid.robot.robot_file import urdf_text

Edit = tuple[int, int, bytes]
"""First byte, byte after the last one, and the replacement."""

MoreEdits = Callable[[bytes, "Element"], list[Edit]] | None
"""What a format of URDF adds to a text, by its root element."""

_START_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=/>]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*/?>""")


@dataclass(eq=False)
class Element:
    """An XML element with its byte positions: `start` to `end`, content from `inside` on."""

    tag: str
    attributes: Mapping[str, str]
    start: int
    inside: int
    end: int
    children: list[Element]

    def find(self, tag: str) -> Element | None:
        """Return the first child of a tag, None if there is none."""
        return next((child for child in self.children if child.tag == tag), None)

    def named(self, tag: str) -> dict[str, Element]:
        """Return {name: child} of the named children of a tag."""
        children = (child for child in self.children if child.tag == tag)
        return {child.attributes["name"]: child for child in children if "name" in child.attributes}

    def all(self) -> Iterable[Element]:
        """Yield the element and all its descendants."""
        yield self
        for child in self.children:
            yield from child.all()


def parse_positions(text: bytes) -> Element:
    """Return the root element of an XML text, with the byte positions of all elements.

    The tag of an element in a namespace starts with the namespace and a space. Raises ValueError
    for text that is not well-formed, or whose encoding does not contain ASCII.
    """
    parser = expat.ParserCreate(namespace_separator=" ")
    top = Element("", {}, 0, 0, 0, [])
    waiting = [top]

    def begin(tag: str, attributes: Mapping[str, str]) -> None:
        at = parser.CurrentByteIndex
        # Not up to the next ">", which may be in a quoted value.
        match = _START_TAG.match(text, at)
        if match is None:
            raise ValueError("its encoding is not one of single bytes or UTF-8")
        element = Element(tag, attributes, at, match.end(), match.end(), [])
        waiting[-1].children.append(element)
        waiting.append(element)

    def finish(_: str) -> None:
        element = waiting.pop()
        # expat reports the end of <a/> behind it, where the next ">" belongs to another tag.
        if not is_empty(text, element):
            element.end = text.index(b">", parser.CurrentByteIndex) + 1

    parser.StartElementHandler, parser.EndElementHandler = begin, finish
    try:
        parser.Parse(text, True)
    except expat.ExpatError as problem:
        raise ValueError(str(problem)) from None
    return top.children[0]


def is_empty(text: bytes, element: Element) -> bool:
    """Return whether an element is a single tag, <a/>."""
    return text.endswith(b"/>", element.start, element.inside)


def with_children(
    text: bytes, parent: Element, children: Mapping[str, Mapping[str, str]]
) -> list[Edit]:
    """Return the edits that set attributes of children; missing children are created."""
    edits, missing = [], {}
    for tag, attributes in children.items():
        child = parent.find(tag)
        if child is None:
            missing[tag] = attributes
        else:
            edits.append(with_start(text, child, attributes))
    if missing:
        edits.append(with_content(text, parent, [_tag(*element) for element in missing.items()]))
    return edits


def new_element(tag: str, children: Mapping[str, Mapping[str, str]]) -> bytes:
    """Return an element on one line."""
    content = b"".join(_tag(*child) for child in children.items())
    return b"<%b>%b</%b>" % (tag.encode(), content, tag.encode())


def with_content(text: bytes, parent: Element, elements: Iterable[bytes]) -> Edit:
    """Return the edit that inserts elements at the start of another, indented as its children."""
    # Empty where the parent does not begin its line: text on one line stays on one line.
    outer = _indent(text, parent.start)
    if not is_empty(text, parent):
        # The line end and the indentation of the first child, not of </parent>.
        follows = re.compile(rb"\r?\n[ \t]*(?=<(?!/))").match(text, parent.inside)
        indent = follows.group() if follows is not None else outer and outer + b"  "
        return parent.inside, parent.inside, b"".join(indent + element for element in elements)
    content = b"".join((outer and outer + b"  ") + element for element in elements)
    opened = text[parent.start : parent.inside].removesuffix(b"/>").rstrip() + b">"
    close = b"%b</%b>" % (outer, parent.tag.encode())
    return parent.start, parent.inside, opened + content + close


def with_start(text: bytes, element: Element, attributes: Mapping[str, str]) -> Edit:
    """Return the edit that sets attributes of an element."""
    tag = text[element.start : element.inside]
    return element.start, element.inside, _with_attributes(tag, attributes)


def without(text: bytes, element: Element) -> Edit:
    """Return the edit that removes an element and the space before it."""
    start = element.start
    while start and text[start - 1 : start].isspace():
        start -= 1
    return start, element.end, b""


def edited(text: bytes, edits: Iterable[Edit]) -> bytes:
    """Return a text after edits, which must not overlap."""
    parts, done = [], 0
    # Insertions have start = end, and come before a replacement that starts there.
    for start, end, new in sorted(edits):
        parts += [text[done:start], new]
        done = end
    return b"".join([*parts, text[done:]])


def _indent(text: bytes, start: int) -> bytes:
    """Return the line end and the spaces before a position, empty if other text precedes it."""
    line = text.rfind(b"\n", 0, start)
    if line < 0 or text[line + 1 : start].strip(b" \t"):
        return b""
    return text[line - (text[line - 1 : line] == b"\r") : start]


def _tag(tag: str, attributes: Mapping[str, str]) -> bytes:
    return _with_attributes(b"<%b/>" % tag.encode(), attributes)


def _with_attributes(tag: bytes, attributes: Mapping[str, str]) -> bytes:
    """Return a start tag with attributes set; existing ones keep their positions."""
    for name, value in attributes.items():
        key, quoted = name.encode(), b'"%b"' % value.encode()
        existing = re.search(rb"""\s%b\s*=\s*("[^"]*"|'[^']*')""" % re.escape(key), tag)
        if existing is not None:
            tag = tag[: existing.start(1)] + quoted + tag[existing.end(1) :]
            continue
        close = re.search(rb"\s*/?>\Z", tag)
        assert close is not None  # it matched as a start tag
        tag = tag[: close.start()] + b" %b=%b" % (key, quoted) + tag[close.start() :]
    return tag


_ROUNDING = 1e-13
"""Relative size below which the difference of a body and its parts is rounding error."""


@dataclass(frozen=True, repr=False)
class WrittenUrdf(Display):
    """The files written, and `notes` on what they do not contain."""

    urdf: Path
    drives: Path | None
    notes: tuple[str, ...]


@checked(RobotError)
def write_urdf(
    identified: Identification | Robot,
    path: str | Path,
    *,
    source: str | Path | None = None,
    force: bool = False,
    at_temperature_degC: float | None = None,
) -> WrittenUrdf:
    """Write the robot's URDF with the identified bodies, and its drives as a TOML file.

    Only the <inertial> of moving links and the <dynamics> of joints with a stiff drive (damping and
    friction at the joint) change; all other text stays byte by byte, but for default namespaces and
    XML version 0.0, which some readers refuse. Links fixed to a moving link
    keep their inertia, and the moving link gets the difference to the identified sum; if that
    difference is physically inconsistent, the moving link gets the sum and the fixed links none (a
    note says so). The payload is not in the file. Drives that are not ideal go to `<path>.toml`.

    Parameters
    ----------
    identified : Identification or Robot
    path : path
        The URDF to write, another file than `source`.
    source : path, optional
        The URDF to edit. Default: the file from which the robot was loaded.
    force : bool
        Whether to write physically inconsistent bodies.
    at_temperature_degC : float, optional
        Temperature of the motors, for <dynamics> of friction that depends on it, as a comment at
        the end of the file says. Default: that of reference. The drives keep their terms.

    Returns
    -------
    WrittenUrdf

    Raises
    ------
    RobotError
        For bodies that are unknown, or physically inconsistent without `force`, and for a source
        that is `path` or lacks the links of the robot.
    SeaidError
        If a file cannot be written.

    Examples
    --------
    >>> result = seaid.identify(robot, log, feasible=True)
    >>> seaid.write_urdf(result, "identified.urdf").drives
    PosixPath('identified.toml')
    """
    robot = identified.robot if isinstance(identified, Identification) else identified
    return write_edited(robot, Path(path), source, force, at_temperature_degC)


def write_edited(
    robot: Robot,
    path: Path,
    source: str | Path | None,
    force: bool,
    at_temperature_degC: float | None,
    more: MoreEdits = None,
) -> WrittenUrdf:
    """Write what `write_urdf` does; with `more` edits of the text, as a rigid robot."""
    source, drives = _source_and_drives(robot, path, source)
    text = urdf_text(source)  # read once: the file may change meanwhile
    tree = reread_urdf(source, text)
    _check_links(source, tree, robot)
    notes: list[str] = []
    # A locked joint is a fixed one at its angle: the links behind it are part of the moving body.
    bodies = _bodies(robot, tree.locked_at(robot.locked), notes, force)
    root = _root(source, text)
    links = root.named("link")
    edits = [edit for link in bodies for edit in _inertial_edits(text, links[link], bodies[link])]
    warm = robot.at_temperature(at_temperature_degC)
    edits += _dynamics(text, root, warm, is_rigid=more is not None)
    edits += [] if more is None else more(text, root)
    warmth = temperature_notes(robot, at_temperature_degC)
    notes += warmth
    _note_missing(robot, notes)
    _note_files(path, source, root, notes)
    with whole_file(path) as temporary:
        comments = "".join(f"\n<!-- {note} -->\n" for note in warmth)
        temporary.write_bytes(edited(text, edits) + comments.encode())
        if drives is not None:
            write_drives(robot.drives, drives)
    return WrittenUrdf(path, drives, tuple(notes))


def _source_and_drives(
    robot: Robot, path: Path, source: str | Path | None
) -> tuple[Path, Path | None]:
    """Return the URDF to edit, and the drive file to write: None if all drives are ideal."""
    source = robot.urdf if source is None else Path(source)
    if source is None:
        raise RobotError(f"'{robot.name}' was not loaded from a file: name its URDF with source=")
    if not path.name or path.suffix.lower() == ".toml":
        raise RobotError(f"'{path}' is no name for a URDF: name a file that ends in .urdf")
    is_ideal = all(drive == IDEAL_DRIVE for drive in robot.drives.values())
    drives = None if is_ideal else path.with_suffix(".toml")
    for written in (path, drives):
        if written is not None and real_path(written) == real_path(source):
            raise RobotError(f"'{written}' is the source URDF: name another file to write")
    return source, drives


def _root(source: Path, text: bytes) -> Element:
    """Return the root element of a URDF's text."""
    try:
        return parse_positions(text)
    except ValueError as problem:
        raise RobotError(f"cannot write into the text of URDF '{source}': {problem}") from None


def _check_links(source: Path, tree: UrdfTree, robot: Robot) -> None:
    for joint, body in zip(robot.all_joint_names, robot.body_names, strict=False):
        if joint not in tree.joints:
            raise RobotError(f"URDF '{source}': " + unknown_name("joint", joint, tree.joints))
        if tree.joints[joint].child != body:
            raise RobotError(
                f"URDF '{source}': joint '{joint}' moves link '{tree.joints[joint].child}', in the "
                f"robot it moves '{body}': this is not the file of the identified robot"
            )


def _bodies(robot: Robot, tree: UrdfTree, notes: list[str], force: bool) -> dict[str, Array]:
    """Return {link: ten parameters in its frame} of all links that change."""
    if not np.all(np.isfinite(robot.parameters)):
        raise RobotError(f"'{robot.name}' has no inertial parameters to write")
    changed: dict[str, Array] = {}
    moving = frozenset(robot.all_joint_names)
    for body, lump in zip(robot.body_names, robot.parameters.reshape(-1, 10), strict=True):
        placements = _fixed_links(tree, body, moving)
        fixed = {link: tree.links[link] for link in placements if np.any(tree.links[link])}
        # Inertial parameters about one frame add up: those of the link are the sum less the parts.
        rest = _rest(lump, [in_parent_frame(ten, placements[link]) for link, ten in fixed.items()])
        # The parts are those of the file: if it has them too heavy, the rest has a negative mass.
        is_consistent = is_physical(rest, THIN) and not _is_massless(rest)
        if fixed and not is_consistent and is_physical(lump, THIN):
            notes.append(
                f"link '{body}' has the inertia of all links fixed to it "
                f"({', '.join(fixed)}): without theirs it would be physically inconsistent"
            )
            rest, changed = lump, changed | dict.fromkeys(fixed, np.zeros(10))
        _check_consistent(body, rest, force, notes)
        changed[body] = rest
    return changed


def _rest(lump: Array, parts: Sequence[Array]) -> Array:
    """Return a body without some of its parts, all zero if only rounding errors remain."""
    rest = lump - sum(parts, np.zeros(10))
    sizes = np.max(np.abs([lump, *parts]), axis=0)
    # Masses, first and second moments have different units: each kind has its own rounding error.
    remains = any(
        np.max(np.abs(rest[kind])) > _ROUNDING * np.max(sizes[kind])
        for kind in (slice(0, 1), slice(1, 4), slice(4, 10))
    )
    return rest if remains or not parts else np.zeros(10)


def _fixed_links(tree: UrdfTree, body: str, moving: frozenset[str]) -> dict[str, pin.SE3]:
    """Return {link: placement in the body's frame} of the links fixed to that of a body."""
    placements: dict[str, pin.SE3] = {}
    stack = [(body, pin.SE3.Identity())]
    while stack:
        link, placement = stack.pop()
        for below in tree.children(link):
            if below.name not in moving:
                placements[below.child] = placement * below.placement
                stack.append((below.child, placements[below.child]))
    return placements


def _check_consistent(body: str, parameters: Array, force: bool, notes: list[str]) -> None:
    """Raise RobotError for inertial parameters that a URDF cannot hold; note forced ones."""
    massless = _is_massless(parameters)
    absurd = out_of_range(parameters) if np.any(parameters) and not massless else None
    if absurd is not None:
        raise RobotError(f"link '{body}' would have {absurd}, which is not written")
    problem = inconsistent_link(body, parameters)
    if problem is not None and not force:
        raise RobotError(
            f"{problem}: identify with feasible=True, or write it with force=True",
            "feasible=True",
            "write it with force=True",
        )
    if massless:
        raise RobotError(
            f"link '{body}' would have inertia without a mass ({parameters[0]:.4g} kg), which a "
            "URDF cannot hold: identify with feasible=True",
            "feasible=True",
        )
    if problem is not None:
        notes.append(problem)


def _is_massless(parameters: Array) -> bool:
    """Return whether a body has inertia but no mass."""
    return bool(abs(parameters[0]) < SMALLEST_KG and np.any(parameters))


def _inertial_edits(text: bytes, element: Element, parameters: Array) -> list[Edit]:
    """Return the edits that write ten parameters, in the link's frame, as mass and inertia."""
    inertial = element.find("inertial")
    if not np.any(parameters):
        return [] if inertial is None else [without(text, inertial)]
    mass, center = parameters[0], parameters[1:4] / parameters[0]
    # I = tr(S) 1 - S, with the second moments S about the centre of mass too
    second = second_moments(parameters)
    inertia = np.trace(second) * np.eye(3) - second
    places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    children = {
        # An old rpy would turn the new tensor, which is in the axes of the link.
        "origin": {"xyz": spaced(center), "rpy": "0 0 0"},
        "mass": {"value": spaced([mass])},
        "inertia": {name: spaced([inertia[at]]) for name, at in {**places, "izz": (2, 2)}.items()},
    }
    if inertial is None:
        return [with_content(text, element, [new_element("inertial", children)])]
    return with_children(text, inertial, children)


def _dynamics(text: bytes, root: Element, robot: Robot, *, is_rigid: bool) -> list[Edit]:
    """Return the edits that write damping and friction of stiff drives, reflected to the joint.

    Those of elastic drives are only in the TOML, because their motor is no coordinate of a URDF; if
    the robot `is_rigid` they are written as well.
    """
    joints, edits = root.named("joint"), []
    for actuator in actuators_of(robot, is_complete=False):
        known, seen = robot.drives[actuator.joint].values, {}
        if actuator.viscous or "viscous_friction" in known:
            seen["damping"] = spaced([actuator.viscous])
        if actuator.dry or "coulomb_friction" in known:
            seen["friction"] = spaced([actuator.dry])
        if seen and (is_rigid or not actuator.drive.is_elastic):
            edits += with_children(text, joints[actuator.joint], {"dynamics": seen})
    return edits


def _note_missing(robot: Robot, notes: list[str]) -> None:
    """Add notes on parts of the robot that a URDF cannot hold."""
    if np.any(robot.payload_parameters):
        notes.append("the known payload is not in the file: give it with payloads=")
    for joint, is_plain in zip(robot.joint_names, has_plain_gear(robot), strict=True):
        if not is_plain and not robot.drives[joint].is_elastic:
            notes.append(
                f"joint '{joint}': its drive moves other joints, or this one by an angle_ratio, "
                "and <dynamics> cannot hold its friction: the drive file does"
            )


def _note_files(path: Path, source: Path, root: Element, notes: list[str]) -> None:
    """Add a note on meshes and textures that are no longer found from another folder."""
    shapes = (element for element in root.all() if element.tag in ("mesh", "texture"))
    named = dict.fromkeys(shape.attributes.get("filename", "") for shape in shapes)
    relative = [
        name for name in filter(None, named) if not ("://" in name or Path(name).is_absolute())
    ]
    folder = real_path(source).parent
    if relative and real_path(path).parent != folder:
        first, others = f"'{relative[0]}'", counted(len(relative) - 1, "other file")
        files = f"{first} and {others} are" if len(relative) > 1 else f"{first} is"
        notes.append(f"{files} relative to its folder: write it into '{folder}', or copy them")
