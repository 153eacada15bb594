"""Time of the stacked regressor over that of the bare Pinocchio calls, alternately."""

from __future__ import annotations

import statistics
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.example_robots import example_urdf
from scripts.short_form import sized
from seaid._arrays import Array
from seaid.regressor import rigid_body_regressor
from seaid.report.text import table

MODELS = Path(__file__).resolve().parents[2] / "models"
SAMPLES, TURNS = sized((10_000, 15), (1000, 2))


def bare(model: pin.Model, q: Array, v: Array, a: Array) -> None:
    """Call Pinocchio for every sample and discard the results."""
    data = model.createData()
    for t in range(len(q)):
        pin.computeJointTorqueRegressor(model, data, q[t], v[t], a[t])


def seconds(function: Callable[[], object]) -> float:
    """Return the time of one call."""
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def compare(robot: seaid.Robot) -> list[str]:
    """Return a row: microseconds per sample of both and their ratio, medians over the turns."""
    rng = np.random.default_rng(0)
    q, v, a = rng.uniform(-1, 1, (3, SAMPLES, robot.n))
    ours, theirs = [], []
    for _ in range(TURNS):
        theirs.append(seconds(lambda: bare(robot.model, q, v, a)))
        ours.append(seconds(lambda: rigid_body_regressor(robot, q, v, a)))
    ratio = statistics.median(mine / peer for mine, peer in zip(ours, theirs, strict=True))
    cells = [1e6 * statistics.median(times) / SAMPLES for times in (theirs, ours)]
    return [f"{robot.name} ({robot.n} joints)", *(f"{cell:.2f}" for cell in cells), f"{ratio:.2f}"]


def main() -> None:
    """Compare on a leg and on two arms."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    arms = [example_urdf(name) for name in ("ur10_robot.urdf", "xarm7.urdf")]
    paths = [MODELS / "tulip_leg.urdf", *arms]
    rows = [compare(seaid.load_robot(path)) for path in paths]
    header = ["robot", "bare calls [us]", "stacked [us]", "ratio"]
    print(table(f"Regressor per sample, {SAMPLES} samples, median of {TURNS}", header, rows))


if __name__ == "__main__":
    main()
