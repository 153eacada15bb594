"""A model in the place of the robot: the log of a simulation comes back from its inputs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid.checks.predictions import replay_worse
from seaid.simulation import compare_replays, replay
from seaid.simulation.replaying import rollout, without_unknown_terms
from tests.experiments import MODELS
from tests.one_joint import chain
from tests.plants import log_with
from tests.representatives import quick_first

PENDULUM = seaid.Payload("arm", 0.49, (0.0, 0.0, -0.1))
DRIVE = seaid.StiffDrive(gear_ratio=10.0, motor_inertia_kg_m2=2e-5).with_values(
    {"viscous_friction": 1e-4, "coulomb_friction": 2e-3}
)


def pendulum(drive: seaid.StiffDrive = DRIVE) -> seaid.Robot:
    return seaid.load_robot(
        MODELS / "xl330_pendulum.urdf", drives={"pendulum": drive}, payloads=(PENDULUM,)
    )


def swing(robot: seaid.Robot, torque: np.ndarray | None = None, step_s: float = 0.005) -> seaid.Log:
    """Return a log that starts at rest at 0.5 rad; only that and the torque matter."""
    time = np.arange(0.0, 1.2, step_s)
    more = {} if torque is None else {"motor_torque": torque}
    return log_with(robot.joint_names, time, joint_position=np.full(len(time), 0.5), **more)


def test_logged_torques_and_a_servo_that_gives_the_same_move_alike() -> None:
    """The servo holds its torque over each step of 0.2 ms, half of which it is late."""
    robot = pendulum()
    log = swing(robot, step_s=2e-4)

    def servo(at: float, position: np.ndarray) -> np.ndarray:
        return np.asarray(0.05 * (np.sin(3 * at) - position))

    fed_back = replay(robot, log, servo)
    logged = replay(robot, replace(log, motor_torque=fed_back.motor_torque))
    np.testing.assert_allclose(logged.joint_position, fed_back.joint_position, atol=1.1e-3)
    assert np.ptp(fed_back.joint_position) > 0.5


def test_a_logged_torque_is_linear_between_its_samples() -> None:
    """A torque that is held over each step of a millisecond is half of it late: 2 mrad here."""
    knots, moved = 0.03 * np.tile([0.0, 1.0, 0.0, -1.0], 3), []
    for step_s in (0.002, 0.0002):
        time = np.arange(0.0, 1.0, step_s)
        torque = np.interp(time, 0.1 * np.arange(len(knots)), knots)[:, None]
        start = np.full_like(torque, 0.5)
        log = log_with("pendulum", time, joint_position=start, motor_torque=torque)
        moved.append(replay(pendulum(), log).joint_position[:: round(0.002 / step_s)])
    assert np.ptp(moved[1]) > 1.0
    np.testing.assert_allclose(moved[0], moved[1], atol=6.4e-6)


def test_a_voltage_acts_through_its_constant() -> None:
    by_torque = pendulum()
    by_voltage = pendulum(replace(DRIVE, motor_input="voltage", nominal={"voltage_constant": 0.02}))
    plan = swing(by_torque)
    torque = 0.02 * np.sin(4 * plan.time)[:, None]
    expected = replay(by_torque, replace(plan, motor_torque=torque))
    found = replay(by_voltage, replace(plan, motor_voltage=torque / 0.02))
    np.testing.assert_allclose(found.joint_position, expected.joint_position, atol=1e-9)
    np.testing.assert_allclose(found.motor_torque, torque, atol=1e-12)


def test_what_is_missing_is_said() -> None:
    robot = pendulum()
    with pytest.raises(seaid.errors.LogError, match="no motor torque of 'pendulum'"):
        replay(robot, swing(robot))
    electric = pendulum(replace(DRIVE, motor_input="voltage"))
    with pytest.raises(seaid.errors.RobotError, match="'voltage_constant_Nm_per_V' is not given"):
        replay(electric, replace(swing(robot), motor_voltage=np.zeros((240, 1))))
    with pytest.raises(seaid.errors.RobotError, match="is not given; a simulation needs"):
        replay(pendulum(seaid.StiffDrive(gear_ratio=10.0)), swing(robot, np.zeros((240, 1))))


def test_the_start_of_a_noisy_log_has_the_speed_of_the_motion() -> None:
    robot = pendulum()
    plan = swing(robot)
    moved = replay(robot, plan, lambda at, _: np.array([0.03 * np.sin(5 * at)]))
    noise = np.random.default_rng(3).normal(size=(240, 1)) * 2e-3
    log = replace(
        plan, joint_position=moved.joint_position + noise, motor_torque=moved.motor_torque
    ).at(plan.time >= plan.time[80])  # it starts in motion
    error = replay(robot, log).joint_position - moved.joint_position[80:]
    # 0.1 s of a noise of 2 mrad gives a speed within 0.15 rad/s, its end slope one of 0.6 rad/s
    assert np.abs(error).max() < 0.03


def servo(**values: Any) -> seaid.Robot:
    controller = seaid.Controller(position_gain_Nm_per_rad=3.0, velocity_gain_Nms_per_rad=0.1)
    drive = seaid.StiffDrive(motor_input="position_command", controller=controller, **values)
    return pendulum(drive)


TRUTH = {
    "motor_inertia_kg_m2": 2e-3,
    "viscous_friction_Nms_per_rad": 0.05,
    "coulomb_friction_Nm": 0.05,
}


def commanded(noise: float = 1e-4) -> seaid.Log:
    robot = servo(**TRUTH)
    log = replace(
        swing(robot), position_command=0.5 * np.cos(4 * np.arange(0, 1.2, 0.005))[:, None]
    )
    moved = replay(robot, log).joint_position
    random = np.random.default_rng(1).normal(size=moved.shape) * noise
    return replace(log, joint_position=moved + random)


@pytest.mark.slow  # several replays
def test_the_replay_of_the_truth_leaves_noise_and_that_of_the_nominal_model_its_friction() -> None:
    log = commanded()
    found = seaid.compare_replays(servo(), servo(**TRUTH), log)
    assert found.noise == pytest.approx([1e-4], rel=0.2)
    assert 0.9e-4 < found.rms_errors[1][0] < 2e-4  # noise, and that of the start
    nominal = {"motor_inertia_kg_m2": 0.0, "coulomb_friction_Nm": 0.0}
    zero = servo(**nominal, viscous_friction_Nms_per_rad=0.0)
    own = replay(zero, log).joint_position - log.joint_position
    assert found.mean_absolute_errors[0] == pytest.approx(np.abs(own).mean(axis=0), rel=1e-6)
    assert found.mean_absolute_errors[0][0] > 0.01
    assert not found.warnings
    content = found.to_dict()
    assert content["joints"]["pendulum"]["after"]["rms_error"] == found.rms_errors[1][0]
    assert content["mean_absolute_error"]["before"] == found.mean_absolute_errors[0][0]
    text = str(found)
    assert f"{1e3 * found.rms_errors[0][0]:.3g}" in text
    assert "mrad before" in repr(found)


@pytest.mark.slow  # 0.7 s
def test_a_model_that_replays_worse_is_named() -> None:
    worse = without_unknown_terms(servo())
    (warning,) = seaid.compare_replays(servo(**TRUTH), worse, commanded()).warnings
    assert (warning.code, warning.severity) == ("replay-worse", "wrong")
    assert warning.evidence["ratio"] > 10
    torques = pendulum()
    log = replay(torques, swing(torques, np.zeros((240, 1))))
    heavy = pendulum(replace(DRIVE, coulomb_friction_Nm=4e-3))
    (open_loop,) = seaid.compare_replays(torques, heavy, log).warnings
    assert open_loop.severity == "doubtful"


@pytest.mark.slow  # a replay in short steps
def test_a_nominal_model_that_is_too_fast_to_simulate_gets_the_least_rotor_inertia() -> None:
    """An arm of 1e-5 kg m^2 at 1000 N m/rad, without damping, oscillates at 1.6 kHz."""
    bare = without_unknown_terms(servo(friction=()))
    law = seaid.Controller(position_gain_Nm_per_rad=1000.0)
    fast = seaid.load_robot(
        MODELS / "xl330_pendulum.urdf",
        {"pendulum": replace(bare.drives["pendulum"], controller=law)},
    )
    log = commanded()
    with pytest.raises(seaid.SeaidError, match="the simulation diverged"):
        replay(fast, log)
    drive = replace(fast.drives["pendulum"], motor_inertia_kg_m2=0.02)
    after = fast.with_drives({"pendulum": drive})
    found = seaid.compare_replays(fast, after, log)
    (note,) = (one for one in found.warnings if one.code == "rotor-inertia")
    assert (note.joint, note.severity) == ("pendulum", "note")
    assert note.evidence == {"pendulum": pytest.approx(1000.0 * (10 * 5e-4) ** 2)}
    assert np.all(np.isfinite(found.before))
    (other,) = (
        one
        for one in seaid.compare_replays(after, fast, log).warnings
        if one.code == "rotor-inertia"
    )
    assert other.severity == "doubtful"
    assert "diverged under the controllers: the identified model was replayed" in other.message


@pytest.mark.slow  # 5.6 s
@pytest.mark.parametrize("is_held", quick_first([False, True]))
def test_a_replay_in_long_steps_is_that_of_short_ones(is_held: bool) -> None:
    """The controllers act within the steps, and a held command counts with its mean."""
    robot = servo(**TRUTH)
    drive = robot.drives["pendulum"]
    assert drive.controller is not None
    law = replace(drive.controller, torque_limit_Nm=0.4, is_held=is_held)
    robot = robot.with_drives({"pendulum": replace(drive, controller=law)})
    log = commanded()
    short, long = (
        rollout(robot, log, longest_closed_s=step).joint_position for step in (5e-5, 2e-3)
    )
    assert np.max(np.abs(long - short)) < (2e-4 if is_held else 2e-5) * np.ptp(short)


@pytest.mark.slow  # a replay in short steps
def test_friction_without_inertia_is_replayed_with_a_millisecond_of_it() -> None:
    robot, heavier = (
        servo(motor_inertia_kg_m2=x, viscous_friction_Nms_per_rad=10.0, coulomb_friction_Nm=0.05)
        for x in (0.0, 0.02)
    )
    found = seaid.compare_replays(heavier, robot, commanded())
    (note,) = (one for one in found.warnings if one.code == "rotor-inertia")
    assert (note.joint, note.severity) == ("pendulum", "note")
    assert note.message.startswith("viscous friction stops joints within 1 ms: the identified")
    assert "pendulum" in note.message
    assert note.evidence["pendulum"] == pytest.approx(1e-3 * 10 - 4.91e-3, rel=1e-3)
    exact = replay(robot, commanded()).joint_position
    speed = np.max(np.abs(np.diff(exact[:, 0]))) / 0.005
    assert np.max(np.abs(found.after - exact)) < 1.5e-3 * speed


def test_one_joint_of_several_that_is_replayed_worse_is_named() -> None:
    after, ratios = {"a": 0.01, "b": 0.01, "c": 0.02}, {"a": 0.1, "b": 0.1, "c": 2.0}
    (warning,) = replay_worse(after, ratios, ["mrad", "mrad", "mm"], True)
    assert (warning.joint, warning.severity) == ("c", "doubtful")
    assert "20 mm, 2 times that before" in warning.message


def test_a_nominal_model_without_a_stiffness_has_the_identified_one(tmp_path: Path) -> None:
    spring = seaid.SeriesElasticDrive(
        gear_ratio=10.0, motor_inertia_kg_m2=2e-3, friction=(), stiffness_Nm_per_rad=40.0
    )
    robot = chain(tmp_path, "first").with_drives({"first": spring})
    time = np.arange(0.0, 0.3, 0.005)
    torque, still = 0.1 * np.sin(9 * time)[:, None], np.zeros((len(time), 1))
    start = {"joint_position": still, "motor_position": still}
    log = log_with(robot.joint_names, time, motor_torque=torque, **start)
    log = replace(log, joint_position=rollout(robot, log).joint_position)
    unknown = robot.with_drives({"first": replace(spring, stiffness_Nm_per_rad=None)})
    compared = compare_replays(unknown, robot, log)
    np.testing.assert_array_equal(compared.before, compared.after)
    assert np.ptp(compared.after) > 0.0


def test_models_of_two_robots_are_refused() -> None:
    other = seaid.load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml")
    with pytest.raises(seaid.SeaidError, match=r"before=: the joints .*give two models of one"):
        seaid.compare_replays(other, servo(**TRUTH), commanded())


def two_joints(folder: Path) -> tuple[seaid.Robot, seaid.Log]:
    """Return a chain of two joints whose motions are coupled, and a log of it."""
    drive = seaid.StiffDrive(gear_ratio=1.0, motor_inertia_kg_m2=0.2, friction=())
    robot = chain(folder, "first", "second").with_drives({"first": drive, "second": drive})
    time = np.arange(0.0, 0.6, 0.01)
    torque = np.column_stack([2 * np.sin(9 * time), 9 * np.sin(14 * time)])
    start = np.full_like(torque, 0.1)
    log = log_with(robot.joint_names, time, joint_position=start, motor_torque=torque)
    moved = rollout(robot, log)
    return robot, replace(log, joint_position=moved.joint_position)


def test_a_held_joint_follows_its_motion_and_leaves_the_errors_of_the_others(
    tmp_path: Path,
) -> None:
    robot, log = two_joints(tmp_path)
    heavy = replace(robot.drives["second"], motor_inertia_kg_m2=9.0)
    wrong = robot.with_drives({"second": heavy})
    unknown = log.motor_torque.copy()
    unknown[:, 1] = np.nan
    both = compare_replays(robot, wrong, log)
    held = compare_replays(robot, wrong, replace(log, motor_torque=unknown), {"second": "reason"})
    assert held.joints == ("first",)
    assert np.max(held.rms_errors) < 0.05 * both.rms_errors[1][0]
    (note,) = held.warnings
    assert (note.code, note.joint, note.severity) == ("not-replayed", "second", "note")
    assert note.message.endswith(": reason")
    with pytest.raises(seaid.SeaidError, match="no joint is left to replay: first: a"):
        compare_replays(robot, robot, log, {"first": "a", "second": "b"})
