"""Picture: the visible parts of a robot, the placements of its bodies, and colours of deflections.

The colour scale is symmetric about zero and safe for colour-blind users.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite, frozen
from seaid._progress import MOST_NAMES
from seaid.errors import RobotError, listed
from seaid.robot import Robot, UrdfTree, reread_urdf
from seaid.view.shapes import Color, Ellipsoid, Shape, ellipsoids_of, shapes_of


@dataclass(frozen=True, eq=False)
class Mark:
    """A mass at a point of a body: `center` (3,) [m] in the body's frame, `mass` [kg]."""

    name: str
    body: int
    center: Array
    mass: float


@dataclass(frozen=True, eq=False)
class Picture:
    """The visible parts of a robot with n joints, on n + 1 bodies.

    Body 0 is the base, body i + 1 that of joint i, in the frame of Pinocchio's joint. `segments`
    (S, 2, 3) [m] are lines between joints, along prismatic axes and to payloads, on the bodies
    `segment_bodies` (S,);
    `axes` (n, 3) are the joints' axes in their bodies' frames. `up` (3,) points against gravity.
    `payloads` are marks; `nominal` and `identified` bodies (empty without an identified robot) are
    ellipsoids. `notes` list parts that could not be shown.
    """

    robot: Robot
    shapes: tuple[Shape, ...]
    segments: Array
    segment_bodies: tuple[int, ...]
    axes: Array
    payloads: tuple[Mark, ...]
    nominal: tuple[Ellipsoid, ...]
    identified: tuple[Ellipsoid, ...]
    up: Array
    notes: tuple[str, ...]

    @property
    def bare_bodies(self) -> tuple[str, ...]:
        """The names of moving bodies without a shape."""
        shown = {shape.body for shape in self.shapes}
        names = enumerate(self.robot.body_names[: len(self.robot.all_joint_names)], 1)
        return tuple(name for body, name in names if body not in shown)

    @cached_property
    def size(self) -> float:
        """The diagonal [m] of the visible parts in the rest posture."""
        points = self.outline(self.rest_posture[None])
        return float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0

    @property
    def rest_posture(self) -> Array:
        """The posture (n,) within the limits that is nearest to zero."""
        lower, upper = self.robot.lower_limits, self.robot.upper_limits
        return np.clip(np.zeros(self.robot.n), lower, upper)

    def placements(self, q: Array) -> list[pin.SE3]:
        """Return the placements of the base and the N bodies in the base frame at positions q (n,).

        Raises RobotError for positions [rad or m] of another shape or not finite.
        """
        robot, model = self.robot, self.robot.model
        q = finite("joint positions", q, (robot.n,), RobotError)
        data = model.createData()
        pin.forwardKinematics(model, data, robot.to_model(q))
        # Joint 0 of the model is the base. Each placement is copied, since it belongs to the data.
        places = [0, *(1 + np.argsort(robot.model_order))]
        return [pin.SE3(data.oMi[int(place)]) for place in places]

    def outline(self, postures: Array) -> Array:
        """Return points (., 3) [m] that enclose the visible parts in postures (P, n)."""
        return np.concatenate(
            [
                points @ placement.rotation.T + placement.translation
                for q in postures
                for placement, points in zip(self.placements(q), self._outlines, strict=True)
            ]
        )

    @cached_property
    def _outlines(self) -> list[Array]:
        """Points of each body, (., 3): corners of its shapes' boxes, ends of its lines, marks."""
        outlines: list[list[Array]] = [
            [np.zeros((1, 3))] for _ in range(len(self.robot.all_joint_names) + 1)
        ]
        for shape in self.shapes:
            ends = np.array([shape.vertices.min(axis=0), shape.vertices.max(axis=0)])
            # (2, 3) ends -> (8, 3) corners of the box
            grid = np.array(np.meshgrid(*ends.T)).reshape(3, -1).T
            outlines[shape.body].append(grid)
        for body, segment in zip(self.segment_bodies, self.segments, strict=True):
            outlines[body].append(segment)
        for mark in self.payloads:
            outlines[mark.body].append(mark.center[None])
        return [np.concatenate(points) for points in outlines]


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
    shapes, notes = shapes_of(robot.urdf, tree, places, package_dirs)
    payloads = _payloads(robot)
    segments, bodies = _segments(tree, robot, places, payloads)
    gravity = robot.model.gravity.linear
    strength = float(np.linalg.norm(gravity))
    nominal = ellipsoids_of(robot)
    fitted = () if identified is None else ellipsoids_of(identified)
    up = np.array([0.0, 0.0, 1.0]) if strength == 0.0 else -gravity / strength
    return Picture(
        robot=robot,
        shapes=shapes,
        segments=frozen("segments", segments, (None, 2, 3)),
        segment_bodies=bodies,
        axes=_axes(robot),
        payloads=payloads,
        nominal=nominal,
        identified=fitted,
        up=frozen("up", up, (3,)),
        notes=(*notes, *_inconsistent("nominal", nominal), *_inconsistent("identified", fitted)),
    )


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
    """Return the body of each link, and the link's frame on it."""
    places = {tree.root: (0, pin.SE3.Identity())}
    waiting = [tree.root]
    while waiting:
        link = waiting.pop()
        body, placement = places[link]
        for joint in tree.children(link):
            if joint.name in robot.all_joint_names:
                index = robot.all_joint_names.index(joint.name)
                places[joint.child] = (index + 1, pin.SE3.Identity())
            else:
                places[joint.child] = (body, placement * joint.placement)
            waiting.append(joint.child)
    return places


def _axes(robot: Robot) -> Array:
    """Return the axes (N, 3) of the model's joints in their own frames."""
    model, data = robot.model, robot.model.createData()
    jacobian = pin.computeJointJacobians(model, data, np.zeros(model.nv)).reshape(6, model.nv)
    axes = np.empty((model.nv, 3))
    for joint, index in enumerate(robot.model_order, 1):
        # The axes of a Jacobian are in the frame of the base. Each joint has one velocity, so that
        # joint i has column i - 1.
        rows = slice(0, 3) if robot.all_prismatic[index] else slice(3, 6)
        axes[index] = data.oMi[joint].rotation.T @ jacobian[rows, joint - 1]
    return frozen("axes", axes, (None, 3))


def _segments(
    tree: UrdfTree, robot: Robot, places: dict[str, tuple[int, pin.SE3]], payloads: Sequence[Mark]
) -> tuple[Array, tuple[int, ...]]:
    """Return the line segments and their bodies.

    They lead from each link's frame to its child joints, or without any to its centre of mass,
    along the range of prismatic joints, and to payloads.
    """
    lines = [(mark.body, np.zeros(3), mark.center) for mark in payloads]
    lines += _lines(tree, robot, places)
    lines = [(body, start, end) for body, start, end in lines if np.linalg.norm(end - start) > 0]
    segments = np.array([ends for _, *ends in lines]).reshape(-1, 2, 3)
    return segments, tuple(body for body, _, _ in lines)


def _lines(
    tree: UrdfTree, robot: Robot, places: dict[str, tuple[int, pin.SE3]]
) -> Iterator[tuple[int, Array, Array]]:
    """Yield the lines (body, start, end) of all links and prismatic joints."""
    for link, (body, placement) in places.items():
        start, below = placement.translation, tree.children(link)
        for joint in below:
            frame = placement * joint.placement
            yield body, start, frame.translation
            if joint.type == "prismatic" and joint.name in robot.all_joint_names:
                ends = np.array([joint.lower, joint.upper])
                if np.all(np.isfinite(ends)):
                    yield body, frame.act(ends[0] * joint.axis), frame.act(ends[1] * joint.axis)
        mass, *moment = tree.links[link][:4]
        if not below and mass > 0:
            yield body, start, placement.act(np.array(moment) / mass)


def _payloads(robot: Robot) -> tuple[Mark, ...]:
    """Return the known masses on the bodies."""
    return tuple(
        Mark(
            f"payload on {name}",
            body % (len(robot.all_joint_names) + 1),  # a floating base is 0
            frozen("center", ten[1:4] / ten[0], (3,)),
            float(ten[0]),
        )
        for body, (name, ten) in enumerate(
            zip(robot.body_names, robot.payload_parameters.reshape(-1, 10), strict=True), 1
        )
        if ten[0] > 0
    )


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


NEUTRAL: Color = (88, 94, 102)
"""Colour of joints without a spring or with an unknown deflection."""

_STOPS = np.array(
    [(20, 78, 186), (104, 172, 232), (255, 243, 186), (245, 144, 66), (186, 34, 18)], dtype=float
)
"""Blue, light blue, pale yellow, orange, red; at -1, -1/2, 0, 1/2 and 1."""


def deflection_colors(deflection: Array, limit: Array) -> list[Color]:
    """Return colours of deflections (n,) on scales from -limit to limit, neutral for NaN."""
    known = np.isfinite(deflection) & (limit > 0)
    part = np.where(known, deflection, 0.0) / np.where(known, limit, 1.0)
    at = np.linspace(-1.0, 1.0, len(_STOPS))
    channels = [np.interp(part, at, stops) for stops in _STOPS.T]
    painted = np.round(np.column_stack(channels)).astype(int)
    return [
        (int(red), int(green), int(blue)) if is_known else NEUTRAL
        for (red, green, blue), is_known in zip(painted, known, strict=True)
    ]


def hexadecimal(color: Color) -> str:
    """Return a colour in CSS notation, '#1450b4'."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def gradient() -> str:
    """Return the scale as a CSS background, from -limit (left) to limit (right)."""
    stops = ", ".join(hexadecimal((int(r), int(g), int(b))) for r, g, b in _STOPS)
    return f"linear-gradient(to right, {stops})"
