"""What is refused in a log: errors by their codes, whose texts are in refusals.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Generic, TypeVar

from seaid._files import read_toml
from seaid.errors import LogError, SeaidError

_Error = TypeVar("_Error", bound=SeaidError)


class Refusals(Generic[_Error]):
    """The errors of a file with `texts`, and the `arguments` that they name, by their codes."""

    def __init__(self, file: Path, error: type[_Error]) -> None:
        tables, self._error = read_toml(file, "the texts of errors", error), error
        self.texts: dict[str, str] = tables["texts"]
        self.arguments: dict[str, list[str]] = tables.get("arguments", {})

    def __call__(self, code: str, /, **values: object) -> _Error:
        """Return the error of a code, with values for the braces of its text."""
        return self._error(self.texts[code].format(**values), *self.arguments.get(code, ()))


refusal = Refusals(Path(__file__).with_name("refusals.toml"), LogError)
"""Return the error of a code about a log."""
