"""The regressor of a target along a motion, (15), and the gradient back to the motion."""

from __future__ import annotations

import numpy as np

from seaid.arrays import Array
from seaid.drivetrain.smooth import SMOOTH_SIGNALS
from seaid.excitation.flatness import (
    differentiation,
    load_derivatives,
    load_torques,
    motor_signals,
    motor_signals_gradient,
)
from seaid.excitation.gradient import States, regressor_gradient
from seaid.excitation.target import DriveBlock, Target, torque_map
from seaid.rigid_body import rigid_body_regressor
from seaid.transmission import torques_at_drives

READINGS_HZ = 1000.0
"""Readings of torque a second, with independent errors, for which standard errors are stated."""


def stacked_regressor(target: Target, time: Array, states: States) -> Array:
    """Return the weighted and scaled regressor (T rows, columns) of a motion, (15).

    `time` (T,) is equally spaced.
    """
    H = np.zeros((len(time), len(target.row_weights), len(target.names)))
    Y = rigid_body_regressor(target.robot, *states)[:, list(target.rows)]
    H[:, : len(target.rows), : len(target.base_columns)] = _mapped(
        target.at_drives, Y[:, :, list(target.base_columns)]
    )
    for block, (columns, _) in _drive_columns(target, time, states)[0]:
        H[:, :, list(block.columns)] = block.shares[:, None] * columns[:, None]
    H *= _weights(target, time) * target.column_scale
    return H.reshape(-1, len(target.names))


def regressor_pull_back(target: Target, time: Array, states: States, G: Array) -> States:
    """Return the gradient by q, v and a, each (T, n), of a function whose gradient by H is G."""
    G = G.reshape(len(time), len(target.row_weights), -1)
    G = G * _weights(target, time) * target.column_scale
    robot, r = target.robot, len(target.rows)
    weights = np.zeros((len(time), r, 10 * robot.n))
    weights[:, :, list(target.base_columns)] = _mapped(
        target.at_drives.T, G[:, :r, : len(target.base_columns)]
    )
    gradient = np.stack(regressor_gradient(robot, states, target.rows, weights))
    by_signal, by_joint = np.zeros((2, len(SMOOTH_SIGNALS), len(time), robot.n))
    blocks, through = _drive_columns(target, time, states)
    for block, (_, slopes) in blocks:
        by_column = np.einsum("r,trp->tp", block.shares, G[:, :, list(block.columns)])
        felt = by_joint if block.acts_beside else by_signal
        felt[:, :, block.joint] += np.einsum("tp,tps->st", by_column, slopes)
    if not blocks:
        return gradient[0], gradient[1], gradient[2]
    by_state, by_torque = motor_signals_gradient(
        target.drives, by_signal, through, differentiation(time)
    )
    gradient += by_state + by_joint[3:6]
    if target.needs_load:
        tables = load_derivatives(robot, target.beside, states)
        by_torque = _mapped(torque_map(robot).T, by_torque[:, :, None])[:, :, 0]
        gradient += np.einsum("ti,xtij->xtj", by_torque, tables)
    return gradient[0], gradient[1], gradient[2]


def _mapped(matrix: Array, rows: Array) -> Array:
    """Return rows (T, r, p) mapped by a matrix (r, r); bit by bit what they are by the identity."""
    return rows if np.array_equal(matrix, np.eye(len(matrix))) else np.asarray(matrix @ rows)


def _weights(target: Target, time: Array) -> Array:
    """Return the weights (T, rows, 1): a row stands for the readings around it."""
    step = (time[-1] - time[0]) / max(len(time) - 1, 1)
    readings = np.full(len(time), READINGS_HZ * step)
    readings[[0, -1]] *= 0.5
    return np.asarray(np.sqrt(readings)[:, None, None] * target.row_weights[:, None])


def _drive_columns(
    target: Target, time: Array, states: States
) -> tuple[list[tuple[DriveBlock, tuple[Array, Array]]], Array]:
    """Return each drive's picked columns (T, p) and their slopes (T, p, 7); torques on drives."""
    through = np.zeros_like(states[0])
    if not target.blocks:
        return [], through
    if target.needs_load:
        torque = load_torques(target.robot, target.beside, states)
        through = torques_at_drives(target.drives.matrix, torque)
    signals = motor_signals(target.drives, states, through, differentiation(time))
    own = signals.copy()
    own[3:6] = states
    found = []
    for block in target.blocks:
        seen = (own if block.acts_beside else signals)[:, :, block.joint]
        columns, slopes = block.regressor.evaluate(
            dict(zip(SMOOTH_SIGNALS, seen, strict=True)), block.sign_width
        )
        picked = list(block.picked)
        found.append((block, (columns[:, picked], slopes[:, picked])))
    return found, through
