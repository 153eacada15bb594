"""Diagnostics of an estimate: poorly determined directions, significance of terms, whiteness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from seaid._arrays import Array
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.covariance import by_instant
from seaid.estimation.estimate import Estimate
from seaid.estimation.qr_factor import QRFactor, triangle
from seaid.estimation.singular_directions import directions

if TYPE_CHECKING:
    from seaid.regressor import Regression

POORLY_DETERMINED = 1e-2
"""Singular value, relative to the largest, below which a combination is poorly determined."""

_WHITENESS_LAGS = 10


@dataclass(frozen=True, eq=False)
class TermTest:
    """Significance of a group of parameters.

    `growth` is the sum of squared residuals without the `terms` over that with them; `F` and
    `p_value` test the hypothesis that they are zero; `bic` is the Bayesian information criterion
    (Schwarz 1978) without the terms minus that with them, positive if the data support them;
    `independent` is the number of independent rows assumed.
    """

    terms: tuple[str, ...]
    growth: float
    F: float
    p_value: float
    bic: float
    independent: float


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Autocorrelation of the residual of one equation.

    `first` is the autocorrelation at lag one; `durbin_watson` is 2 for white noise and 0 for a
    constant; `p_value` is that of Ljung and Box (1978) for no autocorrelation over ten lags. Rows
    behind a low pass are autocorrelated even if the model is complete.
    """

    first: float
    durbin_watson: float
    p_value: float


def poorly_determined(
    qr_factor: QRFactor, share: float = POORLY_DETERMINED, factor: Array | None = None
) -> list[str]:
    """Return a sentence per combination with a singular value below `share`, worst first.

    Columns are scaled to unit norm, and the largest singular value counts as 1. `factor`
    (p+1, p+1) is the weighted factor; None: all rows have weight one.
    """
    factor = qr_factor.weighted_factor() if factor is None else factor
    found = directions(factor, qr_factor.names)
    return [
        f"scaled singular value {found.shares[place]:.1e} of the combination "
        f"{found.text(int(place))}"
        for place in np.flatnonzero(found.shares < share)[::-1]
    ]


def independent_rows(qr_factor: QRFactor, estimate: Estimate) -> float:
    """Return the number of independent rows that give the standard errors of the correlated ones.

    It is the number of rows over the median ratio of the variances to those for white noise.
    """
    white = estimate.white_standard_errors
    if white is None or not len(white) or not np.all(white > 0):
        return float(qr_factor.count)
    inflation = float(np.median((estimate.standard_errors / white) ** 2))
    return qr_factor.count / max(inflation, 1.0)


def term_test(
    qr_factor: QRFactor,
    weights: Array,
    terms: Sequence[str],
    independent: float | None = None,
    factor: Array | None = None,
) -> TermTest:
    """Return the significance of a group of `terms`, from the QR factor alone.

    `weights` (E,) of the equations are kept; `factor` is the weighted factor if available;
    `independent` is the number of independent rows (default: all rows, right for white noise), see
    `independent_rows`. Raises IdentificationError for unknown terms, and unless there are more
    independent rows than parameters.
    """
    for term in terms:
        if term not in qr_factor.names:
            message = unknown_name("parameter", term, qr_factor.names)
            raise IdentificationError(f"terms=: {message}")
    rows = float(qr_factor.count) if independent is None else independent
    p, q = len(qr_factor.names), len(terms)
    if rows <= p or not q:
        raise IdentificationError(
            f"a test needs terms and more independent rows than parameters, found {q} terms, "
            f"{rows:.1f} rows and {p} parameters"
        )
    R = qr_factor.weighted_factor(weights) if factor is None else factor
    kept = [place for place, name in enumerate((*qr_factor.names, "")) if name not in terms]
    first = min(place for place, name in enumerate(qr_factor.names) if name in terms)
    below = [place for place in kept if place >= first]  # columns before stay triangular
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
    """Return the autocorrelation of the residual of each equation, by joint index."""
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
        Q = count * (count + 2) * np.sum(r**2 / left)  # Ljung and Box 1978
        changes = sum(float(np.sum(np.diff(run, axis=0) ** 2)) for run in runs)
        found[int(joint)] = Whiteness(
            first=float(r[0]),
            durbin_watson=changes / lagged[0] if lagged[0] > 0 else 2.0,
            p_value=float(chi2.sf(Q, _WHITENESS_LAGS)),
        )
    return found


@dataclass(frozen=True, eq=False)
class ModelChecks:
    """Checks of the model of one regression.

    `condition_number` is that of columns of unit norm; `poorly_determined` names combinations that
    the data determine poorly; `terms` tests each optional term of the drives; `whiteness` {joint:
    `Whiteness` of its residual} is empty if the rows were not kept in memory.
    """

    condition_number: float
    poorly_determined: tuple[str, ...]
    terms: tuple[TermTest, ...]
    whiteness: Mapping[str, Whiteness]


def model_checks(
    qr_factor: QRFactor,
    estimate: Estimate,
    optional: Sequence[str],
    whiteness: Mapping[str, Whiteness],
    weights: Array,
) -> ModelChecks:
    """Return the checks of an estimate from its QR factor and the `settled_weights`."""
    factor = qr_factor.weighted_factor(weights)
    independent = independent_rows(qr_factor, estimate)
    return ModelChecks(
        condition_number=estimate.condition_number,
        poorly_determined=tuple(poorly_determined(qr_factor, factor=factor)),
        terms=tuple(
            term_test(qr_factor, weights, [name], independent, factor)
            for name in optional
            if independent > len(qr_factor.names)
        ),
        whiteness=whiteness,
    )
