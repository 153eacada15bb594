"""Playback: positions and spring deflections of a planned or recorded motion over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import Array, frozen
from seaid.errors import ExcitationError, LogError, SeaidError
from seaid.excitation import Excitation, Trajectory
from seaid.log import Log, Motion
from seaid.robot import Robot, at_drives, at_joints, torques_at_drives

Shown = Log | Motion | Trajectory | Excitation

_PLAN_RATE_HZ = 500.0


@dataclass(frozen=True, eq=False)
class Playback:
    """A motion to look at: `time` (T,) [s] from its start, `position` (T, n) [rad or m].

    `deflection` (T, n) is that of each spring, seen at its drive's output [rad or m]: r_M / (N r_L)
    theta_M - phi, about its mean over the motion, since zeros of encoders are not known; NaN where
    there is no spring, or not both sides are known. `notes` tell what is not as measured.
    """

    name: str
    time: Array
    position: Array
    deflection: Array
    notes: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """How long the motion lasts [s]."""
        return float(self.time[-1])

    def at(self, time: float) -> tuple[Array, Array]:
        """Return position and deflection, each (n,), at a time [s]; held beyond both ends."""
        after = int(np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1))
        begin, end = self.time[after - 1], self.time[after]
        part = float(np.clip((time - begin) / (end - begin), 0.0, 1.0))
        position, deflection = (
            (1.0 - part) * values[after - 1] + part * values[after]
            for values in (self.position, self.deflection)
        )
        return position, deflection


def playback_of(robot: Robot, motion: Shown, name: str) -> Playback:
    """Return what there is to play of a log, a motion or a trajectory (or the plan it is of).

    Positions are those of the joints; where a joint has no encoder, its motor's, through gear and
    transmission. The deflection of a planned motion is what the nominal model says. Raises LogError
    or ExcitationError for a motion of other joints and where nothing tells a joint's position.
    """
    if isinstance(motion, Excitation):
        motion = motion.trajectory
    if isinstance(motion, Trajectory):
        return _planned(robot, motion, name)
    if isinstance(motion, Log | Motion):
        return _recorded(robot, motion, name)
    raise SeaidError(
        f"cannot show '{name}', a {type(motion).__name__}: give a Log of read_log, a Motion or a "
        "Trajectory of load_trajectory"
    )


def scales(playbacks: Sequence[Playback], is_prismatic: Sequence[bool]) -> Array:
    """Return the ends of the colour scales (n,): the largest deflection of all turning joints [rad]
    or of all sliding ones [m], in all motions; zero where none is known.
    """
    sliding = np.array(is_prismatic)
    found = np.zeros(len(sliding))
    for kind in (sliding, ~sliding):
        sizes = [np.abs(one.deflection[:, kind]) for one in playbacks]
        known = np.concatenate([size[np.isfinite(size)] for size in sizes] or [np.zeros(0)])
        found[kind] = np.max(known, initial=0.0)
    return found


def _planned(robot: Robot, trajectory: Trajectory, name: str) -> Playback:
    columns = _columns(robot, trajectory.joint_names, f"trajectory '{name}'", ExcitationError)
    count = max(2, int(np.ceil(trajectory.duration * _PLAN_RATE_HZ)) + 1)
    time = np.linspace(0.0, trajectory.duration, count)
    q, v, a = (state[:, columns] for state in trajectory.sample(time))
    deflection, notes = np.full(q.shape, np.nan), ["planned"]
    if robot.elastic_joints:
        try:
            deflection = _nominal_deflection(robot, (q, v, a))
            notes = ["planned; deflections are those of the nominal model"]
        except ExcitationError as problem:
            notes = [f"planned; deflections are not known: {problem}"]
    return _playback(robot, name, time, q, deflection, notes)


def _nominal_deflection(robot: Robot, states: tuple[Array, Array, Array]) -> Array:
    from seaid.excitation import (
        check_nominal_bodies,
        load_torques,
        parallel_elements,
        transmission,
    )

    drives = transmission(robot)
    check_nominal_bodies(robot)
    parallel = parallel_elements(robot, np.max(np.abs(states[1]), axis=0), robot.elastic_joints)
    torque = torques_at_drives(robot.transmission, load_torques(robot, parallel, states))
    radius = [getattr(robot.drives[joint], "load_radius", 1.0) for joint in robot.joint_names]
    deflection: Array = drives.spring_deflection(torque)[0] / np.array(radius)
    return deflection


def _recorded(robot: Robot, motion: Log | Motion, name: str) -> Playback:
    columns = _columns(robot, motion.joint_names, f"log '{name}'", LogError)
    joint, motor = motion.joint_position[:, columns], motion.motor_position[:, columns]
    behind_spring = motor / _ratios(robot)
    unseen = np.isnan(joint[0])
    position = np.where(unseen, at_joints(robot.transmission, behind_spring), joint)
    for index in np.flatnonzero(np.isnan(position[0])):
        raise LogError(f"log '{name}': nothing tells the position of '{robot.joint_names[index]}'")
    notes = [
        f"no encoder at '{joint}': its position is its motor's, without the spring's deflection"
        for joint in robot.elastic_joints
        if unseen[robot.index(joint)]
    ]
    deflection = behind_spring - at_drives(robot.transmission, joint)
    return _playback(robot, name, motion.time - motion.time[0], position, deflection, notes)


def _ratios(robot: Robot) -> Array:
    """Return N r_L / r_M of all drives (n,), motor angle a coordinate of what they turn."""
    drives = [robot.drives[joint] for joint in robot.joint_names]
    levers = [
        getattr(drive, "load_radius", 1.0) / getattr(drive, "motor_radius", 1.0) for drive in drives
    ]
    return np.multiply([drive.ratio for drive in drives], levers)


def _columns(robot: Robot, names: Sequence[str], what: str, error: type[SeaidError]) -> list[int]:
    missing = [joint for joint in robot.joint_names if joint not in names]
    if missing:
        raise error(
            f"{what} has no joint {', '.join(missing)} of '{robot.name}'; its joints: "
            f"{', '.join(names)}; name the joints that move by joints= where the robot is loaded"
        )
    return [tuple(names).index(joint) for joint in robot.joint_names]


def _playback(
    robot: Robot, name: str, time: Array, position: Array, deflection: Array, notes: Sequence[str]
) -> Playback:
    """Return the playback with deflections of springs alone, each about its mean."""
    elastic = [joint in robot.elastic_joints for joint in robot.joint_names]
    about_mean = np.where(elastic, deflection - np.mean(deflection, axis=0), np.nan)
    shape = (len(time), robot.n)
    return Playback(
        name,
        frozen("time", time, (None,)),
        frozen("position", position, shape),
        frozen("deflection", about_mean, shape),
        tuple(notes),
    )
