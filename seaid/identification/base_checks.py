"""Checks of a floating base before any fit: missing axes, frames and orders, jumps of a pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from seaid._arrays import Array, is_constant
from seaid.errors import Finding, listed
from seaid.identification.contact_checks import contact_findings, unused_lifts
from seaid.log import (
    CHANNELS,
    BaseLog,
    Log,
    Motion,
    base_jumps,
    low_pass,
    needed_columns,
    quaternion_rates,
    turned_to_world,
)
from seaid.robot import FloatingBase, Robot

_OFF, _BETTER = 0.002, 5.0
"""One less the correlation of the gyroscope with the change of orientation from which they
contradict each other, if another frame or order is so many times better."""

_UNRELATED = 0.5
"""Correlation below which they contradict each other without an explanation."""


def base_findings(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Sequence[Motion]]
) -> list[Finding]:
    """Return what contradicts itself in the base and the contacts of logs, and their motions."""
    if robot.floating_base is None:
        return []
    own = robot.floating_base
    found = [one for log in logs if log.base is not None for one in _sensors(log.base, log, own)]
    if not any(one.severity == "wrong" for one in found):
        every = [one for each in motions for one in each]
        for motion in every:
            found += list(contact_findings(robot, motion, logs))
        found += list(unused_lifts(own, every))
    return found


def _sensors(base: BaseLog, log: Log, own: FloatingBase) -> Iterator[Finding]:
    """Yield dead axes, frames that contradict each other, and jumps of a pose."""
    imu = own.imu_placement[0]
    for name in ("angular_velocity", "specific_force"):
        values, needed = getattr(base, name), needed_columns(own, name)
        columns = zip("xyz", CHANNELS[name], () if values is None else values.T, strict=False)
        for axis, whole_name, column in columns:
            if whole_name in needed and is_constant(column):
                yield Finding(
                    "base-sensor",
                    f"the {axis} axis of the {name.replace('_', ' ')} of the base is "
                    f"{column[0]:.4g} all the time: it is missing",
                    severity="wrong",
                    evidence={"value": float(column[0])},
                    remedy="log all three axes, or give orientation with velocity or position",
                    certainty="certain",
                )
    if own.imu_is_fixed:
        yield from _frames(base, log.time, imu)
        yield from _plane(base, own)
    for name, (count, largest, first_s) in base_jumps(base, log.time).items():
        unit = {"position": " m", "velocity": " m/s"}.get(name, " rad")
        yield Finding(
            "base-jumps",
            f"the {name} of the base jumps {count} times, by up to {largest:.3g}{unit}, first at t "
            f"= {first_s:.4g} s, as a state estimator does that corrects itself: the jumps were "
            "taken out, and samples near them are not used",
            severity="note",
            evidence={"jumps": float(count), "largest": largest},
            remedy="log the IMU, which does not jump",
            certainty="certain",
        )


def missing_torques(robot: Robot, asked: Sequence[str], used: Sequence[str]) -> Iterator[Finding]:
    """Yield the joints of a floating base that are `asked` for and have no torque in the log."""
    missing = [joint for joint in asked if joint not in used]
    if robot.floating_base is not None and missing:
        yield Finding(
            "no-torque",
            f"the log has no torque of {listed(missing)}: "
            + (
                "their equations are not used, and what moves by them is less certain"
                if used
                else "the equations of the base alone are used"
            ),
            missing[0] if len(missing) == 1 else "",
            "note",
            {"joints": float(len(missing))},
            "describe the torque of these joints, or name the others with torque_joints=",
            "certain",
        )


_LEAVES = 0.2
"""Rate about the axes in its plane over that about its normal, from which a base leaves its plane.
A guide with play and an IMU that is mounted askew have a few hundredths."""


def _plane(base: BaseLog, own: FloatingBase) -> Iterator[Finding]:
    """Yield a planar base that turns out of its plane."""
    if own.normal is None or base.angular_velocity is None:
        return
    w = base.angular_velocity @ own.imu_placement[0].T
    about = w @ np.array(own.normal)
    size, out = (
        float(np.std(about)),
        float(np.linalg.norm(np.std(w @ (np.eye(3) - own.turning), 0))),
    )
    if out > max(_LEAVES * size, _TURNS_RAD_S):
        yield Finding(
            "base-frames",
            f"the base turns with {out:.2g} rad/s (rms) about the axes in its plane and with "
            f"{size:.2g} rad/s about the normal: it does not move in this plane",
            severity="wrong",
            evidence={"out of the plane [rad/s]": out, "in the plane [rad/s]": size},
            remedy="load the robot with base='floating', or with the plane in which it moves",
        )


def _frames(base: BaseLog, time: Array, imu: Array) -> Iterator[Finding]:
    """Yield an orientation that the angular velocity, or gravity, contradicts."""
    if base.orientation is None:
        return
    if base.angular_velocity is not None:
        found = list(_turning(base.orientation, base.angular_velocity @ imu.T, time))
        yield from found
        if found:  # gravity in the axes of a wrong orientation says nothing more
            return
    if base.specific_force is not None:
        mean = turned_to_world(base.orientation, base.specific_force @ imu.T).mean(axis=0)
        if mean[2] < -0.5 * np.linalg.norm(mean):
            yield Finding(
                "base-frames",
                "the specific force of the base points downwards: an accelerometer at rest "
                "measures 9.81 m/s^2 upwards",
                severity="wrong",
                evidence={"mean upwards [m/s^2]": float(mean[2])},
                remedy="in the description of the log:\n[base]\nspecific_force = "
                '{ columns = ["...", "...", "..."], scale = -1 }',
            )


def _turning(orientation: Array, w: Array, time: Array) -> Iterator[Finding]:
    """Yield the order or frame that makes the gyroscope the change of the orientation."""
    w, orientation = (_smooth(x, time) for x in (w, orientation))
    w_there = turned_to_world(orientation, w, back=True)
    readings = {
        'angular_velocity is in the frame of the world: frame = "world"': (orientation, w_there),
        'the quaternion is x, y, z, w: order = "xyzw"': (orientation[:, [3, 0, 1, 2]], w),
        'the quaternion is w, x, y, z: order = "wxyz"': (orientation[:, [1, 2, 3, 0]], w),
        "the quaternion turns from the world to the base: change the signs of x, y, z": (
            orientation * [1, -1, -1, -1],
            w,
        ),
    }
    own = quaternion_rates(orientation, time)
    if float(np.std(own)) < _TURNS_RAD_S:
        return
    now = _alike(own, w)
    scores = {x: _alike(quaternion_rates(p, time), y) for x, (p, y) in readings.items()}
    best = max(scores, key=scores.__getitem__)
    text = "the angular velocity contradicts the orientation: "
    if 1 - now > max(_OFF, _BETTER * (1 - scores[best])):
        yield _frame_finding(text + best, now, _BY_SAMPLES)
    elif now < _UNRELATED:
        yield _frame_finding(text + "order, frame, or times are other ones", now, _BY_SAMPLES)
    elif 0.8 < np.sum(own * w) / np.sum(w * w) / np.radians(1.0) < 1.2:
        yield _frame_finding("the angular velocity is in degrees per second", now, _IN_DEGREES)


_TURNS_RAD_S, _COMPARED_HZ = 0.05, 5.0
"""Angular velocity (rms) from which a base turns, and the low pass for its comparison."""

_IN_DEGREES = (
    "in the description of the log:\n[base]\nangular_velocity = "
    '{ columns = ["...", "...", "..."], scale = 0.0174533 }'
)
_BY_SAMPLES = (
    "name order and frame in [base] of the description of the log; seaid describe decides both by "
    "the samples"
)


def _smooth(values: Array, time: Array) -> Array:
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    return low_pass(values, rate_hz, min(_COMPARED_HZ, 0.4 * rate_hz))


def _frame_finding(text: str, alike: float, remedy: str) -> Finding:
    return Finding(
        "base-frames", text, severity="wrong", evidence={"correlation": alike}, remedy=remedy
    )


def _alike(one: Array, other: Array) -> float:
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.sum(one * other)) / size if size > 0 else 0.0
