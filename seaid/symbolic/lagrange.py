"""From a Lagrangian to equations of motion, by the rule of Euler and Lagrange."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef

from seaid.errors import SymbolicError

_State = dict[sp.Expr, sp.Dummy]


def equations_of_motion(
    lagrangian: Any,
    coordinates: Iterable[sp.Expr],
    forces: Iterable[Any],
    *,
    dissipation: Any = None,
) -> list[sp.Expr]:
    """Return the equations of motion, one expression a coordinate that is zero.

    Equation i is d/dt dL/dq_i' - dL/dq_i + dD/dq_i' - force_i, the form behind (5). `lagrangian` L
    is a sympy expression in the coordinates, functions of one time symbol, their first derivatives
    and any symbols; `forces` has one generalised force a coordinate (0, a symbol, any expression);
    `dissipation` D, for example F_v q'^2 / 2, is in the same terms as L. Coordinates may turn or
    slide, and are real. Any differentiable function of them is allowed; at the jumps of sign(x) the
    derivative is left out.

    Raises SymbolicError for a coordinate that is no function of time, is listed twice or never
    occurs with a derivative; for a wrong number of forces; for another function of time or a
    second derivative in the Lagrangian.
    """
    signals = _coordinates(coordinates)
    time = signals[0].args[0]
    applied = [_expression("a force", force) for force in _listed(forces)]
    if len(applied) != len(signals):
        raise SymbolicError(
            f"found {len(applied)} forces for {len(signals)} coordinates; give one a coordinate, 0 "
            "where none acts"
        )
    energy = _expression("the Lagrangian", lagrangian).doit()
    loss = _expression("the dissipation", 0 if dissipation is None else dissipation).doit()
    _check_functions({"the Lagrangian": energy, "the dissipation": loss}, signals)
    _check_derivatives(signals, (energy, loss, *applied))
    state = _state(signals, energy.free_symbols | loss.free_symbols)
    energy, loss = energy.xreplace(state), loss.xreplace(state)
    back = {dummy: expression for expression, dummy in state.items()}
    equations = []
    for signal, force in zip(signals, applied, strict=True):
        speed = state[signal.diff(time)]
        momentum = energy.diff(speed)
        terms = [
            momentum.diff(state.get(time, time)),
            -energy.diff(state[signal]),
            loss.diff(speed),
        ]
        for other in signals:
            for order in (0, 1):
                slope = momentum.diff(state[other.diff(time, order)])
                terms.append(slope * state[other.diff(time, order + 1)])
        left = sp.Add(*terms).replace(sp.DiracDelta, lambda *_: sp.Integer(0))
        equations.append(left.xreplace(back) - force)
    return equations


def _listed(given: Any) -> list[Any]:
    return [given] if isinstance(given, sp.Expr | int | float) else list(given)


def _expression(what: str, given: Any) -> sp.Expr:
    try:
        found = sp.sympify(given)
    except sp.SympifyError:
        found = given
    if isinstance(found, sp.MatrixBase) and found.shape == (1, 1):
        found = found[0, 0]
    if not isinstance(found, sp.Expr):
        raise SymbolicError(f"{what} must be a scalar sympy expression, found {given!r}")
    return found


def _coordinates(given: Iterable[sp.Expr]) -> tuple[sp.Expr, ...]:
    signals = tuple(_listed(given))
    if not signals:
        raise SymbolicError("there are no coordinates; give at least one function of time")
    for place, signal in enumerate(signals):
        ok = isinstance(signal, AppliedUndef) and len(signal.args) == 1
        if not (ok and signal.args[0].is_Symbol):
            raise SymbolicError(
                f"the coordinate {signal} is no function of time, so it has no derivatives; make "
                f"it one: Function('{signal}')(t)"
            )
        if signal.args != signals[0].args:
            raise SymbolicError(
                f"the coordinates {signals[0]} and {signal} have different times; use one symbol"
            )
        if signal in signals[:place]:
            raise SymbolicError(f"the coordinate {signal} is listed twice; list it once")
    return signals


def _check_functions(energies: dict[str, sp.Expr], signals: Sequence[sp.Expr]) -> None:
    """Refuse functions of time that are no coordinates, and accelerations."""
    allowed = ", ".join(map(str, signals))
    for what, energy in energies.items():
        for found in sorted(energy.atoms(AppliedUndef), key=str):
            if found not in signals and signals[0].args[0] in found.args:
                raise SymbolicError(
                    f"{what} holds {found}, which is not declared; the coordinates are {allowed}; "
                    f"add {found} to them, or make it a symbol if it is constant"
                )
        for found in sorted(energy.atoms(sp.Derivative), key=str):
            if found.expr in signals and found.derivative_count > 1:
                raise SymbolicError(
                    f"{what} holds {found}; only coordinates and their first derivatives are "
                    "allowed in it"
                )


def _check_derivatives(signals: Sequence[sp.Expr], expressions: Sequence[sp.Expr]) -> None:
    moving = {d.expr for expression in expressions for d in expression.atoms(sp.Derivative)}
    for signal in signals:
        if signal not in moving:
            raise SymbolicError(
                f"the coordinate {signal} occurs without derivatives: neither Lagrangian, "
                f"dissipation nor forces hold {signal.diff(signal.args[0])}; add its kinetic "
                "energy, or write its equation down without a Lagrangian"
            )


def _state(signals: Sequence[sp.Expr], symbols: set[sp.Symbol]) -> _State:
    """Map coordinates, their derivatives and all complex symbols to real dummies."""
    time = signals[0].args[0]
    moving = [signal.diff(time, order) for signal in signals for order in range(3)]
    state = {x: sp.Dummy(f"x{i}", real=True) for i, x in enumerate(moving)}
    state |= {s: sp.Dummy(s.name, real=True) for s in symbols if s.is_real is None}
    return state
