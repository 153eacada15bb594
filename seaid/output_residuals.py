"""Residuals of the complete model along a log, and their derivatives: the outputs of `refine`."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from seaid.arrays import Array, BoolArray, FrozenMapping
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.errors import IdentificationError
from seaid.estimation.gauss_newton import Residuals
from seaid.filtering import decimation
from seaid.identification import Identification
from seaid.log import Log
from seaid.motion import POSITION_BAND, Motion, reconstruct_motion
from seaid.motion_rows import REST_RAD_S, STANDSTILL
from seaid.regression import actuator_columns
from seaid.robot import Robot
from seaid.sides.driven_motion import finer_side
from seaid.sides.load_response import Answer, TorqueJacobians, answer_to, torque_jacobians
from seaid.sides.load_side import load_columns

WIDER = 3.0
"""The pass band of the refinement over that of the identification: dry friction is sharp."""

WINDOW_S = 1.0
"""A simulation starts anew so often, so that what the model lacks does not pile up."""

_LEAST_NOISE = 1e-9


@dataclass(frozen=True, eq=False)
class Layout:
    """Which parameter is where: `names` (p,) of all, and the columns of each kind.

    `simulated` are the joints behind springs whose position is computed. `precision` (p,) holds
    what is known beforehand of the encoder zeros, as inverse standard deviations.
    """

    found: Identification
    simulated: tuple[str, ...]
    names: tuple[str, ...]
    drives: FrozenMapping[slice]
    load: slice
    zeros: slice
    precision: Array

    @property
    def start(self) -> Array:
        """The values (p,) of the identification; zeros are as they were read."""
        values = np.zeros(len(self.names))
        for joint, columns in self.drives.items():
            values[columns] = self.found.drivetrains[joint].values
        values[self.load] = self.found.load_side.values
        return values

    def spring(self, joint: str) -> list[int]:
        """Return the columns of stiffness and deflection offset of a joint."""
        names = self.found.drivetrains[joint].names
        first = self.drives[joint].start
        return [first + names.index(name) for name in ("stiffness", "deflection_offset")]


@dataclass(frozen=True, eq=False)
class Run:
    """A log at the present estimate: its motion with the simulated joints in it, whole windows.

    `reading` (T, simulated) is what their encoders said; `block` samples make a row.
    """

    motion: Motion
    reading: Array
    windows: int
    block: int


def layout_of(found: Identification, joint_zero_std: float) -> Layout:
    """Return where the parameters of an identification are in one vector."""
    robot = found.known
    names: list[str] = []
    drives: dict[str, slice] = {}
    for joint in robot.elastic_joints:
        mine = found.drivetrains[joint].names
        drives[joint] = slice(len(names), len(names) + len(mine))
        names += [f"{name} of {joint}" for name in mine]
    load = slice(len(names), len(names) + len(found.model.names))
    names += found.model.names
    zeros = slice(len(names), len(names) + (robot.n if joint_zero_std else 0))
    names += [f"encoder zero of {joint}" for joint in robot.joint_names] if joint_zero_std else []
    precision = np.zeros(len(names))
    precision[zeros] = 1 / joint_zero_std if joint_zero_std else 0.0
    return Layout(
        found=found,
        simulated=tuple(joint for joint in found.model.rows if joint in found.springs),
        names=tuple(names),
        drives=FrozenMapping(drives),
        load=load,
        zeros=zeros,
        precision=precision,
    )


def run_of(layout: Layout, log: Log) -> Run:
    """Return a log without a hole as it enters the refinement: in its wider pass band, cut to
    whole windows.
    """
    known = layout.found.known
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    band = min(WIDER * layout.found.cutoff_hz, rate_hz / 8)
    motion = reconstruct_motion(known, log, band)
    motion = finer_side(known, motion)
    block = decimation(motion.rate_hz, motion.cutoff_hz)
    trim = round(motion.trim_s * motion.rate_hz)
    length = len(motion.time) - 2 * trim
    windows = max(1, round(length / motion.rate_hz / WINDOW_S))
    whole = windows * (length // windows // block) * block
    motion = _selected(motion, slice(trim, trim + whole))
    simulated = [known.index(joint) for joint in layout.simulated]
    return Run(motion, motion.joint_position[:, simulated], windows, block)


def _selected(motion: Motion, samples: slice) -> Motion:
    return replace(
        motion,
        **{
            field.name: getattr(motion, field.name)[samples]
            for field in fields(motion)
            if isinstance(getattr(motion, field.name), np.ndarray)
        },
    )


def robot_at(layout: Layout, x: Array) -> Robot:
    """Return the found robot with the base parameters of x."""
    base, robot = layout.found.base, layout.found.robot
    load = x[layout.load][: len(base.columns)]
    correction = base.least(load - base.project(robot.parameters))
    return robot.with_values(robot.parameters + correction, robot.drivetrains)


def linearised(layout: Layout, run: Run, x: Array) -> tuple[Residuals, Answer]:
    """Return the residuals of a run around x, and how the simulated joints answer.

    Channels: positions of the simulated joints, the elastic drives' torques, the torques of the
    other rows of the load side. The first column of the answer is what the joints still lack to
    obey (8), then the p parameters and the initial states.
    """
    known, motion = layout.found.known, run.motion
    error, by_x, jacobians = _load_error(layout, run, x)
    joints = [known.index(joint) for joint in layout.simulated]
    mine = [layout.found.model.rows.index(joint) for joint in layout.simulated]
    others = [row for row in range(error.shape[1]) if row not in mine]
    inside = jacobians.part(joints, joints)
    spring = np.array([_spring_rate(known, joint) for joint in layout.simulated])
    k = np.array([x[layout.spring(joint)[0]] for joint in layout.simulated])
    inside = replace(inside, position=inside.position + np.diag(spring * k))
    force = np.concatenate([error[:, mine, None], by_x[:, mine]], axis=2)
    answer = answer_to(inside, force, 1 / motion.rate_hz, run.windows)

    free = answer.position.shape[2] - force.shape[2]
    encoder = -answer.position
    encoder[:, :, 0] += run.reading - motion.joint_position[:, joints]
    if layout.precision.any():
        zeros = [1 + layout.zeros.start + joint for joint in joints]
        encoder[:, :, 0] -= x[layout.zeros][joints]
        encoder[:, range(len(joints)), zeros] -= 1.0
    rows = [known.index(layout.found.model.rows[row]) for row in others]
    torque = np.concatenate([error[:, others, None], by_x[:, others]], axis=2)
    torque = np.pad(torque, ((0, 0), (0, 0), (0, free)))
    torque -= jacobians.part(rows, joints).change(answer)
    drive = _drive_error(layout, run, x, answer)
    columns = np.concatenate([encoder, drive, torque], axis=1)
    still = [np.zeros(len(motion.time), dtype=bool) for _ in joints]
    still += [_turning(known, motion, joint) for joint in layout.drives]
    still += [_turning(known, motion, layout.found.model.rows[row]) for row in others]
    return _blocks(run, columns, np.column_stack(still), free), answer


def _load_error(layout: Layout, run: Run, x: Array) -> tuple[Array, Array, TorqueJacobians]:
    """Return what (8) lacks (T, rows), its derivative by x (T, rows, p), and by the motion."""
    found, motion = layout.found, run.motion
    springs = {joint: x[layout.spring(joint)] for joint in found.springs}
    torque, payload, H, carried = load_columns(found.known, motion, found.model, springs)
    jacobians = torque_jacobians(robot_at(layout, x), *motion.joint_states)
    by_x = np.zeros((*torque.shape, len(x)))
    by_x[:, :, layout.load] = -H
    elastic = [joint for joint in found.model.rows if joint in found.springs]
    columns = [column for joint in elastic for column in layout.spring(joint)]
    by_x[:, :, columns] = carried
    if layout.precision.any():
        rows = [found.known.index(joint) for joint in found.model.rows]
        by_x[:, :, layout.zeros] = jacobians.position[:, rows]
        simulated = [layout.zeros.start + found.known.index(joint) for joint in layout.simulated]
        by_x[:, :, simulated] = 0.0
    return torque - payload - H @ x[layout.load], by_x, jacobians


def _spring_rate(robot: Robot, joint: str) -> float:
    """Return how the spring's torque on the load falls with the joint's position, for k = 1."""
    drive = robot.drivetrains[joint]
    assert isinstance(drive, SeriesElasticDrive)
    return drive.load_radius**2


def _drive_error(layout: Layout, run: Run, x: Array, answer: Answer) -> Array:
    """Return what (7) of each elastic drive lacks, and its derivatives (T, drives, 1 + p + s)."""
    known, motion, free = layout.found.known, run.motion, answer.position.shape[2] - 1 - len(x)
    found = np.zeros((len(motion.time), len(layout.drives), 1 + len(x) + free))
    nudged = replace(motion, joint_position=motion.joint_position + 1e-6)
    for row, (joint, columns) in enumerate(layout.drives.items()):
        regressor, zeta, R = actuator_columns(known, motion, joint)
        if regressor.names != layout.found.drivetrains[joint].names:
            raise IdentificationError(
                f"the log tells {', '.join(regressor.names)} of {joint}, the identification has "
                f"{', '.join(layout.found.drivetrains[joint].names)}: same torque sensors needed"
            )
        found[:, row, 0] = zeta - R @ x[columns]
        found[:, row, 1 + columns.start : 1 + columns.stop] = -R
        _, zeta_there, R_there = actuator_columns(known, nudged, joint)
        by_position = (zeta_there - R_there @ x[columns] - found[:, row, 0]) / 1e-6
        if joint in layout.simulated:
            mine = answer.position[:, layout.simulated.index(joint)]
            found[:, row] += by_position[:, None] * mine
        elif layout.precision.any():
            found[:, row, 1 + layout.zeros.start + known.index(joint)] -= by_position
    return found


def _turning(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Tell the samples (T,) near which a motor with dry friction stands or turns back."""
    if "coulomb" not in robot.drivetrains[joint].friction:
        return np.zeros(len(motion.time), dtype=bool)
    speed = motion.motor_velocity[:, robot.index(joint)]
    still = np.abs(speed) < max(STANDSTILL * np.max(np.abs(speed)), REST_RAD_S)
    still[1:] |= speed[1:] * speed[:-1] < 0
    seen = round(motion.rate_hz / (POSITION_BAND * motion.cutoff_hz))
    return np.asarray(maximum_filter1d(still.astype(np.uint8), 2 * seen + 1) > 0)


def _blocks(run: Run, columns: Array, still: BoolArray, free: int) -> Residuals:
    """Average columns (T, C, 1 + p + s) over blocks: white noise stays white."""
    shape = (run.windows, -1, run.block, columns.shape[1])
    means = columns.reshape(*shape, columns.shape[2]).mean(axis=2)
    last = columns.shape[2] - free
    return Residuals(
        residual=means[..., 0],
        jacobian=means[..., 1:last],
        nuisance=means[..., last:],
        kept=np.asarray(~still.reshape(shape).any(axis=2)),
        time=run.motion.time.reshape(run.windows, -1, run.block).mean(axis=2),
        floor=np.full(columns.shape[1], _LEAST_NOISE),
    )
