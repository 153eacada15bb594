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


_MOST_OF_A_LIST = 1500


def shown(value: object, most: int = 80) -> str:
    """Return a value of a user as it stands in a message: its repr, of at most so many letters."""
    try:
        return shortened(repr(value), most)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or endless lists
        return f"a {type(value).__name__} too long to show"


def shortened(text: object, most: int = 80) -> str:
    """Return a user's text as it stands in a message: cut off, what is no letter as its escape.

    What is no text is shown as `shown` does.
    """
    if not isinstance(text, str):
        return shown(text, most)
    short = text if len(text) <= most else f"{text[: most - 2]} …"
    if short.isprintable():
        return short
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in short)


def unknown_name(kind: str, name: str, allowed: Iterable[str]) -> str:
    """Return the sentence for a name that is not among the allowed ones, with the nearest one."""
    names = list(allowed)
    name = shortened(name)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean '{shortened(near[0])}'? " if near else ""
    listed = shortened(", ".join(names), _MOST_OF_A_LIST) or "none"
    return f"no {kind} is named '{name}'; {hint}allowed: {listed}"
