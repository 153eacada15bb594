"""The commands of `seaid`, in the order of the work."""

from __future__ import annotations

from collections.abc import Callable
from inspect import cleandoc
from typing import Any

import typer
from typer.core import TyperGroup

from seaid.cli import excite, export, identify, inspect, report, view
from seaid.cli.messages import reported
from seaid.cli.options import with_groups

_HELP = """Identify robots with springs in their joints: from a URDF and a log to motor friction,
spring stiffness and inertias, each with its standard error.

\b
  seaid inspect leg.urdf --drives leg.toml           which parameters are identifiable
  seaid excite leg.urdf -o plan.json                 a motion that excites them
  seaid simulate leg.urdf plan.json --drives leg.toml -o run.csv
  seaid view leg.urdf --drives leg.toml --log run.csv
  seaid describe run.csv -o run.toml                 a log with custom columns
  seaid check leg.urdf run.csv --drives leg.toml     what is wrong with a set-up
  seaid identify leg.urdf run.csv --drives leg.toml -o parameters.json
  seaid validate leg.urdf other.csv --from run.csv --drives leg.toml
  seaid report leg.urdf --from run.csv --validate other.csv --drives leg.toml
  seaid export leg.urdf --from run.csv --drives leg.toml -o found.urdf

Each command has its own --help with examples. Results go to stdout; notes, errors and progress go
to stderr. Exit codes: 0 success, 1 failure (one line states the reason and the remedy), 2 wrong
usage, 3 warnings of --fail-on. Files are written completely or not at all, and overwritten only
with --force."""


class _Commands(TyperGroup):
    """Commands whose warnings and errors are printed in one line each."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with reported():
            return super().invoke(ctx)


app = typer.Typer(
    name="seaid",
    cls=_Commands,
    help=_HELP,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        from seaid import __version__

        typer.echo(f"seaid {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version."
    ),
) -> None:
    pass


def _add(name: str, function: Callable[..., None]) -> None:
    """Add a command; its help is the docstring, with one line per example."""
    text = cleandoc(function.__doc__ or "")
    app.command(name, help=text.replace("\n\nseaid ", "\n\n\b\nseaid "))(with_groups(function))


_add("inspect", inspect.inspect)
_add("crosscheck", inspect.crosscheck)
_add("excite", excite.excite)
_add("simulate", excite.simulate)
_add("view", view.view)
_add("describe", inspect.describe)
_add("check", identify.check)
_add("identify", identify.identify)
_add("validate", identify.validate)
_add("terms", identify.terms)
_add("report", report.report)
_add("export", export.export)
