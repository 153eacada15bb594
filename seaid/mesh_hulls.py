"""Convex hulls of mesh files, read in a child process: the readers crash on damaged files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np

from seaid.arrays import Array
from seaid.child_process import Answer, ChildError, doing, run_in_child
from seaid.errors import RobotError, reason_of, shortened

_SECONDS, _BYTES_PER_SECOND = 15.0, 1e6
"""Processor time that a child may take: at least, and the slowest rate of reading."""

_MOST_SIZE_M = 1e6
"""Coordinates beyond are no mesh of a robot, and too large for the arithmetic of distances."""


@dataclass(frozen=True)
class Mesh:
    """A mesh file of a link, and the scale (three factors) that the URDF gives it."""

    link: str
    path: Path
    scale: tuple[float, float, float]


def hulls(urdf: str | Path, meshes: Sequence[Mesh]) -> list[Any]:
    """Return the convex hulls of meshes, as coal's shapes.

    Raises RobotError naming the link and the file of a mesh that cannot be read or is flat.
    """
    if not meshes:
        return []
    seconds = _SECONDS + sum(mesh.path.stat().st_size for mesh in meshes) / _BYTES_PER_SECOND
    wanted = [[mesh.link, str(mesh.path), mesh.scale] for mesh in meshes]
    try:
        options, corners = run_in_child(hull_corners, {"meshes": wanted}, seconds=seconds)
    except ChildError as problem:
        raise RobotError(
            f"collision geometry of '{urdf}' cannot be read: {problem}; repair the mesh, or use a "
            "box, a cylinder or a sphere in its place"
        ) from None
    found = zip(corners.values(), options, strict=True)
    return [coal.Convex.convexHull(_points(one), True, option) for one, option in found]


def hull_corners(meshes: Sequence[tuple[str, str, Sequence[float]]]) -> Answer:
    """Return Qhull's option for, and the corners (C, 3) of, each mesh's hull; runs in the child."""
    loader = coal.MeshLoader()
    options, corners = [], {}
    for place, (link, path, scale) in enumerate(meshes):
        where = f"link '{link}': collision mesh '{path}'"
        doing(where)
        try:
            vertices = np.array(loader.load(path, np.array(scale, dtype=float)).vertices())
        except Exception as problem:  # a reader of fifty formats
            raise RobotError(f"{where} cannot be read: {_reason(problem)}") from None
        option, corners[str(place)] = _corners(where, vertices)
        options.append(option)
    return options, corners


def _corners(where: str, vertices: Array) -> tuple[str, Array]:
    from scipy.spatial import ConvexHull, QhullError

    if not len(vertices) or not np.all(np.abs(vertices) < _MOST_SIZE_M):
        raise RobotError(f"{where} has no corners, or some that are beyond {_MOST_SIZE_M:g} m")
    try:
        # coal's own hull ends the process on flat ones
        corners = vertices[ConvexHull(vertices).vertices]
    except (QhullError, ValueError):
        raise RobotError(
            f"{where} is flat, its convex hull has no volume; use a box or another mesh"
        ) from None
    try:
        coal.Convex.convexHull(_points(corners), True, "Qt")
    except RuntimeError:  # coal takes 255 neighbours of a corner: joggled, it has fewer
        coal.Convex.convexHull(_points(corners), True, "QJ")
        return "QJ", corners
    return "Qt", corners


def _reason(problem: Exception) -> str:
    """Return what coal's message says beside where in coal it was written."""
    _, found, message = str(problem).partition("message: ")
    said = message.splitlines()[1:2] if found else []
    return shortened(said[0], 300) if said else reason_of(problem)


def _points(corners: Array) -> Any:
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    return points
