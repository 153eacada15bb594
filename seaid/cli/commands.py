"""The commands of `seaid` in the order of the work; their modules are loaded on use."""

from __future__ import annotations

from importlib import import_module
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import typer
from typer.core import TyperCommand, TyperGroup

import seaid
from seaid.cli.messages import MovedError, begin, reported
from seaid.errors import shortened

_SECTIONS = {
    "Project": ("init", "run"),
    "Robot and motion": ("inspect", "view", "excite", "simulate"),
    "Logs": ("describe", "check", "calibrate"),
    "Identification": ("identify", "frequency", "validate", "replay"),
    "Results": ("compare", "report", "export"),
}
"""{title of a section of the help: its commands}; the function of each is in a module of its name.
"""

COMMANDS = [*chain(*_SECTIONS.values())]


def summary_of(name: str) -> str:
    """Return the first line of a command's docstring, from its source, which is not imported."""
    source = Path(__file__).with_name(f"{name}.py").read_text("utf-8")
    _, _, docstring = source.partition(f"\ndef {name}(")[2].partition('"""')
    return docstring.partition("\n")[0]


MOVED = {
    "crosscheck": "write seaid inspect URDF --exact",
    "codegen": "write seaid export URDF -o FILE.py, or FILE.c",
    "delays": "write seaid check URDF LOG --delays",
    "gear-ratio": "write seaid check URDF LOG, whose table has the ratios",
    "terms": "write seaid check URDF LOG --terms",
    "refine": "write seaid identify URDF LOG --refine",
    "conditions": "write seaid identify URDF --condition NAME=LOG --condition NAME=LOG",
    "cross-validate": "write seaid validate URDF LOG LOG --cross",
    "gains": "docs/how_to/position_commands.md says how a second set of gains differs",
}
"""{former command: what to write now}."""

RENAMED = {
    "--sides": "--method two-step or simultaneous",
    "--rows": "--torque-joints",
    "--joint-zero-std": "--encoder-offset-std",
    "--drive-columns": "--drive-parameters",
    "--allow-impossible": "--allow-inconsistent",
    "--free-ends": "--ends-in-motion",
}
"""{former option: what to write now}."""


class _WordReader:
    """A command of Typer whose parameters read their words by their kinds.

    By itself Typer imports pydantic for the first parameter, which takes 0.2 s.
    """

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, with that of the help."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if hasattr(parameter, "_runtime_param"):
                parameter._runtime_param = SimpleNamespace(coerce=_value)
        return parameters


def _value(words: Any, param: Any, ctx: Any) -> Any:
    """Return the value of a parameter by its kind or type, a list of one that may be repeated."""
    described = param.type_descriptor
    plain = (get_args(described.annotation) or [described.annotation])[0]
    read = described.parameter_info.parser or plain
    is_repeated = param.multiple or param.nargs == -1
    every = words or () if is_repeated else [words]
    try:
        values = [read(word) if isinstance(word, str) else word for word in every]
    except ValueError:
        raise typer.BadParameter(f"'{shortened(str(words))}' is no {plain.__name__}") from None
    return values if is_repeated else values[0]


class _Command(_WordReader, TyperCommand):
    """A command."""


class _Commands(_WordReader, TyperGroup):
    """Commands that are loaded on use, whose warnings and errors are printed in one line each."""

    def __init__(self, **attributes: Any) -> None:
        """Make the group, without its commands."""
        super().__init__(**{**attributes, "commands": dict.fromkeys(COMMANDS)})

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Load a command."""
        return command_of(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands by sections, without loading them."""
        for title, names in _SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name, summary_of(name)) for name in names])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Note which command runs, refuse former names, and find the command."""
        begin(args[0] if args[0] in COMMANDS else "seaid", args)
        if args[0] in MOVED:
            raise MovedError(f"'seaid {args[0]}' is no longer there: {MOVED[args[0]]}")
        for option in RENAMED.keys() & {word.partition("=")[0] for word in args}:
            raise MovedError(f"'{option}' is no longer there: write {RENAMED[option]}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with reported():
            return super().invoke(ctx)


def command_of(name: str) -> Any:
    """Load a command."""
    from seaid.cli import options
    from seaid.cli.project import with_project
    from seaid.cli.signature import descriptions, for_typer, help_of

    function = getattr(import_module(f"seaid.cli.{name}"), name)
    shared = {**descriptions(options), **descriptions(options.IdentifiedOptions)}
    command = for_typer(function, shared, with_project)
    # A Typer of its own: only one command is loaded.
    alone = typer.Typer(add_completion=False, rich_markup_mode=None)
    alone.command(name, cls=_Command, help=help_of(function))(command)
    return typer.main.get_command(alone)


app = typer.Typer(
    name="seaid",
    cls=_Commands,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"seaid {seaid.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Identify robots with springs in their joints: from a URDF and a log to motor friction,
    spring stiffness and inertias, each with its standard error.

    \b
      seaid init leg.urdf run.csv other.csv              a project file, inferred
      seaid run                                          identify, validate, report, export
      seaid inspect leg.urdf --drives leg.toml           which parameters are identifiable
      seaid excite leg.urdf -o plan.json                 a motion that excites them
      seaid simulate leg.urdf plan.json --drives leg.toml -o run.csv
      seaid view leg.urdf --drives leg.toml --log run.csv
      seaid describe run.csv -o run.toml                 a log with custom columns
      seaid check leg.urdf run.csv --drives leg.toml     what is wrong with a set-up
      seaid identify leg.urdf run.csv --drives leg.toml -o parameters.json
      seaid validate leg.urdf other.csv --from run.csv --drives leg.toml
      seaid replay leg.urdf other.csv --from run.csv --drives leg.toml
      seaid report leg.urdf --from run.csv --validate other.csv --drives leg.toml
      seaid export leg.urdf --from run.csv --drives leg.toml -o found.urdf

    A seaid.toml in the working folder has the robot, logs and options of every command that names
    no other robot; the command line takes precedence. Its folder may stand for the URDF. Each
    command has its own --help with examples. Results go to stdout; notes, errors and progress go to
    stderr. Exit codes: 0 success, 1 failure (one line states the reason and the remedy), 2 wrong
    usage, 3 warnings of --fail-on. Files are written completely or not at all, and overwritten only
    with --force.
    """  # noqa: D301
