"""Data, settings and experiment of a page: logs, known values, range of motion, versions."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import numpy as np

from seaid.checks.tolerances import LEAST_DELAY_S
from seaid.drives import IDEAL_DRIVE, Drive, ParameterName, drive_table, readable, total_ratio
from seaid.errors import listed
from seaid.log import Motion, Processing, has_holes, row_samples
from seaid.report import formats
from seaid.report.formats import (
    NONE,
    Cell,
    Column,
    Measured,
    Table,
    figures,
    seconds,
    short,
    table_of,
    words,
)
from seaid.report.tables import measured
from seaid.report.text import exact_text, method_text
from seaid.robot import Robot, at_drives

if TYPE_CHECKING:
    from seaid.estimation import Estimate
    from seaid.excitation import ExcitationMeasures
    from seaid.identification import Identification

_PACKAGES = ("numpy", "scipy", "pin", "sympy")
_SAME = 1e-9

_SENSORS = {
    "motor_torque": "motor torque",
    "joint_torque": "torque at the joint",
    "motor_current": "motor current",
    "motor_voltage": "motor voltage",
    "deflection": "deflection of the spring",
    "motor_temperature": "temperature of the motor",
}


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
        facts = [*_measured(result.known, motion), *_processed(processing)]
        name = f"{kind} {place + 1}" if several else "The log"
        logs.append(LogFacts(name, tuple(facts), tuple(str(r) for r in processing.repairs)))
    return logs


def _measured(robot: Robot, motion: Motion | None) -> Iterator[tuple[str, str]]:
    if motion is None:
        yield "Samples", "read in pieces; the following describes the first one"
        return
    length = float(motion.time[-1] - motion.time[0])
    yield "Samples", f"{len(motion.time)} in {seconds(length)} ({motion.rate_hz:.4g} Hz)"
    yield "Rows per joint", f"{len(row_samples(motion))} after decimation to the cutoff"
    yield "Positions", _positions(robot, motion)
    for field, name in _SENSORS.items():
        values = getattr(motion, field)
        if values is not None:
            logged = np.all(np.isfinite(values), axis=0)
            seen = [j for j, is_logged in zip(robot.joint_names, logged, strict=True) if is_logged]
            if seen:
                yield name.capitalize(), _listed(seen, robot)


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
    # A computed motor position is N C q to rounding, a measured one never.
    off = np.max(np.abs(turned - motion.motor_position), axis=0, initial=0.0)
    both = [j for j, far in zip(robot.joint_names, off > _SAME * scale, strict=True) if far]
    if len(both) == robot.n:
        return "both sides of every joint"
    single = "one side (the other is computed through the stiff gear)"
    if not both:
        return f"every joint: {single}"
    return f"both sides of {_listed(both, robot)}; of the others {single}"


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


def known_table(identification: Identification) -> Table:
    """Return for each joint the known and the identified parameters of its drive."""
    rows = []
    for joint in identification.known.joint_names:
        drive = identification.known.drives[joint]
        estimate = identification.drives.get(joint)
        names = () if estimate is None else estimate.names
        identified = ", ".join(name.replace("_", " ") for name in names)
        rows.append((joint, _known_text(drive), identified or "nothing"))
    caption = "Known and identified parameters of each drive."
    return table_of("known", caption, words("joint", "known", "identified"), rows)


def _known_text(drive: Drive) -> str:
    """Return the known values of a drive: its table without nominal values."""
    if drive == IDEAL_DRIVE:
        return "none: torque known at the joint"
    table = drive_table(drive.without_nominal())
    kind = {"stiff": "stiff", "series_elastic": "series elastic"}[table.pop("type")]
    return "; ".join([kind, *(f"{key} {_plain(value)}" for key, value in table.items())])


def _plain(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain(entry)}" for key, entry in value.items())
    if isinstance(value, list):
        return " + ".join(map(str, value))
    return short(value, 6) if isinstance(value, float) else str(value)


def excitation_table(result: Identification) -> Table | None:
    """Return the motion of every joint within its limits, None for long logs."""
    if not result.motions:
        return None
    robot = result.known
    rows: list[list[Cell | str]] = []
    states = map(np.concatenate, zip(*(m.joint_states for m in result.motions), strict=True))
    whole = robot.joint_states(*states)
    for index, joint in enumerate(robot.joint_names):
        q, v, a = (state[:, index] for state in whole)
        unit = "m" if robot.is_prismatic[index] else "rad"
        lower, upper = float(robot.lower_limits[index]), float(robot.upper_limits[index])
        low, high = float(np.min(q)), float(np.max(q))
        span = upper - lower
        inside = ((low - lower) / span, (high - lower) / span) if 0 < span < np.inf else None
        limits = f" of {short(lower)} … {short(upper)}" if inside else ""
        effort = max(_largest_torque(robot, motion, index) for motion in result.motions)
        torque = robot.drives[joint].joint_units[0]
        rows.append(
            [
                joint,
                Cell(f"{short(low)} … {short(high)}{limits} {unit}", bar=inside),
                _cell(float(np.max(np.abs(v))), float(robot.velocity_limits[index]), f"{unit}/s"),
                f"{short(float(np.max(np.abs(a))))} {unit}/s²",
                _cell(effort, float(robot.effort_limits[index]), torque),
            ]
        )
    heads = ("position", "largest speed", "largest acceleration", "largest torque")
    caption = (
        "Motions used for identification; bars are parts of the limits of the robot file. The "
        "torque is that of the motor, reflected to the joint."
    )
    return table_of("excitation", caption, (*words("joint"), *figures(*heads)), rows)


def measure_facts(named: Sequence[tuple[str, ExcitationMeasures]]) -> list[tuple[str, str]]:
    """Return the measures of motions by name, with the D-efficiency of the first over the second.

    A motion that is the only one has the name "".
    """
    facts = []
    for name, measures in named:
        of = f" of {name}" if name else ""
        drives = ", drives included" if measures.has_drives else ""
        columns = f"{measures.parameters} columns of unit norm{drives}"
        condition = f"{short(measures.scaled_condition_number)} ({columns})"
        facts.append((f"Condition number{of}", condition))
        facts.append((f"D-value{of}", short(measures.d_value)))
    if len(named) == 2:
        (first, old), (second, new) = named
        facts.append(("D-efficiency", f"{short(old.d_efficiency(new))} ({first} over {second})"))
    return facts


def _cell(value: float, limit: float, unit: str) -> Cell:
    """Return a value with its limit, if there is one, and a bar."""
    if not np.isfinite(value):
        return Cell(NONE)
    if not 0 < limit < np.inf:
        return Cell(f"{short(value)} {unit}")
    above = ", above the limit" if value > limit else ""
    return Cell(
        f"{short(value)} of {short(limit)} {unit}{above}", bar=(0.0, min(value / limit, 1.0))
    )


def _largest_torque(robot: Robot, motion: Motion, index: int) -> float:
    """Return the largest torque of a motor at its joint, or of the sensor there; NaN without."""
    drive = robot.drives[robot.joint_names[index]]
    lever = total_ratio(drive)
    both = lever * motion.motor_torque[:, index], motion.joint_torque[:, index]
    known = [float(np.nanmax(np.abs(torque))) for torque in both if np.any(np.isfinite(torque))]
    return known[0] if known else np.nan


def setup_rows(identification: Identification) -> Table:
    """Return delays, gear ratios and encoder offsets: as found by the logs, and as given."""
    rows = [
        row
        for joint in identification.known.joint_names
        for row in (
            *_ratio_row(identification, joint),
            *_delay_rows(identification, joint),
            *_offset_rows(identification, joint),
            *_gear_rows(identification, joint),
        )
    ]
    caption = (
        "Found about sensors and gears, with 95 % intervals, and as given. A delay below "
        f"{1e3 * LEAST_DELAY_S:g} ms may be friction that the model lacks."
    )
    columns = (
        *(*words("joint", "quantity"), Column("found", formats.VALUE)),
        *(Column("95 % interval", formats.INTERVAL), *figures("as given")),
        *(Column("unit", formats.UNIT), *words("how")),
    )
    return table_of("set-up", caption, columns, rows)


_Row = tuple[str | Measured, ...]


def _row(joint: str, quantity: str, found: Measured, given: str, how: str) -> _Row:
    return joint, quantity, found, found if np.isfinite(found.error) else NONE, given, found, how


def _normal(value: float, error: float, unit: str) -> Measured:
    """Return a value with the 95 % interval of a normal distribution."""
    reach = _NORMAL_95 * error
    return Measured(value, error, value - reach, value + reach, unit)


_NORMAL_95 = 1.96


def _ratio_row(identification: Identification, joint: str) -> Iterator[_Row]:
    """Yield the gear ratio of a joint with two encoders."""
    drive, setup = identification.known.drives[joint], identification.setup.get(joint)
    if setup is None or not np.isfinite(setup.gear_ratio):
        return
    known = short(drive.ratio, 7)
    if "gear_ratio" in drive.std:
        known = f"{known} ± {short(drive.std['gear_ratio'], 2)}"
    unit = "rad/m" if getattr(drive, "gear_ratio_rad_per_m", None) else ""
    how = "encoders and motor equation" if drive.is_elastic else "slope between both encoders"
    gap = _gap(setup.gear_ratio - drive.ratio, setup.gear_ratio_error)
    found = _normal(setup.gear_ratio, setup.gear_ratio_error, unit)
    yield _row(joint, "gear ratio", found, known, how + gap)


def _gap(difference: float, error: float, least: float = 0.0) -> str:
    """Return how far from the given value, if it is outside the interval and above `least`."""
    if abs(difference) <= max(_NORMAL_95 * error, least):
        return ""
    return f"; {abs(difference) / error:.1f} standard errors from the given one"


def _delay_rows(identification: Identification, joint: str) -> Iterator[_Row]:
    """Yield the delay of the motor torque, and delays that the description of a log corrects."""
    corrections = {
        quantity: delay_s
        for name, quantity, delay_s in dict.fromkeys(_delays(identification.processing))
        if name == joint
    }
    setup = identification.setup.get(joint)
    if setup is not None and np.isfinite(setup.delay_s) and setup.delay_error_s < _LARGEST_DELAY_S:
        corrected = corrections.pop("motor_torque", 0.0)
        # setup.delay_s remains after the correction by the description: the delay is the sum.
        delay = _normal(1e3 * (corrected + setup.delay_s), 1e3 * setup.delay_error_s, "ms")
        gap = _gap(setup.delay_s, setup.delay_error_s, LEAST_DELAY_S)
        given = short(1e3 * corrected)
        yield _row(joint, "delay of motor torque", delay, given, "torque against the motion" + gap)
    for quantity, delay_s in corrections.items():
        name = f"delay of {quantity.replace('_', ' ')}"
        yield joint, name, NONE, NONE, short(1e3 * delay_s), "ms", "corrected as described"


_LARGEST_DELAY_S = 0.1
"""Standard error of a delay from which the log does not determine it."""


def _offset_rows(identification: Identification, joint: str) -> Iterator[_Row]:
    """Yield what the motor equation says of encoder offsets."""
    drive, estimate = identification.known.drives[joint], identification.drive_side.get(joint)
    if estimate is None:
        return
    if {"spring_offset", "stiffness"} <= set(estimate.names) and "preload" not in drive.spring:
        k, f = estimate.value("stiffness"), estimate.value("spring_offset")
        # without a sensor behind the spring the offset is zero by definition
        if k and estimate.standard_error("spring_offset") > 0:
            both = [estimate.names.index(name) for name in ("spring_offset", "stiffness")]
            # d_0 = -f/k, var(d_0) = g^T C g with g its slopes (the delta method).
            slope = np.array([-1 / k, f / k**2])  # of -f / k
            error = float(np.sqrt(slope @ estimate.covariance[np.ix_(both, both)] @ slope))
            lower, upper = estimate.interval()[both[0]]
            # The 95 % quantile of the estimate, normal or Student's t, from its own interval.
            reach = error * (upper - lower) / (2 * estimate.standard_errors[both[0]])
            offset = Measured(-f / k, error, -f / k - reach, -f / k + reach, drive.spring_units[1])
            how = "force of the spring at deflection zero"
            yield _row(joint, "offset of the deflection", offset, NONE, how)
    yield from _estimated(joint, estimate, {"deflection_zero"}, "motor equation")


def _gear_rows(identification: Identification, joint: str) -> Iterator[_Row]:
    """Yield what the deflection sensor says of the gear."""
    if gear := identification.gears.get(joint):
        yield from _estimated(joint, gear, {*gear.names}, "deflection sensor")


def _estimated(joint: str, estimate: Estimate, names: set[str], how: str) -> Iterator[_Row]:
    for name, found in measured(estimate):
        if name in names:
            yield _row(joint, name.replace("_", " "), found, NONE, how)


def _delays(processing: Sequence[Processing]) -> Iterator[tuple[str, str, float]]:
    """Yield (joint, quantity, delay) of the descriptions by which the logs were read."""
    for log in processing:
        for joint, quantities in dict(log.sources or {}).items():
            for quantity, source in dict(quantities).items():
                delay = source.get("delay_s", 0.0) if hasattr(source, "get") else 0.0
                if delay:
                    yield joint, quantity, float(delay)


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
