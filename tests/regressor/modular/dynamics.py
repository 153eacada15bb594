"""Inverse dynamics of a robot modulo a prime: torques and regressor, vectorised over instants.

The same Newton-Euler equations as in `seaid.regressor.exact.program`, evaluated instead of
written down: in the aligned frame of a body, force m a + B h and moment h x a + I e + w x I w.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np
from flint import fmpq_mat
from numpy.typing import NDArray

from seaid.regressor.exact.geometry import INERTIA, ExactTree, inertia_transform

PRIME = 2**61 - 1
"""A Mersenne prime that fits in a machine word."""

Words = NDArray[np.uint64]
"""Integers from 0 to PRIME - 1."""

_P, _LOW, _HALF = np.uint64(PRIME), np.uint64(2**32 - 1), np.uint64(2**29 - 1)
_29, _32, _61, _3 = (np.uint64(x) for x in (29, 32, 61, 3))


def times(x: Words, y: Words) -> Words:
    """Return x * y, with 2^64 = 8, 2^61 = 1 modulo the prime, in halves of 32 bits."""
    # x y = a c 2^64 + (a d + b c) 2^32 + b d with a, c < 2^29: no sum reaches 2^64.
    a, b, c, d = x >> _32, x & _LOW, y >> _32, y & _LOW
    middle, low = a * d + b * c, b * d
    total = (a * c << _3) + (middle >> _29) + ((middle & _HALF) << _32)
    return folded(total + (low & _P) + (low >> _61))


def folded(total: Words) -> Words:
    """Return sums below 2^64 modulo the prime."""
    # 2^61 = 1: the bits above count as ones; the rest is below 2 PRIME.
    total = (total & _P) + (total >> _61)
    return total - _P * (total >= _P)


def minus(x: Words, y: Words) -> Words:
    """Return x - y."""
    return folded(x + (_P - y))


def residue(value: Fraction) -> int:
    """Return a rational modulo PRIME."""
    return value.numerator * pow(value.denominator, -1, PRIME) % PRIME


def words(matrix: fmpq_mat) -> Words:
    """Return a matrix of rationals modulo the prime."""
    rows = [[residue(Fraction(int(x.p), int(x.q))) for x in row] for row in matrix.tolist()]
    return np.array(rows, dtype=np.uint64)


_Vector = Sequence[Any]
"""Three components, each of any shape."""

BodyMotion = tuple[_Vector, _Vector, _Vector]
"""Acceleration of the origin less gravity, angular velocity w and acceleration e of a body."""


def _sum(parts: Sequence[Words]) -> Words:
    total = parts[0]
    for part in parts[1:]:
        total = folded(total + part)
    return total


def _add(a: _Vector, b: _Vector) -> list[Words]:
    return [folded(x + y) for x, y in zip(a, b, strict=True)]


def _cross(a: _Vector, b: _Vector) -> list[Words]:
    return [minus(times(a[j], b[k]), times(a[k], b[j])) for j, k in ((1, 2), (2, 0), (0, 1))]


def _apply(matrix: Words, vector: _Vector) -> list[Words]:
    """Return matrix @ vector for a matrix of numbers, of which many are zero or one."""
    product = []
    for row in matrix:
        parts = [v if x == 1 else times(x, v) for x, v in zip(row, vector, strict=True) if x]
        product.append(_sum(parts) if parts else np.zeros_like(vector[0]))
    return product


@dataclass(frozen=True, eq=False)
class _Joint:
    parent: int
    is_prismatic: bool
    rotation: Words
    translation: list[Words]
    from_body: Words
    """The map (10, 10) from the parameters of the body to those in its aligned frame."""
    to_aligned: Words
    """The rotation (3, 3) of vectors of the body's frame to its aligned frame."""


@dataclass(frozen=True, eq=False)
class ModularDynamics:
    """A tree modulo the prime; states and torques are ordered as its bodies."""

    joints: tuple[_Joint, ...]
    bodies: tuple[int, ...]
    gravity: list[Words]

    def torques(self, states: Sequence[Words], parameters: Words) -> Words:
        """Return the torques (S, b) at S states, each (S, b): q, cos, sin, v, a; of (10 b,)."""
        motions = self.motions(states)
        count = states[0].shape
        forces: list[tuple[list[Words], list[Words]]] = []
        for joint, body, motion in zip(self.joints, self.bodies, motions, strict=True):
            aligned = _apply(joint.from_body, list(parameters[10 * body : 10 * body + 10]))
            columns = _wrenches(motion, aligned)
            forces.append(columns)
        torques = np.zeros(count, dtype=np.uint64)
        for place in reversed(range(len(self.joints))):
            joint, body, (f, n) = self.joints[place], self.bodies[place], forces[place]
            torques[:, body] = f[2] if joint.is_prismatic else n[2]
            if joint.parent >= 0:
                f, n = _to_parent(joint, [x[:, body] for x in states[:3]], f, n)
                up = forces[joint.parent]
                forces[joint.parent] = (_add(up[0], f), _add(up[1], n))
        return torques

    def regressor(self, states: Sequence[Words], base: BodyMotion | None = None) -> Words:
        """Return the joint-torque regressor (S, b, 10 b).

        With the motion of a floating base six more rows, of force and moment on it, come first, and
        ten more columns, of its own body, last: (S, 6 + b, 10 b + 10).
        """
        motions = self.motions(states, base)
        count, width = states[0].shape
        shape = (6 + width, 10 * width + 10) if base else (width, 10 * width)
        whole = np.zeros((count, *shape), dtype=np.uint64)
        joint_rows = whole[:, -width:]
        below: dict[int, list[_Stack]] = defaultdict(list)  # by the parent, of the base by -1
        for place in reversed(range(len(self.joints))):
            joint, body = self.joints[place], self.bodies[place]
            below[place].append(_columns(motions[place], joint.from_body, body))
            columns, f, n = _joined_stacks(below.pop(place))
            joint_rows[:, body, columns] = f[2] if joint.is_prismatic else n[2]
            if joint.parent >= 0 or base is not None:
                state = [x[:, body, None] for x in states[:3]]
                below[joint.parent].append((columns, *_to_parent(joint, state, f, n)))
        if base is not None:
            below[-1].append(_columns(base, np.eye(10, dtype=np.uint64), width))
            columns, f, n = _joined_stacks(below[-1])
            whole[:, :6, columns] = np.stack([*f, *n], axis=1)
        return whole

    def forces_at(self, states: Sequence[Words], body: int, point: Words, is_flat: bool) -> Words:
        """Return the rows (S, 6 + b, 3 or 6) of unit forces (and moments) at a point of a body.

        The point (3,) is in the frame of the body, -1 for the base; the forces in its aligned one.
        """
        count, width = states[0].shape
        zero, unit = np.zeros((count, 6), dtype=np.uint64), np.eye(6, dtype=np.uint64)
        f, n = ([zero + unit[i] for i in part] for part in (range(3), range(3, 6)))
        place = self.bodies.index(body) if body >= 0 else -1
        at = _apply(self.joints[place].to_aligned, list(point)) if body >= 0 else list(point)
        # Moment about the origin of the body: n + r x f.
        n = _add(n, _cross([x + zero for x in at], f))
        rows = np.zeros((count, 6 + width, 6), dtype=np.uint64)
        while place >= 0:
            joint, index = self.joints[place], self.bodies[place]
            rows[:, 6 + index] = f[2] if joint.is_prismatic else n[2]
            f, n = _to_parent(joint, [x[:, index, None] for x in states[:3]], f, n)
            place = joint.parent
        rows[:, :6] = np.stack([*f, *n], axis=1)
        return rows[:, :, : 6 if is_flat else 3]

    def acceleration_at(
        self, states: Sequence[Words], base: BodyMotion, body: int, point: Words, is_flat: bool
    ) -> Words:
        """Return the acceleration (S, 3 or 6) of a point of a body, in the body's aligned frame."""
        place = self.bodies.index(body) if body >= 0 else -1
        linear, w, e = self.motions(states, base)[place] if body >= 0 else base
        at = _apply(self.joints[place].to_aligned, list(point)) if body >= 0 else list(point)
        r = [x + np.zeros_like(w[0]) for x in at]
        moved = _add(linear, _add(_cross(e, r), _cross(w, _cross(w, r))))
        return np.stack([*moved, *(e if is_flat else ())], axis=1)

    def motions(self, states: Sequence[Words], base: BodyMotion | None = None) -> list[BodyMotion]:
        """Return of every body the acceleration of its origin, w and e, in its aligned frame."""
        q, c, s, v, a = states
        zero = np.zeros(len(q), dtype=np.uint64)
        if base is None:
            base = ([minus(zero, x + zero) for x in self.gravity], [zero] * 3, [zero] * 3)
        motions: list[BodyMotion] = []
        for joint, body in zip(self.joints, self.bodies, strict=True):
            linear, w, e = base if joint.parent < 0 else motions[joint.parent]
            r = [x + zero for x in joint.translation]
            linear = _add(linear, _add(_cross(e, r), _cross(w, _cross(w, r))))
            linear, w, e = (_apply(joint.rotation.T, x) for x in (linear, w, e))
            state = q[:, body], c[:, body], s[:, body], v[:, body], a[:, body]
            through = _slid if joint.is_prismatic else _turned
            motions.append(through(linear, w, e, state))
        return motions


def modular_dynamics(tree: ExactTree) -> ModularDynamics:
    """Return the inverse dynamics of a tree modulo the prime."""
    joints = tuple(
        _Joint(
            joint.parent,
            joint.is_prismatic,
            words(joint.rotation),
            [x[0] for x in words(joint.translation)],
            words(inertia_transform(joint.alignment.transpose())),
            words(joint.alignment.transpose()),
        )
        for joint in tree.joints
    )
    return ModularDynamics(joints, tree.bodies, [x[0] for x in words(tree.gravity)])


def _turned(linear: _Vector, w: _Vector, e: _Vector, state: Sequence[Words]) -> Any:
    """Return the motion behind a joint that rotates about z."""
    _, c, s, speed, rate = state

    def about(x: _Vector) -> list[Words]:
        return [
            folded(times(c, x[0]) + times(s, x[1])),
            minus(times(c, x[1]), times(s, x[0])),
            x[2],
        ]

    linear, w, e = about(linear), about(w), about(e)
    # e' = e + w x z q' + z q''
    e = [folded(e[0] + times(w[1], speed)), minus(e[1], times(w[0], speed)), folded(e[2] + rate)]
    return linear, [w[0], w[1], folded(w[2] + speed)], e


def _slid(linear: _Vector, w: _Vector, e: _Vector, state: Sequence[Words]) -> Any:
    """Return the motion behind a joint that slides along z."""
    q, _, _, speed, rate = state
    zero = np.zeros_like(q)
    along, moving = [zero, zero, q], [zero, zero, folded(speed + speed)]
    linear = _add(linear, _add(_cross(e, along), _cross(w, _cross(w, along))))
    linear = _add(linear, _cross(w, moving))  # 2 w x z q'
    return [linear[0], linear[1], folded(linear[2] + rate)], w, e


def _wrenches(
    motion: tuple[_Vector, _Vector, _Vector], parameters: Sequence[Words]
) -> tuple[list[Words], list[Words]]:
    """Return force and moment about the origin of a body with ten parameters."""
    a, w, e = motion
    m, h = parameters[0], [x + np.zeros_like(a[0]) for x in parameters[1:4]]
    inertia = [[parameters[0]] * 3 for _ in range(3)]
    for value, (i, j) in zip(parameters[4:], INERTIA, strict=True):
        inertia[i][j] = inertia[j][i] = value
    turned, swept = (
        [_sum([times(x, y) for x, y in zip(row, vector, strict=True)]) for row in inertia]
        for vector in (e, w)
    )
    force = _add([times(m, x) for x in a], _add(_cross(e, h), _cross(w, _cross(w, h))))
    return force, _add(_cross(h, a), _add(turned, _cross(w, swept)))


_Stack = tuple[list[int], list[Words], list[Words]]
"""Columns of the regressor, and forces and moments in them, three arrays (S, columns) each."""


def _columns(motion: BodyMotion, from_body: Words, body: int) -> _Stack:
    """Return the columns of a body, with forces and moments of its unit parameters."""
    a, w, e = ([x[:, None] for x in vector] for vector in motion)
    columns = list(range(10 * body, 10 * body + 10))
    return columns, *_wrenches((a, w, e), list(from_body[:, None, :]))


def _joined_stacks(stacks: Sequence[_Stack]) -> _Stack:
    """Return several stacks of columns as one."""
    columns, *sides = zip(*stacks, strict=True)
    f, n = ([np.concatenate(x, axis=1) for x in zip(*side, strict=True)] for side in sides)
    return list(chain(*columns)), f, n


def _to_parent(
    joint: _Joint, state: Sequence[Words], f: _Vector, n: _Vector
) -> tuple[list[Words], list[Words]]:
    """Return a force and a moment about the origin in the parent's frame."""
    q, c, s = state

    def back(x: _Vector) -> _Vector:
        if joint.is_prismatic:
            return x
        return [
            minus(times(c, x[0]), times(s, x[1])),
            folded(times(s, x[0]) + times(c, x[1])),
            x[2],
        ]

    f, n = back(f), back(n)
    if joint.is_prismatic:
        n = [minus(n[0], times(q, f[1])), folded(n[1] + times(q, f[0])), n[2]]  # q z x f
    f, n = _apply(joint.rotation, f), _apply(joint.rotation, n)
    shift = [x + np.zeros_like(f[0]) for x in joint.translation]
    return f, _add(n, _cross(shift, f))
