"""NPZ: an archive of NumPy arrays, one a column, or of two dimensions with a joint a column."""

from __future__ import annotations

import zipfile
import zlib
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError
from seaid.formats.table import Block, Blocks, Table, check_lengths, part_of, samples, with_parts

_DAMAGE = (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error)
Kind = tuple[np.dtype[Any], tuple[int, ...]]


def open_npz(path: Path) -> Table:
    """Return the columns of a NumPy archive. Raises LogError for what is none."""
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = [name.removesuffix(".npy") for name in archive.namelist()]
            names = [part for name in arrays for part in _parts(archive, name)]
    except (OSError, zipfile.BadZipFile, NotImplementedError):
        raise LogError(f"'{path}' is not a NumPy archive (.npz), or a damaged one") from None
    return Table(
        names,
        lambda wanted: _load(path, wanted),
        lambda wanted, size: _blocks(path, wanted, size),
    )


def _parts(archive: zipfile.ZipFile, name: str) -> list[str]:
    """Return the columns of an array; a damaged one is named when it is wanted."""
    try:
        with archive.open(f"{name}.npy") as file:
            return with_parts(name, _kind(file)[1])
    except (*_DAMAGE, KeyError):
        return [name]


def _load(path: Path, wanted: list[str]) -> Block:
    found: Block = {}
    with np.load(path) as archive:
        for name in wanted:
            base, index = (name, None) if name in archive.files else part_of(name)
            try:
                values = archive[base]
            except _DAMAGE as problem:
                raise LogError(f"'{path}': column '{name}' cannot be read: {problem}") from None
            found[name] = samples(path, name, values if index is None else values[:, index])
    return found


def _blocks(path: Path, wanted: list[str], size: int) -> Blocks:
    with zipfile.ZipFile(path) as archive, ExitStack() as stack:
        files = {name: stack.enter_context(_member(path, archive, name)) for name in wanted}
        kinds = {name: _row(path, name, file) for name, file in files.items()}
        check_lengths(path, {name: np.empty(length) for name, (_, length) in kinds.items()})
        total = kinds[wanted[0]][1]
        for start in range(0, max(total, 1), size):
            count = min(size, total - start)
            yield {
                name: _block(path, name, file, kinds[name][0], count)
                for name, file in files.items()
            }


def _member(path: Path, archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    try:
        return archive.open(f"{name}.npy")
    except KeyError:
        raise LogError(
            f"'{path}': '{name}' is a column of an array; in pieces only whole arrays can be read, "
            "one a column"
        ) from None


def _kind(file: IO[bytes]) -> Kind:
    """Return type and shape of an array in its file, and leave the file at its numbers."""
    version = np.lib.format.read_magic(file)
    reader = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        reader = np.lib.format.read_array_header_2_0
    shape, _, kind = reader(file)
    return kind, shape


def _row(path: Path, name: str, file: IO[bytes]) -> tuple[np.dtype[Any], int]:
    """Return type and length of a column."""
    try:
        kind, shape = _kind(file)
    except _DAMAGE as problem:
        raise LogError(f"'{path}': column '{name}' cannot be read: {problem}") from None
    if kind.kind not in "biuf" or len(shape) != 1:
        raise LogError(
            f"'{path}': column '{name}' must be a row of numbers, found {kind} of shape {shape}"
        )
    return kind, int(shape[0])


def _block(path: Path, name: str, file: IO[bytes], kind: np.dtype[Any], count: int) -> Array:
    try:
        values = np.frombuffer(file.read(count * kind.itemsize), dtype=kind)
    except _DAMAGE as problem:
        raise LogError(f"'{path}': column '{name}' cannot be read: {problem}") from None
    if len(values) < count:
        raise LogError(f"'{path}': column '{name}' cannot be read: it ends too early")
    return values.astype(np.float64)
