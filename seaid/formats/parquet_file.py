"""Parquet, read and written with pyarrow (`pip install 'seaid[parquet]'`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError
from seaid.files import whole_file
from seaid.formats.table import Block, Blocks, Table, optional, samples


def open_parquet(path: Path) -> Table:
    """Return the columns of a Parquet file; nulls are NaN, instants are seconds since the first.

    Raises LogError for what is no such file, and where pyarrow is not installed.
    """
    parquet = optional("pyarrow.parquet", "parquet", path)
    try:
        with parquet.ParquetFile(path) as file:
            names = list(file.schema_arrow.names)
    except (OSError, ValueError) as problem:
        raise _damaged(path, problem) from None

    def load(wanted: list[str]) -> Block:
        try:
            with parquet.ParquetFile(path) as file:
                table = file.read(columns=wanted)
        except (OSError, ValueError) as problem:
            raise _damaged(path, problem) from None
        return {name: _samples(path, name, table[name]) for name in wanted}

    def blocks(wanted: list[str], size: int) -> Blocks:
        try:
            with parquet.ParquetFile(path) as file:
                for batch in file.iter_batches(size, columns=wanted):
                    yield {name: _samples(path, name, batch[name]) for name in wanted}
        except (OSError, ValueError) as problem:
            raise _damaged(path, problem) from None

    return Table(names, load, blocks)


def write_parquet(path: Path, data: Mapping[str, Array]) -> None:
    """Write columns, whole or not at all. Raises LogError where pyarrow is not installed."""
    parquet = optional("pyarrow.parquet", "parquet", path)
    arrow = optional("pyarrow", "parquet", path)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        parquet.write_table(arrow.table(dict(data)), file)


def _samples(path: Path, name: str, column: Any) -> Array:
    values = column.to_numpy(zero_copy_only=False)
    if values.dtype.kind == "M":
        since: Array = (values - values[:1]) / np.timedelta64(1, "s")
        return since
    return samples(path, name, values)


def _damaged(path: Path, problem: Exception) -> LogError:
    reason = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
    return LogError(f"'{path}' is not a Parquet file, or a damaged one: {reason}")
