"""parameters.json: plain data with all that is known of a result, and the way back to the robot."""

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
from seaid.export import content_of, read_parameters, write_parameters
from seaid.identification import Identification, identify
from tests.experiments import arm, arm_motion, leg, perfect_log


def test_the_file_has_all_that_is_known_of_a_result(tmp_path: Path) -> None:
    """Checks of each side, feasible parameters with their distance, and what was done to logs."""
    data, own = content(tmp_path), found()
    assert data == content_of(own)
    assert data["seaid"] == seaid.__version__
    assert set(data["checks"]) == set(own.checks)
    for side, check in own.checks.items():
        written = data["checks"][side]
        assert written["condition_number"] == check.condition_number
        assert written["poorly_determined"] == list(check.poorly_determined)
        terms = [(one["terms"], one["bic"]) for one in written["terms"]]
        assert terms == [([*one.terms], plain(one.bic)) for one in check.terms]
        assert set(written["whiteness"]) == set(check.whiteness)
    told, feasible = data["feasible"], own.feasible
    assert feasible is not None
    assert told["chi_square"] == feasible.chi_square
    distances = {one["name"]: one["distance"] for one in told["combinations"]}
    assert distances == dict(zip(feasible.names, feasible.distance.tolist(), strict=True))
    (log,), (processing,) = data["processing"], own.processing
    selection = processing.cutoff_selection
    assert log["cutoff_selection"]["cutoff_hz"] == selection.cutoff_hz == own.cutoff_hz
    assert log["cutoff_selection"]["reason"] == selection.reason
    assert (log["rate_hz"], log["repairs"]) == (processing.rate_hz, [])
    assert data["excluded"] == dict(own.excluded)


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


def test_numbers_that_are_not_finite_are_null() -> None:
    load = found().load
    nothing = np.full_like(load.covariance, np.nan)
    worse = replace(load, covariance=nothing, condition_number=np.inf)
    text = json.dumps(content_of(replace(found(), load=worse)), allow_nan=False)
    assert {one["standard_error"] for one in json.loads(text)["load"]} == {None}


def test_the_robot_comes_back_exactly(tmp_path: Path) -> None:
    """Into a robot without bodies, with those of its file, and with a payload of its own."""
    payload = seaid.Payload("tool", 0.5, (0.1, 0.0, 0.0))
    loaded = seaid.load_robot(MODELS / "mixed_arm.urdf", payloads=[payload])
    files = []
    for name, nominal in (("bare", KNOWN), ("nominal", arm()), ("loaded", loaded)):
        back = read_parameters(saved(tmp_path), nominal)
        np.testing.assert_array_equal(back.parameters, found().robot.parameters)
        np.testing.assert_array_equal(back.payload_parameters, nominal.payload_parameters)
        assert back.drives == found().robot.drives
        written = seaid.write_urdf(back, tmp_path / f"{name}.urdf")
        assert written.drives is not None
        files.append((written.urdf.read_bytes(), written.drives.read_text()))
    assert files[0] == files[1] == files[2]
    assert back.model.inertias[4].mass == pytest.approx(back.parameters[30] + 0.5)


NO_FILES = {
    "{": r"parameters '.*other.json' is not JSON: Expecting",
    "[]": "is no file of identified parameters: 'format' is None, not 'seaid parameters 4'",
    '{"joints": []}': "'format' is None.*: give one|; give one written by seaid identify",
    '{"format": 2}': "'format' is 2, not 'seaid parameters 4'",
    '{"format": "seaid parameters 4"}': "other.json': key 'joints' is missing",
}


def test_what_is_no_such_file_or_of_another_robot_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    with pytest.raises(RobotError, match=r"cannot read parameters '.*other.json': No such file"):
        read_parameters(path, KNOWN)
    for text, words in NO_FILES.items():
        path.write_text(text)
        with pytest.raises(RobotError, match=words) as caught:
            read_parameters(path, KNOWN)
        assert len(str(caught.value)) < 400 + len(str(path))
    with pytest.raises(RobotError, match="is of another robot than 'tulip_leg': its joints are"):
        read_parameters(saved(tmp_path), leg())


def test_a_negative_mass_is_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(changed(content(tmp_path), "bodies.carriage.m", -1.0)))
    with pytest.warns(SeaidWarning, match=r"bodies\.carriage: the mass is negative, -1 kg"):
        read_parameters(path, KNOWN)


def changed(content: dict[str, Any], place: str, value: Any) -> dict[str, Any]:
    """Return content with a value at `a.b.c`; without the key for `...`."""
    key, _, rest = place.partition(".")
    if rest:
        return content | {key: changed(content[key], rest, value)}
    rest_of = {name: one for name, one in content.items() if name != key}
    return rest_of if value is ... else content | {key: value}


ROTARY = {"type": "series_elastic", "gear_ratio": 10.0, "stiffness_Nm_per_rad": 70.0}
SLIDING, TURNING = (
    KNOWN.joint_names[KNOWN.is_prismatic.index(is_prismatic)] for is_prismatic in (True, False)
)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (f"drive_tables.{TURNING}", ..., f"drive_tables: key '{TURNING}' is missing"),
        ("drive_tables", [], r"drive_tables must be a table, found \[\]"),
        ("drive_tables.more", ROTARY, "drive_tables: no key is named 'more'"),
        (f"drive_tables.{SLIDING}", ROTARY, f"joint '{SLIDING}' is prismatic: its elastic drive h"),
        (f"drive_tables.{TURNING}", {"type": "stiff", "gear_ratio": True}, "a number, found True"),
        (f"drive_tables.{TURNING}.gear_ratio", 1e300, "from 1e-09 to 1e\\+09 in size"),
        ("bodies.boom.m", 0.0, "bodies.boom: its mass, 0 kg, is too small for its other"),
        ("bodies.boom.mx", 1e300, "bodies.boom: 1e\\+300 is not a mass"),
        ("bodies.boom.mx", ..., "bodies.boom: key 'mx' is missing"),
        ("bodies.boom", ..., "is of another robot"),
        ("joints", list(KNOWN.joint_names)[::-1], "is of another robot"),
        ("format", "seaid parameters 3", "'format' is 'seaid parameters 3'"),
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
