"""read_log: formal mistakes have the file, the place, what was found, and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import open_long_log, read_log, write_log
from seaid.robot import Robot
from tests.log.readers.files import one_log
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


REMEDY_OF_STAMPS = "give their rate in the description of the log: time = { rate_hz = ... }"

MISTAKES: dict[str, tuple[str, tuple[str, ...]]] = {
    "no time": (
        renamed("time_s", "stamp"),
        ("no column is named 'time_s'", "stamp", 'in the description of the log as time = "..."'),
    ),
    "a missing column": (
        renamed("knee.motor_torque_Nm", "knee.effort"),
        ("joint 'knee' needs one position and one torque", "found joint_position", "knee.motor_to"),
    ),
    "a joint with a capital letter": (
        renamed("hip", "Hip"),
        (
            "joint 'hip'",
            "'Hip.joint_position_rad' in the file is similar to 'hip.joint_position_rad'",
            'in the description of the log: [joints.hip] joint_position = "Hip.joint_position_rad"',
        ),
    ),
    "no header": (
        written(columns(), header=False),
        (
            "no column is named 'time_s'; allowed: 1, 2, 3",
            "the first line is numbers: no header? Name the columns by their numbers",
            "(time = 1, joint_position = 2, ...)",
        ),
    ),
    "words": ("some words\nand more\n", ("no column is named 'time_s'; allowed: some words",)),
    "no column of the robot": (
        "time_s,x\n0,1\n",
        ("no column of this robot; expected names as 'hip.motor_position_rad' (custom columns",),
    ),
    "times that repeat": (
        timed(np.sort(np.append(TIME[1:], TIME[7]))),
        ("time_s repeats at sample 7", "1 such places", "repair them with repair=seaid.Repairs()"),
    ),
    "times that go back": (
        timed(np.where(np.arange(300) == 100, TIME[90], TIME)),
        ("goes backwards at sample 100 (0.99 s, then 0.9 s", "repair=seaid.Repairs()"),
    ),
    "epoch stamps as float32": (
        timed((1.7e9 + TIME).astype(np.float32).astype(np.float64)),
        ("time_s repeats at sample 1 (1.7e+09 s", "299 such places", REMEDY_OF_STAMPS),
    ),
    "epoch stamps of ten digits": (
        timed(np.floor(1.7e9 + TIME)),
        ("time_s repeats at sample 1", "seconds since 1970 need 13", REMEDY_OF_STAMPS),
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


def test_a_joint_of_a_description_with_a_capital_letter(legs: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(written(columns()))
    described = {"joints": {"KNEE": {"joint_position": "hip.joint_position_rad"}}}
    problem = error_of(lambda: read_log(path, legs, description=described))
    assert "no joint is named 'KNEE'; did you mean 'knee'? allowed: hip, knee" in str(problem)


@pytest.mark.parametrize("path", [None, 5, b"log.csv", [5]])
def test_a_path_is_a_text_or_a_path(arm: Robot, path: Any) -> None:
    for read in (read_log, open_long_log):
        with pytest.raises(LogError, match="path= must be a path"):
            read(path, arm)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"repair": True}, "repair= must be a Repairs, found True; make one with"),
        ({"description": 5}, "description= must be a LogDescription, a mapping, a path or a Desc"),
    ],
)
def test_arguments_of_another_kind_are_named(
    arm: Robot, tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    write_log(one_log(), tmp_path / "log.csv")
    with pytest.raises(LogError, match=words):
        read_log(tmp_path / "log.csv", arm, **options)
