"""A URDF file as a plain tree of joints and link inertias, with its rounded angles made exact.

yourdfpy reads and checks the file; nothing of it leaves this module. Meshes are never opened.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.errors import RobotError, SeaidWarning, unknown_name
from seaid.inertia import from_center_of_mass, in_parent_frame

_FLOAT_NOISE_RAD = 1e-6
"""Closer than this to a multiple of pi/2 (or to zero) is float noise of an exporter."""


_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "velocity", "effort"), 1),
}
"""How many numbers each attribute has, of the elements that count for the dynamics."""
_NEEDED = {"mass": ("value",), "inertia": ("ixx", "iyy", "izz")}


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """One joint as in the file: type, links, placement in the parent link, unit axis, limits."""

    name: str
    type: str
    parent: str
    child: str
    placement: pin.SE3
    axis: Array
    lower: float
    upper: float
    velocity: float
    effort: float
    is_mimic: bool


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """A URDF: its name, joints by name, and the ten inertial parameters a link (in its frame)."""

    name: str
    root: str
    joints: dict[str, UrdfJoint]
    links: dict[str, Array]

    def children(self, link: str) -> list[UrdfJoint]:
        """Return the joints below a link, sorted by name (the order of Pinocchio's own reader)."""
        below = [joint for joint in self.joints.values() if joint.parent == link]
        return sorted(below, key=lambda joint: joint.name)


def read_urdf(path: str | Path, snap_tolerance_rad: float) -> UrdfTree:
    """Read a URDF file; angles within the tolerance of the multiple of pi/2 they mean are snapped.

    An angle means a multiple of pi/2 if it is one to the digits that the file writes (1.57, 1.5708,
    3.14159), or to float noise (1e-6 rad). One warning lists them; tolerance 0 leaves all as they
    are. Raises RobotError for a file that is missing, broken or not a tree.
    """
    path = Path(path)
    if not 0 <= snap_tolerance_rad < math.pi / 4:
        raise RobotError(
            f"snap_tolerance_rad must be between 0 and pi/4, found {snap_tolerance_rad}"
        )
    root = _parse_xml(path)
    _check_elements(path, root)
    snapped = [text for joint in root.iter("joint") for text in _snap(joint, snap_tolerance_rad)]
    if snapped:
        shown = ", ".join(dict.fromkeys(snapped))
        warnings.warn(
            f"'{path.name}': {len(snapped)} rounded angles in joint origins taken as the multiples "
            f"of pi/2 they mean ({shown}); snap_tolerance_rad=0 leaves them as written",
            SeaidWarning,
            stacklevel=3,
        )
    robot = _parse_robot(path, root)
    links = {link.name: _link_parameters(path, link) for link in robot.links}
    noise = _FLOAT_NOISE_RAD if snap_tolerance_rad > 0 else 0.0
    joints = {joint.name: _joint(path, joint, noise) for joint in robot.joints}
    return UrdfTree(
        robot.name or path.stem, _root_link(path, links, joints.values()), joints, links
    )


def _parse_xml(path: Path) -> Any:
    from lxml import etree

    if not path.is_file():
        raise RobotError(f"no URDF file at '{path}' (working folder {Path.cwd()})")
    try:
        root = etree.parse(str(path), etree.XMLParser(remove_comments=True)).getroot()
    except (etree.XMLSyntaxError, OSError) as problem:
        raise RobotError(f"URDF '{path}' is not well-formed XML: {problem}") from None
    if root.tag != "robot":
        raise RobotError(f"'{path}' is not a URDF: its root tag is <{root.tag}>, not <robot>")
    return root


def _check_elements(path: Path, root: Any) -> None:
    """Refuse what yourdfpy would trip over or fill in: names, types, ends, numbers."""
    for tag in ("link", "joint"):
        names = [element.get("name") for element in root.findall(tag)]
        if not all(names):
            raise RobotError(f"URDF '{path}': a <{tag}> has no name")
        repeated = {name for name in names if names.count(name) > 1}
        if repeated:
            raise RobotError(f"URDF '{path}': {tag} name used twice: {', '.join(sorted(repeated))}")
    for joint in root.findall("joint"):
        where = f"URDF '{path}': joint '{joint.get('name')}'"
        if joint.get("type") not in _TYPES:
            kind = joint.get("type") or ""
            raise RobotError(f"{where}: " + unknown_name("joint type", kind, _TYPES))
        for tag in ("parent", "child"):
            end = joint.find(tag)
            if end is None or not end.get("link"):
                raise RobotError(f'{where} has no <{tag} link="...">')
        _check_numbers(where, joint)
        _check_limit(where, joint.find("limit"))
    for link in root.findall("link"):
        for inertial in link.findall("inertial"):
            _check_numbers(f"URDF '{path}': link '{link.get('name')}'", inertial)


def _check_numbers(where: str, parent: Any) -> None:
    for element in parent:
        for name, count in _NUMBERS.get(element.tag, {}).items():
            text = element.get(name)
            if text is None:
                if name in _NEEDED.get(element.tag, ()):
                    raise RobotError(f"{where}: <{element.tag}> has no {name}")
                continue
            try:
                found = [float(word) for word in text.split()]
            except ValueError:
                found = []
            endless = element.tag == "limit" and not any(map(math.isnan, found))
            if len(found) != count or not (endless or all(map(math.isfinite, found))):
                raise RobotError(
                    f"{where}: {name} of <{element.tag}> must be {count} finite number"
                    f"{'s' if count > 1 else ''}, found '{text}'"
                )


def _check_limit(where: str, limit: Any) -> None:
    if limit is None:
        return
    lower, upper = (float(limit.get(name, 0.0)) for name in ("lower", "upper"))
    if lower > upper:
        raise RobotError(f"{where}: its lower limit {lower} is above its upper limit {upper}")
    for name in ("velocity", "effort"):
        if float(limit.get(name, 0.0)) < 0:
            raise RobotError(f"{where}: its {name} limit is negative, {limit.get(name)}")


def _parse_robot(path: Path, root: Any) -> Any:
    """Let yourdfpy read the XML and report what it finds missing."""
    import logging

    from lxml import etree
    from yourdfpy import URDF

    logging.getLogger("yourdfpy.urdf").setLevel(logging.ERROR)
    if not root.get("name"):
        root.set("name", path.stem)
    try:
        urdf = URDF.load(BytesIO(etree.tostring(root)), build_scene_graph=False, load_meshes=False)
    except Exception as problem:  # yourdfpy lets whatever its parsing raises through
        raise RobotError(
            f"URDF '{path}' cannot be read: {type(problem).__name__}: {problem}"
        ) from None
    return urdf.robot


def _snap(joint: Any, tolerance: float) -> list[str]:
    """Write the exact multiples of pi/2 into a joint's rpy; return what was rounded before."""
    origin = joint.find("origin")
    if origin is None or not origin.get("rpy") or tolerance <= 0:
        return []
    snapped, angles = [], []
    for text in origin.get("rpy").split():
        exact = _meant_angle(text, tolerance)
        if exact is not None:
            snapped.append(text)
        angles.append(text if exact is None else repr(exact))
    origin.set("rpy", " ".join(angles))
    return snapped


def _meant_angle(text: str, tolerance: float) -> float | None:
    """Return the multiple of pi/2 that a rounded angle means, None if it means itself."""
    try:
        value, exponent = float(text), Decimal(text).as_tuple().exponent
    except (ValueError, InvalidOperation):
        return None  # yourdfpy names the bad number
    if not math.isfinite(value):
        return None
    exact = round(value / (math.pi / 2)) * (math.pi / 2)
    last_digit = 10.0 ** int(exponent) if exact else 0.0
    allowed = min(tolerance, max(_FLOAT_NOISE_RAD, 2 * last_digit))
    return exact if 4e-16 * max(1.0, abs(exact)) < abs(value - exact) <= allowed else None


def _joint(path: Path, joint: Any, noise: float) -> UrdfJoint:
    limit = joint.limit
    turns_freely = joint.type == "continuous" or limit is None

    def limit_or(name: str, default: float) -> float:
        value = None if limit is None else getattr(limit, name)
        return default if value is None else float(value)

    return UrdfJoint(
        name=joint.name,
        type=joint.type,
        parent=joint.parent,
        child=joint.child,
        placement=_placement(joint.origin),
        axis=_axis(path, joint, noise),
        lower=-math.inf if turns_freely else limit_or("lower", 0.0),
        upper=math.inf if turns_freely else limit_or("upper", 0.0),
        velocity=limit_or("velocity", math.inf),
        effort=limit_or("effort", math.inf),
        is_mimic=joint.mimic is not None,
    )


def _placement(origin: Any) -> pin.SE3:
    """Return the joint's placement; entries within float noise of 0 and +-1 made exact."""
    if origin is None:
        return pin.SE3.Identity()
    rotation = np.array(origin[:3, :3])
    nearest = np.round(rotation)
    exact = np.abs(rotation - nearest) < 1e-15
    rotation[exact] = nearest[exact]
    return pin.SE3(rotation, np.array(origin[:3, 3]))


def _axis(path: Path, joint: Any, noise: float) -> Array:
    axis = np.array([1.0, 0.0, 0.0] if joint.axis is None else joint.axis, dtype=float)
    length = float(np.linalg.norm(axis))
    if joint.type == "fixed":
        return np.array([1.0, 0.0, 0.0])
    if not np.isfinite(length) or length == 0.0:
        raise RobotError(f"URDF '{path}': joint '{joint.name}' has no axis, found {axis.tolist()}")
    axis = axis / length
    axis[np.abs(axis) < noise] = 0.0
    return np.array(axis / np.linalg.norm(axis))


def _link_parameters(path: Path, link: Any) -> Array:
    inertial = link.inertial
    if inertial is None:
        return np.zeros(10)
    mass = 0.0 if inertial.mass is None else float(inertial.mass)
    tensor = np.zeros((3, 3)) if inertial.inertia is None else np.array(inertial.inertia, float)
    if mass < 0:
        raise RobotError(f"URDF '{path}': link '{link.name}' has a negative mass, {mass} kg")
    return in_parent_frame(
        from_center_of_mass(mass, np.zeros(3), tensor),
        _placement(inertial.origin),
    )


def _root_link(path: Path, links: dict[str, Array], joints: Iterable[UrdfJoint]) -> str:
    parents: dict[str, str] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise RobotError(
                    f"URDF '{path}': joint '{joint.name}' names link '{link}', which is not there"
                )
        if joint.child in parents:
            raise RobotError(f"URDF '{path}': link '{joint.child}' has two parent joints")
        parents[joint.child] = joint.parent
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        raise RobotError(f"URDF '{path}' is not one tree: links without parent: {roots or 'none'}")
    _check_reachable(path, roots[0], links, parents)
    return roots[0]


def _check_reachable(path: Path, root: str, links: Iterable[str], parents: dict[str, str]) -> None:
    for link in links:
        seen, current = {link}, link
        while current != root:
            current = parents[current]
            if current in seen:
                raise RobotError(f"URDF '{path}' is not a tree: loop through link '{link}'")
            seen.add(current)
