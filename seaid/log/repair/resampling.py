"""Interpolation of samples at other times, and its error over gaps."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from seaid._arrays import Array, BoolArray, white_noise
from seaid.log.filtering import low_pass
from seaid.log.repair.clocks import longest_bridge, longest_step, typical_step
from seaid.log.repair.data import is_position

_CLOSE = 0.3
"""Samples closer than this part of the typical step are merged."""

_WINDOWS, _FEWEST_WINDOWS = 60, 5
"""Test windows of the error of gaps: most, and fewest."""

_NOISES = 2.0
"""Multiple of the noise that is subtracted from the error of gaps."""


def interpolated(time: Array, values: Array, wanted: Array, *, smooth: bool) -> Array:
    """Return samples (T,) of a channel at `wanted` (W,) [s], within its first and last stamp.

    `smooth` (positions): a cubic spline, whose error falls with the fourth power of the step; a
    linear interpolation would bias the derivatives. Otherwise (torques, which jump and are noisy):
    the modified Akima spline, which does not overshoot (Akima 1970). Torques over gaps and
    positions over holes are interpolated linearly, because a slope there would be that of the noise
    at the ends. Samples closer than 0.3 of the typical step are merged first.
    """
    from scipy.interpolate import Akima1DInterpolator, CubicSpline

    origin = time[0]
    time, values = _merged(time - origin, values)
    if smooth:
        found, longest = CubicSpline(time, values)(wanted - origin), longest_bridge(time)
    else:
        akima = Akima1DInterpolator(time, values, method="makima")
        found, longest = akima(wanted - origin), longest_step(time)
    straight = in_gap(time, wanted - origin, longest)
    found[straight] = np.interp(wanted[straight] - origin, time, values)
    return np.asarray(found)


def on_time(
    time: Array, channels: Mapping[str, Array], delays_s: Mapping[str, float]
) -> tuple[BoolArray, dict[str, Array]]:
    """Return the mask (T,) of the times that late channels cover too, and their values then.

    The samples of a late channel show the state so many seconds before their time.
    """
    late, early = max([0.0, *delays_s.values()]), min([0.0, *delays_s.values()])
    kept = (time >= time[0] - early) & (time <= time[-1] - late)
    return kept, {
        name: interpolated(time, channels[name], time[kept] + delay, smooth=is_position(name))
        for name, delay in delays_s.items()
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
    merged_time = np.add.reduceat(time, starts) / counts
    merged = np.add.reduceat(values, starts) / counts
    merged_time[[0, -1]] = time[[0, -1]]
    return merged_time, merged


def resampled(
    time: Array, values: Array, grid: Array, rate_hz: float, own_rate_hz: float, *, smooth: bool
) -> Array:
    """Return a channel on a uniform grid, low-pass filtered if the grid is the coarser one."""
    finer = math.ceil(own_rate_hz / rate_hz - 0.1)
    if finer <= 1:
        return interpolated(time, values, grid, smooth=smooth)
    count = (len(grid) - 1) * finer + 1
    fine = grid[0] + np.arange(count) / (rate_hz * finer)
    dense = interpolated(time, values, np.minimum(fine, grid[-1]), smooth=smooth)
    return low_pass(dense[:, None], rate_hz * finer, 0.4 * rate_hz)[::finer, 0]


def gap_error(
    time: Array, values: Array, longest_step_s: float, longest_bridge_s: float
) -> float | None:
    """Return the rms error of interpolating the gaps of a position (T,) over its deviation.

    Gaps are steps above `longest_step_s`; steps above `longest_bridge_s` are holes. Known stretches
    of the gaps' lengths are removed and interpolated. The error of the channel is
    max(rms difference - 2 noise, 0) sqrt(share of the time in gaps) / standard deviation. None if
    the log is too short for five test windows.
    """
    steps, spread = np.diff(time), float(np.std(values))
    gaps = np.sort(steps[(steps > longest_step_s) & (steps <= longest_bridge_s)])[::-1]
    if not len(gaps) or spread == 0:
        return 0.0
    duration = float(time[-1] - time[0])
    count = min(_WINDOWS, int(duration / (3.0 * gaps[0])) - 1)
    if count < _FEWEST_WINDOWS:
        return None
    starts = time[0] + duration * (np.arange(count) + 0.5) / count
    window = np.searchsorted(starts, time, side="right") - 1
    lengths = np.resize(gaps, count)[window]
    taken = (window >= 0) & (time < starts[np.maximum(window, 0)] + lengths)
    taken[[0, 1, -2, -1]] = False
    if not np.any(taken):
        return 0.0
    bridged = interpolated(time[~taken], values[~taken], time[taken], smooth=True)
    noise = white_noise(values, robust=True)
    error = float(np.sqrt(np.mean((bridged - values[taken]) ** 2)))
    share = float(np.sum(gaps)) / duration
    return max(error - _NOISES * noise, 0.0) / spread * math.sqrt(share)
