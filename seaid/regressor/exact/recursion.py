"""The undetectable changes of a tree's inertial parameters, by one small null space per joint.

A change of body i is undetectable, in combination with a change of its parent, exactly if its
energy seen from the parent does not depend on q_i and q_i' (Wensing, Niemeyer and Slotine 2017, who
do it numerically). The parent's motions enter by the spans of v, v v^T and gravity. The cost is
O(n); nothing is rounded.

Joints that one coordinate moves (mimic joints), with those between them and the body that carries
them all, are a group with one such question: the sum of their energies must not depend on the
group's coordinates x and x'. It is asked at random rational points of the circle, without rounding:
the rank is never too high, and too low only if the points are special.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import chain, combinations
from math import gcd, lcm

import numpy as np
from flint import fmpq, fmpq_mat, nmod, nmod_mat

from seaid.regressor.exact.geometry import (
    IDENTITY,
    PAIRS,
    SLIDING,
    TURNING,
    TWICE_KINETIC,
    ExactJoint,
    ExactTree,
    JointKind,
    about_z,
    applied,
    inertia_transform,
    twist_transform,
    with_axis,
)
from seaid.regressor.exact.grouping import SparseRow

Vector = list[fmpq]

_ZERO = fmpq(0)
"""The rational 0 that exact sums start from."""


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


def null_space(tree: ExactTree, *, floating: bool = False) -> list[SparseRow]:
    """Return a basis of the undetectable changes of the 10n parameters, parents first.

    With a `floating` base its own ten parameters come first, so that there are 10 (n + 1).
    """
    base = _full_spans() if floating else Spans([], [], _basis([tree.gravity.entries()]))
    spans = {-1: base}
    nulls: list[SparseRow] = []
    groups = {group[0]: group for group in _groups(tree)}
    grouped = set(chain(*groups.values()))
    for place, joint in enumerate(tree.joints):
        if place in groups:
            nulls += _group_nulls(tree, groups[place], spans, floating)
        # What a parent compensates for all of its motions it compensates in a group, too.
        hidden = _hidden_from_all(_kind(joint))
        if place not in grouped:
            hidden, spans[place] = _hidden_changes(joint, spans[joint.parent])
        pose = _Pose(joint.rotation, joint.translation, {})
        nulls += _compensated_changes(tree, {place: pose}, hidden, floating)
    return nulls


def _compensated_changes(
    tree: ExactTree, poses: dict[int, _Pose], changes: list[fmpq_mat], floating: bool
) -> list[SparseRow]:
    """Return changes (10 k, 1) of k bodies with those of their carrier that compensate them.

    `poses` are those of the bodies in the carrier's frame at zero position.
    """
    if not changes:
        return []
    carrier, shift = tree.joints[min(poses)].parent, 10 if floating else 0
    rows = fmpq_mat([change.entries() for change in changes]).transpose().tolist()
    # {first column of a body: what it has in each of the changes (10, changes)}
    parts, total = dict[int, fmpq_mat](), fmpq_mat(10, len(changes))
    for i, (place, pose) in enumerate(poses.items()):
        part = fmpq_mat(rows[10 * i : 10 * i + 10])
        parts[10 * tree.bodies[place] + shift] = tree.joints[place].to_body * part
        total += inertia_transform(pose.rotation, pose.translation) * part
    if carrier >= 0:
        parts[10 * tree.bodies[carrier] + shift] = -(tree.joints[carrier].to_body * total)
    elif floating:
        parts[0] = -total
    return [_row_of(parts, k) for k in range(len(changes))]


def _row_of(parts: dict[int, fmpq_mat], k: int) -> SparseRow:
    """Return column k of parts {first place: (10, changes)} as one row."""
    return {first + i: part[i, k] for first, part in parts.items() for i in range(10) if part[i, k]}


def _hidden_changes(joint: ExactJoint, above: Spans) -> tuple[list[fmpq_mat], Spans]:
    """Return the changes (10, 1) of a body that its parent can compensate, and the body's spans."""
    if above.is_full:
        return _hidden_from_all(_kind(joint)), above
    conditions, beyond = _joint_conditions(_kind(joint), _placed_spans(above, joint))
    return _nullspace(conditions), beyond


def _kind(joint: ExactJoint) -> JointKind:
    return SLIDING if joint.is_prismatic else TURNING


@cache
def _hidden_from_all(kind: JointKind) -> list[fmpq_mat]:
    return _nullspace(_joint_conditions(kind, _full_spans())[0])


@cache
def _asked(kind: JointKind) -> list[int]:
    """Return the parameters of a body of which none is the last one of a hidden change."""
    changes = _hidden_from_all(kind)
    last = {max(i for i, x in enumerate(change.entries()) if x) for change in changes}
    return [i for i in range(10) if i not in last]


def _full_spans() -> Spans:
    return Spans(_unit_vectors(6), _unit_vectors(21), _unit_vectors(3))


def _unit_vectors(size: int) -> list[Vector]:
    return [[fmpq(int(i == j)) for j in range(size)] for i in range(size)]


def _placed_spans(above: Spans, joint: ExactJoint | _Pose) -> Spans:
    """Return the parent's spans in the frame of a joint at zero position, or of a pose."""
    turned = joint.rotation.transpose()
    X = twist_transform(joint.rotation, joint.translation)
    velocity, square, gravity = above.velocity, above.square, above.gravity
    if len(velocity) < 6:
        velocity = [(X * _column(v)).entries() for v in velocity]
    if len(square) < 21:
        square = [_transformed(X, w) for w in square]
    if len(gravity) < 3:
        gravity = [(turned * _column(z)).entries() for z in gravity]
    return Spans(velocity, square, gravity)


def _joint_conditions(kind: JointKind, above: Spans) -> tuple[list[Vector], Spans]:
    """Return the conditions on a body's ten parameters, and the spans of its own motions."""
    along = [fmpq(int(place == kind.axis)) for place in range(6)]
    velocity = [
        applied(part, v, 6, _ZERO) for v in above.velocity for part in kind.velocity.values()
    ]
    # The parts of v_i v_i^T that depend on q or q': with q', with q'^2, with powers of q.
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
            # The height of a sliding body grows by q: m g^T z must not.
            conditions.append([z[2], *[_ZERO] * 9])
        for powers, part in kind.gravity.items():
            turned = applied(part, z, 3, _ZERO)
            gravity.append(turned)
            if any(powers):
                # h^T g depends on q where gravity turns about the joint.
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


def _nullspace(
    rows: Sequence[Vector], columns: Sequence[int] = range(10), width: int = 10
) -> list[fmpq_mat]:
    """Return a basis of vectors (width, 1), zero but in `columns`, that all rows map to zero."""
    echelon = _basis(rows)
    pivots = [next(j for j, x in enumerate(row) if x != 0) for row in echelon]
    basis = []
    for free in (j for j in range(len(columns)) if j not in pivots):
        vector = [fmpq(int(j == columns[free])) for j in range(width)]
        for row, pivot in zip(echelon, pivots, strict=True):
            vector[columns[pivot]] = -row[free]
        basis.append(_column(vector))
    return basis


def _column(vector: Sequence[fmpq]) -> fmpq_mat:
    return fmpq_mat(len(vector), 1, list(vector))


def _groups(tree: ExactTree) -> list[list[int]]:
    """Return the places of the joints that move together, with those between them, in order."""
    members: dict[int, set[int]] = defaultdict(set)
    for place, leader in enumerate(tree.leaders):
        members[leader].add(place)
    coupled = (places for places in members.values() if len(places) > 1)
    groups = [_with_joints_between(tree, places) for places in coupled]
    while pair := next((pair for pair in combinations(groups, 2) if pair[0] & pair[1]), None):
        groups.remove(pair[0])
        groups.remove(pair[1])
        groups.append(_with_joints_between(tree, pair[0] | pair[1]))
    return [sorted(group) for group in groups]


def _with_joints_between(tree: ExactTree, group: set[int]) -> set[int]:
    """Return a group with all joints up to the body that carries it."""
    chains = [_chain(tree, place) for place in group]
    common = set.intersection(*(set(chain[1:]) for chain in chains))
    return set().union(*chains) - common


def _chain(tree: ExactTree, place: int) -> list[int]:
    """Return a joint and those before it, to the base."""
    places = []
    while place >= 0:
        places.append(place)
        place = tree.joints[place].parent
    return places


@dataclass(frozen=True, eq=False)
class _Pose:
    """A body of a group at one point: its place in the parent's frame, and B in v_i = A v + B x'.

    `rates` has a column (6,) of B for each coordinate; `asked` are the parameters of the body that
    are left without the changes that a parent compensates whatever its motion.
    """

    rotation: fmpq_mat
    translation: fmpq_mat
    rates: dict[int, fmpq_mat]
    asked: Sequence[int] = ()

    def to_carrier(self) -> fmpq_mat:
        """Return the map (10, k) of the k `asked` parameters to the frame of the carrier."""
        return inertia_transform(self.rotation, self.translation, self.asked)


def _group_nulls(
    tree: ExactTree, group: list[int], spans: dict[int, Spans], floating: bool
) -> list[SparseRow]:
    """Return the undetectable changes of a group that are none of one joint alone.

    The spans of its bodies are added to `spans`.
    """
    carrier = tree.joints[min(group)].parent
    above, still = spans[carrier], _poses(tree, group, carrier, None)
    at_zero = {place: still[place].to_carrier() for place in group}
    columns = [10 * i + column for i, place in enumerate(group) for column in still[place].asked]
    visible, rows, unseen = _visible(above), list[Vector](), _residues(_unit_vectors(len(columns)))
    reached: dict[int, Spans] = {place: Spans([], [], []) for place in group}
    random, unchanged = np.random.default_rng(0), 0
    while unchanged < _CONFIRMING:
        poses = _poses(tree, group, carrier, random)
        before = len(rows), [_sizes(reached[place]) for place in group]
        new, unseen = _independent(_conditions(poses, at_zero, above, visible), unseen)
        rows += new
        for place in group:
            reached[place] = _spans_behind(poses[place], above, reached[place])
        after = len(rows), [_sizes(reached[place]) for place in group]
        unchanged = unchanged + 1 if after == before else 0
    spans.update(reached)
    return _compensated_changes(tree, still, _nullspace(rows, columns, 10 * len(group)), floating)


def _residues(rows: list[Vector]) -> nmod_mat:
    return nmod_mat([[nmod(x, _PRIME) for x in row] for row in rows], _PRIME)


def _independent(rows: list[Vector], unseen: nmod_mat) -> tuple[list[Vector], nmod_mat]:
    """Return the first rows that are independent of all before, and the vectors still unseen.

    `unseen` has vectors as columns that span what the rows before map to zero, modulo a prime. What
    is independent by its residues is so as rationals too.
    """
    # The pivots of the transpose are the first independent rows.
    images = _residues(rows) * unseen
    echelon, rank = images.transpose().rref()
    table = echelon.tolist()[:rank]
    pivots = (next(j for j, x in enumerate(row) if int(x)) for row in table)
    return [rows[pivot] for pivot in pivots], unseen * images.nullspace()[0]


_PRIME = 2**61 - 1
"""Modulus of the residues in place of rationals: the largest Mersenne prime that is a word of 64
bits, which the residues of flint are."""

_CONFIRMING = 3
"""Random points that add nothing, after which the conditions count as complete."""


def _sizes(spans: Spans) -> tuple[int, int, int]:
    return len(spans.velocity), len(spans.square), len(spans.gravity)


def _poses(
    tree: ExactTree, group: list[int], carrier: int, random: np.random.Generator | None
) -> dict[int, _Pose]:
    """Return the bodies of a group in its carrier's frame, at a random point or at zero."""
    turns, lengths = _positions(tree, group, random)
    poses = {carrier: _Pose(IDENTITY, fmpq_mat(3, 1), {})}
    for place in group:
        joint, before = tree.joints[place], poses[tree.joints[place].parent]
        rotation = joint.rotation * turns.get(place, IDENTITY)
        along = fmpq_mat([[0], [0], [lengths.get(place, 0)]])
        translation = joint.translation + joint.rotation * along
        X = twist_transform(rotation, translation)
        rates = {leader: X * column for leader, column in before.rates.items()}
        axis = fmpq_mat(6, 1)
        # v_i = X (v + B x') + phi mu x', with the multiplier mu of the joint.
        axis[2 if joint.is_prismatic else 5, 0] = tree.multipliers[place]
        leader = tree.leaders[place]
        rates[leader] = rates[leader] + axis if leader in rates else axis
        translation = before.translation + before.rotation * translation
        poses[place] = _Pose(before.rotation * rotation, translation, rates, _asked(_kind(joint)))
    return {place: poses[place] for place in group}


def _positions(
    tree: ExactTree, group: list[int], random: np.random.Generator | None
) -> tuple[dict[int, fmpq_mat], dict[int, fmpq]]:
    """Return the rotations (3, 3) of joints that turn, and the lengths of those that slide.

    A length and an angle of one coordinate are independent numbers, since no polynomial relates q
    to cos q. Angles with multipliers a/b of each other, both small, are multiples of one angle.
    """
    turns, lengths = dict[int, fmpq_mat](), dict[int, fmpq]()
    for leader in {tree.leaders[place] for place in group}:
        members = {x: tree.multipliers[x] for x in group if tree.leaders[x] == leader}
        length = _random_number(random)
        for place, multiplier in members.items():
            if tree.joints[place].is_prismatic:
                lengths[place] = multiplier * length
        turning = {x: _fraction(y) for x, y in members.items() if x not in lengths}
        turns |= _turns(turning, random)
    return turns, lengths


def _turns(
    multipliers: dict[int, Fraction], random: np.random.Generator | None
) -> dict[int, fmpq_mat]:
    """Return the rotations about z by the angles {joint: multiplier} of one coordinate."""
    rotations: dict[int, fmpq_mat] = {}
    while multipliers:
        first = next(iter(multipliers.values()))
        ratios = {joint: multiplier / first for joint, multiplier in multipliers.items()}
        similar = {
            joint: ratio
            for joint, ratio in ratios.items()
            if max(abs(ratio.numerator), ratio.denominator) <= _MOST_TURNS
        }
        common = lcm(*(ratio.denominator for ratio in similar.values()))
        counts = {joint: int(ratio * common) for joint, ratio in similar.items()}
        # The random angle is the largest of which all of them are whole multiples.
        shared = gcd(*counts.values())
        t = _random_number(random)
        turn = about_z((1 - t * t) / (1 + t * t), 2 * t / (1 + t * t))
        rotations |= {joint: turn ** (count // shared) for joint, count in counts.items()}
        multipliers = {x: y for x, y in multipliers.items() if x not in similar}
    return rotations


_MOST_TURNS = 60
"""Numerator and denominator up to which the ratio of two multipliers is one of small integers."""


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q)) or Fraction(1)


def _random_number(random: np.random.Generator | None) -> fmpq:
    if random is None:
        return fmpq(0)
    above, below = random.integers(1, 40, 2).tolist()
    return fmpq(int(above), int(below)) * (-1 if random.random() < 0.5 else 1)


def _visible(above: Spans) -> fmpq_mat:
    """Return the combinations (k, 10) of a body's parameters in its energy, for all its motions."""
    kinetic = [applied(TWICE_KINETIC, w, 10, _ZERO) for w in above.square]
    # -U = m g^T p + h^T g, of a body at the origin: h^T g.
    potential = [[_ZERO, *z, *[_ZERO] * 6] for z in above.gravity]
    return fmpq_mat(_basis([*kinetic, *potential]) or [[_ZERO] * 10])


def _conditions(
    poses: dict[int, _Pose], at_zero: dict[int, fmpq_mat], above: Spans, visible: fmpq_mat
) -> list[Vector]:
    """Return the conditions at one point: the energy is that at zero, without a part in x'."""
    leaders = sorted({leader for pose in poses.values() for leader in pose.rates})
    parts = []
    for place, before in at_zero.items():
        pose = poses[place]
        # The energy of a body at rest in its carrier's frame is that of its parameters there.
        change = pose.to_carrier() - before
        change = change if above.is_full else visible * change
        parts.append([*_energies_of_rates(pose, above, leaders), *change.tolist()])
    return [[x for part in row for x in part] for row in zip(*parts, strict=True)]


def _energies_of_rates(pose: _Pose, above: Spans, leaders: list[int]) -> list[Vector]:
    """Return what each unit parameter of a body that is asked adds to the energy with x'."""
    nothing = fmpq_mat(6, 1)
    X = twist_transform(pose.rotation, pose.translation).transpose()
    rates = [pose.rates.get(leader, nothing).entries() for leader in leaders]
    moved = (fmpq_mat(above.velocity or [[_ZERO] * 6]) * X).tolist()
    energies: list[Vector] = []
    for i, rate in enumerate(rates):
        # The bilinear form a^T M b of 2 K: `momenta` has M b by the parameters.
        momenta = [[_ZERO] * 10 for _ in range(6)]
        for parameter, pair, value in TWICE_KINETIC:
            for j, k in (PAIRS[pair], PAIRS[pair][::-1]):
                momenta[j][parameter] = rate[k] if value > 0 else -rate[k]
        asked = fmpq_mat([[row[parameter] for parameter in pose.asked] for row in momenta])
        energies += (fmpq_mat([*rates[: i + 1], *moved]) * asked).tolist()
    return energies


def _symmetric_product(a: Vector, b: Vector) -> Vector:
    """Return the 21 entries of a b^T + b a^T."""
    return [a[i] * b[j] + b[i] * a[j] for i, j in PAIRS]


def _transformed(A: fmpq_mat, square: Vector) -> Vector:
    """Return the 21 entries of A w A^T."""
    w = fmpq_mat(6, 6)
    for (i, j), value in zip(PAIRS, square, strict=True):
        w[i, j] = w[j, i] = value
    image = A * w * A.transpose()
    return [image[i, j] for i, j in PAIRS]


def _spans_behind(pose: _Pose, above: Spans, known: Spans) -> Spans:
    """Return the spans of a body, widened by those at one point."""
    if known.is_full or above.is_full:
        return known if known.is_full else above
    placed, rates = _placed_spans(above, pose), [rate.entries() for rate in pose.rates.values()]
    velocity = [*placed.velocity, *rates]
    square = [*placed.square, *(_symmetric_product(a, b) for a in velocity for b in rates)]
    return Spans(
        velocity=_basis([*known.velocity, *velocity]),
        square=_basis([*known.square, *square]),
        gravity=_basis([*known.gravity, *placed.gravity]),
    )
