"""Coverage of 95 % intervals from short logs, and how many of these logs have a warning.

Three robots move along random motions of 1, 2, 5 and 20 s, a new one in each experiment: the TULip
leg with its test mass, an arm with a rail and a telescope, and the UR10 with rotors that are not
known. A log of a few seconds determines little: what is left are wide intervals, some of which do
not hold, since few independent rows show how large their errors are.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

import seaid
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.short_form import add_quick, sized
from tests.experiments import (
    ARM_SENSORS,
    LEG_SENSORS,
    TEST_MASS,
    arm,
    leg,
    true_geared_arm,
    wiggle,
)

DURATIONS_S, EXPERIMENTS = sized((1.0, 2.0, 5.0, 20.0), (1.0,)), sized(100, 2)

LEG = (0.0, 0.0, -0.2, 0.7, 0.0), (0.8, 0.6, 0.7, 0.7, 1.1)
ARM = (0.0, 0.3, 0.15, 0.0), (0.4, 0.8, 0.2, 0.9)
UR10 = (0.0, -1.2, 1.0, 0.0, 0.5, 0.0), (0.8,) * 6


def short_log(
    name: str, duration_s: float, seed: int
) -> tuple[seaid.Robot, seaid.Robot, seaid.Log]:
    """Return the true robot, the one that is identified, and a log of a random motion."""
    truth, (middle, reach), noise = {
        "leg": (leg(TEST_MASS), LEG, LEG_SENSORS),
        "arm": (arm(), ARM, ARM_SENSORS),
        "ur10": (true_geared_arm(), UR10, Noise(torque_std_Nm=0.05)),
    }[name]
    motion = simulate_motion(truth, wiggle(truth, duration_s, middle, reach, seed=1000 + seed))
    log = measure(truth, motion, noise, seed)
    if name != "ur10":
        return truth, truth.without_nominal(), log
    drives = dict.fromkeys(truth.joint_names, seaid.StiffDrive(gear_ratio=1.0))
    unknown = np.full_like(log.motor_position, np.nan)
    log = replace(log, joint_position=log.motor_position, motor_position=unknown)
    return truth, seaid.load_robot("ur10", drives, snap_tolerance_rad=0), log


def held(truth: seaid.Robot, found: seaid.Identification) -> list[bool]:
    """Return whether each interval of drives and base parameters holds the true value.

    Base parameters that absorb rotors of unknown inertia are not those of the bodies alone.
    """
    pairs = [
        (interval, truth.drives[joint].values[name])
        for joint, estimate in found.drives.items()
        for name, interval in zip(estimate.names, estimate.interval(), strict=True)
        if name in truth.drives[joint].values
    ]
    if all(drive.motor_inertia_kg_m2 is not None for drive in found.known.drives.values()):
        base = found.base.project(truth.parameters)
        pairs += zip(found.load.interval(), base.tolist(), strict=False)
    return [bool(low <= value <= high) for (low, high), value in pairs]


def main(experiments: int) -> None:
    """Print a line per robot and duration."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    rows = []
    for name in ("leg", "arm", "ur10"):
        for duration_s in DURATIONS_S:
            levels, codes, holds = Counter[str](), Counter[str](), dict[str, list[bool]]()
            for seed in range(experiments):
                truth, robot, log = short_log(name, duration_s, seed)
                try:
                    found = seaid.identify(robot, log)
                except seaid.SeaidError:
                    levels["refused"] += 1
                    continue
                level = found.verdict.level
                levels[level] += 1
                codes["few-rows"] += "few-rows" in {one.code for one in found.warnings}
                holds.setdefault("good" if level == "good" else "other", []).extend(
                    held(truth, found)
                )
            every = [one for some in holds.values() for one in some]
            shares = (
                percent(float(np.mean(some))) if some else "-"
                for some in (every, holds.get("good", []))
            )
            counts = (levels["good"], codes["few-rows"], levels["refused"])
            rows.append([name, f"{duration_s:g}", *shares, *map(str, counts)])
    header = (
        "robot",
        "log [s]",
        "intervals that hold",
        "of good logs",
        "good",
        "few-rows",
        "refused",
    )
    print(table(f"{experiments} logs per line", header, rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--experiments", type=int, default=EXPERIMENTS, help="per line")
    add_quick(parser)
    main(parser.parse_args().experiments)
