"""Processor time of a simulation of the TULip leg, of this code and of another revision.

python scripts/benchmarks/simulation_time.py --against main

Runs of both alternate, each in a process of its own, and their trajectories are compared.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from io import BytesIO
from pathlib import Path

import numpy as np

from scripts.short_form import add_quick, sized
from seaid._arrays import Array

ROOT = Path(__file__).resolve().parents[2]

WORK = """
import sys, time
import numpy as np
import seaid
from seaid.simulation.simulation import SETTLE_S, simulate_motion

class Part:  # the first seconds of the plan
    def __init__(self, plan, duration):
        self.joint_names, self.duration, self.sample = plan.joint_names, duration, plan.sample

models, duration = sys.argv[3], float(sys.argv[1])
robot = seaid.load_robot(f"{models}/tulip_leg.urdf", f"{models}/tulip_leg.toml")
plan = seaid.load_trajectory(f"{models}/tulip_plan.json")
before = time.process_time()
motion = simulate_motion(robot, Part(plan, duration))
print((time.process_time() - before) / (duration + SETTLE_S))
np.save(sys.argv[2], np.hstack([motion.joint_position, motion.motor_position]))
"""


def simulated(code: Path, duration_s: float, folder: Path) -> tuple[float, Array]:
    """Return the processor time [s] per second by the seaid in a folder, and the positions."""
    environment = {**os.environ, "PYTHONPATH": str(code), "OPENBLAS_NUM_THREADS": "1"}
    path = folder / "positions.npy"
    run = subprocess.run(
        [sys.executable, "-c", WORK, str(duration_s), str(path), str(ROOT / "models")],
        cwd=code,  # `-c` imports from there first
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return float(run.stdout), np.load(path)


def main(revision: str | None, runs: int, duration_s: float) -> None:
    """Print the medians of alternating runs, and the largest difference of positions."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        places = {"here": ROOT}
        if revision is not None:
            packed = subprocess.run(
                ["git", "archive", revision, "seaid"], cwd=ROOT, check=True, capture_output=True
            )
            with tarfile.open(fileobj=BytesIO(packed.stdout)) as archive:
                archive.extractall(folder, filter="data")
            places[revision] = folder
        seconds: dict[str, list[float]] = {place: [] for place in places}
        positions: dict[str, Array] = {}
        for _ in range(runs):
            for place, code in places.items():
                taken, positions[place] = simulated(code, duration_s, folder)
                seconds[place].append(taken)
    for place, times in seconds.items():
        print(f"{place}: {statistics.median(times):.3f} s per s of motion, least {min(times):.3f}")
    if revision is not None:
        ratios = [a / b for a, b in zip(seconds["here"], seconds[revision], strict=True)]
        difference = np.max(np.abs(positions["here"] - positions[revision]))
        print(f"here / {revision}: {statistics.median(ratios):.2f}, median of the rounds")
        print(f"largest difference of positions: {difference:.1e} rad")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", metavar="REVISION")
    parser.add_argument("--runs", type=int, default=sized(5, 1))
    add_quick(parser)
    given = parser.parse_args()
    main(given.against, given.runs, sized(2.0, 0.05))
