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

_DENSITY, _GROUP = 16, 20
_DENSITIES = (_DENSITY, 4 * _DENSITY)

LimitValue = float | Sequence[float] | Array | Mapping[str, float] | None


@dataclass(frozen=True, eq=False)
class Limits:
    """What a motion must keep to: position, largest speed, largest acceleration [rad or m, s].

    Each is one number for all joints, one a joint, a mapping {joint: value} for some joints, or
    None. What is not given is the robot's: position and velocity from its file (a joint that turns
    without end stays within +-pi), acceleration 10 rad/s^2 or m/s^2.
    """

    lower: LimitValue = None
    upper: LimitValue = None
    velocity: LimitValue = None
    acceleration: LimitValue = None


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

    From a hull close to the curve, so the true distance is at no instant less.
    """

    position: Array
    velocity: Array
    acceleration: Array


def joint_limits(robot: Robot, limits: Limits | None = None) -> JointLimits:
    """Return the limits of every joint: those given, else the robot's.

    Raises ExcitationError, naming the joint and the limit, for one that is missing, not finite,
    zero or inverted.
    """
    limits = Limits() if limits is None else limits
    turns = ~np.array(robot.is_prismatic)
    endless = turns & ~np.isfinite(robot.lower_limits) & ~np.isfinite(robot.upper_limits)
    lower = _values(robot, "lower", limits.lower, np.where(endless, -np.pi, robot.lower_limits))
    upper = _values(robot, "upper", limits.upper, np.where(endless, np.pi, robot.upper_limits))
    velocity = _values(robot, "velocity", limits.velocity, robot.velocity_limits)
    default = np.full(robot.n, DEFAULT_ACCELERATION)
    acceleration = _values(robot, "acceleration", limits.acceleration, default)
    for joint, low, high in zip(robot.joint_names, lower, upper, strict=True):
        if not low < high:
            raise ExcitationError(
                f"joint '{joint}': lower limit {low:.6g} must be less than upper limit {high:.6g}; "
                f"give others by Limits(lower={{'{joint}': ...}}, upper={{'{joint}': ...}})"
            )
    for name, values in (("velocity", velocity), ("acceleration", acceleration)):
        for joint, value in zip(robot.joint_names, values, strict=True):
            if value <= 0:
                raise ExcitationError(
                    f"joint '{joint}': {name} limit must be more than zero, found {value:.6g}; "
                    f"give another by Limits({name}={{'{joint}': ...}})"
                )
    return JointLimits(lower, upper, velocity, acceleration)


def limit_rows(basis: Basis, free: Array, limits: JointLimits) -> Array:
    """Return matrices G (n, g, c, k): joint j keeps its limits at every instant if |G[j] x| <= 1.

    `free` (K, k) gives the coefficients from free variables, which are x times half the joint's
    range about its middle. The rows are hulls of position, velocity and acceleration, close to the
    curve: g groups of c follow each other in time (the last row of each kind fills its group).
    """
    kinds = [_grouped(basis.hull(order, _DENSITY) @ free) for order in range(3)]
    scales = (
        np.ones_like(limits.velocity),
        limits.half_range / limits.velocity,
        limits.half_range / limits.acceleration,
    )
    return np.concatenate(
        [scale[:, None, None, None] * kind for scale, kind in zip(scales, kinds, strict=True)],
        axis=1,
    )


def _grouped(rows: Array) -> Array:
    """Return rows (C, k) as (g, c, k), the last row repeated."""
    missing = -len(rows) % _GROUP
    return np.pad(rows, ((0, missing), (0, 0)), mode="edge").reshape(-1, _GROUP, rows.shape[1])


def margins(trajectory: Trajectory, limits: JointLimits) -> Margins:
    """Return the least distance of a trajectory to its limits; below zero where one is broken."""
    basis, c = trajectory.basis, trajectory.coefficients
    about_middle = c - np.outer(basis.constant, limits.middle)
    q, v, a = (
        np.min([np.abs(basis.hull(order, density) @ part).max(axis=0) for density in _DENSITIES], 0)
        for order, part in enumerate((about_middle, c, c))
    )
    return Margins(limits.half_range - q, limits.velocity - v, limits.acceleration - a)


def _values(robot: Robot, name: str, given: LimitValue, default: Array) -> Array:
    """Return one limit of all joints (n,), read-only."""
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
        if not np.isfinite(value):
            found = "missing" if given is None else f"{value}, which is not finite"
            raise ExcitationError(
                f"joint '{joint}' of '{robot.name}': {name} limit is {found}; give it by "
                f"Limits({name}=...), one number for all joints, one a joint or {{'{joint}': ...}}"
            )
    return values
