"""Instruments from the fitted model, and what they do to noisy encoders."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.checks.values import noise_findings
from seaid.errors import IdentificationError
from seaid.estimation.fitting import ESTIMATORS, EstimatorName
from seaid.identification import identify
from seaid.identification.instrumental import (
    FittedModel,
    actuator_with_instruments,
    estimate_instrumental,
    instrument_motion,
    load_with_instruments,
    split_instruments,
)
from seaid.identification.joint_dynamics import finer_side
from seaid.identification.stacked_fits import RobotEstimate
from seaid.identification.two_step import ONLY, Condition, estimate_two_step
from seaid.legged import load_robot
from seaid.log import Motion, reconstruct_motion
from seaid.regressor import actuator_regression, base_parameters, load_regression
from seaid.regressor.load import LoadModel, load_model
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import DATA, drive_errors, perfect_log, wiggle
from tests.representatives import quick_first

TRUTH = load_robot(
    DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml", joints=("wrist", "telescope", "shoulder")
)
"""A stiff joint and two springs, one of them prismatic, not in the order of the chain."""


@cache
def true_motion() -> Motion:
    trajectory = wiggle(TRUTH, 6.0, (0.0, 0.15, 0.3), (0.9, 0.2, 0.8), seed=1)
    return simulate_motion(TRUTH, trajectory, rate_hz=500.0)


@cache
def noise_free() -> tuple[Robot, LoadModel, Motion, FittedModel, RobotEstimate]:
    """Return what perfect sensors tell of the arm."""
    robot = TRUTH.without_nominal()
    model = load_model(robot, base_parameters(robot), robot.joint_names)
    motion = reconstruct_motion(robot, perfect_log(TRUTH, true_motion()), 8.0)
    sides = estimate_two_step(
        {ONLY: Condition(robot, [motion], robot.joint_names)}, ESTIMATORS["wls"]
    ).of(ONLY)
    springs = dict(sides.springs)
    return robot, model, motion, FittedModel(model, sides.load_side.values, springs), sides


def test_without_noise_the_instruments_are_the_columns() -> None:
    """As far as the narrow band leaves the motion alone."""
    robot, model, motion, fitted, sides = noise_free()
    for joint in robot.elastic_joints:
        rows, Z = split_instruments(actuator_with_instruments(robot, motion, joint, fitted))
        plain = actuator_regression(robot, motion, joint)
        assert rows.names == plain.names
        assert np.array_equal(rows.H, plain.H)
        off = np.linalg.norm(Z - rows.H, axis=0) / np.linalg.norm(rows.H, axis=0)
        assert np.all(off < 0.3)
    both = load_with_instruments(robot, motion, sides.springs, fitted)
    rows, Z = split_instruments(both)
    plain = load_regression(robot, motion, model, sides.springs)
    assert np.array_equal(rows.H, plain.H)
    assert rows.H.shape == Z.shape
    off = np.linalg.norm(Z - rows.H, axis=0) / np.linalg.norm(rows.H, axis=0)
    assert np.median(off) < 0.1


def test_spring_carries_the_torque_of_the_fitted_bodies() -> None:
    robot, model, motion, fitted, _ = noise_free()
    made = instrument_motion(robot, motion, fitted)
    springs = {joint: np.array(spring) for joint, spring in fitted.springs.items()}
    rows = load_regression(robot, made, model, springs)
    for joint in springs:
        mine = rows.joint == robot.index(joint)
        residual = rows.y[mine] - rows.H[mine] @ fitted.load_side
        assert np.max(np.abs(residual)) < 1e-9 * np.max(np.abs(rows.y[mine]))


def test_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, _, motion, _, sides = noise_free()
    log = perfect_log(TRUTH, true_motion())
    with pytest.raises(IdentificationError, match='estimator="iv" needs method="two-step"'):
        identify(robot, log, estimator="iv", method="simultaneous")
    with pytest.raises(IdentificationError, match="did you mean 'iv'"):
        identify(robot, log, estimator="ivv")  # type: ignore[arg-type]
    run = partial(estimate_instrumental, Condition(robot, [motion], robot.joint_names))
    joint = robot.elastic_joints[0]
    drive = sides.drives[joint]
    flipped = replace(drive, values=-drive.values)
    with pytest.raises(IdentificationError, match=f"stiffness of {joint} is not positive"):
        run(replace(sides, drives={**sides.drives, joint: flipped}))
    monkeypatch.setattr("seaid.identification.instrumental._MOST_ITERATIONS", 1)
    away = replace(drive, values=0.5 * drive.values)
    with pytest.raises(IdentificationError, match=r"did not converge in 1 iterations: .* changes"):
        run(replace(sides, drives={**sides.drives, joint: away}))


# The encoders of stiff joints, and those of springs.


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize("side", quick_first(["joint", "motor"]))
def test_stiff_joint_moves_with_its_finer_encoder(side: str) -> None:
    robot, _, motion, _, _ = noise_free()
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


def errors_of(estimator: EstimatorName, seed: int) -> tuple[Array, Array]:
    """Return the errors of bodies and springs with white noise on the joint encoders."""
    rng = np.random.default_rng(seed)
    offsets = tuple(rng.uniform(-3, 3, 3))
    noise = Noise(2 * np.pi / 2000, motor_offset_rad=offsets, torque_std_Nm=0.003)
    log = measure(TRUTH, true_motion(), noise, seed)
    off = rng.normal(size=log.joint_position.shape) * [0.0, 5e-4, 5e-3]
    log = replace(log, joint_position=log.joint_position + off)
    found = identify(TRUTH.without_nominal(), log, estimator=estimator, cutoff_hz=12.0)
    # The bias of least squares follows the motion: to the fit it is a slow error of the torque.
    codes = {one.code for one in noise_findings(found.load)}
    assert codes <= {"drift" if estimator == "wls" else "weak-instruments"}
    springs = drive_errors(found, TRUTH, "stiffness").values()
    return found.load.values - found.base.project(TRUTH.parameters), np.array([*springs])


@pytest.mark.slow  # three logs, each by both estimators
@pytest.mark.usefixtures("estimates_only")
def test_noisy_joint_encoders_bias_the_bodies_and_springs_of_least_squares_only() -> None:
    """A wide pass band lets their noise into the deflection; the mean errors of some draws."""
    draws = [[errors_of(estimator, seed) for seed in range(3)] for estimator in ("wls", "iv")]
    (plain, soft), (freed, right) = (
        [np.mean(errors, axis=0) for errors in zip(*each, strict=True)] for each in draws
    )
    assert np.linalg.norm(freed) < 0.3 * np.linalg.norm(plain)
    worst = int(np.argmax(np.abs(soft)))
    assert soft[worst] < -0.01
    assert abs(right[worst]) < 0.4 * abs(soft[worst])
