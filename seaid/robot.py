"""Robot and load_robot: a URDF, its drivetrains and known payloads as one frozen piece of data."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, frozen
from seaid.drivetrain.model import (
    IDEAL_DRIVE,
    Drive,
    SeriesElasticDrive,
    StiffDrive,
    drives_from_mapping,
    read_drivetrains,
)
from seaid.errors import RobotError, SeaidWarning, unknown_name
from seaid.inertia import (
    from_center_of_mass,
    in_parent_frame,
    parameter_names,
    to_pinocchio,
)
from seaid.urdf import UrdfJoint, UrdfTree, read_urdf

_TURNING = ("revolute", "continuous")
_MOVING = (*_TURNING, "prismatic")


@dataclass(frozen=True)
class Payload:
    """A known body fixed to a link: mass [kg], centre of mass [m] in the link's frame, and its
    inertia at that centre [kg m^2] (a point mass where left out).
    """

    link: str
    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[tuple[float, float, float], ...] = ((0.0,) * 3,) * 3

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mass) and self.mass > 0):
            raise RobotError(
                f"payload on '{self.link}' must have a mass of more than zero, found {self.mass}"
            )
        frozen(f"com of the payload on '{self.link}'", self.com, (3,), RobotError)
        frozen(f"inertia of the payload on '{self.link}'", self.inertia, (3, 3), RobotError)

    @property
    def parameters(self) -> Array:
        """The ten inertial parameters in the link's frame."""
        return from_center_of_mass(self.mass, np.array(self.com), np.array(self.inertia))


@dataclass(frozen=True, eq=False)
class Robot:
    """A fixed-base tree of n one-axis joints with their drives.

    All arrays of seaid have the joints in the order of `joint_names`; body i is what joint i moves,
    named after its link, with what is fixed to it lumped in. `model` is Pinocchio's (nq = nv = n)
    with the payloads; its joint k is joint `model_order[k]` here, which differs only where the
    order asked for is not the tree's. `parameters` (10n,) are the standard parameters of the bodies
    without payload, `payload_parameters` (10n,) those of the payloads alone. `limits` are rows of
    lower and upper position, velocity and effort, in rad or m.
    """

    name: str
    joint_names: tuple[str, ...]
    body_names: tuple[str, ...]
    is_prismatic: tuple[bool, ...]
    model: pin.Model
    model_order: tuple[int, ...]
    drivetrains: Mapping[str, Drive]
    parameters: Array
    payload_parameters: Array
    lower_limits: Array
    upper_limits: Array
    velocity_limits: Array
    effort_limits: Array

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the 10n standard parameters, as 'Iyy_thigh'."""
        return parameter_names(self.body_names)

    @property
    def elastic_joints(self) -> tuple[str, ...]:
        """The joints that have a spring."""
        return tuple(
            joint
            for joint in self.joint_names
            if isinstance(self.drivetrains[joint], SeriesElasticDrive)
        )

    def index(self, joint: str) -> int:
        """Return the column of a joint. Raises RobotError with the nearest name."""
        if joint not in self.joint_names:
            raise RobotError(f"{self.name}: " + unknown_name("joint", joint, self.joint_names))
        return self.joint_names.index(joint)

    def with_values(self, parameters: Array, drivetrains: Mapping[str, Drive]) -> Robot:
        """Return the same robot with other standard parameters (10n,) and drives."""
        parameters = frozen("parameters", parameters, (10 * self.n,), RobotError)
        model = self.model.copy()
        loaded = (parameters + self.payload_parameters).reshape(self.n, 10)
        for position, index in enumerate(self.model_order):
            model.inertias[position + 1] = to_pinocchio(loaded[index])
        drives = MappingProxyType({joint: drivetrains[joint] for joint in self.joint_names})
        return replace(self, model=model, parameters=parameters, drivetrains=drives)

    def without_nominal(self) -> Robot:
        """Return what is known before an identification: geometry, ratios, rotor inertias, payload.

        The standard parameters are NaN, and the drives have no stiffness and no friction, so no
        result computed from this robot can lean on them.
        """
        known = {joint: drive.without_nominal() for joint, drive in self.drivetrains.items()}
        return self.with_values(np.full(10 * self.n, np.nan), known)


def load_robot(
    urdf: str | Path,
    drivetrains: str | Path | Mapping[str, Any] | None = None,
    *,
    joints: Sequence[str] | None = None,
    payloads: Sequence[Payload] = (),
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    snap_tolerance_rad: float = 2e-3,
) -> Robot:
    """Load a URDF with its base fixed.

    `drivetrains`: TOML path, {joint: drive or table}, or None; a joint not named has an ideal stiff
    drive (its torque is known at the joint). `joints`: those that move, in this order; the rest is
    locked at zero; None = all, in Pinocchio's order. `payloads` are known and not identified.
    `gravity` [m/s^2] in the base frame. `snap_tolerance_rad`: see `seaid.urdf.read_urdf`.

    Revolute, continuous and prismatic joints of any axis can move; fixed ones are merged; mimic
    joints stay independent, with a warning. Raises RobotError for everything else.
    """
    tree = read_urdf(urdf, snap_tolerance_rad)
    moving = _moving_joints(tree, joints)
    mimics = [joint for joint in moving if tree.joints[joint].is_mimic]
    if mimics:
        warnings.warn(
            f"'{tree.name}': mimic joints are taken as independent: {', '.join(mimics)}",
            SeaidWarning,
            stacklevel=2,
        )
    return _build(
        tree,
        moving,
        _drives(tree, moving, drivetrains),
        payloads,
        frozen("gravity", gravity, (3,), RobotError),
    )


def _moving_joints(tree: UrdfTree, joints: Sequence[str] | None) -> tuple[str, ...]:
    if joints is None:
        names = [joint for joint in _depth_first(tree) if tree.joints[joint].type != "fixed"]
    else:
        names = list(joints)
        for name in names:
            if name not in tree.joints:
                raise RobotError(f"'{tree.name}': " + unknown_name("joint", name, tree.joints))
        if len(set(names)) < len(names):
            raise RobotError(f"joints= names a joint twice: {names}")
    for name in names:
        kind = tree.joints[name].type
        if kind not in _MOVING:
            raise RobotError(
                f"'{tree.name}': joint '{name}' is {kind}; seaid moves {', '.join(_MOVING)} joints "
                "of a robot with a fixed base: leave it out with joints=[...] (locked at zero)"
            )
    if not names:
        raise RobotError(f"'{tree.name}' has no joint that moves")
    return tuple(names)


def _depth_first(tree: UrdfTree) -> list[str]:
    order: list[str] = []
    stack = list(reversed(tree.children(tree.root)))
    while stack:
        joint = stack.pop()
        order.append(joint.name)
        stack.extend(reversed(tree.children(joint.child)))
    return order


def _drives(
    tree: UrdfTree, moving: Sequence[str], drivetrains: str | Path | Mapping[str, Any] | None
) -> dict[str, Drive]:
    if drivetrains is None:
        given: dict[str, Drive] = {}
    elif isinstance(drivetrains, str | Path):
        given = read_drivetrains(drivetrains)
    else:
        given = drives_from_mapping(drivetrains)
    for name in given:
        if name not in tree.joints:
            raise RobotError(
                f"drivetrains for '{tree.name}': " + unknown_name("joint", name, tree.joints)
            )
    for name in moving:
        _check_kind(tree.joints[name], given.get(name, IDEAL_DRIVE))
    return {name: given.get(name, IDEAL_DRIVE) for name in moving}


def _check_kind(joint: UrdfJoint, drive: Drive) -> None:
    """Refuse a drive for turning joints at a prismatic one and the reverse."""
    turning = joint.type in _TURNING
    if drive is IDEAL_DRIVE:
        return
    if isinstance(drive, StiffDrive):
        wrong, right = ("gear_ratio_rad_per_m", "gear_ratio")
        wrong, right = (wrong, right) if turning else (right, wrong)
        if getattr(drive, wrong) is not None:
            raise RobotError(
                f"joint '{joint.name}' is {joint.type}: its stiff drive has {right}, found {wrong}"
            )
    elif turning and drive.is_linear_spring and drive.load_pulley_radius_m is None:
        raise RobotError(
            f"joint '{joint.name}' turns: its linear spring needs load_pulley_radius_m "
            "(or no radii for a rotary spring)"
        )
    elif not turning and (not drive.is_linear_spring or drive.load_pulley_radius_m is not None):
        raise RobotError(
            f"joint '{joint.name}' is prismatic: its elastic drive has motor_pulley_radius_m and "
            "no load_pulley_radius_m"
        )


def _build(
    tree: UrdfTree,
    moving: tuple[str, ...],
    drives: dict[str, Drive],
    payloads: Sequence[Payload],
    gravity: Array,
) -> Robot:
    """Walk the tree from its root, adding a Pinocchio joint for each that moves."""
    model = pin.Model()
    model.name = tree.name
    model.gravity.linear = np.array(gravity)
    order: list[int] = []
    bodies = {joint: tree.joints[joint].child for joint in moving}
    own, loads = np.zeros((len(moving), 10)), np.zeros((len(moving), 10))
    frames = {tree.root: (0, pin.SE3.Identity())}
    for payload in payloads:
        if payload.link not in tree.links:
            raise RobotError("payload: " + unknown_name("link", payload.link, tree.links))
    for name in _depth_first(tree):
        joint = tree.joints[name]
        parent, placement = frames[joint.parent]
        placement = placement * joint.placement
        if name in bodies:
            parent = _add_joint(model, parent, placement, joint)
            order.append(moving.index(name))
            placement = pin.SE3.Identity()
        frames[joint.child] = (parent, placement)
        if parent:
            own[order[parent - 1]] += in_parent_frame(tree.links[joint.child], placement)
    for payload in payloads:
        parent, placement = frames[payload.link]
        if not parent:
            raise RobotError(f"payload on '{payload.link}': no joint moves this link")
        loads[order[parent - 1]] += in_parent_frame(payload.parameters, placement)
    _check_masses(tree, moving, own)
    limits = [tree.joints[name] for name in moving]
    robot = Robot(
        name=tree.name,
        joint_names=moving,
        body_names=tuple(bodies.values()),
        is_prismatic=tuple(joint.type == "prismatic" for joint in limits),
        model=model,
        model_order=tuple(order),
        drivetrains=MappingProxyType(drives),
        parameters=own.ravel(),
        payload_parameters=frozen("payload", loads.ravel(), (10 * len(moving),)),
        lower_limits=frozen("limits", [joint.lower for joint in limits], (None,)),
        upper_limits=frozen("limits", [joint.upper for joint in limits], (None,)),
        velocity_limits=frozen("limits", [joint.velocity for joint in limits], (None,)),
        effort_limits=frozen("limits", [joint.effort for joint in limits], (None,)),
    )
    return robot.with_values(own.ravel(), drives)


def _add_joint(model: pin.Model, parent: int, placement: pin.SE3, joint: UrdfJoint) -> int:
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


def _check_masses(tree: UrdfTree, moving: Sequence[str], own: Array) -> None:
    for name, parameters in zip(moving, own, strict=True):
        if parameters[0] == 0.0 and np.any(parameters):
            raise RobotError(
                f"'{tree.name}': link '{tree.joints[name].child}' (moved by '{name}') has inertia "
                "but zero mass; give it a mass of more than zero"
            )
