"""What a planned motion shall tell, as one regressor: base parameters, and drives if wanted.

Load rows are the known joint torques of (8), motor rows those of (7) seen from the joint, so that
are torques at a joint [N m, or N]. A row is divided by the standard deviation of its torque.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array
from seaid.base import BaseParameters
from seaid.drivetrain.smooth import SIGNALS, SmoothColumns, smooth_columns
from seaid.errors import ExcitationError
from seaid.excitation.flatness import (
    SIGN_WIDTH,
    Transmission,
    check_nominal_bodies,
    differentiation,
    motor_signals,
    motor_signals_gradient,
    transmission,
)
from seaid.excitation.gradient import States, regressor_gradient, torque_derivatives
from seaid.inertia import UNITS
from seaid.load_side import load_model
from seaid.regression import motor_regressor
from seaid.rigid_body import joint_torques, rigid_body_regressor
from seaid.robot import Robot
from seaid.transmission import named_in_part

READINGS_HZ = 1000.0
"""Readings of torque a second, with independent errors, for which standard errors are stated."""


@dataclass(frozen=True, eq=False)
class DriveBlock:
    """Columns of one drive: where the parameters `picked` of its regressor stand in the whole."""

    joint: int
    row: int
    regressor: SmoothColumns
    columns: tuple[int, ...]
    picked: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Target:
    """The stacked regressor that a motion shall make well conditioned, and how it is scaled.

    Columns are the p base columns, then those of the drives in `blocks`; `names` and `units` tell
    them. Rows at one instant are the known torques `rows`, then the motors of elastic joints.
    `row_weights` (rows,) and `column_scale` (columns,) multiply them; `known` (., columns), scaled
    alike, is the triangular factor of what recorded logs tell already.
    """

    robot: Robot
    rows: tuple[int, ...]
    base_columns: tuple[int, ...]
    blocks: tuple[DriveBlock, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    drives: Transmission
    sign_width: Array
    row_weights: Array
    column_scale: Array
    known: Array

    @property
    def asked(self) -> str:
        """How many parameters of what kind, in words."""
        return f"{len(self.names)} {'parameters' if self.blocks else 'base parameters'}"


def load_target(robot: Robot, rows: Sequence[str] | None, base: BaseParameters) -> Target:
    """Return the target of the base parameters alone, unscaled, as (16) has it.

    It needs the geometry alone: the robot is kept without parameters and drives. Raises
    ExcitationError for rows that are some of the joints that drives move together.
    """
    group = named_in_part(robot.joint_names, robot.transmission, robot.rows(rows))
    if group:
        raise ExcitationError(
            f"the drives of {', '.join(group)} move these joints together: rows= must name all of "
            "them or none to plan a motion"
        )
    bare = replace(robot.with_values(np.zeros(10 * robot.n), robot.drivetrains), drivetrains={})
    nothing, p = np.zeros(robot.n), len(base.columns)
    known = tuple(map(robot.index, robot.rows(rows)))
    return Target(
        robot=bare,
        rows=known,
        base_columns=base.columns,
        blocks=(),
        names=base.expressions,
        units=tuple(UNITS[column % 10] for column in base.columns),
        drives=Transmission(nothing, nothing, nothing),
        sign_width=nothing,
        row_weights=np.ones(len(known)),
        column_scale=np.ones(p),
        known=np.empty((0, p)),
    )


def drive_target(
    robot: Robot, rows: Sequence[str] | None, base: BaseParameters, top_speed: Array
) -> Target:
    """Return the target of base parameters and drives: friction, stiffness, rotor inertia.

    `top_speed` (n,) [rad/s or m/s] sets where Coulomb friction turns. A motor's speed and its
    spring's deflection follow from the nominal model; raises ExcitationError where an elastic drive
    or a body has none.
    """
    known = robot.rows(rows)
    plain, model = load_target(robot, rows, base), load_model(robot, base, known)
    drives = transmission(robot)
    if robot.elastic_joints:
        check_nominal_bodies(robot)
    names, units = list(model.expressions), list(plain.units)
    blocks = []
    for row, joint in enumerate((*known, *robot.elastic_joints)):
        elastic = joint in robot.elastic_joints
        if elastic and row < len(known):
            continue  # its drive is in its motor row
        regressor = smooth_columns(motor_regressor(robot, joint))
        kept = [name for owner, name, _ in model.drives if owner == joint]
        picked = [i for i, name in enumerate(regressor.names) if elastic or name in kept]
        columns = range(len(names), len(names) + len(picked))
        index = robot.index(joint)
        blocks.append(DriveBlock(index, row, regressor, tuple(columns), tuple(picked)))
        names += [f"{regressor.names[i]} of {joint}" for i in picked]
        units += [regressor.units[i] for i in picked]
    return replace(
        plain,
        robot=robot,
        blocks=tuple(blocks),
        names=tuple(names),
        units=tuple(units),
        drives=drives,
        sign_width=SIGN_WIDTH * drives.ratio * top_speed,
        row_weights=np.ones(len(known) + len(robot.elastic_joints)),
        column_scale=np.ones(len(names)),
        known=np.empty((0, len(names))),
    )


def stacked_regressor(target: Target, time: Array, states: States) -> Array:
    """Return the weighted and scaled regressor (T rows, columns) of a motion, (15).

    `time` (T,) is equally spaced.
    """
    H = np.zeros((len(time), len(target.row_weights), len(target.names)))
    Y = rigid_body_regressor(target.robot, *states)
    H[:, : len(target.rows), : len(target.base_columns)] = Y[:, list(target.rows)][
        :, :, list(target.base_columns)
    ]
    for block, (columns, _) in _drive_columns(target, time, states):
        H[:, block.row, list(block.columns)] = columns
    H *= _weights(target, time) * target.column_scale
    return H.reshape(-1, len(target.names))


def regressor_pull_back(target: Target, time: Array, states: States, G: Array) -> States:
    """Return the gradient by q, v and a, each (T, n), of a function whose gradient by H is G."""
    G = G.reshape(len(time), len(target.row_weights), -1)
    G = G * _weights(target, time) * target.column_scale
    robot, r = target.robot, len(target.rows)
    weights = np.zeros((len(time), r, 10 * robot.n))
    weights[:, :, list(target.base_columns)] = G[:, :r, : len(target.base_columns)]
    gradient = np.stack(regressor_gradient(robot, states, target.rows, weights))
    by_signal = np.zeros((len(SIGNALS), len(time), robot.n))
    for block, (_, slopes) in _drive_columns(target, time, states):
        by_signal[:, :, block.joint] += np.einsum(
            "tp,tps->st", G[:, block.row, list(block.columns)], slopes
        )
    if target.blocks:
        by_state, by_torque = motor_signals_gradient(
            target.drives, by_signal, differentiation(time)
        )
        gradient += by_state
        if np.any(target.drives.give):
            tables = torque_derivatives(robot, states)
            gradient += np.einsum("ti,xtij->xtj", by_torque, tables)
    return gradient[0], gradient[1], gradient[2]


def _weights(target: Target, time: Array) -> Array:
    """Return the weights (T, rows, 1): a row stands for the readings around it."""
    step = (time[-1] - time[0]) / max(len(time) - 1, 1)
    readings = np.full(len(time), READINGS_HZ * step)
    readings[[0, -1]] *= 0.5
    return np.asarray(np.sqrt(readings)[:, None, None] * target.row_weights[:, None])


def _drive_columns(
    target: Target, time: Array, states: States
) -> Iterator[tuple[DriveBlock, tuple[Array, Array]]]:
    """Give each drive's columns (T, p), as torques at the joint, and their slopes (T, p, 6)."""
    if not target.blocks:
        return
    springs = np.any(target.drives.give)
    torque = joint_torques(target.robot, *states) if springs else np.zeros_like(states[0])
    signals = motor_signals(target.drives, states, torque, differentiation(time))
    for block in target.blocks:
        ratio = target.drives.ratio[block.joint]
        columns, slopes = block.regressor.evaluate(
            dict(zip(SIGNALS, signals[:, :, block.joint], strict=True)),
            target.sign_width[block.joint],
        )
        picked = list(block.picked)
        yield block, (ratio * columns[:, picked], ratio * slopes[:, picked])
