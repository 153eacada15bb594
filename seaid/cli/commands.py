"""The commands of `seaid` in the order of the work; their modules are loaded on use."""

from __future__ import annotations

from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

import click

import seaid
from seaid.cli.messages import begin, reported

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
    "delays": "write seaid check URDF LOG, which names late channels",
    "gear-ratio": "write seaid check URDF LOG, whose table has the ratios",
    "terms": "write seaid check URDF LOG --terms",
    "refine": "write seaid identify URDF LOG --refine",
    "conditions": 'write condition = "cold" in each [[log]] of seaid.toml, and seaid run',
    "cross-validate": "write seaid validate URDF LOG LOG --cross",
    "gains": "the page on position commands says how a second set of gains differs",
}
"""{former command: what to write now}."""

_COMPLETION = 'write eval "$(_SEAID_COMPLETE=bash_source seaid)" into ~/.bashrc (zsh: zsh_source)'

RENAMED = {
    "--sides": "write --method two-step or simultaneous",
    "--rows": "write --torque-joints",
    "--joint-zero-std": "write --encoder-offset-std",
    "--drive-columns": "write --drive-parameters",
    "--allow-impossible": "write --allow-inconsistent",
    "--free-ends": "write --ends-in-motion",
    "--delays": "write seaid check without it, which names late channels",
    "--figure": "write seaid report --multisine LOG, which draws the responses",
    "--no-browser": "write seaid view without it, which opens no browser unless with --open",
    "inspect --plan": "seaid excite shows the measures of its plan, and "
    "seaid.excitation.excitation_measures those of any",
    **dict.fromkeys(("--install-completion", "--show-completion"), _COMPLETION),
    **dict.fromkeys(("--condition", "--specific", "--condition-payload"), MOVED["conditions"]),
}
"""{former option, of one command behind its name: what to write now}."""


class _Commands(click.Group):
    """Commands that are loaded on use, whose warnings and errors are printed in one line each."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load a command."""
        return command_of(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by sections, without loading them."""
        for title, names in _SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name, summary_of(name)) for name in names])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Note which command runs, and refuse former names, of options before a command too."""
        command = next(iter(args), "")
        begin(command if command in COMMANDS else "seaid", args)
        words = {word.partition("=")[0] for word in args}
        with reported():
            if command in MOVED:
                raise click.UsageError(f"'seaid {command}' is no longer there: {MOVED[command]}")
            for option in RENAMED.keys() & {*words, *(f"{command} {word}" for word in words)}:
                raise click.UsageError(f"'{option}' is no longer there: {RENAMED[option]}")
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        with reported():
            return super().invoke(ctx)


def command_of(name: str) -> click.Command:
    """Load a command."""
    from seaid.cli import options
    from seaid.cli.project import with_project
    from seaid.cli.signature import click_command, descriptions

    function = getattr(import_module(f"seaid.cli.{name}"), name)
    shared = {**descriptions(options), **descriptions(options.IdentifiedOptions)}
    return click_command(function, shared, with_project)


_SETTINGS = {"help_option_names": ["-h", "--help"], "show_default": True}


@click.group("seaid", cls=_Commands, commands=dict.fromkeys(COMMANDS), context_settings=_SETTINGS)
@click.version_option(seaid.__version__, message="seaid %(version)s")
def app() -> None:
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

    A seaid.toml in the working folder has the robot, logs and options of every command whose line
    names no robot; the command line takes precedence. Each command has its own --help with
    examples. Results go to stdout; notes, errors and progress go to stderr. Exit codes: 0 success,
    1 failure (one line states the reason and the remedy), 2 wrong usage, 3 warnings of --fail-on.
    Files are written completely or not at all, and overwritten only with --force.
    """  # noqa: D301
