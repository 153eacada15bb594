"""Logs as files, by the ending of the path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError
from seaid.files import write_csv, write_whole
from seaid.formats.hdf5_file import write_hdf5
from seaid.formats.parquet_file import write_parquet
from seaid.logs.log_data import Log


def write_log(log: Log, path: str | Path) -> None:
    """Write a log as CSV, NPZ, Parquet or HDF5 (by the ending), whole or not at all.

    Raises LogError for another ending, SeaidError where the file cannot be written.
    """
    path = Path(path)
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise LogError(
            f"'{path}': cannot write '{path.suffix}' logs; allowed: {', '.join(_WRITERS)}"
        )
    write(path, {"time_s": log.time, **log.columns()})


def _write_npz(path: Path, data: Mapping[str, Array]) -> None:
    content = BytesIO()
    np.savez_compressed(content, **data)  # type: ignore[arg-type]
    write_whole(path, content.getvalue())


_WRITERS: dict[str, Callable[[Path, Mapping[str, Array]], None]] = {
    ".csv": write_csv,
    ".npz": _write_npz,
    ".parquet": write_parquet,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
}

WRITTEN = tuple(_WRITERS)
"""Endings of the files that `write_log` writes."""
