"""load_robot: a robot from its file, of the type that its base needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from seaid.errors import RobotError, checked
from seaid.regressor.base import check_constant_ratios
from seaid.robot import BaseKind, Contact, Payload, Robot
from seaid.robot.floating_base import base_of_assembly
from seaid.robot.robot import robot_of_file
from seaid.robot.urdf import EARTH, SNAP_RAD


@checked(RobotError)
def load_robot(
    urdf: str | Path,
    drives: str | Path | Mapping[str, Any] | None = None,
    *,
    joints: Sequence[str] | None = None,
    locked: Mapping[str, float] | None = None,
    payloads: Sequence[Payload] = (),
    known_bodies: str | Sequence[str] = (),
    gravity: Sequence[float] = EARTH,
    snap_tolerance_rad: float = SNAP_RAD,
    independent_mimics: bool = False,
    base: BaseKind = "fixed",
    contacts: Sequence[str | Contact] = (),
    imu_link: str | None = None,
) -> Robot:
    """Load a URDF with a fixed or a floating base, and its drives.

    Revolute, continuous and prismatic joints of any axis can move; links behind fixed joints are
    merged into their parents. A mimic joint moves with its leader, as by a transmission: it has no
    drive, no column in a log and no equation of its own, and its body loads its leader.

    Parameters
    ----------
    urdf : str or Path
        The robot description; meshes are not opened.
    drives : path of a TOML file, mapping {joint: drive or table}, or None
        A joint without a drive has an ideal stiff one: its torque is known at the joint.
    joints : list of str, optional
        The joints that move, in the order of all arrays; the others are locked at zero. Default:
        all but those of `locked`, in Pinocchio's order.
    locked : mapping {joint: position}, optional
        Joints that stand still elsewhere, at these positions [rad or m].
    payloads : list of Payload
        Known bodies fixed to links; they are not identified.
    known_bodies : list of str
        Links whose inertial parameters in the URDF are known and not identified; "all": all that
        have any there.
    gravity : 3 floats, default (0, 0, -9.81)
        Gravity [m/s^2] in the base frame.
    snap_tolerance_rad : float, default 2e-3
        Rounded angles in joint origins become the multiples of pi/2 that they mean, such as 1.5708,
        if they are closer than this; 0 keeps all angles. See `seaid.robot.robot_file.read_urdf`.
    independent_mimics : bool, default False
        Whether mimic joints are independent ones with their own drives, as without <mimic>.
    base : {"fixed", "floating", "planar", "planar_xy", "planar_xz", "planar_yz"}
        Whether something holds the base, or it moves freely, as that of a legged robot; a planar
        one moves in a plane of the axes of its link, as that of a hopper on a boom ("planar_xz"),
        whose guide has unknown forces. A floating or planar joint at the root of the file is that
        of the base; "planar" takes the plane from it.
    contacts : list of str or Contact
        Links that can touch the ground, of a floating base: a name is a point contact at the origin
        of the link's frame.
    imu_link : str, optional
        The link of the inertial measurement unit, also one that joints move. Default: the base.

    Returns
    -------
    Robot

    Raises
    ------
    RobotError
        For files that cannot be read, joints of other types, and arguments that do not fit.

    Examples
    --------
    >>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
    >>> robot.joint_names, robot.elastic_joints
    """
    robot, built = robot_of_file(
        urdf,
        drives,
        joints=joints,
        locked=locked,
        payloads=payloads,
        known_bodies=known_bodies,
        gravity=gravity,
        snap_tolerance_rad=snap_tolerance_rad,
        independent_mimics=independent_mimics,
        base=base,
    )
    if base != "fixed":
        # All that is registered for such a robot is loaded with it.
        from seaid.legged.extension import floating_robot

        check_constant_ratios(robot, "a floating base")
        values = {x.name: getattr(robot, x.name) for x in fields(Robot)}
        root = base_of_assembly(built, contacts, imu_link, base)
        return floating_robot({**values, "floating_base": root})
    if contacts or imu_link:
        raise RobotError(
            "contacts= and imu_link= are those of a floating base: give base='floating' with them",
            *("contacts=", "imu_link=", "base='floating'"),
        )
    return robot
