"""Log: its shape, its parts, and the names of what it has."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import LogError, SeaidError
from seaid.log import Log, write_log
from seaid.log.channels import column_names


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


def test_csv_names_its_columns_as_the_design_says(tmp_path: Path) -> None:
    """Names and units of all quantities, of joints that turn and that slide, are fixed."""
    log = log_of(joint_torque=np.zeros((60, 2)), is_prismatic=(False, True))
    write_log(log, tmp_path / "log.csv")
    header = (tmp_path / "log.csv").read_text().splitlines()[0]
    assert header.split(",") == [
        "time_s",
        *("a.motor_position_rad", "a.joint_position_rad", "a.motor_torque_Nm", "a.joint_torque_Nm"),
        *("b.motor_position_rad", "b.joint_position_m", "b.motor_torque_Nm", "b.joint_force_N"),
    ]
    names = list(column_names("b", is_prismatic=True).values())
    more = ["b.motor_current_A", "b.motor_voltage_V", "b.deflection_m"]
    more += ["b.motor_temperature_degC", "b.position_command_m"]
    more += ["b.velocity_command_m_per_s", "b.force_command_N", "b.supply_voltage_V"]
    assert names == [*header.split(",")[5:], *more]


def test_log_cannot_be_written_in_an_unknown_format_or_place(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"cannot write '\.mat' logs; allowed: \.csv, \.npz"):
        write_log(log_of(), tmp_path / "log.mat")
    (tmp_path / "file").touch()
    with pytest.raises(SeaidError, match=r"cannot write .* name a folder you may write to"):
        write_log(log_of(), tmp_path / "file" / "log.csv")


def test_log_keeps_read_only_copies_of_what_was_measured() -> None:
    """What is done to an array afterwards does not reach the log; no sensor is NaN."""
    position = np.zeros((60, 2))
    log = log_of(motor_position=position)
    position[0, 0] = 1.0
    assert log.motor_position[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        log.time[0] = 1.0
    log = Log(log.time, ("arm",), motor_position=position[:, :1], motor_torque=position[:, :1])
    assert np.all(np.isnan(log.joint_position))
    assert [*log.columns()] == ["arm.motor_position_rad", "arm.motor_torque_Nm"]


def test_between_keeps_the_start_and_leaves_the_end() -> None:
    """Every channel is cut alike, and too short a part is refused."""
    current = np.arange(400.0).reshape(200, 2)
    log = log_of(count=200, joint_torque=np.full((200, 2), np.nan), motor_current=current)
    part = log.between(0.5, 1.5)
    np.testing.assert_array_equal(part.sensors()["motor_current"], current[50:150])
    assert part.joint_torque is not None
    assert part.time[[0, -1]].tolist() == [0.5, 1.49]
    np.testing.assert_array_equal(part.motor_torque, log.motor_torque[50:150])
    assert len(log.between(0.0, 0.5).time) == 50
    with pytest.raises(LogError, match="a log needs 50 samples or more, found 49"):
        log.between(0.0, 0.49)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"motor_position": np.zeros((5, 2))}, r"motor_position must have shape \(60, 2\), found"),
        ({"joint_torque": np.zeros(60)}, r"joint_torque must have shape \(60, 2\), found \(60,\)"),
        ({"time": np.zeros((60, 1))}, r"time must have shape \(any\), found \(60, 1\)"),
        ({"time": 3.0}, r"time must have shape \(any\), found \(\)"),
        ({"joint_names": ("a", "a")}, "joint_names has a joint twice: a, a"),
        ({"is_prismatic": (True,)}, "is_prismatic needs one entry per joint, 2, found 1"),
    ],
)
def test_log_of_wrong_shape_is_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(LogError, match=words):
        log_of(**wrong)
