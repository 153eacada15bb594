"""Clocks of logged samples: stamps out of order, clocks that jump, offset and drift of two clocks.

A clock of a log is not trusted: stamps may repeat, come late or be set back, and every joint may
have one of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array, BoolArray, IndexArray
from seaid.errors import LogError

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
class MendedClock:
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


def mended_clock(name: str, time: Array, values: Array, longest_gap_s: float) -> MendedClock:
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
    return MendedClock(
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
