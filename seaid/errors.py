"""The errors and the warning of seaid.

Every message says what was wrong, where, what was found, what is allowed and what to do.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

LONGEST_MESSAGE = 2000
"""Characters of an error message: longer ones lose their middle."""

_LISTED, _ALLOWED, _LONGEST_NAME, _COMPARED = 20, 60, 100, 1000
"""Names in a message, of what is allowed; the names that a misspelled one is compared with: how
long, and how many."""

_LONGEST_REASON = 300
"""Characters of what a library says."""


class SeaidError(Exception):
    """Base of all errors that seaid raises on purpose; their messages have a bounded length."""

    def __init__(self, message: object = "") -> None:
        message = str(message)
        if len(message) > LONGEST_MESSAGE:
            half = LONGEST_MESSAGE // 2
            message = f"{message[:half]} ... {message[-half:]}"
        super().__init__(visible(message))


class RobotError(SeaidError):
    """A robot file, a drive table or a payload that cannot be used."""


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


def visible(text: str) -> str:
    """Return a text with control characters as escapes: names of files and columns may have some.

    Line breaks stay.
    """
    if text.replace("\n", "").isprintable():
        return text
    return "".join(
        one if one.isprintable() or one == "\n" else one.encode("unicode_escape").decode("ascii")
        for one in text
    )


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
    return in_one_line(text if len(text) <= most else f"{text[: most - 2]} …")


def in_one_line(text: str) -> str:
    """Return a text with control characters as escapes, line breaks too."""
    return visible(text).replace("\n", "\\n")


def reason_of(problem: BaseException) -> str:
    """Return what an exception of a library says, in one line of bounded length."""
    if isinstance(problem, MemoryError):
        return "it asks for more memory than there is"
    text = problem.strerror if isinstance(problem, OSError) and problem.strerror else str(problem)
    lines = text.strip().splitlines()
    return shortened(lines[0] if lines else type(problem).__name__, _LONGEST_REASON)


def listed(names: Iterable[object], most: int = _LISTED) -> str:
    """Return names as "a, b, c and 97 more": at most `most` of them, long ones shortened."""
    found = list(names)
    first = ", ".join(shortened(str(name)) for name in found[:most])
    more = len(found) - most
    return f"{first} and {more:,} more" if more > 0 else first


def unknown_name(kind: str, name: object, allowed: Iterable[str]) -> str:
    """Return the sentence for a name that is not among the allowed ones, with the nearest one."""
    names = list(allowed)
    name = shortened(name)
    comparable = (one for one in names if len(one) <= _LONGEST_NAME)
    near = difflib.get_close_matches(name, islice(comparable, _COMPARED), n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"no {kind} is named '{name}'; {hint}allowed: {listed(names, _ALLOWED) or 'none'}"
