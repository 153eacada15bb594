"""Exact base parameters: smallest process time on one core, and memory."""

from __future__ import annotations

import resource
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.example_robots import example_urdfs
from scripts.short_form import few, sized
from seaid.report import table

MODELS = Path(__file__).resolve().parents[2] / "models"
PANDA_ARM = [f"panda_joint{number}" for number in range(1, 8)]
FIGURES: list[tuple[str, list[str] | None, float]] = [
    ("tulip_leg.urdf", None, 0.1),
    ("ur5_robot.urdf", None, 0.1),
    ("xarm7.urdf", None, 0.1),
    ("panda.urdf", PANDA_ARM, 0.1),
    ("g1_29dof_rev_1_0.urdf", None, 0.5),
    ("talos_full_v2.urdf", None, 0.5),
    ("romeo.urdf", None, 0.3),
    ("tiago_dual.urdf", None, 2.0),
]
TURNS = sized(3, 1)


def seconds(function: Callable[[], object]) -> float:
    """Return the smallest process time of a call over the turns."""
    times = []
    for _ in range(TURNS):
        begin = time.process_time()
        function()
        times.append(time.process_time() - begin)
    return min(times)


def line(robot: seaid.Robot, figure: float) -> list[str]:
    """Return robot, joints, base parameters, seconds and the target."""
    base = seaid.symbolic.base_parameters(robot)
    least = seconds(lambda: seaid.symbolic.base_parameters(robot))
    name = f"{robot.name} ({robot.n} joints)"
    return [name, str(base.rank), f"{least:.3f}", f"< {figure:g}"]


def main() -> None:
    """Time all figures of the exact path."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    paths = {path.name: path for path in MODELS.glob("*.urdf")}
    paths = {path.name: path for path in example_urdfs()} | paths
    rows = []
    for name, joints, figure in few(FIGURES):
        rows.append(line(seaid.load_robot(paths[name], joints=joints), figure))
    header = ["robot", "base", "time [s]", "figure [s]"]
    print(table(f"Exact base parameters, process time, least of {TURNS}", header, rows))
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    print(f"Peak memory of the process, Pinocchio and sympy included: {peak / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
