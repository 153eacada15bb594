"""Motions as they are played: positions, deflections about their mean, colours and their scale."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from seaid.legged import load_robot
from seaid.log.motion import reconstruct_motion
from seaid.log.reading import Log
from seaid.robot.robot import Robot
from seaid.simulation.simulation import simulate
from seaid.view.panel import deflection_colors, gradient, legend, plain_text, table
from seaid.view.picture import NEUTRAL
from seaid.view.playback import Playback, Shown, Traces, playback_of, scales, traces_of
from tests.experiments import arm, arm_motion, perfect_log

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
    springs = {
        "a": replace(spring, transmission={"a": 1.0, "b": 1.0}),
        "b": replace(spring, transmission={"a": 1.0, "b": -1.0}),
    }
    robot = load_robot(write_chain(chain), springs)
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


# Traces: what the true values predict is what was measured, and errors of values show.


WRONG_BY = 1.3


def log() -> Log:
    return perfect_log(arm(), arm_motion())


def relative_errors(of: Mapping[str, Array], source: str) -> Array:
    """Return the norm of source less measured over that of the measured (n,)."""
    error, signal = of[source] - of["measured"], of["measured"]
    both = np.isfinite(error)
    squares = (np.sum(np.where(both, x, 0.0) ** 2, axis=0) for x in (error, signal))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.divide(*squares)))


def stiffer(robot: Robot, factor: float) -> Robot:
    """Return a robot with other springs."""
    drives = {joint: robot.drives[joint] for joint in robot.elastic_joints}
    return robot.with_drives(
        {
            joint: drive.with_values({"stiffness": factor * drive.values["stiffness"]})
            for joint, drive in drives.items()
        }
    )


def test_true_values_predict_the_measured_torques_and_deflections() -> None:
    traces = playback_of(arm(), log(), "x").traces
    assert list(traces.torque) == list(traces.deflection) == ["measured", "nominal"]
    assert np.all(relative_errors(traces.torque, "nominal") < 0.03)
    elastic = [arm().index(joint) for joint in arm().elastic_joints]
    assert np.all(relative_errors(traces.deflection, "nominal")[elastic] < 0.01)
    stiff = [i for i in range(arm().n) if i not in elastic]
    assert np.all(np.isnan(traces.deflection["nominal"][:, stiff]))


def test_wrong_values_show_in_the_traces_of_their_robot() -> None:
    heavy = arm().with_values(WRONG_BY * arm().parameters, stiffer(arm(), WRONG_BY).drives)
    traces = playback_of(heavy, log(), "x", arm()).traces
    assert list(traces.torque) == ["measured", "nominal", "identified"]
    assert np.all(relative_errors(traces.torque, "identified") < 0.03)
    elastic = [arm().index(joint) for joint in arm().elastic_joints]
    assert np.max(relative_errors(traces.torque, "nominal")) > 0.1
    np.testing.assert_allclose(  # bodies and springs by the same factor: the same deflection
        traces.deflection["nominal"][:, elastic], traces.deflection["identified"][:, elastic]
    )
    soft = playback_of(stiffer(arm(), 1 / WRONG_BY), log(), "x", arm()).traces.deflection
    sizes = [np.nanstd(soft[source][:, elastic], axis=0) for source in ("nominal", "identified")]
    np.testing.assert_allclose(np.divide(*sizes), WRONG_BY)


def test_motor_side_of_a_plan_follows_from_its_joints() -> None:
    """The plan has no motors: their speeds come from the springs, and their torques from (7)."""
    motion = arm_motion()
    with_motors = playback_of(arm(), motion, "x").traces
    nothing = np.full_like(motion.motor_position, np.nan)
    joints = replace(
        motion, motor_position=nothing, motor_velocity=nothing, motor_acceleration=nothing
    )
    without = playback_of(arm(), joints, "x").traces
    a, b = with_motors.torque["nominal"][20:-20], without.torque["nominal"][20:-20]
    assert np.all(np.linalg.norm(a - b, axis=0) < 0.05 * np.linalg.norm(a, axis=0))


def sensed_at_the_joints(given: Log) -> Log:
    """Return a log with torque sensors at the joints in place of those of the motors."""
    torque = np.repeat(given.time[:, None], given.motor_torque.shape[1], axis=1)
    return replace(given, motor_torque=np.full_like(torque, np.nan), joint_torque=torque)


def test_torque_is_that_of_the_sensor_there_is() -> None:
    given = log()
    at_motor = playback_of(arm(), given, "x").traces
    assert at_motor.at_motor == (True,) * 4
    at_joint = playback_of(arm(), sensed_at_the_joints(given), "x").traces
    assert at_joint.at_motor == (False,) * 4
    ratios = np.array([arm().drives[joint].ratio for joint in arm().joint_names])
    inside = slice(100, -100)
    torque = at_joint.torque["nominal"][inside]
    assert np.all(np.std(torque, axis=0) > 0.5 * np.std(at_motor.torque["nominal"][inside], axis=0))
    assert np.max(ratios) > 1
    measured = at_joint.torque["measured"][inside, 0]
    np.testing.assert_allclose(measured, at_joint.time[inside] + given.time[0], atol=0.01)


def test_current_counts_by_the_constant_of_the_identified_drive() -> None:
    joint, constant, given = arm().joint_names[0], 0.05, log()
    drive = replace(arm().drives[joint], motor_input="current")
    robot = arm().with_drives({joint: drive.with_values({"torque_constant": constant})})
    torque = given.motor_torque.copy()
    current = np.full_like(torque, np.nan)
    current[:, 0], torque[:, 0] = torque[:, 0] / constant, np.nan
    fed = replace(given, motor_torque=torque, motor_current=current)
    expected = playback_of(arm(), given, "x").traces.torque["measured"]
    found = playback_of(robot.without_nominal(), fed, "x", robot).traces.torque
    np.testing.assert_allclose(found["measured"], expected, atol=1e-9)
    assert "nominal" not in found
    unknown = robot.without_nominal()
    assert np.all(np.isnan(playback_of(unknown, fed, "x").traces.torque["measured"][:, 0]))


def holes(given: Log) -> Log:
    """Return a log without a second in its middle."""
    kept = (given.time < 2.5) | (given.time > 3.5)
    return replace(
        given,
        time=given.time[kept],
        motor_position=given.motor_position[kept],
        joint_position=given.joint_position[kept],
        motor_torque=given.motor_torque[kept],
        joint_torque=None,
    )


def test_holes_have_no_torques() -> None:
    traces = playback_of(arm(), holes(log()), "x").traces
    gap = (traces.time > 2.6) & (traces.time < 3.4)
    for source in ("measured", "nominal"):
        assert np.all(np.isnan(traces.torque[source][gap]))
        assert np.all(np.isfinite(traces.torque[source][traces.time == 1.0 * traces.time[200]]))
    assert np.all(relative_errors(traces.torque, "nominal") < 0.05)


def test_log_too_short_for_an_identification_has_raw_torques() -> None:
    given = log()
    short = given.between(given.time[0], given.time[0] + 0.4)
    played = playback_of(arm(), short, "x")
    assert played.notes == ()
    np.testing.assert_allclose(played.traces.torque["measured"][0], short.motor_torque[0])
    assert list(played.traces.torque) == ["measured"]
    (note,) = playback_of(arm(), short, "x", arm()).notes
    assert note.startswith("torques are not computed: ")


def test_model_without_values_is_named_if_models_are_compared() -> None:
    unknown = arm().without_nominal()
    assert playback_of(unknown, log(), "x").notes == ()
    (note,) = playback_of(unknown, log(), "x", arm()).notes
    assert note.startswith("torques of the nominal model are not computed: ")
    assert "no nominal stiffness" in note


def test_traces_are_short_and_about_their_means() -> None:
    traces: Traces = playback_of(arm(), log(), "x").traces
    assert len(traces.time) == 600
    assert traces.time[[0, -1]] == pytest.approx([0.0, log().time[-1] - log().time[0]])
    means = np.nanmean(traces.deflection["measured"], axis=0)
    np.testing.assert_allclose(means, 0.0, atol=1e-12)
    error = traces.deflection["nominal"] - traces.deflection["measured"]
    error = error[np.all(np.isfinite(error[:, 1:3]), axis=1), 1:3]
    np.testing.assert_allclose(np.mean(error, axis=0), 0.0, atol=1e-12)
