"""Picture: all there is to see of a robot at rest, and where its bodies are in a posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, finite, frozen
from seaid.errors import RobotError
from seaid.robot import Robot
from seaid.urdf import UrdfTree, urdf_again
from seaid.view.shapes import Shape, shapes_of


@dataclass(frozen=True, eq=False)
class Mark:
    """A mass at a point of a body: `center` (3,) [m] in the body's frame, `mass` [kg]."""

    name: str
    body: int
    center: Array
    mass: float


@dataclass(frozen=True, eq=False)
class Picture:
    """What there is to see of a robot with n joints, on n + 1 bodies.

    Body 0 is the base, body i + 1 what joint i moves; its frame is that of Pinocchio's joint.
    `places` has the body and the placement on it of every link of the URDF. `segments` (S, 2, 3)
    [m] are lines between the frames of joints, along which they slide and to payloads, on the
    bodies `segment_bodies` (S,);
    `axes` (n, 3) the joints' axes in their bodies' frames. `up` (3,) points against gravity.
    `payloads` and `centers` of mass are marks. `notes` tell what could not be shown.
    """

    robot: Robot
    places: dict[str, tuple[int, pin.SE3]]
    shapes: tuple[Shape, ...]
    segments: Array
    segment_bodies: tuple[int, ...]
    axes: Array
    payloads: tuple[Mark, ...]
    centers: tuple[Mark, ...]
    up: Array
    notes: tuple[str, ...]

    @property
    def bare_bodies(self) -> tuple[str, ...]:
        """The names of bodies that move and on which no shape is shown."""
        shown = {shape.body for shape in self.shapes}
        names = enumerate(self.robot.body_names, 1)
        return tuple(name for body, name in names if body not in shown)

    @cached_property
    def size(self) -> float:
        """The length [m] from corner to corner of what is seen at `home`."""
        points = self.outline(self.home[None])
        return float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0

    @property
    def home(self) -> Array:
        """The posture (n,) within the limits that is nearest to all joints at zero."""
        lower, upper = self.robot.lower_limits, self.robot.upper_limits
        return np.clip(np.zeros(self.robot.n), lower, upper)

    def placements(self, q: Array) -> list[pin.SE3]:
        """Return where the n + 1 bodies are in the base frame at positions q (n,) [rad or m].

        Raises RobotError for positions of another shape or not finite.
        """
        robot, model = self.robot, self.robot.model
        q = finite("joint positions", q, (robot.n,), RobotError)
        bodies, body_of = [pin.SE3.Identity()] * (robot.n + 1), [0]
        for joint, index in enumerate(robot.model_order, 1):  # parents come before children
            body_of.append(index + 1)
            placement = bodies[body_of[model.parents[joint]]] * model.jointPlacements[joint]
            axis, value = self.axes[index], float(q[index])
            turn = np.eye(3) if robot.is_prismatic[index] else pin.exp3(value * axis)
            shift = value * axis if robot.is_prismatic[index] else np.zeros(3)
            bodies[index + 1] = placement * pin.SE3(turn, shift)
        return bodies

    def link_placements(self, q: Array) -> dict[str, pin.SE3]:
        """Return where all links of the URDF are, those that are fixed or locked at zero too."""
        bodies = self.placements(q)
        return {link: bodies[body] * place for link, (body, place) in self.places.items()}

    def outline(self, postures: Array) -> Array:
        """Return points (., 3) [m] around all that is seen in postures (P, n)."""
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
        found: list[list[Array]] = [[np.zeros((1, 3))] for _ in range(self.robot.n + 1)]
        for shape in self.shapes:
            ends = np.array([shape.vertices.min(axis=0), shape.vertices.max(axis=0)])
            grid = np.array(np.meshgrid(*ends.T)).reshape(3, -1).T
            found[shape.body].append(grid)
        for body, segment in zip(self.segment_bodies, self.segments, strict=True):
            found[body].append(segment)
        for mark in self.payloads:
            found[mark.body].append(mark.center[None])
        return [np.concatenate(points) for points in found]


def picture_of(robot: Robot, *, package_dirs: str | Path | Sequence[str | Path] = ()) -> Picture:
    """Return all there is to see of a robot that load_robot has made.

    Shapes are those of the URDF's visuals; `package_dirs` are folders in which packages of meshes
    are searched, beside the folder of the file and those above it. Raises RobotError for a robot
    without its file and for folders that are not there.
    """
    tree = _tree_of(robot)
    places = _places(tree, robot)
    assert robot.urdf is not None
    shapes, notes = shapes_of(robot.urdf, places, package_dirs)
    payloads = _marks("payload on", robot, robot.payload_parameters)
    segments, bodies = _segments(tree, robot, places, payloads)
    gravity = robot.model.gravity.linear
    strength = float(np.linalg.norm(gravity))
    up = np.array([0.0, 0.0, 1.0]) if strength == 0.0 else -gravity / strength
    return Picture(
        robot=robot,
        places=places,
        shapes=shapes,
        segments=frozen("segments", segments, (None, 2, 3)),
        segment_bodies=bodies,
        axes=_axes(robot),
        payloads=payloads,
        centers=_marks("body of", robot, robot.parameters),
        up=frozen("up", up, (3,)),
        notes=notes,
    )


def _tree_of(robot: Robot) -> UrdfTree:
    if robot.urdf is None:
        raise RobotError(f"'{robot.name}' has no URDF to show: make it by load_robot")
    tree = urdf_again(robot.urdf)
    gone = [joint for joint in robot.joint_names if joint not in tree.joints]
    if gone:
        raise RobotError(
            f"'{robot.urdf}' has no joint {', '.join(gone)} any more: it was changed since "
            f"'{robot.name}' was loaded; load it again"
        )
    return tree


def _places(tree: UrdfTree, robot: Robot) -> dict[str, tuple[int, pin.SE3]]:
    """Return the body that carries each link, and the link's frame on it, from the root on."""
    places = {tree.root: (0, pin.SE3.Identity())}
    waiting = [tree.root]
    while waiting:
        link = waiting.pop()
        body, placement = places[link]
        for joint in tree.children(link):
            if joint.name in robot.joint_names:
                places[joint.child] = (robot.index(joint.name) + 1, pin.SE3.Identity())
            else:
                places[joint.child] = (body, placement * joint.placement)
            waiting.append(joint.child)
    return places


def _axes(robot: Robot) -> Array:
    """Return the axes (n, 3) of the model's joints in their own frames."""
    model, data = robot.model, robot.model.createData()
    jacobian = pin.computeJointJacobians(model, data, np.zeros(robot.n)).reshape(6, robot.n)
    axes = np.empty((robot.n, 3))
    for joint, index in enumerate(robot.model_order, 1):
        rows = slice(0, 3) if robot.is_prismatic[index] else slice(3, 6)
        axes[index] = data.oMi[joint].rotation.T @ jacobian[rows, joint - 1]
    return frozen("axes", axes, (None, 3))


def _segments(
    tree: UrdfTree,
    robot: Robot,
    places: dict[str, tuple[int, pin.SE3]],
    payloads: Sequence[Mark],
) -> tuple[Array, tuple[int, ...]]:
    """Return lines from each link's frame to the joints below it, or else to its centre of mass;
    those on which joints slide; and those to payloads.
    """
    lines = [(mark.body, np.zeros(3), mark.center) for mark in payloads]
    for link, (body, placement) in places.items():
        start, below = placement.translation, tree.children(link)
        for joint in below:
            frame = placement * joint.placement
            lines.append((body, start, frame.translation))
            if joint.type == "prismatic" and joint.name in robot.joint_names:
                ends = np.array([joint.lower, joint.upper])
                if np.all(np.isfinite(ends)):
                    lines.append((body, *(frame.act(end * joint.axis) for end in ends)))
        mass, *moment = tree.links[link][:4]
        if not below and mass > 0:
            lines.append((body, start, placement.act(np.array(moment) / mass)))
    seen = [(body, (start, end)) for body, start, end in lines if np.linalg.norm(end - start) > 0]
    segments = np.array([ends for _, ends in seen]).reshape(-1, 2, 3)
    return segments, tuple(body for body, _ in seen)


def _marks(what: str, robot: Robot, parameters: Array) -> tuple[Mark, ...]:
    """Return the centres of the masses that bodies have, but for those not known (NaN)."""
    marks = []
    for index, values in enumerate(parameters.reshape(-1, 10)):
        if np.all(np.isfinite(values[:4])) and values[0] > 0:
            center = frozen("center", values[1:4] / values[0], (3,))
            name = f"{what} {robot.body_names[index]}"
            marks.append(Mark(name, index + 1, center, float(values[0])))
    return tuple(marks)
