"""`check`: the set-up of an experiment before any fit, from the logs and what was given.

Time, motion and channels are looked at one by one, then the torques by `setup_hypotheses`. Every
mistake is a `Finding` with its evidence and the one change that repairs it; what no fit can
use, a robot at rest or a dead channel, is an error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array, is_constant
from seaid._progress import Result, counted
from seaid.errors import (
    ExcitationError,
    Finding,
    IdentificationError,
    LogError,
    by_severity,
    checked,
)
from seaid.identification.datasets import Source, datasets_of, first_motion, sources_of
from seaid.identification.experiment import Experiment, experiment_of
from seaid.identification.setup_hypotheses import encoder_slope, mistakes
from seaid.log import Log, Motion, column_names
from seaid.robot import Robot

_SLOWEST_HZ, _FASTEST_HZ = 8.0, 2e5
"""Sampling rates of dynamic logs lie between; outside the unit of the time is another one."""

_UNITS_OF_TIME = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}

_LEAST_SWING = 0.03
"""Motion [rad or m] of every joint below which the robot hardly moves."""

_AT_LIMIT, _RUN, _LEVELS = 0.01, 5, 50
"""Share of a torque's samples at its extreme, in runs of at least so many, from which it saturates;
channels of fewer levels are too coarse to say."""

_APART = 0.1
"""Difference of the encoder offsets of two logs, over the deflection (rms), that matters."""


@dataclass(frozen=True)
class JointCheck:
    """What the logs say of one joint, NaN where they cannot.

    Attributes
    ----------
    swing : float
        Range of the position [rad or m].
    encoder_slope : float
        Motor angle per joint angle over the gear ratio: 1 for a right set-up.
    nominal, bodies, motor : float
        Share (rms) of the torque that is left by the bodies of the robot file, by any bodies, and
        by the motor equation (7) of a spring joint.
    """

    swing: float
    encoder_slope: float
    nominal: float
    bodies: float
    motor: float


@dataclass(frozen=True, eq=False, repr=False)
class SetupCheck(Result):
    """The result of `check`.

    Attributes
    ----------
    warnings : tuple of Finding
        The mistakes found, the worst first; empty if nothing contradicts the set-up.
    joints : mapping {joint: JointCheck}
        The numbers on which they rest.
    """

    table_name = "setup_table"

    warnings: tuple[Finding, ...]
    joints: dict[str, JointCheck]

    def _in_short(self) -> str:
        return f"{counted(len(self.joints), 'joint')}, {counted(len(self.warnings), 'warning')}"


@checked(IdentificationError)
def check(
    robot: Robot, logs: Source | Sequence[Source], *, cutoff_hz: float | None = None
) -> SetupCheck:
    """Check the set-up of an experiment before the fit: units, signs, ratios, gravity, payloads.

    Nothing is estimated but what decides between mistakes; `identify` makes this check itself.

    Parameters
    ----------
    robot : Robot
        The robot model of `load_robot`. Nominal bodies help to find mistakes, wrong ones only
        weaken the check.
    logs : Log, LongLog, path, or a sequence of them
        The logs; of long logs the first piece is checked.
    cutoff_hz : float, optional
        Cutoff of the low pass. Default: proposed from the data.

    Returns
    -------
    SetupCheck

    Raises
    ------
    IdentificationError, LogError
        For logs that do not fit the robot.

    Examples
    --------
    >>> robot = seaid.load_robot("leg.urdf", "leg.toml")
    >>> print(seaid.check(robot, seaid.read_log("run.csv", robot)).summary())
    """
    sources = sources_of(logs)
    in_memory = [one for one in sources if isinstance(one, Log)]
    first = log_findings(robot, in_memory)
    if any(one.code == "time-unit" for one in first):
        return SetupCheck(tuple(first), {})
    motions = [first_motion(one) for one in datasets_of(robot, sources, cutoff_hz, None, False)]
    given = experiment_of(robot, motions)
    found = [*first, *setup_findings(given, first)]
    return SetupCheck(by_severity(found), _joints(given, motions))


def _joints(given: Experiment, motions: Sequence[Motion]) -> dict[str, JointCheck]:
    swings = np.max([np.ptp(one.joint_position, axis=0) for one in motions], axis=0)
    return {
        joint: JointCheck(
            swing=float(swings[j]),
            encoder_slope=encoder_slope(given, j) if given.both[j] else float("nan"),
            nominal=float(given.nominal[j]),
            bodies=float(given.free[j]),
            motor=float(given.of_motors[j]),
        )
        for j, joint in enumerate(given.robot.joint_names)
    }


def setup_findings(given: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return mistakes of the set-up, unless the `known` findings already explain the torques."""
    if any(one.code in _EXPLAINING for one in known):
        return []
    return mistakes(given)[0]


_EXPLAINING = ("time-unit", "encoder-offsets-differ", "missing-drives", "standstill")
"""Findings after which the torques say nothing of other mistakes."""


def log_findings(robot: Robot, logs: Sequence[Log]) -> list[Finding]:
    """Return the findings that need no motion: the unit of time, drives, saturated torques."""
    found = [
        finding
        for number, log in enumerate(logs, 1)
        for finding in (
            *_time(log),
            *_missing_drives(robot, log),
            *_saturated(log, f" in log {number}" if len(logs) > 1 else ""),
        )
    ]
    return [*found, *_standing(logs), *_offsets(robot, logs)]


def _time(log: Log) -> Iterator[Finding]:
    rate = (len(log.time) - 1) / float(log.time[-1] - log.time[0])
    if _SLOWEST_HZ <= rate <= _FASTEST_HZ:
        return
    fitting = [
        unit for unit, size in _UNITS_OF_TIME.items() if _SLOWEST_HZ <= rate / size <= _FASTEST_HZ
    ]
    # several may fit: the one whose rate is nearest to 500 Hz
    fitting.sort(key=lambda one: abs(float(np.log(rate / _UNITS_OF_TIME[one] / 500))))
    unit, remedy = fitting[0] if fitting else "", ""
    text = "is its time in seconds?"
    if unit:
        text = f"its time seems to be in {unit}, which gives {rate / _UNITS_OF_TIME[unit]:.4g} Hz"
        remedy = f'in the description of the log:\ntime = {{ column = "time_s", unit = "{unit}" }}'
    yield Finding(
        "time-unit",
        f"the log has {rate:.3g} samples per second: {text}",
        severity="wrong",
        evidence={"rate [Hz]": rate},
        remedy=remedy,
        certainty="certain" if unit else "likely",
    )


def _missing_drives(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield the joints with two different encoders, or currents, and an ideal drive."""
    found = []
    for joint, drive in robot.drives.items():
        if drive.is_elastic or drive.ratio != 1 or joint not in log.joint_names:
            continue
        j = log.joint_names.index(joint)
        sides = log.motor_position[:, j], log.joint_position[:, j]
        if not all(np.all(np.isfinite(side)) for side in sides):
            continue
        moved = [float(np.std(side)) for side in sides]
        if min(moved) > 0 and moved[0] > 2.0 * moved[1]:
            found.append((joint, moved[0] / moved[1]))
    if found:
        names = ", ".join(joint for joint, _ in found)
        tables = "\n".join(
            f'[{joint}]\ntype = "stiff"  # or "series_elastic", with its stiffness\n'
            f"gear_ratio = {ratio:.4g}"
            for joint, ratio in found
        )
        yield Finding(
            "missing-drives",
            f"the log has the motor side of {names}, which moves {found[0][1]:.3g} times as far as "
            "the joint, and the robot has no drive there: friction, gear and spring are not in the "
            "model (--drives, drives=)",
            found[0][0],
            "wrong",
            {"motor over joint motion": found[0][1]},
            f"in the drives file:\n{tables}",
            "certain",
        )


def _saturated(log: Log, where: str) -> Iterator[Finding]:
    for field in ("motor_torque", "motor_current", "motor_voltage"):
        values = getattr(log, field)
        for j, joint in enumerate(log.joint_names if values is not None else ()):
            column = np.asarray(values[:, j])
            if not np.all(np.isfinite(column)) or len(np.unique(column)) < _LEVELS:
                continue
            at_limit = (column == np.max(column)) | (column == np.min(column))
            inside = np.convolve(at_limit, np.ones(_RUN), mode="same") >= _RUN
            share = float(np.mean(inside))
            if share > _AT_LIMIT:
                name = field.replace("_", " ")
                yield Finding(
                    "saturation",
                    f"the {name} of {joint} is at its limit, {np.max(np.abs(column)):.4g}, during "
                    f"{share:.1%} of the time{where}: what the motor gave there is unknown if the "
                    "command was logged",
                    joint,
                    "doubtful",
                    {"share at the limit": share},
                    "record a slower motion, or log the measured current",
                    "certain",
                )


def _standing(logs: Sequence[Log]) -> Iterator[Finding]:
    swings = [
        float(np.ptp(side))
        for log in logs
        for side in log.joint_position.T
        if np.all(np.isfinite(side))
    ]
    if swings and max(swings) < _LEAST_SWING:
        yield Finding(
            "standstill",
            f"the robot hardly moves: its widest motion is {max(swings):.2g} rad or m",
            severity="doubtful",
            evidence={"widest motion": max(swings)},
            remedy="record a wider motion: seaid excite plans one",
            certainty="certain",
        )


def _offsets(robot: Robot, logs: Sequence[Log]) -> Iterator[Finding]:
    """Yield elastic joints whose encoder offsets differ between logs by more than deflections."""
    for joint in robot.elastic_joints if len(logs) > 1 else ():
        drive = robot.drives[joint]
        lever = drive.ratio * drive.load_radius / drive.motor_radius
        places = [log.joint_names.index(joint) for log in logs]
        pairs = list(zip(logs, places, strict=True))
        apart = [log.motor_position[:, j] / lever - log.joint_position[:, j] for log, j in pairs]
        if not all(np.all(np.isfinite(one)) for one in apart):
            continue
        torques = [_torque(log, j) for log, j in pairs]
        middles = np.array([np.mean(one) for one in apart])
        loads = np.array([np.mean(one) for one in torques])
        x = np.concatenate([one - mean for one, mean in zip(torques, loads, strict=True)])
        y = np.concatenate([one - mean for one, mean in zip(apart, middles, strict=True)])
        slope = float(x @ y) / max(float(x @ x), 1e-300)
        offsets, size = middles - slope * loads, max(float(np.std(y)), 1e-300)
        spread = abs(slope) * float(np.ptp(loads))
        for number, change in enumerate((offsets[1:] - offsets[0]).tolist(), 2):
            if abs(change) <= _APART * size + spread:
                continue
            names = column_names(joint, robot.is_prismatic[robot.index(joint)])
            column = next(name for name, field in names.items() if field == "motor_position")
            yield Finding(
                "encoder-offsets-differ",
                f"the encoder offsets of {joint} differ by {change * lever:.4g} rad at the motor "
                f"between log 1 and log {number}, {abs(change) / size:.2g} times the deflection of "
                "its spring (rms): the robot was switched on anew",
                joint,
                "wrong",
                {"difference [rad at the motor]": change * lever},
                f"in the description of log {number}:\n[joints.{joint}]\n"
                f'motor_position = {{ column = "{column}", offset = {-change * lever:.6g} }}',
                "certain",
            )


def _torque(log: Log, j: int) -> Array:
    """Return the torque of a joint, zero where it was not logged."""
    motor = log.motor_torque[:, j]
    if not np.all(np.isfinite(motor)) and log.joint_torque is not None:
        motor = log.joint_torque[:, j]
    return np.nan_to_num(motor)


_LEAST_RANGE = 20.0
"""A position moves if its range is this many times the noise between samples."""


def check_excitation(robot: Robot, logs: Sequence[Log]) -> None:
    """Raise ExcitationError if an elastic joint's motor, or the whole robot, does not move."""
    for joint in robot.elastic_joints:
        positions = [log.motor_position[:, log.joint_names.index(joint)] for log in logs]
        if not any(map(_moves, positions)):
            widest = max(float(np.ptp(position)) for position in positions)
            raise ExcitationError(
                f"the motor of '{joint}' stands still (it moves {widest:.3g} rad, noise "
                f"{_noise(positions[0]):.2g} rad), so that its friction and spring are "
                "unidentifiable; move the joint, or exclude it with joints=[...] of load_robot",
                "joints=[...] of load_robot",
            )
    every = [
        column
        for log in logs
        for side in (log.joint_position, log.motor_position)
        for column in side.T
        if np.all(np.isfinite(column))
    ]
    if not any(map(_moves, every)):
        raise ExcitationError("no joint moves in the log: the motion does not excite the robot")


def check_channels(logs: Sequence[Log]) -> None:
    """Raise LogError if a sensor is constant while another sensor of its joint moves."""
    for log in logs:
        for index, joint in enumerate(log.joint_names):
            sides = {
                "motor position": log.motor_position[:, index],
                "joint position": log.joint_position[:, index],
            }
            for dead, other in (tuple(sides), tuple(sides)[::-1]):
                _check_alive(joint, dead, sides[dead], other, sides[other])
            torques = {"motor torque": log.motor_torque[:, index]}
            if log.joint_torque is not None:
                torques["joint torque"] = log.joint_torque[:, index]
            for name, torque in torques.items():
                for side, position in sides.items():
                    _check_alive(joint, name, torque, side, position)


def _check_alive(joint: str, name: str, values: Array, other: str, moved: Array) -> None:
    if is_constant(values) and np.all(np.isfinite(moved)) and _moves(moved):
        raise LogError(
            f"the {name} of '{joint}' is {values[0]:.6g} all the time, while its {other} moves: a "
            "dead channel? Exclude its column from the log, or the joint with joints=[...] of "
            "load_robot",
            "joints=[...] of load_robot",
        )


def _moves(position: Array) -> bool:
    return bool(np.ptp(position) > _LEAST_RANGE * _noise(position))


def _noise(position: Array) -> float:
    """Return the standard deviation of white noise, from second differences of 6-fold variance."""
    return float(np.std(np.diff(position, 2)) / np.sqrt(6))
