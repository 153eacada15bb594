"""Possible bodies near an estimate and a prior: chi-square plus log-det divergence, and its weight.

Every pseudo-inertia is positive semidefinite (Sousa and Cortesao 2014; Wensing, Kim and Slotine
2018) and linear inequalities hold, in one convex program on the estimate and its covariance.

The unknowns are standard parameters and drive parameters, of which the estimate tells fewer
combinations. Distance is in standard errors, |u|^2 with estimate + root u, so that it is a
chi-square; the divergence from the prior is Lee, Wensing and Park's (2020). It makes the minimum
one point inside the cones: that of the central path of the semidefinite program where every
complementary product is the weight, so a primal-dual interior-point method ends there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array
from seaid.estimation.sdp import RESOLVED, Program, minimum
from seaid.robot import is_physical

WEIGHTS = tuple(10.0**decade for decade in range(4, -7, -1))
"""Weights of the prior among which the data choose, in units of chi-square.

The least adds at most 4e-6 a body to chi-square: it decides only what the data leave open.
"""

_PUSH = 1e-3
"""Slope of chi-square along a bound, in the bound's own size, from which something pushes."""


@dataclass(frozen=True, eq=False)
class FeasiblePoint:
    """Possible unknowns (f,), their `values` (p,) beside the estimate and the distance.

    `distance` (p,) is u, whose squares make `chi_square`. `freedom` is how many of the p values the
    data still decide beside a prior of this `weight`, and `risk` Stein's unbiased estimate of the
    expected squared distance to the truth.

    `ranks` (n,) are those of the pseudo-inertias without the directions in which estimate and prior
    push against their bound, 4 where they push in none; `held` the inequalities they push against.
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
    """Return the possible unknowns that minimise chi-square + weight times the divergence.

    The divergence of a body from the prior is tr Q - log det Q - 4, with Q its pseudo-inertia
    where the prior's is 1. Found to rounding; a weight below 1e-9 of chi-square counts as that,
    since less cannot be resolved. Raises IdentificationError where it is not found.
    """
    found = minimum(program, weight)
    point, used = found.point, found.weight
    offset, matrix = program.span
    u = point.x[: point.p]
    unknowns = offset + matrix @ point.x
    for body, safe in enumerate(program.bodies(point.Q)):
        own = slice(10 * body, 10 * body + 10)
        if not is_physical(unknowns[own], 0.0):  # a small body beside large ones: their rounding
            unknowns[own] = safe
    pushes = np.linalg.eigvalsh(point.Z)
    return FeasiblePoint(
        unknowns=unknowns,
        values=program.estimate + program.root @ u,
        distance=u,
        weight=used,
        freedom=found.freedom,
        risk=float(u @ u + 2 * found.freedom - point.p),
        ranks=tuple(map(int, np.sum(pushes < max(_PUSH, 10 * used), axis=1))),
        active_bounds=tuple(map(int, np.flatnonzero(point.multipliers > _PUSH))),
    )


def nearest(program: Program) -> FeasiblePoint:
    """Return the possible unknowns nearest to the estimate; the prior decides what is left open.

    Its chi-square is that of the semidefinite program without prior, but for 4e-6 a body. Raises
    as `regularised` does.
    """
    return regularised(program, WEIGHTS[-1])


def with_selected_weight(
    program: Program, least: float, weights: Sequence[float] = WEIGHTS
) -> FeasiblePoint:
    """Return `regularised` with the weight of the least risk: that which the data choose.

    The risk is Stein's (1981) unbiased estimate of the expected squared distance to the truth, in
    standard errors: |u|^2 + 2 freedom - p. It is what cross-validation estimates, without folds,
    and holds with the covariance of noise that is correlated in time, where folds are not
    independent. Searched over falling `weights` that can be resolved beside `least`, the
    chi-square of `nearest`, and no further than where it and the freedom leave no less risk; then
    half-way to the neighbours of the best.
    """
    p = len(program.estimate)
    able = [weight for weight in weights if weight >= RESOLVED * least] or [weights[0]]
    best = regularised(program, able[0])
    for weight in able[1:]:
        one = regularised(program, weight)
        best = min(best, one, key=_risk)
        if least + 2 * one.freedom - p > best.risk:
            break
    around = best.weight * 10**0.5, best.weight / 10**0.5
    inner = [weight for weight in around if able[-1] < weight < able[0]]
    return min([best, *(regularised(program, weight) for weight in inner)], key=_risk)


def _risk(one: FeasiblePoint) -> float:
    return one.risk
