"""The elements of R and zeta as exact polynomials."""

from __future__ import annotations

from collections.abc import Mapping
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


def grouped_by_motion(ring: Ring, polynomial: fmpq_mpoly) -> dict[Exponents, fmpq_mpoly]:
    """Return {exponents of the motion's generators: coefficient in the known symbols}."""
    moving = set(ring.motion)
    terms: dict[Exponents, dict[Exponents, fmpq]] = {}
    for exponents, coefficient in polynomial.terms():
        motion = tuple(e if i in moving else 0 for i, e in enumerate(exponents))
        known = tuple(0 if i in moving else e for i, e in enumerate(exponents))
        terms.setdefault(motion, {})[known] = coefficient
    return {motion: ring.context.from_dict(known) for motion, known in terms.items()}


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
