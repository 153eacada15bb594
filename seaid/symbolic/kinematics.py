"""How a joint changes what its body's energy is made of: v, v v^T and gravity, as plain sums.

v = (linear, angular) velocity; v v^T is kept as its 21 upper entries. A joint about or along z
makes v into X(q) v + phi q' with X(q) = A_0 + A_c cos q + A_s sin q or A_0 + A_q q, and so each of
the three into a sum over monomials of q, after sin^2 = 1 - cos^2: no reduction is left to do.
The entries may be rationals or polynomials. Motion of the base and bodies: METHOD 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from flint import fmpq_mat

Powers = tuple[int, int]
"""Powers of (cos q, sin q), or of (q, -) where the joint slides."""

Sum = tuple[tuple[int, int, Any], ...]
"""A sparse matrix of integers or rationals: (row, column, value)."""

_Square = Sequence[Sequence[int]]

PAIRS = tuple((i, j) for i in range(6) for j in range(i, 6))
"""The entries of a symmetric matrix (6, 6) that are kept, in their order."""

PAIR = {pair: place for place, pair in enumerate(PAIRS)} | {
    (j, i): place for place, (i, j) in enumerate(PAIRS)
}

_ONE, _C, _S, _CC, _CS = (0, 0), (1, 0), (0, 1), (2, 0), (1, 1)


@dataclass(frozen=True, eq=False)
class JointKind:
    """What a joint of a kind does: `axis` is the place of 1 in phi, the rest sums by monomial."""

    axis: int
    velocity: Mapping[Powers, Sum]
    square: Mapping[Powers, Sum]
    gravity: Mapping[Powers, Sum]


def _turning() -> JointKind:
    still, cosine, sine = (
        ((0, 0, 0), (0, 0, 0), (0, 0, 1)),
        ((1, 0, 0), (0, 1, 0), (0, 0, 0)),
        ((0, 1, 0), (-1, 0, 0), (0, 0, 0)),
    )
    parts = {_ONE: _both(still), _C: _both(cosine), _S: _both(sine)}
    square = {
        _ONE: ((_ONE, _ONE, 1), (_S, _S, 1)),
        _C: ((_ONE, _C, 1), (_C, _ONE, 1)),
        _S: ((_ONE, _S, 1), (_S, _ONE, 1)),
        _CC: ((_C, _C, 1), (_S, _S, -1)),
        _CS: ((_C, _S, 1), (_S, _C, 1)),
    }
    return JointKind(
        axis=5,
        velocity={powers: _sparse(part) for powers, part in parts.items()},
        square={powers: _squared(parts, terms) for powers, terms in square.items()},
        gravity={_ONE: _sparse(still), _C: _sparse(cosine), _S: _sparse(sine)},
    )


def _sliding() -> JointKind:
    same = [[int(i == j) for j in range(6)] for i in range(6)]
    along = [[0] * 6 for _ in range(6)]
    along[0][4], along[1][3] = 1, -1
    parts = {_ONE: same, _C: along}
    square = {
        _ONE: ((_ONE, _ONE, 1),),
        _C: ((_ONE, _C, 1), (_C, _ONE, 1)),
        _CC: ((_C, _C, 1),),
    }
    return JointKind(
        axis=2,
        velocity={powers: _sparse(part) for powers, part in parts.items()},
        square={powers: _squared(parts, terms) for powers, terms in square.items()},
        gravity={_ONE: tuple((i, i, 1) for i in range(3))},
    )


def _both(block: _Square) -> _Square:
    zero = [0, 0, 0]
    return [[*row, *zero] for row in block] + [[*zero, *row] for row in block]


def _sparse(matrix: _Square) -> Sum:
    return tuple((i, j, x) for i, row in enumerate(matrix) for j, x in enumerate(row) if x)


def _squared(parts: Mapping[Powers, _Square], terms: Sequence[tuple[Powers, Powers, int]]) -> Sum:
    """Return the sum over (a, b, sign) of A_a w A_b^T as a matrix on the 21 entries of w."""
    found: dict[tuple[int, int], int] = {}
    for a, b, sign in terms:
        for (i, k, x), (j, m, y) in product(_sparse(parts[a]), _sparse(parts[b])):
            if i <= j:
                place = PAIR[i, j], PAIR[k, m]
                found[place] = found.get(place, 0) + sign * x * y
    return tuple((row, column, value) for (row, column), value in found.items() if value)


TURNING, SLIDING = _turning(), _sliding()

TWICE_KINETIC: Sum = (
    *((0, PAIR[i, i], 1) for i in range(3)),
    *((1, PAIR[1, 5], 2), (1, PAIR[2, 4], -2)),
    *((2, PAIR[2, 3], 2), (2, PAIR[0, 5], -2)),
    *((3, PAIR[0, 4], 2), (3, PAIR[1, 3], -2)),
    *((4, PAIR[3, 3], 1), (5, PAIR[3, 4], 2), (6, PAIR[4, 4], 1)),
    *((7, PAIR[3, 5], 2), (8, PAIR[4, 5], 2), (9, PAIR[5, 5], 1)),
)
"""2 K of a body, a row for each of its ten parameters, from the 21 entries of v v^T."""


def applied(matrix: Sum, vector: Sequence[Any], rows: int, zero: Any) -> list[Any]:
    """Return matrix @ vector for entries of any ring."""
    result = [zero] * rows
    for row, column, value in matrix:
        entry = vector[column]
        result[row] = result[row] + (entry if value == 1 else value * entry)
    return result


def with_axis(kind: JointKind, velocity: Sequence[Any], zero: Any) -> list[Any]:
    """Return the 21 entries of phi v^T + v phi^T."""
    result = [zero] * 21
    for place, entry in enumerate(velocity):
        result[PAIR[place, kind.axis]] = entry if place != kind.axis else 2 * entry
    return result


def twist_transform(rotation: fmpq_mat, translation: fmpq_mat) -> fmpq_mat:
    """Return (6, 6): the velocity at the frame placed by both, in its axes, from the parent's."""
    x, y, z = translation.entries()
    cross = fmpq_mat([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    turned, moved = rotation.transpose(), rotation.transpose() * cross
    rows = [[*turned.tolist()[i], *moved.tolist()[i]] for i in range(3)]
    return fmpq_mat(rows + [[0, 0, 0, *turned.tolist()[i]] for i in range(3)])


def inertia_transform(rotation: fmpq_mat, translation: fmpq_mat) -> fmpq_mat:
    """Return (10, 10): the ten parameters in the frame in which both place the body's frame.

    By the pseudo-inertia T J T^T (Wensing et al. 2018), as `seaid.inertia.in_parent_frame`.
    """
    rows = [[*rotation.tolist()[i], translation[i, 0]] for i in range(3)]
    T = fmpq_mat([*rows, [0, 0, 0, 1]])
    columns = [_from_pseudo(T * J * T.transpose()) for J in _PSEUDO]
    return fmpq_mat(columns).transpose()


_INERTIA = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def _unit_pseudo(place: int) -> fmpq_mat:
    """Return the pseudo-inertia of a unit parameter."""
    J = fmpq_mat(4, 4)
    if place < 4:
        row, column = (3, 3) if place == 0 else (place - 1, 3)
        J[row, column] = J[column, row] = 1
        return J
    row, column = _INERTIA[place - 4]
    J[row, column] = J[column, row] = -1
    if row == column:
        for axis in range(3):
            J[axis, axis] = (fmpq_mat([[1]]) / 2)[0, 0] * (-1 if axis == row else 1)
    return J


_PSEUDO = tuple(_unit_pseudo(place) for place in range(10))


def _from_pseudo(J: fmpq_mat) -> list[Any]:
    trace = J[0, 0] + J[1, 1] + J[2, 2]
    second = [(trace if i == j else 0) - J[i, j] for i, j in _INERTIA]
    return [J[3, 3], J[0, 3], J[1, 3], J[2, 3], *second]
