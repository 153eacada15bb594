"""Simulation of the joints behind springs: the load side (8), linearised along a motion.

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
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, safely, white_noise
from seaid.drives import Drive, states
from seaid.errors import IdentificationError
from seaid.estimation import Parameter
from seaid.identification.datasets import Dataset, first_motion
from seaid.log import POSITION_BAND, Log, Motion, low_pass, spline_derivatives, with_directions
from seaid.regressor import LoadModel, load_columns, motor_regressor, spring_regressor
from seaid.robot import (
    Robot,
    at_drives,
    at_joints,
    group_of,
    rows_at_drives,
    torques_at_drives,
)

if TYPE_CHECKING:
    from seaid.identification.identification import Identification


@dataclass(frozen=True, eq=False)
class TorqueJacobians:
    """Derivatives of the inverse dynamics by q, v and a along a motion, each (T, n, n)."""

    position: Array
    velocity: Array
    acceleration: Array

    def part(self, torques: list[int], joints: list[int]) -> TorqueJacobians:
        """Return the derivatives of some torques by the states of some joints."""
        rows = np.ix_(range(len(self.position)), torques, joints)
        return TorqueJacobians(self.position[rows], self.velocity[rows], self.acceleration[rows])

    def at_drives(self, transmission: Array) -> TorqueJacobians:
        """Return the derivatives in the coordinates of the drives, C^-T J C^-1."""
        return TorqueJacobians(
            *(
                torques_at_drives(transmission, rows_at_drives(transmission, part))
                for part in (self.position, self.velocity, self.acceleration)
            )
        )

    def plus(self, position: Array, velocity: Array) -> TorqueJacobians:
        """Return the derivatives with constant ones (n, n) added."""
        return TorqueJacobians(
            self.position + position, self.velocity + velocity, self.acceleration
        )

    def change(self, response: Response) -> Array:
        """Return the change of the torques (T, rows, columns) with a response of the joints."""
        return np.asarray(
            self.position @ response.position
            + self.velocity @ response.velocity
            + self.acceleration @ response.acceleration
        )


@dataclass(frozen=True, eq=False)
class Response:
    """Changes of position, velocity and acceleration of the joints, each (T, joints, columns)."""

    position: Array
    velocity: Array
    acceleration: Array


def torque_jacobians(robot: Robot, q: Array, v: Array, a: Array) -> TorqueJacobians:
    """Return the derivatives of the inverse dynamics, payloads included, at states (T, n) each.

    Pinocchio adds inertias of bodies, which needs positive masses, and estimated ones may be
    negative. Torques are linear in the parameters: equal masses are added, and theirs subtracted.
    """
    bodies = (robot.parameters + robot.payload_parameters).reshape(-1, 10)
    if np.all(bodies[:, 0] > 0):
        return TorqueJacobians(*robot.from_model(_derivatives(robot, q, v, a), 2))
    added = np.zeros_like(bodies)
    added[:, 0] = 2.0 * np.max(np.abs(bodies[:, 0]), initial=1.0)
    heavier = robot.with_values(robot.parameters + added.ravel(), robot.drives)
    alone = robot.with_values(added.ravel() - robot.payload_parameters, robot.drives)
    derivatives = _derivatives(heavier, q, v, a) - _derivatives(alone, q, v, a)
    return TorqueJacobians(*robot.from_model(derivatives, 2))


def _derivatives(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return d tau / d (q, v, a) of the model's joints, (3, T, N, N)."""
    model, data = robot.model, robot.model.createData()
    states = (robot.to_model(state, order) for order, state in enumerate((q, v, a)))
    derivatives = np.empty((3, len(q), model.nv, model.nv))
    compute = pin.computeRNEADerivatives
    for t, (q_t, v_t, a_t) in enumerate(zip(*states, strict=True)):
        compute(model, data, q_t, v_t, a_t)
        derivatives[0, t], derivatives[1, t], derivatives[2, t] = data.dtau_dq, data.dtau_dv, data.M
    # Pinocchio fills the upper triangle of M alone.
    upper = np.triu(derivatives[2])
    derivatives[2] = upper + np.swapaxes(np.triu(derivatives[2], 1), 1, 2)
    return derivatives


_RESOLVED = 1.0
"""Square of an oscillation's angle per sample below which samples resolve it."""


def response_to(jacobians: TorqueJacobians, force: Array, step: float, windows: int) -> Response:
    """Integrate M a + C v + K q = force (T, joints, columns) by Newmark's method.

    The joints start each of the equally long `windows` at rest; 2 joints more columns at the end
    are the free motions from a unit of each initial position and velocity. The frequency of an
    undamped oscillation is of fourth order in `step` if the samples resolve it (Fox and Goodwin
    1949), else of second order.
    """
    T, joints, columns = force.shape
    free = 2 * joints
    M, C, K = (
        matrix.reshape(windows, T // windows, joints, joints)
        for matrix in (jacobians.acceleration, jacobians.velocity, jacobians.position)
    )
    force = force.reshape(windows, T // windows, joints, columns)
    force = np.concatenate([force, np.zeros((*force.shape[:3], free))], axis=3)
    # Newmark 1959 with gamma = 1/2: beta = 1/12 is stable for step^2 K / M < 6, beta = 1/4 (the
    # trapezoidal rule) always
    # The norm of M^-1 K is a bound of the squared angular frequencies.
    rates = safely(np.linalg.solve, M, K, what="a simulated motion")
    fastest = step**2 * float(np.max(np.linalg.norm(rates, axis=(2, 3)), initial=0.0))
    beta = 1 / 12 if fastest < _RESOLVED else 1 / 4
    # (M + h/2 C + beta h^2 K) a_t = f_t - C v~ - K q~, with v~ and q~ by the state before.
    matrix = M + step / 2 * C + beta * step**2 * K
    inverse = safely(np.linalg.inv, matrix, what="a simulated motion")
    count = force.shape[1]
    q, v, a = (np.zeros((count, windows, joints, columns + free)) for _ in range(3))
    # The last columns have no force, and start from a unit of position or of velocity.
    q[0, :, :, columns : columns + joints] = np.eye(joints)
    v[0, :, :, columns + joints :] = np.eye(joints)
    a[0] = safely(
        np.linalg.solve,
        M[:, 0],
        force[:, 0] - C[:, 0] @ v[0] - K[:, 0] @ q[0],
        what="a simulated motion",
    )
    for t in range(1, count):
        v_t = v[t - 1] + step / 2 * a[t - 1]
        q_t = q[t - 1] + step * v[t - 1] + (0.5 - beta) * step**2 * a[t - 1]
        a[t] = inverse[:, t] @ (force[:, t] - C[:, t] @ v_t - K[:, t] @ q_t)
        v[t], q[t] = v_t + step / 2 * a[t], q_t + beta * step**2 * a[t]
    shape = (T, joints, columns + free)
    return Response(*(np.swapaxes(part, 0, 1).reshape(shape) for part in (q, v, a)))


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
        drive.values[name] if name in drive.known else estimated.get(f"{name} of {joint}", 0.0)
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


def with_joints(
    motion: Motion, joints: list[int], states: tuple[Array, ...] | list[Array]
) -> Motion:
    """Return the motion with position, velocity and acceleration of some joints replaced."""
    q, v, a = (state.copy() for state in motion.joint_states)
    for whole, part in zip((q, v, a), states, strict=True):
        whole[:, joints] = part
    return replace(
        motion, joint_position=q, joint_velocity=v, joint_acceleration=a, deflection=None
    )


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
    if not robot.has_controllers or robot.floating_base is not None:
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


def check_simultaneous(robot: Robot, springs: Iterable[str]) -> None:
    """Raise IdentificationError for springs that method="simultaneous" cannot share."""
    reason = not_shared(robot, springs)
    if reason:
        raise IdentificationError(
            'method="simultaneous" shares springs of unknown stiffness and offset: '
            f'{reason}; use method="two-step"',
            'method="simultaneous"',
            'method="two-step"',
        )


def not_shared(robot: Robot, springs: Iterable[str]) -> str:
    """Return why (7) and (8) cannot share the springs of some joints, "" if they can."""
    for joint in springs:
        names = set(spring_regressor(robot, joint).names)
        if not {"stiffness", "spring_offset"} <= names <= _LINEAR:
            return f"the spring of {joint} {_kind(robot, joint)}"
    return ""


def check_instruments(robot: Robot, springs: Iterable[str]) -> None:
    """Raise IdentificationError for springs for which instruments cannot be computed."""
    for joint in springs:
        if not set(spring_regressor(robot, joint).names) <= _LINEAR:
            raise IdentificationError(
                f'estimator="iv" supports springs of one stiffness; that of {joint} '
                f'{_kind(robot, joint)}: use estimator="wls"',
                'estimator="iv"',
                'estimator="wls"',
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
    if drive.controller is not None:
        alone = all(x.controller is not None for x in robot.drives.values())
        if drive.is_elastic or not alone:
            return "whose command was logged: all drives have to be stiff, with a position command"
        if motor_regressor(robot, joint).non_linear:
            return "whose equation is not linear in its parameters"
    elif drive.motor_input != "torque":
        return f"of which the {drive.motor_input} was logged, not the torque"
    if "load" in drive.friction and not drive.is_elastic:
        return "whose friction grows with the load"
    return ""


def _not_unseen(robot: Robot, joint: str, drive: Drive) -> str:
    if len(group_of(robot.transmission, robot.index(joint))) > 1:
        return "whose motor turns several joints, and no sensor is behind its spring"
    if drive.parallel_spring or drive.joint_friction:
        return "which has a parallel spring or joint friction and no sensor behind its spring"
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
