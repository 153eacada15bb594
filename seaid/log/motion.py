"""Motion: what the robot did, both sides, filtered and differentiated from a log.

Processing: what was done to a log before anything was identified from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array
from seaid.drives import SeriesElasticDrive
from seaid.errors import LogError
from seaid.log.filtering import CutoffSelection, low_pass, propose_pass_band, spline_derivatives
from seaid.log.gaps import HOLES, check_whole, holes, stretches
from seaid.log.reading import Log
from seaid.log.repair.clocks import longest_bridge, typical_step
from seaid.log.repair.data import Repair
from seaid.log.repair.resampling import interpolated
from seaid.robot import Robot, at_drives, at_joints, coupled_groups


def has_holes(processing: Sequence[Processing]) -> bool:
    """Tell whether a log has holes in time, so that it was taken stretch by stretch."""
    return any(one.flags for one in processing)


@dataclass(frozen=True)
class Processing:
    """What was done to a log; str() tells it in one line.

    Rates [Hz] of the log and of the motion's uniform grid (`resampled`: if they differ, or the
    log's steps do), the low pass of the positions [Hz], the pass band of regressor and torque and
    its reason, what is left away at both ends [s], and what was mended when the log was read.
    """

    logged_rate_hz: float
    rate_hz: float
    resampled: bool
    position_low_pass_hz: float
    cutoff_selection: CutoffSelection
    trim_s: float
    repairs: tuple[Repair, ...] = ()

    @property
    def flags(self) -> tuple[str, ...]:
        """In words, the holes in the log's time."""
        return tuple(str(repair) for repair in self.repairs if repair.kind == HOLES)

    def __str__(self) -> str:
        grid = f"{self.rate_hz:.4g} Hz"
        if self.resampled:
            grid = f"uneven steps resampled to {grid} (splines)"
        low_pass = f"positions below {self.position_low_pass_hz:.3g} Hz"
        if self.position_low_pass_hz >= 0.4 * self.rate_hz:
            low_pass = "positions as they are"
        repaired = (
            f"; {len(self.repairs)} kinds of faults mended on reading" if self.repairs else ""
        )
        return (
            f"{grid}, {low_pass}; regressor and torque below {self.cutoff_selection}; "
            f"{self.trim_s:.2g} s left away at both ends{repaired}"
        )


POSITION_BAND = 5.0
"""Positions are filtered at so many times the cutoff, to leave the pass band untouched."""

FEWEST_PERIODS = 10.0
"""Periods of the cutoff that a log must hold for the filters to have an inside."""

SHORTEST_STRETCH = 4.0
"""Periods of the cutoff that a stretch between two holes of a log must hold: half are inside."""

_REGULAR = 1e-3
"""Time steps that differ by more than this part are resampled."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Position, velocity, acceleration and torque of both sides, each (T, n), on a uniform grid.

    Joint side in rad or m, motor side in rad; torques in N m (`joint_torque` of a prismatic joint
    in N); NaN where a joint has no such sensor. `cutoff_hz` is the pass band in which a regression
    compares regressor and torque (inf: no filter); torques, motor current [A] and voltage [V]
    (None: no such sensor) are as measured. `regressions` leave `trim_s` away at both ends, where
    filters swing in. `fastest` (n,) are the largest motor speeds [rad/s] of the whole log where
    this is a part of it. `gear_torque` is the torque that stiff drives put on their load, N m or N,
    as far as it is known, where friction depends on it.
    """

    time: Array
    joint_names: tuple[str, ...]
    joint_position: Array
    joint_velocity: Array
    joint_acceleration: Array
    motor_position: Array
    motor_velocity: Array
    motor_acceleration: Array
    motor_torque: Array
    joint_torque: Array
    cutoff_hz: float
    trim_s: float = 0.0
    fastest: Array | None = None
    motor_current: Array | None = None
    motor_voltage: Array | None = None
    gear_torque: Array | None = None
    processing: Processing | None = None

    @property
    def joint_states(self) -> tuple[Array, Array, Array]:
        """Joint position, velocity and acceleration, each (T, n)."""
        return self.joint_position, self.joint_velocity, self.joint_acceleration

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return _rate_hz(self.time)


def reconstruct_motion(robot: Robot, log: Log, cutoff_hz: float | None = None) -> Motion:
    """Return the motion of a log: resampled if need be, filtered, differentiated.

    Positions pass a zero-phase low pass at five times `cutoff_hz`, the pass band of the
    identification, and are differentiated by a quintic spline; the torques stay as they are, since
    a regression filters regressor and torque alike. `cutoff_hz` None: proposed from the spectra,
    see `seaid.log.filtering`; `Motion.processing` tells what was done, and why. The side of a stiff
    drive that has no encoder is computed from the other; joints that drives move together from all
    of their motors. Raises LogError where the log does not fit the robot, is too short for the
    cutoff or has a hole in time (see `reconstruct_motions`).
    """
    check_whole(log)
    return _motion(robot, log, None if cutoff_hz is None else _given(cutoff_hz))


def reconstruct_motions(
    robot: Robot, log: Log, cutoff_hz: float | None = None
) -> tuple[Motion, ...]:
    """Return the motion of each stretch of a log between its holes in time, in one pass band.

    As `reconstruct_motion` otherwise: a log without a hole has one motion. `cutoff_hz` None:
    the narrower of those proposed from the longest stretch, which may be short, and from the whole
    log with straight lines over its holes, whose bends look fast. Stretches shorter than four
    periods of the cutoff are excluded; the repairs of the first motion's `processing` say so.
    Raises LogError where that, with the holes, is more than half of the log.
    """
    if not holes(log.time):
        return (reconstruct_motion(robot, log, cutoff_hz),)
    longest = max(stretches(log), key=lambda part: float(part.time[-1] - part.time[0]))
    if cutoff_hz is None:
        bands = [_proposed(robot, *_sampled(robot, one)) for one in (log, longest)]
        band = min(bands, key=lambda one: one.cutoff_hz)
    else:
        band = _given(cutoff_hz)
        check_cutoff(cutoff_hz, 1.0 / typical_step(log.time))
    parts = stretches(log, 1.001 * SHORTEST_STRETCH / band.cutoff_hz)
    _check_duration(band.cutoff_hz, sum(float(part.time[-1] - part.time[0]) for part in parts))
    motions = [_motion(robot, part, band, fewest=SHORTEST_STRETCH) for part in parts]
    fastest = np.max([np.max(np.abs(one.motor_velocity), axis=0) for one in motions], axis=0)
    return tuple(replace(one, fastest=fastest) for one in motions)


def _given(cutoff_hz: float) -> CutoffSelection:
    return CutoffSelection(cutoff_hz, "as it was given")


def _sampled(robot: Robot, log: Log) -> tuple[Array, dict[str, Array]]:
    """Return time and {sensor: samples} on a uniform grid, with all positions that are needed."""
    time, signals = _uniform(log, _columns(robot, log))
    _check_sides(robot, signals["joint_position"], signals["motor_position"])
    return time, signals


def _proposed(robot: Robot, time: Array, signals: dict[str, Array]) -> CutoffSelection:
    joint, motor = signals["joint_position"], signals["motor_position"]
    return propose_pass_band(joint, motor, _rate_hz(time), robot.joint_names)


def _motion(
    robot: Robot,
    log: Log,
    band: CutoffSelection | None,
    fewest: float = FEWEST_PERIODS,
) -> Motion:
    """Return the motion of a log without a hole; `band` None: proposed from the spectra."""
    time, signals = _sampled(robot, log)
    rate_hz = _rate_hz(time)
    joint, motor = signals["joint_position"], signals["motor_position"]
    band = _proposed(robot, time, signals) if band is None else band
    cutoff_hz = band.cutoff_hz
    check_cutoff(cutoff_hz, rate_hz)
    _check_duration(cutoff_hz, float(time[-1] - time[0]), fewest)
    measured = low_pass(np.hstack([joint, motor]), rate_hz, POSITION_BAND * cutoff_hz)
    position, velocity, acceleration = (
        _both_sides(robot, signal) for signal in spline_derivatives(time, measured)
    )
    n = robot.n
    return Motion(
        time=time,
        joint_names=robot.joint_names,
        joint_position=position[:, :n],
        joint_velocity=velocity[:, :n],
        joint_acceleration=acceleration[:, :n],
        motor_position=position[:, n:],
        motor_velocity=velocity[:, n:],
        motor_acceleration=acceleration[:, n:],
        motor_torque=signals["motor_torque"],
        joint_torque=signals.get("joint_torque", np.full_like(joint, np.nan)),
        motor_current=signals.get("motor_current"),
        motor_voltage=signals.get("motor_voltage"),
        cutoff_hz=float(cutoff_hz),
        trim_s=1.0 / cutoff_hz,
        processing=_processing(log, time, band),
    )


def _processing(log: Log, time: Array, band: CutoffSelection) -> Processing:
    """Return what was done to a log that is now at other times, or at its own."""
    return Processing(
        logged_rate_hz=_rate_hz(log.time),
        rate_hz=_rate_hz(time),
        resampled=time is not log.time,
        position_low_pass_hz=float(POSITION_BAND * band.cutoff_hz),
        cutoff_selection=band,
        trim_s=float(1.0 / band.cutoff_hz),
        repairs=log.report,
    )


def _rate_hz(time: Array) -> float:
    return float((len(time) - 1) / (time[-1] - time[0]))


def _columns(robot: Robot, log: Log) -> list[int]:
    missing = [joint for joint in robot.joint_names if joint not in log.joint_names]
    if missing:
        raise LogError(
            f"the log has no joint {', '.join(missing)} of '{robot.name}'; "
            f"its joints: {', '.join(log.joint_names)}"
        )
    return [log.joint_names.index(joint) for joint in robot.joint_names]


def is_regular(time: Array) -> bool:
    """Tell whether time steps are so alike that nothing is resampled."""
    steps = np.diff(time)
    step = float(np.median(steps))
    return bool(np.max(np.abs(steps - step)) <= _REGULAR * step)


def _uniform(log: Log, columns: list[int]) -> tuple[Array, dict[str, Array]]:
    """Return time and {sensor: samples} on a uniform grid at the log's mean rate."""
    signals = {field: values[:, columns] for field, values in log.sensors().items()}
    if is_regular(log.time):
        return log.time, signals
    steps = np.diff(log.time)
    step = float(np.mean(steps[steps <= longest_bridge(log.time)]))
    count = math.floor((log.time[-1] - log.time[0]) / step + 1e-9) + 1
    time = np.minimum(log.time[0] + step * np.arange(count), log.time[-1])
    found = {field: np.full((count, len(columns)), np.nan) for field in signals}
    for field, values in signals.items():
        for place in np.flatnonzero(np.isfinite(values[0])):
            found[field][:, place] = interpolated(
                log.time, values[:, place], time, smooth=field.endswith("position")
            )
    return time, found


def _check_sides(robot: Robot, joint: Array, motor: Array) -> None:
    _check_coupled(robot, joint, motor)
    coupled = {index for group in coupled_groups(robot.transmission) for index in group}
    for index, name in enumerate(robot.joint_names):
        no_joint, no_motor = np.isnan(joint[0, index]), np.isnan(motor[0, index])
        if isinstance(robot.drives[name], SeriesElasticDrive):
            if no_joint or no_motor:
                side = "joint" if no_joint else "motor"
                raise LogError(f"elastic joint '{name}' needs its {side} position in the log")
        elif no_joint and no_motor and index not in coupled:
            raise LogError(f"joint '{name}' has no position in the log")


def _check_coupled(robot: Robot, joint: Array, motor: Array) -> None:
    """Raise LogError where encoders of a coupled group do not tell all of its joints."""
    for group in coupled_groups(robot.transmission):
        names = [robot.joint_names[index] for index in group]
        unseen = [robot.joint_names[index] for index in group if np.isnan(joint[0, index])]
        blind = [robot.joint_names[index] for index in group if np.isnan(motor[0, index])]
        elastic = [name for name in names if name in robot.elastic_joints]
        if unseen and (blind or elastic):
            why = f"the motors of {', '.join(blind)} have none" if blind else ""
            why = why or f"behind the spring of {', '.join(elastic)} no motor tells it"
            raise LogError(
                f"the drives of {', '.join(names)} move these joints together, and the log has no "
                f"joint position of {', '.join(unseen)}; {why}"
            )


def _both_sides(robot: Robot, signal: Array) -> Array:
    """Return joint and motor side (T, 2n) with what stiff drives have no encoder for."""
    both, n = signal.copy(), robot.n
    joint, motor = both[:, :n], both[:, n:]
    ratio = np.array([robot.drives[name].ratio for name in robot.joint_names])
    unseen, blind = np.isnan(joint[0]), np.isnan(motor[0])
    joint[:, unseen] = at_joints(robot.transmission, motor / ratio)[:, unseen]
    motor[:, blind] = (at_drives(robot.transmission, joint) * ratio)[:, blind]
    return both


def check_cutoff(cutoff_hz: float, rate_hz: float) -> None:
    """Raise LogError for a pass band that the sampling rate does not have."""
    if not 0 < cutoff_hz < rate_hz / 2:
        raise LogError(
            f"cutoff_hz must be between 0 and half the sampling rate, {rate_hz / 2:.4g} Hz, "
            f"found {cutoff_hz}"
        )


def _check_duration(cutoff_hz: float, duration_s: float, fewest: float = FEWEST_PERIODS) -> None:
    if duration_s * cutoff_hz < fewest:
        raise LogError(
            f"the log is too short: {duration_s:.3g} s hold fewer than {fewest:g} periods of the "
            f"cutoff, {cutoff_hz:.3g} Hz; record more, or set cutoff_hz higher"
        )
