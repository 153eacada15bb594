"""Samples that are none: NaN, zeros and held values while the signal moves; saturation."""

from __future__ import annotations

import numpy as np

from seaid.arrays import Array, BoolArray, IndexArray

_FAR = 4.0
_SIMILAR = 4.0
_STUCK = 3
_PILED = 4.0

SLOWER = 1 / 3
"""Share of held samples above which a sensor is slower than its log."""


def resolution(values: Array) -> float:
    """Return the step of a channel (T,), the smallest change that it shows; 0 without any."""
    changes = np.abs(np.diff(np.unique(values[np.isfinite(values)])))
    largest = np.max(np.abs(values[np.isfinite(values)]), initial=0.0)
    changes = changes[changes > 1e-9 * largest]
    return float(np.percentile(changes, 5)) if len(changes) else 0.0


def runs(mask: BoolArray) -> IndexArray:
    """Return first and one past last sample (R, 2) of each stretch in which `mask` (T,) is true."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)])


def zero_dropouts(values: Array) -> BoolArray:
    """Tell the samples (T,) that are exactly zero where the samples around are far from it.

    Far is by several times the changes around them, and many of the channel's own steps. Zeros up
    to an end of the log count too, if the other end of them is such a jump.
    """
    found, step = np.zeros(len(values), dtype=bool), resolution(values)
    for start, end in runs(values == 0.0):
        found[start:end] = _is_sudden_zero(values, int(start), int(end), step)
    return found


def held_dropouts(values: Array, fewest: int = 2) -> BoolArray:
    """Tell the samples (T,) that repeat the one before while the signal moves on.

    A value that stays for `fewest` samples or more is held if the change that ends it makes up for
    that: as fast a sample as those before and after, and many of the channel's own steps. A coarse
    encoder that stays within its step is not held. Where more than a third are, the sensor is
    slower than its log, and holds every value as long.
    """
    found = np.zeros(len(values), dtype=bool)
    if not len(values):
        return found
    starts = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0]))
    lengths = np.diff(np.concatenate([starts, [len(values)]]))
    changes = np.diff(values[starts])
    if len(changes) < 3:
        return found
    rates = changes / lengths[:-1]
    with np.errstate(divide="ignore"):
        before, after = rates[:-2] / rates[1:-1], rates[2:] / rates[1:-1]
    step = resolution(values)
    alike = [(ratio > 1 / _SIMILAR) & (ratio < _SIMILAR) for ratio in (before, after)]
    large = np.abs(changes[1:-1]) > _FAR * step
    fast = np.minimum(np.abs(changes[:-2]), np.abs(changes[2:])) > 2 * step
    held = lengths[1 : len(changes) - 1] >= fewest
    stale = 1 + np.flatnonzero(held & alike[0] & alike[1] & large & fast)
    if np.sum(lengths[stale] - 1) > SLOWER * len(values):
        stale = np.flatnonzero(lengths <= np.max(lengths[stale]))
    for run in stale:
        found[starts[run] + 1 : starts[run] + lengths[run]] = True
    return found


def _is_sudden_zero(values: Array, start: int, end: int, step: float) -> bool:
    sides = []
    for edge, near in ((start - 1, values[:start][-8:]), (end, values[end:][:8][::-1])):
        near = near[near != 0.0]
        if len(near) < 3:
            continue
        usual = float(np.max(np.abs(np.diff(near))))
        sides.append(abs(float(values[edge])) > _FAR * max(usual, step))
    return bool(sides) and all(sides)


def saturated(values: Array) -> BoolArray:
    """Tell the samples (T,) of a torque, current or voltage that are stuck at an extreme.

    Stuck are those at the largest or the smallest value where that comes up far more often than any
    other near it: a signal that just turns there does not pile up.
    """
    found = np.zeros(len(values), dtype=bool)
    if not np.ptp(values) > 0:
        return found
    levels, counts = np.unique(values, return_counts=True)
    for place, others in ((0, counts[1:6]), (-1, counts[-6:-1])):
        piled = counts[place] >= max(_PILED * np.max(others), _STUCK)
        if piled and levels[place] != 0.0:
            found |= values == levels[place]
    return found


def is_constant(values: Array) -> bool:
    """Tell whether a channel (T,) says the same number all the time."""
    return bool(len(values) and np.all(np.isfinite(values)) and np.ptp(values) == 0.0)
