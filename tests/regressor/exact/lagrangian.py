"""Exact base parameters by kinetic and potential energy, as a proof of the recursion.

L = K - U is linear in the standard parameters: L = sum of f_i(q, q') * (row i of the table) @ theta
with f_i monomials in sin q, cos q and q', linearly independent once sin^2 is replaced.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from flint import Ordering, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from seaid.regressor.exact.geometry import (
    PAIR,
    PAIRS,
    SLIDING,
    TURNING,
    TWICE_KINETIC,
    ExactJoint,
    ExactTree,
    Powers,
    Sum,
    applied,
    independent_tree,
    inertia_transform,
    sparse,
    twist_transform,
    with_axis,
)
from seaid.regressor.exact.grouping import ExactBaseParameters, SparseRow, from_rows, packed
from seaid.robot import Robot

Monomial = tuple[int, ...]
"""Exponents, three per joint: of cos q (of q if prismatic), of sin q, of q'."""


@dataclass(frozen=True, eq=False)
class _State:
    """A body's motion as polynomials: v, v v^T, gravity in its frame, gravity @ position."""

    velocity: Sequence[fmpq_mpoly]
    square: Sequence[fmpq_mpoly]
    gravity: Sequence[fmpq_mpoly]
    height: fmpq_mpoly


def base_by_energy(robot: Robot) -> ExactBaseParameters:
    """Return the combinations in kinetic and potential energy, without columns of known bodies."""
    known, names = set(np.flatnonzero(robot.is_known).tolist()), robot.parameter_names
    rows = lagrangian_table(independent_tree(robot)).values()
    # Most rows are multiples of each other: few are left for the elimination.
    different = {tuple((j, row[j] / row[min(row)]) for j in sorted(row)) for row in rows if row}
    return packed(from_rows([dict(row) for row in different], len(names), without=known), names)


def lagrangian_table(tree: ExactTree) -> dict[Monomial, SparseRow]:
    """Return {function of the motion: {parameter: coefficient}} of L."""
    n = len(tree.joints)
    names = [f"{letter}{i}" for i in range(n) for letter in ("c", "s", "v")]
    ring = fmpq_mpoly_ctx.get(names, Ordering.lex)
    zero = ring.constant(0)
    gravity = [ring.constant(x) for x in tree.gravity.entries()]
    base = _State([zero] * 6, [zero] * 21, gravity, zero)
    states: list[_State] = []
    table: dict[Monomial, SparseRow] = {}
    still = (0,) * (3 * n)
    for place, joint in enumerate(tree.joints):
        above = base if joint.parent < 0 else states[joint.parent]
        state = _moved(ring, place, joint, _placed(joint, above, zero), zero)
        states.append(state)
        first = 10 * tree.bodies[place]
        columns = _columns(state, joint, zero)
        for column, polynomial in enumerate(columns, first):
            for monomial, value in polynomial.terms():
                # A constant energy acts on no joint.
                if monomial != still:
                    table.setdefault(monomial, {})[column] = value
    return table


def _placed(joint: ExactJoint, above: _State, zero: fmpq_mpoly) -> _State:
    """Return the parent's motion in the joint's frame at zero position."""
    X = sparse(twist_transform(joint.rotation, joint.translation).tolist())
    turned = sparse(joint.rotation.transpose().tolist())
    w = [[above.square[PAIR[i, j]] for j in range(6)] for i in range(6)]
    half = list(zip(*(applied(X, row, 6, zero) for row in w), strict=True))
    full = [applied(X, row, 6, zero) for row in half]
    offset = zip(joint.translation.entries(), above.gravity, strict=True)
    return _State(
        applied(X, above.velocity, 6, zero),
        [full[i][j] for i, j in PAIRS],
        applied(turned, above.gravity, 3, zero),
        above.height + sum((x * z for x, z in offset if x != 0), zero),
    )


def _moved(
    ring: fmpq_mpoly_ctx, place: int, joint: ExactJoint, above: _State, zero: fmpq_mpoly
) -> _State:
    """Return the motion of the body behind a joint."""
    kind = SLIDING if joint.is_prismatic else TURNING
    cosine, sine, speed = (ring.gen(3 * place + i) for i in range(3))

    def through(sums: Mapping[Powers, Sum], entries: Sequence[fmpq_mpoly]) -> list[fmpq_mpoly]:
        result = [zero] * len(entries)
        for (c, s), part in sums.items():
            factor = cosine**c * sine**s
            for i, x in enumerate(applied(part, entries, len(entries), zero)):
                if not x.is_zero():
                    result[i] = result[i] + (x * factor if c or s else x)
        return result

    propagated = through(kind.velocity, above.velocity)
    square = through(kind.square, above.square)
    # X v + phi q' has the square X w X^T + q' (phi u^T + u phi^T) + q'^2 phi phi^T with u = X v,
    # which `propagated` is until phi q' is added below.
    for i, x in enumerate(with_axis(kind, propagated, zero)):
        square[i] = square[i] + speed * x
    axis = PAIR[kind.axis, kind.axis]
    square[axis] = square[axis] + speed * speed
    propagated[kind.axis] = propagated[kind.axis] + speed
    # Of a prismatic joint the first generator is q itself.
    height = above.height + (cosine * above.gravity[2] if joint.is_prismatic else zero)
    return _State(propagated, square, through(kind.gravity, above.gravity), height)


def _columns(state: _State, joint: ExactJoint, zero: fmpq_mpoly) -> list[fmpq_mpoly]:
    """Return L of a body for each of its ten parameters in its own frame."""
    half = fmpq(1, 2)
    columns = [half * x for x in applied(TWICE_KINETIC, state.square, 10, zero)]
    # -U = m g^T p + h^T g, with g in the axes of the body.
    for i, x in enumerate((state.height, *state.gravity)):
        columns[i] = columns[i] + x
    to_aligned = inertia_transform(joint.alignment.transpose())
    return applied(sparse(to_aligned.transpose().tolist()), columns, 10, zero)
