"""What sensors tell, as text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seaid.sensors import Identifiability

_WIDTH = 100


def sensors_table(found: Identifiability) -> str:
    """Return counts and lists of what can be found alone, together, up to a factor, not at all."""
    return "\n".join(_lines(found))


def _lines(found: Identifiability) -> Iterator[str]:
    grouped = sum(map(len, found.ratios))
    yield (
        f"{found.robot_name}: of {len(found.names)} parameters the sensors tell "
        f"{found.rank} numbers"
    )
    for joint, sentences in found.usable.items():
        yield from _wrapped(
            f"{joint} ({', '.join(found.sensors[joint]) or 'no sensor'}): ", sentences
        )
    yield from _list(f"Alone: {len(found.identifiable)}", found.identifiable)
    yield from _list(f"Only together: {len(found.combinations)}", found.combinations, "\n")
    for group in found.ratios:
        yield from _list(f"Only up to one common factor: {len(group)}", group, "\n")
    yield from _list(f"Not at all: {len(found.unidentifiable)}", found.unidentifiable)
    count = len(found.base.names)
    agree = "agree" if found.agree else "do NOT agree"
    yield (
        f"{count} combinations, {grouped} of them in {len(found.ratios)} groups; exact and numeric "
        f"rank {agree}, gap {found.gap:.0e}"
    )


def _list(title: str, items: Sequence[str], between: str = ", ") -> Iterator[str]:
    yield title
    if between == "\n":
        for item in items:
            yield from _wrapped("  ", [item])
    elif items:
        yield from _wrapped("  ", items, between)


def _wrapped(start: str, items: Sequence[str], between: str = "; ") -> list[str]:
    return textwrap.wrap(
        start + between.join(items),
        _WIDTH,
        subsequent_indent="    ",
        initial_indent="",
        break_long_words=False,
    )
