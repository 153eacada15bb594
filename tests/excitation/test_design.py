from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.errors import ExcitationError, SeaidWarning
from seaid.excitation import Excitation, Limits, design_excitation, joint_limits
from seaid.excitation import search as search_module
from seaid.excitation.problem import Problem
from seaid.excitation.problem import value_and_gradient as true_value_and_gradient
from seaid.regressor import rigid_body_regressor
from seaid.regressor.base import base_parameters
from seaid.robot.robot import Robot
from tests.representatives import quick_first

QUICK: dict[str, Any] = {"starts": 2, "iterations": 12, "coefficients": 10}


def plan(robot: Robot, duration: float = 4.0, **options: Any) -> Excitation:
    """Plan with a small budget; that it was too small to settle is no news here."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "the search for an excitation ended early")
        return design_excitation(robot, duration, **(QUICK | options))


def kept(robot: Robot, plan: Excitation, limits: Limits | None, rate_hz: float = 1e4) -> None:
    """Assert that no limit is broken by more than 1e-9 at any of the samples."""
    bounds = joint_limits(robot, limits)
    duration = plan.trajectory.duration
    q, v, a = plan.trajectory.sample(np.linspace(0.0, duration, int(duration * rate_hz) + 1))
    assert np.all(q >= bounds.lower - 1e-9)
    assert np.all(q <= bounds.upper + 1e-9)
    assert np.all(np.abs(v) <= bounds.velocity + 1e-9)
    assert np.all(np.abs(a) <= bounds.acceleration + 1e-9)
    least = [plan.margins.position, plan.margins.velocity, plan.margins.acceleration]
    assert np.min(least) >= -1e-9


@pytest.mark.slow  # a search for ten seconds of the leg
def test_leg_from_ten_seconds_rest_to_rest(leg: Robot) -> None:
    limits = Limits(velocity=2.5, acceleration=10.0)
    found = design_excitation(leg, 10.0, limits=limits, starts=1, iterations=120)
    assert len(found.base.columns) == 29
    assert found.condition_number < 35.0
    assert found.trajectory.joint_names == leg.joint_names
    assert found.trajectory.rests_at_ends
    kept(leg, found, limits)


@pytest.mark.slow  # 1.9 s
@pytest.mark.rounding
def test_condition_number_is_raw_and_of_the_columns_in_base(slider_arm: Robot) -> None:
    found = plan(slider_arm)
    motion = found.trajectory.sample(np.linspace(0.0, 4.0, 4001))
    H = found.base.reduce(rigid_body_regressor(slider_arm, *motion))
    kappa = np.linalg.cond(H.reshape(-1, len(found.base.columns)))
    assert found.condition_number == pytest.approx(kappa, rel=1e-2)
    assert len(found.base.columns) == len(base_parameters(slider_arm).columns)
    assert found.trajectory.prismatic_joints == ("rail",)


@pytest.mark.slow  # a search for each of ten limits
@settings(derandomize=True, max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    basis=st.sampled_from([("bspline", 9), ("bspline", 20), ("polynomial", 14), ("fourier", 15)]),
    rest=st.booleans(),
    which=st.sampled_from(["slider_arm", "leg"]),
)
def test_limits_hold_at_every_instant(
    seed: int, basis: tuple[str, int], rest: bool, which: str, slider_arm: Robot, leg: Robot
) -> None:
    robot = {"slider_arm": slider_arm, "leg": leg}[which]
    rng = np.random.default_rng(seed)
    lower, width = rng.uniform(-1, 1, robot.n), 10 ** rng.uniform(-1.5, 0.5, robot.n)
    limits = Limits(
        lower, lower + width, 10 ** rng.uniform(-1, 1, robot.n), 10 ** rng.uniform(-1, 1.5, robot.n)
    )
    duration = float(10 ** rng.uniform(-0.3, 0.7))
    options = {"basis": basis[0], "coefficients": basis[1], "rest_to_rest": rest, "seed": seed}
    kept(robot, plan(robot, duration, limits=limits, **options), limits)


@pytest.mark.slow  # 3.1 s
def test_nominal_parameters_are_not_used(slider_arm: Robot) -> None:
    known, unknown = plan(slider_arm), plan(slider_arm.without_nominal())
    np.testing.assert_array_equal(known.trajectory.coefficients, unknown.trajectory.coefficients)


@pytest.mark.slow  # several searches for a motion
def test_more_search_is_never_worse_and_starts_help(leg: Robot) -> None:
    short = plan(leg, 6.0, starts=1, iterations=1, coefficients=14).condition_number
    longer = plan(leg, 6.0, starts=1, iterations=40, coefficients=14).condition_number
    assert longer < 0.2 * short


@pytest.mark.slow  # a search of 2 s
def test_only_some_torques_known(leg: Robot) -> None:
    found = plan(leg, torque_joints=["hip_pitch", "knee_pitch", "ankle_pitch"])
    assert len(found.base.columns) == 21
    assert np.isfinite(found.condition_number)


@pytest.mark.slow  # 1.6 s
def test_free_ends_reach_further(leg: Robot) -> None:
    """Rest is one of the free ends: the least condition number is no more, here 25 for 27.

    After 40 iterations both still fall, and which is ahead is a matter of rounding; 80 are enough.
    """
    options: dict[str, Any] = {"starts": 1, "iterations": 80, "coefficients": 14}
    rest, free = (plan(leg, 6.0, rest_to_rest=rest, **options) for rest in (True, False))
    assert not free.trajectory.rests_at_ends
    assert free.condition_number < rest.condition_number


@pytest.mark.slow  # a search of 2 s
def test_progress_is_shown_on_stderr(slider_arm: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    plan(slider_arm, progress=True)
    shown = capsys.readouterr()
    assert "condition number" in shown.err
    assert not shown.out


@pytest.mark.slow  # a search for a motion of the leg
def test_a_search_that_still_falls_says_so(leg: Robot) -> None:
    with pytest.warns(SeaidWarning, match=r"iteration limit \(30\) while the criterion was still"):
        found = design_excitation(leg, 10.0, starts=1, iterations=30)
    kept(leg, found, None)


def interrupting(after: int) -> Any:
    calls = 0

    def value_and_gradient(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == after:
            raise KeyboardInterrupt
        return true_value_and_gradient(*arguments)

    return value_and_gradient


@pytest.mark.parametrize("after", quick_first([1, 8, 40]))
@pytest.mark.parametrize("starts", quick_first([1, 3]))
def test_ctrl_c_gives_the_best_so_far(
    slider_arm: Robot, monkeypatch: pytest.MonkeyPatch, after: int, starts: int
) -> None:
    monkeypatch.setattr(search_module, "value_and_gradient", interrupting(after))
    with (
        ThreadPoolExecutor(1) as executor,
        pytest.warns(SeaidWarning, match="ended early: interrupted; the motion keeps all limits"),
    ):
        found = design_excitation(
            slider_arm, 4.0, starts=starts, iterations=60, coefficients=12, executor=executor
        )
    kept(slider_arm, found, None)


@pytest.mark.rounding
def test_a_trial_step_that_tells_nothing_does_not_end_the_search(
    slider_arm: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = 0

    def blind_once(problem: Problem, x: Array) -> tuple[float, Array]:
        nonlocal calls
        calls += 1
        return (np.inf, 0 * x) if calls == 3 else true_value_and_gradient(problem, x)

    monkeypatch.setattr(search_module, "value_and_gradient", blind_once)
    assert np.isfinite(plan(slider_arm, starts=1).condition_number)
    assert calls > 3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"duration": 0.0}, "duration must be more than zero seconds, found 0.0"),
        ({"duration": -2.0, "coefficients": None}, "duration must be more than zero seconds"),
        ({"duration": float("nan"), "coefficients": None}, "duration must be more than zero"),
        ({"basis": "furier"}, "no basis is named 'furier'; did you mean 'fourier'"),
        ({"coefficients": 5}, "needs at least 6 coefficients per joint, .* found 5"),
        ({"starts": 0}, "starts must be at least 1, found 0"),
        ({"iterations": 0}, "iterations must be at least 1, found 0"),
        (
            {"samples": 2},
            "2 samples of 3 torques cannot identify 7 base parameters; give at least 3",
        ),
        ({"limits": Limits(velocity=0.0)}, "joint 'rail': velocity limit must be more than zero"),
        ({"torque_joints": []}, "torque_joints= names no joint"),
    ],
)
def test_bad_requests_say_what_is_wrong(
    slider_arm: Robot, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ExcitationError, match=words):
        plan(slider_arm, **options)


def test_a_motion_that_cannot_tell_all_is_refused(leg: Robot) -> None:
    narrow = Limits(lower=0.0, upper=1e-9)
    with pytest.raises(ExcitationError, match=r"no motion .* identifies all 29 base parameters"):
        plan(leg, limits=narrow)
