"""The rows of B in (12) from the torques: Euler-Lagrange on every function of the energy's table.

L = sum of f_i(q, q') times a row of the table, so the torques are the sum of E(f_i) times the same
row, E = d/dt d/dq' - d/dq: one small monomial at a time, and the equations of motion are never
written down. Monomials are numbers: three bits a joint tell its function of q.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import gcd

from flint import fmpq

from seaid.progress import track
from seaid.symbolic.energies import Monomial, too_large
from seaid.symbolic.geometry import ExactTree
from seaid.symbolic.grouping import SparseRow
from seaid.symbolic.kinematics import Powers

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
    tree: ExactTree,
    table: Mapping[Monomial, SparseRow],
    known: Sequence[int],
    max_terms: int,
    *,
    progress: bool = False,
) -> tuple[list[SparseRow], int]:
    """Return the rows of B for the torques of the joints `known`, and how many functions there are.

    Rows that are the same sum of rows of the table are left out but for the first. Raises
    SymbolicError before there are more than `max_terms` terms.
    """
    bases: dict[tuple[tuple[int, fmpq], ...], int] = {}
    n = len(tree.joints)
    found: dict[int, _Row] = {}
    slopes = [_SLIDING_SLOPES if joint.is_prismatic else _TURNING_SLOPES for joint in tree.joints]
    wanted = frozenset(known)
    for monomial, row in track(list(table.items()), "Torques", progress):
        base = bases.setdefault(tuple(sorted(row.items())), len(bases))
        for k, function, factor in _euler_lagrange(monomial, n, slopes, wanted):
            terms = found.setdefault(function * n + k, {})
            terms[base] = terms.get(base, 0) + factor
        if len(found) > max_terms:
            raise too_large(len(found), max_terms, n - 1, n)
    functions = {key // n for key, terms in found.items() if any(terms.values())}
    sums = {_primitive(terms) for terms in found.values()}
    parts = list(bases)
    return [_expanded(terms, parts) for terms in sums], len(functions)


def _euler_lagrange(
    monomial: Monomial, n: int, slopes: Sequence[_Slopes], wanted: frozenset[int]
) -> Iterator[tuple[int, int, int]]:
    """Yield (joint, function, factor) of the terms of E for one monomial of the energy.

    A function is its part in q and, above those bits, nothing, q_i' q_j' or q_j''.
    """
    codes = [_CODES[monomial[3 * i], monomial[3 * i + 1]] for i in range(n)]
    part = sum(code << 3 * i for i, code in enumerate(codes))
    derived = {
        i: [(part + ((new - code) << 3 * i), factor) for new, factor in slopes[i][code]]
        for i, code in enumerate(codes)
        if code
    }
    speeds = [i for i in range(n) for _ in range(monomial[3 * i + 2])]
    top = 3 * n
    if speeds:
        a, b = speeds
        for k, other in (a, b), (b, a):
            if k in wanted:
                yield k, part + ((1 + n * n + other) << top), 1
                for i, terms in derived.items():
                    pair = _pair(i, other, n) << top
                    for function, factor in terms:
                        yield k, function + pair, factor
    pair = _pair(speeds[0], speeds[1], n) << top if speeds else 0
    for k, terms in derived.items():
        if k in wanted:
            for function, factor in terms:
                yield k, function + pair, -factor


def _pair(i: int, j: int, n: int) -> int:
    return 1 + (i * n + j if i < j else j * n + i)


def _primitive(terms: _Row) -> tuple[tuple[int, int], ...]:
    """Return the terms without zeros and common factor, the first one positive."""
    left = sorted((base, factor) for base, factor in terms.items() if factor)
    common = gcd(*(factor for _, factor in left)) if left else 1
    if left and left[0][1] < 0:
        common = -common
    return tuple((base, factor // common) for base, factor in left)


def _expanded(
    terms: tuple[tuple[int, int], ...], parts: Sequence[tuple[tuple[int, fmpq], ...]]
) -> SparseRow:
    row: SparseRow = {}
    for base, factor in terms:
        for column, value in parts[base]:
            row[column] = row.get(column, 0) + factor * value
    return {column: value for column, value in row.items() if value != 0}
