"""`identify`: the actuator side first, then the load side with its springs, or both at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._files import write_json
from seaid._progress import Result, counted
from seaid.checks import (
    FEET_CHECKS,
    Experiment,
    JointFit,
    SideSelection,
    Verdict,
    base_findings,
    consequences,
    delay_estimate_findings,
    drive_findings,
    excluded_findings,
    experiment_of,
    explained,
    fit_findings,
    fixed_findings,
    gear_findings,
    is_wrong,
    locked_outputs,
    log_findings,
    mass_findings,
    missing_torques,
    model_findings,
    model_sides,
    noise_findings,
    observed,
    offset_findings,
    prediction_errors,
    resolved_widths,
    rigid_gear,
    robot_fit,
    scale_of_bodies,
    selections,
    sensor_errors,
    standstill_findings,
    that_matter,
    unknown_scales,
    unused_findings,
    verdict_of,
    with_torques_of,
    without_echoes,
    without_setup_echoes,
)
from seaid.errors import (
    ExcitationError,
    Finding,
    IdentificationError,
    LogError,
    by_severity,
    checked,
    listed,
)
from seaid.estimation import (
    Estimate,
    Estimator,
    EstimatorName,
    ModelChecks,
    QRFactor,
    estimator_named,
)
from seaid.identification.base_estimates import SensorBias, sensor_bias, whole_mass
from seaid.identification.checking import (
    JointCheck,
    check_channels,
    findings_of_setup,
    joint_checks,
    standing_joints,
    without_locked_loads,
    without_standing,
)
from seaid.identification.command_delays import (
    MOST_DELAY_ROUNDS,
    with_estimated_delays,
    with_fixed_delays,
)
from seaid.identification.consistency import FeasibleParameters, feasible_parameters
from seaid.identification.contact_forces import legged_fit
from seaid.identification.datasets import (
    Dataset,
    Source,
    check_temperatures,
    datasets_by_log,
    first_motion,
    processing_of,
    sources_of,
)
from seaid.identification.drive_estimates import negative_inertias, with_estimate
from seaid.identification.gear import (
    deflection_joints,
    gear_estimates,
    own_estimates,
    with_gears,
    with_rigid_gears,
)
from seaid.identification.instrumental import estimate_instrumental
from seaid.identification.model_selection import MOST_ROUNDS, backlash_findings, with_default_terms
from seaid.identification.motor_side import (
    cutoff_of,
    shown_springs,
    starts_by_regression,
    without_joint_encoder,
)
from seaid.identification.nonlinear_terms import linearised_robot, with_searched_values
from seaid.identification.output_error import FirstEstimate, first_estimate, refined_with_logs
from seaid.identification.sensitivity import (
    check_known_std,
    exact_constants,
    scaled_by_bodies,
    sensitivity_findings,
    with_known_std,
)
from seaid.identification.simulated_joints import check_refinable, with_passed_reversals
from seaid.identification.simultaneous import estimate_simultaneous, estimate_supported
from seaid.identification.two_step import (
    RobotEstimate,
    check_forces,
    check_scale_of_locked,
    estimate_two_step,
    joints_with_torque,
    with_free_scale,
    with_unit_scales,
)
from seaid.log import Log, Motion, Processing, stretches, with_commanded_torque
from seaid.regressor import BaseParameters, LoadModel, check_offset_std, is_linear, load_model_of
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification.validation import Validation


Method = Literal["auto", "two-step", "simultaneous"]

_FAR_M = 1e4
"""Distance of a centre of mass from which a body has no mass but for rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """The parameters of a robot identified from one log or several.

    Attributes
    ----------
    drive_side : mapping {joint: Estimate}
        The parameters of each drive as in its equations: a stiffness is that between the encoders.
    load : Estimate
        The base parameters, whose definitions are in `base`.
    robot : Robot
        The robot with the identified values. Its standard parameters are those nearest to the robot
        file that have the estimated base parameters; physically consistent ones if `feasible` is
        set.
    known : Robot
        The input robot, with values for the parameters in which its drive equations are nonlinear.
    model, load_side : LoadModel, Estimate
        The columns of the load side (8) and their whole estimate.
    springs : mapping {joint: ndarray}
        Parameters of the springs whose torque is that on the load.
    cutoff_hz : float
        Cutoff of the low pass.
    excluded, checks : mapping
        Number of instants near standstill, and checks of the model, by joint and "load" for the
        load side ("both" if both sides were estimated at once).
    feasible : FeasibleParameters or None
        How the physically consistent parameters were computed.
    gears : mapping {joint: Estimate}
        Stiffness, hysteresis and encoder offset of the gears, where the deflection of the spring
        was measured.
    processing, motions : tuple
        Processing of each log; motions of the logs in memory, for `compared`.
    findings : tuple of Finding
        Findings about the set-up, the fit of the whole robot, and its values.
    joint_fits : mapping {joint: JointFit}
        How much of the torque of each joint the model explains.
    residual : tuple of 2 floats
        Of a floating base, the norm of the residual of all joints over that of their torques
        without contact forces: in the own logs, and in blocks of them excluded from the fit.
    exact_constants : mapping {constant: float}
        Constants that were taken as exact, by their names in `known_std`, with typical tolerances.
    known_std : mapping {constant: float}
        Relative standard deviations of known constants that are in the standard errors.
    setup : mapping {joint: JointCheck}
        What the logs say of the set-up: gear ratios between encoders, delays of torques.
    nominal : Robot or None
        `known` without the values of the search: the nominal ones of the input robot only.
    not_shared : str
        Why the data do not support an estimate of both sides at once; "" where they do, or where
        the method was chosen.
    """

    table_name = "identification_table"

    drive_side: Mapping[str, Estimate]
    load: Estimate
    base: BaseParameters
    robot: Robot
    known: Robot
    model: LoadModel
    load_side: Estimate
    springs: Mapping[str, Array]
    cutoff_hz: float
    excluded: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    feasible: FeasibleParameters | None = None
    gears: Mapping[str, Estimate] = field(default_factory=dict)
    processing: tuple[Processing, ...] = ()
    motions: tuple[Motion, ...] = ()
    findings: tuple[Finding, ...] = ()
    joint_fits: Mapping[str, JointFit] = field(default_factory=dict)
    residual: tuple[float, float] = (float("nan"), float("nan"))
    exact_constants: Mapping[str, float] = field(default_factory=dict)
    known_std: Mapping[str, float] = field(default_factory=lambda: FrozenMapping({}))
    setup: Mapping[str, JointCheck] = field(default_factory=dict)
    nominal: Robot | None = None
    not_shared: str = ""

    def _in_short(self) -> str:
        drives = counted(len(self.drives), "drive")
        warnings = counted(len(self.warnings), "warning")
        sizes = f"{drives}, {counted(len(self.load.names), 'base parameter')}"
        return f"'{self.robot.name}': {sizes}, cutoff {self.cutoff_hz:.3g} Hz, {warnings}"

    @property
    def method(self) -> Method:
        """The method of the estimate: "two-step" or "simultaneous"."""
        return "simultaneous" if "both" in self.checks else "two-step"

    @cached_property
    def drives(self) -> Mapping[str, Estimate]:
        """The parameters of each drive, with the spring's own stiffness if the gear's is known."""
        return own_estimates(self.known.drives, self.drive_side, self.gears)

    @cached_property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings about the experiment, the data and the values, the worst first."""
        return by_severity(that_matter(self.findings, self.joint_fits))

    @cached_property
    def unusable_joints(self) -> Mapping[str, str]:
        """Joints of a fixed base that no simulation should have, each with the reason.

        Their torque was not used, or their rotor inertia is negative, and not only uncertain.
        """
        if self.robot.floating_base is not None:
            return {}
        unused = set(self.robot.joint_names) - set(self.model.torque_joints)
        stands = "it stands still in all logs"
        reasons = {
            joint: stands if joint in self.known.at_rest else "its torque was not used"
            for joint in self.robot.joint_names
            if joint in unused
        }
        return FrozenMapping({**reasons, **negative_inertias(self.robot, self.drives)}, "joint")

    @cached_property
    def verdict(self) -> Verdict:
        """Whether to use the result, by its warnings."""
        return verdict_of(self.warnings, self.joint_fits)

    def to_dict(self, validation: Validation | None = None) -> dict[str, Any]:
        """Return the content of `parameters.json` as plain data, null for missing values."""
        from seaid.export import content_of

        return content_of(self, validation)

    def save(self, path: str | Path, validation: Validation | None = None) -> None:
        """Write `parameters.json`, whole or not at all; `read_parameters` reads it."""
        write_json(path, self.to_dict(validation))


@checked(IdentificationError)
def identify(
    robot: Robot,
    logs: Source | Sequence[Source],
    *,
    torque_joints: str | Sequence[str] | None = None,
    method: Method = "auto",
    estimator: EstimatorName = "wls",
    feasible: bool = False,
    cutoff_hz: float | None = None,
    encoder_offset_std: float = 0.0,
    known_std: Mapping[str, float] = MappingProxyType({}),
    executor: Executor | None = None,
    progress: bool = False,
) -> Identification:
    """Identify the drives and the load of a robot from one log or several.

    Part one estimates friction, stiffness and spring offset of each elastic joint from its motor
    equation (7). Part two computes the load torques from the springs by (4b) and estimates the base
    parameters from the load side (8), with the uncertainty of the springs propagated. Where the
    data support it, both equations are then solved at once.

    Of `robot` only ratios, radii, geometry, payloads and known values enter the estimate, and with
    `feasible` its inertial parameters as a prior; nominal values are only starts of a search.
    Parameters in which a drive equation is nonlinear (a width, a Stribeck speed, a dead zone) are
    first searched by variable projection (in the first piece of a log that is read in pieces); then
    they have a column and a standard error like all others.

    Parameters
    ----------
    robot : Robot
        The robot model of `load_robot`.
    logs : Log, LongLog, path, or a sequence of them
        Logs in memory, or log files with standard column names that are read in pieces: with "ols"
        and "wls" memory does not grow with their length.
    torque_joints : sequence of str, optional
        Joints whose torque is used on the load side. Default: all with a measured torque.
    method : {"auto", "two-step", "simultaneous"}
        "two-step" is that of the paper. "simultaneous" continues from it to (7) and (8) in one
        regression that shares the springs. "auto" takes the latter, which is the more accurate one,
        if the equations of two steps lack nothing, and if both agree; `Identification.not_shared`
        says why not.
    estimator : {"wls", "ols", "huber", "tukey", "iv"}
        Least squares weighted per joint or ordinary, robust estimators, or instrumental variables
        from the fitted model against the bias by noise in the regressor (two-step only). Logs
        without the joint position of a spring refuse "iv", and the method "simultaneous".
    feasible : bool
        Make `Identification.robot` physically consistent; see `feasible_parameters`.
    cutoff_hz : float, optional
        Cutoff of the low pass. Default: proposed from the data.
    encoder_offset_std : float
        Standard deviation of the joint encoder offsets [rad or m], propagated to the load side.
    known_std : mapping {constant: relative standard deviation}
        Of what was given as known: "torque" (one scale error common to all torques), "payload"
        (mass), "bodies" (each known body, by a scale of its own), "motor_inertia_kg_m2",
        "gear_ratio", "motor_pulley_radius_m", "load_pulley_radius_m"; propagated to all estimates.
        A drive's own `std` takes precedence.
    executor : concurrent.futures.Executor, optional
        Processes the logs, one per task.
    progress : bool
        Show progress bars.

    Returns
    -------
    Identification

    Raises
    ------
    IdentificationError, ExcitationError, LogError
        For wrong options, for a motion that leaves parameters unidentifiable, for logs that do not
        fit the robot.

    Examples
    --------
    >>> robot = seaid.load_robot("leg.urdf", "leg.toml")
    >>> result = seaid.identify(robot, seaid.read_log("run.csv", robot), feasible=True)
    >>> print(result.summary())
    """
    options = _Options(
        torque_joints=torque_joints,
        method=method,
        estimator=estimator,
        feasible=feasible,
        cutoff_hz=cutoff_hz,
        encoder_offset_std=encoder_offset_std,
        known_std=known_std,
        executor=executor,
        progress=progress,
    )
    result, fixed, unscaled = with_unit_scales(
        {"": robot}, lambda robots: _identify(robots[""], logs, options)
    )
    robot, nominal = fixed[""], result.nominal
    # The column of a delay is a derivative at the delay of the drive: the fit is repeated about
    # each estimate.
    for _ in range(MOST_DELAY_ROUNDS):
        later = with_estimated_delays(robot, result.robot)
        if later is robot:
            break
        robot, result = later, _identify(later, logs, options)
    unclear = (
        *delay_estimate_findings(robot, result.load_side),
        *unknown_scales(result.robot, result.load_side, unscaled),
    )
    scaled = with_free_scale(result.robot, unscaled)
    return replace(result, robot=scaled, nominal=nominal, findings=(*result.findings, *unclear))


@dataclass(frozen=True, eq=False)
class _Options:
    """The options of `identify`."""

    torque_joints: str | Sequence[str] | None
    method: Method
    estimator: EstimatorName
    feasible: bool
    cutoff_hz: float | None
    encoder_offset_std: float
    known_std: Mapping[str, float]
    executor: Executor | None
    progress: bool

    @property
    def of_two_steps(self) -> tuple[Estimator, float, Executor | None, bool]:
        """Those of the two steps, from which instruments continue too."""
        solver = estimator_named("wls" if self.estimator == "iv" else self.estimator)
        return solver, self.encoder_offset_std, self.executor, self.progress

    def check(self) -> None:
        """Raise IdentificationError for options that exclude each other, or wrong values."""
        if self.estimator == "iv" and self.method == "simultaneous":
            raise IdentificationError(
                f'estimator="iv" needs method="two-step", found "{self.method}"',
                'estimator="iv"',
                'method="two-step"',
            )
        check_offset_std(self.encoder_offset_std)
        check_known_std(self.known_std)

    def check_without_encoders(self, joints: Sequence[str]) -> None:
        """Raise IdentificationError for options that do nothing if `joints` have no encoder."""
        refused = 'method="simultaneous"' if self.method == "simultaneous" else ""
        refused = 'estimator="iv"' if self.estimator == "iv" else refused
        if refused:
            raise IdentificationError(
                f"{refused} needs the joint position of each spring, and the logs have none of "
                f"{listed(joints)}: these springs are found by a refinement that simulates the "
                f"motors, whatever the first estimate is; remove {refused}, or log the joint "
                "position",
                refused,
            )


@dataclass(frozen=True, eq=False)
class _Run:
    """Logs as they were reconstructed.

    `logs` are those in memory; `moved` the motions of each log; `locked` the joints whose outputs
    are; `standing` {joint: position} those that stand still; `moving` those whose torques show the
    set-up, which are those of `experiment`.
    """

    sources: list[Source]
    logs: list[Log]
    datasets: list[Dataset]
    moved: list[list[Motion]]
    locked: Sequence[str]
    standing: Mapping[str, float]
    moving: set[str]
    experiment: Experiment

    def setup_findings(
        self, channels: Sequence[Finding], robot: Robot | None = None
    ) -> list[Finding]:
        """Return findings of channels, and the mistakes of the set-up, or of that of a robot."""
        experiment = self.experiment if robot is None else experiment_of(robot, self.moved)
        return findings_of_setup(experiment, self.moving, channels, self.logs)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The equations of a robot for the `used` joints with a torque, and their estimates.

    The robot is `declared` without joints that stand still; `nominal` is before a search. The
    datasets are those of the run without a `bias` of sensors.
    """

    run: _Run
    options: _Options
    declared: Robot
    nominal: Robot
    robot: Robot
    used: tuple[str, ...]
    datasets: list[Dataset]
    bias: SensorBias | None = None

    @cached_property
    def model(self) -> LoadModel:
        """The columns of the load side."""
        return load_model_of(self.robot, list(map(first_motion, self.datasets)), self.used)

    @cached_property
    def two_step(self) -> RobotEstimate:
        """The estimate of both sides in turn."""
        further = None if self.bias is None else (self.bias.columns, self.bias.covariance)
        options = self.options.of_two_steps
        return estimate_two_step(self.robot, self.datasets, self.model, *options, further=further)

    @property
    def identified(self) -> Robot:
        """The robot with the values of two steps."""
        return identified_robot(self.robot, self.model.base, self.two_step)

    @cached_property
    def estimate(self) -> RobotEstimate:
        """The estimate by the method of the options, which continues from two steps."""
        equations = self.robot, self.datasets, self.model, self.two_step
        solver, offset_std, executor, _ = self.options.of_two_steps
        if self.options.estimator == "iv":
            return estimate_instrumental(*equations, offset_std, executor)
        both = partial(estimate_simultaneous, *equations, solver, offset_std, executor)
        if self.options.method == "simultaneous":
            return both()
        if self.options.method == "two-step":
            return self.two_step
        doubtful = [key for side in self.lacking for key in side.doubtful]
        lacking = sorted({(check.code.name, joint) for check, joint in doubtful})
        return estimate_supported(self.robot, self.datasets, self.two_step, lacking, both)

    @cached_property
    def lacking(self) -> list[SideSelection]:
        """What the equations of two steps lack, nothing of logs that are not in memory."""
        motions = [dataset for dataset in self.datasets if isinstance(dataset, Motion)]
        motions = motions if len(motions) == len(self.datasets) else []
        widths = resolved_widths(self.robot, self.run.logs, motions)
        fits = self.two_step.actuators, self.two_step.fit
        known = self.model.base, self.options.encoder_offset_std
        gears = deflection_joints(self.robot, motions)
        return selections(model_sides(self.robot, motions, fits, widths, gears, *known))

    @property
    def experiment(self) -> Experiment:
        """The motions of the run without the errors of the sensors."""
        if self.bias is None:
            return self.run.experiment
        return experiment_of(self.declared, [self.bias.removed(group) for group in self.run.moved])


def _identify(robot: Robot, logs: Source | Sequence[Source], options: _Options) -> Identification:
    """Return the result of `identify` with delays of commands linearised at those of the drives."""
    options.check()
    selected = robot.selected(options.torque_joints)  # refuses unknown joints before a log is read
    sources = [
        with_commanded_torque(robot, source) if isinstance(source, Log) else source
        for source in sources_of(logs)
    ]
    in_memory = [source for source in sources if isinstance(source, Log)]
    findings = log_findings(robot, in_memory, selected)
    unseen = without_joint_encoder(robot, in_memory) if len(in_memory) == len(sources) else ()
    if unseen:
        with explained(findings):
            motors = _from_motors(robot, in_memory, unseen, options)
        return consistent_bodies(motors) if options.feasible else motors
    with explained(findings):
        run = _reconstructed(robot, sources, options, selected)
        findings += base_findings(robot, run.logs, run.moved)
        channels = tuple(findings)
        findings[:] = run.setup_findings(channels)  # the list that `explained` has
        mistakes = [finding for finding in findings if finding not in channels]
        problem = _solved(_assembled(robot, run, options, selected, findings), findings)
    shown_by = partial(run.setup_findings, channels)
    declared, lacking = problem.declared, problem.lacking
    findings = without_setup_echoes(findings, mistakes, lacking, declared, shown_by)
    return _concluded(problem, findings)


def _reconstructed(
    robot: Robot, sources: list[Source], options: _Options, selected: Sequence[str]
) -> _Run:
    """Return the motions of logs whose channels are alive, and what stands still in them."""
    logs = [source for source in sources if isinstance(source, Log)]
    groups = datasets_by_log(robot, sources, options.cutoff_hz, options.executor, options.progress)
    locked = locked_outputs(robot, logs)
    moved = [list(map(first_motion, group)) for group in groups]
    standing = dict[str, float]()
    if len(logs) == len(sources):
        parts = [part for log in logs for part in stretches(log)]
        standing = standing_joints(robot, parts, list(chain(*moved)))
    check_channels(logs, locked)
    datasets = list(chain(*groups))
    check_temperatures(robot, datasets)
    moving = {*selected, *robot.elastic_joints} - {*standing}
    experiment = with_torques_of(experiment_of(robot, moved), moving)
    return _Run(sources, logs, datasets, moved, locked, standing, moving, experiment)


def _assembled(
    robot: Robot, run: _Run, options: _Options, selected: Sequence[str], findings: list[Finding]
) -> _Problem:
    """Return the equations of what moves and has a torque, and append what has not."""
    datasets = run.datasets
    used = joints_with_torque(robot, datasets) if options.torque_joints is None else selected
    findings += missing_torques(robot, selected, used)
    check_forces(datasets, used)
    check_scale_of_locked(robot, datasets, run.locked)
    declared, used = without_locked_loads(robot, used, run.locked)
    robot, used, stopped = without_standing(declared, used, run.standing)
    findings += consequences(findings, standstill_findings(stopped, run.standing))
    robot = nominal = with_rigid_gears(robot, deflection_joints(robot, datasets))
    if not is_linear(robot, used):
        robot, datasets = linearised_robot(robot, datasets, used)
    return _Problem(run, options, declared, nominal, robot, used, datasets)


def _solved(problem: _Problem, findings: list[Finding]) -> _Problem:
    """Return the problem with what its first estimates show, and append that.

    Those are the reversals that friction lets pass, the errors of sensors of a floating base, and
    the terms of drives whose friction nobody named.
    """
    if problem.robot.has_controllers:
        passed = with_passed_reversals(problem.robot, problem.datasets, problem.identified)
        # A new problem, whose cached estimates are computed again from these datasets.
        problem = replace(problem, datasets=passed)
    if problem.robot.floating_base is not None:
        datasets, fit = problem.datasets, problem.two_step.fit
        bias = sensor_bias(problem.identified, datasets, problem.model, fit)
        if bias is not None:
            findings += sensor_errors(bias.places, bias.value, bias.errors, bias.hidden, bias.imu)
            problem = replace(problem, datasets=[*bias.removed(datasets)], bias=bias)
    for _ in range(MOST_ROUNDS):
        robot, nominal, notes = with_default_terms(problem.robot, problem.nominal, problem.lacking)
        if not notes:
            break
        findings += notes
        problem = replace(problem, robot=robot, nominal=nominal)
    return problem


def _concluded(problem: _Problem, findings: list[Finding]) -> Identification:
    """Return the identification by the method of a problem, with what it shows by its values."""
    robot, options, datasets = problem.robot, problem.options, problem.datasets
    model, estimate = problem.model, problem.estimate
    values = value_findings(estimate, problem.nominal, robot)
    weak = {finding.joint for finding in values if finding.code == "weak-spring"}
    values, lacking = without_echoes(values, problem.lacking, datasets[0].cutoff_hz)
    findings += consequences(findings, model_findings(lacking, findings))
    if not is_wrong(findings):
        steps = problem.two_step
        findings += sensitivity_findings(robot, datasets, model, steps, options.estimator)
    # Only now, since the findings above compare estimates by the noise of the logs alone.
    constants = options.known_std, options.executor
    estimate = with_known_std(robot, datasets, model, estimate, *constants)
    searched = with_searched_values(estimate.drives, problem.nominal, robot)
    estimate = replace(estimate, drives=searched)
    consistent = _feasible(robot, model, estimate) if options.feasible else None
    result = identification_of(robot, model, estimate, datasets, consistent, problem.declared)
    values += [*estimate.findings, *result.findings]
    return with_value_findings(_with_fit(problem, result, weak, findings), values)


def _with_fit(
    problem: _Problem, result: Identification, weak: set[str], findings: list[Finding]
) -> Identification:
    """Return a result with how well it explains the experiment, and the findings about that.

    The springs of `weak` joints look so, and may have backlash.
    """
    robot, run, experiment = problem.robot, problem.run, problem.experiment
    # Rows of both sides at once have no torque of a spring as a target, of which errors are a part.
    fit, actuators = problem.two_step.fit, problem.two_step.actuators
    bodies = result.robot.parameters + robot.payload_parameters
    shown = robot.joint_names, fit, actuators, experiment, bodies
    numbers = chain(*([number] * len(group) for number, group in enumerate(run.moved, 1)))
    logs = dict(enumerate(numbers))
    explains = robot_fit(*shown, locked=run.locked, weak=weak, logs=logs)
    predicted = prediction_errors(experiment, problem.model.base, result.load)
    explains = replace(explains, predicted=predicted)
    findings += consequences(findings, fit_findings(explains))
    drives = [joint for joint in result.drives if joint in weak]
    backlash = backlash_findings(problem.nominal, run.sources, drives, problem.used)
    findings += consequences(findings, backlash)
    exact = exact_constants(robot, problem.options.known_std)
    findings += scale_of_bodies(scaled_by_bodies(result.drives, exact))
    legged = legged_fit(result, problem.datasets, fit, problem.bias)
    findings += consequences(findings, [] if legged is None else observed(FEET_CHECKS, legged))
    findings += mass_findings(problem.declared, result.motions, *whole_mass(result))
    return replace(
        result,
        findings=tuple(findings),
        joint_fits=explains.joints,
        residual=explains.residual,
        exact_constants=exact,
        known_std=FrozenMapping(dict(problem.options.known_std)),
        setup=joint_checks(experiment, list(map(first_motion, problem.datasets))),
        nominal=problem.nominal,
    )


def value_findings(
    sides: RobotEstimate,
    nominal: Robot,
    robot: Robot,
    qr_factors: Mapping[str, QRFactor] | None = None,
) -> list[Finding]:
    """Return what the values of both sides show, and what the errors of their rows do.

    `nominal` is the robot before a search. `qr_factors` {joint: that of its motor equation}, by
    default those of the fits.
    """
    fits = {joint: side.qr_factor for joint, side in sides.actuators.items()}
    findings: list[Finding] = []
    for joint, estimate in sides.drives.items():
        drive, before = robot.drives[joint], nominal.drives[joint].known
        findings += fixed_findings(joint, drive, [x for x in drive.known if x not in before])
        if joint in sides.actuators:
            findings += noise_findings(sides.actuators[joint].estimate)
        findings += drive_findings(joint, estimate, (qr_factors or fits).get(joint))
    return [*findings, *offset_findings(robot, sides.fit), *noise_findings(sides.load)]


def with_value_findings(result: Identification, values: Iterable[Finding]) -> Identification:
    """Return an identification with the findings of its values, bodies, gears and channels."""
    described = [processing.sources or {} for processing in result.processing] or [{}]
    findings = [
        *values,
        *(
            finding
            for gear in result.gears.values()
            if "gear_stiffness" in gear.names  # else the gear is rigid within the errors
            for finding in noise_findings(gear)
        ),
        *(() if result.feasible is None else result.feasible.warnings),
        *excluded_findings(result.processing),
        *unused_findings(result.known, result.drives, result.model.torque_joints, result.motions),
        *gear_findings(result.known, result.drive_side, result.gears, described),
    ]
    return replace(result, findings=(*result.findings, *consequences(result.findings, findings)))


_MOST_STEPS = 60
"""Steps of a refinement without joint encoders, three times as many as with them: at a spring that
the torque noise hides, a step goes only part of the way."""


_LOWER = (1.0, 0.5, 0.25)
"""Parts of the proposed cutoff that are tried in turn without joint encoders. That of a motion far
above the antiresonance lets in derivatives of noise, which hide where a search has to start."""


def _from_motors(
    robot: Robot, logs: list[Log], joints: Sequence[str], options: _Options
) -> Identification:
    """Return the identification of logs without a sensor behind the springs of some joints.

    Where the fit does not end below the proposed cutoff, lower ones are tried. Raises the error of
    the proposed one if none of them shows the springs: a fit of noise may end there too.
    """
    check_refinable(robot, joints)
    options.check_without_encoders(joints)
    fit = partial(
        identify,
        robot,
        torque_joints=options.torque_joints,
        method="two-step",  # the simulated angles of the joints come from the springs
        estimator=options.estimator,
        encoder_offset_std=options.encoder_offset_std,
        known_std=options.known_std,
        executor=options.executor,
    )
    proposed_hz, problem = cutoff_of(robot, logs, joints, options.cutoff_hz), None
    for part in _LOWER if options.cutoff_hz is None else (1.0,):
        try:
            cutoff_hz = part * proposed_hz
            second = fit(_simulated(robot, logs, joints, cutoff_hz, fit), cutoff_hz=cutoff_hz)
            result = _refined_from_motors(second, logs, joints, options.encoder_offset_std)
            if problem is None or not any(finding.code == _HIDDEN for finding in result.findings):
                return result
        except (IdentificationError, ExcitationError, LogError) as reason:
            problem = problem or reason
    assert problem is not None
    raise problem


_HIDDEN = "hidden-resonance"


def _simulated(
    robot: Robot,
    logs: list[Log],
    joints: Sequence[str],
    cutoff_hz: float,
    fit: Callable[..., Identification],
) -> list[Log]:
    """Return the logs with the angles of joints as the best of the first estimates simulates them.

    A search of the stiffness gives the angles for a first regression, and its refinement these, for
    a second, from which the terms of the drives and all findings come.
    """
    problem = None
    tried: list[FirstEstimate] = []
    for initial in starts_by_regression(robot, logs, joints, cutoff_hz):
        for consistent in (False, True):  # an inertia as estimated may not be one to simulate
            try:
                start = fit(initial, cutoff_hz=cutoff_hz, feasible=consistent)
                tried.append(first_estimate(start, logs))
                break
            except (IdentificationError, ExcitationError, LogError) as reason:
                problem = problem or reason
        if tried and tried[-1].is_at_noise:
            break
    if not tried and problem is not None:
        raise problem
    return min(tried, key=lambda estimate: estimate.merit).logs


def _refined_from_motors(
    second: Identification, logs: list[Log], joints: Sequence[str], encoder_offset_std: float
) -> Identification:
    """Return the refinement of a second regression, with what hides the springs of joints."""
    try:
        refined, _ = refined_with_logs(second, logs, encoder_offset_std, _MOST_STEPS)
    except IdentificationError as reason:
        raise IdentificationError(
            f"the motor alone does not determine the stiffness of {', '.join(joints)} "
            f"({str(reason).split(';')[0]}). "
            f"Either the motion, with a band of {second.cutoff_hz:.3g} Hz, stays too far below the "
            "antiresonance of the load for the motor to feel the spring, or the load has a spring "
            "of its own: record a multisine with a larger band (seaid excite --basis multisine), "
            "or log the joint position"
        ) from None
    rate_hz = min((len(log.time) - 1) / float(log.time[-1] - log.time[0]) for log in logs)
    findings = (*refined.findings, *shown_springs(refined, joints, rate_hz))
    return replace(refined, findings=findings)


def identification_of(
    robot: Robot,
    model: LoadModel,
    sides: RobotEstimate,
    datasets: Sequence[Dataset],
    feasible: FeasibleParameters | None = None,
    declared: Robot | None = None,
) -> Identification:
    """Return the estimates of both sides as an Identification of the robot.

    `declared` has the gears as given where the deflection of the spring was measured.
    """
    sprung = gear_estimates(robot, datasets, sides.drives, estimator_named("wls"))
    gears = {joint: gear for joint, (gear, _) in sprung.items()}
    identified = identified_robot(robot, model.base, sides) if feasible is None else feasible.robot
    return Identification(
        drive_side=FrozenMapping(sides.drives),
        load=sides.load,
        base=model.base,
        robot=with_gears(identified, declared or robot, gears),
        known=robot,
        model=model,
        load_side=sides.load_side,
        springs=FrozenMapping(sides.springs),
        cutoff_hz=datasets[0].cutoff_hz,
        excluded=FrozenMapping(sides.excluded),
        checks=FrozenMapping(sides.checks),
        feasible=feasible,
        gears=FrozenMapping(gears),
        processing=processing_of(datasets),
        motions=tuple(dataset for dataset in datasets if isinstance(dataset, Motion)),
        findings=tuple(rigid_gear(joint, x) for joint, (_, x) in sprung.items() if x is not None),
        not_shared=sides.not_shared,
    )


def _feasible(robot: Robot, model: LoadModel, estimate: RobotEstimate) -> FeasibleParameters:
    """Return the physically consistent parameters nearest to the estimate of both sides."""
    white = estimate.fit.white_covariance
    if estimate.whole is not None:
        side, white = with_fixed_delays(robot.drives, estimate.whole, white)
        return feasible_parameters(robot, model, side, white_covariance=white)
    columns = len(estimate.load_side.names)  # without those of torque offsets
    elastic = _elastic_drives(robot, estimate.load_side, estimate.drives)
    side, white = with_fixed_delays(robot.drives, estimate.load_side, white[:columns, :columns])
    return feasible_parameters(robot, model, side, elastic, white_covariance=white)


def _elastic_drives(
    robot: Robot, load_side: Estimate, drives: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the estimates of elastic drives, without what the load side contains."""
    elastic = {}
    for joint in robot.elastic_joints:
        drive = drives[joint]
        names = enumerate(drive.names)
        kept = [i for i, name in names if f"{name} of {joint}" not in load_side.names]
        kept = [i for i in kept if drive.covariance[i, i] > 0]  # not what is zero by definition
        part = drive.part(kept, [drive.names[i] for i in kept])
        elastic[joint] = with_fixed_delays(robot.drives, part, part.covariance, joint)[0]
    return elastic


def consistent_bodies(result: Identification) -> Identification:
    """Return an identification with the physically consistent bodies nearest to it."""
    drives = _elastic_drives(result.known, result.load_side, result.drive_side)
    nearest = feasible_parameters(result.known, result.model, result.load_side, drives)
    findings = (*result.findings, *consequences(result.findings, nearest.warnings))
    return replace(result, feasible=nearest, robot=nearest.robot, findings=findings)


def identified_robot(robot: Robot, base: BaseParameters, sides: RobotEstimate) -> Robot:
    """Return the robot with the identified values, its standard parameters nearest to the file's.

    Nearest in the Euclidean norm, from 1 kg per body if the robot has no masses: they have the
    estimated base parameters but need not be physically consistent. A body without mass cannot have
    first moments in Pinocchio: where it gets some, it starts from 1 kg too.
    """
    prior = robot.parameters.copy()
    prior[::10][np.isnan(prior[::10])] = 1.0
    prior = np.nan_to_num(prior)
    correction = base.least(sides.load.values - base.project(prior))
    bodies = np.abs((prior + correction).reshape(-1, 10))
    # A body with mass m, first moment h and inertia I has |h| / m and sqrt(I / m) of its size: far
    # beyond `_FAR_M` it has no mass but rounding, from which Pinocchio cannot make a body.
    least_kg = np.maximum(np.max(bodies[:, 1:4], axis=1) / _FAR_M, bodies[:, 4:].max(1) / _FAR_M**2)
    if np.any(bodies[:, 0] < least_kg):
        prior[::10][prior[::10] == 0] = 1.0
        correction = base.least(sides.load.values - base.project(prior))
    drives = sides.drives
    identified = {
        joint: with_estimate(drive, drives[joint]) if joint in drives else drive
        for joint, drive in robot.drives.items()
    }
    return robot.with_values(prior + correction, identified)
