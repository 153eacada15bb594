"""identify: its choices, its result, and logs that have no answer."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError, IdentificationError, LogError, RobotError
from seaid.estimation import Estimate
from seaid.identification import Identification, cross_validate, identify
from seaid.identification.checking import check_channels
from seaid.legged import load_robot
from seaid.log import Log, open_long_log, write_log
from seaid.regressor import joint_torques
from seaid.simulation.simulation import measure
from tests.experiments import (
    ELASTIC,
    LEG_SENSORS,
    TEST_MASS,
    leg,
    leg_log,
    leg_motion,
    load_scores,
)
from tests.mistakes import unlogged, with_channels

KNOWN = leg(TEST_MASS).without_nominal()


def changed(field: str, joint: str, value: float) -> Log:
    """Return the log with one signal of one joint held at a value."""
    return with_channels(leg_log(), joint, **{field: lambda x: np.full_like(x, value)})


def test_a_dead_torque_is_no_mistake_where_no_equation_has_it() -> None:
    """That of a joint with a spring is in the equation of its motor in any case."""
    joints = leg().joint_names
    for joint, used, is_refused in (
        ("hip_yaw", joints, True),
        ("hip_yaw", [x for x in joints if x != "hip_yaw"], False),
        ("knee_pitch", [x for x in joints if x != "knee_pitch"], True),
    ):
        dead = changed("motor_torque", joint, 0.0)
        with pytest.raises(LogError) if is_refused else nullcontext() as caught:
            check_channels(leg(), [dead], used, ())
        assert caught is None or "its torque by torque_joints= of the others" in str(caught.value)


def test_found_robot_has_the_found_values() -> None:
    robot = found().robot
    assert found().base.project(robot.parameters) == pytest.approx(found().load.values, abs=1e-9)
    for joint in ELASTIC:
        stiffness = robot.drives[joint].own_values["stiffness"]
        assert stiffness == found().drives[joint].value("stiffness")
    friction = robot.drives["hip_yaw"].viscous_friction_Nms_per_rad
    assert friction == found().drives["hip_yaw"].value("viscous_friction")


@pytest.mark.usefixtures("estimates_only")
@pytest.mark.rounding
def test_torques_that_are_used_are_those_named_or_measured() -> None:
    part = identify(KNOWN, leg_log(), torque_joints=ELASTIC)
    assert len(part.load.values) == 21
    assert tuple(part.drives) == ELASTIC
    assert part.model.torque_joints == ELASTIC
    part = identify(KNOWN, changed("motor_torque", "hip_yaw", np.nan))
    assert part.model.torque_joints == KNOWN.joint_names[1:]
    assert "hip_yaw" not in part.drives


def test_robot_without_drives_is_identified_from_its_joint_torques(tulip_urdf: Path) -> None:
    robot = load_robot(tulip_urdf, payloads=(TEST_MASS,))
    motion = leg_motion(TEST_MASS)
    torques = joint_torques(robot, *motion.joint_states)
    ideal = unlogged(leg_log(), "motor_torque", "motor_position")
    ideal = replace(ideal, joint_position=motion.joint_position, joint_torque=torques)
    result = identify(robot.without_nominal(), ideal, cutoff_hz=20.0)
    assert not result.drives
    true = result.base.project(robot.parameters)
    assert np.max(np.abs(result.load.values - true)) < 0.002 * np.max(np.abs(true))


@pytest.mark.slow  # 1.0 s
def test_wrong_joint_zeros_are_within_errors_that_know_of_them() -> None:
    noise = replace(LEG_SENSORS, joint_offset_rad=(0.01, -0.01, 0.01, 0.01, -0.01))
    shifted = measure(leg(TEST_MASS), leg_motion(TEST_MASS), noise, 1)
    worst = []
    for std in (0.0, 0.01):
        result = identify(KNOWN, shifted, encoder_offset_std=std)
        worst.append(np.max(np.abs(load_scores(result, leg(TEST_MASS)))))
    assert worst[0] > 5.0
    assert worst[1] < 3.5


# identify: both sides at once, possible bodies, files, checks, cross-validation.


KNOWN_STD = {"torque": 0.03, "payload": 0.1, "gear_ratio": 0.001}


def options_of(is_stated: bool) -> dict[str, Any]:
    return {"known_std": KNOWN_STD if is_stated else {}, "encoder_offset_std": 0.002}


@cache
def found(is_stated: bool = False) -> Identification:
    return identify(KNOWN, leg_log(), method="two-step", **options_of(is_stated))


def assert_same(one: Estimate, other: Estimate, tolerance: float = 1e-9) -> None:
    assert one.names == other.names
    np.testing.assert_allclose(
        one.values, other.values, rtol=tolerance, atol=tolerance * one.standard_errors.min()
    )
    np.testing.assert_allclose(one.standard_errors, other.standard_errors, rtol=1e-6)


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize(
    ("suffix", "is_stated"), [(".csv", False), (".npz", False), (".npz", True)]
)
def test_a_file_is_identified_as_a_log_is(tmp_path: Path, suffix: str, is_stated: bool) -> None:
    """In the same pass band, and with the errors of what was given as known."""
    path, right = tmp_path / f"log{suffix}", found(is_stated)
    write_log(leg_log(), path)
    opened = open_long_log(path, KNOWN, cutoff_hz=right.cutoff_hz, chunk_samples=3000)
    for source in (str(path), opened):
        one = identify(KNOWN, source, **options_of(is_stated))
        assert one.cutoff_hz == right.cutoff_hz
        assert one.excluded == right.excluded
        assert_same(one.load, right.load, 1e-7)
        for joint in ELASTIC:
            assert_same(one.drives[joint], right.drives[joint], 1e-7)
        assert not one.checks["load"].whiteness  # its rows are not kept
        assert one.warnings == right.warnings


@pytest.mark.slow  # 0.6 s
def test_a_long_log_in_another_pass_band_is_opened_anew(tmp_path: Path) -> None:
    write_log(leg_log(), tmp_path / "log.npz")
    opened = open_long_log(tmp_path / "log.npz", KNOWN, cutoff_hz=6.0)
    assert identify(KNOWN, opened, cutoff_hz=5.0).cutoff_hz == 5.0
    assert identify(KNOWN, opened).cutoff_hz == 6.0


def test_checks_say_that_each_term_is_worth_having() -> None:
    checks = found().checks
    assert set(checks) == {*ELASTIC, "load"}
    for joint in ELASTIC:
        names = {term.terms[0] for term in checks[joint].terms}
        assert names == {"viscous_friction", "coulomb_friction"}
        assert all(term.bic > 0 for term in checks[joint].terms)
        assert set(checks[joint].whiteness) == {joint}
    assert len(checks["load"].terms) == 4
    assert set(checks["load"].whiteness) == set(KNOWN.joint_names)


def without_joint(log: Log) -> Log:
    """Return the log without the last joint."""
    sides = ("motor_position", "joint_position", "motor_torque")
    columns = {side: getattr(log, side)[:, :4] for side in sides}
    return replace(log, joint_names=log.joint_names[:4], is_prismatic=(False,) * 4, **columns)


def still(noise_rad: float) -> Log:
    """Return the log of a robot that stands still, with noise of the motor encoders."""
    noise = noise_rad * np.random.default_rng(0).normal(size=leg_log().motor_position.shape)
    return replace(leg_log(), motor_position=0.3 + noise, joint_position=0.1 + 0.0 * noise)


def sensed_at_knee() -> Log:
    """Return the log with a torque sensor at the knee in the place of that of its motor."""
    sensed = np.where(np.arange(5) == 3, leg_motion(TEST_MASS).joint_torque, np.nan)
    return replace(changed("motor_torque", "knee_pitch", np.nan), joint_torque=sensed)


without = partial(changed, "motor_torque", value=np.nan)
SOME = {"torque_joints": ("hip_yaw", "hip_pitch")}
OPTIONS: list[tuple[dict[str, Any], str]] = [
    ({"estimator": "wsl"}, "no estimator is named 'wsl'; did you mean 'wls'"),
    ({"estimator": "kalman"}, "no estimator is .* 'kalman'; allowed: .*ols"),
    ({"method": "two-stp"}, "is named 'two-stp'; did you mean 'two-step'"),
    ({"known_std": {"mass": 0.1}}, "no constant is named 'mass'"),
    ({"known_std": {"torque": 2.0}}, "of 'torque' must be a relative stand"),
    ({"known_std": {"torque": 0.0}}, "deviation above 0 and at most 1, found 0.0"),
    ({"known_std": {"torque": True}}, "must be a number, found True"),
    ({"known_std": {"bodies": 0.1}}, "known_std has 'bodies', and of the robot none is known"),
    *(
        ({"encoder_offset_std": std}, "must be from 0 to 1000 rad or m")
        for std in (-0.1, float("nan"), float("inf"), 1e200)
    ),
]
REFUSED: list[tuple[Callable[[], Any], dict[str, Any], type[Exception], str]] = [
    *((leg_log, option, IdentificationError, words) for option, words in OPTIONS),
    (leg_log, {"torque_joints": ("knee",)}, RobotError, "'knee'; did you mean 'knee_pitch'"),
    (leg_log, {"torque_joints": ()}, ExcitationError, "names no joint: give those whose torque is"),
    (lambda: [], {}, IdentificationError, "identify needs a log, found none"),
    (lambda: [3.0], {}, IdentificationError, "must be a Log, .* or a list .*list with 3.0"),
    (lambda: without_joint(leg_log()), {}, LogError, "has no joint ankle_pitch of 'tulip_leg'"),
    (lambda: without(joint="knee_pitch"), {}, LogError, "joint 'knee_pitch' has no torque in"),
    (lambda: without(joint="hip_yaw"), SOME, LogError, "no torque in the log at hip_yaw; name the"),
    (lambda: [leg_log(), sensed_at_knee()], {}, LogError, "must have the same torque sensors"),
    (lambda: still(0.0), {}, ExcitationError, "no joint moves in the log"),
    (lambda: still(1e-3), {}, ExcitationError, "no joint moves in the log"),
    *(
        (
            partial(changed, field, joint, 0.4),
            {},
            LogError,
            f"{field.replace('_', ' ')} of '{joint}' is 0.4 all .* moves: a dead channel",
        )
        for field, joint in (
            ("joint_position", "knee_pitch"),
            ("joint_position", "hip_roll"),
            ("motor_torque", "knee_pitch"),
            ("motor_torque", "hip_yaw"),
            ("motor_position", "hip_yaw"),
        )
    ),
]


@pytest.mark.parametrize(("logs", "options", "kind", "words"), REFUSED)
def test_options_and_logs_without_an_answer_are_refused(
    logs: Callable[[], Any], options: dict[str, Any], kind: type[Exception], words: str
) -> None:
    """The error names the values that are allowed, or the joint and the channel."""
    with pytest.raises(kind, match=words):
        identify(KNOWN, logs(), **options)


@pytest.mark.slow  # several identifications of the leg
@pytest.mark.usefixtures("estimates_only")
def test_cross_validation_over_parts_and_logs() -> None:
    parts = cross_validate(KNOWN, leg_log(), parts=2)
    assert len(parts) == 2
    assert all(one.load.relative_error[2:].max() < 0.1 for one in parts)
    logs = cross_validate(KNOWN, [leg_log(), leg_log(2)])
    assert len(logs) == 2
    assert max(one.load.relative_error[2:].max() for one in logs) < 0.03
    for bad, words in ((1, "at least 2, found 1"), (2.5, "whole number")):
        with pytest.raises(IdentificationError, match=words):
            cross_validate(KNOWN, leg_log(), parts=bad)  # type: ignore[arg-type]
    with pytest.raises(LogError, match="too short"):
        cross_validate(KNOWN, leg_log(), parts=12)
