"""What describe_log says of real headers, and how long HEBI's log of the repository takes to open.

    python -m scripts.benchmarks.log_headers

The headers are those of tests/data/headers, with samples that fit their truth.
"""

from __future__ import annotations

import sys
import time
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seaid.log.readers.opening import open_table
from seaid.report import table
from tests.log.describe.test_inference import (
    ALL,
    DEVELOP,
    FIRST_HALF,
    HELD_OUT,
    LAST,
    SECOND_HALF,
    TWENTY,
    judged,
)

HEBI = Path(__file__).resolve().parents[2] / "models/logs/hebi_x5_unloaded/exampleLog.hebilog"


def main() -> None:
    """Print the table of the headers and the time of the HEBI log."""
    rows = []
    groups = {"59, developed on": DEVELOP, "59, others": HELD_OUT}
    groups |= {
        "42, first half": FIRST_HALF,
        "42, second half": SECOND_HALF,
        "9": LAST,
        "20": TWENTY,
    }
    for name, headers in groups.items():
        columns = [column for header in headers for column in judged(ALL.index(header))]
        right = [one for _, one, _ in columns]
        silent = sum(not right and not listed for _, right, listed in columns)
        rows.append([name, str(len(headers)), str(len(columns)), f"{sum(right) / len(right):.1%}"])
        doubted = sum(ok and listed and not one.doubtful for one, ok, listed in columns)
        rows[-1] += [str(silent), f"{doubted / sum(right):.1%}"]
    print(
        table(
            "describe_log",
            ["headers", "count", "columns", "right", "wrong, not listed", "right, doubted"],
            rows,
        )
    )
    if find_spec("hebi"):
        start = time.perf_counter()
        found = open_table(HEBI)
        samples = len(next(iter(found.load(["position[0]"]).values())))
        print(f"{HEBI.name}: {samples} samples opened in {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    main()
