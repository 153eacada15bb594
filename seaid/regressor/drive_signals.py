"""The regressors of a robot's drives, and the signals of a motion at which they are evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import drive_regressor, joint_equation, motor_equation, spring_equation
from seaid.errors import LogError
from seaid.robot import at_drives, torques_at_drives

if TYPE_CHECKING:
    from seaid.drives import Drive, DriveRegressor
    from seaid.log import Motion
    from seaid.robot import Robot

INPUTS = {"torque": "tau_M", "current": "i_M", "voltage": "u_M"}
"""{motor input: its signal in the drive's equation}."""

INPUT_FIELDS = {"torque": "motor_torque", "current": "motor_current", "voltage": "motor_voltage"}
"""Field of a motion with a drive's logged input."""

_STILL = 1e-5
"""Speed [rad/s or m/s] below which a joint stands still: an encoder of 2^14 steps makes one step in
40 s. The rounding of speeds, about 1e-10, is far below, so that it decides no sample."""


def motor_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the motor equation (7) of a joint."""
    return _motor_regressor(robot.drives[joint], joint)


def spring_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the spring equation (4b) of an elastic joint."""
    drive = robot.drives[joint]
    if not drive.is_elastic:
        raise LogError(f"joint '{joint}' has no spring")
    return _spring_regressor(drive, joint)


def joint_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor of the joint terms: parallel spring and joint friction."""
    return _joint_regressor(robot.drives[joint], joint)


def under_load(robot: Robot, used: Sequence[str]) -> tuple[str, ...]:
    """Return the joints among `used` whose stiff drive has load-dependent friction."""
    return tuple(
        joint
        for joint in used
        if joint not in robot.elastic_joints and "load" in robot.drives[joint].friction
    )


def is_linear(robot: Robot, used: Sequence[str]) -> bool:
    """Whether springs and joints `used` are linear, without load-dependent friction."""
    joints = dict.fromkeys((*robot.elastic_joints, *used))
    return not under_load(robot, used) and not any(
        motor_regressor(robot, joint).non_linear for joint in joints
    )


@cache
def _joint_regressor(drive: Drive, joint: str) -> DriveRegressor:
    return drive_regressor(joint_equation(drive), drive, joint)


@cache
def _motor_regressor(drive: Drive, joint: str) -> DriveRegressor:
    return drive_regressor(motor_equation(drive), drive, joint)


@cache
def _spring_regressor(drive: Drive, joint: str) -> DriveRegressor:
    return drive_regressor(spring_equation(drive), drive, joint)


def signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return the signals {name: (T,)} of a drive's equations, with a load torque of zero.

    theta_L is the drive's coordinate phi = C q, or r_M/(N r_L) theta_M less the deflection if this
    was measured. Speeds that are nothing but rounding are set to zero, because their sign, and with
    it friction, would depend on the processor.
    """
    position, velocity, acceleration = (
        at_drives(robot.transmission, state)[:, index] for state in motion.joint_states
    )
    drive = robot.drives[robot.joint_names[index]]
    if drive.is_elastic and has_deflection(motion, index):
        assert motion.deflection is not None
        assert motion.deflection_rate is not None
        # r_L theta_L = r_M/N theta_M - d: what the spring sees, with the gear's wind-up
        lever = drive.motor_radius / (drive.ratio * drive.load_radius)
        position = lever * motion.motor_position[:, index] - motion.deflection[:, index]
        velocity = lever * motion.motor_velocity[:, index] - motion.deflection_rate[:, index]
    return {
        "theta_M": motion.motor_position[:, index],
        "theta_M_dot": _moving(motion.motor_velocity[:, index]),
        "theta_M_ddot": motion.motor_acceleration[:, index],
        "theta_L": position,
        "theta_L_dot": _moving(velocity),
        "theta_L_ddot": acceleration,
        "tau_M": motion.motor_torque[:, index],
        "tau_L": np.zeros(len(motion.time)),
        "i_M": _channel(motion.motor_current, motion, index),
        "u_M": _channel(motion.motor_voltage, motion, index),
        "tau_G": _channel(motion.gear_torque, motion, index),
        "Delta_T": _channel(motion.motor_temperature, motion, index)
        - drive.reference_temperature_degC,
    }


def has_deflection(motion: Motion, index: int) -> bool:
    """Whether the deflection of a joint's spring was measured by a sensor of its own."""
    return motion.deflection is not None and bool(np.isfinite(motion.deflection[0, index]))


def input_signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return `signals`, with joint torque / N where a stiff gear's motor torque was not logged."""
    found, drive = signals(robot, motion, index), robot.drives[robot.joint_names[index]]
    if np.all(np.isnan(found["tau_M"])) and drive.motor_input == "torque":
        found["tau_M"] = sensed_torque(robot, motion, index) / drive.ratio
    return found


def _moving(speed: Array) -> Array:
    return np.where(np.abs(speed) < _STILL, 0.0, speed)


def _channel(samples: Array | None, motion: Motion, index: int) -> Array:
    return np.full(len(motion.time), np.nan) if samples is None else samples[:, index]


def sensed_torque(robot: Robot, motion: Motion, index: int) -> Array:
    """Return the torque (T,) on a drive's coordinate by joint torque sensors, NaN without all."""
    return np.asarray(torques_at_drives(robot.transmission, motion.joint_torque)[:, index])
