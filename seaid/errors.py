"""The errors and the warning of seaid.

Every message says what was wrong, where, what was found, what is allowed and what to do.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SeaidError(Exception):
    """Base of all errors that seaid raises on purpose."""


class RobotError(SeaidError):
    """A robot file, a drivetrain table or a payload that cannot be used."""


class LogError(SeaidError):
    """A log that cannot be read or does not fit the robot."""


class ExcitationError(SeaidError):
    """A motion or a request for one that cannot tell the parameters asked for."""


class SymbolicError(SeaidError):
    """Equations that Algorithm 1 cannot bring to regressor form."""


class IdentificationError(SeaidError):
    """An estimation that has no honest answer."""


class SeaidWarning(UserWarning):
    """Something was changed or left out; the result is still valid."""


def unknown_name(kind: str, name: str, allowed: Iterable[str]) -> str:
    """Return the sentence for a name that is not among the allowed ones, with the nearest one."""
    names = list(allowed)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"no {kind} is named '{name}'; {hint}allowed: {', '.join(names) or 'none'}"
