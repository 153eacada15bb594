"""Shapes: the visual shapes of a URDF as geometry objects, and inertias as ellipsoids."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from seaid._arrays import Array, frozen, safely
from seaid._progress import counted
from seaid.errors import RobotError
from seaid.robot import (
    Robot,
    UrdfTree,
    find_mesh,
    inconsistency,
    search_folders,
    second_moments,
)

Color = tuple[int, int, int]

GREY: Color = (168, 174, 182)
"""Colour of shapes without one in their files."""

_SHARP_RAD = 0.6
"""Angle between faces of STL files above which shading keeps the edge."""


def shape_object(
    name: str, joint: int, placement: pin.SE3, shape: coal.CollisionGeometry, color: Color
) -> pin.GeometryObject:
    """Return an opaque object of one colour on a joint of Pinocchio's model."""
    placed = pin.GeometryObject(name, joint, placement, shape)
    # viser truncates 255 times a channel: half a step keeps what rounding does out of the colour.
    placed.meshColor = np.append((np.array(color) + 0.5) / 255.0, 1.0)
    return placed


def shapes_of(
    urdf: Path,
    tree: UrdfTree,
    places: Mapping[str, tuple[int, pin.SE3]],
    package_dirs: str | Path | Sequence[str | Path] = (),
) -> tuple[list[pin.GeometryObject], dict[str, Any], list[str]]:
    """Return the visual shapes of a valid URDF, and notes on missing or unreadable meshes.

    A mesh is a trimesh.Trimesh by the name of its object, which is its bounding box. `places` has
    the joint and the frame of every link. Meshes are searched in `package_dirs`, the folder of the
    file and those above it. Raises RobotError for a missing folder.
    """
    folders = search_folders(urdf, package_dirs)
    materials = tree.elements.materials
    palette = {m.name: _rgb(m) for m in materials if m.color is not None}
    objects: list[pin.GeometryObject] = []
    meshes: dict[str, Any] = {}
    missing: dict[str, list[str]] = {}
    for link in tree.elements.links:
        joint, placement = places[link.name]
        for visual in link.visuals:
            color = _material_color(visual.material, palette)
            place = placement if visual.origin is None else placement * pin.SE3(visual.origin)
            try:
                parts = list(_parts(visual.geometry, folders))
            except _NoMeshError as problem:
                missing.setdefault(problem.remedy, []).append(f"{problem} (link '{link.name}')")
                continue
            for shape, center, mesh, painted in parts:
                name, at = f"bodies/{len(objects)}", place * pin.SE3(np.eye(3), center)
                objects.append(shape_object(name, joint, at, shape, painted or color))
                if mesh is not None:
                    meshes[name] = mesh
    return objects, meshes, [_missing_text(*entry) for entry in missing.items()]


class _NoMeshError(Exception):
    """A mesh is missing or cannot be read."""

    def __init__(self, text: str, remedy: str) -> None:
        super().__init__(text)
        self.remedy = remedy


def _missing_text(remedy: str, problems: list[str]) -> str:
    """Return one note on the meshes with the same remedy."""
    others = len(dict.fromkeys(problems)) - 1
    more = f", and {counted(others, 'other')} likewise" if others else ""
    return f"{problems[0]}{more}: {remedy}"


def _not_found(name: str) -> _NoMeshError:
    scheme, _, rest = name.rpartition("://")
    option = "with --package-dir (package_dirs=)"
    if scheme == "package":
        package = rest.partition("/")[0]
        remedy = f"name the folder that contains the package '{package}' {option}"
        remedy += ", or set ROS_PACKAGE_PATH"
    elif scheme == "file":
        remedy = "put the file there, or correct the path in the URDF"
    else:
        remedy = f"put it in the folder of the URDF, or name the folder of its path {option}"
    return _NoMeshError(f"mesh '{name}' is not found", remedy)


_CONVERT = "replace it by an STL, OBJ, PLY, glTF or Collada file with triangles"


_Part = tuple[coal.CollisionGeometry, Array, Any, Color | None]
"""A shape, its centre (3,) [m], the mesh about that centre or None, and the colour of its file."""


def _parts(geometry: Any, folders: Sequence[Path]) -> Iterator[_Part]:
    """Yield the shapes of a geometry in the frame of its origin."""
    nowhere = np.zeros(3)
    if geometry.box is not None:
        yield coal.Box(*np.asarray(geometry.box.size, dtype=float)), nowhere, None, None
    elif geometry.sphere is not None:
        yield coal.Sphere(geometry.sphere.radius), nowhere, None, None
    elif geometry.cylinder is not None:
        cylinder = coal.Cylinder(geometry.cylinder.radius, geometry.cylinder.length)
        yield cylinder, nowhere, None, None
    elif geometry.mesh is not None:
        for mesh, painted in _loaded(geometry.mesh, folders):
            center = np.mean(mesh.bounds, axis=0)
            yield coal.Box(*mesh.extents), center, mesh.apply_translation(-center), painted


def _loaded(named: Any, folders: Sequence[Path]) -> Iterator[tuple[Any, Color | None]]:
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # a damaged file makes a note
    path = find_mesh(named.filename, folders)
    if path is None:
        raise _not_found(named.filename)
    try:
        meshes = trimesh.load_scene(path).dump()
        parts = [x for x in meshes if isinstance(x, trimesh.Trimesh) and len(x.faces)]
    except Exception as problem:  # readers of a dozen formats raise any exception
        reason = f"{type(problem).__name__}: {problem}"
        raise _NoMeshError(f"mesh '{path}' cannot be read, {reason}", _CONVERT) from None
    if not parts:
        raise _NoMeshError(f"mesh '{path}' has no triangles", _CONVERT)
    by_color: dict[Color | None, list[Any]] = {}
    for part in parts:
        by_color.setdefault(_painted(part.visual), []).append(part)
    for painted, several in by_color.items():
        mesh: Any = trimesh.util.concatenate(several)
        if path.suffix.lower() == ".stl":  # it has no normals, and its edges were merged
            mesh = trimesh.graph.smooth_shade(mesh, angle=_SHARP_RAD)
        yield mesh.apply_scale(1.0 if named.scale is None else named.scale), painted


def _painted(visual: Any) -> Color | None:
    """Return the main colour of a mesh, None if its file has none."""
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    color = visual.main_color if material is None else material.main_color
    return None if color is None else _color(color[:3])


def _material_color(material: Any, palette: Mapping[str, Color]) -> Color:
    if material is None:
        return GREY
    return _rgb(material) if material.color is not None else palette.get(material.name, GREY)


def _rgb(material: Any) -> Color:
    return _color(np.clip(np.asarray(material.color.rgba[:3], dtype=float), 0.0, 1.0) * 255)


def _color(values: Any) -> Color:
    red, green, blue = (round(float(value)) for value in values)
    return red, green, blue


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The solid ellipsoid of uniform density with the mass and the inertia of a body.

    In the frame of its `joint` of Pinocchio's model: `center` of mass (3,) [m], `semi_axes` (3,)
    [m], and their directions as columns of `rotation` (3, 3). With the pseudo-inertia
    [[S, h], [h^T, m]] the second moments about the centre of mass are S_c = S - h h^T / m, and
    those of a uniform solid ellipsoid are S_c = m/5 R diag(a^2) R^T. The semi-axes are therefore
    a_i = sqrt(5 lambda_i / m), where lambda_i are the eigenvalues of S_c; by principal moments,
    a_i^2 = 5/(2m) (I_j + I_k - I_i).

    A physically inconsistent body has no such ellipsoid: `problem` says why, and `semi_axes` are
    zero. Its `center` is the origin of the body if its mass is not positive.
    """

    joint: int
    name: str
    mass: float
    center: Array
    rotation: Array
    semi_axes: Array
    problem: str | None = None


def joints_of_bodies(robot: Robot) -> list[int]:
    """Return the joint of `robot.model` that moves each body of `body_names`."""
    joints = [robot.model.getJointId(name) for name in robot.all_joint_names]
    # A floating base is the last body and has no joint: it is the base of the picture.
    return [*joints, 0][: len(robot.body_names)]


def ellipsoids_of(robot: Robot) -> tuple[Ellipsoid, ...]:
    """Return the ellipsoids of the bodies with known parameters, without payloads."""
    bodies = (joints_of_bodies(robot), robot.body_names, robot.parameters.reshape(-1, 10))
    return tuple(
        _ellipsoid(joint, name, ten)
        for joint, name, ten in zip(*bodies, strict=True)
        if np.all(np.isfinite(ten)) and np.any(ten)
    )


def _ellipsoid(joint: int, name: str, parameters: Array) -> Ellipsoid:
    mass, problem = float(parameters[0]), inconsistency(parameters)
    center = parameters[1:4] / mass if mass > 0 else np.zeros(3)
    rotation, semi_axes = np.eye(3), np.zeros(3)
    if problem is None:
        what, second = f"the inertia of '{name}'", second_moments(parameters)
        moments, rotation = safely(np.linalg.eigh, second, what=what, error=RobotError)
        semi_axes = np.sqrt(5.0 * np.maximum(moments, 0.0) / mass)
        rotation[:, 2] = np.cross(rotation[:, 0], rotation[:, 1])  # no mirror image
    return Ellipsoid(
        joint,
        name,
        mass,
        frozen("center", center, (3,)),
        frozen("rotation", rotation, (3, 3)),
        frozen("semi_axes", semi_axes, (3,)),
        problem,
    )
