"""Regression: y = H theta over time, (15); the actuator side (10) and the load side (8).

Regressor and torque pass the same low pass, then every few samples make a row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array, BoolArray, frozen
from seaid.base import BaseParameters, grouped_text, left_to_right, negligible, random_states
from seaid.drivetrain.equations import motor_equation, spring_equation
from seaid.drivetrain.model import SeriesElasticDrive, StiffDrive
from seaid.drivetrain.regressor import DriveRegressor, drive_regressor
from seaid.errors import LogError
from seaid.filtering import decimation, low_pass
from seaid.inertia import UNITS
from seaid.motion import Motion
from seaid.rigid_body import rigid_body_regressor
from seaid.robot import Robot

__all__ = [
    "LoadModel",
    "Regression",
    "actuator_regression",
    "load_model",
    "load_regression",
    "motor_regressor",
    "rigid_body_regressor",
    "spring_regressor",
    "stacked",
    "standstill",
    "unknown_friction",
    "zero_sensitivity",
]

STANDSTILL = 0.01
"""A motor slower than this part of its fastest stands still: its friction has no direction."""

REST_RAD_S = 1e-9
"""So does one slower than this, whatever its fastest: that is the rounding of the filters."""

SEEN = 0.05
"""Share of standstill in what the low pass sees above which a sample is left out."""

_ZERO_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Regression:
    """Rows y (R,) = H (R, p) theta, each of one equation at one time.

    `joint` (R,) tells the equation, `time` (R,) [s] the instant; `left_out` counts the instants
    near standstill that are not rows. `carried` (R, s) is the derivative of y with respect to
    parameters that were estimated before (the springs'), if there are any; `run` (R,) tells the
    log, where several are stacked.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    H: Array
    y: Array
    joint: Array
    time: Array
    run: Array
    left_out: int
    carried: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "H", frozen("H", self.H, (None, len(self.names))))
        rows = len(self.H)
        for name in ("y", "joint", "time", "run"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), (rows,)))
        object.__setattr__(self, "carried", frozen("carried", self.carried, (rows, None)))


@dataclass(frozen=True, eq=False)
class LoadModel:
    """What the load side can tell: base parameters, and the columns of the stiff drives.

    `drives` (p_d) are (joint, parameter, unit) of the drive columns that are identifiable beside
    the p base columns; the others are part of the base parameters, as `expressions` (p,) say.
    `rows` are the joints whose equations are used.
    """

    base: BaseParameters
    rows: tuple[str, ...]
    drives: tuple[tuple[str, str, str], ...]
    expressions: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns: expressions, then '<parameter> of <joint>'."""
        return self.expressions + tuple(f"{name} of {joint}" for joint, name, _ in self.drives)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all columns."""
        base = tuple(UNITS[column % 10] for column in self.base.columns)
        return base + tuple(unit for _, _, unit in self.drives)


def motor_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the motor equation (7) of a joint."""
    drive = robot.drivetrains[joint]
    return drive_regressor(motor_equation(drive), drive)


def spring_regressor(robot: Robot, joint: str) -> DriveRegressor:
    """Return the regressor derived from the spring equation (4b) of an elastic joint."""
    drive = robot.drivetrains[joint]
    if not isinstance(drive, SeriesElasticDrive):
        raise LogError(f"joint '{joint}' has no spring")
    return drive_regressor(spring_equation(drive), drive)


def signals(motion: Motion, index: int) -> dict[str, Array]:
    """Return the signals of a joint's drive equations by name, each (T,); no load torque yet."""
    return {
        "theta_M": motion.motor_position[:, index],
        "theta_M_dot": motion.motor_velocity[:, index],
        "theta_M_ddot": motion.motor_acceleration[:, index],
        "theta_L": motion.joint_position[:, index],
        "theta_L_dot": motion.joint_velocity[:, index],
        "theta_L_ddot": motion.joint_acceleration[:, index],
        "tau_M": motion.motor_torque[:, index],
        "tau_L": np.zeros(len(motion.time)),
    }


def standstill(motion: Motion, index: int) -> BoolArray:
    """Tell the samples (T,) that see a motor stand still, so that its friction is unknown.

    Behind the low pass a sample sees its neighbourhood: it is left out if standstill makes up more
    than a small share of that. A reversal without a stop is no standstill.
    """
    speed = np.abs(motion.motor_velocity[:, index])
    still = (speed < max(STANDSTILL * np.max(speed), REST_RAD_S)).astype(float)
    return np.asarray((still > 0) | (in_band(motion, still) > SEEN))


def unknown_friction(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Tell the samples (T,) at which the load side of a joint has unknown friction.

    That of a stiff drive with Coulomb friction does where it stands still; an elastic one has none.
    """
    drive = robot.drivetrains[joint]
    if isinstance(drive, StiffDrive) and "coulomb" in drive.friction:
        return standstill(motion, robot.index(joint))
    return np.zeros(len(motion.time), dtype=bool)


def actuator_columns(
    robot: Robot, motion: Motion, joint: str
) -> tuple[DriveRegressor, Array, Array]:
    """Return the regressor of an elastic joint's actuator side, zeta (T,) and R (T, p), (10).

    From the motor torque and (7); where the log has only the spring's torque, from (4b), which
    tells stiffness and offset. Raises LogError where neither was measured.
    """
    index = robot.index(joint)
    by_name = signals(motion, index)
    if np.all(np.isfinite(by_name["tau_M"])):
        regressor = motor_regressor(robot, joint)
    elif np.all(np.isfinite(motion.joint_torque[:, index])):
        by_name["tau_L"] = motion.joint_torque[:, index]
        regressor = spring_regressor(robot, joint)
    else:
        raise LogError(f"elastic joint '{joint}' has no torque in the log: motor or joint")
    return regressor, *regressor.evaluate(by_name)


def actuator_regression(robot: Robot, motion: Motion, joint: str) -> Regression:
    """Return the actuator side (10) over time: friction, stiffness, deflection offset.

    Instants near standstill are left out where friction is among them.
    """
    index = robot.index(joint)
    regressor, y, H = actuator_columns(robot, motion, joint)
    rows = _rows(motion)
    needs_friction = "coulomb_friction" in regressor.names
    kept = rows[~(standstill(motion, index) & needs_friction)[rows]]
    return Regression(
        names=regressor.names,
        units=regressor.units,
        H=in_band(motion, H)[kept],
        y=in_band(motion, y)[kept],
        joint=np.full(len(kept), index),
        time=motion.time[kept],
        run=np.zeros(len(kept)),
        left_out=len(rows) - len(kept),
        carried=np.empty((len(kept), 0)),
    )


def load_model(robot: Robot, base: BaseParameters, rows: Sequence[str]) -> LoadModel:
    """Return which columns of stiff drives are identifiable beside the base parameters."""
    known = [robot.index(joint) for joint in rows]
    q, v, a = random_states(robot, seed=1, torques=len(known))
    Y = base.reduce(rigid_body_regressor(robot, q, v, a))[:, known]
    columns, drives = _drive_columns(
        robot, rows, lambda index: _stiff_signals(robot, index, q, v, a)
    )
    H = np.concatenate([Y, columns], axis=2).reshape(len(q) * len(known), -1)
    p = len(base.columns)
    found, grouping, _ = left_to_right(H, negligible(H))
    names = (*base.expressions, *(f"{name}_{joint}" for joint, name, _ in drives))
    absorbed = [column for column in range(p, H.shape[1]) if column not in found]
    expressions = []
    for row in range(p):
        wanted = np.zeros(H.shape[1])
        wanted[[row, *absorbed]] = grouping[row, [row, *absorbed]]
        expressions.append(grouped_text(wanted, names))
    kept = tuple(drives[column - p] for column in found if column >= p)
    return LoadModel(base, tuple(rows), kept, tuple(expressions))


def load_columns(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array]
) -> tuple[Array, Array, Array, Array]:
    """Return the load side over time: torque (T, rows), the payload's part of it, H and carried.

    torque = payload + H (T, rows, columns) @ theta; see `load_regression`.
    """
    Y = rigid_body_regressor(robot, *motion.joint_states)
    known = [robot.index(joint) for joint in model.rows]
    columns, drives = _drive_columns(robot, model.rows, lambda index: signals(motion, index))
    wanted = [drives.index(drive) for drive in model.drives]
    H = np.concatenate([model.base.reduce(Y)[:, known], columns[:, :, wanted]], axis=2)
    torque, carried = _load_targets(robot, motion, model.rows, springs)
    return torque, (Y @ robot.payload_parameters)[:, known], H, carried


def load_regression(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array]
) -> Regression:
    """Return the load side (8): base parameters, and friction and rotor inertia of stiff drives.

    `springs` has stiffness and offset of the elastic joints in `model.rows`; one that is not there
    takes its joint torque from the log. The payload's torque is moved to the known side.
    """
    torque, payload, H, carried = load_columns(robot, motion, model, springs)
    y, H, carried = (in_band(motion, part) for part in (torque - payload, H, carried))
    rows = _rows(motion)
    picked = [rows[~unknown_friction(robot, motion, joint)[rows]] for joint in model.rows]
    which = np.repeat(np.arange(len(model.rows)), [len(kept) for kept in picked])
    kept = np.concatenate(picked)
    return Regression(
        names=model.names,
        units=model.units,
        H=H[kept, which],
        y=y[kept, which],
        joint=np.array([robot.index(joint) for joint in model.rows])[which],
        time=motion.time[kept],
        run=np.zeros(len(kept)),
        left_out=len(rows) * len(model.rows) - len(kept),
        carried=carried[kept, which],
    )


def zero_sensitivity(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array], theta: Array
) -> Regression:
    """Return the load side with `carried` (R, n): what a shifted zero of each joint encoder does.

    It is minus the change of the computed torque, at the parameters `theta`, a unit of shift.
    """
    reference, changes = load_regression(robot, motion, model, springs), []
    for index, joint in enumerate(robot.joint_names):
        position = motion.joint_position.copy()
        position[:, index] += _ZERO_STEP
        moved = dict(springs)
        if joint in springs:  # the deflection offset takes what the zero does to the spring
            stiffness, offset = springs[joint]
            load_radius = getattr(robot.drivetrains[joint], "load_radius", 1.0)
            moved[joint] = np.array([stiffness, offset + stiffness * load_radius * _ZERO_STEP])
        shifted = load_regression(robot, replace(motion, joint_position=position), model, moved)
        change = (shifted.y - shifted.H @ theta) - (reference.y - reference.H @ theta)
        changes.append(change / _ZERO_STEP)
    return replace(reference, carried=np.column_stack(changes))


def stacked(regressions: Sequence[Regression]) -> Regression:
    """Return the regressions of several logs as one, (15).

    Raises LogError where they do not have the same columns.
    """
    for one in regressions[1:]:
        if one.names != regressions[0].names:
            raise LogError(
                f"one log tells {', '.join(regressions[0].names)}, another "
                f"{', '.join(one.names)}: the logs must have the same torque sensors"
            )
    return Regression(
        names=regressions[0].names,
        units=regressions[0].units,
        run=np.concatenate([np.full(len(one.y), run) for run, one in enumerate(regressions)]),
        left_out=sum(one.left_out for one in regressions),
        **{
            name: np.concatenate([getattr(one, name) for one in regressions])
            for name in ("H", "y", "joint", "time", "carried")
        },
    )


def in_band(motion: Motion, columns: Array) -> Array:
    """Return columns (T, ...) behind the low pass of the motion's pass band."""
    flat = columns.reshape(len(columns), -1)
    return low_pass(flat, motion.rate_hz, motion.cutoff_hz).reshape(columns.shape)


def _rows(motion: Motion) -> np.ndarray:
    """Return the samples that become rows: decimated to the pass band, ends left away."""
    step = decimation(motion.rate_hz, motion.cutoff_hz)
    trim = round(motion.trim_s * motion.rate_hz)
    return np.arange(trim, len(motion.time) - trim, step)


def _drive_columns(
    robot: Robot, rows: Sequence[str], signals_of: Callable[[int], dict[str, Array]]
) -> tuple[Array, list[tuple[str, str, str]]]:
    """Return the stiff drives' columns (T, rows, columns) at the joints, and what they are."""
    blocks, drives = [], []
    for row, joint in enumerate(rows):
        drive = robot.drivetrains[joint]
        if isinstance(drive, SeriesElasticDrive):
            continue
        regressor = motor_regressor(robot, joint)
        R = regressor.evaluate(signals_of(robot.index(joint)))[1]
        block = np.zeros((len(R), len(rows), R.shape[1]))
        block[:, row] = drive.ratio * R
        blocks.append(block)
        drives += [
            (joint, name, unit) for name, unit in zip(regressor.names, regressor.units, strict=True)
        ]
    length = len(next(iter(signals_of(0).values())))
    return np.concatenate([*blocks, np.empty((length, len(rows), 0))], axis=2), drives


def _stiff_signals(robot: Robot, index: int, q: Array, v: Array, a: Array) -> dict[str, Array]:
    """Return the signals of a stiff drive at joint states: the motor turns with the joint."""
    ratio, nothing = robot.drivetrains[robot.joint_names[index]].ratio, np.zeros(len(q))
    states = {"theta_L": q, "theta_L_dot": v, "theta_L_ddot": a}
    joint = {name: values[:, index] for name, values in states.items()}
    motor = {name.replace("_L", "_M"): ratio * values for name, values in joint.items()}
    return {**joint, **motor, "tau_M": nothing, "tau_L": nothing}


def _load_targets(
    robot: Robot, motion: Motion, rows: Sequence[str], springs: Mapping[str, Array]
) -> tuple[Array, Array]:
    """Return the torque on the load (T, rows) and its derivative by the springs' parameters."""
    elastic = [joint for joint in rows if joint in springs]
    targets = np.empty((len(motion.time), len(rows)))
    carried = np.zeros((*targets.shape, sum(len(springs[joint]) for joint in elastic)))
    start = 0
    for row, joint in enumerate(rows):
        index, drive = robot.index(joint), robot.drivetrains[joint]
        by_name = signals(motion, index)
        measured = motion.joint_torque[:, index]
        if isinstance(drive, SeriesElasticDrive):
            R = drive.load_radius * spring_regressor(robot, joint).evaluate(by_name)[1]
            if joint not in springs:
                targets[:, row] = measured
                continue
            targets[:, row] = R @ springs[joint]  # (4b)
            carried[:, row, start : start + R.shape[1]] = R
            start += R.shape[1]
        else:
            if np.all(np.isnan(by_name["tau_M"])):
                by_name["tau_M"] = measured / drive.ratio
            targets[:, row] = drive.ratio * motor_regressor(robot, joint).evaluate(by_name)[0]
    missing = [joint for row, joint in enumerate(rows) if np.any(np.isnan(targets[:, row]))]
    if missing:
        raise LogError(f"no torque in the log at {', '.join(missing)}; name the others with rows=")
    return targets, carried
