"""Robots that planning must work for: reordered, sliding, loaded, without nominal values."""

import pickle
import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest

from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.excitation import Excitation, FourierBasis, Trajectory, design_excitation
from seaid.excitation.basis import matrices
from seaid.excitation.limits import JointLimits
from seaid.excitation.observation_matrix import Target, regressor_pull_back, stacked_regressor
from seaid.legged import load_robot
from seaid.robot import Payload, Robot
from tests.experiments import MODELS, States

PANDA = [f"panda_joint{i}" for i in range(1, 8)]
TIAGO = ["torso_lift_joint", *(f"arm_{i}_joint" for i in range(1, 8))]


def example_robot(name: str, **options: Any) -> Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the files' rounded angles are another test's matter
        return load_robot(example_urdf(name), **options)


@cache
def robots() -> dict[str, Robot]:
    """Return the robots by name."""
    payload = Payload("wrist_3_link", 2.0, (0.1, 0.0, 0.05))
    return {
        "leg": load_robot(MODELS / "tulip_leg.urdf"),
        "pendulum": load_robot(MODELS / "xl330_pendulum.urdf"),
        "ur5": example_robot("ur5_robot.urdf", payloads=[payload]),
        "panda_reordered": example_robot("panda.urdf", joints=PANDA[::-1]),
        "tiago_prismatic": example_robot("tiago_no_hand.urdf", joints=TIAGO),
        "ur10_nominal_unknown": example_robot("ur10_robot.urdf").without_nominal(),
    }


def plan(robot: Robot, duration: float = 4.0, **options: Any) -> Excitation:
    """Plan with a small budget; that it was too small to settle is no news here."""
    quick: dict[str, Any] = {"starts": 2, "iterations": 12, "coefficients": 10}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "the search for an excitation ended early")
        return design_excitation(robot, duration, **(quick | options))


def assert_kept(motion: Trajectory, bounds: JointLimits, rate_hz: float) -> States:
    """Assert that no limit is broken by more than 1e-9 at any sample, and return these."""
    time = np.append(np.arange(0.0, motion.duration, 1 / rate_hz), motion.duration)
    q, v, a = motion.sample(time)
    for value, most in (
        (q - bounds.middle, bounds.half_range),
        (v, bounds.velocity),
        (a, bounds.acceleration),
    ):
        assert np.all(np.abs(value) <= most + 1e-9 * np.minimum(1.0, most))
    return q, v, a


def smooth_motion(robot: Robot, samples: int = 60, reach: float = 0.1) -> tuple[Array, States]:
    """Return a motion whose time derivatives are smooth, at equally spaced times."""
    basis = FourierBasis(4, 5.0)
    c = reach * np.random.default_rng(0).normal(size=(basis.size, robot.n))
    time = np.linspace(0.0, 4.9, samples)
    q, v, a = (matrix @ c for matrix in matrices(basis, time))
    return time, (q, v, a)


def assert_gradient(target: Target, time: Array, motion: States) -> None:
    rng = np.random.default_rng(1)
    H = stacked_regressor(target, time, motion)
    again = pickle.loads(pickle.dumps(target))  # as it goes to another process
    np.testing.assert_array_equal(stacked_regressor(again, time, motion), H)
    sizes = np.linalg.norm(H, axis=0)
    W = rng.normal(size=H.shape) / sizes
    gradient = regressor_pull_back(target, time, motion, W)
    wave = matrices(FourierBasis(6, 1.1 * float(time[-1])), time)[0]
    for which in range(3):
        direction = wave @ rng.normal(size=(wave.shape[1], motion[0].shape[1]))
        step, sums = 1e-6, []
        for sign in (1, -1):
            moved = list(motion)
            moved[which] = motion[which] + sign * step * direction
            sums.append(np.sum(stacked_regressor(target, time, (moved[0], moved[1], moved[2])) * W))
        assert np.sum(gradient[which] * direction) == pytest.approx(
            (sums[0] - sums[1]) / (2 * step), rel=1e-6
        )
