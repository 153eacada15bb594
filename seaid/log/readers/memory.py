"""Limits of columns and memory of a log, checked before its samples are read."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from seaid.errors import LogError, shortened


def free_memory() -> float:
    """Return the bytes of memory that this process may still take; infinite if unknown.

    It is the smallest of the free memory of the machine, of the process's address space, and of
    the control group of a container.
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
        return float(limit) - float(used)  # "max" raises ValueError: no limit
    return float("inf")


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
            f"padded with equal samples; {advice}"
        )
    raise LogError(
        f"'{path}' takes {size / 1e9:.3g} GB of memory, too much for the {free / 1e9:.3g} GB that "
        f"are free; {advice}"
    )


def check_columns(path: Path, count: int) -> None:
    """Raise LogError for too many columns."""
    if count > MOST_COLUMNS:
        raise LogError(
            f"'{path}' has {count:,} columns or more, allowed are {MOST_COLUMNS:,}; write the "
            "columns needed to a file of their own"
        )


def check_names(path: Path, names: Sequence[str]) -> None:
    """Raise LogError for too many columns, and for names that are too long or not Unicode."""
    check_columns(path, len(names))
    for name in names:
        if len(name) > LONGEST_NAME:
            raise LogError(
                f"'{path}': the name of a column has {len(name):,} characters, allowed are "
                f"{LONGEST_NAME:,}: '{shortened(name)}'"
            )
        if not name.isascii() and name != name.encode("utf-8", "replace").decode("utf-8"):
            raise LogError(f"'{path}': the name of a column is not Unicode text: {name!a}")


def size_of(path: Path) -> float:
    """Return the bytes of a file, or of the files in a folder."""
    if path.is_dir():
        return float(sum(one.stat().st_size for one in path.iterdir() if one.is_file()))
    return float(path.stat().st_size)
