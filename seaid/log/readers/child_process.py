"""Child processes with limits of time and memory, for readers that may crash.

They are those of loky, which start a new interpreter: the calling program needs no
`if __name__ == "__main__"`.
"""

from __future__ import annotations

import os
import re
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from seaid.errors import SeaidError, reason_of
from seaid.log.readers.table import damaged, free_memory, size_of

_MOST_MEMORY, _MEMORY_SHARE, _LEAST_MEMORY = 3e9, 0.5, 5e8
"""Limit on the memory of a child [bytes], the share of the free memory that it may have, and what
it always has."""

SECONDS = 15.0
"""Smallest limit of the processor time of a child [s] that reads a file."""

_WALL_FACTOR = 6.0
"""Ratio of wall time to processor time above which a child counts as hanging."""

# Threads of BLAS and arenas of malloc reserve address space, which RLIMIT_AS counts.
_ENVIRONMENT = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_ENVIRONMENT |= {"MALLOC_ARENA_MAX": "2"}


class ChildError(Exception):
    """A child process ended without an answer; the message is the reason."""


@contextmanager
def child(seconds: float) -> Iterator[Callable[..., Any]]:
    """Yield a function that calls functions of modules in one child: `call(function, *arguments)`.

    `seconds` limits the processor time of all calls; the wall time of each may be six times as
    long. Memory is limited to half of the free memory, at most 3 GB, if the system supports it. A
    call raises the SeaidError of its function, and ChildError with the reason for any other
    exception, a crash or a limit that is reached.
    """
    from loky import BrokenProcessPool, ProcessPoolExecutor

    memory = max(min(_MOST_MEMORY, _MEMORY_SHARE * free_memory()), _LEAST_MEMORY)

    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        late = f"the process that read it did not end within {seconds:.3g} s"
        try:
            answer = executor.submit(_called, function, arguments)
            return answer.result(timeout=_WALL_FACTOR * seconds)
        except (SeaidError, ChildError) as problem:
            raise problem from None
        except TimeoutError:
            raise ChildError(late) from None
        except BrokenProcessPool as problem:
            codes = re.findall(r"\w+\(-?\d+\)", str(problem))
            is_late = not {"SIGXCPU", "SIGALRM"}.isdisjoint(x.partition("(")[0] for x in codes)
            died = f"the process that read it crashed ({', '.join(codes) or 'no exit code'})"
            raise ChildError(late if is_late else died) from None

    try:
        executor = ProcessPoolExecutor(
            1, initializer=_limit, initargs=(seconds, int(memory)), env=_ENVIRONMENT
        )
    except OSError as problem:
        raise ChildError(f"a child process cannot be run: {reason_of(problem)}") from None
    try:
        yield call
    finally:
        executor.shutdown(kill_workers=True)


def read_in_child(
    function: Callable[..., Any], path: Path, kind: str, bytes_per_second: float, *arguments: Any
) -> Any:
    """Call a function of a path in a child with time for the size of its file, or of its folder.

    `bytes_per_second` is the slowest rate of reading. Raises LogError for a file that is not of the
    `kind`, or damaged.
    """
    seconds = SECONDS + size_of(path) / bytes_per_second
    with damaged(path, kind), child(seconds) as call:
        return call(function, str(path), *arguments)


def _called(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Return the answer of a function in the child; its exceptions as those that can be sent."""
    try:
        return function(*arguments)
    except SeaidError:
        raise
    except Exception as problem:  # libraries raise any exception on damaged files
        raise ChildError(reason_of(problem)) from None


def _limit(seconds: float, memory: int) -> None:
    """Limit times and memory of this process, if the system supports it, and silence it."""
    warnings.simplefilter("ignore")
    nothing = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # of libraries
        os.dup2(nothing, stream)
    with suppress(ImportError):
        import resource  # not on Windows

        # RLIMIT_CPU is in whole seconds, hence rounded up; beyond it the kernel sends SIGXCPU.
        wanted = {
            resource.RLIMIT_CPU: int(seconds) + 1,
            resource.RLIMIT_AS: memory,
            resource.RLIMIT_CORE: 0,
        }
        for kind, most in wanted.items():
            hard = resource.getrlimit(kind)[1]
            soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
            with suppress(OSError, ValueError):
                resource.setrlimit(kind, (soft, hard))
    with suppress(AttributeError):  # not on Windows; ends a child whose parent has died
        signal.setitimer(signal.ITIMER_REAL, _WALL_FACTOR * seconds + 5.0)
