"""Traces: measured torques and spring deflections, and those of a robot's values, over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, frozen
from seaid.drives import friction_curve
from seaid.errors import ExcitationError, SeaidError
from seaid.excitation import check_nominal_bodies, load_torques, parallel_elements, transmission
from seaid.log import Log, Motion, low_pass, reconstruct_motions
from seaid.regressor import INPUT_FIELDS
from seaid.robot import at_drives, torques_at_drives

if TYPE_CHECKING:
    from seaid.robot import Robot

MEASURED, NOMINAL, IDENTIFIED = SOURCES = ("measured", "nominal", "identified")

_SAMPLES = 600
"""Instants of a plot, about two per pixel."""

_PER_PERIOD = 20.0
"""Samples per period of the cutoff at which torques are computed."""

States = tuple[Array, Array, Array]
"""Position, velocity and acceleration, each (T, n)."""

Part = tuple[Array, Mapping[str, Array], Mapping[str, Array]]
"""Time (T,) of a stretch, and {source: (T, n)} of torques and of deflections."""


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


def traces_of(parts: Sequence[Part], at_motor: tuple[bool, ...]) -> Traces:
    """Return the parts of a motion at the instants of a plot; the first one has its whole time."""
    time = parts[0][0]
    grid = np.linspace(0.0, time[-1], min(len(time), _SAMPLES))
    torque, deflection = {}, {}
    for source in SOURCES:
        torques = [(part[0], part[1][source]) for part in parts if source in part[1]]
        deflections = [(part[0], part[2][source]) for part in parts if source in part[2]]
        if torques:
            torque[source] = _on(grid, torques)
        if deflections:
            deflection[source] = _on(grid, deflections)
    return Traces(frozen("time", grid, (None,)), torque, _about_mean(deflection), at_motor)


def _on(grid: Array, parts: Sequence[tuple[Array, Array]]) -> Array:
    """Return the values (G, n) of parts (time, values) at the instants of a grid, NaN between."""
    found = np.full((len(grid), parts[0][1].shape[1]), np.nan)
    for time, values in parts:
        inside = (grid >= time[0]) & (grid <= time[-1])
        for column, one in zip(found.T, values.T, strict=True):
            column[inside] = np.interp(grid[inside], time, one)
    return found


def _about_mean(deflection: Mapping[str, Array]) -> dict[str, Array]:
    """Return deflections without the mean of the first source, the others aligned to it."""
    found: dict[str, Array] = {}
    for source, values in deflection.items():
        first = next(iter(found.values()), np.zeros_like(values))
        error = values - first
        known = np.isfinite(error)
        count = np.maximum(np.sum(known, axis=0), 1)
        found[source] = values - np.sum(np.where(known, error, 0.0), axis=0) / count
    return found


def logged_traces(
    robot: Robot,
    identified: Robot | None,
    log: Log | Motion,
    columns: list[int],
    deflection: Array,
) -> tuple[Traces, list[str]]:
    """Return the traces of a log, and why a model has none.

    `columns` are those of the robot's joints, and `deflection` (T, n) is the measured one. All pass
    the low pass of an identification, if the log is good enough for one, whose transients are
    excluded at the ends.
    """
    start, valued = log.time[0], robot if identified is None else identified
    raw, at_motor = _measured_torque(valued, log, columns)
    parts: list[Part] = [(log.time - start, {}, {})]
    try:
        motions = [log] if isinstance(log, Motion) else reconstruct_motions(robot, log)
    except SeaidError as problem:
        parts.append((log.time - start, {MEASURED: raw}, {MEASURED: deflection}))
        return traces_of(parts, at_motor), [f"torques are not computed: {problem}"]
    unknown: dict[str, str] = {}
    for motion in motions:
        own = columns if motion is log else list(range(robot.n))
        torque = _measured_torque(valued, motion, own)[0]
        measured = {MEASURED: torque}, {MEASURED: _on(motion.time, [(log.time, deflection)])}
        parts.append(_inside(motion, (motion.time - start, *measured)))
        rows = slice(None, None, max(1, int(motion.rate_hz / (_PER_PERIOD * motion.cutoff_hz))))
        part, unknown = predicted(
            robot,
            identified,
            motion.time[rows] - start,
            _states(motion, "joint", rows, own),
            _states(motion, "motor", rows, own),
            at_motor,
        )
        parts.append(_inside(motion, part))
    notes = [
        f"torques of the {name} model are not computed: {why.partition(';')[0]}"
        for name, why in unknown.items()
    ]
    return traces_of(parts, at_motor), notes


def _inside(motion: Motion, part: Part) -> Part:
    """Return signals below the cutoff of a motion, without the transients at the ends."""
    time = part[0]
    step = float(time[1] - time[0])
    transient = round(motion.transient_s / step)
    inside = slice(transient, len(time) - transient)

    def smooth(values: Array) -> Array:
        known, found = np.flatnonzero(np.isfinite(values[0])), values.copy()
        found[:, known] = low_pass(values[:, known], 1.0 / step, motion.cutoff_hz)
        return found[inside]

    torque, deflection = ({name: smooth(one) for name, one in kind.items()} for kind in part[1:])
    return time[inside], torque, deflection


def _states(motion: Motion, side: str, rows: slice, columns: list[int]) -> States:
    """Return the states of one side of a motion at some instants."""
    kinds = ("position", "velocity", "acceleration")
    q, v, a = (getattr(motion, f"{side}_{kind}")[rows][:, columns] for kind in kinds)
    return q, v, a


_CONSTANTS = {"current": "torque_constant", "voltage": "voltage_constant"}


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
        if drive.motor_input in _CONSTANTS and inputs is not None:
            constant = drive.values.get(_CONSTANTS[drive.motor_input], np.nan)
            torque[:, index] = constant * inputs[:, column]
        sensed = None if log.joint_torque is None else log.joint_torque[:, column]
        if np.isnan(torque[0, index]) and sensed is not None and np.isfinite(sensed[0]):
            torque[:, index] = sensed
            at_motor.append(False)
        else:
            at_motor.append(True)
    return torque, tuple(at_motor)


def predicted(
    robot: Robot,
    identified: Robot | None,
    time: Array,
    joint: States,
    motor: States | None,
    at_motor: tuple[bool, ...],
) -> tuple[Part, dict[str, str]]:
    """Return the torques and deflections of both models, and why one has none."""
    torque, deflection, unknown = {}, {}, {}
    for name, model in ((NOMINAL, robot), (IDENTIFIED, identified)):
        if model is not None:
            try:
                torque[name], deflection[name] = _prediction(model, time, joint, motor, at_motor)
            except SeaidError as problem:
                unknown[name] = str(problem)
    return (time, torque, deflection), unknown


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
    speed = np.where(np.isnan(speed), np.gradient(angle, time, axis=0), speed)
    acceleration = np.where(np.isnan(acceleration), np.gradient(speed, time, axis=0), acceleration)
    for index in np.flatnonzero(at_motor).tolist():
        states = speed[:, index], acceleration[:, index], load[:, index]
        torque[:, index] = _motor_torque(robot, index, *states)
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
    lever = drive.motor_radius / (drive.ratio * drive.load_radius)
    return np.asarray(inertia * acceleration + friction + lever * load)
