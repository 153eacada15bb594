"""From the regressor form to the base regressor form, (11)-(14), by exact elimination.

Coefficients are rationals or quotients of polynomials in the known symbols, so lengths may stay
symbols and the groupings are closed forms. Nothing is rounded, and no tolerance decides the rank.
"""

from __future__ import annotations

import random
import warnings
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Literal

import numpy as np
import sympy as sp
from flint import fmpq, fmpq_mat, fmpq_mpoly
from mpmath import mp, mpf

from seaid._progress import Display
from seaid.errors import SeaidWarning, SymbolicError
from seaid.symbolic.closed_loops import base_columns
from seaid.symbolic.entries import Entry, Row, grouped_by_motion
from seaid.symbolic.independence import independent_functions
from seaid.symbolic.polynomial import (
    Exponents,
    Ratio,
    Ring,
    connected,
    from_polynomial,
    multiply,
    product,
    ratio,
    ratio_to_sympy,
    term_to_sympy,
    to_sympy,
    total,
)
from seaid.symbolic.separation import RegressorForm

SparseRow = dict[int, Ratio]
PolynomialRow = dict[int, fmpq_mpoly]


def eliminate(
    ring: Ring, rows: Iterable[SparseRow], width: int
) -> tuple[list[SparseRow], tuple[int, ...], list[PolynomialRow]]:
    """Return the nonzero rows of the echelon form, their pivots, and the distinct rows.

    `rows` are sparse, {column: value}, of `width` columns; the pivots are the leftmost possible.
    Rows that differ only by a factor count once.
    """
    different = _distinct_rows(_primitive(ring, _cleared(ring, row)) for row in rows)
    if all(value.is_constant() for row in different for value in row.values()):
        echelon = _rational(ring, different, width)
    else:
        echelon = _eliminated(ring, different, width)
    pivots = tuple(min(row) for row in echelon)
    # The pivots of (13) are 1.
    scaled = [
        {column: ratio(ring, value, row[pivot]) for column, value in row.items()}
        for row, pivot in zip(echelon, pivots, strict=True)
    ]
    return scaled, pivots, different


def _cleared(ring: Ring, row: SparseRow) -> PolynomialRow:
    """Multiply a row by its common denominator."""
    common = ring.constant(1)
    for _, denominator in row.values():
        if not denominator.is_one():
            common = multiply(ring, common, denominator / common.gcd(denominator))
    return {
        column: multiply(ring, numerator, common / denominator)
        for column, (numerator, denominator) in row.items()
    }


def _primitive(ring: Ring, row: PolynomialRow) -> PolynomialRow:
    """Divide a row by its common factor, so that multiples of one row become equal."""
    row = {column: value for column, value in sorted(row.items()) if not value.is_zero()}
    if not row:
        return row
    common = ring.constant(0)
    for value in row.values():
        common = common.gcd(value)
        if common.is_one():
            break
    # Divided by it, the first entry has the leading coefficient 1: multiples become equal.
    common *= row[min(row)].leading_coefficient() / common.leading_coefficient()
    return {column: value / common for column, value in row.items()}


def _distinct_rows(rows: Iterable[PolynomialRow]) -> list[PolynomialRow]:
    distinct = {tuple((column, str(value)) for column, value in row.items()): row for row in rows}
    distinct.pop((), None)
    return list(distinct.values())


def _rational(ring: Ring, rows: list[PolynomialRow], width: int) -> list[PolynomialRow]:
    """Return the echelon form of rows of numbers."""
    zero = ring.constant(0)
    numbers = [
        [row.get(j, zero).leading_coefficient() if j in row else 0 for j in range(width)]
        for row in rows
    ]
    if not numbers:
        return []
    echelon, rank = fmpq_mat(numbers).rref()
    return [
        {j: ring.constant(echelon[i, j]) for j in range(width) if echelon[i, j] != 0}
        for i in range(rank)
    ]


def _eliminated(ring: Ring, rows: list[PolynomialRow], width: int) -> list[PolynomialRow]:
    """Return the echelon form of rows, by Gauss-Jordan elimination without fractions."""
    done: list[PolynomialRow] = []
    for column in range(width):
        holders = [row for row in rows if column in row]
        if holders:
            # The shortest row, since polynomials grow with each combination; ties by text.
            pivot = min(holders, key=lambda row: (sum(map(len, row.values())), str(row)))
            rest = (row for row in rows if row is not pivot)
            rows = _distinct_rows(_combined(ring, row, pivot, column) for row in rest)
            done = [*(_combined(ring, row, pivot, column) for row in done), pivot]
    return done


def _combined(ring: Ring, row: PolynomialRow, pivot: PolynomialRow, column: int) -> PolynomialRow:
    """Eliminate one column of a row by the pivot row, without fractions."""
    if column not in row:
        return row
    # pivot[c]/g row - row[c]/g pivot with the gcd g: without fractions, and with the least growth.
    common = row[column].gcd(pivot[column])
    by, off, zero = pivot[column] / common, row[column] / common, ring.constant(0)
    return _primitive(
        ring,
        {
            j: multiply(ring, by, row.get(j, zero)) - multiply(ring, off, pivot.get(j, zero))
            for j in row.keys() | pivot.keys()
            if j != column
        },
    )


_Function = tuple[sp.Expr, Exponents]
"""A fundamental function: its denominator, and the exponents of its numerator."""

_Table = dict[_Function, SparseRow]


@dataclass(frozen=True, eq=False)
class Column:
    """One column of the regressor and its type in the echelon form (13).

    `kind` is "zero" (the parameter has no effect), "base" (independent of the columns before it)
    or "dependent": R_column = sum of coefficient * R_base over `depends_on`, {base column's
    parameter: coefficient}.
    """

    parameter: sp.Expr
    kind: Literal["zero", "base", "dependent"]
    depends_on: Mapping[sp.Expr, sp.Expr] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class BaseForm(Display):
    """The base regressor form (14): zeta = regressor * parameters, with independent columns.

    Attributes
    ----------
    zeta : sympy matrix (n, 1)
    parameters : sympy matrix (p, 1)
        The base parameters theta_0, each with the parameters grouped to it.
    echelon : sympy matrix (p, m)
        B_Eu of (13), so that theta_0 = B_Eu theta.
    pivots : tuple of int
        The columns of R that make R_0.
    fundamental_functions : sympy matrix (k, 1)
        The linearly independent functions f of (11).
    columns : tuple of Column
        The type of each of the m columns of R.
    ratios : tuple of tuples of expressions
        Groups of base parameters that are identifiable only up to a common factor, because no
        equation in which they occur has a term without unknowns, as in J q'' + c q' + k q = 0.
    function_relations : tuple of pairs
        Dependent functions and what replaced them.
    different_rows : int
        Number of rows of B (12) that differ by more than a factor.
    form, rows
        The regressor form that was reduced; B as exact polynomials, `rows[i]` for equation i.
    """

    zeta: sp.ImmutableMatrix
    parameters: sp.ImmutableMatrix
    echelon: sp.ImmutableMatrix
    pivots: tuple[int, ...]
    fundamental_functions: sp.ImmutableMatrix
    columns: tuple[Column, ...]
    ratios: tuple[tuple[sp.Expr, ...], ...]
    function_relations: tuple[tuple[sp.Expr, sp.Expr], ...]
    different_rows: int
    form: RegressorForm = field(repr=False)
    rows: tuple[tuple[SparseRow, ...], ...] = field(repr=False)

    @cached_property
    def regressor(self) -> sp.ImmutableMatrix:
        """The base regressor R_0 (n, p), computed on first access."""
        return self.form.columns(self.pivots)

    @cached_property
    def B(self) -> sp.ImmutableSparseMatrix:
        """B (n k, m) of (12), R = kron(identity, f^T) B, computed on first access."""
        return _matrix(self.form.ring, list(chain(*self.rows)), len(self.columns))


def _matrix(ring: Ring, rows: Sequence[SparseRow], width: int) -> sp.ImmutableSparseMatrix:
    entries = {
        (i, j): ratio_to_sympy(ring, value)
        for i, row in enumerate(rows)
        for j, value in row.items()
    }
    return sp.ImmutableSparseMatrix(len(rows), width, entries)


def reduce(form: RegressorForm) -> BaseForm:
    """Reduce a regressor form to the base regressor form zeta = R_0 theta_0 of (14).

    R is written in linearly independent functions of the motion (11), whose coefficients are B
    (12). Gauss-Jordan elimination brings B to echelon form (13), with the leftmost possible columns
    as base. Functions whose independence is uncertain (tanh, roots, sign ... of one signal) are
    tested at random points with 200 digits; a dependence is removed and reported in a SeaidWarning.

    Parameters
    ----------
    form : RegressorForm
        The result of `separate`.

    Returns
    -------
    BaseForm

    Raises
    ------
    SymbolicError
        If no parameter is identifiable, or if functions depend on each other with factors that are
        not short rational numbers.

    Examples
    --------
    >>> form = separate(m * x.diff(t, 2) + (b + c) * x.diff(t) - F, [x, F], [m, b, c])
    >>> reduce(form).parameters
    Matrix([
    [    m],
    [b + c]])
    """
    if not isinstance(form, RegressorForm):
        raise SymbolicError(f"reduce takes the result of separate, found {type(form).__name__}")
    ring = form.ring
    # (11): every element of R is f^T b; a table has the b of one equation by function.
    tables = [_table(ring, row, form.monomials) for row in form.rows]
    functions = {motion for _, motion in chain(*tables)}
    replaced, relations = independent_functions(ring, functions)
    tables = [_replaced(ring, table, replaced) for table in tables]
    order = sorted(set(chain(*tables)), key=_function_key)
    # (12): the row of B of equation i and function f, empty where f is not in the equation.
    rows = tuple(tuple(table.get(f, {}) for f in order) for table in tables)
    width = len(form.monomials)
    echelon, pivots, different = eliminate(ring, chain(*rows), width)
    # In a closed loop functions that are independent in themselves depend on each other.
    if form.closures:
        echelon, pivots = base_columns(ring, order, rows, form.closures, width)
    if not pivots:
        raise SymbolicError(
            "no parameter is identifiable: the regressor is zero in every column, of "
            f"{', '.join(map(str, form.parameters))}; check equations and unknowns"
        )
    # (14): theta_0 = B_Eu theta.
    closed = sp.ImmutableMatrix(_matrix(ring, echelon, width))
    parameters = closed * form.parameters
    if not form.closures:
        _warn_of_cancelled(ring, different, pivots, parameters)
    return BaseForm(
        zeta=form.zeta,
        parameters=parameters,
        echelon=closed,
        pivots=pivots,
        fundamental_functions=sp.ImmutableMatrix([term_to_sympy(ring, f) / d for d, f in order]),
        columns=_column_types(form.parameters, closed, pivots),
        ratios=_ratios(form, rows, pivots, parameters),
        function_relations=relations,
        different_rows=len(different),
        form=form,
        rows=rows,
    )


_CANCELLED = 1e-7
"""A pivot below this share of its column is suspect: decimals of seven digits nearly cancel."""


def _warn_of_cancelled(
    ring: Ring, rows: Sequence[PolynomialRow], pivots: tuple[int, ...], parameters: sp.Matrix
) -> None:
    """Warn of base columns that are independent of those before them by rounded numbers only."""
    known = _random_knowns(ring)
    with mp.workdps(_DIGITS):
        table = [[_at(ring, row[j], known) if j in row else mpf(0) for j in pivots] for row in rows]
    H = np.array([[x / max(map(abs, row)) for x in row] for row in table if any(row)], dtype=float)
    # |R_ii| of unit columns: the part of a pivot column outside the span of those before it.
    remaining = np.abs(np.diag(np.linalg.qr(H / np.linalg.norm(H, axis=0), mode="r")))
    for place in np.flatnonzero(remaining < _CANCELLED):
        warnings.warn(
            f"{parameters[int(place)]} is identifiable only because numbers that nearly cancel do "
            f"not: its column differs from a combination of the columns before it by "
            f"{remaining[place]:.1g} of its size; write rounded numbers exactly, such as "
            "Rational(1, 3), sqrt(2) or pi",
            SeaidWarning,
            stacklevel=3,
        )


_DIGITS = 1000
"""Digits of a coefficient such as cos(500 x) in powers of cos x, whose terms cancel."""


def _random_knowns(ring: Ring) -> dict[sp.Symbol, sp.Rational]:
    """Return random values of the known symbols."""
    symbols = {s for i in ring.known for s in ring.generators[i].free_symbols}
    draw = random.Random(3)
    return {s: sp.Rational(draw.randint(500, 1500), 1009) for s in sorted(symbols, key=str)}


def _at(ring: Ring, polynomial: fmpq_mpoly, values: Mapping[sp.Symbol, sp.Rational]) -> mpf:
    number = to_sympy(ring, polynomial).subs(values)
    return mp.re(mp.mpmathify(number.evalf(_DIGITS)))


def _ratios(
    form: RegressorForm,
    rows: Sequence[Sequence[SparseRow]],
    pivots: tuple[int, ...],
    parameters: sp.Matrix,
) -> tuple[tuple[sp.Expr, ...], ...]:
    """Return the groups of base parameters whose equations all have zeta = 0."""
    members = [set(chain(*table)).intersection(pivots) for table in rows]
    nonzero = (group for group, zeta in zip(members, form.zeta, strict=True) if zeta != 0)
    fixed = set(chain(*nonzero))
    return tuple(
        tuple(parameters[i] for i, pivot in enumerate(pivots) if pivot in group)
        for group in connected(members)
        if group and group.isdisjoint(fixed)
    )


def _table(ring: Ring, row: Row, monomials: Sequence[Exponents]) -> _Table:
    """Return the block of B of one equation: {fundamental function: {column: coefficient}}."""
    entries = [(j, row[monomial]) for j, monomial in enumerate(monomials) if monomial in row]
    common = ring.constant(1)
    for _, entry in entries:
        common *= entry.denominator / common.gcd(entry.denominator)
    below = to_sympy(ring, common)
    table: _Table = {}
    for column, entry in entries:
        for motion, value in _terms_over(ring, entry, common).items():
            table.setdefault((below, motion), {})[column] = value
    return table


def _terms_over(ring: Ring, entry: Entry, common: fmpq_mpoly) -> Mapping[Exponents, Ratio]:
    """Return the terms of an element of R over the common denominator of its row."""
    if entry.denominator == common:
        return entry.terms
    unity = ring.constant(1)
    terms = (
        Ratio(value.numerator * ring.context.term(unity.coefficient(0), motion), value.denominator)
        for motion, value in entry.terms.items()
    )
    factor = from_polynomial(ring, common / entry.denominator)
    numerator, denominator = product(ring, total(ring, terms), factor)
    grouped = grouped_by_motion(ring, numerator)
    return {motion: ratio(ring, value, denominator) for motion, value in grouped.items()}


def _replaced(
    ring: Ring, table: _Table, replaced: Mapping[Exponents, Mapping[Exponents, fmpq]]
) -> _Table:
    """Rewrite a table in independent functions."""
    if not replaced:
        return table
    parts: dict[tuple[_Function, int], list[Ratio]] = defaultdict(list)
    for (below, motion), row in table.items():
        for independent, factor in replaced.get(motion, {motion: fmpq(1)}).items():
            for column, (numerator, denominator) in row.items():
                parts[(below, independent), column].append(Ratio(factor * numerator, denominator))
    result: _Table = defaultdict(dict)
    for (function, column), ratios in parts.items():
        value = total(ring, ratios)
        if not value.numerator.is_zero():
            result[function][column] = value
    return result


def _function_key(function: _Function) -> tuple[str, int, tuple[int, ...]]:
    """Return the sort key of the fundamental functions: degree, then order of the generators."""
    below, motion = function
    return str(below), sum(motion), tuple(-e for e in motion)


def _column_types(
    parameters: sp.ImmutableMatrix, echelon: sp.ImmutableMatrix, pivots: tuple[int, ...]
) -> tuple[Column, ...]:
    """Return the type of each column of (13)."""
    columns = []
    for j, parameter in enumerate(parameters):
        factors = {parameters[p]: echelon[i, j] for i, p in enumerate(pivots) if echelon[i, j] != 0}
        if j in pivots:
            columns.append(Column(parameter, "base"))
        else:
            columns.append(Column(parameter, "dependent" if factors else "zero", factors))
    return tuple(columns)
