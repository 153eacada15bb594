"""What sensors do to an equation: a torque that is late, and a zero of an encoder that is off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.checks.codes import (
    DELAY,
    ENCODER_OFFSET,
    in_description,
    only_joint,
    zeros_in_description,
)
from seaid.checks.engine import (
    Accepted,
    Alternative,
    Candidate,
    ColumnCheck,
    Equation,
    Selection,
    linear_candidate,
)
from seaid.checks.tolerances import (
    LEAST_DELAY_S,
    LEAST_SWING,
    POOR,
    SIGNIFICANT,
    SURE,
    SURE_TOGETHER,
)
from seaid.drives import IDEAL_DRIVE
from seaid.errors import Finding
from seaid.estimation import qr_factor_of, scaled_svd, settled_weights
from seaid.log import POSITION_BAND, Motion, changed_source, low_pass

if TYPE_CHECKING:
    from seaid.checks.columns import Side


def _late_torque(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the slope of the motor torque: one late by d is tau - d tau' to first order."""
    drive = side.robot.drives[joint]
    if drive.motor_input != "torque" or (drive.is_elastic and not side.is_motor):
        return
    index = side.robot.index(joint)
    if all(np.all(np.isfinite(motion.motor_torque[:, index])) for motion in side.motions):
        yield linear_candidate(joint, "delay", "motor_torque", partial(_slope, side, joint))


def _slope(side: Side, joint: str) -> Array:
    """Return -tau' (R, 1) at the rows, without what friction and rotor of another drive explain."""
    slope, alike = side.once(_late_columns, joint)
    weighted = side.equation.weight[:, None] * np.hstack([slope, alike])
    # The multiples of `alike` that explain most of the slope next to the columns of the fit (Frisch
    # and Waugh 1933) are subtracted: the coefficient of the rest is still the delay.
    rest = side.equation.residual_of(weighted)
    return np.asarray(slope - (alike @ scaled_svd(rest[:, 1:]).solve(rest[:, 0]))[:, None])


def _late_columns(side: Side, joint: str) -> tuple[Array, Array]:
    """Return -tau' (R, 1) of a motor at the rows, and what resembles it in another drive (R, c).

    Friction that changes gradually near reversals resembles an early torque. What is in the model
    already is zero.
    """
    rows, drive, index = side.drive(joint), side.robot.drives[joint], side.robot.index(joint)
    is_ideal = drive == IDEAL_DRIVE
    is_open = is_ideal or drive.motor_inertia_kg_m2 is None
    fastest = max(float(np.max(np.abs(x.motor_velocity[:, index]))) for x in side.motions)

    def of_drive(motion: Motion) -> Array:
        speed, acceleration = motion.motor_velocity[:, index], motion.motor_acceleration[:, index]
        # tanh(v / w) is 1 from about 2 w on, as the sign of Coulomb friction.
        gradual = np.tanh(speed / (POOR * fastest))
        columns = [gradual, speed, is_ideal * np.sign(speed), is_open * acceleration]
        return np.column_stack(columns)

    alike, weight = rows.at_rows([*map(of_drive, side.motions)]), side.equation.weight[:, None]
    rest = np.linalg.norm(side.equation.residual_of(weight * alike), axis=0)
    alike[:, rest < _ROUNDING * np.linalg.norm(weight * alike, axis=0)] = 0.0
    # Filtered first: at the ends of a log the filter continues a torque and not a slope, the noise
    # of which is as large as its first difference.
    slopes = [
        np.gradient(
            low_pass(x.motor_torque[:, [index]], x.rate_hz, POSITION_BAND * x.cutoff_hz),
            x.time,
            axis=0,
        )
        for x in side.motions
    ]
    return -rows.at_rows(slopes), alike


_ROUNDING = 1e-3
"""Part of a column that rounding leaves of one that is in the model already."""


def _late(side: Side, joint: str, accepted: Sequence[Accepted], share: float) -> Finding:
    """Return the finding of a motor torque that is late or early against the positions."""
    (delay,), (error,) = accepted[0].coefficients.tolist(), accepted[0].errors.tolist()
    return _late_torques(side, [joint], delay, error, share, abs(delay) - SURE * error)


def _late_torques(
    side: Side, joints: Sequence[str], delay: float, error: float, explained: float, surely: float
) -> Finding:
    """Return the finding that the motor torques of joints are late by a delay [s], or early.

    It matters by the part [s] of it that is `surely` there: of one joint what is beyond its error,
    of many all, because how they differ is in the error already.
    """
    entries = {}
    for joint in joints:
        source = side.sources.get(joint, {}).get("motor_torque", "")
        entries[joint] = {"motor_torque": changed_source(source, delay_s=round(delay, 5))}
    return DELAY.finding(
        f"the motor torques of {', '.join(joints)} are {1e3 * abs(delay):.2f} +- "
        f"{1e3 * error:.2f} ms {'late' if delay > 0 else 'early'} against the positions",
        only_joint(joints),
        "doubtful" if surely > LEAST_DELAY_S else "note",
        {"delay [s]": delay, "standard error [s]": error, "explained": explained},
        in_description(entries),
    )


def common_delay(selected: Sequence[tuple[Side, Selection]]) -> Finding | None:
    """Return the finding that all motor torques are late by as much, None without it.

    Delays of single joints that the rows hardly show add up: the weighted mean has the error of
    its parts, and their scatter (Birge 1932).
    """
    delays = {joint: delay for pair in selected for joint, delay in _delays(*pair).items()}
    if len(delays) < 2:
        return None
    values, errors = np.array(list(delays.values())).T
    # Each delay counts as off by LEAST_DELAY_S more, by filters and friction that a model lacks.
    weights = 1.0 / (errors**2 + LEAST_DELAY_S**2)
    common = float(np.average(values, weights=weights))
    spread = float(np.linalg.norm(weights * errors) / np.sum(weights))
    # The variance of the values over their number is that of their mean.
    scatter = float(np.sqrt(np.average((values - common) ** 2, weights=weights) / len(values)))
    error = float(np.hypot(spread, scatter))
    if abs(common) < max(SURE_TOGETHER * error, LEAST_DELAY_S):
        return None
    accepted = (x for _, selection in selected for x in selection.accepted)
    shares = [x.share for x in accepted if x.trial.candidate.about.code is DELAY]
    explained = max(shares, default=0.0)
    return _late_torques(selected[0][0], list(delays), common, error, explained, abs(common))


def _delays(side: Side, selection: Selection) -> dict[str, tuple[float, float]]:
    """Return the delay of each motor torque [s], and its standard error, all at once.

    They are next to what was accepted but for delays: a torque that is late spoils the bodies, and
    with them the other joints.
    """
    joints = [late.joint for joint in side.joints for late in _late_torque(side, joint)]
    if not joints:
        return {}
    equation = side.equation.with_alternatives(
        x.trial.alternative for x in selection.accepted if x.trial.candidate.about.code is not DELAY
    )
    columns = [side.once(_late_columns, joint) for joint in joints]
    late = np.hstack([*(alike for _, alike in columns), *(slope for slope, _ in columns)])
    values, errors = equation.with_alternatives([Alternative(late, 0)]).last(len(joints))
    return dict(zip(joints, zip(values.tolist(), errors.tolist(), strict=True), strict=True))


def _zeros(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the torque that the fitted bodies have more where the zero of an encoder is off.

    The motors of springs move along, because the spring offset absorbs a constant deflection.
    """
    if side.is_motor or side.base is None or not side.robot.base_is_held:
        return
    if side.robot.has_controllers:  # an offset moves the commands as well: `commands` looks at it
        return
    if not side.robot.is_prismatic[side.robot.index(joint)] and side.swing(joint) > LEAST_SWING:
        yield linear_candidate(joint, "offset", "joint_position", partial(_turned, side, joint))


_STEP_RAD = 1e-4
"""Step of the difference quotient by a joint angle."""


def _turned(side: Side, joint: str) -> Array:
    """Return the derivative (R, 1) of the load's torque by the angle of a joint."""
    ahead = side.torques_of(side.bodies, joint, _STEP_RAD)
    return (ahead - side.torque_of_bodies) / _STEP_RAD


_MOST_STEPS = 8
"""Steps of the search of an offset, which is far below a radian."""


def _searched_zero(side: Side, joint: str) -> tuple[float, float]:
    """Return the angle to be added to a joint, and its standard error, next to any bodies.

    Gauss and Newton's steps, with the derivative at the angle of the log: the bodies were fitted at
    the wrong zero, and change with it, and so do the weights of the equations.
    """
    assert side.base is not None
    rows, count = side.equation.rows, len(side.base.grouping)
    # (10N, p + 1): standard parameters per base parameter, and the known bodies in the last column.
    onto = np.column_stack([side.base.least(np.eye(count)), side.robot.known_parameters])
    # Of filtered states: differences of filtered torques are the same within 3 parts in 10^4.
    turned_by = partial(side.torques_of, onto, joint)
    before, ahead = (turned_by(angle=x) for x in (0.0, _STEP_RAD))
    angle, change, derivative = 0.0, np.zeros_like(before), (ahead - before) / _STEP_RAD
    for _ in range(_MOST_STEPS):
        # (8) at the angle: (H + dH) theta = y - d tau_known. Columns of drives do not change.
        H, y = rows.H.copy(), rows.y - change[:, count]
        H[:, :count] += change[:, :count]
        turned = replace(rows, H=H, y=y)
        current = Equation(turned, settled_weights(qr_factor_of(turned)))
        # (R, p + 1) @ (p + 1,): the derivative of the torque of all bodies by the angle.
        slope = derivative @ np.append(current.values[:count], 1.0)
        column = Alternative(slope[:, None], 1)
        (correction,), (error,) = current.with_alternatives([column]).last(1)
        angle += float(correction)
        if abs(correction) < POOR * error:
            break
        change = turned_by(angle=angle) - before
    return angle, float(error)


def _zero_is_off(
    side: Side, joint: str, accepted: Sequence[Accepted], share: float
) -> Finding | None:
    """Return the finding of a joint whose zero is not that of the robot file.

    An angle beyond a turn, or one that is not determined, stands for something else.
    """
    (offset,), (error,) = accepted[0].coefficients.tolist(), accepted[0].errors.tolist()
    if abs(offset) > SURE * side.offset_std:  # else its effect is linear, and in the errors
        offset, error = _searched_zero(side, joint)
    if abs(offset) > np.pi or abs(offset) < SIGNIFICANT * error:
        return None
    return ENCODER_OFFSET.finding(
        f"the zero of {joint} is {np.degrees(offset):.2f} +- {np.degrees(error):.2f} degrees from "
        f"that of the robot file: that explains {share:.0%} of the squared residual of its torque",
        joint,
        "note" if abs(offset) < SURE * side.offset_std else "doubtful",
        {"offset [rad]": offset, "standard error [rad]": error, "explained": share},
        zeros_in_description(side.robot, {joint: offset}, side.sources),
    )


SENSOR_CHECKS = (
    ColumnCheck(
        DELAY,
        _late_torque,
        _late,
        "torque and position that are stamped by one clock have no delay",
        "a motor torque that is late or early",
    ),
    ColumnCheck(
        ENCODER_OFFSET,
        _zeros,
        _zero_is_off,
        "a spirit level or a stop shows the zero of a joint",
        "a zero of the joint that is not that of the robot file",
    ),
)
"""The checks of sensors, in the order in which their findings are listed."""
