"""TOML and JSON files of users as plain data: bounded in size and depth, with finite numbers only.

Nothing in them is evaluated. What a value means is checked by the module that asked for the file.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from seaid.arrays import as_float, number
from seaid.errors import SeaidError, reason_of, shortened, shown

MOST_TOML_BYTES = 2**20
"""The drives of a hundred joints take 50 kB."""

MOST_JSON_BYTES = 2**24
"""The planned motion of seven joints takes 100 kB."""

_MOST_DEPTH = 32
_MOST_DOTS = 200
"""In one line of TOML: the time of `tomllib` grows with the square of the parts of a dotted key."""

_LONGEST_PLACE = 200
_SURROGATE = re.compile("[\ud800-\udfff]")
_BARE = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)

_Place = tuple["_Place", str | int] | None


def read_toml(path: str | Path, what: str, error: type[SeaidError]) -> dict[str, Any]:
    """Return the tables of a TOML file of at most `MOST_TOML_BYTES`.

    `what` names the file's content in messages, as "drivetrains". Raises `error`, with the file and
    the place in it, for a file that cannot be read or is no TOML, and for dates, numbers that are
    not finite and tables that lie too deep.
    """

    def tables(text: str) -> Any:
        for place, line in enumerate(text.splitlines(), 1):
            if line.count(".") > _MOST_DOTS:
                raise ValueError(f"more than {_MOST_DOTS} dots (at line {place})")
        return tomllib.loads(text)

    found: dict[str, Any] = _read(path, what, "is not valid TOML", error, MOST_TOML_BYTES, tables)
    return found


def read_json(path: str | Path, what: str, error: type[SeaidError]) -> Any:
    """Return the content of a JSON file of at most `MOST_JSON_BYTES`.

    `what` names the file's content in messages, as "trajectory". Raises `error`, with the file and
    the place in it, for a file that cannot be read or is no JSON, and for numbers that are not
    finite, a key that stands twice and lists that lie too deep.
    """

    def content(text: str) -> Any:
        return json.loads(text, object_pairs_hook=_without_twins, parse_constant=_no_number)

    return _read(path, what, "is not JSON", error, MOST_JSON_BYTES, content)


def numbers(where: str, value: Any, error: type[SeaidError]) -> Any:
    """Return a number, or lists of numbers, of JSON or TOML as it is.

    Raises `error` naming `where` for anything else in it: texts and true are no numbers here.
    """
    stack = [value]
    while stack:
        one = stack.pop()
        if isinstance(one, list):
            stack += one
        else:
            number(where, one, error)
    return value


def _read(
    path: str | Path,
    what: str,
    wrong: str,
    error: type[SeaidError],
    most_bytes: int,
    parse: Callable[[str], Any],
) -> Any:
    try:
        mode = os.stat(path).st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # a pipe would be waited for
            raise error(f"{what} '{path}' is a pipe, a socket or a device; it must be a file")
        with open(path, "rb") as file:
            data = file.read(most_bytes + 1)
    except OSError as problem:
        raise error(f"cannot read {what} '{path}': {reason_of(problem)}") from None
    except ValueError as problem:  # a path with a zero byte, or with letters no file system has
        raise error(f"cannot read {what} {shown(str(path))}: {reason_of(problem)}") from None
    where = f"{what} '{path}'"
    if len(data) > most_bytes:
        raise error(f"{where} is longer than {most_bytes // 2**20} MB, which none is")
    try:
        content = parse(data.decode("utf-8-sig"))
    except RecursionError:
        raise error(f"{where} {wrong}: tables or lists lie too deep in each other") from None
    except ValueError as problem:  # of TOML, JSON, UTF-8, and of integers of thousands of digits
        raise error(f"{where} {wrong}: {reason_of(problem)}") from None
    _check(where, content, error)
    return content


def _check(where: str, content: Any, error: type[SeaidError]) -> None:
    """Raise `error` naming the first value that is too deep, not finite or no plain data."""
    stack: list[tuple[Any, _Place, int]] = [(content, None, 0)]
    while stack:
        value, place, depth = stack.pop()
        problem = _problem(value, depth)
        if problem is not None:
            raise error(f"{where}: {_text(place) or 'it'} {problem}")
        if isinstance(value, dict):
            broken = [key for key in value if _SURROGATE.search(key)]
            if broken:
                raise error(f"{where}: {shown(broken[0])} is no text: half of a letter is missing")
            stack += [(one, (place, key), depth + 1) for key, one in value.items()]
        elif isinstance(value, list):
            stack += [(one, (place, index), depth + 1) for index, one in enumerate(value)]


def _problem(value: Any, depth: int) -> str | None:
    if isinstance(value, dict | list):
        return f"lies deeper than {_MOST_DEPTH} tables or lists" if depth >= _MOST_DEPTH else None
    if isinstance(value, str):
        return "is no text: half of a letter is missing" if _SURROGATE.search(value) else None
    if value is None or isinstance(value, bool):
        return None
    if not isinstance(value, int | float):
        return f"must be a number, a text, a list or a table, found {shown(str(value))}"
    is_finite = math.isfinite(as_float(value))
    return None if is_finite else "must be a finite number, of 308 digits at most"


def _text(place: _Place) -> str:
    """Return a place as a.b[2]."""
    keys: list[str | int] = []
    while place is not None:
        place, key = place
        keys.append(key)
    text = ""
    for one in reversed(keys):
        name = one if isinstance(one, str) and _BARE.fullmatch(one) else shown(one)
        text += f"[{one}]" if isinstance(one, int) else f".{name}" if text else str(name)
    return shortened(text, _LONGEST_PLACE)


def _without_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twin = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"key {shown(twin)} stands twice in one object")
    return found


def _no_number(word: str) -> Iterator[None]:
    raise ValueError(f"{word} is no number of JSON; give a finite one, or null")
