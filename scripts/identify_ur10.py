"""Identify a real UR10 from its published log: first half to second half, and all of it.

The log (BSD-3, Petrone, Ferrentino and Chiacchio 2025) is not part of this project: give its path
as the first argument. The robot file is the UR10 of example-robot-data.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from importlib.metadata import files
from pathlib import Path

import numpy as np

import seaid
from seaid.files import result_folder
from seaid.report.figures import save_load_figure
from seaid.report.text import percent, table

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
LOG = SHARED / "ur10_exciting" / "ur10_exciting_trajectory.csv"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def load_ur10() -> seaid.Robot:
    """Return the UR10, each joint with friction and rotor inertia at the joint, all unknown."""
    urdf = next(
        str(path.locate())
        for path in files("example-robot-data") or []
        if path.name == "ur10_robot.urdf"
    )
    drive = seaid.StiffDrive(gear_ratio=1.0, friction=("viscous", "coulomb", "offset"))
    return seaid.load_robot(urdf, drivetrains={f"{joint}_joint": drive for joint in JOINTS})


def read(path: Path, robot: seaid.Robot) -> seaid.Log:
    """Read the foreign log: joint positions, and torques as motor current times its gain."""
    columns = {"time_s": "t_stamp"}
    for joint in robot.joint_names:
        columns[f"{joint}.joint_position_rad"] = f"pos_{joint}"
        columns[f"{joint}.joint_torque_Nm"] = f"eff_{joint}"
    return seaid.read_log(path, robot, columns=columns)


def main(path: Path, output: Path) -> None:
    """Identify from one half, predict the other; then all data in sample."""
    result_folder(output)
    robot = load_ur10()
    log = read(path, robot)
    middle = float(np.mean(log.time[[0, -1]]))
    found = seaid.identify(robot, log.between(-np.inf, middle), progress=True)
    unseen = seaid.validate(found, log.between(middle, np.inf))
    everything = seaid.identify(robot, log, progress=True)
    in_sample = seaid.validate(everything, log)

    print(everything.summary())
    rows = [
        [
            joint,
            percent(unseen.load.relative_error[index]),
            percent(unseen.load.raw_relative_error[index]),
            percent(in_sample.load.relative_error[index]),
            percent(in_sample.load.raw_relative_error[index]),
        ]
        for index, joint in enumerate(unseen.joints)
    ]
    header = ["joint", "unseen half", "raw", "all data, in sample", "raw"]
    print(table(f"Relative error below {found.cutoff_hz:.3g} Hz, and raw", header, rows))
    everything.save(output / "parameters.json", in_sample)
    save_load_figure(unseen, output / "load_side.png")
    print(f"{len(found.load.values)} base parameters. Results: {output}/")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", type=Path, nargs="?", default=LOG, help="ur10_exciting csv")
    parser.add_argument("--output", type=Path, default=Path("out/ur10"), help="result folder")
    arguments = parser.parse_args()
    warnings.formatwarning = lambda message, *_: f"note: {message}\n"
    if not arguments.log.exists():
        sys.exit(f"skipped: no measured log at {arguments.log}; give its path as an argument")
    try:
        main(arguments.log, arguments.output)
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")
