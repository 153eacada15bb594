"""Channel: the samples of one sensor on its own clock, in SI units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array, frozen
from seaid.errors import LogError

LARGEST = 1e30
"""Numbers beyond are no measured ones, in whatever unit, and arithmetic on them overflows."""


def is_position(name: str) -> bool:
    """Tell whether a column name of our logs is that of a position."""
    return "position" in name.rsplit(".", 1)[-1]


@dataclass(frozen=True, eq=False)
class Channel:
    """Samples `values` (T,) of a sensor at `time` (T,) [s], as logged: nothing is sorted or mended.

    `name` is a column name of our logs, as "elbow.motor_position_rad", and says the unit. `period`
    is that of an encoder that wraps around, in the same unit, None where there is none. Either
    array may have NaN. Raises LogError for arrays that are not of one length, and for a period that
    is not above zero.
    """

    name: str
    time: Array
    values: Array
    period: float | None = None

    def __post_init__(self) -> None:
        time = frozen(f"time of '{self.name}'", self.time, (None,), LogError)
        object.__setattr__(self, "time", time)
        values = frozen(f"'{self.name}'", self.values, (len(time),), LogError)
        object.__setattr__(self, "values", values)
        for what, samples in (("time", time), ("value", values)):
            beyond = np.flatnonzero(np.abs(np.nan_to_num(samples, posinf=0, neginf=0)) > LARGEST)
            if len(beyond):
                raise LogError(
                    f"'{self.name}' has a {what} of {samples[beyond[0]]:g} in sample {beyond[0]}, "
                    f"allowed are up to {LARGEST:g}: no sensor measures that; leave the sample out"
                )
        if self.period is not None and not (np.isfinite(self.period) and self.period > 0):
            raise LogError(f"the period of '{self.name}' must be above zero, found {self.period}")
