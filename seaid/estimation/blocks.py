"""Comparison of blocks: whether parts of the data agree within the errors of the whole.

What changes from log to log, or slower than the bandwidth of the covariance, is not in it. The
residuals of at least eight blocks, or of the logs if there are more, give the variance of the
estimate a second time. The ratio of both is that of Birge (1932): chi-square per degree of freedom.
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

_LEVEL = 0.99
"""Probability below which a ratio is chance."""

_DISAGREE = 2.0
"""Ratio from which there is a finding; smaller ones only enlarge the standard errors."""


@dataclass(frozen=True)
class Agreement:
    """The ratio of Birge: variance by blocks over variance by autocorrelation.

    `blocks` is their number, `least` the smallest ratio that is not chance.
    """

    ratio: float
    blocks: int
    least: float

    @property
    def factor(self) -> float:
        """Factor on the covariance."""
        return max(self.ratio, 1.0) if self.ratio > self.least else 1.0

    @property
    def findings(self) -> tuple[Finding, ...]:
        """A finding if the blocks disagree."""
        if self.factor < _DISAGREE:
            return ()
        message = (
            f"{self.blocks} parts of the data disagree: their estimates scatter "
            f"{self.ratio**0.5:.1f} times as much as their residuals explain; the standard errors "
            "were enlarged so much"
        )
        return (
            Finding(
                "blocks-disagree",
                message,
                evidence={"chi-square per degree of freedom": self.ratio},
                remedy="look for what changed between or during the logs: encoder offsets, payload,"
                " temperature, a drifting sensor; identify the logs one by one",
            ),
        )


def block_factors(
    pieces: Iterable[Regression], spans: Mapping[int, tuple[float, float]]
) -> list[QRFactor]:
    """Return the QR factors of blocks of rows; `spans` {log: first and last instant [s]}."""
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
    return [combined(parts) for parts in found.values()]


def spans_of(rows: Regression) -> dict[int, tuple[float, float]]:
    """Return {log: first and last instant [s]} of rows in memory."""
    found = {}
    for log in np.unique(rows.run).astype(int):
        time = rows.time[rows.run == log]
        found[log] = float(time.min()), float(time.max())
    return found


def agreement(
    blocks: list[Array],
    inverse: Array,
    fit: tuple[Array, Array],
    variance: Array,
    freedom: float,
) -> Agreement:
    """Return the ratio for `blocks`, each with its weighted factor R (q+1, q+1) of [H C y].

    `inverse` (p, p) is (H^T W^2 H)^-1, `fit` (theta, root) that of [H C] to y with root root^T the
    inverse of its normal equations, `variance` (p,) that by autocorrelation, with its degrees of
    `freedom`.
    """
    theta, root = fit
    p, q = len(inverse), len(theta)
    between, lost = np.zeros(p), np.zeros(p)
    for R in blocks:
        influence = inverse @ R[:, :p].T
        between += (influence @ (R @ np.append(-theta, 1.0))) ** 2
        lost += np.sum((influence @ (R[:, :q] @ root)) ** 2, axis=1)
    left = 1 - lost / np.diag(inverse)
    seen = (left > _LEAST_LEFT) & (variance > 0)
    if not np.any(seen):
        return Agreement(1.0, len(blocks), 1.0)
    ratio = float(np.mean(between[seen] / (left[seen] * variance[seen])))
    # parameters share noise: the degrees of freedom grow with the root of their number
    own = (len(blocks) - 1) * math.sqrt(np.sum(seen)) * float(np.mean(left[seen]))
    least = float(fdtri(own, freedom * math.sqrt(np.sum(seen)), _LEVEL))
    return Agreement(ratio, len(blocks), least)
