"""The origin of a result: versions, inputs with their digests, options and command line.

It is plain data, which is saved with a run; a page has it as facts, texts by their names.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_PACKAGES = ("numpy", "scipy", "pin", "sympy")


def package_versions() -> dict[str, str]:
    """Return the versions of seaid, of Python, and of the packages on which results rest."""
    from seaid import __version__

    versions = {"seaid": __version__, "python": platform.python_version()}
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


def system_name() -> str:
    """Return the operating system and the kind of machine."""
    return f"{platform.system()} {platform.release()} on {platform.machine()}"


def versions() -> list[tuple[str, str]]:
    """Return date, system and versions of packages."""
    written = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    names = {"python": "Python", "pin": "Pinocchio"}
    packages = [(names.get(name, name), number) for name, number in package_versions().items()]
    return [("Written", written), ("System", system_name()), *packages]


_DIGEST = 12
"""Characters of a digest that people read."""


def provenance_of(
    files: Iterable[Path], options: Mapping[str, Any], command: Sequence[str]
) -> dict[str, Any]:
    """Return the origin of a result as plain data."""
    return {
        "time_utc": datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "command": list(command),
        "system": system_name(),
        "versions": package_versions(),
        "inputs": [digest for path in files for digest in _digests(path)],
        "options": dict(options),
    }


def _digests(path: Path) -> Iterator[dict[str, Any]]:
    """Yield path, size and SHA-256 of a file, or of all files of a folder (a bag)."""
    members = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
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
    for place, entry in enumerate(provenance.get("inputs", ()), 1):
        size = "" if entry["bytes"] is None else f", {entry['bytes']} bytes"
        digest = "" if entry["sha256"] is None else f", SHA-256 {entry['sha256'][:_DIGEST]}…"
        facts[f"Input {place}"] = f"{entry['path']}{size}{digest}"
    for name, value in provenance.get("options", {}).items():
        if isinstance(value, Mapping):
            value = [f"{key} {number}" for key, number in value.items()]
        text = ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
        facts[name.replace("_", " ").capitalize()] = text
    return facts


def changed_inputs(provenance: Mapping[str, Any]) -> list[str]:
    """Return the names of inputs whose content is another now than when the result was made."""
    return [
        Path(entry["path"]).name
        for entry in provenance.get("inputs", ())
        if entry["sha256"] is not None
        and Path(entry["path"]).is_file()
        and entry["sha256"] != next(_digests(Path(entry["path"])))["sha256"]
    ]
