"""Checks of the feet of a legged robot: flags and order of legs, radius, forces, ground, mass.

A foot on the ground has no velocity: v_b + w x r + J q' = 0. The velocity of the base is that of
the log, else the one at which most standing feet rest. This checks flags and legs before a fit.

After it, a radius that is wrong by d puts the contact forces f too low by d: it adds d times the
moments of f about the vertical displacement to J_c^T f. With the f of the fit that is one more
column of its rows, as are forces on feet that are flagged as in the air.

Feet on hard ground keep their heights: h_k = up . r_k of two of them differ by a constant, by the
slope of the ground, and, if they sink in by c N under the normal force N, by -c (N_i - N_j). With
the contact forces of the fit that is a linear regression for c. Without the orientation of the base
the plane through four or more feet takes the place of the vertical.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import permutations
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ndtr, stdtrit

from seaid._arrays import Array, BoolArray, IndexArray, runs, safely
from seaid._files import toml_table
from seaid.checks import tolerances as tol
from seaid.checks.check import Observation, in_description
from seaid.checks.codes import (
    CONTACT_FLAGS,
    CONTACT_FORCES,
    GEOMETRY,
    SOFT_FEET,
    SWAPPED_JOINTS,
    TOTAL_MASS,
    UNIDENTIFIABLE,
)
from seaid.errors import ExcitationError, Finding, listed
from seaid.estimation import Estimate, FittedRows, ordinary, with_further_columns
from seaid.log import (
    LEAST_LIFT,
    POSITION_BAND,
    BaseMotion,
    Log,
    Motion,
    as_toml,
    in_band,
    smoothed_where,
)
from seaid.regressor import (
    LoadModel,
    Regression,
    contact_map,
    late_flag_rows,
    radius_rows,
    stacked,
)
from seaid.robot import Contact, FloatingBase, Robot

# Before a fit: flags of contacts, and the order of legs


@dataclass(frozen=True, eq=False)
class FeetInMotion:
    """The feet of a robot with a floating base in one motion of its logs."""

    robot: Robot
    motion: Motion
    logs: Sequence[Log]

    @property
    def base(self) -> BaseMotion:
        """The motion of the base."""
        assert self.motion.base is not None
        return self.motion.base

    @cached_property
    def contacts(self) -> list[Contact]:
        """The k contacts with a flag, as points or balls."""
        floating = self.robot.floating_base
        contacts = () if floating is None else floating.contacts
        flagged = (contact for contact in contacts if contact.link in self.base.contacts)
        return [replace(contact, is_flat=False) for contact in flagged]

    @cached_property
    def links(self) -> list[str]:
        """Their links."""
        return [contact.link for contact in self.contacts]

    @cached_property
    def flags(self) -> BoolArray:
        """Whether each contact is flagged as standing (T, k)."""
        flags = [self.base.contacts[link] for link in self.links]
        return np.column_stack([np.empty((len(self.motion.time), 0), dtype=bool), *flags])

    @cached_property
    def velocities(self) -> Array:
        """The velocities (T, k, 3) of the contacts in the base's frame, if its origin rests."""
        return self.velocities_at(slice(None))

    def velocities_at(
        self, some: IndexArray | slice, order: Sequence[int] | slice = slice(None)
    ) -> Array:
        """Return `velocities` at some instants, with the `order` of the channels of the joints."""
        base, motion = self.base, self.motion
        q, v = (x[some][:, order] for x in (motion.joint_position, motion.joint_velocity))
        up = None if base.up is None else base.up[some]
        J = contact_map(self.robot, q, self.contacts, up).swapaxes(1, 2)[:, :, 3:]
        rates = np.hstack([base.angular_velocity[some], v])
        return np.asarray(np.einsum("tij,tj->ti", J, rates).reshape(len(rates), -1, 3))

    @cached_property
    def judged(self) -> BoolArray:
        """The instants (T,) at which the velocity of the base is known.

        Without that of the log it is that of the majority, if three feet or more stand.
        """
        is_known = self.base.velocity is not None
        return np.asarray(self.base.used & (is_known | (self.flags.sum(axis=1) >= 3)))

    @cached_property
    def speeds(self) -> tuple[Array, Array]:
        """Vertical and horizontal speeds (T, k); all of it is horizontal without orientation."""
        velocity = _over_ground(self.velocities, self.base.velocity, self.flags)
        speed = np.linalg.norm(velocity, axis=2)
        if self.base.up is None:
            return np.zeros_like(speed), speed
        vertical = np.abs(np.einsum("tki,ti->tk", velocity, self.base.up))
        return vertical, np.sqrt(np.maximum(speed**2 - vertical**2, 0.0))

    def source_of(self, link: str) -> Any:
        """Return the source of a flag as the last description has it."""
        described: Mapping[str, Any] = {}
        for log in self.logs:
            described = (log.description or {}).get("contacts", described)
        return described.get(link, {}).get("contact", f"{link}.contact")

    def channels_of(self, joint: str) -> dict[str, str]:
        """Return {quantity: source as TOML} of a joint, as the last description has it."""
        sources = (log.sources()[joint] for log in self.logs)
        return {name: as_toml(x) for channels in sources for name, x in channels.items()}


def _flag_tables(sources: Mapping[str, Any]) -> str:
    """Return the TOML of flags {link: source}."""
    flags = {link: {"contact": as_toml(source)} for link, source in sources.items()}
    return in_description(flags, table="contacts")


def _contradicted_flags(feet: FeetInMotion) -> Iterator[Finding]:
    """Yield contacts, or legs, whose flags the motion contradicts."""
    if not np.any(feet.flags):
        return
    order = best_order(feet)
    late = None if order is not None else lateness(feet)
    if order is not None:
        yield from _exchanges(feet, order)
    elif late is not None:
        yield _late_finding(feet, *late)
    else:
        for k, link in enumerate(feet.links):
            yield from _moving(feet, k, link)
        if feet.base.up is not None:
            yield from _resting(feet)


MOTION_CHECKS = (Observation(CONTACT_FLAGS, _contradicted_flags),)
"""What is looked for in the motion of the feet."""


def _moving(feet: FeetInMotion, k: int, link: str) -> Iterator[Finding]:
    """Yield a contact that moves while its flag says that it stands."""
    vertical, along = (speed[:, k] for speed in feet.speeds)
    standing, has_vertical = feet.flags[:, k] & feet.judged, feet.base.up is not None
    rises, slides = lifted(vertical, standing, feet.motion.rate_hz), along > tol.FOOT_SLIDES_M_S
    for moving, speed, how, is_doubtful in (
        (rises, vertical, "is in the air: it rises and falls", True),
        (slides & standing, along, "slips" if has_vertical else "moves", not has_vertical),
    ):
        share = float(moving.sum()) / max(int(standing.sum()), 1)
        if share >= tol.FEW:
            rms = float(np.sqrt(np.mean(speed[moving] ** 2)))
            yield CONTACT_FLAGS.finding(
                f"{link} is flagged as standing and {how}, with {rms:.2g} m/s during {share:.1%} "
                f"of its stance, first at t = {feet.motion.time[np.argmax(moving)]:.3f} s",
                link,
                "doubtful" if is_doubtful else "note",
                {"speed [m/s]": rms, "share of the stance": share},
                "check the threshold and the delay of its flag, or exclude these times (exclude_s "
                "of the description of the log)"
                if is_doubtful
                else "",
            )
            return


def lifted(vertical: Array, standing: BoolArray, rate_hz: float) -> BoolArray:
    """Return the samples (T,) at which a standing foot moves up or down, far enough to be lifted.

    One that moves by less may sink into the ground, or be soft.
    """
    rises = standing & (vertical > tol.FOOT_RISES_M_S)
    for start, end in runs(rises):
        if np.sum(vertical[start:end]) < tol.FOOT_LIFTS_M * rate_hz:
            rises[start:end] = False
    return np.asarray(rises)


def _resting(feet: FeetInMotion) -> Iterator[Finding]:
    """Yield a contact that rests on the level of the others, and its flag says it is in the air."""
    flags, motion, up = feet.flags, feet.motion, feet.base.up
    assert up is not None
    places = foot_places(feet.robot, motion.joint_position, feet.links)
    height = np.einsum("tki,ti->tk", places, up)
    ground, on_ground = np.full(len(height), np.nan), np.any(flags, axis=1)
    ground[on_ground] = np.nanmedian(np.where(flags, height, np.nan)[on_ground], axis=1)
    for k, link in enumerate(feet.links):
        in_air = feet.judged & ~flags[:, k]
        level = runs(in_air & (np.abs(height[:, k] - ground) < tol.FOOT_LEVEL_M))
        rests_s = (level[:, 1] - level[:, 0]) / motion.rate_hz
        rests_s = rests_s[rests_s > tol.FOOT_REST_S]
        if not len(rests_s):
            continue
        longest_s = float(np.max(rests_s))
        share = float(np.sum(rests_s)) * motion.rate_hz / float(np.sum(in_air))
        yield CONTACT_FLAGS.finding(
            f"{link} is flagged as in the air and rests on the level of the others for "
            f"{longest_s:.2g} s, {share:.0%} of that time in all: forces on it would go into the "
            "bodies",
            link,
            "wrong" if share > tol.RARE else "doubtful",
            {"longest rest [s]": longest_s, "share": share},
            "check the sign, the threshold and the delay of its flag",
        )


def foot_places(robot: Robot, q: Array, links: Sequence[str]) -> Array:
    """Return the places (T, k, 3) of contacts in the frame of the base.

    The moment of a force F at r on the base is r x F: its rows of the contact map have r.
    """
    assert robot.floating_base is not None
    points = [replace(robot.floating_base.contact_of(x), is_flat=False) for x in links]
    A = contact_map(robot, q, points)[:, 3:6].reshape(len(q), 3, -1, 3)
    # the rows of [r]x are (0, -z, y), (z, 0, -x), (-y, x, 0)
    return np.stack([A[:, 2, :, 1], A[:, 0, :, 2], A[:, 1, :, 0]], axis=2)


def unused_lifts(base: FloatingBase, motions: Sequence[Motion]) -> Iterator[Finding]:
    """Yield feet that are in the air too briefly for any of these samples to be used."""
    for link in base.contact_links:
        count, duration_s, least_s, is_used = 0, 0.0, 0.0, False
        for motion in motions:
            if motion.base is not None and link in motion.base.contacts:
                is_up = ~motion.base.contacts[link]
                is_used |= bool(np.any(is_up & motion.base.used))
                count += len(runs(is_up))
                duration_s += float(is_up.sum()) / motion.rate_hz
                least_s = max(least_s, LEAST_LIFT / (POSITION_BAND * motion.cutoff_hz))
        if is_used or count == 0:
            continue
        yield UNIDENTIFIABLE.finding(
            f"{link} is in the air for {duration_s:.2g} s in all, in {count} lifts, which are not "
            "used: next to a change of contact the positions have a corner, and half a period of "
            "the cutoff or less would determine the mass at this foot alone. That mass counts as "
            "not determined",
            link,
            "note",
            {"in the air [s]": duration_s, "lifts": float(count)},
            f"lift the foot for a second or more, or at least {least_s:.2g} s at a time",
            "certain",
        )


def lateness(feet: FeetInMotion) -> tuple[float, float, float] | None:
    """Return by how much [s] all flags are late, and the speeds of standing feet now and without.

    None unless other times are clearly better.
    """
    rate_hz, flags = feet.motion.rate_hz, feet.flags
    most = int(tol.FOOT_REST_S * rate_hz)
    inside = np.arange(most, len(flags) - most)
    if len(inside) < tol.JUDGED_PARTS or np.all(flags == flags[0]):
        return None
    some = inside[_spread(len(inside), 4 * tol.JUDGED_INSTANTS)]
    step, velocities = max(most // 20, 1), feet.velocities[some]
    squares = {
        shift: _mean_squares(velocities, feet.base, some, flags[some + shift])
        for shift in range(-(most // step) * step, most + 1, step)
    }
    best = min(squares, key=lambda shift: float(np.mean(squares[shift])))
    if abs(best) < 2 * step or not _is_clearly_lower(squares[best], squares[0]):
        return None
    now, speed = (float(np.sqrt(np.mean(squares[shift]))) for shift in (0, best))
    return (best / rate_hz, now, speed) if now > tol.FEET_REST_M_S else None


def _late_finding(feet: FeetInMotion, late_s: float, now: float, speed: float) -> Finding:
    """Return the finding on flags that are all late, with their delay."""
    sources = {}
    for link in feet.links:
        source = feet.source_of(link)
        whole = dict(source) if isinstance(source, Mapping) else {"columns": source}
        whole["delay_s"] = round(float(whole.get("delay_s", 0.0)) + late_s, 3)
        sources[link] = whole
    return CONTACT_FLAGS.finding(
        f"the flags of the contacts are {'late' if late_s > 0 else 'early'} by about "
        f"{abs(late_s):.2g} s: standing feet move with {now:.2g} m/s (rms), and with {speed:.2g} "
        "m/s without this delay",
        severity="wrong",
        evidence={"delay [s]": late_s, "speed [m/s]": now},
        remedy=_flag_tables(sources),
    )


def _over_ground(velocities: Array, velocity: Array | None, flags: BoolArray) -> Array:
    """Return the velocities (T, k, 3) of contacts over the ground."""
    if velocity is None:
        standing = np.where(flags[:, :, None], velocities, np.nan)
        standing[~np.any(flags, axis=1)] = 0.0
        velocity = -np.nanmedian(standing, axis=1)
    return np.asarray(velocities + velocity[:, None])


def _mean_squares(velocities: Array, base: BaseMotion, some: IndexArray, flags: BoolArray) -> Array:
    """Return the mean squared speeds of contacts that stand, in successive parts of the time."""
    velocity = None if base.velocity is None else base.velocity[some]
    squares = flags * np.sum(_over_ground(velocities, velocity, flags) ** 2, axis=2)
    parts = (np.array_split(x, tol.JUDGED_PARTS) for x in (squares, flags))
    return np.array([np.sum(x) / max(np.sum(stand), 1) for x, stand in zip(*parts, strict=True)])


def _spread(count: int, most: int) -> IndexArray:
    """Return at most `most` places that are spread over `count`."""
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def _is_clearly_lower(squares: Array, others: Array) -> bool:
    """Whether squared speeds in parts of the time are lower by half, and in most of the parts."""
    is_half = np.mean(squares) <= tol.MOST * np.mean(others)
    return bool(is_half and np.mean(squares <= others) >= 1 - tol.RARE)


@dataclass(frozen=True)
class LegOrder:
    """The order of joints and contacts in which standing feet rest best, and their speeds [m/s].

    `joints` has for each joint the one whose channels it has to get, `contacts` {link: link} for
    each contact the one whose flag it has to get.
    """

    joints: tuple[int, ...]
    contacts: Mapping[str, str]
    speed: float
    speed_as_given: float


def best_order(feet: FeetInMotion) -> LegOrder | None:
    """Return the order of legs and of contact flags in which standing feet rest, None for the own.

    All orders of legs with equal kinds of joints count, also those of logs that have the first
    joints of all legs, then the second ones, and so on; each with all orders of the flags. None
    unless one is clearly better than that of the log and than all others.
    """
    links, standing = feet.links, feet.flags.sum(axis=1)
    used = np.flatnonzero(feet.base.used & (standing >= 2))
    if len(used) < tol.JUDGED_PARTS:
        return None
    differing = used[standing[used] < len(links)]  # all flags are equal while all feet stand
    used = used if len(differing) < tol.JUDGED_PARTS else differing
    tried = _tried_orders(feet, used[_spread(len(used), tol.JUDGED_INSTANTS)])
    as_given = next(tried)
    if np.mean(as_given[0]) < tol.FEET_REST_M_S**2:
        return None
    best, second, *_ = sorted([as_given, *tried], key=lambda each: float(np.mean(each[0])))
    squares, order, places = best
    is_best = np.mean(squares <= second[0]) >= 1 - tol.RARE
    if not is_best or not _is_clearly_lower(squares, as_given[0]):
        return None
    exchanged = {links[i]: links[j] for i, j in enumerate(places) if i != j}
    speed, speed_as_given = (float(np.sqrt(np.mean(x))) for x in (squares, as_given[0]))
    return LegOrder(tuple(order), exchanged, speed, speed_as_given)


def _tried_orders(
    feet: FeetInMotion, some: IndexArray
) -> Iterator[tuple[Array, list[int], tuple[int, ...]]]:
    """Yield the mean squared speeds of each order of joints and of flags, first as in the log."""
    as_given = tuple(range(len(feet.links)))
    flag_orders = [*permutations(as_given)] if len(as_given) <= tol.MOST_LEGS else [as_given]
    for order in _orders(_legs(feet), feet.robot.n):
        velocities = feet.velocities_at(some, order)
        for places in flag_orders:
            flags = feet.flags[some][:, places]
            yield _mean_squares(velocities, feet.base, some, flags), order, places


def _orders(legs: Sequence[IndexArray], n: int) -> Iterator[list[int]]:
    """Yield orders of the joints (n,), first that of the log."""
    yield list(range(n))
    if not 2 <= len(legs) <= tol.MOST_LEGS:
        return
    joints = np.concatenate(legs)
    grouped = np.sort(joints).reshape(-1, len(legs))  # a row per kind of joint
    for places in permutations(range(len(legs))):
        by_leg = np.concatenate([legs[k] for k in places])
        by_kind = np.concatenate([grouped[:, k] for k in places])
        for sources in (by_leg, by_kind):
            order = np.arange(n)
            order[joints] = sources
            if order.tolist() != list(range(n)):
                yield order.tolist()


def _legs(feet: FeetInMotion) -> list[IndexArray]:
    """Return the joints of each leg: those that move its contacts alone, of equal kinds."""
    robot = feet.robot
    J = contact_map(robot, feet.motion.joint_position[:1], feet.contacts)[0, 6:]
    moved = np.any(J.reshape(robot.n, -1, 3) != 0.0, axis=2)
    sets = np.unique(moved.T, axis=0)
    legs = [np.flatnonzero(moving & (sets.sum(axis=0) == 1)) for moving in sets]
    legs = sorted((leg for leg in legs if len(leg)), key=lambda leg: int(leg[0]))
    kinds = [tuple(np.array(robot.is_prismatic)[leg]) for leg in legs]
    return legs if len(set(kinds)) == 1 else []


def _exchanges(feet: FeetInMotion, order: LegOrder) -> Iterator[Finding]:
    """Yield legs that are exchanged, and flags."""
    names = feet.robot.joint_names
    moved = {names[j]: names[source] for j, source in enumerate(order.joints) if j != source}
    if moved:
        yield SWAPPED_JOINTS.finding(
            f"legs are exchanged: standing feet move with {order.speed_as_given:.2g} m/s (rms), "
            f"and with {order.speed:.2g} m/s if the channels of these joints are meant: "
            f"{listed(f'{joint} by those of {source}' for joint, source in moved.items())}",
            next(iter(moved)),
            "wrong",
            remedy=in_description({x: feet.channels_of(source) for x, source in moved.items()}),
        )
    if order.contacts:
        exchanged = ", ".join(f"{link} by that of {x}" for link, x in order.contacts.items())
        yield CONTACT_FLAGS.finding(
            f"the flags of contacts are exchanged: the feet stand as if that of {exchanged} were "
            "meant",
            next(iter(order.contacts)),
            "wrong",
            remedy=_flag_tables({x: feet.source_of(y) for x, y in order.contacts.items()}),
        )


# After it: radius, forces, ground, mass


@dataclass(frozen=True, eq=False)
class LoadedFeet:
    """The forces of a fit on the feet that stand, at the instants of a motion.

    `forces` (T, k, 3) are those of the contacts at `links` in the frame of the base, NaN where they
    are not determined; `counts` (T, k) are the feet that stand.
    """

    motion: Motion
    links: tuple[str, ...]
    forces: Array
    counts: BoolArray


@dataclass(frozen=True, eq=False)
class LeggedFit:
    """A fit of a robot with a floating base, whose motions are in memory.

    Attributes
    ----------
    robot : Robot
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

    robot: Robot
    motions: Sequence[Motion]
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
        return [motion.base for motion in self.motions if motion.base is not None]

    @property
    def are_upright(self) -> bool:
        """Whether all bases have an orientation."""
        return all(base.up is not None for base in self.bases)

    def sure_columns(
        self,
        regress: Callable[[Motion], Regression],
        count: int,
        least: float,
        size: Callable[[Array], Array] = np.abs,
    ) -> list[tuple[int, float, float]]:
        """Return place, value and standard error of further columns that the rows do not refuse.

        The `size` of the value is beyond chance and at least the `least` one that matters.
        """
        columns = stacked([regress(motion) for motion in self.motions]).H
        larger = with_further_columns(
            self.fit,
            np.hstack([self.sensor_errors, columns]),
            lambda values: bool(np.any(size(values[-count:]) > least)),
        )
        if larger is None:
            return []
        values, errors = larger.values[-count:], larger.standard_errors[-count:]
        sure = np.flatnonzero(size(values) > np.maximum(_beyond_chance(larger) * errors, least))
        return list(zip(sure.tolist(), values[sure].tolist(), errors[sure].tolist(), strict=True))


def _beyond_chance(estimate: Estimate) -> float:
    """Return the standard errors of Student's t that are as rare as sure ones of a normal value."""
    freedom = estimate.degrees_of_freedom
    return tol.SURE if freedom is None else float(stdtrit(np.min(freedom), ndtr(tol.SURE)))


def _radius(fit: LeggedFit) -> Iterator[Finding]:
    """Yield a radius of the feet, one for all of them, that the rows of a fit contradict."""
    assert fit.robot.floating_base is not None
    radii = {x.link: x.radius_m for x in fit.robot.floating_base.contacts if not x.is_flat}
    flagged = all(radii.keys() <= base.contacts.keys() for base in fit.bases)
    if len({*radii.values()}) != 1 or not fit.are_upright or not flagged:
        return
    regress = partial(
        radius_rows,
        fit.robot,
        model=fit.model,
        springs=fit.springs,
        theta=fit.theta,
        bodies=fit.bodies,
    )
    for _, change_m, error_m in fit.sure_columns(regress, 1, tol.LENGTH_M):
        radius_m = max(radii.values())
        fitted_m = radius_m + change_m
        if fitted_m > 0:
            yield GEOMETRY.finding(
                f"the feet touch the ground as balls of {1e3 * fitted_m:.3g} mm, with a standard "
                f"error of {1e3 * error_m:.2g} mm, and have {1e3 * radius_m:.3g} mm: the moments "
                "of the contact forces would go into the bodies",
                evidence={"radius [m]": fitted_m, "standard error [m]": error_m},
                remedy=f"load the robot with contacts of radius_m = {fitted_m:.4g}, also if the "
                "foot is larger: a soft one touches nearer to its centre",
            )


def _pushing_feet(fit: LeggedFit) -> Iterator[Finding]:
    """Yield feet that push at the ground before or after their flag, by the rows of a fit."""
    lifts = any(not np.all(flag) for base in fit.bases for flag in base.contacts.values())
    if not lifts or not fit.are_upright or not np.isfinite(fit.mass_kg):
        return
    gravity = np.mean([np.linalg.norm(base.specific_force, axis=1).mean() for base in fit.bases])
    least_N = tol.FEW * fit.mass_kg * float(gravity)
    regress = partial(late_flag_rows, fit.robot, model=fit.model, reach_s=tol.FOOT_TOUCHES_S)
    times = ("before a landing", "after it leaves")
    pushes = fit.sure_columns(regress, len(times), least_N, np.asarray)
    if pushes:
        texts = [f"{value:.2g} +- {error:.1g} N {times[x]}" for x, value, error in pushes]
        yield CONTACT_FLAGS.finding(
            f"a foot pushes at the ground while it is flagged as in the air, with {listed(texts)}, "
            f"fading within {tol.FOOT_TOUCHES_S:g} s: these forces go into the bodies and the "
            "total mass",
            evidence={f"{times[x]} [N]": value for x, value, _ in pushes},
            remedy="flag a foot from the first touch on: lower the threshold of its force (above = "
            "... in the description of the log), or make each flag longer by "
            f"{tol.FOOT_TOUCHES_S:g} s at both ends",
        )


def _sinking_feet(fit: LeggedFit) -> Iterator[Finding]:
    """Yield the sinking of feet under their load, if the heights of standing feet show one."""
    parts = [part for part in (_heights(fit.robot, feet) for feet in fit.loads) if len(part[0])]
    if not parts:
        return
    heights, aside, times, forces = zip(*parts, strict=True)
    y, loads = np.concatenate(heights).T
    H = np.column_stack([loads, block_diag(*aside)])
    H = H[:, np.any(H != 0, axis=0)]
    rows = Regression(
        names=tuple(f"height {place}" for place in range(H.shape[1])),
        units=("",) * H.shape[1],
        H=H,
        y=y,
        joint=np.zeros(len(y)),
        time=np.concatenate(times),
        run=np.repeat(np.arange(len(parts), dtype=float), list(map(len, times))),
        excluded=0,
        propagated=np.empty((len(y), 0)),
    )
    try:
        estimate = ordinary(rows)
    except ExcitationError:  # the load is always the same
        return
    compliance, error = float(estimate.values[0]), float(estimate.standard_errors[0])
    load_N = float(np.concatenate(forces).mean())
    sinking_m = compliance * load_N
    if compliance < _beyond_chance(estimate) * error or sinking_m < tol.LENGTH_M:
        return
    yield SOFT_FEET.finding(
        f"the feet sink in by {1e3 * sinking_m:.2g} mm under their mean load of {load_N:.3g} N, by "
        f"{1e3 * compliance:.3g} +- {1e3 * error:.1g} mm/N: the contact forces act elsewhere than "
        "at rigid feet, which makes the mass some tenths of a per cent wrong, and no standard "
        "error contains that",
        evidence={
            "compliance [m/N]": compliance,
            "standard error [m/N]": error,
            "mean load [N]": load_N,
        },
        remedy="put the robot on hard ground, or harder feet on it; else load it with the radius "
        "of the feet under their mean load (radius_m), or check that the joints do not give way",
    )


def _heights(robot: Robot, feet: LoadedFeet) -> tuple[Array, Array, Array, Array]:
    """Return heights of standing feet about their mean and loads (R, 2), other columns (R, m).

    The last two results are the times (R,), and the loads (R,) themselves. Without an orientation
    the height of a foot over the plane of the others counts.
    """
    motion, base = feet.motion, feet.motion.base
    assert base is not None
    up, fewest = base.up, 2
    if up is None:
        mean, fewest = in_band(motion, base.specific_force), 4
        up = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    places = foot_places(robot, motion.joint_position, feet.links)
    places = smoothed_where(motion, places, feet.counts)
    height, *aside = (np.einsum("tki,ti->tk", places, axis) for axis in (up, *_level(up)))
    load = np.einsum("tki,ti->tk", feet.forces, up)
    counts, k = feet.counts & np.isfinite(height) & np.isfinite(load), len(feet.links)
    # feet have heights of their own, but for the first one
    offsets = np.broadcast_to(np.eye(k)[:, 1:], (*height.shape, k - 1))
    values = np.concatenate([np.stack([height, -load, *aside], axis=2), offsets], axis=2)
    hidden = np.stack([np.ones_like(height), *(aside if base.up is None else ())], axis=2)
    picked = [np.empty((0, values.shape[2] + 2))]
    for pattern in np.unique(counts[np.sum(counts, axis=1) >= fewest], axis=0):
        at = np.ix_(np.flatnonzero(np.all(counts == pattern, axis=1)), np.flatnonzero(pattern))
        inverse = safely(np.linalg.pinv, hidden[at], what="the places of standing feet")
        about_mean = values[at] - hidden[at] @ inverse @ values[at]
        times = np.broadcast_to(motion.time[at[0]], load[at].shape)
        rows = np.concatenate([about_mean, times[:, :, None], load[at][:, :, None]], axis=2)
        picked.append(rows.reshape(-1, rows.shape[2]))
    rows = np.concatenate(picked)
    return rows[:, :2], rows[:, 2:-2], rows[:, -2], rows[:, -1]


def _level(up: Array) -> tuple[Array, Array]:
    """Return two level directions (T, 3) in the frame of the base, as near to its x and y."""
    first = np.cross([0.0, 1.0, 0.0], up)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-9)
    return first, np.cross(up, first)


def mass_findings(
    robot: Robot, motions: Sequence[Motion], mass_kg: float, error_kg: float
) -> Iterator[Finding]:
    """Yield a total mass that no force of the ground can come from, or far from the nominal one.

    `robot` has that of its file. The mass is NaN where it is not determined.
    """
    nominal_kg = float(np.sum((robot.parameters + robot.payload_parameters)[::10]))
    sure_kg = tol.SURE * error_kg
    evidence = {
        "mass [kg]": mass_kg,
        "standard error [kg]": error_kg,
        "robot file [kg]": nominal_kg,
    }
    if mass_kg < -sure_kg:
        yield TOTAL_MASS.finding(
            f"the mass of the whole robot is negative, {mass_kg:.3g} kg",
            severity="wrong",
            evidence=evidence,
            remedy="force sensors have the force of the ground on the robot, and torques act on "
            f"the robot along its joint angles: turn their signs round{_turned_forces(motions)}",
            certainty="certain",
        )
    elif (
        min(mass_kg, nominal_kg) > 0
        and not 1 / tol.TWICE < mass_kg / nominal_kg < tol.TWICE
        and abs(mass_kg - nominal_kg) > sure_kg
    ):
        yield TOTAL_MASS.finding(
            f"the mass of the whole robot is {mass_kg:.3g} kg, {mass_kg / nominal_kg:.2g} of that "
            f"of the robot file, {nominal_kg:.3g} kg",
            evidence=evidence,
            remedy="weigh the robot; is a force sensor or a torque in another unit (1 kgf is 9.81 "
            "N), or does a force act that is not in the log?",
        )


def _turned_forces(motions: Sequence[Motion]) -> str:
    """Return the lines that change the signs of measured forces, "" without any."""
    bases = (motion.base for motion in motions if motion.base is not None)
    sensors = sorted({link for base in bases for link in base.wrenches})
    tables = [f"{toml_table('contacts', x)}\nforce = {{ ..., scale = -1 }}" for x in sensors]
    where = "; in the description of the log, and so for each moment:\n" if sensors else ""
    return where + "\n".join(tables)


FEET_CHECKS = (
    Observation(GEOMETRY, _radius),
    Observation(CONTACT_FLAGS, _pushing_feet),
    Observation(SOFT_FEET, _sinking_feet),
)
"""What the rows of a fit contradict in the feet."""


def force_findings(feet: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Yield feet whose predicted force is not that measured, or pulls at the ground.

    `feet` {link: numbers} are those of `ContactForces.to_dict`, None where they are not known.
    """
    for link, foot in feet.items():
        error, scale = foot["relative_error"], foot["scale"]
        if error is not None and error > tol.RARE:
            yield CONTACT_FORCES.finding(
                f"the measured force at {link} is not that of torques and motion: they differ by "
                f"{error:.0%}, and least with the measured one times {scale:.2g}",
                link,
                evidence={"error": error, "scale": scale},
                remedy="check sign, unit and frame of the force sensor (the force of the ground on "
                "the link, in the frame of the link), and its zero in the air",
            )
        pulled = foot["pulled"]
        if pulled is not None and pulled > tol.FEW:
            least_N, error_N = foot["least_normal"], foot["standard_error"]
            yield CONTACT_FORCES.finding(
                f"{link} would have to pull at the ground: its predicted normal force is clearly "
                f"below zero in {pulled:.0%} of its stance, and is {least_N:.3g} N at least, with "
                f"a standard error of {error_N:.2g} N",
                link,
                evidence={
                    "least normal force [N]": least_N,
                    "standard error [N]": error_N,
                    "share of the stance": pulled,
                },
                remedy="check the flag of this foot, and that nothing else touches or carries the "
                "robot",
            )
