"""Physically consistent parameters near an estimate and a prior.

Every pseudo-inertia is positive semidefinite (Sousa and Cortesao 2014; Wensing, Kim and Slotine
2018) and linear inequalities hold, in one convex program on the estimate and its covariance.

The unknowns are standard parameters and drive parameters, of which the estimate determines fewer
combinations. The objective is |u|^2 with estimate + root u, a chi-square in standard errors, plus
a weight times the log-det divergence from the prior (Lee, Wensing and Park 2020). Its minimum is
unique and inside the cones: it is the point of the central path of the semidefinite program at
which every complementary product equals the weight, so a primal-dual interior-point method ends
there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from seaid._arrays import Array
from seaid.estimation.sdp import RESOLVED, Program, minimum
from seaid.robot import is_physical

WEIGHTS = tuple(10.0**decade for decade in range(4, -7, -1))
"""Weights of the prior among which the data select, in units of chi-square.

The least adds at most 4e-6 per body to chi-square: it determines only what the data leave free.
"""

_OF_ONE = 1.0
"""Weight with which the divergence of a body from the prior counts as much as chi-square."""

_ACTIVE = 1e-3
"""A bound counts as active when its multiplier (slope of chi-square per unit of the bound) exceeds
this, and a body as flat where its pseudo-inertia is also below this part of the prior's.
"""


@dataclass(frozen=True, eq=False)
class FeasiblePoint:
    """Physically consistent unknowns (f,), their `values` (p,) in the estimate, and the distance.

    `distance` (p,) is u, with chi-square |u|^2. `freedom` is the effective number of the p values
    that the data determine under a prior of this `weight`; `risk` is Stein's unbiased estimate of
    the expected squared distance to the truth. `ranks` (n,) are those of the pseudo-inertias
    without the directions in which the cone is active, 4 if none; `active_bounds` are the active
    inequalities.
    """

    unknowns: Array
    values: Array
    distance: Array
    weight: float
    freedom: float
    risk: float
    ranks: tuple[int, ...]
    active_bounds: tuple[int, ...]

    @property
    def chi_square(self) -> float:
        """Squared distance to the estimate in standard errors."""
        return float(self.distance @ self.distance)


def regularised(program: Program, weight: float) -> FeasiblePoint:
    """Return the unknowns that minimise chi-square + `weight` times the log-det divergence.

    The divergence of a body is tr Q - log det Q - 4, with Q its pseudo-inertia in the coordinates
    in which the prior's is the identity. A weight below 1e-9 of chi-square counts as that, since
    less cannot be resolved. Raises IdentificationError if the minimum is not found.
    """
    optimum = minimum(program, weight)
    point, used = optimum.point, optimum.weight
    offset, matrix = program.span
    u = point.x[: point.p]
    unknowns = offset + matrix @ point.x
    for body, safe in enumerate(program.bodies(point.Q)):
        span = slice(10 * body, 10 * body + 10)
        if not is_physical(unknowns[span], 0.0):  # rounding of large bodies in a small one
            unknowns[span] = safe
    multipliers = np.linalg.eigvalsh(point.Z)
    return FeasiblePoint(
        unknowns=unknowns,
        values=program.estimate + program.root @ u,
        distance=u,
        weight=used,
        freedom=optimum.freedom,
        risk=float(u @ u + 2 * optimum.freedom - point.p),  # Stein 1981
        # Z Q = weight, so that Q is below _ACTIVE where Z is above weight / _ACTIVE
        ranks=tuple(map(int, np.sum(multipliers < max(_ACTIVE, used / _ACTIVE), axis=1))),
        active_bounds=tuple(map(int, np.flatnonzero(point.multipliers > _ACTIVE))),
    )


def nearest(program: Program) -> FeasiblePoint:
    """Return the consistent unknowns nearest to the estimate; the prior determines what is free.

    Its chi-square exceeds that of the semidefinite program without a prior by at most 4e-6 per
    body. Raises as `regularised` does.
    """
    return regularised(program, WEIGHTS[-1])


def with_selected_weight(
    program: Program, least: float, weights: Sequence[float] = WEIGHTS
) -> FeasiblePoint:
    """Return `regularised` with the weight of least estimated risk.

    The risk is Stein's (1981) unbiased estimate of the expected squared distance to the truth, in
    standard errors: |u|^2 + 2 freedom - p. Unlike cross-validation it needs no independent folds,
    so it holds for autocorrelated noise. The weights are tried in falling order, as far as they can
    be resolved relative to `least`, the chi-square of `nearest`, and until no smaller risk is
    possible; then the midpoints to the neighbours of the best. A weight below 1, under which bodies
    may be many times as heavy as those of the prior, must lower the risk by more than the standard
    deviation of chi-square over p values.
    """
    resolved = [weight for weight in weights if weight >= RESOLVED * least] or [weights[0]]
    tried = _falling_fits(program, least, resolved)
    best = min(tried, key=attrgetter("risk"))
    if best.weight < _OF_ONE:
        # Chi-square over p values has the variance 2 p.
        highest = best.risk + math.sqrt(2 * len(program.estimate))
        likely = [fit for fit in tried if fit.risk <= highest]
        # Weights from 1 up count alike; of these `max` takes the first, which is the largest.
        return max(likely, key=lambda point: min(point.weight, _OF_ONE))
    around = best.weight * 10**0.5, best.weight / 10**0.5
    inner = [weight for weight in around if resolved[-1] < weight < resolved[0]]
    points = [best, *(regularised(program, weight) for weight in inner)]
    return min(points, key=attrgetter("risk"))


def _falling_fits(program: Program, least: float, weights: Sequence[float]) -> list[FeasiblePoint]:
    """Return `regularised` with the weights in falling order, until no smaller risk is possible."""
    fits = [regularised(program, weights[0])]
    for weight in weights[1:]:
        fits.append(regularised(program, weight))
        # |u|^2 is at least that of `nearest`, and the freedom grows as the weight falls.
        bound = least + 2 * fits[-1].freedom - len(program.estimate)  # of the risk of the others
        if bound > min(fit.risk for fit in fits):
            break
    return fits
