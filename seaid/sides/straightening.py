"""What `identify` does first where drives have terms that are not linear in their parameters."""

from __future__ import annotations

from collections.abc import Sequence

from seaid.errors import IdentificationError
from seaid.motion import Motion
from seaid.robot import Robot
from seaid.sides.bent import straightened
from seaid.sides.bent_load import bent_joints
from seaid.sides.gear_torque import under_load, with_gear_torques
from seaid.sides.records import Record, first_motion


def straightened_robot(
    robot: Robot, records: Sequence[Record], used: Sequence[str]
) -> tuple[Robot, list[Record]]:
    """Return the robot near whose values its drives' equations are taken, and its records.

    The records know the load's torque where friction depends on it. Of logs that are read in
    pieces the first piece is searched. Drives that are linear stay as they are. Raises
    IdentificationError for friction under load of a stiff drive in a log that is read in pieces.
    """
    motions = [first_motion(record) for record in records]
    robot = straightened(robot, motions)
    if not bent_joints(robot, used) and not under_load(robot, used):
        return robot, list(records)
    robot, known = with_gear_torques(robot, motions, used)
    if not under_load(robot, used):
        return robot, list(records)
    if not all(isinstance(record, Motion) for record in records):
        raise IdentificationError(
            "friction under load of a stiff drive needs the log in memory: read it with read_log"
        )
    return robot, list(known)
