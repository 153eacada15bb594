"""Trajectory: a planned motion as a function of time, its files and its ROS 2 message."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array, check_rate, finite, frozen
from seaid._files import numbers, read_json, write_csv, write_whole
from seaid._progress import MOST_NAMES, Display, counted
from seaid.errors import ExcitationError, check_name, checked, listed, shown
from seaid.excitation.basis import Basis, basis_from_dict
from seaid.robot import Robot

_NANO = 10**9
"""Nanoseconds of a second, in which ROS 2 has times."""


def message_times(duration: float, rate_hz: float) -> list[int]:
    """Return the times [ns] of points at a rate [1/s] and at the end, without rounding error."""
    check_rate(rate_hz, duration, error=ExcitationError)
    rate, end = Fraction(rate_hz), round(Fraction(duration) * _NANO)
    times = [round(k * _NANO / rate) for k in range(int(Fraction(duration) * rate) + 1)]
    # the end replaces the last point if only rounding separates them
    close = len(times) > 1 and end - times[-1] < 1e-6 * _NANO / rate_hz
    return [*(times[:-1] if close or times[-1] == end else times), end]


def joint_trajectory_message(
    joint_names: Sequence[str], times: Sequence[int], states: tuple[Array, Array, Array]
) -> dict[str, Any]:
    """Return the message of position, velocity and acceleration (T, n) at `times` [ns]."""
    q, v, a = (state.tolist() for state in states)
    points = [
        {
            "positions": q[t],
            "velocities": v[t],
            "accelerations": a[t],
            "effort": [],
            "time_from_start": {"sec": time // _NANO, "nanosec": time % _NANO},
        }
        for t, time in enumerate(times)
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(joint_names), "points": points}


def as_yaml(message: dict[str, Any]) -> str:
    """Return a message as text that is both JSON and YAML, one line per point."""
    # Not every YAML reader takes 1e-05 for a number: it is written as 1.0e-05.
    texts = (re.sub(r"(?<![.\d])(\d+)e", r"\1.0e", json.dumps(x)) for x in message["points"])
    points = ",\n".join(f"  {text}" for text in texts)
    head = {key: value for key, value in message.items() if key != "points"}
    return f'{json.dumps(head)[:-1]},\n "points": [\n{points}\n]}}\n'


_FORMAT = "seaid trajectory 1"
_TURNING = ("position_rad", "velocity_rad_s", "acceleration_rad_s2")
_SLIDING = ("position_m", "velocity_m_s", "acceleration_m_s2")


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Display):
    """A motion of n joints over [0, duration], linear in its coefficients.

    Raises ExcitationError for values that are not finite or do not fit each other.

    Parameters
    ----------
    joint_names : tuple of n str
    basis : Basis
        A `SplineBasis` or a `FourierBasis`, with K coefficients per joint.
    coefficients : array (K, n)
        [rad or m].
    prismatic_joints : tuple of str
        The prismatic joints, for the units in files.
    main_interval : (float, float)
        Start and end [s] of the exciting motion, without run-in and run-out; default: the whole.

    Examples
    --------
    >>> motion = seaid.load_trajectory("plan.json")
    >>> q, v, a = motion.sample(np.arange(0.0, motion.duration, 0.001))
    >>> motion.save_set_points("plan.csv", rate_hz=500.0)
    """

    joint_names: tuple[str, ...]
    basis: Basis
    coefficients: Array
    prismatic_joints: tuple[str, ...] = ()
    main_interval: tuple[float, float] = ()  # type: ignore[assignment]

    def _in_short(self) -> str:
        names = listed(self.joint_names, MOST_NAMES)
        kind = f"{type(self.basis).__name__} of {counted(self.basis.size, 'coefficient')} per joint"
        return f"{self.duration:.4g} s, joints {names}: {kind}"

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        object.__setattr__(self, "prismatic_joints", tuple(self.prismatic_joints))
        if not self.joint_names or len(set(self.joint_names)) < len(self.joint_names):
            raise ExcitationError(
                f"a trajectory needs joint names, each once, found {shown(list(self.joint_names))}"
            )
        for joint in self.prismatic_joints:
            check_name("joint", joint, self.joint_names, ExcitationError)
        shape = (self.basis.size, len(self.joint_names))
        values = frozen("coefficients", self.coefficients, shape, ExcitationError)
        if not np.all(np.isfinite(values)):
            joint = self.joint_names[int(np.argwhere(~np.isfinite(values))[0, 1])]
            raise ExcitationError(f"coefficients of joint '{joint}' are not all finite")
        object.__setattr__(self, "coefficients", values)
        _check_sizes(self.duration, values)
        interval = self.main_interval or (0.0, self.duration)
        begin, end = finite("main_interval", interval, (2,), ExcitationError).tolist()
        if not 0 <= begin < end <= self.duration:
            raise ExcitationError(
                f"main_interval must lie within 0 to {self.duration:.6g} s, found {begin:.6g} to "
                f"{end:.6g}"
            )
        object.__setattr__(self, "main_interval", (begin, end))

    @property
    def duration(self) -> float:
        """End of the motion [s]; it starts at 0."""
        return self.basis.duration

    @cached_property
    def rests_at_ends(self) -> bool:
        """True if velocity and acceleration are zero at both ends, to 1e-9 of a bound on them."""
        ends = np.array([0.0, self.duration])
        _, v, a = self.basis.states(ends, self.coefficients)
        # Density 0: the coarsest hull, with the widest bound.
        most = (np.max(np.abs(self.basis.hull(order, 0) @ self.coefficients)) for order in (1, 2))
        return all(np.max(np.abs(end)) <= 1e-9 * m for end, m in zip((v, a), most, strict=True))

    def sample(self, time: Any) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, each (T, n) [rad or m, s], at times (T,) [s].

        A motion at rest at its ends stays there before 0 and after the duration. Raises
        ExcitationError for times outside of another motion, and for times that are not finite.
        """
        time = frozen("time", np.atleast_1d(time), (None,), ExcitationError)
        if not np.all(np.isfinite(time)):
            raise ExcitationError("times to sample a trajectory at must be finite")
        within = np.clip(time, 0.0, self.duration)
        # the last sample of a grid in time may be beyond the duration by rounding
        outside = np.abs(time - within) > 1e-6 * self.duration
        if np.any(outside) and not self.rests_at_ends:
            raise ExcitationError(
                f"time {time[outside][0]:.6g} s is outside of this motion (0 to "
                f"{self.duration:.6g} s), which does not rest at its ends; sample inside, or plan "
                "with rest_to_rest=True"
            )
        q, v, a = self.basis.states(within, self.coefficients)
        if self.rests_at_ends:
            # at and beyond the ends: exactly at rest, without the rounding errors of the basis
            still = (within == 0.0) | (within == self.duration)
            v[still], a[still] = 0.0, 0.0
        return q, v, a

    def save(self, path: str | Path) -> None:
        """Write the trajectory as JSON without rounding; `load_trajectory` reads it.

        Raises SeaidError if the file cannot be written.
        """
        content = {
            "format": _FORMAT,
            "joints": list(self.joint_names),
            "prismatic_joints": list(self.prismatic_joints),
            "main_interval": list(self.main_interval),
            "basis": self.basis.to_dict(),
            "coefficients": self.coefficients.tolist(),
        }
        write_whole(path, json.dumps(content, indent=1) + "\n")

    def save_set_points(self, path: str | Path, rate_hz: float = 1000.0) -> None:
        """Write the set-points as CSV at a rate [1/s], from 0 to the duration.

        Columns: `time_s`, then per joint `<joint>.position_rad`, `.velocity_rad_s` and
        `.acceleration_rad_s2`; `_m`, `_m_s` and `_m_s2` for a prismatic joint. Raises
        ExcitationError for a rate that is not more than zero, SeaidError if the file cannot be
        written.
        """
        check_rate(rate_hz, self.duration, error=ExcitationError)
        # the duration may be a whole number of periods but for rounding: its end is then a point
        time = np.arange(int(np.floor(self.duration * rate_hz + 1e-6)) + 1) / rate_hz
        # 3 of (T, n) -> (T, n, 3), so that a row has q, v and a of one joint after another
        states = np.stack(self.sample(np.minimum(time, self.duration)), axis=2)
        header = ["time_s"]
        for joint in self.joint_names:
            units = _SLIDING if joint in self.prismatic_joints else _TURNING
            header += [f"{joint}.{unit}" for unit in units]
        columns = np.column_stack([time, states.reshape(len(time), -1)]).T
        write_csv(path, dict(zip(header, columns, strict=True)))

    def joint_trajectory(self, rate_hz: float = 100.0) -> dict[str, Any]:
        """Return the motion as a ROS 2 message trajectory_msgs/msg/JointTrajectory.

        Points are at a rate [1/s] and at the end, with `time_from_start` exact to the nanosecond,
        without effort. Raises ExcitationError for a rate that is not more than zero.
        """
        times = message_times(self.duration, rate_hz)
        states = self.sample(np.minimum(np.array(times) * 1e-9, self.duration))
        return joint_trajectory_message(self.joint_names, times, states)

    def save_joint_trajectory(self, path: str | Path, rate_hz: float = 100.0) -> None:
        """Write `joint_trajectory` as YAML (and JSON), to send to a ROS 2 controller.

        Once the robot is at the first point: `ros2 topic pub --once /<controller>/joint_trajectory
        trajectory_msgs/msg/JointTrajectory --yaml-file <path>`, or `--stdin < <path>` in versions
        without `--yaml-file`. Raises as `save_set_points` does.
        """
        write_whole(path, as_yaml(self.joint_trajectory(rate_hz)))


_DURATIONS_S = (1e-6, 1e7)
"""Shortest and longest duration of a trajectory [s], so that no acceleration overflows."""

_MOST_COEFFICIENT = 1e9
"""Largest coefficient [rad or m], for the same reason."""


def _check_sizes(duration: float, coefficients: Array) -> None:
    """Raise ExcitationError for sizes whose accelerations would overflow."""
    if not _DURATIONS_S[0] <= duration <= _DURATIONS_S[1]:
        raise ExcitationError(
            f"a trajectory lasts from {_DURATIONS_S[0]:g} to {_DURATIONS_S[1]:g} s, found "
            f"{duration:g} s"
        )
    largest = float(np.max(np.abs(coefficients), initial=0.0))
    if largest > _MOST_COEFFICIENT:
        raise ExcitationError(
            f"coefficients must be at most {_MOST_COEFFICIENT:g} rad or m in size, found "
            f"{largest:g}"
        )


def check_joint_names(trajectory: Trajectory, robot: Robot) -> None:
    """Raise ExcitationError for a trajectory of other joints than those of a robot."""
    if trajectory.joint_names != robot.joint_names:
        raise ExcitationError(
            f"the trajectory moves {', '.join(trajectory.joint_names)}, but '{robot.name}' has "
            f"{', '.join(robot.joint_names)}: give the joints of the robot, in its order"
        )


@checked(ExcitationError)
def load_trajectory(path: str | Path) -> Trajectory:
    """Load the trajectory of a JSON file that `Trajectory.save` wrote.

    Parameters
    ----------
    path : path

    Returns
    -------
    Trajectory

    Raises
    ------
    ExcitationError
        For a file that is missing, not JSON or not a trajectory.

    Examples
    --------
    >>> log = seaid.simulate(robot, seaid.load_trajectory("plan.json"))
    """
    content = read_json(path, "trajectory", ExcitationError)
    declared = content.get("format") if isinstance(content, dict) else None
    if declared != _FORMAT:
        raise ExcitationError(
            f"'{path}' is no trajectory: 'format' is {shown(declared)}, not {_FORMAT!r}"
        )
    try:
        basis = basis_from_dict(content["basis"])
        joints, prismatic = (_names(key, content[key]) for key in ("joints", "prismatic_joints"))
        coefficients = numbers("coefficients", content["coefficients"], ExcitationError)
        main = numbers("main_interval", content.get("main_interval", []), ExcitationError)
        if not isinstance(main, list):
            raise ExcitationError(f"main_interval must be a start and an end, found {main}")
        return Trajectory(joints, basis, coefficients, prismatic, tuple(main))
    except KeyError as problem:
        raise ExcitationError(f"trajectory '{path}' is not complete: {problem!r}") from None
    except ExcitationError as problem:
        raise problem.at(f"trajectory '{path}'") from None


def _names(key: str, value: Any) -> tuple[str, ...]:
    if not (isinstance(value, list) and all(isinstance(name, str) for name in value)):
        raise ExcitationError(f"{key} must be a list of names, found {shown(value)}")
    return tuple(value)
