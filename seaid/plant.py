"""The complete model (7) + (8) as a plant that moves, with dry friction that can hold.

Inside this module all joints are in the order of Pinocchio's model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, BoolArray
from seaid.drivetrain.extra_terms import extra_torque
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.errors import RobotError, SeaidError
from seaid.robot import Robot

REST_RAD_S = 1e-9
"""A motor slower than this is at rest, and friction may hold it."""

_MOST_EVENTS = 200

Extra = Callable[[float, float, float, float], float]
POSITION, SPEED, JOINT_POSITION, JOINT_SPEED = range(4)
"""Rows of a state (4, n): motor angle and speed, joint position and speed."""


@dataclass(frozen=True, eq=False)
class Plant:
    """Numbers of the complete model, each (n,); stiffness 0 and not `elastic` where stiff.

    `motor_lever` r_M/N, `elastic_lever` r_L and `motor_mobility` 1/I_M, the latter two zero where
    stiff; `stiff_ratio` N, zero where elastic.
    `model` carries the rotor inertia of stiff drives as armature, seen at the joint.
    """

    model: pin.Model
    elastic: BoolArray
    ratio: Array
    motor_inertia: Array
    viscous: Array
    coulomb: Array
    motor_radius: Array
    load_radius: Array
    stiffness: Array
    motor_lever: Array
    elastic_lever: Array
    motor_mobility: Array
    stiff_ratio: Array
    extras: tuple[tuple[int, Extra], ...]


def plant_of(robot: Robot) -> Plant:
    """Return the plant of a robot with its payloads and nominal values.

    Raises RobotError naming joint and value where a nominal value is not given.
    """
    if not np.all(np.isfinite(robot.parameters)):
        raise RobotError(f"'{robot.name}' has no inertial parameters: it cannot be simulated")
    drives = [robot.drivetrains[robot.joint_names[index]] for index in robot.model_order]
    names = [robot.joint_names[index] for index in robot.model_order]

    def nominal(value_of: Callable[[str, Drive, str], float], name: str) -> Array:
        pairs = zip(names, drives, strict=True)
        return np.array([value_of(joint, drive, name) for joint, drive in pairs])

    elastic = np.array([isinstance(drive, SeriesElasticDrive) for drive in drives])
    ratio = np.array([drive.ratio for drive in drives])
    inertia = nominal(_nominal, "motor_inertia_kg_m2")
    motor_radius = np.array([getattr(drive, "motor_radius", 1.0) for drive in drives])
    load_radius = np.array([getattr(drive, "load_radius", 1.0) for drive in drives])
    model = robot.model.copy()
    model.armature = np.where(elastic, 0.0, ratio**2 * inertia)
    if np.any(elastic & (inertia == 0)):
        name = names[int(np.flatnonzero(elastic & (inertia == 0))[0])]
        raise RobotError(f"joint '{name}': an elastic drive needs a motor inertia to be simulated")
    return Plant(
        model=model,
        elastic=elastic,
        ratio=ratio,
        motor_inertia=inertia,
        viscous=nominal(_friction, "viscous"),
        coulomb=nominal(_friction, "coulomb"),
        motor_radius=motor_radius,
        load_radius=load_radius,
        stiffness=nominal(_nominal, "stiffness"),
        motor_lever=motor_radius / ratio,
        elastic_lever=np.where(elastic, load_radius, 0.0),
        motor_mobility=np.where(elastic, 1 / np.where(elastic, inertia, 1.0), 0.0),
        stiff_ratio=np.where(elastic, 0.0, ratio),
        extras=tuple(
            (index, extra_torque(drive)) for index, drive in enumerate(drives) if drive.extra_terms
        ),
    )


def _nominal(joint: str, drive: Drive, name: str) -> float:
    if name == "stiffness" and not isinstance(drive, SeriesElasticDrive):
        return 0.0
    value = getattr(drive, name)
    if value is None:
        raise RobotError(
            f"joint '{joint}': '{name}' is not given; a simulation needs a nominal value"
        )
    return float(value)


def _friction(joint: str, drive: Drive, term: str) -> float:
    name = {"viscous": "viscous_friction_Nms_per_rad", "coulomb": "coulomb_friction_Nm"}[term]
    return _nominal(joint, drive, name) if term in drive.friction else 0.0


def accelerations(
    plant: Plant, data: pin.Data, state: Array, torque: Array, slip: Array
) -> tuple[Array, Array]:
    """Return motor and joint acceleration at a state under a motor torque.

    `slip` (n,) is the direction in which dry friction is overcome, 0 where it holds the motor.
    """
    free = torque - plant.viscous * state[SPEED] - plant.coulomb * slip
    for index, extra in plant.extras:
        free[index] -= extra(*state[:, index])
    force = spring_force(plant, state)
    load_torque = plant.elastic_lever * force + plant.stiff_ratio * free
    joint = np.array(
        pin.aba(plant.model, data, state[JOINT_POSITION], state[JOINT_SPEED], load_torque)
    )
    motor = (free - plant.motor_lever * force) * plant.motor_mobility
    held = slip == 0
    if held.any():
        motor[held] = 0.0
        stiff_held = np.flatnonzero(held & ~plant.elastic)
        if stiff_held.size:
            joint += _holding(plant, data, state, joint, stiff_held)[1]
            joint[stiff_held] = 0.0  # exactly: what is held does not creep
    return motor + plant.stiff_ratio * joint, joint


def spring_force(plant: Plant, state: Array) -> Array:
    """Return (3) of each joint (n,), zero where stiff."""
    return np.asarray(
        plant.stiffness
        * (plant.motor_lever * state[POSITION] - plant.load_radius * state[JOINT_POSITION])
    )


def _holding(
    plant: Plant, data: pin.Data, state: Array, joint: Array, held: np.ndarray
) -> tuple[Array, Array]:
    """Return the joint torques that keep the held joints still, and their joint accelerations."""
    inverse = np.triu(pin.computeMinverse(plant.model, data, state[JOINT_POSITION]))
    inverse = inverse + np.triu(inverse, 1).T
    torque = -np.linalg.solve(inverse[np.ix_(held, held)], joint[held])
    return torque, inverse[:, held] @ torque


def slip_directions(plant: Plant, data: pin.Data, state: Array, torque: Array) -> Array:
    """Return where friction slips (+-1) and where it can hold the motor (0), all joints at once."""
    speed = state[SPEED]
    slip = np.where(np.abs(speed) > REST_RAD_S, np.sign(speed), 0.0)
    slip[plant.coulomb == 0] = 1.0
    resting = np.flatnonzero(slip == 0)
    if not resting.size:
        return slip
    free = torque.copy()
    for index, extra in plant.extras:
        free[index] -= extra(*state[:, index])
    free -= plant.motor_lever * spring_force(plant, state)
    moves = plant.elastic & (slip == 0) & (np.abs(free) > plant.coulomb)
    slip[moves] = np.sign(free[moves])
    while (held := np.flatnonzero((slip == 0) & ~plant.elastic)).size:
        without = slip.copy()
        without[held] = 1e-300
        joint = accelerations(plant, data, state, torque, without)[1]
        needed = -_holding(plant, data, state, joint, held)[0] / plant.ratio[held]
        breaks = np.abs(needed) > plant.coulomb[held]
        if not np.any(breaks):
            break
        slip[held[breaks]] = np.sign(needed[breaks])
    return slip


def advance(
    plant: Plant, data: pin.Data, state: Array, torque: Array, torque_rate: Array, step: float
) -> Array:
    """Return the state one step later, stopping inside it wherever a motor comes to rest.

    The torque is `torque` at the start and grows with `torque_rate`. Raises SeaidError if the
    state is no longer finite or the friction events do not end.
    """
    done, stuck = 0.0, np.zeros(len(torque), dtype=bool)
    for _ in range(_MOST_EVENTS):
        now = torque + torque_rate * done
        slip = slip_directions(plant, data, state, now)
        slip[stuck] = 0.0
        rest = step - done
        new = _runge_kutta(plant, data, state, now, torque_rate, slip, rest)
        before, after = state[SPEED] * slip, new[SPEED] * slip
        crossed = np.flatnonzero((after < 0) & (plant.coulomb > 0))
        if not crossed.size:
            if not np.all(np.isfinite(new)):
                raise SeaidError(
                    "the simulation diverged: check stiffness, inertias and controller"
                )
            return new
        fractions = np.clip(before[crossed] / (before[crossed] - after[crossed]), 0.0, 1.0)
        first, fraction = crossed[np.argmin(fractions)], float(fractions.min())
        if fraction * rest < 1e-12:
            stuck[first] = True
        state = _runge_kutta(plant, data, state, now, torque_rate, slip, fraction * rest)
        state[SPEED, first] = 0.0
        if not plant.elastic[first]:
            state[JOINT_SPEED, first] = 0.0
        done += fraction * rest
    raise SeaidError("the simulation stopped: friction events without end in one step")


def _runge_kutta(
    plant: Plant,
    data: pin.Data,
    state: Array,
    torque: Array,
    torque_rate: Array,
    slip: Array,
    step: float,
) -> Array:
    def rate(at: float, y: Array) -> Array:
        motor, joint = accelerations(plant, data, y, torque + torque_rate * at, slip)
        return np.array([y[SPEED], motor, y[JOINT_SPEED], joint])

    half = 0.5 * step
    k1 = rate(0.0, state)
    k2 = rate(half, state + half * k1)
    k3 = rate(half, state + half * k2)
    k4 = rate(step, state + step * k3)
    return np.asarray(state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
