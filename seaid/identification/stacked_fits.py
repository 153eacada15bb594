"""Equations that are fitted in turn, as one estimate with one covariance.

What was given as known comes first, then (7) of each drive, what determines its unknown motor
constant, and (8). Each equation contains values of those before it, so that the matrix A of the
derivatives of all moments is block-triangular: the errors of a fit are its own and its slopes times
those of earlier values, and A^-1 B A^-T is built block by block (Newey and McFadden 1994, section
6). The parameters are functions of the values that were fitted.

(7) has the sum of a constant error of the motor torque b_0 and the spring offset f_0 as one column,
s = f_0 + b_0 N/r_M. (4b) with s instead of f_0 would put r_L N/r_M b_0 on the load. So (8) gets a
column for b_0 per spring: r_L (k d + s) = Y beta + r_L N/r_M b_0, and f_0 is the difference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy import linalg

from seaid._arrays import Array
from seaid.drives import ParameterName, unit_of
from seaid.drives.controller import DELAY_PARAMETER
from seaid.errors import Finding
from seaid.estimation import Estimate, FittedRows, SharedParameter
from seaid.estimation.estimate import ModelChecks, independent_errors, independent_rows
from seaid.estimation.fitting import Rows
from seaid.estimation.parameters import Constraints, shared_columns, shared_parameters
from seaid.estimation.qr_factor import QRFactor, triangle
from seaid.regressor import Regression
from seaid.regressor.regression import spring_regressor
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.log import LongLog, Motion
    from seaid.regressor.load import LoadModel

LOAD = "load side (8)"
"""Key of the load side among equations named by joint."""

SCALE = ParameterName("scale")
"""Key of the fit of the load side that determines motor constants."""

STIFFNESS = "stiffness"

TORQUE_OFFSET = "torque_offset"


def sensed_spring(joint: str) -> ParameterName:
    """Return the key of (4b) of a joint among equations named by joint."""
    return ParameterName("spring", joint)


def spring_of(robot: Robot, estimate: Estimate, joint: str) -> Estimate:
    """Return the estimate of a joint's spring, in the order of its regressor.

    A parameter that several conditions have for themselves is there once for each.
    """
    names = spring_regressor(robot, joint).names
    return estimate.of_names(x for name in names for x in estimate.names if x.quantity == name)


def offset_places(spring: Estimate) -> list[int]:
    """Return the places of the offset of a spring, one for each condition that has its own."""
    return [place for place, name in enumerate(spring.names) if name.quantity == _OFFSET]


_OFFSET = "spring_offset"


def offset_lever(robot: Robot, joint: str) -> float:
    """Return N / r_M: the spring force per motor torque."""
    drive = robot.drives[joint]
    return drive.ratio / drive.motor_radius


@dataclass(frozen=True, eq=False)
class KnownErrors:
    """The errors (k,) of what was given as known, and how the values of the fits depend on them.

    `slopes` {equation: (p, k)} are the derivatives of the values of a fit by the errors; those of
    the load side follow its derivatives by the springs. `levers` {joint: (k,)} are the relative
    derivatives of N / r_M. `fit` is a fit of the load side whose rows propagate the first
    `beside_noise` errors, those of encoder offsets, so that they are no noise of its residual;
    None: there is no such fit.
    """

    errors: Estimate
    slopes: Mapping[str, Array] = field(default_factory=dict)
    levers: Mapping[str, Array] = field(default_factory=dict)
    fit: FittedRows | None = None
    beside_noise: int = 0

    def with_further(self, further: KnownErrors) -> KnownErrors:
        """Return these errors, and behind them those of what else was given, without a fit."""
        if not self.slopes:
            return further
        k = len(further.errors.names)
        return replace(
            self,
            errors=Estimate.joined([self.errors, further.errors]),
            slopes={x: np.hstack([y, further.slopes[x][:, -k:]]) for x, y in self.slopes.items()},
            levers={x: np.append(y, further.levers[x]) for x, y in self.levers.items()},
        )

    def of(self, equation: str, fit: FittedRows) -> Array:
        """Return the derivatives (p, k) of the values of the fit of an equation."""
        nothing = np.zeros((len(fit.estimate.names), len(self.errors.names)))
        return self.slopes.get(equation, nothing)


EXACT = KnownErrors(independent_errors({}))
"""Nothing that was given as known has an error."""


@dataclass(frozen=True, eq=False)
class FitsInTurn:
    """The fits of the motor equations (7), `motors` {joint: fit}, then of the `load` side (8).

    `springs` are the joints whose spring gives the torque on the load. `constants` {joint: name}
    are unknown motor constants: (7) of these joints was fitted for a constant of 1. `by_sensor`
    {joint: fit of its spring (4b)} determines constants by the torque sensor behind the spring;
    `by_load`, a fit of (8), has the others among its parameters. `refit` fits (8) again from rows
    that propagate further errors, of a covariance (k, k), behind those of the springs; None: these
    errors stay in the noise. Where both sides were fitted at once, `load` is the only fit.
    """

    robot: Robot
    motors: Mapping[str, FittedRows]
    springs: tuple[str, ...]
    constants: Mapping[str, ParameterName] = field(default_factory=dict)
    by_sensor: Mapping[str, FittedRows] = field(default_factory=dict)
    by_load: FittedRows | None = None
    load: FittedRows | None = None
    refit: Callable[[Rows, Array], FittedRows] | None = None

    @property
    def equations(self) -> Iterator[tuple[str, str, FittedRows]]:
        """Key, equation and fit of each fit."""
        yield from ((joint, joint, fit) for joint, fit in self.motors.items())
        yield from ((sensed_spring(x), sensed_spring(x), fit) for x, fit in self.by_sensor.items())
        yield from ((SCALE, LOAD, fit) for fit in [self.by_load] if fit is not None)
        yield from ((LOAD, LOAD, fit) for fit in [self.load] if fit is not None)

    @cached_property
    def drives(self) -> Estimate:
        """The parameters of all drives by (7) as one estimate, without errors of what is known."""
        return self._drives(EXACT)

    def spring(self, joint: str) -> Estimate:
        """Return the spring of a joint by (7), whose offset is s."""
        return spring_of(self.robot, _of_joint(self.drives, joint), joint)

    def _drives(self, known: KnownErrors) -> Estimate:
        """Return what is known and the parameters of all drives by (7) as one estimate."""
        whole, given = known.errors, known.errors.names
        for joint, fit in self.motors.items():
            whole = whole.with_further(fit.estimate.at(joint), given, known.of(joint, fit))
        for joint, fit in self.by_sensor.items():
            whole = self._scaled_by_sensor(whole, known, joint, fit)
        if self.by_load is not None:
            whole = self._scaled_by_load(whole, known, self.by_load)
        groups = shared_columns(self.robot.drives, whole.names)
        if not groups:
            return whole
        of_fits = [fit.white_covariance for fit in self.motors.values()]
        white = linalg.block_diag(np.zeros(2 * [len(given)]), *of_fits)
        return Constraints.of(len(whole.names), groups.values()).applied(whole, white)

    @cached_property
    def shared(self) -> tuple[SharedParameter, ...]:
        """What the motor equations show of parameters that drives share."""
        if not self.motors:
            return ()
        alone = Estimate.joined(fit.estimate.at(joint) for joint, fit in self.motors.items())
        rows = sum(independent_rows(fit.qr_factor, fit.estimate) for fit in self.motors.values())
        return shared_parameters(alone, shared_columns(self.robot.drives, alone.names), rows)

    @cached_property
    def actuators(self) -> Mapping[str, FittedRows]:
        """The fits of the motor equations, with the values that drives share."""
        if not self.shared:
            return self.motors
        together = {
            joint: _with_residual_of(fit.estimate, _of_joint(self.drives, joint))
            for joint, fit in self.motors.items()
        }
        return {
            joint: replace(fit, estimate=together[joint], shared=self.shared)
            for joint, fit in self.motors.items()
        }

    def _scaled_by_sensor(
        self, whole: Estimate, known: KnownErrors, joint: str, fit: FittedRows
    ) -> Estimate:
        """Return the drives with the motor constant of one by its torque sensor.

        It is K = k / k_1: the stiffness k by (4b) over that of (7) for a constant of 1.
        """
        name, stiffness = self.constants[joint], ParameterName(STIFFNESS, joint)
        unit, sensed = whole.value(stiffness), fit.estimate.of_names([STIFFNESS])
        constant = sensed.transformed(sensed.values / unit, np.array([[1 / unit]]))
        constant = replace(constant, names=(name,), units=(self._unit(name),))
        slopes = known.of(sensed_spring(joint), fit)[[fit.estimate.names.index(STIFFNESS)]]
        slopes = np.column_stack([slopes, -constant.values]) / unit
        return _with_constant(
            whole.with_further(constant, [*known.errors.names, stiffness], slopes), name
        )

    def _scaled_by_load(self, whole: Estimate, known: KnownErrors, fit: FittedRows) -> Estimate:
        """Return the drives with the motor constants that the load side determines.

        The torque of a spring of values s in (8) is K T s with the constant K of its motor, so that
        an error ds changes the constants by K times their derivatives by that torque.
        """
        names = [name for joint, name in self.constants.items() if joint not in self.by_sensor]
        places, of_load = [fit.estimate.names.index(name) for name in names], fit.estimate.by_name
        springs = self.spring_names
        factors = [of_load.get(self.constants.get(name.owner, name), 1.0) for name in springs]
        slopes = np.hstack([factors * fit.sensitivity, known.of(SCALE, fit)])[places]
        constants = replace(fit.estimate.of_names(names), units=tuple(map(self._unit, names)))
        whole = whole.with_further(constants, [*springs, *known.errors.names], slopes)
        for name in names:
            whole = _with_constant(whole, name)
        return whole

    def _unit(self, name: ParameterName) -> str:
        """Return the unit of a motor constant."""
        return unit_of(self.robot.drives[name.owner], name.quantity)

    @cached_property
    def spring_names(self) -> list[ParameterName]:
        """The parameters of the springs, in the order in which (8) propagates them."""
        return [
            name.at(joint)
            for joint in self.springs
            for name in spring_of(self.robot, self.motors[joint].estimate, joint).names
        ]

    def sides(self, known: KnownErrors = EXACT) -> tuple[dict[str, Estimate], Estimate]:
        """Return the drives {joint: estimate}, f_0 and b_0 separated, and the load side."""
        load, names, given = known.fit or self.load, self.spring_names, known.errors.names
        assert load is not None
        drives, covariance = self._drives(known), load.estimate.covariance
        slopes = known.slopes.get(LOAD, load.sensitivity[:, : len(names)])
        # The covariance of the fit contains the errors that its rows propagate: those of the
        # springs, and with `known.fit` of encoders. Without them it is that of the noise, to which
        # `with_further` adds all errors again by their slopes.
        if m := len(names) + known.beside_noise:
            assert load.propagated is not None
            covariance = covariance - slopes[:, :m] @ load.propagated[:m, :m] @ slopes[:, :m].T
        alone = replace(load.estimate, covariance=covariance)
        whole = self._separated(drives.with_further(alone, [*names, *given], slopes), known)
        p = len(drives.names)
        side = whole.part(range(p, len(whole.names)), load.estimate.names)
        by_joint = {}
        for joint, fit in self.motors.items():
            parameters = [x for x in drives.names if x.owner == joint]
            if (offset := ParameterName(TORQUE_OFFSET, joint)) in side.names:
                parameters.append(offset)
            drive = _of_joint(whole.of_names(parameters), joint)
            by_joint[joint] = _with_residual_of(fit.estimate, drive)
        return by_joint, _with_residual_of(load.estimate, side)

    def of_condition(
        self, condition: str, names: Sequence[str], known: KnownErrors = EXACT
    ) -> tuple[dict[str, Estimate], Estimate]:
        """Return what a condition has: the drives by both sides, and these names of the load."""
        drives, load = self.sides(known)
        side = load.of_condition(condition).of_names(names)
        own = {joint: drive.of_condition(condition) for joint, drive in drives.items()}
        merged = merged_estimates(own, side.by_owner())
        return {joint: merged[joint] for joint in self.robot.joint_names if joint in merged}, side

    def _separated(self, whole: Estimate, known: KnownErrors) -> Estimate:
        """Return both sides with f_0 = s - b_0 N/r_M in place of s."""
        slopes, values, k = np.eye(len(whole.names)), whole.values.copy(), len(known.errors.names)
        for joint in self.springs:
            if (name := ParameterName(TORQUE_OFFSET, joint)) not in whole.names:
                continue
            place, lever = whole.names.index(name), offset_lever(self.robot, joint)
            parameters = enumerate(whole.names)
            offsets = [i for i, x in parameters if (x.quantity, x.owner) == (_OFFSET, joint)]
            slopes[offsets, place] = -lever
            values[offsets] -= lever * values[place]
            if k:  # (8) determines b_0 N/r_M: for a larger lever b_0 is smaller.
                slopes[place, :k] -= values[place] * known.levers[joint]
        return whole.transformed(values, slopes)


def merged_estimates(
    drives: Mapping[str, Estimate], load_side: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the drives' estimates of both sides by joint, without correlation between them."""
    both = drives.keys() & load_side.keys()
    joined = {joint: Estimate.joined([drives[joint], load_side[joint]]) for joint in both}
    return {**load_side, **drives, **joined}


def _with_constant(whole: Estimate, name: ParameterName) -> Estimate:
    """Return the values of a drive for its motor constant in place of those for a constant of 1."""
    place, values, slopes = whole.names.index(name), whole.values.copy(), np.eye(len(whole.names))
    for k, other in enumerate(whole.names):
        # A delay [s] does not scale with torque.
        if other.owner == name.owner and k != place and other.quantity != DELAY_PARAMETER:
            # (x, K) -> (K x, K): d(K x) = K dx + x dK.
            slopes[k, k], slopes[k, place] = values[place], values[k]
            values[k] *= values[place]
    return whole.transformed(values, slopes)


def _of_joint(whole: Estimate, joint: str) -> Estimate:
    """Return what a joint has of an estimate, under names without it."""
    names = {k: x for k, x in enumerate(whole.names) if x.owner == joint}
    return whole.part([*names], [name.at("") for name in names.values()])


def _with_residual_of(fitted: Estimate, estimate: Estimate) -> Estimate:
    """Return an estimate with what a fit shows of its rows."""
    return replace(
        estimate,
        residual_std=fitted.residual_std,
        condition_number=fitted.condition_number,
        diagnostics=fitted.diagnostics,
    )


class SensorErrors(Protocol):
    """Constant errors (k,) of sensors that were identified with the bodies.

    `columns` are the changes of y by the errors (R, k), which have a `covariance` (k, k).
    """

    @property
    def columns(self) -> Array:
        """The changes of y by the errors (R, k)."""

    @property
    def covariance(self) -> Array:
        """The covariance (k, k) of the errors."""

    def removed(self, datasets: Sequence[Motion | LongLog]) -> list[Motion]:
        """Return the motions without the errors."""

    def findings(self) -> Iterable[Finding]:
        """Yield the notes on the errors that were subtracted."""


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """Estimates of both sides of the springs, and the fits that they are from.

    `drives` and `load_side` are the values of the motor equations and of the columns of `model`.
    `springs` {joint: parameters} are the springs whose torque is that on the load. `excluded` rows
    and `checks` are by joint, and "load" for the load side. `fits` are those of both sides in turn,
    `fit` is that of (8). Where both sides were estimated at once, `fit` has both and `whole` is its
    estimate; `regress` returns its rows. `known` are the errors of what was given that it has.
    `not_shared` is the reason why the data do not support an estimate of both sides at once, ""
    without one. `findings` are about the way to the estimates.
    """

    model: LoadModel
    drives: Mapping[str, Estimate]
    load_side: Estimate
    springs: Mapping[str, Array]
    excluded: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    fit: FittedRows
    fits: FitsInTurn
    whole: Estimate | None = None
    findings: tuple[Finding, ...] = ()
    not_shared: str = ""
    known: KnownErrors = EXACT
    regress: Callable[[Robot, Motion], Regression] | None = None

    @cached_property
    def load(self) -> Estimate:
        """The base parameters."""
        return self.load_side.of_names(self.model.expressions)

    @property
    def actuators(self) -> Mapping[str, FittedRows]:
        """The fits of the motor equations by joint, if both sides were estimated in turn."""
        return self.fits.actuators

    @property
    def shared(self) -> tuple[SharedParameter, ...]:
        """The parameters that drives share, each once."""
        fits = [*self.actuators.values(), self.fit]
        return tuple({x.name: x for fit in fits for x in fit.shared}.values())

    def moved_from(self, before: RobotEstimate) -> dict[ParameterName, float]:
        """Return by how many standard errors of a former estimate parameters differ from it."""
        # Standard errors below this part of a value, as those of a log without noise, are rounding.
        moved, rounding = dict[ParameterName, float](), float(np.sqrt(np.finfo(float).eps))
        sides = [(x.at(joint), self.drives[joint].at(joint)) for joint, x in before.drives.items()]
        for old, new in [(before.load, self.load), *sides]:
            for name, value, error in zip(old.names, old.values, old.standard_errors, strict=True):
                size = max(float(error), rounding * abs(float(value)))
                if name in new.names and error > 0:
                    moved[name] = abs(new.value(name) - float(value)) / size
        return moved

    def with_errors(self, known: KnownErrors, condition: str) -> RobotEstimate:
        """Return the estimate of a condition with errors of what was given as known."""
        names = self.load_side.names if self.whole is None else self.whole.names
        drives, side = self.fits.of_condition(condition, names, known)
        whole = None if self.whole is None else side
        load_side = side.of_names(self.load_side.names)
        return replace(self, drives=drives, load_side=load_side, whole=whole, known=known)


LEAST_SHARE = 0.02
"""Least part of the column of a torque offset that the other columns do not explain.

Below it a joint moves so little that its gravity torque is nearly constant, and the errors of the
gravity parameters would grow by the inverse: the offset then counts as zero."""


def with_spring_torque(springs: Sequence[Estimate], rows: Regression) -> Regression:
    """Return rows of the load side with the torque of the springs (4b), from rows without it."""
    if not springs:
        return rows
    values = np.concatenate([spring.values for spring in springs])
    return replace(rows, y=rows.y + rows.propagated[:, : len(values)] @ values)


def with_torque_columns(
    robot: Robot, springs: Mapping[str, Estimate], joints: Sequence[str], rows: Regression
) -> Regression:
    """Return the rows with the torque of the springs and columns of the torque offsets."""
    rows = with_spring_torque(list(springs.values()), rows)
    # `propagated` has the columns of the parameters of each spring in turn.
    places: dict[str, list[int]] = {}
    start = 0
    for joint, spring in springs.items():
        places[joint] = [start + place for place in offset_places(spring)]
        start += len(spring.names)
    columns = np.empty((len(rows.y), len(joints)))
    for column, joint in enumerate(joints):
        # r_L (k d + s) = Y beta + r_L N/r_M b_0: the column of s is r_L, in rows of any condition.
        by_s = rows.propagated[:, places[joint]].sum(axis=1)
        columns[:, column] = offset_lever(robot, joint) * by_s
    names = [ParameterName(TORQUE_OFFSET, joint) for joint in joints]
    return rows.with_columns(names, len(joints) * ["N m"], columns)


def identifiable_offsets(qr_factor: QRFactor, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the joints whose torque offset, among the last columns, the load side determines."""
    R, p = qr_factor.weighted_factor(), len(qr_factor.names)
    kept = list(range(p - len(joints)))
    identifiable: list[str] = []
    for joint, place in zip(joints, range(len(kept), p), strict=True):
        # The last entry of the triangle is the norm of the column without the part in the others.
        remainder = abs(triangle(R[:, [*kept, place]])[-1, -1])
        if remainder > LEAST_SHARE * np.linalg.norm(R[:, place]):
            kept, identifiable = [*kept, place], [*identifiable, joint]
    return tuple(identifiable)
