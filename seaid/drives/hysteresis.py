"""Laws of hysteresis: a state z from -1 to 1 that follows the travel of a position x.

- `dahl`: dz/dx = (1 - z sign(x')) / width (Dahl 1968), the Bouc-Wen law of order 1 without gamma;
- `maxwell_slip`: a spring that slides at |z| = 1, one element of a generalised Maxwell-slip law.

Neither depends on the speed. Between two reversals both have a closed form in the travel u, so that
the state over a log costs one step per reversal. As sympy functions of (x, width) they are terms of
an equation; compiled, they run over the samples of x, from z = 0 at the first one.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
import sympy as sp

from seaid._arrays import Array


def _dahl(z: Any, sign: Any, u: Any) -> tuple[Any, Any, Any]:
    """Return z after a travel u >= 0 in units of the width, and its slopes by z and u."""
    left = np.exp(-u)
    return sign + (z - sign) * left, left, (sign - z) * left


def _maxwell_slip(z: Any, sign: Any, u: Any) -> tuple[Any, Any, Any]:
    """Return the same for the sliding spring."""
    free = z + sign * u
    sticks = np.abs(free) <= 1
    return np.clip(free, -1.0, 1.0), 1.0 * sticks, sign * sticks


_LAWS = {"dahl": _dahl, "maxwell_slip": _maxwell_slip}


def after_travel(law: str, z: float, travel: float, width: float) -> float:
    """Return the state after a travel without reversal."""
    return float(_LAWS[law](z, math.copysign(1.0, travel), abs(travel) / width)[0])


def states(law: str, x: Array, width: float) -> tuple[Array, Array]:
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
        found[0, own], by_z, by_u = _LAWS[law](z, toward, u)
        found[1, own] = by_z * slope - by_u * u / width  # du/dwidth = -u/width
        z, slope = found[:, last].tolist()
    return found[0], found[1]


class Law(sp.Function):  # type: ignore[misc]
    """The state of a law as a function of position and width."""

    nargs = 2
    is_real = True
    slope: ClassVar[Any]

    def fdiff(self, argindex: int = 2) -> sp.Expr:
        """Return the slope by the width; the state is no function of the present position."""
        if argindex != 2:
            raise sp.core.function.ArgumentIndexError(self, argindex)
        return self.slope(*self.args)


class Slope(sp.Function):  # type: ignore[misc]
    """The slope of a state by the width of its law."""

    nargs = 2
    is_real = True


class DahlSlope(Slope):
    """That of `dahl`; `lambdify` evaluates the functions by their `_imp_`."""

    _imp_ = staticmethod(lambda x, width: states("dahl", x, width)[1])


class Dahl(Law):
    """The law `dahl`."""

    slope = DahlSlope
    _imp_ = staticmethod(lambda x, width: states("dahl", x, width)[0])


class MaxwellSlipSlope(Slope):
    """That of `maxwell_slip`."""

    _imp_ = staticmethod(lambda x, width: states("maxwell_slip", x, width)[1])


class MaxwellSlip(Law):
    """The law `maxwell_slip`."""

    slope = MaxwellSlipSlope
    _imp_ = staticmethod(lambda x, width: states("maxwell_slip", x, width)[0])


LAWS: dict[str, type[Law]] = {"dahl": Dahl, "maxwell_slip": MaxwellSlip}
"""{term of friction or spring: its law as a sympy function}."""
