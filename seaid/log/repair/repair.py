"""Repair of the channels of a log: faults are detected, counted, and repaired or refused.

Every channel may have its own clock; the result has one uniform time grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.repair.channels import bridged_s, repaired_channel
from seaid.log.repair.clocks import (
    clock_lines,
    clocks_of,
    irregular_steps,
    repaired_group,
    typical_step,
    with_regular_clock,
)
from seaid.log.repair.data import FEWEST, Channel, Repair, Repairs, is_position
from seaid.log.repair.resampling import in_gap, resampled


def repaired(
    channels: Sequence[Channel], limits: Repairs | None = None
) -> tuple[Array, dict[str, Array], tuple[Repair, ...]]:
    """Return a uniform time grid (T,) [s], {channel: samples (T,)}, and the report of repairs.

    The grid is on the clock of the first channel and covers the time that all channels share,
    without the holes of any channel. Channels without any number are all NaN. A log of one regular
    clock without faults is returned unchanged. Raises LogError, naming channel and place, beyond
    the limits.
    """
    limits = Repairs() if limits is None else limits
    if not channels:
        raise LogError("no channels to repair: a log needs one at least")
    clocks = clocks_of(channels)
    found: list[Repair] = []
    if len(clocks) == 1:
        channels = with_regular_clock(channels, limits, found)
        clocks = [channels]
    usable = _repaired_channels(clocks, limits, found)
    if len(clocks) == 1 and limits.rate_hz is None and not _changed(channels, usable):
        time, values_of = channels[0].time, {one.name: one.values for one in channels}
        return time, values_of, tuple(found)
    time, sampled = _on_grid(usable, limits)
    nothing = np.full(len(time), np.nan)
    return time, {one.name: sampled.get(one.name, nothing) for one in channels}, tuple(found)


def _repaired_channels(
    clocks: Sequence[Sequence[Channel]], limits: Repairs, found: list[Repair]
) -> dict[str, tuple[Array, Array]]:
    """Return {channel: times and samples}, on the first clock, of channels with enough samples."""
    repaired: dict[str, tuple[Array, Array]] = {}
    for group, line in zip(clocks, clock_lines(clocks, limits, found), strict=True):
        clock, kept = repaired_group(group, limits, found)
        for channel in group:
            time, values = repaired_channel(channel, clock, kept, limits, found)
            repaired[channel.name] = (time if line is None else line.to_reference(time), values)
    usable = {name: one for name, one in repaired.items() if len(one[0]) >= FEWEST}
    if not usable:
        raise LogError("no channel of the log has as many as four samples that are numbers")
    return usable


def _changed(channels: Sequence[Channel], usable: dict[str, tuple[Array, Array]]) -> bool:
    """Return whether samples were removed or moved, or the steps are irregular."""
    if len(usable) < len(channels) and any(
        np.any(np.isfinite(one.values)) for one in channels if one.name not in usable
    ):
        return True
    return bool(np.any(irregular_steps(channels[0].time))) or any(
        not np.array_equal(values, channel.values) or not np.array_equal(time, channel.time)
        for channel in channels
        if channel.name in usable
        for time, values in [usable[channel.name]]
    )


def _on_grid(
    usable: dict[str, tuple[Array, Array]], limits: Repairs
) -> tuple[Array, dict[str, Array]]:
    """Return the channels on a uniform grid over their common time, without their holes."""
    late = max(usable, key=lambda name: usable[name][0][0])
    early = min(usable, key=lambda name: usable[name][0][-1])
    start, end = float(usable[late][0][0]), float(usable[early][0][-1])
    longest = max(time[-1] - time[0] for time, _ in usable.values())
    if end - start < (1.0 - limits.most_missing) * longest:
        raise LogError(
            f"the channels share {max(end - start, 0.0):.4g} s of {longest:.4g} s: '{late}' starts "
            f"at {start:.6g} s and '{early}' ends at {end:.6g} s; allowed to miss "
            f"{limits.most_missing:.1%} (Repairs.most_missing): check that their clocks have the "
            "same unit and the same zero"
        )
    rates = {name: 1.0 / typical_step(time) for name, (time, _) in usable.items()}
    rate_hz = limits.rate_hz or max(rates.values())
    grid = start + np.arange(math.floor((end - start) * rate_hz + 1e-6) + 1) / rate_hz
    grid = np.minimum(grid, end)
    sampled = {
        name: resampled(time, values, grid, rate_hz, rates[name], smooth=is_position(name))
        for name, (time, values) in usable.items()
    }
    in_hole = np.zeros(len(grid), dtype=bool)
    for time, _ in usable.values():
        in_hole |= in_gap(time, grid, bridged_s(time, limits))
    return grid[~in_hole], {name: values[~in_hole] for name, values in sampled.items()}
