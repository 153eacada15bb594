"""identify: its choices, its result, and logs that have no answer."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import ExcitationError, IdentificationError, LogError, RobotError
from seaid.estimation.least_squares import Orthonormal, orthonormal
from seaid.estimation.qr_factor import QRFactor
from seaid.identification.identification import identify, validate
from seaid.identification.result import Identification
from seaid.log.reading import Log
from seaid.regressor import joint_torques
from seaid.robot.robot import load_robot
from seaid.simulation.simulation import measure
from tests.experiments import (
    ELASTIC,
    LEG_SENSORS,
    TEST_MASS,
    leg,
    leg_log,
    leg_motion,
)

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
    found().save(path, validate(found(), leg_log(2)))
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
    assert found().to_dict()["validation"] == {}
    json.dumps(found().to_dict(), allow_nan=False)


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
