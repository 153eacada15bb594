"""Algorithm 1: equations of motion into zeta, R and theta of (9), exactly.

The equations are expanded as polynomials and grouped by the powers of the unknowns: a group without
unknowns belongs to zeta, every other one is a column of R and a parameter, a lumped one where
unknowns stand as a product.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import sympy as sp
from flint import fmpq, fmpq_mpoly

from seaid._progress import track
from seaid.errors import SymbolicError
from seaid.symbolic.entries import (
    Entry,
    Row,
    column_key,
    entry_to_sympy,
    grouped,
    grouped_by_motion,
    normalised,
)
from seaid.symbolic.from_sympy import declared, read_equations
from seaid.symbolic.generators import located, shortened
from seaid.symbolic.polynomial import (
    MAX_TERMS,
    Exponents,
    Ratio,
    Ring,
    from_polynomial,
    ratio,
    to_sympy,
)


@dataclass(frozen=True, eq=False)
class RegressorForm:
    """The regressor form (9): zeta = regressor * parameters.

    `zeta` (n, 1), `regressor` (n, m) and `parameters` (m, 1) are sympy matrices for n equations and
    m parameters. `ring`, `rows` and `monomials` hold the same as exact polynomials: `rows[i]` has
    the elements of equation i by the exponents of the unknowns, `monomials` these exponents in
    the order of the columns.
    """

    zeta: sp.ImmutableMatrix
    parameters: sp.ImmutableMatrix
    ring: Ring = field(repr=False)
    rows: tuple[Row, ...] = field(repr=False)
    monomials: tuple[Exponents, ...] = field(repr=False)

    @cached_property
    def regressor(self) -> sp.ImmutableMatrix:
        """R of (9), (n, m). Made when first asked for: of a large system it takes seconds."""
        return self.columns(range(len(self.monomials)))

    def columns(self, places: Iterable[int]) -> sp.ImmutableMatrix:
        """Return the columns of R at `places`."""
        chosen = [self.monomials[place] for place in places]
        rows = [[entry_to_sympy(self.ring, row.get(m)) for m in chosen] for row in self.rows]
        return sp.ImmutableMatrix(rows)


def separate(
    equations: Any,
    motion: Iterable[sp.Expr],
    unknowns: Iterable[sp.Symbol],
    *,
    max_terms: int = MAX_TERMS,
    progress: bool = False,
) -> RegressorForm:
    """Bring equations of motion to the regressor form zeta = R theta of (9), by Algorithm 1.

    `equations`: one expression that is zero or a sympy Eq, or several. `motion`: the measured
    signals, functions of time (their derivatives come with them) or plain symbols. `unknowns`:
    the symbols to identify, in the order of the columns; unknowns that only occur as products
    become one lumped parameter a product, which comes after its first factor. Every other symbol
    is known and stays a symbol; a function of time that is not in `motion` is taken as an input
    where it stands without unknowns; a symbol t is time. An unknown that no equation holds keeps a
    column of zeros. `progress` shows the equations done, on stderr.

    The result does not depend on how an equation is written. A denominator with unknowns is
    cleared. Each row is then divided by one coefficient: that of its input, a signal which stands
    alone, linearly, in one term without unknowns, of which no derivative or function occurs, and
    whose coefficient is, up to a number, also that of a term with an unknown (tau_M of (7)). If
    several terms could be the input, or none, it is the coefficient by which the others become
    simplest: fewest known symbols, then shortest numbers, then first in order. This coefficient
    becomes +1, in zeta if its term has no unknowns. So (7) gives (10).

    Raises SymbolicError where an unknown stands inside a function or in a denominator that cannot
    be cleared, for unusable `motion` or `unknowns`, for an undeclared function of time beside an
    unknown, for equations without any unknown and for equations of more than `max_terms` terms.
    """
    expressions, signals, symbols = declared(equations, motion, unknowns)
    ring, ratios = read_equations(expressions, signals, symbols, max_terms, progress=progress)
    rows = []
    pairs = list(enumerate(zip(ratios, expressions, strict=True), 1))
    for number, (equation, expression) in track(pairs, "equations grouped", progress):
        with located(f"equation {number}"):
            rows.append(normalised(ring, _grouped(ring, equation, expression, symbols)))
    _check_undeclared(ring, rows, symbols)
    monomials = _columns(rows, symbols)
    known = (0,) * len(symbols)
    return RegressorForm(
        zeta=sp.ImmutableMatrix([entry_to_sympy(ring, row.get(known)) for row in rows]),
        parameters=sp.ImmutableMatrix([_lumped(symbols, m) for m in monomials]),
        ring=ring,
        rows=tuple(rows),
        monomials=monomials,
    )


def _lumped(unknowns: Sequence[sp.Symbol], monomial: Exponents) -> sp.Expr:
    return sp.Mul(*(u**e for u, e in zip(unknowns, monomial, strict=True)))


def _grouped(
    ring: Ring, equation: Ratio, expression: sp.Expr, unknowns: Sequence[sp.Symbol]
) -> dict[Exponents, Entry]:
    """Group an equation by its products of unknowns, the denominators with unknowns cleared."""
    numerator = equation.numerator
    unknown_part, motion_part = _denominators(ring, equation.denominator)
    shift = _shift(ring, numerator, unknown_part, expression)
    places = [unknowns.index(ring.generators[i]) for i in ring.unknown]
    entries = {}
    for exponents, terms in grouped(ring, numerator).items():
        monomial = [0] * len(unknowns)
        for place, exponent, less in zip(places, exponents, shift, strict=True):
            monomial[place] = exponent - less
        entries[tuple(monomial)] = _entry(ring, terms, motion_part)
    return entries


def _denominators(ring: Ring, denominator: fmpq_mpoly) -> tuple[fmpq_mpoly, fmpq_mpoly]:
    """Split a denominator: what holds unknowns, what holds motion; known factors only scale."""
    with_unknown, with_motion = ring.constant(1), ring.constant(1)
    if not denominator.is_constant():
        for factor, times in denominator.factor()[1]:
            degrees = factor.degrees()
            if any(degrees[i] for i in ring.unknown):
                with_unknown *= factor**times
            elif any(degrees[i] for i in ring.motion):
                with_motion *= factor**times
    return with_unknown, with_motion


def _shift(
    ring: Ring, numerator: fmpq_mpoly, denominator: fmpq_mpoly, expression: sp.Expr
) -> Exponents:
    """Return the exponents to take off each term: not zero where quotients like m1/m2 are lumped.

    Clearing the denominator is right if a term without unknowns is left, to fix the scale.
    """
    cleared = (0,) * len(ring.unknown)
    if denominator.is_constant():
        return cleared
    products = set(grouped(ring, numerator))
    if cleared in products:
        return cleared
    if len(denominator) == 1:
        (lumped,) = grouped(ring, denominator)
        return lumped if lumped in products else cleared
    found = to_sympy(ring, denominator)
    unknown = next(u for u in (ring.generators[i] for i in ring.unknown) if found.has(u))
    terms = sp.Add.make_args(expression)
    term = next((x for x in terms if sp.fraction(sp.together(x))[1].has(unknown)), expression)
    raise SymbolicError(
        f"the unknown {unknown} stands in the denominator {found} of the term {shortened(term)}, "
        "and it does not clear: multiplied by it, every term holds an unknown and nothing fixes "
        "their scale; make it known, or name the whole fraction as one unknown"
    )


def _entry(ring: Ring, terms: Mapping[Exponents, fmpq_mpoly], below: fmpq_mpoly) -> Entry:
    """Return terms over a denominator of the motion as an element of R, in lowest terms."""
    if not below.is_constant():
        monomials = (ring.context.from_dict({m: fmpq(1)}) * known for m, known in terms.items())
        above, below = ratio(ring, sum(monomials, ring.constant(0)), below)
        terms = grouped_by_motion(ring, above)
    return Entry({m: from_polynomial(ring, known) for m, known in terms.items()}, below)


def _columns(rows: Sequence[Row], unknowns: Sequence[sp.Symbol]) -> tuple[Exponents, ...]:
    """Return the columns: the products that occur, and unknowns that occur in none."""
    found = {monomial for row in rows for monomial in row if any(monomial)}
    if not found:
        raise SymbolicError(
            "the regressor is empty, so no parameter is identifiable: none of the unknowns "
            f"{', '.join(map(str, unknowns))} is left in the equations; check that the same "
            "symbols are used, and that their terms do not cancel"
        )
    for place in range(len(unknowns)):
        if not any(monomial[place] for monomial in found):
            found.add(tuple(int(i == place) for i in range(len(unknowns))))
    return tuple(sorted(found, key=column_key))


def _check_undeclared(ring: Ring, rows: Sequence[Row], unknowns: Sequence[sp.Symbol]) -> None:
    """Refuse an undeclared function of time that multiplies an unknown."""
    for number, row in enumerate(rows, 1):
        for monomial, entry in row.items():
            for place in ring.undeclared if any(monomial) else ():
                if any(m[place] for m in entry.terms) or entry.denominator.degrees()[place] > 0:
                    raise SymbolicError(
                        f"equation {number}: {ring.generators[place]} multiplies the unknown "
                        f"{_lumped(unknowns, monomial)} and is not declared; add it to motion if "
                        "it is measured, or give it as a symbol if it is a known constant"
                    )
