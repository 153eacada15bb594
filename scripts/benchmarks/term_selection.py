"""Rates of wrongly and rightly selected terms.

The TULip leg with its test mass is measured with new noise and encoder offsets in every draw: once
as it is, and once per term with that term added at the knee, with the strength in the table.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._progress import track
from seaid.identification.model_selection import TermSelection
from seaid.log.motion import Motion
from seaid.log.reading import Log
from seaid.report.text import percent, table
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import TEST_MASS, load_leg, sensors
from tests.experiments import leg_trajectory

JOINT = "knee_pitch"
CHANGES = {
    "stribeck": "0.02 N m exp(-(w / 60 rad/s)^2) sign(w)",
    "load": "10 % of the spring's torque",
    "quadratic": "2e-8 N m s^2/rad^2 w |w|",
    "asymmetric": "1.5e-5 N m s/rad |w|",
}


def changed(log: Log, motion: Motion, robot: seaid.Robot, term: str) -> Log:
    """Return the log of a knee with one more term: the same motion needs another torque."""
    index, drive = robot.index(JOINT), robot.drives[JOINT]
    w = motion.motor_velocity[:, index]
    spring = motion.joint_torque[:, index] / drive.load_radius
    gear = spring * drive.motor_radius / drive.ratio
    more: Mapping[str, Array] = {
        "stribeck": 0.02 * np.exp(-((w / 60.0) ** 2)) * np.sign(w),
        "load": 0.1 * np.abs(gear) * np.sign(w),
        "quadratic": 2e-8 * w * np.abs(w),
        "asymmetric": 1.5e-5 * np.abs(w),
    }
    torque = log.motor_torque.copy()
    torque[:, index] += more[term]
    return replace(log, motor_torque=torque)


def asked(selection: TermSelection) -> tuple[int, int, int, int]:
    """Return the numbers of terms tested and selected, and of drives tested and changed."""
    first = [one for one in selection.comparisons if one.step == 0 and one.comparison is not None]
    joints = {one.joint for one in first}
    found = sum(map(len, selection.recommended.values()))
    return len(first), found, len(joints), len(selection.recommended)


def main(draws: int) -> None:
    """Print the rate of wrong selections, and the detection rate of each term."""
    truth = load_leg((TEST_MASS,))
    known = truth.without_nominal()
    motion = simulate_motion(truth, leg_trajectory(), progress=True)
    logs = [measure(truth, motion, sensors(seed), seed) for seed in range(draws)]
    plain = [seaid.compare_terms(known, log) for log in track(logs, "as it is", True)]
    counts = np.sum([asked(one) for one in plain], axis=0)
    rows = [
        [
            "terms selected that are not present",
            f"{counts[1]} of {counts[0]}",
            percent(counts[1] / counts[0]),
        ],
        [
            "drives with a wrongly selected term",
            f"{counts[3]} of {counts[2]}",
            percent(counts[3] / counts[2]),
        ],
    ]
    terms = {"friction": tuple(CHANGES)}
    for term, strength in CHANGES.items():
        found = [
            seaid.compare_terms(
                known, changed(log, motion, truth, term), joints=[JOINT], terms=terms
            )
            for log in track(logs, term, True)
        ]
        hits = sum(("friction", term) in dict(one.recommended).get(JOINT, ()) for one in found)
        rows.append([f"{term} found: {strength}", f"{hits} of {draws}", percent(hits / draws)])
    print(table(f"Selection of terms, {draws} draws", ["", "count", "rate"], rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=12)
    main(parser.parse_args().draws)
