"""Table: the columns of a log file, whatever its format, loaded when they are wanted."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError, unknown_name

Block = dict[str, Array]
Blocks = Iterator[Block]


@dataclass(frozen=True, eq=False)
class Table:
    """The names of columns, and how to get the samples of some of them.

    `load(names)` gives {name: samples (T,)}; `blocks(names, size)` the same in pieces, None where
    the format cannot be read in pieces. `clocks` is {column: time column [s] sampled with it} where
    the file itself says so. `sparse`: NaN says that a message did not have the value.
    """

    names: Sequence[str]
    load: Callable[[list[str]], Block]
    blocks: Callable[[list[str], int], Blocks] | None = None
    clocks: Mapping[str, str] = field(default_factory=dict)
    sparse: bool = False

    def missing(self, name: str) -> str:
        """Return the sentence for a column that is not there, with the nearest name.

        A name with a topic, as "/joint_states/position[elbow]", is told the topics.
        """
        topics = _topics(self)
        if not topics:
            return unknown_name("column", name, self.names)
        topic = next((one for one in topics if name.startswith(f"{one}/")), None)
        if topic is None:
            return unknown_name("topic", name, topics)
        return unknown_name("column", name, [one for one in self.names if topic in one])


def _topics(table: Table) -> list[str]:
    """Return the topics of a bag: all its columns' clocks stand directly below them."""
    clocks = dict.fromkeys(table.clocks.values())
    found = {clock.removesuffix("/header.stamp").removesuffix("/bag_time") for clock in clocks}
    return sorted(one for one in found if one.startswith("/"))


def samples(path: Path, name: str, values: Any) -> Array:
    """Return a column as numbers. Raises LogError where it is not a row of numbers."""
    values = np.asarray(values)
    if values.dtype.kind not in "biuf" or values.ndim != 1:
        raise LogError(
            f"'{path}': column '{name}' must be a row of numbers, found {values.dtype} "
            f"of shape {values.shape}"
        )
    numbers: Array = values.astype(np.float64)
    return numbers


def check_lengths(path: Path, block: Mapping[str, Array]) -> None:
    """Check that columns are equally long. Raises LogError."""
    lengths = {name: len(values) for name, values in block.items()}
    if len(set(lengths.values())) > 1:
        raise LogError(f"'{path}': columns are not equally long: {lengths}")


def with_parts(name: str, shape: Sequence[int]) -> list[str]:
    """Return the column name, and for an array of two dimensions "name[0]", "name[1]", ..."""
    parts = range(shape[1]) if len(shape) == 2 else ()
    return [name, *(f"{name}[{index}]" for index in parts)]


def part_of(name: str) -> tuple[str, int | None]:
    """Return the array of a column, and which of its columns: "q[2]" is ("q", 2)."""
    base, bracket, index = name.rpartition("[")
    if bracket and index.endswith("]") and index[:-1].isdigit():
        return base, int(index[:-1])
    return name, None


def optional(module: str, extra: str, path: Path) -> Any:
    """Import an optional package. Raises LogError naming the extra it comes with."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise _not_installed(module, extra, path) from None


def check_installed(module: str, extra: str, path: Path) -> None:
    """Check that an optional package is there, without loading it. Raises as `optional` does."""
    try:
        found = find_spec(module)
    except ImportError:
        found = None
    if found is None:
        raise _not_installed(module, extra, path)


def _not_installed(module: str, extra: str, path: Path) -> LogError:
    return LogError(
        f"'{path}': '{path.suffix}' logs need the package {module.split('.')[0]}, which is not "
        f"installed; get it with pip install 'seaid[{extra}]'"
    )
