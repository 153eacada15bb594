"""What is refused in a log: errors by their codes, whose texts are in refusals.toml."""

from __future__ import annotations

from pathlib import Path

from seaid._files import read_toml
from seaid.errors import LogError

_FILE = Path(__file__).with_name("refusals.toml")
REFUSALS = read_toml(_FILE, "the texts of errors", LogError)
"""{"texts" or "arguments": {code: its text, or the arguments that the text names}}."""


def refusal(code: str, /, **values: object) -> LogError:
    """Return the error of a code, with values of the log in the braces of its text."""
    arguments = REFUSALS["arguments"].get(code, ())
    return LogError(REFUSALS["texts"][code].format(**values), *arguments)
