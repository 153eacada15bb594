"""Comparison of a model with larger ones: by information criterion, and by prediction of blocks.

All alternatives are compared at once. The columns that they share are projected out of the others
first (Frisch and Waugh 1933), once for each excluded block, so that every further alternative costs
a least-squares problem of a few columns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from seaid._arrays import Array, BoolArray
from seaid.errors import IdentificationError
from seaid.estimation.covariance import long_run_of
from seaid.estimation.qr_factor import ROUNDING, scaled_svd, triangle

if TYPE_CHECKING:
    from seaid.regressor import Regression

BLOCKS, SEGMENTS = 8, 4
"""Number of blocks, of which each is predicted from the others, and of its segments in time.

A block of one segment may lack what makes two models differ, such as the large deflections of a
spring; four spread over the log find a cubic spring twice as often, and no more that is not there
(scripts/benchmarks/term_selection.py)."""

CONFIDENCE = 0.975
"""Confidence with which excluded blocks must be predicted better."""

LEAST_EXPLAINED = 0.05
"""Part of the squared residual that additional parameters must explain to be supported.

Less is real at times and never useful: in right models of a simulated 7-joint arm the smoothing
of Coulomb friction by the low pass explains 2 to 4 % (scripts/benchmarks/term_selection.py)."""


@dataclass(frozen=True, eq=False)
class Alternative:
    """A larger model: the columns (R, c) in addition to, or in place of, those of the rows.

    `replaced` are the places of the columns that it lacks, `parameters` the number of parameters
    that it has in addition: nonlinear ones, whose values are in the columns, included.
    """

    columns: Array
    parameters: int
    replaced: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Comparison of a larger model with a smaller one.

    `bic` is the decrease of the extended Bayesian information criterion (Chen and Chen 2008), which
    counts the number of models compared; `F` tests that the additional parameters are zero;
    `explained` is the part of the squared residual that they explain. `improvement` is the relative
    decrease of the squared error in predicting excluded blocks, with `improvement_std` from the
    spread over the blocks; `better` of `blocks` improved. `t` is the mean decrease over its
    standard error, of the absolute or of the relative decreases of the blocks: the larger one.
    `independent` is the number of independent rows, `parameters` that of additional parameters.
    """

    bic: float
    F: float
    explained: float
    improvement: float
    improvement_std: float
    better: int
    blocks: int
    t: float
    independent: float
    parameters: int

    @property
    def is_supported(self) -> bool:
        """Whether the criterion and the prediction improve, and a part of the residual goes.

        The prediction improves if the squared error of all blocks is smaller, and that of a block
        significantly: by a t test (one-sided, `CONFIDENCE`) that one block cannot decide.
        """
        least = float(stdtrit(self.blocks - 1, CONFIDENCE))
        is_better = self.improvement > 0 and self.t > least
        return self.bic > 0 and self.explained > LEAST_EXPLAINED and is_better


def best_supported(comparisons: Sequence[ModelComparison]) -> int | None:
    """Return the place of the best of the supported models, None without any.

    Their criteria are compared with one number of independent rows, the smallest one.
    """
    supported = [place for place, one in enumerate(comparisons) if one.is_supported]
    rows = min((comparisons[place].independent for place in supported), default=1.0)

    def criterion(place: int) -> float:
        one = comparisons[place]
        return -rows * math.log(max(1 - one.explained, 1e-300)) - one.parameters * math.log(rows)

    return max(supported, key=criterion, default=None)


def compare_models(
    rows: Regression,
    weights: Array,
    alternatives: Sequence[Alternative],
    asked: int,
    only_promising: bool = False,
) -> list[ModelComparison]:
    """Compare the model of the rows with each of the larger `alternatives`.

    `weights` (E,) of the equations are kept; `asked` is the number of models compared. With
    `only_promising` independent rows are counted for alternatives that explain enough, and blocks
    are predicted by those that the criterion supports too; others count as unchanged. Raises
    IdentificationError for too few rows.
    """
    p = len(rows.names)
    replaced = sorted({place for one in alternatives for place in one.replaced})
    core = [place for place in range(p) if place not in replaced]
    # columns: the shared ones, those that some alternative replaces, those of alternatives, y
    parts = [rows.H[:, core], rows.H[:, replaced], *(one.columns for one in alternatives)]
    weight = weights[np.searchsorted(np.unique(rows.joint), rows.joint)]
    X = weight[:, None] * np.column_stack([*parts, rows.y])
    factors = [triangle(X[block]) for block in time_blocks(rows, segments=SEGMENTS)]
    whole = _without_core(np.concatenate(factors), len(core))[1]
    blocks = _Blocks(factors, len(core))
    base = list(range(len(replaced)))
    coefficients, _ = _without_core(np.concatenate(factors), p)
    left = X[:, p:] - X[:, :p] @ coefficients
    found, start = [], p
    for one in alternatives:
        own = list(range(start, start + one.columns.shape[1]))
        start += len(own)
        kept = [k for k, place in enumerate(replaced) if place not in one.replaced]
        larger = [*kept, *(k - len(core) for k in own)]
        growth = _squares(whole, base) / max(_squares(whole, larger), 1e-300)
        explained, count = 1 - 1 / max(growth, 1e-300), 1.0
        if not only_promising or explained > LEAST_EXPLAINED:
            count = _independent_rows(rows, left[:, [k - p for k in own]], left[:, -1])
        freedom = max(count - p - one.parameters, 1.0)
        penalty = one.parameters * math.log(count) + 2 * math.log(max(asked, 1))
        bic = freedom * math.log(max(growth, 1e-300)) - penalty  # Chen and Chen 2008
        without = within = np.zeros(len(factors))
        if not only_promising or (bic > 0 and explained > LEAST_EXPLAINED):
            without, within = blocks.errors(base), blocks.errors(larger)
        F = freedom / one.parameters * max(growth - 1, 0.0)
        numbers = bic, F, explained, *_changes(without, within), count, one.parameters
        found.append(ModelComparison(*numbers))
    return found


def _independent_rows(rows: Regression, columns: Array, residual: Array) -> float:
    """Return the number of independent rows for columns (R, c) without the base model's span.

    It is the number of rows over the variance inflation of their coefficients, by the
    autocorrelation of what the residual is once they are in the model.
    """
    svd = scaled_svd(columns)
    error = residual - columns @ svd.solve(residual)
    scores = long_run_of(svd.left[:, : max(svd.rank(), 1)], error, rows.time, rows.run)
    return len(residual) / max(scores.inflation(np.eye(len(scores.white))), 1.0)


def _changes(without: Array, within: Array) -> tuple[float, float, int, int, float]:
    """Return the `improvement`, its `improvement_std`, `better`, `blocks` and `t`."""
    change, total = without - within, max(float(np.sum(without)), 1e-300)
    relative = change / np.maximum(without + within, 1e-300)
    std = math.sqrt(len(change)) * float(np.std(change, ddof=1)) / total
    t = max(_t(change), _t(relative))
    return float(np.sum(change)) / total, std, int(np.sum(change > 0)), len(change), t


def _t(changes: Array) -> float:
    """Return the mean of the changes of the blocks over its standard error."""
    spread = float(np.std(changes, ddof=1))
    return math.sqrt(len(changes)) * float(np.mean(changes)) / max(spread, 1e-300)


def _without_core(X: Array, p: int) -> tuple[Array, Array]:
    """Return the coefficients (p, s) of the last s columns on the first p, and what is left."""
    R = triangle(X)
    svd = scaled_svd(R[:, :p])
    kept = slice(svd.rank(ROUNDING))
    seen = svd.left[:, kept].T @ R[:, p:]
    scaled = svd.vectors[kept].T @ (seen / svd.sizes[kept, None])
    return scaled / svd.norms[:, None], triangle(R[:, p:] - svd.left[:, kept] @ seen)


@dataclass(frozen=True, eq=False)
class _Blocks:
    """The factors of [columns y] of blocks, whose first `core` columns are shared by all models."""

    factors: Sequence[Array]
    core: int

    @cached_property
    def held_out(self) -> list[tuple[Array, Array]]:
        """The factor of the other blocks and the rows of each one, without the shared columns.

        The coefficients of the shared columns are those of the other blocks.
        """
        pairs = []
        for block, own in enumerate(self.factors):
            others = [R for place, R in enumerate(self.factors) if place != block]
            coefficients, rest = _without_core(np.concatenate(others), self.core)
            pairs.append((rest, own[:, self.core :] - own[:, : self.core] @ coefficients))
        return pairs

    def errors(self, columns: Sequence[int]) -> Array:
        """Return the squared error of each block, predicted from the others with some columns."""
        found = [_left(rest, own, columns) for rest, own in self.held_out]
        return np.array([float(np.sum(error**2)) for error in found])


def _squares(R: Array, columns: Sequence[int]) -> float:
    """Return the squared residual of the last column on some others."""
    return float(np.sum(_left(R, R, columns) ** 2))


def _left(R: Array, rows: Array, columns: Sequence[int]) -> Array:
    """Return what some columns of R leave of the last column of rows."""
    places = list(columns)
    theta = scaled_svd(R[:, places]).solve(R[:, -1])
    return np.asarray(rows[:, -1] - rows[:, places] @ theta)


def time_blocks(rows: Regression, count: int = BLOCKS, segments: int = 1) -> list[BoolArray]:
    """Return `count` masks of rows: blocks of segments of equal length in time, in turn."""
    order = np.lexsort((rows.time, rows.run))
    place = np.empty(len(order), dtype=np.intp)
    place[order] = np.arange(len(order))
    block = place * count * segments // max(len(order), 1) % count
    found = [np.asarray(block == one) for one in range(count)]
    if len(order) < count * 2 or len(order) * (count - 1) / count <= rows.H.shape[1]:
        raise IdentificationError(
            f"{len(order)} rows are too few to exclude one of {count} blocks and estimate "
            f"{rows.H.shape[1]} parameters from the others: record a longer log"
        )
    return found
