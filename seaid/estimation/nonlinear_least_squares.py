"""Least squares that is nonlinear in parameters: a search by Gauss-Newton, and one by projection.

- A `LogResiduals` has the residuals of a log about a point, and moves to another one.
  `gauss_newton_search` goes from a `Point` of logs to the maximum of their likelihood, with a line
  search, bounds, priors, and states of each window that are no parameters.
- `separable_least_squares`: y(v) = H(v) theta + noise. For given v the best theta is linear least
  squares, so that the search is over v alone (Golub and Pereyra 1973), with Kaufman's (1975)
  Jacobian. Its many starts may be far away, which the trust region of SciPy allows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from seaid._arrays import Array, BoolArray, safely
from seaid._progress import track
from seaid.drives.controller import NORMAL_95
from seaid.errors import ExcitationError, SeaidError
from seaid.estimation.covariance import correlated_rows
from seaid.estimation.parameters import Parameter, bounds_of, priors_of
from seaid.estimation.qr_factor import ROUNDING, scaled_svd

LAG_S = 0.25
"""Time [s] beyond which residuals count as uncorrelated."""

_STANDS_OUT = 3.0
"""An autocorrelation is significant above this many standard errors of white noise."""

_LEAST_INFLATION = 0.25
"""Autocorrelation reduces no variance below this part of that of white noise."""

_LEAST_STATE = 1e-3
"""Scaled singular value of a window's nuisance parameters below which its rows do not move them.

Where a motor with dry friction rests, most residuals are masked, and the few that are left may not
determine the state."""

_REWEIGHTINGS = 20
"""Most iterations for the standard deviations of the channels. Those reached then are used: the
next step of the search estimates them again."""

_MATRICES = "the search by Gauss-Newton steps"
"""What the matrices are of, in errors."""

LEAST_STD = 1e-9
"""Least standard deviation of a channel: the rounding of logs without noise."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of one log and their derivatives, in windows (W) of instants (B) of channels (C).

    An instant may be the mean of a few samples.
    `residual` (W, B, C); `jacobian` (W, B, C, p) by the parameters; `nuisance` (W, B, C, s) by the
    nuisance parameters of each window (its initial state); `kept` (W, B, C) masks the residuals
    that count; `time` (W, B) [s]; `channels` numbers them, in all logs alike.
    """

    residual: Array
    jacobian: Array
    nuisance: Array
    kept: BoolArray
    time: Array
    channels: range


@dataclass(frozen=True, eq=False)
class Step:
    """A step towards the maximum of the likelihood.

    `change` (p,) of the parameters, and with it `nuisance` (W, s), the change of the nuisance
    parameters of each log; `nuisance_alone` is their change if the parameters stay. `stds` (C,) are
    those of the channels; `covariance` (p, p) with autocorrelation, `white_covariance` without, the
    inverse of the Fisher information. `merit` before the step is minus the logarithm of likelihood
    times prior, up to a constant. Fixed parameters, and those held at a bound, have a
    change of zero.
    """

    change: Array
    nuisance: tuple[Array, ...]
    nuisance_alone: tuple[Array, ...]
    stds: Array
    covariance: Array
    white_covariance: Array
    merit: float
    condition_number: float

    @property
    def sizes(self) -> Array:
        """The changes (p,) in standard errors of white noise."""
        errors = np.sqrt(np.diag(self.white_covariance))
        return np.abs(self.change) / np.where(errors > 0, errors, 1.0)


def gauss_newton_step(logs: Sequence[Residuals], parameters: Sequence[Parameter], x: Array) -> Step:
    """Return the step from x (p,) to the maximum of the linearised likelihood within the bounds.

    Noise levels are included. Raises ExcitationError if the data leave a combination of the
    parameters unidentifiable.
    """
    free = np.array([not parameter.is_fixed for parameter in parameters], dtype=bool)
    lower, upper = bounds_of(parameters)
    while True:
        step = _step_of(logs, parameters, x, free)
        # Active set: what would cross its bound is held there, and the step is computed again.
        down, up = (x <= lower) & (step.change < 0), (x >= upper) & (step.change > 0)
        if not np.any(free & (down | up)):
            return step
        free &= ~(down | up)


def _step_of(
    logs: Sequence[Residuals], parameters: Sequence[Parameter], x: Array, free: BoolArray
) -> Step:
    """Return the step of the `free` (p,) parameters, with the errors of held ones in theirs."""
    expected, prior_stds = priors_of(parameters)
    distance, precision = (x - expected)[free], 1 / prior_stds[free]
    free_logs = [replace(log, jacobian=log.jacobian[..., free]) for log in logs]
    p = int(np.sum(free))
    # The merit is at x, with the best noise levels there; the step is weighted by those after it.
    unmoved = _converged_stds(free_logs, distance, precision, frozen=True)
    # Residuals per channel times log standard deviation, and the prior.
    of_logs = sum(np.sum(x.kept, (0, 1)) @ np.log(unmoved[x.channels]) for x in free_logs)
    merit = float(of_logs + np.sum((precision * distance) ** 2) / 2)
    stds = _converged_stds(free_logs, distance, precision, frozen=False)
    J, r = _projected(logs, stds)
    # Held parameters with a prior, fixed or at a bound: their prior errors reach the others.
    held = ~free & np.isfinite(prior_stds)
    by_held, J = J[:, held], J[:, free]
    # The prior is p more residuals: precision times (distance + change).
    names = [parameter.name for parameter, is_free in zip(parameters, free, strict=True) if is_free]
    solution, inverse, condition = _solve(
        np.vstack([J, np.diag(precision)]), np.append(r, precision * distance), names
    )
    covariance = _autocorrelated_covariance(free_logs, J @ inverse, r + J @ solution)
    kept = sum(int(np.sum(log.kept)) for log in logs)
    # The trace of Q Q^T is the number of nuisance parameters that move the rows of their window.
    bases = [_basis(log, log.kept / stds[log.channels]) for log in logs]
    spent = p + sum(round(float(np.sum(basis**2))) for basis in bases)
    inflation = kept / max(kept - spent, 1)  # n / (n - p): residuals are smaller than the noise
    # The sandwich over the rows; the prior's residuals are independent, of variance 1.
    covariance = inflation * covariance + (inverse * precision**2) @ inverse
    # J dx + J_h dh = 0 in weighted rows: an error dh of a held parameter moves the others by K dh.
    moves = np.zeros((len(x), int(np.sum(held))))
    moves[free], moves[held] = -inverse @ (J.T @ by_held), np.eye(moves.shape[1])
    spread = moves * prior_stds[held]
    return Step(
        change=_placed(solution, free),
        nuisance=tuple(_nuisance(log, stds, solution) for log in free_logs),
        nuisance_alone=tuple(_nuisance(log, unmoved, np.zeros(p)) for log in free_logs),
        stds=stds,
        covariance=_placed(covariance, free) + spread @ spread.T,
        white_covariance=_placed(inflation * inverse, free),
        merit=merit,
        condition_number=condition,
    )


def _placed(values: Array, free: BoolArray) -> Array:
    """Return a vector or matrix of the `free` (p,) parameters with zeros for all others."""
    whole = np.zeros(values.ndim * (len(free),))
    whole[np.ix_(*values.ndim * (free,))] = values
    return whole


class LogResiduals(Protocol):
    """The residuals of a log, or of a part of it, about a point, and what they become at another.

    What is no parameter, such as a simulated motion with its initial states, is part of it.
    """

    @property
    def residuals(self) -> Residuals:
        """The residuals at its point, linearised."""

    def moved(self, x: Array, part: float, nuisance: Array) -> Self:
        """Return the residuals at parameters x (p,), after a part of a step.

        `nuisance` (W, s) is the whole step of the nuisance parameters of its windows.
        """


LogType = TypeVar("LogType", bound=LogResiduals)

_MOST_SWEEPS, _MOST_PARTS = 5, 5
"""Newton steps of the nuisance parameters, and parts 1, 1/2, ... of a step that are tried."""

_EQUAL_MERIT = 1e-3
"""Difference below which log-likelihoods count as equal."""


@dataclass(frozen=True, eq=False)
class Point(Generic[LogType]):
    """A point of a search: the values x (p,) of the `parameters`, and the logs about them."""

    parameters: tuple[Parameter, ...]
    x: Array
    logs: tuple[LogType, ...]

    @cached_property
    def step(self) -> Step:
        """The next step."""
        return gauss_newton_step([log.residuals for log in self.logs], self.parameters, self.x)

    @property
    def size(self) -> float:
        """The largest change of a parameter by the next step, in standard errors."""
        return float(np.max(self.step.sizes, initial=0.0))

    def moved(self, change: Array, part: float, nuisance: Sequence[Array]) -> Self:
        """Return the point after a part of a step (p,), and of that of the nuisance parameters."""
        x = np.clip(self.x + part * change, *bounds_of(self.parameters))
        pairs = zip(self.logs, nuisance, strict=True)
        logs = tuple(log.moved(x, part, states) for log, states in pairs)
        return replace(self, x=x, logs=logs)

    def settled(self) -> Self:
        """Return the point with the best nuisance parameters at its values, by Newton's method."""
        point = self
        for _ in range(
            _MOST_SWEEPS if any(change.size for change in self.step.nuisance_alone) else 0
        ):
            new = point.moved(np.zeros_like(point.x), 1.0, point.step.nuisance_alone)
            is_settled = abs(new.step.merit - point.step.merit) < _EQUAL_MERIT
            point = new
            if is_settled:
                break
        return point


def gauss_newton_search(
    start: Point[LogType], iterations: int, end_size: float, progress: bool = False
) -> tuple[Point[LogType], bool]:
    """Return the last point, and `is_stuck`: whether no part of its next step improves it.

    If it is not stuck, `size < end_size` [standard errors] distinguishes convergence from the last
    iteration. A step is halved until the likelihood improves, or a whole one leaves it equal, as
    steps near the end do.
    """
    point = start
    for _ in track(range(iterations), "refining", progress):
        improved = _improved(point)
        if improved is None:
            return point, True
        point = improved
        if point.size < end_size:
            break
    return point, False


def _improved(point: Point[LogType]) -> Point[LogType] | None:
    """Return the next point of a search, None if no part of its step improves the likelihood."""
    for part in 0.5 ** np.arange(_MOST_PARTS):
        with suppress(SeaidError):  # it diverges there
            trial = point.moved(point.step.change, part, point.step.nuisance).settled()
            gain = point.step.merit - trial.step.merit
            if gain > _EQUAL_MERIT or (part == 1.0 and gain >= -_EQUAL_MERIT):
                return trial
    return None


def _autocorrelated_covariance(
    logs: Sequence[Residuals], influence: Array, residual: Array
) -> Array:
    """Return the covariance (p, p) of the estimate, with `influence` (R, p) of the rows on it.

    The noise of each channel counts as stationary; its autocorrelation is estimated with flat-top
    weights up to twice the last significant lag (Politis 2003), whose bias is a third of that of
    Bartlett weights. For few rows this has less variance and less bias than the sum over products
    of scores (Newey and West 1987).
    """
    p, start = influence.shape[1], 0
    total = np.zeros((p, p))
    for log in logs:
        channels, size = log.residual.shape[2], log.residual.size
        rows = influence[start : start + size].reshape(-1, channels, p)
        white = residual[start : start + size].reshape(-1, channels)
        start += size
        step = float(np.median(np.diff(log.time.ravel())))
        for channel in range(channels):
            # The noise of weighted rows has unit variance: lag zero has the weight 1.
            effect = rows[:, channel]
            total += effect.T @ effect
            for lag, weight in enumerate(_autocorrelation(white[:, channel], LAG_S / step), 1):
                cross = effect[lag:].T @ effect[:-lag]
                total += weight * (cross + cross.T)
    return _at_least(_LEAST_INFLATION, total, influence.T @ influence)


def _at_least(part: float, covariance: Array, white: Array) -> Array:
    """Return a covariance of which no combination has less than a `part` of the `white` variance.

    Flat-top weights alone do not make it positive.
    """
    # white = root root^T is the identity in these coordinates; `ratios` are covariance over white.
    root, inverse = _root(white)
    ratios, turned = safely(np.linalg.eigh, inverse @ covariance @ inverse.T, what=_MATRICES)
    half = root @ turned * np.sqrt(np.maximum(ratios, part))
    return np.asarray(half @ half.T)


def _root(covariance: Array) -> tuple[Array, Array]:
    """Return C (p, p) of the covariance C C^T, and its inverse.

    Parameters differ in size by many powers of ten: both are of the correlations, scaled back.
    """
    scale = np.sqrt(np.diag(covariance))
    scale[scale == 0] = 1.0  # known by the prior alone
    sizes, axes = safely(np.linalg.eigh, covariance / np.outer(scale, scale), what=_MATRICES)
    sizes = np.sqrt(np.maximum(sizes, ROUNDING))
    return scale[:, None] * axes * sizes, axes.T / sizes[:, None] / scale


def _autocorrelation(residual: Array, most: float) -> Array:
    """Return the weighted autocorrelation at lags from 1 to twice the last significant one."""
    lags, present = min(int(most), len(residual) - 1), residual != 0
    power = max(float(residual @ residual), 1e-300) / max(int(np.sum(present)), 1)
    later = [slice(lag, None) for lag in range(1, lags + 1)]
    products = np.array([residual[x] @ residual[: -x.start] for x in later])
    # Rows that do not count are zero: a mean over all pairs would be too small.
    pairs = np.array([np.sum(present[x] & present[: -x.start]) for x in later])
    correlation = products / np.maximum(pairs, 1) / power
    outstanding = np.flatnonzero(np.abs(correlation) * np.sqrt(pairs) > _STANDS_OUT)
    bandwidth = min(2 * (int(outstanding[-1]) + 1), lags) if outstanding.size else 0
    lag = np.arange(1, bandwidth + 1)
    # Flat top (Politis 2003): 1 up to half of the bandwidth, then a straight line to zero.
    return np.asarray(correlation[:bandwidth] * np.minimum(2 - 2 * lag / (bandwidth + 1), 1.0))


_MOST_NOISE = 0.9
"""Part of the information in any combination of the parameters that may be noise.

The noise is computed from a few random draws, and may exceed the information. No standard error
grows more than tenfold, 1 / (1 - 0.9)."""


def nuisance_draw(log: Residuals, stds: Array, rng: np.random.Generator) -> Array:
    """Return random errors (W, s) of the nuisance parameters of a log, as its noise makes them."""
    white = rng.normal(size=log.residual.shape) * stds[log.channels]
    return _nuisance(replace(log, residual=white), stds, np.zeros(log.jacobian.shape[3]))


def information(logs: Sequence[Residuals], stds: Array) -> Array:
    """Return the information (p, p) on the parameters with the nuisance parameters free."""
    J = _projected(logs, stds)[0]
    return np.asarray(J.T @ J)


def without_information(step: Step, noise: Array) -> Step:
    """Return the step with the covariance that holds if `noise` (p, p) of J^T J is no information.

    That is so where the derivatives contain estimated nuisance parameters, whose errors look like
    information. The derivatives of a residual f - N(x) a by x have the estimated a: J = J_0 + E,
    where E is by its errors, which do not depend on the residual r. So the mean of J^T J is
    J_0^T J_0 + noise, with the mean of E^T E as noise. The mean of the squares of the residual, in
    which x is free and N projected out, has no such part: its curvature is J^T J - noise, and its
    slope J^T r has the covariance J^T J, r being white with unit variance. The error of x is the
    slope over the curvature: its covariance is (J^T J - noise)^-1 J^T J (J^T J - noise)^-1.
    """
    root, inverse = _root(step.white_covariance)
    parts, turned = safely(np.linalg.eigh, root.T @ noise @ root, what=_MATRICES)
    # In the coordinates of `root` the information is the identity, and without noise 1 - parts. The
    # factor n / (n - p) in `white_covariance` is needed here: the random states of `noise` have the
    # standard deviations of the maximum likelihood, whose squares are too small by this factor.
    kept = 1 - np.clip(parts, 0.0, _MOST_NOISE)
    larger = root @ turned / kept @ turned.T @ inverse
    return replace(
        step,
        covariance=larger @ step.covariance @ larger.T,
        white_covariance=larger @ step.white_covariance @ larger.T,
    )


def _converged_stds(
    logs: Sequence[Residuals], distance: Array, precision: Array, frozen: bool
) -> Array:
    """Return the converged standard deviations (C,), with the parameters `frozen` or free."""
    change = np.zeros(len(distance))
    shapes = [(len(log.nuisance), log.nuisance.shape[3]) for log in logs]  # (W, s)
    stds = _stds(logs, change, tuple(map(np.zeros, shapes)))
    for _ in range(_REWEIGHTINGS):
        if not frozen:
            J, r = _projected(logs, stds)
            J, r = np.vstack([J, np.diag(precision)]), np.append(r, precision * distance)
            # its triangle has the same solution, and p + 1 rows
            R = safely(np.linalg.qr, np.column_stack([J, r]), what=_MATRICES, mode="r")
            change = -scaled_svd(R[:, :-1], _MATRICES).solve(R[:, -1], 0.0)
        new = _stds(logs, change, tuple(_nuisance(log, stds, change) for log in logs))
        is_converged = np.allclose(new, stds, rtol=1e-4)
        stds = new
        if is_converged:
            break
    return stds


def _stds(logs: Sequence[Residuals], change: Array, nuisance: tuple[Array, ...]) -> Array:
    """Return the root mean square (C,) of the kept residuals after a change of the parameters."""
    total, count = np.zeros((2, max(log.channels.stop for log in logs)))
    for log, values in zip(logs, nuisance, strict=True):
        after = log.residual + log.jacobian @ change
        after = after + np.einsum("wbcs,ws->wbc", log.nuisance, values)
        total[log.channels] += np.sum(np.where(log.kept, after, 0.0) ** 2, axis=(0, 1))
        count[log.channels] += np.sum(log.kept, axis=(0, 1))
    return np.asarray(np.maximum(np.sqrt(total / np.maximum(count, 1)), LEAST_STD))


def _projected(logs: Sequence[Residuals], stds: Array) -> tuple[Array, Array]:
    """Return the weighted Jacobian and residual, with the nuisance columns projected out."""
    Js, rs = [], []
    for log in logs:
        weights = log.kept / stds[log.channels]
        windows, p = len(log.residual), log.jacobian.shape[3]
        J = (log.jacobian * weights[..., None]).reshape(windows, weights[0].size, p)
        r = (log.residual * weights).reshape(windows, -1)
        Q = _basis(log, weights)
        # What the nuisance parameters of a window explain is no information on the others.
        J = J - Q @ (np.swapaxes(Q, 1, 2) @ J)
        r = r - np.einsum("wms,ws->wm", Q, np.einsum("wms,wm->ws", Q, r))
        Js.append(J.reshape(-1, p))
        rs.append(r.ravel())
    return np.concatenate(Js), np.concatenate(rs)


def _basis(log: Residuals, weights: Array) -> Array:
    """Return an orthonormal basis of each window's weighted nuisance columns.

    Its columns are zero where a nuisance parameter does not move the rows of the window.
    """
    windows, s = len(log.residual), log.nuisance.shape[3]
    columns = (log.nuisance * weights[..., None]).reshape(windows, weights[0].size, s)
    if not s:
        return columns
    norms = np.linalg.norm(columns, axis=1, keepdims=True)
    Q, R = np.linalg.qr(columns / np.where(norms > 0, norms, 1.0))
    # Of dependent columns Q has a direction that is not in their span, and is information on the
    # others: the span is that of the left singular vectors, with the tolerance of `_nuisance`.
    left, sizes, _ = safely(np.linalg.svd, R, what=_MATRICES)
    in_span = sizes > _LEAST_STATE * sizes[:, :1]
    return np.asarray(Q @ (left[:, :, : sizes.shape[1]] * in_span[:, None]))


def _nuisance(log: Residuals, stds: Array, change: Array) -> Array:
    """Return the best nuisance parameters (W, s) after a change of the parameters."""
    weights = log.kept / stds[log.channels]
    windows, s = len(log.residual), log.nuisance.shape[3]
    after = ((log.residual + log.jacobian @ change) * weights).reshape(windows, -1)
    columns = (log.nuisance * weights[..., None]).reshape(windows, weights[0].size, s)
    norms = np.linalg.norm(columns, axis=1, keepdims=True)
    norms[norms == 0] = 1.0
    # A pseudo-inverse: a state that does not move the rows of its window stays as it is.
    inverse = safely(np.linalg.pinv, columns / norms, what=_MATRICES, rcond=_LEAST_STATE)
    return np.asarray(-np.einsum("wsm,wm->ws", inverse, after) / norms[:, 0])


def _solve(J: Array, r: Array, names: Sequence[str]) -> tuple[Array, Array, float]:
    """Return the step, the inverse of the information and the scaled condition number."""
    norms = np.linalg.norm(J, axis=0)
    dead = [name for name, norm in zip(names, norms, strict=True) if norm == 0]
    if dead:
        raise ExcitationError(f"the motion does not excite {', '.join(dead)}: move these joints")
    svd = scaled_svd(J, _MATRICES)
    s = svd.sizes
    if s[-1] < ROUNDING * s[0]:
        share = np.abs(svd.vectors[-1])
        lost = [name for name, x in zip(names, share, strict=True) if x > 0.1 * share.max()]
        raise ExcitationError(
            f"the combination of {', '.join(lost)} is unidentifiable by this motion (scaled "
            f"singular value {s[-1] / s[0]:.1e}, needed {ROUNDING:.0e})"
        )
    # J = U S V^T N with the norms N of the columns: half = N^-1 V S^-1, (J^T J)^-1 = half half^T.
    half = (svd.vectors.T / s) / norms[:, None]
    return -half @ (svd.left.T @ r), half @ half.T, float(s[0] / s[-1])


Columns = Callable[[Array], tuple[Array, Array]]
"""Function of v (b,) that returns y (R,) and H (R, p)."""

Slopes = Callable[[Array, Array], Array]
"""Function of v (b,) and theta (p,) that returns the derivative (R, b) of H theta - y by v."""

_MOST_EVALUATIONS = 60
"""Most evaluations of the search that goes on from the best start."""

_FEW_EVALUATIONS, _MOST_TRIED = 8, 12
"""Evaluations from each start that is tried, and the largest number of these."""


def separable_least_squares(
    columns: Columns, slopes: Slopes, starts: Sequence[Array], lower: Array, upper: Array
) -> list[tuple[Array, Array]]:
    """Return v (b,) and theta (p,) of least squares, and then of the optima that compete with it.

    A few evaluations from the best dozen of the `starts` (each (b,)) are followed by full searches
    from the best result and from its `competing_optima`, within `lower` < v < `upper` (b,). A start
    on a bound is moved inside. Each parameter is scaled by the size of its start, or by its upper
    bound where the start is zero.
    """

    def misfit(v: Array) -> float:
        return float(np.linalg.norm(_residual(columns, v)[0]))

    inside = [_inside(np.asarray(start, dtype=float), lower, upper) for start in starts]
    inside = sorted(inside, key=misfit)[:_MOST_TRIED]
    if len(inside) > 1:
        tried = [_trust_region(columns, slopes, v, lower, upper, _FEW_EVALUATIONS) for v in inside]
        tried.sort(key=misfit)
        inside = [tried[place] for place in competing_optima(columns, slopes, tried)]
    ends = [_trust_region(columns, slopes, v, lower, upper, _MOST_EVALUATIONS) for v in inside]
    ends.sort(key=misfit)
    optima = (ends[place] for place in competing_optima(columns, slopes, ends))
    return [(v, _residual(columns, v)[1]) for v in optima]


def competing_optima(columns: Columns, slopes: Slopes, optima: Sequence[Array]) -> list[int]:
    """Return 0 and the places of the optima v (b,) that the data do not distinguish from the first.

    Their misfit is in the 95 % region of the first one, and some of their values, v or theta, are
    others than those of each optimum before: the 95 % intervals by tangents do not overlap.
    """
    tangents = [_tangent(columns, slopes, v, np.ones(len(v))) for v in optima]
    residual, values, _, _ = tangents[0]
    most, kept = NORMAL_95**2 * _variance(residual, len(values)), dict[int, tuple[Array, Array]]()
    for place, (after, values, errors, _) in enumerate(tangents):
        # Without noise errors are rounding, and searches converge to half of its digits.
        reach = math.sqrt(most) * errors + math.sqrt(ROUNDING) * np.abs(values)
        apart = (np.abs(values - x) > reach + y for x, y in kept.values())
        if after @ after - residual @ residual <= most and all(map(np.any, apart)):
            kept[place] = values, reach
    return [*kept]


def _variance(residual: Array, p: int) -> float:
    """Return that of the noise with p parameters; correlated rows count as fewer ones."""
    correlated = max(correlated_rows(residual), 1.0) / max(len(residual) - p, 1)
    return correlated * float(residual @ residual)


def error_growth(
    columns: Columns, slopes: Slopes, starts: Sequence[Array], lower: Array, upper: Array
) -> Array:
    """Return errors of theta and v by the misfit, over those by its tangents: 1 or more (p + b,).

    The first of the `starts` is the best v. Tangents there give the errors of a misfit that is a
    parabola, and too small ones where it is flat farther off, or as small at another start. So v is
    moved along each of its parameters, the others following at their best, as long as the misfit is
    not significantly larger (profiles; Bates and Watts 1988). What is reached there, with its own
    errors, is that many standard errors away.
    """
    best = starts[0]
    residual, values, errors, _ = _tangent(columns, slopes, best, np.ones(len(best)))
    variance = _variance(residual, len(values))
    errors = np.maximum(math.sqrt(variance) * errors, np.finfo(float).tiny)
    reach = errors.copy()
    # Within so many standard errors are 95 % and 99.7 % of normal errors: a misfit with a second
    # minimum may be a parabola in the one region and not in the other.
    regions, walked = np.array([[NORMAL_95], [3.0]]), 1.5 ** np.arange(12)
    others = [(start, np.zeros(1)) for start in starts[1:]]
    for place, error in enumerate(errors[len(errors) - len(best) :]):
        free = np.arange(len(best)) != place
        for v, steps in [(best, error * walked), (best, -error * walked), *others]:
            # A positive value moves by factors, by which it remains positive.
            is_positive, x = lower[place] > 0, v[place]
            walk = x * np.exp(np.clip(steps / x, -9, 9)) if is_positive else x + steps
            for value in np.clip(walk, lower[place], upper[place]):
                v = np.where(free, v, value)
                v = np.clip(v + _tangent(columns, slopes, v, free)[-1], lower, upper)
                after, near, sides, _ = _tangent(columns, slopes, v, free)
                left = regions**2 * variance + residual @ residual - after @ after
                far = (np.abs(near - values) + np.sqrt(np.maximum(left, 0.0)) * sides) / regions
                reach = np.max([reach, *far[left[:, 0] > 0]], axis=0)
                if np.max(left) <= 0:
                    break
    return reach / errors


def _tangent(columns: Columns, slopes: Slopes, v: Array, free: Array) -> tuple[Array, ...]:
    """Return the residual at v, (theta, v), their errors per noise, and the step of `free` v."""
    (y, H), (residual, theta, _) = columns(v), _residual(columns, v)
    svd = scaled_svd(np.hstack([H, free * slopes(v, theta)]))
    errors = np.linalg.norm(svd.inverses, axis=1)
    return residual, np.append(theta, v), errors, svd.solve(y)[len(theta) :]


def _trust_region(
    columns: Columns, slopes: Slopes, start: Array, lower: Array, upper: Array, most: int
) -> Array:
    """Return v after at most `most` evaluations from a start."""
    from scipy.optimize import least_squares

    size = max(float(np.linalg.norm(_residual(columns, start)[0])), 1e-300)

    @lru_cache(1)
    def at(v: tuple[float, ...]) -> tuple[Array, Array, Array]:
        # `least_squares` asks for residual and Jacobian at the same v in turn: one SVD for both.
        return _residual(columns, np.array(v))

    def residual(v: Array) -> Array:
        return at(tuple(v))[0] / size

    def jacobian(v: Array) -> Array:
        _, theta, Q = at(tuple(v))
        D = slopes(v, theta)
        return -(D - Q @ (Q.T @ D)) / size  # Kaufman 1975: -(I - Q Q^T) d(H theta - y)/dv

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
    # A rank below p is no error here: on the way of the search columns may coincide.
    svd = scaled_svd(H)
    Q = svd.span()
    return y - Q @ (Q.T @ y), svd.solve(y), Q


def _inside(v: Array, lower: Array, upper: Array) -> Array:
    """Return v moved inside its bounds."""
    with np.errstate(invalid="ignore"):
        width = np.where(np.isfinite(upper - lower), upper - lower, 1.0 + np.abs(v))
    return np.clip(v, lower + 1e-6 * width, upper - 1e-6 * width)
