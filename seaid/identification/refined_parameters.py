"""The parameters of a refinement in one vector, its residuals, and the identification they give.

A `Layout` has the parameters x (p,) and the places of each drive and of the load side among them.
`Outputs` has the residuals of a log about x: of joints that the measured motors drive, of joints
that their controllers drive, or of what was measured and is compared with the equations.
`identification_at` makes an identification of the values and the covariance of a search.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping, IndexArray
from seaid.checks.values import revalued
from seaid.drives import PARAMETERS, ParameterName, readable, total_ratio
from seaid.drives.terms import parameter_named
from seaid.errors import IdentificationError
from seaid.estimation import Estimate, Parameter, Prior
from seaid.estimation.nonlinear_least_squares import Point, Residuals, Step
from seaid.estimation.parameters import bounds_of, buses_of, is_stated
from seaid.identification.drive_estimates import with_values
from seaid.identification.stacked_fits import merged_estimates
from seaid.log import Motion
from seaid.regressor import motor_regressor
from seaid.regressor.regression import spring_regressor
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification.result import Identification

_EXACT_RAD = 1e-7
"""Standard deviation of a motor's encoder offset, seen at the joint, that counts as zero."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The parameters (p,) of a refinement, and the places of each kind.

    `simulated` are the joints behind springs, `unseen` those of them without an encoder behind the
    spring; `actuators` {joint: estimate} are the elastic drives as (7) has them, `drives` {joint:
    places} their parameters, and `load` those of (8), in which drives on one bus have one delay.
    `zeros` are those of encoder offsets, none without. `tested` are terms of springs that the model
    lacks, in the last columns: a torque of the joint by the derivative of this order of its
    deflection, with the factor zero.
    """

    identification: Identification
    parameters: tuple[Parameter, ...]
    simulated: tuple[str, ...]
    unseen: tuple[str, ...]
    actuators: FrozenMapping[Estimate]
    drives: FrozenMapping[IndexArray]
    load: IndexArray
    zeros: slice
    tested: tuple[tuple[str, int], ...] = ()

    @cached_property
    def places(self) -> Mapping[Parameter, int]:
        """The column of each parameter."""
        return {parameter: place for place, parameter in enumerate(self.parameters)}

    @cached_property
    def nonlinear(self) -> Mapping[str, Mapping[str, int]]:
        """The drives whose equations are nonlinear, {joint: {parameter: column}}."""
        known, drives = self.identification.known, {}
        for joint, drive in known.drives.items():
            named = {name: Parameter(name, joint) for name in drive.parameter_names}
            columns = {name: self.places[x] for name, x in named.items() if x in self.places}
            if columns.keys() & {*motor_regressor(known, joint).non_linear}:
                drives[joint] = columns
        return drives

    def tests(self, motion: Motion) -> Iterator[tuple[int, str, Array]]:
        """Yield column, joint, and torque (T,) at the joint per unit of each tested term."""
        known, first = self.identification.known, len(self.parameters) - len(self.tested)
        motors = motion.motor_position, motion.motor_velocity, motion.motor_acceleration
        loads = motion.joint_states
        for column, (joint, order) in enumerate(self.tested, first):
            index, ratio = known.index(joint), total_ratio(known.drives[joint])
            yield column, joint, motors[order][:, index] / ratio - loads[order][:, index]

    @property
    def followed(self) -> tuple[str, ...]:
        """Joints without a spring whose torque is that of the simulated motion.

        Where no encoder is behind a spring, the angles there are part of the estimate: a torque on
        them by the angles of an earlier estimate would be fitted to the noise of that one.
        """
        others = self.identification.model.torque_joints
        return tuple(joint for joint in others if self.unseen and joint not in self.simulated)

    @property
    def sensed(self) -> tuple[str, ...]:
        """Joints with a spring whose torque was measured."""
        return tuple(joint for joint in self.drives if joint not in self.simulated)

    @property
    def others(self) -> tuple[str, ...]:
        """Joints that are neither simulated nor followed, with a torque on the load side."""
        used = (*self.simulated, *self.followed)
        return tuple(x for x in self.identification.model.torque_joints if x not in used)

    @property
    def has_zeros(self) -> bool:
        """Whether encoder offsets are estimated."""
        return bool(self.zeros.stop > self.zeros.start)

    @property
    def start(self) -> Array:
        """The values (p,) of the identification within their bounds, with zero encoder offsets.

        A regression may find positive parameters below zero.
        """
        values = np.zeros(len(self.parameters))
        for joint, places in self.drives.items():
            values[places] = self.actuators[joint].values
        values[self.load] = self.identification.load_side.values
        if self.unseen and self.identification.feasible is not None:
            # an inertia that can be simulated
            consistent = self.identification.base.project(self.identification.robot.parameters)
            values[self.load[: len(consistent)]] = consistent
        # It stands for the zero of the motor's encoder (`layout_of`), whose expectation is zero.
        values[[self.offset(joint) for joint in self.unseen]] = 0.0
        return np.asarray(np.clip(values, *bounds_of(self.parameters)))

    def spring(self, joint: str) -> list[int]:
        """Return the columns of a joint's spring, for a linear one stiffness and offset."""
        names = spring_regressor(self.identification.known, joint).names
        return [self.places[Parameter(name, joint)] for name in names]

    def springs_at(self, x: Array) -> dict[str, Array]:
        """Return the values of the springs whose torque is in (8), at the values x (p,)."""
        return {joint: x[self.spring(joint)] for joint in self.identification.springs}

    def offset(self, joint: str) -> int:
        """Return the column of the offset of a joint's spring."""
        return self.places[Parameter("spring_offset", joint)]

    def with_known(self, known: Robot) -> Layout:
        """Return the layout for a robot with other constants, in what is simulated too."""
        start = self.identification
        bodies = np.nan_to_num(known.parameters - start.known.parameters)
        robot = replace(start.robot, payload_parameters=known.payload_parameters)
        robot = robot.with_values(start.robot.parameters + bodies, robot.drives)
        return replace(self, identification=replace(start, known=known, robot=robot))

    def known_at(self, x: Array) -> Robot:
        """Return the robot whose nonlinear drives are linearised at the values x (p,)."""
        known, drives = self.identification.known, {}
        for joint, columns in self.nonlinear.items():
            values = {name: float(x[column]) for name, column in columns.items()}
            for name in motor_regressor(known, joint).non_linear:
                if parameter_named(name).is_positive and values.get(name, 1.0) <= 0:
                    raise IdentificationError(
                        f"the {readable(ParameterName(name, joint))} would become negative"
                    )
            drives[joint] = with_values(known.drives[joint], values)
        return known.with_drives(drives) if drives else known

    def robot_at(self, x: Array) -> Robot:
        """Return the robot with the bodies of x (p,), and the drives of which (8) has columns."""
        start, load_side = self.identification, x[self.load]
        # The columns of the load side are the base parameters, then the parameters of drives.
        bodies, of_drives = np.split(load_side, [len(start.base.columns)])
        robot, values = start.robot, dict[str, dict[str, float]]()
        for (joint, name, _), value in zip(start.model.drives, of_drives, strict=True):
            values.setdefault(joint, {})[name] = float(value)
        known = start.known.drives
        drives = {joint: with_values(known[joint], named) for joint, named in values.items()}
        # The standard parameters change least (14); a simulation depends on the base ones only.
        correction = start.base.least(bodies - start.base.project(robot.parameters))
        return robot.with_values(robot.parameters + correction, {**robot.drives, **drives})


def layout_of(
    start: Identification, encoder_offset_std: float, unseen: tuple[str, ...] = ()
) -> Layout:
    """Return the parameters of an identification in one vector.

    The spring offset of an `unseen` joint is k r_L times the zero of its motor's encoder, which the
    joint's angle follows: it turns gravity, and is known as well as that zero.
    """
    robot = start.known
    parameters: list[Parameter] = []
    drives: dict[str, IndexArray] = {}
    actuators = {joint: _actuator_part(start, joint) for joint in robot.elastic_joints}
    for joint, estimate in actuators.items():
        first = len(parameters)
        parameters += [Parameter(name, joint) for name in estimate.names]
        drives[joint] = np.arange(first, len(parameters))
        if joint in unseen:
            # F = k r_L dq: the standard deviation of the spring's force by that of the zero dq.
            force = estimate.value("stiffness") * robot.drives[joint].load_radius
            prior = Prior(0.0, abs(force) * max(encoder_offset_std, _EXACT_RAD))
            place = first + estimate.names.index("spring_offset")
            parameters[place] = replace(parameters[place], prior=prior)
    of_load, places = _load_parameters(start)
    load = len(parameters) + places
    parameters += of_load
    first = len(parameters)
    if encoder_offset_std:
        zero = Prior(0.0, encoder_offset_std)
        parameters += [Parameter("encoder_zero", joint, prior=zero) for joint in robot.joint_names]
    return Layout(
        identification=start,
        parameters=tuple(parameters),
        simulated=tuple(joint for joint in start.model.torque_joints if joint in start.springs),
        unseen=unseen,
        actuators=FrozenMapping(actuators),
        drives=FrozenMapping(drives),
        load=load,
        zeros=slice(first, len(parameters)),
    )


def _actuator_part(identification: Identification, joint: str) -> Estimate:
    """Return the parameters of a drive by (7); a parallel spring and joint friction are in (8)."""
    whole = identification.drive_side[joint]
    load = {*map(Parameter.of_column, identification.model.names)}
    return whole.of_names(name for name in whole.names if Parameter(name, joint) not in load)


def _load_parameters(start: Identification) -> tuple[list[Parameter], IndexArray]:
    """Return the parameters of the load side, and the place of that of each column among them.

    A delay that is as stated stays so.
    """
    names, drives = start.model.names, start.known.drives
    parameters, firsts = list(map(Parameter.of_column, names)), np.arange(len(names))
    if start.known.has_controllers:
        # Only a rollout of the whole drive diverges for friction or an inertia below zero.
        parameters = [_positive(parameter) for parameter in parameters]
    for bus in buses_of(drives, names):
        first = bus.places[0]
        firsts[list(bus.places)] = first
        if is_stated(start.load_side.standard_errors[first], bus.std_s):
            prior = Prior(bus.nominal_s, bus.std_s) if bus.std_s else None
            parameters[first] = replace(parameters[first], prior=prior, is_fixed=True)
    kept, places = np.unique(firsts, return_inverse=True)
    return [parameters[place] for place in kept], places


def _positive(parameter: Parameter) -> Parameter:
    """Return a parameter with its bound."""
    kind = PARAMETERS.get(parameter.quantity)
    return replace(parameter, lower=0.0) if kind is not None and kind.is_positive else parameter


# Residuals

MotionChange = Callable[[Motion], Motion]
"""Function of a motion that returns it with other inputs."""


@dataclass(frozen=True, eq=False)
class Outputs(ABC):
    """The residuals of a part of a log at parameters x (p,), and what predicts its outputs."""

    layout: Layout
    x: Array

    @property
    @abstractmethod
    def residuals(self) -> Residuals:
        """The residuals at x, linearised."""

    def moved(self, x: Array, part: float, nuisance: Array) -> Self:
        """Return the residuals at parameters x (p,), after a part of a step."""
        return replace(self, x=x)

    def changed(self, known: Robot, change: MotionChange) -> Self:
        """Return the residuals for a robot with other constants, and a change of the log."""
        return replace(self, layout=self.layout.with_known(known))


LogPoint = Point[Outputs]


def block_means(
    columns: Array, unknown: BoolArray, motion: Motion, windows: int, block: int, free: int
) -> Residuals:
    """Average columns (T, C, 1 + p + s) over blocks, by which white noise stays white.

    They are a residual at the samples of a motion, its derivatives by p parameters, and those by
    s = `free` states of each window. Blocks with a sample that is `unknown` (T, C) or bridged do
    not count, nor does a last part block.
    """
    if motion.bridged is not None:  # what was interpolated over a gap was not measured
        unknown = unknown | motion.bridged[:, None]
    count = len(columns) // (windows * block) * windows * block
    shape = (windows, -1, block, columns.shape[1])
    means = columns[:count].reshape(*shape, columns.shape[2]).mean(axis=2)
    last = columns.shape[2] - free
    return Residuals(
        residual=means[..., 0],
        jacobian=means[..., 1:last],
        nuisance=means[..., last:],
        kept=np.asarray(~unknown[:count].reshape(shape).any(axis=2)),
        time=motion.time[:count].reshape(windows, -1, block).mean(axis=2),
        channels=range(columns.shape[1]),
    )


# From a search to an identification


def identification_at(layout: Layout, x: Array, step: Step) -> Identification:
    """Return the identification with the values x (p,) and the covariance of a step from there."""
    start = layout.identification
    actuators, load_side = _estimates(layout, x, step)
    start = replace(start, known=layout.known_at(x), springs=FrozenMapping(layout.springs_at(x)))
    values = {**start.drive_side, **merged_estimates(actuators, load_side.by_owner())}
    drives = {joint: values[joint] for joint in start.drive_side}
    known = start.known.drives
    estimated = {x: with_values(known[x], y.by_name) for x, y in drives.items()}
    return replace(
        start,
        drive_side=FrozenMapping(drives),
        load=load_side.of_names(start.model.expressions),
        load_side=load_side,
        robot=layout.robot_at(x).with_drives(estimated),
        findings=revalued(start.findings, drives),
        estimator="output-error",
    )


def _estimates(layout: Layout, at: Array, step: Step) -> tuple[dict[str, Estimate], Estimate]:
    """Return the estimates of elastic drives by joint, and of the load side, at values (p,)."""
    covariance, x = step.covariance.copy(), at.copy()
    # Without encoder offsets the prior of `_EXACT_RAD` alone determined these: they are known.
    fixed = [] if layout.has_zeros else [layout.offset(joint) for joint in layout.unseen]
    covariance[fixed], covariance[:, fixed], x[fixed] = 0.0, 0.0, 0.0
    whole = Estimate(
        names=tuple(parameter.name for parameter in layout.parameters),
        values=x,
        covariance=covariance,
        units=("",) * len(x),
        residual_std=float("nan"),
        condition_number=step.condition_number,
        white_standard_errors=np.sqrt(np.diag(step.white_covariance)),
    )

    def part(old: Estimate, places: IndexArray, std: float) -> Estimate:
        new = whole.part(places.tolist(), old.names)
        return replace(new, units=old.units, residual_std=std, diagnostics=old.diagnostics)

    # Channels: s positions, s drives, followed joints; then, of what is not simulated, the drives
    # with a measured spring torque and the joints of (8). Under controllers all are positions.
    first, joints = len(layout.simulated), list(layout.simulated)
    end = 2 * first + len(layout.followed)
    stds = dict(zip(joints, step.stds[first:], strict=False))
    stds |= dict(zip(layout.sensed, step.stds[end:], strict=False))
    drives = {
        joint: part(layout.actuators[joint], places, float(stds[joint]))
        for joint, places in layout.drives.items()
    }
    rest = np.append(step.stds[2 * first : end], step.stds[end + len(layout.sensed) :])
    load_std = float(np.sqrt(np.mean((rest if rest.size else step.stds[:first]) ** 2)))
    return drives, part(layout.identification.load_side, layout.load, load_std)
