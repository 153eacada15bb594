"""Motor constants need something known: else every parameter could be larger by a factor.

The paper's two parts: the actuator side (10) of each spring, then the load side (8).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy import linalg

from seaid._arrays import Array, safely
from seaid._progress import track
from seaid.errors import IdentificationError
from seaid.estimation import (
    Change,
    Estimate,
    Estimator,
    Information,
    ModelChecks,
    StoredRows,
    estimate_of,
    estimate_of_rows,
    information_of,
    model_checks,
    settled_weights,
    stored_estimate,
    stored_rows,
    unchanged,
    whiteness,
)
from seaid.identification.datasets import Record, first_motion, rows_of
from seaid.identification.drive_estimates import joined, spring_of, with_flags
from seaid.identification.errors_in_variables import both_noisy, noise_ratio, springs_torque_alone
from seaid.log import LongLog, Motion
from seaid.regressor import (
    LoadModel,
    Regression,
    actuator_regression,
    load_regression,
    spring_regressor,
    zero_sensitivity,
)
from seaid.robot import Robot, group_of

CONSTANTS = {"torque_constant": "current", "voltage_constant": "voltage"}
"""Parameters that turn what is logged of a motor into its torque."""

_ROUNDING = 1e-9

_LOST, _PART = 1e-7, 0.01
"""A combination of columns that is lost, and the least part of it that a constant has then."""

_LOAD_SIDE = "known bodies (known_bodies=), logs with and without a payload (identify_conditions), "
_SPRING = "the stiffness of its spring (known = ['stiffness']), "


def check_scale(information: Information) -> None:
    """Raise IdentificationError where a motor constant is unknown and nothing fixes the scale.

    Then the equations are homogeneous, and least squares finds zero for all that is in them. A
    payload that is always there does not help: it could as well be part of its body.
    """
    places = {
        place: name.split(" of ", 1)
        for place, name in enumerate(information.names)
        if name.split(" of ", 1)[0] in CONSTANTS
    }
    if not places or not information.count:  # without any row `solve` says so
        return
    R, p = information.weighted_factor(), len(information.names)
    norms = np.linalg.norm(R[:, :p], axis=0)
    U, sizes, Vt = safely(
        np.linalg.svd, R[:p, :p] / np.where(norms > 0, norms, 1.0), what="the scale of the torques"
    )
    told = sizes > _LOST * sizes[0]
    theta = Vt[told].T @ ((U.T @ R[:p, p])[told] / sizes[told])
    least = _ROUNDING * float(np.linalg.norm(R[:, p]))
    open_part = np.max(np.abs(Vt[~told]), axis=0, initial=0.0)
    for place, (name, *where) in places.items():
        if abs(theta[place]) <= least or open_part[place] > _PART:
            joint = where[0] if where else information.joint_names[information.equations[0]]
            raise IdentificationError(
                f"of the motor of {joint} only the {CONSTANTS[name]} was logged, and nothing known "
                f"tells its {name.replace('_', ' ')}: all torques could be larger by a factor. "
                f"Give one of: {_LOAD_SIDE if where else _SPRING}its rotor inertia, or the "
                f"constant itself (known = ['{name}'])"
            )


_LOAD_KEY = ""
"""Names the load side among equations that are named by their joint."""

_NEEDED = ("stiffness", "deflection_offset", "deflection_zero")

INPUT_FIELDS = {
    "torque": "motor_torque",
    "current": "motor_current",
    "voltage": "motor_voltage",
}
"""The field of a motion that has a drive's input."""


@dataclass(frozen=True, eq=False)
class Sides:
    """What both sides of the springs told, as `Identification` has it.

    `springs` {joint: stiffness and offset} whose torque is that on the load; `checks` and
    `left_out` by joint, and "load" for the load side. `whole` is the estimate of both sides where
    it is one; `white_covariance` (p, p) what the covariance of that, or else of `load_side`, would
    be if the noise were white.
    """

    drivetrains: Mapping[str, Estimate]
    load: Estimate
    load_side: Estimate
    springs: Mapping[str, Array]
    left_out: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    white_covariance: Array
    whole: Estimate | None = None


@dataclass(frozen=True)
class Regressions:
    """What makes rows of a motion: `actuator` of a joint, `load` of a model and its springs."""

    actuator: Callable[[Robot, Motion, str], Regression] = actuator_regression
    load: Callable[[Robot, Motion, LoadModel, Mapping[str, Array]], Regression] = load_regression


@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate, the information behind it, and the rows if they were kept in memory.

    `settled` are the equations' weights (E,) if the estimate was weighted by those that settle.
    """

    estimate: Estimate
    information: Information
    rows: Regression | None
    carried: Array | None
    settled: Array | None = None

    @cached_property
    def weights(self) -> Array:
        """The weights (E,) of the equations that settle, whatever the estimator weighs by."""
        return settled_weights(self.information) if self.settled is None else self.settled

    @property
    def white_covariance(self) -> Array:
        """The covariance (p, p) if the noise of every equation were white."""
        return estimate_of(self.information, self.weights, None, self.carried).covariance

    def checks(self, joints: Sequence[str], optional: Sequence[str]) -> ModelChecks:
        """Return what speaks for and against the model; `joints` are those of the robot."""
        found = {} if self.rows is None else whiteness(self.rows, self.estimate.values)
        named = {joints[index % len(joints)]: one for index, one in found.items()}
        return model_checks(self.information, self.estimate, optional, named, self.weights)


def fitted(
    records: Sequence[Record],
    regress: Callable[[Motion], Regression],
    estimator: Estimator,
    carried: Array | None,
    executor: Executor | None,
) -> Fit:
    """Return the fit of the rows of all records: in memory, or streamed where all are long logs.

    The weights of the equations are settled once, and handed on with the fit.
    """
    long_logs = _streamed(records, estimator, executor)
    if long_logs:
        with stored_rows(long_logs, {"": regress}) as stored:
            return _fitted_to(stored[""], estimator, carried)
    rows = rows_of(records, regress, executor)
    if estimator.weigh is not None:
        information = information_of(rows)
        check_scale(information)
        weights = estimator.weigh(information)
        estimate = estimate_of_rows(rows, information, weights, carried)
        settled = weights if estimator.weigh is settled_weights else None
        return Fit(estimate, information, rows, carried, settled)
    if any(name.split(" of ")[0] in CONSTANTS for name in rows.names):
        check_scale(information_of(rows))
    estimate = estimator.solve(rows, carried)
    seen = estimator.seen(rows, estimate)
    return Fit(estimate, information_of(seen), seen, carried)


def _streamed(
    records: Sequence[Record], estimator: Estimator, executor: Executor | None
) -> list[LongLog]:
    """Return the long logs if the records are nothing else and can be streamed, otherwise none."""
    long_logs = [record for record in records if isinstance(record, LongLog)]
    streamed = len(long_logs) == len(records) and executor is None and estimator.weigh is not None
    return long_logs if streamed else []


def _fitted_to(
    stored: StoredRows, estimator: Estimator, carried: Array | None, change: Change = unchanged
) -> Fit:
    """Return the fit of stored rows."""
    weigh = estimator.weigh or settled_weights
    estimate, information = stored_estimate(stored, weigh, carried, change)
    check_scale(information)
    return Fit(estimate, information, None, carried)


def sequential_sides(
    robot: Robot,
    records: Sequence[Record],
    model: LoadModel,
    estimator: Estimator,
    joint_zero_std: float,
    executor: Executor | None,
    progress: bool,
    regressions: Regressions = Regressions(),
) -> Sides:
    """Return both sides, one after the other: the springs' uncertainty is carried to the load.

    `regressions` make the rows, in columns that `estimator` knows and `seen` turns into the plain
    ones.
    """
    drives, checks, left_out = {}, {}, {}
    joints = sprung(robot, records, model)
    equations = {
        joint: partial(_of_actuator, robot, regressions, joint) for joint in robot.elastic_joints
    }
    long_logs = _streamed(records, estimator, executor)
    unloaded = partial(_of_load, robot, regressions, model, _without_torque(robot, joints))
    with stored_rows(long_logs, {**equations, _LOAD_KEY: unloaded} if long_logs else {}) as stored:
        for joint, regress in track(list(equations.items()), "actuator side", progress):
            if stored:
                fit = _fitted_to(stored[joint], estimator, None)
            else:
                fit = fitted(records, regress, estimator, None, executor)
                if (
                    estimator.weigh
                    and springs_torque_alone(robot, records, joint)
                    and fit.rows is not None
                ):
                    noisy = both_noisy(fit.rows, noise_ratio(robot, records, joint))
                    fit = replace(fit, estimate=noisy)
            drives[joint] = with_flags(fit.estimate, joint, fit.information)
            optional = [name for name in fit.estimate.names if name not in _NEEDED]
            checks[joint] = fit.checks(robot.joint_names, optional)
            left_out[joint] = fit.information.left_out
        springs = {joint: spring_of(robot, drives[joint], joint) for joint in joints}
        for _ in track([0], "load side", progress):
            load = _load_side(
                *(robot, records, model, springs, estimator),
                *(joint_zero_std, executor, regressions, stored.get(_LOAD_KEY)),
            )
    base, beside = split_load_side(model, load.estimate)
    found = joined(drives, beside)
    return Sides(
        drivetrains={joint: found[joint] for joint in robot.joint_names if joint in found},
        load=base,
        load_side=load.estimate,
        springs={joint: spring.values for joint, spring in springs.items()},
        left_out=left_out | {"load": load.information.left_out},
        checks=checks
        | {"load": load.checks(robot.joint_names, model.names[len(model.expressions) :])},
        white_covariance=load.white_covariance,
    )


def known_torques(robot: Robot, records: Sequence[Record]) -> tuple[str, ...]:
    """Return the joints whose torque is measured, by a sensor or by a spring."""
    motions = [first_motion(record) for record in records]
    return tuple(
        joint
        for joint in robot.joint_names
        if joint in robot.elastic_joints
        or _all_measured(robot, motions, joint, INPUT_FIELDS[robot.drivetrains[joint].motor_input])
        or _all_measured(robot, motions, joint, "joint_torque")
    )


def sprung(robot: Robot, records: Sequence[Record], model: LoadModel) -> tuple[str, ...]:
    """Return the joints of the model whose torque on the load is that of their spring."""
    motions = [first_motion(record) for record in records]
    return tuple(
        joint
        for joint in model.rows
        if joint in robot.elastic_joints
        and not _all_measured(robot, motions, joint, "joint_torque")
    )


def _all_measured(robot: Robot, motions: Sequence[Motion], joint: str, signal: str) -> bool:
    own = robot.index(joint)
    used = group_of(robot.transmission, own) if signal == "joint_torque" else [own]
    channels = [getattr(one, signal) for one in motions]
    return all(one is not None and bool(np.all(np.isfinite(one[:, used]))) for one in channels)


def _load_side(
    robot: Robot,
    records: Sequence[Record],
    model: LoadModel,
    springs: Mapping[str, Estimate],
    estimator: Estimator,
    joint_zero_std: float,
    executor: Executor | None,
    regressions: Regressions,
    stored: StoredRows | None,
) -> Fit:
    """Fit (8), with the uncertainty of springs and zeros; of `stored` rows without the springs."""
    values = {joint: spring.values for joint, spring in springs.items()}
    covariances = [spring.covariance for spring in springs.values()]
    regress: Callable[[Motion], Regression]
    regress = partial(_of_load, robot, regressions, model, values)
    sprung_rows = partial(_with_torque, values)
    if joint_zero_std > 0:
        theta = (
            _fitted_to(stored, estimator, None, sprung_rows)
            if stored
            else fitted(records, regress, estimator, None, executor)
        ).estimate.values
        stored = None
        regress = partial(_with_zeros, robot, regressions, model, values, theta)
        covariances.append(joint_zero_std**2 * np.eye(robot.n))
    carried = linalg.block_diag(*covariances) if covariances else None
    if stored:
        return _fitted_to(stored, estimator, carried, sprung_rows)
    return fitted(records, regress, estimator, carried, executor)


def _without_torque(robot: Robot, joints: Sequence[str]) -> dict[str, Array]:
    """Return springs {joint: stiffness and offset} that have no force, for rows before a fit."""
    return {joint: np.zeros(len(spring_regressor(robot, joint).names)) for joint in joints}


def _with_torque(springs: Mapping[str, Array], rows: Regression) -> Regression:
    """Return rows of the load side made without the springs' force as they are with it, by (4b)."""
    if not springs:
        return rows
    return replace(rows, y=rows.y + rows.carried @ np.concatenate(list(springs.values())))


def _of_actuator(robot: Robot, regressions: Regressions, joint: str, motion: Motion) -> Regression:
    return regressions.actuator(robot, motion, joint)


def _of_load(
    robot: Robot,
    regressions: Regressions,
    model: LoadModel,
    springs: Mapping[str, Array],
    motion: Motion,
) -> Regression:
    return regressions.load(robot, motion, model, springs)


def _with_zeros(
    robot: Robot,
    regressions: Regressions,
    model: LoadModel,
    springs: Mapping[str, Array],
    theta: Array,
    motion: Motion,
) -> Regression:
    """Return the load side, carrying the springs first and then the zeros of the joints."""
    plain = regressions.load(robot, motion, model, springs)
    zeros = zero_sensitivity(robot, motion, model, springs, theta)
    return replace(plain, carried=np.hstack([plain.carried, zeros.carried]))


def split_load_side(model: LoadModel, load_side: Estimate) -> tuple[Estimate, dict[str, Estimate]]:
    """Return the base parameters, and what the load side tells of drives {joint: Estimate}."""
    p = len(model.base.columns)
    base = load_side.part(range(p), model.expressions)
    drives = {}
    for joint in dict.fromkeys(joint for joint, _, _ in model.drives):
        mine = [i for i, (owner, _, _) in enumerate(model.drives) if owner == joint]
        part = load_side.part([p + i for i in mine], [model.drives[i][1] for i in mine])
        drives[joint] = with_flags(part, joint, None)
    return base, drives
