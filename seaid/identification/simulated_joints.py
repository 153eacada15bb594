"""Joints that are simulated along a motion: what pulls at them, and those under controllers.

What pulls at the joints are the bodies and, against their motion, the drives: (8) is linearised
along the motion. A force on the joints, such as the residual of (8) or its derivative by a
parameter, gives their response, to which free motions from the initial states of each window are
added. The simulators of `refine` are made of this.

Joints that follow commands under their own controllers are one of these simulators. A rollout is
that of `replay`, in which dry friction sticks; its sensitivities are those of (8) along it, with
the gains of the controllers as stiffness and damping. The joint positions are the outputs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.drives import Drive
from seaid.drives.drives import groups_of
from seaid.errors import IdentificationError, listed
from seaid.estimation.nonlinear_least_squares import Point, Residuals
from seaid.identification import refined_parameters
from seaid.identification.datasets import Dataset, first_motion
from seaid.log import Log, Motion, low_pass, reconstruct_motion
from seaid.log.channels import OF_CONTROLLERS
from seaid.log.commands import commanded_part, relative_supply
from seaid.log.filtering import spline_derivatives
from seaid.log.motion import with_directions
from seaid.log.usable_parts import stretches, usable
from seaid.regressor import motor_regressor
from seaid.regressor.load import LoadModel, drive_torques, load_columns
from seaid.regressor.regression import spring_regressor
from seaid.robot import Robot, at_drives, at_joints
from seaid.robot.robot import check_held
from seaid.robot.transmission import group_of
from seaid.simulation.plant import (
    jacobians_at_drives,
    response_to,
    torque_jacobians,
    with_joints,
)
from seaid.simulation.replaying import rollout

if TYPE_CHECKING:
    from seaid.identification.result import Identification


@dataclass(frozen=True, eq=False)
class LinearisedLoad:
    """The linearised load side (8) of simulated joints: `inside` moves by a force on them.

    It has the derivatives (3, T, joints, joints) of torques by the states. Steps of `step_s` are
    in equally long `windows`, of which the last one may be shorter.
    """

    inside: Array
    step_s: float
    windows: int

    def response(self, force: Array) -> Array:
        """Return the response of the joints to a force (T, joints, any), and free motions."""
        # The last window is filled with its last sample.
        padding = ((0, -len(force) % self.windows), (0, 0), (0, 0))
        jacobians = np.pad(self.inside, ((0, 0), *padding), mode="edge")
        filled = np.pad(force, padding, mode="edge")
        return response_to(jacobians, filled, self.step_s, self.windows)[:, : len(force)]


def displaced(motion: Motion, joints: list[int], response: Array, weights: Array) -> Motion:
    """Return a motion with the columns of a response of its joints added, by weights (W, columns).

    There is a row of weights for each window.
    """
    length = -(-len(motion.time) // len(weights))
    by_sample = np.repeat(weights, length, axis=0)[: len(motion.time)]
    states = [
        state[:, joints] + np.einsum("tjc,tc->tj", part, by_sample)
        for state, part in zip(motion.joint_states, response, strict=True)
    ]
    return with_joints(motion, joints, states)


NUDGE = 1e-6
"""Change of a position [rad or m] and its derivatives for the slopes of torques of drives."""


def nudged(motion: Motion, order: int, motor: Array | float = 0.0) -> Motion:
    """Return a motion with a derivative of all joint positions changed by `NUDGE`.

    That of the motors changes by `motor` (n,) times as much. The torque of a drive depends on its
    own joint, so that one change of all joints at once gives all slopes, unless drives are coupled.
    """
    name = ("position", "velocity", "acceleration")[order]
    joint, turned = f"joint_{name}", f"motor_{name}"
    changes: dict[str, Any] = {
        joint: getattr(motion, joint) + NUDGE,
        turned: getattr(motion, turned) + NUDGE * np.asarray(motor),
    }
    return replace(motion, **changes)


def drive_slopes(
    known: Robot,
    motion: Motion,
    changed: Iterable[Motion],
    model: LoadModel,
    springs: Mapping[str, Array],
    load_side: Array,
) -> list[Array]:
    """Return minus the slopes (T, joints) of the torques of drives, by `nudged` motions."""
    unchanged = drive_torques(known, motion, model, springs, load_side)
    moved = (drive_torques(known, x, model, springs, load_side) for x in changed)
    return [(unchanged - torque) / NUDGE for torque in moved]


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
    q, v, a = (at_joints(robot.transmission, state) for state in (q, v, a))
    return replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a)


_START_BAND = 0.5
"""The first linearisation is about joint positions with this part of the cutoff."""


def smoothed(motion: Motion, joints: list[int]) -> Motion:
    """Return the motion with some joints low-passed, for the linearisation."""
    band = _START_BAND * motion.cutoff_hz
    smooth = low_pass(motion.joint_position[:, joints], motion.rate_hz, band)
    return with_joints(motion, joints, spline_derivatives(motion.time, smooth))


# Joints under their own controllers

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
        if motion.bridged is not None:  # what was interpolated over a gap was not measured
            unknown |= motion.bridged[:, None]
        block = max(1, round(_BLOCK_S * (len(log.time) - 1) / float(np.ptp(log.time))))
        rows = refined_parameters.block_means(columns, unknown, log.time, 1, block, 0)
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
    columns = [log.joint_names.index(joint) for joint in robot.joint_names]

    def sampled(values: Array) -> Array:
        signals = [np.interp(motion.time, log.time, values[:, column]) for column in columns]
        return np.column_stack(signals)

    unknown, sensors = np.full((len(motion.time), robot.n), np.nan), log.sensors()
    channels = [x for x in ("joint_position", *OF_CONTROLLERS) if x in sensors]
    sent: dict[str, Any] = {name: sampled(sensors[name]) for name in channels}
    regular = Log(
        time=motion.time,
        joint_names=robot.joint_names,
        motor_position=unknown,
        motor_torque=unknown,
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
    H = load_columns(known, motion, model, {}).H
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
    load = LinearisedLoad(np.stack([K, C, M]), 1 / motion.rate_hz, 1)
    whole = np.zeros((len(force), robot.n, len(x)))
    whole[:, order] = load.response(force)[0, :, :, : len(x)]
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


# What a method can simulate

_LINEAR = {"stiffness", "spring_damping", "spring_offset"}


@dataclass(frozen=True)
class Restrictions:
    """What a method that goes on from two steps refuses.

    `option` is how the method is asked for, and `instead` the option for robots that it refuses.
    `why` is the reason for which the base has to be held. Springs have to be linear and to have the
    parameters `needed`, which `what` says.
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

    def unseen_error(self, joints: Sequence[str]) -> IdentificationError:
        """Return the error for joints without encoder, where the method does nothing."""
        return IdentificationError(
            f"{self.option} needs the joint position of each spring, and the logs have none of "
            f"{listed(joints)}: these springs are found by a refinement that simulates the motors, "
            f"whatever the first estimate is; remove {self.option}, or log the joint position",
            self.option,
        )


AT_ONCE = Restrictions(
    option='method="simultaneous"',
    instead='method="two-step"',
    why="without contact forces each equation has the deflections of several springs",
    needed=frozenset({"stiffness", "spring_offset"}),
    what="shares springs of unknown stiffness and offset",
)


BY_INSTRUMENTS = Restrictions(
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
        of_spring = _of_unseen(robot, joint, drive, unseen)
        reasons = chain(_refusals(robot, joint, drive), _of_terms(drive), of_spring)
        if reason := next(reasons, ""):
            raise IdentificationError(
                f"the refinement cannot simulate the drive of {joint}, {reason}; use the result of "
                "identify"
            )


def _refusals(robot: Robot, joint: str, drive: Drive) -> Iterator[str]:
    """Yield why a drive is not simulated."""
    if drive.shared:
        yield f"which shares parameters with others ('{drive.shared}'): it moves those of each"
    if drive.controller is not None:
        if drive.is_elastic or any(x.controller is None for x in robot.drives.values()):
            yield "whose command was logged: all drives have to be stiff, with a position command"
        if any((motor_regressor(robot, joint).non_linear, robot.angle_ratios)):
            yield "whose equation is not linear in its parameters, or has a ratio of its angle"
    elif drive.motor_input != "torque":
        yield f"of which the {drive.motor_input} was logged, not the torque"


def _of_terms(drive: Drive) -> Iterator[str]:
    """Yield which terms of a drive are not simulated."""
    if "dahl" in drive.spring:
        yield "whose spring has hysteresis, a state that adds up the noise of its deflection"
    if "load" in drive.friction and not drive.is_elastic:
        yield "whose friction grows with the load"


def _of_unseen(robot: Robot, joint: str, drive: Drive, unseen: Iterable[str]) -> Iterator[str]:
    """Yield why a drive is not simulated, if no sensor is behind its spring."""
    if joint not in unseen:
        return
    if len(group_of(robot.transmission, robot.index(joint))) > 1:
        yield "whose motor turns several joints, and no sensor is behind its spring"
    if any((drive.parallel_spring, drive.joint_friction, drive.angle_ratio)):
        yield "which has a parallel spring or joint friction, or angle_ratio, and no sensor behind"
    if motor_regressor(robot, joint).non_linear or "load" in drive.friction:
        yield "whose equation is not linear in its parameters, without a sensor behind its spring"
    if not {"stiffness", "spring_offset"} <= {*spring_regressor(robot, joint).names} <= _LINEAR:
        yield f"whose spring {_kind(robot, joint)} and no sensor behind it"


def _kind(robot: Robot, joint: str) -> str:
    """Describe the terms of a spring other than unknown stiffness and offset."""
    regressor, drive = spring_regressor(robot, joint), robot.drives[joint]
    others = [name.replace("_", " ") for name in regressor.names if name not in _LINEAR]
    if others:
        return f"has {', '.join(others)}"
    if "spring_damping" in regressor.names:
        return "has damping"
    return f"has a known {' and '.join(name.replace('_', ' ') for name in drive.known)}"
