"""Variable projection: least squares that is nonlinear in few of its parameters.

The model is y(v) = H(v) theta + noise. For given v the best theta is linear least squares, so the
search is over v alone (Golub and Pereyra 1973), with Kaufman's (1975) Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array
from seaid.estimation.singular_directions import scaled_svd

Columns = Callable[[Array], tuple[Array, Array]]
"""Function of v (b,) that returns y (R,) and H (R, p)."""

Slopes = Callable[[Array, Array], Array]
"""Function of v (b,) and theta (p,) that returns the derivative (R, b) of H theta - y by v."""

_MOST_EVALUATIONS = 60
_FEW_STEPS, _MOST_TRIED = 8, 12


@dataclass(frozen=True, eq=False)
class SeparableFit:
    """The best `nonlinear` (b,) and `linear` (p,) values, and the norm of the residual."""

    nonlinear: Array
    linear: Array
    residual: float


def separable_least_squares(
    columns: Columns, slopes: Slopes, starts: Sequence[Array], lower: Array, upper: Array
) -> SeparableFit:
    """Return the least-squares fit of a model that is nonlinear in b of its parameters.

    A few iterations from the best dozen of the `starts` (each (b,)) are followed by a full search
    from the best result, within `lower` < v < `upper` (b,). The bounds also set the scale of the
    search where they are finite; a start on a bound is moved inside.
    """

    def misfit(v: Array) -> float:
        return float(np.linalg.norm(_residual(columns, v)[0]))

    inside = [_inside(np.asarray(start, dtype=float), lower, upper) for start in starts]
    inside = sorted(inside, key=misfit)[:_MOST_TRIED]
    if len(inside) > 1:
        tried = [_search(columns, slopes, v, lower, upper, _FEW_STEPS) for v in inside]
        inside = [min(tried, key=misfit)]
    best = _search(columns, slopes, inside[0], lower, upper, _MOST_EVALUATIONS)
    residual, theta, _ = _residual(columns, best)
    return SeparableFit(best, theta, float(np.linalg.norm(residual)))


def _search(
    columns: Columns, slopes: Slopes, start: Array, lower: Array, upper: Array, most: int
) -> Array:
    """Return v after at most `most` evaluations from a start."""
    from scipy.optimize import least_squares

    size = max(float(np.linalg.norm(_residual(columns, start)[0])), 1e-300)

    last: list[tuple[Array, tuple[Array, Array, Array]]] = []

    def at(v: Array) -> tuple[Array, Array, Array]:
        if not last or not np.array_equal(last[0][0], v):
            last[:] = [(v.copy(), _residual(columns, v))]
        return last[0][1]

    def residual(v: Array) -> Array:
        return at(v)[0] / size

    def jacobian(v: Array) -> Array:
        _, theta, Q = at(v)
        D = slopes(v, theta)
        return -(D - Q @ (Q.T @ D)) / size  # Kaufman 1975: -(I - Q Q^T) dH/dv theta

    scale = np.where(start != 0, np.abs(start), np.where(np.isfinite(upper), upper, 1.0))
    start = _inside(start, lower, upper)
    solution = least_squares(
        residual,
        start,
        jac=jacobian,
        bounds=(lower, upper),
        x_scale=scale,
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-14,
        max_nfev=most,
    )
    return np.asarray(solution.x)


def _residual(columns: Columns, v: Array) -> tuple[Array, Array, Array]:
    """Return y - H theta at v, theta, and an orthonormal basis (R, rank) of the range of H."""
    y, H = columns(v)
    svd = scaled_svd(H)
    Q = svd.span()
    return y - Q @ (Q.T @ y), svd.solve(y), Q


def _inside(v: Array, lower: Array, upper: Array) -> Array:
    """Return v moved inside its bounds."""
    with np.errstate(invalid="ignore"):
        width = np.where(np.isfinite(upper - lower), upper - lower, 1.0 + np.abs(v))
    return np.clip(v, lower + 1e-6 * width, upper - 1e-6 * width)
