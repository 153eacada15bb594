"""The leg with its test mass, a log and a plan of it, for tests of what is shown."""

import numpy as np

from seaid.excitation import Trajectory
from seaid.log import Log
from seaid.robot import Robot
from tests.plants import polynomial_trajectory


def log_of(robot: Robot) -> Log:
    """Return 2 s of waves, with deflections of 0.01 rad at the hip, 0.02 at the knee, ..."""
    t = np.linspace(0.0, 2.0, 201)[:, None]
    joint = 0.3 + 0.2 * np.sin((1.0 + np.arange(robot.n)) * t)
    deflection = 0.01 * np.arange(-1, robot.n - 1) * np.cos(np.pi * t)
    drives = [robot.drives[name] for name in robot.joint_names]
    levers = [one.load_radius / one.motor_radius for one in drives]
    motor = (joint + deflection) * np.multiply([one.ratio for one in drives], levers)
    return Log(t[:, 0], robot.joint_names, motor, joint, np.full(joint.shape, np.nan))


def plan_of(robot: Robot) -> Trajectory:
    """Return a motion of 1 s, from rest to rest."""
    powers = np.zeros((4, robot.n))
    powers[0], powers[2], powers[3] = 0.1, 0.6, -0.4
    return polynomial_trajectory(robot.joint_names, 1.0, powers)
