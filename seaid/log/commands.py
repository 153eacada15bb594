"""The motor torque of drives of which only the commanded position is logged.

The controller of the drive gives it, with the delay T of the command and within its limits,
tau = (K_p (u(t - T) - q) + K_v u'(t - T) - K_d q' + F) / N. The estimate of T needs its slope,
d tau / dT = -(K_p u' + K_v u'') / N.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import Drive
from seaid.errors import LogError
from seaid.log.filtering import low_pass, spline_derivatives
from seaid.robot import at_drives

if TYPE_CHECKING:
    from seaid.log.log import Log
    from seaid.robot import Robot


def is_commanded(drive: Drive) -> bool:
    """Return whether only the commanded position of a drive is logged."""
    return drive.motor_input == "position_command"


def with_commanded_torque(robot: Robot, log: Log) -> Log:
    """Return a log with the motor torque that the controllers of commanded drives give.

    The torque of all other drives is that of the log. Raises LogError naming a joint without
    commands, or without position.
    """
    if not any(is_commanded(robot.drives[joint]) for joint in robot.joint_names):
        return log
    columns = [log.joint_names.index(joint) for joint in robot.joint_names]
    given = {field: values[:, columns] for field, values in log.sensors().items()}
    motor_torque = log.motor_torque.copy()
    motor_torque[:, columns] = commanded_torque(robot, log.time, given)[0]
    return replace(log, motor_torque=motor_torque)


def commanded_torque(
    robot: Robot, time: Array, signals: dict[str, Array], cutoff_hz: float | None = None
) -> tuple[Array, Array]:
    """Return the motor torques (T, n) and -d tau / dT (T, n), zero for drives with another input.

    `signals` {sensor: samples (T, n)} are of the robot's joints. The slope is that of commands
    below `cutoff_hz`; it is zero where the torque is at its limit.
    """
    torque, slope = signals["motor_torque"].copy(), np.zeros_like(signals["motor_torque"])
    commands = signals.get("position_command")
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if not is_commanded(drive):
            continue
        if commands is None or np.isnan(commands[0, index]):
            unit = "m" if robot.is_prismatic[index] else "rad"
            raise LogError(
                f"the drive of '{joint}' has motor_input = \"position_command\", and the log has "
                f"no column '{joint}.position_command_{unit}'"
            )
        position = drive_position(robot, signals, index)
        velocity = spline_derivatives(time, position[:, None])[1][:, 0]
        law, rate_hz = drive.controller, (len(time) - 1) / (time[-1] - time[0])
        assert law is not None
        late = time - (drive.command_delay_s or 0.0)
        if law.is_held:  # a command that is held for a period is half a period late on average
            late = late - 0.5 / rate_hz
        late = np.clip(late, time[0], time[-1])
        if cutoff_hz is None:
            command = np.interp(late, time, commands[:, index])
        else:
            command = _below_nyquist(time, commands[:, index], 24 if law.is_held else 12)(late)
        smooth = command[:, None]
        if cutoff_hz is not None:
            smooth = low_pass(smooth, rate_hz, cutoff_hz)
        _, rate, change = (one[:, 0] for one in spline_derivatives(time, smooth))
        wanted_torque, is_limited = law.torque(command, position, velocity, rate)
        torque[:, index] = wanted_torque / drive.ratio
        own = law.position_gain_Nm_per_rad * rate + law.command_velocity_gain_Nms_per_rad * change
        slope[:, index] = np.where(is_limited, 0.0, own / drive.ratio)
    return torque, slope


def _below_nyquist(time: Array, command: Array, part: int) -> Callable[[Array], Array]:
    """Return the command between its samples, without what is above half of their rate.

    Drives, and `replay`, go from sample to sample on straight lines. Their frequency response is
    sinc(f dt)^2 = 1 - (pi f dt)^2 / 3 + ..., and that of a twelfth of the second difference
    -(pi f dt)^2 / 3 + .... Samples of the lines themselves have 1 at samples and cos(pi f dt)
    between two, which biased friction by 0.4 % one way or the other, as the delay fell. That of
    held commands is the root of it, but for the delay, so that their `part` is 1/24.
    """
    from scipy.interpolate import make_interp_spline

    smooth = command.copy()
    smooth[1:-1] += np.diff(command, 2) / part
    found: Callable[[Array], Array] = make_interp_spline(time, smooth, k=3)
    return found


def drive_position(robot: Robot, signals: dict[str, Array], index: int) -> Array:
    """Return theta_M / N (T,) of a drive by its encoder, or by those of the joints if it is stiff.

    Raises LogError without either.
    """
    joint = robot.joint_names[index]
    drive = robot.drives[joint]
    motor = signals["motor_position"][:, index]
    if not np.isnan(motor[0]):
        return np.asarray(motor / drive.ratio)
    position = np.asarray(at_drives(robot.transmission, signals["joint_position"])[:, index])
    if drive.is_elastic or np.isnan(position[0]):
        side = "motor" if drive.is_elastic else "joint"
        raise LogError(f"the commanded drive of '{joint}' has no {side} position in the log")
    return position
