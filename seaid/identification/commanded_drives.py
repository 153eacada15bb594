"""Drives whose position command was logged: their delays, and the residual block of their loop.

Delays: one for all drives of a bus, and only where the log determines it. With one gain set a delay
T adds (K_d + F_v) T to the rotor inertia at the joint and K_p T to the viscous friction, to first
order. What is left to tell them apart is often less than the errors of the model; the delay is then
as stated, and its uncertainty in all intervals.

The block: the model follows the commands under its own controllers, from the first state of each
log, and the measured joint positions are compared with its own. A rollout is that of `replay`, in
which dry friction sticks; its sensitivities are those of the load side (8), linearised along it,
with the gains of the controllers as stiffness and damping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, safely
from seaid._files import toml_table
from seaid.drives import (
    DELAY_PARAMETER,
    NORMAL_95,
    PARAMETERS,
    Bus,
    Drive,
    buses_of,
    is_stated,
)
from seaid.errors import IdentificationError
from seaid.estimation import Estimate, FittedRows, Parameter, Point, Prior, Residuals, bounds_of
from seaid.identification.drive_estimates import with_values
from seaid.identification.simulated_joints import (
    response_to,
    torque_jacobians,
    with_base_parameters,
)
from seaid.log import (
    OF_CONTROLLERS,
    Log,
    Motion,
    commanded_part,
    reconstruct_motion,
    relative_supply,
    spline_derivatives,
    stretches,
    usable,
)
from seaid.regressor import Regression, load_columns
from seaid.robot import Robot
from seaid.simulation import rollout

if TYPE_CHECKING:
    from seaid.identification.identification import Identification

# Delays

MOST_DELAY_ROUNDS = 3
"""Most repetitions with commands delayed by the estimate: the error of one is of its square."""

_DELAY_S = 2e-4
"""Change of a delay [s] below which its linearisation has converged."""

_ROUNDING_S = 1e-7
"""Difference [s] of the delays of one bus by rounding; drives stay on one by equal delays."""

_SCALE = 0.01
"""Relative change of the scale of gains below which the slope by the delay has converged."""

LARGEST_DELAY_S = 0.25
"""Largest delay of a command [s] for which the linearisation is tried."""

_FREE = 1e-8
"""Part of a variance that stays to a direction with a fixed value, so that matrices have roots."""


@dataclass(frozen=True, eq=False)
class _Constraints:
    """Constraints A x = b of parameters (p,), with standard deviations `stds` (c,) of the b.

    x of least squares with a covariance W (p, p) becomes P x + G b, with G = W A^T (A W A^T)^+ and
    P = 1 - G A.
    """

    A: Array
    b: Array
    stds: Array

    @classmethod
    def of(cls, p: int, buses: Sequence[Bus], stated: Sequence[Bus] = ()) -> _Constraints:
        """Return one delay for each bus, which is the nominal one of those that are `stated`."""
        unit = np.eye(p)
        equal = [unit[bus.places[0]] - unit[other] for bus in buses for other in bus.places[1:]]
        rows = [*equal, *(unit[bus.places[0]] for bus in stated)]
        b, stds = np.zeros((2, len(rows)))
        b[len(equal) :] = [bus.nominal_s for bus in stated]
        stds[len(equal) :] = [bus.std_s for bus in stated]
        return cls(np.reshape(rows, (-1, p)), b, stds)

    def solution(self, white: Array) -> tuple[Array, Array]:
        """Return P (p, p) and G (p, c) for a covariance (p, p)."""
        A = self.A
        inverse = safely(np.linalg.pinv, A @ white @ A.T, what="the delays of the commands")
        G = white @ A.T @ inverse
        return np.eye(len(white)) - G @ A, G

    def applied(self, estimate: Estimate, white: Array) -> Estimate:
        """Return an estimate under the constraints."""
        P, G = self.solution(white)
        of_data, spread = P @ estimate.covariance @ P.T, G * self.stds
        covariance = of_data + spread @ spread.T
        freedom, errors = estimate.degrees_of_freedom, estimate.white_standard_errors
        if freedom is not None:
            # Welch and Satterthwaite: the stated part of the variance has no degrees of freedom.
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
                freedom = freedom * (np.diag(covariance) / np.diag(of_data)) ** 2
            freedom = np.where(np.isfinite(freedom), freedom, np.inf)
        if errors is not None:
            ratio = np.diag(P @ white @ P.T) / np.maximum(np.diag(white), 1e-300)
            errors = errors * np.sqrt(np.maximum(ratio, 0.0))
        return replace(
            estimate,
            values=P @ estimate.values + G @ self.b,
            covariance=covariance,
            degrees_of_freedom=freedom,
            white_standard_errors=errors,
        )


def with_shared_delays(
    drives: Mapping[str, Drive], fitted: FittedRows, joint: str = ""
) -> FittedRows:
    """Return a fit with one delay per bus, the stated one where the rows do not determine it."""
    buses = buses_of(drives, fitted.estimate.names, joint)
    if not buses:
        return fitted
    white, p = fitted.white_covariance, len(fitted.estimate.names)
    constraints = _Constraints.of(p, buses)
    estimate = constraints.applied(fitted.estimate, white)
    P, _ = constraints.solution(white)
    stated = _undetermined(buses, estimate, P @ white @ P.T, fitted.qr_factor.count)
    if stated:
        constraints = _Constraints.of(p, buses, stated)
        estimate = constraints.applied(fitted.estimate, white)
    values = estimate.values.copy()
    for bus in buses:  # the same but for rounding
        values[list(bus.places)] = bus.nominal_s if bus in stated else values[bus.places[0]]
    estimate = replace(estimate, values=values)
    return replace(fitted, estimate=estimate, constraint=constraints.solution(white)[0])


def _undetermined(buses: Sequence[Bus], estimate: Estimate, white: Array, count: int) -> list[Bus]:
    """Return the buses whose delay `count` rows do not determine, with a covariance (p, p).

    They do not if the effect of the stated range, beyond that of all other parameters, is less than
    the residual: errors of the model may then hide it. An estimate farther beyond that range than
    such errors explain is one to linearise at.
    """
    free, stated = sum(len(bus.places) for bus in buses), []
    for bus in buses:
        place, range_s = bus.places[0], NORMAL_95 * bus.std_s
        # |column| of the delay, orthogonal to all others, is 1 / error for a residual of 1.
        as_residual = np.sqrt(white[place, place] * count * len(bus.places) / free)
        is_far = abs(estimate.values[place] - bus.nominal_s) > range_s + as_residual
        if as_residual > range_s and not is_far:
            stated.append(bus)
    return stated


def with_fixed_delays(
    drives: Mapping[str, Drive], estimate: Estimate, white: Array, joint: str = ""
) -> tuple[Estimate, Array]:
    """Return an estimate and its covariance `white` (p, p) for delays that stay where they are.

    A physically consistent robot is looked for near the estimate. Delays of one bus stay equal
    then, and those that are as stated keep their value: both have a distance from no other value.
    """
    buses = buses_of(drives, estimate.names, joint)
    exact = [bus for bus in buses if is_stated(estimate.standard_errors[bus.places[0]], bus.std_s)]
    constraints = _Constraints.of(len(white), buses, exact)
    if not len(constraints.A):
        return estimate, white
    P, _ = constraints.solution(white)
    stated = [place for bus in exact for place in bus.places]
    covariance, across = estimate.covariance, estimate.covariance[:, stated]
    if stated:
        # C - C_xs C_ss^-1 C_sx, the covariance of the others if the stated delays s are exact.
        inner = safely(np.linalg.pinv, across[stated], what="the delays of the commands")
        covariance = covariance - across @ inner @ across.T
    return replace(estimate, covariance=covariance), P @ white @ P.T + _FREE * white


def with_merged_delays(
    drives: Mapping[str, Drive], rows: Regression, estimate: Estimate, joint: str = ""
) -> Regression:
    """Return rows with one column for the delay of a bus, themselves without such columns.

    Their fit is the constrained one of `with_shared_delays`. Delays that are as stated in an
    estimate have no column: their torque is known.
    """
    buses = buses_of(drives, rows.names, joint)
    if not buses:
        return rows
    H, y = rows.H.copy(), rows.y.copy()
    gone: list[int] = []
    for bus in buses:
        first, *others = bus.places
        # One delay for all: the column of their common value is the sum.
        H[:, first] = H[:, list(bus.places)].sum(axis=1)
        gone += others
        if is_stated(estimate.standard_errors[first], bus.std_s):
            y -= bus.nominal_s * H[:, first]
            gone.append(first)
    kept = np.setdiff1d(np.arange(len(rows.names)), gone)
    names, units = (tuple(texts[place] for place in kept) for texts in (rows.names, rows.units))
    return replace(rows, names=names, units=units, H=H[:, kept], y=y)


def with_estimated_delays(robot: Robot, identified: Robot) -> Robot:
    """Return the robot with the delays of an estimate as nominal ones; itself if they converged.

    Raises IdentificationError for a delay that is far beyond the range of the linearisation.
    """
    drives: dict[str, Drive] = {}
    of_buses: dict[float, list[float]] = {}
    for joint, drive in robot.drives.items():
        if drive.controller is None or DELAY_PARAMETER in drive.known:
            continue
        near = drive.command_delay_s or 0.0
        scaled, delay = _estimated_delay(joint, drive, identified.drives[joint])
        seen = of_buses.setdefault(near, [])
        delay = next((known for known in seen if abs(known - delay) < _ROUNDING_S), delay)
        seen.append(delay)
        if abs(delay - near) > _DELAY_S:
            scaled = replace(scaled, command_delay_s=delay)
        if scaled is not drive:
            drives[joint] = scaled
    return robot.with_drives(drives) if drives else robot


def _estimated_delay(joint: str, drive: Drive, identified: Drive) -> tuple[Drive, float]:
    """Return a drive with the estimated scale of its gains, if that moved, and its delay [s]."""
    delay, near = identified.values[DELAY_PARAMETER], drive.command_delay_s or 0.0
    if drive.is_up_to_scale and "gain_scale" not in drive.known:
        # The slope by the delay was that of the nominal scale.
        scale, before = (max(x.scale_of_gains, 1e-9) for x in (identified, drive))
        delay = near + (delay - near) * before / scale
        if abs(scale / before - 1) > _SCALE:
            drive = drive.with_values({"gain_scale": scale})
    if abs(delay) > LARGEST_DELAY_S:
        raise IdentificationError(
            f"the command of {joint} seems delayed by {delay * 1e3:.3g} ms, more than "
            f"{LARGEST_DELAY_S * 1e3:g} ms either way, where the search ends: check the gains "
            "of its controller, and the signs and clocks of commands and positions; commands "
            "that act so late are shifted in the description of the log:\n"
            f"{toml_table('joints', joint)}\n"
            f'position_command = {{ column = "...", delay_s = {-delay:.3g} }}'
        )
    return drive, delay


# The residual block

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
    """The residual block of a window of a log, which its commands drive at parameters x (f,).

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
        """Return the block at parameters x (f,)."""
        return replace(self, x=x)


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
    blocks = tuple(CommandedLog(commands, log, motion, x) for log, motion in windows)
    return Point(commands.parameters, x, blocks)


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
    drives = {joint: with_values(robot.drives[joint], named) for joint, named in values.items()}
    return robot.with_drives(drives)


def _residuals(commands: Commands, log: Log, motion: Motion, x: Array) -> Residuals:
    """Return the residuals of a window."""
    load_side = commands.spread @ x
    robot = _robot_at(commands.identification, load_side)
    moved = rollout(robot, log, longest_closed_s=STEP_S)
    if not np.all(np.isfinite(moved.joint_position)):
        raise IdentificationError("the simulation diverges")
    motion = _moved(robot, motion, moved)
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


def _moved(robot: Robot, motion: Motion, moved: Log) -> Motion:
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
    names, p = identification.model.torque_joints, len(identification.base.columns)
    order = [robot.index(joint) for joint in names]
    _, _, H, _ = load_columns(identification.known, motion, identification.model, {})

    def of_drives(moved: Motion) -> Array:
        torque, _, columns, _ = load_columns(identification.known, moved, identification.model, {})
        return torque - columns[:, :, p:] @ x[p:]

    unchanged = of_drives(motion)
    slopes = []
    for field in ("position", "velocity", "acceleration"):
        moves = {f"joint_{field}": 1.0, f"motor_{field}": 0.0}
        ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
        changes = {
            name: getattr(motion, name) + _NUDGE * (1.0 if is_joint else ratio)
            for name, is_joint in moves.items()
        }
        # Torques of drives depend on their own joint: one nudge of all gives the diagonal slopes.
        slopes.append((unchanged - of_drives(replace(motion, **changes))) / _NUDGE)
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
