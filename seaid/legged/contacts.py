"""Contacts of a robot with the ground: their forces, and when its feet stand.

With the parameters of the bodies the rows of base and joints, Y theta - tau = sum J_c^T f_c, are
linear equations of the contact forces at each instant, solved by least squares in the metric in
which `identify` eliminates them. What the equations determine follows from the null space of all
J_c^T: with the torques of three joints per leg that of each point foot, without them the sum of
four only, and of several points of one foot never more than their sum.

A mass at a place of contact that always stands hides in the force there: the force is determined by
the identified parameters only if that mass is, too.

`find_contacts` computes these forces with the bodies of the robot file, where a log does not say
when feet stand. `with_leg_order` takes the order of legs and flags in which standing feet rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, safely
from seaid._progress import Display
from seaid.errors import IdentificationError, LogError, checked
from seaid.estimation import FittedRows
from seaid.identification.datasets import Dataset
from seaid.identification.result import SensorErrors
from seaid.identification.validation import for_sensors
from seaid.legged.base import bodies_of_fit, whole_body
from seaid.legged.feet import (
    FeetInMotion,
    LeggedFit,
    LegOrder,
    LoadedFeet,
    best_order,
    smoothed_where,
)
from seaid.legged.floating import (
    FloatingRobot,
    contact_equations,
    contact_map,
    contact_rotations,
    floating,
    floating_regressor,
    guided,
    measured_contact,
    row_scale,
)
from seaid.legged.load_side import contact_force_columns, contact_force_rows
from seaid.log import (
    FOUND_CONTACT,
    Description,
    Log,
    LogDescription,
    Motion,
    Repair,
    in_band,
    low_pass,
    reconstruct_motion,
)
from seaid.log.base_log import BaseMotion
from seaid.log.describe.inference import Doubt
from seaid.log.describe.names import meaning_of
from seaid.log.filtering import decimation
from seaid.log.motion import decimated
from seaid.log.rows import inside_transients
from seaid.regressor.load import LoadModel
from seaid.robot import Contact, Robot, torques_at_joints

if TYPE_CHECKING:
    from seaid.identification import Identification


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

    None for a robot without contacts in the log.
    """
    robot = floating(identification.known)
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
    result: Identification,
    datasets: Sequence[Dataset],
    fit: FittedRows,
    errors: SensorErrors | None,
) -> LeggedFit | None:
    """Return a fit for the checks of the feet, None without its rows."""
    motions = [log for log in datasets if isinstance(log, Motion) and log.base is not None]
    if fit.rows is None or len(motions) < len(datasets):
        return None
    bodies = bodies_of_fit(result)[0]
    return LeggedFit(
        robot=floating(result.known),
        motions=motions,
        fit=fit,
        model=result.model,
        springs=result.springs,
        theta=result.load_side.values,
        bodies=bodies,
        sensor_errors=np.empty((len(fit.rows.y), 0)) if errors is None else errors.columns,
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
        contacts = contacts_of(floating(identification.known), motion)
        instants = force_instants(identification, motion, contacts, bodies)
        links = tuple(contact.link for contact in contacts)
        loads.append(LoadedFeet(motion, links, instants.forces, instants.counts))
    return loads


def contacts_of(robot: FloatingRobot, motion: Motion) -> tuple[Contact, ...]:
    """Return the contacts with a flag or a measured wrench in a motion."""
    base = motion.base
    if base is None:
        return ()
    flagged = [contact for contact in robot.floating_base.contacts if contact.link in base.contacts]
    measured = [measured_contact(robot, x, y.shape[1]) for x, y in base.wrenches.items()]
    if base.up is None:
        measured = [replace(contact, radius_m=0.0) for contact in measured]
    return (*flagged, *measured)


def force_instants(
    identification: Identification, motion: Motion, contacts: Sequence[Contact], bodies: Array
) -> _Instants:
    """Return the forces at the instants of one motion."""
    model, base = identification.model, motion.base
    assert base is not None
    robot = guided(identification.known, base.guided)
    theta = identification.load_side.values
    rows, unknown = contact_force_rows(robot, motion, model, identification.springs, theta, bodies)
    touching, A, inverse = _equations_at(robot, motion, model, contacts, unknown)
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
    R = contact_rotations(robot, motion.joint_position, contacts)
    up = _verticals(base.up, base.specific_force, contacts, R, counts)
    # Normal force u^T f = (u^T A^+) rows: its variance is |u^T A^+|^2 for rows of variance 1.
    spread = np.einsum("tki,tkir->tkr", up, inverse[:, places])
    # Six rows of the base, of which a guide leaves some, and those of joints.
    count = np.sum(robot.free_axes) + np.sum(~unknown, axis=1)
    residual = in_band(motion, residual * base.used[:, None])
    return _Instants(
        forces=smoothed_where(motion, forces[:, places], counts),
        measured=smoothed_where(motion, _measured_forces(base, contacts, R), counts),
        up=up,
        counts=counts,
        spread=np.sum(spread**2, axis=2),
        squares=np.sum(residual**2, axis=1),
        # Rows with an equation less the forces that they determine.
        freedom=count - rank,
        used=base.used & inside_transients(motion),
        stands=stands,
    )


def _equations_at(
    robot: FloatingRobot,
    motion: Motion,
    model: LoadModel,
    contacts: Sequence[Contact],
    unknown: BoolArray | None,
    steps: IndexArray | slice = slice(None),
) -> tuple[dict[str, BoolArray], Array, Array]:
    """Return which contacts touch at some steps, by link, and their `contact_equations` there."""
    base, always = motion.base, np.ones(len(motion.time), dtype=bool)
    assert base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    touching = {x.link: base.contacts.get(x.link, always)[steps] for x in contacts}
    up, q = None if base.up is None else base.up[steps], motion.joint_position[steps]
    return touching, *contact_equations(robot, q, contacts, touching, joints, unknown, up)


def _measured_forces(base: BaseMotion, contacts: Sequence[Contact], R: Array) -> Array:
    """Return the measured forces (T, k, 3) in the frame of the base, NaN without a sensor."""
    measured = np.full((len(R), len(contacts), 3), np.nan)
    for k, contact in enumerate(contacts):
        if contact.link in base.wrenches:
            measured[:, k] = np.einsum("tij,tj->ti", R[:, k], base.wrenches[contact.link][:, :3])
    return measured


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
    robot, model = floating(identification.known), identification.model
    steps = np.flatnonzero(np.any(whole.counts[: len(motion.time)], axis=1))
    variance = np.full(len(contacts), np.nan)
    if not len(steps):
        return ("none",) * len(contacts), variance
    steps = steps[np.linspace(0, len(steps) - 1, min(len(steps), _INSTANTS)).astype(int)]
    assert motion.base is not None
    robot = guided(robot, motion.base.guided)
    *_, inverse = _equations_at(robot, motion, model, contacts, None, steps)
    columns, grouping = contact_force_columns(robot, motion, model, steps)
    F = inverse @ (row_scale(robot, columns.shape[1]) * columns)
    bodies = robot.parameters.size
    identified = [*model.base.columns, *range(bodies, bodies + len(model.drives))]
    # f = F theta is a function of the base parameters B theta (14) if F = F_b B, with the columns
    # F_b of those parameters; the same test as for a mass in `seaid.legged.base`.
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
        covariance = identification.load_side.covariance
        variance[k] = np.median(np.einsum("tm,mn,tn->t", normal, covariance, normal))
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
            # Independent parts: noise of the rows, and errors of the parameters.
            error = np.sqrt(noise * np.median(whole.spread[known, k]) + variance[k])
            numbers[4:, k] = _normal_numbers(normal[known, k], along[known, k], error, weight)
        both = np.all(np.isfinite(forces[:, k] + measured[:, k]), axis=1)
        if np.any(measured[both, k]):
            numbers[:4, k] = _errors_of_forces(measured[both, k], forces[both, k])
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


def _normal_numbers(
    f_n: Array, f_t: Array, error: float, weight: float
) -> tuple[float, float, float, float, float]:
    """Return mean, least and error of normal forces (T,), used friction, and the share of pulls."""
    loaded = f_n > LOADED * weight
    used = np.quantile(f_t[loaded] / f_n[loaded], 0.99) if np.any(loaded) else np.nan
    pulls = np.mean(f_n < -max(_PULLS * error, FREE * weight))
    return float(f_n.mean()), float(f_n.min()), error, float(used), float(pulls)


def _errors_of_forces(f_m: Array, f_p: Array) -> tuple[float, float, float, float]:
    """Return the rms of measured forces (T, 3), the absolute and relative error, and the factor."""
    rms = float(np.sqrt(np.mean(np.sum(f_m**2, axis=1))))
    difference = float(np.sqrt(np.mean(np.sum((f_p - f_m) ** 2, axis=1))))
    return rms, difference, difference / rms, float(np.sum(f_m * f_p) / np.sum(f_m**2))


def _mean_sum(normal: Array, stands: BoolArray) -> float:
    """Return the mean sum of normal forces (T, k) at the instants at which all are known."""
    known = np.all(np.isfinite(normal) | ~stands, axis=1) & np.any(stands, axis=1)
    return float(np.nansum(normal[known], axis=1).mean()) if np.any(known) else float("nan")


_LITTLE = 0.5
"""Degrees of freedom per instant below which the rows do not show their noise."""

_PULLS = 3.0
"""Standard errors below zero from which the force of a foot that stands is a pull."""


LOADED, FREE = 0.03, 0.015
"""Parts of the weight on a foot above which it stands, and below which it is in the air; between
them it stays what it was. A foot said to stand costs information only, one said to be in the air
biases the bodies, so both are small: in walks of a simulated Go2 whose bodies are wrong by 20 % and
that were used to select them, 99 % of the samples are right (docs/results.md)."""

_LOAD_HZ = 15.0
"""Low pass of the forces: a foot lands within a few hundredths of a second."""


@dataclass(frozen=True, eq=False, repr=False)
class FoundContacts(Display):
    """The contacts found in a log.

    Attributes
    ----------
    log : Log
        With the flags of all contacts; its report names those that were found.
    certainty : mapping {link: float}
        The share of the samples in which the force of a foot is clearly that of a standing foot, or
        of one in the air.
    """

    log: Log
    certainty: Mapping[str, float]

    def _in_short(self) -> str:
        texts = (f"{link} {share:.1%} certain" for link, share in self.certainty.items())
        return ", ".join(texts)


@checked(IdentificationError)
def find_contacts(robot: Robot, log: Log) -> FoundContacts:
    """Return a log with the contacts of a legged robot, found from its torques and its motion.

    Use flags or force sensors if there are any: a foot that carries little is not seen.

    Parameters
    ----------
    robot : Robot
        With a floating base, contacts, and inertial parameters, which may be wrong by a fifth.
    log : Log
        With the torques of all joints; flags that it has stay.

    Returns
    -------
    FoundContacts

    Raises
    ------
    IdentificationError
        For a robot without contacts or without inertial parameters, and a log without torques.

    Examples
    --------
    >>> found = seaid.legged.find_contacts(robot, log)
    >>> found.certainty
    >>> seaid.identify(robot, found.log)
    """
    if not isinstance(robot, FloatingRobot) or not robot.floating_base.contacts:
        raise IdentificationError(
            "find_contacts needs a robot with a floating base and contacts=", "contacts="
        )
    if log.base is None or not np.all(np.isfinite(robot.parameters)):
        raise IdentificationError(
            "find_contacts needs the motion of the base in the log, and the inertial parameters of "
            "the robot file, also if they are not exact"
        )
    logged, base = log.base, robot.floating_base
    missing = logged.unflagged(base.contact_links)
    flying = dict.fromkeys(missing, np.zeros(len(log.time)))
    unloaded = replace(log, base=replace(logged, contacts={**logged.contacts, **flying}))
    loads = _loads(robot, unloaded)
    flags, certainty, report = dict(logged.contacts), {}, list(log.report)
    for link in missing:
        load = loads[:, base.contact_links.index(link)]
        flags[link] = _standing(load).astype(float)
        unclear = (load >= 0.5 * LOADED) & (load <= 1.5 * LOADED)
        certainty[link] = float(np.mean(~unclear))
        report.append(_as_repair(link, log.time, unclear))
    base_log = replace(logged, contacts=flags)
    return FoundContacts(replace(log, base=base_log, report=tuple(report)), certainty)


def _as_repair(link: str, time: Array, unclear: BoolArray) -> Repair:
    """Return what the report of a log has about a contact that was found."""
    first = float(time[np.argmax(unclear)])
    action = f"found from torques and motion, {np.mean(~unclear):.1%} of the samples are clear"
    return Repair(f"{link}.contact", FOUND_CONTACT, int(np.sum(unclear)), first, action)


def _loads(robot: FloatingRobot, log: Log) -> Array:
    """Return the part of the weight (T, k) that each contact carries at the times of the log."""
    motion = reconstruct_motion(robot, log)
    base = motion.base
    assert base is not None
    bodies = robot.parameters + robot.payload_parameters
    rows = floating_regressor(robot, *motion.joint_states, base.states) @ bodies
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    torque = torques_at_joints(robot.transmission, motion.motor_torque * ratio)
    torque = np.where(np.isfinite(motion.joint_torque), motion.joint_torque, torque)
    if not np.all(np.isfinite(torque)):
        raise IdentificationError("find_contacts needs the torque of each joint in the log")
    rows[:, 6:] -= low_pass(torque, motion.rate_hz, min(_LOAD_HZ, 0.4 * motion.rate_hz))
    points = [replace(contact, is_flat=False) for contact in robot.floating_base.contacts]
    A = contact_map(robot, motion.joint_position, points, base.up)
    held = ~guided(robot, base.guided).free_axes
    rows[:, :6][:, held] = A[:, :6][:, held] = 0.0
    # All feet count as on the ground. Forces between two feet along their line act on nothing: the
    # small ridge makes them zero.
    normal = A.swapaxes(1, 2) @ A + 1e-9 * np.eye(A.shape[2])
    right = np.einsum("trk,tr->tk", A, rows)[:, :, None]
    forces = safely(
        np.linalg.solve, normal, right, what="the contact forces", error=IdentificationError
    )
    up = base.up
    if up is None:  # the mean specific force
        mean = base.specific_force.mean(axis=0)
        up = np.tile(mean / np.linalg.norm(mean), (len(forces), 1))
    support = np.einsum("tki,ti->tk", forces.reshape(len(forces), -1, 3), up)
    weight = bodies.reshape(-1, 10)[:, 0].sum() * np.linalg.norm(robot.model.gravity.linear)
    smooth = low_pass(support / weight, motion.rate_hz, min(_LOAD_HZ, 0.4 * motion.rate_hz))
    return np.column_stack([np.interp(log.time, motion.time, load) for load in smooth.T])


def _standing(load: Array) -> BoolArray:
    """Return whether a foot with this part (T,) of the weight stands, with hysteresis."""
    sure = np.where(load > LOADED, 1, np.where(load < FREE, 0, -1))
    last = np.maximum.accumulate(np.where(sure >= 0, np.arange(len(sure)), 0))
    # Between the limits a foot stays what it was; before the first clear sample it is in the air.
    return np.asarray(sure[last] == 1)


@checked(LogError)
def with_leg_order(guess: Description, robot: Robot, log: Log) -> Description:
    """Return an inferred description with the legs and flags in the order in which feet rest.

    Only where the joints were taken in the order of the columns: names count more than samples.

    Parameters
    ----------
    guess : Description
        As `describe_log` returns it.
    robot : Robot
        With a floating base and contacts.
    log : Log
        The log by this description.

    Returns
    -------
    Description
        The same without a floating base, without flags, or if no other order is clearly better.

    Examples
    --------
    >>> guess = seaid.describe_log("walk.npz", robot)
    >>> log = seaid.read_log("walk.npz", robot, description=guess.description)
    >>> guess = with_leg_order(guess, robot, log)
    """
    described, names = guess.description, robot.joint_names
    order = _better_order(described, robot, log)
    if order is None:
        return guess
    joints = {x: described.joints[names[j]] for x, j in zip(names, order.joints, strict=True)}
    contacts = {x: described.contacts[order.contacts.get(x, x)] for x in described.contacts}
    positions = (joints[joint].get("joint_position") for joint in names)
    first = [position.column for position in positions if position is not None]
    doubt = Doubt.of(
        "leg_order",
        speed=order.speed,
        as_given=order.speed_as_given,
        joints=", ".join(names),
        columns=", ".join(first),
    )
    # Limits that a joint exceeded were those of a joint of another leg.
    unsure = [x for x in guess.unsure if x.code != "beyond_limits"]
    return replace(
        guess,
        description=replace(described, joints=joints, contacts=contacts),
        unsure=(doubt.about(["joints", "contacts"]), *unsure),
    )


def _better_order(described: LogDescription, robot: Robot, log: Log) -> LegOrder | None:
    """Return the order of legs in which feet rest, None if names of columns have another one."""
    names = robot.joint_names
    if not isinstance(robot, FloatingRobot) or log.base is None or not log.base.contacts:
        return None
    named = (
        meaning_of(source.column, names).joint == joint
        for joint, sources in described.joints.items()
        for source in sources.values()
    )
    if not {*names} <= {*described.joints} or any(named):
        return None
    return best_order(FeetInMotion(robot, reconstruct_motion(robot, log), [log]))
