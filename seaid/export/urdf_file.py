"""The user's own URDF with the identified bodies in it; everything else stays as it was."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.drivetrain.model import IDEAL_DRIVE, StiffDrive
from seaid.errors import RobotError, unknown_name
from seaid.export.drive_tables import write_drivetrains
from seaid.export.xml_text import (
    Edit,
    Element,
    edited,
    new_element,
    read_places,
    with_children,
    with_content,
    without,
)
from seaid.files import whole_file
from seaid.identification import Identification
from seaid.inertia import THIN, impossible_body, in_parent_frame, is_physical
from seaid.robot import Robot
from seaid.urdf import UrdfTree, urdf_again


@dataclass(frozen=True)
class WrittenUrdf:
    """The files written, and in words what a reader of them must know."""

    urdf: Path
    drivetrains: Path | None
    notes: tuple[str, ...]


def write_urdf(
    found: Identification | Robot,
    path: str | Path,
    *,
    source: str | Path | None = None,
    force: bool = False,
) -> WrittenUrdf:
    """Write the robot's URDF with its bodies replaced, and its drives as TOML beside it.

    Only the <inertial> of links that move, and the <dynamics> of joints with a stiff drive (damping
    and friction, seen at the joint), change; all other text stays byte by byte. Links that are
    fixed to a moving one keep their inertia, and the moving link gets the rest of what was
    identified together; where that rest is no possible body, it gets all and they get none (a
    note says so). The payload is not in the file. `source`: the URDF to take (default: the file
    that the robot was loaded from). Drives that are not ideal go to `<path>.toml`.

    Raises RobotError for bodies that cannot exist (unless `force`) or are not known, and for a
    source that is `path` or has not the robot's links; SeaidError where a file cannot be written.
    """
    robot = found.robot if isinstance(found, Identification) else found
    path = Path(path)
    source = robot.urdf if source is None else Path(source)
    if source is None:
        raise RobotError(f"'{robot.name}' was not loaded from a file: name its URDF with source=")
    source = Path(source)
    if path.resolve() == source.resolve():
        raise RobotError(f"'{path}' is the URDF that is taken: name another file to write")
    tree = urdf_again(source)
    _check_links(source, tree, robot)
    notes: list[str] = []
    bodies = _bodies(robot, tree, notes, force)
    text, root = _text_of(source)
    edits = [edit for link in bodies for edit in _inertial_edits(text, root, link, bodies[link])]
    edits += [edit for joint in robot.joint_names for edit in _dynamics(text, root, robot, joint)]
    _note_left_out(robot, path, source, root, notes)
    drives = None
    if any(drive != IDEAL_DRIVE for drive in robot.drivetrains.values()):
        drives = path.with_suffix(".toml")
    with whole_file(path) as temporary:
        temporary.write_bytes(edited(text, edits))
        if drives is not None:
            write_drivetrains(robot.drivetrains, drives)
    return WrittenUrdf(path, drives, tuple(notes))


def _text_of(source: Path) -> tuple[bytes, Element]:
    """Return a URDF's text, and where its elements are."""
    try:
        text = source.read_bytes()
        return text, read_places(text)
    except (ValueError, OSError) as problem:
        raise RobotError(f"cannot read URDF '{source}': {problem}") from None


def _check_links(source: Path, tree: UrdfTree, robot: Robot) -> None:
    for joint, body in zip(robot.joint_names, robot.body_names, strict=True):
        if joint not in tree.joints:
            raise RobotError(f"URDF '{source}': " + unknown_name("joint", joint, tree.joints))
        if tree.joints[joint].child != body:
            raise RobotError(
                f"URDF '{source}': joint '{joint}' moves link '{tree.joints[joint].child}', that "
                f"of the robot '{body}': this is another file than the one identified"
            )


def _bodies(robot: Robot, tree: UrdfTree, notes: list[str], force: bool) -> dict[str, Array]:
    """Return {link: ten parameters in its frame} of all links that change."""
    if not np.all(np.isfinite(robot.parameters)):
        raise RobotError(f"'{robot.name}' has no inertial parameters to write")
    changed: dict[str, Array] = {}
    for joint, body, lump in zip(
        robot.joint_names, robot.body_names, robot.parameters.reshape(-1, 10), strict=True
    ):
        carried = _carried(tree, joint, robot.joint_names)
        fixed = {link: tree.links[link] for link in carried if np.any(tree.links[link])}
        rest = lump - sum(
            (in_parent_frame(own, carried[link]) for link, own in fixed.items()), np.zeros(10)
        )
        if fixed and not is_physical(rest, THIN) and is_physical(lump, THIN):
            notes.append(
                f"link '{body}' has the inertia of all that is fixed to it "
                f"({', '.join(fixed)}): without theirs it would be no possible body"
            )
            rest, changed = lump, changed | dict.fromkeys(fixed, np.zeros(10))
        _check_possible(body, rest, force, notes)
        changed[body] = rest
    return changed


def _carried(tree: UrdfTree, joint: str, moving: tuple[str, ...]) -> dict[str, pin.SE3]:
    """Return {link: placement in the body's frame} of the links fixed to what a joint moves."""
    found: dict[str, pin.SE3] = {}
    stack = [(tree.joints[joint].child, pin.SE3.Identity())]
    while stack:
        link, placement = stack.pop()
        for below in tree.children(link):
            if below.name not in moving:
                found[below.child] = placement * below.placement
                stack.append((below.child, found[below.child]))
    return found


def _check_possible(body: str, parameters: Array, force: bool, notes: list[str]) -> None:
    problem = impossible_body(body, parameters)
    if problem is None:
        return
    if not force:
        raise RobotError(f"{problem}: identify with feasible=True, or write it with force=True")
    if parameters[0] == 0:
        raise RobotError(f"{problem}: a URDF cannot say an inertia without a mass")
    notes.append(problem)


def _inertial_edits(text: bytes, root: Element, link: str, parameters: Array) -> list[Edit]:
    """Return what writes ten parameters, in the link's frame, as a link's mass and inertia."""
    element = _named(root, "link", link)
    inertial = element.find("inertial")
    if not np.any(parameters):
        return [] if inertial is None else [without(text, inertial)]
    mass, center = parameters[0], parameters[1:4] / parameters[0]
    second = center @ center * np.eye(3) - np.outer(center, center)
    xx, xy, yy, xz, yz, zz = parameters[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * second
    places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    children = {
        "origin": {"xyz": _numbers(center), "rpy": "0 0 0"},
        "mass": {"value": _numbers([mass])},
        "inertia": {
            name: _numbers([inertia[at]]) for name, at in {**places, "izz": (2, 2)}.items()
        },
    }
    if inertial is None:
        return [with_content(text, element, [new_element("inertial", children)])]
    return with_children(text, inertial, children)


def _dynamics(text: bytes, root: Element, robot: Robot, joint: str) -> list[Edit]:
    """Return what writes damping and friction of a stiff drive as they are at its own joint."""
    drive = robot.drivetrains[joint]
    if not isinstance(drive, StiffDrive) or drive == IDEAL_DRIVE or _is_coupled(robot, joint):
        return []
    viscous, coulomb = (drive.values.get(f"{kind}_friction") for kind in ("viscous", "coulomb"))
    seen = {}
    if viscous is not None:
        seen["damping"] = _numbers([drive.ratio**2 * viscous])
    if coulomb is not None:
        seen["friction"] = _numbers([drive.ratio * coulomb])
    return with_children(text, _named(root, "joint", joint), {"dynamics": seen}) if seen else []


def _is_coupled(robot: Robot, joint: str) -> bool:
    turned = robot.transmission[robot.index(joint)]
    return bool(turned[robot.index(joint)] != 1 or np.count_nonzero(turned) != 1)


def _note_left_out(robot: Robot, path: Path, source: Path, root: Element, notes: list[str]) -> None:
    """Say what of the robot a URDF cannot have, and which files it names are no longer found."""
    if np.any(robot.payload_parameters):
        notes.append("the payload that was known is not in the file: give it with payloads=")
    for joint, drive in robot.drivetrains.items():
        if isinstance(drive, StiffDrive) and drive != IDEAL_DRIVE and _is_coupled(robot, joint):
            notes.append(
                f"joint '{joint}': its drive moves other joints, and <dynamics> cannot say its "
                "friction: the file of the drives does"
            )
    shapes = (one for one in root.all() if one.tag in ("mesh", "texture"))
    named = (one.attributes.get("filename", "") for one in shapes)
    beside = [name for name in named if name and "://" not in name and not Path(name).is_absolute()]
    if beside and path.resolve().parent != source.resolve().parent:
        more = len(set(beside)) - 1
        notes.append(
            f"'{beside[0]}'{f' and {more} other files' if more else ''} that it names are looked "
            f"for beside it: write it into '{source.resolve().parent}', or copy them"
        )


def _named(root: Element, tag: str, name: str) -> Element:
    found = root.find(tag, name)
    assert found is not None  # urdf_again has found it
    return found


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
