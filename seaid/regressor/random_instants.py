"""Rows of a robot's equations at random instants, as derivatives by all unknown parameters.

Instants are of two kinds. At a free instant every signal is a random number: these give the
combinations of parameters that occur in the equations. At an instant of a true motion all equations
hold for random true parameters, so that signals are dependent (the deflection of a spring is the
torque of the bodies behind it over its stiffness): these give the rank that a log can reach.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

from seaid._arrays import Array, BoolArray, IndexArray, safely
from seaid.drives import PARAMETERS
from seaid.drives.equations import K_t, K_u, N, r_L, r_M, s_K
from seaid.errors import SymbolicError
from seaid.regressor.base import joint_torques, random_states, rigid_body_regressor, torque_slopes
from seaid.regressor.exact.geometry import number
from seaid.regressor.sensor_equations import (
    BACK_EMF,
    MOTOR_SIGNALS,
    STRETCH,
    STRETCH_DOT,
    DriveTerms,
    Equation,
    System,
    plain,
)
from seaid.robot import Robot, at_joints, torques_at_drives
from seaid.robot.transmission import rows_at_drives

_STATES = ("", "_dot", "_ddot")

_SIGNAL, _SPEED = 3.0, 3.0
"""Standard deviation of random signals, and the typical speed of random states [rad/s]."""

Signals = dict[sp.Symbol, Any]
"""{symbol: its values}, each a number or (T,)."""

SumRows = tuple[IndexArray, Array]
"""(columns (k,) that are not zero, rows (T, k) in these columns) of a sum of equations."""


@dataclass(frozen=True, eq=False)
class Truth:
    """True values of the unknown standard parameters (10N,) and of the symbols of each drive."""

    bodies: Array
    drives: tuple[Signals, ...]


def random_truth(system: System, rng: np.random.Generator) -> Truth:
    """Return random values of all unknown parameters, and the known values."""
    drives = []
    for drive in system.terms:
        values: Signals = dict(drive.known)
        for symbol, name in zip(drive.unknowns, drive.names, strict=True):
            values[symbol] = rng.uniform(0.5, 1.5)
            # Of the size of motor speeds, so that tanh(w / w_C) and exp(-(w / w_S)^2) change.
            if name in PARAMETERS and PARAMETERS[name].unit == "rad/s":
                values[symbol] *= _SPEED * (drive.drive.ratio if drive.spring is None else 1.0)
        drives.append(values)
    bodies = rng.uniform(0.5, 1.5, system.robot.parameters.size)
    bodies[system.robot.is_known] = 0.0
    return Truth(bodies, tuple(drives))


def rows_of_sums(
    system: System, truth: Truth, rng: np.random.Generator, count: int, payload: Array | None = None
) -> list[SumRows]:
    """Return the derivatives by the unknown parameters, for each of the system's `sums`.

    A sum of equations has no unknown torque. The `count` instants are free or, with the known
    parameters `payload` (10N,), those of a true motion.
    """
    Y, drives = _instants(system, truth, rng, count, payload)
    starts = np.cumsum([Y.shape[2], *(len(drive.unknowns) for drive in system.terms)])
    slopes = {
        e: _slopes(system.equations[e], system.terms, drives, starts.tolist()) for e in system.used
    }
    rows, has_effect = [], Y.any(axis=0) & ~system.robot.is_known  # known bodies have no column
    for sums in system.sums:
        factors = np.zeros(system.robot.n)
        values: dict[int, Array] = {}
        for e, factor in sums.items():
            if system.equations[e].kind == "load":
                # In (8) the rigid bodies' torque has a minus.
                factors[system.equations[e].index] -= number(factor)
            for column, slope in slopes[e].items():
                values[column] = values.get(column, np.zeros(count)) + number(factor) * slope
        loads = np.flatnonzero(factors)
        seen = np.flatnonzero(has_effect[loads].any(axis=0))
        bodies = np.einsum("tjm,j->tm", Y[:, loads[:, None], seen], factors[loads])
        of_drives = sorted(column for column, value in values.items() if value.any())
        parts = [bodies, *(values[column][:, None] for column in of_drives)]
        rows.append((np.array([*seen, *of_drives], dtype=np.intp), np.hstack(parts)))
    return rows


def _slopes(
    equation: Equation, terms: Sequence[DriveTerms], drives: Sequence[Signals], starts: list[int]
) -> dict[int, Any]:
    """Return the derivatives {column: (T,)} of an equation by the parameters of its drives."""
    slopes: dict[int, Any] = {}
    for i, factor, expression in equation.parts:
        for column, symbol in enumerate(terms[i].unknowns, starts[i]):
            slope = _slope(expression, symbol)
            if slope != 0:
                slopes[column] = slopes.get(column, 0.0) + number(factor) * _value(slope, drives[i])
    return slopes


@cache
def _slope(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative by a parameter; that of a step is zero."""
    return expression.diff(symbol).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


@cache
def _compiled(expression: sp.Expr) -> tuple[Any, list[sp.Symbol]]:
    symbols = sorted(expression.free_symbols, key=str)
    return sp.lambdify(symbols, expression, modules=[np]), symbols


def _value(expression: sp.Expr, signals: Mapping[sp.Symbol, Any]) -> Any:
    function, symbols = _compiled(expression)
    return function(*(signals[symbol] for symbol in symbols))


def _instants(
    system: System, truth: Truth, rng: np.random.Generator, count: int, payload: Array | None
) -> tuple[Array, list[Signals]]:
    """Return the regressor (T, n, 10N) at random instants and the signals of every drive."""
    robot, terms = system.robot, system.terms
    q, v, a = random_states(robot, int(rng.integers(2**31)), count=count)
    drives = []
    for i, drive in enumerate(terms):
        states = (x @ robot.transmission[i] for x in (q, v, a))
        named = {plain(f"theta_L{x}"): state for x, state in zip(_STATES, states, strict=True)}
        signals = {**truth.drives[i], **named}
        drives.append(signals | _motor_states(drive, signals, rng, count))
    if payload is None:
        for signals in drives:
            for name in (*MOTOR_SIGNALS.values(), "tau_G"):
                signals[plain(name)] = rng.normal(0, _SIGNAL, count)
        return rigid_body_regressor(robot, q, v, a), drives
    a = _balanced(system, drives, (q, v, a), truth.bodies + payload)
    for i, (drive, signals) in enumerate(zip(terms, drives, strict=True)):
        signals[plain("theta_L_ddot")] = a @ robot.transmission[i]
        # Stiff drives' motors follow the new accelerations; behind springs they stay as drawn.
        if drive.spring is None:
            signals |= _motor_states(drive, signals, rng, count)
    Y = rigid_body_regressor(robot, q, v, a)
    loads = torques_at_drives(robot.transmission, Y @ (truth.bodies + payload))
    for drive, signals, load in zip(terms, drives, loads.T, strict=True):
        signals |= _motor_torques(drive, signals, load)
    return Y, drives


def _motor_states(
    drive: DriveTerms, signals: Signals, rng: np.random.Generator, count: int
) -> Signals:
    """Return the motor's states: N times the joint's for a stiff drive, else random ones."""
    q, v, a = (signals[plain(f"theta_L{suffix}")] for suffix in _STATES)
    motor = [plain(f"theta_M{suffix}") for suffix in _STATES]
    if drive.spring is None:
        return {symbol: signals[N] * x for symbol, x in zip(motor, (q, v, a), strict=True)}
    stretch, w, w_dot = rng.normal(0, _SIGNAL, (3, count))
    # (3): the deflection is drawn, and theta_M = N / r_M (d + r_L theta_L) follows.
    lever = signals[N] / signals[r_M]
    return {
        **dict(zip(motor, (lever * (stretch + signals[r_L] * q), w, w_dot), strict=True)),
        STRETCH: stretch,
        STRETCH_DOT: w / lever - signals[r_L] * v,
    }


def _balanced(
    system: System, drives: Sequence[Signals], state: tuple[Array, Array, Array], bodies: Array
) -> Array:
    """Return accelerations (T, n) with which the load equation (8) of every spring holds."""
    (q, v, a), terms = state, system.terms
    elastic = [i for i, drive in enumerate(terms) if drive.spring is not None]
    if not elastic:
        return a
    # The robot adds its payloads itself.
    parameters = bodies - system.robot.payload_parameters
    robot = system.robot.with_values(parameters, system.robot.drives)
    # The torques are affine in a, with the inertia as their slope: at the drives C^-T M C^-1.
    C, M = robot.transmission, torque_slopes(robot, q, v, a)[2]
    inertia = rows_at_drives(C, torques_at_drives(C, M))[:, elastic][:, :, elastic]
    wanted = -torques_at_drives(C, joint_torques(robot, q, v, a))[:, elastic]
    for place, i in enumerate(elastic):
        # (8) of elastic drives: r_L F - joint terms = torque of the bodies.
        force = _value(terms[i].spring, drives[i]) * drives[i][r_L]
        wanted[:, place] += force - _value(terms[i].joint, drives[i])
    change = np.zeros_like(a)
    change[:, elastic] = safely(
        np.linalg.solve,
        inertia,
        wanted[..., None],
        what="the motion of the sensors",
        error=SymbolicError,
    )[..., 0]
    return np.asarray(a + at_joints(C, change))


def _motor_torques(drive: DriveTerms, signals: Signals, load: Array) -> Signals:
    """Return the torque, current and voltage of a motor by (7), with the torque of the bodies."""
    tau, current, voltage = (plain(name) for name in MOTOR_SIGNALS.values())
    load = load + _value(drive.joint, signals)
    found: Signals = {plain("tau_G"): load}
    # (7): torque = motor + share * load. `motor` is without the signal of the motor's own sensor.
    torque = number(drive.share) * load + _value(drive.motor, {**signals, **found})
    found[tau] = torque
    for constant in (K_t, s_K):
        if constant in signals:
            found[current] = torque / signals[constant]
    if K_u in signals:
        lost = signals.get(BACK_EMF, 0.0) * signals[plain("theta_M_dot")]
        found[voltage] = (torque + lost) / signals[K_u]
    return found


_LEAST_CHANGE = 1e-9
"""Least change of a torque, over its largest value, that counts as a dependence on a motion."""


def dependencies(robot: Robot, seed: int) -> BoolArray:
    """Return whether the torque of joint i depends on the motion of joint k, as a matrix (n, n).

    The bodies are random; entry [i, k] compares the torque i with and without another motion of k.
    """
    n, rng = robot.n, np.random.default_rng(seed)
    bodies = rng.uniform(0.5, 1.5, robot.parameters.size)
    (q, v, a), others = (random_states(robot, seed + draw, count=n + 1) for draw in range(2))
    # Row 0 has the first motion throughout; in row 1 + k joint k has another one.
    changed = np.vstack([np.zeros(n, dtype=bool), np.eye(n, dtype=bool)])
    q, v, a = (
        np.where(changed, other, first[0]) for first, other in zip((q, v, a), others, strict=True)
    )
    torques = joint_torques(robot.with_values(bodies, robot.drives), q, v, a)
    apart = np.abs(torques[1:] - torques[0])
    return np.asarray(apart > _LEAST_CHANGE * np.abs(torques).max(axis=0)).T
