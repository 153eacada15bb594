"""CSV: a line of column names, then lines of samples."""

from __future__ import annotations

import csv
import os
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError
from seaid.formats.table import Block, Blocks, Table

MEMORY_SHARE = 0.25
"""Largest part of the free memory that a CSV file read as a whole may have as its size."""


def open_csv(path: Path) -> Table:
    """Return the columns of a CSV file; delimited by commas, semicolons or tabs.

    A header behind # or % may be delimited by spaces, as NumPy and MATLAB write it. Raises LogError
    for what is no such file, and where it is too large to be loaded as a whole.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            names, delimiter = _header(path, file.readline().rstrip("\r\n"))
    except OSError as problem:
        raise LogError(f"cannot read '{path}': {problem.strerror}") from None
    except UnicodeDecodeError as problem:
        raise LogError(f"'{path}' is not a text file in UTF-8: {problem}") from None

    def load(wanted: list[str]) -> Block:
        _check_size(path)
        return next(blocks(wanted, 0))

    def blocks(wanted: list[str], size: int) -> Blocks:
        try:
            with path.open(encoding="utf-8-sig") as file:
                file.readline()
                lines, line = list(islice(file, size or None)), 2
                while lines or line == 2:
                    yield _columns(path, names, lines, delimiter, wanted, line)
                    line += len(lines)
                    lines = list(islice(file, size or None))
        except UnicodeDecodeError as problem:
            raise LogError(f"'{path}' is not a text file in UTF-8: {problem}") from None

    return Table(names, load, blocks)


def free_memory() -> float:
    """Return the bytes of memory that a program may still take; infinite where nobody says."""
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if "MemAvailable" in line)
    with suppress(ValueError, OSError, AttributeError):
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def _check_size(path: Path) -> None:
    size, free = path.stat().st_size, free_memory()
    if size > MEMORY_SHARE * free:
        raise LogError(
            f"'{path}' has {size / 1e9:.3g} GB, too much to be read as a whole into the "
            f"{free / 1e9:.3g} GB of memory that are free; read it in pieces with "
            "seaid.open_long_log, or write it as Parquet with the columns needed"
        )


def _header(path: Path, header: str) -> tuple[list[str], str]:
    """Return the column names in the first line of a file, and its delimiter."""
    is_comment = header[:1] in "#%"
    header = header.lstrip("#% ") if is_comment else header
    delimiter = max(",;\t", key=header.count)
    if is_comment and delimiter not in header:
        delimiter, header = " ", " ".join(header.split())
    names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter), [])]
    if not any(names):
        raise LogError(f"'{path}' is empty; a log starts with a line of column names")
    return names, delimiter


def _columns(
    path: Path, names: list[str], lines: list[str], delimiter: str, wanted: list[str], first: int
) -> Block:
    """Return the wanted columns of lines of samples, the first of which is line `first`.

    Only lines with more than numbers in the wanted columns take the slow way.
    """
    if not any(line.strip() for line in lines):
        raise LogError(f"'{path}' has column names but no samples")
    twice = sorted({name for name in wanted if names.count(name) > 1})
    if twice:
        raise LogError(f"'{path}': column named twice: {', '.join(twice)}")
    places = [names.index(name) for name in wanted]
    if delimiter == " ":
        lines = [" ".join(line.split()) for line in lines]
    if all(line.count(delimiter) == len(names) - 1 for line in lines):
        with suppress(ValueError):
            values = np.loadtxt(
                lines, delimiter=delimiter, usecols=places, ndmin=2, comments=None, quotechar='"'
            )
            if len(values) == len(lines):
                return dict(zip(wanted, values.T.copy(), strict=True))
    return _slowly(path, names, lines, delimiter, places, first)


def _slowly(
    path: Path, names: list[str], lines: list[str], delimiter: str, places: list[int], first: int
) -> Block:
    rows = []
    for line, cells in enumerate(csv.reader(lines, delimiter=delimiter), first):
        if not cells:
            continue
        if len(cells) != len(names):
            raise LogError(
                f"'{path}' is not a table: line {line} has {len(cells)} cells, the first line "
                f"{len(names)} column names"
            )
        rows.append([_number(path, line, names[place], cells[place]) for place in places])
    values: Array = np.array(rows)
    return {names[place]: values[:, column] for column, place in enumerate(places)}


def _number(path: Path, line: int, column: str, cell: str) -> float:
    """Return the number in a cell; an empty one is NaN, true and false are 1 and 0."""
    try:
        return float(cell) if cell.strip() else float("nan")
    except ValueError:
        pass
    truth = {"true": 1.0, "false": 0.0}.get(cell.strip().lower())
    if truth is None:
        raise LogError(f"'{path}', line {line}: column '{column}' has '{cell}', which is no number")
    return truth
