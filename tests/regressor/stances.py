"""What the stances of a floating base determine, by Pinocchio's own free-flyer.

At random states of each stance the contacts stand still, balls as points at their centres. The rows
of the base and of the joints that no contact force reaches are the left null space of J_c^T times
Pinocchio's regressor. Their columns are those of `seaid.base_parameters(robot, stances=...)`.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag, null_space

from seaid._arrays import Array, BoolArray
from seaid.log.base_log import moving_base
from seaid.regressor import BaseParameters, rigid_body_regressor
from seaid.robot import HANGING, Contact, Robot
from tests.plants import states

_MORE_ROWS, _OF_BRANCH = 12, 6
"""Rows beyond the number of parameters, and the most rows of an instant that show a branch of the
robot in other ways: it acts on the rest by a force and a moment."""


def columns_of_stances(
    robot: Robot,
    stances: Sequence[Sequence[str]],
    *,
    torque_joints: Sequence[str] | None = None,
    measured: Sequence[str] = (),
    seed: int = 0,
) -> tuple[int, ...]:
    """Return the base columns from the left, with the base before the other bodies.

    Stances are as in `seaid.base_parameters`: contacts that touch, none in flight, or "hanging".
    Wrenches of `measured` contacts are known, and torques of `torque_joints`, by default of all.
    """
    H = rows_of_stances(robot, stances, torque_joints, measured, seed)
    return tuple((pivot - 10) % H.shape[1] for pivot in leftmost(H))


def check_base(base: BaseParameters, H: Array) -> None:
    """Check columns and grouping of base parameters by rows (R, m) at random states."""
    assert base.columns == tuple(leftmost(H))
    scale = np.max(np.abs(H))
    np.testing.assert_allclose(H[:, base.columns] @ base.grouping, H, atol=1e-9 * scale)


def rows_of_torques(robot: Robot, joints: Sequence[str]) -> Array:
    """Return the rows (R, m) of the torques of some joints of a robot on a fixed base."""
    q, v, a = states(robot.n, 12 * robot.n + 12)
    Y = rigid_body_regressor(robot, 2 * q, v, a)[:, [robot.index(joint) for joint in joints]]
    Y[:, :, robot.is_known] = 0
    return Y.reshape(-1, Y.shape[-1])


def rows_of_stances(
    robot: Robot,
    stances: Sequence[Sequence[str]],
    torque_joints: Sequence[str] | None = None,
    measured: Sequence[str] = (),
    seed: int = 0,
) -> Array:
    """Return the rows (R, m) of some stances, the columns of the base before those of others."""
    model, rng = _FreeFlyer(robot), np.random.default_rng(seed)
    known = [6 + robot.index(joint) for joint in robot.selected(torque_joints)]
    width = len(robot.parameters)
    blocks = [np.zeros((0, width))]
    for links in stances:
        count, instant = 0, np.zeros((0, width))
        while count < width + _MORE_ROWS:
            instant = model.rows(rng, links, known, measured)
            blocks.append(instant)
            count += min(max(len(instant), 1), _OF_BRANCH)
    H = np.vstack(blocks)
    H[:, robot.is_known] = 0
    return np.roll(H, 10, axis=1)


class _FreeFlyer:
    """Pinocchio's model of a robot on a free joint, and its columns in the order of the robot."""

    def __init__(self, robot: Robot) -> None:
        base = pin.Model()
        base.gravity = robot.model.gravity
        root = base.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "floating base")
        base.addFrame(pin.Frame("floating base", root, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        self.model = pin.appendModel(base, robot.model, 1, pin.SE3.Identity())
        self.robot = robot
        joints = [self.model.getJointId(name) for name in robot.all_joint_names]
        self.order = [*range(6), *(self.model.joints[joint].idx_v for joint in joints)]
        self.bodies = [*joints, root]
        self.base = moving_base(robot)
        for contact in self.base.contacts:
            body, rotation, position = self.base.frame(contact.link)
            place = pin.SE3(np.eye(3), position + rotation @ np.array(contact.position_m))
            name = f"contact of {contact.link}"
            self.model.addFrame(pin.Frame(name, self.bodies[body], place, pin.FrameType.OP_FRAME))

    def rows(
        self,
        rng: np.random.Generator,
        links: Sequence[str],
        known: Sequence[int],
        measured: Sequence[str],
    ) -> Array:
        """Return the rows (r, m) that no unknown force reaches, at a random state of a stance."""
        n, data, free = self.robot.n, self.model.createData(), self.base.free_axes
        if links == HANGING:
            links, free = (), np.zeros(6, dtype=bool)
        joints = rng.uniform(-2, 2, n)
        q = np.empty(self.model.nq)
        q[:7] = pin.SE3ToXYZQUAT(pin.SE3(self._orientation(rng, free), np.zeros(3)))
        q[[self.model.joints[joint].idx_q for joint in self.bodies[:-1]]] = self.robot.expand(
            joints
        )
        # velocities of the free axes of the base and of the leaders give those of all joints
        E = np.zeros((self.model.nv, 6 + n))
        E[self.order] = block_diag(np.eye(6), self.robot.expand(np.eye(n), 1).T)
        axes = [*np.flatnonzero(free), *range(6, 6 + n)]
        v, a = rng.normal(0, 3, (2, 6 + n))
        v[:6], a[:6] = v[:6] * free, a[:6] * free
        touching = [contact for contact in self.base.contacts if contact.link in links]
        jacobians = {contact: self._jacobian(data, q, contact) @ E for contact in touching}
        if touching:
            J = np.vstack(list(jacobians.values()))
            v[axes] -= np.linalg.pinv(J[:, axes]) @ (J[:, axes] @ v[axes])
            pin.forwardKinematics(self.model, data, q, E @ v, 0 * (E @ v))
            drift = np.concatenate([self._drift(data, contact) for contact in touching])
            a[axes] -= np.linalg.pinv(J[:, axes]) @ (J[:, axes] @ a[axes] + drift)
        Y = E.T @ pin.computeJointTorqueRegressor(self.model, data, q, E @ v, E @ a)
        columns = [np.arange(10 * body - 10, 10 * body) for body in self.bodies]
        kept = [*np.flatnonzero(free), *known]
        hidden = [jacobians[contact] for contact in touching if contact.link not in measured]
        reached = np.vstack([np.zeros((1, len(kept))), *(J[:, kept] for J in hidden)])
        return np.asarray(null_space(reached, 1e-9).T @ Y[np.ix_(kept, np.concatenate(columns))])

    def _orientation(self, rng: np.random.Generator, free: BoolArray) -> Array:
        """Return a random rotation of the base in the world, about the normal of a planar one."""
        normal = self.base.normal
        if not np.any(free):
            return np.eye(3)
        if normal is None:
            return np.asarray(pin.exp3(rng.uniform(-2, 2, 3)))
        # gravity along the normal is the same at all angles
        upright = pin.Quaternion.FromTwoVectors(np.array(normal), self.base.normal_in_world)
        turned = pin.exp3(rng.uniform(-3, 3) * np.array(normal))
        return np.asarray(upright.toRotationMatrix() @ turned)

    def _jacobian(self, data: pin.Data, q: Array, contact: Contact) -> Array:
        """Return that of the velocity (3,) of a point, or of a flat foot (6,)."""
        frame = self.model.getFrameId(f"contact of {contact.link}")
        J = pin.computeFrameJacobian(self.model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(J[: 6 if contact.is_flat else 3])

    def _drift(self, data: pin.Data, contact: Contact) -> Array:
        """Return the acceleration of a contact while base and joints do not accelerate."""
        frame = self.model.getFrameId(f"contact of {contact.link}")
        pin.updateFramePlacement(self.model, data, frame)
        found = pin.getFrameClassicalAcceleration(self.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(found.vector[: 6 if contact.is_flat else 3])


def leftmost(H: Array) -> list[int]:
    """Return the columns that do not depend on those to their left, clearly apart from others."""
    norms = np.linalg.norm(H, axis=0)
    basis, pivots, parts = np.zeros((len(H), 0)), list[int](), list[float]()
    for column in np.flatnonzero(norms > 1e-9 * max(1.0, norms.max(initial=0.0))).tolist():
        rest = H[:, column] / norms[column]
        for _ in range(2):  # orthogonal to rounding after the second time
            rest = rest - basis @ (basis.T @ rest)
        parts.append(float(np.linalg.norm(rest)))
        if parts[-1] > 1e-6:
            basis = np.column_stack([basis, rest / parts[-1]])
            pivots.append(column)
    dependent = [part for part in parts if part <= 1e-6]
    assert max(dependent, default=0.0) < 1e-3 * min(set(parts) - set(dependent), default=1.0)
    return pivots
