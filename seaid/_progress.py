"""Progress bars on stderr for computations that take more than a second."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")


def track(items: Sequence[Item], description: str, enabled: bool) -> Iterable[Item]:
    """Return the items; if `enabled`, iterating over them shows a progress bar on stderr."""
    return _track(items, description) if enabled and len(items) else items


def _track(items: Sequence[Item], description: str) -> Iterator[Item]:
    from rich.console import Console
    from rich.progress import track as rich_track

    yield from rich_track(items, f"{description:<28}", console=Console(stderr=True))


Report = Callable[[float, int], None]
"""Called with the logarithm of a value and the number of completed steps."""


@contextmanager
def best_so_far(description: str, meaning: str, total: int, enabled: bool) -> Iterator[Report]:
    """Yield a `Report` that shows exp(smallest logarithm so far) on stderr if `enabled`."""
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
