"""Instrumental variables: least squares that noise in the regressor does not bias.

What is measured with noise stands in the columns too, and pulls least squares towards zero.
Instruments are columns like them whose noise has nothing in common with the residual (Young 1970;
Janot, Vandanjon and Gautier 2014, who take them from a simulation of the fitted model).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import linalg

from seaid._arrays import Array, finite, safely
from seaid.errors import IdentificationError
from seaid.estimation.covariance import long_run_of
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import estimate_of, score_factors, settled_weights, solve
from seaid.estimation.qr_factor import qr_factor_of, triangle
from seaid.regressor import Regression

WEAK = 0.1
"""Partial R^2 of a column with its instruments below which the estimate says so."""

_LOST = 1e-10


def instrumental(rows: Regression, instruments: Array, propagated: Array | None = None) -> Estimate:
    """Return theta = (Z^T W^2 H)^-1 Z^T W^2 y with instruments Z (R, p) and W that of `weighted`.

    Computed in two stages, so that the errors for lost combinations are those of `ordinary`: the
    columns are replaced by what the instruments tell of them. Covariance: the sandwich of
    instrument times residual, Newey-West. A column of which the instruments tell little beside the
    others (partial R^2 of Shea 1997) is flagged: its estimate is then biased after all, and its
    interval too short. `propagated` as in `ordinary`. Raises IdentificationError for instruments of
    another shape, not finite, or zero.
    """
    Z = finite("instruments", _checked(rows, instruments), rows.H.shape, IdentificationError)
    qr_factor = qr_factor_of(rows)
    weights = settled_weights(qr_factor)
    weight = weights[np.searchsorted(qr_factor.equations, rows.joint)][:, None]
    stages = _first_stage(weight * Z, weight * rows.H, rows.names)
    told = replace(rows, H=Z @ stages)
    solution = solve(qr_factor_of(told), weights)
    # the residual is that of the measured columns, not of what the instruments tell of them
    linear = replace(told, y=rows.y - (rows.H - told.H) @ solution.values)
    of_linear = qr_factor_of(linear)
    factors = score_factors(linear, of_linear, weights, solution.values)
    scores = long_run_of(linear.H, factors, rows.time, rows.run)
    partial = np.diag(solve(qr_factor, weights).inverse) / np.diag(solution.inverse)
    flags = tuple(
        f"the instruments of {name} are weak: they tell {share:.1%} of what it does beside the "
        "other parameters; its value may be as biased as that of least squares"
        for name, share in zip(rows.names, partial, strict=True)
        if share < WEAK
    )
    return replace(estimate_of(of_linear, weights, scores, propagated), flags=flags)


def _checked(rows: Regression, instruments: Array) -> Array:
    if np.shape(instruments) != rows.H.shape:
        raise IdentificationError(
            f"instruments must have a column for each of the {rows.H.shape[1]} parameters and the "
            f"{rows.H.shape[0]} rows of the regression, found shape {np.shape(instruments)}"
        )
    dead = [name for name, column in zip(rows.names, instruments.T, strict=True) if not any(column)]
    if dead:
        raise IdentificationError(
            f"the instruments of {', '.join(dead)} are zero: the motion that they are computed "
            "from does not move these joints"
        )
    return instruments


def _first_stage(Z: Array, H: Array, names: tuple[str, ...]) -> Array:
    """Return the coefficients (p, p) of the columns of H on those of Z, scaled for that."""
    p, norms = len(names), np.linalg.norm(Z, axis=0)
    R = triangle(np.hstack([Z / norms, H]))
    coefficients, _, rank, _ = safely(
        linalg.lstsq, R[:p, :p], R[:p, p:], what="the instruments", cond=_LOST
    )
    if rank < p:
        raise IdentificationError(
            f"the instruments tell only {rank} of {p} parameters apart: the motion that "
            "they are computed from is too smooth; raise cutoff_hz, or use estimator='wls'"
        )
    return np.asarray(coefficients / norms[:, None])
