"""The motor torque of drives of which commands are logged: position, velocity, feed-forward torque.

The controller of the drive gives it, with the delay T of the commands and within its limits,
tau = (c(t - T) - K_p q - K_d q') / N with the commanded part c = K_p u + K_v w + F + f. The
estimate of T needs its slope, d tau / dT = -c' / N.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import COMMANDS, Controller, Drive
from seaid.errors import LogError
from seaid.log.channels import column_names, refusal
from seaid.log.filtering import low_pass, spline_derivatives
from seaid.robot import at_drives

if TYPE_CHECKING:
    from seaid.log.log import Log
    from seaid.robot import Robot


def is_commanded(drive: Drive) -> bool:
    """Return whether the torque of a drive is that of its controller for logged commands."""
    return drive.motor_input in COMMANDS


def with_commanded_torque(robot: Robot, log: Log) -> Log:
    """Return a log with the motor torque that the controllers of commanded drives give.

    The torque of all other drives is that of the log. Raises LogError naming a joint without
    commands, or without position.
    """
    if not robot.has_controllers:
        return log
    columns = [log.joint_names.index(joint) for joint in robot.joint_names]
    motor_torque, signals = log.motor_torque.copy(), log.sensors(robot.joint_names)
    motor_torque[:, columns] = commanded_torque(robot, log.time, signals)[0]
    return replace(log, motor_torque=motor_torque)


def commanded_torque(
    robot: Robot, time: Array, signals: dict[str, Array], cutoff_hz: float | None = None
) -> tuple[Array, Array]:
    """Return the motor torques (T, n) and -d tau / dT (T, n), zero for drives with another input.

    `signals` {sensor: samples (T, n)} are of the robot's joints. Both are those below `cutoff_hz`;
    the slope is zero where the torque is at its limit.
    """
    torque, slope = signals["motor_torque"].copy(), np.zeros_like(signals["motor_torque"])
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if not is_commanded(drive):
            continue
        commands = commanded_part(robot, time, signals, index)
        position = drive_position(robot, signals, index)
        velocity = spline_derivatives(time, position[:, None])[1][:, 0]
        law, rate_hz = drive.controller, (len(time) - 1) / (time[-1] - time[0])
        assert law is not None
        late = time - (drive.command_delay_s or 0.0)
        if law.is_held:  # a command that is held for a period is half a period late on average
            late = late - 0.5 / rate_hz
        # Before its first sample a command is taken for that sample; its spline must not
        # extrapolate.
        late = np.clip(late, time[0], time[-1])
        if cutoff_hz is None:
            command = np.interp(late, time, commands)
        else:
            command = _below_nyquist(time, commands, 24 if law.is_held else 12)(late)
        # The slope is a derivative, which needs the low pass; the torque gets its own below.
        smooth = command[:, None]
        if cutoff_hz is not None:
            smooth = low_pass(smooth, rate_hz, cutoff_hz)
        rate = spline_derivatives(time, smooth)[1][:, 0]
        supply = relative_supply(robot, time, signals, index)
        wanted_torque, is_limited = law.torque(command, position, velocity, supply)
        torque[:, index] = wanted_torque / drive.ratio
        if cutoff_hz is not None:  # that of the accelerations, also where rests are excluded
            torque[:, index] = low_pass(torque[:, index : index + 1], rate_hz, cutoff_hz)[:, 0]
        # -d tau / dT = c' / N; at the limit the torque does not depend on the command.
        slope[:, index] = np.where(is_limited, 0.0, law.gain_factor(supply) * rate / drive.ratio)
    return torque, slope


def commanded_part(
    robot: Robot, time: Array, signals: Mapping[str, Array], index: int, is_scaled: bool = False
) -> Array:
    """Return the torque (T,) at a joint that the commands alone give, c = K_p u + K_v w + F + f.

    In N m with `is_scaled`, otherwise in the units of the controller's gains. Without a column w is
    u', and f is zero. Raises LogError naming the column of a command that is missing.
    """
    joint = robot.joint_names[index]
    drive = robot.drives[joint]
    law = drive.law if is_scaled else drive.controller
    assert law is not None
    commands = _logged(signals, index, (*COMMANDS, "torque_command"))
    if drive.motor_input not in commands:
        raise _missing(robot, index, drive.motor_input)
    gains = {
        "position_command": law.position_gain_Nm_per_rad,
        "velocity_command": law.command_velocity_gain_Nms_per_rad,
        "torque_command": drive.scale_of_gains if is_scaled else 1.0,
    }
    if gains["velocity_command"] and "velocity_command" not in commands:
        rates = spline_derivatives(time, commands["position_command"][:, None])[1]
        commands["velocity_command"] = rates[:, 0]
    torque = np.full(len(time), law.feedforward_Nm)
    for kind, gain in gains.items():
        if gain and kind in commands:
            torque += gain * commands[kind]
    return torque


def _logged(signals: Mapping[str, Array], index: int, kinds: Sequence[str]) -> dict[str, Array]:
    """Return {kind: samples (T,)} of those kinds of a joint's signals that are logged."""
    of_joint = {kind: signals[kind][:, index] for kind in kinds if kind in signals}
    return {kind: values for kind, values in of_joint.items() if not np.isnan(values[0])}


def relative_supply(robot: Robot, time: Array, signals: Mapping[str, Array], index: int) -> Array:
    """Return the supply voltage (T,) of a drive over its nominal one, 1 if that is not given.

    Raises LogError if the log does not have the voltage, or has one that is not positive.
    """
    law = robot.drives[robot.joint_names[index]].controller
    if law is None or law.nominal_supply_V is None:
        return np.ones(len(time))
    supply = signals.get("supply_voltage")
    if supply is None or np.isnan(supply[0, index]):
        raise _missing(robot, index, "supply_voltage")
    if np.min(supply[:, index]) <= 0:
        row = int(np.argmin(supply[:, index]))
        joint, voltage = robot.joint_names[index], supply[row, index]
        raise refusal("no_supply", joint=joint, supply=voltage, time=time[row])
    return np.asarray(supply[:, index] / law.nominal_supply_V)


def _missing(robot: Robot, index: int, field: str) -> LogError:
    """Return the error of a log without a column that the controller of a drive needs."""
    joint = robot.joint_names[index]
    key = "nominal_supply_V" if field == "supply_voltage" else f'motor_input = "{field}"'
    column = column_names(joint, robot.is_prismatic[index])[field]
    return refusal("no_command", joint=joint, key=key, column=column)


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
    spline: Callable[[Array], Array] = make_interp_spline(time, smooth, k=3)
    return spline


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


@dataclass(frozen=True, eq=False)
class Commanded:
    """A joint with a controller in a log.

    `command` and `position` (T,) are those at the joint; the position is that of the encoder which
    the controller sees, of the motor if it was logged. `asked` (T,) is the torque at the joint that
    the controller would give without its limit.
    """

    robot: Robot
    log: Log
    joint: str
    law: Controller
    command: Array
    position: Array
    asked: Array

    @property
    def units(self) -> tuple[str, str]:
        """The units of torque, or of the force of a sliding joint, and position."""
        return self.robot.drives[self.joint].joint_units


def commanded_joints(robot: Robot, log: Log) -> Iterator[Commanded]:
    """Yield the joints of a log with position commands that have a controller and an encoder."""
    assert log.position_command is not None
    unlimited = {
        joint: replace(drive, controller=replace(drive.controller, torque_limit_Nm=math.inf))
        for joint, drive in robot.drives.items()
        if drive.controller is not None
    }
    # the motor torque (T, n) that the controllers would give without a limit
    asked = with_commanded_torque(robot.with_drives(unlimited), log).motor_torque
    for joint, drive in robot.drives.items():
        j, law = log.joint_names.index(joint), drive.controller
        signals = log.position_command[:, j], controlled_position(log, j, drive.ratio)
        if law is not None and not any(np.isnan(signal[0]) for signal in signals):
            yield Commanded(robot, log, joint, law, *signals, drive.ratio * asked[:, j])


def controlled_position(log: Log, j: int, ratio: float) -> Array:
    """Return the position (T,) at joint j that its controller sees, NaN without either encoder."""
    motor = log.motor_position[:, j] / ratio
    return log.joint_position[:, j] if np.isnan(motor[0]) else motor
