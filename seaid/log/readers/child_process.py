"""Child processes with limits of time and memory, for readers that may crash.

A child starts a new interpreter, so the calling program needs no `if __name__ == "__main__"`. Its
answer comes back as JSON and .npz, never as code.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaid import errors
from seaid.errors import SeaidError, reason_of
from seaid.log.readers.table import damaged, free_memory, size_of

Arrays = Mapping[str, NDArray[Any]]
Answer = tuple[Any, Arrays]
"""Result of a function in a child: JSON data, and arrays of numbers by name."""

_MOST_MEMORY, _MEMORY_SHARE, _LEAST_MEMORY = 3e9, 0.5, 5e8
_SECONDS = 15.0
"""Smallest limit of processor time of a child that reads a file."""

_WALL_FACTOR = 6.0
"""Ratio of wall time to processor time above which a child counts as hanging."""

_START = (
    "import json, sys; sys.path[:] = json.load(open(sys.argv[1] + '/call.json'))['path']; "
    "from seaid.log.readers.child_process import serve; serve(sys.argv[1])"
)

_folder: Path | None = None
"""In a child: the folder of its answer."""


class ChildError(Exception):
    """A child process ended without an answer; the message is the reason."""


def run_in_child(
    function: Callable[..., Answer], arguments: Mapping[str, Any], *, seconds: float
) -> Answer:
    """Call a function of a module in a child process, and return its JSON data and arrays.

    `arguments` are JSON data by name. `seconds` limits the processor time; the wall time may be six
    times as long. Memory is limited to half of the free memory, at most 3 GB, if the system
    supports it. Raises the SeaidError of the function, and ChildError with the reason for any other
    exception, a crash or a limit that is reached.
    """
    if not sys.executable:
        raise ChildError("a child process cannot be run: the path of Python is unknown")
    memory = max(min(_MOST_MEMORY, _MEMORY_SHARE * free_memory()), _LEAST_MEMORY)
    call = {
        "path": [entry for entry in sys.path if isinstance(entry, str)],
        "function": [function.__module__, function.__qualname__],
        "arguments": dict(arguments),
        "seconds": seconds,
        "memory": memory,
    }
    try:
        with tempfile.TemporaryDirectory(prefix="seaid-") as name:
            folder = Path(name)
            (folder / "call.json").write_text(json.dumps(call), encoding="utf-8")
            died = _started(folder, seconds)
            return _answer(folder, died)
    except OSError as problem:
        raise ChildError(f"a child process cannot be run: {reason_of(problem)}") from None


def read_in_child(
    function: Callable[..., Answer],
    path: Path,
    kind: str,
    bytes_per_second: float,
    **arguments: Any,
) -> Answer:
    """Call a function of a path in a child with time for the size of its file, or of its folder.

    `bytes_per_second` is the slowest rate of reading. Raises LogError for a file that is not of the
    `kind`, or damaged.
    """
    seconds = _SECONDS + size_of(path) / bytes_per_second
    with damaged(path, kind):
        return run_in_child(function, {"path": str(path), **arguments}, seconds=seconds)


def doing(text: str) -> None:
    """Note the current task of a child, which the reason of a crash names. No effect elsewhere."""
    if _folder is not None:
        (_folder / "doing").write_text(text, encoding="utf-8", errors="replace")


def _started(folder: Path, seconds: float) -> str:
    """Run the child of a folder to its end; return the reason if it died, else an empty text."""
    # -P: `import json` of the child must not find a json.py in the user's working folder.
    command = [sys.executable, "-P", "-W", "ignore", "-c", _START, str(folder)]
    # Threads of BLAS and arenas of malloc reserve address space, which RLIMIT_AS counts.
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    try:
        code = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **one_thread, "MALLOC_ARENA_MAX": "2"},
            timeout=_WALL_FACTOR * seconds,
            start_new_session=True,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return f"the process that read it did not end within {_WALL_FACTOR * seconds:.3g} s"
    if code == 0:
        return ""
    out_of_time = {-getattr(signal, name, 0) for name in ("SIGXCPU", "SIGALRM")}
    if code in out_of_time:
        return f"the process that read it did not end within {seconds:.3g} s"
    with suppress(ValueError):
        return f"the process that read it crashed ({signal.Signals(-code).name})"
    return f"the process that read it ended with code {code}"


def _answer(folder: Path, died: str) -> Answer:
    """Return the answer in a child's folder. Raises its error, or ChildError if it died."""
    with suppress(OSError, ValueError):
        # A reason was written before the child ended, so that it counts more than its exit code.
        kind, reason = json.loads((folder / "reason.json").read_text(encoding="utf-8"))
        raise getattr(errors, kind, ChildError)(reason)
    if died:
        with suppress(OSError):
            died += f" at {(folder / 'doing').read_text(encoding='utf-8')}"
        raise ChildError(died)
    try:
        facts, names = json.loads((folder / "facts.json").read_text(encoding="utf-8"))
        with np.load(folder / "arrays.npz", allow_pickle=False) as archive:
            return facts, {name: archive[str(place)] for place, name in enumerate(names)}
    except (OSError, ValueError, KeyError):
        raise ChildError("the process that read it ended without an answer") from None


def serve(folder: str) -> None:
    """Execute in a child the call in its folder, and write the answer there."""
    global _folder
    _folder = Path(folder)
    call = json.loads((_folder / "call.json").read_text(encoding="utf-8"))
    _limit(call["seconds"], int(call["memory"]))
    try:
        module, name = call["function"]
        facts, arrays = getattr(importlib.import_module(module), name)(**call["arguments"])
        numbered = {str(place): values for place, values in enumerate(arrays.values())}
        np.savez(_folder / "arrays.npz", **numbered)
        (_folder / "facts.json").write_text(json.dumps([facts, list(arrays)]), encoding="utf-8")
    except SeaidError as problem:
        _write_reason(type(problem).__name__, str(problem))
    except Exception as problem:  # libraries raise any exception on damaged files
        _write_reason("", reason_of(problem))


def _write_reason(kind: str, reason: str) -> None:
    if _folder is not None:
        (_folder / "reason.json").write_text(json.dumps([kind, reason]), encoding="utf-8")


def _limit(seconds: float, memory: int) -> None:
    """Limit processor time, wall time and memory of this process, if the system supports it."""
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
