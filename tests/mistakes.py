"""Set-ups with mistakes: logs with a changed channel, what is found first, and its repair."""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

import seaid
from seaid._arrays import Array
from seaid.drives import drive_table
from seaid.drives.toml import drives_from_mapping
from seaid.errors import Finding
from seaid.log import Log, Motion
from seaid.log.repair.channels import unwrapped
from seaid.robot import Robot
from tests.experiments import TEST_MASS, arm, arm_log, leg, leg_log

CASES: dict[str, tuple[Callable[[], Robot], Callable[..., Log]]] = {
    "leg": (lambda: leg(TEST_MASS), leg_log),
    "arm": (arm, arm_log),
}


def changed(log: Log, factors: Mapping[str, Array | float]) -> Log:
    found: dict[str, Any] = {name: getattr(log, name) * by for name, by in factors.items()}
    return replace(log, **found)


def of_joint(log: Log, j: int, **factors: float) -> Log:
    """Return the log with channels of joint j multiplied by factors."""
    own = np.arange(len(log.joint_names)) == j
    return changed(log, {name: np.where(own, by, 1.0) for name, by in factors.items()})


Recorded = TypeVar("Recorded", Log, Motion)


def with_channels(recorded: Recorded, joint: str, **changes: Callable[[Array], Array]) -> Recorded:
    """Return a log or a motion with channels of a joint that are functions of what they were."""
    columns: dict[str, Any] = {name: getattr(recorded, name).copy() for name in changes}
    for name, change in changes.items():
        channel = columns[name][:, recorded.joint_names.index(joint)]
        channel[:] = change(channel)
    return replace(recorded, **columns)


def unlogged(log: Log, *channels: str) -> Log:
    """Return the log without some channels."""
    nothing: dict[str, Any] = dict.fromkeys(channels, np.full_like(log.joint_position, np.nan))
    return replace(log, **nothing)


def in_currents(log: Log, constants: Array | float) -> Log:
    """Return the log with motor currents in place of torques, by torque constants [N m/A]."""
    return replace(unlogged(log, "motor_torque"), motor_current=log.motor_torque / constants)


def with_torque(joint: str, more: Array | float) -> Log:
    """Return the log of the leg with a motor that needs more torque for the same motion."""
    return with_channels(leg_log(3), joint, motor_torque=lambda x: x + more)


def worst(robot: Robot, *logs: Log) -> Finding:
    warnings = seaid.check(robot, list(logs)).warnings
    assert warnings
    return warnings[0]


def described(log: Log, remedy: str, number: int = 0) -> Log:
    """Return the log as a description reads it, applied without a file."""
    first, text = remedy.split("\n", 1)
    assert first == f"in the description of {f'log {number}' if number else 'the log'}:"
    columns = log.columns()
    found: dict[str, Any] = {name: x.copy() for name, x in log.sensors().items()}
    for joint, entries in tomllib.loads(text)["joints"].items():
        for quantity, source in entries.items():
            factor = source.get("sign", 1) * source.get("scale", 1.0)
            column = columns[source["column"]]
            if "wraps" in source:
                column = unwrapped(quantity, log.time, column, source["wraps"])[0]
            values = factor * column + source.get("offset", 0.0)
            found[quantity][:, log.joint_names.index(joint)] = values
    return replace(log, **found)


def repaired(robot: Robot, log: Log, remedy: str) -> tuple[Robot, Log]:
    """Return a robot and a log with the lines of a remedy, of the drives file or of the log."""
    head, text = remedy.split("\n", 1)
    if not head.endswith("in the drives file:"):
        return robot, described(log, remedy)
    tables = {
        joint: {**drive_table(robot.drives[joint]), **lines}
        for joint, lines in tomllib.loads(text).items()
    }
    return robot.with_drives(drives_from_mapping(tables)), log


def lines_of(finding: Finding, joint: str) -> dict[str, Any]:
    """Return the lines that the remedy of a finding has for a joint."""
    lines = finding.remedy.partition("\n")[2]
    # the description of a log comes before the drives file
    tables = tomllib.loads(lines.partition("\nin the drives file:")[0])
    return dict(tables.get("joints", tables)[joint])


@dataclass(frozen=True)
class Planted:
    """A robot and a log with one mistake, and what is found of it.

    `found` is the code, the severity and the joint. Expected values may be approximate: those of
    the lines that the remedy has for the joint, and of the joint's estimates after the repair.
    """

    make: Callable[[], tuple[Robot, Log]]
    found: tuple[str, str, str]
    lines: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, Any] = field(default_factory=dict)
    beside: tuple[str, ...] = ()
    """Codes of findings that may stand beside it."""


def check_planted(planted: Planted) -> tuple[Finding, seaid.Identification, seaid.Identification]:
    """Check that a mistake is the only finding above a note, and that its remedy repairs it.

    Returns
    -------
    finding, before, after
        The finding, and the identifications before and after the repair.
    """
    robot, log = planted.make()
    before = seaid.identify(robot, log)
    above = (x for x in before.warnings if x.severity != "note")
    (finding,) = (x for x in above if x.code not in planted.beside)
    joint = finding.joint
    assert (finding.code, finding.severity, joint) == planted.found
    lines = lines_of(finding, joint) if planted.lines else {}
    assert {name: lines.get(name) for name in planted.lines} == planted.lines
    after = seaid.identify(*repaired(robot, log, finding.remedy))
    assert after.verdict.level == "good", after.warnings
    assert {x: after.drives[joint].value(x) for x in planted.values} == planted.values
    return finding, before, after
