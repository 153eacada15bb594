"""The rank decision of structural identifiability: modulo a prime, and again in doubles.

The equations are evaluated at random instants of two kinds. At a free instant every signal is a
random number: these give the combinations of parameters that occur in the equations. At an instant
of a true motion all equations hold for random true parameters, so that signals are dependent (the
deflection of a spring is the torque of the bodies behind it over its stiffness): these give the
rank that a log can reach, and the groups of parameters that are identifiable up to scale.
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

from seaid._arrays import Array, BoolArray, connected_groups, frozen, safely
from seaid.drives import PARAMETERS, K_t, K_u, N, r_L, r_M, s_K
from seaid.errors import SymbolicError
from seaid.regressor.base import BaseParameters, left_to_right
from seaid.regressor.exact.grouping import exact_text
from seaid.regressor.structural.arithmetic import (
    Known,
    Numbers,
    RealNumbers,
    ResidueNumbers,
    Residues,
    echelon,
    short_fraction,
)
from seaid.regressor.structural.equations import (
    BACK_EMF,
    MOTOR_SIGNALS,
    STRETCH,
    STRETCH_DOT,
    DriveTerms,
    System,
    exact_transmission,
    plain,
)
from seaid.robot import Robot

_STATES = ("", "_dot", "_ddot")


@dataclass(frozen=True, eq=False)
class Truth:
    """True values of the unknown standard parameters (10n,) and of the symbols of each drive."""

    bodies: Any
    drives: tuple[Mapping[sp.Expr, Any], ...]


def random_truth(numbers: Numbers, system: System) -> Truth:
    """Return random values of all unknown parameters, and the known values."""
    drives = []
    for drive in system.terms:
        known: Known = {symbol: numbers.number(x) for symbol, x in drive.known.items()}
        for symbol, name in zip(drive.unknowns, drive.names, strict=True):
            value = numbers.random(1)[0]
            # Of the size of motor speeds, so that tanh(w / w_C) and exp(-(w / w_S)^2) change.
            is_speed = name in PARAMETERS and PARAMETERS[name].unit == "rad/s"
            known[symbol] = (
                numbers.reduced(value * numbers.number(_speed(drive))) if is_speed else value
            )
        drives.append(known)
    bodies = numbers.random(system.robot.parameters.size)
    bodies[system.robot.is_known] = 0
    return Truth(bodies, tuple(drives))


def _speed(drive: DriveTerms) -> float:
    """Return the typical motor speed [rad/s] of random states."""
    return 3.0 * (drive.drive.ratio if drive.spring is None else 1.0)


def columns_at_instants(
    numbers: Numbers, system: System, truth: Truth, count: int, payload: Any = None
) -> Any:
    """Return the derivatives (count * W, m) of the sums of equations by all unknown parameters.

    Instants are free or, with the known parameters `payload` (10N,), those of a true motion.
    """
    robot, terms, sums = system.robot, system.terms, system.sums
    Y, drives = _instants(numbers, robot, terms, truth, count, payload)
    bodies = robot.parameters.size
    starts = np.cumsum([bodies, *(len(drive.unknowns) for drive in terms)]).tolist()
    H = np.zeros((count, len(sums), starts[-1]), dtype=Y.dtype)
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
        for w in np.flatnonzero(sums[:, e] != 0):
            H[:, w] += _number(numbers, sums[w, e]) * numbers.reduced(slopes)
    return numbers.reduced(H).reshape(-1, starts[-1])


@cache
def _slope(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative by a parameter; that of a step is zero."""
    return expression.diff(symbol).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


def _number(numbers: Numbers, value: fmpq) -> Any:
    return numbers.number(Fraction(int(value.p), int(value.q)))


def _matrix(numbers: Numbers, matrix: fmpq_mat, dtype: Any) -> Any:
    rows = [[_number(numbers, x) for x in row] for row in matrix.tolist()]
    return np.array(rows, dtype=dtype)


def _instants(
    numbers: Numbers,
    robot: Robot,
    terms: Sequence[DriveTerms],
    truth: Truth,
    count: int,
    payload: Any,
) -> tuple[Any, list[Known]]:
    """Return the regressor (T, n, 10n) at random instants and the signals of every drive."""
    q, turned, v, a = numbers.states(count)
    exact = exact_transmission(robot)
    C, C_inv = (_matrix(numbers, x, q.dtype) for x in (exact, exact.inv()))
    drives: list[Known] = []
    for i, drive in enumerate(terms):
        known = {**truth.drives[i], **_load_signals(numbers, robot, i, C[i], (q, turned, v, a))}
        _turn_motor(numbers, drive, known, count)
        drives.append(known)
    if payload is None:
        Y, loads = numbers.regressor(q, turned, v, a), [None] * robot.n
    else:
        bodies = numbers.reduced(truth.bodies + payload)
        a = _balanced(numbers, terms, drives, (q, turned, v, a), C_inv, bodies)
        for i, drive in enumerate(terms):
            drives[i][plain("theta_L_ddot")] = numbers.product(a, C[i])
            # Stiff drives' motors follow the new accelerations; behind springs they stay as drawn.
            if drive.spring is None:
                _turn_motor(numbers, drive, drives[i], count)
        Y = numbers.regressor(q, turned, v, a)
        loads = list(numbers.product(numbers.product(Y, bodies), C_inv).T)
    for drive, known, load in zip(terms, drives, loads, strict=True):
        _drive_motor(numbers, drive, known, load, count)
    return Y, drives


def _load_signals(
    numbers: Numbers, robot: Robot, i: int, row: Any, state: tuple[Any, Any, Any, Any]
) -> Known:
    """Return the states of a drive's coordinate `row` @ q; of a joint also cosine and sine."""
    q, turned, v, a = state
    pairs = zip(_STATES, (q, v, a), strict=True)
    known: Known = {plain(f"theta_L{suffix}"): numbers.product(x, row) for suffix, x in pairs}
    if not robot.is_prismatic[i] and np.array_equal(robot.transmission[i], np.eye(robot.n)[i]):
        for function, values in zip((sp.cos, sp.sin), turned, strict=True):
            known[function(plain("theta_L"))] = values[:, i]
    return known


def _turn_motor(numbers: Numbers, drive: DriveTerms, known: Known, count: int) -> None:
    """Add the motor's states: N times the joint's for a stiff drive, else random ones."""
    for suffix in _STATES:
        load = known[plain(f"theta_L{suffix}")]
        motor = plain(f"theta_M{suffix}")
        if drive.spring is None:
            known[motor] = numbers.reduced(known[N] * load)
            continue
        known[motor] = numbers.signal(count)
        if suffix == "":
            # (3): the deflection is drawn, and theta_M = N / r_M (d + r_L theta_L) follows.
            known[STRETCH] = numbers.signal(count)
            into = numbers.over(known[N], known[r_M])
            stretched = numbers.reduced(known[STRETCH] + known[r_L] * load)
            known[motor] = numbers.reduced(into * stretched)
        elif suffix == "_dot":
            rate = numbers.over(known[r_M] * known[motor], known[N])
            known[STRETCH_DOT] = numbers.reduced(rate - known[r_L] * load)


def _balanced(
    numbers: Numbers,
    terms: Sequence[DriveTerms],
    drives: Sequence[Known],
    state: tuple[Any, Any, Any, Any],
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
    repeated, *turns, speeds = (np.tile(x, (1 + len(elastic), 1)) for x in (q, *turned, v))
    torques = numbers.torques(repeated, tuple(turns), speeds, numbers.reduced(stepped), bodies)
    # ((1 + e) T, n) -> (1 + e, T, e): without a step, then one step per elastic drive.
    loads = numbers.product(torques, C_inv)[:, elastic].reshape(-1, *q[:, elastic].shape)
    inertia = numbers.reduced(loads[1:] - loads[0]).transpose(1, 2, 0)
    wanted = -loads[0]
    for place, i in enumerate(elastic):
        # (8) of elastic drives: r_L F - joint terms = torque of the bodies.
        force = numbers.value(terms[i].spring, drives[i]) * drives[i][r_L]
        wanted[:, place] += force - numbers.value(terms[i].joint, drives[i])
    change = numbers.solve(inertia, numbers.reduced(wanted))
    return numbers.reduced(a + numbers.product(change, C_inv.T[elastic]))


def _drive_motor(numbers: Numbers, drive: DriveTerms, known: Known, load: Any, count: int) -> None:
    """Add the torque, current and voltage of a motor: random, or those of the motion by (7)."""
    tau, current, voltage = (plain(MOTOR_SIGNALS[sensor]) for sensor in MOTOR_SIGNALS)
    if load is None:
        for signal in (tau, current, voltage, plain("tau_G")):
            known[signal] = numbers.signal(count)
        return
    load = numbers.reduced(load + numbers.value(drive.joint, known))
    known[plain("tau_G")] = load
    torque = numbers.value(drive.share, known) * load + numbers.value(drive.motor, known)
    known[tau] = numbers.reduced(torque)
    for constant in (K_t, s_K):
        if constant in known:
            known[current] = numbers.over(known[tau], known[constant])
    if K_u in known:
        lost = known.get(BACK_EMF, 0) * known[plain("theta_M_dot")]
        known[voltage] = numbers.over(numbers.reduced(known[tau] + lost), known[K_u])


_MORE_INSTANTS = 6
_SAME = 1e-7
_ROUNDING = 1e-9

Decision = tuple[BaseParameters, tuple[tuple[int, ...], ...], int, bool]
"""Combinations, groups of them (as indices) up to scale, rank, and whether doubles agree."""


def decide(
    system: System, payloads: Sequence[Array], exact: ResidueNumbers, numeric: RealNumbers
) -> Decision:
    """Return the identifiable combinations, for logs with each of the known `payloads` (10n,)."""
    columns, rows = _free_echelon(system, exact)
    on_motion = _motion_echelon(system, payloads, exact, columns)
    groups = _groups(on_motion, len(columns))
    rank = len(on_motion[0]) if on_motion is not None else len(columns)
    grouping, gap, agree = _numeric_grouping(system, payloads, numeric, columns, rows, rank)
    names = system.names
    base = BaseParameters(
        columns=tuple(columns),
        names=tuple(names[column] for column in columns),
        expressions=tuple(
            exact_text(_fractions(row, values), names)
            for row, values in zip(rows, grouping, strict=True)
        ),
        grouping=frozen("grouping", grouping, (None, len(names))),
        gap=gap,
    )
    return base, groups, rank, agree


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
    if not columns or not _can_be_homogeneous(system):
        return None
    truth, count = random_truth(exact, system), _instant_count(system, columns)
    rows = [
        columns_at_instants(exact, system, truth, count, _numbers(exact, payload))
        for payload in payloads
    ]
    return echelon(np.vstack(rows)[:, columns])


def _can_be_homogeneous(system: System) -> bool:
    """Whether the equations can be homogeneous: a dependent signal has an unknown parameter."""
    signals = {plain(name) for name in MOTOR_SIGNALS.values()}
    return any(
        system.terms[i].spring is not None or expression.free_symbols & signals
        for e in system.used
        for i, _, expression in system.equations[e].parts
    )


def _instant_count(system: System, columns: Sequence[int]) -> int:
    return len(columns) // len(system.sums) * 2 + 2 * _MORE_INSTANTS


def _numbers(numbers: Numbers, values: Array) -> Any:
    return np.array([numbers.number(float(x)) for x in values], dtype=object)


def _groups(on_motion: tuple[list[int], Residues] | None, p: int) -> tuple[tuple[int, ...], ...]:
    """Return the groups of combinations that are coupled by directions of the null space."""
    if on_motion is None:
        return ()
    pivots, rows = on_motion
    links = np.zeros((p, p), dtype=bool)
    # A column that is no pivot on true motions is coupled to the pivots it depends on.
    for free in (place for place in range(p) if place not in pivots):
        links[free, [pivot for pivot, row in zip(pivots, rows, strict=True) if row[free]]] = True
        links[free, free] = True
    coupled = np.any(links, axis=0) | np.any(links, axis=1)
    return tuple(tuple(group) for group in connected_groups(links) if coupled[group[0]])


def _numeric_grouping(
    system: System,
    payloads: Sequence[Array],
    numeric: RealNumbers,
    columns: list[int],
    rows: Residues,
    rank: int,
) -> tuple[Array, float, bool]:
    """Return the grouping of the exact base columns, the gap, and whether doubles agree."""
    width = len(system.names)
    if not columns:
        return np.zeros((0, width)), float("inf"), True
    truth = random_truth(numeric, system)
    count = 2 * (width // len(system.sums)) + 4 * _MORE_INSTANTS
    H = columns_at_instants(numeric, system, truth, count)
    numeric_columns, grouping, gap = left_to_right(H, _negligible(system, H))
    agree = numeric_columns == columns
    if not agree:
        grouping = safely(
            np.linalg.lstsq,
            H[:, columns],
            H,
            what="the identifiable combinations",
            error=SymbolicError,
            rcond=None,
        )[0]
    seen = np.abs(grouping) > _SAME * np.max(np.abs(grouping), axis=1, keepdims=True)
    exact = rows != 0  # an entry that is zero in doubles only belongs to an irrational direction
    agree &= not np.any(seen & ~exact)
    numeric_rank = _rank_in_doubles(system, payloads, numeric, columns, truth)
    return np.where(exact, grouping, 0.0), gap, bool(agree and numeric_rank == rank)


def _rank_in_doubles(
    system: System,
    payloads: Sequence[Array],
    numeric: RealNumbers,
    columns: list[int],
    truth: Truth,
) -> int:
    if not _can_be_homogeneous(system):
        return len(columns)
    count = 2 * _instant_count(system, columns)
    rows = [columns_at_instants(numeric, system, truth, count, payload) for payload in payloads]
    return len(left_to_right(np.vstack(rows)[:, columns])[0])


def _negligible(system: System, H: Array) -> BoolArray:
    """Return which columns of bodies are zero up to rounding, as `base.negligible`."""
    norms, bodies = np.linalg.norm(H, axis=0), np.arange(H.shape[1]) < system.robot.parameters.size
    return np.asarray(bodies & (norms < 1e-9 * norms[bodies].max(initial=0.0)))


def _fractions(row: Residues, values: Array) -> dict[int, Fraction]:
    """Return a row of the grouping as rationals: exact ones if short, else the doubles."""
    fractions = {}
    for column in np.flatnonzero(values).tolist():
        value = float(values[column])
        near = short_fraction(int(row[column])), Fraction(round(value)), Fraction(value)
        fractions[column] = next(x for x in near if x and abs(x - value) <= _ROUNDING * abs(value))
    return fractions
