"""Data, settings and experiment of a page: logs, known values, range of motion, versions."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import numpy as np

from seaid.drives import IDEAL_DRIVE, JointParameter, drive_table, readable
from seaid.log import has_holes, row_samples
from seaid.report.html_tables import seconds, short
from seaid.report.text import exact_text
from seaid.robot import at_drives

if TYPE_CHECKING:
    from seaid.drives import Drive
    from seaid.identification import Identification
    from seaid.log import Motion, Processing
    from seaid.robot import Robot

_PACKAGES = ("numpy", "scipy", "pin", "sympy")
_SAME = 1e-9

_SENSORS = {
    "motor_torque": "motor torque",
    "joint_torque": "torque at the joint",
    "motor_current": "motor current",
    "motor_voltage": "motor voltage",
    "deflection": "deflection of the spring",
}


@dataclass(frozen=True)
class LogFacts:
    """One log used for identification: (name, text) pairs, and its repairs."""

    name: str
    facts: tuple[tuple[str, str], ...]
    repairs: tuple[str, ...]


@dataclass(frozen=True)
class MotionRange:
    """The range of motion of a joint over all motions used for identification, as text."""

    joint: str
    cells: tuple[str, ...]


def log_facts(found: Identification) -> list[LogFacts]:
    """Return the facts of every log used for identification."""
    several = len(found.processing) > 1
    kind = "Stretch" if has_holes(found.processing) else "Log"
    logs = []
    for place, processing in enumerate(found.processing):
        motion = found.motions[place] if len(found.motions) == len(found.processing) else None
        facts = [*_measured(found.known, motion), *_processed(processing)]
        name = f"{kind} {place + 1}" if several else "The log"
        logs.append(LogFacts(name, tuple(facts), tuple(str(one) for one in processing.repairs)))
    return logs


def _measured(robot: Robot, motion: Motion | None) -> Iterator[tuple[str, str]]:
    if motion is None:
        yield "Samples", "read in pieces; the following describes the first one"
        return
    length = float(motion.time[-1] - motion.time[0])
    yield "Samples", f"{len(motion.time)} in {seconds(length)} ({motion.rate_hz:.4g} Hz)"
    yield "Rows per joint", f"{len(row_samples(motion))} after decimation to the cutoff"
    yield "Positions", _positions(robot, motion)
    for field, words in _SENSORS.items():
        values = getattr(motion, field)
        if values is not None:
            there = np.all(np.isfinite(values), axis=0)
            seen = [j for j, is_there in zip(robot.joint_names, there, strict=True) if is_there]
            if seen:
                yield words.capitalize(), _of(seen, robot)


def _processed(processing: Processing) -> Iterator[tuple[str, str]]:
    band = processing.cutoff_selection
    yield "Cutoff", str(band)
    if np.isfinite(band.noise_limit_hz):
        yield "Noise", f"1 % of the signal of {band.channel} at {band.noise_limit_hz:.3g} Hz"
    if processing.resampled:
        yield "Time", f"{processing.logged_rate_hz:.4g} Hz in uneven steps, resampled by splines"
    low = processing.position_low_pass_hz
    filtered = low < 0.4 * processing.rate_hz
    yield "Position filter", f"below {low:.3g} Hz, zero phase" if filtered else "none"
    yield "Filter transient", f"{processing.transient_s:.2g} s excluded at each end"


def _positions(robot: Robot, motion: Motion) -> str:
    """Return which joints have an encoder on both sides; that of a stiff drive may be computed."""
    ratio = np.array([robot.drives[name].ratio for name in robot.joint_names])
    turned = at_drives(robot.transmission, motion.joint_position) * ratio
    scale = np.max(np.abs(turned), axis=0, initial=0.0)
    off = np.max(np.abs(turned - motion.motor_position), axis=0, initial=0.0)
    both = [j for j, far in zip(robot.joint_names, off > _SAME * scale, strict=True) if far]
    if len(both) == robot.n:
        return "both sides of every joint"
    single = "one side (the other is computed through the stiff gear)"
    if not both:
        return f"every joint: {single}"
    return f"both sides of {_of(both, robot)}; of the others {single}"


def _of(joints: Sequence[str], robot: Robot) -> str:
    if len(joints) == robot.n:
        return f"all {robot.n} joints" if robot.n > 1 else joints[0]
    listed = ", ".join(joints[:12])
    return listed if len(joints) <= 12 else f"{listed} and {len(joints) - 12} more"


def settings_facts(found: Identification) -> list[tuple[str, str]]:
    """Return the settings of the identification and the known bodies."""
    robot = found.known
    facts = [
        ("Torques used on the load side", _of(found.model.torque_joints, robot)),
        ("Cutoff", f"{found.cutoff_hz:.4g} Hz"),
        ("Known loads", "; ".join(_payloads(robot)) or "none"),
        ("Known bodies", ", ".join(robot.known_bodies) or "none"),
        ("Gravity", " ".join(f"{one:.5g}" for one in robot.model.gravity.linear) + " m/s²"),
    ]
    facts += [("Constants", text) for text in exact_text(found)]
    if robot.elastic_joints:
        method = "simultaneous" if "both" in found.checks else "two-step: springs, then the load"
        facts.insert(2, ("Method", method))
    if found.model.absorbed:
        names = [readable(JointParameter(name, joint)) for joint, name, _ in found.model.absorbed]
        facts.append(("Identified in combination with base parameters", ", ".join(names)))
    return facts


def _payloads(robot: Robot) -> Iterator[str]:
    for body, parameters in zip(
        robot.body_names, robot.payload_parameters.reshape(-1, 10), strict=True
    ):
        if parameters[0] > 0:
            x, y, z = parameters[1:4] / parameters[0]
            yield f"{parameters[0]:.4g} kg on {body} at ({x:.4g}, {y:.4g}, {z:.4g}) m"


def known_rows(found: Identification) -> list[tuple[str, str, str]]:
    """Return for each joint the known and the identified parameters of its drive."""
    rows = []
    for joint in found.known.joint_names:
        drive = found.known.drives[joint]
        estimate = found.drives.get(joint)
        names = () if estimate is None else estimate.names
        identified = ", ".join(name.replace("_", " ") for name in names)
        rows.append((joint, _known_text(drive), identified or "nothing"))
    return rows


def _known_text(drive: Drive) -> str:
    """Return the known values of a drive: its table without nominal values."""
    if drive == IDEAL_DRIVE:
        return "none: torque known at the joint"
    table = drive_table(drive.without_nominal())
    kind = {"stiff": "stiff", "series_elastic": "series elastic"}[table.pop("type")]
    return "; ".join([kind, *(f"{key} {_plain(value)}" for key, value in table.items())])


def _plain(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain(one)}" for key, one in value.items())
    if isinstance(value, list):
        return " + ".join(map(str, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def motion_ranges(found: Identification) -> list[MotionRange]:
    """Return the range of motion of every joint, empty for long logs."""
    if not found.motions:
        return []
    limits = zip(found.known.lower_limits, found.known.upper_limits, strict=True)
    rows = []
    for index, (joint, (lower, upper)) in enumerate(
        zip(found.known.joint_names, limits, strict=True)
    ):
        q, v, a = (
            np.concatenate(
                [getattr(motion, f"joint_{state}")[:, index] for motion in found.motions]
            )
            for state in ("position", "velocity", "acceleration")
        )
        unit = "m" if found.known.is_prismatic[index] else "rad"
        cells = (
            f"{short(float(np.min(q)))} … {short(float(np.max(q)))} {unit}",
            f"{short(float(lower))} … {short(float(upper))} {unit}",
            f"{short(float(np.max(np.abs(v))))} {unit}/s",
            f"{short(float(np.max(np.abs(a))))} {unit}/s²",
        )
        rows.append(MotionRange(joint, cells))
    return rows


def versions() -> list[tuple[str, str]]:
    """Return date, system and versions of packages."""
    from seaid import __version__

    rows = [
        ("Written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("seaid", __version__),
        ("Python", platform.python_version()),
        ("System", f"{platform.system()} {platform.release()} on {platform.machine()}"),
    ]
    for name in _PACKAGES:
        try:
            rows.append(("Pinocchio" if name == "pin" else name, version(name)))
        except PackageNotFoundError:
            continue
    return rows
