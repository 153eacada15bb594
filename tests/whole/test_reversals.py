"""Dry friction at reversals, by another simulator: a motor sticks there until its torque turns."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scripts.unseen_robots import (
    ONE_SIDED,
    Plant,
    Run,
    drives_toml,
    logged,
    simulated,
    urdf_of,
)
from seaid.estimation import Estimate
from seaid.estimation.least_squares import ordinary
from seaid.legged import load_robot
from seaid.log import reconstruct_motion
from seaid.regressor import actuator_regression
from seaid.robot import Robot
from tests.plants import log_with

pytestmark = pytest.mark.slow  # 16 s of MuJoCo in steps of 0.1 ms

PLANT = replace(ONE_SIDED, title="shoulder", joints=ONE_SIDED.joints[:1], duration_s=16.0)
DRIVE = PLANT.joints[0].drive
TRUTH = {
    "viscous_friction": DRIVE.viscous,
    "coulomb_friction": DRIVE.coulomb,
    "motor_inertia": DRIVE.motor_inertia,
    "stiffness": DRIVE.stiffness,
}


@pytest.fixture(scope="module")
def run() -> Run:
    return simulated(PLANT, 3)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder: Path = tmp_path_factory.mktemp("robot")
    (folder / "robot.urdf").write_text(urdf_of(PLANT))
    (folder / "drives.toml").write_text(drives_toml(PLANT))
    return load_robot(folder / "robot.urdf", folder / "drives.toml")


def fitted(robot: Robot, run: Run, plant: Plant = PLANT, seed: int = 0) -> Estimate:
    """Return the fit of (7) to a log with the noise and the encoder steps of a plant."""
    columns = logged(plant, run, np.random.default_rng(seed))[0]
    time, motor, joint, torque = columns.values()
    sensors = {"motor_position": motor, "joint_position": joint, "motor_torque": torque}
    motion = reconstruct_motion(robot, log_with(robot.joint_names, time, **sensors), 10.0)
    return ordinary(actuator_regression(robot, motion, robot.joint_names[0]))


def test_reversals_bias_neither_friction_nor_rotor_inertia(robot: Robot, run: Run) -> None:
    perfect = replace(PLANT, torque_noise=0.0, joint_bits=40, motor_counts=2**40)
    estimate = fitted(robot, run, perfect)
    for name, truth in TRUTH.items():
        # With the sign of the filtered speed in place of it the stiffness was 7e-4 off.
        assert estimate.value(name) == pytest.approx(truth, rel=2e-4), name


def test_intervals_of_friction_hold_what_they_promise(robot: Robot, run: Run) -> None:
    inside, draws = Counter[str](), 200
    for seed in range(draws):
        estimate = fitted(robot, run, seed=seed)
        for name, (lower, upper) in zip(estimate.names, estimate.interval(), strict=True):
            inside[name] += name in TRUTH and lower <= TRUTH[name] <= upper
    shares = {name: inside[name] / draws for name in TRUTH}
    assert all(0.92 <= share <= 0.985 for share in shares.values()), shares
