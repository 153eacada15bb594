"""Constants that were given as known, and the errors that theirs make in the estimates.

The moments H^T W (y - H theta) = 0 of an estimate hold exactly. At the true parameters their
residual is the noise e and, for constants with errors d, C d, where C are the derivatives of the
residual by the constants. So the estimate errs by (H^T W H)^-1 H^T W (e + C d), whatever made the
columns H (instruments too) and the weights W: the derivative by a constant needs one assembly of C
at the estimates, and nothing is estimated again. The way through the springs is the derivative of
the load side by their parameters (stacked moments: Newey and McFadden 1994, section 6).

A scale error of the torques changes all parameters together: their covariance says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from seaid._arrays import Array
from seaid.checks import shared_scale
from seaid.drives import IDEAL_DRIVE, STD_OF_TORQUE, Drive
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation import Estimate, FittedRows, Rows
from seaid.identification.datasets import Dataset, rows_of_equations
from seaid.identification.drive_estimates import TORQUE_OFFSET, offset_lever
from seaid.identification.simultaneous import simultaneous_regression
from seaid.identification.two_step import (
    CONSTANTS,
    LOAD,
    STIFFNESS,
    RobotEstimate,
    scales_with_torque,
    sensed_spring,
    without_torque,
)
from seaid.log import Log, Motion
from seaid.regressor import (
    LoadModel,
    Regress,
    Regression,
    actuator_regression,
    load_regression,
    spring_regression,
    spring_regressor,
    torque_changes,
    with_changes,
)
from seaid.robot import Robot

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

STEP = 1e-5
"""Relative change of a constant in difference quotients of residuals."""

_CHANNELS = ("motor_torque", "motor_current", "motor_voltage", "joint_torque")


Recorded = TypeVar("Recorded", Log, Motion)


@dataclass(frozen=True, eq=False)
class Constant:
    """A constant with a relative standard deviation, and a robot in which it is larger by `STEP`.

    `joint` is "" if it is common to all joints, or that of a body. `inputs` are the joints whose
    logged inputs are larger instead.
    """

    name: str
    joint: str
    std: float
    robot: Robot
    inputs: tuple[str, ...] = ()

    def scaled(self, data: Recorded) -> Recorded:
        """Return a log or motion with the larger inputs, itself for a constant of the robot."""
        if not self.inputs:
            return data
        factor = 1 + STEP * np.isin(data.joint_names, self.inputs)
        logged = [name for name in _CHANNELS if getattr(data, name) is not None]
        changes: dict[str, Any] = {name: getattr(data, name) * factor for name in logged}
        return replace(data, **changes)

    def is_in_drive(self, joint: str) -> bool:
        """Whether the equations of a joint's drive may contain it."""
        return bool(self.inputs) or (self.joint == joint and self.name != "bodies")


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
    is_scaled = bool(robot.known_bodies) and all(map(_has_unknown_scale, robot.drives.values()))
    is_exact = {name: _is_exact(drives, name) for name in TYPICAL_STD} | {
        "torque": not is_scaled and _lacks_std(drives or [IDEAL_DRIVE], STD_OF_TORQUE),
        "payload": bool(np.any(robot.payload_parameters)),
        "bodies": bool(robot.known_bodies),
    }
    return {x: std for x, std in TYPICAL_STD.items() if is_exact[x] and not known_std.get(x)}


def _is_exact(drives: Sequence[Drive], name: str) -> bool:
    """Whether drives have a constant, and one of them no standard deviation of it."""
    return any(getattr(x, name, None) for x in drives) and _lacks_std(drives, name)


def _lacks_std(drives: Sequence[Drive], name: str) -> bool:
    return any(name not in drive.std for drive in drives)


_INPUT_CONSTANTS = {"torque_constant", "voltage_constant"}


def scaled_by_bodies(drives: Mapping[str, Estimate], exact: Mapping[str, float]) -> list[str]:
    """Return the joints whose motor constants rest on known bodies, if these are `exact`."""
    constants = (joint for joint, x in drives.items() if _INPUT_CONSTANTS & set(x.names))
    return list(constants) if "bodies" in exact else []


def _has_unknown_scale(drive: Drive) -> bool:
    return drive.motor_input != "torque" and _INPUT_CONSTANTS.isdisjoint(drive.known)


def constants_of(robot: Robot, known_std: Mapping[str, float]) -> Iterator[Constant]:
    """Yield the constants that have a standard deviation: by `known_std`, or by their drive."""
    if known_std.get("torque"):
        yield Constant("torque", "", known_std["torque"], robot, robot.joint_names)
    if known_std.get("payload"):
        heavier = replace(robot, payload_parameters=(1 + STEP) * robot.payload_parameters)
        yield Constant("payload", "", known_std["payload"], heavier)
    for body in robot.known_bodies if known_std.get("bodies") else ():
        factor = np.where(np.repeat([x == body for x in robot.body_names], 10), 1 + STEP, 1.0)
        heavier = robot.with_values(factor * robot.parameters, robot.drives)
        yield Constant("bodies", body, known_std["bodies"], heavier)
    for joint in robot.drives:
        yield from _constants_of_drive(robot, joint, known_std)


def _constants_of_drive(
    robot: Robot, joint: str, known_std: Mapping[str, float]
) -> Iterator[Constant]:
    """Yield the constants of a drive that have a standard deviation, by `known_std` or its own."""
    drive = robot.drives[joint]
    stds = {name: std for name, std in known_std.items() if hasattr(drive, name)}
    for name, std in {**stds, **drive.std}.items():
        value, is_delay = getattr(drive, name, None) or 0.0, name == "command_delay_s"
        if not std or (is_delay and "command_delay" not in drive.known):
            continue  # the latter is the range of an unknown delay
        if name == STD_OF_TORQUE:
            yield Constant(name, joint, std, robot, (joint,))
        elif is_delay:
            later = _with_constant(robot, joint, name, value + STEP * std)  # value may be zero
            yield Constant(name, joint, 1.0, later)
        elif value:
            relative = std / abs(value) if name in drive.std else std
            larger = _with_constant(robot, joint, name, (1 + STEP) * value)
            yield Constant(name, joint, relative, larger)


def _with_constant(robot: Robot, joint: str, name: str, value: float) -> Robot:
    """Return the robot with a constant of one drive changed."""
    changes: dict[str, Any] = {name: value}
    return robot.with_drives({joint: replace(robot.drives[joint], **changes)})


def with_known_std(
    robot: Robot,
    datasets: Sequence[Dataset],
    model: LoadModel,
    sides: RobotEstimate,
    known_std: Mapping[str, float],
    executor: Executor | None = None,
) -> RobotEstimate:
    """Return the estimates with the uncertainty of the constants in their covariances."""
    constants = list(constants_of(robot, known_std))
    if not constants:
        return sides
    if sides.whole is None:
        equations = _equations(robot, model, sides, constants)
    else:
        equations = {LOAD: partial(_rows_at_once, robot, model, sides, constants)}
    stored = sides.fit.rows is None
    with rows_of_equations(datasets, equations, stored, executor, False) as rows:
        if sides.whole is None:
            slopes = _two_step_slopes(robot, sides, constants, rows)
        else:
            names = sides.whole.names
            slopes = dict(zip(names, sides.fit.slopes(rows[LOAD]), strict=True))
    # Steps are relative, as the standard deviations are; for a delay both are parts of its std.
    stds = np.array([constant.std for constant in constants])
    widened = partial(_widened, slopes=slopes, stds=stds)
    scales = [shared_scale(constant.std) for constant in constants if constant.name == "torque"]
    return replace(
        sides,
        drives={joint: widened(side, joint=joint) for joint, side in sides.drives.items()},
        load=widened(sides.load, names=sides.load_side.names[: len(sides.load.names)]),
        load_side=widened(sides.load_side),
        whole=None if sides.whole is None else widened(sides.whole),
        findings=(*sides.findings, *scales),
    )


def _widened(
    estimate: Estimate,
    slopes: Mapping[str, Array],
    stds: Array,
    joint: str = "",
    names: Sequence[str] | None = None,
) -> Estimate:
    """Return an estimate with the covariance of independent errors of the constants.

    `slopes` {name: (k,)} are derivatives by these, with standard deviations `stds` (k,). The
    estimate is that of a `joint`, or has these `names` in the slopes, by default its own.
    """
    keys = names or [f"{name} of {joint}" if joint else name for name in estimate.names]
    change = np.array([slopes[key] for key in keys]).reshape(len(keys), len(stds)) * stds
    return replace(estimate, covariance=estimate.covariance + change @ change.T)


def _rows_at_once(
    robot: Robot,
    model: LoadModel,
    sides: RobotEstimate,
    constants: Sequence[Constant],
    motion: Motion,
) -> Regression:
    """Return both sides at once, with the derivatives of their residual by the constants."""
    offsets = [joint for joint in sides.springs if TORQUE_OFFSET in sides.drives[joint].names]
    springs = tuple(sides.springs)
    regress = partial(simultaneous_regression, model=model, springs=springs, offsets=offsets)
    changed = (regress(constant.robot, constant.scaled(motion)) for constant in constants)
    return with_changes(regress(robot, motion), changed, sides.fit.estimate.values, STEP)


def _equations(
    robot: Robot, model: LoadModel, sides: RobotEstimate, constants: Sequence[Constant]
) -> dict[str, Regress]:
    """Return the functions for the rows of two steps, which propagate errors of the constants."""
    equations: dict[str, Regress] = {}
    for joint, fit in sides.actuators.items():
        of_drive = partial(_drive_rows, robot, constants, joint)
        equations[joint] = partial(of_drive, fit, actuator_regression)
        by_sensor = sides.scaling.get(joint)
        if by_sensor is not None and STIFFNESS in by_sensor.estimate.names:
            equations[sensed_spring(joint)] = partial(of_drive, by_sensor, spring_regression)
    return equations | {LOAD: partial(_load_rows, robot, model, sides, constants)}


def _drive_rows(
    robot: Robot,
    constants: Sequence[Constant],
    joint: str,
    fit: FittedRows,
    regress: Callable[[Robot, Motion, str], Regression],
    motion: Motion,
) -> Regression:
    """Return the rows of a drive's equation with the derivatives of their residual."""
    rows = regress(robot, motion, joint)
    changed = (
        regress(constant.robot, constant.scaled(motion), joint)
        if constant.is_in_drive(joint)
        else rows
        for constant in constants
    )
    # The unknown constant of a motor, which the estimate lacks, is 1 in a fit without its scale.
    values = dict(zip(fit.estimate.names, fit.estimate.values, strict=True))
    theta = np.array([values.get(name, 1.0) for name in rows.names])
    return with_changes(rows, changed, theta, STEP)


def _load_rows(
    robot: Robot,
    model: LoadModel,
    sides: RobotEstimate,
    constants: Sequence[Constant],
    motion: Motion,
) -> Regression:
    """Return the load side without the torques of springs, which propagates them and constants.

    With f_0 = s - b_0 N/r_M in `springs`, the column of the torque offset b_0 is in the residual.
    """

    def changes(piece: Motion) -> Array:
        changed = [(constant.robot, constant.scaled(piece)) for constant in constants]
        values = sides.springs, sides.load_side.values
        return torque_changes(robot, piece, model, *values, changed) / STEP

    return load_regression(robot, motion, model, without_torque(robot, sides.springs), changes)


def _two_step_slopes(
    robot: Robot, sides: RobotEstimate, constants: Sequence[Constant], rows: Mapping[str, Rows]
) -> dict[str, Array]:
    """Return {parameter: its derivatives (k,) by the constants} of both sides."""
    own = {joint: _motor_slopes(sides, joint, fit, rows) for joint, fit in sides.actuators.items()}
    springs = [(joint, x) for joint in sides.springs for x in spring_regressor(robot, joint).names]

    def of_load(fit: FittedRows) -> dict[str, Array]:
        """Return the derivatives of a fit of (8): direct ones, and those through the springs."""
        by_springs, direct = np.split(fit.slopes(rows[LOAD]), [len(springs)], axis=1)
        through = np.array([own[joint][name] for joint, name in springs])
        total = direct + by_springs @ through.reshape(len(springs), len(constants))
        return dict(zip(fit.estimate.names, total, strict=True))

    scales = {
        joint: _scale_slopes(sides, joint, own[joint], rows, of_load) for joint in sides.scaling
    }
    for joint, relative in scales.items():
        # The values are K x for a motor constant K, and x is at K = 1: d(K x) = K dx + K x dK/K.
        name, scale = _motor_constant(sides, joint)
        unit = sides.actuators[joint].estimate
        for place in np.flatnonzero(scales_with_torque(unit)):
            own[joint][unit.names[place]] += scale * unit.values[place] * relative
        own[joint][name] = scale * relative
    load = of_load(sides.fit)
    for joint in sides.springs:
        if f"{TORQUE_OFFSET} of {joint}" in load:
            _separate(robot, sides, joint, own[joint], load, constants)
    merged = {f"{name} of {joint}": own[joint][name] for joint in own for name in own[joint]}
    return {**merged, **load}


def _motor_constant(sides: RobotEstimate, joint: str) -> tuple[str, float]:
    """Return name and value of the unknown constant of a motor, 1 if it has none."""
    drive = sides.drives[joint]
    return next(((name, drive.value(name)) for name in CONSTANTS if name in drive.names), ("", 1.0))


def _motor_slopes(
    sides: RobotEstimate, joint: str, fit: FittedRows, rows: Mapping[str, Rows]
) -> dict[str, Array]:
    """Return the derivatives of a drive by (7), for a fixed constant of its motor."""
    slopes = fit.slopes(rows[joint])
    if joint in sides.scaling:
        slopes[scales_with_torque(fit.estimate)] *= _motor_constant(sides, joint)[1]
    return dict(zip(fit.estimate.names, slopes, strict=True))


def _scale_slopes(
    sides: RobotEstimate,
    joint: str,
    own: Mapping[str, Array],
    rows: Mapping[str, Rows],
    of_load: Callable[[FittedRows], dict[str, Array]],
) -> Array:
    """Return the relative derivatives (k,) of a motor's constant, which bodies or a sensor give."""
    fit, (name, scale) = sides.scaling[joint], _motor_constant(sides, joint)
    if f"{name} of {joint}" in fit.estimate.names:
        return of_load(fit)[f"{name} of {joint}"] / scale
    # K = k / k_1 with the stiffness k by the sensor and k_1 by (7), for a constant of 1.
    place = fit.estimate.names.index(STIFFNESS)
    by_sensor = fit.slopes(rows[sensed_spring(joint)])[place] / fit.estimate.values[place]
    unit = scale * sides.actuators[joint].estimate.value(STIFFNESS)
    return np.asarray(by_sensor - own[STIFFNESS] / unit)


def _separate(
    robot: Robot,
    sides: RobotEstimate,
    joint: str,
    own: dict[str, Array],
    load: dict[str, Array],
    constants: Sequence[Constant],
) -> None:
    """Give a drive the derivatives of f_0 = s - b_0 N/r_M and of b_0, from those of s and (8)."""
    lever, key = offset_lever(robot, joint), f"{TORQUE_OFFSET} of {joint}"
    changes = [offset_lever(constant.robot, joint) / lever - 1 for constant in constants]
    offset = sides.fit.estimate.value(key)
    own["spring_offset"] = own["spring_offset"] - lever * load[key]
    # (8) gives b_0 N/r_M: for a larger lever b_0 is smaller.
    own[TORQUE_OFFSET] = load[key] = load[key] - offset * np.array(changes) / STEP
