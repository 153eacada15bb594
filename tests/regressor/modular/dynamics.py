"""Inverse dynamics of a robot modulo a prime: torques and regressor, vectorised over instants.

The same Newton-Euler equations as in `seaid.regressor.exact.program`, evaluated instead of
written down: in the aligned frame of a body, force m a + B h and moment h x a + I e + w x I w.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq_mat
from numpy.typing import NDArray

from seaid.regressor.exact.geometry import INERTIA, ExactTree, inertia_transform

PRIME = 2**29 - 3
"""Sums of up to 32 products are below 2^63, so that NumPy's own products of matrices hold."""

Words = NDArray[np.int64]
"""Integers from 0 to PRIME - 1."""

BodyMotion = tuple[Words, Words, Words]
"""Acceleration of the origin less gravity, angular velocity w and acceleration e of a body, (S, 3).
"""


def residue(value: Fraction) -> int:
    """Return a rational modulo PRIME."""
    return value.numerator * pow(value.denominator, -1, PRIME) % PRIME


def words(matrix: fmpq_mat) -> Words:
    """Return a matrix of rationals modulo the prime."""
    rows = [[residue(Fraction(int(x.p), int(x.q))) for x in row] for row in matrix.tolist()]
    return np.array(rows, dtype=np.int64)


def _cross(a: Words, b: Words) -> Words:
    return np.cross(a, b) % PRIME


def _skew(v: Words) -> Words:
    """Return the matrices (..., 3, 3) of the product v x."""
    return _cross(v[..., None, :], np.eye(3, dtype=np.int64)).swapaxes(-1, -2)


def _moved(motion: BodyMotion, r: Words) -> Words:
    """Return the acceleration of a point r (S, 3) or (3,) of a body."""
    linear, w, e = motion
    return (linear + _cross(e, r) + _cross(w, _cross(w, r))) % PRIME


def _wrenches(motion: BodyMotion) -> Words:
    """Return force and moment about the origin (S, 6, 10) of the ten unit parameters of a body."""
    a, w, e = motion
    K = np.zeros((len(a), 6, 10), dtype=np.int64)
    K[:, :3, 0] = a
    K[:, :3, 1:4] = _skew(e) + _skew(w) @ _skew(w)
    K[:, 3:, 1:4] = -_skew(a)
    of_e, of_w = np.zeros((2, len(a), 3, 6), dtype=np.int64)  # I e and I w
    for column, (i, j) in enumerate(INERTIA):
        for product, vector in ((of_e, e), (of_w, w)):
            product[:, i, column], product[:, j, column] = vector[:, j], vector[:, i]
    K[:, 3:, 4:] = of_e + _skew(w) @ of_w
    return K % PRIME


@dataclass(frozen=True, eq=False)
class _Joint:
    parent: int
    is_prismatic: bool
    rotation: Words
    translation: Words
    from_body: Words
    """The map (10, 10) from the parameters of the body to those in its aligned frame."""
    to_aligned: Words
    """The rotation (3, 3) of vectors of the body's frame to its aligned frame."""

    @property
    def row(self) -> int:
        """The component along z of a wrench (6,) that its torque or force is."""
        return 2 if self.is_prismatic else 5

    def turned(self, c: Words, s: Words) -> Words:
        """Return the rotations (S, 3, 3) of the joint about z."""
        R = np.zeros((len(c), 3, 3), dtype=np.int64)
        R[:, 2, 2] = 1
        if self.is_prismatic:
            R[:, 0, 0] = R[:, 1, 1] = 1
        else:
            R[:, 0, 0] = R[:, 1, 1] = c
            R[:, 1, 0], R[:, 0, 1] = s, -s % PRIME
        return R

    def along(self, values: Words, slides: bool) -> Words:
        """Return vectors (S, 3) along z: zero unless the joint slides, or turns."""
        z = np.zeros((len(values), 3), dtype=np.int64)
        z[:, 2] = values * (self.is_prismatic == slides)
        return z

    def behind(self, motion: BodyMotion, state: Sequence[Words]) -> BodyMotion:
        """Return the motion of its body, by that of the parent."""
        q, c, s, v, a = state
        R = self.rotation @ self.turned(c, s) % PRIME
        linear, w, e = (
            np.einsum("sji,sj->si", R, x) % PRIME
            for x in (_moved(motion, self.translation), *motion[1:])
        )
        linear = _moved((linear, w, e), self.along(q, True)) + self.along(a, True)
        linear += 2 * _cross(w, self.along(v, True))
        e = e + _cross(w, self.along(v, False)) + self.along(a, False)
        return linear % PRIME, (w + self.along(v, False)) % PRIME, e % PRIME

    def to_parent(self, state: Sequence[Words], wrenches: Words) -> Words:
        """Return wrenches (S, 6, k) about the parent's origin, in its frame."""
        turned = self.turned(state[1], state[2])
        R = self.rotation @ turned % PRIME
        lever = self.rotation @ (_skew(self.along(state[0], True)) @ turned % PRIME)
        lever += _skew(self.translation) @ R
        f, n = wrenches[:, :3], wrenches[:, 3:]
        return np.concatenate([R @ f, lever % PRIME @ f + R @ n], axis=1) % PRIME


@dataclass(frozen=True, eq=False)
class ModularDynamics:
    """A tree modulo the prime; states and torques are ordered as its bodies."""

    joints: tuple[_Joint, ...]
    bodies: tuple[int, ...]
    gravity: Words

    def torques(self, states: Sequence[Words], parameters: Words) -> Words:
        """Return the torques (S, b) at S states, each (S, b): q, cos, sin, v, a; of (10 b,)."""
        return np.asarray(np.sum(self.regressor(states) * parameters % PRIME, axis=2) % PRIME)

    def regressor(self, states: Sequence[Words], base: BodyMotion | None = None) -> Words:
        """Return the joint-torque regressor (S, b, 10 b).

        With the motion of a floating base six more rows, of force and moment on it, come first, and
        ten more columns, of its own body, last: (S, 6 + b, 10 b + 10).
        """
        motions = self.motions(states, base)
        count, width = states[0].shape
        shape = (6 + width, 10 * width + 10) if base else (width, 10 * width)
        whole = np.zeros((count, *shape), dtype=np.int64)
        below: dict[int, list[tuple[list[int], Words]]] = defaultdict(list)  # of the base by -1
        for place, joint, body, state in self._from_the_tips(states):
            own = _wrenches(motions[place]) @ joint.from_body % PRIME
            columns, wrenches = _joined([*below.pop(place, []), (_columns(body), own)])
            whole[:, body - width, columns] = wrenches[:, joint.row]
            if joint.parent >= 0 or base is not None:
                below[joint.parent].append((columns, joint.to_parent(state, wrenches)))
        if base is not None:
            columns, wrenches = _joined([*below[-1], (_columns(width), _wrenches(base))])
            whole[:, :6, columns] = wrenches
        return whole

    def forces_at(self, states: Sequence[Words], body: int, point: Words, is_flat: bool) -> Words:
        """Return the rows (S, 6 + b, 3 or 6) of unit forces (and moments) at a point of a body.

        The point (3,) is in the frame of the body, -1 for the base; the forces in its aligned one.
        """
        count, width = states[0].shape
        at = point if body < 0 else self.joints[self.bodies.index(body)].to_aligned @ point % PRIME
        wrenches = np.tile(np.eye(6, dtype=np.int64), (count, 1, 1))
        wrenches[:, 3:, :3] = _skew(at)  # the moment about the origin of the body: n + r x f
        rows = np.zeros((count, 6 + width, 6), dtype=np.int64)
        follows = self.bodies.index(body) if body >= 0 else -1
        for place, joint, index, state in self._from_the_tips(states):
            if place == follows:
                rows[:, 6 + index] = wrenches[:, joint.row]
                wrenches, follows = joint.to_parent(state, wrenches), joint.parent
        rows[:, :6] = wrenches
        return rows[:, :, : 6 if is_flat else 3]

    def acceleration_at(
        self, states: Sequence[Words], base: BodyMotion, body: int, point: Words, is_flat: bool
    ) -> Words:
        """Return the acceleration (S, 3 or 6) of a point of a body, in the body's aligned frame."""
        motion, at = base, point
        if body >= 0:
            place = self.bodies.index(body)
            motion = self.motions(states, base)[place]
            at = self.joints[place].to_aligned @ point % PRIME
        return np.hstack([_moved(motion, at), *([motion[2]] if is_flat else [])])

    def motions(self, states: Sequence[Words], base: BodyMotion | None = None) -> list[BodyMotion]:
        """Return of every body the acceleration of its origin, w and e, in its aligned frame."""
        still = np.zeros((len(states[0]), 3), dtype=np.int64)
        base = base or ((still - self.gravity) % PRIME, still, still)
        motions: list[BodyMotion] = []
        for joint, body in zip(self.joints, self.bodies, strict=True):
            parent = base if joint.parent < 0 else motions[joint.parent]
            motions.append(joint.behind(parent, [x[:, body] for x in states]))
        return motions

    def _from_the_tips(
        self, states: Sequence[Words]
    ) -> Iterator[tuple[int, _Joint, int, list[Words]]]:
        for place in reversed(range(len(self.joints))):
            body = self.bodies[place]
            yield place, self.joints[place], body, [x[:, body] for x in states]


def _columns(body: int) -> list[int]:
    return list(range(10 * body, 10 * body + 10))


def _joined(stacks: Sequence[tuple[list[int], Words]]) -> tuple[list[int], Words]:
    """Return wrenches of several bodies, with their columns of the regressor, as one."""
    columns = [column for own, _ in stacks for column in own]
    return columns, np.concatenate([wrenches for _, wrenches in stacks], axis=2)


def modular_dynamics(tree: ExactTree) -> ModularDynamics:
    """Return the inverse dynamics of a tree modulo the prime."""
    joints = tuple(
        _Joint(
            joint.parent,
            joint.is_prismatic,
            words(joint.rotation),
            words(joint.translation)[:, 0],
            words(inertia_transform(joint.alignment.transpose())),
            words(joint.alignment.transpose()),
        )
        for joint in tree.joints
    )
    return ModularDynamics(joints, tree.bodies, words(tree.gravity)[:, 0])
