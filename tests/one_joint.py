"""The smallest robot, for tests of what is read: one joint, "arm", that moves one body."""

from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from seaid.legged import load_robot
from seaid.robot import Robot
from tests.plants import write_robot

BODY = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)


def one_joint(folder: Path, kind: str = "revolute", drive: dict[str, Any] | None = None) -> Robot:
    """Write the robot's URDF into a folder and load it."""
    path = write_robot(folder / "arm.urdf", {"arm": f"{kind} base body"}, BODY)
    return load_robot(path, {"arm": drive} if drive else None)


def chain(folder: Path, *joints: str, limit: float = 3.0, name: str = "robot") -> Robot:
    """Return a chain of revolute joints with these names, which may have any letters."""
    limits = f'<limit lower="{-limit}" upper="{limit}" effort="9" velocity="9"/>'
    links = [quoteattr(link) for link in ("base", *(f"link_of_{joint}" for joint in joints))]
    body = "".join(
        f'<link name={child}>{BODY}</link><joint name={quoteattr(joint)} type="revolute">{limits}'
        f"<parent link={parent}/><child link={child}/></joint>"
        for joint, parent, child in zip(joints, links[:-1], links[1:], strict=True)
    )
    path = folder / "robot.urdf"
    text = f'<robot name={quoteattr(name)}><link name="base"/>{body}</robot>'
    path.write_text(text, encoding="utf-8")
    return load_robot(path)
