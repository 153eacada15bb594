"""Two kinds of numbers in which the same equations are taken: doubles here, residues elsewhere.

`seaid.symbolic.residues` has the exact ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any, Protocol

import numpy as np
import sympy as sp

from seaid.arrays import Array
from seaid.base import random_states
from seaid.errors import SymbolicError
from seaid.linear_algebra import safely
from seaid.rigid_body import joint_torques, rigid_body_regressor
from seaid.robot import Robot

Known = dict[sp.Expr, Any]
"""{symbol or function: its values}, each a number or (T,)."""


class Numbers(Protocol):
    """A kind of numbers, with what is asked of it; arrays are numpy's."""

    def number(self, value: float | Fraction) -> Any:
        """Return a rational number."""

    def random(self, *shape: int) -> Any:
        """Return random numbers, none of them zero."""

    def signal(self, count: int) -> Any:
        """Return random values (count,) of a signal."""

    def states(self, count: int) -> tuple[Any, Any, Any, Any]:
        """Return random q, its cosine and sine, v and a, each (count, n)."""

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

    def sign(self, values: Any) -> Any:
        """Return signs: of the values, or any where numbers have none."""

    def over(self, above: Any, below: Any) -> Any:
        """Return above / below."""

    def reduced(self, values: Any) -> Any:
        """Return sums and products as plain numbers of the kind."""


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
        """Return random q, its cosine and sine, v and a, as `seaid.base.random_states`."""
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
        return joint_torques(self.robot.with_values(own, self.robot.drivetrains), q, v, a)

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

    def sign(self, values: Array) -> Array:
        """Return the signs."""
        return np.sign(values)

    def over(self, above: Any, below: Any) -> Any:
        """Return above / below."""
        return above / below

    def reduced(self, values: Any) -> Any:
        """Return the values: doubles always are."""
        return values


@cache
def _compiled(expression: sp.Expr) -> tuple[Any, list[sp.Symbol]]:
    symbols = sorted(expression.free_symbols, key=str)
    return sp.lambdify(symbols, expression, modules="numpy"), symbols
