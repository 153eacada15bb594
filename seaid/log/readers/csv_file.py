"""CSV and other tables of text: a line of column names, if any, then lines of samples."""

from __future__ import annotations

import csv
import math
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice, takewhile, zip_longest
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, listed, shortened
from seaid.log.readers.table import Block, Blocks, Table, check_memory, in_pieces, joined

LONGEST_LINE = 1_000_000
"""Most characters of a line of a CSV file: 100 for each of the most columns."""

_CELLS = 500_000
"""Cells that are held as text at a time."""

_MOST_HEAD = 200
"""Most lines of comments and blank lines before the column names."""

_MARKS = {
    b"PK\x03\x04": "a spreadsheet or an archive; save the sheet as CSV in UTF-8",
    b"\x1f\x8b": "compressed; unpack it first",
    b"version https://git-lfs": "a pointer of Git LFS to one; fetch the file with git lfs pull",
}
"""First bytes of files that are no text: {bytes: what it is, and what to do}."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_EXCEL = re.compile(r'"?sep=.?"?\s*')
"""A first line in which spreadsheets write the delimiter of the file."""

_ROW_NAME = re.compile(r'"\d+"')
"""The name of a row in a file that R wrote."""

_DATE = re.compile(r"\d{4}-\d\d?-\d\d?|\d\d?:\d\d")

_WORDS = {
    **{"true": 1.0, "false": 0.0},
    **dict.fromkeys(("na", "n/a", "#n/a", "null", "none"), math.nan),
}
"""{word in place of a number: the number}."""

NO_HEADER = "the first line is numbers: no header?"


_Items = dict[int, int | None]


@dataclass(frozen=True)
class _Header:
    """The names of the columns of a file, and its format; `skipped` lines are before the samples.

    `has_names` is False if the first line is numbers: the names are then 1, 2, 3, ... `width` is
    the number of cells in a line; `items` are the cells of the columns and, of a cell that has a
    list, how many numbers, if any has one.
    """

    path: Path
    names: list[str]
    delimiter: str
    decimal: str
    width: int
    skipped: int
    has_names: bool = True
    items: _Items = field(default_factory=dict)

    def places_of(self, wanted: list[str]) -> list[int]:
        """Return the places of columns. Raises LogError for a duplicate name."""
        places, counts = {x: place for place, x in enumerate(self.names)}, Counter(self.names)
        if twice := sorted(name for name in wanted if counts[name] > 1):
            raise LogError(f"'{self.path}': column named twice: {listed(twice)}")
        return [places[name] for name in wanted]

    def cleaned(self, lines: list[str]) -> list[str]:
        """Return lines with decimal points, and with single spaces if these delimit the cells."""
        if self.decimal == ",":
            lines = [line.replace(",", ".") for line in lines]
        return [" ".join(line.split()) for line in lines] if self.delimiter == " " else lines


def open_csv(path: Path) -> Table:
    """Return the columns of a file delimited by commas, semicolons, tabs, bars or spaces.

    Numbers may have decimal commas where commas do not delimit. Comments behind # or % may come
    first; the last one is the header if it has as many names as the samples. Without a header the
    columns are 1, 2, 3, ....

    Raises LogError for an invalid file, and for one too large to be loaded at once.
    """
    with _opened(path) as file:
        header = _header(path, _lines(path, file))

    def blocks(wanted: list[str], size: int) -> Blocks:
        check_memory(path, path.stat().st_size * (size == sys.maxsize))
        with _opened(path) as file:
            lines = islice(_lines(path, file), header.skipped, None)
            yield from _blocks(header, lines, wanted, size)

    return in_pieces(header.names, blocks, "" if header.has_names else _NUMBERED)


_NUMBERED = (
    f"{NO_HEADER} Name the columns by their numbers, from 1 on, in the description of the "
    "log (time = 1, joint_position = 2, ...), or write a line of names on top"
)


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    with path.open("rb") as raw:
        start = raw.read(max(map(len, _MARKS)))
    for mark, what in _MARKS.items():
        if start.startswith(mark):
            raise LogError(f"'{path}' is not a text file in UTF-8 but {what}")
    try:
        # Spreadsheets write a byte order mark in front of the first name.
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


def _blocks(header: _Header, lines: Iterator[str], wanted: list[str], size: int) -> Blocks:
    """Yield the wanted columns of lines, `size` of them at a time."""
    line, has_samples, at_once = header.skipped + 1, False, _CELLS // len(header.names) + 1
    while True:
        parts, first = list[Block](), line
        while batch := list(islice(lines, min(size - line + first, at_once))):
            parts += filter(None, [_columns(header, batch, wanted, line)])
            line += len(batch)
            count = 8.0 * (line - first) * len(wanted)
            check_memory(header.path, count, pieces=size < sys.maxsize)
        if parts:
            has_samples = True
            yield joined(parts)
        elif line == first:
            break
    if not has_samples:
        raise LogError(
            f"'{header.path}' has column names but no samples: the recording wrote none, or the "
            "file was cut off; record or copy it again"
        )


def _header(path: Path, lines: Iterator[str]) -> _Header:
    """Return the names and the format of a file, from its comments and first three other lines."""
    comments, (first, second, third), (line, line_below) = _head(path, lines)
    numbers = _format_of(first)
    if not first or (comments and numbers):
        header = _named(path, comments[-1], first, line - 1, is_comment=True)
        if numbers is None or numbers.fits(header):
            return header
    if numbers and (comments or not _counts_from_zero(first)):
        return numbers.header(path, line - 1)
    header = _named(path, first, second, line)
    units = _units(path, second, header)
    return _with_units(_named(path, first, third, line_below), units) if units else header


def _with_units(header: _Header, units: list[str]) -> _Header:
    """Return a header whose names have their units in brackets."""
    pairs = zip_longest(header.names, units, fillvalue="")
    return replace(header, names=[f"{name} [{unit}]" if unit else name for name, unit in pairs])


def _units(path: Path, line: str, header: _Header) -> list[str]:
    """Return the units in a line below the names, without brackets; [] for a line of samples."""
    cells = _row(path, header.cleaned([line])[0], header.delimiter)
    filled = [cell.strip() for cell in cells if cell.strip()]
    if not filled or len(cells) != header.width or any(map(_is_sample, filled)):
        return []
    return [cell.strip("()[] ") for cell in cells]


def _is_sample(cell: str) -> bool:
    """Return whether a cell is a number, a list of numbers, a date, or a word for a number."""
    numbers = map(_value, _list(cell) or [cell])
    return None not in numbers or bool(_DATE.search(cell))


def _head(path: Path, lines: Iterator[str]) -> tuple[list[str], list[str], list[int]]:
    """Return comments, three other lines from the names on, and the numbers of the first two."""
    head = {number: line.rstrip("\r\n") for number, line in enumerate(islice(lines, _MOST_HEAD), 1)}
    filled = {x: line for x, line in head.items() if line.strip() and not _EXCEL.fullmatch(line)}
    comments = [*takewhile(lambda line: line[0] in "#%", filled.values())]
    others = dict(islice(filled.items(), len(comments), None))
    comments = [*filter(None, (line.lstrip("#% ") for line in comments))]
    while len(others) > 2 and _has_title(path, [*others.values()][:3]):
        del others[min(others)]
    _check_head(path, "".join(comments), [*others.values()])
    end = len(head) + 1
    return comments, [*others.values(), "", "", ""][:3], [*others, end, end][:2]


def _check_head(path: Path, comments: str, lines: Sequence[str]) -> None:
    """Raise LogError for an empty file, and for one that is no text."""
    # UTF-16 has a zero byte next to each letter.
    if "\0" in "".join([comments, *lines[:1]]):
        raise LogError(f"'{path}' is not a text file in UTF-8 (it has zero bytes); save it as such")
    if not "".join([comments, *lines[:2]]).strip(',;\t "'):
        raise LogError(
            f"'{path}' is empty; a log starts with a line of column names, then a line per sample"
        )


def _has_title(path: Path, lines: list[str]) -> bool:
    """Return whether the first of three lines is a title above those of a table."""
    # Of two titles the second has no delimiter.
    names = lines[1] if re.search(r"[,;\t|]", lines[1]) else lines[2]
    delimiter = _delimiter(names, lines[2], is_comment=False)
    rows = [_row(path, line, delimiter) for line in lines]
    widths = [*map(len, rows)]
    # A title has one cell, or another number than the table; samples do not stand below it.
    is_other = widths[2] > 1 and (widths[0] == 1 or widths[0] not in widths[1:])
    return is_other and not any(map(_is_sample, filter(str.strip, rows[1])))


class _Format(NamedTuple):
    """The format of a line of numbers: delimiter, decimal sign, and number of cells."""

    delimiter: str
    decimal: str
    cells: int

    def fits(self, header: _Header) -> bool:
        """Return whether a header has a name for each of the cells, and their delimiter."""
        is_delimited = self.cells == 1 or header.delimiter == self.delimiter
        return len(header.names) == self.cells and is_delimited

    def header(self, path: Path, skipped: int) -> _Header:
        """Return the header of a file without one, whose columns are 1, 2, 3, ...."""
        names = [str(number) for number in range(1, self.cells + 1)]
        return _Header(path, names, *self, skipped, has_names=False)


def _format_of(line: str) -> _Format | None:
    """Return the format of a line of numbers, None for another line."""
    # The order decides: between semicolons or tabs, commas are decimal signs.
    for delimiter in ";\t|, ":
        cells = line.split() if delimiter == " " else line.split(delimiter)
        for decimal in "." if delimiter == "," else ".,":
            values = [_value(cell.replace(decimal, ".")) for cell in cells]
            if None not in values and any(map(str.strip, cells)):
                return _Format(delimiter, decimal, len(cells))
    return None


def _value(cell: str) -> float | None:
    """Return the number in a cell, or that of its word; NaN for a blank cell, None for a text."""
    text = cell.strip()
    try:
        return float(text) if text else math.nan
    except ValueError:
        return _WORDS.get(text.lower())


def _counts_from_zero(line: str) -> bool:
    """Return whether a line is 0,1,2,...: the names that pandas gives to columns without one."""
    cells = re.split(r"[,;\t|]", line)
    return len(cells) > 2 and [cell.strip() for cell in cells] == [*map(str, range(len(cells)))]


def _named(path: Path, header: str, sample: str, skipped: int, is_comment: bool = False) -> _Header:
    """Return the header in a line of names; the first sample helps to find the delimiter."""
    delimiter = _delimiter(header, sample, is_comment)
    names = [name.strip() for name in _row(path, header, delimiter)]
    cells = _row(path, sample, delimiter)
    has_more = len(cells) == len(names) + 1 and all(map(_is_sample, filter(None, cells)))
    if has_more and not is_comment:
        # R has no name for the column of the names of rows, which is the first, and quotes it.
        names.insert(0 if _ROW_NAME.match(sample) else len(names), "unnamed")
    texts = [] if delimiter == "," else map(str.strip, sample.split(delimiter))
    decimal = "," if any(map(_DECIMAL_COMMA.fullmatch, texts)) else "."
    named = _Header(path, names, delimiter, decimal, len(names), skipped)
    return named if decimal == "," else _with_lists(named, cells)


def _row(path: Path, line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, of which spaces that delimit them count as one."""
    line = " ".join(line.split()) if delimiter == " " else line
    return next(_cells(path, [line], delimiter), [])


def _delimiter(header: str, sample: str, is_comment: bool) -> str:
    """Return the most frequent delimiter of a header, first of those as often in the sample."""
    # The sample decides between delimiters, since a name may have a comma: "F (x, y);t".
    ranked = sorted(",;\t|", key=header.count, reverse=True)
    ranked = [delimiter for delimiter in ranked if delimiter in header]
    fitting = (mark for mark in ranked if sample.count(mark) == header.count(mark))
    if ranked:
        return next(fitting, ranked[0])
    in_both = _format_of(sample) in [_Format(" ", sign, len(header.split())) for sign in ".,"]
    return " " if is_comment or in_both else ","


def _with_lists(header: _Header, cells: list[str]) -> _Header:
    """Return a header with a column for each number of the lists in cells, if there are lists.

    Columns of words, as the kind of a message is, are none then.
    """
    columns: list[str] = []
    items: _Items = {}
    for place, (name, cell) in enumerate(zip(header.names, cells, strict=False)):
        if numbers := _list(cell):
            columns += [f"{name}[{item}]" for item in range(len(numbers))]
            items[place] = len(numbers)
        elif _value(cell) is not None:
            columns.append(name)
            items[place] = None
    return replace(header, names=columns, items=items) if any(items.values()) else header


def _list(cell: str) -> list[str] | None:
    """Return the numbers of a cell as [1, 2] or [1 2] as texts, None for another cell."""
    text = cell.strip()
    if not (text.startswith("[") and text.endswith("]")):
        return None
    return text[1:-1].replace(",", " ").split()


def _columns(header: _Header, lines: list[str], wanted: list[str], first: int) -> Block:
    """Return the wanted columns of lines from line `first` on; {} if all are blank."""
    if not any(line.strip() for line in lines):
        return {}
    places, delimiter = header.places_of(wanted), header.delimiter
    lines = header.cleaned(lines)
    values: Array = np.empty((0, 0))
    # NumPy parses far faster than cell by cell, but its errors have no column and line: whatever it
    # refuses is parsed again below.
    if not header.items and all(line.count(delimiter) == header.width - 1 for line in lines):
        with suppress(ValueError):
            values = np.loadtxt(
                lines, delimiter=delimiter, usecols=places, ndmin=2, comments=None, quotechar='"'
            )
    if len(values) != len(lines):
        values = _parsed(header, lines, places, first)
    return dict(zip(wanted, values.T.copy(), strict=True))


def _parsed(header: _Header, lines: list[str], places: list[int], first: int) -> Array:
    """Return the numbers (T, k) of the cells at some places. Raises LogError, with the line."""
    numbered = enumerate(_cells(header.path, lines, header.delimiter), first)
    rows = ((line, _texts(header, cells, line)) for line, cells in numbered if cells)
    named = [(place, header.names[place]) for place in places]
    return np.array(
        [[_number(header.path, line, name, row[x]) for x, name in named] for line, row in rows]
    )


def _texts(header: _Header, cells: list[str], line: int) -> list[str]:
    """Return the text of each column of a line, those of lists one by one."""
    _check_width(header, cells, line)
    if not header.items:
        return cells
    texts: list[str] = []
    for place, count in header.items.items():
        numbers = [cells[place]] if count is None else _list(cells[place]) or []
        if len(numbers) != (count or 1):
            name = header.names[len(texts)].removesuffix("[0]")
            raise LogError(
                f"'{header.path}', line {line}: column '{shortened(name)}' has "
                f"'{shortened(cells[place])}', and a list of {count} numbers before"
            )
        texts += numbers
    return texts


def _check_width(header: _Header, cells: list[str], line: int) -> None:
    """Raise LogError for a line with another number of cells than the header."""
    if len(cells) == header.width:
        return
    if any("\0" in cell for cell in cells):
        raise LogError(
            f"'{header.path}', line {line}: has zero bytes, as a file that was not written to its "
            "end: remove the line, and those behind it that are no samples"
        )
    commas = header.delimiter == "," and len(cells) > header.width
    hint = "; decimal commas? Delimit the columns by semicolons, or write decimal points"
    raise LogError(
        f"'{header.path}' is not a table: line {line} has {len(cells)} cells, the first line "
        f"{header.width} {'column names' if header.has_names else 'numbers'}{hint * commas}"
    )


def _cells(path: Path, lines: list[str], delimiter: str) -> Iterator[list[str]]:
    """Yield the cells of each line."""
    try:
        yield from csv.reader(lines, delimiter=delimiter)
    except csv.Error as problem:
        raise LogError(f"'{path}' is not a table: {problem}") from None


def _number(path: Path, line: int, column: str, cell: str) -> float:
    """Return the number in a cell. Raises LogError for a text."""
    value = _value(cell)
    if value is None:
        hint = ": empty it if nothing was measured"
        hint = "; write the time as seconds" if _DATE.search(cell) else hint
        hint = "; write a decimal point" if _DECIMAL_COMMA.fullmatch(cell.strip()) else hint
        raise LogError(
            f"'{path}', line {line}: column '{shortened(column)}' has '{shortened(cell)}', which "
            f"is not a number{hint}"
        )
    return value
