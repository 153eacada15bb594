"""Files of arrays by name: NumPy (.npz, .npy), HDF5, MATLAB (.mat) and Parquet.

A column is an array (T,), or "name[i]" of an array (T, k). HDF5, and MATLAB from version 7.3 on,
are read by h5py (`pip install 'seaid[hdf5]'`), older files of MATLAB by scipy, and Parquet by
pyarrow (`seaid[parquet]`). MATLAB's files are read in a child process, since a compressed part may
request any memory.
"""

from __future__ import annotations

import math
import sys
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np

from seaid._arrays import Array
from seaid._files import whole_file
from seaid.errors import LogError, listed, shortened
from seaid.log.channels import refusal
from seaid.log.readers.table import (
    Arrays,
    Blocks,
    Refused,
    Table,
    check_columns,
    check_memory,
    damaged,
    held,
    in_pieces,
    is_number,
    no_numbers,
    optional,
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


_DEEPEST = 20
"""Most levels of structures."""


def open_mat(path: Path) -> Table:
    """Return the arrays of a MATLAB file as columns, with "q[0]", "q[1]", ... for a matrix.

    A field of a structure is "log.q". The longer side of a matrix is time. Raises LogError for an
    invalid file, one without an array of numbers, and from version 7.3 on if h5py is not installed.
    """
    from seaid.log.readers.child_process import read_in_child

    names, arrays = read_in_child(mat_arrays, path, "a MATLAB file", 2e6)
    if not arrays:
        raise refusal("no_arrays", path=path, found=listed(names) or "none")
    return held(path, arrays)


def mat_arrays(path: str) -> tuple[list[str], dict[str, Any]]:
    """Return the names of the variables and the arrays of a file; runs in the child."""
    from scipy import io

    try:
        content = io.loadmat(path, simplify_cells=True)
        arrays = dict(_arrays_in("", content, 0))
    except NotImplementedError:  # version 7.3 is HDF5
        h5py = optional("h5py", "hdf5", Path(path))
        with h5py.File(path, "r") as file:
            content, arrays = list(file), dict(_arrays_in("", file, 0))
    longest = max((max(array.shape) for array in arrays.values()), default=0)
    # Samples are along the longest side of all arrays; a square matrix of it stays, as columns.
    rows = {x: y.T if y.shape[1] == longest != y.shape[0] else y for x, y in arrays.items()}
    arrays = {name: x[:, 0] if x.shape[1] == 1 else x for name, x in rows.items()}
    return [name for name in content if not name.startswith(_HIDDEN)], arrays


_HIDDEN = ("_", "#")
"""Starts of names that are no variables: "#refs#" holds what cells and objects refer to."""


def _arrays_in(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield the vectors and matrices of numbers in a variable or in a group, as matrices."""
    if isinstance(value, Mapping) and depth < _DEEPEST:
        for key, field in value.items():
            if not key.startswith(_HIDDEN):
                yield from _arrays_in(f"{name}.{key}".removeprefix("."), field, depth + 1)
    elif getattr(value, "size", 0) > 1 and value.ndim <= 2 and is_number(value.dtype):
        # HDF5 has the dimensions in reverse.
        array = value if isinstance(value, np.ndarray) else np.asarray(value).T
        yield name, array.reshape(len(array), -1)


_PARQUET = "a Parquet file"


def open_parquet(path: Path) -> Table:
    """Return a Parquet file's columns; nulls are NaN, timestamps count [s] from the first."""
    parquet = optional("pyarrow.parquet", "parquet", path)
    arrow = optional("pyarrow", "parquet", path)
    with damaged(path, _PARQUET), parquet.ParquetFile(path) as file:
        check_columns(path, len(file.schema_arrow))
        names = list(file.schema_arrow.names)

    def blocks(wanted: list[str], size: int) -> Blocks:
        starts: dict[str, Any] = {}
        with damaged(path, _PARQUET), parquet.ParquetFile(path) as file:
            _check_kinds(path, file, wanted, arrow.types)
            rows = min(size, max(file.metadata.num_rows, 1))
            check_memory(path, 8.0 * rows * len(wanted), pieces=size < sys.maxsize)
            batch = None
            for batch in file.iter_batches(rows, columns=wanted):
                yield {name: _numbers_of(name, batch[name], starts, arrow.types) for name in wanted}
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


def _numbers_of(name: str, column: Any, starts: dict[str, Any], types: Any) -> Array:
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
