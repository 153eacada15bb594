"""Equations of motion from a Lagrangian: d/dt dL/dq' - dL/dq + dD/dq' = force."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef

from seaid.errors import SymbolicError
from seaid.symbolic.from_sympy import listed, scalar
from seaid.symbolic.generators import bottom_up, operands, prepared, subexpressions

_Rule = dict[sp.Expr, sp.Expr]


def equations_of_motion(
    lagrangian: Any,
    coordinates: Iterable[sp.Expr],
    forces: Iterable[Any],
    *,
    dissipation: Any = None,
    inputs: Iterable[sp.Expr] = (),
) -> list[sp.Expr]:
    """Derive the Euler-Lagrange equations of motion, the form behind (5) of the paper.

    Equation i is the expression d/dt dL/dq_i' - dL/dq_i + dD/dq_i' - force_i, which is zero.

    Parameters
    ----------
    lagrangian : sympy expression
        L = kinetic minus potential energy, in the coordinates, their first derivatives and any
        symbols. Any differentiable function is allowed; the derivative of sign(x) counts as zero.
    coordinates : sympy functions of one time symbol
        The n generalised coordinates, rotary or prismatic, taken as real.
    forces : n expressions
        Generalised force per coordinate; 0 where none acts.
    dissipation : sympy expression, optional
        Rayleigh's dissipation function D, for example F_v q'^2 / 2.
    inputs : sympy functions of the same time, optional
        Known signals in the Lagrangian that have no equation of their own, such as the place of a
        pivot that is moved, with derivatives of any order. `separate` has them in its `motion`.

    Returns
    -------
    list of sympy expressions
        The n equations, in the order of the coordinates, for `separate`.

    Raises
    ------
    SymbolicError
        For a coordinate or input that is not a function of time or is listed twice, and for a
        coordinate that never occurs with a derivative; for a wrong number of forces; for another
        function of time or a second derivative of a coordinate in the Lagrangian.

    Examples
    --------
    >>> t, m, g, tau = sympy.symbols("t m g tau")
    >>> q = sympy.Function("q")(t)
    >>> equations_of_motion(m * q.diff(t) ** 2 / 2 - m * g * q, [q], [tau])
    [g*m + m*Derivative(q(t), (t, 2)) - tau]
    """
    signals = _functions("coordinate", coordinates)
    if not signals:
        raise SymbolicError("there are no coordinates; give at least one function of time")
    known = _functions("input", inputs, signals)
    time = signals[0].args[0]
    applied = [scalar("a force", force) for force in listed(forces)]
    if len(applied) != len(signals):
        raise SymbolicError(
            f"found {len(applied)} forces for {len(signals)} coordinates; give one per coordinate, "
            "0 where none acts"
        )
    energy = prepared(scalar("the Lagrangian", lagrangian))
    loss = prepared(scalar("the dissipation", 0 if dissipation is None else dissipation))
    _check_functions({"the Lagrangian": energy, "the dissipation": loss}, signals, known)
    _check_derivatives(signals, (energy, loss, *applied))
    # d/dt is the derivation t -> 1, q -> q', q' -> q'' ...
    in_time: _Rule = {time: sp.Integer(1)}
    # Inputs may have derivatives of any order: d/dt needs the next one of each.
    rates = _parts(energy, sp.Derivative)
    highest = max((int(x.derivative_count) for x in rates), default=0)
    for signal in (*signals, *known):
        in_time |= {signal.diff(time, k): signal.diff(time, k + 1) for k in range(highest + 1)}
    memory: dict[sp.Expr, sp.Expr] = {}
    equations = []
    for signal, force in zip(signals, applied, strict=True):
        along, by_speed = {signal: sp.Integer(1)}, {signal.diff(time): sp.Integer(1)}
        momentum = _derived(energy, by_speed, {})
        equations.append(
            _derived(momentum, in_time, memory)
            - _derived(energy, along, {})
            + _derived(loss, by_speed, {})
            - force
        )
    return equations


def _derived(expression: sp.Expr, rule: _Rule, memory: dict[sp.Expr, sp.Expr]) -> sp.Expr:
    """Return the derivation of `expression` that maps each variable of `rule` to its value there.

    Each shared subexpression is differentiated once, which sympy's own `diff` does not do.
    """
    for part in bottom_up(expression, memory, operands):
        memory[part] = _derived_part(part, rule, memory)
    return memory[expression]


def _derived_part(part: sp.Expr, rule: _Rule, memory: dict[sp.Expr, sp.Expr]) -> sp.Expr:
    """Differentiate an expression whose operands have been differentiated."""
    if part in rule:
        return rule[part]
    # q and q' are independent variables of L: each is a constant for the other.
    if not part.args or _is_rate(part):
        return sp.Integer(0)
    slopes = [memory[operand] for operand in operands(part)]
    if part.is_Add:
        return sp.Add(*slopes)
    if part.is_Mul:
        numbered, args = enumerate(slopes), part.args
        return sp.Add(*(sp.Mul(*args[:i], x, *args[i + 1 :]) for i, x in numbered if x))
    if slopes:
        return part.exp * part.base ** (part.exp - 1) * slopes[0]
    return _derived_function(part, rule)


def _is_rate(expression: sp.Expr) -> bool:
    """Whether this is a derivative with respect to time, not the slope of some f(q)."""
    return isinstance(expression, sp.Derivative) and expression.variables[0].is_Symbol


def _derived_function(function: sp.Expr, rule: _Rule) -> sp.Expr:
    """Differentiate one function by sympy's chain rule, with real variables and symbols."""
    parts = subexpressions(function)
    # Real dummies: of real symbols sympy derives |x| and sign(x) without complex parts.
    variables = {x: sp.Dummy("x", real=True) for x in rule if x in parts}
    symbols = {x for x in parts if x.is_Symbol and x.is_real is None and x not in variables}
    real = variables | {x: sp.Dummy(x.name, real=True) for x in symbols}
    back = {dummy: x for x, dummy in real.items()}
    smooth = function.xreplace(real)
    slopes = (smooth.diff(dummy).xreplace(back) * rule[x] for x, dummy in variables.items())
    return sp.Add(*slopes).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


def _functions(
    kind: str, functions: Iterable[sp.Expr], others: tuple[sp.Expr, ...] = ()
) -> tuple[sp.Expr, ...]:
    """Check the coordinates or the inputs, which are not among the `others`, and return them."""
    signals = tuple(listed(functions))
    for place, signal in enumerate(signals):
        ok = isinstance(signal, AppliedUndef) and len(signal.args) == 1
        if not (ok and signal.args[0].is_Symbol):
            raise SymbolicError(
                f"the {kind} {signal} is not a function of time, so it has no derivatives; "
                f"make it one: Function('{signal}')(t)"
            )
        first = (*others, *signals)[0]
        if signal.args != first.args:
            raise SymbolicError(
                f"{first} and the {kind} {signal} have different times; use one symbol"
            )
        if signal in (*others, *signals[:place]):
            raise SymbolicError(f"the {kind} {signal} is listed twice; list it once")
    return signals


def _check_functions(
    energies: dict[str, sp.Expr], signals: Sequence[sp.Expr], inputs: Sequence[sp.Expr]
) -> None:
    """Refuse functions of time that are not declared, and accelerations of coordinates."""
    allowed = ", ".join(map(str, signals))
    for what, energy in energies.items():
        for function in _parts(energy, AppliedUndef):
            if function not in (*signals, *inputs) and signals[0].args[0] in function.args:
                raise SymbolicError(
                    f"{what} contains {function}, which is not declared; the coordinates are "
                    f"{allowed}; add {function} to them, or to inputs= if its motion is "
                    "prescribed, or make it a symbol if it is constant"
                )
        for derivative in _parts(energy, sp.Derivative):
            if derivative.expr in signals and derivative.derivative_count > 1:
                raise SymbolicError(
                    f"{what} contains {derivative}; only coordinates and their first derivatives "
                    "are allowed in it"
                )


def _parts(expression: sp.Expr, kind: type[sp.Basic]) -> list[sp.Expr]:
    return sorted((x for x in subexpressions(expression) if isinstance(x, kind)), key=str)


def _check_derivatives(signals: Sequence[sp.Expr], expressions: Sequence[sp.Expr]) -> None:
    moving = {d.expr for expression in expressions for d in _parts(expression, sp.Derivative)}
    for signal in signals:
        if signal not in moving:
            raise SymbolicError(
                f"the coordinate {signal} occurs without derivatives: neither Lagrangian, "
                f"dissipation nor forces contain {signal.diff(signal.args[0])}; add its kinetic "
                "energy, or write its equation down without a Lagrangian"
            )
