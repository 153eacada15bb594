"""Motions in stance: a floating base that moves over feet that stay on the ground.

The contacts of a stance are fixed, phi(z) = 0 over the coordinates z of base and joints. As many
joints as there are constraints depend on the others: the planned coordinates are those of the base
and of the free joints, and the dependent ones follow by inverse kinematics, with velocities from
K v = 0 and accelerations from K v' + K' v = 0, K = d phi / d z. Inverse dynamics of the nominal
model gives the least contact forces that hold the base, and with them the joint torques.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite, number, safely
from seaid.errors import ExcitationError, shown, unknown_name
from seaid.excitation import Limits, Stance, StancePlan, Trajectory
from seaid.excitation.basis import Basis, SplineBasis
from seaid.excitation.criteria import States
from seaid.excitation.flatness import check_nominal_bodies
from seaid.excitation.limits import DEFAULT_ACCELERATION, JointLimits, positive_values
from seaid.legged.floating import (
    FloatingRobot,
    configurations,
    contact_map,
    floating_regressor,
    floating_rows,
    roll_pitch_yaw,
    standing_motion,
    upward,
    with_contact_frames,
    without_contact_forces,
)
from seaid.robot import Contact, Robot

_safely = partial(safely, what="the contacts of the stance", error=ExcitationError)

BASE_COORDINATES = ("base_x", "base_y", "base_z", "base_roll", "base_pitch", "base_yaw")
"""Of the base in the world [m, rad]: it starts at 0, in the axes of its frame."""

_BASE_SPEED = (1.0, 3.0)
"""Velocity limits of the base [m/s] and [rad/s]: for those of its joints, the robot has limits."""

_STAGES, _NEWTON = 4, 20
"""Stages of inverse kinematics from the posture, and iterations of the last one at most.

Where the legs reach their places, a few close the contacts.
"""

_LARGEST_STEP = 0.3
"""Largest step of a joint [rad or m] in one iteration: longer ones can change the branch."""

_DAMPING = 1e-14
"""Added to K^T K, relative to levers of 1 m: legs that are stretched out stay solvable."""

_CLOSED_M, _NEAR_M = 1e-12, 1e-3
"""Distance of the contacts from their places [m] after the last and the other stages."""

_REACHED_M = 1e-7
"""Distance [m] above which a leg does not reach its place."""

_STEP = 1e-6
"""Step of the differences [rad, m and their rates]."""

_RANK = 1e-8
"""Singular values below this share of the largest one are those of a singular stance."""


@dataclass(frozen=True, eq=False)
class StanceModel:
    """A robot in stance, over its planned coordinates z[free], (m,) of 6 + n.

    `posture` (6 + n,) are the coordinates at the start, `dependent` those by inverse kinematics.
    `axes` (contacts, 3, 3) turn the world into tangential and normal directions, `anchors` are the
    placements of the contacts at the start. `rows` are the joints with known torque, `columns` the
    base columns, which only the observation matrix needs.
    """

    robot: FloatingRobot
    stance: Stance
    contacts: tuple[Contact, ...]
    posture: Array
    free: tuple[int, ...]
    dependent: tuple[int, ...]
    axes: Array
    anchors: tuple[pin.SE3, ...]
    limits: JointLimits
    torque_limits: Array
    rows: tuple[int, ...]
    columns: tuple[int, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the planned coordinates."""
        every = (*BASE_COORDINATES, *self.robot.joint_names)
        return tuple(every[index] for index in self.free)

    @property
    def up(self) -> Array:
        """The vertical (3,) in the world."""
        return upward(self.robot)

    @property
    def load_n(self) -> float:
        """The weight per contact [N]."""
        # the first of the ten parameters of each body is its mass
        masses = (self.robot.parameters + self.robot.payload_parameters)[::10]
        weight = np.sum(masses) * np.linalg.norm(self.robot.model.gravity.linear)
        return float(weight / len(self.contacts))

    @property
    def free_limits(self) -> JointLimits:
        """The limits of the planned coordinates."""
        ends = [self.stance.base_range_m, self.stance.base_range_rad]
        if ends[0] is None:
            # the base starts in the origin: its height above the contacts is minus theirs
            up, places = self.up, np.array([anchor.translation for anchor in self.anchors])
            ends[0] = abs(float(np.mean(places @ up))) / 3
        reach = np.concatenate(
            [
                finite(name, np.broadcast_to(np.asarray(end, float), 3), (3,), ExcitationError)
                for name, end in zip(("base_range_m", "base_range_rad"), ends, strict=True)
            ]
        )
        if np.any(reach <= 0):
            raise ExcitationError(f"the range of the base must be more than zero, found {reach}")
        speed, most = np.repeat(_BASE_SPEED, 3), np.full(6, DEFAULT_ACCELERATION)
        limits, pick = self.limits, list(self.free)
        return JointLimits(
            *(
                np.concatenate(pair)[pick]
                for pair in (
                    (-reach, limits.lower),
                    (reach, limits.upper),
                    (speed, limits.velocity),
                    (most, limits.acceleration),
                )
            )
        )

    @property
    def start(self) -> Array:
        """The planned coordinates (m,) at the start."""
        return self.posture[list(self.free)]

    @property
    def links(self) -> tuple[str, ...]:
        """The links of the contacts."""
        return tuple(contact.link for contact in self.contacts)

    def with_base_parameters(self, columns: Sequence[int]) -> StanceModel:
        """Return the model with base columns for its observation matrix."""
        return replace(self, columns=tuple(columns))

    def used_shares(self, states: States) -> Array:
        """Return the used share (T, c) of each limit on contacts, dependent joints and torques."""
        return _use(self, _linearisation_point(self, *_key(states)))

    def joint_torques(self, states: States) -> Array:
        """Return the joint torques (T, n) with the least contact forces."""
        return _linearisation_point(self, *_key(states)).torques

    def observed_rows(self, states: States) -> Array:
        """Return the observation matrix (T, 6 + r, p) without contact forces, unweighted."""
        dynamics = _linearisation_point(self, *_key(states))
        return _observed(self, dynamics, dynamics.regressor[:, :, list(self.columns)])

    def worst_shares(
        self, states: States, starts: range, maps: Sequence[Array], half_range: Array
    ) -> tuple[Array, Array]:
        """Return the largest used share (.,) of each limit from every start on, and derivatives.

        `maps`, 3 of (T, k), give position, velocity and acceleration of planned coordinates of half
        range 1.
        """
        use, slopes, _ = _derivatives(self, *_key(states))
        limits, every = np.arange(use.shape[1]), np.stack(maps)
        shares, gradients = [], []
        for start in starts:
            # (c,): the worst instant of each limit in the block
            at = start + use[start : start + starts.step].argmax(axis=0)
            shares.append(use[at, limits])
            felt = slopes[:, :, at, limits] * half_range[:, None]
            gradients.append(np.einsum("kmc,kcx->cmx", felt, every[:, at]))
        return np.concatenate(shares), np.concatenate(gradients)

    def pull_back(self, states: States, G: Array) -> States:
        """Return the gradient by q, v, a, (T, m) each, of a function with gradient G by rows."""
        by_rows = _derivatives(self, *_key(states))[2]
        q, v, a = np.einsum("kmtrp,trp->ktm", by_rows, G)
        return q, v, a

    def plan(self, basis: Basis, planned: Array, time: Array) -> tuple[Trajectory, StancePlan]:
        """Return the joint trajectory of planned coefficients (K, m), and base and forces at times.

        Quintic splines interpolate the inverse kinematics every 10 ms, so closely that the contacts
        stay within a nanometre.
        """
        from scipy.interpolate import make_interp_spline

        robot, last = self.robot, basis.duration
        # the knots of the plan are sites: between them the motion is smooth
        spans = np.unique(basis.knots) if isinstance(basis, SplineBasis) else np.array([0.0, last])
        pieces = [
            np.linspace(*ends, 1 + max(1, int(np.ceil((ends[1] - ends[0]) / _SPACING_S))))
            for ends in pairwise(spans)
        ]
        sites = np.concatenate([spans[:1], *(piece[1:] for piece in pieces)])
        z = coordinates(self, basis.states(sites, planned)[0])
        # a quintic through the sites has four conditions left: at rest at both ends
        still = [(1, np.zeros(z.shape[1])), (2, np.zeros(z.shape[1]))]
        spline = _safely(make_interp_spline, sites, z, k=5, bc_type=(still, still))
        fine = SplineBasis(5, spline.t)
        slides = tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist())
        joints = Trajectory(robot.joint_names, fine, spline.c[:, 6:], slides)
        base = Trajectory(BASE_COORDINATES, fine, spline.c[:, :6], BASE_COORDINATES[:3])
        dynamics = inverse_dynamics(self, basis.states(time, planned))
        forces = dict(_by_link(self, dynamics.forces))
        return joints, StancePlan(base, time, forces, dynamics.torques)


def stance_model(
    robot: FloatingRobot,
    stance: Stance,
    bounds: JointLimits,
    limits: Limits | None,
    torque_joints: str | Sequence[str] | None,
) -> StanceModel:
    """Return the model of a stance. Raises ExcitationError for one that cannot stand."""
    contacts = _contacts(robot, stance)
    check_nominal_bodies(robot)
    _check_numbers(stance, contacts)
    effort = robot.effort_limits
    default = np.where(np.isfinite(effort) & (effort > 0), effort, np.inf)
    requested = limits or Limits()
    for name in ("motor_torque", "motor_speed", "deflection"):
        if getattr(requested, name) is not None:
            raise ExcitationError(
                f"Limits({name}=...) is not available in stance: give Limits(joint_torque=...)",
                f"Limits({name}=...)",
            )
    most = positive_values(robot, "joint_torque", requested.joint_torque, default, unlimited=True)
    posture = np.concatenate([np.zeros(6), _posture(robot, stance, bounds)])
    model, frames, _ = with_contact_frames(robot, contacts)
    data = model.createData()
    level = roll_pitch_yaw(posture[None], posture[None])[0]
    pin.framesForwardKinematics(model, data, configurations(robot, posture[None], level)[0])
    anchors = tuple(pin.SE3(data.oMf[frame]) for frame in frames)
    up = upward(robot)
    standing = StanceModel(
        robot=robot,
        stance=stance,
        contacts=contacts,
        posture=posture,
        free=(),
        dependent=(),
        axes=np.array([_axes(anchor.rotation, up) for anchor in anchors]),
        anchors=anchors,
        limits=bounds,
        torque_limits=most,
        rows=tuple(robot.index(joint) for joint in robot.selected(torque_joints)),
    )
    standing = _with_dependent_joints(standing)
    _check_standing(standing)
    return standing


def _contacts(robot: FloatingRobot, stance: Stance) -> tuple[Contact, ...]:
    base = robot.floating_base
    if base.normal is not None:
        raise ExcitationError(
            f"stance= needs a base that nothing guides, and that of '{robot.name}' moves in a "
            "plane: load it with base='floating'",
            "stance=",
            "base='floating'",
        )
    links = [stance.contacts] if isinstance(stance.contacts, str) else list(stance.contacts)
    if not links:
        raise ExcitationError("stance= needs at least one contact, found none", "stance=")
    for link in links:
        if link not in base.contact_links:
            raise ExcitationError(
                f"stance=: {unknown_name('contact', link, base.contact_links)}", "stance="
            )
        if links.count(link) > 1:
            raise ExcitationError(f"stance= names '{link}' twice", "stance=")
    return tuple(base.contact_of(link) for link in links)


def _check_numbers(stance: Stance, contacts: Sequence[Contact]) -> None:
    for name in ("friction", "least_load"):
        value = number(name, getattr(stance, name), ExcitationError)
        if not (value > 0 and (name == "friction" or value < 1)):
            raise ExcitationError(
                f"{name} must be more than zero{' and less than 1' * (name == 'least_load')}, "
                f"found {shown(value)}",
                name,
            )
    _check_soles(stance, [contact.link for contact in contacts if contact.is_flat])


def _check_soles(stance: Stance, flat: Sequence[str]) -> None:
    """Raise ExcitationError unless there is a size for the contacts that are `flat`."""
    if flat and stance.sole_m is None:
        raise ExcitationError(
            f"the contact at '{flat[0]}' is a flat foot: give Stance(sole_m=(length, width)), in "
            "which its centre of pressure stays",
            "Stance(sole_m=(length, width))",
        )
    if stance.sole_m is not None:
        size = finite("sole_m", stance.sole_m, (2,), ExcitationError)
        if np.any(size <= 0):
            raise ExcitationError(f"sole_m must be more than zero, found {shown(stance.sole_m)}")


def _posture(robot: Robot, stance: Stance, bounds: JointLimits) -> Array:
    posture = stance.posture
    if posture is None or isinstance(posture, Mapping):
        named = dict(posture or {})
        for joint in named:
            if joint not in robot.joint_names:
                raise ExcitationError(f"posture: {unknown_name('joint', joint, robot.joint_names)}")
        posture = [named.get(x, m) for x, m in zip(robot.joint_names, bounds.middle, strict=True)]
    q = finite("posture", posture, (robot.n,), ExcitationError)
    wrong = np.flatnonzero((q <= bounds.lower) | (q >= bounds.upper))
    if wrong.size:
        j = int(wrong[0])
        raise ExcitationError(
            f"posture: joint '{robot.joint_names[j]}' at {q[j]:.4g} must be between its limits, "
            f"{bounds.lower[j]:.4g} and {bounds.upper[j]:.4g}"
        )
    return q


def _axes(rotation: Array, up: Array) -> Array:
    """Return two tangential directions, the first along x of a link where it can, and `up`."""
    # the first axis of the link at more than 30 degrees from the vertical: sin 30 = 0.5
    first = max(rotation.T, key=lambda axis: np.linalg.norm(np.cross(up, axis)) > 0.5)
    first = first - up * (up @ first)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first), up])


def _with_dependent_joints(model: StanceModel) -> StanceModel:
    """Return the model with the joints of the best conditioned inverse kinematics dependent.

    Pivoting chooses them; coordinates of the base depend only where joints do not suffice.
    """
    from scipy.linalg import qr

    K = contact_motion(model, model.posture[None])[1][0]
    # columns of the base count a thousandth, so that the pivoting takes joints before them
    weights = np.concatenate([np.full(6, 1e-3), np.ones(model.robot.n)])
    R, order = _safely(qr, K * weights, mode="r", pivoting=True)
    size = np.abs(np.diag(R))
    rank = int(np.sum(size > _RANK * size[0]))
    dependent = sorted(order[:rank].tolist())
    free = [index for index in range(K.shape[1]) if index not in dependent]
    if not free:
        raise ExcitationError("the contacts of this stance leave no motion: fewer must stand")
    return replace(model, free=tuple(free), dependent=tuple(dependent))


def _check_standing(model: StanceModel) -> None:
    """Raise ExcitationError if the contacts cannot hold the robot at rest in its posture."""
    links = ", ".join(model.stance.contacts)
    still = np.zeros((1, len(model.free)))
    # J_c^T of the base, (6, k): of rank 6 if the contacts can balance any force and moment
    A = contact_map(model.robot, model.posture[None, 6:], model.contacts, model.up[None])[0, :6]
    values = _safely(np.linalg.svd, A, compute_uv=False)
    if len(values) < 6 or values[5] < _RANK * values[0]:
        raise ExcitationError(
            f"the contacts {links} cannot hold the base: a motion in stance needs three points "
            "that are not on one line, or a flat foot"
        )
    dynamics = inverse_dynamics(model, (model.posture[None, list(model.free)], still, still))
    names, use = _use_names(model), _use(model, dynamics)[0]
    worst = int(np.argmax(use))
    if use[worst] > 0.95:
        forces = {link: f[0].round(3).tolist() for link, f in _by_link(model, dynamics.forces)}
        raise ExcitationError(
            f"at rest in this posture the {names[worst]} is at or beyond its limit (forces x, y, "
            f"normal [N]: {shown(forces)}): give a Stance(posture=...) with the weight over the "
            "feet, more friction, or wider limits",
            "Stance(posture=...)",
        )


@dataclass(frozen=True, eq=False)
class _Dynamics:
    """Coordinates, rates and accelerations (T, 6 + n) of a motion, and what they need.

    `open_m` (T,) is how far the contacts are from their places, `regressor` (T, 6 + n, 10N) that of
    base and joints, `up` (T, 3) the vertical in the base; `forces` (T, k) and `torques` (T, n).
    """

    z: Array
    rates: Array
    accelerations: Array
    open_m: Array
    K: Array
    bias: Array
    force_map: Array
    regressor: Array
    up: Array
    forces: Array
    torques: Array


def inverse_dynamics(
    model: StanceModel,
    states: States,
    at: Array | None = None,
    like: _Dynamics | None = None,
    same_rates: bool = False,
) -> _Dynamics:
    """Return the whole motion of planned states (T, m).

    `at` (T, 6 + n) are known coordinates; `like` is a motion of the same ones, or of the same rates
    too, of which only the accelerations differ.
    """
    if like is None:
        z = coordinates(model, states[0]) if at is None else at
        errors, K, _ = contact_motion(model, z)
        missing = np.max(np.abs(errors), axis=1)
    else:
        z, K, missing = like.z, like.K, like.open_m
    rates = _completed(model, K, states[1], 0.0)
    # bias = K' v
    bias = like.bias if like and same_rates else contact_motion(model, z, rates)[2]
    accelerations = _completed(model, K, states[2], -bias)
    robot = model.robot
    R, E, E_dot = roll_pitch_yaw(z, rates)
    # in the axes of the base: angular velocity w = E v, its rate e = E a + E' v, and f the
    # acceleration less gravity, as an accelerometer measures it
    w = np.einsum("tij,tj->ti", E, rates[:, 3:6])
    e = np.einsum("tij,tj->ti", E, accelerations[:, 3:6])
    e += np.einsum("tij,tj->ti", E_dot, rates[:, 3:6])
    f = np.einsum("tji,tj->ti", R, accelerations[:, :3] - robot.model.gravity.linear)
    joints = (z[:, 6:], rates[:, 6:], accelerations[:, 6:])
    Y = floating_regressor(robot, *joints, (w, e, f))
    up = R.swapaxes(1, 2) @ model.up
    loads = Y @ (robot.parameters + robot.payload_parameters)
    A = _force_map(model, z, R, up) if like is None else like.force_map
    # (8) of the base, which no motor drives: J_c^T forces = load; motors bear what remains of (8)
    forces = _least_forces(model, A[:, :6], loads[:, :6])
    torques = loads[:, 6:] - np.einsum("tnk,tk->tn", A[:, 6:], forces)
    return _Dynamics(z, rates, accelerations, missing, K, bias, A, Y, up, forces, torques)


def _force_map(model: StanceModel, z: Array, R: Array, up: Array) -> Array:
    """Return the map (T, 6 + n, k) of forces in the axes of the contacts."""
    A = contact_map(model.robot, z[:, 6:], model.contacts, up)
    start = 0
    for contact, axes in zip(model.contacts, model.axes, strict=True):
        for block in range(2 if contact.is_flat else 1):
            part = slice(start + 3 * block, start + 3 * block + 3)
            # forces f in the axes of a contact are axes^T f in the world, R^T axes^T f in the base
            A[:, :, part] = A[:, :, part] @ (R.swapaxes(1, 2) @ axes.T)
        start += 6 if contact.is_flat else 3
    return A


def _least_forces(model: StanceModel, A: Array, wanted: Array) -> Array:
    """Return the forces (T, k) of least weighted norm with A (T, 6, k) f = wanted (T, 6).

    The weights are what each may be per unit of the normal force: f = D A^T (A D A^T)^-1 b.
    """
    friction, sole = model.stance.friction, model.stance.sole_m
    sizes = []
    for contact in model.contacts:
        # per unit of normal force: tangential forces by friction; moments about x and y by half the
        # width and half the length of the sole, about z by mu (X + Y) as in `_use`
        sizes += [friction, friction, 1.0]
        if contact.is_flat:
            assert sole is not None
            sizes += [0.5 * sole[1], 0.5 * sole[0], 0.5 * friction * sum(sole)]
    D = np.array(sizes) ** 2
    inner = (A * D) @ A.swapaxes(1, 2)
    multipliers = _safely(np.linalg.solve, inner, wanted[:, :, None])
    return np.asarray(D * np.einsum("tik,ti->tk", A, multipliers[:, :, 0]))


def _by_link(model: StanceModel, forces: Array) -> list[tuple[str, Array]]:
    widths = [6 if contact.is_flat else 3 for contact in model.contacts]
    parts = np.split(forces, np.cumsum(widths)[:-1], axis=1)
    return [(x.link, part) for x, part in zip(model.contacts, parts, strict=True)]


def _use(model: StanceModel, dynamics: _Dynamics) -> Array:
    """Return the used share (T, c) of each limit: 1 at the limit, less within."""
    friction, load, sole = model.stance.friction, model.load_n, model.stance.sole_m
    columns = []
    for _, f in _by_link(model, dynamics.forces):
        normal = f[:, 2]
        # |T| <= mu N as 1 - (N - |T| / mu) / load <= 1: |T| / (mu N) would have a pole where a foot
        # lifts, N = 0; all limits on forces have this form
        columns.append(1 - (normal - np.hypot(f[:, 0], f[:, 1]) / friction) / load)
        columns.append(1 - (normal - model.stance.least_load * load) / load)
        if f.shape[1] == 6:
            assert sole is not None
            X, Y = 0.5 * sole[0], 0.5 * sole[1]
            columns.append(1 - (normal - np.abs(f[:, 4]) / X) / load)
            columns.append(1 - (normal - np.abs(f[:, 3]) / Y) / load)
            # moment about the normal of a rectangular sole (Caron, Pham and Nakamura 2015)
            for sign in (1.0, -1.0):
                taken = np.abs(Y * f[:, 0] - sign * friction * f[:, 3])
                taken += np.abs(X * f[:, 1] - sign * friction * f[:, 4])
                needed = (taken - sign * f[:, 5]) / (friction * (X + Y))
                columns.append(1 - (normal - needed) / load)
    # planned joints keep their limits as linear ones in x; those of dependent joints are not linear
    coupled = np.array([index - 6 for index in model.dependent if index >= 6], dtype=int)
    limits, joint = model.limits, coupled + 6
    position = np.abs(dynamics.z[:, joint] - limits.middle[coupled]) / limits.half_range[coupled]
    velocity = np.abs(dynamics.rates[:, joint]) / limits.velocity[coupled]
    acceleration = np.abs(dynamics.accelerations[:, joint]) / limits.acceleration[coupled]
    limited = np.isfinite(model.torque_limits)
    torque = np.abs(dynamics.torques[:, limited]) / model.torque_limits[limited]
    unreached = np.minimum(dynamics.open_m / _REACHED_M, 10.0)[:, None]
    return np.hstack(
        [np.stack(columns, axis=1), position, velocity, acceleration, torque, unreached]
    )


def _use_names(model: StanceModel) -> list[str]:
    names = []
    for contact in model.contacts:
        kinds = ["friction", "normal force"]
        if contact.is_flat:
            kinds += ["centre of pressure along x", "centre of pressure along y"]
            kinds += 2 * ["moment about the normal"]
        names += [f"{kind} at '{contact.link}'" for kind in kinds]
    joints = [model.robot.joint_names[index - 6] for index in model.dependent if index >= 6]
    for kind in ("position", "velocity", "acceleration"):
        names += [f"{kind} of '{joint}'" for joint in joints]
    limited = np.flatnonzero(np.isfinite(model.torque_limits))
    names += [f"torque of '{model.robot.joint_names[j]}'" for j in limited]
    return [*names, "reach of the legs"]


def _key(states: States) -> tuple[bytes, int]:
    # bytes, because arrays are not hashable: the results of a motion are cached by its states
    return np.stack(states).tobytes(), len(states[0])


def _unpacked(key: bytes, samples: int) -> States:
    q, v, a = np.frombuffer(key).reshape(3, samples, -1)
    return q, v, a


@lru_cache(maxsize=4)
def _linearisation_point(model: StanceModel, key: bytes, samples: int) -> _Dynamics:
    return inverse_dynamics(model, _unpacked(key, samples))


@lru_cache(maxsize=1)
def _derivatives(model: StanceModel, key: bytes, samples: int) -> tuple[Array, Array, Array]:
    """Return shares (T, c), and the derivatives (3, m, T, c) of these and (3, m, T, r, p) of rows.

    They are differences instant by instant: what a motion needs at an instant depends on its state
    there alone, so their number does not grow with the coefficients.
    """
    states = _unpacked(key, samples)
    middle, m, columns = (
        _linearisation_point(model, key, samples),
        len(model.free),
        list(model.columns),
    )
    use = _use(model, middle)
    rows = _observed(model, middle, middle.regressor[:, :, columns])
    by_use = np.empty((3, m, *use.shape))
    by_rows = np.empty((3, m, *rows.shape))
    # dz / d planned, (m, T, 6 + n): along it the contacts stay closed up to the square of a step
    tangents = _completed(
        model, middle.K, np.broadcast_to(np.eye(m)[:, None], (m, samples, m)), 0.0
    )
    changed: list[Array] = []
    for kind in range(3):
        for place in range(m):
            moved = [state.copy() for state in states]
            moved[kind][:, place] += _STEP
            parts = (moved[0], moved[1], moved[2])
            if kind == 0:
                shifted = inverse_dynamics(model, parts, middle.z + _STEP * tangents[place])
            else:
                shifted = inverse_dynamics(model, parts, like=middle, same_rates=kind == 2)
            by_use[kind, place] = (_use(model, shifted) - use) / _STEP
            Y = shifted.regressor[:, :, columns]
            if kind == 0:
                by_rows[0, place] = (_observed(model, shifted, Y) - rows) / _STEP
            else:
                changed.append((Y - middle.regressor[:, :, columns]) / _STEP)
    # at the same positions the contact forces are eliminated alike: all at once
    # (T, r, 2 m p), the columns of velocities and then of accelerations -> (2, m, T, r, p)
    reduced = _observed(model, middle, np.concatenate(changed, axis=2))
    by_rows[1:] = reduced.reshape(*rows.shape[:2], 2, m, len(columns)).transpose(2, 3, 0, 1, 4)
    # the last share is how far the contacts are open: over `_STEP`, the second order of the tangent
    # and the tolerance of inverse kinematics, not a slope
    by_use[:, :, :, -1] = 0.0
    return use, by_use, by_rows


def _observed(model: StanceModel, dynamics: _Dynamics, Y: Array) -> Array:
    """Return the rows of the base and of joints with known torque, without contact forces."""
    touching = {contact.link: np.ones(len(Y), dtype=bool) for contact in model.contacts}
    rows = floating_rows(model.robot, Y, model.rows)
    q = dynamics.z[:, 6:]
    return without_contact_forces(model.robot, q, touching, model.rows, rows, up=dynamics.up)


def coordinates(model: StanceModel, planned: Array) -> Array:
    """Return all coordinates (T, 6 + n) of planned ones (T, m), by damped Gauss-Newton steps.

    All instants start from the posture and get to their places in a few stages along the tangent,
    so that the legs stay in their branch. Where a leg does not reach, the contacts are not at their
    places, which `open_m` shows.
    """
    free, dependent = list(model.free), list(model.dependent)
    z = np.tile(model.posture, (len(planned), 1))
    away = (planned - z[:, free]) / _STAGES
    K = np.repeat(contact_motion(model, z[:1])[1], len(z), axis=0)
    for stage in range(_STAGES):
        step = _completed(model, K, away, 0.0)
        z += step * _bounded(step[:, dependent])
        # also where the step was bounded: only dependent joints may lag behind the stage
        z[:, free] = planned - (_STAGES - 1 - stage) * away
        last = stage == _STAGES - 1
        moving = np.arange(len(z))
        for _ in range(_NEWTON if last else 2):
            errors, K[moving], _ = contact_motion(model, z[moving])
            unclosed = np.max(np.abs(errors), axis=1) > (_CLOSED_M if last else _NEAR_M)
            if not np.any(unclosed):
                break
            moving, errors = moving[unclosed], errors[unclosed]
            step = _completed(model, K[moving], np.zeros((len(moving), len(free))), -errors)
            z[moving] += step * _bounded(step[:, dependent])
    return z


def _bounded(steps: Array) -> Array:
    """Return the factors (T, 1) that bound the steps of joints (T, d)."""
    longest = np.max(np.abs(steps), axis=1, keepdims=True)
    return np.asarray(_LARGEST_STEP / np.maximum(longest, _LARGEST_STEP))


def contact_motion(
    model: StanceModel, z: Array, rates: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return errors, K and bias of the contacts, see `standing_motion`."""
    return standing_motion(model.robot, model.contacts, model.anchors, z, rates)


def _completed(model: StanceModel, K: Array, planned: Array, wanted: Any) -> Array:
    """Return rates (..., T, 6 + n) with the planned ones (..., T, m) and K rates = wanted."""
    free, dependent = list(model.free), list(model.dependent)
    K_d = K[:, :, dependent]
    # K_d rates_d = wanted - K_free planned, by damped normal equations
    inner = K_d.swapaxes(1, 2) @ K_d + _DAMPING * np.eye(len(dependent))
    missing = wanted - np.einsum("tkm,...tm->...tk", K[:, :, free], planned)
    right = np.einsum("tkd,...tk->...td", K_d, missing)
    rates = np.empty((*planned.shape[:-1], len(model.posture)))
    rates[..., free] = planned
    rates[..., dependent] = _safely(np.linalg.solve, inner, right[..., None])[..., 0]
    return rates


_SPACING_S = 0.01
"""Spacing of the sites of splines [s]: `stance_plan` says how closely they interpolate."""
