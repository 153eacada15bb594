"""Extra terms of a drive: text that is added to the motor's equation (7)."""

from __future__ import annotations

import re
from collections.abc import Callable
from keyword import iskeyword

import sympy as sp

from seaid.drivetrain.model import Drive
from seaid.drivetrain.symbols import (
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
from seaid.errors import RobotError, unknown_name


def extra_terms(drive: Drive) -> list[sp.Expr]:
    """Return the drive's extra terms as expressions.

    They are text such as "c*theta_M'**3" or "c*theta_M_dot**3", a torque [N m] at the motor; names
    other than those of STATES, N, r_M, r_L and I_M are unknown parameters. Raises RobotError for
    text that is no expression.
    """
    return [_expression(text) for text in drive.extra_terms]


_NAMES = {**STATES, **{str(symbol): symbol for symbol in (N, r_M, r_L, F_v, F_C, F_0, k, f_0, I_M)}}
_TAKEN = {*PARAMETER_NAMES.values(), *map(str, PARAMETER_NAMES)}
_FUNCTIONS = {
    "abs": sp.Abs,
    "atan": sp.atan,
    "cos": sp.cos,
    "cosh": sp.cosh,
    "exp": sp.exp,
    "log": sp.log,
    "sign": sp.sign,
    "sin": sp.sin,
    "sinh": sp.sinh,
    "sqrt": sp.sqrt,
    "tan": sp.tan,
    "tanh": sp.tanh,
}


def _expression(text: str) -> sp.Expr:
    """Return one extra term as an expression, of names and functions that mean something here.

    sympy would take E, beta or S for its own, and a state with a typo for a parameter.
    """
    plain = re.sub(r"(theta_[ML])''", r"\1_ddot", text)
    plain = re.sub(r"(theta_[ML])'", r"\1_dot", plain)
    where = f"extra term '{text}'"
    if re.search(r"[^\w\s+\-*/^().]|\.\s*[^\W\d]", plain):
        raise RobotError(
            f"{where} is not an expression: it may have names, numbers and + - * / ^ ( )"
        )
    names: dict[str, object] = {"pi": sp.pi, **_NAMES}
    for name, call in re.findall(r"(?<!\w)([^\W\d]\w*)\s*(\(?)", plain):
        if call:
            if name not in _FUNCTIONS:
                raise RobotError(f"{where}: " + unknown_name("function", name, _FUNCTIONS))
            names[name] = _FUNCTIONS[name]
        elif name == "t" or (name.startswith(("theta", "tau")) and name not in STATES):
            raise RobotError(f"{where}: " + unknown_name("state", name, STATES))
        elif name not in _NAMES and (name in _TAKEN or iskeyword(name)):
            raise RobotError(f"{where}: the name '{name}' is taken; choose another")
        else:
            names.setdefault(name, sp.Symbol(name))
    try:
        expression = sp.sympify(plain, locals=names, rational=True)
    except (sp.SympifyError, TypeError, AttributeError, SyntaxError):
        raise RobotError(f"{where} is not an expression") from None
    if not isinstance(expression, sp.Expr) or expression.has(sp.zoo, sp.oo, sp.nan):
        raise RobotError(f"{where} is not an expression but {expression}")
    return expression


def extra_torque(drive: Drive) -> Callable[[float, float, float, float], float]:
    """Return the extra terms as a number of motor angle and speed, joint position and speed.

    Raises RobotError where they have unknown parameters, so that they have no value.
    """
    expression = sum(extra_terms(drive), sp.Integer(0)).subs(known_values(drive))
    flat = {state: sp.Symbol(name) for name, state in reversed(STATES.items())}
    expression = expression.subs(flat)
    arguments = [sp.Symbol(name) for name in ("theta_M", "theta_M_dot", "theta_L", "theta_L_dot")]
    unknown = expression.free_symbols - set(arguments)
    if unknown:
        raise RobotError(
            f"extra terms {list(drive.extra_terms)} have no value for "
            f"{', '.join(sorted(map(str, unknown)))}: write numbers to simulate them"
        )
    return sp.lambdify(arguments, expression, modules="math")  # type: ignore[no-any-return]
