"""JSON: a list of records, or columns as lists, also inside an object with constants."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array, as_float
from seaid.errors import LogError, reason_of
from seaid.log.channels import refusal
from seaid.log.readers.table import Refused, Table, check_columns, check_memory, held, no_numbers

_GROWTH = 10.0
"""Bytes in memory per byte of JSON."""

_DEEPEST = 20
"""Most levels of lists and objects."""


def open_json(path: Path) -> Table:
    """Return the columns of a JSON file: [{"t": 0.0, "q": 0.1}, ...], {"t": [...], "q": [...]}.

    If the list of records is in an object, as {"kp": 100, "entries": [...]}, the numbers of the
    object are constant columns. A list in a record is "q[0]", "q[1]", ..., an object
    "motor.current". Raises LogError for other content.
    """
    content = _content(path)
    values = content if isinstance(content, Mapping) else {}
    constants = {name: as_float(x) for name, x in values.items() if isinstance(x, Real)}
    # With two lists of records it is not known which is the log, and the object is read by names.
    lists = [*filter(_are_records, (content, *values.values()))]
    data = _record_columns(path, lists[0]) if len(lists) == 1 else _lists_by_name(path, values)
    if not data:
        raise refusal("no_columns", path=path)
    length = max(map(len, data.values()))
    check_columns(path, len(data) + len(constants))
    check_memory(path, 8.0 * length * (len(data) + len(constants)))
    for name, value in constants.items():
        # A column of the records has precedence over a constant of its name.
        data.setdefault(name, [value] * length)
    return held(path, {name: _numbers(path, name, values) for name, values in data.items()})


def _content(path: Path) -> Any:
    check_memory(path, _GROWTH * path.stat().st_size)
    try:
        return json.loads(path.read_bytes().decode("utf-8-sig"))
    except (ValueError, RecursionError) as problem:
        raise LogError(f"'{path}' is not valid JSON, or cut off: {reason_of(problem)}") from None


def _are_records(value: Any) -> bool:
    return isinstance(value, list) and value != [] and all(isinstance(x, Mapping) for x in value)


def _record_columns(path: Path, records: list[Any]) -> dict[str, list[Any]]:
    """Return the columns of records, or of lists; None for a value that one lacks."""
    data: dict[str, list[Any]] = {}
    for row, record in enumerate(records):
        for name, value in _flat(path, "", record):
            if name not in data:
                data[name] = [None] * len(records)
                check_columns(path, len(data))
                check_memory(path, 8.0 * len(records) * len(data))
            data[name][row] = value
    return data


def _flat(
    path: Path, name: str, value: Any, depth: int = 0, *, with_lists: bool = True
) -> Iterator[tuple[str, Any]]:
    """Yield what is in objects, and in lists on request, by name."""
    if depth > _DEEPEST:
        raise refusal("too_deep", path=path, levels=_DEEPEST)
    if isinstance(value, Mapping):
        dot = f"{name}." if name else ""
        for key, entry in value.items():
            yield from _flat(path, f"{dot}{key}", entry, depth + 1, with_lists=with_lists)
    elif isinstance(value, list) and with_lists:
        for index, entry in enumerate(value):
            yield from _flat(path, f"{name}[{index}]", entry, depth + 1)
    else:
        yield name, value


def _lists_by_name(path: Path, content: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return the lists in an object by name."""
    data: dict[str, list[Any]] = {}
    for name, entry in _flat(path, "", content, with_lists=False):
        if isinstance(entry, list) and entry:
            rows = all(isinstance(row, list) for row in entry)
            columns = _record_columns(path, entry) if rows else {"": entry}
            data |= {f"{name}{place}": column for place, column in columns.items()}
    return data


def _numbers(path: Path, name: str, values: list[Any]) -> Array | Refused:
    """Return a column as numbers; null is NaN, and anything else is refused when it is wanted."""
    strange = next((value for value in values if not isinstance(value, Real | None)), None)
    if strange is not None:
        return Refused(no_numbers(path, name, type(strange).__name__, (len(values),)))
    return np.array([math.nan if value is None else as_float(value) for value in values])
