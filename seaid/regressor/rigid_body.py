"""The joint-torque regressor of the rigid bodies over time, by Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, frozen
from seaid.errors import SeaidError
from seaid.robot import rows_at_drives

if TYPE_CHECKING:
    from seaid.robot import Robot


def rigid_body_regressor(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the joint-torque regressor Y of the rigid bodies: Y[t] @ theta = inverse dynamics.

    Parameters
    ----------
    robot : Robot
    q, v, a : arrays (T, n)
        Joint positions, velocities and accelerations [rad or m, s], in the robot's joint order.

    Returns
    -------
    array (T, n, 10N)
        For standard parameters theta in the order of `robot.parameter_names`; without payload,
        friction and rotor inertia.

    Raises
    ------
    SeaidError
        For wrong shapes.

    Examples
    --------
    >>> Y = seaid.regressor.rigid_body_regressor(robot, q, v, a)
    >>> torque = Y @ robot.parameters
    """
    model, data = robot.model, robot.model.createData()
    q, v, a = (
        frozen(name, value, (None, robot.n)) for name, value in zip("qva", (q, v, a), strict=True)
    )
    if not len(q) == len(v) == len(a):
        raise SeaidError(f"q, v and a must have as many rows, found {len(q)}, {len(v)}, {len(a)}")
    states, N = [robot.to_model(state, k) for k, state in enumerate((q, v, a))], model.nv
    # `flat` is a view of the memory that every call fills, and exists after the first call.
    pin.computeJointTorqueRegressor(model, data, *np.zeros((3, N)))
    # Pinocchio's matrix is column-major: its transposed view is copied as one block.
    flat = data.jointTorqueRegressor.T.reshape(-1)
    stacked, compute = np.empty((len(q), 10 * N * N)), pin.computeJointTorqueRegressor
    for t, (q_t, v_t, a_t) in enumerate(zip(*states, strict=True)):
        compute(model, data, q_t, v_t, a_t)
        stacked[t] = flat
    # (T, 10N N) -> (T, 10N, N) as Pinocchio's columns lie in memory -> (T, N, 10N).
    Y = stacked.reshape(-1, 10 * N, N).swapaxes(1, 2)
    order = robot.model_order
    if list(order) == sorted(order) and not robot.dependent_joints:
        return Y
    # Columns from the model's order of bodies to the robot's; the rows follow in `from_model`,
    # which adds those of mimic joints to their leaders'.
    by_body = Y.reshape(len(q), N, N, 10)[:, :, np.argsort(order)].reshape(len(q), N, 10 * N)
    return np.moveaxis(robot.from_model(np.moveaxis(by_body, 1, -1)), -1, 1)


def regressor_at_drives(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return `rigid_body_regressor` for the torques on the drives' coordinates, (T, n, 10N)."""
    return rows_at_drives(robot.transmission, rigid_body_regressor(robot, q, v, a))


def joint_torques(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the inverse dynamics (T, n) of the robot with its payloads, by Pinocchio's rnea."""
    model, data = robot.model, robot.model.createData()
    states = (
        robot.to_model(np.asarray(state, dtype=np.float64), k) for k, state in enumerate((q, v, a))
    )
    torques, rnea = np.empty((len(q), model.nv)), pin.rnea
    for t, (q_t, v_t, a_t) in enumerate(zip(*states, strict=True)):
        torques[t] = rnea(model, data, q_t, v_t, a_t)
    return robot.from_model(torques)


def torque_slopes(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the derivatives (3, T, n, n) of `joint_torques` by the states q, v and a."""
    states = [robot.to_model(state, k) for k, state in enumerate((q, v, a))]
    return np.ascontiguousarray(robot.from_model(slopes_of_model(robot.model, states), axes=2))


def slopes_of_model(model: pin.Model, states: Sequence[Array]) -> Array:
    """Return d tau / d (q, v, a), (3, T, N, N), at states (T, N) each in the order of a model."""
    data, compute = model.createData(), pin.computeRNEADerivatives
    q, v, a = (np.ascontiguousarray(state) for state in states)
    compute(model, data, *np.zeros((3, model.nv)))
    # Views of memory that Pinocchio overwrites at every instant.
    views, tables = (data.dtau_dq, data.dtau_dv, data.M), np.empty((len(q), 3, model.nv, model.nv))
    for table, q_t, v_t, a_t in zip(tables, q, v, a, strict=True):
        compute(model, data, q_t, v_t, a_t)
        table[0], table[1], table[2] = views
    slopes = np.ascontiguousarray(tables.swapaxes(0, 1))
    # Pinocchio fills only the upper triangle of the mass matrix.
    slopes[2] = np.triu(slopes[2]) + np.triu(slopes[2], 1).swapaxes(1, 2)
    return slopes
