"""The base columns a condition number is of: picked by QR with column pivoting, once for all."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from seaid.arrays import Array
from seaid.base import BaseParameters, base_of_columns, base_parameters, random_states
from seaid.errors import ExcitationError
from seaid.linear_algebra import safely
from seaid.rigid_body import regressor_at_drives
from seaid.robot import Robot

_safely_grouped = partial(safely, what="the base parameters", error=ExcitationError)

_DRAWS = 16
_LEFT = 1e-6
"""How much less every column weighs in the pivoting than its left neighbour. Columns whose parts
outside of those picked before are equally long occur in every robot; without it rounding, and so
the processor, would choose between them."""

_ALIKE = 1e-6
"""Relative difference of condition numbers that does not decide."""


def pivoted_base(robot: Robot, rows: Sequence[str] | None = None) -> BaseParameters:
    """Return the base parameters whose columns QR with column pivoting picks at random states.

    The pivoting (Businger and Golub 1965) is repeated over 16 draws of states; the columns kept are
    those with the smallest condition number over all states drawn, for it differs by a factor of
    two or three between draws. Between equally good columns the left one is picked. How many there
    are is the rank that `base_parameters` finds; the groupings are its own, solved for these
    columns. The choice depends on the robot and on `rows` alone. Raises ExcitationError where
    nothing is identifiable.
    """
    leftmost = base_parameters(robot, rows=rows)
    known = [robot.index(joint) for joint in robot.rows(rows)]
    draws = [_random_rows(robot, known, draw) for draw in range(_DRAWS)]
    columns = _best_pivots(draws, len(leftmost.columns))
    grouping = _safely_grouped(np.linalg.solve, leftmost.grouping[:, columns], leftmost.grouping)
    grouping[:, columns] = np.eye(len(columns))
    grouping[np.abs(grouping) < 1e-11 * np.abs(grouping).max()] = 0.0
    return base_of_columns(robot, columns, np.asarray(grouping, dtype=np.float64), leftmost.gap)


def _random_rows(robot: Robot, known: list[int], seed: int) -> Array:
    Y = regressor_at_drives(robot, *random_states(robot, seed, len(known)))[:, known]
    return np.where(robot.is_known, 0.0, Y).reshape(-1, 10 * robot.n)


def _best_pivots(draws: list[Array], rank: int) -> list[int]:
    """Return the columns of the one pivoting whose pick is best conditioned over all draws.

    Of two that are equal but for rounding it is the first.
    """
    from scipy.linalg import qr

    R: Array = qr(np.concatenate(draws), mode="r")[0][: draws[0].shape[1]]
    weights = 1.0 - _LEFT * np.arange(R.shape[1])
    pivots = (qr(H * weights, mode="r", pivoting=True)[1] for H in draws)
    picked: list[list[int]] = [sorted(order[:rank].tolist()) for order in pivots]
    condition = np.array([_safely_grouped(np.linalg.cond, R[:, columns]) for columns in picked])
    return picked[int(np.argmax(condition <= (1 + _ALIKE) * np.min(condition)))]
