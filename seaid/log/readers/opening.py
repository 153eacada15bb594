"""Selection of the reader of a log file."""

from __future__ import annotations

import stat
from collections import ChainMap, Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from itertools import chain, islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from seaid._files import working_folder
from seaid.errors import LogError, listed, reason_of, shortened
from seaid.log.readers.array_files import open_hdf5, open_mat, open_npy, open_npz, open_parquet
from seaid.log.readers.csv_file import open_csv
from seaid.log.readers.hebi_log import open_hebilog
from seaid.log.readers.json_file import open_json
from seaid.log.readers.ros_bag import open_bag
from seaid.log.readers.table import IN_MEMORY, Block, Table, check_names, held

READERS: dict[str, Callable[[Path], Table]] = {
    **dict.fromkeys((".csv", ".txt", ".dat", ".tsv"), open_csv),
    ".npz": open_npz,
    ".npy": open_npy,
    ".parquet": open_parquet,
    **dict.fromkeys((".h5", ".hdf5"), open_hdf5),
    ".json": open_json,
    ".mat": open_mat,
    **dict.fromkeys((".db3", ".mcap", ".bag"), open_bag),
    ".hebilog": open_hebilog,
}
"""Readers by the suffix of the file; a folder is a ROS bag."""


_INSTEAD = {
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods"), "save the sheet as CSV in UTF-8"),
    **dict.fromkeys((".gz", ".zip", ".bz2", ".xz", ".7z"), "unpack it first"),
    **dict.fromkeys((".pkl", ".pickle"), "it could run any code; write it as .npz or .parquet"),
    **dict.fromkeys((".tdms", ".mf4", ".ulg", ".mtx"), "export it as CSV, .parquet or .h5"),
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


def in_memory(log: Any) -> Table | None:
    """Return the columns of a mapping or a data frame, with its named index; None for a path."""
    names = getattr(log, "columns", log)
    if isinstance(log, str | Path) or not (names is not log or isinstance(log, Mapping)):
        return None
    data = {str(name): _plain_numbers(log[name]) for name in names}
    index = getattr(log, "index", None)
    if isinstance(getattr(index, "name", None), str):
        data = {str(index.name): _plain_numbers(index), **data}  # type: ignore[union-attr]
    check_names(IN_MEMORY, [*data])
    return held(IN_MEMORY, data)


def _plain_numbers(values: Any) -> Any:
    """Return a column as an array, with instants as seconds since 1970."""
    array = np.asarray(values)
    with suppress(TypeError, ValueError):
        if array.dtype.kind in "mM":
            # Instants of pandas may be in s, ms, us or ns; a duration is in seconds, too.
            seconds = array.astype(f"{array.dtype.kind}8[ns]").astype(np.int64) * 1e-9
            return np.where(np.isnat(array), np.nan, seconds)
        return array.astype(np.float64) if array.dtype.kind == "O" else array
    return array


def files_of(log: Any) -> tuple[list[Path], Table | None]:
    """Return the paths of a log and None; of a log in memory, IN_MEMORY and its columns."""
    if (table := in_memory(log)) is not None:
        return [IN_MEMORY], table
    return [Path(file) for file in ([log] if isinstance(log, str | Path) else log)], None


def open_tables(paths: Sequence[Path]) -> Table:
    """Return the columns of several files of one log; a name in several files is "file:name"."""
    if len(paths) == 1:
        return open_table(paths[0])
    tables = {path.name: open_table(path) for path in paths}
    if len(tables) < len(paths):
        names = listed(path.name for path in paths)
        raise LogError(f"the files of one log need names of their own, found {names}")
    return _joined(tables)


def _joined(tables: Mapping[str, Table]) -> Table:
    """Return the columns of the files of one log."""
    names = _names_in_log(tables)
    places = {name: place for place, name in names.items()}

    def load(wanted: list[str]) -> Block:
        block: Block = {}
        for file, table in tables.items():
            if bare := [name for x, name in map(places.__getitem__, wanted) if x == file]:
                block |= {names[file, name]: x for name, x in table.load(bare).items()}
        return block

    clocks = [{names[x, y]: names[x, z] for y, z in t.clocks.items()} for x, t in tables.items()]
    return Table(
        names=list(places),
        load=load,
        clocks=dict(ChainMap(*clocks)),
        sparse=any(map(attrgetter("sparse"), tables.values())),
        notice="; ".join(dict.fromkeys(filter(None, map(attrgetter("notice"), tables.values())))),
        files={name: file for name, (file, _) in places.items()},
    )


def _names_in_log(tables: Mapping[str, Table]) -> dict[tuple[str, str], str]:
    """Return {(file, column): its name in a log of several files}."""
    counts = Counter(chain.from_iterable(table.names for table in tables.values()))
    return {
        (file, name): name if counts[name] == 1 else f"{file}:{name}"
        for file, table in tables.items()
        for name in table.names
    }


_MOST_NAMES = 1000
"""Names of a folder among which a similar one is sought."""


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
    if mode is None:
        raise LogError(f"no log file at '{path}' ({working_folder()}){_similar(path)}")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        instead = _INSTEAD.get(path.suffix.lower(), f"allowed: {', '.join(READERS)}")
        raise LogError(f"'{path}': cannot read '{shortened(path.suffix)}' logs; {instead}")
    if not stat.S_ISREG(mode):
        raise LogError(f"'{path}' is a pipe, a socket or a device; a log must be a file or folder")
    return reader


def _similar(path: Path) -> str:
    """Return the question whether a similar name in its folder was meant, "" if there is none."""
    with suppress(OSError, ValueError):
        names = [sibling.name for sibling in islice(path.parent.iterdir(), _MOST_NAMES)]
        if near := get_close_matches(path.name, names, 1):
            return f"; did you mean '{near[0]}'?"
    return ""
