"""Robot: a URDF, its drives and known payloads as one frozen object."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, BoolArray, FrozenMapping, finite, frozen
from seaid._progress import Display, counted
from seaid.drives import IDEAL_DRIVE, Drive, read_drives
from seaid.drives.angle_ratio import Ratios
from seaid.drives.toml import drives_from_mapping
from seaid.errors import RobotError, SeaidError, check_name
from seaid.robot.inertia import Payload, parameter_names, to_pinocchio
from seaid.robot.pinocchio_model import (
    TURNING,
    Assembly,
    BaseKind,
    DependentJoint,
    assemble,
    check_independent,
    dependent_joints,
    movable_joints,
    moving_joints,
    without_joint_of_base,
)
from seaid.robot.robot_file import is_mjcf, read_urdf, urdf_path
from seaid.robot.transmission import check_transmission, transmission_matrix
from seaid.robot.urdf import EARTH, SNAP_RAD, UrdfJoint, UrdfTree


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Display):
    """A tree of n one-axis joints on a fixed or floating base with its drives, by `load_robot`.

    Attributes
    ----------
    name : str
    joint_names : tuple of n str
        The order of the independent joints in all arrays of seaid.
    dependent_joints : tuple of DependentJoint
        Joints that others move (mimic in the URDF); no array has a column of theirs.
    body_names : tuple of N str
        Body i is the link that joint i moves, with everything fixed to it; those of the dependent
        joints follow, and a floating base is the last. N is n without both.
    is_prismatic : tuple of n bool
    model : pinocchio.Model
        nq = nv, with the payloads and one coordinate for every joint. Its joint k is joint
        `model_order[k]` of the robot and its dependent joints; the orders differ only if `joints`
        of `load_robot` deviates from the tree, or for dependent joints. `to_model` and `from_model`
        convert states and torques.
    model_order : tuple of J int
        J is N without a floating base.
    drives : mapping {joint: StiffDrive or SeriesElasticDrive}
    parameters, payload_parameters : arrays (10N,)
        Standard inertial parameters of the bodies without payloads, and of the payloads alone.
    lower_limits, upper_limits, velocity_limits, effort_limits : arrays (n,)
        Of the URDF: position [rad or m], velocity, torque or force; infinite if not given.
    urdf : Path or None
        The file.
    known_bodies : tuple of str
        Bodies whose parameters are known and not identified.
    locked : mapping {joint: position}
        Joints that stand still elsewhere than at zero [rad or m].
    joints_of_file : tuple of str
        The joints of the file that can move, in its order, those that stand still too.
    at_rest : mapping {joint: position}
        Joints among those of `joint_names` that move in no log, and where they stand [rad or m].
    """

    table_name = "robot_table"

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
    dependent_joints: tuple[DependentJoint, ...] = ()
    locked: Mapping[str, float] = field(default_factory=lambda: FrozenMapping({}, "joint"))
    joints_of_file: tuple[str, ...] = ()
    at_rest: Mapping[str, float] = field(default_factory=lambda: FrozenMapping({}, "joint"))
    base_is_held: ClassVar[bool] = True
    """Whether something holds the base, so that forces on it determine nothing."""

    def _in_short(self) -> str:
        springs = counted(len(self.elastic_joints), "spring")
        return f"'{self.name}': {counted(self.n, 'joint')}, {springs}"

    @cached_property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def standing_joints(self) -> tuple[str, ...]:
        """The joints of the file that stand still: `locked`, or not among `joints`."""
        return tuple(joint for joint in self.joints_of_file if joint not in self.joint_names)

    def position_range(self, joint: str) -> tuple[float, float]:
        """Return the limits of a position [rad or m]; equal ones, as (0, 0), are none."""
        lower, upper = (float(x[self.index(joint)]) for x in (self.lower_limits, self.upper_limits))
        return (lower, upper) if lower < upper else (-math.inf, math.inf)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the 10N standard parameters, such as 'Iyy_thigh'."""
        return parameter_names(self.body_names)

    @property
    def is_known(self) -> BoolArray:
        """Whether each standard parameter (10N,) belongs to a known body."""
        return np.repeat([body in self.known_bodies for body in self.body_names], 10)

    @property
    def known_parameters(self) -> Array:
        """The known part of the standard parameters (10N,): payloads and known bodies."""
        return self.payload_parameters + np.where(self.is_known, self.parameters, 0.0)

    @cached_property
    def elastic_joints(self) -> tuple[str, ...]:
        """The joints with a series elastic drive."""
        return tuple(joint for joint in self.joint_names if self.drives[joint].is_elastic)

    @property
    def has_controllers(self) -> bool:
        """Whether the controller of any drive gives its torque from logged commands."""
        return any(drive.controller is not None for drive in self.drives.values())

    @cached_property
    def transmission(self) -> Array:
        """C (n, n) of phi = C q, the identity if each drive moves its own joint only.

        Row i is the drive in the table of joint i; see `seaid.robot.transmission`.
        """
        return transmission_matrix(self.joint_names, self.drives)

    @cached_property
    def angle_ratios(self) -> Ratios:
        """The ratios that depend on the angle of a joint, by its index.

        Motions and equations have the angle phi behind the gear as the position of such a joint,
        and the torque there; robot files, logs and plans have the angle and torque of the joint.
        """
        ratios = {self.index(joint): drive.angle_ratio for joint, drive in self.drives.items()}
        return Ratios({j: ratio for j, ratio in ratios.items() if ratio is not None})

    def joint_states(self, *states: Array) -> tuple[Array, ...]:
        """Return q, q', q'' (..., n), or the first of them, at those behind the gears."""
        return self.angle_ratios.at_joints(*states)

    def drive_states(self, *states: Array) -> tuple[Array, ...]:
        """Return phi, phi', phi'' (..., n) behind the gears, or the first, at those of joints."""
        return self.angle_ratios.at_drives(*states)

    @property
    def all_joint_names(self) -> tuple[str, ...]:
        """The joints of all bodies (N): the independent ones, then the dependent ones."""
        return (*self.joint_names, *(joint.name for joint in self.dependent_joints))

    @property
    def all_prismatic(self) -> tuple[bool, ...]:
        """Whether each joint of `all_joint_names` is prismatic."""
        return (*self.is_prismatic, *(joint.is_prismatic for joint in self.dependent_joints))

    def joint_of(self, body: int) -> str:
        """Return the independent joint that moves a body by its index: for most, the one above."""
        return (*self.joint_names, *(joint.leader for joint in self.dependent_joints))[body]

    @property
    def joint_order(self) -> list[int]:
        """The indices of the n independent joints in the order of the model."""
        return [index for index in self.model_order if index < self.n]

    @cached_property
    def _expansion(self) -> tuple[Array, Array] | None:
        """E (N, n) and e (N,) of all positions E q + e; None without dependent joints."""
        if not self.dependent_joints:
            return None
        count = len(self.all_joint_names)
        E, e = np.eye(count, self.n), np.zeros(count)
        for row, joint in enumerate(self.dependent_joints, self.n):
            E[row, self.joint_names.index(joint.leader)] = joint.multiplier
            e[row] = joint.offset
        return E, e

    def expand(self, states: Array, order: int = 0) -> Array:
        """Return positions (..., n), or their time derivatives of an `order`, of all joints."""
        if self._expansion is None:
            return states
        E, e = self._expansion
        return np.asarray(states @ E.T + (e if order == 0 else 0.0))

    def to_model(self, states: Array, order: int = 0) -> Array:
        """Return positions (..., n), or time derivatives of an `order`, as the model has them."""
        return np.ascontiguousarray(self.expand(states, order).take(self.model_order, axis=-1))

    def model_states(self, *states: Array) -> list[Array]:
        """Return q, q', q'' (..., n), or the first of them, as the model has them."""
        return [self.to_model(state, order) for order, state in enumerate(states)]

    def from_model(self, torques: Array, axes: int = 1) -> Array:
        """Return torques (..., N) of the model, or with 2 `axes` matrices (..., N, N), by joint.

        A dependent joint acts on its leader: tau = E^T tau_all and M = E^T M_all E, by the
        principle of power.
        """
        if self.model_order == tuple(range(self.n)):
            return torques
        # (..., N) in the model's order -> in that of `all_joint_names`.
        back = np.argsort(self.model_order)
        for axis in range(-axes, 0):
            torques = np.take(torques, back, axis=axis)
            if self._expansion is not None:
                # Row vectors: tau^T E is (E^T tau)^T.
                moved = np.moveaxis(torques, axis, -1) @ self._expansion[0]
                torques = np.moveaxis(moved, -1, axis)
        return torques

    def index(self, joint: str) -> int:
        """Return the index of a joint. Raises RobotError with the nearest name."""
        if not isinstance(joint, str) or joint not in self.joint_names:
            check_name("joint", joint, self.joint_names, RobotError, self.name)
        return self.joint_names.index(joint)

    def selected(self, names: str | Sequence[str] | None) -> tuple[str, ...]:
        """Return the joints that `torque_joints=` selects, each once; None selects all.

        Joints that stand still are ignored. Raises RobotError with the nearest name for an unknown
        joint.
        """
        wanted = (names,) if isinstance(names, str) else names
        selected = self.joint_names if wanted is None else wanted
        selected = [name for name in selected if name not in self.standing_joints]
        for name in selected:
            self.index(name)
        return tuple(dict.fromkeys(selected))

    def with_values(self, parameters: Array, drives: Mapping[str, Drive]) -> Robot:
        """Return the robot with other standard parameters (10N,) and drives {joint: drive}."""
        parameters = frozen("parameters", parameters, self.payload_parameters.shape, RobotError)
        model = self.model.copy()
        loaded = (parameters + self.payload_parameters).reshape(-1, 10)
        for position, index in enumerate(self.model_order):
            model.inertias[position + 1] = to_pinocchio(loaded[index])
        by_joint = FrozenMapping({joint: drives[joint] for joint in self.joint_names}, "joint")
        return replace(self, model=model, parameters=parameters, drives=by_joint)

    def at_temperature(self, temperature_degC: float | None = None) -> Robot:
        """Return the robot with the friction of one temperature; None: that of reference."""
        warm = {
            joint: drive.at_temperature(temperature_degC) for joint, drive in self.drives.items()
        }
        return self.with_drives({x: new for x, new in warm.items() if new is not self.drives[x]})

    def with_drives(self, drives: Mapping[str, Drive]) -> Robot:
        """Return the robot with other drives at some of its joints. Raises RobotError."""
        for joint in drives:
            self.index(joint)
        # The model has no part of the drives, not even their rotors: it stays.
        return replace(self, drives=FrozenMapping({**self.drives, **drives}, "joint"))

    def without_nominal(self) -> Robot:
        """Return the robot as known before an identification: geometry, ratios, rotor inertias.

        The standard parameters are NaN except those of known bodies, and the drives have neither
        stiffness nor friction, so that no result computed from this robot can depend on them.
        """
        known = {joint: drive.without_nominal() for joint, drive in self.drives.items()}
        return self.with_values(np.where(self.is_known, self.parameters, np.nan), known)


def robot_of_file(
    urdf: str | Path,
    drives: str | Path | Mapping[str, Any] | None = None,
    *,
    joints: Sequence[str] | None = None,
    locked: Mapping[str, float] | None = None,
    payloads: Sequence[Payload] = (),
    known_bodies: str | Sequence[str] = (),
    gravity: Sequence[float] = EARTH,
    snap_tolerance_rad: float = SNAP_RAD,
    independent_mimics: bool = False,
    base: BaseKind = "fixed",
) -> tuple[Robot, Assembly]:
    """Return the robot of a file as on a base that is held, and how it was assembled.

    The base is the last body of a robot whose base moves. `seaid.load_robot` describes the
    arguments, and puts the robot on its base. Raises RobotError.
    """
    urdf = urdf_path(urdf)
    tree = read_urdf(urdf, snap_tolerance_rad)
    if independent_mimics:
        free = {name: replace(joint, mimic=None) for name, joint in tree.joints.items()}
        tree = replace(tree, joints=free)
    floats = base != "fixed"
    if floats:
        tree = without_joint_of_base(tree, base)
    locked = dict(locked or {})
    movable = movable_joints(tree)
    tree = tree.locked_at(locked)
    moving = moving_joints(tree, joints)
    followers = dependent_joints(tree, moving)
    everything = (*moving, *(joint.name for joint in followers))
    by_joint = _drives(tree, moving, drives)
    down = finite("gravity", gravity, (3,), RobotError)
    built = assemble(tree, everything, payloads, down, floats)
    robot = _robot(built, moving, followers, by_joint)
    still = FrozenMapping(locked, "joint")
    robot = replace(robot, urdf=urdf, locked=still, joints_of_file=movable)
    return replace(robot, known_bodies=_known_bodies(robot, tree, known_bodies)), built


def nominal_model(path: Path, robot: Robot) -> Robot:
    """Return the robot with other drives (.toml), or of another file with the same joints.

    A MuJoCo model brings its bodies, damping, friction loss and armature; the controllers of the
    drives and the payloads stay. Raises RobotError.
    """
    if path.suffix.lower() == ".toml":
        return robot.with_drives(read_drives(path))
    gravity = robot.model.gravity.linear.tolist()
    loaded, _ = robot_of_file(
        path, robot.drives, joints=robot.joint_names, locked=robot.locked, gravity=gravity
    )
    loaded = replace(loaded, payload_parameters=robot.payload_parameters)
    drives = dict(robot.drives)
    if loaded.urdf is not None and is_mjcf(loaded.urdf):  # a name has become a path
        from seaid.robot.mjcf import joint_dynamics

        for joint, values in joint_dynamics(loaded.urdf).items():
            if joint in drives and not drives[joint].is_elastic:
                drives[joint] = _with_dynamics(drives[joint], *values)
    return loaded.with_values(loaded.parameters, drives)


def _with_dynamics(drive: Drive, damping: float, friction_loss: float, armature: float) -> Drive:
    """Return a stiff drive with these values at the joint, behind the gear."""
    N = drive.ratio
    values = {"viscous_friction": damping / N**2, "coulomb_friction": friction_loss / N}
    bare = replace(drive, friction=("viscous", "coulomb"), nominal={}, known=())
    return bare.with_values({**values, "motor_inertia": armature / N**2})


def check_held(
    robot: Robot, what: str, error: type[SeaidError] = RobotError, why: str = ""
) -> None:
    """Raise an error if the base of a robot floats, for what needs a base that is held."""
    if not robot.base_is_held:
        because = f" ({why})" if why else ""
        raise error(
            f"{what} needs a robot with a fixed base, and that of '{robot.name}' floats{because}: "
            "load it with base='fixed' for a robot that hangs or is bolted down",
            "base='fixed'",
        )


def _robot(
    built: Assembly,
    moving: tuple[str, ...],
    followers: tuple[DependentJoint, ...],
    drives: dict[str, Drive],
) -> Robot:
    tree = built.tree
    moved = [_within_followers(tree.joints[name], tree, followers) for name in moving]

    joints = (*moving, *(joint.name for joint in followers))
    bodies = tuple(tree.joints[name].child for name in joints)

    def limits(name: str) -> Array:
        return frozen(name, [getattr(joint, name) for joint in moved], (None,))

    robot = Robot(
        name=tree.name,
        joint_names=moving,
        body_names=(*bodies, tree.root)[: len(built.bodies)],
        is_prismatic=tuple(joint.type == "prismatic" for joint in moved),
        model=built.model,
        model_order=built.order,
        drives=FrozenMapping(drives, "joint"),
        parameters=built.bodies.ravel(),
        payload_parameters=frozen("payload", built.payloads.ravel(), (None,)),
        lower_limits=limits("lower"),
        upper_limits=limits("upper"),
        velocity_limits=limits("velocity"),
        effort_limits=limits("effort"),
        dependent_joints=followers,
    )
    return robot.with_values(built.bodies.ravel(), drives)


def _within_followers(
    joint: UrdfJoint, tree: UrdfTree, followers: Sequence[DependentJoint]
) -> UrdfJoint:
    """Return a joint with the limits within which its dependent joints keep theirs."""
    for mimic in followers:
        if mimic.leader != joint.name:
            continue
        moved = tree.joints[mimic.name]
        # Sorted, because a negative multiplier swaps the limits.
        ends = sorted((x - mimic.offset) / mimic.multiplier for x in (moved.lower, moved.upper))
        lower, upper = max(joint.lower, ends[0]), min(joint.upper, ends[1])
        if lower < upper:
            joint = replace(joint, lower=lower, upper=upper)
        if moved.velocity > 0:
            velocity = min(joint.velocity, moved.velocity / abs(mimic.multiplier))
            joint = replace(joint, velocity=velocity)
    return joint


def _known_bodies(robot: Robot, tree: UrdfTree, names: str | Sequence[str]) -> tuple[str, ...]:
    bodies = robot.parameters.reshape(-1, 10)
    names = [names] if isinstance(names, str) else list(names)
    if names == ["all"] and "all" not in robot.body_names:
        names = list(compress(robot.body_names, np.any(np.nan_to_num(bodies), axis=1)))
    still = {tree.joints[joint].child for joint in robot.standing_joints}
    names = [name for name in names if name not in still]  # parts of other bodies
    for name in names:
        kind, where = "body that a joint moves", ("known_bodies", "known_bodies:")
        check_name(kind, name, robot.body_names, RobotError, *where)
        if not np.any(bodies[robot.body_names.index(name)]):
            raise RobotError(
                f"known_bodies: '{name}' has no inertial parameters in the URDF", "known_bodies:"
            )
    return tuple(dict.fromkeys(names))


def _drives(
    tree: UrdfTree, moving: Sequence[str], drives: str | Path | Mapping[str, Any] | None
) -> dict[str, Drive]:
    if isinstance(drives, str | Path):
        declared, where = read_drives(drives), f"drives of '{drives}' for '{tree.name}'"
    else:
        declared, where = drives_from_mapping(drives or {}), f"drives for '{tree.name}'"
    for name in declared:
        check_independent(tree, name, where)
    by_joint = {name: declared.get(name, IDEAL_DRIVE) for name in moving}
    for name, drive in by_joint.items():
        check_kind(name, tree.joints[name].type, drive)
        _check_reach(tree.joints[name], drive)
    check_transmission(moving, by_joint, tree.joints.keys() - set(moving))
    return by_joint


def _check_reach(joint: UrdfJoint, drive: Drive) -> None:
    """Raise RobotError for a table of an angle-dependent ratio that a joint leaves."""
    angles = drive.angle_ratio.angle_rad if drive.angle_ratio is not None else ()
    if angles and not (angles[0] <= joint.lower and joint.upper <= angles[-1]):
        raise RobotError(
            f"the limits of joint '{joint.name}' are {joint.lower:g} and {joint.upper:g} rad, and "
            f"the table of its angle_ratio ends at {angles[0]:g} and {angles[-1]:g} rad"
        )


def check_kind(joint: str, kind: str, drive: Drive) -> None:
    """Raise RobotError for a drive that does not fit the joint's type, or bad extra terms."""
    if drive is IDEAL_DRIVE:
        return
    if drive.extra_terms:
        from seaid.drives.equations import extra_terms

        try:
            extra_terms(drive)
        except RobotError as problem:
            raise problem.at(f"joint '{joint}'") from None
    turning, for_turning = kind in TURNING, drive.joint_units[1] == "rad"
    if drive.angle_ratio is not None and not turning:
        raise RobotError(f"joint '{joint}' is {kind}, and a drive with angle_ratio turns a joint")
    if turning != for_turning and not (for_turning and drive.gear_ratio is None):
        raise RobotError(f"joint '{joint}' {_MISFITS[drive.is_elastic, turning].format(kind)}")


_MISFITS = {
    (False, True): "is {}: its stiff drive has gear_ratio, found gear_ratio_rad_per_m",
    (False, False): "is {}: its stiff drive has gear_ratio_rad_per_m, found gear_ratio",
    (True, True): (
        "turns: its linear spring needs load_pulley_radius_m (or no radii for a rotary spring)"
    ),
    (True, False): (
        "is prismatic: its elastic drive has motor_pulley_radius_m and no load_pulley_radius_m"
    ),
}
"""{(drive is elastic, joint turns): what is wrong with a drive for the other kind of joint}."""
