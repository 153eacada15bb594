"""Functions run in a child process with limits of time and memory, for readers that may crash.

A child needs nothing of the program that calls: no `if __name__ == "__main__"`, no main thread. It
starts a new interpreter, and its answer comes back as JSON and .npz, never as code.
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
from seaid.log.readers.memory import free_memory

Arrays = Mapping[str, NDArray[Any]]
Answer = tuple[Any, Arrays]
"""What a function in a child gives back: facts that JSON knows, and arrays of numbers by name."""

_MOST_MEMORY, _MEMORY_SHARE, _LEAST_MEMORY = 3e9, 0.5, 5e8
_WALL_FACTOR = 6.0
"""Wall time over processor time after which a child counts as hanging."""

_START = (
    "import json, sys; sys.path[:] = json.load(open(sys.argv[1] + '/call.json'))['path']; "
    "from seaid.log.readers.child_process import serve; serve(sys.argv[1])"
)

_folder: Path | None = None
"""In a child: where its answer goes."""


class ChildError(Exception):
    """A child that did not answer, and the reason, in words."""


def run_in_child(
    function: Callable[..., Answer], arguments: Mapping[str, Any], *, seconds: float
) -> Answer:
    """Call a function of a module in a child process; return the facts and arrays of its answer.

    `arguments` by name, as JSON knows them. `seconds` is processor time: a child may take six
    times as long on the wall. Memory is limited to half of what is free, 3 GB at most, where the
    system can do so. Raises the function's own SeaidError, and ChildError with a reason in words
    for whatever else goes wrong: another exception, a crash, a limit that was reached.
    """
    if not sys.executable:
        raise ChildError("a child process cannot be run: nobody knows where Python is")
    memory = max(min(_MOST_MEMORY, _MEMORY_SHARE * free_memory()), _LEAST_MEMORY)
    call = {
        "path": [one for one in sys.path if isinstance(one, str)],
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


def doing(text: str) -> None:
    """Note what a child is at; the reason of a crash then names it. Without effect elsewhere."""
    if _folder is not None:
        (_folder / "doing").write_text(text, encoding="utf-8", errors="replace")


def _started(folder: Path, seconds: float) -> str:
    """Run the child of a folder to its end; return how it died, or nothing."""
    command = [sys.executable, "-P", "-W", "ignore", "-c", _START, str(folder)]
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
        return f"the process that read it found no end in {_WALL_FACTOR * seconds:.3g} s"
    if code == 0:
        return ""
    out_of_time = {-getattr(signal, one, 0) for one in ("SIGXCPU", "SIGALRM")}
    if code in out_of_time:
        return f"the process that read it found no end in {seconds:.3g} s"
    with suppress(ValueError):
        return f"the process that read it crashed ({signal.Signals(-code).name})"
    return f"the process that read it ended with code {code}"


def _answer(folder: Path, died: str) -> Answer:
    """Return what a child left in its folder. Raises its error, or ChildError with how it died."""
    with suppress(OSError, ValueError):
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
    """Do in a child what the call in its folder says, and leave the answer there."""
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
        _say(type(problem).__name__, str(problem))
    except Exception as problem:  # libraries on damaged files let whatever they meet through
        _say("", reason_of(problem))


def _say(kind: str, reason: str) -> None:
    if _folder is not None:
        (_folder / "reason.json").write_text(json.dumps([kind, reason]), encoding="utf-8")


def _limit(seconds: float, memory: int) -> None:
    """Limit processor time, wall time and memory of this process, where the system can."""
    with suppress(ImportError):
        import resource  # not on Windows

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
    with suppress(AttributeError):  # not on Windows: whoever waits has died as well
        signal.setitimer(signal.ITIMER_REAL, _WALL_FACTOR * seconds + 5.0)
