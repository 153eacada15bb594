"""Checks of an estimate: is each term worth having, is the residual white, what is told badly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from seaid.arrays import Array
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.covariance import by_instant
from seaid.estimation.directions import directions
from seaid.estimation.estimate import Estimate
from seaid.estimation.information import Information, triangle
from seaid.regression import Regression

POORLY_TOLD = 1e-2
"""A combination of which the data tell less than this part of the best one is named."""

_WHITENESS_LAGS = 10


@dataclass(frozen=True, eq=False)
class TermTest:
    """Is a group of parameters worth having? Without them the residual grows by `growth`.

    `growth` is the sum of squared residuals without the `terms` over that with them; `F` and
    `p_value` test that they are zero; `bic` is the Bayesian information criterion without the terms
    minus that with them: more than zero where they are worth having (Schwarz 1978). `independent`
    is the number of independent rows that this was computed with.
    """

    terms: tuple[str, ...]
    growth: float
    F: float
    p_value: float
    bic: float
    independent: float


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Correlation in time of one equation's residual.

    `first` is the autocorrelation between rows that follow each other, `durbin_watson` 2 for white
    noise and 0 for a constant; `p_value` that of Ljung and Box (1978) for no correlation over ten
    rows. Rows behind a low pass are correlated even if nothing is missing in the model.
    """

    first: float
    durbin_watson: float
    p_value: float


def poorly_told(
    information: Information, share: float = POORLY_TOLD, factor: Array | None = None
) -> list[str]:
    """Return a sentence for each combination of which rows tell less than `share`, worst first.

    Columns count with unit norm, and the best combination as 1: 'the data tell 3.1e-04 of the
    combination A - 0.97 B'. `factor` is the weighted one; None: all rows count alike.
    """
    factor = information.weighted_factor() if factor is None else factor
    found = directions(factor, information.names)
    return [
        f"the data tell {found.shares[place]:.1e} of the combination {found.text(int(place))}"
        for place in np.flatnonzero(found.shares < share)[::-1]
    ]


def independent_rows(information: Information, estimate: Estimate) -> float:
    """Return how many independent rows tell as much as the correlated ones of an estimate.

    From how much its variances exceed those for white noise, in the middle of all parameters.
    """
    white = estimate.white_standard_errors
    if white is None or not len(white) or not np.all(white > 0):
        return float(information.count)
    inflation = float(np.median((estimate.standard_errors / white) ** 2))
    return information.count / max(inflation, 1.0)


def term_test(
    information: Information,
    weights: Array,
    terms: Sequence[str],
    independent: float | None = None,
    factor: Array | None = None,
) -> TermTest:
    """Return whether a group of `terms` is worth having, from the information alone.

    `weights` (E,) of the equations are held, `factor` is the weighted factor if it is at hand.
    `independent` rows (default: all of them, right for white noise) see `independent_rows`. Raises
    IdentificationError for unknown terms and for no more independent rows than parameters.
    """
    for term in terms:
        if term not in information.names:
            message = unknown_name("parameter", term, information.names)
            raise IdentificationError(f"terms=: {message}")
    rows = float(information.count) if independent is None else independent
    p, q = len(information.names), len(terms)
    if rows <= p or not q:
        raise IdentificationError(
            f"a test needs terms and more independent rows than parameters, found {q} terms, "
            f"{rows:.1f} rows and {p} parameters"
        )
    R = information.weighted_factor(weights) if factor is None else factor
    kept = [place for place, name in enumerate((*information.names, "")) if name not in terms]
    first = min(place for place, name in enumerate(information.names) if name in terms)
    below = [place for place in kept if place >= first]  # what is above stays triangular
    full, fewer = R[-1, -1] ** 2, triangle(R[first:, below])[-1, -1] ** 2
    growth = float(fewer / full) if full > 0 else float("inf")
    F = (rows - p) / q * (growth - 1)
    return TermTest(
        terms=tuple(terms),
        growth=growth,
        F=F,
        p_value=float(f_distribution.sf(F, q, rows - p)),
        bic=float(rows * np.log(growth) - q * np.log(rows)),
        independent=rows,
    )


def whiteness(rows: Regression, theta: Array) -> dict[int, Whiteness]:
    """Return how correlated in time the residual of each equation is, by its joint's index."""
    residual = rows.y - rows.H @ theta
    found = {}
    for joint in np.unique(rows.joint):
        mine = rows.joint == joint
        count = int(np.sum(mine))
        runs = by_instant(np.ones((count, 1)), residual[mine], rows.time[mine], rows.run[mine])
        lagged = [
            sum(float(np.sum(run[lag:] * run[: max(len(run) - lag, 0)])) for run in runs)
            for lag in range(_WHITENESS_LAGS + 1)
        ]
        r = np.array(lagged[1:]) / lagged[0] if lagged[0] > 0 else np.zeros(_WHITENESS_LAGS)
        left = np.maximum(count - np.arange(1, _WHITENESS_LAGS + 1), 1)
        Q = count * (count + 2) * np.sum(r**2 / left)
        changes = sum(float(np.sum(np.diff(run, axis=0) ** 2)) for run in runs)
        found[int(joint)] = Whiteness(
            first=float(r[0]),
            durbin_watson=changes / lagged[0] if lagged[0] > 0 else 2.0,
            p_value=float(chi2.sf(Q, _WHITENESS_LAGS)),
        )
    return found
