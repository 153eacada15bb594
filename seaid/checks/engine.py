"""What a check is, how checks are made, and forward selection of what an equation lacks.

A `Check` looks at a subject, such as the samples of a log (`channels`), an experiment (`setup`), or
an equation of a fit at a joint (`columns`). It proposes findings of what it sees, transforms that
undo a mistake, or columns that an equation may lack: the latter two are tested against each other.
Checks are declared where they are written, in tuples for each subject; `proposals` makes them. A
check that fails is no reason to lose the result: its error becomes a note.

What is wrong with a set-up or a model, a torque that is late or a term that a drive lacks, is a
`Candidate`: columns that it adds to the rows of a fit. Every candidate is tested at the same rows:
which part of the residual it explains, whether the decrease of an information criterion exceeds its
penalty for the number of tests, and whether excluded blocks are predicted better. The best one is
accepted, its columns are put into the model, and all others are tested again, until nothing
matters. What vanishes on the way was an echo of what was accepted.

All alternatives of a step are compared at once. The columns that they share are projected out of
the others first (Frisch and Waugh 1933), once for each excluded block, so that every further
alternative costs a least-squares problem of a few columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, Any, Generic, TypeVar, TypeVarTuple

import numpy as np
import scipy

from seaid._arrays import Array, BoolArray, FrozenMapping, safely
from seaid.checks import tolerances as tol
from seaid.drives import ParameterName
from seaid.errors import Finding, IdentificationError, reason_of
from seaid.estimation import qr_factor
from seaid.estimation.covariance import long_run_of
from seaid.log.filtering import ROWS_PER_PERIOD

if TYPE_CHECKING:
    from seaid.checks.codes import Code
    from seaid.estimation import FittedRows
    from seaid.regressor import Regression

Subject = TypeVarTuple("Subject")
Proposal = TypeVar("Proposal")


@dataclass(frozen=True)
class Need(Generic[*Subject]):
    """What a check needs of its subject: in words, as a noun, and whether a subject has it."""

    words: str
    is_met: Callable[[*Subject], bool]


@dataclass(frozen=True)
class Check(Generic[*Subject, Proposal]):
    """A check of a subject: what it proposes is of its `code`, if the subject meets all `needs`."""

    code: Code
    needs: tuple[Need[*Subject], ...]
    proposed: Callable[[*Subject], Iterable[Proposal]]

    def made(self, *subject: *Subject) -> Iterable[Proposal]:
        """Return what is proposed for a subject, nothing for one without what the check needs."""
        return self.proposed(*subject) if all(x.is_met(*subject) for x in self.needs) else ()

    def __call__(self: Check[*Subject, Finding], *subject: *Subject) -> list[Finding]:
        """Return what is `observed` by this check alone."""
        return observed((self,), *subject)


def proposals(
    checks: Iterable[Check[*Subject, Proposal]], notes: list[Finding], *subject: *Subject
) -> Iterator[Proposal]:
    """Yield what checks propose for a subject, and add the `notes` on those that raise."""
    for check in checks:
        with guarded(check.code, notes):
            yield from check.made(*subject)


def observed(checks: Iterable[Check[*Subject, Finding]], *subject: *Subject) -> list[Finding]:
    """Return the findings of checks, in their order, and notes on those that raise."""
    notes: list[Finding] = []
    return [*proposals(checks, notes, *subject), *notes]


def looks_for(
    code: Code,
) -> Callable[[Callable[[*Subject], Iterable[Finding]]], Check[*Subject, Finding]]:
    """Return the decorator by which a function is a check that needs nothing."""
    return lambda findings: Check(code, (), findings)


@contextmanager
def guarded(code: Code, findings: list[Finding]) -> Iterator[None]:
    """Add to findings, if a check of a code raises, the note that it could not be made."""
    try:
        yield
    except Exception as problem:  # the fit stands, whatever a check meets
        text = f"the check '{code.name}' could not be made: {reason_of(problem)}"
        findings.append(Finding(code.name, text, severity="note", certainty="certain"))


Fit = TypeVar("Fit")


@dataclass(frozen=True, eq=False)
class Alternative:
    """A larger model: the columns H (R, c) in addition to, or in place of, those of the rows.

    They act on the rows `own` (R,), if these are given. `replaced` are the places of the columns
    that it lacks. `parameters` is the number of additional parameters, linear and nonlinear;
    `values` are those of the nonlinear ones at which the columns were computed. `names` are the
    parameters of the columns, if they are those of a term.
    """

    H: Array
    parameters: int
    replaced: tuple[int, ...] = ()
    values: Mapping[str, float] = FrozenMapping({})
    names: tuple[str, ...] = ()
    own: BoolArray | None = None

    @property
    def columns(self) -> Array:
        """The columns (R, c), made anew of H if they are zero but at rows of their own."""
        return self.H if self.own is None else self.H * self.own[:, None]


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Comparison of a larger model with a smaller one.

    `bic` is the decrease of the extended Bayesian information criterion (Chen and Chen 2008), which
    counts the number of models compared; `F` tests that the additional parameters are zero;
    `explained` is the part of the squared residual that they explain. `improvement` is the relative
    decrease of the squared error in predicting excluded blocks, with `improvement_std` from the
    spread over the blocks; `better` of `blocks` improved. `t` is the mean decrease over its
    standard error, of the absolute or of the relative decreases of the blocks: the larger one.
    `independent` is the number of independent rows, `parameters` that of additional parameters, and
    `share` the part of the squared residual of the rows that it acts on, which is explained.
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
    share: float = 0.0

    @property
    def is_supported_overall(self) -> bool:
        """Whether the criterion and the prediction improve, and a part of the residual goes.

        The prediction improves if the squared error of all blocks is smaller, and that of a block
        significantly: by a t test (one-sided, `CONFIDENCE`) that one block cannot decide. The part
        is that of all rows of the fit.
        """
        return self.explained > tol.SLIGHT and self.is_better

    @property
    def is_better(self) -> bool:
        """Whether the criterion and the prediction improve, whatever the part of the residual."""
        # The quantile of Student's t: 2.36 standard errors of the mean of eight blocks.
        least = float(scipy.special.stdtrit(self.blocks - 1, tol.CONFIDENCE))
        return self.bic > 0 and self.improvement > 0 and self.t > least

    @property
    def is_clear_in_few(self) -> bool:
        """Whether what few blocks show is no chance, though they differ too much for the t test.

        The criterion falls by that of `SIGNIFICANT` standard errors, and the prediction improves by
        more than its own: that of a single block that improves is as large as the improvement.
        """
        # z standard errors lower the criterion by z^2, less its penalty
        return self.bic > tol.SIGNIFICANT**2 and self.improvement > self.improvement_std

    @property
    def evidence(self) -> dict[str, float]:
        """The numbers of the comparison as the evidence of a finding."""
        numbers = self.explained, self.F, self.bic, self.improvement, self.improvement_std
        names = "explained", "F", "BIC", "improvement", "standard error"
        return dict(zip(names, numbers, strict=True))

    def criterion(self, rows: float) -> float:
        """Return the information criterion for a number of independent rows, larger if better."""
        # BIC with its sign turned: -n log(RSS / RSS_0) - k log n (Schwarz 1978).
        of_misfit = math.log(max(1 - self.explained, tol.LEAST))
        return -rows * of_misfit - self.parameters * math.log(rows)


Model = TypeVar("Model")


def best_of(supported: Mapping[Model, ModelComparison]) -> Model | None:
    """Return the best of supported models, None without any.

    That is by the criterion with one number of independent rows, the smallest one of all.
    """
    # Criteria of different numbers of rows are not comparable: each grows with its number.
    rows = min((comparison.independent for comparison in supported.values()), default=1.0)
    return max(supported, key=lambda model: supported[model].criterion(rows), default=None)


def _shared_model(equation: Equation, alternatives: Sequence[Alternative]) -> _SharedModel:
    """Return what the comparisons of an equation with alternatives share."""
    rows, p = equation.rows, len(equation.rows.names)
    replaced = sorted({place for model in alternatives for place in model.replaced})
    core = [place for place in range(p) if place not in replaced]
    # columns: the shared ones, those that some alternative replaces, those of alternatives, y
    parts = [rows.H[:, core], rows.H[:, replaced], *(model.columns for model in alternatives)]
    X = equation.weighted(np.column_stack([*parts, rows.y]))
    # The factors R_b of the blocks have all sums of squares that follow: R_b^T R_b = X_b^T X_b.
    blocks = qr_factor.time_blocks(rows, segments=qr_factor.SEGMENTS)
    factors = [qr_factor.triangle(X[block]) for block in blocks]
    joint_factor = np.concatenate(factors)
    # What the core leaves of the other columns and of y has the residuals of the whole model.
    whole = qr_factor.projected_out(joint_factor, len(core))[1]
    # The first p columns of X, core and replaced, are all of the smaller model. The rest is row by
    # row, not a factor: the autocorrelation of the residual needs the order in
    # time.
    rest = X[:, p:] - X[:, :p] @ qr_factor.projected_out(joint_factor, p)[0]
    ends = np.cumsum([0, *(model.H.shape[1] for model in alternatives)]).tolist()
    places = dict(zip(alternatives, map(range, ends, ends[1:]), strict=True))
    return _SharedModel(equation, replaced, len(core), places, factors, whole, rest)


@dataclass(frozen=True, eq=False)
class _SharedModel:
    """The smaller model of comparisons, and what it leaves of the columns of alternatives.

    `replaced` are the places of columns that some alternative replaces, `core` is the number of all
    others, and `places` are those of the columns of alternatives among all of these. `factors` are
    those of the blocks; `whole` is that of the columns that are replaced, those of alternatives and
    y without the core, and `rest` (R, c) the rows of the latter two without all columns of the
    model.
    """

    equation: Equation
    replaced: Sequence[int]
    core: int
    places: Mapping[Alternative, range]
    factors: Sequence[Array]
    whole: Array
    rest: Array

    @cached_property
    def blocks(self) -> tuple[Array, Array]:
        """The factors of the other blocks, and the rows of each one."""
        return _held_out(self.factors, self.core)

    @cached_property
    def without(self) -> Array:
        """The squared error (B,) of the smaller model in predicting each block."""
        return _squares(*self.blocks, range(len(self.replaced)))

    @cached_property
    def before(self) -> float:
        """The squared residual of the smaller model."""
        return float(_squares(self.whole, self.whole, range(len(self.replaced))))

    def places_of(self, model: Alternative) -> list[int]:
        """Return the places of a larger model in `whole`, which begins with those replaced."""
        kept = [k for k, place in enumerate(self.replaced) if place not in model.replaced]
        return [*kept, *(len(self.replaced) + k for k in self.places[model])]

    def rss_ratio(self, model: Alternative) -> float:
        """Return RSS_0 / RSS, the squared residual of the smaller model over that of a larger one.

        It is below one if columns that replace others fit worse than these.
        """
        after = float(_squares(self.whole, self.whole, self.places_of(model)))
        return self.before / max(after, tol.LEAST)

    def trial(self, candidate: Candidate, asked: int, least_bic: float | None) -> Trial:
        """Return a candidate at the best point of its grid."""
        # All points of a grid have the same number of parameters: the best one explains most.
        ratios = {model: self.rss_ratio(model) for model in candidate.alternatives}
        best = max(ratios, key=ratios.__getitem__)
        return Trial(candidate, self.compared(best, ratios[best], asked, least_bic), best)

    def compared(
        self, model: Alternative, rss_ratio: float, asked: int, least_bic: float | None
    ) -> ModelComparison:
        """Compare the smaller model with a larger one.

        `rss_ratio` is that of `model`; `asked` and `least_bic` are those of `compared_candidates`.
        """
        equation, in_full = self.equation, least_bic is None
        explained, count = 1 - 1 / max(rss_ratio, tol.LEAST), 1.0
        acts = np.any(model.columns != 0, axis=1)
        part = equation.squares(acts) / max(equation.squares(), tol.LEAST)
        share = explained / max(part, tol.LEAST)
        # Not counted otherwise: a share this small is never supported, whatever its criterion.
        if in_full or share > tol.SLIGHT:
            columns = self.rest[:, [*self.places[model]]]
            count = _independent_rows(equation.rows, columns, self.rest[:, -1])
        freedom = max(count - len(equation.rows.names) - model.parameters, 1.0)
        bic = _bic(rss_ratio, freedom, count, model.parameters, asked)
        without = within = np.zeros(len(self.factors))
        if least_bic is None or (bic > least_bic and share > tol.SLIGHT):
            without, within = self.without, _squares(*self.blocks, self.places_of(model))
        # F = ((RSS_0 - RSS) / k) / (RSS / n')
        F = freedom / model.parameters * max(rss_ratio - 1, 0.0)
        numbers = bic, F, explained, *_changes(without, within), count, model.parameters, share
        return ModelComparison(*numbers)


def _bic(rss_ratio: float, freedom: float, count: float, parameters: int, asked: int) -> float:
    """Return the criterion of a number of independent rows."""
    # With n independent rows and n' = n - p - k: n' log(RSS_0 / RSS) - k log n - 2 log(asked).
    penalty = parameters * math.log(count) + 2 * math.log(max(asked, 1))
    return freedom * math.log(max(rss_ratio, tol.LEAST)) - penalty  # Chen and Chen 2008


def _independent_rows(rows: Regression, columns: Array, residual: Array) -> float:
    """Return the number of independent rows for columns (R, c) without the base model's span.

    It is the number of rows over the variance inflation of their coefficients, by the
    autocorrelation of what the residual is once they are in the model, and at most two for each
    period of the cutoff (rows are decimated to ROWS_PER_PERIOD of them): below a low pass there are
    no more, whatever few rows seem to show.
    """
    svd = qr_factor.scaled_svd(columns)
    error = residual - columns @ svd.solve(residual)
    # The left singular vectors are orthonormal columns with the same span: (H^T H)^-1 is 1.
    scores = long_run_of(svd.left[:, : max(svd.rank(), 1)], error, rows.time, rows.run)
    return len(residual) / max(scores.inflation(np.eye(len(scores.white))), ROWS_PER_PERIOD / 2)


def _changes(without: Array, within: Array) -> tuple[float, float, int, int, float]:
    """Return the `improvement`, its `improvement_std`, `better`, `blocks` and `t`."""
    change, total = without - within, max(float(np.sum(without)), tol.LEAST)
    # From -1 to 1 per block: a block with large errors has no more weight than any other.
    relative = change / np.maximum(without + within, tol.LEAST)
    # The sum of n changes has sqrt(n) times the standard deviation of one.
    std = math.sqrt(len(change)) * float(np.std(change, ddof=1)) / total
    both = np.array([change, relative])
    errors = np.maximum(np.std(both, axis=1, ddof=1), tol.LEAST) / math.sqrt(len(change))
    t = float(np.max(np.mean(both, axis=1) / errors))
    return float(np.sum(change)) / total, std, int(np.sum(change > 0)), len(change), t


def _held_out(factors: Sequence[Array], core: int) -> tuple[Array, Array]:
    """Return the factors (B, c, c) of the other blocks and the rows (B, m, c) of each one.

    `factors` are those of [columns y] of the blocks. The first `core` columns are projected out by
    the coefficients of the other blocks; c columns remain, y the last.
    """
    height, width = max(map(len, factors)), factors[0].shape[1] - core
    rests, blocks = np.zeros((len(factors), width, width)), np.zeros((len(factors), height, width))
    for place, block in enumerate(factors):
        # Factors add up by stacking: without block b there is no pass over the rows again.
        others = np.concatenate([*factors[:place], *factors[place + 1 :]])
        coefficients, rest = qr_factor.projected_out(others, core)
        # Few rows leave a factor with fewer of them than columns: the others are zero.
        rests[place, : len(rest)] = rest
        blocks[place, : len(block)] = block[:, core:] - block[:, :core] @ coefficients
    return rests, blocks


def _squares(R: Array, rows: Array, columns: Iterable[int]) -> Array:
    """Return the squares (...) of what some columns of R leave of the last column of rows.

    Both (..., m, c) may be stacked.
    """
    places = list(columns)
    theta = qr_factor.scaled_svd(R[..., places]).inverses @ R[..., -1:]
    return np.asarray(np.sum((rows[..., -1:] - rows[..., places] @ theta) ** 2, axis=(-2, -1)))


@dataclass(frozen=True, eq=False)
class Candidate:
    """What may be wrong with an equation, or lack in it, as columns of its rows.

    Attributes
    ----------
    joint : str
        The joint concerned.
    field, term : str
        What it is, such as the field and the term of a drive.
    alternatives : tuple of Alternative
        The columns at every point of the grid of nonlinear parameters, none if it has no columns.
    about : ColumnCheck
        The check that the candidate belongs to.
    """

    joint: str
    field: str
    term: str
    alternatives: tuple[Alternative, ...]
    about: Any = None

    @property
    def origin(self) -> tuple[Any, str]:
        """Its check and its joint."""
        return self.about, self.joint

    @property
    def name(self) -> tuple[str, str, str]:
        """Joint, field and term."""
        return self.joint, self.field, self.term


def linear_candidate(joint: str, field: str, term: str, H: Array) -> Candidate:
    """Return a candidate of columns (R, c) that depend on no nonlinear parameter."""
    return Candidate(joint, field, term, (Alternative(H, H.shape[1]),))


@dataclass(frozen=True)
class ColumnCheck(Check[Fit, str, Candidate], Generic[Fit]):
    """A check of the equation of a joint, which proposes columns that it may lack.

    `finding` words what was accepted of a joint, with the part of the squared residual that it
    explains; it may find that it is nothing.
    """

    finding: Callable[[Fit, str, Acceptance, float], Finding | None]

    def made(self, *subject: *tuple[Fit, str]) -> Iterable[Candidate]:
        """Return the candidates of a joint, which are about this check."""
        return [replace(x, about=self) for x in super().made(*subject)]


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate at the best point of its grid."""

    candidate: Candidate
    comparison: ModelComparison
    alternative: Alternative


def _is_supported(trial: Trial) -> bool:
    """Whether the criterion and the prediction improve and a part of the residual goes.

    The part is that of the rows on which it acts: a joint's own part is small among many joints.
    """
    comparison = trial.comparison
    # A spring deflects far in few blocks only, where it is hard or soft.
    is_clear = trial.candidate.field == "spring" and comparison.is_clear_in_few
    return comparison.share > tol.SLIGHT and (comparison.is_better or is_clear)


def best_trial(trials: Iterable[Trial]) -> Trial | None:
    """Return the best of the supported trials, None without any."""
    return best_of({trial: trial.comparison for trial in trials if _is_supported(trial)})


@dataclass(frozen=True, eq=False)
class Equation:
    """The rows of a fit, with the weights (E,) of its equations.

    `errors` are the parts of the weighted residual that follow errors of earlier values, those of
    springs: directions (R, k), which are orthonormal, and what `whitened` has of their sizes.
    """

    rows: Regression
    weights: Array
    errors: tuple[Array, tuple[tuple[Array, Array], ...]] = (np.empty((0, 0)), ())

    @cached_property
    def weight(self) -> Array:
        """The weight (R,) of each row."""
        # (E,) -> (R,): the weights are in the order of the equations that have rows.
        places = np.searchsorted(np.unique(self.rows.joint), self.rows.joint)
        return np.asarray(self.weights[places])

    def weighted(self, columns: Array) -> Array:
        """Return columns (R, c) times the root of the inverse covariance of the residual."""
        return qr_factor.whitened(self.weight[:, None] * columns, *self.errors)

    @cached_property
    def basis(self) -> Array:
        """An orthonormal basis (R, p) of the weighted columns."""
        columns = self.weighted(self.rows.H)
        norms = np.linalg.norm(columns, axis=0)
        columns = columns[:, norms > 0] / norms[norms > 0]
        return np.linalg.qr(columns)[0]

    @cached_property
    def residual(self) -> Array:
        """The weighted residual (R,)."""
        return self.residual_of(self.weighted(self.rows.y[:, None])[:, 0])

    def residual_of(self, columns: Array) -> Array:
        """Return what the columns of the rows do not explain of weighted ones (R,) or (R, c)."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    @cached_property
    def values(self) -> Array:
        """The parameters (p,) by least squares with the weights, zero of columns of zeros."""
        return np.asarray(qr_factor.scaled_svd(self.factor[:, :-1]).solve(self.factor[:, -1]))

    @cached_property
    def factor(self) -> Array:
        """The triangular factor of the weighted columns and torques [H y]."""
        return qr_factor.triangle(self.weighted(np.column_stack([self.rows.H, self.rows.y])))

    def last(self, count: int) -> tuple[Array, Array]:
        """Return the last parameters (count,), and their standard errors (count,).

        The errors allow for autocorrelation, as those of the estimate do.
        """
        X = self.weighted(self.rows.H)
        scores = long_run_of(X, self.residual, self.rows.time, self.rows.run).for_normal_intervals
        return self.values[len(scores) - count :], self._errors(scores)[len(scores) - count :]

    def last_of_blocks(self, count: int) -> tuple[Array, Array]:
        """Return `last` with the errors of blocks of time, where these differ by more.

        Where a model is wrong each part of the motion has another value, and the scores of a block
        are not those of noise (Liang and Zeger 1986).
        """
        blocks, scores = qr_factor.time_blocks(self.rows), self.weighted(self.rows.H)
        sums = np.array([self.residual[block] @ scores[block] for block in blocks])
        values, errors = self.last(count)
        of_blocks = self._errors(len(sums) / (len(sums) - 1) * sums.T @ sums)
        return values, np.maximum(errors, of_blocks[len(of_blocks) - count :])

    def _errors(self, scores: Array) -> Array:
        """Return the standard errors (p,) of the parameters for a covariance (p, p) of scores."""
        squares: Array = np.einsum("ij,jk,ik->i", self._bread, scores, self._bread)
        return np.sqrt(np.maximum(squares, 0.0))

    @cached_property
    def _bread(self) -> Array:
        """B (p, p) of the sandwich B S B^T: the inverse of the normal equations."""
        svd = qr_factor.scaled_svd(self.factor[:, :-1])
        kept = slice(svd.rank())
        # root root^T = (X^T X)^+ in the units of the parameters.
        root = (svd.vectors[kept].T / svd.sizes[kept]) / svd.norms[:, None]
        return np.asarray(root @ root.T)

    def squares(self, rows: BoolArray | slice = slice(None)) -> float:
        """Return the squared residual, of some rows only."""
        return float(np.sum(self.residual[rows] ** 2))

    def is_promising(self, candidate: Candidate) -> bool:
        """Whether columns explain enough of the residual of the rows that they act on.

        That is a part of it, and of the torque of some joint, unless a delay is most of it: in
        quadrature to a large torque it is small, and as large as the friction. Columns in place of
        others explain no more than they do next to all columns.
        """
        columns = [model.columns for model in candidate.alternatives]
        rows, whole = np.any(np.hstack(columns) != 0, axis=1), self.weighted(np.hstack(columns))
        of_joints = [rows & (self.rows.joint == x) for x in np.unique(self.rows.joint[rows])]
        # All rows of a joint have one weight: std(y) |w| is the norm of the weighted changes of its
        # torque, and NEGLIGIBLE is a ratio of rms values.
        torques = [np.std(self.rows.y[x]) * np.linalg.norm(self.weight[x]) for x in of_joints]
        residual, torque = self.squares(rows), min(torques, default=0.0)
        most = tol.MOST * residual if candidate.field == "delay" else math.inf
        needed = max(tol.SLIGHT * residual, min((tol.NEGLIGIBLE * torque) ** 2, most))
        acting = np.flatnonzero(np.any(whole != 0, axis=1))
        parts = np.repeat(np.arange(len(columns)), [x.shape[1] for x in columns])
        of_rows = whole[acting], self.basis[acting], self.residual[acting]
        return bool(np.max(qr_factor.explained_squares(*of_rows, parts), initial=0.0) > needed)

    def with_alternatives(self, alternatives: Iterable[Alternative]) -> Equation:
        """Return the equation with the columns of alternatives, zero where these replace others."""
        models, width = list(alternatives), len(self.rows.names)
        H = np.hstack([self.rows.H, *(model.columns for model in models)])
        for model in models:
            H[:, list(model.replaced)] = 0.0
        more = ParameterName.all_of(f"accepted column {x}" for x in range(width, H.shape[1]))
        units = (*self.rows.units, *len(more) * ("",))
        rows = replace(self.rows, names=(*self.rows.names, *more), units=units, H=H)
        return replace(self, rows=rows)


def equation_of(fitted: FittedRows) -> Equation:
    """Return the rows of a fit, which are in memory, with the weights of their equations.

    An equation of the fit may have lost all of its rows, those of a contact, and its weight goes.
    """
    assert fitted.rows is not None
    remaining = np.isin(fitted.qr_factor.equations, fitted.rows.joint)
    equation = Equation(fitted.rows, fitted.weights[remaining])
    if fitted.propagated is None:
        return equation
    # With T = Q R the errors T u of a covariance C of u have Q (R C R^T) Q^T.
    Q, R = np.linalg.qr(equation.weighted(fitted.rows.propagated))
    # The noise is what the fit leaves apart from these: springs that are free explain any torque,
    # as it is theirs. A row has a part of an independent one's information.
    noise = np.mean((equation.residual - Q @ (Q.T @ equation.residual)) ** 2) * ROWS_PER_PERIOD / 2
    of_noise = R @ fitted.propagated @ R.T / max(float(noise), tol.LEAST)
    squares, directions = safely(np.linalg.eigh, of_noise, what="the errors of springs")
    return replace(equation, errors=(Q, ((directions, np.sqrt(np.maximum(squares, 0.0))),)))


def compared_candidates(
    equation: Equation, candidates: Iterable[Candidate], asked: int, least_bic: float | None = None
) -> list[Trial]:
    """Return every candidate that has columns at the best point of its grid, in their order.

    `asked` is the number of all tests, which the criterion allows for. With a `least_bic` those are
    compared that may explain enough of the rows that they act on. Independent rows are then counted
    for those that do, and blocks are predicted by those whose criterion is above it; others count
    as unchanged. Raises IdentificationError for too few rows.
    """
    trials, tested = [], [candidate for candidate in candidates if candidate.alternatives]
    if least_bic is not None:
        tested = _without_logs(equation, tested, asked, least_bic)
        tested = [*filter(equation.is_promising, tested)]
    # Those of logs are as wide as the fit: each is compared alone.
    for _, of_width in groupby(tested, lambda x: x.alternatives[0].own is None or x):
        group = [*of_width]
        shared = _shared_model(equation, [x for c in group for x in c.alternatives])
        trials += [shared.trial(candidate, asked, least_bic) for candidate in group]
    return trials


def _without_logs(
    equation: Equation, candidates: Sequence[Candidate], asked: int, least_bic: float
) -> list[Candidate]:
    """Return candidates without logs whose criterion cannot exceed the least one.

    Of the others those remain that may explain most, as many as an equation may accept. Values of
    columns in addition to those of the fit are free in a log, too, so that it explains no more.
    """
    parts = {x: own for x in candidates if (own := x.alternatives[0].own) is not None}
    (Q, effects), rows, p = equation.errors, equation.rows, len(equation.rows.names)
    errors = [Q @ directions * sizes for directions, sizes in effects]
    X = np.column_stack([equation.weight[:, None] * rows.H, *errors, equation.weight * rows.y])
    # |(1 + B B^T)^-1/2 r|^2, of `whitened`, is the least |r - B u|^2 + |u|^2.
    shares = qr_factor.explained_apart(X, np.eye(X.shape[1])[p:-1], parts.values())
    # As many independent rows as there may be, for which the criterion is largest.
    most, bics = 2 * len(rows.y) / ROWS_PER_PERIOD, dict[Candidate, float]()
    for x, share in zip(parts, shares, strict=False):  # without logs nothing is computed
        k = x.alternatives[0].parameters
        bics[x] = _bic(1 / max(1 - share, tol.LEAST), most - p - k, most, k, asked)
    possible = sorted((x for x in bics if bics[x] > least_bic), key=bics.__getitem__)
    return [x for x in candidates if x not in parts or x in possible[-tol.MOST_READ :]]


@dataclass(frozen=True, eq=False)
class Accepted:
    """A candidate that was accepted.

    `coefficients` (c,) are those of its columns next to all that were accepted, `errors` (c,) their
    standard errors, which allow for autocorrelation as those of the estimate do. `share` is the
    part of the squared residual of the fit, of the rows that it acts on, by which it fell at last,
    and `change` (p,) that of the parameters of the fit, zero of those whose columns it replaces.
    `rivals` are candidates of other checks that would have explained as much, and that it explains.
    """

    trial: Trial
    coefficients: Array = field(default_factory=lambda: np.empty(0))
    errors: Array = field(default_factory=lambda: np.empty(0))
    share: float = 0.0
    change: Array | float = 0.0
    rivals: tuple[Trial, ...] = ()


Acceptance = Sequence[Accepted]
"""What was accepted of one check at a joint."""


@dataclass(frozen=True, eq=False)
class Selection:
    """What was accepted into an equation, in turn, and the equation with it.

    `first` are the candidates that were tested at the first step.
    """

    accepted: tuple[Accepted, ...]
    after: Equation
    first: tuple[Trial, ...]


def forward_selection(
    equation: Equation, candidates: Sequence[Candidate], asked: int, least_gain: float
) -> Selection:
    """Accept the best candidate, test all others next to it, and so on, until nothing matters.

    What was accepted is tested again, too: next to its cause an echo vanishes, whichever came
    first. `asked` is the number of all tests of all equations, which the criterion allows for (Chen
    and Chen 2008); `least_gain` is its least decrease.
    """
    least_bic = least_gain + 2 * math.log(max(asked, 1))
    first, kept, remaining = list[Trial](), list[Trial](), list(candidates)
    rivals = dict[Candidate, list[Trial]]()
    # With as few rows as parameters no block can be predicted, and nothing more is accepted. The
    # fit itself has the finding `few-rows` then.
    with suppress(IdentificationError):
        while len(kept) < tol.MOST_READ:
            # Asked for one test: the 2 log(asked) of the criterion is in `least_bic` already. The
            # trials of the first step are returned as `Selection.first`, and callers judge them
            # with a penalty for fewer tests. So all with a criterion above zero are compared in
            # full.
            least = least_bic if first else 0.0
            current = equation.with_alternatives(trial.alternative for trial in kept)
            compared = compared_candidates(current, remaining, 1, least_bic=least)
            first = first or compared
            strong = [trial for trial in compared if trial.comparison.bic > least_bic]
            best = best_trial(strong)
            if best is None:
                break
            rivals[best.candidate] = _rivals(best, strong, least_gain)
            # What is accepted or an echo is not tried again, so that the search ends.
            remaining = [candidate for candidate in remaining if candidate is not best.candidate]
            kept = [*_without_echoes(equation, kept, best, least_bic), best]
    after = equation.with_alternatives(trial.alternative for trial in kept)
    return Selection(tuple(_accepted(equation, kept, rivals, after)), after, tuple(first))


def _without_echoes(
    equation: Equation, kept: Sequence[Trial], best: Trial, least_bic: float
) -> Iterator[Trial]:
    """Yield the trials that are supported next to the others and to the best one."""
    for trial in kept:
        others = [other.alternative for other in (*kept, best) if other is not trial]
        without = equation.with_alternatives(others)
        again = compared_candidates(without, [trial.candidate], 1, least_bic=least_bic)
        if best_trial(x for x in again if x.comparison.bic > least_bic):
            yield trial


def _accepted(
    equation: Equation,
    kept: Sequence[Trial],
    rivals: Mapping[Candidate, Sequence[Trial]],
    after: Equation,
) -> Iterator[Accepted]:
    """Yield the trials that were kept, with their coefficients in the equation `after` all."""
    if not kept:
        return
    ends, p = np.cumsum([x.alternative.columns.shape[1] for x in kept]), len(equation.rows.names)
    parts = (np.split(numbers, ends[:-1]) for numbers in after.last_of_blocks(ends[-1]))
    names, before = {trial.candidate.name for trial in kept}, equation
    for trial, values, errors in zip(kept, *parts, strict=True):
        larger = before.with_alternatives([trial.alternative])
        rows = np.any(trial.alternative.columns != 0, axis=1)
        # Over the residual of the fit, not of this step: the shares at the same rows add up.
        whole = max(equation.squares(rows), tol.LEAST)
        share = (before.squares(rows) - larger.squares(rows)) / whole
        is_fitted = np.any(larger.rows.H[:, :p] != 0, axis=0)
        change = np.where(is_fitted, larger.values[:p] - before.values[:p], 0.0)
        others = tuple(x for x in rivals[trial.candidate] if x.candidate.name not in names)
        yield Accepted(trial, values, errors, share, change, others)
        before = larger


def _rivals(best: Trial, strong: Iterable[Trial], least_gain: float) -> list[Trial]:
    """Return the candidates of other causes at the joint of the best one that are as good.

    A criterion that is less than `least_gain` lower does not decide between two causes. Those of
    one check are one cause, as terms of friction are; but each law of a spring has a stiffness of
    its own.
    """
    least, (check, joint) = best.comparison.bic - least_gain, best.candidate.origin
    others = (x for x in strong if x.candidate.joint == joint and x is not best)
    causes = (x for x in others if x.candidate.about is not check or x.candidate.field == "spring")
    return [x for x in causes if _is_supported(x) and x.comparison.bic > least]
