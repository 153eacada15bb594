"""Slow errors, which autocorrelation within the bandwidth of the covariance does not show.

Noise with a flat spectrum and a random walk have together the spectrum s^2 (1 + (f_c/f)^2): below
the corner f_c drift outweighs noise, and the parameters of slow signals (gravity, offsets) take
most of it out of the residual. The restricted likelihood (Patterson and Thompson 1971) of the
lowest cosines of the rows allows for that: its maximum is f_c. What drift adds to the error of the
estimate follows from f_c.

What changes from log to log shows in blocks: the residuals of at least eight blocks, and of the
logs, give the variance of the estimate again. The ratio of both is that of Birge (1932):
chi-square per degree of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import scipy
from scipy import linalg

from seaid._arrays import Array, BoolArray, safely
from seaid.estimation.covariance import MOST_FREEDOM, at_slots, row_step, slots
from seaid.estimation.estimate import Drift, Estimate
from seaid.estimation.qr_factor import QRFactor, combined, qr_factor_of, triangle

if TYPE_CHECKING:
    from seaid.regressor import Regression

_FLAT, _HIGHEST = 0.7, 0.25
"""Parts of the cutoff below which the spectrum of the noise is flat, and corners are sought."""

_CORNERS = 8
"""Corners that are compared, a factor of about 1.6 apart in a log of six seconds."""

_SIGNIFICANT = 4.0
"""Ratio of likelihoods (twice its logarithm) from which drift is in the covariance."""

_LEAST_SHARE, _LARGEST_SHARE = 1e-3, 0.2
"""Drift as a part of the rms torque below which it is a numerical error, or harmless, and from
which it is none: the model lacks something then, or the stiffness of a spring is far off."""

_FEWEST = 8
"""Fewest cosines above the highest corner, which determine the noise."""

_DEPENDENT, _ROUNDING = 1e-7, 1e-6
"""Part of a unit column outside the span of those before it, below which it depends on them; and
what rounding may add to the number of cosines below a frequency, before it is rounded up."""


@dataclass(frozen=True, eq=False)
class _Band:
    """Weighted rows [H C y] (K, c) of an equation in cosines of `frequency_hz` (K,).

    `changes` (K,) masks the cosines that are not the mean of a log.
    """

    equation: int
    frequency_hz: Array
    changes: BoolArray
    rows: Array


def drifts_of(
    rows: Regression, weights: Array, cutoff_hz: float
) -> tuple[tuple[Drift, Array], ...]:
    """Return the significant drifts, the clearest first; `weights` (E,) are of the equations.

    The array (p, K) of a drift, times normal numbers, is its effect on the right-hand side of the
    weighted normal equations.

    Equations share parameters, so that the drift of one is in the residuals of others.
    """
    bands = [
        _band(rows, int(equation), weight, _FLAT * cutoff_hz)
        for equation, weight in zip(np.unique(rows.joint), weights, strict=True)
    ]
    highest_hz = _HIGHEST * cutoff_hz
    if any(np.sum(band.frequency_hz > highest_hz) < _FEWEST for band in bands):
        return ()
    scaled = _independent(bands)
    levels = _levels(scaled, highest_hz)
    if not np.all(levels > 0):  # a log without noise
        return ()
    scaled = _orthonormal(scaled, levels)
    likelihoods = [_likelihood(band, highest_hz) for band in scaled]
    count = sum(len(band.rows) for band in scaled)
    drifts: list[tuple[Drift, Array]] = []
    for best, corner, ratio in _sought(likelihoods, count):
        corner_hz = float(likelihoods[best].corners_hz[corner])
        drift, influence = _drift(rows, bands[best], corner_hz, ratio, levels[best], weights[best])
        # A drift that small is a numerical error, and one that large a defect of the model: it
        # stays in the residual, and only the search for drifts of other equations allows for it.
        if _LEAST_SHARE <= drift.share < _LARGEST_SHARE:
            drifts.append((drift, influence))
    return tuple(drifts)


def _sought(likelihoods: Sequence[_Likelihood], count: int) -> Iterator[tuple[int, int, float]]:
    """Yield equation, corner and likelihood ratio of the significant drifts of `count` rows.

    Each is sought with those before it known, the clearest first.
    """
    moments = [likelihood.moments[0] for likelihood in likelihoods]
    rest = list(range(len(likelihoods)))
    while rest:
        every = np.sum(moments, axis=0)
        likely = {place: likelihoods[place].best(every - moments[place], count) for place in rest}
        best, (corner, ratio) = max(likely.items(), key=lambda item: item[1][1])
        if ratio < _SIGNIFICANT:  # and so are the ratios of all others
            return
        yield best, corner, ratio
        rest.remove(best)
        moments[best] = likelihoods[best].moments[corner]


def _band(rows: Regression, equation: int, weight: float, highest_hz: float) -> _Band:
    """Return the weighted rows of an equation in cosines below a frequency, by log."""
    frequency, changes, coefficients = [], [], []
    for run in np.unique(rows.run):
        mask = (rows.joint == equation) & (rows.run == run)
        if not np.any(mask):
            continue
        part = rows.at(mask)
        start, step = float(np.min(part.time)), row_step(np.unique(part.time))
        # (rows, p + s + 1) -> (T, p + s + 1) at every instant of the log, zero without a row.
        columns = np.column_stack([part.H, part.propagated, part.y])
        signal = at_slots(columns, np.full(len(columns), weight), slots(part.time, start, step))
        # The cosine of order k over T instants has the frequency k / (2 T step).
        count = min(len(signal), math.ceil(2 * len(signal) * step * highest_hz - _ROUNDING))
        order = np.arange(count)
        changes.append(order > 0)
        # The mean counts as half a step from the first cosine.
        frequency.append(np.maximum(order, 0.5) / (2 * len(signal) * step))
        # Orthonormal: the coefficients of white noise have its standard deviation.
        coefficients.append(scipy.fft.dct(signal, axis=0, norm="ortho")[:count])
    masks = np.concatenate(changes)
    return _Band(equation, np.concatenate(frequency), masks, np.concatenate(coefficients))


def _independent(bands: Sequence[_Band]) -> list[_Band]:
    """Return the equations with columns of at most unit norm, without dependent ones.

    The column of a torque offset is a multiple of the propagated one of the spring offset.
    """
    every = np.concatenate([band.rows for band in bands])
    norms = np.linalg.norm(every, axis=0)
    norms[norms == 0] = norms[-1] = 1.0
    # |R_ii| is the distance of a unit column from the span of those before it.
    diagonal = np.abs(np.diag(triangle(every / norms)))
    kept = [*np.flatnonzero(diagonal[:-1] > _DEPENDENT), every.shape[1] - 1]
    return [replace(band, rows=(band.rows / norms)[:, kept]) for band in bands]


def _levels(bands: Sequence[_Band], highest_hz: float) -> Array:
    """Return the standard deviation (E,) of the residual above the highest corner."""
    every = np.concatenate([band.rows for band in bands])
    Q = np.linalg.qr(every[:, :-1])[0]
    residual, kept = every[:, -1] - Q @ (Q.T @ every[:, -1]), 1 - np.sum(Q**2, axis=1)
    levels, end = [], 0
    for band in bands:
        start, end = end, end + len(band.rows)
        noise = start + np.flatnonzero(band.frequency_hz > highest_hz)
        # s^2 = |r|^2 / tr(1 - Q Q^T) over the cosines above the highest corner, unbiased.
        squares, left = np.sum(residual[noise] ** 2), max(float(np.sum(kept[noise])), 1.0)
        levels.append(math.sqrt(squares / left))
    return np.array(levels)


def _orthonormal(bands: Sequence[_Band], levels: Array) -> list[_Band]:
    """Return the equations over their noise `levels` (E,), in columns that are orthonormal.

    Products of such columns are exact.
    """
    scaled = [band.rows / level for band, level in zip(bands, levels, strict=True)]
    R = triangle(np.concatenate(scaled))
    solved = partial(safely, linalg.solve_triangular, R, what="a drift", trans="T")
    return [replace(band, rows=solved(x.T).T) for band, x in zip(bands, scaled, strict=True)]


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """What the likelihood of the drift of an equation needs, for C corners, the first of them 0.

    `moments` (C, c, c) are those of the rows over noise and drift, `volumes` (C,) their log|V|.
    """

    corners_hz: Array
    moments: Array
    volumes: Array

    def best(self, others: Array, count: int) -> tuple[int, float]:
        """Return the most likely corner and its ratio, with the moments of `others` (c, c)."""
        # The triangle of the moments of [H y] has the root of |H^T V^-1 H| in the product of its
        # first diagonal entries, and that of r^T V^-1 r in its last one.
        lower = safely(np.linalg.cholesky, others + self.moments, what="a drift")
        diagonal = np.log(np.diagonal(lower, axis1=1, axis2=2))
        # -2 log of the restricted likelihood: log|V| + log|H^T V^-1 H| + m log(r^T V^-1 r)
        m = count - others.shape[0] + 1
        deviance = self.volumes + 2 * np.sum(diagonal[:, :-1], axis=1) + 2 * m * diagonal[:, -1]
        best = int(np.argmin(deviance))
        return best, float(deviance[0] - deviance[best])


def _likelihood(band: _Band, highest_hz: float) -> _Likelihood:
    corners = np.append(0.0, np.geomspace(np.min(band.frequency_hz), highest_hz, _CORNERS))
    # the power of noise and drift over that of noise
    spectra = 1 + (corners[:, None] / band.frequency_hz) ** 2
    moments = np.array([band.rows.T @ (band.rows / spectrum[:, None]) for spectrum in spectra])
    return _Likelihood(corners, moments, np.sum(np.log(spectra), axis=1))


def _drift(
    rows: Regression, band: _Band, corner_hz: float, ratio: float, level: float, weight: float
) -> tuple[Drift, Array]:
    """Return the drift of an equation, and its effect, from its weighted rows and their noise."""
    # The root of the drift's part s^2 (f_c / f)^2 of the spectrum at each cosine.
    std = level * corner_hz / band.frequency_hz
    y = rows.y[rows.joint == band.equation]
    # By Parseval the sum over cosines is that over instants; the weight is taken out: [N m].
    rms = float(np.linalg.norm(std[band.changes])) / math.sqrt(len(y)) / weight
    share = rms / max(float(np.std(y)), 1e-300)
    # H^T W^2 d of a drift d whose cosines are independent, with these standard deviations.
    influence = band.rows[:, : len(rows.names)].T * std
    names = rows.joint_names
    joint = names[band.equation % len(names)] if names else ""
    return Drift(joint, corner_hz, share, ratio), influence


def with_drifts(
    estimate: Estimate, inverse: Array, drifts: Sequence[tuple[Drift, Array]]
) -> Estimate:
    """Return the estimate with the drifts in its covariance.

    `inverse` (p, p) is that of the weighted normal equations.
    """
    if not drifts:
        return estimate
    added = np.zeros_like(inverse)
    for _, influence in drifts:
        change = inverse @ influence
        added += change @ change.T
    growth = float(np.max(1 + np.diag(added) / np.diag(estimate.covariance), initial=1.0))
    diagnostics = replace(
        estimate.diagnostics, drifts=tuple(drift for drift, _ in drifts), growth=growth
    )
    return replace(estimate, covariance=estimate.covariance + added, diagnostics=diagnostics)


FEWEST_BLOCKS = 8
"""Fewest blocks of rows, of all logs together, whose disagreement is tested: a log is one block if
there are as many, and divided into parts of equal time if there are fewer."""

_LEAST_LEFT = 0.3
"""Least part of the variance of a parameter, left between blocks by the fit, that is compared."""

_LEVEL = 0.995
"""Probability below which a ratio is chance."""

_FEWEST_FREEDOM = 2
"""Fewest degrees of freedom between blocks: two logs say little."""


def block_factors(
    pieces: Iterable[Regression], spans: Mapping[int, tuple[float, float]]
) -> list[tuple[int, QRFactor]]:
    """Return log and QR factor of blocks of rows; `spans` {log: first and last instant [s]}."""
    per_log = math.ceil(FEWEST_BLOCKS / max(len(spans), 1))
    factors: dict[tuple[int, int], list[QRFactor]] = {}
    for rows in pieces:
        for log in np.unique(rows.run).astype(int):
            start, end = spans[log]
            part = (rows.time - start) / (end - start if end > start else 1.0)
            place = np.minimum((part * per_log).astype(int), per_log - 1)
            of_log = rows.run == log
            for block in np.unique(place[of_log]):
                among = np.flatnonzero(of_log & (place == block))
                factors.setdefault((log, int(block)), []).append(qr_factor_of(rows, among))
    return [(log, combined(parts)) for (log, _), parts in factors.items()]


def spans_of(rows: Regression) -> dict[int, tuple[float, float]]:
    """Return {log: first and last instant [s]} of rows in memory."""
    times = {log: rows.time[rows.run == log] for log in np.unique(rows.run).astype(int)}
    return {log: (float(time.min()), float(time.max())) for log, time in times.items()}


def agreement(
    blocks: list[tuple[int, Array]], values: Array, root: Array, variance: Array, freedom: float
) -> tuple[Array, int]:
    """Return the ratios of Birge (p,), and the number of blocks that they are of.

    They are variance by blocks over variance by autocorrelation: 1 for parameters that are not
    compared, and all of them if they may be chance. Each of `blocks` has its log and weighted
    factor R (q+1, q+1) of [H C y].

    `values` (q,) are those of the whole fit, `root` (p, p) with root root^T the inverse of its
    normal equations, `variance` (p,) that by autocorrelation, with its degrees of `freedom`.
    """
    inverse, p = root @ root.T, len(root)
    sums, removed = [], []
    for _, R in blocks:
        # (H^T W^2 H)^-1 H_b^T W^2 r_b: what the residual of the block b contributes to the
        # estimate. Over all blocks it adds up to zero.
        influence = inverse @ R[:, :p].T
        sums.append(influence @ (R @ np.append(-values, 1.0)))
        # As in `left_by_fit`, x_b^T Q_b with x = H (H^T W^2 H)^-1 and Q = H root.
        removed.append(influence @ (R[:, :p] @ root))
    logs = np.array([log for log, _ in blocks])
    ratios, count = np.ones(p), len(blocks)
    for parts in (np.arange(len(blocks)), logs):
        groups = [np.flatnonzero(parts == part) for part in np.unique(parts)]
        between = sum(np.sum([sums[i] for i in group], axis=0) ** 2 for group in groups)
        lost = sum(np.sum(sum(removed[i] for i in group) ** 2, axis=1) for group in groups)
        # Over all rows the sum of x^2 is the diagonal of (H^T W^2 H)^-1.
        remaining = 1 - lost / np.diag(inverse)
        candidate = _ratios(between, remaining, variance, len(groups) - 1, freedom)
        if np.max(candidate, initial=1.0) > np.max(ratios, initial=1.0):
            ratios, count = candidate, len(groups)
    return ratios, count


def _ratios(
    between: Array, remaining: Array, variance: Array, between_freedom: int, freedom: float
) -> Array:
    """Return the ratios (p,) of one division into blocks, all of them 1 if they may be chance."""
    seen, ratios = (remaining > _LEAST_LEFT) & (variance > 0), np.ones(len(between))
    if between_freedom < _FEWEST_FREEDOM or not np.any(seen):
        return ratios
    seen_ratios = between[seen] / (remaining[seen] * variance[seen])
    freedom = min(freedom, MOST_FREEDOM)  # `fdtri` is NaN for an infinite number
    # parameters share noise: degrees of freedom of their mean grow with the root of their number
    root_count = math.sqrt(np.sum(seen))
    # Both are quantiles of F; that of the largest ratio is at (1 - level) / number (Bonferroni).
    least_mean = scipy.special.fdtri(between_freedom * root_count, freedom * root_count, _LEVEL)
    least_single = scipy.special.fdtri(between_freedom, freedom, 1 - (1 - _LEVEL) / np.sum(seen))
    if np.mean(seen_ratios) > least_mean or np.max(seen_ratios) > least_single:
        ratios[seen] = seen_ratios
    return ratios
