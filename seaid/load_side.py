"""The load side (8): base parameters, and what stiff drives add, from the torques on the load."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array, BoolArray, frozen
from seaid.base import BaseParameters, grouped_text, left_to_right, negligible, random_states
from seaid.drivetrain.model import SeriesElasticDrive, StiffDrive
from seaid.errors import LogError
from seaid.inertia import UNITS
from seaid.motion import Motion
from seaid.regression import (
    Regression,
    in_band_at,
    motor_regressor,
    row_samples,
    sensed_torque,
    signals,
    spring_regressor,
    standstill,
)
from seaid.rigid_body import regressor_at_drives
from seaid.robot import Robot
from seaid.transmission import at_drives

_ZERO_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class LoadModel:
    """What the load side can tell: base parameters, and the columns of the stiff drives.

    `drives` (p_d) are (joint, parameter, unit) of the drive columns that are identifiable beside
    the p base columns; the others are part of the base parameters, as `expressions` (p,) say: they
    are `absorbed` (a), and `absorption` (p + p_d, a) is how much of each is in every column. `rows`
    are the joints whose equations are used: those of their drives, which for drives that move
    several joints are the torques on what each of them turns.
    """

    base: BaseParameters
    rows: tuple[str, ...]
    drives: tuple[tuple[str, str, str], ...]
    expressions: tuple[str, ...]
    absorbed: tuple[tuple[str, str, str], ...]
    absorption: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns: expressions, then '<parameter> of <joint>'."""
        return self.expressions + tuple(f"{name} of {joint}" for joint, name, _ in self.drives)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all columns."""
        base = tuple(UNITS[column % 10] for column in self.base.columns)
        return base + tuple(unit for _, _, unit in self.drives)


def load_model(robot: Robot, base: BaseParameters, rows: Sequence[str]) -> LoadModel:
    """Return which columns of stiff drives are identifiable beside the base parameters."""
    known = [robot.index(joint) for joint in rows]
    q, v, a = random_states(robot, seed=1, torques=len(known))
    Y = base.reduce(regressor_at_drives(robot, q, v, a))[:, known]
    columns, drives = _drive_columns(
        robot, rows, lambda index: _stiff_signals(robot, index, q, v, a)
    )
    H = np.concatenate([Y, columns], axis=2).reshape(len(q) * len(known), -1)
    p = len(base.columns)
    found, grouping, _ = left_to_right(H, negligible(H))
    names = (*base.expressions, *(f"{name}_{joint}" for joint, name, _ in drives))
    absorbed = [column for column in range(p, H.shape[1]) if column not in found]
    expressions = []
    for row in range(p):
        wanted = np.zeros(H.shape[1])
        wanted[[row, *absorbed]] = grouping[row, [row, *absorbed]]
        expressions.append(grouped_text(wanted, names))
    return LoadModel(
        base=base,
        rows=tuple(rows),
        drives=tuple(drives[column - p] for column in found if column >= p),
        expressions=tuple(expressions),
        absorbed=tuple(drives[column - p] for column in absorbed),
        absorption=frozen("absorption", grouping[:, absorbed], (len(found), None)),
    )


def load_columns(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array]
) -> tuple[Array, Array, Array, Array]:
    """Return the load side over time: torque (T, rows), the payload's part of it, H and carried.

    torque = payload + H (T, rows, columns) @ theta; see `load_regression`.
    """
    Y = regressor_at_drives(robot, *motion.joint_states)
    known = [robot.index(joint) for joint in model.rows]
    columns, drives = _drive_columns(robot, model.rows, lambda index: signals(robot, motion, index))
    wanted = [drives.index(drive) for drive in model.drives]
    flat = Y.swapaxes(1, 2).reshape(len(Y), -1)  # no copy: so the regressor lies in memory
    places = np.add.outer(known, robot.n * np.array(model.base.columns, dtype=np.intp))
    base = np.take(flat, places.ravel(), axis=1).reshape(len(Y), *places.shape)
    H = np.concatenate([base, columns[:, :, wanted]], axis=2)
    torque, carried = _load_targets(robot, motion, model.rows, springs)
    payload = np.zeros_like(torque)
    if np.any(robot.payload_parameters):
        payload = (Y @ robot.payload_parameters)[:, known]
    return torque, payload, H, carried


def load_regression(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array]
) -> Regression:
    """Return the load side (8): base parameters, and friction and rotor inertia of stiff drives.

    `springs` has stiffness and offset of the elastic joints in `model.rows`; one that is not there
    takes its joint torque from the log. The payload's torque is moved to the known side.
    """
    torque, payload, H, carried = load_columns(robot, motion, model, springs)
    rows = row_samples(motion)
    y, H, carried = (in_band_at(motion, part, rows) for part in (torque - payload, H, carried))
    told = np.array([~unknown_friction(robot, motion, joint)[rows] for joint in model.rows])
    which, kept = np.nonzero(told)
    return Regression(
        names=model.names,
        units=model.units,
        H=H[kept, which],
        y=y[kept, which],
        joint=np.array([robot.index(joint) for joint in model.rows])[which],
        time=motion.time[rows[kept]],
        run=np.zeros(len(kept)),
        left_out=len(rows) * len(model.rows) - len(kept),
        carried=carried[kept, which],
        joint_names=robot.joint_names,
    )


def zero_sensitivity(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array], theta: Array
) -> Regression:
    """Return the load side with `carried` (R, n): what a shifted zero of each joint encoder does.

    It is minus the change of the computed torque, at the parameters `theta`, a unit of shift.
    """
    reference, changes = load_regression(robot, motion, model, springs), []
    for index in range(robot.n):
        position = motion.joint_position.copy()
        position[:, index] += _ZERO_STEP
        moved = dict(springs)
        for joint, (stiffness, offset) in springs.items():
            travel = _ZERO_STEP * robot.transmission[robot.index(joint), index]
            if travel:  # the deflection offset takes what the zero does to the spring
                load_radius = getattr(robot.drivetrains[joint], "load_radius", 1.0)
                moved[joint] = np.array([stiffness, offset + stiffness * load_radius * travel])
        shifted = load_regression(robot, replace(motion, joint_position=position), model, moved)
        change = (shifted.y - shifted.H @ theta) - (reference.y - reference.H @ theta)
        changes.append(change / _ZERO_STEP)
    return replace(reference, carried=np.column_stack(changes))


def unknown_friction(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Tell the samples (T,) at which the load side of a joint has unknown friction.

    That of a stiff drive with Coulomb friction does where it stands still; an elastic one has none.
    """
    drive = robot.drivetrains[joint]
    if isinstance(drive, StiffDrive) and "coulomb" in drive.friction:
        return standstill(motion, robot.index(joint))
    return np.zeros(len(motion.time), dtype=bool)


def _drive_columns(
    robot: Robot, rows: Sequence[str], signals_of: Callable[[int], dict[str, Array]]
) -> tuple[Array, list[tuple[str, str, str]]]:
    """Return the stiff drives' columns (T, rows, columns) at the joints, and what they are."""
    blocks, drives = [], []
    for row, joint in enumerate(rows):
        drive = robot.drivetrains[joint]
        if isinstance(drive, SeriesElasticDrive):
            continue
        regressor = motor_regressor(robot, joint)
        R = regressor.evaluate(signals_of(robot.index(joint)))[1]
        block = np.zeros((len(R), len(rows), R.shape[1]))
        block[:, row] = drive.ratio * R
        blocks.append(block)
        drives += [
            (joint, name, unit) for name, unit in zip(regressor.names, regressor.units, strict=True)
        ]
    length = len(next(iter(signals_of(0).values())))
    return np.concatenate([*blocks, np.empty((length, len(rows), 0))], axis=2), drives


def _stiff_signals(robot: Robot, index: int, q: Array, v: Array, a: Array) -> dict[str, Array]:
    """Return the signals of a stiff drive at joint states: the motor turns with its joints."""
    ratio, nothing = robot.drivetrains[robot.joint_names[index]].ratio, np.zeros(len(q))
    states = {"theta_L": q, "theta_L_dot": v, "theta_L_ddot": a}
    joint = {
        name: at_drives(robot.transmission, values)[:, index] for name, values in states.items()
    }
    motor = {name.replace("_L", "_M"): ratio * values for name, values in joint.items()}
    return {**joint, **motor, "tau_M": nothing, "tau_L": nothing}


def _load_targets(
    robot: Robot, motion: Motion, rows: Sequence[str], springs: Mapping[str, Array]
) -> tuple[Array, Array]:
    """Return the torque on the load (T, rows) and its derivative by the springs' parameters."""
    elastic = [joint for joint in rows if joint in springs]
    targets = np.empty((len(motion.time), len(rows)))
    carried = np.zeros((*targets.shape, sum(len(springs[joint]) for joint in elastic)))
    start = 0
    for row, joint in enumerate(rows):
        index, drive = robot.index(joint), robot.drivetrains[joint]
        by_name = signals(robot, motion, index)
        measured = sensed_torque(robot, motion, index)
        if isinstance(drive, SeriesElasticDrive):
            if joint not in springs:
                targets[:, row] = measured
                continue
            R = drive.load_radius * spring_regressor(robot, joint).evaluate(by_name)[1]
            targets[:, row] = R @ springs[joint]  # (4b)
            carried[:, row, start : start + R.shape[1]] = R
            start += R.shape[1]
        else:
            if np.all(np.isnan(by_name["tau_M"])):
                by_name["tau_M"] = measured / drive.ratio
            targets[:, row] = drive.ratio * motor_regressor(robot, joint).evaluate(by_name)[0]
    missing = [joint for row, joint in enumerate(rows) if np.any(np.isnan(targets[:, row]))]
    if missing:
        raise LogError(f"no torque in the log at {', '.join(missing)}; name the others with rows=")
    return targets, carried
