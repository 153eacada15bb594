"""Planning: condition numbers and times compared with their targets, and the cost of a gradient.

Every plan starts new processes; their start is included in its time.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from loky import get_reusable_executor

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.example_robots import example_urdf
from scripts.short_form import add_quick, few, plan, sized
from seaid.excitation import EndState, make_basis
from seaid.excitation.boundary import motion_space
from seaid.excitation.criteria import CRITERIA, CriterionName, pivoted_base
from seaid.excitation.limits import joint_limits
from seaid.excitation.observation_matrix import load_target
from seaid.excitation.problem import (
    PlanningProblem,
    make_problem,
    random_start,
    scaled_target,
    value_and_gradient,
    value_of,
)
from seaid.report import table

MODELS = Path(__file__).resolve().parents[2] / "models"
PANDA_ARM = [f"panda_joint{number}" for number in range(1, 8)]
DURATION_S = 10.0
LEG_LIMITS = seaid.Limits(velocity=2.5, acceleration=10.0)
ARM_LIMITS = seaid.Limits(acceleration=10.0)
LEG, PANDA, UR10 = "TULip leg", "Panda arm", "UR10"
FIGURES: list[tuple[str, str, bool, float | None, float | None]] = [
    (LEG, "bspline", True, 28, 20),
    (LEG, "fourier", True, None, None),
    (LEG, "polynomial", True, None, None),
    (LEG, "bspline", False, 20, None),
    *((PANDA, basis, True, 18, 30) for basis in ("bspline", "fourier", "polynomial")),
    *((UR10, basis, True, 8, 30) for basis in ("bspline", "fourier", "polynomial")),
]
"""Robot, basis, rest to rest, and the targets of condition number and seconds."""

COEFFICIENTS, SAMPLES = sized((8, 16, 32, 64), (8,)), sized((256, 512, 1024, 2048), (256,))
TURNS, MOST_RATIO = sized(7, 1), 12.0


def load_robots() -> dict[str, tuple[seaid.Robot, seaid.Limits]]:
    """Return the three robots with their nominal values, and the limits of their motions."""
    leg = seaid.load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml")
    panda = seaid.load_robot(example_urdf("panda.urdf"), joints=PANDA_ARM)
    ur10 = seaid.load_robot(example_urdf("ur10_robot.urdf"))
    return {LEG: (leg, LEG_LIMITS), PANDA: (panda, ARM_LIMITS), UR10: (ur10, ARM_LIMITS)}


def cpu_seconds() -> float:
    """Return process time of this process and of its children that have ended."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    usages = [resource.getrusage(kind) for kind in kinds]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def timed_plan(robot: seaid.Robot, **request: Any) -> tuple[seaid.Excitation, float, float]:
    """Return a plan with its wall and process seconds."""
    wall, cpu = time.perf_counter(), cpu_seconds()
    planned = plan(robot, DURATION_S, **request)
    wall = time.perf_counter() - wall
    get_reusable_executor().shutdown(wait=True)
    return planned, wall, cpu_seconds() - cpu


def figures(seeds: int) -> str:
    """Return the table of condition numbers and seconds, worst of the seeds next to seed 0."""
    robots, rows = load_robots(), []
    for name, basis, rest, condition, seconds in few(FIGURES):
        robot, limits = robots[name]
        found = [
            timed_plan(
                robot.without_nominal(), basis=basis, limits=limits, rest_to_rest=rest, seed=seed
            )
            for seed in range(seeds)
        ]
        conditions = [plan.condition_number for plan, _, _ in found]
        rows.append(
            [
                f"{name} ({len(found[0][0].names)})",
                basis,
                "rest to rest" if rest else "free",
                f"{conditions[0]:.1f}",
                f"{max(conditions):.1f}",
                "-" if condition is None else f"< {condition:g}",
                *(f"{max(each):.0f} s" for each in list(zip(*found, strict=True))[1:]),
                "-" if seconds is None else f"< {seconds:g} s",
            ]
        )
    header = ["robot", "basis", "ends", "condition", f"worst of {seeds} seeds", "wanted"]
    title = f"Plans of {DURATION_S:g} s, defaults; load of the machine {os.getloadavg()[0]:.1f}"
    return table(title, [*header, "wall", "process time", "wanted"], rows)


def make(
    robot: seaid.Robot, limits: seaid.Limits, criterion: CriterionName, count: int, samples: int
) -> PlanningProblem:
    """Return the planning problem with all torques and without drive limits."""
    basis, bounds = make_basis("bspline", DURATION_S, count), joint_limits(robot, limits)
    space = motion_space(basis, robot.joint_names, bounds, EndState(), EndState())
    base = pivoted_base(robot, None)
    target = load_target(robot, None, base)
    problem = make_problem(target, criterion, space, samples, bounds, None, None)
    relative = CRITERIA[criterion].needs_nominal
    return replace(problem, target=scaled_target(problem, robot, base, 1.0, relative))


def seconds(function: Callable[[], object]) -> float:
    """Return the smallest process time of a call over the turns."""
    times = []
    for _ in range(TURNS):
        begin = time.process_time()
        function()
        times.append(time.process_time() - begin)
    return min(times)


def costs(problem: PlanningProblem) -> tuple[float, float]:
    """Return the seconds of the value alone, and of value and gradient."""
    x = random_start(problem, np.random.default_rng(0))
    return seconds(lambda: value_of(problem, x)), seconds(lambda: value_and_gradient(problem, x))


def ratios() -> str:
    """Return the table of the time of value and gradient over value, by coefficients per joint."""
    rows = []
    for name, (robot, limits) in few(load_robots().items()):
        for criterion in CRITERIA:
            found = [
                costs(make(robot, limits, criterion, count, SAMPLES[0])) for count in COEFFICIENTS
            ]
            shown = [f"{both / alone:.1f}" for alone, both in found]
            rows.append([name, criterion, f"{1e3 * found[0][0]:.1f} ms", *shown])
    header = ["robot", "criterion", "value", *(f"{count} coefficients" for count in COEFFICIENTS)]
    title = f"Value and gradient over value, {SAMPLES[0]} instants; wanted <= {MOST_RATIO:g}"
    return table(title, header, rows)


def scaling() -> str:
    """Return the table of the time of value and gradient over samples."""
    rows = []
    for name, (robot, limits) in few(load_robots().items()):
        found = [
            costs(make(robot, limits, "condition_number", 32, samples))[1] for samples in SAMPLES
        ]
        shown = [
            f"{1e6 * each / samples:.0f} us" for each, samples in zip(found, SAMPLES, strict=True)
        ]
        rows.append([name, *shown])
    header = ["robot", *(f"{samples} instants" for samples in SAMPLES)]
    return table("Value and gradient, time per instant (32 coefficients)", header, rows)


def main() -> None:
    """Print the requested tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1, help="of each plan (default 1)")
    parser.add_argument("--only", choices=("plans", "gradient"), help="one of the parts")
    add_quick(parser)
    arguments = parser.parse_args()
    begin = time.perf_counter()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    if arguments.only != "plans":
        print(ratios())
        print(scaling())
    if arguments.only != "gradient":
        print(figures(arguments.seeds))
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
