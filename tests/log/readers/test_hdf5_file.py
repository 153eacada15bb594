"""HDF5: data sets of this file alone, in pieces, no more than fits."""

import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from seaid.errors import LogError, SeaidError
from seaid.log.readers.opening import open_table
from seaid.log.reading import write_log
from tests.log.readers.files import TIME, error_of, one_log


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
