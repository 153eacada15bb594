"""Commands for Typer from functions: their signatures and docstrings define the options.

What stands before `*` is an argument of the line, what stands after it an option; the fields of a
dataclass are options as well. The types are those of `seaid.cli.kinds`, and the help is that of the
NumPy docstring. A parameter that a docstring does not describe is described by `SHARED`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from inspect import Parameter, Signature, cleandoc, getmro, isclass, signature
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer

from seaid.cli.kinds import Kind, choice, text_of

WORDS = {
    "as_json": ("--json",),
    "from_logs": ("--from",),
    "validation": ("--validate",),
    "plans": ("--plan",),
    "open_report": ("--open",),
    "output": ("--output", "-o"),
    "verbose": ("--verbose", "-v"),
    "as_estimated": ("--as-estimated/--feasible",),
}
"""Parameters whose option has another name or a short one."""

_SECTION = re.compile(r"^(\w+)\n-+\n", re.MULTILINE)


def option_name(parameter: str) -> str:
    """Return the option of a parameter: '--rate-hz' of 'rate_hz'."""
    return WORDS.get(parameter, (f"--{parameter.replace('_', '-')}",))[0]


def help_of(command: Callable[..., None]) -> str:
    """Return the help of a command: its docstring, with one line per example."""
    text, *sections = _SECTION.split(cleandoc(command.__doc__ or ""))
    examples = dict(zip(sections[::2], sections[1::2], strict=True)).get("Examples", "")
    return f"{text.strip()}\n\n\b\n{examples}".strip()


def descriptions(documented: Any) -> dict[str, str]:
    """Return {parameter: its description} in the docstrings of a function or of a class."""
    texts: dict[str, str] = {}
    for subject in reversed(getmro(documented)) if isclass(documented) else (documented,):
        _, *sections = _SECTION.split(cleandoc(subject.__doc__ or ""))
        parts = dict(zip(sections[::2], sections[1::2], strict=True)).get("Parameters", "")
        entries = re.findall(r"^(\S.*)\n((?:    .*\n?)+)", parts, re.MULTILINE)
        for names, text in entries:
            texts |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return texts


def for_typer(
    command: Callable[..., None],
    shared: Mapping[str, str],
    fill: Callable[[typer.Context, dict[str, Any], Sequence[str]], dict[str, Any]],
) -> Callable[..., None]:
    """Return a command as Typer takes it, each option with type, default and help.

    Parameters
    ----------
    command : function
    shared : mapping {parameter: description}
        Of parameters that its docstring does not describe.
    fill : function of the context, the values and the names of the arguments
        Returns the values with those of a project file.
    """
    parameters = dict(signature(command).parameters)
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    fields = {name: dict(signature(group).parameters) for name, group in groups.items()}
    texts = dict(shared)
    flat: dict[str, Parameter] = {}
    for name, parameter in parameters.items():
        flat |= fields.get(name, {name: parameter})
    for group in groups.values():
        texts |= descriptions(group)
        hints |= get_type_hints(group, include_extras=True)
    texts |= descriptions(command)
    positional = [name for name, p in flat.items() if p.kind is not Parameter.KEYWORD_ONLY]
    options = [_option(flat[name], hints[name], texts.get(name, "")) for name in flat]
    required = [name for name in positional if flat[name].default is Parameter.empty]
    metavars = {p.name: p.annotation.__metadata__[0].metavar for p in options}

    def run(context: typer.Context, **values: Any) -> None:
        values = fill(context, values, positional)
        check_required({name: metavars[name] for name in required}, values)
        for name, group in groups.items():
            values[name] = group(**{field: values.pop(field) for field in fields[name]})
        command(**values)

    first = Parameter("context", Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)
    # Typer reads the options of a command from its signature.
    run.__signature__ = Signature([first, *options])  # type: ignore[attr-defined]
    return run


def _option(parameter: Parameter, hint: Any, text: str) -> Parameter:
    """Return a parameter with its type and its `Option` or `Argument`, as Typer has them."""
    if NoneType in get_args(hint):
        (hint,) = (part for part in get_args(hint) if part is not NoneType)
    is_repeated = get_origin(hint) is list
    element = get_args(hint)[0] if is_repeated else hint
    base, kind = element, Kind("")
    if get_origin(element) is Annotated:
        base, kind = get_args(element)
    elif get_origin(element) is Literal:
        base = str
        values = get_args(element)
        kind = choice(option_name(parameter.name).removeprefix("--"), lambda: values)
    is_argument = parameter.kind is not Parameter.KEYWORD_ONLY
    sentences = [text.removesuffix(".") + (f", {kind.hint}" if kind.hint else "") + "."]
    sentences += ["May be repeated."] * (is_repeated and not is_argument)
    keywords: dict[str, Any] = {
        "help": " ".join(sentences),
        "metavar": kind.metavar or None,
        "parser": kind.parse,
        "autocompletion": kind.completer,
    }
    default = _text(parameter.default, kind)
    info: Any
    if is_argument:
        info = typer.Argument(**keywords)
        default = None if default is Parameter.empty else default
    else:
        info = typer.Option(*WORDS.get(parameter.name, (option_name(parameter.name),)), **keywords)
    base = str if kind.parse is not None else base
    annotation = Annotated[list[base] if is_repeated else base, info]  # type: ignore[valid-type]
    return Parameter(parameter.name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _text(default: Any, kind: Kind) -> Any:
    """Return a default as the command line has it, from which its kind parses it."""
    is_text = kind.parse is None or default is None or default is Parameter.empty
    return default if is_text else text_of(default)


def check_required(required: Mapping[str, str], values: Mapping[str, Any]) -> None:
    """Raise BadParameter for a missing one of the `required` arguments {name: metavar}."""
    spared = {"urdf": values.get("run"), "logs": values.get("condition")}
    for name, metavar in required.items():
        if not values[name] and not spared.get(name):
            hint = ", or have a seaid.toml here (seaid init)" * (metavar in ("URDF", "LOG"))
            raise typer.BadParameter(f"it is missing: name it{hint}", param_hint=metavar)
