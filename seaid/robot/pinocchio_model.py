"""The Pinocchio model of a URDF tree, assembled joint by joint.

Links behind fixed and locked joints are merged. Every joint has one coordinate (nq = nv = n);
Pinocchio's own reader gives two to a continuous joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite, number, safely
from seaid._progress import Display
from seaid.errors import RobotError, listed, unknown_name
from seaid.robot.inertia import (
    LARGEST_KG,
    LARGEST_KG_M2,
    LARGEST_M,
    SMALLEST_KG,
    from_center_of_mass,
    in_parent_frame,
)

if TYPE_CHECKING:
    from seaid.robot.urdf import UrdfJoint, UrdfTree

BaseKind = Literal["fixed", "floating", "planar", "planar_xy", "planar_xz", "planar_yz"]
"""Whether something holds the base of a robot, or guides it in a plane: that of a planar joint at
the root of the file, or one of the axes of the base."""

TURNING = ("revolute", "continuous")
_MOVING = (*TURNING, "prismatic")


@dataclass(frozen=True, repr=False)
class Payload(Display):
    """A known body fixed to a link.

    Parameters
    ----------
    link : str
        Link of the URDF.
    mass : float
        Mass [kg], above zero.
    com : 3 floats, default (0, 0, 0)
        Centre of mass [m] in the link's frame.
    inertia : 3 x 3 floats, default zero (a point mass)
        Inertia [kg m^2] at the centre of mass.

    Raises
    ------
    RobotError
        For values that no body has.

    Examples
    --------
    >>> Payload("foot", mass=0.5, com=(0.05, 0.0, -0.02))
    """

    link: str
    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[tuple[float, float, float], ...] = ((0.0,) * 3,) * 3

    def __post_init__(self) -> None:
        where = f"of the payload on '{self.link}'"
        mass = number(f"mass {where}", self.mass, RobotError)
        if not finite(f"mass {where}", mass, (), RobotError) > 0:
            raise RobotError(
                f"payload on '{self.link}' must have a mass of more than zero, found {self.mass}"
            )
        com = finite(f"com {where}", self.com, (3,), RobotError)
        inertia = finite(f"inertia {where}", self.inertia, (3, 3), RobotError)
        _check_size(f"mass {where}", self.mass, LARGEST_KG, "kg", SMALLEST_KG)
        _check_size(f"com {where}", float(np.max(np.abs(com))), LARGEST_M, "m")
        _check_size(f"inertia {where}", float(np.max(np.abs(inertia))), LARGEST_KG_M2, "kg m^2")
        scale = float(np.max(np.abs(inertia)))
        least = safely(np.linalg.eigvalsh, inertia, what=f"inertia {where}", error=RobotError)[0]
        symmetric = np.allclose(inertia, inertia.T, rtol=0, atol=1e-9 * scale)
        if not symmetric or least < -1e-9 * scale:
            raise RobotError(
                f"inertia {where} must be a symmetric matrix without negative principal moments, "
                f"found {inertia.tolist()}"
            )

    @property
    def parameters(self) -> Array:
        """The ten inertial parameters in the link's frame."""
        return from_center_of_mass(self.mass, np.array(self.com), np.array(self.inertia))


def _check_size(what: str, value: float, most: float, unit: str, least: float = 0.0) -> None:
    if not least <= value <= most:
        raise RobotError(
            f"{what} is out of range, found {value:g}: allowed are {least:g} to {most:g} {unit}"
        )


@dataclass(frozen=True)
class DependentJoint:
    """A joint that its leader moves: its position is multiplier * leader's position + offset."""

    name: str
    leader: str
    multiplier: float
    offset: float
    is_prismatic: bool


def movable_joints(tree: UrdfTree) -> tuple[str, ...]:
    """Return the independent joints of a tree that are not fixed, in order."""
    all_of = (tree.joints[joint] for joint in _depth_first(tree))
    return tuple(joint.name for joint in all_of if joint.type != "fixed" and joint.mimic is None)


def moving_joints(tree: UrdfTree, joints: Sequence[str] | None) -> tuple[str, ...]:
    """Return the independent joints that move, in order: the given ones, or all of the tree."""
    names = list(movable_joints(tree)) if joints is None else _given_joints(tree, joints)
    for name in names:
        kind = tree.joints[name].type
        if kind not in _MOVING:
            movable = listed(x for x in movable_joints(tree) if tree.joints[x].type in _MOVING)
            base = f"; or that of the base with base='{kind}'" if _is_at_root(tree, name) else ""
            raise RobotError(
                f"URDF '{tree.path}': joint '{name}' is {kind}; seaid moves {', '.join(_MOVING)} "
                "joints of a robot with a fixed base: name those that move with joints=[...], "
                f"which locks '{name}' and all others at zero; there are {movable or 'none'}{base}",
                "joints=[...]",
                f"base='{kind}'",
            )
    if not names:
        raise RobotError(f"URDF '{tree.path}' has no joint that moves")
    return tuple(names)


def without_joint_of_base(tree: UrdfTree, kind: BaseKind) -> tuple[UrdfTree, UrdfJoint | None]:
    """Return the tree below a floating or planar joint at its root, and this joint or None.

    Raises RobotError for a `kind` of base that is not that of the joint.
    """
    below = tree.children(tree.root)
    if len(below) != 1 or not _is_at_root(tree, below[0].name):
        if kind == "planar":
            raise RobotError(
                "base='planar' takes the plane of a planar joint at the root of the file, and that "
                f"of '{tree.path}' has none: name the plane by axes of the base, such as "
                "base='planar_xz'",
                "base='planar'",
                "base='planar_xz'",
            )
        return tree, None
    if below[0].type != kind:
        raise RobotError(
            f"base='{kind}': the joint '{below[0].name}' at the root of '{tree.path}' is "
            f"{below[0].type}: load it with base='{below[0].type}'",
            f"base='{kind}'",
            f"base='{below[0].type}'",
        )
    joints = {name: joint for name, joint in tree.joints.items() if joint is not below[0]}
    return replace(tree, root=below[0].child, joints=joints), below[0]


def _is_at_root(tree: UrdfTree, name: str) -> bool:
    """Whether a joint is the floating or planar one of a base: the only one of an empty root."""
    below = [joint.name for joint in tree.children(tree.root)]
    moves = tree.joints[name].type in ("floating", "planar")
    return moves and below == [name] and not np.any(tree.links[tree.root])


def dependent_joints(tree: UrdfTree, moving: Sequence[str]) -> tuple[DependentJoint, ...]:
    """Return the mimic joints whose leaders move, in the order of the tree."""
    followers = []
    for name in _depth_first(tree):
        joint, mimic = tree.joints[name], tree.joints[name].mimic
        if mimic is None or joint.type == "fixed":
            continue
        where = f"URDF '{tree.path}': joint '{name}' mimics '{mimic.leader}'"
        if joint.type not in _MOVING:
            raise RobotError(f"{where} and is {joint.type}; allowed are {', '.join(_MOVING)}")
        if mimic.leader in moving and mimic.multiplier != 0:
            is_prismatic = joint.type == "prismatic"
            followers.append(DependentJoint(name, *mimic, is_prismatic))
        elif mimic.offset != 0:
            raise RobotError(
                f"{where}, which does not move it here, and would rest at {mimic.offset:g}: let "
                f"'{mimic.leader}' move with joints=[...], or load it with independent_mimics=True",
                "joints=[...]",
                "independent_mimics=True",
            )
    return tuple(followers)


def _given_joints(tree: UrdfTree, joints: Sequence[str]) -> list[str]:
    names = list(joints)
    for name in names:
        if name not in tree.joints:
            raise RobotError(
                f"joints=: '{tree.name}': " + unknown_name("joint", name, tree.joints), "joints="
            )
        mimic = tree.joints[name].mimic
        if mimic is not None:
            raise RobotError(
                f"joints=: '{tree.name}': joint '{name}' mimics '{mimic.leader}' and moves with "
                f"it: name '{mimic.leader}' only, or load it with independent_mimics=True",
                "joints=",
                "independent_mimics=True",
            )
    if len(set(names)) < len(names):
        raise RobotError(f"joints= names a joint twice: {names}", "joints=")
    return names


def _depth_first(tree: UrdfTree) -> list[str]:
    order: list[str] = []
    stack = list(reversed(tree.children(tree.root)))
    while stack:
        joint = stack.pop()
        order.append(joint.name)
        stack.extend(reversed(tree.children(joint.child)))
    return order


@dataclass(frozen=True, eq=False)
class Assembly:
    """Pinocchio's model (without inertias), and (N, 10) parameters of bodies and of payloads.

    The model has one coordinate for every joint, dependent ones too. `order` has the index of each
    of its joints among the n moving joints and the dependent ones, which follow them. `base` (2,
    10) are the parameters of what no joint moves and of the payloads on it; `frames` {link: joint
    of the model (0 for the base), placement in its body}, that of the base first. `path` is the
    file for messages, and `at_root` its joint by which the base moves, if it has one.
    """

    model: pin.Model
    order: tuple[int, ...]
    bodies: Array
    payloads: Array
    base: Array
    frames: Mapping[str, tuple[int, pin.SE3]]
    path: Path
    at_root: UrdfJoint | None = None

    def with_base_last(self, at_root: UrdfJoint | None) -> Assembly:
        """Return the assembly with the base, which a joint of the file moves, as its last body."""
        bodies, payloads = np.vstack([self.bodies, self.base[0]]), self.payloads
        payloads = np.vstack([payloads, self.base[1]])
        return replace(self, bodies=bodies, payloads=payloads, at_root=at_root)


def assemble(
    tree: UrdfTree,
    moving: tuple[str, ...],
    payloads: Sequence[Payload],
    gravity: Array,
    floats: bool = False,
) -> Assembly:
    """Assemble the model from the root outward, with one Pinocchio joint per joint in `moving`.

    Payloads on the base are refused unless it `floats`: nothing depends on them.
    """
    model = pin.Model()
    model.name = tree.name
    model.gravity.linear = np.array(gravity)
    order: list[int] = []
    bodies, loads = np.zeros((2, len(moving) + 1, 10))  # the last row is that of the base
    places = {name: place for place, name in enumerate(moving)}
    frames = {tree.root: (0, pin.SE3.Identity())}
    for name in _depth_first(tree):
        joint = tree.joints[name]
        parent, placement = frames[joint.parent]
        placement = placement * joint.placement
        if name in places:
            parent = _add_joint(model, parent, placement, joint)
            order.append(places[name])
            placement = pin.SE3.Identity()
        frames[joint.child] = (parent, placement)
        # Joint k of the model is that of order[k - 1]; what no joint moves belongs to the base.
        bodies[order[parent - 1] if parent else -1] += in_parent_frame(
            tree.links[joint.child], placement
        )
    for payload in payloads:
        if payload.link not in tree.links:
            unknown = unknown_name("link", payload.link, tree.links)
            raise RobotError(f"payloads=: {unknown}", "payloads=")
        parent, placement = frames[payload.link]
        if not parent and not floats:
            raise RobotError(f"payload on '{payload.link}': no joint moves this link")
        loads[order[parent - 1] if parent else -1] += in_parent_frame(payload.parameters, placement)
    bodies[-1] += tree.links[tree.root]
    _check_masses(tree, moving, bodies[:-1])
    base = np.array([bodies[-1], loads[-1]])
    return Assembly(model, tuple(order), bodies[:-1], loads[:-1], base, frames, tree.path)


def joints_of(model: pin.Model) -> tuple[dict[str, Any], ...]:
    """Return the joints of an assembled model as plain data, from which `model_of` makes it again.

    Inertias are not part of it: `Robot.with_values` sets them.
    """
    return tuple(
        {
            "name": model.names[place],
            "parent": model.parents[place],
            "placement": model.jointPlacements[place].homogeneous.copy(),
            "type": "prismatic" if "JointModelP" in joint.shortname() else "revolute",
            "axis": _axis(joint),
            # Joints of one coordinate: joint k has the coordinate k - 1.
            **{key: float(getattr(model, name)[place - 1]) for key, name in _LIMITS.items()},
        }
        for place, joint in enumerate(model.joints)
        if place
    )


_LIMITS = {
    "effort": "effortLimit",
    "velocity": "velocityLimit",
    "lower": "lowerPositionLimit",
    "upper": "upperPositionLimit",
}


def _axis(joint: Any) -> Array:
    """Return the axis (3,) of a joint: that of its name (RX, PY, ...), or its own."""
    aligned = joint.shortname().removeprefix("JointModel")[1:]
    if aligned in ("X", "Y", "Z"):
        return np.asarray(np.eye(3)["XYZ".index(aligned)])
    return np.asarray(joint.extract().axis, dtype=float)


def model_of(name: str, gravity: Array, joints: Sequence[Mapping[str, Any]]) -> pin.Model:
    """Return a model without inertias from its joints; see `joints_of`."""
    model = pin.Model()
    model.name = name
    model.gravity.linear = np.array(gravity)
    _add_joints(model, joints)
    return model


def with_free_joint(name: str, joints: Sequence[Mapping[str, Any]]) -> pin.Model:
    """Return a model of joints, see `joints_of`, on a free joint, without inertias and gravity."""
    model = pin.Model()
    model.name = name
    # Gravity is in the specific force of the base, which is the acceleration of the model.
    model.gravity.linear = np.zeros(3)
    taken = {joint["name"] for joint in joints}
    free = "base" if "base" not in taken else "floating base of seaid"
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), free)
    _add_joints(model, joints, below=1)
    return model


def _add_joints(model: pin.Model, joints: Sequence[Mapping[str, Any]], below: int = 0) -> None:
    for joint in joints:
        attributes = {key: joint[key] for key in ("name", "type", "axis", *_LIMITS)}
        placement = pin.SE3(np.array(joint["placement"]))
        _add_joint(model, joint["parent"] + below, placement, _Joint(**attributes))


@dataclass(frozen=True)
class _Joint:
    """What a joint of a URDF and one of a saved model have in common."""

    name: str
    type: str
    axis: Array
    effort: float
    velocity: float
    lower: float
    upper: float


def _add_joint(model: pin.Model, parent: int, placement: pin.SE3, joint: UrdfJoint | _Joint) -> int:
    prismatic = joint.type == "prismatic"
    aligned = (
        (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
        if prismatic
        else (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
    )
    along = np.flatnonzero(joint.axis == 1.0)
    if along.size:
        joint_model = aligned[along[0]]()
    elif prismatic:
        joint_model = pin.JointModelPrismaticUnaligned(joint.axis)
    else:
        joint_model = pin.JointModelRevoluteUnaligned(joint.axis)
    return int(
        model.addJoint(
            parent,
            joint_model,
            placement,
            joint.name,
            np.array([joint.effort]),
            np.array([joint.velocity]),
            np.array([joint.lower]),
            np.array([joint.upper]),
        )
    )


def _check_masses(tree: UrdfTree, moving: Sequence[str], bodies: Array) -> None:
    for name, parameters in zip(moving, bodies, strict=True):
        if parameters[0] == 0.0 and np.any(parameters):
            raise RobotError(
                f"URDF '{tree.path}': link '{tree.joints[name].child}' (moved by '{name}') has "
                "inertia but zero mass; give it a mass of more than zero"
            )
