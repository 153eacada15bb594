"""The elements of R and zeta as exact polynomials."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import compress
from typing import NamedTuple

import sympy as sp
from flint import fmpq, fmpq_mpoly

from seaid.symbolic.polynomial import (
    Exponents,
    Ratio,
    Ring,
    ratio_to_sympy,
    term_to_sympy,
    to_sympy,
)


class Entry(NamedTuple):
    """One element of R or zeta: sum of coefficient times motion term, over a function of motion."""

    terms: Mapping[Exponents, Ratio]
    denominator: fmpq_mpoly


Row = Mapping[Exponents, Entry]
"""One equation: for each product of unknowns (its exponents) what it multiplies."""


def grouped(ring: Ring, polynomial: fmpq_mpoly) -> dict[Exponents, dict[Exponents, fmpq_mpoly]]:
    """Return {exponents of the unknowns: {exponents of the motion: coefficient in the knowns}}.

    The first exponents are those of `ring.unknown` only, the second have a place a generator.
    """
    kinds = [[i in places for i in range(len(ring.generators))] for places in _kinds(ring)]
    found: dict[Exponents, dict[Exponents, dict[Exponents, fmpq]]] = {}
    for exponents, value in polynomial.terms():
        unknown, motion, known = (tuple(compress(exponents, kind)) for kind in kinds)
        found.setdefault(unknown, {}).setdefault(motion, {})[known] = value
    spread: dict[Exponents, Exponents] = {}
    return {
        tuple(map(int, unknown)): {
            _spread(ring, ring.motion, motion): ring.context.from_dict(
                {
                    spread.setdefault(key, _spread(ring, ring.known, key)): value
                    for key, value in known.items()
                }
            )
            for motion, known in terms.items()
        }
        for unknown, terms in found.items()
    }


def grouped_by_motion(ring: Ring, polynomial: fmpq_mpoly) -> dict[Exponents, fmpq_mpoly]:
    """Return {exponents of the motion: coefficient in the knowns}, for want of unknowns."""
    return grouped(ring, polynomial).get((0,) * len(ring.unknown), {})


def _kinds(ring: Ring) -> tuple[tuple[int, ...], ...]:
    return ring.unknown, ring.motion, ring.known


def _spread(ring: Ring, places: tuple[int, ...], exponents: Exponents) -> Exponents:
    """Put exponents of some generators to their places among all."""
    result = [0] * len(ring.generators)
    for place, exponent in zip(places, exponents, strict=True):
        result[place] = int(exponent)
    return tuple(result)


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
    """Order of the columns: as the unknowns are declared, a product after its first factor."""
    factors = tuple(i for i, e in enumerate(monomial) for _ in range(abs(e)))
    single = len(factors) == 1 and sum(monomial) == 1
    return factors[0] if factors else -1, not single, factors, monomial
