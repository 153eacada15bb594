"""How much memory is free."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


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
