"""Archives of NumPy: what they declare, and every type of number."""

import io
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.log.long_log import open_long_log
from seaid.log.readers.opening import open_table
from seaid.robot.robot import Robot
from tests.log.readers.files import error_of


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


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros((60, 2)), "must be a vector of numbers, found float64 of shape (60, 2)"),
        (np.array("text"), "must be a vector of numbers, found <U4 of shape ()"),
        (np.zeros(60, dtype=complex), "must be a vector of numbers, found complex128"),
        (np.array([{}], dtype=object), "must be a vector of numbers, found object"),
    ],
)
def test_npz_with_a_bad_column_is_named(tmp_path: Path, values: Any, words: str) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, time=np.zeros(60), a=values, note=np.array("not asked for"))
    text = error_of(path, "time", "a")
    assert text.startswith(f"'{path}': ")
    assert words in text


def test_npz_that_is_damaged_inside_is_named(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez_compressed(path, a=np.sin(np.arange(60.0)))
    content = bytearray(path.read_bytes())
    content[150:250] = bytes(100)
    path.write_bytes(content)
    assert "column 'a' cannot be read" in error_of(path, "a")
