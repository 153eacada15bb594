"""Holes in the time of a log, and the stretches without one between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.log import MINIMUM_SAMPLES, Log
from seaid.log.repair.clocks import longest_bridge
from seaid.log.repair.data import Repair

MOST_EXCLUDED = 0.5
"""A log is refused if more than this share of its time lies in holes and too short stretches."""

HOLES: Final = "holes in time"
"""The kind of the `Repair` that reports holes."""


@dataclass(frozen=True)
class Hole:
    """An interval without samples, between two samples [s], too long to be interpolated."""

    start_s: float
    end_s: float

    @property
    def length_s(self) -> float:
        """Length of the interval."""
        return self.end_s - self.start_s

    def __str__(self) -> str:
        return f"{self.length_s:.3g} s at t = {self.start_s:.6g} s"


def holes(time: Array) -> list[Hole]:
    """Return the holes of increasing time stamps (T,) [s]: steps too long to be bridged."""
    before = np.flatnonzero(np.diff(time) > longest_bridge(time))
    return [Hole(float(time[one]), float(time[one + 1])) for one in before]


def check_whole(log: Log) -> None:
    """Raise LogError naming the first hole of a log, if it has any."""
    found = holes(log.time)
    if found:
        raise LogError(
            f"the log has holes in time ({len(found)} found, the first of {found[0]}), in which "
            "the motion is unknown: take a part without one, log.between(start_s, end_s)"
        )


def stretches(log: Log, shortest_s: float = 0.0) -> list[Log]:
    """Return the parts of a log between its holes that are `shortest_s` or longer.

    A log without a hole is returned unchanged. Otherwise the `report` of the first part has one
    more entry with the number of holes and the excluded share of the time. Raises LogError if that
    share is above one half.
    """
    found = holes(log.time)
    if not found:
        return [log]
    edges = [-np.inf, *(hole.end_s for hole in found), np.inf]
    places = np.searchsorted(log.time, edges)
    spans = [slice(*edge) for edge in pairwise(places)]
    lengths = [float(log.time[one.stop - 1] - log.time[one.start]) for one in spans]
    used = [
        place
        for place, one in enumerate(spans)
        if one.stop - one.start >= MINIMUM_SAMPLES and lengths[place] >= shortest_s
    ]
    whole = float(log.time[-1] - log.time[0])
    excluded = 1.0 - sum(lengths[place] for place in used) / whole
    worst = max(found, key=lambda hole: hole.length_s)
    if excluded > MOST_EXCLUDED:
        raise LogError(
            f"the log has holes in time ({len(found)} found, the longest of {worst}): they and the "
            f"stretches between them that are too short to use are {excluded:.0%} of "
            f"{whole:.4g} s, allowed {MOST_EXCLUDED:.0%}; record again without losing samples, or "
            "pass the good stretches as separate logs, log.between(start_s, end_s)"
        )
    parts = [log.between(log.time[spans[one].start], edges[one + 1]) for one in used]
    short = len(spans) - len(used)
    stubs = f" ({short} stretches between them are too short)" if short else ""
    action = (
        f"of up to {worst}; {excluded:.1%} of the log's time is excluded{stubs}, and so are the "
        "filter transients around them"
    )
    repair = Repair("time_s", HOLES, len(found), found[0].start_s, action)
    reports = [(*log.report, repair), *[()] * (len(parts) - 1)]
    return [replace(part, report=report) for part, report in zip(parts, reports, strict=True)]
