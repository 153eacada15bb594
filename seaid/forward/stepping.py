"""The state of a plant one step later, stopped inside it wherever friction brings one to rest."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, IndexArray
from seaid.errors import SeaidError
from seaid.forward.balance import accelerations
from seaid.forward.holding import without
from seaid.forward.plant import JOINT_SPEED, SPEED, Plant
from seaid.forward.slipping import rubbing_speeds, slip_directions

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
