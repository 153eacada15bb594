"""Zero-phase low pass, derivatives, spikes.

The pass band of an identification, proposed from the spectra of the positions, with the reason.

Least squares takes noise in its regressor for signal: noise in the accelerations makes inertias too
small by the noise's share of their power, which grows with the fifth power of the pass band. A
band narrower than the motion, on the other hand, throws information away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError

_ORDER = 4
_ROUNDING = 1e-6
_GAUSSIAN = 1.4826
"""Standard deviation of Gaussian noise over the median of its absolute values."""

ROWS_PER_PERIOD = 4.0
"""After the low pass, so many rows a period of the cutoff say all there is."""


def low_pass(signals: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Return columns (T, any) behind a zero-phase Butterworth low pass; all of them if too high.

    A cutoff above 0.8 of half the rate, inf too, leaves the signals as they are.
    """
    if cutoff_hz >= 0.8 * rate_hz / 2:
        return signals
    from scipy.signal import sosfiltfilt

    sections = _sections(float(rate_hz), float(cutoff_hz))
    pad = min(len(signals) - 1, round(3 * rate_hz / cutoff_hz))
    return np.asarray(sosfiltfilt(sections, signals, axis=0, padtype="odd", padlen=pad))


@cache
def _sections(rate_hz: float, cutoff_hz: float) -> Array:
    """Return the low pass as second-order sections; a search filters alike hundreds of times."""
    from scipy.signal import butter

    return np.asarray(butter(_ORDER // 2, cutoff_hz, fs=rate_hz, output="sos"))


def despiked(signals: Array, half_window: int = 5, threshold: float = 4.0) -> Array:
    """Return columns (T, any) with single spikes replaced by the median around them (Hampel 1974).

    A spike is farther from the median of the window of 2 `half_window` + 1 samples than `threshold`
    times their spread, and than that of the whole column. For raw samples, before any low pass
    smears a spike over its neighbours; NaN columns stay NaN. Raises LogError for a window or a
    threshold that is not positive.
    """
    from scipy.ndimage import median_filter

    if half_window < 1 or not threshold > 0:
        raise LogError(
            "despiked needs half_window of at least 1 and a threshold more than 0, found "
            f"{half_window} and {threshold}"
        )
    window = (2 * half_window + 1, 1)
    centre = median_filter(signals, window, mode="nearest")
    off = np.abs(signals - centre)
    around = median_filter(off, window, mode="nearest")
    spread = _GAUSSIAN * np.maximum(around, np.median(off, axis=0))
    return np.where(off > threshold * spread, centre, signals)


def decimation(rate_hz: float, cutoff_hz: float) -> int:
    """Return how many samples a row of the filtered regression stands for."""
    return max(1, int(rate_hz / (ROWS_PER_PERIOD * cutoff_hz) * (1 + _ROUNDING)))


def spline_derivatives(time: Array, signals: Array) -> tuple[Array, Array, Array]:
    """Return value, first and second derivative (T, any) of an interpolating quintic spline.

    Right up to the ends, where one-sided differences are not. NaN columns stay NaN.
    """
    from scipy.interpolate import make_interp_spline

    values, first, second = (np.full_like(signals, np.nan) for _ in range(3))
    known = np.flatnonzero(np.isfinite(signals[0]))
    spline = make_interp_spline(time, signals[:, known], k=5)
    values[:, known] = signals[:, known]
    first[:, known], second[:, known] = spline(time, 1), spline(time, 2)
    return values, first, second


_FEWEST_PERIODS = 15.0
"""Periods of the cutoff that a log must hold."""

_WIDENED_HZ = 12.0
"""No log is made to hold them by a wider band than this: one of a few instants is too short."""

_ALLOWED = 0.01
_VELOCITY_SHARE, _WIDE = 0.98, 3.0
_POSITION_SHARE, _NARROW = 0.995, 2.0
_RATES = 8.0
_OUTSTANDING, _MOVING = 3.0, 10.0
_SMOOTHED_BINS = 9
_ON_GRID = 0.95


@dataclass(frozen=True)
class CutoffSelection:
    """A cutoff [Hz] and where it comes from; str() says why in words.

    `motion_hz` (narrowest, widest) is between twice the edge of the motion and three times that of
    its speed; in `noise_limit_hz` noise is one percent of the acceleration or speed (rms) of
    `channel`, the worst; `noise_floor` is the noise there [square of the channel's unit / Hz].
    `shortest_hz` and `rate_limit_hz` are what duration and sampling rate allow.
    """

    cutoff_hz: float
    reason: str
    motion_hz: tuple[float, float] = (np.nan, np.nan)
    noise_limit_hz: float = np.nan
    noise_floor: float = np.nan
    channel: str = ""
    shortest_hz: float = 0.0
    rate_limit_hz: float = np.inf

    def __str__(self) -> str:
        return f"{self.cutoff_hz:.3g} Hz, {self.reason}"


@dataclass(frozen=True)
class _Spectrum:
    """What a channel says: edges of position and speed, where its noise is too much, its floor."""

    position_hz: float
    speed_hz: float
    noise_limit_hz: float
    floor: float
    moves: bool


def propose_pass_band(
    joint: Array, motor: Array, rate_hz: float, names: Sequence[str]
) -> CutoffSelection:
    """Return the pass band for positions (T, n) of both sides, NaN columns where no encoder is.

    The widest in which noise is at most one percent (rms) of each joint's acceleration, and of each
    motor's speed where the joint has an encoder of its own (of its acceleration otherwise). The
    noise floor of a channel is the white one of its spectrum above a quarter of the rate, or that
    of its encoder's steps, if larger. Not narrower than twice the frequency below which the fastest
    channel has 99.5 % of the power of its position, where the motion is: what gears and links
    vibrate at is above. Not wider than three times that with 98 % of the power of its velocity. At
    least fifteen periods in the log (as far as 12 Hz hold them), at most an eighth of the rate.
    Channels that stand still, or move less than ten times their noise (rms), have no say.
    """
    highest = rate_hz / _RATES
    shortest = min(_FEWEST_PERIODS * rate_hz / len(joint), highest, _WIDENED_HZ)
    found: dict[str, _Spectrum] = {}
    for side, positions in (("joint", joint), ("motor", motor)):
        for index, name in enumerate(names):
            samples = positions[:, index]
            if np.isfinite(samples[0]) and np.ptp(samples) > 0:
                order = 1 if side == "motor" and np.isfinite(joint[0, index]) else 2
                found[f"{side} side of {name}"] = _spectrum(samples, rate_hz, order)
    telling = {name: one for name, one in found.items() if one.moves}
    if not telling:
        return CutoffSelection(
            highest, "an eighth of the rate: nothing moves", (np.nan, np.nan), rate_limit_hz=highest
        )
    narrowest = _NARROW * max(one.position_hz for one in telling.values())
    widest = max(_WIDE * max(one.speed_hz for one in telling.values()), narrowest)
    channel = min(telling, key=lambda name: telling[name].noise_limit_hz)
    noise_hz = telling[channel].noise_limit_hz
    limits = (
        (noise_hz, f"where noise is 1 % of what moves the {channel}"),
        (widest, "three times the edge of the motion's speed"),
        (highest, "an eighth of the rate"),
    )
    cutoff, reason = min(limits, key=lambda limit: limit[0])
    if cutoff < min(narrowest, highest):
        cutoff = min(narrowest, highest)
        reason = f"twice the edge of the motion, although noise of the {channel} asks for less"
    if cutoff < shortest:
        cutoff, reason = shortest, "fifteen periods in the log, which is short for its motion"
    return CutoffSelection(
        cutoff_hz=float(cutoff),
        reason=reason,
        motion_hz=(narrowest, widest),
        noise_limit_hz=noise_hz,
        noise_floor=telling[channel].floor,
        channel=channel,
        shortest_hz=shortest,
        rate_limit_hz=highest,
    )


def _spectrum(samples: Array, rate_hz: float, order: int) -> _Spectrum:
    from scipy.signal import detrend, periodogram

    frequency, power = periodogram(detrend(samples), fs=rate_hz, window="hann")
    white = float(np.median(power[frequency > 0.25 * rate_hz])) / np.log(2)
    of_steps, rounding = _noise_of_steps(samples, rate_hz)
    floor, variance = max(white, of_steps), max(white * rate_hz / 2, rounding)
    smooth = np.convolve(power, np.ones(_SMOOTHED_BINS) / _SMOOTHED_BINS, mode="same")
    seen = (smooth >= _OUTSTANDING * floor) & (frequency <= rate_hz / _RATES)
    signal = np.where(seen, np.maximum(power - floor, 0.0), 0.0)
    # the noise of a derivative is integrated, its lines are those of the signal
    # a sweep moves too: only its speed and acceleration are without the trend
    moving = periodogram(samples, fs=rate_hz, window="hann", detrend="constant")[1]
    place = np.where(seen | (frequency <= frequency[2]), np.maximum(moving - floor, 0.0), 0.0)
    exponent = 2 * order
    noise = floor * frequency ** (exponent + 1) / (exponent + 1)
    moved = np.cumsum(signal * frequency**exponent) * frequency[1]
    clean = np.flatnonzero((noise <= _ALLOWED**2 * moved) & (moved > 0))
    return _Spectrum(
        position_hz=_edge(frequency, place, _POSITION_SHARE),
        speed_hz=_edge(frequency, signal * frequency**2, _VELOCITY_SHARE),
        noise_limit_hz=float(frequency[clean[-1]]) if len(clean) else 0.0,
        floor=floor,
        moves=bool(np.sum(place) * frequency[1] >= _MOVING**2 * variance),
    )


def _edge(frequency: Array, power: Array, share: float) -> float:
    total = np.cumsum(power)
    return float(frequency[np.argmax(total >= share * total[-1])])


def _noise_of_steps(samples: Array, rate_hz: float) -> tuple[float, float]:
    """Return floor and variance of an encoder's steps, 0 where samples are not whole steps apart.

    The error of rounding, a twelfth of the step squared, is new at each step that is passed: its
    power lies below half the number of steps a second, low where a coarse encoder turns slowly.
    """
    moves = np.abs(np.diff(samples))
    moves = moves[moves > 1e-9 * np.ptp(samples)]
    step = float(np.min(moves))
    if np.mean(np.abs(moves / step - np.round(moves / step)) < 1e-3) < _ON_GRID:
        return 0.0, 0.0
    steps_hz = min(float(np.sum(moves)) / step * rate_hz / len(samples), rate_hz)
    return step**2 / 6 / steps_hz, step**2 / 12
