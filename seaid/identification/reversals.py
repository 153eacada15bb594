"""At which reversals a joint with position commands may stick: by its friction and inertia."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seaid.identification.datasets import Dataset, first_motion
from seaid.identification.simulated_joints import torque_jacobians
from seaid.log import Motion, with_directions
from seaid.robot import Robot

_POSES = 20
"""Poses of a motion in which the inertia at a joint is computed."""

_LEVELS = ("coulomb_friction", "stribeck_friction")


def with_passed_reversals(robot: Robot, datasets: Sequence[Dataset], found: Robot) -> list[Dataset]:
    """Return the datasets of a robot whose joints may stick where a first estimate lets them.

    Motions that are read in pieces keep all of their reversals excluded.
    """
    if not robot.has_controllers or robot.floating_base is not None:
        return list(datasets)
    dry = _dry_accelerations(found, first_motion(datasets[0]))
    return [with_directions(robot, x, dry) if isinstance(x, Motion) else x for x in datasets]


def _dry_accelerations(robot: Robot, motion: Motion) -> dict[str, float]:
    """Return the motor acceleration of dry friction alone, {joint: level / inertia}.

    The inertia I + M / N^2 is that of rotor and joint, whose other joints move as they do.
    """
    poses = np.linspace(0, len(motion.time) - 1, _POSES).astype(int)
    states = [state[poses] for state in motion.joint_states]
    jacobians = torque_jacobians(robot, *states).at_drives(robot.transmission)
    inertia = np.median(np.einsum("tii->ti", jacobians.acceleration), axis=0)
    found = {}
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        values = drive.values
        level = sum(abs(values.get(name, 0.0)) for name in _LEVELS)
        load = 0.0 if drive.is_elastic else float(inertia[index]) / drive.ratio**2
        own = values.get("motor_inertia", 0.0) + load
        if level > 0 and own > 0:
            found[joint] = level / own
    return found
