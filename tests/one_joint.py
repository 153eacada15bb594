"""The smallest robot, for tests of what is read: one joint, "arm", that moves one body."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seaid.legged import load_robot
from seaid.robot import Robot

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


def chain(folder: Path, *joints: str, limit: float = 3.0) -> Robot:
    """Return a chain of revolute joints with these names."""
    limits = f'<limit lower="{-limit}" upper="{limit}" effort="9" velocity="9"/>'
    links = ["base", *(f"link_of_{joint}" for joint in joints)]
    body = "".join(
        f'<link name="{child}">{BODY}</link><joint name="{joint}" type="revolute">{limits}'
        f'<parent link="{parent}"/><child link="{child}"/></joint>'
        for joint, parent, child in zip(joints, links[:-1], links[1:], strict=True)
    )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="robot"><link name="base"/>{body}</robot>')
    return load_robot(path)
