"""Identify an SO-101 arm from six motions of position commands, and replay four others.

The logs have lists in cells and a clock each for commands and positions, and their torques are
absolute currents, which are not used. The gain of the servos is not known: one value is assumed for
all. The nominal model is the URDF without friction; it needs some armature, since without any it is
too fast for a simulation.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array

OWN = (
    *("chirp_sweep", "multisine", "friction_gravity", "large_amplitude", "prbs_excitation"),
    "inertia_coupling",
)
OTHERS = ("random_waypoints", "static_holding", "hold_under_gravity", "backlash_detection")
GAIN_NM_PER_RAD, STEP_S, LEAST_ARMATURE = 6.0, 0.02, 1e-3
OWN_S, OTHER_S = (5.0, 45.0), (5.0, 17.0)
"""Parts [s] of the motions."""


def columns(path: Path) -> tuple[Array, Array]:
    """Return the time [s] and the positions (T, 6) of a file."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    time = np.array([float(row["timestamp"]) for row in rows]) * 1e-6
    return time, np.array([json.loads(row["positions"]) for row in rows])


def log_of(
    folder: Path, motion: str, joints: tuple[str, ...], part: tuple[float, float]
) -> seaid.Log:
    """Return a part of a motion: positions interpolated, commands held."""
    measured, positions = columns(folder / f"{motion}.state_motor.csv")
    sent, commands = columns(folder / f"{motion}.control.csv")
    time = np.arange(max(measured[0], sent[0]), min(measured[-1], sent[-1]), STEP_S)
    held = np.clip(np.searchsorted(sent, time, side="right") - 1, 0, len(sent) - 1)
    unknown = np.full((len(time), len(joints)), np.nan)
    return seaid.Log(
        time=time,
        joint_names=joints,
        joint_position=np.column_stack([np.interp(time, measured, one) for one in positions.T]),
        motor_position=unknown,
        motor_torque=unknown,
        position_command=commands[held],
    ).between(*part)


def servo_arm() -> seaid.Robot:
    """Return the arm with known bodies, its servos as drives with position commands."""
    urdf = example_urdf("so101.urdf")
    drive = seaid.StiffDrive(
        friction=("viscous", "coulomb", "offset"),
        motor_input="position_command",
        controller=seaid.Controller(position_gain_Nm_per_rad=GAIN_NM_PER_RAD),
        command_delay_s=0.0,
        known=("command_delay",),
        std={"command_delay_s": 0.01},
    )
    bare = seaid.load_robot(urdf)
    drives = dict.fromkeys(bare.joint_names, drive)
    return seaid.load_robot(urdf, drives, known_bodies=bare.body_names)


def without_friction(found: seaid.Robot) -> seaid.Robot:
    """Return the arm without friction, with the armature found, or a least one."""
    drives = {}
    for joint, drive in found.drives.items():
        bare = replace(drive.without_nominal(), friction=())
        inertia = max(drive.motor_inertia_kg_m2 or 0.0, LEAST_ARMATURE)
        drives[joint] = replace(bare, motor_inertia_kg_m2=inertia)
    return found.with_drives(drives)


def main(folder: Path) -> None:
    """Print the errors of the replays of the four motions."""
    if not folder.is_dir():
        print(f"skipped: the logs are not here, no folder '{folder}'; name it: --logs")
        return
    robot = servo_arm()
    own = [log_of(folder, motion, robot.joint_names, OWN_S) for motion in OWN]
    found = seaid.identify(robot, own).robot
    for motion in OTHERS:
        log = log_of(folder, motion, robot.joint_names, OTHER_S)
        moved = seaid.compare_replays(without_friction(found), found, log)
        before, after = (1e3 * float(one.mean()) for one in moved.mean_absolute_errors)
        print(f"{motion:20} mean absolute error {before:5.2f} mrad before, {after:5.2f} after")


if __name__ == "__main__":
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--logs", type=Path, default=Path(__file__).parents[2] / "shared/data/so101_commands"
    )
    try:
        main(parser.parse_args().logs)
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")
