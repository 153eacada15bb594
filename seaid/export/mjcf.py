"""A MuJoCo model of a robot with the springs in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seaid.errors import RobotError
from seaid.export.mjcf_bodies import add_bodies
from seaid.export.mjcf_drives import add_drives
from seaid.export.mjcf_step import step_s
from seaid.files import write_whole
from seaid.identification import Identification
from seaid.robot import Robot

_BESIDE = (
    "joint limits are in the file but off (limited=false), contacts are off, and there are no "
    "shapes: let the viewer show inertias"
)


@dataclass(frozen=True)
class WrittenMjcf:
    """The file written, and in words what a reader of it must know."""

    path: Path
    notes: tuple[str, ...]


def write_mjcf(
    found: Identification | Robot, path: str | Path, *, force: bool = False
) -> WrittenMjcf:
    """Write the robot as a MuJoCo model (MJCF) that simulates with its drives.

    One body a moving link, payloads included. A stiff drive is at its joint: armature N^2 I_M,
    damping N^2 F_v, friction loss N F_C, and a motor of gear N. A series elastic one is a joint
    `<joint>_motor` of its own (armature I_M, damping F_v, friction loss F_C, motor of gear 1) and a
    fixed tendon `<joint>_spring` whose length is the deflection r_M/N theta_M - r_L theta_L. A
    stiff drive that moves several joints is a fixed tendon over them, `<joint>_drive`. Parallel
    springs and friction of a joint are at the joint. Controls are motor torques [N m], each motor
    named after its joint. MuJoCo itself is not needed to write. Terms of friction that MuJoCo does
    not have are left out, and `notes` (also a comment in the file) say so. `force` writes the
    nearest body that MuJoCo loads for one that cannot exist.

    Raises RobotError for such a body without `force`, for bodies and values that are not known, and
    for springs and coupled rotors that MuJoCo cannot say; SeaidError where the file cannot be
    written.
    """
    from lxml import etree

    robot = found.robot if isinstance(found, Identification) else found
    path = Path(path)
    if not np.all(np.isfinite(robot.parameters)):
        raise RobotError(f"'{robot.name}' has no inertial parameters to write")
    notes: list[str] = []
    root = etree.Element("mujoco", model=robot.name)
    option = _settings(robot, root)
    world = etree.SubElement(root, "worldbody")
    joints = add_bodies(robot, world, notes, force)
    parts = [etree.SubElement(root, part) for part in ("tendon", "actuator")]
    step, told = step_s(robot)
    option.set("timestep", repr(step))
    notes[:0] = [told, _BESIDE]
    add_drives(robot, joints, world, parts, step, notes)
    if np.any(robot.payload_parameters):
        notes.append("the payload that was known is part of the bodies it is fixed to")
    root.insert(0, etree.Comment(_comment(notes)))
    etree.indent(root)
    write_whole(path, etree.tostring(root, encoding="utf-8", xml_declaration=True))
    return WrittenMjcf(path, tuple(notes))


def _settings(robot: Robot, root: Any) -> Any:
    """Add what holds for the whole model; return <option>, still without its time step."""
    from lxml import etree

    etree.SubElement(
        root, "compiler", angle="radian", inertiafromgeom="false", balanceinertia="false"
    )
    gravity = " ".join(repr(float(value)) for value in robot.model.gravity.linear)
    option = etree.SubElement(root, "option", gravity=gravity, integrator="RK4")
    etree.SubElement(option, "flag", contact="disable")
    return option


def _comment(notes: list[str]) -> str:
    lines = "".join(f"\n  - {note}" for note in notes)
    while "--" in lines:  # which XML does not allow in a comment
        lines = lines.replace("--", "- -")
    return f" Written by seaid.{lines}\n"
