"""Refinement to maximum likelihood on the TULip leg: errors, coverage, and Cramer-Rao bound.

One motion is measured with many draws of noise and encoder offsets. The refinement is compared with
the linear regression from which it starts, and with the Cramer-Rao bound of the log, the smallest
variance of any unbiased estimate.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import seaid
from seaid._arrays import Array
from seaid.identification.motor_driven import MotorDriven, runs_of
from seaid.identification.output_error import MeasuredTorques
from seaid.identification.refined_parameters import layout_of
from seaid.log.filtering import decimation
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import (
    DURATION_S,
    ENCODER_OFFSET_STD_RAD,
    LIMITS,
    TEST_MASS,
    load_leg,
    sensors,
)
from scripts.short_form import plan, sized
from tests.estimation.cramer_rao import fisher_covariance

DRAWS = sized(40, 1)
WANTED = {
    "stiffness of hip_pitch": 0.005,
    "stiffness of knee_pitch": 0.005,
    "stiffness of ankle_pitch": 0.01,
    "coulomb_friction of hip_pitch": 0.02,
    "coulomb_friction of knee_pitch": 0.02,
    "coulomb_friction of ankle_pitch": 0.02,
    "viscous_friction of hip_pitch": 0.03,
    "viscous_friction of knee_pitch": 0.03,
}


@cache
def true_motion() -> tuple[seaid.Robot, seaid.Motion]:
    """Return the true leg with the test mass, and its motion."""
    truth = load_leg((TEST_MASS,))
    planned = plan(truth.without_nominal(), DURATION_S, basis="polynomial", limits=LIMITS, seed=2)
    return truth, simulate_motion(truth, planned.trajectory, noise=sensors(0))


def true_values(truth: seaid.Robot) -> dict[str, float]:
    """Return the true drive parameters by names such as 'stiffness of knee_pitch'."""
    return {
        f"{name} of {joint}": value
        for joint, drive in truth.drives.items()
        for name, value in drive.values.items()
        if name != "motor_inertia"
    }


def errors_of(found: seaid.Identification, truth: seaid.Robot) -> tuple[Array, Array]:
    """Return errors and standard errors of the drive parameters, then of the base parameters."""
    errors, stds = [], []
    for key, true in true_values(truth).items():
        name, joint = key.split(" of ")
        estimate = found.drives[joint]
        errors.append(estimate.value(name) / true - 1)
        stds.append(estimate.standard_error(name) / true)
    load = found.load.values - found.base.project(truth.parameters)
    return np.append(errors, load), np.append(stds, found.load.standard_errors)


def draw(run: int) -> tuple[Array, float]:
    """Return errors and standard errors (2 methods, 2, p) of a draw, and the time to refine."""
    truth, motion = true_motion()
    log = measure(truth, motion, sensors(run), run)
    found = seaid.identify(truth.without_nominal(), log, encoder_offset_std=ENCODER_OFFSET_STD_RAD)
    begin = time.perf_counter()
    refined = seaid.refine(found, log, encoder_offset_std=ENCODER_OFFSET_STD_RAD)
    seconds = time.perf_counter() - begin
    return np.array([errors_of(one, truth) for one in (found, refined)]), seconds


def bound() -> Array:
    """Return the Cramer-Rao bound of the drive parameters: smallest relative standard deviations.

    Motor angles count as exact. Rows near standstill and reversals, in which the direction of
    friction is unknown, are excluded as in the refinement.
    """
    truth, motion = true_motion()
    noise = sensors(0)
    perfect = measure(truth, motion, replace(noise, **dict.fromkeys(_ERRORS, 0.0)))
    found = seaid.identify(truth.without_nominal(), perfect)
    layout = layout_of(seaid.refine(found, perfect), ENCODER_OFFSET_STD_RAD)
    runs = runs_of(layout, perfect)
    torque = np.array(noise.torque_std_Nm)
    drives = [truth.index(joint) for joint in layout.simulated]
    others = [
        truth.index(joint)
        for joint in layout.identification.model.torque_joints
        if joint not in layout.simulated
    ]
    ratios = [truth.drives[truth.joint_names[index]].ratio for index in others]
    encoder = np.full(len(drives), noise.joint_resolution_rad / np.sqrt(12))
    simulated = np.append(encoder, torque[drives]) / np.sqrt(runs[0].block)
    # every second row of the filtered torques counts
    block = 2 * decimation(runs[0].motion.rate_hz, found.cutoff_hz)
    stds = np.append(simulated, ratios * torque[others] / np.sqrt(block))
    simulated = [MotorDriven(layout, layout.start, run) for run in runs]
    compared = *simulated, MeasuredTorques.of(layout, perfect, layout.start)
    residuals = [log.residuals for log in compared]
    covariance = fisher_covariance(residuals, layout.parameters, stds)
    names = [parameter.name for parameter in layout.parameters]
    least = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    return np.array([least[key] / value for key, value in true_values(truth).items()])


_ERRORS = (
    "motor_resolution_rad",
    "joint_resolution_rad",
    "motor_offset_rad",
    "joint_offset_rad",
    "torque_std_Nm",
)


def main() -> None:
    """Print rms errors, bias and coverage of both, and the bound."""
    truth, _ = true_motion()
    with ProcessPoolExecutor(2) as executor:
        done = list(executor.map(draw, range(DRAWS)))
    results = np.array([values for values, _ in done])  # (draws, methods, error and std, p)
    errors, scores = results[:, :, 0], results[:, :, 0] / results[:, :, 1]
    rms = np.sqrt(np.mean(errors**2, axis=0))
    bias, within = scores.mean(axis=0), np.mean(np.abs(scores) < 1.96, axis=0)
    least, rows = bound(), []
    for index, key in enumerate(true_values(truth)):
        wanted = WANTED.get(key)
        rows.append(
            [
                key,
                *(percent(value) for value in (*rms[:, index], least[index])),
                *(f"{value:+.2f}" for value in bias[:, index]),
                *(f"{value:.0%}" for value in within[:, index]),
                "-" if wanted is None else percent(wanted),
                "-" if wanted is None else f"{DURATION_S * (least[index] / wanted) ** 2:.2g} s",
            ]
        )
    header = [
        *("parameter", "rms WLS", "rms ML", "bound", "bias WLS [s.e.]", "bias ML [s.e.]"),
        *("95 % WLS", "95 % ML", "wanted rms", "bound there after"),
    ]
    print(table(f"TULip leg with test mass, {DRAWS} draws, {DURATION_S:.0f} s", header, rows))
    base = slice(len(rows), None)
    ratio = np.median(rms[1, base] / rms[0, base])
    print(f"Base parameters: rms error of ML over WLS, median {ratio:.2f};")
    print(f"95 % intervals cover {within[0, base].mean():.0%} (WLS), {within[1, base].mean():.0%}")
    largest = np.max(np.abs(bias[:, base]), axis=1)
    print(f"largest bias {largest[0]:.2f} (WLS), {largest[1]:.2f} (ML) standard errors")
    print(f"(of {DRAWS} unbiased draws a bias scatters by {1 / np.sqrt(DRAWS):.2f})")
    print(f"Refining takes {np.median([seconds for _, seconds in done]):.1f} s per log")


if __name__ == "__main__":
    main()
