"""Exact base parameters of a Robot, against numbers of seaid and of Pinocchio."""

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
from seaid.symbolic import base_parameters, rigid_body
from tests.regressor.stances import check_base, rows_of_stances, rows_of_torques
from tests.regressor.trees import SLIDE, Joint, joints, robot_of

Y = '<axis xyz="0 1 0"/>'
TempPaths = pytest.TempPathFactory


GRAVITIES = [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (0.5, 0.0, -9.0)]


@given(
    tree=st.lists(joints, min_size=1, max_size=4),
    gravity=st.sampled_from(GRAVITIES),
    known=st.sets(st.integers(0, 3), min_size=1),
)
def test_any_tree_has_one_answer(
    tree: list[Joint],
    gravity: tuple[float, float, float],
    known: set[int],
    tmp_path_factory: TempPaths,
) -> None:
    """The recursion has the echelon form of all torques; numeric ones have that of some torques."""
    robot = robot_of(tmp_path_factory.mktemp("tree"), tree, gravity=gravity)
    exact = base_parameters(robot)
    check = cross_check(numeric_base_parameters(robot), exact)
    assert check.agree, (check, tree)
    check_base(exact, rows_of_torques(robot, robot.joint_names))
    some = [robot.joint_names[k % robot.n] for k in sorted(known)]
    check_base(numeric_base_parameters(robot, torque_joints=some), rows_of_torques(robot, some))
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
    check_base(exact, rows_of_stances(load_quietly(example_path(name), base="floating"), [()]))
