"""Estimators by name, and the fit of rows by one of them, in memory or stored in a file.

M-estimates (Huber 1964; Beaton and Tukey 1974) give outliers such as spikes and saturated rows a
smaller weight, by iteratively reweighted least squares. The scale of each equation is the median
absolute residual, which tolerates outliers in up to half of the rows.

Of logs that do not fit into memory the rows, a small part of the log, are stored in temporary
files until the parameters are known, because the covariance needs the residuals.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import groupby
from typing import IO, TYPE_CHECKING, Literal, Union

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping
from seaid.errors import ExcitationError, IdentificationError, LogError, reason_of
from seaid.estimation.covariance import at_slots, long_run, long_run_of, slots
from seaid.estimation.drift import block_factors
from seaid.estimation.estimate import (
    Estimate,
    ModelChecks,
    SharedParameter,
    model_checks,
    whiteness,
)
from seaid.estimation.least_squares import (
    MOST_INSTANTS,
    equal_weights,
    estimate_of,
    estimate_of_rows,
    factored,
    ordinary,
    residual_fit,
    score_factors,
    settled_weights,
    solve,
    weighted,
    with_blocks,
    with_propagated,
)
from seaid.estimation.qr_factor import QRFactor, combined, qr_factor_of

if TYPE_CHECKING:
    from seaid.regressor import Regression


HUBER = 1.345
"""Scaled residual above which Huber's weight falls: 95 % efficient for Gaussian noise."""

TUKEY = 4.685
"""Scaled residual above which Tukey's weight is zero: 95 % efficient for Gaussian noise."""

_GAUSSIAN = 1.4826
"""Standard deviation of Gaussian noise over the median of its absolute values."""

_MOST_ITERATIONS = 500
"""Reweightings after which a robust fit is refused, since its weights do not converge."""

_SETTLED = 1e-6
"""Change of the fit, over the scale of the residual of its equation, at which the weights have
converged."""

_EXACT = 1e-10
"""The same over the torque (rms): without noise the scale is rounding, which never settles."""

Weighing = Callable[[Array], Array]


def huber(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return Huber's M-estimate, with the weight of a row clipped above 1.345 scales.

    Scale and estimate are iterated together from ordinary least squares. The covariance is the
    sandwich with autocorrelated scores (Newey-West); `residual_std` is the scale, without the
    outliers. `propagated` and the errors as in `ordinary`; also raises IdentificationError if the
    iteration does not converge.
    """
    theta, scales = _huber(rows)
    return _estimate(rows, theta, scales, huber_weights, propagated)


def tukey(rows: Regression, propagated: Array | None = None) -> Estimate:
    """Return Tukey's bisquare M-estimate (zero weight above 4.685 scales), from Huber's."""
    start, scales = _huber(rows)
    # The scale stays Huber's (MM-estimate, Yohai 1987): Tukey's psi falls to zero again, so that
    # estimate and scale together would have several solutions.
    theta, _ = _iterated(rows, start, lambda _: scales, tukey_weights)
    return _estimate(rows, theta, scales, tukey_weights, propagated)


def without_outliers(rows: Regression, estimate: Estimate) -> Regression:
    """Return the rows times the square root of their Tukey weight, for checks of the estimate."""
    residual = rows.y - rows.H @ estimate.values
    return _scaled(rows, np.sqrt(tukey_weights(residual / _scales(rows, residual))))


def huber_weights(u: Array) -> Array:
    """Return the weights psi(u)/u of Huber's psi for scaled residuals u (R,)."""
    return np.asarray(HUBER / np.maximum(np.abs(u), HUBER))


def tukey_weights(u: Array) -> Array:
    """Return the weights psi(u)/u of Tukey's bisquare for scaled residuals u (R,)."""
    return np.asarray(np.maximum(1 - (u / TUKEY) ** 2, 0.0) ** 2)


def _huber(rows: Regression) -> tuple[Array, Array]:
    """Return Huber's parameters (p,) and the scale of each row (R,)."""
    qr_factor = qr_factor_of(rows)
    start = solve(qr_factor, equal_weights(qr_factor)).values
    return _iterated(rows, start, lambda residual: _scales(rows, residual), huber_weights)


def _iterated(
    rows: Regression, theta: Array, scales_of: Callable[[Array], Array], weigh: Weighing
) -> tuple[Array, Array]:
    """Return the parameters (p,) and scales (R,) at which the reweighting converges."""
    size = float(np.sqrt(np.mean(rows.y**2)))
    for _ in range(_MOST_ITERATIONS):
        residual = rows.y - rows.H @ theta
        scales = scales_of(residual)
        qr_factor = qr_factor_of(_scaled(rows, np.sqrt(weigh(residual / scales)) / scales))
        new = solve(qr_factor, equal_weights(qr_factor)).values
        # The fitted torques converge; parameters differ in unit and may be badly conditioned.
        moved = np.abs(rows.H @ (new - theta))
        theta = new
        # Without noise the scale is rounding, and the torque's size decides.
        if np.all(moved <= np.maximum(_SETTLED * scales, _EXACT * size)):
            return theta, scales
    worst = int(np.argmax(moved / scales))
    raise IdentificationError(
        f"the weights of the rows did not converge in {_MOST_ITERATIONS} iterations: at "
        f"{rows.time[worst]:.3g} s the fit still changes by {moved[worst] / scales[worst]:.1e} of "
        "the residual's scale; record a longer log, or use estimator='wls'",
        "estimator='wls'",
    )


def _estimate(
    rows: Regression, theta: Array, scales: Array, weigh: Weighing, propagated: Array | None
) -> Estimate:
    """Return the estimate with its sandwich covariance at converged parameters.

    Linearised there, an M-estimate is least squares with weights w(u) s / scale^2, where s is the
    mean of psi'(u) over that of w(u), and residuals enlarged by 1 / s so that the scores are psi(u)
    (Huber 1973).
    """
    residual = rows.y - rows.H @ theta
    u = residual / scales
    weights, step = weigh(u), 1e-6
    # A central difference of psi(u) = u w(u).
    derivative = (weigh(u + step) * (u + step) - weigh(u - step) * (u - step)) / (2 * step)  # psi'
    slope = np.empty_like(u)
    for equation in _equations(rows):  # positive: half of the rows are within 0.67 scales
        slope[equation] = np.sum(derivative[equation]) / np.sum(weights[equation])
    root = np.sqrt(weights * slope) / scales
    linear = _scaled(replace(rows, y=rows.H @ theta + residual / slope), root)
    scores = long_run_of(linear.H, linear.y - linear.H @ theta, rows.time, rows.run)
    parts = factored(linear, propagated)
    ones = equal_weights(parts.whole)
    estimate = estimate_of_rows(parts, ones)
    # The same fit with the scores taken as independent, for the standard errors of white noise.
    independent = replace(scores, covariance=scores.white, lags=0)
    white = estimate_of(parts.whole, ones, independent, propagated)
    return replace(
        estimate,
        residual_std=float(np.sqrt(np.mean(scales**2))),
        white_standard_errors=white.standard_errors,
    )


def _scaled(rows: Regression, factor: Array) -> Regression:
    """Return the rows, each times its `factor` (R,)."""
    column = factor[:, None]
    return replace(rows, H=column * rows.H, y=factor * rows.y, propagated=column * rows.propagated)


def _scales(rows: Regression, residual: Array) -> Array:
    """Return the scale (R,) of each row's equation: a standard deviation for Gaussian noise."""
    scales = np.empty_like(residual)
    # Scales are divided by: they are at least rounding, and 1 if all torques are zero.
    smallest = 1e-9 * float(np.sqrt(np.mean(rows.y**2))) or 1.0
    for equation in _equations(rows):
        scales[equation] = max(_GAUSSIAN * float(np.median(np.abs(residual[equation]))), smallest)
    return scales


def _equations(rows: Regression) -> Iterator[BoolArray]:
    """Yield the mask (R,) of the rows of each equation."""
    for index in np.unique(rows.joint).astype(int):
        yield rows.joint == index


@dataclass(frozen=True)
class Estimator:
    """An estimator by its functions.

    `solve` estimates from rows and the propagated covariance; `weigh` gives the weights of the
    equations if a QR factor is sufficient; `effective_rows` returns the rows as the estimate
    weights them, for its checks; `columns` those (R, p) to which its residual is orthogonal, if
    they are not those of the rows.
    """

    solve: Callable[[Regression, Array | None], Estimate]
    weigh: Callable[[QRFactor], Array] | None = None
    effective_rows: Callable[[Regression, Estimate], Regression] = lambda rows, _: rows
    columns: Callable[[Regression], Array] | None = None


LinearEstimator = Literal["ols", "wls", "huber", "tukey"]
"""Estimators of linear equations, which `ESTIMATORS` has."""

EstimatorName = Literal[LinearEstimator, "iv"]
"""Values of `estimator=`; "iv" is `instrumental`, which starts from the estimate of "wls"."""

ESTIMATORS: FrozenMapping[Estimator] = FrozenMapping(
    {
        "ols": Estimator(ordinary, equal_weights),
        "wls": Estimator(weighted, settled_weights),
        "huber": Estimator(huber, effective_rows=without_outliers),
        "tukey": Estimator(tukey, effective_rows=without_outliers),
    }
)


def estimator_named(name: LinearEstimator) -> Estimator:
    """Return an estimator by name."""
    return ESTIMATORS[name]


RowChange = Callable[["Regression"], "Regression"]
"""A function from rows to the rows of the same equations in other columns."""


def unchanged(rows: Regression) -> Regression:
    """Return the rows as they are."""
    return rows


@dataclass(eq=False)
class StoredRows:
    """Rows of one equation of several long logs, stored in a file piece by piece.

    `parts` are the regressions without their rows, each with the number of its log; `spans` {log:
    first and last instant [s]} of its rows; `steps_s` (logs,) the times between them.
    """

    file: IO[bytes]
    steps_s: tuple[float, ...]
    parts: list[tuple[int, Regression]] = field(default_factory=list)
    spans: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, log: int, rows: Regression) -> None:
        """Append the next piece of a log to the file."""
        for name in rows.arrays:
            np.save(self.file, getattr(rows, name), allow_pickle=False)
        self.parts.append((log, rows.at(slice(0))))
        if len(rows.y):
            start, end = self.spans.get(log, (math.inf, -math.inf))
            times = float(np.min(rows.time)), float(np.max(rows.time))
            self.spans[log] = min(start, times[0]), max(end, times[1])

    @property
    def instants(self) -> int:
        """Number of instants of all logs, also of those between their rows."""
        spans = self.spans.items()
        return sum(round((end - start) / self.steps_s[log]) + 1 for log, (start, end) in spans)

    def pieces(self, change: RowChange | None) -> Iterator[tuple[int, Regression]]:
        """Yield the number of the log and the rows of every piece after `change`, if any."""
        # The file has one position: a pass over the pieces ends before the next one begins.
        self.file.seek(0)
        for log, part in self.parts:
            arrays = {name: np.load(self.file, allow_pickle=False) for name in part.arrays}
            rows = replace(part, **arrays)
            yield log, rows if change is None else change(rows)

    def logs(self, change: RowChange | None) -> Iterator[tuple[int, Iterator[Regression]]]:
        """Yield the number of every log that has rows, and the pieces with its rows."""
        pieces = ((log, rows) for log, rows in self.pieces(change) if len(rows.y))
        for log, group in groupby(pieces, key=lambda piece: piece[0]):
            yield log, (rows for _, rows in group)


@contextmanager
def stored_rows(
    names: Iterable[str], steps_s: tuple[float, ...], rows: Iterable[tuple[int, str, Regression]]
) -> Iterator[dict[str, StoredRows]]:
    """Yield the stored rows of equations, from (log, equation, rows of the next piece)."""
    with ExitStack() as files:
        with _room_needed():
            stored = {
                name: StoredRows(files.enter_context(tempfile.TemporaryFile()), steps_s)
                for name in names
            }
        for log, name, piece in rows:
            with _room_needed():
                stored[name].add(log, piece)
        yield stored


@contextmanager
def _room_needed() -> Iterator[None]:
    """Convert an OSError of the temporary file to a LogError."""
    try:
        yield
    except OSError as problem:
        raise LogError(
            f"the rows of a long log cannot be kept in a temporary file ({reason_of(problem)}): "
            "make room in the folder for them, or set TMPDIR to another one"
        ) from None


def stored_estimate(
    stored: StoredRows,
    weigh: Callable[[QRFactor], Array],
    propagated: Array | None = None,
    change: RowChange | None = None,
    cutoff_hz: float | None = None,
) -> tuple[Estimate, QRFactor, Array]:
    """Return the estimate from stored rows, their QR factor and the weights, as in memory.

    `weigh` gives the weights of the equations (`settled_weights` or `equal_weights`); `propagated`
    as in `ordinary`; `change` transforms the stored rows, at the same instants; `cutoff_hz` as in
    `estimate_of_rows`. Raises as `ordinary` does.
    """
    if stored.instants <= MOST_INSTANTS:  # all rows fit into memory
        parts = factored(_whole(stored, change), propagated)
        weights = weigh(parts.whole)
        return estimate_of_rows(parts, weights, cutoff_hz), parts.whole, weights
    # With the propagated columns in H the factors give the noise, too: the residual without the
    # errors that they propagate. A second pass sums its scores by instant.
    numbered = (
        replace(with_propagated(rows, propagated), run=np.full(len(rows.y), log))
        for log, rows in stored.pieces(change)
    )
    blocks = block_factors(numbered, stored.spans)
    joined = combined(factor for _, factor in blocks)
    further = map(str, range(0 if propagated is None else len(propagated)))
    qr_factor = replace(joined.without(further), excluded=sum(x.excluded for _, x in stored.parts))
    weights = weigh(qr_factor)
    solution = solve(qr_factor, weights)
    noise = residual_fit(joined, weights, solution)

    def factors(rows: Regression) -> Array:
        return score_factors(with_propagated(rows, propagated), qr_factor, weights, noise)

    scores = (
        _scores(pieces, stored.spans[log][0], stored.steps_s[log], factors)
        for log, pieces in stored.logs(change)
    )
    initial = estimate_of(qr_factor, weights, long_run(scores, stored.instants), None, solution)
    estimate = with_blocks(qr_factor, weights, (solution, noise), initial, blocks, propagated)
    return estimate, qr_factor, weights


def _whole(stored: StoredRows, change: RowChange | None) -> Regression:
    """Return the stored rows of all logs in memory."""
    from seaid.regressor.regression import stacked

    parts = [replace(rows, run=np.full(len(rows.y), log)) for log, rows in stored.pieces(change)]
    return replace(stacked(parts), run=np.concatenate([part.run for part in parts]))


def _scores(
    pieces: Iterable[Regression],
    start_s: float,
    step_s: float,
    factors: Callable[[Regression], Array],
) -> Iterator[Array]:
    """Yield the scores (T, p) of the pieces of a log, by instant."""
    done = 0
    for rows in pieces:
        # Slot 0 follows the last piece; instants excluded before its rows are rows of zeros.
        summed = at_slots(rows.H, factors(rows), slots(rows.time, start_s, step_s) - done)
        done += len(summed)
        yield summed


Rows = Union["Regression", StoredRows]
"""The rows of one equation or side: in memory, or stored in a file."""


@dataclass(frozen=True, eq=False)
class FittedRows:
    """An estimate with its QR factor, and its rows where they are in memory.

    `rows` are weighted as a robust estimate weights them; `propagated` is the covariance (s, s) of
    the propagated parameters. `settled` are the converged weights (E,) of the equations, None if
    the estimate did not use them; `equal` says that it weighted all equations equally. `change`
    takes plain rows to those of the estimate: with its weights, and the columns to which its
    residual is orthogonal. With a `constraint` P (p, p), c (p,) the values are P x + c of those of
    least squares x. `shared` are the parameters that several drives share.
    """

    estimate: Estimate
    qr_factor: QRFactor
    rows: Regression | None
    propagated: Array | None
    settled: Array | None = None
    equal: bool = False
    change: RowChange = unchanged
    constraint: tuple[Array, Array] | None = None
    shared: tuple[SharedParameter, ...] = ()

    @cached_property
    def weights(self) -> Array:
        """The converged weights (E,) of the equations, for every estimator."""
        return settled_weights(self.qr_factor) if self.settled is None else self.settled

    @cached_property
    def sensitivity(self) -> Array:
        """The derivative (p, s) of the values by the propagated parameters."""
        return self._slopes(self.qr_factor)

    def slopes(self, rows: Rows) -> Array:
        """Return the derivative (p, s) of the values by what `rows` propagate.

        `rows` are the plain ones, before `change`. Their propagated columns C are derivatives of
        the residual y - H theta at the values of the estimate.
        """
        return self._slopes(qr_factor_of_rows(rows, self.change))

    def _slopes(self, qr_factor: QRFactor) -> Array:
        """Return the derivative by the propagated columns of a factor of the same rows."""
        weights = equal_weights(self.qr_factor) if self.equal else self.weights
        # H^T W^2 (y - H theta^) = 0, and the residual of the true parameters is noise e and errors
        # C d: theta^ - theta = (H^T W^2 H)^-1 H^T W^2 (e + C d), whatever made H and W.
        moments = np.einsum("e,eps->ps", weights**2, qr_factor.propagated)
        slopes = solve(qr_factor, weights).inverse @ moments
        return np.asarray(slopes if self.constraint is None else self.constraint[0] @ slopes)

    @property
    def white_covariance(self) -> Array:
        """The covariance (p, p) for white noise in every equation."""
        return estimate_of(self.qr_factor, self.weights, None, self.propagated).covariance

    def checks(self, optional: Sequence[str]) -> ModelChecks:
        """Return the checks of the model, with its `optional` parameters."""
        by_index = {} if self.rows is None else whiteness(self.rows, self.estimate.values)
        names = () if self.rows is None else self.rows.joint_names
        named = {names[index % len(names)]: test for index, test in by_index.items()}
        return model_checks(self.qr_factor, self.estimate, optional, named, self.weights)


def with_further_columns(
    fit: FittedRows, columns: Array, counts: Callable[[Array], bool]
) -> Estimate | None:
    """Return the estimate of a fit with further parameters x, its last k ones, or None.

    They have the `columns` (R, k) on the side of y: y + columns x = H theta. None if they are
    unidentifiable, or if `counts` of their values (k,) is false.
    """
    assert fit.rows is not None
    k = columns.shape[1]
    # y + columns x = H theta: on the side of theta the columns are negative.
    rows = fit.rows.with_columns([f"further {place}" for place in range(k)], k * [""], -columns)
    try:
        parts = factored(rows, fit.propagated)
        if not counts(solve(parts.whole, fit.weights).values[-k:]):
            return None
        return estimate_of_rows(parts, fit.weights)
    except ExcitationError:
        return None


def qr_factor_of_rows(rows: Rows, change: RowChange) -> QRFactor:
    """Return the QR factor of rows after `change`."""
    if isinstance(rows, StoredRows):
        return combined(qr_factor_of(piece) for _, piece in rows.pieces(change))
    return qr_factor_of(change(rows))


def fit(
    rows: Rows,
    estimator: Estimator,
    propagated: Array | None = None,
    change: RowChange | None = None,
    check: Callable[[QRFactor], None] = lambda _: None,
    cutoff_hz: float | None = None,
) -> FittedRows:
    """Fit rows after `change`, with the covariance (s, s) of the propagated parameters.

    `check` may refuse the QR factor of the rows. Stored rows need an estimator that weights
    equations. With the `cutoff_hz` of the rows their drift is in the covariance. Raises as
    `ordinary` does.
    """
    weigh = estimator.weigh

    def checked(qr_factor: QRFactor) -> Array:
        check(qr_factor)
        return equal_weights(qr_factor) if weigh is None else weigh(qr_factor)

    in_memory, changed = None, change or unchanged
    if isinstance(rows, StoredRows):
        assert weigh is not None
        estimate, qr_factor, weights = stored_estimate(rows, checked, propagated, change, cutoff_hz)
    else:
        in_memory = rows if change is None else change(rows)
        parts = factored(in_memory, propagated)
        qr_factor, weights = parts.whole, checked(parts.whole)
        if weigh is None:
            estimate = estimator.solve(in_memory, propagated)
            if estimator.columns is None:
                changed = partial(_effective, estimator, estimate, changed)
            else:
                changed = partial(replace, H=estimator.columns(in_memory))
            # The checks are of the rows as the M-estimate weights them, without its outliers.
            in_memory = estimator.effective_rows(in_memory, estimate)
            qr_factor = qr_factor_of(in_memory)
        else:
            estimate = estimate_of_rows(parts, weights, cutoff_hz)
    settled = weights if weigh is settled_weights else None
    equal = weigh is equal_weights
    return FittedRows(estimate, qr_factor, in_memory, propagated, settled, equal, changed)


def _effective(
    estimator: Estimator, estimate: Estimate, change: RowChange, rows: Regression
) -> Regression:
    """Return rows after a change as an estimate weights them."""
    return estimator.effective_rows(change(rows), estimate)
