"""Compare the selected cutoff with the best fixed one, for fine and coarse joint encoders.

The TULip leg with test mass and the mixed arm of the tests are simulated once, and measured many
times. The error of a cutoff is the geometric mean over parameters of their rms error over draws, so
that no parameter outweighs the others, whatever its unit or size.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._progress import track
from seaid.identification.drive_estimates import nominal_values
from seaid.log.motion import Motion, reconstruct_motion
from seaid.report.text import table
from seaid.robot.robot import Robot
from seaid.simulation.simulation import Noise, measure

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.experiments import ARM_SENSORS, LEG_SENSORS, TEST_MASS, arm, arm_motion, leg, leg_motion

CUTOFFS_HZ = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
STEPS_A_TURN = (2**10, 2**12, 2**14, 2**20)
ROBOTS: dict[str, tuple[Callable[[], Robot], Callable[[], Motion], Noise]] = {
    "leg": (partial(leg, TEST_MASS), partial(leg_motion, TEST_MASS), LEG_SENSORS),
    "arm": (arm, arm_motion, ARM_SENSORS),
}
_TELESCOPE_M = 0.05
"""Radius of the wheel on the rail that drives the encoder of a prismatic joint."""


def main(draws: int) -> None:
    """Print the table."""
    cases = list(product(ROBOTS, STEPS_A_TURN, range(draws)))
    with ProcessPoolExecutor(2) as executor:
        futures = [executor.submit(errors, *case) for case in cases]
        drawn = [future.result() for future in track(futures, "identifying", True)]
    rows = []
    for name, steps in product(ROBOTS, STEPS_A_TURN):
        found = [one for case, one in zip(cases, drawn, strict=True) if case[:2] == (name, steps)]
        proposed = f"{np.mean([cutoff for cutoff, _, _ in found]):.2g} Hz"
        for side in (1, 2):
            squares = np.array([one[side] for one in found]) ** 2  # (draws, cutoffs, parameters)
            size = np.exp(np.mean(np.log(np.mean(squares, axis=0)), axis=-1) / 2)
            ratio = size / np.min(size[1:])
            what = "drives" if side == 1 else "bodies"
            rows.append([f"{name}, {steps}", what, proposed, *(f"{one:.2f}" for one in ratio)])
    header = ["robot, joint encoder", "of", "selected", "its", *(f"{one:g}" for one in CUTOFFS_HZ)]
    print(table(f"Error over that of the best fixed cutoff, {draws} draws", header, rows))


def errors(name: str, steps: int, seed: int) -> tuple[float, Array, Array]:
    """Return the selected cutoff and the errors (1 + cutoffs, p) of drives and of bodies.

    The errors of the selected cutoff come first.
    """
    make, move, sensors = ROBOTS[name]
    truth, motion = make(), move()
    turn = np.where(truth.is_prismatic, 2 * np.pi * _TELESCOPE_M, 2 * np.pi)
    noise = replace(sensors, joint_resolution_rad=tuple((turn / steps).tolist()))
    log = measure(truth, motion, noise, seed)
    known = truth.without_nominal()
    proposed = reconstruct_motion(known, log).cutoff_hz
    found = [seaid.identify(known, log, cutoff_hz=cutoff) for cutoff in (proposed, *CUTOFFS_HZ)]
    drives = [
        [
            one.drives[joint].value(entry) - nominal_values(truth.drives[joint])[entry]
            for joint in truth.elastic_joints
            for entry in one.drives[joint].names
            if entry in ("viscous_friction", "coulomb_friction", "stiffness")
        ]
        for one in found
    ]
    bodies = [one.load.values - one.base.project(truth.parameters) for one in found]
    return proposed, np.array(drives), np.array(bodies)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=8, help="measurements of each motion")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main(parser.parse_args().draws)
