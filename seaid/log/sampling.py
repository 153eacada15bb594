"""What of a motion becomes rows: behind the low pass, every few samples, without standstill."""

from __future__ import annotations

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.drives import Drive
from seaid.log.filtering import decimation, low_pass
from seaid.log.motion import Motion

STANDSTILL = 0.01
"""A motor slower than this part of its fastest stands still: its friction has no direction."""

REST_RAD_S = 1e-9
"""So does one slower than this, whatever its fastest: that is the rounding of the filters."""

SEEN = 0.05
"""Share of standstill in what the low pass sees above which a sample is left out."""

SEEN_AT_A_PEAK = 0.01
"""The same for friction with a peak at standstill (Stribeck), told by the samples beside it."""


def in_band(motion: Motion, columns: Array) -> Array:
    """Return columns (T, ...) behind the low pass of the motion's pass band."""
    return in_band_at(motion, columns, np.arange(len(columns)))


def in_band_at(motion: Motion, columns: Array, samples: IndexArray) -> Array:
    """Return some samples of `in_band`; columns of zeros, half of a chain's, are not filtered."""
    flat = columns.reshape(len(columns), -1)
    used = np.flatnonzero(np.any(flat != 0, axis=0))
    found = np.zeros((len(samples), flat.shape[1]))
    found[:, used] = low_pass(flat[:, used], motion.rate_hz, motion.cutoff_hz)[samples]
    return found.reshape(len(samples), *columns.shape[1:])


def row_samples(motion: Motion) -> IndexArray:
    """Return the samples that become rows: decimated to the pass band, ends left away."""
    step = decimation(motion.rate_hz, motion.cutoff_hz)
    trim = round(motion.trim_s * motion.rate_hz)
    return np.arange(trim, len(motion.time) - trim, step)


def standstill(motion: Motion, index: int, seen: float = SEEN) -> BoolArray:
    """Tell the samples (T,) that see a motor stand still, so that its friction is unknown.

    Behind the low pass a sample sees its neighbourhood: it is left out if standstill makes up more
    than a small share of that, `seen`. A reversal without a stop is no standstill.
    """
    speed = np.abs(motion.motor_velocity[:, index])
    fastest = np.max(speed) if motion.fastest is None else motion.fastest[index]
    return _still(motion, speed, float(fastest), seen)


def standstill_seen(drive: Drive) -> float:
    """Return the share of standstill that samples of a drive with dry friction may see."""
    return SEEN_AT_A_PEAK if "stribeck" in drive.friction else SEEN


def joint_standstill(motion: Motion, index: int) -> BoolArray:
    """Tell the samples (T,) that see a joint stand still, as `standstill` does of its motor."""
    speed = np.abs(motion.joint_velocity[:, index])
    return _still(motion, speed, float(np.max(speed)), SEEN)


def _still(motion: Motion, speed: Array, fastest: float, seen: float) -> BoolArray:
    still = (speed < max(STANDSTILL * fastest, REST_RAD_S)).astype(float)
    return np.asarray((still > 0) | (in_band(motion, still) > seen))
