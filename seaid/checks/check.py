"""A check: the code of a mistake, and how it shows.

A `Code` makes findings. An `Observation` looks at what is there, such as the samples of a channel.
`observed` makes all those of a room. A check that fails is no reason to lose the result: its error
becomes a note.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from seaid._arrays import FrozenMapping
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
