"""Estimators by name, and the fit of rows by one of them, in memory or stored in a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, Union

from seaid._arrays import Array, FrozenMapping
from seaid.estimation.diagnostics import ModelChecks, model_checks, whiteness
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import (
    equal_weights,
    estimate_of,
    estimate_of_rows,
    ordinary,
    settled_weights,
    weighted,
)
from seaid.estimation.qr_factor import QRFactor, qr_factor_of
from seaid.estimation.robust import huber, tukey, without_outliers
from seaid.estimation.streaming import Change, StoredRows, stored_estimate

if TYPE_CHECKING:
    from seaid.regressor import Regression


def unweighted(rows: Regression, estimate: Estimate) -> Regression:
    """Return the rows as they are."""
    return rows


@dataclass(frozen=True)
class Estimator:
    """An estimator by its functions.

    `solve` estimates from rows and the propagated covariance; `weigh` gives the weights of the
    equations if a QR factor is sufficient; `effective_rows` returns the rows as the estimate
    weights them, for its checks.
    """

    solve: Callable[[Regression, Array | None], Estimate]
    weigh: Callable[[QRFactor], Array] | None = None
    effective_rows: Callable[[Regression, Estimate], Regression] = unweighted


LinearEstimator = Literal["ols", "wls", "huber", "tukey"]
"""Estimators of linear equations, which `ESTIMATORS` has."""

EstimatorName = Literal[LinearEstimator, "iv"]
"""Values of `estimator=`; "iv" is `instrumental`, which starts from the estimate of "wls"."""

ESTIMATORS: FrozenMapping[Estimator] = FrozenMapping(
    {
        "ols": Estimator(ordinary, equal_weights),
        "wls": Estimator(weighted, settled_weights),
        "huber": Estimator(huber, effective_rows=without_outliers),
        "tukey": Estimator(tukey, effective_rows=without_outliers),
    }
)


def estimator_named(name: LinearEstimator) -> Estimator:
    """Return an estimator by name."""
    return ESTIMATORS[name]


Rows = Union["Regression", StoredRows]
"""The rows of one equation or side: in memory, or stored in a file."""


@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate with its QR factor, and the rows as it weights them if they are in memory.

    `settled` are the converged weights (E,) of the equations, if the estimate has used them.
    """

    estimate: Estimate
    qr_factor: QRFactor
    rows: Regression | None
    propagated: Array | None
    settled: Array | None = None

    @cached_property
    def weights(self) -> Array:
        """The converged weights (E,) of the equations, for every estimator."""
        return settled_weights(self.qr_factor) if self.settled is None else self.settled

    @property
    def white_covariance(self) -> Array:
        """The covariance (p, p) for white noise in every equation."""
        return estimate_of(self.qr_factor, self.weights, None, self.propagated).covariance

    def checks(self, joints: Sequence[str], optional: Sequence[str]) -> ModelChecks:
        """Return the checks of the model; `joints` are those of the robot."""
        found = {} if self.rows is None else whiteness(self.rows, self.estimate.values)
        named = {joints[index % len(joints)]: one for index, one in found.items()}
        return model_checks(self.qr_factor, self.estimate, optional, named, self.weights)


def fit(
    rows: Rows,
    estimator: Estimator,
    propagated: Array | None = None,
    change: Change | None = None,
    check: Callable[[QRFactor], None] = lambda _: None,
) -> Fit:
    """Fit rows after `change`, with the covariance (s, s) of the propagated parameters.

    `check` may refuse the QR factor of the rows. Stored rows need an estimator that weights
    equations. Raises as `ordinary` does.
    """
    in_memory = None if isinstance(rows, StoredRows) else rows
    if in_memory is not None and change is not None:
        in_memory = change(in_memory)
    if estimator.weigh is None:
        assert in_memory is not None
        check(qr_factor_of(in_memory))
        estimate = estimator.solve(in_memory, propagated)
        weighted = estimator.effective_rows(in_memory, estimate)
        return Fit(estimate, qr_factor_of(weighted), weighted, propagated)
    weigh = estimator.weigh

    def checked(qr_factor: QRFactor) -> Array:
        check(qr_factor)
        return weigh(qr_factor)

    if isinstance(rows, StoredRows):
        estimate, qr_factor, weights = stored_estimate(rows, checked, propagated, change)
    else:
        assert in_memory is not None
        qr_factor = qr_factor_of(in_memory)
        weights = checked(qr_factor)
        estimate = estimate_of_rows(in_memory, qr_factor, weights, propagated)
    settled = weights if weigh is settled_weights else None
    return Fit(estimate, qr_factor, in_memory, propagated, settled)
