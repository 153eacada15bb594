"""Both sides of the springs of several conditions: the rows of all in one regression a side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate

import numpy as np
from scipy import linalg

from seaid.arrays import Array
from seaid.estimation.checks import TermTest, independent_rows, term_test
from seaid.estimation.estimate import Estimate
from seaid.estimation.estimators import Estimator
from seaid.estimation.information import information_of
from seaid.estimation.solve import settled_weights
from seaid.motion import Motion
from seaid.regression import Regression, actuator_regression
from seaid.robot import Robot
from seaid.sides.found import joined, spring_of, with_flags
from seaid.sides.load_model import LoadModel
from seaid.sides.load_side import load_regression
from seaid.sides.records import Record, rows_of
from seaid.sides.sequential import Fit, Sides, split_load_side, sprung
from seaid.sides.shared_columns import SharedRows, placed_carried, shared_rows

BODIES = "bodies"
"""Stands in `own` for all base parameters."""


@dataclass(frozen=True, eq=False)
class ConditionSide:
    """One side of all conditions: its rows, and the fit of them."""

    rows: Mapping[str, Regression]
    shared: SharedRows
    fit: Fit

    def of(self, condition: str) -> Estimate:
        """Return a condition's estimate."""
        return self.shared.of(condition, self.fit.estimate)

    def differences(self) -> dict[str, TermTest]:
        """Return {own parameter: test of whether the conditions differ in it}."""
        names = list(self.fit.estimate.names)
        groups: dict[str, list[int]] = {}
        for place, name in enumerate(names):
            if name.endswith("]"):
                groups.setdefault(name.rsplit(" [", 1)[0], []).append(place)
        change = np.eye(len(names))
        for columns in groups.values():  # the first is what is common, the others differ from it
            change[columns, columns[0]] = 1.0
        rows = self.shared.rows
        information = information_of(replace(rows, H=rows.H @ change))
        independent = independent_rows(self.fit.information, self.fit.estimate)
        if independent <= len(names):
            return {}
        weights = settled_weights(information)
        return {
            name: term_test(information, weights, [names[c] for c in columns[1:]], independent)
            for name, columns in groups.items()
        }


@dataclass(frozen=True, eq=False)
class ConditionSides:
    """Both sides of all conditions: the `actuators` by joint, and the load of `springs` joints."""

    robots: Mapping[str, Robot]
    models: Mapping[str, LoadModel]
    actuators: Mapping[str, ConditionSide]
    load: ConditionSide
    springs: tuple[str, ...]

    def differences(self) -> dict[str, TermTest]:
        """Return {own parameter (of a joint): test of whether the conditions differ in it}."""
        return {
            f"{name} of {joint}": test
            for joint, side in self.actuators.items()
            for name, test in side.differences().items()
        } | self.load.differences()

    def of(self, condition: str) -> Sides:
        """Return one condition's part of all fits, as `identify` would."""
        robot, model = self.robots[condition], self.models[condition]
        drives = {
            joint: with_flags(side.of(condition), joint, information_of(side.rows[condition]))
            for joint, side in self.actuators.items()
        }
        load_side, fit = self.load.of(condition), self.load.fit
        white = replace(fit.estimate, covariance=fit.white_covariance)
        base, others = split_load_side(model, load_side)
        found = joined(drives, others)
        sides = {**self.actuators, "load": self.load}
        return Sides(
            drivetrains={joint: found[joint] for joint in robot.joint_names if joint in found},
            load=base,
            load_side=load_side,
            springs={
                joint: spring_of(robot, drives[joint], joint).values for joint in self.springs
            },
            left_out={name: side.rows[condition].left_out for name, side in sides.items()},
            checks={name: side.fit.checks(robot.joint_names, ()) for name, side in sides.items()},
            white_covariance=self.load.shared.of(condition, white).covariance,
        )


def condition_sides(
    robots: Mapping[str, Robot],
    records: Mapping[str, Sequence[Record]],
    models: Mapping[str, LoadModel],
    own: Sequence[str],
    solver: Estimator,
) -> ConditionSides:
    """Return both sides of {condition: robot}, one after the other; `own` as `identify_conditions`.

    Raises IdentificationError where the conditions do not have the same columns.
    """
    name, first = next(iter(robots.items()))
    springs = sprung(first, records[name], models[name])
    actuators = {
        joint: _actuator(robots, records, joint, own, solver) for joint in first.elastic_joints
    }
    load = _load(robots, records, models, springs, actuators, own, solver)
    return ConditionSides(robots, models, actuators, load, springs)


def _actuator(
    robots: Mapping[str, Robot],
    records: Mapping[str, Sequence[Record]],
    joint: str,
    own: Sequence[str],
    solver: Estimator,
) -> ConditionSide:
    rows = {
        name: rows_of(records[name], partial(_actuator_rows, robots[name], joint))
        for name in robots
    }
    names = next(iter(rows.values())).names
    is_own = [name in own or f"{name} of {joint}" in own for name in names]
    return _fitted(rows, is_own, solver, None)


def _actuator_rows(robot: Robot, joint: str, motion: Motion) -> Regression:
    return actuator_regression(robot, motion, joint)


def _load(
    robots: Mapping[str, Robot],
    records: Mapping[str, Sequence[Record]],
    models: Mapping[str, LoadModel],
    joints: Sequence[str],
    actuators: Mapping[str, ConditionSide],
    own: Sequence[str],
    solver: Estimator,
) -> ConditionSide:
    """Fit (8) of all conditions, with the uncertainty of the springs that they share."""
    first = next(iter(models))
    counts = [len(actuators[joint].fit.estimate.names) for joint in joints]
    starts = list(accumulate(counts, initial=0))
    covariances = [actuators[joint].fit.estimate.covariance for joint in joints]
    rows = {}
    for name, robot in robots.items():
        springs = {joint: spring_of(robot, actuators[joint].of(name), joint) for joint in joints}
        values = {joint: spring.values for joint, spring in springs.items()}
        one = rows_of(records[name], partial(_load_rows, robot, models[name], values))
        places = [
            int(start)
            + actuators[joint].shared.places[name][actuators[joint].shared.names.index(p)]
            for joint, start in zip(joints, starts, strict=False)
            for p in springs[joint].names
        ]
        rows[name] = placed_carried(one, places, int(starts[-1]))
    bodies = len(models[first].expressions)
    is_own = [BODIES in own] * bodies + [
        name in own or name.split(" of ")[0] in own for name in models[first].names[bodies:]
    ]
    carried = linalg.block_diag(*covariances) if covariances else None
    return _fitted(rows, is_own, solver, carried)


def _load_rows(
    robot: Robot, model: LoadModel, springs: Mapping[str, Array], motion: Motion
) -> Regression:
    return load_regression(robot, motion, model, springs)


def _fitted(
    rows: Mapping[str, Regression], own: Sequence[bool], solver: Estimator, carried: Array | None
) -> ConditionSide:
    shared = shared_rows(rows, own)
    estimate = solver.solve(shared.rows, carried)
    seen = solver.seen(shared.rows, estimate)
    return ConditionSide(rows, shared, Fit(estimate, information_of(seen), seen, carried))
