"""Errors of what was given as known, such as gear ratios, in all estimates.

The moments H^T W (y - H theta) = 0 of an estimate hold exactly. At the true parameters their
residual is the noise e and, for constants with errors d, C d, where C are the derivatives of the
residual by the constants. So the estimate errs by (H^T W H)^-1 H^T W (e + C d), whatever made the
columns H (instruments too) and the weights W: the derivative by a constant needs one assembly of C
at the estimates, and nothing is estimated again. The way through the springs is the derivative of
the load side by their parameters (stacked moments: Newey and McFadden 1994, section 6).

A scale error of the torques changes all parameters together: their covariance says so.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from seaid._arrays import Array, number
from seaid.checks.values import shared_scale
from seaid.drives import IDEAL_DRIVE, Drive, ParameterName, readable
from seaid.drives.drives import STD_OF_TORQUE
from seaid.drives.terms import MOTOR_CONSTANTS
from seaid.errors import IdentificationError, check_name
from seaid.estimation import Estimate
from seaid.estimation.estimate import independent_errors
from seaid.estimation.parameters import names_of_all
from seaid.identification import two_step
from seaid.identification.drive_estimates import without_torque
from seaid.identification.stacked_fits import (
    LOAD,
    KnownErrors,
    RobotEstimate,
    offset_lever,
    sensed_spring,
)
from seaid.log import Log, Motion
from seaid.regressor import Regression, actuator_regression, load_regression
from seaid.regressor.load import OFFSET_STEP, shifted_encoder, torque_changes
from seaid.regressor.regression import Regress, spring_regression, with_changes
from seaid.robot import Robot

TYPICAL_STD = {
    "torque": 0.03,
    "payload": 0.01,
    "bodies": 0.05,
    "motor_inertia_kg_m2": 0.05,
    "gear_ratio": 0.001,
    "motor_pulley_radius_m": 0.005,
    "load_pulley_radius_m": 0.005,
}
"""The names in `known_std`, with the values that the output proposes: tolerances of data sheets (of
K_t, of inertias), of scales, of masses by CAD, and of turned pulleys with their cable. The torques
have one scale error common to all, each known body has its own."""

STEP = 1e-5
"""Relative change of a constant in difference quotients of residuals."""

_CHANNELS = ("motor_torque", "motor_current", "motor_voltage", "joint_torque")


Recorded = TypeVar("Recorded", Log, Motion)


@dataclass(frozen=True, eq=False)
class Constant:
    """A constant with a standard deviation, and a `robot` in which it is larger by a step.

    `std` is in units of the step over `STEP`: relative for a step of `STEP` times the value, and 1
    for a delay, whose step is `STEP` of its standard deviation. `joint` is "" if the constant is
    common to all joints, or the name of a body. `inputs` are the joints whose inputs are larger:
    logged ones, and the gains of controllers in the robot. The offset of a joint's encoder, whose
    step is `OFFSET_STEP`, is in the motion alone.
    """

    name: str
    joint: str
    std: float
    robot: Robot
    inputs: tuple[str, ...] = ()

    @property
    def is_offset(self) -> bool:
        """Whether it is an encoder offset, which each condition has for itself."""
        return self.name == two_step.ENCODER_OFFSET

    @property
    def key(self) -> ParameterName:
        """Its name among the errors of what is known."""
        return ParameterName(self.name, self.joint)

    def changed(self, motion: Motion) -> Motion:
        """Return a motion with the larger inputs, or with the encoder offset."""
        if self.is_offset:
            return shifted_encoder(self.robot, motion, self.robot.index(self.joint))
        return self.scaled(motion)

    def scaled(self, data: Recorded) -> Recorded:
        """Return a log or motion with the larger logged inputs, itself without any."""
        if not self.inputs:
            return data
        factor = 1 + STEP * np.isin(data.joint_names, self.inputs)
        logged = [name for name in _CHANNELS if getattr(data, name) is not None]
        changes: dict[str, Any] = {name: getattr(data, name) * factor for name in logged}
        return replace(data, **changes)

    def is_in_drive(self, joint: str) -> bool:
        """Whether the equations of a joint's drive may contain it.

        Those of any drive may contain a larger input, since coupled drives share torques.
        """
        return bool(self.inputs) or (
            self.joint == joint and self.name not in ("bodies", two_step.ENCODER_OFFSET)
        )


def check_known_std(known_std: Mapping[str, float]) -> None:
    """Raise IdentificationError for an unknown name, and for what is no relative deviation."""
    for name, std in known_std.items():
        check_name("constant", name, TYPICAL_STD, IdentificationError, "known_std=", "known_std=")
        of_constant = f"known_std of '{name}'"
        if not 0 < number(of_constant, std, IdentificationError) <= 1:
            text = f"must be a relative standard deviation above 0 and at most 1, found {std}"
            raise IdentificationError(f"{of_constant} {text}", "known_std")


def check_in_use(robots: Collection[Robot], known_std: Mapping[str, float]) -> None:
    """Raise IdentificationError for a standard deviation of what none of the robots has."""
    used = {constant.name for robot in robots for constant in constants_of(robot, known_std)}
    if not any(np.any(robot.payload_parameters) for robot in robots):  # one condition may have none
        used.discard("payload")
    for name in known_std.keys() - used:
        text = f"known_std has '{name}', and of the robot none is known: leave it out, or give it"
        raise IdentificationError(text, "known_std")


def exact_constants(robot: Robot, known_std: Mapping[str, float]) -> dict[str, float]:
    """Return the constants in use without a standard deviation, with their `TYPICAL_STD`."""
    drives = [drive for drive in robot.drives.values() if drive != IDEAL_DRIVE]
    is_scaled = bool(robot.known_bodies) and all(map(_has_unknown_scale, robot.drives.values()))
    is_exact = {name: _is_exact(drives, name) for name in TYPICAL_STD} | {
        "torque": not is_scaled and _lacks_std(drives or [IDEAL_DRIVE], STD_OF_TORQUE),
        "payload": bool(np.any(robot.payload_parameters)),
        "bodies": bool(robot.known_bodies),
    }
    return {x: std for x, std in TYPICAL_STD.items() if is_exact[x] and x not in known_std}


def _is_exact(drives: Sequence[Drive], name: str) -> bool:
    """Whether drives have a constant, and one of them no standard deviation of it."""
    return any(getattr(x, name, None) for x in drives) and _lacks_std(drives, name)


def _lacks_std(drives: Sequence[Drive], name: str) -> bool:
    return any(name not in drive.std for drive in drives)


_INPUT_CONSTANTS = {*MOTOR_CONSTANTS.values()}


def scaled_by_bodies(drives: Mapping[str, Estimate], exact: Mapping[str, float]) -> list[str]:
    """Return the joints whose motor constants rest on known bodies, if these are `exact`."""
    constants = (joint for joint, x in drives.items() if _INPUT_CONSTANTS & set(x.names))
    return list(constants) if "bodies" in exact else []


def _has_unknown_scale(drive: Drive) -> bool:
    return drive.motor_input != "torque" and _INPUT_CONSTANTS.isdisjoint(drive.known)


def constants_of(robot: Robot, known_std: Mapping[str, float]) -> Iterator[Constant]:
    """Yield the constants that have a standard deviation: by `known_std`, or by their drive."""
    if "torque" in known_std:
        larger = _with_larger_gains(robot, robot.joint_names)
        yield Constant("torque", "", known_std["torque"], larger, robot.joint_names)
    if "payload" in known_std:
        heavier = replace(robot, payload_parameters=(1 + STEP) * robot.payload_parameters)
        yield Constant("payload", "", known_std["payload"], heavier)
    for body in robot.known_bodies if "bodies" in known_std else ():
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
        if is_delay and "command_delay" not in drive.known:
            continue  # the latter is the range of an unknown delay
        if name == STD_OF_TORQUE:
            yield Constant(name, joint, std, _with_larger_gains(robot, [joint]), (joint,))
        elif is_delay:
            later = _with_constant(robot, joint, name, value + STEP * std)  # value may be zero
            yield Constant(name, joint, 1.0, later)
        elif value:
            relative = std / abs(value) if name in drive.std else std
            larger = _with_constant(robot, joint, name, (1 + STEP) * value)
            yield Constant(name, joint, relative, larger)


def _with_larger_gains(robot: Robot, joints: Sequence[str]) -> Robot:
    """Return the robot whose controllers at some joints give a torque larger by `STEP`."""
    drives = {}
    for joint in joints:
        if (controller := robot.drives[joint].controller) is not None:
            larger = controller.times(1 + STEP)
            larger = replace(larger, is_up_to_scale=controller.is_up_to_scale)
            drives[joint] = replace(robot.drives[joint], controller=larger)
    return robot.with_drives(drives)


def _with_constant(robot: Robot, joint: str, name: str, value: float) -> Robot:
    """Return the robot with a constant of one drive changed."""
    changes: dict[str, Any] = {name: value}
    return robot.with_drives({joint: replace(robot.drives[joint], **changes)})


def encoder_offsets(robot: Robot, std: float) -> list[Constant]:
    """Return the offsets of the joint encoders with a standard deviation [rad or m], if any."""
    part = std * STEP / OFFSET_STEP  # in units of the step over `STEP`, see `Constant`
    return [Constant(two_step.ENCODER_OFFSET, x, part, robot) for x in robot.joint_names if std]


@dataclass(frozen=True, eq=False)
class GivenConstants:
    """What was given as known of the robots of all conditions, with standard deviations.

    `constants` {condition: its constants} have one error in all conditions, as the drives are the
    same ones; or they are encoder offsets, which are zeroed anew in each.
    """

    conditions: Mapping[str, two_step.Condition]
    constants: Mapping[str, Sequence[Constant]]
    specific: two_step.SpecificParameters

    @property
    def common(self) -> Sequence[Constant]:
        """The constants of all conditions, with the robot of the first one."""
        return next(iter(self.constants.values()))

    @property
    def errors(self) -> Estimate:
        """The errors, of steps that are relative as the standard deviations are."""
        stds = {constant.key: constant.std for constant in self.common}
        own = [x.key for x in self.common if x.is_offset and len(self.conditions) > 1]
        names = {key: names_of_all([key], [*self.conditions], own.__contains__) for key in stds}
        return independent_errors({str(name): stds[key] for key in names for name in names[key]})

    def known_errors(self, estimates: Mapping[str, RobotEstimate]) -> KnownErrors:
        """Return the errors with the slopes of estimates."""
        sides, errors, load = next(iter(estimates.values())), self.errors, None
        fits, first, k = sides.fits, next(iter(self.conditions.values())), len(errors.names)
        equations = {
            name: _equations(name, x, estimates[name], self.constants[name])
            for name, x in self.conditions.items()
        }
        # the last columns of the rows propagate the errors
        with two_step.rows_of_conditions(
            self.conditions,
            self.specific,
            equations,
            two_step.propagated_names(first.robot, [*sides.springs]),
            sides.fit.rows is None,
            error_names=[constant.key for constant in self.common],
        ) as (rows, _):
            slopes = {
                key: fit.slopes(rows[equation])[:, 0 if key == LOAD else -k :]
                for key, equation, fit in fits.equations
            }
            if fits.refit is not None and self.common[0].is_offset:
                load = fits.refit(rows[LOAD], errors.covariance)
        levers = {}  # relative derivatives of N/r_M by each error: those of encoders change nothing
        for joint in fits.springs:
            after = np.array([offset_lever(constant.robot, joint) for constant in self.common])
            changes = (after / offset_lever(fits.robot, joint) - 1) / STEP
            levers[joint] = np.pad(changes, (0, k - len(changes)))
        return KnownErrors(errors, slopes, levers, load, 0 if load is None else k)

    def included(self, estimates: Mapping[str, RobotEstimate]) -> Mapping[str, RobotEstimate]:
        """Return the estimates of all conditions with these errors after those that they have."""
        if not self.common:
            return estimates
        known = next(iter(estimates.values())).known.with_further(self.known_errors(estimates))
        wide = {name: x.with_errors(known, name) for name, x in estimates.items()}
        scales = [shared_scale(x.std) for x in self.common if x.name == "torque"]
        return {name: replace(x, findings=(*x.findings, *scales)) for name, x in wide.items()}


def constants_of_conditions(
    conditions: Mapping[str, two_step.Condition], known_std: Mapping[str, float]
) -> Mapping[str, list[Constant]]:
    """Return the constants of each condition that have a standard deviation."""
    constants = {name: list(constants_of(x.robot, known_std)) for name, x in conditions.items()}
    _check_same(constants)
    return constants


def _check_same(constants: Mapping[str, Sequence[Constant]]) -> None:
    """Raise IdentificationError for conditions with standard deviations of different constants."""
    stds = {
        condition: {ParameterName(x.name, x.joint): x.std for x in stated}
        for condition, stated in constants.items()
    }
    (first, of_first), *others = stds.items()
    for condition, of_other in others:
        if of_other != of_first:
            differing = sorted({*of_first.items()} ^ {*of_other.items()})[0][0]
            raise IdentificationError(
                f"conditions '{first}' and '{condition}' have different standard deviations of "
                f"{readable(differing)}, whose error all conditions share: give both the same"
            )


def _with_constants(
    robot: Robot,
    constants: Sequence[Constant],
    values: Mapping[str, float],
    regress: Callable[[Robot, Motion], Regression],
    motion: Motion,
    joint: str = "",
) -> Regression:
    """Return rows with the derivatives of their residual by the constants, at values.

    Those of the equation of a `joint` may lack some. An offset of an encoder is in the offset of
    its spring, and in nothing else.
    """
    rows = regress(robot, motion)
    changed = (
        rows if joint and not x.is_in_drive(joint) else regress(x.robot, x.changed(motion))
        for x in constants
    )
    # The unknown constant of a motor, which the estimate lacks, is 1 in a fit without its scale.
    theta = np.array([values.get(name, 1.0) for name in rows.names])
    return with_changes(rows, changed, theta, STEP)


def _equations(
    name: str, condition: two_step.Condition, sides: RobotEstimate, constants: Sequence[Constant]
) -> dict[str, Regress]:
    """Return the functions for the rows of a condition, which propagate errors of the constants."""
    robot, fits, equations = condition.robot, sides.fits, dict[str, Regress]()
    if sides.regress is not None:
        values = sides.fit.estimate.by_name
        return {LOAD: partial(_with_constants, robot, constants, values, sides.regress)}
    of_drives = {x: (x, fit, actuator_regression) for x, fit in sides.actuators.items()}
    for joint, fit in fits.by_sensor.items():
        of_drives[sensed_spring(joint)] = joint, fit, spring_regression
    for equation, (joint, fit, regress) in of_drives.items():
        values, rows_of = fit.estimate.of_condition(name).by_name, partial(regress, joint=joint)
        equations[equation] = partial(
            _with_constants, robot, constants, values, rows_of, joint=joint
        )
    return equations | {LOAD: partial(_load_rows, condition, sides, constants)}


def _load_rows(
    condition: two_step.Condition,
    sides: RobotEstimate,
    constants: Sequence[Constant],
    motion: Motion,
) -> Regression:
    """Return the load side without the torques of springs, which propagates them and constants.

    With f_0 = s - b_0 N/r_M in `springs`, the column of the torque offset b_0 is in the residual;
    see `with_torque_columns`.
    """
    robot, model, theta = condition.robot, condition.model, sides.load_side.values
    zero = without_torque(robot, sides.springs)
    if constants[0].is_offset:
        # An offset turns gravity, and so the columns of the bodies.
        regress = partial(load_regression, model=model, springs=sides.springs)
        offsets = _with_constants(robot, constants, sides.load_side.by_name, regress, motion)
        rows = load_regression(robot, motion, model, zero)
        return replace(rows, propagated=np.hstack([rows.propagated, offsets.propagated]))

    def changes(piece: Motion) -> Array:
        changed = [(constant.robot, constant.changed(piece)) for constant in constants]
        return torque_changes(robot, piece, model, sides.springs, theta, changed) / STEP

    return load_regression(robot, motion, model, zero, changes)
