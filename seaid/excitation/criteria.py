"""How much a motion tells, from the triangular factor R of its stacked regressor (15).

Each criterion is a number to make small and its slope: a symmetric matrix S (p, p) with which a
change dH of the regressor changes the number by the sum of (H S) * dH. Where the best motions lie
the plain criteria have kinks, so a search uses smooth ones: maxima over several singular values or
parameters (Kreisselmeier and Steinhauser 1979), at most log(several) / 32 above the plain one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import solve_triangular

from seaid.arrays import Array
from seaid.errors import ExcitationError, unknown_name
from seaid.linear_algebra import safely

_safely = partial(safely, what="the regressor of the motion", error=ExcitationError)

_WORST = 1e12
"""A condition number above this is rounding: the motion does not tell all parameters."""

_SHARPNESS, _NEIGHBOURS = 32.0, 4


@dataclass(frozen=True)
class Criterion:
    """A number to make small, as its logarithm.

    `log_value(R)` is what is reported and what motions are compared by; `smooth(R)` returns what a
    search descends, with its slope S. Both need an R that `tells_all`. `meaning` is a noun.
    """

    meaning: str
    log_value: Callable[[Array], float]
    smooth: Callable[[Array], tuple[float, Array]]
    needs_nominal: bool = False


def criterion_named(name: str) -> Criterion:
    """Return the criterion of a name. Raises ExcitationError with the nearest name."""
    if name not in CRITERIA:
        raise ExcitationError(unknown_name("criterion", name, tuple(CRITERIA)))
    return CRITERIA[name]


def triangular_factor(H: Array, known: Array) -> Array:
    """Return R (p, p) with R^T R = H^T H + known^T known."""
    return np.asarray(np.linalg.qr(np.vstack([known, H]), mode="r"))


def singular_values(R: Array) -> Array:
    """Return the singular values of a triangular factor, largest first."""
    return np.asarray(_safely(np.linalg.svd, R, compute_uv=False), dtype=np.float64)


def tells_all(R: Array) -> bool:
    """Tell whether all columns can be told apart, rounding aside."""
    singular = singular_values(R)
    return bool(R.shape[0] == R.shape[1] and singular[-1] > singular[0] / _WORST)


def _log_condition(R: Array) -> float:
    singular = singular_values(R)
    return float(np.log(singular[0] / singular[-1]))


def _smooth_condition(R: Array) -> tuple[float, Array]:
    """Log of (16) by the largest and smallest few: d log sigma = u^T dH v / sigma = (H v)^T..."""
    _, singular, right = _safely(np.linalg.svd, R)
    value, slope = 0.0, np.zeros_like(R)
    for sign, picked in ((1.0, slice(None, _NEIGHBOURS)), (-1.0, slice(-_NEIGHBOURS, None))):
        part, shares = _smooth_maximum(sign * np.log(singular[picked]))
        value += part
        slope += (right[picked].T * (sign * shares / singular[picked] ** 2)) @ right[picked]
    return value, slope


def _log_mean_error(R: Array) -> float:
    """Return -log det(H^T H) / 2p: the log of the geometric mean of the axes of uncertainty."""
    return float(-np.mean(np.log(np.abs(np.diag(R)))))


def _smooth_mean_error(R: Array) -> tuple[float, Array]:
    inverse = _inverse(R)
    return _log_mean_error(R), -(inverse @ inverse.T) / len(R)


def _log_worst_error(R: Array) -> float:
    """Return the log of the largest standard error, of columns scaled by their parameters."""
    return float(np.log(np.linalg.norm(_inverse(R), axis=1).max()))


def _smooth_worst_error(R: Array) -> tuple[float, Array]:
    inverse = _inverse(R)
    covariance, errors = inverse @ inverse.T, np.linalg.norm(inverse, axis=1)
    value, shares = _smooth_maximum(np.log(errors))
    return value, -(covariance * (shares / errors**2)) @ covariance


def _inverse(R: Array) -> Array:
    return np.asarray(_safely(solve_triangular, R, np.eye(len(R)), check_finite=False))


def _smooth_maximum(values: Array) -> tuple[float, Array]:
    """Return a smooth maximum of values (k,) and its derivative by each."""
    shares = np.exp(_SHARPNESS * (values - values.max()))
    total = float(shares.sum())
    return float(values.max()) + np.log(total) / _SHARPNESS, shares / total


CRITERIA = {
    "condition_number": Criterion("condition number", _log_condition, _smooth_condition),
    "d_optimality": Criterion("mean standard error", _log_mean_error, _smooth_mean_error),
    "relative_error": Criterion(
        "worst relative standard error", _log_worst_error, _smooth_worst_error, needs_nominal=True
    ),
}
"""(16); D-optimality (Fedorov 1972), as the geometric mean of the standard errors along the axes of
uncertainty; and the largest expected standard error over the size of its parameter."""
