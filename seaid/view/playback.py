"""Playback: a planned or logged motion over time, with the torques and deflections along it.

Traces are measured torques and spring deflections, and those of a robot's values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array, frozen
from seaid.drives import friction_curve, total_ratio
from seaid.drives.terms import MOTOR_CONSTANTS
from seaid.errors import ExcitationError, LogError, SeaidError
from seaid.excitation import Excitation, Trajectory
from seaid.excitation.flatness import (
    check_nominal_bodies,
    load_torques,
    parallel_elements,
    transmission,
)
from seaid.log import Log, Motion, in_band
from seaid.log.motion import reconstruct_motions
from seaid.log.rows import inside_transients
from seaid.regressor.regression import INPUT_FIELDS
from seaid.robot import Robot, at_drives, at_joints, torques_at_drives

MEASURED, NOMINAL, IDENTIFIED = SOURCES = ("measured", "nominal", "identified")

_SAMPLES = 600
"""Instants of a plot, about two per pixel."""

States = tuple[Array, Array, Array]
"""Position, velocity and acceleration, each (T, n)."""

Signals = tuple[Array, Array, Array]
"""Time (T,) of a stretch, torques and deflections (T, n)."""


@dataclass(frozen=True, eq=False)
class Traces:
    """Torque and spring deflection over `time` (G,) [s], as plots show them.

    `torque` [N m, or N] and `deflection` [rad or m] are {source: (G, n)}: "measured", and the
    models with values, "nominal" and "identified". Deflections are about the mean of the first
    source, because encoder offsets are unknown. `at_motor` (n,): whether the torque is that of the
    motor, and not that at the joint.
    """

    time: Array
    torque: Mapping[str, Array]
    deflection: Mapping[str, Array]
    at_motor: tuple[bool, ...]


def traces_of(
    duration: float, sources: Mapping[str, Sequence[Signals]], at_motor: tuple[bool, ...]
) -> Traces:
    """Return the signals of each source, in stretches of time, at the instants of a plot."""
    grid = np.linspace(0.0, duration, _SAMPLES)
    torque, deflection = {}, {}
    for source in sorted(sources, key=SOURCES.index):
        torque[source] = _sampled(grid, [(time, tau) for time, tau, _ in sources[source]])
        deflection[source] = _sampled(grid, [(time, d) for time, _, d in sources[source]])
    return Traces(frozen("time", grid, (None,)), torque, _about_mean(deflection), at_motor)


def _sampled(grid: Array, stretches: Sequence[tuple[Array, Array]]) -> Array:
    """Return stretches (time, values) at the instants of a grid (G, n), NaN between them."""
    sampled = np.full((len(grid), stretches[0][1].shape[1]), np.nan)
    for time, values in stretches:
        inside = (grid >= time[0]) & (grid <= time[-1])
        for column, signal in zip(sampled.T, values.T, strict=True):
            column[inside] = np.interp(grid[inside], time, signal)
    return sampled


def _about_mean(deflection: Mapping[str, Array]) -> dict[str, Array]:
    """Return deflections without the mean of the first source, the others aligned to it."""
    aligned: dict[str, Array] = {}
    for source, values in deflection.items():
        first = next(iter(aligned.values()), np.zeros_like(values))
        # An encoder offset shifts a whole trace: the mean difference to the first one is taken off.
        error = values - first
        known = np.isfinite(error)
        count = np.maximum(np.sum(known, axis=0), 1)
        aligned[source] = values - np.sum(np.where(known, error, 0.0), axis=0) / count
    return aligned


Models = Mapping[str, Robot]
"""The robot with its nominal values, and with the identified ones if there are any."""


def _logged_traces(
    models: Models, log: Log | Motion, columns: list[int], deflection: Array
) -> tuple[Traces, list[str]]:
    """Return the traces of a log, and why a model has none.

    `columns` are those of the robot's joints, and `deflection` (T, n) is the measured one. All pass
    the low pass of an identification, if the log is good enough for one, whose transients are
    excluded at the ends.
    """
    start, robot = log.time[0], models[NOMINAL]
    valued = models.get(IDENTIFIED, robot)
    raw, at_motor = _measured_torque(valued, log, columns)
    duration, sources = float(log.time[-1] - start), dict[str, list[Signals]]()
    try:
        motions = [log] if isinstance(log, Motion) else reconstruct_motions(robot, log)
    except SeaidError as problem:
        sources[MEASURED] = [(log.time - start, raw, deflection)]
        return traces_of(duration, sources, at_motor), [f"torques are not computed: {problem}"]
    unknown: dict[str, SeaidError] = {}
    for motion in motions:
        order = columns if motion is log else list(range(robot.n))
        joint, motor = (_states(motion, side, order) for side in ("joint", "motor"))
        time = motion.time - start
        signals, unknown = _predicted(models, time, joint, motor, at_motor)
        torque, _ = _measured_torque(valued, motion, order)
        signals[MEASURED] = time, torque, _sampled(motion.time, [(log.time, deflection)])
        for source, (_, *values) in signals.items():
            torque, deflected = (_smooth(motion, of_joints) for of_joints in values)
            sources.setdefault(source, []).append((time, torque, deflected))
    notes = [
        f"torques of the {name} model are not computed: {problem.reason}"
        for name, problem in unknown.items()
    ]
    return traces_of(duration, sources, at_motor), notes


def _smooth(motion: Motion, values: Array) -> Array:
    """Return values (T, n) below the cutoff of a motion, NaN in the transients at its ends."""
    # A channel is logged whole or is NaN throughout; the filter would spread NaN.
    smooth, known = np.full(values.shape, np.nan), np.isfinite(values[0])
    smooth[:, known] = in_band(motion, values[:, known])
    smooth[~inside_transients(motion)] = np.nan
    return smooth


def _states(motion: Motion, side: str, columns: list[int]) -> States:
    """Return the states of one side of a motion."""
    kinds = ("position", "velocity", "acceleration")
    q, v, a = (getattr(motion, f"{side}_{kind}")[:, columns] for kind in kinds)
    return q, v, a


def _measured_torque(
    robot: Robot, log: Log | Motion, columns: list[int]
) -> tuple[Array, tuple[bool, ...]]:
    """Return the logged torque (T, n) and whether it is that of the motor.

    A current or voltage counts by the constant of the drive, if it is known.
    """
    torque, at_motor = log.motor_torque[:, columns].copy(), []
    for index, joint in enumerate(robot.joint_names):
        drive, column = robot.drives[joint], columns[index]
        inputs = getattr(log, INPUT_FIELDS[drive.motor_input])
        if drive.motor_input in MOTOR_CONSTANTS and inputs is not None:
            constant = drive.values.get(MOTOR_CONSTANTS[drive.motor_input], np.nan)
            torque[:, index] = constant * inputs[:, column]
        sensed = None if log.joint_torque is None else log.joint_torque[:, column]
        if np.isnan(torque[0, index]) and sensed is not None and np.isfinite(sensed[0]):
            torque[:, index] = sensed
            at_motor.append(False)
        else:
            at_motor.append(True)
    return torque, tuple(at_motor)


def _predicted(
    models: Models, time: Array, joint: States, motor: States | None, at_motor: tuple[bool, ...]
) -> tuple[dict[str, Signals], dict[str, SeaidError]]:
    """Return the torques and deflections of the models, and why one has none."""
    signals, unknown = {}, {}
    for name, model in models.items():
        try:
            signals[name] = (time, *_prediction(model, time, joint, motor, at_motor))
        except SeaidError as problem:
            unknown[name] = problem
    return signals, unknown


_SIGN_WIDTH = 1e-3
"""Dry friction changes its sign over this share of the top speed, within one sample of a plot."""


def _prediction(
    robot: Robot, time: Array, joint: States, motor: States | None, at_motor: tuple[bool, ...]
) -> tuple[Array, Array]:
    """Return torques [N m or N] and deflections at the drives' outputs [rad or m], each (T, n).

    By (7) and (8) with the values of a robot, along the motion of its joints. The motor side is
    that of the joints and the springs where it is NaN or None. NaN for the motor torque of a drive
    without all values, and for the deflection without a spring. Raises ExcitationError for a body
    or a spring without values.
    """
    drives = transmission(robot)
    check_nominal_bodies(robot)
    top_speed = np.maximum(np.max(np.abs(joint[1]), axis=0), 1e-6)
    parallel = parallel_elements(robot, top_speed, robot.joint_names)
    torque = load_torques(robot, parallel, joint)
    load = torques_at_drives(robot.transmission, torque)
    deflection = drives.spring_deflection(load)[0]
    # (3): theta_M = N / r_M (r_L phi + d)
    angle = drives.ratio * at_drives(robot.transmission, joint[0]) + drives.lever * deflection
    nothing = np.full(angle.shape, np.nan)
    _, speed, acceleration = (nothing, nothing, nothing) if motor is None else motor
    # Of a motor without an encoder: theta_M by (3), differentiated.
    speed = np.where(np.isnan(speed), np.gradient(angle, time, axis=0), speed)
    acceleration = np.where(np.isnan(acceleration), np.gradient(speed, time, axis=0), acceleration)
    for index in np.flatnonzero(at_motor).tolist():
        states = speed[:, index], acceleration[:, index], load[:, index]
        torque[:, index] = _motor_torque(robot, index, *states)
    # (3): the deflection r_M/N theta_M - r_L phi over r_L is an angle at the output of the drive.
    radius = np.array([robot.drives[name].load_radius for name in robot.joint_names])
    return torque, np.where(drives.lever > 0, deflection / radius, np.nan)


def _motor_torque(
    robot: Robot, index: int, speed: Array, acceleration: Array, load: Array
) -> Array:
    """Return the motor torque (T,) by (7) under a load at the drive's output; NaN if unknown."""
    joint = robot.joint_names[index]
    drive, width = robot.drives[joint], _SIGN_WIDTH * max(float(np.max(np.abs(speed))), 1e-6)
    inertia = np.nan if drive.motor_inertia_kg_m2 is None else drive.motor_inertia_kg_m2
    try:
        friction = friction_curve(joint, drive).torque(speed, load, sign_width=width)[0]
    except ExcitationError:  # a value is missing
        return np.full(len(speed), np.nan)
    # (7) with the torque of spring or gear at the motor, r_M/N F_s = r_M/(N r_L) tau_phi
    return np.asarray(inertia * acceleration + friction + load / total_ratio(drive))


Shown = Log | Motion | Trajectory | Excitation

_PLAN_RATE_HZ = 500.0


@dataclass(frozen=True, eq=False)
class Playback:
    """A motion to show: `time` (T,) [s] from its start, `position` (T, n) [rad or m].

    `deflection` (T, n) is that of each spring at the output of its drive, r_M / (N r_L) theta_M -
    phi [rad or m], about its mean over the motion because encoder offsets are unknown; NaN for a
    joint without a spring or with one side unknown. `notes` list values that are not measured.
    """

    name: str
    time: Array
    position: Array
    deflection: Array
    traces: Traces
    notes: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.time[-1])

    def at(self, time: float) -> tuple[Array, Array]:
        """Return position and deflection, each (n,), at a time [s]; constant beyond both ends."""
        after = int(np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1))
        begin, end = self.time[after - 1], self.time[after]
        part = float(np.clip((time - begin) / (end - begin), 0.0, 1.0))
        position, deflection = (
            (1.0 - part) * values[after - 1] + part * values[after]
            for values in (self.position, self.deflection)
        )
        return position, deflection


def playback_of(
    robot: Robot, motion: Shown, name: str, identified: Robot | None = None
) -> Playback:
    """Return the playback of a log, a motion, a trajectory or a plan.

    Its traces have the torques and deflections by the values of `robot` and of the `identified`
    one.
    The position of a joint without an encoder is that of its motor, through gear and transmission.
    The deflection of a planned motion is that of the nominal model. Raises LogError or
    ExcitationError for a motion of other joints, or without any position of a joint.
    """
    models = {NOMINAL: robot} if identified is None else {NOMINAL: robot, IDENTIFIED: identified}
    if isinstance(motion, Excitation):
        motion = motion.trajectory
    if isinstance(motion, Trajectory):
        return _planned(models, motion, name)
    if isinstance(motion, Log | Motion):
        return _logged(models, motion, name)
    raise SeaidError(
        f"cannot show '{name}', a {type(motion).__name__}: give a Log of read_log, a Motion or a "
        "Trajectory of load_trajectory"
    )


def scales(playbacks: Sequence[Playback], is_prismatic: Sequence[bool]) -> Array:
    """Return the ends (n,) of the colour scales, the largest deflections per kind of joint."""
    sliding = np.array(is_prismatic)
    limits = np.zeros(len(sliding))
    for kind in (sliding, ~sliding):
        sizes = [np.abs(playback.deflection[:, kind]) for playback in playbacks]
        known = np.concatenate([size[np.isfinite(size)] for size in sizes] or [np.zeros(0)])
        limits[kind] = np.max(known, initial=0.0)
    return limits


def _planned(models: Models, trajectory: Trajectory, name: str) -> Playback:
    robot = models[NOMINAL]
    columns = _columns(robot, trajectory.joint_names, f"trajectory '{name}'", ExcitationError)
    count = max(2, int(np.ceil(trajectory.duration * _PLAN_RATE_HZ)) + 1)
    time = np.linspace(0.0, trajectory.duration, count)
    q, v, a = robot.drive_states(*(state[:, columns] for state in trajectory.sample(time)))
    at_motor = (True,) * robot.n
    sources, unknown = _predicted(models, time, (q, v, a), None, at_motor)
    deflection = sources[NOMINAL][2] if NOMINAL in sources else np.full(q.shape, np.nan)
    notes = ["planned"]
    if robot.elastic_joints:
        reason = unknown.get(NOMINAL)
        text = f"are unknown: {reason}" if reason else "are those of the nominal model"
        notes = [f"planned; deflections {text}"]
    traces = traces_of(trajectory.duration, {name: [x] for name, x in sources.items()}, at_motor)
    return _playback(robot, name, time, q, deflection, traces, notes)


def _logged(models: Models, motion: Log | Motion, name: str) -> Playback:
    robot = models[NOMINAL]
    columns = _columns(robot, motion.joint_names, f"log '{name}'", LogError)
    joint, motor = motion.joint_position[:, columns], motion.motor_position[:, columns]
    joint = robot.drive_states(joint)[0] if isinstance(motion, Log) else joint
    # N r_L / r_M is the motor angle per angle at the output of the drive.
    behind_spring = motor / [total_ratio(robot.drives[joint]) for joint in robot.joint_names]
    unseen = np.isnan(joint[0])
    position = np.where(unseen, at_joints(robot.transmission, behind_spring), joint)
    for index in np.flatnonzero(np.isnan(position[0])):
        joint_name = robot.joint_names[index]
        raise LogError(f"log '{name}': no encoder gives the position of '{joint_name}'")
    notes = [
        f"no encoder at '{joint}': its position is that of its motor, without spring deflection"
        for joint in robot.elastic_joints
        if unseen[robot.index(joint)]
    ]
    deflection = behind_spring - at_drives(robot.transmission, joint)
    traces, unknown = _logged_traces(models, motion, columns, deflection)
    if IDENTIFIED in models:
        notes += unknown
    time = motion.time - motion.time[0]
    return _playback(robot, name, time, position, deflection, traces, notes)


def _columns(robot: Robot, names: Sequence[str], what: str, error: type[SeaidError]) -> list[int]:
    missing = [joint for joint in robot.joint_names if joint not in names]
    if missing:
        raise error(
            f"{what} has no joint {', '.join(missing)} of '{robot.name}'; its joints: "
            f"{', '.join(names)}; name the joints that move by joints= when loading the robot",
            "joints=",
        )
    return [tuple(names).index(joint) for joint in robot.joint_names]


def _playback(
    robot: Robot,
    name: str,
    time: Array,
    position: Array,
    deflection: Array,
    traces: Traces,
    notes: Sequence[str],
) -> Playback:
    """Return the playback with the deflections of springs about their means, NaN elsewhere."""
    elastic = [joint in robot.elastic_joints for joint in robot.joint_names]
    about_mean = np.where(elastic, deflection - np.mean(deflection, axis=0), np.nan)
    shape = (len(time), robot.n)
    return Playback(
        name,
        frozen("time", time, (None,)),
        frozen("position", robot.joint_states(position)[0], shape),
        frozen("deflection", about_mean, shape),
        traces,
        tuple(notes),
    )
