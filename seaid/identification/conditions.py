"""Several conditions at once: with and without payload, warm and cold, several robots of one type.

Shared parameters are estimated from all conditions, condition-specific ones from each: in one
regression per side, in which a specific column occurs once per condition. Two payloads, one of
them known, identify what one condition cannot, such as the torque constant of a motor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate, chain

import numpy as np
from scipy import linalg

from seaid._arrays import Array, BoolArray, FrozenMapping
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
from seaid.drives import PARAMETERS, JointParameter
from seaid.errors import Finding, IdentificationError, checked, listed, shown, unknown_name
from seaid.estimation import (
    Estimate,
    Estimator,
    FittedRows,
    LinearEstimator,
    QRFactor,
    TermTest,
    estimator_named,
    independent_rows,
    qr_factor_of,
    settled_weights,
    term_test,
)
from seaid.identification.checking import joint_checks
from seaid.identification.command_delays import (
    MOST_DELAY_ROUNDS,
    with_estimated_delays,
    with_shared_delays,
)
from seaid.identification.datasets import (
    Dataset,
    Source,
    datasets_of,
    first_motion,
    rows_in_memory,
    sources_of,
)
from seaid.identification.drive_estimates import merged_estimates, spring_of, with_spring_torque
from seaid.identification.gear import deflection_joints, with_rigid_gears
from seaid.identification.identification import (
    Identification,
    consistent_bodies,
    identification_of,
    identified_robot,
    value_findings,
    with_value_findings,
)
from seaid.identification.nonlinear_terms import linearised_robot, with_searched_values
from seaid.identification.simulated_joints import with_passed_reversals
from seaid.identification.two_step import (
    LOAD,
    RobotEstimate,
    UnknownScaleError,
    fit_inputs,
    joints_with_torque,
    scaled_with_springs,
    split_load_side,
    spring_torque_joints,
    two_step_equations,
    with_constant_columns,
    with_free_scale,
    with_unit_constant,
    with_unit_scales,
)
from seaid.log import Log
from seaid.regressor import LoadModel, Regression, load_model_of, stacked
from seaid.robot import Robot


@dataclass(frozen=True, eq=False)
class SharedRows:
    """Rows of all conditions, and the places (p,) of each condition's columns among them."""

    rows: Regression
    places: Mapping[str, tuple[int, ...]]
    names: tuple[str, ...]

    def of(self, condition: str, estimate: Estimate) -> Estimate:
        """Return a condition's part of the estimate, under the condition's own names."""
        return estimate.part(self.places[condition], self.names)

    def place(self, condition: str, name: str) -> int:
        """Return the column that a parameter of a condition has."""
        return self.places[condition][self.names.index(name)]


def shared_rows(rows: Mapping[str, Regression], specific: Sequence[bool]) -> SharedRows:
    """Return the regressions of the conditions as one; `specific` (p,) masks columns not shared.

    A specific column is named "<name> [<condition>]". Raises IdentificationError if the conditions
    differ in their columns.
    """
    first, *others = rows
    names = rows[first].names
    for condition in others:
        if rows[condition].names != names:
            raise IdentificationError(
                f"condition '{first}' has the parameters {', '.join(names)}; '{condition}' has "
                f"{', '.join(rows[condition].names)}: conditions need the same sensors and terms"
            )
    # A specific parameter has one column per condition, with zeros in the rows of the others.
    columns = {name: place for place, name in enumerate(_columns(names, specific, list(rows)))}
    places = {
        condition: tuple(columns[text] for text in _columns(names, specific, [condition]))
        for condition in rows
    }
    units = dict(zip(names, rows[first].units, strict=True))
    wide = [
        replace(
            regression,
            names=tuple(columns),
            units=tuple(units[text.split(" [")[0]] for text in columns),
            H=_placed(regression.H, places[condition], len(columns)),
        )
        for condition, regression in rows.items()
    ]
    starts = _first_runs(wide)
    # Logs are numbered through all conditions: autocorrelation ends with a log, and `is_of` finds
    # the rows of a condition by these numbers.
    run = np.concatenate([part.run + start for part, start in zip(wide, starts, strict=False)])
    return SharedRows(replace(stacked(wide), run=run), places, names)


def _first_runs(rows: Iterable[Regression]) -> Array:
    """Return the number of the first log of each condition, and one more."""
    return np.cumsum([0, *(float(np.max(part.run, initial=0.0)) + 1 for part in rows)])


def _columns(
    names: Sequence[str], specific: Sequence[bool], conditions: Sequence[str]
) -> list[str]:
    return [
        text
        for name, is_specific in zip(names, specific, strict=True)
        for text in ([f"{name} [{x}]" for x in conditions] if is_specific else [name])
    ]


def _placed(columns: Array, places: Sequence[int], count: int) -> Array:
    wide = np.zeros((len(columns), count))
    wide[:, list(places)] = columns
    return wide


BODIES = "bodies"
"""Stands for all base parameters in `condition_specific`."""


@dataclass(frozen=True, eq=False)
class ConditionFit:
    """One side of all conditions: its rows, their fit, and `estimate`, that of the fit.

    Of a motor whose constant the load side gives, the fit is that for a constant of 1.
    """

    rows: Mapping[str, Regression]
    shared: SharedRows
    fit: FittedRows
    estimate: Estimate

    def of(self, condition: str) -> Estimate:
        """Return the estimate of a condition."""
        return self.shared.of(condition, self.estimate)

    def is_of(self, condition: str) -> BoolArray:
        """Return which rows (R,) of the fit are those of a condition."""
        assert self.fit.rows is not None
        # The number of the first log of a condition, and that of the next condition.
        starts, place = _first_runs(self.rows.values()), list(self.rows).index(condition)
        run = self.fit.rows.run
        return np.asarray((starts[place] <= run) & (run < starts[place + 1]))

    def scaled(self, estimate: Estimate) -> ConditionFit:
        """Return the side with an estimate that has the constant as its last parameter."""
        places = {name: (*old, len(estimate.names) - 1) for name, old in self.shared.places.items()}
        names = (*self.shared.names, estimate.names[-1])
        shared = replace(self.shared, places=places, names=names)
        return replace(self, shared=shared, estimate=estimate)

    def with_fit(self, fit: FittedRows) -> ConditionFit:
        """Return the side with another fit and its estimate."""
        return replace(self, fit=fit, estimate=fit.estimate)

    def differences(self) -> dict[str, TermTest]:
        """Return {specific parameter: test of whether the conditions differ in it}."""
        names = list(self.fit.estimate.names)
        groups: dict[str, list[int]] = {}
        for place, name in enumerate(names):
            if name.endswith("]"):
                groups.setdefault(name.rsplit(" [", 1)[0], []).append(place)
        change = np.eye(len(names))
        for columns in groups.values():  # the first column is common, the others are differences
            # theta_c = theta_1 + delta_c, so that H theta = (H change) (theta_1, delta_2, ...).
            change[columns, columns[0]] = 1.0
        rows = self.shared.rows
        qr_factor = qr_factor_of(replace(rows, H=rows.H @ change))
        independent = independent_rows(self.fit.qr_factor, self.fit.estimate)
        # Each F test needs degrees of freedom of the residual.
        if independent <= len(names):
            return {}
        weights = settled_weights(qr_factor)
        return {
            name: term_test(qr_factor, weights, [names[c] for c in columns[1:]], independent)
            for name, columns in groups.items()
        }


@dataclass(frozen=True, eq=False)
class ConditionFits:
    """Both sides of all conditions: `actuators` by joint, `load` with the joints in `springs`."""

    robots: Mapping[str, Robot]
    models: Mapping[str, LoadModel]
    actuators: Mapping[str, ConditionFit]
    load: ConditionFit
    springs: tuple[str, ...]

    def differences(self) -> dict[str, TermTest]:
        """Return {specific parameter (of a joint): test of whether the conditions differ in it}."""
        return {
            JointParameter(name, joint): test
            for joint, side in self.actuators.items()
            for name, test in side.differences().items()
        } | self.load.differences()

    def qr_factors(self, condition: str) -> dict[str, QRFactor]:
        """Return the QR factors of one condition's motor equations, by joint."""
        return {joint: qr_factor_of(x.rows[condition]) for joint, x in self.actuators.items()}

    def of(self, condition: str) -> RobotEstimate:
        """Return one condition's part of all fits, as `identify` would."""
        robot, model = self.robots[condition], self.models[condition]
        drives = {joint: side.of(condition) for joint, side in self.actuators.items()}
        load_side = self.load.of(condition)
        base, others = split_load_side(model, load_side)
        merged = merged_estimates(drives, others)
        sides = {**self.actuators, "load": self.load}
        return RobotEstimate(
            drives={joint: merged[joint] for joint in robot.joint_names if joint in merged},
            load=base,
            load_side=load_side,
            springs={
                joint: spring_of(robot, drives[joint], joint).values for joint in self.springs
            },
            excluded={name: side.rows[condition].excluded for name, side in sides.items()},
            checks={name: side.fit.checks(()) for name, side in sides.items()},
            fit=self.load.fit,
            actuators={joint: side.fit for joint, side in self.actuators.items()},
        )


def estimate_conditions(
    robots: Mapping[str, Robot],
    datasets: Mapping[str, Sequence[Dataset]],
    models: Mapping[str, LoadModel],
    specific: Sequence[str],
    solver: Estimator,
) -> ConditionFits:
    """Estimate both sides of {condition: robot}, one after the other."""
    name, first = next(iter(robots.items()))
    springs = spring_torque_joints(first, datasets[name], models[name])
    rows = {
        name: rows_in_memory(datasets[name], two_step_equations(robot, models[name], springs))
        for name, robot in robots.items()
    }
    actuators, unscaled = {}, {}
    for joint in first.elastic_joints:
        joint_rows = {name: equations[joint] for name, equations in rows.items()}
        try:
            side = _fitted_actuator(joint_rows, joint, specific, solver)
        except UnknownScaleError as problem:
            if joint not in springs:
                raise
            unscaled[joint] = problem
            joint_rows = {name: with_unit_constant(part) for name, part in joint_rows.items()}
            # The spring in units of the input; `_scaled_by_load` finds the unit from (8).
            side = _fitted_actuator(joint_rows, joint, specific, solver)
        actuators[joint] = side.with_fit(with_shared_delays(first.drives, side.fit, joint))
    load_rows = {name: equations[LOAD] for name, equations in rows.items()}
    if unscaled:
        actuators |= _scaled_by_load(
            robots, load_rows, models, springs, actuators, unscaled, specific, solver
        )
    load = _load(robots, load_rows, models, springs, actuators, specific, solver)
    return ConditionFits(robots, models, actuators, load, springs)


def _fitted_actuator(
    rows: Mapping[str, Regression], joint: str, specific: Sequence[str], solver: Estimator
) -> ConditionFit:
    names = next(iter(rows.values())).names
    is_specific = [name in specific or f"{name} of {joint}" in specific for name in names]
    return _fitted(rows, is_specific, solver, None)


def _scaled_by_load(
    robots: Mapping[str, Robot],
    rows: Mapping[str, Regression],
    models: Mapping[str, LoadModel],
    joints: Sequence[str],
    actuators: Mapping[str, ConditionFit],
    unscaled: Mapping[str, UnknownScaleError],
    specific: Sequence[str],
    solver: Estimator,
) -> dict[str, ConditionFit]:
    """Return the sides of `unscaled` joints with the constants that (8) of all conditions gives.

    Bodies that are the same with and without a known payload, or known bodies, give them. Raises
    the UnknownScaleError of a joint if they do not.
    """
    robot = next(iter(robots.values()))
    constants = {x: JointParameter(problem.parameter, x) for x, problem in unscaled.items()}
    changed = _with_springs(
        robots, rows, joints, actuators, partial(with_constant_columns, robot, constants=constants)
    )
    # The constant of a motor is common to all conditions: a known payload in one of them gives it.
    is_specific = _is_specific(models, specific) + [False] * len(constants)
    try:
        fitted = _fitted(changed, is_specific, solver, None).fit
    except UnknownScaleError:
        raise next(iter(unscaled.values())) from None
    springs = {joint: actuators[joint].estimate for joint in joints}
    return {
        joint: actuators[joint].scaled(
            scaled_with_springs(robot, springs[joint], name, fitted, springs)
        )
        for joint, name in constants.items()
    }


def _load(
    robots: Mapping[str, Robot],
    rows: Mapping[str, Regression],
    models: Mapping[str, LoadModel],
    joints: Sequence[str],
    actuators: Mapping[str, ConditionFit],
    specific: Sequence[str],
    solver: Estimator,
) -> ConditionFit:
    """Fit (8) of all conditions, with the uncertainty of the springs that they share."""
    placed = _with_springs(
        robots,
        rows,
        joints,
        actuators,
        lambda springs, rows: with_spring_torque(list(springs.values()), rows),
    )
    covariances = [actuators[joint].estimate.covariance for joint in joints]
    propagated = linalg.block_diag(*covariances) if covariances else None
    side = _fitted(placed, _is_specific(models, specific), solver, propagated)
    drives = robots[next(iter(robots))].drives
    return side.with_fit(with_shared_delays(drives, side.fit))


def _with_springs(
    robots: Mapping[str, Robot],
    rows: Mapping[str, Regression],
    joints: Sequence[str],
    actuators: Mapping[str, ConditionFit],
    change: Callable[[Mapping[str, Estimate], Regression], Regression],
) -> dict[str, Regression]:
    """Return (8) of all conditions after a change by the condition's springs {joint: estimate}.

    The propagated columns become those of the parameters that the conditions share.
    """
    starts = list(accumulate((len(actuators[x].estimate.names) for x in joints), initial=0))
    placed = {}
    for name, robot in robots.items():
        springs = {joint: spring_of(robot, actuators[joint].of(name), joint) for joint in joints}
        # A parameter of a spring that the conditions share has one column for all of them: its
        # error moves all their loads together. A specific one has a column per condition.
        places = [
            start + actuators[joint].shared.place(name, parameter)
            for joint, start in zip(joints, starts, strict=False)
            for parameter in springs[joint].names
        ]
        changed = change(springs, rows[name])
        columns = _placed(changed.propagated, places, starts[-1])
        placed[name] = replace(changed, propagated=columns)
    return placed


def _is_specific(models: Mapping[str, LoadModel], specific: Sequence[str]) -> list[bool]:
    first = models[next(iter(models))]
    return [BODIES in specific] * len(first.expressions) + [
        f"{name} of {joint}" in specific or name in specific for joint, name, _ in first.drives
    ]


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
    mask: BoolArray,
    values: Iterable[Finding],
) -> Identification:
    """Return the identification of a condition with how well it explains the rows in `mask`.

    Springs may look weak by the findings of their `values`.
    """
    weak = {finding.joint for finding in values if finding.code == "weak-spring"}
    joints, bodies = result.known.joint_names, result.robot.parameters
    bodies = bodies + result.known.payload_parameters
    logs = dict[int, int]()
    if sides.fit.rows is not None:
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


def _fitted(
    rows: Mapping[str, Regression],
    specific: Sequence[bool],
    solver: Estimator,
    propagated: Array | None,
) -> ConditionFit:
    shared = shared_rows(rows, specific)
    fit = fit_inputs(shared.rows, solver, propagated, None, None)
    return ConditionFit(rows, shared, fit, fit.estimate)


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
    torque_joints, estimator, feasible, cutoff_hz, progress
        As in `identify`. Nonlinear drive equations are linearised near values of the first
        condition.

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

    def with_scales(robots: Mapping[str, Robot]) -> Conditions:
        return once({name: (robot, conditions[name][1]) for name, robot in robots.items()})

    once = partial(
        _identify_conditions,
        condition_specific=condition_specific,
        torque_joints=torque_joints,
        estimator=estimator,
        cutoff_hz=cutoff_hz,
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
    solver = estimator_named(estimator)
    fit = partial(estimate_conditions, robots, models=models, solver=solver)
    sides = fit(datasets, specific=condition_specific)
    if first.has_controllers:
        for name, robot in robots.items():
            # Reversals that a motor only passes, by the friction of the first fit, count in the
            # second; the first excludes all of them.
            start = identified_robot(robot, models[name].base, sides.of(name))
            datasets[name] = with_passed_reversals(robot, datasets[name], start)
        sides = fit(datasets, specific=condition_specific)
    identified = {}
    for name, robot in robots.items():
        part = sides.of(name)
        values = value_findings(part, nominal[name], robot, sides.qr_factors(name))
        part = replace(part, drives=with_searched_values(part.drives, nominal[name], robot))
        parts, experiment = datasets[name], experiments[name]
        result = identification_of(robot, models[name], part, parts, declared=declared[name])
        checks = joint_checks(experiment, list(map(first_motion, parts)))
        values += result.findings
        result = replace(result, findings=setup[name], setup=checks, nominal=nominal[name])
        result = _with_fits(result, part, experiment, sides.load.is_of(name), values)
        identified[name] = with_value_findings(result, values)
    return Conditions(
        FrozenMapping(identified), tuple(condition_specific), FrozenMapping(sides.differences())
    )


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
