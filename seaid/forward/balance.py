"""The complete model (7) + (8) of a plant: accelerations and torques where friction is known.

All joints are in the order of Pinocchio's model.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.errors import RobotError, SeaidError
from seaid.forward.holding import holding, without
from seaid.forward.inertia_matrix import mass_matrix
from seaid.forward.plant import JOINT_POSITION, JOINT_SPEED, POSITION, SPEED, Plant
from seaid.linear_algebra import safely

_MOST_TURNS, _SETTLED = 60, 1e-11
"""The torque through a gear, where friction depends on it, settles to this part of itself."""


def drive_states(plant: Plant, state: Array) -> Array:
    """Return a state (4, n) with what the drives turn, phi = C q, in place of the joints."""
    if plant.coupling is None:
        return state
    return np.concatenate([state[:JOINT_POSITION], state[JOINT_POSITION:] @ plant.coupling.T])


def spring_force(plant: Plant, turned: Array) -> Array:
    """Return (3) of each joint (n,), zero where stiff, at a state of `drive_states`."""
    force = np.asarray(
        plant.stiffness
        * (plant.motor_lever * turned[POSITION] - plant.load_radius * turned[JOINT_POSITION])
    )
    for index, drive in plant.acting:
        if plant.elastic[index]:
            force[index] = drive.force(*turned[:, index].tolist(), 0.0)
    return force


def accelerations(
    plant: Plant, data: pin.Data, state: Array, torque: Array, slip: Array
) -> tuple[Array, Array]:
    """Return motor and joint acceleration at a state under a motor torque.

    `slip` (n + m,) is the direction in which dry friction is overcome, 0 where it holds: that of
    the motors, then that of the m rubbing joints. Raises SeaidError where friction under load has
    no solution.
    """
    turned = drive_states(plant, state)
    free = torque - plant.viscous * state[SPEED] - plant.coulomb * slip[: len(torque)]
    for index, extra in plant.extras:
        free[index] -= extra(*turned[:, index])
    force = spring_force(plant, turned)
    if not plant.acting:
        return _driven(plant, data, state, free, force, slip)
    at = turned.T.tolist()
    gear, under_load = np.zeros_like(free), list(plant.under_load)
    last: tuple[Array, Array] | None = None
    for _ in range(_MOST_TURNS):
        rest = free.copy()
        for index, drive in plant.acting:
            through = float(gear[index])
            rest[index] -= drive.friction(*at[index], through)
            if slip[index] != 0:
                rest[index] -= drive.level(*at[index], through) * slip[index]
        motor, joint = _driven(plant, data, state, rest, force, slip)
        found = (plant.ratio * (rest - plant.motor_inertia * motor))[under_load]
        error = found - gear[under_load]
        if np.all(np.abs(error) <= _SETTLED * (1 + np.abs(found))):
            return motor, joint
        gear[under_load] = found if last is None else _faster(found, error, *last)
        last = found, error
    raise SeaidError("friction under load does not settle: load_friction must be well below one")


def _faster(found: Array, error: Array, found_before: Array, error_before: Array) -> Array:
    """Return the next guess of a fixed point, by the secant of the last two (Anderson 1965)."""
    change = error - error_before
    size = float(change @ change)
    part = float(error @ change) / size if size > 0 else 0.0
    return found - part * (found - found_before)


def _driven(
    plant: Plant, data: pin.Data, state: Array, free: Array, force: Array, slip: Array
) -> tuple[Array, Array]:
    """Return motor and joint acceleration under motor torques less friction, and spring forces."""
    load_torque = plant.elastic_lever * force + plant.stiff_ratio * free
    joint = _joint_accelerations(plant, data, state, load_torque, slip)
    motor = (free - plant.motor_lever * force) * plant.motor_mobility
    resting = not slip.all()
    if resting:
        held = np.flatnonzero((slip == 0) & plant.holds_load)
        motor[slip[: len(motor)] == 0] = 0.0
        if held.size:
            joint += holding(plant, data, state, joint, held)[1]
            joint = without(plant, joint, held)
    turning = joint if plant.coupling is None else plant.coupling @ joint
    motor = motor + plant.stiff_ratio * turning
    if resting and plant.coupling is not None:
        motor[slip[: len(motor)] == 0] = 0.0
    return motor, joint


def _joint_accelerations(
    plant: Plant, data: pin.Data, state: Array, torque: Array, slip: Array
) -> Array:
    """Return the joint accelerations under torques on what the drives turn."""
    position, speed = state[JOINT_POSITION], state[JOINT_SPEED]
    torque = torque if plant.coupling is None else plant.coupling.T @ torque
    for index, drive in plant.acting:
        torque[index] -= drive.beside(float(position[index]), float(speed[index]))
    if plant.rubbing.size:
        torque[plant.rubbing] -= plant.joint_coulomb * slip[len(torque) :]
    if plant.rotors is None:
        return np.array(pin.aba(plant.model, data, position, speed, torque))
    bias = pin.nle(plant.model, data, position, speed)
    inertia = mass_matrix(plant.model, data, position) + plant.rotors
    return np.asarray(
        safely(np.linalg.solve, inertia, torque - bias, what="the mass matrix", error=RobotError)
    )


def gear_torques(
    plant: Plant, data: pin.Data, state: Array, acceleration: Array, slip: Array
) -> Array:
    """Return what stiff gears put on their load (n,), NaN where elastic; of joint accelerations.

    A rubbing joint that is held counts without its friction.
    """
    armature, plant.model.armature = plant.model.armature.copy(), np.zeros(plant.model.nv)
    torque = pin.rnea(plant.model, data, state[JOINT_POSITION], state[JOINT_SPEED], acceleration)
    plant.model.armature = armature
    torque = np.array(torque)
    for index, drive in plant.acting:
        torque[index] += drive.beside(*state[JOINT_POSITION:, index].tolist())
    torque[plant.rubbing] += plant.joint_coulomb * slip[len(torque) :]
    torque = torque if plant.uncoupling is None else torque @ plant.uncoupling
    return np.where(plant.elastic, np.nan, torque)
