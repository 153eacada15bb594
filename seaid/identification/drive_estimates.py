"""Estimates of drives: the spring's part and its noise, the drive with its values, and warnings.

(7) has the sum of a constant error of the motor torque b_0 and the spring offset f_0 as one column,
s = f_0 + b_0 N/r_M. (4b) with s instead of f_0 would put r_L N/r_M b_0 on the load. So (8) gets a
column for b_0 per spring: r_L (k d + s) = Y beta + r_L N/r_M b_0, and f_0 is the difference.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from seaid._arrays import Array
from seaid.drives import (
    COMMANDS,
    PARAMETERS,
    PARAMETERS_OF,
    Drive,
    JointParameter,
    is_harmonic,
    parameter_named,
    readable,
)
from seaid.errors import Finding, Severity
from seaid.estimation import Estimate, FittedRows, QRFactor, triangle
from seaid.regressor import (
    Regression,
    actuator_equation,
    sensed_torque,
    signals,
    spring_regressor,
)
from seaid.robot import Robot
from seaid.simulation import mass_matrix

if TYPE_CHECKING:
    from seaid.log import Motion

POORLY_IDENTIFIED = 0.1
"""Relative standard error above which a parameter has a warning."""

_BAND = (2.5, 4.0)
"""Band for the noise in units of the cutoff; positions are filtered at five times the cutoff: the
spectra there contain only noise and vibration of a spring."""


def spring_of(robot: Robot, estimate: Estimate, joint: str) -> Estimate:
    """Return the estimate of a joint's spring, in the order of its regressor."""
    names = spring_regressor(robot, joint).names
    return estimate.part([estimate.names.index(name) for name in names], names)


def merged_estimates(
    drives: Mapping[str, Estimate], load_side: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the drives' estimates of both sides by joint, without correlation between them."""
    found = dict(load_side)
    for joint, drive in drives.items():
        found[joint] = _with(drive, load_side[joint]) if joint in load_side else drive
    return found


def _with(drive: Estimate, other: Estimate) -> Estimate:
    return replace(
        drive,
        names=drive.names + other.names,
        values=np.concatenate([drive.values, other.values]),
        covariance=linalg.block_diag(drive.covariance, other.covariance),
        units=drive.units + other.units,
        warnings=drive.warnings + other.warnings,
        white_standard_errors=_both(drive.white_standard_errors, other.white_standard_errors),
        degrees_of_freedom=_both(drive.degrees_of_freedom, other.degrees_of_freedom),
    )


def weak_springs(drives: Mapping[str, Estimate]) -> set[str]:
    """Return the joints with a spring that the motion hardly loads."""
    warnings = (one for drive in drives.values() for one in drive.warnings)
    return {one.joint for one in warnings if one.code == "weak-spring"}


_SURE = 3.0
"""Standard errors below zero from which a parameter is negative, and not only uncertain: of twenty
parameters that are zero, one is two standard errors below it in four of ten logs."""


def _both(one: Array | None, other: Array | None) -> Array | None:
    return None if one is None or other is None else np.concatenate([one, other])


_ZEROS = (
    "spring_offset",
    "deflection_zero",
    "friction_offset",
    "torque_offset",
    "coulomb_shift",
    "parallel_preload",
)
"""Parameters whose true value may be zero, so that a relative error is meaningless."""


_CONSTANTS = tuple(
    names[-1]
    for kind, names in PARAMETERS_OF["motor_input"].items()
    if kind not in COMMANDS and names
)
"""Motor constants: of one that the load or a sensor gives, (7) has the ratio to the stiffness."""


def with_estimate(drive: Drive, estimate: Estimate) -> Drive:
    """Return the drive with its estimated values."""
    return with_values(drive, dict(zip(estimate.names, estimate.values, strict=True)))


def with_values(drive: Drive, values: Mapping[str, float]) -> Drive:
    """Return the drive with those of the values that are its own and have their proper sign."""
    return drive.with_values(
        {
            name: max(float(value), 0.0) if parameter_named(name).is_positive else float(value)
            for name, value in values.items()
            if name in drive.parameter_names and (value > 0 or name != "stiffness")
        }
    )


def negative_inertias(robot: Robot, drives: Mapping[str, Estimate]) -> dict[str, str]:
    """Return the joints whose estimated rotor inertia is negative {joint: sentence}.

    It is by more than its uncertainty, or by more than the inertia of the bodies that move along.
    """
    held = robot.to_model(np.zeros(robot.n))
    mass = robot.from_model(mass_matrix(robot.model, robot.model.createData(), held), axes=2)
    found = {}
    for index, joint in enumerate(robot.joint_names):
        estimate = drives.get(joint)
        if estimate is None or "motor_inertia" not in estimate.names:
            continue
        value, error = estimate.value("motor_inertia"), estimate.standard_error("motor_inertia")
        at_joint = value * robot.drives[joint].ratio ** 2
        if value < -_SURE * error or at_joint < min(-mass[index, index], 0.0):
            found[joint] = f"its rotor inertia was estimated as {value:.3g} kg m^2, and no drive "
            found[joint] += "has a negative one"
    return found


def with_warnings(estimate: Estimate, joint: str, qr_factor: QRFactor | None) -> Estimate:
    """Return a drive's estimate with warnings; `qr_factor` of (10), None without a spring."""
    warnings = []
    for name, value, error in zip(
        estimate.names, estimate.values, estimate.standard_errors, strict=True
    ):
        if name in _ZEROS or is_harmonic(name) or name == "command_delay":  # may be zero
            continue
        text = readable(JointParameter(name, joint))
        reasons, is_weak, subject = [], False, text
        if error > POORLY_IDENTIFIED * abs(value):
            reasons.append(f"standard error {error / abs(value):.0%}" if value else "value zero")
        if name == "stiffness" and qr_factor is not None and _has_linear_spring(estimate):
            weak = _weak_spring(estimate, qr_factor)
            reasons, is_weak = reasons + weak, bool(weak)
            if is_weak and (constant := _scattering(estimate)):
                with_it = "and with it friction and rotor inertia"
                subject = f"{readable(JointParameter(constant, joint))}, {with_it},"
        evidence = {"value": float(value), "standard error": float(error)}
        if reasons:
            warnings.append(
                Finding(
                    "weak-spring" if is_weak else "poorly-identified",
                    f"{subject} is poorly identified: {'; '.join(reasons)}",
                    joint,
                    "doubtful" if is_weak else "note",
                    evidence,
                )
            )
        if value < 0 and name in PARAMETERS and PARAMETERS[name].is_positive:
            if PARAMETERS[name].starts:  # found by a search: not due to a wrong sign in the log
                message = f"{text} is not distinguishable from zero: remove its term"
                warnings.append(Finding("needless-term", message, joint, "note", evidence))
            elif name == "coulomb_friction" and "stiffness" in estimate.names:
                play = abs(value / estimate.value("stiffness"))
                message = (
                    f"{text} is negative, {value:.3g}: the joint encoder, or the spring, has play "
                    f"or hysteresis, at least {play:.2g} (torque of the motor over stiffness)"
                )
                severity: Severity = "doubtful" if value < -_SURE * error else "note"
                warnings.append(Finding("loose-encoder", message, joint, severity, evidence))
            else:
                message = f"{text} is negative, {value:.3g}: check signs and offsets of the log"
                sure = value < -_SURE * error
                is_of_input = name in (*_CONSTANTS, "stiffness")
                severity = ("wrong" if is_of_input else "doubtful") if sure else "note"
                remedy = _if_negative(name, estimate.names, sure)
                warnings.append(
                    Finding("negative-parameter", message, joint, severity, evidence, remedy)
                )
    return replace(estimate, warnings=tuple(warnings))


def _if_negative(name: str, others: Collection[str], sure: bool) -> str:
    """Return what to do about a parameter below zero, `sure` if its interval excludes zero."""
    if name in (*_CONSTANTS, "stiffness"):
        return (
            "the motor's torque, current or voltage, the deflection, or all channels of this joint "
            "have the opposite sign: sign = -1 in the description of the log"
        )
    if not sure:
        what = "state it as zero (known)" if name == "motor_inertia" else "remove its term"
        return f"zero is within three standard errors: {what} in the drives file, or move faster"
    if name == "motor_inertia" and "command_delay" in others:
        return (
            "state the delay of the commands (command_delay_s, negative where positions are logged "
            "late), or let the bodies of the robot file be identified: they may contain the rotors"
        )
    if name == "motor_inertia" and "stiffness" not in others:
        return (
            'state it as zero (motor_inertia_kg_m2 = 0.0, known = ["motor_inertia"]); where bodies '
            "count as known, let them be identified: they may contain the rotors"
        )
    if name == "motor_inertia":
        return "accelerate the motor more: its inertia is hardly in this torque"
    return "move faster and slower: one speed does not separate the terms of friction"


def _has_linear_spring(estimate: Estimate) -> bool:
    """Return whether the spring is k times the deflection and an offset, and nothing else.

    A dead zone has a zero of its deflection.
    """
    others = ("deflection_zero", "cubic_stiffness", "fifth_stiffness", "hysteresis_force")
    return "spring_offset" in estimate.names and not set(others) & set(estimate.names)


def _weak_spring(estimate: Estimate, qr_factor: QRFactor) -> list[str]:
    """Describe the possible bias of a stiffness by noise in the deflection.

    Direct regression with noise in a column gives too small a value, reverse regression too large a
    one. Their ratio is the column's partial R^2, a^2 / (a^2 + b^2) with a, b the entries of the
    last column of R for the deflection and for the residual (Frisch 1934).
    """
    names = qr_factor.names
    k, offset, p = names.index("stiffness"), names.index("spring_offset"), len(names)
    others = [place for place in range(p) if place not in (k, offset)]
    R = triangle(qr_factor.weighted_factor()[:, [*others, offset, k, p]])[-2:, -2:]
    share = R[0, 1] ** 2 / max(R[0, 1] ** 2 + R[1, 1] ** 2, 1e-300)  # partial R^2
    if share > 1 - POORLY_IDENTIFIED:
        return []
    value = estimate.value("stiffness")
    about_mean = triangle(qr_factor.weighted_factor()[:, [offset, k]])[1, 1]
    # amplitude of the sinusoid with the same root mean square
    swing = np.sqrt(2.0 / qr_factor.count) * abs(about_mean * value)
    unit, constant = estimate.units[k], _scattering(estimate)
    if constant:
        value, share = estimate.value(constant), 1 / share
        unit = estimate.units[estimate.names.index(constant)]
    return [
        f"direct and reverse regression give {value:.3g} and {value / share:.3g} {unit}",
        f"the motion changes the torque of this spring by only +-{swing:.2g} N m at the motor",
    ]


def _scattering(estimate: Estimate) -> str:
    """Return the motor constant, if its error is that of the stiffness in (7); else "".

    Of a constant K that the load or a torque sensor gives, (7) has the stiffness k_1 = k / K: where
    the load has k, it is K that scatters.
    """

    def size(name: str) -> float:
        return estimate.standard_error(name) / max(abs(estimate.value(name)), 1e-300)

    there = [one for one in _CONSTANTS if one in estimate.names]
    return there[0] if there and size(there[0]) > size("stiffness") else ""


def has_only_spring_torque(robot: Robot, motions: Sequence[Motion], joint: str) -> bool:
    """Return whether an elastic joint has the equation (4b) only, without a logged motor torque."""
    used = [actuator_equation(robot, one, joint)[0] for one in motions]
    return all(regressor is spring_regressor(robot, joint) for regressor in used)


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


TORQUE_OFFSET = "torque_offset"

LEAST_SHARE = 0.02
"""Least part of the column of a torque offset that the other columns do not explain.

Below it a joint moves so little that its gravity torque is nearly constant, and the errors of the
gravity parameters would grow by the inverse: the offset then counts as zero."""

_LEVEL = 0.999
"""Level of the interval that excludes zero if a torque offset has a finding."""

_MATTERS, _LARGE = 0.01, 0.2
"""Torque offset, as a part of the rms torque, from which it has a finding, and a doubtful one."""


def with_spring_torque(springs: Sequence[Estimate], rows: Regression) -> Regression:
    """Return rows of the load side with the torque of the springs (4b), from rows without it."""
    if not springs:
        return rows
    values = np.concatenate([spring.values for spring in springs])
    return replace(rows, y=rows.y + rows.propagated[:, : len(values)] @ values)


def with_torque_columns(
    robot: Robot, springs: Mapping[str, Estimate], joints: Sequence[str], rows: Regression
) -> Regression:
    """Return the rows with the torque of the springs and columns of the torque offsets."""
    rows = with_spring_torque(list(springs.values()), rows)
    places, start = {}, 0
    for joint, spring in springs.items():
        if "spring_offset" in spring.names:
            places[joint] = start + spring.names.index("spring_offset")
        start += len(spring.names)
    lever = [offset_lever(robot, joint) for joint in joints]
    columns = rows.propagated[:, [places[joint] for joint in joints]] * lever
    return replace(
        rows,
        names=(*rows.names, *(JointParameter(TORQUE_OFFSET, joint) for joint in joints)),
        units=(*rows.units, *len(joints) * ("N m",)),
        H=np.hstack([rows.H, columns]),
    )


def offset_lever(robot: Robot, joint: str) -> float:
    """Return N / r_M: the spring force per motor torque."""
    drive = robot.drives[joint]
    return drive.ratio / drive.motor_radius


def identifiable_offsets(qr_factor: QRFactor, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the joints whose torque offset, among the last columns, the load side determines."""
    R, p = qr_factor.weighted_factor(), len(qr_factor.names)
    kept = list(range(p - len(joints)))
    found: list[str] = []
    for joint, place in zip(joints, range(len(kept), p), strict=True):
        own = abs(triangle(R[:, [*kept, place]])[-1, -1])
        if own > LEAST_SHARE * np.linalg.norm(R[:, place]):
            kept, found = [*kept, place], [*found, joint]
    return tuple(found)


def with_torque_offsets(
    robot: Robot, load: FittedRows, drives: Mapping[str, Estimate], springs: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the drives {joint: Estimate} with the spring offset and the torque offset separated.

    The error of s is in both the fit of (7) and b_0, so that f_0 does not contain it.
    """
    found, start = dict(drives), 0
    for joint, spring in springs.items():
        name = f"{TORQUE_OFFSET} of {joint}"
        if name in load.estimate.names:
            place = load.estimate.names.index(name)
            slopes = load.sensitivity[place, start : start + len(spring.names)]
            found[joint] = _separated(robot, load, joint, drives[joint], (spring, place, slopes))
        start += len(spring.names)
    return found


def _separated(
    robot: Robot,
    load: FittedRows,
    joint: str,
    drive: Estimate,
    offset: tuple[Estimate, int, Array],
) -> Estimate:
    """Return a drive with f_0 = s - b_0 N/r_M and b_0, the load side's column `place`."""
    spring, place, slopes = offset
    side, q = load.estimate, len(drive.names)
    own = [drive.names.index(name) for name in spring.names]
    shared = drive.covariance[:, own] @ slopes
    joined = np.vstack(
        [
            np.column_stack([drive.covariance, shared]),
            np.append(shared, side.covariance[place, place]),
        ]
    )
    change = np.eye(q + 1)
    change[drive.names.index("spring_offset"), q] = -offset_lever(robot, joint)
    covariance = change @ joined @ change.T
    white, freedom = (
        None if one is None or other is None else np.append(other, one[place])
        for one, other in (
            (side.white_standard_errors, drive.white_standard_errors),
            (side.degrees_of_freedom, drive.degrees_of_freedom),
        )
    )
    return replace(
        drive,
        names=(*drive.names, TORQUE_OFFSET),
        units=(*drive.units, "N m"),
        values=change @ np.append(drive.values, side.values[place]),
        covariance=covariance,
        white_standard_errors=white,
        degrees_of_freedom=freedom,
        warnings=(*drive.warnings, *_findings(robot, load, joint, place)),
    )


def _findings(robot: Robot, load: FittedRows, joint: str, place: int) -> tuple[Finding, ...]:
    """Return a finding if a torque offset is significant and large enough to matter."""
    value = float(load.estimate.values[place])
    error = float(load.estimate.standard_errors[place])
    equation = load.qr_factor.equations.index(robot.index(joint))
    norm = np.linalg.norm(load.qr_factor.factors[equation, :, -1])
    torque = norm / np.sqrt(load.qr_factor.counts[equation])
    torque /= offset_lever(robot, joint) * robot.drives[joint].load_radius
    lower, upper = load.estimate.interval(_LEVEL)[place]
    if lower <= 0 <= upper or abs(value) < _MATTERS * torque:
        return ()
    message = (
        f"the motor torque of {joint} has a constant error of {value:.2g} N m ({value / torque:.0%}"
        " of the torque on its spring at the motor), which the estimates allow for"
    )
    evidence = {"offset_Nm": value, "standard error": error, "torque_rms_Nm": float(torque)}
    return (
        Finding(
            "torque-offset",
            message,
            joint,
            "doubtful" if abs(value) > _LARGE * torque else "note",
            evidence,
            "set the zero of the torque or current sensor while the motor is off",
        ),
    )
