"""The undetectable changes of a tree's inertial parameters, by one small null space per joint.

A change of body i is undetectable, in combination with a change of its parent, exactly if its
energy seen from the parent does not depend on q_i and q_i' (Wensing, Niemeyer and Slotine 2017, who
do it numerically). The parent's motions enter by the spans of v, v v^T and gravity. The cost is
O(n); nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from flint import fmpq, fmpq_mat

from seaid.regressor.exact.geometry import (
    PAIRS,
    SLIDING,
    TURNING,
    TWICE_KINETIC,
    ExactJoint,
    ExactTree,
    JointKind,
    applied,
    inertia_transform,
    twist_transform,
    with_axis,
)

Vector = list[fmpq]

Null = dict[int, fmpq]
"""A combination of standard parameters without any effect: {column: value}."""

_ZERO = fmpq(0)


@dataclass(frozen=True, eq=False)
class Spans:
    """Bases of the spans over all motions of a body: v (at most 6), v v^T (21), gravity (3)."""

    velocity: list[Vector]
    square: list[Vector]
    gravity: list[Vector]

    @property
    def is_full(self) -> bool:
        """True if the spans are the whole spaces, and so those of every body further out."""
        return (len(self.velocity), len(self.square), len(self.gravity)) == (6, 21, 3)


def null_space(tree: ExactTree, *, floating: bool = False) -> list[Null]:
    """Return a basis of the undetectable changes of the 10n parameters, parents first.

    With a `floating` base its own ten parameters come first, so that there are 10 (n + 1).
    """
    shift = 10 if floating else 0
    base = _full_spans() if floating else Spans([], [], _basis([tree.gravity.entries()]))
    spans = {-1: base}
    nulls: list[Null] = []
    for place, (joint, body) in enumerate(zip(tree.joints, tree.bodies, strict=True)):
        hidden, spans[place] = _hidden(joint, spans[joint.parent])
        own = inertia_transform(joint.alignment)
        above, parent = inertia_transform(joint.rotation, joint.translation), 0
        if joint.parent >= 0:
            above = inertia_transform(tree.joints[joint.parent].alignment) * above
            parent = 10 * tree.bodies[joint.parent] + shift
        for change in hidden:
            null = _at(10 * body + shift, own * change)
            if joint.parent >= 0 or floating:
                null |= _at(parent, -(above * change))
            nulls.append(null)
    return nulls


def _at(column: int, parameters: fmpq_mat) -> Null:
    return {column + i: x for i, x in enumerate(parameters.entries()) if x != 0}


def _hidden(joint: ExactJoint, above: Spans) -> tuple[list[fmpq_mat], Spans]:
    """Return the changes (10, 1) of a body that its parent can compensate, and the body's spans."""
    kind = SLIDING if joint.is_prismatic else TURNING
    if above.is_full:
        return _hidden_from_all(kind), above
    conditions, beyond = _through(kind, _placed(above, joint))
    return _nullspace(conditions), beyond


@cache
def _hidden_from_all(kind: JointKind) -> list[fmpq_mat]:
    return _nullspace(_through(kind, _full_spans())[0])


def _full_spans() -> Spans:
    return Spans(_unit(6), _unit(21), _unit(3))


def _unit(size: int) -> list[Vector]:
    return [[fmpq(int(i == j)) for j in range(size)] for i in range(size)]


def _placed(above: Spans, joint: ExactJoint) -> Spans:
    """Return the parent's spans in the joint's frame at zero position."""
    turned = joint.rotation.transpose()
    X = twist_transform(joint.rotation, joint.translation)
    velocity, square, gravity = above.velocity, above.square, above.gravity
    if len(velocity) < 6:
        velocity = [(X * _column(v)).entries() for v in velocity]
    if len(square) < 21:
        full = [X * _symmetric(w) * X.transpose() for w in square]
        square = [[matrix[i, j] for i, j in PAIRS] for matrix in full]
    if len(gravity) < 3:
        gravity = [(turned * _column(z)).entries() for z in gravity]
    return Spans(velocity, square, gravity)


def _through(kind: JointKind, above: Spans) -> tuple[list[Vector], Spans]:
    """Return the conditions on a body's ten parameters, and the spans of its own motions."""
    along = [fmpq(int(place == kind.axis)) for place in range(6)]
    velocity = [
        applied(part, v, 6, _ZERO) for v in above.velocity for part in kind.velocity.values()
    ]
    moving = [with_axis(kind, v, _ZERO) for v in (*velocity, along)]
    still: list[Vector] = []
    for w in above.square:
        for powers, part in kind.square.items():
            (moving if any(powers) else still).append(applied(part, w, 21, _ZERO))
    kinetic = [applied(TWICE_KINETIC, w, 10, _ZERO) for w in moving]
    potential, gravity = _potential(kind, above.gravity)
    return [*kinetic, *potential], Spans(
        velocity=_widened(above.velocity, [*velocity, along]),
        square=_widened(above.square, [*moving, *still]),
        gravity=_widened(above.gravity, gravity),
    )


def _potential(kind: JointKind, above: list[Vector]) -> tuple[list[Vector], list[Vector]]:
    """Return the conditions from the potential energy, and the directions of gravity behind."""
    conditions, gravity = [], []
    for z in above:
        if kind is SLIDING:
            conditions.append([z[2], *[_ZERO] * 9])
        for powers, part in kind.gravity.items():
            turned = applied(part, z, 3, _ZERO)
            gravity.append(turned)
            if any(powers):
                conditions.append([_ZERO, *turned, *[_ZERO] * 6])
    return conditions, gravity


def _widened(above: list[Vector], vectors: list[Vector]) -> list[Vector]:
    """Return a basis of the vectors; `above` if it is already one of the whole space."""
    return above if above and len(above) == len(above[0]) else _basis(vectors)


def _basis(vectors: Sequence[Sequence[fmpq]]) -> list[Vector]:
    """Return the reduced basis of the span of the vectors."""
    if not vectors:
        return []
    echelon, rank = fmpq_mat([list(vector) for vector in vectors]).rref()
    return [list(row) for row in echelon.tolist()[:rank]]


def _nullspace(rows: Sequence[Vector]) -> list[fmpq_mat]:
    """Return a basis of vectors (10, 1) that all rows map to zero."""
    echelon = _basis(rows)
    pivots = [next(j for j, x in enumerate(row) if x != 0) for row in echelon]
    found = []
    for free in (j for j in range(10) if j not in pivots):
        vector = [fmpq(int(j == free)) for j in range(10)]
        for row, pivot in zip(echelon, pivots, strict=True):
            vector[pivot] = -row[free]
        found.append(_column(vector))
    return found


def _column(vector: Sequence[fmpq]) -> fmpq_mat:
    return fmpq_mat(len(vector), 1, list(vector))


def _symmetric(entries: Sequence[fmpq]) -> fmpq_mat:
    matrix = fmpq_mat(6, 6)
    for (i, j), value in zip(PAIRS, entries, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix
