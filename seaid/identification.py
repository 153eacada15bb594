"""identify: the paper's two parts. Actuator side first, then the load side with its springs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import linalg

from seaid.arrays import Array, FrozenMapping
from seaid.base import BaseParameters, base_parameters
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.estimate import Estimate
from seaid.estimation.solve import ordinary, weighted
from seaid.excited import check_excitation
from seaid.files import whole_file
from seaid.found import spring_of, with_estimate, with_flags
from seaid.load_side import LoadModel, load_model, load_regression, zero_sensitivity
from seaid.log import Log
from seaid.motion import Motion, reconstruct_motion
from seaid.progress import track
from seaid.regression import Regression, actuator_regression, stacked
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.validation import Validation

Estimator = Callable[[Regression, Array | None], Estimate]

ESTIMATORS: Mapping[str, Estimator] = FrozenMapping({"ols": ordinary, "wls": weighted})

SIDES = ("sequential",)


@dataclass(frozen=True, eq=False)
class Identification:
    """What a log told about a robot.

    `drivetrains` {joint: Estimate} has the drives' parameters; `load` the base parameters, whose
    combinations are in `base`; `robot` the robot with the found values (its standard parameters are
    the nearest to those of the file that have the found base parameters), `known` the robot as it
    was given. `load_side` is the whole
    estimate of the load side in the columns of `model`. `left_out` counts instants near standstill
    by joint, "load" for the load side.
    """

    drivetrains: Mapping[str, Estimate]
    load: Estimate
    base: BaseParameters
    robot: Robot
    known: Robot
    model: LoadModel
    load_side: Estimate
    springs: Mapping[str, Array]
    cutoff_hz: float
    left_out: Mapping[str, int]

    @property
    def flags(self) -> tuple[str, ...]:
        """In words, what must not be trusted."""
        return tuple(
            flag for estimate in (*self.drivetrains.values(), self.load) for flag in estimate.flags
        )

    def summary(self) -> str:
        """Return one table that a human reads."""
        from seaid.report.text import identification_table

        return identification_table(self)

    def to_dict(self, validation: Validation | None = None) -> dict[str, Any]:
        """Return the content of `parameters.json`."""
        return {
            "robot": self.robot.name,
            "joints": list(self.robot.joint_names),
            "drivetrains": {
                joint: {
                    name: {"value": float(value), "standard_error": float(error), "unit": unit}
                    for name, value, error, unit in _rows_of(estimate)
                }
                for joint, estimate in self.drivetrains.items()
            },
            "load": [
                {
                    "expression": name,
                    "value": float(value),
                    "standard_error": float(error),
                    "unit": unit,
                }
                for name, value, error, unit in _rows_of(self.load)
            ],
            "base_columns": list(self.base.columns),
            "grouping": self.base.grouping.tolist(),
            "validation": {} if validation is None else validation.to_dict(),
            "torques_used": list(self.model.rows),
            "cutoff_hz": self.cutoff_hz,
            "flags": list(self.flags),
        }

    def save(self, path: str | Path, validation: Validation | None = None) -> None:
        """Write `parameters.json`, whole or not at all."""
        with whole_file(path) as temporary:
            temporary.write_text(json.dumps(self.to_dict(validation), indent=1) + "\n")


def identify(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    rows: Sequence[str] | None = None,
    sides: str = "sequential",
    estimator: str = "wls",
    cutoff_hz: float | None = None,
    joint_zero_std: float = 0.0,
    progress: bool = False,
) -> Identification:
    """Identify drives and load from one log or several.

    Part one estimates friction, stiffness and deflection offset of each elastic joint from (7);
    part two computes the load torques by (4b) and estimates the base parameters from (8), with the
    uncertainty of the springs carried along. Only ratios, radii, known rotor inertias, geometry and
    payload of `robot` are used. `rows` names the joints whose torque is used on the load side
    (default: all that were measured). `estimator` "ols" or "wls" (rows weighted by joint);
    `cutoff_hz` the pass band, None = proposed from the data. `joint_zero_std` [rad or m] is how
    well the zeros of the joint encoders are known; a wrong one turns gravity, and the covariance of
    the load side then says what that does. Raises kinds of SeaidError for data that cannot answer.
    """
    estimate = _chosen(sides, estimator)
    logs = [logs] if isinstance(logs, Log) else list(logs)
    if not logs:
        raise IdentificationError("identify needs a log, found none")
    motions = _motions(robot, logs, cutoff_hz, progress)
    check_excitation(robot, logs)
    drives, left_out = _actuator_side(robot, motions, estimate, progress)
    rows = _known_torques(robot, motions) if rows is None else robot.rows(rows)
    springs = {
        joint: spring_of(drives[joint])
        for joint in rows
        if joint in drives and not _all_measured(robot, motions, joint, "joint_torque")
    }
    model = load_model(robot, base_parameters(robot, rows=rows), rows)
    load_side, left_out["load"] = _load_side(
        robot, track(motions, "load side", progress), model, springs, estimate, joint_zero_std
    )
    base, stiff = _split(model, load_side)
    found = drives | stiff
    drives = {joint: found[joint] for joint in robot.joint_names if joint in found}
    return Identification(
        drivetrains=FrozenMapping(drives),
        load=base,
        base=model.base,
        robot=_found_robot(robot, model.base, base, drives),
        known=robot,
        model=model,
        load_side=load_side,
        springs=FrozenMapping({joint: spring.values for joint, spring in springs.items()}),
        cutoff_hz=motions[0].cutoff_hz,
        left_out=FrozenMapping(left_out),
    )


def _chosen(sides: str, estimator: str) -> Estimator:
    for kind, name, allowed in (("sides", sides, SIDES), ("estimator", estimator, ESTIMATORS)):
        if name not in allowed:
            raise IdentificationError(f"{kind}=: " + unknown_name(kind, name, allowed))
    return ESTIMATORS[estimator]


def _motions(
    robot: Robot, logs: Sequence[Log], cutoff_hz: float | None, progress: bool
) -> list[Motion]:
    """Reconstruct all logs with one pass band: the given one, or the narrowest proposed."""
    motions = [
        reconstruct_motion(robot, log, cutoff_hz)
        for log in track(logs, "filtering the log", progress)
    ]
    narrowest = min(motion.cutoff_hz for motion in motions)
    return [
        motion if motion.cutoff_hz == narrowest else reconstruct_motion(robot, log, narrowest)
        for motion, log in zip(motions, logs, strict=True)
    ]


def _all_measured(robot: Robot, motions: Sequence[Motion], joint: str, signal: str) -> bool:
    index = robot.index(joint)
    return all(bool(np.all(np.isfinite(getattr(one, signal)[:, index]))) for one in motions)


def _known_torques(robot: Robot, motions: Sequence[Motion]) -> tuple[str, ...]:
    """Return the joints whose torque is measured, by a sensor or by a spring."""
    return tuple(
        joint
        for joint in robot.joint_names
        if joint in robot.elastic_joints
        or _all_measured(robot, motions, joint, "motor_torque")
        or _all_measured(robot, motions, joint, "joint_torque")
    )


def _actuator_side(
    robot: Robot, motions: Sequence[Motion], estimate: Estimator, progress: bool
) -> tuple[dict[str, Estimate], dict[str, int]]:
    """Estimate (7) of each elastic joint; also return the instants left out by joint."""
    drives, left_out = {}, {}
    for joint in track(robot.elastic_joints, "actuator side", progress):
        rows = stacked([actuator_regression(robot, motion, joint) for motion in motions])
        drives[joint] = with_flags(estimate(rows, None), joint, rows)
        left_out[joint] = rows.left_out
    return drives, left_out


def _load_side(
    robot: Robot,
    motions: Iterable[Motion],
    model: LoadModel,
    springs: Mapping[str, Estimate],
    estimate: Estimator,
    joint_zero_std: float,
) -> tuple[Estimate, int]:
    """Estimate (8), with the uncertainty of springs and zeros; also return the rows left out."""
    values = {joint: spring.values for joint, spring in springs.items()}
    covariances = [spring.covariance for spring in springs.values()]
    motions = list(motions)
    load = stacked([load_regression(robot, motion, model, values) for motion in motions])
    if joint_zero_std > 0:
        theta = estimate(load, None).values
        sensitivity = stacked(
            [zero_sensitivity(robot, one, model, values, theta) for one in motions]
        )
        load = replace(load, carried=np.hstack([load.carried, sensitivity.carried]))
        covariances.append(joint_zero_std**2 * np.eye(robot.n))
    carried = linalg.block_diag(*covariances) if covariances else None
    return estimate(load, carried), load.left_out


def _split(model: LoadModel, load_side: Estimate) -> tuple[Estimate, dict[str, Estimate]]:
    """Return the base parameters, and the stiff drives' parameters by joint."""
    p = len(model.base.columns)
    base = load_side.part(range(p), model.expressions)
    stiff = {}
    for joint in dict.fromkeys(joint for joint, _, _ in model.drives):
        mine = [i for i, (owner, _, _) in enumerate(model.drives) if owner == joint]
        part = load_side.part([p + i for i in mine], [model.drives[i][1] for i in mine])
        stiff[joint] = with_flags(part, joint, None)
    return base, stiff


def _found_robot(
    robot: Robot, base: BaseParameters, load: Estimate, drives: Mapping[str, Estimate]
) -> Robot:
    """Return the robot with the found values; standard parameters nearest to the file's.

    Nearest in the plain Euclidean sense, from a point of 1 kg a body where the robot has none: it
    has the found base parameters, and need not be physically possible body by body.
    """
    prior = robot.parameters.copy()
    prior[::10][np.isnan(prior[::10])] = 1.0
    prior = np.nan_to_num(prior)
    correction = np.linalg.pinv(base.grouping) @ (load.values - base.project(prior))
    found = {
        joint: with_estimate(drive, drives[joint]) if joint in drives else drive
        for joint, drive in robot.drivetrains.items()
    }
    return robot.with_values(prior + correction, found)


def _rows_of(estimate: Estimate) -> list[tuple[str, float, float, str]]:
    return list(
        zip(
            estimate.names,
            estimate.values,
            estimate.standard_errors,
            estimate.units,
            strict=True,
        )
    )
