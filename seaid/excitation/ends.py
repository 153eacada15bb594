"""The motions of a basis that keep given ends, and the limits they keep at every instant.

End states are linear equations in the coefficients; what they leave free is a null space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.errors import ExcitationError
from seaid.excitation.basis import Basis
from seaid.excitation.end_conditions import (
    FREE,
    SAME,
    EndState,
    check_met,
    check_within,
    end_conditions,
    solutions,
)
from seaid.excitation.limits import KINDS, JointLimits, grouped, hull_rows

__all__ = ["FREE", "EndState", "MotionSpace", "limit_rows", "motion_space", "with_room"]

_WAY_SHARE, _WAY_DENSITY = 0.98, 4


@dataclass(frozen=True, eq=False)
class MotionSpace:
    """The motions of a basis that keep given ends, over free variables x (n k,), joint by joint.

    The coefficients (K, n) are home + half_range * (free @ x_j for every joint j): `home` (K, n) is
    a motion well within limits, `free` (K, k), `half_range` (n,) half of each joint's range. `ways`
    are motions that hang on this one and have to keep the limits too, see `with_run_in`: each a
    basis of size L and the matrix (L, K) from coefficients to its own.
    """

    basis: Basis
    home: Array
    half_range: Array
    free: Array
    ways: tuple[tuple[Basis, Array], ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """Number of joints and of free variables a joint, (n, k)."""
        return len(self.half_range), self.free.shape[1]

    def coefficients(self, x: Array) -> Array:
        """Return the coefficients (K, n) of free variables x (n k,) or (n, k)."""
        return self.home + self.half_range * (self.free @ np.reshape(x, self.shape).T)


@dataclass(frozen=True, eq=False)
class _Block:
    """The limit of one kind on one curve: |rows (n, C, k) @ x_j + offsets (n, C)| <= 1.

    `decided` (n, D) are offsets whose rows are zero: nothing but the ends decides them.
    """

    kind: int
    rows: Array
    offsets: Array
    decided: Array


def motion_space(
    basis: Basis,
    joint_names: Sequence[str],
    limits: JointLimits,
    start: EndState,
    end: EndState,
) -> MotionSpace:
    """Return the motions of a basis that start and end as asked.

    Home is the middle of each joint's range where that keeps the ends, else the motion with the
    most room, see `with_room`. Raises ExcitationError for an end state that is not finite, names
    other joints, lies outside the limits, contradicts the other end of a periodic basis, needs more
    coefficients, or leaves no motion within limits.
    """
    asked = end_conditions(basis, joint_names, start, end)
    check_within(asked, joint_names, limits)
    free, back = solutions(basis, asked)
    middle = np.outer(basis.constant, limits.middle)
    missed = asked.missed(middle)
    home = middle + back @ missed
    check_met(asked, home, joint_names, limits)
    moved = np.any(np.abs(missed) > SAME * limits.half_range, axis=0)
    space = MotionSpace(basis, np.where(moved, home, middle), limits.half_range, free)
    return with_room(space, joint_names, limits, moved)


def limit_rows(space: MotionSpace, limits: JointLimits) -> tuple[Array, Array]:
    """Return G (n, g, c, k) and offsets g (n, g, c) of the limits that x can break.

    Joint j keeps its limits of position, velocity and acceleration at every instant if
    |G[j] x_j + g[j]| <= 1. The rows are hulls close to the curve: g groups of c follow each other
    in time (the last row of each kind fills its group). Rows that the ends alone decide are left
    out: `motion_space` has checked them.
    """
    blocks = _blocks(space, limits)
    return (
        np.concatenate([grouped(block.rows, 1) for block in blocks], axis=1),
        np.concatenate([grouped(block.offsets, 1) for block in blocks], axis=1),
    )


def with_room(
    space: MotionSpace, joint_names: Sequence[str], limits: JointLimits, moved: BoolArray
) -> MotionSpace:
    """Return the space with a home that has room on all sides, for the joints `moved` (n,).

    It is the centre of the largest ball of free variables within limits, from a linear programme.
    Raises ExcitationError, naming joint and limit, where nothing is within.
    """
    blocks, home = _blocks(space, limits), space.home.copy()
    for joint in map(int, np.flatnonzero(moved)):
        for block in blocks:
            use = np.abs(block.decided[joint]).max(initial=0.0)
            if use > 1.0 + SAME:
                raise _infeasible(joint_names[joint], block.kind, use)
        rows = np.concatenate([block.rows[joint] for block in blocks])
        offsets = np.concatenate([block.offsets[joint] for block in blocks])
        y, room = _roomiest(rows, offsets, np.linalg.norm(rows, axis=1))
        if room <= 0 or np.abs(rows @ y + offsets).max() >= 1.0:
            y, _ = _roomiest(rows, offsets, np.ones(len(rows)))
            use = np.abs(rows @ y + offsets)
            kinds = np.repeat([b.kind for b in blocks], [b.offsets.shape[1] for b in blocks])
            raise _infeasible(joint_names[joint], int(kinds[use.argmax()]), float(use.max()))
        home[:, joint] += space.half_range[joint] * (space.free @ y)
    return replace(space, home=home)


def _blocks(space: MotionSpace, limits: JointLimits) -> list[_Block]:
    itself = (space.basis, np.eye(space.basis.size))
    blocks = [_block(space, limits, kind, itself, None) for kind in range(3)]
    return blocks + [
        _block(space, limits, kind, way, _WAY_DENSITY) for way in space.ways for kind in range(3)
    ]


def _block(
    space: MotionSpace,
    limits: JointLimits,
    kind: int,
    curve: tuple[Basis, Array],
    density: int | None,
) -> _Block:
    basis, matrix = curve
    hull, bounds, middle = hull_rows(basis, limits, kind, density)
    hull = hull @ matrix
    scale = bounds if density is None else _WAY_SHARE * bounds
    moves = hull @ space.free
    whole = np.linalg.norm(hull @ space.basis.natural, axis=1)
    free = np.linalg.norm(moves, axis=1) > SAME * whole
    about = space.home - np.outer(space.basis.constant, middle)
    offsets = ((hull @ about) / scale).T
    rows = (space.half_range / scale)[:, None, None] * moves[free]
    return _Block(kind, rows, offsets[:, free], offsets[:, ~free])


def _roomiest(rows: Array, offsets: Array, weights: Array) -> tuple[Array, float]:
    """Return y and the largest s with |rows @ y + offsets| + weights * s <= 1."""
    from scipy.optimize import linprog

    sides = np.vstack([np.column_stack([sign * rows, weights]) for sign in (1.0, -1.0)])
    right = np.concatenate([1.0 - offsets, 1.0 + offsets])
    cost = np.zeros(sides.shape[1])
    cost[-1] = -1.0
    found = linprog(cost, A_ub=sides, b_ub=right, bounds=(None, None), method="highs")
    if found.x is None:
        raise ExcitationError(f"no motion that keeps the ends was found: {found.message}")
    return found.x[:-1], float(found.x[-1])


def _infeasible(joint: str, kind: int, use: float) -> ExcitationError:
    return ExcitationError(
        f"joint '{joint}': no motion between these ends keeps its {KINDS[kind]} limit at every "
        f"instant, at best it uses {use:.4g} of it; give a longer duration, more coefficients or "
        "wider limits"
    )
