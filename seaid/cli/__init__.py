"""The command line `seaid`: one command for each step of the library, `main` runs it.

In: files (URDF, TOML, logs, trajectories). Out: results on stdout or in files, notes and errors on
stderr. The commands have the names and options of the functions of the library that they call.

$ seaid identify leg.urdf run.csv --drives leg.toml -o parameters.json
"""

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
