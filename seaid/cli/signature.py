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
    hints, texts = get_type_hints(command, include_extras=True), dict(shared)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    for subject in (*groups.values(), command):
        hints |= get_type_hints(subject, include_extras=True)
        texts |= descriptions(subject)
    flat: dict[str, Parameter] = {}
    for name, parameter in signature(command).parameters.items():
        flat |= signature(groups[name]).parameters if name in groups else {name: parameter}
    positional = [name for name, p in flat.items() if p.kind is not Parameter.KEYWORD_ONLY]
    options = {name: _option(flat[name], hints[name], texts.get(name, "")) for name in flat}
    required = {
        name: options[name].annotation.__metadata__[0].metavar
        for name in positional
        if flat[name].default is Parameter.empty
    }

    def run(context: typer.Context, **values: Any) -> None:
        values = fill(context, values, positional)
        check_required(required, values)
        command(**_in_groups(values, groups))

    first = Parameter("context", Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)
    # Typer reads the options of a command from its signature.
    run.__signature__ = Signature([first, *options.values()])  # type: ignore[attr-defined]
    return run


def _in_groups(values: dict[str, Any], groups: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values with an object of each group in the place of its fields."""
    for name, group in groups.items():
        values[name] = group(**{field: values.pop(field) for field in signature(group).parameters})
    return values


def _kind_of(option: str, hint: Any) -> tuple[Any, Kind, bool]:
    """Return the type and the kind of the values of an option, and whether it may be repeated."""
    if NoneType in get_args(hint):
        (hint,) = (part for part in get_args(hint) if part is not NoneType)
    is_repeated = get_origin(hint) is list
    element = get_args(hint)[0] if is_repeated else hint
    if get_origin(element) is Annotated:
        return *get_args(element), is_repeated
    if get_origin(element) is Literal:
        return str, choice(option.removeprefix("--"), lambda: get_args(element)), is_repeated
    return element, Kind(""), is_repeated


def _option(parameter: Parameter, hint: Any, text: str) -> Parameter:
    """Return a parameter with its type and its `Option` or `Argument`, as Typer has them."""
    option = option_name(parameter.name)
    base, kind, is_repeated = _kind_of(option, hint)
    is_argument = parameter.kind is not Parameter.KEYWORD_ONLY
    sentences = [text.removesuffix(".") + (f", {kind.hint}" if kind.hint else "") + "."]
    sentences += ["May be repeated."] * (is_repeated and not is_argument)
    keywords: dict[str, Any] = {
        "help": " ".join(sentences),
        "metavar": kind.metavar or None,
        "parser": kind.parse,
        "autocompletion": kind.completer,
    }
    default, info = parameter.default, None
    if kind.parse is not None and default not in (None, Parameter.empty):
        default = text_of(default)  # from which the kind parses it
    if is_argument:
        info = typer.Argument(**keywords)
        default = None if default is Parameter.empty else default
    else:
        info = typer.Option(*WORDS.get(parameter.name, (option,)), **keywords)
    base = str if kind.parse is not None else base
    annotation = Annotated[list[base] if is_repeated else base, info]  # type: ignore[valid-type]
    return Parameter(parameter.name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def check_required(required: Mapping[str, str], values: Mapping[str, Any]) -> None:
    """Raise BadParameter for a missing one of the `required` arguments {name: metavar}."""
    spared = {"urdf": values.get("run"), "logs": values.get("condition")}
    for name, metavar in required.items():
        if not values[name] and not spared.get(name):
            hint = ", or have a seaid.toml here (seaid init)" * (metavar in ("URDF", "LOG"))
            raise typer.BadParameter(f"it is missing: name it{hint}", param_hint=metavar)
