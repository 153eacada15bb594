"""Contact forces, predicted from joint torques and the motion of the base.

With the parameters of the bodies the rows of base and joints, Y theta - tau = sum J_c^T f_c, are
linear equations of the contact forces at each instant, solved by least squares in the metric in
which `identify` eliminates them. What the equations determine follows from the null space of all
J_c^T: with the torques of three joints per leg that of each point foot, without them the sum of
four only, and of several points of one foot never more than their sum.

A mass at a place of contact that always stands hides in the force there: the force is determined by
the identified parameters only if that mass is, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid._progress import Display
from seaid.checks import LeggedFit, LoadedFeet
from seaid.estimation import FittedRows
from seaid.identification.base_estimates import SensorBias, bodies_of_fit, whole_body
from seaid.identification.datasets import Dataset
from seaid.identification.gear import for_sensors
from seaid.identification.inferred_contacts import FREE, LOADED
from seaid.log import Motion, decimated, decimation, in_band, inside_transients, smoothed_where
from seaid.regressor import (
    contact_equations,
    contact_force_columns,
    contact_force_rows,
    contact_rotations,
    measured_contact,
    row_scale,
)
from seaid.robot import Contact, Robot

if TYPE_CHECKING:
    from seaid.identification.result import Identification

CONTACT_NUMBERS = (
    *("rms_force", "rms_error", "relative_error", "scale"),
    *("mean_normal", "least_normal", "standard_error", "friction_used", "pulled"),
)
"""Fields of `ContactForces` with a number per foot."""


@dataclass(frozen=True, eq=False, repr=False)
class ContactForces(Display):
    """Predicted and measured forces of the ground on k contacts, below the cutoff.

    Attributes
    ----------
    links : tuple of str
        The k contacts.
    basis : tuple of str
        What the prediction at each rests on: "identified", "robot file" if the identified
        parameters lack the mass at a foot that always stood, which is that of the robot file then,
        and "none" if no force there is determined.
    predicted, measured : arrays (T, k, 3)
        Forces [N] in the frame of the base, NaN where they are not known, or not used: in filter
        transients, near a change of contact, and in the air.
    rms_force, rms_error : arrays (k,)
        Of the measured force and of the prediction less the measured force [N].
    relative_error, scale : arrays (k,)
        Error over force, and the factor on the measured force by which it fits the prediction best.
    mean_normal, least_normal : arrays (k,)
        Mean and smallest predicted force along the vertical while the foot stands [N].
    standard_error : array (k,)
        Of the predicted normal force [N], by what the rows leave and by the identified parameters.
    friction_used : array (k,)
        The friction coefficient that the predicted forces need, in 99 % of the time in which a foot
        carries 3 % of the weight or more.
    pulled : array (k,)
        The share of the stance with a normal force clearly below zero.
    weight : float
        That of the robot [N] by its identified mass, else with hidden masses of the robot file.
    vertical, measured_vertical : float
        Mean of the sum of the forces along the vertical [N], NaN if one is not known.
    """

    links: tuple[str, ...]
    basis: tuple[str, ...]
    predicted: Array
    measured: Array
    rms_force: Array
    rms_error: Array
    relative_error: Array
    scale: Array
    mean_normal: Array
    least_normal: Array
    standard_error: Array
    friction_used: Array
    pulled: Array
    weight: float
    vertical: float
    measured_vertical: float

    def _in_short(self) -> str:
        return ", ".join(map(" by ".join, zip(self.links, self.basis, strict=True)))

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as plain data, null for those that are not known."""
        feet = {
            link: {"basis": basis}
            | {name: _number(getattr(self, name)[k]) for name in CONTACT_NUMBERS}
            for k, (link, basis) in enumerate(zip(self.links, self.basis, strict=True))
        }
        sums = ("weight", "vertical", "measured_vertical")
        return {"feet": feet, **{name: _number(getattr(self, name)) for name in sums}}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class _Instants:
    """Forces of k contacts at the instants of a motion, and what is known of them.

    `forces`, `measured`, `up` (T, k, 3); `counts` (T, k): the foot may stand and its force is
    determined; `spread` (T, k): variance of the normal force over that of the rows; `squares`,
    `freedom` (T,): squared residual of the rows and its degrees of freedom; `used` (T,); `stands`
    (T, k): the foot may stand.
    """

    forces: Array
    measured: Array
    up: Array
    counts: BoolArray
    spread: Array
    squares: Array
    freedom: Array
    used: BoolArray
    stands: BoolArray


def contact_forces(identification: Identification, *motions: Motion) -> ContactForces | None:
    """Predict the contact forces of the motions of one log, and compare them with measured ones.

    None for a robot without a floating base, and for one without contacts in the log.
    """
    robot = identification.known
    contacts = contacts_of(robot, motions[0])
    if not contacts:
        return None
    bodies, is_whole = bodies_of_fit(identification)
    identification, _ = for_sensors(identification, motions[0])
    sensed = [for_sensors(identification, motion)[1] for motion in motions]
    parts = [force_instants(identification, motion, contacts, bodies) for motion in sensed]
    names = [field.name for field in fields(_Instants)]
    whole = _Instants(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    basis, variance = _basis(identification, sensed[0], contacts, whole, is_whole)
    return _summary(identification, contacts, whole, basis, variance)


def legged_fit(
    result: Identification, datasets: Sequence[Dataset], fit: FittedRows, bias: SensorBias | None
) -> LeggedFit | None:
    """Return a fit for the checks of the feet, None for a fixed base or without its rows."""
    motions = [log for log in datasets if isinstance(log, Motion) and log.base is not None]
    if result.known.floating_base is None or fit.rows is None or len(motions) < len(datasets):
        return None
    bodies = bodies_of_fit(result)[0]
    return LeggedFit(
        robot=result.known,
        motions=motions,
        fit=fit,
        model=result.model,
        springs=result.springs,
        theta=result.load_side.values,
        bodies=bodies,
        sensor_errors=np.empty((len(fit.rows.y), 0)) if bias is None else bias.columns,
        mass_kg=whole_body(result)[0].value,
        loads=_loaded_feet(result, motions, bodies),
    )


def _loaded_feet(
    identification: Identification, motions: Sequence[Motion], bodies: Array
) -> list[LoadedFeet]:
    """Return the forces on feet that stand, if the flags of each log and nothing else has them."""
    bases = [motion.base for motion in motions]
    if any(base is None or base.wrenches or not base.contacts for base in bases):
        return []
    loads = []
    identification, _ = for_sensors(identification, motions[0])
    for motion in (for_sensors(identification, logged)[1] for logged in motions):
        motion = decimated(motion, decimation(motion.rate_hz, 2 * motion.cutoff_hz))
        contacts = contacts_of(identification.known, motion)
        instants = force_instants(identification, motion, contacts, bodies)
        links = tuple(contact.link for contact in contacts)
        loads.append(LoadedFeet(motion, links, instants.forces, instants.counts))
    return loads


def contacts_of(robot: Robot, motion: Motion) -> tuple[Contact, ...]:
    """Return the contacts with a flag or a measured wrench in a motion."""
    base, floating = motion.base, robot.floating_base
    if base is None or floating is None:
        return ()
    flagged = [contact for contact in floating.contacts if contact.link in base.contacts]
    measured = [measured_contact(robot, x, y.shape[1]) for x, y in base.wrenches.items()]
    if base.up is None:
        measured = [replace(contact, radius_m=0.0) for contact in measured]
    return (*flagged, *measured)


def force_instants(
    identification: Identification, motion: Motion, contacts: Sequence[Contact], bodies: Array
) -> _Instants:
    """Return the forces at the instants of one motion."""
    robot, model, base, q = (
        identification.known,
        identification.model,
        motion.base,
        motion.joint_position,
    )
    assert base is not None
    theta = identification.load_side.values
    joints = [robot.index(joint) for joint in model.torque_joints]
    rows, unknown = contact_force_rows(robot, motion, model, identification.springs, theta, bodies)
    always = np.ones(len(q), dtype=bool)
    touching = {contact.link: base.contacts.get(contact.link, always) for contact in contacts}
    A, inverse = contact_equations(robot, q, contacts, touching, joints, unknown, base.up)
    # Forces times a length and moments have one unit, in which least squares is meaningful.
    rows = rows * row_scale(robot, rows.shape[1])[:, 0]
    # At standstill the friction of a drive is unknown: its row determines nothing, as in A.
    rows[:, 6:] *= ~unknown
    forces = np.einsum("tkr,tr->tk", inverse, rows)
    residual = rows - np.einsum("trk,tk->tr", A, forces)
    # f^ = A^+ rows, A^+ A f = f for what the rows determine: a diagonal of A^+ A below 1 is a force
    # that is shared with the null space. Its trace is the rank.
    projector = inverse @ A
    first = np.cumsum([0, *(6 if contact.is_flat else 3 for contact in contacts)])[:-1]
    places = np.add.outer(first, np.arange(3))  # the three forces of each contact
    rank = np.trace(projector, axis1=1, axis2=2)
    diagonal = projector[:, places, places]
    stands = np.stack([touching[contact.link] for contact in contacts], axis=1)
    counts = stands & (np.min(diagonal, axis=2) > 1 - _DETERMINED) & base.used[:, None]
    R = contact_rotations(robot, q, contacts)
    measured = np.full((len(q), len(contacts), 3), np.nan)
    for k, contact in enumerate(contacts):
        if contact.link in base.wrenches:
            measured[:, k] = np.einsum("tij,tj->ti", R[:, k], base.wrenches[contact.link][:, :3])
    up = _verticals(base.up, base.specific_force, contacts, R, counts)
    # Normal force u^T f = (u^T A^+) rows: its variance is |u^T A^+|^2 for rows of variance 1.
    spread = np.einsum("tki,tkir->tkr", up, inverse[:, places])
    free = np.append(robot.floating_base.free_axes, np.ones(len(joints), dtype=bool))  # type: ignore[union-attr]
    free = np.broadcast_to(free, rows.shape).copy()
    free[:, 6:] &= ~unknown
    residual = in_band(motion, residual * base.used[:, None])
    split = forces[:, places]
    return _Instants(
        forces=smoothed_where(motion, split, counts),
        measured=smoothed_where(motion, measured, counts),
        up=up,
        counts=counts,
        spread=np.sum(spread**2, axis=2),
        squares=np.sum(residual**2, axis=1),
        # Rows with an equation less the forces that they determine.
        freedom=free.sum(axis=1) - rank,
        used=base.used & inside_transients(motion),
        stands=stands,
    )


_DETERMINED = 1e-6
"""Part of a force outside of what the equations, or the parameters, determine that is rounding."""


def _verticals(
    up: Array | None,
    specific_force: Array,
    contacts: Sequence[Contact],
    R: Array,
    counts: BoolArray,
) -> Array:
    """Return the vertical (T, k, 3) in the frame of the base, NaN where it is unknown.

    Without the orientation of the base it is that of a flat foot, which does not turn as it stands.
    """
    if up is not None:
        return np.repeat(up[:, None], len(contacts), axis=1)
    vertical = np.full((len(R), len(contacts), 3), np.nan)
    for k, contact in enumerate(contacts):
        if contact.is_flat and np.any(counts[:, k]):
            mean = np.einsum("tji,tj->ti", R[:, k], specific_force)[counts[:, k]].mean(axis=0)
            # The mean specific force in the axes of a foot that stands is that of gravity, if the
            # accelerations of the base cancel over the stances.
            vertical[:, k] = R[:, k] @ (mean / np.linalg.norm(mean))
    return vertical


def _basis(
    identification: Identification,
    motion: Motion,
    contacts: Sequence[Contact],
    whole: _Instants,
    is_whole: bool,
) -> tuple[tuple[str, ...], Array]:
    """Return what the prediction at each contact rests on, and the variance (k,) by parameters.

    Both are those at some instants of the first motion.
    """
    robot, model, estimate = identification.known, identification.model, identification.load_side
    steps = np.flatnonzero(np.any(whole.counts[: len(motion.time)], axis=1))
    variance = np.full(len(contacts), np.nan)
    if not len(steps):
        return ("none",) * len(contacts), variance
    steps = steps[np.linspace(0, len(steps) - 1, min(len(steps), _INSTANTS)).astype(int)]
    assert motion.base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    always = np.ones(len(steps), dtype=bool)
    flags = {x: y[steps] for x, y in motion.base.contacts.items()}
    touching = {contact.link: flags.get(contact.link, always) for contact in contacts}
    up = None if motion.base.up is None else motion.base.up[steps]
    q = motion.joint_position[steps]
    _, inverse = contact_equations(robot, q, contacts, touching, joints, None, up)
    columns, grouping = contact_force_columns(robot, motion, model, steps)
    F = inverse @ (row_scale(robot, columns.shape[1]) * columns)
    bodies = robot.parameters.size
    identified = [*model.base.columns, *range(bodies, bodies + len(model.drives))]
    # f = F theta is a function of the base parameters B theta (14) if F = F_b B, with the columns
    # F_b of those parameters; the same test as for a mass in `base_estimates`.
    undetermined = F - F[:, :, identified] @ grouping
    basis, start = [], 0
    for k, contact in enumerate(contacts):
        axes, counts = slice(start, start + 3), whole.counts[steps, k]
        start += 6 if contact.is_flat else 3
        if not np.any(counts):
            basis.append("none")
            continue
        size = np.linalg.norm(F[counts, axes])
        is_identified = np.linalg.norm(undetermined[counts, axes]) <= _DETERMINED * size
        basis.append("identified" if is_identified else "robot file" if is_whole else "none")
        normal = np.einsum("ti,tim->tm", whole.up[steps[counts], k], F[counts, axes])[:, identified]
        # u^T F_b C F_b^T u.
        variances = np.einsum("tm,mn,tn->t", normal, estimate.covariance, normal)
        variance[k] = np.median(variances)
    return tuple(basis), variance


_INSTANTS = 40
"""Instants at which it is decided what parameters a force depends on."""


def _summary(
    identification: Identification,
    contacts: Sequence[Contact],
    whole: _Instants,
    basis: tuple[str, ...],
    variance: Array,
) -> ContactForces:
    """Return the forces with their numbers."""
    is_known = np.array([source != "none" for source in basis])
    forces = np.where(is_known[:, None], whole.forces, np.nan)
    measured, used = whole.measured, whole.used
    freedom = float(np.sum(whole.freedom[used]))
    is_redundant = freedom > _LITTLE * used.sum()
    noise = float(np.sum(whole.squares[used])) / freedom if is_redundant else np.nan
    normal = np.einsum("tki,tki->tk", whole.up, forces)
    # |f_t| with f_t = f - (u^T f) u.
    along = np.linalg.norm(forces - normal[:, :, None] * whole.up, axis=2)
    robot, mass = identification.robot, whole_body(identification)[0].value
    if np.isnan(mass) and np.all(np.isfinite(identification.known.parameters)):
        mass = robot.parameters[::10].sum()
    weight = float(mass * np.linalg.norm(robot.model.gravity.linear))
    numbers = np.full((len(CONTACT_NUMBERS), len(contacts)), np.nan)
    for k in range(len(contacts)):
        known = np.isfinite(normal[:, k])
        if np.any(known):
            f_n, f_t = normal[known, k], along[known, k]
            # Independent parts: noise of the rows, and errors of the parameters.
            error = np.sqrt(noise * np.median(whole.spread[known, k]) + variance[k])
            loaded = f_n > LOADED * weight
            used_friction = (
                np.quantile(f_t[loaded] / f_n[loaded], 0.99) if np.any(loaded) else np.nan
            )
            pulls = np.mean(f_n < -max(_PULLS * error, FREE * weight))
            numbers[4:, k] = f_n.mean(), f_n.min(), error, used_friction, pulls
        both = np.all(np.isfinite(forces[:, k] + measured[:, k]), axis=1)
        if np.any(measured[both, k]):
            f_m, f_p = measured[both, k], forces[both, k]
            rms = np.sqrt(np.mean(np.sum(f_m**2, axis=1)))
            difference = np.sqrt(np.mean(np.sum((f_p - f_m) ** 2, axis=1)))
            numbers[:4, k] = rms, difference, difference / rms, np.sum(f_m * f_p) / np.sum(f_m**2)
    of_measured = np.einsum("tki,tki->tk", whole.up, measured)
    by_name: dict[str, Any] = dict(zip(CONTACT_NUMBERS, numbers, strict=True))
    return ContactForces(
        links=tuple(contact.link for contact in contacts),
        basis=basis,
        predicted=forces,
        measured=measured,
        **by_name,
        weight=weight,
        vertical=_mean_sum(normal, whole.stands),
        measured_vertical=_mean_sum(of_measured, whole.stands),
    )


def _mean_sum(normal: Array, stands: BoolArray) -> float:
    """Return the mean sum of normal forces (T, k) at the instants at which all are known."""
    known = np.all(np.isfinite(normal) | ~stands, axis=1) & np.any(stands, axis=1)
    return float(np.nansum(normal[known], axis=1).mean()) if np.any(known) else float("nan")


_LITTLE = 0.5
"""Degrees of freedom per instant below which the rows do not show their noise."""

_PULLS = 3.0
"""Standard errors below zero from which the force of a foot that stands is a pull."""
