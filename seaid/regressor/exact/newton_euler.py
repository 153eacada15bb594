"""The joint-torque regressor as a straight-line program, by Newton-Euler body by body.

In the aligned frame of a body with origin acceleration a (less gravity), angular velocity w,
angular acceleration e, mass m and first moments h, the force is m a + B h and the moment about the
origin h x a + I e + w x I w, with B = [e]x + [w]x [w]x. The torque at each joint above is their
product with the partial velocities of the joint (Kane).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from seaid.regressor.exact.codegen import (
    ZERO,
    Program,
    Value,
    combined,
    constant,
    cross,
    dot,
    name,
    named,
    plus,
    scaled,
    times,
)
from seaid.regressor.exact.geometry import INERTIA, ExactJoint, ExactTree, inertia_transform

Entries = dict[tuple[int, int], Value]
"""The elements of the regressor: {(joint, parameter): value}."""

_NOTHING = [ZERO] * 3
_UNIT = [[constant(int(i == j)) for i in range(3)] for j in range(3)]
_AXIS = _UNIT[2]
_Vector = Sequence[Value]


@dataclass(frozen=True, eq=False)
class _Motion:
    """A frame's motion in its own axes: acceleration of its origin, w (`angular`), e (`turning`).

    `partial` has the linear and angular velocity per unit velocity of each joint above.
    """

    acceleration: _Vector
    angular: _Vector
    turning: _Vector
    partial: Mapping[int, tuple[_Vector, _Vector]]


def regressor_program(tree: ExactTree) -> tuple[Program, Entries]:
    """Return the program (inputs q0 .., v0 .., a0 ..) and the nonzero elements by joint."""
    program, entries = Program(), Entries()
    # A base accelerated by -g gives every body its weight.
    gravity = [constant(-x) for x in tree.gravity.entries()]
    base = _Motion(gravity, _NOTHING, _NOTHING, {})
    motions: list[_Motion] = []
    for place, (joint, body) in enumerate(zip(tree.joints, tree.bodies, strict=True)):
        above = base if joint.parent < 0 else motions[joint.parent]
        placed = _placed(program, joint, above)
        through = _slid if joint.is_prismatic else _turned
        motion = _named_motion(program, through(program, place, body, placed))
        motions.append(motion)
        for (k, column), value in _columns(program, joint, motion).items():
            entries[tree.bodies[k], 10 * body + column] = value
    return program, entries


def _placed(program: Program, joint: ExactJoint, above: _Motion) -> _Motion:
    """Return the parent's motion at the joint's frame at zero position."""
    turned = joint.rotation.transpose().tolist()
    offset = [constant(x) for x in joint.translation.entries()]
    # Acceleration of the point at `offset`: a + B offset, B = [e]x + [w]x [w]x.
    shape = _shape(program, above.angular, above.turning)
    moved = [_times(x, column) for x, column in zip(offset, shape, strict=True)]
    partial = {
        k: (combined(turned, _added(v, cross(w, offset))), combined(turned, w))
        for k, (v, w) in above.partial.items()
    }
    motion = _Motion(
        combined(turned, _added(above.acceleration, *moved)),
        combined(turned, above.angular),
        combined(turned, above.turning),
        partial,
    )
    return _named_motion(program, motion)


def _turned(program: Program, place: int, body: int, placed: _Motion) -> _Motion:
    """Return the motion behind a joint that rotates about z."""
    c, s, speed, rate = (f"{x}{body}" for x in "csva")
    program.circular[c], program.circular[s] = ("cos", f"q{body}"), ("sin", f"q{body}")
    # e = R^T e_0 + (R^T w_0) x z q' + z q''.
    propagated = named(program, _about_axis(c, s, placed.angular))
    swept = _times(name(speed), cross(propagated, _AXIS))
    partial = {
        k: (_about_axis(c, s, v), _about_axis(c, s, w)) for k, (v, w) in placed.partial.items()
    }
    return _Motion(
        _about_axis(c, s, placed.acceleration),
        _added(propagated, _times(name(speed), _AXIS)),
        _added(_about_axis(c, s, placed.turning), swept, _times(name(rate), _AXIS)),
        {**partial, place: (_NOTHING, _AXIS)},
    )


def _slid(program: Program, place: int, body: int, placed: _Motion) -> _Motion:
    """Return the motion behind a joint that slides along z."""
    q, speed, rate = (name(f"{x}{body}") for x in "qva")
    # a = a_0 + B z q + 2 w x z q' + z q''.
    coriolis = [scaled(2, x) for x in _times(speed, cross(placed.angular, _AXIS))]
    along = _times(q, _shape(program, placed.angular, placed.turning)[2])
    partial = {
        k: (_added(v, _times(q, cross(w, _AXIS))), w) for k, (v, w) in placed.partial.items()
    }
    return _Motion(
        _added(placed.acceleration, along, coriolis, _times(rate, _AXIS)),
        placed.angular,
        placed.turning,
        {**partial, place: (_AXIS, _NOTHING)},
    )


def _named_motion(program: Program, motion: _Motion) -> _Motion:
    partial = {k: (named(program, v), named(program, w)) for k, (v, w) in motion.partial.items()}
    return _Motion(
        named(program, motion.acceleration),
        named(program, motion.angular),
        named(program, motion.turning),
        partial,
    )


def _added(*vectors: _Vector) -> list[Value]:
    return [plus(*parts) for parts in zip(*vectors, strict=True)]


def _times(factor: Value, vector: _Vector) -> list[Value]:
    return [times(factor, x) for x in vector]


def _about_axis(c: str, s: str, vector: _Vector) -> list[Value]:
    """Return a vector in the axes rotated about z by the joint."""
    cosine, sine, (x, y, z) = name(c), name(s), vector
    return [
        plus(times(cosine, x), times(sine, y)),
        plus(times(cosine, y), scaled(-1, times(sine, x))),
        z,
    ]


def _shape(program: Program, w: _Vector, e: _Vector) -> list[list[Value]]:
    """Return the columns of B = [e]x + [w]x [w]x; equal sums share one name in the program."""
    return [
        named(program, _added(cross(e, axis), cross(w, named(program, cross(w, axis)))))
        for axis in _UNIT
    ]


def _inertia_moments(program: Program, motion: _Motion) -> list[list[Value]]:
    """Return I e + w x I w for each of the six unit moments of inertia."""
    moments = []
    for row, column in INERTIA:
        unit = [[0] * 3 for _ in range(3)]
        unit[row][column] = unit[column][row] = 1
        spin = cross(motion.angular, combined(unit, motion.angular))
        spin = [_by_products(program, x) for x in spin]
        force = combined(unit, motion.turning)
        moments.append([plus(x, y) for x, y in zip(force, spin, strict=True)])
    return moments


def _by_products(program: Program, value: Value) -> Value:
    """Name each product of a sum, so that it is computed once."""
    return plus(*(named(program, [{factors: x}])[0] for factors, x in value.items()))


def _columns(program: Program, joint: ExactJoint, motion: _Motion) -> dict[tuple[int, int], Value]:
    """Return the nonzero {(joint above, parameter of the body): torque}."""
    a = motion.acceleration
    forces = [a, *_shape(program, motion.angular, motion.turning)]
    moments = [named(program, cross(axis, a)) for axis in _UNIT]
    inertial = [named(program, moment) for moment in _inertia_moments(program, motion)]
    to_aligned = inertia_transform(joint.alignment.transpose()).transpose().tolist()
    columns = {}
    # tau_k = v_k . f + w_k . n with the unit parameters' (f, n): (a, 0) of m, (B e_i, e_i x a) of
    # h_i, and (0, moment) of inertias.
    for k, (linear, angular) in motion.partial.items():
        torques = [dot(linear, force) for force in forces]
        torques[1:] = _added(torques[1:], [dot(angular, moment) for moment in moments])
        torques += [dot(angular, moment) for moment in inertial]
        # Y theta = Y_aligned T theta: the rows of Y_aligned times T, computed as T^T times columns.
        aligned = named(program, combined(to_aligned, named(program, torques)))
        columns.update({(k, column): value for column, value in enumerate(aligned) if value})
    return columns
