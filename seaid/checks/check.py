"""A check: the code of a mistake, and how it shows.

A `Code` makes findings. An `Observation` looks at what is there, such as the samples of a channel.
`observed` makes all those of a room. A check that fails is no reason to lose the result: its error
becomes a note.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from seaid._arrays import FrozenMapping
from seaid._files import toml_table, toml_text
from seaid.errors import Certainty, Finding, Severity, reason_of

Given = TypeVar("Given")


@dataclass(frozen=True)
class Code:
    """What a finding stands for.

    Attributes
    ----------
    name : str
        The word by which users and scripts refer to it, such as "delay".
    meaning : str
        What it stands for, in a phrase.
    cause, advice : str
        The usual cause, and what to do, in sentences.
    """

    name: str
    meaning: str
    cause: str
    advice: str

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
        """Return a finding of this code; the arguments are the attributes of `Finding`."""
        return Finding(self.name, message, joint, severity, evidence, remedy, certainty, joints)


@dataclass(frozen=True)
class Observation(Generic[Given]):
    """A check that looks at what is there: `look` yields the findings of its `code`."""

    code: Code
    look: Callable[[Given], Iterable[Finding]]


def observed(checks: Iterable[Observation[Given]], given: Given) -> list[Finding]:
    """Return the findings of checks, in their order; a check that raises becomes a note."""
    findings: list[Finding] = []
    for check in checks:
        try:
            findings += check.look(given)
        except Exception as problem:  # the fit stands, whatever a check meets
            findings.append(not_made(check.code, problem))
    return findings


def not_made(code: Code, problem: Exception) -> Finding:
    """Return the note that a check could not be made."""
    return code.finding(
        f"the check '{code.name}' could not be made: {reason_of(problem)}",
        severity="note",
        certainty="certain",
    )


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


_OF_FIT = ("no-fit", "negative-parameter")
"""Codes of findings that say that a model, or its values, are wrong."""


def is_wrong(setup: Iterable[Finding]) -> bool:
    """Whether findings say that the set-up, and not only the model, is wrong."""
    return any(one.severity == "wrong" and one.code not in _OF_FIT for one in setup)


def consequences(setup: Sequence[Finding], findings: Iterable[Finding]) -> list[Finding]:
    """Return findings about a fit: mere notes if the set-up is already known to be wrong."""
    return [replace(one, severity="note") if is_wrong(setup) else one for one in findings]
