"""Zero-phase low pass, spline derivatives, and the selection of the cutoff frequency.

Noise in the regressor biases least squares towards zero (attenuation, Fuller 1987): noise in the
accelerations reduces inertias by its share of their power, which grows with the fifth power of the
cutoff. A cutoff below the bandwidth of the motion, on the other hand, discards excitation. The
cutoff is therefore selected from the spectra of the positions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from seaid._arrays import Array, BoolArray, runs, white_noise

_ROUNDING = 1e-6
"""Relative rounding error of a quotient of two rates."""

UNFILTERED = 0.4
"""Cutoff over the sampling rate from which there is no low pass."""

ROWS_PER_PERIOD = 4.0
"""Rows per period of the cutoff after decimation: twice the Nyquist rate of the filtered signal."""

_FORGOTTEN = 6.0
"""Periods of the cutoff f after which the filter has forgotten all but 1e-11.

It decays with exp(-2 pi f t / sqrt 2), by 0.012 in each.
"""


def low_pass(signals: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Return columns (T, any) after a zero-phase Butterworth low pass; unchanged near Nyquist."""
    if cutoff_hz >= UNFILTERED * rate_hz:
        return signals
    from scipy import fft

    # Steps from sample to sample, whose rounding errors are hundreds of times smaller than those of
    # the signals, which would be seen in a second derivative.
    steps, period = np.diff(signals.T), rate_hz / cutoff_hz
    count = steps.shape[1]
    # The continuation is odd, so that a line stays a line, and then constant.
    near, far = min(count, round(3 * period)), math.ceil(_FORGOTTEN * period)
    before, after = steps[:, :near][:, ::-1], steps[:, count - near :][:, ::-1]
    steps = np.concatenate([np.zeros((len(steps), far)), before, steps, after], axis=1)
    length = fft.next_fast_len(steps.shape[1] + far, real=True)
    # Order 2 in both directions has no phase, and the gain 1 / (1 + (f' / f)^4) of the frequencies
    # that the bilinear transform warps: one half at the cutoff, not 1 / sqrt 2.
    warped = np.tan(np.pi / length * np.arange(length // 2 + 1)) / _warped(rate_hz, cutoff_hz)
    smooth = fft.irfft(fft.rfft(steps, length) / (1 + warped**4), length)
    smooth[:, 0] += 2 * signals[0] - signals[near]
    np.cumsum(smooth, axis=1, out=smooth)
    return np.ascontiguousarray(smooth[:, near + far - 1 : near + far + count].T)


def _warped(rate_hz: float, cutoff_hz: float) -> float:
    """Return the frequency of the bilinear transform, s = (z - 1) / (z + 1), at the cutoff."""
    return math.tan(math.pi * cutoff_hz / rate_hz)


def low_pass_at(
    columns: Callable[[slice], Array], count: int, rate_hz: float, cutoff_hz: float, lattice: slice
) -> Array:
    """Return `low_pass` at the samples of a slice, by sums over the blocks between them.

    `columns` returns columns (S, ...) of successive ones of `count` samples: those of all samples
    need not be in memory.

    The low pass forward and backward has the kernel phi_0 at lag zero and Re(c p^|l|) elsewhere,
    with the pole p. Its sums to both sides of a sample are those of its block, and p^step times
    those of the next sample: they need one product of matrices, and a recursion over the rows.
    """
    centre, c, p = _kernel(float(rate_hz), float(cutoff_hz))
    first, step = lattice.start, lattice.step
    blocks = (lattice.stop - 1 - first) // step
    last = first + blocks * step
    # The odd continuation of `low_pass` at both ends.
    pad = min(count - 1, round(3 * rate_hz / cutoff_hz))
    ends = slice(max(first, pad + 1)), slice(min(last, count - pad - 1), count)
    start, end = (np.reshape(x := columns(part), (len(x), -1)) for part in ends)
    before = np.concatenate([2 * start[:1] - start[pad:0:-1], start[:first]])
    after = np.concatenate([end[last - count :], 2 * end[-1:] - end[-2 : -pad - 2 : -1]])
    # p^l, which NumPy computes in a twentieth of the time as an exponential.
    powers = np.exp(np.log(p) * np.arange(max(step, len(before), len(after)) + 1))
    # Lags of step to 1 before the next sample, and of 0 to step - 1 after this one.
    lags, width = np.stack([powers[step:0:-1], powers[:step]]), start.shape[1]
    sums, at = np.empty((2, blocks + 1, width), dtype=complex), np.empty((blocks, width))
    # 100,000 numbers at a time stay in the processor's cache.
    size = max(100_000 // (step * max(width, 1)), 1)
    for i in range(0, blocks, size):
        j = min(i + size, blocks)
        within = columns(slice(first + i * step, first + j * step)).reshape(j - i, step, -1)
        both, at[i:j] = _weighted(lags, within), within[:, 0]
        sums[0, i + 1 : j + 1], sums[1, ::-1][i:j] = both[:, 0], both[:, 1]
    # Beyond the continuation there is a constant: p^T + p^(T+1) + ... = p^T / (1 - p).
    far, near = powers[len(before) : 0 : -1], powers[: len(after)]
    sums[0, 0] = _weighted(far[None], before)[0] + far[0] * p / (1 - p) * before[0]
    sums[1, 0] = _weighted(near[None], after)[0] + near[-1] * p / (1 - p) * after[-1]
    # s_m + q s_(m-1) + q^2 s_(m-2) + ..., of many columns by a recursion, since one row of them
    # stays in the cache; of few with twice as many terms at each turn.
    q, terms, is_wide = p**step, 1, width > 32
    for row in range(blocks if is_wide else 0):
        sums[:, row + 1] += q * sums[:, row]
    while not is_wide and terms <= blocks and abs(q) > np.finfo(float).eps:
        sums[:, terms:] += q * sums[:, :-terms]
        q, terms = q * q, 2 * terms
    outer = (c * (sums[0] + sums[1, ::-1])).real
    return np.asarray(outer + (centre - c.real) * np.concatenate([at, after[:1]]))


def _weighted(weights: Array, signals: Array) -> Array:
    """Return the sums (..., w, c) of signals (..., step, c) with complex weights (w, step)."""
    parts = np.concatenate([weights.real, weights.imag]) @ signals
    return np.asarray(parts[..., : len(weights), :] + 1j * parts[..., len(weights) :, :])


@cache
def _kernel(rate_hz: float, cutoff_hz: float) -> tuple[float, complex, complex]:
    """Return phi_0, c and p of the kernel of the low pass in both directions."""
    K = _warped(rate_hz, cutoff_hz)
    # K^4 / (K^4 + s^4) is the gain with s of `_warped`. Its residue at the pole s, s^4 = -K^4, is
    # -s / 4, with dz/ds = 2 / (1 - s)^2 and z = p = (1 + s) / (1 - s); twice it, for the conjugate
    # pole, is c p / 2 dz/ds. At z = 0 there is a residue for lag zero.
    s = K * complex(-1, 1) / math.sqrt(2)
    c = s / (s**2 - 1)
    return c.real + K**4 / (1 + K**4), c, (1 + s) / (1 - s)


def decimation(rate_hz: float, cutoff_hz: float) -> int:
    """Return the number of samples per row of the filtered regression."""
    # Rounded down, for at least ROWS_PER_PERIOD rows; a quotient of 25 less a rounding error is 25.
    return max(1, int(rate_hz / (ROWS_PER_PERIOD * cutoff_hz) * (1 + _ROUNDING)))


def filter_overlap(rate_hz: float, cutoff_hz: float) -> int:
    """Return the samples, whole rows, in which the transient of the filter decays to 1e-11."""
    # Whole rows, so that the rows of a piece are at the same samples as those of the whole motion.
    step = decimation(rate_hz, cutoff_hz)
    return step * math.ceil(_FORGOTTEN * rate_hz / cutoff_hz / step)


def spline_derivatives(time: Array, signals: Array) -> tuple[Array, Array, Array]:
    """Return value, first and second derivative (T, any) of an interpolating quintic spline.

    They are accurate up to the ends, unlike one-sided differences. NaN columns stay NaN.
    """
    from scipy.interpolate import make_interp_spline

    values, first, second = (np.full_like(signals, np.nan) for _ in range(3))
    known = np.flatnonzero(np.isfinite(signals[0]))
    # The second derivative of a quintic spline is a cubic one; that of a cubic spline has corners.
    spline = make_interp_spline(time, signals[:, known], k=5)
    values[:, known] = signals[:, known]
    first[:, known], second[:, known] = spline(time, 1), spline(time, 2)
    return values, first, second


STILL_RAD_S = 1e-5
"""Speed [rad/s or m/s] below which a joint stands still: an encoder of 2^14 steps makes one step in
40 s. The rounding of speeds, about 1e-10, is far below, so that it decides no sample."""


STILL = 1e-3
"""Range of a position [rad or m] that stands still, of a joint, its motor or a base."""


def moving(speed: Array) -> Array:
    """Return speeds, zero where nothing but rounding is left of them."""
    return np.where(np.abs(speed) < STILL_RAD_S, 0.0, speed)


STANDSTILL = 0.01
"""A motor below this fraction of its largest speed stands still: the sign of its friction is
unknown."""

REST_RAD_S = 1e-9
"""Speed [rad/s] below which a motor always stands still, by what rounding leaves of it behind a
filter or after a step of a simulation, so that friction may hold it."""

_PASSES = 3.0
"""Acceleration at a reversal, over that of dry friction alone, from which a joint passes through
it. With less than that of friction it sticks, and with little more it is slow on one side: with 2
delays of four simulated arms were up to twice as far off as with 3, and with 3 as without any."""


def mean_directions(velocity: Array, rate_hz: float, band_hz: float, dry: float) -> Array:
    """Return the mean of sign(speed) over the interval about each sample (T,), below `band_hz`.

    The sign at the samples is up to half an interval wrong at each reversal. A reversal is at the
    zero of the line between two samples, less the time by which the low pass of the positions at
    `band_hz` made it late: dry friction changes the acceleration there by twice its own, `dry` = g,
    and the low pass of that kink has the speed g E|tau|, with E|tau| = 1 / (2 sqrt(2) pi f) of the
    kernel of 1 / (1 + (f' / f)^4). Where the joint may stick there is no kink to correct.
    """
    velocity = moving(velocity)
    slope = _slopes(velocity, rate_hz)
    passes = (slope > _PASSES * dry) & (band_hz < UNFILTERED * rate_hz)
    late_s = np.zeros(len(velocity))
    # w = -s t + g |t| about a reversal at t = 0. The low-passed w(0) is g E|tau| and its slope -s,
    # so that its zero is g E|tau| / s late: 0.94 ms for g = 5, s = 30 rad/s^2 and 20 Hz.
    late_s[passes] = dry / (2 * np.sqrt(2) * np.pi * band_hz) / slope[passes]
    directions = _mean_signs(velocity, rate_hz, late_s)
    return low_pass(directions[:, None], rate_hz, band_hz)[:, 0]  # as torques and accelerations are


def runs_that(passes: Callable[[int, int], bool], mask: BoolArray) -> BoolArray:
    """Return the mask (T,) without those runs of true values that do not pass a test.

    The test gets the first sample of a run and its end.
    """
    kept = np.zeros(len(mask), dtype=bool)
    for start, end in runs(mask).tolist():
        kept[start:end] = passes(start, end)
    return kept


BLUR_OF_COMMANDS, _BLUR = 3.5, 7.0
"""Time constants 1 / (2 pi f) of the low pass of the positions by which a rest is longer in them.

Behind x of them the acceleration of a joint that stops is known to exp(-x / sqrt 2) of its step, to
8 % and to 0.7 %. The torque of a command has passed the low pass of the positions, too. A measured
torque has not: behind 3.5 rotor inertias were off by up to 0.7 standard errors, behind 7 by 0.2."""


def is_friction_known(
    velocity: Array,
    fastest: float,
    rate_hz: float,
    band_hz: float,
    dry: float = np.inf,
    blur: float = _BLUR,
) -> BoolArray:
    """Return the mask (T,) of samples at which the direction of dry friction is known.

    It is not where a joint stands, nor at a reversal at which it may stick, with little more than
    the acceleration `dry` of dry friction alone (inf: not known). The low pass of the positions at
    `band_hz` spreads both.
    """
    velocity = moving(velocity)
    turns = np.append(np.diff(np.sign(velocity)) != 0, False)
    passes = turns & (_slopes(velocity, rate_hz) > _PASSES * dry)
    rest = np.abs(velocity) < max(STANDSTILL * fastest, REST_RAD_S)
    # Both samples of a change of sign, since a fast reversal passes zero between two samples.
    rest |= turns | np.roll(turns, 1)

    def is_rest(start: int, end: int) -> bool:
        # one reversal, through which the joint passes, is none
        return not (np.sum(turns[start:end]) == 1 and np.any(passes[start:end]))

    rest = runs_that(is_rest, rest)
    reach = round(blur * rate_hz / (2 * np.pi * min(band_hz, UNFILTERED * rate_hz)))
    count = np.convolve(rest, np.ones(2 * reach + 1))[reach : reach + len(rest)]
    return np.asarray(count < 0.5)


def long_rests(velocity: Array, fastest: float, samples: float) -> BoolArray:
    """Return the mask (T,) of a rest that is longer than a number of `samples`."""
    rests = np.abs(velocity) < STANDSTILL * fastest
    return runs_that(lambda start, end: end - start > max(samples, 1.0), rests)


def _slopes(velocity: Array, rate_hz: float) -> Array:
    """Return the size of the acceleration between each sample and the next one (T,)."""
    return np.append(np.abs(np.diff(velocity)), 0.0) * rate_hz


def _mean_signs(velocity: Array, rate_hz: float, early_s: Array) -> Array:
    """Return the means of the sign, whose changes after each sample are earlier by `early_s`."""
    sign = np.sign(velocity)
    before = np.flatnonzero(np.diff(sign))
    passed = velocity[before] / (velocity[before] - velocity[before + 1])
    changes = before + passed - rate_hz * early_s[before]  # [samples]
    edges = np.arange(len(velocity) + 1) - 0.5
    # Two reversals that are shifted by different times may change places, and `interp` needs order.
    inside = np.maximum.accumulate(np.clip(changes, edges[0], edges[-1]))
    knots = np.concatenate([edges[:1], inside, edges[-1:]])
    levels = sign[np.concatenate([[0], before + 1])]
    # The integral of the sign is linear between its changes, so that its differences over the
    # intervals are the exact means, also of those with several changes.
    travelled = np.concatenate([[0.0], np.cumsum(levels * np.diff(knots))])
    return np.diff(np.interp(edges, knots, travelled))


_FEWEST_PERIODS = 15.0
"""Periods of the selected cutoff in a log, at least."""

_WIDENED_HZ = 12.0
"""The cutoff is raised for a short log up to this frequency only."""

_ALLOWED, _ALLOWED_OF_COMMANDS = 0.01, 0.05
"""Largest ratio of noise to signal (rms).

With commands the noise of the encoder is in the torque too: in the closed loop, with the natural
frequency f0, the inertia is off by the integral of (f0^2 - f^2) f^2 S in place of -f^4 S, over that
of the power of the accelerations: by 0.25 % at a twentieth, if f0 is not far above the cutoff."""

_VELOCITY_SHARE, _WIDE = 0.98, 4.0
"""Share of the power of the velocity within its bandwidth, and the cutoff as a multiple of that.
`scripts/benchmarks/cutoff.py`: friction is best determined with four times the bandwidth or more,
bodies with three to four times."""

_POSITION_SHARE, _NARROW = 0.995, 2.0
"""The same of the position: the cutoff is not below this multiple of its bandwidth."""

_CLOSEST = 1.5
"""Coloured noise does not lower the cutoff below this multiple of the bandwidth of the velocity,
since fast motion has such a spectrum, too."""

_RATES = 8.0
"""Sampling rate over the highest cutoff."""

_OUTSTANDING, _SMOOTHED_BINS = 3.0, 9
"""The mean of so many bins counts as signal above this multiple of the noise floor."""

_MOVING, _ON_GRID = 10.0, 0.95
"""Motion over noise (rms) of a channel that moves; share of whole steps of a quantised channel."""


@dataclass(frozen=True)
class CutoffSelection:
    """A cutoff frequency and the reason for it; str() is one line.

    Attributes
    ----------
    cutoff_hz, reason : float, str
        The cutoff [Hz] and the limit that determines it.
    motion_hz : tuple of float
        Twice the bandwidth of the positions, and four times that of the velocities [Hz].
    noise_limit_hz : float
        Cutoff at which noise is one percent (rms) of the acceleration or velocity of `channel`.
    noise_floor : float
        Power spectral density of the noise of `channel` [squared unit of the channel / Hz].
    channel : str
        The channel with the lowest noise limit.
    shortest_hz, rate_limit_hz : float
        Lower limit by the duration of the log, and upper limit by its sampling rate [Hz].
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


class _Spectrum:
    """A channel (T,): bandwidth of position and velocity, noise limits, noise floor, if it moves.

    `order` is that of the derivative whose noise is compared with the motion's.
    """

    def __init__(self, samples: Array, rate_hz: float, order: int, of_commands: bool) -> None:
        allowed = _ALLOWED_OF_COMMANDS if of_commands else _ALLOWED
        frequency, power = periodogram(without_trend(samples), rate_hz)
        # periodogram ordinates of white noise are chi^2_2: the median is log 2 times the mean
        white = float(np.median(power[frequency > 0.25 * rate_hz])) / np.log(2)
        # The median above a quarter of the rate hardly sees the quantisation noise of a slow joint.
        of_steps, rounding = _noise_of_steps(samples, rate_hz)
        floor, variance = max(white, of_steps), max(white * rate_hz / 2, rounding)
        self.floor = floor
        smooth = np.convolve(power, np.ones(_SMOOTHED_BINS) / _SMOOTHED_BINS, mode="same")
        # Single ordinates of white noise exceed three times their mean in e^-3 = 5 % of the bins,
        # means of nine in 0.1 %.
        seen = (smooth >= _OUTSTANDING * floor) & (frequency <= rate_hz / _RATES)
        signal = np.where(seen, np.maximum(power - floor, 0.0), 0.0)
        # a sweep moves too, so the power of the position keeps the linear trend
        moving = periodogram(samples - np.mean(samples), rate_hz)[1]
        # `seen` is that of the samples without the trend, whose power the Hann window has in bins
        # 1 and 2.
        place = np.where(seen | (frequency <= frequency[2]), np.maximum(moving - floor, 0.0), 0.0)
        # white noise of density S, differentiated k times: int_0^f S nu^2k dnu
        # = S f^(2k+1) / (2k+1)
        exponent = 2 * order
        noise = floor * frequency ** (exponent + 1) / (exponent + 1)
        # The factor (2 pi)^2k of the k-th derivative is in neither noise nor motion: it cancels.
        moved = np.cumsum(signal * frequency**exponent) * frequency[1]
        self.position_hz = _edge(frequency, place, _POSITION_SHARE)
        self.speed_hz = _edge(frequency, signal * frequency**2, _VELOCITY_SHARE)
        self.moves = bool(np.sum(place) * frequency[1] >= _MOVING**2 * variance)
        limit = _limit(frequency, noise, moved, allowed)
        self.noise_limit_hz = self.coloured_limit_hz = limit
        if order == 2 and not of_steps and not of_commands:
            noise = np.maximum(noise, _coloured_noise(frequency, power, rate_hz))
            self.coloured_limit_hz = _limit(frequency, noise, moved, allowed)

    def limit_hz(self, fastest_hz: float) -> float:
        """Return the limit by both kinds of noise, for the largest bandwidth of the velocities."""
        return min(self.noise_limit_hz, max(self.coloured_limit_hz, _CLOSEST * fastest_hz))


def select_cutoff(
    joint: Array, motor: Array, rate_hz: float, names: Sequence[str], *, of_commands: bool = False
) -> CutoffSelection:
    """Return the cutoff for positions (T, n) of both sides; columns without an encoder are NaN.

    `of_commands`: the torque is that of commands, with the same noise, so that five percent of
    white noise are in place of one percent below.

    The cutoff is the highest frequency at which noise is at most one percent (rms) of the
    acceleration of each joint, and of the velocity of each motor (of its acceleration, if the joint
    has no encoder). It is at least twice the bandwidth of the positions (99.5 % of the power of the
    fastest channel), below the vibrations of gears and links; at most four times the bandwidth of
    the velocities (98 %); at least fifteen periods in the log (up to 12 Hz); and at most an eighth
    of the rate. The noise floor of a channel is the median of its spectrum above a quarter of the
    rate, or the quantisation noise of its encoder, whichever is larger. Noise in accelerations of
    other sensors may grow towards low frequencies: a power law through their spectrum above the
    motion is continued below, down to 1.5 times the bandwidth of the velocities. Channels that move
    less than ten times their noise (rms) are ignored.
    """
    highest = rate_hz / _RATES
    shortest = min(_FEWEST_PERIODS * rate_hz / len(joint), highest, _WIDENED_HZ)
    allowed = _ALLOWED_OF_COMMANDS if of_commands else _ALLOWED
    moving = _moving_spectra(joint, motor, rate_hz, names, of_commands)
    if not moving:
        reason = "an eighth of the rate: nothing moves"
        return CutoffSelection(highest, reason, rate_limit_hz=highest)
    narrowest = _NARROW * max(spectrum.position_hz for spectrum in moving.values())
    fastest = max(spectrum.speed_hz for spectrum in moving.values())
    widest = max(_WIDE * fastest, narrowest)
    channel = min(moving, key=lambda name: moving[name].limit_hz(fastest))
    noise_hz = moving[channel].limit_hz(fastest)
    limits = (
        (noise_hz, f"where noise is {100 * allowed:.0f} % of the motion of the {channel}"),
        (widest, "four times the bandwidth of the velocity"),
        (highest, "an eighth of the rate"),
    )
    cutoff, reason = min(limits, key=lambda limit: limit[0])
    if cutoff < min(narrowest, highest):
        cutoff = min(narrowest, highest)
        reason = f"twice the bandwidth of the motion, although noise of the {channel} requires less"
    if cutoff < shortest:
        cutoff, reason = shortest, "fifteen periods in the log, which is short for its motion"
    return CutoffSelection(
        cutoff_hz=float(cutoff),
        reason=reason,
        motion_hz=(narrowest, widest),
        noise_limit_hz=noise_hz,
        noise_floor=moving[channel].floor,
        channel=channel,
        shortest_hz=shortest,
        rate_limit_hz=highest,
    )


def _moving_spectra(
    joint: Array, motor: Array, rate_hz: float, names: Sequence[str], of_commands: bool
) -> dict[str, _Spectrum]:
    """Return {channel: spectrum} of the encoders that move."""
    spectra: dict[str, _Spectrum] = {}
    for side, positions in (("joint", joint), ("motor", motor)):
        for index, name in enumerate(names):
            samples = positions[:, index]
            if np.isfinite(samples[0]) and np.ptp(samples) > 0:
                # Without an encoder at the joint, the accelerations of (8) are the motor's.
                order = 1 if side == "motor" and np.isfinite(joint[0, index]) else 2
                spectra[f"{side} side of {name}"] = _Spectrum(samples, rate_hz, order, of_commands)
    return {name: spectrum for name, spectrum in spectra.items() if spectrum.moves}


def without_trend(samples: Array) -> Array:
    """Return samples (T,) without the line through them."""
    ramp = np.arange(len(samples))
    return np.asarray(samples - np.polyval(np.polyfit(ramp, samples, 1), ramp))


def periodogram(samples: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and the one-sided power spectral density, with a Hann window."""
    count = len(samples)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / count)
    power = np.abs(np.fft.rfft(window * samples)) ** 2 / (rate_hz * (window @ window))
    # S = 2 |X|^2 / (rate sum w^2): its integral up to half of the rate is the variance.
    power[1 : (count + 1) // 2] *= 2  # both signs, of all but the mean and half of the rate
    return np.asarray(np.fft.rfftfreq(count, 1 / rate_hz)), power


def _limit(frequency: Array, noise: Array, moved: Array, allowed: float) -> float:
    """Return the highest frequency below which the power of noise is small against the motion's."""
    # Both are powers up to each frequency; `allowed` is a ratio of rms values, hence its square.
    clean = np.flatnonzero((noise <= allowed**2 * moved) & (moved > 0))
    return float(frequency[clean[-1]]) if len(clean) else 0.0


_BINS_PER_OCTAVE, _FEWEST_BINS, _STEEPEST = 4, 4, 2.5
"""Bins in which coloured noise is measured, fewest of them, and its largest exponent p: steeper
spectra are those of motion (3 for noise-free simulated joints with dry friction, 2 for the pendulum
on which this was tried first)."""


def _coloured_noise(frequency: Array, power: Array, rate_hz: float) -> Array:
    """Return the power of coloured noise in the acceleration below each frequency (F,).

    The motion ends and noise begins where the spectrum of the acceleration, S f^4, is smallest. The
    line log S = log S0 - p log(f / f0) through the spectrum from f0, one octave above, continues
    below: int_0^f S0 (nu / f0)^-p nu^4 dnu = S0 f0^p f^(5 - p) / (5 - p).
    """
    edges = np.arange(np.log2(8 * frequency[1]), np.log2(0.25 * rate_hz), 1 / _BINS_PER_OCTAVE)
    places = np.searchsorted(frequency, 2.0**edges)
    middle = 2.0 ** (0.5 * (edges[1:] + edges[:-1]))
    level = np.array([np.median(power[a:b]) for a, b in pairwise(places)]) / np.log(2)
    if len(level) < _FEWEST_BINS or not np.all(level > 0):
        return np.zeros_like(frequency)
    first = int(np.argmin(level * middle**4)) + _BINS_PER_OCTAVE
    if len(level) < first + _FEWEST_BINS:
        return np.zeros_like(frequency)
    x, y = np.log(middle[first:] / middle[first]), np.log(level[first:])
    p = max(0.0, -float(np.polyfit(x, y, 1)[0]))
    if p > _STEEPEST:
        return np.zeros_like(frequency)
    # S0 for the exponent p after clipping at zero; the constant of the fit belongs to its own
    # slope.
    start = float(np.exp(np.mean(y + p * x)))
    return np.asarray(start * middle[first] ** p * frequency ** (5 - p) / (5 - p))


def _edge(frequency: Array, power: Array, share: float) -> float:
    """Return the frequency below which this share of the power lies."""
    total = np.cumsum(power)
    return float(frequency[np.argmax(total >= share * total[-1])])


def noise_density(samples: Array, rate_hz: float) -> float:
    """Return the density of the noise of an encoder (T,) at low frequencies [unit^2/Hz]."""
    return _noise_of_steps(samples, rate_hz)[0] or 2 * white_noise(samples) ** 2 / rate_hz


def _noise_of_steps(samples: Array, rate_hz: float) -> tuple[float, float]:
    """Return density and variance of quantisation noise, 0 if samples are not whole steps apart.

    The error is a sawtooth of variance step^2 / 12 (Bennett 1948). Its harmonic k has the power
    step^2 / (2 pi^2 k^2), at k times the steps passed per second, r. With the density f of r over
    the log the noise at low frequencies is sum_k step^2 / (2 pi^2 k^3) f(0), of normal speeds
    zeta(3) step^2 / (pi^3 mean(r)), and not less than the whole variance over half of the rate, to
    which harmonics above it are folded.
    """
    from scipy.special import zeta

    moves = np.abs(np.diff(samples))
    moves = moves[moves > 1e-9 * np.ptp(samples)]
    step = float(np.min(moves))
    if np.mean(np.abs(moves / step - np.round(moves / step)) < 1e-3) < _ON_GRID:
        return 0.0, 0.0
    steps_hz = float(np.sum(moves)) / step * rate_hz / len(samples)
    # f(0) = 2 / (pi mean(r)), for |v| of a normal speed v.
    density = max(float(zeta(3)) / (np.pi**3 * steps_hz), 1 / (6 * rate_hz))
    return step**2 * density, step**2 / 12
