"""How joints behind springs answer: the load side (8) linearised along a motion, and integrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.linear_algebra import safely
from seaid.robot import Robot
from seaid.transmission import rows_at_drives, torques_at_drives


@dataclass(frozen=True, eq=False)
class TorqueJacobians:
    """Derivatives of the inverse dynamics by q, v and a along a motion, each (T, n, n)."""

    position: Array
    velocity: Array
    acceleration: Array

    def part(self, torques: list[int], joints: list[int]) -> TorqueJacobians:
        """Return the derivatives of some torques by the states of some joints."""
        rows = np.ix_(range(len(self.position)), torques, joints)
        return TorqueJacobians(self.position[rows], self.velocity[rows], self.acceleration[rows])

    def at_drives(self, transmission: Array) -> TorqueJacobians:
        """Return them of the torques on what the drives turn, by that: C^-T J C^-1."""
        return TorqueJacobians(
            *(
                torques_at_drives(transmission, rows_at_drives(transmission, part))
                for part in (self.position, self.velocity, self.acceleration)
            )
        )

    def plus(self, position: Array, velocity: Array) -> TorqueJacobians:
        """Return the derivatives with constant ones (n, n) added to them."""
        return TorqueJacobians(
            self.position + position, self.velocity + velocity, self.acceleration
        )

    def change(self, answer: Answer) -> Array:
        """Return how the torques (T, rows, columns) change with an answer of the joints."""
        return np.asarray(
            self.position @ answer.position
            + self.velocity @ answer.velocity
            + self.acceleration @ answer.acceleration
        )


@dataclass(frozen=True, eq=False)
class Answer:
    """Changes of position, velocity and acceleration of the joints, each (T, joints, columns)."""

    position: Array
    velocity: Array
    acceleration: Array


def torque_jacobians(robot: Robot, q: Array, v: Array, a: Array) -> TorqueJacobians:
    """Return the derivatives of the inverse dynamics, payloads and all, at states (T, n) each."""
    model, data, order = robot.model, robot.model.createData(), list(robot.model_order)
    states = (np.ascontiguousarray(state[:, order]) for state in (q, v, a))
    found = np.empty((3, len(q), robot.n, robot.n))
    compute = pin.computeRNEADerivatives
    for t, (q_t, v_t, a_t) in enumerate(zip(*states, strict=True)):
        compute(model, data, q_t, v_t, a_t)
        found[0, t], found[1, t], found[2, t] = data.dtau_dq, data.dtau_dv, data.M
    upper = np.triu(found[2])
    found[2] = upper + np.swapaxes(np.triu(found[2], 1), 1, 2)
    back = np.argsort(order)
    return TorqueJacobians(*found[:, :, back][:, :, :, back])


def answer_to(jacobians: TorqueJacobians, force: Array, step: float, windows: int) -> Answer:
    """Integrate M a + C v + K q = force (T, joints, columns) by the trapezoidal rule.

    The joints start each of the equally long `windows` at rest; 2 joints columns more, at the end,
    are the free motions from a unit of each initial position and velocity. Second order in `step`,
    which is enough for a change of a motion that is known beforehand.
    """
    T, joints, columns = force.shape
    free = 2 * joints
    M, C, K = (
        matrix.reshape(windows, T // windows, joints, joints)
        for matrix in (jacobians.acceleration, jacobians.velocity, jacobians.position)
    )
    force = force.reshape(windows, T // windows, joints, columns)
    force = np.concatenate([force, np.zeros((*force.shape[:3], free))], axis=3)
    inverse = safely(np.linalg.inv, M + step / 2 * C + step**2 / 4 * K, what="a simulated motion")
    count = force.shape[1]
    q, v, a = (np.zeros((count, windows, joints, columns + free)) for _ in range(3))
    q[0, :, :, columns : columns + joints] = np.eye(joints)
    v[0, :, :, columns + joints :] = np.eye(joints)
    a[0] = safely(
        np.linalg.solve,
        M[:, 0],
        force[:, 0] - C[:, 0] @ v[0] - K[:, 0] @ q[0],
        what="a simulated motion",
    )
    for t in range(1, count):
        v_t = v[t - 1] + step / 2 * a[t - 1]
        q_t = q[t - 1] + step * v[t - 1] + step**2 / 4 * a[t - 1]
        a[t] = inverse[:, t] @ (force[:, t] - C[:, t] @ v_t - K[:, t] @ q_t)
        v[t], q[t] = v_t + step / 2 * a[t], q_t + step**2 / 4 * a[t]
    shape = (T, joints, columns + free)
    return Answer(*(np.swapaxes(part, 0, 1).reshape(shape) for part in (q, v, a)))
