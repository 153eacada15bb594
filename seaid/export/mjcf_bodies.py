"""The bodies of a MuJoCo model: placements, joints and inertias of a robot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, safely, spaced
from seaid.errors import RobotError
from seaid.log.base_log import moving_base
from seaid.robot import Robot, is_physical
from seaid.robot.inertia import THIN, inconsistent_link, out_of_range, pseudo_inertia

TINY = 1e-14
"""Mass [kg] and second moments [kg m^2] in place of zero: MuJoCo rejects less than 1e-15."""


def add_bodies(robot: Robot, world: Any, notes: list[str], force: bool) -> dict[str, Any]:
    """Add a body with its joint for each moving link; return {joint: its element}.

    Dependent joints follow their leaders by an <equality>.
    """
    from lxml import etree

    loaded = (robot.parameters + robot.payload_parameters).reshape(-1, 10)
    # Place 0 of `bodies` is what Pinocchio calls joint 0, the fixed frame of its model: the world,
    # or the floating base, which seaid's model of the joints takes as fixed.
    bodies, joints = [world], {}
    if not robot.base_is_held:
        bodies = [_add_base(robot, world, loaded[-1], notes, force)]
    for position, index in enumerate(robot.model_order, 1):
        placement = robot.model.jointPlacements[position]
        link, joint = robot.body_names[index], robot.all_joint_names[index]
        body = etree.SubElement(
            bodies[robot.model.parents[position]],
            "body",
            name=_body_name(robot, link, notes),
            pos=spaced(placement.translation),
            quat=spaced(_quaternion(placement.rotation)),
        )
        bodies.append(body)
        _add_inertial(body, link, loaded[index], notes, force)
        joints[joint] = _add_joint(body, robot, position, index)
    if not robot.base_is_held:
        _add_contacts(robot, world, bodies)
    return joints


def _add_base(robot: Robot, world: Any, loaded: Array, notes: list[str], force: bool) -> Any:
    """Add the floor and the floating base with its free joint, or planar ones; return the base."""
    from lxml import etree

    # MuJoCo lets two shapes touch if contype of one and conaffinity of the other have a bit in
    # common: floor 1/2 and ball 2/1 do, ball and ball do not.
    floor = {"type": "plane", "size": "0 0 1", "contype": "1", "conaffinity": "2"}
    etree.SubElement(world, "geom", name="floor", **floor)
    link = robot.body_names[-1]
    body = etree.SubElement(world, "body", name=_body_name(robot, link, notes))
    base = moving_base(robot)
    if base.normal is None:
        etree.SubElement(body, "freejoint", name=f"{link}_free")
    else:
        # MuJoCo takes axes of joints in the frame of their body, here turned by `upright`. The
        # hinge comes last, so that the slides do not turn with it.
        body.set("quat", spaced(base.upright_quaternion))
        for name, axis, free in zip("xyz", np.eye(3), base.free_axes, strict=False):
            if free:
                slide = {"name": f"{link}_{name}", "type": "slide", "axis": spaced(axis)}
                etree.SubElement(body, "joint", **slide)
        turns = {"name": f"{link}_angle", "type": "hinge", "axis": spaced(base.normal)}
        etree.SubElement(body, "joint", **turns)
    _add_inertial(body, link, loaded, notes, force)
    return body


_SMALL_M = 0.005
"""Radius [m] of the ball of a contact that is a point, with the point in its middle."""


def _add_contacts(robot: Robot, world: Any, bodies: list[Any]) -> None:
    """Add the balls of the contacts, and raise the base until all are above the floor."""
    from lxml import etree

    base = moving_base(robot)
    data, lowest = robot.model.createData(), 0.0
    upright = np.eye(3) if base.upright is None else base.upright
    pin.forwardKinematics(robot.model, data, robot.to_model(np.zeros(robot.n)))
    for contact in base.contacts:
        index, rotation, position = base.frame(contact.link)
        place, joint = position + rotation @ np.array(contact.position_m), 0
        radius = contact.radius_m or _SMALL_M
        if index >= 0:
            joint = 1 + robot.model_order.index(index)
        height = float((upright @ data.oMi[joint].act(place))[2])  # above the base, in the world
        lowest = min(lowest, height - radius)
        shape = {"type": "sphere", "size": spaced([radius]), "pos": spaced(place)}
        touches = {"contype": "2", "conaffinity": "1", "mass": "0"}
        etree.SubElement(bodies[joint], "geom", name=f"{contact.link}_contact", **shape, **touches)
    bodies[0].set("pos", spaced([0.0, 0.0, -lowest]))


def _body_name(robot: Robot, link: str, notes: list[str]) -> str:
    """Return the name of a link's body; 'world' is renamed, because MuJoCo reserves it."""
    if link != "world":
        return link
    name = "world_link"
    while name in robot.body_names:
        name += "_"
    notes.append(f"link 'world' is the body '{name}': MuJoCo reserves 'world' for the fixed frame")
    return name


def _add_joint(body: Any, robot: Robot, position: int, index: int) -> Any:
    joint = robot.model.joints[position]
    data = joint.createData()
    joint.calc(data, np.zeros(1))
    # The column of motion of a Pinocchio joint is (linear, angular), in the frame of the joint.
    along = np.asarray(data.S).ravel()
    slides = robot.all_prismatic[index]
    element = body.makeelement(
        "joint",
        name=robot.all_joint_names[index],
        type="slide" if slides else "hinge",
        axis=spaced(along[:3] if slides else along[3:]),
    )
    lower, upper = -np.inf, np.inf
    if index < robot.n:
        lower, upper = float(robot.lower_limits[index]), float(robot.upper_limits[index])
    # Active stops would add torques that the equations of the method do not have.
    element.set("limited", "false")
    if np.isfinite(lower) and np.isfinite(upper) and lower < upper:
        element.set("range", spaced((lower, upper)))
    body.insert(1, element)
    return element


def _add_inertial(body: Any, link: str, parameters: Array, notes: list[str], force: bool) -> None:
    """Write ten parameters as mass, centre of mass, principal axes and moments."""
    from lxml import etree

    _check_consistent(link, parameters, force)
    mass = parameters[0]
    center = parameters[1:4] / mass if mass > 0 else np.zeros(3)
    # second moments S about the centre of mass; the moments of inertia are I = tr(S) 1 - S
    second = pseudo_inertia(parameters)[:3, :3] - mass * np.outer(center, center)
    moments, axes = safely(np.linalg.eigh, second, what="the inertia of a body", error=RobotError)
    if not is_physical(parameters, THIN):
        notes.append(
            f"link '{link}' is physically inconsistent: its second moments at the centre of mass "
            f"along the principal axes are {', '.join(f'{moment:.3g}' for moment in moments)} "
            "kg m^2; negative ones are written as zero"
        )
    moments = np.maximum(moments, TINY)
    # eigh may return a reflection (determinant -1), which no quaternion can be.
    axes[:, 2] *= np.linalg.det(axes)
    etree.SubElement(
        body,
        "inertial",
        pos=spaced(center),
        quat=spaced(_quaternion(axes)),
        mass=spaced([max(mass, TINY)]),
        # I_1 = S_2 + S_3: a sum of non-negative moments keeps the triangle inequality of MuJoCo.
        diaginertia=spaced(moments[[1, 2, 0]] + moments[[2, 0, 1]]),
    )


def _check_consistent(link: str, parameters: Array, force: bool) -> None:
    """Raise RobotError for inertial parameters that MJCF cannot hold, unless forced."""
    absurd = out_of_range(parameters)
    if absurd is not None and parameters[0] > 0:
        raise RobotError(f"link '{link}' would have {absurd}, which is not written")
    problem = inconsistent_link(link, parameters)
    if problem is None or (force and parameters[0] > 0):
        return
    advice = "identify with feasible=True, or write the nearest body with force=True"
    if parameters[0] <= 0:
        advice = "identify with feasible=True (force=True needs a mass of more than zero)"
    raise RobotError(f"{problem}: {advice}", "feasible=True", "force=True")


def _quaternion(rotation: Array) -> Array:
    """Return a rotation as w, x, y, z."""
    # Eigen has the scalar last, MuJoCo has it first.
    x, y, z, w = pin.Quaternion(np.asarray(rotation)).normalized().coeffs()
    return np.array([w, x, y, z])
