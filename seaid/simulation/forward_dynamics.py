"""Forward dynamics of the complete model (7) and (8) with stick-slip friction.

`begin_of` decides where dry friction slips and where it sticks, and solves the model there, and
`advance` integrates over a step that ends early at each event where friction brings a motor or
joint to rest. All joints are in the order of Pinocchio's model; the m
"dry joints" have dry friction between their own two bodies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, IndexArray, safely
from seaid.drives.equations import after_travel
from seaid.drives.functions import DriveFunctions, OfState
from seaid.errors import RobotError, SeaidError
from seaid.log.filtering import REST_RAD_S
from seaid.simulation.plant import (
    JOINT_POSITION,
    JOINT_SPEED,
    POSITION,
    SPEED,
    Plant,
    holding,
    inertia,
    inverse_dynamics,
)

_safely = partial(safely, what="the sticking friction", error=RobotError)


def sticking_rows(plant: Plant, sticking: IndexArray) -> Array:
    """Return the constraint rows (sticking, n): phi of sticking drives, q of sticking joints."""
    n = len(plant.elastic)
    turned = np.eye(n) if plant.coupling is None else plant.coupling
    return np.vstack([turned, np.eye(n)[plant.dry_joints]])[sticking]


def without_sticking(plant: Plant, joint: Array, sticking: IndexArray) -> Array:
    """Return joint speeds or accelerations projected onto the sticking constraints, no creep."""
    n = len(joint)
    if plant.coupling is not None:
        rows = sticking_rows(plant, sticking)
        # x - A^+ A x: then the constraints hold up to rounding, and those of single joints exactly
        # by the line below.
        joint = joint - _safely(np.linalg.pinv, rows) @ (rows @ joint)
        sticking = sticking[sticking >= n]
    joint[plant.places[sticking]] = 0.0
    return joint


_MOST_ITERATIONS, _SETTLED = 60, 1e-11
"""Relative tolerance of the torque through a gear on which friction depends."""


def drive_states(plant: Plant, state: Array) -> Array:
    """Return a state (4, n) with the drives' coordinates phi = C q in place of the joints'."""
    if plant.coupling is None:
        return state
    turned = state.copy()
    turned[JOINT_POSITION : JOINT_SPEED + 1] = (
        state[JOINT_POSITION : JOINT_SPEED + 1] @ plant.coupling.T
    )
    return turned


def of_column(function: OfState, column: list[float], through: float = 0.0) -> float:
    """Return a term of a drive at its column of a state, with the torque through its gear."""
    return function(*column[: JOINT_SPEED + 1], through, *column[JOINT_SPEED + 1 :])


def with_memory(plant: Plant, before: Array, state: Array) -> Array:
    """Return a state with its hysteresis moved on by the travel since `before`."""
    if plant.memory:
        change = drive_states(plant, state - before)
        for index, row, (motor, joint), width in plant.memory:
            travel = motor * change[POSITION, index] + joint * change[JOINT_POSITION, index]
            state[row, index] = after_travel(before[row, index], travel, width)
    return state


def _with_inputs(state: Array, torque: Array) -> Array:
    """Return a state with the motor torques and a place for the slip directions as last rows."""
    y = np.empty((len(state) + 2, len(torque)))
    y[:-2], y[-2] = state, torque
    return y


@dataclass(frozen=True, eq=False)
class _Held:
    """What friction that sticks holds at slip directions: places on the load side, and motors.

    `levers` are the ratios of the drives at these places, one at dry joints; `model` is that of the
    robot whose joints there are held.
    """

    slip: Array
    model: pin.Model
    places: IndexArray
    levers: Array
    motors: tuple[int, ...]


@lru_cache(maxsize=64)
def _held(plant: Plant, slip: tuple[float, ...]) -> _Held:
    """Return what friction holds that sticks at the zeros of `slip`."""
    resting, model = np.flatnonzero(np.array(slip) == 0), plant.model
    places = resting[plant.acts_on_load[resting]]
    if places.size and plant.rotors is None:
        model = holding(model, tuple(plant.places[places].tolist()))
    motors = tuple(resting[resting < len(plant.elastic)].tolist())
    levers = np.append(plant.ratio, np.ones(len(plant.dry_joints)))[places]
    return _Held(np.array(slip), model, places, levers, motors)


Begin = tuple[_Held, Array]
"""The begin of a step: what friction holds, and `_driven` at the state."""


def _begin(plant: Plant, data: pin.Data, y: Array, slip: Sequence[float]) -> Begin:
    """Return the begin of a step at slip directions, which become the last row of `y`."""
    held = _held(plant, tuple(slip))
    y[-1] = held.slip[: y.shape[1]]
    return held, _driven(plant, data, y, held)


def _driven(plant: Plant, data: pin.Data, y: Array, held: _Held) -> Array:
    """Return three rates of a state with inputs, of joint speeds as the fourth, then torques.

    These are the torques on joints and on rotors, without friction that sticks. Further rows, one
    per row of hysteresis, are zero.
    """
    if not plant.functions:
        return _moved(plant, data, y, y.reshape(-1), held)
    n, state, under_load = y.shape[1], y[: plant.rows], list(plant.under_load)
    at = drive_states(plant, state).T.tolist()
    free, force = y[-2], _spring_forces(plant, at)
    gear, last = np.zeros(n), None
    # Friction under load depends on the torque through the gear, which depends on the acceleration:
    # the fixed point x = N (free - friction(x) - I_M theta''(x)).
    for _ in range(_MOST_ITERATIONS):
        rest = _without_friction(free, plant.functions, at, held.slip, gear)
        acting = np.concatenate([state[: JOINT_SPEED + 1].reshape(-1), rest, held.slip[:n], force])
        rates = _moved(plant, data, state, acting, held)
        load = (plant.ratio * (rest - plant.motor_inertia * rates[SPEED]))[under_load]
        error = load - gear[under_load]
        if np.all(np.abs(error) <= _SETTLED * (1 + np.abs(load))):
            return rates
        gear[under_load] = load if last is None else _faster(load, error, *last)
        last = load, error
    raise SeaidError(
        "load-dependent friction does not converge: load_friction must be well below one"
    )


def _spring_forces(plant: Plant, at: Sequence[list[float]]) -> Array:
    """Return the forces of springs in `functions`, zero of all others."""
    force = np.zeros(len(at))
    for index, drive in plant.functions:
        if plant.elastic[index]:
            force[index] = of_column(drive.force, at[index])
    return force


def _without_friction(
    torque: Array,
    drives: Sequence[tuple[int, DriveFunctions]],
    at: Sequence[list[float]],
    slip: Array,
    gear: Array,
) -> Array:
    """Return the torques of motors less the friction of some drives, with torques through gears."""
    rest = torque.copy()
    for index, drive in drives:
        through = float(gear[index])
        rest[index] -= of_column(drive.friction, at[index], through)
        if slip[index] != 0:
            rest[index] -= of_column(drive.level, at[index], through) * slip[index]
    return rest


def _faster(load: Array, error: Array, load_before: Array, error_before: Array) -> Array:
    """Return the next guess of a fixed point, by the secant of the last two (Anderson 1965)."""
    # x+ = g - b (g - g_before), b = <e, de> / <de, de>, with g the map and e = g - x its residual.
    change = error - error_before
    size = float(change @ change)
    part = float(error @ change) / size if size > 0 else 0.0
    return load - part * (load - load_before)


def _moved(plant: Plant, data: pin.Data, state: Array, acting: Array, held: _Held) -> Array:
    """Return `_driven` by what acts, as `drive_matrix` has it."""
    # on so small matrices `dot` takes a third of the time of `@`
    rates: Array = plant.drive_matrix.dot(acting).reshape(-1, len(plant.elastic))
    torque = rates[JOINT_SPEED + 1]
    for index, drive in plant.functions:
        torque[index] -= drive.joint_torque(*state[[JOINT_POSITION, JOINT_SPEED], index].tolist())
    if plant.dry_joints.size:
        torque[plant.dry_joints] -= plant.joint_coulomb * held.slip[len(torque) :]
    joint = _accelerations(plant, data, held, state[JOINT_POSITION], state[JOINT_SPEED], torque)
    rates[JOINT_SPEED] = joint
    rates[SPEED] += plant.turning.dot(joint)  # theta_M'' = N phi'' at stiff drives
    for motor in held.motors:
        # N phi'' of a stiff motor that sticks is zero up to rounding, by which it would creep.
        rates[SPEED, motor] = 0.0
    return rates


def _accelerations(
    plant: Plant, data: pin.Data, held: _Held, position: Array, speed: Array, torque: Array
) -> Array:
    """Return the joint accelerations (n,) under torques on the joints, zero at what is held."""
    if plant.rotors is None:
        return np.asarray(pin.aba(held.model, data, position, speed, torque))
    # `aba` has armature of single joints, but no rotors that several joints turn.
    rest = torque - inverse_dynamics(plant, data, (position, speed, np.zeros_like(speed)))
    solve = partial(_safely, np.linalg.solve, inertia(plant, data, position))
    joint = np.asarray(solve(rest))
    if not held.places.size:
        return joint
    # With rows A of the constraints, A (qdd + M^-1 A^T torque) = 0. Drives and dry joints may
    # constrain one direction together: A M^-1 A^T is then singular.
    rows = sticking_rows(plant, held.places)
    columns = solve(rows.T)
    joint = joint - columns @ _safely(np.linalg.lstsq, rows @ columns, rows @ joint)[0]
    return without_sticking(plant, joint, held.places)


def sticking_torques(plant: Plant, data: pin.Data, state: Array, begin: Begin) -> Array:
    """Return the torques of friction that sticks, at joint accelerations under other torques."""
    sticking, joint, torque = begin[0].places, begin[1][JOINT_SPEED], begin[1][JOINT_SPEED + 1]
    states = state[JOINT_POSITION], state[JOINT_SPEED], joint
    needed = inverse_dynamics(plant, data, states) - torque
    if plant.rotors is None:
        return np.asarray(needed[plant.places[sticking]])
    # A^T x = M qdd + b - tau, and of torques that act in one direction those of least norm.
    rows = sticking_rows(plant, sticking)
    return np.asarray(_safely(np.linalg.lstsq, rows.T, needed + plant.rotors @ joint)[0])


def gear_torques(plant: Plant, data: pin.Data, state: Array, begin: Begin) -> Array:
    """Return the torque (n,) of stiff gears on their loads, without sticking joint friction."""
    # Behind the rotors: N (tau_M - friction - I_M theta_M''), hence without armature.
    armature, plant.model.armature = plant.model.armature.copy(), np.zeros(plant.model.nv)
    motion = *state[[JOINT_POSITION, JOINT_SPEED]], begin[1][JOINT_SPEED]
    torque = inverse_dynamics(plant, data, motion)
    plant.model.armature = armature
    for index, drive in plant.functions:
        torque[index] += drive.joint_torque(*state[[JOINT_POSITION, JOINT_SPEED], index].tolist())
    torque[plant.dry_joints] += plant.joint_coulomb * begin[0].slip[len(torque) :]
    torque = torque if plant.uncoupling is None else torque @ plant.uncoupling
    return np.where(plant.elastic, np.nan, torque)


def begin_of(
    plant: Plant, data: pin.Data, state: Array, torque: Array, slip: Array | None = None
) -> Begin:
    """Return the begin of a step at a state under a motor torque.

    `slip` (n + m,) is the direction in which dry friction slips, 0 where it sticks, at the motors
    and then at the dry joints; by default the one that is consistent. Raises SeaidError if
    load-dependent friction has no solution.
    """
    y = _with_inputs(state, torque)
    return _decided(plant, data, y) if slip is None else _begin(plant, data, y, slip.tolist())


def _decided(plant: Plant, data: pin.Data, y: Array) -> Begin:
    """Return the begin of a step, with slip directions that are consistent.

    Resting places are assumed to stick; those whose constraint torque exceeds the friction level
    are released, until the others are consistent.
    """
    n, speeds = y.shape[1], friction_speeds(plant, y).tolist()
    # Zero would stick. Without a level of friction the direction has no effect.
    slip = [
        1.0 if speed > REST_RAD_S or not dry else -1.0 if speed < -REST_RAD_S else 0.0
        for speed, dry in zip(speeds, plant.is_dry.tolist(), strict=True)
    ]
    # Places are only released: at most n + m passes.
    while True:
        held, rates = begin = _begin(plant, data, y, slip)
        if 0.0 not in slip:
            return begin
        # What would move a motor on a spring by (7) alone. The friction that holds others is
        # opposite to what it holds.
        pull = np.zeros(len(slip))
        pull[:n] = free = rates[JOINT_SPEED + 2]
        if held.places.size:
            # From the drives' coordinates to the motors, where the levels of their friction are.
            pull[held.places] = -sticking_torques(plant, data, y, begin) / held.levers
        levels = friction_levels(plant, y, free, pull)
        (released,) = ((held.slip == 0) & (np.abs(pull) > levels)).nonzero()
        if not released.size:
            return begin
        for place in released.tolist():
            slip[place] = math.copysign(1.0, pull[place])


def friction_speeds(plant: Plant, state: Array) -> Array:
    """Return the speeds (n + m,) of the motors, then of the dry joints."""
    if not plant.dry_joints.size:
        return np.asarray(state[SPEED])
    return np.append(state[SPEED], state[JOINT_SPEED, plant.dry_joints])


def friction_levels(plant: Plant, y: Array, free: Array, pull: Array) -> Array:
    """Return the levels (n + m,) of dry friction at the motors, then at the dry joints.

    Friction takes the `pull` (n + m,) from the torques `free` (n,) of the motors of stiff drives
    that stick, and the rest of them is through their gears.
    """
    if not plant.functions:
        return plant.coulomb
    level = np.append(plant.coulomb, plant.joint_coulomb)
    at = drive_states(plant, y[: plant.rows]).T.tolist()
    through = plant.ratio * (free - pull[: len(free)])
    for index, drive in plant.functions:
        level[index] = of_column(drive.level, at[index], float(through[index]))
    return level


_MOST_EVENTS = 200
"""Stops and reversals of friction within a step, beyond which they would not end."""

_MOST_LINEAR = 24
"""Joints up to which the matrices of steps are worth it: those of 30 joints on springs, which often
stick and begin to slip, take more time than they save."""

Feedback = Callable[[float, Array], Array]
"""Function of the time in a step [s] and the state (4, n) that returns motor torques (n,)."""


def advance(
    plant: Plant,
    data: pin.Data,
    state: Array,
    torque: Array,
    torque_rate: Array,
    step: float,
    feedback: Feedback | None = None,
    begin: Begin | None = None,
    repeated_parts: int = 0,
) -> Array:
    """Return the state (4, n) after a step [s], with an event wherever friction stops a motion.

    The motor torque is `torque` at the start and changes with `torque_rate`; `feedback` adds what
    depends on the state. `begin` is that of the step, if it is known, and `repeated_parts` the
    number of its parts, if many steps have this length. Raises SeaidError if the state is not
    finite or the friction events do not end.
    """
    parts = max(repeated_parts, 1)
    if step > parts * plant.longest_step:
        parts *= math.ceil(step / parts / plant.longest_step)
    rates = np.zeros((plant.rows - JOINT_SPEED + 1, len(torque)))
    rates[-2] = torque_rate
    is_linear = feedback is None and not plant.functions
    is_linear = is_linear and len(torque) <= _MOST_LINEAR
    repeated = step / parts if repeated_parts and is_linear else math.nan
    part, y = _Part(plant, data, rates, feedback, repeated), _with_inputs(state, torque)
    try:
        for number in range(parts):
            y = part.advanced(y, number * step / parts, step / parts, None if number else begin)
    except OverflowError:
        raise diverged() from None
    return y[: plant.rows]


def diverged() -> SeaidError:
    """Return the error of a simulation that diverged."""
    return SeaidError("the simulation diverged: check stiffness, inertias and controller")


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a step, with the rates of the rows after the four of all states.

    Rows of hysteresis have no rate: `with_memory` moves them on with the travel, exactly. The last
    two are those of torques and slip directions. Linear steps of the `repeated` length [s] have
    their matrices.
    """

    plant: Plant
    data: pin.Data
    rates: Array
    feedback: Feedback | None
    repeated: float

    def advanced(self, y: Array, start: float, length: float, begin: Begin | None) -> Array:
        """Return a state with inputs after a time [s] that begins `start` after the step does."""
        plant, done, stuck = self.plant, 0.0, list[int]()
        for _ in range(_MOST_EVENTS):
            now = self._fed(start + done, y)
            begin = begin or _decided(plant, self.data, now)
            slip = begin[0].slip
            if stuck:
                slip = slip.copy()
                slip[stuck] = 0.0
                begin = _begin(plant, self.data, now, slip.tolist())
            y[-1] = slip[: y.shape[1]]
            rest = length - done
            new = self._after(rest, y, start + done, begin)
            after = friction_speeds(plant, new) * slip
            crossed = ((after < 0) & plant.is_dry).nonzero()[0]
            if not crossed.size:
                if not math.isfinite(np.vdot(new, new)):  # takes half the time of a sum
                    raise diverged()
                return new
            # The speed counts as linear over the step: the time of the stop has an error of its
            # square. A released motor may still creep back.
            started = np.maximum((friction_speeds(plant, y) * slip)[crossed], 0.0)
            fractions = started / (started - after[crossed])
            first, fraction = int(crossed[np.argmin(fractions)]), float(fractions.min())
            # A place that would turn round at once is held for the rest of the step: it would
            # chatter.
            if fraction * rest < 1e-12:
                stuck.append(first)
            y = self._after(fraction * rest, y, start + done, begin)
            _stop(plant, y, first, np.flatnonzero(slip == 0))
            done, begin = done + fraction * rest, None
        raise SeaidError("the simulation stopped: endless friction events within one step")

    def _fed(self, at: float, y: Array) -> Array:
        """Return a state with inputs, with the torques of the feedback."""
        if self.feedback is None:
            return y
        y = y.copy()
        y[-2] += self.feedback(at, y)
        return y

    def _after(self, step: float, y: Array, start: float, begin: Begin) -> Array:
        """Return a state with inputs after a step of Runge and Kutta, by the slip of its begin."""
        if step == self.repeated:
            return self._after_repeated(y, begin)

        def moved(by: Array) -> Array:
            return with_memory(self.plant, y, y + by)

        def rate(at: float, state: Array) -> Array:
            driven = _driven(self.plant, self.data, self._fed(start + at, state), begin[0])
            driven[JOINT_SPEED + 1 :] = self.rates
            return driven

        half, k1 = 0.5 * step, begin[1].copy()
        k1[JOINT_SPEED + 1 :] = self.rates
        k2 = rate(half, moved(half * k1))
        k3 = rate(half, moved(half * k2))
        k4 = rate(step, moved(step * k3))
        return moved(step / 6 * (k1 + k4 + 2 * (k2 + k3)))

    def _after_repeated(self, y: Array, begin: Begin) -> Array:
        """Return `_after` a step of the repeated length."""
        (held, driven), n = begin, y.shape[1]
        stages, end = _step_matrices(self.plant, held.motors, self.repeated)
        # The first acceleration is that of the begin; the others follow stage by stage.
        accelerations = driven[JOINT_SPEED], np.zeros(3 * n)
        values = np.concatenate((y.reshape(-1), self.rates[-2], *accelerations))
        for stage in stages:
            known = stage.shape[1]
            x = stage.dot(values[:known])
            joint = _accelerations(self.plant, self.data, held, x[:n], x[n:-n], x[-n:])
            values[known : known + n] = joint
        return np.asarray(end.dot(values).reshape(-1, n))


@lru_cache(maxsize=16)
def _step_matrices(
    plant: Plant, resting: tuple[int, ...], step: float
) -> tuple[list[Array], Array]:
    """Return the matrices of a step [s] of Runge and Kutta in which some motors stick.

    All but the joint accelerations is linear. The matrices of the stages after the first give joint
    positions, speeds and torques on the joints (3n), the last one the state with inputs (6n) after
    the step, by x, which is that before it and the torque rates (7n), and the joint accelerations
    (n) of each stage so far.
    """
    n, D = len(plant.elastic), plant.drive_matrix
    known, is_free = np.eye(11 * n), ~np.isin(np.arange(n), resting)[:, None]
    x, accelerations = known[: 7 * n], known[7 * n :].reshape(4, n, -1)

    def rate(at: Array, joint: Array) -> Array:
        motor = is_free * (D[n : 2 * n] @ at[: 6 * n] + plant.turning @ joint)
        return np.concatenate([at[n : 2 * n], motor, at[3 * n : 4 * n], joint, at[6 * n :], still])

    still = np.zeros((2 * n, 11 * n))  # slip directions and torque rates
    slopes, stages = [rate(x, accelerations[0])], []
    for number, part in ((1, 0.5), (2, 0.5), (3, 1.0)):
        at = x + part * step * slopes[-1]
        acting = np.concatenate([at[2 * n : 4 * n], D[4 * n : 5 * n] @ at[: 6 * n]])
        stages.append(acting[:, : (7 + number) * n].copy())
        slopes.append(rate(at, accelerations[number]))
    k1, k2, k3, k4 = slopes
    return stages, (x + step / 6 * (k1 + k4 + 2 * (k2 + k3)))[: 6 * n]


def _stop(plant: Plant, state: Array, first: int, resting: IndexArray) -> None:
    """Set the speed of a motor or dry joint to zero, and that of stiff motors accordingly."""
    n = len(plant.elastic)
    if first < n:
        state[SPEED, first] = 0.0
        if plant.elastic[first]:
            return
    # No impulse: these speeds are zero but for the error of the time, which the projection removes.
    sticking = np.append(resting[plant.acts_on_load[resting]], first)
    state[JOINT_SPEED] = without_sticking(plant, state[JOINT_SPEED], sticking)
    if plant.coupling is not None:
        turning = plant.ratio * (plant.coupling @ state[JOINT_SPEED])
        stiff = ~plant.elastic
        stiff[sticking[sticking < n]] = False
        state[SPEED, stiff] = turning[stiff]
