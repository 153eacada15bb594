"""Long-run covariance of autocorrelated scores: Newey-West with an automatic bandwidth.

The noise behind a low pass is autocorrelated, and so are the regressors; the textbook formula for
white noise then gives standard errors that are half of the true ones. Bartlett weights (Newey and
West 1987) repair this. The bandwidth is 1.3 sqrt(T) with the fixed-b correction (Lazarus, Lewis,
Stock and Watson 2018): in `scripts/benchmarks/covariance.py` its intervals cover the truth more
often in short logs than those of plug-in bandwidths, which minimise the mean square error of the
covariance and not of the intervals, and than those of block methods.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy import sparse

from seaid._arrays import Array, IndexArray

_NORMAL = 1.96
_FIXED_B = (2.9694, 0.4160, -0.5324)
"""Coefficients a_i of the 95 % quantile 1.96 + sum a_i b^i, b = bandwidth / T, for Bartlett weights
(Kiefer and Vogelsang 2005).
"""


@dataclass(frozen=True, eq=False)
class LongRun:
    """Long-run covariance of the sum of scores.

    `covariance` (p, p) includes the fixed-b correction, so that normal 95 % intervals are right
    even if the bandwidth is a sizeable part of the log; `white` (p, p) is the covariance without
    autocorrelation; `lags` is the bandwidth in instants.
    """

    covariance: Array
    white: Array
    lags: int

    def inflation(self, inverse: Array) -> float:
        """Return the variance inflation by autocorrelation, averaged over the parameters.

        It is the number of correlated rows per independent row. `inverse` (p, p) is (H^T W^2 H)^-1.
        """
        white = float(np.sum(inverse * self.white))
        return float(np.sum(inverse * self.covariance)) / white if white > 0 else 1.0


def automatic_lags(instants: int) -> int:
    """Return the bandwidth for a number of instants."""
    return max(0, min(round(1.3 * math.sqrt(instants)), instants - 1))


def newey_west(scores: Array, time: Array, run: Array) -> Array:
    """Return the long-run covariance (p, p) of the sum of `scores` (R, p); see `LongRun`.

    A score is a row of the regressor times its residual. `time` (R,) [s] and `run` (R,) give the
    instant and the log of each row. Rows of one instant (several joints) are summed first; excluded
    instants count as zero.
    """
    return long_run_of(scores, np.ones(len(scores)), time, run).covariance


def long_run_of(H: Array, factor: Array, time: Array, run: Array) -> LongRun:
    """Return `newey_west` of the scores `factor` (R,) times `H` (R, p)."""
    summed = by_instant(H, factor, time, run)
    return long_run([[one] for one in summed], sum(map(len, summed)))


def by_instant(H: Array, factor: Array, time: Array, run: Array) -> list[Array]:
    """Return the scores (T, p) of each log, summed over the rows of an instant, zero in gaps."""
    summed = []
    for one in np.unique(run):
        rows = run == one
        instants = np.unique(time[rows])
        slot = slots(time[rows], instants[0], row_step(instants))
        summed.append(at_slots(H if np.all(rows) else H[rows], factor[rows], slot))
    return summed


def row_step(instants: Array) -> float:
    """Return the time [s] between rows, from the instants (I,) that are present."""
    steps = np.diff(instants)
    return float(np.mean(steps[steps < 1.5 * np.min(steps)])) if len(steps) else 1.0


def slots(time: Array, start_s: float, step_s: float) -> IndexArray:
    """Return the index of the instant of each row, counted from `start_s`."""
    return np.asarray(np.round((time - start_s) / step_s), dtype=np.intp)


def at_slots(H: Array, factor: Array, slot: IndexArray) -> Array:
    """Return the scores, rows of `H` (R, p) times `factor` (R,), summed per slot."""
    shape = (int(np.max(slot)) + 1, len(H))
    gather = sparse.csr_array((factor, (slot, np.arange(len(slot)))), shape=shape)
    return np.asarray(gather @ H)


def long_run(runs: Iterable[Iterable[Array]], instants: int) -> LongRun:
    """Return the long-run covariance of `runs`, per log an iterable of scores (T, p) in time."""
    lags = automatic_lags(instants)
    sums = [bartlett(run, lags) for run in runs]
    return LongRun(
        covariance=np.asarray(fixed_b(lags, instants) * sum(weighted for weighted, _ in sums)),
        white=np.asarray(sum(white for _, white in sums)),
        lags=lags,
    )


def fixed_b(lags: int, instants: int) -> float:
    """Return the factor on the variance that corrects for a bandwidth of `lags` in `instants`."""
    b = min((lags + 1) / max(instants, 1), 1.0)
    excess = sum(factor * b**power for power, factor in enumerate(_FIXED_B, 1))
    return float((1 + excess / _NORMAL) ** 2)  # squared ratio of the fixed-b to the normal quantile


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
    for chunk in chain([first], chunks, [np.zeros_like(tail)]):
        padded = np.concatenate([tail, chunk])
        sums = np.cumsum(np.pad(padded, ((1, 0), (0, 0))), axis=0)
        windows = sums[lags + 1 :] - sums[: -lags - 1]
        weighted = weighted + windows.T @ windows
        white = white + chunk.T @ chunk
        tail = padded[len(padded) - lags :]
    return weighted / (lags + 1), white
