"""HDF5, read and written with h5py (`pip install 'seaid[hdf5]'`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from seaid._arrays import Array
from seaid._files import whole_file
from seaid.errors import LogError, shortened
from seaid.log.readers.table import Arrays, Refused, Table, check_columns, optional, table_of_arrays


def open_hdf5(path: Path) -> Table:
    """Return the datasets of an HDF5 file as columns, named by their path: "elbow/position".

    Columns of a dataset of two dimensions are "name[0]", "name[1]", ..., those of a table
    "name/field". Raises LogError for an invalid file, and if h5py is not installed. Datasets with
    samples in other files (external, virtual) are refused; links to other files are not followed.
    """
    h5py = optional("h5py", "hdf5", path)

    @contextmanager
    def opened() -> Iterator[Arrays]:
        arrays: dict[str, Any] = {}

        def visit(name: str | bytes, item: Any) -> None:
            if isinstance(name, bytes):  # not in UTF-8
                name = name.decode("utf-8", "replace")
            if isinstance(item, h5py.Dataset):
                arrays.update(_arrays_of(path, name, item))
                check_columns(path, len(arrays))

        with h5py.File(path, "r") as file:
            file.visititems(visit)
            yield arrays

    return table_of_arrays(path, "an HDF5 file", opened)


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


def _arrays_of(path: Path, name: str, data: Any) -> dict[str, Any]:
    """Return a dataset, or the fields of a table, by name; an unreadable one raises when wanted."""
    try:
        if data.is_virtual or data.external:
            reason = (
                f"'{path}': the samples of column '{shortened(name)}' are not in this file but in "
                "others, which are not read; copy them into it"
            )
            return {name: Refused(LogError(reason))}
        fields = data.dtype.names
    except (TypeError, ValueError, RuntimeError, OSError) as problem:
        return {name: Refused(problem)}
    return {f"{name}/{field}": _Field(data, field) for field in fields} if fields else {name: data}


class _Field:
    """A field of a dataset whose samples are records."""

    def __init__(self, data: Any, name: str) -> None:
        self.data, self.name = data, name
        self.shape, self.dtype, self.chunks = data.shape, data.dtype[name], data.chunks

    def __getitem__(self, rows: slice) -> Any:
        return self.data.fields(self.name)[rows]
