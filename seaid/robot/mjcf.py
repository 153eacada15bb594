"""A MuJoCo model (MJCF) as the text of a URDF: bodies, joints, limits and joint equalities.

MuJoCo compiles the file, so that defaults, included files, inertias of shapes and units are its
own. Shapes, actuators, tendons, damping and armature are not part of the URDF.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from seaid._arrays import Array, spaced
from seaid.errors import RobotError, reason_of
from seaid.robot.urdf import EARTH, displacement, warn_of

_EXACT_RAD = 1e-9
"""An angle of MuJoCo's quaternions is a multiple of pi/2 if it is closer than this."""


def urdf_of_mjcf(path: Path) -> bytes:
    """Return the URDF text of an MJCF file. Raises RobotError for closed loops."""
    try:
        import mujoco
    except ImportError:
        raise RobotError(
            f"'{path}' is a MuJoCo model, not a URDF: install the package that reads it "
            "(pip install mujoco), or name a URDF of the robot"
        ) from None
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except Exception as problem:  # ValueError, and whatever its parser raises
        raise RobotError(f"MuJoCo cannot compile '{path}': {reason_of(problem)}") from None
    if not np.allclose(model.opt.gravity, EARTH, atol=1e-6):
        gravity = ", ".join(f"{component:g}" for component in model.opt.gravity)
        warn_of(path, f"its gravity is ({gravity}) m/s^2, which gravity= must repeat")
    root = etree.Element("robot", name=path.stem)
    anchors = [np.zeros(3)]
    etree.SubElement(root, "link", name=_name(model.body(0)))
    for index in range(1, model.nbody):
        anchors.append(_add_body(root, model, index, anchors))
    _add_equalities(root, model, mujoco.mjtEq, path)
    return bytes(etree.tostring(root))


def joint_dynamics(path: Path) -> dict[str, tuple[float, float, float]]:
    """Return {joint: (damping, friction loss, armature)} of the one-axis joints of an MJCF file."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    joints = [model.joint(index) for index in range(model.njnt)]
    return {
        _joint_name(x): (float(x.damping[0]), float(x.frictionloss[0]), float(x.armature[0]))
        for x in joints
    }


def _name(element: Any, kind: str = "body") -> str:
    """Return the name of a body or a joint, or its kind and number."""
    return str(element.name or f"{kind}_{element.id}")


def _joint_name(joint: Any) -> str:
    return _name(joint, "joint")


def _add_body(root: Any, model: Any, index: int, anchors: list[Array]) -> Array:
    """Add the joints and the link of a body; return the origin of the link's frame in the body."""
    body, parent = model.body(index), int(model.body_parentid[index])
    above, anchor = _name(model.body(parent)), np.zeros(3)
    # A URDF has a joint at the origin of its child link, MuJoCo anywhere in the body: the frame of
    # a link is at the anchor of its last joint.
    placement = pin.SE3(_rotation(body.quat), body.pos - anchors[parent])
    first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
    for j in range(first, first + count):
        joint = model.joint(j)
        last = j == first + count - 1
        # Several joints of a body are a chain of links without mass.
        child = _name(body) if last else f"{_name(body)}_{_joint_name(joint)}"
        if not last:
            etree.SubElement(root, "link", name=child)
        placement = placement * pin.SE3(np.eye(3), joint.pos - anchor)
        anchor, above = joint.pos.copy(), _add_joint(root, model, joint, (above, child), placement)
        placement = pin.SE3.Identity()
    if not count:
        _joint(root, f"{_name(body)}_fixed", "fixed", (above, _name(body)), placement)
    link = etree.SubElement(root, "link", name=_name(body))
    if body.mass[0] > 0:
        inertial = etree.SubElement(link, "inertial")
        _origin(inertial, pin.SE3(_rotation(body.iquat), body.ipos - anchor))
        etree.SubElement(inertial, "mass", value=repr(float(body.mass[0])))
        moments = dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
        moments |= zip(("ixx", "iyy", "izz"), map(float, body.inertia), strict=True)
        etree.SubElement(inertial, "inertia", {name: repr(x) for name, x in moments.items()})
    return anchor


_KINDS = ("floating", "spherical", "prismatic", "revolute")
"""Types of URDF in the order of MuJoCo's mjtJoint: free, ball, slide, hinge."""


def _add_joint(
    root: Any, model: Any, joint: Any, links: tuple[str, str], placement: pin.SE3
) -> str:
    """Add a joint of a body, whose position is zero at the reference; return its child link."""
    kind = _KINDS[int(joint.type[0])]
    axis = np.array(joint.axis)
    if kind in ("prismatic", "revolute"):
        # The placement in the file is that at q = qpos0, in a URDF that at q = 0.
        reference = float(model.qpos0[int(joint.qposadr[0])])
        placement = placement * displacement(kind, axis, -reference)
        if kind == "revolute" and not joint.limited[0]:
            kind = "continuous"
    element = _joint(root, _joint_name(joint), kind, links, placement)
    etree.SubElement(element, "axis", xyz=spaced(axis))
    if joint.limited[0] and kind in ("prismatic", "revolute"):
        lower, upper = map(float, joint.range)
        etree.SubElement(element, "limit", lower=repr(lower), upper=repr(upper))
    return links[1]


def _joint(root: Any, name: str, kind: str, links: tuple[str, str], placement: pin.SE3) -> Any:
    element = etree.SubElement(root, "joint", name=name, type=kind)
    etree.SubElement(element, "parent", link=links[0])
    etree.SubElement(element, "child", link=links[1])
    _origin(element, placement)
    return element


def _origin(element: Any, placement: pin.SE3) -> None:
    angles = np.array(pin.rpy.matrixToRpy(placement.rotation))
    nearest = np.round(angles / (math.pi / 2)) * (math.pi / 2)
    angles = np.where(np.abs(angles - nearest) < _EXACT_RAD, nearest, angles)
    etree.SubElement(element, "origin", xyz=spaced(placement.translation), rpy=spaced(angles))


def _add_equalities(root: Any, model: Any, kinds: Any, path: Path) -> None:
    """Add joint equalities q1 - q1_0 = a0 + a1 (q2 - q2_0) as mimic; refuse closed loops."""
    joints = {element.get("name"): element for element in root.iter("joint")}
    for index in np.flatnonzero(model.eq_active0):
        kind = int(model.eq_type[index])
        if kind == kinds.mjEQ_CONNECT:
            raise RobotError(
                f"'{path}' has a closed loop (<connect>), and seaid reads trees: model the loop "
                "by <equality><joint> or mimic, or open it"
            )
        if kind != kinds.mjEQ_JOINT or model.eq_obj2id[index] < 0:
            continue
        joint, leader = (model.joint(int(ids[index])) for ids in (model.eq_obj1id, model.eq_obj2id))
        constant, factor, *curve = map(float, model.eq_data[index][:5])
        if any(curve):
            raise RobotError(
                f"'{path}': joint '{_joint_name(joint)}' follows '{_joint_name(leader)}' by a "
                "polynomial of higher degree than 1, which seaid does not model"
            )
        start, lead = (float(model.qpos0[int(x.qposadr[0])]) for x in (joint, leader))
        etree.SubElement(
            joints[_joint_name(joint)],
            "mimic",
            joint=_joint_name(leader),
            multiplier=repr(factor),
            offset=repr(constant + start - factor * lead),
        )


def _rotation(quaternion: Array) -> Array:
    """Return the rotation of a quaternion w, x, y, z."""
    w, x, y, z = quaternion
    return np.asarray(pin.Quaternion(w, x, y, z).normalized().toRotationMatrix())
