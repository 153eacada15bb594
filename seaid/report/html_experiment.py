"""Data and settings of a page: logs, known values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seaid.drives import IDEAL_DRIVE, ParameterName, drive_table, readable
from seaid.errors import listed
from seaid.log import has_holes
from seaid.report.text import exact_text, method_text
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification import Identification


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
        ("Known loads", "; ".join(_payloads(robot)) or "none"),
        ("Known bodies", ", ".join(robot.known_bodies) or "none"),
        ("Gravity", " ".join(f"{g:.5g}" for g in robot.model.gravity.linear) + " m/s²"),
    ]
    facts += [("Constants", text) for text in exact_text(result)]
    if robot.elastic_joints:
        facts.insert(2, ("Method", method_text(result)))
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
