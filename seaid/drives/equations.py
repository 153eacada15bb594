"""Motor, gear, spring and friction of one joint as sympy equations, (1)-(4), (7) and (8).

An equation is an expression that is zero along every motion. A term that is added here, or as one
of the `extra_terms` of a drive, becomes a column of the regressor without any other change.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache

import sympy as sp

from seaid.drives.drives import Drive, is_smooth
from seaid.drives.symbols import (
    F_0,
    F_C,
    F_CT,
    F_CW,
    F_H,
    F_L,
    F_S,
    I_M,
    PARAMETER_NAMES,
    STATES,
    T_0,
    T_C,
    Dahl,
    Delta_T,
    F_a,
    F_q,
    F_v,
    F_vT,
    F_vW,
    F_x,
    F_xx,
    K_t,
    K_u,
    N,
    b_L,
    c_k,
    c_L,
    d_0,
    f_0,
    g,
    i_M,
    k,
    k_3,
    k_5,
    k_P,
    known_values,
    q_0,
    r_L,
    r_M,
    s_0,
    s_K,
    symbol_of,
    t,
    t_log,
    t_W,
    tau_C,
    tau_G,
    tau_L,
    tau_M,
    tau_P,
    theta_L,
    theta_M,
    u_M,
    w_0,
    w_C,
    w_g,
    w_H,
    w_M,
    w_S,
)
from seaid.drives.terms import COULOMB, DEAD_ZONES
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
_TAKEN = {*PARAMETER_NAMES.values(), *map(str, PARAMETER_NAMES), str(Delta_T.func), str(t_log.func)}
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


@dataclass(frozen=True)
class DriveEquation:
    """An expression that is zero along the motion; every symbol not in `known` is unknown."""

    expression: sp.Expr
    known: tuple[sp.Symbol, ...]

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]:
        """The unknown parameters: the named ones first, then added ones by name."""
        free = self.expression.free_symbols - {t, *self.known}
        named = [symbol for symbol in PARAMETER_NAMES if symbol in free]
        return (*named, *sorted(free - set(named), key=str))


def spring_force(drive: Drive) -> sp.Expr:
    """Return the spring force (3) with the terms of the drive's spring, 0 without a spring.

    A linear spring has the spring offset f_0, which absorbs unknown encoder offsets.
    """
    offset = f_0 if drive.is_elastic and not drive.is_nonlinear_spring else 0
    kind = next((term for term in DEAD_ZONES if term in drive.spring), None)
    terms = _spring_terms(drive.is_nonlinear_spring, kind)
    whole = sum((terms[term] for term in drive.spring), sp.Integer(0)) + offset
    return whole + periodic(drive, "transmission_error")


@cache
def _spring_terms(is_nonlinear: bool, dead_zone: str | None) -> dict[str, sp.Expr]:
    """Return {term: force} of all terms of a spring, with the deflection outside a dead zone."""
    stretch = r_M / N * theta_M - r_L * theta_L
    d = stretch - d_0 if is_nonlinear else stretch
    if dead_zone == "dead_zone":
        d = d - (sp.Abs(d + g) - sp.Abs(d - g)) / 2  # d less its saturation to -g .. g
    elif dead_zone == "smooth_dead_zone":  # the same in the limit w_g -> 0
        d = d - (sp.sqrt((d + g) ** 2 + w_g**2) - sp.sqrt((d - g) ** 2 + w_g**2)) / 2
    return {
        "linear": k * d,
        "cubic": k_3 * d**3,
        "fifth": k_5 * d**5,
        "damping": c_k * stretch.diff(t),
        "preload": f_0 if is_nonlinear else 0,
        **dict.fromkeys(DEAD_ZONES, 0),
        "dahl": F_H * Dahl(stretch, w_H),
    }


_ANGLES = {"motor": theta_M, "joint": theta_L, "mesh": theta_M - theta_M / N}


def periodic(drive: Drive, field: str) -> sp.Expr:
    """Return the periodic errors of a field of the drive, with their amplitudes as symbols."""
    terms = (
        symbol_of(name) * function(harmonic.order * _ANGLES[harmonic.angle])
        for harmonic in drive.harmonics
        if harmonic.field == field
        for name, function in zip(harmonic.names, (sp.cos, sp.sin), strict=True)
    )
    return sum(terms, sp.Integer(0))


def direction(drive: Drive) -> sp.Expr:
    """Return sign(w) of the motor speed w, its tanh for smooth friction, or a presliding state."""
    w = theta_M.diff(t)
    if "dahl" in drive.friction:
        return Dahl(theta_M, w_M)
    if "shifted_coulomb" in drive.friction:
        return sp.tanh((w - w_0) / w_C)
    return sp.tanh(w / w_C) if "smooth_coulomb" in drive.friction else sp.sign(w)


_Q = theta_L - q_0
_LEVELS = {
    **dict.fromkeys(COULOMB, F_C),
    "stribeck": F_S * sp.exp(-((theta_M.diff(t) / w_S) ** 2)),
    "coulomb_position": F_x * _Q + F_xx * _Q**2,
    "coulomb_temperature": F_CT * Delta_T,
    "coulomb_warm_up": F_CW * sp.exp(-t_log / t_W),
}
"""{term: its level of friction} of all but the load."""


def friction_level(drive: Drive) -> sp.Expr:
    """Return the factor of sign(w) in the motor's friction: Coulomb, load and other terms."""
    terms = _LEVELS
    if "load" in drive.friction:
        # (4a) over N: the torque of the spring at the motor.
        behind_gear = r_M / N * spring_force(drive) if drive.is_elastic else tau_G / N
        terms = {**terms, "load": F_L * sp.Abs(behind_gear)}
    return sum((terms[term] for term in drive.friction if term in terms), sp.Integer(0))


def dry_friction(drive: Drive) -> sp.Expr:
    """Return the friction level that can hold the motor at rest: the factor of sign(w), or 0."""
    return sp.Integer(0) if is_smooth(drive) else friction_level(drive)


_W = theta_M.diff(t)
_SMOOTH = {
    "viscous": F_v * _W,
    "offset": F_0,
    "asymmetric": F_a * sp.Abs(_W),
    "quadratic": F_q * _W * sp.Abs(_W),
    "viscous_temperature": F_vT * Delta_T * _W,
    "viscous_warm_up": F_vW * sp.exp(-t_log / t_W) * _W,
}
"""{term: its torque} of friction that cannot hold a motor at rest."""


def smooth_friction(drive: Drive) -> sp.Expr:
    """Return the motor's friction without sign(w), which cannot hold it at rest, and its ripple."""
    terms = [_SMOOTH[term] for term in drive.friction if term in _SMOOTH]
    friction = sum(terms, sp.Integer(0))
    friction = friction + periodic(drive, "torque_ripple")
    return friction + friction_level(drive) * direction(drive) if is_smooth(drive) else friction


def motor_equation(drive: Drive) -> DriveEquation:
    """Return the motor equation (7); a stiff gear has the joint torque in place of the spring."""
    behind_gear = r_M * spring_force(drive) if drive.is_elastic else tau_L  # (4a)
    expression = (
        I_M * theta_M.diff(t, 2)
        + smooth_friction(drive)
        + dry_friction(drive) * sp.sign(theta_M.diff(t))
        + sum(extra_terms(drive))
        + behind_gear / N
        - _input_torque(drive)
    )
    return DriveEquation(expression, _known_symbols(drive))


def spring_equation(drive: Drive) -> DriveEquation:
    """Return (4b) as a balance of spring forces, for a joint whose torque is measured."""
    return DriveEquation(spring_force(drive) - tau_L / r_L, _known_symbols(drive))


def joint_equation(drive: Drive) -> DriveEquation:
    """Return the joint terms (parallel spring, joint friction) that act in (8), less `tau_L`."""
    speed = theta_L.diff(t)
    spring = {"linear": k_P * theta_L, "preload": tau_P}
    friction = {"viscous": b_L * speed, "coulomb": c_L * sp.sign(speed)}
    terms = [spring[term] for term in drive.parallel_spring]
    terms += [friction[term] for term in drive.joint_friction]
    return DriveEquation(sum(terms, sp.Integer(0)) - tau_L, _known_symbols(drive))


def _input_torque(drive: Drive) -> sp.Expr:
    """Return the motor torque by the logged input.

    Gains up to the scale s_K: the product s_K T_C with the delay is linear about nominal values,
    s_K (tau_M - T_0 tau_C') - s_0 (T_C - T_0) tau_C'; both are those of the last estimate.
    """
    if drive.is_up_to_scale:
        rate = tau_C.diff(t)
        return s_K * (tau_M - T_0 * rate) - s_0 * (T_C - T_0) * rate
    return {
        "torque": tau_M,
        "current": K_t * i_M,
        "voltage": K_u * u_M,
    }.get(drive.motor_input, tau_M - T_C * tau_C.diff(t))


def _known_symbols(drive: Drive) -> tuple[sp.Symbol, ...]:
    return tuple(known_values(drive))
