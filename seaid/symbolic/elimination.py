"""Gauss-Jordan elimination of (13), exact: over the rationals, or over quotients of polynomials."""

from __future__ import annotations

from collections.abc import Iterable

from flint import fmpq_mat, fmpq_mpoly

from seaid.symbolic.polynomial import Ratio, Ring, multiply, ratio

SparseRow = dict[int, Ratio]
_Row = dict[int, fmpq_mpoly]


def eliminate(
    ring: Ring, rows: Iterable[SparseRow], width: int
) -> tuple[list[SparseRow], tuple[int, ...], int]:
    """Return the nonzero rows of the echelon form, their pivots, and how many rows differed.

    `rows` are sparse, {column: value}, of `width` columns; the pivots are the leftmost possible.
    Rows that differ by a factor only are counted and used once.
    """
    different = _different(_primitive(ring, _cleared(ring, row)) for row in rows)
    if all(value.is_constant() for row in different for value in row.values()):
        echelon = _rational(ring, different, width)
    else:
        echelon = _back_substituted(ring, _triangular(ring, different, width))
    pivots = tuple(min(row) for row in echelon)
    scaled = [
        {column: ratio(ring, value, row[pivot]) for column, value in row.items()}
        for row, pivot in zip(echelon, pivots, strict=True)
    ]
    return scaled, pivots, len(different)


def _cleared(ring: Ring, row: SparseRow) -> _Row:
    """Multiply a row by its denominators."""
    common = ring.constant(1)
    for _, denominator in row.values():
        if not denominator.is_one():
            common = multiply(ring, common, denominator / common.gcd(denominator))
    return {
        column: multiply(ring, numerator, common / denominator)
        for column, (numerator, denominator) in row.items()
    }


def _primitive(ring: Ring, row: _Row) -> _Row:
    """Divide a row by its common factor, so that multiples of a row become equal."""
    row = {column: value for column, value in sorted(row.items()) if not value.is_zero()}
    if not row:
        return row
    common = ring.constant(0)
    for value in row.values():
        common = common.gcd(value)
        if common.is_one():
            break
    common *= row[min(row)].leading_coefficient() / common.leading_coefficient()
    return {column: value / common for column, value in row.items()}


def _different(rows: Iterable[_Row]) -> list[_Row]:
    found = {tuple((column, str(value)) for column, value in row.items()): row for row in rows}
    found.pop((), None)
    return list(found.values())


def _rational(ring: Ring, rows: list[_Row], width: int) -> list[_Row]:
    """Echelon form of rows of numbers."""
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


def _triangular(ring: Ring, rows: list[_Row], width: int) -> list[_Row]:
    done = []
    for column in range(width):
        holders = [row for row in rows if column in row]
        if not holders:
            continue
        pivot = min(holders, key=lambda row: (sum(map(len, row.values())), str(row)))
        done.append(pivot)
        rest = [row for row in rows if column not in row]
        combined = (_combined(ring, row, pivot, column) for row in holders if row is not pivot)
        rows = _different([*rest, *combined])
    return done


def _back_substituted(ring: Ring, rows: list[_Row]) -> list[_Row]:
    rows = list(rows)
    for place in reversed(range(len(rows))):
        column = min(rows[place])
        for above in range(place):
            if column in rows[above]:
                rows[above] = _combined(ring, rows[above], rows[place], column)
    return rows


def _combined(ring: Ring, row: _Row, pivot: _Row, column: int) -> _Row:
    """Remove one column of a row by a multiple of the pivot row, without fractions."""
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
