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
from typing import Any

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._progress import track
from seaid.identification import TermSelection
from seaid.log import Log, Motion
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import TEST_MASS, load_leg, sensors
from scripts.short_form import add_quick, few, is_quick, leg_plan
from tests.experiments import (
    ARM_SENSORS,
    LEG_SENSORS,
    arm,
    arm_motion,
    leg,
    leg_motion,
    leg_trajectory,
)

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
    trajectory = leg_plan() if is_quick() else leg_trajectory()
    motion = simulate_motion(truth, trajectory, progress=True)
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
    for term, strength in few(CHANGES.items()):
        found = [
            seaid.compare_terms(
                known, changed(log, motion, truth, term), joints=[JOINT], terms=terms
            )
            for log in track(logs, term, True)
        ]
        hits = sum(("friction", term) in dict(one.recommended).get(JOINT, ()) for one in found)
        rows.append([f"{term} found: {strength}", f"{hits} of {draws}", percent(hits / draws)])
    print(table(f"Selection of terms, {draws} draws", ["", "count", "rate"], rows))


def findings(draws: int) -> None:
    """Print how often `identify` names a missing term of right models, and of wrong springs."""
    robots = {
        "leg": (leg(TEST_MASS), leg_motion(TEST_MASS), LEG_SENSORS),
        "leg, coarse encoders": (leg(TEST_MASS), leg_motion(TEST_MASS), COARSE),
    }
    if not is_quick():
        robots["mixed arm"] = (arm(), arm_motion(), ARM_SENSORS)
    for share in few((0.05, 0.1, 0.2)):
        hard = hardening(leg(TEST_MASS), share)
        trajectory = leg_plan() if is_quick() else leg_trajectory()
        motion = simulate_motion(hard, trajectory, progress=True)
        robots[f"leg, cubic part of {share:.0%}"] = (hard, motion, LEG_SENSORS)
    rows = []
    for name, (truth, motion, noise) in reversed(few(reversed(robots.items()))):
        known = (leg(TEST_MASS) if "cubic" in name else truth).without_nominal()
        logs = [measure(truth, motion, noise, seed) for seed in range(draws)]
        found = [seaid.identify(known, log).warnings for log in track(logs, name, True)]
        named = [[one for one in some if one.code in CODES] for some in found]
        springs = [sum(one.code == "nonlinear-spring" for one in some) for some in named]
        doubtful = sum(any(one.severity == "doubtful" for one in some) for some in named)
        counts = f"{sum(map(bool, named))} of {draws}", f"{doubtful} of {draws}"
        rows.append([name, *counts, f"{np.mean(springs):.2g}"])
    header = ["set-up", "with a finding", "doubtful", "springs named, of three"]
    print(table(f"Missing terms named by identify, {draws} draws", header, rows))


CODES = ("missing-term", "nonlinear-spring")
COARSE = seaid.Noise(
    motor_resolution_rad=2 * np.pi / 500,
    joint_resolution_rad=2 * np.pi / 2**12,
    torque_std_Nm=0.006,
)


def hardening(robot: seaid.Robot, share: float) -> seaid.Robot:
    """Return the leg with cubic springs, which give a share of the force at the largest stretch."""
    drives = {}
    motion = leg_motion(TEST_MASS)
    for joint in robot.elastic_joints:
        index, drive = robot.index(joint), robot.drives[joint]
        lever = drive.motor_radius / drive.ratio
        stretch = lever * motion.motor_position[:, index]
        stretch = stretch - drive.load_radius * motion.joint_position[:, index]
        cubic = share * drive.values["stiffness"] / float(np.max(stretch**2))
        values = {"cubic_stiffness": cubic, "deflection_zero": 0.0}
        elastic: Any = drive
        drives[joint] = replace(elastic, spring=("linear", "cubic")).with_values(values)
    return robot.with_drives(drives)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--findings", action="store_true", help="those of identify instead")
    add_quick(parser)
    given = parser.parse_args()
    (findings if given.findings else main)(given.draws)
