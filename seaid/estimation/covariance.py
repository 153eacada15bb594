"""Covariance of a sum of scores that are correlated in time: Newey-West, bandwidth automatic.

The noise behind a low pass is correlated over rows, and so are the regressors; the textbook formula
for white noise then claims errors that are half of the true ones. Bartlett weights (Newey and West
1987) repair it. `scripts/benchmarks/covariance.py` has the comparison by which the bandwidth was
chosen: 1.3 sqrt(T) with the fixed-b correction (Lazarus, Lewis, Stock and Watson 2018) holds the
truth more often in short logs than the plug-in bandwidths, which minimise the mean square error of
the covariance and not the error of the intervals, and than block methods, which run out of blocks.
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
"""Bartlett's 95 % quantile grows so with b = bandwidth / T (Kiefer and Vogelsang 2005)."""


@dataclass(frozen=True, eq=False)
class LongRun:
    """Covariance (p, p) of the sum of scores, and `white`, what it would be without correlation.

    `lags` is the bandwidth in instants; `covariance` has the fixed-b correction in it, so that
    normal intervals of 95 % are right though the bandwidth is a sizeable part of the log.
    """

    covariance: Array
    white: Array
    lags: int

    def inflation(self, inverse: Array) -> float:
        """Return how much larger the variance is than without correlation, all parameters alike.

        So many rows tell as much as one independent one; `inverse` (p, p) is the inverse of the
        information.
        """
        white = float(np.sum(inverse * self.white))
        return float(np.sum(inverse * self.covariance)) / white if white > 0 else 1.0


def automatic_lags(instants: int) -> int:
    """Return the bandwidth for so many instants."""
    return max(0, min(round(1.3 * math.sqrt(instants)), instants - 1))


def newey_west(scores: Array, time: Array, run: Array) -> Array:
    """Return the long-run covariance (p, p) of the sum of scores; see `LongRun`.

    `scores` (R, p) are the rows of the regressor times their residual, `time` (R,) [s] and `run`
    (R,) tell when and in which log. Rows of one instant (several joints) belong together; instants
    that were left out count as zero.
    """
    return long_run_of(scores, np.ones(len(scores)), time, run).covariance


def long_run_of(H: Array, factor: Array, time: Array, run: Array) -> LongRun:
    """Return the long-run covariance of scores: rows of H (R, p) times a factor (R,) each.

    `time` and `run` as in `newey_west`.
    """
    summed = by_instant(H, factor, time, run)
    return long_run([[one] for one in summed], sum(map(len, summed)))


def by_instant(H: Array, factor: Array, time: Array, run: Array) -> list[Array]:
    """Return the scores (T, p) of each log, those of one instant summed, gaps filled with zero."""
    summed = []
    for one in np.unique(run):
        rows = run == one
        instants = np.unique(time[rows])
        slot = slots(time[rows], instants[0], row_step(instants))
        summed.append(at_slots(H if np.all(rows) else H[rows], factor[rows], slot))
    return summed


def row_step(instants: Array) -> float:
    """Return the time [s] between rows, from the instants (I,) of those that are there."""
    steps = np.diff(instants)
    return float(np.mean(steps[steps < 1.5 * np.min(steps)])) if len(steps) else 1.0


def slots(time: Array, start_s: float, step_s: float) -> IndexArray:
    """Return the instant that each row belongs to, counted from a start."""
    return np.asarray(np.round((time - start_s) / step_s), dtype=np.intp)


def at_slots(H: Array, factor: Array, slot: IndexArray) -> Array:
    """Return the sum of the scores, rows of H (R, p) times a factor (R,), of each slot."""
    shape = (int(np.max(slot)) + 1, len(H))
    gather = sparse.csr_array((factor, (slot, np.arange(len(slot)))), shape=shape)
    return np.asarray(gather @ H)


def long_run(runs: Iterable[Iterable[Array]], instants: int) -> LongRun:
    """Return the long-run covariance of scores by instant: chunks (T, p) of each log.

    `instants` is the length of all together. Logs are independent of each other, chunks of one
    follow each other in time and are asked for once.
    """
    lags = automatic_lags(instants)
    sums = [bartlett(run, lags) for run in runs]
    return LongRun(
        covariance=np.asarray(fixed_b(lags, instants) * sum(weighted for weighted, _ in sums)),
        white=np.asarray(sum(white for _, white in sums)),
        lags=lags,
    )


def fixed_b(lags: int, instants: int) -> float:
    """Return the factor on a variance for a bandwidth that is a sizeable part of the instants."""
    b = min((lags + 1) / max(instants, 1), 1.0)
    grown = sum(factor * b**power for power, factor in enumerate(_FIXED_B, 1))
    return float((1 + grown / _NORMAL) ** 2)


def bartlett(chunks: Iterable[Array], lags: int) -> tuple[Array, Array]:
    """Return sums (p, p) of lagged products of scores: Bartlett weights up to `lags`, and no lag.

    `chunks` (T, p) follow each other in time. The sum over windows of lags + 1 instants of what
    falls into each is the same as the weighted sum over lags, at a cost that does not grow with
    them, positive semidefinite as it stands; only the last `lags` instants need remembering.
    """
    chunks = iter(chunks)
    first = next(chunks)
    tail = np.zeros((lags, first.shape[1]))
    weighted = white = np.zeros((first.shape[1], first.shape[1]))
    for chunk in chain([first], chunks, [np.zeros_like(tail)]):
        padded = np.concatenate([tail, chunk])
        reached = np.cumsum(np.pad(padded, ((1, 0), (0, 0))), axis=0)
        windows = reached[lags + 1 :] - reached[: -lags - 1]
        weighted = weighted + windows.T @ windows
        white = white + chunk.T @ chunk
        tail = padded[len(padded) - lags :]
    return weighted / (lags + 1), white
