"""replay: what a model does in the place of a robot whose log is there, forward in time.

The strictest question to a model: no measured torque or acceleration enters, errors add up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.drives import SeriesElasticDrive
from seaid.errors import LogError, RobotError
from seaid.log import Log, check_whole, spline_derivatives
from seaid.robot import Robot, at_drives
from seaid.simulation.forward_dynamics import advance
from seaid.simulation.plant import JOINT_POSITION, JOINT_SPEED, POSITION, SPEED, plant_of

_LONGEST_STEP_S = 1e-3

_INPUTS = {
    "torque": ("motor_torque", None),
    "current": ("motor_current", "torque_constant"),
    "voltage": ("motor_voltage", "voltage_constant"),
}
"""{motor input: (field of the log, parameter that makes a torque of it)}."""

Command = Callable[[float, Array], Array]
"""Time [s] and joint positions (n,) -> motor inputs (n,): torque, current or voltage."""


def replay(robot: Robot, log: Log, command: Command | None = None) -> Log:
    """Return what the robot does from the first state of a log on, sampled at the log's times.

    Its motors get the inputs that were logged (torque, current or voltage, as the drives say),
    or those of `command`, as a position servo whose gains are known: then the model's own position
    is fed back. Joint position and motor position are the model's, motor torque what its motors
    give. Raises LogError where an input or the first state is not in the log or the log has a
    hole in time, RobotError where the robot has no value for a parameter.
    """
    check_whole(log)
    plant, order = plant_of(robot), list(robot.model_order)
    given = _logged(robot, log) if command is None else command
    comparisons = np.array([_gain(robot, joint) for joint in robot.joint_names])
    data, state, back = plant.model.createData(), _start(robot, log)[:, order], np.argsort(order)
    shape = (len(log.time), robot.n)
    joint, motor, torques = np.empty(shape), np.empty(shape), np.empty(shape)

    def torque(at: float, now: Array) -> Array:
        return (comparisons * given(at, now[JOINT_POSITION, back]))[order]

    for tick, at in enumerate(log.time):
        joint[tick], motor[tick] = state[JOINT_POSITION, back], state[POSITION, back]
        torques[tick] = torque(at, state)[back]
        if tick + 1 == len(log.time):
            break
        steps = math.ceil((log.time[tick + 1] - at) / _LONGEST_STEP_S)
        step = (log.time[tick + 1] - at) / steps
        for part in range(steps):
            now = torque(at + part * step, state)
            state = advance(plant, data, state, now, np.zeros(robot.n), step)
    return Log(
        time=log.time,
        joint_names=robot.joint_names,
        motor_position=motor,
        joint_position=joint,
        motor_torque=torques,
        is_prismatic=robot.is_prismatic,
    )


def _gain(robot: Robot, joint: str) -> float:
    """Return the torque [N m] a unit of what the drive of a joint is fed with."""
    drive = robot.drives[joint]
    parameter = _INPUTS[drive.motor_input][1]
    if parameter is None:
        return 1.0
    if parameter not in drive.values:
        raise RobotError(f"joint '{joint}': '{parameter}' is not given; a replay needs its value")
    return drive.values[parameter]


def _column(robot: Robot, log: Log, field: str, joint: str) -> Array:
    """Return the samples (T,) of one sensor of one joint."""
    values: Any = getattr(log, field)
    if joint not in log.joint_names or values is None:
        raise LogError(f"replay: the log has no {field.replace('_', ' ')} of '{joint}'")
    column: Array = values[:, log.joint_names.index(joint)]
    if not np.all(np.isfinite(column)):
        raise LogError(f"replay: the log has no {field.replace('_', ' ')} of '{joint}'")
    return column


def _logged(robot: Robot, log: Log) -> Command:
    fields = {joint: _INPUTS[robot.drives[joint].motor_input][0] for joint in robot.joint_names}
    inputs = [_column(robot, log, field, joint) for joint, field in fields.items()]

    def given(at: float, _: Array) -> Array:
        return np.array([np.interp(at, log.time, one) for one in inputs])

    return given


def _start(robot: Robot, log: Log) -> Array:
    """Return the first state (4, n) of a log; motors of stiff drives turn with their joints."""
    state = np.zeros((4, robot.n))
    for index, joint in enumerate(robot.joint_names):
        position = _column(robot, log, "joint_position", joint)[:, None]
        state[JOINT_POSITION, index] = position[0, 0]
        state[JOINT_SPEED, index] = spline_derivatives(log.time, position)[1][0, 0]
    position, speed = at_drives(robot.transmission, state[[JOINT_POSITION, JOINT_SPEED]])
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if isinstance(drive, SeriesElasticDrive):
            turned = _column(robot, log, "motor_position", joint)[:, None]
            state[POSITION, index] = turned[0, 0]
            state[SPEED, index] = spline_derivatives(log.time, turned)[1][0, 0]
        else:
            state[POSITION, index] = drive.ratio * position[index]
            state[SPEED, index] = drive.ratio * speed[index]
    return state
