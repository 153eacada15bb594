"""How the rows and columns of a criterion are scaled, and what recorded logs tell already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seaid.arrays import Array
from seaid.base import BaseParameters
from seaid.errors import ExcitationError
from seaid.excitation.criteria import triangular_factor
from seaid.excitation.flatness import check_nominal_bodies
from seaid.excitation.limits import positive_values
from seaid.excitation.problem import Problem, random_start, states_of
from seaid.excitation.target import Target
from seaid.excitation.target_regressor import stacked_regressor
from seaid.log import Log
from seaid.motion import reconstruct_motion
from seaid.motion_rows import row_samples
from seaid.robot import Robot
from seaid.sides.found import nominal_values

_REFERENCES = 3
_SMALL, _UNCOUNTED = 0.1, 10.0
_BLOCK = 400


def scaled_target(
    problem: Problem,
    robot: Robot,
    base: BaseParameters,
    torque_std: float | Sequence[float] | Mapping[str, float],
    relative: bool,
) -> Target:
    """Return the problem's target with weights of rows and scales of columns.

    Rows are divided by `torque_std`. Columns are multiplied by the nominal size of their parameter
    where the criterion is `relative` (those that have none, as offsets, so much that they do not
    count). Otherwise base columns stay raw, and each drive column gets the geometric mean norm of
    the base columns. Norms are those over three random motions within limits, the same for every
    seed. Raises ExcitationError where a nominal value is missing.
    """
    std = positive_values(robot, "torque_std", torque_std, np.ones(robot.n))
    motors = [robot.index(joint) for joint in robot.elastic_joints] if problem.target.blocks else []
    target = replace(problem.target, row_weights=1.0 / std[[*problem.target.rows, *motors]])
    if not relative and not target.blocks:
        return target
    rng = np.random.default_rng(0)
    motions = [states_of(problem, random_start(problem, rng)) for _ in range(_REFERENCES)]
    H = np.vstack([stacked_regressor(target, problem.time, states) for states in motions])
    norms, p = np.linalg.norm(H, axis=0), len(target.base_columns)
    if np.any(norms == 0):
        lost = target.names[int(np.argmin(norms))]
        raise ExcitationError(f"no motion within these limits tells the {lost}")
    if relative:
        sizes = _sizes(target, robot, base)
        scale = np.where(np.isnan(sizes), _UNCOUNTED * np.nanmax(sizes * norms) / norms, sizes)
    else:
        scale = np.exp(np.mean(np.log(norms[:p]))) / norms
        scale[:p] = 1.0
    return replace(target, column_scale=scale)


def recorded_factor(target: Target, robot: Robot, logs: Sequence[Log]) -> Array:
    """Return the triangular factor (., columns) of what recorded logs tell, scaled as the target.

    Of the joints' motion in the logs' own pass band; a log that does not fit the robot raises
    LogError.
    """
    factor = np.empty((0, len(target.names)))
    for log in logs:
        motion = reconstruct_motion(robot, log)
        picked = row_samples(motion)
        for start in range(0, len(picked), _BLOCK):
            rows = picked[start : start + _BLOCK]
            if len(rows) > 5:  # a quintic through its samples needs six
                q, v, a = (state[rows] for state in motion.joint_states)
                H = stacked_regressor(target, motion.time[rows], (q, v, a))
                factor = triangular_factor(H, factor)
    return factor


def _sizes(target: Target, robot: Robot, base: BaseParameters) -> Array:
    """Return the nominal size of every parameter (p,), NaN of those that have none.

    That of one that is nearly zero is a tenth of the median of its kind, by unit.
    """
    check_nominal_bodies(robot)
    sizes = list(np.abs(base.project(robot.parameters)))
    for block in target.blocks:
        values = nominal_values(robot.drivetrains[robot.joint_names[block.joint]])
        sizes += [values.get(block.regressor.names[index], np.nan) for index in block.picked]
    found, units = np.array(sizes), np.array(target.units)
    for unit in set(target.units):
        mine = units == unit
        positive = found[mine & (found > 0)]
        if positive.size:
            found[mine] = np.maximum(found[mine], _SMALL * np.median(positive))
    return np.where(found > 0, found, np.nan)
