"""load_scene: the bodies of a URDF and the keep-out boxes that a motion must keep apart."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, compress
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from seaid._arrays import Array, finite
from seaid._progress import Display
from seaid.errors import (
    ExcitationError,
    SeaidWarning,
    check_name,
    checked,
    shortened,
    shown,
)
from seaid.excitation.collision import MOST_SIZE_M, Pair, Scene, collision_geometry, distances
from seaid.robot import Robot

_POSTURES = 500
"""Random postures within the limits at which pairs that nearly always touch are looked for."""

_NEARLY_ALWAYS = 0.95
"""Share of random postures that MoveIt's setup assistant takes for 'always in collision'."""


@dataclass(frozen=True, eq=False, repr=False)
class Box(Display):
    """A box, in the base frame, that the robot must keep out of.

    Parameters
    ----------
    center, size : array (3,)
        Centre and edge lengths [m].
    rotation_rpy : array (3,)
        Rotation about the centre [rad]: roll, pitch, yaw as in a URDF.
    name : str
        Its name in `Scene.pairs` and messages.

    Examples
    --------
    >>> table = seaid.excitation.Box(center=(0.4, 0.0, -0.05), size=(0.6, 0.8, 0.1), name="table")
    """

    center: Sequence[float] | Array
    size: Sequence[float] | Array
    rotation_rpy: Sequence[float] | Array = (0.0, 0.0, 0.0)
    name: str = "box"

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isprintable():
            raise ExcitationError(
                "the name of a keep-out box is a text without control characters, found "
                f"{shown(self.name)}"
            )
        for name in ("center", "size", "rotation_rpy"):
            where = f"{name} of keep-out box '{shortened(self.name)}'"
            value = finite(where, getattr(self, name), (3,), ExcitationError)
            if np.max(np.abs(value)) > MOST_SIZE_M:
                raise ExcitationError(
                    f"{where} must be at most {MOST_SIZE_M:g}, found {value.tolist()}"
                )
            object.__setattr__(self, name, value)
        if np.min(self.size) <= 0:
            raise ExcitationError(
                f"size of keep-out box '{shortened(self.name)}' must be more than zero in every "
                f"direction, found {list(map(float, self.size))}"
            )

    @property
    def shape(self) -> pin.GeometryObject:
        """The box as a geometry object of Pinocchio, on the base."""
        box = coal.Box(*map(float, self.size))
        box.computeLocalAABB()
        turned = pin.rpy.rpyToMatrix(*map(float, self.rotation_rpy))
        return pin.GeometryObject(self.name, 0, pin.SE3(turned, np.array(self.center)), box)


@checked(ExcitationError)
def load_scene(
    urdf: str | Path,
    robot: Robot,
    *,
    package_dirs: str | Path | Sequence[str | Path] = (),
    keep_out: Sequence[Box] = (),
    clearance_m: float = 0.01,
    disabled_pairs: Iterable[Pair] = (),
) -> Scene:
    """Load the collision pairs of a robot and its surroundings.

    The pairs are those of any two bodies that no joint connects directly, and of every moving body
    with every box. Pairs closer than `clearance_m` in 95 % of 500 random postures within the limits
    are excluded; a SeaidWarning and `Scene.ignored` list them. Meshes are replaced by their convex
    hulls, which contain them: a motion that keeps the clearance is free of collisions.

    Parameters
    ----------
    urdf : path
        The file of the robot, with `<collision>` elements.
    robot : Robot
    package_dirs : path or sequence of paths
        Folders to search for meshes, besides the folder of the file and those above it.
    keep_out : sequence of Box
        Boxes that the robot must not enter.
    clearance_m : float
        Minimum distance of a planned motion [m].
    disabled_pairs : iterable of (str, str)
        Pairs of link or box names that are not checked.

    Returns
    -------
    Scene

    Raises
    ------
    RobotError
        For the file of another robot, and a mesh that is missing or not readable.
    ExcitationError
        For unknown names, a file without collision geometry, a box that no posture avoids, and if
        no pair remains.

    Examples
    --------
    >>> table = seaid.excitation.Box(center=(0.4, 0.0, -0.05), size=(0.6, 0.8, 0.1), name="table")
    >>> scene = seaid.excitation.load_scene("leg.urdf", robot, keep_out=[table], clearance_m=0.02)
    >>> plan = seaid.design_excitation(robot, 10.0, scene=scene)
    """
    if not (np.isfinite(clearance_m) and clearance_m >= 0):
        raise ExcitationError(f"clearance_m must be zero or more, found {clearance_m}")
    geometry, links = collision_geometry(urdf, robot, package_dirs)
    if not links:
        raise ExcitationError(
            f"'{urdf}' has no collision geometry, so no distance of '{robot.name}' to itself or to "
            "a box can be computed; add <collision> elements to its links"
        )
    names = _with_boxes(geometry, links, keep_out)
    disabled = _disabled(disabled_pairs, names)
    joints = [shape.parentJoint for shape in geometry.geometryObjects]
    for first, second in _pairs(robot.model, joints, len(links)):
        if frozenset((names[first], names[second])) not in disabled:
            geometry.addCollisionPair(pin.CollisionPair(first, second))
    pairs = tuple((names[pair.first], names[pair.second]) for pair in geometry.collisionPairs)
    scene = Scene(robot, geometry, pairs, (), float(clearance_m))
    return _without_always_close(scene, robot, {box.name for box in keep_out})


def _with_boxes(
    geometry: pin.GeometryModel, links: tuple[str, ...], boxes: Sequence[Box]
) -> tuple[str, ...]:
    """Add the boxes to the geometry; return the names of all its objects."""
    names = [*links]
    for box in boxes:
        if box.name in names:
            raise ExcitationError(
                f"keep-out box '{box.name}' has the name of another box or of a link; give it "
                "another by Box(..., name=...)"
            )
        geometry.addGeometryObject(box.shape)
        names.append(box.name)
    return tuple(names)


def _pairs(model: pin.Model, joints: Sequence[int], links: int) -> Iterator[tuple[int, int]]:
    """Yield the objects on two bodies that are no neighbours, and moving ones with each box."""
    for first, second in combinations(range(len(joints)), 2):
        a, b = joints[first], joints[second]
        are_neighbours = model.parents[a] == b or model.parents[b] == a
        # boxes are on joint 0, the base, but no neighbours of a link whose joint hangs on the base
        if a != b and (first < links <= second or not are_neighbours):
            yield first, second


def _disabled(pairs: Iterable[Pair], names: Sequence[str]) -> set[frozenset[str]]:
    """Return the pairs of `disabled_pairs`, whose order does not count. Raises ExcitationError."""
    known = dict.fromkeys(names)
    disabled = set()
    for pair in pairs:
        is_pair = not isinstance(pair, str) and isinstance(pair, Collection) and len(pair) == 2
        if not is_pair or not all(isinstance(name, str) for name in pair):
            raise ExcitationError(
                f"disabled_pairs must be pairs of link names, found {shown(pair)}"
            )
        for name in pair:
            what = "link with collision geometry"
            check_name(what, name, known, ExcitationError, "disabled_pairs")
        disabled.add(frozenset(pair))
    return disabled


def _without_always_close(scene: Scene, robot: Robot, boxes: set[str]) -> Scene:
    """Return the scene without pairs always close; raise for a box always in collision."""
    # capped at the clearance: of pairs farther apart the exact distance is not needed
    close = distances(scene, _postures(robot), cap_m=scene.clearance_m) < scene.clearance_m
    shares = np.mean(close, axis=0)
    to_box = np.array([not boxes.isdisjoint(pair) for pair in scene.pairs], dtype=bool)
    # pairs of links that are always close are excluded; a box always in collision is misplaced
    blocked = list(compress(scene.pairs, to_box & (shares == 1.0)))
    if blocked:
        link, box = blocked[0]
        raise ExcitationError(
            f"no posture keeps link '{link}' clear of keep-out box '{box}' (of {_POSTURES} tried); "
            f"move the box, or exclude the pair by disabled_pairs=[{blocked[0]!r}]"
        )
    keep = to_box | (shares < _NEARLY_ALWAYS)
    ignored = tuple(dict.fromkeys(compress(scene.pairs, ~keep)))
    if ignored:
        warnings.warn(
            f"'{robot.name}': not checked for collision, because closer than "
            f"{scene.clearance_m:g} m in nearly every posture: "
            f"{', '.join(' and '.join(pair) for pair in ignored)}",
            SeaidWarning,
            stacklevel=4,
        )
    if not np.any(keep):
        raise ExcitationError(
            f"'{robot.name}' has no two bodies to keep apart: plan without a scene, or give boxes "
            "by keep_out=[...]"
        )
    geometry = scene.geometry.copy()
    geometry.removeAllCollisionPairs()
    for collision_pair in compress(scene.geometry.collisionPairs, keep):
        geometry.addCollisionPair(collision_pair)
    pairs = tuple(compress(scene.pairs, keep))
    return replace(scene, geometry=geometry, pairs=pairs, ignored=ignored)


def _postures(robot: Robot) -> Array:
    """Return random positions (T, n) within the limits (+-pi or 1 m for an unlimited joint)."""
    unlimited = np.where(robot.is_prismatic, 1.0, np.pi)
    bounded = robot.lower_limits < robot.upper_limits
    lower = np.where(np.isfinite(robot.lower_limits) & bounded, robot.lower_limits, -unlimited)
    upper = np.where(np.isfinite(robot.upper_limits) & bounded, robot.upper_limits, unlimited)
    return np.random.default_rng(0).uniform(lower, upper, (_POSTURES, robot.n))
