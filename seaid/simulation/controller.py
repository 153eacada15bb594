"""A joint controller for simulated experiments: feedforward of the plan, feedback on the motor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from seaid._arrays import Array
from seaid.drives import COMMANDS, DEAD_ZONES, Controller, unit_of
from seaid.drives.functions import spring_inverse
from seaid.drives.terms import key_of
from seaid.errors import RobotError
from seaid.log import Log
from seaid.log.commands import commanded_part, relative_supply
from seaid.robot import Robot
from seaid.simulation.plant import Plant, effective_inertia, inverse_dynamics


def motor_inputs(robot: Robot, torque: Array) -> tuple[Array, Array | None, Array | None]:
    """Return the logged torque [N m], current [A] and voltage [V] (T, n) of motors by their torque.

    Each motor is logged by its drive's `motor_input`, and NaN in the others: torque, torque /
    torque constant, or torque / voltage constant. Current and voltage are None if no motor is
    logged by them. Raises RobotError naming a joint whose constant has no value.
    """
    kinds = np.array([robot.drives[joint].motor_input for joint in robot.joint_names])
    fed = torque / [input_gain(robot, joint) for joint in robot.joint_names]
    logged = {kind: np.where(kinds == kind, fed, np.nan) for kind in {"torque", *kinds.tolist()}}
    return logged["torque"], logged.get("current"), logged.get("voltage")


def input_gain(robot: Robot, joint: str) -> float:
    """Return the motor torque [N m] per unit of the drive's motor input, or raise RobotError."""
    drive = robot.drives[joint]
    if drive.motor_input in ("torque", *COMMANDS):
        return 1.0
    name = {"current": "torque_constant", "voltage": "voltage_constant"}[drive.motor_input]
    value = drive.values.get(name, 0.0)
    if value == 0:
        raise RobotError(
            f"joint '{joint}': '{key_of(name, unit_of(drive, name))}' is not given, or zero; a "
            "simulation needs its value"
        )
    return value


_LEAST_BANDWIDTH_RAD_S = 60.0
"""Least bandwidth of a position controller [rad/s], also behind a stiff gear."""

_DAMPING = 0.7
"""Damping ratio of the loop of a motor with its controller: near 1 / sqrt(2), with which its
response has no resonance."""

_PASSAGE_S = 0.01
"""Smoothing of steps in the planned motor motion: dead zones, reversals of dry joint friction."""

_SLOW = 0.02
"""Below this part of the highest speed the feedforward of Coulomb friction fades."""


@dataclass(frozen=True, eq=False)
class JointController:
    """Motor references and feedforward torque (T, n) per tick, and feedback gains (n,)."""

    motor_position: Array
    motor_velocity: Array
    feedforward: Array
    position_gain: Array
    velocity_gain: Array
    velocity_filter: Array

    def torque(self, tick: int, position: Array, velocity: Array) -> Array:
        """Return the motor torque [N m] for a measured motor angle and speed."""
        return np.asarray(
            self.feedforward[tick]
            + self.position_gain * (self.motor_position[tick] - position)
            + self.velocity_gain * (self.motor_velocity[tick] - velocity)
        )


def joint_controller(plant: Plant, q: Array, v: Array, a: Array, rate_hz: float) -> JointController:
    """Design the controller for a sampled motion (T, n): (8) gives theta_M, (7) tau_M."""
    planned, load = q, _drive_torques(plant, q, v, a, rate_hz)
    if plant.coupling is not None:
        # q and v are those of the drives from here on, phi = C q; `planned` is for the mass matrix
        q, v = q @ plant.coupling.T, v @ plant.coupling.T
    N, r_M, r_L = plant.ratio, plant.motor_radius, plant.load_radius
    # (4b): deflection = tau_L / (r_L k); drives in `functions` have k = 0 here and follow below
    stretch = np.where(
        plant.elastic, load / (np.where(plant.stiffness > 0, plant.stiffness, 1) * r_L), 0
    )
    stiffness = plant.stiffness.copy()
    for index, _ in plant.functions:
        if plant.elastic[index]:
            force = load[:, index] / r_L[index]
            stretch[:, index], stiffness[index] = _nonlinear_stretch(plant, index, force, rate_hz)
    # (3): r_M theta_M / N = r_L q + deflection
    motor_position = np.where(plant.elastic, N / r_M * (r_L * q + stretch), N * q)
    motor_velocity = np.gradient(motor_position, 1 / rate_hz, axis=0)
    motor_acceleration = np.gradient(motor_velocity, 1 / rate_hz, axis=0)
    slow = _SLOW * np.maximum(np.max(np.abs(motor_velocity), axis=0), 1e-300)
    friction = plant.viscous * motor_velocity + plant.coulomb * np.tanh(motor_velocity / slow)
    for index, drive in plant.functions:
        direction = np.tanh(motor_velocity[:, index] / slow[index])
        # the arguments of `DriveFunctions`: theta_M and its rate, theta_L and its rate, torque on
        # the load, and the state of presliding, which is the direction after a long travel
        state = (motor_position, motor_velocity, q, v, load)
        states = np.column_stack([*(values[:, index] for values in state), direction])
        friction[:, index] = [drive.friction(*state) for state in states.tolist()]
        friction[:, index] += direction * [drive.level(*state) for state in states.tolist()]
    # (7): tau_M = I_M theta_M'' + friction + (r_M / N) F_s with F_s = tau_L / r_L
    elastic = plant.motor_inertia * motor_acceleration + r_M / N * load / r_L
    feedforward = friction + np.where(plant.elastic, elastic, load / N)
    # what the motor feels: its rotor alone on a spring, rotor and links behind a stiff gear
    inertia = np.where(plant.elastic, plant.motor_inertia, _least_inertia(plant, planned) / N**2)
    # of the rotor on its spring, sqrt(k (r_M / N)^2 / I_M) [rad/s]
    resonance = np.sqrt(stiffness / np.maximum(plant.motor_inertia, 1e-300)) * r_M / N
    # twice the resonance: the position gain is four times the stiffness of the spring at the motor
    bandwidth = np.where(plant.elastic, 2 * resonance, 0.0)
    # at most 0.2 rad per tick, because the loop is closed only once per tick
    bandwidth = np.clip(bandwidth, _LEAST_BANDWIDTH_RAD_S, 0.2 * rate_hz)
    return JointController(
        motor_position=motor_position,
        motor_velocity=motor_velocity,
        feedforward=feedforward,
        # s^2 + 2 d w s + w^2 for an inertia, with the bandwidth w and the damping d
        position_gain=inertia * bandwidth**2,
        velocity_gain=2 * _DAMPING * inertia * bandwidth,
        # first-order low pass at five times the bandwidth, against the steps of the encoders
        velocity_filter=1 - np.exp(-5 * bandwidth / rate_hz),
    )


def _drive_torques(plant: Plant, q: Array, v: Array, a: Array, rate_hz: float) -> Array:
    """Return the torques (T, n) on the drives' coordinates, with the rotors of stiff drives.

    Steps of dry joint friction are smoothed over `_PASSAGE_S`, because a spring cannot follow them.
    """
    data = plant.model.createData()
    load = np.array([inverse_dynamics(plant, data, states) for states in zip(q, v, a, strict=True)])
    for index, drive in plant.functions:
        pairs = zip(q[:, index].tolist(), v[:, index].tolist(), strict=True)
        load[:, index] += [drive.joint_torque(*pair) for pair in pairs]
        # the standard deviation of the Gaussian is in ticks
        direction = scipy.ndimage.gaussian_filter1d(
            np.sign(v[:, index]), _PASSAGE_S * rate_hz, mode="nearest"
        )
        load[:, index] += drive.joint_level * direction
    if plant.rotors is not None:
        load = load + a @ plant.rotors
    # tau_phi = C^-T tau, for rows of torques
    return load if plant.uncoupling is None else np.asarray(load @ plant.uncoupling)


def _nonlinear_stretch(
    plant: Plant, index: int, force: Array, rate_hz: float
) -> tuple[Array, float]:
    """Return the deflection (T,), smooth across a dead zone, and the median stiffness."""
    drive = plant.drives[index]
    stretch, by_force = spring_inverse(drive).stretch(force)
    if drive.is_nonlinear_spring:
        stretch = stretch + drive.values.get("deflection_zero", 0.0)
    if {*DEAD_ZONES} & {*drive.spring}:
        stretch = scipy.ndimage.gaussian_filter1d(stretch, _PASSAGE_S * rate_hz, mode="nearest")
    return stretch, float(1 / np.median(by_force))


def _least_inertia(plant: Plant, q: Array) -> Array:
    """Return the least effective inertia (n,) at each drive along a motion, the others free.

    Gains for the diagonal of the mass matrix would be too high for strongly coupled joints.
    """
    some = q[:: max(1, len(q) // 50)]
    return np.asarray(np.min([effective_inertia(plant, position) for position in some], axis=0))


@dataclass(frozen=True, eq=False)
class CommandedSteps:
    """What commands give in steps (S): parts of torques [N m] at both ends, and supplies (S, m)."""

    length_s: Array
    first: Array
    last: Array
    supply: Array


@dataclass(frozen=True, eq=False)
class PositionControllers:
    """The controllers of drives that follow logged commands, in a simulation.

    `index` (m,) are their places among the joints; `commanded` (T, m) are the parts of their
    torques [N m] that the commands at `time` give, and `supply` (T, m) the voltages of the supplies
    over their nominal ones.
    """

    index: Array
    time: Array
    commanded: Array
    supply: Array
    delay_s: Array
    ratio: Array
    position_gain: Array
    velocity_gain: Array
    laws: Sequence[Controller]

    @cached_property
    def limited(self) -> tuple[int, ...]:
        """The places of the laws whose torque has a limit, or depends on the supply."""
        return tuple(
            place
            for place, law in enumerate(self.laws)
            if np.isfinite(law.torque_limit_Nm) or law.is_duty
        )

    def during(self, start: Array, length_s: Array) -> CommandedSteps:
        """Return what the commands give in steps that begin at `start` (S,) [s].

        A held command counts with its mean over each step, so that it is as late as it is.
        """
        first, last = (np.empty((len(start), len(self.index))) for _ in range(2))
        supply = np.ones_like(first)
        for place, (law, delay) in enumerate(zip(self.laws, self.delay_s, strict=True)):
            # the command that acts now was logged one delay ago
            at, commanded = start - delay, self.commanded[:, place]
            if law.is_held:
                first[:, place] = last[:, place] = self._held(commanded, at, length_s)
            else:
                first[:, place] = np.interp(at, self.time, commanded)
                last[:, place] = np.interp(at + length_s, self.time, commanded)
            if law.nominal_supply_V is not None:
                middle = start + length_s / 2
                supply[:, place] = np.interp(middle, self.time, self.supply[:, place])
        return CommandedSteps(length_s, first, last, supply)

    def _held(self, commanded: Array, at: Array, length_s: Array) -> Array:
        """Return the means (S,) of a held command over steps."""
        # mean = change of the integral of the held command over the length of the step; before the
        # first sample the first command holds, after the last one the last
        begin, end = min(at[0], self.time[0]), max(at[-1] + length_s[-1], self.time[-1])
        ends = np.concatenate([[begin], self.time, [end]])
        values = np.concatenate([commanded[:1], commanded])
        whole = np.concatenate([[0.0], np.cumsum(values * np.diff(ends))])
        change = np.interp(at + length_s, ends, whole) - np.interp(at, ends, whole)
        return np.asarray(change / length_s)

    def torque(self, commanded: Array, supply: Array, position: Array, velocity: Array) -> Array:
        """Return the torques (m,) of the motors at their positions and velocities (m,)."""
        # the law is at the joint, on theta_M / N; divided by N it gives the torque of the motor
        turned = position / self.ratio, velocity / self.ratio
        wanted = commanded - self.position_gain * turned[0] - self.velocity_gain * turned[1]
        # the linear law for all at once, and the complete one only where it differs
        for place in self.limited:
            state = commanded[place], turned[0][place], turned[1][place], supply[place]
            wanted[place] = self.laws[place].torque(*state)[0]
        return np.asarray(wanted / self.ratio)


def position_controllers(robot: Robot, log: Log) -> PositionControllers | None:
    """Return the controllers of the drives with logged commands, None without one.

    Raises LogError naming a column that the log does not have.
    """
    drives = [robot.drives[joint] for joint in robot.joint_names]
    laws = {index: law for index, drive in enumerate(drives) if (law := drive.law) is not None}
    if not laws:
        return None
    signals = log.sensors(robot.joint_names)  # in the order of the robot
    parts = [commanded_part(robot, log.time, signals, k, is_scaled=True) for k in laws]
    delays = [drives[k].command_delay_s or 0.0 for k in laws]
    gains = [(law.position_gain_Nm_per_rad, law.velocity_gain_Nms_per_rad) for law in laws.values()]
    position_gain, velocity_gain = np.array(gains, dtype=float).T.copy()
    return PositionControllers(
        index=np.array([*laws]),
        time=log.time,
        commanded=np.column_stack(parts),
        supply=np.column_stack([relative_supply(robot, log.time, signals, k) for k in laws]),
        delay_s=np.array(delays, dtype=float),
        ratio=np.array([drives[k].ratio for k in laws], dtype=float),
        position_gain=position_gain,
        velocity_gain=velocity_gain,
        laws=[*laws.values()],
    )
