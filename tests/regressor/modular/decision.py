"""Structural identifiability without rounding: the equations of `sensor_equations` modulo a prime.

It has the same two kinds of instants as `seaid.regressor.random_instants`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from flint import fmpq, fmpq_mat
from numpy.typing import NDArray

from seaid._arrays import Array
from seaid.drives import PARAMETERS, K_t, K_u, N, r_L, r_M, s_K
from seaid.regressor.exact.geometry import exact_number
from seaid.regressor.sensor_equations import (
    BACK_EMF,
    MOTOR_SIGNALS,
    STRETCH,
    STRETCH_DOT,
    DriveTerms,
    System,
    plain,
    system_of,
)
from seaid.robot import Robot
from tests.regressor.modular.arithmetic import (
    PRIME,
    Known,
    ResidueNumbers,
    Residues,
    States,
    echelon,
)

_STATES = ("", "_dot", "_ddot")


@dataclass(frozen=True, eq=False)
class Truth:
    """True values of the unknown standard parameters (10n,) and of the symbols of each drive."""

    bodies: Any
    drives: tuple[Mapping[sp.Expr, Any], ...]


def random_truth(numbers: ResidueNumbers, system: System) -> Truth:
    """Return random values of all unknown parameters, and the known values."""
    drives = []
    for drive in system.terms:
        known: Known = {symbol: numbers.number(x) for symbol, x in drive.known.items()}
        for symbol, name in zip(drive.unknowns, drive.names, strict=True):
            value = numbers.random(1)[0]
            # Of the size of motor speeds, so that tanh(w / w_C) and exp(-(w / w_S)^2) change.
            is_speed = name in PARAMETERS and PARAMETERS[name].unit == "rad/s"
            known[symbol] = value * numbers.number(_speed(drive)) % PRIME if is_speed else value
        drives.append(known)
    bodies = numbers.random(system.robot.parameters.size)
    bodies[system.robot.is_known] = 0
    return Truth(bodies, tuple(drives))


def _speed(drive: DriveTerms) -> float:
    """Return the typical motor speed [rad/s] of random states."""
    return 3.0 * (drive.drive.ratio if drive.spring is None else 1.0)


def columns_at_instants(
    numbers: ResidueNumbers, system: System, truth: Truth, count: int, payload: Any = None
) -> Any:
    """Return the derivatives (count * W, m) of the sums of equations by all unknown parameters.

    Instants are free or, with the known parameters `payload` (10N,), those of a true motion.
    """
    robot, terms = system.robot, system.terms
    Y, drives = _instants(numbers, robot, terms, truth, count, payload)
    bodies = robot.parameters.size
    starts = np.cumsum([bodies, *(len(drive.unknowns) for drive in terms)]).tolist()
    H = np.zeros((count, len(system.sums), starts[-1]), dtype=Y.dtype)
    for e in sorted(system.used):
        equation = system.equations[e]
        slopes = np.zeros((count, starts[-1]), dtype=Y.dtype)
        if equation.kind == "load":
            # In (8) the rigid bodies' torque has a minus; known bodies have no column.
            slopes[:, :bodies] = -Y[:, equation.index] * ~robot.is_known
        for i, factor, expression in equation.parts:
            for place, symbol in enumerate(terms[i].unknowns, starts[i]):
                slope = _slope(expression, symbol)
                if slope != 0:
                    slopes[:, place] += _number(numbers, factor) * numbers.value(slope, drives[i])
        for w, sums in enumerate(system.sums):
            if e in sums:
                H[:, w] += _number(numbers, sums[e]) * (slopes % PRIME)
    return np.asarray(H % PRIME).reshape(-1, starts[-1])


@cache
def _slope(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative by a parameter; that of a step is zero."""
    return expression.diff(symbol).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


def _number(numbers: ResidueNumbers, value: fmpq) -> Any:
    return numbers.number(Fraction(int(value.p), int(value.q)))


def _matrix(numbers: ResidueNumbers, matrix: fmpq_mat) -> Residues:
    rows = [[_number(numbers, x) for x in row] for row in matrix.tolist()]
    return np.array(rows, dtype=object)


def _instants(
    numbers: ResidueNumbers,
    robot: Robot,
    terms: Sequence[DriveTerms],
    truth: Truth,
    count: int,
    payload: Any,
) -> tuple[Any, list[Known]]:
    """Return the regressor (T, n, 10n) at random instants and the signals of every drive."""
    state = numbers.states(count)
    exact = fmpq_mat([[exact_number(x) for x in row] for row in robot.transmission])
    C, C_inv = (_matrix(numbers, x) for x in (exact, exact.inv()))
    drives: list[Known] = []
    for i, drive in enumerate(terms):
        known = {**truth.drives[i], **_load_signals(numbers, i, C[i], state)}
        _turn_motor(numbers, drive, known, count)
        drives.append(known)
    if payload is None:
        Y, loads = numbers.regressor(state), [None] * robot.n
    else:
        bodies = (truth.bodies + payload) % PRIME
        a = _balanced(numbers, terms, drives, state, C_inv, bodies)
        for i, drive in enumerate(terms):
            drives[i][plain("theta_L_ddot")] = numbers.product(a, C[i])
            # Stiff drives' motors follow the new accelerations; behind springs they stay as drawn.
            if drive.spring is None:
                _turn_motor(numbers, drive, drives[i], count)
        Y = numbers.regressor((*state[:3], a))
        loads = list(numbers.product(numbers.product(Y, bodies), C_inv).T)
    for drive, known, load in zip(terms, drives, loads, strict=True):
        _drive_motor(numbers, drive, known, load, count)
    return Y, drives


def _load_signals(numbers: ResidueNumbers, i: int, row: Any, state: States) -> Known:
    """Return the states of a drive's coordinate `row` @ q; of a joint also cosine and sine."""
    (q, turned, v, a), robot = state, numbers.robot
    pairs = zip(_STATES, (q, v, a), strict=True)
    known: Known = {plain(f"theta_L{suffix}"): numbers.product(x, row) for suffix, x in pairs}
    if not robot.is_prismatic[i] and np.array_equal(robot.transmission[i], np.eye(robot.n)[i]):
        for function, values in zip((sp.cos, sp.sin), turned, strict=True):
            known[function(plain("theta_L"))] = values[:, i]
    return known


def _turn_motor(numbers: ResidueNumbers, drive: DriveTerms, known: Known, count: int) -> None:
    """Add the motor's states: N times the joint's for a stiff drive, else random ones."""
    for suffix in _STATES:
        load = known[plain(f"theta_L{suffix}")]
        motor = plain(f"theta_M{suffix}")
        if drive.spring is None:
            known[motor] = known[N] * load % PRIME
            continue
        known[motor] = numbers.random(count)
        if suffix == "":
            # (3): the deflection is drawn, and theta_M = N / r_M (d + r_L theta_L) follows.
            known[STRETCH] = numbers.random(count)
            into = numbers.over(known[N], known[r_M])
            stretched = (known[STRETCH] + known[r_L] * load) % PRIME
            known[motor] = into * stretched % PRIME
        elif suffix == "_dot":
            rate = numbers.over(known[r_M] * known[motor], known[N])
            known[STRETCH_DOT] = (rate - known[r_L] * load) % PRIME


def _balanced(
    numbers: ResidueNumbers,
    terms: Sequence[DriveTerms],
    drives: Sequence[Known],
    state: States,
    C_inv: Any,
    bodies: Any,
) -> Any:
    """Return accelerations (T, n) with which the load equation (8) of every spring holds."""
    q, turned, v, a = state
    elastic = [i for i, drive in enumerate(terms) if drive.spring is not None]
    if not elastic:
        return a
    # The torques are affine in a: unit steps of the drives' accelerations give the inertia.
    stepped = np.concatenate([a, *(a + C_inv[:, i] for i in elastic)])
    repeated, cosines, sines, speeds = (np.tile(x, (1 + len(elastic), 1)) for x in (q, *turned, v))
    torques = numbers.torques((repeated, (cosines, sines), speeds, stepped % PRIME), bodies)
    # ((1 + e) T, n) -> (1 + e, T, e): without a step, then one step per elastic drive.
    loads = numbers.product(torques, C_inv)[:, elastic].reshape(-1, *q[:, elastic].shape)
    inertia = ((loads[1:] - loads[0]) % PRIME).transpose(1, 2, 0)
    wanted = -loads[0]
    for place, i in enumerate(elastic):
        # (8) of elastic drives: r_L F - joint terms = torque of the bodies.
        force = numbers.value(terms[i].spring, drives[i]) * drives[i][r_L]
        wanted[:, place] += force - numbers.value(terms[i].joint, drives[i])
    change = numbers.solve(inertia, wanted % PRIME)
    return (a + numbers.product(change, C_inv.T[elastic])) % PRIME


def _drive_motor(
    numbers: ResidueNumbers, drive: DriveTerms, known: Known, load: Any, count: int
) -> None:
    """Add the torque, current and voltage of a motor: random, or those of the motion by (7)."""
    tau, current, voltage = (plain(MOTOR_SIGNALS[sensor]) for sensor in MOTOR_SIGNALS)
    if load is None:
        for signal in (tau, current, voltage, plain("tau_G")):
            known[signal] = numbers.random(count)
        return
    load = (load + numbers.value(drive.joint, known)) % PRIME
    known[plain("tau_G")] = load
    torque = _number(numbers, drive.share) * load + numbers.value(drive.motor, known)
    known[tau] = torque % PRIME
    for constant in (K_t, s_K):
        if constant in known:
            known[current] = numbers.over(known[tau], known[constant])
    if K_u in known:
        lost = known.get(BACK_EMF, 0) * known[plain("theta_M_dot")]
        known[voltage] = numbers.over(known[tau] + lost, known[K_u])


_MORE_INSTANTS = 6


@dataclass(frozen=True, eq=False)
class ExactDecision:
    """Base columns, which entries of their grouping are not zero (p, m), and rank and links.

    `links` are the pairs of base parameters that directions of the null space of true motions
    couple.
    """

    columns: tuple[int, ...]
    pattern: NDArray[np.bool_]
    rank: int
    coupled: frozenset[str]


def exact_decision(
    robot: Robot, sensors: Mapping[str, frozenset[str]], conditions: Sequence[Robot] = ()
) -> ExactDecision:
    """Return what sensors {joint: names} determine, for logs of the robot and of conditions."""
    exact = ResidueNumbers(robot, np.random.default_rng(0))
    system = system_of(robot, sensors, exact.depends())
    columns, rows = _free_echelon(system, exact)
    payloads = [condition.known_parameters for condition in (robot, *conditions)]
    on_motion = _motion_echelon(system, payloads, exact, columns)
    names = [system.names[column] for column in columns]
    rank, coupled = len(columns), set[str]()
    if on_motion is not None:
        pivots, links = on_motion
        rank = len(pivots)
        for free in (place for place in range(len(columns)) if place not in pivots):
            bound = [x for x, row in zip(pivots, links, strict=True) if row[free]]
            coupled.update(names[place] for place in [free, *bound])
    return ExactDecision(tuple(columns), np.asarray(rows != 0), rank, frozenset(coupled))


def _free_echelon(system: System, exact: ResidueNumbers) -> tuple[list[int], Residues]:
    """Return pivots and rows of the echelon form over free instants, added until the rank stays."""
    width, sums = len(system.names), len(system.sums)
    columns: list[int] = []
    rows: Residues = np.zeros((0, width), dtype=object)
    if not sums:
        return columns, rows
    truth = random_truth(exact, system)
    while True:
        new = columns_at_instants(exact, system, truth, width // sums + _MORE_INSTANTS)
        # a random combination of rows is in a row space if they all are
        mixed = exact.product(exact.random(len(new)), new)
        # In the reduced echelon form the entries at the pivots are the coefficients of the rows.
        if np.array_equal(mixed, exact.product(mixed[columns], rows)):
            return columns, rows
        columns, rows = echelon(np.vstack([rows, new]))


def _motion_echelon(
    system: System, payloads: Sequence[Array], exact: ResidueNumbers, columns: list[int]
) -> tuple[list[int], Residues] | None:
    """Return the echelon form of the combinations over true motions, None if it is surely full."""
    if not columns:
        return None
    truth, count = random_truth(exact, system), _instant_count(system, columns)
    rows = [
        columns_at_instants(exact, system, truth, count, _numbers(exact, payload))
        for payload in payloads
    ]
    return echelon(np.vstack(rows)[:, columns])


def _instant_count(system: System, columns: Sequence[int]) -> int:
    return len(columns) // len(system.sums) * 2 + 2 * _MORE_INSTANTS


def _numbers(numbers: ResidueNumbers, values: Array) -> Any:
    return np.array([numbers.number(float(x)) for x in values], dtype=object)
