"""What a result rests on: versions, inputs with their digests, options, logs and settings.

The origin is plain data, which is saved with a run. A page has facts: texts by their names.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seaid.drives import IDEAL_DRIVE, ParameterName, drive_table, readable
from seaid.errors import listed
from seaid.report.text import exact_text, has_holes, method_text
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification import Identification

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


# Data and settings


@dataclass(frozen=True)
class LogFacts:
    """One log used for identification: (name, text) pairs, and its repairs."""

    name: str
    facts: tuple[tuple[str, str], ...]
    repairs: tuple[str, ...]


def log_facts(result: Identification) -> list[LogFacts]:
    """Return the facts of every log used for identification."""
    several = len(result.processing) > 1
    kind = "Stretch" if has_holes(result.processing) else "Log"
    logs = []
    for place, processing in enumerate(result.processing):
        motion = result.motions[place] if len(result.motions) == len(result.processing) else None
        samples = "read in pieces; not kept" if motion is None else repr(motion)
        facts = [("Samples", samples), ("Processing", str(processing))]
        name = f"{kind} {place + 1}" if several else "The log"
        logs.append(LogFacts(name, tuple(facts), tuple(str(r) for r in processing.repairs)))
    return logs


def _listed(joints: Sequence[str], robot: Robot) -> str:
    if len(joints) == robot.n:
        return f"all {robot.n} joints" if robot.n > 1 else joints[0]
    return listed(joints, 12)


def settings_facts(result: Identification) -> list[tuple[str, str]]:
    """Return the settings of the identification and the known bodies."""
    robot = result.known
    facts = [
        ("Torques used on the load side", _listed(result.model.torque_joints, robot)),
        ("Cutoff", f"{result.cutoff_hz:.4g} Hz"),
        ("Method", method_text(result)),
        ("Known loads", "; ".join(_payloads(robot)) or "none"),
        ("Known bodies", ", ".join(robot.known_bodies) or "none"),
        ("Gravity", " ".join(f"{g:.5g}" for g in robot.model.gravity.linear) + " m/s²"),
    ]
    facts += [("Constants", text) for text in exact_text(result)]
    if result.model.absorbed:
        names = [readable(ParameterName(name, joint)) for joint, name, _ in result.model.absorbed]
        facts.append(("Identified in combination with base parameters", ", ".join(names)))
    return facts


def _payloads(robot: Robot) -> Iterator[str]:
    for body, parameters in zip(
        robot.body_names, robot.payload_parameters.reshape(-1, 10), strict=True
    ):
        if parameters[0] > 0:
            x, y, z = parameters[1:4] / parameters[0]
            yield f"{parameters[0]:.4g} kg on {body} at ({x:.4g}, {y:.4g}, {z:.4g}) m"


def known_drives(identification: Identification) -> str:
    """Return the drives file of what was known, without nominal values; empty for ideal drives."""
    import tomli_w

    drives = {
        joint: drive_table(drive.without_nominal())
        for joint, drive in identification.known.drives.items()
        if drive != IDEAL_DRIVE
    }
    return tomli_w.dumps(drives).rstrip()
