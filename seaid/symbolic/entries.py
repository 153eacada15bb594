"""The elements of R and zeta as exact polynomials, and the normalisation of their rows.

zeta = R theta holds for any multiple of an equation; `normalised` applies the rule stated in
`seaid.symbolic.separate`, which gives every equation exactly one regressor form.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import chain, compress
from typing import NamedTuple

import sympy as sp
from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly
from sympy.core.function import AppliedUndef

from seaid.symbolic.polynomial import (
    Exponents,
    Ratio,
    Ring,
    exponents_at,
    occurring,
    product,
    quotient,
    ratio,
    ratio_to_sympy,
    term_to_sympy,
    to_sympy,
    total,
)


class Entry(NamedTuple):
    """One element of R or zeta: sum of coefficient * motion monomial, over a denominator."""

    terms: Mapping[Exponents, Ratio]
    denominator: fmpq_mpoly


Row = Mapping[Exponents, Entry]
"""One equation: {exponents of a product of unknowns: its coefficient}."""


def grouped(ring: Ring, polynomial: fmpq_mpoly) -> dict[Exponents, dict[Exponents, fmpq_mpoly]]:
    """Return {exponents of the unknowns: {exponents of the motion: coefficient in the knowns}}.

    The first exponents are those of `ring.unknown` only, the second those of all generators.
    """
    sorts = (ring.unknown, ring.motion, ring.known)
    kinds = [[i in places for i in range(len(ring.generators))] for places in sorts]
    groups: dict[Exponents, dict[Exponents, dict[Exponents, fmpq]]] = {}
    for exponents, value in polynomial.terms():
        unknown, motion, known = (tuple(compress(exponents, kind)) for kind in kinds)
        groups.setdefault(unknown, {}).setdefault(motion, {})[known] = value
    spread: dict[Exponents, Exponents] = {}
    return {
        tuple(map(int, unknown)): {
            exponents_at(ring, ring.motion, motion): ring.context.from_dict(
                {
                    spread.setdefault(key, exponents_at(ring, ring.known, key)): value
                    for key, value in known.items()
                }
            )
            for motion, known in terms.items()
        }
        for unknown, terms in groups.items()
    }


def grouped_by_motion(ring: Ring, polynomial: fmpq_mpoly) -> dict[Exponents, fmpq_mpoly]:
    """Return {exponents of the motion: coefficient in the knowns} of the part without unknowns."""
    return grouped(ring, polynomial).get((0,) * len(ring.unknown), {})


def entry_to_sympy(ring: Ring, entry: Entry | None) -> sp.Expr:
    """Return an element of R or zeta as a sympy sum."""
    if entry is None:
        return sp.Integer(0)
    terms = (
        ratio_to_sympy(ring, value) * term_to_sympy(ring, exponents)
        for exponents, value in entry.terms.items()
    )
    return sp.Add(*terms) / to_sympy(ring, entry.denominator)


_HIGHEST_POWER = 4
"""Powers of sine and cosine of an angle up to this stay powers: their coefficients are short, and
products of joint rotations have no higher ones."""


def with_multiples(ring: Ring, rows: Sequence[Row]) -> tuple[Ring, list[Row]]:
    """Return ring and rows in which high powers of an angle are sines and cosines of its multiples.

    sin(84 q) is a polynomial of degree 84 in sin q and cos q, exact but with 25 digits in its
    coefficients, which cancel when it is evaluated. The sines and cosines of the multiples of an
    angle are linearly independent as well, and become generators of their own.
    """
    angles = _high_angles(ring, rows)
    if not angles:
        return ring, list(rows)
    entries = (entry for row in rows for entry in row.values())
    motions = dict.fromkeys(chain(*(entry.terms for entry in entries)))
    expanded = {motion: _expanded(ring, angles, motion) for motion in motions}
    functions = dict.fromkeys(chain(*(key[1] for key in chain(*expanded.values()))))
    wider = _wider(ring, functions)
    return wider, [
        {monomial: _entry_in_multiples(wider, entry, expanded) for monomial, entry in row.items()}
        for row in rows
    ]


def _entry_in_multiples(
    wider: Ring, entry: Entry, expanded: Mapping[Exponents, _Expansion]
) -> Entry:
    """Return an entry in the wider ring, with the expansions of its functions of the motion."""
    terms: dict[Exponents, list[Ratio]] = defaultdict(list)
    for motion, value in entry.terms.items():
        numerator, denominator = (_in_ring(wider, part) for part in value)
        for (others, functions), factor in expanded[motion].items():
            exponents = list(others) + [0] * (len(wider.generators) - len(others))
            for function in functions:
                exponents[wider.index[function]] += 1
            terms[tuple(exponents)].append(Ratio(factor * numerator, denominator))
    totals = {motion: total(wider, values) for motion, values in terms.items()}
    nonzero = {motion: value for motion, value in totals.items() if not value.numerator.is_zero()}
    return Entry(nonzero, _in_ring(wider, entry.denominator))


def _high_angles(ring: Ring, rows: Sequence[Row]) -> list[tuple[int, int]]:
    """Return the places (sine, cosine) of the angles with high powers, in no denominator."""
    entries = [entry for row in rows for entry in row.values()]
    below = set(chain(*(occurring(entry.denominator) for entry in entries)))
    angles = []
    for place in ring.motion:
        sine = ring.generators[place]
        if isinstance(sine, sp.sin):
            pair = place, ring.index[sp.cos(sine.args[0])]
            powers = (m[pair[0]] + m[pair[1]] for entry in entries for m in entry.terms)
            if below.isdisjoint(pair) and max(powers, default=0) > _HIGHEST_POWER:
                angles.append(pair)
    return angles


_Expansion = dict[tuple[Exponents, tuple[sp.Expr, ...]], fmpq]
"""{(exponents of all but the high angles, sines and cosines of multiples of these): factor}."""


def _expanded(ring: Ring, angles: Sequence[tuple[int, int]], motion: Exponents) -> _Expansion:
    """Return a product of powers, in the sines and cosines of the multiples of the angles."""
    others = list(motion)
    factors: dict[tuple[sp.Expr, ...], fmpq] = {(): fmpq(1)}
    for sine, cosine in angles:
        angle, powers = ring.generators[sine].args[0], (motion[sine], motion[cosine])
        others[sine] = others[cosine] = 0
        factors = {
            (*functions, *([function] if function != 1 else [])): factor * more
            for functions, factor in factors.items()
            for function, more in _multiples(angle, *powers).items()
        }
    return {(tuple(others), functions): factor for functions, factor in factors.items()}


@cache
def _multiple(function: type[sp.Function], times: int, angle: sp.Expr) -> sp.Expr:
    return function(times * angle)


@cache
def _multiples(angle: sp.Expr, of_sine: int, of_cosine: int) -> dict[sp.Expr, fmpq]:
    """Return sin^a x cos^b x, with a of 0 or 1, as a sum of sin(n x) and cos(n x).

    With z = exp(i x), 2 cos x = z + 1/z and 2 i sin x = z - 1/z: the factors are those of powers of
    z, of which z^n and z^-n make up a cosine or, with the sine, a sine.
    """
    function, degree = sp.sin if of_sine else sp.cos, of_sine + of_cosine
    powers = fmpq_poly([1, 0, 1]) ** of_cosine * fmpq_poly([-1, 0, 1]) ** of_sine / 2**degree
    return {
        _multiple(function, n, angle): powers[degree + n] * (2 if n else 1)
        for n in range(degree, -1, -1)
        if powers[degree + n] != 0
    }


def _wider(ring: Ring, functions: Iterable[sp.Expr]) -> Ring:
    """Return the ring with further functions of the motion, if it does not have them."""
    generators = (*ring.generators, *(x for x in functions if x not in ring.index))
    places = tuple(range(len(ring.generators), len(generators)))
    undeclared = [
        ring.generators[i].args[0]
        for i in ring.undeclared
        if isinstance(ring.generators[i], sp.sin)
    ]
    wider = replace(
        ring,
        context=fmpq_mpoly_ctx.get([f"x{i}" for i in range(len(generators))], "lex"),
        generators=generators,
        motion=(*ring.motion, *places),
        undeclared=(
            *ring.undeclared,
            *(
                place
                for place in places
                if any((generators[place].args[0] / angle).is_Rational for angle in undeclared)
            ),
        ),
        relations=[],
    )
    wider.relations.extend(
        r._replace(polynomial=_in_ring(wider, r.polynomial)) for r in ring.relations
    )
    return wider


def _in_ring(wider: Ring, polynomial: fmpq_mpoly) -> fmpq_mpoly:
    """Return a polynomial of a ring in the one with further generators."""
    more = (0,) * (len(wider.generators) - polynomial.context().nvars())
    return wider.context.from_dict(
        {(*map(int, exponents), *more): value for exponents, value in polynomial.terms()}
    )


def column_key(monomial: Exponents) -> tuple[int, bool, Exponents, Exponents]:
    """Return the sort key of columns: unknowns as declared, products after their first factor."""
    factors = tuple(i for i, e in enumerate(monomial) for _ in range(abs(e)))
    single = len(factors) == 1 and sum(monomial) == 1
    return factors[0] if factors else -1, not single, factors, monomial


_MOST_SCALES = 12
"""Number of coefficients tried as the scale of a row without an input."""


def normalised(ring: Ring, row: Row) -> Row:
    """Divide a row by its scale and move the terms without unknowns to the other side.

    `row` is an equation that is zero, with coefficients of denominator 1. The result is a row of R
    and, under the exponents (0, ..., 0), zeta.
    """
    if not row:
        return row
    scale, pivot = _scale(ring, row)
    above = ratio(ring, *reversed(scale))
    opposite = Ratio(-above.numerator, above.denominator)
    # The pivot's coefficient becomes +1 on its side of zeta = R theta; the other side changes sign.
    return {
        monomial: Entry(
            _times(ring, entry.terms, above if any(monomial) == any(pivot) else opposite),
            entry.denominator,
        )
        for monomial, entry in row.items()
    }


def _times(ring: Ring, terms: Mapping[Exponents, Ratio], factor: Ratio) -> dict[Exponents, Ratio]:
    if factor.numerator.is_constant() and factor.denominator.is_one():
        number = factor.numerator.leading_coefficient()
        return {m: Ratio(number * value.numerator, value.denominator) for m, value in terms.items()}
    return {m: product(ring, value, factor) for m, value in terms.items()}


def _scale(ring: Ring, row: Row) -> tuple[Ratio, Exponents]:
    """Return the coefficient to divide the row by, and the product of unknowns that has it."""
    terms = [
        (monomial, motion, value)
        for monomial, entry in sorted(row.items(), key=lambda item: column_key(item[0]))
        for motion, value in sorted(entry.terms.items(), reverse=True)
    ]
    # The rule of `separate`: the coefficient of an input, else that which leaves the simplest row.
    candidates = _inputs(ring, row, terms) or terms
    if len(candidates) > 1:
        counts = Counter(_text(value) for _, _, value in terms)
        different = {_text(value): value for _, _, value in terms}
        weighted = [(value, counts[text]) for text, value in different.items()]
        candidates = _shortlist(ring, candidates)
        candidates.sort(key=lambda term: _cost_of_row(ring, weighted, term[2]))
    monomial, _, scale = candidates[0]
    return scale, monomial


_Term = tuple[Exponents, Exponents, Ratio]


def _inputs(ring: Ring, row: Row, terms: list[_Term]) -> list[_Term]:
    """Return the terms that are inputs, with the coefficient of a term with an unknown."""
    shared = {_up_to_number(value) for monomial, _, value in terms if any(monomial)}
    return [
        (monomial, motion, value)
        for monomial, motion, value in terms
        if not any(monomial) and _up_to_number(value) in shared and _is_input(ring, row, motion)
    ]


def _text(value: Ratio) -> str:
    return f"{value.numerator}/{value.denominator}"


def _up_to_number(value: Ratio) -> str:
    return str(value.numerator / value.numerator.leading_coefficient())


def _shortlist(ring: Ring, terms: list[_Term]) -> list[_Term]:
    """Return one term per coefficient, for the few simplest once the common factor is removed."""
    common = terms[0][2].numerator
    for _, _, value in terms:
        common = common.gcd(value.numerator)
    different: dict[str, _Term] = {}
    for term in terms:
        different.setdefault(_text(term[2]), term)
    order = sorted(
        different.values(), key=lambda term: _cost(ratio(ring, term[2].numerator, common))[0]
    )
    return order[:_MOST_SCALES]


def _cost_of_row(
    ring: Ring, weighted: Sequence[tuple[Ratio, int]], scale: Ratio
) -> tuple[int, int]:
    """Return the complexity of a row divided by `scale`: (known symbols, binary digits)."""
    symbols, digits = 0, 0
    for value, count in weighted:
        cost = _cost(quotient(ring, value, scale))
        symbols, digits = symbols + count * cost[0], digits + count * cost[1]
    return symbols, digits


def _cost(value: Ratio) -> tuple[int, int]:
    """Return the complexity of a coefficient: (known symbols with multiplicity, binary digits)."""
    symbols, digits = 0, 0
    for polynomial in value:
        for exponents, number in polynomial.terms():
            symbols += sum(exponents)
            digits += int(number.p).bit_length() + int(number.q).bit_length()
    return symbols, digits


def _is_input(ring: Ring, row: Row, motion: Exponents) -> bool:
    """Whether a term is a bare signal, of which no function occurs elsewhere in the row."""
    if sum(motion) != 1:
        return False
    place = motion.index(1)
    signal = ring.generators[place]
    if not isinstance(signal, sp.Symbol | AppliedUndef) or any(
        generator != signal and generator.has(signal) for generator in ring.generators
    ):
        return False
    occurs = sum(m[place] != 0 for entry in row.values() for m in entry.terms)
    return occurs == 1 and all(e.denominator.degrees()[place] == 0 for e in row.values())
