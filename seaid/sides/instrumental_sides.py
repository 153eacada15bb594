"""Both sides by instrumental variables, the instruments from the estimate before, iterated."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from seaid.arrays import Array
from seaid.errors import IdentificationError
from seaid.estimation.estimate import Estimate
from seaid.estimation.estimators import Estimator
from seaid.estimation.instrumental import instrumental
from seaid.regression import Regression
from seaid.robot import Robot
from seaid.sides.found import spring_of
from seaid.sides.instruments import (
    FittedModel,
    Maker,
    actuator_with_instruments,
    apart,
    instrument_motion,
    load_with_instruments,
    motor_driven_motion,
)
from seaid.sides.load_model import LoadModel
from seaid.sides.method_limits import check_instruments, straight_spring
from seaid.sides.records import Record
from seaid.sides.sequential import Regressions, Sides, sequential_sides

SETTLED = 0.01
"""Part of a standard error below which new instruments change nothing."""

_NOTHING = 1e-6
"""Part of a standard error that is rounding."""

_MOST_ITERATIONS = 20


def instrumental_sides(
    robot: Robot,
    records: Sequence[Record],
    model: LoadModel,
    start: Sides,
    joint_zero_std: float,
    executor: Executor | None,
) -> Sides:
    """Return both sides, one after the other, from a `start` as least squares gives it.

    The instruments are those of `seaid.sides.instruments` with the estimate before, until no
    parameter moves by more than a small part of its standard error (Janot, Vandanjon and Gautier
    2014): first of smoothed joint positions, which need no good estimate, then on the load side of
    joints that the motors drive. Where the latter diverge or do not settle the former stay, and a
    flag says so; so does one where all drives are stiff, and instruments change nothing.
    Raises IdentificationError where that does not come, and as `instrumental` does.
    """
    run = partial(
        _settled,
        robot,
        records,
        model,
        joint_zero_std=joint_zero_std,
        executor=executor,
    )
    found = run(start, make=instrument_motion)
    try:
        found = run(found, make=motor_driven_motion)
    except IdentificationError as problem:
        return _flagged(
            found,
            "instruments of the load side are those of the smoothed joint encoders, whose noise "
            f"may bias the base parameters: {problem}",
        )
    if max(_moved(start, found).values()) < _NOTHING:
        return _flagged(
            found,
            "instrumental variables give what least squares gives: behind stiff drives the motor's "
            "encoder is the instrument, and the motion is that of the same encoder",
        )
    return found


def _flagged(found: Sides, flag: str) -> Sides:
    return replace(found, load=replace(found.load, flags=(*found.load.flags, flag)))


def _settled(
    robot: Robot,
    records: Sequence[Record],
    model: LoadModel,
    found: Sides,
    make: Maker,
    joint_zero_std: float,
    executor: Executor | None,
) -> Sides:
    """Return both sides once new instruments change nothing; `make` is for the load side's."""
    estimator = Estimator(_solve, seen=_seen)
    for _ in range(_MOST_ITERATIONS):
        fitted = _fitted(robot, model, found)
        regressions = Regressions(
            partial(actuator_with_instruments, fitted=fitted),
            partial(load_with_instruments, fitted=fitted, make=make),
        )
        before, found = (
            found,
            sequential_sides(
                robot, records, model, estimator, joint_zero_std, executor, False, regressions
            ),
        )
        moved = {name: step for name, step in _moved(before, found).items() if step > SETTLED}
        if not moved:
            return found
    worst = max(moved, key=lambda name: moved[name])
    raise IdentificationError(
        f"instrumental variables did not settle in {_MOST_ITERATIONS} iterations: {worst} still "
        f"moves by {moved[worst]:.2g} standard errors; move that joint more, or use "
        "estimator='wls'"
    )


def _fitted(robot: Robot, model: LoadModel, sides: Sides) -> FittedModel:
    springs = {
        joint: spring_of(robot, sides.drivetrains[joint], joint).values
        for joint in model.rows
        if joint in robot.elastic_joints
    }
    check_instruments(robot, springs)
    bad = [
        joint
        for joint, values in springs.items()
        if straight_spring(robot, joint, values).stiffness <= 0
    ]
    if bad:
        raise IdentificationError(
            f"the stiffness of {', '.join(bad)} was found not positive: the fitted model predicts "
            "no deflection; load this spring more, or use estimator='wls'"
        )
    return FittedModel(model, sides.load_side.values, springs)


def _solve(rows: Regression, carried: Array | None) -> Estimate:
    return instrumental(*apart(rows), carried)


def _seen(rows: Regression, estimate: Estimate) -> Regression:
    return apart(rows)[0]


def _moved(before: Sides, after: Sides) -> dict[str, float]:
    """Return how far each parameter moved, in standard errors."""
    moved: dict[str, float] = {}
    pairs = [("load", before.load_side, after.load_side)] + [
        (joint, before.drivetrains[joint], one) for joint, one in after.drivetrains.items()
    ]
    for where, old, new in pairs:
        steps = np.abs(new.values - old.values) / np.maximum(new.standard_errors, 1e-300)
        steps[np.abs(new.values - old.values) <= 1e-9 * np.abs(new.values)] = 0.0
        moved |= {f"{name} of {where}": float(s) for name, s in zip(new.names, steps, strict=True)}
    return moved
