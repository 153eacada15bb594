"""Joints driven by the fitted model: where they go, and whose noise they have."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.checks import noise_findings
from seaid.errors import IdentificationError
from seaid.estimation import EstimatorName
from seaid.estimation.fitting import ESTIMATORS
from seaid.identification.identification import identify
from seaid.identification.instrumental import FittedModel, driven_motion, estimate_instrumental
from seaid.identification.simulated_joints import finer_side
from seaid.identification.stacked_fits import RobotEstimate
from seaid.identification.two_step import Condition, estimate_two_step
from seaid.legged import load_robot
from seaid.log.motion import Motion, reconstruct_motion
from seaid.regressor.base import base_parameters
from seaid.regressor.load import LoadModel, load_columns, load_model
from seaid.robot.robot import Robot
from seaid.simulation.simulation import Noise, measure, simulate_motion
from tests.experiments import DATA, perfect_log, wiggle
from tests.representatives import quick_first

SPRINGS = ("shoulder", "telescope")
TRUTH = load_robot(
    DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml", joints=("wrist", "telescope", "shoulder")
)
"""A stiff joint and two springs, one of them prismatic, not in the order of the chain."""


@cache
def true_motion() -> Motion:
    trajectory = wiggle(TRUTH, 6.0, (0.0, 0.15, 0.3), (0.9, 0.2, 0.8), seed=1)
    return simulate_motion(TRUTH, trajectory, rate_hz=500.0)


@cache
def noise_free() -> tuple[Robot, LoadModel, Motion, RobotEstimate]:
    """Return what perfect sensors tell."""
    robot = TRUTH.without_nominal()
    model = load_model(robot, base_parameters(robot), robot.joint_names)
    motion = reconstruct_motion(robot, perfect_log(TRUTH, true_motion()), 8.0)
    sides = estimate_two_step({"": Condition(robot, [motion], model)}, ESTIMATORS["wls"]).of("")
    return robot, model, motion, sides


def driven(motion: Motion) -> Motion:
    robot, model, _, sides = noise_free()
    return driven_motion(robot, motion, FittedModel(model, sides.load_side.values, sides.springs))


def inside(motion: Motion, values: Array) -> Array:
    """Return the samples that are not left away at the ends."""
    trim = round(motion.transient_s * motion.rate_hz)
    return values[trim:-trim]


@pytest.mark.slow  # 2.1 s
def test_perfect_motors_drive_the_joints_to_where_they_were() -> None:
    motion = noise_free()[2]
    made = driven(motion)
    for name, share in (("position", 1e-3), ("velocity", 0.01), ("acceleration", 0.1)):
        was = inside(motion, getattr(motion, f"joint_{name}"))
        off = inside(motion, getattr(made, f"joint_{name}")) - was
        assert np.all(np.std(off, axis=0) < share * np.std(was, axis=0))
    assert np.array_equal(made.motor_velocity, motion.motor_velocity)


@pytest.mark.slow  # simulates joints in windows of a log
def test_joints_obey_the_fitted_model_in_every_window() -> None:
    robot, model, motion, sides = noise_free()
    made = driven(motion)
    torque, payload, H, _ = load_columns(robot, made, model, sides.springs)
    residual = torque - payload - H @ sides.load_side.values
    rows = [model.torque_joints.index(joint) for joint in SPRINGS]
    assert np.all(np.std(residual[:, rows], axis=0) < 1e-4 * np.std(torque[:, rows], axis=0))


def in_rows(motion: Motion, name: str) -> Array:
    return inside(motion, getattr(driven(motion), f"joint_{name}"))


@pytest.mark.slow  # simulates joints in windows of a log
def test_noise_of_the_joint_encoders_stays_outside() -> None:
    """But for the initial states: four numbers a window, of which there are five periods each."""
    motion = noise_free()[2]
    joints = [TRUTH.index(joint) for joint in SPRINGS]
    noise = np.zeros_like(motion.joint_position)
    noise[:, joints] = 1e-3 * np.random.default_rng(0).normal(size=(len(noise), 2))
    noisy = replace(
        motion,
        joint_position=motion.joint_position + noise,
        joint_velocity=motion.joint_velocity + 100 * noise,
        joint_acceleration=motion.joint_acceleration + 1e4 * noise,
    )
    moved = in_rows(noisy, "position") - in_rows(motion, "position")
    assert np.all(np.std(moved, axis=0)[joints] < 0.1 * 1e-3)
    accelerated = in_rows(noisy, "acceleration") - in_rows(motion, "acceleration")
    assert np.all(np.std(accelerated, axis=0)[joints] < 0.01 * 10.0)


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize("side", quick_first(["joint", "motor"]))
def test_stiff_joint_moves_with_its_finer_encoder(side: str) -> None:
    robot, _, motion, _ = noise_free()
    wrist, ratio = robot.index("wrist"), robot.drives["wrist"].ratio
    noise = np.zeros_like(motion.joint_position)
    noise[:, wrist] = 50 * np.random.default_rng(0).normal(size=len(noise))
    shifted = motion.motor_position.copy()
    shifted[:, wrist] += 3.0
    motion = replace(motion, motor_position=shifted)
    noisy = replace(
        motion, **{f"{side}_acceleration": getattr(motion, f"{side}_acceleration") + ratio * noise}
    )
    made = finer_side(robot, noisy)
    turned = motion.motor_acceleration[:, wrist] / ratio
    expected = turned if side == "joint" else motion.joint_acceleration[:, wrist]
    assert np.array_equal(made.joint_acceleration[:, wrist], expected)
    middle = np.mean(motion.joint_position[:, wrist])
    assert np.mean(made.joint_position[:, wrist]) == pytest.approx(middle, abs=1e-12)


@pytest.mark.slow  # simulates joints in windows of a log
def test_a_model_that_cannot_be_simulated() -> None:
    """Bodies with negative inertia run away from the motors."""
    robot, model, motion, sides = noise_free()
    with pytest.raises(IdentificationError, match=r"diverges when it is driven .* lower cutoff_hz"):
        driven_motion(
            robot, motion, FittedModel(model, -1e-3 * sides.load_side.values, sides.springs)
        )


def base_errors(estimator: EstimatorName, seed: int) -> Array:
    """Return the errors of the base parameters with white noise on the joint encoders."""
    rng = np.random.default_rng(seed)
    noise = Noise(
        motor_resolution_rad=2 * np.pi / 2000,
        motor_offset_rad=tuple(rng.uniform(-3, 3, 3)),
        torque_std_Nm=0.003,
    )
    log = measure(TRUTH, true_motion(), noise, seed)
    off = rng.normal(size=log.joint_position.shape) * [0.0, 5e-4, 5e-3]
    log = replace(log, joint_position=log.joint_position + off)
    found = identify(TRUTH.without_nominal(), log, estimator=estimator, cutoff_hz=12.0)
    # The bias of least squares follows the motion: to the fit it is a slow error of the torque.
    codes = {one.code for one in noise_findings(found.load)}
    assert codes <= ({"drift"} if estimator == "wls" else set())
    return np.asarray(found.load.values - found.base.project(TRUTH.parameters))


@pytest.mark.slow  # three logs, each by both estimators
def test_noisy_joint_encoders_bias_the_bodies_of_least_squares_only() -> None:
    plain, freed = (
        np.mean([base_errors(estimator, seed) for seed in range(3)], axis=0)
        for estimator in ("wls", "iv")
    )
    assert np.linalg.norm(freed) < 0.3 * np.linalg.norm(plain)


@pytest.mark.slow  # simulates joints in windows of a log
def test_where_the_model_diverges_the_smoothed_motion_stays_and_a_flag_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot, model, motion, sides = noise_free()

    def diverges(*_: object) -> Motion:
        raise IdentificationError("the fitted model diverges")

    monkeypatch.setattr("seaid.identification.instrumental.driven_motion", diverges)
    found = estimate_instrumental(robot, [motion], model, sides, None)
    (finding,) = found.findings
    assert finding.message.startswith("the instruments of the load side come from the smoothed")
    assert finding.message.endswith("the fitted model diverges")
