"""Stage: a picture in a viser scene, drawn and moved by Pinocchio's visualizer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from pinocchio.visualize import ViserVisualizer

from seaid._arrays import Array
from seaid.view.picture import GROUPS, Color, Picture, color_of

GHOST = color_of("#f0821e")

_FIELD_OF_VIEW_RAD = 0.7

_PANEL_PX, _SMALL_PX = 345, 576
"""Width of viser's panel, and of the pages on which it covers the lower part instead."""

_WINDOW_PX = 900, 800
"""Size of the scene until a browser reports its own."""

_FEW_VERTICES = 100
"""Meshes with fewer vertices have flat faces; smooth shading would make balls of them."""


class Visualizer(ViserVisualizer):  # type: ignore[misc]
    """Pinocchio's visualizer, with ellipsoids and with meshes of one colour that can fade.

    ViserVisualizer itself refuses ellipsoids, draws a Collada file as a binary that has no opacity,
    which would hide drums and inertia inside the bodies, and rounds the edges of cylinders and of
    STL files.
    """

    def __init__(
        self, server: Any, root: str, model: pin.Model, geometry: pin.GeometryModel, **look: Any
    ) -> None:
        super().__init__(model, pin.GeometryModel(), geometry)
        self._meshes: Mapping[str, Any] = look.pop("meshes", {})
        self.initViewer(server)
        self.loadViewerModel(root, **look)

    def loadViewerGeometryObject(
        self, geometry_object: pin.GeometryObject, prefix: str = "", color: Any = None
    ) -> None:
        """Add an object to the scene."""
        name, shape = geometry_object.name, geometry_object.geometry
        scene, node = self.viewer.scene, f"{prefix}/{name}"
        rgb = tuple((color or geometry_object.meshColor)[:3])
        if name in self._meshes:
            vertices, faces = self._meshes[name].vertices, self._meshes[name].faces
            flat = len(vertices) < _FEW_VERTICES
            self.frames[node] = scene.add_mesh_simple(
                node, vertices, faces, color=rgb, flat_shading=flat, side="double"
            )
        elif isinstance(shape, coal.Ellipsoid):
            is_wire = name.startswith("nominal")
            self.frames[node] = scene.add_icosphere(
                node,
                1.0,
                rgb,
                scale=tuple(shape.radii),
                subdivisions=2 if is_wire else 4,
                wireframe=is_wire,
                opacity=0.35 if is_wire else 0.6,
                cast_shadow=False,
            )
        elif isinstance(shape, coal.Cylinder):
            height = 2.0 * shape.halfLength
            self.frames[node] = scene.add_cylinder(node, shape.radius, height, rgb)
        else:
            super().loadViewerGeometryObject(geometry_object, prefix, color)
            self.frames[node].opacity = None  # 1 would draw it after what shines through

    def group(self, name: str) -> list[Any]:
        """Return the nodes of a group of the picture, in its order."""
        start = f"{self.visualRootNodeName}/{name}/"
        return [node for key, node in self.frames.items() if key.startswith(start)]


class Stage:
    """The robot of a picture, and its skeleton in orange for a motion to compare with.

    `groups` {name: nodes} are those of the picture, and the "names" of its joints.
    """

    def __init__(self, server: Any, picture: Picture) -> None:
        model, skeleton = picture.robot.model, pin.GeometryModel()
        for line in picture.objects("lines"):
            skeleton.addGeometryObject(line)
        self.robot = Visualizer(server, "robot", model, picture.geometry, meshes=picture.meshes)
        orange = [(channel + 0.5) / 255 for channel in GHOST]
        self.ghost = Visualizer(server, "ghost", model, skeleton, visual_color=[*orange, 1.0])
        self.ghost.displayVisuals(False)
        self.groups = {kind: self.robot.group(kind) for kind in GROUPS}
        ends = [part.geometry.halfLength for part in picture.objects("joints")]
        joints = zip(self.groups["joints"], picture.robot.joint_names, ends, strict=True)
        # The end of its drum, where names of coincident joints do not overlap.
        self.groups["names"] = [
            _label(server, node, name, (0.0, 0.0, end), "bottom-left") for node, name, end in joints
        ]
        masses = picture.robot.payload_parameters[::10]
        for node, mass in zip(self.groups["payloads"], masses[masses > 0], strict=True):
            _label(server, node, f"{mass:.4g} kg", (0.0, 0.0, 0.0), "top-left")

    def paint(self, colors: Sequence[Color]) -> None:
        """Set the colours of the joints' drums; only changes are sent."""
        for joint, color in zip(self.groups["joints"], colors, strict=True):
            if tuple(joint.color) != color:
                joint.color = color

    def show(self, group: str, visible: bool) -> None:
        """Show or hide the nodes of a group."""
        for node in self.groups[group]:
            node.visible = visible

    def fade(self, opacity: float) -> None:
        """Set the opacity of the bodies: 1 is opaque, 0 hides them."""
        for node in self.groups["bodies"]:
            node.opacity = None if opacity >= 1.0 else opacity
            node.visible = opacity > 0.0


def _label(server: Any, node: Any, text: str, position: tuple[float, ...], anchor: str) -> Any:
    return server.scene.add_label(
        f"{node.name}/name",
        text,
        position=position,
        font_screen_scale=0.9,
        anchor=anchor,
        depth_test=False,
    )


def set_the_view(server: Any, picture: Picture, postures: Array) -> None:
    """Point the camera at the robot in postures (P, n), and put a grid below."""
    points, up = picture.outline(postures), picture.up
    middle, radius = sphere_around(points)
    server.scene.set_up_direction(tuple(up))
    aim(server.initial_camera, middle, radius, up, _WINDOW_PX)

    @server.on_client_connect  # type: ignore[untyped-decorator]
    def _(client: Any) -> None:
        window_px = client.camera.image_width, client.camera.image_height
        aim(client.camera, middle, radius, up, window_px)

    server.scene.configure_default_lights(cast_shadow=False)
    cell = 10.0 ** np.round(np.log10(radius / 2))
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), up)
    server.scene.add_grid(
        "/grid",
        infinite_grid=True,
        cell_size=cell,
        section_size=5 * cell,
        cell_color=(228, 231, 234),
        section_color=(205, 210, 215),
        fade_distance=12 * radius,
        position=tuple(middle + up * (np.min((points - middle) @ up) - 0.01 * radius)),
        wxyz=turn.coeffs()[[3, 0, 1, 2]],  # viser has the scalar first
    )


def sphere_around(points: Array) -> tuple[Array, float]:
    """Return the middle (3,) of points (., 3) and their largest distance from it."""
    middle = (np.min(points, axis=0) + np.max(points, axis=0)) / 2
    return middle, float(np.max(np.linalg.norm(points - middle, axis=1))) or 0.5


def aim(camera: Any, middle: Array, radius: float, up: Array, window_px: tuple[int, int]) -> None:
    """Place a camera so that a sphere fills the part of the window without the panel."""
    width, height = window_px
    small = width < _SMALL_PX
    # the free part, from -1 to 1 across and up the window
    left, right = (-0.8, 0.8) if small else (-0.9, max(1.0 - 2.0 * _PANEL_PX / width, 0.0))
    low, high = (0.3, 0.9) if small else (-0.85, 0.9)
    across = np.eye(3)[int(np.argmin(np.abs(up)))]
    front = across - (across @ up) * up
    front /= np.linalg.norm(front)
    back = 0.75 * front - 0.60 * np.cross(up, front) + 0.28 * up
    back /= np.linalg.norm(back)
    aside = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    rise = np.tan(_FIELD_OF_VIEW_RAD / 2)
    run = rise * width / height
    # A sphere at a distance d is seen within the tangent r / sqrt(d^2 - r^2) of its middle.
    tangent = min(run * (right - left), rise * (high - low)) / 2
    away = radius * float(np.sqrt(1.0 + 1.0 / tangent**2))
    # Camera and target move together, so that the middle is seen in the middle of the free part.
    above = np.cross(back, aside)
    shift = run * (left + right) / 2 * aside + rise * (low + high) / 2 * above
    target = middle - away * shift
    camera.position = tuple(target + away * back)
    camera.look_at = tuple(target)
    camera.fov = _FIELD_OF_VIEW_RAD
    camera.near, camera.far = away / 100, away * 50
