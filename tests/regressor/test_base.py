"""Counts and groupings of base parameters; known bodies are in none of them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import ExcitationError, RobotError, SeaidError
from seaid.excitation.criteria import pivoted_base
from seaid.legged import load_robot
from seaid.regressor import base_parameters, cross_check, joint_torques, rigid_body_regressor
from seaid.regressor.base import (
    _regressor,
    grouped_text,
    left_to_right,
    negligible,
    random_states,
)
from seaid.regressor.load import load_model, load_side
from seaid.robot import Robot
from seaid.symbolic import base_parameters as exact_base_parameters
from tests.experiments import MODELS, motion_of
from tests.regressor.stances import check_base, rows_of_torques

Chain = Callable[..., Path]

LIMIT = '<limit lower="0" upper="1" effort="1" velocity="1"/>'
AXES = {
    "y": 'continuous <axis xyz="0 1 0"/>',
    "z": 'continuous <axis xyz="0 0 1"/>',
    "slide": f'prismatic <axis xyz="0 0 1"/>{LIMIT}',
}
PUMA = "y 0 0.2435 0, y 0.4318 -0.0934 0, z -0.0203 0 0.4331, y 0 0 0, z 0 0 0"
SKEW = "0.1 0.2 0.3 0.1 0.2 0.3"
VERTICAL = "-0.19866933079506116;0.2896294776255156;0.9362933635841992"
TEXTBOOKS = {
    "pendulum": ("y", 3),
    "pendulum on a vertical axis": ("z", 1),
    "2R in a vertical plane": ("y, y 0 0 1", 6),
    "2R in a horizontal plane": ("z, z 1 0 0", 4),
    "2R with an axis that is vertical up to rounding": (f"z, {VERTICAL} 1 0 0 0.3 0.2 0.7", 4),
    "3R in a vertical plane": ("y 0 0 0.5, y 0 0 0.5, y 0 0 0.5", 9),
    "SCARA": ("z, z 0.4 0 0, z 0.3 0 0, slide 0 0 0", 8),
    "Stanford arm": ("z, y 0 0 0.4, slide 0 0.15 0, z 0 0 0, y 0 0 0, z 0 0 0", 33),
    "PUMA 560": (f"z 0 0 0.67, {PUMA}", 36),
    "PUMA 560 on a wall": (f"z 0 0 0.67 1.5707963267948966 0 0, {PUMA}", 38),
    "no special direction": (f"1;2;3 {SKEW}, 3;-1;2 {SKEW}, 0.2;0.3;-0.9 {SKEW}, 1;1;0 {SKEW}", 24),
}
"""{system: (axis, place and angles of each joint, count of the literature)}"""


def joints_of(system: str) -> dict[str, str]:
    """Return the joints of a chain by the axes and places of a table."""
    joints = {}
    for number, text in enumerate(system.split(", "), 1):
        axis, *numbers = text.split()
        kind = AXES.get(axis, f'continuous <axis xyz="{axis.replace(";", " ")}"/>')
        place, angles = " ".join(numbers[:3]), " ".join(numbers[3:]) or "0 0 0"
        joints[f"joint_{number}"] = kind + f'<origin xyz="{place}" rpy="{angles}"/>' * bool(place)
    return joints


@pytest.mark.rounding
@pytest.mark.parametrize(("system", "count"), TEXTBOOKS.values(), ids=TEXTBOOKS)
def test_count_of_a_textbook_system(system: str, count: int, write_chain: Chain) -> None:
    robot = load_robot(write_chain(joints_of(system)))
    numeric, exact = base_parameters(robot), exact_base_parameters(robot)
    assert exact.rank == count
    assert cross_check(numeric, exact).agree


@pytest.mark.rounding
@pytest.mark.parametrize(
    "second", ["0;0;1 0.1 0 0.2 0.7853981633974483 0 0", "1;1;0 0.1 0 0.2 0 1.5707963267948966 0"]
)
def test_oblique_axes_that_meet_at_a_right_angle_up_to_rounding(
    second: str, write_chain: Chain
) -> None:
    """Without gravity six parameters count: the axes meet, so that no lever of link 2 does."""
    path = write_chain(joints_of(f"1;1;1, {second}"))
    robot = load_robot(path, gravity=(0.0, 0.0, 0.0))
    numeric, exact = base_parameters(robot), exact_base_parameters(robot)
    assert exact.rank == len(numeric.columns) == 6
    assert cross_check(numeric, exact).agree


@pytest.mark.rounding
@pytest.mark.parametrize("order", [1, -1])
def test_tulip_leg_has_29_and_21_and_9(tulip_leg: Robot, tulip_urdf: Path, order: int) -> None:
    """All torques, those of the springs alone, and the leg in its plane; in any order of joints."""
    robot = load_robot(tulip_urdf, joints=tulip_leg.joint_names[::order])
    pitch = tulip_leg.joint_names[2:]
    assert len(base_parameters(robot).columns) == 29
    assert len(base_parameters(robot, torque_joints=pitch).columns) == 21
    in_plane = load_robot(tulip_urdf, joints=pitch[::order])
    assert exact_base_parameters(in_plane).rank == len(base_parameters(in_plane).columns) == 9


@pytest.mark.rounding
def test_motion_of_one_joint_tells_what_a_pendulum_tells(write_chain: Chain) -> None:
    """The torques of a motion tell less than those of random states."""
    robot = load_robot(write_chain({"one": AXES["y"], "two": AXES["y"]}))
    time = np.linspace(0, 5, 300)
    q, v, a = (np.column_stack([f(time), 0 * time]) for f in (np.sin, np.cos, lambda t: -np.sin(t)))
    motion = motion_of(robot, time, (q, v, a), (q, v, a))
    alone = base_parameters(robot, motion, torque_joints=("one",))
    assert alone.names == ("mx_one_link", "mz_one_link", "Iyy_one_link")
    assert len(base_parameters(robot, motion).columns) == 6
    assert len(base_parameters(robot, torque_joints=("one",)).columns) == 6


def test_nothing_identifiable_is_an_error(write_chain: Chain) -> None:
    robot = load_robot(write_chain({"turn": AXES["y"]}), gravity=(0, 0, 0))
    still = np.zeros((60, 1))
    with pytest.raises(ExcitationError, match=r"no parameter of 'test' is identifiable .* turn"):
        base_parameters(robot, motion_of(robot, np.arange(60) / 10, (still,) * 3, (still,) * 3))


@pytest.mark.rounding
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_rank_decision_does_not_depend_on_units(scale: float) -> None:
    """A trace of a rounded angle is no column, and a column in small units is one."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(40, 4))
    H = np.column_stack([A[:, 0], A[:, 1], A[:, 0] - 2 * A[:, 1], A[:, 2], A[:, 3]])
    H[:, 3] *= scale
    columns, grouping, gap = left_to_right(H)
    assert columns == [0, 1, 3, 4]
    assert np.allclose(grouping[:, 2], [1, -2, 0, 0], rtol=0, atol=1e-10 * max(1, scale))
    assert gap > 1e12
    traces = rng.normal(size=(40, 3)) * [1.0, 1e-12, 3.0]
    assert list(negligible(traces)) == [False, True, False]
    assert left_to_right(traces, negligible(traces))[0] == [0, 2]


@pytest.mark.parametrize(
    ("coefficients", "text"),
    [
        ([1, 0, 0.07563], "a + 0.07563 c"),
        ([0, -1, 2], "-b + 2 c"),
        ([0, 0, -0.5], "-0.5 c"),
        ([1, -1, 0], "a - b"),
        ([0, 0, 0], ""),
    ],
)
def test_grouping_as_text(coefficients: list[float], text: str) -> None:
    assert grouped_text(np.array(coefficients, dtype=float), ("a", "b", "c")) == text


PITCHES = ("hip_pitch", "knee_pitch")


def test_a_robot_larger_than_memory_is_refused_before_it_is_made(
    tulip_leg: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seaid.regressor.base._MOST_BYTES", 7e3)
    words = "has 5 joints that move: Pinocchio takes 8e-06 GB for it, allowed are 7e-06 GB; let"
    robot = tulip_leg.with_drives(tulip_leg.drives)  # of which nothing is kept
    with pytest.raises(ExcitationError, match=words):
        base_parameters(robot)


@pytest.mark.rounding
def test_many_samples_come_in_blocks(tulip_leg: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block has few samples, and the base parameters are those of all samples at once."""
    time = np.arange(200) / 100
    q, v, a = (state[:200] for state in random_states(tulip_leg, 1, 2, count=200))
    motion = motion_of(tulip_leg, time, (q, v, a), (q, v, a), q, joint_torque=q)
    robots = tulip_leg, tulip_leg.with_drives(tulip_leg.drives)  # what is kept of one is not its
    whole = [base_parameters(robots[0], x, torque_joints=PITCHES) for x in (None, motion)]
    model = load_model(robots[0], base_parameters(robots[0], torque_joints=PITCHES), PITCHES)
    columns = load_side(robots[0]).columns(motion, model, {}).H
    sizes, compute = list[int](), _regressor
    monkeypatch.setattr("seaid.regressor.base._MOST_BYTES", 1e5)

    def counted(robot: Robot, q: Array, states: Sequence[Array]) -> Array:
        sizes.append(len(q))
        return compute(robot, q, states)

    monkeypatch.setattr("seaid.regressor.base._regressor", counted)
    blocks = [base_parameters(robots[1], x, torque_joints=PITCHES) for x in (None, motion)]
    assert np.array_equal(load_side(robots[1]).columns(motion, model, {}).H, columns)
    assert max(sizes) == 6
    assert len(sizes) > 40
    for at_once, in_blocks in zip(whole, blocks, strict=True):
        assert in_blocks.columns == at_once.columns
        assert_close(in_blocks.grouping, at_once.grouping)


LARGEST = 60
"""Joints; the numeric QR of a larger tree takes seconds, and the script does them all."""

ROUNDED = {"kinova": (36, 38), "anymal-kinova": (104, 106), "so100": (36, 38), "so101": (36, 38)}
COUNTS = {
    "ur3_robot": 36,
    "ur10_robot": 36,
    "ur5_gripper": 36,
    "kinova": 36,
    "so100": 36,
    "xarm7": 43,
    "talos_left_arm": 45,
    "talos_full_v2": 290,
    "romeo": 361,
    "g1_29dof_with_hand_rev_1_0": 287,
    "tiago_dual": 639,
    "double_pendulum": 6,
}
"""Base parameters, by the literature or by the sum of those of their chains."""


def assert_close(values: Array, expected: Array) -> None:
    assert np.max(np.abs(values - expected)) <= 1e-9 * np.max(np.abs(expected))


@pytest.mark.rounding
def test_numeric_and_exact_agree(example_urdf: Path, load_quietly: Callable[..., Robot]) -> None:
    """Columns, counts and groupings, with a clear gap of the singular values.

    The regressor gives the torques, and a grouping is one of columns: it holds for any values.
    """
    robot = load_quietly(example_urdf)
    states = [state[:6] for state in random_states(robot, seed=3)]
    Y = rigid_body_regressor(robot, *states)
    assert_close(Y @ robot.parameters, joint_torques(robot, *states))
    exact = exact_base_parameters(robot)
    assert exact.rank == COUNTS.get(example_urdf.stem, exact.rank)
    if robot.n > LARGEST:
        pytest.skip(f"{robot.n} joints: scripts/cross_check.py")
    base = base_parameters(robot)
    assert_close(base.reduce(Y) @ base.grouping, Y)
    check = cross_check(base, exact)
    assert check.agree, check
    assert check.same_columns
    assert check.counts[0] == check.counts[1]
    assert check.max_difference < 1e-9
    # The left-to-right choice is ill-conditioned where axes are tilted by 2.6 degrees.
    assert check.gap > (1e9 if example_urdf.stem == "romeo_laas_small" else 1e12)


@pytest.mark.parametrize(("name", "counts"), ROUNDED.items(), ids=ROUNDED)
def test_rounded_angles_split_the_count_and_snapping_heals_it(
    name: str,
    counts: tuple[int, int],
    example_path: Callable[[str], Path],
    load_quietly: Callable[..., Robot],
) -> None:
    """An angle of 1.57 is none of a quarter turn, and each such axis counts more parameters."""
    path = example_path(f"{name}.urdf")
    for tolerance, count in zip((2e-3, 0.0), counts, strict=True):
        robot = load_quietly(path, snap_tolerance_rad=tolerance)
        assert exact_base_parameters(robot).rank == count


@pytest.mark.rounding
def test_another_choice_or_grouping_does_not_agree(
    tulip_leg: Robot, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    """A column that is missing, and a coefficient that is off by 1e-6, are told.

    2.4e-9 of the largest coefficient at a gap of 4e9 is rounding, amplified by the choice.
    """
    numeric, exact = base_parameters(tulip_leg), exact_base_parameters(tulip_leg)
    with pytest.raises(SeaidError, match="found 50 and 70"):
        cross_check(numeric, exact_base_parameters(load_quietly(example_path("xarm7.urdf"))))
    fewer = replace(numeric, columns=numeric.columns[1:], grouping=numeric.grouping[1:])
    check = cross_check(fewer, exact)
    assert (check.agree, check.same_columns, check.counts) == (False, False, (28, 29))
    assert check.max_difference == float("inf")
    largest = 2.4e-9 * max(1.0, np.abs(numeric.grouping).max())
    for change, gap, agree in (
        (1e-6, numeric.gap, False),
        *((largest, 4e9, True), (largest, 1e14, False), (2e-6, 10.0, False)),
    ):
        grouping = np.array(numeric.grouping)
        grouping[0, -1] += change
        check = cross_check(replace(numeric, grouping=grouping, gap=gap), exact)
        assert (check.agree, check.same_columns) == (agree, True)
        # the coefficient's own rounding, 1e-16 of numbers up to 1, is 1e-7 of what was added
        assert check.max_difference == pytest.approx(change, rel=1e-6)


def test_regressor_has_neither_values_of_bodies_nor_rotors_in_it(tulip_leg: Robot) -> None:
    """And states of another shape are refused."""
    q, v, a = (state[:6] for state in random_states(tulip_leg, seed=7))
    Y, unknown = rigid_body_regressor(tulip_leg, q, v, a), tulip_leg.without_nominal()
    geared = tulip_leg.with_values(tulip_leg.parameters, tulip_leg.drives)
    geared.model.armature = np.full(geared.n, 0.1)
    for robot in (unknown, geared):
        assert np.array_equal(Y, rigid_body_regressor(robot, q, v, a))
    assert base_parameters(unknown).columns == base_parameters(tulip_leg).columns
    with pytest.raises(SeaidError, match=r"v must have shape \(any, 5\), found \(6, 4\)"):
        rigid_body_regressor(tulip_leg, q, v[:, :4], a)
    with pytest.raises(SeaidError, match="as many rows, found 6, 5, 6"):
        rigid_body_regressor(tulip_leg, q, v[:5], a)


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
