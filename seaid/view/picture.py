"""Picture: what is visible of a robot, and the Stage on which a viser server shows and moves it.

A `Robot` comes in. The visual shapes of its URDF, its joints, lines between them, and inertias as
ellipsoids are groups of `Shape`s in the frames of its joints. yourdfpy and trimesh read the visual
shapes; what cannot be shown is a note with a remedy, not an error. A `Stage` has the robot and a
ghost of it, and poses of the joints' frames move them: no mesh is sent again.

Pinocchio's `ViserVisualizer` is not used: it loads meshes by path, places each geometry instead of
each joint in every posture, and has no colours that change with the deflection.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, IndexArray, safely
from seaid._progress import counted
from seaid.errors import RobotError, reason_of
from seaid.robot import Robot, UrdfTree, inconsistency, reread_urdf
from seaid.robot.inertia import second_moments
from seaid.robot.urdf import find_mesh, search_folders

Color = tuple[int, ...]
"""Red, green and blue, each of 0 to 255."""

GREY: Color = tuple(bytes.fromhex("a8aeb6"))
"""Colour of shapes without one in their files."""

LINES: Color = tuple(bytes.fromhex("3c424a"))
NOMINAL: Color = tuple(bytes.fromhex("464c56"))
IDENTIFIED: Color = tuple(bytes.fromhex("00966e"))
NEUTRAL: Color = tuple(bytes.fromhex("585e66"))
"""Colour of joints without a spring or with an unknown deflection."""

_DRUM, _STIFF_DRUM, _LINE, _THIN = 0.03, 0.016, 0.004, 1e-3
"""Radii of the drums of joints and of lines, and least semi-axis of an ellipsoid, so that thin
bodies stay visible; relative to the picture's size."""

GHOST: Color = tuple(bytes.fromhex("f0821e"))

_LOOKS: dict[str, dict[str, Any]] = {
    "nominal": {"wireframe": True, "opacity": 0.35},
    "identified": {"opacity": 0.6},
}
"""Options of the meshes of a group, which is opaque in its own colours without them."""

_FEW_VERTICES = 140
"""Meshes with fewer vertices have flat faces; smooth shading would make balls of them."""

_FIELD_OF_VIEW_RAD = 0.7
"""Vertical angle of the camera's view [rad]."""

_PANEL_PX, _SMALL_PX = 345, 576
"""Width of viser's panel, and of the pages on which it covers the lower part instead."""

_TILT_RAD, _TURN_RAD = 1.29, 0.9
"""Angles of the camera from above, and about the vertical."""

Places = Mapping[str, tuple[int, pin.SE3]]
"""{link: the joint of Pinocchio's model that moves it, and the link's frame in the joint's}."""

Points = tuple[int, Array]
"""A joint of Pinocchio's model and points (., 3) [m] in its frame."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A trimesh.Trimesh in the frame of a joint of Pinocchio's model, and its colour."""

    joint: int
    mesh: Any
    color: Color


@dataclass(frozen=True, eq=False)
class Picture:
    """The visible parts of a robot on the joints of `robot.model`, where joint 0 is the base.

    `groups` are the "bodies", the visual elements of the URDF; "lines" from links to those below
    them or to their centre of mass; "joints", drums about the axes of the robot's joints; and the
    ellipsoids of inertia "nominal" and "identified". `enclosed` has the corners of bodies and
    lines, `up` (3,) points against gravity, and `notes` list parts that could not be shown.
    """

    robot: Robot
    groups: Mapping[str, Sequence[Shape]]
    enclosed: Sequence[Points]
    up: Array
    notes: tuple[str, ...]

    def outline(self, postures: Array) -> Array:
        """Return points (., 3) [m] that enclose bodies and lines in postures (P, n)."""
        return _outline(self.robot, self.enclosed, postures)


def rest_posture(robot: Robot) -> Array:
    """Return the posture (n,) within the limits that is nearest to zero."""
    return np.clip(np.zeros(robot.n), robot.lower_limits, robot.upper_limits)


def placements(robot: Robot, q: Array) -> list[pin.SE3]:
    """Return the placements of the joints of `robot.model` in the base frame at q (n,)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.to_model(q))
    return [pin.SE3(placement) for placement in data.oMi]


def _outline(robot: Robot, enclosed: Sequence[Points], postures: Array) -> Array:
    points = []
    for q in postures:
        joints = placements(robot, q)
        points += [joint.translation[None] for joint in joints]
        for joint, inside in enclosed:
            points.append(inside @ joints[joint].rotation.T + joints[joint].translation)
    return np.concatenate(points)


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
    bodies, notes = shapes_of(tree, places, package_dirs)
    lines = list(_lines(tree, places))
    enclosed = [*lines, *((shape.joint, shape.mesh.bounding_box.vertices) for shape in bodies)]
    outline = _outline(robot, enclosed, rest_posture(robot)[None])
    size = float(np.linalg.norm(np.ptp(outline, axis=0))) or 1.0
    thin = _THIN * size
    groups = {
        "bodies": bodies,
        "lines": [_rod(joint, ends, _LINE * size, LINES) for joint, ends in lines],
        "joints": list(_drums(tree, robot, size)),
        "nominal": ellipsoids_of(robot, NOMINAL, thin),
        "identified": [] if identified is None else ellipsoids_of(identified, IDENTIFIED, thin),
    }
    gravity = robot.model.gravity.linear
    strength = float(np.linalg.norm(gravity))
    up = np.array([0.0, 0.0, 1.0]) if strength == 0.0 else -gravity / strength
    return Picture(robot, groups, enclosed, up, tuple(notes))


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


def shapes_of(
    tree: UrdfTree, places: Places, package_dirs: str | Path | Sequence[str | Path] = ()
) -> tuple[list[Shape], list[str]]:
    """Return the visual shapes of a URDF, and notes on missing or unreadable meshes.

    Meshes are searched in `package_dirs`, the folder of the file and those above it. Raises
    RobotError for a missing folder.
    """
    folders = search_folders(tree.path, package_dirs)
    shapes: list[Shape] = []
    missing: dict[str, list[str]] = {}
    for link in tree.elements.links:
        joint, place = places[link.name]
        for visual in link.visuals:
            try:
                meshes = _meshes(visual, tree.elements.materials, folders)
            except RobotError as problem:
                texts = missing.setdefault(problem.advice, [])
                texts.append(f"{problem.reason} (link '{link.name}')")
                continue
            for mesh in meshes:
                mesh.apply_transform(place.homogeneous)
                shapes.append(Shape(joint, mesh, _color(mesh)))
    return shapes, [_missing_text(*entry) for entry in missing.items()]


def _missing_text(remedy: str, problems: list[str]) -> str:
    """Return one note on the meshes with the same remedy."""
    more = len(dict.fromkeys(problems)) - 1
    likewise = f", and {counted(more, 'other')} likewise" if more else ""
    return f"{problems[0]}{likewise}: {remedy}"


_FIND = (
    "name the folder that contains its package or path with --package-dir (package_dirs=), or "
    "correct it in the URDF"
)
_CONVERT = "replace it by an STL, OBJ, PLY, glTF or Collada file with triangles"


def _meshes(visual: Any, materials: Sequence[Any], folders: Sequence[Path]) -> list[Any]:
    """Return the meshes of a visual element in the frame of its link.

    Raises RobotError, with the remedy as its advice, for an element that cannot be shown.
    """
    from yourdfpy import urdf

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # a damaged file makes a note
    element = getattr(visual.geometry, "mesh", None)
    what = "a shape" if element is None else f"mesh '{element.filename}'"
    path = None if element is None else find_mesh(element.filename, folders)
    if element is not None and path is None:
        raise RobotError(f"{what} is not found", advice=_FIND)
    link = urdf.Link(name="link", visuals=[visual])
    alone = urdf.Robot(name="robot", links=[link], materials=materials)
    try:
        parts = urdf.URDF(alone, filename_handler=lambda fname: str(path)).scene.dump()
    except Exception as problem:  # readers of a dozen formats raise any exception
        reason = f"{what} cannot be read, {reason_of(problem)}"
        raise RobotError(reason, advice=_CONVERT) from None
    # Points and lines have no faces.
    if not (meshes := [part for part in parts if len(getattr(part, "faces", ()))]):
        raise RobotError(f"{what} has no triangles", advice=_CONVERT)
    return meshes


def _color(mesh: Any) -> Color:
    """Return the main colour of a mesh."""
    material = getattr(mesh.visual, "material", mesh.visual)
    color = getattr(material, "main_color", None) if mesh.visual.defined else None
    return GREY if color is None else tuple(color[:3].tolist())


def _lines(tree: UrdfTree, places: Places) -> Iterator[Points]:
    """Yield lines from each link to its child joints, from the last ones to the centre of mass."""
    for link, (joint, place) in places.items():
        mass, *moment = tree.links[link][:4]
        ends = [child.placement.translation for child in tree.children(link)]
        if not ends and mass > 0:
            ends = [np.array(moment) / mass]
        for end in ends:
            if np.any(end):
                yield joint, np.array([place.translation, place.act(end)])


def _rod(joint: int, ends: Array, radius: float, color: Color) -> Shape:
    """Return a cylinder between two points."""
    from trimesh import creation

    return Shape(joint, creation.cylinder(radius, sections=64, segment=ends), color)


def _drums(tree: UrdfTree, robot: Robot, size: float) -> Iterator[Shape]:
    """Yield a cylinder about the axis of each joint, thicker for one with a spring."""
    for name in robot.joint_names:
        radius = size * (_DRUM if name in robot.elastic_joints else _STIFF_DRUM)
        end = 3.0 * radius * tree.joints[name].axis
        yield _rod(robot.model.getJointId(name), np.array([-end, end]), radius, NEUTRAL)


def ellipsoids_of(robot: Robot, color: Color, thinnest: float = 0.0) -> list[Shape]:
    """Return the ellipsoids of the bodies with known and physically consistent parameters.

    Each is the solid ellipsoid of uniform density with the mass and the inertia of its body, with
    semi-axes of at least `thinnest` [m]. With the pseudo-inertia [[S, h], [h^T, m]] the second
    moments about the centre of mass are S_c = S - h h^T / m, and those of a uniform solid ellipsoid
    are S_c = m/5 R diag(a^2) R^T. The semi-axes are therefore a_i = sqrt(5 lambda_i / m), where
    lambda_i are the eigenvalues of S_c; by principal moments, a_i^2 = 5/(2m) (I_j + I_k - I_i).
    """
    from trimesh import creation

    joints = [robot.model.getJointId(name) for name in robot.all_joint_names]
    # A floating base is the last body and has no joint: it is the base of the picture.
    bodies = zip([*joints, 0], robot.parameters.reshape(-1, 10), strict=False)
    shapes = []
    for joint, parameters in bodies:
        known = np.all(np.isfinite(parameters)) and parameters[0] != 0
        if not known or inconsistency(parameters) is not None:
            continue
        second = second_moments(parameters)
        moments, directions = safely(np.linalg.eigh, second, what="an inertia", error=RobotError)
        semi_axes = np.sqrt(5.0 * np.maximum(moments, 0.0) / parameters[0])
        placed = np.eye(4)
        placed[:3, :3] = directions * np.maximum(semi_axes, thinnest)
        placed[:3, 3] = parameters[1:4] / parameters[0]
        shapes.append(Shape(joint, creation.icosphere(2).apply_transform(placed), color))
    return shapes


class Figure:
    """A robot in a viser scene: a frame `root`, and in it a frame for each joint of its model."""

    def __init__(self, server: Any, name: str, robot: Robot) -> None:
        self.robot, self.scene = robot, server.scene
        self.root = self.scene.add_frame(f"/{name}", show_axes=False)
        names = [f"/{name}/{joint}" for joint in range(robot.model.njoints)]
        self.joints = [self.scene.add_frame(x, show_axes=False) for x in names]

    def add(self, group: str, shapes: Sequence[Shape], **looks: Any) -> list[Any]:
        """Add shapes to the frames of their joints, with options, and return their nodes."""
        return [
            self.scene.add_mesh_simple(
                f"{self.joints[shape.joint].name}/{group}/{number}",
                shape.mesh.vertices,
                shape.mesh.faces,
                flat_shading=len(shape.mesh.vertices) < _FEW_VERTICES,
                **{"color": shape.color, "side": "double", "cast_shadow": False, **looks},
            )
            for number, shape in enumerate(shapes)
        ]

    def move(self, q: Array) -> None:
        """Show the robot at q (n,)."""
        for joint, placement in zip(self.joints, placements(self.robot, q), strict=True):
            joint.position, joint.wxyz = placement.translation, _wxyz(placement.rotation)


class Stage:
    """The robot of a picture, and a ghost in orange for a motion to compare with.

    `groups` {name: nodes} has a group of nodes for each group of the picture's shapes, and the
    labels "names" of its joints. The group "joints" has one drum per joint, in their order.
    """

    def __init__(self, server: Any, picture: Picture) -> None:
        self.robot = Figure(server, "robot", picture.robot)
        self.ghost = Figure(server, "ghost", picture.robot)
        skeleton = picture.groups["lines"]
        self.ghost.add("ghost", picture.groups["bodies"] or skeleton, color=GHOST, opacity=0.5)
        self.ghost.root.visible = False
        # Springs and inertia shine through the bodies.
        has_inside = picture.robot.elastic_joints or picture.groups["identified"]
        looks = {**_LOOKS, "bodies": {"opacity": 0.35 if has_inside else None}}
        self.groups = {
            name: self.robot.add(name, shapes, **looks.get(name, {}))
            for name, shapes in picture.groups.items()
        }
        self.groups["names"] = []
        for drum, name in zip(picture.groups["joints"], picture.robot.joint_names, strict=True):
            node, end = f"{self.robot.joints[drum.joint].name}/name", tuple(drum.mesh.vertices[-1])
            # At the end of its drum, where names of coincident joints do not overlap.
            self.groups["names"].append(server.scene.add_label(node, name, position=end))

    def paint(self, colors: IndexArray) -> None:
        """Set the colours (n, 3) of the joints' drums; only changes are sent."""
        for drum, color in zip(self.groups["joints"], colors.tolist(), strict=True):
            drum.color = tuple(color)

    def show(self, group: str, visible: bool) -> None:
        """Show or hide the nodes of a group."""
        for node in self.groups[group]:
            node.visible = visible


def _wxyz(rotation: Array) -> Array:
    """Return the quaternion of a rotation as viser has it, with the scalar first."""
    return np.asarray(pin.Quaternion(rotation).coeffs()[[3, 0, 1, 2]])


def upright(up: Array) -> Array:
    """Return the rotation (3, 3) from z to the direction up."""
    return np.asarray(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), up).matrix())


def set_the_view(server: Any, picture: Picture, postures: Array) -> None:
    """Point the camera at the robot in postures (P, n), and put a grid below."""
    points, up = picture.outline(postures), picture.up
    middle, radius = sphere_around(points)
    server.scene.set_up_direction(tuple(up))

    @server.on_client_connect  # type: ignore[untyped-decorator]
    def _(client: Any) -> None:
        window_px = client.camera.image_width, client.camera.image_height
        aim(client.camera, middle, radius, up, window_px)

    server.scene.configure_default_lights(cast_shadow=False)
    cell = 10.0 ** np.round(np.log10(radius / 2))
    lowest = np.min((points - middle) @ up) - 0.01 * radius
    server.scene.add_grid(
        "/grid",
        infinite_grid=True,
        cell_size=cell,
        section_size=5 * cell,
        fade_distance=12 * radius,
        position=tuple(middle + lowest * up),
        wxyz=_wxyz(upright(up)),
    )


def sphere_around(points: Array) -> tuple[Array, float]:
    """Return the middle (3,) of points (., 3) and their largest distance from it."""
    middle = (np.min(points, axis=0) + np.max(points, axis=0)) / 2
    return middle, float(np.max(np.linalg.norm(points - middle, axis=1))) or 0.5


def aim(camera: Any, middle: Array, radius: float, up: Array, window_px: tuple[int, int]) -> None:
    """Place a camera so that a sphere fills the part of the window without the panel."""
    width, height = window_px
    small = width < _SMALL_PX
    # The free part, from -1 to 1 across and up the window.
    left, right = (-0.8, 0.8) if small else (-0.9, max(1.0 - 2.0 * _PANEL_PX / width, 0.0))
    low, high = (0.3, 0.9) if small else (-0.85, 0.9)
    # The axes of the camera, which looks along -z from above before it is tilted and turned.
    aside, above, back = (upright(up) @ pin.rpy.rpyToMatrix(_TILT_RAD, 0.0, _TURN_RAD)).T
    rise = np.tan(_FIELD_OF_VIEW_RAD / 2)
    run = rise * width / height
    # A sphere at a distance d is seen within the tangent r / sqrt(d^2 - r^2) of its middle.
    tangent = min(run * (right - left), rise * (high - low)) / 2
    away = radius * float(np.sqrt(1.0 + 1.0 / tangent**2))
    # Camera and target move together, so that the middle is seen in the middle of the free part.
    shift = run * (left + right) / 2 * aside + rise * (low + high) / 2 * above
    target = middle - away * shift
    camera.position, camera.look_at = tuple(target + away * back), tuple(target)
    camera.fov = _FIELD_OF_VIEW_RAD
