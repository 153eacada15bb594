"""Commands for Click from functions: their signatures and docstrings define the options.

What stands before `*` is an argument of the line, what stands after it an option; the fields of a
dataclass are options as well. The types are those of `seaid.cli.kinds`, and the help is that of the
NumPy docstring. A parameter that a docstring does not describe is described by that of a group.

Signatures are read here, and Click is called directly, because of the time to start: importing tyro
or cyclopts alone takes twice the time of `seaid --help`, and without Typer the help of a command
takes half the time, and six dependencies are gone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from inspect import Parameter, cleandoc, getmro, isclass, signature
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import click

from seaid.cli.kinds import File, Kind

WORDS = {
    "as_json": ("--json",),
    "from_logs": ("--from",),
    "validation": ("--validate",),
    "open_browser": ("--open",),
    "output": ("--output", "-o"),
    "verbose": ("--verbose", "-v"),
    "as_estimated": ("--as-estimated/--feasible",),
}
"""Parameters whose option has another name or a short one."""

_SECTION = re.compile(r"^(\w+)\n-+\n", re.MULTILINE)


def option_name(parameter: str) -> str:
    """Return the option of a parameter: '--rate-hz' of 'rate_hz'."""
    return WORDS.get(parameter, (f"--{parameter.replace('_', '-')}",))[0]


def _sections(documented: Any) -> tuple[str, dict[str, str]]:
    """Return the text of a docstring, and its sections by their titles."""
    text, *sections = _SECTION.split(cleandoc(documented.__doc__ or ""))
    return text.strip(), dict(zip(sections[::2], sections[1::2], strict=True))


def descriptions(documented: Any) -> dict[str, str]:
    """Return {parameter: its description} in the docstrings of a function or of a class."""
    texts: dict[str, str] = {}
    for subject in reversed(getmro(documented)) if isclass(documented) else (documented,):
        parts = _sections(subject)[1].get("Parameters", "")
        for names, text in re.findall(r"^(\S.*)\n((?:    .*\n?)+)", parts, re.MULTILINE):
            texts |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return texts


def click_command(
    function: Callable[..., None],
    shared: Mapping[str, str],
    fill: Callable[[click.Context, dict[str, Any], Sequence[str]], dict[str, Any]],
) -> click.Command:
    """Return a command as Click runs it, each option with type, default and help.

    Parameters
    ----------
    function : function
    shared : mapping {parameter: description}
        Of parameters that its docstring does not describe.
    fill : function of the context, the values and the names of the arguments
        Returns the values with those of a project file.
    """
    hints, texts = get_type_hints(function, include_extras=True), dict(shared)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    for subject in (*groups.values(), function):
        hints |= get_type_hints(subject, include_extras=True)
        texts |= descriptions(subject)
    flat = _flattened(function, groups)
    params = [_parameter(flat[name], hints[name], texts.get(name, "")) for name in flat]
    arguments = {str(x.name): x for x in params if isinstance(x, click.Argument)}
    needed = {x: str(arguments[x].metavar) for x in arguments if flat[x].default is Parameter.empty}

    @click.pass_context
    def run(context: click.Context, /, **values: Any) -> None:
        values = fill(context, values, [*arguments])
        check_required(needed, values)
        function(**_in_groups(values, groups))

    text, sections = _sections(function)
    text = f"{text}\n\n\b\n{sections.get('Examples', '')}".strip()
    return click.Command(function.__name__, callback=run, params=params, help=text)


def _flattened(function: Callable[..., None], groups: Mapping[str, Any]) -> dict[str, Parameter]:
    """Return the parameters of a function, the fields of groups in the place of these."""
    flat: dict[str, Parameter] = {}
    for name, parameter in signature(function).parameters.items():
        flat |= signature(groups[name]).parameters if name in groups else {name: parameter}
    return flat


def _in_groups(values: dict[str, Any], groups: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values with an object of each group in the place of its fields."""
    for name, group in groups.items():
        values[name] = group(**{field: values.pop(field) for field in signature(group).parameters})
    return values


def _kind_of(hint: Any) -> tuple[Any, bool]:
    """Return the kind of the values of an annotation, and whether it may be repeated.

    `tuple[kind, ...]` may be repeated, and `kind | None` has the default None.
    """
    if NoneType in get_args(hint):
        (hint,) = (part for part in get_args(hint) if part is not NoneType)
    is_repeated = get_origin(hint) is tuple
    kind: Any = get_args(hint)[0] if is_repeated else hint
    if get_origin(kind) is Annotated:
        (kind,) = kind.__metadata__
    elif get_origin(kind) is Literal:
        kind = click.Choice(get_args(kind))
    return kind, is_repeated


def _parameter(parameter: Parameter, hint: Any, text: str) -> click.Parameter:
    """Return a parameter as Click has it, by its annotation."""
    kind, is_repeated = _kind_of(hint)
    name, default = parameter.name, parameter.default
    metavar = kind.name if isinstance(kind, Kind | File) else None
    shape: dict[str, Any]
    if parameter.kind is not Parameter.KEYWORD_ONLY:
        shape = {} if default is Parameter.empty else {"default": default}
        shape |= {"nargs": -1 if is_repeated else 1, "metavar": metavar}
        return click.Argument([name], False, text, type=kind, **shape)
    more = f"{text.removesuffix('.')}{getattr(kind, 'hint', '')}."
    more += " May be repeated." * is_repeated
    # A default of Click that is None is a value, so that a required option has none.
    usual = None if is_repeated else default
    shape = {"required": True} if default is Parameter.empty else {"default": usual}
    shape |= {"multiple": True} if is_repeated else {"is_flag": kind is bool}
    return click.Option(
        [*WORDS.get(name, (option_name(name),)), name],
        type=kind,
        help=more,
        metavar=metavar,
        **shape,
    )


def check_required(required: Mapping[str, str], values: Mapping[str, Any]) -> None:
    """Raise BadParameter for a missing one of the `required` arguments {name: metavar}."""
    for name, metavar in required.items():
        if not values[name] and not (name == "urdf" and values.get("run")):
            hint = ", or have a seaid.toml here (seaid init)" * (metavar in ("URDF", "LOG"))
            hint = _project_hint(values.get("urdf")) or hint
            raise click.BadParameter(f"it is missing: name it{hint}", param_hint=metavar)


def _project_hint(folder: Any) -> str:
    """Return what to call for a project that is in the place of a robot."""
    from seaid._files import PROJECT_FILE

    if folder is None or not (folder / PROJECT_FILE).is_file():
        return ""
    return f"; '{folder}' is a project: seaid run {folder} identifies it"
