"""What an estimate depends on: the estimator and the cutoff.

Two ways of the same fit have the same noise, so that the standard error of their difference is far
below that of independent ones (Hausman 1978): it is that of the sum over time of the difference of
the influences of the rows. A difference beyond it is a bias of one of the estimates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.checks import CODES, disagreement, homogeneous
from seaid.errors import ExcitationError, Finding, IdentificationError
from seaid.estimation import (
    Estimate,
    FittedRows,
    QRFactor,
    at_slots,
    equal_weights,
    long_run,
    qr_factor_of,
    row_step,
    slots,
    solve,
)
from seaid.identification.command_delays import with_merged_delays
from seaid.identification.datasets import Dataset, first_motion
from seaid.identification.drive_estimates import has_only_spring_torque
from seaid.identification.two_step import LOAD, RobotEstimate, with_unit_constant
from seaid.log import POSITION_BAND, Motion, low_pass
from seaid.regressor import (
    LoadModel,
    Regress,
    Regression,
    actuator_regression,
    load_regression,
    stacked,
)
from seaid.robot import Robot

WIDER = 1.6
"""Ratio of the compared cutoffs: noise in an acceleration grows tenfold in power."""

_SAMPLES_PER_PERIOD = 20.0
"""Samples per period of the lower cutoff in the comparison of cutoffs: twice those of the wider
low pass of the positions, and a tenth of the log."""

_DIFFERENT = 5.0
"""Standard errors of a difference above which estimates differ: beyond chance for 50 parameters
whose covariance rests on some 100 correlated instants (`scripts/benchmarks/sensitivity.py`: at most
4.5 in 120 right set-ups)."""

_MATERIAL = 2.0
"""Stated standard errors above which a difference counts: below it is within the interval."""

_NEGLIGIBLE = 0.005
"""Part of the torque that a difference must change: less is harmless, however certain."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Values (p,) of rows, and their derivatives by what they depend on.

    `residual` (R,) of each row has the square of its weight; times the row and `inverse` (p, p),
    that of the normal equations, it is the influence of the row on the values. `by_propagated`
    (p, s) is the derivative by the values from which the targets were computed.
    """

    rows: Regression
    values: Array
    residual: Array
    inverse: Array
    by_propagated: Array


def fit_of(rows: Regression, weights: Array, qr_factor: QRFactor | None = None) -> Fit:
    """Fit rows with weights (E,) of their equations; `qr_factor` is theirs if it is known."""
    qr_factor = qr_factor or qr_factor_of(rows)
    solution = solve(qr_factor, weights)
    squares = weights[np.searchsorted(qr_factor.equations, rows.joint)] ** 2
    residual = squares * (rows.y - rows.H @ solution.values)
    # d theta / ds = (H^T W H)^-1 H^T W T for targets y + T s.
    moments = np.einsum("e,eps->ps", weights**2, qr_factor.propagated)
    inverse = solution.inverse
    return Fit(rows, solution.values, residual, inverse, inverse @ moments)


def difference(fits: Sequence[Fit], propagated: Array | None) -> tuple[Array, Array]:
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


def _influences(fits: Sequence[Fit], run: float) -> Array:
    """Return the influences (T, p) of the rows of a log on a difference, by steps of time.

    The steps are those of the fit with the fewest rows; other logs have instants between them.
    """
    parts = [_rows_of_log(fit, run) for fit in fits]
    instants = [np.unique(time) for time, _, _ in parts if len(time)]
    start_s = min(times[0] for times in instants)
    step_s = max(row_step(times) for times in instants)
    places = [slots(time, start_s, step_s) for time, _, _ in parts]
    every = np.concatenate(places)
    first, count = int(np.min(every)), int(np.ptp(every)) + 1
    influences = np.zeros((count, len(fits[0].values)))
    for sign, fit, (_, H, residual), place in zip((1, -1), fits, parts, places, strict=True):
        if len(place):
            scores = at_slots(H, sign * residual, place - first)
            influences[: len(scores)] += scores @ fit.inverse
    return influences


def _rows_of_log(fit: Fit, run: float) -> tuple[Array, Array, Array]:
    """Return times, rows and residuals of a fit in one log."""
    is_row = fit.rows.run == run
    rows = slice(None) if np.all(is_row) else is_row  # a view of all rows
    return fit.rows.time[rows], fit.rows.H[rows], fit.residual[rows]


def _scores(fits: Sequence[Fit], estimate: Estimate, propagated: Array | None) -> Array:
    """Return the standard errors (p,) by which two fits differ, zero where it does not matter."""
    change, errors = difference(fits, propagated)
    by_name = dict(zip(estimate.names, estimate.standard_errors, strict=True))
    stated = np.array([by_name[name] for name in fits[0].rows.names])
    H, y = fits[0].rows.H, fits[0].rows.y
    # Norm of the torque in the rows that a parameter acts on.
    torque = np.linalg.norm(y[:, None] * (H != 0), axis=0)
    matters = np.abs(change) > _MATERIAL * stated
    matters &= np.abs(change) * np.linalg.norm(H, axis=0) > _NEGLIGIBLE * torque
    scores = np.abs(change) / errors
    return np.where(matters & (scores > _DIFFERENT), scores, 0.0)


def sensitivity_findings(
    robot: Robot,
    datasets: Sequence[Dataset],
    model: LoadModel,
    sides: RobotEstimate,
    estimator: str,
) -> list[Finding]:
    """Return what another estimator or a wider cutoff contradicts in two steps of wls or ols.

    Of long logs the first pieces are compared.
    """
    if estimator not in ("wls", "ols"):
        return []
    ordinary, cutoff_hz = estimator == "ols", datasets[0].cutoff_hz
    findings = list(
        homogeneous(
            sides.fit,
            equal_weights(sides.fit.qr_factor) if ordinary else sides.fit.weights,
            cutoff_hz,
        )
    )
    with suppress(ExcitationError, IdentificationError):  # what only the other way cannot solve
        load = _with_shared_delays(robot, sides.fit)
        findings += _estimator_findings(robot, load, ordinary, cutoff_hz)
        findings += _cutoff_findings(robot, datasets, model, sides, load, ordinary)
    return findings


def _with_shared_delays(robot: Robot, fit: FittedRows, joint: str = "") -> FittedRows:
    """Return a fit whose rows and factor have one column for the delay of a bus, as its values."""
    if fit.rows is None:
        return fit
    rows = with_merged_delays(robot.drives, fit.rows, fit.estimate, joint)
    return fit if rows is fit.rows else replace(fit, rows=rows, qr_factor=qr_factor_of(rows))


def _estimator_findings(
    robot: Robot, fit: FittedRows, ordinary: bool, cutoff_hz: float
) -> Iterator[Finding]:
    """Yield the parameters of the load side on which weighted and ordinary rows disagree."""
    if fit.rows is None or len(fit.qr_factor.equations) < 2:
        return
    weights = {"wls": fit.weights, "ols": equal_weights(fit.qr_factor)}
    ways = ("ols", "wls") if ordinary else ("wls", "ols")
    fits = [fit_of(fit.rows, weights[name], fit.qr_factor) for name in ways]
    scores = _scores(fits, fit.estimate, fit.propagated)
    remedy = f"{_other_cutoff(robot, cutoff_hz)}; else a term that a joint lacks"
    values = [fit.values for fit in fits]
    yield from disagreement(
        CODES["estimator-disagrees"], "", fits[0].rows, values, scores, ways, remedy
    )


def _cutoff_findings(
    robot: Robot,
    datasets: Sequence[Dataset],
    model: LoadModel,
    sides: RobotEstimate,
    load: FittedRows,
    ordinary: bool,
) -> Iterator[Finding]:
    """Yield the parameters that differ between the cutoff and a wider one, by fewer samples."""
    motions = [first_motion(dataset) for dataset in datasets]
    few = [_decimated(motion) for motion in motions]
    cutoff_hz = few[0].cutoff_hz
    # The positions are filtered at a multiple of the narrow cutoff and stay as they are: the wider
    # one is that of regressor and torque.
    wider = [replace(motion, cutoff_hz=WIDER * cutoff_hz) for motion in few]
    ways = (f"a cutoff of {cutoff_hz:.3g} Hz", f"a cutoff of {WIDER * cutoff_hz:.3g} Hz")
    equations = _compared_equations(robot, motions, model, sides, load)
    # of long logs, the rows of the fit are those of more than the first pieces
    in_memory = all(isinstance(dataset, Motion) for dataset in datasets)
    for joint, (regress, fit) in equations.items():
        shared = partial(with_merged_delays, robot.drives, estimate=fit.estimate, joint=joint)
        weights = fit.weights if joint == LOAD and not ordinary else equal_weights(fit.qr_factor)
        rows = shared(stacked(list(map(regress, wider))))
        wide = fit_of(rows, weights)
        if in_memory and fit.rows is not None and fit.rows.names == rows.names:
            narrow = fit_of(fit.rows, weights, fit.qr_factor)
        else:
            narrow = fit_of(shared(stacked(list(map(regress, few)))), weights)
        scores = _scores([narrow, wide], fit.estimate, fit.propagated)
        better = _better_cutoff(robot, joint, cutoff_hz, compress(rows.names, scores))
        remedy = f"{better}; compare others with cutoff_sensitivity"
        values = [narrow.values, wide.values]
        yield from disagreement(
            CODES["cutoff-sensitive"], joint, narrow.rows, values, scores, ways, remedy
        )


def _compared_equations(
    robot: Robot, motions: list[Motion], model: LoadModel, sides: RobotEstimate, load: FittedRows
) -> dict[str, tuple[Regress, FittedRows]]:
    """Return the equations of drives with a motor torque, and of the load side, with their fits."""
    equations: dict[str, tuple[Regress, FittedRows]] = {}
    for joint, fit in sides.actuators.items():
        if not has_only_spring_torque(robot, motions, joint):
            regress = partial(_actuator_rows, robot, joint=joint, fit=fit)
            equations[joint] = regress, _with_shared_delays(robot, fit, joint)
    equations[LOAD] = partial(load_regression, robot, model=model, springs=sides.springs), load
    return equations


def _better_cutoff(robot: Robot, joint: str, cutoff_hz: float, differing: Iterable[str]) -> str:
    """Return the cutoff to try where parameters differ between two."""
    if joint == LOAD and robot.has_controllers:
        return _other_cutoff(robot, cutoff_hz)
    # noise biases all parameters but friction, which lacks the band of its reversals
    is_biased = joint == LOAD or any("friction" not in name for name in differing)
    return f"cutoff_hz={cutoff_hz * (0.5 if is_biased else WIDER):.2g}"


def _other_cutoff(robot: Robot, cutoff_hz: float) -> str:
    """Return the cutoff to try; with commands friction at rest biases a delay by the narrow one."""
    narrower = f"cutoff_hz={cutoff_hz / 2:.2g}, if the encoders are noisy"
    if robot.has_controllers:
        return f"cutoff_hz={WIDER * cutoff_hz:.2g}, if joints stick at their reversals; {narrower}"
    return narrower


def _actuator_rows(robot: Robot, motion: Motion, joint: str, fit: FittedRows) -> Regression:
    """Return the rows of (10) in the columns of a fit, which may be that of a unit constant."""
    rows = actuator_regression(robot, motion, joint)
    return rows if rows.names == fit.qr_factor.names else with_unit_constant(rows)


def _decimated(motion: Motion) -> Motion:
    """Return a motion with fewer samples, torques and directions without what these would alias."""
    step = max(1, int(motion.rate_hz / (_SAMPLES_PER_PERIOD * motion.cutoff_hz)))
    band = POSITION_BAND * motion.cutoff_hz
    inputs = ("motor_torque", "joint_torque", "motor_current", "motor_voltage", "motor_direction")
    smooth: dict[str, Any] = {
        name: low_pass(signal, motion.rate_hz, band)
        for name in inputs
        if (signal := getattr(motion, name)) is not None
    }
    return replace(motion, **smooth).samples(slice(None, None, step))
