"""B-splines over [0, duration]: the bases "bspline" and "polynomial" (18)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid._arrays import Array, frozen
from seaid.errors import ExcitationError, shown

_MOST_DEGREE = 100
_LEAST_SPAN = 1e-12
"""Of the duration: knots nearer than that are one place, but for rounding."""


@dataclass(frozen=True, eq=False)
class SplineBasis:
    """Clamped B-splines of one `degree` on `knots` (K + degree + 1,) [s], from 0 to the duration.

    Position, velocity and acceleration of a joint are matrices of this basis times its K
    coefficients, the control points [rad or m]. Raises ExcitationError for knots that are not
    clamped, not in order, nearer than 1e-12 of the duration, or too many at one place for a
    continuous acceleration.
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
        count, end = self.degree + 1, len(knots) - self.degree - 1
        clamped = count <= end and np.all(knots[:count] == 0) and np.all(knots[end:] == knots[-1])
        inside = knots[count:end]
        ordered = clamped and np.all(np.isfinite(knots)) and np.all(np.diff(knots) >= 0)
        if not (ordered and knots[-1] > 0 and np.all((inside > 0) & (inside < knots[-1]))):
            raise ExcitationError(
                f"knots of degree {self.degree} must be {count} zeros, then rising times, then "
                f"{count} times the duration, found {shown(knots.tolist())}"
            )
        spans = np.diff(knots)
        near = (spans > 0) & (spans < _LEAST_SPAN * knots[-1])
        if np.any(near):
            i = int(np.argmax(near))
            raise ExcitationError(
                f"knots at different times must be at least {_LEAST_SPAN:g} of the duration apart, "
                f"found {knots[i]:.9g} and {knots[i + 1]:.9g} s"
            )
        if np.unique(inside, return_counts=True)[1].max(initial=0) > self.degree - 2:
            raise ExcitationError(
                f"a knot of degree {self.degree} stands more than {self.degree - 2} times at one "
                "place: the acceleration would jump there"
            )

    @property
    def duration(self) -> float:
        """End of the motion [s]; it starts at 0."""
        return float(self.knots[-1])

    @property
    def size(self) -> int:
        """Number of coefficients a joint, K."""
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
    def natural(self) -> Array:
        """The matrix (K, K) from variables of like size to coefficients: the identity."""
        return np.eye(self.size)

    def hull(self, order: int, density: int) -> Array:
        """Return the matrix (C, K) to control points of the derivative of `order` (0, 1, 2).

        The derivative lies between the least and the greatest control point at every instant
        (convex hull property). The spans between knots are cut first, into about `density` pieces a
        coefficient: the more, the closer the control points lie to the curve (quadratically).
        """
        pieces = max(1, -(-density * self.size // self.spans))
        matrix, knots = np.eye(self.size), np.asarray(self.knots)
        for degree in range(self.degree, self.degree - order, -1):
            spans = knots[degree + 1 : -1] - knots[1 : -degree - 1]
            matrix = degree * np.diff(matrix, axis=0) / spans[:, None]
            knots = knots[1:-1]
        ends = np.unique(knots)
        cuts = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(1, pieces) / pieces
        finer = np.sort(np.concatenate([knots, cuts.ravel()]))
        return _refinement(knots, finer, self.degree - order) @ matrix

    def to_dict(self) -> dict[str, Any]:
        """Return what a JSON file keeps of the basis."""
        return {"type": "spline", "degree": self.degree, "knots": self.knots.tolist()}


def bernstein_from_powers(powers: Array, duration: float) -> Array:
    """Return Bernstein coefficients (d+1, n) over [0, duration] of the a_i (d+1, n) of (18)."""
    from scipy.special import comb

    count = len(powers)
    scaled = powers * (duration ** np.arange(count))[:, None]
    i, j = np.indices((count, count))
    return np.asarray(np.where(j <= i, comb(i, j) / comb(count - 1, j), 0.0) @ scaled)


def _refinement(knots: Array, finer: Array, degree: int) -> Array:
    """Return the matrix from control points to those of the same curve on finer knots.

    The Oslo algorithm (Cohen, Lyche and Riesenfeld 1980): control point i of the finer curve is its
    polar form at the knots i+1 .. i+degree, by de Boor's recursion.
    """
    index = np.arange(len(finer) - degree - 1)
    middle = finer[index + (degree + 1) // 2]
    span = np.searchsorted(knots, middle, side="right") - 1
    span = np.clip(span, degree, len(knots) - degree - 2)
    points = np.eye(len(knots) - degree - 1)[span[:, None] + np.arange(-degree, 1)]
    for level in range(1, degree + 1):
        left = span[:, None] + np.arange(level - degree, 1)
        low, high = knots[left], knots[left + degree + 1 - level]
        share = ((finer[index + level, None] - low) / (high - low))[:, :, None]
        points[:, level:] = (1.0 - share) * points[:, level - 1 : -1] + share * points[:, level:]
    return np.asarray(points[:, degree])
