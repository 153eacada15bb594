"""The picture of the robot as SVG: its joints in colours, with labels.

Pinocchio places the joints; they are seen in parallel projection from the side that shows most of
the links. A cylinder is a revolute joint, a box on a rail a prismatic one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array
from seaid.report.formats import rendered, svg_path

if TYPE_CHECKING:
    from seaid.identification import Identification
    from seaid.robot import Robot

_WIDTH, _HEIGHT, _LABELS = 640.0, 420.0, 165.0
_MOST_LABELS = 6
"""Labels on each side of the picture; other joints have a name under the pointer only."""

_ELEVATION, _TURNED = np.radians(18.0), np.radians(24.0)
"""Height of the eye, and angle away from the view that shows most, so that joints look round."""

_JOINT, _LEAST, _OF_LINK, _NEAR = 0.055, 0.012, 0.4, 0.6
"""Largest and least size of a joint over that of the robot, largest over the median link; joints
closer than so many sizes move apart."""

_LONGEST = 17


@dataclass(frozen=True)
class Label:
    """Text and colour of a joint in a picture: classes of report.css."""

    name: str
    value: str
    colour: str
    is_flagged: bool = False


@dataclass(frozen=True, eq=False)
class Posture:
    """A robot in the middle of its motion, in the frame of the base.

    `origins`, `axes` and `turns` (N, 3 or 3 x 3) are of joints and bodies, dependent ones too;
    `parents` (N,) are joints, -1 for the base; `up` is against gravity.
    """

    robot: Robot
    origins: Array
    axes: Array
    turns: Array
    parents: tuple[int, ...]
    up: Array

    @cached_property
    def ends(self) -> Array:
        """The visible ends (n, 3) of the links: of the last ones, beyond their centres of mass."""
        ends = np.full_like(self.origins, np.nan)
        leaves = set(range(len(self.origins))) - set(self.parents)
        for joint in leaves:
            center = center_of_mass(self.robot.parameters[10 * joint : 10 * joint + 10])
            if center is not None and np.linalg.norm(center) > 0:
                # Where a last link ends is unknown; a uniform rod would at 2 centres of mass.
                ends[joint] = self.origins[joint] + 1.6 * self.turns[joint] @ center
        return ends

    @cached_property
    def points(self) -> Array:
        """All points (., 3) of the skeleton."""
        ends = self.ends[np.isfinite(self.ends[:, 0])]
        return np.concatenate([np.zeros((1, 3)), self.origins, ends])

    @cached_property
    def size(self) -> float:
        """The diagonal of the skeleton [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) or 1.0

    @cached_property
    def joint_size(self) -> float:
        """The size of a drawn joint [m]."""
        starts = [self.origins[parent] if parent >= 0 else np.zeros(3) for parent in self.parents]
        links = np.linalg.norm(self.origins - starts, axis=1)
        links = links[links > 1e-3 * self.size]
        typical = float(np.median(links)) if len(links) else self.size
        return max(_LEAST * self.size, min(_JOINT * self.size, _OF_LINK * typical))


def posture_of(identification: Identification) -> Posture:
    """Return the robot in the middle of the motion that was used, else of its limits."""
    robot, model = identification.robot, identification.robot.model
    lower, upper = robot.lower_limits, robot.upper_limits
    if identification.motions:
        phi = np.concatenate([motion.joint_position for motion in identification.motions])
        (positions,) = robot.joint_states(phi)
        lower, upper = positions.min(axis=0), positions.max(axis=0)
    bounded = np.isfinite(lower) & np.isfinite(upper)
    q = np.where(bounded, 0.5 * (np.nan_to_num(lower) + np.nan_to_num(upper)), 0.0)
    data, order = model.createData(), list(robot.model_order)
    # Columns (linear, angular) in the frame of the base: a prismatic axis is the linear part.
    jacobian = pin.computeJointJacobians(model, data, robot.to_model(q)).reshape(6, -1)
    slides = np.array(robot.all_prismatic, dtype=bool)[order]
    axes = np.where(slides, jacobian[:3], jacobian[3:]).T
    frames = np.array([frame.homogeneous for frame in data.oMi.tolist()[1:]]).reshape(-1, 4, 4)
    parents = [order[above - 1] if above else -1 for above in list(model.parents)[1:]]
    # From the order of Pinocchio's model to that of the robot.
    places = np.argsort(order)
    origins, turns = frames[places, :3, 3], frames[places, :3, :3]
    gravity = model.gravity.linear
    size = float(np.linalg.norm(gravity))
    up = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    return Posture(robot, origins, axes[places], turns, tuple(parents[k] for k in places), up)


def center_of_mass(parameters: Array) -> Array | None:
    """Return the centre of mass (3,) of ten parameters, None without a mass."""
    return parameters[1:4] / parameters[0] if parameters[0] > 0 else None


@dataclass(frozen=True, eq=False)
class _View:
    """A parallel projection into the middle of a picture: rows right, up, towards the eye."""

    rows: Array
    middle: Array
    scale: float

    def places(self, points: Array) -> Array:
        """Return places (., 2) in the picture."""
        flat = (points - self.middle) @ self.rows[:2].T * self.scale
        return np.asarray([_WIDTH / 2, _HEIGHT / 2] + flat * [1.0, -1.0])


def _view(posture: Posture, points: Array, room: float) -> _View:
    """Return the view of points (., 3) that shows most of the links, a little turned.

    `room` is what remains free at both sides.
    """
    # Gram-Schmidt with the unit vector least parallel to `up`: some horizontal direction.
    helper = np.eye(3)[int(np.argmin(np.abs(posture.up)))]
    front = np.cross(posture.up, np.cross(helper, posture.up))
    front = front / np.linalg.norm(front)
    starts = [posture.origins[parent] if parent >= 0 else np.zeros(3) for parent in posture.parents]
    links = np.concatenate([posture.origins - starts, posture.ends - posture.origins])
    links = links[np.isfinite(links[:, 0])]

    def rows_at(angle: float) -> Array:
        turned = pin.exp3(angle * posture.up) @ front
        eye = np.cos(_ELEVATION) * turned + np.sin(_ELEVATION) * posture.up
        right = np.cross(posture.up, turned)
        return np.array([right, np.cross(eye, right), eye])

    angles = np.radians(np.arange(0.0, 360.0, 15.0))
    # Rounded, so that of equally good views the first is taken on each machine.
    seen = [float(np.linalg.norm(links @ rows_at(angle)[:2].T)) for angle in angles]
    rows = rows_at(angles[int(np.argmax(np.round(seen, 9)))] + _TURNED)
    flat = points @ rows[:2].T
    margin = 2.0 * _JOINT * posture.size
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    scale = float(np.min([_WIDTH - 2 * room, _HEIGHT - 30.0] / (high - low)))
    return _View(rows, rows[:2].T @ (0.5 * (low + high)), scale)


def robot_picture(posture: Posture, labels: Mapping[str, Label], title: str) -> Any:
    """Return the robot with its joints in the colours of their labels, as SVG."""
    view = _view(posture, posture.points, _LABELS)
    centers = _joint_centers(posture)
    followers = posture.robot.dependent_joints
    labels = {**{j.name: Label(j.name, j.leader, "none") for j in followers}, **labels}
    depth = np.argsort(centers @ view.rows[2], kind="stable")
    names = posture.robot.all_joint_names
    return rendered(
        "robot.svg.j2",
        **_background(posture, view),
        title=title,
        labels=_labelled(posture, view.places(centers), labels),
        joints=[
            {"label": labels[names[joint]], **_joint(posture, view, joint, centers[joint])}
            for joint in depth.tolist()
        ],
    )


def _background(posture: Posture, view: _View) -> dict[str, Any]:
    """Return the base, as a plate perpendicular to gravity, and the links, as paths."""
    rim = 2.2 * _JOINT * posture.size * _circle(posture.up, 40)
    ground, links = svg_path(view.places(rim)), _links(posture, view)
    return {"size": (_WIDTH, _HEIGHT), "ground": ground, "links": links}


def _joint_centers(posture: Posture) -> Array:
    """Return the centres (n, 3) of the drawn joints: joints at one place move along their axes."""
    size, centers = posture.joint_size, posture.origins.copy()
    for joint in range(len(centers)):
        near = np.linalg.norm(posture.origins - posture.origins[joint], axis=1) < _NEAR * size
        if np.sum(near) > 1:
            place = int(np.sum(near[:joint]))
            centers[joint] += (1.5 if place % 2 else -1.5) * size * posture.axes[joint]
    return centers


def _circle(axis: Array, count: int) -> Array:
    """Return points (count, 3) of the unit circle about an axis."""
    turn = np.linspace(0, 2 * np.pi, count)
    u = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    u = u / np.linalg.norm(u)
    return np.asarray(np.outer(np.cos(turn), u) + np.outer(np.sin(turn), np.cross(axis, u)))


def _links(posture: Posture, view: _View) -> str:
    places, ends = view.places(posture.origins), view.places(posture.ends)
    base = view.places(np.zeros((1, 3)))[0]
    lines = ""
    for joint, parent in enumerate(posture.parents):
        start = base if parent < 0 else places[parent]
        lines += svg_path(np.array([start, places[joint]]))
        if np.isfinite(ends[joint, 0]):
            lines += svg_path(np.array([places[joint], ends[joint]]))
    return lines


def _joint(posture: Posture, view: _View, joint: int, center: Array) -> dict[str, Any]:
    """Return a cylinder along the axis of a revolute joint, a box on a rail of a prismatic one."""
    from scipy.spatial import ConvexHull

    size, axis = posture.joint_size, posture.axes[joint]
    # The face towards the eye is drawn over the side.
    axis = axis if float(axis @ view.rows[2]) >= 0 else -axis
    if posture.robot.all_prismatic[joint]:
        rail, box = (view.places(center + np.array([[-k], [k]]) * size * axis) for k in (1.8, 0.8))
        return {"rail": rail, "box": box, "width": 1.3 * size * view.scale}
    rim = 0.62 * _circle(axis, 48)
    # Both faces of the cylinder; in parallel projection its outline is their common convex hull.
    near, far = (view.places(center + size * (rim + k * axis)) for k in (0.75, -0.75))
    both = np.concatenate([near, far])
    axle = view.places((center + 0.75 * size * axis)[None])[0]
    return {"side": both[ConvexHull(both).vertices], "face": near, "axle": axle}


def _labelled(posture: Posture, places: Array, labels: Mapping[str, Label]) -> list[dict[str, Any]]:
    """Return labels in a column on each side, the flagged ones first, with lines to the joints."""
    names = posture.robot.joint_names
    rank = [
        (not labels[name].is_flagged, ("poor", "fair", "good", "none").index(labels[name].colour))
        for name in names
    ]
    ranked = sorted(range(len(names)), key=rank.__getitem__)[: 2 * _MOST_LABELS]
    across = sorted(ranked, key=lambda k: float(places[k, 0]))
    half = -(-len(across) // 2)
    texts = []
    for is_left, column in ((True, across[:half]), (False, across[half:])):
        column = sorted(column, key=lambda k: float(places[k, 1]))
        for joint, y in zip(column, _spread(places[column, 1]), strict=True):
            edge, anchor = (_LABELS - 22, "end") if is_left else (_WIDTH - _LABELS + 22, "start")
            x, joint_y = places[joint]
            near = edge + (14 if is_left else -14)
            line = f"M{edge + (5 if is_left else -5):.1f} {y:.1f}H{near:.1f}L{x:.1f} {joint_y:.1f}"
            name = names[joint]
            text = name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"
            place = {"line": line, "x": edge, "y": y, "anchor": anchor}
            texts.append({"of": labels[name], "text": text, **place})
    return texts


def _spread(wanted: Array, step: float = 62.0) -> list[float]:
    """Return heights near the wanted ones, in order, that are at least a label apart."""
    count = len(wanted)
    step = min(step, (_HEIGHT - 50.0) / max(count - 1, 1))
    # Heights y_k with y_k - y_(k-1) >= step: y_k - k step must not fall, hence the running maximum.
    free = np.clip(wanted - step * np.arange(count), 24.0, None)
    heights = np.maximum.accumulate(free) + step * np.arange(count)
    over = max(float(heights[-1]) - (_HEIGHT - 32.0), 0.0) if count else 0.0
    least = 24.0 + step * np.arange(count)
    return [float(height) for height in np.maximum(heights - over, least)]
