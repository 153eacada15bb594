"""Instrumental variables: estimates without the bias of least squares with noisy columns.

Measurement noise in a column of the regressor biases least squares towards zero (attenuation).
Instruments are similar columns whose noise is independent of the residual (Young 1970; Janot,
Vandanjon and Gautier 2014, who compute them by a simulation of the fitted model).

Of a spring from its measured torque by (4b), with noise in both torque and deflection, direct
regression gives too small a stiffness, reverse regression too large a one (Frisch 1934). Deming's
(1943) line between them weighs both errors by the ratio of their variances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from seaid._arrays import Array, FrozenMapping, finite, safely
from seaid.errors import IdentificationError
from seaid.estimation import least_squares
from seaid.estimation.estimate import Estimate
from seaid.estimation.qr_factor import RANK_TOLERANCE, ROUNDING, QRFactor, qr_factor_of, triangle

if TYPE_CHECKING:
    from seaid.regressor import Regression

_MOST_ROUNDS, _SETTLED = 50, 1e-8
"""Iterations for predicted columns at most, and the relative change at which they have settled."""

_safely = partial(safely, what="predicted currents", error=IdentificationError)


def instrumental(rows: Regression, instruments: Array, propagated: Array | None = None) -> Estimate:
    """Return theta = (Z^T W^2 H)^-1 Z^T W^2 y with instruments Z (R, p) and W that of `weighted`.

    It is computed in two stages, so that unidentifiable combinations raise the errors of
    `ordinary`: the columns are replaced by their projection on the instruments. The covariance is
    the sandwich of instrument times residual (Newey-West). A column with a small partial R^2 (Shea
    1997), which the diagnostics have, has an estimate that may still be biased, and an interval
    that may be too short. `propagated` as in `ordinary`. Raises IdentificationError for instruments
    of another shape, not finite, or zero.
    """
    qr_factor = qr_factor_of(rows)
    weights = least_squares.settled_weights(qr_factor)
    projected = replace(rows, H=_projected(rows, instruments, qr_factor, weights))
    solution = least_squares.solve(qr_factor_of(projected), weights)
    # the residual is that of the measured columns, not of their projections
    linear = replace(projected, y=rows.y - (rows.H - projected.H) @ solution.values)
    # Shea's (1997) partial R^2: variance by least squares over variance by instruments, without
    # the factor of the residual (Godfrey 1999)
    partial = np.diag(least_squares.solve(qr_factor, weights).inverse) / np.diag(solution.inverse)
    estimate = least_squares.estimate_of_rows(least_squares.factored(linear, propagated), weights)
    shares = FrozenMapping(dict(zip(rows.names, partial.tolist(), strict=True)), "parameter")
    return replace(estimate, diagnostics=replace(estimate.diagnostics, instruments=shares))


def projected_columns(rows: Regression, instruments: Array) -> Array:
    """Return the columns (R, p) by which least squares has the estimate of `instrumental`.

    They are the projections of the columns of rows on the instruments.
    """
    qr_factor = qr_factor_of(rows)
    return _projected(rows, instruments, qr_factor, least_squares.settled_weights(qr_factor))


def _projected(rows: Regression, instruments: Array, qr_factor: QRFactor, weights: Array) -> Array:
    """Return the projections of the columns of rows with these weights of their equations."""
    Z = finite("instruments", instruments, rows.H.shape, IdentificationError)
    if dead := [x for x, column in zip(rows.names, Z.T, strict=True) if not any(column)]:
        raise IdentificationError(
            f"the instruments of {', '.join(dead)} are zero: these joints do not move in the "
            "motion from which the instruments are computed"
        )
    weight = weights[np.searchsorted(qr_factor.equations, rows.joint)][:, None]
    return np.asarray(Z @ _first_stage(weight * Z, weight * rows.H, rows.names))


def unattenuated(
    qr_factor: QRFactor, weights: Array, noisy: Sequence[int], reweigh: bool
) -> Array | None:
    """Return the estimate (p,) if the noise of an equation is that of one of its columns.

    Of y + noise of c k = H theta, with a logged current in the column c and its unknown torque
    constant k, least squares makes k too small (attenuation). Maximum likelihood minimises the
    residual r over k: n log |r| - n log k, whose derivative is zero where r is orthogonal to all
    other columns and to c + r / k, the current that the model predicts. These are instruments, and
    the solution is iterated. `noisy` are the places of such columns. With `reweigh` the `weights`
    (E,) of the equations follow the residuals. None if it does not converge: the columns are mostly
    noise.
    """
    R, p = qr_factor.factors, len(qr_factor.names)
    theta = first = least_squares.solve(qr_factor, weights).values
    for _ in range(_MOST_ROUNDS):
        # The equations have products of columns only, which the rows of R give as all rows do.
        Z = predicted_columns(R[:, :, :p], R @ np.append(-theta, 1.0), theta, noisy)
        stacked = [
            (weights[:, None, None] * part).reshape(-1, part.shape[2])
            for part in (Z, R[:, :, :p], R[:, :, p:])
        ]
        scale = np.maximum(np.linalg.norm(stacked[1], axis=0), np.finfo(float).tiny)
        Q = _safely(np.linalg.qr, stacked[0] / scale)[0]
        # With Z = Q R, Q^T H theta = Q^T y has the solution of Z^T H theta = Z^T y, better
        # conditioned.
        inner, right = Q.T @ (stacked[1] / scale), (Q.T @ stacked[2])[:, 0]
        if _safely(np.linalg.cond, inner) > 1 / RANK_TOLERANCE:
            return None
        before, theta = theta, _safely(np.linalg.solve, inner, right) / scale
        # c + r / k has a pole at k = 0: beyond it the iteration is at another solution.
        if not np.all(theta[list(noisy)] * first[list(noisy)] > 0):
            return None
        weights = least_squares.weights_at(qr_factor, theta) if reweigh else weights
        if np.all(np.abs(theta - before) * scale < _SETTLED * np.linalg.norm(theta * scale)):
            return np.asarray(theta)
    return None


def predicted_columns(H: Array, residual: Array, theta: Array, noisy: Sequence[int]) -> Array:
    """Return columns (E, m, p) with those that are `noisy` as the fit predicts them, c + r / k.

    `residual` (E, m) is y - H theta; only equations that have such a column are changed.
    """
    predicted = H.copy()
    for place in noisy:
        equations = np.any(H[:, :, place] != 0, axis=1)
        predicted[equations, :, place] += residual[equations] / theta[place]
    return predicted


def with_predicted_columns(rows: Regression, theta: Array, noisy: Sequence[int]) -> Regression:
    """Return rows whose least-squares estimate and residual are those of `unattenuated`."""
    residual, H = rows.y - rows.H @ theta, rows.H.copy()
    for equation in np.unique(rows.joint):
        part = np.flatnonzero(rows.joint == equation)
        H[part] = predicted_columns(rows.H[part][None], residual[part][None], theta, noisy)[0]
    # y' - H' theta = y - H theta: the residual stays that of the measured columns.
    return replace(rows, H=H, y=rows.y + (H - rows.H) @ theta)


def deflection_instruments(rows: Regression, ratio: float) -> Array:
    """Return instruments for stiffness and offset from (4b) with noise in column and torque.

    `ratio` is the noise variance of the torque over that of the deflection. The deflection
    estimated from both measurements is the instrument of the measured one.
    """
    # What the offset explains is projected out of both: `deming` needs values without a mean.
    column = rows.names.index("stiffness")
    others = np.delete(rows.H, column, axis=1)
    d, tau = (
        values
        - others
        @ safely(np.linalg.lstsq, others, values, what="the torque of a spring", rcond=None)[0]
        for values in (rows.H[:, column], rows.y)
    )
    stiffness = deming(d, tau, ratio)
    instruments = rows.H.copy()
    # With an infinite ratio the deflection has no noise, and is its own instrument.
    if np.isfinite(ratio):
        # the best estimate of the true deflection from both measurements (Deming 1943)
        deflection = (ratio * d + stiffness * tau) / (ratio + stiffness**2)
        instruments[:, column] += deflection - d
    return instruments


def deming(x: Array, y: Array, ratio: float) -> float:
    """Return the slope of y on x, both without mean; `ratio` is the noise variance of y over x.

    It is (yy - r xx + sqrt((yy - r xx)^2 + 4 r xy^2)) / (2 xy) (Deming 1943).
    """
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xy == 0:
        return 0.0
    if not np.isfinite(ratio):
        return xy / xx
    # The numerator is positive, so that the slope has the sign of xy; the other root fits worst.
    half = 0.5 * (yy - ratio * xx)
    root = float(np.hypot(half, np.sqrt(ratio) * xy))
    # a + sqrt(a^2 + b) = b / (sqrt(a^2 + b) - a), which does not cancel for a < 0.
    return (half + root) / xy if half > 0 else ratio * xy / (root - half)


def _first_stage(Z: Array, H: Array, names: tuple[str, ...]) -> Array:
    """Return the coefficients (p, p) of the regression of the columns of H on those of Z."""
    p, norms = len(names), np.linalg.norm(Z, axis=0)
    # The triangle of [Z H] has the same regression of H on Z, in p rows.
    R = triangle(np.hstack([Z / norms, H]))
    coefficients, _, rank, _ = safely(
        linalg.lstsq, R[:p, :p], R[:p, p:], what="the instruments", cond=ROUNDING
    )
    if rank < p:
        raise IdentificationError(
            f"the instruments identify only {rank} of {p} parameters: the motion from which they "
            "are computed is too smooth; raise cutoff_hz, or use estimator='wls'",
            "estimator='wls'",
        )
    return np.asarray(coefficients / norms[:, None])
