"""The errors and the warning of seaid, and the functions that put user input into messages.

Every message states the problem, the place, the value found, the values allowed and the remedy.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

LONGEST_MESSAGE = 2000
"""Characters of an error message: longer ones lose their middle."""

_LISTED, _ALLOWED, _LONGEST_NAME, _COMPARED = 20, 60, 100, 1000
"""Names listed in a message; allowed names listed; length and number of the names that a misspelled
name is compared with."""

_LONGEST_REASON = 300
"""Characters of the message of another library."""


class SeaidError(Exception):
    """Base of all errors that seaid raises on purpose; their messages have a bounded length.

    `arguments` are those that the message names, as it does: "joints=" or 'method="two-step"'. The
    command line names its options in their place.
    """

    def __init__(self, message: object = "", *arguments: str) -> None:
        message = str(message)
        if len(message) > LONGEST_MESSAGE:
            half = LONGEST_MESSAGE // 2
            message = f"{message[:half]} ... {message[-half:]}"
        super().__init__(visible(message))
        self.arguments = arguments


class RobotError(SeaidError):
    """A robot file, a drive table or a payload that cannot be used."""


class LogError(SeaidError):
    """A log that cannot be read or does not fit the robot."""


class ExcitationError(SeaidError):
    """A motion, or a request for one, that does not excite the parameters asked for."""


class SymbolicError(SeaidError):
    """Equations that Algorithm 1 cannot bring to regressor form."""


class IdentificationError(SeaidError):
    """An estimation problem without a unique or meaningful solution."""


class SeaidWarning(UserWarning):
    """Something was changed or excluded; the result is still valid."""


def visible(text: str) -> str:
    """Return a text with control characters escaped, except line breaks."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join(
        one if one.isprintable() or one == "\n" else one.encode("unicode_escape").decode("ascii")
        for one in text
    )


def shown(value: object, most: int = 80) -> str:
    """Return the repr of a user's value for a message, at most `most` characters long."""
    try:
        return shortened(repr(value), most)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or endless lists
        return f"a {type(value).__name__} too long to show"


def shortened(text: object, most: int = 80) -> str:
    """Return a user's text for a message, truncated and escaped; other values as `shown` does."""
    if not isinstance(text, str):
        return shown(text, most)
    return in_one_line(text if len(text) <= most else f"{text[: most - 2]} …")


def in_one_line(text: str) -> str:
    """Return a text with control characters escaped, including line breaks."""
    return visible(text).replace("\n", "\\n")


def reason_of(problem: BaseException) -> str:
    """Return the message of another library's exception in one line of bounded length."""
    if isinstance(problem, MemoryError):
        return "it requests more memory than is available"
    text = problem.strerror if isinstance(problem, OSError) and problem.strerror else str(problem)
    lines = text.strip().splitlines()
    return shortened(lines[0] if lines else type(problem).__name__, _LONGEST_REASON)


def listed(names: Iterable[object], most: int = _LISTED) -> str:
    """Return names as "a, b, c and 97 more": at most `most` names, long names shortened."""
    found = list(names)
    first = ", ".join(shortened(str(name)) for name in found[:most])
    more = len(found) - most
    return f"{first} and {more:,} more" if more > 0 else first


def unknown_name(kind: str, name: object, allowed: Iterable[str]) -> str:
    """Return the message for a name that is not allowed, with the most similar allowed name."""
    names = list(allowed)
    name = shortened(name)
    comparable = (one for one in names if len(one) <= _LONGEST_NAME)
    near = difflib.get_close_matches(name, islice(comparable, _COMPARED), n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"no {kind} is named '{name}'; {hint}allowed: {listed(names, _ALLOWED) or 'none'}"
