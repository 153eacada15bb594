"""Causes that checks name in parts of the measured logs, whose set-ups are right.

    python scripts/benchmarks/parts_of_logs.py
    python scripts/benchmarks/parts_of_logs.py --parts 1 2 --list

Every log of `scripts/real_data.toml` is cut into 1, 2, 3 and 5 parts of equal length, and each part
is identified alone. Parts are short, move few joints, or were recorded while hands pushed the arm:
a sign, a unit or another ratio may fit what little they show. Counted are the findings above a note
whose code is a cause of the set-up (`CAUSES`), by severity, and the parts that could be identified.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import seaid
from scripts.golden_measured import LOGS, measured_robot, measured_table
from scripts.short_form import add_quick, few

CAUSES = frozenset(
    (
        *("coupled-joints", "encoder-offset", "gear-ratio", "geometry", "gravity", "payload"),
        *("rotor-inertia", "sign", "swapped-joints", "time-unit", "torque-scale", "unit"),
        *("varying-ratio", "wraps"),
    )
)
"""Codes of mistakes of the set-up that no measured set has."""

OF_HANDS = ("grav_comp_bad", "star_trace")
"""Logs of an arm that hands moved."""


class Part(NamedTuple):
    """A part of a log: the set, the file, which of how many parts, and its findings, if any."""

    of: str
    file: str
    number: int
    parts: int
    findings: tuple[seaid.Finding, ...] | None

    @property
    def causes(self) -> list[seaid.Finding]:
        """The findings above a note that name a cause of the set-up."""
        return [x for x in self.findings or () if x.severity != "note" and x.code in CAUSES]


def parts_of(table: dict[str, Any], counts: Sequence[int]) -> Iterator[Part]:
    """Yield the parts of all logs of a set."""
    robot = measured_robot(table)
    for path in sorted(LOGS.glob(table["logs"])):
        log = seaid.read_log(path, robot, description=LOGS / table["description"])
        for count in counts:
            edges = np.linspace(log.time[0], log.time[-1], count + 1).tolist()
            for number, (start, end) in enumerate(pairwise(edges), 1):
                try:
                    findings = seaid.identify(robot, log.between(start, end)).findings
                except seaid.SeaidError:  # too short, or nothing moves
                    yield Part(table["name"], path.stem, number, count, None)
                    continue
                yield Part(table["name"], path.stem, number, count, findings)


def main() -> None:
    """Print the numbers, and with --list every cause."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--parts", type=int, nargs="+", default=[1, 2, 3, 5])
    arguments.add_argument("--list", action="store_true")
    add_quick(arguments)
    options = arguments.parse_args()
    warnings.simplefilter("ignore")
    counts = {False: Counter[str](), True: Counter[str]()}
    for table in few(measured_table()):
        if Path(table["logs"]).stem == "sample":  # its motors were off, and the log is refused
            continue
        for part in parts_of(table, few(options.parts)):
            of_kind = counts[part.file in OF_HANDS]
            of_kind["parts"] += part.findings is not None
            of_kind.update({x.severity for x in part.causes})
            for finding in part.causes if options.list else ():
                place = f"{part.of}, {part.file}, {part.number} of {part.parts}"
                print(f"{place}: {finding.severity} {finding.code}: {finding.message}")
    for is_of_hands, words in ((False, "the robot alone"), (True, "hands on the robot")):
        of_kind = counts[is_of_hands]
        print(
            f"{words}: {of_kind['parts']} parts, {of_kind['wrong']} with a cause that is wrong, "
            f"{of_kind['doubtful']} with a doubtful one"
        )


if __name__ == "__main__":
    main()
