"""NumPy files: archives (.npz), and single arrays (.npy), with one column or several each.

A column is an array (T,), or "name[i]" of an array (T, k).
"""

from __future__ import annotations

import math
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from seaid.errors import LogError
from seaid.log.readers.table import (
    Block,
    Blocks,
    Table,
    as_floats,
    check_columns,
    check_lengths,
    check_memory,
    damaged,
    has_samples_in_columns,
    is_number,
    no_numbers,
    part_of,
    with_parts,
)

_KIND = "a NumPy archive (.npz)"
_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compressions that NumPy writes; readers of others use unlimited memory."""


@dataclass(frozen=True)
class _Header:
    """The header of an array as if its samples were in rows.

    `by_columns` says that its numbers are in the order of Fortran then.
    """

    kind: np.dtype[Any]
    shape: tuple[int, ...]
    by_columns: bool

    @property
    def size(self) -> int:
        return math.prod(self.shape) * self.kind.itemsize


def open_npz(path: Path) -> Table:
    """Return the columns of a NumPy archive. Raises LogError for an invalid file."""
    names: list[str] = []
    with damaged(path, _KIND), zipfile.ZipFile(path) as archive:
        arrays = [name.removesuffix(".npy") for name in archive.namelist()]
        check_columns(path, len(arrays))
        for name in arrays:
            names += _parts(path, archive, name)
            check_columns(path, len(names))
    return Table(
        names, lambda wanted: _load(path, wanted), lambda wanted, size: _blocks(path, wanted, size)
    )


def open_npy(path: Path) -> Table:
    """Return the columns of one NumPy array, which has the name of its file."""
    with damaged(path, "a NumPy array (.npy)"), path.open("rb") as file:
        header = _header(file)
        _check_kind(path, path.stem, header)

    def load(wanted: list[str]) -> Block:
        with damaged(path, "a NumPy array (.npy)"), path.open("rb") as file:
            values = _array(path, path.stem, file, _header(file))
        return _picked(path, values, [(name, part_of(name)[1]) for name in wanted])

    names = with_parts(path.stem, header.shape)
    return Table(names, load)


def _parts(path: Path, archive: zipfile.ZipFile, name: str) -> list[str]:
    """Return the names of the columns of an array; a damaged one has its own, to raise then."""
    try:
        with _member(path, archive, name) as (_, header):
            return with_parts(name, header.shape)
    except LogError:
        return [name]


def _places(archive: zipfile.ZipFile, wanted: list[str]) -> dict[str, list[tuple[str, int | None]]]:
    """Return {array: [(column, its index in the array, None for a whole one)]}."""
    arrays = set(archive.namelist())
    places: dict[str, list[tuple[str, int | None]]] = {}
    for name in wanted:
        # "q[0]" may be the name of an array itself.
        base, index = (name, None) if f"{name}.npy" in arrays else part_of(name)
        places.setdefault(base, []).append((name, index))
    return places


def _picked(path: Path, values: Any, places: list[tuple[str, int | None]]) -> Block:
    """Return the columns of an array of one or two dimensions."""
    columns: Block = {}
    for name, index in places:
        if values.ndim != (1 if index is None else 2):
            raise no_numbers(path, name, values.dtype, values.shape)
        columns[name] = as_floats(values if index is None else values[:, index])
    return columns


def _load(path: Path, wanted: list[str]) -> Block:
    with damaged(path, _KIND), zipfile.ZipFile(path) as archive:
        block: Block = {}
        for base, places in _places(archive, wanted).items():
            with _member(path, archive, base) as (file, header):
                values = _array(path, base, file, header)
            block |= _picked(path, values, places)
            check_memory(path, 8.0 * sum(len(column) for column in block.values()))
    return {name: block[name] for name in wanted}


def _array(path: Path, name: str, file: IO[bytes], header: _Header) -> Any:
    """Return an array of one or two dimensions, with the type of its file."""
    _check_kind(path, name, header)
    # As stored, or as float64: a file of bytes grows by a factor of eight.
    check_memory(path, max(header.size, 8.0 * math.prod(header.shape)))
    values = np.frombuffer(_exactly(file, header.size), dtype=header.kind)
    return values.reshape(header.shape, order="F" if header.by_columns else "C")


def _check_kind(path: Path, name: str, header: _Header) -> None:
    if not is_number(header.kind) or len(header.shape) not in (1, 2):
        raise no_numbers(path, name, header.kind, header.shape)


def _blocks(path: Path, wanted: list[str], size: int) -> Blocks:
    """Yield the wanted columns in pieces of `size` rows at most; those by columns are loaded."""
    with damaged(path, _KIND), zipfile.ZipFile(path) as archive, ExitStack() as stack:
        places = _places(archive, wanted)
        files: dict[str, tuple[IO[bytes], _Header]] = {}
        whole: dict[str, Any] = {}
        for base in places:
            file, header = stack.enter_context(_member(path, archive, base))
            _check_kind(path, places[base][0][0], header)
            if header.by_columns:  # it cannot be read row by row
                whole[base] = _array(path, base, file, header)
            files[base] = (file, header)
        check_lengths(path, {base: header.shape[0] for base, (_, header) in files.items()})
        total = next(iter(files.values()))[1].shape[0]  # that of all
        widths = sum(math.prod(header.shape[1:]) for _, header in files.values())
        check_memory(path, 8.0 * min(size, total) * widths, pieces=True)
        for start in range(0, max(total, 1), size):  # of no rows there is one empty block
            count = min(size, total - start)
            block: Block = {}
            for base, (file, header) in files.items():
                if base in whole:
                    rows = whole[base][start : start + count]
                else:
                    rows = _rows(path, base, file, header, count)
                block |= _picked(path, rows, places[base])
            yield {name: block[name] for name in wanted}


def _rows(path: Path, name: str, file: IO[bytes], header: _Header, count: int) -> Any:
    """Return the next rows of an array."""
    with damaged(path, _KIND, name):
        width = math.prod(header.shape[1:])
        data = _exactly(file, count * width * header.kind.itemsize)
        return np.frombuffer(data, dtype=header.kind).reshape(count, *header.shape[1:])


@contextmanager
def _member(path: Path, archive: zipfile.ZipFile, name: str) -> Iterator[tuple[IO[bytes], _Header]]:
    """Yield the file of an array, positioned at its numbers, and its header."""
    with damaged(path, _KIND, name):
        if archive.getinfo(f"{name}.npy").compress_type not in _COMPRESSIONS:
            raise ValueError("it has a compression that NumPy does not write")
        with archive.open(f"{name}.npy") as file:
            yield file, _header(file)


def _header(file: IO[bytes]) -> _Header:
    version = np.lib.format.read_magic(file)
    reader = np.lib.format.read_array_header_1_0
    # Version 2 has a longer header, and version 3 names in UTF-8, which only records have.
    if version != (1, 0):
        reader = np.lib.format.read_array_header_2_0
    with warnings.catch_warnings():  # of headers that Python 2 wrote
        warnings.simplefilter("ignore")
        shape, by_columns, kind = reader(file)
    if any(length < 0 for length in shape):
        raise ValueError(f"its shape is {shape}")
    if has_samples_in_columns(shape):
        # The transpose of a matrix in C order is one in Fortran order: no number moves.
        return _Header(kind, shape[::-1], not by_columns)
    return _Header(kind, shape, by_columns)


def _exactly(file: IO[bytes], count: int) -> bytes:
    data = file.read(count)
    if len(data) < count:
        raise ValueError("it is truncated")
    return data
