"""Checks of the base of a legged robot: its sensors in a log, and their errors in a fit.

Axes that are missing, frames and orders that contradict each other, and jumps of a pose are seen in
the samples. If they are right, the contacts are looked at.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np

from seaid._arrays import Array, is_constant
from seaid.checks import codes
from seaid.checks import tolerances as tol
from seaid.checks.check import Observation, observed, only_joint
from seaid.checks.echoes import is_wrong
from seaid.checks.feet import MOTION_CHECKS, FeetInMotion, unused_lifts
from seaid.errors import Finding, listed
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


@dataclass(frozen=True, eq=False)
class BaseRecord:
    """The samples of a base at the times (T,) of a log, and the base that has the sensors."""

    samples: BaseLog
    time: Array
    base: FloatingBase


def _missing_axes(record: BaseRecord) -> Iterator[Finding]:
    """Yield the axes of an IMU that are constant."""
    for name in ("angular_velocity", "specific_force"):
        values, needed = getattr(record.samples, name), needed_columns(record.base, name)
        columns = zip("xyz", CHANNELS[name], () if values is None else values.T, strict=False)
        for axis, whole_name, column in columns:
            if whole_name in needed and is_constant(column):
                yield codes.BASE_SENSOR.wrong(
                    f"the {axis} axis of the {name.replace('_', ' ')} of the base is "
                    f"{column[0]:.4g} all the time: it is missing",
                    evidence={"value": float(column[0])},
                    remedy="log all three axes, or give orientation with velocity or position",
                    certainty="certain",
                )


def _jumps(record: BaseRecord) -> Iterator[Finding]:
    """Yield jumps of a pose, which were taken out."""
    for name, (count, largest, first_s) in base_jumps(record.samples, record.time).items():
        unit = {"position": " m", "velocity": " m/s"}.get(name, " rad")
        yield codes.BASE_JUMPS.note(
            f"the {name} of the base jumps {count} times, by up to {largest:.3g}{unit}, first at t "
            f"= {first_s:.4g} s, as a state estimator does that corrects itself: the jumps were "
            "taken out, and samples near them are not used",
            evidence={"jumps": float(count), "largest": largest},
            remedy="log the IMU, which does not jump",
            certainty="certain",
        )


def _contradicting_frames(record: BaseRecord) -> Iterator[Finding]:
    """Yield an order, a frame or a plane that the sensors of a base contradict."""
    samples, base = record.samples, record.base
    if not base.imu_is_fixed:
        return
    w, force = (
        None if vectors is None else vectors @ base.imu_placement[0].T
        for vectors in (samples.angular_velocity, samples.specific_force)
    )
    if samples.orientation is not None:
        turning = [*_turning(samples.orientation, w, record.time)] if w is not None else []
        yield from turning
        if force is not None and not turning:  # a wrong orientation turns gravity too
            yield from _downwards(turned_to_world(samples.orientation, force).mean(axis=0))
    if base.normal is not None and w is not None:
        yield from _out_of_plane(base, np.array(base.normal), w)


def _downwards(force: Array) -> Iterator[Finding]:
    """Yield a mean specific force (3,) in the world that has the direction of gravity."""
    if force[2] < -tol.MOST * np.linalg.norm(force):
        yield codes.BASE_FRAMES.wrong(
            "the specific force of the base points downwards: an accelerometer at rest measures "
            "9.81 m/s^2 upwards",
            evidence={"mean upwards [m/s^2]": float(force[2])},
            remedy=_described("specific_force", "-1"),
        )


def _out_of_plane(base: FloatingBase, normal: Array, w: Array) -> Iterator[Finding]:
    """Yield a planar base whose angular velocity (T, 3) is about the axes in its plane too."""
    inside = float(np.std(w @ normal))
    # w without its part about the normal; `turning` projects on that.
    outside = float(np.linalg.norm(np.std(w @ (np.eye(3) - base.turning), 0)))
    # a guide with play and an IMU that is mounted askew have a few hundredths
    if outside > max(tol.RARE * inside, tol.BASE_TURNS_RAD_S):
        yield codes.BASE_FRAMES.wrong(
            f"the base turns with {outside:.2g} rad/s (rms) about the axes in its plane and with "
            f"{inside:.2g} rad/s about the normal: it does not move in this plane",
            evidence={"out of the plane [rad/s]": outside, "in the plane [rad/s]": inside},
            remedy="load the robot with base='floating', or with the plane in which it moves",
        )


def _turning(orientation: Array, w: Array, time: Array) -> Iterator[Finding]:
    """Yield the order, frame or unit that makes the gyroscope the change of the orientation."""
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    band_hz = min(tol.FRAMES_HZ, 0.4 * rate_hz)
    # Both behind one low pass: what it attenuates is no misfit between them.
    w, orientation = (low_pass(x, rate_hz, band_hz) for x in (w, orientation))
    change = quaternion_rates(orientation, time)
    if float(np.std(change)) < tol.BASE_TURNS_RAD_S:
        return
    w_in_base = turned_to_world(orientation, w, back=True)
    # A quaternion is w, x, y, z in memory: one that was read in the other order is permuted back.
    readings = {
        'angular_velocity is in the frame of the world: frame = "world"': (orientation, w_in_base),
        'the quaternion is x, y, z, w: order = "xyzw"': (orientation[:, [3, 0, 1, 2]], w),
        'the quaternion is w, x, y, z: order = "wxyz"': (orientation[:, [1, 2, 3, 0]], w),
        "the quaternion turns from the world to the base: change the signs of x, y, z": (
            orientation * [1, -1, -1, -1],
            w,
        ),
    }
    misfit = 1 - _correlation(change, w)
    misfits = {
        text: 1 - _correlation(quaternion_rates(turns, time), rates)
        for text, (turns, rates) in readings.items()
    }
    best = min(misfits, key=misfits.__getitem__)
    text, remedy = "contradicts the orientation: order, frame, or times are others", _BY_SAMPLES
    if misfit > tol.NEGLIGIBLE and tol.MANY_TIMES * misfits[best] < misfit:
        text = f"contradicts the orientation: {best}"
    elif misfit <= tol.MOST:
        text, remedy = "is in degrees per second", _described("angular_velocity", "0.0174533")
        # change = s w by least squares has s = pi / 180 for a gyroscope in degrees per second.
        if abs(np.sum(change * w) / np.sum(w * w) / np.radians(1.0) - 1) >= tol.RARE:
            return
    text, evidence = f"the angular velocity {text}", {"correlation": 1 - misfit}
    yield codes.BASE_FRAMES.wrong(text, evidence=evidence, remedy=remedy)


_BY_SAMPLES = (
    "name order and frame in [base] of the description of the log; seaid describe decides both by "
    "the samples"
)


def _described(quantity: str, scale: str) -> str:
    """Return a vector of the base with a scale, as TOML."""
    columns = '["...", "...", "..."]'
    return (
        f"in the description of the log:\n[base]\n{quantity} = "
        f"{{ columns = {columns}, scale = {scale} }}"
    )


def _correlation(x: Array, y: Array) -> float:
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(np.sum(x * y)) / size if size > 0 else 0.0


_RECORD_CHECKS = (
    Observation(codes.BASE_SENSOR, _missing_axes),
    Observation(codes.BASE_FRAMES, _contradicting_frames),
    Observation(codes.BASE_JUMPS, _jumps),
)


def base_findings(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Sequence[Motion]]
) -> list[Finding]:
    """Return what contradicts itself in the base and the contacts of logs, and their motions."""
    base = robot.floating_base
    if base is None:
        return []
    records = [BaseRecord(log.base, log.time, base) for log in logs if log.base is not None]
    findings = [finding for record in records for finding in observed(_RECORD_CHECKS, record)]
    if is_wrong(findings):
        return findings
    every = list(chain(*motions))
    for motion in every:
        findings += observed(MOTION_CHECKS, FeetInMotion(robot, motion, logs))
    lifts = Observation(codes.UNIDENTIFIABLE, partial(unused_lifts, base))
    return findings + observed((lifts,), every)


def missing_torques(robot: Robot, asked: Sequence[str], used: Collection[str]) -> Iterator[Finding]:
    """Yield the note on joints of a floating base that are `asked` for and have no torque."""
    missing = [joint for joint in asked if joint not in used]
    consequence = "the equations of the base alone are used"
    if used:
        consequence = "their equations are not used, and what moves by them is less certain"
    if robot.floating_base is not None and missing:
        yield codes.NO_TORQUE.note(
            f"the log has no torque of {listed(missing)}: {consequence}",
            only_joint(missing),
            evidence={"joints": float(len(missing))},
            remedy="describe the torque of these joints, or name the others with torque_joints=",
            certainty="certain",
        )


def sensor_errors(
    places: Sequence[tuple[str, int]],
    values: Array,
    errors: Array,
    hidden: Sequence[tuple[str, int]],
    imu: Array | None,
) -> Iterator[Finding]:
    """Yield notes on errors of sensors that were identified with the bodies and subtracted.

    `places` are their axes, (link of a force sensor, axis), with the link "" for the accelerometer,
    whose errors are in the frame of the base; `imu` (3, 3) turns from its own frame. `values` have
    standard `errors`; the logs do not determine `hidden` axes.
    """
    estimates = dict(zip(places, zip(values.tolist(), errors.tolist(), strict=True), strict=True))
    bias = np.array([estimates.pop(("", axis), (0.0, 0.0)) for axis in range(3)])
    error = float(np.max(bias[:, 1]))
    if error and imu is not None:
        evidence = dict(zip(("x [m/s^2]", "y [m/s^2]", "z [m/s^2]"), bias[:, 0] @ imu, strict=True))
        yield codes.BASE_BIAS.note(
            f"the accelerometer has a bias of {', '.join(f'{x:.2g}' for x in evidence.values())} "
            f"m/s^2 (x, y, z, standard error {error:.1g}): it was identified with the bodies and "
            "subtracted",
            evidence=evidence,
            remedy="calibrate the accelerometer in several orientations, or let the base tilt "
            "more: the bodies are less certain by the error of the bias",
        )
    if not estimates:
        return
    zeros = {
        f"{_axis_of(*x)} [{'N m' if x[1] > 2 else 'N'}]": pair for x, pair in estimates.items()
    }
    texts = (f"{name} {value:.3g} +- {std:.1g}" for name, (value, std) in zeros.items())
    unknown = f"; not determined: {listed(_axis_of(*at) for at in hidden)}" if hidden else ""
    yield codes.SENSOR_ZERO.note(
        f"force sensors have zeros of {', '.join(texts)}: they were identified with the bodies and "
        f"subtracted{unknown}",
        next(iter(estimates))[0],
        evidence={name: value for name, (value, _) in zeros.items()},
        remedy="set the sensors to zero with the feet in the air: the bodies are less certain by "
        "the errors of the zeros",
    )


def _axis_of(link: str, axis: int) -> str:
    """Return the name of an axis of a force sensor, forces first."""
    return f"{('force', 'moment')[axis // 3]} {'xyz'[axis % 3]} of {link}"
