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

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import permutations, product, starmap
from typing import Any

import numpy as np
from scipy.special import ndtr, stdtrit

from seaid._arrays import Array, BoolArray, IndexArray, runs, safely
from seaid._files import toml_table
from seaid.checks import CODES
from seaid.checks.codes import Observation, in_description, observed, only_joint
from seaid.checks.engine import Alternative, equation_of
from seaid.checks.tolerances import FEW, MATTERS, MOST, RARE, SURE, TWICE
from seaid.errors import ExcitationError, Finding, listed
from seaid.estimation import Estimate, FittedRows
from seaid.estimation.fitting import with_further_columns
from seaid.estimation.least_squares import ordinary
from seaid.estimation.qr_factor import scaled_svd
from seaid.legged.floating import FloatingRobot, contact_map
from seaid.legged.load_side import late_flag_rows, radius_rows
from seaid.log import Log, Motion, in_band
from seaid.log.base_log import LEAST_LIFT, BaseMotion
from seaid.log.description import changed_source
from seaid.log.motion import POSITION_BAND
from seaid.log.rows import inside_transients
from seaid.regressor import Regression
from seaid.regressor.load import LoadModel
from seaid.regressor.regression import stacked
from seaid.robot import Contact, FloatingBase, Robot

CONTACT_FLAGS = CODES["contact-flags"]
CONTACT_FORCES = CODES["contact-forces"]
GEOMETRY = CODES["geometry"]
SOFT_FEET = CODES["soft-feet"]
SWAPPED_JOINTS = CODES["swapped-joints"]
TOTAL_MASS = CODES["total-mass"]
UNIDENTIFIABLE = CODES["unidentifiable"]

FOOT_RISES_M_S, FOOT_SLIDES_M_S, FOOT_LIFTS_M = 0.08, 0.2, 0.015
"""Vertical and horizontal speed [m/s] of a foot that does not stand, and the way [m] up or down
without a stop that a foot on the ground does not make, however soft it is. Feet of a simulated Go2
that walks and slips a little are faster during at most 0.4 % of their stance, and with exchanged
flags during 8 % (`scripts/benchmarks/legged_findings.py`)."""

FOOT_LEVEL_M, FOOT_REST_S = 0.005, 0.3
"""Difference in height [m] to the standing feet of a foot that stands, and time [s] for which a
foot in the air is not at this height. It is the largest delay of a flag, too."""

FEET_REST_M_S = 0.03
"""Speed [m/s] (rms) of feet on the ground below which no other order of legs is sought."""

FOOT_TOUCHES_S = 0.06
"""Time [s] in which the force of a foot that lands or leaves is less than a threshold of 20 N, on
soft feet of a simulated Go2 that trots (`scripts/benchmarks/legged_findings.py`)."""

LENGTH_M = 0.001
"""Error [m] of the place of a contact that matters: 1 mm is 0.2 % of the mass of a Go2."""

JUDGED_INSTANTS, JUDGED_PARTS, MOST_LEGS = 500, 20, 4
"""Instants at which orders of legs are compared, the parts of the time in which one has to be the
better one, and the legs whose orders are all tried."""

# Before a fit: flags of contacts, and the order of legs


@dataclass(frozen=True, eq=False)
class FeetInMotion:
    """The feet of a robot with a floating base in one motion of its logs."""

    robot: FloatingRobot
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
        flagged = self.base.contacts.keys()
        contacts = (x for x in self.robot.floating_base.contacts if x.link in flagged)
        return [replace(contact, is_flat=False) for contact in contacts]

    @cached_property
    def links(self) -> list[str]:
        """Their links."""
        return [contact.link for contact in self.contacts]

    @cached_property
    def flags(self) -> BoolArray:
        """Whether each contact is flagged as standing (T, k)."""
        flags = np.array([self.base.contacts[link] for link in self.links], dtype=bool)
        return flags.reshape(-1, len(self.motion.time)).T

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
        # J_c^T (T, 6 + n, 3k) -> J_c (T, 3k, 3 + n), without the linear velocity of the base, zero.
        J = contact_map(self.robot, q, self.contacts, up).swapaxes(1, 2)[:, :, 3:]
        rates = np.hstack([base.angular_velocity[some], v])
        return np.asarray(np.einsum("tij,tj->ti", J, rates).reshape(len(rates), -1, 3))

    def over_ground(
        self, velocities: Array, flags: BoolArray, some: IndexArray | slice = slice(None)
    ) -> Array:
        """Return velocities (t, k, 3) of contacts at some instants over the ground.

        The velocity of the base is that of the log, or the one at which most standing feet rest.
        """
        if self.base.velocity is not None:
            return velocities + self.base.velocity[some][:, None]
        # A median, since feet with a wrong flag would move a mean.
        return velocities - _median_of_standing(velocities, flags[:, :, None], 0.0)[:, None]

    def mean_squares(self, velocities: Array, flags: BoolArray, some: IndexArray) -> Array:
        """Return the mean squared speeds of standing feet in successive parts of some instants."""
        squares = flags * np.sum(self.over_ground(velocities, flags, some) ** 2, axis=2)
        parts = (np.array_split(x, JUDGED_PARTS) for x in (squares, flags))
        return np.array(
            [np.sum(x) / max(np.sum(stand), 1) for x, stand in zip(*parts, strict=True)]
        )

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
        velocity = self.over_ground(self.velocities, self.flags)
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

    def channels_of(self, joint: str) -> dict[str, str | Mapping[str, Any]]:
        """Return {quantity: source} of a joint, as the last description has it."""
        sources = (log.sources()[joint] for log in self.logs)
        return {name: x for channels in sources for name, x in channels.items()}


def _median_of_standing(values: Array, flags: BoolArray, of_none: float) -> Array:
    """Return the median of values (T, k, ...) over standing feet, `of_none` where none stands."""
    standing = np.where(flags, values, np.nan)
    standing[~np.any(flags, axis=1).ravel()] = of_none
    return np.asarray(np.nanmedian(standing, axis=1))


def _contradicted_flags(feet: FeetInMotion) -> Iterator[Finding]:
    """Yield contacts, or legs, whose flags the motion contradicts."""
    if not np.any(feet.flags):
        return
    misread = [*_exchanges(feet)] or [*_late(feet)]
    yield from misread
    for k, link in enumerate(feet.links if not misread else ()):
        yield from _moving(feet, k, link)
    if not misread and feet.base.up is not None:
        yield from _resting(feet, feet.base.up)


MOTION_CHECKS = (Observation(CONTACT_FLAGS, _contradicted_flags),)
"""What is looked for in the motion of the feet."""


def _moving(feet: FeetInMotion, k: int, link: str) -> Iterator[Finding]:
    """Yield a contact that moves while its flag says that it stands."""
    vertical, along = (speed[:, k] for speed in feet.speeds)
    standing, has_vertical = feet.flags[:, k] & feet.judged, feet.base.up is not None
    rises, slides = lifted(vertical, standing, feet.motion.rate_hz), along > FOOT_SLIDES_M_S
    for moving, speed, how, is_doubtful in (
        (rises, vertical, "is in the air: it rises and falls", True),
        (slides & standing, along, "slips" if has_vertical else "moves", not has_vertical),
    ):
        share = float(moving.sum()) / max(int(standing.sum()), 1)
        if share >= FEW:
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
    rises = standing & (vertical > FOOT_RISES_M_S)
    for start, end in runs(rises):
        # sum |v_z| / rate is the way up or down.
        if np.sum(vertical[start:end]) < FOOT_LIFTS_M * rate_hz:
            rises[start:end] = False
    return np.asarray(rises)


def _resting(feet: FeetInMotion, up: Array) -> Iterator[Finding]:
    """Yield a contact that rests on the level of the others, and its flag says it is in the air."""
    flags, rate_hz = feet.flags, feet.motion.rate_hz
    places = foot_places(feet.robot, feet.motion.joint_position, feet.links)
    height = np.einsum("tki,ti->tk", places, up)
    apart = np.abs(height - _median_of_standing(height, flags, np.inf)[:, None])
    for k, link in enumerate(feet.links):
        in_air = feet.judged & ~flags[:, k]
        rests_s = np.diff(runs(in_air & (apart[:, k] < FOOT_LEVEL_M)))[:, 0] / rate_hz
        rests_s = rests_s[rests_s > FOOT_REST_S]
        if not len(rests_s):
            continue
        longest_s = float(np.max(rests_s))
        share = float(np.sum(rests_s)) * rate_hz / float(np.sum(in_air))
        yield CONTACT_FLAGS.finding(
            f"{link} is flagged as in the air and rests on the level of the others for "
            f"{longest_s:.2g} s, {share:.0%} of that time in all: forces on it would go into the "
            "bodies",
            link,
            "wrong" if share > RARE else "doubtful",
            {"longest rest [s]": longest_s, "share": share},
            "check the sign, the threshold and the delay of its flag",
        )


def foot_places(robot: FloatingRobot, q: Array, links: Sequence[str]) -> Array:
    """Return the places (T, k, 3) of contacts in the frame of the base.

    The moment of a force F at r on the base is r x F: its rows of the contact map have r.
    """
    points = [replace(robot.floating_base.contact_of(x), is_flat=False) for x in links]
    A = contact_map(robot, q, points)[:, 3:6].reshape(len(q), 3, -1, 3)
    # the rows of [r]x are (0, -z, y), (z, 0, -x), (-y, x, 0)
    return np.stack([A[:, 2, :, 1], A[:, 0, :, 2], A[:, 1, :, 0]], axis=2)


def unused_lifts(base: FloatingBase, motions: Sequence[Motion]) -> Iterator[Finding]:
    """Yield feet that are in the air too briefly for any of these samples to be used."""
    for link in base.contact_links:
        flagged = _flagged(link, motions)
        lifts = [~moved.contacts[link] for _, moved in flagged]
        count = sum(map(len, map(runs, lifts)))
        used = [moved.used for _, moved in flagged]
        if count == 0 or np.any(np.concatenate(used) & np.concatenate(lifts)):
            continue
        rates = np.array([(motion.rate_hz, motion.cutoff_hz) for motion, _ in flagged])
        duration_s = float(np.sum(list(map(np.sum, lifts)) / rates[:, 0]))
        least_s = LEAST_LIFT / (POSITION_BAND * float(np.min(rates[:, 1])))
        yield UNIDENTIFIABLE.note(
            f"{link} is in the air for {duration_s:.2g} s in all, in {count} lifts, which are not "
            "used: next to a change of contact the positions have a corner, and half a period of "
            "the cutoff or less would determine the mass at this foot alone. That mass counts as "
            "not determined",
            link,
            evidence={"in the air [s]": duration_s, "lifts": float(count)},
            remedy=f"lift the foot for a second or more, or at least {least_s:.2g} s at a time",
            certainty="certain",
        )


def _flagged(link: str, motions: Sequence[Motion]) -> list[tuple[Motion, BaseMotion]]:
    """Return the motions that have flags of a contact, and those of their bases."""
    return [(x, x.base) for x in motions if x.base is not None and link in x.base.contacts]


def feet_findings(
    robot: FloatingRobot, logs: Sequence[Log], motions: Sequence[Motion]
) -> list[Finding]:
    """Return what contradicts itself in the contacts of logs, by their motions."""
    findings = []
    for motion in motions:
        findings += observed(MOTION_CHECKS, FeetInMotion(robot, motion, logs))
    lifts = Observation(UNIDENTIFIABLE, partial(unused_lifts, robot.floating_base))
    return findings + observed((lifts,), motions)


# How the channels and flags have to be read


@dataclass(frozen=True, eq=False)
class _Reading:
    """One way to read a log: the order of its joints and of its flags, or the flags with a delay.

    `squares` are the mean squared speeds of standing feet in successive parts of the time, and
    `late` counts samples.
    """

    squares: Array
    joints: Sequence[int] = ()
    flags: Sequence[int] = ()
    late: int = 0

    @property
    def speed(self) -> float:
        """The speed [m/s] (rms) of standing feet."""
        return float(np.sqrt(np.mean(self.squares)))

    def is_slower(self, other: _Reading) -> bool:
        """Whether feet are slower in most parts of the time than in another reading."""
        return bool(np.mean(self.squares <= other.squares) >= 1 - RARE)


def _best_readings(tried: Iterator[_Reading]) -> list[_Reading]:
    """Return the reading of the log, which is the first one tried, the best one and the second.

    None of them unless the best one is clearly better: half of the squared speed of feet that do
    not rest, and less in most of the time.
    """
    as_given = next(tried)
    if as_given.speed < FEET_REST_M_S:
        return []
    ranked = sorted([as_given, *tried], key=lambda reading: reading.speed)
    is_half = ranked[0].speed ** 2 <= MOST * as_given.speed**2
    return [as_given, *ranked[:2]] if is_half and ranked[0].is_slower(as_given) else []


def _spread(places: IndexArray, most: int) -> IndexArray:
    """Return at most `most` of the places, evenly over all."""
    return np.asarray(places[np.linspace(0, len(places) - 1, min(len(places), most)).astype(int)])


def _late(feet: FeetInMotion) -> Iterator[Finding]:
    """Yield that all flags are late, or one is, or early, if standing feet rest at other times."""
    rate_hz, flags = feet.motion.rate_hz, feet.flags
    most = int(FOOT_REST_S * rate_hz)
    inside = np.arange(most, len(flags) - most)
    if len(inside) < JUDGED_PARTS or np.all(flags == flags[0]):
        return
    some, step = _spread(inside, 4 * JUDGED_INSTANTS), max(most // 20, 1)
    velocities, count, links = feet.velocities[some], most // step, range(len(feet.links))

    def shifted(late: int, contacts: Sequence[int]) -> _Reading:
        moved = flags[some]
        moved[:, contacts] = flags[some + late][:, contacts]  # a late flag is right at t + late
        return _Reading(feet.mean_squares(velocities, moved, some), flags=contacts, late=late)

    # No shift comes first: that reading counts as the log's.
    shifts = (step * shift for shift in sorted(range(-count, count + 1), key=abs))
    readings = _best_readings(starmap(shifted, product(shifts, [links, *([k] for k in links)])))
    if not readings or abs(readings[1].late) < 2 * step:
        return
    yield _late_flags(feet, readings[0].speed, readings[1])


def _late_flags(feet: FeetInMotion, now: float, best: _Reading) -> Finding:
    """Return the finding of flags that are late as in the `best` reading; `now` is a speed."""
    late_s, late = float(best.late / feet.motion.rate_hz), [feet.links[k] for k in best.flags]
    sources = {}
    for link in late:
        source = feet.source_of(link)
        whole = source if isinstance(source, Mapping) else {"columns": source}
        sources[link] = {"contact": changed_source(whole, delay_s=round(late_s, 3))}
    return CONTACT_FLAGS.wrong(
        f"the {f'flag of {late[0]} is' if len(late) == 1 else 'flags of the contacts are'} "
        f"{'late' if late_s > 0 else 'early'} by about "
        f"{abs(late_s):.2g} s: standing feet move with {now:.2g} m/s (rms), and with "
        f"{best.speed:.2g} m/s without this delay",
        only_joint(late),
        evidence={"delay [s]": late_s, "speed [m/s]": now},
        remedy=in_description(sources, table="contacts"),
    )


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
    if len(used) < JUDGED_PARTS:
        return None
    differing = used[standing[used] < len(links)]  # all flags are equal while all feet stand
    used = used if len(differing) < JUDGED_PARTS else differing
    readings = _best_readings(_tried_orders(feet, _spread(used, JUDGED_INSTANTS)))
    if not readings or not readings[1].is_slower(readings[2]):
        return None
    as_given, best, _ = readings
    exchanged = {links[i]: links[j] for i, j in enumerate(best.flags) if i != j}
    return LegOrder(tuple(best.joints), exchanged, best.speed, as_given.speed)


def _tried_orders(feet: FeetInMotion, some: IndexArray) -> Iterator[_Reading]:
    """Yield the readings by each order of joints and of flags, first that of the log."""
    as_given = tuple(range(len(feet.links)))
    flag_orders = [*permutations(as_given)] if len(as_given) <= MOST_LEGS else [as_given]
    for joints in _orders(_legs(feet), feet.robot.n):
        velocities = feet.velocities_at(some, joints)
        for order in flag_orders:
            squares = feet.mean_squares(velocities, feet.flags[some][:, order], some)
            yield _Reading(squares, joints, order)


def _orders(legs: Sequence[IndexArray], n: int) -> Iterator[list[int]]:
    """Yield orders of the joints (n,), first that of the log."""
    as_given = list(range(n))
    yield as_given
    if not 2 <= len(legs) <= MOST_LEGS:
        return
    joints = np.concatenate(legs)
    grouped = np.sort(joints).reshape(-1, len(legs)).T  # a row per leg, a column per kind of joint
    for places in permutations(range(len(legs))):
        for by_leg in (legs, grouped):
            order = np.arange(n)
            order[joints] = np.concatenate([by_leg[k] for k in places])
            if order.tolist() != as_given:
                yield order.tolist()


def _legs(feet: FeetInMotion) -> list[IndexArray]:
    """Return the joints of each leg: those that move its contacts alone, of equal kinds."""
    robot = feet.robot
    J = contact_map(robot, feet.motion.joint_position[:1], feet.contacts)[0, 6:]
    moved = np.any(J.reshape(robot.n, -1, 3) != 0.0, axis=2)
    sets = np.unique(moved.T, axis=0)
    # Joints of a torso move the contacts of several legs, and are in none.
    legs = [np.flatnonzero(moving & (sets.sum(axis=0) == 1)) for moving in sets]
    legs = sorted((leg for leg in legs if len(leg)), key=lambda leg: int(leg[0]))
    kinds = {tuple(np.array(robot.is_prismatic)[leg]) for leg in legs}
    return legs if len(kinds) == 1 else []


def _exchanges(feet: FeetInMotion) -> Iterator[Finding]:
    """Yield legs that are exchanged, and flags."""
    order, names = best_order(feet), feet.robot.joint_names
    if order is None:
        return
    moved = {names[j]: names[source] for j, source in enumerate(order.joints) if j != source}
    if moved:
        yield SWAPPED_JOINTS.wrong(
            f"legs are exchanged: standing feet move with {order.speed_as_given:.2g} m/s (rms), "
            f"and with {order.speed:.2g} m/s if the channels of these joints are meant: "
            f"{listed(f'{joint} by those of {source}' for joint, source in moved.items())}",
            next(iter(moved)),
            remedy=in_description({x: feet.channels_of(source) for x, source in moved.items()}),
        )
    if order.contacts:
        exchanged = ", ".join(f"{link} by that of {x}" for link, x in order.contacts.items())
        flags = {x: {"contact": feet.source_of(y)} for x, y in order.contacts.items()}
        yield CONTACT_FLAGS.wrong(
            f"the flags of contacts are exchanged: the feet stand as if that of {exchanged} were "
            "meant",
            next(iter(order.contacts)),
            remedy=in_description(flags, table="contacts"),
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
    def weight_N(self) -> float:
        """The weight of the robot, NaN where its mass is not determined."""
        # The specific force of a base that comes to rest again is about g on average.
        forces = [np.linalg.norm(base.specific_force, axis=1).mean() for base in self.bases]
        return self.mass_kg * float(np.mean(forces))

    def sure_columns(
        self, regress: Callable[[Motion], Regression], names: Sequence[str], least: float
    ) -> list[tuple[str, float, float, float]]:
        """Return name, value, standard error and share of further columns that the rows show.

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
        acts, after = (
            np.any(columns != 0, axis=1),
            known.with_alternatives([Alternative(columns, 0)]),
        )
        share = 1 - after.squares(acts) / max(known.squares(acts), 1e-300)
        named = zip(names, values.tolist(), errors.tolist(), strict=True)
        return [(*column, share) for column, is_sure in zip(named, sure, strict=True) if is_sure]


def _beyond_chance(estimate: Estimate) -> float:
    """Return the standard errors of Student's t that are as rare as sure ones of a normal value."""
    freedom = estimate.degrees_of_freedom
    return SURE if freedom is None else float(stdtrit(np.min(freedom), ndtr(SURE)))


def _radius(fit: LeggedFit) -> Iterator[Finding]:
    """Yield a radius of the feet, one for all of them, that the rows of a fit contradict.

    A ball that would reach the joint above it is none: something else is in its moments.
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

    for _, change_m, error_m, share in fit.sure_columns(regress, ("radius",), LENGTH_M):
        radius_m = max(radii.values())
        fitted_m = radius_m + change_m
        if 0 < fitted_m < largest_m:
            yield GEOMETRY.finding(
                f"the feet touch the ground as balls of {1e3 * fitted_m:.3g} mm, with a standard "
                f"error of {1e3 * error_m:.2g} mm, and have {1e3 * radius_m:.3g} mm: the moments "
                f"of the contact forces would go into the bodies; that explains {share:.0%} of the "
                "squared residual",
                severity="doubtful" if share >= MATTERS else "note",
                evidence={
                    "radius [m]": fitted_m,
                    "standard error [m]": error_m,
                    "explained": share,
                },
                remedy=f"load the robot with contacts of radius_m = {fitted_m:.4g}, also if the "
                "foot is larger: a soft one touches nearer to its centre",
            )


def _pushing_feet(fit: LeggedFit) -> Iterator[Finding]:
    """Yield feet that push at the ground before or after their flag, by the rows of a fit."""
    flags = (flag for base in fit.bases for flag in base.contacts.values())
    if all(map(np.all, flags)) or not np.isfinite(fit.mass_kg):
        return
    regress = partial(late_flag_rows, fit.robot, model=fit.model, reach_s=FOOT_TOUCHES_S)
    times, least_N = ("before a landing", "after it leaves"), FEW * fit.weight_N
    pushes = [push for push in fit.sure_columns(regress, times, least_N) if push[1] > 0]
    if pushes:
        texts = [f"{value:.2g} +- {error:.1g} N {when}" for when, value, error, _ in pushes]
        yield CONTACT_FLAGS.finding(
            f"a foot pushes at the ground while it is flagged as in the air, with {listed(texts)}, "
            f"fading within {FOOT_TOUCHES_S:g} s: these forces go into the bodies and the "
            "total mass",
            evidence={f"{when} [N]": value for when, value, *_ in pushes},
            remedy="flag a foot from the first touch on: lower the threshold of its force (above = "
            "... in the description of the log), or make each flag longer by "
            f"{FOOT_TOUCHES_S:g} s at both ends",
        )


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
    yield SOFT_FEET.finding(
        f"the feet sink in by {1e3 * sinking_m:.2g} mm under their mean load of {load_N:.3g} N, by "
        f"{1e3 * compliance:.3g} +- {1e3 * error:.1g} mm/N: the contact forces act elsewhere than "
        "at rigid feet, which makes the mass some tenths of a per cent wrong, and no standard "
        "error contains that",
        evidence={**evidence, "mean load [N]": load_N},
        remedy="put the robot on hard ground, or harder feet on it; else load it with the radius "
        "of the feet under their mean load (radius_m), or check that the joints do not give way",
    )


def _heights(robot: FloatingRobot, feet: LoadedFeet) -> tuple[Regression, Array] | None:
    """Return the heights of standing feet as rows of their load, and the loads (R,); None without.

    Both are about the mean of the feet, and less what their own heights and the slope of the ground
    explain (Frisch and Waugh 1933). Without an orientation the height of a foot over the plane of
    the others counts.
    """
    motion, base = feet.motion, feet.motion.base
    assert base is not None
    up = _upwards(motion, base)
    # Two feet have a difference in height. A plane goes through any three: it needs a fourth.
    fewest = 4 if base.up is None else 2
    places = foot_places(robot, motion.joint_position, feet.links)
    places = smoothed_where(motion, places, feet.counts)
    height, *aside = (np.einsum("tki,ti->tk", places, axis) for axis in (up, *_level(up)))
    load = np.einsum("tki,ti->tk", feet.forces, up)
    counts, k = feet.counts & np.isfinite(height) & np.isfinite(load), len(feet.links)
    # feet have heights of their own, but for the first one
    offsets = np.broadcast_to(np.eye(k)[:, 1:], (*height.shape, k - 1))
    # h_k = c_0(t) + offset_k + slope . (x_k, y_k) - c N_k: the column of the compliance c is -N_k.
    values = np.concatenate([np.stack([height, -load, *aside], axis=2), offsets], axis=2)
    hidden = np.stack([np.ones_like(height), *(aside if base.up is None else ())], axis=2)
    about_mean = np.full_like(values, np.nan)
    for pattern in np.unique(counts[np.sum(counts, axis=1) >= fewest], axis=0):
        at = np.ix_(np.flatnonzero(np.all(counts == pattern, axis=1)), np.flatnonzero(pattern))
        inverse = safely(np.linalg.pinv, hidden[at], what="the places of standing feet")
        # (t, feet, columns) at all instants with the same standing feet: at each one less what the
        # height of the base, or the plane of the feet, explains.
        about_mean[at] = values[at] - hidden[at] @ inverse @ values[at]
    rows = np.isfinite(about_mean[:, :, 0])
    if not np.any(rows):
        return None
    pairs, columns = np.split(about_mean[rows], [2], axis=1)
    span = scaled_svd(columns).span()
    y, H = (pairs - span @ (span.T @ pairs)).T
    regression = Regression(
        names=("compliance",),
        units=("m/N",),
        H=H[:, None],
        y=y,
        joint=np.zeros(len(y)),
        time=motion.time[np.nonzero(rows)[0]],
        run=np.zeros(len(y)),
        excluded=0,
        propagated=np.empty((len(y), 0)),
    )
    return regression, load[rows]


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


def mass_findings(
    robot: Robot, motions: Sequence[Motion], mass_kg: float, error_kg: float
) -> Iterator[Finding]:
    """Yield a total mass that no force of the ground can come from, or far from the nominal one.

    `robot` has that of its file. The mass is NaN where it is not determined.
    """
    nominal_kg = float(np.sum((robot.parameters + robot.payload_parameters)[::10]))
    sure_kg, ratio = SURE * error_kg, mass_kg / nominal_kg if nominal_kg > 0 else 1.0
    evidence = {"mass [kg]": mass_kg, "standard error [kg]": error_kg}
    evidence["robot file [kg]"] = nominal_kg
    if mass_kg < -sure_kg:
        yield TOTAL_MASS.wrong(
            f"the mass of the whole robot is negative, {mass_kg:.3g} kg",
            evidence=evidence,
            remedy="force sensors have the force of the ground on the robot, and torques act on "
            f"the robot along its joint angles: turn their signs round{_turned_forces(motions)}",
            certainty="certain",
        )
    elif mass_kg > 0 and not 1 / TWICE < ratio < TWICE and abs(mass_kg - nominal_kg) > sure_kg:
        yield TOTAL_MASS.finding(
            f"the mass of the whole robot is {mass_kg:.3g} kg, {ratio:.2g} of that "
            f"of the robot file, {nominal_kg:.3g} kg",
            evidence=evidence,
            remedy="weigh the robot; is a force sensor or a torque in another unit (1 kgf is 9.81 "
            "N), or does a force act that is not in the log?",
        )


def _turned_forces(motions: Sequence[Motion]) -> str:
    """Return the lines that change the signs of measured forces, "" without any."""
    bases = (motion.base for motion in motions if motion.base is not None)
    sensors = sorted({link for base in bases for link in base.wrenches})
    lines = [f"{toml_table('contacts', link)}\nforce = {{ ..., scale = -1 }}" for link in sensors]
    header = "; in the description of the log, and so for each moment:"
    return "\n".join([header, *lines]) if sensors else ""


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
        if error is not None and error > RARE:
            yield CONTACT_FORCES.finding(
                f"the measured force at {link} is not that of torques and motion: they differ by "
                f"{error:.0%}, and least with the measured one times {scale:.2g}",
                link,
                evidence={"error": error, "scale": scale},
                remedy="check sign, unit and frame of the force sensor (the force of the ground on "
                "the link, in the frame of the link), and its zero in the air",
            )
        pulled = foot["pulled"]
        if pulled is not None and pulled > FEW:
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
"""Least part of the low pass of a sample that counting samples have: at a boundary it is a half."""
