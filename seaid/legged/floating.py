"""The robot whose base moves: its type, and the equations of its base and joints.

The rows are those of the base (force and moment on it, in its frame) and of the joints:
M v' + h = S^T tau + sum J_c^T f_c. Contact forces that were not measured are unknown at every
instant. Multiplied by P = 1 - Q Q^T, with Q an orthonormal basis of the columns of all J_c^T, the
rows do not contain them (Mistry, Buchli, Schaal 2010); the least-squares solution is that with the
contact forces as further unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, BoolArray, IndexArray, safely
from seaid.errors import LogError, RobotError
from seaid.log import Motion
from seaid.log.base_log import BaseMotion, moving_base
from seaid.log.motion import MotionWithBase
from seaid.robot import BASE_ROWS, HANGING, Contact, FloatingBase, Robot
from seaid.robot.pinocchio_model import floating_model
from seaid.robot.transmission import rows_at_drives
from seaid.robot.urdf import EARTH

BaseStates = tuple[Array, Array, Array]
"""Angular velocity [rad/s] and acceleration, specific force [m/s^2] of the base, each (T, 3)."""


@dataclass(frozen=True, eq=False, repr=False)
class FloatingRobot(Robot):
    """A robot whose base nothing holds, or a guide lets move in a plane.

    Attributes
    ----------
    floating_base : FloatingBase
        The base, whose body is the last of the robot's; `model` is that of the joints on a held
        base.
    guided : tuple of str
        Those of `BASE_ROWS` that have an unknown force of a guide, besides those off its plane.
    """

    floating_base: FloatingBase = field(kw_only=True)
    guided: tuple[str, ...] = ()
    base_is_held = False

    def _in_short(self) -> str:
        kind = "floating" if self.floating_base.normal is None else "planar"
        return f"{super()._in_short()}, {kind} base"

    @property
    def free_axes(self) -> BoolArray:
        """Whether nothing holds the base along x, y, z and about x, y, z of its frame (6,)."""
        return self.floating_base.free_axes & ~np.isin(BASE_ROWS, self.guided)

    def joint_of(self, body: int) -> str:
        """Return the joint that moves a body, the first one for the base, which none moves."""
        return super().joint_of(0 if body == len(self.body_names) - 1 else body)


def planar_rotations(base: FloatingBase, angle_rad: Array) -> Array:
    """Return the rotations (T, 3, 3) of a planar base at its angles (T,) in the world."""
    n, upright = np.array(base.normal), np.eye(3) if base.upright is None else base.upright
    K = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    s, c = np.sin(angle_rad)[:, None, None], np.cos(angle_rad)[:, None, None]
    # Rodrigues: exp(angle [n]x) = 1 + sin [n]x + (1 - cos) [n]x^2.
    return np.asarray(upright @ (np.eye(3) + s * K + (1 - c) * K @ K))


def floating(robot: Robot) -> FloatingRobot:
    """Return a robot whose base is known to move, as one of its type."""
    assert isinstance(robot, FloatingRobot)
    return robot


def base_of(motion: Motion) -> BaseMotion:
    """Return the motion of the base of a robot whose base is known to move."""
    assert isinstance(motion, MotionWithBase)
    return motion.base


@lru_cache(maxsize=8)
def guided(robot: Robot, rows: tuple[str, ...]) -> FloatingRobot:
    """Return the robot whose base a guide holds in those `rows` that are of `BASE_ROWS`."""
    of_base = tuple(row for row in rows if row in BASE_ROWS)
    return replace(floating(robot), guided=of_base) if of_base else floating(robot)


def floating_regressor(
    robot: Robot,
    q: Array,
    v: Array,
    a: Array,
    base: BaseStates,
    columns: Sequence[int] | None = None,
) -> Array:
    """Return the regressor Y (T, 6 + n, 10N) of the rows of the base and of the joints.

    Y[t] @ theta is the force and moment on the base in its frame, and the torques at the joints;
    `columns` selects some of its columns.
    """
    model = _model(robot)
    data = model.createData()
    # Pinocchio has the base first, seaid last
    bodies = np.array([*(1 + np.argsort(robot.model_order)), 0])
    places = np.add.outer(10 * bodies, np.arange(10)).ravel()
    places = places if columns is None else places[list(columns)]
    stacked = np.empty((len(q), len(places), model.nv))
    states = zip(*_states(robot, q, v, a, base), strict=True)
    for t, (q_t, v_t, a_t) in enumerate(states):
        whole = pin.computeJointTorqueRegressor(model, data, q_t, v_t, a_t).T
        # With mode="clip" `take` writes into `out` directly; by default it would need a buffer.
        np.take(whole, places, axis=0, out=stacked[t], mode="clip")
    joints = robot.from_model(stacked[:, :, 6:])
    return np.concatenate([stacked[:, :, :6], joints], axis=2).swapaxes(1, 2)


def accelerated_base(robot: Robot, q: Array) -> Array:
    """Return the force on the rows (T, 6 + n, 3) per acceleration of the base, in its frame.

    They are three columns of the mass matrix.
    """
    model, nothing = _model(robot), (np.zeros((len(q), 3)),) * 3
    data, still = model.createData(), np.zeros((len(q), robot.n))
    mass = np.empty((len(q), 3, model.nv))
    for t, q_t in enumerate(_states(robot, q, still, still, nothing)[0]):
        # The base is first: its rows are whole in the upper triangle, which crba always fills.
        mass[t] = np.triu(pin.crba(model, data, q_t))[:3]
    return np.concatenate([mass[:, :, :6], robot.from_model(mass[:, :, 6:])], axis=2).swapaxes(1, 2)


def contact_map(
    robot: Robot,
    q: Array,
    contacts: Sequence[Contact],
    up: Array | None = None,
    own_frame: bool = False,
) -> Array:
    """Return J_c^T (T, 6 + n, k) of the forces of contacts on the rows, in the frame of the base.

    A point has three columns, a flat foot three more of the moment about it. `up` (T, 3) shows
    where balls touch the ground. With `own_frame` the forces are those in the frames of the links.
    """
    model, frames, widths = with_contact_frames(robot, tuple(contacts))
    data, still = model.createData(), np.zeros((len(q), robot.n))
    nothing = (np.zeros((len(q), 3)),) * 3
    J = np.empty((len(q), sum(widths), model.nv))
    for t, q_t in enumerate(_states(robot, q, still, still, nothing)[0]):
        pin.computeJointJacobians(model, data, q_t)
        start = 0
        for contact, frame, width in zip(contacts, frames, widths, strict=True):
            # The base is at the origin (`_states`): the axes of the world are those of the base.
            whole = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            if contact.radius_m and up is not None:
                # v at the lowest point: v_c + w x (-r up) = v_c + r up x w
                whole[:3] += contact.radius_m * pin.skew(up[t]) @ whole[3:]
            if own_frame:
                R = pin.updateFramePlacement(model, data, frame).rotation
                whole = np.vstack([R.T @ whole[:3], R.T @ whole[3:]])
            J[t, start : start + width] = whole[:width]
            start += width
    return np.concatenate([J[:, :, :6], robot.from_model(J[:, :, 6:])], axis=2).swapaxes(1, 2)


def without_contact_forces(
    robot: Robot,
    q: Array,
    touching: Mapping[str, BoolArray],
    joints: Sequence[int],
    rows: Array,
    unknown: BoolArray | None = None,
    up: Array | None = None,
) -> Array:
    """Return rows (T, 6 + k, m) of the base and of k joints, without the contact forces.

    `touching` {link: (T,)} says when each contact has a force that was not measured; `unknown`
    (T, k) marks rows of joints that are not used; `up` (T, 3) is needed for feet that are balls.
    The rows of the forces on the base count times the typical lever of the contacts, so that all
    rows have the unit of a torque.
    """
    rows = rows.copy()
    rows[:, :6][:, ~floating(robot).free_axes] = 0.0
    if unknown is not None:
        rows[:, 6:] *= ~unknown[:, :, None]
    contacts = [contact for contact in moving_base(robot).contacts if contact.link in touching]
    scale = row_scale(robot, rows.shape[1])
    for now, columns, A in _stance_maps(robot, q, contacts, touching, joints, unknown, up):
        if columns.size:
            Q = _range(A)
            part = scale * rows[now]
            residual = part - Q @ (Q.swapaxes(1, 2) @ part)
            # orthonormal columns: the sum of squares is the rank
            # Forces that reach all rows with an equation leave nothing of these but rounding.
            hidden = np.sum(Q**2, axis=(1, 2)) > np.any(part, axis=2).sum(axis=1) - 0.5
            rows[now] = np.where(hidden[:, None, None], 0.0, residual / scale)
    return rows


def contact_equations(
    robot: Robot,
    q: Array,
    contacts: Sequence[Contact],
    touching: Mapping[str, BoolArray],
    joints: Sequence[int],
    unknown: BoolArray | None = None,
    up: Array | None = None,
) -> tuple[Array, Array]:
    """Return J_c^T (T, 6 + k, m) and its pseudo-inverse, by which rows determine contact forces.

    Both are those of rows times `row_scale`; the arguments are as in `without_contact_forces`. The
    columns of contacts that do not touch the ground are zero.
    """
    count = sum(force_counts(contacts))
    A = np.zeros((len(q), 6 + len(joints), count))
    inverse = A.swapaxes(1, 2).copy()
    for now, columns, part in _stance_maps(robot, q, contacts, touching, joints, unknown, up):
        if columns.size:
            turned = safely(
                partial(np.linalg.pinv, rcond=_DEPENDENT),
                part,
                what="the contact forces",
                error=LogError,
            )
            A[np.ix_(now, np.arange(A.shape[1]), columns)] = part
            inverse[np.ix_(now, columns, np.arange(A.shape[1]))] = turned
    return A, inverse


def force_counts(contacts: Sequence[Contact]) -> list[int]:
    """Return how many components of force and moment each contact has."""
    return [6 if contact.is_flat else 3 for contact in contacts]


def row_scale(robot: Robot, count: int) -> Array:
    """Return the factors (count, 1) by which all rows have the unit of a torque."""
    return np.where(np.arange(count) < 3, _typical_lever(robot), 1.0)[:, None]


def _stance_maps(
    robot: Robot,
    q: Array,
    contacts: Sequence[Contact],
    touching: Mapping[str, BoolArray],
    joints: Sequence[int],
    unknown: BoolArray | None,
    up: Array | None,
) -> Iterator[tuple[IndexArray, IndexArray, Array]]:
    """Yield the instants of each stance, its columns, and J_c^T of them in scaled rows."""
    patterns = np.array([touching[contact.link] for contact in contacts]).T
    if not np.any(patterns):
        return
    balls = [contact.link for contact in contacts if contact.radius_m]
    if balls and up is None:
        raise LogError(
            f"the contact at {balls[0]} is a ball, whose lowest point depends on the orientation "
            "of the base, which the log has not: add base.orientation_w ... _z"
        )
    A = floating_rows(robot, contact_map(robot, q, contacts, up), joints)
    if unknown is not None:
        A[:, 6:] *= ~unknown[:, :, None]
    A *= row_scale(robot, A.shape[1])
    # (m,) the contact of each column of A.
    owner = np.repeat(np.arange(len(contacts)), force_counts(contacts))
    for pattern in np.unique(patterns, axis=0):
        now = np.flatnonzero(np.all(patterns == pattern, axis=1))
        columns = np.flatnonzero(pattern[owner])
        yield now, columns, A[now][:, :, columns]


_DEPENDENT = 1e-8
"""Size of a column of contact forces, over the largest, after which it depends on the others."""


def _range(A: Array) -> Array:
    """Return matrices (T, r, k) whose columns are an orthonormal basis of those of A, or zero.

    Several points of one foot, and legs that move in a plane, have dependent contact forces.
    """
    # QR gives a basis of independent columns, the usual case; the others need the SVD.
    Q, R = safely(np.linalg.qr, A, what="the contact forces", error=LogError)
    size = np.abs(np.diagonal(R, axis1=1, axis2=2))
    lacking = size.min(axis=1) <= _DEPENDENT * size.max(axis=1)
    # With more forces than rows Q has too few columns: the SVD decides at all instants.
    if A.shape[2] > A.shape[1]:
        lacking[:] = True
        Q = np.zeros_like(A)
    if np.any(lacking):
        U, s, _ = safely(
            partial(np.linalg.svd, full_matrices=False),
            A[lacking],
            what="the contact forces",
            error=LogError,
        )
        Q[lacking, :, : s.shape[1]] = U * (s > _DEPENDENT * s[:, :1])[:, None]
    return np.asarray(Q)


def measured_wrenches(
    robot: Robot,
    q: Array,
    wrenches: Mapping[str, Array],
    joints: Sequence[int],
    up: Array | None = None,
) -> Array:
    """Return what measured wrenches contribute to the rows (T, 6 + k): sum of J_c^T w.

    Forces without moments on a ball act at its lowest point, if `up` (T, 3) is known.
    """
    rows = np.zeros((len(q), 6 + len(joints)))
    for link, values in wrenches.items():
        contact = measured_contact(robot, link, values.shape[1])
        A = floating_rows(robot, contact_map(robot, q, [contact], up, own_frame=True), joints)
        rows += np.einsum("trk,tk->tr", A, values)
    return rows


def measured_contact(robot: Robot, link: str, width: int) -> Contact:
    """Return the contact of a wrench with so many columns; with moments it acts at its place."""
    contact = moving_base(robot).contact_of(link)
    return replace(contact, is_flat=width == 6, radius_m=0.0 if width == 6 else contact.radius_m)


def contact_rotations(robot: Robot, q: Array, contacts: Sequence[Contact]) -> Array:
    """Return the rotations (T, k, 3, 3) of the links of contacts in the frame of the base."""
    model, frames, _ = with_contact_frames(robot, tuple(contacts))
    data, still = model.createData(), np.zeros((len(q), robot.n))
    nothing = (np.zeros((len(q), 3)),) * 3
    rotations = np.empty((len(q), len(frames), 3, 3))
    for t, q_t in enumerate(_states(robot, q, still, still, nothing)[0]):
        pin.framesForwardKinematics(model, data, q_t)
        rotations[t] = [data.oMf[frame].rotation for frame in frames]
    return rotations


def stance_rows(
    robot: Robot,
    links: Sequence[str],
    seed: int,
    joints: Sequence[int],
    measured: Sequence[str] = (),
) -> tuple[BaseStates, Array, Callable[[Array], Array]]:
    """Return random states of joints in a stance, the rows (T, 6 + k, m) of bodies, and a function.

    The function removes the contact forces of the stance that are not `measured` from rows. A ball
    counts as a point at its centre, which hides the mass there: its roll shows of a mass m what has
    an inertia of m r^2, far below the noise in the columns, which would bias all parameters that
    this mass belongs to.
    """
    count = -(-30 * len(robot.body_names) // 6)  # three equations per parameter
    if links == HANGING:
        states = stance_states(robot, (), seed, count)[0]
        still = np.zeros((count, 3))
        # An accelerometer on a base at rest measures -g.
        base = (still, still, still - robot.model.gravity.linear)
        Y = floating_rows(robot, floating_regressor(robot, *states, base), joints)
        return states, Y, lambda rows: np.asarray(rows * (np.arange(rows.shape[1]) >= 6)[:, None])
    robot = guided(_with_points(robot), tuple(links))
    states, base = stance_states(robot, links, seed, count)
    hidden = (link for link in links if link not in measured)
    touching = dict.fromkeys(hidden, np.ones(count, dtype=bool))
    Y = floating_rows(robot, floating_regressor(robot, *states, base), joints)

    def reduced(rows: Array) -> Array:
        return without_contact_forces(robot, states[0], touching, joints, rows)

    return states, Y, reduced


def _with_points(robot: Robot) -> Robot:
    """Return the robot with points in place of the balls that touch the ground."""
    points = tuple(replace(contact, radius_m=0.0) for contact in moving_base(robot).contacts)
    return replace(floating(robot), floating_base=replace(moving_base(robot), contacts=points))


def stance_states(
    robot: Robot, links: Sequence[str], seed: int, count: int
) -> tuple[BaseStates, BaseStates]:
    """Return random states of joints and of the base in which some points or flat feet stand.

    Velocities v with J_c v = 0, accelerations with J_c v' + J_c' v = 0, and gravity in any
    direction: a base that is turned feels it from there. A planar base turns about its normal.
    """
    base, free = moving_base(robot), floating(robot).free_axes
    contacts = [contact for contact in base.contacts if contact.link in links]
    rng = np.random.default_rng(seed)
    shape = (count, 6 + robot.n)
    reach = np.where(robot.is_prismatic, 1.0, np.pi)
    q = rng.uniform(-reach, reach, (count, robot.n))
    v, a = rng.normal(0, 3, shape), rng.normal(0, 10, shape)
    up = rng.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    if base.normal is not None:
        angles = rng.uniform(-np.pi, np.pi, count) * np.any(free[3:])
        R, down = planar_rotations(base, angles), robot.model.gravity.linear
        # A row vector times R is R^T times the vector: the vertical in the axes of the base.
        up = -down / (np.linalg.norm(down) or 1.0) @ R
        v[:, :6] *= free
        a[:, :6] *= free
    if contacts:
        J = contact_map(robot, q, contacts).swapaxes(1, 2)
        J[:, :, :6] *= free
        inverse = safely(np.linalg.pinv, J, what="the contacts", error=RobotError)

        def within(x: Array, wanted: Array) -> Array:
            missing = wanted - np.einsum("tij,tj->ti", J, x)
            return np.asarray(x + np.einsum("tij,tj->ti", inverse, missing))

        v = within(v, np.zeros(J.shape[:2]))
        a = within(a, -_drift(robot, q, v, contacts))
    # Specific force: a - g, which is a + 9.81 m/s^2 upward.
    return (q, v[:, 6:], a[:, 6:]), (v[:, 3:6], a[:, 3:6], a[:, :3] - EARTH[2] * up)


def _drift(robot: Robot, q: Array, v: Array, contacts: Sequence[Contact]) -> Array:
    """Return J_c' v (T, k): the accelerations of contacts at velocities (T, 6 + n)."""
    model, frames, widths = with_contact_frames(robot, tuple(contacts))
    data, still = model.createData(), np.zeros((len(q), robot.n))
    base = (v[:, 3:6], np.zeros((len(q), 3)), np.zeros((len(q), 3)))
    drift = np.empty((len(q), sum(widths)))
    states = zip(*_states(robot, q, v[:, 6:], still, base), v[:, :3], strict=True)
    for t, (q_t, v_t, a_t, linear) in enumerate(states):
        v_t[:3] = linear
        a_t[:3] = -np.cross(v_t[3:6], linear)  # no classical acceleration of the origin
        pin.forwardKinematics(model, data, q_t, v_t, a_t)
        parts = [
            pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
            for frame in frames
        ]
        drift[t] = np.concatenate([x[:width] for x, width in zip(parts, widths, strict=True)])
    return drift


def standing_motion(
    robot: Robot,
    contacts: tuple[Contact, ...],
    anchors: Sequence[pin.SE3],
    z: Array,
    rates: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Return the errors (T, k) of contacts, their K (T, k, 6 + n), and the bias K' v (T, k).

    Coordinates z (T, 6 + n) and their `rates` are position [m] and roll, pitch, yaw [rad] of the
    base in the world, and joints; `anchors` are the placements of the contacts, K = d errors / d z.

    The centre of a ball moves by its radius times the horizontal part of the turn of what was its
    top, as one that rolls does up to the third order of the angle.
    """
    whole, frames, widths = with_contact_frames(robot, contacts)
    up = upward(robot)
    level = np.eye(3) - np.outer(up, up)
    speeds = np.zeros_like(z) if rates is None else rates
    R, E, E_dot = roll_pitch_yaw(z, speeds)
    q = configurations(robot, z, R)
    twist = np.einsum("tji,tj->ti", R, speeds[:, :3])
    spin = np.einsum("tij,tj->ti", E, speeds[:, 3:6])
    v = np.hstack([twist, spin, robot.to_model(speeds[:, 6:], 1)])
    # At constant rates, the twist v = (R^T p', E rates) changes by (-w x R^T p', E' rates).
    a = np.zeros_like(v)
    a[:, :3] = -np.cross(spin, twist)
    a[:, 3:6] = np.einsum("tij,tj->ti", E_dot, speeds[:, 3:6])
    motions = _frame_motions(whole, frames, q, v, None if rates is None else a)
    errors, bias, jacobians = [], [], []
    for k, (contact, width, anchor) in enumerate(zip(contacts, widths, anchors, strict=True)):
        place, turn, jacobian, acceleration = (x[k] for x in motions)
        away = place - anchor.translation
        if contact.radius_m:
            top = turn @ (anchor.rotation.T @ up)
            rolled = contact.radius_m * level
            away = away - top @ rolled
            # d/dt top = w x top = -[top]x w.
            jacobian[:, :3] += rolled @ _skew(top) @ jacobian[:, 3:]
            w = np.einsum("tij,tj->ti", jacobian[:, 3:], v)
            turning = np.cross(acceleration[:, 3:], top) + np.cross(w, np.cross(w, top))
            acceleration[:, :3] -= turning @ rolled
        if width == 6:
            # The rotation vector of R_c R_0^T, in the axes of the world: zero at the anchor.
            turned = [pin.log3(rotation @ anchor.rotation.T) for rotation in turn]
            away = np.hstack([away, np.reshape(turned, (-1, 3))])
        errors.append(away)
        jacobians.append(jacobian[:, :width])
        bias.append(acceleration[:, :width])
    J = np.concatenate(jacobians, axis=1)
    K = np.concatenate([J[:, :, :6], robot.from_model(J[:, :, 6:])], axis=2)
    # From the twist of the base to the rates of its coordinates: v = R^T p', w = E rates.
    K[:, :, :3] = J[:, :, :3] @ R.swapaxes(1, 2)
    K[:, :, 3:6] = J[:, :, 3:6] @ E
    return np.hstack(errors), K, np.hstack(bias)


def _frame_motions(
    model: pin.Model, frames: Sequence[int], q: Array, v: Array, a: Array | None
) -> tuple[Array, Array, Array, Array]:
    """Return places (k, T, 3), rotations, Jacobians and accelerations (k, T, 6) of frames.

    The axes are those of the world. Without `a` the accelerations are zero.
    """
    data, axes = model.createData(), [model.frames[index] for index in frames]
    joints = [frame.parentJoint for frame in axes]
    whole, change = np.empty((2, len(q), 6, model.nv))
    places, rotations = np.empty((len(frames), len(q), 3)), np.empty((len(frames), len(q), 3, 3))
    for t in range(len(q)):
        if a is None:
            whole[t] = pin.computeJointJacobians(model, data, q[t])
        else:
            change[t] = pin.computeJointJacobiansTimeVariation(model, data, q[t], v[t])
            whole[t] = data.J
        for k, joint in enumerate(joints):
            placement = data.oMi[joint]
            places[k, t], rotations[k, t] = placement.translation, placement.rotation
    jacobians, accelerations = np.empty((len(frames), *whole.shape)), []
    for k, frame in enumerate(axes):
        places[k] += rotations[k] @ frame.placement.translation
        rotations[k] = rotations[k] @ frame.placement.rotation
        # Pinocchio's Jacobian has all joints; only those between base and frame move the frame.
        moving = np.zeros(model.nv)
        for joint in list(model.supports[frame.parentJoint])[1:]:
            start = model.joints[joint].idx_v
            moving[start : start + model.joints[joint].nv] = 1.0
        # of the point of a body that is in the origin: v = v_0 + w x p
        J = jacobians[k] = whole * moving
        jacobians[k, :, :3] -= _skew(places[k]) @ J[:, 3:]
        if a is None:
            accelerations.append(np.zeros((len(q), 6)))
            continue
        A = np.einsum("tij,tj->ti", J, a) + np.einsum("tij,tj->ti", change * moving, v)
        speed = np.einsum("tij,tj->ti", jacobians[k], v)
        # Classical acceleration of the point: a_0 + e x p + w x v.
        A[:, :3] += np.cross(A[:, 3:], places[k]) + np.cross(speed[:, 3:], speed[:, :3])
        accelerations.append(A)
    return places, rotations, jacobians, np.array(accelerations)


def _skew(vectors: Array) -> Array:
    """Return the matrices (T, 3, 3) of the cross products with vectors (T, 3)."""
    return np.cross(vectors[:, None], np.eye(3)).swapaxes(1, 2)


def roll_pitch_yaw(z: Array, rates: Array) -> tuple[Array, Array, Array]:
    """Return R (T, 3, 3) of roll, pitch and yaw, E with w = E rates in the base, and E'."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(z[:, 3:6]).T, np.sin(z[:, 3:6]).T
    R = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    nil, (roll, pitch, _) = np.zeros_like(cr), rates[:, 3:6].T
    E = np.array([[nil + 1, nil, -sp], [nil, cr, sr * cp], [nil, -sr, cr * cp]])
    E_dot = np.array(
        [
            [nil, nil, -cp * pitch],
            [nil, -sr * roll, cr * cp * roll - sr * sp * pitch],
            [nil, -cr * roll, -sr * cp * roll - cr * sp * pitch],
        ]
    )
    R, E, E_dot = (np.moveaxis(x, 2, 0) for x in (R, E, E_dot))
    return R, E, E_dot


def configurations(robot: Robot, z: Array, R: Array) -> Array:
    """Return the configurations of the model at coordinates z (T, 6 + n)."""
    turns = np.array([pin.Quaternion(rotation).coeffs() for rotation in R])
    return np.hstack([z[:, :3], turns, robot.to_model(z[:, 6:])])


def upward(robot: Robot) -> Array:
    """Return the vertical (3,) in the world, whose axes are those of a base that is held."""
    gravity = robot.model.gravity.linear
    return np.asarray(-gravity / np.linalg.norm(gravity))


def floating_rows(robot: Robot, Y: Array, joints: Sequence[int]) -> Array:
    """Return the rows (T, 6 + k, m) of the base and of k joints at the drives' coordinates.

    Those in which a guide has unknown forces are zero.
    """
    of_joints = rows_at_drives(robot.transmission, Y[:, 6:])[:, joints]
    rows = np.concatenate([Y[:, :6], of_joints], axis=1)
    rows[:, :6][:, ~floating(robot).free_axes] = 0.0
    return rows


_POSTURES, _TURNED_RAD = 20, 0.5
"""Random postures, and the largest angle [rad] of a joint in them, over which the lever of the
contacts is taken (rms)."""


@lru_cache(maxsize=8)
def _typical_lever(robot: Robot) -> float:
    """Return the rms lever [m] of the forces of all contacts on the base, about the posture 0.

    1 m without contacts, of a robot in the air.
    """
    if not moving_base(robot).contacts:
        return 1.0
    turned = np.random.default_rng(0).uniform(-1, 1, (_POSTURES, robot.n)) * _TURNED_RAD
    A = contact_map(robot, turned * ~np.array(robot.is_prismatic), moving_base(robot).contacts)
    # The columns are unit forces: rms of the moments over that of the forces.
    return float(np.linalg.norm(A[:, 3:6]) / np.linalg.norm(A[:, :3]))


@lru_cache(maxsize=8)
def with_contact_frames(
    robot: Robot, contacts: tuple[Contact, ...]
) -> tuple[pin.Model, list[int], list[int]]:
    """Return the model with a frame for each contact, these frames, and their numbers of forces."""
    model, frames = pin.Model(_model(robot)), []
    for place, contact in enumerate(contacts):
        body, rotation, position = moving_base(robot).frame(contact.link)
        # Joint 0 of the model is the universe, joint 1 the base.
        joint = 1 if body < 0 else 2 + robot.model_order.index(body)
        placement = pin.SE3(rotation, position + rotation @ np.array(contact.position_m))
        frame = pin.Frame(f"contact {place}", joint, 0, placement, pin.FrameType.OP_FRAME)
        frames.append(model.addFrame(frame, False))
    return model, frames, force_counts(contacts)


@lru_cache(maxsize=8)
def _model(robot: Robot) -> pin.Model:
    return floating_model(robot.model, (robot.parameters + robot.payload_parameters)[-10:])


def _states(
    robot: Robot, q: Array, v: Array, a: Array, base: BaseStates
) -> tuple[Array, Array, Array]:
    """Return the states of the model: the base at rest in the origin, accelerated as measured."""
    w, e, f = base
    # Pinocchio's quaternion is (x, y, z, w).
    at_origin = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(q), 1))
    joints = robot.model_states(q, v, a)
    position = np.column_stack([at_origin, joints[0]])
    velocity = np.column_stack([np.zeros_like(w), w, joints[1]])
    return position, velocity, np.column_stack([f, e, joints[2]])
