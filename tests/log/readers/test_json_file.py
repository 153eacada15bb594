"""Files of JSON: records and columns, what is none, what declares too much."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.log.readers.opening import open_table
from seaid.robot.robot import Robot
from tests.log.readers.files import error_of


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[" * 100_000, "is not valid JSON, or cut off"),
        ('{"a": ' * 900 + "1" + "}" * 900, "are more than 20 levels deep"),
        ('[{"a": ' + "[" * 30 + "1" + "]" * 30 + "}]", "are more than 20 levels deep"),
        ('{"a": [' + "1" * 5_000 + "]}", "is not valid JSON, or cut off"),
        ('{"a": [1, "x"]}', "must be a vector of numbers, found str"),
        ('{"a": [1, [2]]}', "must be a vector of numbers, found list"),
        ('{"\\ud800": [1]}', "is not Unicode text"),
        (json.dumps([{f"c{k}": 1 for k in range(20_000)}]), "columns or more, allowed are 10,000"),
        (json.dumps({"a": [[1] * 20_000]}), "columns or more, allowed are 10,000"),
        (json.dumps({"a": [1], **{f"c{k}": 1 for k in range(20_000)}}), "columns or more"),
        ('{"a": [1, 2', "is not valid JSON, or cut off"),
    ],
)
def test_json(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "log.json"
    path.write_text(content)
    assert words in error_of(path, "a")


def test_whole_numbers_of_json_beyond_the_largest_float_are_infinite(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(json.dumps({"a": [1, -(10**400), None], "rows": 10**400}))
    found = open_table(path).load(["a", "rows"])
    np.testing.assert_array_equal(found["a"], [1.0, -np.inf, np.nan])
    assert np.all(np.isinf(found["rows"]))


def test_json_records_may_lack_values_and_have_constants_beside(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = [{"t": 0.0, "motor": {"i": [1, 2]}}, {"t": 1.0}]
    path = tmp_path / "log.json"
    path.write_text(json.dumps({"kp": 100, "name": "x", "entries": rows}))
    table = open_table(path)
    assert list(table.names) == ["t", "motor.i[0]", "motor.i[1]", "kp"]
    found = table.load(["t", "motor.i[1]", "kp"])
    np.testing.assert_array_equal(found["motor.i[1]"], [2.0, np.nan])
    assert found["kp"].tolist() == [100.0, 100.0]


@pytest.mark.parametrize("content", ["[]", "{}", "3", '"text"', '{"a": {"b": 1}}', "[1, 2]"])
def test_json_without_columns_is_named(arm: Robot, tmp_path: Path, content: str) -> None:
    path = tmp_path / "log.json"
    path.write_text(content)
    assert "has no columns; a JSON log is a list of records" in error_of(path)
