"""How well the torques are predicted, as a table of a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaid.identification import Identification
from seaid.report.html_numbers import share, short
from seaid.report.html_traces import SIDES, Run
from seaid.validation import Fit

_MOST_ERRORS = 1500


@dataclass(frozen=True)
class ErrorRow:
    """How well the torque of a joint on one side is predicted in a run."""

    run: str
    is_unseen: bool
    joint: str
    side: str
    cells: tuple[str, ...]
    relative_error: float


def error_rows(found: Identification, runs: Sequence[Run]) -> list[ErrorRow]:
    """Return how well every run is predicted, by side and joint; sides without traces left out."""
    return [
        ErrorRow(
            run=run.name,
            is_unseen=run.is_unseen,
            joint=joint,
            side=side,
            cells=_error_cells(fit, index, _torque_unit(found, side, index)),
            relative_error=float(fit.relative_error[index]),
        )
        for run in runs
        for side in SIDES
        for fit in [getattr(run.result, side)]
        for index, joint in enumerate(run.result.joints)
        if np.isfinite(fit.relative_error[index])
    ]


def worst_rows(rows: Sequence[ErrorRow]) -> list[ErrorRow]:
    """Return the rows of a table that is not too long: the largest errors, in their order."""
    largest = sorted(range(len(rows)), key=lambda k: -rows[k].relative_error)[:_MOST_ERRORS]
    return [rows[k] for k in sorted(largest)]


def _torque_unit(found: Identification, side: str, index: int) -> str:
    return "N" if side == "load" and found.robot.is_prismatic[index] else "N m"


def _error_cells(fit: Fit, index: int, unit: str) -> tuple[str, ...]:
    return (
        share(float(fit.relative_error[index])),
        share(float(fit.moving_relative_error[index])),
        share(float(fit.raw_relative_error[index])),
        f"{short(float(fit.rms_error[index]))} {unit}",
        f"{float(fit.r_squared[index]):.4f}",
    )
