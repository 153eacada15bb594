"""The joint-torque regressor as a straight-line program, by Newton-Euler body by body.

A program is a list of named sums of products of numbers and names, in the order of evaluation, with
one name per common subexpression. Coefficients stay rational until they are evaluated or written.

In the aligned frame of a body with origin acceleration a (less gravity), angular velocity w,
angular acceleration e, mass m and first moments h, the force is m a + B h and the moment about the
origin h x a + I e + w x I w, with B = [e]x + [w]x [w]x. The torque at each joint above is their
product with the partial velocities of the joint (Kane).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import fmpq

from seaid._arrays import Array
from seaid.regressor.exact.geometry import INERTIA, ExactJoint, ExactTree, inertia_transform, number

Value = Mapping[tuple[str, ...], fmpq]
"""A sum: {sorted names of the factors: coefficient}; {} is zero."""

ZERO: Value = {}


@dataclass(frozen=True, eq=False)
class Program:
    """Steps {name: value}, each in earlier names; `circular` are {name: ('sin', 'q1')}."""

    circular: dict[str, tuple[str, str]] = field(default_factory=dict)
    steps: dict[str, Value] = field(default_factory=dict)
    known: dict[frozenset[tuple[tuple[str, ...], fmpq]], str] = field(default_factory=dict)


def constant(x: Any) -> Value:
    """Return a number as a value."""
    return {(): fmpq(x)} if x != 0 else {}


def name(text: str) -> Value:
    """Return a name as a value."""
    return {(text,): fmpq(1)}


def plus(*values: Value) -> Value:
    """Return the sum."""
    total: dict[tuple[str, ...], fmpq] = {}
    for value in values:
        for factors, x in value.items():
            total[factors] = total.get(factors, 0) + x
    return {factors: x for factors, x in total.items() if x != 0}


def times(a: Value, b: Value) -> Value:
    """Return the product."""
    products = ({tuple(sorted(f + g)): x * y} for f, x in a.items() for g, y in b.items())
    return plus(*products)


def scaled(scale: Any, value: Value) -> Value:
    """Return scale * value."""
    return {factors: scale * x for factors, x in value.items()} if scale != 0 else {}


def dot(a: Iterable[Value], b: Iterable[Value]) -> Value:
    """Return the sum of the products."""
    return plus(*(times(x, y) for x, y in zip(a, b, strict=True)))


def cross(a: Sequence[Value], b: Sequence[Value]) -> list[Value]:
    """Return the vector product of two triples."""
    return [
        plus(times(a[j], b[k]), scaled(-1, times(a[k], b[j]))) for j, k in ((1, 2), (2, 0), (0, 1))
    ]


def combined(matrix: Sequence[Sequence[Any]], vector: Sequence[Value]) -> list[Value]:
    """Return matrix @ vector for a matrix of numbers."""
    return [
        plus(*(scaled(x, value) for x, value in zip(row, vector, strict=True))) for row in matrix
    ]


def named(program: Program, values: Iterable[Value]) -> list[Value]:
    """Name each value that is more than a number times a name; equal ones share a name."""
    return [_named(program, value) for value in values]


def _named(program: Program, value: Value) -> Value:
    if not value or (len(value) == 1 and len(next(iter(value))) < 2):
        return value
    existing = program.known.get(frozenset(value.items()))
    if existing is not None:
        return name(existing)
    # The same value with the other sign shares the name: cross products give many of these.
    opposite = program.known.get(frozenset(scaled(-1, value).items()))
    if opposite is not None:
        return scaled(-1, name(opposite))
    text = f"x{len(program.steps)}"
    program.steps[text] = value
    program.known[frozenset(value.items())] = text
    return name(text)


def needed(program: Program, values: Iterable[Value]) -> set[str]:
    """Return the names that the values need, directly or through others."""
    names = {factor for value in values for factors in value for factor in factors}
    # A step needs earlier ones only: backwards, all that need a step have been seen before it.
    for text in reversed(program.steps):
        if text in names:
            names.update(factor for factors in program.steps[text] for factor in factors)
    names.update(argument for text, (_, argument) in program.circular.items() if text in names)
    return names


_CIRCULAR: dict[str, Callable[[Array], Array]] = {"sin": np.sin, "cos": np.cos}


def evaluated(
    program: Program, entries: Mapping[tuple[int, int], Value], motion: Mapping[str, Array]
) -> Iterator[tuple[tuple[int, int], Any]]:
    """Yield the places of entries and their values (T,) along `motion` {name: (T,)}.

    They agree bit by bit with those of the exported source.
    """
    known, used = dict(motion), needed(program, entries.values())
    for text, (function, argument) in program.circular.items():
        if text in used:
            known[text] = _CIRCULAR[function](motion[argument])
    for text, value in program.steps.items():
        if text in used:
            known[text] = _sum_of(value, known)
    for place, value in entries.items():
        yield place, _sum_of(value, known)


def _sum_of(value: Value, known: Mapping[str, Any]) -> Any:
    # In the order of the exported text, with which doubles agree bit by bit.
    total: Any = 0.0
    for factors, x in value.items():
        product: Any = number(x)
        for factor in factors:
            product = product * known[factor]
        total = total + product
    return total


Entries = dict[tuple[int, int], Value]
"""The elements of the regressor: {(joint, parameter): value}."""

_NOTHING = [ZERO] * 3
"""The vector (0, 0, 0)."""

_UNIT = [[constant(int(i == j)) for i in range(3)] for j in range(3)]
"""The unit vectors along x, y and z."""

_AXIS = _UNIT[2]
"""The axis of a joint in its own frame, z."""

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
