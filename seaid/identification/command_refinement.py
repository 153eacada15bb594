"""`refine` where position commands were logged: output error of the closed loop.

The model follows the commands under its own controllers, from the first state of each log, and the
measured joint positions are compared with its own. A rollout is that of `replay`, in which dry
friction sticks; its sensitivities are those of the load side (8), linearised along it, with the
gains of the controllers as stiffness and damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, FrozenMapping, safely
from seaid._progress import track
from seaid.checks import revalued
from seaid.drives import PARAMETERS, Bus, buses_of, is_stated, readable
from seaid.errors import IdentificationError, SeaidError
from seaid.estimation import Residuals, Step, gauss_newton_step
from seaid.identification.drive_estimates import with_estimate
from seaid.identification.simulated_joints import response_to, torque_jacobians
from seaid.identification.two_step import split_load_side
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
from seaid.regressor import load_columns
from seaid.robot import Robot
from seaid.simulation import rollout

if TYPE_CHECKING:
    from seaid.identification.result import Identification

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
_MOST_HALVINGS, _SETTLED, _BETTER = 4, 0.02, 1e-3

_FAR = 3.0
"""Standard errors of the next step beyond which a search that cannot go on has not converged: 0.13
to 0.41 on the measured logs of a Go2, 48 where friction holds the joints of an arm at reversals."""


@dataclass(frozen=True, eq=False)
class Rollouts:
    """A point of the iteration: parameters (p,), and residuals per window.

    `stated` (1, B, n, s) per window are their derivatives by delays that are as stated.
    """

    x: Array
    residuals: list[Residuals]
    stated: list[Array]


@dataclass(frozen=True, eq=False)
class _Task:
    """What stays in all iterations.

    `parts` are the windows of the logs, `free` (p, f) the directions of the parameters: those of a
    bus have one delay. `stated` are the buses whose delay is as stated.
    """

    identification: Identification
    parts: list[tuple[Log, Motion]]
    free: Array
    names: tuple[str, ...]
    stated: tuple[Bus, ...]


def refine_commanded(
    start: Identification, logs: Sequence[Log], iterations: int, progress: bool
) -> tuple[Identification, str, dict[str, float]]:
    """Return the identification with the least output error of the closed loop, "" and {}.

    Where its values are worse than those of the start, the reason why, and numbers. With errors of
    the model in place of noise the likelihood, in which joints of small errors weigh most, may rise
    while the positions get worse; or no step may improve it, although its slope is not zero.
    """
    task = _task(start, logs)
    try:
        point = _rollouts(task, _within_bounds(start, np.array(start.load_side.values)))
    except SeaidError as problem:
        raise IdentificationError(
            "the model cannot be simulated with the values of the identification: give the bodies "
            f"that are known (known_bodies=), or identify with feasible=True; {problem}",
            "known_bodies=",
            "feasible=True",
        ) from None
    first = point
    for _ in track(range(iterations), "refining", progress):
        step, free = _step(task, point)
        improved = _improved(task, point, free @ step.change, step.merit)
        if improved is None:
            rest = np.abs(step.change) / np.sqrt(np.diag(step.covariance))
            if np.max(rest, initial=0.0) > _FAR:
                return start, *_not_converged(task, free, rest)
            break
        sizes = np.abs(step.change) / np.sqrt(np.diag(step.white_covariance))
        point = improved
        if np.max(sizes, initial=0.0) < _SETTLED:
            break
    before, after = _mean_absolute_error(first), _mean_absolute_error(point)
    if after > before:
        evidence = {"error of the start": before, "error after": after}
        return start, "its positions follow the commands more closely", evidence
    return _refined(task, point), "", {}


def _not_converged(task: _Task, free: Array, rest: Array) -> tuple[str, dict[str, float]]:
    """Return why a search ended whose next step (g,) in standard errors is long."""
    worst = int(np.argmax(rest))
    name = readable(task.identification.load_side.names[int(np.argmax(free[:, worst]))])
    return (
        f"its search cannot improve the simulated positions, although its next step would change "
        f"{name} by {rest[worst]:.0f} standard errors"
    ), {"standard errors": float(rest[worst])}


def _mean_absolute_error(point: Rollouts) -> float:
    """Return the mean absolute error of all joints [rad or m]."""
    return float(np.mean(np.concatenate([abs(x.residual[x.kept]) for x in point.residuals])))


def _task(result: Identification, logs: Sequence[Log]) -> _Task:
    robot, side = result.known, result.load_side
    drives = {joint: robot.drives[joint] for joint in robot.joint_names}
    free, names = np.eye(len(side.names)), list(map(str, side.names))
    stated, gone = [], set()
    for bus in buses_of(drives, side.names):
        first, *others = bus.places
        # The direction of a bus changes all of its delays alike.
        free[others, first] = 1.0
        gone |= set(others)
        if is_stated(side.standard_errors[first], bus.std_s):
            stated.append(bus)
            gone.add(first)
    kept = [place for place in range(len(names)) if place not in gone]
    parts = []
    for log in logs:
        for stretch in stretches(usable(log), 1.0):
            count = max(1, int(np.ceil((stretch.time[-1] - stretch.time[0]) / _WINDOW_S)))
            edges = np.linspace(stretch.time[0], stretch.time[-1], count + 1)
            for start, end in pairwise(edges):
                parts.append(_window(result, stretch.between(start, end)))
    return _Task(result, parts, free[:, kept], tuple(names[place] for place in kept), tuple(stated))


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


def robot_at(identification: Identification, x: Array) -> Robot:
    """Return the robot with the values x of the load side."""
    base, robot = identification.base, identification.robot
    correction = base.least(x[: len(base.columns)] - base.project(robot.parameters))
    estimate = replace(identification.load_side, values=x)
    _, sides = split_load_side(identification.model, estimate)
    drives = {
        joint: with_estimate(drive, sides[joint]) if joint in sides else drive
        for joint, drive in robot.drives.items()
    }
    return robot.with_values(robot.parameters + correction, drives)


def _rollouts(task: _Task, x: Array) -> Rollouts:
    """Return the residuals of all windows at x, and their derivatives."""
    robot = robot_at(task.identification, x)
    windows = [_residuals(task, robot, log, motion, x) for log, motion in task.parts]
    return Rollouts(x, [residuals for residuals, _ in windows], [stated for _, stated in windows])


def _residuals(
    task: _Task, robot: Robot, log: Log, motion: Motion, x: Array
) -> tuple[Residuals, Array]:
    """Return the residuals of a window, and their derivatives by stated delays."""
    moved = rollout(robot, log, longest_closed_s=STEP_S)
    if not np.all(np.isfinite(moved.joint_position)):
        raise IdentificationError("the simulation diverges")
    step_s = float(log.time[1] - log.time[0])
    sensitivity = _sensitivity(task, robot, _moved(robot, motion, moved), log, x)
    error = (log.joint_position - moved.joint_position)[..., None]
    # The residual is measured less simulated: its derivatives are minus the sensitivities.
    columns = np.concatenate([error, -sensitivity @ task.free], axis=2)
    stated = [sensitivity[..., list(bus.places)].sum(axis=2) for bus in task.stated]
    columns = np.concatenate([columns, *(-slope[..., None] for slope in stated)], axis=2)
    block = max(1, round(_BLOCK_S / step_s))
    count = len(log.time) // block
    means = columns[: count * block].reshape(count, block, *columns.shape[1:]).mean(axis=1)
    time = log.time[: count * block].reshape(count, block).mean(axis=1)
    laws = [drive.law for drive in robot.drives.values() if drive.law is not None]
    held = [law for law in laws if law.position_gain_Nm_per_rad]
    decay = max(
        (x.velocity_gain_Nms_per_rad / x.position_gain_Nm_per_rad for x in held), default=0.0
    )
    late = time - log.time[0] > min(_TRANSIENT_S + _DECAYS * decay, 0.25 * np.ptp(log.time))
    if motion.bridged is not None:  # what was interpolated over a gap was not measured
        late &= ~np.any(motion.bridged[: count * block].reshape(count, block), axis=1)
    size = task.free.shape[1]
    residuals = Residuals(
        residual=means[None, ..., 0],
        jacobian=means[None, ..., 1 : 1 + size],
        nuisance=np.zeros((1, count, robot.n, 0)),
        kept=np.broadcast_to(late[None, :, None], (1, count, robot.n)).copy(),
        time=time[None],
        channels=range(robot.n),
    )
    return residuals, means[None, ..., 1 + size :]


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


def _sensitivity(task: _Task, robot: Robot, motion: Motion, log: Log, x: Array) -> Array:
    """Return the derivative (T, n, p) of the positions of a rollout by the parameters."""
    identification = task.identification
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


def _is_positive(name: str) -> bool:
    parameter = name.split(" of ")[0]
    return parameter in PARAMETERS and PARAMETERS[parameter].is_positive


def _step(task: _Task, point: Rollouts) -> tuple[Step, Array]:
    """Return the next step in its directions (p, f), in which no positive parameter falls below 0.

    Parameters at their bound that the step would push across stay there.
    """
    values = point.x[np.argmax(task.free, axis=0)]
    free = np.ones(len(task.names), dtype=bool)
    positive = np.array([_is_positive(name) for name in task.names])
    while True:
        size = int(np.sum(free))
        parts = [replace(window, jacobian=window.jacobian[..., free]) for window in point.residuals]
        names = tuple(name for name, is_free in zip(task.names, free, strict=True) if is_free)
        step = gauss_newton_step(parts, names, np.zeros(size), np.zeros(size))
        change = np.zeros(len(free))
        change[free] = step.change
        # Active set: what would cross its bound is held there, and the step is computed again.
        across = free & positive & (values <= 0) & (change < 0)
        if not np.any(across):
            return step, task.free[:, free]
        free &= ~across


def _within_bounds(identification: Identification, x: Array) -> Array:
    """Return values x with zeros for positive parameters that a regression found below zero."""
    positive = np.array([_is_positive(str(name)) for name in identification.load_side.names])
    return np.where(positive, np.maximum(x, 0.0), x)


def _improved(task: _Task, point: Rollouts, change: Array, merit: float) -> Rollouts | None:
    """Return the next point, the step halved until the likelihood improves; None if it cannot."""
    part = 1.0
    for _ in range(_MOST_HALVINGS):
        x = _within_bounds(task.identification, point.x + part * change)
        with suppress(SeaidError):  # it diverges there
            trial = _rollouts(task, x)
            if _step(task, trial)[0].merit < merit - _BETTER:
                return trial
        part /= 2
    return None


def _refined(task: _Task, point: Rollouts) -> Identification:
    """Return the identification with the values of a point and their covariance."""
    identification = task.identification
    step, free = _step(task, point)
    covariance = free @ step.covariance @ free.T
    weights = [window.kept / step.stds for window in point.residuals]
    parts = zip(point.residuals, point.stated, weights, strict=True)
    jacobians = [
        (np.concatenate([window.jacobian @ _within(task, free), stated], axis=3) * w[..., None])
        for window, stated, w in parts
    ]
    rows = np.concatenate([part.reshape(-1, part.shape[3]) for part in jacobians])
    size = free.shape[1]
    for column, bus in enumerate(task.stated, size):
        # J dx + j ds = 0 in weighted rows: an error ds of a stated delay moves x by -J^+ j ds.
        others = safely(
            np.linalg.lstsq, rows[:, :size], rows[:, column], what="the output error", rcond=None
        )[0]
        change = -free @ others
        change[list(bus.places)] = 1.0
        covariance += bus.std_s**2 * np.outer(change, change)
    side = replace(
        identification.load_side,
        values=point.x,
        covariance=covariance,
        residual_std=float(np.sqrt(np.mean(step.stds**2))),
        condition_number=step.condition_number,
        white_standard_errors=np.sqrt(np.diag(free @ step.white_covariance @ free.T)),
        degrees_of_freedom=None,
    )
    load, drives = split_load_side(identification.model, side)
    refined = {**identification.drive_side, **drives}
    robot = robot_at(identification, point.x)
    known = {
        joint: with_estimate(drive, refined[joint]) if joint in refined else drive
        for joint, drive in identification.known.drives.items()
    }
    return replace(
        identification,
        drive_side=FrozenMapping({j: refined[j] for j in robot.joint_names if j in refined}),
        load=load,
        load_side=side,
        robot=robot.with_values(robot.parameters, known),
        findings=revalued(identification.findings, drives),
    )


def _within(task: _Task, free: Array) -> Array:
    """Return the columns of `task.free` that are in `free`, as a selection (f, g)."""
    kept = [int(np.flatnonzero(np.all(task.free == d[:, None], axis=0))[0]) for d in free.T]
    return np.eye(task.free.shape[1])[:, kept]
