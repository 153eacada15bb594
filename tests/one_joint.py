"""The smallest robot, for tests of what is read: one joint, "arm", that moves one body."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seaid.robot.robot import Robot, load_robot

BODY = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)


def one_joint(folder: Path, kind: str = "revolute", drive: dict[str, Any] | None = None) -> Robot:
    """Write the robot's URDF into a folder and load it."""
    path = folder / "arm.urdf"
    path.write_text(
        f'<robot name="arm"><link name="base"/><link name="body">{BODY}</link><joint name="arm" '
        f'type="{kind}"><parent link="base"/><child link="body"/></joint></robot>'
    )
    return load_robot(path, {"arm": drive} if drive else None)
