"""An experiment in simulation: plant, joint controller and the sensors that watch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array, check_rate, frozen, seed_of
from seaid._progress import track
from seaid.errors import SeaidError
from seaid.excitation import Trajectory
from seaid.log import Log, Motion
from seaid.robot import Robot, torques_at_joints
from seaid.simulation.controller import input_gain, joint_controller, motor_inputs
from seaid.simulation.forward_dynamics import (
    accelerations,
    advance,
    drive_states,
    gear_torques,
    slip_directions,
)
from seaid.simulation.plant import JOINT_POSITION, JOINT_SPEED, POSITION, SPEED, Plant, plant_of

SETTLE_S = 1.0
"""The controller holds the start of the trajectory so long before the log begins."""

_LONGEST_STEP_S, _LARGEST_NOISE = 5e-4, 1e9
_LEAST_RATE_HZ = 0.1
"""A controller that is slower holds nothing, and takes endless steps between its ticks."""


@dataclass(frozen=True, eq=False)
class Noise:
    """What the sensors add: a number for all joints or one a joint; the default adds nothing.

    Encoder steps and unknown encoder zeros of both sides [rad; joint side of a prismatic joint m],
    and the standard deviation of the white noise on the motor torque [N m].
    """

    motor_resolution_rad: float | tuple[float, ...] = 0.0
    joint_resolution_rad: float | tuple[float, ...] = 0.0
    motor_zero_rad: float | tuple[float, ...] = 0.0
    joint_zero_rad: float | tuple[float, ...] = 0.0
    torque_std_Nm: float | tuple[float, ...] = 0.0


def simulate(
    robot: Robot,
    trajectory: Trajectory,
    *,
    rate_hz: float = 1000.0,
    noise: Noise | None = None,
    seed: int = 0,
    progress: bool = False,
) -> Log:
    """Return the log of a robot that follows a trajectory under joint control.

    The robot moves with its payloads and all terms of its drives at their nominal values; the
    controller sees the motor encoders as the log has them. A motor whose drive has the input
    "current" or "voltage" is logged by that, without a torque. The same seed gives the same log.
    Raises RobotError where a drive lacks a nominal value.
    """
    noise = Noise() if noise is None else noise
    motion = simulate_motion(robot, trajectory, rate_hz=rate_hz, noise=noise, progress=progress)
    return measure(robot, motion, noise, seed)


def measure(robot: Robot, motion: Motion, noise: Noise, seed: int = 0) -> Log:
    """Return what the sensors say of a true motion: zeros, steps, white torque noise."""
    rng = np.random.default_rng(seed_of(seed))
    noise_torque = rng.normal(size=motion.motor_torque.shape) * _spread(
        robot, "torque_std_Nm", noise.torque_std_Nm
    )
    inputs = motor_inputs(robot, motion.motor_torque + noise_torque)
    return Log(
        time=motion.time,
        joint_names=robot.joint_names,
        motor_position=_reading(robot, noise, "motor", motion.motor_position),
        joint_position=_reading(robot, noise, "joint", motion.joint_position),
        motor_torque=inputs.torque,
        motor_current=inputs.current,
        motor_voltage=inputs.voltage,
        is_prismatic=robot.is_prismatic,
    )


def simulate_motion(
    robot: Robot,
    trajectory: Trajectory,
    *,
    rate_hz: float = 1000.0,
    noise: Noise | None = None,
    progress: bool = False,
) -> Motion:
    """Return the true motion of the experiment: states, accelerations and torques at each tick.

    `trajectory` needs `duration` [s] and `sample(time) -> q, v, a`. The motor current ramps from
    one command of the controller to the next within one tick, so the torque that a sensor reads at
    a tick is the one that acts then; it is there whatever the motor is logged by. `gear_torque` is
    there where friction of stiff drives depends on it.
    """
    check_rate(rate_hz, trajectory.duration, _LEAST_RATE_HZ)
    _check_joints(robot, trajectory)
    for joint in robot.joint_names:
        input_gain(robot, joint)  # a missing constant is told before anything moves
    plant, order = plant_of(robot), list(robot.model_order)
    noise = Noise() if noise is None else noise
    settle = round(SETTLE_S * rate_hz)
    count = math.floor(trajectory.duration * rate_hz + 1e-6) + 1
    time = np.arange(count) / rate_hz
    planned = [
        np.concatenate([np.repeat(rows[:1] * hold, settle, axis=0), rows])[:, order]
        for rows, hold in zip(trajectory.sample(time), (1.0, 0.0, 0.0), strict=True)
    ]
    states, torques = _run(robot, plant, planned, noise, rate_hz, progress)
    return _motion(robot, plant, time, states[settle:], torques[settle:])


def _check_joints(robot: Robot, trajectory: Trajectory) -> None:
    """Refuse a motion of other joints; one without names counts as the robot's."""
    names = getattr(trajectory, "joint_names", robot.joint_names)
    if tuple(names) != robot.joint_names:
        raise SeaidError(
            f"the trajectory moves {', '.join(names)}; '{robot.name}' has "
            f"{', '.join(robot.joint_names)}: plan for this robot, with its joints in this order"
        )


def _run(
    robot: Robot,
    plant: Plant,
    planned: list[Array],
    noise: Noise,
    rate_hz: float,
    progress: bool,
) -> tuple[Array, Array]:
    """Return states (T, 4, n) and motor torques (T, n) at the ticks, in the model's order."""
    q, v, a = planned
    controller = joint_controller(plant, q, v, a, rate_hz)
    ticks, joints = planned[0].shape
    order = list(robot.model_order)
    data = plant.model.createData()
    steps = math.ceil(1 / (rate_hz * _LONGEST_STEP_S))
    states, torques = np.empty((ticks, 4, joints)), np.empty((ticks, joints))
    state = np.zeros((4, joints))
    state[POSITION], state[JOINT_POSITION] = controller.motor_position[0], planned[0][0]
    torque, velocity, previous = controller.feedforward[0], np.zeros(joints), None
    for tick in track(range(ticks), "simulating", progress):
        states[tick], torques[tick] = state, torque
        reading = np.empty(joints)
        reading[:] = _reading(robot, noise, "motor", state[POSITION][None, np.argsort(order)])[0][
            order
        ]
        if previous is not None:
            velocity += controller.velocity_filter * ((reading - previous) * rate_hz - velocity)
        previous = reading
        command = controller.torque(tick, reading, velocity)
        rate = (command - torque) * rate_hz
        for step in range(steps):
            at = torque + rate * step / (steps * rate_hz)
            state = advance(plant, data, state, at, rate, 1 / (steps * rate_hz))
        torque = command
    return states, torques


def _motion(robot: Robot, plant: Plant, time: Array, states: Array, torques: Array) -> Motion:
    data, order = plant.model.createData(), list(robot.model_order)
    speeds, through = np.empty((2, *torques.shape)), np.full(torques.shape, np.nan)
    for tick, (state, torque) in enumerate(zip(states, torques, strict=True)):
        slip = slip_directions(plant, data, state, torque)
        speeds[:, tick] = accelerations(plant, data, state, torque, slip)
        if plant.under_load:
            through[tick] = gear_torques(plant, data, state, speeds[1, tick], slip)
    load = _spring_torques(plant, states)
    back = np.argsort(order)
    inputs = motor_inputs(robot, torques[:, back])
    return Motion(
        time=time,
        joint_names=robot.joint_names,
        joint_position=states[:, JOINT_POSITION, back],
        joint_velocity=states[:, JOINT_SPEED, back],
        joint_acceleration=speeds[1][:, back],
        motor_position=states[:, POSITION, back],
        motor_velocity=states[:, SPEED, back],
        motor_acceleration=speeds[0][:, back],
        motor_torque=torques[:, back],
        joint_torque=torques_at_joints(robot.transmission, load[:, back]),
        motor_current=inputs.current,
        motor_voltage=inputs.voltage,
        gear_torque=through[:, back] if plant.under_load else None,
        cutoff_hz=math.inf,
    )


def _spring_torques(plant: Plant, states: Array) -> Array:
    """Return (4b) along states (T, 4, n): the torque (T, n) of springs on what the drives turn."""
    turned = states
    if plant.coupling is not None or plant.acting:
        turned = np.array([drive_states(plant, state) for state in states])
    stretch = plant.motor_radius / plant.ratio * turned[:, POSITION]
    stretch = stretch - plant.load_radius * turned[:, JOINT_POSITION]
    load = np.where(plant.elastic, plant.load_radius * plant.stiffness * stretch, np.nan)
    for index, drive in plant.acting:
        if plant.elastic[index]:
            force = [drive.force(*state, 0.0) for state in turned[:, :, index].tolist()]
            load[:, index] = plant.load_radius[index] * np.array(force)
    return load


def _reading(robot: Robot, noise: Noise, side: str, position: Array) -> Array:
    """Return the encoder's reading (T, n) of a position: shifted zero, whole steps."""
    step = _spread(robot, f"{side}_resolution_rad", getattr(noise, f"{side}_resolution_rad"))
    zero = _spread(robot, f"{side}_zero_rad", getattr(noise, f"{side}_zero_rad"))
    shifted = position + zero
    whole = np.where(step > 0, step, 1.0)
    return np.where(step > 0, np.round(shifted / whole) * whole, shifted)


def _spread(robot: Robot, name: str, value: float | tuple[float, ...]) -> Array:
    values = np.full(robot.n, value) if np.ndim(value) == 0 else value
    spread = frozen(f"Noise.{name}", values, (robot.n,))
    if not np.all(np.abs(spread) <= _LARGEST_NOISE):
        raise SeaidError(
            f"Noise.{name} must be from -{_LARGEST_NOISE:g} to {_LARGEST_NOISE:g}, found "
            f"{spread.tolist()}"
        )
    return spread
