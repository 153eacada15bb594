"""Exact base parameters of a Robot: three ways, one echelon form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid.errors import RobotError, SeaidWarning, SymbolicError
from seaid.legged import load_robot
from seaid.regressor.base import base_parameters as numeric_base_parameters
from seaid.regressor.base import cross_check
from seaid.robot.robot import Robot
from seaid.symbolic import ExactBaseParameters, base_parameters
from tests.regressor.trees import SLIDE, Joint, joints, robot_of

SMALL = {
    "ur5_robot.urdf": 36,
    "so100.urdf": 36,
    "xarm7.urdf": 43,
    "talos_left_arm.urdf": 45,
    "tiago_no_hand.urdf": 58,
    "a1.urdf": 68,
    "allegro_left_hand.urdf": 94,
    "panda.urdf": 43,
    "double_pendulum.urdf": 6,
    "finger_edu.urdf": 17,
    "hextilt_flying_arm_5.urdf": 23,
}
TempPaths = pytest.TempPathFactory


def three_ways(robot: Robot) -> list[ExactBaseParameters]:
    return [
        base_parameters(robot),
        base_parameters(robot, through="energy"),
        base_parameters(robot, through="torque"),
    ]


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "count"), SMALL.items())
def test_three_ways_give_the_same_rationals(
    name: str, count: int, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    arm = [f"panda_joint{number}" for number in range(1, 8)] if name == "panda.urdf" else None
    ways = three_ways(load_quietly(example_path(name), joints=arm and tuple(arm)))
    assert [way.rank for way in ways] == [count] * 3
    assert ways[0].exact_rows == ways[1].exact_rows == ways[2].exact_rows
    assert ways[0].expressions == ways[1].expressions == ways[2].expressions
    assert np.array_equal(ways[0].grouping, ways[2].grouping)


GRAVITIES = [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (0.5, 0.0, -9.0)]


@given(tree=st.lists(joints, min_size=1, max_size=4), gravity=st.sampled_from(GRAVITIES))
def test_any_tree_has_one_answer(
    tree: list[Joint], gravity: tuple[float, float, float], tmp_path_factory: TempPaths
) -> None:
    robot = robot_of(tmp_path_factory.mktemp("tree"), tree, gravity=gravity)
    ways = three_ways(robot)
    assert ways[0].exact_rows == ways[1].exact_rows == ways[2].exact_rows
    check = cross_check(numeric_base_parameters(robot), ways[0])
    assert check.agree, (check, tree)


def test_directions_that_coincide_through_sliding_joints_are_named(
    write_chain: Callable[..., Path],
) -> None:
    quarter, half = "1.5707963267948966", "3.141592653589793"
    chain = {
        "a": ("continuous", "-0.25 0.1234567 0", "1 0.3 -1", f"0 {quarter} 0"),
        "b": ("prismatic", "0 1 -0.25", "0 0 0", f"{quarter} 0.4 {quarter}"),
        "c": ("prismatic", "0 1 0.3", "0.3 0.1234567 0.3", f"{half} {half} 0.4"),
        "d": ("prismatic", "0.3 -1 0", "-1 0.1234567 0", f"{quarter} 0 0"),
        "e": ("continuous", "1 0 0", "-1 1 0", f"0 {quarter} 0"),
    }
    path = write_chain(
        {
            name: f'{kind} <axis xyz="{axis}"/><origin xyz="{xyz}" rpy="{rpy}"/>{SLIDE}'
            for name, (kind, axis, xyz, rpy) in chain.items()
        }
    )
    with pytest.warns(SeaidWarning, match=r"my_d_link counts as identifiable .* [1-9]e-17"):
        assert base_parameters(load_robot(path)).rank == 19


def test_certificate(tulip_leg: Robot) -> None:
    recursion, energy, torque = three_ways(tulip_leg)
    assert (recursion.fundamental_functions, recursion.different_rows) == (None, None)
    assert recursion.through == "recursion"
    assert energy.through == "energy"
    assert energy.fundamental_functions is not None
    assert energy.fundamental_functions > 29
    assert energy.different_rows is not None
    assert energy.different_rows >= 29
    assert torque.through == "torque"
    assert torque.fundamental_functions is not None
    assert torque.fundamental_functions > energy.fundamental_functions
    assert torque.gap == float("inf")


@pytest.mark.parametrize(
    ("rows", "count"),
    [
        (("hip_pitch", "knee_pitch", "ankle_pitch"), 21),
        (("knee_pitch",), None),
        (("ankle_pitch", "hip_yaw"), None),
    ],
)
def test_known_torques_only(tulip_leg: Robot, rows: tuple[str, ...], count: int | None) -> None:
    exact = base_parameters(tulip_leg, torque_joints=rows)
    assert exact.through == "torque"
    assert count in (None, exact.rank)
    assert cross_check(numeric_base_parameters(tulip_leg, torque_joints=rows), exact).agree
    assert base_parameters(tulip_leg, torque_joints=rows, through="torque").rank == exact.rank


def test_known_torques_are_those_of_the_named_joints_in_any_order(tulip_urdf: Path) -> None:
    order = ["ankle_pitch", "hip_pitch", "knee_pitch", "hip_yaw"]
    robot = load_robot(tulip_urdf, joints=order)
    exact = base_parameters(robot, torque_joints=["knee_pitch", "hip_pitch"])
    check = cross_check(
        numeric_base_parameters(robot, torque_joints=["knee_pitch", "hip_pitch"]), exact
    )
    assert check.agree, check
    ways = three_ways(robot)
    assert ways[0].exact_rows == ways[1].exact_rows == ways[2].exact_rows


def test_unusable_rows(tulip_leg: Robot) -> None:
    with pytest.raises(RobotError, match="did you mean 'knee_pitch'"):
        base_parameters(tulip_leg, torque_joints=("knee_pich",))
    with pytest.raises(SymbolicError, match="at least one joint name"):
        base_parameters(tulip_leg, torque_joints=())
    with pytest.raises(SymbolicError, match="found 'knee_pitch'"):
        base_parameters(tulip_leg, torque_joints="knee_pitch")


@pytest.mark.parametrize("way", ["energy", "torque"])
def test_too_large_a_system_says_so(
    way: str, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    robot = load_quietly(example_path("talos_full_v2.urdf"))
    with pytest.raises(SymbolicError, match=r"about \d+ terms at joint \d+ of 44, max_terms=20000"):
        base_parameters(robot, through=way, max_terms=20_000)  # type: ignore[arg-type]


def test_a_limit_between_the_two_ways(tulip_leg: Robot) -> None:
    assert base_parameters(tulip_leg, through="energy", max_terms=20_000).rank == 29
    with pytest.raises(SymbolicError, match="max_terms=2000"):
        base_parameters(tulip_leg, through="torque", max_terms=2000)
