"""Mistakes of the gauntlet about the flags of feet on the ground.

Each has the form of those in `scripts/gauntlet_mistakes.py`, and is made at the quadruped alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scripts.gauntlet_mistakes import Case, Change, Mistake, Setup, forms, in_logs
from scripts.gauntlet_robots import Columns
from scripts.legged_plant import SOLO12
from seaid._arrays import Array

FLAGS = [f"{foot}.contact" for foot in SOLO12.feet]
THIRD = 1 / 3


def late_flags(delay_s: float, every: bool) -> Change:
    """Delay the flags of all feet, or that of the second one."""

    def late(log: Columns) -> Columns:
        time = log["time_s"]
        before = np.maximum(
            np.arange(len(time)) - round(delay_s / float(np.median(np.diff(time)))), 0
        )
        return log | {name: log[name][before] for name in (FLAGS if every else FLAGS[1:2])}

    return lambda case, setup: in_logs(setup, late)


def lost_flag(value: float) -> Change:
    """Set the flag of the second foot to a value in the second third of the log."""

    def lost(log: Columns) -> Columns:
        time: Array = log["time_s"] / log["time_s"][-1]
        is_lost = (time > THIRD) & (time < 2 * THIRD)
        return log | {FLAGS[1]: np.where(is_lost, value, log[FLAGS[1]])}

    return lambda case, setup: in_logs(setup, lost)


def repaired(change: Change) -> Change:
    """Read the log with repairs, too."""

    def whole(case: Case, setup: Setup) -> Setup | None:
        changed = change(case, setup)
        return None if changed is None else replace(changed, repair=True)

    return whole


def flag_mistakes() -> list[Mistake]:
    """Return mistakes of flags: late, lost, or without a value for a part of the log."""
    late, lost, words = {"contact-flags", "delay"}, {"contact-flags", "holes"}, ("contact", "flag")
    found = [
        *forms("flag of a foot late by 80 ms, or 30 ms", late, words,
               late_flags(0.08, False), late_flags(0.03, False)),
        *forms("flags of all feet late by 80 ms, or 30 ms", late, words,
               late_flags(0.08, True), late_flags(0.03, True)),
        *forms("flag of a foot lost for a third: says in the air", lost, words,
               lost_flag(0.0), None, repairable=False),
        *forms("flag of a foot lost for a third: says on the ground", lost, words,
               lost_flag(1.0), None, repairable=False),
        *forms("flag of a foot lost for a third: no value, and read with repairs", lost, words,
               lost_flag(np.nan), repaired(lost_flag(np.nan)), repairable=False),
    ]  # fmt: skip
    return [replace(mistake, of_quadruped=True) for mistake in found]
