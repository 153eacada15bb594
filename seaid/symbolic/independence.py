"""Linear independence of the fundamental functions of (11), which the paper presupposes.

Monomials in signals and in sine, cosine and exponential of different signals are independent once
sin^2 is reduced. All other functions, and large multiples of an angle next to it, are tested
numerically: they are evaluated at random points, with signals of all sizes, since tanh(1000 w) is a
sign but near w = 0.001. Independence is proven in intervals of at least 200 digits; a dependence is
accepted if it holds in these intervals, also at fresh points.
"""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import chain, combinations, cycle, islice
from math import inf
from typing import Any

import sympy as sp
from flint import arb, ctx, fmpq
from mpmath import mp, mpf
from sympy.core.function import AppliedUndef

from seaid.errors import SeaidWarning, SymbolicError
from seaid.symbolic.polynomial import Exponents, Ring, connected, term_to_sympy

Combination = dict[Exponents, fmpq]
_Row = list[mpf]
_Balls = list[arb]
_Point = dict[sp.Expr, sp.Expr]

_DIGITS, _FEW_DIGITS, _MOST_DIGITS = 200, 25, 6000
"""Decimal digits by which a dependence is decided; those that show most independences already, and
that the arithmetic has beyond the others; and the most that are tried."""

_ROUNDS = 4
"""Decisions that are made, each with twice the digits and with more points than the one before."""

_LONGEST = 10**12
"""Largest denominator of a factor of a dependence that is made rational, and then confirmed."""

_MOST_FUNCTIONS = 300
"""Functions up to which their independence is tested; of more there is a warning."""

_DECADES = range(-9, 5)
"""Powers of ten of the signals: friction and stops of real machines are alive in one of them."""

_CERTAIN = (sp.Symbol, AppliedUndef, sp.Derivative, sp.sin, sp.cos, sp.exp)


def independent_functions(
    ring: Ring, functions: Collection[Exponents]
) -> tuple[dict[Exponents, Combination], tuple[tuple[sp.Expr, sp.Expr], ...]]:
    """Return {dependent function: combination of independent ones}, and the relations behind it.

    `functions` are exponents of the motion's generators. The relations are pairs of sympy
    expressions, and are also reported in a SeaidWarning. Raises SymbolicError for a dependence
    whose factors are not short rationals.
    """
    replaced: dict[Exponents, Combination] = {f: {f: fmpq(1)} for f in functions}
    relations: list[tuple[sp.Expr, sp.Expr]] = []
    for group in _groups(ring):
        dependences = _dependences(ring, group, set(chain(*replaced.values())))
        if dependences:
            relations += [_relation(ring, *dependence) for dependence in dependences.items()]
            replaced = {f: _rewritten(old, group, dependences) for f, old in replaced.items()}
    if relations:
        text = "; ".join(f"{lhs} = {rhs}" for lhs, rhs in relations)
        warnings.warn(
            f"functions of the motion depend on each other, found at random points: {text}; the "
            "left sides were replaced by the right ones",
            SeaidWarning,
            stacklevel=3,
        )
    return {f: c for f, c in replaced.items() if c != {f: fmpq(1)}}, tuple(relations)


def _groups(ring: Ring) -> list[tuple[int, ...]]:
    """Return the groups of generators that share signals and need the numerical test."""
    signals = {place: _signals(ring, ring.generators[place]) for place in ring.motion}
    groups = (
        tuple(sorted(i for i in ring.motion if signals[i] & group))
        for group in connected(signals.values())
    )
    return [x for x in groups if not _are_certain([ring.generators[i] for i in x])]


def _are_certain(generators: Sequence[sp.Expr]) -> bool:
    """Whether products of generators are independent: no angle is a multiple of another one."""
    angles = {x.args[0] for x in generators if isinstance(x, sp.sin | sp.cos)}
    multiples = ((first / second).is_Rational for first, second in combinations(angles, 2))
    return all(isinstance(x, _CERTAIN) for x in generators) and not any(multiples)


def _signals(ring: Ring, expression: sp.Basic) -> set[sp.Expr]:
    """Return the functions of time and moving symbols in an expression."""
    if isinstance(expression, AppliedUndef | sp.Derivative) or expression in ring.moving:
        return {expression}
    return {signal for part in expression.args for signal in _signals(ring, part)}


def _part(function: Exponents, group: tuple[int, ...]) -> Exponents:
    return tuple(e if i in group else 0 for i, e in enumerate(function))


def _rewritten(
    combination: Combination, group: tuple[int, ...], dependences: Mapping[Exponents, Combination]
) -> Combination:
    """Replace the dependent functions of a group by the combinations in `dependences`."""
    result: Combination = {}
    for function, factor in combination.items():
        old = _part(function, group)
        for part, times in dependences.get(old, {old: fmpq(1)}).items():
            # Within the product, the exponents o of the group become p.
            new = tuple(f - o + p for f, o, p in zip(function, old, part, strict=True))
            result[new] = result.get(new, fmpq(0)) + factor * times
    return {function: factor for function, factor in result.items() if factor != 0}


def _relation(ring: Ring, part: Exponents, combination: Combination) -> tuple[sp.Expr, sp.Expr]:
    right = (term_to_sympy(ring, function, factor) for function, factor in combination.items())
    return term_to_sympy(ring, part), sp.Add(*right)


def _dependences(
    ring: Ring, group: tuple[int, ...], functions: Collection[Exponents]
) -> dict[Exponents, Combination]:
    """Return {function: combination of those before it} within a `group`, at random points."""
    # Simple functions first, since a dependent one is replaced by those before it.
    parts = sorted({_part(f, group) for f in functions}, key=lambda e: (sum(e), e[::-1]))
    names = ", ".join(str(ring.generators[i]) for i in group)
    points = _Points(ring, group, parts)
    rows = points.evaluated(len(parts) + 4, _FEW_DIGITS) if len(parts) <= _MOST_FUNCTIONS else None
    if rows is None:
        warnings.warn(
            f"whether {len(parts)} functions made of {names} are independent was not checked; "
            "if they are not, too many base parameters are counted",
            SeaidWarning,
            stacklevel=4,
        )
        return {}
    with ctx.workdps(2 * _FEW_DIGITS):  # shows independence already in the usual case
        if not _eliminated(_balls(rows, _FEW_DIGITS)):
            return {}
    # Values of ordinary size decide: at large ones exp(1000 x) has more digits than are of use.
    digits = _DIGITS + 2 * _decades(rows[: len(parts)])
    return _proven_dependences(points, min(digits, _MOST_DIGITS), names)


def _proven_dependences(points: _Points, digits: int, names: str) -> dict[Exponents, Combination]:
    """Return the dependences that hold with many digits, also at points that did not give them."""
    parts = points.parts
    table: list[_Balls] = []
    for _ in range(_ROUNDS):
        rows, fresh = (points.evaluated(count, digits) for count in (len(parts) + 4, 8))
        if rows is None or fresh is None:
            break
        with ctx.workdps(digits + _FEW_DIGITS):
            checks = _balls(fresh, digits)
            table += _balls(rows, digits)
            dependent = _eliminated(table)
            if all(_holds(row, *dependence) for row in checks for dependence in dependent.items()):
                return {
                    parts[column]: _confirmed(points.ring, parts, column, factors, checks)
                    for column, factors in dependent.items()
                }
            table += checks
        digits = min(2 * digits, _MOST_DIGITS)
    raise SymbolicError(
        f"whether the functions made of {names} are independent remains open: "
        f"{len(table)} random points do not decide it; give one of them as a signal"
    )


def _decades(rows: list[_Row]) -> int:
    """Return the largest power of ten, positive or negative, of the values."""
    return max((abs(int(mp.log10(abs(x)))) for row in rows for x in row if x), default=0)


def _balls(rows: list[_Row], digits: int) -> list[_Balls]:
    """Return products of a few values as intervals of flint, which carry their own errors."""
    return [[arb(x, abs(x) * mpf(10) ** (3 - digits)) for x in row] for row in rows]


def _holds(row: _Balls, column: int, factors: Mapping[int, arb]) -> bool:
    """Whether a dependence holds at a point, to a quarter of the digits of its largest term."""
    terms = [row[column], *(-factor * row[j] for j, factor in factors.items())]
    residual = sum(terms, arb(0))
    largest = max(float(_size(x)) for x in terms)
    return bool(residual.contains(0)) and _size(residual.abs_upper()) <= largest - ctx.prec / 4


def _size(number: arb) -> float:
    """Return the number of binary digits before the point of the middle of an interval."""
    mantissa, exponent = number.mid().man_exp()
    return int(mantissa).bit_length() + int(exponent) if mantissa else -inf


def _confirmed(
    ring: Ring,
    parts: list[Exponents],
    column: int,
    factors: Mapping[int, arb],
    fresh: list[_Balls],
) -> Combination:
    """Return a dependence with rational factors, if it also holds at the points `fresh`."""
    short = {j: _short_rational(factor) for j, factor in factors.items()}
    exact = {j: arb(factor) for j, factor in short.items()}
    if not all(_holds(row, column, exact) for row in fresh):
        names = ", ".join(str(term_to_sympy(ring, parts[j])) for j in short)
        raise SymbolicError(
            f"the function {term_to_sympy(ring, parts[column])} of the motion depends on "
            f"{names} with factors that are not short rational numbers; write the equations "
            "with one of these functions less"
        )
    return {parts[j]: factor for j, factor in short.items()}


@dataclass(eq=False)
class _Points:
    """Random values of the signals in a group of generators, and of products of these, `parts`."""

    ring: Ring
    group: tuple[int, ...]
    parts: list[Exponents]
    draw: random.Random = field(default_factory=lambda: random.Random(1))
    expressions: list[sp.Expr] = field(init=False)
    constants: _Point = field(init=False)
    signals: list[sp.Expr] = field(init=False)

    def __post_init__(self) -> None:
        self.expressions = [self.ring.generators[i] for i in self.group]
        signals = {s for x in self.expressions for s in _signals(self.ring, x)}
        free = {s for x in self.expressions for s in x.free_symbols} - self.ring.moving
        self.signals = sorted(signals, key=str)
        self.constants = {s: self._random(positive=True) for s in sorted(free, key=str)}

    @cached_property
    def function(self) -> Callable[..., list[Any]] | None:
        """The functions of signals and constants for mpmath, or None if one is not defined."""
        plain = {s: sp.Dummy(real=True) for s in (*self.signals, *self.constants)}
        expressions = [x.xreplace(plain) for x in self.expressions]
        if any(x.has(AppliedUndef, sp.Derivative) for x in expressions):
            return None
        function: Callable[..., list[Any]] = sp.lambdify(
            list(plain.values()), expressions, ["mpmath", "sympy"]
        )
        return function

    def evaluated(self, count: int, digits: int) -> list[_Row] | None:
        """Return the values of the parts, a row per point; None if too few of them are real.

        There are `count` points of ordinary size, and one of each decade.
        """
        rows: list[_Row] = []
        wanted = count + len(_DECADES)
        with mp.workdps(digits):
            for drawn, most in ((self.ordinary(count), count), (self.scaled(), wanted)):
                real = (x for point in drawn if (x := self.values(point, digits)) is not None)
                for values in islice(real, most - len(rows)):
                    powers = list(zip(self.group, values, strict=True))
                    rows.append(
                        [mp.fprod(x ** int(m[i]) for i, x in powers if m[i]) for m in self.parts]
                    )
        return rows if len(rows) >= count else None

    def values(self, point: _Point, digits: int) -> list[mpf] | None:
        """Return the values at a point, or None if they are not real.

        They are computed with more and more digits until `digits` do not change any more.
        """
        last: list[mpf] | None = None
        for guard in (10 * 4**n for n in range(6)):
            with mp.workdps(digits + guard):
                values = self._values(point)
            if values is None:
                return None
            if last is not None and all(
                abs(x - y) <= mpf(10) ** -digits * abs(x) for x, y in zip(values, last, strict=True)
            ):
                return values
            last = values
        return None

    def _values(self, point: _Point) -> list[mpf] | None:
        if self.function is None:
            return None
        arguments = [_number(point[s]) for s in (*self.signals, *self.constants)]
        try:
            values = [_number(x) for x in self.function(*arguments)]
        except (*_NO_VALUE, mp.NoConvergence):
            return None
        return values if all(isinstance(x, mpf) and mp.isfinite(x) for x in values) else None

    def ordinary(self, count: int) -> Iterator[_Point]:
        """Yield 20 points for each of `count`: values of both signs, later positive ones only."""
        for attempt in range(20 * count):
            positive = attempt >= 10 * count
            yield self.constants | {s: self._random(positive) for s in self.signals}

    def scaled(self) -> Iterator[_Point]:
        """Yield 10 points of each decade, in which all signals have the size of a power of ten.

        At small ones tanh(1000 w) is no sign, and at large ones Max(q - 30, 0) is not zero.
        """
        for point, power in zip(self.ordinary(len(_DECADES)), cycle(_DECADES), strict=False):
            yield point | {s: sp.Integer(10) ** power * point[s] for s in self.signals}

    def _random(self, positive: bool) -> sp.Rational:
        sign = 1 if positive else self.draw.choice((-1, 1))
        return sp.Rational(sign * self.draw.randint(200, 2200), 1009)


_NO_VALUE = (ArithmeticError, ValueError, TypeError, NameError, AttributeError)
"""What Python raises for an expression at a pole, or with a function that mpmath does not have."""


def _number(value: Any) -> Any:
    """Return a number of Python, mpmath or sympy as one of mpmath, with its present digits."""
    if isinstance(value, sp.Rational):
        return mpf(int(value.p)) / int(value.q)
    return mp.mpmathify(value.evalf(mp.dps) if isinstance(value, sp.Expr) else value)


def _eliminated(table: list[_Balls]) -> dict[int, dict[int, arb]]:
    """Return {dependent column: factors of the independent ones}, by pivoted Gauss-Jordan.

    A pivot is an interval without zero; a column without one counts as dependent.
    """
    rows = list(map(list, table))
    pivots: list[int] = []
    dependent: dict[int, dict[int, arb]] = {}
    for column in range(len(rows[0])):
        top = len(pivots)
        # Scaled partial pivoting: a pivot that is small in its row would widen the intervals.
        shares = [_share(row[column:]) for row in rows[top:]]
        largest = max(shares, default=-inf)
        if largest == -inf:
            # A factor that may be zero counts as zero, which the fresh points confirm or refute.
            values = {pivot: rows[i][column] for i, pivot in enumerate(pivots)}
            dependent[column] = {pivot: x for pivot, x in values.items() if not x.contains(0)}
            continue
        best = top + shares.index(largest)
        rows[top], rows[best] = rows[best], rows[top]
        rest = [x / rows[top][column] for x in rows[top][column + 1 :]]
        rows[top][column + 1 :] = rest
        for row in (*rows[:top], *rows[top + 1 :]):
            factor = row[column]
            row[column + 1 :] = [
                x - factor * y for x, y in zip(row[column + 1 :], rest, strict=True)
            ]
        pivots.append(column)
    return dependent


def _share(row: _Balls) -> float:
    """Return how large the first entry is in its row, in binary digits; -inf if it may be zero."""
    return -inf if row[0].contains(0) else _size(row[0]) - max(map(_size, row))


def _short_rational(number: arb) -> fmpq:
    mantissa, exponent = number.mid().man_exp()
    exact = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    near = exact.limit_denominator(_LONGEST)
    return fmpq(near.numerator, near.denominator)
