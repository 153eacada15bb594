"""Feet of a legged robot in a log, before a fit: flags, the order of legs, and when feet stand.

A foot on the ground has no velocity: v_b + w x r + J q' = 0. The velocity of the base is that of
the log, else the one at which most standing feet rest. This checks flags and legs, and
`with_leg_order` takes the order of legs and flags in which standing feet rest.

`find_contacts` computes the forces of the ground with the bodies of the robot file, where a log
does not have when feet stand. What a fit has of its feet is in `seaid.legged.contacts`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations, product, starmap
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, runs, safely
from seaid._progress import Display, counted
from seaid.checks import CODES
from seaid.checks.codes import in_description, only_joint
from seaid.checks.engine import Check, observed
from seaid.checks.tolerances import FEW, MOST, RARE
from seaid.errors import Finding, IdentificationError, LogError, checked, listed
from seaid.legged.floating import FloatingRobot, base_of, contact_map, floating_regressor, guided
from seaid.log import (
    FOUND_CONTACT,
    Description,
    Log,
    LogDescription,
    Motion,
    Repair,
    low_pass,
    reconstruct_motion,
)
from seaid.log.base_log import LEAST_LIFT, BaseMotion
from seaid.log.describe.inference import Doubt
from seaid.log.describe.names import meaning_of
from seaid.log.description import changed_source
from seaid.log.motion import POSITION_BAND
from seaid.robot import Contact, FloatingBase, Robot, torques_at_joints

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

JUDGED_INSTANTS, JUDGED_PARTS, MOST_LEGS = 500, 20, 4
"""Instants at which orders of legs are compared, the parts of the time in which one has to be the
better one, and the legs whose orders are all tried."""


@dataclass(frozen=True, eq=False)
class FeetInMotion:
    """The feet of a robot with a floating base in one motion of its logs."""

    robot: FloatingRobot
    motion: Motion
    logs: Sequence[Log]

    @property
    def base(self) -> BaseMotion:
        """The motion of the base."""
        return base_of(self.motion)

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
    """Yield exchanged flags or legs, else late flags, else single contacts.

    Each explains those after it. A new check of flags belongs here, not in `MOTION_CHECKS`.
    """
    if not np.any(feet.flags):
        return
    misread = [*_exchanges(feet)] or [*_late(feet)]
    yield from misread
    for k, link in enumerate(feet.links if not misread else ()):
        yield from _moving(feet, k, link)
    if not misread and feet.base.up is not None:
        yield from _resting(feet, feet.base.up)


MOTION_CHECKS = (Check(CODES["contact-flags"], (), _contradicted_flags),)
"""What is looked for in the motion of the feet."""


def _moving(feet: FeetInMotion, k: int, link: str) -> Iterator[Finding]:
    """Yield a contact that moves while its flag says that it stands."""
    vertical, horizontal = (speed[:, k] for speed in feet.speeds)
    standing, has_vertical = feet.flags[:, k] & feet.judged, feet.base.up is not None
    rises, slides = lifted(vertical, standing, feet.motion.rate_hz), horizontal > FOOT_SLIDES_M_S
    for moving, speed, how, is_doubtful in (
        (rises, vertical, "is in the air: it rises and falls", True),
        (slides & standing, horizontal, "slips" if has_vertical else "moves", not has_vertical),
    ):
        share = float(moving.sum()) / max(int(standing.sum()), 1)
        if share >= FEW:
            rms = float(np.sqrt(np.mean(speed[moving] ** 2)))
            evidence = {"speed [m/s]": rms, "share of the stance": share, "link": link, "how": how}
            evidence["at"] = f"{feet.motion.time[np.argmax(moving)]:.3f}"
            case = "standing" if is_doubtful else "slipping"
            yield CODES["contact-flags"].finding(case, link, evidence)
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
        evidence = {"longest rest [s]": longest_s, "share": share, "link": link}
        yield CODES["contact-flags"].finding("rests", link, evidence, is_worse=share > RARE)


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
        # The motions that have flags of the contact, and those of their bases.
        flagged = [(x, base_of(x)) for x in motions if link in base_of(x).contacts]
        lifts = [~base_motion.contacts[link] for _, base_motion in flagged]
        count = sum(map(len, map(runs, lifts)))
        used = [base_motion.used for _, base_motion in flagged]
        if count == 0 or np.any(np.concatenate(used) & np.concatenate(lifts)):
            continue
        rates = np.array([(motion.rate_hz, motion.cutoff_hz) for motion, _ in flagged])
        duration_s = float(np.sum(list(map(np.sum, lifts)) / rates[:, 0]))
        least_s = LEAST_LIFT / (POSITION_BAND * float(np.min(rates[:, 1])))
        evidence = {"in the air [s]": duration_s, "lifts": float(count), "link": link}
        words = {"times": counted(count, "lift"), "least": f"{least_s:.2g}"}
        yield CODES["unidentifiable"].finding("lifts", link, {**evidence, **words})


LIFT_CHECKS = (Check(CODES["unidentifiable"], (), unused_lifts),)
"""What is looked for in the lifts of feet."""


def feet_findings(
    robot: FloatingRobot, logs: Sequence[Log], motions: Sequence[Motion]
) -> list[Finding]:
    """Return what contradicts itself in the contacts of logs, by their motions."""
    findings = []
    for motion in motions:
        findings += observed(MOTION_CHECKS, FeetInMotion(robot, motion, logs))
    return findings + observed(LIFT_CHECKS, robot.floating_base, motions)


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


def _late_flags(feet: FeetInMotion, speed_as_given: float, best: _Reading) -> Finding:
    """Return the finding of flags that are late as in the `best` reading."""
    late_s, late = float(best.late / feet.motion.rate_hz), [feet.links[k] for k in best.flags]
    sources = {}
    for link in late:
        source = feet.source_of(link)
        whole = source if isinstance(source, Mapping) else {"columns": source}
        sources[link] = {"contact": changed_source(whole, delay_s=round(late_s, 3))}
    words = {"flags": f"flag of {late[0]} is" if len(late) == 1 else "flags of the contacts are"}
    words |= {"late": "late" if late_s > 0 else "early", "right": f"{best.speed:.2g}"}
    evidence = {"delay [s]": late_s, "speed [m/s]": speed_as_given, **words}
    lines = in_description(sources, table="contacts")
    return CODES["contact-flags"].finding("late", only_joint(late), evidence, lines)


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
    """Return the order of legs and flags in which standing feet rest, None if the log's is best.

    All orders of legs with equal kinds of joints count, also those of logs that have the first
    joints of all legs, then the second ones, and so on; each with all orders of the flags. None
    unless one is clearly better than that of the log and than all others.
    """
    links, standing = feet.links, feet.flags.sum(axis=1)
    # A biped that walks has one foot on the ground at a time.
    used = np.flatnonzero(feet.base.used & (standing >= min(2, len(links) - 1)))
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
        pairs = listed(f"{joint} by those of {source}" for joint, source in moved.items())
        words = {"given": f"{order.speed_as_given:.2g}", "right": f"{order.speed:.2g}"}
        lines = in_description({x: feet.channels_of(source) for x, source in moved.items()})
        of_legs = "legs", next(iter(moved)), {**words, "pairs": pairs}, lines
        yield CODES["swapped-joints"].finding(*of_legs)
    if order.contacts:
        exchanged = ", ".join(f"{link} by that of {x}" for link, x in order.contacts.items())
        flags = {x: {"contact": feet.source_of(y)} for x, y in order.contacts.items()}
        lines, words = in_description(flags, table="contacts"), {"pairs": exchanged}
        yield CODES["contact-flags"].finding("exchanged", next(iter(order.contacts)), words, lines)


# Contacts that a log does not have: from its torques, with the bodies of the robot file

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
    base, bodies = base_of(motion), robot.parameters + robot.payload_parameters
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
