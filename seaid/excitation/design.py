"""design_excitation: the motion within limits that tells the parameters best, (17)-(19)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from seaid.base import BaseParameters
from seaid.errors import ExcitationError, SeaidWarning
from seaid.excitation.basis import Basis, make_basis
from seaid.excitation.criterion import Criterion, condition_number, make_criterion, pivoted_base
from seaid.excitation.limits import Limits, Margins, joint_limits, limit_rows, margins
from seaid.excitation.search import Outcome, Problem, search
from seaid.excitation.trajectory import Trajectory
from seaid.robot import Robot

_REPORT_SAMPLES = 2000


@dataclass(frozen=True, eq=False)
class Excitation:
    """A planned motion and what it tells.

    `condition_number` (16) is raw, of the columns of `base`, over 2000 instants of `trajectory`;
    `margins` are the least distances to the limits over the whole motion.
    """

    trajectory: Trajectory
    condition_number: float
    base: BaseParameters
    margins: Margins


def design_excitation(
    robot: Robot,
    duration: float,
    *,
    basis: str = "bspline",
    coefficients: int | None = None,
    limits: Limits | None = None,
    rest_to_rest: bool = True,
    rows: Sequence[str] | None = None,
    starts: int = 3,
    iterations: int = 150,
    seed: int = 0,
    samples: int | None = None,
    progress: bool = False,
    executor: Executor | None = None,
) -> Excitation:
    """Plan a motion of `duration` [s] that tells the rigid-body parameters of the robot well.

    Minimises the log of the condition number (16) of the stacked base regressor (15) over the
    `coefficients` (so many a joint) of a "bspline", a "polynomial" (18) or a "fourier" series, by
    SLSQP with the exact gradient: a third of the `iterations` from each of the random `starts`,
    then all of them from the best. The `limits` (default: the robot's, see `Limits`) hold at every
    instant, not only at the `samples` that the criterion looks at. `rest_to_rest`: zero velocity
    and acceleration at both ends. `rows` names the joints whose torques are known (default all).
    The inertial parameters of the robot are not used and may be NaN.

    The same seed gives the same motion, whatever `executor` (concurrent.futures) runs the starts.
    `progress` shows a bar on stderr. Ctrl-C ends the search and gives the best motion so far; a
    search that ends early says so in a SeaidWarning. Raises ExcitationError for a duration,
    coefficients, limits or rows that cannot be planned with.
    """
    for name, count in (("starts", starts), ("iterations", iterations)):
        if count < 1:
            raise ExcitationError(f"{name} must be at least 1, found {count}")
    count = _coefficients(robot, basis, duration) if coefficients is None else coefficients
    function = make_basis(basis, duration, count, rest_to_rest=rest_to_rest)
    bounds = joint_limits(robot, limits)
    base = pivoted_base(robot, rows)
    criterion = make_criterion(robot, rows, base)
    free = function.free_coefficients(rest_to_rest=rest_to_rest)
    time = np.linspace(0.0, duration, _samples(criterion, function, samples))
    position, velocity, acceleration = (matrix @ free for matrix in function.matrices(time))
    problem = Problem(
        criterion, bounds, (position, velocity, acceleration), limit_rows(function, free, bounds)
    )
    found = search(problem, starts, iterations, seed, executor=executor, progress=progress)
    _warn_if_early(found)
    trajectory = Trajectory(
        robot.joint_names,
        function,
        np.outer(function.constant, bounds.middle)
        + bounds.half_range * (free @ found.x.reshape(problem.shape).T),
        tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist()),
    )
    instants = np.linspace(0.0, duration, _REPORT_SAMPLES)
    kappa = condition_number(criterion, *trajectory.sample(instants))
    return Excitation(trajectory, kappa, base, margins(trajectory, bounds))


def _coefficients(robot: Robot, basis: str, duration: float) -> int:
    """Return how many coefficients a joint: more for longer motions, fewer for many joints."""
    if basis == "polynomial":
        return 18
    spans = min(3.0 * duration, 160.0 / robot.n) if duration > 0 else 0.0
    count = 5 + max(7, round(spans))
    return count - 1 + count % 2 if basis == "fourier" else count


def _samples(criterion: Criterion, function: Basis, samples: int | None) -> int:
    """Return how many instants the criterion looks at: four a coefficient unless given."""
    needed = -(-len(criterion.columns) // len(criterion.rows))
    if samples is None:
        return max(100, 4 * function.size, 4 * needed)
    if samples < needed:
        raise ExcitationError(
            f"{samples} samples of {len(criterion.rows)} torques cannot tell "
            f"{len(criterion.columns)} base parameters; give at least {needed}"
        )
    return int(samples)


def _warn_if_early(found: Outcome) -> None:
    if found.early:
        warnings.warn(
            f"the search for an excitation ended early: {found.early}; the motion keeps all "
            f"limits, its condition number is {np.exp(found.value):.4g}",
            SeaidWarning,
            stacklevel=3,
        )
