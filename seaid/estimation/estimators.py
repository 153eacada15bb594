"""The estimators by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from seaid.arrays import Array, FrozenMapping
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.estimate import Estimate
from seaid.estimation.information import Information
from seaid.estimation.robust import huber, tukey
from seaid.estimation.solve import equal_weights, ordinary, settled_weights, weighted
from seaid.regression import Regression


@dataclass(frozen=True)
class Estimator:
    """`solve` estimates from rows; `weigh` gives equations' weights where R factors are enough."""

    solve: Callable[[Regression, Array | None], Estimate]
    weigh: Callable[[Information], Array] | None = None


ESTIMATORS = FrozenMapping(
    {
        "ols": Estimator(ordinary, equal_weights),
        "wls": Estimator(weighted, settled_weights),
        "huber": Estimator(huber),
        "tukey": Estimator(tukey),
    }
)


def estimator_named(name: str) -> Estimator:
    """Return an estimator. Raises IdentificationError with the nearest name."""
    if name not in ESTIMATORS:
        raise IdentificationError("estimator=: " + unknown_name("estimator", name, ESTIMATORS))
    return ESTIMATORS[name]
