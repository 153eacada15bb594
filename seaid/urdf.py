"""A URDF file as a plain tree of joints and link inertias, with its rounded angles made exact.

yourdfpy reads and checks the file; nothing of it leaves this module. Meshes are never opened.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.errors import RobotError, SeaidWarning, reason_of, shortened
from seaid.files import working_folder
from seaid.inertia import from_center_of_mass, in_parent_frame
from seaid.rounded_angles import FLOAT_NOISE_RAD, snap
from seaid.urdf_checks import check_elements
from seaid.urdf_xml import LARGEST_BYTES, parse_urdf

SNAP_RAD = 2e-3
"""How far an angle may be from the multiple of pi/2 that it means, if nothing else is asked."""


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
        return self._below.get(link, [])

    @cached_property
    def _below(self) -> dict[str, list[UrdfJoint]]:
        below: dict[str, list[UrdfJoint]] = {}
        for joint in sorted(self.joints.values(), key=lambda joint: joint.name):
            below.setdefault(joint.parent, []).append(joint)
        return below


def urdf_again(path: str | Path, text: bytes | None = None) -> UrdfTree:
    """Read the URDF of a robot that was loaded before, not warning of rounded angles again.

    `text` is its content where it has been read already.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeaidWarning)
        return _urdf_of(Path(path), urdf_text(Path(path)) if text is None else text, SNAP_RAD)


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
    return _urdf_of(path, urdf_text(path), snap_tolerance_rad)


def urdf_text(path: Path) -> bytes:
    """Return the bytes of a URDF file. Raises RobotError where it is missing or too large."""
    missing = f"no URDF file at '{shortened(str(path), 500)}' ({working_folder()})"
    try:
        if not path.is_file():
            raise RobotError(missing)
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise RobotError(
                f"URDF '{path}' is too large: {size:,} bytes, allowed are {LARGEST_BYTES:,}"
            )
        return path.read_bytes()
    except OSError as problem:
        raise RobotError(f"{missing}: {reason_of(problem)}") from None


def _urdf_of(path: Path, text: bytes, snap_tolerance_rad: float) -> UrdfTree:
    """Return the tree of a URDF's text; `path` names it. See `read_urdf`."""
    root = parse_urdf(path, text)
    check_elements(path, root)
    joints_as_written = root.findall("joint")
    snapped = [text for joint in joints_as_written for text in snap(joint, snap_tolerance_rad)]
    if snapped:
        shown = ", ".join(dict.fromkeys(snapped))
        warnings.warn(
            f"'{path.name}': {len(snapped)} rounded angles in joint origins taken as the multiples "
            f"of pi/2 they mean ({shown}); snap_tolerance_rad=0 leaves them as written",
            SeaidWarning,
            stacklevel=4,
        )
    robot = _parse_robot(path, root)
    links = {link.name: _link_parameters(path, link) for link in robot.links}
    noise = FLOAT_NOISE_RAD if snap_tolerance_rad > 0 else 0.0
    joints = {joint.name: _joint(path, joint, noise) for joint in robot.joints}
    return UrdfTree(
        robot.name or path.stem, _root_link(path, links, joints.values()), joints, links
    )


def _parse_robot(path: Path, root: Any) -> Any:
    """Let yourdfpy read the XML and report what it finds missing."""
    import logging

    from lxml import etree
    from yourdfpy import URDF

    logging.getLogger("yourdfpy.urdf").setLevel(logging.ERROR)
    if not root.get("name"):
        root.set("name", "".join(one if one.isprintable() else "?" for one in path.stem))
    try:
        urdf = URDF.load(BytesIO(etree.tostring(root)), build_scene_graph=False, load_meshes=False)
    except Exception as problem:  # yourdfpy lets whatever its parsing raises through
        raise RobotError(
            f"URDF '{path}' cannot be read: {type(problem).__name__}: {problem}"
        ) from None
    return urdf.robot


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
    if joint.type == "fixed":
        return np.array([1.0, 0.0, 0.0])
    largest = float(np.max(np.abs(axis)))
    if largest == 0.0:
        raise RobotError(f"URDF '{path}': joint '{joint.name}' has no axis, found {axis.tolist()}")
    axis = axis / largest  # before the norm, whose squares may overflow
    axis = axis / np.linalg.norm(axis)
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
        found = shortened(roots, 500) if roots else "none"
        raise RobotError(f"URDF '{path}' is not one tree: links without parent: {found}")
    _check_reachable(path, roots[0], links, parents)
    return roots[0]


def _check_reachable(
    path: Path, root: str, links: Iterable[str], parents: Mapping[str, str]
) -> None:
    reached = {root}
    for link in links:
        way: dict[str, None] = {}
        while link not in reached:
            if link in way:
                raise RobotError(f"URDF '{path}' is not a tree: loop through link '{link}'")
            way[link] = None
            link = parents[link]
        reached.update(way)
