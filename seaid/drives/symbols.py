"""The symbols of the drive's equations: signals, known values, parameters, and Dahl's hysteresis.

The hysteresis of Dahl (1968) is a state z from -1 to 1 that follows the travel of a position:
dz/dx = (1 - z sign(x')) / width, which is the Bouc-Wen law of order 1 without gamma. It does not
depend on the speed. Between two reversals it has a closed form in the travel u, so that the state
over a log costs one step per reversal. As a sympy function of (x, width) it is a term of an
equation; compiled, it runs over the samples of x, from z = 0 at the first one.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from seaid._arrays import Array

if TYPE_CHECKING:
    from seaid.drives.drives import Drive

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

PARAMETER_NAMES = {
    F_v: "viscous_friction",
    F_C: "coulomb_friction",
    w_C: "coulomb_width",
    w_0: "coulomb_shift",
    w_M: "presliding_angle",
    F_0: "friction_offset",
    F_a: "asymmetric_friction",
    F_q: "quadratic_friction",
    F_L: "load_friction",
    F_S: "stribeck_friction",
    w_S: "stribeck_speed",
    F_x: "coulomb_position_slope",
    F_xx: "coulomb_position_curvature",
    F_vT: "viscous_temperature_slope",
    F_CT: "coulomb_temperature_slope",
    F_vW: "cold_viscous_friction",
    F_CW: "cold_coulomb_friction",
    t_W: "warm_up_time",
    k: "stiffness",
    k_3: "cubic_stiffness",
    k_5: "fifth_stiffness",
    g: "dead_zone",
    w_g: "dead_zone_rounding",
    c_k: "spring_damping",
    F_H: "hysteresis_force",
    w_H: "hysteresis_deflection",
    f_0: "spring_offset",
    d_0: "deflection_zero",
    I_M: "motor_inertia",
    K_t: "torque_constant",
    K_u: "voltage_constant",
    T_C: "command_delay",
    s_K: "gain_scale",
    k_P: "parallel_stiffness",
    tau_P: "parallel_preload",
    b_L: "joint_viscous_friction",
    c_L: "joint_coulomb_friction",
}
"""{symbol: name} of the parameters in `seaid.drives.terms`, in the same order."""


@cache
def symbol_of(name: str) -> sp.Symbol:
    """Return the symbol of a parameter; that of an amplitude of a harmonic has its name."""
    return SYMBOLS[name] if name in SYMBOLS else sp.Symbol(name, real=True)


SYMBOLS = {name: symbol for symbol, name in PARAMETER_NAMES.items()}
SIGNALS = (theta_M, theta_L, tau_M, tau_L, i_M, u_M, tau_G, Delta_T, t_log, tau_C)
STATES = {
    "theta_M": theta_M,
    "theta_M_dot": theta_M.diff(t),
    "theta_M_ddot": theta_M.diff(t, 2),
    "theta_L": theta_L,
    "theta_L_dot": theta_L.diff(t),
    "theta_L_ddot": theta_L.diff(t, 2),
}
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
    at_start, state = np.zeros((2, len(starts))), (0.0, 0.0)
    for place, (s, travel) in enumerate(zip(toward.tolist(), u[ends - 1].tolist(), strict=True)):
        at_start[:, place] = state
        state = _after(*state, s, travel, width)
    z, slope = at_start[:, stroke]
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
