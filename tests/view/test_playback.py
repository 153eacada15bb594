"""Motions as they are played: positions, deflections about their mean, colours and their scale."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.drives import SeriesElasticDrive, StiffDrive
from seaid.errors import ExcitationError, LogError, SeaidError
from seaid.excitation import Trajectory
from seaid.legged import load_robot
from seaid.log import Log
from seaid.robot import Robot
from seaid.view.panel import deflection_colors, legend, scales
from seaid.view.picture import NEUTRAL
from seaid.view.playback import Playback, playback_of
from tests.experiments import arm, arm_found, arm_log, leg
from tests.plants import picked, polynomial_trajectory


@pytest.fixture
def robot() -> Robot:
    return arm()


def plan(robot: Robot) -> Trajectory:
    """Return a motion from rest to rest in 2 s."""
    t = np.polynomial.Polynomial([0.0, 1.0])
    shape = (t**3 * (2.0 - t) ** 3).coef  # velocity and acceleration are zero at both ends
    coefficients = np.outer(shape, [0.2, 0.4, -0.1, 0.3])
    return polynomial_trajectory(robot.joint_names, 2.0, coefficients, ("rail", "telescope"))


def log_of(robot: Robot, joint: Array, motor: Array, start: float = 0.0) -> Log:
    time = start + np.linspace(0.0, 0.01 * (len(joint) - 1), len(joint))
    nothing = np.full(joint.shape, np.nan)
    return Log(time, robot.joint_names, motor, joint, nothing, is_prismatic=robot.is_prismatic)


def ratios(robot: Robot) -> Array:
    """Return what motors turn when the joints move by one."""
    drives = robot.drives.values()
    return np.array([drive.ratio * drive.load_radius / drive.motor_radius for drive in drives])


def waves(robot: Robot, seed: int = 0) -> tuple[Array, Array]:
    """Return positions and deflections (100, n)."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, 100)[:, None]
    joint = rng.normal(size=robot.n) + np.sin(rng.uniform(3, 9, robot.n) * t)
    return joint, 0.3 + 0.01 * np.cos(rng.uniform(3, 9, robot.n) * t)


@pytest.mark.parametrize("robot", [arm(), leg()], ids=["arm", "leg"])
def test_log_is_played_as_it_is(robot: Robot) -> None:
    """From zero on, its columns found by name, with deflections about their mean."""
    joint, deflection = waves(robot)
    log = log_of(robot, joint, (joint + deflection) * ratios(robot), start=1.7e9)
    turned = picked(log, [*range(robot.n)][::-1], robot.joint_names[::-1])
    elastic = np.isin(robot.joint_names, robot.elastic_joints)
    about_mean = np.where(elastic, deflection - deflection.mean(axis=0), np.nan)
    for recorded in (log, turned):
        played = playback_of(robot, recorded, "run")
        assert played.time[0] == 0.0
        assert played.duration == pytest.approx(0.99, abs=1e-6)
        np.testing.assert_array_equal(played.position, joint)
        np.testing.assert_allclose(played.deflection, about_mean, atol=1e-12)
        assert played.notes == ()


def test_joint_without_encoder_is_where_its_motor_is(robot: Robot) -> None:
    """Without any encoder there is nothing to play."""
    joint, _ = waves(robot)
    motor, unseen = joint * ratios(robot), joint.copy()
    unseen[:, [1, 3]] = np.nan
    played = playback_of(robot, log_of(robot, unseen, motor), "run")
    np.testing.assert_allclose(played.position, joint, atol=1e-12)
    assert np.all(np.isnan(played.deflection[:, [0, 1, 3]]))
    unseen = np.where(np.arange(4) == 2, np.nan, joint)
    with pytest.raises(LogError, match="log 'run': no encoder gives the position of 'telescope'"):
        playback_of(robot, log_of(robot, unseen, unseen), "run")


@pytest.mark.parametrize("is_elastic", [True, False])
def test_coupled_drives_tell_their_joints_and_deflections(
    write_chain: Callable[..., Path], is_elastic: bool
) -> None:
    """Motors turn by the sum and the difference of two joints, springs by what they add to it."""
    spring = SeriesElasticDrive(10.0, stiffness_Nm_per_rad=100.0)
    kind: Any = spring if is_elastic else StiffDrive(10.0)
    drives = {
        joint: replace(kind, transmission={"a": 1.0, "b": sign})
        for joint, sign in (("a", 1.0), ("b", -1.0))
    }
    robot = load_robot(write_chain(dict.fromkeys("ab", 'continuous <axis xyz="0 1 0"/>')), drives)
    joint, deflection = waves(robot)
    turned = np.column_stack([joint.sum(axis=1), joint[:, 0] - joint[:, 1]])
    seen = joint if is_elastic else np.full(joint.shape, np.nan)
    motor = 10.0 * (turned + deflection * is_elastic)
    played = playback_of(robot, log_of(robot, seen, motor), "run")
    np.testing.assert_allclose(played.position, joint, atol=1e-12)
    if is_elastic:
        about_mean = deflection - deflection.mean(axis=0)
        np.testing.assert_allclose(played.deflection, about_mean, atol=1e-12)


def test_between_samples_it_is_on_the_line(robot: Robot) -> None:
    joint, deflection = waves(robot)
    played = playback_of(robot, log_of(robot, joint, (joint + deflection) * 100.0), "run")
    for time in (0.0, 0.0123, 0.5, 0.99):
        position, sprung = played.at(time)
        for shown, values in ((position, played.position), (sprung, played.deflection)):
            expected = [np.interp(time, played.time, column) for column in values.T]
            np.testing.assert_allclose(shown, expected, atol=1e-12)
    np.testing.assert_array_equal(played.at(-1.0)[0], joint[0])
    np.testing.assert_array_equal(played.at(9.0)[0], joint[-1])


def test_what_is_no_motion_of_the_robot_is_refused(robot: Robot) -> None:
    joint, _ = waves(robot)
    names = ("rail", "shoulder", "telescop", "wrist")
    words = r"'x' has no joint telescope of 'mixed_arm'; its joints: rail, shoulder, telescop, "
    motions: tuple[Any, ...] = (
        (replace(log_of(robot, joint, joint), joint_names=names), LogError, words),
        (replace(plan(robot), joint_names=names, prismatic_joints=()), ExcitationError, words),
        ({}, SeaidError, "cannot show 'x', a dict: give a Log of read_log"),
    )
    for motion, error, message in motions:
        with pytest.raises(error, match=message):
            playback_of(robot, motion, "x")


@given(st.floats(0.0, 1.0))
def test_colours_go_from_blue_through_yellow_to_red(part: float) -> None:
    """They end at the limit, and what is not known is neutral."""
    limit = np.array([2.0])
    plus, zero, minus = (
        deflection_colors(sign * 2 * np.array([part]), limit)[0] for sign in (1, 0, -1)
    )
    assert tuple(zero) == (255, 243, 186)
    assert plus[2] <= zero[2]
    assert minus[0] <= zero[0]
    if part > 0.5:
        assert plus[0] > plus[2] + 100
        assert minus[2] > minus[0] + 100
    largest = deflection_colors(limit, limit)
    np.testing.assert_array_equal(deflection_colors(np.array([5.0]), limit), largest)
    unknown = deflection_colors(np.array([np.nan, part]), np.array([1.0, 0.0]))
    np.testing.assert_array_equal(unknown, [NEUTRAL, NEUTRAL])


def test_scales_have_units(robot: Robot) -> None:
    """One scale for all joints that turn, and one for all that slide."""
    time, nothing = np.array([0.0, 1.0]), np.full((2, 4), np.nan)

    def deflected(turning: float, sliding: float) -> Playback:
        deflection = np.tile([-turning, 0.0, sliding, np.nan], (2, 1))
        return Playback("x", time, np.zeros((2, 4)), deflection, nothing, nothing)

    shown = [deflected(0.2, 3e-3), deflected(0.1, 4e-3)]
    ends = scales(shown, (False, False, True, True))
    np.testing.assert_array_equal(ends, [0.2, 0.2, 4e-3, 4e-3])
    np.testing.assert_array_equal(scales([], (False, True)), [0.0, 0.0])
    text = legend(robot, np.array([0.0, 0.0123, 0.004, 0.0]))
    for words in ("±12.3 mrad and ±4 mm at the ends", "motor minus joint side"):
        assert words in text
    assert "none is known" in legend(robot, np.zeros(4))


# Torques: what an identification computes is what was measured.


@pytest.mark.parametrize("kind", ["log", "motion"])
def test_torques_are_measured_and_identified_ones(kind: str) -> None:
    """By (7) of elastic joints, and by (8) of stiff ones."""
    identification = arm_found()
    motion = identification.motions[0] if kind == "motion" else arm_log(2, motion_seed=5)
    played = playback_of(arm(), motion, "x", identification)
    known = np.all(np.isfinite(played.torque), axis=1)
    assert np.mean(known) > 0.5  # without the transients of the filter
    error, measured = (played.computed - played.torque)[known], played.torque[known]
    assert np.all(np.linalg.norm(error, axis=0) < 0.1 * np.linalg.norm(measured, axis=0))
    elastic = [joint in arm().elastic_joints for joint in arm().joint_names]
    noise = (measured - motion.motor_torque[known])[:, elastic]
    assert np.all(np.linalg.norm(noise, axis=0) < 0.2 * np.linalg.norm(measured, axis=0)[elastic])
    assert played.notes == ()
    raw = playback_of(arm(), motion, "x")
    np.testing.assert_array_equal(raw.torque, motion.motor_torque)
    assert np.all(np.isnan(raw.computed))
    curves = played.curves(played.time[:3], 1)
    np.testing.assert_array_equal(curves[1], played.torque[:3, 1])


def test_torques_and_deflections_that_are_not_computed_have_a_reason(robot: Robot) -> None:
    """Of a plan without nominal values, and of a log that is too short."""
    played = playback_of(robot.without_nominal(), plan(robot), "plan")
    assert np.all(np.isnan(played.deflection))
    assert played.notes[0].startswith("planned; deflections are unknown: joint 'shoulder'")
    recorded = arm_log()
    short = recorded.between(recorded.time[0], recorded.time[0] + 0.4)
    played = playback_of(arm(), short, "x", arm_found())
    assert played.notes[0].startswith("torques are not computed: ")
    np.testing.assert_array_equal(played.torque, short.motor_torque)
