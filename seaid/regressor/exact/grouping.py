"""Exact base parameters: the echelon form, left to right, as rationals."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq, fmpq_mat

from seaid._arrays import frozen
from seaid.regressor.base import BaseParameters, combination_text, rational_text
from seaid.regressor.exact.geometry import number

SparseRow = dict[int, fmpq]
"""{column: value}, without zeros."""


@dataclass(frozen=True, eq=False)
class ExactBaseParameters(BaseParameters):
    """Base parameters over the rationals. Fields as in BaseParameters, with an infinite `gap`.

    Attributes
    ----------
    rank : int
        Rank over the rationals.
    exact_rows : tuple of p mappings {column: Fraction}
        The grouping, to which `grouping` has the nearest doubles.
    """

    rank: int
    exact_rows: tuple[Mapping[int, Fraction], ...] = field(repr=False)


def packed(echelon: Sequence[SparseRow], names: Sequence[str]) -> ExactBaseParameters:
    """Return the base parameters of an echelon form, one per row."""
    rows = tuple(
        {j: Fraction(int(x.p), int(x.q)) for j, x in sorted(row.items())} for row in echelon
    )
    grouping = np.zeros((len(rows), len(names)))
    for i, row in enumerate(echelon):
        for j, x in row.items():
            grouping[i, j] = number(x)
    columns = tuple(min(row) for row in rows)
    return ExactBaseParameters(
        columns=columns,
        names=tuple(names[column] for column in columns),
        expressions=tuple(
            combination_text(x.values(), [names[j] for j in x], rational_text) for x in rows
        ),
        grouping=frozen("grouping", grouping, (None, None)),
        gap=float("inf"),
        rank=len(rows),
        exact_rows=rows,
    )


def from_null_space(nulls: Iterable[SparseRow], width: int) -> list[SparseRow]:
    """Return the echelon form whose null space is spanned by the given rows.

    The last column of each row depends on the columns before it, with the row's coefficients.
    """
    dependent: dict[int, SparseRow] = {}
    for null in nulls:
        # The last column is the pivot: a parameter depends on those before it, so that the base
        # columns are the leftmost ones, as in B_E of (13).
        row = dict(null)
        for column in row.keys() & dependent.keys():
            subtract(row, row[column], dependent[column])
        last = max(row)
        row = {j: x / row[last] for j, x in row.items()}
        for earlier in dependent.values():
            if last in earlier:
                subtract(earlier, earlier[last], row)
        dependent[last] = row
    # H null = 0 with 1 in `column`: H_column = -sum x_j H_j over the columns j before it.
    echelon = {j: {j: fmpq(1)} for j in range(width)}
    for column, row in dependent.items():
        del echelon[column], row[column]
        for j, x in row.items():
            echelon[j][column] = -x
    return list(echelon.values())


def subtract(row: dict[Any, fmpq], factor: fmpq, pivot_row: Mapping[Any, fmpq]) -> None:
    """Subtract factor * pivot_row from a row, without keeping zeros."""
    for j, x in pivot_row.items():
        value = row.get(j, 0) - factor * x
        if value == 0:
            row.pop(j, None)
        else:
            row[j] = value


def from_rows(
    rows: Sequence[SparseRow], width: int, without: Collection[int] = ()
) -> list[SparseRow]:
    """Return the echelon form of rows, without the columns of known parameters."""
    matrix = fmpq_mat(len(rows), width)
    for i, row in enumerate(rows):
        for j, x in row.items():
            matrix[i, j] = 0 if j in without else x
    echelon, rank = matrix.rref()
    return [{j: x for j, x in enumerate(row) if x != 0} for row in echelon.tolist()[:rank]]
