"""Output of the commands: results on stdout, notes and errors in one line each on stderr.

The streams may be closed or full, or lack some characters.
"""

from __future__ import annotations

import errno
import io
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

import typer

from seaid.errors import SeaidError, SeaidWarning, reason_of

_OPTIONS = {
    "payloads=": "--payload",
    "known_bodies=": "--known-body",
    "repair=seaid.Repairs()": "--repair",
    "write it with force=True": "add --allow-inconsistent",
    "force=True": "--allow-inconsistent",
}
"""Arguments whose option has another name: {argument as an error names it: option}."""


@contextmanager
def reported() -> Iterator[None]:
    """Print warnings of seaid once as `note:` lines, and errors as `error:` with exit code 1."""
    printed: set[str] = set()

    def note(message: Warning | str, category: type[Warning], *place: Any) -> None:
        if not issubclass(category, SeaidWarning):
            other(message, category, *place)
        elif str(message) not in printed:
            printed.add(str(message))
            typer.echo(f"note: {' '.join(str(message).split())}", err=True)

    with warnings.catch_warnings():
        other = warnings.showwarning
        warnings.simplefilter("always", SeaidWarning)
        warnings.showwarning = note  # type: ignore[assignment]
        try:
            yield
        except SeaidError as problem:
            typer.echo(f"error: {error_text(problem)}", err=True)
            raise typer.Exit(1) from None


def error_text(problem: BaseException | None) -> str:
    """Return an error and its context in one line, with options in place of arguments."""
    text = str(problem)
    while problem is not None:
        for argument in getattr(problem, "arguments", ()):
            text = text.replace(argument, option_of(argument))
        problem = problem.__context__
    return " ".join(text.split())


def option_of(argument: str) -> str:
    """Return the option for an argument: '--method "two-step"' for 'method="two-step"'."""
    name, _, value = argument.removeprefix("Limits(").partition("=")
    option = f"--{name.replace('_', '-')}"
    has_value = value.startswith(("'", '"'))
    return _OPTIONS.get(argument, f"{option} {value}" if has_value else option)


def show(text: str, content: Any, as_json: bool, *paths: Path | None) -> None:
    """Print the text for people, or the content as JSON for machines, on stdout.

    The last line names the files of the results; it is on stderr if stdout is JSON.
    """
    from seaid._files import plain

    if as_json:
        text = json.dumps(plain(content), indent=1, allow_nan=False, ensure_ascii=False)
    typer.echo(text)
    if there := ", ".join(map(str, filter(None, paths))):
        typer.echo(f"Results: {there}", err=as_json)


def is_terminal() -> bool:
    """Return whether to show progress: stderr is a terminal."""
    return sys.stderr.isatty()


def check_outputs(*paths: Path | None, force: bool, read: Iterable[Path | None]) -> None:
    """Check before a long computation that the results can be written.

    Raises SeaidError for an existing file (unless `force`), a file that is `read`, a folder, and a
    path that cannot be written.
    """
    from seaid._files import is_replaced, real_path, result_folder

    sources = {real_path(path) for path in filter(None, read)}
    for path in filter(None, paths):
        target = real_path(path)
        if target in sources:
            raise SeaidError(f"'{path}' is read by this command: name another file for the results")
        if os.path.isdir(target):
            raise SeaidError(f"'{path}' is a folder: name a file in it")
        replaced = is_replaced(path)
        if replaced and not force:
            raise SeaidError(f"'{path}' is there already: name another file, or add --force")
        if replaced or not path.exists():  # not for a device or a pipe
            result_folder(target.parent)


@contextmanager
def safe_streams() -> Iterator[None]:
    """Run a command; if its output cannot be written, end it with exit code 1 and one line.

    A closed pipe (`| head -1`) prints no error. Characters that the encoding of the output lacks,
    and undecodable bytes of paths, are written as escapes.
    """
    lost: list[TextIO] = []
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller
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
    """Add a stream to `lost` when writing to it fails."""

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
    """Redirect a stream to nowhere, because Python flushes it at exit."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
