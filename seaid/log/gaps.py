"""Holes in the time of a log, and the stretches without one between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.log import MINIMUM_SAMPLES, Log
from seaid.log.repair.clocks import longest_bridge
from seaid.log.repair.data import Repair

MOST_EXCLUDED = 0.5
"""Share of a log's time in holes and in stretches too short to use above which it is refused."""

HOLES = "holes in time"
"""The kind of `Repair` that tells of them."""


@dataclass(frozen=True)
class Hole:
    """A time without samples, from the last one before it to the first one after it [s]."""

    start_s: float
    end_s: float

    @property
    def length_s(self) -> float:
        """How long it is."""
        return self.end_s - self.start_s

    def __str__(self) -> str:
        return f"{self.length_s:.3g} s at t = {self.start_s:.6g} s"


def holes(time: Array) -> list[Hole]:
    """Return the holes between stamps (T,) [s] that grow: steps too long to be bridged."""
    before = np.flatnonzero(np.diff(time) > longest_bridge(time))
    return [Hole(float(time[one]), float(time[one + 1])) for one in before]


def check_whole(log: Log) -> None:
    """Raise LogError naming the first hole where a log has any: for what must not go over one."""
    found = holes(log.time)
    if found:
        raise LogError(
            f"the log has holes in time ({len(found)} found, the first of {found[0]}), over which "
            "nothing is known of the motion: take a part without one, log.between(start_s, end_s)"
        )


def stretches(log: Log, shortest_s: float = 0.0) -> list[Log]:
    """Return the parts of a log between its holes that are `shortest_s` or longer.

    A log without a hole comes back as it is. Otherwise the first part's `report` has one more
    entry: how many holes there are, and how much of the log is not used. Raises LogError where that
    is more than half of its time.
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
            "give the good stretches as logs of their own, log.between(start_s, end_s)"
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
