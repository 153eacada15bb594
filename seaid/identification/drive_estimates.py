"""What an estimate of a drive means: its spring, its drive with the found values, its flags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import linalg

from seaid.drives import PARAMETERS, Drive
from seaid.estimation import Estimate, QRFactor, triangle
from seaid.regressor import spring_regressor
from seaid.robot import Robot

POORLY_IDENTIFIED = 0.1
"""Relative standard error above which a parameter is flagged."""


def spring_of(robot: Robot, estimate: Estimate, joint: str) -> Estimate:
    """Return the parameters of a joint's spring alone, in the order of its regressor."""
    names = spring_regressor(robot, joint).names
    return estimate.part([estimate.names.index(name) for name in names], names)


def merged_estimates(
    drives: Mapping[str, Estimate], beside: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the estimates of both by joint; of a joint in both, as one without correlation.

    `drives` are those of actuator sides, `beside` what the load side tells of the same drives.
    """
    found = dict(beside)
    for joint, drive in drives.items():
        found[joint] = _with(drive, beside[joint]) if joint in beside else drive
    return found


def _with(drive: Estimate, other: Estimate) -> Estimate:
    white = [one.white_standard_errors for one in (drive, other)]
    known = [errors for errors in white if errors is not None]
    return replace(
        drive,
        names=drive.names + other.names,
        values=np.concatenate([drive.values, other.values]),
        covariance=linalg.block_diag(drive.covariance, other.covariance),
        units=drive.units + other.units,
        flags=drive.flags + other.flags,
        white_standard_errors=np.concatenate(known) if len(known) == len(white) else None,
    )


SEARCHED = ("coulomb_width", "stribeck_speed", "dead_zone")
"""Positive parameters that were searched for: a minus is not that of a torque in the log."""

_ZEROS = (
    "spring_offset",
    "deflection_zero",
    "friction_offset",
    "coulomb_shift",
    "parallel_preload",
)
"""Parameters that may well be zero: their relative error says nothing."""


def with_estimate(drive: Drive, estimate: Estimate) -> Drive:
    """Return the drive with the found friction, stiffness and rotor inertia."""
    return with_values(drive, dict(zip(estimate.names, estimate.values, strict=True)))


def with_values(drive: Drive, values: Mapping[str, float]) -> Drive:
    """Return the drive with values under their names in an estimate: those of its own parameters.

    Negative ones of what cannot be negative become zero, and a stiffness that is not positive stays
    what it was.
    """
    return drive.with_values(
        {
            name: max(float(value), 0.0) if PARAMETERS[name].is_positive else float(value)
            for name, value in values.items()
            if name in PARAMETERS and (value > 0 or name != "stiffness")
        }
    )


def with_flags(estimate: Estimate, joint: str, qr_factor: QRFactor | None) -> Estimate:
    """Return the estimate of a drive with its flags: poorly identified, or impossible.

    `qr_factor` is that of the actuator side (10), None for a drive without a spring.
    """
    flags = []
    for name, value, error in zip(
        estimate.names, estimate.values, estimate.standard_errors, strict=True
    ):
        if name in _ZEROS:
            continue
        text = name.replace("_", " ") + f" of {joint}"
        reasons = []
        if error > POORLY_IDENTIFIED * abs(value):
            reasons.append(f"standard error {error / abs(value):.0%}" if value else "found zero")
        if name == "stiffness" and qr_factor is not None and _has_linear_spring(estimate):
            reasons += _weak_spring(estimate, qr_factor)
        if reasons:
            flags.append(f"{text} is poorly identified: {'; '.join(reasons)}")
        if value < 0 and name in SEARCHED:
            flags.append(f"{text} is not told from zero: leave its term out")
        elif value < 0 and name in PARAMETERS and PARAMETERS[name].is_positive:
            flags.append(f"{text} is negative, {value:.3g}: check signs and zeros of the log")
    return replace(estimate, flags=tuple(flags))


def _has_linear_spring(estimate: Estimate) -> bool:
    """Tell whether the spring is k times the deflection and an offset, and nothing else."""
    nonlinear = ("deflection_zero", "cubic_stiffness", "fifth_stiffness", "dead_zone")
    return "spring_offset" in estimate.names and not set(nonlinear) & set(estimate.names)


def _weak_spring(estimate: Estimate, qr_factor: QRFactor) -> list[str]:
    """Say how far noise in the deflection may have pulled a stiffness down.

    Least squares with noise in a column gives too little; the regression the other way round gives
    too much. Their ratio is the column's partial R^2 (Frisch 1934).
    """
    names = qr_factor.names
    k, offset, p = names.index("stiffness"), names.index("spring_offset"), len(names)
    others = [place for place in range(p) if place not in (k, offset)]
    R = triangle(qr_factor.weighted_factor()[:, [*others, offset, k, p]])[-2:, -2:]
    share = R[0, 1] ** 2 / max(R[0, 1] ** 2 + R[1, 1] ** 2, 1e-300)
    if share > 1 - POORLY_IDENTIFIED:
        return []
    value = estimate.value("stiffness")
    about_mean = triangle(qr_factor.weighted_factor()[:, [offset, k]])[1, 1]
    swing = np.sqrt(2.0 / qr_factor.count) * abs(about_mean * value)
    return [
        f"regressed both ways it is between {value:.3g} and {value / share:.3g} "
        f"{estimate.units[k]}",
        f"the motion changes the torque of this spring by only +-{swing:.2g} N m at the motor",
    ]
