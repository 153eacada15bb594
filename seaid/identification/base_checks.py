"""Checks of a floating base before any fit: sensors, frames, and flags against the motion of feet.

A foot on the ground has no velocity: v_b + w x r + J q' = 0. The velocity of the base is that of
the log, else the one at which most standing feet rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from operator import itemgetter
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from seaid._arrays import Array, BoolArray, IndexArray, is_constant, runs
from seaid._files import toml_table
from seaid.errors import Finding, listed
from seaid.log import (
    CHANNELS,
    LEAST_LIFT,
    POSITION_BAND,
    BaseLog,
    BaseMotion,
    Log,
    Motion,
    as_toml,
    base_jumps,
    column_names,
    low_pass,
    needed_columns,
    quaternion_rates,
    turned_to_world,
)
from seaid.regressor import contact_map
from seaid.robot import FloatingBase, Robot

_RISES_M_S, _SLIDES_M_S, _MOVES_SHARE, _MOVES_S = 0.08, 0.2, 0.01, 0.1
"""Vertical and horizontal speed of a foot that does not stand, and the share of its stance and the
time from which it is said. Of a simulated Go2 that walks and slips a little, feet are faster during
at most 0.4 % of their stance, and with exchanged flags during 8 %."""

_RESTS_M_S, _RESTS_S, _LEVEL_M = 0.05, 0.3, 0.005
"""Vertical speed, duration, and difference in height to the standing feet of a foot that stands."""

_FEWEST = 3
"""Standing feet from which the odd one out has a name, if the log has no velocity of the base."""

_EXCHANGED = 0.5
"""Flags, or legs, are exchanged if that lowers the share of the stance in which feet move to this
part; the other orders of legs must be as much worse."""

_MOST_LEGS, _JUDGED = 4, 1000
"""Legs whose orders are all tried, and instants by which they are judged."""

_OFF, _BETTER = 0.002, 5.0
"""One less the correlation of the gyroscope with the change of orientation from which they
contradict each other, if another frame or order is so many times better."""

_UNRELATED = 0.5
"""Correlation below which they contradict each other without an explanation."""


def base_findings(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Sequence[Motion]]
) -> list[Finding]:
    """Return what contradicts itself in the base and the contacts of logs, and their motions."""
    if robot.floating_base is None:
        return []
    own = robot.floating_base
    found = [one for log in logs if log.base is not None for one in _sensors(log.base, log, own)]
    if not any(one.severity == "wrong" for one in found):
        every = [one for each in motions for one in each]
        for motion in every:
            found += list(_contacts(robot, motion, logs))
        found += list(_unused_lifts(own, every))
    return found


def _in_the_air(link: str, motion: Motion) -> tuple[BoolArray, BoolArray]:
    """Return the samples (T,) in which a foot is in the air, and those of them that are used."""
    base = motion.base
    assert base is not None
    is_up = ~base.contacts[link]
    return is_up, is_up & base.used


def _unused_lifts(own: FloatingBase, motions: Sequence[Motion]) -> Iterator[Finding]:
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


def with_brief_lifts(
    finding: Finding, robot: Robot, motions: Sequence[Sequence[Motion]]
) -> Finding:
    """Return a `few-rows` finding with the feet that are in the air in one part of the logs only.

    No other part determines the mass at such a foot, by which excluded blocks are off.
    """
    if finding.code != "few-rows" or robot.floating_base is None:
        return finding
    every = [one for each in motions for one in each if one.base is not None]
    total, texts = sum(len(one.time) for one in every), []
    for link in robot.floating_base.contact_links:
        start, places = 0, []
        for one in every:
            if one.base is not None and link in one.base.contacts:
                places.append(start + np.flatnonzero(_in_the_air(link, one)[1]))
            start += len(one.time)
        up = np.concatenate([np.empty(0, dtype=int), *places])
        if len(up) and up[-1] - up[0] < _ONE_PART * total:
            texts.append(f"{link} ({len(up) / every[0].rate_hz:.2g} s)")
    if not texts:
        return finding
    return replace(
        finding,
        message=f"{finding.message}; in the air in one part of the logs only, which alone "
        f"determines the mass at the foot: {', '.join(texts)}",
        remedy="lift each foot several times, spread over the log, or never",
    )


_ONE_PART = 1 / 8
"""Part of the logs: one of the blocks that are excluded in turn."""


def _sensors(base: BaseLog, log: Log, own: FloatingBase) -> Iterator[Finding]:
    """Yield dead axes, frames that contradict each other, and jumps of a pose."""
    imu = own.imu_placement[0]
    for name in ("angular_velocity", "specific_force"):
        values, needed = getattr(base, name), needed_columns(own, name)
        columns = zip("xyz", CHANNELS[name], () if values is None else values.T, strict=False)
        for axis, whole_name, column in columns:
            if whole_name in needed and is_constant(column):
                yield Finding(
                    "base-sensor",
                    f"the {axis} axis of the {name.replace('_', ' ')} of the base is "
                    f"{column[0]:.4g} all the time: it is missing",
                    severity="wrong",
                    evidence={"value": float(column[0])},
                    remedy="log all three axes, or give orientation with velocity or position",
                    certainty="certain",
                )
    if own.imu_is_fixed:
        yield from _frames(base, log.time, imu)
        yield from _plane(base, own)
    for name, (count, largest, first_s) in base_jumps(base, log.time).items():
        unit = {"position": " m", "velocity": " m/s"}.get(name, " rad")
        yield Finding(
            "base-jumps",
            f"the {name} of the base jumps {count} times, by up to {largest:.3g}{unit}, first at t "
            f"= {first_s:.4g} s, as a state estimator does that corrects itself: the jumps were "
            "taken out, and samples near them are not used",
            severity="note",
            evidence={"jumps": float(count), "largest": largest},
            remedy="log the IMU, which does not jump",
            certainty="certain",
        )


_LEAVES = 0.2
"""Rate about the axes in its plane over that about its normal, from which a base leaves its plane.
A guide with play and an IMU that is mounted askew have a few hundredths."""


def _plane(base: BaseLog, own: FloatingBase) -> Iterator[Finding]:
    """Yield a planar base that turns out of its plane."""
    if own.normal is None or base.angular_velocity is None:
        return
    w = base.angular_velocity @ own.imu_placement[0].T
    about = w @ np.array(own.normal)
    size, out = (
        float(np.std(about)),
        float(np.linalg.norm(np.std(w @ (np.eye(3) - own.turning), 0))),
    )
    if out > max(_LEAVES * size, _TURNS_RAD_S):
        yield Finding(
            "base-frames",
            f"the base turns with {out:.2g} rad/s (rms) about the axes in its plane and with "
            f"{size:.2g} rad/s about the normal: it does not move in this plane",
            severity="wrong",
            evidence={"out of the plane [rad/s]": out, "in the plane [rad/s]": size},
            remedy="load the robot with base='floating', or with the plane in which it moves",
        )


def _frames(base: BaseLog, time: Array, imu: Array) -> Iterator[Finding]:
    """Yield an orientation that the angular velocity, or gravity, contradicts."""
    if base.orientation is None:
        return
    if base.angular_velocity is not None:
        yield from _turning(base.orientation, base.angular_velocity @ imu.T, time)
    if base.specific_force is not None:
        mean = turned_to_world(base.orientation, base.specific_force @ imu.T).mean(axis=0)
        if mean[2] < -0.5 * np.linalg.norm(mean):
            yield Finding(
                "base-frames",
                "the specific force of the base points downwards: an accelerometer at rest "
                "measures 9.81 m/s^2 upwards",
                severity="wrong",
                evidence={"mean upwards [m/s^2]": float(mean[2])},
                remedy="in the description of the log:\n[base]\nspecific_force = "
                '{ columns = ["...", "...", "..."], scale = -1 }',
            )


def _turning(orientation: Array, w: Array, time: Array) -> Iterator[Finding]:
    """Yield the order or frame that makes the gyroscope the change of the orientation."""
    w, orientation = (_smooth(x, time) for x in (w, orientation))
    w_there = turned_to_world(orientation, w, back=True)
    readings = {
        'angular_velocity is in the frame of the world: frame = "world"': (orientation, w_there),
        'the quaternion is x, y, z, w: order = "xyzw"': (orientation[:, [3, 0, 1, 2]], w),
        "the quaternion turns from the world to the base: change the signs of x, y, z": (
            orientation * [1, -1, -1, -1],
            w,
        ),
    }
    own = quaternion_rates(orientation, time)
    if float(np.std(own)) < _TURNS_RAD_S:
        return
    now = _alike(own, w)
    scores = {x: _alike(quaternion_rates(p, time), y) for x, (p, y) in readings.items()}
    best = max(scores, key=scores.__getitem__)
    text = "the angular velocity contradicts the orientation: "
    if 1 - now > max(_OFF, _BETTER * (1 - scores[best])):
        yield _frame_finding(text + best, now, _BY_SAMPLES)
    elif now < _UNRELATED:
        yield _frame_finding(text + "order, frame, or times are other ones", now, _BY_SAMPLES)
    elif 0.8 < np.sum(own * w) / np.sum(w * w) / np.radians(1.0) < 1.2:
        yield _frame_finding("the angular velocity is in degrees per second", now, _IN_DEGREES)


_TURNS_RAD_S, _COMPARED_HZ = 0.05, 5.0
"""Angular velocity (rms) from which a base turns, and the low pass for its comparison."""

_IN_DEGREES = (
    "in the description of the log:\n[base]\nangular_velocity = "
    '{ columns = ["...", "...", "..."], scale = 0.0174533 }'
)
_BY_SAMPLES = (
    "name order and frame in [base] of the description of the log; seaid describe decides both by "
    "the samples"
)


def _smooth(values: Array, time: Array) -> Array:
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    return low_pass(values, rate_hz, min(_COMPARED_HZ, 0.4 * rate_hz))


def _frame_finding(text: str, alike: float, remedy: str) -> Finding:
    return Finding(
        "base-frames", text, severity="wrong", evidence={"correlation": alike}, remedy=remedy
    )


def _alike(one: Array, other: Array) -> float:
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.sum(one * other)) / size if size > 0 else 0.0


def _contacts(robot: Robot, motion: Motion, logs: Sequence[Log]) -> Iterator[Finding]:
    """Yield contacts whose flags the motion contradicts."""
    base = motion.base
    assert base is not None
    assert robot.floating_base is not None
    links = [one for one in robot.floating_base.contact_links if one in base.contacts]
    if not links or not np.any([base.contacts[one] for one in links]):
        return
    flags = np.column_stack([base.contacts[link] for link in links])
    own = _foot_velocities(robot, motion, links)
    shares, legs = _moving_shares(own, flags, base), None
    if _least(shares) > _MOVES_SHARE:
        legs = _exchanged_legs(robot, motion, links, flags)
    if legs is not None:
        order, shares = legs
        yield _legs_finding(robot, logs, order)
    exchanged = _exchanged(links, shares)
    if exchanged:
        yield _exchange_finding(exchanged, logs)
    if exchanged or legs is not None:
        return
    known = base.velocity is not None
    velocity = _relative(own, base.velocity, flags)
    vertical, along = _parts(velocity, base.up)
    judged = base.used & (known | (flags.sum(axis=1) >= _FEWEST))
    for k, link in enumerate(links):
        yield from _moving(link, motion, vertical[:, k], along[:, k], flags[:, k] & judged)
    if base.up is not None:
        yield from _resting(robot, motion, links, flags, vertical, judged)


def _foot_velocities(robot: Robot, motion: Motion, links: Sequence[str]) -> Array:
    """Return the velocities (T, k, 3) of contacts in the base's frame, if its origin is at rest."""
    base = motion.base
    assert base is not None
    assert robot.floating_base is not None
    points = [replace(robot.floating_base.contact_of(x), is_flat=False) for x in links]
    J = contact_map(robot, motion.joint_position, points, base.up).swapaxes(1, 2)[:, :, 3:]
    rates = np.hstack([base.angular_velocity, motion.joint_velocity])
    return np.asarray(np.einsum("tij,tj->ti", J, rates).reshape(len(rates), -1, 3))


def _relative(own: Array, velocity: Array | None, flags: BoolArray) -> Array:
    """Return the velocities (T, k, 3) of contacts over the ground."""
    if velocity is None:
        standing = np.where(flags[:, :, None] > 0, own, np.nan)
        standing[~np.any(flags, axis=1)] = 0.0
        velocity = -np.nanmedian(standing, axis=1)
    return np.asarray(own + velocity[:, None])


def _moving_shares(own: Array, flags: BoolArray, base: BaseMotion) -> Array:
    """Return the shares (k, k) of the stance by the flag of a contact in which another one moves.

    `own` are the velocities of the contacts in the base's frame.
    """
    vertical, along = _parts(_relative(own, base.velocity, np.ones_like(flags)), base.up)
    moves = along > _SLIDES_M_S if base.up is None else vertical > _RISES_M_S
    moves, standing = (x[base.used].astype(float) for x in (moves, flags))
    return np.asarray(moves.T @ standing / np.maximum(standing.sum(axis=0), 1))


def _least(shares: Array) -> float:
    """Return the mean share with the flags exchanged as they fit best."""
    return float(shares[linear_sum_assignment(shares)].mean())


def _exchanged_legs(
    robot: Robot, motion: Motion, links: Sequence[str], flags: BoolArray
) -> tuple[IndexArray, Array] | None:
    """Return the order (n,) of the joints by which standing feet rest, and their moving shares.

    All orders of legs with equal kinds of joints count, each with the flags that fit it best. None
    unless one is far better than that of the log and than all others.
    """
    assert motion.base is not None
    legs = _legs(robot, motion, links)
    if not 2 <= len(legs) <= _MOST_LEGS:
        return None
    some = slice(None, None, -(-len(motion.time) // _JUDGED))
    base = motion.base.samples(some)
    found = []
    for chosen in permutations(legs):
        order = np.arange(robot.n)
        order[np.concatenate(legs)] = np.concatenate(chosen)
        q, v = (x[some][:, order] for x in (motion.joint_position, motion.joint_velocity))
        turned = replace(motion, base=base, joint_position=q, joint_velocity=v)
        shares = _moving_shares(_foot_velocities(robot, turned, links), flags[some], base)
        found.append((_least(shares), order, shares))
    (now, *_), (best, order, shares), second = found[0], *sorted(found, key=itemgetter(0))[:2]
    if now < 2 * _MOVES_SHARE or best > _EXCHANGED * min(now, second[0]):
        return None
    return order, shares


def _legs(robot: Robot, motion: Motion, links: Sequence[str]) -> list[IndexArray]:
    """Return the joints of each leg: those that move its contacts alone, of equal kinds."""
    assert robot.floating_base is not None
    points = [replace(robot.floating_base.contact_of(x), is_flat=False) for x in links]
    J = contact_map(robot, motion.joint_position[:1], points)[0, 6:].reshape(robot.n, -1, 3)
    moved = np.any(J != 0.0, axis=2)
    sets = np.unique(moved.T, axis=0)
    legs = [np.flatnonzero(one & (sets.sum(axis=0) == 1)) for one in sets]
    kinds = [tuple(np.array(robot.is_prismatic)[leg]) for leg in legs]
    return legs if len(set(kinds)) == 1 and kinds[0] else []


def _exchanged(links: Sequence[str], shares: Array) -> dict[str, str]:
    """Return {contact: the one whose flag fits it} if flags of several contacts are exchanged."""
    rows, columns = linear_sum_assignment(shares)
    now, best = float(np.trace(shares)), float(shares[rows, columns].sum())
    if now < 2 * _MOVES_SHARE or best > _EXCHANGED * now:
        return {}
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {links[i]: links[j] for i, j in pairs if i != j}


def _parts(velocity: Array, up: Array | None) -> tuple[Array, Array]:
    """Return the vertical and the horizontal speeds (T, k), all of it horizontal without `up`."""
    speed = np.linalg.norm(velocity, axis=2)
    if up is None:
        return np.zeros_like(speed), speed
    vertical = np.abs(np.einsum("tki,ti->tk", velocity, up))
    return vertical, np.sqrt(np.maximum(speed**2 - vertical**2, 0.0))


def _legs_finding(robot: Robot, logs: Sequence[Log], order: IndexArray) -> Finding:
    described: Mapping[str, Mapping[str, Any]] = {}
    for log in logs:
        described = (log.description or {}).get("joints", described)
    names, tables, pairs = robot.joint_names, [], []
    for j in np.flatnonzero(order != np.arange(robot.n)):
        joint, other = names[j], names[order[j]]
        pairs.append(f"{joint} by those of {other}")
        columns = column_names(other, robot.is_prismatic[j]).items()
        own = {field: name for name, field in columns if any(name in log.columns() for log in logs)}
        sources = described.get(other, own)
        tables += [toml_table("joints", joint), *(f"{x} = {as_toml(sources[x])}" for x in sources)]
    return Finding(
        "swapped-joints",
        "legs are exchanged: standing feet rest if the channels of these joints are meant: "
        + listed(pairs),
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
    """Yield a contact that moves while its flag says that it stands."""
    rises, slides = standing & (vertical > _RISES_M_S), standing & (along > _SLIDES_M_S)
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
        longest = max((int(end - start) for start, end in runs(rests)), default=0)
        if longest > _RESTS_S * motion.rate_hz:
            duration = longest / motion.rate_hz
            yield Finding(
                "contact-flags",
                f"{link} is flagged as in the air and rests on the level of the others for "
                f"{duration:.2g} s: forces on it would go into the bodies",
                link,
                "doubtful",
                {"longest rest [s]": duration},
                "check the threshold and the delay of its flag",
                "likely",
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
