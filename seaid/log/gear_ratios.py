"""Gear ratio from the angles of both sides of a gear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array
from seaid._progress import Display
from seaid.errors import LogError, checked

_RESOLVED = 0.05
"""Relative standard error above which the motion is too small to determine a ratio."""


@dataclass(frozen=True, repr=False)
class GearRatio(Display):
    """A gear ratio, as `gear_ratio` determines it.

    Attributes
    ----------
    value, standard_error : float
        Motor turns per output turn, negative if the gear reverses; and its standard error.
    misfit_rad : float
        Root mean square of output angle minus motor angle over ratio [rad].
    """

    value: float
    standard_error: float
    misfit_rad: float


@checked(LogError)
def gear_ratio(
    motor_angle_rad: Array | Sequence[Array], output_angle_rad: Array | Sequence[Array]
) -> GearRatio:
    """Return the gear ratio from the angles of both sides of the gear.

    The estimate is the slope of the reduced major axis: both angles have errors, in proportion to
    their ranges. The residual is not noise but transmission error and encoder eccentricity, which
    are functions of the angle and do not average out. The standard error is therefore that of one
    sample: ratio times rms misfit over rms angle. A motion shorter than a period of such an error
    takes part of it for the ratio.

    Parameters
    ----------
    motor_angle_rad : array (T,) or list of arrays
        Motor angle [rad]; a list holds one array per log, each with its own encoder offset.
    output_angle_rad : array (T,) or list of arrays
        Angle behind the gear [rad], on the motor side of the spring: joint angle plus deflection,
        or the joint angle behind a rigid gear.

    Returns
    -------
    GearRatio
        The ratio with its standard error and the misfit.

    Raises
    ------
    LogError
        For angles of different shapes, angles that disagree, and too small a motion.

    Examples
    --------
    >>> seaid.gear_ratio(log.motor_position[:, 0], log.joint_position[:, 0]).value
    """
    pairs = _pairs(motor_angle_rad, output_angle_rad)
    motor = np.concatenate([one - one.mean() for one, _ in pairs])
    output = np.concatenate([one - one.mean() for _, one in pairs])
    amplitude = float(np.sqrt(np.mean(output**2)))
    product = float(motor @ output)
    if amplitude == 0 or product == 0:
        raise LogError("gear_ratio: one of the angles is constant, so the ratio is undetermined")
    # reduced major axis: sign(x y) |x| / |y|
    value = float(np.sign(product) * np.linalg.norm(motor) / np.linalg.norm(output))
    misfit = float(np.sqrt(np.mean((output - motor / value) ** 2)))
    error = misfit / amplitude
    if error > _RESOLVED:
        raise LogError(
            f"gear_ratio: the angles disagree by {misfit:.2g} rad (rms) in a motion of "
            f"{amplitude:.2g} rad (rms) behind the gear; turn the joint farther, or check units "
            "and wraps"
        )
    return GearRatio(value, abs(value) * error, misfit)


def _pairs(
    motor: Array | Sequence[Array], output: Array | Sequence[Array]
) -> list[tuple[Array, Array]]:
    several = isinstance(motor, list | tuple) and np.ndim(motor[0]) > 0
    motors, outputs = (list(one) if several else [one] for one in (motor, output))
    if len(motors) != len(outputs):
        raise LogError(
            f"gear_ratio needs the same number of logs for both angles, found {len(motors)} and "
            f"{len(outputs)}"
        )
    pairs = []
    for one, other in zip(motors, outputs, strict=True):
        a, b = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
        if a.ndim != 1 or a.shape != b.shape or len(a) < 2:
            raise LogError(
                f"gear_ratio needs two angles of shape (T,), found shapes {a.shape} and {b.shape}"
            )
        known = np.isfinite(a) & np.isfinite(b)
        if known.sum() < 2:
            raise LogError("gear_ratio: one of the angles is NaN at all samples")
        pairs.append((a[known], b[known]))
    return pairs
