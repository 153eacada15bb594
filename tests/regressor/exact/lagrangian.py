"""Exact base parameters by Lagrange's equations, as a proof of the recursion and of the numbers.

L = K - U is linear in the standard parameters: L = sum of f_i(q, q') * (row i of the table) @ theta
with f_i monomials in sin q, cos q and q', linearly independent once sin^2 is replaced.

The torques are then the sum of E(f_i) * (row i) @ theta with Euler's operator
E = d/dt d/dq' - d/dq, applied to one monomial at a time, without ever forming the equations of
motion. For this, monomials are encoded as integers, with three bits per joint for its function of
q.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import gcd

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
    """Return the base parameters as the combinations in kinetic and potential energy."""
    return _base(robot, list(lagrangian_table(independent_tree(robot)).values()))


def base_by_torques(robot: Robot, joints: Sequence[str] | None = None) -> ExactBaseParameters:
    """Return the base parameters as the combinations in the torques of joints, (11) to (13)."""
    tree = independent_tree(robot)
    known = [robot.model_order.index(robot.index(x)) for x in joints or robot.joint_names]
    return _base(robot, torque_rows(tree, lagrangian_table(tree), known))


def _base(robot: Robot, rows: Sequence[SparseRow]) -> ExactBaseParameters:
    """Return the base parameters of rows of B in (12), without columns of known bodies."""
    known, names = set(np.flatnonzero(robot.is_known).tolist()), robot.parameter_names
    # Most rows of B are multiples of each other: few are left for the elimination.
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


_CODES: dict[Powers, int] = {(0, 0): 0, (1, 0): 1, (0, 1): 2, (2, 0): 3, (1, 1): 4}

_Slopes = Mapping[int, tuple[tuple[int, int], ...]]

_TURNING_SLOPES: _Slopes = {
    0: (),
    1: ((2, -1),),
    2: ((1, 1),),
    3: ((4, -2),),
    4: ((3, 2), (0, -1)),
}
"""Derivatives: cos' = -sin, sin' = cos, (cos^2)' = -2 cos sin, (cos sin)' = 2 cos^2 - 1."""

_SLIDING_SLOPES: _Slopes = {0: (), 1: ((0, 1),), 3: ((1, 2),)}

_Row = dict[int, int]
"""{row of the energy's table: factor}."""


def torque_rows(
    tree: ExactTree, table: Mapping[Monomial, SparseRow], known: Sequence[int]
) -> list[SparseRow]:
    """Return the rows of B for the torques of the joints `known`.

    Repeated sums of rows of the table are kept once.
    """
    bases: dict[tuple[tuple[int, fmpq], ...], int] = {}
    n = len(tree.joints)
    rows: dict[int, _Row] = {}
    slopes = [_SLIDING_SLOPES if joint.is_prismatic else _TURNING_SLOPES for joint in tree.joints]
    wanted = frozenset(known)
    for monomial, row in table.items():
        base = bases.setdefault(tuple(sorted(row.items())), len(bases))
        for k, function, factor in _euler_lagrange(monomial, n, slopes, wanted):
            # Function and joint as one number: the row of B.
            terms = rows.setdefault(function * n + k, {})
            terms[base] = terms.get(base, 0) + factor
    sums = {_primitive(terms) for terms in rows.values()}
    parts = list(bases)
    return [_expanded(terms, parts) for terms in sums]


def _euler_lagrange(
    monomial: Monomial, n: int, slopes: Sequence[_Slopes], wanted: frozenset[int]
) -> Iterator[tuple[int, int, int]]:
    """Yield (joint, function, factor) of the terms of E(f) for one monomial f of the energy.

    A function is encoded as its part in q, with nothing, q_i' q_j' or q_j'' in the higher bits.
    """
    part, slopes_of_part = _position_part(monomial, n, slopes)
    speeds = [i for i in range(n) for _ in range(monomial[3 * i + 2])]
    pair = 0
    if speeds:  # f = g(q) q_a' q_b': d/dt df/dq_a' = g q_b'' + sum_i dg/dq_i q_i' q_b'
        a, b = speeds
        pair = _pair(a, b, n)
        for k, partner in (a, b), (b, a):
            if k in wanted:
                yield k, part + ((1 + n * n + partner) << 3 * n), 1
                for i, function, factor in slopes_of_part:
                    yield k, function + _pair(i, partner, n), factor
    for k, function, factor in slopes_of_part:
        if k in wanted:
            yield k, function + pair, -factor


def _position_part(
    monomial: Monomial, n: int, slopes: Sequence[_Slopes]
) -> tuple[int, list[tuple[int, int, int]]]:
    """Return the code of a monomial's part in q, and its derivatives (joint, code, factor)."""
    codes = [_CODES[monomial[3 * i], monomial[3 * i + 1]] for i in range(n)]
    part = sum(code << 3 * i for i, code in enumerate(codes))
    return part, [
        (i, part + ((new - code) << 3 * i), factor)
        for i, code in enumerate(codes)
        for new, factor in slopes[i][code]
    ]


def _pair(i: int, j: int, n: int) -> int:
    """Return the code of q_i' q_j'."""
    return (1 + (i * n + j if i < j else j * n + i)) << 3 * n


def _primitive(terms: _Row) -> tuple[tuple[int, int], ...]:
    """Return the terms divided by their common factor, without zeros, the first one positive."""
    nonzero = sorted((base, factor) for base, factor in terms.items() if factor)
    common = gcd(*(factor for _, factor in nonzero)) if nonzero else 1
    if nonzero and nonzero[0][1] < 0:
        common = -common
    return tuple((base, factor // common) for base, factor in nonzero)


def _expanded(
    terms: tuple[tuple[int, int], ...], parts: Sequence[tuple[tuple[int, fmpq], ...]]
) -> SparseRow:
    row: SparseRow = {}
    for base, factor in terms:
        for column, value in parts[base]:
            row[column] = row.get(column, 0) + factor * value
    return {column: value for column, value in row.items() if value != 0}
