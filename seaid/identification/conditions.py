"""Several conditions at once: with and without payload, warm and cold, several robots of one type.

Shared parameters are estimated from all conditions, condition-specific ones from each: in one
regression per side, in which a specific column occurs once per condition. Two payloads, one of
them known, identify what one condition cannot, such as the torque constant of a motor.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from seaid._arrays import FrozenMapping
from seaid._progress import MOST_NAMES, Result, counted
from seaid.checks import (
    Experiment,
    consequences,
    experiment_of,
    fit_findings,
    log_findings,
    robot_fit,
    setup_findings,
    unknown_scales,
)
from seaid.drives import PARAMETERS, JointParameter, without_condition
from seaid.errors import Finding, IdentificationError, checked, listed, shown, unknown_name
from seaid.estimation import (
    LinearEstimator,
    QRFactor,
    Share,
    TermTest,
    differences,
    estimator_named,
    places_of,
    qr_factor_of,
)
from seaid.identification.checking import joint_checks
from seaid.identification.command_delays import (
    MOST_DELAY_ROUNDS,
    with_estimated_delays,
)
from seaid.identification.datasets import (
    Dataset,
    Source,
    datasets_of,
    first_motion,
    sources_of,
)
from seaid.identification.gear import deflection_joints, with_rigid_gears
from seaid.identification.identification import (
    Identification,
    consistent_bodies,
    identification_of,
    identified_robot,
    value_findings,
    with_value_findings,
)
from seaid.identification.motor_constants import with_free_scale, with_unit_scales
from seaid.identification.nonlinear_terms import linearised_robot, with_searched_values
from seaid.identification.simulated_joints import with_passed_reversals
from seaid.identification.two_step import (
    BODIES,
    LOAD,
    Condition,
    RobotEstimate,
    SpecificParameters,
    TwoStepFits,
    estimate_two_step,
    joints_with_torque,
)
from seaid.log import Log
from seaid.regressor import LoadModel, check_offset_std, load_model_of
from seaid.robot import Robot


def _in_memory(logs: Source | Sequence[Source]) -> list[Log]:
    return [source for source in sources_of(logs) if isinstance(source, Log)]


def _with_findings_of_others(
    setup: Mapping[str, Sequence[Finding]],
) -> dict[str, tuple[Finding, ...]]:
    """Return the findings of each condition, and what is wrong in others: they share parameters."""
    return {
        name: (
            *findings,
            *(
                replace(
                    finding,
                    message=f"in condition '{source}', which shares parameters: {finding.message}",
                )
                for source, theirs in setup.items()
                for finding in theirs
                if source != name and finding.severity == "wrong"
            ),
        )
        for name, findings in setup.items()
    }


_DIFFERENT = (
    "; or the conditions differ: give each robot the payload it had (payload=), and name the "
    "parameters that differ (condition_specific=)"
)


def _with_fits(
    result: Identification,
    sides: RobotEstimate,
    experiment: Experiment,
    share: Share,
    values: Iterable[Finding],
) -> Identification:
    """Return the identification of a condition with how well it explains its share of the rows.

    Springs may look weak by the findings of their `values`.
    """
    weak = {finding.joint for finding in values if finding.code == "weak-spring"}
    joints, bodies = result.known.joint_names, result.robot.parameters
    bodies = bodies + result.known.payload_parameters
    assert sides.fit.rows is not None
    mask = np.zeros(len(sides.fit.rows.y), dtype=bool)
    mask[share.rows] = True
    runs = np.unique(sides.fit.rows.run[mask]).astype(int).tolist()
    logs = {run: number for number, run in enumerate(runs, 1)}
    shown = joints, sides.fit, sides.actuators, experiment, bodies, mask
    fit = robot_fit(*shown, weak=weak, logs=logs)
    of_fit = [
        replace(finding, remedy=f"{finding.remedy}{_DIFFERENT}")
        if finding.code == "no-fit"
        else finding
        for finding in consequences(result.findings, fit_findings(fit))
    ]
    findings = (*result.findings, *of_fit)
    return replace(result, findings=findings, joint_fits=fit.joints, residual=fit.residual)


CONDITION_SPECIFIC = ("spring_offset", "deflection_zero")
"""Default: encoders are zeroed anew when a robot is switched on."""


@dataclass(frozen=True, eq=False, repr=False)
class Conditions(Result):
    """The identifications of several conditions.

    Attributes
    ----------
    identifications : mapping {condition: Identification}
        One per condition, with equal shared parameters.
    condition_specific : tuple of str
        The parameters that are not shared.
    differences : mapping {parameter: TermTest}
        Test per specific parameter of whether the conditions differ in it.
    """

    table_name = "conditions_table"

    identifications: Mapping[str, Identification]
    condition_specific: tuple[str, ...]
    differences: Mapping[str, TermTest]

    def _in_short(self) -> str:
        differ = sum(test.bic > 0 for test in self.differences.values())
        specific = counted(len(self.differences), "specific parameter")
        return f"{listed(self.identifications, MOST_NAMES)}: {specific}, differing: {differ}"


@checked(IdentificationError)
def identify_conditions(
    conditions: Mapping[str, tuple[Robot, Source | Sequence[Source]]],
    *,
    condition_specific: Sequence[str] = CONDITION_SPECIFIC,
    torque_joints: str | Sequence[str] | None = None,
    estimator: LinearEstimator = "wls",
    feasible: bool = False,
    cutoff_hz: float | None = None,
    encoder_offset_std: float = 0.0,
    progress: bool = False,
) -> Conditions:
    """Identify several conditions together, by the two-step method.

    Parameters
    ----------
    conditions : mapping {condition: (robot, logs)}
        The robots are of one type, with the same URDF and drives; their payloads may differ.
    condition_specific : sequence of str
        Parameters estimated per condition, for all joints ("viscous_friction") or for one
        ("viscous_friction of knee"), or "bodies" for the base parameters. All others are shared.
    torque_joints, estimator, feasible, cutoff_hz, encoder_offset_std, progress
        As in `identify`. Nonlinear drive equations are linearised near values of the first
        condition; each condition has encoder offsets of its own.

    Returns
    -------
    Conditions

    Raises
    ------
    IdentificationError
        For less than two conditions, for unknown names, and for robots that differ in joints,
        drives or base parameters; further errors as in `identify`.

    Examples
    --------
    >>> both = seaid.identify_conditions(
    ...     {"cold": (robot, cold_log), "warm": (robot, warm_log)},
    ...     condition_specific=("spring_offset", "viscous_friction"),
    ... )
    >>> print(both.summary())
    """
    _check_conditions(conditions)
    check_offset_std(encoder_offset_std)

    def with_scales(robots: Mapping[str, Robot]) -> Conditions:
        return once({name: (robot, conditions[name][1]) for name, robot in robots.items()})

    once = partial(
        _identify_conditions,
        condition_specific=condition_specific,
        torque_joints=torque_joints,
        estimator=estimator,
        cutoff_hz=cutoff_hz,
        encoder_offset_std=encoder_offset_std,
        progress=progress,
    )
    declared = {name: robot for name, (robot, _) in conditions.items()}
    result, robots, unscaled = with_unit_scales(declared, with_scales)
    first = result.identifications
    # The column of a delay is a derivative at the delay of the drive: the fit is repeated about
    # each estimate.
    for _ in range(MOST_DELAY_ROUNDS):
        later = {
            name: with_estimated_delays(robot, result.identifications[name].robot)
            for name, robot in robots.items()
        }
        if all(later[name] is robot for name, robot in robots.items()):
            break
        robots, result = later, with_scales(later)
    consistent = {
        name: consistent_bodies(part) if feasible else part
        for name, part in result.identifications.items()
    }
    parts = {
        name: replace(
            part,
            robot=with_free_scale(part.robot, unscaled),
            nominal=first[name].nominal,
            findings=(*part.findings, *unknown_scales(part.robot, part.load_side, unscaled)),
        )
        for name, part in consistent.items()
    }
    return replace(result, identifications=FrozenMapping(parts))


def _identify_conditions(
    conditions: Mapping[str, tuple[Robot, Source | Sequence[Source]]],
    *,
    condition_specific: Sequence[str],
    torque_joints: str | Sequence[str] | None,
    estimator: LinearEstimator,
    cutoff_hz: float | None,
    encoder_offset_std: float,
    progress: bool,
) -> Conditions:
    """Return the result of `identify_conditions` with delays linearised at those of the drives."""
    robots, datasets = _read(conditions, cutoff_hz, progress)
    first = robots[next(iter(robots))]
    _check_specific(first, condition_specific)
    used = _used(robots, datasets) if torque_joints is None else first.selected(torque_joints)
    springs = deflection_joints(first, list(chain(*datasets.values())))
    declared = robots
    experiments = {
        name: experiment_of(robot, [[first_motion(dataset)] for dataset in datasets[name]])
        for name, robot in robots.items()
    }
    setup = _setups(experiments, {name: logs for name, (_, logs) in conditions.items()})
    robots = {name: with_rigid_gears(robot, springs) for name, robot in robots.items()}
    nominal = robots
    robots, datasets = _linearised(robots, datasets, used)
    models = {
        name: load_model_of(robot, list(map(first_motion, datasets[name])), used)
        for name, robot in robots.items()
    }
    _check_models(models)
    specific = SpecificParameters(tuple(condition_specific))
    fitted = partial(
        estimate_two_step,
        estimator=estimator_named(estimator),
        encoder_offset_std=encoder_offset_std,
        specific=specific,
    )
    cases = {name: Condition(robot, datasets[name], models[name]) for name, robot in robots.items()}
    fits = fitted(cases)
    if first.has_controllers:
        for name, case in cases.items():
            # Reversals that a motor only passes, by the friction of the first fit, count in the
            # second; the first excludes all of them.
            start = identified_robot(case.robot, case.model.base, fits.of(name))
            passed = with_passed_reversals(case.robot, case.datasets, start)
            cases[name] = replace(case, datasets=passed)
        fits = fitted(cases)
    identified = {}
    for name, case in cases.items():
        robot, parts, experiment = case.robot, case.datasets, experiments[name]
        sides, motors = fits.of(name), motor_factors(fits, name)
        values = value_findings(sides, nominal[name], robot, motors)
        sides = replace(sides, drives=with_searched_values(sides.drives, nominal[name], robot))
        result = identification_of(robot, case.model, sides, parts, declared=declared[name])
        checks = joint_checks(experiment, case.motions)
        values += result.findings
        result = replace(result, findings=setup[name], setup=checks, nominal=nominal[name])
        result = _with_fits(result, sides, experiment, fits.shares[LOAD][name], values)
        identified[name] = with_value_findings(result, values)
    return Conditions(
        FrozenMapping(identified), tuple(condition_specific), FrozenMapping(_differences(fits))
    )


def motor_factors(fits: TwoStepFits, condition: str) -> dict[str, QRFactor]:
    """Return the QR factors {joint: factor} of the motor equations of one condition."""
    factors = {}
    for joint, fit in fits.actuators.items():
        assert fit.rows is not None
        rows = fit.rows.at(fits.shares[joint][condition].rows)
        places = places_of(rows.names, condition)
        names = tuple(without_condition(rows.names[place]) for place in places)
        units = tuple(rows.units[place] for place in places)
        factors[joint] = qr_factor_of(replace(rows, names=names, units=units, H=rows.H[:, places]))
    return factors


def _differences(fits: TwoStepFits) -> dict[str, TermTest]:
    """Return {specific parameter (of a joint): test of whether the conditions differ in it}."""
    return {
        JointParameter(name, joint): test
        for joint, fit in fits.actuators.items()
        for name, test in differences(fit).items()
    } | differences(fits.load)


def _setups(
    experiments: Mapping[str, Experiment], logs: Mapping[str, Source | Sequence[Source]]
) -> dict[str, tuple[Finding, ...]]:
    """Return the findings of the logs and of the set-up of each condition."""
    mistakes = {}
    for name, experiment in experiments.items():
        known = log_findings(experiment.robot, _in_memory(logs[name]))
        mistakes[name] = setup_findings(experiment, known)
    return _with_findings_of_others(mistakes)


def _check_conditions(conditions: Mapping[str, object]) -> None:
    """Check that conditions are at least two pairs of a robot and its logs."""
    if len(conditions) < 2:
        raise IdentificationError(
            f"identify_conditions needs at least two conditions, found {len(conditions)}"
        )
    for name, pair in conditions.items():
        if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], Robot)):
            raise IdentificationError(
                f"condition '{name}' must be (robot, logs), found {shown(pair)}"
            )


def _read(
    conditions: Mapping[str, tuple[Robot, Source | Sequence[Source]]],
    cutoff_hz: float | None,
    progress: bool,
) -> tuple[dict[str, Robot], dict[str, list[Dataset]]]:
    """Return robots and datasets of all conditions, with one cutoff."""
    robots = {name: robot for name, (robot, _) in conditions.items()}
    _check_joints(robots)
    sources = {name: sources_of(logs) for name, (_, logs) in conditions.items()}

    def read(cutoff: float | None) -> dict[str, list[Dataset]]:
        return {
            name: datasets_of(robots[name], sources[name], cutoff, None, progress)
            for name in conditions
        }

    datasets = read(cutoff_hz)
    bands = {dataset.cutoff_hz for group in datasets.values() for dataset in group}
    # One cutoff for all: a bias that depends on it would look like a difference of the conditions.
    return robots, datasets if len(bands) == 1 else read(min(bands))


def _linearised(
    robots: Mapping[str, Robot], datasets: Mapping[str, list[Dataset]], used: Sequence[str]
) -> tuple[dict[str, Robot], dict[str, list[Dataset]]]:
    """Return robots with drives linearised near the values of the first condition, and datasets."""
    linearised, known = dict(robots), {}
    for place, (name, robot) in enumerate(robots.items()):
        straight, known[name] = linearised_robot(linearised[name], datasets[name], used)
        if place == 0 and straight is not robot:
            # A value is the only start of a search (`starts_of`): with those of the first condition
            # all searches end in the same local optimum.
            alike = {x: twin for x, twin in robots.items() if twin.drives == robot.drives}
            linearised |= {x: twin.with_drives(straight.drives) for x, twin in alike.items()}
    return linearised, known


def _used(robots: Mapping[str, Robot], datasets: Mapping[str, list[Dataset]]) -> tuple[str, ...]:
    """Return the joints whose torque is measured in every condition."""
    known = [joints_with_torque(robots[name], datasets[name]) for name in robots]
    return tuple(joint for joint in known[0] if all(joint in joints for joints in known))


def _check_joints(robots: Mapping[str, Robot]) -> None:
    (first, robot), *others = robots.items()
    for name, compared in others:
        if compared.joint_names != robot.joint_names:
            raise IdentificationError(
                f"condition '{first}' has the joints {', '.join(robot.joint_names)}, '{name}' "
                f"{', '.join(compared.joint_names)}: they must be one type of robot"
            )


def _check_specific(robot: Robot, specific: Sequence[str]) -> None:
    allowed = [BODIES, *PARAMETERS]
    for name in specific:
        parameter, _, joint = name.partition(" of ")
        if parameter not in allowed:
            raise IdentificationError(
                "condition_specific=: " + unknown_name("parameter", parameter, allowed),
                "condition_specific=",
            )
        if joint and joint not in robot.joint_names:
            raise IdentificationError(
                "condition_specific=: " + unknown_name("joint", joint, robot.joint_names),
                "condition_specific=",
            )


def _check_models(models: Mapping[str, LoadModel]) -> None:
    first, *others = models
    for name in others:
        if models[name].names != models[first].names:
            raise IdentificationError(
                f"conditions '{first}' and '{name}' do not have the same base parameters and "
                "drives: they must be one type of robot, with the same joints; payloads may differ"
            )
