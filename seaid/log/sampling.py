"""Selection of the samples of a motion that become rows of a regression."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.log.filtering import decimation, filter_overlap, low_pass

if TYPE_CHECKING:
    from seaid.drives import Drive
    from seaid.log.motion import Motion

STANDSTILL = 0.01
"""A motor below this fraction of its largest speed stands still: the sign of its friction is
unknown."""

REST_RAD_S = 1e-9
"""Speed [rad/s] below which a motor always stands still: the rounding errors of the filters."""

STANDSTILL_SHARE = 0.05
"""Share of standstill in the window of the low pass above which a sample is excluded."""

STRIBECK_SHARE = 0.01
"""The same for Stribeck friction, which the samples next to standstill determine."""


BRIDGED_SHARE = 0.2
"""Share of interpolated gaps in the window of the low pass above which a sample is excluded.

On the simulated leg with two gaps of 0.09 s the error of the drives is 1.5 times that without gaps
if all rows are kept, and 1.05 times at 0.1 to 0.3 (ten draws); gaps of 10 ms need no exclusion.
"""


_AT_ONCE = 8
"""Columns that are filtered at a time: they stay in the processor's cache."""


def in_band(motion: Motion, columns: Array) -> Array:
    """Return columns (T, ...) filtered by the low pass at the motion's cutoff."""
    return in_band_at(motion, columns, np.arange(len(columns)))


def in_band_at(motion: Motion, columns: Array, samples: IndexArray | Array) -> Array:
    """Return some samples of `in_band`, or places between samples by straight lines.

    Zero columns, half of those of a chain, are skipped.
    """
    flat = columns.reshape(len(columns), -1)
    used = np.flatnonzero(np.any(flat != 0, axis=0))
    found = np.zeros((len(samples), flat.shape[1]))
    before = np.minimum(samples.astype(np.intp), len(columns) - 2)
    for start in range(0, len(used), _AT_ONCE):
        part = used[start : start + _AT_ONCE]
        filtered = low_pass(flat[:, part], motion.rate_hz, motion.cutoff_hz)
        if samples.dtype.kind == "f":
            step = filtered[before + 1] - filtered[before]
            found[:, part] = filtered[before] + (samples - before)[:, None] * step
        else:
            found[:, part] = filtered[samples]
    return found.reshape(len(samples), *columns.shape[1:])


def row_samples(motion: Motion) -> IndexArray:
    """Return the samples that become rows: decimated, without filter transients and gaps."""
    step = decimation(motion.rate_hz, motion.cutoff_hz)
    transient = round(motion.transient_s * motion.rate_hz)
    rows = np.arange(transient, len(motion.time) - transient, step)
    if motion.bridged is None:
        return rows
    return rows[in_band_at(motion, motion.bridged.astype(float), rows) <= BRIDGED_SHARE]


PIECE_SAMPLES = 16_000
"""Samples of a motion whose columns are in memory at a time, without the overlap."""


def pieces(motion: Motion) -> Iterator[tuple[Motion, float, float]]:
    """Yield the pieces of a motion, which overlap, and the time span [start, end) [s] of each.

    The rows of all spans are those of the whole motion, since the overlap takes the transients of
    the filter.
    """
    count, overlap = len(motion.time), filter_overlap(motion.rate_hz, motion.cutoff_hz)
    step = decimation(motion.rate_hz, motion.cutoff_hz)
    own = step * -(-PIECE_SAMPLES // step)  # whole rows
    motion = replace(motion, fastest=motion.largest_speeds)  # once, not by every piece
    for start in range(0, count, own):
        end, part = start + own, slice(max(start - overlap, 0), start + own + overlap)
        until = float(motion.time[end]) if end < count else np.inf
        yield motion.samples(part), float(motion.time[start]), until


def standstill(motion: Motion, index: int, share: float = STANDSTILL_SHARE) -> BoolArray:
    """Return the mask (T,) of samples at which a motor's friction is unknown because it stands.

    The low pass averages over the neighbourhood of a sample: the sample counts if standstill makes
    up more than `share` of that average. A reversal without a stop is no standstill.
    """
    speed = np.abs(motion.motor_velocity[:, index])
    fastest = np.max(speed) if motion.fastest is None else motion.fastest[0, index]
    return _still(motion, speed, float(fastest), share)


def still_share(drive: Drive) -> float:
    """Return the share of standstill that is allowed for a drive with dry friction."""
    return STRIBECK_SHARE if "stribeck" in drive.friction else STANDSTILL_SHARE


def joint_standstill(motion: Motion, index: int) -> BoolArray:
    """Return the mask (T,) of samples at which a joint stands, as `standstill` for its motor."""
    speed = np.abs(motion.joint_velocity[:, index])
    fastest = np.max(speed) if motion.fastest is None else motion.fastest[1, index]
    return _still(motion, speed, float(fastest), STANDSTILL_SHARE)


def _still(motion: Motion, speed: Array, fastest: float, share: float) -> BoolArray:
    still = (speed < max(STANDSTILL * fastest, REST_RAD_S)).astype(float)
    return np.asarray((still > 0) | (in_band(motion, still) > share))
