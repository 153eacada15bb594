"""The command line `seaid`: one command for each step, with the words of the library."""

from __future__ import annotations


def main() -> None:
    """Run the command line, as the console script `seaid` and `python -m seaid` do."""
    from seaid.cli.commands import app
    from seaid.cli.messages import safe_streams

    with safe_streams():
        app(prog_name="seaid")
