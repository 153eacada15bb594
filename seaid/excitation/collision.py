"""Distances between the bodies of a robot and keep-out boxes, with exact gradients.

`collision_geometry` reads the shapes of a URDF on the joints of a Robot; meshes become convex
hulls, in a child process because their readers crash on damaged files. `load_scene` adds boxes and
pairs of bodies and makes a Scene, of which `distances` and `distance_gradients` are computed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite
from seaid.errors import ExcitationError, RobotError, listed, reason_of, shortened
from seaid.log.readers.child_process import SECONDS, ChildError, child
from seaid.robot import Robot, UrdfTree, reread_urdf
from seaid.robot.urdf import find_mesh, numbers_of, search_folders

_BYTES_PER_SECOND = 1e6
"""Slowest rate [bytes/s] at which a child reads a mesh."""

MOST_SIZE_M = 1e6
"""Largest coordinate [m] of a mesh, and coordinate or edge of a keep-out box; larger ones overflow
the arithmetic of distances."""


Mesh = tuple[str, str, tuple[float, float, float]]
"""A link, the path of its mesh, and the scale (three factors) that the URDF gives it."""


def hulls(urdf: str | Path, meshes: Sequence[Mesh]) -> list[Any]:
    """Return the convex hulls of meshes as shapes of coal, or raise RobotError for a flat one."""
    if not meshes:
        return []
    size = sum(Path(path).stat().st_size for _, path, _ in meshes)
    seconds = SECONDS + size / _BYTES_PER_SECOND
    shapes = []
    with child(seconds) as call:
        for link, path, scale in meshes:
            where = f"link '{link}': collision mesh '{path}'"
            try:
                option, corners = call(hull_corners, where, path, scale)
            except ChildError as problem:
                raise RobotError(
                    f"collision geometry of '{urdf}' cannot be read: {problem} at {where}; repair "
                    "the mesh, or use a box, a cylinder or a sphere in its place"
                ) from None
            shapes.append(coal.Convex.convexHull(_points(corners), True, option))
    return shapes


def hull_corners(
    where: str, path: str, scale: tuple[float, float, float]
) -> tuple[Literal["Qt", "QJ"], Array]:
    """Return the option of Qhull and the corners (C, 3) of a mesh's hull; runs in the child."""
    try:
        vertices = np.array(coal.MeshLoader().load(path, np.array(scale, dtype=float)).vertices())
    except Exception as problem:  # a reader of fifty formats
        raise RobotError(f"{where} cannot be read: {_reason(problem)}") from None
    return _corners(where, vertices)


def _corners(where: str, vertices: Array) -> tuple[Literal["Qt", "QJ"], Array]:
    """Return the option with which coal accepts the hull, and its corners (C, 3).

    Raises RobotError for a flat mesh.
    """
    from scipy.spatial import ConvexHull, QhullError

    if not len(vertices) or not np.all(np.abs(vertices) < MOST_SIZE_M):
        raise RobotError(f"{where} has no corners, or some that are beyond {MOST_SIZE_M:g} m")
    try:
        # coal's own hull aborts the process on a flat mesh
        corners = vertices[ConvexHull(vertices).vertices]
    except (QhullError, ValueError):
        raise RobotError(
            f"{where} is flat, its convex hull has no volume; use a box or another mesh"
        ) from None
    try:
        # A trial: the parent makes the hull again of these corners, by the same option of Qhull.
        # Qt: triangulated faces; QJ: joggled input.
        coal.Convex.convexHull(_points(corners), True, "Qt")
    except RuntimeError:  # coal allows 255 neighbours per corner; joggling leaves fewer
        coal.Convex.convexHull(_points(corners), True, "QJ")
        return "QJ", corners
    return "Qt", corners


def _reason(problem: Exception) -> str:
    """Return the message of an exception, without its location in coal's source."""
    _, separator, message = str(problem).partition("message: ")
    lines = message.splitlines()[1:2] if separator else []  # the text is on the line after it
    return shortened(lines[0], 300) if lines else reason_of(problem)


def _points(corners: Array) -> Any:
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    return points


_SAME_PLACEMENT = 1e-2
"""Largest difference [m, rad] of a placement between two readings of a file.

The robot was read with angles snapped to multiples of pi/2, by default by up to 2e-3 rad each, and
for its shapes the file is read without. A placement may have several snapped angles, three of its
own and those of locked joints before it: five of them pass."""


def collision_geometry(
    urdf: str | Path, robot: Robot, package_dirs: str | Path | Sequence[str | Path]
) -> tuple[pin.GeometryModel, tuple[str, ...]]:
    """Return the collision geometry on the joints of `robot.model`, and the link of each object.

    Boxes, spheres and cylinders are kept; a mesh becomes its convex hull, which contains it. Raises
    RobotError for meshes that are not found or not readable, and for the file of another robot.
    """
    tree = reread_urdf(urdf, snap_tolerance_rad=0.0)
    strangers = [name for name in robot.joint_names if name not in tree.joints]
    if strangers:
        raise RobotError(
            f"'{urdf}' is not the file of robot '{robot.name}': it has no joint "
            f"{', '.join(strangers)}"
        )
    text, meshes = _without_meshes(tree, search_folders(Path(urdf), package_dirs))
    try:
        full = pin.buildModelFromXML(text)
        shapes = pin.buildGeomFromUrdfString(full, text, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as problem:
        raise RobotError(f"collision geometry of '{urdf}' cannot be read: {problem}") from None
    at_rest = _rest_configuration(full, tree.still(robot.locked))
    still = [full.getJointId(x) for x in full.names[1:] if x not in robot.all_joint_names]
    model, moved = pin.buildReducedModel(full, shapes, still, at_rest)
    _check_same_tree(str(urdf), model, robot)
    convex = dict(zip(meshes, hulls(urdf, list(meshes.values())), strict=True))
    placed = pin.GeometryModel()
    for shape in moved.geometryObjects:
        joint = robot.model.getJointId(model.names[shape.parentJoint])
        geometry = convex.get(shape.name, shape.geometry)
        geometry.computeLocalAABB()
        placed.addGeometryObject(pin.GeometryObject(shape.name, joint, shape.placement, geometry))
    return placed, tuple(full.frames[x.parentFrame].name for x in shapes.geometryObjects)


def _rest_configuration(full: pin.Model, still: Mapping[str, float]) -> Array:
    """Return the configuration with moving joints at zero and the locked ones where they stand."""
    q = pin.neutral(full)
    for name, position in still.items():
        joint = full.joints[full.getJointId(name)]
        is_turning = joint.nq == 2  # a continuous joint: cosine and sine
        coordinates = [np.cos(position), np.sin(position)] if is_turning else [position]
        q[joint.idx_q : joint.idx_q + joint.nq] = coordinates
    return np.asarray(q)


def _check_same_tree(where: str, model: pin.Model, robot: Robot) -> None:
    """Raise RobotError unless each joint has its parent and placement in the file's model, too."""
    for index, name in enumerate(robot.model.names[1:], 1):
        joint = model.getJointId(name)
        placement = model.jointPlacements[joint].homogeneous
        difference = placement - robot.model.jointPlacements[index].homogeneous
        parent, expected = model.parents[joint], robot.model.parents[index]
        is_elsewhere = model.names[parent] != robot.model.names[expected]
        if is_elsewhere or np.max(np.abs(difference)) > _SAME_PLACEMENT:
            raise RobotError(
                f"'{where}' is not the file of robot '{robot.name}': joint '{name}' is elsewhere"
            )


def _without_meshes(tree: UrdfTree, folders: Sequence[Path]) -> tuple[str, dict[str, Mesh]]:
    """Return the URDF text with every collision mesh replaced by a sphere, and the meshes by name.

    The names are those of Pinocchio's objects: link, and number of the link's collision element.
    """
    from lxml import etree

    urdf, root = tree.path, etree.fromstring(tree.xml)
    named = {
        f"{link.get('name')}_{place}": (str(link.get("name")), mesh)
        for link in root.iter("link")
        for place, box in enumerate(link.iterfind("collision"))
        for mesh in box.iterfind("geometry/mesh")
    }
    files = _mesh_files(urdf, [str(mesh.get("filename")) for _, mesh in named.values()], folders)
    meshes = {}
    for (name, (link, mesh)), path in zip(named.items(), files, strict=True):
        meshes[name] = link, str(path), _scale(urdf, link, mesh.get("scale") or "1 1 1")
        # Pinocchio would read the file in this process: a placeholder, whose name finds the hull
        mesh.getparent().replace(mesh, etree.Element("sphere", radius="1"))
    return str(etree.tostring(root, encoding="unicode")), meshes


def _mesh_files(urdf: Path, names: Sequence[str], folders: Sequence[Path]) -> list[Path]:
    files = {name: find_mesh(name, folders) for name in names}
    missing = [name for name, path in files.items() if path is None]
    if missing:
        raise RobotError(
            f"'{urdf}': {len(missing)} collision meshes not found: {listed(missing)}; searched "
            "in package_dirs, the folder of the file and those above it; give the folders that "
            "hold the packages by package_dirs=[...]"
        )
    return [path for path in map(files.get, names) if path is not None]


def _scale(urdf: Path, link: str, text: str) -> tuple[float, float, float]:
    try:
        x, y, z = numbers_of(text)
    except ValueError:
        x = y = z = 0.0
    if not np.all(np.isfinite([x, y, z])) or 0.0 in (x, y, z):
        raise RobotError(
            f"'{urdf}', link '{link}': the scale of a mesh must be three numbers that are not "
            f"zero, found '{shortened(text)}'"
        )
    return x, y, z


Pair = tuple[str, str]

_TOLERANCE_M, _MOST_ITERATIONS = 1e-10, 1000
"""Of distances between polytopes, spheres (inflated points) and capsules (inflated lines), where
the algorithms GJK and EPA end exactly."""

_CURVED = (coal.Cylinder, coal.Cone, coal.Ellipsoid)
"""Shapes whose depth of overlap EPA only approximates."""

_CURVED_TOLERANCE_M, _MOST_CURVED_ITERATIONS = 1e-6, 255
"""Of pairs with a curved shape. At a tolerance of 1e-8 m, EPA is wrong by centimetres for one in a
hundred pairs of deeply overlapping cylinders. With 64 iterations it ends up to 2 mm too early, with
1000 it is no more accurate."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The pairs of convex bodies that may collide, on the joints of a robot; from `load_scene`.

    `pairs` names the two links, or the link and the box, of each of the P pairs checked; `ignored`
    names the pairs excluded because they are closer than `clearance_m` in 95 % of random postures.
    `clearance_m` is the minimum distance [m] of a planned motion.
    """

    robot: Robot
    geometry: pin.GeometryModel
    pairs: tuple[Pair, ...]
    ignored: tuple[Pair, ...]
    clearance_m: float

    @cached_property
    def objects_of_pairs(self) -> tuple[Array, Array]:
        """The first and second objects of the pairs, as indices (P,) into the geometry."""
        pairs = self.geometry.collisionPairs
        first, second = [pair.first for pair in pairs], [pair.second for pair in pairs]
        return np.array(first, dtype=int), np.array(second, dtype=int)

    @cached_property
    def moves(self) -> Array:
        """Whether a joint of `robot.model` moves an object, 1 or 0, (G objects, N joints)."""
        moved = np.zeros((self.geometry.ngeoms, self.robot.model.nv))
        for row, shape in zip(moved, self.geometry.geometryObjects, strict=True):
            # joint 0 of Pinocchio is the base; joint j has one degree of freedom, column j - 1
            joints = self.robot.model.supports[shape.parentJoint]
            row[[joint - 1 for joint in joints if joint]] = 1.0
        return moved


def distances(scene: Scene, q: Array, *, cap_m: float = np.inf) -> Array:
    """Return the signed distance (T, P) [m] of every pair at positions q (T, n) [rad or m].

    The distance of overlapping bodies is minus their penetration depth. Distances are capped at
    `cap_m`, which saves most of the time. Raises ExcitationError for positions of another shape or
    not finite.
    """
    return _witnesses(scene, q, cap_m).distances


def distance_gradients(scene: Scene, q: Array, *, cap_m: float = np.inf) -> tuple[Array, Array]:
    """Return the `distances` (T, P) and their exact gradient (T, P, n) by the joint positions.

    The gradient of a capped distance is zero. If the nearest points are not unique (parallel
    faces), it is that of one choice of them. The normal of a cylinder is accurate to 1e-5, to 1e-2
    in overlap. Raises as `distances` does.
    """
    distance, normals, points, jacobians = _witnesses(scene, q, cap_m)
    first, second = scene.objects_of_pairs
    # zero for a joint that moves both bodies or neither: it does not change their distance
    sign = scene.moves[second] - scene.moves[first]
    # d(distance)/dq = normal^T (J_second - J_first), Jacobians of the two nearest points, where
    # normal^T J(point) = normal^T J_linear + (point x normal)^T J_angular. The normal points from
    # the first body to the second. The nearest points differ by a multiple of it, so that
    # point x normal is the same for both.
    along = sign * (normals @ jacobians[:, :3] + np.cross(points, normals) @ jacobians[:, 3:])
    return distance, scene.robot.from_model(along)


class _Witnesses(NamedTuple):
    """The distances (T, P), and the normals and nearest points of the first bodies (T, P, 3).

    The last two are zero for a pair at the cap. The Jacobians (T, 6, N) are those of Pinocchio's
    model, at the origin of the base.
    """

    distances: Array
    normals: Array
    points: Array
    jacobians: Array


def _witnesses(scene: Scene, q: Array, cap_m: float) -> _Witnesses:
    """Return the nearest points of all pairs at positions q (T, n)."""
    q = scene.robot.to_model(finite("q", q, (None, scene.robot.n), ExcitationError))
    model, geometry = scene.robot.model, scene.geometry
    data, placed = model.createData(), geometry.createData()
    _set_accuracy(geometry, placed)
    first, second = scene.objects_of_pairs
    centres = np.array([shape.geometry.aabb_center for shape in geometry.geometryObjects])
    radii = np.array([shape.geometry.aabb_radius for shape in geometry.geometryObjects])
    # pairs whose bounding spheres are farther apart than the cap are not evaluated
    reach = np.maximum(radii[first] + radii[second] + cap_m, 0.0)
    distance = np.full((len(q), len(first)), cap_m)
    normals, points = np.zeros((2, len(q), len(first), 3))
    jacobians = np.empty((len(q), 6, model.nv))
    for k, position in enumerate(q):
        jacobians[k] = pin.computeJointJacobians(model, data, position)
        pin.updateGeometryPlacements(model, data, geometry, placed)
        spots = np.array([oMg.act(c) for oMg, c in zip(placed.oMg, centres, strict=True)])
        apart = spots[first] - spots[second]
        for pair in np.flatnonzero(np.einsum("pi,pi->p", apart, apart) < reach**2).tolist():
            result = pin.computeDistance(geometry, placed, pair)
            # not `< cap_m`, so that a distance that is NaN does not disappear behind the cap
            if not result.min_distance >= cap_m:
                distance[k, pair] = result.min_distance
                normals[k, pair] = result.normal
                points[k, pair] = result.getNearestPoint1()
    return _Witnesses(distance, normals, points, jacobians)


def _set_accuracy(geometry: pin.GeometryModel, placed: pin.GeometryData) -> None:
    curved = [isinstance(shape.geometry, _CURVED) for shape in geometry.geometryObjects]
    for pair, request in zip(geometry.collisionPairs, placed.distanceRequests, strict=True):
        either = curved[pair.first] or curved[pair.second]
        request.enable_signed_distance = True
        request.gjk_tolerance, request.gjk_max_iterations = _TOLERANCE_M, _MOST_ITERATIONS
        request.epa_tolerance = _CURVED_TOLERANCE_M if either else _TOLERANCE_M
        request.epa_max_iterations = _MOST_CURVED_ITERATIONS if either else _MOST_ITERATIONS
