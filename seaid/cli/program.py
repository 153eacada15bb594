"""The program `seaid`: the command line with safe streams."""

from __future__ import annotations

_COLLECT_AFTER = (500_000, 20, 20)
"""Objects between collections of garbage: an import makes many and drops none, 0.2 s otherwise."""


def main() -> None:
    """Run the command line; called by the console script `seaid` and by `python -m seaid`."""
    import gc

    gc.set_threshold(*_COLLECT_AFTER)
    from seaid.cli.commands import app
    from seaid.cli.messages import safe_streams

    with safe_streams():
        app(prog_name="seaid")
