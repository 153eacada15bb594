"""What is asked of the two ends of a motion, as linear equations in its coefficients.

The motions of a basis that keep given ends, and the limits they keep at every instant.

End states are linear equations in the coefficients; what they leave free is a null space.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, finite, safely
from seaid.errors import ExcitationError, unknown_name
from seaid.excitation.basis import Basis
from seaid.excitation.limits import KINDS, JointLimits, grouped, hull_rows

EndValue = float | Sequence[float] | Array | Mapping[str, float] | None
SAME = 1e-9
"""What rounding may take, as a part of the whole."""

_ENDS = ("start", "end")


@dataclass(frozen=True, eq=False)
class EndState:
    """Position, velocity and acceleration at one end of a motion [rad or m, s].

    Each is one number for all joints, one a joint, a mapping {joint: value} of all joints, or None:
    free. Without arguments it is rest at a position that stays free.
    """

    position: EndValue = None
    velocity: EndValue = 0.0
    acceleration: EndValue = 0.0


IN_MOTION = EndState(None, None, None)
"""An end at which nothing is asked."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Equations rows (c, K) @ coefficients (K, n) = values (c, n).

    Condition i is on the kind `kinds[i]` (0 position, 1 velocity, 2 acceleration) at the end
    `ends[i]` (0 start, 1 end). `sizes` (c,) are the lengths of the rows over natural variables.
    """

    rows: Array
    values: Array
    sizes: Array
    kinds: tuple[int, ...]
    ends: tuple[int, ...]

    def missed(self, coefficients: Array) -> Array:
        """Return by how much coefficients (K, n) miss each condition (c, n), all weighed alike."""
        return (self.values - self.rows @ coefficients) / self.sizes[:, None]


def end_conditions(
    basis: Basis, joint_names: Sequence[str], start: EndState, end: EndState
) -> Conditions:
    """Return what end states ask of a basis. Raises ExcitationError for values that cannot be."""
    tables = basis.matrices(np.array([0.0, basis.duration]))
    found: list[tuple[Array, Array, int, int]] = []
    for which, state in enumerate((start, end)):
        for kind, given in enumerate((state.position, state.velocity, state.acceleration)):
            if given is not None:
                name = f"{KINDS[kind]} at the {_ENDS[which]}"
                values = _end_values(name, given, tuple(joint_names))
                found.append((tables[kind][which], values, kind, which))
    rows = np.array([row for row, *_ in found]).reshape(-1, basis.size)
    return Conditions(
        rows,
        np.array([values for _, values, *_ in found]).reshape(-1, len(joint_names)),
        np.asarray(np.linalg.norm(rows @ basis.natural, axis=1)),
        tuple(kind for *_, kind, _ in found),
        tuple(which for *_, which in found),
    )


def solutions(basis: Basis, asked: Conditions) -> tuple[Array, Array]:
    """Return the matrix (K, k) of what conditions leave free, and (K, c) from `missed` to a change.

    The first has orthonormal columns over natural variables. Raises ExcitationError for a basis
    whose coefficients are too few.
    """
    from scipy.linalg import qr

    rows = (asked.rows @ basis.natural) / asked.sizes[:, None]
    if not len(rows):
        return basis.natural, np.empty((basis.size, 0))
    Q, R, _ = qr(rows.T, pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > SAME))
    # where no position is asked, one that does not move at all is left, and is no motion
    least = rank + (1 if 0 in asked.kinds else 2)
    if basis.size < least:
        raise ExcitationError(
            f"{basis.size} coefficients a joint are too few for the ends asked, which are {rank} "
            f"conditions; give at least {least}"
        )
    back = safely(
        np.linalg.pinv, rows, what="the ends of a motion", error=ExcitationError, rcond=SAME
    )
    return np.asarray(basis.natural @ Q[:, rank:]), np.asarray(basis.natural @ back)


def check_within(asked: Conditions, joint_names: Sequence[str], limits: JointLimits) -> None:
    """Raise ExcitationError, naming joint, end and limit, where an end state breaks a limit."""
    low = (limits.lower, -limits.velocity, -limits.acceleration)
    high = (limits.upper, limits.velocity, limits.acceleration)
    for kind, which, values in zip(asked.kinds, asked.ends, asked.values, strict=True):
        for joint, value, least, most in zip(
            joint_names, values, low[kind], high[kind], strict=True
        ):
            if not least - SAME <= value <= most + SAME:
                raise ExcitationError(
                    f"joint '{joint}': {KINDS[kind]} {value:.6g} at the {_ENDS[which]} is outside "
                    f"its limits, {least:.6g} to {most:.6g}; give another or wider Limits"
                )


def check_met(
    asked: Conditions, coefficients: Array, joint_names: Sequence[str], limits: JointLimits
) -> None:
    """Raise ExcitationError where the conditions contradict each other: a periodic basis."""
    reach = limits.half_range + np.abs(coefficients).max(axis=0)
    wrong = np.argwhere(np.abs(asked.missed(coefficients)) > SAME * reach)
    if len(wrong):
        condition, joint = wrong[0]
        kind = asked.kinds[condition]
        start, end = asked.values[np.array(asked.kinds) == kind, joint]
        raise ExcitationError(
            f"joint '{joint_names[joint]}': {KINDS[kind]} {start:.6g} at the start and {end:.6g} "
            "at the end contradict each other, for a fourier series is periodic and ends as it "
            "starts; give equal ends, leave one free, or take a bspline"
        )


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


__all__ = ["IN_MOTION", "EndState", "MotionSpace", "limit_rows", "motion_space", "with_room"]

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

    It is the centre of the largest ball of free variables within limits, from a linear program.
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
