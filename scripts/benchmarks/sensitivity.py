"""False flags and found biases of the comparison of two cutoffs in `identify`.

Right set-ups are the leg and the mixed arm of the tests with their sensors; the biased ones are the
measured logs of the double pendulum, each alone, whose published parameters are known.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np

import seaid
from seaid._progress import track
from seaid.report import table

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.short_form import add_quick, few
from seaid.simulation.simulation import measure
from tests.experiments import (
    ARM_SENSORS,
    LEG_SENSORS,
    TEST_MASS,
    arm,
    arm_motion,
    leg,
    leg_motion,
)

ROOT = Path(__file__).resolve().parents[2]
CODES = ("homogeneous", "cutoff-sensitive")
PUBLISHED = {1: -0.3491, 2: 0.1079, 4: -0.1111, 5: 0.0239}
"""{place among the base parameters: published value}."""


def flags(found: seaid.Identification) -> list[str]:
    """Return the codes of the comparisons that an identification has."""
    return sorted({one.code for one in found.warnings if one.code in CODES})


def _leg() -> tuple[seaid.Robot, seaid.Motion]:
    return leg(TEST_MASS), leg_motion(TEST_MASS)


def _arm() -> tuple[seaid.Robot, seaid.Motion]:
    return arm(), arm_motion()


def false_flags(draws: int) -> list[list[str]]:
    """Return a line per right robot: the flags of so many draws of its sensors."""
    lines = []
    for make, sensors in few(((_leg, LEG_SENSORS), (_arm, ARM_SENSORS))):
        truth, motion = make()
        known = truth.without_nominal()
        found = [
            flags(seaid.identify(known, measure(truth, motion, sensors, seed)))
            for seed in track(range(draws), truth.name, True)
        ]
        lines.append([truth.name, str(draws), str(sum(map(bool, found)))])
    return lines


def measured(data: Path) -> list[list[str]]:
    """Return a line per log and cutoff: the largest error of a published value, and the flags."""
    models = ROOT / "models"
    robot = seaid.load_robot(models / "double_pendulum_a0.urdf", models / "double_pendulum_a0.toml")
    lines = []
    for kind in ("weak", "strong"):
        description = models / "logs" / f"double_pendulum_{kind}.toml"
        for path in few(sorted(data.glob(f"double_pendulum_a0/{kind}_torque/*"))):
            log = seaid.read_log(path, robot, description=description)
            for cutoff_hz in few((None, 2.5)):
                found = seaid.identify(robot, log, cutoff_hz=cutoff_hz)
                off = [found.load.values[place] / value - 1 for place, value in PUBLISHED.items()]
                worst = f"{np.max(np.abs(off)):.0%}"
                cutoff = f"{found.cutoff_hz:.3g} Hz"
                lines.append([path.stem[-26:], cutoff, worst, ", ".join(flags(found))])
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--data", type=Path, default=ROOT / "models" / "logs")
    add_quick(parser)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    print(table("Right set-ups", ["robot", "draws", "flagged"], false_flags(arguments.draws)))
    header = ["log", "cutoff", "largest error", "flags"]
    print(table("Double pendulum", header, measured(arguments.data)))
