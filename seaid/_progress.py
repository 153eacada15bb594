"""What people see: progress bars on stderr, and objects in one line or as a table."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields
from html import escape
from typing import Any, ClassVar, TypeVar

from seaid.errors import in_one_line, listed, shortened

Item = TypeVar("Item")


def track(items: Sequence[Item], description: str, enabled: bool) -> Iterable[Item]:
    """Return the items; if `enabled`, iterating over them shows a progress bar on stderr."""
    if not enabled or not len(items):
        return items
    from rich.console import Console
    from rich.progress import track as rich_track

    return rich_track(items, f"{description:<28}", console=Console(stderr=True))


Report = Callable[[float, int], None]
"""Called with the logarithm of a value and the number of completed steps."""


@contextmanager
def best_so_far(description: str, meaning: str, total: int, enabled: bool) -> Iterator[Report]:
    """Yield a `Report` that shows exp(smallest logarithm so far) on stderr if `enabled`."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), disable=not enabled) as bar:
        task, best = bar.add_task(description, total=total), math.inf

        def report(value: float, step: int) -> None:
            nonlocal best
            best = min(best, value)
            text = f"{description}: {meaning} {math.exp(best):.4g}"
            bar.update(task, completed=step, description=text)

        yield report
        bar.update(task, completed=total)


_LONGEST_VALUE, _LONGEST_LINE, _MOST_ELEMENTS = 80, 300, 3
"""Characters of a value and of a line in a `repr`, and the elements of an array that it writes
out."""


class Display:
    """Data with a `repr` of one line, which notebooks show by a table of `seaid.report.text`."""

    table_name: ClassVar[str] = "fields_table"
    """The function of `seaid.report.text` that makes the table."""

    def _in_short(self) -> str:
        """Return what the repr has in brackets: here the fields that differ from their defaults."""
        return ", ".join(f"{name}={text}" for name, text in field_texts(self))

    def __repr__(self) -> str:
        text = shortened(self._in_short(), _LONGEST_LINE)
        return f"{type(self).__name__}({text})"

    def _table(self) -> str:
        from seaid import report

        return str(getattr(report.text, self.table_name)(self))

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self._table())}</pre>"


class Result(Display):
    """A result that `summary()` and `print` show by its table."""

    def summary(self) -> str:
        """Return the result as text that a human reads."""
        return self._table()

    def __str__(self) -> str:
        return self.summary()


def field_texts(data: Any) -> Iterator[tuple[str, str]]:
    """Yield each field that differs from its default, and its value as text."""
    for field in fields(data):
        value = getattr(data, field.name)
        is_default = field.default is not MISSING and not hasattr(value, "shape")
        if field.repr and not (is_default and value == field.default):
            yield field.name, value_text(value)


def value_text(value: Any) -> str:
    """Return a value in one short line, an array of more than three elements by its shape."""
    if hasattr(value, "shape") and math.prod(value.shape) > _MOST_ELEMENTS:
        return f"array {value.shape}"
    text = in_one_line(repr(value.tolist() if hasattr(value, "shape") else value))
    if isinstance(value, Mapping | list | tuple) and len(text) > _LONGEST_VALUE:
        return counted(len(value), "entry")
    return shortened(text, _LONGEST_VALUE)


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: "1 joint", "2 bodies", "1,200 samples"."""
    plural = re.sub(r"(?<![aeiou])ys$", "ies", f"{noun}s")
    return f"{number:,} {noun if number == 1 else plural}"


MOST_NAMES = 6
"""Names of joints and the like in a line."""


def sampled_text(time: Any, joint_names: Sequence[str]) -> str:
    """Return the number of samples, duration, rate and joints of a log or motion."""
    duration = float(time[-1] - time[0])
    rate = f" at {(len(time) - 1) / duration:.4g} Hz" if duration > 0 else ""
    samples = f"{counted(len(time), 'sample')}, {duration:.2f} s{rate}"
    return f"{samples}, joints {listed(joint_names, MOST_NAMES)}"
