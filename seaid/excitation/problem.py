"""The planning problem (16)-(19) over free variables x: its value, its gradient, its limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array
from seaid.excitation.criteria import Criterion, criterion_named, tells_all, triangular_factor
from seaid.excitation.drive_limits import DriveLimits, drive_load_gradient, drive_loads
from seaid.excitation.ends import MotionSpace, limit_rows
from seaid.excitation.gradient import States
from seaid.excitation.limits import JointLimits
from seaid.excitation.scene import Scene, distance_gradients, distances
from seaid.excitation.target import Target
from seaid.excitation.target_regressor import regressor_pull_back, stacked_regressor

AIM = 0.97
"""The search keeps to this part of the limits that it sees at instants only."""

_SAFE = 0.985
_SCENE_REACH_M = 0.1
_INSTANTS = 10
_BISECTIONS = 14


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimise a criterion over x (n k,), within limits.

    Coefficients are those of `space`; `maps` (3) of (T, k) give position, velocity and acceleration
    at `time` (T,) for joints of unit range, `home` (3, T, n) those at x = 0. Joint j keeps its
    linear limits at every instant where |rows[j] x_j + offset[j]| <= 1; `rows` (n, g, c, k).
    """

    target: Target
    criterion: str
    space: MotionSpace
    time: Array
    maps: tuple[Array, Array, Array]
    home: Array
    half_range: Array
    rows: Array
    offset: Array
    drive_limits: DriveLimits | None
    scene: Scene | None

    @property
    def shape(self) -> tuple[int, int]:
        """Number of joints and of free variables a joint."""
        return self.rows.shape[0], self.rows.shape[3]

    @property
    def measure(self) -> Criterion:
        """The criterion by its name."""
        return criterion_named(self.criterion)


def make_problem(
    target: Target,
    criterion: str,
    space: MotionSpace,
    samples: int,
    limits: JointLimits,
    drives: DriveLimits | None,
    scene: Scene | None,
) -> Problem:
    """Return the problem that looks at so many equally spaced instants."""
    rows, offset = limit_rows(space, limits)
    time, maps, home = _at_instants(space, samples)
    half_range = limits.half_range
    return Problem(
        target, criterion, space, time, maps, home, half_range, rows, offset, drives, scene
    )


def seen_at(problem: Problem, samples: int) -> Problem:
    """Return the problem looking at another number of instants."""
    time, maps, home = _at_instants(problem.space, samples)
    return replace(problem, time=time, maps=maps, home=home)


def counted_from(problem: Problem, x: Array) -> Problem:
    """Return the problem with the motion x as its home."""
    joints = x.reshape(problem.shape)
    return replace(
        problem,
        space=replace(problem.space, home=problem.space.coefficients(x)),
        home=np.stack(states_of(problem, x)),
        offset=problem.offset + np.einsum("jgck,jk->jgc", problem.rows, joints),
    )


def _at_instants(
    space: MotionSpace, samples: int
) -> tuple[Array, tuple[Array, Array, Array], Array]:
    time = np.linspace(0.0, space.basis.duration, samples)
    position, velocity, acceleration = space.basis.matrices(time)
    maps = (position @ space.free, velocity @ space.free, acceleration @ space.free)
    home = np.stack([matrix @ space.home for matrix in (position, velocity, acceleration)])
    return time, maps, home


def states_of(problem: Problem, x: Array) -> States:
    """Return q, v and a of x, each (T, n)."""
    joints = x.reshape(problem.shape).T
    q, v, a = (
        home + problem.half_range * (matrix @ joints)
        for home, matrix in zip(problem.home, problem.maps, strict=True)
    )
    return q, v, a


def value_of(problem: Problem, x: Array) -> float:
    """Return the log of the criterion, infinite where the motion does not tell all parameters."""
    H = stacked_regressor(problem.target, problem.time, states_of(problem, x))
    R = triangular_factor(H, problem.target.known)
    return problem.measure.log_value(R) if tells_all(R) else np.inf


def value_and_gradient(problem: Problem, x: Array) -> tuple[float, Array]:
    """Return the smooth criterion and its exact gradient (n k,); infinity has none (zero)."""
    states = states_of(problem, x)
    H = stacked_regressor(problem.target, problem.time, states)
    R = triangular_factor(H, problem.target.known)
    if not tells_all(R):
        return np.inf, np.zeros(x.size)
    value, slope = problem.measure.smooth(R)
    gradients = regressor_pull_back(problem.target, problem.time, states, H @ slope)
    by_joint = [matrix.T @ part for matrix, part in zip(problem.maps, gradients, strict=True)]
    return value, np.ravel((problem.half_range * np.sum(by_joint, axis=0)).T)


def linear_use(problem: Problem, x: Array) -> Array:
    """Return how much of its linear limits each joint uses on its way from x = 0 (n,): 1 is all."""
    used = np.einsum("jgck,jk->jgc", problem.rows, x.reshape(problem.shape))
    room = np.where(used > 0, 1.0 - problem.offset, 1.0 + problem.offset)
    return np.asarray((np.abs(used) / room).max(axis=(1, 2)))


def linear_slack(problem: Problem, x: Array) -> tuple[Array, Array]:
    """Return what each group of rows leaves above and below (2 n g,), and its derivative.

    A group counts as its largest: a maximum of linear functions has the same feasible set, and its
    derivative is the row that is largest.
    """
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


def is_curved(problem: Problem) -> bool:
    """Tell whether there are limits that are not linear in x."""
    return problem.drive_limits is not None or problem.scene is not None


def curved_use(problem: Problem, x: Array) -> tuple[Array, Array]:
    """Return how much of the limits on drives and distances is used, and its derivative.

    One entry (m,) a limit and ten instants, the largest there: 1 is all of a limit. The derivative
    is (m, n k).
    """
    states, parts = states_of(problem, x), []
    if problem.drive_limits is not None:
        parts.append(_drive_use(problem, problem.drive_limits, states))
    if problem.scene is not None:
        parts.append(_scene_use(problem, problem.scene, states))
    return (
        np.concatenate([use for use, _ in parts]),
        np.concatenate([gradient.reshape(len(gradient), -1) for _, gradient in parts]),
    )


def most_curved_use(problem: Problem, x: Array) -> float:
    """Return the largest part of a limit on drives or distances that is used; 0 without any."""
    states, most = states_of(problem, x), 0.0
    if problem.drive_limits is not None:
        loads = np.abs(drive_loads(problem.drive_limits, problem.time, states))
        most = float(np.max(loads.max(axis=1) / problem.drive_limits.most))
    if problem.scene is not None:
        closest = _capped(problem.scene, states[0]).min()
        most = max(most, float(_use_of_distance(problem.scene, closest)))
    return most


def drawn_inside(problem: Problem, x: Array) -> Array:
    """Return x, drawn towards zero until no limit is broken.

    A joint that breaks a linear limit alone; all of them while a drive or a distance breaks one.
    """
    joints = x.reshape(problem.shape)
    return drawn_together(
        problem, np.ravel(joints / np.maximum(linear_use(problem, x), 1.0)[:, None]), _SAFE
    )


def drawn_together(problem: Problem, x: Array, most: float) -> Array:
    """Return x, drawn towards zero until no drive or distance uses more than `most` of a limit."""
    if not is_curved(problem) or most_curved_use(problem, x) <= most:
        return x
    inside, outside = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        kept = most_curved_use(problem, middle * x) <= most
        inside, outside = (middle, outside) if kept else (inside, middle)
    return inside * x


def random_start(problem: Problem, rng: np.random.Generator) -> Array:
    """Return a random x within limits: each joint uses 60 to 95 percent of the linear ones."""
    joints = rng.normal(size=problem.shape)
    share = rng.uniform(0.6, 0.95, problem.shape[0])
    x = np.ravel(joints * (share / linear_use(problem, joints.ravel()))[:, None])
    return drawn_inside(problem, x)


def _drive_use(problem: Problem, limits: DriveLimits, states: States) -> tuple[Array, Array]:
    loads = drive_loads(limits, problem.time, states)
    limited = np.argwhere(np.isfinite(limits.most))
    starts = np.arange(0, len(problem.time), _INSTANTS)
    kinds, joints = (np.repeat(column, len(starts)) for column in limited.T)
    used = np.abs(loads[limited[:, 0], :, limited[:, 1]]) / limits.most[tuple(limited.T)][:, None]
    instants = np.concatenate(
        [start + used[:, start : start + _INSTANTS].argmax(axis=1)[:, None] for start in starts], 1
    ).ravel()
    picked = (kinds, instants, joints)
    maps = problem.maps
    gradient = drive_load_gradient(limits, problem.time, states, loads, picked, maps)
    signed = loads[kinds, instants, joints] / limits.most[kinds, joints]
    factor = np.sign(signed) / limits.most[kinds, joints]
    return np.abs(signed), gradient * factor[:, None, None] * problem.half_range[:, None]


def _scene_use(problem: Problem, scene: Scene, states: States) -> tuple[Array, Array]:
    far = _capped(scene, states[0])
    starts = np.arange(0, len(problem.time), _INSTANTS)
    instants = np.array(
        [start + int(far[start : start + _INSTANTS].min(axis=1).argmin()) for start in starts]
    )
    near, slopes = distance_gradients(scene, states[0][instants], cap_m=_cap(scene))
    closest = near.argmin(axis=1)
    order = np.arange(len(instants))
    by_position = -slopes[order, closest] * problem.half_range / _SCENE_REACH_M
    gradient = by_position[:, :, None] * problem.maps[0][instants][:, None, :]
    return _use_of_distance(scene, near[order, closest]), gradient


def _capped(scene: Scene, q: Array) -> Array:
    return distances(scene, q, cap_m=_cap(scene))


def _cap(scene: Scene) -> float:
    """Return the distance beyond which no limit is near: farther pairs need not be looked at."""
    return scene.clearance_m + _SCENE_REACH_M


def _use_of_distance(scene: Scene, distance: Array) -> Array:
    """Return 1 at the clearance, less where it is farther."""
    return 1.0 - (distance - scene.clearance_m) / _SCENE_REACH_M
