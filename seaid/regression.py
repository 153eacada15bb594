"""Regression: y = H theta over time, (15); the actuator side (10).

Regressor and torque pass the same low pass, then every few samples make a row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from seaid.arrays import Array, BoolArray, IndexArray, frozen
from seaid.drivetrain.equations import joint_equation, motor_equation, spring_equation
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.drivetrain.regressor import DriveRegressor, drive_regressor
from seaid.drivetrain.values import is_dry
from seaid.errors import LogError
from seaid.filtering import decimation, low_pass
from seaid.motion import Motion
from seaid.rigid_body import rigid_body_regressor
from seaid.robot import Robot
from seaid.transmission import at_drives, torques_at_drives

__all__ = [
    "Regression",
    "actuator_regression",
    "motor_regressor",
    "rigid_body_regressor",
    "spring_regressor",
    "stacked",
    "standstill",
    "standstill_seen",
]

STANDSTILL = 0.01
"""A motor slower than this part of its fastest stands still: its friction has no direction."""

REST_RAD_S = 1e-9
"""So does one slower than this, whatever its fastest: that is the rounding of the filters."""

SEEN = 0.05
"""Share of standstill in what the low pass sees above which a sample is left out."""

SEEN_AT_A_PEAK = 0.01
"""The same for friction with a peak at standstill (Stribeck), told by the samples beside it."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Rows y (R,) = H (R, p) theta, each of one equation at one time.

    `joint` (R,) tells the equation, `time` (R,) [s] the instant; `left_out` counts the instants
    near standstill that are not rows. `carried` (R, s) is the derivative of y with respect to
    parameters that were estimated before (the springs'), if there are any; `run` (R,) tells the
    log, where several are stacked; `joint_names` (n,) are those that `joint` counts, if known.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    H: Array
    y: Array
    joint: Array
    time: Array
    run: Array
    left_out: int
    carried: Array
    joint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "H", frozen("H", self.H, (None, len(self.names))))
        rows = len(self.H)
        for name in ("y", "joint", "time", "run"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), (rows,)))
        object.__setattr__(self, "carried", frozen("carried", self.carried, (rows, None)))


def motor_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the motor equation (7) of a joint."""
    return _motor_regressor(robot.drivetrains[joint])


def spring_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the spring equation (4b) of an elastic joint."""
    drive = robot.drivetrains[joint]
    if not isinstance(drive, SeriesElasticDrive):
        raise LogError(f"joint '{joint}' has no spring")
    return _spring_regressor(drive)


def joint_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor of what acts beside the drive: parallel spring, joint friction."""
    return _joint_regressor(robot.drivetrains[joint])


@cache
def _joint_regressor(drive: Drive) -> DriveRegressor:
    return drive_regressor(joint_equation(drive), drive)


@cache
def _motor_regressor(drive: Drive) -> DriveRegressor:
    return drive_regressor(motor_equation(drive), drive)


@cache
def _spring_regressor(drive: SeriesElasticDrive) -> DriveRegressor:
    return drive_regressor(spring_equation(drive), drive)


def signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return the signals of a drive's equations by name, each (T,); no load torque yet.

    theta_L is what the drive turns: the joint, or the sum of joints of its transmission.
    """
    position, velocity, acceleration = (
        at_drives(robot.transmission, state)[:, index] for state in motion.joint_states
    )
    return {
        "theta_M": motion.motor_position[:, index],
        "theta_M_dot": motion.motor_velocity[:, index],
        "theta_M_ddot": motion.motor_acceleration[:, index],
        "theta_L": position,
        "theta_L_dot": velocity,
        "theta_L_ddot": acceleration,
        "tau_M": motion.motor_torque[:, index],
        "tau_L": np.zeros(len(motion.time)),
        "i_M": _channel(motion.motor_current, motion, index),
        "u_M": _channel(motion.motor_voltage, motion, index),
        "tau_G": _channel(motion.gear_torque, motion, index),
    }


def _channel(samples: Array | None, motion: Motion, index: int) -> Array:
    return np.full(len(motion.time), np.nan) if samples is None else samples[:, index]


INPUTS = {"torque": "tau_M", "current": "i_M", "voltage": "u_M"}
"""The signal that a drive's equation has as the motor's input."""


def sensed_torque(robot: Robot, motion: Motion, index: int) -> Array:
    """Return the torque (T,) on what a drive turns by the sensors at the joints, NaN without.

    Of a drive that moves several joints it takes the sensors of all joints that are coupled.
    """
    return np.asarray(torques_at_drives(robot.transmission, motion.joint_torque)[:, index])


def standstill(motion: Motion, index: int, seen: float = SEEN) -> BoolArray:
    """Tell the samples (T,) that see a motor stand still, so that its friction is unknown.

    Behind the low pass a sample sees its neighbourhood: it is left out if standstill makes up more
    than a small share of that, `seen`. A reversal without a stop is no standstill.
    """
    speed = np.abs(motion.motor_velocity[:, index])
    fastest = np.max(speed) if motion.fastest is None else motion.fastest[index]
    return _still(motion, speed, float(fastest), seen)


def standstill_seen(drive: Drive) -> float:
    """Return the share of standstill that samples of a drive with dry friction may see."""
    return SEEN_AT_A_PEAK if "stribeck" in drive.friction else SEEN


def joint_standstill(motion: Motion, index: int) -> BoolArray:
    """Tell the samples (T,) that see a joint stand still, as `standstill` does of its motor."""
    speed = np.abs(motion.joint_velocity[:, index])
    return _still(motion, speed, float(np.max(speed)), SEEN)


def _still(motion: Motion, speed: Array, fastest: float, seen: float) -> BoolArray:
    still = (speed < max(STANDSTILL * fastest, REST_RAD_S)).astype(float)
    return np.asarray((still > 0) | (in_band(motion, still) > seen))


def actuator_columns(
    robot: Robot, motion: Motion, joint: str
) -> tuple[DriveRegressor, Array, Array]:
    """Return the regressor of an elastic joint's actuator side, zeta (T,) and R (T, p), (10).

    From the motor torque and (7); where the log has only the spring's torque, from (4b), which
    tells stiffness and offset. Raises LogError where neither was measured.
    """
    regressor, by_name = actuator_equation(robot, motion, joint)
    return regressor, *regressor.evaluate(by_name)


def actuator_equation(
    robot: Robot, motion: Motion, joint: str
) -> tuple[DriveRegressor, dict[str, Array]]:
    """Return the regressor that `actuator_columns` evaluates, and the signals it takes."""
    index = robot.index(joint)
    by_name = signals(robot, motion, index)
    sensed = sensed_torque(robot, motion, index)
    kind = robot.drivetrains[joint].motor_input
    if np.all(np.isfinite(by_name[INPUTS[kind]])):
        return motor_regressor(robot, joint), by_name
    if np.all(np.isfinite(sensed)):
        return spring_regressor(robot, joint), {**by_name, "tau_L": sensed}
    others = [other for other, name in INPUTS.items() if np.all(np.isfinite(by_name[name]))]
    hint = f"; it has its {others[0]}: say motor_input = '{others[0]}'" if others else ""
    raise LogError(
        f"elastic joint '{joint}' has no torque in the log: motor {kind} or joint torque{hint}"
    )


def actuator_regression(robot: Robot, motion: Motion, joint: str) -> Regression:
    """Return the actuator side (10) over time: friction, stiffness, deflection offset.

    Instants near standstill are left out where dry friction is among them.
    """
    index = robot.index(joint)
    regressor, y, H = actuator_columns(robot, motion, joint)
    kept, left_out = actuator_rows(robot, motion, joint, regressor)
    return Regression(
        names=regressor.names,
        units=regressor.units,
        H=in_band_at(motion, H, kept),
        y=in_band_at(motion, y, kept),
        joint=np.full(len(kept), index),
        time=motion.time[kept],
        run=np.zeros(len(kept)),
        left_out=left_out,
        carried=np.empty((len(kept), 0)),
        joint_names=robot.joint_names,
    )


def actuator_rows(
    robot: Robot, motion: Motion, joint: str, regressor: DriveRegressor
) -> tuple[IndexArray, int]:
    """Return the samples that become rows of an actuator side, and how many are left out.

    The spring equation (4b) has no derivative in it: it holds to the ends of the log.
    """
    if "tau_M" not in regressor.signals and not regressor.signals & {"i_M", "u_M"}:
        return row_samples(replace(motion, trim_s=0.0)), 0
    rows = row_samples(motion)
    drive = robot.drivetrains[joint]
    if not is_dry(drive):
        return rows, 0
    kept = rows[~standstill(motion, robot.index(joint), standstill_seen(drive))[rows]]
    return kept, len(rows) - len(kept)


def stacked(regressions: Sequence[Regression]) -> Regression:
    """Return the regressions of several logs as one, (15).

    Raises LogError where they do not have the same columns.
    """
    for one in regressions[1:]:
        if one.names != regressions[0].names:
            raise LogError(
                f"one log tells {', '.join(regressions[0].names)}, another "
                f"{', '.join(one.names)}: the logs must have the same torque sensors"
            )
    return Regression(
        names=regressions[0].names,
        units=regressions[0].units,
        run=np.concatenate([np.full(len(one.y), run) for run, one in enumerate(regressions)]),
        left_out=sum(one.left_out for one in regressions),
        joint_names=regressions[0].joint_names,
        **{
            name: np.concatenate([getattr(one, name) for one in regressions])
            for name in ("H", "y", "joint", "time", "carried")
        },
    )


def in_band(motion: Motion, columns: Array) -> Array:
    """Return columns (T, ...) behind the low pass of the motion's pass band."""
    return in_band_at(motion, columns, np.arange(len(columns)))


def in_band_at(motion: Motion, columns: Array, samples: IndexArray) -> Array:
    """Return some samples of `in_band`; columns of zeros, half of a chain's, are not filtered."""
    flat = columns.reshape(len(columns), -1)
    used = np.flatnonzero(np.any(flat != 0, axis=0))
    found = np.zeros((len(samples), flat.shape[1]))
    found[:, used] = low_pass(flat[:, used], motion.rate_hz, motion.cutoff_hz)[samples]
    return found.reshape(len(samples), *columns.shape[1:])


def row_samples(motion: Motion) -> IndexArray:
    """Return the samples that become rows: decimated to the pass band, ends left away."""
    step = decimation(motion.rate_hz, motion.cutoff_hz)
    trim = round(motion.trim_s * motion.rate_hz)
    return np.arange(trim, len(motion.time) - trim, step)
