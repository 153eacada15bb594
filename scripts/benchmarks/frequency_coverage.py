"""How often 95 % intervals of a frequency response hold the truth, over draws of noise.

The linear two-mass plant of the tests, logged at two rates, and a drive of TULip's size with dry
friction of 10 % and 30 % of the torque. Motor torque and motor angle only.

    python scripts/benchmarks/frequency_coverage.py [--draws 100]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import seaid
from scripts.benchmarks.frequency import DRIVES, STEP_RAD
from scripts.short_form import add_quick, few
from seaid._arrays import Array
from tests.linear_plant import TwoMass, multisine_torque

MODES = ("resonance", "resonance_damping", "antiresonance", "antiresonance_damping")
NAMES = (*MODES, "stiffness", "spring_damping", "load_inertia", "viscous_friction")


def measured(log: seaid.Log, draw: int, every: int) -> seaid.Log:
    """Return every so many samples of a log with white noise of torque and angle."""
    rng = np.random.default_rng(draw)
    noise = rng.normal(size=(2, len(log.time), 1))[:, ::every]
    return seaid.Log(
        time=log.time[::every],
        joint_names=log.joint_names,
        motor_position=log.motor_position[::every] + 1e-3 * noise[0],
        joint_position=np.full((len(log.time[::every]), 1), np.nan),
        motor_torque=log.motor_torque[::every] + 0.005 * noise[1],
    )


def of_plant(draw: int, *, every: int, log: seaid.Log, robot: seaid.Robot) -> Array:
    """Return errors over standard errors (8,) of the linear plant."""
    return _scores(TwoMass(), robot, measured(log, draw, every), 4.0)


def of_drive(draw: int, *, share: float, folder: Path) -> Array:
    """Return those of the drive of TULip's size."""
    plant, size = DRIVES["TULip-like"]
    torque = multisine_torque(
        size, period_s=5.0, periods=2, top_hz=2 * plant.modes[0], seed=draw, left_out=4
    )
    log = plant.log(torque, coulomb=share * size, torque_std=0.02 * size, seed=draw)
    log = replace(log, motor_position=np.round(log.motor_position / STEP_RAD) * STEP_RAD)
    robot = plant.robot(folder)
    drive = replace(robot.drives["arm"], friction=("viscous", "coulomb"))
    return _scores(plant, robot.with_drives({"arm": drive}), log, 5.0)


def _scores(plant: TwoMass, robot: seaid.Robot, log: seaid.Log, period_s: float) -> Array:
    found = seaid.frequency_response(robot, log, period_s=period_s).drives["arm"]
    truth = [*plant.modes, plant.stiffness, plant.damping, plant.load, plant.friction]
    values, errors = ([of(one) for one in NAMES] for of in (found.value, found.standard_error))
    return np.asarray((np.array(values) - truth) / errors)


def main() -> None:
    """Print the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=100)
    add_quick(parser)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robot, log = TwoMass().robot(folder), TwoMass().log(multisine_torque(0.1))
        plant = partial(of_plant, log=log, robot=robot)
        cases: dict[str, Callable[[int], Array]] = {
            "linear, 1000 Hz": partial(plant, every=1),
            "linear, 500 Hz": partial(plant, every=2),
            "dry friction of 10 %": partial(of_drive, share=0.1, folder=folder),
            "dry friction of 30 %": partial(of_drive, share=0.3, folder=folder),
        }
        print(f"{'share inside of 95 % intervals':32s}", *(f"{one[:12]:>12s}" for one in NAMES))
        for case, run in few(cases.items(), 3):
            inside = np.mean(np.abs([run(draw) for draw in range(given.draws)]) < 1.96, axis=0)
            cells = (f"{100 * one:12.0f}" for one in inside)
            print(f"{case:32s}", *cells, f"mean {100 * np.mean(inside):.1f} %", flush=True)


if __name__ == "__main__":
    main()
