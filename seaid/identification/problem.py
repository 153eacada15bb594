"""From logs to an identification, of one condition or of several together.

`solved` reconstructs the motions of the logs, assembles the equations of what moves and has a
torque, and fits them until the robot about which they are linear stays the same. `concluded` makes
the identification of a condition of the fits and of what the checks find.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, Literal

import numpy as np

from seaid._arrays import BoolArray, FrozenMapping
from seaid.checks import CODES
from seaid.checks.channels import locked_outputs, standstill_findings
from seaid.checks.codes import consequences, guarded, is_wrong
from seaid.checks.columns import resolved_widths
from seaid.checks.commands import delay_estimate_findings
from seaid.checks.experiment import Experiment, experiment_of, with_torques_of
from seaid.checks.model import (
    SideSelection,
    model_findings,
    model_sides,
    selections,
    without_echoes,
    without_setup_echoes,
)
from seaid.checks.setup import joint_checks, log_findings
from seaid.checks.values import scale_of_bodies, shared_findings, unknown_scales
from seaid.checks.verdict import RobotFit, explained, fit_findings, robot_fit
from seaid.drives import Drive, ParameterName
from seaid.drives.drives import check_groups
from seaid.drives.terms import places_of
from seaid.errors import Finding, IdentificationError, unknown_name
from seaid.estimation import Estimator, estimator_named
from seaid.estimation.fitting import EstimatorName
from seaid.estimation.qr_factor import QRFactor, qr_factor_of
from seaid.identification.checking import (
    check_channels,
    findings_of_setup,
    standing_joints,
    without_locked_loads,
    without_standing,
)
from seaid.identification.datasets import (
    Dataset,
    Source,
    check_temperatures,
    datasets_by_log,
    first_motion,
)
from seaid.identification.drive_estimates import (
    MOST_DELAY_ROUNDS,
    UnknownScaleError,
    with_estimated_delays,
    with_free_scale,
    with_unit_scale,
)
from seaid.identification.gear import deflection_joints, with_rigid_gears
from seaid.identification.instrumental import estimate_instrumental
from seaid.identification.model_selection import MOST_ROUNDS, backlash_findings, with_default_terms
from seaid.identification.nonlinear_terms import linearised_robot, with_searched_values
from seaid.identification.result import (
    Identification,
    SensorErrors,
    consistent_bodies,
    extension_of,
    feasible_of,
    identification_of,
    identified_robot,
    value_findings,
    with_value_findings,
)
from seaid.identification.sensitivity import (
    TYPICAL_STD,
    Given,
    encoder_offsets,
    exact_constants,
    given_constants,
    scaled_by_bodies,
    sensitivity_findings,
)
from seaid.identification.simulated_joints import (
    AT_ONCE,
    BY_INSTRUMENTS,
    Limits,
    with_passed_reversals,
)
from seaid.identification.simultaneous import estimate_simultaneous, estimate_supported
from seaid.identification.stacked_fits import LOAD, RobotEstimate
from seaid.identification.two_step import (
    NOTHING_SPECIFIC,
    Condition,
    SpecificParameters,
    TwoStepFits,
    check_forces,
    check_scale_of_locked,
    estimate_two_step,
    joints_with_torque,
)
from seaid.log import Log, Motion
from seaid.log.commands import with_commanded_torque
from seaid.log.usable_parts import stretches
from seaid.regressor.load import check_offset_std, load_model_of
from seaid.regressor.regression import is_linear
from seaid.robot import Robot


def check_known_std(known_std: Mapping[str, float]) -> None:
    """Raise IdentificationError for an unknown name or a standard deviation outside [0, 1]."""
    for name, std in known_std.items():
        if name not in TYPICAL_STD:
            wrong = unknown_name("constant", name, TYPICAL_STD)
            raise IdentificationError(f"known_std=: {wrong}", "known_std=")
        if not 0 <= std <= 1:
            raise IdentificationError(
                f"known_std of '{name}' must be a relative standard deviation from 0 to 1, found "
                f"{std}",
                "known_std=",
            )


Method = Literal["auto", "two-step", "simultaneous"]
"""Values of `method=`."""


@dataclass(frozen=True, eq=False)
class Options:
    """The options of `identify`, and the parameters that conditions have for themselves."""

    torque_joints: str | Sequence[str] | None = None
    method: Method = "auto"
    estimator: EstimatorName = "wls"
    feasible: bool = False
    cutoff_hz: float | None = None
    encoder_offset_std: float = 0.0
    known_std: Mapping[str, float] = field(default_factory=dict)
    executor: Executor | None = None
    progress: bool = False
    specific: SpecificParameters = NOTHING_SPECIFIC

    def __post_init__(self) -> None:
        if self.estimator == "iv" and self.method == "simultaneous":
            raise IdentificationError(
                f'estimator="iv" needs method="two-step", found "{self.method}"',
                'estimator="iv"',
                'method="two-step"',
            )
        check_offset_std(self.encoder_offset_std)
        check_known_std(self.known_std)

    @property
    def limits(self) -> Limits | None:
        """The limits of a method that goes on from linear two steps, if it is asked for."""
        if self.estimator == "iv":
            return BY_INSTRUMENTS
        return AT_ONCE if self.method == "simultaneous" else None

    def check_shared(self, robot: Robot) -> None:
        """Raise an error for drives that cannot share, or do not by a method that was chosen."""
        check_groups(robot.drives, robot.name, is_whole=False)
        if self.limits is not None:
            self.limits.check_alone(robot)

    @property
    def linear_estimator(self) -> Estimator:
        """The estimator of two steps, from which instruments continue too."""
        return estimator_named("wls" if self.estimator == "iv" else self.estimator)


@dataclass(frozen=True, eq=False)
class Run:
    """The logs of one condition as they were reconstructed.

    `logs` are those in memory; `moved` the motions of each log; `locked` the joints whose outputs
    are; `standing` {joint: position} those that stand still; `moving` those whose torques show the
    set-up, which are those of `experiment`; `channels` what the channels of the logs show.
    """

    sources: list[Source]
    logs: list[Log]
    datasets: list[Dataset]
    moved: list[list[Motion]]
    locked: Sequence[str]
    standing: Mapping[str, float]
    moving: set[str]
    experiment: Experiment
    channels: tuple[Finding, ...]

    @cached_property
    def setup(self) -> list[Finding]:
        """What the channels show, and the mistakes of the set-up."""
        return self.setup_of(self.experiment)

    def setup_of(self, experiment: Experiment) -> list[Finding]:
        """Return what the channels show, and the mistakes of the set-up of an experiment."""
        return findings_of_setup(experiment, self.moving, self.channels, self.logs)


@dataclass(frozen=True, eq=False)
class Case:
    """The equations of the robot of one condition, for the `used` joints with a torque.

    The robot is `declared` without the drives {joint: drive} that are `stopped`; `nominal` is
    before a search. The datasets are those of the run without a `bias` of sensors.
    """

    run: Run
    declared: Robot
    nominal: Robot
    robot: Robot
    used: tuple[str, ...]
    stopped: Mapping[str, Drive]
    datasets: list[Dataset]
    bias: SensorErrors | None = None

    @cached_property
    def condition(self) -> Condition:
        """The robot, its datasets and the columns of its load side."""
        model = load_model_of(self.robot, list(map(first_motion, self.datasets)), self.used)
        return Condition(self.robot, self.datasets, model)

    @property
    def motions(self) -> list[Motion]:
        """The motions if all logs are in memory, else none."""
        motions = [dataset for dataset in self.datasets if isinstance(dataset, Motion)]
        return motions if len(motions) == len(self.datasets) else []

    @property
    def experiment(self) -> Experiment:
        """The motions of the run without the errors of the sensors."""
        if self.bias is None:
            return self.run.experiment
        return experiment_of(self.declared, [self.bias.removed(group) for group in self.run.moved])


@dataclass(frozen=True, eq=False)
class Problem:
    """The equations of all conditions, and their estimates.

    `notes` are on terms that were added to drives. `nominals` {condition: robot} have the nominal
    values only, where delays of commands were estimated since; `unscaled` are the joints whose
    gains are in units of the drive, so that parameters are known as ratios.
    """

    options: Options
    cases: Mapping[str, Case]
    notes: tuple[Finding, ...] = ()
    nominals: Mapping[str, Robot] = field(default_factory=dict)
    unscaled: tuple[str, ...] = ()

    @property
    def only(self) -> Case | None:
        """The case if it is the only one, None for several conditions."""
        return next(iter(self.cases.values())) if len(self.cases) == 1 else None

    @cached_property
    def fits(self) -> TwoStepFits:
        """The fits of both sides in turn, with the errors of encoder offsets."""
        bias, options = self.only.bias if self.only else None, self.options
        fits = estimate_two_step(
            self.conditions,
            options.linear_estimator,
            options.executor,
            options.progress,
            options.specific,
            further=None if bias is None else (bias.columns, bias.covariance),
        )
        if not self.offsets.common:
            return fits
        return replace(fits, known=self.offsets.known({name: fits.of(name) for name in self.cases}))

    @property
    def conditions(self) -> Mapping[str, Condition]:
        """The conditions by name."""
        return {name: case.condition for name, case in self.cases.items()}

    @cached_property
    def offsets(self) -> Given:
        """The encoders as given, and all else as exact."""
        std, options = self.options.encoder_offset_std, self.options
        constants = {name: encoder_offsets(case.robot, std) for name, case in self.cases.items()}
        return Given(self.conditions, constants, options.specific, options.executor)

    @cached_property
    def two_step(self) -> Mapping[str, RobotEstimate]:
        """The estimates of two steps by condition."""
        return {name: self.fits.of(name) for name in self.cases}

    def identified(self, name: str) -> Robot:
        """Return the robot of a condition with the values of two steps."""
        condition = self.cases[name].condition
        return identified_robot(condition.robot, condition.model.base, self.two_step[name])

    @cached_property
    def estimates(self) -> Mapping[str, RobotEstimate]:
        """The estimates by the method of the options, which continues from two steps."""
        if self.only is None:
            return self.two_step
        ((name, start),), options, case = self.two_step.items(), self.options, self.only
        equations = case.robot, case.datasets, case.condition.model, start

        def both() -> RobotEstimate:
            of_rows = options.linear_estimator, options.executor
            return self.offsets.included({name: estimate_simultaneous(*equations, *of_rows)})[name]

        if options.estimator == "iv":
            instrumental = estimate_instrumental(*equations, options.executor)
            return self.offsets.included({name: instrumental})
        if options.method == "simultaneous":
            return {name: both()}
        if options.method == "two-step":
            return self.two_step
        doubtful = [key for side in self.lacking for key in side.doubtful]
        lacking = sorted({(check.code.name, joint) for check, joint in doubtful})
        return {name: estimate_supported(case.robot, case.datasets, start, lacking, both)}

    @cached_property
    def with_errors_of_constants(self) -> Mapping[str, RobotEstimate]:
        """The estimates, with the errors of what was given as known."""
        of_drives = given_constants(self.conditions, self.options.known_std)
        constants = {name: [*x, *self.offsets.constants[name]] for name, x in of_drives.items()}
        if not any(of_drives.values()):
            return self.estimates
        return replace(self.offsets, constants=constants).included(self.estimates)

    @cached_property
    def lacking(self) -> list[SideSelection]:
        """What the equations of two steps of one condition lack, if its logs are in memory."""
        if self.only is None:
            return []
        (fit,), case = self.two_step.values(), self.only
        motions = case.motions
        widths = resolved_widths(case.robot, case.run.logs, motions)
        known = case.condition.model.base, self.options.encoder_offset_std
        gears = deflection_joints(case.robot, motions)
        fits = fit.actuators, fit.fit
        return selections(model_sides(case.robot, motions, fits, widths, gears, *known))


def solved(
    robots: Mapping[str, Robot], sources: Mapping[str, Sequence[Source]], options: Options
) -> Problem:
    """Return the fitted equations of {condition: robot}.

    The column of a delay is a derivative at the delay of the drive, and gains in units of the drive
    have the scale 1 where nothing determines it: fits are repeated about each new robot.
    """
    for robot in robots.values():
        options.check_shared(robot)
    unscaled: tuple[str, ...] = ()
    nominals: Mapping[str, Robot] = {}
    declared, rounds = dict(robots), MOST_DELAY_ROUNDS
    while True:
        runs = reconstructed(declared, sources, options)
        with explained(partial(_setups, runs)):
            try:
                start = replace(
                    assembled(declared, runs, options), nominals=nominals, unscaled=unscaled
                )
                problem = _with_first_estimates(start)
            except UnknownScaleError as reason:
                # Each round makes one more scale known, which then has no column.
                declared = {name: with_unit_scale(x, reason) for name, x in declared.items()}
                unscaled = (*unscaled, reason.joint)
                continue
            nominals = nominals or {name: case.nominal for name, case in problem.cases.items()}
            later = {
                name: with_estimated_delays(robot, problem.identified(name))
                for name, robot in declared.items()
                if rounds and robot.has_controllers
            }
        if all(robot is declared[name] for name, robot in later.items()):
            return problem
        declared, rounds = {**declared, **later}, rounds - 1


def _setups(runs: Mapping[str, Run]) -> list[Finding]:
    """Return what is wrong with the set-ups of all conditions."""
    return list(chain(*(run.setup for run in runs.values())))


def reconstructed(
    robots: Mapping[str, Robot], sources: Mapping[str, Sequence[Source]], options: Options
) -> dict[str, Run]:
    """Return the motions of the logs of each condition, with one cutoff."""
    read = partial(_reconstructed, robots, sources, options)
    runs = read(options.cutoff_hz)
    bands = {dataset.cutoff_hz for run in runs.values() for dataset in run.datasets}
    # One cutoff for all: a bias that depends on it would look like a difference of the conditions.
    return runs if len(bands) == 1 else read(min(bands))


def _reconstructed(
    robots: Mapping[str, Robot],
    sources: Mapping[str, Sequence[Source]],
    options: Options,
    cutoff_hz: float | None,
) -> dict[str, Run]:
    return {name: _run(robot, sources[name], options, cutoff_hz) for name, robot in robots.items()}


def _run(robot: Robot, sources: Sequence[Source], options: Options, cutoff_hz: float | None) -> Run:
    """Return the motions of logs whose channels are alive, and what stands still in them."""
    selected = robot.selected(options.torque_joints)
    read = [with_commanded_torque(robot, x) if isinstance(x, Log) else x for x in sources]
    logs = [source for source in read if isinstance(source, Log)]
    findings = log_findings(robot, logs, selected)
    with explained(partial(list, findings)):
        groups = datasets_by_log(robot, read, cutoff_hz, options.executor, options.progress)
        locked = locked_outputs(robot, logs)
        moved = [list(map(first_motion, group)) for group in groups]
        standing = dict[str, float]()
        if len(logs) == len(read):
            parts = [part for log in logs for part in stretches(log)]
            standing = standing_joints(robot, parts, list(chain(*moved)))
        check_channels(logs, locked)
        datasets = list(chain(*groups))
        check_temperatures(robot, datasets)
    moving = {*selected, *robot.elastic_joints} - {*standing}
    experiment = with_torques_of(experiment_of(robot, moved), moving)
    channels = (*findings, *extension_of(robot).log_findings(robot, logs, moved))
    return Run(read, logs, datasets, moved, locked, standing, moving, experiment, channels)


def assembled(robots: Mapping[str, Robot], runs: Mapping[str, Run], options: Options) -> Problem:
    """Return the equations of what moves in a condition and has a torque in all conditions."""
    first = next(iter(robots.values()))
    datasets = {name: run.datasets for name, run in runs.items()}
    used = _used(robots, datasets)
    if options.torque_joints is not None:
        used = first.selected(options.torque_joints)
    # A joint that one condition moves has its equation in all of them.
    standing = _common({name: tuple(run.standing) for name, run in runs.items()})
    springs = deflection_joints(first, list(chain(*datasets.values())))
    cases = {}
    for name, robot in robots.items():
        run = runs[name]
        check_forces(run.datasets, used)
        check_scale_of_locked(robot, run.datasets, run.locked)
        declared, kept = without_locked_loads(robot, used, run.locked)
        still = {joint: run.standing[joint] for joint in standing}
        moving, kept, stopped = without_standing(declared, kept, still)
        nominal = with_rigid_gears(moving, springs)
        cases[name] = Case(run, declared, nominal, nominal, kept, stopped, run.datasets)
    cases = _linearised(cases)
    _check_models({name: case.condition for name, case in cases.items()})
    return Problem(options, cases)


def _used(
    robots: Mapping[str, Robot], datasets: Mapping[str, Sequence[Dataset]]
) -> tuple[str, ...]:
    """Return the joints whose torque is measured in every condition."""
    return _common({name: joints_with_torque(x, datasets[name]) for name, x in robots.items()})


def _common(joints: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return what all conditions have, in the order of the first."""
    first, *others = joints.values()
    return tuple(joint for joint in first if all(joint in of_other for of_other in others))


def _linearised(cases: Mapping[str, Case]) -> dict[str, Case]:
    """Return cases with drives linearised near the values of the first condition."""
    straight, start = dict[str, Case](), None
    for name, case in cases.items():
        robot = case.robot
        if is_linear(robot, case.used):
            straight[name] = case
            continue
        if start is not None and robot.drives == start.nominal.drives:
            # A value is the only start of a search (`starts_of`): with those of the first condition
            # all searches end in the same local optimum.
            robot = robot.with_drives(start.robot.drives)
        robot, datasets = linearised_robot(robot, case.datasets, case.used)
        straight[name] = replace(case, robot=robot, datasets=datasets)
        start = start or straight[name]
    return straight


def _check_models(conditions: Mapping[str, Condition]) -> None:
    first, *others = conditions
    for name in others:
        if conditions[name].model.names != conditions[first].model.names:
            raise IdentificationError(
                f"conditions '{first}' and '{name}' do not have the same base parameters and "
                "drives: they must be one type of robot, with the same joints; payloads may differ"
            )


def _with_first_estimates(problem: Problem) -> Problem:
    """Return the problem with what its first estimates show.

    Those are the reversals that friction lets pass and, of one condition, the errors of sensors of
    a floating base and the terms of drives whose friction nobody named.
    """
    cases = {
        name: replace(
            case,
            datasets=with_passed_reversals(case.robot, case.datasets, problem.identified(name)),
        )
        for name, case in problem.cases.items()
        if case.robot.has_controllers
    }
    # A new problem, whose cached estimates are computed again from these datasets.
    problem = replace(problem, cases={**problem.cases, **cases}) if cases else problem
    case = problem.only
    if case is None:
        return problem
    bias = _sensor_errors(problem, case)
    if bias is not None:
        problem = _with_case(problem, datasets=[*bias.removed(case.datasets)], bias=bias)
    for _ in range(MOST_ROUNDS):
        case = problem.only
        assert case is not None
        robot, nominal, notes = with_default_terms(case.robot, case.nominal, problem.lacking)
        if not notes:
            break
        problem = _with_case(problem, robot=robot, nominal=nominal)
        problem = replace(problem, notes=(*problem.notes, *notes))
    return problem


def _sensor_errors(problem: Problem, case: Case) -> SensorErrors | None:
    """Return the errors of sensors that the fit of the only case supports."""
    extension, (name,) = extension_of(case.robot), problem.cases
    fit = problem.two_step[name].fit
    return extension.sensor_errors(
        problem.identified(name), case.datasets, case.condition.model, fit
    )


def _with_case(problem: Problem, **changes: Any) -> Problem:
    """Return a problem of one condition with changes of its case."""
    cases = {name: replace(case, **changes) for name, case in problem.cases.items()}
    return replace(problem, cases=cases)


def concluded(problem: Problem, name: str) -> Identification:
    """Return the identification of a condition, with what its values and the checks show."""
    case, options, estimate = problem.cases[name], problem.options, problem.estimates[name]
    robot, datasets, model = case.robot, case.datasets, case.condition.model
    findings, only = _setup_findings(problem, name), problem.only is not None
    factors = None if only else motor_factors(problem.fits, name)
    values, lacking = value_findings(estimate, case.nominal, robot, factors), problem.lacking
    weak = {finding.joint for finding in values if finding.code == "weak-spring"}
    with guarded(CODES["missing-term"], findings):
        values, lacking = without_echoes(values, lacking, datasets[0].cutoff_hz)
        findings += consequences(findings, model_findings(lacking, findings))
    if only and not is_wrong(findings):
        steps = problem.two_step[name]
        with guarded(CODES["estimator-disagrees"], findings):
            findings += sensitivity_findings(robot, datasets, model, steps, options.estimator)
    # Only now, since the findings above compare estimates by the noise of the logs alone.
    estimate = problem.with_errors_of_constants[name]
    searched = with_searched_values(estimate.drives, case.nominal, robot)
    estimate = replace(estimate, drives=searched)
    consistent = feasible_of(robot, model, estimate) if options.feasible and only else None
    result = identification_of(robot, model, estimate, datasets, consistent, case.declared)
    with guarded(CODES["drives-differ"], values):
        values += shared_findings(estimate.shared)
    values += [*estimate.findings, *result.findings]
    motors = (side for side in lacking if side.side.is_motor)
    doubtful = {joint for side in motors for _, joint in side.doubtful}
    fitted = _with_fit(problem, name, result, findings, weak, doubtful)
    result = with_value_findings(fitted, values)
    result = consistent_bodies(result) if options.feasible and not only else result
    findings = [*result.findings]
    with guarded(CODES["command-delay"], findings):
        findings += delay_estimate_findings(case.run.experiment.robot, result.load_side)
    with guarded(CODES["gain-scale"], findings):
        findings += unknown_scales(result.robot, result.load_side, problem.unscaled)
    scaled = with_free_scale(result.robot, problem.unscaled)
    return replace(
        result,
        robot=scaled,
        nominal=problem.nominals.get(name, case.nominal),
        findings=tuple(findings),
    )


def _setup_findings(problem: Problem, name: str) -> list[Finding]:
    """Return what is wrong with a set-up, with what that of other conditions does to it."""
    case, options = problem.cases[name], problem.options
    run, findings = case.run, list(case.run.setup)
    mistakes = [finding for finding in findings if finding not in run.channels]
    findings += [
        replace(
            finding, message=f"in condition '{source}', which shares parameters: {finding.message}"
        )
        for source, other in problem.cases.items()
        for finding in other.run.setup
        if source != name and finding.severity == "wrong"
    ]
    robot = run.experiment.robot
    asked = robot.selected(options.torque_joints)
    findings += extension_of(robot).torque_findings(robot, asked, case.used)
    findings += consequences(findings, standstill_findings(case.stopped, run.standing))
    findings += [] if case.bias is None else case.bias.findings()
    findings += problem.notes

    def shown_by(robot: Robot) -> list[Finding]:
        return run.setup_of(experiment_of(robot, run.moved))

    return without_setup_echoes(findings, mistakes, problem.lacking, case.declared, shown_by)


def motor_factors(fits: TwoStepFits, condition: str) -> dict[str, QRFactor]:
    """Return the QR factors {joint: factor} of the motor equations of one condition."""
    factors = {}
    for joint, fit in fits.actuators.items():
        assert fit.rows is not None
        rows = fit.rows.at(fits.shares[joint][condition].rows)
        places = places_of(rows.names, condition)
        rows = rows.of_columns(places)
        names = tuple(ParameterName.of(name).within(None) for name in rows.names)
        factors[joint] = qr_factor_of(replace(rows, names=names))
    return factors


_DIFFERENT = (
    "; or the conditions differ: give each robot the payload it had (payload=), and name the "
    "parameters that differ (condition_specific=)"
)


def _own_rows(problem: Problem, name: str) -> tuple[BoolArray | None, dict[int, int]]:
    """Return the rows of a condition in the load side, None for all, and {run: number of log}."""
    moved, rows = problem.cases[name].run.moved, problem.two_step[name].fit.rows
    numbers = list(chain(*([number] * len(group) for number, group in enumerate(moved, 1))))
    if problem.only is not None or rows is None:
        return None, dict(enumerate(numbers))
    own = np.zeros(len(rows.y), dtype=bool)
    own[problem.fits.shares[LOAD][name].rows] = True
    runs = np.unique(rows.run[own]).astype(int).tolist()
    return own, dict(zip(runs, numbers, strict=False))


def _with_fit(
    problem: Problem,
    name: str,
    result: Identification,
    findings: list[Finding],
    weak: set[str],
    lacking: set[str],
) -> Identification:
    """Return a result with how well it explains the experiment, and the findings about that.

    The springs of `weak` joints look so, and may have backlash; the motor equations of `lacking`
    joints lack a term.
    """
    case, options, sides = problem.cases[name], problem.options, problem.two_step[name]
    robot, run, experiment, only = case.robot, case.run, case.experiment, problem.only is not None
    # Rows of both sides at once have no torque of a spring as a target, of which errors are a part.
    fit, actuators = sides.fit, sides.actuators
    bodies = result.robot.parameters + robot.payload_parameters
    own, logs = _own_rows(problem, name)
    bare = RobotFit(robot.joint_names, fit, own=own, weak=weak, lacking=lacking, logs=logs)
    of_load = case.condition.model.base, result.load
    explains = robot_fit(bare, actuators, experiment, bodies, run.locked, *of_load)
    of_fit = [
        replace(finding, remedy=f"{finding.remedy}{_DIFFERENT}")
        if finding.code == "no-fit" and not only
        else finding
        for finding in fit_findings(explains)
    ]
    findings += consequences(findings, of_fit)
    drives = [joint for joint in result.drives if joint in weak]
    backlash = backlash_findings(case.nominal, run.sources, drives, case.used)
    findings += consequences(findings, backlash)
    exact = exact_constants(robot, options.known_std)
    findings += scale_of_bodies(scaled_by_bodies(result.drives, exact))
    extension = extension_of(robot)
    if only:
        of_rows = extension.fit_findings(result, case.datasets, fit, case.bias)
        findings += consequences(findings, of_rows)
    findings += extension.value_findings(case.declared, result)
    setup = joint_checks(experiment, list(map(first_motion, case.datasets)), findings)
    return replace(
        result,
        findings=tuple(findings),
        joint_fits=explains.joints,
        residual=explains.residual,
        exact_constants=exact,
        known_std=FrozenMapping(dict(options.known_std)),
        setup=setup,
    )
