"""Physically consistent parameters near an estimate and a prior, by a semidefinite program.

Every pseudo-inertia is positive semidefinite (Sousa and Cortesao 2014; Wensing, Kim and Slotine
2018) and linear inequalities hold, in one convex program on the estimate and its covariance.

The unknowns are standard parameters and drive parameters, of which the estimate determines fewer
combinations. The objective is |u|^2 with estimate + root u, a chi-square in standard errors, plus
a weight times the log-det divergence from the prior (Lee, Wensing and Park 2020). Its minimum is
unique and inside the cones: it is the point of the central path of the semidefinite program at
which every complementary product equals the weight, so a primal-dual interior-point method ends
there. `regularised` returns it, and `of_least_risk` chooses the weight.

`minimum` minimises chi-square + weight (tr Q - log det Q), with the bodies Q positive definite
and the slacks positive, by a primal-dual interior-point method: HKM direction (Helmberg, Rendl,
Vanderbei and Wolkowicz 1996), Mehrotra's (1992) predictor and corrector, and one step length for
all parts. It is guarded against rounding:

- Newton's equations are solved as least squares, J x = -r, never as J^T J, whose condition number
  is the square; none of their matrices can fail to be positive definite.
- A step is taken only if the triangular factors of the new point exist.
- Neither weight nor barrier falls below 1e-9 of chi-square, so that the eigenvalues of a
  complementary pair are not further apart than double precision can represent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np
from scipy import linalg

from seaid._arrays import Array, IndexArray, finite, safely
from seaid.errors import IdentificationError
from seaid.robot import is_physical
from seaid.robot.inertia import from_pseudo_inertia, pseudo_inertia


@dataclass(frozen=True, eq=False)
class Program:
    """An estimate of combinations of f unknowns, the first 10n of which are n bodies.

    `columns` (p, f) @ unknowns is estimated by `estimate` (p,) with covariance `root` @ `root`.T;
    the `pivots` (p,) are unknowns whose columns are those of the identity. `prior` (n, 10) are
    physically consistent bodies with mass in every direction; `limits` (c, f) @ unknowns >=
    `bounds` (c,); `start` (f,) is strictly feasible.
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
        shapes = {"columns": (p, f), "estimate": (p,), "root": (p, p), "prior": (None, 10)}
        shapes |= {"limits": (None, f), "bounds": (len(self.limits),), "start": (f,)}
        for name, shape in shapes.items():
            value = finite(name, getattr(self, name), shape, IdentificationError)
            object.__setattr__(self, name, value)

    @cached_property
    def free(self) -> tuple[int, ...]:
        """The unknowns other than the pivots."""
        return tuple(sorted(set(range(self.columns.shape[1])) - set(self.pivots)))

    @cached_property
    def span(self) -> tuple[Array, Array]:
        """Offset (f,) and matrix (f, f): unknowns = offset + matrix @ (u, free unknowns).

        It is exact for every u and all free unknowns: the estimate changes by root @ u and nothing
        else.
        """
        p, f = self.columns.shape
        offset, matrix = np.zeros(f), np.zeros((f, f))
        # columns[:, pivots] = 1, so that x_pivots = estimate + root u - columns[:, free] x_free.
        pivots, free = list(self.pivots), list(self.free)
        offset[pivots] = self.estimate
        matrix[pivots, :p] = self.root
        matrix[pivots, p:] = -self.columns[:, free]
        matrix[free, range(p, f)] = 1.0
        return offset, matrix

    @cached_property
    def prior_roots(self) -> Array:
        """Triangular factors (n, 4, 4) of the prior's pseudo-inertias."""
        prior = np.array([pseudo_inertia(parameters) for parameters in self.prior])
        return np.asarray(safely(np.linalg.cholesky, prior, what="the bodies of the prior"))

    @cached_property
    def cones(self) -> tuple[Array, Array]:
        """Offset (n, 4, 4) and matrix (n, f, 4, 4) of the scaled pseudo-inertias Q."""
        offset, matrix = self.span
        basis = np.array([pseudo_inertia(unit) for unit in np.eye(10)])
        first, blocks = [], []
        for body, half in enumerate(np.linalg.inv(self.prior_roots)):
            # Q = L^-1 P L^-T is linear in the parameters of P; L L^T is P of the prior.
            units = half @ basis @ half.T
            span = slice(10 * body, 10 * body + 10)
            first.append(np.tensordot(offset[span], units, 1))
            blocks.append(np.tensordot(matrix[span].T, units, 1))
        return np.array(first), np.array(blocks)

    @cached_property
    def slack(self) -> tuple[Array, Array]:
        """Offset (c,) and matrix (c, f) of the slacks of the inequalities."""
        offset, matrix = self.span
        return self.limits @ offset - self.bounds, self.limits @ matrix

    def scaled(self, unknowns: Array) -> Array:
        """Return the pseudo-inertias Q (n, 4, 4) of unknowns (f,), the identity at the prior."""
        half = np.linalg.inv(self.prior_roots)
        inertias = [pseudo_inertia(x) for x in unknowns[: self.prior.size].reshape(-1, 10)]
        return np.asarray(half @ inertias @ half.transpose(0, 2, 1))

    def bodies(self, Q: Array) -> Array:
        """Return the parameters (n, 10) of scaled pseudo-inertias."""
        pseudo = self.prior_roots @ Q @ self.prior_roots.transpose(0, 2, 1)
        return np.array([from_pseudo_inertia(inertia) for inertia in pseudo])

    def coordinates(self, unknowns: Array) -> Array:
        """Return (u, free unknowns) of unknowns (f,)."""
        distance = self.columns @ unknowns - self.estimate
        return np.concatenate([_whitened(self.root, distance), unknowns[list(self.free)]])


def covariance_root(covariance: Array, values: Array) -> Array:
    """Return root (p, p) with root @ root.T = covariance, invertible for every covariance.

    A standard error counts as at least 1e-10 of its value, and a principal direction as at least
    1e-10 of the largest, the limits of double precision.
    """
    covariance = finite("covariance", covariance, (len(values),) * 2, IdentificationError)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.maximum(errors, 1e-10 * np.abs(values) + 1e-13)
    # Eigenvalues of the correlation, since parameters differ in unit and size.
    correlation = covariance / np.outer(scale, scale)
    spread, vectors = safely(np.linalg.eigh, correlation, what="the covariance")
    spread = np.maximum(spread, 1e-10 * np.max(spread, initial=1e-3))
    return np.asarray(scale[:, None] * vectors * np.sqrt(spread))


def _whitened(root: Array, values: Array) -> Array:
    """Return root^-1 values, for the root (p, p) of a covariance and values (p,) or (p, k).

    Its rows have the sizes of parameters of different units: without them it is well conditioned.
    """
    sizes = np.linalg.norm(root, axis=1)
    scaled = (root.T / sizes).T, (values.T / sizes).T
    return np.asarray(safely(linalg.solve, *scaled, what="the covariance", check_finite=False))


def floored_covariance(covariance: Array, white: Array) -> Array:
    """Return the covariance, in no direction smaller than that of white noise.

    A long-run covariance from a finite log is far too small in its smallest directions, which would
    dominate the distance. `white` (p, p) is that, without noise singular but for rounding.
    """
    root = covariance_root(white, np.zeros(len(white)))
    relative = _whitened(root, _whitened(root, covariance).T)
    # root^-1 covariance root^-T = V diag(ratios) V^T: white noise has the ratios 1.
    ratios, vectors = safely(np.linalg.eigh, relative, what="the covariance over white noise")
    half = root @ vectors * np.sqrt(np.maximum(ratios, 1.0))
    return np.asarray(half @ half.T)


BARRIER = 1e-6
"""Weight of the logarithmic barrier of a linear inequality: its cost in chi-square."""

RESOLVED = 1e-9
"""Part of chi-square below which neither a weight nor a barrier can be resolved."""

_SETTLED = 1e-9
"""Decrement of the merit, in units of the weight, at which the minimum is reached."""

_ROUNDING = 1e-11
"""The same as a part of chi-square, for points far from the estimate."""

_STALLED = 1e-2
"""Decrement of the merit, in units of the weight, that suffices once it stops falling."""

_STUCK, _LATE = 1e-3, 10
"""Step length, and number of final steps, at which rounding ends the search: then a decrement of
twice the weight suffices.
"""

_ATTEMPTS = ((RESOLVED, 1e-8), (1e2 * RESOLVED, 1e-5), (1e4 * RESOLVED, 1e-2))
"""Least parts: of weight and barrier in chi-square, and of the barrier in the weight."""

_MOST_STEPS = 200
"""Steps after which a search ends without a minimum."""

_MOST_CUTS = 50
"""Times that a step is halved to stay feasible: 2^-50 of it is near the rounding of doubles."""

_TO_THE_BOUNDARY = 0.9
"""Part of the way to the nearest boundary that a step goes: matrices stay positive definite, and
slacks positive."""

_LEAST_CENTRING = 1e-4
"""Least part of their mean that a corrected step aims the complementary products at, where the rule
of Mehrotra (1992), (1 - length)^3, gives less."""

_LONG = 0.3
"""Length of a corrected step up to which a smaller part of the second-order correction is tried
too."""

_APART = 1e4
"""Largest ratio of a complementary product to their mean that helps the next step."""


@dataclass(frozen=True, eq=False)
class Point:
    """(u, free unknowns), the bodies Q (n, 4, 4), slacks (c,), and the multipliers of both.

    The first `p` of the unknowns x are u; `roots` are the triangular factors of Q and of Z.
    """

    x: Array
    Q: Array
    slack: Array
    Z: Array
    multipliers: Array
    roots: tuple[Array, Array]
    p: int

    @cached_property
    def chi_square(self) -> float:
        """Squared distance to the estimate in standard errors."""
        return float(self.x[: self.p] @ self.x[: self.p])

    @cached_property
    def halves(self) -> tuple[Array, Array]:
        """Inverses of the roots."""
        first, second = (np.asarray(np.linalg.inv(root)) for root in self.roots)
        return first, second

    @cached_property
    def inverse(self) -> Array:
        """Inverses of the bodies."""
        return self.halves[0].transpose(0, 2, 1) @ self.halves[0]

    @cached_property
    def gaps(self) -> tuple[float, float]:
        """Mean complementary products of bodies and of inequalities."""
        bodies = float(np.sum(self.Q * self.Z)) / (4 * len(self.Q))
        return bodies, float(self.slack @ self.multipliers) / max(len(self.slack), 1)


@dataclass(frozen=True, eq=False)
class Minimum:
    """The minimising point, the weight that was resolved, and the `effective_parameters`."""

    point: Point
    weight: float
    effective_parameters: float


@dataclass(frozen=True, eq=False)
class _Step:
    """The change of each part of a point."""

    x: Array
    Q: Array
    slack: Array
    Z: Array
    multipliers: Array


@dataclass(frozen=True, eq=False)
class _System:
    """Newton's equations: J = basis @ factor @ permutation, columns in units of `scale`.

    `rows` is the order of the rows of J, the largest first: with it and with pivoted columns the
    factor is as accurate in small rows as in large ones (Cox and Higham 1998).
    """

    basis: Array
    factor: Array
    rows: IndexArray
    order: IndexArray
    scale: Array

    def solved(self, rest: Array) -> tuple[Array, float]:
        """Return x that minimises |J x + rest|, and |J x|^2."""
        along = self.basis.T @ rest[self.rows]
        x = np.empty_like(along)
        x[self.order] = linalg.solve_triangular(self.factor, along, check_finite=False)
        return -self.scale * x, float(along @ along)

    def variances(self) -> Array:
        """Return the diagonal of the inverse of J^T J."""
        inverse = np.empty_like(self.factor)
        unit = np.eye(len(self.factor))
        inverse[self.order] = linalg.solve_triangular(self.factor, unit, check_finite=False)
        return np.asarray(np.sum((self.scale[:, None] * inverse) ** 2, axis=1))


def minimum(program: Program, weight: float) -> Minimum:
    """Return the minimum of chi-square + weight times the divergence from the prior.

    A weight below 1e-9 of chi-square counts as that; if rounding prevents convergence, the limit is
    raised to 1e-7 and then 1e-5, with higher barriers. Raises IdentificationError if no attempt
    converges, and for numbers too large to be squared.
    """
    start = _start(program, weight)
    for resolved, relative in _ATTEMPTS:
        optimum = _search(program, weight, start, resolved, relative)
        if optimum is not None:
            return optimum
    raise IdentificationError(
        f"the physically consistent bodies nearest to the prior with weight {weight:.3g} were not "
        f"found: the search started {np.sqrt(start.chi_square):.3g} standard errors from the "
        "estimate and did not converge. Check payloads, known bodies and bounds against the data, "
        "or give wider bounds"
    )


def _search(
    program: Program, weight: float, point: Point, resolved: float, relative: float
) -> Minimum | None:
    """Return the minimum, None if the search does not converge.

    Neither weight nor barrier falls below the part `resolved` of chi-square, nor the barrier below
    the part `relative` of the weight, where rounding would dominate its slack.
    """
    used, before, late = np.inf, np.inf, 0
    for _ in range(_MOST_STEPS):
        least = resolved * point.chi_square
        # The weight in use only falls, with chi-square, and ends at the one asked for if it can.
        used = max(weight, min(used, least))
        final = used, max(BARRIER, least, relative * used)
        system = _system(program, point)
        step, decrement = _direction(program, used, point, system, final)
        is_centred = bool(np.all(np.array(point.gaps) <= 2 * np.array(final)))
        if not (is_centred and decrement <= used):
            step = _corrected(program, used, point, system, final, step)
        moved, length = _moved(program, point, step)
        late += is_centred
        is_stuck, is_stalled = length < _STUCK or late > _LATE, decrement > 0.1 * before
        if is_centred and decrement < _sufficient(used, point.chi_square, is_stuck, is_stalled):
            # With the estimate d and the Hessian J^T J, du/dd = 2 [(J^T J)^-1]_uu: its trace is the
            # number of values that follow the data.
            return Minimum(moved or point, used, 2 * float(np.sum(system.variances()[: point.p])))
        if moved is None:
            break
        point, before = moved, decrement if is_centred else np.inf
    return None


def _sufficient(used: float, chi_square: float, is_stuck: bool, is_stalled: bool) -> float:
    """Return the decrement of the merit at which a search has reached the minimum."""
    factor = 2.0 if is_stuck else _STALLED if is_stalled else 0.0
    return max(_SETTLED * used + _ROUNDING * chi_square, factor * used)


def _start(program: Program, weight: float) -> Point:
    """Return the point of the program's start, with multipliers that balance its merit."""
    with np.errstate(over="ignore", invalid="ignore"):
        x = program.coordinates(program.start)
        Q = program.scaled(program.start)
        slack = program.limits @ program.start - program.bounds
        u = x[: len(program.estimate)]
        # The duality gap of the start, sum tr(Z Q) = 4 n gap, is as large as its merit.
        gap = max(weight, float(u @ u + weight * np.einsum("nii->", Q)) / (4 * len(Q)))
    root = _root(Q) if np.isfinite(gap) else None
    if root is None or np.min(slack, initial=1.0) <= 0:
        raise IdentificationError(
            "physical consistency: estimate, standard errors, prior and bounds differ too much in "
            f"size to be compared: estimates up to {_largest(program.estimate)}, standard errors "
            f"up to {_largest(program.root)}, prior up to {_largest(program.prior)}; check "
            "their units"
        )
    half = np.linalg.inv(root)
    # Z Q = gap I: the start is centred, whatever the bodies are.
    Z = gap * half.transpose(0, 2, 1) @ half
    # R' R = half' half as of Cholesky, but QR cannot fail if Q is nearly singular
    triangle = np.linalg.qr(half, mode="r")
    signs = np.where(np.einsum("nii->ni", triangle) < 0, -1.0, 1.0)[:, :, None]
    dual = np.sqrt(gap) * (signs * triangle).transpose(0, 2, 1)
    return Point(x, Q, slack, Z, gap / slack, (root, dual), len(u))


def _largest(values: Array) -> str:
    return f"{np.max(np.abs(values), initial=0.0):.3g}"


def _inside(program: Program, x: Array) -> tuple[Array, Array]:
    """Return the bodies and the slacks of unknowns."""
    (first, blocks), (offset, matrix) = program.cones, program.slack
    return first + np.tensordot(x, blocks, (0, 1)), offset + matrix @ x


def _system(program: Program, point: Point) -> _System:
    blocks, matrix = program.cones[1], program.slack[1]
    f, (half, _), (_, dual) = len(point.x), point.halves, point.roots
    # J^T J has tr(A_i Z A_j Q^-1) = <F_i, F_j> (HKM) with F_i = R^-1 A_i D, Q = R R^T, Z = D D^T:
    # no product is inverted.
    flat = (half[:, None] @ blocks @ dual[:, None]).transpose(0, 2, 3, 1).reshape(-1, f)
    # Of the inequalities: multiplier / slack times a_i a_j.
    steep = np.sqrt(point.multipliers / point.slack)[:, None] * matrix
    J = np.concatenate([flat, steep, np.sqrt(2.0) * np.eye(point.p, f)])
    scale = 1 / np.linalg.norm(J, axis=0)
    J *= scale
    rows = np.argsort(-np.max(np.abs(J), axis=1), kind="stable")
    basis, factor, order = linalg.qr(
        J[rows], mode="economic", pivoting=True, overwrite_a=True, check_finite=False
    )
    return _System(basis, factor, rows, order, scale)


def _direction(
    program: Program,
    weight: float,
    point: Point,
    system: _System,
    targets: tuple[float, float],
    predictor: _Step | None = None,
    part: float = 1.0,
) -> tuple[_Step, float]:
    """Return the step to complementary products `targets`, and the decrement of the merit.

    `predictor` is a step of which `part` of the second-order terms is compensated (Mehrotra 1992).
    """
    blocks, matrix = program.cones[1], program.slack[1]
    (root, _), (half, inverse_dual) = point.roots, point.halves
    second_order, product = np.zeros_like(point.Q), np.zeros_like(point.slack)
    if predictor is not None:
        second_order = part * predictor.Z @ predictor.Q @ point.inverse
        product = part * predictor.slack * predictor.multipliers
    upper = root.transpose(0, 2, 1)
    # <F_i, pull> = tr A_i (weight I - target Q^-1 + second order): the slope of the merit.
    slope = weight * upper - targets[0] * half + upper @ second_order
    pull = slope @ inverse_dual.transpose(0, 2, 1)
    push = (product - targets[1]) / np.sqrt(point.multipliers * point.slack)
    rest = np.concatenate([pull.ravel(), push, np.sqrt(2.0) * point.x[: point.p]])
    x, decrement = system.solved(rest)
    Q, slack = np.tensordot(x, blocks, (0, 1)), matrix @ x
    # Z Q = target I, linearised for Z and made symmetric (HKM).
    product_change = second_order + point.Z @ Q @ point.inverse
    Z = (
        targets[0] * point.inverse
        - point.Z
        - 0.5 * (product_change + product_change.transpose(0, 2, 1))
    )
    multipliers = (targets[1] - product - point.multipliers * slack) / point.slack
    return _Step(x, Q, slack, Z, multipliers - point.multipliers), decrement


def _corrected(
    program: Program,
    weight: float,
    point: Point,
    system: _System,
    final: tuple[float, float],
    predictor: _Step,
) -> _Step:
    """Return Mehrotra's corrector: the more centred, the shorter the `predictor` step is.

    If the step with the whole second-order correction is short, a part of it or none is tried,
    and the longest step is taken.
    """
    reach = _length(point, predictor)
    centring = max((1 - reach) ** 3, _LEAST_CENTRING)  # Mehrotra 1992
    bodies, limits = (
        max(target, centring * gap) for target, gap in zip(final, point.gaps, strict=True)
    )
    best, longest = predictor, 0.0
    for part in (1.0, reach, 0.0):
        step, _ = _direction(program, weight, point, system, (bodies, limits), predictor, part)
        length = _length(point, step)
        if length > longest:
            best, longest = step, length
        if longest > _LONG:
            break
    return best


def _moved(program: Program, point: Point, step: _Step) -> tuple[Point | None, float]:
    """Return the point after a step shortened to stay feasible, None if too short; its length."""
    length = _length(point, step)
    for _ in range(_MOST_CUTS):
        x = point.x + length * step.x
        Q, slack = _inside(program, x)
        root = _root(Q)
        if root is None:  # the sum over x may be all rounding: add the exact change instead
            Q = point.Q + length * step.Q
            root = _root(Q)
        # For small slacks the sum over x is rounding too, where the change is exact.
        ahead = point.slack + length * step.slack
        slack = np.where(slack > 0.5 * ahead, slack, ahead)
        if root is not None and np.min(slack, initial=1.0) > 0:
            Z = point.Z + length * step.Z
            multipliers = point.multipliers + length * step.multipliers
            return _balanced(x, Q, slack, Z, multipliers, root, point.p), length
        length *= 0.5
    return None, 0.0


def _balanced(
    x: Array, Q: Array, slack: Array, Z: Array, multipliers: Array, root: Array, p: int
) -> Point:
    """Return the point with its complementary products limited to a range about their mean."""
    # Those of R^T Z R are the eigenvalues of Z Q, the complementary products.
    products, vectors = np.linalg.eigh(root.transpose(0, 2, 1) @ Z @ root)
    near = np.mean(products)
    products = np.clip(products, near / _APART, near * _APART)
    half = np.linalg.inv(root).transpose(0, 2, 1)
    dual = half @ vectors * np.sqrt(products)[:, None, :]
    near = float(slack @ multipliers) / max(len(slack), 1)
    multipliers = np.clip(multipliers, near / _APART / slack, near * _APART / slack)
    return Point(x, Q, slack, dual @ dual.transpose(0, 2, 1), multipliers, (root, dual), p)


def _root(matrices: Array) -> Array | None:
    """Return the Cholesky factors, None if a matrix is not positive definite."""
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        return None


def _length(point: Point, step: _Step) -> float:
    """Return the part of a step that keeps matrices positive definite and slacks positive."""
    steepest = 0.0
    # Q + s dQ stays positive definite for s below -1 over the least eigenvalue of R^-1 dQ R^-T.
    for half, change in zip(point.halves, (step.Q, step.Z), strict=True):
        ratios = np.linalg.eigvalsh(half @ change @ half.transpose(0, 2, 1))
        steepest = max(steepest, -float(np.min(ratios)))
    steepest = max(steepest, -float(np.min(step.slack / point.slack, initial=0.0)))
    steepest = max(steepest, -float(np.min(step.multipliers / point.multipliers, initial=0.0)))
    return float(min(1.0, _TO_THE_BOUNDARY / max(steepest, 1e-300)))


# The weight of the prior

WEIGHTS = tuple(10.0**decade for decade in range(4, -7, -1))
"""Weights of the prior among which the data select, in units of chi-square.

The least adds at most 4e-6 per body to chi-square: it determines only what the data leave free.
"""

_EQUAL_WEIGHT = 1.0
"""Weight with which the divergence of a body from the prior counts as much as chi-square."""

_ACTIVE = 1e-3
"""A bound counts as active when its multiplier (slope of chi-square per unit of the bound) exceeds
this, and a body as flat where its pseudo-inertia is also below this part of the prior's.
"""


@dataclass(frozen=True, eq=False)
class FeasiblePoint:
    """Physically consistent unknowns (f,), their `values` (p,) in the estimate, and the distance.

    `distance` (p,) is u, with chi-square |u|^2. `effective_parameters` is the number of the p
    values that the data determine under a prior of this `weight`; `risk` is Stein's unbiased
    estimate of the expected squared distance to the truth. `ranks` (n,) are those of the
    pseudo-inertias without the directions in which the cone is active, 4 if none; `active_bounds`
    are the active inequalities.
    """

    unknowns: Array
    values: Array
    distance: Array
    weight: float
    effective_parameters: float
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
        effective_parameters=optimum.effective_parameters,
        risk=float(u @ u + 2 * optimum.effective_parameters - point.p),  # Stein 1981
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


def of_least_risk(
    program: Program, least: float, weights: Sequence[float] = WEIGHTS
) -> FeasiblePoint:
    """Return `regularised` with the weight of least estimated risk.

    The risk is Stein's (1981) unbiased estimate of the expected squared distance to the truth, in
    standard errors: |u|^2 + 2 effective parameters - p. Unlike cross-validation it needs no
    independent folds, so it holds for autocorrelated noise. The weights are tried in falling order,
    as far as they can be resolved relative to `least`, the chi-square of `nearest`, and until no
    smaller risk is possible; then the midpoints to the neighbours of the best. A weight below 1,
    under which bodies may be many times as heavy as those of the prior, must lower the risk by more
    than the standard deviation of chi-square over p values.
    """
    resolved = [weight for weight in weights if weight >= RESOLVED * least] or [weights[0]]
    tried = _falling_fits(program, least, resolved)
    best = min(tried, key=attrgetter("risk"))
    if best.weight < _EQUAL_WEIGHT:
        # Chi-square over p values has the variance 2 p.
        highest = best.risk + math.sqrt(2 * len(program.estimate))
        likely = [fit for fit in tried if fit.risk <= highest]
        # Weights from 1 up count alike; of these `max` takes the first, which is the largest.
        return max(likely, key=lambda point: min(point.weight, _EQUAL_WEIGHT))
    around = best.weight * 10**0.5, best.weight / 10**0.5
    inner = [weight for weight in around if resolved[-1] < weight < resolved[0]]
    return min([best, *(regularised(program, x) for x in inner)], key=attrgetter("risk"))


def _falling_fits(program: Program, least: float, weights: Sequence[float]) -> list[FeasiblePoint]:
    """Return `regularised` with the weights in falling order, until no smaller risk is possible."""
    fits = [regularised(program, weights[0])]
    for weight in weights[1:]:
        fits.append(regularised(program, weight))
        # |u|^2 is at least that of `nearest`, and more parameters follow the data as the weight
        # falls: a bound of the risk of the others.
        bound = least + 2 * fits[-1].effective_parameters - len(program.estimate)
        if bound > min(fit.risk for fit in fits):
            break
    return fits
