"""Possible bodies near an estimate and a prior: chi-square plus log-det divergence, and its weight.

Every pseudo-inertia is positive semidefinite (Sousa and Cortesao 2014; Wensing, Kim and Slotine
2018) and linear inequalities hold, in one convex programme on the estimate and its covariance.

The unknowns are standard parameters and drive parameters, of which the estimate tells fewer
combinations. Distance is in standard errors, |u|^2 with estimate + root u, so that it is a
chi-square; the divergence from the prior is Lee, Wensing and Park's (2020). It makes the minimum
one point inside the cones: that of the central path of the semidefinite programme where every
complementary product is the weight, so a primal-dual interior-point method ends there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from seaid.arrays import Array
from seaid.errors import IdentificationError
from seaid.estimation.programme import Programme

WEIGHTS = tuple(10.0**decade for decade in range(4, -7, -1))
"""Weights of the prior among which the data choose, in units of chi-square.

The least adds at most 4e-6 a body to chi-square: it decides only what the data leave open.
"""

_BARRIER = 1e-6
"""What a linear inequality may cost in chi-square: its logarithmic barrier's weight."""

_PUSH = 1e-3
"""Slope of chi-square along a bound, in the bound's own size, from which something pushes."""

_SETTLED = 1e-9
"""Decrement of the merit in units of the weight at which the minimum is found."""

_ROUNDING = 1e-11
"""The same as a part of chi-square: far from the estimate no more can be resolved."""

_MOST_STEPS = 200
_TO_THE_BOUNDARY = 0.9


@dataclass(frozen=True, eq=False)
class Possible:
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
    held: tuple[int, ...]

    @property
    def chi_square(self) -> float:
        """Squared distance to the estimate in standard errors."""
        return float(self.distance @ self.distance)


def regularised(programme: Programme, weight: float) -> Possible:
    """Return the possible unknowns that minimise chi-square + weight times the divergence.

    The divergence of a body from the prior is tr Q - log det Q - 4, with Q its pseudo-inertia
    where the prior's is 1. Found to rounding by a primal-dual method (Helmberg, Rendl, Vanderbei
    and Wolkowicz 1996). Raises IdentificationError where it does not end.
    """
    point = _first(programme, weight)
    final, length = (1.0, _BARRIER / weight), 1.0
    for _ in range(_MOST_STEPS):
        shorten = min(1.0, max(0.1, 1.5 * (1 - length)))
        gaps = point.gaps
        targets = (max(final[0], shorten * gaps[0]), max(final[1], shorten * gaps[1]))
        hessian, step, decrement = _direction(programme, weight, point, targets)
        point, length, whole = _moved(programme, point, step)
        u = point.x[: len(programme.estimate)]
        rounding = _ROUNDING * float(u @ u) / weight
        if targets == final and whole and decrement < max(_SETTLED, rounding):
            return _possible(programme, point, weight, hessian)
    raise IdentificationError(
        f"the bodies nearest to the prior with weight {weight:.3g} were not found in {_MOST_STEPS} "
        "steps: check that the covariance of the estimate is finite and the bounds are not extreme"
    )


def nearest(programme: Programme) -> Possible:
    """Return the possible unknowns nearest to the estimate; the prior decides what is left open.

    Its chi-square is that of the semidefinite programme without prior, but for 4e-6 a body. Raises
    as `regularised` does.
    """
    return regularised(programme, WEIGHTS[-1])


def chosen(programme: Programme, least: float, weights: Sequence[float] = WEIGHTS) -> Possible:
    """Return `regularised` with the weight of the least risk: that which the data choose.

    The risk is Stein's (1981) unbiased estimate of the expected squared distance to the truth, in
    standard errors: |u|^2 + 2 freedom - p. It is what cross-validation estimates, without folds,
    and holds with the covariance of noise that is correlated in time, where folds are not
    independent. Searched over falling `weights`, then half-way to the neighbours of the best, and
    no further than where `least`, the chi-square of `nearest`, and the freedom leave no less risk.
    """
    p, best = len(programme.estimate), regularised(programme, weights[0])
    for weight in weights[1:]:
        one = regularised(programme, weight)
        best = min(best, one, key=_risk)
        if least + 2 * one.freedom - p > best.risk:
            break
    around = [best.weight * 10**0.5, best.weight / 10**0.5]
    return min([best, *(regularised(programme, weight) for weight in around)], key=_risk)


def _risk(one: Possible) -> float:
    return one.risk


@dataclass(frozen=True, eq=False)
class _Point:
    """(u, free unknowns), the bodies Q (n, 4, 4), slacks (c,), and the multipliers of both."""

    x: Array
    Q: Array
    slack: Array
    Z: Array
    multipliers: Array

    @property
    def gaps(self) -> tuple[float, float]:
        """Mean complementary products of bodies and of inequalities."""
        bodies = float(np.sum(self.Q * self.Z)) / (4 * len(self.Q))
        return bodies, float(self.slack @ self.multipliers) / max(len(self.slack), 1)


def _first(programme: Programme, weight: float) -> _Point:
    x = programme.coordinates(programme.start)
    (first, blocks), (offset, matrix) = programme.cones, programme.slack
    Q, slack = first + np.tensordot(x, blocks, (0, 1)), offset + matrix @ x
    u = x[: len(programme.estimate)]
    gap = max(1.0, float(u @ u) / weight / (4 * len(Q)))
    return _Point(x, Q, slack, np.asarray(gap * np.linalg.inv(Q)), gap / slack)


def _direction(
    programme: Programme, weight: float, point: _Point, targets: tuple[float, float]
) -> tuple[Array, _Point, float]:
    """Return the Hessian, the step of all that a point has, and the decrement of the merit."""
    p = len(programme.estimate)
    blocks, matrix = programme.cones[1], programme.slack[1]
    half = np.linalg.inv(np.linalg.cholesky(point.Q))
    inverse = half.transpose(0, 2, 1) @ half
    whitened = half[:, None] @ blocks @ np.linalg.cholesky(point.Z)[:, None]
    flat = whitened.transpose(0, 2, 3, 1).reshape(-1, len(point.x))
    steep = matrix * np.sqrt(point.multipliers / point.slack)[:, None]
    hessian = flat.T @ flat + steep.T @ steep
    hessian[range(p), range(p)] += 2 / weight
    gradient = np.einsum("nfij,nij->f", blocks, np.eye(4) - targets[0] * inverse)
    gradient -= targets[1] * (matrix.T @ (1 / point.slack))
    gradient[:p] += 2 / weight * point.x[:p]
    x = -_inverse_times(hessian, gradient)
    Q, slack = np.tensordot(x, blocks, (0, 1)), matrix @ x
    turned = point.Z @ Q @ inverse
    Z = targets[0] * inverse - point.Z - 0.5 * (turned + turned.transpose(0, 2, 1))
    multipliers = (targets[1] - point.multipliers * slack) / point.slack - point.multipliers
    return hessian, _Point(x, Q, slack, Z, multipliers), -float(gradient @ x)


def _moved(programme: Programme, point: _Point, step: _Point) -> tuple[_Point, float, bool]:
    """Return the point after a step that stays inside, the shorter length, and if x went all."""
    primal = _length(point.Q, step.Q, point.slack, step.slack)
    dual = _length(point.Z, step.Z, point.multipliers, step.multipliers)
    x = point.x + primal * step.x
    (first, blocks), (offset, matrix) = programme.cones, programme.slack
    moved = _Point(
        x,
        first + np.tensordot(x, blocks, (0, 1)),
        offset + matrix @ x,
        point.Z + dual * step.Z,
        point.multipliers + dual * step.multipliers,
    )
    return moved, min(primal, dual), primal == 1.0


def _length(matrices: Array, changes: Array, values: Array, falls: Array) -> float:
    """Return how much of a step keeps matrices positive definite and values positive."""
    half = np.linalg.inv(np.linalg.cholesky(matrices))
    ratios = np.linalg.eigvalsh(half @ changes @ half.transpose(0, 2, 1)).ravel()
    steepest = -min(np.min(ratios), np.min(falls / values, initial=0.0))
    length = min(1.0, _TO_THE_BOUNDARY / max(steepest, 1e-300))
    while np.min(np.linalg.eigvalsh(matrices + length * changes)) <= 0:
        length *= 0.7
    return float(length)


def _inverse_times(hessian: Array, columns: Array) -> Array:
    """Solve with a Hessian whose unknowns are of different sizes; a ridge only where it must be."""
    scale = 1 / np.sqrt(np.diag(hessian))
    balanced = hessian * np.outer(scale, scale)
    columns = (scale * columns.T).T
    for ridge in (0.0, 1e-15, 1e-13, 1e-11):
        try:
            factor = linalg.cho_factor(balanced + ridge * np.eye(len(scale)), check_finite=False)
        except linalg.LinAlgError:
            continue
        return np.asarray((scale * linalg.cho_solve(factor, columns, check_finite=False).T).T)
    raise IdentificationError(
        "possible bodies: estimate and prior leave unknowns open; check that the covariance of the "
        "estimate is that of a real estimate"
    )


def _possible(programme: Programme, point: _Point, weight: float, hessian: Array) -> Possible:
    """Return what a point means; `hessian` (f, f) is that of the merit over the weight."""
    p = len(programme.estimate)
    offset, matrix = programme.span
    u = point.x[:p]
    freedom = 2 / weight * np.trace(_inverse_times(hessian, np.eye(len(point.x), p))[:p])
    pushes = weight * np.linalg.eigvalsh(point.Z)
    return Possible(
        unknowns=offset + matrix @ point.x,
        values=programme.estimate + programme.root @ u,
        distance=u,
        weight=weight,
        freedom=float(freedom),
        risk=float(u @ u + 2 * freedom - p),
        ranks=tuple(map(int, np.sum(pushes < max(_PUSH, 10 * weight), axis=1))),
        held=tuple(map(int, np.flatnonzero(weight * point.multipliers > _PUSH))),
    )
