"""Progress of anything that takes more than a second, on stderr."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")


def track(items: Sequence[Item], description: str, enabled: bool) -> Iterable[Item]:
    """Return the items, with a progress bar on stderr while they are used if `enabled`."""
    return _track(items, description) if enabled and len(items) else items


def _track(items: Sequence[Item], description: str) -> Iterator[Item]:
    from rich.console import Console
    from rich.progress import track as rich_track

    yield from rich_track(items, f"{description:<28}", console=Console(stderr=True))


Report = Callable[[float, int], None]
"""Told the log of a value and the number of steps done."""


@contextmanager
def best_so_far(description: str, meaning: str, total: int, enabled: bool) -> Iterator[Report]:
    """Give a function that shows the best value so far and the steps done, on stderr if `enabled`.

    The value is the exponential of the least number that the function was told.
    """
    if not enabled:
        yield lambda value, step: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(description, total=total)
        best = float("inf")

        def report(value: float, step: int) -> None:
            nonlocal best
            best = min(best, value)
            text = f"{description}: {meaning} {math.exp(best):.4g}"
            bar.update(task, completed=step, description=text)

        yield report
        bar.update(task, completed=total)
