"""The regressor of a drive, (10), derived by Algorithm 1 and evaluated over all samples at once.

An equation e(p) = 0 that is nonlinear in its parameters is linearised at given values p_0:
e(p) ~ e(p_0) + de/dp (p - p_0), which is a regressor as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import sympy as sp

from seaid._arrays import Array
from seaid.drives.drives import Drive, unit_of
from seaid.drives.equations import (
    NAMES_OF,
    PARAMETER_NAMES,
    SIGNALS,
    Dahl,
    DriveEquation,
    known_values,
    symbol_of,
)
from seaid.drives.terms import ParameterName, parameter_named
from seaid.errors import RobotError
from seaid.symbolic import separate

_SIGN = "theta_M_sign"
"""Sign of the motor speed, or its mean about each sample, if the signals have it."""


@dataclass(frozen=True)
class DriveRegressor:
    """The regressor form (9), zeta = row @ parameters, of one drive equation.

    `zeta` and `row` (p,) are expressions of the signals, with the known values (ratio, radii, rotor
    inertia) as symbols. `non_linear` names the parameters that must be given for the equation to
    be linear in the others; their columns are derivatives at the drive's values. `joint` is the
    drive's, for messages.
    """

    names: tuple[ParameterName, ...]
    units: tuple[str, ...]
    zeta: sp.Expr
    row: tuple[sp.Expr, ...]
    drive: Drive
    non_linear: tuple[str, ...] = ()
    joint: str = ""

    @cached_property
    def signals(self) -> set[str]:
        """Names of the signals in the equation."""
        return _symbols_in(self.zeta, self.row) & set(NAMES_OF.values())

    @cached_property
    def known(self) -> dict[str, float]:
        """The known values of the drive by their symbols: ratio, radii, what `known` names."""
        return {str(symbol): value for symbol, value in known_values(self.drive).items()}

    @property
    def linear(self) -> tuple[str, ...]:
        """The parameters in which the equation is linear once `non_linear` are given."""
        return tuple(name for name in self.names if name not in self.non_linear)

    def evaluate(
        self, signals: Mapping[str, Array], values: Mapping[str, float] | None = None
    ) -> tuple[Array, Array]:
        """Return zeta (T,) and the regressor (T, p), linearised where necessary.

        `signals` {name: (T,)} needs those named in `signals` only, as "theta_M_ddot" or "tau_L";
        "theta_M_sign" replaces the sign of the motor speed at the samples.
        `values` {parameter: value} override the drive's as point of linearisation. Raises
        RobotError naming a nonlinear parameter without a value.
        """
        near = self.drive.values if values is None else {**self.drive.values, **values}
        zeta, R = _evaluate(self, signals, near, self.names)
        nonlinear = [self.names.index(name) for name in self.non_linear]
        # 0 = e(p_0) + de/dp (p - p_0), so zeta = -e(p_0) + de/dp p_0.
        return zeta + R[:, nonlinear] @ [near[name] for name in self.non_linear], R

    def given(
        self, signals: Mapping[str, Array], values: Mapping[str, float]
    ) -> tuple[Array, Array]:
        """Return zeta (T,) and the columns (T, l) of `linear`, exact for `values` of the others."""
        return _evaluate(self, signals, values, self.linear)

    def columns(
        self, signals: Mapping[str, Array], values: Mapping[str, float], names: Sequence[str]
    ) -> Array:
        """Return the columns (T, names) of some parameters, the derivatives at `values`."""
        return _evaluate(self, signals, values, tuple(names))[1]


def drive_regressor(equation: DriveEquation, drive: Drive, joint: str = "") -> DriveRegressor:
    """Derive the regressor of a drive's equation by Algorithm 1; if nonlinear, by derivatives."""
    zeta, parameters, row, nonlinear = _derived(equation, drive.parameter_names)
    return DriveRegressor(
        names=tuple(ParameterName(PARAMETER_NAMES.get(x, str(x))) for x in parameters),
        units=tuple(
            _unit(symbol, column, drive) for symbol, column in zip(parameters, row, strict=True)
        ),
        zeta=zeta,
        row=row,
        drive=drive,
        non_linear=tuple(PARAMETER_NAMES.get(symbol, str(symbol)) for symbol in nonlinear),
        joint=joint,
    )


_Row = tuple[sp.Expr, ...]


@cache
def _derived(
    equation: DriveEquation, parameter_names: tuple[str, ...]
) -> tuple[sp.Expr, _Row, _Row, _Row]:
    """Return zeta, parameters, row and nonlinear parameters of the equation of a kind of drive.

    They do not depend on the values of a drive, so that drives of a kind share them.
    """
    drive_symbols = PARAMETER_NAMES.keys() | set(map(symbol_of, parameter_names))
    nonlinear = non_linear(equation)
    has_memory = equation.expression.has(Dahl)
    # Nonlinear unknowns of extra terms are for Algorithm 1: it lumps products, and refuses the
    # rest.
    if (nonlinear or has_memory) and drive_symbols >= set(nonlinear):
        row = tuple(_slope(equation.expression, symbol) for symbol in equation.unknowns)
        # zeta is minus the equation without the parameters in which it is linear.
        linear = [symbol for symbol in equation.unknowns if symbol not in nonlinear]
        zeta = -flat_names(equation.expression).xreplace(dict.fromkeys(linear, sp.Integer(0)))
        return zeta, equation.unknowns, row, nonlinear
    return *_separated(equation), ()


@cache
def _symbols_in(zeta: sp.Expr, row: _Row) -> set[str]:
    """Return the names of the symbols in the entries of a row."""
    return {str(symbol) for entry in (zeta, *row) for symbol in flat_names(entry).free_symbols}


@cache
def non_linear(equation: DriveEquation) -> tuple[sp.Symbol, ...]:
    """Return the unknowns that must be given for the equation to be linear in the others.

    These are the unknowns p with p in de/dp, and then those that remain in other derivatives.
    """
    slopes = {symbol: _slope(equation.expression, symbol) for symbol in equation.unknowns}
    nonlinear = [symbol for symbol, slope in slopes.items() if symbol in slope.free_symbols]
    for symbol, slope in slopes.items():
        others = slope.free_symbols & set(slopes) - {symbol, *nonlinear}
        if symbol not in nonlinear and others:
            nonlinear += sorted(others, key=str)
    return tuple(symbol for symbol in slopes if symbol in nonlinear)


@cache
def _slope(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative by a parameter, for real signals."""
    # The equations of drives have terms, and factors of these, in common.
    if expression.is_Add:
        return sp.Add(*(_slope(x, symbol) for x in expression.args if x.has(symbol)))
    factor, remaining = expression.as_independent(symbol, as_Add=False)
    slope = slope_by(of_real(remaining), symbol) if factor == 1 else _slope(remaining, symbol)
    return of_real(factor) * slope


def slope_by(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative of an expression of real symbols; that of a step is 0."""
    return expression.diff(symbol).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


@cache
def of_real(expression: sp.Expr) -> sp.Expr:
    """Return a flat expression of real signals: else sympy derives |x| by real and imaginary x."""
    real = {sp.Symbol(name): sp.Symbol(name, real=True) for name in NAMES_OF.values()}
    return flat_names(expression).xreplace(real)


def _separated(equation: DriveEquation) -> tuple[sp.Expr, _Row, _Row]:
    expression, unknowns = equation.expression, list(equation.unknowns)
    if not unknowns:
        return -expression, (), ()
    form = separate(expression, motion=list(SIGNALS), unknowns=unknowns)
    parameters, row = tuple(form.parameters), tuple(form.regressor)
    factor = _factor(expression, parameters, row)
    if factor.free_symbols & {sp.Symbol(name) for name in NAMES_OF.values()}:
        # the form is divided by a function of the motion, which may be zero: a dead zone
        slopes = tuple(_slope(expression, symbol) for symbol in unknowns)
        return -flat_names(expression).subs(dict.fromkeys(unknowns, 0)), tuple(unknowns), slopes
    return factor * form.zeta[0], parameters, tuple(factor * entry for entry in row)


def _factor(
    expression: sp.Expr, parameters: tuple[sp.Expr, ...], row: tuple[sp.Expr, ...]
) -> sp.Expr:
    """Return the factor that gives a row of (9) the scale of the equation, N m at the motor.

    Algorithm 1 fixes the scale of a row by its own rule, see `seaid.symbolic.separate`.
    """
    pairs = [pair for pair in zip(parameters, row, strict=True) if pair[0].is_Symbol]
    if not pairs:
        return sp.Integer(1)
    parameter, entry = min(pairs, key=lambda pair: pair[1].count_ops())
    # de/dp over the entry of one p: the factor is the same for all of a row.
    slope = expression.diff(parameter)
    return sp.cancel(flat_names(slope) / flat_names(entry))


def _evaluate(
    regressor: DriveRegressor,
    signals: Mapping[str, Array],
    near: Mapping[str, float],
    wanted: tuple[str, ...],
) -> tuple[Array, Array]:
    """Return zeta (T,) and the columns (T, wanted), with nonlinear parameters at `near`."""
    columns = tuple(regressor.row[regressor.names.index(name)] for name in wanted)
    function, names = _compiled(regressor.zeta, columns)
    inputs = dict(signals) | {symbol_of(name).name: value for name, value in near.items()}
    inputs |= regressor.known
    if _SIGN in names and _SIGN not in inputs:
        inputs[_SIGN] = np.sign(inputs["theta_M_dot"])
    missing = [name for name in names if name not in inputs]
    if missing:
        raise _without_value(regressor.joint, missing[0])
    table = np.empty((1 + len(wanted), len(next(iter(signals.values())))))
    arguments = [inputs[name] for name in names]
    # An entry may be one number, which is repeated over the samples.
    for line, entry in zip(table, function(*arguments), strict=True):
        line[:] = entry
    return table[0], np.ascontiguousarray(table[1:].T)


def _without_value(joint: str, symbol: str) -> RobotError:
    """Return the error of a nonlinear parameter without a value."""
    named = {str(symbol): name for symbol, name in PARAMETER_NAMES.items()}
    drive = f"the drive of '{joint}'" if joint else "the drive"
    return RobotError(
        f"the equation of {drive} is nonlinear in its parameters: "
        f"{named.get(symbol, symbol)} needs an initial value"
    )


def _sampled(expression: sp.Expr) -> sp.Expr:
    """Return an expression with sign(w) of the motor as a signal, which may be a mean of it."""

    def signal(x: sp.Expr) -> sp.Expr:
        return sp.Symbol(_SIGN) if str(x) == "theta_M_dot" else sp.sign(x)

    sampled: sp.Expr = flat_names(expression).replace(sp.sign, signal)
    return sampled


@cache
def _compiled(zeta: sp.Expr, row: _Row) -> Compiled:
    return compiled([_sampled(entry) for entry in (zeta, *row)])


Compiled = tuple[Callable[..., list[Array]], list[str]]
"""A function of samples, and the names of its arguments in order."""


def compiled(entries: Sequence[sp.Expr]) -> Compiled:
    """Return expressions as a function of their symbols over samples, and the names of these."""
    by_name = {str(symbol): symbol for entry in entries for symbol in entry.free_symbols}
    names = sorted(by_name)
    return sp.lambdify([by_name[x] for x in names], entries, modules="numpy", cse=True), names


def _unit(symbol: sp.Expr, column: sp.Expr, drive: Drive) -> str:
    if symbol in PARAMETER_NAMES:
        return unit_of(drive, PARAMETER_NAMES[symbol])
    if str(symbol) in drive.parameter_names:  # k times an error of the deflection, or a torque
        is_force = parameter_named(str(symbol)).unit == "L"
        return drive.spring_units[0] if is_force else "N m"
    return f"N m/({flat_names(column)})"


def flat_names(expression: sp.Expr) -> sp.Expr:
    """Return an expression with each signal or derivative as a symbol such as "theta_M_dot"."""
    flat = {signal: sp.Symbol(name) for signal, name in NAMES_OF.items()}
    return expression.xreplace(flat)
