"""Zero-phase low pass, derivatives, spikes."""

from __future__ import annotations

from functools import cache

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError

_ORDER = 4
_ROUNDING = 1e-6
_STILL = 1e-6
"""Share of the largest speed below which nothing moves. The rounding of a quintic spline is 1e-12
of it: far enough below for no sample to stand at the edge."""

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


def spline_derivatives(
    time: Array, signals: Array, largest: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return value, first and second derivative (T, any) of an interpolating quintic spline.

    Right up to the ends, where one-sided differences are not. NaN columns stay NaN. First
    derivatives below a millionth of the largest are zero: what stands still has no direction, and
    `sign` of it would be that of the processor's rounding. `largest` (any,) are the largest first
    derivatives of the whole where the signals are a part of it.
    """
    from scipy.interpolate import make_interp_spline

    values, first, second = (np.full_like(signals, np.nan) for _ in range(3))
    known = np.flatnonzero(np.isfinite(signals[0]))
    spline = make_interp_spline(time, signals[:, known], k=5)
    values[:, known] = signals[:, known]
    slope, second[:, known] = spline(time, 1), spline(time, 2)
    fastest = np.max(np.abs(slope), axis=0) if largest is None else largest[known]
    still = np.abs(slope) <= _STILL * fastest
    first[:, known] = np.where(still, 0.0, slope)
    return values, first, second
