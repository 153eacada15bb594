"""Coverage of the stiffness of elastic joints where the gear ratio is inferred, or wrong.

The simulated TULip leg: (a) its gear ratios come from the log, as `seaid init` infers them, with
their standard errors; (b) given ratios are drawn around the true ones with a standard deviation of
0.3 %, which the drives state. Printed is how many 95 % intervals of the stiffness have the truth,
with and without the standard deviation of the ratio.

    python scripts/benchmarks/inferred_ratio.py --motions 12 --noises 3
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

import seaid
from scripts.identify_tulip_leg import MODELS, TEST_MASS, load_leg
from scripts.short_form import add_quick, sized
from seaid.drives.toml import drives_from_mapping
from seaid.project.first_project import filled, inferred_drives
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion

SENSORS = Noise(
    motor_resolution_rad=2 * np.pi / 2000,
    joint_resolution_rad=2 * np.pi / 2**14,
    motor_offset_rad=(1.0, -2.0, 0.5, 3.0, -1.5),
    torque_std_Nm=(0.005, 0.005, 0.005, 0.006, 0.006),
)
RATIO_STD = 0.003


def inferred(log: seaid.Log) -> Robot:
    """Return the leg with the drives that its log shows; spring forces count at the joint."""
    bare = seaid.load_robot(MODELS / "tulip_leg.urdf", payloads=[TEST_MASS])
    tables, _ = inferred_drives(bare, [log])
    return bare.with_drives(drives_from_mapping(filled(tables)))


def drawn(truth: Robot, random: np.random.Generator) -> Robot:
    """Return the leg with ratios around the true ones, and their standard deviation."""
    drives = {
        joint: replace(
            drive,
            gear_ratio=drive.ratio * (1 + RATIO_STD * random.normal()),
            std={"gear_ratio": RATIO_STD * drive.ratio},
        )
        for joint, drive in truth.drives.items()
        if drive.is_elastic
    }
    return truth.with_drives(drives)


def scores(robot: Robot, truth: Robot, log: seaid.Log) -> list[tuple[float, bool]]:
    """Return (error over standard error, whether the interval has the truth) of each stiffness."""
    found, rows = seaid.identify(robot, log), []
    for joint in truth.elastic_joints:
        drive, estimate = truth.drives[joint], found.drives[joint]
        lever = drive.load_radius / robot.drives[joint].load_radius
        true = drive.values["stiffness"] * lever**2
        place = estimate.names.index("stiffness")
        lower, upper = estimate.interval()[place]
        error = (estimate.values[place] - true) / estimate.standard_errors[place]
        rows.append((float(error), bool(lower <= true <= upper)))
    return rows


def main(motions: int, noises: int) -> None:
    """Print the table."""
    truth = load_leg((TEST_MASS,))
    random = np.random.default_rng(0)
    rows: dict[str, list[tuple[float, bool]]] = {}
    for seed in range(motions):
        motion = simulate_motion(truth, _trajectory(truth, seed))
        for number in range(noises):
            log = measure(truth, motion, SENSORS, 100 * seed + number)
            nominal = truth.without_nominal()
            for name, robot in (("inferred", inferred(log)), ("0.3 %", drawn(nominal, random))):
                exact = {j: replace(one, std={}) for j, one in robot.drives.items()}
                rows.setdefault(name, []).extend(scores(robot, truth, log))
                blind = scores(robot.with_drives(exact), truth, log)
                rows.setdefault(f"{name}, taken as exact", []).extend(blind)
    for name, scored in rows.items():
        rms = np.sqrt(np.mean([score**2 for score, _ in scored]))
        share = np.mean([is_covered for _, is_covered in scored])
        print(f"{name:28s} {share:6.1%} of {len(scored)}, rms score {rms:.2f}")


def _trajectory(robot: Robot, seed: int) -> seaid.Trajectory:
    from tests.experiments import wiggle

    return wiggle(
        robot, sized(6.0, 2.0), (0.0, 0.0, -0.2, 0.7, 0.0), (0.8, 0.6, 0.7, 0.7, 1.1), seed=seed
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--motions", type=int, default=12)
    parser.add_argument("--noises", type=int, default=3)
    add_quick(parser)
    given = parser.parse_args()
    main(given.motions, given.noises)
