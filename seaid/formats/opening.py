"""Which reader a log file is for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from seaid.errors import LogError
from seaid.formats.csv_file import open_csv
from seaid.formats.hdf5_file import open_hdf5
from seaid.formats.hebi_log import open_hebilog
from seaid.formats.json_file import open_json
from seaid.formats.npz_file import open_npz
from seaid.formats.parquet_file import open_parquet
from seaid.formats.ros_bag import open_bag
from seaid.formats.table import Table

READERS: dict[str, Callable[[Path], Table]] = {
    ".csv": open_csv,
    ".npz": open_npz,
    ".parquet": open_parquet,
    ".h5": open_hdf5,
    ".hdf5": open_hdf5,
    ".json": open_json,
    ".db3": open_bag,
    ".mcap": open_bag,
    ".bag": open_bag,
    ".hebilog": open_hebilog,
}
"""Readers by the ending of the file; a folder is a ROS bag."""


def open_table(path: Path) -> Table:
    """Return the columns of a log file. Raises LogError for one that cannot be read."""
    if path.is_dir():
        return open_bag(path)
    if path.suffix.lower() not in READERS:
        raise LogError(f"'{path}': cannot read '{path.suffix}' logs; allowed: {', '.join(READERS)}")
    if not path.is_file():
        raise LogError(f"no log file at '{path}' (working folder {Path.cwd()})")
    return READERS[path.suffix.lower()](path)
