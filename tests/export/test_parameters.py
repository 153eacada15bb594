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
from seaid._files import plain
from seaid.errors import RobotError, SeaidWarning
from seaid.estimation.estimate import Estimate
from seaid.export import content_of, write_parameters
from seaid.export.parameters import read_parameters
from seaid.identification.identification import identify
from seaid.identification.result import Identification
from seaid.robot.inertia import PARAMETERS
from seaid.robot.robot import Robot
from tests.experiments import arm, arm_motion, leg, perfect_log

MODELS = Path(__file__).parents[1] / "data"
KNOWN = arm().without_nominal()


@cache
def found() -> Identification:
    return identify(KNOWN, perfect_log(KNOWN, arm_motion()), feasible=True)


def saved(folder: Path) -> Path:
    write_parameters(found(), folder / "parameters.json")
    return folder / "parameters.json"


def content(folder: Path) -> dict[str, Any]:
    text = saved(folder).read_text(encoding="utf-8")
    data = json.loads(text, parse_constant=lambda word: pytest.fail(f"JSON has no {word}"))
    assert isinstance(data, dict)
    return data


def test_content_is_what_is_written(tmp_path: Path) -> None:
    assert content(tmp_path) == content_of(found())
    assert content(tmp_path)["seaid"] == seaid.__version__


def test_checks_of_the_model_are_there_by_side(tmp_path: Path) -> None:
    checks = content(tmp_path)["checks"]
    assert set(checks) == set(found().checks)
    for side, own in found().checks.items():
        assert checks[side]["condition_number"] == own.condition_number
        assert checks[side]["poorly_determined"] == list(own.poorly_determined)
        assert [one["terms"] for one in checks[side]["terms"]] == [
            [*one.terms] for one in own.terms
        ]
        assert [one["bic"] for one in checks[side]["terms"]] == [
            plain(one.bic) for one in own.terms
        ]
        assert set(checks[side]["whiteness"]) == set(own.whiteness)


def test_feasible_parameters_are_written_with_their_distance(tmp_path: Path) -> None:
    told, own = content(tmp_path)["feasible"], found().feasible
    assert own is not None
    assert told["chi_square"] == own.chi_square
    assert [one["name"] for one in told["combinations"]] == list(own.names)
    assert [one["distance"] for one in told["combinations"]] == own.distance.tolist()
    assert content_of(identify(KNOWN, perfect_log(KNOWN, arm_motion())))["feasible"] is None


def test_processing_of_each_log_is_there_with_its_pass_band(tmp_path: Path) -> None:
    (told,), (own,) = content(tmp_path)["processing"], found().processing
    assert (
        told["cutoff_selection"]["cutoff_hz"] == own.cutoff_selection.cutoff_hz == found().cutoff_hz
    )
    assert told["cutoff_selection"]["reason"] == own.cutoff_selection.reason
    assert told["rate_hz"] == own.rate_hz
    assert told["repairs"] == []
    assert content(tmp_path)["excluded"] == dict(found().excluded)


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
    text = json.dumps(content_of(replace(found(), load=worse)), allow_nan=False)
    assert {one["standard_error"] for one in json.loads(text)["load"]} == {None}


@pytest.mark.parametrize("nominal", [KNOWN, arm()], ids=["bare", "nominal"])
def test_the_robot_comes_back_exactly(tmp_path: Path, nominal: Robot) -> None:
    back = read_parameters(saved(tmp_path), nominal)
    np.testing.assert_array_equal(back.parameters, found().robot.parameters)
    assert back.drives == found().robot.drives
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
        ("{", r"parameters '.*other.json' is not JSON: Expecting"),
        ("[]", "is no file of identified parameters: 'format' is None, not 'seaid parameters 4'"),
        ('{"joints": []}', "'format' is None.*: give one|; give one written by seaid identify"),
        ('{"format": 2}', "'format' is 2, not 'seaid parameters 4'"),
        ('{"format": "seaid parameters 4"}', "other.json': key 'robot' is missing"),
        ('{"format": 1, "format": 2}', "duplicate key 'format' in one object"),
        ('{"m": NaN}', "NaN is not a JSON number; give a finite number or null"),
        ('{"m": 1e999}', "other.json': m must be a finite number"),
        ('{"a": [0, 1' + 400 * "0" + "]}", r"a\[1\] must be a finite number"),
        ('{"m": ' + 5000 * "9" + "}", "is not JSON: Exceeds the limit"),
        ("[" * 40 + "]" * 40, "is more than 32 levels deep"),
        ("[" * 200_000, "is not JSON: tables or lists have too many levels"),
        ('{"\\ud800": 1}', r"'\\\\ud800' is not Unicode|unpaired surrogate"),
    ):
        path.write_text(text)
        with pytest.raises(RobotError, match=words) as caught:
            read_parameters(path, KNOWN)
        assert len(str(caught.value)) < 400 + len(str(path))


def test_parameters_of_another_robot_are_told(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="is of another robot than 'tulip_leg': its joints are"):
        read_parameters(saved(tmp_path), leg())


def changed(content: dict[str, Any], place: str, value: Any) -> dict[str, Any]:
    """Return content with a value at `a.b.c`; without the key for `...`."""
    key, _, rest = place.partition(".")
    if rest:
        return content | {key: changed(content[key], rest, value)}
    rest_of = {name: one for name, one in content.items() if name != key}
    return rest_of if value is ... else content | {key: value}


ROTARY = {"type": "series_elastic", "gear_ratio": 10.0, "stiffness_Nm_per_rad": 70.0}
RACK = {"type": "stiff", "gear_ratio_rad_per_m": 3.0}
SLIDING, TURNING = (
    KNOWN.joint_names[KNOWN.is_prismatic.index(is_prismatic)] for is_prismatic in (True, False)
)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (f"drive_tables.{TURNING}", ..., f"drive_tables: key '{TURNING}' is missing"),
        ("drive_tables", ..., "key 'drive_tables' is missing"),
        ("drive_tables", [], r"drive_tables must be a table, found \[\]"),
        ("drive_tables.more", ROTARY, "drive_tables: no key is named 'more'"),
        (f"drive_tables.{SLIDING}", ROTARY, f"joint '{SLIDING}' is prismatic: its elastic drive h"),
        (f"drive_tables.{TURNING}", RACK, "found gear_ratio_"),
        (f"drive_tables.{TURNING}", {"type": "stiff", "gear_ratio": None}, "gear_ratio"),
        (f"drive_tables.{TURNING}", {"type": "stiff", "gear_ratio": True}, "a number, found True"),
        (f"drive_tables.{TURNING}.gear_ratio", 1e300, "from 1e-09 to 1e\\+09 in size"),
        ("bodies.boom.m", 0.0, "bodies.boom: its mass, 0 kg, is too small for its other"),
        ("bodies.boom.m", 5e-324, "bodies.boom: its mass, 4.94066e-324 kg, is too small"),
        ("bodies.boom.m", None, "bodies.boom: 'm' must be a number, found None"),
        ("bodies.boom.m", "1", "bodies.boom: 'm' must be a number, found '1'"),
        ("bodies.boom.m", True, "bodies.boom: 'm' must be a number, found True"),
        ("bodies.boom.mx", 1e300, "bodies.boom: 1e\\+300 is not a mass"),
        ("bodies.boom.mx", ..., "bodies.boom: key 'mx' is missing"),
        ("bodies.boom.mw", 1.0, "bodies.boom: no key is named 'mw'"),
        ("bodies.boom", [1.0], r"bodies.boom must be a table, found \[1.0\]"),
        ("bodies.boom", ..., "is of another robot"),
        ("bodies", None, "bodies must be a table, found None"),
        ("joints", None, "is of another robot"),
        ("joints", list(KNOWN.joint_names)[::-1], "is of another robot"),
        ("format", "seaid parameters 3", "'format' is 'seaid parameters 3'"),
        ("model", 1, "no key is named 'model'"),
    ],
)
def test_a_file_that_was_changed_is_refused(
    tmp_path: Path, place: str, value: Any, words: str
) -> None:
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(changed(content(tmp_path), place, value)))
    with pytest.raises(RobotError, match=words) as caught:
        read_parameters(path, KNOWN)
    assert "changed.json" in str(caught.value)


def test_a_negative_mass_is_said(tmp_path: Path) -> None:
    data = content(tmp_path)
    link = next(iter(data["bodies"]))
    data["bodies"][link]["m"] *= -1
    (tmp_path / "parameters.json").write_text(json.dumps(data))
    with pytest.warns(SeaidWarning, match=rf"bodies\.{link}: the mass is negative, -.* kg"):
        assert read_parameters(tmp_path / "parameters.json", KNOWN).parameters[0] < 0
