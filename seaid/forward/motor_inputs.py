"""What a log has of motors that are driven by torque, current or voltage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array
from seaid.drivetrain.catalogue import key_of
from seaid.drivetrain.values import unit_of
from seaid.errors import RobotError
from seaid.robot import Robot


@dataclass(frozen=True, eq=False)
class MotorInputs:
    """Torque [N m], current [A] and voltage [V] (T, n), NaN where a motor is logged by another.

    Current and voltage are None where no motor is.
    """

    torque: Array
    current: Array | None
    voltage: Array | None


def motor_inputs(robot: Robot, torque: Array) -> MotorInputs:
    """Return what is logged of motors that give torques (T, n) [N m].

    Each is logged by its drive's input: current is torque over torque constant, voltage torque over
    voltage constant. Raises RobotError naming a joint whose constant has no value.
    """
    kinds = np.array([robot.drivetrains[joint].motor_input for joint in robot.joint_names])
    fed = torque / [input_gain(robot, joint) for joint in robot.joint_names]

    def logged(kind: str) -> Array:
        return np.where(kinds == kind, fed, np.nan)

    return MotorInputs(
        torque=logged("torque"),
        current=logged("current") if "current" in kinds else None,
        voltage=logged("voltage") if "voltage" in kinds else None,
    )


def input_gain(robot: Robot, joint: str) -> float:
    """Return the torque [N m] a unit of what the drive of a joint is fed with.

    Raises RobotError where its constant has no value, or is zero.
    """
    drive = robot.drivetrains[joint]
    if drive.motor_input == "torque":
        return 1.0
    name = {"current": "torque_constant", "voltage": "voltage_constant"}[drive.motor_input]
    value = drive.values.get(name, 0.0)
    if value == 0:
        raise RobotError(
            f"joint '{joint}': '{key_of(name, unit_of(drive, name))}' is not given, or zero; a "
            "simulation needs its value"
        )
    return value
