"""Limits of a motion (17), as linear inequalities that hold at every instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid.arrays import Array, frozen
from seaid.errors import ExcitationError, unknown_name
from seaid.excitation.basis import Basis
from seaid.excitation.trajectory import Trajectory
from seaid.robot import Robot

DEFAULT_ACCELERATION = 10.0
"""rad/s^2 or m/s^2."""

_SMALLEST, _LARGEST = 1e-9, 1e9
"""Of limits in their units: what is beyond is no limit of a robot, and its square no number."""

_DENSITY, _GROUP = 16, 20
_DENSITIES = (_DENSITY, 4 * _DENSITY)

KINDS = ("position", "velocity", "acceleration")
"""The limits that are linear in the coefficients."""

LimitValue = float | Sequence[float] | Array | Mapping[str, float] | None


@dataclass(frozen=True, eq=False)
class Limits:
    """What a motion must keep to: position, speed, acceleration [rad or m, s], and what it asks.

    Each is one number for all joints, one a joint, a mapping {joint: value} for some joints, or
    None. What is not given is the robot's: position and velocity from its file (a joint that turns
    without end stays within +-pi), acceleration 10 rad/s^2 or m/s^2.

    The other four are computed from the robot's nominal values, and `math.inf` means not limited:
    `joint_torque` [N m, or N at a joint that slides], by default the effort limit of the file where
    that is more than zero and the nominal values are known, else not limited; `motor_torque` [N m]
    and `motor_speed` [rad/s] at the motor, and `deflection` of the spring, r_M/N theta_M - r_L q
    [m or rad], by default not limited.
    """

    lower: LimitValue = None
    upper: LimitValue = None
    velocity: LimitValue = None
    acceleration: LimitValue = None
    joint_torque: LimitValue = None
    motor_torque: LimitValue = None
    motor_speed: LimitValue = None
    deflection: LimitValue = None


@dataclass(frozen=True, eq=False)
class JointLimits:
    """The limits of n joints, each (n,), checked: lower < upper, the others more than zero."""

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
    """Least distance to the limits over the whole motion, each (n,) [rad or m, s].

    Position, velocity and acceleration from a hull close to the curve, so the true distance is at
    no instant less. The others, in the units of `Limits`, are at instants of a fine grid; inf where
    not limited, None where no drive is. `distance_m` is the least distance between bodies and boxes
    of the scene, if there is one.
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
    """Return the limits of every joint: those given, else the robot's.

    Raises ExcitationError, naming the joint and the limit, for one that is missing, not finite,
    zero or inverted.
    """
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
            raise ExcitationError(
                f"joint '{joint}': lower limit {low:.6g} must be less than upper limit {high:.6g}; "
                f"give others by Limits(lower={{'{joint}': ...}}, upper={{'{joint}': ...}})"
            )
    return JointLimits(lower, upper, velocity, acceleration)


def hull_rows(
    basis: Basis, limits: JointLimits, kind: int, density: int | None = None
) -> tuple[Array, Array, Array]:
    """Return a hull (C, K), its limits (n,) and the middle to count from (n,).

    `kind` is 0 for position, 1 for velocity, 2 for acceleration. A motion of coefficients c keeps
    the limit at every instant if |hull @ (c - constant middle)| is nowhere more than it.
    """
    bounds = (limits.half_range, limits.velocity, limits.acceleration)
    middle = limits.middle if kind == 0 else np.zeros_like(limits.middle)
    return basis.hull(kind, density or _DENSITY), bounds[kind], middle


def grouped(rows: Array, axis: int) -> Array:
    """Return rows, C of them along `axis`, as (g, c) groups, the last row repeated."""
    missing = -rows.shape[axis] % _GROUP
    padding = [(0, missing if dimension == axis else 0) for dimension in range(rows.ndim)]
    shape = (*rows.shape[:axis], -1, _GROUP, *rows.shape[axis + 1 :])
    return np.pad(rows, padding, mode="edge").reshape(shape)


def margins(trajectory: Trajectory, limits: JointLimits) -> Margins:
    """Return the least distance of a trajectory to its limits; below zero where one is broken."""
    basis, c = trajectory.basis, trajectory.coefficients
    about_middle = c - np.outer(basis.constant, limits.middle)
    q, v, a = (
        np.min([np.abs(basis.hull(order, density) @ part).max(axis=0) for density in _DENSITIES], 0)
        for order, part in enumerate((about_middle, c, c))
    )
    return Margins(limits.half_range - q, limits.velocity - v, limits.acceleration - a)


def limit_values(
    robot: Robot, name: str, given: LimitValue, default: Array, *, unlimited: bool = False
) -> Array:
    """Return one limit of all joints (n,), read-only: `default` (n,) where it is not given.

    Raises ExcitationError, naming the joint, for one that is not finite, or with `unlimited` for
    one that is not finite nor infinity; for other joints and other shapes.
    """
    wanted: Any = given
    if isinstance(given, Mapping):
        for joint in given:
            if joint not in robot.joint_names:
                raise ExcitationError(
                    f"{name} limit: " + unknown_name("joint", joint, robot.joint_names)
                )
        wanted = [given.get(joint, default[robot.index(joint)]) for joint in robot.joint_names]
    elif given is None:
        wanted = default
    elif np.ndim(given) == 0:
        wanted = [given] * robot.n
    values = frozen(f"{name} limit", wanted, (robot.n,), ExcitationError)
    for joint, value in zip(robot.joint_names, values, strict=True):
        if not (np.isfinite(value) or (unlimited and value == np.inf)):
            found = "missing" if given is None else f"{value}, which is not finite"
            raise ExcitationError(
                f"joint '{joint}' of '{robot.name}': {name} limit is {found}; give it by "
                f"Limits({name}=...), one number for all joints, one a joint or {{'{joint}': ...}}"
            )
        if np.isfinite(value) and abs(value) > _LARGEST:
            raise ExcitationError(
                f"joint '{joint}': {name} limit is beyond what a motion can have, found "
                f"{value:.6g}: allowed are -{_LARGEST:g} to {_LARGEST:g}; give another by "
                f"Limits({name}={{'{joint}': ...}})"
            )
    return values


def positive_values(
    robot: Robot, name: str, given: LimitValue, default: Array, *, unlimited: bool = False
) -> Array:
    """Return `limit_values` that are more than zero. Raises ExcitationError for others."""
    values = limit_values(robot, name, given, default, unlimited=unlimited)
    for joint, value in zip(robot.joint_names, values, strict=True):
        if value < _SMALLEST:
            least = "zero" if value <= 0 else f"{_SMALLEST:g}"
            raise ExcitationError(
                f"joint '{joint}': {name} limit must be more than {least}, found {value:.6g}; "
                f"give another by Limits({name}={{'{joint}': ...}})"
            )
    return values
