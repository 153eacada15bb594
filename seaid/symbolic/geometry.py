"""The exact geometry of a Robot: rational translations, exactly orthogonal rational rotations.

Numbers are the decimals that the file meant, freed of float noise. Angles that are
multiples of 90 degrees within float noise are so exactly; of any other angle the half tangent is a
rational, so that sine and cosine are rationals with sin^2 + cos^2 = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq, fmpq_mat

from seaid.arrays import Array
from seaid.robot import Robot

_LENGTH_NOISE = 1e-15
"""Float noise of a translation after merging fixed joints, relative to one metre or itself."""

_FILE_DIGITS = 14
"""A decimal with more digits is taken as the result of arithmetic."""

_ANGLE_NOISE = 1e-14
"""Float noise of an angle after merging fixed joints; angles rounded in a file are further off."""

_HALF_TANGENT_ERROR = 1e-16


@dataclass(frozen=True, eq=False)
class ExactJoint:
    """One joint between aligned frames, in which the axis of every joint is z.

    `parent` is the place of the parent joint in the tree, -1 for the base, whose aligned frame is
    its own; `rotation` (3, 3) and `translation` (3, 1) place the joint's aligned frame at zero in
    the parent's; `alignment` (3, 3) has the axes of the aligned frame in the frame of the body.
    """

    parent: int
    is_prismatic: bool
    rotation: fmpq_mat
    translation: fmpq_mat
    alignment: fmpq_mat


@dataclass(frozen=True, eq=False)
class ExactTree:
    """Joints with parents first, the gravity (3, 1) in the base frame, and whose body is whose.

    `bodies[i]` is the place among the robot's bodies of the body that joint i moves.
    """

    joints: tuple[ExactJoint, ...]
    gravity: fmpq_mat
    bodies: tuple[int, ...]


def exact_tree(robot: Robot) -> ExactTree:
    """Return the exact geometry of a robot."""
    model = robot.model
    identity = fmpq_mat([[int(i == j) for j in range(3)] for i in range(3)])
    joints: list[ExactJoint] = []
    for index in range(1, model.njoints):
        parent = int(model.parents[index]) - 1
        placement = model.jointPlacements[index]
        above = identity if parent < 0 else joints[parent].alignment
        alignment = _alignment(joint_axis(model.joints[index]))
        rotation = as_floats(above).T @ placement.rotation @ as_floats(alignment)
        translation = fmpq_mat([[exact_number(x)] for x in placement.translation])
        joints.append(
            ExactJoint(
                parent=parent,
                is_prismatic=robot.is_prismatic[robot.model_order[index - 1]],
                rotation=exact_rotation(rotation),
                translation=above.transpose() * translation,
                alignment=alignment,
            )
        )
    gravity = fmpq_mat([[exact_number(x)] for x in model.gravity.linear])
    return ExactTree(tuple(joints), gravity, robot.model_order)


def joint_axis(joint: object) -> Array:
    """Return the unit axis of one of Pinocchio's joint models with one coordinate."""
    name = joint.shortname()  # type: ignore[attr-defined]
    if name[-1] in "XYZ":
        return np.array(np.eye(3)["XYZ".index(name[-1])])
    return np.asarray(joint.extract().axis)  # type: ignore[attr-defined]


def exact_number(value: float) -> fmpq:
    """Return the decimal that a double means, as a rational.

    It is the shortest one of that double; where that is long, a trace of arithmetic, the shortest
    one within float noise.
    """
    value = float(value)
    exact = Fraction(repr(value))
    if len(str(exact.numerator)) > _FILE_DIGITS or abs(value) < _LENGTH_NOISE:
        noise = _LENGTH_NOISE * max(1.0, abs(value))
        near = (round(value, digits) for digits in range(17))
        exact = Fraction(repr(next((x for x in near if abs(x - value) <= noise), value)))
    return fmpq(exact.numerator, exact.denominator)


def exact_rotation(rotation: Array) -> fmpq_mat:
    """Return an exactly orthogonal rational matrix within 1e-15 of a rotation (3, 3).

    Float noise of 1e-14 rad about a multiple of 90 degrees is left out. It is Rz(a) Rx(b) Rz(c): b, the angle between z axes, decides what is parallel and what is
    perpendicular, and is exact where it is a multiple of 90 degrees.
    """
    tilt = math.atan2(math.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])
    if min(tilt, math.pi - tilt) > _ANGLE_NOISE:
        first = _about_z(math.atan2(rotation[0, 2], -rotation[1, 2])) * _about_x(tilt)
    else:
        first = _about_x(tilt)
    # What is left is measured, so that the error of a, large where b is small, does not stay.
    rest = as_floats(first).T @ rotation
    return first * _about_z(math.atan2(rest[1, 0], rest[0, 0]))


def as_floats(matrix: fmpq_mat) -> Array:
    """Return a rational matrix as doubles, each the nearest one."""
    shape = matrix.nrows(), matrix.ncols()
    return np.array([number(x) for x in matrix.entries()]).reshape(shape)


def number(value: fmpq) -> float:
    """Return the double nearest to a rational."""
    return int(value.p) / int(value.q)


def _alignment(axis: Array) -> fmpq_mat:
    """Return a rotation whose last column is the axis: a permutation for a coordinate axis."""
    along = np.flatnonzero(np.abs(axis) == 1.0)
    if along.size and axis[along[0]] > 0:
        last = int(along[0])
        columns = [(last + 1) % 3, (last + 2) % 3, last]
        return fmpq_mat([[int(row == column) for column in columns] for row in range(3)])
    tilt = math.atan2(math.hypot(axis[0], axis[1]), axis[2])
    return _about_z(math.atan2(axis[0], -axis[1]) if tilt < math.pi else 0.0) * _about_x(tilt)


def _about_z(angle: float) -> fmpq_mat:
    cosine, sine = _cosine_and_sine(angle)
    return fmpq_mat([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def _about_x(angle: float) -> fmpq_mat:
    cosine, sine = _cosine_and_sine(angle)
    return fmpq_mat([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])


def _cosine_and_sine(angle: float) -> tuple[fmpq, fmpq]:
    """Return rationals on the unit circle, in steps of 90 degrees exact."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    t = fmpq(0) if abs(rest) <= _ANGLE_NOISE else _simplest(math.tan(rest / 2))
    cosine, sine = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    for _ in range(quarters % 4):
        cosine, sine = -sine, cosine
    return cosine, sine


def _simplest(value: float) -> fmpq:
    """Return the rational of smallest denominator within 1e-16 of a double (continued fraction)."""
    exact, error = Fraction(value), Fraction(_HALF_TANGENT_ERROR)
    low, high = 1, 10**18
    while low < high:
        middle = (low + high) // 2
        if abs(exact.limit_denominator(middle) - exact) <= error:
            high = middle
        else:
            low = middle + 1
    near = exact.limit_denominator(low)
    return fmpq(near.numerator, near.denominator)
