"""replay: drive a model with the logged motor inputs, forward in time.

The strictest validation of a model: no measured position or acceleration enters after the start,
and errors accumulate. `compare_replays` says how much better one model replays a log than another.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from seaid._arrays import Array, IndexArray
from seaid._progress import Result, sampled_text
from seaid.checks.predictions import not_replayed, other_inertias, replay_worse
from seaid.drives import COMMANDS, IDEAL_DRIVE, PARAMETERS_OF, Drive
from seaid.errors import Finding, LogError, RobotError, SeaidError, checked
from seaid.log import Log, low_pass, select_cutoff
from seaid.log.filtering import spline_derivatives
from seaid.log.usable_parts import check_whole
from seaid.robot import Robot, at_drives
from seaid.robot.robot import check_held
from seaid.robot.transmission import group_of
from seaid.simulation.controller import (
    CommandedSteps,
    PositionControllers,
    input_gain,
    position_controllers,
)
from seaid.simulation.forward_dynamics import Feedback, advance, diverged
from seaid.simulation.plant import (
    JOINT_POSITION,
    JOINT_SPEED,
    POSITION,
    SPEED,
    Plant,
    effective_inertia,
    plant_of,
    warmed,
)

_LONGEST_STEP_S = 1e-3
"""Longest step with the torques of a log."""

_LEAST_CLOSED_S, _MOST_CLOSED_S = 5e-4, 2e-3
"""Shortest and longest of the longest steps with controllers."""

FARTHEST = 1e6
"""Position [rad or m] that only a simulation that diverges comes to."""

Command = Callable[[float, Array], Array]
"""Function of time [s] and joint positions (n,) that returns motor inputs (n,)."""


@checked(SeaidError)
def replay(robot: Robot, log: Log, command: Command | None = None) -> Log:
    """Simulate a robot from the first state of a log, with the motor inputs of the log.

    Parameters
    ----------
    robot : Robot
        The model, with values of all parameters.
    log : Log
        The log with the start and, without `command`, the inputs of all motors: torque, current or
        voltage, by each drive's `motor_input`. With a position command, the drive's controller
        closes the loop on the model's own position, with the delay of the command.
    command : callable, optional
        Function (time [s], joint positions (n,)) -> motor inputs (n,), for example a position
        servo with known gains; it is called with the model's own positions.

    Returns
    -------
    Log
        The model's motor and joint positions and motor torques at the log's times.

    Raises
    ------
    LogError
        If an input or the first state is missing in the log, or if the log has a hole in time.
    RobotError
        If the robot has no value for a parameter.

    Examples
    --------
    >>> replayed = seaid.replay(result.robot, log)
    >>> np.std(replayed.joint_position - log.joint_position, axis=0)
    """
    check_held(robot, "replay", why="seaid does not simulate contacts")
    check_whole(log)
    return rollout(robot, log, command)


def rollout(
    robot: Robot,
    log: Log,
    command: Command | None = None,
    longest_closed_s: float | None = None,
    held: Mapping[int, Array] = MappingProxyType({}),
) -> Log:
    """Return the `replay` of a whole log, with the longest step under a controller.

    The joints `held` {index: position and speed (2, T)} pass through these states at each sample.
    """
    plant, order = plant_of(robot), robot.joint_order
    back = np.argsort(order)
    controllers = position_controllers(robot, log) if command is None else None
    motor_input = _logged(robot, log) if command is None else command
    gains = np.array([input_gain(robot, joint) for joint in robot.joint_names])
    data = plant.model.createData()
    state = np.zeros((plant.rows, robot.n))
    state[: JOINT_SPEED + 1] = _start(robot, log)[:, order]
    shape = (len(log.time), robot.n)
    joint, motor, torques = np.empty(shape), np.empty(shape), np.empty(shape)
    warmth = _warmth(robot, log)
    longest = _LONGEST_STEP_S
    if controllers is not None:
        longest = longest_closed_s or _longest_closed_s(plant, controllers, back)
    for tick, (at, steps, feedbacks) in enumerate(_ticks(log.time, longest, controllers, back)):
        for index, states in held.items():
            # `index` is that of the robot, columns of a state are those of the model; the drive of
            # a held joint has ratio 1, so that its motor moves as the joint does
            state[: JOINT_SPEED + 1, order.index(index)] = np.tile(states[:, tick], 2)
        joint[tick], motor[tick] = state[JOINT_POSITION, back], state[POSITION, back]
        (positions,) = robot.joint_states(state[JOINT_POSITION, back])
        torques[tick] = gains * motor_input(at, positions)
        if feedbacks is not None:
            # controllers close the loop on the model: their torque is that of its state now
            torques[tick] += feedbacks[0](0.0, state)[back]
        if tick + 1 == len(log.time):
            break
        since = float(at - log.time[0])
        warm_plant = warmed(plant, None if warmth is None else warmth[tick, order], since)
        step = (log.time[tick + 1] - at) / steps
        for part in range(steps):
            start = at + part * step
            (positions,) = robot.joint_states(state[JOINT_POSITION, back])
            now = gains * motor_input(start, positions)
            later = now  # a command is held over a step, as a digital controller does it
            if command is None:  # a logged input is linear between its samples
                later = gains * motor_input(start + step, positions)
            feedback = None if feedbacks is None else feedbacks[part]
            rate = (later - now)[order] / step
            state = advance(warm_plant, data, state, now[order], rate, step, feedback)
        if not np.all(np.abs(state[JOINT_POSITION]) < FARTHEST):
            raise diverged()
    return Log(
        time=log.time,
        joint_names=robot.joint_names,
        motor_position=motor,
        joint_position=robot.joint_states(joint)[0],
        motor_torque=torques,
        is_prismatic=robot.is_prismatic,
    )


_STEP_SHARE = 0.2
"""Longest step over the time constants of the loops: the fourth-order error of a step is 3e-6."""


def _longest_closed_s(plant: Plant, controllers: PositionControllers, back: IndexArray) -> float:
    """Return the longest step [s] for the loops of motors, or motors with their loads."""
    places = back[controllers.index]
    # a motor on a spring is fast alone; behind a stiff gear it moves its load
    rotors = plant.motor_inertia * plant.ratio**2
    inertia = np.where(plant.elastic, rotors, effective_inertia(plant))[places]
    damping = controllers.velocity_gain + (plant.viscous * plant.ratio**2)[places]
    # over the inertia J: sqrt(K_p / J) of the position loop, and damping / J of the speed
    rates = np.sqrt(controllers.position_gain * inertia), damping
    fastest = float(np.max(np.maximum(*rates) / np.maximum(inertia, np.finfo(float).tiny)))
    return float(np.clip(_STEP_SHARE / max(fastest, 1e-9), _LEAST_CLOSED_S, _MOST_CLOSED_S))


_BLOCK = 4096
"""Samples of a log whose commands are computed at once."""

Tick = tuple[float, int, Sequence[Feedback] | None]


def _ticks(
    time: Array, longest_s: float, controllers: PositionControllers | None, back: IndexArray
) -> Iterator[Tick]:
    """Yield the time of each sample, the steps to the next one, and the controllers in each."""
    # an interval of whole steps but for rounding needs no further one; the last sample has none,
    # and gets one dummy step for the torque that is logged there
    steps = np.append(np.ceil(np.diff(time) / longest_s - 1e-9), 1.0).astype(int)
    lengths = np.append(np.diff(time), longest_s) / steps
    for begin in range(0, len(time), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        ends = np.cumsum(steps[block])
        length = np.repeat(lengths[block], steps[block])
        # `ends` are one past the last step of each interval, `part` the number of a step in its own
        part = np.arange(ends[-1]) - np.repeat(ends - steps[block], steps[block])
        start = np.repeat(time[block], steps[block]) + part * length
        commanded = None if controllers is None else controllers.during(start, length)
        for at, end, count in zip(time[block], ends, steps[block], strict=True):
            feedbacks = None
            if controllers is not None and commanded is not None:
                rows = range(end - count, end)
                feedbacks = [_feedback(controllers, commanded, row, back) for row in rows]
            yield float(at), int(count), feedbacks


def _feedback(
    controllers: PositionControllers, commanded: CommandedSteps, row: int, back: IndexArray
) -> Feedback:
    """Return the torques of the controllers in a step, in the order of the plant's joints."""
    places = back[controllers.index]
    first, supply = commanded.first[row], commanded.supply[row]
    rate = (commanded.last[row] - first) / commanded.length_s[row]

    def torque(at: float, state: Array) -> Array:
        torques = np.zeros(len(back))
        moving = state[POSITION, places], state[SPEED, places]
        torques[places] = controllers.torque(first + rate * at, supply, *moving)
        return torques

    return torque


def _column(log: Log, field: str, joint: str) -> Array:
    """Return the samples (T,) of one sensor of one joint."""
    values: Any = getattr(log, field)
    known = joint in log.joint_names and values is not None
    column: Array = values[:, log.joint_names.index(joint)] if known else np.array([np.nan])
    if not np.all(np.isfinite(column)):
        raise LogError(f"replay: the log has no {field.replace('_', ' ')} of '{joint}'")
    return column


def _warmth(robot: Robot, log: Log) -> Array | None:
    """Return the temperatures (T, n) of motors whose friction depends on it; None without any."""
    warm = [joint for joint in robot.joint_names if robot.drives[joint].has_temperature_terms]
    temperatures = np.zeros((len(log.time), robot.n))
    for joint in warm:
        temperatures[:, robot.index(joint)] = _column(log, "motor_temperature", joint)
    return temperatures if warm else None


_START_SHARE, _START_S = 0.01, 0.1
"""Standard error of the start's speed over the rms speed, and longest part from which it comes."""


def _first(log: Log, field: str, joint: str) -> tuple[float, float]:
    """Return the first position of a joint or motor, and its speed, by a cubic.

    The slope at the end of a cubic through N samples of noise s, dt apart, has the standard error
    sqrt(1200 / N^3) s / dt: the least N with `_START_SHARE` is taken, within `_START_S`.
    """
    position = _column(log, field, joint)[:, None]
    speed = np.sqrt(np.mean(spline_derivatives(log.time, position)[1] ** 2))
    step = (log.time[-1] - log.time[0]) / (len(log.time) - 1)
    error = _noise(position)[0] / step / max(_START_SHARE * speed, np.finfo(float).tiny)
    # sqrt(1200 / N^3) s / dt <= share speed, solved for N; a cubic needs four samples
    count = int(np.clip((1200 * min(error, 1e9) ** 2) ** (1 / 3), 4, max(4, _START_S / step)))
    cubic = np.polyfit(log.time[:count] - log.time[0], position[:count, 0], 3)
    return float(cubic[-1]), float(cubic[-2])


def _logged(robot: Robot, log: Log) -> Command:
    """Return the logged motor inputs as a function of time, interpolated linearly."""
    inputs = {
        robot.index(joint): _column(log, f"motor_{drive.motor_input}", joint)
        for joint, drive in robot.drives.items()
        if drive.motor_input not in COMMANDS
    }

    def interpolated(at: float, _: Array) -> Array:
        # motors that follow commands have no input here: `PositionControllers` gives their torques
        values = np.zeros(robot.n)
        for index, samples in inputs.items():
            values[index] = np.interp(at, log.time, samples)
        return values

    return interpolated


def _start(robot: Robot, log: Log) -> Array:
    """Return the first state (4, n) of a log; motors of stiff drives follow their joints."""
    state = np.zeros((4, robot.n))
    for index, joint in enumerate(robot.joint_names):
        state[[JOINT_POSITION, JOINT_SPEED], index] = _first(log, "joint_position", joint)
    behind = slice(JOINT_POSITION, JOINT_SPEED + 1)
    state[behind] = robot.drive_states(*state[behind])
    position, speed = at_drives(robot.transmission, state[behind])
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if drive.is_elastic:
            state[[POSITION, SPEED], index] = _first(log, "motor_position", joint)
        else:
            state[POSITION, index] = drive.ratio * position[index]
            state[SPEED, index] = drive.ratio * speed[index]
    return state


@dataclass(frozen=True, eq=False, repr=False)
class ReplayComparison(Result):
    """The replays of one log by two models of a robot.

    Attributes
    ----------
    joints : tuple of n str
        The n joints that were simulated.
    time : ndarray (T,)
        Time [s].
    measured, before, after : ndarray (T, n)
        Joint positions [rad or m]: of the log, and of both models.
    noise : ndarray (n,)
        Standard deviation of the noise of the measured positions.
    is_prismatic : tuple of bool
        One entry per joint.
    warnings : tuple of Finding
        Joints that the second model replays worse than the first one, and joints that were held.
    """

    table_name = "replay_table"

    joints: tuple[str, ...]
    time: Array
    measured: Array
    before: Array
    after: Array
    noise: Array
    is_prismatic: tuple[bool, ...]
    warnings: tuple[Finding, ...] = ()

    @property
    def mean_absolute_errors(self) -> tuple[Array, Array]:
        """Mean absolute errors (n,) before and after [rad or m]."""
        before, after = (np.abs(q - self.measured) for q in (self.before, self.after))
        return before.mean(axis=0), after.mean(axis=0)

    @property
    def rms_errors(self) -> tuple[Array, Array]:
        """Rms errors (n,) before and after [rad or m]."""
        before, after = (np.square(q - self.measured) for q in (self.before, self.after))
        return np.sqrt(before.mean(axis=0)), np.sqrt(after.mean(axis=0))

    @property
    def mean_errors(self) -> dict[str, list[float]]:
        """Means over joints {"mrad" or "mm": absolute before, after, rms before, after}, in SI."""
        errors = np.array([*self.mean_absolute_errors, *self.rms_errors])
        slides = np.asarray(self.is_prismatic, dtype=bool)
        kinds = {"mrad": errors[:, ~slides], "mm": errors[:, slides]}
        return {unit: kind.mean(axis=1).tolist() for unit, kind in kinds.items() if kind.size}

    def _in_short(self) -> str:
        before, after = (
            ", ".join(f"{1e3 * mean[place]:.3g} {unit}" for unit, mean in self.mean_errors.items())
            for place in (0, 1)
        )
        errors = f"mean absolute error {before} before, {after} after"
        return f"{sampled_text(self.time, self.joints)}: {errors}"

    def to_dict(self) -> dict[str, Any]:
        """Return the errors by joint and their means, as plain data.

        Joints of two units, rad and m, have no mean: it is None.
        """
        errors = {"mean_absolute_error": self.mean_absolute_errors, "rms_error": self.rms_errors}
        by_joint = {
            joint: {
                "unit": "m" if self.is_prismatic[index] else "rad",
                "noise": float(self.noise[index]),
                "before": {name: float(error[0][index]) for name, error in errors.items()},
                "after": {name: float(error[1][index]) for name, error in errors.items()},
            }
            for index, joint in enumerate(self.joints)
        }
        means_by_unit = [*self.mean_errors.values()]
        mean = means_by_unit[0] if len(means_by_unit) == 1 else (None, None)
        whole = {"before": mean[0], "after": mean[1]}
        return {"joints": by_joint, "mean_absolute_error": whole}


@checked(SeaidError)
def compare_replays(
    before: Robot, after: Robot, log: Log, held_joints: Mapping[str, str] = MappingProxyType({})
) -> ReplayComparison:
    """Replay a log by two models, as before and after an identification.

    Parameters
    ----------
    before, after : Robot
        Models of one robot. A term of friction, a rotor inertia and a delay without a value count
        as zero in `before`, and what else it lacks is that of `after`, such as a stiffness.
    log : Log
        The log as of `replay`, best one that was not used for the identification.
    held_joints : mapping {joint: reason}, optional
        Joints that follow their measured motion in place of their model, as those of
        `Identification.unusable_joints`. The comparison is that of the others.

    Returns
    -------
    ReplayComparison

    Raises
    ------
    LogError, RobotError
        As `replay`, if the robots have different joints, and if all joints are held.

    Examples
    --------
    >>> held = result.unusable_joints
    >>> seaid.compare_replays(result.known, result.robot, log, held).mean_absolute_errors
    """
    if before.joint_names != after.joint_names:
        raise SeaidError(
            f"before=: the joints {', '.join(before.joint_names)}, but after= has "
            f"{', '.join(after.joint_names)}: give two models of one robot"
        )
    check_held(after, "replay", why="seaid does not simulate contacts")
    check_whole(log)
    held = _held_joints(after, held_joints)
    joints = tuple(joint for joint in after.joint_names if joint not in held)
    if not joints:
        raise SeaidError(f"no joint is left to replay: {'; '.join(map(': '.join, held.items()))}")
    log, states = _with_measured_motion(after, log, held)
    models = {"nominal": without_unknown_terms(before, after), "identified": after}
    notes = [not_replayed(joint, reason) for joint, reason in held.items()]
    indices = [after.index(joint) for joint in joints]
    moved = []
    for title, model in models.items():
        model = model.with_drives(dict.fromkeys(held, _FOLLOWING))
        moved.append(_replayed(title, model, log, states, notes).joint_position[:, indices])
    measured = log.joint_position[:, [log.joint_names.index(joint) for joint in joints]]
    comparison = ReplayComparison(
        joints=joints,
        time=log.time,
        measured=measured,
        before=moved[0],
        after=moved[1],
        noise=_noise(measured),
        is_prismatic=tuple(after.is_prismatic[index] for index in indices),
    )
    return replace(comparison, warnings=(*_worse(comparison, after), *notes))


def _worse(comparison: ReplayComparison, after: Robot) -> Iterator[Finding]:
    """Yield the findings about joints that the second model replays worse than the first one."""
    joints = comparison.joints
    # noise is part of both, so that two replays within the noise count as equally good
    errors = (np.hypot(rms, comparison.noise).tolist() for rms in comparison.rms_errors)
    old, new = (dict(zip(joints, error, strict=True)) for error in errors)
    ratios = {joint: new[joint] / max(old[joint], np.finfo(float).tiny) for joint in joints}
    units = ["mm" if slides else "mrad" for slides in comparison.is_prismatic]
    return replay_worse(new, ratios, units, all(after.drives[x].controller for x in joints))


_FOLLOWING = replace(IDEAL_DRIVE, motor_inertia_kg_m2=1e6)
"""The drive of a joint that follows a motion: with so much inertia [kg m^2 or kg], torques of
100 N m change its acceleration by 1e-4 rad/s^2."""


def _held_joints(robot: Robot, held: Mapping[str, str]) -> dict[str, str]:
    """Return the joints that are held {joint: reason}, with those that their drives move too."""
    reasons = dict(held)
    for joint, reason in held.items():
        for index in group_of(robot.transmission, robot.index(joint)):
            reasons.setdefault(robot.joint_names[index], f"it moves with {joint}: {reason}")
    return reasons


def _with_measured_motion(
    robot: Robot, log: Log, held: Collection[str]
) -> tuple[Log, dict[int, Array]]:
    """Return the log with the torques that accelerate held joints, and their states (2, T).

    They are those of the measured motion below its proposed cutoff.
    """
    torque, states = log.motor_torque.copy(), dict[int, Array]()
    rate_hz = (len(log.time) - 1) / float(log.time[-1] - log.time[0])
    for joint in held:
        position = _column(log, "joint_position", joint)[:, None]
        cutoff = select_cutoff(position, np.full_like(position, np.nan), rate_hz, (joint,))
        smooth = low_pass(position, rate_hz, cutoff.cutoff_hz)
        q, v, a = (derivative[:, 0] for derivative in spline_derivatives(log.time, smooth))
        torque[:, log.joint_names.index(joint)] = (_FOLLOWING.motor_inertia_kg_m2 or 0.0) * a
        states[robot.index(joint)] = np.array([q, v])
    return replace(log, motor_torque=torque), states


_STEPS_PER_RADIAN = 10.0
"""Steps of a simulation per radian of the oscillation of a rotor alone under its controller."""


def _replayed(
    title: str, robot: Robot, log: Log, held: Mapping[int, Array], notes: list[Finding]
) -> Log:
    """Return a replay; one that diverges is repeated with rotor inertias that it can follow.

    Light links without a rotor inertia oscillate faster than the steps of a simulation under their
    controllers. Adds a note for that. Raises SeaidError if the repetition fails, too.
    """
    robot = _with_least_inertias(title, robot, notes)
    try:
        return rollout(robot, log, held=held)
    except SeaidError as problem:
        drives = {joint: _slower(drive) for joint, drive in robot.drives.items()}
        changed = [joint for joint, drive in drives.items() if drive is not robot.drives[joint]]
        if not changed or isinstance(problem, LogError | RobotError):
            raise
        replayed = rollout(robot.with_drives(drives), log, held=held)
    ratios = {joint: robot.drives[joint].ratio for joint in changed}
    inertias = {
        joint: drives[joint].values["motor_inertia"] * ratio**2 for joint, ratio in ratios.items()
    }
    notes.append(other_inertias(title, inertias))
    return replayed


_LEAST_TIME_S = 1e-3
"""Least time constant of inertia and viscous friction at a joint under its controller: a joint that
has less follows its torque as late as that, and is not simulated in steps of microseconds."""


def _with_least_inertias(title: str, robot: Robot, notes: list[Finding]) -> Robot:
    """Return the robot with enough rotor inertia at joints that have friction and hardly any."""
    plant, back = plant_of(robot), np.argsort(robot.joint_order)
    inertias = effective_inertia(plant)[back]
    drives, raised = dict(robot.drives), {}
    for index, (joint, drive) in enumerate(robot.drives.items()):
        if drive.controller is None or drive.is_elastic:
            continue
        friction = drive.values.get("viscous_friction", 0.0) * drive.ratio**2
        # time constant J / (N^2 F_v)
        lack = _LEAST_TIME_S * friction - inertias[index]
        if lack > 0:
            rotor_inertia = drive.values.get("motor_inertia", 0.0) + lack / drive.ratio**2
            drives[joint] = drive.with_values({"motor_inertia": rotor_inertia})
            raised[joint] = rotor_inertia * drive.ratio**2
    if raised:
        reason = f"viscous friction stops joints within {1e3 * _LEAST_TIME_S:g} ms"
        notes.append(other_inertias(title, raised, reason))
    return robot.with_drives(drives)


def _slower(drive: Drive) -> Drive:
    """Return a drive whose rotor is slow enough for the steps of a simulation."""
    law, rotor_inertia = drive.law, drive.values.get("motor_inertia", 0.0)
    if law is None:
        return drive
    # rotor alone: sqrt(K_p / J) dt <= 1 / steps per radian and K_d / J dt <= 1 at the shortest dt
    spring = law.position_gain_Nm_per_rad * (_STEPS_PER_RADIAN * _LEAST_CLOSED_S) ** 2
    least = max(spring, law.velocity_gain_Nms_per_rad * _LEAST_CLOSED_S) / drive.ratio**2
    return drive if rotor_inertia >= least else drive.with_values({"motor_inertia": least})


def without_unknown_terms(robot: Robot, identified: Robot | None = None) -> Robot:
    """Return the robot without the friction, rotor inertia and delays that have no value.

    What else its drives lack, such as a stiffness, is that of the identified robot.
    """
    drives = (identified or robot).drives
    return robot.with_drives({x: _plain(y, drives[x].values) for x, y in robot.drives.items()})


def _plain(drive: Drive, values: Mapping[str, float]) -> Drive:
    known, terms = {*drive.values}, PARAMETERS_OF["friction"]
    kept = tuple(term for term in drive.friction if known.issuperset(terms[term]))
    plain = replace(drive, friction=kept, motor_inertia_kg_m2=drive.motor_inertia_kg_m2 or 0.0)
    lacking = {*plain.parameter_names}.difference(plain.values).intersection(values)
    return plain.with_values({name: values[name] for name in lacking})


def _noise(position: Array) -> Array:
    """Return the standard deviation (n,) of the noise of positions (T, n), or of their steps.

    That of a third difference of white noise is sqrt(20) times its own, 1.4826 times the median of
    its size; a smooth motion leaves little of itself in third differences.
    """
    white = 1.4826 * np.median(np.abs(np.diff(position, 3, axis=0)), axis=0) / np.sqrt(20)
    steps = np.abs(np.diff(position, axis=0))
    least = np.min(np.where(steps > 0, steps, np.inf), axis=0)
    has_steps = np.any(steps == 0, axis=0) & np.isfinite(least)  # samples within one step repeat
    return np.asarray(np.maximum(white, np.where(has_steps, least, 0.0) / np.sqrt(12)))
