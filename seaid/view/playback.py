"""Playback: positions and spring deflections of a planned or logged motion over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, frozen
from seaid.errors import ExcitationError, LogError, SeaidError
from seaid.excitation import Excitation, Trajectory
from seaid.log import Log, Motion
from seaid.robot import at_drives, at_joints
from seaid.view.traces import NOMINAL, Traces, logged_traces, predicted, traces_of

if TYPE_CHECKING:
    from seaid.robot import Robot

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
    if isinstance(motion, Excitation):
        motion = motion.trajectory
    if isinstance(motion, Trajectory):
        return _planned(robot, motion, name, identified)
    if isinstance(motion, Log | Motion):
        return _logged(robot, motion, name, identified)
    raise SeaidError(
        f"cannot show '{name}', a {type(motion).__name__}: give a Log of read_log, a Motion or a "
        "Trajectory of load_trajectory"
    )


def scales(playbacks: Sequence[Playback], is_prismatic: Sequence[bool]) -> Array:
    """Return the ends (n,) of the colour scales, the largest deflections per kind of joint."""
    sliding = np.array(is_prismatic)
    found = np.zeros(len(sliding))
    for kind in (sliding, ~sliding):
        sizes = [np.abs(one.deflection[:, kind]) for one in playbacks]
        known = np.concatenate([size[np.isfinite(size)] for size in sizes] or [np.zeros(0)])
        found[kind] = np.max(known, initial=0.0)
    return found


def _planned(robot: Robot, trajectory: Trajectory, name: str, identified: Robot | None) -> Playback:
    columns = _columns(robot, trajectory.joint_names, f"trajectory '{name}'", ExcitationError)
    count = max(2, int(np.ceil(trajectory.duration * _PLAN_RATE_HZ)) + 1)
    time = np.linspace(0.0, trajectory.duration, count)
    q, v, a = (state[:, columns] for state in trajectory.sample(time))
    part, unknown = predicted(robot, identified, time, (q, v, a), None, (True,) * robot.n)
    deflection = part[2].get(NOMINAL, np.full(q.shape, np.nan))
    notes = ["planned"]
    if robot.elastic_joints:
        reason = unknown.get(NOMINAL)
        text = f"are unknown: {reason}" if reason else "are those of the nominal model"
        notes = [f"planned; deflections {text}"]
    traces = traces_of([part], (True,) * robot.n)
    return _playback(robot, name, time, q, deflection, traces, notes)


def _logged(robot: Robot, motion: Log | Motion, name: str, identified: Robot | None) -> Playback:
    columns = _columns(robot, motion.joint_names, f"log '{name}'", LogError)
    joint, motor = motion.joint_position[:, columns], motion.motor_position[:, columns]
    behind_spring = motor / _ratios(robot)
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
    time = motion.time - motion.time[0]
    deflection = behind_spring - at_drives(robot.transmission, joint)
    traces, unknown = logged_traces(robot, identified, motion, columns, deflection)
    if identified is not None:
        notes += unknown
    return _playback(robot, name, time, position, deflection, traces, notes)


def _ratios(robot: Robot) -> Array:
    """Return N r_L / r_M of all drives (n,), the motor angle per output angle."""
    drives = [robot.drives[joint] for joint in robot.joint_names]
    return np.array([drive.ratio * (drive.load_radius / drive.motor_radius) for drive in drives])


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
        frozen("position", position, shape),
        frozen("deflection", about_mean, shape),
        traces,
        tuple(notes),
    )
