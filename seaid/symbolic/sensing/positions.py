"""Which positions the encoders of a robot tell, directly or through others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flint import fmpq, fmpq_mat

from seaid.drivetrain.model import StiffDrive
from seaid.robot import Robot
from seaid.symbolic.geometry import exact_number


@dataclass(frozen=True, eq=False)
class Seen:
    """Which positions the sensors tell: of motors, of what drives turn, of joints, of springs."""

    motor: tuple[bool, ...]
    driven: tuple[bool, ...]
    joint: tuple[bool, ...]
    stretch: tuple[bool, ...]


def positions_seen(robot: Robot, sensors: Mapping[str, frozenset[str]]) -> Seen:
    """Return what the encoders tell, each directly or through others and the transmission."""
    n = robot.n
    C = exact_transmission(robot)
    rows: list[list[fmpq]] = []
    motors, driven, stretches = [], [], []
    for i, joint in enumerate(robot.joint_names):
        drive = robot.drivetrains[joint]
        unit = [fmpq(int(j == i)) for j in range(n)]
        turned = [fmpq(0)] * n + [C[i, j] for j in range(n)]
        motor = [*unit, *[fmpq(0)] * n]
        ratio = exact_number(drive.ratio)
        if isinstance(drive, StiffDrive):
            stretch = None
            rows.append([x - ratio * y for x, y in zip(motor, turned, strict=True)])
        else:
            in_, out = exact_number(drive.motor_radius) / ratio, exact_number(drive.load_radius)
            stretch = [in_ * x - out * y for x, y in zip(motor, turned, strict=True)]
        motors.append(motor)
        driven.append(turned)
        stretches.append(stretch)
        if "motor_position" in sensors[joint]:
            rows.append(motor)
        if "joint_position" in sensors[joint]:
            rows.append([*[fmpq(0)] * n, *unit])
        if "deflection" in sensors[joint] and stretch is not None:
            rows.append(stretch)
    rank = fmpq_mat(rows).rank() if rows else 0

    def told(position: list[fmpq] | None) -> bool:
        return position is not None and fmpq_mat([*rows, position]).rank() == rank

    joints = [[fmpq(int(j == n + i)) for j in range(2 * n)] for i in range(n)]
    return Seen(*(tuple(map(told, each)) for each in (motors, driven, joints, stretches)))


def exact_transmission(robot: Robot) -> fmpq_mat:
    """Return C (n, n) of phi = C q as rationals."""
    return fmpq_mat([[exact_number(x) for x in row] for row in robot.transmission])
