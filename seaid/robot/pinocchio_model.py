"""The Pinocchio model of a URDF tree, assembled joint by joint.

Links behind fixed and locked joints are merged. Every joint has one coordinate (nq = nv = n);
Pinocchio's own reader gives two to a continuous joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin

from seaid._arrays import Array
from seaid.errors import RobotError, check_name, listed
from seaid.robot.inertia import Payload, in_parent_frame, to_pinocchio

if TYPE_CHECKING:
    from seaid.robot.urdf import UrdfJoint, UrdfTree

BaseKind = Literal["fixed", "floating", "planar", "planar_xy", "planar_xz", "planar_yz"]
"""Whether something holds the base of a robot, or guides it in a plane: that of a planar joint at
the root of the file, or one of the axes of the base."""

TURNING = ("revolute", "continuous")
_MOVING = (*TURNING, "prismatic")


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
    names = movable_joints(tree) if joints is None else tuple(dict.fromkeys(joints))
    for name in names:
        check_independent(tree, name, f"joints=: '{tree.name}'", "joints=")
        kind = tree.joints[name].type
        if kind not in _MOVING:
            movable = listed(x for x in movable_joints(tree) if tree.joints[x].type in _MOVING)
            still = "fixed, or locked by locked=" if kind == "fixed" else kind
            at_base = tree.joints[name] is _joint_of_base(tree)
            base = f"; or that of the base with base='{kind}'" if at_base else ""
            raise RobotError(
                f"URDF '{tree.path}': joint '{name}' is {still}; seaid moves {', '.join(_MOVING)} "
                "joints of a robot with a fixed base: name those that move with joints=[...], "
                f"which locks '{name}' and all others at zero; there are {movable or 'none'}{base}",
                "joints=[...]",
                "locked=",
                f"base='{kind}'",
            )
    if not names:
        raise RobotError(f"URDF '{tree.path}' has no joint that moves")
    return names


def without_joint_of_base(tree: UrdfTree, kind: BaseKind) -> UrdfTree:
    """Return the tree below a floating or planar joint at its root, which is then its `at_root`.

    Raises RobotError for a `kind` of base that is not that of the joint.
    """
    at_root = _joint_of_base(tree)
    if at_root is None and kind == "planar":
        raise RobotError(
            "base='planar' takes the plane of a planar joint at the root of the file, and that of "
            f"'{tree.path}' has none: name the plane by axes of the base, as base='planar_xz'",
            "base='planar'",
            "base='planar_xz'",
        )
    if at_root is None:
        return tree
    if at_root.type != kind:
        raise RobotError(
            f"base='{kind}': the joint '{at_root.name}' at the root of '{tree.path}' is "
            f"{at_root.type}: load it with base='{at_root.type}'",
            f"base='{kind}'",
            f"base='{at_root.type}'",
        )
    joints = {name: joint for name, joint in tree.joints.items() if joint is not at_root}
    return replace(tree, root=at_root.child, joints=joints, at_root=at_root)


def _joint_of_base(tree: UrdfTree) -> UrdfJoint | None:
    """Return the floating or planar joint of a base, the only one of an empty root, if any."""
    match tree.children(tree.root):
        case [joint] if joint.type in ("floating", "planar") and not np.any(tree.links[tree.root]):
            return joint
    return None


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


def check_independent(tree: UrdfTree, joint: str, where: str, *arguments: str) -> None:
    """Raise RobotError for a joint that is not in the file or that another joint moves."""
    check_name("joint", joint, tree.joints, RobotError, where, *arguments)
    mimic = tree.joints[joint].mimic
    if mimic is not None:
        raise RobotError(
            f"{where}: joint '{joint}' mimics '{mimic.leader}', whose drive moves both: name "
            f"'{mimic.leader}' only, or load the robot with independent_mimics=True",
            *arguments,
            "independent_mimics=True",
        )


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
    """The model (without inertias) of a tree, and the parameters (N, 10) of bodies and payloads.

    The model has one coordinate for every joint, dependent ones too. `order` has the index of each
    of its joints among the n moving joints and the dependent ones, which follow them. A base that
    moves is the last body: what no joint moves, and the payloads on it. `frames` {link: joint of
    the model (0 for the base), placement in its body} has that of the base first.
    """

    tree: UrdfTree
    model: pin.Model
    order: tuple[int, ...]
    bodies: Array
    payloads: Array
    frames: Mapping[str, tuple[int, pin.SE3]]


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
    model, order = _empty_model(tree.name, gravity), list[int]()
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
        if payload.link in tree.joints.keys() - tree.links.keys():
            raise RobotError(f"payloads=: '{payload.link}' is a joint: name a link", "payloads=")
        check_name("link", payload.link, tree.links, RobotError, "payloads=", "payloads=")
        parent, placement = frames[payload.link]
        if not parent and not floats:
            raise RobotError(f"payloads=: no joint moves '{payload.link}'", "payloads=")
        loads[order[parent - 1] if parent else -1] += in_parent_frame(payload.parameters, placement)
    bodies[-1] += tree.links[tree.root]
    _check_masses(tree, moving, bodies[:-1])
    count = len(moving) + floats
    return Assembly(tree, model, tuple(order), bodies[:count], loads[:count], frames)


@dataclass(frozen=True)
class ModelJoint:
    """A joint of an assembled model as plain data: what a model without inertias is made of.

    Attributes
    ----------
    parent : int
        The joint of the model before it, 0 for the base.
    placement : array (4, 4)
    axis : array (3,)
    """

    name: str
    parent: int
    placement: Array
    type: Literal["prismatic", "revolute"]
    axis: Array
    effort: float
    velocity: float
    lower: float
    upper: float


def joints_of(model: pin.Model) -> tuple[ModelJoint, ...]:
    """Return the joints of an assembled model, from which `model_of` makes it again."""
    joints = []
    for place, joint in enumerate(model.joints):
        if not place:
            continue
        # The velocity of the joint is this (6,), linear and angular, times that of its coordinate.
        linear, angular = np.split(joint.createData().S.ravel(), 2)
        made = ModelJoint(
            name=model.names[place],
            parent=model.parents[place],
            placement=model.jointPlacements[place].homogeneous.copy(),
            type="prismatic" if np.any(linear) else "revolute",
            axis=linear + angular,
            # Joints of one coordinate: joint k has the coordinate k - 1.
            effort=float(model.effortLimit[place - 1]),
            velocity=float(model.velocityLimit[place - 1]),
            lower=float(model.lowerPositionLimit[place - 1]),
            upper=float(model.upperPositionLimit[place - 1]),
        )
        joints.append(made)
    return tuple(joints)


def model_of(name: str, gravity: Array, joints: Sequence[ModelJoint]) -> pin.Model:
    """Return a model without inertias; `Robot.with_values` sets them."""
    model = _empty_model(name, gravity)
    for joint in joints:
        _add_joint(model, joint.parent, pin.SE3(joint.placement), joint)
    return model


def floating_model(held: pin.Model, base: Array) -> pin.Model:
    """Return the model of the joints on a free joint with the parameters (10,), without gravity."""
    free = pin.Model()
    name = "floating base of seaid" if "base" in held.names else "base"
    joint = free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
    free.inertias[joint] = to_pinocchio(base)
    model = pin.appendModel(free, held, free.addJointFrame(joint), pin.SE3.Identity())
    model.name = held.name
    # Gravity is in the specific force of the base, which is the acceleration of the model.
    model.gravity.linear = np.zeros(3)
    return model


def _empty_model(name: str, gravity: Array) -> pin.Model:
    model = pin.Model()
    model.name = name
    model.gravity.linear = np.array(gravity)
    return model


def _add_joint(
    model: pin.Model, parent: int, placement: pin.SE3, joint: UrdfJoint | ModelJoint
) -> int:
    prismatic = joint.type == "prismatic"
    along = np.flatnonzero(joint.axis == 1.0)
    if along.size:
        joint_model = getattr(pin, f"JointModel{'P' if prismatic else 'R'}{'XYZ'[along[0]]}")()
    elif prismatic:
        joint_model = pin.JointModelPrismaticUnaligned(joint.axis)
    else:
        joint_model = pin.JointModelRevoluteUnaligned(joint.axis)
    limits = (joint.effort, joint.velocity, joint.lower, joint.upper)
    arrays = (np.array([limit]) for limit in limits)
    return int(model.addJoint(parent, joint_model, placement, joint.name, *arrays))


def _check_masses(tree: UrdfTree, moving: Sequence[str], bodies: Array) -> None:
    for name, parameters in zip(moving, bodies, strict=True):
        if parameters[0] == 0.0 and np.any(parameters):
            raise RobotError(
                f"URDF '{tree.path}': link '{tree.joints[name].child}' (moved by '{name}') has "
                "inertia but zero mass; give it a mass of more than zero"
            )
