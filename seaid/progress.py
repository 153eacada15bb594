"""Progress of anything that takes more than a second, on stderr."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")


def track(items: Sequence[Item], description: str, enabled: bool) -> Iterable[Item]:
    """Return the items, with a progress bar on stderr while they are used if `enabled`."""
    return _track(items, description) if enabled and len(items) else items


def _track(items: Sequence[Item], description: str) -> Iterator[Item]:
    from rich.console import Console
    from rich.progress import track as rich_track

    yield from rich_track(items, f"{description:<28}", console=Console(stderr=True))
