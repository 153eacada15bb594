"""Readers: every format gives the same log; truncated, corrupt and empty files are named."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

import seaid.log.readers.table as limits
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.long_log import iterate_log, open_long_log
from seaid.log.readers.opening import open_table
from seaid.log.readers.table import free_memory
from seaid.log.reading import WRITTEN, Log, read_log, write_log
from seaid.robot.robot import Robot
from tests.representatives import quick_first

TIME = np.arange(400) / 100


def one_log() -> Log:
    def wave(hz: float) -> Array:
        return np.sin(2 * np.pi * hz * TIME)[:, None]

    return Log(TIME, ("arm",), wave(0.5), wave(0.7), wave(0.9), motor_current=wave(1.1))


def write_json(log: Log, path: Path) -> None:
    columns = {"time_s": log.time, **log.columns()}
    path.write_text(json.dumps({name: values.tolist() for name, values in columns.items()}))


FORMATS: dict[str, Callable[[Log, Path], None]] = {
    **dict.fromkeys(WRITTEN, write_log),
    ".json": write_json,
}
"""{suffix: what writes a log with our columns}."""

IN_PIECES = WRITTEN
"""Suffixes of the files that are read in pieces."""


def error_of(path: Path, robot: Robot) -> str:
    with pytest.raises(LogError) as caught:
        read_log(path, robot)
    return str(caught.value)


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_the_log_back_to_the_last_bit(
    arm: Robot, tmp_path: Path, suffix: str
) -> None:
    log, path = one_log(), tmp_path / f"log{suffix}"
    FORMATS[suffix](log, path)
    back = read_log(path, arm)
    assert back.columns().keys() == log.columns().keys()
    for column, values in log.columns().items():
        np.testing.assert_array_equal(back.columns()[column], values)


@pytest.mark.parametrize("suffix", IN_PIECES)
def test_log_in_pieces_is_the_log_as_a_whole(arm: Robot, tmp_path: Path, suffix: str) -> None:
    log, path = one_log(), tmp_path / f"log{suffix}"
    FORMATS[suffix](log, path)
    parts = [part.log for part in iterate_log(path, arm, chunk_samples=150)]
    assert [len(part.time) for part in parts] == [150, 150, 100]
    joined = np.concatenate([part.joint_position for part in parts])
    np.testing.assert_array_equal(joined, log.joint_position)


def test_json_logs_cannot_be_read_in_pieces(arm: Robot, tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(json.dumps({"time_s": TIME.tolist()}))
    with pytest.raises(LogError, match=r"'\.json' logs cannot be read in pieces; allowed: \.csv"):
        open_long_log(path, arm)


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        (".parquet", "is not a Parquet file, or a damaged one"),
        (".h5", "is not an HDF5 file, or a damaged one"),
        (".json", "is not valid JSON, or cut off"),
        (".db3", "is not a ROS bag, or a damaged one"),
        (".mcap", "is not a ROS bag, or a damaged one"),
        (".bag", "is not a ROS bag, or a damaged one"),
        pytest.param(".hebilog", "is not a HEBI log, or a damaged one", marks=pytest.mark.hebi),
    ],
)
@pytest.mark.parametrize(
    "content",  # a process of its own for each bag
    quick_first([b"junk", b"", bytes(range(256)) * 20]),
)
def test_what_is_no_file_of_its_ending_is_named(
    arm: Robot, tmp_path: Path, ending: str, words: str, content: bytes
) -> None:
    path = tmp_path / f"log{ending}"
    path.write_bytes(content)
    text = error_of(path, arm)
    assert text.startswith(f"'{path}' ")
    assert words in text


@pytest.mark.parametrize("name", ["log.npz", "log.parquet", "log.h5"])
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_file_that_is_cut_off_is_named(arm: Robot, tmp_path: Path, name: str, share: float) -> None:
    path = tmp_path / name
    write_log(one_log(), path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert error_of(path, arm).startswith(f"'{path}'")


def test_csv_cut_off_in_a_line_is_named(arm: Robot, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    write_log(one_log(), path)
    path.write_bytes(path.read_bytes()[:-60])
    assert "is not a table: line" in error_of(path, arm)


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
    arm: Robot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    module: str,
    name: str,
    extra: str,
) -> None:
    (tmp_path / name).touch()
    monkeypatch.setitem(sys.modules, module, None)
    package = module.split(".")[0]
    assert error_of(tmp_path / name, arm).endswith(
        f"need the package {package}, which is not installed; get it with pip install "
        f"'seaid[{extra}]'"
    )


# CSV of others


def test_header_of_numpy_and_spaces_are_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([TIME, TIME**2]), header="time   angle")
    table = open_table(path)
    assert list(table.names) == ["time", "angle"]
    np.testing.assert_array_equal(table.load(["angle"])["angle"], TIME**2)


def test_truth_values_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("on,off\nTrue,false\nFALSE,true\n")
    table = open_table(path)
    assert table.load(["on"])["on"].tolist() == [1.0, 0.0]


def test_wide_csv_is_read_without_looking_at_what_is_not_wanted(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("a,b,c\n" + "1,x,2\n" * 3)
    assert open_table(path).load(["c", "a"])["c"].tolist() == [2.0] * 3


def test_csv_too_large_for_the_memory_is_sent_to_the_long_way(
    arm: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    write_log(one_log(), path)
    with path.open("r+b") as file:
        file.truncate(2 * 10**9)  # sparse: takes no room on the disk
    monkeypatch.setattr(limits, "free_memory", lambda: 7.9e9)
    text = error_of(path, arm)
    assert "takes 2 GB of memory, too much for the 7.9 GB that are free" in text
    assert "read it in pieces with seaid.open_long_log" in text


def test_free_memory_is_what_the_machine_says() -> None:
    assert 1e6 < free_memory() < 1e14


# Arrays of two dimensions, nested data


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


def test_parquet_has_nulls_as_nan_and_instants_as_seconds(tmp_path: Path) -> None:
    stamps = np.datetime64("2026-01-15T10:28:10", "ns") + np.arange(3) * np.timedelta64(5, "ms")
    data = {"stamp": stamps, "q": arrow.array([1, None, 3]), "on": arrow.array([True, False, True])}
    parquet.write_table(arrow.table(data), tmp_path / "log.parquet")
    found = open_table(tmp_path / "log.parquet").load(["stamp", "q", "on"])
    np.testing.assert_allclose(found["stamp"], [0.0, 0.005, 0.01], rtol=1e-12)
    np.testing.assert_array_equal(found["q"], [1.0, np.nan, 3.0])
    assert found["on"].tolist() == [1.0, 0.0, 1.0]


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
    assert "has no columns; a JSON log is a list of records" in error_of(path, arm)


@pytest.mark.parametrize("ending", [".npz", ".h5", ".json", ".parquet"])
def test_text_where_numbers_belong_is_named(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"log{ending}"
    write: dict[str, Callable[[], Any]] = {
        ".npz": lambda: np.savez(path, a=np.array(["x", "y"])),
        ".json": lambda: path.write_text('{"a": ["x", "y"]}'),
        ".parquet": lambda: parquet.write_table(arrow.table({"a": ["x", "y"]}), path),
        ".h5": lambda: write_text_hdf5(path),
    }
    write[ending]()
    with pytest.raises(LogError, match="column 'a' must be a vector of numbers, found"):
        open_table(path).load(["a"])


def write_text_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["a"] = ["x", "y"]
