"""The two-step method of the paper: the actuator side (10) of each spring, then the load side (8).

A motor constant is identifiable only if something known fixes the scale of the equations.
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
    ModelChecks,
    QRFactor,
    StoredRows,
    estimate_of,
    estimate_of_rows,
    model_checks,
    qr_factor_of,
    settled_weights,
    stored_estimate,
    stored_rows,
    unchanged,
    whiteness,
)
from seaid.identification.datasets import Dataset, first_motion, rows_of
from seaid.identification.drive_estimates import merged_estimates, spring_of, with_flags
from seaid.identification.errors_in_variables import (
    errors_in_variables,
    noise_ratio,
    only_spring_torque,
)
from seaid.log import LongLog, Motion
from seaid.regressor import (
    LoadModel,
    Regression,
    actuator_regression,
    load_regression,
    offset_sensitivity,
    spring_regressor,
)
from seaid.robot import Robot, group_of

CONSTANTS = {"torque_constant": "current", "voltage_constant": "voltage"}
"""Motor constants, and the logged input that they convert to torque."""

_ROUNDING = 1e-9

_RANK_TOLERANCE, _PART = 1e-7, 0.01
"""Singular value of a lost combination, and the least share of a constant in it."""

_LOAD_SIDE = "known bodies (known_bodies=), logs with and without a payload (identify_conditions), "
_SPRING = "the stiffness of its spring (known = ['stiffness']), "


def check_scale(qr_factor: QRFactor) -> None:
    """Raise IdentificationError if an unknown motor constant makes the equations homogeneous.

    All torques are then known only up to scale, and least squares gives zero. A payload in all logs
    does not help, since it could be part of its body.
    """
    places = {
        place: name.split(" of ", 1)
        for place, name in enumerate(qr_factor.names)
        if name.split(" of ", 1)[0] in CONSTANTS
    }
    if not places or not qr_factor.count:  # without rows `solve` raises
        return
    R, p = qr_factor.weighted_factor(), len(qr_factor.names)
    norms = np.linalg.norm(R[:, :p], axis=0)
    U, sizes, Vt = safely(
        np.linalg.svd, R[:p, :p] / np.where(norms > 0, norms, 1.0), what="the scale of the torques"
    )
    kept = sizes > _RANK_TOLERANCE * sizes[0]
    theta = Vt[kept].T @ ((U.T @ R[:p, p])[kept] / sizes[kept])
    least = _ROUNDING * float(np.linalg.norm(R[:, p]))
    open_part = np.max(np.abs(Vt[~kept]), axis=0, initial=0.0)
    for place, (name, *where) in places.items():
        if abs(theta[place]) <= least or open_part[place] > _PART:
            joint = where[0] if where else qr_factor.joint_names[qr_factor.equations[0]]
            raise IdentificationError(
                f"the {name.replace('_', ' ')} of {joint} is unidentifiable: only the "
                f"{CONSTANTS[name]} of its motor was logged, so all torques are known only up to "
                f"scale. Give one of: {_LOAD_SIDE if where else _SPRING}its rotor inertia, or the "
                f"constant itself (known = ['{name}'])"
            )


_LOAD_KEY = ""
"""Key of the load side among equations named by joint."""

_NEEDED = ("stiffness", "spring_offset", "deflection_zero")

INPUT_FIELDS = {
    "torque": "motor_torque",
    "current": "motor_current",
    "voltage": "motor_voltage",
}
"""Field of a motion with a drive's logged input."""


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """Estimates of both sides of the springs.

    `springs` {joint: parameters} are those whose torque is that on the load; `checks` and
    `excluded` by joint, and "load" for the load side. `whole` is the estimate of both sides if they
    were estimated at once; `white_covariance` (p, p) the covariance of that, or of `load_side`, for
    white noise.
    """

    drives: Mapping[str, Estimate]
    load: Estimate
    load_side: Estimate
    springs: Mapping[str, Array]
    excluded: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    white_covariance: Array
    whole: Estimate | None = None


@dataclass(frozen=True)
class Regressions:
    """Functions for the rows: `actuator` (robot, motion, joint), `load` (..., model, springs)."""

    actuator: Callable[..., Regression] = actuator_regression
    load: Callable[..., Regression] = load_regression


@dataclass(frozen=True, eq=False)
class SideFit:
    """An estimate with its QR factor, and the rows if they were kept in memory.

    `settled` are the converged weights (E,) of the equations, if the estimate has used them.
    """

    estimate: Estimate
    qr_factor: QRFactor
    rows: Regression | None
    propagated: Array | None
    settled: Array | None = None

    @cached_property
    def weights(self) -> Array:
        """The converged weights (E,) of the equations, for every estimator."""
        return settled_weights(self.qr_factor) if self.settled is None else self.settled

    @property
    def white_covariance(self) -> Array:
        """The covariance (p, p) for white noise in every equation."""
        return estimate_of(self.qr_factor, self.weights, None, self.propagated).covariance

    def checks(self, joints: Sequence[str], optional: Sequence[str]) -> ModelChecks:
        """Return the checks of the model; `joints` are those of the robot."""
        found = {} if self.rows is None else whiteness(self.rows, self.estimate.values)
        named = {joints[index % len(joints)]: one for index, one in found.items()}
        return model_checks(self.qr_factor, self.estimate, optional, named, self.weights)


def fitted(
    datasets: Sequence[Dataset],
    regress: Callable[[Motion], Regression],
    estimator: Estimator,
    propagated: Array | None,
    executor: Executor | None,
) -> SideFit:
    """Return the fit of the rows of all datasets: in memory, or streamed if all are long logs."""
    long_logs = _streamed(datasets, estimator, executor)
    if long_logs:
        with stored_rows(long_logs, {"": regress}) as stored:
            return _fitted_to(stored[""], estimator, propagated)
    rows = rows_of(datasets, regress, executor)
    if estimator.weigh is not None:
        qr_factor = qr_factor_of(rows)
        check_scale(qr_factor)
        weights = estimator.weigh(qr_factor)
        estimate = estimate_of_rows(rows, qr_factor, weights, propagated)
        settled = weights if estimator.weigh is settled_weights else None
        return SideFit(estimate, qr_factor, rows, propagated, settled)
    if any(name.split(" of ")[0] in CONSTANTS for name in rows.names):
        check_scale(qr_factor_of(rows))
    estimate = estimator.solve(rows, propagated)
    seen = estimator.effective_rows(rows, estimate)
    return SideFit(estimate, qr_factor_of(seen), seen, propagated)


def _streamed(
    datasets: Sequence[Dataset], estimator: Estimator, executor: Executor | None
) -> list[LongLog]:
    """Return the long logs if all datasets are such and can be streamed, otherwise none."""
    long_logs = [dataset for dataset in datasets if isinstance(dataset, LongLog)]
    streamed = len(long_logs) == len(datasets) and executor is None and estimator.weigh is not None
    return long_logs if streamed else []


def _fitted_to(
    stored: StoredRows, estimator: Estimator, propagated: Array | None, change: Change = unchanged
) -> SideFit:
    """Return the fit of stored rows."""
    weigh = estimator.weigh or settled_weights
    estimate, qr_factor = stored_estimate(stored, weigh, propagated, change)
    check_scale(qr_factor)
    return SideFit(estimate, qr_factor, None, propagated)


def estimate_two_step(
    robot: Robot,
    datasets: Sequence[Dataset],
    model: LoadModel,
    estimator: Estimator,
    encoder_offset_std: float,
    executor: Executor | None,
    progress: bool,
    regressions: Regressions = Regressions(),
) -> RobotEstimate:
    """Estimate both sides in turn, with the springs' uncertainty propagated to the load.

    `regressions` compute the rows, in columns that `estimator` knows and that its `effective_rows`
    converts to the plain ones.
    """
    drives, checks, excluded = {}, {}, {}
    joints = spring_torque_joints(robot, datasets, model)
    equations = {
        joint: partial(regressions.actuator, robot, joint=joint) for joint in robot.elastic_joints
    }
    long_logs = _streamed(datasets, estimator, executor)
    unloaded = partial(regressions.load, robot, model=model, springs=_without_torque(robot, joints))
    with stored_rows(long_logs, {**equations, _LOAD_KEY: unloaded} if long_logs else {}) as stored:
        for joint, regress in track(list(equations.items()), "actuator side", progress):
            if stored:
                fit = _fitted_to(stored[joint], estimator, None)
            else:
                fit = fitted(datasets, regress, estimator, None, executor)
                if (
                    estimator.weigh
                    and only_spring_torque(robot, datasets, joint)
                    and fit.rows is not None
                ):
                    noisy = errors_in_variables(fit.rows, noise_ratio(robot, datasets, joint))
                    fit = replace(fit, estimate=noisy)
            drives[joint] = with_flags(fit.estimate, joint, fit.qr_factor)
            optional = [name for name in fit.estimate.names if name not in _NEEDED]
            checks[joint] = fit.checks(robot.joint_names, optional)
            excluded[joint] = fit.qr_factor.excluded
        springs = {joint: spring_of(robot, drives[joint], joint) for joint in joints}
        for _ in track([0], "load side", progress):
            load = _load_side(
                *(robot, datasets, model, springs, estimator),
                *(encoder_offset_std, executor, regressions, stored.get(_LOAD_KEY)),
            )
    base, load_drives = split_load_side(model, load.estimate)
    found = merged_estimates(drives, load_drives)
    return RobotEstimate(
        drives={joint: found[joint] for joint in robot.joint_names if joint in found},
        load=base,
        load_side=load.estimate,
        springs={joint: spring.values for joint, spring in springs.items()},
        excluded=excluded | {"load": load.qr_factor.excluded},
        checks=checks
        | {"load": load.checks(robot.joint_names, model.names[len(model.expressions) :])},
        white_covariance=load.white_covariance,
    )


def joints_with_torque(robot: Robot, datasets: Sequence[Dataset]) -> tuple[str, ...]:
    """Return the joints whose torque is measured, by a sensor or by a spring."""
    motions = [first_motion(dataset) for dataset in datasets]
    return tuple(
        joint
        for joint in robot.joint_names
        if joint in robot.elastic_joints
        or _all_measured(robot, motions, joint, INPUT_FIELDS[robot.drives[joint].motor_input])
        or _all_measured(robot, motions, joint, "joint_torque")
    )


def spring_torque_joints(
    robot: Robot, datasets: Sequence[Dataset], model: LoadModel
) -> tuple[str, ...]:
    """Return the joints of the model whose torque on the load is that of their spring."""
    motions = [first_motion(dataset) for dataset in datasets]
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
    datasets: Sequence[Dataset],
    model: LoadModel,
    springs: Mapping[str, Estimate],
    estimator: Estimator,
    encoder_offset_std: float,
    executor: Executor | None,
    regressions: Regressions,
    stored: StoredRows | None,
) -> SideFit:
    """Fit (8) with the uncertainty of springs and encoder offsets, if `stored` to stored rows."""
    values = {joint: spring.values for joint, spring in springs.items()}
    covariances = [spring.covariance for spring in springs.values()]
    regress: Callable[[Motion], Regression]
    regress = partial(regressions.load, robot, model=model, springs=values)
    rows_with_torque = partial(_with_torque, values)
    if encoder_offset_std > 0:
        theta = (
            _fitted_to(stored, estimator, None, rows_with_torque)
            if stored
            else fitted(datasets, regress, estimator, None, executor)
        ).estimate.values
        stored = None
        regress = partial(_with_offsets, robot, regressions, model, values, theta)
        covariances.append(encoder_offset_std**2 * np.eye(robot.n))
    propagated = linalg.block_diag(*covariances) if covariances else None
    if stored:
        return _fitted_to(stored, estimator, propagated, rows_with_torque)
    return fitted(datasets, regress, estimator, propagated, executor)


def _without_torque(robot: Robot, joints: Sequence[str]) -> dict[str, Array]:
    """Return springs {joint: parameters} without force, for rows before the fit of the springs."""
    return {joint: np.zeros(len(spring_regressor(robot, joint).names)) for joint in joints}


def _with_torque(springs: Mapping[str, Array], rows: Regression) -> Regression:
    """Return rows of the load side with the springs' force by (4b), from rows without it."""
    if not springs:
        return rows
    return replace(rows, y=rows.y + rows.propagated @ np.concatenate(list(springs.values())))


def _with_offsets(
    robot: Robot,
    regressions: Regressions,
    model: LoadModel,
    springs: Mapping[str, Array],
    theta: Array,
    motion: Motion,
) -> Regression:
    """Return the load side with propagated columns of the springs and then of encoder offsets."""
    plain = regressions.load(robot, motion, model, springs)
    zeros = offset_sensitivity(robot, motion, model, springs, theta)
    return replace(plain, propagated=np.hstack([plain.propagated, zeros.propagated]))


def split_load_side(model: LoadModel, load_side: Estimate) -> tuple[Estimate, dict[str, Estimate]]:
    """Return the base parameters, and the load side's estimates of drives {joint: Estimate}."""
    p = len(model.base.columns)
    base = load_side.part(range(p), model.expressions)
    drives = {}
    for joint in dict.fromkeys(joint for joint, _, _ in model.drives):
        mine = [i for i, (owner, _, _) in enumerate(model.drives) if owner == joint]
        part = load_side.part([p + i for i in mine], [model.drives[i][1] for i in mine])
        drives[joint] = with_flags(part, joint, None)
    return base, drives
