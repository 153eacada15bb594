"""Compare rules for the cutoff: on simulated robots with the best fixed one, and on real pendulums.

The TULip leg with test mass and the mixed arm of the tests are simulated on motions on which no
rule was tuned, and measured many times with fine and coarse joint encoders. The error of a cutoff
is the geometric mean over parameters of their rms error over draws, so that no parameter outweighs
the others, whatever its unit or size. On real logs, each by itself, the error is the rms relative
difference from the published values.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from unittest.mock import patch

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._progress import track
from seaid.log import Motion, filtering
from seaid.log.motion import reconstruct_motions
from seaid.report import table
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.real_data import DATA, Case, read_cases, value_of
from scripts.short_form import add_quick, few, sized
from tests.experiments import ARM_SENSORS, LEG_SENSORS, TEST_MASS, arm, arm_motion, leg, leg_motion

CUTOFFS_HZ = sized((2.0, 3.0, 4.0, 6.0, 8.0, 12.0), (4.0,))
ALL_RULES = {
    "3": (3.0, np.inf),
    "4": (4.0, np.inf),
    "6": (6.0, np.inf),
    "9": (9.0, np.inf),
    "4, coloured": (4.0, 1.5),
    "6, coloured": (6.0, 1.5),
}
"""{rule: largest cutoff over the bandwidth of the velocity, and smallest one by coloured noise}."""

RULES = dict(few(ALL_RULES.items()))
STEPS_A_TURN = few((2**11, 2**14, 2**20))
MOTION_SEEDS = few((3, 4))
ROBOTS: dict[str, tuple[Callable[[], Robot], Callable[..., Motion], Noise]] = {
    "leg": (partial(leg, TEST_MASS), partial(leg_motion, TEST_MASS), LEG_SENSORS),
    "arm": (arm, arm_motion, ARM_SENSORS),
}
_TELESCOPE_M = 0.05
"""Radius of the wheel on the rail that drives the encoder of a prismatic joint."""


def main(draws: int) -> None:
    """Print both tables."""
    robots = few(ROBOTS)
    cases = list(product(robots, STEPS_A_TURN, MOTION_SEEDS, range(draws)))
    with ProcessPoolExecutor(2) as executor:
        futures = [executor.submit(errors, *case) for case in cases]
        drawn = [future.result() for future in track(futures, "identifying", True)]
    rows = []
    for name, steps in product(robots, STEPS_A_TURN):
        found = [one for case, one in zip(cases, drawn, strict=True) if case[:2] == (name, steps)]
        sizes = []
        for side in (1, 2):
            squares = np.array([one[side] for one in found]) ** 2  # (draws, cutoffs, parameters)
            size = np.exp(np.mean(np.log(np.mean(squares, axis=0)), axis=-1) / 2)
            sizes.append(size / np.min(size[len(RULES) :]))
        cutoffs = np.mean([one[0] for one in found], axis=0)
        cells = [
            f"{cutoff:.2g} Hz: {drives:.2f}, {bodies:.2f}"
            for cutoff, drives, bodies in zip(cutoffs, *sizes, strict=False)
        ]
        rows.append([f"{name}, {steps}", *cells])
    title = f"Error over that of the best of {CUTOFFS_HZ} Hz: drives, bodies; {len(found)} draws"
    print(table(title, ["robot, joint encoder", *RULES], rows))
    sets = few(case for case in read_cases() if case.name.startswith("Double"))
    real = [row for case in sets for row in few(of_logs(case))]
    print(table("Single logs of the double pendulum: cutoff, error", ["log", *RULES], real))


def selected(robot: Robot, log: seaid.Log, rule: str) -> float:
    """Return the cutoff that a rule selects for a log."""
    wide, closest = RULES[rule]
    with patch.multiple(filtering, _WIDE=wide, _CLOSEST=closest):
        return reconstruct_motions(robot, log)[0].cutoff_hz


def errors(name: str, steps: int, motion_seed: int, seed: int) -> tuple[list[float], Array, Array]:
    """Return the selected cutoffs and the errors (rules + cutoffs, p) of drives and of bodies."""
    make, move, sensors = ROBOTS[name]
    truth, motion = make(), move(seed=motion_seed)
    turn = np.where(truth.is_prismatic, 2 * np.pi * _TELESCOPE_M, 2 * np.pi)
    noise = replace(sensors, joint_resolution_rad=tuple((turn / steps).tolist()))
    log = measure(truth, motion, noise, seed)
    known = truth.without_nominal()
    chosen = [selected(known, log, rule) for rule in RULES]
    fits = {
        cutoff: seaid.identify(known, log, cutoff_hz=cutoff) for cutoff in {*chosen, *CUTOFFS_HZ}
    }
    found = [fits[cutoff] for cutoff in (*chosen, *CUTOFFS_HZ)]
    drives = [
        [
            one.drives[joint].value(entry) - truth.drives[joint].values[entry]
            for joint in truth.elastic_joints
            for entry in one.drives[joint].names
            if entry in ("viscous_friction", "coulomb_friction", "stiffness")
        ]
        for one in found
    ]
    bodies = [one.load.values - one.base.project(truth.parameters) for one in found]
    return chosen, np.array(drives), np.array(bodies)


def of_logs(case: Case) -> Iterator[list[str]]:
    """Yield a row of the table of real logs for each log of a set."""
    robot = case.load_robot()
    for number, log in enumerate(case.read_logs(robot, DATA)):
        cells = []
        for rule in RULES:
            cutoff = selected(robot, log, rule)
            found = seaid.identify(robot, log, cutoff_hz=cutoff)
            off = [value_of(found, one["found"])[0] / one["published"] - 1 for one in case.value]
            cells.append(f"{cutoff:.2g} Hz: {np.sqrt(np.mean(np.square(off))):.0%}")
        yield [f"{case.name.split()[-1]} {number}", *cells]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=4, help="measurements of each motion")
    add_quick(parser)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main(parser.parse_args().draws)
