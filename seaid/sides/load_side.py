"""The load side (8): base parameters, and what stiff drives add, from the torques on the load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.drive_signals import (
    INPUTS,
    fed_signals,
    motor_regressor,
    sensed_torque,
    signals,
    spring_regressor,
)
from seaid.drivetrain.model import SeriesElasticDrive, StiffDrive
from seaid.drivetrain.values import is_dry
from seaid.errors import LogError
from seaid.motion import Motion
from seaid.motion_rows import in_band_at, joint_standstill, row_samples, standstill, standstill_seen
from seaid.regression import Regression
from seaid.rigid_body import regressor_at_drives
from seaid.robot import Robot
from seaid.sides.drive_columns import drive_columns, load_signals
from seaid.sides.load_model import LoadModel
from seaid.transmission import group_of


def load_columns(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array]
) -> tuple[Array, Array, Array, Array]:
    """Return the load side over time: torque (T, rows), what is known of it, H and carried.

    torque = payload + H (T, rows, columns) @ theta; see `load_regression`.
    """
    Y = regressor_at_drives(robot, *motion.joint_states)
    known = [robot.index(joint) for joint in model.rows]
    signals_of = partial(load_signals, robot, motion)
    columns, drives = drive_columns(robot, model.rows, signals_of)
    wanted = [drives.index(drive) for drive in model.drives]
    flat = Y.swapaxes(1, 2).reshape(len(Y), -1)  # no copy: so the regressor lies in memory
    places = np.add.outer(known, robot.n * np.array(model.base.columns, dtype=np.intp))
    base = np.take(flat, places.ravel(), axis=1).reshape(len(Y), *places.shape)
    H = np.concatenate([base, columns[:, :, wanted]], axis=2) if wanted else base
    torque, carried = _load_targets(robot, motion, model.rows, springs)
    payload = np.zeros_like(torque)
    if np.any(robot.known_parameters):
        payload = (Y @ robot.known_parameters)[:, known]
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


def unknown_friction(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Tell the samples (T,) at which the load side of a joint has unknown friction.

    That of a stiff drive with dry friction has where it stands still; an elastic one has it only
    where the joint itself has dry friction behind the spring.
    """
    drive, index = robot.drivetrains[joint], robot.index(joint)
    unknown = np.zeros(len(motion.time), dtype=bool)
    if isinstance(drive, StiffDrive) and is_dry(drive):
        unknown |= standstill(motion, index, standstill_seen(drive))
    for other in group_of(robot.transmission, index):
        beside = robot.drivetrains[robot.joint_names[other]]
        if "coulomb" in getattr(beside, "joint_friction", ()):
            unknown |= joint_standstill(motion, other)
    return unknown


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
        if isinstance(drive, SeriesElasticDrive):
            if joint not in springs:
                targets[:, row] = sensed_torque(robot, motion, index)
                continue
            zeta, R = spring_regressor(robot, joint).evaluate(signals(robot, motion, index))
            R = drive.load_radius * R
            targets[:, row] = R @ springs[joint] - drive.load_radius * zeta  # (4b)
            carried[:, row, start : start + R.shape[1]] = R
            start += R.shape[1]
        else:
            by_name = fed_signals(robot, motion, index)
            targets[:, row] = drive.ratio * motor_regressor(robot, joint).evaluate(by_name)[0]
            targets[np.isnan(by_name[INPUTS[drive.motor_input]]), row] = np.nan
    missing = [joint for row, joint in enumerate(rows) if np.any(np.isnan(targets[:, row]))]
    if missing:
        raise LogError(f"no torque in the log at {', '.join(missing)}; name the others with rows=")
    return targets, carried
