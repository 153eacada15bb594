"""How long the steps of an exported model may be."""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg

from seaid.drivetrain.model import SeriesElasticDrive
from seaid.errors import RobotError
from seaid.export.mjcf_bodies import TINY
from seaid.forward.inertia_matrix import mass_matrix
from seaid.linear_algebra import safely
from seaid.robot import Robot

_LONGEST_S, _SHORTEST_S = 1e-3, 1e-6
_STEPS_A_RADIAN = 20.0
"""Steps in the time in which the fastest spring swings by one radian."""


def step_s(robot: Robot) -> tuple[float, str]:
    """Return a time step [s] that resolves the fastest spring and damper, and that in words.

    Values that are missing count as zero here; whoever needs them refuses.
    """
    fastest = float(np.max(np.abs(_rates(robot)), initial=0.0))
    wanted = min(_LONGEST_S, 1 / (_STEPS_A_RADIAN * max(fastest, TINY)))
    step = max(_round_down(wanted), _SHORTEST_S)
    return step, (
        f"integrator RK4 with steps of {step:g} s: springs and dampers are as fast as "
        f"{fastest:.3g} rad/s (at the zero position)"
    )


def _rates(robot: Robot) -> np.ndarray:
    """Return the eigenvalues [1/s] of joints and motors at zero, without gravity."""
    n, C = robot.n, robot.transmission
    order = np.argsort(robot.model_order)
    model = robot.model.copy()
    model.armature = np.zeros(n)
    mass, spring, damping = (np.zeros((2 * n, 2 * n)) for _ in range(3))
    mass[:n, :n] = mass_matrix(model, model.createData(), np.zeros(n))[np.ix_(order, order)]
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drivetrains[joint]
        values = drive.values
        at_joint, at_motor = np.zeros(2 * n), np.zeros(2 * n)
        at_joint[:n], at_motor[n + index] = C[index], 1.0
        if isinstance(drive, SeriesElasticDrive):
            stretch = drive.motor_radius / drive.ratio * at_motor - drive.load_radius * at_joint
            spring += values.get("stiffness", 0.0) * np.outer(stretch, stretch)
            damping += values.get("spring_damping", 0.0) * np.outer(stretch, stretch)
        else:
            mass[n + index, n + index] = 1.0  # no motor of its own
            at_motor = drive.ratio * at_joint
        mass += values.get("motor_inertia", 0.0) * np.outer(at_motor, at_motor)
        damping += values.get("viscous_friction", 0.0) * np.outer(at_motor, at_motor)
        spring[index, index] += values.get("parallel_stiffness", 0.0)
        damping[index, index] += values.get("joint_viscous_friction", 0.0)
    mass += TINY * np.eye(2 * n)
    below = -safely(
        scipy.linalg.solve,
        mass,
        np.hstack([spring, damping]),
        what="the step of the simulation",
        error=RobotError,
        assume_a="sym",
    )
    above = np.hstack([np.zeros_like(mass), np.eye(2 * n)])
    return np.asarray(
        safely(
            np.linalg.eigvals,
            np.vstack([above, below]),
            what="the step of the simulation",
            error=RobotError,
        )
    )


def _round_down(step: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not more than a step."""
    power = 10.0 ** math.floor(math.log10(step) + 1e-9)
    return float(f"{max(m for m in (1, 2, 5) if m * power <= step * (1 + 1e-9)) * power:g}")
