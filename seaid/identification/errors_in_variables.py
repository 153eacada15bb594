"""The spring from its measured torque, (4b), where torque and deflection are both noisy.

Least squares of the torque on the deflection takes the deflection as exact and finds too small a
stiffness; the other way round it finds too large a one (Frisch 1934). Between them lies the line
that weighs both errors (Deming 1943). Their ratio is that of both spectra above the pass band,
where nothing but noise and what shakes the spring is left.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seaid._arrays import Array, safely
from seaid.estimation import Estimate, instrumental
from seaid.identification.datasets import Dataset, first_motion
from seaid.log import Motion
from seaid.regressor import Regression, actuator_equation, sensed_torque, signals, spring_regressor
from seaid.robot import Robot

_BAND = (2.5, 4.0)
"""The noise is looked at between so many times the cutoff; positions are filtered at five times."""


def only_spring_torque(robot: Robot, datasets: Sequence[Dataset], joint: str) -> bool:
    """Tell whether a plain spring is found from its torque, the motor's not being in the log."""
    spring = spring_regressor(robot, joint)
    used = [actuator_equation(robot, first_motion(one), joint)[0] for one in datasets]
    plain = spring.names == ("stiffness", "spring_offset")
    return plain and all(regressor is spring for regressor in used)


def errors_in_variables(rows: Regression, ratio: float) -> Estimate:
    """Return stiffness and offset of rows (4b) with noise in column and torque.

    `ratio` is the variance of the torque's noise over that of the deflection's. Least squares with
    the deflection that both tell as the instrument of the measured one.
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
        told = (ratio * d + stiffness * tau) / (ratio + stiffness**2)
        instruments[:, column] += told - d
    return instrumental(rows, instruments)


def deming(x: Array, y: Array, ratio: float) -> float:
    """Return the slope of y on x, both without mean; `ratio` of the noise variances, y over x."""
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xy == 0:
        return 0.0
    if not np.isfinite(ratio):
        return xy / xx
    half = 0.5 * (yy - ratio * xx)
    return float((half + np.sqrt(half**2 + ratio * xy**2)) / xy)


def noise_ratio(robot: Robot, datasets: Sequence[Dataset], joint: str) -> float:
    """Return the noise variance of a joint's torque over that of its deflection, (4b).

    The median of the spectra's ratio between 2.5 and 4 times the cutoff; inf, so that the
    deflection counts as exact, where it has none.
    """
    ratios = [_spectra(robot, first_motion(dataset), joint) for dataset in datasets]
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
