"""Counts of base parameters by the recursion: textbooks, and whole robots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from seaid._arrays import Array
from seaid.errors import SymbolicError
from seaid.legged import load_robot
from seaid.regressor import rigid_body_regressor
from seaid.regressor.base import left_to_right, random_states
from seaid.regressor.exact.geometry import exact_tree, number
from seaid.regressor.exact.recursion import null_space
from seaid.robot.robot import Robot
from seaid.symbolic import base_parameters

X, Y, Z = ('<axis xyz="{} {} {}"/>'.format(*axis) for axis in ("100", "010", "001"))


def at(xyz: str, rpy: str = "0 0 0") -> str:
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


LIMIT = '<limit lower="0" upper="1" effort="1" velocity="1"/>'
QUARTER = "1.5707963267948966"
TEXTBOOKS = {
    "pendulum": ({"a": f"continuous {Y}"}, 3),
    "pendulum on a vertical axis": ({"a": f"continuous {Z}"}, 1),
    "2R in a vertical plane": ({"a": f"continuous {Y}", "b": f"continuous {Y}{at('0 0 1')}"}, 6),
    "2R in a horizontal plane": ({"a": f"continuous {Z}", "b": f"continuous {Z}{at('1 0 0')}"}, 4),
    "3R in a vertical plane": ({name: f"continuous {Y}{at('0 0 0.5')}" for name in "abc"}, 9),
    "SCARA": (
        {
            "a": f"continuous {Z}",
            "b": f"continuous {Z}{at('0.4 0 0')}",
            "c": f"continuous {Z}{at('0.3 0 0')}",
            "d": f"prismatic {Z}{at('0 0 0')}{LIMIT}",
        },
        8,
    ),
    "Stanford arm": (
        {
            "a": f"continuous {Z}",
            "b": f"continuous {Y}{at('0 0 0.4')}",
            "c": f"prismatic {Z}{at('0 0.15 0')}{LIMIT}",
            "d": f"continuous {Z}{at('0 0 0')}",
            "e": f"continuous {Y}{at('0 0 0')}",
            "f": f"continuous {Z}{at('0 0 0')}",
        },
        33,
    ),
    "PUMA 560": (
        {
            "a": f"continuous {Z}{at('0 0 0.67')}",
            "b": f"continuous {Y}{at('0 0.2435 0')}",
            "c": f"continuous {Y}{at('0.4318 -0.0934 0')}",
            "d": f"continuous {Z}{at('-0.0203 0 0.4331')}",
            "e": f"continuous {Y}{at('0 0 0')}",
            "f": f"continuous {Z}{at('0 0 0')}",
        },
        36,
    ),
    "PUMA 560 on a wall": (
        {
            "a": f"continuous {Z}{at('0 0 0.67', f'{QUARTER} 0 0')}",
            "b": f"continuous {Y}{at('0 0.2435 0')}",
            "c": f"continuous {Y}{at('0.4318 -0.0934 0')}",
            "d": f"continuous {Z}{at('-0.0203 0 0.4331')}",
            "e": f"continuous {Y}{at('0 0 0')}",
            "f": f"continuous {Z}{at('0 0 0')}",
        },
        38,
    ),
    "axes of no special direction": (
        {
            name: f'continuous <axis xyz="{axis}"/>{at("0.1 0.2 0.3", "0.1 0.2 0.3")}'
            for name, axis in zip("abcd", ("1 2 3", "3 -1 2", "0.2 0.3 -0.9", "1 1 0"), strict=True)
        },
        24,
    ),
}
EXAMPLES = {
    "ur5_robot.urdf": 36,
    "kinova.urdf": 36,
    "so100.urdf": 36,
    "xarm7.urdf": 43,
    "talos_full_v2.urdf": 290,
    "romeo.urdf": 361,
    "g1_29dof_with_hand_rev_1_0.urdf": 287,
    "tiago_dual.urdf": 639,
}


@pytest.mark.parametrize(("joints", "count"), TEXTBOOKS.values(), ids=TEXTBOOKS)
def test_count_of_a_textbook_system(
    joints: dict[str, str], count: int, write_chain: Callable[..., Path]
) -> None:
    assert base_parameters(load_robot(write_chain(joints))).rank == count


@pytest.mark.parametrize(("name", "count"), EXAMPLES.items())
def test_count_of_a_known_robot(
    name: str, count: int, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    assert base_parameters(load_quietly(example_path(name))).rank == count


def test_counts_of_the_leg(tulip_leg: Robot, tulip_urdf: Path) -> None:
    base = base_parameters(tulip_leg)
    assert base.rank == len(base.columns) == len(base.expressions) == 29
    assert base.through == "recursion"
    assert base.gap == float("inf")
    in_plane = load_robot(tulip_urdf, joints=["hip_pitch", "knee_pitch", "ankle_pitch"])
    assert base_parameters(in_plane).rank == 9


def test_grouping_is_rational_and_readable(write_chain: Callable[..., Path]) -> None:
    robot = load_robot(
        write_chain(
            {"hip": f"continuous {Y}{at('0 0 0')}", "knee": f"continuous {Y}{at('0 0 0.275')}"}
        )
    )
    base = base_parameters(robot)
    assert base.expressions == (
        "mx_hip_link",
        "mz_hip_link + 11/40 m_knee_link",
        "Iyy_hip_link + 121/1600 m_knee_link",
        "mx_knee_link",
        "mz_knee_link",
        "Iyy_knee_link",
    )
    assert np.array_equal(np.array(base.exact_grouping, dtype=float), base.grouping)
    assert base.exact_grouping[2][10] * 1600 == 121


def test_long_numbers_are_shown_as_decimals(
    example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    texts = base_parameters(load_quietly(example_path("ur5_robot.urdf"))).expressions
    assert "0.01846 m_upper_arm_link + 2717/10000 my_upper_arm_link" in texts[0]


def test_without_gravity_weights_are_not_seen(write_chain: Callable[..., Path]) -> None:
    path = write_chain({"a": f"continuous {Y}", "b": f"continuous {Y}"})
    assert base_parameters(load_robot(path, gravity=(0, 0, 0))).rank == 4
    assert base_parameters(load_robot(path, gravity=(0, -9.81, 0))).rank == 4
    assert base_parameters(load_robot(path, gravity=(1.0, 2.0, -9.0))).rank == 6


def test_order_of_the_joints_changes_columns_but_not_the_count(tulip_urdf: Path) -> None:
    chain = ["hip_yaw", "hip_roll", "hip_pitch", "knee_pitch"]
    forward = base_parameters(load_robot(tulip_urdf, joints=chain))
    backward = base_parameters(load_robot(tulip_urdf, joints=chain[::-1]))
    assert forward.rank == backward.rank
    assert forward.names != backward.names


def test_every_null_vector_is_one_of_the_numeric_regressor(tulip_leg: Robot) -> None:
    nulls = null_space(exact_tree(tulip_leg))
    assert len(nulls) == 10 * tulip_leg.n - 29
    changes = np.zeros((len(nulls), 10 * tulip_leg.n))
    for change, null in zip(changes, nulls, strict=True):
        for column, value in null.items():
            change[column] = number(value)
    Y = rigid_body_regressor(tulip_leg, *random_states(tulip_leg, 0))
    assert np.max(np.abs(Y @ changes.T)) < 1e-10


@pytest.mark.parametrize("name", ["a1.urdf", "ur5_robot.urdf", "baxter.urdf"])
def test_floating_base_is_that_of_the_numeric_regressor(
    name: str, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    robot = load_quietly(example_path(name))
    columns, grouping, _ = left_to_right(floating_regressor(robot))
    exact = base_parameters(robot, floating_base=True)
    assert exact.columns == tuple(columns)
    assert exact.names[:10] == tuple(
        f"{name}_base" if "base" not in robot.body_names else f"{name}_floating_base"
        for name in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    )
    np.testing.assert_allclose(grouping, exact.grouping, rtol=0, atol=1e-9)


def floating_regressor(robot: Robot) -> Array:
    """The regressor of wrench and torques with a free base, at random states, from Pinocchio."""
    base = pin.Model()
    joint = base.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    base.addFrame(pin.Frame("free", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    base.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    model = pin.appendModel(base, robot.model, joint, pin.SE3.Identity())
    data, rng = model.createData(), np.random.default_rng(0)
    pin.seed(0)
    blocks = []
    for _ in range(60):
        q = rng.uniform(-2, 2, model.nq)
        q[3:7] /= np.linalg.norm(q[3:7])
        v, a = rng.normal(0, 3, (2, model.nv))
        blocks.append(np.array(pin.computeJointTorqueRegressor(model, data, q, v, a)))
    return np.vstack(blocks)


def test_options_that_do_not_go_together(tulip_leg: Robot) -> None:
    with pytest.raises(SymbolicError, match=r'through="energy", but only through="torque"'):
        base_parameters(tulip_leg, through="energy", torque_joints=("knee_pitch",))
    with pytest.raises(SymbolicError, match="did you mean 'torque'"):
        base_parameters(tulip_leg, through="torques")  # type: ignore[arg-type]
    with pytest.raises(SymbolicError, match="floating_base=True needs"):
        base_parameters(tulip_leg, through="energy", floating_base=True)
