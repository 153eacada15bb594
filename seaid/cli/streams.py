"""Where a command speaks to: streams that may be closed, full, or without some letters."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from seaid.errors import reason_of


@contextmanager
def safe_streams() -> Iterator[None]:
    """Run a command whose output may go nowhere: that ends it with exit code 1, in one line.

    A reader that has enough (`| head -1`) is no error worth a word. Letters that the output's
    encoding does not have, and bytes of paths that are no text, are written by their numbers.
    """
    lost: list[TextIO] = []
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by whoever called
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
            _watch(stream, lost)
    out, err = sys.stdout, sys.stderr
    try:
        try:
            yield
        finally:
            out.flush()
    except OSError as problem:
        if not lost:
            raise
        if problem.errno != errno.EPIPE and err not in lost:
            print(f"error: cannot write the output: {reason_of(problem)}", file=err)
        for stream in lost:
            _silence(stream)
        sys.exit(1)


def _watch(stream: TextIO, lost: list[TextIO]) -> None:
    """Note a stream as lost where something cannot be written to it."""

    def noting(method: Callable[..., Any]) -> Callable[..., Any]:
        def noted(*arguments: Any) -> Any:
            try:
                return method(*arguments)
            except OSError:
                lost.append(stream)
                raise

        return noted

    for name in ("write", "flush"):
        setattr(stream, name, noting(getattr(stream, name)))


def _silence(stream: TextIO) -> None:
    """Let what is left in a stream go nowhere, which Python writes when it ends."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
