"""Estimates from logs that do not fit into memory: rows piece by piece, information, estimate.

Each piece of a log is read and reconstructed once for all equations asked for; their rows, a small
part of the log, wait for the parameters in temporary files, since the covariance needs residuals.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import IO

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, reason_of
from seaid.estimation.covariance import at_slots, long_run, slots
from seaid.estimation.estimate import Estimate
from seaid.estimation.least_squares import estimate_of, score_factors, settled_weights, solve
from seaid.estimation.qr_factor import QRFactor, combined, qr_factor_of
from seaid.log import LongLog
from seaid.regressor import Regress, Regression, regressions_of_parts

Weigh = Callable[[QRFactor], Array]
Change = Callable[[Regression], Regression]

_ARRAYS = ("H", "y", "joint", "time", "run", "propagated")


def unchanged(rows: Regression) -> Regression:
    """Return rows as they are."""
    return rows


def stream_qr_factor(logs: Sequence[LongLog], regress: Regress) -> QRFactor:
    """Return the information of long logs, each read once.

    `regress` makes the rows of a motion: lambda motion: actuator_regression(robot, motion, joint),
    or load_regression with the springs of a first turn. Raises LogError for logs that differ in
    their columns.
    """
    return combined(
        qr_factor_of(rows) for log in logs for _, rows in regressions_of_parts(log, {"": regress})
    )


def stream_estimate(
    logs: Sequence[LongLog],
    regress: Regress,
    weigh: Weigh = settled_weights,
    propagated: Array | None = None,
) -> tuple[Estimate, QRFactor]:
    """Return estimate and information of long logs; the covariance is that of all rows in memory.

    `weigh` gives the weights of the equations (`settled_weights` or `equal_weights`), `propagated`
    as in `ordinary`. Each log is read once. Raises as `stream_qr_factor` and `ordinary` do.
    """
    with stored_rows(logs, {"": regress}) as stored:
        return stored_estimate(stored[""], weigh, propagated)


@dataclass(eq=False)
class StoredRows:
    """Rows of one equation of several long logs, in a file, piece by piece.

    `parts` are the regressions without their rows, each with the number of its log; `spans` {log:
    first and last instant [s]} of its rows, `steps_s` (logs,) the times between them.
    """

    file: IO[bytes]
    steps_s: tuple[float, ...]
    parts: list[tuple[int, Regression]] = field(default_factory=list)
    spans: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, log: int, rows: Regression) -> None:
        """Put the next piece of a log into the file."""
        for name in _ARRAYS:
            np.save(self.file, getattr(rows, name), allow_pickle=False)
        self.parts.append(
            (log, replace(rows, **{name: getattr(rows, name)[:0] for name in _ARRAYS}))
        )
        if len(rows.y):
            start, end = self.spans.get(log, (math.inf, -math.inf))
            times = float(np.min(rows.time)), float(np.max(rows.time))
            self.spans[log] = min(start, times[0]), max(end, times[1])

    def pieces(self, change: Change) -> Iterator[tuple[int, Regression]]:
        """Yield the number of the log and the rows of every piece, as `change` makes them."""
        self.file.seek(0)
        for log, part in self.parts:
            arrays = {name: np.load(self.file, allow_pickle=False) for name in _ARRAYS}
            yield log, change(replace(part, **arrays))


@contextmanager
def stored_rows(
    logs: Sequence[LongLog], equations: Mapping[str, Regress]
) -> Iterator[dict[str, StoredRows]]:
    """Give the rows of several equations {name: what makes them of a motion}, each log read once.

    Raises LogError where the temporary folder has no room for them.
    """
    steps = tuple(log.step_s for log in logs)
    with ExitStack() as files:
        with _room_needed():
            stored = {
                name: StoredRows(files.enter_context(tempfile.TemporaryFile()), steps)
                for name in equations
            }
        for number, log in enumerate(logs):
            for name, rows in regressions_of_parts(log, equations):
                with _room_needed():
                    stored[name].add(number, rows)
        yield stored


@contextmanager
def _room_needed() -> Iterator[None]:
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
    change: Change = unchanged,
) -> tuple[Estimate, QRFactor]:
    """Return estimate and information of stored rows, as `stream_estimate`.

    `change` makes the rows out of those that were stored, with the same instants.
    """
    qr_factor = combined(qr_factor_of(rows) for _, rows in stored.pieces(change))
    weights = weigh(qr_factor)
    theta = solve(qr_factor, weights).values

    def factors(rows: Regression) -> Array:
        return score_factors(rows, qr_factor, weights, theta)

    pieces = ((log, rows) for log, rows in stored.pieces(change) if len(rows.y))
    scores = (
        _scores((rows for _, rows in mine), stored.spans[log][0], stored.steps_s[log], factors)
        for log, mine in groupby(pieces, key=lambda piece: piece[0])
    )
    instants = sum(
        round((end - start) / stored.steps_s[log]) + 1 for log, (start, end) in stored.spans.items()
    )
    return estimate_of(qr_factor, weights, long_run(scores, instants), propagated), qr_factor


def _scores(
    pieces: Iterable[Regression],
    start_s: float,
    step_s: float,
    factors: Callable[[Regression], Array],
) -> Iterator[Array]:
    """Yield the scores (T, p) of the regressions of a log by instant, one after the other."""
    done = 0
    for rows in pieces:
        summed = at_slots(rows.H, factors(rows), slots(rows.time, start_s, step_s) - done)
        done += len(summed)
        yield summed
