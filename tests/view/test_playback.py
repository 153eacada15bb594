"""Motions as they are played: positions, deflections about their mean, colours and their scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.drives.drives import SeriesElasticDrive, StiffDrive
from seaid.errors import ExcitationError, LogError, SeaidError
from seaid.excitation import Trajectory
from seaid.excitation.trajectory import polynomial_trajectory
from seaid.log.motion import reconstruct_motion
from seaid.log.reading import Log
from seaid.robot.robot import Robot, load_robot
from seaid.simulation.simulation import simulate
from seaid.view.panel import deflection_colors, gradient, legend, plain_text, table
from seaid.view.picture import NEUTRAL
from seaid.view.playback import Playback, Shown, playback_of, scales, traces_of

LIMIT = '<limit lower="-1" upper="1" velocity="3" effort="50"/>'
AXIS = '<axis xyz="0 1 0"/>'
JOINTS = {
    "turn": f"revolute {AXIS}{LIMIT}",
    "slide": f"prismatic {LIMIT}",
    "stiff": f"revolute {AXIS}{LIMIT}",
}
PULLEYS = SeriesElasticDrive(
    50.0,
    1e-5,
    0.02,
    0.04,
    stiffness_N_per_m=4e4,
    viscous_friction_Nms_per_rad=1e-4,
    coulomb_friction_Nm=0.0,
)
RACK = SeriesElasticDrive(
    80.0,
    1e-5,
    0.015,
    stiffness_N_per_m=3e4,
    viscous_friction_Nms_per_rad=1e-4,
    coulomb_friction_Nm=0.0,
)
STIFF = StiffDrive(30.0, None, 1e-5, viscous_friction_Nms_per_rad=1e-4, coulomb_friction_Nm=0.0)


@pytest.fixture
def robot(write_chain: Callable[..., Path]) -> Robot:
    """Return a robot with a spring between pulleys, one at a rack, and a stiff joint."""
    return load_robot(write_chain(JOINTS), {"turn": PULLEYS, "slide": RACK, "stiff": STIFF})


def plan(robot: Robot) -> Trajectory:
    """Return a motion from rest to rest in 2 s."""
    t = np.polynomial.Polynomial([0.0, 1.0])
    shape = (t**3 * (2.0 - t) ** 3).coef  # velocity and acceleration are zero at both ends
    coefficients = np.outer(shape, [0.4, -0.2, 0.3])
    return polynomial_trajectory(robot.joint_names, 2.0, coefficients, ("slide",))


def log_of(robot: Robot, joint: Array, motor: Array, start: float = 0.0) -> Log:
    time = start + np.linspace(0.0, 0.01 * (len(joint) - 1), len(joint))
    nothing = np.full(joint.shape, np.nan)
    return Log(time, robot.joint_names, motor, joint, nothing, is_prismatic=robot.is_prismatic)


def waves(robot: Robot, seed: int = 0) -> tuple[Array, Array]:
    """Return positions and deflections (100, n)."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, 100)[:, None]
    joint = rng.normal(size=robot.n) + np.sin(rng.uniform(3, 9, robot.n) * t)
    return joint, 0.3 + 0.01 * np.cos(rng.uniform(3, 9, robot.n) * t)


def test_log_is_played_as_it_is(robot: Robot) -> None:
    joint, deflection = waves(robot)
    motor = (joint + deflection) * [50.0 * 2.0, 80.0 / 0.015, 30.0]  # N r_L / r_M
    played = playback_of(robot, log_of(robot, joint, motor, start=1.7e9), "run")
    assert played.time[0] == 0.0
    assert played.duration == pytest.approx(0.99, abs=1e-6)
    np.testing.assert_array_equal(played.position, joint)
    about_mean = deflection - deflection.mean(axis=0)
    np.testing.assert_allclose(played.deflection[:, :2], about_mean[:, :2], atol=1e-12)
    assert np.all(np.isnan(played.deflection[:, 2]))
    assert played.notes == ()


def test_joint_without_encoder_is_where_its_motor_is(robot: Robot) -> None:
    joint, _ = waves(robot)
    motor, unseen = joint * [100.0, 80.0 / 0.015, 30.0], joint.copy()
    unseen[:, [0, 2]] = np.nan
    played = playback_of(robot, log_of(robot, unseen, motor), "run")
    np.testing.assert_allclose(played.position, joint, atol=1e-12)
    assert np.all(np.isnan(played.deflection[:, [0, 2]]))
    assert played.notes == (
        "no encoder at 'turn': its position is that of its motor, without spring deflection",
    )


def test_joint_without_any_encoder_is_refused(robot: Robot) -> None:
    joint, _ = waves(robot)
    joint[:, 1] = np.nan
    with pytest.raises(LogError, match="log 'run': no encoder gives the position of 'slide'"):
        playback_of(robot, log_of(robot, joint, joint), "run")


def test_coupled_drives_tell_their_joints_and_deflections(write_chain: Callable[..., Path]) -> None:
    both = {"a": 1.0, "b": 1.0}
    drives = {
        "a": StiffDrive(10.0, transmission=both),
        "b": StiffDrive(10.0, transmission={"a": 1.0, "b": -1.0}),
    }
    chain = dict.fromkeys("ab", f"revolute {AXIS}{LIMIT}")
    robot = load_robot(write_chain(chain), drives)
    joint, _ = waves(robot)
    motor = 10.0 * np.column_stack([joint.sum(axis=1), joint[:, 0] - joint[:, 1]])
    played = playback_of(robot, log_of(robot, np.full(joint.shape, np.nan), motor), "run")
    np.testing.assert_allclose(played.position, joint, atol=1e-12)
    spring = SeriesElasticDrive(10.0, stiffness_Nm_per_rad=100.0)
    drives = {
        "a": replace(spring, transmission={"a": 1.0, "b": 1.0}),
        "b": replace(spring, transmission={"a": 1.0, "b": -1.0}),
    }
    robot = load_robot(write_chain(dict.fromkeys("ab", f"revolute {AXIS}{LIMIT}")), drives)
    joint, deflection = waves(robot)
    turned = np.column_stack([joint.sum(axis=1), joint[:, 0] - joint[:, 1]])
    played = playback_of(robot, log_of(robot, joint, 10.0 * (turned + deflection)), "run")
    np.testing.assert_allclose(played.deflection, deflection - deflection.mean(axis=0), atol=1e-12)


def test_columns_of_a_log_are_found_by_name(robot: Robot) -> None:
    joint, _ = waves(robot)
    log = log_of(robot, joint, joint)
    order = [2, 0, 1]
    turned = Log(
        log.time,
        tuple(robot.joint_names[index] for index in order),
        log.motor_position[:, order],
        log.joint_position[:, order],
        log.motor_torque[:, order],
    )
    np.testing.assert_array_equal(playback_of(robot, turned, "run").position, joint)


@pytest.mark.slow  # 0.7 s
def test_plan_is_played_with_the_deflections_of_the_nominal_model(robot: Robot) -> None:
    trajectory = plan(robot)
    played = playback_of(robot, trajectory, "plan")
    position, _, _ = trajectory.sample(played.time)
    np.testing.assert_array_equal(played.position, position)
    assert played.notes == ("planned; deflections are those of the nominal model",)

    run = simulate(robot, trajectory, rate_hz=500.0)
    previous_logs = playback_of(robot, run, "run")
    size = np.max(np.abs(previous_logs.deflection[:, :2]))
    np.testing.assert_allclose(
        played.deflection[:, :2], previous_logs.deflection[:, :2], atol=0.05 * size
    )

    motion = reconstruct_motion(robot, run, 20.0)
    filtered = playback_of(robot, motion, "motion")
    np.testing.assert_allclose(filtered.position, previous_logs.position, atol=1e-4)


def test_plan_without_nominal_values_says_why(robot: Robot) -> None:
    played = playback_of(robot.without_nominal(), plan(robot), "plan")
    assert np.all(np.isnan(played.deflection))
    (note,) = played.notes
    assert note.startswith("planned; deflections are unknown: joint 'turn'")


def test_between_samples_it_is_on_the_line(robot: Robot) -> None:
    joint, deflection = waves(robot)
    played = playback_of(robot, log_of(robot, joint, (joint + deflection) * 100.0), "run")
    for time in (0.0, 0.0123, 0.5, 0.99):
        position, sprung = played.at(time)
        for found, values in ((position, played.position), (sprung, played.deflection)):
            expected = [np.interp(time, played.time, column) for column in values.T]
            np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_array_equal(played.at(-1.0)[0], joint[0])
    np.testing.assert_array_equal(played.at(9.0)[0], joint[-1])


@pytest.mark.parametrize("planned", [True, False])
def test_motion_of_other_joints_is_refused(robot: Robot, planned: bool) -> None:
    joint, _ = waves(robot)
    names = ("turn", "slid", "stiff")
    motion: Shown = replace(log_of(robot, joint, joint), joint_names=names)
    if planned:
        motion = replace(plan(robot), joint_names=names, prismatic_joints=())
    error = ExcitationError if planned else LogError
    with pytest.raises(error, match=r"'x' has no joint slide of 'test'; its joints: turn, slid, "):
        playback_of(robot, motion, "x")


def test_what_is_no_motion_is_refused(robot: Robot) -> None:
    with pytest.raises(SeaidError, match="cannot show 'x', a dict: give a Log of read_log"):
        playback_of(robot, {}, "x")  # type: ignore[arg-type]


def test_scales_are_of_all_turning_and_of_all_sliding_joints() -> None:
    time, nothing = np.array([0.0, 1.0]), np.full((2, 1), np.nan)

    def one(turning: float, sliding: float) -> Playback:
        deflection = np.hstack([[[-turning]] * 2, [[0.0]] * 2, [[sliding]] * 2, nothing])
        return Playback("x", time, np.zeros((2, 4)), deflection, traces_of(1.0, {}, ()))

    kinds = (False, False, True, True)
    found = scales([one(0.2, 3e-3), one(0.1, 4e-3)], kinds)
    np.testing.assert_array_equal(found, [0.2, 0.2, 4e-3, 4e-3])
    np.testing.assert_array_equal(scales([], kinds), np.zeros(4))


@given(st.floats(0.0, 1.0))
def test_colours_go_from_blue_through_yellow_to_red(part: float) -> None:
    limit = np.array([2.0])
    (plus,), (zero,), (minus,) = (
        deflection_colors(sign * 2 * np.array([part]), limit) for sign in (1, 0, -1)
    )
    assert zero == (255, 243, 186)
    assert plus[2] <= zero[2]
    assert minus[0] <= zero[0]
    if part > 0.5:
        assert plus[0] > plus[2] + 100
        assert minus[2] > minus[0] + 100
    assert deflection_colors(np.array([5.0]), limit) == deflection_colors(limit, limit)


def test_what_is_not_known_has_the_neutral_colour() -> None:
    colors = deflection_colors(np.array([np.nan, 0.1, 0.0]), np.array([1.0, 0.0, 1.0]))
    assert colors[:2] == [NEUTRAL, NEUTRAL]
    assert colors[2] != NEUTRAL


def test_legend_says_units_and_what_is_not_known(robot: Robot) -> None:
    text = legend(robot, np.array([0.0123, 0.004, 0.0]))
    assert gradient() in text
    assert "+12.3 mrad" in text
    assert "−4" in text
    assert "+4 mm" in text
    assert "about its mean" in text
    assert "motor side (through the gear) minus joint side" in text
    assert "no deflection is known" in legend(robot, np.zeros(3))
    rigid = robot.with_drives({"turn": STIFF, "slide": StiffDrive()})
    assert "no joint has a spring" in legend(rigid, np.zeros(3))


def test_numbers_have_units_and_names_are_no_markup(write_chain: Callable[..., Path]) -> None:
    name = "&lt;b&gt;x&lt;/b&gt;"
    robot = load_robot(write_chain({name: f"revolute {LIMIT}", "slide": f"prismatic {LIMIT}"}))
    assert robot.joint_names[0] == "<b>x</b>"
    text = table(robot, np.array([-0.5, 0.25]), np.full(2, np.nan), [NEUTRAL, NEUTRAL])
    assert name in text
    assert "<b>x" not in text
    assert "−0.500 rad" in text
    assert "+0.250 m" in text
    assert "deflection" not in text
    assert plain_text(["<i>"]).count("&lt;i&gt;") == 1


def test_numbers_of_springs_are_in_small_units(robot: Robot) -> None:
    deflection = np.array([0.0123, -0.002, np.nan])
    text = table(robot, np.zeros(3), deflection, [NEUTRAL] * 3)
    assert "+12.30 mrad" in text
    assert "−2.00 mm" in text
    assert "nan" not in text
