"""Encoders that wrap around: the period they wrap by, and the angle without wraps."""

from __future__ import annotations

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError

_FARTHER = 2.0
_ALIKE = 0.02
_FULL = 1.0 + 1e-3
_STRAY = 0.1
_CLEAR = 0.4
_TURN = 2 * np.pi
_GAP, _MEAN = 1.5, 5


def wrap_period(time: Array, values: Array) -> float | None:
    """Return the period by which a position (T,) wraps around, None where it does not.

    A wrap is a step of more than half the range and far larger than those beside it, after which
    the speed is what it was. Nearly all must be alike, and the range no larger than they are. A
    period near a whole, half or quarter turn, or near a power of two of the encoder's own steps
    (4096 counts), is taken to be just that.
    """
    steps = np.diff(values)
    jumps = np.flatnonzero(np.abs(steps) > 0.5 * np.ptp(values))
    inner = jumps[(jumps > 0) & (jumps < len(steps) - 1)]
    if not len(inner):
        return None
    rates = steps / np.diff(time)
    before, after = rates[inner - 1], rates[inner + 1]
    usual = np.maximum(np.abs(before), np.abs(after)) * np.diff(time)[inner]
    clear = np.diff(time)[inner] < _GAP * np.median(np.diff(time))
    if not np.any(clear):
        return None
    inner = inner[clear]
    before, after, usual = before[clear], after[clear], usual[clear]
    if np.mean(np.abs(steps[inner]) < _FARTHER * usual) > _STRAY:
        return None
    expected = 0.5 * (before + after) * np.diff(time)[inner]
    periods = np.abs(steps[inner] - expected)
    period = _plausible(float(np.median(periods)), values)
    alike = np.abs(periods - period) <= _ALIKE * period + 0.5 * usual
    if np.mean(~alike) > _STRAY or np.ptp(values) > _FULL * period:
        return None
    # a position that only jumps there and back is a glitch: it wraps as it crosses the edge
    against = np.sign(steps[inner]) == -np.sign(before + after)
    strays = np.mean(~against & (usual > 1e-3 * period))
    return period if np.any(against) and strays <= _STRAY else None


def unwrapped(name: str, time: Array, values: Array, period: float) -> tuple[Array, int, int]:
    """Return a position (T,) without wraps, how many there were, and the sample of the first.

    Each sample is taken into the period that is nearest to where the last speed leads, so the
    position may move by more than half a period between samples, once it is under way. Raises
    LogError where it is more than 0.4 of a period from there.
    """
    steps = np.diff(values)
    nearest = steps - period * np.round(steps / period)
    if np.max(np.abs(nearest), initial=0.0) > period / 4:
        nearest = _predicted(name, time, nearest, period)
    turns = np.round((nearest - steps) / period)
    wraps = np.flatnonzero(turns)
    whole = values + period * np.concatenate([[0.0], np.cumsum(turns)])
    return whole, len(wraps), int(wraps[0]) + 1 if len(wraps) else 0


def _predicted(name: str, time: Array, nearest: Array, period: float) -> Array:
    """Return steps in the period that is nearest to the speed of the step before.

    Over a gap, nearest to the mean speed before and after, which may differ by a period's half.
    """
    durations, found = np.diff(time).tolist(), nearest.tolist()
    long = _GAP * float(np.median(durations))
    rate = found[0] / durations[0]
    for place in range(1, len(found)):
        duration = durations[place]
        expected, doubt = rate * duration, 0.0
        if duration > long and place + 1 < len(found):
            before = sum(found[max(0, place - _MEAN) : place])
            before /= time[place] - time[max(0, place - _MEAN)]
            follows = _follows(found, durations, place + 1, before, period)
            expected, doubt = 0.5 * (before + follows) * duration, 0.5 * abs(follows - before)
        found[place] += period * round((expected - found[place]) / period)
        off = max(abs(found[place] - expected), doubt * duration)
        if off > _CLEAR * period and abs(found[place]) > period / 4:
            raise LogError(
                f"'{name}' moves by {abs(found[place]):.3g} from t = {time[place]:.6g} s to the "
                f"next sample, {duration:.3g} s later, and wraps around every "
                f"{period:.6g}: how often cannot be told (clear is at most {_CLEAR:g} of a "
                "period from where the speed before leads); log at a higher rate, or leave this "
                "time out"
            )
        rate = found[place] / duration
    return np.array(found)


def _follows(
    found: list[float], durations: list[float], start: int, rate: float, period: float
) -> float:
    """Return the mean speed of the steps from `start` on, the first one near `rate`."""
    end, total = min(start + _MEAN, len(found)), 0.0
    for place in range(start, end):
        expected = rate * durations[place]
        step = found[place] + period * round((expected - found[place]) / period)
        rate = step / durations[place]
        total += step
    return total / sum(durations[start:end])


def _plausible(period: float, values: Array) -> float:
    """Return the period that an encoder has near a found one: parts of a turn, 2^k steps."""
    from seaid.logs.dropouts import resolution

    step = resolution(values)
    candidates = [_TURN, _TURN / 2, _TURN / 4, 2 * _TURN]
    if step > 0 and period / step < 2**24:
        candidates.append(step * 2.0 ** round(np.log2(period / step)))
    near = min(candidates, key=lambda one: abs(one - period))
    return float(near) if abs(near - period) <= _ALIKE * period else period
