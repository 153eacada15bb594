"""MATLAB files of all versions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import io

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import read_log
from seaid.log.readers.opening import open_table
from seaid.robot import Robot

TIME: Array = np.linspace(0.0, 1.99, 200)

ROWS: Array = np.column_stack([TIME, np.sin(3 * TIME), np.cos(2 * TIME)])


@pytest.mark.slow  # 2.4 s
@pytest.mark.parametrize("version", ["5", "4", "7.3"])
def test_a_matlab_file_is_read(arm: Robot, tmp_path: Path, version: str) -> None:
    path = tmp_path / "run.mat"
    if version == "7.3":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            file["t"] = TIME[None, :]
            file["log/q"] = ROWS.T
            file["#refs#/a"] = 1.0
        content = path.read_bytes()
        head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
        path.write_bytes(head.ljust(512, b"\0") + content[512:])
    elif version == "5":
        io.savemat(path, {"t": TIME, "log": {"q": ROWS}, "name": "a text", "n": 3})
    else:
        io.savemat(path, {"t": TIME[:, None], "log": ROWS}, format="4")
    names = open_table(path).names
    q = "log" if version == "4" else "log.q"
    assert set(names) == {"t", f"{q}[0]", f"{q}[1]", f"{q}[2]"}
    description = {
        "time": "t",
        "joints": {"arm": {"joint_position": f"{q}[1]", "motor_torque": f"{q}[2]"}},
    }
    log = read_log(path, arm, description=description)
    np.testing.assert_allclose(log.joint_position[:, 0], ROWS[:, 1])


@pytest.mark.slow  # 0.7 s
def test_a_matlab_file_without_numbers_or_damaged_is_named(tmp_path: Path) -> None:
    io.savemat(tmp_path / "run.mat", {"name": "a text"})
    with pytest.raises(LogError, match=r"has no array of numbers, found: name; save arrays of num"):
        open_table(tmp_path / "run.mat")
    (tmp_path / "run.mat").write_bytes(b"junk" * 100)
    with pytest.raises(LogError, match="is not a MATLAB file, or a damaged one"):
        open_table(tmp_path / "run.mat")
