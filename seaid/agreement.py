"""The agreement of two ways to base parameters, as numbers: numeric by QR, and exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seaid.base import BaseParameters
from seaid.errors import SeaidError

AGREEMENT = 1e-9
"""The largest difference of groupings that rounding explains."""


@dataclass(frozen=True)
class CrossCheck:
    """What numeric and exact base parameters have in common.

    `same_columns` is true for the same base columns; then `max_difference` is the largest
    difference of the grouping matrices, each base parameter's divided by its largest coefficient
    (which is at least 1), else infinite. `gap` is the numeric rank decision's. `agree` is true for
    the same columns and a difference below 1e-9. `counts` are the numeric and the exact number of
    base parameters.
    """

    agree: bool
    same_columns: bool
    max_difference: float
    gap: float
    counts: tuple[int, int]


def cross_check(numeric: BaseParameters, exact: BaseParameters) -> CrossCheck:
    """Compare the numeric base parameters of a robot with its exact ones.

    Raises SeaidError where both do not belong to the same number of standard parameters.
    """
    widths = numeric.grouping.shape[1], exact.grouping.shape[1]
    if widths[0] != widths[1]:
        raise SeaidError(
            f"cross_check compares base parameters of one robot, found {widths[0]} and {widths[1]} "
            "standard parameters; make both from the same Robot"
        )
    same = numeric.columns == exact.columns
    difference = float("inf")
    if same:
        largest = np.max(np.abs(exact.grouping), axis=1, initial=1.0)
        apart = np.abs(numeric.grouping - exact.grouping) / largest[:, None]
        difference = float(np.max(apart, initial=0.0))
    return CrossCheck(
        agree=same and difference < AGREEMENT,
        same_columns=same,
        max_difference=difference,
        gap=numeric.gap,
        counts=(len(numeric.columns), len(exact.columns)),
    )
