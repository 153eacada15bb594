"""What dry friction holds: motors behind stiff gears and rubbing joints that must stay at rest.

The complete model (7) + (8) of a plant: accelerations and torques where friction is known.

All joints are in the order of Pinocchio's model.

Where dry friction slips, and where it can hold.

The state of a plant one step later, stopped inside it wherever friction brings one to rest.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, IndexArray, safely
from seaid.errors import RobotError, SeaidError
from seaid.simulation.plant import (
    JOINT_POSITION,
    JOINT_SPEED,
    POSITION,
    SPEED,
    Plant,
    inverse_inertia,
    mass_matrix,
)

_safely = partial(safely, what="what dry friction holds", error=RobotError)


def held_rows(plant: Plant, held: IndexArray) -> Array:
    """Return what held drives and joints turn, as rows (held, n) on the joints."""
    n = len(plant.elastic)
    turned = np.eye(n) if plant.coupling is None else plant.coupling
    return np.vstack([turned, np.eye(n)[plant.rubbing]])[held]


def without(plant: Plant, joint: Array, held: IndexArray) -> Array:
    """Return joint speeds or accelerations without those of held drives and joints: no creeping."""
    n = len(joint)
    if plant.coupling is not None:
        rows = held_rows(plant, held)
        joint = joint - _safely(np.linalg.pinv, rows) @ (rows @ joint)
        held = held[held >= n]
    joint[plant.places[held]] = 0.0
    return joint


def holding(
    plant: Plant, data: pin.Data, state: Array, joint: Array, held: IndexArray
) -> tuple[Array, Array]:
    """Return the torques that keep held drives and joints still, and their joint accelerations."""
    inverse = inverse_inertia(plant.model, data, state[JOINT_POSITION], plant.rotors)
    if plant.coupling is None:
        places = plant.places[held]
        torque = np.asarray(
            -_safely(np.linalg.solve, inverse[np.ix_(places, places)], joint[places])
        )
        return torque, np.asarray(inverse[:, places] @ torque)
    rows = held_rows(plant, held)
    torque = np.asarray(-_safely(np.linalg.lstsq, rows @ inverse @ rows.T, rows @ joint)[0])
    return torque, np.asarray(inverse @ rows.T @ torque)


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


REST_RAD_S = 1e-9
"""A motor slower than this is at rest, and friction may hold it."""

_NOTHING = 1e-300
"""A slip that is there and has no friction."""


def slip_directions(plant: Plant, data: pin.Data, state: Array, torque: Array) -> Array:
    """Return where friction slips (+-1) and where it can hold (0), (n + m,), all at once.

    That of the motors, then that of the m rubbing joints.
    """
    n, speed = len(torque), rubbing_speeds(plant, state)
    slip = np.where(np.abs(speed) > REST_RAD_S, np.sign(speed), 0.0)
    slip[~plant.is_dry] = 1.0
    resting = np.flatnonzero(slip == 0)
    if not resting.size:
        return slip
    free, turned = torque.copy(), drive_states(plant, state)
    for index, extra in plant.extras:
        free[index] -= extra(*turned[:, index])
    for index, drive in plant.acting:
        free[index] -= drive.friction(*turned[:, index].tolist(), 0.0)
    free -= plant.motor_lever * spring_force(plant, turned)
    level = levels(plant, turned, np.zeros_like(free))
    moves = np.flatnonzero(plant.elastic & (slip[:n] == 0) & (np.abs(free) > level[:n]))
    slip[moves] = np.sign(free[moves])
    while (held := np.flatnonzero((slip == 0) & plant.holds_load)).size:
        without = slip.copy()
        without[held] = _NOTHING
        joint = accelerations(plant, data, state, torque, without)[1]
        motors = held[held < n]
        needed = -holding(plant, data, state, joint, held)[0]
        needed[: len(motors)] /= plant.ratio[motors]
        if plant.under_load:
            through = np.zeros_like(free)
            through[motors] = plant.ratio[motors] * (free[motors] - needed[: len(motors)])
            level = levels(plant, turned, through)
        breaks = np.abs(needed) > level[held]
        if not np.any(breaks):
            break
        slip[held[breaks]] = np.sign(needed[breaks])
    return slip


def rubbing_speeds(plant: Plant, state: Array) -> Array:
    """Return the speeds (n + m,) of the motors, then of the rubbing joints."""
    if not plant.rubbing.size:
        return np.asarray(state[SPEED])
    return np.append(state[SPEED], state[JOINT_SPEED, plant.rubbing])


def levels(plant: Plant, turned: Array, through: Array) -> Array:
    """Return the friction (n + m,) that can hold motors, and rubbing joints.

    `through` is the torque through the gears of stiff drives.
    """
    if not plant.acting:
        return plant.coulomb
    level = np.append(plant.coulomb, plant.joint_coulomb)
    for index, drive in plant.acting:
        level[index] = drive.level(*turned[:, index].tolist(), float(through[index]))
    return level


_MOST_EVENTS = 200


def advance(
    plant: Plant, data: pin.Data, state: Array, torque: Array, torque_rate: Array, step: float
) -> Array:
    """Return the state one step later, stopping inside it wherever a motor comes to rest.

    The torque is `torque` at the start and grows with `torque_rate`. Raises SeaidError if the
    state is no longer finite or the friction events do not end.
    """
    parts = math.ceil(step / plant.longest_step) if step > plant.longest_step else 1
    try:
        for part in range(parts):
            now = torque if part == 0 else torque + torque_rate * (part * step / parts)
            state = _advance(plant, data, state, now, torque_rate, step / parts)
    except OverflowError:
        raise _diverged() from None
    return state


def _diverged() -> SeaidError:
    return SeaidError("the simulation diverged: check stiffness, inertias and controller")


def _advance(
    plant: Plant, data: pin.Data, state: Array, torque: Array, torque_rate: Array, step: float
) -> Array:
    done, stuck = 0.0, np.zeros(len(plant.is_dry), dtype=bool)
    for _ in range(_MOST_EVENTS):
        now = torque + torque_rate * done
        slip = slip_directions(plant, data, state, now)
        slip[stuck] = 0.0
        rest = step - done
        new = _runge_kutta(plant, data, state, now, torque_rate, slip, rest)
        before, after = (rubbing_speeds(plant, one) * slip for one in (state, new))
        crossed = np.flatnonzero((after < 0) & plant.is_dry)
        if not crossed.size:
            if not np.all(np.isfinite(new)):
                raise _diverged()
            return new
        fractions = np.clip(before[crossed] / (before[crossed] - after[crossed]), 0.0, 1.0)
        first, fraction = crossed[np.argmin(fractions)], float(fractions.min())
        if fraction * rest < 1e-12:
            stuck[first] = True
        state = _runge_kutta(plant, data, state, now, torque_rate, slip, fraction * rest)
        _stop(plant, state, int(first), np.flatnonzero(slip == 0))
        done += fraction * rest
    raise SeaidError("the simulation stopped: friction events without end in one step")


def _stop(plant: Plant, state: Array, first: int, resting: IndexArray) -> None:
    """Set the speed of a motor or rubbing joint to zero, and that of stiff motors with it."""
    n = len(plant.elastic)
    if first < n:
        state[SPEED, first] = 0.0
        if plant.elastic[first]:
            return
    held = np.append(resting[plant.holds_load[resting]], first)
    state[JOINT_SPEED] = without(plant, state[JOINT_SPEED], held)
    if plant.coupling is not None:
        turning = plant.ratio * (plant.coupling @ state[JOINT_SPEED])
        stiff = ~plant.elastic
        stiff[held[held < n]] = False
        state[SPEED, stiff] = turning[stiff]


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
