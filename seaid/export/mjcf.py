"""write_mjcf: a MuJoCo model of a robot with its springs, and the time step that resolves them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import safely, spaced
from seaid._files import write_whole
from seaid._progress import Display
from seaid.errors import RobotError, checked
from seaid.export.mjcf_bodies import TINY, add_bodies
from seaid.export.mjcf_drives import add_drives, temperature_notes
from seaid.frequency.linear_joints import linearised, state_matrix
from seaid.identification import Identification
from seaid.regressor.base import check_constant_ratios
from seaid.robot import Robot

_SETTINGS_NOTE = (
    "joint limits are in the file but off (limited=false), contacts are off, and there are no "
    "shapes: let the viewer show inertias"
)


_FLOATING_NOTE = (
    "joint limits are in the file but off (limited=false); the only shapes are the floor and a "
    "ball at each contact, which touches nothing but the floor; flat feet are balls too"
)


@dataclass(frozen=True, repr=False)
class WrittenMjcf(Display):
    """The file written, and `notes` on what differs from the identified model."""

    path: Path
    notes: tuple[str, ...]


@checked(RobotError)
def write_mjcf(
    identified: Identification | Robot,
    path: str | Path,
    *,
    force: bool = False,
    at_temperature_degC: float | None = None,
) -> WrittenMjcf:
    """Write a robot with its drives as a MuJoCo model (MJCF).

    There is one body per moving link, payloads included. A stiff drive is on its joint: armature
    N^2 I_M, damping N^2 F_v, friction loss N F_C, motor of gear N; one that moves several joints is
    a fixed tendon `<joint>_drive`. A series elastic drive is a joint `<joint>_motor` (armature I_M,
    damping F_v, friction loss F_C, motor of gear 1) and a fixed tendon `<joint>_spring`, whose
    length is the deflection r_M/N theta_M - r_L theta_L. Parallel springs and joint friction are on
    the joint. Controls are motor torques [N m]; each motor has the name of its joint. Friction
    terms that MuJoCo lacks are excluded and noted. MuJoCo need not be installed.

    A floating base has a free joint, a planar one two slides and a hinge; each of its contacts is a
    ball that can touch a level floor, and contacts are on.

    Parameters
    ----------
    identified : Identification or Robot
    path : path
        The file to write.
    force : bool
        Whether to write the nearest valid body for one that is physically inconsistent.
    at_temperature_degC : float, optional
        Temperature of the motors, for friction that depends on it. Default: the reference
        temperature of each drive.

    Returns
    -------
    WrittenMjcf
        Its `notes`, also a comment in the file, list what differs from the identified model.

    Raises
    ------
    RobotError
        For a physically inconsistent body without `force`, unknown bodies or values, and springs or
        coupled rotors that MuJoCo cannot represent.
    SeaidError
        If the file cannot be written.

    Examples
    --------
    >>> result = seaid.identify(robot, log, feasible=True)
    >>> seaid.write_mjcf(result, "leg.xml").notes
    """
    from lxml import etree

    reference = identified.robot if isinstance(identified, Identification) else identified
    robot, path = reference.at_temperature(at_temperature_degC), Path(path)
    check_constant_ratios(robot, "a MuJoCo model")
    if not np.all(np.isfinite(robot.parameters)):
        raise RobotError(f"'{robot.name}' has no inertial parameters to write")
    notes: list[str] = []
    root = etree.Element("mujoco", model=robot.name)
    option = _settings(robot, root)
    world = etree.SubElement(root, "worldbody")
    joints = add_bodies(robot, world, notes, force)
    parts = [etree.SubElement(root, part) for part in ("tendon", "actuator")]
    step, step_note = _time_step(robot)
    option.set("timestep", repr(step))
    settings = _SETTINGS_NOTE if robot.base_is_held else _FLOATING_NOTE
    notes[:0] = [step_note, settings, *temperature_notes(reference, at_temperature_degC)]
    add_drives(robot, joints, world, parts, step, notes)
    _add_dependent(robot, root, step, notes)
    if np.any(robot.payload_parameters):
        notes.append("the known payload is part of the bodies to which it is fixed")
    root.insert(0, etree.Comment(_comment(notes)))
    etree.indent(root)
    write_whole(path, etree.tostring(root, encoding="utf-8", xml_declaration=True))
    return WrittenMjcf(path, tuple(notes))


_LONGEST_S, _SHORTEST_S = 1e-3, 1e-6
"""Longest and shortest time step [s] that is written."""

_STEPS_PER_RADIAN = 20.0
"""Time steps per radian of the fastest oscillation."""


def _time_step(robot: Robot) -> tuple[float, str]:
    """Return a time step [s] that resolves the fastest spring and damper, and a note about it."""
    fastest = float(np.max(np.abs(_rates(robot)), initial=0.0))
    # RK4 is stable up to |lambda| step = 2.8 or so; 1/20 is for the accuracy of the fastest mode.
    wanted = min(_LONGEST_S, 1 / (_STEPS_PER_RADIAN * max(fastest, TINY)))
    # A frequency that needs less than a microsecond is not resolved; the note has its value.
    step = max(_round_down(wanted), _SHORTEST_S)
    return step, (
        f"integrator RK4 with steps of {step:g} s: springs and dampers are as fast as "
        f"{fastest:.3g} rad/s (at the zero position)"
    )


def _rates(robot: Robot) -> np.ndarray:
    """Return the eigenvalues [1/s] of the linearised robot at zero positions, without gravity."""
    joints = linearised(robot, np.zeros(robot.n), range(robot.n))
    drives = (robot.drives[joint] for joint in robot.joint_names)
    parallel = np.diag([drive.values.get("parallel_stiffness", 0.0) for drive in drives])
    joints = replace(
        joints,
        # `linearised` has gravity and parallel springs in one stiffness at the joints: here it is
        # that of the parallel springs alone.
        gravity=joints.motion.T @ parallel @ joints.motion,
        # Unknown values are refused with their names when the drives are written.
        inertia=np.nan_to_num(joints.inertia),
        stiffness=np.nan_to_num(joints.stiffness),
    )
    inertia, damping, stiffness = joints.matrices()
    # Links without inertia about a joint, or motors of inertia zero, would make M singular.
    system = state_matrix(inertia + TINY * np.eye(len(inertia)), damping, stiffness)
    return np.asarray(safely(np.linalg.eigvals, system, what="the time step", error=RobotError))


def _round_down(step: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that does not exceed a step."""
    power = 10.0 ** math.floor(math.log10(step) + 1e-9)
    return float(f"{max(m for m in (1, 2, 5) if m * power <= step * (1 + 1e-9)) * power:g}")


def _add_dependent(robot: Robot, root: Any, step: float, notes: list[str]) -> None:
    """Add the equalities of dependent joints, as stiff as a step [s] allows."""
    from lxml import etree

    if not robot.dependent_joints:
        return
    equality = etree.SubElement(root, "equality")
    for joint in robot.dependent_joints:
        etree.SubElement(
            equality,
            "joint",
            joint1=joint.name,
            joint2=joint.leader,
            # joint1 = a_0 + a_1 joint2 + ...: the first coefficient is the offset, about positions
            # of zero.
            polycoef=spaced((joint.offset, joint.multiplier, 0.0, 0.0, 0.0)),
            # The time constant must be two steps or more for a stable constraint (MuJoCo, refsafe).
            solref=spaced((2 * step, 1.0)),
            solimp=spaced((0.999, 0.9999, 0.001)),
        )
    notes.append(
        f"{', '.join(joint.name for joint in robot.dependent_joints)}: a mimic joint follows its "
        "leader by an equality, which is soft in MuJoCo: give the state of both at the start"
    )


def _settings(robot: Robot, root: Any) -> Any:
    """Add the settings of the model; return <option>, still without its time step."""
    from lxml import etree

    # No inertia but that of <inertial>: none of shapes, and no mean of the three moments where
    # rounding misses the triangle inequality.
    etree.SubElement(
        root, "compiler", angle="radian", inertiafromgeom="false", balanceinertia="false"
    )
    gravity = " ".join(repr(float(value)) for value in robot.model.gravity.linear)
    option = etree.SubElement(root, "option", gravity=gravity, integrator="RK4")
    if robot.base_is_held:
        etree.SubElement(option, "flag", contact="disable")
    return option


def _comment(notes: list[str]) -> str:
    lines = "".join(f"\n  - {note}" for note in notes)
    while "--" in lines:  # which XML does not allow in a comment
        lines = lines.replace("--", "- -")
    return f" Written by seaid.{lines}\n"
