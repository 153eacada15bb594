"""Identifiability with given sensors: `identifiability.py robot.urdf [drives.toml]`.

Without --sensors the script prints a table of common choices. With --sensors it prints the details
of one choice, as in
`--sensors motor_position joint_position motor_torque --of hip_yaw joint_position`.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import seaid
from seaid.regressor.structural_identifiability import Sensor
from seaid.report import table

BOTH: tuple[Sensor, Sensor] = ("motor_position", "joint_position")
HEADER = (
    "sensors",
    "base",
    "individually",
    "in combination",
    "up to scale",
    "unidentifiable",
    "numbers",
)
Choice = Sequence[Sensor] | Mapping[str, Sequence[Sensor]] | None


def choices(robot: seaid.Robot) -> Iterator[tuple[str, Choice]]:
    """Return common choices of sensors by name."""
    yield "both positions, motor torque", (*BOTH, "motor_torque")
    if 0 < len(robot.elastic_joints) < robot.n:
        every: dict[str, Sequence[Sensor]] = dict.fromkeys(robot.joint_names, BOTH)
        some: dict[str, Sequence[Sensor]]
        some = dict.fromkeys(robot.elastic_joints, (*BOTH, "motor_torque"))
        yield "the same, no torque at stiff joints", {**every, **some}
    yield "both positions, motor current", (*BOTH, "motor_current")
    yield "both positions, motor voltage", (*BOTH, "motor_voltage")
    yield "both positions, joint torque", (*BOTH, "joint_torque")
    yield "both positions", BOTH
    yield "joint position, joint torque", ("joint_position", "joint_torque")
    yield "motor position, motor torque", ("motor_position", "motor_torque")
    yield "deflection, joint torque", ("deflection", "joint_torque")


def row(name: str, found: seaid.regressor.Identifiability) -> list[str]:
    """Return the counts of one choice."""
    groups = " + ".join(str(len(group)) for group in found.ratios) or "-"
    counts = map(len, (found.identifiable, found.combinations))
    return [
        name,
        str(found.body_count),
        *map(str, counts),
        groups,
        str(len(found.unidentifiable)),
        str(found.rank),
    ]


def main(arguments: argparse.Namespace) -> None:
    """Print the table of all choices, or the details of one."""
    robot = seaid.load_robot(arguments.urdf, arguments.toml, joints=arguments.joints)
    if arguments.sensors is None and not arguments.of:
        found = [(name, seaid.identifiability(robot, sensors)) for name, sensors in choices(robot)]
        for name, one in found:
            if not one.agree:
                print(f"two random draws do not agree: {name}")
        rows = [row(name, one) for name, one in found]
        print(table(f"{robot.name}: {len(found[0][1].names)} parameters", HEADER, rows))
        return
    sensors = dict.fromkeys(robot.joint_names, arguments.sensors or ())
    sensors |= {joint: names for joint, *names in arguments.of}
    print(seaid.identifiability(robot, sensors))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("urdf", type=Path)
    parser.add_argument("toml", type=Path, nargs="?")
    parser.add_argument("--joints", nargs="+", help="moving joints (default: all)")
    parser.add_argument("--sensors", nargs="*", help="of every joint")
    parser.add_argument("--of", nargs="+", action="append", default=[], help="joint, its sensors")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    try:
        main(arguments)
    except seaid.SeaidError as problem:
        sys.exit(f"error: {problem}")
