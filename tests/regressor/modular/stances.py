"""What the stances of a floating base determine, exactly: rows without contact forces mod a prime.

At random instants of each stance the contacts stand still, balls as points at their centres; the
rows of the base and of the joints that no contact force reaches are the left null space of J_c^T
times the regressor. Their columns are those of `seaid.base_parameters(robot, stances=...)`, decided
without rounding.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from flint import nmod_mat

from seaid.legged.floating import force_counts
from seaid.regressor.exact.geometry import exact_tree
from seaid.robot import HANGING, Contact, Robot
from tests.regressor.modular.arithmetic import ResidueNumbers, Residues, echelon
from tests.regressor.modular.dynamics import PRIME, BodyMotion, Words, modular_dynamics

_MORE_ROWS, _OF_BRANCH = 12, 6
"""Rows beyond the number of parameters, and the most rows of an instant that show a branch of the
robot in other ways: it acts on the rest by a force and a moment."""


def columns_of_stances(
    robot: Robot,
    stances: Sequence[Sequence[str]],
    *,
    torque_joints: Sequence[str] | None = None,
    measured: Sequence[str] = (),
    seed: int = 0,
) -> tuple[int, ...]:
    """Return the base columns of the regressor of a floating base in some stances, exactly.

    Parameters
    ----------
    robot : Robot
        With a floating base.
    stances : list of lists of str
        As in `seaid.base_parameters`; an empty list is flight; "hanging": with the base bolted to
        the world.
    torque_joints : list of str, optional
        Joints whose torque is known. Default: all.
    measured : list of str, optional
        Contacts whose wrench is measured.
    seed : int, default 0

    Returns
    -------
    tuple of int
        Those from the left, with the base before the other bodies.
    """
    assert robot.floating_base is not None
    numbers = ResidueNumbers(robot, np.random.default_rng(seed))
    known = list(map(robot.index, robot.selected(torque_joints)))
    free = _axes_and_gravity(numbers)[0]
    width, rows = len(robot.parameters), [np.zeros((0, len(robot.parameters)), dtype=object)]
    for links in stances:
        if links == HANGING:
            rows.append(_hanging_rows(numbers, known, _instants(width, len(known))))
            continue
        contacts = [contact for contact in robot.floating_base.contacts if contact.link in links]
        hidden = [contact for contact in contacts if contact.link not in measured]
        reached = sum(force_counts(hidden))
        equations = max(int(sum(free)) + len(known) - reached, 1)
        rows.append(_rows(numbers, contacts, hidden, known, _instants(width, equations)))
    H = np.vstack(rows)
    H[:, robot.is_known] = 0
    order = np.roll(np.arange(width), 10)  # the base is the last body
    pivots, _ = echelon(H[:, order])
    return tuple(int(order[pivot]) for pivot in pivots)


def _instants(width: int, rows: int) -> int:
    """Return at how many instants so many `rows` each determine what can be of all parameters."""
    return (width + _MORE_ROWS) // min(rows, _OF_BRANCH) + 1


def _rows(
    numbers: ResidueNumbers,
    contacts: Sequence[Contact],
    hidden: Sequence[Contact],
    known: Sequence[int],
    count: int,
) -> Residues:
    """Return the rows (R, m) without the forces of `hidden` contacts at instants of one stance."""
    dynamics, n = modular_dynamics(exact_tree(numbers.robot)), numbers.robot.n
    q, turned, v, a = numbers.states(count)
    linear, w, e, f = (numbers.random(count, 3) for _ in range(4))
    free, along = _axes_and_gravity(numbers)
    linear, w, e, f = linear * free[:3], w * free[3:], e * free[3:], f * free[:3] + along
    places = [_place(numbers, contact) for contact in contacts]
    states = numbers.of_bodies(q, turned, v, a)
    forces = [
        _leader_rows(numbers, dynamics.forces_at(states, *place, contact.is_flat))
        for place, contact in zip(places, contacts, strict=True)
    ]
    A = np.concatenate([np.zeros((count, 6 + n, 0), dtype=object), *forces], axis=2)
    if contacts:
        changing = A * np.array([*free, *[1] * n], dtype=object)[:, None]
        # J v = 0, by changing only velocities that the guide of the base and the joints leave free.
        moved = _changed(changing, np.hstack([linear, w, v]), 0 * A[:, 0])
        w, v = moved[:, 3:6], moved[:, 6:]
        states = numbers.of_bodies(q, turned, v, 0 * v)
        # J' v: accelerations of the contacts with all accelerations of base and joints zero.
        still = _motion(0 * w, w, 0 * w)
        drift = [
            dynamics.acceleration_at(states, still, *place, contact.is_flat).astype(object)
            for place, contact in zip(places, contacts, strict=True)
        ]
        wanted = -np.hstack(drift) % PRIME
        moved = _changed(changing, np.hstack([linear, e, a]), wanted)
        # the specific force is the acceleration less gravity, which has any direction
        f, e, a = (moved[:, :3] + f) % PRIME, moved[:, 3:6], moved[:, 6:]
    states = numbers.of_bodies(q, turned, v, a)
    Y = _leader_rows(numbers, dynamics.regressor(states, _motion(f, w, e)))
    kept = [*np.flatnonzero(free), *(6 + joint for joint in known)]
    unknown = [x for x, contact in zip(forces, contacts, strict=True) if contact in hidden]
    A = np.concatenate([A[:, :, :0], *unknown], axis=2)
    return np.vstack(
        [_unreached_rows(A_t, Y_t) for A_t, Y_t in zip(A[:, kept], Y[:, kept], strict=True)]
    )


def _hanging_rows(numbers: ResidueNumbers, known: Sequence[int], count: int) -> Residues:
    """Return the rows (R, m) of joints whose base is bolted to the world."""
    dynamics = modular_dynamics(exact_tree(numbers.robot))
    still = np.zeros((count, 3), dtype=object)
    f = still - np.array([int(x) for x in dynamics.gravity], dtype=object)
    states = numbers.of_bodies(*numbers.states(count))
    Y = _leader_rows(numbers, dynamics.regressor(states, _motion(f, still, still)))
    return np.asarray(Y[:, [6 + joint for joint in known]].reshape(-1, Y.shape[2]))


_DIGITS = 12
"""Decimals of the place of a contact [m] that are no rounding."""


def _place(numbers: ResidueNumbers, contact: Contact) -> tuple[int, Words]:
    """Return the body of a contact, and its place (3,) in the frame of that body."""
    base = numbers.robot.floating_base
    assert base is not None
    body, rotation, position = base.frame(contact.link)
    at = np.round(position + rotation @ np.array(contact.position_m), _DIGITS)
    return body, np.array([numbers.number(x) for x in at.tolist()], dtype=np.int64)


def _axes_and_gravity(numbers: ResidueNumbers) -> tuple[Residues, Residues]:
    """Return whether the base moves along and turns about each axis, 0 or 1 (6,), and -g (3,).

    Gravity along the normal of a planar base is the same at all of its angles.
    """
    base, along = numbers.robot.floating_base, np.zeros(3, dtype=object)
    assert base is not None
    if base.normal is not None:
        down = float(numbers.robot.model.gravity.linear @ base.normal_in_world)
        value = numbers.number(round(-down, _DIGITS))
        along = np.array([int(x) * value for x in base.normal], dtype=object)
    return base.free_axes.astype(int).astype(object), along


def _motion(linear: Residues, w: Residues, e: Residues) -> BodyMotion:
    whole = np.stack([linear, w, e]).astype(object) % PRIME
    first, second, third = whole.astype(np.int64)
    return first, second, third


def _leader_rows(numbers: ResidueNumbers, rows: Words) -> Residues:
    """Return rows (T, 6 + n, ...) of the base and of the independent joints."""
    return np.concatenate([rows[:, :6].astype(object), numbers.on_leaders(rows[:, 6:])], axis=1)


def _matrix(values: Residues) -> nmod_mat:
    rows, columns = values.shape
    matrix: nmod_mat = nmod_mat(rows, columns, [int(x) for x in values.ravel()], PRIME)
    return matrix


def _changed(A: Residues, x: Residues, wanted: Residues) -> Residues:
    """Return x (T, m) changed in the pivots of J = A^T so that J x = `wanted` (T, k)."""
    changed = x.copy()
    for t, (A_t, b) in enumerate(zip(A, wanted, strict=True)):
        J = A_t.T
        # J dx = b - J x; with dx zero outside the pivots the last column is dx.
        right = (b - J @ x[t]) % PRIME
        reduced, rank = _matrix(np.column_stack([J, right])).rref()
        for row in reduced.tolist()[:rank]:
            pivot = next(place for place, entry in enumerate(row) if int(entry))
            changed[t, pivot] = (changed[t, pivot] + int(row[-1])) % PRIME
    return changed


def _unreached_rows(A: Residues, Y: Residues) -> Residues:
    """Return the combinations of the rows Y (r, m) that the forces A (r, k) do not reach."""
    if not A.shape[1]:
        return Y
    # In [A 1], rows of the echelon form that are zero in A span the left null space of A.
    reduced, rank = _matrix(np.hstack([A, np.eye(len(A), dtype=object)])).rref()
    table = np.array([[int(x) for x in row] for row in reduced.tolist()], dtype=object)
    k = A.shape[1]
    free = table[[place for place in range(rank) if not np.any(table[place, :k])], k:]
    return np.asarray(free @ Y % PRIME)
