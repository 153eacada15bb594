"""Files that are damaged, declare too much, lie elsewhere, or are no files: always a LogError."""

import csv
import io
import json
import os
import socket
import struct
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

import seaid.log.readers.hebi_log as hebi_log
import seaid.log.readers.ros_bag as ros_bag
import seaid.log.readers.table as limits
from seaid.errors import LogError, SeaidError
from seaid.log.long_log import iterate_log, open_long_log
from seaid.log.readers.child_process import Answer
from seaid.log.readers.opening import READERS, open_table
from seaid.log.readers.table import free_memory
from seaid.log.reading import Log, read_log, write_log
from seaid.robot.robot import Robot
from tests.fuzz.mutators import damaged_bytes

HEBI_X5 = Path(__file__).parents[3] / "models/logs/hebi_x5_unloaded/exampleLog.hebilog"
MEASURED = Path(__file__).parents[4] / "shared" / "data" / "hebi_arms" / "virtual_spring.hebilog"
TIME = np.arange(300) / 100


def one_log() -> Log:
    wave = np.sin(2 * np.pi * TIME)[:, None]
    return Log(TIME, ("arm",), wave, 0.9 * wave, 2.0 * wave)


def error_of(path: Path, *wanted: str) -> str:
    """Return what opening a file, or loading columns of it, says; never much."""
    with pytest.raises(LogError) as caught:
        open_table(path).load(list(wanted))
    assert len(str(caught.value)) < 2100
    assert "\n" not in str(caught.value)
    return str(caught.value)


# What is no file


@pytest.mark.parametrize("ending", READERS)
def test_a_pipe_is_not_waited_for(tmp_path: Path, ending: str) -> None:
    os.mkfifo(tmp_path / f"log{ending}")
    assert "is a pipe, a socket or a device" in error_of(tmp_path / f"log{ending}")


def test_sockets_devices_and_links_that_go_round_are_refused(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(os.path.relpath(tmp_path / "s.csv"))
    assert "is a pipe, a socket or a device" in error_of(tmp_path / "s.csv")
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


@pytest.mark.parametrize("path", [None, 5, b"log.csv", [5]])
def test_a_path_is_a_text_or_a_path(arm: Robot, path: Any) -> None:
    for read in (read_log, open_long_log):
        with pytest.raises(LogError, match="path= must be a path"):
            read(path, arm)


# Arguments


@pytest.mark.parametrize("chunk_samples", [0, -1, 49, 1.5, "100", None, True, 10**10])
def test_pieces_have_a_whole_number_of_samples(
    arm: Robot, tmp_path: Path, chunk_samples: Any
) -> None:
    write_log(one_log(), tmp_path / "log.npz")
    with pytest.raises(LogError, match=r"chunk_samples=? must be a whole number"):
        open_long_log(tmp_path / "log.npz", arm, chunk_samples=chunk_samples)
    with pytest.raises(LogError, match="overlap_samples must be a whole number from 0 to"):
        next(iterate_log(tmp_path / "log.npz", arm, overlap_samples=-1))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"columns": ["time_s"]}, "columns= must be a mapping"),
        ({"columns": {"time_s": 5}}, "'time_s' must be a column name or"),
        ({"columns": {"time_s": ("t", None)}}, "'time_s' must be a column name or"),
        ({"columns": {"time_s": (5, 1.0)}}, "'time_s' must be a column name or"),
        (
            {"repair": True},
            "repair= must be a Repairs, found True; make one with",
        ),
        ({"description": 5}, "description= must be a LogDescription, a mapping, a path or a Desc"),
        (
            {
                "description": {
                    "joints": {"arm": {"joint_position": {"column": "q", "wraps": 10**400}}}
                }
            },
            "'wraps' must be a number above zero",
        ),
    ],
)
def test_arguments_of_another_kind_are_named(
    arm: Robot, tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    write_log(one_log(), tmp_path / "log.csv")
    with pytest.raises(LogError, match=words):
        read_log(tmp_path / "log.csv", arm, **options)


# CSV


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty; a log starts with a line of column names"),
        (b"\n\n\n", "is empty"),
        (b"a,b\n", "has column names but no samples"),
        (b"a,b\n\n \n", "has column names but no samples"),
        (
            "a,b\n1,2\n".encode("utf-16"),
            "is not a text file in UTF-8 (invalid start byte at byte 0)",
        ),
        ("a,b\n1,2\n".encode("utf-16-le"), "is not a text file in UTF-8 (it has zero bytes)"),
        (b"a,b\n1,\xff\n", "is not a text file in UTF-8 (invalid start byte at byte 6)"),
        (b'a,b\n"' + b"x" * 140_000 + b'",1\n', "is not a table: field larger than field limit"),
        (b'"' + b"x" * 140_000 + b'",b\n', "is not a table: field larger than field limit"),
        (
            b"a,b\n1," + b"2" * 2_000_000,
            "is not a table: line 2 has more than 1,000,000 characters",
        ),
        (b",".join([b"x"] * 20_000), "has 20,000 columns or more, allowed are 10,000"),
        (b"a," + b"b" * 5_000, "the name of a column has 5,000 characters, allowed are 1,000"),
        (b"a,a,b\n1,2,3\n", "column named twice: a"),
        (b"a,b\n1,2\n3\n", "line 3 has 1 cells, the first line 2 column names"),
        (b"a,b\n1,2,3,4\n", "line 2 has 4 cells, the first line 2 column names"),
        (b"a,b\n1,2\n1,2,3\n", "line 3 has 3 cells, the first line 2 column names"),
        (b"a,b\n1,2,3\n1,2\n", "line 3 has 2 cells, the first line 3 column names"),
        (b"a,b\n" + b"y" * 5_000 + b",1\n", "has 'yyy"),
        (b"a,b\n1\x00,2\n", "is not a number"),
        (b"a,b\n2024-05-01 12:00:00,2\n", "is not a number; write the time as seconds"),
    ],
)
def test_csv(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    assert words in error_of(path, "a")


def test_a_mark_of_utf8_blank_lines_at_the_end_and_a_field_are_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"\xef\xbb\xbfa,b\n1,2\n3,4\n\n\n")
    assert open_table(path).load(["a"])["a"].tolist() == [1.0, 3.0]
    blocks = open_table(path).blocks
    assert blocks is not None
    assert [one["b"].tolist() for one in blocks(["b"], 2)] == [[2.0, 4.0]]
    assert csv.field_size_limit() == 131_072  # as it was: it is everybody's


def test_a_long_file_is_read_in_parts_like_a_short_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    path.write_text("a,b\n" + "".join(f"{k},{k if k % 7 else 'nan'}\n" for k in range(500)))
    whole = open_table(path).load(["b", "a"])
    monkeypatch.setattr("seaid.log.readers.csv_file._LINES", 64)
    monkeypatch.setattr("seaid.log.readers.csv_file._TEXT", 100)
    parts = open_table(path).load(["b", "a"])
    np.testing.assert_array_equal(parts["b"], whole["b"])
    assert parts["a"].tolist() == list(range(500))


# JSON


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


# NPZ


def npy(shape: str, kind: str = "<f8", data: bytes = b"") -> bytes:
    header = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header = header.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def npz(compression: int = zipfile.ZIP_DEFLATED, /, **arrays: bytes) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", compression) as archive:
        for name, array in arrays.items():
            archive.writestr(f"{name}.npy", array)
    return content.getvalue()


def encrypted() -> bytes:
    content = bytearray(npz(a=npy("(2,)", data=bytes(16))))
    for mark, place in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        content[content.index(mark) + place] |= 1
    return bytes(content)


@pytest.mark.slow  # 1.1 s
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (npz(a=npy("(1000000000,)")), "declares 8 GB of samples"),
        (npz(a=npy("(10**30,)")), "column 'a' cannot be read: "),
        (npz(a=npy("(9" + "9" * 30 + ",)")), "declares 8e+22 GB of samples"),
        (npz(a=npy("(-5,)")), "column 'a' cannot be read: its shape is (-5,)"),
        (npz(a=npy("(2,)", data=bytes(9))), "column 'a' cannot be read: it is truncated"),
        (npz(a=npy("(2")), "column 'a' cannot be read"),
        (npz(a=npy("(2,)", "f8(")), "column 'a' cannot be read"),
        (npz(a=npy("(2,)", "|O", b"\x80\x04K\x01.")), "must be a vector of numbers, found object"),
        (npz(a=npy("(1, 1, 1)", data=bytes(8))), "must be a vector of numbers"),
        (npz(a=b"junk"), "column 'a' cannot be read"),
        (npz(zipfile.ZIP_LZMA, a=npy("(2,)", data=bytes(16))), "that NumPy does not write"),
        (npz(zipfile.ZIP_BZIP2, a=npy("(2,)", data=bytes(16))), "that NumPy does not write"),
        (encrypted(), "column 'a' cannot be read: File"),
        (
            npz(zipfile.ZIP_DEFLATED, **{f"c{k}": b"" for k in range(10_001)}),
            "has 10,001 columns or more",
        ),
        (npz(a=npy("(1, 10001)", data=bytes(8 * 10_001))), "must be a vector of numbers"),
    ],
)
def test_npz(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "log.npz"
    path.write_bytes(content)
    assert words in error_of(path, "a")


def test_npz_in_pieces_declares_no_more_than_fits(arm: Robot, tmp_path: Path) -> None:
    names = ("time_s", *(f"arm.{one}" for one in ("motor_position_rad", "motor_torque_Nm")))
    content = npz(zipfile.ZIP_DEFLATED, **{name: npy("(1000000000,)") for name in names})
    (tmp_path / "log.npz").write_bytes(content)
    with pytest.raises(LogError, match=r"read fewer samples at a time with a smaller chunk"):
        open_long_log(tmp_path / "log.npz", arm, chunk_samples=10**9)
    with pytest.raises(LogError, match="cannot be read: it is truncated"):
        open_long_log(tmp_path / "log.npz", arm)


def test_arrays_of_every_type_of_number_and_order_are_read(tmp_path: Path) -> None:
    values = np.arange(12.0).reshape(4, 3)
    kinds = ("f2", ">f4", "f8", "f16", "i1", ">i4", "u8", "?")
    arrays: dict[str, Any] = {f"k{k}": values[:, 1].astype(kind) for k, kind in enumerate(kinds)}
    arrays |= {
        "rows": values,
        "columns": np.asfortranarray(values),
        "huge": np.array(["1e4000"], "f16"),
    }
    np.savez_compressed(tmp_path / "log.npz", **arrays)
    found = open_table(tmp_path / "log.npz").load([f"k{k}" for k in range(8)] + ["huge"])
    for name in list(arrays)[:7]:
        assert found[name].tolist() == [1.0, 4.0, 7.0, 10.0]
    assert found["k7"].tolist() == [1.0] * 4
    assert found["huge"].tolist() == [np.inf]
    parts = open_table(tmp_path / "log.npz").load(["rows[2]", "columns[2]"])
    assert parts["rows[2]"].tolist() == parts["columns[2]"].tolist() == [2.0, 5.0, 8.0, 11.0]


# HDF5


def test_one_empty_data_set_does_not_hide_the_others(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["a"] = TIME
        file["nothing"] = h5py.Empty("f8")
        file["none"] = np.zeros(0)
        file["text"] = ["x"]
    table = open_table(path)
    assert set(table.names) == {"a", "nothing", "none", "text"}
    np.testing.assert_array_equal(table.load(["a"])["a"], TIME)
    assert table.load(["none"])["none"].tolist() == []
    assert "column 'nothing' must be a vector of numbers" in error_of(path, "nothing")
    assert "column 'text' must be a vector of numbers" in error_of(path, "text")


def test_samples_in_other_files_are_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(np.full(60, 7.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.full(60, 7.0)
    path = tmp_path / "log.h5"
    layout = h5py.VirtualLayout((60,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (60,))
    with h5py.File(path, "w") as file:
        file["own"] = np.ones(60)
        file.create_dataset("external", (60,), "f8", external=[(str(secret), 0, 480)])
        file.create_virtual_dataset("virtual", layout)
        file["link"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "x")
    table = open_table(path)
    assert set(table.names) == {"own", "external", "virtual"}
    for name in ("external", "virtual"):
        assert f"column '{name}' are not in this file" in error_of(path, name)
        assert table.blocks is not None
        with pytest.raises(LogError, match="are not in this file but in others"):
            next(table.blocks([name], 50))


@pytest.mark.slow  # 0.7 s
def test_hdf5_that_declares_too_much(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (10**9,), "f8", chunks=(1000,))
        file.create_dataset("wide", (2, 20_000), "f4")
        file.create_dataset("chunk", (10**8,), "f8", chunks=(10**8,), compression="gzip")
    assert path.stat().st_size < 30_000
    table = open_table(path)
    assert list(table.names) == ["a", "chunk", "wide"]
    assert "declares 8 GB of samples" in error_of(path, "a")
    assert table.blocks is not None
    assert len(next(table.blocks(["a"], 100))["a"]) == 100
    with h5py.File(path, "w") as file:
        for k in range(11):
            file[f"table{k}"] = np.zeros(3, dtype=[(f"c{n}", "f4") for n in range(1_000)])
    assert "columns or more, allowed are 10,000" in error_of(path)


def test_hdf5_in_pieces_reads_no_column_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["a"], file["b"] = np.arange(1000.0), np.arange(999.0)
    rows, get = list[Any](), h5py.Dataset.__getitem__

    def noted(self: Any, key: Any, **more: Any) -> Any:
        rows.append(key)
        return get(self, key, **more)

    monkeypatch.setattr(h5py.Dataset, "__getitem__", noted)
    table = open_table(path)
    assert table.blocks is not None
    assert [len(one["a"]) for one in table.blocks(["a"], 400)] == [400, 400, 200]
    assert all(one.stop - one.start == 400 for one in rows)
    with pytest.raises(LogError, match="columns have different lengths: 'a' 1000, 'b' 999"):
        next(table.blocks(["a", "b"], 400))


def test_hdf5_for_a_full_disk_is_made_in_memory(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    path, soft = tmp_path / "log.h5", resource.getrlimit(resource.RLIMIT_FSIZE)
    path.write_text("old")
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, soft[1]))  # Python ignores its signal
    try:
        with pytest.raises(SeaidError, match=r"cannot write '.*log.h5': File too large"):
            write_log(one_log(), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, soft)
    assert path.read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["log.h5"]


# Parquet


def test_parquet_of_many_types(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    instants = [datetime(2026, 1, 1, tzinfo=UTC), datetime(2026, 1, 2, tzinfo=UTC)]
    good: dict[str, Any] = {
        "decimal": arrow.array([Decimal("1.5"), None]),
        "dictionary": arrow.array([2.5, 2.5]).dictionary_encode(),
        "null": arrow.nulls(2),
        "date": arrow.array([0, 1], arrow.int32()).cast(arrow.date32()),
        "instant": arrow.array(instants),
    }
    bad: dict[str, Any] = {
        "list": arrow.array([[1.0], []]),
        "struct": arrow.array([{"x": 1.0}] * 2),
        "words": arrow.array(["x", "y"]).dictionary_encode(),
        "time": arrow.array([1, 2], arrow.time64("us")),
        "bytes": arrow.array([b"x", b"y"]),
    }
    parquet.write_table(arrow.table(good | bad), path)
    found = open_table(path).load(list(good))
    np.testing.assert_array_equal(found["decimal"], [1.5, np.nan])
    assert found["dictionary"].tolist() == [2.5, 2.5]
    assert np.all(np.isnan(found["null"]))
    assert found["instant"].tolist() == found["date"].tolist() == [0.0, 86_400.0]
    for name in bad:
        assert f"column '{name}' must be a vector of numbers" in error_of(path, name)


def test_instants_of_parquet_in_pieces_go_on(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    stamps = np.datetime64("2026-01-01", "ms") + np.arange(100) * np.timedelta64(10, "ms")
    parquet.write_table(arrow.table({"t": stamps}), path)
    blocks = open_table(path).blocks
    assert blocks is not None
    joined = np.concatenate([one["t"] for one in blocks(["t"], 30)])
    np.testing.assert_allclose(joined, np.arange(100) / 100, atol=1e-12)


def test_parquet_that_declares_too_much_has_no_rows_or_a_name_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.parquet"
    parquet.write_table(arrow.table({"a": np.zeros(1_000_000, dtype=np.int8)}), path)
    monkeypatch.setattr(limits, "MOST_BYTES", 1e6)
    assert "declares 0.008 GB of samples" in error_of(path, "a")
    parquet.write_table(arrow.table({"a": arrow.array([], arrow.float64())}), path)
    blocks = open_table(path).blocks
    assert blocks is not None
    assert [len(one["a"]) for one in blocks(["a"], 50)] == [0]
    two = arrow.Table.from_arrays([arrow.array([1.0])] * 2, names=["a", "a"])
    parquet.write_table(two, path)
    assert "column 'a' exists 2 times" in error_of(path, "a")


# HEBI logs


def hebilog(samples: int = 3) -> bytes:
    """Return what stands around the messages of a HEBI log of two modules."""
    address = struct.pack(">II", 0x4119, 1)
    message = address + struct.pack(">I", 10) + bytes(8) + b"x" * 10
    return (
        struct.pack(">HHI", 0x73B1, 2, 2)
        + 2 * address
        + struct.pack(">HHQ", 0x73B1, 4, 5)
        + samples * (struct.pack(">HH", 0x73B1, 1) + message)
    )


def crash(path: str) -> Answer:
    os.abort()


def test_a_hebi_log_that_is_cut_off_is_said_to_be(tmp_path: Path) -> None:
    pytest.importorskip("hebi")
    path, whole = tmp_path / "log.hebilog", hebilog()
    for cut in (len(whole) - 1, len(whole) - 33, 60, 40, 30, 20, 10):
        path.write_bytes(whole[:cut])
        assert "is cut off: its last record" in error_of(path)
        assert f"the file has {cut} bytes" in error_of(path)
    path.write_bytes(whole[:36] + bytes([0x74]) + whole[37:])
    assert "HEBI's reader: " in error_of(path)


def test_bytes_between_the_records_of_a_hebi_log_are_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hebi_log, "check_installed", lambda *_: None)
    monkeypatch.setattr(hebi_log, "run_in_child", lambda *_, **__: (2, {}))
    path, whole = tmp_path / "log.hebilog", hebilog()
    for place in (24, 36, 70, len(whole)):  # behind the modules, the start, a sample, all
        more = whole[:place] + b"\0\0\0\x01\x73\xb1\xff\xfe" + whole[place:]
        path.write_bytes(more)
        assert len(open_table(path).names) == 36
        if place < len(whole):
            for cut in (1, 20, 33):
                path.write_bytes(more[:-cut])
                assert f"the file has {len(more) - cut} bytes" in error_of(path)


@pytest.mark.hebi
def test_a_hebi_log_with_bytes_between_its_records_is_read_whole(tmp_path: Path) -> None:
    path, whole = tmp_path / "log.hebilog", HEBI_X5.read_bytes()
    place = whole.index(b"\x73\xb1\x00\x04")
    path.write_bytes(whole[:place] + bytes(8) + whole[place:])
    columns = ["motor_position[0]", "time[0]"]
    for name, values in open_table(HEBI_X5).load(columns).items():
        np.testing.assert_array_equal(open_table(path).load(columns)[name], values)


@pytest.mark.skipif(
    not MEASURED.is_file(), reason=f"measured logs are not part of the project: no file {MEASURED}"
)
def test_a_measured_hebi_log_is_read_whole_and_said_to_be_cut_off(tmp_path: Path) -> None:
    pytest.importorskip("hebi")
    table = open_table(MEASURED)
    assert len(table.names) == 36
    assert len(table.load(["motor_position[1]", "time[0]"])["time[0]"]) == 5_337
    path, whole = tmp_path / "log.hebilog", MEASURED.read_bytes()
    for cut in np.random.default_rng(0).integers(100, len(whole), 20):
        path.write_bytes(whole[:cut])
        assert "is cut off: its last record" in error_of(path)


def test_a_crash_of_hebis_reader_is_a_log_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("hebi")
    monkeypatch.setattr(hebi_log, "read_fields", crash)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    path = tmp_path / "log.hebilog"
    path.write_bytes(hebilog())
    text = error_of(path)
    assert text.startswith(f"'{path}' is not a HEBI log, or a damaged one: HEBI's reader: ")
    assert text.endswith("the process that read it crashed (SIGABRT)")
    assert os.listdir(tmp_path) == ["log.hebilog"]


def greedy(path: str) -> Answer:
    return None, {"a": np.ones(10**12)}


@pytest.mark.slow  # 0.9 s
def test_a_bag_that_asks_for_all_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rosbags")
    monkeypatch.setattr(ros_bag, "bag_columns", greedy)
    path = tmp_path / "log.mcap"
    path.write_bytes(b"compressed")
    text = "is not a ROS bag, or a damaged one: it requests more memory than is available"
    assert error_of(path) == f"'{path}' {text}"


# All of them


def test_what_fits_depends_on_the_memory_and_on_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.npz"
    path.write_bytes(bytes(1000))
    limits.check_memory(path, 1e8)
    with pytest.raises(LogError, match="declares 2 GB of samples, more than 20 times its size"):
        limits.check_memory(path, 2e9)
    monkeypatch.setattr(limits, "free_memory", lambda: 1e8)
    with pytest.raises(LogError, match=r"takes 0\.1 GB of memory, too much for the 0\.1 GB"):
        limits.check_memory(path, 1e8)


def test_free_memory_is_also_what_the_limit_of_the_process_leaves() -> None:
    resource = pytest.importorskip("resource")
    old = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (60 * 10**9, old[1]))
    try:
        assert free_memory() < 60e9
    finally:
        resource.setrlimit(resource.RLIMIT_AS, old)


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


@pytest.mark.parametrize("name", ["log.csv", "log.npz", "log.h5", "log.parquet", "log.json"])
def test_damaged_bytes_of_any_kind_are_read_or_refused(
    arm: Robot, tmp_path: Path, name: str
) -> None:
    path, rng = tmp_path / name, Random(name)
    if path.suffix == ".json":
        data = {"time_s": one_log().time, **one_log().columns()}
        path.write_text(json.dumps({key: values[:60].tolist() for key, values in data.items()}))
    else:
        write_log(one_log(), path)
    whole = path.read_bytes()
    for _ in range(60):
        path.write_bytes(damaged_bytes(rng, whole))
        with suppress(SeaidError):
            read_log(path, arm)
