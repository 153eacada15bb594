"""Estimates from logs that do not fit into memory.

Each piece of a log is read and reconstructed once for all equations. The rows, a small part of
the log, are stored in temporary files until the parameters are known, because the covariance
needs the residuals.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import IO, TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, reason_of
from seaid.estimation.covariance import at_slots, long_run, slots
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import estimate_of, score_factors, solve
from seaid.estimation.qr_factor import QRFactor, combined, qr_factor_of

if TYPE_CHECKING:
    from seaid.regressor import Regression

Weigh = Callable[[QRFactor], Array]
Change = Callable[["Regression"], "Regression"]

_ARRAYS = ("H", "y", "joint", "time", "run", "propagated")


@dataclass(eq=False)
class StoredRows:
    """Rows of one equation of several long logs, stored in a file piece by piece.

    `parts` are the regressions without their rows, each with the number of its log; `spans` {log:
    first and last instant [s]} of its rows; `steps_s` (logs,) the times between them.
    """

    file: IO[bytes]
    steps_s: tuple[float, ...]
    parts: list[tuple[int, Regression]] = field(default_factory=list)
    spans: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, log: int, rows: Regression) -> None:
        """Append the next piece of a log to the file."""
        for name in _ARRAYS:
            np.save(self.file, getattr(rows, name), allow_pickle=False)
        self.parts.append(
            (log, replace(rows, **{name: getattr(rows, name)[:0] for name in _ARRAYS}))
        )
        if len(rows.y):
            start, end = self.spans.get(log, (math.inf, -math.inf))
            times = float(np.min(rows.time)), float(np.max(rows.time))
            self.spans[log] = min(start, times[0]), max(end, times[1])

    def pieces(self, change: Change | None) -> Iterator[tuple[int, Regression]]:
        """Yield the number of the log and the rows of every piece after `change`, if any."""
        self.file.seek(0)
        for log, part in self.parts:
            arrays = {name: np.load(self.file, allow_pickle=False) for name in _ARRAYS}
            rows = replace(part, **arrays)
            yield log, rows if change is None else change(rows)


@contextmanager
def stored_rows(
    names: Iterable[str], steps_s: tuple[float, ...], rows: Iterable[tuple[int, str, Regression]]
) -> Iterator[dict[str, StoredRows]]:
    """Yield the stored rows of several equations, from (log, equation, rows of the next piece).

    `steps_s` are the times between rows of each log. Raises LogError if the temporary folder has no
    room for them.
    """
    with ExitStack() as files:
        with _room_needed():
            stored = {
                name: StoredRows(files.enter_context(tempfile.TemporaryFile()), steps_s)
                for name in names
            }
        for log, name, piece in rows:
            with _room_needed():
                stored[name].add(log, piece)
        yield stored


@contextmanager
def _room_needed() -> Iterator[None]:
    """Convert an OSError of the temporary file to a LogError."""
    try:
        yield
    except OSError as problem:
        raise LogError(
            f"the rows of a long log cannot be kept in a temporary file ({reason_of(problem)}): "
            "make room in the folder for them, or set TMPDIR to another one"
        ) from None


def stored_estimate(
    stored: StoredRows,
    weigh: Weigh,
    propagated: Array | None = None,
    change: Change | None = None,
) -> tuple[Estimate, QRFactor, Array]:
    """Return the estimate from stored rows, their QR factor and the weights, as in memory.

    `weigh` gives the weights of the equations (`settled_weights` or `equal_weights`); `propagated`
    as in `ordinary`; `change` transforms the stored rows, at the same instants. Raises as
    `ordinary` does.
    """
    qr_factor = combined(qr_factor_of(rows) for _, rows in stored.pieces(change))
    weights = weigh(qr_factor)
    solution = solve(qr_factor, weights)

    def factors(rows: Regression) -> Array:
        return score_factors(rows, qr_factor, weights, solution.values)

    pieces = ((log, rows) for log, rows in stored.pieces(change) if len(rows.y))
    scores = (
        _scores((rows for _, rows in mine), stored.spans[log][0], stored.steps_s[log], factors)
        for log, mine in groupby(pieces, key=lambda piece: piece[0])
    )
    instants = sum(
        round((end - start) / stored.steps_s[log]) + 1 for log, (start, end) in stored.spans.items()
    )
    noise = long_run(scores, instants)
    estimate = estimate_of(qr_factor, weights, noise, propagated, solution)
    return estimate, qr_factor, weights


def _scores(
    pieces: Iterable[Regression],
    start_s: float,
    step_s: float,
    factors: Callable[[Regression], Array],
) -> Iterator[Array]:
    """Yield the scores (T, p) of the pieces of a log, by instant."""
    done = 0
    for rows in pieces:
        summed = at_slots(rows.H, factors(rows), slots(rows.time, start_s, step_s) - done)
        done += len(summed)
        yield summed
