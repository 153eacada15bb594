"""Constant errors of the motor torque on springs, which (7) cannot tell from the spring offset.

(7) has the sum of torque offset b_0 and spring offset f_0 as one column, s = f_0 + b_0 N/r_M. (4b)
with s instead of f_0 would put r_L N/r_M b_0 on the load. So (8) gets a column for b_0 per spring:
r_L (k d + s) = Y beta + r_L N/r_M b_0, and f_0 is the difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seaid._arrays import Array
from seaid.drives import JointParameter
from seaid.errors import Finding
from seaid.estimation import Estimate, FittedRows, QRFactor, triangle
from seaid.regressor import Regression
from seaid.robot import Robot

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
