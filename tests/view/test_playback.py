"""Motions as they are played: positions, deflections about their mean, colours and their scale."""

from collections.abc import Callable, Mapping
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
from seaid.log import Log, reconstruct_motion
from seaid.robot import Robot
from seaid.simulation import simulate
from seaid.view.panel import deflection_colors, gradient, legend, plain_text, table
from seaid.view.picture import NEUTRAL
from seaid.view.playback import Playback, playback_of, scales, traces_of
from tests.experiments import arm, arm_motion, perfect_log
from tests.plants import polynomial_trajectory

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
    """From zero on, its columns found by name, with deflections about their mean."""
    joint, deflection = waves(robot)
    motor = (joint + deflection) * [50.0 * 2.0, 80.0 / 0.015, 30.0]  # N r_L / r_M
    log = log_of(robot, joint, motor, start=1.7e9)
    order = [2, 0, 1]
    turned = Log(
        log.time,
        tuple(robot.joint_names[index] for index in order),
        log.motor_position[:, order],
        log.joint_position[:, order],
        log.motor_torque[:, order],
    )
    for recorded in (log, turned):
        played = playback_of(robot, recorded, "run")
        assert played.time[0] == 0.0
        assert played.duration == pytest.approx(0.99, abs=1e-6)
        np.testing.assert_array_equal(played.position, joint)
        about_mean = (deflection - deflection.mean(axis=0))[:, :2]
        np.testing.assert_allclose(played.deflection[:, :2], about_mean, atol=1e-12)
        assert np.all(np.isnan(played.deflection[:, 2]))
        assert played.notes == ()


def test_joint_without_encoder_is_where_its_motor_is(robot: Robot) -> None:
    """Which is said of a spring; without any encoder there is nothing to play."""
    joint, _ = waves(robot)
    motor, unseen = joint * [100.0, 80.0 / 0.015, 30.0], joint.copy()
    unseen[:, [0, 2]] = np.nan
    played = playback_of(robot, log_of(robot, unseen, motor), "run")
    np.testing.assert_allclose(played.position, joint, atol=1e-12)
    assert np.all(np.isnan(played.deflection[:, [0, 2]]))
    note = "no encoder at 'turn': its position is that of its motor, without spring deflection"
    assert played.notes == (note,)
    unseen = np.where(np.arange(3) == 1, np.nan, joint)
    with pytest.raises(LogError, match="log 'run': no encoder gives the position of 'slide'"):
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
    robot = load_robot(write_chain(dict.fromkeys("ab", f"revolute {AXIS}{LIMIT}")), drives)
    joint, deflection = waves(robot)
    turned = np.column_stack([joint.sum(axis=1), joint[:, 0] - joint[:, 1]])
    seen = joint if is_elastic else np.full(joint.shape, np.nan)
    motor = 10.0 * (turned + deflection * is_elastic)
    played = playback_of(robot, log_of(robot, seen, motor), "run")
    np.testing.assert_allclose(played.position, joint, atol=1e-12)
    if is_elastic:
        about_mean = deflection - deflection.mean(axis=0)
        np.testing.assert_allclose(played.deflection, about_mean, atol=1e-12)


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


def test_what_is_no_motion_of_the_robot_is_refused(robot: Robot) -> None:
    """A log and a plan of other joints, and another object."""
    joint, _ = waves(robot)
    names = ("turn", "slid", "stiff")
    words = r"'x' has no joint slide of 'test'; its joints: turn, slid, "
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
    unknown = deflection_colors(np.array([np.nan, part]), np.array([1.0, 0.0]))
    assert unknown == [NEUTRAL, NEUTRAL]


def test_scales_and_numbers_have_units_and_names_are_no_markup(
    robot: Robot, write_chain: Callable[..., Path]
) -> None:
    """One scale for all joints that turn, and one for all that slide."""
    time, nothing = np.array([0.0, 1.0]), np.full((2, 1), np.nan)

    def one(turning: float, sliding: float) -> Playback:
        deflection = np.hstack([[[-turning]] * 2, [[0.0]] * 2, [[sliding]] * 2, nothing])
        return Playback("x", time, np.zeros((2, 4)), deflection, traces_of(1.0, {}, ()))

    found = scales([one(0.2, 3e-3), one(0.1, 4e-3)], (False, False, True, True))
    np.testing.assert_array_equal(found, [0.2, 0.2, 4e-3, 4e-3])
    text = legend(robot, np.array([0.0123, 0.004, 0.0]))
    for words in (gradient(), "+12.3 mrad", "−4", "+4 mm", "motor side (through the gear) minus j"):
        assert words in text
    assert "no deflection is known" in legend(robot, np.zeros(3))
    rigid = robot.with_drives({"turn": STIFF, "slide": StiffDrive()})
    assert "no joint has a spring" in legend(rigid, np.zeros(3))
    name = "&lt;b&gt;x&lt;/b&gt;"
    hostile = load_robot(write_chain({name: f"revolute {LIMIT}", "slide": f"prismatic {LIMIT}"}))
    text = table(hostile, np.array([-0.5, 0.25]), np.full(2, np.nan), [NEUTRAL] * 2)
    text += table(robot, np.zeros(3), np.array([0.0123, -0.002, np.nan]), [NEUTRAL] * 3)
    for words in (name, "−0.500 rad", "+0.250 m", "+12.30 mrad", "−2.00 mm"):
        assert words in text
    assert "<b>x" not in text
    assert "nan" not in text
    assert plain_text(["<i>"]).count("&lt;i&gt;") == 1


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


def test_torque_is_that_of_the_sensor_there_is() -> None:
    """Sensors at the joints have the torques of the load, by the ratio of the gear larger."""
    recorded = log()
    at_motor = playback_of(arm(), recorded, "x").traces
    measured = np.repeat(recorded.time[:, None], 4, axis=1)
    nothing = np.full_like(measured, np.nan)
    sensed = replace(recorded, motor_torque=nothing, joint_torque=measured)
    at_joint = playback_of(arm(), sensed, "x").traces
    assert (at_motor.at_motor, at_joint.at_motor) == ((True,) * 4, (False,) * 4)
    sizes = [np.std(x.torque["nominal"][100:-100], axis=0) for x in (at_joint, at_motor)]
    assert np.all(sizes[0] > 0.5 * sizes[1])
    shown = at_joint.torque["measured"][100:-100, 0]
    np.testing.assert_allclose(shown, at_joint.time[100:-100] + recorded.time[0], atol=0.01)


def test_traces_are_short_about_their_means_and_without_torques_in_holes() -> None:
    """A log without a second in its middle."""
    recorded = log()
    traces = playback_of(arm(), replace(recorded, time=recorded.time + 5.0), "x").traces
    assert len(traces.time) == 600
    assert traces.time[[0, -1]] == pytest.approx([0.0, np.ptp(recorded.time)])
    error = traces.deflection["nominal"] - traces.deflection["measured"]
    for values in (traces.deflection["measured"], error[:, 1:3]):
        known = values[np.all(np.isfinite(values), axis=1)]
        np.testing.assert_allclose(np.mean(known, axis=0), 0.0, atol=1e-12)
    kept = (recorded.time < 2.5) | (recorded.time > 3.5)
    sensors = ("motor_position", "joint_position", "motor_torque")
    changes: dict[str, Any] = {name: getattr(recorded, name)[kept] for name in sensors}
    holes = replace(recorded, time=recorded.time[kept], joint_torque=None, **changes)
    traces = playback_of(arm(), holes, "x").traces
    gap = (traces.time > 2.6) & (traces.time < 3.4)
    for source in ("measured", "nominal"):
        assert np.all(np.isnan(traces.torque[source][gap]))
    assert np.all(relative_errors(traces.torque, "nominal") < 0.05)


def test_torques_that_are_not_computed_have_a_reason(robot: Robot) -> None:
    """Of a plan, of a log that is too short, and of models that are compared without values."""
    played = playback_of(robot.without_nominal(), plan(robot), "plan")
    assert np.all(np.isnan(played.deflection))
    assert played.notes[0].startswith("planned; deflections are unknown: joint 'turn'")
    recorded = log()
    short = recorded.between(recorded.time[0], recorded.time[0] + 0.4)
    played = playback_of(arm(), short, "x")
    assert played.notes == ()
    assert list(played.traces.torque) == ["measured"]
    np.testing.assert_allclose(played.traces.torque["measured"][0], short.motor_torque[0])
    assert playback_of(arm().without_nominal(), recorded, "x").notes == ()
    for nominal, motion, words in (
        (arm(), short, "torques are not computed: "),
        (arm().without_nominal(), recorded, "torques of the nominal model are not computed: "),
    ):
        (note,) = playback_of(nominal, motion, "x", arm()).notes
        assert note.startswith(words)
