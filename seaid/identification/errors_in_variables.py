"""The spring from its measured torque by (4b), with noise in both torque and deflection.

Direct regression of the torque on the deflection gives too small a stiffness, reverse regression
too large a one (Frisch 1934). Deming's (1943) line between them weighs both errors by the ratio of
their variances: here that of the spectra above the bandwidth of the motion, which contain only
noise and vibration of the spring.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, safely
from seaid.estimation import instrumental
from seaid.regressor import actuator_equation, sensed_torque, signals, spring_regressor

if TYPE_CHECKING:
    from seaid.estimation import Estimate
    from seaid.log import Motion
    from seaid.regressor import Regression
    from seaid.robot import Robot

_BAND = (2.5, 4.0)
"""Band for the noise in units of the cutoff; positions are filtered at five times the cutoff."""


def has_only_spring_torque(robot: Robot, motions: Sequence[Motion], joint: str) -> bool:
    """Return whether an elastic joint has the equation (4b) only, without a logged motor torque."""
    used = [actuator_equation(robot, one, joint)[0] for one in motions]
    return all(regressor is spring_regressor(robot, joint) for regressor in used)


def errors_in_variables(rows: Regression, ratio: float) -> Estimate:
    """Return stiffness and offset from rows of (4b) with noise in column and torque.

    `ratio` is the noise variance of the torque over that of the deflection. It is least squares
    with the deflection estimated from both measurements as the instrument of the measured one.
    """
    column = rows.names.index("stiffness")
    others = np.delete(rows.H, column, axis=1)
    d, tau = (
        values
        - others
        @ safely(np.linalg.lstsq, others, values, what="the torque of a spring", rcond=None)[0]
        for values in (rows.H[:, column], rows.y)
    )
    stiffness = deming(d, tau, ratio)
    instruments = rows.H.copy()
    if np.isfinite(ratio):
        # the best estimate of the true deflection from both measurements (Deming 1943)
        deflection = (ratio * d + stiffness * tau) / (ratio + stiffness**2)
        instruments[:, column] += deflection - d
    return instrumental(rows, instruments)


def deming(x: Array, y: Array, ratio: float) -> float:
    """Return the slope of y on x, both without mean; `ratio` is the noise variance of y over x.

    It is (yy - r xx + sqrt((yy - r xx)^2 + 4 r xy^2)) / (2 xy) (Deming 1943).
    """
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xy == 0:
        return 0.0
    if not np.isfinite(ratio):
        return xy / xx
    half = 0.5 * (yy - ratio * xx)
    return float((half + np.sqrt(half**2 + ratio * xy**2)) / xy)


def noise_ratio(robot: Robot, motions: Sequence[Motion], joint: str) -> float:
    """Return the noise variance of a joint's torque over that of its deflection in (4b).

    It is the median ratio of the spectra between 2.5 and 4 times the cutoff; inf, so that the
    deflection counts as exact, if the deflection has no noise there.
    """
    ratios = [_spectra(robot, one, joint) for one in motions]
    return float(np.median(ratios))


def _spectra(robot: Robot, motion: Motion, joint: str) -> float:
    from scipy.signal import detrend, periodogram

    index = robot.index(joint)
    by_name = signals(robot, motion, index)
    by_name["tau_L"] = sensed_torque(robot, motion, index)
    regressor = spring_regressor(robot, joint)
    torque, columns = regressor.evaluate(by_name)
    both = detrend(
        np.column_stack([torque, columns[:, regressor.names.index("stiffness")]]), axis=0
    )
    frequency, power = periodogram(both, fs=motion.rate_hz, window="hann", axis=0)
    seen = (frequency > _BAND[0] * motion.cutoff_hz) & (frequency < _BAND[1] * motion.cutoff_hz)
    torque_noise, deflection_noise = np.median(power[seen], axis=0) if np.any(seen) else (0.0, 0.0)
    return float(torque_noise / deflection_noise) if deflection_noise > 0 else float("inf")
