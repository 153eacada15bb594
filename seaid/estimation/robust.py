"""Robust estimators: Huber's and Tukey's M-estimates.

M-estimates (Huber 1964; Beaton and Tukey 1974) give outliers such as spikes and saturated rows a
smaller weight, by iteratively reweighted least squares. The scale of each equation is the median
absolute residual, which tolerates outliers in up to half of the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid.errors import IdentificationError
from seaid.estimation.covariance import long_run_of
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import equal_weights, estimate_of, estimate_of_rows, solve
from seaid.estimation.qr_factor import qr_factor_of

if TYPE_CHECKING:
    from seaid.regressor import Regression

HUBER = 1.345
"""Scaled residual above which Huber's weight falls: 95 % efficient for Gaussian noise."""

TUKEY = 4.685
"""Scaled residual above which Tukey's weight is zero: 95 % efficient for Gaussian noise."""

_GAUSSIAN = 1.4826
"""Standard deviation of Gaussian noise over the median of its absolute values."""

_MOST_ITERATIONS = 500
_SETTLED = 1e-6
_EXACT = 1e-10

Weighing = Callable[[Array], Array]


def huber(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return Huber's M-estimate, with the weight of a row clipped above 1.345 scales.

    Scale and estimate are iterated together from ordinary least squares. The covariance is the
    sandwich with autocorrelated scores (Newey-West); `residual_std` is the scale, without the
    outliers. `propagated` and the errors as in `ordinary`; also raises IdentificationError if the
    iteration does not converge.
    """
    theta, scales = _huber(rows)
    return _estimate(rows, theta, scales, huber_weights, propagated)


def tukey(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return Tukey's bisquare M-estimate (zero weight above 4.685 scales), from Huber's."""
    start, scales = _huber(rows)
    theta, _ = _iterated(rows, start, lambda _: scales, tukey_weights)
    return _estimate(rows, theta, scales, tukey_weights, propagated)


def without_outliers(rows: Regression, estimate: Estimate) -> Regression:
    """Return the rows times the square root of their Tukey weight, for checks of the estimate."""
    residual = rows.y - rows.H @ estimate.values
    return _scaled(rows, np.sqrt(tukey_weights(residual / _scales(rows, residual))))


def huber_weights(u: Array) -> Array:
    """Return the weights psi(u)/u of Huber's psi for scaled residuals u (R,)."""
    return np.asarray(HUBER / np.maximum(np.abs(u), HUBER))


def tukey_weights(u: Array) -> Array:
    """Return the weights psi(u)/u of Tukey's bisquare for scaled residuals u (R,)."""
    return np.asarray(np.maximum(1 - (u / TUKEY) ** 2, 0.0) ** 2)


def _huber(rows: Regression) -> tuple[Array, Array]:
    """Return Huber's parameters (p,) and the scale of each row (R,)."""
    qr_factor = qr_factor_of(rows)
    start = solve(qr_factor, equal_weights(qr_factor)).values
    return _iterated(rows, start, lambda residual: _scales(rows, residual), huber_weights)


def _iterated(
    rows: Regression, theta: Array, scales_of: Callable[[Array], Array], weigh: Weighing
) -> tuple[Array, Array]:
    """Return the parameters (p,) and scales (R,) at which the reweighting converges."""
    size = float(np.sqrt(np.mean(rows.y**2)))
    for _ in range(_MOST_ITERATIONS):
        residual = rows.y - rows.H @ theta
        scales = scales_of(residual)
        qr_factor = qr_factor_of(_scaled(rows, np.sqrt(weigh(residual / scales)) / scales))
        new = solve(qr_factor, equal_weights(qr_factor)).values
        moved = np.abs(rows.H @ (new - theta))
        theta = new
        if np.all(moved <= np.maximum(_SETTLED * scales, _EXACT * size)):
            return theta, scales
    worst = int(np.argmax(moved / scales))
    raise IdentificationError(
        f"the weights of the rows did not converge in {_MOST_ITERATIONS} iterations: at "
        f"{rows.time[worst]:.3g} s the fit still changes by {moved[worst] / scales[worst]:.1e} of "
        "the residual's scale; record a longer log, or use estimator='wls'",
        "estimator='wls'",
    )


def _estimate(
    rows: Regression, theta: Array, scales: Array, weigh: Weighing, propagated: Array | None
) -> Estimate:
    """Return the estimate with its sandwich covariance at converged parameters.

    Linearised there, an M-estimate is least squares with weights w(u) s / scale^2, where s is the
    mean of psi'(u) over that of w(u), and residuals enlarged by 1 / s so that the scores are psi(u)
    (Huber 1973).
    """
    residual = rows.y - rows.H @ theta
    u = residual / scales
    weights, step = weigh(u), 1e-6
    derivative = (weigh(u + step) * (u + step) - weigh(u - step) * (u - step)) / (2 * step)  # psi'
    slope = np.empty_like(u)
    for mine in _equations(rows):  # positive: half of the rows are within 0.67 scales
        slope[mine] = np.sum(derivative[mine]) / np.sum(weights[mine])
    root = np.sqrt(weights * slope) / scales
    linear = _scaled(replace(rows, y=rows.H @ theta + residual / slope), root)
    scores = long_run_of(linear.H, linear.y - linear.H @ theta, rows.time, rows.run)
    qr_factor = qr_factor_of(linear)
    one = equal_weights(qr_factor)
    estimate = estimate_of_rows(linear, qr_factor, one, propagated)
    independent = replace(scores, covariance=scores.white, lags=0)
    white = estimate_of(qr_factor, one, independent, propagated)
    return replace(
        estimate,
        residual_std=float(np.sqrt(np.mean(scales**2))),
        white_standard_errors=white.standard_errors,
    )


def _scaled(rows: Regression, factor: Array) -> Regression:
    """Return the rows, each times its `factor` (R,)."""
    column = factor[:, None]
    return replace(rows, H=column * rows.H, y=factor * rows.y, propagated=column * rows.propagated)


def _scales(rows: Regression, residual: Array) -> Array:
    """Return the scale (R,) of each row's equation: a standard deviation for Gaussian noise."""
    scales = np.empty_like(residual)
    smallest = 1e-9 * float(np.sqrt(np.mean(rows.y**2))) or 1.0
    for mine in _equations(rows):
        scales[mine] = max(_GAUSSIAN * float(np.median(np.abs(residual[mine]))), smallest)
    return scales


def _equations(rows: Regression) -> Iterator[BoolArray]:
    """Yield the mask (R,) of the rows of each equation."""
    for index in np.unique(rows.joint).astype(int):
        yield rows.joint == index
