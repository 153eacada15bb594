"""Number of files that `seaid.identify` enters on the plain TULip leg, and of changes of file.

    python -m scripts.benchmarks.hops

Counted by `sys.setprofile` over one call with the defaults (`method="auto"`, which tries both sides
at once after two steps; `estimator="wls"`) on the simulated log of the shipped plan, after
everything has been imported and compiled once. The last line names the method of the result.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any

import seaid
from scripts.short_form import leg_plan

MODELS = Path(__file__).resolve().parents[2] / "models"
PACKAGE = str(Path(seaid.__file__).parent)


def hops() -> tuple[Counter[str], int, str]:
    """Return the calls per file of seaid, the calls from one file to another, and the method."""
    robot = seaid.load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml")
    plan = leg_plan()
    log = seaid.simulate(robot, plan, seed=1)
    known = robot.without_nominal()
    seaid.identify(known, log)
    entered: Counter[str] = Counter()
    changes = 0

    def watch(frame: FrameType, event: str, _: Any) -> None:
        nonlocal changes
        file = frame.f_code.co_filename
        if event == "call" and file.startswith(PACKAGE):
            entered[file] += 1
            caller = frame.f_back.f_code.co_filename if frame.f_back is not None else ""
            changes += caller != file

    sys.setprofile(watch)
    try:
        method = seaid.identify(known, log).method
    finally:
        sys.setprofile(None)
    return entered, changes, method


def main() -> None:
    """Print the files, with the most frequently called ones last."""
    entered, changes, method = hops()
    for file, calls in sorted(entered.items(), key=lambda one: one[1]):
        print(f"{calls:8,}  {Path(file).relative_to(PACKAGE)}")
    print(f"{len(entered)} files entered, {changes:,} changes of file, by {method}")


if __name__ == "__main__":
    main()
