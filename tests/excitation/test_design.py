from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import ExcitationError, SeaidWarning
from seaid.excitation import Box, EndState, Excitation, Limits, design_excitation, load_scene
from seaid.excitation import search as search_module
from seaid.excitation.collision import distances
from seaid.excitation.criteria import CRITERIA, pivoted_base
from seaid.excitation.limits import joint_limits
from seaid.excitation.observation_matrix import load_target, stacked_regressor
from seaid.excitation.problem import PlanningProblem
from seaid.excitation.problem import value_and_gradient as true_value_and_gradient
from seaid.log import Log
from seaid.regressor import base_parameters, rigid_body_regressor
from seaid.robot import Robot
from tests.excitation.robots import assert_kept, plan
from tests.representatives import quick_first


@pytest.mark.slow  # 3.1 s
@pytest.mark.rounding
def test_condition_number_is_raw_and_of_the_columns_in_base(slider_arm: Robot) -> None:
    """The nominal parameters of the robot are not used for it."""
    found = plan(slider_arm)
    unknown = plan(slider_arm.without_nominal()).trajectory
    np.testing.assert_array_equal(found.trajectory.coefficients, unknown.coefficients)
    motion = found.trajectory.sample(np.linspace(0.0, 4.0, 4001))
    H = found.base.reduce(rigid_body_regressor(slider_arm, *motion))
    kappa = np.linalg.cond(H.reshape(-1, len(found.base.columns)))
    assert found.condition_number == pytest.approx(kappa, rel=1e-2)
    assert len(found.base.columns) == len(base_parameters(slider_arm).columns)
    assert found.trajectory.prismatic_joints == ("rail",)


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
    assert_kept(found.trajectory, joint_limits(slider_arm), 1e4)
    margins = (found.margins.position, found.margins.velocity, found.margins.acceleration)
    assert np.min(margins) >= -1e-9


@pytest.mark.rounding
def test_a_trial_step_that_tells_nothing_does_not_end_the_search(
    slider_arm: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = 0

    def blind_once(problem: PlanningProblem, x: Array) -> tuple[float, Array]:
        nonlocal calls
        calls += 1
        return (np.inf, 0 * x) if calls == 3 else true_value_and_gradient(problem, x)

    monkeypatch.setattr(search_module, "value_and_gradient", blind_once)
    assert np.isfinite(plan(slider_arm, starts=1).condition_number)
    assert calls > 3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"duration": -2.0, "coefficients": None}, r"duration must be from 0\.001 to"),
        ({"starts": 0}, "starts= must be a whole number of 1 or more, found 0"),
        ({"iterations": 0}, "iterations= must be a whole number of 1 or more, found 0"),
        ({"samples": 3}, "^samples= must be a whole number of 6 or more, found 3"),
        ({"torque_joints": []}, "torque_joints= names no joint"),
        ({"criterion": "d_optimal"}, "did you mean 'd_optimality'"),
        (
            {"torque_std": 0},
            "torque_std must be more than zero, found 0; give another by torque_std={'",
        ),
        ({"torque_std": {"elbo": 1.0}}, "did you mean 'elbow'"),
        ({"end": EndState(position=3.0)}, "position 3 at the end is outside its limits"),
    ],
)
def test_bad_requests_say_what_is_wrong(
    slider_arm: Robot, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ExcitationError, match=words):
        plan(slider_arm, **options)


def test_robots_that_cannot_be_planned_for_say_why(leg: Robot) -> None:
    with pytest.raises(ExcitationError, match=r"no motion .* identifies all 29 base parameters"):
        plan(leg, limits=Limits(lower=0.0, upper=1e-9))
    with pytest.raises(ExcitationError, match=r"no nominal inertial parameters .* \(NaN\)"):
        plan(leg, criterion="relative_error")


# What can be asked of a plan: criteria, drives, ends, recorded logs, a scene

LIMITS = Limits(velocity=2.5, acceleration=10.0)


def longer(robot: Robot, duration: float = 6.0, **options: Any) -> Excitation:
    with ThreadPoolExecutor(1) as executor:
        more: dict[str, Any] = {"starts": 1, "iterations": 30, "coefficients": 12}
        return plan(robot, duration, **({"limits": LIMITS, "executor": executor} | more | options))


def log_of(robot: Robot, found: Excitation) -> Log:
    """Return what perfect joint encoders would have recorded."""
    time = np.arange(0, found.trajectory.duration, 1 / 500)
    q = found.trajectory.sample(time)[0]
    nothing = np.full_like(q, np.nan)
    return Log(time, robot.joint_names, nothing, q, nothing, np.zeros_like(q), robot.is_prismatic)


@pytest.mark.slow  # a search for each criterion
@pytest.mark.parametrize("drives", [False, True])
def test_each_criterion_is_best_at_its_own(tulip_leg: Robot, drives: bool) -> None:
    plans = {
        name: longer(tulip_leg, criterion=name, drive_parameters=drives, iterations=60)
        for name in CRITERIA
    }
    kappa = {
        name: found.singular_values[0] / found.singular_values[-1]
        for name, found in plans.items()
        if name != "relative_error"  # it has columns of another scale
    }
    assert plans["condition_number"].value == pytest.approx(kappa["condition_number"], rel=1e-9)
    assert kappa["condition_number"] < kappa["d_optimality"]
    worst = {name: relative_errors(tulip_leg, found).max() for name, found in plans.items()}
    assert worst["relative_error"] < 0.8 * min(worst["d_optimality"], worst["condition_number"])
    assert plans["d_optimality"].value < np.exp(
        -np.mean(np.log(plans["condition_number"].singular_values))
    )
    names = plans["relative_error"].names
    assert len(names) == (45 if drives else 29)


def relative_errors(robot: Robot, found: Excitation) -> Any:
    """Return expected standard errors of base parameters over their nominal sizes (p,)."""
    sizes = np.abs(found.base.project(robot.parameters))
    units = np.array(found.units[: len(sizes)])
    for unit in set(units):
        sizes[units == unit] = np.maximum(
            sizes[units == unit], 0.1 * np.median(sizes[units == unit])
        )
    return found.standard_errors[: len(sizes)] / sizes


@pytest.mark.slow  # many estimates of the leg
@pytest.mark.rounding
def test_expected_standard_errors_are_those_of_white_noise(tulip_leg: Robot) -> None:
    found = longer(tulip_leg, torque_std=0.5)
    time = np.linspace(0, 6, 6001)
    base = pivoted_base(tulip_leg)
    target = load_target(tulip_leg, None, base)
    H = stacked_regressor(target, time, found.trajectory.sample(time))
    expected = 0.5 * np.sqrt(np.diag(np.linalg.inv(H.T @ H)))
    np.testing.assert_allclose(found.standard_errors, expected, rtol=0.02)


@pytest.mark.rounding
def test_one_long_log_counts_as_its_parts(leg: Robot) -> None:
    first = longer(leg, iterations=5)
    log = log_of(leg, first)
    once, twice = (longer(leg, iterations=1, previous_logs=logs) for logs in ([log], [log, log]))
    assert np.all(twice.start_singular_values >= once.start_singular_values * (1 - 1e-9))


PEDESTAL = Box(center=(0.3, 0.1, -0.4), size=(0.2, 0.3, 0.3), name="pedestal")


@pytest.mark.slow  # 1.2 s
def test_bodies_and_boxes_stay_apart(slider_arm_with_bodies: tuple[Path, Robot]) -> None:
    path, robot = slider_arm_with_bodies
    scene = load_scene(path, robot, keep_out=[PEDESTAL], clearance_m=0.02)
    options: dict[str, Any] = {"limits": None, "duration": 4.0, "iterations": 20}
    free, found = longer(robot, **options), longer(robot, scene=scene, **options)
    time = np.linspace(0, 4, 1601)
    least = distances(scene, found.trajectory.sample(time)[0]).min()
    assert least >= 0.02 - 1e-6
    assert found.margins.distance_m == pytest.approx(least, abs=1e-3)
    assert distances(scene, free.trajectory.sample(time)[0]).min() < 0.0
    assert np.isfinite(found.condition_number)


@pytest.mark.slow  # 1.2 s
def test_a_box_that_cannot_be_left_is_named(slider_arm_with_bodies: tuple[Path, Robot]) -> None:
    path, robot = slider_arm_with_bodies
    wall = Box(center=(0.0, 0.1, -0.2), size=(0.2, 0.2, 0.2), name="wall")
    scene = load_scene(path, robot, keep_out=[wall])
    here = Limits({"rail": -0.01, "shoulder": -0.1}, {"rail": 0.01, "shoulder": 0.1})
    with pytest.raises(ExcitationError, match=r"no motion was found that keeps '.*' and 'wall'"):
        longer(robot, scene=scene, limits=here)
