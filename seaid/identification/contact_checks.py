"""Checks of contact flags, and of the order of legs, by the motion of the feet.

A foot on the ground has no velocity: v_b + w x r + J q' = 0. The velocity of the base is that of
the log, else the one at which most standing feet rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, runs
from seaid._files import toml_table
from seaid._progress import Display
from seaid.errors import Finding, LogError, checked, listed
from seaid.log import (
    LEAST_LIFT,
    POSITION_BAND,
    BaseMotion,
    Description,
    Log,
    Motion,
    as_toml,
    meaning_of,
    reconstruct_motion,
)
from seaid.regressor import contact_map
from seaid.robot import FloatingBase, Robot

_RISES_M_S, _SLIDES_M_S, _MOVES_SHARE, _MOVES_S = 0.08, 0.2, 0.01, 0.1
"""Vertical and horizontal speed of a foot that does not stand, and the share of its stance and the
time from which it is said. Of a simulated Go2 that walks and slips a little, feet are faster during
at most 0.4 % of their stance, and with exchanged flags during 8 %."""

_LIFTS_M = 0.015
"""Way up or down without a stop that a foot on the ground does not make, however soft it is."""

_RESTS_M_S, _RESTS_S, _LEVEL_M = 0.05, 0.3, 0.005
"""Vertical speed, duration, and difference in height to the standing feet of a foot that stands."""

_FEWEST = 3
"""Standing feet from which the odd one out has a name, if the log has no velocity of the base."""

_EXCHANGED, _PARTS, _WINS = 0.75, 20, 0.8
"""Flags, or legs, are exchanged if that lowers the speed of standing feet (rms) to this part, and,
in most of the parts of the time, below that in the order of the log and in the next best one. Of a
Go2 that trots on soft feet, which sink in and slip, it falls to 0.12 to 0.53."""

_MOVES_RMS_M_S = 0.03
"""Speed of standing feet in the order of the log below which no other is sought."""

_MOST_LEGS, _JUDGED, _FEWEST_JUDGED = 4, 500, 100
"""Legs whose orders are all tried, and instants by which they are judged, at most and at least."""


def _in_the_air(link: str, motion: Motion) -> tuple[BoolArray, BoolArray]:
    """Return the samples (T,) in which a foot is in the air, and those of them that are used."""
    base = motion.base
    assert base is not None
    is_up = ~base.contacts[link]
    return is_up, is_up & base.used


def unused_lifts(own: FloatingBase, motions: Sequence[Motion]) -> Iterator[Finding]:
    """Yield feet that are in the air too briefly for any of these samples to be used."""
    for link in own.contact_links:
        there = [one for one in motions if one.base is not None and link in one.base.contacts]
        lifts = [_in_the_air(link, one) for one in there]
        if any(np.any(used) for _, used in lifts) or not any(np.any(is_up) for is_up, _ in lifts):
            continue
        pairs = list(zip(lifts, there, strict=True))
        duration = sum(float(is_up.sum()) / one.rate_hz for (is_up, _), one in pairs)
        count = sum(len(runs(is_up)) for is_up, _ in lifts)
        least = max(LEAST_LIFT / (POSITION_BAND * one.cutoff_hz) for one in there)
        yield Finding(
            "unidentifiable",
            f"{link} is in the air for {duration:.2g} s in all, in {count} lifts, which are not "
            "used: next to a change of contact the positions have a corner, and half a period of "
            "the cutoff or less would determine the mass at this foot alone. That mass counts as "
            "not determined",
            link,
            "note",
            {"in the air [s]": duration, "lifts": float(count)},
            f"lift the foot for a second or more, or at least {least:.2g} s at a time",
            "certain",
        )


def contact_findings(robot: Robot, motion: Motion, logs: Sequence[Log]) -> Iterator[Finding]:
    """Yield contacts whose flags the motion contradicts."""
    base = motion.base
    assert base is not None
    assert robot.floating_base is not None
    links = [one for one in robot.floating_base.contact_links if one in base.contacts]
    if not links or not np.any([base.contacts[one] for one in links]):
        return
    order = best_order(robot, motion)
    if order is not None:
        if order.joints != tuple(range(robot.n)):
            yield _legs_finding(robot, logs, order)
        if order.contacts:
            yield _exchange_finding(order.contacts, logs)
        return
    flags = np.column_stack([base.contacts[link] for link in links])
    own = _foot_velocities(robot, motion, links)
    late_s = _lateness(motion, own, flags)
    if late_s is not None:
        yield _late_finding(late_s, links, logs)
        return
    known = base.velocity is not None
    velocity = _relative(own, base.velocity, flags)
    vertical, along = _parts(velocity, base.up)
    judged = base.used & (known | (flags.sum(axis=1) >= _FEWEST))
    for k, link in enumerate(links):
        yield from _moving(link, motion, vertical[:, k], along[:, k], flags[:, k] & judged)
    if base.up is not None:
        yield from _resting(robot, motion, links, flags, vertical, judged)


def _foot_velocities(
    robot: Robot,
    motion: Motion,
    links: Sequence[str],
    some: IndexArray | slice = slice(None),
    order: Sequence[int] | slice = slice(None),
) -> Array:
    """Return the velocities (T, k, 3) of contacts in the base's frame, if its origin is at rest.

    `order` selects the channel of each joint, at some instants.
    """
    base = motion.base
    assert base is not None
    assert robot.floating_base is not None
    points = [replace(robot.floating_base.contact_of(x), is_flat=False) for x in links]
    q, v = (x[some][:, order] for x in (motion.joint_position, motion.joint_velocity))
    up = None if base.up is None else base.up[some]
    J = contact_map(robot, q, points, up).swapaxes(1, 2)[:, :, 3:]
    rates = np.hstack([base.angular_velocity[some], v])
    return np.asarray(np.einsum("tij,tj->ti", J, rates).reshape(len(rates), -1, 3))


def _lateness(motion: Motion, own: Array, flags: BoolArray) -> tuple[float, float, float] | None:
    """Return by how much [s] all flags are late, and the speeds of standing feet now and without.

    None unless other times are clearly better; `own` are the velocities of the feet.
    """
    base = motion.base
    assert base is not None
    rate_hz, most = motion.rate_hz, int(_LATEST_S * motion.rate_hz)
    inside = np.arange(most, len(flags) - most)
    if len(inside) < _FEWEST_JUDGED or np.all(flags == flags[0]):
        return None
    some = inside[np.linspace(0, len(inside) - 1, min(len(inside), 4 * _JUDGED)).astype(int)]
    step = max(round(_LATE_STEP_S * rate_hz), 1)
    squares = {
        shift: _mean_squares(own[some], base, some, flags[some + shift])
        for shift in range(-(most // step) * step, most + 1, step)
    }
    best = min(squares, key=lambda one: float(np.mean(squares[one])))
    speed, now = (float(np.sqrt(np.mean(squares[one]))) for one in (best, 0))
    wins = float(np.mean(squares[best] < squares[0]))
    if abs(best) < 2 * step or now < _MOVES_RMS_M_S or speed > _EXCHANGED * now or wins < _WINS:
        return None
    return best / rate_hz, now, speed


_LATEST_S, _LATE_STEP_S = 0.2, 0.01
"""Largest delay of flags that is sought, and its step; from two steps on it is said."""


def _late_finding(
    found: tuple[float, float, float], links: Sequence[str], logs: Sequence[Log]
) -> Finding:
    late_s, now, speed = found
    described: Mapping[str, Mapping[str, Any]] = {}
    for log in logs:
        described = (log.description or {}).get("contacts", described)
    tables = []
    for link in links:
        source = described.get(link, {}).get("contact", f"{link}.contact")
        whole = dict(source) if isinstance(source, Mapping) else {"columns": source}
        whole["delay_s"] = round(float(whole.get("delay_s", 0.0)) + late_s, 3)
        tables.append(f"{toml_table('contacts', link)}\ncontact = {as_toml(whole)}")
    return Finding(
        "contact-flags",
        f"the flags of the contacts are {'late' if late_s > 0 else 'early'} by about "
        f"{abs(late_s):.2g} s: standing feet move with {now:.2g} m/s (rms), and with {speed:.2g} "
        "m/s without this delay",
        severity="wrong",
        evidence={"delay [s]": late_s, "speed [m/s]": now},
        remedy="\n".join(["in the description of the log:", *tables]),
    )


def _relative(own: Array, velocity: Array | None, flags: BoolArray) -> Array:
    """Return the velocities (T, k, 3) of contacts over the ground."""
    if velocity is None:
        standing = np.where(flags[:, :, None] > 0, own, np.nan)
        standing[~np.any(flags, axis=1)] = 0.0
        velocity = -np.nanmedian(standing, axis=1)
    return np.asarray(own + velocity[:, None])


@dataclass(frozen=True, eq=False, repr=False)
class Order(Display):
    """The order of the joints and of the contacts of a log in which standing feet rest best.

    Attributes
    ----------
    joints : tuple of int
        For each joint of the robot the one whose channels it has to get.
    contacts : mapping {link: link}
        For each contact the one whose flag it has to get.
    speed, speed_as_given : float
        Speed (rms) of the standing feet in this order, and in that of the log [m/s].
    """

    joints: tuple[int, ...]
    contacts: Mapping[str, str]
    speed: float
    speed_as_given: float

    def _in_short(self) -> str:
        return f"standing feet move with {self.speed:.2g} m/s for {self.speed_as_given:.2g}"


def best_order(robot: Robot, motion: Motion) -> Order | None:
    """Return the order of legs and of contact flags in which standing feet rest, None for the own.

    All orders of legs with equal kinds of joints count, also those of logs that have the first
    joints of all legs, then the second ones, and so on; each with all orders of the flags. None
    unless one is clearly better than that of the log and than all others.
    """
    base = motion.base
    assert base is not None
    assert robot.floating_base is not None
    links = [one for one in robot.floating_base.contact_links if one in base.contacts]
    flags = np.column_stack([base.contacts[link] for link in links]) if links else np.empty(0)
    standing = flags.sum(axis=1) if len(links) > 1 else np.zeros(len(base.used))
    used = np.flatnonzero(base.used & (standing >= 2))
    if len(used) < _FEWEST_JUDGED:
        return None
    lifted = used[standing[used] < len(links)]  # all flags are equal while all feet stand
    used = used if len(lifted) < _FEWEST_JUDGED else lifted
    some = used[np.linspace(0, len(used) - 1, min(len(used), _JUDGED)).astype(int)]
    found: list[tuple[Array, list[int], tuple[int, ...]]] = []
    given = tuple(range(len(links)))
    flag_orders = list(permutations(given)) if len(links) <= _MOST_LEGS else [given]
    for order in _orders(_legs(robot, motion, links), robot.n):
        own = _foot_velocities(robot, motion, links, some, order)
        for places in flag_orders:
            squares = _mean_squares(own, base, some, flags[some][:, places])
            found.append((squares, order, places))
            if np.mean(found[0][0]) < _MOVES_RMS_M_S**2:
                return None
    best, second, *_ = sorted(found, key=lambda one: float(np.mean(one[0])))
    squares, order, places = best
    rivals = [found[0][0], second[0]]
    speed, as_given = (float(np.sqrt(np.mean(one))) for one in (squares, rivals[0]))
    if speed > _EXCHANGED * as_given:
        return None
    if any(np.mean(squares <= rival) < _WINS for rival in rivals):
        return None
    exchanged = {links[i]: links[j] for i, j in enumerate(places) if i != j}
    return Order(tuple(order), exchanged, speed, as_given)


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
    given = guess.description
    named = (
        meaning_of(str(one.column), robot.joint_names).joint == joint
        for joint, sources in given.joints.items()
        for one in sources.values()
    )
    if log.base is None or not log.base.contacts or any(named):
        return guess
    start_s = float(log.time[0])
    motion = reconstruct_motion(robot, log.between(start_s, start_s + _ORDERED_S))
    found = best_order(robot, motion)
    if found is None or not set(robot.joint_names) <= set(given.joints):
        return guess
    names = robot.joint_names
    joints = {joint: given.joints[names[j]] for joint, j in zip(names, found.joints, strict=True)}
    contacts = {x: given.contacts[found.contacts.get(x, x)] for x in given.contacts}
    first = [
        str(joints[x]["joint_position"].column) for x in names if "joint_position" in joints[x]
    ]
    text = (
        f"joints, contacts: in the order in which standing feet rest, with {found.speed:.2g} m/s "
        f"(rms), {found.speed_as_given:.2g} m/s in the order of the robot: {', '.join(names)} are "
        f"the columns {', '.join(first)}"
    )
    unsure = [one for one in guess.unsure if "beyond the limits of" not in one]
    return replace(
        guess,
        description=replace(given, joints=joints, contacts=contacts),
        unsure=(text, *unsure),
    )


_ORDERED_S = 20.0
"""Time at the start of a log from which the order of the legs is inferred."""


def _orders(legs: Sequence[IndexArray], n: int) -> Iterator[list[int]]:
    """Yield orders of the joints (n,), first that of the log."""
    yield list(range(n))
    if not 2 <= len(legs) <= _MOST_LEGS:
        return
    for chosen in permutations(range(len(legs))):
        if list(chosen) != list(range(len(legs))):
            order = np.arange(n)
            order[np.concatenate(legs)] = np.concatenate([legs[k] for k in chosen])
            yield order.tolist()
    grouped = np.sort(np.concatenate(legs)).reshape(-1, len(legs))  # a row per kind of joint
    for chosen in permutations(range(len(legs))):
        order = np.arange(n)
        order[np.concatenate(legs)] = np.concatenate([grouped[:, k] for k in chosen])
        yield order.tolist()


def _mean_squares(own: Array, base: BaseMotion, some: IndexArray, flags: BoolArray) -> Array:
    """Return the mean squared speeds of contacts that stand, in successive parts of the time."""
    velocity = None if base.velocity is None else base.velocity[some]
    squares = flags * np.sum(_relative(own, velocity, flags) ** 2, axis=2)
    parts = zip(np.array_split(squares, _PARTS), np.array_split(flags, _PARTS), strict=True)
    return np.array([np.sum(one) / max(np.sum(stand), 1) for one, stand in parts])


def _legs(robot: Robot, motion: Motion, links: Sequence[str]) -> list[IndexArray]:
    """Return the joints of each leg: those that move its contacts alone, of equal kinds."""
    assert robot.floating_base is not None
    points = [replace(robot.floating_base.contact_of(x), is_flat=False) for x in links]
    J = contact_map(robot, motion.joint_position[:1], points)[0, 6:].reshape(robot.n, -1, 3)
    moved = np.any(J != 0.0, axis=2)
    sets = np.unique(moved.T, axis=0)
    legs = [np.flatnonzero(one & (sets.sum(axis=0) == 1)) for one in sets]
    legs = sorted((one for one in legs if len(one)), key=lambda one: int(one[0]))
    kinds = [tuple(np.array(robot.is_prismatic)[leg]) for leg in legs]
    return legs if len(set(kinds)) == 1 else []


def _parts(velocity: Array, up: Array | None) -> tuple[Array, Array]:
    """Return the vertical and the horizontal speeds (T, k), all of it horizontal without `up`."""
    speed = np.linalg.norm(velocity, axis=2)
    if up is None:
        return np.zeros_like(speed), speed
    vertical = np.abs(np.einsum("tki,ti->tk", velocity, up))
    return vertical, np.sqrt(np.maximum(speed**2 - vertical**2, 0.0))


def _legs_finding(robot: Robot, logs: Sequence[Log], found: Order) -> Finding:
    names, tables, pairs = robot.joint_names, [], []
    order = np.array(found.joints)
    for j in np.flatnonzero(order != np.arange(robot.n)):
        joint, other = names[j], names[order[j]]
        pairs.append(f"{joint} by those of {other}")
        sources = {key: source for log in logs for key, source in log.sources()[other].items()}
        tables += [toml_table("joints", joint), *(f"{x} = {as_toml(sources[x])}" for x in sources)]
    return Finding(
        "swapped-joints",
        "legs are exchanged: standing feet move with "
        f"{found.speed_as_given:.2g} m/s (rms), and with {found.speed:.2g} m/s if the channels "
        f"of these joints are meant: {listed(pairs)}",
        names[int(np.argmax(order != np.arange(robot.n)))],
        "wrong",
        remedy="\n".join(["in the description of the log:", *tables]),
    )


def _exchange_finding(exchanged: Mapping[str, str], logs: Sequence[Log]) -> Finding:
    described: Mapping[str, Mapping[str, Any]] = {}
    for log in logs:
        described = (log.description or {}).get("contacts", described)
    tables = []
    for link, other in exchanged.items():
        source = described.get(other, {}).get("contact", f"{other}.contact")
        tables.append(f"{toml_table('contacts', link)}\ncontact = {as_toml(source)}")
    pairs = ", ".join(f"{link} by that of {other}" for link, other in exchanged.items())
    return Finding(
        "contact-flags",
        f"the flags of contacts are exchanged: the feet stand as if that of {pairs} were meant",
        next(iter(exchanged)),
        "wrong",
        remedy="\n".join(["in the description of the log:", *tables]),
    )


def _moving(
    link: str, motion: Motion, vertical: Array, along: Array, standing: BoolArray
) -> Iterator[Finding]:
    """Yield a contact that moves while its flag says that it stands.

    One that moves up or down by less than `_LIFTS_M` may sink into the ground, or be soft.
    """
    rises, slides = standing & (vertical > _RISES_M_S), standing & (along > _SLIDES_M_S)
    for start, end in runs(rises):
        if np.sum(vertical[start:end]) < _LIFTS_M * motion.rate_hz:
            rises[start:end] = False
    total, fewest = max(int(standing.sum()), 1), _MOVES_S * motion.rate_hz
    is_up = motion.base is not None and motion.base.up is not None
    for moving, speed, how, severity in (
        (rises, vertical, "is in the air: it rises and falls", "doubtful"),
        (slides, along, "slips" if is_up else "moves", "note" if is_up else "doubtful"),
    ):
        share = float(moving.sum()) / total
        if share < _MOVES_SHARE or moving.sum() < fewest:
            continue
        rms = float(np.sqrt(np.mean(speed[moving] ** 2)))
        at = float(motion.time[np.argmax(moving)])
        yield Finding(
            "contact-flags",
            f"{link} is flagged as standing and {how}, with {rms:.2g} m/s during {share:.1%} of "
            f"its stance, first at t = {at:.3f} s",
            link,
            severity,  # type: ignore[arg-type]
            {"speed [m/s]": rms, "share of the stance": share},
            "check the threshold and the delay of its flag, or exclude these times (exclude_s of "
            "the description of the log)"
            if severity == "doubtful"
            else "",
        )
        return


def _resting(
    robot: Robot,
    motion: Motion,
    links: Sequence[str],
    flags: BoolArray,
    vertical: Array,
    judged: BoolArray,
) -> Iterator[Finding]:
    """Yield a contact that rests on the level of the others, and its flag says it is in the air."""
    base = motion.base
    assert base is not None
    assert base.up is not None
    height = np.einsum("tki,ti->tk", foot_places(robot, motion.joint_position, links), base.up)
    level = np.nanmedian(np.where(flags, height, np.nan)[np.any(flags, axis=1)], axis=1)
    ground = np.full(len(height), np.nan)
    ground[np.any(flags, axis=1)] = level
    for k, link in enumerate(links):
        rests = judged & ~flags[:, k] & (vertical[:, k] < _RESTS_M_S)
        rests &= np.abs(height[:, k] - ground) < _LEVEL_M
        lasting = [
            (int(end - start)) / motion.rate_hz
            for start, end in runs(rests)
            if end - start > _RESTS_S * motion.rate_hz
        ]
        if not lasting:
            continue
        share = float(np.sum(rests)) / float(np.sum(judged & ~flags[:, k]))
        yield Finding(
            "contact-flags",
            f"{link} is flagged as in the air and rests on the level of the others for "
            f"{max(lasting):.2g} s, {share:.0%} of that time in all: forces on it would go into "
            "the bodies",
            link,
            "wrong" if share > _RESTS_OFTEN else "doubtful",
            {"longest rest [s]": max(lasting), "share": share},
            "check the sign, the threshold and the delay of its flag",
            "likely",
        )


_RESTS_OFTEN = 0.1
"""Share of its time in the air in which a foot rests, from which its flag is wrong."""


def foot_places(robot: Robot, q: Array, links: Sequence[str]) -> Array:
    """Return the places (T, k, 3) of contacts in the frame of the base.

    The moment of a force F at r on the base is r x F: its rows of the contact map have r.
    """
    assert robot.floating_base is not None
    points = [replace(robot.floating_base.contact_of(x), is_flat=False) for x in links]
    A = contact_map(robot, q, points)[:, 3:6].reshape(len(q), 3, -1, 3)
    # the rows of [r]x are (0, -z, y), (z, 0, -x), (-y, x, 0)
    return np.stack([A[:, 2, :, 1], A[:, 0, :, 2], A[:, 1, :, 0]], axis=2)
