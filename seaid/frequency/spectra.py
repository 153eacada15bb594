"""Spectra of logs at the joints, and the best linear approximation from torques to angles.

Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 4 and 7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy  # reports import this module, and `signal` takes half a second, `ndimage` a tenth
from scipy.interpolate import CubicSpline, make_interp_spline

from seaid._arrays import Array, BoolArray, IndexArray, safely
from seaid.errors import IdentificationError
from seaid.log import Log
from seaid.robot import Robot, at_drives

MOVES = 0.02
"""A joint takes part if its acceleration in the band is this share of that of the fastest joint."""

_EXCITED = 0.04
"""A line of a period is excited if it has this share of the power of the strongest one near it."""

_ABOVE_NOISE, _FLOOR = 20.0, 1e-5
"""An excited line has this multiple of the power of the noise, and share of the largest one."""

_FEWEST_LINES = 4
"""Lines that are not excited, from which a nonlinear distortion is estimated."""

_BROAD_FLOOR = 1e-3
"""The same share for a log without periods, whose ends leak into all lines."""

NEAR = 6
"""Lines on either side that are near: variances and, with few logs, responses are smooth there."""

STICKS, _STILL = 0.01, 1e-3
"""Shares of the standard deviation of the speed: below the first a motor sticks, and the second is
rounding."""

_QUIET = 0.02
"""Share of the standard deviation of the speed. Up to this noise the differences of the angle show
the reversals. Above it a smoothed speed does, which shows them late, since speeds have a kink at a
reversal; what it has below the same share is taken as noise."""

_SEGMENTS = 8
"""Segments of a log without periods, half overlapping (Welch)."""

_safely = partial(safely, what="the frequency response")


@dataclass(frozen=True, eq=False)
class Record:
    """One log at the joints in P periods of N samples: torque, angle and sign of speed of motors.

    Arrays are (P, N, n); a log without periods has one, from which the line between its ends is
    subtracted. `posture` (n,) is the mean position, by the motor where the joint is not measured.
    """

    torque: Array
    motor: Array
    sign: Array
    step_s: float
    posture: Array


@dataclass(frozen=True, eq=False)
class Spectra:
    """Spectra of E logs in P periods at L lines, (E, P, L, n), with those of unexcited lines.

    `unexcited` are torque and motor angle (2, E, P, K, n) at `unexcited_hz` (K,), where nothing is
    excited.
    """

    hz: Array
    torque: Array
    motor: Array
    sign: Array
    unexcited_hz: Array
    unexcited: Array
    is_periodic: bool

    def up_to(self, line: int) -> Spectra:
        """Return the spectra of the lowest lines, up to one of them."""
        torque, motor, sign = (x[:, :, :line] for x in (self.torque, self.motor, self.sign))
        return replace(self, hz=self.hz[:line], torque=torque, motor=motor, sign=sign)


@dataclass(frozen=True, eq=False)
class Approximation:
    """Responses (F, n, n) at the joints, their standard deviations, and the coherence (F, n).

    `noise_std` is from what differs between periods, `total_std` has the nonlinear distortion too.
    They are NaN where the logs do not show them.
    """

    hz: Array
    response: Array
    noise_std: Array
    total_std: Array
    coherence: Array


def record_of(robot: Robot, log: Log, ratio: Array, period_s: float | None) -> Record:
    """Return a log at the joints, with whole periods counted from its end.

    The first of three periods or more, in which the motion settles, is excluded.
    """
    motor = log.motor_position / ratio
    values = np.stack([log.motor_torque * ratio, motor])
    instants, step = _instants(log.time, period_s)
    sampled = CubicSpline(log.time, np.nan_to_num(values), axis=1)(instants)
    # A channel of which a sample is missing is missing.
    is_whole = np.all(np.isfinite(values), axis=1, keepdims=True)
    torque, angle = np.where(is_whole[:, None], sampled, np.nan)
    flat = np.nan_to_num(angle.reshape(-1, angle.shape[-1]))
    sign = np.stack([_friction_sign(x) for x in flat.T], axis=1).reshape(angle.shape)
    if period_s is None:
        # A jump of the angle from its end to its start would alias; a line acts as 1/s does.
        line = np.linspace(0.0, 1.0, angle.shape[1])[:, None]
        angle = angle - angle[:, :1] - line * (angle[:, -1:] - angle[:, :1])
    joint = at_drives(robot.transmission, log.joint_position)
    posture = np.mean(np.where(np.isfinite(joint), joint, motor), axis=0)
    return Record(torque, angle, sign, step, posture)


def _instants(time: Array, period_s: float | None) -> tuple[Array, float]:
    """Return even instants (P, N) of whole periods up to the end of a log, and their step [s].

    Without a period they are those of the whole log, as one period.
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    if period_s is None:
        return np.linspace(time[0], time[-1], len(time))[None], step
    count, length = round(period_s / step), len(time) * step
    periods = round_down(length / period_s)
    kept = periods - 1 if periods >= 3 else periods
    # Of exactly whole periods the last sample is a step before the end.
    is_whole = length - periods * period_s < 0.5 * step
    step = period_s / count
    end = time[-1] + (step if is_whole else 0.0)
    instants = end - step * np.arange(kept * count, 0, -1)
    return np.clip(instants, time[0], time[-1]).reshape(kept, count), step


def motor_rates(angle: Array) -> tuple[Array, Array]:
    """Return speed and acceleration (2 of (T, ...)) per sample, smoothed over five samples."""
    smoothed = partial(scipy.signal.savgol_filter, angle, 5, 2, axis=0)
    return smoothed(deriv=1), smoothed(deriv=2)


def _friction_sign(angle: Array) -> Array:
    """Return the sign (T,) of the speed, and while the motor sticks a line from one to the next.

    Each sample has the mean of the intervals before and after it.
    """
    moved = np.diff(angle)
    # Of white noise of variance v the fourth differences have 70 v, the first ones 2 v.
    noise = np.sqrt(2 / 70) * np.std(np.diff(angle, 4))
    if noise > _QUIET * np.std(moved):
        speed = motor_rates(angle)[0]
        moved = 0.5 * (speed[1:] + speed[:-1])
        moved = np.where(np.abs(moved) > _QUIET * np.std(speed), moved, 0.0)
    moves = np.flatnonzero(np.abs(moved) > _STILL * np.std(moved))
    if not len(moves):
        return np.zeros_like(angle)
    signs = np.interp(np.arange(-1, len(angle)), moves, np.sign(moved[moves]))
    return np.asarray(0.5 * (signs[1:] + signs[:-1]))


def round_down(value: float) -> int:
    """Return the whole number below a value, rounding errors aside."""
    return math.floor(value + 1e-6)


def moving_joints(records: Sequence[Record], top_hz: float) -> list[int]:
    """Return the joints whose motors accelerate in the band."""
    power = np.zeros(records[0].motor.shape[-1])
    for record in records:
        lines, hz = _transform(record.motor - record.motor.mean((0, 1)), record.step_s)
        power += np.mean(np.abs(lines[:, hz < top_hz] * hz[hz < top_hz, None] ** 2) ** 2, (0, 1))
    size = np.sqrt(np.nan_to_num(power))
    return [int(i) for i in np.flatnonzero(size > MOVES * np.max(size))] if np.max(size) else []


def _transform(values: Array, step_s: float) -> tuple[Array, Array]:
    """Return the amplitudes (..., L, n) of each period, and the frequencies (L,) [Hz]."""
    count = values.shape[-2]
    # The factor 2 / T makes a line the amplitude of its sine.
    lines: Array = 2 * np.fft.rfft(values, axis=-2) / count
    return lines, np.asarray(np.fft.rfftfreq(count, step_s), dtype=np.float64)


def spectra_of(
    records: Sequence[Record],
    picked: Sequence[int],
    band_hz: tuple[float, float],
    harmonics: IndexArray | None,
    *,
    periodic: bool,
) -> Spectra:
    """Return the spectra of joints in a band; `harmonics` are the excited ones, else looked for."""
    periods = min(len(record.torque) for record in records)
    count = min(record.torque.shape[1] for record in records)
    # The last periods, since the first ones of a longer record may have its transient.
    parts = [
        [getattr(record, name)[-periods:, :count][..., picked] for record in records]
        for name in ("torque", "motor", "sign")
    ]
    fields, hz = _transform(np.array(parts), records[0].step_s)
    low, high = band_hz
    within = (hz > 0) & (hz >= low) & (hz <= high)
    if harmonics is not None:
        excited = within & np.isin(np.arange(len(hz)), harmonics)
    else:
        excited = _excited(fields, hz, within) if periodic else _broadly_excited(fields[0], within)
    if np.sum(excited) < 2:
        raise IdentificationError(
            f"the logs have {np.sum(excited)} excited frequencies from {low:g} to {high:.4g} Hz; "
            "all else is noise: give another band_hz, the plan that they followed, or logs of a "
            "larger motion",
            "band_hz",
        )
    others, (torque, motor, sign) = _unexcited(hz, within, excited), fields[:, :, :, excited]
    unexcited = fields[:2, :, :, others]
    return Spectra(hz[excited], torque, motor, sign, hz[others], unexcited, periodic)


def _unexcited(hz: Array, within: BoolArray, excited: BoolArray) -> BoolArray:
    """Return the lines (L,) that show the distortion below the highest excited one."""
    others: BoolArray = np.asarray(within & ~excited & (hz <= hz[excited][-1]))
    is_odd = np.arange(len(hz)) % 2 == 1
    if np.all(is_odd[excited]) and np.sum(others & is_odd) >= _FEWEST_LINES:
        others &= is_odd  # distortion by dry friction is odd, and even lines do not show it
    return others


def _broadly_excited(torque: Array, within: BoolArray) -> BoolArray:
    """Return the lines (L,) of a log without periods whose torque is above its noise."""
    power = np.sum(np.abs(torque) ** 2, axis=(0, 1, 3)) * within
    smooth = scipy.ndimage.uniform_filter1d(power, 2 * NEAR + 1)
    floor = _ABOVE_NOISE * np.median(smooth[len(smooth) * 3 // 4 :])
    return np.asarray(within & (smooth > max(_BROAD_FLOOR * np.max(smooth), floor)))


def _excited(fields: Array, hz: Array, within: BoolArray) -> BoolArray:
    """Return the lines (L,) that stand out of those near them, in torque or in acceleration.

    They stand out of what differs between periods too.
    """
    excited = np.zeros(len(hz), dtype=bool)
    for values in (fields[0], fields[1] * hz[:, None] ** 2):
        periods = values.shape[1]
        power = np.sum(np.abs(np.mean(values, axis=1)) ** 2, axis=(0, 2)) * within
        least = np.full(len(hz), _FLOOR * np.max(power))
        if periods > 1:
            noise = np.sum(np.var(values, axis=1) / (periods - 1), axis=(0, 2))
            smooth = scipy.ndimage.uniform_filter1d(noise, 2 * NEAR + 1)
            least = np.maximum(least, _ABOVE_NOISE * smooth)
        near = scipy.ndimage.maximum_filter1d(power, 2 * NEAR + 1)
        excited |= (power > _EXCITED * near) & (power > least) & within
    return excited


def approximation_of(
    spectra: Spectra, records: Sequence[Record], picked: Sequence[int], fitted: Array
) -> Approximation:
    """Return the best linear approximation, from periods or else from segments.

    With fewer logs than joints it is the response (L, n, n) of the `fitted` robot plus what these
    logs change in it, smoothly over frequency.
    """
    if not spectra.is_periodic:
        return _by_segments(records, picked, spectra)
    E, P, L, n = spectra.torque.shape
    U, Y = spectra.torque.mean(axis=1), spectra.motor.mean(axis=1)
    few = n > E
    base = fitted if few else np.zeros_like(fitted)
    # With few logs what the fitted robot does not explain is taken as smooth over the lines: the
    # response itself is not, near resonances.
    motor, gram = _responses(U, Y - np.einsum("fij,efj->efi", base, U), few)
    motor = base + motor
    residual = spectra.motor - np.einsum("fij,epfj->epfi", motor, spectra.torque)
    noise_variance = np.full((L, n), np.nan)
    if P > 1:
        # of the mean over P periods, from what differs between them
        differs = residual - residual.mean(axis=1, keepdims=True)
        power = np.sum(np.abs(differs) ** 2, axis=(0, 1)) / (E * (P - 1) * P)
        noise_variance = scipy.ndimage.uniform_filter1d(power, NEAR, axis=0)
    total_variance = _total_variance(spectra, motor, residual.mean(axis=1), max(E - n, 0))
    total_variance = np.fmax(total_variance, noise_variance)  # the larger one that is not NaN
    with np.errstate(invalid="ignore"):
        power = np.mean(np.abs(Y) ** 2, axis=0)
        coherence = np.clip(1 - total_variance / np.maximum(power, 1e-300), 0.0, 1.0)
        variances = noise_variance, total_variance
        noise_std, total_std = (np.sqrt(x[:, :, None] * gram[:, None, :]) for x in variances)
    return Approximation(spectra.hz, motor, noise_std, total_std, coherence)


def _responses(U: Array, Y: Array, few: bool) -> tuple[Array, Array]:
    """Return G (L, n, n) of Y = G U over logs (E, L, n), and the diagonals (L, n) of (U^H U)^-1.

    With `few` logs, less than joints, G is the same at near lines.
    """
    E, L, n = U.shape
    G, gram = np.empty((L, n, n), dtype=complex), np.empty((L, n))
    half = max(NEAR, math.ceil(n / E)) if few else 0
    for line in range(L):
        first = min(max(line - half, 0), max(L - 2 * half - 1, 0))
        near = slice(first, first + 2 * half + 1)
        # G^T = U^+ Y over logs (and near lines); the variance of G_ij is that of Y_i times
        # [(U^H U)^-1]_jj, which is the row sum of |U^+|^2.
        inverse = _safely(np.linalg.pinv, U[:, near].reshape(-1, n))
        G[line] = (inverse @ Y[:, near].reshape(-1, n)).T
        gram[line] = np.sum(np.abs(inverse) ** 2, axis=1)
    return G, gram


def _total_variance(spectra: Spectra, motor: Array, residual: Array, spare: int) -> Array:
    """Return the variance (L, n) of what the linear response leaves, averaged over near lines.

    `residual` is (E, L, n). With logs to spare it is that between realisations, else that at lines
    which are not excited (detection lines); NaN without either.
    """
    if spare > 0:
        power = np.sum(np.abs(residual) ** 2, axis=0) / spare
        return np.asarray(scipy.ndimage.uniform_filter1d(power, NEAR, axis=0))
    if len(spectra.unexcited_hz) < _FEWEST_LINES:
        return np.full(residual.shape[1:], np.nan)
    U, Y = spectra.unexcited.mean(axis=2)
    G = _at_lines(spectra.unexcited_hz, spectra.hz, motor)
    # Distortion is what the torque at these lines does not cause linearly.
    power = np.mean(np.abs(Y - np.einsum("fij,efj->efi", G, U)) ** 2, axis=0)
    smooth = scipy.ndimage.uniform_filter1d(power, 2 * NEAR, axis=0)
    return _at_lines(spectra.hz, spectra.unexcited_hz, smooth)


def _at_lines(wanted: Array, hz: Array, values: Array) -> Array:
    """Return values (L, ...) at other frequencies: linear between lines, constant beyond them."""
    return np.asarray(make_interp_spline(hz, values, k=1)(np.clip(wanted, hz[0], hz[-1])))


def _by_segments(
    records: Sequence[Record], picked: Sequence[int], spectra: Spectra
) -> Approximation:
    """Return the response by the spectra of segments of all logs, which overlap by half (Welch)."""
    parts = []
    for record in records:
        signals = np.nan_to_num(np.stack([record.torque[0], record.motor[0]])[..., picked])
        length = 2 * signals.shape[1] // (_SEGMENTS + 1)
        hz, _, lines = scipy.signal.spectrogram(
            *(signals, 1 / record.step_s, "hann", length, length // 2),
            **{"detrend": "linear", "mode": "complex", "axis": 1},
        )
        parts.append(lines)
    kept = (hz >= spectra.hz[0]) & (hz <= spectra.hz[-1]) & (hz > 0)
    # (2, L, n, K) of each log -> (2, K, L, n) of all segments
    U, Y = np.moveaxis(np.concatenate(parts, axis=-1)[:, kept], -1, 1)
    G, gram = _responses(U, Y, few=False)
    unexplained = np.sum(np.abs(Y - np.einsum("fij,efj->efi", G, U)) ** 2, axis=0)
    power = np.sum(np.abs(Y) ** 2, axis=0)
    # Hann windows that overlap by half correlate by 1/6, which leaves 0.95 of the averages: of K
    # segments K / (1 + 2 (1 - 1/K) / 6^2) count (Welch 1967).
    averages = len(records) * _SEGMENTS / (1 + 2 * (1 - 1 / _SEGMENTS) / 6**2)
    variance = unexplained / max(averages - len(picked), 1.0)
    total_std = np.sqrt(variance[:, :, None] * gram[:, None, :])
    coherence = np.clip(1 - unexplained / np.maximum(power, 1e-300), 0.0, 1.0)
    return Approximation(hz[kept], G, np.nan * total_std, total_std, coherence)
