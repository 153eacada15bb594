"""Table: the columns of a log file of any format, loaded on demand within the free memory."""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaid._arrays import Array
from seaid.errors import LogError, listed, reason_of, shortened, unknown_name
from seaid.log.channels import refusal


def free_memory() -> float:
    """Return the bytes of memory that this process may still take; infinite if unknown.

    It is the smallest of the free memory of the machine, of the process's address space, and of
    the control group of a container.
    """
    free = [math.inf]
    with suppress(OSError, ValueError, IndexError, StopIteration):  # not Linux
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free += [1024.0 * next(int(line.split()[1]) for line in lines if "MemAvailable" in line)]
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource  # not on Windows

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        if limit != resource.RLIM_INFINITY:
            free += [float(limit - pages * resource.getpagesize())]
    # A container or a batch system kills a process long before the machine's memory is full.
    with suppress(OSError, ValueError):  # "max" is no number: no limit
        group = Path("/sys/fs/cgroup")
        used, most = (group / f"memory.{x}" for x in ("current", "max"))
        free += [float(most.read_text("ascii")) - float(used.read_text("ascii"))]
    return min(free)


MOST_COLUMNS = 10_000
"""Most columns of a log; more are an image, a point cloud, or a damaged file."""

LONGEST_NAME = 1_000
"""Most characters in the name of a column."""

MEMORY_SHARE = 0.25
"""Largest share of the free memory for samples read at once; later steps copy them."""

MOST_BYTES, MOST_GROWTH = 1e9, 20.0
"""A file may declare this many bytes of samples, or this multiple of its size if that is more."""


def check_memory(path: Path, size: float, pieces: bool = False) -> None:
    """Raise LogError, with advice, if `size` bytes of samples read at once are too many."""
    stored, free = size_of(path), max(free_memory(), 0.0)
    # A few bytes of a damaged or malicious header may declare any number of samples.
    allowed = max(MOST_BYTES, MOST_GROWTH * stored)
    if size <= min(MEMORY_SHARE * free, allowed):
        return
    advice = refusal("smaller_pieces" if pieces else "in_pieces")
    sizes_gb = {"size": size / 1e9, "stored": stored / 1e9, "free": free / 1e9}
    limits = {"growth": MOST_GROWTH, "most": MOST_BYTES / 1e9}
    code = "padded" if size > allowed else "no_memory"
    raise refusal(code, path=path, advice=advice, **sizes_gb, **limits)


def check_columns(path: Path, count: int) -> None:
    """Raise LogError for too many columns."""
    if count > MOST_COLUMNS:
        raise refusal("too_many_columns", path=path, count=count, most=MOST_COLUMNS)


def check_names(path: Path, names: Sequence[str]) -> None:
    """Raise LogError for too many columns, and for names that are too long or not Unicode."""
    check_columns(path, len(names))
    for name in names:
        if len(name) > LONGEST_NAME:
            most = {"most": LONGEST_NAME, "name": shortened(name)}
            raise refusal("long_name", path=path, count=len(name), **most)
        if not name.isascii() and name != name.encode("utf-8", "replace").decode("utf-8"):
            raise LogError(f"'{path}': the name of a column is not Unicode text: {name!a}")


IN_MEMORY = Path("columns in memory")
"""What messages name in the place of a file."""


def size_of(path: Path) -> float:
    """Return the bytes of a file, or of the files in a folder; infinite for columns in memory."""
    if path == IN_MEMORY:
        return math.inf
    if path.is_dir():
        return float(sum(file.stat().st_size for file in path.iterdir() if file.is_file()))
    return float(path.stat().st_size)


Block = dict[str, Array]
Blocks = Iterator[Block]


@dataclass(frozen=True, eq=False)
class Table:
    """The names of columns, and the functions that load them.

    `load(names)` returns {name: samples (T,)}; `blocks(names, size)` yields the same in pieces,
    None if the format cannot be read in pieces. `clocks` is {column: its time column [s]} if the
    file defines it. `sparse`: NaN marks values that a message lacks. `notice` is what messages on
    its columns add. `files` is {column: file} of a log of several files, where a name that several
    files have is "file:name". `labels` are {column: name given by the user}.
    """

    names: Sequence[str]
    load: Callable[[list[str]], Block]
    blocks: Callable[[list[str], int], Blocks] | None = None
    clocks: Mapping[str, str] = field(default_factory=dict)
    sparse: bool = False
    notice: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)

    def start(self, names: list[str], samples: int) -> Block:
        """Return the first samples of columns, all if the format cannot be read in pieces."""
        return next(self.blocks(names, samples)) if self.blocks else self.load(names)

    def bare(self, name: str) -> str:
        """Return the name of a column in its own file."""
        return name.removeprefix(f"{self.files.get(name, '')}:")

    def label(self, name: str) -> str:
        """Return the name of a column that says what it is: that of the user, or of its file."""
        return self.labels.get(name, self.bare(name))

    def in_file_of(self, name: str, others: Iterable[str]) -> str:
        """Return the column of a name, if several files have it that in the file of the others."""
        names = [f"{self.files.get(column)}:{name}" for column in others]
        return next((column for column in [name, *names] if column in self.names), name)

    def missing(self, name: str) -> str:
        """Return the message for a missing column, with the most similar name.

        In a ROS bag, a name with an unknown topic gets the list of topics.
        """
        topics = _topics(self)
        columns = [f"'{column}'" for column in self.files if self.bare(column) == name]
        if columns:
            return f"several files have a column '{name}': write {' or '.join(columns)}"
        if not topics:
            return "; ".join(filter(None, [unknown_name("column", name, self.names), self.notice]))
        if near := [topic for topic in topics if name.startswith(f"{topic}/")]:
            return unknown_name("column", name, [x for x in self.names if near[0] in x])
        return unknown_name("topic", name, topics)


def _topics(table: Table) -> list[str]:
    """Return the topics of a bag, which are the parents of the clocks of its columns."""
    clocks = dict.fromkeys(table.clocks.values())
    topics = {clock.removesuffix("/header.stamp").removesuffix("/bag_time") for clock in clocks}
    return sorted(topic for topic in topics if topic.startswith("/"))


@contextmanager
def damaged(path: Path, kind: str, column: str = "") -> Iterator[None]:
    """Turn any exception of a library on an invalid or damaged file, or column, into a LogError."""
    try:
        yield
    except LogError:
        raise
    except Exception as problem:  # parsers of untrusted bytes raise any exception
        what = f" is not {kind}, or a damaged one"
        if column:
            what = f": column '{shortened(column)}' cannot be read"
        raise LogError(f"'{path}'{what}: {reason_of(problem)}") from None


def is_number(kind: np.dtype[Any]) -> bool:
    """Return whether an array's type is a real number or a boolean."""
    return kind.kind in "biuf"


def no_numbers(path: Path, name: str, kind: object, shape: object) -> LogError:
    """Return the error for a column that is not a vector of numbers."""
    column, found = shortened(name), shortened(str(kind))
    return refusal("no_numbers", path=path, column=column, found=found, shape=shape)


class Refused:
    """An array that is listed by its name, and whose reason is raised when it is wanted."""

    shape = None

    def __init__(self, reason: Exception) -> None:
        self.reason = reason

    @property
    def dtype(self) -> Any:
        """Raise the reason."""
        raise self.reason


Arrays = Mapping[str, Any]
"""Arrays by name, each with `dtype`, `shape` and slices of its rows, in which samples are."""


def table_of_arrays(
    path: Path, kind: str, opened: Callable[[], AbstractContextManager[Arrays]]
) -> Table:
    """Return the columns of arrays (T,) and (T, k): "name", and "name[0]", "name[1]", ....

    `opened` yields the arrays of a file, which is "a NumPy archive" or of another `kind`.
    """
    with damaged(path, kind), opened() as arrays:
        columns = _columns_of(path, arrays)

    def blocks(wanted: list[str], size: int) -> Blocks:
        of_arrays: dict[str, dict[str, int | None]] = {}
        for name in wanted:
            array, place = columns[name]
            of_arrays.setdefault(array, {})[name] = place
        with damaged(path, kind), opened() as arrays:
            parts = [_Part(path, kind, arrays, *each) for each in of_arrays.items()]
            in_pieces = size < sys.maxsize
            if in_pieces:
                check_lengths(path, {part.name: part.length for part in parts})
            total = max(part.length for part in parts)
            check_memory(path, sum(part.bytes_of(min(size, total)) for part in parts), in_pieces)
            for start in range(0, max(total, 1), size):  # of no rows there is one empty block
                block: Block = {}
                for part in parts:
                    block |= part.columns(start, min(start + size, part.length))
                yield {name: block[name] for name in wanted}

    return in_pieces(list(columns), blocks)


def held(path: Path, arrays: Arrays) -> Table:
    """Return the columns of arrays in memory, which are not read in pieces."""
    table = table_of_arrays(path, "a log", lambda: nullcontext(arrays))
    names = [name for name in table.names if f"{name}[0]" not in table.names]
    return replace(table, names=names, blocks=None)


def in_pieces(
    names: Sequence[str], blocks: Callable[[list[str], int], Blocks], notice: str = ""
) -> Table:
    """Return a table whose columns are loaded as one piece, too."""

    def load(wanted: list[str]) -> Block:
        pieces = [*blocks(wanted, sys.maxsize)]
        return pieces[0] if len(pieces) == 1 else joined(pieces)

    return Table(names, load, blocks, notice=notice)


def joined(blocks: Sequence[Block]) -> Block:
    """Return blocks of the same columns as one."""
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _shape_of(array: Any) -> Sequence[int] | None:
    """Return the shape of an array, None if its file does not say it."""
    with suppress(TypeError, ValueError, RuntimeError, OSError):
        return array.shape  # type: ignore[no-any-return]
    return None


def _columns_of(path: Path, arrays: Arrays) -> dict[str, tuple[str, int | None]]:
    """Return {column: its array, and its place in a matrix}, of matrices up to a limit."""
    columns: dict[str, tuple[str, int | None]] = {}
    for name, array in arrays.items():
        columns[name], shape = (name, None), _shape_of(array) or ()
        if len(shape) == 2 and shape[1] <= MOST_COLUMNS:
            columns |= {f"{name}[{place}]": (name, place) for place in range(shape[1])}
        check_columns(path, len(columns))
    # "q[0]" may be the name of an array itself.
    return columns | {name: (name, None) for name in arrays}


class _Part:
    """The wanted columns of an array of an open file."""

    def __init__(
        self, path: Path, kind: str, arrays: Arrays, base: str, places: Mapping[str, int | None]
    ) -> None:
        self.name, self.places = next(iter(places)), places
        self.named = partial(damaged, path, kind, self.name)
        with self.named():
            self.array = arrays[base]
            dtype, shape = self.array.dtype, self.array.shape
            for name, place in places.items():
                if shape is None or len(shape) != 1 + (place is not None) or not is_number(dtype):
                    raise no_numbers(path, name, dtype, shape)
            self.length, self.row = int(shape[0]), math.prod(shape[1:]) * dtype.itemsize

    def bytes_of(self, rows: int) -> float:
        """Return the largest number of bytes in memory while reading so many samples."""
        # Numbers as stored, and as float64: a file of bytes grows by a factor of eight. HDF5
        # decompresses whole chunks, also for a single sample.
        chunk = math.prod(getattr(self.array, "chunks", None) or (0,)) * self.array.dtype.itemsize
        return float(max(rows * max(self.row, 8 * len(self.places)), chunk))

    def columns(self, start: int, end: int) -> Block:
        """Return some samples of the columns."""
        with self.named():
            rows = np.asarray(self.array[start:end])
            return {x: as_floats(rows if k is None else rows[:, k]) for x, k in self.places.items()}


def as_floats(values: NDArray[Any]) -> Array:
    """Return numbers as float64; infinite if too large."""
    with np.errstate(all="ignore"):
        numbers: Array = values.astype(np.float64)
    return numbers


def check_lengths(path: Path, lengths: Mapping[str, int]) -> None:
    """Raise LogError for columns of different lengths."""
    if len(set(lengths.values())) > 1:
        text = listed(f"'{shortened(name)}' {length}" for name, length in lengths.items())
        raise LogError(f"'{path}': columns have different lengths: {text}")


def optional(module: str, extra: str, path: Path) -> Any:
    """Import an optional package. Raises LogError naming the extra that installs it."""
    check_installed(module, extra, path)
    return importlib.import_module(module)


def check_installed(module: str, extra: str, path: Path) -> None:
    """Raise LogError as `optional` does, but without importing the package."""
    with suppress(ImportError):
        if find_spec(module) is not None:
            return
    package = module.split(".")[0]
    raise refusal("not_installed", path=path, suffix=path.suffix, package=package, extra=extra)
