"""The residual block of drives that follow logged position commands: output error of the loop.

The model follows the commands under its own controllers, from the first state of each log, and the
measured joint positions are compared with its own. A rollout is that of `replay`, in which dry
friction sticks; its sensitivities are those of the load side (8), linearised along it, with the
gains of the controllers as stiffness and damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.drives import PARAMETERS, buses_of, is_stated
from seaid.errors import IdentificationError
from seaid.estimation import Parameter, Point, Prior, Residuals, bounds_of
from seaid.identification.drive_estimates import with_estimate
from seaid.identification.simulated_joints import (
    response_to,
    torque_jacobians,
    with_base_parameters,
)
from seaid.identification.two_step import split_load_side
from seaid.log import (
    OF_CONTROLLERS,
    Log,
    Motion,
    commanded_part,
    reconstruct_motion,
    relative_supply,
    spline_derivatives,
    stretches,
    usable,
)
from seaid.regressor import load_columns
from seaid.robot import Robot
from seaid.simulation import rollout

if TYPE_CHECKING:
    from seaid.identification.identification import Identification

STEP_S = 2.5e-3
"""Longest step [s] of a rollout: a hundredth of the period of a loop of 4 Hz; the error of the last
digits is far below that of a model."""

_BLOCK_S = 0.02
"""Length [s] of the averages that are compared: 25 Hz is above the bandwidth of these loops."""

_WINDOW_S = 20.0
"""Longest part of a log [s] in one rollout, whose sensitivities are in memory."""

_TRANSIENT_S, _DECAYS = 0.2, 4.0
"""Excluded start of a rollout, whose first speed is noisy: 0.2 s and four times K_d / K_p."""

_REST, _HOLD = 2e-3, 50.0
"""Part of the highest speed below which a joint counts as sticking, and the damping of its
sensitivity: this times the inertia over the step."""

_NUDGE = 1e-4


@dataclass(frozen=True, eq=False)
class Commands:
    """The parameters (f,) of a refinement; drives on one bus share that of their delay.

    `spread` (p, f) @ x are the values of the load side.
    """

    identification: Identification
    parameters: tuple[Parameter, ...]
    spread: Array

    @property
    def start(self) -> Array:
        """The values (f,) of the identification within their bounds.

        A regression may find positive parameters below zero.
        """
        first = np.argmax(self.spread, axis=0)
        values = self.identification.load_side.values[first]
        return np.asarray(np.clip(values, *bounds_of(self.parameters)))


@dataclass(frozen=True, eq=False)
class CommandedLog:
    """The residual block of a window of a log, which its commands drive at parameters x (f,).

    `log` is on regular samples, and its rollouts replace the joints of `motion`.
    """

    commands: Commands
    log: Log
    motion: Motion
    x: Array

    @cached_property
    def residuals(self) -> Residuals:
        """The residuals of the joint positions."""
        return _residuals(self.commands, self.log, self.motion, self.x)

    def moved(self, x: Array, part: float, nuisance: Array) -> CommandedLog:
        """Return the block at parameters x (f,)."""
        return replace(self, x=x)


def commanded_point(start: Identification, logs: Sequence[Log]) -> Point[CommandedLog]:
    """Return the point of a search at the values of an identification."""
    commands = _commands(start)
    windows = []
    for log in logs:
        for stretch in stretches(usable(log), 1.0):
            count = max(1, int(np.ceil((stretch.time[-1] - stretch.time[0]) / _WINDOW_S)))
            edges = np.linspace(stretch.time[0], stretch.time[-1], count + 1)
            windows += [_window(start, stretch.between(a, b)) for a, b in pairwise(edges)]
    x = commands.start
    blocks = tuple(CommandedLog(commands, log, motion, x) for log, motion in windows)
    return Point(commands.parameters, x, blocks)


def _commands(start: Identification) -> Commands:
    """Return the parameters of an identification; a delay that is as stated stays so."""
    side = start.load_side
    parameters = [_parameter(name) for name in side.names]
    spread = np.eye(len(parameters))
    shared: list[int] = []
    for bus in buses_of(start.known.drives, side.names):
        first, *others = bus.places
        spread[others, first] = 1.0
        shared += others
        if is_stated(side.standard_errors[first], bus.std_s):
            prior = Prior(bus.nominal_s, bus.std_s) if bus.std_s else None
            parameters[first] = replace(parameters[first], prior=prior, is_fixed=True)
    kept = [place for place in range(len(parameters)) if place not in shared]
    return Commands(start, tuple(parameters[place] for place in kept), spread[:, kept])


def _parameter(column: str) -> Parameter:
    """Return the parameter of a column of the load side, with its bound."""
    parameter = Parameter.of_column(column)
    kind = PARAMETERS.get(parameter.quantity)
    is_positive = kind is not None and kind.is_positive
    return replace(parameter, lower=0.0) if is_positive else parameter


def _window(identification: Identification, log: Log) -> tuple[Log, Motion]:
    """Return a window on regular samples, with the motion that its rollouts replace."""
    robot = identification.known
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    motion = reconstruct_motion(robot, log, min(3 * identification.cutoff_hz, rate_hz / 8))
    columns = [log.joint_names.index(joint) for joint in robot.joint_names]

    def sampled(values: Array) -> Array:
        signals = [np.interp(motion.time, log.time, values[:, column]) for column in columns]
        return np.column_stack(signals)

    unknown = np.full((len(motion.time), robot.n), np.nan)
    regular = Log(
        time=motion.time,
        joint_names=robot.joint_names,
        joint_position=sampled(log.joint_position),
        motor_position=unknown,
        motor_torque=unknown,
        is_prismatic=robot.is_prismatic,
    )
    sensors = log.sensors()
    sent: dict[str, Any] = {x: sampled(sensors[x]) for x in OF_CONTROLLERS if x in sensors}
    return replace(regular, **sent), motion


def _robot_at(start: Identification, load_side: Array) -> Robot:
    """Return the robot with the values (p,) of the load side."""
    _, sides = split_load_side(start.model, replace(start.load_side, values=load_side))
    robot = with_base_parameters(start, load_side)
    drives = {joint: with_estimate(robot.drives[joint], side) for joint, side in sides.items()}
    return robot.with_drives(drives)


def _residuals(commands: Commands, log: Log, motion: Motion, x: Array) -> Residuals:
    """Return the residuals of a window."""
    load_side = commands.spread @ x
    robot = _robot_at(commands.identification, load_side)
    moved = rollout(robot, log, longest_closed_s=STEP_S)
    if not np.all(np.isfinite(moved.joint_position)):
        raise IdentificationError("the simulation diverges")
    motion = _moved(robot, motion, moved)
    sensitivity = _sensitivity(commands.identification, robot, motion, log, load_side)
    error = (log.joint_position - moved.joint_position)[..., None]
    # The residual is measured less simulated: its derivatives are minus the sensitivities.
    columns = np.concatenate([error, -sensitivity @ commands.spread], axis=2)
    block = max(1, round(_BLOCK_S * (len(log.time) - 1) / float(np.ptp(log.time))))
    count = len(log.time) // block
    means = columns[: count * block].reshape(count, block, *columns.shape[1:]).mean(axis=1)
    time = log.time[: count * block].reshape(count, block).mean(axis=1)
    late = time - log.time[0] > min(_transient_s(robot), 0.25 * np.ptp(log.time))
    if motion.bridged is not None:  # what was interpolated over a gap was not measured
        late &= ~np.any(motion.bridged[: count * block].reshape(count, block), axis=1)
    return Residuals(
        residual=means[None, ..., 0],
        jacobian=means[None, ..., 1:],
        nuisance=np.zeros((1, count, robot.n, 0)),
        kept=np.broadcast_to(late[None, :, None], (1, count, robot.n)).copy(),
        time=time[None],
        channels=range(robot.n),
    )


def _transient_s(robot: Robot) -> float:
    """Return the excluded start of a rollout [s]."""
    laws = [drive.law for drive in robot.drives.values() if drive.law is not None]
    decays = [
        law.velocity_gain_Nms_per_rad / law.position_gain_Nm_per_rad
        for law in laws
        if law.position_gain_Nm_per_rad
    ]
    return _TRANSIENT_S + _DECAYS * max(decays, default=0.0)


def _moved(robot: Robot, motion: Motion, moved: Log) -> Motion:
    """Return the motion of a rollout."""
    q, v, a = spline_derivatives(moved.time, moved.joint_position)
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    return replace(
        motion,
        joint_position=q,
        joint_velocity=v,
        joint_acceleration=a,
        motor_position=ratio * q,
        motor_velocity=ratio * v,
        motor_acceleration=ratio * a,
        motor_direction=None,
        motor_torque=moved.motor_torque
        / [robot.drives[x].scale_of_gains for x in robot.joint_names],
    )


def _sensitivity(
    identification: Identification, robot: Robot, motion: Motion, log: Log, x: Array
) -> Array:
    """Return the derivative (T, n, p) of the positions of a rollout by the load side x (p,)."""
    names, p = identification.model.torque_joints, len(identification.base.columns)
    order = [robot.index(joint) for joint in names]
    _, _, H, _ = load_columns(identification.known, motion, identification.model, {})

    def of_drives(moved: Motion) -> Array:
        torque, _, columns, _ = load_columns(identification.known, moved, identification.model, {})
        return torque - columns[:, :, p:] @ x[p:]

    unchanged = of_drives(motion)
    slopes = []
    for field in ("position", "velocity", "acceleration"):
        moves = {f"joint_{field}": 1.0, f"motor_{field}": 0.0}
        ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
        changes = {
            name: getattr(motion, name) + _NUDGE * (1.0 if is_joint else ratio)
            for name, is_joint in moves.items()
        }
        # Torques of drives depend on their own joint: one nudge of all gives the diagonal slopes.
        slopes.append((unchanged - of_drives(replace(motion, **changes))) / _NUDGE)
    jacobians = torque_jacobians(robot, *motion.joint_states).part(order, order)
    gains = _gains(robot, names, motion, log)
    diagonal = np.eye(len(order))
    M = jacobians.acceleration + slopes[2][..., None] * diagonal
    fastest = np.max(np.abs(motion.joint_velocity[:, order]), axis=0)
    rests = np.abs(motion.joint_velocity[:, order]) < _REST * fastest
    inertia = np.einsum("tii->ti", M)
    # A joint that sticks does not respond: no force on it, and a damping of `_HOLD` times the
    # inertia over the step, which stops it within a sample.
    held = np.where(rests, _HOLD * inertia * motion.rate_hz, slopes[1] * ~rests)
    C = jacobians.velocity + (held + gains[1])[..., None] * diagonal
    K = jacobians.position + (slopes[0] + gains[0])[..., None] * diagonal
    inside = replace(jacobians, position=K, velocity=C, acceleration=M)
    # M dq'' + C dq' + K dq = -H dx: the torque that a parameter takes is not there for the motion.
    force = np.where(rests[..., None], 0.0, -H)
    response = response_to(inside, force, 1 / motion.rate_hz, 1).position[:, :, : H.shape[2]]
    whole = np.zeros((len(response), robot.n, H.shape[2]))
    whole[:, order] = response
    return whole


def _gains(robot: Robot, names: Sequence[str], motion: Motion, log: Log) -> tuple[Array, Array]:
    """Return K_p and K_d (T, n) of the controllers, zero where the torque is at its limit."""
    gains = np.zeros((2, len(motion.time), len(names)))
    for column, joint in enumerate(names):
        drive, index = robot.drives[joint], robot.index(joint)
        law = drive.law
        assert law is not None
        late = motion.time - (drive.command_delay_s or 0.0)
        commanded = commanded_part(robot, log.time, log.sensors(), index, is_scaled=True)
        states = motion.joint_position[:, index], motion.joint_velocity[:, index]
        supply = relative_supply(robot, log.time, log.sensors(), index)
        is_free = ~law.torque(np.interp(late, log.time, commanded), *states, supply)[1]
        factor = law.gain_factor(supply) * is_free
        gains[0, :, column] = law.position_gain_Nm_per_rad * factor
        gains[1, :, column] = law.velocity_gain_Nms_per_rad * factor
    return gains[0], gains[1]
