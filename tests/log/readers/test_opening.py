"""Files of every format: the same log, or what is no such file."""

from __future__ import annotations

import json
import os
import re
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seaid._arrays import Array
from seaid.errors import LogError, SeaidError, SeaidWarning
from seaid.log.channels import SENSORS
from seaid.log.log import LARGEST
from seaid.log.long_log import iterate_log, open_long_log
from seaid.log.readers.opening import READERS, open_table
from seaid.log.reading import WRITTEN, Log, read_log
from seaid.robot.robot import Robot
from tests.fuzz.mutators import damaged_bytes
from tests.log.readers.files import FORMATS, TIME, error_of, one_log, write
from tests.one_joint import one_joint
from tests.representatives import quick_first

numbers = arrays(np.float64, (50, 3), elements=st.floats(-LARGEST, LARGEST))


@pytest.mark.parametrize("suffix", [*FORMATS, ".CSV", ".NPZ"])
@given(values=numbers, missing=st.sets(st.sampled_from(sorted({*SENSORS} - {"motor_torque"}))))
def test_any_log_is_the_same_to_the_last_bit_after_writing_and_reading(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, values: Array, missing: set[str]
) -> None:
    folder = tmp_path_factory.mktemp("log")
    missing -= {"joint_position"} if "motor_position" in missing else set()  # one side is needed
    data: dict[str, Any] = {x: values[:, [k % 3]] for k, x in enumerate(SENSORS)}
    data |= {name: np.full((50, 1), np.nan) for name in missing}  # no such sensor
    log = Log(np.cumsum(1e-3 + np.arange(50.0) ** 0.3), ("arm",), **data)
    write(log, folder / f"log{suffix}")
    back = read_log(folder / f"log{suffix}", one_joint(folder))
    np.testing.assert_array_equal(back.time, log.time)
    assert back.columns().keys() == log.columns().keys()
    for name, column in log.columns().items():
        np.testing.assert_array_equal(back.columns()[name], column)
    assert sorted(os.listdir(folder)) == ["arm.urdf", f"log{suffix}"]


@pytest.mark.parametrize("suffix", WRITTEN)
def test_log_in_pieces_is_the_log_as_a_whole(arm: Robot, tmp_path: Path, suffix: str) -> None:
    log, path = one_log(), tmp_path / f"log{suffix}"
    write(log, path)
    parts = [part.log for part in iterate_log(path, arm, chunk_samples=150)]
    assert [len(part.time) for part in parts] == [150, 150, 100]
    joined = np.concatenate([part.joint_position for part in parts])
    np.testing.assert_array_equal(joined, log.joint_position)


def test_json_logs_cannot_be_read_in_pieces(arm: Robot, tmp_path: Path) -> None:
    write(one_log(), tmp_path / "log.json")
    with pytest.raises(LogError, match=r"'\.json' logs cannot be read in pieces; allowed: \.csv"):
        open_long_log(tmp_path / "log.json", arm)


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        (".npz", "is not a NumPy archive (.npz), or a damaged one"),
        (".parquet", "is not a Parquet file, or a damaged one"),
        (".h5", "is not an HDF5 file, or a damaged one"),
        (".mat", "is not a MATLAB file, or a damaged one"),
        (".json", "is not valid JSON, or cut off"),
        (".db3", "is not a ROS bag, or a damaged one"),
        (".mcap", "is not a ROS bag, or a damaged one"),
        (".bag", "is not a ROS bag, or a damaged one"),
        pytest.param(".hebilog", "is not a HEBI log, or a damaged one", marks=pytest.mark.hebi),
    ],
)
@pytest.mark.parametrize(
    "content",  # a process of its own for each bag
    quick_first([b"junk" * 100, b"", b"PK\x03\x04junk", bytes(range(256)) * 20]),
)
def test_what_is_no_file_of_its_ending_is_named(
    tmp_path: Path, ending: str, words: str, content: bytes
) -> None:
    path = tmp_path / f"log{ending}"
    path.write_bytes(content)
    assert error_of(path).startswith(f"'{path}' {words}")


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_file_that_is_cut_off_is_named(
    arm: Robot, tmp_path: Path, suffix: str, share: float
) -> None:
    path = tmp_path / f"log{suffix}"
    write(one_log(), path)
    content = path.read_bytes()[: int(share * path.stat().st_size)]
    path.write_bytes(content.rpartition(b",")[0] if suffix == ".csv" else content)
    with pytest.raises(LogError, match=re.escape(f"'{path}'")):
        read_log(path, arm)


@pytest.mark.parametrize("suffix", FORMATS)
def test_damaged_bytes_of_any_kind_are_read_or_refused(
    arm: Robot, tmp_path: Path, suffix: str
) -> None:
    path, rng = tmp_path / f"log{suffix}", Random(f"log{suffix}")
    write(one_log().between(0.0, 0.6), path)
    whole = path.read_bytes()
    for _ in range(60):
        path.write_bytes(damaged_bytes(rng, whole))
        with suppress(SeaidError, SeaidWarning):
            read_log(path, arm)


@pytest.mark.parametrize(
    ("module", "name", "extra"),
    [
        ("pyarrow.parquet", "log.parquet", "parquet"),
        ("h5py", "log.h5", "hdf5"),
        ("rosbags.highlevel", "log.db3", "ros"),
        ("hebi", "log.hebilog", "hebi"),
    ],
)
def test_missing_package_names_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, name: str, extra: str
) -> None:
    (tmp_path / name).touch()
    monkeypatch.setitem(sys.modules, module, None)
    assert error_of(tmp_path / name).endswith(
        f"need the package {module.split('.')[0]}, which is not installed; get it with pip install "
        f"'seaid[{extra}]'"
    )


def test_files_that_are_not_there_and_unknown_formats_are_named(tmp_path: Path) -> None:
    path = tmp_path / "no.csv"
    missing = f"no log file at '{path}' (working folder {Path.cwd()})"
    assert error_of(path) == missing
    (tmp_path / "now.csv").write_text("")
    assert error_of(path) == f"{missing}; did you mean 'now.csv'?"
    remedies = {
        "log.out": f"allowed: {', '.join(READERS)}",
        "run.xlsx": "save the sheet as CSV in UTF-8",
        "run.csv.gz": "unpack it first",
        "run.pkl": "it could run any code; write it as .npz or .parquet",
        "run.tdms": "export it as CSV, .parquet or .h5",
        "run.mtx": "export it as CSV, .parquet or .h5",
    }
    for name, remedy in remedies.items():
        path = tmp_path / name
        path.write_bytes(b"PK")
        assert error_of(path) == f"'{path}': cannot read '{path.suffix}' logs; {remedy}"


@pytest.mark.parametrize("ending", [".npz", ".h5", ".json", ".parquet"])
def test_text_where_numbers_belong_is_named(tmp_path: Path, ending: str) -> None:
    path, words = tmp_path / f"log{ending}", ["x", "y"]
    if ending == ".h5":
        with h5py.File(path, "w") as file:
            file["a"] = words
    elif ending == ".npz":
        np.savez(path, a=np.array(words))
    elif ending == ".json":
        path.write_text(json.dumps({"a": words}))
    else:
        parquet.write_table(arrow.table({"a": words}), path)
    assert "column 'a' must be a vector of numbers, found" in error_of(path, "a")


def test_columns_of_arrays_have_their_place_in_brackets(tmp_path: Path) -> None:
    q = np.random.default_rng(0).normal(size=(60, 3))
    np.savez(tmp_path / "log.npz", t=TIME[:60], q=q)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["state/q"] = q
        file["state/t"] = TIME[:60]
        file["table"] = np.array([(1.0, 2)] * 60, dtype=[("a", "f8"), ("b", "i4")])
    (tmp_path / "log.json").write_text(json.dumps({"q": q.tolist(), "t": TIME[:60].tolist()}))
    for name, prefix in (("log.npz", ""), ("log.h5", "state/"), ("log.json", "")):
        table = open_table(tmp_path / name)
        assert {f"{prefix}q[0]", f"{prefix}q[2]", f"{prefix}t"} <= set(table.names)
        np.testing.assert_array_equal(table.load([f"{prefix}q[2]"])[f"{prefix}q[2]"], q[:, 2])
    fields = open_table(tmp_path / "log.h5").load(["table/a", "table/b"])
    assert fields["table/b"].tolist() == [2.0] * 60


def test_sockets_devices_and_links_that_go_round_are_refused(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(os.path.relpath(tmp_path / "s.csv"))
    assert "is a pipe, a socket or a device" in error_of(tmp_path / "s.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    assert "is a pipe, a socket or a device" in error_of(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    assert "is a pipe, a socket or a device" in error_of(tmp_path / "zero.csv")
    (tmp_path / "round.csv").symlink_to("round.csv")
    assert "Too many levels of symbolic links" in error_of(tmp_path / "round.csv")
    assert "File name too long" in error_of(tmp_path / f"{'x' * 300}.csv")
    assert "null" in error_of(Path("a\0b.csv"))
    assert "no log file at" in error_of(tmp_path / "zero.csv" / "log.csv")


def test_a_folder_with_a_pipe_for_a_bag_is_none(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.db3")
    assert "is a folder without a ROS bag" in error_of(tmp_path)


def test_names_with_escapes_are_shown_without(arm: Robot, tmp_path: Path) -> None:
    write: dict[str, Callable[[Path], Any]] = {
        "log.json": lambda path: path.write_text(json.dumps({"a\n\x1b[31m": [1.0]})),
        "log.parquet": lambda path: parquet.write_table(arrow.table({"a\n\x1b[31m": [1.0]}), path),
    }
    for name, to in write.items():
        to(tmp_path / name)
        with pytest.raises(LogError) as caught:
            read_log(tmp_path / name, arm)
        assert "\x1b" not in str(caught.value)
        assert "\\x1b[31m" in str(caught.value)
