"""Exact base parameters of a Robot: three ways, one echelon form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid.errors import RobotError, SeaidWarning, SymbolicError
from seaid.regressor.base import base_parameters as numeric_base_parameters
from seaid.regressor.base import cross_check
from seaid.robot.robot import Robot, load_robot
from seaid.symbolic import ExactBaseParameters, base_parameters

SMALL = {
    "ur5_robot.urdf": 36,
    "so100.urdf": 36,
    "xarm7.urdf": 43,
    "talos_left_arm.urdf": 45,
    "tiago_no_hand.urdf": 58,
    "a1.urdf": 68,
    "allegro_left_hand.urdf": 94,
    "double_pendulum.urdf": 6,
    "finger_edu.urdf": 17,
    "hextilt_flying_arm_5.urdf": 23,
}
TempPaths = pytest.TempPathFactory
SLIDE = '<limit lower="0" upper="1" effort="1" velocity="1"/>'


def three_ways(robot: Robot) -> list[ExactBaseParameters]:
    return [
        base_parameters(robot),
        base_parameters(robot, through="energy"),
        base_parameters(robot, through="torque"),
    ]


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "count"), SMALL.items())
def test_three_ways_give_the_same_rationals(
    name: str,
    count: int,
    example_path: Callable[[str], Path],
    load_quietly: Callable[..., Robot],
) -> None:
    ways = three_ways(load_quietly(example_path(name)))
    assert [way.rank for way in ways] == [count] * 3
    assert ways[0].exact_rows == ways[1].exact_rows == ways[2].exact_rows
    assert ways[0].expressions == ways[1].expressions == ways[2].expressions
    assert np.array_equal(ways[0].grouping, ways[2].grouping)


def test_panda_arm_by_three_ways(
    example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    arm = load_quietly(
        example_path("panda.urdf"), joints=tuple(f"panda_joint{number}" for number in range(1, 8))
    )
    ways = three_ways(arm)
    assert [way.rank for way in ways] == [43] * 3
    assert ways[0].exact_rows == ways[1].exact_rows == ways[2].exact_rows


@pytest.mark.rounding
def test_three_ways_with_sliding_joints_and_skew_axes(write_chain: Callable[..., Path]) -> None:
    rpy = '<origin xyz="0.1 -0.2 0.3" rpy="0.4 0.5 -0.6"/>'
    joints = {
        "a": f'prismatic <axis xyz="1 2 -2"/>{SLIDE}',
        "b": f'continuous <axis xyz="0.3 -0.1 0.8"/>{rpy}',
        "c": f'prismatic <axis xyz="0 1 0"/>{SLIDE}{rpy}',
        "d": f'continuous <axis xyz="0 0 -1"/>{rpy}',
    }
    robot = load_robot(write_chain(joints), gravity=(0.5, 0.0, -9.0))
    ways = three_ways(robot)
    assert ways[0].exact_rows == ways[1].exact_rows == ways[2].exact_rows
    assert cross_check(numeric_base_parameters(robot), ways[0]).agree


numbers = st.sampled_from(["0", "0", "1", "-1", "0.3", "-0.25", "0.1234567"])
triples = st.tuples(numbers, numbers, numbers).map(" ".join)
angles = st.sampled_from(["0", "0", "1.5707963267948966", "3.141592653589793", "0.4", "-1.1"])
joints = st.tuples(
    st.sampled_from(["continuous", "prismatic"]),
    triples.filter(lambda axis: axis != "0 0 0").filter(lambda axis: set(axis.split()) != {"0"}),
    triples,
    st.tuples(angles, angles, angles).map(" ".join),
    st.integers(0, 3),
)


@given(tree=st.lists(joints, min_size=1, max_size=4), gravity=st.sampled_from([0.0, -9.81]))
def test_any_tree_has_one_answer(
    tree: list[tuple[str, str, str, str, int]], gravity: float, tmp_path_factory: TempPaths
) -> None:
    text = '<link name="l0"/>'
    for number, (kind, axis, xyz, rpy, parent) in enumerate(tree, 1):
        text += (
            f'<link name="l{number}"/><joint name="j{number}" type="{kind}"><axis xyz="{axis}"/>'
            f'<parent link="l{min(parent, number - 1)}"/><child link="l{number}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/>{SLIDE}</joint>'
        )
    path = tmp_path_factory.mktemp("tree") / "tree.urdf"
    path.write_text(f'<robot name="tree">{text}</robot>')
    robot = load_robot(path, gravity=(0.0, 0.0, gravity))
    ways = three_ways(robot)
    assert ways[0].exact_rows == ways[1].exact_rows == ways[2].exact_rows
    check = cross_check(numeric_base_parameters(robot), ways[0])
    assert check.agree, (check, path)


def test_directions_that_coincide_through_sliding_joints_are_named(
    write_chain: Callable[..., Path],
) -> None:
    quarter, half = "1.5707963267948966", "3.141592653589793"
    joints = {
        "a": ("continuous", "-0.25 0.1234567 0", "1 0.3 -1", f"0 {quarter} 0"),
        "b": ("prismatic", "0 1 -0.25", "0 0 0", f"{quarter} 0.4 {quarter}"),
        "c": ("prismatic", "0 1 0.3", "0.3 0.1234567 0.3", f"{half} {half} 0.4"),
        "d": ("prismatic", "0.3 -1 0", "-1 0.1234567 0", f"{quarter} 0 0"),
        "e": ("continuous", "1 0 0", "-1 1 0", f"0 {quarter} 0"),
    }
    path = write_chain(
        {
            name: f'{kind} <axis xyz="{axis}"/><origin xyz="{xyz}" rpy="{rpy}"/>{SLIDE}'
            for name, (kind, axis, xyz, rpy) in joints.items()
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
    joints = ["ankle_pitch", "hip_pitch", "knee_pitch", "hip_yaw"]
    robot = load_robot(tulip_urdf, joints=joints)
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
