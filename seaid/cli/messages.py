"""What a command says: notes and errors in one line each on stderr, results on stdout.

Where a command speaks to: streams that may be closed, full, or without some letters.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

import typer

from seaid.errors import SeaidError, SeaidWarning, reason_of

_AS_OPTIONS = {
    r"write it with force=True": "add --allow-inconsistent",
    r"repair=seaid\.Repairs\(\)": "--repair",
    r"\b(feasible|progress)=True": r"--\1",
    r"\bpayloads=": "--payload",
    r"\bknown_bodies=": "--known-body",
    r"\bencoder_offset_std=": "--encoder-offset-std",
    r"\bcutoff_hz=": "--cutoff-hz",
    r"\btorque_joints=": "--torque-joints",
    r"\b(method|estimator|joints|description)=(?=[\w\"])": r"--\1 ",
    r"\b(method|estimator|joints|description)=": r"--\1",
}
"""How what the library asks for is asked for here."""


@contextmanager
def spoken() -> Iterator[None]:
    """Say warnings of seaid as `note:` lines, once each, and its errors as `error:` with exit 1."""
    said: set[str] = set()

    def note(message: Warning | str, category: type[Warning], *place: Any) -> None:
        if not issubclass(category, SeaidWarning):
            other(message, category, *place)
        elif str(message) not in said:
            said.add(str(message))
            typer.echo(f"note: {in_one_line(str(message))}", err=True)

    with warnings.catch_warnings():
        other = warnings.showwarning
        warnings.simplefilter("always", SeaidWarning)
        warnings.showwarning = note  # type: ignore[assignment]
        try:
            yield
        except SeaidError as problem:
            typer.echo(f"error: {in_one_line(str(problem))}", err=True)
            raise typer.Exit(1) from None


def in_one_line(text: str) -> str:
    """Return a message of the library in one line, its keywords as options of the command line."""
    for pattern, option in _AS_OPTIONS.items():
        text = re.sub(pattern, option, text)
    return " ".join(text.split())


def say(text: str, content: Any, as_json: bool) -> None:
    """Print the text for people, or the content as JSON for machines, on stdout."""
    from seaid._files import plain

    if as_json:
        text = json.dumps(plain(content), indent=1, allow_nan=False, ensure_ascii=False)
    typer.echo(text)


def say_results(as_json: bool, *paths: Path | None) -> None:
    """Say in the last line where results are: on stdout, or on stderr where that is JSON."""
    there = ", ".join(str(path) for path in paths if path is not None)
    if there:
        typer.echo(f"Results: {there}", err=as_json)


def shows_progress() -> bool:
    """Tell whether progress is worth showing: stderr is a terminal."""
    return sys.stderr.isatty()


def to_be_written(*paths: Path | None, force: bool, read: tuple[Path | None, ...] = ()) -> None:
    """Check, before long work, that results can be written and what would be lost by it.

    Raises SeaidError for a file that is there already (unless `force`), one of those that are
    `read`, a folder, and where nothing can be written.
    """
    from seaid._files import is_replaced, real_path, result_folder

    sources = {real_path(path) for path in read if path is not None}
    for path in paths:
        if path is None:
            continue
        target = real_path(path)
        if target in sources:
            raise SeaidError(f"'{path}' is read by this command: name another file for the results")
        if os.path.isdir(target):
            raise SeaidError(f"'{path}' is a folder: name a file in it")
        replaced = is_replaced(path)
        if replaced and not force:
            raise SeaidError(f"'{path}' is there already: name another file, or add --force")
        if replaced or not path.exists():  # a device or a pipe takes no file beside it
            result_folder(target.parent)


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
