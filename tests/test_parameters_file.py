"""parameters.json: plain data with all that is known of a result, and the way back to the robot."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid.errors import RobotError
from seaid.estimation.estimate import Estimate
from seaid.files import plain
from seaid.identification import Identification, identify
from seaid.inertia import PARAMETERS
from seaid.parameters_file import read_parameters
from seaid.robot import Robot
from tests.experiments import arm, arm_motion, leg, perfect_log

MODELS = Path(__file__).parent / "data"
KNOWN = arm().without_nominal()


@cache
def found() -> Identification:
    return identify(KNOWN, perfect_log(KNOWN, arm_motion()), feasible=True)


def saved(folder: Path) -> Path:
    found().save(folder / "parameters.json")
    return folder / "parameters.json"


def content(folder: Path) -> dict[str, Any]:
    text = saved(folder).read_text(encoding="utf-8")
    data = json.loads(text, parse_constant=lambda word: pytest.fail(f"JSON has no {word}"))
    assert isinstance(data, dict)
    return data


def test_content_is_what_is_written(tmp_path: Path) -> None:
    assert content(tmp_path) == found().to_dict()
    assert content(tmp_path)["seaid"] == seaid.__version__


def test_checks_of_the_model_are_there_by_side(tmp_path: Path) -> None:
    checks = content(tmp_path)["checks"]
    assert set(checks) == set(found().checks)
    for side, own in found().checks.items():
        assert checks[side]["condition_number"] == own.condition_number
        assert checks[side]["poorly_told"] == list(own.poorly_told)
        assert [one["terms"] for one in checks[side]["terms"]] == [
            [*one.terms] for one in own.terms
        ]
        assert [one["bic"] for one in checks[side]["terms"]] == [
            plain(one.bic) for one in own.terms
        ]
        assert set(checks[side]["whiteness"]) == set(own.whiteness)


def test_possible_bodies_are_told_with_their_distance(tmp_path: Path) -> None:
    told, own = content(tmp_path)["possible"], found().possible
    assert own is not None
    assert told["chi_square"] == own.chi_square
    assert [one["name"] for one in told["combinations"]] == list(own.names)
    assert [one["distance"] for one in told["combinations"]] == own.distance.tolist()
    assert identify(KNOWN, perfect_log(KNOWN, arm_motion())).to_dict()["possible"] is None


def test_processing_of_each_log_is_there_with_its_pass_band(tmp_path: Path) -> None:
    (told,), (own,) = content(tmp_path)["processing"], found().processing
    assert told["pass_band"]["cutoff_hz"] == own.pass_band.cutoff_hz == found().cutoff_hz
    assert told["pass_band"]["reason"] == own.pass_band.reason
    assert told["rate_hz"] == own.rate_hz
    assert told["repairs"] == []
    assert content(tmp_path)["left_out"] == dict(found().left_out)


def test_numbers_that_are_not_finite_are_null() -> None:
    load = found().load
    worse = Estimate(
        names=load.names,
        values=load.values,
        covariance=np.full_like(load.covariance, np.nan),
        units=load.units,
        residual_std=load.residual_std,
        condition_number=np.inf,
    )
    text = json.dumps(replace(found(), load=worse).to_dict(), allow_nan=False)
    assert {one["standard_error"] for one in json.loads(text)["load"]} == {None}


@pytest.mark.parametrize("nominal", [KNOWN, arm()], ids=["bare", "nominal"])
def test_the_robot_comes_back_exactly(tmp_path: Path, nominal: Robot) -> None:
    back = read_parameters(saved(tmp_path), nominal)
    np.testing.assert_array_equal(back.parameters, found().robot.parameters)
    assert back.drivetrains == found().robot.drivetrains
    assert (
        content(tmp_path)["bodies"]["boom"]["mx"]
        == back.parameters[10 * back.body_names.index("boom") + PARAMETERS.index("mx")]
    )
    first, second = tmp_path / "first.urdf", tmp_path / "second.urdf"
    seaid.write_urdf(found(), first)
    seaid.write_urdf(back, second)
    assert first.read_bytes() == second.read_bytes()
    assert first.with_suffix(".toml").read_text() == second.with_suffix(".toml").read_text()


def test_payloads_are_those_of_the_robot_given(tmp_path: Path) -> None:
    payload = seaid.Payload("tool", 0.5, (0.1, 0.0, 0.0))
    loaded = seaid.load_robot(MODELS / "mixed_arm.urdf", payloads=[payload])
    back = read_parameters(saved(tmp_path), loaded)
    np.testing.assert_array_equal(back.payload_parameters, loaded.payload_parameters)
    np.testing.assert_array_equal(back.parameters, found().robot.parameters)
    assert back.model.inertias[4].mass == pytest.approx(back.parameters[30] + 0.5)


def test_what_is_no_such_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    with pytest.raises(RobotError, match=r"cannot read parameters '.*other.json': No such file"):
        read_parameters(path, KNOWN)
    for text, words in (
        ("{", "is no file of identified parameters (Expecting"),
        ("[]", "is no file of identified parameters (list"),
        ('{"joints": []}', "(key 'bodies'): give one that seaid identify or save has written"),
    ):
        path.write_text(text)
        with pytest.raises(RobotError) as caught:
            read_parameters(path, KNOWN)
        assert words in str(caught.value)


def test_parameters_of_another_robot_are_told(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="is of another robot than 'tulip_leg': its joints are"):
        read_parameters(saved(tmp_path), leg())
    changed = content(tmp_path)
    changed["bodies"]["boom"]["m"] = None
    (tmp_path / "changed.json").write_text(json.dumps(changed))
    with pytest.raises(RobotError, match=r"changed.json': bodies"):
        read_parameters(tmp_path / "changed.json", KNOWN)
