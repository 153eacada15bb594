"""Exact base parameters of a Robot: three ways, one echelon form."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid.errors import SeaidWarning
from seaid.legged import load_robot
from seaid.regressor import base_parameters as numeric_base_parameters
from seaid.regressor import cross_check, rigid_body_regressor
from seaid.regressor.base import random_states
from seaid.robot import Robot
from seaid.symbolic import ExactBaseParameters, base_parameters, rigid_body
from tests.regressor.exact.lagrangian import base_by_energy, base_by_torques
from tests.regressor.stances import check_floating
from tests.regressor.trees import SLIDE, Joint, joints, robot_of

SMALL = ("ur5_robot.urdf", "tiago_no_hand.urdf", "a1.urdf", "hextilt_flying_arm_5.urdf")
Y = '<axis xyz="0 1 0"/>'
TempPaths = pytest.TempPathFactory


def three_ways(robot: Robot) -> list[ExactBaseParameters]:
    return [base_parameters(robot), base_by_energy(robot), base_by_torques(robot)]


@pytest.mark.rounding
@pytest.mark.parametrize("name", SMALL)
def test_three_ways_give_the_same_rationals(
    name: str, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    """Recursion, energy and torque have one echelon form."""
    recursion, energy, torque = three_ways(load_quietly(example_path(name)))
    assert recursion.exact_rows == energy.exact_rows == torque.exact_rows
    assert recursion.expressions == energy.expressions == torque.expressions
    assert torque.gap == float("inf")


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
    states = random_states(robot, 0)
    expected = rigid_body_regressor(robot, *states)
    form, atol = rigid_body(robot), 1e-9 * max(1.0, np.max(np.abs(expected)))
    np.testing.assert_allclose(form.regressor(*states), expected, rtol=0, atol=atol)
    base = form.base.reduce(expected)
    np.testing.assert_allclose(form.base_regressor(*states), base, rtol=0, atol=atol)


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


@pytest.mark.parametrize(
    ("joints", "torques", "count"),
    [
        (None, ("hip_pitch", "knee_pitch", "ankle_pitch"), 21),
        (None, ("ankle_pitch", "hip_yaw"), None),
        (("ankle_pitch", "hip_pitch", "knee_pitch"), ("knee_pitch", "hip_pitch"), None),
    ],
)
def test_known_torques_only(
    joints: tuple[str, ...] | None, torques: tuple[str, ...], count: int | None, tulip_urdf: Path
) -> None:
    """Torques of some joints, in any order of the joints."""
    robot = load_robot(tulip_urdf, joints=joints)
    exact = base_by_torques(robot, torques)
    assert count in (None, exact.rank)
    check = cross_check(numeric_base_parameters(robot, torque_joints=torques), exact)
    assert check.agree, check


def test_grouping_is_rational_and_readable(
    write_chain: Callable[..., Path],
    example_path: Callable[[str], Path],
    load_quietly: Callable[..., Robot],
) -> None:
    """Short rationals stay as they are, and long ones are shown as decimals."""
    knee = f'continuous {Y}<origin xyz="0 0 0.275"/>'
    robot = load_robot(write_chain({"hip": f"continuous {Y}", "knee": knee}))
    base = base_parameters(robot)
    assert base.expressions == (
        "mx_hip_link",
        "mz_hip_link + 11/40 m_knee_link",
        "Iyy_hip_link + 121/1600 m_knee_link",
        "mx_knee_link",
        "mz_knee_link",
        "Iyy_knee_link",
    )
    parameters = range(base.grouping.shape[1])
    dense = [[float(row.get(j, 0)) for j in parameters] for row in base.exact_rows]
    assert np.array_equal(dense, base.grouping)
    assert base.exact_rows[2][10] * 1600 == 121
    texts = base_parameters(load_quietly(example_path("ur5_robot.urdf"))).expressions
    assert "0.01846 m_upper_arm_link + 2717/10000 my_upper_arm_link" in texts[0]


@pytest.mark.parametrize("name", ["a1.urdf", "ur5_robot.urdf", "baxter.urdf"])
def test_floating_base_is_that_of_pinocchios_free_flyer(
    name: str, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    """Columns and grouping; the base has a name that no link has."""
    robot = load_quietly(example_path(name))
    exact = base_parameters(robot, floating_base=True)
    link = "floating_base" if "base" in robot.body_names else "base"
    assert exact.names[:4] == tuple(f"{parameter}_{link}" for parameter in ("m", "mx", "my", "mz"))
    check_floating(exact, load_quietly(example_path(name), base="floating"))
