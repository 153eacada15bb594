"""Exact arithmetic for equations of motion: quotients of sparse polynomials over the rationals.

The generators are the functions of the motion (q', q'', sin q, cos q, sign q' ...), the known
symbols and the unknown ones. Algebraic generators are reduced everywhere (sin^2 to 1 - cos^2,
sqrt(a)^2 to a, sign^2 to 1), so that a polynomial is zero exactly if it has no terms.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import sympy as sp
from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly

from seaid.errors import SymbolicError

Exponents = tuple[int, ...]

Member = TypeVar("Member")

MAX_TERMS = 500_000
"""Default limit on the terms of one polynomial, a few hundred megabytes."""

_PRODUCTS_PER_TERM = 100
"""A multiplication may form this many products per term of the limit before it is refused."""


class Relation(NamedTuple):
    """generator^degree = lower terms, as `polynomial` = 0 with leading term generator^degree."""

    generator: int
    degree: int
    polynomial: fmpq_mpoly


class Ratio(NamedTuple):
    """numerator / denominator without common factors, leading coefficient 1 in the denominator."""

    numerator: fmpq_mpoly
    denominator: fmpq_mpoly


@dataclass(frozen=True, eq=False)
class Ring:
    """The generators of a system of equations, their kinds and their relations.

    `generators` are sympy expressions; `motion`, `unknown`, `known` are their indices by kind;
    `undeclared` are functions of time that the caller did not declare; `moving` are the symbols
    that change during a motion, time among them. `units` has the divisor of every "angle",
    "exponent" and base of a "root" of which the rational factors are multiples. Up to `most_turns`
    times an angle, sine and cosine are polynomials in those of the angle.
    """

    context: fmpq_mpoly_ctx
    generators: tuple[sp.Expr, ...]
    motion: tuple[int, ...]
    unknown: tuple[int, ...]
    known: tuple[int, ...]
    undeclared: tuple[int, ...]
    moving: frozenset[sp.Symbol]
    units: Mapping[str, Mapping[sp.Expr, sp.Rational]]
    max_terms: int
    most_turns: float
    relations: list[Relation] = field(default_factory=list)
    index: dict[sp.Expr, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", {g: i for i, g in enumerate(self.generators)})

    def constant(self, value: int | fmpq) -> fmpq_mpoly:
        """Return a constant polynomial."""
        return self.context.constant(value)

    def generator(self, expression: sp.Expr) -> fmpq_mpoly:
        """Return the generator of `expression`."""
        return self.context.gen(self.index[expression])


def exponents_at(ring: Ring, places: Iterable[int], powers: Iterable[int]) -> Exponents:
    """Return the exponents of a product of generators at `places`, each to its power."""
    result = [0] * len(ring.generators)
    for place, exponent in zip(places, powers, strict=True):
        result[place] += int(exponent)
    return tuple(result)


def rational(value: sp.Rational) -> fmpq:
    """Return a sympy rational as a flint one."""
    return fmpq(int(value.p), int(value.q))


def from_polynomial(ring: Ring, polynomial: fmpq_mpoly) -> Ratio:
    """Return the polynomial as a ratio with denominator 1."""
    return Ratio(polynomial, ring.constant(1))


def ratio(ring: Ring, numerator: fmpq_mpoly, denominator: fmpq_mpoly) -> Ratio:
    """Return numerator / denominator in lowest terms, without square roots in the denominator."""
    if not denominator.is_constant():
        numerator, denominator = _rationalised(ring, numerator, denominator)
    # Only now: a denominator is zero exactly if it has no terms once it is reduced.
    if denominator.is_zero():
        raise SymbolicError("a denominator is identically zero; check the equation for x/(a - a)")
    if not denominator.is_constant():
        common = numerator.gcd(denominator)
        numerator, denominator = numerator / common, denominator / common
    leading = denominator.leading_coefficient()
    return Ratio(numerator / leading, denominator / leading)


def _rationalised(
    ring: Ring, numerator: fmpq_mpoly, denominator: fmpq_mpoly
) -> tuple[fmpq_mpoly, fmpq_mpoly]:
    """Free the denominator of generators with a relation: 1/sqrt(2) becomes sqrt(2)/2.

    Sums in several such functions of the motion stay: each of them would double the terms. So do
    sums of known symbols and algebraic numbers of degree three and more.
    """
    degrees = denominator.degrees()
    present = {place for place, _, _ in ring.relations if degrees[place] > 0}
    if not present:
        return numerator, denominator
    one_moves = len(present.intersection(ring.motion)) == 1
    for relation in ring.relations:
        if denominator.degrees()[relation.generator] > 0:
            factor = _freeing_factor(ring, denominator, relation, one_moves)
            if factor is not None:
                numerator = multiply(ring, numerator, factor)
                denominator = multiply(ring, denominator, factor)
    return numerator, denominator


def _freeing_factor(
    ring: Ring, denominator: fmpq_mpoly, relation: Relation, one_moves: bool
) -> fmpq_mpoly | None:
    """Return the factor that frees a denominator of a generator; None if the factor is long."""
    place, degree, polynomial = relation
    x, zero = ring.context.gen(place), ring.constant(0)
    parts = collect(ring, denominator, place)
    powers = collect(ring, polynomial, place)
    # Of a pure root x^d = c, x^(d - n) frees a single power x^n.
    if len(parts) == 1 and powers.keys() == {0, degree}:
        return x ** (degree - max(parts))
    if degree == 2 and (one_moves or place not in ring.motion):
        # the conjugate of a + b x with x^2 + l x + c = 0 is a - b l - b x
        b = parts[1]
        return parts.get(0, zero) - multiply(ring, b, powers.get(1, zero)) - x * b
    if all(part.is_constant() for part in (*parts.values(), *powers.values())):
        return _inverse(ring, place, parts, powers)
    return None


def _inverse(
    ring: Ring, place: int, parts: Mapping[int, fmpq_mpoly], relation: Mapping[int, fmpq_mpoly]
) -> fmpq_mpoly:
    """Return the inverse of a polynomial with rational coefficients in an algebraic number."""
    value, modulus = (
        fmpq_poly([side[n].leading_coefficient() if n in side else 0 for n in range(max(side) + 1)])
        for side in (parts, relation)
    )
    x = ring.context.gen(place)
    # s value + t modulus = 1: s is the inverse in the field of the number.
    factors = value.xgcd(modulus)[1].coeffs()
    return sum((factor * x**n for n, factor in enumerate(factors)), ring.constant(0))


def occurring(polynomial: Any) -> list[int]:
    """Return the places of the generators that a polynomial contains."""
    return [i for i, degree in enumerate(polynomial.degrees()) if degree > 0]


def collect(ring: Ring, polynomial: fmpq_mpoly, place: int) -> dict[int, fmpq_mpoly]:
    """Return {power: coefficient} of the polynomial in one generator."""
    parts: dict[int, dict[Exponents, fmpq]] = {}
    for exponents, value in polynomial.terms():
        rest = (*exponents[:place], 0, *exponents[place + 1 :])
        parts.setdefault(exponents[place], {})[rest] = value
    return {power: ring.context.from_dict(terms) for power, terms in parts.items()}


def multiply(ring: Ring, a: fmpq_mpoly, b: fmpq_mpoly) -> fmpq_mpoly:
    """Return a * b, reduced. Raises SymbolicError before `max_terms` is exceeded."""
    if len(a) < len(b):
        a, b = b, a
    products = len(a) * len(b)
    if products <= ring.max_terms:
        return reduced(ring, a * b)
    if products > _PRODUCTS_PER_TERM * ring.max_terms:
        raise _too_large(ring, f"a product of {len(a)} by {len(b)} terms")
    terms = list(a.terms())
    step = max(1, ring.max_terms // len(b))
    total = ring.constant(0)
    for start in range(0, len(terms), step):
        total += reduced(ring, ring.context.from_dict(dict(terms[start : start + step])) * b)
        if len(total) > ring.max_terms:
            raise _too_large(ring, f"a product of {len(a)} by {len(b)} terms")
    return total


def _too_large(ring: Ring, what: str) -> SymbolicError:
    return SymbolicError(
        f"the equations are too large: {what} goes beyond max_terms={ring.max_terms}; raise "
        "max_terms (about 500 bytes a term), or write the equations with fewer symbols"
    )


def reduced(ring: Ring, polynomial: fmpq_mpoly) -> fmpq_mpoly:
    """Return the polynomial with every relation applied: sin^2 becomes 1 - cos^2."""
    degrees = polynomial.degrees()
    # In the order of the generators: a relation may bring in those after its own, reduced later.
    for place, degree, relation in ring.relations:
        if degrees[place] >= degree:
            # In the lexicographic order the leading term of a relation is generator^degree.
            polynomial = divmod(polynomial, relation)[1]
            degrees = polynomial.degrees()
    return polynomial


def product(ring: Ring, a: Ratio, b: Ratio) -> Ratio:
    """Return a * b."""
    numerator = multiply(ring, a.numerator, b.numerator)
    if a.denominator.is_one() and b.denominator.is_one():
        return Ratio(numerator, a.denominator)
    return ratio(ring, numerator, multiply(ring, a.denominator, b.denominator))


def quotient(ring: Ring, a: Ratio, b: Ratio) -> Ratio:
    """Return a / b."""
    return product(ring, a, ratio(ring, b.denominator, b.numerator))


def total(ring: Ring, parts: Iterable[Ratio]) -> Ratio:
    """Return the sum, added in pairs so that long sums stay cheap."""
    summands = list(parts) or [from_polynomial(ring, ring.constant(0))]
    while len(summands) > 1:
        pairs = [_sum(ring, *summands[i : i + 2]) for i in range(0, len(summands) - 1, 2)]
        summands = pairs + summands[2 * len(pairs) :]
    if len(summands[0].numerator) > ring.max_terms:
        raise _too_large(ring, f"a sum of {len(summands[0].numerator)} terms")
    return summands[0]


def _sum(ring: Ring, p: Ratio, q: Ratio) -> Ratio:
    a, b = p
    c, d = q
    if b.is_one() and d.is_one():
        return Ratio(a + c, b)
    common = b.gcd(d)
    numerator = multiply(ring, a, d / common) + multiply(ring, c, b / common)
    return ratio(ring, numerator, multiply(ring, b, d / common))


def power(ring: Ring, base: Ratio, exponent: int) -> Ratio:
    """Return base^exponent by repeated squaring, each step under the limit of terms."""
    if exponent < 0:
        base, exponent = ratio(ring, base.denominator, base.numerator), -exponent
    if len(base.numerator) == 1 and base.denominator.is_one():
        return Ratio(reduced(ring, base.numerator**exponent), base.denominator)
    if exponent == 0:
        return from_polynomial(ring, ring.constant(1))
    half = power(ring, base, exponent // 2)
    even = product(ring, half, half)
    return product(ring, even, base) if exponent % 2 else even


def connected(sets: Iterable[Iterable[Member]]) -> list[set[Member]]:
    """Return the unions of the sets that share members, directly or through other sets."""
    unions: list[set[Member]] = []
    for members in map(set, sets):
        union = members.union(*(x for x in unions if x & members))
        unions = [*(x for x in unions if not x & members), union]
    return unions


def to_sympy(ring: Ring, polynomial: fmpq_mpoly) -> sp.Expr:
    """Return the polynomial as a sympy sum of products of the generators' expressions."""
    return sp.Add(*(term_to_sympy(ring, *term) for term in polynomial.terms()))


def term_to_sympy(ring: Ring, exponents: Exponents, value: fmpq | int = 1) -> sp.Expr:
    """Return one term, value times generators to their (possibly negative) exponents."""
    number = sp.Rational(int(value.p), int(value.q)) if isinstance(value, fmpq) else value
    factors = (ring.generators[i] ** int(e) for i, e in enumerate(exponents) if e)
    return sp.Mul(number, *factors)


def ratio_to_sympy(ring: Ring, value: Ratio) -> sp.Expr:
    """Return the ratio as a sympy expression, a sum over one denominator."""
    return to_sympy(ring, value.numerator) / to_sympy(ring, value.denominator)
