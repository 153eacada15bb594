"""Springs and loads from motor angle and motor torque alone, without a sensor behind the spring.

From (7) the torque on the load follows from the motor, tau_L = n (tau_M - I_M theta_M'' - friction)
with n = N r_L / r_M, and from (4b) the angle of the joint, q = theta_M / n - tau_L / (k r_L^2):
nothing is integrated, but noise of the torque enters (8) with two derivatives. So these angles only
start the fit. `refine` simulates the joints from the motors instead, the one direction in which the
equations neither drift nor depend on dry friction at rest, and compares the motor torques, whose
noise no controller feeds back into the motor angles. Windows shorter than a period of the joint
keep the cost smooth far from the solution (multiple shooting, Bock 1983); longer ones then give the
accuracy. `filled_by_model` gives the first start, by a robot without springs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import StiffDrive, total_ratio
from seaid.errors import Finding
from seaid.estimation import LEAST_STD, RANK_TOLERANCE, scaled_svd
from seaid.identification.simulated_joints import fitted_robot, torque_jacobians
from seaid.identification.torque_offsets import TORQUE_OFFSET
from seaid.identification.two_step import joints_with_torque
from seaid.log import FEWEST_PERIODS, Log, Motion, low_pass, reconstruct_motions
from seaid.regressor import (
    LoadModel,
    actuator_columns,
    base_parameters,
    load_columns,
    load_model,
    load_regression,
)
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification.identification import Identification

STARTS = (0.4, 1.0, 0.16, 2.5)
"""Antiresonances over the cutoff from which the fit starts, until only noise is left of the torque;
else the best one goes on. From 0.3 to 10 times the true stiffness short windows led there for a
motion that hardly excites the resonance, from a smaller range if it does: on the plants of
scripts/benchmarks/motor_side.py, on which the list was chosen."""

RIGID_BELOW = (1.0, 0.1)
"""Parts of the cutoff up to which the robot counts as rigid in the first regression."""

_WEIGHTINGS = 3

SAMPLES = 8
"""Samples per period of an oscillation that a log shows."""

POORLY_KNOWN, _WANTED = 0.1, 0.03
"""Relative standard error of a stiffness from which it has a finding, and the one wanted."""


def without_joint_encoder(robot: Robot, logs: Sequence[Log]) -> tuple[str, ...]:
    """Return the elastic joints of which each log has the motor side only."""
    return tuple(
        joint for joint in robot.elastic_joints if all(_only_motor(log, joint) for log in logs)
    )


def _only_motor(log: Log, joint: str) -> bool:
    if joint not in log.joint_names:
        return False
    place = log.joint_names.index(joint)
    behind = (log.joint_position, log.joint_torque, log.deflection)
    sensed = [one is not None and bool(np.any(np.isfinite(one[:, place]))) for one in behind]
    motor = np.isfinite(log.motor_position[:, place]) & np.isfinite(log.motor_torque[:, place])
    return bool(np.all(motor)) and not any(sensed)


def motor_side_finding(joints: Sequence[str]) -> Finding:
    """Return the note that joints have no encoder behind their springs, and what that means."""
    return Finding(
        "motor-side",
        f"{', '.join(joints)}: no sensor behind the spring, so that stiffness and load come from "
        "motor angle and torque by output error; the joint angle is that of the motor over the "
        "gear ratio at a spring without force",
        joints[0] if len(joints) == 1 else "",
        "note",
        certainty="certain",
    )


def joint_angle(robot: Robot, motion: Motion, joint: str, values: Mapping[str, float]) -> Array:
    """Return the joint position (T,) that satisfies (7) at the `values` of the drive."""
    index, drive = robot.index(joint), robot.drives[joint]
    ratio = total_ratio(robot.drives[joint])
    q = motion.motor_position[:, index] / ratio
    positions = motion.joint_position.copy()
    positions[:, index] = q
    at = replace(motion, joint_position=positions, deflection=None)
    regressor, zeta, R = actuator_columns(robot, at, joint)
    rest = zeta - R @ [values.get(name, 0.0) for name in regressor.names]
    rest = rest - values.get(TORQUE_OFFSET, 0.0)
    # (7) is linear in q: a change by d changes `rest` by k r_M r_L / N d
    return np.asarray(q - rest * ratio / (values["stiffness"] * drive.load_radius**2))


def with_rigid_angles(robot: Robot, log: Log, joints: Sequence[str]) -> Log:
    """Return the log with the motor angles over the gear ratio as joint positions."""
    position = log.joint_position.copy()
    for joint in joints:
        place = log.joint_names.index(joint)
        position[:, place] = log.motor_position[:, place] / total_ratio(robot.drives[joint])
    return replace(log, joint_position=position)


def with_angles(log: Log, motions: Sequence[Motion], angles: Sequence[Mapping[str, Array]]) -> Log:
    """Return the log with joint positions {joint: (T,)} at the times of its motions."""
    position = log.joint_position.copy()
    for motion, own in zip(motions, angles, strict=True):
        inside = (log.time >= motion.time[0]) & (log.time <= motion.time[-1])
        for joint, angle in own.items():
            place = log.joint_names.index(joint)
            position[inside, place] = np.interp(log.time[inside], motion.time, angle)
    return replace(log, joint_position=position)


def with_joint_angles(
    robot: Robot, log: Log, values: Mapping[str, Mapping[str, float]], cutoff_hz: float
) -> Log:
    """Return the log with the joint positions that satisfy (7) at the `values` of the drives."""
    log = with_rigid_angles(robot, log, list(values))
    motions = reconstruct_motions(robot, log, cutoff_hz)
    angles = [
        {joint: joint_angle(robot, one, joint, own) for joint, own in values.items()}
        for one in motions
    ]
    return with_angles(log, motions, angles)


def rigid_robot(robot: Robot, joints: Sequence[str]) -> Robot:
    """Return the robot with rigid drives in place of the springs of some joints."""
    drives = dict(robot.drives)
    for joint in joints:
        old = drives[joint]
        per_m = old.joint_units[1] == "m"
        drives[joint] = StiffDrive(
            gear_ratio=None if per_m else total_ratio(robot.drives[joint]),
            gear_ratio_rad_per_m=total_ratio(robot.drives[joint]) if per_m else None,
            motor_inertia_kg_m2=old.motor_inertia_kg_m2,
            friction=(*old.friction, "offset"),
            torque_ripple=old.torque_ripple,
        )
    return robot.with_values(robot.parameters, drives)


@dataclass(frozen=True, eq=False)
class RigidFit:
    """The regression of rigid drives in place of springs without a sensor behind them.

    `torques` are those on the load along each of the `motions` of each log, by `model` at `x` (p,);
    `inertia` (n,) is that about each joint.
    """

    model: LoadModel
    x: Array
    logs: Sequence[Log]
    motions: Sequence[Sequence[Motion]]
    torques: Sequence[Sequence[Array]]
    inertia: Array


def cutoff_of(
    robot: Robot, logs: Sequence[Log], joints: Sequence[str], cutoff_hz: float | None
) -> float:
    """Return the given cutoff, or the lowest that the logs propose."""
    if cutoff_hz is not None:
        return cutoff_hz
    rigid = [with_rigid_angles(robot, log, joints) for log in logs]
    return min(reconstruct_motions(robot, log)[0].cutoff_hz for log in rigid)


def fit_rigid(
    robot: Robot, logs: Sequence[Log], joints: Sequence[str], cutoff_hz: float
) -> RigidFit:
    """Return the regression of the robot with rigid drives instead of the springs of `joints`."""
    rigid = rigid_robot(robot, joints)
    logs = [with_rigid_angles(robot, log, joints) for log in logs]
    motions = [reconstruct_motions(rigid, log, cutoff_hz) for log in logs]
    every = [one for group in motions for one in group]
    used = [one for one in joints_with_torque(rigid, every) if one not in rigid.elastic_joints]
    model = load_model(rigid, base_parameters(rigid, torque_joints=used), used)
    rows = [load_regression(rigid, one, model, {}) for one in every]
    H, y, joint = (np.concatenate([getattr(one, x) for one in rows]) for x in ("H", "y", "joint"))
    weight = np.ones(len(y))
    for _ in range(_WEIGHTINGS):
        x = scaled_svd(H * weight[:, None]).solve(y * weight, RANK_TOLERANCE)
        for own in (joint == j for j in np.unique(joint)):
            weight[own] = 1 / max(float(np.sqrt(np.mean((y - H @ x)[own] ** 2))), LEAST_STD)
    torques = [[_load_torque(rigid, one, model, x) for one in group] for group in motions]
    inertia = inertia_about(fitted_robot(rigid, model, x), every[0])
    return RigidFit(model, x, logs, motions, torques, inertia)


def _load_torque(rigid: Robot, motion: Motion, model: LoadModel, x: Array) -> Array:
    """Return the torques (T, joints of the model) of the bodies below the cutoff."""
    _, payload, H, _ = load_columns(rigid, motion, model, {})
    p = len(model.base.columns)
    return low_pass(payload + H[:, :, :p] @ x[:p], motion.rate_hz, motion.cutoff_hz)


def filled_by_model(
    robot: Robot,
    logs: Sequence[Log],
    joints: Sequence[str],
    antiresonance_hz: float,
    rigid_below_hz: float,
) -> list[Log]:
    """Return the logs with joint positions by the load torques of a rigid robot.

    The springs are those with an antiresonance, of the joint with a locked motor, at the given
    frequency. Far below it the robot moves like a rigid one, above it as if its inertia were
    negative. No noise of a torque is in these angles, so that a regression starts well with them.
    """
    shortest_s = min(float(log.time[-1] - log.time[0]) for log in logs)
    lowest_hz = 1.2 * FEWEST_PERIODS / shortest_s
    fit = fit_rigid(robot, logs, joints, max(rigid_below_hz, lowest_hz))
    filled = []
    for log, motions, torques in zip(fit.logs, fit.motions, fit.torques, strict=True):
        angles: list[dict[str, Array]] = [{} for _ in motions]
        for joint in joints:
            index, row = robot.index(joint), fit.model.torque_joints.index(joint)
            rate = fit.inertia[index] * (2 * np.pi * antiresonance_hz) ** 2  # k r_L^2
            for own, motion, torque in zip(angles, motions, torques, strict=True):
                rigid = motion.motor_position[:, index] / total_ratio(robot.drives[joint])
                own[joint] = rigid - torque[:, row] / rate
        filled.append(with_angles(log, motions, angles))
    return filled


def inertia_about(robot: Robot, motion: Motion) -> Array:
    """Return the mean inertia (n,) about each joint while the others are locked."""
    few = motion.samples(slice(None, None, max(1, len(motion.time) // 50)))
    jacobians = torque_jacobians(robot, *few.joint_states)
    inertia = np.mean(np.diagonal(jacobians.acceleration, axis1=1, axis2=2), axis=0)
    return np.asarray(np.abs(inertia))


def hardly_shown(found: Identification, joints: Sequence[str]) -> list[str]:
    """Return the joints whose stiffness is poorly known, or has the wrong sign."""
    drives = ((joint, found.drive_side[joint]) for joint in joints)
    return [
        joint
        for joint, one in drives
        if not one.standard_error("stiffness") < POORLY_KNOWN * one.value("stiffness")
    ]


def resonance_findings(
    found: Identification, joints: Sequence[str], rate_hz: float
) -> Iterator[Finding]:
    """Yield the joints whose stiffness the motor hardly shows, with what would show it."""
    inertia = inertia_about(found.robot, found.motions[0])
    for joint in hardly_shown(found, joints):
        drive, lever = found.drive_side[joint], found.known.drives[joint].load_radius
        k, error = drive.value("stiffness"), drive.standard_error("stiffness")
        spring = abs(k) * lever**2 / inertia[found.known.index(joint)]
        resonance_hz = float(np.sqrt(spring)) / (2 * np.pi)
        needed_hz, larger = SAMPLES * resonance_hz, error / (_WANTED * abs(k))
        rate = f"log at {needed_hz:.3g} Hz or more, " if needed_hz > rate_hz else ""
        yield Finding(
            "hidden-resonance",
            f"the motor torque hardly shows the spring of {joint}: its stiffness is known to "
            f"{error / abs(k):.0%}. The motor feels it most at the antiresonance, about "
            f"{resonance_hz:.3g} Hz, and the motion has a band of {found.cutoff_hz:.3g} Hz",
            joint,
            "doubtful",
            {"antiresonance [Hz]": resonance_hz, "relative standard error": error / abs(k)},
            f"{rate}excite the joint up to {1.3 * resonance_hz:.3g} Hz or with {larger:.2g} times "
            "the amplitude, or log the joint position",
        )
