"""The planning problem (16)-(19) over free variables x: value, gradient, limits and scaling."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation.basis import matrices
from seaid.excitation.boundary import MotionSpace, limit_rows
from seaid.excitation.collision import Scene, distance_gradients, distances
from seaid.excitation.criteria import (
    CRITERIA,
    Criterion,
    CriterionName,
    States,
    has_full_rank,
    triangular_factor,
)
from seaid.excitation.flatness import check_nominal_bodies
from seaid.excitation.limits import (
    DRIVE_KINDS,
    DriveLimits,
    JointLimits,
    Margins,
    drive_load_gradient,
    drive_loads,
    largest_factor,
    margins,
    positive_values,
)
from seaid.excitation.observation_matrix import (
    Target,
    reading_weights,
    regressor_pull_back,
    stacked_regressor,
)
from seaid.excitation.stance import StandingRobot
from seaid.excitation.trajectory import Trajectory
from seaid.log import Log, reconstruct_motion, row_samples
from seaid.regressor import BaseParameters
from seaid.robot import Robot

TARGET_USE = 0.97
"""Share of a limit, evaluated at instants only, that the search may use."""

_SAFE = 0.985
"""Share from which motions are scaled back: SLSQP may exceed TARGET_USE slightly."""

_SCENE_REACH_M = 0.1
"""Distance [m] beyond the clearance at which a pair uses nothing of its limit."""

_WINDOW = 10
"""Consecutive instants of which a limit has one constraint, at the worst of them."""


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """Minimise a criterion over the free variables x (n k,), k of each of n joints, within limits.

    `maps` are 3 matrices M (T, k) and `start_states` is (3, T, n), for position, velocity and
    acceleration: those of joint j at `time` (T,) are start_j + half_range_j (M x_j). The linear
    limits hold at every instant if |rows[j] x_j + offset[j]| <= 1, with `rows` (n, g, c, k) in g
    groups of c consecutive ones. In a `stance` the n joints are its planned coordinates, those of
    the base first.
    """

    target: Target
    criterion: CriterionName
    space: MotionSpace
    time: Array
    maps: tuple[Array, Array, Array]
    start_states: Array
    rows: Array
    offset: Array
    drive_limits: DriveLimits | None
    scene: Scene | None
    stance: StandingRobot | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Number of joints and of free variables per joint."""
        return self.rows.shape[0], self.rows.shape[3]

    @property
    def measure(self) -> Criterion:
        """The criterion of that name."""
        return CRITERIA[self.criterion]


def make_problem(
    target: Target,
    criterion: CriterionName,
    space: MotionSpace,
    samples: int,
    limits: JointLimits,
    drives: DriveLimits | None,
    scene: Scene | None,
    stance: StandingRobot | None = None,
) -> PlanningProblem:
    """Return the problem with a number of equally spaced instants."""
    instants, linear = _at_instants(space, samples), limit_rows(space, limits)
    return PlanningProblem(target, criterion, space, *instants, *linear, drives, scene, stance)


def recentred(problem: PlanningProblem, x: Array) -> PlanningProblem:
    """Return the problem with the motion x as its origin."""
    joints = x.reshape(problem.shape)
    # linear limits about the new origin: |rows (x + dx) + offset| <= 1
    return replace(
        problem,
        space=replace(problem.space, feasible_start=problem.space.coefficients(x)),
        start_states=np.stack(states_of(problem, x)),
        offset=problem.offset + np.einsum("jgck,jk->jgc", problem.rows, joints),
    )


def _at_instants(
    space: MotionSpace, samples: int
) -> tuple[Array, tuple[Array, Array, Array], Array]:
    time = np.linspace(0.0, space.basis.duration, samples)
    tables = matrices(space.basis, time)
    position, velocity, acceleration = (table @ space.free for table in tables)
    start_states = np.stack([table @ space.feasible_start for table in tables])
    return time, (position, velocity, acceleration), start_states


def states_of(problem: PlanningProblem, x: Array) -> States:
    """Return q, v and a of x, each (T, n)."""
    joints = x.reshape(problem.shape).T
    q, v, a = (
        start_states + problem.space.half_range * (matrix @ joints)
        for start_states, matrix in zip(problem.start_states, problem.maps, strict=True)
    )
    return q, v, a


def observation_matrix(problem: PlanningProblem, time: Array, states: States) -> Array:
    """Return the weighted and scaled observation matrix (T rows, columns), (15)."""
    target = problem.target
    if problem.stance is None:
        return stacked_regressor(target, time, states)
    H = problem.stance.observed_rows(states) * reading_weights(target, time)
    return (H * target.column_scale).reshape(-1, len(target.names))


def _pull_back(problem: PlanningProblem, states: States, G: Array) -> States:
    """Return d value / d states, each (T, n), from G = d value / d H of `observation_matrix`."""
    target, time = problem.target, problem.time
    if problem.stance is None:
        return regressor_pull_back(target, time, states, G)
    G = G.reshape(len(time), len(target.row_weights), -1) * target.column_scale
    return problem.stance.pull_back(states, G * reading_weights(target, time))


def factor_of(problem: PlanningProblem, x: Array) -> Array:
    """Return the triangular factor of the observation matrix of x and the previous logs."""
    H = observation_matrix(problem, problem.time, states_of(problem, x))
    return triangular_factor(H, problem.target.previous_factor)


def value_of(problem: PlanningProblem, x: Array) -> float:
    """Return the log of the criterion, infinite if a parameter is unidentifiable."""
    R = factor_of(problem, x)
    return problem.measure.log_value(R) if has_full_rank(R) else np.inf


def value_and_gradient(problem: PlanningProblem, x: Array) -> tuple[float, Array]:
    """Return the smooth criterion and its exact gradient (n k,), zero where it is infinite."""
    states = states_of(problem, x)
    H = observation_matrix(problem, problem.time, states)
    R = triangular_factor(H, problem.target.previous_factor)
    if not has_full_rank(R):
        return np.inf, np.zeros(x.size)
    value, slope = problem.measure.smooth(R)
    # d value = sum((H S) * dH) with S = `slope`; then q = start + half_range * (map @ x_j) gives
    # the gradient by x: (T, n) at the instants -> (k, n) -> (n k,), joint by joint
    gradients = _pull_back(problem, states, H @ slope)
    by_joint = [matrix.T @ part for matrix, part in zip(problem.maps, gradients, strict=True)]
    return value, np.ravel((problem.space.half_range * np.sum(by_joint, axis=0)).T)


def linear_use(problem: PlanningProblem, x: Array) -> Array:
    """Return the share of its linear limits that each joint uses between 0 and x (n,)."""
    used = np.einsum("jgck,jk->jgc", problem.rows, x.reshape(problem.shape))
    # from 0 to x, rows x + offset goes from offset to +1 or -1: the room is 1 -+ offset
    room = np.where(used > 0, 1.0 - problem.offset, 1.0 + problem.offset)
    return np.asarray((np.abs(used) / room).max(axis=(1, 2)))


def linear_slack(problem: PlanningProblem, x: Array) -> tuple[Array, Array]:
    """Return the smallest slack of each group of rows (2 n g,), and its derivative."""
    # SLSQP solves a quadratic program over all constraints: of each group of consecutive rows it
    # gets only the largest and the least, whose rows are the derivatives
    used = np.einsum("jgck,jk->jgc", problem.rows, x.reshape(problem.shape)) + problem.offset
    highest, lowest = used.argmax(axis=2), used.argmin(axis=2)
    slack = np.concatenate([1.0 - used.max(axis=2).ravel(), 1.0 + used.min(axis=2).ravel()])
    (n, k), groups = problem.shape, highest.shape[1]
    gradient = np.zeros((2, n, groups, n, k))
    order = np.arange(groups)
    for joint in range(n):
        gradient[0, joint, :, joint] = -problem.rows[joint, order, highest[joint]]
        gradient[1, joint, :, joint] = problem.rows[joint, order, lowest[joint]]
    return slack, gradient.reshape(2 * n * groups, n * k)


def has_nonlinear_limits(problem: PlanningProblem) -> bool:
    """Return whether there are limits that are not linear in x."""
    return any(limit is not None for limit in (problem.drive_limits, problem.scene, problem.stance))


def nonlinear_use(problem: PlanningProblem, x: Array) -> tuple[Array, Array]:
    """Return the used shares (m,) of the limits on drives and distances, and derivatives (m, n k).

    There is one entry per limit and ten instants, the largest there.
    """
    states, parts = states_of(problem, x), []
    if problem.drive_limits is not None:
        parts.append(_drive_use(problem, problem.drive_limits, states))
    if problem.scene is not None:
        parts.append(_scene_use(problem, problem.scene, states))
    if problem.stance is not None:
        instants = range(0, len(problem.time), _WINDOW)
        parts.append(
            problem.stance.worst_shares(states, instants, problem.maps, problem.space.half_range)
        )
    return (
        np.concatenate([use for use, _ in parts]),
        np.concatenate([gradient.reshape(len(gradient), -1) for _, gradient in parts]),
    )


def largest_nonlinear_use(problem: PlanningProblem, x: Array) -> float:
    """Return the largest used share of a limit on drives or distances, 0 without any."""
    states, most = states_of(problem, x), 0.0
    if problem.drive_limits is not None:
        loads = np.abs(drive_loads(problem.drive_limits, problem.time, states))
        most = float(np.max(loads.max(axis=1) / problem.drive_limits.largest))
    if problem.scene is not None:
        scene = problem.scene
        closest = distances(scene, states[0], cap_m=_cap(scene)).min()
        most = max(most, float(_use_of_distance(problem.scene, closest)))
    if problem.stance is not None:
        most = max(most, float(problem.stance.used_shares(states).max()))
    return most


def scaled_into_limits(problem: PlanningProblem, x: Array) -> Array:
    """Return x with each joint (or, for drives and distances, all) scaled into the limits."""
    joints = x.reshape(problem.shape)
    return scaled_into_nonlinear_limits(
        problem, np.ravel(joints / np.maximum(linear_use(problem, x), 1.0)[:, None]), _SAFE
    )


def scaled_into_nonlinear_limits(problem: PlanningProblem, x: Array, most: float) -> Array:
    """Return x, scaled towards zero until no drive or distance uses more than `most` of a limit."""
    if not has_nonlinear_limits(problem):
        return x
    # x = 0 keeps all limits, see `with_feasible_start`
    return x * largest_factor(lambda factor: largest_nonlinear_use(problem, factor * x) <= most)


def random_start(problem: PlanningProblem, rng: np.random.Generator) -> Array:
    """Return a random x within limits that uses 60 to 95 % of each joint's linear ones."""
    joints = rng.normal(size=problem.shape)
    share = rng.uniform(0.6, 0.95, problem.shape[0])
    x = np.ravel(joints * (share / linear_use(problem, joints.ravel()))[:, None])
    return scaled_into_limits(problem, x)


def _drive_use(
    problem: PlanningProblem, limits: DriveLimits, states: States
) -> tuple[Array, Array]:
    """Return the used shares (L b,) of L limits on drives in b blocks of instants, and derivatives.

    The derivatives are (L b, n, k). Each share is that of the worst instant of its block.
    """
    loads = drive_loads(limits, problem.time, states)
    # (L, 2): kind and joint of each limit; then its worst instant in every block of ten, (L b,)
    limited = np.argwhere(np.isfinite(limits.largest))
    starts = np.arange(0, len(problem.time), _WINDOW)
    kinds, joints = (np.repeat(column, len(starts)) for column in limited.T)
    largest = limits.largest[tuple(limited.T)][:, None]
    used = np.abs(loads[limited[:, 0], :, limited[:, 1]]) / largest
    instants = np.concatenate(
        [start + used[:, start : start + _WINDOW].argmax(axis=1)[:, None] for start in starts], 1
    ).ravel()
    picked = (kinds, instants, joints)
    gradient = drive_load_gradient(limits, problem.time, states, loads, picked, problem.maps)
    signed = loads[kinds, instants, joints] / limits.largest[kinds, joints]
    # d |load| = sign(load) d load
    factor = np.sign(signed) / limits.largest[kinds, joints]
    return np.abs(signed), gradient * factor[:, None, None] * problem.space.half_range[:, None]


def _scene_use(problem: PlanningProblem, scene: Scene, states: States) -> tuple[Array, Array]:
    """Return the used shares (b,) of the distance limit in b blocks of instants, and derivatives.

    The derivatives are (b, n, k), by the nearest pair at the worst instant of each block.
    """
    far = distances(scene, states[0], cap_m=_cap(scene))
    starts = np.arange(0, len(problem.time), _WINDOW)
    instants = np.array(
        [start + int(far[start : start + _WINDOW].min(axis=1).argmin()) for start in starts]
    )
    near, slopes = distance_gradients(scene, states[0][instants], cap_m=_cap(scene))
    closest = near.argmin(axis=1)
    order = np.arange(len(instants))
    # use = 1 - (distance - clearance) / reach, by the nearest pair at that instant
    by_position = -slopes[order, closest] * problem.space.half_range / _SCENE_REACH_M
    gradient = by_position[:, :, None] * problem.maps[0][instants][:, None, :]
    return _use_of_distance(scene, near[order, closest]), gradient


def _cap(scene: Scene) -> float:
    """Return the distance beyond which pairs need not be evaluated."""
    return scene.clearance_m + _SCENE_REACH_M


def _use_of_distance(scene: Scene, distance: Array) -> Array:
    """Return the used share of a distance limit: 1 at the clearance, less beyond it."""
    return 1.0 - (distance - scene.clearance_m) / _SCENE_REACH_M


def constraints(problem: PlanningProblem, nonlinear: bool = True) -> list[dict[str, Any]]:
    """Return the limits as constraints of scipy's SLSQP, with or without the nonlinear ones."""
    constraints = [_constraint(partial(linear_slack, problem))]
    if nonlinear and has_nonlinear_limits(problem):
        constraints.append(_constraint(partial(_nonlinear_slack, problem)))
    return constraints


def _nonlinear_slack(problem: PlanningProblem, x: Array) -> tuple[Array, Array]:
    use, gradient = nonlinear_use(problem, x)
    return TARGET_USE - use, -gradient


def _constraint(slack: Callable[[Array], tuple[Array, Array]]) -> dict[str, Any]:
    """Return a function, with its derivative, as a constraint that caches its last results."""
    # SLSQP evaluates each x twice. It is cached as bytes, since arrays are not hashable.
    cached = lru_cache(maxsize=2)(lambda x: slack(np.frombuffer(x)))
    return {
        "type": "ineq",
        "fun": lambda x: cached(x.tobytes())[0],
        "jac": lambda x: cached(x.tobytes())[1],
    }


_FINER, _MOST_INSTANTS = 8, 2000
"""Instants of the fine grid over those of the search, and how many it has at most."""


def motion_within(problem: PlanningProblem, x: Array) -> Array:
    """Return x, scaled towards zero if a limit is broken between the instants of the search."""
    return scaled_into_nonlinear_limits(_on_fine_grid(problem), x, 1.0)


def all_margins(
    problem: PlanningProblem, x: Array, trajectory: Trajectory, bounds: JointLimits
) -> Margins:
    """Return the margins of x: linear ones at every instant, the others on a finer grid."""
    # the knots of a trajectory by inverse kinematics are dense as they are
    margin = (
        margins(trajectory, bounds) if problem.stance is None else margins(trajectory, bounds, [0])
    )
    if not has_nonlinear_limits(problem):
        return margin
    fine = _on_fine_grid(problem)
    states = states_of(fine, x)
    if fine.drive_limits is not None:
        most = np.abs(drive_loads(fine.drive_limits, fine.time, states)).max(axis=1)
        remaining = fine.drive_limits.largest - most
        margin = replace(margin, **dict(zip(DRIVE_KINDS, remaining, strict=True)))
    if fine.scene is not None:
        margin = replace(margin, distance_m=float(distances(fine.scene, states[0]).min()))
    if fine.stance is not None:
        most = np.abs(fine.stance.joint_torques(states)).max(axis=0)
        margin = replace(margin, joint_torque=fine.stance.torque_limits - most)
    return margin


def _on_fine_grid(problem: PlanningProblem) -> PlanningProblem:
    samples = len(problem.time)
    count = min(_FINER * samples, max(_MOST_INSTANTS, samples))
    time, maps, start_states = _at_instants(problem.space, count)
    return replace(problem, time=time, maps=maps, start_states=start_states)


_REFERENCES = 3
"""Random motions by whose columns the parameters are scaled."""

_SMALL, _UNCOUNTED = 0.1, 10.0
"""Least nominal size over the median of its unit; scale of parameters without a nominal size, over
the largest column, so that their relative errors stay below the others."""

_BLOCK = 400
"""Samples at once: the differentiation matrices of a block are (400, 400)."""


def scaled_target(
    problem: PlanningProblem,
    robot: Robot,
    base: BaseParameters,
    torque_std: float | Sequence[float] | Mapping[str, float],
    relative: bool,
) -> Target:
    """Return the problem's target with row weights and column scales.

    Rows are divided by `torque_std`. A `relative` criterion multiplies columns by the nominal size
    of their parameter; parameters without one, as offsets, get a scale at which they do not affect
    the criterion. Otherwise base columns stay unscaled, and each drive column gets the geometric
    mean norm of the base columns. Norms are over three random motions within limits, the same for
    every seed. Raises ExcitationError if a nominal value is missing.
    """
    std = positive_values(robot, "torque_std", torque_std, np.ones(robot.n))
    motors = [robot.index(joint) for joint in robot.elastic_joints] if problem.target.blocks else []
    weights = 1.0 / std[[*problem.target.rows, *motors]]
    if problem.stance is not None:  # the six equations of the base have no torque of their own
        weights = np.concatenate([np.full(6, np.mean(weights)), weights])
    target = replace(problem.target, row_weights=weights)
    if not relative and not target.blocks:
        return target
    rng = np.random.default_rng(0)
    motions = [states_of(problem, random_start(problem, rng)) for _ in range(_REFERENCES)]
    weighted = replace(problem, target=target)
    H = np.vstack([observation_matrix(weighted, problem.time, states) for states in motions])
    norms, p = np.linalg.norm(H, axis=0), len(target.base_columns)
    if np.any(norms == 0):
        lost = target.names[int(np.argmin(norms))]
        raise ExcitationError(f"no motion within these limits identifies the {lost}")
    if relative:
        sizes = _sizes(target, robot, base)
        scale = np.where(np.isnan(sizes), _UNCOUNTED * np.nanmax(sizes * norms) / norms, sizes)
    else:
        scale = np.exp(np.mean(np.log(norms[:p]))) / norms
        scale[:p] = 1.0
    return replace(target, column_scale=scale)


def previous_logs_factor(target: Target, robot: Robot, logs: Sequence[Log]) -> Array:
    """Return the factor (., columns) of previous logs at their cutoffs, scaled as the target."""
    factor = np.empty((0, len(target.names)))
    for log in logs:
        motion = reconstruct_motion(robot, log)
        picked = row_samples(motion)
        for start in range(0, len(picked), _BLOCK):
            rows = picked[start : start + _BLOCK]
            if len(rows) > 5:  # an interpolating quintic needs six samples
                q, v, a = (state[rows] for state in motion.joint_states)
                H = stacked_regressor(target, motion.time[rows], (q, v, a))
                factor = triangular_factor(H, factor)
    return factor


def _sizes(target: Target, robot: Robot, base: BaseParameters) -> Array:
    """Return the nominal size (p,), at least a tenth of the median of its unit, or NaN."""
    check_nominal_bodies(robot)
    sizes = list(np.abs(base.project(robot.parameters)))
    for block in target.blocks:
        values = robot.drives[robot.joint_names[block.joint]].values
        sizes += [values.get(block.regressor.names[index], np.nan) for index in block.picked]
    nominal, units = np.array(sizes), np.array(target.units)
    for unit in set(target.units):
        same_unit = units == unit
        positive = nominal[same_unit & (nominal > 0)]
        if positive.size:
            nominal[same_unit] = np.maximum(nominal[same_unit], _SMALL * np.median(positive))
    return np.where(nominal > 0, nominal, np.nan)
