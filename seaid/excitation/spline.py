"""B-splines over [0, duration]: the bases "bspline" and "polynomial" (18)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid._arrays import Array, frozen
from seaid.errors import ExcitationError, shown

_MOST_DEGREE = 100
_LEAST_SPAN = 1e-12
"""Relative to the duration: knots closer than this differ by rounding error only."""


@dataclass(frozen=True, eq=False)
class SplineBasis:
    """Clamped B-splines over [0, duration]; the K coefficients of a joint are control points.

    Parameters
    ----------
    degree : int
        From 3 to 100.
    knots : array (K + degree + 1,)
        Rising times [s], the first and the last repeated degree + 1 times. Raises ExcitationError
        for knots that are not clamped, not in order, closer than 1e-12 of the duration, or
        repeated so often that the acceleration jumps.
    """

    degree: int
    knots: Array

    def __post_init__(self) -> None:
        knots = frozen("knots", self.knots, (None,), ExcitationError)
        object.__setattr__(self, "knots", knots)
        if not (self.degree >= 3 and self.degree == int(self.degree)):
            raise ExcitationError(
                f"the degree of a spline is a whole number of at least 3, found {self.degree}"
            )
        if self.degree > _MOST_DEGREE:
            raise ExcitationError(
                f"the degree of a spline is at most {_MOST_DEGREE}, found {shown(self.degree)}"
            )
        _check_knots(knots, self.degree)

    @property
    def duration(self) -> float:
        """End of the motion [s]; it starts at 0."""
        return float(self.knots[-1])

    @property
    def size(self) -> int:
        """Number of coefficients per joint, K."""
        return len(self.knots) - self.degree - 1

    @property
    def spans(self) -> int:
        """Number of intervals between knots."""
        return len(np.unique(self.knots)) - 1

    def matrices(self, time: Array) -> tuple[Array, Array, Array]:
        """Return the matrices (T, K) of position, velocity and acceleration at times (T,) [s].

        Times must lie within [0, duration].
        """
        return self.states(time, np.eye(self.size))

    def states(self, time: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (T, n) of coefficients (K, n) at times."""
        from scipy.interpolate import BSpline

        spline = BSpline(self.knots, coefficients, self.degree)
        position, velocity, acceleration = (spline(time, nu=order) for order in range(3))
        return position, velocity, acceleration

    @property
    def constant(self) -> Array:
        """The coefficients (K,) of the constant 1."""
        return np.ones(self.size)

    @property
    def scaling(self) -> Array:
        """The matrix (K, K) from variables to coefficients: the identity."""
        return np.eye(self.size)

    def hull(self, order: int, density: int) -> Array:
        """Return the matrix (C, K) to control points of the derivative of `order` (0, 1, 2).

        The derivative lies between its least and greatest control points at every instant (convex
        hull property). Inserting knots, about `density` per coefficient, brings the control points
        closer to the curve, quadratically in their number.
        """
        pieces = max(1, -(-density * self.size // self.spans))
        matrix, knots = np.eye(self.size), np.asarray(self.knots)
        for degree in range(self.degree, self.degree - order, -1):
            # control points of the derivative: p (c[i+1] - c[i]) / (t[i+p+1] - t[i+1])
            spans = knots[degree + 1 : -1] - knots[1 : -degree - 1]
            matrix = degree * np.diff(matrix, axis=0) / spans[:, None]
            knots = knots[1:-1]
        ends = np.unique(knots)
        cuts = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(1, pieces) / pieces
        finer = np.sort(np.concatenate([knots, cuts.ravel()]))
        return _refinement(knots, finer, self.degree - order) @ matrix

    def to_dict(self) -> dict[str, Any]:
        """Return the basis as JSON content."""
        return {"type": "spline", "degree": self.degree, "knots": self.knots.tolist()}


def _check_knots(knots: Array, degree: int) -> None:
    count, end = degree + 1, len(knots) - degree - 1
    clamped = count <= end and np.all(knots[:count] == 0) and np.all(knots[end:] == knots[-1])
    inside, spans = knots[count:end], np.diff(knots)
    ordered = clamped and np.all(np.isfinite(knots)) and np.all(spans >= 0)
    if not (ordered and knots[-1] > 0 and np.all((inside > 0) & (inside < knots[-1]))):
        raise ExcitationError(
            f"knots of degree {degree} must be {count} zeros, then rising times, then "
            f"{count} times the duration, found {shown(knots.tolist())}"
        )
    near = (spans > 0) & (spans < _LEAST_SPAN * knots[-1])
    if np.any(near):
        i = int(np.argmax(near))
        raise ExcitationError(
            f"knots at different times must be at least {_LEAST_SPAN:g} of the duration apart, "
            f"found {knots[i]:.9g} and {knots[i + 1]:.9g} s"
        )
    if np.unique(inside, return_counts=True)[1].max(initial=0) > degree - 2:
        raise ExcitationError(
            f"a knot of degree {degree} is repeated more than {degree - 2} times: "
            "the acceleration would jump there"
        )


def bernstein_from_powers(powers: Array, duration: float) -> Array:
    """Return Bernstein coefficients (d+1, n) over [0, duration] of powers a_i (d+1, n) of (18)."""
    from scipy.special import comb

    count = len(powers)
    scaled = powers * (duration ** np.arange(count))[:, None]
    i, j = np.indices((count, count))
    return np.asarray(np.where(j <= i, comb(i, j) / comb(count - 1, j), 0.0) @ scaled)


def _refinement(knots: Array, finer: Array, degree: int) -> Array:
    """Return the matrix from control points to those of the same curve on finer knots.

    Oslo algorithm (Cohen, Lyche and Riesenfeld 1980): control point i of the finer curve is the
    polar form at its knots s[i+1] .. s[i+degree], by the recursion of de Boor.
    """
    index = np.arange(len(finer) - degree - 1)
    middle = finer[index + (degree + 1) // 2]
    span = np.searchsorted(knots, middle, side="right") - 1
    span = np.clip(span, degree, len(knots) - degree - 2)
    points = np.eye(len(knots) - degree - 1)[span[:, None] + np.arange(-degree, 1)]
    for level in range(1, degree + 1):
        left = span[:, None] + np.arange(level - degree, 1)
        low, high = knots[left], knots[left + degree + 1 - level]
        # d[j] <- (1 - w) d[j-1] + w d[j],  w = (s[i+level] - t[j]) / (t[j+degree+1-level] - t[j])
        share = ((finer[index + level, None] - low) / (high - low))[:, :, None]
        points[:, level:] = (1.0 - share) * points[:, level - 1 : -1] + share * points[:, level:]
    return np.asarray(points[:, degree])
