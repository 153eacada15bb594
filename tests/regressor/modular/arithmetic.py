"""Residues of a prime, in which the equations of a robot are evaluated: a second route to a rank.

Residues are exact arithmetic without growth. A rational has a value modulo the prime, and dependent
rows stay dependent, so that a rank never comes out too large. It comes out too small only if a
random point is a zero of a nonzero polynomial, with a probability of at most degree / prime, 1e-6
here (Zippel 1979, Schwartz 1980).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property
from math import lcm
from typing import Any

import numpy as np
import sympy as sp
from flint import nmod_mat
from numpy.typing import NDArray

from seaid.regressor.exact.geometry import exact_number, exact_tree
from seaid.regressor.exact.program import Value, regressor_program
from seaid.robot import Robot

PRIME = 2**29 - 3
"""Sums of up to 32 products are below 2^63."""

Known = dict[sp.Expr, Any]
"""{symbol or function: its values}, each a number or (T,)."""


Residues = NDArray[np.object_]
"""Integers from 0 to PRIME - 1."""

States = tuple[Residues, tuple[Residues, Residues], Residues, Residues]
"""q, cosine and sine of all bodies' angles, v and a."""

_inverse = np.frompyfunc(lambda x: pow(x, -1, PRIME), 1, 1)

_Terms = list[tuple[int, tuple[str, ...]]]


def residue(value: Fraction) -> int:
    """Return a rational modulo PRIME."""
    return value.numerator * pow(value.denominator, -1, PRIME) % PRIME


@cache
def _program_of(robot: Robot) -> tuple[dict[str, _Terms], dict[tuple[int, int], _Terms]]:
    """Return steps and elements of the exact regressor of all bodies, coefficients as residues."""

    def terms(value: Value) -> _Terms:
        return [(residue(Fraction(int(x.p), int(x.q))), names) for names, x in value.items()]

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
class ResidueNumbers:
    """The numbers modulo PRIME, and the regressor of a robot in them.

    A function that is not rational, such as exp or tanh, is an independent number at every instant;
    sine and cosine of an angle satisfy sin^2 + cos^2 = 1, and a sign is 1 or -1.
    """

    robot: Robot
    rng: np.random.Generator

    def depends(self) -> NDArray[np.bool_]:
        """Return whether each torque (n,) depends on the motion of each joint (n,).

        These are those whose motion, changed at random, changes the torque of random bodies.
        """
        n, leaders = self.robot.n, np.array(self._leaders)
        first, second = (self.of_bodies(*self.states(1)) for _ in range(2))
        # Row 0 has the first motion throughout; in row 1 + k joint k has the second one.
        changed = np.vstack([np.zeros(len(leaders), dtype=bool), np.arange(n)[:, None] == leaders])
        states = [np.where(changed, new, old) for old, new in zip(first, second, strict=True)]
        torques = self._regressor(states) @ self.random(10 * len(leaders)) % PRIME
        return np.asarray((torques[1:] != torques[0]).T)

    @cached_property
    def _leaders(self) -> list[int]:
        """The independent joint of each body."""
        bodies = range(len(self.robot.all_joint_names))
        return [self.robot.index(self.robot.joint_of(i)) for i in bodies]

    @cached_property
    def _multipliers(self) -> list[Fraction]:
        """The multiplier of each body's joint."""
        numbers = [exact_number(joint.multiplier) for joint in self.robot.dependent_joints]
        exact = [Fraction(int(x.p), int(x.q)) for x in numbers]
        return [Fraction(1)] * self.robot.n + exact

    def number(self, value: float | Fraction) -> int:
        """Return the residue of a rational; a double counts as the decimal that it represents."""
        if not isinstance(value, Fraction):
            exact = exact_number(value)
            value = Fraction(int(exact.p), int(exact.q))
        return residue(value)

    def random(self, *shape: int) -> Residues:
        """Return random numbers, none of them zero."""
        return self.rng.integers(1, PRIME, shape).astype(object)

    def states(self, count: int) -> States:
        """Return random q, cosine and sine of all bodies' angles, v and a, of `count` instants.

        Cosine and sine are independent of q, because no polynomial relation links them. Those of
        a mimic joint, and of its leader, are of multiples of one angle.
        """
        q, turn, v, a = (self.random(count, self.robot.n) for _ in range(4))
        cosine, sine = _circle(turn)
        turned = np.zeros((2, count, len(self._leaders)), dtype=object)
        for body, leader in enumerate(self._leaders):
            pairs = zip(self._leaders, self._multipliers, strict=True)
            # The random angle is that of the leader over the common denominator of its multipliers.
            common = lcm(*(x.denominator for i, x in pairs if i == leader))
            turns = int(self._multipliers[body] * common)
            turned[:, :, body] = _turned(cosine[:, leader], sine[:, leader], turns)
        return q, (turned[0], turned[1]), v, a

    def regressor(self, state: States) -> Residues:
        """Return the joint-torque regressor (T, n, 10n), as `rigid_body_regressor`."""
        return self._regressor(self.of_bodies(*state))

    def torques(self, state: States, bodies: Residues) -> Residues:
        """Return `regressor` @ bodies, (T, n)."""
        return np.asarray(self.regressor(state) @ bodies % PRIME)

    def of_bodies(
        self, q: Residues, turned: tuple[Residues, Residues], v: Residues, a: Residues
    ) -> list[Residues]:
        """Return the states (T, b) of the joints of all bodies: q, cosine, sine, v and a."""
        factors = np.array([residue(x) for x in self._multipliers], dtype=object)
        q, v, a = (x[:, self._leaders] * factors % PRIME for x in (q, v, a))
        return [q, *turned, v, a]

    def _regressor(self, states: list[Residues]) -> Residues:
        """Return the regressor at states of all bodies, on the leaders: tau = E^T tau_all."""
        steps, entries = _program_of(self.robot)
        words = zip("qcsva", (x.astype(np.int64) for x in states), strict=True)
        bodies = range(len(self._leaders))
        known: dict[str, Any] = {f"{x}{b}": values[:, b] for x, values in words for b in bodies}
        for name, terms in steps.items():
            known[name] = _sum_of(terms, known)
        shape = len(states[0]), self.robot.n, 10 * len(self._leaders)
        sums = np.zeros(shape, dtype=object)
        for (body, column), terms in entries.items():
            share = residue(self._multipliers[body]) * _sum_of(terms, known)
            sums[:, self._leaders[body], column] += share
        return np.asarray(sums % PRIME)

    def product(self, A: Residues, B: Residues) -> Residues:
        """Return A @ B."""
        # Python's integers do not overflow: one reduction after the sum of products.
        return np.asarray((A @ B) % PRIME)

    def solve(self, matrix: Residues, right: Residues) -> Residues:
        """Return the solutions (T, e) of systems (T, e, e), (T, e)."""
        e = right.shape[1]
        solved = [
            nmod_mat(e, e, A.ravel().tolist(), PRIME).solve(nmod_mat(e, 1, b.tolist(), PRIME))
            for A, b in zip(matrix, right, strict=True)
        ]
        return np.array([[int(x) for x in solution.entries()] for solution in solved], dtype=object)

    def over(self, above: Any, below: Any) -> Any:
        """Return above / below."""
        return above * _inverse(below % PRIME) % PRIME

    def value(self, expression: sp.Expr, known: dict[sp.Expr, Any]) -> Any:
        """Return an expression of known symbols; the functions in it are added to `known`."""
        if expression in known:
            return known[expression]
        if isinstance(expression, sp.Rational):
            return residue(Fraction(int(expression.p), int(expression.q)))
        if isinstance(expression, sp.Add):
            return sum(self.value(part, known) for part in expression.args) % PRIME
        if isinstance(expression, sp.Mul):
            total: Any = 1
            for part in expression.args:
                total = total * self.value(part, known) % PRIME
            return total
        if isinstance(expression, sp.Pow) and expression.exp.is_Integer:
            return _power(self.value(expression.base, known), int(expression.exp))
        if isinstance(expression, sp.Abs):
            inside = expression.args[0]
            return self.value(inside, known) * self.value(sp.sign(inside), known) % PRIME
        known[expression] = self._function(expression, known)
        return known[expression]

    def _function(self, expression: sp.Expr, known: dict[sp.Expr, Any]) -> Residues:
        """Return random values of a function that is not rational, one per instant."""
        count = max(len(x) for x in known.values() if isinstance(x, np.ndarray))
        if isinstance(expression, sp.sign):
            # residues have no order: a random sign
            return np.where(self.rng.random(count) < 0.5, 1, PRIME - 1).astype(object)
        if isinstance(expression, sp.sin | sp.cos):
            angle = expression.args[0]
            cosine, sine = _circle(self.random(count))
            known[sp.cos(angle)], known[sp.sin(angle)] = cosine, sine
            return sine if isinstance(expression, sp.sin) else cosine
        return self.random(count)


def echelon(H: Residues) -> tuple[list[int], Residues]:
    """Return pivots and rows (p, m) of the reduced echelon form of H (R, m), leftmost pivots."""
    rows, width = H.shape
    reduced, rank = nmod_mat(rows, width, H.ravel().tolist(), PRIME).rref()
    table = [[int(x) for x in row] for row in reduced.tolist()[:rank]]
    kept = np.array(table, dtype=object).reshape(rank, width)
    return [int(np.flatnonzero(row)[0]) for row in kept], kept


def _circle(t: Residues) -> tuple[Residues, Residues]:
    """Return cosine (1 - t^2) / (1 + t^2) and sine 2 t / (1 + t^2) for half tangents t."""
    below = _inverse((1 + t * t) % PRIME)
    return (1 - t * t) * below % PRIME, 2 * t * below % PRIME


def _turned(cosine: Residues, sine: Residues, turns: int) -> tuple[Residues, Residues]:
    """Return cosine and sine of a multiple of an angle, by squaring of c + i s."""
    if turns == 1:
        return cosine, sine
    c, s = np.ones_like(cosine), np.zeros_like(sine)
    remaining = abs(turns)
    while remaining:
        if remaining % 2:
            c, s = (c * cosine - s * sine) % PRIME, (s * cosine + c * sine) % PRIME
        cosine, sine = (cosine**2 - sine**2) % PRIME, 2 * cosine * sine % PRIME
        remaining //= 2
    return c, (s if turns >= 0 else -s % PRIME)


def _power(base: Any, exponent: int) -> Any:
    total: Any = 1
    base = base if exponent > 0 else _inverse(base)
    for _ in range(abs(exponent)):
        total = total * base % PRIME
    return total
