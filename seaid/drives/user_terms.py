"""Extra terms of a drive: a user's text, added to the motor equation (7)."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache

import sympy as sp

from seaid.drives.drives import Drive
from seaid.drives.symbols import (
    F_0,
    F_C,
    I_M,
    PARAMETER_NAMES,
    STATES,
    F_v,
    N,
    f_0,
    k,
    known_values,
    r_L,
    r_M,
)
from seaid.errors import RobotError, SymbolicError, shortened, shown, unknown_name
from seaid.symbolic import expression_of


def extra_terms(drive: Drive) -> list[sp.Expr]:
    """Return the drive's extra terms as expressions of torque [N m] at the motor.

    A term is a text such as "c*theta_M'**3" or "c*theta_M_dot**3". Names other than those of
    STATES, N, r_M, r_L and I_M are unknown parameters. Raises RobotError for any other text.
    """
    return [_expression(text) for text in drive.extra_terms]


_NAMES = {
    "pi": sp.pi,
    **STATES,
    **{str(symbol): symbol for symbol in (N, r_M, r_L, F_v, F_C, F_0, k, f_0, I_M)},
}
_TAKEN = {*PARAMETER_NAMES.values(), *map(str, PARAMETER_NAMES)}
_PLAIN = ("atan", "cos", "cosh", "exp", "log", "sign", "sin", "sinh", "sqrt", "tan", "tanh")
_FUNCTIONS = {"abs": sp.Abs, **{name: getattr(sp, name) for name in _PLAIN}}


@lru_cache(maxsize=256)
def _expression(text: str) -> sp.Expr:
    """Return one extra term as an expression."""
    plain = re.sub(r"(theta_[ML])''", r"\1_ddot", text)
    plain = re.sub(r"(theta_[ML])'", r"\1_dot", plain)
    try:
        return expression_of(plain, _symbol, _FUNCTIONS)
    except SymbolicError as problem:
        reason = str(problem)
    joint = " " if reason.startswith(("is ", "has ")) else ": "
    raise RobotError(f"extra term '{shortened(text)}'{joint}{reason}")


def _symbol(name: str) -> sp.Expr:
    """Return the symbol of a name; a misspelled state is an error, not a parameter."""
    if name in _NAMES:
        return _NAMES[name]
    if name == "t" or name.startswith(("theta", "tau")):
        raise SymbolicError(unknown_name("state", name, STATES))
    if name in _TAKEN:
        raise SymbolicError(f"the name '{shortened(name)}' is taken; choose another")
    return sp.Symbol(name)


def extra_torque(drive: Drive) -> Callable[[float, float, float, float], float]:
    """Return the sum [N m] of the extra terms as a function of (theta_M, w, q, q').

    Raises RobotError if a term has unknown parameters; the function raises it for a state at which
    a term has no real value.
    """
    flat = {state: sp.Symbol(name, real=True) for name, state in STATES.items()}
    expression = sum(extra_terms(drive), sp.Integer(0)).xreplace(flat)
    known = known_values(drive)
    states = ("theta_M", "theta_M_dot", "theta_L", "theta_L_dot")
    arguments = [*(flat[STATES[name]] for name in states), *known]
    unknown = expression.free_symbols - set(arguments)
    if unknown:
        raise RobotError(
            f"extra terms {shown(list(drive.extra_terms))} have no value for "
            f"{', '.join(sorted(map(str, unknown)))}: write numbers to simulate them"
        )
    function = sp.lambdify(arguments, expression, modules="math")
    values = tuple(known.values())

    def torque(*state: float) -> float:
        try:
            return float(function(*state, *values))
        except (ArithmeticError, ValueError, TypeError) as problem:  # TypeError: not real
            at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(states, state, strict=True))
            raise RobotError(
                f"extra terms {shown(list(drive.extra_terms))} have no value at {at}: {problem}"
            ) from None

    return torque
