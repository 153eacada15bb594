"""The regressor of a drive, (10), derived by Algorithm 1 and evaluated over all samples at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp

from seaid.arrays import Array
from seaid.drivetrain.equations import (
    F_0,
    F_C,
    I_M,
    PARAMETER_NAMES,
    SIGNALS,
    DriveEquation,
    F_v,
    f_0,
    k,
    known_values,
    t,
)
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.symbolic import RegressorForm, separate

_ARGUMENTS = {
    signal.diff(t, order): f"{signal.func}{suffix}"
    for order, suffix in ((2, "_ddot"), (1, "_dot"), (0, ""))
    for signal in SIGNALS
}
"""Derivatives first, so that a substitution of the signal does not break them."""

_NOTHING = sp.Symbol("nothing")
"""Stands for the unknowns of an equation that has none, as an ideal drive's; has no column."""


@dataclass(frozen=True)
class DriveRegressor:
    """zeta = regressor @ parameters of one drive: names, units and the derived form (9).

    `form` is symbolic, with the known values (ratio, radii, rotor inertia) still as symbols.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    form: RegressorForm
    drive: Drive

    def evaluate(self, signals: Mapping[str, Array]) -> tuple[Array, Array]:
        """Return zeta (T,) and the regressor (T, p) over signals (T,).

        `signals` has "theta_M", "theta_M_dot", "theta_M_ddot", the same of "theta_L", "tau_M" and
        "tau_L"; only those in the equation are needed.
        """
        function, names = _compiled(
            self.form.zeta[0], tuple(self.form.regressor)[: len(self.names)]
        )
        values = {str(symbol): value for symbol, value in known_values(self.drive).items()}
        arguments = [values[name] if name in values else signals[name] for name in names]
        length = len(next(iter(signals.values())))
        columns = [np.broadcast_to(column, (length,)) for column in function(*arguments)]
        return np.array(columns[0], dtype=float), np.column_stack(
            [*columns[1:], np.empty((length, 0))]
        )


def drive_regressor(equation: DriveEquation, drive: Drive) -> DriveRegressor:
    """Derive the regressor of a drive's equation by Algorithm 1.

    Raises SymbolicError where the equation is not linear in its unknowns.
    """
    form = _separated(equation)
    columns = [
        (symbol, column)
        for symbol, column in zip(form.parameters, form.regressor, strict=True)
        if symbol != _NOTHING
    ]
    names = tuple(PARAMETER_NAMES.get(symbol, str(symbol)) for symbol, _ in columns)
    units = tuple(_unit(symbol, column, drive) for symbol, column in columns)
    return DriveRegressor(names, units, form, drive)


@cache
def _separated(equation: DriveEquation) -> RegressorForm:
    expression, unknowns = equation.expression, list(equation.unknowns)
    if not unknowns:
        expression, unknowns = expression + _NOTHING, [_NOTHING]
    return separate(expression, motion=list(SIGNALS), unknowns=unknowns)


@cache
def _compiled(zeta: sp.Expr, row: tuple[sp.Expr, ...]):  # type: ignore[no-untyped-def]
    expressions = [flat_names(entry) for entry in (zeta, *row)]
    names = sorted({str(symbol) for entry in expressions for symbol in entry.free_symbols})
    return sp.lambdify([sp.Symbol(name) for name in names], expressions, modules="numpy"), names


def _unit(symbol: sp.Expr, column: sp.Expr, drive: Drive) -> str:
    force = drive.force_unit if isinstance(drive, SeriesElasticDrive) else "N m"
    stiffness = drive.stiffness_unit if isinstance(drive, SeriesElasticDrive) else ""
    known = {F_v: "N m s/rad", F_C: "N m", F_0: "N m", k: stiffness, f_0: force, I_M: "kg m^2"}
    if symbol in known:
        return known[symbol]
    return f"N m/({flat_names(column)})"


def flat_names(expression: sp.Expr) -> sp.Expr:
    """Return an expression of signals with each as a plain symbol, as "theta_M_dot"."""
    flat = {signal: sp.Symbol(name) for signal, name in _ARGUMENTS.items()}
    return sp.sympify(expression).subs(flat)
