"""Stage and Figure: the shapes of a robot as meshes of a viser scene, on one frame per joint.

A viser server and a `Picture` come in. The scene then has the robot and a ghost of it, and poses of
the joints' frames move them: no mesh is sent again. Pinocchio's `ViserVisualizer` is not used: it
loads meshes by path, places each geometry instead of each joint in every posture, and has no
colours that change with the deflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, IndexArray
from seaid.robot import Robot
from seaid.view.picture import Color, Picture, Shape, placements

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
