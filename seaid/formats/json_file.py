"""JSON: a list of records, columns as lists, or either inside an object with constants beside."""

from __future__ import annotations

import json
from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from seaid.errors import LogError
from seaid.formats.table import Block, Table, samples


def open_json(path: Path) -> Table:
    """Return the columns of a JSON file: [{"t": 0.0, "q": 0.1}, ...], {"t": [...], "q": [...]}.

    Where such a list of records lies in an object, as {"kp": 100, "entries": [...]}, numbers beside
    it are constant columns. A list in a record is "q[0]", "q[1]", ..., an object "motor.current".
    Raises LogError for what is neither.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as problem:
        raise LogError(f"cannot read '{path}': {problem.strerror}") from None
    except (ValueError, RecursionError) as problem:
        raise LogError(f"'{path}' is not valid JSON, or cut off: {problem}") from None
    constants: dict[str, float] = {}
    records: Any = content
    if isinstance(content, Mapping):
        constants = {name: float(one) for name, one in content.items() if isinstance(one, Real)}
        lists = [one for one in content.values() if _are_records(one)]
        records = lists[0] if len(lists) == 1 else content
    data = _of_records(records) if _are_records(records) else _of_lists(records)
    if not data:
        raise LogError(
            f"'{path}' has no columns; a JSON log is a list of records, or lists of numbers by name"
        )
    length = max(len(values) for values in data.values())
    for name, value in constants.items():
        data.setdefault(name, [value] * length)

    def load(wanted: list[str]) -> Block:
        return {name: samples(path, name, _filled(data[name])) for name in wanted}

    return Table(list(data), load)


def _are_records(value: Any) -> bool:
    return (
        isinstance(value, list) and bool(value) and all(isinstance(one, Mapping) for one in value)
    )


def _of_records(records: list[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the columns of records; what a record does not have is None."""
    data: dict[str, list[Any]] = {}
    for row, record in enumerate(records):
        for name, value in _flat("", record):
            data.setdefault(name, [None] * len(records))[row] = value
    return data


def _flat(name: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        dot = f"{name}." if name else ""
        return [pair for key, one in value.items() for pair in _flat(f"{dot}{key}", one)]
    if isinstance(value, list):
        return [pair for index, one in enumerate(value) for pair in _flat(f"{name}[{index}]", one)]
    return [(name, value)]


def _of_lists(value: Any) -> dict[str, list[Any]]:
    """Return the lists in an object; a list of equally long lists is a column each."""
    data: dict[str, list[Any]] = {}
    for name, one in value.items() if isinstance(value, Mapping) else ():
        if isinstance(one, Mapping):
            data.update({f"{name}.{key}": inner for key, inner in _of_lists(one).items()})
        elif isinstance(one, list) and one and all(isinstance(row, list) for row in one):
            if len({len(row) for row in one}) == 1:
                for index, column in enumerate(zip(*one, strict=True)):
                    data[f"{name}[{index}]"] = list(column)
        elif isinstance(one, list) and one:
            data[name] = one
    return data


def _filled(values: list[Any]) -> Any:
    if not any(isinstance(one, str | list | Mapping) for one in values):
        return np.array([np.nan if one is None else one for one in values], dtype=np.float64)
    return np.array([str(one) for one in values])
