"""Processor time of short commands, over that of Python and its `import numpy` in the same minute.

python scripts/benchmarks/start_up.py
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
from pathlib import Path

from scripts.short_form import sized

ROOT = Path(__file__).resolve().parents[2]
LEG = ("models/tulip_leg.urdf", "--drives", "models/tulip_leg.toml")
REFERENCES = {"python -c pass": ("-c", "pass"), "import numpy": ("-c", "import numpy")}
COMMANDS = {
    "seaid --help": ("-m", "seaid", "--help"),
    "seaid identify --help": ("-m", "seaid", "identify", "--help"),
    "seaid inspect tulip_leg": ("-m", "seaid", "inspect", *LEG),
}
ROUNDS = sized(9, 1)


def seconds(arguments: tuple[str, ...]) -> float:
    """Return the processor time of one process of Python."""
    before = _of_children()
    subprocess.run([sys.executable, *arguments], cwd=ROOT, check=True, capture_output=True)
    return _of_children() - before


def _of_children() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    """Print medians of alternating runs."""
    tried = REFERENCES | COMMANDS
    runs = [{name: seconds(arguments) for name, arguments in tried.items()} for _ in range(ROUNDS)]
    found = {name: statistics.median(run[name] for run in runs) for name in tried}
    bare, numpy = (found[name] for name in REFERENCES)
    print(f"{'':25} {'s':>6} {'over python':>12} {'over numpy':>11}")
    for name, one in found.items():
        print(f"{name:25} {one:6.3f} {one / bare:12.1f} {one / numpy:11.1f}")


if __name__ == "__main__":
    main()
