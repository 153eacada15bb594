"""Limits of methods: which terms of drives instruments, two sides at once and `refine` support."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from seaid.drives import Drive
from seaid.errors import IdentificationError
from seaid.regressor import motor_regressor, spring_regressor
from seaid.robot import Robot

_LINEAR = {"stiffness", "spring_damping", "spring_offset"}


@dataclass(frozen=True)
class LinearSpring:
    """A spring with stiffness, damping and an offset."""

    stiffness: float
    offset: float
    damping: float


def linear_spring(robot: Robot, joint: str, values: Iterable[float]) -> LinearSpring:
    """Return a spring with its known and its estimated values, in the order of its regressor."""
    found = dict(zip(spring_regressor(robot, joint).names, values, strict=True))
    drive = robot.drives[joint]
    known = {name: drive.values[name] for name in drive.known if name in _LINEAR}
    known |= {name: float(value) for name, value in found.items()}
    names = ("stiffness", "spring_offset", "spring_damping")
    return LinearSpring(*(known.get(name, 0.0) for name in names))


def check_simultaneous(robot: Robot, springs: Iterable[str]) -> None:
    """Raise IdentificationError for springs that method="simultaneous" cannot share."""
    for joint in springs:
        names = set(spring_regressor(robot, joint).names)
        if not {"stiffness", "spring_offset"} <= names <= _LINEAR:
            raise IdentificationError(
                'method="simultaneous" shares a spring of unknown stiffness and offset; that of '
                f'{joint} {_kind(robot, joint)}: use method="two-step"',
                'method="simultaneous"',
                'method="two-step"',
            )


def check_instruments(robot: Robot, springs: Iterable[str]) -> None:
    """Raise IdentificationError for springs for which instruments cannot be computed."""
    for joint in springs:
        if not set(spring_regressor(robot, joint).names) <= _LINEAR:
            raise IdentificationError(
                f'estimator="iv" supports springs of one stiffness; that of {joint} '
                f'{_kind(robot, joint)}: use estimator="wls"',
                'estimator="iv"',
                'estimator="wls"',
            )


def check_refinable(robot: Robot, unseen: Iterable[str] = ()) -> None:
    """Raise IdentificationError for terms of drives that `refine` does not simulate.

    The joints `unseen` have no sensor behind their springs, which have to be linear then.
    """
    for joint, drive in robot.drives.items():
        reason = _not_refinable(robot, joint, drive) or (
            _not_unseen(robot, joint, drive) if joint in unseen else ""
        )
        if reason:
            raise IdentificationError(
                f"the refinement cannot simulate the drive of {joint}, {reason}; use the result of "
                "identify"
            )


def _not_refinable(robot: Robot, joint: str, drive: Drive) -> str:
    if drive.controller is not None:
        alone = all(one.controller is not None for one in robot.drives.values())
        if drive.is_elastic or not alone:
            return "whose command was logged: all drives have to be stiff, with a position command"
        if motor_regressor(robot, joint).non_linear:
            return "whose equation is not linear in its parameters"
    elif drive.motor_input != "torque":
        return f"of which the {drive.motor_input} was logged, not the torque"
    if "load" in drive.friction and not drive.is_elastic:
        return "whose friction grows with the load"
    return ""


def _not_unseen(robot: Robot, joint: str, drive: Drive) -> str:
    if drive.parallel_spring or drive.joint_friction:
        return "which has a parallel spring or joint friction and no sensor behind its spring"
    if motor_regressor(robot, joint).non_linear or "load" in drive.friction:
        return "whose equation is not linear in its parameters, without a sensor behind its spring"
    names = set(spring_regressor(robot, joint).names)
    if not {"stiffness", "spring_offset"} <= names <= _LINEAR:
        return f"whose spring {_kind(robot, joint)} and no sensor behind it"
    return ""


def _kind(robot: Robot, joint: str) -> str:
    """Describe the terms of a spring other than unknown stiffness and offset."""
    regressor, drive = spring_regressor(robot, joint), robot.drives[joint]
    others = [name.replace("_", " ") for name in regressor.names if name not in _LINEAR]
    if others:
        return f"has {', '.join(others)}"
    if "spring_damping" in regressor.names:
        return "has damping"
    return f"has a known {' and '.join(name.replace('_', ' ') for name in drive.known)}"
