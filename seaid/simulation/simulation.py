"""A simulated experiment: plant, joint controller and sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, check_rate, frozen
from seaid._progress import Display, track
from seaid.errors import SeaidError, Seed, check_name, checked
from seaid.excitation import Trajectory
from seaid.excitation.trajectory import check_joint_names
from seaid.log import Log, Motion
from seaid.robot import Robot, torques_at_joints
from seaid.robot.robot import check_held
from seaid.simulation.controller import input_gain, joint_controller, motor_inputs
from seaid.simulation.forward_dynamics import (
    advance,
    begin_of,
    drive_states,
    gear_torques,
    of_column,
)
from seaid.simulation.plant import (
    JOINT_POSITION,
    JOINT_SPEED,
    POSITION,
    SPEED,
    Plant,
    plant_of,
    warmed,
)

SETTLE_S = 1.0
"""Time for which the controller holds the start of the trajectory before the log begins."""

_LONGEST_STEP_S, _LARGEST_NOISE = 5e-4, 1e9
"""Longest step of the integration [s], and largest standard deviation of a noise, in its unit."""

_COLDEST_DEGC, _HOTTEST_DEGC = -100.0, 300.0
"""Range of the temperatures of motors [degC], beyond those in which motors run."""

Temperature = float | Sequence[float] | Mapping[str, float | Sequence[float]] | None
"""Temperatures of motors, see `simulate`."""

_LEAST_RATE_HZ = 0.1
"""A slower controller is unstable, and needs too many steps between its ticks."""


@dataclass(frozen=True, eq=False, repr=False)
class Noise(Display):
    """Errors of the simulated sensors: one number for all joints, or one per joint; default 0.

    Parameters
    ----------
    motor_resolution_rad, joint_resolution_rad : float or n floats
        Step of the encoders [rad; m at the joint side of a prismatic joint]; 0: continuous.
    motor_offset_rad, joint_offset_rad : float or n floats
        Encoder offsets, added to the true positions, in the same units.
    torque_std_Nm : float or n floats
        Standard deviation of the white noise on the motor torque [N m].

    Examples
    --------
    >>> Noise(motor_resolution_rad=2 * np.pi / 4096, torque_std_Nm=0.002)
    """

    motor_resolution_rad: float | tuple[float, ...] = 0.0
    joint_resolution_rad: float | tuple[float, ...] = 0.0
    motor_offset_rad: float | tuple[float, ...] = 0.0
    joint_offset_rad: float | tuple[float, ...] = 0.0
    torque_std_Nm: float | tuple[float, ...] = 0.0


@checked(SeaidError)
def simulate(
    robot: Robot,
    trajectory: Trajectory,
    *,
    rate_hz: float = 1000.0,
    noise: Noise | None = None,
    seed: Seed = 0,
    temperature_degC: Temperature = None,
    progress: bool = False,
) -> Log:
    """Simulate a robot that follows a trajectory under PD joint control, and return its log.

    Parameters
    ----------
    robot : Robot
        The true robot, with its payloads and nominal values of all drive parameters.
    trajectory : Trajectory
        The planned joint motion, of the robot's joints in their order.
    rate_hz : float, default 1000
        Rate of the controller and of the log.
    noise : Noise, optional
        Errors of the sensors; the controller sees the same motor encoders as the log.
    seed : int, default 0
        Seed of the torque noise; the same seed gives the same log.
    temperature_degC : float or mapping {joint: float or values over time}, optional
        Temperature of the motors, for friction that depends on it: constant, or values at equal
        distances in time from start to end, such as (20, 45). Default: that of reference.
    progress : bool, default False
        Show a progress bar on stderr.

    Returns
    -------
    Log
        Motor and joint positions, and the motor torque; of a drive with `motor_input` "current" or
        "voltage" that input instead.

    Raises
    ------
    RobotError
        If a drive lacks a nominal value.
    SeaidError
        For a trajectory of other joints, and if the simulation diverges.

    Examples
    --------
    >>> robot = seaid.load_robot("leg.urdf", "leg.toml")
    >>> plan = seaid.load_trajectory("plan.json")
    >>> log = seaid.simulate(robot, plan, noise=seaid.Noise(torque_std_Nm=0.002), seed=1)
    """
    check_held(robot, "simulate", why="seaid does not simulate contacts")
    noise = Noise() if noise is None else noise
    motion = simulate_motion(
        robot,
        trajectory,
        rate_hz=rate_hz,
        noise=noise,
        temperature_degC=temperature_degC,
        progress=progress,
    )
    return measure(robot, motion, noise, seed)


def measure(robot: Robot, motion: Motion, noise: Noise, seed: Seed = 0) -> Log:
    """Return the log of a true motion: encoder offsets, encoder steps and white torque noise."""
    rng = np.random.default_rng(seed)
    white = rng.normal(size=motion.motor_torque.shape)
    torque = motion.motor_torque + white * _spread(robot, noise, "torque_std_Nm")
    logged, current, voltage = motor_inputs(robot, torque)
    at_joints, in_order = robot.joint_states(motion.joint_position), range(robot.n)
    return Log(
        time=motion.time,
        joint_names=robot.joint_names,
        motor_position=_encoder(robot, noise, "motor", in_order)(motion.motor_position),
        joint_position=_encoder(robot, noise, "joint", in_order)(*at_joints),
        motor_torque=logged,
        motor_current=current,
        motor_voltage=voltage,
        motor_temperature=motion.motor_temperature,
        is_prismatic=robot.is_prismatic,
    )


def simulate_motion(
    robot: Robot,
    trajectory: Trajectory,
    *,
    rate_hz: float = 1000.0,
    noise: Noise | None = None,
    temperature_degC: Temperature = None,
    progress: bool = False,
) -> Motion:
    """Return the true motion of a simulated experiment: states, accelerations and torques.

    `trajectory` needs `joint_names`, `duration` [s] and `sample(time) -> q, v, a`. The motor torque
    ramps from one command of the controller to the next within one tick, so that the logged torque
    is the one that acts at the tick. `gear_torque` is given if friction of a stiff drive depends on
    it.
    """
    check_rate(rate_hz, trajectory.duration, _LEAST_RATE_HZ)
    check_joint_names(trajectory, robot)
    for joint in robot.joint_names:
        input_gain(robot, joint)  # report a missing constant before the simulation starts
    plant, order = plant_of(robot), robot.joint_order
    noise = Noise() if noise is None else noise
    settle = round(SETTLE_S * rate_hz)
    count = math.floor(trajectory.duration * rate_hz + 1e-6) + 1
    time = np.arange(count) / rate_hz
    # before the log the start is held: first position, zero velocity and acceleration
    moved = robot.drive_states(*trajectory.sample(time))
    planned = [
        np.concatenate([np.repeat(rows[:1] * hold, settle, axis=0), rows])[:, order]
        for rows, hold in zip(moved, (1.0, 0.0, 0.0), strict=True)
    ]
    warmth = _warmth(robot, temperature_degC, count)
    before = None
    if warmth is not None:
        before = np.pad(warmth[:, order], ((settle, 0), (0, 0)), mode="edge")
    run = _run(robot, plant, planned, noise, before, rate_hz, progress)
    return replace(_motion(robot, plant, time, [x[settle:] for x in run]), motor_temperature=warmth)


def _warmth(robot: Robot, degC: Temperature, count: int) -> Array | None:
    """Return the temperatures (count, n) of the motors [degC], None if none is given."""
    if degC is None:
        return None
    if not isinstance(degC, Mapping):
        degC = dict.fromkeys(robot.joint_names, degC)
    temperatures = np.empty((count, robot.n))
    for joint in degC:
        check_name("joint", joint, robot.joint_names, SeaidError, "temperature_degC")
    for index, joint in enumerate(robot.joint_names):
        # a constant is one value, which `interp` extends over the whole motion
        values = np.atleast_1d(degC.get(joint, robot.drives[joint].reference_temperature_degC))
        values = frozen(f"temperature_degC of '{joint}'", values, (None,))
        if not len(values) or not np.all((values > _COLDEST_DEGC) & (values < _HOTTEST_DEGC)):
            raise SeaidError(
                f"temperature_degC of '{joint}' must be between {_COLDEST_DEGC:g} and "
                f"{_HOTTEST_DEGC:g} degC, found {values.tolist()}"
            )
        temperatures[:, index] = np.interp(
            np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, len(values)), values
        )
    return temperatures


def _run(
    robot: Robot,
    plant: Plant,
    planned: list[Array],
    noise: Noise,
    warmth: Array | None,
    rate_hz: float,
    progress: bool,
) -> tuple[Array, Array, Array, Array]:
    """Return states (T, rows, n), motor torques, accelerations and gear torques at the ticks.

    Torques are (T, n), accelerations (T, 2, n) of motors and joints, in the model's order. Torques
    through gears are NaN where no friction depends on them.
    """
    (q, v, a), data = planned, plant.model.createData()
    controller = joint_controller(plant, q, v, a, rate_hz)
    ticks, joints = q.shape
    steps = math.ceil(1 / (rate_hz * _LONGEST_STEP_S))
    states, torques = np.empty((ticks, plant.rows, joints)), np.empty((ticks, joints))
    accelerations, through = np.empty((ticks, 2, joints)), np.full_like(torques, np.nan)
    state = np.zeros((plant.rows, joints))
    state[POSITION], state[JOINT_POSITION] = controller.motor_position[0], q[0]
    torque, velocity, previous = controller.feedforward[0], np.zeros(joints), None
    # the sensors are in the order of the robot, states in that of the model
    encoder = _encoder(robot, noise, "motor", robot.joint_order)
    for tick in track(range(ticks), "simulating", progress):
        states[tick], torques[tick] = state, torque
        reading = encoder(state[POSITION])
        # filtered difference of readings; the first tick has no previous one, and speed zero
        if previous is not None:
            velocity += controller.velocity_filter * ((reading - previous) * rate_hz - velocity)
        previous = reading
        command = controller.torque(tick, reading, velocity)
        rate = (command - torque) * rate_hz
        since = (tick - round(SETTLE_S * rate_hz)) / rate_hz
        warm = warmed(plant, None if warmth is None else warmth[tick], since)
        begin = begin_of(warm, data, state, torque)
        accelerations[tick] = begin[1][SPEED : JOINT_SPEED + 1 : 2]
        if plant.under_load:
            through[tick] = gear_torques(warm, data, state, begin)
        inputs = torque, rate, 1 / rate_hz
        state = advance(warm, data, state, *inputs, begin=begin, repeated_parts=steps)
        torque = command
    return states, torques, accelerations, through


def _motion(robot: Robot, plant: Plant, time: Array, run: Sequence[Array]) -> Motion:
    (states, torques, accelerations, through), back = run, np.argsort(robot.joint_order)
    load = _spring_torques(plant, states)
    _, current, voltage = motor_inputs(robot, torques[:, back])
    return Motion(
        time=time,
        joint_names=robot.joint_names,
        joint_position=states[:, JOINT_POSITION, back],
        joint_velocity=states[:, JOINT_SPEED, back],
        joint_acceleration=accelerations[:, 1, back],
        motor_position=states[:, POSITION, back],
        motor_velocity=states[:, SPEED, back],
        motor_acceleration=accelerations[:, 0, back],
        motor_torque=torques[:, back],
        # (4b) at the drives -> at the joints, tau = C^T tau_phi
        joint_torque=torques_at_joints(robot.transmission, load[:, back]),
        motor_current=current,
        motor_voltage=voltage,
        gear_torque=through[:, back] if plant.under_load else None,
        cutoff_hz=math.inf,
    )


def _spring_torques(plant: Plant, states: Array) -> Array:
    """Return the spring torques (4b) (T, n) at the drives along states (T, rows, n)."""
    turned = states
    if plant.coupling is not None or plant.functions:
        turned = np.array([drive_states(plant, state) for state in states])
    stretch = plant.motor_radius / plant.ratio * turned[:, POSITION]
    stretch = stretch - plant.load_radius * turned[:, JOINT_POSITION]
    load = np.where(plant.elastic, plant.load_radius * plant.stiffness * stretch, np.nan)
    for index, drive in plant.functions:
        if plant.elastic[index]:
            force = [of_column(drive.force, column) for column in turned[:, :, index].tolist()]
            load[:, index] = plant.load_radius[index] * np.array(force)
    return load


def _encoder(
    robot: Robot, noise: Noise, side: str, order: Sequence[int]
) -> Callable[[Array], Array]:
    """Return the function from positions (..., n) to the readings of the encoders on a side.

    The offset is added, and the sum is rounded to whole steps. The joints are in this order of
    those of the robot.
    """
    step = _spread(robot, noise, f"{side}_resolution_rad")[order]
    offset, is_stepped = _spread(robot, noise, f"{side}_offset_rad")[order], step > 0
    # `where` evaluates both branches: no division by a step of zero
    whole = np.where(is_stepped, step, 1.0)

    def reading(position: Array) -> Array:
        shifted = position + offset
        return np.where(is_stepped, np.rint(shifted / whole) * whole, shifted)

    return reading


def _spread(robot: Robot, noise: Noise, name: str) -> Array:
    """Return a field of `Noise` per joint (n,), checked."""
    value = getattr(noise, name)
    values = np.full(robot.n, value) if np.ndim(value) == 0 else value
    spread = frozen(f"Noise.{name}", values, (robot.n,))
    if not np.all(np.abs(spread) <= _LARGEST_NOISE):
        raise SeaidError(
            f"Noise.{name} must be from -{_LARGEST_NOISE:g} to {_LARGEST_NOISE:g}, found "
            f"{spread.tolist()}"
        )
    return spread
