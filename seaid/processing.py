"""Processing: what was done to a log before anything was identified from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from seaid.logs.holes import HOLES
from seaid.logs.repair import Repair
from seaid.pass_band import PassBand


def has_holes(processing: Sequence[Processing]) -> bool:
    """Tell whether a log has holes in time, so that it was taken stretch by stretch."""
    return any(one.flags for one in processing)


@dataclass(frozen=True)
class Processing:
    """What was done to a log; str() tells it in one line.

    Rates [Hz] of the log and of the motion's uniform grid (`resampled`: if they differ, or the
    log's steps do), the low pass of the positions [Hz], the pass band of regressor and torque and
    its reason, what is left away at both ends [s], and what was mended when the log was read.
    """

    logged_rate_hz: float
    rate_hz: float
    resampled: bool
    position_low_pass_hz: float
    pass_band: PassBand
    trim_s: float
    repairs: tuple[Repair, ...] = ()

    @property
    def flags(self) -> tuple[str, ...]:
        """In words, the holes in the log's time."""
        return tuple(str(repair) for repair in self.repairs if repair.kind == HOLES)

    def __str__(self) -> str:
        grid = f"{self.rate_hz:.4g} Hz"
        if self.resampled:
            grid = f"uneven steps resampled to {grid} (splines)"
        low_pass = f"positions below {self.position_low_pass_hz:.3g} Hz"
        if self.position_low_pass_hz >= 0.4 * self.rate_hz:
            low_pass = "positions as they are"
        mended = f"; {len(self.repairs)} kinds of faults mended on reading" if self.repairs else ""
        return (
            f"{grid}, {low_pass}; regressor and torque below {self.pass_band}; "
            f"{self.trim_s:.2g} s left away at both ends{mended}"
        )
