"""How a motion starts and ends, and the motions of a basis that keep to it.

Given end states are linear equations in the coefficients; what they leave free is a null space.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid.arrays import Array, finite
from seaid.errors import ExcitationError, unknown_name
from seaid.excitation.basis import Basis
from seaid.excitation.limits import KINDS, JointLimits, grouped, hull_rows

EndValue = float | Sequence[float] | Array | Mapping[str, float] | None
_SAME = 1e-9
_MARGIN = 1e-9


@dataclass(frozen=True, eq=False)
class EndState:
    """Position, velocity and acceleration at one end of a motion [rad or m, s].

    Each is one number for all joints, one a joint, a mapping {joint: value} of all joints, or None:
    free. Without arguments it is rest at a position that stays free.
    """

    position: EndValue = None
    velocity: EndValue = 0.0
    acceleration: EndValue = 0.0


FREE = EndState(None, None, None)
"""An end at which nothing is asked."""


@dataclass(frozen=True, eq=False)
class MotionSpace:
    """The motions of a basis that keep given ends, over free variables x (n k,), joint by joint.

    The coefficients (K, n) are home + half_range * (free @ x_j for every joint j): `home` (K, n) is
    a motion well within limits, `free` (K, k), `half_range` (n,) half of each joint's range.
    """

    basis: Basis
    home: Array
    half_range: Array
    free: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Number of joints and of free variables a joint, (n, k)."""
        return len(self.half_range), self.free.shape[1]

    def coefficients(self, x: Array) -> Array:
        """Return the coefficients (K, n) of free variables x (n k,) or (n, k)."""
        return self.home + self.half_range * (self.free @ np.reshape(x, self.shape).T)


@dataclass(frozen=True, eq=False)
class _Conditions:
    """Rows (c, K) that give `kinds` (c,) at `ends` (c,), 0 or 1, and the values asked (c, n)."""

    rows: Array
    values: Array
    kinds: tuple[int, ...]
    ends: tuple[int, ...]


def motion_space(
    basis: Basis,
    joint_names: Sequence[str],
    limits: JointLimits,
    start: EndState,
    end: EndState,
) -> MotionSpace:
    """Return the motions of a basis that start and end as asked.

    Home is the middle of each joint's range where that keeps the ends, else the motion with the
    most room: the centre of the largest ball of free variables within limits (a linear programme).
    Raises ExcitationError for an end state that is not finite, of other joints, outside the limits,
    contradicts the other end of a periodic basis, needs more coefficients, or leaves no motion
    within limits.
    """
    asked = _conditions(basis, tuple(joint_names), start, end)
    _check_within(asked, joint_names, limits)
    space, rows = _null_space(basis, asked)
    _check_count(basis, asked, rows)
    home = np.outer(basis.constant, limits.middle)
    missed = asked.values - asked.rows @ home
    home = home + basis.natural @ np.linalg.pinv(rows) @ (missed / _norms(asked, basis))
    _check_consistent(basis, asked, home, joint_names, limits)
    found = MotionSpace(basis, home, limits.half_range, space)
    away = np.abs(missed / _norms(asked, basis)) > _SAME * limits.half_range
    return _with_most_room(found, joint_names, limits, np.any(away, axis=0))


def limit_rows(space: MotionSpace, limits: JointLimits) -> tuple[Array, Array]:
    """Return G (n, g, c, k) and offsets g (n, g, c) of the limits that x can break.

    Joint j keeps its limits of position, velocity and acceleration at every instant if
    |G[j] x_j + g[j]| <= 1. The rows are hulls close to the curve: g groups of c follow each other
    in time (the last row of each kind fills its group). Rows that the ends alone decide are left
    out: `motion_space` has checked them.
    """
    kinds = [_kind_rows(space, limits, kind) for kind in range(3)]
    G = np.concatenate([grouped(rows, 1) for rows, _, _ in kinds], axis=1)
    return G, np.concatenate([grouped(offsets, 1) for _, offsets, _ in kinds], axis=1)


def _kind_rows(space: MotionSpace, limits: JointLimits, kind: int) -> tuple[Array, Array, Array]:
    """Return rows (n, C, k) and offsets (n, C) of one kind of limit, and offsets decided (n, D)."""
    hull, scale, middle = hull_rows(space.basis, limits, kind)
    moves = hull @ space.free
    whole = np.linalg.norm(hull @ space.basis.natural, axis=1)
    free = np.linalg.norm(moves, axis=1) > _SAME * whole
    offsets = ((hull @ (space.home - np.outer(space.basis.constant, middle))) / scale).T
    rows = (space.half_range / scale)[:, None, None] * moves[free]
    return rows, offsets[:, free], offsets[:, ~free]


def _with_most_room(
    space: MotionSpace, joint_names: Sequence[str], limits: JointLimits, away: Any
) -> MotionSpace:
    """Return the space with a home within limits; joints that are not `away` stay in the middle."""
    kinds = [_kind_rows(space, limits, kind) for kind in range(3)]
    home = space.home.copy()
    for joint in map(int, np.flatnonzero(away)):
        for kind, (_, _, decided) in enumerate(kinds):
            use = np.abs(decided[joint]).max(initial=0.0)
            if use > 1.0 + _MARGIN:
                raise _infeasible(joint_names[joint], kind, use)
        rows = np.concatenate([rows[joint] for rows, _, _ in kinds])
        offsets = np.concatenate([offsets[joint] for _, offsets, _ in kinds])
        y, room = _solve(rows, offsets, np.linalg.norm(rows, axis=1))
        use = np.abs(rows @ y + offsets)
        if room <= 0 or use.max() >= 1.0 - _MARGIN:
            y, _ = _solve(rows, offsets, np.ones(len(rows)))
            use = np.abs(rows @ y + offsets)
            owner = np.repeat(range(3), [part[1].shape[1] for part in kinds])
            raise _infeasible(joint_names[joint], int(owner[use.argmax()]), use.max())
        home[:, joint] += space.half_range[joint] * (space.free @ y)
    return MotionSpace(space.basis, home, space.half_range, space.free)


def _solve(rows: Array, offsets: Array, weights: Array) -> tuple[Array, float]:
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


def _conditions(
    basis: Basis, joint_names: tuple[str, ...], start: EndState, end: EndState
) -> _Conditions:
    tables = basis.matrices(np.array([0.0, basis.duration]))
    found: list[tuple[Array, Array, int, int]] = []
    for which, state in enumerate((start, end)):
        for kind, given in enumerate((state.position, state.velocity, state.acceleration)):
            if given is not None:
                name = f"{KINDS[kind]} at the {_END[which]}"
                values = _end_values(name, given, joint_names)
                found.append((tables[kind][which], values, kind, which))
    n = len(joint_names)
    return _Conditions(
        np.array([row for row, *_ in found]).reshape(-1, basis.size),
        np.array([values for _, values, *_ in found]).reshape(-1, n),
        tuple(kind for *_, kind, _ in found),
        tuple(which for *_, which in found),
    )


_END = ("start", "end")


def _end_values(name: str, given: Any, joint_names: tuple[str, ...]) -> Array:
    """Return one part of an end state (n,)."""
    wanted = given
    if isinstance(given, Mapping):
        for joint in given:
            if joint not in joint_names:
                raise ExcitationError(f"{name}: " + unknown_name("joint", joint, joint_names))
        missing = [joint for joint in joint_names if joint not in given]
        if missing:
            raise ExcitationError(
                f"{name} is not given for {', '.join(missing)}; name all joints, or give None "
                "where it may be any"
            )
        wanted = [given[joint] for joint in joint_names]
    elif np.ndim(given) == 0:
        wanted = [given] * len(joint_names)
    return finite(name, wanted, (len(joint_names),), ExcitationError)


def _check_within(asked: _Conditions, joint_names: Sequence[str], limits: JointLimits) -> None:
    low = (limits.lower, -limits.velocity, -limits.acceleration)
    high = (limits.upper, limits.velocity, limits.acceleration)
    for kind, which, values in zip(asked.kinds, asked.ends, asked.values, strict=True):
        for joint, value, least, most in zip(
            joint_names, values, low[kind], high[kind], strict=True
        ):
            if not least - _MARGIN <= value <= most + _MARGIN:
                raise ExcitationError(
                    f"joint '{joint}': {KINDS[kind]} {value:.6g} at the {_END[which]} is outside "
                    f"its limits, {least:.6g} to {most:.6g}; give another or wider Limits"
                )


def _norms(asked: _Conditions, basis: Basis) -> Array:
    """Return what to divide each condition by (c, 1), so that all weigh alike."""
    return np.asarray(np.linalg.norm(asked.rows @ basis.natural, axis=1, keepdims=True))


def _null_space(basis: Basis, asked: _Conditions) -> tuple[Array, Array]:
    """Return `free` (K, k), and the conditions in variables of like size (c, K), scaled."""
    from scipy.linalg import qr

    rows = (asked.rows @ basis.natural) / _norms(asked, basis)
    if not len(rows):
        return basis.natural, rows
    Q, R, _ = qr(rows.T, pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > _SAME))
    return np.asarray(basis.natural @ Q[:, rank:]), rows


def _check_count(basis: Basis, asked: _Conditions, rows: Array) -> None:
    """Refuse ends that leave nothing, or no more than a constant position."""
    rank = int(np.linalg.matrix_rank(rows, _SAME)) if len(rows) else 0
    least = rank + (1 if 0 in asked.kinds else 2)
    if basis.size < least:
        raise ExcitationError(
            f"{basis.size} coefficients a joint are too few for the ends asked, which are {rank} "
            f"conditions; give at least {least}"
        )


def _check_consistent(
    basis: Basis,
    asked: _Conditions,
    home: Array,
    joint_names: Sequence[str],
    limits: JointLimits,
) -> None:
    missed = np.abs(asked.rows @ home - asked.values) / _norms(asked, basis)
    wrong = np.argwhere(missed > _SAME * (limits.half_range + np.abs(home).max(axis=0)))
    if len(wrong):
        condition, joint = wrong[0]
        kind = asked.kinds[condition]
        start, end = asked.values[[i for i, k in enumerate(asked.kinds) if k == kind]][:2, joint]
        raise ExcitationError(
            f"joint '{joint_names[joint]}': {KINDS[kind]} {start:.6g} at the start and {end:.6g} "
            "at the end contradict each other, for a fourier series is periodic and ends as it "
            "starts; give equal ends, leave one free, or take a bspline"
        )
