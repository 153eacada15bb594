"""Repair of clocks: stamps sorted, repeats and jumps removed, and clocks aligned with the first.

Stamps of a log may repeat, come late or be set back, and every joint may have its own clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.log.channels import refusal
from seaid.log.repair import FEWEST, Channel, Report

_LATE_RUN = 5
"""Most late samples in a row."""

_NEIGHBOURS, _TOLERANCE = 10, 3.0
"""A signal is continuous if its change is at most this multiple of those of so many neighbours."""

_BLOCKS, _PAIRED = 100, 3.0
"""Blocks of the line between two clocks, and its largest jitter in typical steps."""

_ALIKE, _MOST = 0.01, 0.8
"""Relative tolerance of equal steps, and the share of them that makes a clock regular."""

_GAP, _REGULAR = 5.0, 1e-3
"""A longer step, in typical steps, is a gap; relative tolerance of regular steps."""

_FEWEST_CHANGES, _EVEN, _LIVE = 5, 2.0, 0.5
"""Changes of coarse stamps from which their samples have a rate; largest range of the changes about
a regular clock, in steps: one by the stamps, one by the samples; share of the samples in which a
channel changes both within a stamp and from one to the next."""

LONGEST_BRIDGE_S = 0.1
"""Up to this time, or five typical steps if that is more, missing samples are interpolated.

Over longer gaps an interpolation follows noise instead of the robot: on a simulated leg, gaps of
0.1 s do not change the errors of friction and stiffness, gaps of 0.15 s multiply the error of the
stiffness by four, and gaps of 0.3 s by seven.
"""


@dataclass(frozen=True, eq=False)
class RepairedClock:
    """Sorted stamps: `rows` (S,) of the remaining samples, and non-decreasing `time` (S,) [s].

    `late` samples were sorted into place; at `jumps` (row, seconds) the clock was set back or
    forward during continuous sampling; `unknown` rows had no finite stamp and are excluded.
    """

    rows: IndexArray
    time: Array
    late: IndexArray
    jumps: tuple[tuple[int, float], ...]
    unknown: IndexArray


@dataclass(frozen=True)
class ClockLine:
    """A clock relative to a reference: clock = reference + offset_s + drift (reference - middle_s).

    `drift_error` is half of the 95 % confidence interval of the drift; `jitter_s` is the median
    distance from the line.
    """

    offset_s: float
    drift: float
    drift_error: float
    middle_s: float
    jitter_s: float

    def to_reference(self, time: Array) -> Array:
        """Return stamps (T,) of this clock converted to the reference clock."""
        # clock - middle = offset + (1 + drift) (reference - middle), solved for the reference.
        since = np.asarray(time) - self.offset_s - self.middle_s
        return np.asarray(self.middle_s + since / (1.0 + self.drift))


def typical_step(time: Array) -> float:
    """Return the typical time between samples [s]: the mean of the equal steps if most are equal.

    Otherwise it is the mean of all steps but pauses of more than ten mean steps.
    """
    steps = np.diff(time)
    steps = steps[steps > 0]
    if not len(steps):
        return 0.0
    # The mean has more digits than the median if stamps are rounded, as the median is one of them.
    alike = np.abs(steps / np.median(steps) - 1.0) < _ALIKE
    if np.mean(alike) > _MOST:
        return float(np.mean(steps[alike]))
    return float(np.mean(steps[steps <= 10 * np.mean(steps)]))


def longest_step(time: Array) -> float:
    """Return the time between samples [s] above which a step is a gap: five typical steps."""
    return _GAP * typical_step(time)


def longest_bridge(time: Array) -> float:
    """Return the time between samples [s] above which a step is a hole, not interpolated."""
    return max(longest_step(time), LONGEST_BRIDGE_S)


def irregular_steps(time: Array) -> BoolArray:
    """Return the mask (T - 1,) of steps of a clock that differ from the median step."""
    steps = np.diff(time)
    return np.asarray(np.abs(steps - np.median(steps)) > _REGULAR * np.median(steps))


def repaired_clock(name: str, time: Array, values: Array, longest_gap_s: float) -> RepairedClock:
    """Return the sorted stamps of a clock; `values` (T, any) are the samples stamped by it.

    Single late samples are sorted into the gap that they left. A jump of the clock backwards, or
    forward by more than `longest_gap_s`, is removed if all values are continuous there. Raises
    LogError for a jump backwards with discontinuous values: two recordings in one.
    """
    known = np.isfinite(time)
    rows, unknown = np.flatnonzero(known), np.flatnonzero(~known)
    stamps, values = time[rows].copy(), values[rows]
    step = typical_step(stamps)
    late, jumps, place = [], [], 1
    while place < len(stamps):
        jump = stamps[place] - stamps[place - 1]
        if jump < 0:
            run = _late_run(stamps, values, place, step)
            if run:
                late.append(np.arange(place, place + run))
                # Sorted up to the run only, since the clock may be set back later on.
                stamps, values, rows = _sorted(stamps, values, rows, place + run)
                place += run
                continue
            if not _is_continuous(values, place):
                stamps_s = {"before": stamps[place - 1], "time": stamps[place]}
                raise refusal("two_recordings", name=name, row=rows[place], **stamps_s)
        # Over a true gap a joint moves on. If it would have moved and the values still continue,
        # the clock was set forward, and no sample is missing.
        forward = jump > longest_gap_s and _would_move(values, place, jump / max(step, 1e-12))
        if jump < 0 or (forward and _is_continuous(values, place)):
            jumps.append((int(rows[place]), float(jump - step)))
            # All later stamps, so that a typical step is between both samples.
            stamps[place:] -= jump - step
        place = _next_break(stamps, place + 1, longest_gap_s)
    runs = np.concatenate([*late, np.empty(0, dtype=np.intp)]).astype(np.intp)
    return RepairedClock(rows=rows, time=stamps, late=runs, jumps=tuple(jumps), unknown=unknown)


def _next_break(stamps: Array, place: int, longest_gap_s: float) -> int:
    """Return the next sample after a step backwards or a step above `longest_gap_s`."""
    steps = np.diff(stamps[place - 1 :])
    broken = np.flatnonzero((steps < 0) | (steps > longest_gap_s))
    return place + int(broken[0]) if len(broken) else len(stamps)


def _late_run(stamps: Array, values: Array, place: int, step: float) -> int:
    """Return the number of late samples from `place` on, 0 if the clock was set back."""
    ahead = stamps[place : place + _LATE_RUN + 1] >= stamps[place - 1]
    run = int(np.argmax(ahead)) if np.any(ahead) else len(ahead)
    if run > _LATE_RUN:
        return 0
    jump = stamps[place] - stamps[place - 1]
    if -jump < step:  # the jitter of the stamp before
        return run
    # In the right reading of the stamps, the motion and the sampling are the smoother ones.
    near = slice(max(0, place - _NEIGHBOURS), place + run + _NEIGHBOURS)
    at = min(place, _NEIGHBOURS)
    stamps, values = stamps[near], values[near]
    late, moved, _ = _sorted(stamps, values, np.arange(len(stamps)), at + run)
    set_on = np.concatenate([stamps[:at], stamps[at:] - (jump - step)])
    return run if _roughness(late, moved) < _roughness(set_on, values) else 0


def _roughness(time: Array, values: Array) -> float:
    """Return how far channels (T, any) and their sampling are from smooth, as a sum of logarithms.

    That is -2 / T times the log-likelihood of samples on lines between their neighbours, with
    noise of unknown variance in each channel. The number of a sample is one more channel, which is
    a line in the time of regular sampling.
    """
    columns = np.column_stack([np.arange(len(time)), np.where(np.isfinite(values), values, np.nan)])
    share = np.diff(time)[:-1] / np.maximum(time[2:] - time[:-2], np.finfo(float).tiny)
    off = columns[1:-1] - columns[:-2] - share[:, None] * (columns[2:] - columns[:-2])
    power, changes = (np.nansum(x**2, axis=0) for x in (off, np.diff(columns, axis=0)))
    moves = changes > 0
    # A line without noise has none of its changes left, and would outweigh all other channels.
    return float(np.sum(np.log(power[moves] + _REGULAR**2 * changes[moves])))


def _sorted(
    stamps: Array, values: Array, rows: IndexArray, end: int
) -> tuple[Array, Array, IndexArray]:
    order = np.arange(len(stamps))
    order[:end] = np.argsort(stamps[:end], kind="stable")
    return stamps[order], values[order], rows[order]


def _is_continuous(values: Array, place: int) -> bool:
    """Return whether all values change at `place` by no more than a few neighbouring changes."""
    change = np.abs(values[place] - values[place - 1])
    usual = _usual_changes(values, place)
    seen = np.isfinite(change) & np.isfinite(usual)
    return bool(np.any(seen) and np.all(change[seen] <= _TOLERANCE * usual[seen]))


def _usual_changes(values: Array, place: int) -> Array:
    """Return the largest change (any,) between samples around a place, excluding that at it."""
    around = np.abs(np.diff(values[max(0, place - _NEIGHBOURS) : place + _NEIGHBOURS], axis=0))
    # The change at `place` is number min(place, _NEIGHBOURS) - 1 of the window.
    around = np.delete(around, min(place, _NEIGHBOURS) - 1, axis=0)
    largest = np.max(np.where(np.isfinite(around), around, -1.0), axis=0, initial=-1.0)
    return np.where(largest < 0, np.nan, largest)


def _would_move(values: Array, place: int, steps: float) -> bool:
    """Return whether a value of constant speed would have moved clearly during `steps` steps."""
    before = values[max(0, place - _NEIGHBOURS) : place]
    after = values[place : place + _NEIGHBOURS]
    if min(len(before), len(after)) < 2:
        return False
    speeds = [(x[-1] - x[0]) / (len(x) - 1) for x in (before, after)]
    slower, faster = np.sort(np.abs(speeds), axis=0)  # NaN comes last, and is no faster one
    # Three times the change that counts as continuous, which no true gap with this motion passes.
    moved = steps * slower > 3 * _TOLERANCE * _usual_changes(values, place)
    return bool(np.any(moved & (2 * slower > faster) & (speeds[0] * speeds[1] > 0)))


def clock_line(clock: Array, reference: Array) -> ClockLine:
    """Return the line of one clock over another; both (T,) [s] stamp the same rows.

    The line has the median slope through the medians of blocks, so late and repeated stamps do not
    affect it.
    """
    known = np.isfinite(clock) & np.isfinite(reference)
    clock, reference = clock[known], reference[known]
    if len(clock) < 2:
        return ClockLine(0.0, 0.0, np.inf, 0.0, 0.0)
    difference = clock - reference
    blocks = np.array_split(np.arange(len(clock)), min(_BLOCKS, len(clock)))
    at, apart = (np.array([np.median(x[part]) for part in blocks]) for x in (reference, difference))
    drift, low, high = median_slope(at, apart) if np.ptp(at) > 0 else (0.0, 0.0, 0.0)
    middle = float(np.median(reference))
    detrended = difference - drift * (reference - middle)
    # At the middle of the log, where the errors of offset and slope are nearly uncorrelated.
    offset = float(np.median(detrended))
    jitter = float(np.median(np.abs(detrended - offset)))
    return ClockLine(offset, drift, (high - low) / 2, middle, jitter)


def median_slope(x: Array, y: Array) -> tuple[float, float, float]:
    """Return the median slope of points (T,), and its interval of 95 % (Theil 1950, Sen 1968).

    It is that of `scipy.stats.theilslopes`, whose package takes a third of a second to import.
    """
    steps, changes = np.subtract.outer(x, x), np.subtract.outer(y, y)
    slopes = np.sort(changes[steps > 0] / steps[steps > 0])
    # Kendall's score has n (n - 1) (2 n + 5) / 18 as its variance, less the same of all that tie.
    counts = [np.array([len(x)]), *(np.unique(each, return_counts=True)[1] for each in (x, y))]
    every, *ties = (float(np.sum(n * (n - 1) * (2 * n + 5))) for n in counts)
    spread = float(scipy.special.ndtri(0.975)) * np.sqrt(max(every - sum(ties), 0.0) / 18)
    low, high = round((len(slopes) - spread) / 2) - 1, round((len(slopes) + spread) / 2)
    interval = slopes[[max(low, 0), min(high, len(slopes) - 1)]].tolist()
    return float(np.median(slopes)), interval[0], interval[1]


def with_regular_clock(group: Sequence[Channel], report: Report) -> list[Channel]:
    """Return channels with a regular clock if their stamps have too few digits, and it is plain.

    The stamp changes at the first sample behind each multiple of its resolution. If samples are
    equidistant, time over number of these samples is a line, within one step.
    """
    time, values = group[0].time, np.column_stack([channel.values for channel in group])
    if not np.all(np.isfinite(time)):
        return list(group)
    repeats = np.diff(time) == 0
    # Only the first sample of each stamp is near the time that it states.
    changes = np.flatnonzero(~repeats) + 1
    is_coarse = np.sum(repeats) > report.limits.most_disordered * len(time)
    if not is_coarse or np.any(np.diff(time) < 0) or len(changes) < _FEWEST_CHANGES:
        return list(group)
    # without a change within a stamp, each sample is there several times
    moved = np.diff(np.nan_to_num(values, posinf=0.0, neginf=0.0), axis=0) != 0
    live = np.minimum(np.mean(moved[repeats], axis=0), np.mean(moved[~repeats], axis=0))
    step, start = np.polyfit(changes, time[changes] - time[0], 1)
    off = time[changes] - time[0] - (start + step * changes)
    if np.max(live) < _LIVE or np.ptp(off) > _EVEN * step:
        return list(group)
    name = _clock_name(group)
    report.add(name, "stamps with too few digits", time, repeats, rate_hz=1 / step)
    regular = time[0] + start + step * np.arange(len(time))
    return [replace(channel, time=regular) for channel in group]


def clocks_of(channels: Sequence[Channel]) -> list[list[Channel]]:
    """Return the channels grouped by their clock."""
    clocks: list[list[Channel]] = []
    for channel in channels:
        alike = [x for x in clocks if np.array_equal(x[0].time, channel.time, equal_nan=True)]
        if alike:
            alike[0].append(channel)
        else:
            clocks.append([channel])
    return clocks


def clock_lines(clocks: Sequence[Sequence[Channel]], report: Report) -> list[ClockLine | None]:
    """Return the line of each clock over the first one; None: the clock is not changed.

    A line is determined only for clocks with the same number of samples that run in step. An offset
    below one step without a drift stays: it cannot be distinguished from sequential sampling.
    """
    return [None, *(_line(group, clocks[0], report) for group in clocks[1:])]


def _line(group: Sequence[Channel], first: Sequence[Channel], report: Report) -> ClockLine | None:
    """Return the line of a group's clock over that of the first group; None: not changed."""
    clock, reference = group[0].time, first[0].time
    line = clock_line(clock, reference) if len(clock) == len(reference) else None
    step = typical_step(reference[np.isfinite(reference)])
    # Equal rows of both clocks were sampled at the same time, except for jitter.
    if line is None or line.jitter_s >= _PAIRED * step:
        return None
    span = float(np.nanmax(reference) - np.nanmin(reference))
    # Both tests: a drift of less than a sample over the log does not matter, and one within its
    # confidence interval may be none.
    drifts = abs(line.drift) * span > step and abs(line.drift) > line.drift_error
    # A clock that drifts is another one, whose offset changes throughout. That at the middle of the
    # log is as much a fault of the clock as that at its start.
    if not drifts and abs(line.offset_s) <= step:
        return None
    line = replace(line, drift=line.drift * drifts)
    name, first_name = _clock_name(group), _clock_name(first)
    report.check("drift", abs(line.drift), name=name, drift=line.drift, first=first_name)
    start = np.array([np.nanargmin(clock)])
    sizes = {"offset_s": line.offset_s, "drift_us_per_s": line.drift * 1e6, "first": first_name}
    for kind, size in (("clock offset", line.offset_s), ("clock drift", line.drift)):
        report.add(name, kind, clock, start[: int(size != 0.0)], **sizes)
    return line


def _clock_name(group: Sequence[Channel]) -> str:
    others = len(group) - 1
    return f"'{group[0].name}'" + (f" and {others} more" if others else "")


def repaired_group(group: Sequence[Channel], report: Report) -> RepairedClock:
    """Return the repaired clock of channels, of the first sample of each stamp."""
    name, raw = _clock_name(group), group[0].time
    values = np.column_stack([channel.values for channel in group])
    finite = raw[np.isfinite(raw)]
    if len(finite) < FEWEST:
        raise refusal("too_few_stamps", name=name, count=len(finite), fewest=FEWEST)
    longest_s = report.limits.longest_gap_s or longest_step(finite)
    clock = repaired_clock(name, raw, values, longest_s)
    repeats = np.concatenate([[False], np.diff(clock.time) <= 0])
    jumps = ", ".join(f"{size:.4g} s" for _, size in clock.jumps)
    faults = {
        "stamps that are not finite": clock.unknown,
        "late samples": clock.late,
        "repeated stamps": clock.rows[repeats],
        "clock jumps": np.array([row for row, _ in clock.jumps], dtype=np.intp),
    }
    for kind, rows in faults.items():
        report.add(name, kind, raw, np.maximum(rows - 1, 0), jumps=jumps)
    # Repeated stamps with equal values are copies; those with other values are samples at a time
    # that is not known, and only these count for the limit.
    changes = np.diff(values[clock.rows], axis=0, prepend=np.nan)  # NaN differs from any value
    unlike = repeats & ~np.all(changes == 0, axis=1)
    _check_order(name, raw, np.concatenate([clock.unknown, clock.late, clock.rows[unlike]]), report)
    _report_steps(name, clock.time[~repeats], report)
    return replace(clock, rows=clock.rows[~repeats], time=clock.time[~repeats])


def _check_order(name: str, raw: Array, rows: IndexArray, report: Report) -> None:
    """Raise LogError for too many stamps that are out of order."""
    first = float(raw[max(int(np.min(rows, initial=len(raw))) - 1, 0)])
    stamps = {"count": len(rows), "total": len(raw), "time": first, "rate_hz": _mean_rate(raw)}
    report.check("order", len(rows) / len(raw), name=name, **stamps)


def _mean_rate(raw: Array) -> str:
    """Return the mean rate of samples [Hz] as text, "..." if their stamps hardly change."""
    finite = raw[np.isfinite(raw)]
    if len(np.unique(finite)) < _FEWEST_CHANGES:
        return "..."
    return f"{(len(finite) - 1) / float(np.ptp(finite)):.4g}"


def _report_steps(name: str, time: Array, report: Report) -> None:
    """Report irregular steps and gaps of a clock. Raises LogError for too much time in gaps."""
    steps = np.diff(time)
    gaps, irregular = steps > longest_step(time), irregular_steps(time)
    if np.sum(irregular) > np.sum(gaps):
        ends = {"least_s": np.min(steps), "most_s": np.max(steps)}
        report.add(name, "irregular steps", time, irregular, **ends)
    lost = float(np.sum(steps[gaps]) / (time[-1] - time[0]))
    longest = report.limits.longest_gap_s or longest_bridge(time)
    over = int(np.sum(steps > longest))
    done = f"bridged, {over} above {longest:.3g} s excluded" if over else "bridged"
    report.add(name, "gaps", time, gaps, most_s=np.max(steps), done=done, lost=lost)
    first = {"count": np.sum(gaps), "time": time[np.argmax(gaps)]}
    report.check("time_in_gaps", lost, name=name, lost=lost, **first)
