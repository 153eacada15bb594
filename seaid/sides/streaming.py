"""Estimates from logs that do not fit into memory: rows piece by piece, information, estimate."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import IO

import numpy as np

from seaid.arrays import Array
from seaid.estimation.covariance import at_slots, long_run, slots
from seaid.estimation.estimate import Estimate
from seaid.estimation.information import Information, combined, information_of
from seaid.estimation.solve import estimate_of, score_factors, settled_weights, solve
from seaid.long_log import LongLog, Regress
from seaid.regression import Regression

Weigh = Callable[[Information], Array]


def stream_information(logs: Sequence[LongLog], regress: Regress) -> Information:
    """Return the information of long logs, each read once.

    `regress` makes the rows of a motion: lambda motion: actuator_regression(robot, motion, joint),
    or load_regression with the springs of a first turn. Raises LogError for logs that differ in
    their columns.
    """
    return combined(information_of(rows) for log in logs for rows in log.regressions(regress))


def stream_estimate(
    logs: Sequence[LongLog],
    regress: Regress,
    weigh: Weigh = settled_weights,
    carried: Array | None = None,
) -> tuple[Estimate, Information]:
    """Return estimate and information of long logs; the covariance is that of all rows in memory.

    `weigh` gives the weights of the equations (`settled_weights` or `equal_weights`), `carried` as
    in `ordinary`. Each log is read once; its rows wait for the parameters in a temporary file,
    because the covariance needs their residuals. Raises as `stream_information` and `ordinary` do.
    """
    with tempfile.TemporaryFile() as spool:
        spans = [_Span() for _ in logs]
        information = combined(
            information_of(rows)
            for log, span in zip(logs, spans, strict=True)
            for rows in _kept(spool, log.regressions(regress), span)
        )
        weights = weigh(information)
        theta = solve(information, weights).values
        spool.seek(0)
        told = [
            (span, log.step_s) for log, span in zip(logs, spans, strict=True) if span.regressions
        ]
        scores = (
            _scores(
                spool, span, step_s, lambda rows: score_factors(rows, information, weights, theta)
            )
            for span, step_s in told
        )
        instants = sum(round((span.end_s - span.start_s) / step_s) + 1 for span, step_s in told)
        return estimate_of(information, weights, long_run(scores, instants), carried), information


@dataclass
class _Span:
    """How many regressions of a log wait in the file, one of them, and when their rows are."""

    regressions: int = 0
    like: Regression | None = None
    start_s: float = math.inf
    end_s: float = -math.inf


def _kept(spool: IO[bytes], parts: Iterable[Regression], span: _Span) -> Iterator[Regression]:
    """Yield regressions and put those that have rows into the file, too."""
    for rows in parts:
        if len(rows.y):
            table = np.column_stack([rows.H, rows.y, rows.joint, rows.time, rows.run, rows.carried])
            np.save(spool, table, allow_pickle=False)
            span.like = rows
            span.regressions += 1
            span.start_s = min(span.start_s, float(np.min(rows.time)))
            span.end_s = max(span.end_s, float(np.max(rows.time)))
        yield rows


def _scores(
    spool: IO[bytes], span: _Span, step_s: float, factors: Callable[[Regression], Array]
) -> Iterator[Array]:
    """Yield the scores (T, p) of the regressions of a log by instant, one after the other."""
    done = 0
    for _ in range(span.regressions):
        rows = _regression(np.load(spool, allow_pickle=False), span.like)
        summed = at_slots(rows.H, factors(rows), slots(rows.time, span.start_s, step_s) - done)
        done += len(summed)
        yield summed


def _regression(table: Array, like: Regression | None) -> Regression:
    """Return the regression whose columns wait in the file; `like` is one of the same log."""
    assert like is not None
    p = len(like.names)
    H, y, joint, time, run, carried = np.split(table, [p, p + 1, p + 2, p + 3, p + 4], axis=1)
    y, joint, time, run = (column[:, 0] for column in (y, joint, time, run))
    return replace(like, H=H, y=y, joint=joint, time=time, run=run, carried=carried)
