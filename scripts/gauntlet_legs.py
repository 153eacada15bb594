"""A quadruped on the ground in the gauntlet: its files and its logs.

A Solo12 of 2.5 kg trots, or lifts its feet in turn, in MuJoCo. Its log has an IMU and the flags of
four feet. Its mistakes are those of `scripts/gauntlet_flags.py`.
"""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from scripts.benchmarks.legged import noisy, quadruped
from scripts.example_robots import example_urdf
from scripts.legged_plant import SOLO12, plan, plant, simulate, trot
from seaid._arrays import Array

QUADRUPED = "quadruped"
"""The name of its subject."""

DURATION_S, SEED = 20.0, 5000


def quadruped_files() -> tuple[str, dict[str, Any]]:
    """Return the URDF as text, and the options of `load_robot` of its base."""
    urdf = example_urdf(SOLO12.urdf).read_text("utf-8")
    return urdf, {"base": "floating", "contacts": SOLO12.contacts}


@cache
def true_log(motion: int) -> seaid.Log:
    """Return the log of a motion without noise: a trot, every other one lifts its feet in turn."""
    robot = quadruped(SOLO12)
    moves = plan if motion % 2 else trot
    targets = moves(robot, SOLO12, DURATION_S, SEED + motion)
    return simulate(robot, plant(robot), DURATION_S, legs=SOLO12, targets=targets)


def quadruped_columns(motion: int, seed: int | None) -> dict[str, Array]:
    """Return the log of a motion as {column: samples}, with the noise of a seed if there is one."""
    log = true_log(motion)
    if seed is not None:
        log = noisy(log, 1000 * seed + motion, SOLO12)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.npz"
        seaid.write_log(log, path)
        with np.load(path) as archive:
            return {name: archive[name] for name in archive.files}
