"""Columns of a drive's regressor with their slopes: what a search with gradients needs of (10)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp

from seaid.arrays import Array, FrozenMapping
from seaid.drivetrain.equations import motor_equation
from seaid.drivetrain.model import Drive
from seaid.drivetrain.regressor import DriveRegressor, flat_names
from seaid.drivetrain.symbols import PARAMETER_NAMES, SYMBOLS, K_t, K_u, N, known_values, r_L, r_M
from seaid.drivetrain.values import check_divisors

STATES = ("theta_M", "theta_M_dot", "theta_M_ddot", "theta_L", "theta_L_dot", "theta_L_ddot")
SMOOTH_SIGNALS = (*STATES, "tau_G")
"""What the columns are differentiated by, in this order; `tau_G` is the torque on the load."""

WIDTH = sp.Symbol("sign_width", real=True)
"""Speed within which the sign of a speed turns, in `smoothed` expressions."""

_POSITIVE = {str(symbol) for symbol in (N, r_M, r_L, *PARAMETER_NAMES) if symbol.is_positive}
_SPEEDS = {"theta_M_dot", "theta_L_dot"}
_NAMES = {str(symbol): name for symbol, name in PARAMETER_NAMES.items()}


@dataclass(frozen=True)
class SmoothColumns:
    """The columns of a drive's regressor as expressions of `SMOOTH_SIGNALS` and `known` values.

    Plain data, which can be sent to other processes.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    row: tuple[sp.Expr, ...]
    known: FrozenMapping[float]

    @property
    def missing(self) -> tuple[str, ...]:
        """The parameters near whose values the columns are taken, and that have none."""
        symbols = {str(symbol) for entry in self.row for symbol in entry.free_symbols}
        return tuple(name for key, name in _NAMES.items() if key in symbols - set(self.known))

    def evaluate(self, signals: Mapping[str, Array], sign_width: float) -> tuple[Array, Array]:
        """Return the columns (T, p) and their slopes (T, p, 7) by `SMOOTH_SIGNALS`, each (T,).

        As `DriveRegressor.evaluate`, with the sign of a speed as tanh(speed / sign_width), so that
        friction has a slope. A signal that is in no column may be left out.
        """
        function, names = _compiled_slopes(self.row)
        known = {**self.known, str(WIDTH): sign_width}
        arguments = [known[name] if name in known else signals[name] for name in names]
        p, length = len(self.row), len(next(iter(signals.values())))
        table = np.empty((p * (1 + len(SMOOTH_SIGNALS)), length))
        for line, entry in zip(table, function(*arguments), strict=True):
            line[:] = entry
        return table[:p].T, table[p:].reshape(p, len(SMOOTH_SIGNALS), length).transpose(2, 0, 1)


def smooth_columns(regressor: DriveRegressor) -> SmoothColumns:
    """Return the columns of a drive's regressor with slopes.

    Current and voltage are those that the drive needs for its motion, with its values; zeros of
    encoders are zero where they are not given.
    """
    row = tuple(_with_input(flat_names(entry), regressor.drive) for entry in regressor.row)
    values = {"deflection_zero": 0.0, "deflection_offset": 0.0, **regressor.drive.values}
    if "preload" not in getattr(regressor.drive, "spring", ("preload",)):
        values["deflection_offset"] = 0.0
    check_divisors(regressor.drive, values)
    known = {str(SYMBOLS[name]): value for name, value in values.items()}
    known |= {str(symbol): value for symbol, value in known_values(regressor.drive).items()}
    return SmoothColumns(regressor.names, regressor.units, row, FrozenMapping(known))


def _with_input(entry: sp.Expr, drive: Drive) -> sp.Expr:
    """Return a flat column in which current or voltage follow from the motor equation (7)."""
    constants = {"i_M": K_t, "u_M": K_u}
    asked = [symbol for symbol in entry.free_symbols if str(symbol) in constants]
    if not asked:
        return entry
    needed = flat_names(motor_equation(drive).expression)
    nothing = dict.fromkeys(map(sp.Symbol, constants), 0)
    needed = needed.subs({**nothing, sp.Symbol("tau_L"): sp.Symbol("tau_G")})
    return entry.subs({symbol: needed / constants[str(symbol)] for symbol in asked})


def smoothed(expression: sp.Expr) -> sp.Expr:
    """Return a flat expression of real symbols in which the signs of speeds turn within `WIDTH`."""
    real = {symbol: real_symbol(str(symbol)) for symbol in expression.free_symbols}
    return expression.xreplace(real).replace(sp.sign, _turning)


def slope_of(expression: sp.Expr, name: str) -> sp.Expr:
    """Return the derivative of a smoothed expression by a signal; a step has none."""
    slope = expression.diff(real_symbol(name))
    return slope.replace(sp.DiracDelta, lambda *_: sp.Integer(0))


def real_symbol(name: str) -> sp.Symbol:
    """Return the symbol of a signal or parameter in `smoothed` expressions."""
    return sp.Symbol(name, positive=True) if name in _POSITIVE else sp.Symbol(name, real=True)


def _turning(x: sp.Expr) -> sp.Expr:
    of_speed = {str(symbol) for symbol in x.free_symbols & set(map(real_symbol, SMOOTH_SIGNALS))}
    return sp.tanh(x / WIDTH) if of_speed and of_speed <= _SPEEDS else sp.sign(x)


@cache
def _compiled_slopes(row: tuple[sp.Expr, ...]):  # type: ignore[no-untyped-def]
    smooth = [smoothed(entry) for entry in row]
    entries = [*smooth, *(slope_of(entry, signal) for entry in smooth for signal in SMOOTH_SIGNALS)]
    names = sorted({str(symbol) for entry in entries for symbol in entry.free_symbols})
    arguments = [real_symbol(name) for name in names]
    return sp.lambdify(arguments, entries, modules="numpy", cse=True), names
