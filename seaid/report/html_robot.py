"""The picture of the robot as SVG: its joints in colours, with labels.

Pinocchio places the joints; they are seen in parallel projection from the side that shows most of
the links. A cylinder is a revolute joint, a box on a rail a prismatic one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array
from seaid.report.formats import layout_of, rendered, svg_path

if TYPE_CHECKING:
    from seaid.identification import Identification
    from seaid.robot import Robot

_LAYOUT = layout_of("picture")
_ELEVATION, _TURNED = np.radians([_LAYOUT.elevation_deg, _LAYOUT.turned_deg])


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

    `origins` and `axes` (N, 3) are of joints, dependent ones too; `links` (L, 2, 3) are lines from
    each joint to the next, and to an end of the last bodies; `up` is against gravity.
    """

    robot: Robot
    origins: Array
    axes: Array
    links: Array
    up: Array


def posture_of(identification: Identification) -> Posture:
    """Return the robot in the middle of the motion that was used, else of its limits."""
    robot, model = identification.robot, identification.robot.model
    data, order = model.createData(), list(robot.model_order)
    # Columns (linear, angular) in the frame of the base: a prismatic axis is the linear part.
    jacobian = pin.computeJointJacobians(model, data, robot.to_model(_middle(identification)))
    slides = np.array(robot.all_prismatic, dtype=bool)[order]
    axes = np.where(slides, *np.split(jacobian.reshape(6, -1), 2)).T
    frames = data.oMi.tolist()
    lines = []
    for joint, parent in enumerate(model.parents.tolist()):
        origin, body = frames[joint].translation, 10 * order[joint - 1]
        if joint:
            lines.append((frames[parent].translation, origin))
        if joint and joint not in model.parents.tolist():
            center = center_of_mass(robot.parameters[body : body + 10])
            # Where a last link ends is unknown; a uniform rod would at 2 centres of mass.
            lines.append((origin, origin if center is None else frames[joint].act(1.6 * center)))
    # From the order of Pinocchio's model to that of the robot.
    places = np.argsort(order)
    origins = np.array([frame.translation for frame in frames[1:]])[places]
    size = float(np.linalg.norm(model.gravity.linear))
    up = -model.gravity.linear / size if size > 0 else np.array([0.0, 0.0, 1.0])
    return Posture(robot, origins, axes[places], np.array(lines), up)


def _middle(identification: Identification) -> Array:
    """Return the joint positions (n,) in the middle of the motions, or of the limits."""
    robot = identification.robot
    ends = np.array([robot.lower_limits, robot.upper_limits])
    if identification.motions:
        phi = np.concatenate([motion.joint_position for motion in identification.motions])
        (positions,) = robot.joint_states(phi)
        ends = np.array([positions.min(axis=0), positions.max(axis=0)])
    bounded = np.all(np.isfinite(ends), axis=0)
    return np.asarray(np.where(bounded, ends, 0.0).mean(axis=0))


def center_of_mass(parameters: Array) -> Array | None:
    """Return the centre of mass (3,) of ten parameters, None without a mass."""
    return parameters[1:4] / parameters[0] if parameters[0] > 0 else None


@dataclass(frozen=True, eq=False)
class _View:
    """A parallel projection into the middle of a picture: rows right, up, towards the eye.

    `joint_size` is that of a drawn joint in the picture.
    """

    rows: Array
    middle: Array
    scale: float
    joint_size: float

    def places(self, points: Array) -> Array:
        """Return places (..., 2) in the picture."""
        flat = (points - self.middle) @ self.rows[:2].T * self.scale
        return np.asarray([_LAYOUT.width / 2, _LAYOUT.height / 2] + flat * [1.0, -1.0])


def _view(posture: Posture) -> _View:
    """Return the view that shows most of the links, a little turned, with room for labels."""
    up, links = posture.up, posture.links[:, 1] - posture.links[:, 0]
    # The unit vector least parallel to `up` leads to two horizontal directions.
    across = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    across = across / np.linalg.norm(across)
    x, y = links @ across, links @ np.cross(up, across)
    # Links extend most along the principal axis of their second moments: it stays in the picture.
    # Rounded, and without -0.0, so that the view is the same on each machine.
    moments = np.round([2 * x @ y, x @ x - y @ y], 9) + 0.0
    right = pin.exp3((0.5 * np.arctan2(*moments) + _TURNED) * up) @ across
    eye = np.cos(_ELEVATION) * np.cross(right, up) + np.sin(_ELEVATION) * up
    rows = np.array([right, np.cross(eye, right), eye])
    flat = posture.links.reshape(-1, 3) @ rows[:2].T
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([_LAYOUT.width - 2 * _LAYOUT.label_width, _LAYOUT.height]) - 2 * _LAYOUT.margin
    scale = float(np.min(room / np.maximum(high - low, 1e-6)))
    lengths = scale * np.linalg.norm(links, axis=1)
    typical = float(np.median(lengths[lengths > 1])) if np.any(lengths > 1) else _LAYOUT.height
    joint_size = float(np.clip(_LAYOUT.joint_of_link * typical, _LAYOUT.least_joint, _LAYOUT.joint))
    return _View(rows, rows[:2].T @ (0.5 * (low + high)), scale, joint_size)


def robot_picture(posture: Posture, labels: Mapping[str, Label], title: str) -> Any:
    """Return the robot with its joints in the colours of their labels, as SVG."""
    view, robot = _view(posture), posture.robot
    centers = _joint_centers(posture, view.joint_size / view.scale)
    labels = {**{j.name: Label(j.name, j.leader, "none") for j in robot.dependent_joints}, **labels}
    drawn = [
        {
            "label": labels[robot.all_joint_names[joint]],
            "slides": robot.all_prismatic[joint],
            **_joint(view, centers[joint], posture.axes[joint]),
        }
        for joint in np.argsort(centers @ view.rows[2], kind="stable").tolist()
    ]
    return rendered(
        "robot.svg.j2",
        size=(_LAYOUT.width, _LAYOUT.height),
        title=title,
        base=view.places(np.zeros(3)).tolist(),
        flatness=float(np.sin(_ELEVATION)),
        links="".join(map(svg_path, view.places(posture.links))),
        labels=_labelled(robot, view.places(centers), labels),
        joints=drawn,
        radius=0.62 * view.joint_size,
    )


def _joint_centers(posture: Posture, size: float) -> Array:
    """Return the centres (n, 3) of the drawn joints: joints at one place move along their axes."""
    centers = posture.origins.copy()
    for joint in range(len(centers)):
        distances = np.linalg.norm(posture.origins - posture.origins[joint], axis=1)
        near = distances < _LAYOUT.near * size
        if np.sum(near) > 1:
            place = int(np.sum(near[:joint]))
            centers[joint] += (1.5 if place % 2 else -1.5) * size * posture.axes[joint]
    return centers


def _joint(view: _View, center: Array, axis: Array) -> dict[str, Any]:
    """Return the body of a joint from its far end to its near one, and the rail, along its axis.

    A circle about the axis is an ellipse, by its `flatness` and the `angle` of the axis [deg].
    """
    depth = float(axis @ view.rows[2])
    axis = view.joint_size / view.scale * (axis if depth >= 0 else -axis)
    steps = np.array([[-0.75], [0.75], [-1.8], [1.8]])
    far, near, *rail = view.places(center + steps * axis)
    angle = float(np.degrees(np.arctan2(*(near - far)[::-1])))
    return {"body": [far, near], "rail": rail, "angle": angle, "flatness": abs(depth)}


def _labelled(robot: Robot, places: Array, labels: Mapping[str, Label]) -> list[dict[str, Any]]:
    """Return labels in a column on each side, the flagged ones first, with lines to the joints."""
    names = robot.joint_names
    rank = [
        (not labels[name].is_flagged, ("poor", "fair", "good", "none").index(labels[name].colour))
        for name in names
    ]
    ranked = sorted(range(len(names)), key=rank.__getitem__)[: 2 * _LAYOUT.most_labels]
    across = sorted(ranked, key=lambda k: float(places[k, 0]))
    half, texts = -(-len(across) // 2), []
    longest, room = _LAYOUT.longest_label, _LAYOUT.label_width
    for is_left, column in ((True, across[:half]), (False, across[half:])):
        column = sorted(column, key=lambda k: float(places[k, 1]))
        for row, joint in enumerate(column, 1):
            y = _LAYOUT.height * row / (len(column) + 1)
            anchor, side = ("end", -1) if is_left else ("start", 1)
            edge = room - 22 if is_left else _LAYOUT.width - room + 22
            x, joint_y = places[joint]
            near = edge - 14 * side
            line = f"M{edge - 5 * side:.1f} {y:.1f}H{near:.1f}L{x:.1f} {joint_y:.1f}"
            name = names[joint]
            text = name if len(name) <= longest else f"{name[: longest - 1]}…"
            place = {"line": line, "x": edge, "y": y, "anchor": anchor}
            texts.append({"of": labels[name], "text": text, **place})
    return texts
