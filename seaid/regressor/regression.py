"""Regression: y = H theta over time, (15); the actuator side (10).

The regressors of drives are evaluated at the signals of a motion; regressor and torque are filtered
by the same low pass and then decimated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, freeze
from seaid.drives import ParameterName, is_dry, motor_equation, spring_equation, total_ratio
from seaid.drives.equations import joint_equation
from seaid.drives.regressor import drive_regressor
from seaid.errors import LogError
from seaid.log import Motion, row_samples, standstill
from seaid.log.filtering import is_friction_known, long_rests, moving
from seaid.log.motion import POSITION_BAND
from seaid.log.rows import PIECE_SAMPLES, in_band_at, pieces
from seaid.regressor.base import INPUTS
from seaid.robot import at_drives, torques_at_drives

if TYPE_CHECKING:
    from seaid.drives import Drive
    from seaid.drives.regressor import DriveRegressor
    from seaid.log import LongLog
    from seaid.robot import Robot


def motor_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the motor equation (7) of a joint."""
    return _regressor(motor_equation, robot.drives[joint], joint)


def spring_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the spring equation (4b) of an elastic joint."""
    drive = robot.drives[joint]
    if not drive.is_elastic:
        raise LogError(f"joint '{joint}' has no spring")
    return _regressor(spring_equation, drive, joint)


def joint_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor of the joint terms: parallel spring and joint friction."""
    return _regressor(joint_equation, robot.drives[joint], joint)


def under_load(robot: Robot, used: Sequence[str]) -> tuple[str, ...]:
    """Return the joints among `used` whose stiff drive has load-dependent friction."""
    return tuple(
        joint
        for joint in used
        if joint not in robot.elastic_joints and "load" in robot.drives[joint].friction
    )


def is_linear(robot: Robot, used: Sequence[str]) -> bool:
    """Whether springs and joints `used` are linear, without load-dependent friction."""
    joints = dict.fromkeys((*robot.elastic_joints, *used))
    return not under_load(robot, used) and not any(
        motor_regressor(robot, joint).non_linear for joint in joints
    )


@cache
def _regressor(equation: Callable[[Drive], Any], drive: Drive, joint: str) -> DriveRegressor:
    return drive_regressor(equation(drive), drive, joint)


def signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return the signals {name: (T,)} of a drive's equations, with a load torque of zero.

    theta_L is the drive's coordinate phi = C q, or r_M/(N r_L) theta_M less the deflection if this
    was measured. Speeds that are nothing but rounding are set to zero, because their sign, and with
    it friction, would depend on the processor.
    """
    states = [at_drives(robot.transmission, state)[:, index] for state in motion.joint_states]
    position, velocity, acceleration = states
    drive, warmth = robot.drives[robot.joint_names[index]], motion.motor_temperature
    speed = moving(motion.motor_velocity[:, index])
    warmth = None if warmth is None else warmth - drive.reference_temperature_degC
    if drive.is_elastic and has_deflection(motion, index):
        assert motion.deflection is not None
        assert motion.deflection_rate is not None
        # r_L theta_L = r_M/N theta_M - d: what the spring sees, with the gear's wind-up
        lever = 1.0 / total_ratio(drive)
        position = lever * motion.motor_position[:, index] - motion.deflection[:, index]
        velocity = lever * motion.motor_velocity[:, index] - motion.deflection_rate[:, index]
    return {
        "theta_M": motion.motor_position[:, index],
        "theta_M_dot": speed,
        "theta_M_sign": _direction(motion, index, speed),
        "theta_M_ddot": motion.motor_acceleration[:, index],
        "theta_L": position,
        "theta_L_dot": moving(velocity),
        "theta_L_ddot": acceleration,
        "tau_M": _without_delay(motion, index),
        "tau_C_dot": _channel(motion.command_slope, motion, index),
        "tau_L": np.broadcast_to(0.0, len(motion.time)),
        "i_M": _channel(motion.motor_current, motion, index),
        "u_M": _channel(motion.motor_voltage, motion, index),
        "tau_G": _channel(motion.gear_torque, motion, index),
        "Delta_T": _channel(warmth, motion, index),
        "t_log": motion.time - motion.start_s,
    }


def has_deflection(motion: Motion, index: int) -> bool:
    """Whether the deflection of a joint's spring was measured by a sensor of its own."""
    return motion.deflection is not None and bool(np.isfinite(motion.deflection[0, index]))


def input_signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return `signals`, with joint torque / N where a stiff gear's motor torque was not logged."""
    by_name, drive = signals(robot, motion, index), robot.drives[robot.joint_names[index]]
    if np.all(np.isnan(by_name["tau_M"])) and drive.motor_input == "torque":
        by_name["tau_M"] = sensed_torque(robot, motion, index) / drive.ratio
    return by_name


def _without_delay(motion: Motion, index: int) -> Array:
    """Return the motor torque (T,), that of a command without its delay, to first order in it."""
    torque = motion.motor_torque[:, index]
    if motion.command_slope is None:
        return torque
    # u(t) = u(t - T) + T u'(t - T): the commands before the delay T of the drive.
    return np.asarray(torque + motion.command_delay_s[index] * motion.command_slope[:, index])


def _direction(motion: Motion, index: int, speed: Array) -> Array:
    """Return the mean of sign(motor speed) (T,) about the samples, or its sign at them."""
    known = motion.motor_direction
    if known is None or np.isnan(known[0, index]):
        return np.sign(speed)
    return known[:, index]


def _channel(samples: Array | None, motion: Motion, index: int) -> Array:
    """Return a channel (T,) of a joint, NaN without it: one number, of which T are seen."""
    return np.broadcast_to(np.nan, len(motion.time)) if samples is None else samples[:, index]


def sensed_torque(robot: Robot, motion: Motion, index: int) -> Array:
    """Return the torque (T,) on a drive's coordinate by joint torque sensors, NaN without all."""
    return np.asarray(torques_at_drives(robot.transmission, motion.joint_torque)[:, index])


@dataclass(frozen=True, eq=False)
class Regression:
    """Linear equations y = H theta; each of the R rows is one equation at one instant.

    Attributes
    ----------
    names, units : tuples of p ParameterName and of p str
        Of the parameters theta.
    H, y : arrays (R, p) and (R,)
        Observation matrix (W of the paper) and torques [N m, or N].
    joint, time, run : arrays (R,)
        Index of the row's equation in `joint_names`, instant [s] and index of the log. Whole
        numbers are stored as floats. Of a robot with a moving base the six rows of the base have
        the names and indices after those of the n joints.
    excluded : int
        Number of instants near standstill that make no rows.
    propagated : array (R, s)
        Derivative of y by s parameters that were estimated before (those of the springs).
    joint_names : tuple of n str
    """

    names: tuple[ParameterName, ...]
    units: tuple[str, ...]
    H: Array
    y: Array
    joint: Array
    time: Array
    run: Array
    excluded: int
    propagated: Array
    joint_names: tuple[str, ...] = ()
    arrays: ClassVar = ("H", "y", "joint", "time", "run", "propagated")

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", ParameterName.all_of(self.names))
        rows = (len(self.y),)
        shapes = {"H": (*rows, len(self.names)), "propagated": (*rows, None)}
        freeze(self, shapes | dict.fromkeys(("y", "joint", "time", "run"), rows))

    @classmethod
    def of_equation(
        cls, names: Iterable[str], units: Sequence[str], H: Array, y: Array, time: Array
    ) -> Regression:
        """Return the rows of one equation in one log, with no errors of other estimates."""
        zero, nothing = np.zeros(len(y)), np.empty((len(y), 0))
        return cls(ParameterName.all_of(names), tuple(units), H, y, zero, time, zero, 0, nothing)

    def at(self, rows: BoolArray | slice) -> Regression:
        """Return the regression with some of its rows."""
        return replace(self, **{name: getattr(self, name)[rows] for name in self.arrays})

    def of_columns(self, places: Iterable[int]) -> Regression:
        """Return the regression with some of its columns."""
        kept = list(places)
        names, units = tuple(self.names[x] for x in kept), tuple(self.units[x] for x in kept)
        return replace(self, names=names, units=units, H=self.H[:, kept])

    def with_columns(
        self, names: Iterable[str], units: Iterable[str], columns: Array
    ) -> Regression:
        """Return the regression with further parameters, whose columns (R, k) follow its own."""
        H = np.column_stack([self.H, columns])
        every = (*self.names, *ParameterName.all_of(names))
        return replace(self, names=every, units=(*self.units, *units), H=H)


def actuator_columns(
    robot: Robot, motion: Motion, joint: str
) -> tuple[DriveRegressor, Array, Array]:
    """Return the regressor of an elastic joint's actuator side (10), zeta (T,) and R (T, p).

    They are those of `actuator_equation`, evaluated. `actuator_rows` are the samples at which they
    are rows, which `actuator_regression` filters and decimates.

    From (7) and the motor torque; if the log has only the joint torque, from (4b), which determines
    stiffness and spring offset. Raises LogError if neither was measured.
    """
    regressor, by_name = actuator_equation(robot, motion, joint)
    return regressor, *regressor.evaluate(by_name)


def actuator_equation(
    robot: Robot, motion: Motion, joint: str
) -> tuple[DriveRegressor, dict[str, Array]]:
    """Return the regressor of `actuator_columns` and the signals at which it is evaluated."""
    index = robot.index(joint)
    by_name = signals(robot, motion, index)
    sensed = sensed_torque(robot, motion, index)
    kind = robot.drives[joint].motor_input
    if np.all(np.isfinite(by_name[INPUTS[kind]])):
        return motor_regressor(robot, joint), by_name
    if np.all(np.isfinite(sensed)):
        return spring_regressor(robot, joint), {**by_name, "tau_L": sensed}
    others = [key for key, name in INPUTS.items() if np.all(np.isfinite(by_name[name]))]
    text = f"elastic joint '{joint}' has no torque in the log: motor {kind} or joint torque"
    hints = (f'; it has its {x}: write motor_input = "{x}" in the drives file' for x in others)
    raise LogError(text + next(hints, ""))


def actuator_regression(robot: Robot, motion: Motion, joint: str) -> Regression:
    """Return the actuator side (10) of an elastic joint over time: friction and spring parameters.

    If the drive has dry friction, its equation counts for nothing at reversals and at standstill.
    """
    return _drive_rows(robot, motion, joint, *actuator_equation(robot, motion, joint))


def spring_regression(robot: Robot, motion: Motion, joint: str) -> Regression:
    """Return (4b) of an elastic joint over time, with its measured torque: spring parameters."""
    index = robot.index(joint)
    measured = signals(robot, motion, index) | {"tau_L": sensed_torque(robot, motion, index)}
    return _drive_rows(robot, motion, joint, spring_regressor(robot, joint), measured)


def _drive_rows(
    robot: Robot, motion: Motion, joint: str, regressor: DriveRegressor, by_name: dict[str, Array]
) -> Regression:
    """Return the rows of a drive's equation at the given signals."""
    y, H = regressor.evaluate(by_name)
    kept, known, excluded = actuator_rows(robot, motion, joint, regressor)
    columns = regressor.names, regressor.units, known[:, None] * H, known * y
    return replace(_rows_at(robot, motion, joint, columns, kept), excluded=excluded)


_Columns = tuple[tuple[ParameterName, ...], tuple[str, ...], Array, Array]
"""Names and units of parameters, their columns (T, p), and y (T,)."""


def _rows_at(
    robot: Robot, motion: Motion, joint: str, columns: _Columns, rows: IndexArray
) -> Regression:
    """Return the rows of a joint at some samples of a motion."""
    names, units, *sides = columns
    H, y = (in_band_at(motion, side, rows) for side in sides)
    equation = Regression.of_equation(names, units, H, y, motion.time[rows])
    place = np.full(len(rows), robot.index(joint))
    return replace(equation, joint=place, joint_names=robot.joint_names)


GEAR = ParameterName.all_of(("gear_compliance", "gear_hysteresis", "gear_offset"))
"""The parameters of `gear_regression`: c, h and the constant."""


def gear_regression(robot: Robot, motion: Motion, joint: str, spring: Array) -> Regression:
    """Return the deflection between the encoders less that of the spring, which was measured.

    It is c F + h sign(w) + constant: wind-up of the gear under the spring force F, by the torque
    sensor or else by (4b) with the parameters `spring`, and hysteresis of half width h. At
    standstill, where the gear may be anywhere inside its hysteresis, sign(w) counts as zero.
    """
    index, drive = robot.index(joint), robot.drives[joint]
    measured = signals(robot, motion, index)
    between = at_drives(robot.transmission, motion.joint_position)[:, index]
    # r_L (theta_L - q) = (r_M/N theta_M - r_L q) - d: between the encoders, less the spring's.
    y = drive.load_radius * (measured["theta_L"] - between)
    # At a load torque of zero, zeta is minus the part of the force by known parameters.
    zeta, R = spring_regressor(robot, joint).evaluate(measured)
    force, sensed = R @ spring - zeta, sensed_torque(robot, motion, index)
    if np.all(np.isfinite(sensed)):
        force = sensed / drive.load_radius
    # With an infinite share only the speed of the sample itself counts, not its neighbourhood.
    is_moving = ~standstill(motion, index, share=np.inf)
    direction = np.where(is_moving, np.sign(measured["theta_M_dot"]), 0.0)
    H = np.column_stack([force, direction, np.ones_like(y)])
    unit, length = drive.spring_units
    columns = GEAR, (f"{length}/({unit})", length, length), H, y
    return _rows_at(robot, motion, joint, columns, row_samples(motion))


def actuator_rows(
    robot: Robot, motion: Motion, joint: str, regressor: DriveRegressor
) -> tuple[IndexArray, Array, int]:
    """Return (samples that become rows, factor (T,) of the equation, number of excluded samples).

    The factor is `known_friction`. The spring equation (4b) has no derivatives, so that its rows
    reach the ends of the log.
    """
    if not _has_motor(regressor):
        # Without derivatives there are no filter transients of speed and acceleration at the ends.
        return row_samples(replace(motion, transient_s=0.0)), np.ones(len(motion.time)), 0
    rows = row_samples(motion)
    known = known_friction(robot, motion, joint, regressor)
    kept = rows[in_band_at(motion, known, rows) >= LEAST_KNOWN]
    return kept, known, len(rows) - len(kept)


LEAST_KNOWN = 0.2
"""Part of the window of the low pass in which friction is known, at least, for a row."""


def known_friction(robot: Robot, motion: Motion, joint: str, regressor: DriveRegressor) -> Array:
    """Return 1 where the friction of an actuator side is known, and 0 where it is not (T,).

    At a reversal the sign of dry friction is that of the speed before the low pass, which made the
    reversal later or earlier, and while the motor sticks its friction is anything up to that of
    Coulomb. As a factor of the whole equation before the low pass of the rows, zero takes these
    samples out of a combination of equations that are all valid. (4b) has no friction.
    """
    drive, index = robot.drives[joint], robot.index(joint)
    if not _has_motor(regressor) or not (is_dry(drive) or "smooth_coulomb" in drive.friction):
        return np.ones(len(motion.time))
    speed, fastest = motion.motor_velocity[:, index], float(motion.largest_speeds[0, index])
    if not is_dry(drive):
        # A reversal, which shows the width of smooth friction, takes less than a period of the
        # cutoff; in a rest, which takes longer, the motor may stick as with dry friction.
        return np.where(long_rests(speed, fastest, motion.rate_hz / motion.cutoff_hz), 0.0, 1.0)
    rates = motion.rate_hz, POSITION_BAND * motion.cutoff_hz
    return is_friction_known(speed, fastest, *rates).astype(float)


def known_load_friction(robot: Robot, motion: Motion, index: int) -> Array:
    """Return `known_friction` of the load side of a joint (T,), that of the motor if it is stiff.

    On a moving base all count: the equations are combined so that contact forces leave them, and a
    factor of its own for each of them would leave these in.
    """
    joint, known = robot.joint_names[index], motion.friction_known
    if known is not None and not np.isnan(known[0, index]):
        return known[:, index]
    if robot.drives[joint].is_elastic or not robot.base_is_held:
        return np.ones(len(motion.time))
    return known_friction(robot, motion, joint, motor_regressor(robot, joint))


def _has_motor(regressor: DriveRegressor) -> bool:
    """Return whether an equation is that of the motor (7), and not that of the spring (4b)."""
    return bool(regressor.signals & {"tau_M", "i_M", "u_M"})


def stacked(regressions: Sequence[Regression]) -> Regression:
    """Return the regressions of several logs, whose columns must be equal, as one, (15)."""
    first, *others = regressions
    for part in others:
        if part.names != first.names:
            raise LogError(
                f"one log determines {', '.join(first.names)}, another {', '.join(part.names)}: "
                "the logs must have the same torque sensors"
            )
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in regressions])
        for name in Regression.arrays
    }
    arrays["run"] = np.repeat(np.arange(len(regressions)), [len(part.y) for part in regressions])
    return replace(first, **arrays, excluded=sum(part.excluded for part in regressions))


Regress = Callable[[Motion], Regression]
"""A function from a motion to its rows."""


def with_changes(
    rows: Regression, changed: Iterable[Regression], theta: Array, step: float
) -> Regression:
    """Return rows whose `propagated` (R, k) are the changes of their residual to k others.

    The residual is y - H theta, at fixed parameters; the changes are divided by `step`.
    """
    residual = rows.y - rows.H @ theta
    changes = [other.y - other.H @ theta - residual for other in changed]
    columns = np.array(changes).reshape(len(changes), len(residual))
    return replace(rows, propagated=columns.T / step)


def regressions_of_parts(
    long_log: LongLog, equations: Mapping[str, Regress]
) -> Iterator[tuple[str, Regression]]:
    """Yield (name, rows) of the parts of each equation, reading a long log once."""
    for motion, start_s, end_s in long_log.motions():
        for name, regress in equations.items():
            yield name, _rows_within(regress(motion), motion, start_s, end_s)


def rows_by_pieces(motion: Motion, regress: Regress, samples: int = PIECE_SAMPLES) -> Regression:
    """Return the rows of a motion, whose columns are computed piece by piece if it is long."""
    if len(motion.time) <= samples:
        return regress(motion)
    parts = pieces(motion, samples)
    rows = stacked([_rows_within(regress(piece), piece, start, end) for piece, start, end in parts])
    # The pieces are one log, in which noise is autocorrelated from piece to piece.
    return replace(rows, run=np.zeros(len(rows.y)))


def _rows_within(rows: Regression, motion: Motion, start_s: float, end_s: float) -> Regression:
    """Return the rows whose instants are in [start_s, end_s), without those of the overlaps."""
    instants = motion.time[row_samples(motion)]
    count = int(np.sum((instants >= start_s) & (instants < end_s)))
    # (rows + excluded) / instants is the number of equations; of these times `count` in the span,
    # what is no row was excluded.
    equations = (len(rows.y) + rows.excluded) // max(len(instants), 1)
    kept = (rows.time >= start_s) & (rows.time < end_s)
    return replace(rows.at(kept), excluded=equations * count - int(np.sum(kept)))
