"""CSV and other tables of text: a line of column names, if any, then lines of samples."""

from __future__ import annotations

import csv
import math
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice, takewhile, zip_longest
from pathlib import Path
from typing import TextIO

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid._progress import counted
from seaid.errors import LogError, listed, shortened
from seaid.log.channels import refusal
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

_TO_POINT = {".": str.maketrans({}), ",": str.maketrans(",.", ".,")}
"""{decimal sign of a number: table that exchanges it for a point, and a point for it}."""

_GROUPED = re.compile(
    r"[+-]?[1-9]\d{0,2}([,'’\u00a0\u202f])\d{3}(?:\1\d{3})*(?:\.\d*)?(?:[eE][+-]?\d+)?"
)
"""A number with a decimal point and with separators of thousands: "1,234.5", "12'345"."""

_EXCEL = re.compile(r'"?sep=.?"?\s*')
"""A first line in which spreadsheets write the delimiter of the file."""

_ROW_NAME = re.compile(r'"\d+"')
"""The name of a row in a file that R wrote."""

UNNAMED = "unnamed"
"""The name of a column without one, next to others that have names."""

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

    def fits(self, numbers: _Header) -> bool:
        """Return whether it has a name for each cell of a line of numbers, and their delimiter."""
        is_delimited = numbers.width == 1 or self.delimiter == numbers.delimiter
        return len(self.names) == numbers.width and is_delimited


def open_csv(path: Path) -> Table:
    """Return the columns of a file delimited by commas, semicolons, tabs, bars or spaces.

    Numbers may have decimal commas where commas do not delimit, and separators of thousands where
    the cells of a column leave no doubt of them. Comments behind # or % may come
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
    f"{NO_HEADER} Name the columns by their numbers, from 1 on, in the description of the log "
    "(time = 1, joint_position = 2, ...)"
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
        raise refusal("no_utf8", path=path, reason=problem.reason, byte=problem.start) from None


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    for number, line in enumerate(iter(partial(file.readline, LONGEST_LINE), ""), 1):
        if len(line) == LONGEST_LINE:
            raise refusal("long_line", path=path, line=number, most=LONGEST_LINE)
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
        raise refusal("no_samples", path=header.path)


def _header(path: Path, lines: Iterator[str]) -> _Header:
    """Return the names and the format of a file, from its comments and first other lines."""
    comments, (first, *rows), (line, below) = _head(path, lines)
    numbers = _numbered(path, first, line - 1)
    if not first or (comments and numbers):
        header = _named(path, comments[-1], [first], line - 1, is_comment=True)
        if numbers is None or header.fits(numbers):
            return header
    # 0,1,2,... are the names that pandas gives to columns without one.
    if numbers and (comments or not _counts(re.split(r"[,;\t|]", first), 0)):
        return numbers
    header = _named(path, first, rows, line)
    return _with_units(path, rows[0], _named(path, first, rows[1:], below), header.width) or header


def _with_units(path: Path, line: str, header: _Header, width: int) -> _Header | None:
    """Return a header with the units below its names in brackets, None for a line of samples."""
    cells = [cell.strip() for cell in _row(path, line, header.delimiter)]
    if len(cells) != width or not any(cells) or any(map(_is_sample, filter(None, cells))):
        return None
    pairs = zip_longest(header.names, (cell.strip("()[] ") for cell in cells), fillvalue="")
    return replace(header, names=[f"{name} [{unit}]" if unit else name for name, unit in pairs])


def _is_sample(cell: str) -> bool:
    """Return whether a cell is a number, a list of numbers, a date, or a word for a number."""
    texts = _list(cell) or [cell]
    is_number = any(None not in [_value(text, sign) for text in texts] for sign in ".,")
    return is_number or bool(_DATE.search(cell))


def _head(path: Path, lines: Iterator[str]) -> tuple[list[str], list[str], list[int]]:
    """Return comments, three or more lines from the names on, and the numbers of the first two."""
    head = {number: line.rstrip("\r\n") for number, line in enumerate(islice(lines, _MOST_HEAD), 1)}
    filled = {x: line for x, line in head.items() if line.strip() and not _EXCEL.fullmatch(line)}
    comments = [*takewhile(lambda line: line[0] in "#%", filled.values())]
    others = dict(islice(filled.items(), len(comments), None))
    comments = [*filter(None, (line.lstrip("#% ") for line in comments))]
    while len(others) > 2 and _has_title(path, [*others.values()][:3]):
        del others[min(others)]
    _check_head(path, "".join(comments), [*others.values()])
    end = len(head) + 1
    return comments, [*others.values(), "", "", ""], [*others, end, end][:2]


def _check_head(path: Path, comments: str, lines: Sequence[str]) -> None:
    """Raise LogError for an empty file, and for one that is no text."""
    # UTF-16 has a zero byte next to each letter.
    if "\0" in "".join([comments, *lines[:1]]):
        raise LogError(f"'{path}' is not a text file in UTF-8 (it has zero bytes); save it as such")
    if not "".join([comments, *lines[:2]]).strip(',;\t "'):
        raise refusal("empty", path=path)


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


def _numbered(path: Path, line: str, skipped: int) -> _Header | None:
    """Return the header 1, 2, 3, ... of a line of numbers, None for another line."""
    # The order decides: between semicolons or tabs, commas are decimal signs.
    for delimiter in ";\t|, ":
        cells = line.split(None if delimiter == " " else delimiter)
        decimal = "." if delimiter == "," else _decimal_of(cells)
        is_read = None not in [_value(x, decimal) for x in cells] and any(map(str.strip, cells))
        # A comma may be a separator of thousands only where another sign delimits.
        if is_read and (delimiter in line or not _is_grouped(line, decimal)):
            names = [str(number) for number in range(1, len(cells) + 1)]
            return _Header(path, names, delimiter, decimal, len(cells), skipped, has_names=False)
    return None


def _value(cell: str, decimal: str = ".") -> float | None:
    """Return the number in a cell, or that of its word; NaN for a blank cell, None for a text."""
    text = cell.strip().translate(_TO_POINT[decimal])
    if _is_grouped(cell, decimal):
        text = re.sub("[,'’\u00a0\u202f]", "", text)
    try:
        return float(text) if text else math.nan
    except ValueError:
        return _WORDS.get(text.lower())


def _is_grouped(cell: str, decimal: str) -> bool:
    """Return whether a cell is a number with separators of thousands."""
    return bool(_GROUPED.fullmatch(cell.strip().translate(_TO_POINT[decimal])))


def _counts(cells: Sequence[str], *starts: int) -> bool:
    """Return whether three or more cells are a start and the whole numbers behind it."""
    counts = ([str(start + place) for place in range(len(cells))] for start in starts)
    return len(cells) > 2 and [cell.strip() for cell in cells] in [*counts]


def _named(
    path: Path, header: str, samples: Sequence[str], skipped: int, is_comment: bool = False
) -> _Header:
    """Return the header in a line of names; the first sample helps to find the delimiter."""
    sample, delimiter = samples[0], _delimiter(header, samples[0], is_comment)
    names = [*map(str.strip, _row(path, header, delimiter))]
    cells = _row(path, sample, delimiter)
    has_more = len(cells) == len(names) + 1 and all(map(_is_sample, filter(None, cells)))
    if has_more and not is_comment:
        # R has no name for the column of the names of rows, which is the first. A last cell that is
        # empty is behind a delimiter at the end of the line.
        firsts = [_row(path, line, delimiter)[0] for line in filter(str.strip, samples)]
        is_first = _ROW_NAME.match(sample) or (cells[-1].strip() and _counts(firsts, 0, 1))
        names.insert(0 if is_first else len(names), UNNAMED)
    decimal = "." if delimiter == "," else _decimal_of(sample.split(delimiter))
    named = _Header(path, names, delimiter, decimal, len(names), skipped)
    return named if decimal == "," else _with_lists(named, cells)


def _decimal_of(cells: Sequence[str]) -> str:
    """Return the decimal sign of a line: a cell that has one meaning decides before "1,234"."""
    read = {x: [sign for sign in ".," if _value(x, sign) is not None] for x in cells}
    if [","] in read.values():
        return ","
    has_commas = ["."] not in read.values() and any("," in x for x, signs in read.items() if signs)
    return "," if has_commas else "."


def _row(path: Path, line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, of which spaces that delimit them count as one."""
    return next(_cells(path, [_single_spaced(line, delimiter)], delimiter), [])


def _single_spaced(line: str, delimiter: str) -> str:
    """Return a line with single spaces if these delimit its cells."""
    return " ".join(line.split()) if delimiter == " " else line


def _delimiter(header: str, sample: str, is_comment: bool) -> str:
    """Return the most frequent delimiter of a header, first of those as often in the sample."""
    # The sample decides between delimiters, since a name may have a comma: "F (x, y);t".
    ranked = sorted(",;\t|", key=header.count, reverse=True)
    ranked = [delimiter for delimiter in ranked if delimiter in header]
    fitting = (mark for mark in ranked if sample.count(mark) == header.count(mark))
    if ranked:
        return next(fitting, ranked[0])
    count, numbers = len(header.split()), _numbered(Path(), sample.replace('"', ""), 0)
    # The column of the names of rows has none: several names may be one fewer than the numbers.
    in_both = numbers and numbers.delimiter == " " and numbers.width - count in (0, count > 1)
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
    lines = [_single_spaced(line, delimiter) for line in lines]
    values: Array = np.empty((0, 0))
    # NumPy parses far faster than cell by cell, but its errors have no column and line: whatever it
    # refuses is parsed again below.
    if not header.items and all(line.count(delimiter) == header.width - 1 for line in lines):
        points = (line.translate(_TO_POINT[header.decimal]) for line in lines)
        with suppress(ValueError):
            values = np.loadtxt(
                points, delimiter=delimiter, usecols=places, ndmin=2, comments=None, quotechar='"'
            )
    if len(values) != len(lines) or np.any(_jumps_at_thousand(values)):
        values = _parsed(header, lines, places, first)
    return dict(zip(wanted, values.T.copy(), strict=True))


def _parsed(header: _Header, lines: list[str], places: list[int], first: int) -> Array:
    """Return the numbers (T, k) of the cells at some places. Raises LogError, with the line."""
    numbered = enumerate(_cells(header.path, lines, header.delimiter), first)
    rows = {line: _texts(header, cells, line) for line, cells in numbered if cells}
    return np.column_stack([_numbers(header, place, rows) for place in places])


def _numbers(header: _Header, place: int, rows: Mapping[int, list[str]]) -> Array:
    """Return the numbers of a column {line: texts}, with one decimal sign in all of its cells.

    Raises LogError for a text, and for a separator that may be of thousands or a decimal sign.
    """
    cells = [texts[place] for texts in rows.values()]
    own, unread = _read(cells, header.decimal)
    if not (np.any(unread) or _is_doubtful(cells, own, header.decimal)):
        return own
    # The other decimal sign, which those of a single column may have.
    other, strange = _read(cells, "," if header.decimal == "." else ".")
    if np.any(unread) and not np.any(strange) and header.delimiter != ",":
        return other
    wrong = np.nan_to_num(own) != np.nan_to_num(other)
    for number in np.flatnonzero(unread if np.any(unread | strange) else wrong)[:1]:
        raise _no_number(header, place, rows, int(number))
    return own


def _is_doubtful(cells: Sequence[str], numbers: Array, decimal: str) -> bool:
    """Return whether cells have separators of thousands, or a decimal sign that may be one."""
    has_groups = any(_is_grouped(cell, decimal) for cell in cells)
    return has_groups or bool(np.any(_jumps_at_thousand(numbers)))


def _read(cells: Sequence[str], decimal: str) -> tuple[Array, BoolArray]:
    """Return the numbers of cells (T,), and which of these have none."""
    values = [_value(cell, decimal) for cell in cells]
    return np.array(values, dtype=float), np.array([value is None for value in values])


def _jumps_at_thousand(values: Array) -> BoolArray:
    """Return the mask (T - 1, ...) of steps between 100, ..., 999 and less than ten.

    Counts with a point behind thousands, "999" and then "1.000", fall there by a factor.
    """
    size = np.abs(values)
    is_below = (size >= 100) & (size < 1000) & (values == np.round(values))
    is_above = (size >= 1) & (size < 10)
    return np.asarray(is_below[:-1] & is_above[1:] | is_above[:-1] & is_below[1:])


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
            cell = {"column": shortened(name), "cell": shortened(cells[place])}
            raise refusal("other_list", path=header.path, line=line, count=count, **cell)
        texts += numbers
    return texts


def _check_width(header: _Header, cells: list[str], line: int) -> None:
    """Raise LogError for a line with another number of cells than the header."""
    if (count := len(cells)) == header.width:
        return
    if any("\0" in cell for cell in cells):
        raise refusal("zero_bytes", path=header.path, line=line)
    has_commas = header.delimiter == "," and count > header.width
    first = f"{header.width} {'column names' if header.has_names else 'numbers'}"
    sizes = {"line": line, "cells": counted(count, "cell"), "first": first}
    raise refusal("decimal_commas" if has_commas else "other_width", path=header.path, **sizes)


def _cells(path: Path, lines: list[str], delimiter: str) -> Iterator[list[str]]:
    """Yield the cells of each line."""
    try:
        yield from csv.reader(lines, delimiter=delimiter)
    except csv.Error as problem:
        raise LogError(f"'{path}' is not a table: {problem}") from None


def _no_number(header: _Header, place: int, rows: Mapping[int, list[str]], number: int) -> LogError:
    """Return the error of a cell that is a text, or whose separator has two meanings."""
    line, cell = [(line, texts[place]) for line, texts in rows.items()][number]
    values = {value for sign in ".," if (value := _value(cell, sign)) is not None}
    code = "date" if _DATE.search(cell) else ("no_number", "other_sign", "two_numbers")[len(values)]
    meanings = " or ".join(f"{value:.9g}" for value in sorted(values))
    where = {"path": header.path, "line": line, "cell": shortened(cell)}
    return refusal(code, column=shortened(header.names[place]), meanings=meanings, **where)
