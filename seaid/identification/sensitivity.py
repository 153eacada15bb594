"""What an estimate depends on: the cutoff, and the constants that were given.

Fits with two cutoffs have the same noise, so that the standard error of their difference is far
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
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import Any, TypeVar

import numpy as np

from seaid._arrays import Array
from seaid.checks import CODES
from seaid.checks.tolerances import MATERIAL, SIGNIFICANT
from seaid.checks.values import disagreement, homogeneous, shared_scale
from seaid.drives import IDEAL_DRIVE, Drive, ParameterName, readable
from seaid.drives.drives import STD_OF_TORQUE
from seaid.drives.terms import MOTOR_CONSTANTS
from seaid.errors import ExcitationError, Finding, IdentificationError
from seaid.estimation import Estimate, FittedRows
from seaid.estimation.covariance import at_slots, long_run, row_step, slots
from seaid.estimation.estimate import independent_errors
from seaid.estimation.fitting import Rows
from seaid.estimation.least_squares import equal_weights, solve
from seaid.estimation.parameters import names_of_all
from seaid.estimation.qr_factor import QRFactor, qr_factor_of
from seaid.identification import two_step
from seaid.identification.drive_estimates import (
    has_only_spring_torque,
    with_unit_constant,
    without_torque,
)
from seaid.identification.stacked_fits import (
    LOAD,
    KnownErrors,
    RobotEstimate,
    offset_lever,
    sensed_spring,
)
from seaid.log import Log, Motion, low_pass
from seaid.log.motion import POSITION_BAND
from seaid.regressor import Regression, actuator_regression, load_regression
from seaid.regressor.load import OFFSET_STEP, LoadModel, shifted_encoder, torque_changes
from seaid.regressor.regression import Regress, spring_regression, stacked, with_changes
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


def _scores(fits: Sequence[WeightedFit], estimate: Estimate, propagated: Array | None) -> Array:
    """Return the standard errors (p,) by which two fits differ, zero where it does not matter."""
    change, errors = difference(fits, propagated)
    by_name = dict(zip(estimate.names, estimate.standard_errors, strict=True))
    stated = np.array([by_name[name] for name in fits[0].rows.names])
    H, y = fits[0].rows.H, fits[0].rows.y
    # Norm of the torque in the rows that a parameter acts on.
    torque = np.linalg.norm(y[:, None] * (H != 0), axis=0)
    matters = np.abs(change) > MATERIAL * stated
    matters &= np.abs(change) * np.linalg.norm(H, axis=0) > _NEGLIGIBLE * torque
    scores = np.abs(change) / errors
    return np.where(matters & (scores > SIGNIFICANT), scores, 0.0)


def sensitivity_findings(
    condition: two_step.Condition, sides: RobotEstimate, estimator: str
) -> list[Finding]:
    """Return what a wider cutoff contradicts in two steps of wls or ols, and pulls to zero.

    Of long logs the first pieces are compared.
    """
    if estimator not in ("wls", "ols"):
        return []
    ordinary, cutoff_hz = estimator == "ols", condition.datasets[0].cutoff_hz
    findings = list(
        homogeneous(
            sides.fit,
            equal_weights(sides.fit.qr_factor) if ordinary else sides.fit.weights,
            cutoff_hz,
        )
    )
    with suppress(ExcitationError, IdentificationError):  # what only the other way cannot solve
        findings += _cutoff_findings(condition, sides, ordinary)
    return findings


def _cutoff_findings(
    condition: two_step.Condition, sides: RobotEstimate, ordinary: bool
) -> Iterator[Finding]:
    """Yield the parameters that differ between the cutoff and a wider one, by fewer samples."""
    robot, motions = condition.robot, condition.motions
    few = list(map(_decimated, motions))
    cutoff_hz = few[0].cutoff_hz
    # The positions are filtered at a multiple of the narrow cutoff and stay as they are: the wider
    # one is that of regressor and torque.
    wider = [replace(motion, cutoff_hz=WIDER * cutoff_hz) for motion in few]
    ways = (f"a cutoff of {cutoff_hz:.3g} Hz", f"a cutoff of {WIDER * cutoff_hz:.3g} Hz")
    equations = _compared_equations(robot, motions, condition.model, sides)
    # of long logs, the rows of the fit are those of more than the first pieces
    in_memory = all(isinstance(dataset, Motion) for dataset in condition.datasets)
    for joint, (regress, fit) in equations.items():
        weights = fit.weights if joint == LOAD and not ordinary else equal_weights(fit.qr_factor)
        rows = stacked(list(map(regress, wider)))
        constraint = _constraint_of(fit, rows.names)
        wide = fit_of(rows, weights, None, constraint)
        if in_memory and fit.rows is not None and fit.rows.names == rows.names:
            narrow = fit_of(fit.rows, weights, fit.qr_factor, constraint)
        else:
            narrow = fit_of(stacked(list(map(regress, few))), weights, None, constraint)
        scores = _scores([narrow, wide], fit.estimate, fit.propagated)
        better = _better_cutoff(robot, joint, cutoff_hz, compress(rows.names, scores))
        remedy = f"{better}, and compare the values"
        values = dict(zip(ways, (narrow.values, wide.values), strict=True))
        owner = "" if joint == LOAD else joint
        code = CODES["cutoff-sensitive"]
        yield from disagreement(code, owner, narrow.rows, values, scores, remedy)


def _constraint_of(fit: FittedRows, names: Sequence[str]) -> tuple[Array, Array] | None:
    """Return the constraint of a fit for rows without the columns of torque offsets, if any."""
    if fit.constraint is None:
        return None
    places = [fit.estimate.names.index(name) for name in names]
    return fit.constraint[0][np.ix_(places, places)], fit.constraint[1][places]


def _compared_equations(
    robot: Robot, motions: list[Motion], model: LoadModel, sides: RobotEstimate
) -> dict[str, tuple[Regress, FittedRows]]:
    """Return the equations of drives with a motor torque, and of the load side, with their fits."""
    equations: dict[str, tuple[Regress, FittedRows]] = {}
    for joint, fit in sides.actuators.items():
        if not has_only_spring_torque(robot, motions, joint):
            regress = partial(_actuator_rows, robot, joint=joint, fit=fit)
            equations[joint] = regress, fit
    regress = partial(load_regression, robot, model=model, springs=sides.springs)
    return equations | {LOAD: (regress, sides.fit)}


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
"""The names in `known_std`, with the values that the output proposes: tolerances of data sheets (of
K_t, of inertias), of scales, of masses by CAD, and of turned pulleys with their cable. The torques
have one scale error common to all, each known body has its own."""

STEP = 1e-5
"""Relative change of a constant in difference quotients of residuals."""

_CHANNELS = ("motor_torque", "motor_current", "motor_voltage", "joint_torque")


Recorded = TypeVar("Recorded", Log, Motion)


@dataclass(frozen=True, eq=False)
class Constant:
    """A constant with a standard deviation, and a `robot` in which it is larger by a step.

    `std` is in units of the step over `STEP`: relative for a step of `STEP` times the value, and 1
    for a delay, whose step is `STEP` of its standard deviation. `joint` is "" if the constant is
    common to all joints, or the name of a body. `inputs` are the joints whose inputs are larger:
    logged ones, and the gains of controllers in the robot. The offset of a joint's encoder, whose
    step is `OFFSET_STEP`, is in the motion alone.
    """

    name: str
    joint: str
    std: float
    robot: Robot
    inputs: tuple[str, ...] = ()

    @property
    def is_offset(self) -> bool:
        """Whether it is an encoder offset, which each condition has for itself."""
        return self.name == two_step.ENCODER_OFFSET

    @property
    def key(self) -> ParameterName:
        """Its name among the errors of what is known, which belong to no drive."""
        return ParameterName(f"{self.name} of {self.joint}")

    def changed(self, motion: Motion) -> Motion:
        """Return a motion with the larger inputs, or with the encoder offset."""
        if self.is_offset:
            return shifted_encoder(self.robot, motion, self.robot.index(self.joint))
        return self.scaled(motion)

    def scaled(self, data: Recorded) -> Recorded:
        """Return a log or motion with the larger logged inputs, itself without any."""
        if not self.inputs:
            return data
        factor = 1 + STEP * np.isin(data.joint_names, self.inputs)
        logged = [name for name in _CHANNELS if getattr(data, name) is not None]
        changes: dict[str, Any] = {name: getattr(data, name) * factor for name in logged}
        return replace(data, **changes)

    def is_in_drive(self, joint: str) -> bool:
        """Whether the equations of a joint's drive may contain it.

        Those of any drive may contain a larger input, since coupled drives share torques.
        """
        return bool(self.inputs) or (
            self.joint == joint and self.name not in ("bodies", two_step.ENCODER_OFFSET)
        )


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


_INPUT_CONSTANTS = {*MOTOR_CONSTANTS.values()}


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
    drives = {}
    for joint in joints:
        if (controller := robot.drives[joint].controller) is not None:
            larger = controller.times(1 + STEP)
            larger = replace(larger, is_up_to_scale=controller.is_up_to_scale)
            drives[joint] = replace(robot.drives[joint], controller=larger)
    return robot.with_drives(drives)


def _with_constant(robot: Robot, joint: str, name: str, value: float) -> Robot:
    """Return the robot with a constant of one drive changed."""
    changes: dict[str, Any] = {name: value}
    return robot.with_drives({joint: replace(robot.drives[joint], **changes)})


def encoder_offsets(robot: Robot, std: float) -> list[Constant]:
    """Return the offsets of the joint encoders with a standard deviation [rad or m], if any."""
    part = std * STEP / OFFSET_STEP  # in units of the step over `STEP`, see `Constant`
    return [Constant(two_step.ENCODER_OFFSET, x, part, robot) for x in robot.joint_names if std]


@dataclass(frozen=True, eq=False)
class GivenConstants:
    """What was given as known of the robots of all conditions, with standard deviations.

    `constants` {condition: its constants} have one error in all conditions, as the drives are the
    same ones; encoders, which come last, are zeroed anew in each.
    """

    conditions: Mapping[str, two_step.Condition]
    constants: Mapping[str, Sequence[Constant]]
    specific: two_step.SpecificParameters

    @property
    def common(self) -> Sequence[Constant]:
        """The constants of all conditions, with the robot of the first one."""
        return next(iter(self.constants.values()))

    @property
    def errors(self) -> Estimate:
        """The errors, of steps that are relative as the standard deviations are."""
        stds = {constant.key: constant.std for constant in self.common}
        own = [x.key for x in self.common if x.is_offset and len(self.conditions) > 1]
        names = {key: names_of_all([key], [*self.conditions], own.__contains__) for key in stds}
        return independent_errors({str(name): stds[key] for key in names for name in names[key]})

    @contextmanager
    def rows(self, estimates: Mapping[str, RobotEstimate]) -> Iterator[Mapping[str, Rows]]:
        """Yield the rows of the equations of estimates, whose last columns propagate the errors."""
        sides, first = next(iter(estimates.values())), next(iter(self.conditions.values()))
        equations = {
            name: _equations(name, x, estimates[name], self.constants[name])
            for name, x in self.conditions.items()
        }
        with two_step.rows_of_conditions(
            self.conditions,
            self.specific,
            equations,
            two_step.propagated_names(first.robot, [*sides.springs]),
            sides.fit.rows is None,
            error_names=[constant.key for constant in self.common],
        ) as of_conditions:
            yield of_conditions.rows

    def known_errors(self, estimates: Mapping[str, RobotEstimate]) -> KnownErrors:
        """Return the errors with the slopes of estimates."""
        fits, errors, load = next(iter(estimates.values())).fits, self.errors, None
        with self.rows(estimates) as rows:
            slopes = {key: fit.slopes(rows[equation]) for key, equation, fit in fits.equations}
            if fits.refit is not None and len(self._offsets):
                load = fits.refit(rows[LOAD], self._offsets)
        k = len(errors.names)
        slopes = {key: x if key == LOAD else x[:, -k:] for key, x in slopes.items()}
        levers = {}  # relative derivatives of N/r_M by each error: those of encoders change nothing
        for joint in fits.springs:
            after = np.array([offset_lever(constant.robot, joint) for constant in self.common])
            changes = (after / offset_lever(fits.robot, joint) - 1) / STEP
            levers[joint] = np.pad(changes, (0, k - len(changes)))
        return KnownErrors(errors, slopes, levers, load, len(self._offsets))

    @property
    def _offsets(self) -> Array:
        """The covariance of encoder offsets, which are in the residual and are no noise."""
        first = sum(not constant.is_offset for constant in self.common)
        return self.errors.covariance[first:, first:]

    def included(self, estimates: Mapping[str, RobotEstimate]) -> Mapping[str, RobotEstimate]:
        """Return the estimates of all conditions with the errors of what was given."""
        if not self.common:
            return estimates
        known_errors = self.known_errors(estimates)
        wide = {name: x.with_errors(known_errors, name) for name, x in estimates.items()}
        scales = [shared_scale(x.std) for x in self.common if x.name == "torque"]
        return {name: replace(x, findings=(*x.findings, *scales)) for name, x in wide.items()}


def given_constants(
    conditions: Mapping[str, two_step.Condition], known_std: Mapping[str, float]
) -> Mapping[str, list[Constant]]:
    """Return the constants of each condition that have a standard deviation."""
    constants = {name: list(constants_of(x.robot, known_std)) for name, x in conditions.items()}
    _check_same(constants)
    return constants


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


def _with_constants(
    robot: Robot,
    constants: Sequence[Constant],
    values: Mapping[str, float],
    regress: Callable[[Robot, Motion], Regression],
    motion: Motion,
    joint: str = "",
) -> Regression:
    """Return rows with the derivatives of their residual by the constants, at values.

    Those of the equation of a `joint` may lack some. An offset of an encoder is in the offset of
    its spring, and in nothing else.
    """
    rows = regress(robot, motion)
    changed = (
        rows if joint and not x.is_in_drive(joint) else regress(x.robot, x.changed(motion))
        for x in constants
    )
    # The unknown constant of a motor, which the estimate lacks, is 1 in a fit without its scale.
    theta = np.array([values.get(name, 1.0) for name in rows.names])
    return with_changes(rows, changed, theta, STEP)


def _equations(
    name: str, condition: two_step.Condition, sides: RobotEstimate, constants: Sequence[Constant]
) -> dict[str, Regress]:
    """Return the functions for the rows of a condition, which propagate errors of the constants."""
    robot, fits, equations = condition.robot, sides.fits, dict[str, Regress]()
    if sides.regress is not None:
        values = sides.fit.estimate.by_name
        return {LOAD: partial(_with_constants, robot, constants, values, sides.regress)}
    of_drives = {x: (x, fit, actuator_regression) for x, fit in sides.actuators.items()}
    for joint, fit in fits.by_sensor.items():
        of_drives[sensed_spring(joint)] = joint, fit, spring_regression
    for equation, (joint, fit, regress) in of_drives.items():
        values, rows_of = fit.estimate.of_condition(name).by_name, partial(regress, joint=joint)
        equations[equation] = partial(
            _with_constants, robot, constants, values, rows_of, joint=joint
        )
    return equations | {LOAD: partial(_load_rows, condition, sides, constants)}


def _load_rows(
    condition: two_step.Condition,
    sides: RobotEstimate,
    constants: Sequence[Constant],
    motion: Motion,
) -> Regression:
    """Return the load side without the torques of springs, which propagates them and constants.

    With f_0 = s - b_0 N/r_M in `springs`, the column of the torque offset b_0 is in the residual;
    see `with_torque_columns`.
    """
    robot, model, theta = condition.robot, condition.model, sides.load_side.values
    in_drives = [constant for constant in constants if not constant.is_offset]

    def changes(piece: Motion) -> Array:
        changed = [(constant.robot, constant.changed(piece)) for constant in in_drives]
        return torque_changes(robot, piece, model, sides.springs, theta, changed) / STEP

    zero, further = without_torque(robot, sides.springs), changes if in_drives else None
    rows = load_regression(robot, motion, model, zero, further)
    # An offset turns gravity, and so the columns of the bodies.
    turning = [constant for constant in constants if constant.is_offset]
    if not turning:
        return rows
    regress = partial(load_regression, model=model, springs=sides.springs)
    offsets = _with_constants(robot, turning, sides.load_side.by_name, regress, motion)
    return replace(rows, propagated=np.hstack([rows.propagated, offsets.propagated]))
