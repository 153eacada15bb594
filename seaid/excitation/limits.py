"""Limits of a motion (17), linear ones at every instant, and those of the drives on a grid.

Limits of position, velocity and acceleration are linear in the coefficients. Those of joint torque,
motor torque, motor speed and deflection are computed from the nominal model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, frozen
from seaid._progress import Display
from seaid.drives import DEAD_ZONES, friction_curve
from seaid.drives.functions import SmoothColumns, joint_term_parameters
from seaid.errors import ExcitationError, check_name
from seaid.excitation.basis import Basis
from seaid.excitation.criteria import States
from seaid.excitation.flatness import (
    SIGN_WIDTH,
    ParallelElements,
    Transmission,
    check_nominal_bodies,
    differentiation,
    load_derivatives,
    load_torques,
    motor_signals,
    motor_speeds,
    nominal_value,
    parallel_elements,
    rigid_transmission,
    transmission,
)
from seaid.excitation.trajectory import Trajectory
from seaid.robot import Robot, torques_at_drives

DEFAULT_ACCELERATION = 10.0
"""rad/s^2 or m/s^2."""

_SMALLEST, _LARGEST = 1e-9, 1e9
"""Smallest and largest limit, in its unit: squares of larger ones could overflow."""

_DENSITY, _GROUP = 16, 20
"""Rows per coefficient of the hull that bounds a motion in the search (`Basis.hull`), and rows in a
group, of which the search has one constraint, at the worst of them."""

_DENSITIES = (_DENSITY, 4 * _DENSITY)
"""Those of the hulls by which the margins of a motion are stated: the second bound is tighter than
that of the search."""

KINDS = ("position", "velocity", "acceleration")
"""The limits that are linear in the coefficients."""

LimitValue = float | Sequence[float] | Array | Mapping[str, float] | None


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Display):
    """Limits of a planned motion.

    Each is one number for all joints, one per joint, {joint: value} for some joints, or None for
    the default. The last four are computed from the nominal values of the robot, and `math.inf`
    means not limited.

    Parameters
    ----------
    lower, upper : limit
        Position [rad or m]. Default: the robot's file, +-pi for a continuous joint.
    velocity : limit
        [rad/s or m/s]. Default: the robot's file.
    acceleration : limit
        [rad/s^2 or m/s^2]. Default: 10.
    joint_torque : limit
        [N m or N]. Default: the effort limit of the robot's file if it is positive and the nominal
        values are known, else not limited.
    motor_torque, motor_speed : limit
        At the motor [N m], [rad/s]. Default: not limited.
    deflection : limit
        Of the spring, r_M/N theta_M - r_L q [m or rad]. Default: not limited.

    Examples
    --------
    >>> limits = seaid.Limits(velocity=2.0, joint_torque={"knee": 20.0})
    """

    lower: LimitValue = None
    upper: LimitValue = None
    velocity: LimitValue = None
    acceleration: LimitValue = None
    joint_torque: LimitValue = None
    motor_torque: LimitValue = None
    motor_speed: LimitValue = None
    deflection: LimitValue = None


@dataclass(frozen=True, eq=False, repr=False)
class JointLimits(Display):
    """The limits of n joints, each (n,), with lower < upper and the others more than zero."""

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array

    @property
    def middle(self) -> Array:
        """The middle of each joint's range (n,)."""
        return 0.5 * (self.lower + self.upper)

    @property
    def half_range(self) -> Array:
        """Half of each joint's range (n,)."""
        return 0.5 * (self.upper - self.lower)


@dataclass(frozen=True, eq=False)
class Margins:
    """Minimum distance to the limits over the whole motion, each (n,), in the units of `Limits`.

    Those of position, velocity and acceleration are lower bounds over all instants. The others are
    minima over a fine grid: inf for a joint that is not limited, None if no drive is. `distance_m`
    is the minimum distance between the bodies and boxes of the scene, if there is one.
    """

    position: Array
    velocity: Array
    acceleration: Array
    joint_torque: Array | None = None
    motor_torque: Array | None = None
    motor_speed: Array | None = None
    deflection: Array | None = None
    distance_m: float | None = None


def joint_limits(robot: Robot, limits: Limits | None = None) -> JointLimits:
    """Return every joint's limits, given or the robot's; raise ExcitationError for bad ones."""
    limits = Limits() if limits is None else limits
    turns = ~np.array(robot.is_prismatic)
    endless = turns & ~np.isfinite(robot.lower_limits) & ~np.isfinite(robot.upper_limits)
    low = np.where(endless, -np.pi, robot.lower_limits)
    high = np.where(endless, np.pi, robot.upper_limits)
    lower = limit_values(robot, "lower", limits.lower, low)
    upper = limit_values(robot, "upper", limits.upper, high)
    velocity = positive_values(robot, "velocity", limits.velocity, robot.velocity_limits)
    default = np.full(robot.n, DEFAULT_ACCELERATION)
    acceleration = positive_values(robot, "acceleration", limits.acceleration, default)
    for joint, low, high in zip(robot.joint_names, lower, upper, strict=True):
        if not low < high:
            others = f"Limits(lower={{'{joint}': ...}}, upper={{'{joint}': ...}})"
            raise ExcitationError(
                f"joint '{joint}': lower limit {low:.6g} must be less than upper limit {high:.6g}; "
                f"give others by {others}",
                others,
            )
    return JointLimits(lower, upper, velocity, acceleration)


def hull_rows(
    basis: Basis, limits: JointLimits, kind: int, density: int | None = None
) -> tuple[Array, Array, Array]:
    """Return a hull (C, K), its limits (n,), and the middle of their range (n,).

    `kind` is 0 for position, 1 for velocity, 2 for acceleration. A motion of coefficients c keeps
    the limit at every instant if |hull @ (c - constant middle)| <= limit.
    """
    bounds = (limits.half_range, limits.velocity, limits.acceleration)
    middle = limits.middle if kind == 0 else np.zeros_like(limits.middle)
    return basis.hull(kind, density or _DENSITY), bounds[kind], middle


def grouped(rows: Array, axis: int) -> Array:
    """Return the C rows along `axis` in groups (g, c), the last one repeated."""
    groups = -(-rows.shape[axis] // _GROUP)
    missing = groups * _GROUP - rows.shape[axis]
    padding = [(0, missing if dimension == axis else 0) for dimension in range(rows.ndim)]
    # repeating a row changes no largest use, and all groups have one size
    shape = (*rows.shape[:axis], groups, _GROUP, *rows.shape[axis + 1 :])
    return np.pad(rows, padding, mode="edge").reshape(shape)


def margins(
    trajectory: Trajectory, limits: JointLimits, densities: Sequence[int] = _DENSITIES
) -> Margins:
    """Return the minimum distance of a trajectory to its limits, negative if one is broken."""
    basis, c = trajectory.basis, trajectory.coefficients
    about_middle = c - np.outer(basis.constant, limits.middle)
    # every density gives a bound; that of the search is among them, so that a motion that keeps
    # its limits there has no negative margin
    q, v, a = (
        np.min([np.abs(basis.hull(order, density) @ part).max(axis=0) for density in densities], 0)
        for order, part in enumerate((about_middle, c, c))
    )
    return Margins(limits.half_range - q, limits.velocity - v, limits.acceleration - a)


_BISECTIONS = 14
"""Steps of a bisection, to 1 / 16,000 of a motion."""


def largest_factor(keeps_limits: Callable[[float], bool]) -> float:
    """Return the largest factor up to 1 of a motion that keeps the limits, as the factor 0 does."""
    inside, outside = 0.0, 1.0
    if keeps_limits(outside):
        return outside
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if keeps_limits(middle) else (inside, middle)
    return inside


def limit_values(
    robot: Robot, name: str, limit: LimitValue, default: Array, *, unlimited: bool = False
) -> Array:
    """Return one limit of all joints (n,), read-only; `default` (n,) for those not given.

    Raises ExcitationError, naming the joint, for a value that is not finite (infinity is allowed
    with `unlimited`), for unknown joints and other shapes.
    """
    wanted: Any = default if limit is None else limit
    if isinstance(limit, Mapping):
        wanted = dict(zip(robot.joint_names, default, strict=True)) | dict(limit)
    what = _called(name)
    wanted = per_joint(what, wanted, robot.joint_names, what)
    values = frozen(what, wanted, (robot.n,), ExcitationError)
    for joint, value in zip(robot.joint_names, values, strict=True):
        if not (np.isfinite(value) or (unlimited and value == np.inf)):
            fault = "missing" if limit is None else f"{value}, which is not finite"
            raise ExcitationError(
                f"joint '{joint}' of '{robot.name}': {what} is {fault}; give it by "
                f"{_written(name, '...')}, one for all joints, one per joint or one for "
                f"'{joint}' by its name",
                _written(name, "..."),
            )
        if np.isfinite(value) and abs(value) > _LARGEST:
            raise _out_of_range(joint, name, value, f"from -{_LARGEST:g} to {_LARGEST:g}")
    return values


def _called(name: str) -> str:
    """Return what a message calls values of joints: a limit, or an argument of its own."""
    return f"{name} limit" if hasattr(Limits, name) else name


def _written(name: str, value: str) -> str:
    """Return how a caller writes values of joints: in `Limits`, or as an argument of its own."""
    return f"Limits({name}={value})" if hasattr(Limits, name) else f"{name}={value}"


def _out_of_range(joint: str, name: str, value: float, allowed: str) -> ExcitationError:
    """Return the error for a value of a joint that is not as it must be."""
    another = _written(name, f"{{'{joint}': ...}}")
    wrong = f"joint '{joint}': {_called(name)} must be {allowed}, found {value:.6g}"
    return ExcitationError(f"{wrong}; give another by {another}", another)


def per_joint(name: str, values: Any, joint_names: Sequence[str], *arguments: str) -> Any:
    """Return the values of {joint: value} in the order of the joints, or the same for all.

    `arguments` are those of the error for an unknown joint.
    """
    if not isinstance(values, Mapping):
        return [values] * len(joint_names) if np.ndim(values) == 0 else values
    for joint in values:
        check_name("joint", joint, joint_names, ExcitationError, name, *arguments)
    missing = [joint for joint in joint_names if joint not in values]
    if missing:
        raise ExcitationError(
            f"{name} is not given for {', '.join(missing)}; name all joints, or give None "
            "where it may be any"
        )
    return [values[joint] for joint in joint_names]


def positive_values(
    robot: Robot, name: str, limit: LimitValue, default: Array, *, unlimited: bool = False
) -> Array:
    """Return `limit_values` that are more than zero. Raises ExcitationError for others."""
    values = limit_values(robot, name, limit, default, unlimited=unlimited)
    for joint, value in zip(robot.joint_names, values, strict=True):
        if value < _SMALLEST:
            least = "zero" if value <= 0 else f"{_SMALLEST:g}"
            raise _out_of_range(joint, name, value, f"more than {least}")
    return values


DRIVE_KINDS = ("joint_torque", "motor_torque", "motor_speed", "deflection")


_DEFLECTION = DRIVE_KINDS.index("deflection")

_NOT_FLAT = {
    **dict.fromkeys(DEAD_ZONES, ("motor_torque", "motor_speed")),
    "damping": ("motor_torque", "motor_speed", "deflection"),
}
"""{spring term: kinds that the joint's motion does not determine at each instant}: the motor jumps
across a dead zone, and the deflection of a damped spring depends on the past."""


@dataclass(frozen=True, eq=False)
class DriveLimits:
    """Limits of the drives: `largest` values (4, n) of `DRIVE_KINDS`, inf where not limited.

    `friction` has the curves of motors limited in torque, by index; `sign_width` (n,) [rad/s] is
    the speed over which it changes sign.
    """

    robot: Robot
    largest: Array
    drives: Transmission
    motor_inertia: Array
    friction: tuple[tuple[int, SmoothColumns], ...]
    parallel: ParallelElements
    sign_width: Array


def drive_limits(robot: Robot, limits: Limits, top_speed: Array) -> DriveLimits | None:
    """Return the limits of the drives, None if there are none.

    A joint torque that is not given is limited by the effort of the URDF, if the nominal bodies and
    parallel elements are known. Raises ExcitationError if a limit needs a nominal value that is
    missing, or a quantity that the motion of the joint does not determine.
    """
    nothing = np.full(robot.n, np.inf)
    effort = robot.effort_limits
    known = _has_parallel_values(robot) & np.all(np.isfinite(robot.parameters))
    usable = np.isfinite(effort) & (effort > 0) & known
    elastic = np.array([joint in robot.elastic_joints for joint in robot.joint_names])
    defaults = {"joint_torque": np.where(usable, effort, np.inf)}
    triples = [(kind, getattr(limits, kind), defaults.get(kind, nothing)) for kind in DRIVE_KINDS]
    most = np.array([positive_values(robot, *triple, unlimited=True) for triple in triples])
    most[DRIVE_KINDS.index("deflection"), ~elastic] = np.inf
    limited = np.isfinite(most)
    if not np.any(limited):
        return None
    check_nominal_bodies(robot)
    _check_flat(robot, limited)
    motors = np.flatnonzero(limited[DRIVE_KINDS.index("motor_torque")])
    # limits of joint torques alone need no motor motion, and so no stiffness
    drives = transmission(robot) if np.any(limited[1:]) else rigid_transmission(robot)
    limited_joints = [robot.joint_names[index] for index in np.flatnonzero(limited.any(axis=0))]
    names = [robot.joint_names[index] for index in motors]
    inertia = np.zeros(robot.n)
    inertia[motors] = [nominal_value(x, robot.drives[x], "motor_inertia") for x in names]
    curves = [friction_curve(joint, robot.drives[joint]) for joint in names]
    return DriveLimits(
        robot=robot,
        largest=most,
        drives=drives,
        motor_inertia=inertia,
        friction=tuple(zip(motors.tolist(), curves, strict=True)),
        parallel=parallel_elements(robot, top_speed, limited_joints),
        sign_width=SIGN_WIDTH * motor_speeds(drives, top_speed),
    )


def _has_parallel_values(robot: Robot) -> BoolArray:
    """Return for each joint (n,) whether the elements parallel to its drive have values."""
    drives = [robot.drives[joint] for joint in robot.joint_names]
    return np.array([set(joint_term_parameters(drive)) <= set(drive.values) for drive in drives])


def _check_flat(robot: Robot, limited: BoolArray) -> None:
    """Raise ExcitationError for limits of quantities that the joint's motion does not determine."""
    for index, joint in enumerate(robot.joint_names):
        for term in robot.drives[joint].spring:
            kinds = [
                kind for kind in _NOT_FLAT.get(term, ()) if limited[DRIVE_KINDS.index(kind), index]
            ]
            if kinds:
                raise ExcitationError(
                    f"joint '{joint}' has a spring with {term.replace('_', ' ')}: its "
                    f"{' and '.join(kinds)} do not follow from the motion of the joint, so that a "
                    "plan cannot limit them; remove these limits"
                )


def drive_loads(limits: DriveLimits, time: Array, states: States) -> Array:
    """Return `DRIVE_KINDS` along a motion, (4, T, n) [N m or N, N m, rad/s, rad or m]."""
    torque = load_torques(limits.robot, limits.parallel, states)
    drive_torque = torques_at_drives(limits.drives.matrix, torque)
    signals = motor_signals(limits.drives, states, drive_torque, differentiation(time))
    speed, acceleration = signals[1], signals[2]
    # (7) with (8): tau_M = I_M theta_M'' + friction + tau / ratio
    motor = limits.motor_inertia * acceleration + drive_torque / limits.drives.ratio
    for index, curve in limits.friction:
        width = float(limits.sign_width[index])
        speed_and_torque = speed[:, index], drive_torque[:, index]
        motor[:, index] += curve.torque(*speed_and_torque, sign_width=width)[0]
    return np.stack([torque, motor, speed, limits.drives.spring_deflection(drive_torque)[0]])


def drive_load_gradient(
    limits: DriveLimits,
    time: Array,
    states: States,
    loads: Array,
    picked: tuple[IndexArray, IndexArray, IndexArray],
    maps: tuple[Array, Array, Array],
) -> Array:
    """Return the derivatives (m, n, k) of loads[kind, t, j] for `picked` (kind, t, j), each (m,).

    They are by variables x (n, k) with q = maps[0] @ x.T and so on, for joints of unit range;
    `maps` are 3 of (T, k). `loads` are those of `drive_loads`.
    """
    kinds, instants, joints = picked
    matrix = limits.drives.matrix
    tables = load_derivatives(limits.robot, limits.parallel, states)
    # (3, T, n, n): tau_phi = C^-T tau on the axis of the torques, which is the last but one
    at_drives = np.moveaxis(torques_at_drives(matrix, np.moveaxis(tables, 2, -1)), -1, 2)
    drive_torque = torques_at_drives(matrix, loads[0])
    by_force = limits.drives.spring_deflection(drive_torque)[1]
    motor_compliance = limits.drives.lever * by_force
    first, second = differentiation(time)
    by_state = np.stack(maps)
    gradient = np.zeros((len(kinds), limits.robot.n, by_state.shape[2]))
    for joint in np.unique(joints):
        for table, rows in (
            # kind 0 is the torque at the joint itself; the others depend on that of the drive
            (tables, np.flatnonzero((joints == joint) & (kinds == 0))),
            (at_drives, np.flatnonzero((joints == joint) & (kinds > 0))),
        ):
            t = instants[rows]
            by_acceleration, by_speed, by_torque = _slopes(
                limits, int(joint), kinds[rows], loads[2, t, joint], drive_torque[t, joint]
            )
            by_torque[kinds[rows] == _DEFLECTION] = by_force[t, joint][kinds[rows] == _DEFLECTION]
            # d(motor speed)/dx = ratio v_x + D1 diag(compliance) tau_x, D1 the differentiation
            # matrix; likewise the acceleration with D2: `weights` (m, T) multiply tau_x
            weights = motor_compliance[:, joint] * (
                by_speed[:, None] * first[t] + by_acceleration[:, None] * second[t]
            )
            # at its own instant a load also depends on the torque directly, not only by the spring
            weights[np.arange(len(rows)), t] += by_torque
            chain = np.einsum("xti,xtk->tik", table[:, :, joint], by_state)
            gradient[rows] = np.tensordot(weights, chain, axes=1)
            # ratio phi' and ratio phi'' of the motor, with phi = C q
            turning = limits.drives.ratio[joint] * (
                by_speed[:, None] * by_state[1, t] + by_acceleration[:, None] * by_state[2, t]
            )
            gradient[rows] += matrix[joint][:, None] * turning[:, None, :]
    return gradient


def _slopes(
    limits: DriveLimits, joint: int, kinds: IndexArray, speed: Array, torque: Array
) -> tuple[Array, Array, Array]:
    """Return the slopes (m,) of loads by motor acceleration, speed and torque."""
    slopes = np.zeros((3, len(kinds)))
    # kinds 0 to 2 of `DRIVE_KINDS`; the slope of the deflection, kind 3, is that of the caller
    at_joint, motor, fast = (kinds == number for number in range(3))
    slopes[2, at_joint] = 1.0
    slopes[0, motor] = limits.motor_inertia[joint]
    slopes[2, motor] = 1.0 / limits.drives.ratio[joint]
    for index, curve in limits.friction:
        if index == joint:
            width = float(limits.sign_width[joint])
            _, (by_speed, by_torque) = curve.torque(speed[motor], torque[motor], sign_width=width)
            slopes[1, motor] += by_speed
            slopes[2, motor] += by_torque
    slopes[1, fast] = 1.0
    return slopes[0], slopes[1], slopes[2]
