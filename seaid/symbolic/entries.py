"""The elements of R and zeta as exact polynomials, and the normalisation of their rows.

zeta = R theta holds for any multiple of an equation; `normalised` applies the rule stated in
`seaid.symbolic.separate`, which gives every equation exactly one regressor form.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import compress
from typing import NamedTuple

import sympy as sp
from flint import fmpq, fmpq_mpoly
from sympy.core.function import AppliedUndef

from seaid.symbolic.polynomial import (
    Exponents,
    Ratio,
    Ring,
    exponents_at,
    product,
    quotient,
    ratio,
    ratio_to_sympy,
    term_to_sympy,
    to_sympy,
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
