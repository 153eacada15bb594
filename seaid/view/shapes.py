"""What the links of a URDF look like: meshes and primitive shapes as triangles with a colour."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, IndexArray
from seaid.mesh_files import find_mesh, search_folders

Color = tuple[int, int, int]

GREY: Color = (168, 174, 182)
"""Of what has no colour in its files."""

_SHARP_RAD = 0.6
"""Faces of STL files that meet at more than this keep an edge between them when shaded."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles of one colour on a link: `vertices` (V, 3) [m] in its body's frame, `faces` (F, 3).

    `body` is 0 for the base, i + 1 for what joint i of the robot moves; `color` is red, green, blue
    of 0 to 255.
    """

    link: str
    body: int
    vertices: Array
    faces: IndexArray
    color: Color


def shapes_of(
    urdf: Path,
    places: Mapping[str, tuple[int, pin.SE3]],
    package_dirs: str | Path | Sequence[str | Path] = (),
) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Return the visual shapes of a URDF that loads, and notes on what could not be shown.

    `places` has the body and the placement on it of every link. Meshes are searched in
    `package_dirs`, the folder of the file and those above it; one that is not found or not read
    makes a note. Raises RobotError for a folder that is not there.
    """
    folders = search_folders(urdf, package_dirs)
    robot = _parsed(urdf)
    palette = {one.name: _rgb(one) for one in robot.materials if one.color is not None}
    shapes: list[Shape] = []
    missing: dict[str, str] = {}
    for link in robot.links:
        body, placement = places[link.name]
        for visual in link.visuals:
            wanted = _own_color(visual.material, palette)
            try:
                parts = list(_parts(visual.geometry, folders))
            except _NoMeshError as problem:
                missing[str(problem)] = link.name
                continue
            origin = np.eye(4) if visual.origin is None else visual.origin
            whole = placement.homogeneous @ origin
            for mesh, painted in parts:
                color = painted or wanted or GREY
                shapes.append(_shape(link.name, body, mesh.apply_transform(whole), color))
    notes = tuple(f"{problem} (link '{link}')" for problem, link in missing.items())
    return tuple(shapes), notes


class _NoMeshError(Exception):
    """A mesh that is not there or cannot be read."""


def _parsed(urdf: Path) -> Any:
    """Return yourdfpy's reading of a file that load_robot has checked."""
    from io import BytesIO

    from lxml import etree
    from yourdfpy import URDF

    logging.getLogger("yourdfpy.urdf").setLevel(logging.ERROR)
    root = etree.parse(str(urdf), etree.XMLParser(remove_comments=True)).getroot()
    root.set("name", root.get("name") or urdf.stem)
    text = BytesIO(etree.tostring(root))
    return URDF.load(text, build_scene_graph=False, load_meshes=False).robot


def _shape(link: str, body: int, mesh: Any, color: Color) -> Shape:
    vertices = np.array(mesh.vertices, dtype=np.float64)
    faces = np.array(mesh.faces, dtype=np.intp)
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return Shape(link, body, vertices, faces, color)


def _parts(geometry: Any, folders: Sequence[Path]) -> Iterator[tuple[Any, Color | None]]:
    """Yield meshes of a geometry, each with the colour that its file gives it."""
    import trimesh

    if geometry.box is not None:
        yield trimesh.creation.box(np.asarray(geometry.box.size, dtype=float)), None
    elif geometry.sphere is not None:
        yield trimesh.creation.icosphere(3, radius=geometry.sphere.radius), None
    elif geometry.cylinder is not None:
        cylinder = geometry.cylinder
        yield trimesh.creation.cylinder(radius=cylinder.radius, height=cylinder.length), None
    elif geometry.mesh is not None:
        yield from _loaded(geometry.mesh, folders)


def _loaded(named: Any, folders: Sequence[Path]) -> Iterator[tuple[Any, Color | None]]:
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # a damaged file makes a note
    path = find_mesh(named.filename, folders)
    if path is None:
        raise _NoMeshError(f"mesh '{named.filename}' is not found")
    try:
        parts = [one for one in trimesh.load_scene(path).dump() if isinstance(one, trimesh.Trimesh)]
    except Exception as problem:  # readers of a dozen formats let whatever they meet through
        reason = f"{type(problem).__name__}: {problem}"
        raise _NoMeshError(f"mesh '{path}' cannot be read, {reason}") from None
    if not any(len(part.faces) for part in parts):
        raise _NoMeshError(f"mesh '{path}' has no triangles")
    scale = np.eye(4)
    scale[:3, :3] *= 1.0 if named.scale is None else named.scale
    for part in parts:
        painted = _painted(part.visual)
        if path.suffix.lower() == ".stl":  # it has no normals, and its edges were merged
            part = trimesh.graph.smooth_shade(part, angle=_SHARP_RAD)
        yield part.apply_transform(scale), painted


def _painted(visual: Any) -> Color | None:
    """Return the main colour of a mesh, None where its file has none."""
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    color = visual.main_color if material is None else material.main_color
    return None if color is None else _color(color[:3])


def _own_color(material: Any, palette: Mapping[str, Color]) -> Color | None:
    if material is None:
        return None
    return _rgb(material) if material.color is not None else palette.get(material.name)


def _rgb(material: Any) -> Color:
    return _color(np.clip(np.asarray(material.color.rgba[:3], dtype=float), 0.0, 1.0) * 255)


def _color(values: Any) -> Color:
    red, green, blue = (round(float(value)) for value in values)
    return red, green, blue
