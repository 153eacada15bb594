"""How much memory is free, and whether what a file declares fits into it, asked before reading."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from seaid.errors import SeaidError

MEMORY_SHARE = 0.25
"""Largest part of the free memory that data read as a whole may take: what follows copies it."""

MOST_BYTES = 1e9
"""Most bytes that are read as a whole, however much memory is free."""


def check_memory(
    where: str, size: float, advice: str, error: type[SeaidError] = SeaidError
) -> None:
    """Check that `size` bytes of data may be read into memory. Raises `error` with the advice."""
    free = free_memory()
    if size > MOST_BYTES:
        limit = f"more than the {MOST_BYTES / 1e9:.3g} GB that are read as a whole"
    elif size > MEMORY_SHARE * free:
        limit = (
            f"too much to be read as a whole into the {max(free, 0.0) / 1e9:.3g} GB of memory "
            "that are free"
        )
    else:
        return
    raise error(f"{where} has {size / 1e9:.3g} GB, {limit}; {advice}")


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
