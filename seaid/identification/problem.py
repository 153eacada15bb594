"""From logs to fitted equations, of one condition or of several together.

`solve` reconstructs the motions of the logs, assembles the equations of what moves and has a
torque, and fits them until the robot about which they are linear stays the same. `conclude`, of the
module `conclusion`, makes the identification of a condition of these fits and of what the checks
find.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, Literal

from seaid.checks.channels import locked_outputs
from seaid.checks.experiment import Experiment, with_torques_of
from seaid.checks.model import SideSelection, selections
from seaid.checks.setup import log_findings
from seaid.drives import Drive
from seaid.drives.drives import check_groups
from seaid.errors import Finding, IdentificationError, SeaidError
from seaid.estimation import Estimator, estimator_named
from seaid.estimation.fitting import EstimatorName
from seaid.estimation.parameters import check_buses
from seaid.identification import checking, drive_estimates, result
from seaid.identification.command_driven import with_passed_reversals
from seaid.identification.datasets import (
    Dataset,
    Source,
    check_temperatures,
    datasets_by_log,
    first_motion,
)
from seaid.identification.gear import deflection_joints, with_rigid_gears
from seaid.identification.given_constants import (
    GivenConstants,
    check_in_use,
    check_known_std,
    constants_of_conditions,
    encoder_offsets,
)
from seaid.identification.instrumental import BY_INSTRUMENTS
from seaid.identification.model_selection import MOST_ROUNDS, with_default_terms
from seaid.identification.nonlinear_terms import linearised_condition
from seaid.identification.simultaneous import AT_ONCE, estimate_supported
from seaid.identification.stacked_fits import RobotEstimate, SensorErrors
from seaid.identification.two_step import (
    IN_TURN,
    NOTHING_SPECIFIC,
    Condition,
    Procedure,
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
from seaid.regressor.load import check_offset_std
from seaid.robot import Robot

Method = Literal["auto", "two-step", "simultaneous"]
"""Values of `method=`."""


@contextmanager
def explained(findings: Callable[[], Sequence[Finding]]) -> Iterator[None]:
    """Put before an error of seaid the finding that explains it: a wrong set-up, and its remedy.

    The `findings` are only looked for if there is an error.
    """
    try:
        yield
    except SeaidError as problem:
        for wrong in [x for x in findings() if x.severity == "wrong"][:1]:
            remedy = f"; remedy: {wrong.remedy}" if wrong.remedy else ""
            text = f"{wrong.code}: {wrong.message}{remedy}\nand so: {problem}"
            problem.args = SeaidError(text).args
        raise


@dataclass(frozen=True, eq=False)
class Options:
    """The options of `identify`, and the parameters that conditions have for themselves.

    `as_recorded` is what logs show as they were recorded, if parts of them are simulated since.
    """

    torque_joints: str | Sequence[str] | None = None
    method: Method = "auto"
    estimator: EstimatorName = "wls"
    feasible: bool = False
    cutoff_hz: float | None = None
    encoder_offset_std: float = 0.0
    known_std: Mapping[str, float] = field(default_factory=dict)
    progress: bool = False
    specific: SpecificParameters = NOTHING_SPECIFIC
    as_recorded: Sequence[Finding] | None = None

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
    def procedure(self) -> Procedure:
        """What gives the estimate, with the method "auto" if the data support it."""
        if self.estimator == "iv":
            return BY_INSTRUMENTS
        return IN_TURN if self.method == "two-step" else AT_ONCE

    def check_robots(self, robots: Collection[Robot]) -> None:
        """Raise an error for drives that cannot share, and for deviations of what no robot has."""
        for robot in robots:
            check_groups(robot.drives, robot.name, is_whole=False)
            check_buses(robot.drives)
        check_in_use(robots, self.known_std)

    @property
    def linear_estimator(self) -> Estimator:
        """The estimator of two steps, from which instruments continue too."""
        return estimator_named("wls" if self.estimator == "iv" else self.estimator)


@dataclass(frozen=True, eq=False)
class ConditionLogs:
    """The logs of one condition and their motions.

    `in_memory` are the logs that are not read in pieces; `motions_by_log` the motions of the parts
    of each log; `locked` {joint: position} are joints whose outputs are locked, `standing` those
    that stand still; `setup_joints` those whose torques show the set-up, which `experiment` has;
    `channel_findings` what the channels of the logs show.
    """

    sources: list[Source]
    in_memory: list[Log]
    datasets: list[Dataset]
    motions_by_log: list[list[Motion]]
    locked: Mapping[str, float]
    standing: Mapping[str, float]
    setup_joints: set[str]
    experiment: Experiment
    channel_findings: tuple[Finding, ...]

    @cached_property
    def setup_findings(self) -> list[Finding]:
        """What the channels show, and the mistakes of the set-up."""
        return self.findings_of(self.experiment)

    @property
    def numbers(self) -> list[int]:
        """The number, from 1, of the log of each motion."""
        logs = enumerate(self.motions_by_log, 1)
        return [number for number, motions in logs for _ in motions]

    def findings_of(self, experiment: Experiment) -> list[Finding]:
        """Return what the channels show, and the mistakes of the set-up of an experiment."""
        joints, known = self.setup_joints, self.channel_findings
        return checking.findings_of_setup(experiment, joints, known, self.in_memory)


@dataclass(frozen=True, eq=False)
class Case(Condition):
    """The equations of the robot of one condition.

    `declared` is the robot as given, without the loads of locked joints. `nominal` is `declared`
    without the drives {joint: drive} that are `stopped`, because they stand still, and has the
    values as given. `robot` is `nominal` with the nonlinear parameters that a search found. The
    datasets are those of the `logs` without the `bias` of sensors, if one was found.
    """

    logs: ConditionLogs
    declared: Robot
    nominal: Robot
    stopped: Mapping[str, Drive]
    bias: SensorErrors | None = None

    @property
    def experiment(self) -> Experiment:
        """The motions of the logs without the errors of the sensors."""
        if self.bias is None:
            return self.logs.experiment
        groups = self.logs.motions_by_log
        return Experiment.of(self.declared, [self.bias.removed(group) for group in groups])


@dataclass(frozen=True, eq=False)
class Problem:
    """The equations of all conditions, and their estimates.

    Estimates are computed once. A problem is changed by `replace` only, which forgets them.

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
        chosen = options.linear_estimator, options.progress, options.specific
        fits = estimate_two_step(self.cases, *chosen, sensor_errors=bias)
        if not self.offsets.common:
            return fits
        estimates = {name: fits.of(name) for name in self.cases}
        return replace(fits, known_errors=self.offsets.known_errors(estimates))

    @cached_property
    def offsets(self) -> GivenConstants:
        """The encoders as given, and all else as exact."""
        std, options = self.options.encoder_offset_std, self.options
        constants = {name: encoder_offsets(case.robot, std) for name, case in self.cases.items()}
        return GivenConstants(self.cases, constants, options.specific)

    @cached_property
    def two_step(self) -> Mapping[str, RobotEstimate]:
        """The estimates of two steps by condition."""
        return {name: self.fits.of(name) for name in self.cases}

    def identified(self, name: str) -> Robot:
        """Return the robot of a condition with the values of two steps."""
        return result.identified_robot(self.cases[name].robot, self.two_step[name])

    @cached_property
    def estimates(self) -> Mapping[str, RobotEstimate]:
        """The estimates by the method of the options, which continues from two steps."""
        procedure, is_auto = self.options.procedure, self.options.method == "auto"
        if (go_on := procedure.continued) is None:
            return self.two_step
        ((name, case),), (start,) = self.cases.items(), self.two_step.values()

        def estimate() -> RobotEstimate:
            later = go_on(case, start, self.options.linear_estimator)
            return self.offsets.included({name: later})[name]

        if procedure is not AT_ONCE or not is_auto:
            reason = "instruments are of the equations in turn" if is_auto else ""
            return {name: replace(estimate(), not_shared=reason)}
        doubtful = [key for side in self.lacking for key in side.doubtful]
        lacking = sorted({(check.code.name, joint) for check, joint in doubtful})
        return {name: estimate_supported(case, start, lacking, estimate)}

    @cached_property
    def with_errors_of_constants(self) -> Mapping[str, RobotEstimate]:
        """The estimates, with the errors of what was given as known."""
        constants = constants_of_conditions(self.cases, self.options.known_std)
        return replace(self.offsets, constants=constants).included(self.estimates)

    @cached_property
    def lacking(self) -> list[SideSelection]:
        """What the equations of two steps of one condition lack, if its logs are in memory."""
        if self.only is None:
            return []
        (estimate,), case = self.two_step.values(), self.only
        gears = deflection_joints(case.robot, case.motions_in_memory)
        known = gears, self.options.encoder_offset_std, case.logs.numbers
        return selections(checking.checked_sides(case, estimate, case.logs.in_memory, *known))


def solve(
    robots: Mapping[str, Robot], sources: Mapping[str, Sequence[Source]], options: Options
) -> Problem:
    """Return the fitted equations of {condition: robot}.

    The column of a delay is a derivative at the delay of the drive, and gains in units of the drive
    have the scale 1 where nothing determines it: fits are repeated about each new robot.
    """
    options.check_robots(robots.values())
    unscaled: tuple[str, ...] = ()
    nominals: Mapping[str, Robot] = {}
    declared, rounds = dict(robots), drive_estimates.MOST_DELAY_ROUNDS
    while True:
        logs = reconstruct(declared, sources, options)
        with explained(partial(_setup_findings, logs)):
            try:
                start = assemble(declared, logs, options)
                start = replace(start, nominals=nominals, unscaled=unscaled)
                problem = _with_first_estimates(start)
            except drive_estimates.UnknownScaleError as reason:
                # Each round makes one more scale known, which then has no column.
                declared = {
                    name: drive_estimates.with_unit_scale(x, reason) for name, x in declared.items()
                }
                unscaled = (*unscaled, reason.joint)
                continue
            nominals = nominals or {name: case.nominal for name, case in problem.cases.items()}
            later = {
                name: drive_estimates.with_estimated_delays(robot, problem.identified(name))
                for name, robot in declared.items()
                if rounds and robot.has_controllers
            }
        changed = {name: robot for name, robot in later.items() if robot is not None}
        if not changed:
            return problem
        declared, rounds = {**declared, **changed}, rounds - 1


def _setup_findings(logs: Mapping[str, ConditionLogs]) -> list[Finding]:
    """Return what is wrong with the set-ups of all conditions."""
    return list(chain(*(of_condition.setup_findings for of_condition in logs.values())))


def reconstruct(
    robots: Mapping[str, Robot], sources: Mapping[str, Sequence[Source]], options: Options
) -> dict[str, ConditionLogs]:
    """Return the motions of the logs of each condition, with one cutoff."""

    def read(cutoff_hz: float | None) -> dict[str, ConditionLogs]:
        return {name: _logs_of(x, sources[name], options, cutoff_hz) for name, x in robots.items()}

    logs = read(options.cutoff_hz)
    bands = {dataset.cutoff_hz for x in logs.values() for dataset in x.datasets}
    # One cutoff for all: a bias that depends on it would look like a difference of the conditions.
    return logs if len(bands) == 1 else read(min(bands))


def _logs_of(
    robot: Robot, sources: Sequence[Source], options: Options, cutoff_hz: float | None
) -> ConditionLogs:
    """Return the motions of logs whose channels are alive, and what stands still in them."""
    selected = robot.selected(options.torque_joints)
    read = [with_commanded_torque(robot, x) if isinstance(x, Log) else x for x in sources]
    logs = [source for source in read if isinstance(source, Log)]
    recorded = options.as_recorded
    findings = log_findings(robot, logs, selected) if recorded is None else recorded
    with explained(lambda: findings):  # an error raised inside gets these findings as its cause
        groups = datasets_by_log(robot, read, cutoff_hz, options.progress)
        motions_by_log = [list(map(first_motion, group)) for group in groups]
        motions, locked = list(chain(*motions_by_log)), locked_outputs(robot, logs)
        standing = dict[str, float]()
        if len(logs) == len(read):
            parts = [part for log in logs for part in stretches(log)]
            standing = checking.standing_joints(robot, parts, motions)
        checking.check_channels(robot, logs, selected, locked)
        datasets = list(chain(*groups))
        check_temperatures(robot, datasets)
    setup_joints = {*selected, *robot.elastic_joints} - {*standing}
    of_base = result.extension_of(robot).log_findings(robot, logs, motions_by_log)
    return ConditionLogs(
        sources=read,
        in_memory=logs,
        datasets=datasets,
        motions_by_log=motions_by_log,
        locked=checking.mean_positions(robot, motions, locked),
        standing=standing,
        setup_joints=setup_joints,
        experiment=with_torques_of(Experiment.of(robot, motions_by_log), setup_joints),
        channel_findings=(*findings, *of_base),
    )


def assemble(
    robots: Mapping[str, Robot], logs: Mapping[str, ConditionLogs], options: Options
) -> Problem:
    """Return the equations of what moves in a condition and has a torque in all conditions."""
    first = next(iter(robots.values()))
    if options.torque_joints is None:
        used = _common([joints_with_torque(x, logs[name].datasets) for name, x in robots.items()])
    else:
        used = first.selected(options.torque_joints)
    # A joint that one condition moves has its equation in all of them.
    standing = _common([tuple(x.standing) for x in logs.values()])
    springs = deflection_joints(first, list(chain(*(x.datasets for x in logs.values()))))
    cases = {}
    for name, robot in robots.items():
        recorded = logs[name]
        check_forces(recorded.datasets, used)
        check_scale_of_locked(robot, recorded.datasets, recorded.locked)
        declared, kept = checking.without_locked_loads(robot, used, recorded.locked)
        still = {joint: recorded.standing[joint] for joint in standing}
        moving, kept, stopped = checking.without_standing(declared, kept, still)
        nominal = with_rigid_gears(moving, springs)
        cases[name] = Case(nominal, recorded.datasets, kept, recorded, declared, nominal, stopped)
    return Problem(options, _linearised(cases))


def _common(joints: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the joints that all conditions have, in the order of the first."""
    first, *others = joints
    return tuple(joint for joint in first if all(joint in of_other for of_other in others))


def _linearised(cases: Mapping[str, Case]) -> dict[str, Case]:
    """Return cases with drives linearised near the values of the first condition."""
    straight, start = dict[str, Case](), None
    for name, case in cases.items():
        if start is not None and case.robot.drives == start.nominal.drives:
            # A value is the only start of a search (`starts_of`): with those of the first condition
            # all searches end in the same local optimum.
            case = case.with_drives(start.robot.drives)
        straight[name] = linearised_condition(case)
        start = start or straight[name]
    return straight


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
    problem = replace(problem, cases={**problem.cases, **cases}) if cases else problem
    case = problem.only
    if case is None:
        return problem
    bias = _sensor_errors(problem, case)
    if bias is not None:
        problem = _with_case(problem, datasets=[*bias.removed(case.datasets)], bias=bias)
    for _ in range(MOST_ROUNDS):
        (case,) = problem.cases.values()
        robot, nominal, notes = with_default_terms(case.robot, case.nominal, problem.lacking)
        if not notes:
            break
        problem = _with_case(problem, robot=robot, nominal=nominal)
        problem = replace(problem, notes=(*problem.notes, *notes))
    return problem


def _sensor_errors(problem: Problem, case: Case) -> SensorErrors | None:
    """Return the errors of sensors that the fit of the only case supports."""
    extension, (name,) = result.extension_of(case.robot), problem.cases
    fit = problem.two_step[name].fit
    return extension.sensor_errors(problem.identified(name), case.datasets, case.model, fit)


def _with_case(problem: Problem, **changes: Any) -> Problem:
    """Return a problem of one condition with changes of its case."""
    cases = {name: replace(case, **changes) for name, case in problem.cases.items()}
    return replace(problem, cases=cases)
