"""The ratio of a gear from the angles on both of its sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError

_RESOLVED = 0.05
"""Relative standard error above which the motion is too small to tell a ratio."""


@dataclass(frozen=True)
class GearRatio:
    """Motor turns a turn behind the gear, its standard error, and the angles' misfit [rad]."""

    value: float
    standard_error: float
    misfit_rad: float


def gear_ratio(
    motor_angle_rad: Array | Sequence[Array], output_angle_rad: Array | Sequence[Array]
) -> GearRatio:
    """Return the gear ratio from motor angle and angle behind the gear [rad], each (T,).

    The angle behind the gear is that of the motor side of the spring: joint angle plus deflection,
    or the joint angle itself behind a stiff gear. Several logs, a list of arrays each, have a zero
    of their own. Least squares with both angles inexact, weighed by the ratio itself.

    What is left over is no noise but the gear's transmission error and the encoder's eccentricity:
    functions of the angle, which any number of samples repeat. The standard error is therefore that
    of one sample: rms misfit over rms angle. A motion shorter than a period of such an error sees
    part of it as ratio, and cannot know. Raises LogError for angles that do not fit together, or
    too small a motion.
    """
    pairs = _pairs(motor_angle_rad, output_angle_rad)
    motor = np.concatenate([one - one.mean() for one, _ in pairs])
    output = np.concatenate([one - one.mean() for _, one in pairs])
    swing = float(np.sqrt(np.mean(output**2)))
    together = float(motor @ output)
    if swing == 0 or together == 0:
        raise LogError("gear_ratio: one of the angles stands still, so that they tell no ratio")
    value = float(np.sign(together) * np.linalg.norm(motor) / np.linalg.norm(output))
    misfit = float(np.sqrt(np.mean((output - motor / value) ** 2)))
    error = misfit / swing
    if error > _RESOLVED:
        raise LogError(
            f"gear_ratio: the angles disagree by {misfit:.2g} rad (rms) in a motion of {swing:.2g} "
            "rad (rms) behind the gear; turn the joint farther, or check units and wraps"
        )
    return GearRatio(value, abs(value) * error, misfit)


def _pairs(
    motor: Array | Sequence[Array], output: Array | Sequence[Array]
) -> list[tuple[Array, Array]]:
    several = isinstance(motor, list | tuple) and np.ndim(motor[0]) > 0
    motors, outputs = (list(one) if several else [one] for one in (motor, output))
    if len(motors) != len(outputs):
        raise LogError(
            f"gear_ratio needs as many angles of both sides, found {len(motors)} and "
            f"{len(outputs)} logs"
        )
    pairs = []
    for one, other in zip(motors, outputs, strict=True):
        a, b = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
        if a.ndim != 1 or a.shape != b.shape or len(a) < 2:
            raise LogError(
                f"gear_ratio needs angles (T,) of both sides, found shapes {a.shape} and {b.shape}"
            )
        known = np.isfinite(a) & np.isfinite(b)
        if known.sum() < 2:
            raise LogError("gear_ratio: one of the angles is NaN throughout; was it measured?")
        pairs.append((a[known], b[known]))
    return pairs
