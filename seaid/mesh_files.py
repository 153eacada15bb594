"""Where the meshes of a URDF are: package://, file:// and plain names, searched in folders."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from seaid.errors import RobotError
from seaid.files import real_path


def search_folders(urdf: Path, package_dirs: str | Path | Sequence[str | Path]) -> list[Path]:
    """Return where meshes are searched: the folders given, that of the file and its parents.

    Raises RobotError for a folder that is not there.
    """
    several = [package_dirs] if isinstance(package_dirs, str | Path) else package_dirs
    given = [real_path(folder) for folder in several]
    for folder in given:
        if not os.path.isdir(folder):
            raise RobotError(f"package_dirs: there is no folder '{folder}'")
    return [*given, *real_path(urdf).parents]


def find_mesh(name: str, folders: Sequence[Path]) -> Path | None:
    """Return the file of a mesh under the name that a URDF has for it, None if it is not there."""
    candidates = (path for path in _candidates(name, folders) if os.path.isfile(path))
    return next(candidates, None)


def _candidates(name: str, folders: Sequence[Path]) -> Iterator[Path]:
    """Yield where a mesh may be; a folder given may be that of its package itself."""
    scheme, _, rest = name.rpartition("://")
    if scheme == "file":
        yield Path(rest)
        return
    rest = rest.lstrip("/") if scheme else rest
    package, _, inside = rest.partition("/")
    for folder in folders:
        yield folder / rest
        if scheme and folder.name == package:
            yield folder / inside
