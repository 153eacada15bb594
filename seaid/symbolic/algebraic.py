"""Minimal polynomials of the algebraic numbers in equations: cos(pi/9), sqrt(2 + sqrt(2)).

Each number is a root of a polynomial over the field of those before it. Its coefficients are an
integer relation between powers, found by lattice reduction (Lenstra, Lenstra, Lovasz 1982) with far
more digits than the relation has, and confirmed with twice as many.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import prod

import sympy as sp
from flint import fmpq, fmpz_mat
from mpmath import mp, mpf

from seaid.symbolic.polynomial import Exponents, Relation, Ring

MOST_DEGREES = 40
"""Largest degree of the field of all numbers; beyond it only sin^2 = 1 - cos^2 is used."""

_DIGITS_PER_TERM = 30
"""A chance relation has coefficients of about this many digits, a true one at most half."""


def algebraic_relations(ring: Ring) -> list[Relation]:
    """Return the relations of the ring's algebraic numbers, the lowest generator first.

    Empty if the numbers are roots of integers only, which are independent as they are, or if their
    field is too large.
    """
    places = [i for i in reversed(ring.known) if _is_algebraic(ring.generators[i])]
    numbers = [ring.generators[i] for i in places]
    if all(x.is_Pow and x.base.is_Integer for x in numbers):
        return []
    relations: list[Relation] = []
    degrees: list[int] = []
    for place in places:
        relation = _relation(ring, places[: len(degrees)], degrees, place)
        if relation is None:
            return []
        relations.append(relation)
        degrees.append(relation.degree)
    return relations


def _is_algebraic(number: sp.Expr) -> bool:
    return bool(number.is_number and number.is_algebraic and not number.is_Rational)


def _relation(
    ring: Ring, below: Sequence[int], degrees: Sequence[int], place: int
) -> Relation | None:
    """Return the relation of least degree of a number over the field of those `below`."""
    size = prod(degrees)
    least = 1 if degrees else _degree(ring.generators[place])
    for degree in range(least, MOST_DEGREES // size + 1):
        powers = product(*map(range, (*degrees, degree)))
        terms = [_exponents(ring, (*below, place), one) for one in powers]
        terms.append(_exponents(ring, (place,), (degree,)))
        factors = _integer_relation(ring, terms)
        if factors is not None:
            whole = {term: fmpq(x, factors[-1]) for term, x in zip(terms, factors, strict=True)}
            return Relation(place, degree, ring.context.from_dict(whole))
    return None


def _degree(number: sp.Expr) -> int:
    """Return the degree of cos(p pi / q), half that of the root of unity; 1 for other numbers."""
    if not isinstance(number, sp.cos):
        return 1
    turn = number.args[0] / (2 * sp.pi)
    return int(sp.totient(turn.q)) // 2 if turn.is_Rational else 1


def _exponents(ring: Ring, places: Sequence[int], powers: Sequence[int]) -> Exponents:
    result = [0] * len(ring.generators)
    for place, power in zip(places, powers, strict=True):
        result[place] = power
    return tuple(result)


def _integer_relation(ring: Ring, terms: Sequence[Exponents]) -> list[int] | None:
    """Return integers with which the terms add up to zero, the last of them not zero, or None."""
    digits = 100 + _DIGITS_PER_TERM * len(terms)
    with mp.workdps(2 * digits + 50):
        values = [_value(ring, term) for term in terms]
        lattice = [
            [*(int(i == j) for j in range(len(terms))), int(mp.nint(value * mpf(10) ** digits))]
            for i, value in enumerate(values)
        ]
        shortest = [int(x) for x in fmpz_mat(lattice).lll().tolist()[0]][:-1]
        left = abs(mp.fdot(shortest, values))
        is_short = max(map(abs, shortest)) < 10 ** (_DIGITS_PER_TERM // 2)
        return shortest if is_short and shortest[-1] and left < mpf(10) ** (-2 * digits) else None


def _value(ring: Ring, term: Exponents) -> mpf:
    parts = ((ring.generators[i], power) for i, power in enumerate(term) if power)
    return mp.fprod(mp.mpmathify(x.evalf(mp.dps)) ** power for x, power in parts)
