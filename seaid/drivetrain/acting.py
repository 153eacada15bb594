"""What a drive's terms do while it moves: its equations as numbers of its state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp

from seaid.arrays import Array
from seaid.drivetrain.catalogue import key_of
from seaid.drivetrain.equations import (
    dry_friction,
    joint_equation,
    smooth_friction,
    spring_force,
)
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.drivetrain.regressor import flat_names
from seaid.drivetrain.symbols import PARAMETER_NAMES, SYMBOLS, known_values, tau_L
from seaid.drivetrain.values import check_divisors, is_dry, unit_of
from seaid.errors import RobotError

Acting = Callable[..., float]
"""Of motor angle and speed, joint position and speed, and torque through the gear."""

_STATE = ("theta_M", "theta_M_dot", "theta_L", "theta_L_dot", "tau_G")
_PLAIN_FRICTION = {"viscous", "coulomb"}


@dataclass(frozen=True, eq=False)
class ActingDrive:
    """The terms of a drive with its values.

    `friction` [N m] at the motor, which cannot hold it, `level` [N m] of the friction that can,
    `force` of the spring (zero of a stiff drive), `beside` of the joint's own position and speed:
    what acts between its bodies beside the drive [N m or N] and cannot hold it, `joint_level` of
    the friction there that can. `is_under_load`: the friction of a stiff drive depends on the
    torque through its gear.
    """

    friction: Acting
    level: Acting
    force: Acting
    beside: Callable[[float, float], float]
    joint_level: float
    is_dry: bool
    is_under_load: bool


def is_plain(drive: Drive) -> bool:
    """Tell whether a drive has viscous and Coulomb friction and a linear spring at most."""
    spring = getattr(drive, "spring", ("linear",))
    beside = (*drive.parallel_spring, *getattr(drive, "joint_friction", ()))
    return set(drive.friction) <= _PLAIN_FRICTION and spring == ("linear",) and not beside


@cache
def acting_drive(drive: Drive) -> ActingDrive:
    """Return the terms of a drive with its values.

    The deflection offset of a linear spring without preload does not act: it is what unknown
    encoder zeros leave. A deflection zero that is not given is zero. Raises RobotError naming a
    parameter without a value by its key.
    """
    level = _with_values(drive, dry_friction(drive))
    friction = _with_values(drive, smooth_friction(drive))
    force = sp.Integer(0)
    if isinstance(drive, SeriesElasticDrive):
        force = _with_values(drive, spring_force(drive))
    beside = _with_values(drive, joint_equation(drive).expression + tau_L)
    smooth = beside.replace(sp.sign, lambda _: sp.Integer(0))
    position, speed = sp.symbols("theta_L theta_L_dot")
    return ActingDrive(
        friction=_function(friction),
        level=_function(level),
        force=_function(force),
        beside=sp.lambdify([position, speed], smooth, modules="math"),
        joint_level=float(beside.coeff(sp.sign(speed))),
        is_dry=is_dry(drive),
        is_under_load=not isinstance(drive, SeriesElasticDrive) and "load" in drive.friction,
    )


@dataclass(frozen=True, eq=False)
class SpringCurve:
    """The force of a spring at rest and its slope, as functions of the stretch (any shape).

    The stretch is r_M/N theta_M - r_L theta_L.
    """

    force: Callable[[Array], Array]
    slope: Callable[[Array], Array]


@cache
def spring_curve(drive: SeriesElasticDrive) -> SpringCurve:
    """Return the curve of a drive's spring with its values, without damping.

    Raises RobotError naming a parameter without a value by its key.
    """
    stretch = sp.Symbol("stretch", real=True)
    undamped = [term for term in drive.spring if term != "damping"]
    force = _with_values(drive, spring_force(drive), needed=undamped)
    zero = {sp.Symbol(name): 0 for name in _STATE}
    turned = stretch * drive.ratio / drive.motor_radius
    curve = force.subs({**zero, sp.Symbol("theta_M"): turned})
    slope = curve.diff(stretch)
    return SpringCurve(_vectorised(stretch, curve), _vectorised(stretch, slope))


def stretch_of(curve: SpringCurve, force: Array) -> Array:
    """Return the stretch at which a spring has a force, any shape; bisected from the zero outward.

    Within a dead zone it is one of its ends. Raises RobotError where the spring never has it.
    """
    most, least = float(np.max(force)), float(np.min(force))
    bound = 1e-6
    while not np.all(_reaches(curve, bound, least, most)):
        bound *= 1.2
        if bound > 1e6:
            raise RobotError(
                f"its spring never pulls with {least:.4g} to {most:.4g}: check the nominal values "
                "of its terms"
            )
    low, high = np.full_like(force, -bound), np.full_like(force, bound)
    for _ in range(70):
        middle = 0.5 * (low + high)
        short = curve.force(middle) < force
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return 0.5 * (low + high)


def _reaches(curve: SpringCurve, bound: float, least: float, most: float) -> tuple[bool, bool]:
    low, high = curve.force(np.array([-bound, bound]))
    return bool(low <= least), bool(high >= most)


def _with_values(drive: Drive, expression: sp.Expr, needed: list[str] | None = None) -> sp.Expr:
    """Return an expression of flat states with the drive's values in it."""
    flat = flat_names(expression).subs(known_values(drive))
    values = dict(drive.values)
    if "preload" not in getattr(drive, "spring", ()):
        values["deflection_offset"] = 0.0
    values.setdefault("deflection_zero", 0.0)
    check_divisors(drive, values)
    if needed is not None and "damping" not in needed:
        values["spring_damping"] = 0.0
    for symbol in sorted(flat.free_symbols & set(PARAMETER_NAMES), key=str):
        name = PARAMETER_NAMES[symbol]
        if name not in values:
            raise RobotError(
                f"'{key_of(name, unit_of(drive, name))}' is not given; a simulation needs a "
                "nominal value"
            )
    return flat.subs({SYMBOLS[name]: value for name, value in values.items()})


def _function(expression: sp.Expr) -> Acting:
    arguments = [sp.Symbol(name) for name in _STATE]
    return sp.lambdify(arguments, expression, modules="math", cse=True)  # type: ignore[no-any-return]


def _vectorised(argument: sp.Symbol, expression: sp.Expr) -> Callable[[Array], Array]:
    plain = sp.lambdify(argument, expression, modules="numpy")
    return lambda values: np.broadcast_to(plain(values), np.shape(values)).astype(float)
