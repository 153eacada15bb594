"""Repairs: limits within which a log is mended; Repair: what was found in it and done.

Channel: the samples of one sensor on its own clock, in SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from seaid._arrays import Array, frozen
from seaid.errors import LogError, shown


@dataclass(frozen=True)
class Repairs:
    """Limits within which a log is mended; beyond them it is refused. Shares are between 0 and 1.

    `rate_hz`: of the common time grid (None: the mean rate of the fastest channel, so that nothing
    is lost; where a lower one is asked for, channels pass a low pass first). `longest_gap_s`: that
    is bridged in any channel; None: 0.1 s or five usual steps, in a position as long as such
    bridges, tried where the samples are known, add an error of at most `most_gap_error` of its
    standard deviation; the time of longer ones, the holes, is excluded. `most_missing`: share of a
    channel's samples that are no numbers, sudden zeros or held, and of the time that lies in gaps.
    `most_disordered`: share of stamps that are late, repeated with other values, or not finite.
    `most_saturated`: share of a torque's, current's or voltage's samples stuck at its extreme.
    `largest_drift`: of one clock against another, s/s. Raises LogError for what cannot be meant.
    """

    rate_hz: float | None = None
    longest_gap_s: float | None = None
    most_gap_error: float = 0.03
    most_missing: float = 0.25
    most_disordered: float = 0.02
    most_saturated: float = 0.05
    largest_drift: float = 2e-3

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            optional = field.name in ("rate_hz", "longest_gap_s")
            if value is None and optional:
                continue
            largest = math.inf if optional else 1.0
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (is_number and 0 <= value <= largest) or (optional and not 0 < value < math.inf):
                allowed = "a finite number above 0, or None" if optional else "a share from 0 to 1"
                raise LogError(f"Repairs.{field.name} must be {allowed}, found {shown(value)}")


@dataclass(frozen=True)
class Repair:
    """What was found in a channel, or in the clock of several: `kind`, `count` of samples or places
    with it, the first at `time_s` [s] (on its own clock), and what was done; str() in one sentence.
    """

    channel: str
    kind: str
    count: int
    time_s: float
    action: str

    def __str__(self) -> str:
        return (
            f"{self.channel}: {self.kind}, {self.count} found, the first at t = "
            f"{self.time_s:.6g} s: {self.action}"
        )


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
