"""Covariance of an estimate whose residuals are correlated in time."""

from __future__ import annotations

import numpy as np

from seaid.arrays import Array

LAG_S = 0.25


def newey_west(scores: Array, time: Array, run: Array, lag_s: float = LAG_S) -> Array:
    """Return the long-run covariance (p, p) of the sum of scores (Newey and West 1987).

    `scores` (R, p) are the rows of the regressor times their residual, `time` (R,) [s] and `run`
    (R,) tell when and in which log. Rows of one instant (several joints) belong together; instants
    that were left out count as zero. Bartlett weights up to `lag_s`.
    """
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for one in np.unique(run):
        rows = run == one
        instants, where = np.unique(time[rows], return_inverse=True)
        step = float(np.min(np.diff(instants))) if len(instants) > 1 else 1.0
        slots = np.round((instants - instants[0]) / step).astype(int)
        summed = np.zeros((slots[-1] + 1, scores.shape[1]))
        np.add.at(summed, slots[where], scores[rows])
        total += summed.T @ summed
        lags = min(int(lag_s / step), len(summed) - 1)
        for lag in range(1, lags + 1):
            cross = summed[lag:].T @ summed[:-lag]
            total += (1 - lag / (lags + 1)) * (cross + cross.T)
    return total
