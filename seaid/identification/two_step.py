"""The two-step method of the paper: the actuator side (10) of each spring, then the load side (8).

Several conditions are fitted together: a condition is a part of the names of what it does not share
with the others, and an identification of one robot is that of one condition without a name.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Self

import numpy as np
from scipy import linalg

from seaid._arrays import Array
from seaid.drives import Drive, ParameterName
from seaid.drives.drives import groups_of
from seaid.drives.terms import places_of
from seaid.errors import IdentificationError, listed
from seaid.estimation import Estimator, FittedRows, fit
from seaid.estimation.estimate import ModelChecks
from seaid.estimation.fitting import RowChange, Rows, qr_factor_of_rows
from seaid.estimation.instrumental_variables import (
    deflection_instruments,
    instrumental,
    projected_columns,
    unattenuated,
    with_predicted_columns,
)
from seaid.estimation.least_squares import equal_weights
from seaid.estimation.parameters import Share, joined_rows, shares_of
from seaid.identification import drive_estimates
from seaid.identification.datasets import Dataset, first_motion, rows_in_memory, rows_of_equations
from seaid.identification.stacked_fits import (
    EXACT,
    LOAD,
    STIFFNESS,
    FitsInTurn,
    KnownErrors,
    RobotEstimate,
    SensorErrors,
    identifiable_offsets,
    offset_places,
    sensed_spring,
    spring_of,
    with_torque_columns,
)
from seaid.log import Motion
from seaid.regressor import Regression, actuator_regression, load_regression, motor_regressor
from seaid.regressor.base import INPUT_FIELDS
from seaid.regressor.load import LoadModel, load_model_of
from seaid.regressor.regression import Regress, spring_regression, spring_regressor
from seaid.robot import Robot
from seaid.robot.robot import check_held
from seaid.robot.transmission import group_of

_OF_CURRENT = "torque_constant"
"""The constant of a current. A current is measured with noise, so that its column biases least
squares; a voltage is what the drive applies, without noise."""

_NEEDED = (STIFFNESS, "spring_offset", "deflection_zero")


@dataclass(frozen=True, eq=False)
class Condition:
    """What was logged in one condition: its robot, datasets, and joints with a torque in use.

    `competing` {joint: drives} are at other optima of the searches of nonlinear parameters, which
    the data do not distinguish from those of the robot.
    """

    robot: Robot
    datasets: Sequence[Dataset]
    used: Sequence[str]
    competing: Mapping[str, Sequence[Drive]] = field(default_factory=dict, kw_only=True)

    def with_drives(self, drives: Mapping[str, Drive]) -> Self:
        """Return the condition with other drives at some joints."""
        return replace(self, robot=self.robot.with_drives(drives))

    def measures(self, joint: str, signal: str) -> bool:
        """Whether all logs have a signal of a joint."""
        index = self.robot.index(joint)
        # The torque at a drive is that of all sensors of its coupled joints, C^-T tau.
        is_torque = signal == "joint_torque"
        used = group_of(self.robot.transmission, index) if is_torque else [index]
        channels = [getattr(motion, signal) for motion in self.motions]
        return all(x is not None and bool(np.all(np.isfinite(x[:, used]))) for x in channels)

    def has_input(self, joint: str) -> bool:
        """Whether all logs have the torque, current or voltage of a motor, or its command."""
        return self.measures(joint, INPUT_FIELDS[self.robot.drives[joint].motor_input])

    @property
    def springs(self) -> tuple[str, ...]:
        """The joints in use whose torque on the load is that of their spring."""
        elastic = (joint for joint in self.used if joint in self.robot.elastic_joints)
        return tuple(joint for joint in elastic if not self.measures(joint, "joint_torque"))

    @cached_property
    def model(self) -> LoadModel:
        """The columns of the load side."""
        return load_model_of(self.robot, self.motions, self.used)

    @property
    def motions(self) -> list[Motion]:
        """The motions, of long logs those of their first pieces."""
        return [first_motion(dataset) for dataset in self.datasets]

    @property
    def motions_in_memory(self) -> list[Motion]:
        """The motions if all logs are in memory, else none."""
        motions = [dataset for dataset in self.datasets if isinstance(dataset, Motion)]
        return motions if len(motions) == len(self.datasets) else []


ONLY = ""
"""Name of the condition of an identification that has no other: its parameters have none in their
names."""

BODIES = "bodies"
"""Stands for all base parameters among those that are specific to a condition."""


@dataclass(frozen=True)
class SpecificParameters:
    """The parameters that each condition has for itself: `names` of any joint, or of one joint."""

    names: tuple[str, ...] = ()

    def has(self, name: ParameterName) -> bool:
        """Whether the parameter of a drive, or a base parameter, is specific."""
        if not name.owner:
            return BODIES in self.names
        return name.quantity in self.names or name in self.names


NOTHING_SPECIFIC = SpecificParameters()

ENCODER_OFFSET = "encoder_offset"


@dataclass(frozen=True, eq=False)
class TwoStepFits:
    """One fit per equation over all conditions.

    A parameter that is not shared has one column per condition, with the condition in its name.
    `shares` {equation: {condition: its rows}} are those of `rows_of_conditions`, `known_errors` the
    errors of what was given as known, which all estimates have.
    """

    conditions: Mapping[str, Condition]
    fits: FitsInTurn
    shares: Mapping[str, Mapping[str, Share]]
    known_errors: KnownErrors = EXACT

    @property
    def actuators(self) -> Mapping[str, FittedRows]:
        """The fits of the motor equations by joint."""
        return self.fits.actuators

    @property
    def load(self) -> FittedRows:
        """The fit of the load side."""
        load = self.known_errors.fit or self.fits.load
        assert load is not None
        return load

    def of(self, name: str) -> RobotEstimate:
        """Return the estimate of the robot of one condition."""
        robot, model = self.conditions[name].robot, self.conditions[name].model
        drives, load_side = self.fits.of_condition(name, model.names, self.known_errors)
        names = self.load.estimate.names
        columns = [names[place] for place in places_of(names, name)]
        # `model.expressions` are the base parameters. The drive parameters follow in `model.names`,
        # and torque offsets follow these: a drive may lack its parameters, but not its bodies.
        optional = columns[len(model.expressions) : len(model.names)]
        excluded = {joint: self._excluded(joint, name, x) for joint, x in self.actuators.items()}
        return RobotEstimate(
            model=model,
            drives=drives,
            load_side=load_side,
            springs={x: spring_of(robot, drives[x], x).values for x in self.fits.springs},
            excluded=excluded | {"load": self._excluded(LOAD, name, self.load)},
            checks=_checks(self.actuators, name) | {"load": self.load.checks(optional)},
            fit=self.load,
            fits=self.fits,
            known=self.known_errors,
        )

    def _excluded(self, equation: str, condition: str, fit: FittedRows) -> int:
        share = self.shares.get(equation, {}).get(condition)
        return fit.qr_factor.excluded if share is None else share.excluded


def estimate_two_step(
    conditions: Mapping[str, Condition],
    estimator: Estimator,
    progress: bool = False,
    specific: SpecificParameters = NOTHING_SPECIFIC,
    equations: Mapping[str, Regress] | None = None,
    sensor_errors: SensorErrors | None = None,
) -> TwoStepFits:
    """Estimate both sides in turn, with the springs' uncertainty propagated to the load.

    Parameters that are not `specific` are the same in all conditions. `sensor_errors` change the
    torques of one condition.

    `equations` replace `two_step_equations` of one condition. Their columns are those that
    `estimator` expects, its `effective_rows` restores the plain ones, and torque offsets are not
    fitted.
    """
    first = next(iter(conditions.values()))
    datasets = [dataset for each in conditions.values() for dataset in each.datasets]
    whole = Condition(first.robot, datasets, first.used)
    joints = whole.springs
    sensed = _joints_scaled_by_sensors(whole) if equations is None else ()
    sensed = tuple(x for x in sensed if not specific.has(ParameterName(STIFFNESS, x)))
    of_all = {
        name: two_step_equations(x.robot, x.model, joints, sensed) for name, x in conditions.items()
    }
    by_condition = of_all if equations is None else dict.fromkeys(conditions, equations)
    stored, propagated = estimator.weigh is not None, propagated_names(first.robot, joints)
    is_plain = equations is None
    chosen = conditions, specific, by_condition, propagated, stored, progress
    with rows_of_conditions(*chosen) as (rows, shares):
        motors = _fits_of_motors(whole, estimator, joints, sensed, rows)
        side = LoadSideFit(motors, estimator, datasets[0].cutoff_hz, is_plain, sensor_errors)
        load = side.fit(rows[LOAD], np.zeros((0, 0)))
    fits = replace(motors, load=load, refit=side.fit if is_plain else None)
    return TwoStepFits(conditions, fits, shares)


def propagated_names(robot: Robot, springs: Sequence[str]) -> list[ParameterName]:
    """Return the names of the parameters of springs, whose errors the load side propagates."""
    return [
        ParameterName(x, joint) for joint in springs for x in spring_regressor(robot, joint).names
    ]


@contextmanager
def rows_of_conditions(
    conditions: Mapping[str, Condition],
    specific: SpecificParameters,
    equations: Mapping[str, Mapping[str, Regress]],
    propagated: Sequence[ParameterName],
    stored: bool,
    progress: bool = False,
    error_names: Sequence[ParameterName] = (),
) -> Iterator[tuple[Mapping[str, Rows], Mapping[str, Mapping[str, Share]]]]:
    """Yield the rows {equation: rows} over all conditions, and who has which of them.

    `equations` are {condition: {equation: function for its rows}}, and the shares {equation:
    {condition: its rows}}, none of a single condition, which has all.

    Those of one condition may be stored in files. `propagated` are the columns that the load side
    has besides its own. Every equation has columns of the errors of known constants, which are
    called `error_names`; all conditions share these but for encoder offsets.
    """
    if len(conditions) == 1:
        ((name, only),) = conditions.items()
        with rows_of_equations(only.datasets, equations[name], stored, progress) as rows:
            yield rows, {}
        return
    parts = {
        name: rows_in_memory(x.datasets, equations[name], progress)
        for name, x in conditions.items()
    }
    by_equation = {
        key: {name: rows[key] for name, rows in parts.items()} for key in next(iter(parts.values()))
    }

    joined: dict[str, Rows] = {}
    for key, rows_of_all in by_equation.items():
        # The columns of a drive's equation do not name its joint.
        joint = "" if key == LOAD else ParameterName.of(key).owner or key
        propagated_of_all = error_names if joint else [*propagated, *error_names]
        is_specific = partial(_is_specific, specific, joint, error_names)
        joined[key] = joined_rows(rows_of_all, is_specific, propagated_of_all)
    shares = {key: shares_of(rows_of_all) for key, rows_of_all in by_equation.items()}
    yield joined, shares


def _is_specific(
    specific: SpecificParameters,
    joint: str,
    error_names: Sequence[ParameterName],
    name: ParameterName,
) -> bool:
    """Whether each condition has a column for itself: encoders are zeroed at each start."""
    if name in error_names:
        return name.quantity == ENCODER_OFFSET
    return specific.has(name.at(joint) if joint else name)


def _fits_of_motors(
    condition: Condition,
    estimator: Estimator,
    springs: tuple[str, ...],
    sensed: Sequence[str],
    rows: Mapping[str, Rows],
) -> FitsInTurn:
    """Return the fits (10) of the motor equations, and of what gives their unknown constants.

    A constant comes from the torque sensor of a `sensed` joint, else from the load side, which has
    the torques of the `springs`. Where the spring torque was measured alone, the fit is by errors
    in variables.
    """
    motors, unscaled = dict[str, FittedRows](), dict[str, drive_estimates.UnknownScaleError]()
    constants, by_sensor = dict[str, ParameterName](), dict[str, FittedRows]()
    robot, motions = condition.robot, condition.motions
    cutoff_hz = motions[0].cutoff_hz
    for joint in robot.elastic_joints:
        try:
            fitted = fit_inputs(rows[joint], estimator, None, None, cutoff_hz)
        except drive_estimates.UnknownScaleError as problem:
            # The load would scale each drive of a group for itself.
            if joint not in (*springs, *sensed) or groups_of(robot.drives):
                raise
            # With a constant of 1 the input is in y, where its noise does not attenuate anything:
            # the fit needs no correction for a noisy column.
            constants[joint] = ParameterName(problem.parameter, joint)
            unscaled[joint], change = problem, drive_estimates.with_unit_constant
            fitted = fit(rows[joint], estimator, change=change, cutoff_hz=cutoff_hz)
        motors[joint] = drive_estimates.with_shared_parameters(robot.drives, fitted, joint)
        if drive_estimates.has_only_spring_torque(robot, motions, joint):
            motors[joint] = _with_noisy_deflection(robot, motions, motors[joint], joint, estimator)
    for joint in filter(sensed.__contains__, constants):
        del unscaled[joint]
        spring = fit(rows[sensed_spring(joint)], estimator, cutoff_hz=cutoff_hz)
        by_sensor[joint] = _with_noisy_deflection(robot, motions, spring, joint, estimator)
    fits = FitsInTurn(robot, motors, springs, constants, by_sensor)
    if not unscaled:
        return fits
    values = {joint: fits.spring(joint).values for joint in springs}
    scales = drive_estimates.fit_constants(robot, values, rows[LOAD], estimator, unscaled)
    return replace(fits, by_load=scales)


def _checks(actuators: Mapping[str, FittedRows], condition: str) -> dict[str, ModelChecks]:
    """Return the checks of the motor equations, of the terms that a drive may lack."""
    checks = {}
    for joint, side in actuators.items():
        names = side.estimate.names
        of_condition = [names[place] for place in places_of(names, condition)]
        optional = [name for name in of_condition if name.quantity not in _NEEDED]
        checks[joint] = side.checks(optional)
    return checks


def two_step_equations(
    robot: Robot, model: LoadModel, springs: Sequence[str], sensed: Sequence[str] = ()
) -> dict[str, Regress]:
    """Return the functions for the rows: of each elastic joint, and of the load side (`LOAD`).

    Those of the springs of `sensed` joints are of (4b) too.
    """
    # Springs of zero have no torque in y, but their columns T of (4b) are in `propagated`: after
    # the fits of the springs s, y + T s is (8) with their torque, and T C_s T^T its covariance.
    zero = drive_estimates.without_torque(robot, springs)
    equations: dict[str, Regress] = {
        joint: partial(actuator_regression, robot, joint=joint) for joint in robot.elastic_joints
    }
    equations[LOAD] = partial(load_regression, robot, model=model, springs=zero)
    of_springs = {sensed_spring(x): partial(spring_regression, robot, joint=x) for x in sensed}
    return equations | of_springs


def _with_noisy_deflection(
    robot: Robot, motions: Sequence[Motion], fitted: FittedRows, joint: str, estimator: Estimator
) -> FittedRows:
    """Return the fit of (4b) by errors in variables, if its spring is linear and has an offset."""
    plain = fitted.estimate.names == (STIFFNESS, "spring_offset")
    if not plain or not estimator.weigh or fitted.rows is None:
        return fitted
    instruments = deflection_instruments(
        fitted.rows, drive_estimates.noise_ratio(robot, motions, joint)
    )
    change = partial(replace, H=projected_columns(fitted.rows, instruments))
    return replace(fitted, estimate=instrumental(fitted.rows, instruments), change=change)


def _joints_scaled_by_sensors(condition: Condition) -> tuple[str, ...]:
    """Return the elastic joints with an unknown motor constant and a measured spring torque."""
    robot = condition.robot
    return tuple(
        joint
        for joint in robot.elastic_joints
        if set(drive_estimates.CONSTANTS) & set(motor_regressor(robot, joint).names)
        and STIFFNESS in spring_regressor(robot, joint).names
        and condition.has_input(joint)
        and condition.measures(joint, "joint_torque")
    )


def check_scale_of_locked(robot: Robot, datasets: Sequence[Dataset], locked: Iterable[str]) -> None:
    """Raise IdentificationError for locked outputs whose motor constant nothing determines.

    What holds them could have any torque, so that bodies give no scale.
    """
    sensed = _joints_scaled_by_sensors(Condition(robot, datasets, ()))
    for joint in (joint for joint in locked if joint not in sensed):
        names = set(motor_regressor(robot, joint).names)
        if names & set(drive_estimates.CONSTANTS) and {STIFFNESS, "motor_inertia"} <= names:
            (name,) = names & set(drive_estimates.CONSTANTS)
            raise IdentificationError(
                f"the {name.replace('_', ' ')} of {joint} is unidentifiable: "
                f"{drive_estimates.CONSTANTS[name]}, and its output is locked. Give one of: the "
                "torque of a sensor behind the gear (joint_torque), the stiffness of its spring "
                f"(known = ['{STIFFNESS}']), its rotor inertia, or the constant itself "
                f"(known = ['{name}'])"
            )


@dataclass(frozen=True, eq=False)
class LoadSideFit:
    """How (8) is fitted once the `motors` are: with their springs' torques and torque offsets."""

    motors: FitsInTurn
    estimator: Estimator
    cutoff_hz: float
    has_torque_offsets: bool
    sensor_errors: SensorErrors | None

    def fit(self, rows: Rows, error_covariance: Array) -> FittedRows:
        """Fit (8) from rows without spring torque, with columns of identifiable torque offsets.

        The propagated columns of the rows are those of the springs, then those of errors of the
        `error_covariance` (k, k).
        """
        robot, motors = self.motors.robot, self.motors
        springs = {joint: motors.spring(joint) for joint in motors.springs}
        covariances = [motors.drives.of_names(motors.spring_names).covariance, error_covariance]
        if self.sensor_errors is not None and isinstance(rows, Regression):
            columns = np.hstack([rows.propagated, self.sensor_errors.columns])
            rows = replace(rows, propagated=columns)
            covariances.append(self.sensor_errors.covariance)
        covariance = linalg.block_diag(*covariances)
        freed = tuple(x for x in springs if self.has_torque_offsets and offset_places(springs[x]))
        if freed:
            with_all = partial(with_torque_columns, robot, springs, freed)
            # All offsets are tried at once: a column that gravity nearly explains is dropped again.
            freed = identifiable_offsets(qr_factor_of_rows(rows, with_all), freed)
        change: RowChange = partial(with_torque_columns, robot, springs, freed)
        propagated = covariance if covariance.size else None
        fitted = fit_inputs(rows, self.estimator, propagated, change, self.cutoff_hz)
        return drive_estimates.with_shared_parameters(robot.drives, fitted)


def fit_inputs(
    rows: Rows,
    estimator: Estimator,
    propagated: Array | None,
    change: RowChange | None,
    cutoff_hz: float | None,
) -> FittedRows:
    """Fit rows with the noise of logged currents in their own columns; see `unattenuated`.

    If it hides the constant, the estimate is that of least squares.
    """
    fitted = fit(rows, estimator, propagated, change, drive_estimates.check_scale, cutoff_hz)
    names = enumerate(fitted.qr_factor.names)
    noisy = [place for place, name in names if name.quantity == _OF_CURRENT]
    if not noisy or estimator.weigh is None:
        return fitted
    weights = equal_weights(fitted.qr_factor) if fitted.equal else fitted.weights
    theta = unattenuated(fitted.qr_factor, weights, noisy, reweigh=not fitted.equal)
    if theta is None:
        return fitted

    # Of a noisy column c with the parameter k and the residual r, c + r / k is the column without
    # its noise. Least squares with it has the solution and the residual of `unattenuated`, so that
    # covariance and checks, which come from the rows, are those of it.
    def predicted(part: Regression) -> Regression:
        return with_predicted_columns(part if change is None else change(part), theta, noisy)

    return fit(rows, estimator, propagated, predicted, cutoff_hz=cutoff_hz)


def joints_with_torque(robot: Robot, datasets: Sequence[Dataset]) -> tuple[str, ...]:
    """Return the joints whose torque is measured, by a sensor or by a spring."""
    logged = Condition(robot, datasets, ())
    joints = tuple(
        joint
        for joint in robot.joint_names
        if joint in robot.elastic_joints
        or logged.has_input(joint)
        or logged.measures(joint, "joint_torque")
    )
    if not joints and robot.base_is_held:
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


# Procedures, and what they cannot have

LINEAR_SPRING = {"stiffness", "spring_damping", "spring_offset"}

Limits = Callable[[Robot, Collection[str]], Iterator[str]]
"""Function of a robot and some of its joints that yields why a procedure cannot have them."""

Continuation = Callable[[Condition, RobotEstimate, Estimator], RobotEstimate]
"""Function that returns an estimate from that of two steps by a linear estimator."""


@dataclass(frozen=True)
class Procedure:
    """What estimates both sides from their blocks of residuals, (7) and (8), with its limits.

    `option` is how it is asked for. It refuses what its `limits` yield: the text is what it `only`
    does, the limit, and what to do `instead`. `held` is the reason for which the base has to be
    held. `continued` goes on from two steps; None: it does not.
    """

    option: str
    limits: Limits = lambda robot, joints: iter(())
    only: str = ""
    instead: str = ""
    held: str = ""
    continued: Continuation | None = None

    def check(self, robot: Robot, joints: Collection[str]) -> None:
        """Raise IdentificationError for a floating base, and for joints that it cannot have."""
        if self.held:
            check_held(robot, self.option, IdentificationError, why=self.held)
        for reason in self.limits(robot, joints):
            text = f"{self.option} {self.only}: {reason}; {self.instead}"
            raise IdentificationError(text, self.option, self.instead.removeprefix("use "))

    def check_seen(self, joints: Sequence[str]) -> None:
        """Raise IdentificationError for joints without encoder, where it would do nothing."""
        if self.continued is not None:
            raise IdentificationError(
                f"{self.option} needs the joint position of each spring, and the logs have none of "
                f"{listed(joints)}: these springs are found by a refinement that simulates the "
                f"motors, whatever the first estimate is; remove {self.option}, or log the joint "
                "position",
                self.option,
            )


IN_TURN = Procedure('method="two-step"')
"""(7) of each drive, or (4b) where only the torque of its spring is known, then (8)."""


def nonlinear_springs(needed: set[str], robot: Robot, joints: Collection[str]) -> Iterator[str]:
    """Yield which springs are not linear, or lack the parameters that are needed."""
    for joint in joints:
        if not needed <= {*spring_regressor(robot, joint).names} <= LINEAR_SPRING:
            yield f"the spring of {joint} {kind_of_spring(robot, joint)}"


def kind_of_spring(robot: Robot, joint: str) -> str:
    """Describe the terms of a spring other than unknown stiffness and offset."""
    regressor, drive = spring_regressor(robot, joint), robot.drives[joint]
    others = [name.replace("_", " ") for name in regressor.names if name not in LINEAR_SPRING]
    if others:
        return f"has {', '.join(others)}"
    if "spring_damping" in regressor.names:
        return "has damping"
    return f"has a known {' and '.join(name.replace('_', ' ') for name in drive.known)}"
