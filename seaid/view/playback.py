"""Playback: a planned or logged motion over time, with the torques and deflections along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import total_ratio
from seaid.errors import ExcitationError, LogError, SeaidError
from seaid.excitation import Excitation, Trajectory
from seaid.excitation.flatness import (
    check_nominal_bodies,
    load_torques,
    parallel_elements,
    transmission,
)
from seaid.log import Log, Motion
from seaid.robot import Robot, at_drives, at_joints, torques_at_drives

if TYPE_CHECKING:
    from seaid.identification import Identification

Shown = Log | Motion | Trajectory | Excitation


@dataclass(frozen=True, eq=False)
class Playback:
    """A motion to show: `time` (T,) [s] from its start, `position` (T, n) [rad or m].

    `deflection` (T, n) is that of each spring at the output of its drive, r_M / (N r_L) theta_M -
    phi [rad or m], about its mean over the motion because encoder offsets are unknown; NaN for a
    joint without a spring or with one side unknown. `torque` (T, n) is that of the motors as
    it was logged, or what an identification compares with its `computed` one (T, n): the torque of
    the motor of an elastic joint, and on the load of a stiff one. Both are NaN where they are
    unknown. `notes` list what is not measured.
    """

    name: str
    time: Array
    position: Array
    deflection: Array
    torque: Array
    computed: Array
    notes: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.time[-1])

    def at(self, time: float) -> tuple[Array, Array]:
        """Return position and deflection, each (n,), at a time [s]; constant beyond both ends."""
        instant = np.clip([time], 0.0, self.duration)
        position = sampled(instant, self.time, self.position)[0]
        return position, sampled(instant, self.time, self.deflection)[0]

    def curves(self, grid: Array, index: int) -> Array:
        """Return deflection, torque and computed torque (3, G) of a joint at instants (G,) [s]."""
        kinds = (self.deflection, self.torque, self.computed)
        return sampled(grid, self.time, np.column_stack([x[:, index] for x in kinds])).T


def sampled(grid: Array, time: Array, values: Array) -> Array:
    """Return values (T, n) at the instants of a grid (G, n), NaN beyond both ends."""
    return np.column_stack([np.interp(grid, time, x, np.nan, np.nan) for x in values.T])


def playback_of(
    robot: Robot, motion: Shown, name: str, identified: Robot | Identification | None = None
) -> Playback:
    """Return the playback of a log, a motion, a trajectory or a plan.

    The position of a joint without an encoder is that of its motor, through gear and transmission.
    The deflection of a planned motion is that of the nominal model. Raises LogError or
    ExcitationError for a motion of other joints, or without any position of a joint.
    """
    if isinstance(motion, Excitation):
        motion = motion.trajectory
    if isinstance(motion, Trajectory):
        return _planned(robot, motion, name)
    if isinstance(motion, Log | Motion):
        return _logged(robot, motion, name, identified)
    raise SeaidError(
        f"cannot show '{name}', a {type(motion).__name__}: give a Log of read_log, a Motion or a "
        "Trajectory of load_trajectory"
    )


def _columns(robot: Robot, names: Sequence[str], what: str, error: type[SeaidError]) -> list[int]:
    missing = [joint for joint in robot.joint_names if joint not in names]
    if missing:
        raise error(
            f"{what} has no joint {', '.join(missing)} of '{robot.name}'; its joints: "
            f"{', '.join(names)}; name the joints that move by joints= when loading the robot",
            "joints=",
        )
    return [tuple(names).index(joint) for joint in robot.joint_names]


def _planned(robot: Robot, trajectory: Trajectory, name: str) -> Playback:
    columns = _columns(robot, trajectory.joint_names, f"trajectory '{name}'", ExcitationError)
    # Several instants for each frame of a plan of a minute.
    time = np.linspace(0.0, trajectory.duration, 5000)
    q, v, a = robot.drive_states(*(state[:, columns] for state in trajectory.sample(time)))
    unknown = np.full(q.shape, np.nan)
    try:
        deflection = _nominal_deflection(robot, q, v, a)
        note = "planned; deflections are those of the nominal model"
    except SeaidError as problem:
        deflection, note = unknown, f"planned; deflections are unknown: {problem}"
    position, deflection = robot.joint_states(q)[0], _about_mean(robot, deflection)
    return Playback(name, time, position, deflection, unknown, unknown, (note,))


def _nominal_deflection(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return deflections (T, n) at the outputs of the drives, by (8) with the nominal values.

    Raises ExcitationError for a body or a spring without values.
    """
    drives = transmission(robot)
    check_nominal_bodies(robot)
    top_speed = np.maximum(np.max(np.abs(v), axis=0), 1e-6)
    parallel = parallel_elements(robot, top_speed, robot.joint_names)
    load = torques_at_drives(robot.transmission, load_torques(robot, parallel, (q, v, a)))
    # (3): the deflection r_M/N theta_M - r_L phi over r_L is an angle at the output of the drive.
    radius = np.array([robot.drives[joint].load_radius for joint in robot.joint_names])
    return np.asarray(drives.spring_deflection(load)[0] / radius)


def _about_mean(robot: Robot, deflection: Array) -> Array:
    elastic = [joint in robot.elastic_joints for joint in robot.joint_names]
    return np.where(elastic, deflection - np.mean(deflection, axis=0), np.nan)


def _logged(
    robot: Robot, motion: Log | Motion, name: str, identified: Robot | Identification | None
) -> Playback:
    columns = _columns(robot, motion.joint_names, f"log '{name}'", LogError)
    joint, motor = motion.joint_position[:, columns], motion.motor_position[:, columns]
    joint = robot.drive_states(joint)[0] if isinstance(motion, Log) else joint
    # N r_L / r_M is the motor angle per angle at the output of the drive.
    behind_spring = motor / [total_ratio(robot.drives[joint]) for joint in robot.joint_names]
    position = np.where(np.isnan(joint), at_joints(robot.transmission, behind_spring), joint)
    for index in np.flatnonzero(np.isnan(position[0])):
        joint_name = robot.joint_names[index]
        raise LogError(f"log '{name}': no encoder gives the position of '{joint_name}'")
    deflection = _about_mean(robot, behind_spring - at_drives(robot.transmission, joint))
    torque, notes = motion.motor_torque[:, columns], list[str]()
    computed = np.full(torque.shape, np.nan)
    if identified is not None and not isinstance(identified, Robot):
        try:
            torque, computed = _validated(identified, motion)
        except SeaidError as problem:
            notes.append(f"torques are not computed: {problem}")
    time, position = motion.time - motion.time[0], robot.joint_states(position)[0]
    return Playback(name, time, position, deflection, torque, computed, tuple(notes))


def _validated(identification: Identification, motion: Log | Motion) -> tuple[Array, Array]:
    """Return measured and computed torques (T, n) below the cutoff of an identification.

    They are those of the motor, by (7), of an elastic joint, and on the load, by (8), of a stiff
    one.
    """
    from seaid.identification import validate
    from seaid.identification.validation import compared

    if isinstance(motion, Log):
        result = validate(identification, motion)
    else:
        result = compared(identification, motion)
    motor, load = result.actuator, result.load
    measured = np.where(np.isnan(motor.measured), load.measured, motor.measured)
    computed = np.where(np.isnan(motor.computed), load.computed, motor.computed)
    return sampled(motion.time, result.time, measured), sampled(motion.time, result.time, computed)
