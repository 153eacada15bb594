"""Joints that follow commands under their own controllers: a simulator of `refine`.

A rollout is that of `replay`, in which dry friction sticks; its sensitivities are those of (8)
along it, with the gains of the controllers as stiffness and damping. The joint positions are the
outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.errors import IdentificationError
from seaid.estimation.nonlinear_least_squares import Point, Residuals
from seaid.identification import refined_parameters
from seaid.identification.datasets import Dataset, first_motion
from seaid.identification.joint_dynamics import drive_slopes, nudged
from seaid.log import Log, Motion, reconstruct_motion
from seaid.log.channels import OF_CONTROLLERS
from seaid.log.commands import commanded_part, relative_supply
from seaid.log.filtering import spline_derivatives
from seaid.log.motion import with_directions
from seaid.log.usable_parts import stretches, usable
from seaid.regressor.load import load_side
from seaid.robot import Robot
from seaid.simulation.plant import (
    jacobians_at_drives,
    response_to,
    torque_jacobians,
    with_joints,
)
from seaid.simulation.replaying import rollout

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


@dataclass(frozen=True, eq=False)
class CommandDriven(refined_parameters.Outputs):
    """A window of a log on regular samples; the rollouts of its commands replace its `motion`.

    Commands are inputs that have no scale.
    """

    log: Log
    motion: Motion

    @cached_property
    def residuals(self) -> Residuals:
        """The residuals of the joint positions; each rollout starts anew."""
        layout, x, log = self.layout, self.x, self.log
        robot = layout.robot_at(x)
        moved = rollout(robot, log, longest_closed_s=STEP_S)
        if not np.all(np.isfinite(moved.joint_position)):
            raise IdentificationError("the simulation diverges")
        motion = _motion_of(robot, self.motion, moved)
        error = (log.joint_position - moved.joint_position)[..., None]
        # The residual is measured less simulated: its derivatives are minus the sensitivities.
        columns = np.concatenate([error, -_sensitivity(layout, robot, motion, log, x)], axis=2)
        unknown = np.zeros(error.shape[:2], dtype=bool)
        block = max(1, round(_BLOCK_S * (len(log.time) - 1) / float(np.ptp(log.time))))
        rows = refined_parameters.block_means(columns, unknown, motion, 1, block, 0)
        late = rows.time - log.time[0] > min(_transient_s(robot), 0.25 * np.ptp(log.time))
        return replace(rows, kept=rows.kept & late[..., None])


def commanded_point(start: Identification, logs: Sequence[Log]) -> refined_parameters.LogPoint:
    """Return the point of a search at the values of an identification."""
    layout = refined_parameters.layout_of(start, 0.0)
    windows: list[refined_parameters.Outputs] = []
    for log in logs:
        for stretch in stretches(usable(log), 1.0):
            count = max(1, int(np.ceil((stretch.time[-1] - stretch.time[0]) / _WINDOW_S)))
            edges = np.linspace(stretch.time[0], stretch.time[-1], count + 1)
            windows += [_window(layout, stretch.between(a, b)) for a, b in pairwise(edges)]
    return Point(layout.parameters, layout.start, tuple(windows))


def _window(layout: refined_parameters.Layout, log: Log) -> CommandDriven:
    """Return a window on regular samples, with the motion that its rollouts replace."""
    robot, cutoff_hz = layout.identification.known, layout.identification.cutoff_hz
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    motion = reconstruct_motion(robot, log, min(3 * cutoff_hz, rate_hz / 8))
    sensors = log.sensors(robot.joint_names)

    def sampled(values: Array) -> Array:
        return np.column_stack([np.interp(motion.time, log.time, x) for x in values.T])

    channels = [x for x in ("joint_position", *OF_CONTROLLERS) if x in sensors]
    sent: dict[str, Any] = {name: sampled(sensors[name]) for name in channels}
    regular = Log(
        time=motion.time,
        joint_names=robot.joint_names,
        is_prismatic=robot.is_prismatic,
        **sent,
    )
    return CommandDriven(layout, layout.start, regular, motion)


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
    states = spline_derivatives(moved.time, moved.joint_position)
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    scales = [robot.drives[joint].scale_of_gains for joint in robot.joint_names]
    angle, speed, acceleration = ratio * np.array(states)
    return replace(
        with_joints(motion, list(range(robot.n)), states),
        motor_position=angle,
        motor_velocity=speed,
        motor_acceleration=acceleration,
        motor_direction=None,
        motor_torque=moved.motor_torque / scales,
    )


def _sensitivity(
    layout: refined_parameters.Layout, robot: Robot, motion: Motion, log: Log, x: Array
) -> Array:
    """Return the derivative (T, n, p) of the positions of a rollout by the parameters x (p,)."""
    known, model = layout.identification.known, layout.identification.model
    names = model.torque_joints
    order = [robot.index(joint) for joint in names]
    H = load_side(known).columns(motion, model, {}).H
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    changed = [nudged(motion, derivative, ratio) for derivative in range(3)]
    slopes = drive_slopes(known, motion, changed, model, {}, x[layout.load])
    K, C, M = torque_jacobians(robot, *motion.joint_states)[:, :, order][..., order]
    gains = _gains(robot, names, motion, log)
    diagonal = np.eye(len(order))
    M = M + slopes[2][..., None] * diagonal
    fastest = np.max(np.abs(motion.joint_velocity[:, order]), axis=0)
    rests = np.abs(motion.joint_velocity[:, order]) < _REST * fastest
    inertia = np.einsum("tii->ti", M)
    # A joint that sticks does not respond: no force on it, and a damping of `_HOLD` times the
    # inertia over the step, which stops it within a sample.
    held = np.where(rests, _HOLD * inertia * motion.rate_hz, slopes[1] * ~rests)
    C = C + (held + gains[1])[..., None] * diagonal
    K = K + (slopes[0] + gains[0])[..., None] * diagonal
    # M dq'' + C dq' + K dq = -H dx: the torque that a parameter takes is not there for the motion.
    # A delay that drives share takes the sum of their torques.
    by_x = H @ np.eye(len(x))[layout.load]
    force = np.where(rests[..., None], 0.0, -by_x)
    response = response_to(np.stack([K, C, M]), force, 1 / motion.rate_hz, 1)
    whole = np.zeros((len(force), robot.n, len(x)))
    whole[:, order] = response[0, :, :, : len(x)]
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
    jacobians = jacobians_at_drives(robot.transmission, torque_jacobians(robot, *states))
    inertia = np.median(np.einsum("tii->ti", jacobians[2]), axis=0)
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
