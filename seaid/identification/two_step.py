"""The two-step method of the paper: the actuator side (10) of each spring, then the load side (8).

A motor constant is identifiable only if something known fixes the scale of the equations.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
from scipy import linalg

from seaid._arrays import Array, BoolArray
from seaid.drives import DELAY_PARAMETER, JointParameter, parameter_of, unit_of
from seaid.errors import Finding, IdentificationError
from seaid.estimation import (
    RANK_TOLERANCE,
    Change,
    Estimate,
    Estimator,
    FittedRows,
    ModelChecks,
    QRFactor,
    Rows,
    deflection_instruments,
    equal_weights,
    fit,
    instrumental,
    projected_columns,
    qr_factor_of_rows,
    scaled_svd,
    unattenuated,
    with_columns,
    with_predicted_columns,
)
from seaid.identification.command_delays import with_shared_delays
from seaid.identification.datasets import Dataset, first_motion, rows_of_equations
from seaid.identification.drive_estimates import (
    has_only_spring_torque,
    identifiable_offsets,
    merged_estimates,
    noise_ratio,
    spring_of,
    with_torque_columns,
    with_torque_offsets,
)
from seaid.log import Motion
from seaid.regressor import (
    INPUT_FIELDS,
    LoadModel,
    Regress,
    Regression,
    actuator_regression,
    load_regression,
    motor_regressor,
    offset_sensitivity,
    spring_regression,
    spring_regressor,
)
from seaid.robot import Robot, group_of

CONSTANTS = {
    "torque_constant": "only the current of its motor was logged",
    "voltage_constant": "only the voltage of its motor was logged",
    "gain_scale": "the gains of its controller are in units of the drive",
}
"""Factors that convert a logged input to torque, and why they are unknown."""

_OF_CURRENT = "torque_constant"
"""That of a current, which is measured, with noise; a voltage is what the drive applies."""

_ROUNDING = 1e-9

_PART = 0.01
"""Least share of a constant in a lost combination."""

_LOAD_SIDE = "known bodies (known_bodies=), logs with and without a payload (identify_conditions), "
_SPRING = (
    "the stiffness of its spring (known = ['stiffness']), known bodies (known_bodies=), logs with "
    "and without a payload (identify_conditions), a torque sensor behind the gear (joint_torque), "
    "its rotor inertia, "
)


Found = TypeVar("Found")


class UnknownScaleError(IdentificationError):
    """Equations that an unknown constant `parameter` of a `joint` makes homogeneous."""

    joint = parameter = ""


def check_scale(qr_factor: QRFactor) -> None:
    """Raise UnknownScaleError if an unknown motor constant makes the equations homogeneous.

    All torques are then known only up to scale, and least squares gives zero. A payload in all logs
    does not help, since it could be part of its body.
    """
    places = [
        place for place, name in enumerate(qr_factor.names) if parameter_of(name) in CONSTANTS
    ]
    if not places or not qr_factor.count:  # without rows `solve` raises
        return
    R, p = qr_factor.weighted_factor(), len(qr_factor.names)
    svd = scaled_svd(R[:p, :p], "the scale of the torques")
    # |column| theta is the norm of the torque that each column contributes. If the equations are
    # homogeneous, least squares makes all of them, and so the constant, zero but for rounding.
    torques = svd.norms * svd.solve(R[:p, p], RANK_TOLERANCE)
    least = _ROUNDING * float(np.linalg.norm(R[:, p]))
    # The rows of `vectors` beyond the rank span the null space: a constant that has a part in one
    # of them can be changed, together with the bodies or the spring, without changing any torque.
    open_part = np.max(np.abs(svd.vectors[svd.rank(RANK_TOLERANCE) :]), axis=0, initial=0.0)
    for place in places:
        if abs(torques[place]) <= least or open_part[place] > _PART:
            column = qr_factor.names[place]
            name, remedy = parameter_of(column), _SPRING
            joint = qr_factor.joint_names[qr_factor.equations[0]]
            if isinstance(column, JointParameter):
                joint, remedy = column.joint, _LOAD_SIDE
            problem = UnknownScaleError(
                f"the {name.replace('_', ' ')} of {joint} is unidentifiable: {CONSTANTS[name]}, "
                f"so all torques are known only up to scale. Give one of: {remedy}or the constant "
                f"itself (known = ['{name}'])",
                "known_bodies=",
            )
            problem.joint, problem.parameter = joint, name
            raise problem


def with_unit_scale(robot: Robot, problem: UnknownScaleError) -> Robot:
    """Return the robot with the nominal scale of the gains at fault as known, 1 without one.

    Raises the problem if it is another one: gains in units of the drive still give ratios.
    """
    drive = robot.drives.get(problem.joint)
    if drive is None or problem.parameter != "gain_scale":
        raise problem
    fixed = drive.with_values({"gain_scale": drive.scale_of_gains})
    return robot.with_drives({problem.joint: replace(fixed, known=(*drive.known, "gain_scale"))})


def with_unit_scales(
    robots: Mapping[str, Robot], identify: Callable[[Mapping[str, Robot]], Found]
) -> tuple[Found, Mapping[str, Robot], list[str]]:
    """Return identify(robots), the robots with each scale at fault as known, and their joints."""
    joints: list[str] = []
    # Each round makes one more scale known, which then has no column and cannot raise again.
    while True:
        try:
            return identify(robots), robots, joints
        except UnknownScaleError as problem:
            robots = {name: with_unit_scale(robot, problem) for name, robot in robots.items()}
            joints.append(problem.joint)


def with_free_scale(robot: Robot, joints: Collection[str]) -> Robot:
    """Return the robot with unknown scales of the gains of some joints, as they were given."""
    drives = {}
    for joint in joints:
        drive = robot.drives[joint]
        known = tuple(name for name in drive.known if name != "gain_scale")
        drives[joint] = replace(drive, known=known)
    return robot.with_drives(drives) if drives else robot


LOAD = ""
"""Key of the load side among equations named by joint."""

STIFFNESS = "stiffness"
_NEEDED = (STIFFNESS, "spring_offset", "deflection_zero")


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """Estimates of both sides of the springs.

    `springs` {joint: parameters} are those whose torque is that on the load; `checks` and
    `excluded` by joint, and "load" for the load side. `whole` is the estimate of both sides if they
    were estimated at once, `fit` the fit of that, or of `load_side`; `actuators` {joint: fit of its
    motor equation} if they were estimated in turn. `scaling` {joint: fit that gives its unknown
    motor constant}: of its spring by a torque sensor, or of the load side. `findings` are about
    the way to the estimates, and `not_shared` is why the data do not support an estimate of both
    sides at once, whose rows `regress` returns.
    """

    drives: Mapping[str, Estimate]
    load: Estimate
    load_side: Estimate
    springs: Mapping[str, Array]
    excluded: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    fit: FittedRows
    whole: Estimate | None = None
    actuators: Mapping[str, FittedRows] = field(default_factory=dict)
    scaling: Mapping[str, FittedRows] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    not_shared: str = ""
    regress: Callable[[Robot, Motion], Regression] | None = None


def estimate_two_step(
    robot: Robot,
    datasets: Sequence[Dataset],
    model: LoadModel,
    estimator: Estimator,
    encoder_offset_std: float,
    executor: Executor | None,
    progress: bool,
    equations: Mapping[str, Regress] | None = None,
    further: tuple[Array, Array] | None = None,
) -> RobotEstimate:
    """Estimate both sides in turn, with the springs' uncertainty propagated to the load.

    `further` are columns (R, k) of the load side by which errors of known covariance (k, k) change
    its torques.

    `equations` compute the rows in place of `two_step_equations`, in columns that `estimator` knows
    and that its `effective_rows` converts to the plain ones; torque offsets then count as 0.
    """
    joints = spring_torque_joints(robot, datasets, model)
    free, known_errors = equations is None, [] if further is None else [further[1]]
    sensed = _joints_scaled_by_sensors(robot, datasets) if equations is None else ()
    equations = equations or two_step_equations(robot, model, joints)
    equations = {**equations, **_sensed_springs(robot, sensed)}
    stored, cutoff_hz = estimator.weigh is not None, datasets[0].cutoff_hz
    with rows_of_equations(datasets, equations, stored, executor, progress) as rows:
        sides = _actuator_side(robot, datasets, rows, estimator, joints, sensed)
        actuators, estimates, scaling = sides
        springs = {joint: spring_of(robot, estimates[joint], joint) for joint in joints}
        fit_rows = partial(fit_load, robot, springs, estimator, cutoff_hz, free)
        load = fit_rows(_with_columns(rows[LOAD], further), known_errors)
        if encoder_offset_std > 0:
            # The change of y - H theta by an encoder offset depends on theta, so that a fit without
            # offsets comes first. Torque offsets, after the columns of the model, do not matter.
            theta, regress = load.estimate.values[: len(model.names)], equations[LOAD]
            shifted = partial(with_offset_columns, robot, model, springs, theta, regress)
            errors = [encoder_offset_std**2 * np.eye(robot.n), *known_errors]
            again = rows_of_equations(datasets, {LOAD: shifted}, stored, executor, progress)
            with again as rows_of_offsets:
                load = fit_rows(_with_columns(rows_of_offsets[LOAD], further), errors)
    # (7) gave s = f_0 + b_0 N/r_M in `springs`, the load side b_0: from here on f_0 replaces s.
    drives = with_torque_offsets(robot, load, estimates, springs)
    load_side = load.estimate.part(range(len(model.names)), model.names)
    base, load_drives = split_load_side(model, load_side)
    merged = merged_estimates(drives, load_drives)
    fits = {**actuators, "load": load}
    return RobotEstimate(
        drives={joint: merged[joint] for joint in robot.joint_names if joint in merged},
        load=base,
        load_side=load_side,
        springs={joint: spring_of(robot, drives[joint], joint).values for joint in springs},
        excluded={name: fitted.qr_factor.excluded for name, fitted in fits.items()},
        checks=_checks(actuators) | {"load": load.checks(model.names[len(model.expressions) :])},
        fit=load,
        actuators=actuators,
        scaling=scaling,
    )


def _actuator_side(
    robot: Robot,
    datasets: Sequence[Dataset],
    rows: Mapping[str, Rows],
    estimator: Estimator,
    joints: Sequence[str],
    sensed: Sequence[str],
) -> tuple[dict[str, FittedRows], dict[str, Estimate], dict[str, FittedRows]]:
    """Return fits of the motor equations, estimates with motor constants, and the fits of these.

    Unknown constants are those of a torque sensor for `sensed` joints, else those of the load,
    which has the torques of the springs of `joints`.
    """
    actuators, unscaled, scaling = {}, {}, {}
    for joint in robot.elastic_joints:
        try:
            actuators[joint] = fit_actuator(robot, datasets, joint, rows[joint], estimator)
        except UnknownScaleError as problem:
            if joint not in (*joints, *sensed):
                raise
            # With a constant of 1 the input is in y, where its noise does not attenuate anything:
            # the fit needs no correction for a noisy column.
            unscaled[joint], cutoff_hz = problem, datasets[0].cutoff_hz
            change = with_unit_constant
            actuators[joint] = fit(rows[joint], estimator, change=change, cutoff_hz=cutoff_hz)
    estimates = {joint: side.estimate for joint, side in actuators.items()}
    for joint in [joint for joint in unscaled if joint in sensed]:
        spring = _fit_spring(robot, datasets, joint, rows[sensed_spring(joint)], estimator)
        constant, scaling[joint] = unscaled.pop(joint).parameter, spring
        scaled = scaled_by_sensor(robot, estimates[joint], joint, constant, spring.estimate)
        estimates[joint] = scaled
    if unscaled:
        scaled_ones, fitted = scaled_by_load(
            robot, estimates, joints, rows[LOAD], estimator, unscaled
        )
        estimates |= scaled_ones
        scaling |= dict.fromkeys(unscaled, fitted)
    return actuators, estimates, scaling


def _checks(actuators: Mapping[str, FittedRows]) -> dict[str, ModelChecks]:
    """Return the checks of the motor equations, of the terms that a drive may lack."""
    return {
        joint: side.checks([name for name in side.estimate.names if name not in _NEEDED])
        for joint, side in actuators.items()
    }


def _with_columns(rows: Rows, further: tuple[Array, Array] | None) -> Rows:
    """Return rows in memory with further columns of propagated errors."""
    if further is None or not isinstance(rows, Regression):
        return rows
    return replace(rows, propagated=np.hstack([rows.propagated, further[0]]))


def two_step_equations(
    robot: Robot, model: LoadModel, springs: Sequence[str]
) -> dict[str, Regress]:
    """Return the functions for the rows: of each elastic joint, and of the load side ("")."""
    # Springs of zero have no torque in y, but their columns T of (4b) are in `propagated`: after
    # the fits of the springs s, y + T s is (8) with their torque, and T C_s T^T its covariance.
    zero = without_torque(robot, springs)
    equations: dict[str, Regress] = {
        joint: partial(actuator_regression, robot, joint=joint) for joint in robot.elastic_joints
    }
    return equations | {LOAD: partial(load_regression, robot, model=model, springs=zero)}


def without_torque(robot: Robot, springs: Collection[str]) -> dict[str, Array]:
    """Return springs {joint: parameters} without torque, for rows before the fit of the springs."""
    return {joint: np.zeros(len(spring_regressor(robot, joint).names)) for joint in springs}


def fit_actuator(
    robot: Robot, datasets: Sequence[Dataset], joint: str, rows: Rows, estimator: Estimator
) -> FittedRows:
    """Fit (10) of an elastic joint, by errors in variables if the spring torque was measured."""
    fitted = fit_inputs(rows, estimator, None, None, datasets[0].cutoff_hz)
    fitted = with_shared_delays(robot.drives, fitted, joint)
    motions = [first_motion(dataset) for dataset in datasets]
    if not has_only_spring_torque(robot, motions, joint):
        return fitted
    return _with_noisy_deflection(robot, motions, joint, fitted, estimator)


def _with_noisy_deflection(
    robot: Robot, motions: Sequence[Motion], joint: str, fitted: FittedRows, estimator: Estimator
) -> FittedRows:
    """Return the fit of (4b) by errors in variables, if its spring is linear and has an offset."""
    plain = fitted.estimate.names == ("stiffness", "spring_offset")
    if not plain or not estimator.weigh or fitted.rows is None:
        return fitted
    instruments = deflection_instruments(fitted.rows, noise_ratio(robot, motions, joint))
    change = partial(with_columns, projected_columns(fitted.rows, instruments))
    return replace(fitted, estimate=instrumental(fitted.rows, instruments), change=change)


def _joints_scaled_by_sensors(robot: Robot, datasets: Sequence[Dataset]) -> tuple[str, ...]:
    """Return the elastic joints with an unknown motor constant and a measured spring torque."""
    motions = [first_motion(dataset) for dataset in datasets]
    return tuple(
        joint
        for joint in robot.elastic_joints
        if set(CONSTANTS) & set(motor_regressor(robot, joint).names)
        and STIFFNESS in spring_regressor(robot, joint).names
        and _all_measured(robot, motions, joint, INPUT_FIELDS[robot.drives[joint].motor_input])
        and _all_measured(robot, motions, joint, "joint_torque")
    )


def check_scale_of_locked(robot: Robot, datasets: Sequence[Dataset], locked: Sequence[str]) -> None:
    """Raise IdentificationError for locked outputs whose motor constant nothing determines.

    What holds them could have any torque, so that bodies give no scale.
    """
    sensed = _joints_scaled_by_sensors(robot, datasets)
    for joint in (joint for joint in locked if joint not in sensed):
        names = set(motor_regressor(robot, joint).names)
        if names & set(CONSTANTS) and {STIFFNESS, "motor_inertia"} <= names:
            (name,) = names & set(CONSTANTS)
            raise IdentificationError(
                f"the {name.replace('_', ' ')} of {joint} is unidentifiable: {CONSTANTS[name]}, "
                "and its output is locked. Give one of: the torque of a sensor behind the gear "
                f"(joint_torque), the stiffness of its spring (known = ['{STIFFNESS}']), its "
                f"rotor inertia, or the constant itself (known = ['{name}'])"
            )


def sensed_spring(joint: str) -> str:
    """Return the key of (4b) of a joint among equations named by joint."""
    return f"spring of {joint}"


def _sensed_springs(robot: Robot, joints: Sequence[str]) -> dict[str, Regress]:
    return {sensed_spring(x): partial(spring_regression, robot, joint=x) for x in joints}


def _fit_spring(
    robot: Robot, datasets: Sequence[Dataset], joint: str, rows: Rows, estimator: Estimator
) -> FittedRows:
    """Fit (4b) of a spring whose torque was measured."""
    motions = [first_motion(dataset) for dataset in datasets]
    fitted = fit(rows, estimator, cutoff_hz=datasets[0].cutoff_hz)
    return _with_noisy_deflection(robot, motions, joint, fitted, estimator)


def with_unit_constant(rows: Regression) -> Regression:
    """Return the rows of (10) of a motor whose unknown constant is 1."""
    (place,) = (k for k, name in enumerate(rows.names) if name in CONSTANTS)
    kept = [k for k in range(len(rows.names)) if k != place]
    return replace(
        rows,
        names=tuple(rows.names[k] for k in kept),
        units=tuple(rows.units[k] for k in kept),
        H=rows.H[:, kept],
        y=rows.y - rows.H[:, place],
    )


def scaled_by_load(
    robot: Robot,
    estimates: Mapping[str, Estimate],
    joints: Sequence[str],
    rows: Rows,
    estimator: Estimator,
    unscaled: Mapping[str, UnknownScaleError],
) -> tuple[dict[str, Estimate], FittedRows]:
    """Return the estimates of `unscaled` joints with the motor constants that (8) determines.

    The second result is the fit of these. Their spring torque for a constant of 1 is a column of
    (8), whose parameter is the constant: known bodies give its scale. Raises UnknownScaleError if
    they do not.
    """
    springs = {joint: spring_of(robot, estimates[joint], joint) for joint in joints}
    constants = {x: JointParameter(problem.parameter, x) for x, problem in unscaled.items()}
    change = partial(with_constant_columns, robot, springs, constants=constants)
    try:
        fitted = fit(rows, estimator, None, change, check_scale)
    except UnknownScaleError:
        raise next(iter(unscaled.values())) from None
    scaled = {
        joint: scaled_with_springs(robot, estimates[joint], name, fitted, springs)
        for joint, name in constants.items()
    }
    return scaled, fitted


def with_constant_columns(
    robot: Robot,
    springs: Mapping[str, Estimate],
    rows: Regression,
    constants: Mapping[str, JointParameter],
) -> Regression:
    """Return (8) with the torques of the springs: for a constant of 1 as the column of it.

    The propagated columns of `rows` are those of the springs.
    """
    # y + K T s = H theta with an unknown constant K and T s for a constant of 1: K has the column
    # -T s, next to those of the bodies.
    ends = np.cumsum([0, *(len(spring.values) for spring in springs.values())])
    y, columns = rows.y, []
    for k, (joint, spring) in enumerate(springs.items()):
        torque = rows.propagated[:, ends[k] : ends[k + 1]] @ spring.values
        if joint in constants:
            columns.append(-torque)
        else:
            y = y + torque
    names = tuple(constants[joint] for joint in springs if joint in constants)
    units = tuple(unit_of(robot.drives[name.joint], name.parameter) for name in names)
    H = np.column_stack([rows.H, *columns])
    return replace(rows, names=rows.names + names, units=rows.units + units, H=H, y=y)


def scaled_with_springs(
    robot: Robot,
    unit: Estimate,
    name: JointParameter,
    fitted: FittedRows,
    springs: Mapping[str, Estimate],
) -> Estimate:
    """Return the estimate `unit` with its constant in `fitted`, which the springs' errors move.

    The torque of a spring of values s in (8), K T s with the constant K of its motor, changes by
    K T ds: the constant by K times the derivative of the fit by that torque.
    """
    load = fitted.estimate
    row = fitted.sensitivity[load.names.index(name)]
    ends = np.cumsum([0, *(len(spring.values) for spring in springs.values())])
    variance, slopes = load.standard_error(name) ** 2, np.zeros(len(unit.names))
    for k, (joint, spring) in enumerate(springs.items()):
        same = JointParameter(name.parameter, joint)
        # Errors of the own spring are in `unit` too, so that their part of the error is correlated
        # with it and goes through `slopes`; those of other springs are independent of it.
        slope = (load.value(same) if same in load.names else 1.0) * row[ends[k] : ends[k + 1]]
        if joint == name.joint:
            slopes[[unit.names.index(x) for x in spring.names]] = slope
        else:
            variance += float(slope @ spring.covariance @ slope)
    error = float(np.sqrt(variance))
    return _scaled(robot, unit, name.joint, name.parameter, load.value(name), error, slopes)


def scaled_by_sensor(
    robot: Robot, unit: Estimate, joint: str, name: str, spring: Estimate
) -> Estimate:
    """Return the estimate `unit` for a motor constant of 1 with the constant that a sensor gives.

    It is K = k / k_1: the stiffness by the torque sensor in (4b) over that of (7) for a constant of
    1. The errors of both count, so that K k_1 has that of k.
    """
    of_unit, of_sensor = unit.value(STIFFNESS), spring.value(STIFFNESS)
    slopes = np.where(np.array(unit.names) == STIFFNESS, -of_sensor / of_unit**2, 0.0)
    error = spring.standard_error(STIFFNESS) / abs(of_unit)
    return _scaled(robot, unit, joint, name, of_sensor / of_unit, error, slopes)


def scales_with_torque(estimate: Estimate) -> BoolArray:
    """Return which parameters (p,) of a drive scale with its torque: all but a delay [s]."""
    return np.array([name != DELAY_PARAMETER for name in estimate.names])


def _scaled(
    robot: Robot,
    unit: Estimate,
    joint: str,
    name: str,
    constant: float,
    error: float,
    by_unit: Array | float = 0.0,
) -> Estimate:
    """Return the estimate for a motor constant with an error, from that for a constant of 1.

    The constant has the derivative `by_unit` by the values of the latter.
    """
    is_scaled = scales_with_torque(unit)
    factors = np.where(is_scaled, constant, 1.0)
    values = np.append(factors * unit.values, constant)
    # The values are (K x, K), with dK = by_unit^T dx + an error that is independent of x:
    # d(K x, K) = (diag(K); 0) dx + (x, 1) dK. A delay [s] does not scale with torque.
    by_constant = np.append(np.where(is_scaled, unit.values, 0.0), 1.0)
    change = np.vstack([np.diag(factors), np.zeros(len(factors))])
    change += np.outer(by_constant, np.broadcast_to(by_unit, len(factors)))
    covariance = change @ unit.covariance @ change.T + error**2 * np.outer(by_constant, by_constant)
    white, freedom = unit.white_standard_errors, unit.degrees_of_freedom
    return replace(
        unit,
        names=(*unit.names, name),
        values=values,
        covariance=covariance,
        units=(*unit.units, unit_of(robot.drives[joint], name)),
        white_standard_errors=None if white is None else np.append(factors * white, error),
        degrees_of_freedom=None if freedom is None else np.append(freedom, np.min(freedom)),
    )


def fit_load(
    robot: Robot,
    springs: Mapping[str, Estimate],
    estimator: Estimator,
    cutoff_hz: float,
    free: bool,
    rows: Rows,
    errors: Sequence[Array],
) -> FittedRows:
    """Fit (8) from rows without spring torque, with columns of the identifiable torque offsets.

    `errors` are the covariances of propagated columns after those of the springs, such as that of
    the encoder offsets. Unless `free`, torque offsets are 0.
    """
    covariances = [*(spring.covariance for spring in springs.values()), *errors]
    propagated = linalg.block_diag(*covariances) if covariances else None
    freed = tuple(j for j, spring in springs.items() if free and "spring_offset" in spring.names)
    if freed:
        columns = partial(with_torque_columns, robot, springs, freed)
        # All offsets are tried at once: a column that gravity nearly explains is dropped again.
        freed = identifiable_offsets(qr_factor_of_rows(rows, columns), freed)
    change = partial(with_torque_columns, robot, springs, freed)
    fitted = fit_inputs(rows, estimator, propagated, change, cutoff_hz)
    return with_shared_delays(robot.drives, fitted)


def fit_inputs(
    rows: Rows,
    estimator: Estimator,
    propagated: Array | None,
    change: Change | None,
    cutoff_hz: float | None,
) -> FittedRows:
    """Fit rows with the noise of logged currents in their own columns; see `unattenuated`.

    If it hides the constant, the estimate is that of least squares.
    """
    fitted = fit(rows, estimator, propagated, change, check_scale, cutoff_hz)
    names = enumerate(fitted.qr_factor.names)
    noisy = [place for place, name in names if parameter_of(name) == _OF_CURRENT]
    if not noisy or estimator.weigh is None:
        return fitted
    weights = equal_weights(fitted.qr_factor) if fitted.equal else fitted.weights
    theta = unattenuated(fitted.qr_factor, weights, noisy, reweigh=not fitted.equal)
    if theta is None:
        return fitted

    # Least squares with the predicted columns c + r / k has the solution and the residual of
    # `unattenuated`, so that covariance and checks, which come from the rows, are those of it.
    def predicted(part: Regression) -> Regression:
        return with_predicted_columns(part if change is None else change(part), theta, noisy)

    return fit(rows, estimator, propagated, predicted, cutoff_hz=cutoff_hz)


def with_offset_columns(
    robot: Robot,
    model: LoadModel,
    springs: Mapping[str, Estimate],
    theta: Array,
    regress: Regress,
    motion: Motion,
) -> Regression:
    """Return the load side with propagated columns of the springs and then of encoder offsets."""
    plain, values = regress(motion), {joint: spring.values for joint, spring in springs.items()}
    of_springs = partial(load_regression, robot, model=model, springs=values)
    offsets = offset_sensitivity(robot, motion, of_springs, theta)
    return replace(plain, propagated=np.hstack([plain.propagated, offsets.propagated]))


def joints_with_torque(robot: Robot, datasets: Sequence[Dataset]) -> tuple[str, ...]:
    """Return the joints whose torque is measured, by a sensor or by a spring."""
    motions = [first_motion(dataset) for dataset in datasets]
    joints = tuple(
        joint
        for joint in robot.joint_names
        if joint in robot.elastic_joints
        or _all_measured(robot, motions, joint, INPUT_FIELDS[robot.drives[joint].motor_input])
        or _all_measured(robot, motions, joint, "joint_torque")
    )
    if not joints and robot.floating_base is None:
        raise IdentificationError(
            "no joint has a torque in the logs: describe a motor_torque (a current is one with "
            'unit = "A" and torque_constant_Nm_per_A), or write motor_input in the drives file'
        )
    return joints


def check_forces(datasets: Sequence[Dataset], torque_joints: Sequence[str]) -> None:
    """Raise IdentificationError for logs of a floating base without torque or measured wrench."""
    bases = [first_motion(dataset).base for dataset in datasets]
    if not torque_joints and all(base is not None and not base.wrenches for base in bases):
        raise IdentificationError(
            "no joint has a torque and no contact a measured wrench, so nothing in the logs is a "
            "force: add torques of joints, or the force of each foot (<link>.force_x_N and so on)",
            "torque_joints=",
        )


def spring_torque_joints(
    robot: Robot, datasets: Sequence[Dataset], model: LoadModel
) -> tuple[str, ...]:
    """Return the joints of the model whose torque on the load is that of their spring."""
    motions = [first_motion(dataset) for dataset in datasets]
    return tuple(
        joint
        for joint in model.torque_joints
        if joint in robot.elastic_joints
        and not _all_measured(robot, motions, joint, "joint_torque")
    )


def _all_measured(robot: Robot, motions: Sequence[Motion], joint: str, signal: str) -> bool:
    index = robot.index(joint)
    # The torque at a drive is that of all sensors of its coupled joints, C^-T tau.
    used = group_of(robot.transmission, index) if signal == "joint_torque" else [index]
    channels = [getattr(motion, signal) for motion in motions]
    return all(data is not None and bool(np.all(np.isfinite(data[:, used]))) for data in channels)


def split_load_side(model: LoadModel, load_side: Estimate) -> tuple[Estimate, dict[str, Estimate]]:
    """Return the base parameters, and the load side's estimates of drives {joint: Estimate}."""
    p = len(model.base.columns)
    base = load_side.part(range(p), model.expressions)
    drives = {}
    for joint in dict.fromkeys(joint for joint, _, _ in model.drives):
        # The columns of `model` are the base parameters, then the parameters of drives.
        places = [i for i, (owner, _, _) in enumerate(model.drives) if owner == joint]
        names = [model.drives[i][1] for i in places]
        drives[joint] = load_side.part([p + i for i in places], names)
    return base, drives
