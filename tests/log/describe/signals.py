"""Samples of the columns in tests/data/headers/columns.toml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from seaid._arrays import Array

TIME: Array = np.arange(1000) / 200


def wave(hz: float, size: float = 1.0) -> Array:
    return np.asarray(size * np.sin(2 * np.pi * hz * TIME + hz))


GOAL = wave(0.5)
LATE = GOAL[np.maximum(np.arange(len(TIME)) - 5, 0)]
"""What follows the command GOAL."""
RATE = np.gradient(GOAL, TIME)
SOFT = wave(0.5) + wave(1.3, 0.6) + wave(2.1, 0.3)
SPEED = np.gradient(SOFT, TIME)
REST = 0.12 * SPEED + 0.02 * np.gradient(SPEED, TIME) + 0.2 + 0.05 * np.sign(SPEED)
"""Friction, inertia and weight over a gain, which a soft loop adds to a position SOFT."""
SIGNALS: dict[str, Array] = {
    "time": TIME,
    "goal": GOAL,
    "late": LATE,
    "rate": RATE,
    "torque": 3 * wave(0.5, 1.0)[::-1] + 0.3 * np.sin(11 * TIME),
    "slow": wave(0.1),
    "quick": wave(1.0),
    "quicker": wave(2.0),
    "quickest": wave(3.0),
    "counts": np.round(wave(0.5, 1800.0) + 2000),
    "whole": np.round(100 * wave(0.7)),
    "current": np.abs(wave(0.7)),
    "states": np.floor(TIME) % 3,
    "soft": SOFT,
    "soft loop": 1.1 * SOFT + REST,
    "soft torque": 0.3 * SOFT + REST,
    "soft rest": REST,
    "steps": np.where(TIME > 1.0, 40.0, 20.0),
    "nothing": np.full_like(TIME, np.nan),
}


def samples(of: str | Sequence[float | str]) -> Array:
    """Return a signal by its name, or by a factor, its name and an offset."""
    if isinstance(of, str):
        return SIGNALS[of]
    factor, name, *offset = of
    return np.asarray(float(factor) * SIGNALS[str(name)] + sum(map(float, offset)))


def columns_of(case: Mapping[str, Any]) -> dict[str, Array]:
    """Return the columns of a case, beside a time t unless it says what its time is."""
    columns = {name: samples(of) for name, of in case["columns"].items()}
    return columns if "time" in case else {"t": TIME} | columns
