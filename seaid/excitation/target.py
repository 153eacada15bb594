"""What a planned motion shall tell, as one regressor: base parameters, and drives if wanted.

Load rows are the known joint torques of (8), motor rows those of (7) seen from the joint, so that
are torques at a joint [N m, or N]. A row is divided by the standard deviation of its torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array
from seaid.base import BaseParameters
from seaid.drive_signals import joint_regressor, motor_regressor
from seaid.drivetrain.curves import beside_names, no_value
from seaid.drivetrain.regressor import DriveRegressor
from seaid.drivetrain.smooth import SmoothColumns, smooth_columns
from seaid.errors import ExcitationError
from seaid.excitation.flatness import (
    SIGN_WIDTH,
    Besides,
    Transmission,
    besides,
    check_nominal_bodies,
    motor_speeds,
    rigid_transmission,
    transmission,
)
from seaid.inertia import UNITS
from seaid.robot import Robot
from seaid.sides.load_model import load_model
from seaid.transmission import named_in_part, torques_at_drives


@dataclass(frozen=True, eq=False)
class DriveBlock:
    """Columns of one drive: where the parameters `picked` of its regressor stand in the whole.

    Torques of the regressor times `shares` (rows,) are what they are in every row. `acts_beside`:
    its signals are those of the joint itself, otherwise of the motor and what it turns.
    """

    joint: int
    shares: Array
    regressor: SmoothColumns
    columns: tuple[int, ...]
    picked: tuple[int, ...]
    sign_width: float
    acts_beside: bool

    @property
    def signals(self) -> set[str]:
        """Names of the signals in the picked columns."""
        row = [self.regressor.row[place] for place in self.picked]
        return {str(symbol) for entry in row for symbol in entry.free_symbols}


@dataclass(frozen=True, eq=False)
class Target:
    """The stacked regressor that a motion shall make well conditioned, and how it is scaled.

    Columns are the p base columns, then those of the drives in `blocks`; `names` and `units` tell
    them. Rows at one instant are the known torques `rows`, then the motors of elastic joints;
    `at_drives` (r, r) makes torques on what the drives turn of those at joints. `needs_load`: drive
    columns depend on the load's torque, to which `beside` belongs.
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
    beside: Besides
    needs_load: bool
    at_drives: Array
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
    p = len(base.columns)
    known = tuple(map(robot.index, robot.rows(rows)))
    return Target(
        robot=bare,
        rows=known,
        base_columns=base.columns,
        blocks=(),
        names=base.expressions,
        units=tuple(UNITS[column % 10] for column in base.columns),
        drives=rigid_transmission(bare),
        beside=(),
        needs_load=False,
        at_drives=np.eye(len(known)),
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
    or a body has none, and where a column is a slope near a value that is not given.
    """
    known, drives = robot.rows(rows), transmission(robot)
    parts = _drive_blocks(robot, drives, known, top_speed)
    plain, model = load_target(robot, rows, base), load_model(robot, base, known)
    names, units = list(model.expressions), list(plain.units)
    blocks = []
    for block in parts:
        joint, regressor = robot.joint_names[block.joint], block.regressor
        told = {name for owner, name, _ in model.drives if owner == joint}
        in_motor_row = np.any(block.shares[len(known) :])
        picked = [i for i, name in enumerate(regressor.names) if in_motor_row or name in told]
        columns = tuple(range(len(names), len(names) + len(picked)))
        blocks.append(replace(block, columns=columns, picked=tuple(picked)))
        names += [f"{regressor.names[i]} of {joint}" for i in picked]
        units += [regressor.units[i] for i in picked]
    needs_load = drives.is_elastic or any("tau_G" in block.signals for block in blocks)
    if needs_load:
        check_nominal_bodies(robot)
    return replace(
        plain,
        robot=robot,
        blocks=tuple(blocks),
        names=tuple(names),
        units=tuple(units),
        drives=drives,
        beside=besides(robot, top_speed, robot.joint_names) if needs_load else (),
        needs_load=needs_load,
        at_drives=torque_map(robot)[np.ix_(plain.rows, plain.rows)],
        row_weights=np.ones(len(known) + len(robot.elastic_joints)),
        column_scale=np.ones(len(names)),
        known=np.empty((0, len(names))),
    )


def _drive_blocks(
    robot: Robot, drives: Transmission, known: Sequence[str], top_speed: Array
) -> list[DriveBlock]:
    """Return what drives, and what acts beside them, bring to the rows; nothing picked yet."""
    load_rows = [robot.index(joint) for joint in known]
    motors = SIGN_WIDTH * motor_speeds(drives, top_speed)
    blocks = []
    for index, joint in enumerate(robot.joint_names):
        shares = np.zeros(len(known) + len(robot.elastic_joints))
        if joint in robot.elastic_joints:
            shares[len(known) + robot.elastic_joints.index(joint)] = drives.ratio[index]
        elif joint in known:
            shares[known.index(joint)] = drives.ratio[index]
        if np.any(shares):
            columns = _valued(joint, motor_regressor(robot, joint))
            blocks.append(DriveBlock(index, shares, columns, (), (), motors[index], False))
        if beside_names(robot.drivetrains[joint]):
            shares = np.zeros(len(shares))
            shares[: len(known)] = torque_map(robot)[load_rows, index]
            columns, width = _valued(joint, joint_regressor(robot, joint)), top_speed[index]
            blocks.append(DriveBlock(index, shares, columns, (), (), SIGN_WIDTH * width, True))
    return blocks


def _valued(joint: str, regressor: DriveRegressor) -> SmoothColumns:
    """Return smooth columns. Raises ExcitationError where a value is missing for them."""
    columns = smooth_columns(regressor)
    if columns.missing:
        raise no_value(joint, columns.missing[0])
    return columns


def torque_map(robot: Robot) -> Array:
    """Return the matrix (n, n) that makes torques on what the drives turn of those at joints."""
    return torques_at_drives(robot.transmission, np.eye(robot.n)).T
