"""Contacts of a robot with the ground by a fit: their forces, and what contradicts the feet.

With the parameters of the bodies the rows of base and joints, Y theta - tau = sum J_c^T f_c, are
linear equations of the contact forces at each instant, solved by least squares in the metric in
which `identify` eliminates them. What the equations determine follows from the null space of all
J_c^T: with the torques of three joints per leg that of each point foot, without them the sum of
four only, and of several points of one foot never more than their sum.

A mass at a place of contact that always stands hides in the force there: the force is determined by
the identified parameters only if that mass is, too.

If the radius of a foot is wrong by d, its force f acts d away from its true point: J_c^T f changes
by the moment of f about that vertical shift. With the f of the fit that is one more column of its
rows, as are forces on feet that are flagged as in the air.

Feet on hard ground keep their heights: h_k = up . r_k of two of them differ by a constant, by the
slope of the ground, and, if they sink in by c N under the normal force N, by -c (N_i - N_j). With
the contact forces of the fit that is a linear regression for c. Without the orientation of the base
the plane through four or more feet takes the place of the vertical.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr, stdtrit

from seaid._arrays import Array, BoolArray, IndexArray, safely
from seaid._progress import Display
from seaid.checks import CODES
from seaid.checks.engine import Alternative, Check, equation_of
from seaid.checks.tolerances import FEW, MATTERS, SURE
from seaid.errors import ExcitationError, Finding, listed
from seaid.estimation import Estimate, FittedRows
from seaid.estimation.fitting import with_further_columns
from seaid.estimation.least_squares import ordinary
from seaid.estimation.qr_factor import scaled_svd
from seaid.identification.datasets import Dataset
from seaid.identification.stacked_fits import SensorErrors
from seaid.identification.validation import for_sensors
from seaid.legged.base import DETERMINED, bodies_of_fit, whole_body
from seaid.legged.feet import FREE, LOADED, foot_places
from seaid.legged.floating import (
    FloatingRobot,
    base_of,
    contact_equations,
    contact_rotations,
    floating,
    guided,
    measured_contact,
    row_scale,
)
from seaid.legged.load_side import (
    contact_force_columns,
    contact_force_rows,
    late_flag_rows,
    radius_rows,
)
from seaid.log import Motion, in_band
from seaid.log.base_log import BaseMotion
from seaid.log.filtering import decimation
from seaid.log.motion import MotionWithBase, decimated
from seaid.regressor import Regression
from seaid.regressor.load import LoadModel
from seaid.regressor.regression import stacked
from seaid.robot import Contact

if TYPE_CHECKING:
    from seaid.identification import Identification


FOOT_TOUCHES_S = 0.06
"""Time [s] in which the force of a foot that lands or leaves is less than a threshold of 20 N, on
soft feet of a simulated Go2 that trots (`scripts/benchmarks/legged_findings.py`)."""

LENGTH_M = 0.001
"""Error [m] of the place of a contact that matters: 1 mm is 0.2 % of the mass of a Go2."""

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


@dataclass(frozen=True, eq=False)
class LoadedFeet:
    """The forces of a fit on the feet that stand, at the instants of a motion.

    `forces` (T, k, 3) are those of the contacts at `links` in the frame of the base, NaN where they
    are not determined; `stands` (T, k): the foot stands.
    """

    motion: Motion
    links: tuple[str, ...]
    forces: Array
    stands: BoolArray


@dataclass(frozen=True, eq=False)
class LeggedFit:
    """A fit of a robot with a floating base, whose motions are in memory.

    Attributes
    ----------
    robot : FloatingRobot
        With the bodies that count as known.
    motions, fit, model, springs
        The motions, the rows of the fit, their columns, and the springs of its drives.
    theta, bodies : arrays (p,) and (10 N,)
        Parameters of the fit, and standard parameters that have them.
    sensor_errors : array (R, k)
        Columns of errors of sensors that were subtracted: they may come of a wrong radius, and are
        identified again.
    mass_kg : float
        That of the whole robot, NaN where it is not determined.
    loads : sequence of LoadedFeet
        Empty if feet have force sensors, or no flags.
    """

    robot: FloatingRobot
    motions: Sequence[MotionWithBase]
    fit: FittedRows
    model: LoadModel
    springs: Mapping[str, Array]
    theta: Array
    bodies: Array
    sensor_errors: Array
    mass_kg: float
    loads: Sequence[LoadedFeet] = ()

    @property
    def bases(self) -> list[BaseMotion]:
        """The motions of the base."""
        return [motion.base for motion in self.motions]

    @property
    def weight_N(self) -> float:
        """The weight of the robot, NaN where its mass is not determined."""
        # The mean of |f| is at least |mean f|, which is g for a base that comes to rest again: this
        # is an upper bound of the weight.
        forces = [np.linalg.norm(base.specific_force, axis=1).mean() for base in self.bases]
        return self.mass_kg * float(np.mean(forces))

    def significant_columns(
        self, regress: Callable[[Motion], Regression], names: Sequence[str], least: float
    ) -> list[tuple[str, float, float, float]]:
        """Return name, value, standard error and share of further columns that are significant.

        The value is beyond chance and larger than the `least` one that matters, of either sign. The
        share is the part of the squared residual that all columns explain at the rows on which they
        act. Without the orientation of each base there are none.
        """
        if any(base.up is None for base in self.bases):
            return []
        columns, count = stacked([regress(motion) for motion in self.motions]).H, len(names)
        larger = with_further_columns(
            self.fit,
            np.hstack([self.sensor_errors, columns]),
            lambda values: bool(np.any(np.abs(values[-count:]) > least)),
        )
        if larger is None:
            return []
        values, errors = larger.values[-count:], larger.standard_errors[-count:]
        sure = np.abs(values) > np.maximum(_beyond_chance(larger) * errors, least)
        known = equation_of(self.fit).with_alternatives([Alternative(self.sensor_errors, 0)])
        after = known.with_alternatives([Alternative(columns, 0)])
        acts = np.any(columns != 0, axis=1)
        share = 1 - after.squares(acts) / max(known.squares(acts), 1e-300)
        named = zip(names, values.tolist(), errors.tolist(), strict=True)
        return [(*column, share) for column, is_sure in zip(named, sure, strict=True) if is_sure]


def legged_fit(
    result: Identification,
    datasets: Sequence[Dataset],
    fit: FittedRows,
    errors: SensorErrors | None,
) -> LeggedFit | None:
    """Return a fit for the checks of the feet, None without its rows."""
    motions = [log for log in datasets if isinstance(log, MotionWithBase)]
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
    identification: Identification, motions: Sequence[MotionWithBase], bodies: Array
) -> list[LoadedFeet]:
    """Return the forces on feet that stand, if the flags of each log and nothing else has them."""
    bases = [motion.base for motion in motions]
    if any(base.wrenches or not base.contacts for base in bases):
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
    if not isinstance(motion, MotionWithBase):
        return ()
    base = motion.base
    flagged = [contact for contact in robot.floating_base.contacts if contact.link in base.contacts]
    measured = [measured_contact(robot, x, y.shape[1]) for x, y in base.wrenches.items()]
    if base.up is None:
        measured = [replace(contact, radius_m=0.0) for contact in measured]
    return (*flagged, *measured)


def inside_transients(motion: Motion) -> BoolArray:
    """Return the samples (T,) that are no filter transients."""
    samples, transient = np.arange(len(motion.time)), round(motion.transient_s * motion.rate_hz)
    return np.asarray((samples >= transient) & (samples < len(samples) - transient))


def force_instants(
    identification: Identification, motion: Motion, contacts: Sequence[Contact], bodies: Array
) -> _Instants:
    """Return the forces at the instants of one motion."""
    model, base = identification.model, base_of(motion)
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
    counts = stands & (np.min(diagonal, axis=2) > 1 - DETERMINED) & base.used[:, None]
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
    base, always = base_of(motion), np.ones(len(motion.time), dtype=bool)
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
    robot = guided(robot, base_of(motion).guided)
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
        is_identified = np.linalg.norm(undetermined[counts, axes]) <= DETERMINED * size
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
    pulls = np.mean(f_n < -max(SURE * error, FREE * weight))
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


# What the forces of a fit, and its rows, contradict in the feet


def _beyond_chance(estimate: Estimate) -> float:
    """Return the quantile of Student's t with the tail probability of `SURE` standard errors."""
    freedom = estimate.degrees_of_freedom
    return SURE if freedom is None else float(stdtrit(np.min(freedom), ndtr(SURE)))


def _radius(fit: LeggedFit) -> Iterator[Finding]:
    """Yield a radius of the feet, one for all of them, that the rows of a fit contradict.

    A fitted radius beyond the next joint is not reported: it stands for another error.
    """
    base = fit.robot.floating_base
    radii = {x.link: x.radius_m for x in base.contacts if not x.is_flat}
    above_m = np.array([np.linalg.norm(base.frame(link)[2]) for link in radii])
    largest_m = float(np.min(above_m[above_m > 0], initial=math.inf))
    flagged = all(radii.keys() <= base.contacts.keys() for base in fit.bases)
    if len({*radii.values()}) != 1 or not flagged:
        return

    def regress(motion: Motion) -> Regression:
        return radius_rows(fit.robot, motion, fit.model, fit.springs, fit.theta, fit.bodies)

    for _, change_m, error_m, share in fit.significant_columns(regress, ("radius",), LENGTH_M):
        radius_m = max(radii.values())
        fitted_m = radius_m + change_m
        if 0 < fitted_m < largest_m:
            evidence = {"radius [m]": fitted_m, "standard error [m]": error_m, "explained": share}
            given, matters = {"given": f"{1e3 * radius_m:.3g}"}, bool(share >= MATTERS)
            yield CODES["geometry"].finding("feet", "", {**evidence, **given}, is_worse=matters)


def _pushing_feet(fit: LeggedFit) -> Iterator[Finding]:
    """Yield feet that push at the ground before or after their flag, by the rows of a fit."""
    flags = (flag for base in fit.bases for flag in base.contacts.values())
    if all(map(np.all, flags)) or not np.isfinite(fit.mass_kg):
        return
    regress = partial(late_flag_rows, fit.robot, model=fit.model, reach_s=FOOT_TOUCHES_S)
    times, least_N = ("before a landing", "after it leaves"), FEW * fit.weight_N
    pushes = [push for push in fit.significant_columns(regress, times, least_N) if push[1] > 0]
    if pushes:
        texts = [f"{value:.2g} +- {error:.1g} N {when}" for when, value, error, _ in pushes]
        evidence = {f"{when} [N]": value for when, value, *_ in pushes}
        words = {"pushes": listed(texts), "fading": f"{FOOT_TOUCHES_S:g}"}
        yield CODES["contact-flags"].finding("pushes", "", {**evidence, **words})


def _sinking_feet(fit: LeggedFit) -> Iterator[Finding]:
    """Yield the sinking of feet under their load, if the heights of standing feet show one."""
    parts = [part for part in (_heights(fit.robot, feet) for feet in fit.loads) if part is not None]
    if not parts:
        return
    try:
        estimate = ordinary(stacked([rows for rows, _ in parts]))
    except ExcitationError:  # the load is always the same
        return
    compliance, error = float(estimate.values[0]), float(estimate.standard_errors[0])
    load_N = float(np.concatenate([forces for _, forces in parts]).mean())
    sinking_m = compliance * load_N
    if compliance < _beyond_chance(estimate) * error or sinking_m < LENGTH_M:
        return
    evidence = {"compliance [m/N]": compliance, "standard error [m/N]": error}
    evidence["mean load [N]"], words = load_N, {"sinking": f"{1e3 * sinking_m:.2g}"}
    yield CODES["soft-feet"].finding("sink", "", {**evidence, **words})


def _heights(robot: FloatingRobot, feet: LoadedFeet) -> tuple[Regression, Array] | None:
    """Return the heights of standing feet as rows of their load, and the loads (R,); None without.

    Both are about the mean of the feet, and less what their own heights and the slope of the ground
    explain. The slope has constant coefficients along the heading of the base: a robot that turns
    on sloping ground violates that. Without an orientation the height of a foot over the plane of
    the others counts.
    """
    motion, base = feet.motion, base_of(feet.motion)
    up = _upwards(motion, base)
    # Two feet have a difference in height. A plane goes through any three: it needs a fourth.
    fewest = 4 if base.up is None else 2
    places = foot_places(robot, motion.joint_position, feet.links)
    places = smoothed_where(motion, places, feet.stands)
    height, *level = (np.einsum("tki,ti->tk", places, axis) for axis in (up, *_level(up)))
    load = np.einsum("tki,ti->tk", feet.forces, up)
    counts, k = feet.stands & np.isfinite(height) & np.isfinite(load), len(feet.links)
    # feet have heights of their own, but for the first one
    offsets = np.broadcast_to(np.eye(k)[:, 1:], (*height.shape, k - 1))
    # h_k = c_0(t) + offset_k + slope . (x_k, y_k) - c N_k: the column of the compliance c is -N_k.
    values = np.concatenate([np.stack([height, -load, *level], axis=2), offsets], axis=2)
    # At each instant the height of the base, or the plane of the feet, is free.
    per_instant = np.stack([np.ones_like(height), *(level if base.up is None else ())], axis=2)
    counts &= np.sum(counts, axis=1, keepdims=True) >= fewest
    about_mean = _unexplained(per_instant, values, counts)
    rows = np.isfinite(about_mean[:, :, 0])
    if not np.any(rows):
        return None
    return _compliance_rows(about_mean[rows], motion.time[np.nonzero(rows)[0]]), load[rows]


def _unexplained(per_instant: Array, values: Array, counts: BoolArray) -> Array:
    """Return values (T, feet, columns) of counted feet less what columns of each instant explain.

    They are NaN for other feet.
    """
    remaining = np.full_like(values, np.nan)
    for pattern in np.unique(counts[np.any(counts, axis=1)], axis=0):
        # (t, feet, columns) at all instants with the same counted feet
        at = np.ix_(np.flatnonzero(np.all(counts == pattern, axis=1)), np.flatnonzero(pattern))
        inverse = safely(np.linalg.pinv, per_instant[at], what="the places of standing feet")
        remaining[at] = values[at] - per_instant[at] @ inverse @ values[at]
    return remaining


def _compliance_rows(about_mean: Array, time: Array) -> Regression:
    """Return the rows of the compliance from columns (R, 2 + c): height, its column, and others.

    What the others explain, slope and heights of the feet, is subtracted (Frisch and Waugh 1933).
    """
    pairs, columns = np.split(about_mean, [2], axis=1)
    span = scaled_svd(columns).span()
    y, H = (pairs - span @ (span.T @ pairs)).T
    return Regression.of_equation(["compliance"], ["m/N"], H[:, None], y, time)


def _upwards(motion: Motion, base: BaseMotion) -> Array:
    """Return the vertical (T, 3) in the frame of the base, as the mean specific force if needed."""
    if base.up is not None:
        return base.up
    mean = in_band(motion, base.specific_force)
    return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))


def _level(up: Array) -> tuple[Array, Array]:
    """Return two level directions (T, 3) in the frame of the base, as near to its x and y."""
    # y x z = x, and z x x = y
    first = np.cross([0.0, 1.0, 0.0], up)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-9)
    return first, np.cross(up, first)


FEET_CHECKS = (
    Check(CODES["geometry"], (), _radius),
    Check(CODES["contact-flags"], (), _pushing_feet),
    Check(CODES["soft-feet"], (), _sinking_feet),
)
"""What the rows of a fit contradict in the feet."""


def smoothed_where(motion: Motion, values: Array, counts: BoolArray) -> Array:
    """Return the low-passed values (T, k, 3) over the samples that count, NaN at the others."""
    # Normalised convolution (Knutsson and Westin 1993): the low pass of the counted samples over
    # that of their mask, so that the values at a boundary are not drawn to zero.
    weight = in_band(motion, counts.astype(float))[:, :, None]
    counted = np.where(counts[:, :, None] & np.isfinite(values), values, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = in_band(motion, counted) / weight
    kept = counts & inside_transients(motion)[:, None] & (weight[:, :, 0] > _WEIGHT)
    return np.where(kept[:, :, None] & np.isfinite(values), smooth, np.nan)


_WEIGHT = 0.25
"""Least share of counted samples under the low pass: at a boundary it is one half."""
