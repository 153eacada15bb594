"""What was given as known is not exact: its standard deviations, propagated to the estimates.

The derivative of an estimate by a constant is a difference quotient of the whole identification, so
that it contains the way through the springs. A scale error of the torques changes all parameters
together: their covariance says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.checks import shared_scale
from seaid.drives import IDEAL_DRIVE, STD_OF_TORQUE, Drive
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation import Estimate
from seaid.identification.datasets import Dataset
from seaid.log import Motion
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification.two_step import RobotEstimate

KNOWN_STD = {
    "torque": "the torques, with one scale error common to all",
    "payload": "the mass of the payloads",
    "bodies": "the known bodies, each with a scale of its own",
    "motor_inertia_kg_m2": "rotor inertias",
    "gear_ratio": "gear ratios",
    "motor_pulley_radius_m": "motor pulley radii",
    "load_pulley_radius_m": "load pulley radii",
}
"""Names in `known_std`: relative standard deviations of what."""

TYPICAL_STD = {
    "torque": 0.03,
    "payload": 0.01,
    "bodies": 0.05,
    "motor_inertia_kg_m2": 0.05,
    "gear_ratio": 0.001,
    "motor_pulley_radius_m": 0.005,
    "load_pulley_radius_m": 0.005,
}
"""Values that the output proposes: tolerances of data sheets (of K_t, of inertias), of scales, of
masses by CAD, and of turned pulleys with their cable."""

_STEP = 1e-3
"""Relative change of a constant in difference quotients."""

_CHANNELS = ("motor_torque", "motor_current", "motor_voltage", "joint_torque")


@dataclass(frozen=True, eq=False)
class Constant:
    """A constant with a relative standard deviation, and inputs in which it is larger by `_STEP`.

    `joint` is "" if it is common to all joints, or that of a body.
    """

    name: str
    joint: str
    std: float
    robot: Robot
    datasets: Sequence[Dataset]


def check_known_std(known_std: Mapping[str, float]) -> None:
    """Raise IdentificationError for an unknown name or a standard deviation outside [0, 1]."""
    for name, std in known_std.items():
        if name not in KNOWN_STD:
            wrong = unknown_name("constant", name, KNOWN_STD)
            raise IdentificationError(f"known_std=: {wrong}", "known_std=")
        if not 0 <= std <= 1:
            raise IdentificationError(
                f"known_std of '{name}' must be a relative standard deviation from 0 to 1, found "
                f"{std}",
                "known_std=",
            )


def exact_constants(robot: Robot, known_std: Mapping[str, float]) -> dict[str, float]:
    """Return the constants in use without a standard deviation, with their `TYPICAL_STD`."""
    drives = [drive for drive in robot.drives.values() if drive != IDEAL_DRIVE]
    names = {name for drive in drives for name in KNOWN_STD if getattr(drive, name, None)}
    names = {name for name in names if any(name not in drive.std for drive in drives)}
    is_scaled = bool(robot.known_bodies) and all(map(_has_unknown_scale, robot.drives.values()))
    if not is_scaled and any(STD_OF_TORQUE not in drive.std for drive in drives or [IDEAL_DRIVE]):
        names.add("torque")
    if np.any(robot.payload_parameters):
        names.add("payload")
    if robot.known_bodies:
        names.add("bodies")
    names -= {name for name, std in known_std.items() if std}
    return {name: std for name, std in TYPICAL_STD.items() if name in names}


_INPUT_CONSTANTS = {"torque_constant", "voltage_constant"}


def scaled_by_bodies(drives: Mapping[str, Estimate], exact: Mapping[str, float]) -> list[str]:
    """Return the joints whose motor constants rest on known bodies, if these are `exact`."""
    constants = (joint for joint, one in drives.items() if _INPUT_CONSTANTS & set(one.names))
    return list(constants) if "bodies" in exact else []


def _has_unknown_scale(drive: Drive) -> bool:
    return drive.motor_input != "torque" and _INPUT_CONSTANTS.isdisjoint(drive.known)


def constants_of(
    robot: Robot, datasets: Sequence[Dataset], known_std: Mapping[str, float]
) -> Iterator[Constant]:
    """Yield the constants that have a standard deviation: by `known_std`, or by their drive."""
    if known_std.get("torque"):
        louder = [_with_torques(one, range(robot.n)) for one in datasets]
        yield Constant("torque", "", known_std["torque"], robot, louder)
    if known_std.get("payload"):
        heavier = replace(robot, payload_parameters=(1 + _STEP) * robot.payload_parameters)
        yield Constant("payload", "", known_std["payload"], heavier, datasets)
    for body in robot.known_bodies if known_std.get("bodies") else ():
        factor = np.where(np.repeat([one == body for one in robot.body_names], 10), 1 + _STEP, 1.0)
        heavier = robot.with_values(factor * robot.parameters, robot.drives)
        yield Constant("bodies", body, known_std["bodies"], heavier, datasets)
    for joint, drive in robot.drives.items():
        stds = {name: known_std[name] for name in known_std if hasattr(drive, name)}
        stds |= drive.std
        for name, std in stds.items():
            if name == STD_OF_TORQUE and std:
                louder = [_with_torques(one, [robot.index(joint)]) for one in datasets]
                yield Constant(name, joint, std, robot, louder)
            elif name == "command_delay_s" and "command_delay" not in drive.known:
                continue  # the range of an unknown delay
            elif std and name == "command_delay_s":
                later = (drive.command_delay_s or 0.0) + _STEP * std  # the delay may be zero
                other = replace(drive, command_delay_s=later)
                yield Constant(name, joint, 1.0, robot.with_drives({joint: other}), datasets)
            elif std and (value := getattr(drive, name, None)):
                relative = std / abs(value) if name in drive.std else std
                other = replace(drive, **{name: (1 + _STEP) * value})
                yield Constant(name, joint, relative, robot.with_drives({joint: other}), datasets)


def _with_torques(dataset: Dataset, joints: Sequence[int]) -> Dataset:
    """Return a motion with the logged inputs of some joints larger by `_STEP`."""
    if not isinstance(dataset, Motion):
        raise IdentificationError(
            "a standard deviation of the torques needs logs in memory: read them with read_log",
            "known_std=",
        )
    factor = np.ones(dataset.joint_position.shape[1])
    factor[list(joints)] += _STEP
    given = {name: getattr(dataset, name) for name in _CHANNELS}
    changes = {name: one * factor for name, one in given.items() if one is not None}
    return replace(dataset, **changes)


def with_known_std(
    found: RobotEstimate,
    constants: Iterator[Constant],
    estimate: Callable[[Robot, Sequence[Dataset]], RobotEstimate],
) -> RobotEstimate:
    """Return the estimates with the uncertainty of the constants in their covariances."""
    for constant in constants:
        other = estimate(constant.robot, constant.datasets)
        size = constant.std / _STEP
        found = replace(
            found,
            drives={
                joint: _propagated(one, other.drives[joint].values, size)
                for joint, one in found.drives.items()
            },
            load=_propagated(found.load, other.load.values, size),
            load_side=_propagated(found.load_side, other.load_side.values, size),
            whole=None
            if found.whole is None or other.whole is None
            else _propagated(found.whole, other.whole.values, size),
        )
        if constant.name == "torque":
            found = replace(found, findings=(*found.findings, shared_scale(constant.std)))
    return found


def _propagated(estimate: Estimate, other: Array, size: float) -> Estimate:
    """Return the estimate with the covariance of a change to `other` values, times `size`."""
    change = size * (other - estimate.values)
    return replace(estimate, covariance=estimate.covariance + np.outer(change, change))
