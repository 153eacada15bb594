"""Instruments: the columns of both sides from a motion of the fitted model.

The joints are taken to go where a narrow low pass of the measurement says; the fitted model tells
all the rest, so that no instrument has the noise of its own column in it:

- motor angle, speed and acceleration of a sprung joint are N/r_M (d + r_L q) of the *joint*
  encoder, with the fitted deflection d. Noise of the motor encoder, which is in the speed and in
  the torque of the rotor's inertia, is not in them.
- the deflection is torque over stiffness, the torque that of the fitted bodies. Noise of the joint
  encoder reaches it only through them, as part (stiffness of gravity and inertia over that of the
  spring) of what the measured deflection has, and only from inside the narrow band.
- on the load side joint noise from inside the narrow band would still be in acceleration and
  torque alike: once there is an estimate the joints are simulated from the motor encoders instead
  (`driven_motion`).
- a stiff drive has one sensor or two that tell the same, and the motor of a spring that carries no
  known torque is smoothed as it is; there the narrow band alone helps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.filtering import low_pass, spline_derivatives
from seaid.motion import Motion
from seaid.motion_rows import in_band
from seaid.regression import Regression, actuator_columns, actuator_regression
from seaid.robot import Robot
from seaid.sides.driven_motion import driven_motion
from seaid.sides.load_model import LoadModel
from seaid.sides.load_side import load_columns, load_regression
from seaid.sides.method_limits import straight_spring
from seaid.transmission import at_drives

REFERENCE_BAND = 0.5
"""Pass band of the reference motion over that of the identification, three times the motion's."""

_PREFIX = "instrument of "


@dataclass(frozen=True, eq=False)
class FittedModel:
    """What instruments are computed with: bodies and springs of an estimate before.

    `load_side` (p,) has the values of the columns of `model`; `springs` {joint: values} those of
    the springs' regressors.
    """

    model: LoadModel
    load_side: Array
    springs: Mapping[str, Array]


Maker = Callable[[Robot, Motion, FittedModel], Motion]
"""What makes the motion that instruments are columns of."""


def instrument_motion(robot: Robot, motion: Motion, fitted: FittedModel) -> Motion:
    """Return the motion that the fitted model makes of the smoothed joint positions.

    Torques and pass band are those of the measured motion.
    """
    band = REFERENCE_BAND * motion.cutoff_hz
    smooth = low_pass(motion.joint_position, motion.rate_hz, band)
    q, v, a = spline_derivatives(motion.time, smooth)
    turned = at_drives(robot.transmission, q)
    angle = low_pass(motion.motor_position, motion.rate_hz, band)
    for index, joint in enumerate(robot.joint_names):
        if joint not in robot.elastic_joints:
            angle[:, index] = robot.drivetrains[joint].ratio * turned[:, index]
    reference = _with_motors(
        replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a), angle
    )
    _, payload, H, _ = load_columns(robot, reference, fitted.model, fitted.springs)
    torque = payload + H @ fitted.load_side
    for row, joint in enumerate(fitted.model.rows):
        drive, index = robot.drivetrains[joint], robot.index(joint)
        if joint in fitted.springs and isinstance(drive, SeriesElasticDrive):
            spring = straight_spring(robot, joint, fitted.springs[joint])
            force = torque[:, row] / drive.load_radius - spring.offset
            deflection = force / spring.stiffness  # (4b); an instrument may lack its damping
            travel = deflection + drive.load_radius * turned[:, index]
            angle[:, index] = drive.ratio / drive.motor_radius * travel
    return _with_motors(reference, angle)


def motor_driven_motion(robot: Robot, motion: Motion, fitted: FittedModel) -> Motion:
    """Return the motion that the fitted model makes of the motors' angles: see `driven_motion`."""
    return driven_motion(robot, motion, fitted.model, fitted.springs, fitted.load_side)


def _with_motors(motion: Motion, angle: Array) -> Motion:
    """Return the motion with motors at other angles (T, n) [rad]."""
    position, speed, acceleration = spline_derivatives(motion.time, angle)
    return replace(
        motion, motor_position=position, motor_velocity=speed, motor_acceleration=acceleration
    )


def actuator_with_instruments(
    robot: Robot, motion: Motion, joint: str, fitted: FittedModel
) -> Regression:
    """Return `actuator_regression` with the instruments beside its columns."""
    rows = actuator_regression(robot, motion, joint)
    made = instrument_motion(robot, motion, fitted)
    Z = in_band(made, actuator_columns(robot, made, joint)[2])
    return beside(rows, Z[np.searchsorted(motion.time, rows.time)])


def load_with_instruments(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    fitted: FittedModel,
    make: Maker = instrument_motion,
) -> Regression:
    """Return `load_regression` with the instruments beside its columns, of the motion it makes."""
    rows = load_regression(robot, motion, model, springs)
    made = make(robot, motion, fitted)
    Z = in_band(made, load_columns(robot, made, model, springs)[2])
    row_of = {robot.index(joint): row for row, joint in enumerate(model.rows)}
    which = [row_of[int(index)] for index in rows.joint]
    return beside(rows, Z[np.searchsorted(motion.time, rows.time), which])


def beside(rows: Regression, instruments: Array) -> Regression:
    """Return rows whose further columns are the instruments of the first ones."""
    return replace(
        rows,
        names=(*rows.names, *(_PREFIX + name for name in rows.names)),
        units=(*rows.units, *rows.units),
        H=np.hstack([rows.H, instruments]),
    )


def apart(rows: Regression) -> tuple[Regression, Array]:
    """Return the rows of `beside` and the instruments."""
    p = len(rows.names) // 2
    plain = replace(rows, names=rows.names[:p], units=rows.units[:p], H=rows.H[:, :p])
    return plain, rows.H[:, p:]
