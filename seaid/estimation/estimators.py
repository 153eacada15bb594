"""The estimators by name.

Robust estimates: rows that do not fit count less, so that spikes and saturation do little.

M-estimates (Huber 1964; Beaton and Tukey 1974) by iteratively reweighted least squares. The scale
of each equation is the median of its absolute residuals, which up to half of its rows cannot spoil.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.covariance import long_run_of
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import (
    equal_weights,
    estimate_of,
    ordinary,
    settled_weights,
    solve,
    weighted,
)
from seaid.estimation.qr_factor import QRFactor, equation_name, qr_factor_of
from seaid.regressor import Regression

HUBER = 1.345
"""Residual in scales from which Huber's weight falls: 95 % efficient for Gaussian noise."""

TUKEY = 4.685
"""Residual in scales from which on Tukey's weight is zero: 95 % efficient for Gaussian noise."""

_GAUSSIAN = 1.4826
"""Standard deviation of Gaussian noise over the median of its absolute values."""

_MOST_ITERATIONS = 500
_SETTLED = 1e-6
_EXACT = 1e-10

Weighing = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Outliers:
    """Which rows fit badly: `weights` (R,) are what Huber's function gives each of them.

    `shares` {equation: part of its rows that counts less than half}, by the joint's name ("motor of
    knee_pitch" for the motor equation where both sides are stacked); `words` say how many and when.
    """

    shares: Mapping[str, float]
    weights: Array
    words: tuple[str, ...]


def huber(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return Huber's estimate: rows farther off than 1.345 scales count by their sign alone.

    Scale and estimate are iterated together, from ordinary least squares on. The covariance is the
    sandwich with the correlation of the scores in time (Newey-West); `residual_std` is the scale
    without the outliers. `propagated` as in `ordinary`, and so are the errors; IdentificationError
    too where the iteration does not settle.
    """
    theta, scales = _huber(rows)
    return _estimate(rows, theta, scales, huber_weights, propagated)


def tukey(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return Tukey's bisquare estimate: rows farther off than 4.685 scales do not count at all.

    Iterated from Huber's estimate on, with its scales held. Otherwise as `huber`.
    """
    start, scales = _huber(rows)
    theta, _ = _iterated(rows, start, lambda _: scales, tukey_weights)
    return _estimate(rows, theta, scales, tukey_weights, propagated)


def outliers(rows: Regression, estimate: Estimate) -> Outliers:
    """Return which rows an estimate of theirs does not fit, whatever estimator it is from."""
    residual = rows.y - rows.H @ estimate.values
    weights = huber_weights(residual / _scales(rows, residual))
    weights.setflags(write=False)
    bad = weights < 0.5
    shares, words = {}, []
    for name, mine in _equations(rows):
        shares[name] = float(np.mean(bad[mine]))
        if np.any(bad & mine):
            words.append(
                f"{np.sum(bad & mine)} of {np.sum(mine)} rows of {name} count less than half, "
                f"{_when(rows, bad & mine)}"
            )
    return Outliers(FrozenMapping(shares), weights, tuple(words))


def without_outliers(rows: Regression, estimate: Estimate) -> Regression:
    """Return the rows times the root of Tukey's weight of each, for checks of the estimate."""
    residual = rows.y - rows.H @ estimate.values
    return _scaled(rows, np.sqrt(tukey_weights(residual / _scales(rows, residual))))


def huber_weights(u: Array) -> Array:
    """Return the weights of residuals in scales, psi(u)/u of Huber's psi."""
    return np.asarray(HUBER / np.maximum(np.abs(u), HUBER))


def tukey_weights(u: Array) -> Array:
    """Return the weights of residuals in scales, psi(u)/u of Tukey's bisquare."""
    return np.asarray(np.maximum(1 - (u / TUKEY) ** 2, 0.0) ** 2)


def _huber(rows: Regression) -> tuple[Array, Array]:
    """Return Huber's parameters (p,) and the scale of each row (R,)."""
    qr_factor = qr_factor_of(rows)
    start = solve(qr_factor, equal_weights(qr_factor)).values
    return _iterated(rows, start, lambda residual: _scales(rows, residual), huber_weights)


def _iterated(
    rows: Regression, theta: Array, scales_of: Callable[[Array], Array], weigh: Weighing
) -> tuple[Array, Array]:
    """Return parameters and scales (R,) that no further weighing of the rows changes."""
    size = float(np.sqrt(np.mean(rows.y**2)))
    for _ in range(_MOST_ITERATIONS):
        residual = rows.y - rows.H @ theta
        scales = scales_of(residual)
        qr_factor = qr_factor_of(_scaled(rows, np.sqrt(weigh(residual / scales)) / scales))
        new = solve(qr_factor, equal_weights(qr_factor)).values
        moved = np.abs(rows.H @ (new - theta))
        theta = new
        if np.all(moved <= np.maximum(_SETTLED * scales, _EXACT * size)):
            return theta, scales
    worst = int(np.argmax(moved / scales))
    raise IdentificationError(
        f"the weights of the rows do not settle in {_MOST_ITERATIONS} turns: at "
        f"{rows.time[worst]:.3g} s the fit still moves by {moved[worst] / scales[worst]:.1e} of "
        "the residual's scale; record a longer log, or use estimator='wls'"
    )


def _estimate(
    rows: Regression, theta: Array, scales: Array, weigh: Weighing, propagated: Array | None
) -> Estimate:
    """Return the estimate with its sandwich covariance, at parameters that have settled.

    Linearised there it is least squares: the weights' information times what each equation's psi
    rises by (its derivative), with residuals enlarged so that the scores are those of psi.
    """
    residual = rows.y - rows.H @ theta
    u = residual / scales
    weights, step = weigh(u), 1e-6
    rise = (weigh(u + step) * (u + step) - weigh(u - step) * (u - step)) / (2 * step)
    slope = np.empty_like(u)
    for _, mine in _equations(rows):  # positive: half of the rows are within 0.67 scales
        slope[mine] = np.sum(rise[mine]) / np.sum(weights[mine])
    root = np.sqrt(weights * slope) / scales
    linear = _scaled(replace(rows, y=rows.H @ theta + residual / slope), root)
    scores = long_run_of(linear.H, linear.y - linear.H @ theta, rows.time, rows.run)
    qr_factor = qr_factor_of(linear)
    found = estimate_of(qr_factor, equal_weights(qr_factor), scores, propagated)
    independent = replace(scores, covariance=scores.white)
    white = estimate_of(qr_factor, equal_weights(qr_factor), independent, propagated)
    return replace(
        found,
        residual_std=float(np.sqrt(np.mean(scales**2))),
        white_standard_errors=white.standard_errors,
    )


def _scaled(rows: Regression, factor: Array) -> Regression:
    """Return the rows times a factor (R,) each."""
    column = factor[:, None]
    return replace(rows, H=column * rows.H, y=factor * rows.y, propagated=column * rows.propagated)


def _scales(rows: Regression, residual: Array) -> Array:
    """Return the scale (R,) of each row's equation: a standard deviation if noise is Gaussian."""
    scales = np.empty_like(residual)
    smallest = 1e-9 * float(np.sqrt(np.mean(rows.y**2))) or 1.0
    for _, mine in _equations(rows):
        scales[mine] = max(_GAUSSIAN * float(np.median(np.abs(residual[mine]))), smallest)
    return scales


def _equations(rows: Regression) -> Iterator[tuple[str, BoolArray]]:
    """Give the name of each equation and its rows (R,)."""
    for index in np.unique(rows.joint).astype(int):
        yield equation_name(rows.joint_names, index), rows.joint == index


def _when(rows: Regression, bad: BoolArray) -> str:
    """Say between which instants of which log more than half of some rows are."""
    runs, counts = np.unique(rows.run[bad], return_counts=True)
    time = np.sort(rows.time[bad & (rows.run == runs[np.argmax(counts)])])
    half = len(time) // 2
    first = int(np.argmin(time[half:] - time[: len(time) - half]))
    several = bool(np.ptp(rows.run))
    which = f"most of those in log {int(runs[np.argmax(counts)]) + 1}" if several else "most"
    return f"{which} between {time[first]:.1f} and {time[first + half]:.1f} s"


def all_alike(rows: Regression, estimate: Estimate) -> Regression:
    """Return the rows as they are: an estimate that sees all of them."""
    return rows


@dataclass(frozen=True)
class Estimator:
    """`solve` estimates from rows; `weigh` gives equations' weights where R factors are enough.

    `seen` returns the rows as the estimate sees them, for the checks of it.
    """

    solve: Callable[[Regression, Array | None], Estimate]
    weigh: Callable[[QRFactor], Array] | None = None
    seen: Callable[[Regression, Estimate], Regression] = all_alike


ESTIMATORS = FrozenMapping(
    {
        "ols": Estimator(ordinary, equal_weights),
        "wls": Estimator(weighted, settled_weights),
        "huber": Estimator(huber, seen=without_outliers),
        "tukey": Estimator(tukey, seen=without_outliers),
    }
)


def estimator_named(name: str) -> Estimator:
    """Return an estimator. Raises IdentificationError with the nearest name."""
    if name not in ESTIMATORS:
        raise IdentificationError(
            "estimator=: " + unknown_name("estimator", name, [*ESTIMATORS, "iv"])
        )
    return ESTIMATORS[name]
