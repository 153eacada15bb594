"""What an estimate depends on: the estimator, the cutoff, and the constants that were given.

Two ways of the same fit have the same noise, so that the standard error of their difference is far
below that of independent ones (Hausman 1978): it is that of the sum over time of the difference of
the influences of the rows. A difference beyond it is a bias of one of the estimates.

The moments H^T W (y - H theta) = 0 of an estimate hold exactly. At the true parameters their
residual is the noise e and, for constants with errors d, C d, where C are the derivatives of the
residual by the constants. So the estimate errs by (H^T W H)^-1 H^T W (e + C d), whatever made the
columns H (instruments too) and the weights W: the derivative by a constant needs one assembly of C
at the estimates, and nothing is estimated again. The way through the springs is the derivative of
the load side by their parameters (stacked moments: Newey and McFadden 1994, section 6).

A scale error of the torques changes all parameters together: their covariance says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import Any, TypeVar

import numpy as np

from seaid._arrays import Array
from seaid.checks import CODES, disagreement, homogeneous, shared_scale
from seaid.drives import (
    IDEAL_DRIVE,
    STD_OF_TORQUE,
    Drive,
    ParameterName,
    parameter_of,
    readable,
)
from seaid.errors import ExcitationError, Finding, IdentificationError
from seaid.estimation import (
    Estimate,
    FittedRows,
    QRFactor,
    Rows,
    at_slots,
    equal_weights,
    long_run,
    qr_factor_of,
    row_step,
    slots,
    solve,
)
from seaid.identification.datasets import Dataset, first_motion
from seaid.identification.drive_estimates import (
    LOAD,
    TORQUE_OFFSET,
    RobotEstimate,
    has_only_spring_torque,
    offset_lever,
    sensed_spring,
    shared_slopes,
    with_merged_columns,
    without_torque,
)
from seaid.identification.motor_constants import (
    CONSTANTS,
    STIFFNESS,
    scales_with_torque,
    with_unit_constant,
)
from seaid.identification.two_step import (
    Condition,
    SpecificParameters,
    propagated_names,
    rows_of_conditions,
)
from seaid.log import POSITION_BAND, Log, Motion, low_pass
from seaid.regressor import (
    LoadModel,
    Regress,
    Regression,
    actuator_regression,
    load_regression,
    names_of_all,
    spring_regression,
    stacked,
    torque_changes,
    with_changes,
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
        load = _with_merged(robot, sides.fit)
        findings += _estimator_findings(robot, load, ordinary, cutoff_hz)
        findings += _cutoff_findings(robot, datasets, model, sides, load, ordinary)
    return findings


def _with_merged(robot: Robot, fit: FittedRows, joint: str = "") -> FittedRows:
    """Return a fit whose rows and factor have one column for the delay of a bus, as its values."""
    if fit.rows is None:
        return fit
    rows = with_merged_columns(robot.drives, fit.rows, fit.estimate, joint)
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
        shared = partial(with_merged_columns, robot.drives, estimate=fit.estimate, joint=joint)
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
            equations[joint] = regress, _with_merged(robot, fit, joint)
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


TYPICAL_STD = {
    "torque": 0.03,
    "payload": 0.01,
    "bodies": 0.05,
    "motor_inertia_kg_m2": 0.05,
    "gear_ratio": 0.001,
    "motor_pulley_radius_m": 0.005,
    "load_pulley_radius_m": 0.005,
}
"""Values that the output proposes: tolerances of data sheets (of K_t, of inertias), of scales, of
masses by CAD, and of turned pulleys with their cable."""

STEP = 1e-5
"""Relative change of a constant in difference quotients of residuals."""

_CHANNELS = ("motor_torque", "motor_current", "motor_voltage", "joint_torque")


Recorded = TypeVar("Recorded", Log, Motion)


@dataclass(frozen=True, eq=False)
class Constant:
    """A constant with a relative standard deviation, and a robot in which it is larger by `STEP`.

    `joint` is "" if it is common to all joints, or that of a body. `inputs` are the joints whose
    inputs are larger: logged ones, and the gains of controllers in the robot.
    """

    name: str
    joint: str
    std: float
    robot: Robot
    inputs: tuple[str, ...] = ()

    def scaled(self, data: Recorded) -> Recorded:
        """Return a log or motion with the larger logged inputs, itself without any."""
        if not self.inputs:
            return data
        factor = 1 + STEP * np.isin(data.joint_names, self.inputs)
        logged = [name for name in _CHANNELS if getattr(data, name) is not None]
        changes: dict[str, Any] = {name: getattr(data, name) * factor for name in logged}
        return replace(data, **changes)

    def is_in_drive(self, joint: str) -> bool:
        """Whether the equations of a joint's drive may contain it."""
        return bool(self.inputs) or (self.joint == joint and self.name != "bodies")


def exact_constants(robot: Robot, known_std: Mapping[str, float]) -> dict[str, float]:
    """Return the constants in use without a standard deviation, with their `TYPICAL_STD`."""
    drives = [drive for drive in robot.drives.values() if drive != IDEAL_DRIVE]
    is_scaled = bool(robot.known_bodies) and all(map(_has_unknown_scale, robot.drives.values()))
    is_exact = {name: _is_exact(drives, name) for name in TYPICAL_STD} | {
        "torque": not is_scaled and _lacks_std(drives or [IDEAL_DRIVE], STD_OF_TORQUE),
        "payload": bool(np.any(robot.payload_parameters)),
        "bodies": bool(robot.known_bodies),
    }
    return {x: std for x, std in TYPICAL_STD.items() if is_exact[x] and not known_std.get(x)}


def _is_exact(drives: Sequence[Drive], name: str) -> bool:
    """Whether drives have a constant, and one of them no standard deviation of it."""
    return any(getattr(x, name, None) for x in drives) and _lacks_std(drives, name)


def _lacks_std(drives: Sequence[Drive], name: str) -> bool:
    return any(name not in drive.std for drive in drives)


_INPUT_CONSTANTS = {"torque_constant", "voltage_constant"}


def scaled_by_bodies(drives: Mapping[str, Estimate], exact: Mapping[str, float]) -> list[str]:
    """Return the joints whose motor constants rest on known bodies, if these are `exact`."""
    constants = (joint for joint, x in drives.items() if _INPUT_CONSTANTS & set(x.names))
    return list(constants) if "bodies" in exact else []


def _has_unknown_scale(drive: Drive) -> bool:
    return drive.motor_input != "torque" and _INPUT_CONSTANTS.isdisjoint(drive.known)


def constants_of(robot: Robot, known_std: Mapping[str, float]) -> Iterator[Constant]:
    """Yield the constants that have a standard deviation: by `known_std`, or by their drive."""
    if known_std.get("torque"):
        larger = _with_larger_gains(robot, robot.joint_names)
        yield Constant("torque", "", known_std["torque"], larger, robot.joint_names)
    if known_std.get("payload"):
        heavier = replace(robot, payload_parameters=(1 + STEP) * robot.payload_parameters)
        yield Constant("payload", "", known_std["payload"], heavier)
    for body in robot.known_bodies if known_std.get("bodies") else ():
        factor = np.where(np.repeat([x == body for x in robot.body_names], 10), 1 + STEP, 1.0)
        heavier = robot.with_values(factor * robot.parameters, robot.drives)
        yield Constant("bodies", body, known_std["bodies"], heavier)
    for joint in robot.drives:
        yield from _constants_of_drive(robot, joint, known_std)


def _constants_of_drive(
    robot: Robot, joint: str, known_std: Mapping[str, float]
) -> Iterator[Constant]:
    """Yield the constants of a drive that have a standard deviation, by `known_std` or its own."""
    drive = robot.drives[joint]
    stds = {name: std for name, std in known_std.items() if hasattr(drive, name)}
    for name, std in {**stds, **drive.std}.items():
        value, is_delay = getattr(drive, name, None) or 0.0, name == "command_delay_s"
        if not std or (is_delay and "command_delay" not in drive.known):
            continue  # the latter is the range of an unknown delay
        if name == STD_OF_TORQUE:
            yield Constant(name, joint, std, _with_larger_gains(robot, [joint]), (joint,))
        elif is_delay:
            later = _with_constant(robot, joint, name, value + STEP * std)  # value may be zero
            yield Constant(name, joint, 1.0, later)
        elif value:
            relative = std / abs(value) if name in drive.std else std
            larger = _with_constant(robot, joint, name, (1 + STEP) * value)
            yield Constant(name, joint, relative, larger)


def _with_larger_gains(robot: Robot, joints: Sequence[str]) -> Robot:
    """Return the robot whose controllers at some joints give a torque larger by `STEP`."""
    commanded = {x: y for x in joints if (y := robot.drives[x].controller) is not None}
    larger = {
        joint: replace(controller.times(1 + STEP), is_up_to_scale=controller.is_up_to_scale)
        for joint, controller in commanded.items()
    }
    return robot.with_drives(
        {joint: replace(robot.drives[joint], controller=larger[joint]) for joint in larger}
    )


def _with_constant(robot: Robot, joint: str, name: str, value: float) -> Robot:
    """Return the robot with a constant of one drive changed."""
    changes: dict[str, Any] = {name: value}
    return robot.with_drives({joint: replace(robot.drives[joint], **changes)})


def with_known_std(
    conditions: Mapping[str, Condition],
    estimates: Mapping[str, RobotEstimate],
    known_std: Mapping[str, float],
    specific: SpecificParameters,
    executor: Executor | None = None,
) -> Mapping[str, RobotEstimate]:
    """Return the estimates of all conditions with the uncertainty of the constants.

    A constant has one error in all conditions, as the drives are the same ones.
    """
    constants = {name: list(constants_of(x.robot, known_std)) for name, x in conditions.items()}
    _check_same(constants)
    common = next(iter(constants.values()))
    if not common:
        return estimates
    slopes = _slopes(conditions, estimates, constants, specific, executor)
    # Steps are relative, as the standard deviations are; for a delay both are parts of its std.
    stds = np.array([constant.std for constant in common])
    scales = [shared_scale(constant.std) for constant in common if constant.name == "torque"]

    def of_condition(name: str, sides: RobotEstimate) -> RobotEstimate:
        widened = partial(_widened, slopes=slopes, stds=stds, condition=name)
        return replace(
            sides,
            drives={joint: widened(side, joint=joint) for joint, side in sides.drives.items()},
            load=widened(sides.load, names=sides.load_side.names[: len(sides.load.names)]),
            load_side=widened(sides.load_side),
            whole=None if sides.whole is None else widened(sides.whole),
            findings=(*sides.findings, *scales),
        )

    return {name: of_condition(name, sides) for name, sides in estimates.items()}


def _slopes(
    conditions: Mapping[str, Condition],
    estimates: Mapping[str, RobotEstimate],
    constants: Mapping[str, Sequence[Constant]],
    specific: SpecificParameters,
    executor: Executor | None,
) -> Mapping[str, Array]:
    """Return {parameter: its derivatives (k,) by the constants} of the estimates together."""
    first, sides = next(iter(estimates.items()))
    robot, common = conditions[first].robot, constants[first]
    of_springs = propagated_names(robot, [*sides.springs])
    equations = {
        name: _equations(name, x, estimates[name], constants[name])
        for name, x in conditions.items()
    }
    names = [ParameterName(constant.name, constant.joint) for constant in common]
    stored = sides.fit.rows is None
    with rows_of_conditions(
        conditions, specific, equations, of_springs, stored, executor, constants=names
    ) as (rows, _):
        if sides.regress is not None:
            return dict(zip(sides.fit.estimate.names, sides.fit.slopes(rows[LOAD]), strict=True))
        springs = names_of_all(of_springs, [*conditions], specific.of_load)
        return _two_step_slopes(robot, sides, common, rows, springs)


def _check_same(constants: Mapping[str, Sequence[Constant]]) -> None:
    """Raise IdentificationError for conditions with standard deviations of different constants."""
    stds = {
        condition: {ParameterName(x.name, x.joint): x.std for x in stated}
        for condition, stated in constants.items()
    }
    (first, of_first), *others = stds.items()
    for condition, of_other in others:
        if of_other != of_first:
            differing = sorted({*of_first.items()} ^ {*of_other.items()})[0][0]
            raise IdentificationError(
                f"conditions '{first}' and '{condition}' have different standard deviations of "
                f"{readable(differing)}, whose error all conditions share: give both the same"
            )


def _widened(
    estimate: Estimate,
    slopes: Mapping[str, Array],
    stds: Array,
    condition: str,
    joint: str = "",
    names: Sequence[str] | None = None,
) -> Estimate:
    """Return an estimate with the covariance of independent errors of the constants.

    `slopes` {name: (k,)} are derivatives by these, with standard deviations `stds` (k,); those of
    what a condition has alone are under its name. The estimate is that of a `joint`, or has these
    `names` in the slopes, by default its own.
    """
    keys = names or [ParameterName(name, joint) if joint else name for name in estimate.names]
    keys = [x if x in slopes else ParameterName.of(x).within(condition) for x in keys]
    change = np.array([slopes[key] for key in keys]).reshape(len(keys), len(stds)) * stds
    return replace(estimate, covariance=estimate.covariance + change @ change.T)


def _rows_at_once(
    regress: Callable[[Robot, Motion], Regression],
    robot: Robot,
    theta: Array,
    constants: Sequence[Constant],
    motion: Motion,
) -> Regression:
    """Return both sides at once, with the derivatives of their residual by the constants."""
    changed = (regress(constant.robot, constant.scaled(motion)) for constant in constants)
    return with_changes(regress(robot, motion), changed, theta, STEP)


def _equations(
    name: str, condition: Condition, sides: RobotEstimate, constants: Sequence[Constant]
) -> dict[str, Regress]:
    """Return the functions for the rows of a condition, which propagate errors of the constants."""
    robot, equations = condition.robot, dict[str, Regress]()
    if sides.regress is not None:
        values = sides.fit.estimate.values
        return {LOAD: partial(_rows_at_once, sides.regress, robot, values, constants)}
    for joint, fit in sides.actuators.items():
        of_drive = partial(_drive_rows, robot, constants, joint)
        equations[joint] = partial(of_drive, fit.estimate.of_condition(name), actuator_regression)
        by_sensor = sides.scaling.get(joint)
        if by_sensor is not None and STIFFNESS in by_sensor.estimate.names:
            equations[sensed_spring(joint)] = partial(
                of_drive, by_sensor.estimate.of_condition(name), spring_regression
            )
    return equations | {LOAD: partial(_load_rows, robot, condition.model, sides, constants)}


def _drive_rows(
    robot: Robot,
    constants: Sequence[Constant],
    joint: str,
    estimate: Estimate,
    regress: Callable[[Robot, Motion, str], Regression],
    motion: Motion,
) -> Regression:
    """Return the rows of a drive's equation with the derivatives of their residual."""
    rows = regress(robot, motion, joint)
    changed = (
        regress(constant.robot, constant.scaled(motion), joint)
        if constant.is_in_drive(joint)
        else rows
        for constant in constants
    )
    # The unknown constant of a motor, which the estimate lacks, is 1 in a fit without its scale.
    values = dict(zip(estimate.names, estimate.values, strict=True))
    theta = np.array([values.get(name, 1.0) for name in rows.names])
    return with_changes(rows, changed, theta, STEP)


def _load_rows(
    robot: Robot,
    model: LoadModel,
    sides: RobotEstimate,
    constants: Sequence[Constant],
    motion: Motion,
) -> Regression:
    """Return the load side without the torques of springs, which propagates them and constants.

    With f_0 = s - b_0 N/r_M in `springs`, the column of the torque offset b_0 is in the residual.
    """

    def changes(piece: Motion) -> Array:
        changed = [(constant.robot, constant.scaled(piece)) for constant in constants]
        values = sides.springs, sides.load_side.values
        return torque_changes(robot, piece, model, *values, changed) / STEP

    return load_regression(robot, motion, model, without_torque(robot, sides.springs), changes)


def _two_step_slopes(
    robot: Robot,
    sides: RobotEstimate,
    constants: Sequence[Constant],
    rows: Mapping[str, Rows],
    springs: Sequence[str],
) -> dict[str, Array]:
    """Return {parameter: its derivatives (k,) by the constants} of both sides.

    `springs` are the parameters whose errors (8) propagates.
    """
    own = {joint: _motor_slopes(sides, joint, fit, rows) for joint, fit in sides.actuators.items()}
    shared_slopes(robot, sides.actuators, own)
    of_springs = list(map(ParameterName.of, springs))

    def of_load(fit: FittedRows) -> dict[str, Array]:
        """Return the derivatives of a fit of (8): direct ones, and those through the springs."""
        by_springs, direct = np.split(fit.slopes(rows[LOAD]), [len(springs)], axis=1)
        through = np.array([own[name.owner][name.at("")] for name in of_springs])
        total = direct + by_springs @ through.reshape(len(springs), len(constants))
        return dict(zip(fit.estimate.names, total, strict=True))

    scales = {
        joint: _scale_slopes(sides, joint, own[joint], rows, of_load) for joint in sides.scaling
    }
    for joint, relative in scales.items():
        # The values are K x for a motor constant K, and x is at K = 1: d(K x) = K dx + K x dK/K.
        name, scale = _motor_constant(sides, joint)
        unit = sides.actuators[joint].estimate
        for place in np.flatnonzero(scales_with_torque(unit)):
            own[joint][unit.names[place]] += scale * unit.values[place] * relative
        own[joint][name] = scale * relative
    load = of_load(sides.fit)
    for joint in sides.springs:
        if ParameterName(TORQUE_OFFSET, joint) in load:
            _separate(robot, sides, joint, own[joint], load, constants)
    merged: dict[str, Array] = {
        ParameterName.of(name).at(joint): own[joint][name] for joint in own for name in own[joint]
    }
    return {**merged, **load}


def _motor_constant(sides: RobotEstimate, joint: str) -> tuple[str, float]:
    """Return name and value of the unknown constant of a motor, 1 if it has none."""
    drive = sides.drives[joint]
    return next(((name, drive.value(name)) for name in CONSTANTS if name in drive.names), ("", 1.0))


def _motor_slopes(
    sides: RobotEstimate, joint: str, fit: FittedRows, rows: Mapping[str, Rows]
) -> dict[str, Array]:
    """Return the derivatives of a drive by (7), for a fixed constant of its motor."""
    slopes = fit.slopes(rows[joint])
    if joint in sides.scaling:
        slopes[scales_with_torque(fit.estimate)] *= _motor_constant(sides, joint)[1]
    return dict(zip(fit.estimate.names, slopes, strict=True))


def _scale_slopes(
    sides: RobotEstimate,
    joint: str,
    own: Mapping[str, Array],
    rows: Mapping[str, Rows],
    of_load: Callable[[FittedRows], dict[str, Array]],
) -> Array:
    """Return the relative derivatives (k,) of a motor's constant, which bodies or a sensor give."""
    fit, (name, scale) = sides.scaling[joint], _motor_constant(sides, joint)
    if ParameterName(name, joint) in fit.estimate.names:
        return of_load(fit)[ParameterName(name, joint)] / scale
    # K = k / k_1 with the stiffness k by the sensor and k_1 by (7), for a constant of 1.
    place = fit.estimate.names.index(STIFFNESS)
    by_sensor = fit.slopes(rows[sensed_spring(joint)])[place] / fit.estimate.values[place]
    unit = scale * sides.actuators[joint].estimate.value(STIFFNESS)
    return np.asarray(by_sensor - own[STIFFNESS] / unit)


def _separate(
    robot: Robot,
    sides: RobotEstimate,
    joint: str,
    own: dict[str, Array],
    load: dict[str, Array],
    constants: Sequence[Constant],
) -> None:
    """Give a drive the derivatives of f_0 = s - b_0 N/r_M and of b_0, from those of s and (8)."""
    lever, key = offset_lever(robot, joint), ParameterName(TORQUE_OFFSET, joint)
    changes = [offset_lever(constant.robot, joint) / lever - 1 for constant in constants]
    offset = sides.fit.estimate.value(key)
    for name in own:
        if parameter_of(name) == "spring_offset":
            own[name] = own[name] - lever * load[key]
    # (8) gives b_0 N/r_M: for a larger lever b_0 is smaller.
    own[TORQUE_OFFSET] = load[key] = load[key] - offset * np.array(changes) / STEP
