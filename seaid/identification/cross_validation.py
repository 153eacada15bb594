"""Cross-validation: each log on the model identified from all the others."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from seaid._progress import track
from seaid.errors import IdentificationError, checked
from seaid.identification.identification import identify
from seaid.identification.validation import Validation, validate
from seaid.log import Log
from seaid.robot import Robot


@checked(IdentificationError)
def cross_validate(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    parts: int = 4,
    progress: bool = False,
    **options: Any,
) -> tuple[Validation, ...]:
    """Validate each log on the model identified from all the others.

    Parameters
    ----------
    robot : Robot
        The robot model.
    logs : Log or sequence of Log
        Logs of several motions; a single log is cut into `parts`.
    parts : int
        Number of parts of a single log, at least 2.
    progress : bool
        Show a progress bar.
    **options
        Options of `identify`. All identifications use one cutoff, `cutoff_hz` or that of all logs.

    Returns
    -------
    tuple of Validation
        One per log or part.

    Raises
    ------
    IdentificationError
        For less than two parts; further errors as in `identify` and `validate`.

    Examples
    --------
    >>> [one.load.r_squared for one in seaid.cross_validate(robot, log, parts=4)]
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
    """Return a log in consecutive parts of equal length."""
    if not (parts >= 2 and parts == int(parts)):
        raise IdentificationError(
            f"parts must be a whole number of at least 2, found {parts}", "parts"
        )
    edges = np.linspace(log.time[0], log.time[-1], int(parts) + 1)
    edges[-1] = np.inf
    return [log.between(start, end) for start, end in pairwise(edges)]
