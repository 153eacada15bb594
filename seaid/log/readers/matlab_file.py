"""MATLAB files (.mat), read with scipy, from version 7.3 on with h5py.

The reader runs in a child process, since a compressed part of a file may request any memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seaid.errors import LogError, listed
from seaid.log.readers.child_process import read_in_child
from seaid.log.readers.table import Block, Table, check_columns, is_number, optional

_DEEPEST = 20
"""Most levels of structures."""

_HINT = "save arrays of numbers, or a structure of them (save('run.mat', 't', 'q'))"


def open_mat(path: Path) -> Table:
    """Return the arrays of a MATLAB file as columns, with "q[0]", "q[1]", ... for a matrix.

    A field of a structure is "log.q". The longer side of a matrix is time. Raises LogError for an
    invalid file, one without an array of numbers, and from version 7.3 on if h5py is not installed.
    """
    names, data = read_in_child(mat_columns, path, "a MATLAB file", 2e6)
    check_columns(path, len(data))
    if not data:
        raise LogError(
            f"'{path}' has no array of numbers, found: {listed(names) or 'none'}; {_HINT}"
        )
    return Table(list(data), lambda wanted: {name: data[name] for name in wanted})


def mat_columns(path: str) -> tuple[list[str], Block]:
    """Return the names of the variables and the columns of a file; runs in the child."""
    from scipy import io

    try:
        content = io.loadmat(path, simplify_cells=True)
        arrays = dict(_arrays("", content, 0))
    except NotImplementedError:  # version 7.3 is HDF5
        h5py = optional("h5py", "hdf5", Path(path))
        with h5py.File(path, "r") as file:
            content, arrays = list(file), dict(_arrays("", file, 0))
    longest = max((max(array.shape) for array in arrays.values()), default=0)
    columns: Block = {}
    for name, values in arrays.items():
        # Samples are along the longest side of all arrays; a square matrix of it stays, as columns.
        rows = values.T if values.shape[1] == longest != values.shape[0] else values
        many = rows.shape[1] > 1
        check_columns(Path(path), len(columns) + rows.shape[1])
        for place, column in enumerate(rows.T):
            columns[f"{name}[{place}]" if many else name] = column.astype(np.float64)
    return [name for name in content if not name.startswith(_HIDDEN)], columns


_HIDDEN = ("_", "#")
"""Starts of names that are no variables: "#refs#" holds what cells and objects refer to."""


def _arrays(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield the vectors and matrices of numbers in a variable or in a group, as matrices."""
    if isinstance(value, Mapping) and depth < _DEEPEST:
        for key, field in value.items():
            if not key.startswith(_HIDDEN):
                yield from _arrays(f"{name}.{key}".removeprefix("."), field, depth + 1)
    elif getattr(value, "size", 0) > 1 and value.ndim <= 2 and is_number(value.dtype):
        # HDF5 has the dimensions in reverse.
        array = value if isinstance(value, np.ndarray) else np.asarray(value).T
        yield name, array.reshape(len(array), -1)
