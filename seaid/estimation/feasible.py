"""Possible bodies nearest to an estimate: a semidefinite programme, and a prior for the rest.

The unknowns are standard parameters and drive parameters, of which the estimate tells fewer
combinations. Distance is in standard errors, |u|^2 with estimate + root u, so that it is a
chi-square. Every pseudo-inertia is positive semidefinite (Sousa and Cortesao 2014; Wensing, Kim and
Slotine 2018), linear inequalities hold. `nearest` solves that programme by Clarabel's cones.
`regularised` adds weight times the log-det divergence from a prior (Lee, Wensing and Park 2020),
which makes the minimum one point inside the cones: Newton's method finds it to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from seaid.arrays import Array, frozen
from seaid.errors import IdentificationError
from seaid.estimation.cones import solve_cones, triangle_rows, upper_triangle
from seaid.inertia import pseudo_inertia

WEIGHTS = tuple(10.0**decade for decade in range(4, -7, -1))
"""Weights of the prior among which the data choose, in units of chi-square."""

_BARRIER = 1e-6
"""What a linear inequality may cost in chi-square: its logarithmic barrier's weight."""

_LEAST_TRACE = 1e-7
"""Weight of the bodies' size in the programme without prior, whose minimum is not one point."""

_PUSH = 1e-3
"""Slope of chi-square along a bound, in the bound's own size, from which the data push."""

_INWARDS = 1e-6
"""Part of the way to a point well inside that Newton's method starts from."""

_RIDGE = 1e-13
_MOST_STEPS = 100


@dataclass(frozen=True, eq=False)
class Programme:
    """An estimate of combinations of f unknowns, the first 10n of which are n bodies.

    columns (p, f) @ unknowns is what `estimate` (p,) tells with covariance root @ root.T; the
    `pivots` (p,) are unknowns whose columns are those of the identity. `prior` (n, 10) are possible
    bodies with mass in every direction; `limits` (c, f) @ unknowns >= `bounds` (c,); `start` (f,)
    keeps all of that strictly.
    """

    columns: Array
    pivots: tuple[int, ...]
    estimate: Array
    root: Array
    prior: Array
    limits: Array
    bounds: Array
    start: Array

    def __post_init__(self) -> None:
        p, f = np.shape(self.columns)
        shapes = {
            "columns": (p, f),
            "estimate": (p,),
            "root": (p, p),
            "prior": (None, 10),
            "limits": (None, f),
            "bounds": (len(self.limits),),
            "start": (f,),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape))

    @cached_property
    def free(self) -> tuple[int, ...]:
        """The unknowns beside the pivots."""
        return tuple(sorted(set(range(self.columns.shape[1])) - set(self.pivots)))

    @cached_property
    def span(self) -> tuple[Array, Array]:
        """Offset (f,) and matrix (f, f): unknowns = offset + matrix @ (u, unknowns that are free).

        Exact for every u and every free unknown: the estimate moves by root @ u and nothing else.
        """
        p, f = self.columns.shape
        offset, matrix = np.zeros(f), np.zeros((f, f))
        pivots, free = list(self.pivots), list(self.free)
        offset[pivots] = self.estimate
        matrix[pivots, :p] = self.root
        matrix[pivots, p:] = -self.columns[:, free]
        matrix[free, range(p, f)] = 1.0
        return offset, matrix

    @cached_property
    def cones(self) -> tuple[Array, Array]:
        """Offset (n, 4, 4) and matrix (n, f, 4, 4) of the pseudo-inertias, 1 at the prior's."""
        offset, matrix = self.span
        basis = np.array([pseudo_inertia(unit) for unit in np.eye(10)])
        first, blocks = [], []
        for body, parameters in enumerate(self.prior):
            half = np.linalg.inv(np.linalg.cholesky(pseudo_inertia(parameters)))
            units = half @ basis @ half.T
            own = slice(10 * body, 10 * body + 10)
            first.append(np.tensordot(offset[own], units, 1))
            blocks.append(np.tensordot(matrix[own].T, units, 1))
        return np.array(first), np.array(blocks)

    @cached_property
    def slack(self) -> tuple[Array, Array]:
        """Offset (c,) and matrix (c, f) of what the inequalities leave."""
        offset, matrix = self.span
        return self.limits @ offset - self.bounds, self.limits @ matrix

    def coordinates(self, unknowns: Array) -> Array:
        """Return (u, free unknowns) of unknowns (f,)."""
        distance = self.columns @ unknowns - self.estimate
        u = linalg.solve(self.root, distance, check_finite=False)
        return np.concatenate([u, unknowns[list(self.free)]])


@dataclass(frozen=True, eq=False)
class Possible:
    """Possible unknowns (f,), their `values` (p,) beside the estimate and the distance.

    `distance` (p,) is u, whose squares make `chi_square`. `freedom` is how many of the p values the
    data still decide beside a prior of this `weight`, and `risk` Stein's unbiased estimate of the
    expected squared distance to the truth.
    """

    unknowns: Array
    values: Array
    distance: Array
    weight: float
    freedom: float
    risk: float

    @property
    def chi_square(self) -> float:
        """Squared distance to the estimate in standard errors."""
        return float(self.distance @ self.distance)


@dataclass(frozen=True, eq=False)
class Nearest:
    """The least `chi_square` of all possible unknowns, and what holds them there.

    `values` (p,) are those of the estimate's combinations. `ranks` (n,) of the pseudo-inertias
    where the data push against their bound, 4 where they do not; `held` the inequalities that they
    push against.
    """

    values: Array
    chi_square: float
    ranks: tuple[int, ...]
    held: tuple[int, ...]


def root_of(covariance: Array, values: Array) -> Array:
    """Return root (p, p) with root @ root.T = covariance, invertible for every covariance.

    A standard error counts as 1e-10 of its value at least, and a combination of values that are in
    standard errors as 1e-10 of the largest: better is nothing known in double precision.
    """
    errors = np.sqrt(np.diag(covariance))
    scale = np.maximum(errors, 1e-10 * np.abs(values) + 1e-13)
    spread, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    spread = np.maximum(spread, 1e-10 * max(spread[-1], 1e-3))
    return np.asarray(scale[:, None] * vectors * np.sqrt(spread))


def nearest(programme: Programme) -> Nearest:
    """Return the possible values nearest to the estimate, by Clarabel's semidefinite cones.

    Raises IdentificationError without Clarabel, and with the solver's status where it fails.
    """
    p, count, bodies = len(programme.estimate), len(programme.bounds), len(programme.prior)
    triangles, constants = triangle_rows(*programme.cones)
    A = np.vstack([programme.slack[1], triangles])
    b = np.concatenate([programme.slack[0], constants])
    linear = _LEAST_TRACE * np.einsum("nfii->f", programme.cones[1])
    quadratic = np.where(np.arange(len(linear)) < p, 2.0, 0.0)
    x, dual = solve_cones(quadratic, linear, A, b, count, (4,) * bodies)
    return Nearest(
        values=programme.estimate + programme.root @ x[:p],
        chi_square=float(x[:p] @ x[:p]),
        ranks=_ranks(dual[count:].reshape(bodies, -1)),
        held=tuple(map(int, np.flatnonzero(dual[:count] > _PUSH))),
    )


def regularised(programme: Programme, weight: float) -> Possible:
    """Return the possible unknowns that minimise chi-square + weight times the divergence.

    The divergence of a body from the prior is tr Q - log det Q - 4, with Q its pseudo-inertia
    where the prior's is 1. Clarabel's point is improved by Newton's method, to rounding. Raises
    IdentificationError as `nearest` does, and where Newton's method does not end.
    """
    x = _cone_point(programme, weight)
    x += _INWARDS * (programme.coordinates(programme.start) - x)
    value, gradient, hessian = _merit(programme, x, weight)
    for _ in range(_MOST_STEPS if np.isfinite(value) else 0):
        step = -_inverse_times(hessian, gradient)
        decrement = -float(gradient @ step)
        if decrement <= max(1e-9 * min(weight, 1.0), 1e-13 * abs(value)):
            return _possible(programme, x, weight, hessian)
        x, (value, gradient, hessian) = _descend(programme, x, weight, step, value, decrement)
    raise IdentificationError(
        f"the bodies nearest to the prior with weight {weight:.3g} were not found in {_MOST_STEPS} "
        "steps: check that the covariance of the estimate is finite and the bounds are not extreme"
    )


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


def least_spread(covariance: Array, white: Array) -> Array:
    """Return the covariance with no combination known better than noise that is white allows.

    A long-run covariance from a finite record is far too small in its smallest directions, and
    they would decide what is nearest. `white` (p, p) is positive definite.
    """
    ratios, vectors = linalg.eigh(covariance, white)
    half = white @ vectors * np.sqrt(np.maximum(ratios, 1.0))
    return np.asarray(half @ half.T)


def _risk(one: Possible) -> float:
    return one.risk


def _cone_point(programme: Programme, weight: float) -> Array:
    """Return (u, free unknowns) near the minimum of `regularised`.

    log det Q is the largest sum of log Z_kk over lower triangles Z with [[Q, Z], [Z.T, diag Z]]
    positive semidefinite.
    """
    p, f = programme.columns.shape
    first, blocks = programme.cones
    bodies = len(first)
    lower = [(row, column) for row in range(4) for column in range(row + 1)]
    size = f + 14 * bodies  # ten entries of Z and four logarithms a body
    offset, matrix = np.zeros((bodies, 8, 8)), np.zeros((bodies, size, 8, 8))
    offset[:, :4, :4], matrix[:, :f, :4, :4] = first, blocks
    logarithms = np.zeros((4 * bodies, 3, size))
    logarithms[range(4 * bodies), 0, range(f + 10 * bodies, size)] = 1.0
    for body in range(bodies):
        for place, (row, column) in enumerate(lower, f + 10 * body):
            matrix[body, place, row, 4 + column] = matrix[body, place, 4 + column, row] = 1.0
            if row == column:
                matrix[body, place, 4 + row, 4 + row] = 1.0
                logarithms[4 * body + row, 2, place] = 1.0
    triangles, constants = triangle_rows(offset, matrix)
    A = np.pad(programme.slack[1], ((0, 0), (0, size - f)))
    A = np.vstack([A, triangles, logarithms.reshape(-1, size)])
    b = np.concatenate([programme.slack[0], constants, np.tile([0.0, 1.0, 0.0], 4 * bodies)])
    linear = np.zeros(size)
    linear[:f] = np.einsum("nfii->f", blocks)
    linear[f + 10 * bodies :] = -1.0
    quadratic = np.where(np.arange(size) < p, 2 / weight, 0.0)
    count = len(programme.bounds)
    return solve_cones(quadratic, linear, A, b, count, (8,) * bodies, 4 * bodies)[0][:f]


def _ranks(dual: Array) -> tuple[int, ...]:
    """Return the ranks that the pseudo-inertias are pushed to, from the cones' multipliers."""
    rows, columns = upper_triangle(4)
    multipliers = np.zeros((len(dual), 4, 4))
    scale = np.where(rows == columns, 1.0, np.sqrt(0.5))
    multipliers[:, rows, columns] = multipliers[:, columns, rows] = dual * scale
    return tuple(int(4 - np.sum(np.linalg.eigvalsh(one) > _PUSH)) for one in multipliers)


def _merit(programme: Programme, x: Array, weight: float) -> tuple[float, Array, Array]:
    """Return value, gradient and Hessian of what `regularised` minimises; infinite outside."""
    p = len(programme.estimate)
    (first, blocks), (offset, matrix) = programme.cones, programme.slack
    Q, slack = first + np.tensordot(x, blocks, (0, 1)), offset + matrix @ x
    nothing = np.empty(0)
    if np.any(slack <= 0):
        return np.inf, nothing, nothing
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(Q))
    except np.linalg.LinAlgError:
        return np.inf, nothing, nothing
    divergence = np.trace(Q, axis1=1, axis2=2) - 4
    divergence += 2 * np.sum(np.log(np.diagonal(inverse, axis1=1, axis2=2)), axis=1)
    value = x[:p] @ x[:p] + weight * np.sum(divergence) - _BARRIER * np.sum(np.log(slack))
    whitened = inverse[:, None] @ blocks @ inverse.transpose(0, 2, 1)[:, None]
    gradient = weight * np.einsum("nfii->f", blocks) - weight * np.einsum("nfii->f", whitened)
    gradient -= _BARRIER * (matrix.T @ (1 / slack))
    gradient[:p] += 2 * x[:p]
    flat = whitened.transpose(0, 2, 3, 1).reshape(-1, len(x))
    steep = matrix / slack[:, None]
    hessian = weight * flat.T @ flat + _BARRIER * steep.T @ steep
    hessian[range(p), range(p)] += 2
    return float(value), gradient, hessian


def _descend(
    programme: Programme, x: Array, weight: float, step: Array, value: float, decrement: float
) -> tuple[Array, tuple[float, Array, Array]]:
    """Return the point along a Newton step that is inside and lower, and the merit there."""
    length = 1.0
    while length > 1e-12:
        merit = _merit(programme, x + length * step, weight)
        if merit[0] <= value - 1e-4 * length * decrement + 1e-13 * abs(value):
            return x + length * step, merit
        length *= 0.5
    raise IdentificationError(
        f"no step towards the bodies nearest to the prior goes down (weight {weight:.3g}, "
        f"decrement {decrement:.1e}): check that the covariance of the estimate is finite"
    )


def _inverse_times(hessian: Array, columns: Array) -> Array:
    """Solve with a Hessian whose unknowns are of different sizes."""
    scale = 1 / np.sqrt(np.diag(hessian))
    balanced = hessian * np.outer(scale, scale) + _RIDGE * np.eye(len(hessian))
    factor = linalg.cho_factor(balanced, check_finite=False)
    columns = (scale * columns.T).T
    return np.asarray((scale * linalg.cho_solve(factor, columns, check_finite=False).T).T)


def _possible(programme: Programme, x: Array, weight: float, hessian: Array) -> Possible:
    p = len(programme.estimate)
    offset, matrix = programme.span
    freedom = 2 * np.trace(_inverse_times(hessian, np.eye(len(x), p))[:p])
    return Possible(
        unknowns=offset + matrix @ x,
        values=programme.estimate + programme.root @ x[:p],
        distance=x[:p],
        weight=weight,
        freedom=float(freedom),
        risk=float(x[:p] @ x[:p] + 2 * freedom - p),
    )
