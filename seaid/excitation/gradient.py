"""Derivatives of inverse dynamics and of the regressor, contracted over all samples.

Exact, through Pinocchio's derivatives of the inverse dynamics (Carpentier and Mansard 2018): the
torque of one joint weighted by a parameter vector is the inverse dynamics of a robot that has these
parameters, so a gradient costs one such pass a known torque, however many parameters or trajectory
coefficients there are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.robot import Robot

States = tuple[Array, Array, Array]
"""Joint position, velocity and acceleration, each (T, n)."""


def torque_derivatives(robot: Robot, states: States) -> Array:
    """Return d tau_i / d (q, v, a)_j of the inverse dynamics, (3, T, n, n), payloads included."""
    model, order = robot.model, list(robot.model_order)
    tables = np.empty((3, len(states[0]), robot.n, robot.n))
    inverse = np.argsort(order)
    by_state = _derivatives(model, tuple(state[:, order] for state in states), slice(None), None)
    tables[:] = by_state[:, :, inverse][:, :, :, inverse]
    return tables


def regressor_gradient(
    robot: Robot, states: States, rows: Sequence[int], weights: Array
) -> tuple[Array, Array, Array]:
    """Return the gradient of sum_t sum_r Y_t[rows[r]] . weights[t, r] by q, v and a, each (T, n).

    `weights` (T, r, 10n) are those of the standard regressor's entries. Pinocchio needs bodies with
    mass; torques are linear in the parameters, so equal masses are added everywhere, and taken off
    again once for all rows.
    """
    model, order, n = robot.model.copy(), list(robot.model_order), robot.n
    positions = [order.index(row) for row in rows]
    ordered = tuple(np.ascontiguousarray(state[:, order]) for state in states)
    bodies = weights.reshape(*weights.shape[:2], n, 10)[:, :, order]
    mass = 2.0 * max(float(np.abs(weights).max(initial=0.0)), 1e-12)
    bodies[:, :, :, 0] += mass
    plain = np.zeros(10)
    plain[0] = mass
    for body in range(n):
        model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(plain)
    total = -_derivatives(model, ordered, positions, None).sum(axis=2)
    for r, position in enumerate(positions):
        total += _derivatives(model, ordered, [position], bodies[:, r])[:, :, 0]
    gradient = np.empty_like(total)
    gradient[:, :, order] = total
    return gradient[0], gradient[1], gradient[2]


def _derivatives(
    model: pin.Model, states: tuple[Array, ...], rows: Sequence[int] | slice, bodies: Array | None
) -> Array:
    """Return d tau[rows] / d (q, v, a), (3, T, rows, n), all in the order of the model.

    `bodies` (T, n, 10) are the parameters at every instant, None for those of the model; only those
    that the one row feels are set.
    """
    data, n = model.createData(), model.nv
    q, v, a = (np.ascontiguousarray(state) for state in states)
    pin.computeRNEADerivatives(model, data, q[0], v[0], a[0])
    by_q, by_v, mass_matrix = data.dtau_dq, data.dtau_dv, data.M
    everything = np.arange(n)[rows]
    tables = np.empty((4, len(q), len(everything), n))
    felt: list[int] = []
    if bodies is not None:
        felt = [joint - 1 for joint in model.subtrees[int(everything[0]) + 1]]
    inertias, inertia_of = model.inertias, pin.Inertia.FromDynamicParameters
    compute = pin.computeRNEADerivatives
    index = int(everything[0]) if len(everything) == 1 else everything
    for t in range(len(q)):
        for body in felt:
            inertias[body + 1] = inertia_of(bodies[t, body])  # type: ignore[index]
        compute(model, data, q[t], v[t], a[t])
        tables[0, t], tables[1, t] = by_q[index], by_v[index]
        tables[2, t], tables[3, t] = mass_matrix[index], mass_matrix.T[index]
    # the mass matrix is sure in its upper triangle only
    upper = np.arange(n)[None, :] >= everything[:, None]
    tables[2] = np.where(upper, tables[2], tables[3])
    return tables[:3]
