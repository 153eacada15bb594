from __future__ import annotations

import warnings
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.arrays import Array
from seaid.base import base_parameters, random_states
from seaid.errors import ExcitationError, RobotError
from seaid.excitation.criterion import (
    condition_number,
    log_condition,
    make_criterion,
    pivoted_base,
)
from seaid.rigid_body import rigid_body_regressor
from seaid.robot import Payload, Robot, load_robot

MODELS = Path(__file__).parents[2] / "models"
PANDA = [f"panda_joint{i}" for i in range(1, 8)]
TIAGO = ["torso_lift_joint", *(f"arm_{i}_joint" for i in range(1, 8))]


def example_robot(name: str, **options: Any) -> Robot:
    path = next(path for path in files("example-robot-data") or [] if path.name == name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the files' rounded angles are another test's matter
        return load_robot(str(path.locate()), **options)


def robots() -> dict[str, Robot]:
    payload = Payload("wrist_3_link", 2.0, (0.1, 0.0, 0.05))
    return {
        "leg": load_robot(MODELS / "tulip_leg.urdf"),
        "ur5": example_robot("ur5_robot.urdf", payloads=[payload]),
        "panda_reordered": example_robot("panda.urdf", joints=PANDA[::-1]),
        "tiago_prismatic": example_robot("tiago_no_hand.urdf", joints=TIAGO),
        "ur10_nominal_unknown": example_robot("ur10_robot.urdf").without_nominal(),
    }


def states(robot: Robot, samples: int, seed: int = 0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    shape = (samples, robot.n)
    return rng.uniform(-1, 1, shape), rng.normal(0, 1, shape), rng.normal(0, 3, shape)


@pytest.mark.parametrize("neighbours", [1, 4])
@pytest.mark.parametrize("name", robots())
def test_gradient_equals_central_differences(name: str, neighbours: int) -> None:
    robot = robots()[name]
    criterion = make_criterion(robot, None, pivoted_base(robot))
    motion = states(robot, 60)
    value, gradient = log_condition(criterion, *motion, neighbours=neighbours)
    log_kappa = np.log(condition_number(criterion, *motion))
    if neighbours == 1:
        assert value == pytest.approx(log_kappa, rel=1e-12)
    assert log_kappa <= value + 1e-12 <= log_kappa + 2 * np.log(neighbours) / 32 + 2e-12
    rng = np.random.default_rng(1)
    for which in range(3):
        direction = rng.normal(size=motion[which].shape)
        step = 1e-5
        values = []
        for sign in (1, -1):
            moved = list(motion)
            moved[which] = motion[which] + sign * step * direction
            values.append(log_condition(criterion, *moved, neighbours=neighbours)[0])
        numeric = (values[0] - values[1]) / (2 * step)
        assert np.sum(gradient[which] * direction) == pytest.approx(numeric, rel=1e-6)


def test_gradient_with_some_torques_known() -> None:
    robot = load_robot(MODELS / "tulip_leg.urdf")
    rows = ("ankle_pitch", "hip_pitch", "knee_pitch")
    criterion = make_criterion(robot, rows, pivoted_base(robot, rows))
    assert len(criterion.columns) == 21
    motion = states(robot, 60)
    _, gradient = log_condition(criterion, *motion)
    flat = np.stack(motion)
    numeric = np.empty((3, robot.n))
    for index in np.ndindex(3, robot.n):
        step = np.zeros(flat.shape)
        step[index[0], 7, index[1]] = 1e-5
        plus = condition_number(criterion, *(flat + step))
        minus = condition_number(criterion, *(flat - step))
        numeric[index] = (np.log(plus) - np.log(minus)) / 2e-5
    np.testing.assert_allclose(np.stack(gradient)[:, 7], numeric, rtol=1e-5, atol=1e-8)


def test_joint_order_and_payload_do_not_matter() -> None:
    plain = example_robot("panda.urdf", joints=PANDA)
    other = example_robot(
        "panda.urdf", joints=PANDA[::-1], payloads=[Payload("panda_link7", 1.0, (0.0, 0.1, 0.1))]
    )
    motion = states(plain, 60)
    turned = [state[:, ::-1] for state in motion]
    base = base_parameters(plain)
    columns = [10 * (6 - column // 10) + column % 10 for column in base.columns]
    first = make_criterion(plain, None, base)
    second = make_criterion(other, None, base_parameters(other))
    second = type(second)(second.robot, second.rows, tuple(columns))
    value, gradient = log_condition(first, *motion)
    value_turned, gradient_turned = log_condition(second, *turned)
    assert value_turned == pytest.approx(value, rel=1e-12)
    np.testing.assert_allclose(
        np.stack(gradient_turned)[:, :, ::-1], np.stack(gradient), rtol=1e-8, atol=1e-12
    )


@pytest.mark.parametrize(("name", "rank"), [("leg", 29), ("ur5", 36), ("panda_reordered", 43)])
def test_pivoted_base_tells_the_same_torques(name: str, rank: int) -> None:
    robot = robots()[name]
    base = pivoted_base(robot)
    assert len(base.columns) == rank
    Y = rigid_body_regressor(robot, *random_states(robot, 5))
    theta = np.random.default_rng(2).normal(size=10 * robot.n)
    np.testing.assert_allclose(base.reduce(Y) @ base.project(theta), Y @ theta, atol=1e-8)
    np.testing.assert_array_equal(base.grouping[:, base.columns], np.eye(rank))


def test_a_motion_that_does_not_tell_all_is_refused() -> None:
    robot = robots()["leg"]
    criterion = make_criterion(robot, None, pivoted_base(robot))
    still = np.zeros((50, robot.n))
    assert condition_number(criterion, still, still, still) == np.inf
    with pytest.raises(ExcitationError, match="does not tell all 29 base parameters"):
        log_condition(criterion, still, still, still)


def test_unknown_row_offers_the_nearest() -> None:
    with pytest.raises(RobotError, match="did you mean 'ankle_pitch'"):
        pivoted_base(robots()["leg"], ["ankle_pich"])


def test_condition_number_is_that_of_the_stacked_regressor() -> None:
    robot = robots()["leg"]
    base = pivoted_base(robot)
    motion = states(robot, 40)
    H = base.reduce(rigid_body_regressor(robot, *motion)).reshape(-1, len(base.columns))
    expected = np.linalg.cond(H)
    criterion = make_criterion(robot, None, base)
    assert condition_number(criterion, *motion) == pytest.approx(expected, rel=1e-10)
