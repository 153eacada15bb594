"""A URDF file as a tree of joints and link inertias, checked, with rounded angles made exact.

`urdf_tree` parses the XML with limits on its size, checks the elements that matter for the
dynamics (names, types, links, numbers), snaps angles such as 1.5708 to the multiples of pi/2 that
they mean. yourdfpy reads the shapes when they are asked for. `find_mesh` locates mesh files; none
is opened here.
"""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite
from seaid._files import real_path
from seaid.errors import RobotError, SeaidWarning, check_name, listed, shortened
from seaid.robot.inertia import LARGEST, SMALLEST_KG, from_center_of_mass, in_parent_frame

_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
_SINGLE = ("revolute", "continuous", "prismatic")


class _Numbers(NamedTuple):
    """Unit of the numbers in an attribute where their size has a limit, and their count."""

    unit: str = ""
    many: int = 1


_NUMBERS: Mapping[str, Mapping[str, _Numbers]] = {
    "origin": {"xyz": _Numbers("m", 3), "rpy": _Numbers("rad", 3)},
    "axis": {"xyz": _Numbers(many=3)},
    "mass": {"value": _Numbers("kg")},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), _Numbers("kg m^2")),
    "limit": dict.fromkeys(("lower", "upper", "velocity", "effort"), _Numbers()),
    "mimic": dict.fromkeys(("multiplier", "offset"), _Numbers("rad or m")),
}
"""Attributes of the elements that matter for the dynamics."""
_NEEDED = {"mass": ("value",), "inertia": ("ixx", "iyy", "izz")}
_ONCE = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": (
        *("origin", "parent", "child", "axis", "limit"),
        *("dynamics", "mimic", "calibration", "safety_controller"),
    ),
}
"""{element: children of which it has at most one}; readers would silently pick one of several."""


def _check_elements(path: Path, root: Any) -> None:
    """Raise RobotError for bad names, types, links and numbers, which yourdfpy may accept."""
    joints, links = root.findall("joint"), root.findall("link")
    _check_names(path, "link", links)
    _check_names(path, "joint", joints)
    for joint in joints:
        where = f"URDF '{path}': joint '{joint.get('name')}'"
        check_name("joint type", joint.get("type", ""), _TYPES, RobotError, where)
        _check_once(where, joint)
        for tag in ("parent", "child"):
            end = joint.find(tag)
            if end is None or not end.get("link"):
                raise RobotError(f'{where} has no <{tag} link="...">')
        _check_numbers(where, joint)
        _check_limit(where, joint.find("limit"))
    for link in links:
        where = f"URDF '{path}': link '{link.get('name')}'"
        _check_once(where, link)
        for inertial in link.findall("inertial"):
            _check_once(where, inertial)
            _check_numbers(where, inertial)


def _check_names(path: Path, tag: str, elements: list[Any]) -> None:
    names = Counter(element.get("name") for element in elements)
    if not all(names):
        raise RobotError(f"URDF '{path}': a <{tag}> has no name")
    repeated = [name for name, count in names.items() if count > 1]
    if repeated:
        raise RobotError(
            f"URDF '{path}': {tag} name used twice: {shortened(', '.join(sorted(repeated)))}"
        )


def _check_once(where: str, parent: Any) -> None:
    """Refuse repeated elements, see `_ONCE`."""
    counts = Counter(element.tag for element in parent)
    for tag in _ONCE[parent.tag]:
        if counts[tag] > 1:
            raise RobotError(f"{where} has {counts[tag]} elements <{tag}>: keep one of them")


def _check_numbers(where: str, parent: Any) -> None:
    for element in parent:
        for name, wanted in _NUMBERS.get(element.tag, {}).items():
            text = element.get(name)
            if text is not None:
                _check_number(where, element.tag, name, text, wanted)
            elif name in _NEEDED.get(element.tag, ()):
                raise RobotError(f"{where}: <{element.tag}> has no {name}")


def _check_number(where: str, tag: str, name: str, text: str, wanted: _Numbers) -> None:
    try:
        values = numbers_of(text)
    except ValueError:
        values = []
    most = math.inf if tag == "limit" else sys.float_info.max
    if len(values) != wanted.many or not np.all(np.abs(values) <= most):
        raise RobotError(
            f"{where}: {name} of <{tag}> must be {wanted.many} finite number"
            f"{'s' if wanted.many > 1 else ''}, found '{shortened(text)}'"
        )
    largest = LARGEST.get(wanted.unit, math.inf)
    if max(map(abs, values)) > largest:
        raise RobotError(
            f"{where}: {name} of <{tag}> is out of range, found '{shortened(text)}': allowed are "
            f"-{largest:g} to {largest:g} {wanted.unit}"
        )


def numbers_of(text: str) -> list[float]:
    """Return the numbers in an attribute; raise ValueError for what other readers refuse.

    Python's float() takes 1_0 and digits of other scripts, and split() their spaces.
    """
    if "_" in text or not text.isascii():
        raise ValueError(text)
    return [float(word) for word in text.split()]


def _check_limit(where: str, limit: Any) -> None:
    if limit is None:
        return
    lower, upper = (float(limit.get(name, 0.0)) for name in ("lower", "upper"))
    if lower > upper:
        raise RobotError(f"{where}: its lower limit {lower} is above its upper limit {upper}")
    for name in ("velocity", "effort"):
        if float(limit.get(name, 0.0)) < 0:
            raise RobotError(f"{where}: its {name} limit is negative, {shortened(limit.get(name))}")


FLOAT_NOISE_RAD = 1e-6
"""An angle closer than this to a multiple of pi/2 (or to zero) has an exporter's float noise."""


def _snap(joint: Any, tolerance: float) -> list[str]:
    """Write exact multiples of pi/2 into a joint's rpy; return the rounded texts they replace."""
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


AXIS_RAD = 1e-4
"""An axis closer than this to a coordinate axis is that axis, written with four digits."""


def _snap_axis(joint: Any, tolerance: float) -> list[str]:
    """Write the exact coordinate axis into a joint; return the rounded text that it replaces."""
    element = joint.find("axis")
    if element is None or joint.get("type") == "fixed":
        return []
    text = element.get("xyz", "1 0 0")
    sizes = np.abs(numbers_of(text))
    along = int(np.argmax(sizes))
    tilt = float(np.max(np.delete(sizes, along))) / max(float(sizes[along]), 1e-300)
    if not FLOAT_NOISE_RAD <= tilt <= min(tolerance, AXIS_RAD):
        return []
    exact = ["0", "0", "0"]
    exact[along] = "1" if numbers_of(text)[along] > 0 else "-1"
    element.set("xyz", " ".join(exact))
    return [text]


def _meant_angle(text: str, tolerance: float) -> float | None:
    """Return the multiple of pi/2 that a rounded angle means, None for any other angle."""
    value, exponent = float(text), Decimal(text).as_tuple().exponent
    exact = round(value / (math.pi / 2)) * (math.pi / 2)
    last_digit = 10.0 ** int(exponent) if exact else 0.0
    allowed = min(tolerance, max(FLOAT_NOISE_RAD, 2 * last_digit))
    # An angle that is exact already up to rounding is not reported as snapped.
    return exact if 4e-16 * max(1.0, abs(exact)) < abs(value - exact) <= allowed else None


MOST = {"joint": 5_000, "link": 5_001}
"""Limits on the joints and the links of a robot.

Pinocchio stores for each joint all joints before and behind it: 5,000 in a row take 1 GB.
"""


def _parse_urdf(path: Path, text: bytes) -> Any:
    """Return the <robot> element of a URDF's text, without comments; `path` is for messages.

    Raises RobotError for malformed XML, another root, and more joints or links than allowed.
    """
    from lxml import etree

    try:
        root = etree.fromstring(text, etree.XMLParser(remove_comments=True, remove_pis=True))
    except etree.XMLSyntaxError as problem:
        remedy = "; write version 1.0" if "Unsupported version" in str(problem.msg) else ""
        raise RobotError(f"URDF '{path}' is not well-formed XML: {problem.msg}{remedy}") from None
    if root.tag != "robot":
        tag = f"{root.prefix}:{etree.QName(root).localname}" if root.prefix else root.tag
        raise RobotError(f"'{path}' is not a URDF: its root tag is <{tag}>, not <robot>")
    for kind, most in MOST.items():
        if len(root.findall(kind)) > most:
            raise RobotError(f"URDF '{path}' has more than the {most:,} {kind}s that are allowed")
    return root


def search_folders(urdf: Path, package_dirs: str | Path | Sequence[str | Path]) -> list[Path]:
    """Return the folders to search for meshes: the given ones, all above the file, and ROS's."""
    several = [package_dirs] if isinstance(package_dirs, str | Path) else package_dirs
    folders = [real_path(folder) for folder in several]
    for folder in folders:
        if not os.path.isdir(folder):
            raise RobotError(f"package_dirs: there is no folder '{folder}'")
    ros = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    ros += [f"{root}/share" for root in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
    return [*folders, *real_path(urdf).parents, *(Path(x) for x in ros if os.path.isabs(x))]


def find_mesh(name: str, folders: Sequence[Path]) -> Path | None:
    """Return the file of a mesh by its name in a URDF (package://, file:// or plain), or None."""
    candidates = (path for path in _candidates(name, folders) if os.path.isfile(path))
    return next(candidates, None)


def _candidates(name: str, folders: Sequence[Path]) -> Iterator[Path]:
    """Yield the possible paths of a mesh; a folder may contain the package or be it."""
    scheme, _, rest = name.rpartition("://")
    if scheme == "file":
        yield Path(rest)
        return
    rest = rest.lstrip("/") if scheme else rest
    package, _, inside = rest.partition("/")
    for folder in folders:
        yield folder / rest
        if scheme and folder.name == package:
            yield folder / inside


EARTH = (0.0, 0.0, -9.81)
"""Default of `gravity` [m/s^2]: that of the earth, against the z-axis of the world."""

SNAP_RAD = 2e-3
"""Default of `snap_tolerance_rad`: 1.57 is 8e-4 away from pi/2, 3.14 is 1.6e-3 away from pi."""


class Mimic(NamedTuple):
    """The position of a joint that another moves: multiplier * position of the leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """One joint of the file: type, links, placement in the parent link, unit axis, limits.

    `mimic` names a leader that mimics no other joint.
    """

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
    mimic: Mimic | None


def displacement(kind: str, axis: Array, position: float) -> pin.SE3:
    """Return what a joint of one axis displaces its child link by at a position [rad or m]."""
    if kind == "prismatic":
        return pin.SE3(np.eye(3), position * axis)
    return pin.SE3(pin.exp3(position * axis), np.zeros(3))


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """A URDF: its name, joints by name, and ten inertial parameters per link (in its frame).

    `xml` is the file with exact angles, and `path` its name for messages. `at_root` is the joint
    of the file by which the base moves, if it has one.
    """

    name: str
    root: str
    joints: dict[str, UrdfJoint]
    links: dict[str, Array]
    path: Path
    xml: bytes = field(repr=False)
    at_root: UrdfJoint | None = None

    @cached_property
    def elements(self) -> Any:
        """The <robot> as yourdfpy reads it, with its shapes. Raises RobotError for broken ones."""
        import logging

        from yourdfpy import URDF

        logging.getLogger("yourdfpy.urdf").setLevel(logging.ERROR)
        try:
            urdf = URDF.load(BytesIO(self.xml), build_scene_graph=False, load_meshes=False)
        except Exception as problem:  # yourdfpy lets whatever its parsing raises through
            raise RobotError(
                f"URDF '{self.path}' cannot be read: {type(problem).__name__}: {problem}"
            ) from None
        return urdf.robot

    def children(self, link: str) -> list[UrdfJoint]:
        """Return the joints below a link, sorted by name (the order of Pinocchio's own reader)."""
        return self._child_joints.get(link, [])

    def locked_at(self, positions: Mapping[str, float]) -> UrdfTree:
        """Return the tree with joints fixed at positions [rad or m], and those that mimic them.

        Raises RobotError for an unknown joint, one that cannot move, and for what is no position.
        """
        joints, where = dict(self.joints), f"locked=: '{self.name}'"
        for name in positions:
            check_name("joint", name, joints, RobotError, where, "locked=")
            mimic = joints[name].mimic
            if joints[name].type not in _SINGLE or mimic is not None:
                kind = joints[name].type if mimic is None else f"moved by '{mimic.leader}'"
                raise RobotError(
                    f"{where}: joint '{name}' is {kind}; name revolute, continuous or prismatic "
                    "joints",
                    "locked=",
                )
        for name, position in self.still(positions).items():
            joint = joints[name]
            at = float(finite(f"locked=: position of '{name}'", position, (), RobotError))
            placement = joint.placement * displacement(joint.type, joint.axis, at)
            joints[name] = replace(joint, type="fixed", placement=placement, mimic=None)
        return replace(self, joints=joints) if positions else self

    def still(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Return the positions of locked joints, and of those that mimic them."""
        mimics = {name: x.mimic for name, x in self.joints.items() if x.mimic is not None}
        return dict(positions) | {
            name: mimic.multiplier * positions[mimic.leader] + mimic.offset
            for name, mimic in mimics.items()
            if mimic.leader in positions
        }

    @cached_property
    def _child_joints(self) -> dict[str, list[UrdfJoint]]:
        below: dict[str, list[UrdfJoint]] = {}
        for joint in sorted(self.joints.values(), key=lambda joint: joint.name):
            below.setdefault(joint.parent, []).append(joint)
        return below


def urdf_tree(path: Path, text: bytes, snap_tolerance_rad: float) -> UrdfTree:
    """Return the tree of a URDF's text; see `read_urdf`. `path` is for messages."""
    from lxml import etree

    root = _parse_urdf(path, text)
    _check_elements(path, root)
    joints_as_written = root.findall("joint")
    _snap_joints(path, joints_as_written, snap_tolerance_rad)
    links = {str(link.get("name")): _link_parameters(path, link) for link in root.iterfind("link")}
    _warn_of_negative_moments(path, root)
    noise = FLOAT_NOISE_RAD if snap_tolerance_rad > 0 else 0.0
    joints = {joint.get("name"): _joint(path, joint, noise) for joint in joints_as_written}
    base = _root_link(path, links, joints.values())
    _add_mimics(path, joints, joints_as_written)
    if not root.get("name"):
        root.set("name", "".join(char if char.isprintable() else "?" for char in path.stem))
    return UrdfTree(root.get("name"), base, joints, links, path, etree.tostring(root))


def warn_of(path: Path, text: str) -> None:
    """Warn the caller of `load_robot` of something in a file."""
    warnings.warn(f"'{path.name}': {text}", SeaidWarning, stacklevel=8)


def _snap_joints(path: Path, joints: Iterable[Any], tolerance_rad: float) -> None:
    """Make rounded angles and axes of joints what they mean, with a warning for each kind."""
    for snap, what in (
        (_snap, "angles in joint origins taken as the multiples of pi/2"),
        (_snap_axis, "axes of joints taken as the coordinate axes"),
    ):
        snapped = [text for joint in joints for text in snap(joint, tolerance_rad)]
        if snapped:
            shown = ", ".join(dict.fromkeys(snapped))
            warn_of(
                path,
                f"{len(snapped)} rounded {what} they mean ({shown}); "
                "snap_tolerance_rad=0 leaves them as written",
            )


def _warn_of_negative_moments(path: Path, root: Any) -> None:
    """Warn of links with negative moments of inertia, which a file of forced bodies may have."""
    negative = [
        str(link.get("name"))
        for link in root.iterfind("link")
        for inertia in link.iterfind("inertial/inertia")
        if min(float(inertia.get(moment, 0.0)) for moment in ("ixx", "iyy", "izz")) < 0
    ]
    if negative:
        warn_of(
            path,
            f"no body has the negative moments of inertia of {listed(negative)}: correct ixx, iyy "
            "and izz of <inertia>, or identify with feasible=True",
        )


def _add_mimics(path: Path, joints: dict[str, UrdfJoint], elements: Iterable[Any]) -> None:
    """Give each joint what it mimics by its <mimic>, or a warning if that is not there."""
    mimics = {}
    for element in elements:
        for mimic in element.iterfind("mimic"):
            factor, offset = float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
            mimics[element.get("name")] = Mimic(mimic.get("joint"), factor, offset)
    lost = [name for name, mimic in mimics.items() if mimic.leader not in joints]
    if lost:
        leaders = listed(mimics[name].leader for name in lost)
        warn_of(
            path,
            f"<mimic> of {listed(lost)} names joints that are not there ({leaders}): taken as "
            "independent",
        )
    mimics = {name: mimic for name, mimic in mimics.items() if name not in lost}
    for name in mimics:
        joints[name] = replace(joints[name], mimic=_followed(path, name, mimics))


def _followed(path: Path, name: str, mimics: Mapping[str, Mimic]) -> Mimic:
    """Return what a joint mimics in the end, through other mimic joints."""
    leader, multiplier, offset, passed = name, 1.0, 0.0, list[str]()
    while leader in mimics:
        if leader in passed:
            raise RobotError(
                f"URDF '{path}': mimic joints follow each other: {listed(passed)}: remove the "
                "<mimic> of one"
            )
        passed.append(leader)
        mimic = mimics[leader]
        # q = m q1 + c and q1 = m1 q2 + c1 give q = (m m1) q2 + (m c1 + c)
        offset += multiplier * mimic.offset
        multiplier *= mimic.multiplier
        leader = mimic.leader
    return Mimic(leader, multiplier, offset)


def _joint(path: Path, joint: Any, noise: float) -> UrdfJoint:
    limit = joint.find("limit")
    limits = {} if limit is None else limit.attrib
    turns_freely = joint.get("type") == "continuous" or limit is None
    return UrdfJoint(
        name=joint.get("name"),
        type=joint.get("type"),
        parent=joint.find("parent").get("link"),
        child=joint.find("child").get("link"),
        placement=_placement(joint.find("origin")),
        axis=_axis(path, joint, noise),
        lower=-math.inf if turns_freely else float(limits.get("lower", 0.0)),
        upper=math.inf if turns_freely else float(limits.get("upper", 0.0)),
        velocity=float(limits.get("velocity", math.inf)),
        effort=float(limits.get("effort", math.inf)),
        mimic=None,
    )


def _placement(origin: Any) -> pin.SE3:
    """Return a joint's placement, with rotation entries within float noise of 0 and +-1 exact."""
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array(numbers_of(origin.get(name, "0 0 0"))) for name in ("xyz", "rpy"))
    rotation = pin.rpy.rpyToMatrix(rpy)
    nearest = np.round(rotation)
    exact = np.abs(rotation - nearest) < 1e-15
    rotation[exact] = nearest[exact]
    return pin.SE3(rotation, xyz)


def _axis(path: Path, joint: Any, noise: float) -> Array:
    element = joint.find("axis")
    axis = np.array([1.0, 0, 0] if element is None else numbers_of(element.get("xyz", "1 0 0")))
    if joint.get("type") == "fixed":
        return np.array([1.0, 0.0, 0.0])
    largest = float(np.max(np.abs(axis)))
    if largest == 0.0:
        raise RobotError(
            f"URDF '{path}': joint '{joint.get('name')}' has no axis, found {axis.tolist()}"
        )
    axis = axis / largest  # before the norm, whose squares may overflow
    axis = axis / np.linalg.norm(axis)
    axis[np.abs(axis) < noise] = 0.0
    return np.array(axis / np.linalg.norm(axis))


def _link_parameters(path: Path, link: Any) -> Array:
    inertial = link.find("inertial")
    if inertial is None:
        return np.zeros(10)
    mass, moments = inertial.find("mass"), inertial.find("inertia")
    kg = 0.0 if mass is None else float(mass.get("value"))
    kg = kg if abs(kg) >= SMALLEST_KG else 0.0
    tensor = np.zeros((3, 3))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    for name, row, column in zip(names, *np.triu_indices(3), strict=True):
        value = 0.0 if moments is None else float(moments.get(name, 0.0))
        tensor[row, column] = tensor[column, row] = value
    if kg < 0:
        raise RobotError(f"URDF '{path}': link '{link.get('name')}' has a negative mass, {kg} kg")
    return in_parent_frame(
        from_center_of_mass(kg, np.zeros(3), tensor), _placement(inertial.find("origin"))
    )


def _root_link(path: Path, links: dict[str, Array], joints: Iterable[UrdfJoint]) -> str:
    parents: dict[str, str] = {}
    if not links:
        raise RobotError(f"URDF '{path}' has no links: it needs one for the base and each body")
    for joint in joints:
        for link in (joint.parent, joint.child):
            check_name("link", link, links, RobotError, f"URDF '{path}': joint '{joint.name}'")
        if joint.child in parents:
            raise RobotError(
                f"URDF '{path}': link '{joint.child}' has two parent joints, and a URDF is a tree: "
                "keep one of them, which opens a closed chain"
            )
        parents[joint.child] = joint.parent
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise RobotError(
            f"URDF '{path}' is not one tree: links without parent: {shortened(roots, 500)}; join "
            "all but one to another link, by a joint of type fixed if it does not move"
        )
    _check_loops(path, parents)
    return roots[0]


def _check_loops(path: Path, parents: Mapping[str, str]) -> None:
    try:
        TopologicalSorter({link: [parent] for link, parent in parents.items()}).prepare()
    except CycleError as problem:
        loop = listed(problem.args[1][1:])
        raise RobotError(
            f"URDF '{path}' is not a tree: loop through links {loop}: remove a joint of it"
        ) from None
