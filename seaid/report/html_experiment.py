"""Data, settings and experiment of a page: logs, known values, range of motion, versions."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.checks.tolerances import LEAST_DELAY_S
from seaid.drives import IDEAL_DRIVE, Drive, ParameterName, drive_table, readable, total_ratio
from seaid.errors import listed
from seaid.log import Motion, Processing, has_holes, row_samples
from seaid.report.formats import NONE, Measured, Table, seconds, short, table_of
from seaid.report.tables import measured
from seaid.report.text import exact_text, method_text
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.estimation import Estimate
    from seaid.identification import Identification

_PACKAGES = ("numpy", "scipy", "pin", "sympy")

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
        facts = [*_measured(result.known, motion), ("Processing", str(processing))]
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
    for field, name in _SENSORS.items():
        values = getattr(motion, field)
        if values is not None:
            logged = np.all(np.isfinite(values), axis=0)
            if np.any(logged):
                yield name.capitalize(), _listed(list(compress(robot.joint_names, logged)), robot)


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


def excitation_table(result: Identification) -> Table:
    """Return the motion of every joint within its limits, without rows for long logs."""
    robot = result.known
    columns = {
        "joint": "words",
        "position": "figure",
        "of its range": "share with bar",
        "largest speed": "figure",
        "of the speed limit": "share with bar",
        "largest acceleration": "figure",
        "largest torque": "figure",
        "of the torque limit": "share with bar",
    }
    caption = (
        "Motions used for identification, and limits of the robot file. The torque is that of the "
        "motor, reflected to the joint."
    )
    if not result.motions:
        return table_of("excitation", caption, columns, ())
    rows = zip(robot.joint_names, *_used(robot, result.motions), strict=True)
    return table_of("excitation", caption, columns, rows)


def _used(robot: Robot, motions: Sequence[Motion]) -> Iterator[list[str] | Array]:
    """Yield the columns of the table of excitation behind the names of the joints."""
    states = map(np.concatenate, zip(*(motion.joint_states for motion in motions), strict=True))
    q, *derivatives = robot.joint_states(*states)
    units = ["m" if slides else "rad" for slides in robot.is_prismatic]
    low, high = q.min(axis=0), q.max(axis=0)
    ends = zip(low.tolist(), high.tolist(), units, strict=True)
    yield [f"{short(first)} … {short(last)} {unit}" for first, last, unit in ends]
    yield _over(high - low, robot.upper_limits - robot.lower_limits)
    speed, acceleration = (np.max(np.abs(x), axis=0) for x in derivatives)
    yield _with_units(speed, [f"{unit}/s" for unit in units])
    yield _over(speed, robot.velocity_limits)
    yield _with_units(acceleration, [f"{unit}/s²" for unit in units])
    torque = np.concatenate([_torque(robot, motion) for motion in motions])
    effort = np.max(np.nan_to_num(np.abs(torque)), axis=0)
    effort[effort == 0] = np.nan  # a torque that is in no log
    yield _with_units(effort, [drive.joint_units[0] for drive in robot.drives.values()])
    yield _over(effort, robot.effort_limits)


def _over(value: Array, limit: Array) -> Array:
    """Return values (n,) over their limits, NaN without one."""
    return np.where((limit > 0) & np.isfinite(limit), value / np.where(limit > 0, limit, 1), np.nan)


def _with_units(values: Array, units: Sequence[str]) -> list[str]:
    texts = zip(values.tolist(), units, strict=True)
    return [f"{short(value)} {unit}" if np.isfinite(value) else NONE for value, unit in texts]


def _torque(robot: Robot, motion: Motion) -> Array:
    """Return the torques (T, n) of motors at their joints, or of the sensors there."""
    levers = np.array([total_ratio(drive) for drive in robot.drives.values()])
    motor = levers * motion.motor_torque
    return np.where(np.any(np.isfinite(motor), axis=0), motor, motion.joint_torque)


def setup_table(identification: Identification) -> Table:
    """Return delays, gear ratios and encoder offsets: as found by the logs, and as given."""
    columns = {
        "joint": "words",
        "quantity": "parameter",
        "found": "value",
        "95 % interval": "interval",
        "as given": "given",
        "unit": "unit",
        "off by [s.e.]": "off",
    }
    rows = [
        (joint, quantity, *[found] * (len(columns) - 2))
        for joint in identification.known.joint_names
        for quantity, found in _found_about(identification, joint)
    ]
    caption = (
        "Found about sensors and gears, and as given: ratios by both encoders, delays by torques "
        "against the motion, offsets by the force of the spring. A delay below "
        f"{1e3 * LEAST_DELAY_S:g} ms may be friction that the model lacks."
    )
    return table_of("set-up", caption, columns, rows)


def _found_about(identification: Identification, joint: str) -> Iterator[tuple[str, Measured]]:
    """Yield the quantities of the set-up of a joint that its logs determine."""
    drive, setup = identification.known.drives[joint], identification.setup.get(joint)
    corrections = dict(_delays(identification.processing, joint))
    if setup is not None and np.isfinite(setup.gear_ratio):
        unit = "rad/m" if getattr(drive, "gear_ratio_rad_per_m", None) else ""
        yield "gear ratio", _normal(setup.gear_ratio, setup.gear_ratio_error, unit, drive.ratio)
    if setup is not None and np.isfinite(setup.delay_s) and setup.delay_error_s < _LARGEST_DELAY_S:
        corrected = 1e3 * corrections.pop("motor_torque", 0.0)
        # setup.delay_s remains after the correction by the description: the delay is the sum.
        delay = corrected + 1e3 * setup.delay_s
        yield "delay of motor torque", _normal(delay, 1e3 * setup.delay_error_s, "ms", corrected)
    for quantity, delay_s in corrections.items():
        yield f"delay of {quantity}", _normal(np.nan, np.nan, "ms", 1e3 * delay_s)
    if joint in identification.drive_side:
        yield from _offsets(drive, identification.drive_side[joint])
    if gear := identification.gears.get(joint):
        yield from measured(gear)


_LARGEST_DELAY_S = 0.1
"""Standard error of a delay from which the log does not determine it."""


def _normal(value: float, error: float, unit: str, given: float) -> Measured:
    """Return a value with the 95 % interval of a normal distribution."""
    reach = _NORMAL_95 * error
    return Measured(value, error, value - reach, value + reach, unit, given)


_NORMAL_95 = 1.96


def _offsets(drive: Drive, estimate: Estimate) -> Iterator[tuple[str, Measured]]:
    """Yield what the motor equation says of encoder offsets."""
    names = estimate.names
    if "deflection_zero" in names:
        yield from measured(estimate.of_names(["deflection_zero"]))
    if not {"spring_offset", "stiffness"} <= set(names) or "preload" in drive.spring:
        return
    k, f = estimate.value("stiffness"), estimate.value("spring_offset")
    both = [names.index(name) for name in ("spring_offset", "stiffness")]
    offset_error = estimate.standard_errors[both[0]]
    # Without a sensor behind the spring the offset is zero by definition.
    if k and offset_error > 0:
        # d_0 = -f/k, var(d_0) = g^T C g with g its slopes (the delta method).
        slope = np.array([-1 / k, f / k**2])
        error = float(np.sqrt(slope @ estimate.covariance[np.ix_(both, both)] @ slope))
        lower, upper = estimate.interval()[both[0]]
        # The 95 % quantile of the estimate, normal or Student's t, from its own interval.
        reach = error * (upper - lower) / (2 * offset_error)
        zero = Measured(-f / k, error, -f / k - reach, -f / k + reach, drive.spring_units[1])
        yield "offset of the deflection", zero


def _delays(processing: Sequence[Processing], joint: str) -> Iterator[tuple[str, float]]:
    """Yield (quantity, delay) of a joint in the descriptions by which the logs were read."""
    for log in processing:
        for quantity, source in dict((log.sources or {}).get(joint, {})).items():
            delay_s = source.get("delay_s", 0.0) if hasattr(source, "get") else 0.0
            if delay_s:
                yield quantity, float(delay_s)


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
