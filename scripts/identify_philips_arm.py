"""Identify the Philips arm, the paper's other system, in simulation: with stiff or elastic drives.

Its seven joints follow their Denavit-Hartenberg table, and its first axis is horizontal. With
`--elastic` there is a rotary spring behind each gear.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np

import seaid
from seaid._files import result_folder
from seaid.report.text import drive_table, load_table, validation_table

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.short_form import add_quick, plan
from scripts.torque_figures import save_actuator_figure, save_load_figure

MODELS = Path(__file__).resolve().parents[1] / "models"
LIMITS = seaid.Limits(acceleration=4.0)
DURATION_S = 20.0
STIFF, ELASTIC = "philips_arm.toml", "philips_arm_elastic.toml"


def sensors(robot: seaid.Robot) -> seaid.Noise:
    """Return sensors with 2000 counts per motor turn, gears of 100 and torque noise of 0.5 %.

    The stiff drive file has its motors at the joints, so both are converted by the gear.
    """
    gears = [robot.drives[joint].ratio for joint in robot.joint_names]
    return seaid.Noise(
        motor_resolution_rad=tuple(2 * np.pi / 2000 * gear / 100 for gear in gears),
        joint_resolution_rad=2 * np.pi / 2**16,
        torque_std_Nm=tuple((0.005 * robot.effort_limits / gears).tolist()),
    )


def load_arm(drives: str, gravity: tuple[float, float, float]) -> seaid.Robot:
    """Return the true arm with the drives of a file of `models/`."""
    return seaid.load_robot(MODELS / "philips_arm.urdf", drives=MODELS / drives, gravity=gravity)


def main(output: Path, drives: str, seed: int) -> None:
    """Plan, simulate, identify, validate, write."""
    result_folder(output)
    truth = load_arm(drives, (-9.81, 0.0, 0.0))
    upright = seaid.base_parameters(load_arm(drives, (0.0, 0.0, -9.81)))
    known = truth.without_nominal()
    plans = [
        plan(known, DURATION_S, limits=LIMITS, seed=one, progress=True) for one in (seed, seed + 1)
    ]
    log, other_log = (
        seaid.simulate(truth, one.trajectory, noise=sensors(truth), seed=seed + run, progress=True)
        for run, one in enumerate(plans)
    )
    found = seaid.identify(known, log, method="two-step", progress=True)  # the paper's
    result = seaid.validate(found, other_log)

    print(drive_table("Drives of the Philips arm", found, truth))
    print(load_table("Base parameters", found, truth))
    print(validation_table(result))
    for flag in found.warnings:
        print(f"! {flag}")
    print(
        f"{len(found.load.values)} base parameters with axis 1 horizontal, "
        f"{len(upright.columns)} with axis 1 vertical; condition number of the excitation "
        f"{plans[0].condition_number:.0f}"
    )
    seaid.write_parameters(found, output / "parameters.json", result)
    save_load_figure(result, output / "load_side.png")
    if truth.elastic_joints:
        save_actuator_figure(result, output / "actuator_side.png")
    print(f"Results: {output}/")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--elastic", action="store_true", help="a spring in every joint")
    parser.add_argument("--output", type=Path, default=Path("out/philips_arm"), help="folder")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    add_quick(parser)
    arguments = parser.parse_args()
    warnings.formatwarning = lambda message, *_: f"note: {message}\n"
    try:
        main(arguments.output, ELASTIC if arguments.elastic else STIFF, arguments.seed)
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")
