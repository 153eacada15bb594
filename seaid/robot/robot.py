"""Robot and load_robot: a URDF, its drives and known payloads as one frozen piece of data."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, BoolArray, FrozenMapping, finite, frozen
from seaid.drives import (
    IDEAL_DRIVE,
    Drive,
    SeriesElasticDrive,
    StiffDrive,
    drives_from_mapping,
    read_drives,
)
from seaid.errors import RobotError, SeaidWarning, unknown_name
from seaid.robot.inertia import parameter_names, to_pinocchio
from seaid.robot.pinocchio_model import TURNING, Assembly, Payload, assemble, moving_joints
from seaid.robot.transmission import check_transmission, transmission_matrix
from seaid.robot.urdf import SNAP_RAD, UrdfTree, read_urdf

__all__ = ["Payload", "Robot", "load_robot"]


@dataclass(frozen=True, eq=False)
class Robot:
    """A fixed-base tree of n one-axis joints with their drives.

    All arrays of seaid have the joints in the order of `joint_names`; body i is what joint i moves,
    named after its link, with what is fixed to it lumped in. `model` is Pinocchio's (nq = nv = n)
    with the payloads; its joint k is joint `model_order[k]` here, which differs only where the
    order asked for is not the tree's. `parameters` (10n,) are the standard parameters of the bodies
    without payload, `payload_parameters` (10n,) those of the payloads alone. `limits` are rows of
    lower and upper position, velocity and effort, in rad or m. `urdf` is the file it came from.
    `known_bodies` names those whose parameters are known and not identified.
    """

    name: str
    joint_names: tuple[str, ...]
    body_names: tuple[str, ...]
    is_prismatic: tuple[bool, ...]
    model: pin.Model
    model_order: tuple[int, ...]
    drives: Mapping[str, Drive]
    parameters: Array
    payload_parameters: Array
    lower_limits: Array
    upper_limits: Array
    velocity_limits: Array
    effort_limits: Array
    urdf: Path | None = None
    known_bodies: tuple[str, ...] = ()

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the 10n standard parameters, as 'Iyy_thigh'."""
        return parameter_names(self.body_names)

    @property
    def is_known(self) -> BoolArray:
        """Tells which of the standard parameters (10n,) are those of known bodies."""
        return np.repeat([body in self.known_bodies for body in self.body_names], 10)

    @property
    def known_parameters(self) -> Array:
        """What is known beforehand of the standard parameters (10n,): payloads, known bodies."""
        return self.payload_parameters + np.where(self.is_known, self.parameters, 0.0)

    @property
    def elastic_joints(self) -> tuple[str, ...]:
        """The joints that have a spring."""
        return tuple(
            joint
            for joint in self.joint_names
            if isinstance(self.drives[joint], SeriesElasticDrive)
        )

    @property
    def transmission(self) -> Array:
        """C (n, n) of phi = C q, what the drives turn; the identity where each has its joint.

        Rows are drives, by the joint in whose table they stand; see `seaid.robot.transmission`.
        """
        return transmission_matrix(self.joint_names, self.drives)

    def index(self, joint: str) -> int:
        """Return the column of a joint. Raises RobotError with the nearest name."""
        if joint not in self.joint_names:
            raise RobotError(f"{self.name}: " + unknown_name("joint", joint, self.joint_names))
        return self.joint_names.index(joint)

    def rows(self, names: str | Sequence[str] | None) -> tuple[str, ...]:
        """Return the joints that `torque_joints=` means, each once: all for None, one for a plain
        name.

        Raises RobotError with the nearest name for one that is not there.
        """
        chosen = (
            self.joint_names if names is None else (names,) if isinstance(names, str) else names
        )
        for name in chosen:
            self.index(name)
        return tuple(dict.fromkeys(chosen))

    def with_values(self, parameters: Array, drives: Mapping[str, Drive]) -> Robot:
        """Return the same robot with other standard parameters (10n,) and drives."""
        parameters = frozen("parameters", parameters, (10 * self.n,), RobotError)
        model = self.model.copy()
        loaded = (parameters + self.payload_parameters).reshape(self.n, 10)
        for position, index in enumerate(self.model_order):
            model.inertias[position + 1] = to_pinocchio(loaded[index])
        given = FrozenMapping({joint: drives[joint] for joint in self.joint_names})
        return replace(self, model=model, parameters=parameters, drives=given)

    def with_drives(self, drives: Mapping[str, Drive]) -> Robot:
        """Return the same robot with other drives at some joints. Raises RobotError for others."""
        for joint in drives:
            self.index(joint)
        return self.with_values(self.parameters, {**self.drives, **drives})

    def without_nominal(self) -> Robot:
        """Return what is known before an identification: geometry, ratios, rotor inertias, payload.

        The standard parameters are NaN but for known bodies, and the drives have no stiffness and
        no friction, so no result computed from this robot can lean on them.
        """
        known = {joint: drive.without_nominal() for joint, drive in self.drives.items()}
        return self.with_values(np.where(self.is_known, self.parameters, np.nan), known)


def load_robot(
    urdf: str | Path,
    drives: str | Path | Mapping[str, Any] | None = None,
    *,
    joints: Sequence[str] | None = None,
    payloads: Sequence[Payload] = (),
    known_bodies: Sequence[str] = (),
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    snap_tolerance_rad: float = SNAP_RAD,
) -> Robot:
    """Load a URDF with its base fixed.

    `drives`: TOML path, {joint: drive or table}, or None; a joint not named has an ideal stiff
    drive (its torque is known at the joint). `joints`: those that move, in this order; the rest is
    locked at zero; None = all, in Pinocchio's order. `payloads` are known and not identified; so
    are the bodies of the links that `known_bodies` names, with what is fixed to them, as they are
    in the URDF.
    `gravity` [m/s^2] in the base frame. `snap_tolerance_rad`: see `seaid.robot.urdf.read_urdf`.

    Revolute, continuous and prismatic joints of any axis can move; fixed ones are merged; mimic
    joints stay independent, with a warning. Raises RobotError for everything else.
    """
    tree = read_urdf(urdf, snap_tolerance_rad)
    moving = moving_joints(tree, joints)
    mimics = [joint for joint in moving if tree.joints[joint].is_mimic]
    if mimics:
        warnings.warn(
            f"'{tree.name}': mimic joints are taken as independent: {', '.join(mimics)}",
            SeaidWarning,
            stacklevel=2,
        )
    by_joint = _drives(tree, moving, drives)
    built = assemble(tree, moving, payloads, finite("gravity", gravity, (3,), RobotError))
    robot = replace(_robot(tree, moving, by_joint, built), urdf=Path(urdf))
    return replace(robot, known_bodies=_known_bodies(robot, tree, known_bodies))


def _robot(
    tree: UrdfTree, moving: tuple[str, ...], drives: dict[str, Drive], built: Assembly
) -> Robot:
    moved = [tree.joints[name] for name in moving]

    def limits(name: str) -> Array:
        return frozen(name, [getattr(joint, name) for joint in moved], (None,))

    robot = Robot(
        name=tree.name,
        joint_names=moving,
        body_names=tuple(joint.child for joint in moved),
        is_prismatic=tuple(joint.type == "prismatic" for joint in moved),
        model=built.model,
        model_order=built.order,
        drives=FrozenMapping(drives),
        parameters=built.bodies.ravel(),
        payload_parameters=frozen("payload", built.payloads.ravel(), (None,)),
        lower_limits=limits("lower"),
        upper_limits=limits("upper"),
        velocity_limits=limits("velocity"),
        effort_limits=limits("effort"),
    )
    return robot.with_values(built.bodies.ravel(), drives)


def _known_bodies(robot: Robot, tree: UrdfTree, names: Sequence[str]) -> tuple[str, ...]:
    if isinstance(names, str):
        raise RobotError(f"known_bodies= must be a list of names, found the text '{names}'")
    bodies = robot.parameters.reshape(-1, 10)
    for name in names:
        if name in tree.links and name not in robot.body_names:
            raise RobotError(
                f"known_bodies: no joint that moves carries '{name}'; the bodies are those of "
                f"{', '.join(robot.body_names)}, with what is fixed to them"
            )
        if name not in robot.body_names:
            raise RobotError("known_bodies: " + unknown_name("body", name, robot.body_names))
        if not np.any(bodies[robot.body_names.index(name)]):
            raise RobotError(f"known_bodies: '{name}' has no inertial parameters in the URDF")
    return tuple(dict.fromkeys(names))


def _drives(
    tree: UrdfTree, moving: Sequence[str], drives: str | Path | Mapping[str, Any] | None
) -> dict[str, Drive]:
    if drives is None:
        given: dict[str, Drive] = {}
    elif isinstance(drives, str | Path):
        given = read_drives(drives)
    elif isinstance(drives, Mapping):
        given = drives_from_mapping(drives)
    else:
        raise RobotError(
            "drives= must be the path of a TOML file or {joint: drive}, found "
            f"{type(drives).__name__}"
        )
    for name in given:
        if name not in tree.joints:
            raise RobotError(
                f"drives for '{tree.name}': " + unknown_name("joint", name, tree.joints)
            )
    for name in moving:
        check_kind(name, tree.joints[name].type, given.get(name, IDEAL_DRIVE))
    by_joint = {name: given.get(name, IDEAL_DRIVE) for name in moving}
    check_transmission(moving, by_joint, tree.joints.keys() - set(moving))
    return by_joint


def check_kind(joint: str, kind: str, drive: Drive) -> None:
    """Refuse a drive for turning joints at a prismatic one and the reverse, and unread terms.

    `kind` is the type of the joint in a URDF. Raises RobotError.
    """
    turning = kind in TURNING
    if drive is IDEAL_DRIVE:
        return
    if drive.extra_terms:
        from seaid.drives import extra_terms

        try:
            extra_terms(drive)
        except RobotError as problem:
            raise RobotError(f"joint '{joint}': {problem}") from None
    if isinstance(drive, StiffDrive):
        wrong, right = ("gear_ratio_rad_per_m", "gear_ratio")
        wrong, right = (wrong, right) if turning else (right, wrong)
        if getattr(drive, wrong) is not None:
            raise RobotError(
                f"joint '{joint}' is {kind}: its stiff drive has {right}, found {wrong}"
            )
    elif turning and drive.is_linear_spring and drive.load_pulley_radius_m is None:
        raise RobotError(
            f"joint '{joint}' turns: its linear spring needs load_pulley_radius_m "
            "(or no radii for a rotary spring)"
        )
    elif not turning and (not drive.is_linear_spring or drive.load_pulley_radius_m is not None):
        raise RobotError(
            f"joint '{joint}' is prismatic: its elastic drive has motor_pulley_radius_m and "
            "no load_pulley_radius_m"
        )
