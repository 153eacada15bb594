"""Comparison of blocks: whether parts of the data agree within the errors of the whole.

What changes from log to log, or slower than the bandwidth of the covariance, is not in it. The
residuals of at least eight blocks, and of the logs, give the variance of the estimate again. The
ratio of both is that of Birge (1932): chi-square per degree of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import fdtri

from seaid._arrays import Array
from seaid.errors import Finding
from seaid.estimation.qr_factor import QRFactor, combined, qr_factor_of

if TYPE_CHECKING:
    from seaid.regressor import Regression

FEWEST_BLOCKS = 8

_LEAST_LEFT = 0.3
"""Least part of the variance of a parameter, left between blocks by the fit, that is compared."""

_LEVEL = 0.995
"""Probability below which a ratio is chance."""

_FEWEST_FREEDOM = 2
"""Fewest degrees of freedom between blocks: two logs say little."""

_DISAGREE = 2.0
"""Ratio from which there is a finding; smaller ones only enlarge the standard errors."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """The ratios of Birge (p,): variance by blocks over variance by autocorrelation.

    They are 1 for parameters that are not compared, and all of them if they may be chance. `blocks`
    is the number of blocks.
    """

    ratios: Array
    blocks: int

    @property
    def factors(self) -> Array:
        """Factors (p,) on the variances."""
        return np.maximum(self.ratios, 1.0)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A finding if the blocks disagree."""
        worst = float(np.max(self.ratios, initial=1.0))
        if worst < _DISAGREE:
            return ()
        message = (
            f"{self.blocks} parts of the data disagree: their estimates scatter up to "
            f"{worst**0.5:.1f} times as much as their residuals explain; the standard errors were "
            "enlarged so much"
        )
        return (
            Finding(
                "blocks-disagree",
                message,
                evidence={"chi-square per degree of freedom": worst},
                remedy="look for what changed between or during the logs: encoder offsets, payload,"
                " temperature, a drifting sensor; identify the logs one by one",
            ),
        )


def block_factors(
    pieces: Iterable[Regression], spans: Mapping[int, tuple[float, float]]
) -> list[tuple[int, QRFactor]]:
    """Return log and QR factor of blocks of rows; `spans` {log: first and last instant [s]}."""
    per_log = math.ceil(FEWEST_BLOCKS / max(len(spans), 1))
    found: dict[tuple[int, int], list[QRFactor]] = {}
    for rows in pieces:
        for log in np.unique(rows.run).astype(int):
            start, end = spans[log]
            part = (rows.time - start) / (end - start if end > start else 1.0)
            place = np.minimum((part * per_log).astype(int), per_log - 1)
            mine = rows.run == log
            for one in np.unique(place[mine]):
                own = rows.at(mine & (place == one))
                found.setdefault((log, int(one)), []).append(qr_factor_of(own))
    return [(log, combined(parts)) for (log, _), parts in found.items()]


def spans_of(rows: Regression) -> dict[int, tuple[float, float]]:
    """Return {log: first and last instant [s]} of rows in memory."""
    found = {}
    for log in np.unique(rows.run).astype(int):
        time = rows.time[rows.run == log]
        found[log] = float(time.min()), float(time.max())
    return found


def agreement(
    blocks: list[tuple[int, Array]], values: Array, root: Array, variance: Array, freedom: float
) -> Agreement:
    """Return the ratios; each of `blocks` has its log and weighted factor R (q+1, q+1) of [H C y].

    `values` (q,) are those of the whole fit, `root` (p, p) with root root^T the inverse of its
    normal equations, `variance` (p,) that by autocorrelation, with its degrees of `freedom`.
    """
    inverse, p = root @ root.T, len(root)
    sums, removed = [], []
    for _, R in blocks:
        influence = inverse @ R[:, :p].T
        sums.append(influence @ (R @ np.append(-values, 1.0)))
        removed.append(influence @ (R[:, :p] @ root))
    logs = np.array([log for log, _ in blocks])
    ratios, count = np.ones(p), len(blocks)
    for parts in (np.arange(len(blocks)), logs):
        groups = [np.flatnonzero(parts == one) for one in np.unique(parts)]
        between = sum(np.sum([sums[i] for i in own], axis=0) ** 2 for own in groups)
        lost = sum(np.sum(sum(removed[i] for i in own) ** 2, axis=1) for own in groups)
        left = 1 - lost / np.diag(inverse)
        found = _ratios(between, left, variance, len(groups) - 1, freedom)
        if np.max(found, initial=1.0) > np.max(ratios, initial=1.0):
            ratios, count = found, len(groups)
    return Agreement(ratios, count)


def _ratios(
    between: Array, left: Array, variance: Array, own_freedom: int, freedom: float
) -> Array:
    """Return the ratios (p,) of one division into blocks, all of them 1 if they may be chance."""
    seen, ratios = (left > _LEAST_LEFT) & (variance > 0), np.ones(len(between))
    if own_freedom < _FEWEST_FREEDOM or not np.any(seen):
        return ratios
    own = between[seen] / (left[seen] * variance[seen])
    # parameters share noise: degrees of freedom of their mean grow with the root of their number
    root_count = math.sqrt(np.sum(seen))
    least_mean = fdtri(own_freedom * root_count, freedom * root_count, _LEVEL)
    least_own = fdtri(own_freedom, freedom, 1 - (1 - _LEVEL) / np.sum(seen))
    if np.mean(own) > least_mean or np.max(own) > least_own:
        ratios[seen] = own
    return ratios
