"""Output of the commands: results on stdout, notes and errors in one line each on stderr."""

from __future__ import annotations

import json
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from seaid.errors import SeaidError, SeaidWarning

_OPTIONS = {
    "payloads=": "--payload",
    "known_bodies=": "--known-body",
    "known_bodies:": "--known-body:",
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


_CALL: ContextVar[_Call] = ContextVar("_CALL")
_CALL.set(_Call())


def begin(command: str, arguments: Sequence[str]) -> None:
    """Note which command runs, so that errors in its arguments can be JSON too."""
    _CALL.set(_Call(command, "--json" in arguments))


def note(text: str) -> None:
    """Print a note on stderr, once; it is in the JSON of the result too."""
    call, line = _CALL.get(), " ".join(text.split())
    if line not in call.notes:
        call.notes.append(line)
        click.echo(f"note: {line}", err=True)


@contextmanager
def reported() -> Iterator[None]:
    """Print warnings of seaid as `note:` lines, and errors in one line, as JSON too if asked."""

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
        except (SeaidError, click.ClickException) as problem:
            error = problem
            if isinstance(error, SeaidError):
                error = click.ClickException(error_text(error))
            call = _CALL.get()
            if call.as_json and not call.has_result:
                facts = {"message": error.format_message(), "exit_code": error.exit_code}
                click.echo(_json(envelope(error=facts)))
            raise error from None


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
    results, on stderr if stdout is JSON.
    """
    files = [path for path in paths if path is not None]
    click.echo(_json(envelope(result=result, files=files, **facts)) if as_json else text)
    _CALL.get().has_result = True
    if files:
        click.echo(f"Results: {', '.join(map(str, files))}", err=as_json)


def is_terminal() -> bool:
    """Return whether to show progress: stderr is a terminal."""
    return sys.stderr.isatty()
