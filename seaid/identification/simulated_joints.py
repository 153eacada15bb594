"""Simulation of joints behind springs and under controllers: (8) linearised along a motion.

`driven_motion` is the motion of the joints by the fitted model when the motors turn as measured.
The motor encoder sees the joint through a gear, so that its noise is small there; noise of the
joint encoders enters the motion only by the initial state of each window. Instruments for (8)
need this: acceleration and gravity without the noise of the measured columns and the deflection.

Hysteresis of springs and dry friction of joints, which are sharp, are corrections {joint: (T, 1 +
p)} of what the equations of the drives have at the samples of the simulated motion: of the torque
at the joint, and of its derivatives by the parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from seaid._arrays import Array, safely, white_noise
from seaid.drives import PARAMETERS, Drive, ParameterName, groups_of, states
from seaid.errors import IdentificationError, listed
from seaid.estimation import Parameter, Point, Prior, Residuals, bounds_of, buses_of, is_stated
from seaid.identification.datasets import Dataset, first_motion
from seaid.identification.drive_estimates import with_values
from seaid.log import (
    OF_CONTROLLERS,
    POSITION_BAND,
    Log,
    Motion,
    commanded_part,
    low_pass,
    reconstruct_motion,
    relative_supply,
    spline_derivatives,
    stretches,
    usable,
    with_directions,
)
from seaid.regressor import (
    LoadModel,
    drive_torques,
    load_columns,
    motor_regressor,
    spring_regressor,
)
from seaid.robot import Robot, at_drives, at_joints, check_held, group_of
from seaid.simulation import (
    Response,
    TorqueJacobians,
    response_to,
    rollout,
    torque_jacobians,
    with_joints,
)

if TYPE_CHECKING:
    from seaid.identification.result import Identification
    from seaid.identification.sensitivity import Constant


_START_BAND = 0.5
"""The first linearisation is about joint positions with this part of the cutoff."""

_WINDOW_PERIODS = 5.0
"""Length of a window in periods of the cutoff, over which model errors accumulate."""

_SWEEPS = 2

_PARALLEL = ("parallel_stiffness", "joint_viscous_friction")
"""Stiffness and damping between a joint's bodies, parallel to its drive."""

_RUNAWAY = 1e12
"""Response to a unit of initial position or velocity above which the simulation diverges."""

_DIVERGED = (
    "the fitted model diverges when it is driven by the measured motors: the encoders are too "
    "coarse for this cutoff; lower cutoff_hz, or use estimator='wls'"
)


def driven_motion(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array], load_side: Array
) -> Motion:
    """Return the motion with its joints simulated from the motors by the fitted model (8).

    `springs` {joint of the model: its spring's values} are simulated, `load_side` (p,) has the
    values of the columns of `model`; stiff joints follow the encoder with less noise, and the motor
    side stays as measured. The initial state of each window is a least-squares fit to the joint
    encoders below the cutoff. Raises IdentificationError if the simulation diverges, with a
    deviation larger than the range of the motion.
    """
    names = [joint for joint in model.torque_joints if joint in springs]
    if not names:
        return finer_side(robot, motion)
    joints = list(map(robot.index, names))
    rows = list(map(model.torque_joints.index, names))
    fitted = fitted_robot(robot, model, load_side)
    # k r_L^2 and c r_L^2 at the joint, (4b).
    lever = np.array([robot.drives[joint].load_radius ** 2 for joint in names])
    linear = [linear_spring(robot, joint, springs[joint]) for joint in names]
    rate, damping = lever * np.transpose([(x.stiffness, x.damping) for x in linear])
    parallel = [_parallel_matrix(robot, model, load_side, name) for name in _PARALLEL]
    turned = at_drives(robot.transmission, motion.joint_position)
    reading = low_pass(turned[:, joints], motion.rate_hz, motion.cutoff_hz)
    simulated = smoothed(_turned(finer_side(robot, motion), robot.transmission, at_drives), joints)
    periods = (motion.time[-1] - motion.time[0]) * motion.cutoff_hz
    windows = max(1, int(periods / _WINDOW_PERIODS)) if np.isfinite(periods) else 1
    for _ in range(_SWEEPS):
        with np.errstate(all="ignore"):
            moved = _turned(simulated, robot.transmission, at_joints)
            torque, payload, H, _ = load_columns(robot, moved, model, springs)
            residual = (torque - payload - H @ load_side)[:, rows]
            jacobians = torque_jacobians(fitted, *moved.joint_states).plus(*parallel)
            inside = jacobians.at_drives(robot.transmission).part(joints, joints)
            # The motors are given: a spring, with its damping, pulls as one to a fixed point.
            inside = inside.plus(np.diag(rate), np.diag(damping))
            response = _response(inside, residual, 1 / motion.rate_hz, windows)
        simulated = _moved(simulated, joints, response, reading, windows)
    return _turned(simulated, robot.transmission, at_joints)


def finer_side(robot: Robot, motion: Motion) -> Motion:
    """Return the motion with stiff joints from the encoder with less acceleration noise."""
    q, v, a = (at_drives(robot.transmission, state).copy() for state in motion.joint_states)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if drive.is_elastic:
            continue
        if np.std(motion.motor_acceleration[:, index]) < drive.ratio * np.std(a[:, index]):
            turned = motion.motor_position[:, index] / drive.ratio
            # The encoder of the joint gives the mean, that of the motor the motion.
            q[:, index] = turned + np.mean(q[:, index] - turned)
            v[:, index] = motion.motor_velocity[:, index] / drive.ratio
            a[:, index] = motion.motor_acceleration[:, index] / drive.ratio
    finer = replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a)
    return _turned(finer, robot.transmission, at_joints)


def _turned(motion: Motion, matrix: Array, to: Callable[[Array, Array], Array]) -> Motion:
    """Return the motion with its joints in the coordinates of the drives, or back."""
    q, v, a = (to(matrix, state) for state in motion.joint_states)
    return replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a)


def fitted_robot(robot: Robot, model: LoadModel, load_side: Array) -> Robot:
    """Return a robot with the estimated base parameters; it does not matter which one."""
    base, prior = model.base, np.zeros(robot.parameters.size)
    prior[::10] = 1.0
    prior[robot.is_known] = robot.parameters[robot.is_known]
    residual = load_side[: len(base.columns)] - base.project(prior)
    return robot.with_values(prior + base.least(residual), robot.drives)


def with_base_parameters(start: Identification, load_side: Array) -> Robot:
    """Return the identified robot with the base parameters of the load side (p,).

    Its standard parameters change least (14); a simulation depends on the base parameters only.
    """
    base, robot = start.base, start.robot
    correction = base.least(load_side[: len(base.columns)] - base.project(robot.parameters))
    return robot.with_values(robot.parameters + correction, robot.drives)


def _parallel_matrix(robot: Robot, model: LoadModel, load_side: Array, name: str) -> Array:
    """Return a parameter of the parallel elements, known or estimated, as a matrix (n, n)."""
    estimated = dict(zip(model.names, load_side, strict=True))
    values = [
        drive.values[name]
        if name in drive.known
        else estimated.get(ParameterName(name, joint), 0.0)
        for joint, drive in robot.drives.items()
    ]
    return np.diag(values)


def smoothed(motion: Motion, joints: list[int]) -> Motion:
    """Return the motion with some joints low-passed, for the linearisation."""
    band = _START_BAND * motion.cutoff_hz
    smooth = low_pass(motion.joint_position[:, joints], motion.rate_hz, band)
    return with_joints(motion, joints, spline_derivatives(motion.time, smooth))


def _response(inside: TorqueJacobians, force: Array, step: float, windows: int) -> Response:
    """Return the response (T, joints, 1 + 2 joints) to a force (T, joints), by windows."""
    extra = -len(force) % windows
    padded = [
        np.pad(part, ((0, extra), *[(0, 0)] * (part.ndim - 1)), mode="edge")
        for part in (inside.position, inside.velocity, inside.acceleration, force)
    ]
    response = response_to(TorqueJacobians(*padded[:3]), padded[3][:, :, None], step, windows)
    count = len(force)
    return Response(
        response.position[:count], response.velocity[:count], response.acceleration[:count]
    )


def _moved(
    motion: Motion, joints: list[int], response: Response, reading: Array, windows: int
) -> Motion:
    """Return the motion after a sweep, each joint in its own scale, and its initial states."""
    if not all(np.all(np.abs(part) < _RUNAWAY) for part in vars(response).values()):
        raise IdentificationError(_DIVERGED, "estimator='wls'")
    spread = np.std(reading, axis=0)
    scale = 1 / np.where(spread > 0, spread, 1.0)
    # reading = q + dq + Phi s: the initial states s of each window, by least squares.
    residual = scale * (reading - motion.joint_position[:, joints] - response.position[:, :, 0])
    free = scale[:, None] * response.position[:, :, 1:]
    # Rounded up, as `_response` pads the last window.
    length = -(-len(reading) // windows)
    coefficients = np.empty((len(reading), 1 + free.shape[2]))
    coefficients[:, 0] = 1.0
    for start in range(0, len(reading), length):
        window = slice(start, start + length)
        columns = free[window].reshape(-1, free.shape[2])
        coefficients[window, 1:] = safely(
            np.linalg.lstsq,
            columns,
            residual[window].ravel(),
            what="the initial states of a simulated motion",
            rcond=None,
        )[0]
    changes = [
        np.einsum("tjc,tc->tj", part, coefficients)
        for part in (response.position, response.velocity, response.acceleration)
    ]
    states = [
        state[:, joints] + change
        for state, change in zip(motion.joint_states, changes, strict=True)
    ]
    if np.any(np.max(np.abs(states[0] - reading), axis=0) > np.ptp(reading, axis=0)):
        raise IdentificationError(_DIVERGED, "estimator='wls'")
    return with_joints(motion, joints, states)


def with_hysteresis(robot: Robot, joints: Sequence[str]) -> list[str]:
    """Return those of the joints whose spring has a law of hysteresis."""
    return [joint for joint in joints if "dahl" in robot.drives[joint].spring]


def hysteresis_corrections(
    robot: Robot,
    joints: Sequence[str],
    motion: Motion,
    measured: Motion,
    columns: Mapping[Parameter, int],
    x: Array,
) -> dict[str, Array]:
    """Return the corrections of springs at parameters x (p,).

    The states are those along the `measured` motion, which begins before the simulated one and ends
    with it, in place of those along the simulated `motion`, which are zero at its first sample. The
    simulated joint has the noise of the inputs, amplified by the spring, and a law adds up what its
    argument travels: along it widths were 1 % large, two to four standard errors, and a third of
    the iterations did not end (`scripts/benchmarks/hysteresis.py --refine`). `columns`
    {parameter: place in x}.
    """
    corrections, length = {}, len(motion.time)
    for joint in with_hysteresis(robot, joints):
        drive = robot.drives[joint]
        place = columns.get(Parameter("hysteresis_deflection", joint))
        width = drive.values["hysteresis_deflection"]
        measured_states, simulated_states = (
            np.array(states(_deflection(robot, path, joint), width))[:, -length:]
            for path in (measured, motion)
        )
        state, by_width = drive.load_radius * (measured_states - simulated_states)
        force, corrections[joint] = _linear(robot, joint, "hysteresis_force", state, columns, x)
        if place is not None:
            corrections[joint][:, 1 + place] = force * by_width
    return corrections


def friction_corrections(
    robot: Robot, joints: Sequence[str], motion: Motion, columns: Mapping[Parameter, int], x: Array
) -> tuple[dict[str, Array], Array]:
    """Return the corrections of dry friction, and its slopes (T, joints) by the joint's speed.

    It is the mean about a sample of c sign(v), with v linear in time. Its slope lets a reversal
    move; with the sign at the samples alone bodies were 1.5 to 5 times worse.
    """
    torques, slopes = {}, np.zeros((len(motion.time), len(joints)))
    for row, joint in enumerate(joints):
        if "coulomb" not in robot.drives[joint].joint_friction:
            continue
        index = robot.index(joint)
        speed = motion.joint_velocity[:, index]
        # v goes from v - s to v + s about a sample: the mean of sign(v), clip(v / s, -1, 1), takes
        # the place of the sign(v) in the columns of (8).
        swept = 0.5 * np.abs(motion.joint_acceleration[:, index]) / motion.rate_hz
        swept = np.maximum(swept, _LEAST_RAD_S)
        change = np.sign(speed) - np.clip(speed / swept, -1.0, 1.0)
        level, torques[joint] = _linear(robot, joint, "joint_coulomb_friction", change, columns, x)
        slopes[:, row] = np.where(np.abs(speed) < swept, level / swept, 0.0)
    return torques, slopes


_LEAST_RAD_S = 1e-12
"""Change of speed from a sample to the next that counts as none."""


def _linear(
    robot: Robot, joint: str, name: str, unit: Array, columns: Mapping[Parameter, int], x: Array
) -> tuple[float, Array]:
    """Return the value of a parameter, and the corrections by the torque (T,) of a `unit` of it."""
    place = columns.get(Parameter(name, joint))
    value = robot.drives[joint].values[name] if place is None else float(x[place])
    correction = np.zeros((len(unit), 1 + len(x)))
    correction[:, 0] = value * unit
    if place is not None:
        correction[:, 1 + place] = unit
    return value, correction


def _deflection(robot: Robot, motion: Motion, joint: str) -> Array:
    index, drive = robot.index(joint), robot.drives[joint]
    turned = drive.motor_radius / drive.ratio * motion.motor_position[:, index]
    return np.asarray(turned - drive.load_radius * motion.joint_position[:, index])


def with_encoder_noise(
    robot: Robot, motion: Motion, logs: Sequence[Log], rng: np.random.Generator
) -> Motion:
    """Return a measured motion whose joint positions have the noise of both encoders once more."""
    noise = np.zeros_like(motion.joint_position)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        at_joint = drive.motor_radius / drive.ratio / drive.load_radius
        noise[:, index] = max(
            np.hypot(
                at_joint * white_noise(log.motor_position[:, index]),
                white_noise(log.joint_position[:, index]),
            )
            for log in logs
        )
    noise = noise * rng.normal(size=noise.shape)
    noise = low_pass(noise, motion.rate_hz, POSITION_BAND * motion.cutoff_hz)
    return replace(motion, joint_position=motion.joint_position + noise)


_POSES = 20
"""Poses of a motion in which the inertia at a joint is computed."""

_LEVELS = ("coulomb_friction", "stribeck_friction")


def with_passed_reversals(robot: Robot, datasets: Sequence[Dataset], known: Robot) -> list[Dataset]:
    """Return the datasets of a robot whose joints may stick where a first estimate lets them.

    Motions that are read in pieces keep all of their reversals excluded.
    """
    if not robot.has_controllers or not robot.base_is_held:
        return list(datasets)
    dry = _dry_accelerations(known, first_motion(datasets[0]))
    return [with_directions(robot, x, dry) if isinstance(x, Motion) else x for x in datasets]


def _dry_accelerations(robot: Robot, motion: Motion) -> dict[str, float]:
    """Return the motor acceleration of dry friction alone, {joint: level / inertia}.

    The inertia I + M / N^2 is that of rotor and joint, whose other joints move as they do.
    """
    poses = np.linspace(0, len(motion.time) - 1, _POSES).astype(int)
    states = [state[poses] for state in motion.joint_states]
    jacobians = torque_jacobians(robot, *states).at_drives(robot.transmission)
    inertia = np.median(np.einsum("tii->ti", jacobians.acceleration), axis=0)
    accelerations = {}
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        values = drive.values
        level = sum(abs(values.get(name, 0.0)) for name in _LEVELS)
        load = 0.0 if drive.is_elastic else float(inertia[index]) / drive.ratio**2
        total = values.get("motor_inertia", 0.0) + load
        if level > 0 and total > 0:
            accelerations[joint] = level / total
    return accelerations


_LINEAR = {"stiffness", "spring_damping", "spring_offset"}


@dataclass(frozen=True)
class LinearSpring:
    """A spring with stiffness, damping and an offset."""

    stiffness: float
    offset: float
    damping: float


def linear_spring(robot: Robot, joint: str, values: Iterable[float]) -> LinearSpring:
    """Return a spring with its known and its estimated values, in the order of its regressor."""
    estimated = dict(zip(spring_regressor(robot, joint).names, values, strict=True))
    drive = robot.drives[joint]
    known = {name: drive.values[name] for name in drive.known if name in _LINEAR}
    known |= {name: float(value) for name, value in estimated.items()}
    names = ("stiffness", "spring_offset", "spring_damping")
    return LinearSpring(*(known.get(name, 0.0) for name in names))


@dataclass(frozen=True)
class Limits:
    """What a method that goes on from two steps cannot do.

    `why` it needs a base that is held. Springs have the parameters `needed`, and are linear: `what`
    says so, and `instead` is the option for others.
    """

    option: str
    instead: str
    why: str
    needed: frozenset[str]
    what: str

    def reason(self, robot: Robot, springs: Iterable[str]) -> str:
        """Return which of the springs the method cannot have, "" if it can have all."""
        for joint in springs:
            if not self.needed <= {*spring_regressor(robot, joint).names} <= _LINEAR:
                return f"the spring of {joint} {_kind(robot, joint)}"
        return ""

    def check(self, robot: Robot, springs: Iterable[str]) -> None:
        """Raise IdentificationError for a floating base, and for springs that are refused."""
        check_held(robot, self.option, IdentificationError, why=self.why)
        if reason := self.reason(robot, springs):
            options = self.option, self.instead
            raise IdentificationError(
                f"{self.option} {self.what}: {reason}; use {self.instead}", *options
            )

    def check_alone(self, robot: Robot) -> None:
        """Raise IdentificationError for drives that share parameters."""
        if groups := groups_of(robot.drives):
            raise IdentificationError(
                f"{self.option} estimates each drive alone, and drives share parameters "
                f'({listed(groups)}): use method="two-step" with a linear estimator, or remove '
                "the groups (shared = ... in the drives file, share=)",
                self.option,
            )

    def refuse_unseen(self, joints: Sequence[str]) -> NoReturn:
        """Raise IdentificationError for joints without encoder, where the method does nothing."""
        raise IdentificationError(
            f"{self.option} needs the joint position of each spring, and the logs have none of "
            f"{listed(joints)}: these springs are found by a refinement that simulates the motors, "
            f"whatever the first estimate is; remove {self.option}, or log the joint position",
            self.option,
        )


AT_ONCE = Limits(
    option='method="simultaneous"',
    instead='method="two-step"',
    why="without contact forces each equation has the deflections of several springs",
    needed=frozenset({"stiffness", "spring_offset"}),
    what="shares springs of unknown stiffness and offset",
)

BY_INSTRUMENTS = Limits(
    option='estimator="iv"',
    instead='estimator="wls"',
    why="its instruments are a simulation, and seaid does not simulate contacts",
    needed=frozenset(),
    what="supports springs of one stiffness",
)


def check_refinable(robot: Robot, unseen: Iterable[str] = ()) -> None:
    """Raise IdentificationError for terms of drives that `refine` does not simulate.

    The joints `unseen` have no sensor behind their springs, which have to be linear then.
    """
    for joint, drive in robot.drives.items():
        reason = _not_refinable(robot, joint, drive) or (
            _not_unseen(robot, joint, drive) if joint in unseen else ""
        )
        if reason:
            raise IdentificationError(
                f"the refinement cannot simulate the drive of {joint}, {reason}; use the result of "
                "identify"
            )


def _not_refinable(robot: Robot, joint: str, drive: Drive) -> str:
    if drive.shared:
        return f"which shares parameters with others ('{drive.shared}'): it moves those of each"
    if drive.controller is not None:
        alone = all(x.controller is not None for x in robot.drives.values())
        if drive.is_elastic or not alone:
            return "whose command was logged: all drives have to be stiff, with a position command"
        if any((motor_regressor(robot, joint).non_linear, robot.angle_ratios)):
            return "whose equation is not linear in its parameters, or has a ratio of its angle"
    elif drive.motor_input != "torque":
        return f"of which the {drive.motor_input} was logged, not the torque"
    if "load" in drive.friction and not drive.is_elastic:
        return "whose friction grows with the load"
    return ""


def _not_unseen(robot: Robot, joint: str, drive: Drive) -> str:
    if len(group_of(robot.transmission, robot.index(joint))) > 1:
        return "whose motor turns several joints, and no sensor is behind its spring"
    if any((drive.parallel_spring, drive.joint_friction, drive.angle_ratio)):
        return "which has a parallel spring or joint friction, or angle_ratio, and no sensor behind"
    if motor_regressor(robot, joint).non_linear or "load" in drive.friction:
        return "whose equation is not linear in its parameters, without a sensor behind its spring"
    names = set(spring_regressor(robot, joint).names)
    if not {"stiffness", "spring_offset"} <= names <= _LINEAR:
        return f"whose spring {_kind(robot, joint)} and no sensor behind it"
    return ""


def _kind(robot: Robot, joint: str) -> str:
    """Describe the terms of a spring other than unknown stiffness and offset."""
    regressor, drive = spring_regressor(robot, joint), robot.drives[joint]
    others = [name.replace("_", " ") for name in regressor.names if name not in _LINEAR]
    if others:
        return f"has {', '.join(others)}"
    if "spring_damping" in regressor.names:
        return "has damping"
    return f"has a known {' and '.join(name.replace('_', ' ') for name in drive.known)}"


# Joints that follow commands under their own controllers: the residuals of `refine`. A rollout
# is that of `replay`, in which dry friction sticks; its sensitivities are those of the load side
# (8), linearised along it, with the gains of the controllers as stiffness and damping.

STEP_S = 2.5e-3
"""Longest step [s] of a rollout: a hundredth of the period of a loop of 4 Hz; the error of the last
digits is far below that of a model."""

_BLOCK_S = 0.02
"""Length [s] of the averages that are compared: 25 Hz is above the bandwidth of these loops."""

_WINDOW_S = 20.0
"""Longest part of a log [s] in one rollout, whose sensitivities are in memory."""

_TRANSIENT_S, _DECAYS = 0.2, 4.0
"""Excluded start of a rollout, whose first speed is noisy: 0.2 s and four times K_d / K_p."""

_REST, _HOLD = 2e-3, 50.0
"""Part of the highest speed below which a joint counts as sticking, and the damping of its
sensitivity: this times the inertia over the step."""

_NUDGE = 1e-4


@dataclass(frozen=True, eq=False)
class Commands:
    """The parameters (f,) of a refinement; drives on one bus share that of their delay.

    `spread` (p, f) @ x are the values of the load side.
    """

    identification: Identification
    parameters: tuple[Parameter, ...]
    spread: Array

    @property
    def start(self) -> Array:
        """The values (f,) of the identification within their bounds.

        A regression may find positive parameters below zero.
        """
        first = np.argmax(self.spread, axis=0)
        values = self.identification.load_side.values[first]
        return np.asarray(np.clip(values, *bounds_of(self.parameters)))


@dataclass(frozen=True, eq=False)
class CommandedLog:
    """The residuals of a window of a log, which its commands drive at parameters x (f,).

    `log` is on regular samples, and its rollouts replace the joints of `motion`.
    """

    commands: Commands
    log: Log
    motion: Motion
    x: Array

    @cached_property
    def residuals(self) -> Residuals:
        """The residuals of the joint positions."""
        return _residuals(self.commands, self.log, self.motion, self.x)

    def moved(self, x: Array, part: float, nuisance: Array) -> CommandedLog:
        """Return the residuals at parameters x (f,)."""
        return replace(self, x=x)

    def with_constant(self, constant: Constant) -> CommandedLog:
        """Return the residuals with a constant changed, in what is known and what is simulated."""
        start, changed = self.commands.identification, constant.robot
        bodies = np.nan_to_num(changed.parameters - start.known.parameters)
        robot = replace(start.robot, payload_parameters=changed.payload_parameters)
        robot = robot.with_values(start.robot.parameters + bodies, robot.drives)
        start = replace(start, known=changed, robot=robot)
        return replace(self, commands=replace(self.commands, identification=start))


def commanded_point(start: Identification, logs: Sequence[Log]) -> Point[CommandedLog]:
    """Return the point of a search at the values of an identification."""
    commands = _commands(start)
    windows = []
    for log in logs:
        for stretch in stretches(usable(log), 1.0):
            count = max(1, int(np.ceil((stretch.time[-1] - stretch.time[0]) / _WINDOW_S)))
            edges = np.linspace(stretch.time[0], stretch.time[-1], count + 1)
            windows += [_window(start, stretch.between(a, b)) for a, b in pairwise(edges)]
    x = commands.start
    residuals = tuple(CommandedLog(commands, log, motion, x) for log, motion in windows)
    return Point(commands.parameters, x, residuals)


def _commands(start: Identification) -> Commands:
    """Return the parameters of an identification; a delay that is as stated stays so."""
    side = start.load_side
    parameters = [_parameter(name) for name in side.names]
    spread = np.eye(len(parameters))
    shared: list[int] = []
    for bus in buses_of(start.known.drives, side.names):
        first, *others = bus.places
        spread[others, first] = 1.0
        shared += others
        if is_stated(side.standard_errors[first], bus.std_s):
            prior = Prior(bus.nominal_s, bus.std_s) if bus.std_s else None
            parameters[first] = replace(parameters[first], prior=prior, is_fixed=True)
    kept = [place for place in range(len(parameters)) if place not in shared]
    return Commands(start, tuple(parameters[place] for place in kept), spread[:, kept])


def _parameter(column: str) -> Parameter:
    """Return the parameter of a column of the load side, with its bound."""
    parameter = Parameter.of_column(column)
    kind = PARAMETERS.get(parameter.quantity)
    is_positive = kind is not None and kind.is_positive
    return replace(parameter, lower=0.0) if is_positive else parameter


def _window(identification: Identification, log: Log) -> tuple[Log, Motion]:
    """Return a window on regular samples, with the motion that its rollouts replace."""
    robot = identification.known
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    motion = reconstruct_motion(robot, log, min(3 * identification.cutoff_hz, rate_hz / 8))
    columns = [log.joint_names.index(joint) for joint in robot.joint_names]

    def sampled(values: Array) -> Array:
        signals = [np.interp(motion.time, log.time, values[:, column]) for column in columns]
        return np.column_stack(signals)

    unknown = np.full((len(motion.time), robot.n), np.nan)
    regular = Log(
        time=motion.time,
        joint_names=robot.joint_names,
        joint_position=sampled(log.joint_position),
        motor_position=unknown,
        motor_torque=unknown,
        is_prismatic=robot.is_prismatic,
    )
    sensors = log.sensors()
    sent: dict[str, Any] = {x: sampled(sensors[x]) for x in OF_CONTROLLERS if x in sensors}
    return replace(regular, **sent), motion


def _robot_at(start: Identification, load_side: Array) -> Robot:
    """Return the robot with the values (p,) of the load side."""
    robot, values = with_base_parameters(start, load_side), dict[str, dict[str, float]]()
    # The columns of the load side are the base parameters, then the parameters of drives.
    of_drives = load_side[len(start.base.columns) :].tolist()
    for (joint, name, _), value in zip(start.model.drives, of_drives, strict=True):
        values.setdefault(joint, {})[name] = value
    known = start.known.drives
    drives = {joint: with_values(known[joint], named) for joint, named in values.items()}
    return robot.with_drives(drives)


def _residuals(commands: Commands, log: Log, motion: Motion, x: Array) -> Residuals:
    """Return the residuals of a window."""
    load_side = commands.spread @ x
    robot = _robot_at(commands.identification, load_side)
    moved = rollout(robot, log, longest_closed_s=STEP_S)
    if not np.all(np.isfinite(moved.joint_position)):
        raise IdentificationError("the simulation diverges")
    motion = _motion_of(robot, motion, moved)
    sensitivity = _sensitivity(commands.identification, robot, motion, log, load_side)
    error = (log.joint_position - moved.joint_position)[..., None]
    # The residual is measured less simulated: its derivatives are minus the sensitivities.
    columns = np.concatenate([error, -sensitivity @ commands.spread], axis=2)
    block = max(1, round(_BLOCK_S * (len(log.time) - 1) / float(np.ptp(log.time))))
    count = len(log.time) // block
    means = columns[: count * block].reshape(count, block, *columns.shape[1:]).mean(axis=1)
    time = log.time[: count * block].reshape(count, block).mean(axis=1)
    late = time - log.time[0] > min(_transient_s(robot), 0.25 * np.ptp(log.time))
    if motion.bridged is not None:  # what was interpolated over a gap was not measured
        late &= ~np.any(motion.bridged[: count * block].reshape(count, block), axis=1)
    return Residuals(
        residual=means[None, ..., 0],
        jacobian=means[None, ..., 1:],
        nuisance=np.zeros((1, count, robot.n, 0)),
        kept=np.broadcast_to(late[None, :, None], (1, count, robot.n)).copy(),
        time=time[None],
        channels=range(robot.n),
    )


def _transient_s(robot: Robot) -> float:
    """Return the excluded start of a rollout [s]."""
    laws = [drive.law for drive in robot.drives.values() if drive.law is not None]
    decays = [
        law.velocity_gain_Nms_per_rad / law.position_gain_Nm_per_rad
        for law in laws
        if law.position_gain_Nm_per_rad
    ]
    return _TRANSIENT_S + _DECAYS * max(decays, default=0.0)


def _motion_of(robot: Robot, motion: Motion, moved: Log) -> Motion:
    """Return the motion of a rollout."""
    q, v, a = spline_derivatives(moved.time, moved.joint_position)
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    return replace(
        motion,
        joint_position=q,
        joint_velocity=v,
        joint_acceleration=a,
        motor_position=ratio * q,
        motor_velocity=ratio * v,
        motor_acceleration=ratio * a,
        motor_direction=None,
        motor_torque=moved.motor_torque
        / [robot.drives[x].scale_of_gains for x in robot.joint_names],
    )


def _sensitivity(
    identification: Identification, robot: Robot, motion: Motion, log: Log, x: Array
) -> Array:
    """Return the derivative (T, n, p) of the positions of a rollout by the load side x (p,)."""
    known, model = identification.known, identification.model
    names = model.torque_joints
    order = [robot.index(joint) for joint in names]
    _, _, H, _ = load_columns(known, motion, model, {})
    unchanged = drive_torques(known, motion, model, {}, x)
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    slopes = []
    for field in ("position", "velocity", "acceleration"):
        # Torques of drives depend on their own joint: one nudge of all gives the diagonal slopes.
        changes = {
            f"joint_{field}": getattr(motion, f"joint_{field}") + _NUDGE,
            f"motor_{field}": getattr(motion, f"motor_{field}") + _NUDGE * ratio,
        }
        torque = drive_torques(known, replace(motion, **changes), model, {}, x)
        slopes.append((unchanged - torque) / _NUDGE)
    jacobians = torque_jacobians(robot, *motion.joint_states).part(order, order)
    gains = _gains(robot, names, motion, log)
    diagonal = np.eye(len(order))
    M = jacobians.acceleration + slopes[2][..., None] * diagonal
    fastest = np.max(np.abs(motion.joint_velocity[:, order]), axis=0)
    rests = np.abs(motion.joint_velocity[:, order]) < _REST * fastest
    inertia = np.einsum("tii->ti", M)
    # A joint that sticks does not respond: no force on it, and a damping of `_HOLD` times the
    # inertia over the step, which stops it within a sample.
    held = np.where(rests, _HOLD * inertia * motion.rate_hz, slopes[1] * ~rests)
    C = jacobians.velocity + (held + gains[1])[..., None] * diagonal
    K = jacobians.position + (slopes[0] + gains[0])[..., None] * diagonal
    inside = replace(jacobians, position=K, velocity=C, acceleration=M)
    # M dq'' + C dq' + K dq = -H dx: the torque that a parameter takes is not there for the motion.
    force = np.where(rests[..., None], 0.0, -H)
    response = response_to(inside, force, 1 / motion.rate_hz, 1).position[:, :, : H.shape[2]]
    whole = np.zeros((len(response), robot.n, H.shape[2]))
    whole[:, order] = response
    return whole


def _gains(robot: Robot, names: Sequence[str], motion: Motion, log: Log) -> tuple[Array, Array]:
    """Return K_p and K_d (T, n) of the controllers, zero where the torque is at its limit."""
    gains = np.zeros((2, len(motion.time), len(names)))
    for column, joint in enumerate(names):
        drive, index = robot.drives[joint], robot.index(joint)
        law = drive.law
        assert law is not None
        late = motion.time - (drive.command_delay_s or 0.0)
        commanded = commanded_part(robot, log.time, log.sensors(), index, is_scaled=True)
        states = motion.joint_position[:, index], motion.joint_velocity[:, index]
        supply = relative_supply(robot, log.time, log.sensors(), index)
        is_free = ~law.torque(np.interp(late, log.time, commanded), *states, supply)[1]
        factor = law.gain_factor(supply) * is_free
        gains[0, :, column] = law.position_gain_Nm_per_rad * factor
        gains[1, :, column] = law.velocity_gain_Nms_per_rad * factor
    return gains[0], gains[1]
