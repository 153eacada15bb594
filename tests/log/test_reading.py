"""read_log: columns become a log, or the mistake and its remedy are named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import seaid
from seaid._arrays import Array
from seaid.errors import LogError, SeaidWarning
from seaid.log import read_log
from seaid.log.channels import column_names
from seaid.log.readers.opening import _plain_numbers
from seaid.robot import Robot
from tests.one_joint import one_joint
from tests.plants import write_columns

TIME: Array = np.arange(300) / 100
MOTOR, JOINT = "arm.motor_position_rad", "arm.joint_position_rad"
TORQUE, SPRING = "arm.motor_torque_Nm", "arm.joint_torque_Nm"
COLUMNS = {"time_s": TIME, MOTOR: np.sin(TIME), JOINT: np.cos(TIME), TORQUE: np.sin(3 * TIME)}


def written(folder: Path, **change: Array | None) -> Path:
    """Write the columns with some more or other ones, and without those that are None."""
    columns = {name: x for name, x in (COLUMNS | change).items() if x is not None}
    return write_columns(folder / "log.csv", columns)


def with_sample(values: Array, place: int, value: float) -> Array:
    return np.where(np.arange(len(values)) == place, value, values)


def column(name: str, place: int, value: float) -> dict[str, Array]:
    return {name: with_sample(COLUMNS[name], place, value)}


NEEDS = "one position and one torque, current, voltage, position command or velocity command"
RATE = "give their rate in the description of the log: time = { rate_hz = ... }"
REPAIR = "repair=seaid.Repairs()"
MISTAKES: tuple[tuple[dict[str, Any], tuple[str, ...]], ...] = (
    (
        {"time_s": None, "stamp": TIME},
        ("no column is named 'time_s'", "stamp", 'in the description of the log as time = "..."'),
    ),
    (
        {TORQUE: None},
        (
            f"joint 'arm' needs {NEEDS}, found motor_position, joint_",
            f"its columns are {', '.join(column_names('arm', is_prismatic=False).values())}",
        ),
    ),
    (
        {MOTOR: None, JOINT: None, "Arm.joint_position_rad": TIME},
        (
            "'Arm.joint_position_rad' in the file is similar to 'arm.joint_position_rad'",
            'in the description of the log: [joints.arm] joint_position = "Arm.joint_position_rad"',
        ),
    ),
    (
        {MOTOR: None, JOINT: None, TORQUE: None, "x": TIME},
        ("no column of this robot; expected names as 'arm.motor_position_rad' (custom columns",),
    ),
    (
        {"time_s": np.sort(np.append(TIME[1:], TIME[7]))},
        ("time_s repeats at sample 7 (0.07 s, then 0.07 s", "1 such places", REPAIR),
    ),
    (
        {"time_s": with_sample(TIME, 100, 0.9)},
        ("goes backwards at sample 100 (0.99 s, then 0.9 s", REPAIR),
    ),
    (
        {"time_s": np.full(300, 2.5)},
        ("299 such places); it must increase: it is constant; if the stamps", RATE),
    ),
    (
        {"time_s": np.floor(1.7e9 + TIME)},
        ("time_s repeats at sample 1 (1.7e+09 s", "seconds since 1970 need 13", RATE),
    ),
    (
        column("time_s", 5, np.nan),
        ("time_s is not finite in 1 of ", "samples, the first in sample 5: "),
    ),
    (
        column(JOINT, 5, np.nan),
        (
            f"'{JOINT}' is not finite in 1 of ",
            "samples, the first in sample 5: ",
            "leave the whole column NaN if there is no such sensor",
        ),
    ),
    (column(TORQUE, 7, 2e12), (f"'{TORQUE}' has 2e+12 in sample 7",)),
    ({"repair": True}, ("repair= must be a Repairs, found True",)),
    ({"description": 5}, ("description= must be a LogDescription, a mapping, a path or a Desc",)),
)
"""Other columns, or options, and what is said of them."""


@pytest.mark.parametrize(("change", "words"), MISTAKES)
def test_a_formal_mistake_is_named_with_its_remedy(
    arm: Robot, tmp_path: Path, change: dict[str, Any], words: tuple[str, ...]
) -> None:
    options = {
        name: x for name, x in change.items() if name in ("columns", "repair", "description")
    }
    path = written(tmp_path, **({} if options else change))
    with pytest.raises(LogError) as caught:
        read_log(path, arm, **options)
    assert str(caught.value).startswith(f"'{path}'") or options
    for word in words:
        assert word in str(caught.value)
    if REPAIR in str(caught.value):  # the command line names its option in this place
        assert REPAIR in caught.value.arguments


def test_a_repair_refuses_a_dead_sensor_in_any_names(arm: Robot, tmp_path: Path) -> None:
    """Only a log with a description was asked whether its sensors are alive."""
    path = written(tmp_path, **{MOTOR: np.zeros(len(TIME))})
    with pytest.raises(LogError, match="is 0 all the time while the other side of the joint"):
        read_log(path, arm, repair=seaid.Repairs())


def test_joints_need_the_sensors_of_their_drive(arm: Robot, tmp_path: Path) -> None:
    """A stiff joint needs one encoder; an elastic one that of its motor, with its torque."""
    elastic = one_joint(tmp_path, drive={"type": "series_elastic", "gear_ratio": 100})
    assert np.all(np.isnan(read_log(written(tmp_path, **{MOTOR: None}), arm).motor_position))
    alone = written(tmp_path, **{JOINT: None})
    assert all(np.all(np.isnan(read_log(alone, one).joint_position)) for one in (arm, elastic))
    words = (
        "joint 'arm' needs both positions and one torque, or at least motor position and motor "
        "torque, found joint_position, motor_torque"
    )
    for missing in (None, np.full_like(TIME, np.nan)):
        with pytest.raises(LogError, match=words):
            read_log(written(tmp_path, **{MOTOR: missing}), elastic)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("amr.joint_torque_Nm", "no joint 'amr': the nearest name is 'arm.joint_torque_Nm'"),
        ("leg.joint_torque_Nm", "'leg.joint_torque_Nm' is not read, as the robot has no joint"),
        ("arm.joint_toque_Nm", "not read: the nearest name is 'arm.joint_torque_Nm'"),
        (SPRING, f"'{SPRING}' is NaN throughout"),
    ],
)
def test_a_column_that_is_none_of_a_joint_is_said(
    name: str, words: str, arm: Robot, tmp_path: Path
) -> None:
    """A name that is nearly right, and a sensor without a number, get a warning."""
    path = written(tmp_path, **{name: np.nan * TIME if name == SPRING else TIME})
    with pytest.warns(SeaidWarning, match=words):
        assert np.all(np.isnan(read_log(path, arm).sensors()["joint_torque"]))


def test_columns_in_memory_are_read_as_a_file(arm: Robot, tmp_path: Path) -> None:
    """Mappings and tables of pandas, with stamps and arrays, give the log of the file."""
    expected, frame = read_log(written(tmp_path), arm), pd.DataFrame(COLUMNS)
    for held in (COLUMNS, frame, frame.set_index("time_s")):
        log = read_log(held, arm)
        np.testing.assert_allclose(log.time, expected.time, rtol=1e-11)
        np.testing.assert_allclose(log.motor_torque, expected.motor_torque, rtol=1e-11)
    stamps = frame.assign(time_s=pd.to_datetime(1.7e9 + TIME, unit="s"))
    assert read_log(stamps, arm).time == pytest.approx(1.7e9 + TIME)
    unknown = pd.Series(pd.to_datetime([1.7e9, None, 1.7e9 + 1], unit="s"))
    np.testing.assert_array_equal(_plain_numbers(unknown), [1.7e9, np.nan, 1.7e9 + 1])
    custom = {"t": TIME, "q": COLUMNS[MOTOR][:, None], "tau": COLUMNS[TORQUE]}
    of_arm = {"motor_position": "q[0]", "motor_torque": "tau"}
    log = read_log(custom, arm, description={"time": "t", "joints": {"arm": of_arm}})
    assert log.motor_position[:, 0] == pytest.approx(COLUMNS[MOTOR])
    for wrong, words in (
        ({"q": TIME}, r"columns in memory.* no column of this robot"),
        ({MOTOR: TIME}, r"columns in memory.*'time_s'"),
        (COLUMNS | {MOTOR: ["a"] * 300}, "must be a vector of numbers"),
        (
            COLUMNS | {MOTOR: np.zeros(7)},
            f"columns have different lengths: '{MOTOR}' 7, 'time_s' 300, ",
        ),
    ):
        with pytest.raises(LogError, match=words):
            read_log(wrong, arm)
