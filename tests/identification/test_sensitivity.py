"""Estimators and cutoffs that contradict each other, and equations without a torque."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.estimation.fitting import EstimatorName
from seaid.identification import Identification, identify
from seaid.identification.sensitivity import difference, fit_of
from seaid.legged import load_robot
from seaid.log import Log
from seaid.regressor import Regression
from seaid.robot import Robot
from seaid.simulation import replay
from tests.experiments import MODELS, arm, arm_log
from tests.plants import log_with, regression
from tests.representatives import quick_first
from tests.standard_errors import check_scores

CODES = ("homogeneous", "cutoff-sensitive")
RATE_HZ = 500.0


@cache
def pendulum() -> Robot:
    """Return the double pendulum with ideal drives."""
    drive: dict[str, Any] = {"type": "stiff", "gear_ratio": 6.0, "friction": []}
    drive["motor_inertia_kg_m2"] = 0.0
    return load_robot(MODELS / "double_pendulum_a0.urdf", {"Joint1": drive, "Joint2": drive})


@cache
def swing() -> Log:
    """Return ten seconds of the pendulum, of which joint 1 alone is driven."""
    time, phases = np.arange(0, 10, 1 / RATE_HZ), np.random.default_rng(0).uniform(0, 6, 6)
    rates = 2 * np.pi * np.linspace(0.2, 1.2, 6)
    torque = 0.3 * np.sum(np.sin(np.outer(time, rates) + phases), axis=1) / 6
    torques = np.column_stack([torque, 0 * torque])
    start = log_with(("Joint1", "Joint2"), time, joint_position=0 * torques, motor_torque=torques)
    return replay(pendulum(), start)


def undriven(noise_rad: float, seed: int = 0) -> Log:
    rng, log = np.random.default_rng(seed), swing()
    return log_with(
        log.joint_names,
        log.time,
        joint_position=log.joint_position + noise_rad * rng.normal(size=log.joint_position.shape),
        motor_torque=log.motor_torque + 5e-3 / 6 * rng.normal(size=log.joint_position.shape),
    )


def flags(found: Identification) -> dict[str, str]:
    return {one.code: one.severity for one in found.warnings if one.code in CODES}


@cache
def at(noise_rad: float, cutoff_hz: float) -> tuple[Identification, Array]:
    """Return an identification, and its values over the true ones."""
    found = identify(pendulum().without_nominal(), undriven(noise_rad), cutoff_hz=cutoff_hz)
    true = found.base.project(pendulum().parameters)
    large = np.abs(true) > 1e-6
    return found, found.load.values[large] / true[large]


def test_undriven_joint_with_a_good_encoder_has_no_flag() -> None:
    found, ratios = at(2e-4, 6.0)
    assert np.all(np.abs(ratios - 1) < 0.02)
    assert not flags(found)


def test_undriven_joint_with_a_noisy_encoder_does_not_end_at_zero() -> None:
    """With the weights of its residual the inertia of link 2 was below 0.01 of the truth."""
    found, ratios = at(1e-3, 12.0)
    assert np.all(ratios > 0.7)
    assert set(flags(found)) >= {"homogeneous", "cutoff-sensitive"}
    (finding,) = [one for one in found.warnings if one.code == "homogeneous"]
    assert finding.joint == "Joint2"
    assert 0.02 < finding.evidence["reduction"] < 0.3
    assert "cutoff_hz=6" in finding.remedy
    assert np.all(np.abs(at(1e-3, 6.0)[1] - 1) < 0.03)
    assert flags(at(3e-3, 12.0)[0])["homogeneous"] == "wrong"  # a strong pull to zero


def test_a_wider_cutoff_is_named_with_both_values() -> None:
    found, _ = at(3e-3, 12.0)
    named = {one.code: one for one in found.warnings}
    sensitive = named["cutoff-sensitive"]
    assert sensitive.message.startswith("a cutoff of 12 Hz and a cutoff of 19.2 Hz give different")
    assert named["homogeneous"].remedy.startswith("cutoff_hz=6")  # the cause
    assert sensitive.evidence["standard errors"] > 5
    assert len(sensitive.evidence) == 3
    ols = identify(pendulum().without_nominal(), undriven(3e-3), cutoff_hz=12.0, estimator="ols")
    assert any(one.code == "cutoff-sensitive" for one in ols.warnings)
    estimators: tuple[EstimatorName, ...] = ("iv", "huber")
    for name in estimators:
        log = undriven(3e-3)
        other = identify(pendulum().without_nominal(), log, cutoff_hz=6.0, estimator=name)
        assert not flags(other)


@pytest.mark.parametrize("seed", quick_first(range(3)))
def test_right_set_up_has_no_flag(seed: int) -> None:
    log = arm_log(seed)
    assert not flags(identify(arm().without_nominal(), log))


def rows(seed: int, every: int) -> Regression:
    """Return each `every`-th instant of two equations with autocorrelated noise."""
    rng = np.random.default_rng(seed)
    H = np.random.default_rng(1).normal(size=(600, 2, 3))
    H = H + np.roll(H, 1, axis=0) + np.roll(H, 2, axis=0)
    noise = rng.normal(size=(600, 2)) * [1.0, 5.0]
    noise = noise + np.roll(noise, 1, axis=0) + np.roll(noise, 2, axis=0)
    known = rng.normal(size=2)  # a value with an error, from which the targets are computed
    by = np.random.default_rng(2).normal(size=(600, 2, 2))
    y = H @ np.ones(3) + noise + by @ known
    picked = slice(None, None, every)
    return regression(
        H[picked].reshape(-1, 3),
        y[picked].ravel(),
        joint=np.tile([0.0, 1.0], len(H[picked])),
        time=np.repeat(np.arange(600)[picked] * 0.1, 2),
        propagated=by[picked].reshape(-1, 2),
    )


EQUAL, WEIGHTED = np.ones(2), np.array([5.0, 1.0])


@pytest.mark.slow  # 0.8 s
@pytest.mark.parametrize(
    "ways", [((1, WEIGHTED), (1, EQUAL)), ((1, EQUAL), (2, EQUAL))], ids=["weights", "rows"]
)
def test_a_difference_is_as_large_as_its_errors_say(ways: tuple[tuple[int, Array], ...]) -> None:
    """Of weighted and ordinary rows, and of all rows and every other one."""
    scores = []
    for seed in range(150):
        fits = [fit_of(rows(seed, every), weights) for every, weights in ways]
        change, errors = difference(fits, np.eye(2))
        scores.append(change / errors)
    check_scores(scores, band=1.2)
