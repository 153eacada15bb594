"""The program `seaid`: the command line, whose streams may be closed, full, or lack characters."""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress

_COLLECT_AFTER = (500_000, 20, 20)
"""Objects between collections of garbage: an import makes many and drops none, 0.2 s otherwise."""


def main() -> None:
    """Run the command line; called by the console script `seaid` and by `python -m seaid`."""
    import gc

    gc.set_threshold(*_COLLECT_AFTER)
    from seaid.cli.commands import app
    from seaid.errors import reason_of

    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller: Click would print errors on stdout
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        app(prog_name="seaid")
    except OSError as problem:
        with suppress(OSError):
            print(f"Error: cannot write the output: {reason_of(problem)}", file=sys.stderr)
        # Python flushes both streams at its exit, which would fail again.
        sys.stdout = sys.stderr = None
        sys.exit(1)
