"""The usable parts of a log: without rest at its ends, without frozen channels, between holes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from seaid._arrays import Array, BoolArray, resolution, runs, white_noise
from seaid.errors import LogError
from seaid.log.channels import quantity_of
from seaid.log.log import MINIMUM_SAMPLES, Log
from seaid.log.repair import Repair
from seaid.log.repair.clocks import longest_bridge, typical_step

REST: Final = "rest at the ends"
FROZEN: Final = "frozen values"
HOLES: Final = "holes in time"
"""Kinds of the `Repair` entries that report excluded samples."""

REST_S = 0.25
"""Rest before and after the motion that is kept [s], for the filter transients.

Rest adds noise but no excitation: with 13 s of it at both ends of 8 s of motion of the simulated
leg, the errors of the base parameters are a third larger, those of the drives equal (six draws).
"""

_FULL_REST_S = 2 * REST_S
"""Shorter rest is not cut."""

_NOISES, _STEPS, _SHARE, _TORQUE_SHARE = 6.0, 1.5, 0.002, 0.05
"""A channel rests while it is within so many standard deviations of its noise, steps of its
resolution, or this share of its range: of a position, of a torque. A robot that stands still while
its torques change is not at rest: friction holds it, which is part of the experiment."""

_SOME = 4
"""Every so many samples show whether a channel has coarse steps, without sorting all of them."""

_SMOOTHED_S = 0.1
"""Moving average of the torques [s], which are noisy, before they are compared."""

_JUMP = 4.0
"""A position was frozen if it then jumps by this multiple of its largest usual changes."""

_REPEATS, _MOVES = 0.05, 0.01
"""Largest share of repeated samples of a noisy torque; a joint moves if its position changes by
this share of its range."""


def usable(log: Log, shortest_s: float = 0.0) -> Log:
    """Return a log without rest at its ends and without the time in which a channel is frozen.

    `shortest_s`: time that remains at least, with some of the rest. The excluded samples are
    reported.
    """
    return without_frozen(_without_rest(log, shortest_s))


def _without_rest(log: Log, shortest_s: float) -> Log:
    """Return a log without the rest of all joints before their first and after their last motion.

    Up to `REST_S` of rest remains. A log in which nothing moves stays as it is.
    """
    time, before, after, moves = log.time, np.inf, np.inf, False
    window = max(1, round(_SMOOTHED_S / typical_step(time)))
    for name, values in log.columns().items():
        if quantity_of(name).is_slow:
            continue
        share, count = (_SHARE, 1) if quantity_of(name).is_position else (_TORQUE_SHARE, window)
        least = share * float(np.ptp(values))
        # its 5th percentile of n steps is at most ptp / 0.95 n
        if len(np.unique(values[::_SOME])) < 1.1 * _STEPS / share:
            least = max(_STEPS * resolution(values), least)
        rest = _rest_s(time, values, least, count)
        before = min(before, rest)
        # Reversed in time with negative stamps: these increase, and the rest at the end is at the
        # start.
        after = min(after, _rest_s(-time[::-1], values[::-1], least, count))
        moves |= quantity_of(name).is_position and np.isfinite(rest)
    if not moves:
        return log
    rests = (length if np.isfinite(length) else 0.0 for length in (before, after))
    cut = np.array([length - REST_S if length > _FULL_REST_S else 0.0 for length in rests])
    # Both cuts shrink alike until `shortest_s` remains.
    cut *= min(1.0, max(float(time[-1] - time[0]) - shortest_s, 0.0) / max(np.sum(cut), REST_S))
    if not np.any(cut):
        return log
    # `between` excludes its end: the next float above it includes the sample at the end itself.
    part = log.between(time[0] + cut[0], np.nextafter(time[-1] - cut[1], np.inf))
    action = f"{cut[0]:.3g} s before and {cut[1]:.3g} s after the motion are excluded"
    count = len(time) - len(part.time)
    return replace(part, report=(*log.report, Repair("time_s", REST, count, time[0], action)))


def _rest_s(time: Array, values: Array, least: float, count: int) -> float:
    """Return the time [s] that a channel (T,) rests at its start; infinite if it always does.

    It rests while its means of `count` samples are within `least` and their noise of the first.
    """
    first = values[: max(3, int(np.searchsorted(time, time[0] + REST_S)))]
    noise = white_noise(first, robust=True) / np.sqrt(count)  # of a mean of `count` samples
    means = _moving_mean(values, min(count, len(values)))
    moved = np.abs(means - np.mean(first)) > max(_NOISES * noise, least)
    return float(time[np.argmax(moved)] - time[0]) if np.any(moved) else np.inf


def _moving_mean(values: Array, count: int) -> Array:
    """Return the means of `count` samples about each of a channel (T,), of fewer at its ends."""
    first = np.maximum(np.arange(len(values)) - count // 2, 0)
    last = np.minimum(first + count, len(values))
    # Less the first value, since a large mean would cost the sums their digits.
    sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
    return np.asarray(values[0] + (sums[last] - sums[first]) / (last - first))


def without_frozen(log: Log) -> Log:
    """Return a log without the samples at which a channel is frozen while the robot moves."""
    bad, repairs = np.zeros(len(log.time), dtype=bool), []
    for name, values in log.columns().items():
        repeated = _long_repeats(log.time, values)
        if quantity_of(name).is_slow or quantity_of(name).is_command or not np.any(repeated):
            continue
        if quantity_of(name).is_position:
            frozen = _frozen_positions(values, repeated)
        else:
            logged = log.logged(name.rsplit(".", 1)[0]).items()
            sides = [samples for field, samples in logged if quantity_of(field).is_position]
            frozen = _frozen_torques(values, repeated, sides)
        if np.any(frozen):
            longest = max(log.time[end - 1] - log.time[start] for start, end in runs(frozen))
            action = f"repeated for up to {longest:.3g} s; excluded"
            at = float(log.time[np.argmax(frozen)])
            repairs.append(Repair(name, FROZEN, len(runs(frozen)), at, action))
            bad |= frozen
    if not repairs:
        return log
    if np.mean(bad) > MOST_EXCLUDED:
        raise LogError(
            f"channels of the log are frozen in {np.mean(bad):.0%} of its samples, allowed "
            f"{MOST_EXCLUDED:.0%}; {repairs[0]}"
        )
    return replace(log.at(~bad), report=(*log.report, *repairs))


def _long_repeats(time: Array, values: Array) -> BoolArray:
    """Return the mask (T,) of samples that repeat a value for longer than gaps are bridged."""
    repeats = np.zeros(len(values), dtype=bool)
    # A run begins at the second of equal values; the first is a measurement, hence `start` - 1.
    spans = runs(np.concatenate([[False], np.diff(values) == 0.0]))
    long = time[spans[:, 1] - 1] - time[spans[:, 0] - 1] > longest_bridge(time)
    for start, end in spans[long]:
        repeats[start:end] = True
    return repeats


def _frozen_positions(values: Array, repeated: BoolArray) -> BoolArray:
    """Return the repetitions of a position (T,) after which it jumps, or that begin in motion.

    A joint that rests starts and stops gradually: its change from sample to sample is then no
    larger than usual.
    """
    changes = np.abs(np.diff(values))
    usual, large = np.percentile(changes[changes > 0.0], (50, 99)) if np.any(changes) else (0, 0)
    frozen = repeated.copy()
    for start, end in runs(repeated):
        before = values[max(start - 1 - _BEFORE, 0) : start]
        # At the end of a log there is no jump: a position is frozen there if it stops from full
        # speed.
        stops = len(before) > _BEFORE and abs(before[-1] - before[0]) > _BEFORE * usual
        jumps = end < len(values) and abs(values[end] - values[end - 1]) > _JUMP * large
        frozen[start:end] = jumps or (end == len(values) and stops)
    return frozen


_BEFORE = 8
"""Steps before a stop over which the speed is averaged."""


def _frozen_torques(values: Array, repeated: BoolArray, positions: list[Array]) -> BoolArray:
    """Return the repetitions of a noisy torque, current or voltage (T,) while its joint moves.

    Zero and the extremes may be repeated: the motor is off, or saturated.
    """
    changes = np.diff(values[~repeated])
    # A coarse torque repeats values anyway, so that a repetition is no sign of a frozen channel.
    if np.mean(repeated) > MOST_EXCLUDED or np.sum(changes == 0.0) >= _REPEATS * len(changes):
        return np.zeros_like(repeated)
    frozen = repeated & ~np.isin(values, [0.0, np.min(values), np.max(values)])
    for start, end in runs(frozen):
        moves = [np.ptp(x[start:end]) > _MOVES * np.ptp(x) for x in positions]
        frozen[start:end] = any(moves)
    return frozen


MOST_EXCLUDED = 0.5
"""A log is refused if more than this share of its time lies in holes and too short stretches."""


@dataclass(frozen=True)
class Hole:
    """An interval without samples, between two samples [s], too long to be interpolated."""

    start_s: float
    end_s: float

    @property
    def length_s(self) -> float:
        """Length of the interval."""
        return self.end_s - self.start_s

    def __str__(self) -> str:
        return f"{self.length_s:.3g} s at t = {self.start_s:.6g} s"


def holes(time: Array) -> list[Hole]:
    """Return the holes of increasing time stamps (T,) [s]: steps too long to be bridged."""
    before = np.flatnonzero(np.diff(time) > longest_bridge(time))
    return [Hole(float(time[row]), float(time[row + 1])) for row in before]


def check_whole(log: Log) -> None:
    """Raise LogError naming the first hole of a log, if it has any."""
    gaps = holes(log.time)
    if gaps:
        raise LogError(
            f"the log has holes in time ({len(gaps)} found, the first of {gaps[0]}), in which "
            "the motion is unknown: take a part without one, log.between(start_s, end_s)"
        )


def stretches(log: Log, shortest_s: float = 0.0) -> list[Log]:
    """Return the parts of a log between its holes that are `shortest_s` or longer.

    A log without a hole is returned unchanged. Otherwise the `report` of the first part has one
    more entry with the number of holes and the excluded share of the time. Raises LogError if that
    share is above one half.
    """
    gaps = holes(log.time)
    if not gaps:
        return [log]
    # The first sample behind a hole is at its end, and starts the next stretch.
    edges = [-np.inf, *(hole.end_s for hole in gaps), np.inf]
    places = np.searchsorted(log.time, edges)
    spans = [slice(*edge) for edge in pairwise(places)]
    lengths = [float(log.time[span.stop - 1] - log.time[span.start]) for span in spans]
    used = [
        place
        for place, span in enumerate(spans)
        if span.stop - span.start >= MINIMUM_SAMPLES and lengths[place] >= shortest_s
    ]
    whole = float(log.time[-1] - log.time[0])
    excluded = 1.0 - sum(lengths[place] for place in used) / whole
    worst = max(gaps, key=lambda hole: hole.length_s)
    if excluded > MOST_EXCLUDED:
        raise LogError(
            f"the log has holes in time ({len(gaps)} found, the longest of {worst}): they and the "
            f"stretches between them that are too short to use are {excluded:.0%} of "
            f"{whole:.4g} s, allowed {MOST_EXCLUDED:.0%}; record again without losing samples, or "
            "pass the good stretches as separate logs, log.between(start_s, end_s)"
        )
    parts = [log.between(log.time[spans[place].start], edges[place + 1]) for place in used]
    short = len(spans) - len(used)
    stubs = f" ({short} stretches between them are too short)" if short else ""
    action = (
        f"of up to {worst}; {excluded:.1%} of the log's time is excluded{stubs}, and so are the "
        "filter transients around them"
    )
    repair = Repair("time_s", HOLES, len(gaps), gaps[0].start_s, action)
    reports = [(*log.report, repair), *[()] * (len(parts) - 1)]
    return [replace(part, report=report) for part, report in zip(parts, reports, strict=True)]
