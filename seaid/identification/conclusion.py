"""From fitted equations to the identification of a condition: its values, and all findings.

A mistake of the set-up may be the cause of what values and fits show. So the set-up is judged
first, then what the equations lack, and then how well they fit: each finding comes next to those
that may explain it, see `consequences`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import FrozenMapping
from seaid.checks import CODES
from seaid.checks.channels import excluded_findings, standstill_findings
from seaid.checks.codes import consequences, is_wrong
from seaid.checks.columns import unknown_scales
from seaid.checks.commands import delay_estimate_findings
from seaid.checks.engine import guarded
from seaid.checks.experiment import Experiment
from seaid.checks.model import (
    delays_of,
    model_findings,
    with_settled_limits,
    without_echoes,
    without_setup_echoes,
)
from seaid.checks.values import (
    drive_findings,
    fixed_findings,
    gear_findings,
    noise_findings,
    offset_findings,
    rigid_gear,
    scale_of_bodies,
    shared_findings,
    unused_findings,
)
from seaid.checks.verdict import RobotFit, fit_findings, robot_fit
from seaid.drives import ParameterName
from seaid.drives.controller import DELAY_PARAMETER
from seaid.drives.terms import places_of
from seaid.errors import Finding
from seaid.estimation import Estimate, estimator_named
from seaid.estimation.qr_factor import QRFactor, qr_factor_of
from seaid.identification.checking import joint_checks
from seaid.identification.consistency import FeasibleParameters, feasible_parameters
from seaid.identification.datasets import Dataset, processing_of
from seaid.identification.drive_estimates import with_fixed_delays, with_free_scale
from seaid.identification.gear import gear_estimates, with_gears
from seaid.identification.given_constants import exact_constants, scaled_by_bodies
from seaid.identification.model_selection import backlash_findings
from seaid.identification.nonlinear_terms import with_searched_drives
from seaid.identification.result import Identification, extension_of, identified_robot
from seaid.identification.sensitivity import sensitivity_findings
from seaid.identification.stacked_fits import LOAD, RobotEstimate
from seaid.identification.two_step import TwoStepFits
from seaid.log import Motion
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.checks.model import SideSelection
    from seaid.identification.problem import Problem


def conclude(problem: Problem, name: str) -> Identification:
    """Return the identification of a condition, with what its values and the checks show."""
    case, options, estimate = problem.cases[name], problem.options, problem.estimates[name]
    is_only, cutoff_hz = problem.only is not None, case.datasets[0].cutoff_hz
    final = problem.with_errors_of_constants[name]
    findings = _setup_findings(problem, name)
    factors = None if is_only else motor_factors(problem.fits, name)
    values = value_findings(estimate, case.nominal, case.robot, factors)
    values += offset_findings(final.drives, case.experiment)
    weak = {finding.joint for finding in values if finding.code == "weak-spring"}
    # A term that the equations lack changes the values: what it explains is no finding of them.
    lacking = problem.lacking
    with guarded(CODES["missing-term"], findings):
        values, lacking = without_echoes(values, lacking, cutoff_hz)
        findings += consequences(findings, model_findings(lacking, findings))
    # Cutoffs differ by the noise of the logs alone; it matters beyond the errors of constants.
    if is_only and not is_wrong(findings):
        with guarded(CODES["cutoff-sensitive"], findings):
            two_step = problem.two_step[name]
            findings += sensitivity_findings(case, two_step, final, options.estimator)
    result = _identification(problem, name)
    # Errors of the model differ at the drives of a bus, and with them delays.
    of_type = (x for x in final.shared if x.name.quantity != DELAY_PARAMETER)
    values += shared_findings(of_type)
    values += result.findings
    # The fit is judged without the findings of the values, which are no causes of it.
    fit = replace(_two_step_fit(problem, name, lacking), weak=weak)
    result = _with_fit_quality(problem, name, result, findings, fit)
    result = with_value_findings(result, values)
    # With several conditions the bodies of each are made consistent after the fit of all.
    result = consistent_bodies(result) if options.feasible and not is_only else result
    return _with_free_scales(problem, name, result)


def _identification(problem: Problem, name: str) -> Identification:
    """Return the identification with the errors of what was given as known."""
    case, estimate = problem.cases[name], problem.with_errors_of_constants[name]
    estimate = with_searched_drives(estimate, case)
    is_consistent = problem.options.feasible and problem.only is not None
    consistent = feasible_of(case.robot, estimate) if is_consistent else None
    return identification_of(case.robot, estimate, case.datasets, consistent, case.declared)


def _with_free_scales(problem: Problem, name: str, result: Identification) -> Identification:
    """Return a result whose gains in units of the drive have unknown scales again, as given."""
    case, findings = problem.cases[name], [*result.findings]
    robot, nominal = result.robot, problem.nominals.get(name, case.nominal)
    findings += delay_estimate_findings(case.logs.experiment.robot, nominal, result.load_side)
    findings += unknown_scales(robot, problem.unscaled)
    scaled = with_free_scale(robot, problem.unscaled)
    return replace(result, robot=scaled, nominal=nominal, findings=tuple(findings))


def _setup_findings(problem: Problem, name: str) -> list[Finding]:
    """Return what is wrong with a set-up, with what that of other conditions does to it."""
    case, logs = problem.cases[name], problem.cases[name].logs
    findings = with_settled_limits(logs.setup_findings, problem.lacking)
    mistakes = [finding for finding in findings if finding not in logs.channel_findings]
    findings += [
        replace(
            finding, message=f"in condition '{source}', which shares parameters: {finding.message}"
        )
        for source, of_source in problem.cases.items()
        for finding in of_source.logs.setup_findings
        if source != name and finding.severity == "wrong"
    ]
    robot = logs.experiment.robot
    selected = robot.selected(problem.options.torque_joints)
    findings += extension_of(robot).torque_findings(robot, selected, case.used)
    findings += consequences(findings, standstill_findings(case.stopped, logs.standing))
    findings += [] if case.bias is None else case.bias.findings()
    findings += problem.notes

    def shown_by(robot: Robot) -> list[Finding]:
        return logs.findings_of(Experiment.of(robot, logs.motions_by_log))

    return without_setup_echoes(findings, mistakes, problem.lacking, case.declared, shown_by)


def motor_factors(fits: TwoStepFits, condition: str) -> dict[str, QRFactor]:
    """Return the QR factors {joint: factor} of the motor equations of one condition."""
    factors = {}
    for joint, fit in fits.actuators.items():
        assert fit.rows is not None
        rows = fit.rows.at(fits.shares[joint][condition].rows)
        places = places_of(rows.names, condition)
        rows = rows.of_columns(places)
        names = tuple(name.within(None) for name in rows.names)
        factors[joint] = qr_factor_of(replace(rows, names=names))
    return factors


_CONDITIONS_DIFFER = (
    "; or the conditions differ: give each robot the payload it had (payload=), and name the "
    "parameters that differ (condition_specific=)"
)


def _two_step_fit(problem: Problem, name: str, selected: list[SideSelection]) -> RobotFit:
    """Return the fit of the load side in two steps, with the rows and logs of a condition in it.

    It is judged whatever the method: rows of both sides at once have no torque of a spring as a
    target, of which the errors are a part.
    """
    case, fit = problem.cases[name], problem.two_step[name].fit
    motors = (side for side in selected if side.side.is_motor)
    lacking = {joint for side in motors for _, joint in side.doubtful}
    numbers = case.logs.numbers
    whole = RobotFit(case.robot.joint_names, fit, lacking=lacking, logs=dict(enumerate(numbers)))
    if problem.only is not None or fit.rows is None:
        return whole
    own = np.zeros(len(fit.rows.y), dtype=bool)
    own[problem.fits.shares[LOAD][name].rows] = True
    runs = np.unique(fit.rows.run[own]).astype(int).tolist()
    return replace(whole, own=own, logs=dict(zip(runs, numbers, strict=False)))


def _with_fit_quality(
    problem: Problem, name: str, result: Identification, known: Sequence[Finding], fit: RobotFit
) -> Identification:
    """Return a result with how well its `fit` explains the experiment, after the `known` findings.

    A joint whose spring looks weak may have backlash.
    """
    case, is_only, findings = problem.cases[name], problem.only is not None, [*known]
    robot, experiment, actuators = case.robot, case.experiment, problem.two_step[name].actuators
    bodies = result.robot.parameters + robot.payload_parameters
    # More rows do not reduce the errors of what was given as known.
    of_load = case.model.base, problem.estimates[name].load
    explains = robot_fit(fit, actuators, experiment, bodies, case.logs.locked, *of_load)
    of_fit = [
        replace(finding, remedy=f"{finding.remedy}{_CONDITIONS_DIFFER}")
        if finding.code == "no-fit" and not is_only
        else finding
        for finding in fit_findings(explains)
    ]
    findings += consequences(findings, of_fit)
    drives = [joint for joint in result.drives if joint in fit.weak]
    backlash = backlash_findings(case.nominal, case.logs.sources, drives, case.used)
    findings += consequences(findings, backlash)
    exact = exact_constants(robot, problem.options.known_std)
    findings += scale_of_bodies(scaled_by_bodies(result.drives, exact))
    extension = extension_of(robot)
    if is_only:
        of_rows = extension.fit_findings(result, case.datasets, fit.fit, case.bias)
        findings += consequences(findings, of_rows)
    findings += extension.value_findings(case.declared, result)
    setup = joint_checks(experiment, case.motions, findings, delays_of(problem.lacking))
    return replace(
        result,
        findings=tuple(findings),
        joint_fits=explains.joints,
        residual=explains.residual,
        exact_constants=exact,
        known_std=FrozenMapping(dict(problem.options.known_std)),
        setup=setup,
        estimator=problem.options.estimator,
    )


def value_findings(
    sides: RobotEstimate, nominal: Robot, robot: Robot, qr_factors: Mapping[str, QRFactor] | None
) -> list[Finding]:
    """Return what the values of both sides show, and what the errors of their rows do.

    `nominal` is the robot before a search. `qr_factors` {joint: that of its motor equation} are
    those of the fits if None.
    """
    fits = {joint: side.qr_factor for joint, side in sides.actuators.items()}
    findings: list[Finding] = []
    for joint, estimate in sides.drives.items():
        drive, before = robot.drives[joint], nominal.drives[joint].known
        fixed = [x for x in drive.known if x not in before]
        findings += fixed_findings(joint, drive, fixed)
        if joint in sides.actuators:
            findings += noise_findings(sides.actuators[joint].estimate)
        findings += drive_findings(joint, estimate, (qr_factors or fits).get(joint))
    return [*findings, *noise_findings(sides.load)]


def with_value_findings(result: Identification, values: Iterable[Finding]) -> Identification:
    """Return an identification with the findings of its values, bodies, gears and channels."""
    described = [processing.sources or {} for processing in result.processing] or [{}]
    drives, findings = result.drives, [*values]
    for gear in result.gears.values():
        if "gear_stiffness" in gear.names:  # else the gear is rigid within the errors
            findings += noise_findings(gear)
    findings += () if result.feasible is None else result.feasible.warnings
    findings += excluded_findings(result.processing)
    joints, motions = result.model.torque_joints, result.motions
    findings += unused_findings(result.known, drives, joints, motions)
    findings += gear_findings(result.known, result.drive_side, result.gears, described)
    return result.with_findings(findings)


def identification_of(
    robot: Robot,
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
    rigid = (rigid_gear(joint, x) for joint, (_, x) in sprung.items() if x is not None)
    identified = identified_robot(robot, sides) if feasible is None else feasible.robot
    return Identification(
        drive_side=FrozenMapping(sides.drives),
        load=sides.load,
        base=sides.model.base,
        robot=with_gears(identified, declared or robot, gears),
        known=robot,
        model=sides.model,
        load_side=sides.load_side,
        springs=FrozenMapping(sides.springs),
        cutoff_hz=datasets[0].cutoff_hz,
        excluded=FrozenMapping(sides.excluded),
        checks=FrozenMapping(sides.checks),
        feasible=feasible,
        gears=FrozenMapping(gears),
        processing=processing_of(datasets),
        motions=tuple(dataset for dataset in datasets if isinstance(dataset, Motion)),
        findings=(*sides.findings, *rigid),
        not_shared=sides.not_shared,
        shared=sides.shared,
    )


def feasible_of(robot: Robot, estimate: RobotEstimate) -> FeasibleParameters:
    """Return the physically consistent parameters nearest to the estimate of both sides."""
    # A drive that is in the estimate of both sides is not stacked on it; the columns of torque
    # offsets come after those of the load side.
    side, elastic = estimate.whole or estimate.load_side, dict[str, Estimate]()
    if estimate.whole is None:
        elastic = _elastic_drives(robot, side, estimate.drives)
    white = estimate.fit.white_covariance[: len(side.names), : len(side.names)]
    side, white = with_fixed_delays(robot.drives, side, white)
    return feasible_parameters(robot, estimate.model, side, elastic, white_covariance=white)


def _elastic_drives(
    robot: Robot, load_side: Estimate, drives: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the estimates of elastic drives, without what the load side contains."""
    elastic = {}
    for joint in robot.elastic_joints:
        drive = drives[joint]
        alone = [name for name in drive.names if ParameterName(name, joint) not in load_side.names]
        # A parameter that is zero by definition has no distance from another value.
        part = drive.of_names(name for name in alone if drive.standard_error(name) > 0)
        elastic[joint] = with_fixed_delays(robot.drives, part, part.covariance, joint)[0]
    return elastic


def consistent_bodies(result: Identification) -> Identification:
    """Return an identification with the physically consistent bodies nearest to it."""
    drives = _elastic_drives(result.known, result.load_side, result.drive_side)
    nearest = feasible_parameters(result.known, result.model, result.load_side, drives)
    consistent = replace(result, feasible=nearest, robot=nearest.robot)
    return consistent.with_findings(nearest.warnings)
