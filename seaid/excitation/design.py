"""design_excitation: the motion within limits with the best criterion, (16)-(19)."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np

from seaid._arrays import Array, safely
from seaid._progress import Result, counted
from seaid.errors import ExcitationError, Least, SeaidError, SeaidWarning, Seed, checked
from seaid.excitation.basis import Basis, BasisName, make_basis
from seaid.excitation.boundary import IN_MOTION, EndState, MotionSpace, motion_space, with_run_in
from seaid.excitation.collision import Scene
from seaid.excitation.criteria import (
    CriterionName,
    States,
    has_full_rank,
    pivoted_base,
    scaled_condition_and_d_value,
    singular_values,
)
from seaid.excitation.limits import (
    DriveLimits,
    JointLimits,
    Limits,
    Margins,
    drive_limits,
    joint_limits,
    positive_values,
)
from seaid.excitation.multisine import Multisine
from seaid.excitation.multisine import multisine as multisine_motion
from seaid.excitation.observation_matrix import (
    READINGS_HZ,
    Target,
    drive_target,
    load_target,
    stacked_regressor,
)
from seaid.excitation.problem import (
    PlanningProblem,
    all_margins,
    factor_of,
    make_problem,
    motion_within,
    observation_matrix,
    previous_logs_factor,
    scaled_target,
)
from seaid.excitation.search import Outcome, search, with_feasible_start
from seaid.excitation.stance import (
    Stance,
    StancePlan,
    StandingRobot,
    refuse_in_stance,
    standing_robot,
)
from seaid.excitation.trajectory import Trajectory, check_joint_names
from seaid.log import Log, Motion
from seaid.regressor import BaseParameters
from seaid.regressor.base import check_constant_ratios
from seaid.robot import Robot
from seaid.robot.robot import check_held

_REPORT_SAMPLES = 2000
"""Instants of a plan, and at most of each log, at which measures are computed."""

_MOST_NUMBERS, _FEWEST_SAMPLES = 20_000_000, 50
"""Largest number of entries of the regressor of measured logs, and the fewest samples of each."""

_safely = partial(safely, what="the regressor of the motion", error=ExcitationError)


@dataclass(frozen=True)
class ExcitationMeasures:
    """Measures of a motion that compare, of the base parameters that pivoting selects.

    Attributes
    ----------
    scaled_condition_number : float
        Of columns of unit norm: the same in all units, but not for other base columns.
    d_value : float
        (det(H^T H / T))^(1/(2 p)) of T samples: the inverse of a mean standard error, so that 2 is
        worth four times the samples. Its ratio between two motions of a robot, the D-efficiency,
        depends neither on the base columns nor on units.
    parameters : int
        Number p of the parameters: base parameters, and those of the drives if their nominal values
        are known.
    has_drives : bool
        Whether the parameters of the drives are included.
    """

    scaled_condition_number: float
    d_value: float
    parameters: int
    has_drives: bool

    def d_efficiency(self, other: ExcitationMeasures) -> float:
        """Return the D-efficiency over another motion: 2 is worth four times its samples.

        Raises ExcitationError for motions with other parameters.
        """
        if (self.parameters, self.has_drives) != (other.parameters, other.has_drives):
            raise ExcitationError(
                "the D-efficiency compares motions of one robot with the same torques, found "
                f"{self.parameters} and {other.parameters} parameters"
            )
        return self.d_value / other.d_value if other.d_value else np.inf


@checked(ExcitationError)
def excitation_measures(
    robot: Robot,
    motion: Trajectory | Sequence[Motion],
    torque_joints: str | Sequence[str] | None = None,
) -> ExcitationMeasures:
    """Return measures of a motion that compare across base columns and units.

    Parameters
    ----------
    robot : Robot
        Its nominal values are needed for the parameters of the drives.
    motion : Trajectory or sequence of Motion
        A planned motion, or those of logs.
    torque_joints : sequence of str, optional
        Joints whose torques are known. Default: all.

    Returns
    -------
    ExcitationMeasures

    Examples
    --------
    >>> plan = seaid.load_trajectory("plan.json")
    >>> measures = seaid.excitation.excitation_measures(robot, plan)
    >>> measures.d_efficiency(measures)
    """
    if isinstance(motion, Trajectory):
        check_joint_names(motion, robot)
    check_held(robot, "excitation_measures", ExcitationError)
    robot = robot.at_temperature()
    base = pivoted_base(robot, torque_joints)
    return _measures(robot, motion, torque_joints, base, joint_limits(robot, None).velocity)


def _measures(
    robot: Robot,
    motion: Trajectory | Sequence[Motion],
    torque_joints: str | Sequence[str] | None,
    base: BaseParameters,
    top_speed: Array,
) -> ExcitationMeasures:
    parts = list(_sampled(robot, motion))

    def stacked(target: Target) -> Array:
        return np.vstack([stacked_regressor(target, *part) for part in parts])

    try:
        H, has_drives = stacked(drive_target(robot, torque_joints, base, top_speed)), True
    except SeaidError:  # nominal values are missing
        H, has_drives = stacked(load_target(robot, torque_joints, base)), False
    return _measures_of(H, sum(float(time[-1] - time[0]) for time, _ in parts), has_drives)


def _measures_of(H: Array, duration_s: float, has_drives: bool) -> ExcitationMeasures:
    # rows are weighted to READINGS_HZ a second: per reading, the length does not count
    scaled, d_value = scaled_condition_and_d_value(H / np.sqrt(READINGS_HZ * duration_s))
    return ExcitationMeasures(scaled, d_value, H.shape[1], has_drives)


def _sampled(robot: Robot, motion: Trajectory | Sequence[Motion]) -> Iterator[tuple[Array, States]]:
    """Yield times (T,) and states of a plan, or of each motion of logs."""
    if isinstance(motion, Trajectory):
        time = np.linspace(0.0, motion.duration, _REPORT_SAMPLES)
        q, v, a = robot.drive_states(*motion.sample(time))
        yield time, (q, v, a)
    else:
        n = motion[0].joint_position.shape[1]
        # the regressor of a sample has n rows of 10 n columns
        most = min(_REPORT_SAMPLES, _MOST_NUMBERS // (10 * n**2 * len(motion)))
        for part in motion:
            few = part.samples(slice(None, None, -(-len(part.time) // max(most, _FEWEST_SAMPLES))))
            yield few.time, few.joint_states


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Result):
    """A planned motion, its criterion and its margins to the limits.

    Attributes
    ----------
    trajectory : Trajectory
    condition_number : float
        (16) of the unscaled columns of `base`, over 2000 instants of `trajectory` alone.
    base : BaseParameters
    margins : Margins
        Minimum distances to the `limits` over the whole motion.
    limits : JointLimits
    criterion, value : str, float
        The criterion and its value, previous logs included.
    names, units : tuple of p str
        The parameters of the criterion.
    standard_errors : array (p,)
        Expected ones, for white torque noise of `torque_std` at 1 kHz.
    singular_values, start_singular_values : array (p,)
        Of the scaled observation matrix of the plan, and of the best random start.
    measures : ExcitationMeasures
        Measures that compare with those of other motions, with the drives where values are known.
    stance : StancePlan or None
        Motion of the base and contact forces of a motion in stance.
    """

    table_name = "excitation_table"

    trajectory: Trajectory
    condition_number: float
    base: BaseParameters
    margins: Margins
    limits: JointLimits
    criterion: CriterionName
    value: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    standard_errors: Array
    singular_values: Array
    start_singular_values: Array
    measures: ExcitationMeasures
    stance: StancePlan | None = None

    def _in_short(self) -> str:
        parameters = counted(len(self.names), "parameter")
        return f"{self.trajectory._in_short()}; {parameters}, {self.criterion} {self.value:.4g}"


@checked(ExcitationError)
def design_excitation(
    robot: Robot,
    duration: float,
    *,
    basis: BasisName = "bspline",
    coefficients: int | None = None,
    multisine: Multisine | None = None,
    limits: Limits | None = None,
    rest_to_rest: bool = True,
    start: EndState | None = None,
    end: EndState | None = None,
    torque_joints: str | Sequence[str] | None = None,
    criterion: CriterionName = "condition_number",
    drive_parameters: bool = False,
    torque_std: float | Sequence[float] | dict[str, float] = 1.0,
    previous_logs: Sequence[Log] = (),
    scene: Scene | None = None,
    stance: Stance | Sequence[str] | None = None,
    starts: Annotated[int, Least(1)] = 3,
    iterations: Annotated[int, Least(1)] = 150,
    seed: Seed = 0,
    samples: Annotated[int, Least(6)] | None = None,
    progress: bool = False,
    executor: Executor | None = None,
) -> Excitation:
    """Plan an exciting motion within limits, by minimising a criterion of its regressor (16)-(19).

    Nominal values of the robot are needed only for "relative_error", the drive parameters of
    elastic joints, and limits on torques or drives; otherwise they may be NaN. Ctrl-C ends the
    search and returns the best motion so far; a search that ends early issues a SeaidWarning.

    Parameters
    ----------
    robot : Robot
    duration : float
        Length of the motion [s].
    basis : {"bspline", "polynomial", "fourier", "multisine"}
        Functions of time that compose the motion; "polynomial" is (18). "multisine" is a periodic
        motion for `frequency_response`, of random phases instead of a search: only `limits`,
        `torque_joints`, `torque_std` and `seed` apply to it.
    coefficients : int, optional
        Number of coefficients per joint; by default it grows with the duration.
    multisine : Multisine, optional
        Band, periods, spectrum and amplitudes of a multisine.
    limits : Limits, optional
        Limits that hold over the whole motion. Default: the robot's, see `Limits`.
    rest_to_rest : bool
        Whether an end that is not given is at rest at a free position. If False it may be in
        motion, and `add_run_in` finds a run-in from rest.
    start, end : EndState, optional
        State at the start and at the end.
    torque_joints : sequence of str, optional
        Joints whose torques are known. Default: all.
    criterion : {"condition_number", "d_optimality", "relative_error"}
        The condition number (16), the determinant of the covariance, or the largest expected
        standard error relative to the nominal size of its parameter.
    drive_parameters : bool
        Whether the criterion includes friction, stiffness and the other parameters of the drives,
        besides the base parameters. A condition number scales their columns to the mean norm of the
        base columns, which stay unscaled.
    torque_std : float, sequence of n floats or dict
        Standard deviation of the torques at the joints [N m or N], which weights the rows.
    previous_logs : sequence of Log
        Logs that will be identified together with this motion, as prior information.
    scene : Scene, optional
        Collision pairs, from `load_scene`, whose clearance holds over the whole motion.
    stance : Stance or list of str
        Of a floating base: the contacts that stand on the ground throughout. The motion starts and
        ends at rest in the posture of the stance; the base and the joints that the contacts leave
        free move within limits of joints and contact forces, which the nominal model gives.
    starts, iterations : int
        Random starts of the search (SLSQP with exact gradients) and its iterations: a third of them
        from every start, then all of them from the best.
    seed : int
        The same seed gives the same motion, with any `executor`.
    samples : int, optional
        Instants at which the criterion is evaluated, at least 6, which a spline through them
        needs. Default: four per coefficient, at least 100 and four times as many as the parameters
        need.
    progress : bool
        Whether to show a progress bar on stderr.
    executor : concurrent.futures.Executor, optional
        Runs the starts. Default: processes of this machine.

    Returns
    -------
    Excitation

    Raises
    ------
    ExcitationError
        For invalid arguments, missing nominal values, and if no motion keeps the limits or no
        motion identifies all parameters.

    Examples
    --------
    >>> limits = seaid.Limits(velocity=2.0, joint_torque={"knee": 20.0})
    >>> plan = seaid.design_excitation(robot, 10.0, limits=limits, drive_parameters=True)
    >>> plan.condition_number
    >>> plan.trajectory.save_set_points("plan.csv")
    """
    if stance is None:
        check_held(robot, "design_excitation", ExcitationError)
    else:
        refuse_in_stance(
            basis,
            rest_to_rest=not rest_to_rest,
            start=start is not None,
            end=end is not None,
            drive_parameters=drive_parameters,
            previous_logs=bool(previous_logs),
            scene=scene is not None,
        )
    check_constant_ratios(robot, "design_excitation", ExcitationError)
    limits = limits or Limits()
    bounds = joint_limits(robot, limits)
    if basis == "multisine":
        drives = drive_limits(robot, limits, bounds.velocity)
        motion = multisine_motion(robot, duration, multisine or Multisine(), bounds, drives, seed)
        return _multisine_excitation(robot, motion, torque_joints, torque_std, bounds, drives)
    if multisine is not None:
        raise ExcitationError("multisine= needs basis='multisine'", "basis='multisine'")
    basis_of = partial(_basis_for, basis, duration, coefficients)
    # a plan does not know how warm the motors will be
    cold = robot.at_temperature()
    if stance is None:
        chosen, free = basis_of(robot.n), EndState() if rest_to_rest else IN_MOTION
        space = motion_space(chosen, robot.joint_names, bounds, start or free, end or free)
        if not rest_to_rest:
            space = with_run_in(space, robot.joint_names, bounds)
        base = pivoted_base(cold, torque_joints)
        if drive_parameters:
            target = drive_target(cold, torque_joints, base, bounds.velocity)
        else:
            target = load_target(cold, torque_joints, base)
        drives = drive_limits(robot, limits, bounds.velocity)
        instants = _samples(target, chosen.size, samples)
        problem = make_problem(target, criterion, space, instants, bounds, drives, scene)
        problem = with_feasible_start(problem, seed)
    else:
        requested = stance if isinstance(stance, Stance) else Stance(stance)
        model = standing_robot(cold, requested, bounds, limits, torque_joints)
        space = _standing_space(model, basis_of(len(model.names)))
        base = pivoted_base(cold, torque_joints, model.links)
        model = model.with_base_parameters(base.columns)
        target = load_target(cold, torque_joints, base)
        # the six equations of the base are rows too, before those of the joints
        target = replace(target, row_weights=np.ones(6 + len(target.rows)))
        instants = _samples(target, space.basis.size, samples)
        free_limits = model.free_limits
        problem = make_problem(target, criterion, space, instants, free_limits, None, None, model)
    target = scaled_target(problem, cold, base, torque_std, problem.measure.needs_nominal)
    # After scaling: the factor of previous logs is in the same scaled columns.
    target = replace(target, previous_factor=previous_logs_factor(target, cold, previous_logs))
    problem = replace(problem, target=target)
    outcome, best_start = search(
        problem, starts, iterations, seed, executor=executor, progress=progress
    )
    _warn_if_early(outcome, problem.measure.meaning)
    return _excitation(cold, problem, outcome, best_start, base, bounds)


def _excitation(
    robot: Robot,
    problem: PlanningProblem,
    outcome: Outcome,
    best_start: Array,
    base: BaseParameters,
    bounds: JointLimits,
) -> Excitation:
    x = motion_within(problem, outcome.x)
    basis, coefficients = problem.space.basis, problem.space.coefficients(x)
    time = np.linspace(0.0, basis.duration, _REPORT_SAMPLES)
    known = [robot.joint_names[row] for row in problem.target.rows]
    plain, plan = load_target(robot, known, base), None
    if problem.stance is None:
        slides = tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist())
        trajectory = Trajectory(robot.joint_names, basis, coefficients, slides)
        states = trajectory.sample(time)
    else:
        states = basis.states(time, coefficients)
        trajectory, plan = problem.stance.plan(basis, coefficients, time)
        plain = replace(plain, row_weights=np.ones(6 + len(known)))
    H = observation_matrix(replace(problem, target=plain), time, states)
    R, R_start = factor_of(problem, x), factor_of(problem, best_start)
    # covariance (H^T H)^-1 = R^-1 R^-T: the standard errors are the norms of the rows of R^-1
    inverse, value = np.full_like(R, np.inf), np.inf
    if has_full_rank(R):
        inverse, value = _safely(np.linalg.inv, R), problem.measure.log_value(R)
    measures = _measures_of(H, basis.duration, False)
    if plan is None:
        measures = _measures(robot, trajectory, known, base, bounds.velocity)
    return Excitation(
        trajectory=trajectory,
        condition_number=float(_safely(np.linalg.cond, H)),
        base=base,
        margins=all_margins(problem, x, trajectory, bounds),
        limits=bounds,
        criterion=problem.criterion,
        value=float(np.exp(value)),
        names=problem.target.names,
        units=problem.target.units,
        standard_errors=np.linalg.norm(inverse, axis=1) * problem.target.column_scale,
        singular_values=singular_values(R),
        start_singular_values=singular_values(R_start),
        measures=measures,
        stance=plan,
    )


def _multisine_excitation(
    robot: Robot,
    motion: Trajectory,
    torque_joints: str | Sequence[str] | None,
    torque_std: float | Sequence[float] | dict[str, float],
    bounds: JointLimits,
    drives: DriveLimits | None,
) -> Excitation:
    """Return a multisine with the condition number of the load side, which it need not identify."""
    base = pivoted_base(robot, torque_joints)
    target = load_target(robot, torque_joints, base)
    std = positive_values(robot, "torque_std", torque_std, np.ones(robot.n))[[*target.rows]]
    target = replace(target, row_weights=1 / std)
    # a problem without variables, whose only motion is the multisine
    free = np.zeros((motion.basis.size, 0))
    space = MotionSpace(motion.basis, motion.coefficients, bounds.half_range, free)
    instants = _samples(target, motion.basis.size, None)
    problem = make_problem(target, "condition_number", space, instants, bounds, drives, None)
    return _excitation(robot, problem, Outcome(0.0, nothing := np.zeros(0)), nothing, base, bounds)


def _standing_space(model: StandingRobot, basis: Basis) -> MotionSpace:
    """Return the motions of the planned coordinates from the posture and back, at rest."""
    end = EndState(position=model.start)
    space = motion_space(basis, model.names, model.free_limits, end, end)
    # `standing_robot` has checked that the robot can stand in the posture within all limits
    return replace(space, feasible_start=np.outer(basis.constant, model.start))


def _basis_for(basis: BasisName, duration: float, coefficients: int | None, joints: int) -> Basis:
    """Return the basis; by default the number of coefficients is by duration and joints."""
    if coefficients is None:
        # three spans per second, at most 160 over all joints, which bounds the variables; a
        # quintic has five coefficients more than spans. Of the 12 of seven spans the states at both
        # ends fix six. A polynomial is one function of the whole motion: its 18 do not grow.
        spans = min(3.0 * duration, 160.0 / joints) if duration > 0 else 0.0
        count = 18 if basis == "polynomial" else 5 + max(7, round(spans))
        # odd: 2 N + 1 of N harmonics
        coefficients = count - 1 + count % 2 if basis == "fourier" else count
    return make_basis(basis, duration, coefficients)


def _samples(target: Target, size: int, samples: int | None) -> int:
    """Return the number of instants of the criterion.

    Default: four per coefficient, at least 100 and four times as many as the parameters need.
    """
    rows = len(target.row_weights)
    needed = -(-len(target.names) // rows)
    if samples is None:
        return max(100, 4 * size, 4 * needed)
    if samples < needed:
        raise ExcitationError(
            f"{samples} samples of {rows} torques cannot identify {target.description}; "
            f"give at least {needed}"
        )
    return int(samples)


def _warn_if_early(outcome: Outcome, meaning: str) -> None:
    if outcome.early:
        warnings.warn(
            f"the search for an excitation ended early: {outcome.early}; the motion keeps all "
            f"limits, its {meaning} is {np.exp(outcome.value):.4g}",
            SeaidWarning,
            stacklevel=4,
        )
