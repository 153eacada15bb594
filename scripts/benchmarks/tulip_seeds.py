"""Scatter of the TULip figures: the shipped motion, many draws of torque noise and offsets."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import seaid
from seaid._progress import track
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import (
    ENCODER_OFFSET_STD_RAD,
    TEST_MASS,
    load_leg,
    sensors,
)
from scripts.short_form import leg_plan, sized

RUNS = sized(24, 1)
ALLOWED = {
    ("hip_pitch", "stiffness"): 0.01,
    ("knee_pitch", "stiffness"): 0.01,
    ("ankle_pitch", "stiffness"): 0.02,
    ("hip_pitch", "coulomb_friction"): 0.05,
    ("knee_pitch", "coulomb_friction"): 0.05,
    ("ankle_pitch", "coulomb_friction"): 0.05,
    ("hip_pitch", "viscous_friction"): 0.05,
    ("knee_pitch", "viscous_friction"): 0.10,
}


def main() -> None:
    """Print errors over the draws, also in standard errors."""
    truth = load_leg((TEST_MASS,))
    known = truth.without_nominal()
    motion = simulate_motion(truth, leg_plan(), noise=sensors(0), progress=True)
    errors, scores, load_scores = [], [], []
    for run in track(range(RUNS), "identifying", True):
        log = measure(truth, motion, sensors(run), run)
        found = seaid.identify(known, log, encoder_offset_std=ENCODER_OFFSET_STD_RAD)
        true = found.base.project(truth.parameters)
        load_scores.append((found.load.values - true) / found.load.standard_errors)
        off = {}
        for joint in truth.elastic_joints:
            for name, exact in truth.drives[joint].values.items():
                estimate = found.drives[joint]
                if name in estimate.names:
                    error = estimate.value(name) - exact
                    off[joint, name] = error / exact, error / estimate.standard_error(name)
        errors.append([value for value, _ in off.values()])
        scores.append([score for _, score in off.values()])
    rows = []
    for index, key in enumerate(off):
        column = np.abs(np.array(errors)[:, index])
        allowed = ALLOWED.get(key)
        met = "-" if allowed is None else f"{np.mean(column < allowed):.0%} below {allowed:.0%}"
        spread = f"{np.sqrt(np.mean(np.array(scores)[:, index] ** 2)):.1f}"
        rms = np.sqrt(np.mean(column**2))
        rows.append([*key, percent(rms), percent(column.max()), met, spread])
    header = ["joint", "parameter", "rms error", "largest", "figure met", "rms in s.e."]
    print(table(f"TULip leg with test mass, {RUNS} draws of noise and offsets", header, rows))
    within = np.abs(load_scores) < 1.96
    print(f"95 % intervals contain {np.mean(within):.0%} of the true base parameters")


if __name__ == "__main__":
    main()
