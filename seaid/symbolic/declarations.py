"""What the caller declares: equations, motion and unknowns, checked before any work starts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef

from seaid.errors import SymbolicError
from seaid.symbolic.functions import subexpressions


def declared(
    equations: Any, motion: Any, unknowns: Any
) -> tuple[list[sp.Expr], tuple[sp.Expr, ...], tuple[sp.Symbol, ...]]:
    """Return the three arguments as sequences. Raises SymbolicError for what cannot be used."""
    expressions = [scalar("an equation", equation) for equation in listed(equations)]
    signals = tuple(m.expr if isinstance(m, sp.Derivative) else m for m in listed(motion))
    symbols = tuple(listed(unknowns))
    for kind, given in (("equations", expressions), ("motion", signals), ("unknowns", symbols)):
        if not given:
            raise SymbolicError(f"{kind} is empty; give at least one")
    for signal in signals:
        if not isinstance(signal, sp.Symbol | AppliedUndef):
            raise SymbolicError(
                f"motion holds {signal!r}; allowed are functions of time such as Function('q')(t), "
                "and symbols"
            )
    for place, symbol in enumerate(symbols):
        if not isinstance(symbol, sp.Symbol):
            raise SymbolicError(f"unknowns holds {symbol!r}; allowed are sympy symbols")
        if symbol in symbols[:place]:
            raise SymbolicError(f"the unknown {symbol} is listed twice; list it once")
        if any(symbol == signal or signal.has(symbol) for signal in signals):
            raise SymbolicError(
                f"{symbol} is both unknown and known: it stands in unknowns and in motion; take it "
                "out of one of them"
            )
    _check_names(expressions, (*signals, *symbols))
    return expressions, signals, symbols


def listed(given: Any) -> list[Any]:
    """Return one expression, or several in a list, a tuple or a matrix, as a list."""
    several = isinstance(given, Iterable | sp.MatrixBase)
    return list(given) if several and not isinstance(given, str) else [given]


def scalar(what: str, given: Any) -> sp.Expr:
    """Return a scalar sympy expression. Raises SymbolicError naming `what` otherwise."""
    try:
        found = sp.sympify(given, strict=True)
    except sp.SympifyError:
        found = given
    if isinstance(found, sp.MatrixBase) and found.shape == (1, 1):
        found = found[0, 0]
    if isinstance(found, sp.Eq):
        found = found.lhs - found.rhs
    if not isinstance(found, sp.Expr) or found.is_Matrix:
        raise SymbolicError(f"{what} must be a scalar sympy expression, found {given!r}")
    return found


def _check_names(expressions: Sequence[sp.Expr], declared: Sequence[sp.Expr]) -> None:
    """Refuse two different symbols of one name, a declared one and one of the equations."""
    names = {str(x): x for x in declared}
    for number, expression in enumerate(expressions, 1):
        for found in subexpressions(expression):
            if not isinstance(found, sp.Symbol | AppliedUndef):
                continue
            twin = names.get(str(found), found)
            if twin != found:
                raise SymbolicError(
                    f"equation {number} holds a {found} that is not the declared {twin}: they "
                    "share the name but not the assumptions (real, positive ...); make it once and "
                    "use it everywhere"
                )
