"""Motor, gear, spring and friction of one joint as sympy equations, (1)-(4), (7) and (8).

An equation is an expression that is zero along every motion. A term that is added here, or as one
of the `extra_terms` of a drive, becomes a column of the regressor without any other change.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
import sympy as sp

from seaid._arrays import Array
from seaid.drives.drives import Drive, is_smooth
from seaid.drives.terms import COULOMB, DEAD_ZONES, PARAMETERS, Parameter
from seaid.errors import RobotError, SymbolicError, shortened, unknown_name
from seaid.symbolic.expression_text import expression_of

t = sp.Symbol("t")
theta_M, theta_L, tau_M, tau_L = (
    sp.Function(name)(t) for name in ("theta_M", "theta_L", "tau_M", "tau_L")
)
"""Motor angle, joint coordinate, motor torque and the torque (or force) on the load."""

i_M, u_M = (sp.Function(name)(t) for name in ("i_M", "u_M"))
"""Motor current and voltage, the inputs of motors without a logged torque."""

tau_G = sp.Function("tau_G")(t)
"""Torque of a stiff gear on its load, a given signal in the load-dependent friction."""

Delta_T = sp.Function("Delta_T")(t)
"""Temperature of the motor above the reference temperature of the drive [K]."""

t_log = sp.Function("t_log")(t)
"""Time since the start of the log [s]."""

tau_C = sp.Function("tau_C")(t)
"""Part of the motor torque that the command of a position controller gives, K_p u / N."""

N, r_M, r_L = sp.symbols("N r_M r_L", positive=True)
I_M, F_v, F_C, F_0, F_a, F_q, F_L, F_S, w_0 = sp.symbols(
    "I_M F_v F_C F_0 F_a F_q F_L F_S w_0", real=True
)
w_C, w_S, w_M, g, w_g, w_H, K_t, K_u = sp.symbols("w_C w_S w_M g w_g w_H K_t K_u", positive=True)
k, k_3, k_5, c_k, F_H, f_0, d_0 = sp.symbols("k k_3 k_5 c_k F_H f_0 d_0", real=True)
F_vT, F_CT, F_vW, F_CW, F_x, F_xx = sp.symbols("F_vT F_CT F_vW F_CW F_x F_xx", real=True)
q_0 = sp.Symbol("q_0", real=True)
"""Reference position of a drive, at which its Coulomb friction has the stated value."""

t_W, s_K = sp.symbols("t_W s_K", positive=True)
T_0, s_0 = sp.symbols("T_0 s_0", real=True)
"""Nominal delay of a command and nominal scale of its controller's gains, known values."""

k_P, tau_P, b_L, c_L, T_C = sp.symbols("k_P tau_P b_L c_L T_C", real=True)


def _symbol_of(parameter: Parameter) -> sp.Symbol:
    """Return the symbol of a parameter, positive if the equations divide by it or it is a width."""
    is_positive = parameter.is_divisor or bool(parameter.starts and parameter.is_positive)
    sign = {"positive": True} if is_positive else {"real": True}
    return sp.Symbol(parameter.symbol, **sign)


SYMBOLS = {name: _symbol_of(parameter) for name, parameter in PARAMETERS.items()}
PARAMETER_NAMES = {symbol: name for name, symbol in SYMBOLS.items()}
"""{symbol: name} of the parameters in `seaid.drives.terms`, in the same order."""


@cache
def symbol_of(name: str) -> sp.Symbol:
    """Return the symbol of a parameter; that of an amplitude of a harmonic has its name."""
    return SYMBOLS[name] if name in SYMBOLS else sp.Symbol(name, real=True)


SIGNALS = (theta_M, theta_L, tau_M, tau_L, i_M, u_M, tau_G, Delta_T, t_log, tau_C)
NAMES_OF = {
    sp.Derivative(signal, (t, order)): f"{signal.func}{suffix}"
    for order, suffix in ((2, "_ddot"), (1, "_dot"), (0, ""))
    for signal in SIGNALS
}
"""{signal or derivative: flat name}, highest derivatives first for substitution."""

STATES = {name: signal for signal, name in NAMES_OF.items() if signal.has(theta_M, theta_L)}
"""{name in the text of an extra term: signal}."""


def known_values(drive: Drive) -> dict[sp.Symbol, float]:
    """Return {known symbol: value} of a drive."""
    values = {N: drive.ratio, r_M: drive.motor_radius, r_L: drive.load_radius}
    values[q_0] = drive.reference_position_rad
    if drive.is_up_to_scale:
        values[T_0] = drive.command_delay_s or 0.0
        values[s_0] = drive.scale_of_gains
    known = [*drive.known, *(["motor_inertia"] if drive.motor_inertia_kg_m2 is not None else [])]
    return values | {symbol_of(name): drive.values[name] for name in known}


# The hysteresis of Dahl (1968) is a state z from -1 to 1 that follows the travel of a position:
# dz/dx = (1 - z sign(x')) / width, which is the Bouc-Wen law of order 1 without gamma. It does not
# depend on the speed. Between two reversals it has a closed form in the travel u, so that the state
# over a log costs one step per reversal. As a sympy function of (x, width) it is a term of an
# equation; compiled, it runs over the samples of x, from z = 0 at the first one.


def _dahl(z: Any, sign: Any, u: Any) -> tuple[Any, Any, Any]:
    """Return z after a travel u >= 0 in units of the width, and its slopes by z and u."""
    # dz/du = s - z with s = sign(x') and u = |travel| / width: z = s + (z_0 - s) exp(-u).
    decay = np.exp(-u)
    return sign + (z - sign) * decay, decay, (sign - z) * decay


def after_travel(z: float, travel: float, width: float) -> float:
    """Return the state after a travel without reversal."""
    return float(_dahl(z, math.copysign(1.0, travel), abs(travel) / width)[0])


def states(x: Array, width: float) -> tuple[Array, Array]:
    """Return the state (T,) over samples x (T,), and its slope by the width."""
    step = np.diff(x)
    sign = np.sign(step)
    moves = np.flatnonzero(sign)
    history = np.zeros((2, len(x)))
    if not len(moves):
        return history[0], history[1]
    turns = moves[np.flatnonzero(np.diff(sign[moves])) + 1]  # the first steps after a reversal
    starts, ends = np.array([[0, *turns], [*turns, len(step)]])
    # A stroke may begin with samples that stand still: the first that moves decides.
    toward = sign[moves[np.searchsorted(moves, starts)]]
    stroke = np.repeat(np.arange(len(starts)), ends - starts)  # of each sample but the first one
    u = np.abs(x[1:] - x[starts][stroke]) / width
    # z and its slope at the start of each stroke, from stroke to stroke
    at_start, z, slope = list[tuple[float, float]](), 0.0, 0.0
    ways = (toward, u[ends - 1] / width, np.exp(-u[ends - 1]))
    for s, travel, decay in zip(*(way.tolist() for way in ways), strict=True):
        at_start.append((z, slope))
        # `_after`, of numbers.
        z, slope = s + (z - s) * decay, decay * (slope - (s - z) * travel)
    z, slope = np.array(at_start).T[:, stroke]
    history[:, 1:] = _after(z, slope, toward[stroke], u, width)
    return history[0], history[1]


def _after(z: Any, slope: Any, sign: Any, u: Any, width: float) -> tuple[Any, Any]:
    """Return the state after a travel u, in units of the width, and its slope by the width.

    By the chain rule the latter has that of the state before, too: du/dwidth = -u/width.
    """
    state, by_z, by_u = _dahl(z, sign, u)
    return state, by_z * slope - by_u * u / width


class Dahl(sp.Function):  # type: ignore[misc]
    """The state as a function of position and width; `lambdify` evaluates it by its `_imp_`."""

    nargs = 2
    is_real = True
    _imp_ = staticmethod(lambda x, width: states(x, width)[0])

    def fdiff(self, argindex: int = 2) -> sp.Expr:
        """Return the slope by the width; the state is no function of the present position."""
        if argindex != 2:
            raise sp.core.function.ArgumentIndexError(self, argindex)
        return DahlSlope(*self.args)


class DahlSlope(sp.Function):  # type: ignore[misc]
    """The slope of the state by the width."""

    nargs = 2
    is_real = True
    _imp_ = staticmethod(lambda x, width: states(x, width)[1])


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


_W, _ACCELERATION = STATES["theta_M_dot"], STATES["theta_M_ddot"]
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
    friction = sum(terms, sp.Integer(0)) + periodic(drive, "torque_ripple")
    return friction + friction_level(drive) * direction(drive) if is_smooth(drive) else friction


def motor_equation(drive: Drive) -> DriveEquation:
    """Return the motor equation (7); a stiff gear has the joint torque in place of the spring."""
    behind_gear = r_M * spring_force(drive) if drive.is_elastic else tau_L  # (4a)
    expression = (
        I_M * _ACCELERATION
        + smooth_friction(drive)
        + dry_friction(drive) * sp.sign(_W)
        + sum(extra_terms(drive))
        + behind_gear / N
        - _input_torque(drive)
    )
    return DriveEquation(expression, tuple(known_values(drive)))


def spring_equation(drive: Drive) -> DriveEquation:
    """Return (4b) as a balance of spring forces, for a joint whose torque is measured."""
    return DriveEquation(spring_force(drive) - tau_L / r_L, tuple(known_values(drive)))


_PARALLEL = {"linear": k_P * theta_L, "preload": tau_P}
_AT_JOINT = {"viscous": b_L * theta_L.diff(t), "coulomb": c_L * sp.sign(theta_L.diff(t))}


def joint_equation(drive: Drive) -> DriveEquation:
    """Return the joint terms (parallel spring, joint friction) that act in (8), less `tau_L`."""
    terms = [_PARALLEL[term] for term in drive.parallel_spring]
    terms += [_AT_JOINT[term] for term in drive.joint_friction]
    return DriveEquation(sum(terms, sp.Integer(0)) - tau_L, tuple(known_values(drive)))


def _input_torque(drive: Drive) -> sp.Expr:
    """Return the motor torque by the logged input.

    Gains up to the scale s_K: the product s_K T_C with the delay is linear about nominal values,
    s_K (tau_M - T_0 tau_C') - s_0 (T_C - T_0) tau_C'; both are those of the last estimate.
    """
    if drive.is_up_to_scale:
        rate = tau_C.diff(t)
        return s_K * (tau_M - T_0 * rate) - s_0 * (T_C - T_0) * rate
    inputs = {"torque": tau_M, "current": K_t * i_M, "voltage": K_u * u_M}
    is_command = drive.motor_input not in inputs
    return tau_M - T_C * tau_C.diff(t) if is_command else inputs[drive.motor_input]
