"""What describe_log says of real headers, and how long HEBI's log of the repository takes to open.

    python -m scripts.benchmarks.log_headers

The headers are those of tests/data/headers/headers.toml, with samples that fit their truth.
"""

from __future__ import annotations

import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seaid.log.readers.opening import open_table
from seaid.report.text import table
from tests.log.test_real_headers import DEVELOP, HEADERS, HELD_OUT, judged

HEBI = Path(__file__).resolve().parents[2] / "models/logs/hebi_x5_unloaded/exampleLog.hebilog"


def main() -> None:
    """Print the table of the headers and the time of the HEBI log."""
    rows = []
    for name, headers in (("developed on", DEVELOP), ("only asked", HELD_OUT), ("all", HEADERS)):
        columns = []
        for header in headers:
            with tempfile.TemporaryDirectory() as folder:
                columns += judged(header, Path(folder))
        right = [one for _, one, _ in columns]
        silent = sum(not right and not listed for _, right, listed in columns)
        rows.append([name, str(len(headers)), str(len(columns)), f"{sum(right) / len(right):.1%}"])
        rows[-1].append(str(silent))
    print(
        table("describe_log", ["headers", "count", "columns", "right", "wrong, not listed"], rows)
    )
    if find_spec("hebi"):
        start = time.perf_counter()
        found = open_table(HEBI)
        samples = len(next(iter(found.load(["position[0]"]).values())))
        print(f"{HEBI.name}: {samples} samples opened in {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    main()
