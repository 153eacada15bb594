"""A planned second gain set determines armature and delay as well as the plan says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seaid
from seaid.errors import IdentificationError
from seaid.identification.gain_sets import _free, _noisy, _with_drives
from seaid.simulation import rollout
from tests.cli.test_cli import done
from tests.cli.test_cli import run as said
from tests.identification.test_position_commands import (
    SOFT,
    URDF,
    mujoco_log,
    robot_of,
    values_of,
)

NOISE = 3e-3
DELAY_S = 0.005


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gains") / "one.urdf"
    path.write_text(URDF)
    return path


@pytest.fixture(scope="module")
def first() -> seaid.Log:
    return mujoco_log(SOFT, DELAY_S, NOISE, 0).between(0, 10)


@pytest.fixture(scope="module")
def found(urdf: Path, first: seaid.Log) -> seaid.Identification:
    return seaid.identify(robot_of(urdf, SOFT), first)


@pytest.fixture(scope="module")
def plan(found: seaid.Identification, first: seaid.Log) -> seaid.identification.GainSetPlan:
    return seaid.plan_gain_set(found, first, gain_factors=[(0.5, 1.0)])


@pytest.mark.slow  # simulates candidates of a motion
def test_the_second_set_determines_more_than_the_first(
    plan: seaid.identification.GainSetPlan,
) -> None:
    best = plan.candidates[0]
    assert best.armature_errors["j"] < 0.5 * plan.armature_errors["j"]
    assert best.delay_error_s < 0.5 * plan.delay_error_s
    errors = [one.armature_errors["j"] for one in plan.candidates]
    assert errors == sorted(errors)
    assert plan.model_error < 1.1  # MuJoCo's plant is the model
    assert best.controllers["j"].position_gain_Nm_per_rad == 20.0
    assert "delay within" in repr(plan)
    assert "first log alone" in plan.summary()


@pytest.mark.slow  # 24 experiments
def test_the_scatter_of_experiments_is_the_predicted_standard_error(
    found: seaid.Identification, first: seaid.Log, plan: seaid.identification.GainSetPlan
) -> None:
    """With noise of the encoder alone; within 1.3, of which the scatter of 24 has 15 %."""
    best = plan.candidates[0]
    free = _with_drives(found.known, _free)
    second = free.with_drives({"j": replace(free.drives["j"], controller=best.controllers["j"])})
    clean = rollout(found.robot, first, longest_closed_s=2.5e-3)
    values, noise = [], np.array([NOISE])
    for seed in range(24):
        rng = np.random.default_rng(seed + 10)
        logs = _noisy(clean, first, noise, rng), _noisy(best.log, best.log, noise, rng)
        pairs = dict(zip(("first", "second"), zip((free, second), logs, strict=True), strict=True))
        both = seaid.identify_conditions(pairs, condition_specific=())
        of_both = values_of(both.identifications["first"])
        values.append([of_both[name][0] for name in ("motor_inertia", "command_delay")])
    scatter = np.std(values, axis=0, ddof=1)
    predicted = [best.armature_errors["j"], best.delay_error_s]
    assert np.all(np.abs(np.log(scatter / predicted)) < np.log(1.3))


@pytest.mark.slow  # simulations of motions that become smaller
def test_a_plan_keeps_the_limits_or_says_why_not(
    found: seaid.Identification, first: seaid.Log
) -> None:
    law = found.known.drives["j"].controller
    assert law is not None
    weak = replace(law, torque_limit_Nm=8.0)

    def limited(robot: seaid.Robot, law: seaid.Controller) -> seaid.Robot:
        return robot.with_drives({"j": replace(robot.drives["j"], controller=law)})

    under = replace(found, known=limited(found.known, weak), robot=limited(found.robot, weak))
    plan = seaid.plan_gain_set(under, first, gain_factors=[(0.5, 1.0)])
    assert all(one.torques["j"] < 8.0 for one in plan.candidates)
    commands = plan.candidates[0].log.position_command
    assert commands is not None
    with pytest.raises(IdentificationError, match=r"no second gain set .*unstable"):
        seaid.plan_gain_set(found, first, gain_factors=[(1.0, 0.001)])  # hardly damped
    with pytest.raises(IdentificationError, match=r"must be positive numbers, found \(0, 1\)"):
        seaid.plan_gain_set(found, first, gain_factors=[(0, 1)])
    with pytest.raises(IdentificationError, match="duration_s must be more than 1"):
        seaid.plan_gain_set(found, first, duration_s=0.5)
    plain = replace(found, known=seaid.load_robot("models/xl330_pendulum.urdf"))
    with pytest.raises(IdentificationError, match="stiff drives with position commands"):
        seaid.plan_gain_set(plain, first)


@pytest.mark.slow  # simulates candidates of a motion
def test_gains_on_the_command_line(urdf: Path, first: seaid.Log, tmp_path: Path) -> None:
    drives, run, log = tmp_path / "one.toml", tmp_path / "run.npz", tmp_path / "first.csv"
    seaid.write_log(first, log)
    drives.write_text(
        """[j]
type = "stiff"
gear_ratio = 1.0
friction = ["viscous", "coulomb", "offset"]
motor_input = "position_command"
controller = { position_gain_Nm_per_rad = 40.0, velocity_gain_Nms_per_rad = 1.0 }
"""
    )
    done("identify", urdf, log, "--drives", drives, "--known-body", "arm", "-o", run)
    out = tmp_path / "second.csv"
    text = done("gains", log, "--run", run, "--factor", "0.5,1", "--duration", "5", "-o", out).out
    assert "first log alone" in text
    options = ("--factor", "0.5,1", "--duration", "5", "--json")
    content = json.loads(done("gains", log, "--run", run, *options).out)
    assert content["command"] == "gains"
    assert content["result"]["candidates"][0]["controllers"]["j"]["position_gain_Nm_per_rad"] == 20
    sent = seaid.read_log(out, robot_of(urdf, SOFT))
    assert sent.position_command is not None
    assert np.all(np.abs(sent.position_command) < 0.7)
    assert "is not KP,KD" in said("gains", log, "--run", run, "--factor", "2").err
