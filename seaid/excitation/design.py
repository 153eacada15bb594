"""design_excitation: the motion within limits that tells the parameters best, (17)-(19)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from seaid._arrays import Array, safely, seed_of
from seaid.errors import ExcitationError, SeaidWarning
from seaid.excitation.basis import make_basis
from seaid.excitation.boundary import IN_MOTION, EndState, motion_space
from seaid.excitation.collision import Scene
from seaid.excitation.criteria import (
    criterion_named,
    pivoted_base,
    singular_values,
    tells_all,
    triangular_factor,
)
from seaid.excitation.limits import JointLimits, Limits, Margins, drive_limits, joint_limits
from seaid.excitation.objective import Target, drive_target, load_target, stacked_regressor
from seaid.excitation.problem import (
    Problem,
    all_margins,
    make_problem,
    motion_within,
    recorded_factor,
    scaled_target,
    states_of,
)
from seaid.excitation.run_in import with_run_in
from seaid.excitation.search import Outcome, search, with_feasible_home
from seaid.excitation.trajectory import Trajectory
from seaid.log import Log
from seaid.regressor import BaseParameters
from seaid.robot import Robot

_REPORT_SAMPLES = 2000

_safely = partial(safely, what="the regressor of the motion", error=ExcitationError)


@dataclass(frozen=True, eq=False)
class Excitation:
    """A planned motion and what it tells.

    `condition_number` (16) is raw, of the columns of `base`, over 2000 instants of `trajectory`
    alone. `criterion` and `value` tell what was made small; `names` and `units` (p,) the parameters
    asked for, `standard_errors` (p,) what to expect of them from white torque noise of `torque_std`
    at 1 kHz. `singular_values` (p,) are those of the criterion's scaled regressor, recorded logs
    included, `start_singular_values` those of the best random start. `limits` are what the motion
    keeps, `margins` the least distances to them over the whole motion.
    """

    trajectory: Trajectory
    condition_number: float
    base: BaseParameters
    margins: Margins
    limits: JointLimits
    criterion: str
    value: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    standard_errors: Array
    singular_values: Array
    start_singular_values: Array


def design_excitation(
    robot: Robot,
    duration: float,
    *,
    basis: str = "bspline",
    coefficients: int | None = None,
    limits: Limits | None = None,
    rest_to_rest: bool = True,
    start: EndState | None = None,
    end: EndState | None = None,
    torque_joints: Sequence[str] | None = None,
    criterion: str = "condition_number",
    drive_parameters: bool = False,
    torque_std: float | Sequence[float] | dict[str, float] = 1.0,
    previous_logs: Sequence[Log] = (),
    scene: Scene | None = None,
    starts: int = 3,
    iterations: int = 150,
    seed: int = 0,
    samples: int | None = None,
    progress: bool = False,
    executor: Executor | None = None,
) -> Excitation:
    """Plan a motion of `duration` [s] that tells the parameters of the robot well.

    The motion has so many `coefficients` a joint of a "bspline", a "polynomial" (18) or a "fourier"
    series. `start` and `end` are its `EndState`s; those not given are at rest at a free position,
    or free if not `rest_to_rest` (`add_run_in` then finds a way there from rest). The `limits`
    (default: the robot's, see `Limits`) and the clearances of a `scene` hold over the whole motion.

    `criterion`: "condition_number" (16), "d_optimality" (log det of the information), or
    "relative_error" (the worst expected standard error relative to the parameter's nominal size).
    It is that of the base parameters, from the torques of the joints `rows` (default all), and with
    `drive_parameters` of friction, stiffness and what else the drives have as well. Rows are
    torques at the joints over their `torque_std` [N m or N], a number, one a joint or {joint:
    value}. Base columns are raw in a condition number; drive columns are scaled to the same mean
    norm there. `previous_logs` logs count as told already: the motion is the one that helps most
    after them. Only "relative_error", the drive columns of elastic joints, and limits on torque or
    drives use the robot's nominal values; otherwise they may be NaN.

    The search is SLSQP with the exact gradient: a third of the `iterations` from each of the random
    `starts`, then all of them from the best; it looks at so many `samples` (default: four a
    coefficient). The same seed gives the same motion, whatever `executor` (concurrent.futures; by
    default processes of this machine) runs the starts. `progress` shows a bar on stderr. Ctrl-C
    ends the search and gives the best motion so far; a search that ends early says so in a
    SeaidWarning. Raises ExcitationError for what cannot be planned with.
    """
    measure = criterion_named(criterion)
    for name, count in (("starts", starts), ("iterations", iterations)):
        if count < 1:
            raise ExcitationError(f"{name} must be at least 1, found {count}")
    seed = seed_of(seed, ExcitationError)
    count = _coefficients(robot, basis, duration) if coefficients is None else coefficients
    function = make_basis(basis, duration, count)
    bounds = joint_limits(robot, limits)
    drives = drive_limits(robot, limits or Limits(), bounds.velocity)
    others = EndState() if rest_to_rest else IN_MOTION
    space = motion_space(function, robot.joint_names, bounds, start or others, end or others)
    if not rest_to_rest:
        space = with_run_in(space, robot.joint_names, bounds)
    base = pivoted_base(robot, torque_joints)
    target = (
        drive_target(robot, torque_joints, base, bounds.velocity)
        if drive_parameters
        else load_target(robot, torque_joints, base)
    )
    instants = _samples(target, function.size, samples)
    problem = make_problem(target, criterion, space, instants, bounds, drives, scene)
    problem = with_feasible_home(problem, seed)
    target = scaled_target(problem, robot, base, torque_std, measure.needs_nominal)
    target = replace(target, known=recorded_factor(target, robot, previous_logs))
    problem = replace(problem, target=target)
    found, begin = search(problem, starts, iterations, seed, executor=executor, progress=progress)
    _warn_if_early(found, measure.meaning)
    return _excitation(robot, problem, found, begin, base, bounds)


def _excitation(
    robot: Robot,
    problem: Problem,
    found: Outcome,
    begin: Array,
    base: BaseParameters,
    bounds: JointLimits,
) -> Excitation:
    x = motion_within(problem, found.x)
    trajectory = Trajectory(
        robot.joint_names,
        problem.space.basis,
        problem.space.coefficients(x),
        tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist()),
    )
    time = np.linspace(0.0, trajectory.duration, _REPORT_SAMPLES)
    plain = load_target(robot, [robot.joint_names[row] for row in problem.target.rows], base)
    kappa = _safely(np.linalg.cond, stacked_regressor(plain, time, trajectory.sample(time)))
    R, R_begin = (_factor(problem, x) for x in (x, begin))
    target = problem.target
    inverse = _safely(np.linalg.inv, R) if tells_all(R) else np.full_like(R, np.inf)
    return Excitation(
        trajectory=trajectory,
        condition_number=float(kappa),
        base=base,
        margins=all_margins(problem, x, trajectory, bounds),
        limits=bounds,
        criterion=problem.criterion,
        value=float(np.exp(problem.measure.log_value(R))),
        names=target.names,
        units=target.units,
        standard_errors=np.linalg.norm(inverse, axis=1) * target.column_scale,
        singular_values=singular_values(R),
        start_singular_values=singular_values(R_begin),
    )


def _factor(problem: Problem, x: Array) -> Array:
    H = stacked_regressor(problem.target, problem.time, states_of(problem, x))
    return triangular_factor(H, problem.target.known)


def _coefficients(robot: Robot, basis: str, duration: float) -> int:
    """Return how many coefficients a joint: more for longer motions, fewer for many joints."""
    if basis == "polynomial":
        return 18
    spans = min(3.0 * duration, 160.0 / robot.n) if duration > 0 else 0.0
    count = 5 + max(7, round(spans))
    return count - 1 + count % 2 if basis == "fourier" else count


def _samples(target: Target, size: int, samples: int | None) -> int:
    """Return how many instants the criterion looks at: four a coefficient unless given."""
    rows = len(target.row_weights)
    needed = -(-len(target.names) // rows)
    if samples is None:
        return max(100, 4 * size, 4 * needed)
    if samples < needed:
        raise ExcitationError(
            f"{samples} samples of {rows} torques cannot tell {target.asked}; "
            f"give at least {needed}"
        )
    return int(samples)


def _warn_if_early(found: Outcome, meaning: str) -> None:
    if found.early:
        warnings.warn(
            f"the search for an excitation ended early: {found.early}; the motion keeps all "
            f"limits, its {meaning} is {np.exp(found.value):.4g}",
            SeaidWarning,
            stacklevel=3,
        )
