"""The energy of every body as exact polynomials, a column for each standard parameter.

The Lagrangian L = K - U is linear in the standard parameters, so it is a table: the rows are
functions of the motion (monomials in sin q, cos q, q' with sin^2 taken out, which are linearly
independent), the columns the parameters. Nothing of it is an equation of motion yet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flint import Ordering, fmpq, fmpq_mat, fmpq_mpoly, fmpq_mpoly_ctx

from seaid.errors import SymbolicError
from seaid.progress import track
from seaid.symbolic.geometry import ExactJoint, ExactTree
from seaid.symbolic.grouping import SparseRow
from seaid.symbolic.kinematics import (
    PAIR,
    PAIRS,
    SLIDING,
    TURNING,
    TWICE_KINETIC,
    Powers,
    Sum,
    applied,
    inertia_transform,
    twist_transform,
    with_axis,
)

Monomial = tuple[int, ...]
"""Exponents: three a joint, of cos q (of q where it slides), of sin q, of q'."""

_GROWTH = 4
"""About how many times as many terms a body's motion has as its parent's."""

_NO_SHIFT = fmpq_mat(3, 1)


@dataclass(frozen=True, eq=False)
class _State:
    """A body's motion as polynomials: v, v v^T, gravity in its frame, gravity times place."""

    velocity: Sequence[fmpq_mpoly]
    square: Sequence[fmpq_mpoly]
    gravity: Sequence[fmpq_mpoly]
    height: fmpq_mpoly


def lagrangian_table(
    tree: ExactTree, max_terms: int, *, progress: bool = False
) -> dict[Monomial, SparseRow]:
    """Return {function of the motion: {parameter: coefficient}} of L, constants left out.

    Raises SymbolicError before there are more than `max_terms` terms in it.
    """
    n = len(tree.joints)
    names = [f"{letter}{i}" for i in range(n) for letter in ("c", "s", "v")]
    ring = fmpq_mpoly_ctx.get(names, Ordering.lex)
    zero = ring.constant(0)
    gravity = [ring.constant(x) for x in tree.gravity.entries()]
    base = _State([zero] * 6, [zero] * 21, gravity, zero)
    states: list[_State] = []
    table: dict[Monomial, SparseRow] = {}
    still = (0,) * (3 * n)
    count = 0
    for place, joint in track(list(enumerate(tree.joints)), "Energies", progress):
        above = base if joint.parent < 0 else states[joint.parent]
        expected = count + _GROWTH * sum(map(len, above.square))
        if expected > max_terms:
            raise too_large(expected, max_terms, place, n)
        state = _moved(ring, place, joint, _placed(joint, above, zero), zero)
        states.append(state)
        first = 10 * tree.bodies[place]
        columns = _columns(state, joint, zero)
        count += sum(map(len, columns)) + sum(map(len, state.square))
        for column, polynomial in enumerate(columns, first):
            for monomial, value in polynomial.terms():
                if monomial != still:
                    table.setdefault(monomial, {})[column] = value
    return table


def too_large(count: int, max_terms: int, place: int, joints: int) -> SymbolicError:
    """Return the error for a system that does not fit."""
    return SymbolicError(
        f"the system is too large for its polynomials: about {count} terms at joint {place + 1} of "
        f'{joints}, max_terms={max_terms}; take through="recursion", which has none, fewer joints '
        "with load_robot(..., joints=[...]), or raise max_terms (about 1 kB a term)"
    )


def _placed(joint: ExactJoint, above: _State, zero: fmpq_mpoly) -> _State:
    """Return the parent's motion as seen from the joint's frame at zero."""
    X = _sparse(twist_transform(joint.rotation, joint.translation))
    turned = _sparse(joint.rotation.transpose())
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


def _sparse(matrix: fmpq_mat) -> Sum:
    rows = matrix.tolist()
    return tuple((i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row) if x != 0)


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

    carried = through(kind.velocity, above.velocity)
    square = through(kind.square, above.square)
    for i, x in enumerate(with_axis(kind, carried, zero)):
        square[i] = square[i] + speed * x
    axis = PAIR[kind.axis, kind.axis]
    square[axis] = square[axis] + speed * speed
    carried[kind.axis] = carried[kind.axis] + speed
    height = above.height + (cosine * above.gravity[2] if joint.is_prismatic else zero)
    return _State(carried, square, through(kind.gravity, above.gravity), height)


def _columns(state: _State, joint: ExactJoint, zero: fmpq_mpoly) -> list[fmpq_mpoly]:
    """Return L of a body for each of its ten parameters in its own frame."""
    half = fmpq(1, 2)
    columns = [half * x for x in applied(TWICE_KINETIC, state.square, 10, zero)]
    for i, x in enumerate((state.height, *state.gravity)):
        columns[i] = columns[i] + x
    to_aligned = inertia_transform(joint.alignment.transpose(), _NO_SHIFT)
    return applied(_sparse(to_aligned.transpose()), columns, 10, zero)
