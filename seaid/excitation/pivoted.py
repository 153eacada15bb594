"""The base columns a condition number is of: picked by QR with column pivoting, once for all."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.base import BaseParameters, base_of_columns, base_parameters, random_states
from seaid.errors import ExcitationError
from seaid.linear_algebra import safely
from seaid.rigid_body import regressor_at_drives
from seaid.robot import Robot

_safely = partial(safely, what="the base parameters", error=ExcitationError)

_DRAWS = 16

_ALIKE = 1e-6
"""Relative difference of norms and of condition numbers that does not decide: rounding of a norm is
below 1e-12, and what differs by a millionth is as good."""


def pivoted_base(robot: Robot, rows: Sequence[str] | None = None) -> BaseParameters:
    """Return the base parameters whose columns QR with column pivoting picks at random states.

    The pivoting (Businger and Golub 1965) is repeated over 16 draws of states; the columns kept are
    those with the smallest condition number over all states drawn, for it differs by a factor of
    two or three between draws. How many columns there are is the rank that `base_parameters` finds;
    the groupings are its own, solved for these columns. The choice depends on the robot and on
    `rows` alone. Raises ExcitationError where nothing is identifiable.
    """
    leftmost = base_parameters(robot, rows=rows)
    known = [robot.index(joint) for joint in robot.rows(rows)]
    draws = [_random_rows(robot, known, draw) for draw in range(_DRAWS)]
    columns = _best_pivots(draws, len(leftmost.columns))
    grouping = _safely(np.linalg.solve, leftmost.grouping[:, columns], leftmost.grouping)
    grouping[:, columns] = np.eye(len(columns))
    grouping[np.abs(grouping) < 1e-11 * np.abs(grouping).max()] = 0.0
    return base_of_columns(robot, columns, np.asarray(grouping, dtype=np.float64), leftmost.gap)


def _random_rows(robot: Robot, known: list[int], seed: int) -> Array:
    Y = regressor_at_drives(robot, *random_states(robot, seed, len(known)))[:, known]
    return np.where(robot.is_known, 0.0, Y).reshape(-1, 10 * robot.n)


def _best_pivots(draws: list[Array], rank: int) -> list[int]:
    """Return the columns of the one pivoting whose pick is best conditioned over all draws.

    Of two that are equal but for rounding it is the first, whatever kernel adds the numbers.
    """
    factors = [np.asarray(np.linalg.qr(H, mode="r")) for H in draws]
    R = np.asarray(np.linalg.qr(np.concatenate(factors), mode="r"))
    picked = [_pivots(factor, rank) for factor in factors]
    condition = [float(_safely(np.linalg.cond, R[:, columns])) for columns in picked]
    return picked[_first_of(np.array(condition) <= (1 + _ALIKE) * min(condition))]


def _pivots(factor: Array, rank: int) -> list[int]:
    """Return the columns that pivoting picks, sorted: each time the one with most left, the first
    of those that are alike. Robots have exact ties: a link turns about an axis of its own symmetry.
    """
    left = factor.copy()
    columns: list[int] = []
    for _ in range(rank):
        norms = np.linalg.norm(left, axis=0)
        norms[columns] = 0.0
        column = _first_of(norms >= (1 - _ALIKE) * np.max(norms))
        columns.append(column)
        unit = left[:, column] / np.linalg.norm(left[:, column])
        for _ in range(2):  # twice: what rounding left of the direction goes too
            left -= np.outer(unit, unit @ left)
    return sorted(columns)


def _first_of(chosen: BoolArray) -> int:
    return int(np.flatnonzero(chosen)[0])
