"""Selection of the reader of a log file."""

from __future__ import annotations

import stat
from collections.abc import Callable
from pathlib import Path

from seaid._files import working_folder
from seaid.errors import LogError, reason_of, shortened
from seaid.log.readers.csv_file import open_csv
from seaid.log.readers.hdf5_file import open_hdf5
from seaid.log.readers.hebi_log import open_hebilog
from seaid.log.readers.json_file import open_json
from seaid.log.readers.matlab_file import open_mat, open_mtx
from seaid.log.readers.memory import check_names
from seaid.log.readers.npz_file import open_npz
from seaid.log.readers.parquet_file import open_parquet
from seaid.log.readers.ros_bag import open_bag
from seaid.log.readers.table import Table

READERS: dict[str, Callable[[Path], Table]] = {
    **dict.fromkeys((".csv", ".txt", ".dat", ".tsv"), open_csv),
    ".npz": open_npz,
    ".parquet": open_parquet,
    ".h5": open_hdf5,
    ".hdf5": open_hdf5,
    ".json": open_json,
    ".mat": open_mat,
    ".mtx": open_mtx,
    ".db3": open_bag,
    ".mcap": open_bag,
    ".bag": open_bag,
    ".hebilog": open_hebilog,
}
"""Readers by the suffix of the file; a folder is a ROS bag."""


_INSTEAD = {
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods"), "save the sheet as CSV in UTF-8"),
    **dict.fromkeys((".gz", ".zip", ".bz2", ".xz", ".7z"), "unpack it first"),
    **dict.fromkeys((".pkl", ".pickle"), "it could run any code; write it as .npz or .parquet"),
    **dict.fromkeys((".tdms", ".mf4", ".ulg"), "export it as CSV, .parquet or .h5"),
}
"""What to do with files of other programs, by their suffix."""


def open_table(path: Path) -> Table:
    """Return the columns of a log file. Raises LogError if it cannot be read."""
    reader = _reader(path)
    try:
        table = reader(path)
    except OSError as problem:
        raise LogError(f"cannot read '{path}': {reason_of(problem)}") from None
    check_names(path, table.names)
    return table


def _reader(path: Path) -> Callable[[Path], Table]:
    """Return the reader of a file or folder. Raises LogError for anything else."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        mode = None
    except (OSError, ValueError) as problem:
        raise LogError(f"cannot read '{shortened(str(path), 300)}': {reason_of(problem)}") from None
    if mode is not None and stat.S_ISDIR(mode):
        return open_bag
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        instead = _INSTEAD.get(path.suffix.lower(), f"allowed: {', '.join(READERS)}")
        raise LogError(f"'{path}': cannot read '{shortened(path.suffix)}' logs; {instead}")
    if mode is None:
        raise LogError(f"no log file at '{path}' ({working_folder()})")
    if not stat.S_ISREG(mode):
        raise LogError(f"'{path}' is a pipe, a socket or a device; a log must be a file or folder")
    return reader
