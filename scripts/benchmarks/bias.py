"""What noise of the encoders does to least squares, and what instrumental variables make of it.

The TULip leg with test mass and with a free foot, each simulated once and measured anew many times.
Bias is given in units of the mean stated standard error, +- its own uncertainty.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import seaid
from seaid.arrays import Array
from seaid.found import nominal_values
from seaid.log import Log
from seaid.motion import Motion
from seaid.progress import track
from seaid.report.text import table
from seaid.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import DURATION_S, LIMITS, TEST_MASS, load_leg, sensors

ESTIMATORS = ("ols", "iv")
"""Weighted least squares is the same as ordinary here: each spring has one motor equation."""

PARAMETERS = ("viscous_friction", "stiffness")
LOADS = {"test mass": (TEST_MASS,), "free foot": ()}
FINE = (2 * np.pi / 2000, 2 * np.pi / 2**14)
COARSE = (2 * np.pi / 500, 2 * np.pi / 2**12)
SETTINGS = (  # load, steps of motor and joint encoder [rad], every so many samples, pass band [Hz]
    ("test mass", FINE, 1, None),
    ("test mass", COARSE, 1, None),
    ("free foot", COARSE, 1, None),
    ("test mass", COARSE, 20, 8.0),
    ("free foot", COARSE, 20, 8.0),
)


def main(draws: int) -> None:
    """Print the table."""
    motions = true_motions()
    rows = []
    with ProcessPoolExecutor(2) as executor:
        for setting in SETTINGS:
            load, (motor, joint), every, cutoff_hz = setting
            one = partial(errors, motions[load], setting)
            futures = [executor.submit(one, seed) for seed in range(draws)]
            drawn = [future.result() for future in track(futures, "identifying", True)]
            found = [draw for draw in drawn if draw]
            print(f"{load}, every {every}: {draws - len(found)} of {draws} draws refused")
            rows += [
                [
                    f"{load}, motor {2 * np.pi / motor:.0f}, joint {2 * np.pi / joint:.0f}, "
                    f"{1000 / every:.0f} Hz, band {cutoff_hz or 'auto'}",
                    name,
                    *(in_errors(np.array([draw[name][e] for draw in found])) for e in ESTIMATORS),
                ]
                for name in found[0]
            ]
    header = ["setting", "parameter", *(f"{name}, bias / s.e." for name in ESTIMATORS)]
    print(table(f"TULip leg, {draws} draws of noise and zeros", header, rows))


def true_motions() -> dict[str, Motion]:
    """Return the true motion with each load."""
    known = load_leg((TEST_MASS,)).without_nominal()
    plan = seaid.design_excitation(known, DURATION_S, basis="polynomial", limits=LIMITS, seed=2)
    return {
        load: simulate_motion(load_leg(payloads), plan.trajectory, noise=sensors(0))
        for load, payloads in LOADS.items()
    }


def errors(
    motion: Motion,
    setting: tuple[str, tuple[float, float], int, float | None],
    seed: int,
) -> dict[str, dict[str, tuple[float, float]]]:
    """Return {parameter: {estimator: (error, standard error)}} of one draw, empty if refused."""
    load, (motor, joint), every, cutoff_hz = setting
    truth = load_leg(LOADS[load])
    noise = replace(sensors(seed), motor_resolution_rad=motor, joint_resolution_rad=joint)
    log = thinned(measure(truth, motion, noise, seed), every)
    known = truth.without_nominal()
    found: dict[str, dict[str, tuple[float, float]]] = {}
    for estimator in ESTIMATORS:
        try:
            told = seaid.identify(known, log, estimator=estimator, cutoff_hz=cutoff_hz)
        except seaid.IdentificationError:
            return {}
        for name in truth.elastic_joints:
            estimate, exact = told.drivetrains[name], nominal_values(truth.drivetrains[name])
            for parameter in PARAMETERS:
                if parameter in estimate.names:
                    error = estimate.value(parameter) - exact[parameter]
                    of_parameter = found.setdefault(f"{parameter} of {name}", {})
                    of_parameter[estimator] = error, estimate.standard_error(parameter)
    return found


def thinned(log: Log, every: int) -> Log:
    """Return the log of a slower logger: every so many samples."""
    return replace(
        log,
        time=log.time[::every],
        joint_position=log.joint_position[::every],
        motor_position=log.motor_position[::every],
        motor_torque=log.motor_torque[::every],
    )


def in_errors(found: Array) -> str:
    """Return the mean error in mean standard errors, from (draws, 2), with its uncertainty."""
    error, stated = found.T
    half = np.std(error, ddof=1) / np.sqrt(len(error))
    return f"{np.mean(error) / np.mean(stated):+.2f} +- {half / np.mean(stated):.2f}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=40, help="of noise and encoder zeros")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main(parser.parse_args().draws)
