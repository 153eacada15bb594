"""What a system of sensed equations can tell: exactly by residues, and once more in doubles."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from scipy.sparse.csgraph import connected_components

from seaid.arrays import Array, BoolArray, frozen
from seaid.base import BaseParameters, left_to_right
from seaid.errors import SymbolicError
from seaid.linear_algebra import safely
from seaid.symbolic.grouping import exact_text
from seaid.symbolic.residues import ResidueNumbers, Residues, echelon, short_fraction
from seaid.symbolic.sensing.arithmetic import Numbers, RealNumbers
from seaid.symbolic.sensing.drives import MOTOR_SIGNALS, plain
from seaid.symbolic.sensing.equations import System
from seaid.symbolic.sensing.instants import Truth, columns_at_instants, random_truth

_MORE_INSTANTS = 6
_SAME = 1e-7
_ROUNDING = 1e-9

Decision = tuple[BaseParameters, tuple[tuple[int, ...], ...], int, bool]
"""Combinations, groups of their places known up to a factor, rank, and whether doubles agree."""


def decided(
    system: System,
    payloads: Sequence[Array],
    exact: ResidueNumbers,
    numeric: RealNumbers,
) -> Decision:
    """Return what can be told, with the known `payloads` (10n,) of which there are logs."""
    columns, rows = _free(system, exact)
    on_motion = _on_motion(system, payloads, exact, columns)
    groups = _groups(on_motion, len(columns))
    rank = len(on_motion[0]) if on_motion is not None else len(columns)
    grouping, gap, agree = _in_doubles(system, payloads, numeric, columns, rows, rank)
    names = system.names
    base = BaseParameters(
        columns=tuple(columns),
        names=tuple(names[column] for column in columns),
        expressions=tuple(
            exact_text(_fractions(row, values), names)
            for row, values in zip(rows, grouping, strict=True)
        ),
        grouping=frozen("grouping", grouping, (None, len(names))),
        gap=gap,
    )
    return base, groups, rank, agree


def _free(system: System, exact: ResidueNumbers) -> tuple[list[int], Residues]:
    """Return pivots and rows of the echelon form, of as many instants as tell something new."""
    width, sums = len(system.names), len(system.sums)
    columns: list[int] = []
    rows: Residues = np.zeros((0, width), dtype=object)
    if not sums:
        return columns, rows
    truth = random_truth(exact, system)
    while True:
        new = columns_at_instants(exact, system, truth, width // sums + _MORE_INSTANTS)
        found, rows = echelon(np.vstack([rows, new]))
        if len(found) == len(columns):
            return found, rows
        columns = found


def _on_motion(
    system: System, payloads: Sequence[Array], exact: ResidueNumbers, columns: list[int]
) -> tuple[list[int], Residues] | None:
    """Return the echelon form of the combinations over true motions, None where it is full."""
    if not columns or not _can_be_homogeneous(system):
        return None
    truth, count = random_truth(exact, system), _count(system, columns)
    rows = [
        columns_at_instants(exact, system, truth, count, _numbers(exact, payload))
        for payload in payloads
    ]
    return echelon(np.vstack(rows)[:, columns])


def _can_be_homogeneous(system: System) -> bool:
    """Tell whether a signal that follows from the others stands beside an unknown parameter."""
    signals = {plain(name) for name in MOTOR_SIGNALS.values()}
    return any(
        system.terms[i].spring is not None or expression.free_symbols & signals
        for e in system.used
        for i, _, expression in system.equations[e].parts
    )


def _count(system: System, columns: Sequence[int]) -> int:
    return len(columns) // len(system.sums) * 2 + 2 * _MORE_INSTANTS


def _numbers(numbers: Numbers, values: Array) -> Any:
    return np.array([numbers.number(float(x)) for x in values], dtype=object)


def _groups(on_motion: tuple[list[int], Residues] | None, p: int) -> tuple[tuple[int, ...], ...]:
    """Return the combinations that a direction without any trace moves together."""
    if on_motion is None:
        return ()
    pivots, rows = on_motion
    links = np.zeros((p, p), dtype=bool)
    for free in (place for place in range(p) if place not in pivots):
        links[free, [pivot for pivot, row in zip(pivots, rows, strict=True) if row[free]]] = True
        links[free, free] = True
    _, labels = connected_components(links, directed=False)
    held = np.any(links, axis=0) | np.any(links, axis=1)
    labelled = [np.flatnonzero((labels == label) & held) for label in dict.fromkeys(labels)]
    return tuple(tuple(group.tolist()) for group in labelled if len(group))


def _in_doubles(
    system: System,
    payloads: Sequence[Array],
    numeric: RealNumbers,
    columns: list[int],
    rows: Residues,
    rank: int,
) -> tuple[Array, float, bool]:
    """Return the grouping of the exact base columns, the gap, and whether doubles agree."""
    width = len(system.names)
    if not columns:
        return np.zeros((0, width)), float("inf"), True
    truth, count = (
        random_truth(numeric, system),
        2 * (width // len(system.sums)) + 4 * _MORE_INSTANTS,
    )
    H = columns_at_instants(numeric, system, truth, count)
    found, grouping, gap = left_to_right(H, _negligible(system, H))
    agree = found == columns
    if not agree:
        grouping = safely(
            np.linalg.lstsq,
            H[:, columns],
            H,
            what="what the sensors tell",
            error=SymbolicError,
            rcond=None,
        )[0]
    seen = np.abs(grouping) > _SAME * np.max(np.abs(grouping), axis=1, keepdims=True)
    exact = rows != 0  # what is zero in doubles alone is the trace of an irrational direction
    agree &= not np.any(seen & ~exact)
    told = _rank_in_doubles(system, payloads, numeric, columns, truth)
    return np.where(exact, grouping, 0.0), gap, bool(agree and told == rank)


def _rank_in_doubles(
    system: System,
    payloads: Sequence[Array],
    numeric: RealNumbers,
    columns: list[int],
    truth: Truth,
) -> int:
    if not _can_be_homogeneous(system):
        return len(columns)
    count = 2 * _count(system, columns)
    rows = [columns_at_instants(numeric, system, truth, count, payload) for payload in payloads]
    return len(left_to_right(np.vstack(rows)[:, columns])[0])


def _negligible(system: System, H: Array) -> BoolArray:
    """Tell columns of bodies that are zero but for rounding, as `seaid.base.negligible`."""
    norms, bodies = np.linalg.norm(H, axis=0), np.arange(H.shape[1]) < 10 * system.robot.n
    return np.asarray(bodies & (norms < 1e-9 * norms[bodies].max(initial=0.0)))


def _fractions(row: Residues, values: Array) -> dict[int, Fraction]:
    """Return a row of the grouping as rationals: exactly where they are short, else the doubles."""
    found = {}
    for column in np.flatnonzero(values).tolist():
        value = float(values[column])
        near = short_fraction(int(row[column])), Fraction(round(value)), Fraction(value)
        found[column] = next(x for x in near if x and abs(x - value) <= _ROUNDING * abs(value))
    return found
