"""replay: drive a model with the logged motor inputs, forward in time.

The strictest validation of a model: no measured position or acceleration enters after the start,
and errors accumulate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, SeaidError, checked
from seaid.log import Log, check_whole, spline_derivatives
from seaid.robot import Robot, at_drives
from seaid.simulation.controller import input_gain, position_controllers
from seaid.simulation.forward_dynamics import advance
from seaid.simulation.plant import JOINT_POSITION, JOINT_SPEED, POSITION, SPEED, plant_of, warmed

_LONGEST_STEP_S = 1e-3
_LONGEST_CLOSED_S = 5e-4
"""Longest steps without and with a controller, whose torque changes with the state."""

Command = Callable[[float, Array], Array]
"""Function of time [s] and joint positions (n,) that returns motor inputs (n,)."""


@checked(SeaidError)
def replay(robot: Robot, log: Log, command: Command | None = None) -> Log:
    """Simulate a robot from the first state of a log, with the motor inputs of the log.

    Parameters
    ----------
    robot : Robot
        The model, with values of all parameters.
    log : Log
        The log with the start and, without `command`, the inputs of all motors: torque, current or
        voltage, by each drive's `motor_input`. With a position command, the drive's controller
        closes the loop on the model's own position, with the delay of the command.
    command : callable, optional
        Function (time [s], joint positions (n,)) -> motor inputs (n,), for example a position
        servo with known gains; it is called with the model's own positions.

    Returns
    -------
    Log
        The model's motor and joint positions and motor torques at the log's times.

    Raises
    ------
    LogError
        If an input or the first state is missing in the log, or if the log has a hole in time.
    RobotError
        If the robot has no value for a parameter.

    Examples
    --------
    >>> replayed = seaid.replay(result.robot, log)
    >>> np.std(replayed.joint_position - log.joint_position, axis=0)
    """
    check_whole(log)
    plant, order = plant_of(robot), robot.joint_order
    controllers = position_controllers(robot, log) if command is None else None
    given = _logged(robot, log) if command is None else command
    gains = np.array([input_gain(robot, joint) for joint in robot.joint_names])
    data, back = plant.model.createData(), np.argsort(order)
    state = np.zeros((plant.rows, robot.n))
    state[: JOINT_SPEED + 1] = _start(robot, log)[:, order]
    shape = (len(log.time), robot.n)
    joint, motor, torques = np.empty(shape), np.empty(shape), np.empty(shape)

    warmth = _warmth(robot, log)

    def torque(at: float, now: Array) -> Array:
        logged = gains * given(at, now[JOINT_POSITION, back])
        if controllers is not None:
            logged = controllers.with_torque(logged, at, now[POSITION, back], now[SPEED, back])
        return logged[order]

    for tick, at in enumerate(log.time):
        joint[tick], motor[tick] = state[JOINT_POSITION, back], state[POSITION, back]
        torques[tick] = torque(at, state)[back]
        if tick + 1 == len(log.time):
            break
        own = warmed(plant, None if warmth is None else warmth[tick, order])
        longest = _LONGEST_STEP_S if controllers is None else _LONGEST_CLOSED_S
        steps = math.ceil((log.time[tick + 1] - at) / longest)
        step = (log.time[tick + 1] - at) / steps
        for part in range(steps):
            now = torque(at + part * step, state)
            rate = np.zeros(robot.n)
            if controllers is not None:
                moving = state[POSITION, back], state[SPEED, back]
                rate = controllers.rate(at + part * step, *moving, step)[order]
            state = advance(own, data, state, now, rate, step)
    return Log(
        time=log.time,
        joint_names=robot.joint_names,
        motor_position=motor,
        joint_position=joint,
        motor_torque=torques,
        is_prismatic=robot.is_prismatic,
    )


def _column(log: Log, field: str, joint: str) -> Array:
    """Return the samples (T,) of one sensor of one joint."""
    values: Any = getattr(log, field)
    known = joint in log.joint_names and values is not None
    column: Array = values[:, log.joint_names.index(joint)] if known else np.array([np.nan])
    if not np.all(np.isfinite(column)):
        raise LogError(f"replay: the log has no {field.replace('_', ' ')} of '{joint}'")
    return column


def _warmth(robot: Robot, log: Log) -> Array | None:
    """Return the temperatures (T, n) of motors whose friction depends on it; None without any."""
    warm = [joint for joint in robot.joint_names if robot.drives[joint].has_temperature_terms]
    found = np.zeros((len(log.time), robot.n))
    for joint in warm:
        found[:, robot.index(joint)] = _column(log, "motor_temperature", joint)
    return found if warm else None


def _first(log: Log, field: str, joint: str) -> tuple[float, float]:
    """Return the first position of a joint or motor, and its speed."""
    position = _column(log, field, joint)[:, None]
    return position[0, 0], spline_derivatives(log.time, position)[1][0, 0]


def _logged(robot: Robot, log: Log) -> Command:
    """Return the logged motor inputs as a function of time, interpolated linearly."""
    kinds = {joint: robot.drives[joint].motor_input for joint in robot.joint_names}
    inputs = [
        np.zeros(len(log.time))
        if kind == "position_command"
        else _column(log, f"motor_{kind}", joint)
        for joint, kind in kinds.items()
    ]

    def given(at: float, _: Array) -> Array:
        return np.array([np.interp(at, log.time, one) for one in inputs])

    return given


def _start(robot: Robot, log: Log) -> Array:
    """Return the first state (4, n) of a log; motors of stiff drives follow their joints."""
    state = np.zeros((4, robot.n))
    for index, joint in enumerate(robot.joint_names):
        state[[JOINT_POSITION, JOINT_SPEED], index] = _first(log, "joint_position", joint)
    position, speed = at_drives(robot.transmission, state[[JOINT_POSITION, JOINT_SPEED]])
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if drive.is_elastic:
            state[[POSITION, SPEED], index] = _first(log, "motor_position", joint)
        else:
            state[POSITION, index] = drive.ratio * position[index]
            state[SPEED, index] = drive.ratio * speed[index]
    return state
