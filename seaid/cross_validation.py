"""Cross-validation over motions: what is identified from some, validated on the others."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from seaid.errors import IdentificationError
from seaid.identification import identify
from seaid.log import Log
from seaid.progress import track
from seaid.robot import Robot
from seaid.validation import Validation, validate


def cross_validate(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    parts: int = 4,
    progress: bool = False,
    **options: Any,
) -> tuple[Validation, ...]:
    """Return one validation a log, of what the other logs tell; one log is cut into `parts`.

    `options` are those of `identify`. All use one pass band, that of all logs together unless
    `cutoff_hz` is given. Raises IdentificationError for less than two parts, and as `identify` and
    `validate` do.
    """
    pieces = _cut(logs, parts) if isinstance(logs, Log) else list(logs)
    if len(pieces) == 1:
        pieces = _cut(pieces[0], parts)
    if len(pieces) < 2:
        raise IdentificationError(
            f"cross-validation needs two logs or parts at least, found {len(pieces)}"
        )
    if options.get("cutoff_hz") is None:
        options["cutoff_hz"] = identify(robot, logs, **options).cutoff_hz
    return tuple(
        validate(identify(robot, [*pieces[:place], *pieces[place + 1 :]], **options), pieces[place])
        for place in track(range(len(pieces)), "cross-validation", progress)
    )


def _cut(log: Log, parts: int) -> list[Log]:
    """Return a log in parts of equal length, one after the other."""
    if not (parts >= 2 and parts == int(parts)):
        raise IdentificationError(f"parts must be a whole number of at least 2, found {parts}")
    edges = np.linspace(log.time[0], log.time[-1], int(parts) + 1)
    edges[-1] = np.inf
    return [log.between(start, end) for start, end in pairwise(edges)]
