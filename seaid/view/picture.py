"""Picture: a robot's visible parts as Pinocchio's geometry objects on the joints of its model.

A `Robot` comes in. The visual shapes of its URDF, its joints, lines and payloads, and inertias as
ellipsoids go out as one `pin.GeometryModel`, which `pinocchio.visualize.ViserVisualizer` draws
and moves.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite, frozen, safely
from seaid._progress import MOST_NAMES, counted
from seaid.errors import RobotError, listed
from seaid.robot import Robot, UrdfTree, inconsistency, reread_urdf
from seaid.robot.inertia import second_moments
from seaid.robot.urdf import find_mesh, search_folders

Color = tuple[int, int, int]


def color_of(hexadecimal: str) -> Color:
    """Return the colour of a CSS notation, '#1450b4'."""
    red, green, blue = bytes.fromhex(hexadecimal.removeprefix("#"))
    return red, green, blue


GREY = color_of("#a8aeb6")
"""Colour of shapes without one in their files."""

_SHARP_RAD = 0.6
"""Angle between faces of STL files above which shading keeps the edge."""

GROUPS = ("bodies", "lines", "joints", "payloads", "nominal", "identified")
"""The kinds of objects of a picture."""

LINES = color_of("#3c424a")
PAYLOAD = color_of("#963ca0")
NOMINAL = color_of("#464c56")
IDENTIFIED = color_of("#00966e")
WRONG = color_of("#d7191e")
"""Colours of nominal bodies (wire), identified ones (solid), and inconsistent ones (crosses)."""

NEUTRAL = color_of("#585e66")
"""Colour of joints without a spring or with an unknown deflection."""

_STEEL_KG_PER_M3 = 7850.0
"""Density of the sphere that represents a payload."""

_DRUM, _STIFF_DRUM, _LINE, _POINT = 0.03, 0.016, 0.004, 0.012
"""Radii of the cylinders of joints, of lines and of points, relative to the picture's size."""

_THIN = 0.1
"""Least semi-axis of an ellipsoid relative to the ball at its centre: thin bodies stay visible."""

Line = tuple[int, Array, Array]
"""A joint of Pinocchio's model, and the start and the end (3,) [m] of a line in its frame."""

Places = Mapping[str, tuple[int, pin.SE3]]
"""{link: the joint of Pinocchio's model that moves it, and the link's frame in the joint's}."""


@dataclass(frozen=True, eq=False)
class Picture:
    """The visible parts of a robot on the joints of `robot.model`, where joint 0 is the base.

    The objects of `geometry` are named GROUP/NUMBER. "bodies" are the visual shapes of the links;
    a mesh of `meshes` {name of the object} has its bounding box there. "joints" are drums about the
    axes, numbered as the robot's joints. "lines" lead between joints, along prismatic axes and to
    payloads. "nominal" and "identified" are ellipsoids of inertia, whose numbers are in the tuples.
    `size` [m] is the diagonal in the rest posture, `up` (3,) points against gravity, and `notes`
    list parts that could not be shown.
    """

    robot: Robot
    geometry: pin.GeometryModel
    meshes: Mapping[str, Any]
    nominal: tuple[Ellipsoid, ...]
    identified: tuple[Ellipsoid, ...]
    size: float
    up: Array
    notes: tuple[str, ...]

    def objects(self, *groups: str) -> list[pin.GeometryObject]:
        """Return the objects of these groups."""
        every = self.geometry.geometryObjects
        return [part for part in every if part.name.partition("/")[0] in groups]

    @property
    def bare_bodies(self) -> tuple[str, ...]:
        """The names of moving bodies without a shape."""
        shown = {part.parentJoint for part in self.objects("bodies")}
        bodies = zip(self.robot.body_names, joints_of_bodies(self.robot), strict=True)
        return tuple(name for name, joint in bodies if joint not in {*shown, 0})

    def outline(self, postures: Array) -> Array:
        """Return points (., 3) [m] that enclose bodies, lines and payloads in postures (P, n)."""
        return _outline(self.robot, self.objects("bodies", "lines", "payloads"), postures)


def rest_posture(robot: Robot) -> Array:
    """Return the posture (n,) within the limits that is nearest to zero."""
    return np.clip(np.zeros(robot.n), robot.lower_limits, robot.upper_limits)


def placements(robot: Robot, q: Array) -> list[pin.SE3]:
    """Return the placements of the joints of `robot.model` in the base frame at q (n,).

    Raises RobotError for positions [rad or m] of another shape or not finite.
    """
    data = robot.model.createData()
    q = finite("joint positions", q, (robot.n,), RobotError)
    pin.forwardKinematics(robot.model, data, robot.to_model(q))
    return [pin.SE3(placement) for placement in data.oMi]


def _outline(robot: Robot, parts: Sequence[pin.GeometryObject], postures: Array) -> Array:
    """Return the corners of the objects' boxes and the origins of all joints, (., 3) [m]."""
    corners = [_corners(part) for part in parts]
    points = []
    for q in postures:
        joints = placements(robot, q)
        points += [joint.translation[None] for joint in joints]
        for part, box in zip(parts, corners, strict=True):
            joint = joints[part.parentJoint]
            points.append(box @ joint.rotation.T + joint.translation)
    return np.concatenate(points)


def _corners(part: pin.GeometryObject) -> Array:
    """Return the corners (8, 3) of an object's bounding box in the frame of its joint."""
    part.geometry.computeLocalAABB()
    ends = [part.geometry.aabb_local.min_, part.geometry.aabb_local.max_]
    box = np.array(np.meshgrid(*np.transpose(ends))).reshape(3, -1).T
    return np.asarray(box @ part.placement.rotation.T + part.placement.translation)


def picture_of(
    robot: Robot,
    *,
    identified: Robot | None = None,
    package_dirs: str | Path | Sequence[str | Path] = (),
) -> Picture:
    """Return the picture of a robot from load_robot, with the visual shapes of its URDF.

    `identified` is the same robot with other inertial parameters. Meshes are searched in
    `package_dirs`, the folder of the file and those above it. Raises RobotError for a robot without
    its file and for missing folders.
    """
    tree = _tree_of(robot)
    places = link_places(tree, robot)
    assert robot.urdf is not None
    shapes, meshes, notes = shapes_of(robot.urdf, tree, places, package_dirs)
    lines = [*_lines(tree, robot, places), *_payload_lines(robot)]
    points = _outline(robot, [*shapes, *_rods("lines", lines, 0.0)], rest_posture(robot)[None])
    size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    bodies = {"nominal": ellipsoids_of(robot)}
    bodies["identified"] = () if identified is None else ellipsoids_of(identified)
    geometry = pin.GeometryModel()
    for part in (
        *shapes,
        *_rods("lines", lines, _LINE * size),
        *_drums(tree, robot, size),
        *_payloads(robot),
        *_ellipsoids("nominal", bodies["nominal"], NOMINAL, size),
        *_ellipsoids("identified", bodies["identified"], IDENTIFIED, size),
    ):
        geometry.addGeometryObject(part)
    gravity = robot.model.gravity.linear
    strength = float(np.linalg.norm(gravity))
    up = np.array([0.0, 0.0, 1.0]) if strength == 0.0 else -gravity / strength
    wrong = (note for which, found in bodies.items() for note in _inconsistent(which, found))
    return Picture(robot, geometry, meshes, **bodies, size=size, up=up, notes=(*notes, *wrong))


def _tree_of(robot: Robot) -> UrdfTree:
    if robot.urdf is None:
        raise RobotError(f"'{robot.name}' has no URDF to show: load it with load_robot")
    tree = reread_urdf(robot.urdf).locked_at(robot.locked)
    gone = [joint for joint in robot.all_joint_names if joint not in tree.joints]
    if gone:
        raise RobotError(
            f"'{robot.urdf}' has no joint {', '.join(gone)} any more: it has changed since "
            f"'{robot.name}' was loaded; load it again"
        )
    return tree


def link_places(tree: UrdfTree, robot: Robot) -> dict[str, tuple[int, pin.SE3]]:
    """Return the joint of the model that moves each link, and the link's frame in the joint's."""
    places = {tree.root: (0, pin.SE3.Identity())}
    waiting = [tree.root]
    while waiting:
        link = waiting.pop()
        parent, placement = places[link]
        for joint in tree.children(link):
            if joint.name in robot.all_joint_names:
                places[joint.child] = (robot.model.getJointId(joint.name), pin.SE3.Identity())
            else:
                places[joint.child] = (parent, placement * joint.placement)
            waiting.append(joint.child)
    return places


def _lines(tree: UrdfTree, robot: Robot, places: Places) -> Iterator[Line]:
    """Yield lines from each link to its child joints, and along the range of prismatic joints.

    A link without child joints has a line to its centre of mass.
    """
    for link, (parent, placement) in places.items():
        start, below = placement.translation, tree.children(link)
        for joint in below:
            frame = placement * joint.placement
            yield parent, start, frame.translation
            if joint.type == "prismatic" and joint.name in robot.all_joint_names:
                ends = np.array([joint.lower, joint.upper])
                if np.all(np.isfinite(ends)):
                    yield parent, frame.act(ends[0] * joint.axis), frame.act(ends[1] * joint.axis)
        mass, *moment = tree.links[link][:4]
        if not below and mass > 0:
            yield parent, start, placement.act(np.array(moment) / mass)


def _payload_masses(robot: Robot) -> Iterator[tuple[int, float, Array]]:
    """Yield the joint of each known payload, its mass [kg] and its centre (3,) [m]."""
    payloads = robot.payload_parameters.reshape(-1, 10)
    for joint, ten in zip(joints_of_bodies(robot), payloads, strict=True):
        if ten[0] > 0:
            yield joint, float(ten[0]), ten[1:4] / ten[0]


def _payload_lines(robot: Robot) -> Iterator[Line]:
    return ((joint, np.zeros(3), center) for joint, _, center in _payload_masses(robot))


def _payloads(robot: Robot) -> Iterator[pin.GeometryObject]:
    """Yield payloads as steel balls of their masses."""
    for number, (joint, mass, center) in enumerate(_payload_masses(robot)):
        ball = coal.Sphere(float(np.cbrt(3 * mass / (4 * np.pi * _STEEL_KG_PER_M3))))
        place = pin.SE3(np.eye(3), center)
        yield shape_object(f"payloads/{number}", joint, place, ball, PAYLOAD)


def _drums(tree: UrdfTree, robot: Robot, size: float) -> Iterator[pin.GeometryObject]:
    """Yield a cylinder about the axis of each joint, thicker for one with a spring."""
    for index, name in enumerate(robot.joint_names):
        radius = size * (_DRUM if name in robot.elastic_joints else _STIFF_DRUM)
        end = 3.0 * radius * tree.joints[name].axis
        line = robot.model.getJointId(name), -end, end
        yield _rod(f"joints/{index}", line, radius, NEUTRAL)


def _rods(group: str, lines: Sequence[Line], radius: float) -> list[pin.GeometryObject]:
    """Return lines as thin cylinders."""
    drawn = [line for line in lines if np.linalg.norm(line[2] - line[1]) > 0]
    return [_rod(f"{group}/{k}", line, radius, LINES) for k, line in enumerate(drawn)]


def _rod(name: str, line: Line, radius: float, color: Color) -> pin.GeometryObject:
    """Return a cylinder along a line."""
    joint, start, end = line
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - start)
    cylinder = coal.Cylinder(radius, float(np.linalg.norm(end - start)))
    return shape_object(name, joint, pin.SE3(turn.matrix(), (start + end) / 2), cylinder, color)


def _ellipsoids(
    which: str, bodies: Sequence[Ellipsoid], color: Color, size: float
) -> Iterator[pin.GeometryObject]:
    """Yield ellipsoids and balls at their centres of mass; crosses for inconsistent bodies."""
    radius = _POINT * size
    for number, body in enumerate(bodies):
        if body.problem is not None:
            for axis, end in enumerate(3.0 * radius * np.eye(3)):
                line = body.joint, body.center - end, body.center + end
                yield _rod(f"{which}/{number}_cross_{axis}", line, radius / 4, WRONG)
            continue
        shape = coal.Ellipsoid(*np.maximum(body.semi_axes, _THIN * radius).tolist())
        place = pin.SE3(body.rotation, body.center)
        yield shape_object(f"{which}/{number}", body.joint, place, shape, color)
        ball = coal.Sphere(radius)
        yield shape_object(f"{which}/{number}_center", body.joint, place, ball, color)


_REMEDY = {
    "nominal": "correct the inertial parameters of the URDF",
    "identified": "identify with feasible=True (--feasible)",
}


def _inconsistent(which: str, bodies: Sequence[Ellipsoid]) -> tuple[str, ...]:
    """Return a note on the physically inconsistent bodies, which have crosses in the scene."""
    wrong = [body for body in bodies if body.problem is not None]
    if not wrong:
        return ()
    names = listed([f"'{body.name}'" for body in wrong], MOST_NAMES)
    several = f"bodies {names} are" if len(wrong) > 1 else f"body {names} is"
    return (
        f"the {which} {several} physically inconsistent, marked by a cross: '{wrong[0].name}' has "
        f"{wrong[0].problem}; {_REMEDY[which]}",
    )


def shape_object(
    name: str, joint: int, placement: pin.SE3, shape: coal.CollisionGeometry, color: Color
) -> pin.GeometryObject:
    """Return an opaque object of one colour on a joint of Pinocchio's model."""
    placed = pin.GeometryObject(name, joint, placement, shape)
    # viser truncates 255 times a channel: half a step keeps what rounding does out of the colour.
    placed.meshColor = np.append((np.array(color) + 0.5) / 255.0, 1.0)
    return placed


def shapes_of(
    urdf: Path,
    tree: UrdfTree,
    places: Places,
    package_dirs: str | Path | Sequence[str | Path] = (),
) -> tuple[list[pin.GeometryObject], dict[str, Any], list[str]]:
    """Return the visual shapes of a valid URDF, and notes on missing or unreadable meshes.

    A mesh is a trimesh.Trimesh by the name of its object, which is its bounding box. `places` has
    the joint and the frame of every link. Meshes are searched in `package_dirs`, the folder of the
    file and those above it. Raises RobotError for a missing folder.
    """
    folders = search_folders(urdf, package_dirs)
    # Those with a colour last, so that they count where a material is named without one too.
    materials = sorted(tree.elements.materials, key=lambda material: material.color is not None)
    palette = {material.name: material for material in materials}
    objects: list[pin.GeometryObject] = []
    meshes: dict[str, Any] = {}
    missing: dict[str, list[str]] = {}
    for link in tree.elements.links:
        joint, placement = places[link.name]
        for visual in link.visuals:
            color = _material_color(visual.material, palette)
            place = placement if visual.origin is None else placement * pin.SE3(visual.origin)
            try:
                parts = list(_parts(visual.geometry, folders))
            except _NoMeshError as problem:
                missing.setdefault(problem.remedy, []).append(f"{problem} (link '{link.name}')")
                continue
            for shape, center, mesh, painted in parts:
                name, at = f"bodies/{len(objects)}", place * pin.SE3(np.eye(3), center)
                objects.append(shape_object(name, joint, at, shape, painted or color))
                if mesh is not None:
                    meshes[name] = mesh
    return objects, meshes, [_missing_text(*entry) for entry in missing.items()]


class _NoMeshError(Exception):
    """A mesh is missing or cannot be read."""

    def __init__(self, text: str, remedy: str) -> None:
        super().__init__(text)
        self.remedy = remedy


def _missing_text(remedy: str, problems: list[str]) -> str:
    """Return one note on the meshes with the same remedy."""
    others = len(dict.fromkeys(problems)) - 1
    more = f", and {counted(others, 'other')} likewise" if others else ""
    return f"{problems[0]}{more}: {remedy}"


def _not_found(name: str) -> _NoMeshError:
    scheme, _, rest = name.rpartition("://")
    option = "with --package-dir (package_dirs=)"
    if scheme == "package":
        package = rest.partition("/")[0]
        remedy = f"name the folder that contains the package '{package}' {option}"
        remedy += ", or set ROS_PACKAGE_PATH"
    elif scheme == "file":
        remedy = "put the file there, or correct the path in the URDF"
    else:
        remedy = f"put it in the folder of the URDF, or name the folder of its path {option}"
    return _NoMeshError(f"mesh '{name}' is not found", remedy)


_CONVERT = "replace it by an STL, OBJ, PLY, glTF or Collada file with triangles"


_Part = tuple[coal.CollisionGeometry, Array, Any, Color | None]
"""A shape, its centre (3,) [m], the mesh about that centre or None, and the colour of its file."""


def _parts(geometry: Any, folders: Sequence[Path]) -> Iterator[_Part]:
    """Yield the shapes of a geometry in the frame of its origin."""
    nowhere = np.zeros(3)
    if geometry.box is not None:
        yield coal.Box(*np.asarray(geometry.box.size, dtype=float)), nowhere, None, None
    elif geometry.sphere is not None:
        yield coal.Sphere(geometry.sphere.radius), nowhere, None, None
    elif geometry.cylinder is not None:
        cylinder = coal.Cylinder(geometry.cylinder.radius, geometry.cylinder.length)
        yield cylinder, nowhere, None, None
    elif geometry.mesh is not None:
        for mesh, painted in _loaded(geometry.mesh, folders):
            center = np.mean(mesh.bounds, axis=0)
            yield coal.Box(*mesh.extents), center, mesh.apply_translation(-center), painted


def _loaded(named: Any, folders: Sequence[Path]) -> Iterator[tuple[Any, Color | None]]:
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # a damaged file makes a note
    path = find_mesh(named.filename, folders)
    if path is None:
        raise _not_found(named.filename)
    try:
        meshes = trimesh.load_scene(path).dump()
        parts: list[Any] = [x for x in meshes if len(getattr(x, "faces", ()))]  # no points or lines
    except Exception as problem:  # readers of a dozen formats raise any exception
        reason = f"{type(problem).__name__}: {problem}"
        raise _NoMeshError(f"mesh '{path}' cannot be read, {reason}", _CONVERT) from None
    if not parts:
        raise _NoMeshError(f"mesh '{path}' has no triangles", _CONVERT)
    by_color: dict[Color | None, list[Any]] = {}
    for part in parts:
        by_color.setdefault(_painted(part.visual), []).append(part)
    for painted, several in by_color.items():
        mesh: Any = trimesh.util.concatenate(several)
        if path.suffix.lower() == ".stl":  # it has no normals, and its edges were merged
            mesh = trimesh.graph.smooth_shade(mesh, angle=_SHARP_RAD)
        yield mesh.apply_scale(1.0 if named.scale is None else named.scale), painted


def _painted(visual: Any) -> Color | None:
    """Return the main colour of a mesh, None if its file has none."""
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    color = visual.main_color if material is None else material.main_color
    return None if color is None else _color(color[:3])


def _material_color(material: Any, palette: Mapping[str, Any]) -> Color:
    """Return the colour of a material, or of that with its name in the palette of the robot."""
    named = palette.get(getattr(material, "name", ""))
    color = getattr(material, "color", None) or getattr(named, "color", None)
    if color is None:
        return GREY
    return _color(np.clip(np.asarray(color.rgba[:3], dtype=float), 0.0, 1.0) * 255)


def _color(values: Any) -> Color:
    red, green, blue = (round(float(value)) for value in values)
    return red, green, blue


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The solid ellipsoid of uniform density with the mass and the inertia of a body.

    In the frame of its `joint` of Pinocchio's model: `center` of mass (3,) [m], `semi_axes` (3,)
    [m], and their directions as columns of `rotation` (3, 3). With the pseudo-inertia
    [[S, h], [h^T, m]] the second moments about the centre of mass are S_c = S - h h^T / m, and
    those of a uniform solid ellipsoid are S_c = m/5 R diag(a^2) R^T. The semi-axes are therefore
    a_i = sqrt(5 lambda_i / m), where lambda_i are the eigenvalues of S_c; by principal moments,
    a_i^2 = 5/(2m) (I_j + I_k - I_i).

    A physically inconsistent body has no such ellipsoid: `problem` says why, and `semi_axes` are
    zero. Its `center` is the origin of the body if its mass is not positive.
    """

    joint: int
    name: str
    mass: float
    center: Array
    rotation: Array
    semi_axes: Array
    problem: str | None = None


def joints_of_bodies(robot: Robot) -> list[int]:
    """Return the joint of `robot.model` that moves each body of `body_names`."""
    joints = [robot.model.getJointId(name) for name in robot.all_joint_names]
    # A floating base is the last body and has no joint: it is the base of the picture.
    return [*joints, 0][: len(robot.body_names)]


def ellipsoids_of(robot: Robot) -> tuple[Ellipsoid, ...]:
    """Return the ellipsoids of the bodies with known parameters, without payloads."""
    bodies = (joints_of_bodies(robot), robot.body_names, robot.parameters.reshape(-1, 10))
    return tuple(
        _ellipsoid(joint, name, ten)
        for joint, name, ten in zip(*bodies, strict=True)
        if np.all(np.isfinite(ten)) and np.any(ten)
    )


def _ellipsoid(joint: int, name: str, parameters: Array) -> Ellipsoid:
    mass, problem = float(parameters[0]), inconsistency(parameters)
    center = parameters[1:4] / mass if mass > 0 else np.zeros(3)
    rotation, semi_axes = np.eye(3), np.zeros(3)
    if problem is None:
        what, second = f"the inertia of '{name}'", second_moments(parameters)
        moments, rotation = safely(np.linalg.eigh, second, what=what, error=RobotError)
        semi_axes = np.sqrt(5.0 * np.maximum(moments, 0.0) / mass)
        rotation[:, 2] = np.cross(rotation[:, 0], rotation[:, 1])  # no mirror image
    return Ellipsoid(
        joint,
        name,
        mass,
        frozen("center", center, (3,)),
        frozen("rotation", rotation, (3, 3)),
        frozen("semi_axes", semi_axes, (3,)),
        problem,
    )
