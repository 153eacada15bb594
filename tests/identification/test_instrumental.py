"""Instruments from the fitted model, and what they do to noisy encoders."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from seaid.errors import IdentificationError
from seaid.estimation import EstimatorName
from seaid.estimation.fitting import ESTIMATORS
from seaid.identification.identification import identify
from seaid.identification.instrumental import (
    FittedModel,
    actuator_with_instruments,
    estimate_instrumental,
    instrument_motion,
    load_with_instruments,
    split_instruments,
)
from seaid.identification.stacked_fits import RobotEstimate
from seaid.identification.two_step import Condition, estimate_two_step
from seaid.log.motion import Motion, reconstruct_motion
from seaid.regressor.base import base_parameters
from seaid.regressor.load import LoadModel, load_model, load_regression
from seaid.regressor.regression import actuator_regression
from seaid.robot.robot import Robot
from seaid.simulation.simulation import Noise, measure, simulate
from tests.experiments import ARM_SENSORS, arm, arm_motion, drive_errors, perfect_log, wiggle
from tests.terms import STIFF
from tests.terms import arm as two_joints


@cache
def noise_free() -> tuple[Robot, LoadModel, Motion, FittedModel, RobotEstimate]:
    """Return what perfect sensors tell of the mixed arm."""
    robot = arm().without_nominal()
    model = load_model(robot, base_parameters(robot), robot.joint_names)
    motion = reconstruct_motion(robot, perfect_log(arm(), arm_motion()))
    sides = estimate_two_step({"": Condition(robot, [motion], model)}, ESTIMATORS["wls"]).of("")
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
    rows, Z = split_instruments(load_with_instruments(robot, motion, model, sides.springs, fitted))
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


@pytest.mark.slow  # four logs, each by a search for instruments
def test_coarse_joint_encoders_bias_least_squares_more() -> None:
    """A wide pass band lets their noise into the deflection; the mean error of some draws."""
    known = arm().without_nominal()
    plain: list[list[float]] = []
    freed: list[list[float]] = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        noise = replace(ARM_SENSORS, motor_offset_rad=tuple(rng.uniform(-3, 3, 4)))
        log = measure(arm(), arm_motion(), noise, seed)
        position = log.joint_position + 2e-2 * rng.normal(size=log.joint_position.shape) * (
            [0.02, 1.0, 0.02, 1.0]
        )
        log = replace(log, joint_position=position)
        cases: list[tuple[EstimatorName, list[list[float]]]] = [("wls", plain), ("iv", freed)]
        for name, errors in cases:
            found = identify(known, log, estimator=name, cutoff_hz=8.0)
            errors.append(list(drive_errors(found, arm(), "stiffness").values()))
    worst = int(np.argmax(np.abs(np.mean(plain, axis=0))))
    assert np.mean(plain, axis=0)[worst] < -0.01
    assert abs(np.mean(freed, axis=0)[worst]) < 0.4 * abs(np.mean(plain, axis=0)[worst])


@pytest.mark.slow  # a search for instruments in the log of the arm
def test_stiff_drives_have_no_instruments_and_that_is_said(tmp_path: Path) -> None:
    robot = two_joints(tmp_path, STIFF, STIFF)
    sensors = Noise(motor_resolution_rad=2 * np.pi / 2**10, torque_std_Nm=0.001)
    trajectory = wiggle(robot, 4.0, (0.0, 0.0), (1.2, 1.5))
    log = simulate(robot, trajectory, rate_hz=250.0, noise=sensors, seed=1)
    plain, found = (
        identify(robot.without_nominal(), log, estimator=name) for name in ("wls", "iv")
    )
    assert found.load.values == pytest.approx(plain.load.values, rel=1e-9)
    assert [one for one in map(str, found.warnings) if "have no effect" in one]


def test_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, model, motion, _, sides = noise_free()
    log = measure(arm(), arm_motion(), Noise(torque_std_Nm=0.01), 0)
    with pytest.raises(IdentificationError, match='estimator="iv" needs method="two-step"'):
        identify(robot, log, estimator="iv", method="simultaneous")
    with pytest.raises(IdentificationError, match="did you mean 'iv'"):
        identify(robot, log, estimator="ivv")  # type: ignore[arg-type]
    run = partial(estimate_instrumental, robot, [motion], model)
    joint = robot.elastic_joints[0]
    drive = sides.drives[joint]
    flipped = replace(drive, values=-drive.values)
    with pytest.raises(IdentificationError, match=f"stiffness of {joint} is not positive"):
        run(replace(sides, drives={**sides.drives, joint: flipped}), None)
    monkeypatch.setattr("seaid.identification.instrumental._MOST_ITERATIONS", 1)
    away = replace(drive, values=0.5 * drive.values)
    with pytest.raises(IdentificationError, match=r"did not converge in 1 iterations: .* changes"):
        run(replace(sides, drives={**sides.drives, joint: away}), None)
