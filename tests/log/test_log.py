"""Log, read_log and write_log: round trips, foreign columns, and what is wrong named."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seaid._arrays import Array
from seaid.errors import LogError, SeaidError, SeaidWarning
from seaid.log.channels import column_names
from seaid.log.log import MINIMUM_SAMPLES
from seaid.log.readers.opening import _plain_numbers
from seaid.log.reading import Log, read_log, write_log
from seaid.robot.robot import Robot
from tests.one_joint import one_joint

TIME = np.arange(60) / 100
NAMES = ["time_s", "arm.motor_position_rad", "arm.joint_position_rad", "arm.motor_torque_Nm"]
VALUES = np.column_stack([TIME, np.sin(TIME), np.cos(TIME), TIME**2])
Columns = dict[str, Any]


@pytest.fixture
def elastic_arm(tmp_path: Path) -> Robot:
    return one_joint(tmp_path, drive={"type": "series_elastic", "gear_ratio": 100})


@pytest.fixture
def write_csv(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes names and rows of cells, or a text, as log.csv."""

    def write(names: list[str] = NAMES, rows: Any = VALUES, delimiter: str = ",") -> Path:
        path = tmp_path / "log.csv"
        lines = [delimiter.join(names), *(delimiter.join(map(str, row)) for row in rows)]
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def read_error(path: Path, robot: Robot, columns: Any = None) -> str:
    with pytest.raises(LogError) as caught:
        read_log(path, robot, columns=columns)
    return str(caught.value)


def log_of(n: int = 2, count: int = 60, **other: Any) -> Log:
    rng = np.random.default_rng(0)
    position, load, torque = rng.normal(size=(3, count, n))
    names = tuple("abcdef"[:n])
    fields: dict[str, Any] = {
        "time": np.arange(count) / 100,
        "joint_names": names,
        "motor_position": position,
        "joint_position": load,
        "motor_torque": torque,
    }
    return Log(**(fields | other))


# Round trips


def test_csv_names_its_columns_as_the_design_says(tmp_path: Path) -> None:
    log = log_of(joint_torque=np.zeros((60, 2)), is_prismatic=(False, True))
    write_log(log, tmp_path / "log.csv")
    header = (tmp_path / "log.csv").read_text().splitlines()[0]
    assert header.split(",") == [
        "time_s",
        *("a.motor_position_rad", "a.joint_position_rad", "a.motor_torque_Nm", "a.joint_torque_Nm"),
        *("b.motor_position_rad", "b.joint_position_m", "b.motor_torque_Nm", "b.joint_force_N"),
    ]
    names = list(column_names("b", is_prismatic=True))
    more = ["b.motor_current_A", "b.motor_voltage_V", "b.deflection_m"]
    more += ["b.motor_temperature_degC", "b.position_command_m"]
    more += ["b.velocity_command_m_per_s", "b.force_command_N", "b.supply_voltage_V"]
    assert names == [*header.split(",")[5:], *more]


def test_log_cannot_be_written_in_an_unknown_format_or_place(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"cannot write '\.mat' logs; allowed: \.csv, \.npz"):
        write_log(log_of(), tmp_path / "log.mat")
    (tmp_path / "file").touch()
    for name in ("log.csv", "log.npz"):
        with pytest.raises(SeaidError, match=r"cannot write .* name a folder you may write to"):
            write_log(log_of(), tmp_path / "file" / name)


# The same table written otherwise


def test_columns_not_asked_for_may_hold_anything(
    arm: Robot, write_csv: Callable[..., Path]
) -> None:
    rows = [[*row, "running", ""] for row in VALUES]
    log = read_log(write_csv([*NAMES, "state", "state"], rows), arm)
    np.testing.assert_array_equal(log.joint_position[:, 0], VALUES[:, 2])


# Foreign columns


def test_foreign_columns_come_in_by_name_unit_and_factor(
    arm: Robot, write_csv: Callable[..., Path]
) -> None:
    path = write_csv(["t", "angle", "pos", "current"])
    columns: Columns = {
        "time_s": ("t", "ms"),
        "arm.motor_position_rad": ("angle", "turn"),
        "arm.joint_position_rad": ("pos", "deg"),
        "arm.motor_torque_Nm": ("current", -0.0302),
    }
    log = read_log(path, arm, columns=columns)
    np.testing.assert_allclose(log.time, 1e-3 * TIME, rtol=1e-15)
    np.testing.assert_allclose(log.motor_position[:, 0], 2 * np.pi * VALUES[:, 1], rtol=1e-15)
    np.testing.assert_allclose(log.joint_position[:, 0], np.deg2rad(VALUES[:, 2]), rtol=1e-15)
    np.testing.assert_allclose(log.motor_torque[:, 0], -0.0302 * VALUES[:, 3], rtol=1e-15)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"arm.joint_position": "x"}, "robot's log is named 'arm.joint_position'; did you mean"),
        ({"time_s": "tme_s"}, "no column is named 'tme_s'; did you mean 'time_s'? allowed: time_s"),
        ({"time_s": ("time_s", "msec")}, "'time_s': no unit of this quantity is named 'msec'; did"),
        ({"time_s": ("time_s", "deg")}, "is named 'deg'; allowed: s, ms, us, ns"),
        ({NAMES[3]: (NAMES[3], "rad")}, "is named 'rad'; allowed: Nm, mNm, uNm"),
        ({NAMES[1]: (NAMES[1], 0.0)}, "the factor must be finite and not zero, found 0.0"),
        ({NAMES[1]: (NAMES[1], np.nan)}, "the factor must be finite and not zero, found nan"),
        ({NAMES[1]: ("x", "rad", 1)}, "must be a column name or (name, unit or factor), found ("),
        ({NAMES[1]: None}, "must be a column name or (name, unit or factor), found None"),
        ({"time_s": 5}, "'time_s' must be a column name or"),
        ({"time_s": ("t", None)}, "'time_s' must be a column name or"),
        ({"time_s": (5, 1.0)}, "'time_s' must be a column name or"),
        (["time_s"], "columns= must be a mapping"),
    ],
)
def test_wrong_mapping_of_columns_is_named(
    arm: Robot, write_csv: Callable[..., Path], columns: Any, words: str
) -> None:
    assert words in read_error(write_csv(), arm, columns)


# Files that are no log


# Samples that cannot be


@pytest.mark.parametrize(
    ("row", "column", "cell", "words"),
    [
        (5, 2, "nan", "'arm.joint_position_rad' has 1 values that are not finite, the first in "),
        (5, 2, "", "sample 5 (t = 0.05 s); leave the whole column NaN if there is no such sensor"),
        (5, 2, "inf", "column 'arm.joint_position_rad' has 1 values that are not finite"),
        (5, 0, "nan", "time_s has a value that is not finite in sample 5"),
        (5, 0, "0.04", "time_s repeats at sample 5 (0.04 s, then 0.04 s; 1 such places); it must"),
        (5, 0, "0.01", "time_s goes backwards at sample 5 (0.04 s, then 0.01 s; 1 such places)"),
        (7, 3, "2e12", "'arm.motor_torque_Nm' has 2e+12 in sample 7"),
    ],
)
def test_bad_sample_is_named_with_file_column_and_place(
    arm: Robot, write_csv: Callable[..., Path], row: int, column: int, cell: str, words: str
) -> None:
    rows: list[list[Any]] = VALUES.tolist()
    rows[row][column] = cell
    path = write_csv(rows=rows)
    text = read_error(path, arm)
    assert text.startswith(f"'{path}': ")
    assert words in text


def test_too_few_samples_are_counted(arm: Robot, write_csv: Callable[..., Path]) -> None:
    assert MINIMUM_SAMPLES == 50
    text = read_error(write_csv(rows=VALUES[:49]), arm)
    assert text.endswith("a log needs 50 samples or more, found 49")
    assert len(read_log(write_csv(rows=VALUES[:50]), arm).time) == 50


# Sensors that a joint needs


def without(name: str) -> tuple[list[str], Array]:
    kept = [index for index, other in enumerate(NAMES) if other != name]
    return [NAMES[index] for index in kept], VALUES[:, kept]


def test_stiff_joint_needs_one_position_and_one_torque(
    arm: Robot, write_csv: Callable[..., Path]
) -> None:
    for name in ("arm.motor_position_rad", "arm.joint_position_rad"):
        read_log(write_csv(*without(name)), arm)
    text = read_error(write_csv(*without("arm.motor_torque_Nm")), arm)
    needs = "one position and one torque, current, voltage, position command or velocity command"
    assert f"joint 'arm' needs {needs}, found motor_position, joint_" in text
    assert text.endswith(f"its columns are {', '.join(column_names('arm', is_prismatic=False))}")


def test_elastic_joint_needs_both_positions(
    elastic_arm: Robot, write_csv: Callable[..., Path]
) -> None:
    read_log(write_csv(), elastic_arm)
    words = (
        "joint 'arm' needs both positions and one torque, or at least motor position and motor "
        "torque, found joint_position, motor_torque"
    )
    text = read_error(write_csv(*without("arm.motor_position_rad")), elastic_arm)
    assert words in text
    empty = VALUES.copy()
    empty[:, 1] = np.nan
    assert words in read_error(write_csv(rows=empty), elastic_arm)


def test_elastic_joint_may_have_the_motor_side_alone(
    elastic_arm: Robot, write_csv: Callable[..., Path]
) -> None:
    log = read_log(write_csv(*without("arm.joint_position_rad")), elastic_arm)
    assert np.all(np.isnan(log.joint_position))


# Log itself


def test_log_keeps_read_only_copies() -> None:
    position = np.zeros((60, 2))
    log = log_of(motor_position=position)
    position[0, 0] = 1.0
    assert log.motor_position[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        log.time[0] = 1.0


def test_between_keeps_the_start_and_leaves_the_end() -> None:
    current = np.arange(400.0).reshape(200, 2)
    log = log_of(count=200, joint_torque=np.full((200, 2), np.nan), motor_current=current)
    part = log.between(0.5, 1.5)
    np.testing.assert_array_equal(part.sensors()["motor_current"], current[50:150])
    assert part.joint_torque is not None
    assert part.time[[0, -1]].tolist() == [0.5, 1.49]
    np.testing.assert_array_equal(part.motor_torque, log.motor_torque[50:150])
    with pytest.raises(LogError, match="a log needs 50 samples or more, found 10"):
        log.between(0.0, 0.1)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"motor_position": np.zeros((5, 2))}, r"motor_position must have shape \(60, 2\), found"),
        ({"joint_torque": np.zeros(60)}, r"joint_torque must have shape \(60, 2\), found \(60,\)"),
        ({"time": np.zeros((60, 1))}, r"time must have shape \(any\), found \(60, 1\)"),
        ({"time": 3.0}, r"time must have shape \(any\), found \(\)"),
        ({"time": np.zeros(60)}, r"time_s repeats at sample 1 \(0 s, then 0 s; 59 such places\)"),
        ({"joint_names": ("a", "a")}, "joint_names has a joint twice: a, a"),
        ({"is_prismatic": (True,)}, "is_prismatic needs one entry per joint, 2, found 1"),
    ],
)
def test_log_of_wrong_shape_is_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(LogError, match=words):
        log_of(**wrong)


def test_a_column_of_nan_is_said(arm: Robot, write_csv: Callable[..., Path]) -> None:
    rows = np.column_stack([VALUES, np.full(len(TIME), np.nan)])
    path = write_csv([*NAMES, "arm.joint_torque_Nm"], rows)
    with pytest.warns(SeaidWarning, match="'arm.joint_torque_Nm' is NaN throughout"):
        assert np.all(np.isnan(read_log(path, arm).sensors()["joint_torque"]))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("amr.joint_torque_Nm", "no joint 'amr': the nearest name is 'arm.joint_torque_Nm'"),
        ("leg.joint_torque_Nm", "'leg.joint_torque_Nm' is not read, as the robot has no joint"),
        ("arm.joint_toque_Nm", "not read: the nearest name is 'arm.joint_torque_Nm'"),
    ],
)
def test_a_column_that_is_nearly_one_of_a_joint_is_said(
    name: str, words: str, arm: Robot, write_csv: Callable[..., Path]
) -> None:
    path = write_csv([*NAMES, name], np.column_stack([VALUES, TIME]))
    with pytest.warns(SeaidWarning, match=words):
        read_log(path, arm)


def test_columns_in_memory_are_read_as_a_file(arm: Robot, write_csv: Callable[..., Path]) -> None:
    columns = dict(zip(NAMES, VALUES.T, strict=True))
    expected = read_log(write_csv(), arm)
    frame = pd.DataFrame(columns)
    for held in (columns, frame, frame.set_index("time_s")):
        log = read_log(held, arm)
        assert np.array_equal(log.time, expected.time)
        assert np.array_equal(log.motor_torque, expected.motor_torque)
    stamps = frame.assign(time_s=pd.to_datetime(1.7e9 + TIME, unit="s"))
    assert read_log(stamps, arm).time == pytest.approx(1.7e9 + TIME)
    unknown = pd.Series(pd.to_datetime([1.7e9, None, 1.7e9 + 1], unit="s"))
    np.testing.assert_array_equal(_plain_numbers(unknown), [1.7e9, np.nan, 1.7e9 + 1])
    custom = {"t": TIME, "q": VALUES[:, [1]], "tau": VALUES[:, 3]}
    names = {"time_s": "t", NAMES[1]: "q[0]", NAMES[3]: "tau"}
    assert read_log(custom, arm, columns=names).motor_position[:, 0] == pytest.approx(VALUES[:, 1])
    with pytest.raises(LogError, match=r"columns in memory.*'time_s'"):
        read_log({"q": TIME}, arm)
    with pytest.raises(LogError, match="must be a vector of numbers"):
        read_log({**columns, NAMES[1]: ["a"] * 60}, arm)
    with pytest.raises(LogError, match="columns have different lengths: 'time_s' 60, "):
        read_log({**columns, NAMES[1]: np.zeros(7)}, arm)


def test_a_log_has_what_was_measured() -> None:
    log = Log(TIME, ("arm",), motor_position=VALUES[:, [1]], motor_torque=VALUES[:, [3]])
    assert log.joint_position.shape == (60, 1)
    assert np.all(np.isnan(log.joint_position))
    assert [*log.columns()] == [NAMES[1], NAMES[3]]
    assert len(log.between(0.0, 0.55).time) == 55
