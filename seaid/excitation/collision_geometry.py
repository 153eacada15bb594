"""The collision geometry of a URDF, placed on the joints of a Robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.errors import RobotError, listed, shortened
from seaid.mesh_files import find_mesh, search_folders
from seaid.mesh_hulls import Mesh, hulls
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
    text, meshes = _without_meshes(Path(urdf), search_folders(Path(urdf), package_dirs))
    try:
        full = pin.buildModelFromXML(text)
        shapes = pin.buildGeomFromUrdfString(full, text, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as problem:
        raise RobotError(f"collision geometry of '{urdf}' cannot be read: {problem}") from None
    _check_same_tree(str(urdf), full, robot)
    convex = dict(zip(meshes, hulls(urdf, list(meshes.values())), strict=True))
    data = full.createData()
    pin.forwardKinematics(full, data, pin.neutral(full))
    placed, links = pin.GeometryModel(), []
    for shape in shapes.geometryObjects:
        links.append(full.frames[shape.parentFrame].name)
        moving = _moving(full, shape.parentJoint, robot)
        joint = robot.model.getJointId(full.names[moving])
        placement = data.oMi[moving].actInv(data.oMi[shape.parentJoint] * shape.placement)
        geometry = convex.get(shape.name, shape.geometry)
        geometry.computeLocalAABB()
        placed.addGeometryObject(pin.GeometryObject(shape.name, joint, placement, geometry))
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


def _without_meshes(urdf: Path, folders: Sequence[Path]) -> tuple[str, dict[str, Mesh]]:
    """Return the text of the file with a ball in the place of every collision mesh, and those.

    They are named as Pinocchio names its objects: link, and number of the link's collision element.
    """
    from lxml import etree

    root = etree.parse(str(urdf), etree.XMLParser(remove_comments=True)).getroot()
    if not root.get("name"):
        root.set("name", urdf.stem)
    named = {
        f"{link.get('name')}_{place}": (str(link.get("name")), mesh)
        for link in root.iter("link")
        for place, box in enumerate(link.iterfind("collision"))
        for mesh in box.iterfind("geometry/mesh")
    }
    where = dict.fromkeys(str(mesh.get("filename")) for _, mesh in named.values())
    found = {name: find_mesh(name, folders) for name in where}
    missing = [name for name, path in found.items() if path is None]
    if missing:
        raise RobotError(
            f"'{urdf}': {len(missing)} collision meshes not found: {listed(missing)}; searched "
            "in package_dirs, the folder of the file and those above it; give the folders that "
            "hold the packages by package_dirs=[...]"
        )
    meshes = {}
    for name, (link, mesh) in named.items():
        path = found[str(mesh.get("filename"))]
        if path is not None:
            meshes[name] = Mesh(link, path, _scale(urdf, link, mesh.get("scale") or "1 1 1"))
        mesh.getparent().replace(mesh, etree.Element("sphere", radius="1"))
    return str(etree.tostring(root, encoding="unicode")), meshes


def _scale(urdf: Path, link: str, text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(one) for one in text.split())
    except ValueError:
        x = y = z = 0.0
    if not np.all(np.isfinite([x, y, z])) or 0.0 in (x, y, z):
        raise RobotError(
            f"'{urdf}', link '{link}': the scale of a mesh must be three numbers that are not "
            f"zero, found '{shortened(text)}'"
        )
    return x, y, z


def bounding_spheres(geometry: pin.GeometryModel) -> tuple[Array, Array]:
    """Return centres (G, 3) in the objects' own frames and radii (G,) of spheres about them."""
    shapes = [shape.geometry for shape in geometry.geometryObjects]
    centres = np.array([shape.aabb_center for shape in shapes])
    return centres, np.array([shape.aabb_radius for shape in shapes])
