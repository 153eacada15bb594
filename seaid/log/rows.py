"""The rows of a regression: which samples of a motion become rows, and columns in its band.

Of filtered samples few are independent, and at standstill the friction of a motor is unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.log import filtering

if TYPE_CHECKING:
    from seaid.drives import Drive
    from seaid.log.motion import Motion

STANDSTILL_SHARE = 0.05
"""Share of standstill in the window of the low pass above which a sample is excluded."""

STRIBECK_SHARE = 0.01
"""The same for Stribeck friction, which the samples next to standstill determine."""


BRIDGED_SHARE = 0.2
"""Share of interpolated gaps in the window of the low pass above which a sample is excluded.

On the simulated leg with two gaps of 0.09 s the error of the drives is 1.5 times that without gaps
if all rows are kept, and 1.05 times at 0.1 to 0.3 (ten draws); gaps of 10 ms need no exclusion.
"""

_AT_ONCE = 16
"""Columns that are filtered at a time: they stay in the processor's cache."""


def in_band(motion: Motion, columns: Array) -> Array:
    """Return columns (T, ...) filtered by the low pass at the motion's cutoff."""
    return in_band_at(motion, columns, np.arange(len(columns)))


Columns = Array | Callable[[slice], Array]
"""Columns (T, ...) of a motion, or a function that returns those (S, ...) of successive samples."""


def in_band_at(motion: Motion, columns: Columns, samples: IndexArray) -> Array:
    """Return some samples of `in_band`.

    Where they are far apart, as rows are, only their own values are computed. Elsewhere zero
    columns, half of those of a chain, are skipped.
    """
    made = columns if callable(columns) else columns.__getitem__
    count, shape = len(motion.time), made(slice(0)).shape[1:]
    step = int(np.gcd.reduce(np.diff(samples))) if len(samples) > 1 else 0
    if step >= _FAR_APART and motion.cutoff_hz < filtering.UNFILTERED * motion.rate_hz:
        first, last = int(np.min(samples)), int(np.max(samples))
        numbers, lattice = (samples - first) // step, slice(first, last + 1, step)
        filtered = filtering.low_pass_at(made, count, motion.rate_hz, motion.cutoff_hz, lattice)
        return filtered[numbers].reshape(len(samples), *shape)
    table = np.reshape(made(slice(count)), (count, -1))
    used = np.flatnonzero(np.any(table != 0, axis=0))
    filtered = np.zeros((len(samples), table.shape[1]))
    for start in range(0, len(used), _AT_ONCE):
        part = used[start : start + _AT_ONCE]
        below = filtering.low_pass(table[:, part], motion.rate_hz, motion.cutoff_hz)
        filtered[:, part] = below[samples]
    return filtered.reshape(len(samples), *shape)


_FAR_APART = 8
"""Samples from one row to the next from which a sum over blocks costs less than a recursion."""


def row_samples(motion: Motion) -> IndexArray:
    """Return the samples that become rows: decimated, without filter transients and gaps."""
    step = filtering.decimation(motion.rate_hz, motion.cutoff_hz)
    transient = round(motion.transient_s * motion.rate_hz)
    rows = np.arange(transient, len(motion.time) - transient, step)
    if motion.bridged is None:
        return rows
    # The low pass of a mask of 0 and 1 is the share of the filter's weight on the gaps.
    return rows[in_band_at(motion, motion.bridged.astype(float), rows) <= BRIDGED_SHARE]


PIECE_SAMPLES = 16_000
"""Samples of a log, or of a motion with its columns, that are in memory at a time, without the
overlap."""


def pieces(motion: Motion, samples: int = PIECE_SAMPLES) -> Iterator[tuple[Motion, float, float]]:
    """Yield the pieces of a motion, which overlap, and the time span [start, end) [s] of each.

    The rows of all spans are those of the whole motion, since the overlap takes the transients of
    the filter.
    """
    count, overlap = len(motion.time), filtering.filter_overlap(motion.rate_hz, motion.cutoff_hz)
    step = filtering.decimation(motion.rate_hz, motion.cutoff_hz)
    length = step * -(-samples // step)  # whole rows
    # Standstill is a share of the largest speed: with that of a piece, other rows would be
    # excluded.
    motion = replace(motion, fastest=motion.largest_speeds)  # once, not by every piece
    # The last piece may be as long as those in the middle, which have two overlaps.
    times, starts = np.append(motion.time, np.inf), range(0, max(count - 2 * overlap, 1), length)
    for start, end in zip(starts, [*starts[1:], count], strict=True):
        part = slice(max(start - overlap, 0), end + overlap)
        yield motion.samples(part), float(times[start]), float(times[end])


def standstill(
    motion: Motion, index: int, share: float = STANDSTILL_SHARE, *, of_joint: bool = False
) -> BoolArray:
    """Return the mask (T,) of samples at which a motor's friction is unknown because it stands.

    The low pass averages over the neighbourhood of a sample: the sample counts if standstill makes
    up more than `share` of that average. A reversal without a stop is no standstill. `of_joint`:
    the same of the joint's side.
    """
    speed = motion.joint_velocity if of_joint else motion.motor_velocity
    still = np.abs(speed[:, index]) < still_speed(motion, index, of_joint=of_joint)
    return np.asarray(still | (in_band(motion, still.astype(float)) > share))


def still_speed(motion: Motion, index: int, *, of_joint: bool = False) -> float:
    """Return the speed [rad/s] below which a motor, or a joint, counts as standing."""
    fastest = float(motion.largest_speeds[int(of_joint), index])
    return max(filtering.STANDSTILL * fastest, filtering.REST_RAD_S)


def still_share(drive: Drive) -> float:
    """Return the share of standstill that is allowed for a drive with dry friction."""
    return STRIBECK_SHARE if "stribeck" in drive.friction else STANDSTILL_SHARE
