"""The way of a newcomer: a URDF and logs in an empty folder, to a report in two commands.

A measured HEBI arm without a drives file and with its own column names, and a simulated TULip leg
without a drives file whose payload is named. Printed are the commands, their times as whole
processes (minimum of several), and what was inferred against the truth.

    python scripts/benchmarks/journey.py
"""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import seaid
from scripts.short_form import add_quick, few

ROOT = Path(__file__).resolve().parents[2]
MODELS, LOGS = ROOT / "models", ROOT / "models/logs/hebi_arms"
FIRMWARE = {"joint_0": 762.222, "joint_1": 272.222}
"""Gear ratios of the modules, from HEBI's documents."""


def hebi(folder: Path) -> str:
    """Copy the arm and a log, and return the command that begins the project."""
    shutil.copy(MODELS / "hebi_arm_2.urdf", folder / "arm.urdf")
    shutil.copy(LOGS / "grav_comp_bad.npz", folder / "run.npz")
    return "seaid init arm.urdf run.npz"


def leg(folder: Path) -> str:
    """Simulate two logs of the leg as CSV, and return the command that begins the project."""
    shutil.copy(MODELS / "tulip_leg.urdf", folder / "leg.urdf")
    payload = seaid.Payload("foot", 2.0, (0.15, 0.0, 0.0))
    robot = seaid.load_robot(
        MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml", payloads=[payload]
    )
    noise = seaid.Noise(
        motor_resolution_rad=2 * np.pi / 2000,
        joint_resolution_rad=2 * np.pi / 2**14,
        torque_std_Nm=0.005,
    )
    plans = ("tulip_plan.json", "tulip_validation_plan.json")
    for seed, (plan, name) in enumerate(zip(plans, ("run.csv", "other.csv"), strict=True)):
        trajectory = seaid.load_trajectory(MODELS / plan)
        log = seaid.simulate(robot, trajectory, noise=noise, seed=seed)
        seaid.write_log(log, folder / name)
    return "seaid init leg.urdf run.csv other.csv --payload foot:2.0:0.15,0,0"


def seconds(command: str, folder: Path) -> float:
    """Run a command in a folder, and return its time."""
    words = [sys.executable, "-m", *shlex.split(command)]
    begin = time.perf_counter()
    subprocess.run(words, cwd=folder, check=True, capture_output=True)
    return time.perf_counter() - begin


def ratios(file: Path) -> dict[str, float]:
    """Return {joint: gear ratio} of an inferred drives file."""
    tables = re.findall(r"^\[(\w+)\]\n.*\ngear_ratio = ([\d.]+)", file.read_text(), re.MULTILINE)
    return {joint: float(ratio) for joint, ratio in tables}


def main(repeats: int) -> None:
    """Print the table of both ways."""
    ways = (("HEBI arm, measured", hebi), ("TULip leg, simulated", leg))
    for name, prepare in few(ways):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            begin = prepare(folder)
            inputs = {one.name for one in folder.iterdir()}
            times = []
            for _ in range(repeats):
                for one in folder.iterdir():
                    if one.name not in inputs:
                        shutil.rmtree(one) if one.is_dir() else one.unlink()
                times.append([seconds(command, folder) for command in (begin, "seaid run")])
            first, second = np.min(times, axis=0)
            print(f"\n{name}\n  {begin}: {first:.2f} s\n  seaid run: {second:.2f} s")
            found = seaid.project.load_run(folder / "runs/latest").identification
            print(f"  verdict: {found.verdict.sentence}")
            (drives,) = folder.glob("*_drives.toml")
            for joint, ratio in ratios(drives).items():
                print(f"  {joint}: gear ratio {ratio:g}, {_true_ratio(joint):g} in truth")
            for joint, drive in found.drives.items():
                if "stiffness" in drive.names:
                    value, error = drive.value("stiffness"), drive.standard_error("stiffness")
                    print(f"  {joint}: stiffness {value:.4g} +- {error:.2g} N m/rad{_true(joint)}")


def _leg_drive(joint: str) -> seaid.SeriesElasticDrive | None:
    drive = seaid.load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml").drives[joint]
    return drive if isinstance(drive, seaid.SeriesElasticDrive) else None


def _true_ratio(joint: str) -> float:
    """Return the true ratio of motor to joint, with the pulleys of the leg."""
    if joint in FIRMWARE:
        return FIRMWARE[joint]
    robot = seaid.load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml")
    drive = robot.drives[joint]
    return float(drive.ratio * drive.load_radius / drive.motor_radius)


def _true(joint: str) -> str:
    """Return the true stiffness at the joint, K r_L^2, as text."""
    if joint in FIRMWARE:
        return ", 70 in the firmware"
    drive = _leg_drive(joint)
    assert drive is not None
    return f", {drive.values['stiffness'] * drive.load_radius**2:.4g} in truth"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    add_quick(parser)
    main(parser.parse_args().repeats)
