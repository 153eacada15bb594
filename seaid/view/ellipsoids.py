"""Inertia ellipsoids: mass, centre of mass and inertia of the bodies of a robot as shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, frozen, safely
from seaid.errors import RobotError
from seaid.robot import inconsistency, pseudo_inertia

if TYPE_CHECKING:
    from seaid.robot import Robot


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The solid ellipsoid of uniform density with the mass and the inertia of a body.

    In the body's frame: `center` of mass (3,) [m], `semi_axes` (3,) [m], and their directions as
    columns of `rotation` (3, 3). With the pseudo-inertia [[S, h], [h^T, m]] the second moments
    about the centre of mass are S_c = S - h h^T / m, and those of a uniform solid ellipsoid are
    S_c = m/5 R diag(a^2) R^T. The semi-axes are therefore a_i = sqrt(5 lambda_i / m), where
    lambda_i are the eigenvalues of S_c; by principal moments, a_i^2 = 5/(2m) (I_j + I_k - I_i).

    A physically inconsistent body has no such ellipsoid: `problem` says why, and `semi_axes` are
    zero. Its `center` is the origin of the body if its mass is not positive.
    """

    body: int
    name: str
    mass: float
    center: Array
    rotation: Array
    semi_axes: Array
    problem: str | None = None


def ellipsoids_of(robot: Robot) -> tuple[Ellipsoid, ...]:
    """Return the ellipsoids of the bodies with known parameters, without payloads."""
    bodies = zip(robot.body_names, robot.parameters.reshape(-1, 10), strict=True)
    return tuple(
        _ellipsoid(index, name, ten)
        for index, (name, ten) in enumerate(bodies, 1)
        if np.all(np.isfinite(ten)) and np.any(ten)
    )


def _ellipsoid(body: int, name: str, parameters: Array) -> Ellipsoid:
    mass, problem = float(parameters[0]), inconsistency(parameters)
    center = parameters[1:4] / mass if mass > 0 else np.zeros(3)
    rotation, semi_axes = np.eye(3), np.zeros(3)
    if problem is None:
        second = pseudo_inertia(parameters)[:3, :3] - mass * np.outer(center, center)
        what = f"the inertia of '{name}'"
        moments, rotation = safely(np.linalg.eigh, second, what=what, error=RobotError)
        semi_axes = np.sqrt(5.0 * np.maximum(moments, 0.0) / mass)
        rotation[:, 2] = np.cross(rotation[:, 0], rotation[:, 1])  # no mirror image
    return Ellipsoid(
        body,
        name,
        mass,
        frozen("center", center, (3,)),
        frozen("rotation", rotation, (3, 3)),
        frozen("semi_axes", semi_axes, (3,)),
        problem,
    )
