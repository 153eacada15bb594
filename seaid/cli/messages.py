"""Output of the commands: results on stdout, notes and errors in one line each on stderr.

The streams may be closed or full, or lack some characters.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TextIO

import typer

from seaid.errors import SeaidError, SeaidWarning, reason_of

_OPTIONS = {
    "payloads=": "--payload",
    "known_bodies=": "--known-body",
    "known_bodies:": "--known-body:",
    "condition_specific=": "--specific",
    "independent_mimics=True": "--independent-mimics",
    "repair=seaid.Repairs()": "--repair",
    "seaid.describe_log": "seaid describe",
    "description= (seaid.describe_log infers one)": "--description (seaid describe infers one)",
    "contacts=": "--contact",
    "load_robot(contacts=[...])": "--contact",
    "write it with force=True": "add --allow-inconsistent",
    "force=True": "--allow-inconsistent",
}
"""Arguments whose option has another name: {argument as an error names it: option}."""


FORMAT = 1
"""Number of the format of `--json`: it rises when a key changes its name or meaning."""


@dataclass
class _Call:
    """The command that runs, and what it has printed."""

    command: str = "seaid"
    as_json: bool = False
    notes: list[str] = field(default_factory=list)
    has_result: bool = False


class MovedError(SeaidError):
    """A former command: wrong usage, for which one line names what to write now."""


_CALL: ContextVar[_Call] = ContextVar("_CALL")
_CALL.set(_Call())


def begin(command: str, arguments: Sequence[str]) -> None:
    """Note which command runs, so that errors in its arguments can be JSON too."""
    # Behind "--" all words are arguments, also "--json".
    leading = list(arguments)[: list(arguments).index("--")] if "--" in arguments else arguments
    _CALL.set(_Call(command, "--json" in leading))


def note(text: str) -> None:
    """Print a note on stderr, once; it is in the JSON of the result too."""
    call, line = _CALL.get(), " ".join(text.split())
    if line not in call.notes:
        call.notes.append(line)
        typer.echo(f"note: {line}", err=True)


@contextmanager
def reported() -> Iterator[None]:
    """Print warnings of seaid as `note:` lines, and errors as `error:` with their exit code."""

    def noted(message: Warning | str, category: type[Warning], *place: Any) -> None:
        if issubclass(category, SeaidWarning):
            note(str(message))
        else:
            previous(message, category, *place)

    with warnings.catch_warnings():
        previous = warnings.showwarning
        warnings.simplefilter("always", SeaidWarning)
        warnings.showwarning = noted  # type: ignore[assignment]
        try:
            yield
        except SeaidError as problem:
            code = 2 if isinstance(problem, MovedError) else 1
            _print_error_json(error_text(problem), code)
            typer.echo(f"error: {error_text(problem)}", err=True)
            raise typer.Exit(code) from None
        except _USAGE_ERROR as problem:
            _print_error_json(problem.format_message(), problem.exit_code)
            raise


_USAGE_ERROR: Any = typer.BadParameter.__mro__[1]
"""What Typer raises for wrong usage, which it does not export."""


def _print_error_json(message: str, exit_code: int) -> None:
    """Print an error as JSON on stdout if the command has --json and printed no result."""
    call = _CALL.get()
    if call.as_json and not call.has_result:
        typer.echo(_json(envelope(error={"message": message, "exit_code": exit_code})))


def envelope(**facts: Any) -> dict[str, Any]:
    """Return what --json prints, the same keys for all commands: docs/reference/commands.md.

    `facts` are some of result, robot, verdict, warnings, files and error.
    """
    call = _CALL.get()
    content = {
        "format": f"seaid {call.command} {FORMAT}",
        "command": call.command,
        "robot": None,
        "verdict": None,
        "warnings": (),
        "notes": call.notes,
        "result": None,
        "files": (),
        "error": None,
    }
    return content | facts


def _json(content: Any) -> str:
    from seaid._files import plain

    text = json.dumps(plain(content), indent=1, allow_nan=False, ensure_ascii=False)
    return text.encode(errors="backslashreplace").decode()  # undecodable bytes of paths


def error_text(problem: BaseException | None) -> str:
    """Return an error and its context in one line, with options in place of arguments."""
    text = str(problem)
    # An error that was raised again with more words has the arguments of the first in its context.
    while problem is not None:
        for argument in getattr(problem, "arguments", ()):
            text = text.replace(argument, option_of(argument))
        problem = problem.__context__
    return " ".join(text.split())


def option_of(argument: str) -> str:
    """Return the option for an argument: '--method "two-step"' for 'method="two-step"'.

    'Limits(velocity={'knee': ...})' is '--velocity knee=...'.
    """
    if "={'" in argument:
        each = re.findall(r"(\w+)=\{'(.+?)': \.\.\.\}", argument)
        return ", ".join(f"--{name.replace('_', '-')} {joint}=..." for name, joint in each)
    name, _, value = argument.removeprefix("Limits(").removeprefix("Stance(").partition("=")
    option = f"--{name.replace('_', '-')}"
    has_value = value.startswith(("'", '"'))
    return _OPTIONS.get(argument, f"{option} {value}" if has_value else option)


def show(text: str, result: Any, as_json: bool, *paths: Path | None, **facts: Any) -> None:
    """Print the text for people, or the result as JSON for machines, on stdout.

    `facts` are robot, verdict and warnings of the `envelope`. The last line names the files of the
    results. It is on stderr if stdout is JSON; so is the text if a result is on stdout itself.
    """
    files = [path for path in paths if path is not None and not is_stdout(path)]
    to_stderr = any(path is not None and is_stdout(path) for path in paths)
    if as_json:
        text = _json(envelope(result=result, files=files, **facts))
    typer.echo(text, err=to_stderr)
    _CALL.get().has_result = True
    if files:
        typer.echo(f"Results: {', '.join(map(str, files))}", err=as_json or to_stderr)


def is_stdout(path: Path | None) -> bool:
    """Return whether `-o -` asks for a result on stdout."""
    return str(path) == "-"


def written(path: Path | None, suffix: str, write: Callable[[Path], Any]) -> Any:
    """Return what `write` returns after it wrote a result: to `path`, or for `-` to stdout.

    Nothing is written, and None returned, without a path.
    """
    if path is None or not is_stdout(path):
        return None if path is None else write(path)
    with TemporaryDirectory() as folder:
        result = write(file := Path(folder, f"result{suffix}"))
        typer.echo(file.read_bytes().decode(), nl=False)
    return result


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
        if is_stdout(path):
            continue
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
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    out, err = sys.stdout, sys.stderr
    try:
        try:
            yield
        finally:
            out.flush()
    except OSError as problem:
        if problem.filename is not None:  # of a file, which has a message of its own
            raise
        if problem.errno != errno.EPIPE:
            with suppress(OSError):
                print(f"error: cannot write the output: {reason_of(problem)}", file=err)
        for stream in (out, err):
            _silence(stream)
        sys.exit(1)


def _silence(stream: TextIO) -> None:
    """Redirect a stream to nowhere, because Python flushes it at exit."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
