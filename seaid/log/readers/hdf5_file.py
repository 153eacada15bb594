"""HDF5, read and written with h5py (`pip install 'seaid[hdf5]'`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

from seaid._arrays import Array
from seaid._files import whole_file
from seaid.errors import LogError, shortened
from seaid.log.readers.table import (
    Block,
    Blocks,
    Table,
    as_floats,
    check_columns,
    check_lengths,
    check_memory,
    damaged,
    is_number,
    no_numbers,
    optional,
    part_of,
    with_parts,
)

_KIND = "an HDF5 file"


def open_hdf5(path: Path) -> Table:
    """Return the datasets of an HDF5 file as columns, named by their path: "elbow/position".

    Columns of a dataset of two dimensions are "name[0]", "name[1]", ..., those of a table
    "name/field". Raises LogError for an invalid file, and if h5py is not installed. Datasets with
    samples in other files (external, virtual) are refused; links to other files are not followed.
    """
    h5py = optional("h5py", "hdf5", path)
    names: list[str] = []

    def visit(name: str | bytes, item: Any) -> None:
        if isinstance(name, bytes):  # not in UTF-8: listed, but cannot be loaded
            name = name.decode("utf-8", "replace")
        if isinstance(item, h5py.Dataset):
            names.extend(_columns_of(name, item))
            check_columns(path, len(names))

    with damaged(path, _KIND), h5py.File(path, "r") as file:
        file.visititems(visit)

    def load(wanted: list[str]) -> Block:
        with damaged(path, _KIND), h5py.File(path, "r") as file:
            columns = {name: _Column(path, file, name) for name in wanted}
            check_memory(path, sum(map(_Column.size, columns.values())))
            return {name: column.read(slice(None)) for name, column in columns.items()}

    def blocks(wanted: list[str], size: int) -> Blocks:
        with damaged(path, _KIND), h5py.File(path, "r") as file:
            columns = {name: _Column(path, file, name) for name in wanted}
            check_lengths(path, {name: column.length for name, column in columns.items()})
            total = columns[wanted[0]].length
            check_memory(
                path, sum(column.size(min(size, total)) for column in columns.values()), pieces=True
            )
            for start in range(0, max(total, 1), size):
                yield {name: x.read(slice(start, start + size)) for name, x in columns.items()}

    return Table(names, load, blocks)


def write_hdf5(path: Path, data: Mapping[str, Array]) -> None:
    """Write columns atomically. Raises LogError if h5py is not installed.

    The file is composed in memory, because h5py aborts the process on a full disk.
    """
    h5py = optional("h5py", "hdf5", path)
    content = BytesIO()
    with h5py.File(content, "w") as file:
        for name, values in data.items():
            file.create_dataset(name, data=values)
    with whole_file(path) as temporary:
        temporary.write_bytes(content.getvalue())


def _columns_of(name: str, data: Any) -> list[str]:
    """Return the columns of a dataset; its name only for an unreadable type or shape."""
    try:
        fields, shape = data.dtype.names, data.shape
    except (TypeError, ValueError, RuntimeError, OSError):
        return [name]
    return [f"{name}/{field}" for field in fields] if fields else with_parts(name, shape)


def _place_of(file: Any, name: str) -> tuple[str, int | None, str | None]:
    """Return the dataset of a column, and the index or the field in it."""
    if name in file:
        return name, None, None
    base, index = part_of(name)
    if index is not None:
        return base, index, None
    base, _, field = name.rpartition("/")
    return base, None, field


class _Column:
    """A column of an open file: a dataset, a column of a dataset, or a field of a table."""

    def __init__(self, path: Path, file: Any, name: str) -> None:
        self.path, self.name = path, name
        with damaged(path, _KIND, name):
            base, self.index, self.field = _place_of(file, name)
            self.data = file[base]
            if self.data.is_virtual or self.data.external:
                raise LogError(
                    f"'{path}': the samples of column '{shortened(name)}' are not in this file but "
                    "in others, which are not read; copy them into it"
                )
            kind, shape = self.data.dtype, self.data.shape
            kind = kind if self.field is None else kind[self.field]
            # A field of numbers has no dimensions of its own; a column of a matrix needs two.
            flat = 1 if self.index is None else 2
            if shape is None or len(shape) != flat or kind.shape or not is_number(kind):
                raise no_numbers(path, name, kind, shape)
            self.length, self.width = int(shape[0]), max(kind.itemsize, 8)

    def size(self, rows: int | None = None) -> float:
        """Return the largest number of bytes in memory while reading this many samples, or all."""
        rows = self.length if rows is None else rows
        # HDF5 decompresses whole chunks, also for a single sample.
        chunk = math.prod(self.data.chunks or (1,)) * self.data.dtype.itemsize
        return float(max(rows * self.width, chunk))

    def read(self, rows: slice) -> Array:
        """Return samples as numbers."""
        with damaged(self.path, _KIND, self.name):
            if self.field is not None:
                return as_floats(self.data.fields(self.field)[rows])
            return as_floats(self.data[rows] if self.index is None else self.data[rows, self.index])
