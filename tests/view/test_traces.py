"""Traces: what the true values predict is what was measured, and errors of values show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.log.log import Log
from seaid.robot.robot import Robot
from seaid.view.playback import Traces, playback_of
from tests.experiments import arm, arm_motion, perfect_log

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
