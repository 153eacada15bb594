"""The collision geometry of a URDF, placed on the joints of a Robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.errors import RobotError
from seaid.mesh_files import find_mesh, search_folders
from seaid.robot import Robot
from seaid.urdf import read_urdf

_SAME_PLACEMENT = 1e-2
"""Placements of one joint differ by less [m, rad] between two readings of one file (snapping)."""


def collision_geometry(
    urdf: str | Path, robot: Robot, package_dirs: str | Path | Sequence[str | Path]
) -> tuple[pin.GeometryModel, tuple[str, ...]]:
    """Return the collision geometry on the joints of `robot.model`, and the link of each object.

    Boxes, spheres and cylinders stay what they are; a mesh becomes its convex hull, which is never
    smaller. Raises RobotError for meshes that are not found or not read, and for another robot's
    file.
    """
    tree = read_urdf(urdf, 0.0)
    strangers = [name for name in robot.joint_names if name not in tree.joints]
    if strangers:
        raise RobotError(
            f"'{urdf}' is not the file of robot '{robot.name}': it has no joint "
            f"{', '.join(strangers)}"
        )
    text = _with_mesh_paths(Path(urdf), search_folders(Path(urdf), package_dirs))
    try:
        full = pin.buildModelFromXML(text)
        shapes = pin.buildGeomFromUrdfString(full, text, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as problem:
        raise RobotError(f"collision geometry of '{urdf}' cannot be read: {problem}") from None
    _check_same_tree(str(urdf), full, robot)
    data = full.createData()
    pin.forwardKinematics(full, data, pin.neutral(full))
    placed, links = pin.GeometryModel(), []
    for shape in shapes.geometryObjects:
        links.append(full.frames[shape.parentFrame].name)
        moving = _moving(full, shape.parentJoint, robot)
        joint = robot.model.getJointId(full.names[moving])
        placement = data.oMi[moving].actInv(data.oMi[shape.parentJoint] * shape.placement)
        convex = _convex(shape.geometry, links[-1], shape.meshPath)
        placed.addGeometryObject(pin.GeometryObject(shape.name, joint, placement, convex))
    return placed, tuple(links)


def _moving(full: pin.Model, joint: int, robot: Robot) -> int:
    """Return the joint, or the nearest one towards the base that is not locked (0: the base)."""
    while joint and full.names[joint] not in robot.joint_names:
        joint = full.parents[joint]
    return joint


def _check_same_tree(where: str, full: pin.Model, robot: Robot) -> None:
    data = full.createData()
    pin.forwardKinematics(full, data, pin.neutral(full))
    for own, name in enumerate(robot.model.names[1:], 1):
        joint = full.getJointId(name)
        parent = _moving(full, full.parents[joint], robot)
        # a locked joint is at zero: all joints at neutral leave the placements as they are
        placement = data.oMi[parent].actInv(data.oMi[joint]).homogeneous
        difference = placement - robot.model.jointPlacements[own].homogeneous
        same_parent = full.names[parent] == robot.model.names[robot.model.parents[own]]
        if not same_parent or np.max(np.abs(difference)) > _SAME_PLACEMENT:
            raise RobotError(
                f"'{where}' is not the file of robot '{robot.name}': joint '{name}' is elsewhere"
            )


def _convex(geometry: Any, link: str, mesh: str) -> Any:
    """Return the geometry, or its hull if it is a mesh, with its bounding sphere."""
    if isinstance(geometry, coal.BVHModelBase):
        geometry = _hull(geometry, link, mesh)
    geometry.computeLocalAABB()
    return geometry


def _hull(geometry: Any, link: str, mesh: str) -> Any:
    from scipy.spatial import ConvexHull, QhullError

    corners = np.array(geometry.vertices())
    try:
        corners = corners[ConvexHull(corners).vertices]  # coal's own ends the process on flat ones
    except QhullError:
        raise RobotError(
            f"link '{link}': collision mesh '{mesh}' is flat, its convex hull has no volume; use a "
            "box or another mesh"
        ) from None
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    try:
        return coal.Convex.convexHull(points, True, "Qt")
    except RuntimeError:  # coal takes 255 neighbours of a corner: joggled, it has fewer
        return coal.Convex.convexHull(points, True, "QJ")


def _with_mesh_paths(urdf: Path, folders: Sequence[Path]) -> str:
    """Return the text of the file with every collision mesh at its full path."""
    from lxml import etree

    root = etree.parse(str(urdf), etree.XMLParser(remove_comments=True)).getroot()
    if not root.get("name"):
        root.set("name", urdf.stem)
    meshes = [mesh for box in root.iter("collision") for mesh in box.iter("mesh")]
    where = {str(mesh.get("filename")): None for mesh in meshes}
    found: Mapping[str, Path | None] = {name: find_mesh(name, folders) for name in where}
    missing = [name for name, path in found.items() if path is None]
    if missing:
        raise RobotError(
            f"'{urdf}': {len(missing)} collision meshes not found: {', '.join(missing)}; searched "
            "in package_dirs, the folder of the file and those above it; give the folders that "
            "hold the packages by package_dirs=[...]"
        )
    for mesh in meshes:
        mesh.set("filename", str(found[mesh.get("filename")]))
    return str(etree.tostring(root, encoding="unicode"))


def bounding_spheres(geometry: pin.GeometryModel) -> tuple[Array, Array]:
    """Return centres (G, 3) in the objects' own frames and radii (G,) of spheres about them."""
    shapes = [shape.geometry for shape in geometry.geometryObjects]
    centres = np.array([shape.aabb_center for shape in shapes])
    return centres, np.array([shape.aabb_radius for shape in shapes])
