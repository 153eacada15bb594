"""Repair of one channel: dropouts, wraps, saturation and gaps; its samples at other times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, is_constant, resolution, runs, white_noise
from seaid.log.channels import OF_CONTACTS, Interpolation, quantity_of, refusal
from seaid.log.filtering import low_pass, runs_that
from seaid.log.repair import FEWEST, Channel, Repairs, Report
from seaid.log.repair.clocks import RepairedClock, longest_bridge, longest_step, typical_step

_CLOSE = 0.3
"""Samples closer than this part of the typical step are merged."""

_WINDOWS, _FEWEST_WINDOWS = 60, 5
"""Test windows of the error of gaps: most, and fewest."""

_RARELY = 0.7
"""Share of the rate of the grid below which commands come more rarely than its samples."""

_ROUNDED = 0.01
"""Distance of a stamp over the typical step that is rounding: steps of commands that are held would
become two, and repeated ones none."""

_NOISES = 2.0
"""Multiple of the noise that is subtracted from the error of gaps."""


def interpolated(time: Array, values: Array, wanted: Array, how: Interpolation) -> Array:
    """Return samples (T,) of a channel at `wanted` (W,) [s], within its first and last stamp.

    Positions: a cubic spline, whose error falls with the fourth power of the step; a linear
    interpolation would bias the derivatives. Torques, which jump and are noisy: the modified Akima
    spline, which does not overshoot (Akima 1970). Torques over gaps and positions over holes are
    interpolated linearly, because a slope there would be that of the noise at the ends, and so are
    commands, which stay what they are next to their stamps. Samples closer than 0.3 of the typical
    step are merged first.
    """
    from scipy.interpolate import Akima1DInterpolator, CubicSpline

    if not np.any(np.isfinite(values)):
        return np.full(len(wanted), np.nan)  # a channel that was not measured
    if how == "linear":
        samples = np.interp(wanted, time, values)
        after = np.clip(np.searchsorted(time, wanted), 1, len(time) - 1)
        nearest = np.where(wanted - time[after - 1] < time[after] - wanted, after - 1, after)
        # A rounded stamp would give a mean of two commands where a command steps.
        is_there = np.abs(time[nearest] - wanted) < _ROUNDED * typical_step(time)
        return np.asarray(np.where(is_there, values[nearest], samples))
    origin = time[0]
    time, values = _merged(time - origin, values)
    if how == "spline":
        samples, longest = CubicSpline(time, values)(wanted - origin), longest_bridge(time)
    else:
        akima = Akima1DInterpolator(time, values, method="makima")
        # Positions are bridged over gaps by the spline, since they are smooth; torques are not.
        samples, longest = akima(wanted - origin), longest_step(time)
    straight = in_gap(time, wanted - origin, longest)
    samples[straight] = np.interp(wanted[straight] - origin, time, values)
    return np.asarray(samples)


def on_time(
    time: Array, channels: Mapping[str, Array], delays_s: Mapping[str, float]
) -> tuple[BoolArray, dict[str, Array]]:
    """Return the mask (T,) of the times that late channels cover too, and their values then.

    The samples of a late channel show the state so many seconds before their time.
    """
    late, early = max([0.0, *delays_s.values()]), min([0.0, *delays_s.values()])
    kept = (time >= time[0] - early) & (time <= time[-1] - late)
    # A late sample shows the state `delay` before its stamp: that at t has the stamp t + delay.
    return kept, {
        x: interpolated(time, channels[x], time[kept] + delay, quantity_of(x).interpolation)
        for x, delay in delays_s.items()
    }


def in_gap(time: Array, wanted: Array, longest_s: float) -> BoolArray:
    """Return the mask (W,) of times `wanted` inside a step of `time` (T,) above `longest_s`."""
    after = np.clip(np.searchsorted(time, wanted), 1, len(time) - 1)
    inside = (wanted > time[after - 1]) & (wanted < time[after])
    return np.asarray(inside & (time[after] - time[after - 1] > longest_s))


def _merged(time: Array, values: Array) -> tuple[Array, Array]:
    """Return a channel with bursts of samples replaced by their means; the end stamps stay."""
    shortest = _CLOSE * typical_step(time)
    if np.min(np.diff(time)) >= shortest:
        return time, values
    starts, open_since = [0], time[0]
    for place, stamp in enumerate(time.tolist()):
        if stamp - open_since >= shortest:
            starts.append(place)
            open_since = stamp
    counts = np.diff([*starts, len(time)])
    merged_time, merged = (np.add.reduceat(x, starts) / counts for x in (time, values))
    # The means of the first and last burst would shorten the range of the channel, and what is
    # wanted at its ends would be extrapolated.
    merged_time[[0, -1]] = time[[0, -1]]
    return merged_time, merged


def resampled(
    time: Array, values: Array, grid: Array, rate_hz: float, own_rate_hz: float, how: Interpolation
) -> Array:
    """Return a channel on a uniform grid, low-pass filtered if the grid is the coarser one.

    Of commands that are sent more rarely than the grid each one holds until the next one comes.
    """
    if how == "linear" and own_rate_hz < _RARELY * rate_hz:
        last = np.searchsorted(time, grid + 1e-6 / rate_hz, side="right") - 1
        return np.asarray(values[np.maximum(last, 0)])
    # A whole multiple of the grid, so that the low pass is followed by plain decimation; up to 10 %
    # above the grid's rate there is next to nothing to alias.
    finer = math.ceil(own_rate_hz / rate_hz - 0.1)
    if finer <= 1:
        return interpolated(time, values, grid, how)
    count = (len(grid) - 1) * finer + 1
    fine = grid[0] + np.arange(count) / (rate_hz * finer)
    dense = interpolated(time, values, np.minimum(fine, grid[-1]), how)
    return low_pass(dense[:, None], rate_hz * finer, 0.4 * rate_hz)[::finer, 0]


def gap_error(time: Array, values: Array, longest_step_s: float, longest_bridge_s: float) -> float:
    """Return the rms error of interpolating the gaps of a position (T,) over its deviation.

    Gaps are steps above `longest_step_s`; steps above `longest_bridge_s` are holes. Known stretches
    of the gaps' lengths are removed and interpolated. The error of the channel is
    max(rms difference - 2 noise, 0) sqrt(share of the time in gaps) / standard deviation;
    infinite if the log is too short for five test windows.
    """
    steps, spread = np.diff(time), float(np.std(values))
    gaps = np.sort(steps[(steps > longest_step_s) & (steps <= longest_bridge_s)])[::-1]
    if not len(gaps) or spread == 0:
        return 0.0
    duration = float(time[-1] - time[0])
    count = min(_WINDOWS, int(duration / (3.0 * gaps[0])) - 1)
    if count < _FEWEST_WINDOWS:
        return math.inf
    starts = time[0] + duration * (np.arange(count) + 0.5) / count
    window = np.searchsorted(starts, time, side="right") - 1
    lengths = np.resize(gaps, count)[window]
    taken = (window >= 0) & (time < starts[np.maximum(window, 0)] + lengths)
    # The ends stay, because the spline must not extrapolate.
    taken[[0, 1, -2, -1]] = False
    if not np.any(taken):
        return 0.0
    bridged = interpolated(time[~taken], values[~taken], time[taken], "spline")
    error = float(np.sqrt(np.mean((bridged - values[taken]) ** 2)))
    share = float(np.sum(gaps)) / duration
    # The error exists in the gaps only, a share s of the time: over the whole log its rms is
    # sqrt(s) times that of the gaps.
    return max(error - _NOISES * white_noise(values, robust=True), 0.0) / spread * math.sqrt(share)


_FARTHER = 2.0
"""A wrap exceeds this multiple of the neighbouring steps."""

_ALIKE = 0.02
"""Relative tolerance of the size of wraps."""

_FULL = 1.0 + 1e-3
"""Largest range of a wrapped position, in periods."""

_STRAY = 0.1
"""Largest share of jumps that do not look like wraps."""

_CLEAR = 0.4
"""Largest distance from the extrapolated position, in periods, at which a wrap is unambiguous."""

_GAP, _MEAN = 1.5, 5
"""A step longer than this many median steps is a gap, over which the mean speed of this many steps
on both sides is extrapolated."""

_TURN = 2 * np.pi
"""A turn [rad]."""


def wrap_period(time: Array, values: Array) -> float | None:
    """Return the period by which a position (T,) wraps around, None if it does not.

    A wrap is a step of more than half the range and far larger than its neighbours, with the same
    speed before and after. Nearly all wraps must have the same size, which the range does not
    exceed. A period close to one, a half or a quarter turn, or to a power of two of the encoder's
    resolution (4096 counts), is rounded to that value.
    """
    steps, durations = np.diff(values), np.diff(time)
    jumps = np.flatnonzero(np.abs(steps) > 0.5 * np.ptp(values))
    inner = jumps[(jumps > 0) & (jumps < len(steps) - 1)]
    # At a gap the step is that of several samples, so the neighbouring speeds do not predict it.
    inner = inner[durations[inner] < _GAP * np.median(durations)]
    if not len(inner):
        return None
    # noise at the end of a turn wraps a position forth and back, from one end of it to the other
    size = float(np.median(np.abs(steps[jumps])))
    is_whole = bool(_turn(size, values)) and np.ptp(np.abs(steps[jumps])) < _ALIKE * size
    # The neighbours of a wrap may be wraps themselves, back and forth: their steps modulo the
    # period.
    near = steps - size * np.rint(steps / size) if is_whole else steps
    rates = near / durations
    before, after = rates[inner - 1], rates[inner + 1]
    usual = np.maximum(np.abs(before), np.abs(after)) * durations[inner]
    if np.mean(np.abs(steps[inner]) < _FARTHER * usual) > _STRAY:
        return None
    # The jump is the period plus the motion during that step, which the speeds about it give.
    periods = np.abs(steps[inner] - 0.5 * (before + after) * durations[inner])
    period = float(np.median(periods))
    period = _turn(period, values) or period
    alike = np.abs(periods - period) <= _ALIKE * period + 0.5 * usual
    # A wrap jumps against the motion; a position that jumps forth and back is a glitch.
    against = np.sign(steps[inner]) == -np.sign(before + after)
    strays = np.mean(~against & (usual > 1e-3 * period))
    # A position in [0, period) never covers more than a period; multi-turn positions do.
    is_within = np.ptp(values) <= _FULL * period
    is_wrap = is_within & np.any(against) & (max(np.mean(~alike), strays) <= _STRAY)
    return period if is_wrap else None


def unwrapped(name: str, time: Array, values: Array, period: float) -> tuple[Array, IndexArray]:
    """Return a position (T,) without wraps, and the samples behind them.

    Each sample is shifted by whole periods to be nearest to the position extrapolated with the last
    speed, so a position in motion may move by more than half a period between samples. Raises
    LogError if it is more than 0.4 of a period away from the extrapolation.
    """
    steps = np.diff(values)
    nearest = steps - period * np.round(steps / period)
    # Below a quarter of the period per sample the nearest step is the true one, and extrapolation
    # with its noise is not needed.
    if np.max(np.abs(nearest), initial=0.0) > period / 4:
        nearest = _predicted_steps(name, time, nearest, period)
    turns = np.round((nearest - steps) / period)
    whole = values + period * np.concatenate([[0.0], np.cumsum(turns)])
    return whole, np.flatnonzero(turns) + 1


def _predicted_steps(name: str, time: Array, nearest: Array, period: float) -> Array:
    """Return steps shifted by whole periods to be nearest to the speed around them."""
    steps, durations = nearest.copy(), np.diff(time)
    gap = durations > _GAP * np.median(durations)
    rate, doubt, expected = steps[0] / durations[0], np.zeros(len(steps)), steps.copy()
    for place in np.flatnonzero(~gap[1:]) + 1:
        expected[place] = rate * durations[place]
        steps[place] += period * np.round((expected[place] - steps[place]) / period)
        rate = steps[place] / durations[place]
    for place in np.flatnonzero(gap[1:]) + 1:
        sides = slice(max(0, place - _MEAN), place), slice(place + 1, place + 1 + _MEAN)
        speeds = [np.sum(steps[x]) / np.sum(durations[x]) for x in sides if len(steps[x])]
        # The trapezoidal rule over the gap; the speeds before and after bound what is uncertain.
        expected[place] = np.mean(speeds) * durations[place]
        doubt[place] = 0.5 * np.ptp(speeds) * durations[place]
        steps[place] += period * np.round((expected[place] - steps[place]) / period)
    off = np.maximum(np.abs(steps - expected), doubt)
    unclear = np.flatnonzero((off > _CLEAR * period) & (np.abs(steps) > period / 4))
    for place in unclear[:1]:
        wrap = {"step": abs(steps[place]), "duration": durations[place], "share": _CLEAR}
        raise refusal("ambiguous_wraps", name=name, time=time[place], period=period, **wrap)
    return steps


def _turn(period: float, values: Array) -> float | None:
    """Return the fraction of a turn, or 2^k steps, to which an estimated period is close."""
    step = resolution(values)
    candidates = [_TURN, _TURN / 2, _TURN / 4, 2 * _TURN]
    if step > 0 and period / step < 2**24:
        candidates.append(step * 2.0 ** round(np.log2(period / step)))
    near = min(candidates, key=lambda candidate: abs(candidate - period))
    return float(near) if abs(near - period) <= _ALIKE * period else None


_FAR = 4.0
"""A dropout is farther from the signal than this multiple of the usual change or resolution."""

_SIMILAR = 4.0
"""Largest ratio of rates of change that count as equal."""

_STUCK, _PILED = 3, 4.0
"""A saturated extreme occurs at least this often, and this many times as often as nearby levels."""

SLOWER = 1 / 3
"""Share of held samples above which a sensor samples more slowly than its log."""


def zero_dropouts(values: Array) -> BoolArray:
    """Return the mask (T,) of samples that are exactly zero while the neighbours are far from it.

    Far means several times the neighbouring changes and the resolution. Zeros that reach an end of
    the log count too, if there is such a jump at their other end.
    """
    return runs_that(partial(_is_sudden_zero, values, resolution(values)), values == 0.0)


def held_dropouts(values: Array, fewest: int = 2) -> BoolArray:
    """Return the mask (T,) of samples that repeat the previous one while the signal moves.

    A value repeated for `fewest` samples or more is held if the next change makes up for it: its
    rate over the whole time is that of the changes before and after, and it is several times the
    resolution, so a coarse encoder within one step is not held. If more than a third of the samples
    are held, the sensor is slower than its log, and all repetitions of that length are held.
    """
    dropouts = np.zeros(len(values), dtype=bool)
    if not len(values):
        return dropouts
    starts = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0]))
    lengths = np.diff(np.concatenate([starts, [len(values)]]))
    changes = np.diff(values[starts])
    if len(changes) < 3:
        return dropouts
    rates = changes / lengths[:-1]
    with np.errstate(divide="ignore"):
        before, after = rates[:-2] / rates[1:-1], rates[2:] / rates[1:-1]
    step = resolution(values)
    alike = [(ratio > 1 / _SIMILAR) & (ratio < _SIMILAR) for ratio in (before, after)]
    large = np.abs(changes[1:-1]) > _FAR * step
    fast = np.minimum(np.abs(changes[:-2]), np.abs(changes[2:])) > 2 * step
    held = lengths[1 : len(changes) - 1] >= fewest
    # Runs of equal values; `rates` are changes over the lengths of the runs before them, so that a
    # value held too long has the usual rate, and one that rests has a far smaller one.
    stale = 1 + np.flatnonzero(held & alike[0] & alike[1] & large & fast)
    if np.sum(lengths[stale] - 1) > SLOWER * len(values):
        # All repeats of a slow sensor, also those at which the signal turns and no test holds.
        stale = np.flatnonzero(lengths <= np.max(lengths[stale]))
    for run in stale:
        dropouts[starts[run] + 1 : starts[run] + lengths[run]] = True
    return dropouts


_CHANCE = 1e-6
"""Probability below which changes of a channel do not fall on every nth sample by chance."""


def held_over(time: Array, values: Array) -> int:
    """Return the number of samples over which a channel (T,) is held throughout, 1 if it is not.

    It changes only at every nth sample of its log, always the same ones. A coarse channel, or one
    at rest, repeats values too, but changes at any sample: C changes fall on the same of n samples
    with a probability of n^(1 - C).
    """
    steps = np.diff(time)
    samples = np.cumsum(np.rint(steps / np.median(steps))).astype(np.intp)  # gaps have theirs
    changes = samples[np.diff(values) != 0.0]
    count = int(np.gcd.reduce(np.diff(changes))) if len(changes) > 1 else 1
    # log of n^(1 - C), because the power itself underflows for long logs.
    by_chance = (1 - len(changes)) * math.log(max(count, 1)) > math.log(_CHANCE)
    return 1 if by_chance else count


def _is_sudden_zero(values: Array, step: float, start: int, end: int) -> bool:
    sides = []
    for edge, near in ((start - 1, values[:start][-8:]), (end, values[end:][:8][::-1])):
        near = near[near != 0.0]
        if len(near) < 3:
            continue
        usual = float(np.max(np.abs(np.diff(near))))
        sides.append(abs(float(values[edge])) > _FAR * max(usual, step))
    return bool(sides) and all(sides)


def saturated(values: Array) -> BoolArray:
    """Return the mask (T,) of samples of a torque, current or voltage that are saturated.

    The largest or smallest value counts as saturation if it occurs far more often than any of the
    five nearest values.
    """
    stuck = np.zeros(len(values), dtype=bool)
    if not np.ptp(values) > 0:
        return stuck
    levels, counts = np.unique(values, return_counts=True)
    for place, others in ((0, counts[1:6]), (-1, counts[-6:-1])):
        piled = counts[place] >= max(_PILED * np.max(others), _STUCK)
        # A torque that never has the other sign rests at zero: that is no saturation.
        if piled and levels[place] != 0.0:
            stuck |= values == levels[place]
    return stuck


def encoder_noise(position: Array) -> float:
    """Return the standard deviation of noise and resolution of an encoder (T,).

    Noise has 924 times its variance in sixth differences, where a motion leaves little of itself.
    """
    # 1.4826 times the median of |x| is the standard deviation of Gaussian noise; outliers and
    # reversals have no part in it.
    sixth = 1.4826 * float(np.median(np.abs(np.diff(position, 6)))) / math.sqrt(924)
    repeats = bool(np.any(np.diff(position) == 0))
    return float(max(sixth, resolution(position) / math.sqrt(12) if repeats else 0.0))


def beyond_extremes(values: Array) -> Array:
    """Return shapes (T, 2) of what a channel (T,) that is `saturated` may lack at its extremes.

    It is as much all the time, or follows a parabola between the ends of each time at an extreme,
    as a smooth signal does to second order.
    """
    # Single precision, since samples between two equal ones may differ in the last digit.
    stuck = saturated(values.astype(np.float32))
    parabola = np.zeros(len(values))
    for start, end in runs(stuck):
        place = np.arange(end - start)
        parabola[start:end] = (place + 1) * (end - start - place)
    return np.asarray(np.sign(values)[:, None] * np.column_stack([stuck, parabola]))


@dataclass
class _Remaining:
    """The samples of a channel that are valid so far, and how many are lost."""

    channel: Channel
    time: Array
    values: Array
    report: Report
    lost: int = 0

    def add(self, kind: str, where: BoolArray | IndexArray, **values: Any) -> None:
        """Report a fault of some samples."""
        self.report.add(self.channel.name, kind, self.time, where, **values)

    def exclude(self, kind: str, bad: BoolArray) -> None:
        """Exclude and report the samples of a mask (T,)."""
        self.add(kind, bad)
        self.time, self.values = self.time[~bad], self.values[~bad]
        self.lost += int(np.sum(bad))


def repaired_channel(channel: Channel, clock: RepairedClock, report: Report) -> tuple[Array, Array]:
    """Return stamps and values of the valid samples of a channel, without wraps."""
    values = channel.values[clock.rows]
    if np.all(np.isnan(values)):
        return np.empty(0), np.empty(0)
    samples = _Remaining(channel, clock.time, values, report)
    samples.exclude("values that are no number", ~np.isfinite(values))
    if channel.quantity.is_command:  # zeros and repeated values are what was sent, and no faults
        _unwrap(samples)
    elif channel.quantity.name not in OF_CONTACTS:
        _repair_measured(samples)
    return samples.time, samples.values


def _repair_measured(samples: _Remaining) -> None:
    """Exclude what a sensor did not measure. Raises LogError for too much of it."""
    channel, total = samples.channel, samples.lost + len(samples.values)
    if is_constant(samples.values):
        samples.add("constant channel", np.zeros(1, dtype=np.intp), value=samples.values[0])
    samples.exclude("sudden zeros", zero_dropouts(samples.values))
    if channel.quantity.is_slow:  # so that neither repeats nor gaps are faults
        return
    _unwrap(samples)
    _exclude_held(samples)
    counts = {"lost": samples.lost, "total": total}
    samples.report.check("lost_samples", samples.lost / total, name=channel.name, **counts)
    if len(samples.values) >= FEWEST:
        _report_saturation(samples)
        _check_gap(samples)


def _exclude_held(samples: _Remaining) -> None:
    """Exclude the samples that repeat the last one while the signal moves."""
    # A noisy torque repeats a value now and then; two equal ones in a row are no fault. A motor may
    # get torques that are held throughout: whether these are late the motion shows, see `checks`.
    is_position, lost = samples.channel.quantity.is_position, samples.lost
    held = held_dropouts(samples.values, 2 if is_position else 3)
    held &= is_position or held_over(samples.time, samples.values) == 1
    is_slower = np.sum(held) > SLOWER * len(held)
    samples.exclude("values of a slower sensor" if is_slower else "held values", held)
    if is_slower:  # its samples are simply fewer than those of its log
        samples.lost = lost


def _unwrap(samples: _Remaining) -> None:
    channel, time, values = samples.channel, samples.time, samples.values
    # The angle of a base is in rad by its name, so that its turn is known.
    known = 2 * math.pi if channel.quantity.kind == "angle" else channel.period
    period = known
    if period is None and channel.quantity.is_position:
        period = wrap_period(time, values)
    if period is not None and len(values) >= FEWEST:
        samples.values, wraps = unwrapped(channel.name, time, values, period)
        origin = "as given" if known else "estimated from the jumps"
        samples.add("wraps", wraps, period=period, origin=origin)


def _report_saturation(samples: _Remaining) -> None:
    """Report saturation of a torque, current or voltage: `checks` show whether it is wrong."""
    # A position has no end of its range, and what an estimator computes of a base repeats at rest.
    if samples.channel.quantity.interpolation != "spline":
        stuck = saturated(samples.values)
        samples.add("saturated samples", stuck, level=samples.values[np.argmax(stuck)])


def _check_gap(samples: _Remaining) -> None:
    """Raise LogError for a gap that cannot be interpolated; holes are excluded elsewhere."""
    time, report = samples.time, samples.report
    steps, longest, usual = np.diff(time), bridged_s(time, report.limits), longest_step(time)
    is_limited = report.limits.longest_gap_s is not None
    gap = float(np.max(steps if is_limited else np.where(steps <= longest, steps, 0.0)))
    if gap <= usual or not (is_limited or samples.channel.quantity.is_position):
        return
    where = {"gap_s": gap, "time": time[np.argmax(steps == gap)]}
    if is_limited:
        report.check("gap", gap, name=samples.channel.name, **where)
        return
    error = gap_error(time, samples.values, usual, longest)
    known = f"is {error:.1%}" if error < np.inf else "cannot be estimated, the log is too short"
    report.check("gap_error", error, name=samples.channel.name, known=known, **where)


def bridged_s(time: Array, limits: Repairs) -> float:
    """Return the longest step [s] between a channel's stamps (T,) that is interpolated."""
    if limits.longest_gap_s is None:
        return longest_bridge(time)
    return max(limits.longest_gap_s, longest_step(time))
