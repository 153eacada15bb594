"""What a check is: the code of its findings, what it needs, and what it proposes for a subject.

A `Check` looks at a subject, such as the samples of a log (`channels`), an experiment (`setup`), or
an equation of a fit at a joint (`columns`). It proposes findings of what it sees, transforms that
undo a mistake, or columns that an equation may lack: the latter two are tested against each other.
Checks are declared where they are written, in tuples for each subject; `proposals` makes them. A
check that fails is no reason to lose the result: its error becomes a note.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar, TypeVarTuple

from seaid import errors
from seaid.errors import Finding

if TYPE_CHECKING:
    from seaid.checks.codes import Code

Subject = TypeVarTuple("Subject")
Proposal = TypeVar("Proposal")


@dataclass(frozen=True)
class Need(Generic[*Subject]):
    """What a check needs of its subject: in words, as a noun, and whether a subject has it."""

    words: str
    is_met: Callable[[*Subject], bool]


@dataclass(frozen=True)
class Check(Generic[*Subject, Proposal]):
    """A check of a subject: what it proposes is of its `code`, if the subject meets all `needs`."""

    code: Code
    needs: tuple[Need[*Subject], ...]
    proposed: Callable[[*Subject], Iterable[Proposal]]


def proposals(
    checks: Iterable[Check[*Subject, Proposal]], notes: list[Finding], *subject: *Subject
) -> Iterator[Proposal]:
    """Yield what checks propose for a subject, and add the `notes` on those that raise."""
    for check in checks:
        with guarded(check.code, notes):
            if all(need.is_met(*subject) for need in check.needs):
                yield from check.proposed(*subject)


def observed(checks: Iterable[Check[*Subject, Finding]], *subject: *Subject) -> list[Finding]:
    """Return the findings of checks, in their order, and notes on those that raise."""
    notes: list[Finding] = []
    return [*proposals(checks, notes, *subject), *notes]


@contextmanager
def guarded(code: Code, findings: list[Finding]) -> Iterator[None]:
    """Add to findings, if a check of a code raises, the note that it could not be made."""
    try:
        yield
    except Exception as problem:  # the fit stands, whatever a check meets
        text = f"the check '{code.name}' could not be made: {errors.reason_of(problem)}"
        findings.append(code.note(text))
