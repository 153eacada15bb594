"""Friction of a drive, and what acts beside it, with slopes: numbers of its terms along a plan."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp

from seaid.arrays import Array, FrozenMapping
from seaid.drivetrain.catalogue import PARAMETERS_OF
from seaid.drivetrain.equations import dry_friction, joint_equation, smooth_friction
from seaid.drivetrain.model import Drive, StiffDrive
from seaid.drivetrain.regressor import flat_names
from seaid.drivetrain.smooth import WIDTH, real_symbol, slope_of, smoothed
from seaid.drivetrain.symbols import PARAMETER_NAMES, N, tau_L, theta_M
from seaid.drivetrain.symbols import t as time_symbol
from seaid.drivetrain.values import check_divisors
from seaid.errors import ExcitationError


@dataclass(frozen=True)
class DriveCurve:
    """A torque as an expression of two `signals` and of `values` {parameter: value}.

    Plain data, which can be sent to other processes.
    """

    expression: sp.Expr
    signals: tuple[str, str]
    values: FrozenMapping[float]

    def evaluate(self, one: Array, other: Array, width: float) -> tuple[Array, Array, Array]:
        """Return the torque and its slopes by both signals, each (T,).

        Signs of speeds turn within `width` [rad/s or m/s].
        """
        function, names = _compiled(self.expression, self.signals)
        given = [self.values[name] for name in names]
        found = np.empty((3, *np.shape(one)))
        for line, entry in zip(found, function(one, other, width, *given), strict=True):
            line[...] = entry
        return found[0], found[1], found[2]


def friction_curve(joint: str, drive: Drive) -> DriveCurve:
    """Return the friction [N m] at the motor of its speed and the torque on what the drive turns.

    Extra terms are left out. Raises ExcitationError where a nominal value is missing.
    """
    return _curve(joint, drive, *_friction(drive))


def beside_curve(joint: str, drive: Drive) -> DriveCurve:
    """Return the torque of parallel spring and joint friction of the joint's position and speed.

    In N m, or N. Raises ExcitationError where a nominal value is missing.
    """
    beside = joint_equation(drive).expression + tau_L
    return _curve(joint, drive, beside, ("theta_L", "theta_L_dot"))


def beside_names(drive: Drive) -> tuple[str, ...]:
    """Return the parameters of what acts between the joint's bodies beside the drive."""
    return tuple(
        name
        for field in ("parallel_spring", "joint_friction")
        for term in getattr(drive, field, ())
        for name in PARAMETERS_OF[field][term]
    )


def no_value(joint: str, name: str) -> ExcitationError:
    """Return the error of a nominal value that is missing."""
    return ExcitationError(
        f"joint '{joint}': its drive has no nominal {name.replace('_', ' ')}; "
        "this criterion or limit needs one: give it in the drivetrains of load_robot"
    )


def _friction(drive: Drive) -> tuple[sp.Expr, tuple[str, str]]:
    """Return friction as if the drive was stiff: the load's torque stands for the spring's."""
    lever = drive.ratio * getattr(drive, "load_radius", 1.0) / getattr(drive, "motor_radius", 1.0)
    stiff = StiffDrive(friction=drive.friction)
    turning = dry_friction(stiff) * sp.sign(theta_M.diff(time_symbol))
    friction = smooth_friction(stiff) + turning
    return friction.subs(N, sp.Float(lever)), ("theta_M_dot", "tau_G")


def _curve(joint: str, drive: Drive, expression: sp.Expr, signals: tuple[str, str]) -> DriveCurve:
    flat = flat_names(expression)
    for name in _compiled(flat, signals)[1]:
        if name not in drive.values:
            raise no_value(joint, name)
    check_divisors(drive, drive.values)
    return DriveCurve(flat, signals, FrozenMapping(drive.values))


@cache
def _compiled(expression: sp.Expr, signals: tuple[str, str]):  # type: ignore[no-untyped-def]
    smooth = smoothed(expression)
    names = {str(symbol): name for symbol, name in PARAMETER_NAMES.items()}
    used = sorted({str(symbol) for symbol in smooth.free_symbols} & set(names))
    entries = [smooth, *(slope_of(smooth, signal) for signal in signals)]
    arguments = [real_symbol(name) for name in (*signals, str(WIDTH), *used)]
    function = sp.lambdify(arguments, entries, modules="numpy", cse=True)
    return function, [names[name] for name in used]
