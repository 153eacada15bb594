"""Parquet: types, instants, pieces, and what declares too much."""

from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

import seaid.log.readers.table as limits
from seaid.log.readers.opening import open_table
from tests.log.readers.files import error_of


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


def test_parquet_has_nulls_as_nan_and_instants_as_seconds(tmp_path: Path) -> None:
    stamps = np.datetime64("2026-01-15T10:28:10", "ns") + np.arange(3) * np.timedelta64(5, "ms")
    data = {"stamp": stamps, "q": arrow.array([1, None, 3]), "on": arrow.array([True, False, True])}
    parquet.write_table(arrow.table(data), tmp_path / "log.parquet")
    found = open_table(tmp_path / "log.parquet").load(["stamp", "q", "on"])
    np.testing.assert_allclose(found["stamp"], [0.0, 0.005, 0.01], rtol=1e-12)
    np.testing.assert_array_equal(found["q"], [1.0, np.nan, 3.0])
    assert found["on"].tolist() == [1.0, 0.0, 1.0]
