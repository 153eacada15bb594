"""Compare the estimates from the two halves of each measured set with their standard errors.

    python scripts/benchmarks/halves.py
    python scripts/benchmarks/halves.py --against ../main

Sets of several logs are halved by every second log, sets of one log by time. Right standard errors
give differences over their standard errors with a root mean square of one, 5 % of them above two.
Larger ones are right only where the result has a warning. With `--against TREE` a second table has
the differences themselves, here over those by the code of another checkout.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import seaid

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.gauntlet import markdown
from scripts.real_data import DATA, Case, read_cases
from scripts.short_form import add_quick, few, is_quick

HEADER = ("set", "parameters", "rms", "> 2 [%]", "worst", "warnings but notes")


Pair = tuple[str, float, float]
"""A parameter, its difference between the halves, and the standard error of this."""


def main(against: Path | None) -> None:
    """Print a line per measured set, and what became of its differences."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    rows, here = [], dict[str, list[Pair]]()
    for case in few(read_cases()):
        try:
            here[case.name], codes = compared(case)
            rows.append(line_of(case.name, here[case.name], codes))
        except seaid.SeaidError:
            rows.append([case.name, "-", "-", "-", "-", "refused: a channel is missing"])
    print(markdown(HEADER, rows))
    if against is not None:
        print(markdown(CHANGES, changes(here, differences_by(against))))


def compared(case: Case) -> tuple[list[Pair], str]:
    """Return the differences between the halves of a measured set, and the warnings of both."""
    robot = case.load_robot()
    results = [seaid.identify(robot, half) for half in halves(case.read_logs(robot, DATA))]
    warned = (warning for result in results for warning in result.warnings)
    codes = sorted({warning.code for warning in warned if warning.severity != "note"})
    return differences(*results), ", ".join(codes)


def line_of(name: str, pairs: list[Pair], codes: str) -> list[str]:
    """Return the line of a measured set."""
    scores = np.array([difference / error for _, difference, error in pairs])
    worst = int(np.argmax(np.abs(scores)))
    share = 100 * np.mean(np.abs(scores) > 2)
    rms = np.sqrt(np.mean(np.square(scores)))
    size = f"{pairs[worst][0]} {scores[worst]:.1f}"
    return [name, str(len(scores)), f"{rms:.2f}", f"{share:.0f}", size, codes]


def differences_by(tree: Path) -> dict[str, list[Pair]]:
    """Return the differences {set: differences} by the code of another checkout."""
    command = [sys.executable, __file__, "--json", *(["--quick"] if is_quick() else [])]
    environment = {**os.environ, "PYTHONPATH": str(tree.resolve())}
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    read: dict[str, list[Pair]] = json.loads(done.stdout)
    return read


def print_differences() -> None:
    """Print the differences of all sets for `differences_by`."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    sets = dict[str, list[Pair]]()
    for case in few(read_cases()):
        try:
            sets[case.name], _ = compared(case)
        except seaid.SeaidError:
            continue
    print(json.dumps(sets))


CHANGES = ("set", "parameters of both", "median", "worst", "standard errors", "rms there")


def changes(here: Mapping[str, list[Pair]], there: Mapping[str, list[Pair]]) -> list[list[str]]:
    """Return a line per set: the absolute differences here over those there, of equal names."""
    rows = []
    for name in here.keys() & there.keys():
        before = {parameter: (size, error) for parameter, size, error in there[name]}
        both = [(x, y, e, *before[x]) for x, y, e in here[name] if x in before and before[x][0]]
        ratios = np.array([abs(now / old) for _, now, _, old, _ in both])
        errors = np.median([now / old for _, _, now, _, old in both])
        rms = np.sqrt(np.mean([(size / error) ** 2 for size, error in before.values()]))
        worst = int(np.argmax(ratios))
        shown = f"{np.median(ratios):.2f}", f"{both[worst][0]} {ratios[worst]:.1f}"
        rows.append([name, str(len(both)), *shown, f"{errors:.2f}", f"{rms:.2f}"])
    return sorted(rows)


def halves(logs: list[seaid.Log]) -> tuple[list[seaid.Log], list[seaid.Log]]:
    """Return every second log, or both halves of a single one."""
    if len(logs) > 1:
        return logs[::2], logs[1::2]
    middle = float(np.mean(logs[0].time[[0, -1]]))
    return [logs[0].between(-np.inf, middle)], [logs[0].between(middle, np.inf)]


def differences(first: seaid.Identification, second: seaid.Identification) -> list[Pair]:
    """Return the differences of the parameters that both results have."""
    sides = [("", first.load, second.load)]
    drives = first.drives.keys() & second.drives.keys()
    sides += [(f" of {x}", first.drives[x], second.drives[x]) for x in sorted(drives)]
    pairs: list[Pair] = []
    for of_joint, before, after in sides:
        for name in [name for name in before.names if name in after.names]:
            error = float(np.hypot(before.standard_error(name), after.standard_error(name)))
            size = before.value(name) - after.value(name)
            pairs.append((f"{name.split(' ')[0]}{of_joint}", size, error))
    return pairs


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--against", type=Path, metavar="TREE", help="another checkout")
    parser.add_argument("--json", action="store_true", help="print differences as data")
    add_quick(parser)
    options = parser.parse_args()
    print_differences() if options.json else main(options.against)
