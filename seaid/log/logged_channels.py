"""The channels of a log with their sources in its description, and how these change.

A source is the column of a quantity, or its entry in the description, as plain data: what a log was
read by, and what a remedy writes anew.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, is_constant
from seaid.drives import total_ratio
from seaid.log.description import changed_source

if TYPE_CHECKING:
    from seaid.log.log import Log
    from seaid.log.motion import Motion
    from seaid.robot import Robot

Source = str | Mapping[str, Any]
"""How a quantity was read: its column, or its entry in the description of a log."""

Sources = Mapping[str, Mapping[str, Source]]
"""{joint: {quantity: its source}}."""


@dataclass(frozen=True, eq=False)
class Channel:
    """The samples (T,) of a quantity of a joint, and the `source` in which the log has them."""

    joint: str
    quantity: str
    values: Array
    source: Source | None

    @property
    def words(self) -> str:
        """The quantity in words."""
        return self.quantity.replace("_", " ")

    @property
    def entry(self) -> Mapping[str, Any]:
        """The entry of the description, empty for a column alone."""
        return self.source if isinstance(self.source, Mapping) else {}

    def changed(self, **changes: float) -> Source:
        """Return the source with the changes of `changed_source`."""
        return changed_source(self.source or "", **changes)

    @property
    def scale(self) -> float:
        """The factor on the column."""
        return float(self.entry.get("scale", 1.0))

    @property
    def largest(self) -> float:
        """The largest size of a sample."""
        return float(np.max(np.abs(self.values)))


def channels_of(log: Log, joints: Collection[str], *quantities: str) -> Iterator[Channel]:
    """Yield the channels of joints whose samples are all known, and change."""
    sources = log.sources()
    for quantity in (name for name in quantities if getattr(log, name) is not None):
        for joint, values in zip(log.joint_names, getattr(log, quantity).T, strict=True):
            if joint in joints and np.all(np.isfinite(values)) and not is_constant(values):
                yield Channel(joint, quantity, values, sources[joint].get(quantity))


def sources_of(motions: Sequence[Motion]) -> Sources:
    """Return the sources of the channels of a log {joint: {quantity: source}}."""
    processing = motions[0].processing
    return {} if processing is None else processing.sources or {}


def moved_zeros(
    robot: Robot, angles: Mapping[str, float], sources: Sources, reverses: Collection[str] = ()
) -> Sources:
    """Return the `sources` that change if angles are added to the zeros of joints.

    The zeros of the motors that turn these joints, and commands, move along; the positions and
    commands of joints that are `reverses` change their sign.
    """
    added = [angles.get(joint, 0.0) for joint in robot.joint_names]
    # theta_M = N r_L / r_M phi, phi = C q: the zero of a joint moves all motors that turn it.
    turned = robot.transmission @ added * [total_ratio(drive) for drive in robot.drives.values()]
    entries: dict[str, dict[str, Source]] = {}
    for joint, angle, of_motor in zip(robot.joint_names, added, turned.tolist(), strict=True):
        factor = -1.0 if joint in reverses else 1.0
        offsets = dict.fromkeys(("joint_position", "position_command"), angle)
        offsets |= {"motor_position": of_motor, "velocity_command": 0.0, "torque_command": 0.0}
        for quantity, offset in offsets.items():
            source = sources.get(joint, {}).get(quantity)
            if source and (offset or factor < 0):
                changed = changed_source(source, factor=factor, offset=round(offset, 5))
                entries.setdefault(joint, {})[quantity] = changed
    return entries


def changed_sources(changes: Mapping[Channel, Mapping[str, float]]) -> dict[str, dict[str, Any]]:
    """Return {joint: {quantity: source}} of channels with their changes."""
    sources = dict[str, dict[str, Any]]()
    for channel, change in changes.items():
        sources.setdefault(channel.joint, {})[channel.quantity] = channel.changed(**change)
    return sources


@dataclass(frozen=True, eq=False)
class Logged:
    """The logs of a robot, and its joints whose torques are used."""

    robot: Robot
    logs: Sequence[Log]
    used: Collection[str]

    @property
    def named(self) -> list[tuple[str, Log]]:
        """Each log with its name, "log 2", "the log" for a single one."""
        if len(self.logs) == 1:
            return [("the log", self.logs[0])]
        return [(f"log {number}", log) for number, log in enumerate(self.logs, 1)]
