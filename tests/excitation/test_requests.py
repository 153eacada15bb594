"""What can be asked of a plan: criteria, drives, ends, recorded logs, a scene."""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError
from seaid.excitation import EndState, Excitation, Limits, design_excitation
from seaid.excitation.collision import distances
from seaid.excitation.criteria import CRITERIA, pivoted_base
from seaid.excitation.objective import load_target, stacked_regressor
from seaid.excitation.scene_file import Box, load_scene
from seaid.log.reading import Log
from seaid.robot.robot import Robot, load_robot

MODELS = Path(__file__).parents[2] / "models"
LIMITS = Limits(velocity=2.5, acceleration=10.0)


@pytest.fixture(scope="module")
def elastic_leg() -> Robot:
    return load_robot(MODELS / "tulip_leg.urdf", drives=MODELS / "tulip_leg.toml")


def plan(robot: Robot, duration: float = 6.0, **options: Any) -> Excitation:
    with warnings.catch_warnings(), ThreadPoolExecutor(1) as executor:
        warnings.filterwarnings("ignore", "the search for an excitation ended early")
        quick: dict[str, Any] = {
            "starts": 1,
            "iterations": 30,
            "coefficients": 12,
            "limits": LIMITS,
            "executor": executor,
        }
        return design_excitation(robot, duration, **(quick | options))


def log_of(robot: Robot, found: Excitation) -> Log:
    """Return what perfect joint encoders would have recorded."""
    time = np.arange(0, found.trajectory.duration, 1 / 500)
    q = found.trajectory.sample(time)[0]
    nothing = np.full_like(q, np.nan)
    return Log(time, robot.joint_names, nothing, q, nothing, np.zeros_like(q), robot.is_prismatic)


@pytest.mark.slow  # a search for each criterion
@pytest.mark.parametrize("drives", [False, True])
def test_each_criterion_is_best_at_its_own(elastic_leg: Robot, drives: bool) -> None:
    plans = {
        name: plan(elastic_leg, criterion=name, drive_parameters=drives, iterations=60)
        for name in CRITERIA
    }
    kappa = {
        name: found.singular_values[0] / found.singular_values[-1]
        for name, found in plans.items()
        if name != "relative_error"  # it has columns of another scale
    }
    assert plans["condition_number"].value == pytest.approx(kappa["condition_number"], rel=1e-9)
    assert kappa["condition_number"] < kappa["d_optimality"]
    worst = {name: relative_errors(elastic_leg, found).max() for name, found in plans.items()}
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
def test_expected_standard_errors_are_those_of_white_noise(elastic_leg: Robot) -> None:
    found = plan(elastic_leg, torque_std=0.5)
    time = np.linspace(0, 6, 6001)
    base = pivoted_base(elastic_leg)
    target = load_target(elastic_leg, None, base)
    H = stacked_regressor(target, time, found.trajectory.sample(time))
    expected = 0.5 * np.sqrt(np.diag(np.linalg.inv(H.T @ H)))
    np.testing.assert_allclose(found.standard_errors, expected, rtol=0.02)


@pytest.mark.slow  # several searches for a motion
def test_given_ends_are_kept(elastic_leg: Robot) -> None:
    start = EndState(position=dict.fromkeys(elastic_leg.joint_names, 0.2))
    end = EndState(position=[0.1, 0.0, -0.3, 0.9, 0.2], velocity=0.5, acceleration=None)
    found = plan(elastic_leg, start=start, end=end)
    q, v, a = found.trajectory.sample([0.0, 6.0])
    np.testing.assert_allclose(q[0], 0.2, atol=1e-12)
    np.testing.assert_allclose(q[1], [0.1, 0.0, -0.3, 0.9, 0.2], atol=1e-12)
    np.testing.assert_allclose(v, [[0.0] * 5, [0.5] * 5], atol=1e-11)
    np.testing.assert_allclose(a[0], 0.0, atol=1e-10)
    assert min(found.margins.position) >= -1e-9
    assert np.isfinite(found.condition_number)


@pytest.mark.slow  # three searches for a motion of the leg
def test_a_motion_that_helps_after_what_was_recorded(leg: Robot) -> None:
    """Three joints were moved already: the next motion tells of the two others.

    In it these three are slow, so that a plan that knows of the first leaves to it what it tells:
    59 together, and 89 where it does not know. A search ends in one of several minima, and rounding
    may change which; they differ by a tenth.
    """
    first = plan(leg, limits=Limits(velocity=[2.5e-3, 2.5e-3, 2.5, 2.5, 2.5]))
    log = log_of(leg, first)
    others = Limits(velocity=[2.5, 2.5, 2.5e-2, 2.5e-2, 2.5e-2])
    after = plan(leg, previous_logs=[log], limits=others, iterations=80)
    alone = plan(leg, limits=others, iterations=80)
    assert after.singular_values[-1] > first.singular_values[-1] * 2

    def together(found: Excitation) -> float:
        base, rows = pivoted_base(leg), []
        for one in (first, found):
            time = np.linspace(0, 6, 1500)
            rows.append(
                stacked_regressor(load_target(leg, None, base), time, one.trajectory.sample(time))
            )
        return float(np.linalg.cond(np.vstack(rows)))

    assert after.value == pytest.approx(together(after), rel=0.05)
    assert together(after) < 0.8 * together(alone)
    assert together(after) < together(first)


@pytest.mark.rounding
def test_one_long_log_counts_as_its_parts(leg: Robot) -> None:
    first = plan(leg, iterations=5)
    log = log_of(leg, first)
    once, twice = (plan(leg, iterations=1, previous_logs=logs) for logs in ([log], [log, log]))
    assert np.all(twice.start_singular_values >= once.start_singular_values * (1 - 1e-9))


PEDESTAL = Box(center=(0.3, 0.1, -0.4), size=(0.2, 0.3, 0.3), name="pedestal")


@pytest.mark.slow  # 1.2 s
def test_bodies_and_boxes_stay_apart(slider_arm_with_bodies: tuple[Path, Robot]) -> None:
    path, robot = slider_arm_with_bodies
    scene = load_scene(path, robot, keep_out=[PEDESTAL], clearance_m=0.02)
    options: dict[str, Any] = {"limits": None, "duration": 4.0, "iterations": 20}
    free, found = plan(robot, **options), plan(robot, scene=scene, **options)
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
        plan(robot, scene=scene, limits=here)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"criterion": "d_optimal"}, "did you mean 'd_optimality'"),
        ({"torque_std": 0.0}, "torque_std limit must be more than zero"),
        ({"torque_std": {"knee": 1.0}}, "did you mean 'knee_pitch'"),
        ({"end": EndState(position=3.0)}, "position 3 at the end is outside its limits"),
        (
            {"start": EndState(0.2), "end": EndState(0.05), "duration": 0.05},
            "joint '.*': no motion between these ends keeps its acceleration limit",
        ),
    ],
)
def test_bad_requests(elastic_leg: Robot, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ExcitationError, match=words):
        plan(elastic_leg, **options)


def test_relative_errors_need_nominal_values(leg: Robot) -> None:
    with pytest.raises(ExcitationError, match=r"no nominal inertial parameters .* \(NaN\)"):
        plan(leg, criterion="relative_error")
