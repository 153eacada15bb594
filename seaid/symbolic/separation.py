"""Algorithm 1: equations of motion into zeta, R and theta of (9), exactly.

The equations are expanded as polynomials and grouped by the powers of the unknowns: a group without
unknowns belongs to zeta, every other one is a column of R and a parameter, a lumped one where
unknowns stand as a product.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import sympy as sp
from flint import fmpq, fmpq_mpoly
from sympy.core.function import AppliedUndef

from seaid.errors import SymbolicError
from seaid.symbolic.functions import located
from seaid.symbolic.polynomial import (
    MAX_TERMS,
    Exponents,
    Ratio,
    Ring,
    from_polynomial,
    product,
    quotient,
    ratio,
    ratio_to_sympy,
    term_to_sympy,
    to_sympy,
)
from seaid.symbolic.reading import read_equations


class Entry(NamedTuple):
    """One element of R or zeta: sum of coefficient times motion term, over a function of motion."""

    terms: Mapping[Exponents, Ratio]
    denominator: fmpq_mpoly


_MOST_SCALES = 30
"""Coefficients tried as the scale of a row that has no input."""

Row = Mapping[Exponents, Entry]
"""One equation: for each product of unknowns (its exponents) what it multiplies."""


@dataclass(frozen=True, eq=False)
class RegressorForm:
    """The regressor form (9): zeta = regressor * parameters.

    `zeta` (n, 1), `regressor` (n, m) and `parameters` (m, 1) are sympy matrices for n equations and
    m parameters. `ring`, `rows` and `monomials` hold the same as exact polynomials: `rows[i]` has
    the elements of equation i by the exponents of the unknowns, `monomials` these exponents in
    the order of the columns.
    """

    zeta: sp.ImmutableMatrix
    regressor: sp.ImmutableMatrix
    parameters: sp.ImmutableMatrix
    ring: Ring = field(repr=False)
    rows: tuple[Row, ...] = field(repr=False)
    monomials: tuple[Exponents, ...] = field(repr=False)


def separate(
    equations: Any,
    motion: Iterable[sp.Expr],
    unknowns: Iterable[sp.Symbol],
    *,
    max_terms: int = MAX_TERMS,
) -> RegressorForm:
    """Bring equations of motion to the regressor form zeta = R theta of (9), by Algorithm 1.

    `equations`: one expression that is zero or a sympy Eq, or several. `motion`: the measured
    signals, functions of time (their derivatives come with them) or plain symbols. `unknowns`:
    the symbols to identify, in the order of the columns; unknowns that only occur as products
    become one lumped parameter a product, after the single ones. Every other symbol is known and
    stays a symbol; a function of time that is not in `motion` is taken as an input where it
    stands without unknowns. An unknown that no equation holds keeps a column of zeros.

    The result does not depend on how an equation is written. A denominator with unknowns is
    cleared. Each row is then divided by one coefficient: that of its input, a signal which stands
    alone, linearly, in one term without unknowns, and of which no derivative or function occurs
    (tau_M of (7)); of several, or of all terms if there is none, by the one that leaves the
    simplest coefficients: fewest known symbols, then shortest numbers. This coefficient becomes
    +1, in zeta if its term has no unknowns. So (7) gives (10).

    Raises SymbolicError where an unknown stands inside a function or in a denominator that cannot
    be cleared, for unusable `motion` or `unknowns`, for an undeclared function of time beside an
    unknown, for equations without any unknown and for equations of more than `max_terms` terms.
    """
    expressions, signals, symbols = _checked(equations, motion, unknowns)
    ring, ratios = read_equations(expressions, signals, symbols, max_terms)
    rows = []
    for number, (equation, expression) in enumerate(zip(ratios, expressions, strict=True), 1):
        with located(f"equation {number}"):
            rows.append(_normalised(ring, _grouped(ring, equation, expression, symbols)))
    _check_undeclared(ring, rows, symbols)
    monomials = _columns(rows, symbols)
    known = (0,) * len(symbols)
    return RegressorForm(
        zeta=sp.ImmutableMatrix([entry_to_sympy(ring, row.get(known)) for row in rows]),
        regressor=sp.ImmutableMatrix(
            [[entry_to_sympy(ring, row.get(m)) for m in monomials] for row in rows]
        ),
        parameters=sp.ImmutableMatrix([_lumped(symbols, m) for m in monomials]),
        ring=ring,
        rows=tuple(rows),
        monomials=monomials,
    )


def entry_to_sympy(ring: Ring, entry: Entry | None) -> sp.Expr:
    """Return an element of R or zeta as a sympy sum."""
    if entry is None:
        return sp.Integer(0)
    terms = (
        ratio_to_sympy(ring, value) * term_to_sympy(ring, exponents)
        for exponents, value in entry.terms.items()
    )
    return sp.Add(*terms) / to_sympy(ring, entry.denominator)


def _lumped(unknowns: Sequence[sp.Symbol], monomial: Exponents) -> sp.Expr:
    return sp.Mul(*(u**e for u, e in zip(unknowns, monomial, strict=True)))


def _checked(
    equations: Any, motion: Any, unknowns: Any
) -> tuple[list[sp.Expr], tuple[sp.Expr, ...], tuple[sp.Symbol, ...]]:
    """Return the three arguments as sequences. Raises SymbolicError for what cannot be used."""
    expressions = [_expression(equation) for equation in _listed(equations)]
    signals = tuple(m.expr if isinstance(m, sp.Derivative) else m for m in _listed(motion))
    symbols = tuple(_listed(unknowns))
    for kind, given in (("equations", expressions), ("motion", signals), ("unknowns", symbols)):
        if not given:
            raise SymbolicError(f"{kind} is empty; give at least one")
    for signal in signals:
        if not isinstance(signal, sp.Symbol | AppliedUndef):
            raise SymbolicError(
                f"motion holds {signal!r}; allowed are functions of time such as Function('q')(t), "
                "and symbols"
            )
    for place, symbol in enumerate(symbols):
        if not isinstance(symbol, sp.Symbol):
            raise SymbolicError(f"unknowns holds {symbol!r}; allowed are sympy symbols")
        if symbol in symbols[:place]:
            raise SymbolicError(f"the unknown {symbol} is listed twice; list it once")
        if any(symbol == signal or signal.has(symbol) for signal in signals):
            raise SymbolicError(
                f"{symbol} is both unknown and known: it stands in unknowns and in motion; take it "
                "out of one of them"
            )
    _check_names(expressions, (*signals, *symbols))
    return expressions, signals, symbols


def _listed(given: Any) -> list[Any]:
    return [given] if isinstance(given, sp.Expr | sp.Eq) else list(given)


def _expression(equation: Any) -> sp.Expr:
    try:
        equation = sp.sympify(equation)
    except sp.SympifyError:
        raise SymbolicError(f"{equation!r} is no equation; give a sympy expression or Eq") from None
    if isinstance(equation, sp.Eq):
        equation = equation.lhs - equation.rhs
    if not isinstance(equation, sp.Expr):
        raise SymbolicError(f"{equation!r} is no equation; give a sympy expression or Eq")
    return equation


def _check_names(expressions: Sequence[sp.Expr], declared: Sequence[sp.Expr]) -> None:
    """Refuse two different symbols of one name, a declared one and one of the equations."""
    names = {str(x): x for x in declared}
    for number, expression in enumerate(expressions, 1):
        for found in expression.free_symbols | expression.atoms(AppliedUndef):
            twin = names.get(str(found), found)
            if twin != found:
                raise SymbolicError(
                    f"equation {number} holds a {found} that is not the declared {twin}: they "
                    "share the name but not the assumptions (real, positive ...); make it once and "
                    "use it everywhere"
                )


def _grouped(
    ring: Ring, equation: Ratio, expression: sp.Expr, unknowns: Sequence[sp.Symbol]
) -> dict[Exponents, Entry]:
    """Group an equation by its products of unknowns, the denominators with unknowns cleared."""
    numerator = equation.numerator
    unknown_part, motion_part = _denominators(ring, equation.denominator)
    places = [ring.index.get(u) for u in unknowns]
    shift = _shift(ring, numerator, unknown_part, expression)
    groups: dict[Exponents, dict[Exponents, fmpq]] = {}
    for exponents, value in numerator.terms():
        monomial = tuple(0 if i is None else exponents[i] - shift[i] for i in places)
        rest = list(exponents)
        for i in ring.unknown:
            rest[i] = 0
        groups.setdefault(monomial, {})[tuple(rest)] = value
    return {
        monomial: _entry(ring, ratio(ring, ring.context.from_dict(terms), motion_part))
        for monomial, terms in groups.items()
    }


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
    cleared = (0,) * len(ring.generators)
    if denominator.is_constant():
        return cleared
    products = {tuple(e[i] for i in ring.unknown) for e in numerator.monoms()}
    if (0,) * len(ring.unknown) in products:
        return cleared
    if len(denominator) == 1:
        lumped = denominator.monomial(0)
        return lumped if tuple(lumped[i] for i in ring.unknown) in products else cleared
    found = to_sympy(ring, denominator)
    unknown = next(u for u in (ring.generators[i] for i in ring.unknown) if found.has(u))
    terms = sp.Add.make_args(expression)
    term = next((x for x in terms if sp.fraction(sp.together(x))[1].has(unknown)), expression)
    raise SymbolicError(
        f"the unknown {unknown} stands in the denominator {found} of the term {term}, and it does "
        "not clear: multiplied by it, every term holds an unknown and nothing fixes their scale; "
        "make it known, or name the whole fraction as one unknown"
    )


def _entry(ring: Ring, value: Ratio) -> Entry:
    """Group a ratio by its functions of the motion."""
    moving = set(ring.motion)
    terms: dict[Exponents, dict[Exponents, fmpq]] = {}
    for exponents, coefficient in value.numerator.terms():
        motion = tuple(e if i in moving else 0 for i, e in enumerate(exponents))
        known = tuple(0 if i in moving else e for i, e in enumerate(exponents))
        terms.setdefault(motion, {})[known] = coefficient
    return Entry(
        {m: from_polynomial(ring, ring.context.from_dict(k)) for m, k in terms.items()},
        value.denominator,
    )


def _normalised(ring: Ring, row: Mapping[Exponents, Entry]) -> Row:
    """Divide a row by its scale and bring the terms without unknowns to the other side."""
    if not row:
        return row
    scale, pivot = _scale(ring, row)
    if not any(pivot):
        scale = _negative(scale)
    inverse = {True: ratio(ring, *reversed(scale))}
    inverse[False] = _negative(inverse[True])
    return {
        monomial: Entry(
            {m: product(ring, value, inverse[any(monomial)]) for m, value in entry.terms.items()},
            entry.denominator,
        )
        for monomial, entry in row.items()
    }


def _negative(value: Ratio) -> Ratio:
    return Ratio(-value.numerator, value.denominator)


def _scale(ring: Ring, row: Mapping[Exponents, Entry]) -> tuple[Ratio, Exponents]:
    """Return the coefficient to divide the row by, and the product of unknowns it belongs to."""
    terms = [
        (monomial, motion, value)
        for monomial, entry in sorted(row.items(), key=lambda item: _column_key(item[0]))
        for motion, value in sorted(entry.terms.items(), reverse=True)
    ]
    inputs = [term for term in terms if not any(term[0]) and _is_input(ring, row, term[1])]
    candidates = inputs or terms
    if len(candidates) > 1:
        counts = Counter(_text(value) for _, _, value in terms)
        different = {_text(value): value for _, _, value in terms}
        weighted = [(value, counts[text]) for text, value in different.items()]
        candidates = _shortlist(ring, candidates)
        candidates.sort(key=lambda term: _cost_of_row(ring, weighted, term[2]))
    monomial, _, scale = candidates[0]
    return scale, monomial


def _text(value: Ratio) -> str:
    return f"{value.numerator}/{value.denominator}"


_Term = tuple[Exponents, Exponents, Ratio]


def _shortlist(ring: Ring, terms: list[_Term]) -> list[_Term]:
    """The first terms of the few coefficients that are simplest without their common factor."""
    common = terms[0][2].numerator
    for _, _, value in terms:
        common = common.gcd(value.numerator)
    different: dict[str, _Term] = {}
    for term in terms:
        different.setdefault(_text(term[2]), term)
    order = sorted(
        different.values(),
        key=lambda term: _cost(ratio(ring, term[2].numerator, common))[0],
    )
    return order[:_MOST_SCALES]


def _cost_of_row(
    ring: Ring, weighted: Sequence[tuple[Ratio, int]], scale: Ratio
) -> tuple[int, int]:
    """How complicated the coefficients of a row are once divided by `scale`."""
    symbols, digits = 0, 0
    for value, count in weighted:
        cost = _cost(quotient(ring, value, scale))
        symbols, digits = symbols + count * cost[0], digits + count * cost[1]
    return symbols, digits


def _cost(value: Ratio) -> tuple[int, int]:
    """Known symbols in a coefficient, with multiplicity, and binary digits of its numbers."""
    symbols, digits = 0, 0
    for polynomial in value:
        for exponents, number in polynomial.terms():
            symbols += sum(exponents)
            digits += int(number.p).bit_length() + int(number.q).bit_length()
    return symbols, digits


def _is_input(ring: Ring, row: Mapping[Exponents, Entry], motion: Exponents) -> bool:
    """True for a signal alone in its term, no function of which occurs elsewhere in the row."""
    if sum(motion) != 1:
        return False
    place = motion.index(1)
    signal = ring.generators[place]
    if not isinstance(signal, sp.Symbol | AppliedUndef) or any(
        other != signal and other.has(signal) for other in ring.generators
    ):
        return False
    occurs = sum(m[place] != 0 for entry in row.values() for m in entry.terms)
    return occurs == 1 and all(e.denominator.degrees()[place] == 0 for e in row.values())


def _column_key(monomial: Exponents) -> tuple[bool, Exponents, Exponents]:
    """Order of the columns: single unknowns as declared, then products by their first factor."""
    factors = tuple(i for i, e in enumerate(monomial) for _ in range(abs(e)))
    return sum(monomial) != 1 or len(factors) != 1, factors, monomial


def _columns(rows: Sequence[Row], unknowns: Sequence[sp.Symbol]) -> tuple[Exponents, ...]:
    """Return the columns: the products that occur, and unknowns that occur in none."""
    found = {monomial for row in rows for monomial in row if any(monomial)}
    if not found:
        raise SymbolicError(
            "the regressor is empty: none of the unknowns "
            f"{', '.join(map(str, unknowns))} is left in the equations; check that the same "
            "symbols are used, and that their terms do not cancel"
        )
    for place in range(len(unknowns)):
        if not any(monomial[place] for monomial in found):
            found.add(tuple(int(i == place) for i in range(len(unknowns))))
    return tuple(sorted(found, key=_column_key))


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
