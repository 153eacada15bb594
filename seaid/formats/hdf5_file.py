"""HDF5, read and written with h5py (`pip install 'seaid[hdf5]'`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from seaid.arrays import Array
from seaid.errors import LogError
from seaid.files import whole_file
from seaid.formats.table import (
    Block,
    Blocks,
    Table,
    check_lengths,
    optional,
    part_of,
    samples,
    with_parts,
)

_DAMAGE = (OSError, ValueError, RuntimeError, KeyError)


def open_hdf5(path: Path) -> Table:
    """Return the data sets of an HDF5 file as columns, by their path in it: "elbow/position".

    Columns of a set of two dimensions are "name[0]", "name[1]", ..., those of a table "name/field".
    Raises LogError for what is no such file, and where h5py is not installed.
    """
    h5py = optional("h5py", "hdf5", path)
    names: list[str] = []

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            fields = item.dtype.names or ()
            names.extend(
                [f"{name}/{one}" for one in fields] if fields else with_parts(name, item.shape)
            )

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except _DAMAGE as problem:
        raise LogError(f"'{path}' is not an HDF5 file, or a damaged one: {problem}") from None

    def load(wanted: list[str]) -> Block:
        with h5py.File(path, "r") as file:
            return {name: _samples(path, file, name, slice(None)) for name in wanted}

    def blocks(wanted: list[str], size: int) -> Blocks:
        with h5py.File(path, "r") as file:
            total = max(len(_samples(path, file, name, slice(None))) for name in wanted[:1])
            for start in range(0, max(total, 1), size):
                rows = slice(start, start + size)
                block = {name: _samples(path, file, name, rows) for name in wanted}
                check_lengths(path, block)
                yield block

    return Table(names, load, blocks)


def write_hdf5(path: Path, data: Mapping[str, Array]) -> None:
    """Write columns, whole or not at all. Raises LogError where h5py is not installed."""
    h5py = optional("h5py", "hdf5", path)
    with whole_file(path) as temporary, h5py.File(temporary, "w") as file:
        for name, values in data.items():
            file.create_dataset(name, data=values)


def _samples(path: Path, file: Any, name: str, rows: slice) -> Array:
    try:
        if name in file:
            return samples(path, name, file[name][rows])
        base, index = part_of(name)
        if index is not None:
            return samples(path, name, file[base][rows, index])
        base, _, field = name.rpartition("/")
        return samples(path, name, file[base][rows][field])
    except _DAMAGE as problem:
        raise LogError(f"'{path}': column '{name}' cannot be read: {problem}") from None
