"""Scene: distances between the bodies of a robot and to keep-out boxes, with exact gradients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from seaid.arrays import Array, BoolArray, finite
from seaid.errors import ExcitationError
from seaid.excitation.collision_geometry import bounding_spheres
from seaid.excitation.trajectory import Trajectory

Pair = tuple[str, str]

_TOLERANCE, _TOLERANCE_CURVED = 1e-10, 1e-6
"""[m]. On polytopes (a sphere is a point, a capsule a line, thick) GJK and EPA end exactly; EPA on
two deeply overlapping cylinders fails below 1e-6."""
_ITERATIONS, _ITERATIONS_CURVED = 1000, 255
_CURVED = (coal.Cylinder, coal.Cone, coal.Ellipsoid)
_HULL_DENSITY = 16
_COARSE = 16


@dataclass(frozen=True, eq=False)
class Scene:
    """What may collide: pairs of convex bodies on the joints of a robot, from `load_scene`.

    `pairs` names the two links, or the link and the box, of each of the P pairs watched; `ignored`
    those left out because they collide in nearly every posture. `clearance_m` is the least
    distance [m] that a planned motion keeps. Plain data, which can be sent to a process.
    """

    joint_names: tuple[str, ...]
    model: pin.Model
    model_order: tuple[int, ...]
    geometry: pin.GeometryModel
    pairs: tuple[Pair, ...]
    ignored: tuple[Pair, ...]
    clearance_m: float

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """The objects of each pair, as indices (P,) into the geometry."""
        pairs = self.geometry.collisionPairs
        first, second = [pair.first for pair in pairs], [pair.second for pair in pairs]
        return np.array(first, dtype=int), np.array(second, dtype=int)

    @cached_property
    def moves(self) -> Array:
        """Which joints (of the model) move each object of the geometry, (G, n) of 0 and 1."""
        moved = np.zeros((self.geometry.ngeoms, self.model.nv))
        for row, shape in zip(moved, self.geometry.geometryObjects, strict=True):
            row[[joint - 1 for joint in self.model.supports[shape.parentJoint] if joint]] = 1.0
        return moved


def distances(scene: Scene, q: Array, *, cap_m: float = np.inf) -> Array:
    """Return the signed distance (T, P) [m] of every pair at positions q (T, n) [rad or m].

    Negative where two bodies overlap: the shortest shift that parts them. Distances of more than
    `cap_m` count as `cap_m`, which saves most of the time. Raises ExcitationError for positions of
    another shape or not finite.
    """
    return _witnesses(scene, q, cap_m)[0]


def distance_gradients(scene: Scene, q: Array, *, cap_m: float = np.inf) -> tuple[Array, Array]:
    """Return the `distances` (T, P) and their exact gradient (T, P, n) by the joint positions.

    A distance changes as its nearest points, carried along by the bodies, come apart along the
    normal. Zero where the distance is capped. Where the nearest points are not unique (parallel
    faces), this is the derivative of one choice of them. With cylinders the normal is good to 1e-5,
    to 1e-2 where they overlap. Raises as `distances` does.
    """
    found, normals, points, jacobians = _witnesses(scene, q, cap_m)
    linear, angular = jacobians[:, :3], jacobians[:, 3:]
    first, second = scene.ends
    sign = scene.moves[second] - scene.moves[first]
    along = sign * (normals @ linear + np.cross(points, normals) @ angular)
    gradient = np.empty_like(along)
    gradient[:, :, list(scene.model_order)] = along
    return found, gradient


def _witnesses(scene: Scene, q: Array, cap_m: float) -> tuple[Array, Array, Array, Array]:
    """Return distances (T, P), normals and points of the first body (T, P, 3), Jacobians (T, 6, n).

    The Jacobians are those of Pinocchio's model, at the origin of the base.
    """
    q = finite("q", q, (None, len(scene.joint_names)), ExcitationError)[:, list(scene.model_order)]
    model, geometry = scene.model, scene.geometry
    data, placed = model.createData(), geometry.createData()
    _set_accuracy(geometry, placed)
    first, second = scene.ends
    centres, radii = bounding_spheres(geometry)
    least = np.maximum(radii[first] + radii[second] + cap_m, 0.0)
    found = np.full((len(q), len(first)), cap_m)
    normals, points = np.zeros((2, len(q), len(first), 3))
    jacobians = np.empty((len(q), 6, model.nv))
    for k, position in enumerate(q):
        jacobians[k] = pin.computeJointJacobians(model, data, position)
        pin.updateGeometryPlacements(model, data, geometry, placed)
        spots = np.array([oMg.act(c) for oMg, c in zip(placed.oMg, centres, strict=True)])
        apart = spots[first] - spots[second]
        for pair in np.flatnonzero(np.einsum("pi,pi->p", apart, apart) < least**2).tolist():
            result = pin.computeDistance(geometry, placed, pair)
            if not result.min_distance >= cap_m:
                found[k, pair] = result.min_distance
                normals[k, pair] = result.normal
                points[k, pair] = result.getNearestPoint1()
    return found, normals, points, jacobians


def _set_accuracy(geometry: pin.GeometryModel, placed: pin.GeometryData) -> None:
    curved = [isinstance(shape.geometry, _CURVED) for shape in geometry.geometryObjects]
    for pair, request in zip(geometry.collisionPairs, placed.distanceRequests, strict=True):
        either = curved[pair.first] or curved[pair.second]
        request.enable_signed_distance = True
        request.gjk_tolerance, request.gjk_max_iterations = _TOLERANCE, _ITERATIONS
        request.epa_tolerance = _TOLERANCE_CURVED if either else _TOLERANCE
        request.epa_max_iterations = _ITERATIONS_CURVED if either else _ITERATIONS


@dataclass(frozen=True, eq=False)
class Clearance:
    """The least distance of a motion: `distance_m` [m] of `pair` at `time_s`, over the samples.

    Between the samples, no pair comes closer than `proven_m` at any instant.
    """

    distance_m: float
    pair: Pair
    time_s: float
    proven_m: float


def clearance(scene: Scene, trajectory: Trajectory, *, rate_hz: float = 1000.0) -> Clearance:
    """Return the least distance of any pair over a motion, sampled at `rate_hz` [1/s].

    What no sample shows is bounded: a distance changes at most by the way that the points of its
    bodies go, which is that of the joints times their greatest lever arms; the joints' speed
    between samples is bounded by the hull of their accelerations. Raises ExcitationError for a
    trajectory of other joints and a rate that is not more than zero.
    """
    if trajectory.joint_names != scene.joint_names:
        raise ExcitationError(
            f"the trajectory is of joints {', '.join(trajectory.joint_names)}; the scene has "
            f"{', '.join(scene.joint_names)}"
        )
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ExcitationError(f"rate_hz must be more than zero, found {rate_hz}")
    steps = int(np.ceil(trajectory.duration * rate_hz))
    time = np.linspace(0.0, trajectory.duration, steps + 1)
    q, v, _ = trajectory.sample(time)
    reach, _, acceleration = (
        np.max(np.abs(trajectory.basis.hull(order, _HULL_DENSITY) @ trajectory.coefficients), 0)
        for order in range(3)
    )
    half = 0.5 * trajectory.duration / steps
    way = (np.abs(v) + 0.5 * half * acceleration) * half
    change = way @ lever_arms(scene, reach).T
    nearest = float(np.min(distances(scene, q[::_COARSE])))
    found = distances(scene, q, cap_m=nearest + float(np.max(change)))
    sample, pair = np.unravel_index(np.argmin(found), found.shape)
    return Clearance(
        float(found[sample, pair]),
        scene.pairs[pair],
        float(time[sample]),
        float(np.min(found - change)),
    )


def lever_arms(scene: Scene, reach: Array) -> Array:
    """Return how far [m] the pairs' points go at most, (P, n), a radian or metre of each joint.

    `reach` (n,) is the greatest |position| of each joint, which prismatic ones stretch the arm by.
    """
    model, slides = scene.model, _slides(scene.model)
    order = list(scene.model_order)
    steps = np.array([np.linalg.norm(M.translation) for M in model.jointPlacements])
    steps[1:] += np.where(slides, reach[order], 0.0)
    centres, radii = bounding_spheres(scene.geometry)
    arms = np.zeros((scene.geometry.ngeoms, model.nv))
    for row, shape, centre, radius in zip(
        arms, scene.geometry.geometryObjects, centres, radii, strict=True
    ):
        arm = float(np.linalg.norm(shape.placement.act(centre))) + radius
        for joint in reversed([joint for joint in model.supports[shape.parentJoint] if joint]):
            row[joint - 1] = 1.0 if slides[joint - 1] else arm
            arm += steps[joint]
    first, second = scene.ends
    apart = (arms[first] + arms[second]) * (scene.moves[first] != scene.moves[second])
    levers = np.empty(apart.shape)
    levers[:, order] = apart
    return levers


def _slides(model: pin.Model) -> BoolArray:
    kinds = [joint.shortname() for joint in model.joints[1:]]
    return np.array([kind.startswith("JointModelP") for kind in kinds], dtype=bool)
