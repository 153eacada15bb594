"""Clocks of channels made fit for use: brought to the first one, put in order, without repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.errors import LogError
from seaid.logs.channels import Channel
from seaid.logs.clocks import (
    ClockLine,
    MendedClock,
    clock_line,
    irregular_steps,
    is_paired,
    longest_bridge,
    longest_step,
    mended_clock,
    typical_step,
)
from seaid.logs.repair import Repair, Repairs
from seaid.logs.resampling import FEWEST


def clocks_of(channels: Sequence[Channel]) -> list[list[Channel]]:
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


def clock_lines(
    clocks: Sequence[Sequence[Channel]], limits: Repairs, found: list[Repair]
) -> list[ClockLine | None]:
    """Return how to bring each clock to the first one; None: as it is.

    Only rows that belong together can tell: clocks with as many samples, in step. An offset below
    one step cannot be told from sensors that sample one after the other, and stays.
    """
    return [None, *(_line(group, clocks[0], limits, found) for group in clocks[1:])]


def _line(
    group: Sequence[Channel], first: Sequence[Channel], limits: Repairs, found: list[Repair]
) -> ClockLine | None:
    """Return how to bring the clock of channels to that of the first ones; None: as it is."""
    own, reference = group[0].time, first[0].time
    line = clock_line(own, reference) if len(own) == len(reference) else None
    step = typical_step(reference[np.isfinite(reference)])
    if line is None or not is_paired(line, step):
        return None
    span = float(np.nanmax(reference) - np.nanmin(reference))
    drifts = abs(line.drift) * span > step and abs(line.drift) > line.drift_error
    shifted = abs(line.offset_s) > step
    name, name_first = _clock_name(group), _clock_name(first)
    if drifts and abs(line.drift) > limits.largest_drift:
        raise LogError(
            f"the clock of {name} drifts by {line.drift:.3g} s/s against that of {name_first}, "
            f"allowed {limits.largest_drift:.3g} (Repairs.largest_drift): is its unit right, and "
            "are its rows those of the other?"
        )
    for kind, there, size in (
        ("clock offset", shifted, f"{line.offset_s:.6g} s"),
        ("clock drift", drifts, f"{line.drift * 1e6:.4g} us/s"),
    ):
        if there:
            action = f"{size} against {name_first}, taken out"
            found.append(Repair(name, kind, 1, float(np.nanmin(own)), action))
    if not drifts and not shifted:
        return None
    return replace(
        line, drift=line.drift if drifts else 0.0, offset_s=line.offset_s if shifted else 0.0
    )


def _clock_name(group: Sequence[Channel]) -> str:
    others = len(group) - 1
    return f"'{group[0].name}'" + (f" and {others} more" if others else "")


def mended_group(
    group: Sequence[Channel], limits: Repairs, found: list[Repair]
) -> tuple[MendedClock, BoolArray]:
    """Return the clock of channels in order, and which of its samples are kept."""
    name = _clock_name(group)
    raw = group[0].time
    values = np.column_stack([channel.values for channel in group])
    finite = raw[np.isfinite(raw)]
    if len(finite) < FEWEST:
        raise LogError(
            f"the clock of {name} has {len(finite)} finite stamps, at least {FEWEST} are needed"
        )
    clock = mended_clock(name, raw, values, limits.longest_gap_s or longest_step(finite))
    repeats = np.concatenate([[False], np.diff(clock.time) <= 0])
    _note_disorder(name, raw, clock, repeats, found)
    changes = np.diff(values[clock.rows], axis=0, prepend=np.nan)  # NaN differ from all
    _check_disorder(name, raw, clock, repeats & ~np.all(changes == 0, axis=1), limits)
    _note_steps(name, clock.time[~repeats], limits, found)
    return clock, ~repeats


def _note_disorder(
    name: str, raw: Array, clock: MendedClock, repeats: BoolArray, found: list[Repair]
) -> None:
    """Note what was wrong with the order of the stamps of a clock."""
    jumps = ", ".join(f"{size:.4g} s" for _, size in clock.jumps)
    for kind, places, action in (
        ("stamps that are not finite", clock.unknown, "their samples were left out"),
        ("late samples", clock.late, "sorted into place"),
        ("repeated stamps", clock.rows[repeats], "the first sample of each was kept"),
        (
            "clock jumps",
            np.array([row for row, _ in clock.jumps], dtype=np.intp),
            f"of {jumps}, taken out: the values go on",
        ),
    ):
        if len(places):
            before = float(raw[max(int(places[0]) - 1, 0)])
            found.append(Repair(name, kind, len(places), before, action))


def _check_disorder(
    name: str, raw: Array, clock: MendedClock, other: BoolArray, limits: Repairs
) -> None:
    """Refuse too many stamps out of order; `other` are those repeated with other values."""
    rows = np.concatenate([clock.unknown, clock.late, clock.rows[other]])
    if len(rows) > limits.most_disordered * len(raw):
        first = float(raw[max(int(np.min(rows)) - 1, 0)])
        raise LogError(
            f"the clock of {name}: {len(rows)} of {len(raw)} stamps are late, repeated with other "
            f"values or not finite, the first near t = {first:.6g} s; "
            f"allowed is a share of {limits.most_disordered:g} (Repairs.most_disordered): does the "
            "time have all its digits? Log finer stamps, or sort the log"
        )


def _note_steps(name: str, time: Array, limits: Repairs, found: list[Repair]) -> None:
    """Note irregular steps and gaps of a clock, and refuse too much time in gaps."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > longest_step(time))
    irregular = np.flatnonzero(irregular_steps(time))
    if len(irregular) > len(gaps):
        action = f"steps of {np.min(steps):.3g} to {np.max(steps):.3g} s, resampled"
        found.append(
            Repair(name, "irregular steps", len(irregular), float(time[irregular[0]]), action)
        )
    if not len(gaps):
        return
    lost = float(np.sum(steps[gaps]) / (time[-1] - time[0]))
    longest = limits.longest_gap_s or longest_bridge(time)
    over = int(np.sum(steps > longest))
    done = f"bridged, {over} above {longest:.3g} s excluded" if over else "bridged"
    action = f"of up to {np.max(steps):.3g} s, {done}: {lost:.1%} of the time"
    found.append(Repair(name, "gaps", len(gaps), float(time[gaps[0]]), action))
    if lost > limits.most_missing:
        raise LogError(
            f"the clock of {name} has {len(gaps)} gaps with {lost:.1%} of the time in them, the "
            f"first at t = {time[gaps[0]]:.6g} s; allowed {limits.most_missing:.1%} "
            "(Repairs.most_missing): take a part of the log without them"
        )
