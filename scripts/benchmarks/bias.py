"""Bias of least squares and of instrumental variables due to encoder noise.

The TULip leg with test mass and with a free foot is simulated once each, and measured many times.
The bias is in units of the mean stated standard error, +- its own uncertainty. Each draw of
encoder errors is identified twice, with the torque noise and with its negative. Errors linear in
the torque noise cancel, so a bias is known several times better than from single draws. The offsets
of the joint encoders are known here, since a wrong offset is not noise.
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
from seaid._arrays import Array
from seaid._progress import track
from seaid.estimation.fitting import EstimatorName
from seaid.log import Log, Motion
from seaid.report import table
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import DURATION_S, LIMITS, TEST_MASS, load_leg, sensors
from scripts.short_form import add_quick, few, plan, sized

ESTIMATORS: tuple[EstimatorName, ...] = sized(("ols", "iv"), ("iv",))
"""Weighted equals ordinary least squares here, since each spring has one motor equation."""

PARAMETERS = ("viscous_friction", "stiffness")
LOADS = {"test mass": (TEST_MASS,), "free foot": ()}
FINE = (2 * np.pi / 2000, 2 * np.pi / 2**14)
COARSE = (2 * np.pi / 500, 2 * np.pi / 2**12)
COARSER = (2 * np.pi / 2000, 2 * np.pi / 2**11)
COARSEST = (2 * np.pi / 2000, 2 * np.pi / 2**10)
BODIES = "worst base parameter"
SETTINGS = (  # load, resolution of motor and joint encoder [rad], decimation, cutoff [Hz]
    ("test mass", FINE, 1, None),
    ("test mass", COARSE, 1, None),
    ("free foot", COARSE, 1, None),
    ("test mass", COARSE, 20, 8.0),
    ("free foot", COARSE, 20, 8.0),
    ("test mass", COARSER, 1, 12.0),
    ("free foot", COARSEST, 1, 12.0),
)


def main(pairs: int) -> None:
    """Print the table."""
    motions = true_motions()
    rows = []
    with ProcessPoolExecutor(2) as executor:
        for setting in sized(SETTINGS, SETTINGS[3:4]):
            load, (motor, joint), every, cutoff_hz = setting
            one = partial(errors, motions[load], setting)
            futures = [executor.submit(one, seed) for seed in range(pairs)]
            drawn = [future.result() for future in track(futures, "identifying", True)]
            found = [draw for draw in drawn if draw]
            print(f"{load}, every {every}: {pairs - len(found)} of {pairs} pairs refused")
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
    print(table(f"TULip leg, {pairs} pairs of draws", header, rows))


def true_motions() -> dict[str, Motion]:
    """Return the true motion with each load."""
    known = load_leg((TEST_MASS,)).without_nominal()
    planned = plan(known, DURATION_S, basis="polynomial", limits=LIMITS, seed=2)
    return {
        load: simulate_motion(load_leg(payloads), planned.trajectory, noise=sensors(0))
        for load, payloads in few(LOADS.items())
    }


def errors(
    motion: Motion,
    setting: tuple[str, tuple[float, float], int, float | None],
    seed: int,
) -> dict[str, dict[str, Array]]:
    """Return {parameter: {estimator: (errors, standard errors)}} of a pair, empty if refused.

    Means over the pair, (2, 1) each; (2, p) for the base parameters.
    """
    load, (motor, joint), every, cutoff_hz = setting
    truth = load_leg(LOADS[load])
    zeros = joint * np.random.default_rng(seed).uniform(-0.5, 0.5, truth.n)
    noise = replace(
        sensors(seed),
        motor_resolution_rad=motor,
        joint_resolution_rad=joint,
        joint_offset_rad=tuple(zeros),
    )
    log = measure(truth, motion, noise, seed)
    log = replace(log, joint_position=log.joint_position - zeros)
    opposite = replace(log, motor_torque=2 * motion.motor_torque - log.motor_torque)
    known = truth.without_nominal()
    found: dict[str, dict[str, Array]] = {}
    for estimator in ESTIMATORS:
        try:
            pair = [
                seaid.identify(known, thinned(one, every), estimator=estimator, cutoff_hz=cutoff_hz)
                for one in (log, opposite)
            ]
        except seaid.errors.IdentificationError:
            return {}
        results = [errors_of(one, truth) for one in pair]
        for name in results[0]:
            mean = np.mean([one[name] for one in results], axis=0)
            found.setdefault(name, {})[estimator] = mean
    return found


def errors_of(found: seaid.Identification, truth: seaid.Robot) -> dict[str, Array]:
    """Return {parameter: errors and standard errors}, (2, 1), and of all base parameters (2, p)."""
    result: dict[str, Array] = {}
    for joint in truth.elastic_joints:
        estimate, exact = found.drives[joint], truth.drives[joint].values
        for name in PARAMETERS:
            error = estimate.value(name) - exact[name]
            result[f"{name} of {joint}"] = np.array([[error], [estimate.standard_error(name)]])
    errors_of_bodies = found.load.values - found.base.project(truth.parameters)
    return result | {BODIES: np.array([errors_of_bodies, found.load.standard_errors])}


def thinned(log: Log, every: int) -> Log:
    """Return the log with every `every`-th sample only, as of a slower logger."""
    return replace(
        log,
        time=log.time[::every],
        joint_position=log.joint_position[::every],
        motor_position=log.motor_position[::every],
        motor_torque=log.motor_torque[::every],
    )


def in_errors(found: Array) -> str:
    """Return the largest mean error in mean standard errors with its +-, from (draws, 2, p)."""
    stated = np.mean(found[:, 1], axis=0)
    bias = np.mean(found[:, 0], axis=0) / stated
    half = np.std(found[:, 0], axis=0, ddof=min(1, len(found) - 1)) / np.sqrt(len(found)) / stated
    worst = int(np.argmax(np.abs(bias)))
    return f"{bias[worst]:+.2f} +- {half[worst]:.2f}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=20, help="draws with noise of both signs")
    add_quick(parser)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main(parser.parse_args().pairs)
