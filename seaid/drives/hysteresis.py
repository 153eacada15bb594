"""The hysteresis of Dahl (1968): a state z from -1 to 1 that follows the travel of a position.

dz/dx = (1 - z sign(x')) / width, which is the Bouc-Wen law of order 1 without gamma. It does not
depend on the speed. Between two reversals it has a closed form in the travel u, so that the state
over a log costs one step per reversal. As a sympy function of (x, width) it is a term of an
equation; compiled, it runs over the samples of x, from z = 0 at the first one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import sympy as sp

from seaid._arrays import Array


def _dahl(z: Any, sign: Any, u: Any) -> tuple[Any, Any, Any]:
    """Return z after a travel u >= 0 in units of the width, and its slopes by z and u."""
    left = np.exp(-u)
    return sign + (z - sign) * left, left, (sign - z) * left


def after_travel(z: float, travel: float, width: float) -> float:
    """Return the state after a travel without reversal."""
    return float(_dahl(z, math.copysign(1.0, travel), abs(travel) / width)[0])


def states(x: Array, width: float) -> tuple[Array, Array]:
    """Return the state (T,) over samples x (T,), and its slope by the width."""
    step = np.diff(x)
    sign = np.sign(step)
    moves = np.flatnonzero(sign)
    found = np.zeros((2, len(x)))
    if not len(moves):
        return found[0], found[1]
    turns = moves[np.flatnonzero(np.diff(sign[moves])) + 1]  # the first steps after a reversal
    z = slope = 0.0
    for first, last in zip([0, *turns], [*turns, len(step)], strict=True):
        own = slice(first + 1, last + 1)
        toward = float(sign[moves[np.searchsorted(moves, first)]])
        u = np.abs(x[own] - x[first]) / width
        found[0, own], by_z, by_u = _dahl(z, toward, u)
        found[1, own] = by_z * slope - by_u * u / width  # du/dwidth = -u/width
        z, slope = found[:, last].tolist()
    return found[0], found[1]


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
