"""Where a result comes from: versions, inputs with their digests, options, command line, time."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_PACKAGES = ("numpy", "scipy", "pin", "sympy")
_DIGEST = 12
"""Characters of a digest that people read."""


def provenance_of(
    files: Iterable[Path], options: Mapping[str, Any], command: Sequence[str]
) -> dict[str, Any]:
    """Return the origin of a result as plain data."""
    from seaid import __version__

    versions = {"seaid": __version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "time_utc": datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "command": list(command),
        "system": f"{platform.system()} {platform.release()} on {platform.machine()}",
        "versions": versions,
        "inputs": [one for path in files for one in _digests(path)],
        "options": dict(options),
    }


def _digests(path: Path) -> Iterator[dict[str, Any]]:
    """Yield path, size and SHA-256 of a file, or of all files of a folder (a bag)."""
    members = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
    for member in members:
        try:
            with member.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            yield {"path": str(member.resolve()), "bytes": member.stat().st_size, "sha256": digest}
        except OSError:  # the name of a robot, or removed since it was read
            yield {"path": str(member), "bytes": None, "sha256": None}


def facts_of(provenance: Mapping[str, Any]) -> dict[str, str]:
    """Return the origin as facts {name: text} of a report."""
    facts = {}
    if provenance.get("command"):
        facts["Command"] = " ".join(provenance["command"])
    for place, one in enumerate(provenance.get("inputs", ()), 1):
        size = "" if one["bytes"] is None else f", {one['bytes']} bytes"
        digest = "" if one["sha256"] is None else f", SHA-256 {one['sha256'][:_DIGEST]}…"
        facts[f"Input {place}"] = f"{one['path']}{size}{digest}"
    for name, value in provenance.get("options", {}).items():
        facts[name.replace("_", " ").capitalize()] = str(value)
    return facts


def changed_inputs(provenance: Mapping[str, Any]) -> list[str]:
    """Return the names of inputs whose content is another now than when the result was made."""
    return [
        Path(one["path"]).name
        for one in provenance.get("inputs", ())
        if one["sha256"] is not None
        and Path(one["path"]).is_file()
        and one["sha256"] != next(_digests(Path(one["path"])))["sha256"]
    ]
