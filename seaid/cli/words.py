"""What a command says: notes and errors in one line each on stderr, results on stdout."""

from __future__ import annotations

import json
import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from seaid.errors import SeaidError, SeaidWarning

_AS_OPTIONS = {
    r"write it with force=True": "add --allow-impossible",
    r"repair=seaid\.Repairs\(\)": "--repair",
    r"\bread_log mends": "it is mended",
    r"\blet read_log mend them with": "have them mended with",
    r"\b(feasible|progress)=True": r"--\1",
    r"\bpayloads=": "--payload",
    r"\bknown_bodies=": "--known-body",
    r"\bjoint_zero_std=": "--joint-zero-std",
    r"\bcutoff_hz=": "--cutoff-hz",
    r"\b(sides|estimator|rows|joints|description)=(?=[\w\"])": r"--\1 ",
    r"\b(sides|estimator|rows|joints|description)=": r"--\1",
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
    from seaid.files import plain

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
    from seaid.files import is_replaced, real_path, result_folder

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
