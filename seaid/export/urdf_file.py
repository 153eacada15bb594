"""The user's own URDF with the identified bodies in it; everything else stays as it was."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.drivetrain.model import IDEAL_DRIVE, StiffDrive
from seaid.errors import RobotError, SeaidWarning, unknown_name
from seaid.export.drive_tables import write_drivetrains
from seaid.files import whole_file
from seaid.identification import Identification
from seaid.inertia import in_parent_frame, is_physical, pseudo_inertia
from seaid.robot import Robot
from seaid.urdf import UrdfTree, read_urdf

_SNAP = 2e-3

_ROUNDING = 1e-9
"""Relative: a pseudo-inertia less negative than this is one of a body without thickness."""


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
    and friction, seen at the joint), change; comments, meshes and unknown tags stay. Links that are
    fixed to a moving one keep their inertia, and the moving link gets the rest of what was
    identified together; where that rest is no possible body, it gets all and they get none (a
    note says so). The payload is not in the file. `source`: the URDF to take (default: the file
    that the robot was loaded from). Drives that are not ideal go to `<path>.toml`.

    Raises RobotError for bodies that cannot exist (unless `force`) or are not known, and for a
    source without the robot's links; SeaidError where a file cannot be written.
    """
    robot = found.robot if isinstance(found, Identification) else found
    path = Path(path)
    source = robot.urdf if source is None else Path(source)
    if source is None:
        raise RobotError(f"'{robot.name}' was not loaded from a file: name its URDF with source=")
    document = _document(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)  # rounded angles were told when it was loaded
        tree = read_urdf(source, _SNAP)
    _check_links(source, tree, robot)
    notes: list[str] = []
    for link, parameters in _bodies(robot, tree, notes, force).items():
        _set_inertial(document, link, parameters)
    for joint, drive in robot.drivetrains.items():
        if isinstance(drive, StiffDrive) and drive != IDEAL_DRIVE:
            _set_dynamics(document, joint, drive)
    with whole_file(path) as temporary:
        document.write(str(temporary), encoding="utf-8", xml_declaration=True)
    if np.any(robot.payload_parameters):
        notes.append("the payload that was known is not in the file: give it with payloads=")
    return WrittenUrdf(path, _write_drives(robot, path), tuple(notes))


def _document(source: Path) -> Any:
    from lxml import etree

    try:
        return etree.parse(str(source), etree.XMLParser(remove_comments=False))
    except (etree.XMLSyntaxError, OSError) as problem:
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
        if fixed and not is_physical(rest, _ROUNDING) and is_physical(lump, _ROUNDING):
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
    if is_physical(parameters, _ROUNDING):
        return
    least = float(np.linalg.eigvalsh(pseudo_inertia(parameters))[0])
    problem = (
        f"link '{body}' would be no possible body (mass {parameters[0]:.4g} kg, least eigenvalue "
        f"of its pseudo-inertia {least:.2g})"
    )
    if not force:
        raise RobotError(f"{problem}: identify with feasible=True, or write it with force=True")
    if parameters[0] == 0:
        raise RobotError(f"{problem}: a URDF cannot say an inertia without a mass")
    notes.append(problem)


def _set_inertial(document: Any, link: str, parameters: Array) -> None:
    """Write ten parameters, in the link's frame, as mass, centre of mass and inertia there."""
    element = next(e for e in document.getroot().iter("link") if e.get("name") == link)
    inertial = element.find("inertial")
    if not np.any(parameters):
        if inertial is not None:
            element.remove(inertial)
        return
    if inertial is None:
        inertial = element.makeelement("inertial")
        inertial.tail = element.text
        element.insert(0, inertial)
    mass, center = parameters[0], parameters[1:4] / parameters[0]
    second = center @ center * np.eye(3) - np.outer(center, center)
    xx, xy, yy, xz, yz, zz = parameters[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * second
    origin = _child(inertial, "origin")
    origin.set("xyz", _text(center))
    origin.set("rpy", "0 0 0")
    _child(inertial, "mass").set("value", _text([mass]))
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    for name, place in {**names, "izz": (2, 2)}.items():
        _child(inertial, "inertia").set(name, _text([inertia[place]]))


def _set_dynamics(document: Any, joint: str, drive: StiffDrive) -> None:
    """Write damping and friction of a stiff drive as they are at the joint."""
    element = next(e for e in document.getroot().findall("joint") if e.get("name") == joint)
    viscous, coulomb = drive.viscous_friction_Nms_per_rad, drive.coulomb_friction_Nm
    if viscous is not None:
        _child(element, "dynamics").set("damping", _text([drive.ratio**2 * viscous]))
    if coulomb is not None:
        _child(element, "dynamics").set("friction", _text([drive.ratio * coulomb]))


def _write_drives(robot: Robot, path: Path) -> Path | None:
    if all(drive == IDEAL_DRIVE for drive in robot.drivetrains.values()):
        return None
    beside = path.with_suffix(".toml")
    write_drivetrains(robot.drivetrains, beside)
    return beside


def _child(parent: Any, tag: str) -> Any:
    """Return the first child of a tag, made at the end where there is none."""
    found = parent.find(tag)
    if found is None:
        found = parent.makeelement(tag)
        found.tail = parent.text if len(parent) == 0 else parent[-1].tail
        parent.append(found)
    return found


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
