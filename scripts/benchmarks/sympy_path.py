"""From a sympy Lagrangian to its base regressor: a spatial arm with symbolic lengths."""

from __future__ import annotations

import statistics
import sys
import time
from itertools import pairwise
from pathlib import Path

import sympy as sp

from seaid.report import table
from seaid.symbolic import equations_of_motion, reduce, separate

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.short_form import sized
from tests.symbolic.systems import Offset, arm

TURNS = sized(3, 1)


def seconds(axes: str, offsets: list[Offset]) -> tuple[list[float], int]:
    """Return the process time of each step, and the number of base parameters."""
    lagrangian, q, parameters = arm(axes, offsets)
    marks = [time.process_time()]
    equations = equations_of_motion(lagrangian, q, [sp.Symbol(f"tau{i}") for i in range(len(q))])
    marks.append(time.process_time())
    form = separate(equations, motion=[*q, *sp.symbols(f"tau:{len(q)}")], unknowns=parameters)
    marks.append(time.process_time())
    base = reduce(form)
    marks.append(time.process_time())
    steps = [end - begin for begin, end in pairwise(marks)]
    return [*steps, sum(steps)], len(base.pivots)


def main() -> None:
    """Print medians of a few turns."""
    lengths = sp.symbols("l1 l2 d1 d2")
    offsets: list[Offset] = [(0, 0, 0), (lengths[0], lengths[2], 0), (lengths[1], 0, lengths[3])]
    turns = [seconds("zyx", offsets) for _ in range(TURNS)]
    columns = zip(*(steps for steps, _ in turns), strict=True)
    medians = [statistics.median(column) for column in columns]
    cells = [f"{value:.2f}" for value in medians]
    rows = [["spatial arm zyx, 30 parameters", *cells, str(turns[0][1])]]
    header = ["system", "equations [s]", "separate [s]", "reduce [s]", "all [s]", "base"]
    print(table(f"Process time, median of {TURNS}", header, rows))


if __name__ == "__main__":
    main()
