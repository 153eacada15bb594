"""identify: its choices, its result, and logs that have no answer."""

from __future__ import annotations

import json
import pickle
import re
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import ExcitationError, IdentificationError, LogError, RobotError
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import Orthonormal, orthonormal
from seaid.estimation.qr_factor import QRFactor
from seaid.export import content_of, write_parameters
from seaid.identification import Method
from seaid.identification.identification import cross_validate, identify, validate
from seaid.identification.result import Identification
from seaid.legged import load_robot
from seaid.log.long_log import open_long_log
from seaid.log.reading import Log, write_log
from seaid.regressor import joint_torques
from seaid.robot.inertia import is_physical
from seaid.simulation.simulation import measure
from tests.experiments import (
    ARM_SENSORS,
    ELASTIC,
    LEG_SENSORS,
    TEST_MASS,
    arm,
    arm_motion,
    leg,
    leg_log,
    leg_motion,
)
from tests.representatives import quick_first

KNOWN = leg(TEST_MASS).without_nominal()


@cache
def found() -> Identification:
    return identify(KNOWN, leg_log())


def changed(field: str, joint: str, value: float) -> Log:
    """Return the log with one signal of one joint held at a value."""
    values = getattr(leg_log(), field).copy()
    values[:, KNOWN.index(joint)] = value
    return replace(leg_log(), **{field: values})


def standing(joint: str) -> Log:
    return replace(
        changed("motor_position", joint, 0.3),
        joint_position=changed("joint_position", joint, 0.1).joint_position,
    )


@pytest.mark.usefixtures("estimates_only")
def test_weights_are_settled_once_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    settled: list[int] = []

    def counted(qr_factor: QRFactor, theta: Array) -> Orthonormal:
        settled.append(len(theta))
        return orthonormal(qr_factor, theta)

    monkeypatch.setattr("seaid.estimation.least_squares.orthonormal", counted)
    identify(KNOWN, leg_log())
    assert len(settled) == len(ELASTIC) + 1


def test_result_has_what_the_design_says() -> None:
    assert tuple(found().drives) == KNOWN.joint_names
    for joint in ELASTIC:
        assert found().drives[joint].names == (
            "viscous_friction",
            "coulomb_friction",
            "stiffness",
            "spring_offset",
            "torque_offset",
        )
    assert found().drives["hip_yaw"].names == ("viscous_friction", "coulomb_friction")
    assert len(found().load.values) == len(found().base.columns) == 29
    assert found().load.names == found().model.expressions
    assert found().known is KNOWN
    assert set(found().excluded) == {*ELASTIC, "load"}


def test_found_robot_has_the_found_values() -> None:
    robot = found().robot
    assert found().base.project(robot.parameters) == pytest.approx(found().load.values, abs=1e-9)
    for joint in ELASTIC:
        stiffness = robot.drives[joint].stiffness  # type: ignore[union-attr]
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
    ideal = replace(leg_log(), joint_position=motion.joint_position, joint_torque=torques)
    nothing = np.full_like(torques, np.nan)
    ideal = replace(ideal, motor_torque=nothing, motor_position=nothing)
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
        true = result.base.project(leg(TEST_MASS).parameters)
        worst.append(np.max(np.abs((result.load.values - true) / result.load.standard_errors)))
    assert worst[0] > 5.0
    assert worst[1] < 3.5


def test_parameters_json_has_the_fields_of_the_design(tmp_path: Path) -> None:
    path = tmp_path / "parameters.json"
    write_parameters(found(), path, validate(found(), leg_log(2)))
    content = json.loads(path.read_text())
    assert content["robot"] == "tulip_leg"
    assert content["joints"] == list(KNOWN.joint_names)
    stiffness = content["drives"]["knee_pitch"]["stiffness"]
    assert stiffness == {
        "value": found().drives["knee_pitch"].value("stiffness"),
        "standard_error": found().drives["knee_pitch"].standard_error("stiffness"),
        "interval_95": found().drives["knee_pitch"].interval()[2].tolist(),
        "unit": "N/m",
    }
    assert len(content["load"]) == len(content["base_columns"]) == len(content["grouping"]) == 29
    assert set(content["load"][0]) == {
        *("expression", "value", "standard_error", "interval_95", "unit"),
    }
    assert [entry["value"] for entry in content["load"]] == found().load.values.tolist()
    assert np.array(content["grouping"]).shape == (29, 50)
    assert content["validation"]["load"]["knee_pitch"]["relative_error"] < 0.05
    assert content["validation"]["actuator"]["hip_yaw"]["relative_error"] is None
    assert list(tmp_path.iterdir()) == [path]
    assert content_of(found())["validation"] == {}
    json.dumps(content_of(found()), allow_nan=False)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"estimator": "wsl"}, "no estimator is named 'wsl'; did you mean 'wls'"),
        ({"estimator": "kalman"}, "no estimator is named 'kalman'; allowed: .*ols"),
        ({"method": "two-stp"}, "no method is named 'two-stp'; did you mean 'two-step'"),
    ],
)
def test_unknown_choice_names_the_nearest(option: dict[str, str], words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        identify(KNOWN, leg_log(), **option)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("rows", "kind", "words"),
    [
        (("knee",), RobotError, "no joint is named 'knee'; did you mean 'knee_pitch'"),
        ((), ExcitationError, "torque_joints= names no joint: give those whose torque is known"),
    ],
)
def test_rows_that_tell_nothing(rows: tuple[str, ...], kind: type[Exception], words: str) -> None:
    with pytest.raises(kind, match=words):
        identify(KNOWN, leg_log(), torque_joints=rows)


def test_robot_that_stands_still() -> None:
    still = leg_log()
    for joint in KNOWN.joint_names:
        one = standing(joint)
        still = replace(
            still,
            motor_position=np.where(
                np.array(KNOWN.joint_names) == joint, one.motor_position, still.motor_position
            ),
            joint_position=np.where(
                np.array(KNOWN.joint_names) == joint, one.joint_position, still.joint_position
            ),
        )
    with pytest.raises(ExcitationError, match="no joint moves in the log"):
        identify(KNOWN, still)
    rng = np.random.default_rng(0)
    noisy = replace(
        still, motor_position=still.motor_position + rng.normal(0, 1e-3, still.motor_position.shape)
    )
    with pytest.raises(ExcitationError, match="no joint moves in the log"):
        identify(KNOWN, noisy)


def test_log_that_lacks_a_joint_or_a_torque() -> None:
    fewer = Log(
        time=leg_log().time,
        joint_names=KNOWN.joint_names[:4],
        motor_position=leg_log().motor_position[:, :4],
        joint_position=leg_log().joint_position[:, :4],
        motor_torque=leg_log().motor_torque[:, :4],
    )
    with pytest.raises(LogError, match="the log has no joint ankle_pitch of 'tulip_leg'"):
        identify(KNOWN, fewer)
    with pytest.raises(LogError, match="elastic joint 'knee_pitch' has no torque in the log"):
        identify(KNOWN, changed("motor_torque", "knee_pitch", np.nan))
    with pytest.raises(LogError, match="no torque in the log at hip_yaw; name the others with"):
        identify(
            KNOWN,
            changed("motor_torque", "hip_yaw", np.nan),
            torque_joints=("hip_yaw", "hip_pitch"),
        )


@pytest.mark.slow  # 0.8 s
def test_logs_with_other_sensors_do_not_go_together() -> None:
    torque = np.full_like(leg_log().motor_torque, np.nan)
    torque[:, 3] = leg_motion(TEST_MASS).joint_torque[:, 3]
    other = replace(changed("motor_torque", "knee_pitch", np.nan), joint_torque=torque)
    with pytest.raises(LogError, match="the logs must have the same torque sensors"):
        identify(KNOWN, [leg_log(), other])


# identify: both sides at once, possible bodies, files, executors, checks, cross-validation.


TRUTH = leg(TEST_MASS)


@cache
def found_with(**options: Any) -> Identification:
    return identify(KNOWN, leg_log(), encoder_offset_std=0.002, **{"method": "two-step", **options})


def assert_same(one: Estimate, other: Estimate, tolerance: float = 1e-9) -> None:
    assert one.names == other.names
    np.testing.assert_allclose(
        one.values, other.values, rtol=tolerance, atol=tolerance * one.standard_errors.min()
    )
    np.testing.assert_allclose(one.standard_errors, other.standard_errors, rtol=1e-6)


def truth_of(identified: Identification) -> Any:
    return identified.base.project(TRUTH.parameters)


@pytest.mark.slow  # several identifications of the leg
def test_both_sides_at_once_tell_the_springs_better() -> None:
    both = found_with(method="simultaneous")
    for joint in ELASTIC:
        true = TRUTH.drives[joint].stiffness  # type: ignore[union-attr]
        error = both.drives[joint].standard_error("stiffness")
        assert true is not None
        assert abs(both.drives[joint].value("stiffness") - true) < 3 * error
        assert error < found_with().drives[joint].standard_error("stiffness")
    z = (both.load.values - truth_of(both)) / both.load.standard_errors
    assert np.sqrt(np.mean(z**2)) < 1.5
    assert both.load.names == found_with().load.names
    assert tuple(both.checks) == ("both",)
    assert validate(both, leg_log(2)).load.relative_error[2:].max() < 0.02


@pytest.mark.slow  # 1.5 s
def test_possible_bodies_are_possible_and_near_the_estimate() -> None:
    possible = found_with(feasible=True)
    bodies = possible.robot.parameters.reshape(-1, 10)
    assert all(is_physical(body, 0.0) for body in bodies)
    assert possible.feasible is not None
    assert possible.feasible.robot is possible.robot
    projected = possible.base.project(possible.robot.parameters)
    np.testing.assert_allclose(
        projected, possible.feasible.values[: len(projected)], rtol=1e-9, atol=1e-9
    )
    off = (projected - possible.load.values) / possible.load.standard_errors
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert_same(possible.load, found_with().load)
    assert not all(is_physical(body) for body in found_with().robot.parameters.reshape(-1, 10))
    text = possible.summary()
    assert "physically consistent parameters: chi-square" in text
    assert "a ball of 1 kg replaces" in text


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize("suffix", quick_first([".csv", ".npz"]))
def test_a_file_is_identified_as_the_log_in_memory(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    write_log(leg_log(), path)
    whole = identify(KNOWN, str(path), encoder_offset_std=0.002)
    opened = open_long_log(path, KNOWN, cutoff_hz=found_with().cutoff_hz, chunk_samples=3000)
    pieces = identify(KNOWN, opened, encoder_offset_std=0.002)
    for one in (whole, pieces):
        assert one.cutoff_hz == found_with().cutoff_hz
        assert one.excluded == found_with().excluded
        assert_same(one.load, found_with().load, 1e-7)
        for joint in ELASTIC:
            assert_same(one.drives[joint], found_with().drives[joint], 1e-7)
        assert not one.checks["load"].whiteness  # its rows are not kept
        assert one.warnings == found_with().warnings


@pytest.mark.slow  # 0.6 s
def test_a_long_log_in_another_pass_band_is_opened_anew(tmp_path: Path) -> None:
    write_log(leg_log(), tmp_path / "log.npz")
    opened = open_long_log(tmp_path / "log.npz", KNOWN, cutoff_hz=6.0)
    assert identify(KNOWN, opened, cutoff_hz=5.0).cutoff_hz == 5.0
    assert identify(KNOWN, opened).cutoff_hz == 6.0


@pytest.mark.slow  # 1.1 s
@pytest.mark.parametrize("executor", quick_first([ThreadPoolExecutor, ProcessPoolExecutor]))
def test_an_executor_works_on_the_logs(executor: type[Executor], tmp_path: Path) -> None:
    write_log(leg_log(2), tmp_path / "second.npz")
    cutoff_hz = found_with().cutoff_hz
    in_turn = partial(identify, KNOWN, cutoff_hz=cutoff_hz, method="two-step")
    here = in_turn([leg_log(), leg_log(2)])
    with executor(2) as pool:  # type: ignore[call-arg]
        there = in_turn([leg_log(), tmp_path / "second.npz"], executor=pool)
    assert_same(there.load, here.load)
    for joint in ELASTIC:
        assert_same(there.drives[joint], here.drives[joint])


def test_checks_say_that_each_term_is_worth_having() -> None:
    checks = found_with().checks
    assert set(checks) == {*ELASTIC, "load"}
    for joint in ELASTIC:
        assert {term.terms[0] for term in checks[joint].terms} == {
            "viscous_friction",
            "coulomb_friction",
        }
        assert all(term.bic > 0 for term in checks[joint].terms)
        assert set(checks[joint].whiteness) == {joint}
    assert len(checks["load"].terms) == 4
    assert set(checks["load"].whiteness) == set(KNOWN.joint_names)
    text = found_with().summary()
    assert "Terms of the drives: support by the data" in text
    assert "coulomb_friction of knee_pitch" in text
    assert re.search(rf"load side +{checks['load'].condition_number:.3g} ", text)


def test_a_term_that_is_not_there_is_not_worth_having() -> None:
    robot = arm()
    known = robot.without_nominal()
    joint = known.elastic_joints[0]
    more = replace(known.drives[joint], extra_terms=("c*theta_M_dot**3",))
    known = known.with_values(known.parameters, {**known.drives, joint: more})
    identified = identify(known, measure(robot, arm_motion(), ARM_SENSORS, 3), method="two-step")
    tests = {term.terms[0]: term for term in identified.checks[joint].terms}
    assert tests["c"].bic < 0 < tests["viscous_friction"].bic


@pytest.mark.slow  # several identifications of the leg
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


def test_an_identification_can_be_sent_to_a_process() -> None:
    again = pickle.loads(pickle.dumps(found_with()))
    assert again.load.names == found_with().load.names


@pytest.mark.parametrize(
    ("logs", "words"),
    [
        ([], "identify needs a log, found none"),
        ([3.0], "logs= must be a Log, a LongLog, a path or a list of these, found a list with 3.0"),
    ],
)
def test_what_is_no_log(logs: Any, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        identify(KNOWN, logs)


@pytest.mark.parametrize(
    ("field", "joint", "words"),
    [
        ("joint_position", "knee_pitch", "joint position of 'knee_pitch' is 0.4 all the time"),
        ("joint_position", "hip_roll", "joint position of 'hip_roll' is 0.4 all the time"),
        ("motor_torque", "knee_pitch", "motor torque of 'knee_pitch' is 0.4 all the time"),
        ("motor_torque", "hip_yaw", "motor torque of 'hip_yaw' is 0.4 all the time"),
        ("motor_position", "hip_yaw", "motor position of 'hip_yaw' is 0.4 all the time"),
    ],
)
@pytest.mark.parametrize("method", ["two-step", "simultaneous"])
def test_a_dead_channel_is_named(field: str, joint: str, words: str, method: Method) -> None:
    values = getattr(leg_log(), field).copy()
    values[:, KNOWN.index(joint)] = 0.4
    with pytest.raises(LogError, match=f"{words}, while its .* moves: a dead channel"):
        identify(KNOWN, replace(leg_log(), **{field: values}), method=method)


@pytest.mark.parametrize("std", [-0.1, float("nan"), float("inf"), 1e200])
def test_a_standard_deviation_of_zeros_that_is_none_is_refused(std: float) -> None:
    with pytest.raises(
        IdentificationError, match="encoder_offset_std must be from 0 to 1000 rad or m"
    ):
        identify(KNOWN, leg_log(), encoder_offset_std=std)
