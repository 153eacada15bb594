"""What an estimate depends on: its change by a wider cutoff, over the standard error of the change.

Fits with two cutoffs have the same noise, so that the standard error of their difference is far
below that of independent ones (Hausman 1978): it is that of the sum over time of the difference of
the influences of the rows. A difference beyond it is a bias of one of the estimates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress

import numpy as np

from seaid._arrays import Array
from seaid.checks.tolerances import SIGNIFICANT, TWICE
from seaid.checks.values import disagreement, homogeneous
from seaid.errors import ExcitationError, Finding, IdentificationError
from seaid.estimation import FittedRows
from seaid.estimation.covariance import at_slots, long_run, row_step, slots
from seaid.estimation.least_squares import equal_weights, solve
from seaid.estimation.qr_factor import QRFactor, qr_factor_of
from seaid.identification import two_step
from seaid.identification.drive_estimates import has_only_spring_torque, with_unit_constant
from seaid.identification.stacked_fits import LOAD, RobotEstimate
from seaid.log import Motion
from seaid.log.motion import decimated
from seaid.regressor import Regression, actuator_regression, load_regression
from seaid.regressor.load import LoadModel
from seaid.regressor.regression import Regress, stacked
from seaid.robot import Robot

WIDER = 1.6
"""Ratio of the compared cutoffs: noise in an acceleration grows tenfold in power."""

_SAMPLES_PER_PERIOD = 20.0
"""Samples per period of the lower cutoff in the comparison of cutoffs: twice those of the wider
low pass of the positions, and a tenth of the log."""

_NEGLIGIBLE = 0.005
"""Part of the torque that a difference must change: less is harmless, however certain."""


@dataclass(frozen=True, eq=False)
class WeightedFit:
    """Values (p,) of rows, and their derivatives by what they depend on.

    `influence` (R, p) is that of each row on the values, and `by_propagated` (p, s) is
    d theta / ds by the values s from which y was computed.
    """

    rows: Regression
    values: Array
    influence: Array
    by_propagated: Array


def fit_of(
    rows: Regression,
    weights: Array,
    qr_factor: QRFactor | None = None,
    constraint: tuple[Array, Array] | None = None,
) -> WeightedFit:
    """Fit rows with weights (E,) of their equations; `qr_factor` is theirs if it is known.

    With a `constraint` P (p, p), c (p,) the values are P x + c, where x are those of least squares.
    """
    qr_factor = qr_factor or qr_factor_of(rows)
    solution = solve(qr_factor, weights)
    values, inverse = solution.values, solution.inverse
    if constraint is not None:
        values, inverse = constraint[0] @ values + constraint[1], constraint[0] @ inverse
    squares = weights[np.searchsorted(qr_factor.equations, rows.joint)] ** 2
    # w^2 (y - H theta) H (H^T W H)^-1, under the constraint of the values.
    influence = (squares * (rows.y - rows.H @ values))[:, None] * (rows.H @ inverse.T)
    # d theta / ds = (H^T W H)^-1 H^T W T for targets y + T s.
    moments = np.einsum("e,eps->ps", weights**2, qr_factor.propagated)
    return WeightedFit(rows, values, influence, inverse @ moments)


def difference(fits: Sequence[WeightedFit], propagated: Array | None) -> tuple[Array, Array]:
    """Return the difference (p,) of two fits, and its standard errors.

    The influences are summed over common steps of time, as the rows need not be the same.
    `propagated` (s, s) is the covariance of the values from which the targets were computed.
    """
    first, second = fits
    runs = np.unique(np.concatenate([fit.rows.run for fit in fits]))
    summed = [_influences(fits, run) for run in runs]
    # Both fits have the same noise: the variance of their difference is that of the difference of
    # the influences, not the sum of two variances.
    covariance = long_run([[scores] for scores in summed], sum(map(len, summed)))
    total = covariance.for_normal_intervals
    if propagated is not None:
        # those that both have: not encoder offsets and a bias, which are common to them
        k = min(fit.by_propagated.shape[1] for fit in fits)
        by = first.by_propagated[:, :k] - second.by_propagated[:, :k]
        total = total + by @ propagated[:k, :k] @ by.T
    return first.values - second.values, np.sqrt(np.maximum(np.diag(total), 1e-300))


def _influences(fits: Sequence[WeightedFit], run: float) -> Array:
    """Return the influences (T, p) of the rows of a log on a difference, by steps of time.

    The steps are those of the fit with the fewest rows; other logs have instants between them.
    """
    parts = [fit.rows.run == run for fit in fits]
    times = [fit.rows.time[part] for fit, part in zip(fits, parts, strict=True)]
    instants = [np.unique(time) for time in times if len(time)]
    start_s, step_s = min(x[0] for x in instants), max(map(row_step, instants))
    signed = zip((1, -1), fits, parts, strict=True)
    influences = np.concatenate([sign * fit.influence[part] for sign, fit, part in signed])
    places = slots(np.concatenate(times), start_s, step_s)
    return at_slots(influences, np.ones(len(places)), places)


def _scores(
    fits: Sequence[WeightedFit], stated_errors: Mapping[str, float], propagated: Array | None
) -> Array:
    """Return the standard errors (p,) by which two fits differ, zero where it does not matter.

    A change within the `stated_errors` {parameter: standard error} does not.
    """
    change, errors = difference(fits, propagated)
    stated = np.array([stated_errors[name] for name in fits[0].rows.names])
    H, y = fits[0].rows.H, fits[0].rows.y
    # Norm of the torque in the rows that a parameter acts on.
    torque = np.linalg.norm(y[:, None] * (H != 0), axis=0)
    matters = np.abs(change) > TWICE * stated
    matters &= np.abs(change) * np.linalg.norm(H, axis=0) > _NEGLIGIBLE * torque
    scores = np.abs(change) / errors
    return np.where(matters & (scores > SIGNIFICANT), scores, 0.0)


def _stated_errors(
    joint: str, fit: FittedRows, sides: RobotEstimate, stated: RobotEstimate
) -> dict[str, float]:
    """Return {parameter: standard error} of a fit, with the errors of what was given as known.

    They are to those by the noise of the logs as in the result, whose units may be others: a fit
    for a motor constant of 1 has a stiffness over that constant.
    """
    errors = dict(zip(fit.estimate.names, fit.estimate.standard_errors.tolist(), strict=True))
    both = [x.load_side if joint == LOAD else x.drives[joint] for x in (sides, stated)]
    for name in {*errors}.intersection(*(x.names for x in both)):
        before, after = (x.standard_error(name) for x in both)
        errors[name] *= max(after / before, 1.0) if before else 1.0
    return errors


def sensitivity_findings(
    condition: two_step.Condition, sides: RobotEstimate, stated: RobotEstimate, estimator: str
) -> list[Finding]:
    """Return what a wider cutoff contradicts in two steps of wls or ols, and pulls to zero.

    `stated` has the errors of what was given as known. Of long logs the first pieces are compared.
    """
    if estimator not in ("wls", "ols"):
        return []
    ordinary, cutoff_hz = estimator == "ols", condition.datasets[0].cutoff_hz
    weights = equal_weights(sides.fit.qr_factor) if ordinary else sides.fit.weights
    findings = list(homogeneous(sides.fit, weights, cutoff_hz))
    with suppress(ExcitationError, IdentificationError):  # what only the other way cannot solve
        findings += _cutoff_findings(condition, sides, stated, ordinary)
    return findings


def _cutoff_findings(
    condition: two_step.Condition, sides: RobotEstimate, stated: RobotEstimate, ordinary: bool
) -> Iterator[Finding]:
    """Yield the parameters that differ between the cutoff and a wider one, by fewer samples."""
    robot, motions = condition.robot, condition.motions
    cutoff_hz = motions[0].cutoff_hz
    steps = (int(x.rate_hz / (_SAMPLES_PER_PERIOD * cutoff_hz)) for x in motions)
    few = [decimated(x, step) if step > 1 else x for x, step in zip(motions, steps, strict=True)]
    # The positions are filtered at a multiple of the narrow cutoff and stay as they are: the wider
    # one is that of regressor and torque.
    wider = [replace(motion, cutoff_hz=WIDER * cutoff_hz) for motion in few]
    ways = (f"a cutoff of {cutoff_hz:.3g} Hz", f"a cutoff of {WIDER * cutoff_hz:.3g} Hz")
    for joint, regress, fit in _compared_equations(robot, motions, condition.model, sides):
        weights = fit.weights if joint == LOAD and not ordinary else equal_weights(fit.qr_factor)
        rows = stacked(list(map(regress, wider)))
        constraint = _constraint_of(fit, rows.names)
        wide = fit_of(rows, weights, None, constraint)
        # of long logs, the rows of the fit are those of more than the first pieces
        if condition.motions_in_memory and fit.rows is not None and fit.rows.names == rows.names:
            narrow = fit_of(fit.rows, weights, fit.qr_factor, constraint)
        else:
            narrow = fit_of(stacked(list(map(regress, few))), weights, None, constraint)
        scores = _scores([narrow, wide], _stated_errors(joint, fit, sides, stated), fit.propagated)
        better = _better_cutoff(robot, joint, cutoff_hz, compress(rows.names, scores))
        remedy = f"{better}, and compare the values"
        values = dict(zip(ways, (narrow.values, wide.values), strict=True))
        owner = "" if joint == LOAD else joint
        yield from disagreement(owner, narrow.rows, values, scores, remedy)


def _constraint_of(fit: FittedRows, names: Sequence[str]) -> tuple[Array, Array] | None:
    """Return the constraint of a fit for rows without the columns of torque offsets, if any."""
    if fit.constraint is None:
        return None
    places = [fit.estimate.names.index(name) for name in names]
    return fit.constraint[0][np.ix_(places, places)], fit.constraint[1][places]


def _compared_equations(
    robot: Robot, motions: list[Motion], model: LoadModel, sides: RobotEstimate
) -> Iterator[tuple[str, Regress, FittedRows]]:
    """Yield the equations of drives with a motor torque, and of the load side, with their fits."""
    for joint, fit in sides.actuators.items():
        if not has_only_spring_torque(robot, motions, joint):
            yield joint, partial(_actuator_rows, robot, joint=joint, fit=fit), fit
    yield LOAD, partial(load_regression, robot, model=model, springs=sides.springs), sides.fit


def _better_cutoff(robot: Robot, joint: str, cutoff_hz: float, differing: Iterable[str]) -> str:
    """Return the cutoff to try where parameters differ between two."""
    is_load, narrow, wide = joint == LOAD, 0.5 * cutoff_hz, WIDER * cutoff_hz
    if is_load and robot.has_controllers:  # friction at rest biases a delay by the narrow cutoff
        sticking = f"cutoff_hz={wide:.2g}, if joints stick at their reversals"
        return f"{sticking}; cutoff_hz={narrow:.2g}, if the encoders are noisy"
    # Noise biases all parameters but friction, which lacks the band of its reversals.
    is_biased = is_load or any("friction" not in name for name in differing)
    return f"cutoff_hz={narrow if is_biased else wide:.2g}"


def _actuator_rows(robot: Robot, motion: Motion, joint: str, fit: FittedRows) -> Regression:
    """Return the rows of (10) in the columns of a fit, which may be that of a unit constant."""
    rows = actuator_regression(robot, motion, joint)
    return rows if rows.names == fit.qr_factor.names else with_unit_constant(rows)
