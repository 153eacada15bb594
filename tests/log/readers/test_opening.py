"""Files of every format: the same log, the same columns, or what is no such file."""

from __future__ import annotations

import json
import os
import re
import struct
import sys
import zipfile
from datetime import UTC, datetime
from decimal import Decimal
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import io

import seaid.log.readers.table as limits
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import Log, open_long_log, read_log
from seaid.log.channels import SENSORS
from seaid.log.log import LARGEST
from seaid.log.readers.opening import READERS, open_table
from seaid.log.readers.table import check_memory, free_memory
from seaid.robot import Robot
from tests.log.readers.files import FORMATS, TIME, error_of, loaded, one_log, save, write
from tests.measured import LOGS
from tests.one_joint import one_joint
from tests.representatives import quick_first

numbers = arrays(np.float64, (50, 3), elements=st.floats(-LARGEST, LARGEST))


@pytest.mark.parametrize("suffix", [*FORMATS, ".CSV"])
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


# Columns that formats have beside those of seaid


Q: Array = np.random.default_rng(0).normal(size=(4, 3))
STAMPS = np.datetime64("2026-01-15T10:28:10", "ns") + np.arange(3) * np.timedelta64(500, "ms")
ODD = {
    "decimal": arrow.array([Decimal("1.5"), None]),
    "dictionary": arrow.array([2.5, 2.5]).dictionary_encode(),
    "null": arrow.nulls(2),
    "date": arrow.array([0, 1], arrow.int32()).cast(arrow.date32()),
    "instant": [datetime(2026, 1, 1, tzinfo=UTC), datetime(2026, 1, 2, tzinfo=UTC)],
}
RECORDS = [{"t": 0.0, "motor": {"i": [1, 2]}}, {"t": 1.0}]
BEYOND = '{"a": [1, -1' + 400 * "0" + ', null], "rows": 1' + 400 * "0" + "}"
COLUMNS: tuple[tuple[str, Any, dict[str, Any]], ...] = (
    ("log.npz", {"t": TIME[:4], "q": Q}, {"q[2]": Q[:, 2].tolist(), "t": TIME[:4].tolist()}),
    ("log.h5", {"state/q": Q, "state/t": TIME[:4]}, {"state/q[2]": Q[:, 2].tolist()}),
    ("log.json", {"q": Q.tolist(), "t": TIME[:4].tolist()}, {"q[2]": Q[:, 2].tolist()}),
    ("log.npz", {"q": np.asfortranarray(Q)}, {"q[1]": Q[:, 1].tolist()}),
    *(
        ("log.npz", {"a": np.array([1, 4], kind)}, {"a": [1.0, 4.0]})
        for kind in ("f2", ">f4", "f8", "f16", "i1", ">i4", "u8")
    ),
    ("log.npz", {"a": np.array([True, False])}, {"a": [1.0, 0.0]}),
    ("log.npz", {"a": np.array(["1e4000"], "f16")}, {"a": [np.inf]}),
    ("log.h5", {"a": np.array([(1.0, 2)], [("x", "f8"), ("y", "i4")])}, {"a/y": [2.0]}),
    ("log.h5", {"a": TIME[:2], "none": h5py.Empty("f8"), "b": ["x"]}, {"a": TIME[:2].tolist()}),
    ("log.h5", {"empty": np.zeros(0)}, {"empty": []}),
    ("log.json", BEYOND, {"a": [1.0, -np.inf, None], "rows": 3 * [np.inf]}),
    (
        "log.json",
        {"kp": 100, "name": "x", "entries": RECORDS},
        {"t": [0.0, 1.0], "motor.i[0]": [1.0, None], "motor.i[1]": [2.0, None], "kp": [100.0] * 2},
    ),
    (
        "log.parquet",
        ODD,
        {
            "decimal": [1.5, None],
            "dictionary": [2.5, 2.5],
            "null": [None, None],
            "date": [0.0, 86_400.0],
            "instant": [0.0, 86_400.0],
        },
    ),
    (
        "log.parquet",
        {"stamp": STAMPS, "q": [1, None, 3], "on": [True, False, True]},
        {"stamp": [0.0, 0.5, 1.0], "q": [1.0, None, 3.0], "on": [1.0, 0.0, 1.0]},
    ),
)


@pytest.mark.parametrize(
    ("name", "content", "columns"), COLUMNS, ids=[f"{name} {[*of]}" for name, _, of in COLUMNS]
)
def test_columns_of_any_type_and_shape_are_numbers(
    tmp_path: Path, name: str, content: Any, columns: dict[str, list[float | None]]
) -> None:
    """Rows of arrays have their place in brackets, and what is missing is NaN."""
    path = save(tmp_path / name, content)
    assert loaded(path, columns) == columns
    assert columns.keys() <= {*open_table(path).names}


@pytest.mark.slow  # 2.4 s, a process each
@pytest.mark.parametrize("version", ["5", "4", "7.3"])
def test_a_matlab_file_is_read(tmp_path: Path, version: str) -> None:
    """Versions 4 and 5, and 7.3, which is HDF5 behind a head, give the same columns."""
    path = tmp_path / "run.mat"
    if version == "7.3":
        with h5py.File(path, "w", userblock_size=512) as file:
            file["t"] = TIME[None, :4]
            file["log/q"] = Q.T
            file["#refs#/a"] = 1.0
        content = path.read_bytes()
        head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
        path.write_bytes(head.ljust(512, b"\0") + content[512:])
    elif version == "5":
        io.savemat(path, {"t": TIME[:4], "log": {"q": Q}, "name": "a text", "n": 3})
    else:
        io.savemat(path, {"t": TIME[:4, None], "log": Q}, format="4")
    names = open_table(path).names
    q = "log" if version == "4" else "log.q"
    assert set(names) == {"t", f"{q}[0]", f"{q}[1]", f"{q}[2]"}
    np.testing.assert_array_equal(open_table(path).load([f"{q}[1]"])[f"{q}[1]"], Q[:, 1])


@pytest.mark.hebi
def test_a_hebi_log_with_bytes_between_its_records_is_read_whole(tmp_path: Path) -> None:
    """HEBI's own reader passes over them, too."""
    measured = LOGS / "hebi_x5_unloaded" / "exampleLog.hebilog"
    path, whole = tmp_path / "log.hebilog", measured.read_bytes()
    place = whole.index(b"\x73\xb1\x00\x04")
    path.write_bytes(whole[:place] + bytes(8) + whole[place:])
    for name, values in open_table(measured).load(["motor_position[0]", "time[0]"]).items():
        np.testing.assert_array_equal(open_table(path).load([name])[name], values)


# What is refused


def npy(shape: str, kind: str = "<f8", data: bytes = b"") -> bytes:
    header = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header = header.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def npz(compression: int = zipfile.ZIP_DEFLATED, /, **arrays: bytes) -> bytes:
    content = BytesIO()
    with zipfile.ZipFile(content, "w", compression) as archive:
        for name, array in arrays.items():
            archive.writestr(f"{name}.npy", array)
    return content.getvalue()


def encrypted() -> bytes:
    content = bytearray(npz(a=npy("(2,)", data=bytes(16))))
    for mark, place in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        content[content.index(mark) + place] |= 1
    return bytes(content)


NOT_NUMBERS = "column 'a' must be a vector of numbers, found"
PACKED = npz(a=npy("(60,)", data=np.sin(np.arange(60.0)).tobytes()))
REFUSED: tuple[tuple[str, Any, str], ...] = (
    ("log.npz", npz(a=npy("(1000000000,)")), "declares 8 GB of samples"),
    ("log.npz", npz(a=npy("(10**30,)")), "column 'a' cannot be read: "),
    ("log.npz", npz(a=npy("(-5,)")), "column 'a' cannot be read: its shape is (-5,)"),
    ("log.npz", npz(a=npy("(2,)", data=bytes(9))), "column 'a' cannot be read: it is truncated"),
    ("log.npz", npz(a=npy("(2")), "column 'a' cannot be read"),
    ("log.npz", npz(a=npy("(2,)", "f8(")), "column 'a' cannot be read"),
    ("log.npz", npz(a=npy("(1, 1, 1)", data=bytes(8))), "must be a vector of numbers"),
    ("log.npz", npz(a=b"junk"), "column 'a' cannot be read"),
    ("log.npz", npz(zipfile.ZIP_LZMA, a=npy("(2,)", data=bytes(16))), "that NumPy does not write"),
    ("log.npz", encrypted(), "column 'a' cannot be read: File"),
    ("log.npz", PACKED[:150] + bytes(100) + PACKED[250:], "column 'a' cannot be read"),
    (
        "log.npz",
        npz(zipfile.ZIP_DEFLATED, **{f"c{k}": b"" for k in range(10_001)}),
        "has 10,001 columns or more",
    ),
    ("log.npz", npz(a=npy("(1, 10001)", data=bytes(8 * 10_001))), "must be a vector of numbers"),
    ("log.npz", {"a": np.zeros((60, 2))}, f"{NOT_NUMBERS} float64 of shape (60, 2)"),
    ("log.npz", {"a": np.array("text")}, f"{NOT_NUMBERS} <U4 of shape ()"),
    ("log.npz", {"a": np.array([{}], dtype=object)}, f"{NOT_NUMBERS} object"),
    *((f"log.{end}", {"a": ["x", "y"]}, NOT_NUMBERS) for end in ("npz", "h5", "json", "parquet")),
    ("log.h5", {"a": h5py.Empty("f8")}, NOT_NUMBERS),
    ("log.json", "[" * 100_000, "is not valid JSON, or cut off"),
    ("log.json", '{"a": ' * 900 + "1" + "}" * 900, "are more than 20 levels deep"),
    ("log.json", '[{"a": ' + "[" * 30 + "1" + "]" * 30 + "}]", "are more than 20 levels deep"),
    ("log.json", '{"a": [' + "1" * 5_000 + "]}", "is not valid JSON, or cut off"),
    ("log.json", '{"a": [1, "x"]}', "must be a vector of numbers, found str"),
    ("log.json", '{"a": [1, [2]]}', "must be a vector of numbers, found list"),
    ("log.json", '{"\\ud800": [1]}', "is not Unicode text"),
    (
        "log.json",
        json.dumps([{f"c{k}": 1 for k in range(20_000)}]),
        "columns or more, allowed are 10,000",
    ),
    ("log.json", json.dumps({"a": [[1] * 20_000]}), "columns or more, allowed are 10,000"),
    ("log.json", json.dumps({"a": [1], **{f"c{k}": 1 for k in range(20_000)}}), "columns or more"),
    ("log.json", b"junk", "is not valid JSON, or cut off"),
    *(
        ("log.json", content, "has no columns; a JSON log is a list of records")
        for content in ("[]", "{}", "3", '"text"', '{"a": {"b": 1}}', "[1, 2]")
    ),
    *(
        ("log.parquet", {"a": values}, NOT_NUMBERS)
        for values in (
            [[1.0], []],
            [{"x": 1.0}] * 2,
            arrow.array(["x", "y"]).dictionary_encode(),
            arrow.array([1, 2], arrow.time64("us")),
            [b"x", b"y"],
        )
    ),
    (
        "log.parquet",
        arrow.Table.from_arrays([arrow.array([1.0])] * 2, names=["a", "a"]),
        "column 'a' exists 2 times",
    ),
    ("log.out", b"PK", f"cannot read '.out' logs; allowed: {', '.join(READERS)}"),
    ("run.xlsx", b"PK", "cannot read '.xlsx' logs; save the sheet as CSV in UTF-8"),
    ("run.csv.gz", b"PK", "cannot read '.gz' logs; unpack it first"),
    ("run.pkl", b"PK", "it could run any code; write it as .npz or .parquet"),
    ("run.tdms", b"PK", "cannot read '.tdms' logs; export it as CSV, .parquet or .h5"),
)


@pytest.mark.parametrize(
    ("name", "content", "words"), REFUSED, ids=[f"{name} {words}" for name, _, words in REFUSED]
)
def test_what_is_no_log_is_named_with_its_column(
    tmp_path: Path, name: str, content: Any, words: str
) -> None:
    path = save(tmp_path / name, content)
    text = error_of(path, "a")
    assert text.startswith(f"'{path}'")
    assert words in text


KINDS = {
    **{".npz": "a NumPy archive (.npz)", ".parquet": "a Parquet file", ".h5": "an HDF5 file"},
    **{".mat": "a MATLAB file", ".db3": "a ROS bag", ".mcap": "a ROS bag", ".bag": "a ROS bag"},
    ".hebilog": "a HEBI log",
}


@pytest.mark.parametrize(
    "ending", [pytest.param(x, marks=pytest.mark.hebi if x == ".hebilog" else ()) for x in KINDS]
)
@pytest.mark.parametrize(
    "content",  # a process of its own for each bag
    quick_first([b"junk" * 100, b"", bytes(range(256)) * 20]),
)
def test_what_is_no_file_of_its_ending_is_named(
    tmp_path: Path, ending: str, content: bytes
) -> None:
    path = save(tmp_path / f"log{ending}", content)
    assert error_of(path).startswith(f"'{path}' is not {KINDS[ending]}, or a damaged one")


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_file_that_is_cut_off_is_named(
    arm: Robot, tmp_path: Path, suffix: str, share: float
) -> None:
    """A part of a file is never taken for a log."""
    path = tmp_path / f"log{suffix}"
    write(one_log(), path)
    content = path.read_bytes()[: int(share * path.stat().st_size)]
    path.write_bytes(content.rpartition(b",")[0] if suffix == ".csv" else content)
    with pytest.raises(LogError, match=re.escape(f"'{path}'")):
        read_log(path, arm)


@pytest.mark.parametrize(
    ("module", "ending", "extra"),
    [
        ("pyarrow.parquet", "parquet", "parquet"),
        ("h5py", "h5", "hdf5"),
        ("rosbags.highlevel", "db3", "ros"),
        ("hebi", "hebilog", "hebi"),
    ],
)
def test_missing_package_names_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, ending: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    text = error_of(save(tmp_path / f"log.{ending}", b""))
    assert f"need the package {module.split('.')[0]}, which is not installed" in text
    assert text.endswith(f"get it with pip install 'seaid[{extra}]'")


def test_files_that_are_not_there_are_named(tmp_path: Path) -> None:
    """A path is shown with the working folder, and with a file of a similar name."""
    path = tmp_path / "no.csv"
    missing = f"no log file at '{path}' (working folder {Path.cwd()})"
    assert error_of(path) == missing
    (tmp_path / "now.csv").write_text("")
    assert error_of(path) == f"{missing}; did you mean 'now.csv'?"


# What is read in pieces, and what is too large


def test_json_logs_cannot_be_read_in_pieces(arm: Robot, tmp_path: Path) -> None:
    write(one_log(), tmp_path / "log.json")
    with pytest.raises(LogError, match=r"'\.json' logs cannot be read in pieces; allowed: \.csv"):
        open_long_log(tmp_path / "log.json", arm)


def test_npz_in_pieces_declares_no_more_than_fits(arm: Robot, tmp_path: Path) -> None:
    names = ("time_s", *(f"arm.{one}" for one in ("motor_position_rad", "motor_torque_Nm")))
    content = npz(zipfile.ZIP_DEFLATED, **{name: npy("(1000000000,)") for name in names})
    (tmp_path / "log.npz").write_bytes(content)
    with pytest.raises(LogError, match=r"read fewer samples at a time with a smaller chunk"):
        open_long_log(tmp_path / "log.npz", arm, chunk_samples=10**9)
    with pytest.raises(LogError, match="cannot be read: it is truncated"):
        open_long_log(tmp_path / "log.npz", arm)


def test_instants_of_parquet_in_pieces_go_on(tmp_path: Path) -> None:
    """The second piece does not begin at zero again; a file without rows has one piece of none."""
    stamps = np.datetime64("2026-01-01", "ms") + np.arange(100) * np.timedelta64(10, "ms")
    for values, expected in ((stamps, np.arange(100) / 100), (np.zeros(0), np.zeros(0))):
        blocks = open_table(save(tmp_path / "log.parquet", {"t": values})).blocks
        assert blocks is not None
        joined = np.concatenate([block["t"] for block in blocks(["t"], 30)])
        np.testing.assert_allclose(joined, expected, atol=1e-12)


def test_samples_in_other_files_are_not_read(tmp_path: Path) -> None:
    """No file can show what stands in another one, such as a password."""
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
    """Room that was never written is refused as a whole, and read in pieces."""
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
    """Each read is of the samples of its piece."""
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
    assert [one.stop - one.start for one in rows] == [400, 400, 200]
    with pytest.raises(LogError, match="columns have different lengths: 'a' 1000, 'b' 999"):
        next(table.blocks(["a", "b"], 400))


def test_what_fits_depends_on_the_memory_and_on_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Much more than the size of the file is a lie, and more than is free does not fit."""
    assert 1e6 < free_memory() < 1e14
    path = save(tmp_path / "log.npz", bytes(1000))
    check_memory(path, 1e8)
    with pytest.raises(LogError, match="declares 2 GB of samples, more than 20 times its size"):
        check_memory(path, 2e9)
    monkeypatch.setattr(limits, "free_memory", lambda: 1e8)
    with pytest.raises(LogError, match=r"takes 0\.1 GB of memory, too much for the 0\.1 GB"):
        check_memory(path, 1e8)
    monkeypatch.setattr(limits, "MOST_BYTES", 1e6)
    path = save(tmp_path / "log.parquet", {"a": np.zeros(1_000_000, dtype=np.int8)})
    assert "declares 0.008 GB of samples" in error_of(path, "a")


def test_free_memory_is_also_what_the_limit_of_the_process_leaves() -> None:
    resource = pytest.importorskip("resource")
    old = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (60 * 10**9, old[1]))
    try:
        assert free_memory() < 60e9
    finally:
        resource.setrlimit(resource.RLIMIT_AS, old)
