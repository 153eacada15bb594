"""Structural identifiability without rounding: the equations of `sensor_equations` modulo a prime.

Residues of a prime are exact arithmetic without growth. A rational has a value modulo the prime,
and dependent rows stay dependent, so that a rank never comes out too large. It comes out too small
only if a random point is a zero of a nonzero polynomial, with a probability of at most degree /
prime, 1e-6 here (Zippel 1979, Schwartz 1980). A function that is not rational, such as exp or tanh,
is an independent number at every instant; sine and cosine satisfy sin^2 + cos^2 = 1, and a sign is
1 or -1. Instants are of two kinds, free ones and those of true motions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import sympy as sp
from flint import fmpq, fmpq_mat, nmod_mat
from numpy.typing import NDArray

from seaid.drives import PARAMETERS
from seaid.drives.equations import K_t, K_u, N, r_L, r_M, s_K
from seaid.regressor.exact.geometry import exact_number, exact_tree
from seaid.regressor.exact.program import Value, regressor_program
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

PRIME = 2**29 - 3
"""Products of two residues are below 2^63."""

Residues = NDArray[np.object_]
"""Integers from 0 to PRIME - 1."""

Known = dict[sp.Expr, Any]
"""{symbol or function: its values}, each a number or (T,)."""

States = tuple[Residues, Residues, Residues, Residues, Residues]
"""q (T, n), cosine and sine of the angles, v and a of the independent joints."""

_Terms = list[tuple[int, tuple[str, ...]]]
_STATES = ("", "_dot", "_ddot")
_power = np.frompyfunc(lambda x, exponent: pow(x, exponent, PRIME), 2, 1)


def residue(value: float | fmpq) -> int:
    """Return a rational modulo PRIME; a double counts as the decimal that it represents."""
    exact = value if isinstance(value, fmpq) else exact_number(float(value))
    return int(exact.p) * pow(int(exact.q), -1, PRIME) % PRIME


@dataclass(frozen=True, eq=False)
class ExactDecision:
    """Base columns, where their grouping is not zero (p, m), the rank, and what is up to scale.

    `coupled` are the base parameters in directions of the null space of true motions.
    """

    columns: tuple[int, ...]
    pattern: NDArray[np.bool_]
    rank: int
    coupled: frozenset[str]


def exact_decision(
    robot: Robot, sensors: Mapping[str, frozenset[str]], conditions: Sequence[Robot] = ()
) -> ExactDecision:
    """Return what sensors {joint: names} determine, for logs of the robot and of conditions."""
    bodies = _Bodies(robot, np.random.default_rng(0))
    system = system_of(robot, sensors, bodies.depends())
    columns, rows = _free_echelon(bodies, system)
    names = [system.names[column] for column in columns]
    rank, coupled = len(columns), set[str]()
    if columns:
        instants = _Instants(bodies, system)
        count = len(columns) // len(system.sums) * 2 + 12
        known = [condition.known_parameters for condition in (robot, *conditions)]
        payloads = [np.array(list(map(residue, values)), dtype=object) for values in known]
        motions = [instants.columns(count, payload) for payload in payloads]
        pivots, links = echelon(np.vstack(motions)[:, columns])
        rank = len(pivots)
        for free in (place for place in range(len(columns)) if place not in pivots):
            bound = [x for x, row in zip(pivots, links, strict=True) if row[free]]
            coupled.update(names[place] for place in [free, *bound])
    return ExactDecision(tuple(columns), np.asarray(rows != 0), rank, frozenset(coupled))


def _free_echelon(bodies: _Bodies, system: System) -> tuple[list[int], Residues]:
    """Return pivots and rows of the echelon form over free instants, added until the rank stays."""
    columns: list[int] = []
    rows: Residues = np.zeros((0, len(system.names)), dtype=object)
    if not system.sums:
        return columns, rows
    instants = _Instants(bodies, system)
    while True:
        new = instants.columns(len(system.names) // len(system.sums) + 6)
        # A random combination of rows is in a row space if they all are. In the reduced echelon
        # form the entries at the pivots are the coefficients of the rows.
        mixed = bodies.random(len(new)) @ new % PRIME
        if np.array_equal(mixed, mixed[columns] @ rows % PRIME):
            return columns, rows
        columns, rows = echelon(np.vstack([rows, new]))


def echelon(H: Residues) -> tuple[list[int], Residues]:
    """Return pivots and rows (p, m) of the reduced echelon form of H (R, m), leftmost pivots."""
    rows, width = H.shape
    reduced, rank = nmod_mat(rows, width, H.ravel().tolist(), PRIME).rref()
    table = [[int(x) for x in row] for row in reduced.tolist()[:rank]]
    kept = np.array(table, dtype=object).reshape(rank, width)
    return [int(np.flatnonzero(row)[0]) for row in kept], kept


# Rigid bodies: seaid's exact program of the regressor, evaluated modulo the prime


@cache
def _program_of(robot: Robot) -> tuple[dict[str, _Terms], dict[tuple[int, int], _Terms]]:
    """Return steps and elements of the exact regressor of all bodies, coefficients as residues."""

    def terms(value: Value) -> _Terms:
        return [(residue(x), names) for names, x in value.items()]

    program, entries = regressor_program(exact_tree(robot))
    steps = {name: terms(value) for name, value in program.steps.items()}
    return steps, {place: terms(value) for place, value in entries.items()}


def _sum_of(terms: _Terms, known: dict[str, Any]) -> Any:
    total: Any = 0
    for coefficient, names in terms:
        product: Any = coefficient
        for name in names:
            product = product * known[name] % PRIME
        total = total + product
    return total % PRIME


@dataclass(frozen=True, eq=False)
class _Bodies:
    """The rigid bodies of a robot, at random states."""

    robot: Robot
    rng: np.random.Generator

    @cached_property
    def leaders(self) -> list[int]:
        """The independent joint of each body."""
        robot = self.robot
        return [robot.index(robot.joint_of(i)) for i in range(len(robot.all_joint_names))]

    @cached_property
    def signs(self) -> Residues:
        """The multiplier of each body's joint, 1 or -1."""
        followers = [round(joint.multiplier) for joint in self.robot.dependent_joints]
        assert all(abs(joint.multiplier) == 1 for joint in self.robot.dependent_joints)
        return np.array([1] * self.robot.n + followers, dtype=object)

    def random(self, *shape: int) -> Residues:
        """Return random numbers, none of them zero."""
        return self.rng.integers(1, PRIME, shape).astype(object)

    def states(self, count: int) -> States:
        """Return random states of `count` instants; no polynomial links q to its cosine."""
        q, turn, v, a = (self.random(count, self.robot.n) for _ in range(4))
        return q, *_circle(turn), v, a

    def regressor(self, states: Sequence[Residues]) -> Residues:
        """Return the joint-torque regressor (T, n, 10N), of leaders by tau = E^T tau_all."""
        steps, entries = _program_of(self.robot)
        signs = self.signs, np.abs(self.signs), self.signs, self.signs, self.signs  # cos is even
        known: dict[str, Any] = {}
        for name, state, sign in zip("qcsva", states, signs, strict=True):
            of_bodies = (state[:, self.leaders] * sign % PRIME).astype(np.int64)
            known |= {f"{name}{body}": values for body, values in enumerate(of_bodies.T)}
        for name, terms in steps.items():
            known[name] = _sum_of(terms, known)
        shape = len(states[0]), self.robot.n, 10 * len(self.leaders)
        sums = np.zeros(shape, dtype=object)
        for (body, column), terms in entries.items():
            sums[:, self.leaders[body], column] += self.signs[body] * _sum_of(terms, known)
        return np.asarray(sums % PRIME)

    def depends(self) -> NDArray[np.bool_]:
        """Return whether each torque (n,) depends on the motion of each joint (n,).

        These are those whose motion, changed at random, changes the torque of random bodies.
        """
        first, second = self.states(1), self.states(1)
        # Row 0 has the first motion throughout; in row 1 + k joint k has the second one.
        changed = np.eye(self.robot.n + 1, self.robot.n, -1, dtype=bool)
        states = [np.where(changed, new, old) for old, new in zip(first, second, strict=True)]
        torques = self.regressor(states) @ self.random(10 * len(self.leaders)) % PRIME
        return np.asarray((torques[1:] != torques[0]).T)


# Instants, and the columns of the equations at them


class _Instants:
    """Random true values of all unknown parameters, and columns of the equations at instants."""

    def __init__(self, bodies: _Bodies, system: System) -> None:
        self.of, self.system, robot = bodies, system, system.robot
        exact = fmpq_mat([[exact_number(x) for x in row] for row in robot.transmission])
        self.C, self.C_inv = (
            np.array([[residue(x) for x in row] for row in matrix.tolist()], dtype=object)
            for matrix in (exact, exact.inv())
        )
        self.bodies = bodies.random(robot.parameters.size) * ~robot.is_known
        self.drives: list[Known] = []
        for drive in system.terms:
            known: Known = {symbol: residue(x) for symbol, x in drive.known.items()}
            # Of the size of motor speeds, so that tanh(w / w_C) and exp(-(w / w_S)^2) change.
            speed = residue(3.0 * (drive.drive.ratio if drive.spring is None else 1.0))
            for symbol, name in zip(drive.unknowns, drive.names, strict=True):
                is_speed = name in PARAMETERS and PARAMETERS[name].unit == "rad/s"
                known[symbol] = bodies.random(1)[0] * (speed if is_speed else 1) % PRIME
            self.drives.append(known)

    def columns(self, count: int, payload: Residues | None = None) -> Residues:
        """Return the derivatives (count * W, m) of the sums of equations by all unknown parameters.

        Instants are free or, with the known parameters `payload` (10N,), those of a true motion.
        """
        robot, terms, system = self.system.robot, self.system.terms, self.system
        Y, signals = self._at(count, payload)
        width = robot.parameters.size
        starts = np.cumsum([width, *(len(drive.unknowns) for drive in terms)]).tolist()
        H = np.zeros((count, len(system.sums), starts[-1]), dtype=object)
        for e in sorted(system.used):
            equation = system.equations[e]
            slopes = np.zeros((count, starts[-1]), dtype=object)
            if equation.kind == "load":
                # In (8) the rigid bodies' torque has a minus; known bodies have no column.
                slopes[:, :width] = -Y[:, equation.index] * ~robot.is_known
            for i, factor, expression in equation.parts:
                for place, symbol in enumerate(terms[i].unknowns, starts[i]):
                    slope = _slope(expression, symbol)
                    if slope != 0:
                        slopes[:, place] += residue(factor) * self._value(slope, signals[i])
            for w, sums in enumerate(system.sums):
                if e in sums:
                    H[:, w] += residue(sums[e]) * (slopes % PRIME)
        return np.asarray(H % PRIME).reshape(-1, starts[-1])

    def _at(self, count: int, payload: Residues | None) -> tuple[Residues, list[Known]]:
        """Return the regressor (T, n, 10N) at random instants and the signals of every drive."""
        robot, terms, state = self.system.robot, self.system.terms, self.of.states(count)
        signals: list[Known] = []
        for i, drive in enumerate(terms):
            known = {**self.drives[i], **self._load_signals(i, state)}
            self._turn_motor(drive, known, count)
            signals.append(known)
        Y, loads = self.of.regressor(state), [None] * robot.n
        if payload is not None:
            bodies = (self.bodies + payload) % PRIME
            a = self._balanced(signals, state, bodies)
            for i, drive in enumerate(terms):
                signals[i][plain("theta_L_ddot")] = a @ self.C[i] % PRIME
                # Stiff drives' motors follow the new accelerations; others stay as drawn.
                if drive.spring is None:
                    self._turn_motor(drive, signals[i], count)
            Y = self.of.regressor((*state[:4], a))
            loads = list((Y @ bodies % PRIME @ self.C_inv % PRIME).T)
        for drive, known, load in zip(terms, signals, loads, strict=True):
            self._drive_motor(drive, known, load, count)
        return Y, signals

    def _load_signals(self, i: int, state: States) -> Known:
        """Return the states of a drive's coordinate C q; of a joint also cosine and sine."""
        (q, cosine, sine, v, a), robot = state, self.system.robot
        pairs = zip(_STATES, (q, v, a), strict=True)
        known: Known = {plain(f"theta_L{suffix}"): x @ self.C[i] % PRIME for suffix, x in pairs}
        if not robot.is_prismatic[i] and np.array_equal(robot.transmission[i], np.eye(robot.n)[i]):
            angle = plain("theta_L")
            known |= {sp.cos(angle): cosine[:, i], sp.sin(angle): sine[:, i]}
        return known

    def _turn_motor(self, drive: DriveTerms, known: Known, count: int) -> None:
        """Add the motor's states: N times the joint's for a stiff drive, else random ones."""
        for suffix in _STATES:
            load, motor = known[plain(f"theta_L{suffix}")], plain(f"theta_M{suffix}")
            if drive.spring is None:
                known[motor] = known[N] * load % PRIME
                continue
            known[motor] = self.of.random(count)
            if suffix == "":
                # (3): the deflection is drawn, and theta_M = N / r_M (d + r_L theta_L) follows.
                known[STRETCH] = self.of.random(count)
                stretched = known[STRETCH] + known[r_L] * load
                known[motor] = _over(known[N], known[r_M]) * stretched % PRIME
            elif suffix == "_dot":
                rate = _over(known[r_M] * known[motor], known[N])
                known[STRETCH_DOT] = (rate - known[r_L] * load) % PRIME

    def _balanced(self, signals: Sequence[Known], state: States, bodies: Residues) -> Residues:
        """Return accelerations (T, n) with which the load equation (8) of every spring holds."""
        terms, a = self.system.terms, state[4]
        elastic = [i for i, drive in enumerate(terms) if drive.spring is not None]
        if not elastic:
            return a
        # The torques are affine in a: unit steps of the drives' accelerations give the inertia.
        stepped = np.concatenate([a, *(a + self.C_inv[:, i] for i in elastic)]) % PRIME
        repeated = [np.tile(x, (1 + len(elastic), 1)) for x in state[:4]]
        torques = self.of.regressor([*repeated, stepped]) @ bodies % PRIME
        # ((1 + e) T, n) -> (1 + e, T, e): without a step, then one step per elastic drive.
        loads = (torques @ self.C_inv % PRIME)[:, elastic].reshape(-1, len(a), len(elastic))
        inertia = ((loads[1:] - loads[0]) % PRIME).transpose(1, 2, 0)
        wanted = -loads[0]
        for place, i in enumerate(elastic):
            # (8) of elastic drives: r_L F - joint terms = torque of the bodies.
            force = self._value(terms[i].spring, signals[i]) * signals[i][r_L]
            wanted[:, place] += force - self._value(terms[i].joint, signals[i])
        change = _solved(inertia, wanted % PRIME)
        return np.asarray((a + change @ self.C_inv.T[elastic]) % PRIME)

    def _drive_motor(self, drive: DriveTerms, known: Known, load: Any, count: int) -> None:
        """Add the torque, current and voltage of a motor: random, or those of the motion by (7)."""
        tau, current, voltage = (plain(MOTOR_SIGNALS[sensor]) for sensor in MOTOR_SIGNALS)
        if load is None:
            for signal in (tau, current, voltage, plain("tau_G")):
                known[signal] = self.of.random(count)
            return
        load = (load + self._value(drive.joint, known)) % PRIME
        known[plain("tau_G")] = load
        known[tau] = (residue(drive.share) * load + self._value(drive.motor, known)) % PRIME
        for constant in (K_t, s_K):
            if constant in known:
                known[current] = _over(known[tau], known[constant])
        if K_u in known:
            lost = known.get(BACK_EMF, 0) * known[plain("theta_M_dot")]
            known[voltage] = _over(known[tau] + lost, known[K_u])

    def _value(self, expression: sp.Expr, known: Known) -> Any:
        """Return an expression of known symbols; the functions in it are added to `known`."""
        if expression in known:
            return known[expression]
        if isinstance(expression, sp.Rational):
            return residue(fmpq(int(expression.p), int(expression.q)))
        if isinstance(expression, sp.Add):
            return sum(self._value(part, known) for part in expression.args) % PRIME
        if isinstance(expression, sp.Mul):
            total: Any = 1
            for part in expression.args:
                total = total * self._value(part, known) % PRIME
            return total
        if isinstance(expression, sp.Pow) and expression.exp.is_Integer:
            return _power(self._value(expression.base, known), int(expression.exp))
        if isinstance(expression, sp.Abs):
            inside = expression.args[0]
            return self._value(inside, known) * self._value(sp.sign(inside), known) % PRIME
        self._add_function(expression, known)
        return known[expression]

    def _add_function(self, expression: sp.Expr, known: Known) -> None:
        """Add random values of a function that is not rational, one per instant."""
        count = max(len(x) for x in known.values() if isinstance(x, np.ndarray))
        if isinstance(expression, sp.sign):
            # residues have no order: a random sign
            is_positive = self.of.rng.random(count) < 0.5
            known[expression] = np.where(is_positive, 1, PRIME - 1).astype(object)
        elif isinstance(expression, sp.sin | sp.cos):
            angle = expression.args[0]
            known[sp.cos(angle)], known[sp.sin(angle)] = _circle(self.of.random(count))
        else:
            known[expression] = self.of.random(count)


@cache
def _slope(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative by a parameter; that of a step is zero."""
    return expression.diff(symbol).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


def _over(above: Any, below: Any) -> Any:
    return above * _power(below % PRIME, -1) % PRIME


def _solved(matrix: Residues, right: Residues) -> Residues:
    """Return the solutions (T, e) of systems (T, e, e), (T, e)."""
    e = right.shape[1]
    solved = [
        nmod_mat(e, e, A.ravel().tolist(), PRIME).solve(nmod_mat(e, 1, b.tolist(), PRIME))
        for A, b in zip(matrix, right, strict=True)
    ]
    return np.array([[int(x) for x in solution.entries()] for solution in solved], dtype=object)


def _circle(t: Residues) -> tuple[Residues, Residues]:
    """Return cosine (1 - t^2) / (1 + t^2) and sine 2 t / (1 + t^2) for half tangents t."""
    below = _power((1 + t * t) % PRIME, -1)
    return (1 - t * t) * below % PRIME, 2 * t * below % PRIME
