"""Instrumental variables: estimates without the bias of least squares with noisy columns.

Measurement noise in a column of the regressor biases least squares towards zero (attenuation).
Instruments are similar columns whose noise is independent of the residual (Young 1970; Janot,
Vandanjon and Gautier 2014, who compute them by a simulation of the fitted model).

Of a spring from its measured torque by (4b), with noise in both torque and deflection, direct
regression gives too small a stiffness, reverse regression too large a one (Frisch 1934). Deming's
(1943) line between them weighs both errors by the ratio of their variances.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from seaid._arrays import Array, finite, safely
from seaid.errors import Finding, IdentificationError
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import estimate_of_rows, settled_weights, solve
from seaid.estimation.qr_factor import ROUNDING, qr_factor_of, triangle

if TYPE_CHECKING:
    from seaid.regressor import Regression

WEAK = 0.1
"""Partial R^2 of a column with its instruments below which the instruments are flagged as weak."""


def instrumental(rows: Regression, instruments: Array, propagated: Array | None = None) -> Estimate:
    """Return theta = (Z^T W^2 H)^-1 Z^T W^2 y with instruments Z (R, p) and W that of `weighted`.

    It is computed in two stages, so that unidentifiable combinations raise the errors of
    `ordinary`: the columns are replaced by their projection on the instruments. The covariance is
    the sandwich of instrument times residual (Newey-West). A column with a small partial R^2 (Shea
    1997) is flagged: its estimate may still be biased, and its interval too short. `propagated` as
    in `ordinary`. Raises IdentificationError for instruments of another shape, not finite, or zero.
    """
    Z = finite("instruments", _checked(rows, instruments), rows.H.shape, IdentificationError)
    qr_factor = qr_factor_of(rows)
    weights = settled_weights(qr_factor)
    weight = weights[np.searchsorted(qr_factor.equations, rows.joint)][:, None]
    first_stage = _first_stage(weight * Z, weight * rows.H, rows.names)
    projected = replace(rows, H=Z @ first_stage)
    solution = solve(qr_factor_of(projected), weights)
    # the residual is that of the measured columns, not of their projections
    linear = replace(projected, y=rows.y - (rows.H - projected.H) @ solution.values)
    of_linear = qr_factor_of(linear)
    # Shea's (1997) partial R^2: variance by least squares over variance by instruments, without
    # the factor of the residual (Godfrey 1999)
    partial = np.diag(solve(qr_factor, weights).inverse) / np.diag(solution.inverse)
    warnings = tuple(
        Finding(
            "weak-instruments",
            f"the instruments of {name} are weak (partial R^2 {share:.1%}): its value may be as "
            "biased as that of least squares",
            evidence={"partial R^2": float(share)},
        )
        for name, share in zip(rows.names, partial, strict=True)
        if share < WEAK
    )
    estimate = estimate_of_rows(linear, of_linear, weights, propagated)
    return replace(estimate, warnings=(*estimate.warnings, *warnings))


def errors_in_variables(rows: Regression, ratio: float) -> Estimate:
    """Return stiffness and offset from rows of (4b) with noise in column and torque.

    `ratio` is the noise variance of the torque over that of the deflection. It is least squares
    with the deflection estimated from both measurements as the instrument of the measured one.
    """
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
    if np.isfinite(ratio):
        # the best estimate of the true deflection from both measurements (Deming 1943)
        deflection = (ratio * d + stiffness * tau) / (ratio + stiffness**2)
        instruments[:, column] += deflection - d
    return instrumental(rows, instruments)


def deming(x: Array, y: Array, ratio: float) -> float:
    """Return the slope of y on x, both without mean; `ratio` is the noise variance of y over x.

    It is (yy - r xx + sqrt((yy - r xx)^2 + 4 r xy^2)) / (2 xy) (Deming 1943).
    """
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xy == 0:
        return 0.0
    if not np.isfinite(ratio):
        return xy / xx
    half = 0.5 * (yy - ratio * xx)
    return float((half + np.sqrt(half**2 + ratio * xy**2)) / xy)


def _checked(rows: Regression, instruments: Array) -> Array:
    if np.shape(instruments) != rows.H.shape:
        raise IdentificationError(
            f"instruments must have a column for each of the {rows.H.shape[1]} parameters and the "
            f"{rows.H.shape[0]} rows of the regression, found shape {np.shape(instruments)}"
        )
    dead = [name for name, column in zip(rows.names, instruments.T, strict=True) if not any(column)]
    if dead:
        raise IdentificationError(
            f"the instruments of {', '.join(dead)} are zero: these joints do not move in the "
            "motion from which the instruments are computed"
        )
    return instruments


def _first_stage(Z: Array, H: Array, names: tuple[str, ...]) -> Array:
    """Return the coefficients (p, p) of the regression of the columns of H on those of Z."""
    p, norms = len(names), np.linalg.norm(Z, axis=0)
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
