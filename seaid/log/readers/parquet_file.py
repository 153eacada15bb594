"""Parquet, read and written with pyarrow (`pip install 'seaid[parquet]'`)."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid._files import whole_file
from seaid.errors import LogError, shortened
from seaid.log.readers.table import (
    Blocks,
    Table,
    check_columns,
    check_memory,
    damaged,
    in_pieces,
    no_numbers,
    optional,
)

_KIND = "a Parquet file"


def open_parquet(path: Path) -> Table:
    """Return a Parquet file's columns; nulls are NaN, timestamps count [s] from the first."""
    parquet = optional("pyarrow.parquet", "parquet", path)
    arrow = optional("pyarrow", "parquet", path)
    with damaged(path, _KIND), parquet.ParquetFile(path) as file:
        check_columns(path, len(file.schema_arrow))
        names = list(file.schema_arrow.names)

    def blocks(wanted: list[str], size: int) -> Blocks:
        starts: dict[str, Any] = {}
        with damaged(path, _KIND), parquet.ParquetFile(path) as file:
            _check_kinds(path, file, wanted, arrow.types)
            rows = min(size, max(file.metadata.num_rows, 1))
            check_memory(path, 8.0 * rows * len(wanted), pieces=size < sys.maxsize)
            batch = None
            for batch in file.iter_batches(rows, columns=wanted):
                yield {name: _samples(name, batch[name], starts, arrow.types) for name in wanted}
            # A file without rows has no batch, and a reader in pieces needs the names of one.
            if batch is None:
                yield {name: np.zeros(0) for name in wanted}

    return in_pieces(names, blocks)


def write_parquet(path: Path, data: Mapping[str, Array]) -> None:
    """Write columns atomically. Raises LogError if pyarrow is not installed."""
    parquet = optional("pyarrow.parquet", "parquet", path)
    arrow = optional("pyarrow", "parquet", path)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        parquet.write_table(arrow.table(dict(data)), file)


def _check_kinds(path: Path, file: Any, wanted: Sequence[str], types: Any) -> None:
    """Raise LogError for columns that are not numbers, booleans or timestamps."""
    numbers = ("integer", "floating", "boolean", "timestamp", "date", "decimal", "null")
    schema = file.schema_arrow  # every access builds a new schema
    for name in wanted:
        places = schema.get_all_field_indices(name)
        if len(places) != 1:
            raise LogError(f"'{path}': column '{shortened(name)}' exists {len(places)} times")
        kind = schema.field(places[0]).type
        inner = kind.value_type if types.is_dictionary(kind) else kind
        if not any(getattr(types, f"is_{number}")(inner) for number in numbers):
            raise no_numbers(path, name, kind, (file.metadata.num_rows,))


def _samples(name: str, column: Any, starts: dict[str, Any], types: Any) -> Array:
    """Return a column as numbers; timestamps since the first one, which `starts` keeps."""
    if types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if not (types.is_timestamp(column.type) or types.is_date(column.type)):
        column = column.cast("float64", safe=False)  # integers may be rounded
    values = column.to_numpy(zero_copy_only=False)
    if values.dtype.kind == "M":
        # Since the first of all pieces, in integers: float64 has no nanoseconds since 1970.
        values = (values - starts.setdefault(name, values[:1])) / np.timedelta64(1, "s")
    return np.asarray(values)
