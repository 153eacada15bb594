"""The exact geometry of a Robot: rational translations, exactly orthogonal rational rotations.

Numbers are the decimals of the file, freed of float noise. Angles that are multiples of 90 degrees
within float noise are so exactly; any other angle has a rational half tangent t, so that
cos = (1 - t^2) / (1 + t^2) and sin = 2 t / (1 + t^2) are rational with sin^2 + cos^2 = 1.

The energy of a body is linear in v v^T and gravity, with v = (linear, angular) velocity; v v^T is
stored as its 21 upper entries. A joint about or along z maps v to X(q) v + phi q' with
X(q) = A_0 + A_c cos q + A_s sin q or A_0 + A_q q. `JointKind` has this map, and those of v v^T and
gravity, as sums over monomials of q with sin^2 = 1 - cos^2 applied. The entries that are mapped may
be rationals or polynomials.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import chain, product
from typing import Any

import numpy as np
from flint import fmpq, fmpq_mat, fmpz_mat

from seaid._arrays import Array
from seaid.errors import RobotError, listed
from seaid.robot import Robot

_LENGTH_NOISE = 1e-15
"""Float noise of a translation after merging fixed joints, relative to one metre or itself."""

_FILE_DIGITS = 14
"""A decimal with more digits is the result of arithmetic, not a number of the file."""

_ANGLE_NOISE = 1e-14
"""Float noise of an angle after merging fixed joints; angles rounded in a file are further off."""

_HALF_TANGENT_ERROR = 1e-16
"""Distance from tan(angle / 2), at most 0.41, within which the simplest rational is taken: about
the rounding of doubles of this size."""


def _diagonal(*entries: int) -> fmpq_mat:
    """Return a diagonal matrix."""
    return fmpq_mat([[x if i == j else 0 for j, x in enumerate(entries)] for i in range(3)])


IDENTITY, _HALF_TURN, _NO_SHIFT = _diagonal(1, 1, 1), _diagonal(1, -1, -1), fmpq_mat(3, 1)
"""The rotation that changes nothing, half a turn about x, and the translation by zero."""


@dataclass(frozen=True, eq=False)
class ExactJoint:
    """One joint between aligned frames, in which the axis of every joint is z.

    `parent` is the index of the parent joint in the tree, -1 for the base, whose aligned frame is
    its own; `rotation` (3, 3) and `translation` (3, 1) place the joint's aligned frame at zero
    position in the parent's; `alignment` (3, 3) has the axes of the aligned frame in the body's.
    """

    parent: int
    is_prismatic: bool
    rotation: fmpq_mat
    translation: fmpq_mat
    alignment: fmpq_mat

    @cached_property
    def to_body(self) -> fmpq_mat:
        """The map (10, 10) of inertial parameters in the aligned frame to those in the body's."""
        return inertia_transform(self.alignment)


@dataclass(frozen=True, eq=False)
class ExactTree:
    """Joints with parents first, and the gravity (3, 1) in the base frame.

    `bodies[i]` is the index, among the robot's bodies, of the body that joint i moves. A position
    is `multipliers[i]` times that of the independent joint `leaders[i]`: the rows of E. Constant
    angles and lengths of E q + e are in the placements.
    """

    joints: tuple[ExactJoint, ...]
    gravity: fmpq_mat
    bodies: tuple[int, ...]
    leaders: tuple[int, ...]
    multipliers: tuple[fmpq, ...]


def independent_tree(robot: Robot) -> ExactTree:
    """Return the exact geometry of a robot. Raises RobotError if it has dependent joints."""
    if robot.dependent_joints:
        names = listed(joint.name for joint in robot.dependent_joints)
        raise RobotError(
            f"'{robot.name}' has mimic joints ({names}), which symbolic equations do not take: "
            "load it with independent_mimics=True, or without their leaders in joints=",
            "independent_mimics=True",
            "joints=",
        )
    return exact_tree(robot)


def exact_tree(robot: Robot) -> ExactTree:
    """Return the exact geometry of a robot."""
    model, n = robot.model, robot.n
    followers = robot.dependent_joints
    leaders = [*range(n), *(robot.index(follower.leader) for follower in followers)]
    factors = [*[fmpq(1)] * n, *(exact_number(follower.multiplier) for follower in followers)]
    offsets = [*[0.0] * n, *(follower.offset for follower in followers)]
    joints: list[ExactJoint] = []
    for index in range(1, model.njoints):
        parent = int(model.parents[index]) - 1
        placement = model.jointPlacements[index]
        above = IDENTITY if parent < 0 else joints[parent].alignment
        axis = joint_axis(model.joints[index])
        body = robot.model_order[index - 1]
        rotation, alignment = _between_axes(above, exact_rotation(placement.rotation), axis)
        translation = _to_meet(above.transpose() * exact_vector(placement.translation), rotation)
        slides = robot.all_prismatic[body]
        if slides:
            translation += rotation * exact_vector([0.0, 0.0, offsets[body]])
        elif offsets[body]:
            rotation = rotation * about_z(*_cosine_and_sine(offsets[body]))
        joints.append(ExactJoint(parent, slides, rotation, translation, alignment))
    order = robot.model_order
    moved = (tuple(leaders[i] for i in order), tuple(factors[i] for i in order))
    return ExactTree(tuple(joints), exact_vector(model.gravity.linear), order, *moved)


def exact_vector(values: Iterable[float]) -> fmpq_mat:
    """Return numbers as a column of rationals."""
    return fmpq_mat([[exact_number(x)] for x in values])


def _between_axes(above: fmpq_mat, placed: fmpq_mat, axis: Array) -> tuple[fmpq_mat, fmpq_mat]:
    """Return a joint's rotation between aligned frames, and its alignment.

    Axes that are parallel or perpendicular up to float noise are made exactly so: parallel ones by
    changing the axis if the frames are rotated by multiples of 90 degrees, all others by changing
    the rotation.
    """
    alignment = _alignment(axis)
    rotation = above.transpose() * placed * alignment
    cosine = rotation[2, 2]
    sine = math.hypot(number(rotation[0, 2]), number(rotation[1, 2]))
    if abs(cosine) in (0, 1) or min(abs(number(cosine)), sine) > _ANGLE_NOISE:
        return rotation, alignment
    if sine > _ANGLE_NOISE or any(x.q != 1 for x in placed.entries()):
        return exact_rotation(as_floats(rotation)), alignment
    turn = IDENTITY if cosine > 0 else _HALF_TURN
    return turn, placed.transpose() * above * turn


def _to_meet(translation: fmpq_mat, rotation: fmpq_mat) -> fmpq_mat:
    """Return a translation (3, 1) with which axes that meet up to float noise meet exactly."""
    # Both axes are apart along the normal z x R z, which is zero if they are parallel.
    normal = fmpq_mat([[-rotation[1, 2]], [rotation[0, 2]], [0]])
    distance, square = ((normal.transpose() * x)[0, 0] for x in (translation, normal))
    if not 0 < number(distance) ** 2 <= _LENGTH_NOISE**2 * number(square):
        return translation
    return translation - distance / square * normal


def joint_axis(joint: object) -> Array:
    """Return the unit axis of a Pinocchio joint model with one coordinate."""
    name = joint.shortname()  # type: ignore[attr-defined]
    if name[-1] in "XYZ":
        return np.array(np.eye(3)["XYZ".index(name[-1])])
    return np.asarray(joint.extract().axis)  # type: ignore[attr-defined]


def exact_number(value: float) -> fmpq:
    """Return the decimal that a double represents, as a rational.

    It is the shortest decimal of that double or, if that is long because of arithmetic, the
    shortest one within float noise.
    """
    # repr is the shortest decimal that gives this double: 0.1 is 1/10.
    value = float(value)
    exact = Fraction(repr(value))
    if len(str(exact.numerator)) > _FILE_DIGITS or abs(value) < _LENGTH_NOISE:
        noise = _LENGTH_NOISE * max(1.0, abs(value))
        near = (round(value, digits) for digits in range(17))
        exact = Fraction(repr(next((x for x in near if abs(x - value) <= noise), value)))
    return fmpq(exact.numerator, exact.denominator)


def exact_rotation(rotation: Array) -> fmpq_mat:
    """Return an exactly orthogonal rational matrix within 1e-15 of a rotation (3, 3).

    Entries that are 0 or +-1 up to float noise (1e-14) become exact.
    """
    row, column = _special_entry(rotation)
    before, after = (_alignment(np.eye(3)[place]) for place in (row, column))
    inner = as_floats(before).T @ rotation @ as_floats(after)
    # Euler angles Rz(a) Rx(b) Rz(c): if b is 0 or 90 degrees, zeros elsewhere come from a and c.
    tilt = math.atan2(math.hypot(inner[0, 2], inner[1, 2]), inner[2, 2])
    first = _about_x(tilt)
    if min(tilt, math.pi - tilt) > _ANGLE_NOISE:
        first = about_z(*_cosine_and_sine(math.atan2(inner[0, 2], -inner[1, 2]))) * first
    # c is measured on the remainder, which removes the error of a, large for small b.
    rest = as_floats(first).T @ inner
    inner_exact = first * about_z(*_cosine_and_sine(math.atan2(rest[1, 0], rest[0, 0])))
    return before * inner_exact * after.transpose()


def _special_entry(rotation: Array) -> tuple[int, int]:
    """Return the indices of an entry that is 1 or -1, else of one that is 0, else the last."""
    sizes = np.abs(rotation)
    for special in (sizes > 1 - _ANGLE_NOISE, sizes < _ANGLE_NOISE):
        if special.any():
            row, column = np.argwhere(special)[-1]
            return int(row), int(column)
    return 2, 2


def as_floats(matrix: fmpq_mat) -> Array:
    """Return a rational matrix as doubles, each the nearest one."""
    shape = matrix.nrows(), matrix.ncols()
    return np.array([number(x) for x in matrix.entries()]).reshape(shape)


def number(value: fmpq) -> float:
    """Return the double nearest to a rational."""
    # The division of two integers is rounded once, however long they are.
    return int(value.p) / int(value.q)


def _alignment(axis: Array) -> fmpq_mat:
    """Return a rotation whose last column is the axis; a permutation for a coordinate axis."""
    along = np.flatnonzero(np.abs(axis) == 1.0)
    if along.size:
        last = int(along[0])
        columns = [(last + 1) % 3, (last + 2) % 3, last]
        turned = fmpq_mat([[int(row == column) for column in columns] for row in range(3)])
        return turned if axis[last] > 0 else turned * _HALF_TURN
    # Half a turn about w, the bisector of z and the axis: R = 2 w w^T / (w^T w) - 1.
    up = 1 if axis[2] >= 0 else -1
    w = _unit_vector(axis) + fmpq_mat(3, 1, [0, 0, up])
    turned = 2 / (w.transpose() * w)[0, 0] * (w * w.transpose()) - IDENTITY
    return turned if up > 0 else turned * _HALF_TURN


def _unit_vector(axis: Array) -> fmpq_mat:
    """Return an exact unit vector; permuted or negated components give permuted or negated ones."""
    order = np.argsort(np.abs(axis), kind="stable")
    x, y, z = np.abs(axis)[order]
    high, low = _cosine_and_sine(math.atan2(x, math.hypot(y, z)))
    cosine, sine = _cosine_and_sine(math.atan2(y, z))
    vector = fmpq_mat(3, 1)
    for place, value in zip(order, (low, high * sine, high * cosine), strict=True):
        vector[int(place), 0] = value if axis[place] > 0 else -value
    return vector


def about_z(cosine: fmpq, sine: fmpq) -> fmpq_mat:
    """Return the rotation (3, 3) about z by the angle of a cosine and a sine."""
    return fmpq_mat([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def _about_x(angle: float) -> fmpq_mat:
    cosine, sine = _cosine_and_sine(angle)
    return fmpq_mat([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])


def _cosine_and_sine(angle: float) -> tuple[fmpq, fmpq]:
    """Return rational cosine and sine of an angle, exact at multiples of 90 degrees."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    t = fmpq(0) if abs(rest) <= _ANGLE_NOISE else _simplest(math.tan(rest / 2))
    cosine, sine = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    for _ in range(quarters % 4):
        cosine, sine = -sine, cosine
    return cosine, sine


def _simplest(value: float) -> fmpq:
    """Return the rational of smallest denominator within 1e-16 of a double (continued fraction)."""
    exact, error = Fraction(abs(value)), Fraction(_HALF_TANGENT_ERROR)
    p, q = _between(*(exact - error).as_integer_ratio(), *(exact + error).as_integer_ratio())
    return fmpq(p if value > 0 else -p, q)


def _between(a: int, b: int, c: int, d: int) -> tuple[int, int]:
    """Return numerator and denominator of the simplest rational from a / b to c / d."""
    whole = -(-a // b)
    if whole * d <= c:
        return whole, 1
    # All of them are whole - 1 plus a part below one, whose inverse is between those of the ends.
    p, q = _between(d, c - (whole - 1) * d, b, a - (whole - 1) * b)
    return (whole - 1) * p + q, p


Powers = tuple[int, int]
"""Powers of (cos q, sin q), or of (q, -) for a prismatic joint."""

Sum = tuple[tuple[int, int, Any], ...]
"""A sparse matrix of integers or rationals: (row, column, value)."""

_Square = Sequence[Sequence[int]]

PAIRS = tuple((i, j) for i in range(6) for j in range(i, 6))
"""The stored entries of a symmetric matrix (6, 6), in order."""

PAIR = {pair: place for place, pair in enumerate(PAIRS)} | {
    (j, i): place for place, (i, j) in enumerate(PAIRS)
}

_ONE, _C, _S, _CC, _CS = (0, 0), (1, 0), (0, 1), (2, 0), (1, 1)
"""The monomials 1, c, s, c^2 and c s of c = cos q and s = sin q, or 1, q and q^2 of a prismatic
joint."""


@dataclass(frozen=True, eq=False)
class JointKind:
    """The maps of a joint type: `axis` is the index of 1 in phi, the others {monomial: matrix}."""

    axis: int
    velocity: Mapping[Powers, Sum]
    square: Mapping[Powers, Sum]
    gravity: Mapping[Powers, Sum]


def _turning() -> JointKind:
    # A vector in the axes behind the joint is (still + cosine cos q + sine sin q) times it.
    still, cosine, sine = (
        ((0, 0, 0), (0, 0, 0), (0, 0, 1)),
        ((1, 0, 0), (0, 1, 0), (0, 0, 0)),
        ((0, 1, 0), (-1, 0, 0), (0, 0, 0)),
    )
    parts = {_ONE: _block_diag(still), _C: _block_diag(cosine), _S: _block_diag(sine)}
    # X w X^T = sum of A_a w A_b^T; by sin^2 = 1 - cos^2 the part A_s w A_s^T is in the constant
    # and, with a minus, in cos^2.
    square = {
        _ONE: ((_ONE, _ONE, 1), (_S, _S, 1)),
        _C: ((_ONE, _C, 1), (_C, _ONE, 1)),
        _S: ((_ONE, _S, 1), (_S, _ONE, 1)),
        _CC: ((_C, _C, 1), (_S, _S, -1)),
        _CS: ((_C, _S, 1), (_S, _C, 1)),
    }
    return JointKind(
        axis=5,
        velocity={powers: sparse(part) for powers, part in parts.items()},
        square={powers: _squared(parts, terms) for powers, terms in square.items()},
        gravity={_ONE: sparse(still), _C: sparse(cosine), _S: sparse(sine)},
    )


def _sliding() -> JointKind:
    same = [[int(i == j) for j in range(6)] for i in range(6)]
    along = [[0] * 6 for _ in range(6)]
    # v + w x z q = v + q (w_y, -w_x, 0).
    along[0][4], along[1][3] = 1, -1
    parts = {_ONE: same, _C: along}
    square = {
        _ONE: ((_ONE, _ONE, 1),),
        _C: ((_ONE, _C, 1), (_C, _ONE, 1)),
        _CC: ((_C, _C, 1),),
    }
    return JointKind(
        axis=2,
        velocity={powers: sparse(part) for powers, part in parts.items()},
        square={powers: _squared(parts, terms) for powers, terms in square.items()},
        gravity={_ONE: tuple((i, i, 1) for i in range(3))},
    )


def _block_diag(block: _Square) -> _Square:
    zero = [0, 0, 0]
    return [[*row, *zero] for row in block] + [[*zero, *row] for row in block]


def sparse(matrix: Sequence[Sequence[Any]]) -> Sum:
    """Return a matrix without its zeros."""
    return tuple((i, j, x) for i, row in enumerate(matrix) for j, x in enumerate(row) if x)


def _squared(parts: Mapping[Powers, _Square], terms: Sequence[tuple[Powers, Powers, int]]) -> Sum:
    """Return the sum over (a, b, sign) of A_a w A_b^T as a matrix on the 21 entries of w."""
    entries: dict[tuple[int, int], int] = {}
    for a, b, sign in terms:
        for (i, k, x), (j, m, y) in product(sparse(parts[a]), sparse(parts[b])):
            if i <= j:
                place = PAIR[i, j], PAIR[k, m]
                entries[place] = entries.get(place, 0) + sign * x * y
    return tuple((row, column, value) for (row, column), value in entries.items() if value)


TURNING, SLIDING = _turning(), _sliding()

INERTIA = tuple((j, i) for i in range(3) for j in range(i + 1))
"""Row and column of xx, xy, yy, xz, yz and zz in the rotational inertia (3, 3)."""


def _twice_kinetic() -> Iterator[tuple[int, int, int]]:
    # 2 K = m v^T v + 2 h^T (v x w) + w^T I w, with h in the rows 1 to 3 and I in 4 to 9.
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        yield from ((0, PAIR[i, i], 1), (1 + i, PAIR[j, 3 + k], 2), (1 + i, PAIR[k, 3 + j], -2))
    for row, (i, j) in enumerate(INERTIA, 4):
        yield row, PAIR[3 + i, 3 + j], 1 if i == j else 2


TWICE_KINETIC: Sum = tuple(_twice_kinetic())
"""2 K of a body from the 21 entries of v v^T, one row per inertial parameter."""


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
    """Return the map (6, 6) from the parent's velocity to that of a frame placed in it."""
    x, y, z = translation.entries()
    # v + w x r = v - [r]x w, in the axes of the frame.
    cross = fmpq_mat([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    turned, moved = rotation.transpose(), rotation.transpose() * cross
    rows = [[*turned.tolist()[i], *moved.tolist()[i]] for i in range(3)]
    return fmpq_mat(rows + [[0, 0, 0, *turned.tolist()[i]] for i in range(3)])


def inertia_transform(
    rotation: fmpq_mat, translation: fmpq_mat = _NO_SHIFT, parameters: Iterable[int] = range(10)
) -> fmpq_mat:
    """Return the map (10, k) of k of a body's ten `parameters` to its ten in the parent frame.

    By the pseudo-inertia T J T^T (Wensing et al. 2018), as `seaid.robot.inertia.in_parent_frame`.
    """
    # Integers over one denominator d: T (2 J) of the unit parameters side by side, and then on top
    # of each other for the second factor.
    upper = [[*row, x] for row, x in zip(rotation.tolist(), translation.entries(), strict=True)]
    T, d = fmpq_mat([*upper, [0, 0, 0, 1]]).numer_denom()
    half = (T * _TWICE_PSEUDO).tolist()
    stacked = fmpz_mat([row[4 * i : 4 * i + 4] for i in parameters for row in half])
    entries = (stacked * T.transpose()).tolist()
    columns = [_from_pseudo(entries[at : at + 4]) for at in range(0, len(entries), 4)]
    return fmpq_mat(fmpz_mat(columns).transpose()) * fmpq(1, 2 * d * d)


def _twice_pseudo(parameters: Sequence[Any]) -> list[list[Any]]:
    """Return twice the pseudo-inertia (4, 4) of a body's ten parameters."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = parameters
    # It has the second moments tr(I) / 2 - I in its upper block.
    return [
        [yy + zz - xx, -2 * xy, -2 * xz, 2 * x],
        [-2 * xy, xx + zz - yy, -2 * yz, 2 * y],
        [-2 * xz, -2 * yz, xx + yy - zz, 2 * z],
        [2 * x, 2 * y, 2 * z, 2 * m],
    ]


_UNITS = map(_twice_pseudo, np.eye(10, dtype=int).tolist())
"""Twice the pseudo-inertias (4, 4) of bodies with one of their ten parameters 1 and the others
0."""

_TWICE_PSEUDO = fmpz_mat([[*chain(*rows)] for rows in zip(*_UNITS, strict=True)])
"""Twice the pseudo-inertias (4, 40) of unit parameters, side by side."""


def _from_pseudo(J: Sequence[Sequence[Any]]) -> list[Any]:
    """Return the ten parameters of a pseudo-inertia."""
    trace = J[0][0] + J[1][1] + J[2][2]
    # The inverse: I = tr(S) - S with the second moments S.
    second = [(trace if i == j else 0) - J[i][j] for i, j in INERTIA]
    return [J[3][3], J[0][3], J[1][3], J[2][3], *second]
