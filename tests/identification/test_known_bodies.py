"""Known bodies: their parameters are not identified, and what they weigh is on the known side."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from seaid.errors import RobotError
from seaid.excitation.criteria import pivoted_base
from seaid.legged import load_robot
from seaid.regressor import base_parameters, cross_check, joint_torques, rigid_body_regressor
from seaid.regressor.exact.equations import base_parameters as exact_base_parameters
from seaid.robot import Robot
from tests.experiments import MODELS
from tests.regressor.stances import check_base, rows_of_torques

LEG = (MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml")


def leg(*known: str) -> Robot:
    return load_robot(*LEG, known_bodies=known)


@pytest.mark.rounding
@pytest.mark.parametrize(
    ("known", "count"),
    [((), 29), (("foot",), 22), (("thigh", "shank"), 17), (("hip_yaw_link",), 29)],
)
def test_both_base_parameters_leave_known_bodies_out(known: tuple[str, ...], count: int) -> None:
    robot = leg(*known)
    exact = exact_base_parameters(robot)
    assert cross_check(base_parameters(robot), exact).agree
    check_base(exact, rows_of_torques(robot, robot.joint_names))
    assert exact.rank == len(pivoted_base(robot).columns) == count
    assert not np.any(exact.grouping[:, robot.is_known])


@pytest.mark.rounding
def test_base_parameters_and_known_ones_make_the_whole_torque() -> None:
    robot = leg("shank")
    base, rng = base_parameters(robot), np.random.default_rng(1)
    states = rng.normal(size=(3, 20, robot.n))
    Y = rigid_body_regressor(robot, *states)
    told = base.reduce(Y) @ base.project(robot.parameters) + Y @ robot.known_parameters
    np.testing.assert_allclose(told, joint_torques(robot, *states), atol=1e-10)


def test_a_robot_of_known_bodies_has_no_base_parameters() -> None:
    robot = leg(*leg().body_names)
    base = base_parameters(robot)
    assert base.columns == ()
    assert base.grouping.shape == (0, 50)
    assert cross_check(base, exact_base_parameters(robot)).agree


def test_all_bodies_with_inertial_parameters_can_be_known(write_chain: Callable[..., Path]) -> None:
    path = write_chain({"one": "continuous", "two": "continuous"}, empty=("one_link",))
    for names in ("all", ["all"]):
        assert load_robot(path, known_bodies=names).known_bodies == ("two_link",)
    with pytest.raises(RobotError, match="'one_link' has no inertial parameters in the URDF"):
        load_robot(path, known_bodies=["one_link"])
