"""How much memory is free.

What a log may declare: columns, and bytes of samples, checked before they are read.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from seaid.errors import LogError, shortened


def free_memory() -> float:
    """Return the bytes of memory that this process may still take; infinite where nobody says.

    The least of what the machine has, what the limit of the process's address space leaves, and
    what the control group of a container leaves.
    """
    return min(_of_machine(), _of_process(), _of_group())


def _of_machine() -> float:
    with suppress(OSError, ValueError, IndexError, StopIteration):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if "MemAvailable" in line)
    with suppress(ValueError, OSError, AttributeError):
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def _of_process() -> float:
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource  # not on Windows

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            return float(limit - pages * resource.getpagesize())
    return float("inf")


def _of_group() -> float:
    group = Path("/sys/fs/cgroup")
    with suppress(OSError, ValueError):
        limit = (group / "memory.max").read_text(encoding="ascii")
        used = (group / "memory.current").read_text(encoding="ascii")
        return float(limit) - float(used)  # "max" is no number: no limit
    return float("inf")


MOST_COLUMNS = 10_000
"""Columns of a log; more are an image, a cloud of points, or a damaged file."""

LONGEST_NAME = 1_000
"""Characters in the name of a column."""

MEMORY_SHARE = 0.25
"""Largest part of the free memory that samples read at once may take: what follows copies them."""

MOST_BYTES, MOST_GROWTH = 1e9, 20.0
"""A file may declare this many bytes of samples, or this many times its own size if that is more:
what is beyond was never measured."""


def check_memory(path: Path, size: float, pieces: bool = False) -> None:
    """Check the bytes of the samples that are to be read at once, before they are.

    Raises LogError with what to do, which for `pieces` is another than for a file as a whole.
    """
    own, free = size_of(path), max(free_memory(), 0.0)
    allowed = max(MOST_BYTES, MOST_GROWTH * own)
    if size <= min(MEMORY_SHARE * free, allowed):
        return
    advice = (
        "read fewer samples at a time with a smaller chunk_samples="
        if pieces
        else "read it in pieces with seaid.open_long_log, or write it as Parquet with the columns "
        "needed"
    )
    if size > allowed:
        raise LogError(
            f"'{path}' of {own / 1e9:.3g} GB declares {size / 1e9:.3g} GB of samples, more than "
            f"{MOST_GROWTH:g} times its size and than {MOST_BYTES / 1e9:g} GB: it is damaged, or "
            f"padded with samples that are all the same; {advice}"
        )
    raise LogError(
        f"'{path}' takes {size / 1e9:.3g} GB of memory, too much for the {free / 1e9:.3g} GB that "
        f"are free; {advice}"
    )


def check_columns(path: Path, count: int) -> None:
    """Check the number of columns of a log. Raises LogError."""
    if count > MOST_COLUMNS:
        raise LogError(
            f"'{path}' has {count:,} columns or more, allowed are {MOST_COLUMNS:,}; write the "
            "columns needed to a file of their own"
        )


def check_names(path: Path, names: Sequence[str]) -> None:
    """Check number, length and characters of the names of columns. Raises LogError."""
    check_columns(path, len(names))
    for name in names:
        if len(name) > LONGEST_NAME:
            raise LogError(
                f"'{path}': the name of a column has {len(name):,} characters, allowed are "
                f"{LONGEST_NAME:,}: '{shortened(name)}'"
            )
        if not name.isascii() and name != name.encode("utf-8", "replace").decode("utf-8"):
            raise LogError(f"'{path}': the name of a column is no text in Unicode: {name!a}")


def size_of(path: Path) -> float:
    """Return the bytes of a file, or of the files in a folder."""
    if path.is_dir():
        return float(sum(one.stat().st_size for one in path.iterdir() if one.is_file()))
    return float(path.stat().st_size)
