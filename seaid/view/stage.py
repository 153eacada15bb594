"""Stage: the robot as nodes of a viser scene, which are moved and coloured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array
from seaid.view.picture import NEUTRAL, Picture
from seaid.view.shapes import Color

if TYPE_CHECKING:
    from seaid.view.shapes import Ellipsoid

LINES: Color = (60, 66, 74)
GHOST: Color = (240, 130, 30)
PAYLOAD: Color = (150, 60, 160)
NOMINAL: Color = (70, 76, 86)
IDENTIFIED: Color = (0, 150, 110)
WRONG: Color = (215, 25, 30)
"""Colours of nominal bodies (wire), identified ones (solid), and inconsistent ones (crosses)."""

_STEEL_KG_PER_M3 = 7850.0
"""Density of the sphere that represents a payload."""

_DRUM, _STIFF_DRUM, _LINE, _POINT = 0.03, 0.016, 0.006, 0.012
"""Radii of the cylinders of joints, of lines and of points, relative to the picture's size."""

_THIN = 0.1
"""Least semi-axis of an ellipsoid relative to the ball at its centre: thin bodies stay visible."""

_FIELD_OF_VIEW_RAD = 0.7

_PANEL_PX, _SMALL_PX = 345, 576
"""Width of viser's panel, and of the pages on which it covers the lower part instead."""

_WINDOW_PX = 900, 800
"""Size of the scene until a browser reports its own."""


@dataclass(frozen=True, eq=False)
class Stage:
    """Handles of viser's nodes: `bodies` and `ghost` (n + 1) are frames, `joints` (n) the drums.

    `groups` has the nodes that are shown or hidden together, by kind.
    """

    bodies: tuple[Any, ...]
    ghost: tuple[Any, ...]
    joints: tuple[Any, ...]
    groups: dict[str, tuple[Any, ...]]


def put_on_stage(server: Any, picture: Picture) -> Stage:
    """Add a picture to a viser server; all nodes are children of the frames of bodies."""
    count = len(picture.robot.all_joint_names) + 1
    bodies = tuple(server.scene.add_frame(f"/robot/{k}", show_axes=False) for k in range(count))
    ghost = tuple(server.scene.add_frame(f"/ghost/{k}", show_axes=False) for k in range(count))
    joints = tuple(_drum(server, picture, index) for index in range(picture.robot.n))
    groups = {
        "bodies": _shapes(server, picture),
        "lines": _lines(server, picture, "/robot", LINES),
        "ghost": _lines(server, picture, "/ghost", GHOST),
        "joints": joints,
        "names": _names(server, picture),
        "payloads": _payloads(server, picture),
        "nominal": _ellipsoids(server, picture, "nominal", NOMINAL),
        "identified": _ellipsoids(server, picture, "identified", IDENTIFIED),
    }
    return Stage(bodies, ghost, joints, groups)


def place(frames: Sequence[Any], placements: Sequence[pin.SE3]) -> None:
    """Move the frames of bodies to their placements."""
    for frame, placement in zip(frames, placements, strict=True):
        frame.position = tuple(placement.translation)
        frame.wxyz = _wxyz(pin.Quaternion(placement.rotation))


def _wxyz(turn: pin.Quaternion) -> tuple[float, float, float, float]:
    """Return a rotation as viser has it: the scalar first, which Eigen has last."""
    x, y, z, w = turn.normalized().coeffs().tolist()
    return w, x, y, z


def paint(joints: Sequence[Any], colors: Sequence[Color]) -> None:
    """Set the colours of the drums of joints; only changes are sent."""
    for joint, color in zip(joints, colors, strict=True):
        if tuple(joint.color) != color:
            joint.color = color


def show(group: Sequence[Any], visible: bool) -> None:
    """Show or hide the nodes of a group."""
    for node in group:
        node.visible = visible


def fade(group: Sequence[Any], opacity: float) -> None:
    """Set the opacity of shapes: 1 is opaque, 0 hides them."""
    for node in group:
        node.opacity = None if opacity >= 1.0 else opacity
        node.visible = opacity > 0.0


def set_the_view(server: Any, picture: Picture, postures: Array) -> None:
    """Point the camera at the robot in postures (P, n), and put a grid below."""
    points, up = picture.outline(postures), picture.up
    middle = (np.min(points, axis=0) + np.max(points, axis=0)) / 2
    radius = float(np.max(np.linalg.norm(points - middle, axis=1))) or 0.5
    server.scene.set_up_direction(tuple(up))
    aim(server.initial_camera, points - middle, middle, up, _WINDOW_PX)

    @server.on_client_connect  # type: ignore[untyped-decorator]
    def _(client: Any) -> None:
        window_px = client.camera.image_width, client.camera.image_height
        aim(client.camera, points - middle, middle, up, window_px)

    server.scene.configure_default_lights(cast_shadow=False)
    cell = _round_length(radius / 2)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), up)
    floor = middle + up * (np.min((points - middle) @ up) - 0.01 * radius)
    server.scene.add_grid(
        "/grid",
        infinite_grid=True,
        cell_size=cell,
        section_size=5 * cell,
        cell_color=(228, 231, 234),
        section_color=(205, 210, 215),
        fade_distance=12 * radius,
        position=tuple(floor),
        wxyz=_wxyz(turn),
    )


def aim(camera: Any, points: Array, middle: Array, up: Array, window_px: tuple[int, int]) -> None:
    """Place a camera so that points (., 3) about the middle fill the part without the panel."""
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
    above = np.cross(back, aside)
    x, y, depth = points @ aside, points @ above, points @ back
    rise = np.tan(_FIELD_OF_VIEW_RAD / 2)
    run = rise * width / height
    # a point is seen at x / (run (away - depth)): all of them within half of the free part
    sizes = np.maximum(
        np.abs(x) / (run * (right - left) / 2), np.abs(y) / (rise * (high - low) / 2)
    )
    away = float(np.max(sizes + depth)) or 1.0
    # Camera and target move together, so that the middle is seen in the middle of the free part.
    shift = run * (left + right) / 2 * aside + rise * (low + high) / 2 * above
    target = middle - away * shift
    camera.position = tuple(target + away * back)
    camera.look_at = tuple(target)
    camera.fov = _FIELD_OF_VIEW_RAD
    camera.near, camera.far = away / 100, away * 50


def _round_length(length: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that does not exceed a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)))


def _shapes(server: Any, picture: Picture) -> tuple[Any, ...]:
    return tuple(
        server.scene.add_mesh_simple(
            f"/robot/{shape.body}/shape_{number}",
            shape.vertices,
            shape.faces,
            color=shape.color,
            flat_shading=len(shape.vertices) < 100,
            side="double",
        )
        for number, shape in enumerate(picture.shapes)
    )


def _lines(server: Any, picture: Picture, root: str, color: Color) -> tuple[Any, ...]:
    bodies = np.array(picture.segment_bodies, dtype=int)
    return tuple(
        server.scene.add_line_segments(
            f"{root}/{body}/lines",
            picture.segments[bodies == body],
            color,
            thickness=_LINE * picture.size,
        )
        for body in np.unique(bodies)
    )


def _drum(server: Any, picture: Picture, index: int) -> Any:
    """Add a cylinder about the axis of a joint."""
    radius, half_length = _drum_size(picture, index)
    # The cylinder of viser stands along z.
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), picture.axes[index])
    return server.scene.add_cylinder(
        f"/robot/{index + 1}/joint",
        radius,
        2.0 * half_length,
        NEUTRAL,
        radial_segments=40,
        wxyz=_wxyz(turn),
    )


def _drum_size(picture: Picture, index: int) -> tuple[float, float]:
    """Return radius and half length of a joint's drum, which extends beyond its body."""
    elastic = picture.robot.joint_names[index] in picture.robot.elastic_joints
    radius = (_DRUM if elastic else _STIFF_DRUM) * picture.size
    axis, half_length = picture.axes[index], 2.0 * radius
    for shape in picture.shapes:
        if shape.body == index + 1:
            along = shape.vertices @ axis
            distance = np.linalg.norm(shape.vertices - along[:, None] * axis, axis=1)
            # Only vertices near the axis hide the drum; those of the link's far end do not.
            near = np.abs(along[distance < 3.0 * radius])
            half_length = max(half_length, float(np.max(near, initial=0.0)) + 0.3 * radius)
    return radius, min(half_length, 4.0 * radius)


def _names(server: Any, picture: Picture) -> tuple[Any, ...]:
    """Add the names at the ends of the drums, where those of coincident joints do not overlap."""
    few = picture.robot.n <= 12
    return tuple(
        server.scene.add_label(
            f"/robot/{index + 1}/name",
            name,
            position=tuple(_drum_size(picture, index)[1] * picture.axes[index]),
            font_screen_scale=0.9,
            anchor="bottom-left",
            visible=few,
        )
        for index, name in enumerate(picture.robot.joint_names)
    )


def _payloads(server: Any, picture: Picture) -> tuple[Any, ...]:
    nodes = []
    for mark in picture.payloads:
        radius = float(np.cbrt(3 * mark.mass / (4 * np.pi * _STEEL_KG_PER_M3)))
        nodes += [
            server.scene.add_icosphere(
                f"/robot/{mark.body}/payload", radius, PAYLOAD, position=tuple(mark.center)
            ),
            server.scene.add_label(
                f"/robot/{mark.body}/payload_name",
                f"{mark.mass:.4g} kg",
                position=tuple(mark.center),
                font_screen_scale=0.9,
                anchor="top-left",
            ),
        ]
    return tuple(nodes)


def _ellipsoids(server: Any, picture: Picture, which: str, color: Color) -> tuple[Any, ...]:
    """Add the ellipsoids of bodies with their centres of mass, crosses for inconsistent bodies."""
    nodes, radius = [], _POINT * picture.size
    bodies: tuple[Ellipsoid, ...] = getattr(picture, which)
    for e in bodies:
        name = f"/robot/{e.body}/{which}"
        if e.problem is not None:
            ends = 3.0 * radius * np.array([np.diag([1, 1, 1]), -np.diag([1, 1, 1])])
            lines = np.swapaxes(e.center + ends, 0, 1)
            nodes.append(server.scene.add_line_segments(name, lines, WRONG, thickness=radius / 2))
            continue
        nodes += [
            server.scene.add_icosphere(
                name,
                1.0,
                color,
                scale=tuple(np.maximum(e.semi_axes, _THIN * radius)),
                subdivisions=2 if which == "nominal" else 4,
                wireframe=which == "nominal",
                opacity=0.35 if which == "nominal" else 0.6,
                wxyz=_wxyz(pin.Quaternion(e.rotation)),
                position=tuple(e.center),
                cast_shadow=False,
            ),
            server.scene.add_icosphere(f"{name}_center", radius, color, position=tuple(e.center)),
        ]
    return tuple(nodes)
