"""Exact base parameters by three methods: smallest process time on one core, and memory."""

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
from seaid.regressor.exact.grouping import Route
from seaid.report import table

MODELS = Path(__file__).resolve().parents[2] / "models"
PANDA_ARM = [f"panda_joint{number}" for number in range(1, 8)]
FIGURES: list[tuple[str, list[str] | None, dict[Route, float]]] = [
    ("tulip_leg.urdf", None, {"recursion": 0.1, "energy": 0.1, "torque": 0.3}),
    ("ur5_robot.urdf", None, {"recursion": 0.1, "energy": 0.1, "torque": 0.3}),
    ("xarm7.urdf", None, {"recursion": 0.1, "energy": 0.4, "torque": 2.0}),
    ("panda.urdf", PANDA_ARM, {"recursion": 0.1, "energy": 0.4, "torque": 2.0}),
    ("g1_29dof_rev_1_0.urdf", None, {"recursion": 0.5}),
    ("talos_full_v2.urdf", None, {"recursion": 0.5}),
    ("romeo.urdf", None, {"recursion": 0.5}),
    ("tiago_dual.urdf", None, {"recursion": 2.0}),
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


def line(robot: seaid.Robot, way: Route, figure: float) -> list[str]:
    """Return robot, joints, method, base parameters, seconds and the target."""
    base = seaid.symbolic.base_parameters(robot, through=way)
    found = seconds(lambda: seaid.symbolic.base_parameters(robot, through=way))
    counts = [base.fundamental_functions, base.different_rows]
    shown = ["-" if count is None else str(count) for count in counts]
    name = f"{robot.name} ({robot.n} joints)"
    return [name, way, str(base.rank), *shown, f"{found:.3f}", f"< {figure:g}"]


def main() -> None:
    """Time all figures of the exact path."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    paths = {path.name: path for path in MODELS.glob("*.urdf")}
    paths = {path.name: path for path in example_urdfs()} | paths
    rows = []
    for name, joints, figures in few(FIGURES):
        robot = seaid.load_robot(paths[name], joints=joints)
        rows += [line(robot, way, figure) for way, figure in figures.items()]
    header = ["robot", "through", "base", "functions", "different rows", "time [s]", "figure [s]"]
    print(table(f"Exact base parameters, process time, least of {TURNS}", header, rows))
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    print(f"Peak memory of the process, Pinocchio and sympy included: {peak / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
