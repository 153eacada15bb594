"""Both sides of the springs at once, from the estimate of one after the other on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial

import numpy as np

from seaid.arrays import Array
from seaid.estimation.estimators import Estimator
from seaid.estimation.information import information_of
from seaid.motion import Motion
from seaid.regression import Regression
from seaid.robot import Robot
from seaid.sides.found import spring_of
from seaid.sides.joint_sides import (
    joint_regression,
    joint_zero_sensitivity,
    settled,
    split_joint,
    whitened,
)
from seaid.sides.load_model import LoadModel
from seaid.sides.method_limits import check_joint_sides
from seaid.sides.records import Record, rows_of
from seaid.sides.sequential import Fit, Sides


def simultaneous_sides(
    robot: Robot,
    records: Sequence[Record],
    model: LoadModel,
    start: Sides,
    estimator: Estimator,
    joint_zero_std: float,
    executor: Executor | None,
) -> Sides:
    """Return both sides at once; `whole` has the covariance between them.

    (7) and (8) are rows of one regression that shares each spring; see `joint_sides`. Raises
    IdentificationError where the iteration does not settle, and for springs that cannot be shared.
    """
    springs = tuple(start.springs)
    check_joint_sides(robot, springs)
    regress: Callable[[Motion], Regression]
    regress = partial(joint_regression, robot, model=model, springs=springs)
    rows = rows_of(records, regress, executor)
    whole, _ = settled(
        robot, rows, _values(rows, start), lambda found: estimator.solve(found, None)
    )
    zeros: Array | None = None
    if joint_zero_std > 0:
        theta = whole.values
        regress = partial(joint_zero_sensitivity, robot, model=model, springs=springs, theta=theta)
        rows = rows_of(records, regress, executor)
        zeros = joint_zero_std**2 * np.eye(robot.n)
        whole, _ = settled(robot, rows, theta, lambda found: estimator.solve(found, zeros))
    drives, load, load_side = split_joint(robot, model, whole)
    solved = estimator.seen(whitened(robot, rows, whole.values), whole)
    fit = Fit(whole, information_of(solved), solved, zeros)
    optional = [
        name
        for name in whole.names
        if name not in model.expressions and not name.startswith(("stiffness", "deflection_offset"))
    ]
    return Sides(
        drivetrains=drives,
        load=load,
        load_side=load_side,
        springs={joint: spring_of(robot, drives[joint], joint).values for joint in springs},
        left_out=start.left_out,
        checks={"both": fit.checks(robot.joint_names, optional)},
        white_covariance=fit.white_covariance,
        whole=whole,
    )


def _values(rows: Regression, start: Sides) -> Array:
    """Return the sequential estimate in the columns of the rows."""
    known = {
        f"{name} of {joint}": value
        for joint, drive in start.drivetrains.items()
        for name, value in zip(drive.names, drive.values, strict=True)
    }
    known |= dict(zip(start.load_side.names, start.load_side.values, strict=True))
    return np.array([known[name] for name in rows.names])
