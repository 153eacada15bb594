"""Checks of an estimate: is each term worth having, is the residual white, what is told badly.

Is a larger model worth it? BIC over independent rows, and prediction of blocks left out.

Is the model right? What is checked of one regression, for a report.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from seaid._arrays import Array, BoolArray, safely
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.covariance import by_instant
from seaid.estimation.estimate import Estimate
from seaid.estimation.qr_factor import QRFactor, directions, qr_factor_of, triangle
from seaid.regressor import Regression

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


def poorly_determined(
    qr_factor: QRFactor, share: float = POORLY_TOLD, factor: Array | None = None
) -> list[str]:
    """Return a sentence for each combination of which rows tell less than `share`, worst first.

    Columns count with unit norm, and the best combination as 1: 'the data tell 3.1e-04 of the
    combination A - 0.97 B'. `factor` is the weighted one; None: all rows count alike.
    """
    factor = qr_factor.weighted_factor() if factor is None else factor
    found = directions(factor, qr_factor.names)
    return [
        f"the data tell {found.shares[place]:.1e} of the combination {found.text(int(place))}"
        for place in np.flatnonzero(found.shares < share)[::-1]
    ]


def independent_rows(qr_factor: QRFactor, estimate: Estimate) -> float:
    """Return how many independent rows tell as much as the correlated ones of an estimate.

    From how much its variances exceed those for white noise, in the middle of all parameters.
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
    """Return whether a group of `terms` is worth having, from the information alone.

    `weights` (E,) of the equations are held, `factor` is the weighted factor if it is at hand.
    `independent` rows (default: all of them, right for white noise) see `independent_rows`. Raises
    IdentificationError for unknown terms and for no more independent rows than parameters.
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


BLOCKS = 8
"""Parts of the rows, one after the other in time, of which each is predicted from the others."""

_LOST = 1e-9


@dataclass(frozen=True, eq=False)
class Gain:
    """What a group of parameters is worth.

    `bic` is how much the extended Bayesian information criterion falls by them (Chen, Chen 2008:
    it counts how many terms were asked about; Schwarz 1978); `F` of the test that they are zero;
    `improvement` is how much smaller the squared error of blocks that were left out becomes, as a
    part of it, with `improvement_std` from the spread over the blocks; `better` of `blocks` became
    better.
    """

    bic: float
    F: float
    improvement: float
    improvement_std: float
    better: int
    blocks: int

    @property
    def is_worth_it(self) -> bool:
        """Both say so: the criterion, and the prediction by more than its standard error."""
        return self.bic > 0 and self.improvement > self.improvement_std


def gain(
    rows: Regression,
    weights: Array,
    base: Sequence[str],
    whole: Sequence[str],
    independent: float,
    asked: int,
) -> Gain:
    """Return what a model with the columns `whole` of rows is worth beside that with `base`.

    `whole` holds what `base` can say and more, if not in the same columns. `weights` (E,) of the
    equations are held; so many `independent` rows tell as much as the correlated ones; so many
    models were `asked` about. Raises IdentificationError for too few rows, and for a model that is
    not larger.
    """
    more = len(whole) - len(base)
    if more < 1 or independent <= len(whole):
        raise IdentificationError(
            f"a comparison needs a larger model and more independent rows than its {len(whole)} "
            f"parameters, found {more} more parameters and {independent:.1f} rows"
        )
    parts = [qr_factor_of(_part(rows, block)) for block in time_blocks(rows)]
    factors = [part.weighted_factor(_of(part, rows, weights)) for part in parts]
    columns = [[rows.names.index(name) for name in names] for names in (base, whole)]
    growth = _residual(factors, columns[0]) / max(_residual(factors, columns[1]), 1e-300)
    without, within = (_left_out(factors, chosen) for chosen in columns)
    change, total = without - within, max(float(np.sum(without)), 1e-300)
    penalty = more * math.log(independent) + 2 * math.log(max(asked, 1))
    return Gain(
        bic=independent * math.log(max(growth, 1e-300)) - penalty,
        F=(independent - len(whole)) / more * (growth - 1),
        improvement=float(np.sum(change)) / total,
        improvement_std=math.sqrt(len(change)) * float(np.std(change, ddof=1)) / total,
        better=int(np.sum(change > 0)),
        blocks=len(change),
    )


def common_rows(one: Regression, other: Regression) -> tuple[Regression, Regression]:
    """Return the rows of the same equations and instants in two regressions of the same logs."""
    keys = [list(zip(rows.joint, rows.run, rows.time, strict=True)) for rows in (one, other)]
    shared = set(keys[0]) & set(keys[1])
    masks = [np.array([key in shared for key in found], dtype=bool) for found in keys]
    return _part(one, masks[0]), _part(other, masks[1])


def time_blocks(rows: Regression, count: int = BLOCKS) -> list[BoolArray]:
    """Return `count` blocks of rows, equally long in time over all runs one after the other.

    Raises IdentificationError where one of them would have fewer rows than columns.
    """
    order = np.lexsort((rows.time, rows.run))
    place = np.empty(len(order), dtype=np.intp)
    place[order] = np.arange(len(order))
    block = place * count // max(len(order), 1)
    found = [np.asarray(block == one) for one in range(count)]
    if len(order) < count * 2 or len(order) * (count - 1) / count <= rows.H.shape[1]:
        raise IdentificationError(
            f"{len(order)} rows are too few to leave out one of {count} blocks and estimate "
            f"{rows.H.shape[1]} parameters from the others: record more"
        )
    return found


def _part(rows: Regression, block: BoolArray) -> Regression:
    arrays = {
        name: getattr(rows, name)[block]
        for name in ("H", "y", "joint", "time", "run", "propagated")
    }
    return replace(rows, **arrays)


def _of(part: QRFactor, rows: Regression, weights: Array) -> Array:
    """Return the weights of the equations that a part has."""
    equations = np.unique(rows.joint).tolist()
    return np.array([weights[equations.index(equation)] for equation in part.equations])


def _residual(factors: Sequence[Array], columns: Sequence[int]) -> float:
    """Return the squared residual of all rows with some columns."""
    R = np.concatenate(factors)
    theta = _solved(R[:, columns], R[:, -1])
    return float(np.sum((R[:, -1] - R[:, columns] @ theta) ** 2))


def _left_out(factors: Sequence[Array], columns: Sequence[int]) -> Array:
    """Return the squared error of each block, predicted from the others with some columns."""
    errors = np.empty(len(factors))
    for place, left in enumerate(factors):
        others = np.concatenate([R for other, R in enumerate(factors) if other != place])
        theta = _solved(others[:, columns], others[:, -1])
        errors[place] = np.sum((left[:, -1] - left[:, columns] @ theta) ** 2)
    return errors


def _solved(H: Array, y: Array) -> Array:
    norms = np.linalg.norm(H, axis=0)
    norms[norms == 0] = 1.0
    return np.asarray(
        safely(np.linalg.lstsq, H / norms, y, what="the equations", rcond=_LOST)[0] / norms
    )


@dataclass(frozen=True, eq=False)
class ModelChecks:
    """What speaks for and against the model of one regression.

    `condition_number` is that of columns of unit norm; `poorly_determined` names combinations of
    which the data tell little; `terms` tests each optional term of the drives; `whiteness` {joint:
    of its residual}, empty where the rows were not kept in memory.
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
    """Return the checks of an estimate, from its information; `optional` terms are tested.

    `weights` (E,) of the equations are those that `settled_weights` gives.
    """
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
