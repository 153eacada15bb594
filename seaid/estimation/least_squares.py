"""Ordinary and weighted least squares, solved from a `QRFactor` on scaled columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from seaid._arrays import Array, safely
from seaid.errors import ExcitationError, IdentificationError
from seaid.estimation.covariance import LongRun, left_by_fit, left_of_mean, long_run_of
from seaid.estimation.drift import agreement, block_factors, drifts_of, spans_of, with_drifts
from seaid.estimation.estimate import Diagnostics, Estimate
from seaid.estimation.qr_factor import (
    RANK_TOLERANCE,
    Directions,
    QRFactor,
    combined,
    determining_joints,
    directions,
    first_term,
    qr_factor_of,
)

if TYPE_CHECKING:
    from seaid.regressor import Regression

_LARGEST_PRODUCTS = 1e8
"""Number of entries of `Orthonormal.products`, 0.8 GB, above which they are not stored."""

_MOST_UNEQUAL = 1e4
"""Ratio of the weights up to which the normal equations of `Orthonormal` are accurate."""


@dataclass(frozen=True, eq=False)
class Orthonormal:
    """The equations in coordinates in which the rows of all of them together are orthonormal.

    With R the factor of all rows and theta_0 its solution, z = R (theta - theta_0): the residual of
    an equation is `residuals` (E, m) - `columns` (E, m, p) z. However badly conditioned the
    regressor is, the condition number of the weighted normal equations in z is at most the square
    of the ratio of the weights, so that residuals for other weights are cheap and accurate.
    """

    columns: Array
    residuals: Array

    @cached_property
    def products(self) -> Array | None:
        """The products C^T C (E, p, p) of the columns C, which add up to the identity.

        None if they would be larger than the memory that is spent on them.
        """
        equations, _, p = self.columns.shape
        if equations * p * p > _LARGEST_PRODUCTS:
            return None
        return self.columns.swapaxes(1, 2) @ self.columns

    def _normal(self, weights: Array) -> Array:
        """Return the matrix (p, p) of the weighted normal equations, its upper triangle."""
        if self.products is not None:
            return np.tensordot(weights**2, self.products, 1)
        weighted = (weights[:, None, None] * self.columns).reshape(-1, self.columns.shape[2])
        return np.asarray(linalg.blas.dsyrk(1.0, weighted.T))

    def residual_norms(self, weights: Array) -> Array | None:
        """Return the norm (E,) of each equation's residual at the estimate with weights (E,).

        None if the weights are too unequal for the normal equations.
        """
        if np.max(weights) > _MOST_UNEQUAL * np.min(weights):
            return None
        # sum w_e^2 C_e^T C_e z = sum w_e^2 C_e^T r_e. assume_a="pos" reads the upper triangle only,
        # which is all that dsyrk has written.
        z = safely(
            linalg.solve,
            self._normal(weights),
            np.einsum("e,emp,em->p", weights**2, self.columns, self.residuals, optimize=True),
            what="the weighted equations",
            assume_a="pos",
            check_finite=False,
        )
        return np.asarray(np.linalg.norm(self.residuals - self.columns @ z, axis=1))


def orthonormal(qr_factor: QRFactor, theta: Array) -> Orthonormal:
    """Return the equations of a QR factor whose unweighted solution is `theta` (p,), p > 0."""
    p = len(qr_factor.names)
    factors = qr_factor.factors
    R = qr_factor.weighted_factor()[:p, :p]
    residuals = factors @ np.append(-theta, 1.0)
    stacked = factors[:, :, :p].reshape(-1, p)
    # C = H R^-1 by R^T C^T = H^T.
    columns = safely(
        linalg.solve_triangular, R, stacked.T, what="the equations", trans="T", check_finite=False
    ).T
    return Orthonormal(columns.reshape(*factors.shape[:2], p), residuals)


_ROUNDING = 1e-9
"""A residual below this part of the target is rounding, or an iteration's remainder."""

MOST_INSTANTS = 4000
"""Instants beyond which the part of the variance that the fit removes is small: approximated."""

_MOST_REWEIGHTINGS = 1000
"""Reweightings after which a fit is refused. Weights that settle slowly are given the time: one
takes a fraction of a millisecond."""

_PLAIN_REWEIGHTINGS = 48
"""Reweightings after which every third is extrapolated. Most weights are settled after 10; where
the likelihood is flat, the plain iteration would need some thousand."""

_MOST_NAMED = 3
"""Unidentifiable combinations that an error writes out; of the others it has the number."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Least-squares `values` (p,), a root (p, p) of the inverse of H^T W^2 H, condition number.

    The condition number is that of the weighted regressor with columns scaled to unit norm.
    """

    values: Array
    root: Array
    condition_number: float

    @property
    def inverse(self) -> Array:
        """The inverse (p, p) of H^T W^2 H."""
        return np.asarray(self.root @ self.root.T)


def ordinary(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return the ordinary least-squares estimate, with a Newey-West covariance.

    `propagated` (s, s) is the covariance of the s values from which the targets were computed; see
    `Regression`. Raises IdentificationError for fewer rows than parameters and ExcitationError if
    the data leave a combination of parameters unidentifiable.
    """
    parts = factored(rows, propagated)
    return estimate_of_rows(parts, equal_weights(parts.whole))


def weighted(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return the least-squares estimate with each equation weighted by its residual.

    Iterated until the weights converge (Gautier 1997; Swevers et al. 1997). Otherwise as
    `ordinary`.
    """
    parts = factored(rows, propagated)
    return estimate_of_rows(parts, settled_weights(parts.whole))


def equal_weights(qr_factor: QRFactor) -> Array:
    """Return weights (E,) of one."""
    return np.ones(len(qr_factor.equations))


HOMOGENEOUS = 0.7
"""An equation is homogeneous if its residual is larger than this part of its torque: half of the
torque's power or more is unexplained, so that zero fits it about as well as the estimate."""

_MOST_GROWTH = 1.25
"""Weights are refused that make the residual of an equation grow by more than this. To the right
weights it grows by sqrt(n / (n - p)), 1.1 for n = 6 p rows."""


def settled_weights(qr_factor: QRFactor) -> Array:
    """Return the converged weights (E,), relative to the equation of largest residual.

    A homogeneous equation, such as that of a joint without a motor, would be fitted ever better by
    ever smaller parameters, since noise in its columns makes zero fit better than the truth. If the
    weights end there at the expense of another equation, they are bounded by those of the
    unweighted residuals.
    """
    p = len(qr_factor.names)
    theta = solve(qr_factor, equal_weights(qr_factor)).values
    equations = orthonormal(qr_factor, theta) if p else None
    first = qr_factor.residual_norms(theta)
    weights, norms = _settled(qr_factor, equations, first, np.zeros_like(first))
    torques = np.linalg.norm(qr_factor.factors[:, :, -1], axis=1)
    is_homogeneous = (norms > HOMOGENEOUS * torques) & (norms < first)
    if np.any(is_homogeneous) and np.any(norms > _MOST_GROWTH * first):
        weights, _ = _settled(qr_factor, equations, first, np.where(is_homogeneous, first, 0.0))
    return weights


def weights_at(qr_factor: QRFactor, theta: Array) -> Array:
    """Return the weights (E,) by the residuals at an estimate (p,), relative to the largest."""
    target = np.linalg.norm(qr_factor.factors[:, :, -1]) / np.sqrt(max(qr_factor.count, 1))
    std = qr_factor.residual_norms(theta) / np.sqrt(np.maximum(qr_factor.counts, 1))
    std = np.maximum(std, _ROUNDING * max(float(target), 1e-300))
    return np.asarray(np.max(std) / std)


def _settled(
    qr_factor: QRFactor, equations: Orthonormal | None, norms: Array | None, least: Array
) -> tuple[Array, Array]:
    """Return the converged weights (E,) and residual norms, from the norms without weights.

    Norms below `least` (E,) count as that.
    """
    weights, residual_norms = equal_weights(qr_factor), np.asarray(norms)
    root_counts = np.sqrt(np.maximum(qr_factor.counts, 1))
    target = np.linalg.norm(qr_factor.factors[:, :, -1]) / np.sqrt(max(qr_factor.count, 1))
    last: list[Array] = []
    for iteration in range(_MOST_REWEIGHTINGS):
        # The weights are too unequal for the normal equations: the QR factor of all rows is solved.
        if norms is None:
            norms = qr_factor.residual_norms(solve(qr_factor, weights).values)
        residual_norms = norms
        std = np.maximum(norms, least) / root_counts
        largest = float(np.max(std))
        # Without noise the residuals are rounding, and so would be the weights.
        if largest <= _ROUNDING * target:
            break
        new = largest / np.maximum(std, _ROUNDING * target)
        settled = np.allclose(new, weights, rtol=1e-6)
        weights = new
        if settled or equations is None:  # without parameters, residuals are as they are
            break
        norms = equations.residual_norms(weights)
        last = [*last[-2:], np.log(weights)]
        if iteration >= _PLAIN_REWEIGHTINGS and iteration % 3 == 0 and norms is not None:
            norms = _further_norms(equations, last, norms, qr_factor.counts)
    else:
        raise IdentificationError(
            f"the weights of the joints did not converge in {_MOST_REWEIGHTINGS} iterations: a "
            "joint has too few rows; record a longer log, or use estimator='ols'",
            "estimator='ols'",
        )
    return weights, residual_norms


def _further_norms(
    equations: Orthonormal, last: Sequence[Array], norms: Array, counts: Sequence[int]
) -> Array:
    """Return the residual norms (E,) where the `last` three weights lead, if they are more likely.

    Else the present `norms`.
    """
    led = extrapolated(last)
    further = equations.residual_norms(
        np.exp(np.clip(led - np.max(led), -np.log(_MOST_UNEQUAL), 0.0))
    )
    # -2 log L = 2 sum_e n_e log |r_e| + constant falls towards the settled weights.
    if further is None or not np.dot(counts, np.log(further / norms)) < 0:
        return norms
    return further


def extrapolated(last: Sequence[Array] | Array) -> Array:
    """Return where three successive values (3, p) of a slow iteration lead, in comparable units.

    Scheme S3 of squared extrapolation (Varadhan and Roland 2008).
    """
    first, second, third = last
    step, curvature = second - first, third - 2 * second + first
    length = -np.linalg.norm(step) / max(float(np.linalg.norm(curvature)), 1e-300)
    return np.asarray(first - 2 * length * step + length**2 * curvature)


def solve(qr_factor: QRFactor, weights: Array) -> Solution:
    """Return the least-squares solution with the rows of each equation times its weight (E,).

    Raises IdentificationError for fewer rows than parameters, and ExcitationError that names the
    unidentifiable combinations of parameters and the joints that would excite them.
    """
    count, p = qr_factor.count, len(qr_factor.names)
    if count < p:
        still = f" ({qr_factor.excluded} more are near standstill)" * bool(qr_factor.excluded)
        raise IdentificationError(
            f"{count} rows{still} cannot determine {p} parameters: record a longer log"
            f"{' with more motion' if still else ''}, or raise cutoff_hz"
        )
    R = qr_factor.weighted_factor(weights)
    dead = np.flatnonzero(np.linalg.norm(R[:p, :p], axis=0) == 0)
    if len(dead):
        names = ", ".join(first_term(qr_factor.names[place]) for place in dead)
        raise ExcitationError(f"the motion does not excite {names}: move these joints")
    combinations = directions(R, qr_factor.names)
    worst = float(combinations.shares[-1]) if p else 1.0
    if worst < RANK_TOLERANCE:
        raise ExcitationError(_unidentifiable(qr_factor, combinations), "torque_joints=")
    # R = U S V^T N with the norms N of the columns: half = N^-1 V S^-1 is a root of (R^T R)^-1, and
    # theta = half U^T y.
    half = (combinations.svd.vectors.T / combinations.svd.sizes) / combinations.svd.norms[:, None]
    return Solution(half @ (combinations.svd.left.T @ R[:p, p]), half, 1 / worst)


def estimate_of(
    qr_factor: QRFactor,
    weights: Array,
    scores: LongRun | None = None,
    propagated: Array | None = None,
    solution: Solution | None = None,
    left: Array | None = None,
) -> Estimate:
    """Return the estimate with weights (E,) of the equations, from the QR factor alone.

    `scores` is the long-run covariance of the scores of all rows (see `score_factors`); None: as if
    the noise of every equation were white. `left` (p,) is that of `left_by_fit`, by default
    approximated. `propagated` (s, s) as in `ordinary`. `solution` is that of `solve` if it is known
    already.
    """
    solution = solve(qr_factor, weights) if solution is None else solution
    inverse, theta = solution.inverse, solution.values
    # The sandwich (H^T W^2 H)^-1 S (H^T W^2 H)^-1 with S the covariance of the sum of scores.
    white = inverse @ _white(qr_factor, weights, theta) @ inverse
    # The factor n / (n - p), with n the number of independent rows.
    white *= qr_factor.count / max(qr_factor.count - len(theta), 1.0)
    covariance, freedom, independent = white, np.inf, np.inf
    if scores is not None:
        freedom = scores.degrees_of_freedom
        independent = qr_factor.count / max(scores.inflation(inverse), 1.0)
        if left is None:
            # Alike for all: what Bartlett sums about a mean lose, and the fit of p parameters.
            rest = max(1 - len(theta) / independent, 1 / independent)
            left = np.full(len(theta), left_of_mean(scores.bandwidth) * rest)
        # Divided in rows and in columns: correlations stay, and the matrix remains positive.
        covariance = inverse @ scores.covariance @ inverse / np.sqrt(np.outer(left, left))
    squares = float(np.sum(qr_factor.residual_norms(theta) ** 2))
    estimate = Estimate(
        names=qr_factor.names,
        values=theta,
        covariance=0.5 * (covariance + covariance.T),
        units=qr_factor.units,
        residual_std=float(np.sqrt(squares / qr_factor.count)),
        condition_number=solution.condition_number,
        white_standard_errors=np.sqrt(np.diag(white)),
        degrees_of_freedom=np.full(len(theta), freedom),
        diagnostics=Diagnostics(independent, len(theta)),
    )
    return _with_targets(qr_factor, weights, solution, estimate, propagated)


def score_factors(rows: Regression, qr_factor: QRFactor, weights: Array, theta: Array) -> Array:
    """Return the factor (R,) that makes a row of H its score: weight squared times residual."""
    weight = weights[np.searchsorted(qr_factor.equations, rows.joint)]
    return np.asarray(weight**2 * (rows.y - rows.H @ theta))


def _white(qr_factor: QRFactor, weights: Array, theta: Array) -> Array:
    """Return the covariance (p, p) of the sum of scores for white noise in each equation."""
    p = len(qr_factor.names)
    std = qr_factor.residual_norms(theta) / np.sqrt(np.maximum(qr_factor.counts, 1))
    # S = sum over equations of w^4 s^2 H_e^T H_e, and H_e^T H_e = R_e^T R_e.
    stack = np.concatenate((weights**2 * std)[:, None, None] * qr_factor.factors[:, :, :p])
    return np.asarray(stack.T @ stack)


@dataclass(frozen=True, eq=False)
class Factored:
    """Rows by their QR factors: each row is factored once, in its block.

    `propagated` is as in `ordinary`, and `wide` are the rows `with_propagated`; `blocks` are log
    and QR factor of the blocks of these, `joined` that of all blocks, and `whole` that without the
    propagated columns.
    """

    rows: Regression
    propagated: Array | None
    wide: Regression
    blocks: list[tuple[int, QRFactor]]
    joined: QRFactor
    whole: QRFactor


def factored(rows: Regression, propagated: Array | None = None) -> Factored:
    """Return the QR factors of rows, with the covariance `propagated` as in `ordinary`.

    Raises IdentificationError if the rows are not finite.
    """
    wide = with_propagated(rows, propagated)
    blocks = block_factors([wide], spans_of(wide))
    # Rows that are none have no blocks, but columns.
    none = qr_factor_of(wide, np.zeros(0, dtype=np.intp))
    joined = combined([none, *(block for _, block in blocks)])
    whole = replace(joined.without(wide.names[len(rows.names) :]), excluded=rows.excluded)
    return Factored(rows, propagated, wide, blocks, joined, whole)


def estimate_of_rows(parts: Factored, weights: Array, cutoff_hz: float | None = None) -> Estimate:
    """Return the estimate with weights (E,) of the equations, from rows and their QR factors.

    With the `cutoff_hz` of the rows their drift is in its covariance.
    """
    rows, qr_factor, propagated = parts.rows, parts.whole, parts.propagated
    solution = solve(qr_factor, weights)
    # Scores are of the noise alone: the errors of the propagated parameters are the same in all
    # rows, and their covariance is added at the end.
    noise = residual_fit(parts.joined, weights, solution)
    factors = score_factors(parts.wide, qr_factor, weights, noise)
    scores = long_run_of(rows.H, factors, rows.time, rows.run)
    short = scores.instants <= MOST_INSTANTS
    remaining = left_of(rows, weights, qr_factor, solution) if short else None
    # `propagated` comes after the enlargement by blocks, which all have its errors in common.
    initial = estimate_of(qr_factor, weights, scores, None, solution, remaining)
    fits = solution, noise
    enlarged = with_blocks(qr_factor, weights, fits, initial, parts.blocks, propagated)
    return with_drifts_of(rows, weights, solution, enlarged, cutoff_hz) if short else enlarged


def with_drifts_of(
    rows: Regression,
    weights: Array,
    solution: Solution,
    estimate: Estimate,
    cutoff_hz: float | None,
) -> Estimate:
    """Return the estimate with the drift of rows in its covariance, if they have a cutoff."""
    if cutoff_hz is None or not np.isfinite(cutoff_hz):
        return estimate
    return with_drifts(estimate, solution.inverse, drifts_of(rows, weights, cutoff_hz))


def with_blocks(
    qr_factor: QRFactor,
    weights: Array,
    fits: tuple[Solution, Array],
    estimate: Estimate,
    blocks: list[tuple[int, QRFactor]],
    propagated: Array | None,
) -> Estimate:
    """Return the estimate, its covariance enlarged where blocks disagree, and by `propagated`.

    `fits` are the solution and that of `residual_fit`.
    """
    solution, noise = fits
    # A block need not have rows of every equation.
    factors = [
        (log, block.weighted_factor(weights[np.searchsorted(qr_factor.equations, block.equations)]))
        for log, block in blocks
    ]
    degrees = estimate.degrees_of_freedom
    freedom = np.inf if degrees is None else float(np.min(degrees, initial=np.inf))
    variance = np.diag(estimate.covariance)
    ratios, count = agreement(factors, noise, solution.root, variance, freedom)
    scale = np.sqrt(np.maximum(ratios, 1.0))
    # An enlarged variance is that between the blocks, and has their degrees of freedom.
    fewer = np.where(scale > 1, float(count - 1), np.inf)
    worst = float(np.max(ratios, initial=1.0))
    enlarged = replace(
        estimate,
        covariance=estimate.covariance * np.outer(scale, scale),
        degrees_of_freedom=np.minimum(freedom, fewer),
        diagnostics=replace(estimate.diagnostics, scatter=worst, blocks=count),
    )
    return _with_targets(qr_factor, weights, solution, enlarged, propagated)


def _with_targets(
    qr_factor: QRFactor,
    weights: Array,
    solution: Solution,
    estimate: Estimate,
    propagated: Array | None,
) -> Estimate:
    """Return the estimate with the covariance `propagated` from its targets, if any."""
    if propagated is None or not qr_factor.propagated.shape[2]:
        return estimate
    # d theta = (H^T W^2 H)^-1 H^T W^2 C d for an error d of the propagated parameters.
    sensitivity = solution.inverse @ np.einsum("e,eps->ps", weights**2, qr_factor.propagated)
    from_targets = sensitivity @ propagated @ sensitivity.T
    white = estimate.white_standard_errors
    assert white is not None
    return replace(
        estimate,
        covariance=estimate.covariance + 0.5 * (from_targets + from_targets.T),
        white_standard_errors=np.sqrt(white**2 + np.diag(from_targets)),
    )


def with_propagated(rows: Regression, propagated: Array | None) -> Regression:
    """Return the rows with the propagated columns C in H: their errors are no noise.

    The columns are those of independent errors u of variance one: C L, L L^T = `propagated`.
    """
    if propagated is None:
        return rows
    # By eigenvalues and not by Cholesky: the covariance may be singular.
    sizes, vectors = safely(np.linalg.eigh, propagated, what="the propagated covariance")
    root = vectors * np.sqrt(np.maximum(sizes, 0.0))
    columns, s = rows.propagated @ root, root.shape[1]
    return rows.with_columns(map(str, range(s)), s * [""], columns)


_MOST_DEVIATIONS = 3.0
"""Largest error of a propagated parameter that counts as such, in its standard deviations."""


def residual_fit(qr_factor: QRFactor, weights: Array, solution: Solution) -> Array:
    """Return (theta, u) whose residual is the noise, of rows `with_propagated`.

    u minimises |W (y - H theta - C L u)|^2 / s^2 + |u|^2, with s^2 the variance of the residual of
    `solution`. Columns with noise of their own, such as a deflection, could take away that noise
    with a u of many standard deviations: it is clipped.
    """
    p, q = len(solution.values), len(qr_factor.names)
    R = qr_factor.weighted_factor(weights)
    columns, y = R[p:, p:q], R[p:, q]  # of C L and y, without their part in H
    variance = float(y @ y) / qr_factor.count
    if p == q or variance == 0:
        return np.append(solution.values, np.zeros(q - p))
    # The normal equations of |y - C L u|^2 / s^2 + |u|^2, times s^2.
    moments = columns.T @ columns + variance * np.eye(q - p)
    u = safely(np.linalg.solve, moments, columns.T @ y, what="the residual")
    u = np.clip(u, -_MOST_DEVIATIONS, _MOST_DEVIATIONS)
    theta = solution.values - solution.inverse @ (R[:p, :p].T @ (R[:p, p:q] @ u))
    return np.append(theta, u)


def left_of(rows: Regression, weights: Array, qr_factor: QRFactor, solution: Solution) -> Array:
    """Return `left_by_fit` of rows with a solution."""
    # Of weighted rows: H (H^T W^2 H)^-1 is their influence, and H root is orthonormal.
    H = weights[np.searchsorted(qr_factor.equations, rows.joint)][:, None] * rows.H
    return left_by_fit(H @ solution.inverse, H @ solution.root, rows.time, rows.run)


def _unidentifiable(qr_factor: QRFactor, combinations: Directions) -> str:
    """Name the unidentifiable combinations and the joints whose torque depends on them."""
    lost = [int(place) for place in np.flatnonzero(combinations.shares < RANK_TOLERANCE)][::-1]
    columns = sorted({column for place in lost for column in combinations.terms(place)})
    names = ", ".join(first_term(qr_factor.names[column]) for column in columns)
    texts = "; ".join(combinations.text(place) for place in lost[:_MOST_NAMED])
    more = f" and {len(lost) - _MOST_NAMED} more" if len(lost) > _MOST_NAMED else ""
    return (
        f"the motion does not excite all parameters: the combination of {names} is unidentifiable "
        f"({texts}{more}; scaled singular value {combinations.shares[-1]:.1e}, needed "
        f"{RANK_TOLERANCE:.0e}). It acts on the torque of "
        f"{', '.join(determining_joints(qr_factor, columns))}; move these joints more, or exclude "
        "torques with torque_joints="
    )
