"""Columns that drives bring to the load side (8): stiff ones, and what acts beside any."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from seaid.arrays import Array
from seaid.drive_signals import joint_regressor, motor_regressor, signals
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.motion import Motion
from seaid.robot import Robot
from seaid.transmission import at_drives, torques_at_drives

_JOINT = ("theta_L", "theta_L_dot", "theta_L_ddot")


def drive_columns(
    robot: Robot, rows: Sequence[str], signals_of: Callable[[int], dict[str, Array]]
) -> tuple[Array, list[tuple[str, str, str]]]:
    """Return the drives' columns (T, rows, columns) on the load side, and what they are.

    Those of stiff drives, and of what acts beside any drive between the joint's bodies.
    """
    blocks, drives = [], []
    known = [robot.index(joint) for joint in rows]
    for joint in robot.joint_names:
        index, drive = robot.index(joint), robot.drivetrains[joint]
        parts = []
        if not isinstance(drive, SeriesElasticDrive) and index in known:
            parts.append((motor_regressor(robot, joint), drive.ratio, np.eye(robot.n)[index]))
        if drive.parallel_spring or getattr(drive, "joint_friction", ()):
            at_drive = torques_at_drives(robot.transmission, np.eye(robot.n)[index])
            parts.append((joint_regressor(robot, joint), 1.0, at_drive))
        for regressor, factor, share in parts:
            by_name = signals_of(index)
            if regressor is not motor_regressor(robot, joint):
                by_name = {**by_name, **{name: by_name[f"own_{name}"] for name in _JOINT}}
            R = factor * regressor.evaluate(by_name)[1]
            blocks.append(R[:, None, :] * share[known][None, :, None])
            drives += [
                (joint, name, unit)
                for name, unit in zip(regressor.names, regressor.units, strict=True)
            ]
    length = len(next(iter(signals_of(0).values())))
    return np.concatenate([*blocks, np.empty((length, len(rows), 0))], axis=2), drives


def load_signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return the signals of a drive, and the states of its own joint as own_theta_L."""
    own = {
        f"own_{name}": values[:, index]
        for name, values in zip(_JOINT, motion.joint_states, strict=True)
    }
    return signals(robot, motion, index) | own


def stiff_signals(robot: Robot, index: int, q: Array, v: Array, a: Array) -> dict[str, Array]:
    """Return the signals of a stiff drive at joint states: the motor turns with its joints.

    What is independent of them, current, voltage and the torque through the gear, is random.
    """
    ratio, nothing = robot.drivetrains[robot.joint_names[index]].ratio, np.zeros(len(q))
    own = {f"own_{name}": values[:, index] for name, values in zip(_JOINT, (q, v, a), strict=True)}
    rng = np.random.default_rng(index)
    free = {name: rng.normal(size=len(q)) for name in ("i_M", "u_M", "tau_G")}
    states = {"theta_L": q, "theta_L_dot": v, "theta_L_ddot": a}
    joint = {
        name: at_drives(robot.transmission, values)[:, index] for name, values in states.items()
    }
    motor = {name.replace("_L", "_M"): ratio * values for name, values in joint.items()}
    return {**joint, **motor, **own, **free, "tau_M": nothing, "tau_L": nothing}
