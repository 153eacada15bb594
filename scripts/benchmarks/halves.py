"""Compare the estimates from the two halves of each measured set with their standard errors.

Sets of several logs are halved by every second log, sets of one log by time. Right standard errors
give differences over their standard errors with a root mean square of one, 5 % of them above two.
Larger ones are right only where the result has a warning.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np

import seaid
from seaid._arrays import Array

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.gauntlet import markdown
from scripts.real_data import DATA, Case, read_cases
from scripts.short_form import few

HEADER = ("set", "parameters", "rms", "> 2 [%]", "worst", "warnings but notes")


def main() -> None:
    """Print a line per measured set."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    rows = []
    for case in few(read_cases()):
        try:
            rows.append(compared(case))
        except seaid.SeaidError:
            rows.append([case.name, "-", "-", "-", "-", "refused: a channel is missing"])
    print(markdown(HEADER, rows))


def compared(case: Case) -> list[str]:
    """Return the line of a measured set."""
    robot = case.load_robot()
    found = [seaid.identify(robot, half) for half in halves(case.read_logs(robot, DATA))]
    names, scores = differences(*found)
    worst = int(np.argmax(np.abs(scores)))
    codes = sorted({one.code for half in found for one in half.warnings if one.severity != "note"})
    share = 100 * np.mean(np.abs(scores) > 2)
    rms = np.sqrt(np.mean(np.square(scores)))
    size = f"{names[worst]} {scores[worst]:.1f}"
    return [case.name, str(len(scores)), f"{rms:.2f}", f"{share:.0f}", size, ", ".join(codes)]


def halves(logs: list[seaid.Log]) -> tuple[list[seaid.Log], list[seaid.Log]]:
    """Return every second log, or both halves of a single one."""
    if len(logs) > 1:
        return logs[::2], logs[1::2]
    middle = float(np.mean(logs[0].time[[0, -1]]))
    return [logs[0].between(-np.inf, middle)], [logs[0].between(middle, np.inf)]


def differences(one: seaid.Identification, other: seaid.Identification) -> tuple[list[str], Array]:
    """Return the parameters in both results, and their differences over the standard errors."""
    pairs = [("", one.load, other.load)]
    pairs += [(f" of {j}", one.drives[j], other.drives[j]) for j in one.drives if j in other.drives]
    names, scores = [], []
    for joint, own, its in pairs:
        for name in set(own.names) & set(its.names):
            error = np.hypot(own.standard_error(name), its.standard_error(name))
            names.append(f"{name.split(' ')[0]}{joint}")
            scores.append((own.value(name) - its.value(name)) / error)
    return names, np.array(scores)


if __name__ == "__main__":
    main()
