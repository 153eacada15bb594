"""A check: the code of a mistake, and how it shows.

A `Code` makes findings. An `Observation` looks at what is there, such as the samples of a channel
of a log, a `Channel`. `observed` makes all those of a room. A check that fails is no reason to lose
the result: its error becomes a note.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Generic, TypedDict, TypeVar, Unpack

import numpy as np

from seaid._arrays import Array, FrozenMapping, is_constant
from seaid._files import read_toml, toml_table, toml_text
from seaid.drives import total_ratio
from seaid.errors import Certainty, Finding, SeaidError, Severity, reason_of
from seaid.log import Log, changed_source
from seaid.robot import Robot

Given = TypeVar("Given")


class _Details(TypedDict, total=False):
    """What a finding has next to its message, its joint and its severity."""

    evidence: Mapping[str, float]
    remedy: str
    certainty: Certainty
    joints: tuple[str, ...]


@dataclass(frozen=True)
class Code:
    """What a finding stands for.

    Attributes
    ----------
    name : str
        The word by which users and scripts refer to it, such as "delay".
    is_symptom, spoils : bool
        Whether it is a `Symptom`, or a `Cause`.
    """

    name: str
    is_symptom: ClassVar[bool] = False
    spoils: ClassVar[bool] = False

    @property
    def meaning(self) -> str:
        """What it stands for, in a phrase."""
        return _texts()[self.name]["meaning"]

    @property
    def cause(self) -> str:
        """The usual cause, in sentences."""
        return _texts()[self.name]["cause"]

    @property
    def advice(self) -> str:
        """What to do, in sentences."""
        return _texts()[self.name]["advice"]

    @property
    def measurement(self) -> str:
        """What decides between it and other causes that explain a log as well, "" if nothing."""
        return _texts()[self.name].get("measurement", "")

    @property
    def implies(self) -> str:
        """What follows if it is the cause, as a clause, "" if nothing does."""
        return _texts()[self.name].get("implies", "")

    def finding(
        self,
        message: str,
        joint: str = "",
        severity: Severity = "doubtful",
        evidence: Mapping[str, float] = FrozenMapping({}),
        remedy: str = "",
        certainty: Certainty = "likely",
        joints: tuple[str, ...] = (),
    ) -> Finding:
        """Return a finding of this code; the arguments are the attributes of `Finding`.

        The joint is the only one of `joints` unless it is named.
        """
        joint = joint or only_joint(joints)
        return Finding(self.name, message, joint, severity, evidence, remedy, certainty, joints)

    def wrong(self, message: str, joint: str = "", **details: Unpack[_Details]) -> Finding:
        """Return a `finding` by which the result is not to be used."""
        return self.finding(message, joint, "wrong", **details)

    def note(self, message: str, joint: str = "", **details: Unpack[_Details]) -> Finding:
        """Return a `finding` for information: by default what is certain and no mistake."""
        details.setdefault("certainty", "certain")
        return self.finding(message, joint, "note", **details)


@cache
def _texts() -> Mapping[str, Mapping[str, str]]:
    """Return {name of a code: its texts} of codes.toml, read once, where a text is needed."""
    path = Path(__file__).with_name("codes.toml")
    tables = read_toml(path, "the texts of codes", SeaidError)
    return {
        name: {key: " ".join(text.split()) for key, text in texts.items()}
        for name, texts in tables.items()
    }


class Symptom(Code):
    """A code of something that is off, and not of why: what spoils a fit brings it with it."""

    is_symptom = True


class Cause(Code):
    """A code of what spoils the fit of its joint, or of all joints if a finding names none."""

    spoils = True


@dataclass(frozen=True)
class Observation(Generic[Given]):
    """A check that looks at what is there: `look` yields the findings of its `code`."""

    code: Code
    look: Callable[[Given], Iterable[Finding]]


def observed(checks: Iterable[Observation[Given]], subject: Given) -> list[Finding]:
    """Return the findings of checks, in their order; a check that raises becomes a note."""
    findings: list[Finding] = []
    for check in checks:
        with guarded(check.code, findings):
            findings += check.look(subject)
    return findings


@contextmanager
def guarded(code: Code, findings: list[Finding]) -> Iterator[None]:
    """Add to findings, if a check of a code raises, the note that it could not be made."""
    try:
        yield
    except Exception as problem:  # the fit stands, whatever a check meets
        text = f"the check '{code.name}' could not be made: {reason_of(problem)}"
        findings.append(code.note(text))


def in_drives(tables: Mapping[tuple[str, ...], str], only: str = "") -> str:
    """Return the remedy that adds lines to tables of the drives file: {keys of a table: lines}."""
    parts = [f"{toml_table(*keys)}\n{lines}" for keys, lines in tables.items()]
    return "\n".join([f"in the drives file{only and f', {only}'}:", *parts])


def in_description(
    sources: Mapping[str, Mapping[str, str]], log: str = "the log", table: str = "joints"
) -> str:
    """Return the remedy that changes channels of a log: {joint: {quantity: its source as TOML}}."""
    lines = [f"in the description of {log}:"]
    for name, entries in sources.items():
        lines.append(toml_table(table, name))
        lines += [f"{quantity} = {source}" for quantity, source in entries.items()]
    return "\n".join(lines)


def zeros_in_description(
    robot: Robot, angles: Mapping[str, float], sources: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return the remedy that adds angles to the zeros of joints, and of the motors that turn them.

    `sources` {joint: {quantity: column or entry of a description}} has what was logged.
    """
    moved = {(joint, "joint_position"): angle for joint, angle in angles.items()}
    added = np.array([angles.get(joint, 0.0) for joint in robot.joint_names])
    for turned, (joint, drive) in zip(
        robot.transmission @ added, robot.drives.items(), strict=True
    ):
        # theta_M = N r_L / r_M phi, phi = C q: the zero of a joint moves all motors that turn it.
        moved[joint, "motor_position"] = float(turned) * total_ratio(drive)
    entries: dict[str, dict[str, str]] = {}
    for (joint, quantity), offset in moved.items():
        source = sources.get(joint, {}).get(quantity)
        if offset and source:
            changed = changed_source(source, offset=round(offset, 5))
            entries.setdefault(joint, {})[quantity] = changed
    return in_description(entries)


def joints_of(findings: Iterable[Finding]) -> set[str]:
    """Return the joints that findings name, alone or among several."""
    return {joint for x in findings for joint in (x.joint, *x.joints) if joint}


def as_note(finding: Finding) -> Finding:
    """Return a finding as a note without a remedy, whose numbers are those of a wrong model."""
    return replace(finding, severity="note", remedy="")


def only_joint(joints: Sequence[str]) -> str:
    """Return the joint of a finding: the only one, or "" for several."""
    return joints[0] if len(joints) == 1 else ""


def excluding_torque(kept: Sequence[str]) -> str:
    """Return how to use the torques of some joints only, after words to which ", or" fits."""
    if not kept:
        return ""
    return (
        f", or exclude its torque (--torque-joints {','.join(kept)}), in [identify] of "
        f"seaid.toml:\ntorque_joints = [{', '.join(map(toml_text, kept))}]"
    )


@dataclass(frozen=True, eq=False)
class Channel:
    """The samples (T,) of a quantity of a joint, and the `source` in which the log has them."""

    joint: str
    quantity: str
    values: Array
    source: str | Mapping[str, Any] | None

    @property
    def entry(self) -> Mapping[str, Any]:
        """The entry of the description, empty for a column alone."""
        return self.source if isinstance(self.source, Mapping) else {}

    def changed(self, **changes: float) -> str:
        """Return the TOML of the source with the changes of `changed_source`."""
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
