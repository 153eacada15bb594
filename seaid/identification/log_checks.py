"""Checks of a log: excitation and dead channels before the regression, signs after it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, is_constant
from seaid.errors import ExcitationError, Finding, LogError, listed
from seaid.identification.two_step import INPUT_FIELDS
from seaid.log import Log
from seaid.regressor import motor_regressor, random_states, regressor_at_drives
from seaid.robot import Robot, at_joints

if TYPE_CHECKING:
    from seaid.estimation import Estimate
    from seaid.identification.identification import Identification


_SURE = 2.0
_FEWEST = 2
_POSTURES = 40
_OWN = {
    "viscous_friction": "viscous friction",
    "coulomb_friction": "Coulomb friction",
    "stiffness": "stiffness",
}


def sign_warnings(found: Identification) -> tuple[Finding, ...]:
    """Return a warning for every joint whose torque seems to have the wrong sign.

    Friction and stiffness are positive, and so is the inertia of a joint; gravity has the direction
    that the masses of the file give, if any. A torque has a warning if at least two of these are
    significantly negative and none is positive; inertia and gravity, which depend on the torques of
    other joints too, do not outweigh friction and stiffness.
    """
    warnings = []
    for joint in found.known.joint_names:
        own = dict(_own_signs(found, joint))
        if 1 in own.values():  # contradicts the others
            continue
        shared = dict(_shared_signs(found, joint))
        minus = [name for name, sign in (own | shared).items() if sign < 0]
        own_minus = [name for name in minus if name in own]
        contradicted = 1 in shared.values() and len(own_minus) < _FEWEST
        if len(minus) >= _FEWEST and not contradicted:
            what = " and ".join([", ".join(minus[:-1]), minus[-1]])
            number = "both" if len(minus) == _FEWEST else "all"
            message = (
                f"the torque of {joint} looks flipped: the estimates of {what} are {number} "
                "negative; compare the sign of its torque column with that of its position"
            )
            warnings.append(Finding("sign", message, joint, "wrong"))
    return tuple(warnings)


def _own_signs(found: Identification, joint: str) -> Iterator[tuple[str, int]]:
    """Yield the parameters of a drive with a known sign: 1 expected, -1 opposite, 0 uncertain."""
    drive = found.drives.get(joint)
    if drive is None:
        return
    for place, name in enumerate(drive.names):
        if name in _OWN:
            yield _OWN[name], _sure(float(drive.values[place]), drive.standard_errors[place])


def _shared_signs(found: Identification, joint: str) -> Iterator[tuple[str, int]]:
    """Yield the same for inertia and gravity of the load on a joint."""
    if joint not in found.model.torque_joints:
        return
    yield "inertia", _sign(found.load, _inertia(found, joint))
    gravity = _gravity(found, joint)
    if gravity is not None:
        yield "gravity", _sign(found.load, gravity)


def _sign(load: Estimate, direction: Array) -> int:
    """Return the sign of a combination (p,) of the base parameters, 0 if not significant."""
    variance = max(float(direction @ load.covariance @ direction), 0.0)
    return _sure(float(direction @ load.values), variance**0.5)


def _sure(value: float, error: float) -> int:
    return int(np.sign(value)) if abs(value) > _SURE * error else 0


def _inertia(found: Identification, joint: str) -> Array:
    """Return the mean inertia of a joint over random postures, in the base parameters (p,)."""
    robot = found.known
    q, v, _ = (state[:_POSTURES] for state in random_states(robot, seed=2))
    index = robot.index(joint)
    pushed = np.zeros_like(q)
    pushed[:, index] = 1.0
    pushed = at_joints(robot.transmission, pushed)
    rows = regressor_at_drives(robot, q, 0 * v, pushed) - regressor_at_drives(
        robot, q, 0 * v, 0 * v
    )
    return np.asarray(np.mean(found.base.reduce(rows)[:, index], axis=0))


def _gravity(found: Identification, joint: str) -> Array | None:
    """Return gravity of the input masses in the base parameters (p,), None without masses."""
    robot = found.known
    if not np.all(np.isfinite(robot.parameters)):
        return None
    q, v, _ = (state[:_POSTURES] for state in random_states(robot, seed=3))
    rows = found.base.reduce(regressor_at_drives(robot, q, 0 * v, 0 * v))[:, robot.index(joint)]
    expected = rows @ found.base.project(robot.parameters)
    size = float(expected @ expected)
    return np.asarray(expected @ rows / size) if size > 0 else None


_CHANNELS = (*INPUT_FIELDS.values(), "joint_torque")


def unused_findings(found: Identification) -> tuple[Finding, ...]:
    """Return notes on parameters of drives that no equation has, and on channels without use."""
    return tuple(chain(_missing_parameters(found), _unused_channels(found)))


def _missing_parameters(found: Identification) -> Iterator[Finding]:
    """Yield a note for every elastic joint whose motor equation (7) the log does not have."""
    for joint in found.known.elastic_joints:
        drive, own = found.known.drives[joint], found.drives[joint].names
        names = motor_regressor(found.known, joint).names
        missing = [name.replace("_", " ") for name in names if name not in own]
        if missing:
            message = (
                f"the log has the joint torque of {joint} and not its motor {drive.motor_input}, "
                f"which alone would identify {listed(missing)}"
            )
            yield Finding("unidentifiable", message, joint, "note", certainty="certain")


def _unused_channels(found: Identification) -> Iterator[Finding]:
    """Yield a note for every kind of torque channel that is in the log and in no equation."""
    robot = found.known
    joints = [one for one in robot.joint_names if one in found.model.torque_joints]
    own = {joint: INPUT_FIELDS[robot.drives[joint].motor_input] for joint in joints}
    for channel in _CHANNELS:
        unused = [
            joint
            for joint in joints
            if channel != own[joint] and _is_logged(found, channel, joint)
            if channel != "joint_torque" or not robot.drives[joint].is_elastic
            if channel != "joint_torque" or _is_logged(found, own[joint], joint)
        ]
        if unused:
            name = channel.replace("_", " ")
            message = f"the {name} of {listed(unused)} is in the log and in no equation"
            joint = unused[0] if len(unused) == 1 else ""
            yield Finding("unused-channel", message, joint, "note", certainty="certain")


def _is_logged(found: Identification, channel: str, joint: str) -> bool:
    """Whether a log in memory has a channel of a joint."""
    index = found.known.index(joint)
    values = [getattr(motion, channel) for motion in found.motions]
    return any(one is not None and bool(np.any(np.isfinite(one[:, index]))) for one in values)


_LEAST_RANGE = 20.0
"""A position moves if its range is this many times the noise between samples."""


def check_excitation(robot: Robot, logs: Sequence[Log]) -> None:
    """Raise ExcitationError if an elastic joint's motor, or the whole robot, does not move."""
    for joint in robot.elastic_joints:
        positions = [log.motor_position[:, log.joint_names.index(joint)] for log in logs]
        if not any(map(_moves, positions)):
            widest = max(float(np.ptp(position)) for position in positions)
            raise ExcitationError(
                f"the motor of '{joint}' stands still (it moves {widest:.3g} rad, noise "
                f"{_noise(positions[0]):.2g} rad), so that its friction and spring are "
                "unidentifiable; move the joint, or exclude it with joints=[...] of load_robot",
                "joints=[...] of load_robot",
            )
    every = [
        column
        for log in logs
        for side in (log.joint_position, log.motor_position)
        for column in side.T
        if np.all(np.isfinite(column))
    ]
    if not any(map(_moves, every)):
        raise ExcitationError("no joint moves in the log: the motion does not excite the robot")


def check_channels(logs: Sequence[Log]) -> None:
    """Raise LogError if a sensor is constant while another sensor of its joint moves."""
    for log in logs:
        for index, joint in enumerate(log.joint_names):
            sides = {
                "motor position": log.motor_position[:, index],
                "joint position": log.joint_position[:, index],
            }
            for dead, other in (tuple(sides), tuple(sides)[::-1]):
                _check_alive(joint, dead, sides[dead], other, sides[other])
            torques = {"motor torque": log.motor_torque[:, index]}
            if log.joint_torque is not None:
                torques["joint torque"] = log.joint_torque[:, index]
            for name, torque in torques.items():
                for side, position in sides.items():
                    _check_alive(joint, name, torque, side, position)


def _check_alive(joint: str, name: str, values: Array, other: str, moved: Array) -> None:
    if is_constant(values) and np.all(np.isfinite(moved)) and _moves(moved):
        raise LogError(
            f"the {name} of '{joint}' is {values[0]:.6g} all the time, while its {other} moves: a "
            "dead channel? Exclude its column from the log, or the joint with joints=[...] of "
            "load_robot",
            "joints=[...] of load_robot",
        )


def _moves(position: Array) -> bool:
    return bool(np.ptp(position) > _LEAST_RANGE * _noise(position))


def _noise(position: Array) -> float:
    """Return the standard deviation of white noise, from second differences of 6-fold variance."""
    return float(np.std(np.diff(position, 2)) / np.sqrt(6))
