"""Table: the columns of a log file, whatever its format, loaded when they are wanted."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaid._arrays import Array
from seaid.errors import LogError, listed, reason_of, shortened, unknown_name
from seaid.log.readers.memory import MOST_COLUMNS

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

        A name with a topic, as "/joint_states/position[elbow]", gets the topics.
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


@contextmanager
def damaged(path: Path, kind: str) -> Iterator[None]:
    """Turn what a library says of a file that is damaged, or no `kind`, into a LogError."""
    with _in_words(f"'{path}' is not {kind}, or a damaged one"):
        yield


@contextmanager
def damaged_column(path: Path, name: str) -> Iterator[None]:
    """Turn what a library says of a column whose data are damaged into a LogError."""
    with _in_words(f"'{path}': column '{shortened(name)}' cannot be read"):
        yield


@contextmanager
def _in_words(what: str) -> Iterator[None]:
    try:
        yield
    except LogError:
        raise
    except Exception as problem:  # parsers of untrusted bytes let whatever they meet through
        raise LogError(f"{what}: {reason_of(problem)}") from None


def is_number(kind: np.dtype[Any]) -> bool:
    """Tell whether an array's type is one of real numbers or truth values."""
    return kind.kind in "biuf"


def no_numbers(path: Path, name: str, kind: object, shape: object) -> LogError:
    """Return the error for a column that is no row of numbers."""
    return LogError(
        f"'{path}': column '{shortened(name)}' must be a row of numbers, found "
        f"{shortened(str(kind))} of shape {shape}"
    )


def samples(path: Path, name: str, values: Any) -> Array:
    """Return a column as numbers. Raises LogError where it is not a row of numbers."""
    values = np.asarray(values)
    if not is_number(values.dtype) or values.ndim != 1:
        raise no_numbers(path, name, values.dtype, values.shape)
    return as_floats(values)


def as_floats(values: NDArray[Any]) -> Array:
    """Return numbers as float64; what is too large for it is infinite."""
    with np.errstate(all="ignore"):
        numbers: Array = values.astype(np.float64)
    return numbers


def check_lengths(path: Path, lengths: Mapping[str, int]) -> None:
    """Check that columns are equally long. Raises LogError."""
    if len(set(lengths.values())) > 1:
        found = listed(f"'{shortened(name)}' {length}" for name, length in lengths.items())
        raise LogError(f"'{path}': columns are not equally long: {found}")


def with_parts(name: str, shape: Sequence[int] | None) -> list[str]:
    """Return the column name, and for an array of two dimensions "name[0]", "name[1]", ...

    An array with more columns than a log may have is no set of channels: it has no parts.
    """
    many = shape is not None and len(shape) == 2 and shape[1] <= MOST_COLUMNS
    return [name, *(f"{name}[{index}]" for index in range(shape[1] if shape and many else 0))]


def part_of(name: str) -> tuple[str, int | None]:
    """Return the array of a column, and which of its columns: "q[2]" is ("q", 2)."""
    base, bracket, index = name.rpartition("[")
    if bracket and index.endswith("]") and index[:-1].isdecimal() and index.isascii():
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
