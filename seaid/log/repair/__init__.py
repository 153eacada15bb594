"""The repair of logged channels: its limits (`Repairs`), its report of `Repair`, and a `Channel`.

Clocks are repaired in `clocks`; gaps, wraps of encoders and dropouts in `channels`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Self

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, frozen
from seaid._files import read_toml
from seaid._progress import Display
from seaid.errors import LogError
from seaid.log.channels import Quantity, check_size, quantity_of
from seaid.log.tables import Reader, Within, types_of

_Positive = Annotated[float, Within("a finite number above 0", lambda value: 0 < value < np.inf)]
"""A limit in its unit."""

_Share = Annotated[float, Within("a share from 0 to 1", lambda value: 0 <= value <= 1)]
"""A limit that is a part of something."""


@dataclass(frozen=True, repr=False)
class Repairs(Display):
    """Limits within which a log is repaired; a log beyond them is refused.

    Attributes
    ----------
    rate_hz : float or None
        Rate of the common time grid; None: the mean rate of the fastest channel. A lower rate
        applies a low pass to the channels first.
    longest_gap_s : float or None
        Longest gap that is interpolated in any channel; None: 0.1 s or five typical steps. The
        time of longer gaps (holes) is excluded.
    most_gap_error : float
        Largest error of interpolating the gaps of a position, relative to its standard deviation,
        as estimated on known samples; without a given `longest_gap_s`.
    most_missing : float
        Largest share of a channel's samples that are not numbers, sudden zeros or held values, and
        of the time in gaps.
    most_disordered : float
        Largest share of stamps that are late, repeated with other values, or not finite.
    largest_drift : float
        Largest drift of one clock relative to another [s/s].

    Raises
    ------
    LogError
        For a share outside 0 to 1, and a rate or gap that is not positive and finite.

    Examples
    --------
    >>> limits = seaid.Repairs(longest_gap_s=0.05)
    >>> log = seaid.read_log("run.csv", robot, repair=limits)
    >>> [str(repair) for repair in log.report]
    """

    rate_hz: _Positive | None = None
    longest_gap_s: _Positive | None = None
    most_gap_error: _Share = 0.03
    most_missing: _Share = 0.25
    most_disordered: _Share = 0.02
    largest_drift: _Share = 2e-3

    def __post_init__(self) -> None:
        Reader(LogError).table(types_of(Repairs), vars(self), "Repairs")


_FAULTS = read_toml(Path(__file__).with_name("faults.toml"), "the faults of logs", LogError)

FOUND_CONTACT: Final = "samples of unclear load"
"""The kind of what the report of a log has about a contact that was found from torques."""


@dataclass(frozen=True, repr=False)
class Repair(Display):
    """A fault of a channel, or of the clock of several, and its repair; str() is one sentence.

    Attributes
    ----------
    channel, kind : str
        The channel, or the first of the channels, and the kind of the fault, as faults.toml has it.
    count : int
        Number of samples or places with the fault.
    time_s : float
        Time of the first one [s], on the clock of the channel.
    action : str
        What was done.
    """

    channel: str
    kind: str
    count: int
    time_s: float
    action: str

    @classmethod
    def of(cls, channel: str, kind: str, count: int, time_s: float, **values: Any) -> Self:
        """Return the repair of a kind of faults.toml, with values for the braces of its action."""
        return cls(channel, kind, count, float(time_s), _FAULTS["actions"][kind].format(**values))

    def __str__(self) -> str:
        time = f"{self.time_s:.6g}" if abs(self.time_s) < 1e5 else f"{self.time_s:.2f}"
        fault = f"{self.kind}, {self.count} found, the first at t = {time} s"
        return f"{self.channel}: {fault}: {self.action}"


@dataclass(frozen=True)
class Report:
    """The limits of a repair, and the faults that were found so far."""

    limits: Repairs
    repairs: list[Repair] = field(default_factory=list)

    def add(
        self, channel: str, kind: str, time: Array, where: BoolArray | IndexArray, **values: Any
    ) -> None:
        """Add a fault of the samples of a mask or with these numbers, if there are any."""
        rows = np.flatnonzero(where) if where.dtype == bool else where
        if len(rows):
            self.repairs.append(Repair.of(channel, kind, len(rows), time[rows[0]], **values))

    def check(self, code: str, size: float, **values: Any) -> None:
        """Raise LogError for a fault of faults.toml whose size is beyond its limit."""
        limit, *texts = (_FAULTS["limits"][code][key] for key in ("limit", "fault", "advice"))
        allowed, (fault, advice) = getattr(self.limits, limit), (x.format(**values) for x in texts)
        if size > allowed:
            raise LogError(f"{fault}; allowed {allowed:.3g} (Repairs.{limit}): {advice}")


FEWEST = 4
"""Fewest samples of a channel that can be interpolated."""

LARGEST = 1e30
"""Largest magnitude of a sample in any unit, so that arithmetic does not overflow."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Samples `values` (T,) of a sensor at `time` (T,) [s] as logged, unsorted and not repaired.

    `name` is a column name of seaid with the unit, as "elbow.motor_position_rad". `period` is that
    of an encoder that wraps around, in the same unit, or None. The samples show the state `delay_s`
    before their time. Both arrays may contain NaN. Raises LogError for arrays of different lengths.
    """

    name: str
    time: Array
    values: Array
    period: float | None = None
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        time = frozen(f"time of '{self.name}'", self.time, (None,), LogError)
        object.__setattr__(self, "time", time)
        values = frozen(f"'{self.name}'", self.values, (len(time),), LogError)
        object.__setattr__(self, "values", values)
        check_size(f"time of '{self.name}'", time, LARGEST)
        check_size(f"'{self.name}'", values, LARGEST)

    @property
    def quantity(self) -> Quantity:
        """The row of its name in the table of channels."""
        return quantity_of(self.name)
