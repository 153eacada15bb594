"""The usable parts of a log: without rest at its ends, without frozen channels, between holes."""

from __future__ import annotations

from dataclasses import replace
from itertools import compress, pairwise
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
    time = log.time
    moving = {x: values for x, values in log.columns().items() if not quantity_of(x).is_slow}
    rests = {x: _rests_s(time, x, values) for x, values in moving.items()}
    if not any(quantity_of(x).is_position and np.isfinite(rest[0]) for x, rest in rests.items()):
        return log
    ends = np.min([*rests.values()], axis=0)
    cut = np.where((ends > _FULL_REST_S) & np.isfinite(ends), ends - REST_S, 0.0)
    # Both cuts shrink alike until `shortest_s` remains.
    cut *= min(1.0, max(float(time[-1] - time[0]) - shortest_s, 0.0) / max(np.sum(cut), REST_S))
    if not np.any(cut):
        return log
    # `between` excludes its end: the next float above it includes the sample at the end itself.
    part = log.between(time[0] + cut[0], np.nextafter(time[-1] - cut[1], np.inf))
    count, ends = len(time) - len(part.time), {"before_s": cut[0], "after_s": cut[1]}
    return replace(part, report=(*log.report, Repair.of("time_s", REST, count, time[0], **ends)))


def _rests_s(time: Array, name: str, values: Array) -> tuple[float, float]:
    """Return the time [s] that a channel rests before its first and after its last motion."""
    window = max(1, round(_SMOOTHED_S / typical_step(time)))
    share, count = (_SHARE, 1) if quantity_of(name).is_position else (_TORQUE_SHARE, window)
    least = share * float(np.ptp(values))
    # its 5th percentile of n steps is at most ptp / 0.95 n
    if len(np.unique(values[::_SOME])) < 1.1 * _STEPS / share:
        least = max(_STEPS * resolution(values), least)
    # Reversed in time with negative stamps: these increase, and the end is at the start.
    after = _rest_s(-time[::-1], values[::-1], least, count)
    return _rest_s(time, values, least, count), after


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
    masks = {name: _frozen(log, name, values) for name, values in log.columns().items()}
    masks = {name: frozen for name, frozen in masks.items() if np.any(frozen)}
    if not masks:
        return log
    repairs = [_frozen_repair(name, log.time, frozen) for name, frozen in masks.items()]
    bad = np.any([*masks.values()], axis=0)
    if np.mean(bad) > MOST_EXCLUDED:
        raise LogError(
            f"channels of the log are frozen in {np.mean(bad):.0%} of its samples, allowed "
            f"{MOST_EXCLUDED:.0%}; {repairs[0]}"
        )
    return replace(log.at(~bad), report=(*log.report, *repairs))


def _frozen_repair(name: str, time: Array, frozen: BoolArray) -> Repair:
    """Return the exclusion of the samples (T,) at which a channel is frozen."""
    spans = runs(frozen)
    longest = np.max(time[spans[:, 1] - 1] - time[spans[:, 0]])
    return Repair.of(name, FROZEN, len(spans), time[np.argmax(frozen)], most_s=longest)


def _frozen(log: Log, name: str, values: Array) -> BoolArray:
    """Return the mask (T,) of samples at which a channel is frozen while the robot moves."""
    row, repeated = quantity_of(name), _long_repeats(log.time, values)
    if row.is_slow or row.is_command or not np.any(repeated):
        return np.zeros_like(repeated)
    if row.is_position:
        return _frozen_positions(values, repeated)
    logged = log.logged(name.rsplit(".", 1)[0]).items()
    sides = [samples for field, samples in logged if quantity_of(field).is_position]
    return _frozen_torques(values, repeated, sides)


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
        frozen[start:end] = any(np.ptp(x[start:end]) > _MOVES * np.ptp(x) for x in positions)
    return frozen


MOST_EXCLUDED = 0.5
"""A log is refused if more than this share of its time lies in holes and too short stretches."""


def holes(time: Array) -> Array:
    """Return start and end (H, 2) [s] of the steps of stamps (T,) that are too long to bridge."""
    before = np.flatnonzero(np.diff(time) > longest_bridge(time))
    return np.column_stack([time[before], time[before + 1]])


def hole_text(hole: Array) -> str:
    """Return the length and the start of a hole as text."""
    return f"{hole[1] - hole[0]:.3g} s at t = {hole[0]:.6g} s"


def check_whole(log: Log) -> None:
    """Raise LogError naming the first hole of a log, if it has any."""
    gaps = holes(log.time)
    if len(gaps):
        raise LogError(
            f"the log has holes in time ({len(gaps)} found, the first of {hole_text(gaps[0])}), in "
            "which the motion is unknown: take a part without one, log.between(start_s, end_s)"
        )


def stretches(log: Log, shortest_s: float = 0.0) -> list[Log]:
    """Return the parts of a log between its holes that are `shortest_s` or longer.

    A log without a hole is returned unchanged. Otherwise the `report` of the first part has one
    more entry with the number of holes and the excluded share of the time. Raises LogError if that
    share is above one half.
    """
    gaps = holes(log.time)
    if not len(gaps):
        return [log]
    # The first sample behind a hole is at its end, and starts the next stretch.
    edges = [-np.inf, *gaps[:, 1], np.inf]
    places = np.searchsorted(log.time, edges)
    spans = [log.time[slice(*span)] for span in pairwise(places)]
    is_used = [len(x) >= MINIMUM_SAMPLES and x[-1] - x[0] >= shortest_s for x in spans]
    whole = float(log.time[-1] - log.time[0])
    excluded = 1.0 - sum(float(x[-1] - x[0]) for x in compress(spans, is_used)) / whole
    worst = hole_text(gaps[np.argmax(np.diff(gaps)[:, 0])])
    if excluded > MOST_EXCLUDED:
        raise LogError(
            f"the log has holes in time ({len(gaps)} found, the longest of {worst}): they and the "
            f"stretches between them that are too short to use are {excluded:.0%} of "
            f"{whole:.4g} s, allowed {MOST_EXCLUDED:.0%}; record again without losing samples, or "
            "pass the good stretches as separate logs, log.between(start_s, end_s)"
        )
    parts = [log.between(*edge) for edge in compress(pairwise(edges), is_used)]
    short = is_used.count(False)
    stubs = f" ({short} stretches between them are too short)" * bool(short)
    what = {"worst": worst, "excluded": excluded, "stubs": stubs}
    repair = Repair.of("time_s", HOLES, len(gaps), gaps[0, 0], **what)
    first, *others = parts
    report = (*log.report, repair)
    return [replace(first, report=report), *(replace(part, report=()) for part in others)]
