"""Two kinds of numbers in which the same equations are evaluated: doubles, and residues of a prime.

Residues are exact arithmetic without growth. A rational has a value modulo the prime, and dependent
rows stay dependent, so that a rank never comes out too large. It comes out too small only if a
random point is a zero of a nonzero polynomial, with a probability of at most degree / prime, 1e-15
here (Zippel 1979, Schwartz 1980).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property, lru_cache
from math import isqrt, lcm
from typing import Any, Protocol

import numpy as np
import sympy as sp
from flint import nmod_mat
from numpy.typing import NDArray

from seaid._arrays import Array, safely
from seaid.errors import SymbolicError
from seaid.regressor.base import random_states
from seaid.regressor.exact.codegen import Program, Value, needed
from seaid.regressor.exact.geometry import exact_number, exact_tree
from seaid.regressor.exact.newton_euler import Entries, regressor_program
from seaid.regressor.rigid_body import joint_torques, rigid_body_regressor
from seaid.robot import Robot

Known = dict[sp.Expr, Any]
"""{symbol or function: its values}, each a number or (T,)."""


class Numbers(Protocol):
    """The operations of a kind of numbers; arrays are numpy's."""

    def number(self, value: float | Fraction) -> Any:
        """Return a rational number."""

    def random(self, *shape: int) -> Any:
        """Return random numbers, none of them zero."""

    def signal(self, count: int) -> Any:
        """Return random values (count,) of a signal."""

    def states(self, count: int) -> tuple[Any, Any, Any, Any]:
        """Return random q, v and a, each (count, n), and cosine and sine of the joints."""

    def regressor(self, q: Any, turned: Any, v: Any, a: Any) -> Any:
        """Return the joint-torque regressor (T, n, 10n)."""

    def torques(self, q: Any, turned: Any, v: Any, a: Any, bodies: Any) -> Any:
        """Return `regressor` @ bodies, (T, n)."""

    def product(self, left: Any, right: Any) -> Any:
        """Return left @ right."""

    def solve(self, matrix: Any, right: Any) -> Any:
        """Return the solutions (T, e) of (T, e, e) and (T, e)."""

    def value(self, expression: sp.Expr, known: Known) -> Any:
        """Return the values of an expression."""

    def over(self, above: Any, below: Any) -> Any:
        """Return above / below."""

    def reduced(self, values: Any) -> Any:
        """Return the canonical representatives of sums and products."""


@dataclass(frozen=True, eq=False)
class RealNumbers:
    """Doubles, and the regressor by Pinocchio."""

    robot: Robot
    rng: np.random.Generator

    def number(self, value: float | Fraction) -> float:
        """Return the double."""
        return float(value)

    def random(self, *shape: int) -> Array:
        """Return numbers between 0.5 and 1.5."""
        return self.rng.uniform(0.5, 1.5, shape)

    def signal(self, count: int) -> Array:
        """Return random values of a signal, of both signs."""
        return self.rng.normal(0, 3, count)

    def states(self, count: int) -> tuple[Array, tuple[Array, Array], Array, Array]:
        """Return random q, its cosine and sine, v and a, as `base.random_states`."""
        drawn = [random_states(self.robot, int(self.rng.integers(2**31)))]
        while sum(len(q) for q, _, _ in drawn) < count:
            drawn.append(random_states(self.robot, int(self.rng.integers(2**31))))
        q, v, a = (np.concatenate(parts)[:count] for parts in zip(*drawn, strict=True))
        return q, (np.cos(q), np.sin(q)), v, a

    def regressor(self, q: Array, turned: object, v: Array, a: Array) -> Array:
        """Return the joint-torque regressor (T, n, 10n)."""
        return rigid_body_regressor(self.robot, q, v, a)

    def torques(self, q: Array, turned: object, v: Array, a: Array, bodies: Array) -> Array:
        """Return `regressor` @ bodies, (T, n)."""
        own = bodies - self.robot.payload_parameters
        return joint_torques(self.robot.with_values(own, self.robot.drives), q, v, a)

    def product(self, left: Array, right: Array) -> Array:
        """Return left @ right."""
        return np.asarray(left @ right)

    def solve(self, matrix: Array, right: Array) -> Array:
        """Return the solutions (T, e) of (T, e, e) and (T, e)."""
        return np.asarray(
            safely(
                np.linalg.solve,
                matrix,
                right[..., None],
                what="the motion of the sensors",
                error=SymbolicError,
            )[..., 0]
        )

    def value(self, expression: sp.Expr, known: Known) -> Any:
        """Return the values of an expression of known symbols."""
        function, symbols = _compiled(expression)
        return function(*(known[symbol] for symbol in symbols))

    def over(self, above: Any, below: Any) -> Any:
        """Return above / below."""
        return above / below

    def reduced(self, values: Any) -> Any:
        """Return the values: doubles always are."""
        return values


@cache
def _compiled(expression: sp.Expr) -> tuple[Any, list[sp.Symbol]]:
    symbols = sorted(expression.free_symbols, key=str)
    return sp.lambdify(symbols, expression, modules=[np]), symbols


PRIME = 2**61 - 1
"""A Mersenne prime that fits in a machine word."""

Residues = NDArray[np.object_]
"""Integers from 0 to PRIME - 1."""

_inverse = np.frompyfunc(lambda x: pow(x, -1, PRIME), 1, 1)


@dataclass(frozen=True, eq=False)
class ResidueNumbers:
    """The numbers modulo PRIME, and the regressor of a robot in them.

    A function that is not rational, such as exp or tanh, is an independent number at every instant;
    sine and cosine of an angle satisfy sin^2 + cos^2 = 1, and a sign is 1 or -1.
    """

    robot: Robot
    rng: np.random.Generator

    @property
    def _program(self) -> tuple[Program, Entries]:
        return _program_of(self.robot)

    def depends(self) -> list[frozenset[int]]:
        """Return, for each joint, the joints on whose motion its torque depends."""
        program, entries = self._program
        leaders = self._leaders
        found = []
        for row in range(self.robot.n):
            values = [x for (i, _), x in entries.items() if leaders[i] == row]
            inputs = {name[1:] for name in needed(program, values) if name[0] in "qva"}
            found.append(frozenset(leaders[int(one)] for one in inputs))
        return found

    @cached_property
    def _leaders(self) -> list[int]:
        """The independent joint of each body."""
        return [self.robot.index(self.robot.joint_of(i)) for i in range(len(self.robot.body_names))]

    @cached_property
    def _multipliers(self) -> list[Fraction]:
        """The multiplier of each body's joint."""
        found = [exact_number(one.multiplier) for one in self.robot.dependent_joints]
        exact = [Fraction(int(x.p), int(x.q)) for x in found]
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

    def signal(self, count: int) -> Residues:
        """Return random values of a signal."""
        return self.random(count)

    def states(self, count: int) -> tuple[Residues, tuple[Residues, Residues], Residues, Residues]:
        """Return random q, cosine and sine of all bodies' angles, v and a, of `count` instants.

        Cosine and sine are independent of q, because no polynomial relation links them. Those of
        a mimic joint, and of its leader, are of multiples of one angle.
        """
        q, turn, v, a = (self.random(count, self.robot.n) for _ in range(4))
        cosine, sine = _circle(turn)
        turned = np.zeros((2, count, len(self._leaders)), dtype=object)
        for body, leader in enumerate(self._leaders):
            own = zip(self._leaders, self._multipliers, strict=True)
            common = lcm(*(x.denominator for i, x in own if i == leader))
            turns = int(self._multipliers[body] * common)
            turned[:, :, body] = _turned(cosine[:, leader], sine[:, leader], turns)
        return q, (turned[0], turned[1]), v, a

    def regressor(
        self, q: Residues, turned: tuple[Residues, Residues], v: Residues, a: Residues
    ) -> Residues:
        """Return the joint-torque regressor (T, n, 10n), as `rigid_body_regressor`."""
        known = self._steps(q, turned, v, a)
        Y = np.zeros((len(q), self.robot.n, self.robot.parameters.size), dtype=object)
        for (row, column), value in self._program[1].items():
            Y[:, self._leaders[row], column] += self._on_leader(row, _sum(value, known, len(q)))
        return np.asarray(Y % PRIME)

    def torques(
        self,
        q: Residues,
        turned: tuple[Residues, Residues],
        v: Residues,
        a: Residues,
        bodies: Residues,
    ) -> Residues:
        """Return `regressor` @ bodies, (T, n)."""
        known = self._steps(q, turned, v, a)
        found = np.zeros((len(q), self.robot.n), dtype=object)
        for (row, column), value in self._program[1].items():
            own = self._on_leader(row, _sum(value, known, len(q)))
            found[:, self._leaders[row]] += own * bodies[column]
        return np.asarray(found % PRIME)

    def _on_leader(self, row: int, torque: Residues) -> Residues:
        """Return the torque of a body's joint on its leader: a row of tau = E^T tau_all."""
        return torque if row < self.robot.n else torque * residue(self._multipliers[row])

    def _steps(
        self, q: Residues, turned: tuple[Residues, Residues], v: Residues, a: Residues
    ) -> dict[str, Residues]:
        """Return every named value of the program."""
        factors = np.array([residue(one) for one in self._multipliers], dtype=object)
        q, v, a = (x[:, self._leaders] * factors % PRIME for x in (q, v, a))
        states = dict(zip("cs", turned, strict=True)) | {"q": q, "v": v, "a": a}
        known = {f"{x}{i}": column for x, s in states.items() for i, column in enumerate(s.T)}
        for name, value in self._program[0].steps.items():
            known[name] = _sum(value, known, len(q))
        return known

    def product(self, left: Residues, right: Residues) -> Residues:
        """Return left @ right."""
        return np.asarray((left @ right) % PRIME)

    def solve(self, matrix: Residues, right: Residues) -> Residues:
        """Return the solutions (T, e) of systems (T, e, e), (T, e)."""
        e = right.shape[1]
        solved = [
            nmod_mat(e, e, A.ravel().tolist(), PRIME).solve(nmod_mat(e, 1, b.tolist(), PRIME))
            for A, b in zip(matrix, right, strict=True)
        ]
        return np.array([[int(x) for x in one.entries()] for one in solved], dtype=object)

    def over(self, above: Any, below: Any) -> Any:
        """Return above / below."""
        return above * _inverse(self.reduced(below)) % PRIME

    def reduced(self, values: Any) -> Any:
        """Return sums and products modulo the prime."""
        return values % PRIME

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


@lru_cache(1)
def _program_of(robot: Robot) -> tuple[Program, Entries]:
    return regressor_program(exact_tree(robot))


def residue(value: Fraction) -> int:
    """Return a rational modulo PRIME."""
    return value.numerator * pow(value.denominator, -1, PRIME) % PRIME


def echelon(H: Residues) -> tuple[list[int], Residues]:
    """Return pivots and rows (p, m) of the reduced echelon form of H (R, m), leftmost pivots."""
    rows, width = H.shape
    if not rows or not width:
        return [], np.zeros((0, width), dtype=object)
    reduced, rank = nmod_mat(rows, width, H.ravel().tolist(), PRIME).rref()
    table = [[int(reduced[i, j]) for j in range(width)] for i in range(rank)]
    kept = np.array(table, dtype=object).reshape(rank, width)
    return [int(np.flatnonzero(row)[0]) for row in kept], kept


def short_fraction(value: int) -> Fraction | None:
    """Return the rational below 1e9 in both parts with this residue (Wang 1981), or None."""
    most = isqrt(PRIME // 2)
    before, here, factor_before, factor = PRIME, value % PRIME, 0, 1
    while here > most:
        quotient = before // here
        before, here = here, before - quotient * here
        factor_before, factor = factor, factor_before - quotient * factor
    return Fraction(here, factor) if factor and abs(factor) <= most else None


def _circle(t: Residues) -> tuple[Residues, Residues]:
    """Return cosine (1 - t^2) / (1 + t^2) and sine 2 t / (1 + t^2) for half tangents t."""
    below = _inverse((1 + t * t) % PRIME)
    return (1 - t * t) * below % PRIME, 2 * t * below % PRIME


def _turned(cosine: Residues, sine: Residues, turns: int) -> tuple[Residues, Residues]:
    """Return cosine and sine of a multiple of an angle, by squaring of c + i s."""
    if turns == 1:
        return cosine, sine
    c, s = np.ones_like(cosine), np.zeros_like(sine)
    left = abs(turns)
    while left:
        if left % 2:
            c, s = (c * cosine - s * sine) % PRIME, (s * cosine + c * sine) % PRIME
        cosine, sine = (cosine**2 - sine**2) % PRIME, 2 * cosine * sine % PRIME
        left //= 2
    return c, (s if turns >= 0 else -s % PRIME)


def _power(base: Any, exponent: int) -> Any:
    total: Any = 1
    base = base if exponent > 0 else _inverse(base)
    for _ in range(abs(exponent)):
        total = total * base % PRIME
    return total


def _sum(value: Value, known: Mapping[str, Residues], count: int) -> Residues:
    """Return a sum of products of a program."""
    total = np.zeros(count, dtype=object)
    for factors, x in value.items():
        product: Any = residue(Fraction(int(x.p), int(x.q)))
        for name in factors:
            product = product * known[name] % PRIME
        total = total + product
    return np.asarray(total % PRIME)
