"""Linear independence of the fundamental functions of (11), which the paper presupposes.

Monomials in signals and in sine, cosine and exponential of different signals are independent once
sin^2 is reduced. All other functions are tested numerically: they are evaluated with 200 digits at
random points, and a dependence is accepted if it also holds at fresh points.
"""

from __future__ import annotations

import random
import warnings
from collections.abc import Collection, Iterator, Mapping
from fractions import Fraction
from itertools import chain

import numpy as np
import sympy as sp
from flint import fmpq
from mpmath import mp, mpf
from sympy.core.function import AppliedUndef

from seaid._arrays import safely
from seaid.errors import SeaidWarning, SymbolicError
from seaid.symbolic.polynomial import Exponents, Ring, term_to_sympy

Combination = dict[Exponents, fmpq]

_DIGITS = 200
_SMALL = mpf(10) ** -(_DIGITS // 2)
_LONGEST = 10**12
_MOST_FUNCTIONS = 300
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
        found = _dependences(ring, group, set(chain(*replaced.values())))
        if found:
            relations += [_relation(ring, *dependence) for dependence in found.items()]
            replaced = {f: _rewritten(old, group, found) for f, old in replaced.items()}
    if relations:
        text = "; ".join(f"{left} = {right}" for left, right in relations)
        warnings.warn(
            f"functions of the motion depend on each other, found at random points: {text}; the "
            "left sides were replaced by the right ones",
            SeaidWarning,
            stacklevel=3,
        )
    return {f: c for f, c in replaced.items() if c != {f: fmpq(1)}}, tuple(relations)


def _groups(ring: Ring) -> list[tuple[int, ...]]:
    """Return the groups of generators that share signals and need the numerical test."""
    groups: list[tuple[set[int], set[sp.Expr]]] = []
    for place in ring.motion:
        places, signals = {place}, _signals(ring, ring.generators[place])
        apart = []
        for group in groups:
            if group[1] & signals:
                places, signals = places | group[0], signals | group[1]
            else:
                apart.append(group)
        groups = [*apart, (places, signals)]
    return [
        tuple(sorted(places))
        for places, _ in groups
        if any(not isinstance(ring.generators[i], _CERTAIN) for i in places)
    ]


def _signals(ring: Ring, expression: sp.Basic) -> set[sp.Expr]:
    """Return the functions of time and moving symbols in an expression."""
    if isinstance(expression, AppliedUndef | sp.Derivative) or expression in ring.moving:
        return {expression}
    return {signal for part in expression.args for signal in _signals(ring, part)}


def _part(function: Exponents, group: tuple[int, ...]) -> Exponents:
    return tuple(e if i in group else 0 for i, e in enumerate(function))


def _rewritten(
    combination: Combination, group: tuple[int, ...], found: Mapping[Exponents, Combination]
) -> Combination:
    """Replace the dependent functions of a group by the combinations in `found`."""
    result: Combination = {}
    for function, factor in combination.items():
        own = _part(function, group)
        for part, times in found.get(own, {own: fmpq(1)}).items():
            other = tuple(f - o + p for f, o, p in zip(function, own, part, strict=True))
            result[other] = result.get(other, fmpq(0)) + factor * times
    return {function: factor for function, factor in result.items() if factor != 0}


def _relation(ring: Ring, part: Exponents, found: Combination) -> tuple[sp.Expr, sp.Expr]:
    right = (term_to_sympy(ring, other, factor) for other, factor in found.items())
    return term_to_sympy(ring, part), sp.Add(*right)


def _dependences(
    ring: Ring, group: tuple[int, ...], functions: Collection[Exponents]
) -> dict[Exponents, Combination]:
    """Return {function: combination of those before it} within a `group`, at random points."""
    parts = sorted({_part(f, group) for f in functions}, key=lambda e: (sum(e), e[::-1]))
    with mp.workdps(_DIGITS):
        few = len(parts) <= _MOST_FUNCTIONS
        table = _evaluated(ring, group, parts, len(parts) + 4, seed=1) if few else None
        if table is None:
            names = ", ".join(str(ring.generators[i]) for i in group)
            warnings.warn(
                f"whether {len(parts)} functions made of {names} are independent was not checked; "
                "if they are not, too many base parameters are counted",
                SeaidWarning,
                stacklevel=4,
            )
            return {}
        if _surely_independent(table):
            return {}
        fresh = _evaluated(ring, group, parts, 8, seed=2) or []
        return {
            parts[column]: _confirmed(ring, parts, column, factors, fresh)
            for column, factors in _eliminated(table).items()
        }


def _confirmed(
    ring: Ring,
    parts: list[Exponents],
    column: int,
    factors: Mapping[int, mpf],
    fresh: list[list[mpf]],
) -> Combination:
    """Return a dependence with rational factors, if it also holds at the points `fresh`."""
    short = {other: _short_rational(factor) for other, factor in factors.items()}
    for row in fresh:
        if abs(row[column] - sum(_value(short[j]) * row[j] for j in short)) >= _SMALL:
            names = ", ".join(str(term_to_sympy(ring, parts[other])) for other in short)
            raise SymbolicError(
                f"the function {term_to_sympy(ring, parts[column])} of the motion depends on "
                f"{names} with factors that are not short rational numbers; write the equations "
                "with one of these functions less"
            )
    return {parts[other]: factor for other, factor in short.items()}


def _evaluated(
    ring: Ring, group: tuple[int, ...], parts: list[Exponents], count: int, seed: int
) -> list[list[mpf]] | None:
    """Return the values at `count` random points, a row per point; None if they are not real."""
    expressions = [ring.generators[i] for i in group]
    rows: list[list[mpf]] = []
    for point in _random_points(ring, expressions, count, seed):
        values = [x.xreplace(point).evalf(_DIGITS) for x in expressions]
        if all(value.is_Float or value.is_Rational for value in values):
            pairs = list(zip(group, map(mp.mpmathify, values), strict=True))
            rows.append([mp.fprod(x ** int(part[i]) for i, x in pairs) for part in parts])
            if len(rows) == count:
                return rows
    return None


def _random_points(
    ring: Ring, expressions: list[sp.Expr], count: int, seed: int
) -> Iterator[dict[sp.Expr, sp.Rational]]:
    """Yield 20 points for each of `count`: values of both signs, later positive ones only."""
    generator = random.Random(seed)
    signals = sorted({s for x in expressions for s in _signals(ring, x)}, key=str)
    free = {s for x in expressions for s in x.free_symbols} - ring.moving
    constants = {s: _random(generator, positive=True) for s in sorted(free, key=str)}
    for attempt in range(20 * count):
        positive = attempt >= 10 * count
        yield constants | {s: _random(generator, positive) for s in signals}


def _random(generator: random.Random, positive: bool) -> sp.Rational:
    sign = 1 if positive else generator.choice((-1, 1))
    return sp.Rational(sign * generator.randint(200, 2200), 1009)


def _surely_independent(table: list[list[mpf]]) -> bool:
    """Whether singular values in double precision already show independence, the usual case."""
    values = np.array(table, dtype=np.float64)
    values /= np.linalg.norm(values, axis=0)
    singular = safely(
        np.linalg.svd,
        values,
        what="the independence of functions",
        error=SymbolicError,
        compute_uv=False,
    )
    return bool(singular[-1] > 1e-9 * singular[0])


def _eliminated(table: list[list[mpf]]) -> dict[int, dict[int, mpf]]:
    """Return {dependent column: factors of the independent ones}, by pivoted Gauss-Jordan."""
    rows = np.array(table, dtype=object)
    pivots: list[int] = []
    dependent: dict[int, dict[int, mpf]] = {}
    for column in range(rows.shape[1]):
        top = len(pivots)
        best = top + int(np.argmax(np.abs(rows[top:, column])))
        if abs(rows[best, column]) < _SMALL:
            factors = zip(pivots, rows[:, column], strict=False)
            dependent[column] = {pivot: x for pivot, x in factors if abs(x) > _SMALL}
            continue
        rows[[top, best]] = rows[[best, top]]
        rows[top] = rows[top] / rows[top, column]
        others = np.arange(len(rows)) != top
        rows[others] = rows[others] - np.outer(rows[others, column], rows[top])
        pivots.append(column)
    return dependent


def _short_rational(number: mpf) -> fmpq:
    mantissa, exponent = mp.frexp(number)
    scaled = int(mp.ldexp(mantissa, mp.prec))
    exact = Fraction(scaled) * Fraction(2) ** (int(exponent) - mp.prec)
    near = exact.limit_denominator(_LONGEST)
    return fmpq(near.numerator, near.denominator)


def _value(number: fmpq) -> mpf:
    return mpf(int(number.p)) / int(number.q)
