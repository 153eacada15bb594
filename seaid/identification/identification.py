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
    JointFit,
    Side,
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
from seaid.identification.drive_estimates import (
    negative_inertias,
    with_estimate,
)
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
    constants_of,
    exact_constants,
    scaled_by_bodies,
    sensitivity_findings,
    with_known_std,
)
from seaid.identification.simulated_joints import check_refinable, with_passed_reversals
from seaid.identification.simultaneous import estimate_simultaneous
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
from seaid.regressor import (
    BaseParameters,
    LoadModel,
    check_offset_std,
    is_linear,
    load_model_of,
)
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification.validation import Validation


Method = Literal["two-step", "simultaneous"]

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
    setup : mapping {joint: JointCheck}
        What the logs say of the set-up: gear ratios between encoders, delays of torques.
    nominal : Robot or None
        `known` without the values of the search: the nominal ones of the input robot only.
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
    setup: Mapping[str, JointCheck] = field(default_factory=dict)
    nominal: Robot | None = None

    def _in_short(self) -> str:
        drives = counted(len(self.drives), "drive")
        warnings = counted(len(self.warnings), "warning")
        sizes = f"{drives}, {counted(len(self.load.names), 'base parameter')}"
        return f"'{self.robot.name}': {sizes}, cutoff {self.cutoff_hz:.3g} Hz, {warnings}"

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
    method: Method = "two-step",
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
    parameters from the load side (8), with the uncertainty of the springs propagated.

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
    method : {"two-step", "simultaneous"}
        "simultaneous" continues from two steps to (7) and (8) in one regression that shares the
        springs.
    estimator : {"wls", "ols", "huber", "tukey", "iv"}
        Least squares weighted per joint or ordinary, robust estimators, or instrumental variables
        from the fitted model against the bias by noise in the regressor (two-step only).
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
    once = partial(
        _identify,
        logs=logs,
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
    result, fixed, unscaled = with_unit_scales({"": robot}, lambda robots: once(robots[""]))
    robot, nominal = fixed[""], result.nominal
    for _ in range(MOST_DELAY_ROUNDS):
        later = with_estimated_delays(robot, result.robot)
        if later is robot:
            break
        robot, result = later, once(later)
    unclear = (
        *delay_estimate_findings(robot, result.load_side),
        *unknown_scales(result.robot, result.load_side, unscaled),
    )
    scaled = with_free_scale(result.robot, unscaled)
    return replace(result, robot=scaled, nominal=nominal, findings=(*result.findings, *unclear))


def _identify(
    robot: Robot,
    *,
    logs: Source | Sequence[Source],
    torque_joints: str | Sequence[str] | None,
    method: Method,
    estimator: EstimatorName,
    feasible: bool,
    cutoff_hz: float | None,
    encoder_offset_std: float,
    known_std: Mapping[str, float],
    executor: Executor | None,
    progress: bool,
) -> Identification:
    """Return the result of `identify` with delays of commands linearised at those of the drives."""
    if estimator == "iv" and method != "two-step":
        raise IdentificationError(
            f'estimator="iv" needs method="two-step", found "{method}"',
            'estimator="iv"',
            'method="two-step"',
        )
    check_offset_std(encoder_offset_std)
    check_known_std(known_std)
    selected = robot.selected(torque_joints)  # refuses unknown joints before a log is read
    solver = estimator_named("wls" if estimator == "iv" else estimator)
    sources = [
        with_commanded_torque(robot, source) if isinstance(source, Log) else source
        for source in sources_of(logs)
    ]
    logs_in_memory = [source for source in sources if isinstance(source, Log)]
    findings = log_findings(robot, logs_in_memory, selected)
    unseen = without_joint_encoder(robot, logs_in_memory) if logs_in_memory else ()
    if unseen and len(logs_in_memory) == len(sources):
        fit = partial(
            identify,
            robot,
            torque_joints=torque_joints,
            estimator="wls" if estimator == "iv" else estimator,
            encoder_offset_std=encoder_offset_std,
            known_std=known_std,
            executor=executor,
        )
        with explained(findings):
            motors = _from_motors(robot, logs_in_memory, unseen, cutoff_hz, fit, encoder_offset_std)
        return consistent_bodies(motors) if feasible else motors
    with explained(findings):
        groups = datasets_by_log(robot, sources, cutoff_hz, executor, progress)
        datasets = [dataset for group in groups for dataset in group]
        in_memory = [part for log in logs_in_memory for part in stretches(log)]
        locked = locked_outputs(robot, logs_in_memory)
        moved = [list(map(first_motion, group)) for group in groups]
        standing = dict[str, float]()
        if len(logs_in_memory) == len(sources):
            standing = standing_joints(robot, in_memory, list(chain(*moved)))
        check_channels(logs_in_memory, locked)
        check_temperatures(robot, datasets)
        moving = {*selected, *robot.elastic_joints} - {*standing}
        experiment = with_torques_of(experiment_of(robot, moved), moving)
        findings += base_findings(robot, logs_in_memory, moved)
        channels = tuple(findings)
        # the list that `explained` has
        findings[:] = findings_of_setup(experiment, moving, channels, logs_in_memory)
        setup_mistakes = [finding for finding in findings if finding not in channels]
        used = joints_with_torque(robot, datasets) if torque_joints is None else selected
        findings += missing_torques(robot, selected, used)
        check_forces(datasets, used)
        check_scale_of_locked(robot, datasets, locked)
        robot, used = without_locked_loads(robot, used, locked)
        declared = robot
        robot, used, stopped = without_standing(robot, used, standing)
        findings += consequences(findings, standstill_findings(stopped, standing))
        robot = with_rigid_gears(robot, deflection_joints(robot, datasets))
        nominal = robot
        if not is_linear(robot, used):
            robot, datasets = linearised_robot(robot, datasets, used)
        options = solver, encoder_offset_std, executor, progress
        datasets, model, estimate = _first_two_step(robot, datasets, used, options)
        bias = _sensor_bias(robot, datasets, model, estimate)
        if bias is not None:
            findings += sensor_errors(bias.places, bias.value, bias.errors, bias.hidden, bias.imu)
            datasets = [*bias.removed(datasets)]
            experiment = experiment_of(declared, [bias.removed(group) for group in moved])
            model, estimate = _two_step(robot, datasets, used, options, bias)
        whole = [dataset for dataset in datasets if isinstance(dataset, Motion)]
        whole = whole if len(whole) == len(datasets) else []
        widths = resolved_widths(robot, logs_in_memory, whole)
        lacking = selections(_sides(robot, whole, model, estimate, widths, encoder_offset_std))
        for _ in range(MOST_ROUNDS):
            robot, nominal, notes = with_default_terms(robot, nominal, lacking)
            if not notes:
                break
            findings += notes
            model, estimate = _two_step(robot, datasets, used, options, bias)
            lacking = selections(_sides(robot, whole, model, estimate, widths, encoder_offset_std))
    shown_by = partial(_findings_of_setup, moved, moving, channels, logs_in_memory)
    findings = without_setup_echoes(findings, setup_mistakes, lacking, declared, shown_by)
    estimate = _continued(robot, datasets, model, estimate, (method, estimator), options)

    def again(robot: Robot, datasets: Sequence[Dataset]) -> RobotEstimate:
        estimate = estimate_two_step(robot, datasets, model, *options, further=_further(bias))
        return _continued(robot, datasets, model, estimate, (method, estimator), options)

    values = value_findings(estimate, nominal, robot)
    weak = {finding.joint for finding in values if finding.code == "weak-spring"}
    values, lacking = without_echoes(values, lacking, datasets[0].cutoff_hz)
    findings += consequences(findings, model_findings(lacking, findings))
    if not is_wrong(findings):
        findings += sensitivity_findings(robot, datasets, model, estimate, estimator)
    estimate = with_known_std(estimate, constants_of(robot, datasets, known_std), again)
    estimate = replace(estimate, drives=with_searched_values(estimate.drives, nominal, robot))
    consistent = _feasible(robot, model, estimate) if feasible else None
    result = identification_of(robot, model, estimate, datasets, consistent, declared)
    bodies = result.robot.parameters + robot.payload_parameters
    sides = estimate.fit, estimate.actuators
    explains = robot_fit(robot.joint_names, *sides, experiment, bodies, locked=locked, weak=weak)
    explains = replace(explains, predicted=prediction_errors(experiment, model.base, result.load))
    findings += consequences(findings, fit_findings(explains))
    weak_drives = [joint for joint in result.drives if joint in weak]
    findings += consequences(findings, backlash_findings(nominal, sources, weak_drives, used))
    exact = exact_constants(robot, known_std)
    findings += scale_of_bodies(scaled_by_bodies(result.drives, exact))
    setup = joint_checks(experiment, [first_motion(dataset) for dataset in datasets])
    legged = legged_fit(result, datasets, estimate.fit, bias)
    findings += consequences(findings, [] if legged is None else observed(FEET_CHECKS, legged))
    findings += mass_findings(declared, result.motions, *whole_mass(result))
    values += [*estimate.findings, *result.findings]
    result = replace(
        result,
        findings=tuple(findings),
        joint_fits=explains.joints,
        residual=explains.residual,
        exact_constants=exact,
        setup=setup,
        nominal=nominal,
    )
    return with_value_findings(result, values)


def _findings_of_setup(
    moved: Sequence[Sequence[Motion]],
    moving: set[str],
    channels: Sequence[Finding],
    logs: Sequence[Log],
    robot: Robot,
) -> list[Finding]:
    """Return the findings of channels, and the mistakes of the set-up of a robot by its motions."""
    return findings_of_setup(experiment_of(robot, moved), moving, channels, logs)


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


def _sides(
    robot: Robot,
    motions: Sequence[Motion],
    model: LoadModel,
    estimate: RobotEstimate,
    widths: Mapping[str, float],
    offset_std: float,
) -> list[Side]:
    """Return the equations of an estimate that are checked, none of logs that are not in memory."""
    gears, fits = deflection_joints(robot, motions), (estimate.actuators, estimate.fit)
    return model_sides(robot, motions, fits, widths, gears, model.base, offset_std)


_MOST_STEPS = 60
"""Steps of a refinement without joint encoders, three times as many as with them: at a spring that
the torque noise hides, a step goes only part of the way."""


_LOWER = (1.0, 0.5, 0.25)
"""Parts of the proposed cutoff that are tried in turn without joint encoders. That of a motion far
above the antiresonance lets in derivatives of noise, which hide where a search has to start."""


def _from_motors(
    robot: Robot,
    logs: list[Log],
    joints: Sequence[str],
    cutoff_hz: float | None,
    fit: Callable[..., Identification],
    encoder_offset_std: float,
) -> Identification:
    """Return the identification of logs without a sensor behind the springs of some joints.

    Where the fit does not end below the proposed cutoff, lower ones are tried. Raises the error of
    the proposed one if none of them shows the springs: a fit of noise may end there too.
    """
    check_refinable(robot, joints)
    proposed_hz, problem = cutoff_of(robot, logs, joints, cutoff_hz), None
    for part in _LOWER if cutoff_hz is None else (1.0,):
        try:
            result = _from_motors_below(
                robot, logs, joints, part * proposed_hz, fit, encoder_offset_std
            )
            if problem is None or not any(finding.code == _HIDDEN for finding in result.findings):
                return result
        except (IdentificationError, ExcitationError, LogError) as reason:
            problem = problem or reason
    assert problem is not None
    raise problem


_HIDDEN = "hidden-resonance"


def _from_motors_below(
    robot: Robot,
    logs: list[Log],
    joints: Sequence[str],
    cutoff_hz: float,
    fit: Callable[..., Identification],
    encoder_offset_std: float,
) -> Identification:
    """Return the identification below a cutoff.

    A search of the stiffness gives the joints' angles for a first regression, and its refinement
    the simulated ones for a second, from which the terms of the drives and all findings come.
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
    simulated = min(tried, key=lambda estimate: estimate.merit).logs
    second = fit(simulated, cutoff_hz=cutoff_hz)
    try:
        refined, _ = refined_with_logs(second, logs, encoder_offset_std, _MOST_STEPS)
    except IdentificationError as reason:
        raise IdentificationError(
            f"the motor alone does not determine the stiffness of {', '.join(joints)} "
            f"({str(reason).split(';')[0]}). "
            f"Either the motion, with a band of {cutoff_hz:.3g} Hz, stays too far below the "
            "antiresonance of the load for the motor to feel the spring, or the load has a spring "
            "of its own: record a multisine with a larger band (seaid excite --basis multisine), "
            "or log the joint position"
        ) from None
    rate_hz = min((len(log.time) - 1) / float(log.time[-1] - log.time[0]) for log in logs)
    findings = (*refined.findings, *shown_springs(refined, joints, rate_hz))
    return replace(refined, findings=findings)


def _two_step(
    robot: Robot,
    datasets: Sequence[Dataset],
    used: Sequence[str],
    options: tuple[Estimator, float, Executor | None, bool],
    bias: SensorBias | None = None,
) -> tuple[LoadModel, RobotEstimate]:
    """Return the columns of the load side and the estimate of both sides in turn."""
    model = load_model_of(robot, list(map(first_motion, datasets)), used)
    return model, estimate_two_step(robot, datasets, model, *options, further=_further(bias))


def _first_two_step(
    robot: Robot,
    datasets: Sequence[Dataset],
    used: Sequence[str],
    options: tuple[Estimator, float, Executor | None, bool],
) -> tuple[list[Dataset], LoadModel, RobotEstimate]:
    """Return `_two_step`, and the datasets with the reversals that its friction lets pass."""
    model, estimate = _two_step(robot, datasets, used, options)
    if not robot.has_controllers:
        return list(datasets), model, estimate
    known = with_passed_reversals(robot, datasets, identified_robot(robot, model.base, estimate))
    return known, *_two_step(robot, known, used, options)


def _sensor_bias(
    robot: Robot, datasets: Sequence[Dataset], model: LoadModel, estimate: RobotEstimate
) -> SensorBias | None:
    """Return the errors of the sensors of a floating base, next to the estimated bodies."""
    if robot.floating_base is None:
        return None
    bodies = identified_robot(robot, model.base, estimate)
    return sensor_bias(bodies, datasets, model, estimate.fit)


def _further(bias: SensorBias | None) -> tuple[Array, Array] | None:
    """Return the columns of a bias that was removed, and its covariance."""
    return None if bias is None else (bias.columns, bias.covariance)


def _continued(
    robot: Robot,
    datasets: Sequence[Dataset],
    model: LoadModel,
    estimate: RobotEstimate,
    way: tuple[Method, EstimatorName],
    options: tuple[Estimator, float, Executor | None, bool],
) -> RobotEstimate:
    """Return the estimate of two steps, or by instruments or both sides at once from there."""
    solver, encoder_offset_std, executor, _ = options
    if way[1] == "iv":
        return estimate_instrumental(robot, datasets, model, estimate, encoder_offset_std, executor)
    if way[0] == "simultaneous":
        return estimate_simultaneous(
            robot, datasets, model, estimate, solver, encoder_offset_std, executor
        )
    return estimate


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
