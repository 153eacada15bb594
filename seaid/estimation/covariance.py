"""Long-run covariance of autocorrelated scores: Newey-West with an automatic bandwidth.

The noise behind a low pass is autocorrelated, and so are the regressors; the textbook formula for
white noise then gives standard errors that are half of the true ones. Bartlett weights (Newey and
West 1987) repair this. The bandwidth is 1.3 sqrt(T) with the fixed-b correction (Lazarus, Lewis,
Stock and Watson 2018): in `scripts/benchmarks/covariance.py` its intervals cover the truth more
often in short logs than those of plug-in bandwidths, which minimise the mean square error of the
covariance and not of the intervals, and than those of block methods.

The fit removes a part of the noise from the residuals, most of it where the bandwidth is long: the
covariance is divided by what would be left of white noise (Bell and McCaffrey 2002), so that a
standard error is one standard deviation. That it is estimated itself is in the degrees of freedom
of Student's t, by which intervals are wider than normal ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import chain, pairwise

import numpy as np
import scipy

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.drives.controller import NORMAL_95

MOST_FREEDOM = 1e4
"""Degrees of freedom beyond which Student's t is normal."""

LEAST_LEFT = 0.1
"""Least part of the variance of a parameter, or of the power of a line, that counts as left by the
fit."""

_FIXED_B = (2.9694, 0.4160, -0.5324)
"""Coefficients a_i of the 95 % quantile 1.96 + sum a_i b^i, b = bandwidth / T, for Bartlett weights
(Kiefer and Vogelsang 2005).
"""


@dataclass(frozen=True, eq=False)
class LongRun:
    """Long-run covariance of the sum of scores.

    `covariance` (p, p) has Bartlett weights, `white` (p, p) is that without autocorrelation; `lags`
    is the bandwidth in instants, `instants` the number of these.
    """

    covariance: Array
    white: Array
    lags: int
    instants: int

    def inflation(self, inverse: Array) -> float:
        """Return the variance inflation by autocorrelation, averaged over the parameters.

        It is the number of correlated rows per independent row. `inverse` (p, p) is (H^T W^2 H)^-1.
        """
        # tr((H^T W^2 H)^-1 S): a mean over the parameters that does not depend on their units.
        white = float(np.sum(inverse * self.white))
        return float(np.sum(inverse * self.covariance)) / white if white > 0 else 1.0

    @property
    def bandwidth(self) -> float:
        """Bandwidth as a part of the log, b."""
        # The Bartlett weights 1 - |l| / (lags + 1) reach zero at the lag lags + 1.
        return min((self.lags + 1) / max(self.instants, 1), 1.0)

    @property
    def for_normal_intervals(self) -> Array:
        """The covariance (p, p) by which normal 95 % intervals are right."""
        # A normal interval is 1.96 standard errors wide on either side; fixed b needs more of them.
        return np.asarray((fixed_b(self.bandwidth) / NORMAL_95) ** 2 * self.covariance)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom by which Student's 95 % quantile is that of fixed b (`fixed_b`)."""
        return fixed_b_freedom(self.bandwidth)


def automatic_lags(instants: int) -> int:
    """Return the bandwidth for a number of instants."""
    return max(0, min(round(1.3 * math.sqrt(instants)), instants - 1))


def long_run_of(H: Array, factor: Array, time: Array, run: Array) -> LongRun:
    """Return the long-run covariance of the scores `factor` (R,) times `H` (R, p)."""
    summed = by_instant(H, factor, time, run)
    return long_run([[sums] for sums in summed], sum(map(len, summed)))


def left_of_mean(b: float) -> float:
    """Return the part of the variance of a mean that is left in Bartlett sums about it.

    The weights sum to b T - b^2 T / 3 per instant, the part that the mean removes.
    """
    return 1 - b + b**2 / 3


def left_by_fit(x: Array, Q: Array, time: Array, run: Array) -> Array:
    """Return the part (p,) of the variance of each parameter that is left in the residuals' sums.

    `x` (R, p) is the influence of each row's noise on each parameter, `Q` (R, m) an orthonormal
    basis of what the fit removes. Of white noise e it leaves e - Q Q^T e, so that the Bartlett sum
    of x e loses those of x q over the columns q of Q.
    """
    lost, logs = np.zeros(x.shape[1]), _instants(time, run)
    lags = automatic_lags(sum(int(np.max(slot)) + 1 for _, slot in logs))
    for rows, slot in logs:
        influence, fitted = (_by_slot(values[rows], slot) for values in (x, Q))
        # With cov(r) = 1 - Q Q^T, E sum_w (x_w^T r_w)^2 = sum_w (|x_w|^2 - |x_w^T Q_w|^2) over all
        # windows w of lags + 1 instants, in which each instant is lags + 1 times.
        lost += _window_squares(influence, fitted, lags) / (lags + 1)
    whole = np.sum(x**2, axis=0)
    return np.asarray(np.maximum(1 - lost / np.where(whole > 0, whole, 1.0), LEAST_LEFT))


_NUMBERS = 100_000
"""Sums of products that `left_by_fit` has in memory at a time: they stay in the cache."""


def _by_slot(values: Array, slot: IndexArray) -> Array:
    """Return rows (R, p) by their instant (T, most rows of one, p), zero where there is none."""
    order, counts = np.argsort(slot, kind="stable"), np.bincount(slot)
    # (R,) the place of each row among those of its instant, which several joints share.
    place = np.arange(len(slot)) - np.repeat(np.cumsum(counts) - counts, counts)
    table = np.zeros((len(counts), int(np.max(counts)), values.shape[1]))
    table[slot[order], place] = values[order]
    return table


def _window_squares(x: Array, Q: Array, lags: int) -> Array:
    """Return the squares (p,) of the products of x (T, r, p) with Q (T, r, m), summed over r, m,
    each window of lags + 1 instants, and all windows.
    """
    # Windows that reach beyond the ends of the log count too: each instant is in lags + 1 of them.
    count, squares = len(x) + lags, np.zeros(x.shape[2])
    step = max(_NUMBERS // max(x.shape[2] * Q.shape[2], 1), 1)
    x, Q = (np.pad(values, ((lags + 1, lags), (0, 0), (0, 0))) for values in (x, Q))
    window = np.zeros((x.shape[2], Q.shape[2]))
    for start in range(0, count, step):
        end = min(start + step, count)
        leaves, windows = (
            x[span].swapaxes(1, 2) @ Q[span]
            for span in (slice(start, end), slice(start + lags + 1, end + lags + 1))
        )
        # Window i is window i - 1 with the instant that enters and without that which leaves, so
        # that the cost does not grow with the lags. (`np.cumsum` along the first axis takes ten
        # times as long.)
        windows -= leaves
        for before, after in pairwise([window, *windows]):
            after += before
        squares += np.einsum("tpm,tpm->p", windows, windows)
        window = windows[-1]
    return squares


def by_instant(H: Array, factor: Array, time: Array, run: Array) -> list[Array]:
    """Return the scores (T, p) of each log, summed over the rows of an instant, zero in gaps."""
    return [at_slots(H[rows], factor[rows], slot) for rows, slot in _instants(time, run)]


def _instants(time: Array, run: Array) -> list[tuple[BoolArray | slice, IndexArray]]:
    """Return the rows of each log and the index of their instants."""
    logs: list[tuple[BoolArray | slice, IndexArray]] = []
    for log in np.unique(run):
        rows = run == log
        instants = np.unique(time[rows])
        slot = slots(time[rows], instants[0], row_step(instants))
        logs.append((slice(None) if np.all(rows) else rows, slot))  # a view of all rows
    return logs


def row_step(instants: Array) -> float:
    """Return the time [s] between rows, from the instants (I,) that are present."""
    steps = np.diff(instants)
    # Gaps of excluded rows are two steps or more: the mean is over the single steps alone.
    return float(np.mean(steps[steps < 1.5 * np.min(steps)])) if len(steps) else 1.0


def slots(time: Array, start_s: float, step_s: float) -> IndexArray:
    """Return the index of the instant of each row, counted from `start_s`."""
    return np.asarray(np.round((time - start_s) / step_s), dtype=np.intp)


def at_slots(H: Array, factor: Array, slot: IndexArray) -> Array:
    """Return the scores, rows of `H` (R, p) times `factor` (R,), summed per slot."""
    # (T, R), in column format: row r of H is column r, which has one entry: `arange` points to it.
    entries, shape = (factor, slot, np.arange(len(slot) + 1)), (int(np.max(slot)) + 1, len(slot))
    return np.asarray(scipy.sparse.csc_array(entries, shape=shape) @ H)


def long_run(runs: Iterable[Iterable[Array]], instants: int) -> LongRun:
    """Return the long-run covariance of `runs`, per log an iterable of scores (T, p) in time."""
    lags = automatic_lags(instants)
    sums = [bartlett(run, lags) for run in runs]
    return LongRun(
        covariance=np.asarray(sum(weighted for weighted, _ in sums)),
        white=np.asarray(sum(white for _, white in sums)),
        lags=lags,
        instants=instants,
    )


def fixed_b(b: float) -> float:
    """Return the 95 % quantile of a value over the root of its Bartlett sum, of bandwidth b."""
    return NORMAL_95 + sum(factor * b**power for power, factor in enumerate(_FIXED_B, 1))


@cache
def fixed_b_freedom(b: float) -> float:
    """Return the degrees of freedom whose quantile is that of fixed b for an unbiased variance."""
    # The quantile is that of a value over its biased sum; the unbiased variance is larger by 1 /
    # left, and the value over it smaller by the root.
    quantile = fixed_b(b) * math.sqrt(left_of_mean(b))
    if quantile < scipy.special.stdtrit(MOST_FREEDOM, 0.975):
        return MOST_FREEDOM
    return float(scipy.special.stdtridf(0.975, quantile))


def bartlett(chunks: Iterable[Array], lags: int) -> tuple[Array, Array]:
    """Return the sums (p, p) of lagged products of scores: with Bartlett weights, and of lag zero.

    The Bartlett sum equals sum_t w_t w_t^T / (lags + 1) with w_t the sum of the scores in a window
    of lags + 1 instants. It is positive semidefinite by construction, its cost does not grow with
    the lags, and only the last `lags` instants of a chunk (T, p) are kept for the next one.
    """
    chunks = iter(chunks)
    first = next(chunks)
    tail = np.zeros((lags, first.shape[1]))
    weighted = white = np.zeros((first.shape[1], first.shape[1]))
    # A last chunk of zeros moves the windows out of the log, as the zeros before it move them in.
    for chunk in chain([first], chunks, [np.zeros_like(tail)]):
        padded = np.concatenate([tail, chunk])
        sums = np.cumsum(np.pad(padded, ((1, 0), (0, 0))), axis=0)
        windows = sums[lags + 1 :] - sums[: -lags - 1]
        weighted = weighted + windows.T @ windows
        white = white + chunk.T @ chunk
        # Not padded[-lags:], which is everything for lags = 0.
        tail = padded[len(padded) - lags :]
    return weighted / (lags + 1), white


def correlated_rows(residual: Array) -> float:
    """Return rows per independent one: the long-run variance over the variance (Bartlett)."""
    x = residual - np.mean(residual)
    power, lags = float(x @ x), round(2 * math.sqrt(len(x)))
    products = np.correlate(x, x, "full")[len(x) : len(x) + lags]
    sums = (1 - np.arange(1, lags + 1) / (lags + 1)) * products
    # 1 + 2 sum_l (1 - l / (L + 1)) rho_l, with the autocorrelation rho_l (Newey and West 1987)
    return 1 + 2 * float(np.sum(sums)) / power if power > 0 else 1.0
