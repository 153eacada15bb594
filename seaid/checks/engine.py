"""The engine: which columns belong into an equation, by forward selection.

What is wrong with a set-up or a model, a torque that is late or a term that a drive lacks, is a
`Candidate`: columns that it adds to the rows of a fit. Every candidate is tested at the same rows:
which part of the residual it explains, whether an information criterion for as many tests allows
for that, and whether excluded blocks are predicted better. The best one is accepted, its columns
are put into the model, and all others are tested again, until nothing matters. What vanishes on
the way was an echo of what was accepted.

All alternatives of a step are compared at once. The columns that they share are projected out of
the others first (Frisch and Waugh 1933), once for each excluded block, so that every further
alternative costs a least-squares problem of a few columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from scipy.special import stdtrit

from seaid._arrays import Array, BoolArray, FrozenMapping
from seaid.errors import IdentificationError
from seaid.estimation import ROUNDING, long_run_of, scaled_svd, triangle

if TYPE_CHECKING:
    from seaid.checks.check import Code
    from seaid.errors import Finding
    from seaid.regressor import Regression

Fit = TypeVar("Fit")

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
        return self.explained > LEAST_EXPLAINED and self.is_better

    @property
    def is_better(self) -> bool:
        """Whether the criterion and the prediction improve, whatever the part of the residual."""
        least = float(stdtrit(self.blocks - 1, CONFIDENCE))
        return self.bic > 0 and self.improvement > 0 and self.t > least


def best_supported(comparisons: Sequence[ModelComparison]) -> int | None:
    """Return the place of the best of the supported models, None without any."""
    places = [place for place, one in enumerate(comparisons) if one.is_supported]
    return places[_best([comparisons[place] for place in places])] if places else None


def _best(comparisons: Sequence[ModelComparison]) -> int:
    """Return the place of the best model: by the criterion with one number of independent rows.

    That is the smallest one, by which all are compared.
    """
    rows = min(one.independent for one in comparisons)

    def criterion(place: int) -> float:
        one = comparisons[place]
        return -rows * math.log(max(1 - one.explained, 1e-300)) - one.parameters * math.log(rows)

    return max(range(len(comparisons)), key=criterion)


def compare_models(
    rows: Regression,
    weights: Array,
    alternatives: Sequence[Alternative],
    asked: int,
    least: Sequence[float] = (),
) -> list[ModelComparison]:
    """Compare the model of the rows with each of the larger `alternatives`.

    `weights` (E,) of the equations are kept; `asked` is the number of models compared. With `least`
    parts of the squared residual, one per alternative, independent rows are counted for those that
    explain as much, and blocks are predicted by those that the criterion supports too; others count
    as unchanged. Raises IdentificationError for too few rows.
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
    needed = least or [0.0] * len(alternatives)
    for one, share in zip(alternatives, needed, strict=True):
        own = list(range(start, start + one.columns.shape[1]))
        start += len(own)
        kept = [k for k, place in enumerate(replaced) if place not in one.replaced]
        larger = [*kept, *(k - len(core) for k in own)]
        growth = _squares(whole, base) / max(_squares(whole, larger), 1e-300)
        explained, count = 1 - 1 / max(growth, 1e-300), 1.0
        if not least or explained > share:
            count = _independent_rows(rows, left[:, [k - p for k in own]], left[:, -1])
        freedom = max(count - p - one.parameters, 1.0)
        penalty = one.parameters * math.log(count) + 2 * math.log(max(asked, 1))
        bic = freedom * math.log(max(growth, 1e-300)) - penalty  # Chen and Chen 2008
        without = within = np.zeros(len(factors))
        if not least or (bic > 0 and explained > share):
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


@dataclass(frozen=True, eq=False)
class Point:
    """Columns of a candidate at `values` of the parameters in which its equation is nonlinear."""

    values: Mapping[str, float]
    alternative: Alternative


@dataclass(frozen=True, eq=False)
class Candidate:
    """What may be wrong with an equation, or lack in it, as columns of its rows.

    Attributes
    ----------
    joint : str
        The joint concerned.
    field, term : str
        What it is, such as the field and the term of a drive.
    points : callable
        The columns at every point of the grid of nonlinear parameters. `points(True)` has them from
        fewer samples, by which they are screened.
    about : ColumnCheck
        The check that the candidate belongs to.
    """

    joint: str
    field: str
    term: str
    points: Callable[[bool], Iterable[Point]]
    about: Any = None

    @property
    def name(self) -> tuple[str, str, str]:
        """Joint, field and term."""
        return self.joint, self.field, self.term


@dataclass(frozen=True)
class ColumnCheck(Generic[Fit]):
    """A check of an equation: `candidates` are its columns for a joint.

    `finding` words what was accepted of a joint, with the part of the squared residual that it
    explains; it may find that it is nothing. `cause` names a candidate as the rival of another, by
    its field and term, and `decision` is the measurement that separates it from its rivals.
    `contains` are the codes of simpler mistakes, whose columns are among those of the candidates.
    """

    code: Code
    candidates: Callable[[Fit, str], Iterable[Candidate]]
    finding: Callable[[Fit, str, Sequence[Accepted], float], Finding | None]
    cause: str
    decision: str
    contains: tuple[Code, ...] = ()


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate at the best point of its grid; `comparison` is None where it has no columns.

    `share` is the part of the squared residual that it explains of the rows that it acts on;
    `reason` says why a comparison could not be made.
    """

    candidate: Candidate
    comparison: ModelComparison | None
    values: Mapping[str, float] = FrozenMapping({})
    alternative: Alternative | None = None
    share: float = 0.0
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Equation:
    """The rows of a fit, with the weights (E,) of its equations."""

    rows: Regression
    weights: Array

    @cached_property
    def weight(self) -> Array:
        """The weight (R,) of each row."""
        places = np.searchsorted(np.unique(self.rows.joint), self.rows.joint)
        return np.asarray(self.weights[places])

    @cached_property
    def basis(self) -> Array:
        """An orthonormal basis (R, p) of the weighted columns."""
        columns = self.weight[:, None] * self.rows.H
        norms = np.linalg.norm(columns, axis=0)
        return np.linalg.qr(columns[:, norms > 0] / norms[norms > 0])[0]

    @cached_property
    def residual(self) -> Array:
        """The weighted residual (R,)."""
        return self.left(self.weight * self.rows.y)

    def left(self, columns: Array) -> Array:
        """Return what the columns of the rows leave of weighted ones (R,) or (R, c)."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    @cached_property
    def values(self) -> Array:
        """The parameters (p,) by least squares with the weights, zero of columns of zeros."""
        return np.asarray(scaled_svd(self.factor[:, :-1]).solve(self.factor[:, -1]))

    @cached_property
    def factor(self) -> Array:
        """The triangular factor of the weighted columns and torques [H y]."""
        return triangle(self.weight[:, None] * np.column_stack([self.rows.H, self.rows.y]))

    def last(self, count: int) -> tuple[Array, Array]:
        """Return the last parameters (count,), and their standard errors (count,).

        The errors allow for autocorrelation, as those of the estimate do.
        """
        rows, X = self.rows, self.weight[:, None] * self.rows.H
        svd = scaled_svd(self.factor[:, :-1])
        kept = slice(svd.rank())
        root = (svd.vectors[kept].T / svd.sizes[kept]) / svd.norms[:, None]
        scores = long_run_of(X, self.residual, rows.time, rows.run).for_normal_intervals
        own = (root @ root.T)[len(root) - count :]
        errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", own, scores, own), 0.0))
        return self.values[len(root) - count :], errors

    def squares(self, rows: BoolArray) -> float:
        """Return the squared residual of some rows."""
        return float(np.sum(self.residual[rows] ** 2))

    def part_of(self, rows: BoolArray) -> float:
        """Return the part of the squared residual that some rows have."""
        return self.squares(rows) / max(float(self.residual @ self.residual), 1e-300)

    def least(self, rows: BoolArray) -> float:
        """Return the squares that a candidate at some rows has to explain to be tested at all.

        That is a part of their residual, and of the torque of some joint.
        """
        own = [rows & (self.rows.joint == joint) for joint in np.unique(self.rows.joint[rows])]
        torques = [float(np.std(self.rows.y[x]) * np.linalg.norm(self.weight[x])) for x in own]
        return max(PROMISING * self.squares(rows), (LEAST_TORQUE * min(torques, default=0.0)) ** 2)

    def with_alternative(self, alternative: Alternative) -> Equation:
        """Return the equation with the columns of an alternative, zero where it replaces others."""
        H = self.rows.H.copy()
        H[:, list(alternative.replaced)] = 0.0
        count = alternative.columns.shape[1]
        more = tuple(f"accepted column {len(self.rows.names) + k}" for k in range(count))
        rows = replace(
            self.rows,
            names=(*self.rows.names, *more),
            units=(*self.rows.units, *count * ("",)),
            H=np.hstack([H, alternative.columns]),
        )
        return Equation(rows, self.weights)


LEAST_TORQUE = 0.004
"""Least rms of what a candidate adds, over that of the changes of the joint's torque, to be tested.

Less does not matter, and is what the low pass leaves at reversals: at most 0.22 % in nine logs
without noise of the simulated leg and arm of the tests. An error of 1 mrad between the encoders is
0.6 to 1.3 % of the torques of that leg."""

PROMISING = 0.5 * LEAST_EXPLAINED
"""Part of the squared residual that a candidate explains at coarse samples, to be tested at all:
half of what supports it, since narrow widths are coarsely sampled."""

_LOST = 1e-6
"""Part of a column below which nothing is left of it next to the others but interpolation."""


def promising(equation: Equation, candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates that may explain enough of the residual, by fewer samples.

    Columns in place of others explain no more than their changes of these do next to all columns.
    """
    found = []
    for candidate in candidates:
        points = list(candidate.points(True))
        if not points:
            continue
        weighted = [equation.weight[:, None] * point.alternative.columns for point in points]
        columns = np.hstack(weighted)
        needed = equation.least(np.any(columns != 0, axis=1))
        left = equation.left(columns)
        left[:, np.linalg.norm(left, axis=0) <= _LOST * np.linalg.norm(columns, axis=0)] = 0.0
        parts = np.split(left, np.cumsum([one.shape[1] for one in weighted])[:-1], axis=1)
        if any(explained_squares(part, equation.residual) > needed for part in parts):
            found.append(candidate)
    return found


def explained_squares(columns: Array, y: Array) -> float:
    """Return the sum of squares of y (R,) that columns (R, c) explain."""
    norms = np.linalg.norm(columns, axis=0)
    if len(norms) == 1:
        return float(columns[:, 0] @ y / max(norms[0], 1e-300)) ** 2
    span = np.linalg.qr(columns / np.maximum(norms, 1e-300))[0]
    return float(np.sum((span.T @ y) ** 2))


_NO_COLUMN = "it has no column: the log lacks its equation, or the fit the stiffness of the spring"


def compared_candidates(
    equation: Equation, candidates: Sequence[Candidate], asked: int, *, only_promising: bool = False
) -> list[Trial]:
    """Return every candidate at the best point of its grid, in their order.

    `asked` is the number of all tests, which the criterion allows for. With `only_promising` those
    are compared in full that explain enough of the rows that they act on.
    """
    points = [(place, point) for place, one in enumerate(candidates) for point in one.points(False)]
    best = [Trial(candidate, None, reason=_NO_COLUMN) for candidate in candidates]
    if not points:
        return best
    alternatives = [point.alternative for _, point in points]
    parts = [equation.part_of(np.any(one.columns != 0, axis=1)) for one in alternatives]
    least = [LEAST_EXPLAINED * part for part in parts] if only_promising else ()
    try:
        compared = compare_models(equation.rows, equation.weights, alternatives, asked, least)
    except IdentificationError as problem:  # too few rows
        return [replace(one, reason=str(problem)) for one in best]
    for (place, point), comparison, part in zip(points, compared, parts, strict=True):
        before = best[place].comparison
        if before is None or comparison.explained > before.explained:
            values, share = FrozenMapping(point.values), comparison.explained / max(part, 1e-300)
            best[place] = Trial(candidates[place], comparison, values, point.alternative, share)
    return best


def best_of(candidates: Sequence[Trial]) -> Trial | None:
    """Return the best of the supported candidates, None without any.

    A candidate is supported if criterion and prediction improve, and a part of the residual of its
    rows goes.
    """
    supported = [
        one
        for one in candidates
        if one.share > LEAST_EXPLAINED and one.comparison is not None and one.comparison.is_better
    ]
    compared = [one.comparison for one in supported if one.comparison is not None]
    return supported[_best(compared)] if supported else None


@dataclass(frozen=True, eq=False)
class Accepted:
    """A candidate that was accepted.

    `coefficients` (c,) are those of its columns next to all that were accepted, `errors` (c,) their
    standard errors, which allow for autocorrelation as those of the estimate do. `share` is the
    part of the squared residual of the fit, of the rows that it acts on, by which it fell at last.
    `rivals` are candidates of other checks that would have explained as much, and that it explains.
    """

    trial: Trial
    coefficients: Array
    errors: Array
    share: float = 0.0
    rivals: tuple[Trial, ...] = ()


@dataclass(frozen=True, eq=False)
class Selection:
    """What was accepted into an equation, in turn, and the equation before and with it.

    `first` are the candidates that were tested at the first step.
    """

    accepted: tuple[Accepted, ...]
    before: Equation
    after: Equation
    first: tuple[Trial, ...]


MOST_ACCEPTED = 7
"""Candidates that one equation may accept: more findings above a note would not be read."""


def forward_selection(
    equation: Equation, candidates: Sequence[Candidate], asked: int, least_gain: float
) -> Selection:
    """Accept the best candidate, test all others next to it, and so on, until nothing matters.

    `asked` is the number of all tests of all equations, which the criterion allows for (Chen and
    Chen 2008); `least_gain` is its least decrease.
    """
    least_bic = least_gain + 2 * math.log(max(asked, 1))
    first: tuple[Trial, ...] | None = None
    accepted: list[Trial] = []
    shares: list[float] = []
    rivals: list[list[Trial]] = []
    current, remaining = equation, list(candidates)
    while len(accepted) < MOST_ACCEPTED:
        compared = compared_candidates(
            current, promising(current, remaining), 1, only_promising=True
        )
        first = tuple(compared) if first is None else first
        strong = [
            one
            for one in compared
            if one.comparison is not None and one.comparison.bic >= least_bic
        ]
        best = best_of(strong)
        if best is None or best.alternative is None:
            break
        own = np.any(best.alternative.columns != 0, axis=1)
        larger = current.with_alternative(best.alternative)
        whole, before, after = (one.squares(own) for one in (equation, current, larger))
        shares.append((before - after) / max(whole, 1e-300))
        accepted.append(best)
        rivals.append(_rivals(best, strong, least_gain))
        current = larger
        remaining = [one for one in remaining if one is not best.candidate]
    if not accepted:
        return Selection((), equation, equation, first or ())
    counts = [one.alternative.columns.shape[1] for one in accepted if one.alternative is not None]
    parts = (np.split(x, np.cumsum(counts)[:-1]) for x in current.last(sum(counts)))
    names = {one.candidate.name for one in accepted}
    alike = [tuple(x for x in several if x.candidate.name not in names) for several in rivals]
    found = tuple(map(Accepted, accepted, *parts, shares, alike))
    return Selection(found, equation, current, first or ())


def _rivals(best: Trial, supported: Iterable[Trial], least_gain: float) -> list[Trial]:
    """Return the candidates of other checks at the joint of the best one that are as good.

    A criterion that is less than `least_gain` lower does not decide between two causes.
    """
    assert best.comparison is not None
    least_bic = best.comparison.bic - least_gain
    return [
        one
        for one in supported
        if one.candidate.joint == best.candidate.joint
        and one.candidate.about is not best.candidate.about
        and one.comparison is not None
        and one.comparison.is_better
        and one.comparison.bic > least_bic
    ]


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
