"""NumPy files: archives (.npz), and single arrays (.npy), with one column or several each.

A column is an array (T,), or "name[i]" of an array (T, k).
"""

from __future__ import annotations

import math
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from seaid.errors import LogError
from seaid.log.readers.table import (
    Arrays,
    Refused,
    Table,
    check_columns,
    check_memory,
    damaged,
    table_of_arrays,
)

_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compressions that NumPy writes; readers of others use unlimited memory."""


_FEWEST_SAMPLES, _LONGER = 1000, 4
"""A matrix with so many columns, and so many times more than it has rows, has its samples in
columns: shorter logs of so many channels without names are not known."""


def open_npz(path: Path) -> Table:
    """Return the columns of a NumPy archive. Raises LogError for an invalid file."""

    @contextmanager
    def opened() -> Iterator[Arrays]:
        with zipfile.ZipFile(path) as archive, ExitStack() as stack:
            names = archive.namelist()
            check_columns(path, len(names))
            yield {x.removesuffix(".npy"): _member(path, archive, x, stack) for x in names}

    return table_of_arrays(path, "a NumPy archive (.npz)", opened)


def open_npy(path: Path) -> Table:
    """Return the columns of one NumPy array, which has the name of its file."""

    @contextmanager
    def opened() -> Iterator[Arrays]:
        with path.open("rb") as file:
            yield {path.stem: _Stored(path, file)}

    return table_of_arrays(path, "a NumPy array (.npy)", opened)


def _member(path: Path, archive: zipfile.ZipFile, name: str, stack: ExitStack) -> Any:
    """Return an array of an archive; a damaged one raises when it is wanted."""
    try:
        with damaged(path, "", name.removesuffix(".npy")):
            if archive.getinfo(name).compress_type not in _COMPRESSIONS:
                raise ValueError("it has a compression that NumPy does not write")
            return _Stored(path, stack.enter_context(archive.open(name)))
    except LogError as problem:
        return Refused(problem)


class _Stored:
    """An array in a file, whose rows are read one after the other, with the type of its file.

    The samples of a matrix are in its rows. One whose numbers are in the order of Fortran then
    cannot be read row by row, and is read whole.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path, self.file = path, file
        version = np.lib.format.read_magic(file)
        reader = np.lib.format.read_array_header_1_0
        # Version 2 has a longer header, and version 3 names in UTF-8, which only records have.
        if version != (1, 0):
            reader = np.lib.format.read_array_header_2_0
        with warnings.catch_warnings():  # of headers that Python 2 wrote
            warnings.simplefilter("ignore")
            self.shape, by_columns, self.dtype = reader(file)
        if any(length < 0 for length in self.shape):
            raise ValueError(f"its shape is {self.shape}")
        is_matrix = len(self.shape) == 2
        if is_matrix and self.shape[1] >= max(_FEWEST_SAMPLES, _LONGER * self.shape[0]):
            # The transpose of a matrix in C order is one in Fortran order: no number moves.
            self.shape, by_columns = self.shape[::-1], not by_columns
        self._is_whole = by_columns
        self._values: Any = None

    def __getitem__(self, rows: slice) -> Any:
        count = rows.stop - rows.start
        if not self._is_whole:
            return self._read((count, *self.shape[1:]))
        if self._values is None:
            check_memory(self.path, math.prod(self.shape) * float(self.dtype.itemsize))
            self._values = self._read(self.shape[::-1]).T
        return self._values[rows]

    def _read(self, shape: tuple[int, ...]) -> Any:
        """Return the next numbers of the file."""
        size = math.prod(shape) * self.dtype.itemsize
        data = self.file.read(size)
        if len(data) < size:
            raise ValueError("it is truncated")
        return np.frombuffer(data, dtype=self.dtype).reshape(shape)
