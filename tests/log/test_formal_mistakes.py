"""Formal mistakes of logs: each message has the file, the place, what was found, and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import read_log
from seaid.robot import Robot
from tests.one_joint import chain

TIME: Array = np.linspace(0.0, 2.99, 300)
Columns = dict[str, Array]


def columns() -> Columns:
    found = {"time_s": TIME}
    for joint in ("hip", "knee"):
        found[f"{joint}.joint_position_rad"] = np.sin(2 * TIME)
        found[f"{joint}.motor_torque_Nm"] = np.cos(3 * TIME)
    return found


def written(data: Columns, delimiter: str = ",", header: bool = True) -> str:
    rows = np.column_stack(list(data.values()))
    lines = [delimiter.join(f"{one:.9f}" for one in row) for row in rows]
    return "\n".join([delimiter.join(data), *lines] if header else lines) + "\n"


def renamed(old: str, new: str) -> str:
    return written({name.replace(old, new): values for name, values in columns().items()})


def timed(time: Array) -> str:
    return written({**columns(), "time_s": time})


def backwards() -> Array:
    time = TIME.copy()
    time[100] = time[90]
    return time


REMEDY_OF_STAMPS = "give their rate in the description of the log: time = { rate_hz = ... }"

MISTAKES: dict[str, tuple[str, list[str]]] = {
    "no time": (
        renamed("time_s", "stamp"),
        ["no column is named 'time_s'", "stamp", 'in the description of the log as time = "..."'],
    ),
    "a missing column": (
        renamed("knee.motor_torque_Nm", "knee.effort"),
        [
            "joint 'knee' needs one position and one torque",
            "found joint_position",
            "knee.motor_tor",
        ],
    ),
    "a joint with a capital letter": (
        renamed("hip", "Hip"),
        [
            "joint 'hip'",
            "'Hip.joint_position_rad' in the file is similar to 'hip.joint_position_rad'",
            'in the description of the log: [joints.hip] joint_position = "Hip.joint_position_rad"',
        ],
    ),
    "no header": (
        written(columns(), header=False),
        ["the first line is numbers: no header?", "(time = 1, joint_position = 2, ...)"],
    ),
    "decimal commas between commas": (
        written(columns()).replace("0.", "0,"),
        ["line 2 has", "the first line 5 column names", "decimal commas? Delimit the columns by"],
    ),
    "an empty file": ("", ["is empty", "a line of column names, then a line per sample"]),
    "names only": (",".join(columns()) + "\n", ["no samples", "record or copy it again"]),
    "times that repeat": (
        timed(np.sort(np.append(TIME[1:], TIME[7]))),
        ["time_s repeats at sample 7", "1 such places", "repair them with repair=seaid.Repairs()"],
    ),
    "times that go back": (
        timed(backwards()),
        ["goes backwards at sample 100 (0.99 s, then 0.9 s", "repair=seaid.Repairs()"],
    ),
    "epoch stamps as float32": (
        timed((1.7e9 + TIME).astype(np.float32).astype(np.float64)),
        ["time_s repeats at sample 1 (1.7e+09 s", "299 such places", REMEDY_OF_STAMPS],
    ),
    "epoch stamps of ten digits": (
        timed(np.floor(1.7e9 + TIME)),
        ["time_s repeats at sample 1", "seconds since 1970 need 13", REMEDY_OF_STAMPS],
    ),
    "a date for the time": (
        written(columns()).replace("0.010000000,", "2026-11-22 12:00:01,", 1),
        ["line 3: column 'time_s' has '2026-11-22 12:00:01'", "write the time as seconds"],
    ),
}


@pytest.fixture
def legs(tmp_path: Path) -> Robot:
    return chain(tmp_path, "hip", "knee")


def error_of(read: Callable[[], object]) -> LogError:
    with pytest.raises(LogError) as caught:
        read()
    return caught.value


@pytest.mark.parametrize("name", MISTAKES)
def test_a_formal_mistake_is_named_with_its_remedy(name: str, legs: Robot, tmp_path: Path) -> None:
    content, words = MISTAKES[name]
    path = tmp_path / "run.csv"
    path.write_text(content)
    problem = error_of(lambda: read_log(path, legs))
    assert str(problem).startswith(f"'{path}'")
    for word in words:
        assert word in str(problem)
    if "repair=" in str(problem):  # the command line names its option in this place
        assert "repair=seaid.Repairs()" in problem.arguments


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_semicolons_tabs_spaces_and_decimal_commas_are_no_mistake(
    delimiter: str, legs: Robot, tmp_path: Path
) -> None:
    head, body = written(columns(), delimiter).split("\n", 1)
    path = tmp_path / "run.csv"
    path.write_text(f"{head}\n{body.replace('.', ',')}")
    np.testing.assert_allclose(read_log(path, legs).time, TIME, atol=1e-9)


def test_a_joint_of_a_description_with_a_capital_letter(legs: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(written(columns()))
    described = {"joints": {"KNEE": {"joint_position": "hip.joint_position_rad"}}}
    problem = error_of(lambda: read_log(path, legs, description=described))
    assert "no joint is named 'KNEE'; did you mean 'knee'? allowed: hip, knee" in str(problem)
