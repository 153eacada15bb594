"""The observation matrix (15) of a planned motion, and its gradient by the motion.

Columns are the base parameters and, if wanted, the parameters of the drives. Load rows are the
known joint torques of (8), motor rows are (7) reflected to the joint, so all are torques at a joint
[N m or N]. A row is divided by the standard deviation of its torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from seaid._arrays import Array
from seaid.drives import ParameterName
from seaid.drives.functions import (
    SMOOTH_SIGNALS,
    SmoothColumns,
    joint_term_parameters,
    missing_value,
    smooth_columns,
)
from seaid.drives.regressor import DriveRegressor
from seaid.errors import ExcitationError
from seaid.excitation.criteria import States, regressor_gradient
from seaid.excitation.flatness import (
    SIGN_WIDTH,
    ParallelElements,
    Transmission,
    check_nominal_bodies,
    differentiation,
    load_derivatives,
    load_torques,
    motor_signals,
    motor_signals_gradient,
    motor_speeds,
    parallel_elements,
    rigid_transmission,
    transmission,
)
from seaid.regressor import BaseParameters, joint_regressor, motor_regressor, rigid_body_regressor
from seaid.regressor.base import incomplete_group
from seaid.regressor.load import load_model
from seaid.robot import Robot, torques_at_drives
from seaid.robot.inertia import UNITS


@dataclass(frozen=True, eq=False)
class DriveBlock:
    """The columns of one drive: parameters `picked` of its regressor are `columns` of the target.

    `shares` (rows,) are the factors of its torques in every row. `is_parallel`: its signals are
    those of the joint itself, otherwise of the motor and the output of the drive.
    """

    joint: int
    shares: Array
    regressor: SmoothColumns
    columns: tuple[int, ...]
    picked: tuple[int, ...]
    sign_width: float
    is_parallel: bool

    @property
    def signals(self) -> set[str]:
        """Names of the signals in the picked columns."""
        row = [self.regressor.row[place] for place in self.picked]
        return {str(symbol) for entry in row for symbol in entry.free_symbols}


@dataclass(frozen=True, eq=False)
class Target:
    """The rows, columns and scaling of the observation matrix that a motion makes well conditioned.

    Columns are the p base columns, then those of the drives in `blocks`, with `names` and `units`.
    Rows at one instant are, in stance, the six equations of the base, which `row_weights` alone
    counts, then the known torques `rows` and the motors of elastic joints; `at_drives` (r, r) maps
    torques at joints to torques at drives. `needs_load`: columns of drives depend on the load
    torque, which includes the `parallel` elements. `row_weights` (rows,) and `column_scale`
    (columns,) multiply the matrix; `previous_factor` (., columns), scaled alike, is the triangular
    factor of previous logs.
    """

    robot: Robot
    rows: tuple[int, ...]
    base_columns: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    drives: Transmission
    at_drives: Array
    row_weights: Array
    column_scale: Array
    blocks: tuple[DriveBlock, ...] = ()
    parallel: ParallelElements = ()
    needs_load: bool = False
    previous_factor: Array | None = None

    @property
    def description(self) -> str:
        """Number and kind of the parameters, for messages."""
        return f"{len(self.names)} {'parameters' if self.blocks else 'base parameters'}"


def load_target(
    robot: Robot, torque_joints: str | Sequence[str] | None, base: BaseParameters
) -> Target:
    """Return the target of the base parameters alone, unscaled, as in (16).

    Its robot has geometry alone, without parameters and drives. Raises ExcitationError if
    `torque_joints` names some but not all of the joints that drives move together.
    """
    group = incomplete_group(robot.joint_names, robot.transmission, robot.selected(torque_joints))
    if group:
        raise ExcitationError(
            f"the drives of {', '.join(group)} move these joints together: torque_joints= must "
            "name all of them or none to plan a motion",
            "torque_joints=",
        )
    bare = replace(robot.with_values(np.zeros(robot.parameters.size), robot.drives), drives={})
    known = tuple(map(robot.index, robot.selected(torque_joints)))
    return Target(
        robot=bare,
        rows=known,
        base_columns=base.columns,
        names=base.expressions,
        units=tuple(UNITS[column % 10] for column in base.columns),
        drives=rigid_transmission(bare),
        at_drives=np.eye(len(known)),
        row_weights=np.ones(len(known)),
        column_scale=np.ones(len(base.columns)),
    )


def drive_target(
    robot: Robot, torque_joints: str | Sequence[str] | None, base: BaseParameters, top_speed: Array
) -> Target:
    """Return the target of base parameters and drives: friction, stiffness, rotor inertia.

    `top_speed` (n,) [rad/s or m/s] scales the speed width of Coulomb friction. Motor speed and
    deflection follow from the nominal model; raises ExcitationError if an elastic drive or a body
    lacks nominal values, or a column linearised about a nominal value that is missing.
    """
    known, drives = robot.selected(torque_joints), transmission(robot)
    parts = _drive_blocks(robot, drives, known, top_speed)
    plain, model = load_target(robot, torque_joints, base), load_model(robot, base, known)
    # in (8) a drive has only the columns that are identifiable next to the base parameters
    in_load_model = {(joint, name) for joint, name, _ in model.drives}
    names, units = list(model.expressions), list(plain.units)
    blocks = []
    for block in parts:
        joint, regressor = robot.joint_names[block.joint], block.regressor
        is_column = [(joint, name) in in_load_model for name in regressor.names]
        # (10) is in base form: an elastic drive has a motor row of its own, with all its columns
        if np.any(block.shares[len(known) :]):  # in the row of a motor
            is_column = [True] * len(regressor.names)
        picked = tuple(np.flatnonzero(is_column).tolist())
        columns = tuple(range(len(names), len(names) + len(picked)))
        blocks.append(replace(block, columns=columns, picked=picked))
        names += [ParameterName(name, joint) for name in compress(regressor.names, is_column)]
        units += compress(regressor.units, is_column)
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
        parallel=parallel_elements(robot, top_speed, robot.joint_names) if needs_load else (),
        needs_load=needs_load,
        at_drives=torque_map(robot)[np.ix_(plain.rows, plain.rows)],
        row_weights=np.ones(len(known) + len(robot.elastic_joints)),
        column_scale=np.ones(len(names)),
    )


def _drive_blocks(
    robot: Robot, drives: Transmission, known: Sequence[str], top_speed: Array
) -> list[DriveBlock]:
    """Return the blocks of drives and of elements parallel to them, without `picked` columns."""
    load_rows = [robot.index(joint) for joint in known]
    motors = SIGN_WIDTH * motor_speeds(drives, top_speed)
    blocks = []
    for index, joint in enumerate(robot.joint_names):
        shares = np.zeros(len(known) + len(robot.elastic_joints))
        if joint in robot.elastic_joints:
            # (7) times N r_L / r_M is a torque at the joint, like the rows of (8)
            shares[len(known) + robot.elastic_joints.index(joint)] = drives.ratio[index]
        elif joint in known:
            shares[known.index(joint)] = drives.ratio[index]
        if np.any(shares):
            columns = _smooth_columns(joint, motor_regressor(robot, joint))
            blocks.append(DriveBlock(index, shares, columns, (), (), motors[index], False))
        if joint_term_parameters(robot.drives[joint]):
            shares = np.zeros(len(shares))
            # an element parallel to a drive acts on its joint: C^-T gives its torques at the drives
            shares[: len(known)] = torque_map(robot)[load_rows, index]
            columns, width = _smooth_columns(joint, joint_regressor(robot, joint)), top_speed[index]
            blocks.append(DriveBlock(index, shares, columns, (), (), SIGN_WIDTH * width, True))
    return blocks


def _smooth_columns(joint: str, regressor: DriveRegressor) -> SmoothColumns:
    """Return smooth columns. Raises ExcitationError if they need a value that is missing."""
    columns = smooth_columns(regressor)
    if columns.missing:
        raise missing_value(joint, columns.missing[0])
    return columns


def torque_map(robot: Robot) -> Array:
    """Return the matrix (n, n) from torques at joints to torques at drives."""
    return torques_at_drives(robot.transmission, np.eye(robot.n)).T


READINGS_HZ = 1000.0
"""Rate of the torque readings with independent errors for which standard errors are stated."""


def stacked_regressor(target: Target, time: Array, states: States) -> Array:
    """Return the weighted and scaled observation matrix (T rows, columns), (15)."""
    H = np.zeros((len(time), len(target.row_weights), len(target.names)))
    Y = rigid_body_regressor(target.robot, *states)[:, list(target.rows)]
    H[:, : len(target.rows), : len(target.base_columns)] = _transformed(
        target.at_drives, Y[:, :, list(target.base_columns)]
    )
    for block, (columns, _) in _drive_columns(target, time, states)[0]:
        H[:, :, list(block.columns)] = block.shares[:, None] * columns[:, None]
    H *= reading_weights(target, time) * target.column_scale
    return H.reshape(-1, len(target.names))


def regressor_pull_back(target: Target, time: Array, states: States, G: Array) -> States:
    """Return the gradient by q, v and a, each (T, n), of a function with gradient G by H."""
    G = G.reshape(len(time), len(target.row_weights), -1)
    # H is linear in the regressor: a gradient by it has the same weights and scales
    G = G * reading_weights(target, time) * target.column_scale
    robot, r = target.robot, len(target.rows)
    weights = np.zeros((len(time), r, robot.parameters.size))
    weights[:, :, list(target.base_columns)] = _transformed(
        target.at_drives.T, G[:, :r, : len(target.base_columns)]
    )
    gradient = regressor_gradient(robot, states, target.rows, weights)
    by_signal, by_joint = np.zeros((2, len(SMOOTH_SIGNALS), len(time), robot.n))
    blocks, drive_torque = _drive_columns(target, time, states)
    for block, (_, slopes) in blocks:
        by_column = np.einsum("r,trp->tp", block.shares, G[:, :, list(block.columns)])
        felt = by_joint if block.is_parallel else by_signal
        felt[:, :, block.joint] += np.einsum("tp,tps->st", by_column, slopes)
    if not blocks:
        return gradient[0], gradient[1], gradient[2]
    # signals are those of motors and drives; `by_state` is by q, v, a, `by_torque` by tau_phi
    by_state, by_torque = motor_signals_gradient(
        target.drives, by_signal, drive_torque, differentiation(time)
    )
    # elements parallel to drives depend on their own joint: signals 3 to 5, theta_L to theta_L_ddot
    gradient += by_state + by_joint[3:6]
    if target.needs_load:
        tables = load_derivatives(robot, target.parallel, states)
        # tau_phi = M tau with M of `torque_map`, so that the gradient by tau is M^T by_torque
        by_torque = _transformed(torque_map(robot).T, by_torque[:, :, None])[:, :, 0]
        gradient += np.einsum("ti,xtij->xtj", by_torque, tables)
    return gradient[0], gradient[1], gradient[2]


def _transformed(matrix: Array, rows: Array) -> Array:
    """Return matrix (r, r) @ rows (T, r, p); for the identity without rounding."""
    return rows if np.array_equal(matrix, np.eye(len(matrix))) else np.asarray(matrix @ rows)


def reading_weights(target: Target, time: Array) -> Array:
    """Return the weights (T, rows, 1): each row represents all readings around its instant."""
    # trapezoidal rule: H^T H is that of all readings if a row counts times the root of the number
    # of readings that it represents, half as many at either end
    step = (time[-1] - time[0]) / max(len(time) - 1, 1)
    readings = np.full(len(time), READINGS_HZ * step)
    readings[[0, -1]] *= 0.5
    return np.asarray(np.sqrt(readings)[:, None, None] * target.row_weights[:, None])


def _drive_columns(
    target: Target, time: Array, states: States
) -> tuple[list[tuple[DriveBlock, tuple[Array, Array]]], Array]:
    """Return each drive's picked columns (T, p) with slopes (T, p, 7), and the drive torques."""
    drive_torque = np.zeros_like(states[0])
    if not target.blocks:
        return [], drive_torque
    if target.needs_load:
        torque = load_torques(target.robot, target.parallel, states)
        drive_torque = torques_at_drives(target.drives.matrix, torque)
    signals = motor_signals(target.drives, states, drive_torque, differentiation(time))
    # elements parallel to a drive see q of their own joint, not phi = C q
    joint_signals = signals.copy()
    joint_signals[3:6] = states
    evaluated = []
    for block in target.blocks:
        seen = (joint_signals if block.is_parallel else signals)[:, :, block.joint]
        columns, slopes = block.regressor.evaluate(
            dict(zip(SMOOTH_SIGNALS, seen, strict=True)), block.sign_width
        )
        picked = list(block.picked)
        evaluated.append((block, (columns[:, picked], slopes[:, picked])))
    return evaluated, drive_torque
