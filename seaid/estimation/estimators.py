"""The estimators by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from seaid.arrays import Array, FrozenMapping
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.estimate import Estimate
from seaid.estimation.information import Information
from seaid.estimation.robust import huber, tukey, without_outliers
from seaid.estimation.solve import equal_weights, ordinary, settled_weights, weighted
from seaid.regression import Regression


def all_alike(rows: Regression, estimate: Estimate) -> Regression:
    """Return the rows as they are: an estimate that sees all of them."""
    return rows


@dataclass(frozen=True)
class Estimator:
    """`solve` estimates from rows; `weigh` gives equations' weights where R factors are enough.

    `seen` returns the rows as the estimate sees them, for the checks of it.
    """

    solve: Callable[[Regression, Array | None], Estimate]
    weigh: Callable[[Information], Array] | None = None
    seen: Callable[[Regression, Estimate], Regression] = all_alike


ESTIMATORS = FrozenMapping(
    {
        "ols": Estimator(ordinary, equal_weights),
        "wls": Estimator(weighted, settled_weights),
        "huber": Estimator(huber, seen=without_outliers),
        "tukey": Estimator(tukey, seen=without_outliers),
    }
)


def estimator_named(name: str) -> Estimator:
    """Return an estimator. Raises IdentificationError with the nearest name."""
    if name not in ESTIMATORS:
        raise IdentificationError(
            "estimator=: " + unknown_name("estimator", name, [*ESTIMATORS, "iv"])
        )
    return ESTIMATORS[name]
