"""Clocks of logged samples: stamps out of order, clocks that jump, offset and drift of two clocks.

A clock of a log is not trusted: stamps may repeat, come late or be set back, and every joint may
have one of its own.

Clocks of channels made fit for use: brought to the first one, put in order, without repeats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.errors import LogError
from seaid.log.repair.data import Channel, Repair, Repairs
from seaid.log.repair.resampling import FEWEST

_LATE_RUN = 5
_HOLE = 0.3
_NEIGHBOURS = 10
_TOLERANCE = 3.0
_BLOCKS = 100
_PAIRED = 3.0
_ALIKE, _MOST = 0.01, 0.8
_GAP, _REGULAR = 5.0, 1e-3

LONGEST_BRIDGE_S = 0.1
"""Up to this time, or five usual steps if that is more, missing samples are interpolated.

Over longer ones an interpolation follows noise instead of the robot: on a simulated leg 0.1 s leave
the errors of friction and stiffness as they are, 0.15 s make that of the stiffness four times as
large, 0.3 s seven times.
"""


@dataclass(frozen=True, eq=False)
class RepairedClock:
    """Stamps in order: `rows` (S,) of the samples that are left, `time` (S,) [s] that never falls.

    `late` samples were put back into place; at `jumps` (row, seconds) the clock was set back or on
    while the sampling went on; `unknown` rows had no finite stamp and are left out.
    """

    rows: IndexArray
    time: Array
    late: IndexArray
    jumps: tuple[tuple[int, float], ...]
    unknown: IndexArray


@dataclass(frozen=True)
class ClockLine:
    """A clock beside another: own = reference + offset_s + drift (reference - middle_s).

    `drift_error` is half of the 95 % interval of the drift; `jitter_s` the median distance from the
    line.
    """

    offset_s: float
    drift: float
    drift_error: float
    middle_s: float
    jitter_s: float

    def to_reference(self, time: Array) -> Array:
        """Return stamps (T,) of the own clock as the reference would have them."""
        since = np.asarray(time) - self.offset_s - self.middle_s
        return np.asarray(self.middle_s + since / (1.0 + self.drift))


def typical_step(time: Array) -> float:
    """Return the time between samples [s]: that of nearly all if they are alike, else the mean.

    Pauses of more than ten mean steps are left out of the mean.
    """
    steps = np.diff(time)
    steps = steps[steps > 0]
    if not len(steps):
        return 0.0
    alike = np.abs(steps / np.median(steps) - 1.0) < _ALIKE
    if np.mean(alike) > _MOST:
        return float(np.mean(steps[alike]))
    return float(np.mean(steps[steps <= 10 * np.mean(steps)]))


def longest_step(time: Array) -> float:
    """Return the time between samples [s] above which it is a gap: five typical steps."""
    return _GAP * typical_step(time)


def longest_bridge(time: Array) -> float:
    """Return the time between samples [s] above which it is a hole, that nothing bridges."""
    return max(longest_step(time), LONGEST_BRIDGE_S)


def irregular_steps(time: Array) -> BoolArray:
    """Tell the steps (T - 1,) of a clock that are not as long as most of them."""
    steps = np.diff(time)
    return np.asarray(np.abs(steps - np.median(steps)) > _REGULAR * np.median(steps))


def repaired_clock(name: str, time: Array, values: Array, longest_gap_s: float) -> RepairedClock:
    """Return the stamps of a clock in order, with the `values` (T, any) that were sampled by it.

    Single late samples are sorted into the hole that they left. Where the clock was set back, or
    set on by more than `longest_gap_s`, while all values go on as if nothing had happened, the
    jump is taken out. Raises LogError where values do not go on: two recordings in one.
    """
    known = np.isfinite(time)
    rows, unknown = np.flatnonzero(known), np.flatnonzero(~known)
    stamps, values = time[rows].copy(), values[rows]
    step = typical_step(stamps)
    late, jumps = [], []
    place = 1
    while place < len(stamps):
        jump = stamps[place] - stamps[place - 1]
        if jump < 0:
            run = _late_run(stamps, place, step)
            if run:
                late.append(np.arange(place, place + run))
                stamps, values, rows = _sorted(stamps, values, rows, place + run)
                place += run
                continue
            if not _goes_on(values, place):
                raise LogError(
                    f"the clock of {name} goes backwards at sample {rows[place]} (from "
                    f"{stamps[place - 1]:.9g} s to {stamps[place]:.9g} s) and the values do not go "
                    "on there: two recordings in one? Split the log at this place"
                )
        set_on = jump > longest_gap_s and _moved(values, place, jump / max(step, 1e-12))
        if jump < 0 or (set_on and _goes_on(values, place)):
            jumps.append((int(rows[place]), float(jump - step)))
            stamps[place:] -= jump - step
        place = _next_break(stamps, place + 1, longest_gap_s)
    return RepairedClock(
        rows=rows,
        time=stamps,
        late=np.concatenate([*late, np.empty(0, dtype=np.intp)]).astype(np.intp),
        jumps=tuple(jumps),
        unknown=unknown,
    )


def _next_break(stamps: Array, place: int, longest_gap_s: float) -> int:
    """Return the next place whose step is backwards or a long one."""
    steps = np.diff(stamps[place - 1 :])
    broken = np.flatnonzero((steps < 0) | (steps > longest_gap_s))
    return place + int(broken[0]) if len(broken) else len(stamps)


def _late_run(stamps: Array, place: int, step: float) -> int:
    """Return how many samples from `place` on are late, 0 where the clock was set back.

    Late ones are few, and fall into a hole between the stamps before.
    """
    ahead = stamps[place : place + _LATE_RUN + 1] >= stamps[place - 1]
    run = int(np.argmax(ahead)) if np.any(ahead) else len(ahead)
    if run > _LATE_RUN:
        return 0
    before = stamps[max(0, place - 50) : place]
    distance = np.min(np.abs(stamps[place : place + run, None] - before), axis=1)
    return run if np.all(distance > _HOLE * step) else 0


def _sorted(
    stamps: Array, values: Array, rows: IndexArray, end: int
) -> tuple[Array, Array, IndexArray]:
    order = np.arange(len(stamps))
    order[:end] = np.argsort(stamps[:end], kind="stable")
    return stamps[order], values[order], rows[order]


def _goes_on(values: Array, place: int) -> bool:
    """Tell whether no value changes at `place` by more than its neighbours do."""
    change = np.abs(values[place] - values[place - 1])
    usual = _usual_changes(values, place)
    seen = np.isfinite(change) & np.isfinite(usual)
    return bool(np.any(seen) and np.all(change[seen] <= _TOLERANCE * usual[seen]))


def _usual_changes(values: Array, place: int) -> Array:
    """Return the largest change (any,) from sample to sample around a place, without that at it."""
    around = np.abs(np.diff(values[max(0, place - _NEIGHBOURS) : place + _NEIGHBOURS], axis=0))
    around = np.delete(around, min(place, _NEIGHBOURS) - 1, axis=0)
    found = np.where(np.isfinite(around), around, -1.0)
    largest = np.max(found, axis=0, initial=-1.0)
    return np.where(largest < 0, np.nan, largest)


def _moved(values: Array, place: int, steps: float) -> bool:
    """Tell whether some value with the same speed before and after would have moved away."""
    before = values[max(0, place - _NEIGHBOURS) : place]
    after = values[place : place + _NEIGHBOURS]
    if min(len(before), len(after)) < 2:
        return False
    speed_before = (before[-1] - before[0]) / (len(before) - 1)
    speed_after = (after[-1] - after[0]) / (len(after) - 1)
    slower = np.minimum(np.abs(speed_before), np.abs(speed_after))
    alike = 2 * slower > np.maximum(np.abs(speed_before), np.abs(speed_after))
    moved = steps * slower > 3 * _TOLERANCE * _usual_changes(values, place)
    return bool(np.any(moved & alike & (speed_before * speed_after > 0)))


def clock_line(own: Array, reference: Array) -> ClockLine:
    """Return how one clock runs beside another, both (T,) [s] stamping the same rows.

    Robust: medians of blocks, and the line of median slope through them (Theil 1950, Sen 1968), so
    that stamps which came late or stood still do not turn it.
    """
    from scipy.stats import theilslopes

    known = np.isfinite(own) & np.isfinite(reference)
    own, reference = own[known], reference[known]
    if len(own) < 2:
        return ClockLine(0.0, 0.0, np.inf, 0.0, 0.0)
    difference = own - reference
    blocks = np.array_split(np.arange(len(own)), min(_BLOCKS, len(own)))
    at = np.array([np.median(reference[block]) for block in blocks])
    apart = np.array([np.median(difference[block]) for block in blocks])
    slope, _, low, high = theilslopes(apart, at)
    middle = float(np.median(reference))
    straight = difference - slope * (reference - middle)
    offset = float(np.median(straight))
    jitter = float(np.median(np.abs(straight - offset)))
    return ClockLine(offset, float(slope), float(high - low) / 2, middle, jitter)


def is_paired(line: ClockLine, step: float) -> bool:
    """Tell whether rows with the same number were sampled at the same time, but for jitter."""
    return line.jitter_s < _PAIRED * step


def clocks_of(channels: Sequence[Channel]) -> list[list[Channel]]:
    """Return the channels grouped by the clock that stamps them."""
    clocks: list[list[Channel]] = []
    for channel in channels:
        for group in clocks:
            if np.array_equal(group[0].time, channel.time, equal_nan=True):
                group.append(channel)
                break
        else:
            clocks.append([channel])
    return clocks


def clock_lines(
    clocks: Sequence[Sequence[Channel]], limits: Repairs, found: list[Repair]
) -> list[ClockLine | None]:
    """Return how to bring each clock to the first one; None: as it is.

    Only rows that belong together can tell: clocks with as many samples, in step. An offset below
    one step cannot be told from sensors that sample one after the other, and stays.
    """
    return [None, *(_line(group, clocks[0], limits, found) for group in clocks[1:])]


def _line(
    group: Sequence[Channel], first: Sequence[Channel], limits: Repairs, found: list[Repair]
) -> ClockLine | None:
    """Return how to bring the clock of channels to that of the first ones; None: as it is."""
    own, reference = group[0].time, first[0].time
    line = clock_line(own, reference) if len(own) == len(reference) else None
    step = typical_step(reference[np.isfinite(reference)])
    if line is None or not is_paired(line, step):
        return None
    span = float(np.nanmax(reference) - np.nanmin(reference))
    drifts = abs(line.drift) * span > step and abs(line.drift) > line.drift_error
    shifted = abs(line.offset_s) > step
    name, name_first = _clock_name(group), _clock_name(first)
    if drifts and abs(line.drift) > limits.largest_drift:
        raise LogError(
            f"the clock of {name} drifts by {line.drift:.3g} s/s against that of {name_first}, "
            f"allowed {limits.largest_drift:.3g} (Repairs.largest_drift): is its unit right, and "
            "are its rows those of the other?"
        )
    for kind, there, size in (
        ("clock offset", shifted, f"{line.offset_s:.6g} s"),
        ("clock drift", drifts, f"{line.drift * 1e6:.4g} us/s"),
    ):
        if there:
            action = f"{size} against {name_first}, taken out"
            found.append(Repair(name, kind, 1, float(np.nanmin(own)), action))
    if not drifts and not shifted:
        return None
    return replace(
        line, drift=line.drift if drifts else 0.0, offset_s=line.offset_s if shifted else 0.0
    )


def _clock_name(group: Sequence[Channel]) -> str:
    others = len(group) - 1
    return f"'{group[0].name}'" + (f" and {others} more" if others else "")


def repaired_group(
    group: Sequence[Channel], limits: Repairs, found: list[Repair]
) -> tuple[RepairedClock, BoolArray]:
    """Return the clock of channels in order, and which of its samples are kept."""
    name = _clock_name(group)
    raw = group[0].time
    values = np.column_stack([channel.values for channel in group])
    finite = raw[np.isfinite(raw)]
    if len(finite) < FEWEST:
        raise LogError(
            f"the clock of {name} has {len(finite)} finite stamps, at least {FEWEST} are needed"
        )
    clock = repaired_clock(name, raw, values, limits.longest_gap_s or longest_step(finite))
    repeats = np.concatenate([[False], np.diff(clock.time) <= 0])
    _note_disorder(name, raw, clock, repeats, found)
    changes = np.diff(values[clock.rows], axis=0, prepend=np.nan)  # NaN differ from all
    _check_disorder(name, raw, clock, repeats & ~np.all(changes == 0, axis=1), limits)
    _note_steps(name, clock.time[~repeats], limits, found)
    return clock, ~repeats


def _note_disorder(
    name: str, raw: Array, clock: RepairedClock, repeats: BoolArray, found: list[Repair]
) -> None:
    """Note what was wrong with the order of the stamps of a clock."""
    jumps = ", ".join(f"{size:.4g} s" for _, size in clock.jumps)
    for kind, places, action in (
        ("stamps that are not finite", clock.unknown, "their samples were left out"),
        ("late samples", clock.late, "sorted into place"),
        ("repeated stamps", clock.rows[repeats], "the first sample of each was kept"),
        (
            "clock jumps",
            np.array([row for row, _ in clock.jumps], dtype=np.intp),
            f"of {jumps}, taken out: the values go on",
        ),
    ):
        if len(places):
            before = float(raw[max(int(places[0]) - 1, 0)])
            found.append(Repair(name, kind, len(places), before, action))


def _check_disorder(
    name: str, raw: Array, clock: RepairedClock, other: BoolArray, limits: Repairs
) -> None:
    """Refuse too many stamps out of order; `other` are those repeated with other values."""
    rows = np.concatenate([clock.unknown, clock.late, clock.rows[other]])
    if len(rows) > limits.most_disordered * len(raw):
        first = float(raw[max(int(np.min(rows)) - 1, 0)])
        raise LogError(
            f"the clock of {name}: {len(rows)} of {len(raw)} stamps are late, repeated with other "
            f"values or not finite, the first near t = {first:.6g} s; "
            f"allowed is a share of {limits.most_disordered:g} (Repairs.most_disordered): does the "
            "time have all its digits? Log finer stamps, or sort the log"
        )


def _note_steps(name: str, time: Array, limits: Repairs, found: list[Repair]) -> None:
    """Note irregular steps and gaps of a clock, and refuse too much time in gaps."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > longest_step(time))
    irregular = np.flatnonzero(irregular_steps(time))
    if len(irregular) > len(gaps):
        action = f"steps of {np.min(steps):.3g} to {np.max(steps):.3g} s, resampled"
        found.append(
            Repair(name, "irregular steps", len(irregular), float(time[irregular[0]]), action)
        )
    if not len(gaps):
        return
    lost = float(np.sum(steps[gaps]) / (time[-1] - time[0]))
    longest = limits.longest_gap_s or longest_bridge(time)
    over = int(np.sum(steps > longest))
    done = f"bridged, {over} above {longest:.3g} s excluded" if over else "bridged"
    action = f"of up to {np.max(steps):.3g} s, {done}: {lost:.1%} of the time"
    found.append(Repair(name, "gaps", len(gaps), float(time[gaps[0]]), action))
    if lost > limits.most_missing:
        raise LogError(
            f"the clock of {name} has {len(gaps)} gaps with {lost:.1%} of the time in them, the "
            f"first at t = {time[gaps[0]]:.6g} s; allowed {limits.most_missing:.1%} "
            "(Repairs.most_missing): take a part of the log without them"
        )
