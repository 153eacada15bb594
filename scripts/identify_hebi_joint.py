"""Find the spring stiffness of a real series elastic joint: a HEBI arm, joint 0.

From motor angle, link angle and torque, (4b): the deflection channel is not used. The log (MIT,
github.com/zCoCo/16384) is not part of this project: give its path as the first argument.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import seaid
from seaid.files import result_folder
from seaid.report.figures import save_load_figure
from seaid.report.text import drive_table

MODELS = Path(__file__).resolve().parents[1] / "models"
LOG = Path(__file__).resolve().parents[2] / "shared" / "data" / "hebi_arms" / "virtual_spring.csv"
JOINTS = ("joint_0", "joint_1")


def read(path: Path, robot: seaid.Robot) -> seaid.Log:
    """Read the foreign log on the clock of joint 0; `eff` is the torque of the spring."""
    columns = {"time_s": "t_tx_0"}
    for index, joint in enumerate(JOINTS):
        columns[f"{joint}.motor_position_rad"] = f"mpos_{index}"
        columns[f"{joint}.joint_position_rad"] = f"pos_{index}"
        columns[f"{joint}.joint_torque_Nm"] = f"eff_{index}"
    return seaid.read_log(path, robot, columns=columns)


def main(path: Path, output: Path) -> None:
    """Identify both springs and the arm's base parameters."""
    result_folder(output)
    robot = seaid.load_robot(
        MODELS / "hebi_arm_2.urdf", drivetrains=MODELS / "hebi_arm_2.toml", gravity=(0, 0, -9.81)
    )
    log = read(path, robot)
    found = seaid.identify(robot, log, progress=True)
    print(drive_table("Springs of the HEBI arm (nominal 70 N m/rad, both)", found))
    for flag in found.flags:
        print(f"! {flag}")
    result = seaid.validate(found, log)
    found.save(output / "parameters.json", result)
    save_load_figure(result, output / "load_side.png")
    print(f"Results: {output}/")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", type=Path, nargs="?", default=LOG, help="a 2-joint hebi_arms csv")
    parser.add_argument("--output", type=Path, default=Path("out/hebi"), help="result folder")
    arguments = parser.parse_args()
    warnings.formatwarning = lambda message, *_: f"note: {message}\n"
    if not arguments.log.exists():
        sys.exit(f"skipped: no measured log at {arguments.log}; give its path as an argument")
    try:
        main(arguments.log, arguments.output)
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")
