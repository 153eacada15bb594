"""CSV: a line of column names, then lines of samples."""

from __future__ import annotations

import csv
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, listed, shortened
from seaid.log.readers.memory import check_memory
from seaid.log.readers.table import Block, Blocks, Table

LONGEST_LINE = 1_000_000
"""Most characters of a line of a CSV file: 100 for each of the most columns."""

_LINES, _TEXT = 50_000, 50_000_000
"""Most lines, and characters in them, that are held as text at a time."""


@dataclass(frozen=True)
class _Header:
    """The first line of a file: the names of its columns, and the delimiter."""

    path: Path
    names: list[str]
    delimiter: str

    @cached_property
    def places(self) -> dict[str, int]:
        """The place of each column."""
        return {name: place for place, name in enumerate(self.names)}

    def places_of(self, wanted: list[str]) -> list[int]:
        """Return the places of columns. Raises LogError for a duplicate name."""
        if len(self.places) < len(self.names):
            counts = Counter(self.names)
            twice = sorted(name for name in wanted if counts[name] > 1)
            if twice:
                raise LogError(f"'{self.path}': column named twice: {listed(twice)}")
        return [self.places[name] for name in wanted]


def open_csv(path: Path) -> Table:
    """Return the columns of a CSV file delimited by commas, semicolons or tabs.

    A header behind # or % may be delimited by spaces, as NumPy and MATLAB write it. Raises LogError
    for an invalid file, and for one too large to be loaded at once.
    """
    with _opened(path) as file:
        header = _header(path, next(_lines(path, file), ""))

    def load(wanted: list[str]) -> Block:
        check_memory(path, path.stat().st_size)
        return next(blocks(wanted, sys.maxsize))

    def blocks(wanted: list[str], size: int) -> Blocks:
        with _opened(path) as file:
            lines, line = _lines(path, file), 2
            next(lines, "")
            while parts := _parts(header, lines, wanted, line, size):
                line += sum(count for count, _ in parts)
                found = [part for _, part in parts if part]
                if found:
                    yield {name: np.concatenate([one[name] for one in found]) for name in wanted}

    return Table(header.names, load, blocks)


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    try:
        with path.open(encoding="utf-8-sig") as file:
            yield file
    except UnicodeDecodeError as problem:
        raise LogError(
            f"'{path}' is not a text file in UTF-8 ({problem.reason} at byte {problem.start}); "
            "save it as CSV in UTF-8"
        ) from None


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    for number, line in enumerate(iter(partial(file.readline, LONGEST_LINE), ""), 1):
        if len(line) == LONGEST_LINE:
            raise LogError(
                f"'{path}' is not a table: line {number} has more than {LONGEST_LINE:,} characters"
            )
        yield line


def _parts(
    header: _Header, lines: Iterator[str], wanted: list[str], first: int, most: int
) -> list[tuple[int, Block]]:
    """Return the next `most` lines in parts: the number of lines, and their columns."""
    parts: list[tuple[int, Block]] = []
    count = 0
    while some := _some(lines, min(most - count, _LINES)):
        parts.append((len(some), _columns(header, some, wanted, first + count)))
        count += len(some)
        check_memory(header.path, 8.0 * count * len(wanted), pieces=most < sys.maxsize)
    if first == 2 and not any(part for _, part in parts):
        raise LogError(f"'{header.path}' has column names but no samples")
    return parts


def _some(lines: Iterator[str], most: int) -> list[str]:
    """Return the next lines, limited in number and size."""
    found: list[str] = []
    size = 0
    for line in islice(lines, most):
        found.append(line)
        size += len(line)
        if size > _TEXT:
            break
    return found


def _header(path: Path, header: str) -> _Header:
    """Return the names and the delimiter in the first line of a file."""
    header = header.rstrip("\r\n")
    if "\0" in header:
        raise LogError(f"'{path}' is not a text file in UTF-8 (it has zero bytes); save it as such")
    is_comment = header[:1] in "#%"
    header = header.lstrip("#% ") if is_comment else header
    delimiter = max(",;\t", key=header.count)
    if is_comment and delimiter not in header:
        delimiter, header = " ", " ".join(header.split())
    cells = next(_cells(path, [header], delimiter, 1), (1, []))[1]
    names = [name.strip() for name in cells]
    if not any(names):
        raise LogError(f"'{path}' is empty; a log starts with a line of column names")
    return _Header(path, names, delimiter)


def _columns(header: _Header, lines: list[str], wanted: list[str], first: int) -> Block:
    """Return the wanted columns of lines from line `first` on; {} if all are blank."""
    if not any(line.strip() for line in lines):
        return {}
    places, delimiter = header.places_of(wanted), header.delimiter
    if delimiter == " ":
        lines = [" ".join(line.split()) for line in lines]
    if all(line.count(delimiter) == len(header.names) - 1 for line in lines):
        with suppress(ValueError):
            values = np.loadtxt(
                lines, delimiter=delimiter, usecols=places, ndmin=2, comments=None, quotechar='"'
            )
            if len(values) == len(lines):
                return dict(zip(wanted, values.T.copy(), strict=True))
    return _parsed_cells(header, lines, places, first)


def _parsed_cells(header: _Header, lines: list[str], places: list[int], first: int) -> Block:
    path, names, rows = header.path, header.names, []
    for line, cells in _cells(path, lines, header.delimiter, first):
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


def _cells(
    path: Path, lines: list[str], delimiter: str, first: int
) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the cells of each line."""
    try:
        yield from enumerate(csv.reader(lines, delimiter=delimiter), first)
    except csv.Error as problem:
        raise LogError(f"'{path}' is not a table: {problem}") from None


def _number(path: Path, line: int, column: str, cell: str) -> float:
    """Return the number in a cell; NaN for an empty cell, 1 and 0 for true and false."""
    try:
        return float(cell) if cell.strip() else float("nan")
    except ValueError:
        pass
    truth = {"true": 1.0, "false": 0.0}.get(cell.strip().lower())
    if truth is None:
        raise LogError(
            f"'{path}', line {line}: column '{shortened(column)}' has '{shortened(cell)}', which "
            "is not a number"
        )
    return truth
