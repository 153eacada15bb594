"""Where dry friction slips, and where it can hold."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.forward.balance import accelerations, drive_states, spring_force
from seaid.forward.holding import holding
from seaid.forward.plant import JOINT_SPEED, SPEED, Plant

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
