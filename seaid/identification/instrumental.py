"""Instrumental variables of both sides: columns computed from a motion of the fitted model.

The joints follow a low pass of their measurement with a smaller cutoff; all other signals are
computed by the fitted model, so that no instrument contains the noise of its own column:

- Motor angle, speed and acceleration of an elastic joint are N/r_M (d + r_L q) of the *joint*
  encoder, with the fitted deflection d. They are free of noise of the motor encoder, which is in
  the speed and in the inertial torque of the rotor.
- The deflection is torque over stiffness, with the torque of the fitted bodies. Noise of the joint
  encoder affects it only through them, by the ratio of the stiffness of gravity and inertia to
  that of the spring, and only below the smaller cutoff.
- A stiff drive has one sensor, or two equivalent ones, and the motor of a spring without a known
  torque is smoothed as it is; there only the smaller cutoff helps.

The instruments come from the previous estimate, iterated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from seaid._arrays import Array
from seaid.checks.values import instruments_of_stiff_drives
from seaid.drives import readable
from seaid.errors import IdentificationError
from seaid.estimation import Estimator
from seaid.estimation.instrumental_variables import instrumental, projected_columns
from seaid.identification.drive_estimates import without_torque
from seaid.identification.stacked_fits import LOAD, RobotEstimate, spring_of
from seaid.identification.two_step import (
    ONLY,
    Condition,
    Procedure,
    estimate_two_step,
    nonlinear_springs,
)
from seaid.log import Motion, in_band, low_pass
from seaid.log.filtering import spline_derivatives
from seaid.regressor import Regression, actuator_regression, load_regression
from seaid.regressor.load import LoadModel, Springs, known_frictions, load_side, where_known
from seaid.regressor.regression import Regress, actuator_columns, known_friction, spring_regressor
from seaid.robot import Robot, at_drives

REFERENCE_BAND = 0.5
"""Cutoff of the reference motion over that of the identification: three times the bandwidth."""

_PREFIX = "instrument of "


@dataclass(frozen=True, eq=False)
class FittedModel:
    """The bodies and springs of a fit of (8).

    `load_side` (p,) has the values of the columns of `model`; `springs` {joint: values} those of
    the springs' regressors.
    """

    model: LoadModel
    load_side: Array
    springs: Springs


def instrument_motion(robot: Robot, motion: Motion, fitted: FittedModel) -> Motion:
    """Return the fitted model's motion for smoothed joint positions, with measured torques."""
    band = REFERENCE_BAND * motion.cutoff_hz
    smooth = low_pass(motion.joint_position, motion.rate_hz, band)
    q, v, a = spline_derivatives(motion.time, smooth)
    turned = at_drives(robot.transmission, q)
    # A motor of a spring outside of the model follows its own encoder, smoothed.
    angle = low_pass(motion.motor_position, motion.rate_hz, band)
    for index, joint in enumerate(robot.joint_names):
        if joint not in robot.elastic_joints:
            angle[:, index] = robot.drives[joint].ratio * turned[:, index]
    reference = _with_motors(
        replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a, deflection=None),
        angle,
    )
    columns = load_side(robot).columns(reference, fitted.model, fitted.springs)
    torque = columns.payload + columns.H @ fitted.load_side
    for row, joint in enumerate(fitted.model.torque_joints):
        drive, index = robot.drives[joint], robot.index(joint)
        if joint in fitted.springs:
            stiffness, offset = _linear_spring(robot, joint, fitted.springs[joint])
            force = torque[:, row] / drive.load_radius - offset
            deflection = force / stiffness  # (4b); an instrument may lack its damping
            # r_M/N theta_M = d + r_L theta_L.
            travel = deflection + drive.load_radius * turned[:, index]
            angle[:, index] = drive.ratio / drive.motor_radius * travel
    return _with_motors(reference, angle)


def _linear_spring(robot: Robot, joint: str, estimated: Iterable[float]) -> tuple[float, float]:
    """Return stiffness and offset of a spring, known or in the order of its regressor."""
    names = spring_regressor(robot, joint).names
    values = dict(robot.drives[joint].values)
    values.update(zip(names, estimated, strict=True))
    return values["stiffness"], values.get("spring_offset", 0.0)


def _with_motors(motion: Motion, angle: Array) -> Motion:
    """Return the motion with other motor angles (T, n) [rad]."""
    position, speed, acceleration = spline_derivatives(motion.time, angle)
    return replace(
        motion,
        motor_position=position,
        motor_velocity=speed,
        motor_acceleration=acceleration,
        motor_direction=None,
    )


def actuator_with_instruments(
    robot: Robot, motion: Motion, joint: str, fitted: FittedModel
) -> Regression:
    """Return `actuator_regression` with the instruments as further columns."""
    rows = actuator_regression(robot, motion, joint)
    made = instrument_motion(robot, motion, fitted)
    # Instruments pass the filter of the rows, and are taken at their instants: column by column
    # they stand for the same quantity, without its noise.
    regressor, _, Z = actuator_columns(robot, made, joint)
    # Where friction is known is decided by the measured motion, for instruments as for the rows.
    Z = in_band(made, known_friction(robot, motion, joint, regressor)[:, None] * Z)
    return with_instruments(rows, Z[np.searchsorted(motion.time, rows.time)])


def load_with_instruments(
    robot: Robot, motion: Motion, springs: Springs, fitted: FittedModel
) -> Regression:
    """Return `load_regression` with the instruments as further columns."""
    model, made = fitted.model, instrument_motion(robot, motion, fitted)
    rows = load_regression(robot, motion, model, springs)
    # Where friction is known is decided by the measured motion, for instruments as for the rows.
    known = known_frictions(robot, motion, model.torque_joints)
    Z = in_band(made, where_known(known, load_side(robot).columns(made, model, springs).H))
    row_of = {robot.index(joint): row for row, joint in enumerate(model.torque_joints)}
    which = [row_of[int(index)] for index in rows.joint]
    return with_instruments(rows, Z[np.searchsorted(motion.time, rows.time), which])


def with_instruments(rows: Regression, instruments: Array) -> Regression:
    """Return rows with the instruments of their columns as further columns."""
    return rows.with_columns((_PREFIX + name for name in rows.names), rows.units, instruments)


def split_instruments(rows: Regression) -> tuple[Regression, Array]:
    """Return the rows without instruments, and the instruments."""
    p = len(rows.names) // 2
    return rows.of_columns(range(p)), rows.H[:, p:]


SETTLED = 0.01
"""Part of a standard error below which a change of the estimate is negligible."""

_MOST_ITERATIONS = 20
"""Sets of instruments after which an estimate is refused, since it does not converge."""


def estimate_instrumental(condition: Condition, start: RobotEstimate) -> RobotEstimate:
    """Estimate both sides by instrumental variables, starting from least squares.

    The instruments come from the previous estimate until no parameter changes by more than a small
    part of its standard error (Janot, Vandanjon and Gautier 2014). A robot without springs has a
    note. Raises IdentificationError if the estimates do not converge, and as `instrumental` does.
    """
    robot, model, joints = condition.robot, condition.model, condition.model.torque_joints
    BY_INSTRUMENTS.check(robot, [joint for joint in joints if joint in robot.elastic_joints])
    estimate = start
    for _ in range(_MOST_ITERATIONS):
        before, equations = estimate, _equations(robot, model, estimate)
        fits = estimate_two_step({ONLY: condition}, _BY_ROWS, equations=equations)
        estimate = fits.of(ONLY)
        steps = estimate.moved_from(before)
        moved = {name: step for name, step in steps.items() if step > SETTLED}
        if not moved:
            notes = () if robot.elastic_joints else (instruments_of_stiff_drives(),)
            return replace(estimate, findings=notes)
    worst = max(moved, key=lambda name: moved[name])
    raise IdentificationError(
        f"instrumental variables did not converge in {_MOST_ITERATIONS} iterations: "
        f"{readable(worst)} still changes by {moved[worst]:.2g} standard errors; move that joint "
        "more, or use estimator='wls'",
        "estimator='wls'",
    )


BY_INSTRUMENTS = Procedure(
    option='estimator="iv"',
    limits=partial(nonlinear_springs, set[str]()),
    only="supports springs of one stiffness",
    instead='use estimator="wls"',
    held="its instruments are a simulation, and seaid does not simulate contacts",
    continued=lambda condition, start, _: estimate_instrumental(condition, start),
)

_BY_ROWS = Estimator(
    lambda rows, propagated: instrumental(*split_instruments(rows), propagated),
    effective_rows=lambda rows, _: split_instruments(rows)[0],
    columns=lambda rows: projected_columns(*split_instruments(rows)),
)
"""The estimator of rows with their instruments as further columns."""


def _equations(robot: Robot, model: LoadModel, estimate: RobotEstimate) -> dict[str, Regress]:
    """Return the functions for the rows of both sides, with instruments by an estimate."""
    fitted, zero = _fitted(robot, model, estimate), without_torque(robot, estimate.springs)
    equations: dict[str, Regress] = {
        joint: partial(actuator_with_instruments, robot, joint=joint, fitted=fitted)
        for joint in robot.elastic_joints
    }
    load = partial(load_with_instruments, robot, springs=zero, fitted=fitted)
    return equations | {LOAD: load}


def _fitted(robot: Robot, model: LoadModel, sides: RobotEstimate) -> FittedModel:
    springs = {
        joint: spring_of(robot, sides.drives[joint], joint).values
        for joint in model.torque_joints
        if joint in robot.elastic_joints
    }
    bad = [
        joint for joint, values in springs.items() if _linear_spring(robot, joint, values)[0] <= 0
    ]
    if bad:
        raise IdentificationError(
            f"the estimated stiffness of {', '.join(bad)} is not positive, so the fitted model "
            "predicts no deflection; load this spring more, or use estimator='wls'",
            "estimator='wls'",
        )
    return FittedModel(model, sides.load_side.values, springs)
