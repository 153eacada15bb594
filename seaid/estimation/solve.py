"""Ordinary and weighted least squares on scaled columns."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from seaid.arrays import Array
from seaid.errors import ExcitationError, IdentificationError
from seaid.estimation.covariance import newey_west
from seaid.estimation.estimate import Estimate
from seaid.regression import Regression

_LOST = 1e-7
"""Singular value, relative to the largest, below which a combination of columns is lost."""

_MOST_REWEIGHTINGS = 20


def ordinary(rows: Regression, carried: Array | None = None) -> Estimate:
    """Return the ordinary least-squares estimate, all rows alike.

    `carried` (s, s) is the covariance of what the targets were computed from; see `Regression`.
    Covariance: Newey-West. Raises IdentificationError for fewer rows than parameters and
    ExcitationError where the data leave a combination of parameters open.
    """
    return _estimate(rows, np.ones(len(rows.y)), carried)


def weighted(rows: Regression, carried: Array | None = None) -> Estimate:
    """Return the least-squares estimate with rows weighted by their joint's residual.

    Iterated until the weights settle (Gautier 1997; Swevers et al. 1997). Otherwise as `ordinary`.
    """
    weights = np.ones(len(rows.y))
    for _ in range(_MOST_REWEIGHTINGS):
        residual = rows.y - rows.H @ _solve(rows, weights)[0]
        std = {joint: _spread(residual[rows.joint == joint]) for joint in np.unique(rows.joint)}
        largest = max(std.values())
        if largest <= 1e-12 * _spread(rows.y):
            break
        new = np.array([largest / max(std[joint], 1e-9 * largest) for joint in rows.joint])
        settled = np.allclose(new, weights, rtol=1e-6)
        weights = new
        if settled:
            break
    return _estimate(rows, weights, carried)


def _first_term(name: str) -> str:
    """Return a long grouping by its first parameter, which is the base column's own name."""
    return name if len(name) <= 40 else f"{name.split(' ')[0]} + ..."


def _spread(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _solve(rows: Regression, weights: Array) -> tuple[Array, Array, float]:
    """Return the solution, the inverse of the information and the scaled condition number."""
    H = rows.H * weights[:, None]
    count, p = H.shape
    if count < p:
        raise IdentificationError(
            f"{count} rows cannot tell {p} parameters: record a longer log, or raise cutoff_hz"
        )
    norms = np.linalg.norm(H, axis=0)
    dead = [name for name, norm in zip(rows.names, norms, strict=True) if norm == 0]
    if dead:
        raise ExcitationError(
            f"the motion does not excite {', '.join(map(_first_term, dead))}: move these joints"
        )
    U, s, Vt = linalg.svd(H / norms, full_matrices=False)
    if s[-1] < _LOST * s[0]:
        share = np.abs(Vt[-1])
        lost = [rows.names[column] for column in np.flatnonzero(share > 0.1 * share.max())]
        raise ExcitationError(
            "the motion does not excite all parameters: it tells nothing about the combination of "
            f"{', '.join(map(_first_term, lost))} (scaled singular value "
            f"{s[-1] / s[0]:.1e}, needed {_LOST:.0e}); move these joints more, or leave torques "
            "out with rows="
        )
    theta = Vt.T @ ((U.T @ (rows.y * weights)) / s) / norms
    inverse = (Vt.T / s) / norms[:, None]
    return theta, inverse @ inverse.T, float(s[0] / s[-1])


def _estimate(rows: Regression, weights: Array, carried: Array | None) -> Estimate:
    theta, inverse, condition = _solve(rows, weights)
    residual = rows.y - rows.H @ theta
    scores = rows.H * (weights**2 * residual)[:, None]
    covariance = inverse @ newey_west(scores, rows.time, rows.run) @ inverse
    covariance *= len(rows.y) / max(len(rows.y) - len(theta), 1)
    if carried is not None and rows.carried.shape[1]:
        sensitivity = inverse @ (rows.H * (weights**2)[:, None]).T @ rows.carried
        covariance += sensitivity @ carried @ sensitivity.T
    return Estimate(
        names=rows.names,
        values=theta,
        covariance=0.5 * (covariance + covariance.T),
        units=rows.units,
        residual_std=_spread(residual),
        condition_number=condition,
    )
