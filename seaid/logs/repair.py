"""Channels of a foreign log made fit for use: what is wrong is found, counted, mended or refused.

Every channel may have its own clock; out comes one uniform time grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.errors import LogError
from seaid.logs.channels import Channel
from seaid.logs.clocks import (
    ClockLine,
    MendedClock,
    clock_line,
    is_paired,
    mended_clock,
    typical_step,
)
from seaid.logs.dropouts import SLOWER, held_dropouts, is_constant, saturated, zero_dropouts
from seaid.logs.resampling import gap_error, resampled
from seaid.logs.wrapping import unwrapped, wrap_period

_REGULAR = 1e-3
_GAP = 5.0
_FEWEST = 4
_TORQUE_GAP_S = 0.5


@dataclass(frozen=True)
class Repairs:
    """Limits within which a log is mended; beyond them it is refused. Shares are between 0 and 1.

    `rate_hz`: of the common time grid (None: the mean rate of the fastest channel, so that nothing
    is lost; where a lower one is asked for, channels pass a low pass first). `longest_gap_s`: that
    is bridged in any channel; None: in a position as long as bridges over such gaps, tried where
    the samples are known, add an error of at most `most_gap_error` of its standard deviation, and
    half a second in a torque, current or voltage. `most_missing`: share of a channel's
    samples that are no numbers, sudden zeros or held, and of the time that lies in gaps.
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
            if not (isinstance(value, int | float) and 0 <= value <= largest) or (
                optional and not 0 < value < math.inf
            ):
                allowed = "a finite number above 0, or None" if optional else "a share from 0 to 1"
                raise LogError(f"Repairs.{field.name} must be {allowed}, found {value!r}")


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


def repaired(
    channels: Sequence[Channel], limits: Repairs | None = None
) -> tuple[Array, dict[str, Array], tuple[Repair, ...]]:
    """Return a uniform time grid (T,) [s], {channel: samples (T,)}, and what was found and done.

    The grid is on the clock of the first channel and covers the time that all channels share.
    Channels without any number are all NaN. Where nothing is wrong with a log of one regular clock,
    it comes out as it went in. Raises LogError, naming channel and place, beyond the limits.
    """
    limits = Repairs() if limits is None else limits
    if not channels:
        raise LogError("no channels to repair: a log needs one at least")
    clocks = _clocks(channels)
    mended: dict[str, tuple[Array, Array]] = {}
    found: list[Repair] = []
    lines = _clock_lines(clocks, limits, found)
    for group, line in zip(clocks, lines, strict=True):
        clock, kept = _mended_group(group, limits, found)
        for channel in group:
            time, values = _mended_channel(channel, clock, kept, limits, found)
            mended[channel.name] = (time if line is None else line.to_reference(time), values)
    usable = {name: one for name, one in mended.items() if len(one[0]) >= _FEWEST}
    if not usable:
        raise LogError("no channel of the log has as many as four samples that are numbers")
    if len(clocks) == 1 and limits.rate_hz is None and not _changed(channels, usable):
        time, values_of = channels[0].time, {one.name: one.values for one in channels}
        return time, values_of, tuple(found)
    time, sampled = _on_grid(usable, limits, found)
    nothing = np.full(len(time), np.nan)
    return time, {one.name: sampled.get(one.name, nothing) for one in channels}, tuple(found)


def _clocks(channels: Sequence[Channel]) -> list[list[Channel]]:
    """Return the channels grouped by the clock that stamps them."""
    clocks: list[list[Channel]] = []
    for channel in channels:
        for group in clocks:
            if np.array_equal(group[0].time, channel.time, equal_nan=True):
                group.append(channel)
                break
        else:
            clocks.append([channel])
    return clocks


def _clock_lines(
    clocks: list[list[Channel]], limits: Repairs, found: list[Repair]
) -> list[ClockLine | None]:
    """Return how to bring each clock to the first one; None: as it is.

    Only rows that belong together can tell: clocks with as many samples, in step. An offset below
    one step cannot be told from sensors that sample one after the other, and stays.
    """
    first = clocks[0][0]
    lines: list[ClockLine | None] = [None]
    for group in clocks[1:]:
        own = group[0]
        line = clock_line(own.time, first.time) if len(own.time) == len(first.time) else None
        step = typical_step(first.time[np.isfinite(first.time)])
        if line is None or not is_paired(line, step):
            lines.append(None)
            continue
        span = float(np.nanmax(first.time) - np.nanmin(first.time))
        drifts = abs(line.drift) * span > step and abs(line.drift) > line.drift_error
        shifted = abs(line.offset_s) > step
        line = replace(
            line,
            drift=line.drift if drifts else 0.0,
            offset_s=line.offset_s if shifted else 0.0,
        )
        name, start = _clock_name(group), float(np.nanmin(own.time))
        if drifts and abs(line.drift) > limits.largest_drift:
            raise LogError(
                f"the clock of {name} drifts by {line.drift:.3g} s/s against that of "
                f"{_clock_name(clocks[0])}, allowed {limits.largest_drift:.3g} "
                "(Repairs.largest_drift): is its unit right, and are its rows those of the other?"
            )
        for kind, there, size in (
            ("clock offset", shifted, f"{line.offset_s:.6g} s"),
            ("clock drift", drifts, f"{line.drift * 1e6:.4g} us/s"),
        ):
            if there:
                action = f"{size} against {_clock_name(clocks[0])}, taken out"
                found.append(Repair(name, kind, 1, start, action))
        lines.append(line if drifts or shifted else None)
    return lines


def _clock_name(group: Sequence[Channel]) -> str:
    others = len(group) - 1
    return f"'{group[0].name}'" + (f" and {others} more" if others else "")


def _mended_group(
    group: list[Channel], limits: Repairs, found: list[Repair]
) -> tuple[MendedClock, BoolArray]:
    """Return the clock of channels in order, and which of its samples are kept."""
    name = _clock_name(group)
    raw = group[0].time
    values = np.column_stack([channel.values for channel in group])
    finite = raw[np.isfinite(raw)]
    if len(finite) < _FEWEST:
        raise LogError(
            f"the clock of {name} has {len(finite)} finite stamps, at least {_FEWEST} are needed"
        )
    longest = limits.longest_gap_s or _GAP * typical_step(finite)
    clock = mended_clock(name, raw, values, longest)
    repeats = np.concatenate([[False], np.diff(clock.time) <= 0])
    same = np.all(
        np.diff(values[clock.rows], axis=0, prepend=np.nan) == 0, axis=1
    )  # NaN differ from all
    other = repeats & ~same
    disordered = len(clock.unknown) + len(clock.late) + int(other.sum())
    for kind, places, action in (
        ("stamps that are not finite", clock.unknown, "their samples were left out"),
        ("late samples", clock.late, "sorted into place"),
        ("repeated stamps", clock.rows[repeats], "the first sample of each was kept"),
        (
            "clock jumps",
            np.array([row for row, _ in clock.jumps], dtype=np.intp),
            "of " + ", ".join(f"{size:.4g} s" for _, size in clock.jumps) + ", taken out: the "
            "values go on",
        ),
    ):
        if len(places):
            before = raw[max(int(places[0]) - 1, 0)]
            found.append(Repair(name, kind, len(places), float(before), action))
    if disordered > limits.most_disordered * len(raw):
        raise LogError(
            f"the clock of {name}: {disordered} of {len(raw)} stamps are late, repeated with other "
            f"values or not finite, the first near t = {_first_time(raw, clock, other):.6g} s; "
            f"allowed is a share of {limits.most_disordered:g} (Repairs.most_disordered): does the "
            "time have all its digits? Log finer stamps, or sort the log"
        )
    _note_steps(name, clock.time[~repeats], limits, found)
    return clock, ~repeats


def _first_time(raw: Array, clock: MendedClock, other: BoolArray) -> float:
    rows = np.concatenate([clock.unknown, clock.late, clock.rows[other]])
    return float(raw[max(int(np.min(rows)) - 1, 0)])


def _note_steps(name: str, time: Array, limits: Repairs, found: list[Repair]) -> None:
    """Note irregular steps and gaps of a clock, and refuse too much time in gaps."""
    steps, step = np.diff(time), typical_step(time)
    gaps = np.flatnonzero(steps > _GAP * step)
    irregular = np.flatnonzero(np.abs(steps - np.median(steps)) > _REGULAR * np.median(steps))
    if len(irregular) > len(gaps):
        action = f"steps of {np.min(steps):.3g} to {np.max(steps):.3g} s, resampled"
        found.append(
            Repair(name, "irregular steps", len(irregular), float(time[irregular[0]]), action)
        )
    if not len(gaps):
        return
    lost = float(np.sum(steps[gaps]) / (time[-1] - time[0]))
    action = f"of up to {np.max(steps):.3g} s, bridged: {lost:.1%} of the time"
    found.append(Repair(name, "gaps", len(gaps), float(time[gaps[0]]), action))
    if lost > limits.most_missing:
        raise LogError(
            f"the clock of {name} has {len(gaps)} gaps with {lost:.1%} of the time in them, the "
            f"first at t = {time[gaps[0]]:.6g} s; allowed {limits.most_missing:.1%} "
            "(Repairs.most_missing): take a part of the log without them"
        )


def _mended_channel(
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
    if len(values) >= _FEWEST:
        values = _without_wraps(channel, time, values, found)
    held = held_dropouts(values, 2 if _is_position(channel) else 3)
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
    if len(values) < _FEWEST:
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


def _is_position(channel: Channel) -> bool:
    return "position" in channel.name.rsplit(".", 1)[-1]


def _without_wraps(channel: Channel, time: Array, values: Array, found: list[Repair]) -> Array:
    period = channel.period
    if period is None and _is_position(channel):
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
    stuck = np.zeros(1, dtype=bool) if _is_position(channel) else saturated(values)
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
    """Refuse a channel with a gap that cannot be bridged."""
    steps = np.diff(time)
    place = int(np.argmax(steps))
    gap, usual = float(steps[place]), _GAP * typical_step(time)
    text = f"'{channel.name}' has a gap of {gap:.3g} s at t = {time[place]:.6g} s"
    hint = "take the parts before and after it as two logs"
    given = limits.longest_gap_s
    longest = max(_TORQUE_GAP_S if given is None else given, usual)
    if gap > longest and not (given is None and _is_position(channel)):
        raise LogError(f"{text}, allowed {longest:.3g} s (Repairs.longest_gap_s): {hint}")
    if given is not None or gap <= usual or not _is_position(channel):
        return
    error = gap_error(time, values, usual)
    if error is None or error > limits.most_gap_error:
        known = "the log is too short to tell what" if error is None else f"{error:.1%} is what"
        raise LogError(
            f"{text}: {known} bridging such gaps adds to the channel (error over standard "
            f"deviation, from known stretches), allowed {limits.most_gap_error:.1%} "
            f"(Repairs.most_gap_error; longest_gap_s sets a length instead): {hint}"
        )


def _changed(channels: Sequence[Channel], usable: dict[str, tuple[Array, Array]]) -> bool:
    """Tell whether anything was taken out or moved, or the steps are not alike."""
    if len(usable) < len(channels) and any(
        np.any(np.isfinite(one.values)) for one in channels if one.name not in usable
    ):
        return True
    steps = np.diff(channels[0].time)
    regular = np.all(np.abs(steps - np.median(steps)) <= _REGULAR * np.median(steps))
    return not regular or any(
        not np.array_equal(values, channel.values) or not np.array_equal(time, channel.time)
        for channel in channels
        if channel.name in usable
        for time, values in [usable[channel.name]]
    )


def _on_grid(
    usable: dict[str, tuple[Array, Array]], limits: Repairs, found: list[Repair]
) -> tuple[Array, dict[str, Array]]:
    """Return the channels on a uniform grid over the time that they share."""
    late = max(usable, key=lambda name: usable[name][0][0])
    early = min(usable, key=lambda name: usable[name][0][-1])
    start, end = float(usable[late][0][0]), float(usable[early][0][-1])
    longest = max(time[-1] - time[0] for time, _ in usable.values())
    if end - start < (1.0 - limits.most_missing) * longest:
        raise LogError(
            f"the channels share {max(end - start, 0.0):.4g} s of {longest:.4g} s: '{late}' starts "
            f"at {start:.6g} s and '{early}' ends at {end:.6g} s; allowed to miss "
            f"{limits.most_missing:.1%} (Repairs.most_missing): are their clocks in the same unit, "
            "with the same zero?"
        )
    rates = {name: 1.0 / typical_step(time) for name, (time, _) in usable.items()}
    rate_hz = limits.rate_hz or max(rates.values())
    grid = start + np.arange(math.floor((end - start) * rate_hz + 1e-6) + 1) / rate_hz
    grid = np.minimum(grid, end)
    return grid, {
        name: resampled(
            time, values, grid, rate_hz, rates[name], smooth="position" in name.rsplit(".", 1)[-1]
        )
        for name, (time, values) in usable.items()
    }
