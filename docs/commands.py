"""The reference of the command line, as `seaid --help` has it, in Markdown."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

MARK = "<!-- commands -->"


def markdown() -> str:
    """Return a section for each command: usage, help, arguments and options."""
    from seaid.cli.commands import COMMANDS, command_of

    sections = (_section(name, command_of(name)) for name in COMMANDS)
    return "\n".join(line for section in sections for line in section)


def _section(name: str, command: Any) -> Iterator[str]:
    text, _, examples = inspect.cleandoc(command.help).partition("\b\n")
    yield from (f"## seaid {name}", "", *text.strip().splitlines(), "")
    yield from ("```sh", *examples.splitlines(), "```", "")
    for parameter in command.params:
        yield f"- {_words(parameter)}{_default(parameter)}: {_meaning(parameter)}"
    yield ""


def _words(parameter: Any) -> str:
    context = click.Context(click.Command("seaid"))
    shape = parameter.make_metavar(context)
    if parameter.param_type_name == "argument":
        return f"`{shape}`"
    options = [*parameter.opts, *parameter.secondary_opts]
    value = "" if parameter.is_flag else f" {shape}"
    return ", ".join(f"`{option}{value}`" for option in sorted(options, key=len))


def _meaning(parameter: Any) -> str:
    return (parameter.help or "") + (" Required." if parameter.required else "")


def _default(parameter: Any) -> str:
    value = parameter.default
    shown = isinstance(value, (str, float, int, Path)) and not isinstance(value, bool)
    return f" (default `{value}`)" if shown else ""
