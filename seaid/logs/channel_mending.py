"""One channel made fit for use: no dropouts, no wraps; saturation and gaps within limits."""

from __future__ import annotations

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.errors import LogError
from seaid.logs.channels import Channel, is_position
from seaid.logs.clocks import MendedClock, longest_bridge, longest_step
from seaid.logs.dropouts import SLOWER, held_dropouts, is_constant, saturated, zero_dropouts
from seaid.logs.repair import Repair, Repairs
from seaid.logs.resampling import FEWEST, gap_error
from seaid.logs.wrapping import unwrapped, wrap_period


def mended_channel(
    channel: Channel, clock: MendedClock, kept: BoolArray, limits: Repairs, found: list[Repair]
) -> tuple[Array, Array]:
    """Return stamps and values of the samples of a channel that are good, without wraps."""
    time, values = clock.time, channel.values[clock.rows]
    if np.all(np.isnan(values)):
        return np.empty(0), np.empty(0)
    time, values = time[kept], values[kept]
    total = len(values)
    time, values, missing = _without(
        channel, time, values, ~np.isfinite(values), "values that are no number", found
    )
    if is_constant(values):
        action = f"it is {values[0]:.6g} all the time; left as it is"
        found.append(Repair(channel.name, "constant channel", 1, float(time[0]), action))
    time, values, lost = _without(
        channel, time, values, zero_dropouts(values), "sudden zeros", found
    )
    missing += lost
    if len(values) >= FEWEST:
        values = _without_wraps(channel, time, values, found)
    held = held_dropouts(values, 2 if is_position(channel.name) else 3)
    slower = float(np.mean(held)) > SLOWER if len(held) else False
    kind = "values of a slower sensor" if slower else "held values"
    time, values, lost = _without(channel, time, values, held, kind, found)
    missing += 0 if slower else lost
    if missing > limits.most_missing * total:
        raise LogError(
            f"'{channel.name}' lacks {missing} of {total} samples (no numbers, sudden zeros or "
            f"held values), allowed {limits.most_missing:.1%} (Repairs.most_missing): take a part "
            "of the log in which the sensor works, or leave the column out"
        )
    if len(values) < FEWEST:
        return time, values
    _check_saturation(channel, time, values, limits, found)
    _check_gap(channel, time, values, limits)
    return time, values


def _without(
    channel: Channel,
    time: Array,
    values: Array,
    bad: BoolArray,
    kind: str,
    found: list[Repair],
) -> tuple[Array, Array, int]:
    """Return a channel without some samples, and how many these are."""
    count = int(bad.sum())
    if count:
        at = float(time[np.argmax(bad)])
        found.append(Repair(channel.name, kind, count, at, "left out and interpolated"))
    return time[~bad], values[~bad], count


def _without_wraps(channel: Channel, time: Array, values: Array, found: list[Repair]) -> Array:
    period = channel.period
    if period is None and is_position(channel.name):
        period = wrap_period(time, values)
    if period is None:
        return values
    whole, count, first = unwrapped(channel.name, time, values, period)
    if count:
        given = "as given" if channel.period else "found in the jumps"
        action = f"by {period:.6g} ({given}), made one angle"
        found.append(Repair(channel.name, "wraps", count, float(time[first]), action))
    return whole


def _check_saturation(
    channel: Channel, time: Array, values: Array, limits: Repairs, found: list[Repair]
) -> None:
    """Note a torque, current or voltage that is stuck at its extreme; refuse too much of it."""
    stuck = np.zeros(1, dtype=bool) if is_position(channel.name) else saturated(values)
    if not np.any(stuck):
        return
    count, at = int(stuck.sum()), float(time[np.argmax(stuck)])
    level = values[np.argmax(stuck)]
    action = f"stuck at {level:.4g}, which cannot be mended: left as they are"
    found.append(Repair(channel.name, "saturated samples", count, at, action))
    if count > limits.most_saturated * len(values):
        raise LogError(
            f"'{channel.name}' is stuck at its extreme ({level:.4g}) in {count} of {len(values)} "
            f"samples, the first at t = {at:.6g} s; allowed {limits.most_saturated:.1%} "
            "(Repairs.most_saturated): the true value is not known there; move the robot less "
            "hard, or widen the range of the sensor"
        )


def _check_gap(channel: Channel, time: Array, values: Array, limits: Repairs) -> None:
    """Refuse a channel with a gap that cannot be bridged; holes are excluded, see `bridged_s`."""
    steps = np.diff(time)
    hint = "take the parts before and after it as two logs"
    given, longest, usual = limits.longest_gap_s, bridged_s(time, limits), longest_step(time)
    if given is not None and np.max(steps) > longest:
        place = int(np.argmax(steps))
        raise LogError(
            f"'{channel.name}' has a gap of {steps[place]:.3g} s at t = {time[place]:.6g} s, "
            f"allowed {longest:.3g} s (Repairs.longest_gap_s): {hint}"
        )
    bridged = np.where(steps <= longest, steps, 0.0)
    place = int(np.argmax(bridged))
    if given is not None or bridged[place] <= usual or not is_position(channel.name):
        return
    error = gap_error(time, values, usual, longest)
    if error is None or error > limits.most_gap_error:
        known = "the log is too short to tell what" if error is None else f"{error:.1%} is what"
        raise LogError(
            f"'{channel.name}' has a gap of {bridged[place]:.3g} s at t = {time[place]:.6g} s: "
            f"{known} bridging such gaps adds to the channel (error over standard "
            f"deviation, from known stretches), allowed {limits.most_gap_error:.1%} "
            f"(Repairs.most_gap_error; longest_gap_s sets a length instead): {hint}"
        )


def bridged_s(time: Array, limits: Repairs) -> float:
    """Return the longest step [s] of a channel's stamps (T,) that is bridged."""
    if limits.longest_gap_s is None:
        return longest_bridge(time)
    return max(limits.longest_gap_s, longest_step(time))
