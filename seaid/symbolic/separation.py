"""Algorithm 1 of the paper: equations of motion into zeta, R and theta of (9), exactly.

The equations are expanded as polynomials and grouped by the powers of the unknowns. The group
without unknowns is zeta; every other group is a column of R, and its product of unknowns a
parameter.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import sympy as sp
from flint import fmpq, fmpq_mpoly

from seaid._progress import Display, track
from seaid.errors import SymbolicError, checked
from seaid.symbolic.closed_loops import check_closures, prolonged
from seaid.symbolic.entries import (
    Entry,
    Row,
    column_key,
    entry_to_sympy,
    grouped,
    grouped_by_motion,
    normalised,
)
from seaid.symbolic.from_sympy import declared, read_equations, without_dependent
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


@dataclass(frozen=True, eq=False, repr=False)
class RegressorForm(Display):
    """The regressor form (9): zeta = regressor * parameters.

    Attributes
    ----------
    zeta, parameters : sympy matrices, (n, 1) and (m, 1)
        For n equations and m parameters.
    ring, rows, monomials
        The same as exact polynomials: `rows[i]` are the elements of equation i by the exponents of
        the unknowns, `monomials` these exponents in the order of the columns.
    closures
        Polynomials that are zero along every motion: loop closures and their derivatives.
    """

    zeta: sp.ImmutableMatrix
    parameters: sp.ImmutableMatrix
    ring: Ring = field(repr=False)
    rows: tuple[Row, ...] = field(repr=False)
    monomials: tuple[Exponents, ...] = field(repr=False)
    closures: tuple[fmpq_mpoly, ...] = field(repr=False, default=())

    @cached_property
    def regressor(self) -> sp.ImmutableMatrix:
        """The regressor R (n, m) of (9), computed on first access; seconds for a large system."""
        return self.columns(range(len(self.monomials)))

    def columns(self, places: Iterable[int]) -> sp.ImmutableMatrix:
        """Return the columns of R at `places`."""
        selected = [self.monomials[place] for place in places]
        rows = [[entry_to_sympy(self.ring, row.get(m)) for m in selected] for row in self.rows]
        return sp.ImmutableMatrix(rows)


@checked(SymbolicError)
def separate(
    equations: Any,
    motion: Iterable[sp.Expr],
    unknowns: Iterable[sp.Expr],
    *,
    relations: Any = (),
    max_terms: int = MAX_TERMS,
    progress: bool = False,
) -> RegressorForm:
    """Bring equations of motion to the regressor form zeta = R theta of (9), by Algorithm 1.

    Parameters
    ----------
    equations : sympy expression, Eq, or several
        Expressions that are zero along every motion. Floats count as the decimals they represent.
    motion : sympy functions of time or symbols
        The measured signals; the derivatives of a function of time are included.
    unknowns : sympy symbols
        The symbols to identify, in the order of the columns. Unknowns that occur only as a product
        become one lumped parameter, placed after its first factor. An unknown phase gives two: of
        a sin(q + phi) these are a cos(phi) and a sin(phi). Every other symbol is known and
        stays a symbol; a symbol t is time. A function of time that is not in `motion` is an input
        and must not multiply an unknown; so is a symbol that multiplies nothing that moves.
    relations : sympy expression, Eq, or several, optional
        Expressions in signals that are zero along every motion, such as u - q' for a generalised
        speed, or q2 + 2 q1 for a gear. A signal that occurs in one once, linearly, with a constant
        factor, is replaced with its derivatives (the last declared one, if there are several).
        Other relations, such as the closure of a four-bar linkage, are kept: `reduce` then judges
        columns on the motions that satisfy them. They may contain signals, their sines,
        cosines and roots, known symbols and algebraic numbers such as sqrt(3).
    max_terms : int, default 500 000
        Limit on the terms of one polynomial.
    progress : bool, default False
        Show a progress bar on stderr.

    Returns
    -------
    RegressorForm
        An unknown that occurs in no equation keeps a column of zeros.

    Raises
    ------
    SymbolicError
        If an unknown is inside a function or in a sum in a denominator that cannot be cleared, for
        unusable `motion` or `unknowns`, for an undeclared function of time that multiplies an
        unknown, for complex numbers and integrals, for relations with an unknown or without a
        signal, for equations without unknowns and for equations of more than `max_terms` terms.

    Notes
    -----
    The result does not depend on how an equation is written. Quotients of products of unknowns,
    such as k/N**2, are parameters, so that a row keeps its scale: (8) times an unknown ratio N
    would share no parameter with (7), and zero would solve it. A sum of unknowns in a denominator
    is cleared where a term without unknowns remains. Each row is then divided by one known
    coefficient, which becomes +1. It is that of the row's
    input: a signal that occurs once, linearly and without unknowns, with a coefficient that is, up
    to a number, also that of a term with an unknown, as tau_M in (7). If no term or several terms
    qualify, it is the coefficient that leaves the others simplest: fewest known symbols, then
    shortest numbers, then first in order. So (7) gives (10).

    Examples
    --------
    >>> t, m, b = sympy.symbols("t m b")
    >>> x, F = sympy.Function("x")(t), sympy.Function("F")(t)
    >>> separate(m * x.diff(t, 2) + b * x.diff(t) - F, motion=[x, F], unknowns=[m, b]).regressor
    Matrix([[Derivative(x(t), (t, 2)), Derivative(x(t), t)]])
    """
    expressions, signals, symbols = declared(equations, motion, unknowns)
    expressions, loops = without_dependent(expressions, relations, signals, symbols)
    loops = prolonged(loops, expressions, signals)
    ring, ratios = read_equations(
        expressions, signals, symbols, max_terms, closures=loops, progress=progress
    )
    closures = tuple(closure.numerator for closure in ratios[len(expressions) :])
    check_closures(ring, closures, loops)
    symbols = _with_phases(ring, symbols)
    rows: list[Row] = []
    # The ratios of closures are the last ones, and no equations.
    pairs = list(enumerate(zip(ratios, expressions, strict=False), 1))
    for number, (equation, expression) in track(pairs, "equations grouped", progress):
        with located(f"equation {number}"):
            rows.append(_grouped(ring, equation, expression, symbols))
    rows = [normalised(ring, row) for row in rows]
    _check_undeclared(ring, rows, symbols)
    monomials = _columns(rows, symbols)
    known = (0,) * len(symbols)
    return RegressorForm(
        zeta=sp.ImmutableMatrix([entry_to_sympy(ring, row.get(known)) for row in rows]),
        parameters=sp.ImmutableMatrix([_lumped(symbols, m) for m in monomials]),
        ring=ring,
        rows=tuple(rows),
        monomials=monomials,
        closures=closures,
    )


def _with_phases(ring: Ring, unknowns: tuple[sp.Symbol, ...]) -> tuple[sp.Expr, ...]:
    """Return the unknowns, with cos(phi) and sin(phi) for an unknown phi inside of them."""
    expanded: list[sp.Expr] = []
    for unknown in unknowns:
        within = [x for x in (ring.generators[i] for i in ring.unknown) if x.has(unknown)]
        expanded += sorted(within, key=str) or [unknown]
    return tuple(dict.fromkeys(expanded))


def _lumped(unknowns: Sequence[sp.Expr], monomial: Exponents) -> sp.Expr:
    return sp.Mul(*(u**e for u, e in zip(unknowns, monomial, strict=True)))


def _grouped(
    ring: Ring, equation: Ratio, expression: sp.Expr, unknowns: Sequence[sp.Expr]
) -> dict[Exponents, Entry]:
    """Group an equation by its products of unknowns, such as k and k/N; the row keeps its scale."""
    # Products of unknowns in the denominator become negative exponents: k and k/N differ.
    quotients, sums, motion_part = _denominators(ring, equation.denominator)
    groups = grouped(ring, equation.numerator)
    shift = quotients
    if not sums.is_constant():
        shift = _clearing_shift(ring, groups, quotients, sums, expression)
    places = [unknowns.index(ring.generators[i]) for i in ring.unknown]
    entries = {}
    for exponents, terms in groups.items():
        monomial = [0] * len(unknowns)
        for place, exponent, less in zip(places, exponents, shift, strict=True):
            monomial[place] = exponent - less
        entries[tuple(monomial)] = _entry(ring, terms, motion_part)
    return entries


def _denominators(ring: Ring, denominator: fmpq_mpoly) -> tuple[Exponents, fmpq_mpoly, fmpq_mpoly]:
    """Split a denominator into a product of unknowns, their sums, and factors with motion only.

    Known factors only scale the row.
    """
    product, sums, motion = [0] * len(ring.unknown), ring.constant(1), ring.constant(1)
    if not denominator.is_constant():
        for factor, times in denominator.factor()[1]:
            degrees = factor.degrees()
            # A factor of one term is a power of an unknown, for its exponent; sums must be cleared.
            unknown = [k for k, i in enumerate(ring.unknown) if degrees[i]]
            if unknown and len(factor) == 1:
                product[unknown[0]] += int(times)
            elif unknown:
                sums *= factor**times
            elif any(degrees[i] for i in ring.motion):
                motion *= factor**times
    return tuple(product), sums, motion


def _clearing_shift(
    ring: Ring,
    groups: Container[Exponents],
    quotients: Exponents,
    sums: fmpq_mpoly,
    expression: sp.Expr,
) -> Exponents:
    """Return the exponents to subtract from each term of an equation that `sums` multiplies.

    That is allowed only if a term without unknowns remains, which fixes the scale: with the
    quotients of products, or else without any quotient.
    """
    for shift in (quotients, (0,) * len(quotients)):
        if shift in groups:
            return shift
    below = to_sympy(ring, sums)
    unknown = next(u for u in (ring.generators[i] for i in ring.unknown) if below.has(u))
    terms = sp.Add.make_args(expression)
    term = next((x for x in terms if sp.fraction(sp.together(x))[1].has(unknown)), expression)
    raise SymbolicError(
        f"the unknown {unknown} is in the denominator {below} of the term {shortened(term)} and "
        "cannot be cleared: multiplied by it, every term contains an unknown and nothing fixes "
        "their scale; make it known, or name the whole fraction as one unknown"
    )


def _entry(ring: Ring, terms: Mapping[Exponents, fmpq_mpoly], below: fmpq_mpoly) -> Entry:
    """Return terms over a denominator of the motion as an element of R, in lowest terms."""
    if not below.is_constant():
        monomials = (ring.context.from_dict({m: fmpq(1)}) * known for m, known in terms.items())
        above, below = ratio(ring, sum(monomials, ring.constant(0)), below)
        terms = grouped_by_motion(ring, above)
    return Entry({m: from_polynomial(ring, known) for m, known in terms.items()}, below)


def _columns(rows: Sequence[Row], unknowns: Sequence[sp.Expr]) -> tuple[Exponents, ...]:
    """Return the columns: the products that occur, and the unknowns that occur in none."""
    monomials = {monomial for row in rows for monomial in row if any(monomial)}
    if not monomials:
        raise SymbolicError(
            "the regressor is empty, so no parameter is identifiable: none of the unknowns "
            f"{', '.join(map(str, unknowns))} is left in the equations; check that the same "
            "symbols are used, and that their terms do not cancel"
        )
    for place in range(len(unknowns)):
        if unknowns[place].is_Symbol and not any(monomial[place] for monomial in monomials):
            monomials.add(tuple(int(i == place) for i in range(len(unknowns))))
    return tuple(sorted(monomials, key=column_key))


def _check_undeclared(ring: Ring, rows: Sequence[Row], unknowns: Sequence[sp.Expr]) -> None:
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
