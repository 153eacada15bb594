"""Drives that move several joints: phi = C q, and by the principle of power tau = C^T tau_phi.

phi_i is the output coordinate of drive i, behind its gear. C (n, n) has the robot's joint order on
both sides; row i has the factors in the table of joint i. It is the identity except for groups of
coupled joints (a differential, a parallelogram, a wrist). A factor on a prismatic joint is in rad/m
for the drive of a revolute one, and in m/rad the other way round.

Functions of an array act on its last axis (n) and change only coupled joints: all others keep their
values bit by bit, and NaN of one group does not spread to another.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from seaid._arrays import Array, connected_groups, frozen, safely
from seaid.drives import Drive
from seaid.errors import RobotError, check_name

_SINGULAR = 1e-9
"""Least singular value of a regular block of C, with rows and columns scaled."""


def transmission_matrix(joints: Sequence[str], drives: Mapping[str, Drive]) -> Array:
    """Return C (n, n), read-only; a drive without a transmission moves its own joint."""
    matrix = np.eye(len(joints))
    for row, joint in enumerate(joints):
        factors = drives[joint].transmission if joint in drives else {}
        if factors:
            matrix[row] = [factors.get(name, 0.0) for name in joints]
    return frozen("transmission", matrix, (None, None))


def check_transmission(
    joints: Sequence[str], drives: Mapping[str, Drive], immobile: Collection[str]
) -> None:
    """Raise RobotError for factors on joints that are `immobile`, or for a singular matrix."""
    for joint in joints:
        for name in drives[joint].transmission:
            where = f"joint '{joint}': the transmission of its drive"
            if name in immobile:
                raise RobotError(
                    f"{where} has a factor on '{name}', which does not move here (fixed, or locked "
                    "at zero): let it move with joints=, or remove the factor",
                    "joints=",
                )
            check_name("joint", name, joints, RobotError, where)
            if drives[name].angle_ratio is not None:
                raise RobotError(f"{where} has a factor on '{name}', whose drive has angle_ratio")
    matrix = transmission_matrix(joints, drives)
    for group in coupled_groups(matrix):
        block = matrix[np.ix_(group, group)]
        sizes = np.linalg.norm(block, axis=1, keepdims=True)
        # The rank does not depend on the units of rows and columns, the singular values do.
        scaled = block / np.where(sizes > 0, sizes, 1.0)
        scaled /= np.maximum(np.max(np.abs(scaled), axis=0), _SINGULAR)
        what = "a transmission"
        rank = safely(np.linalg.matrix_rank, scaled, what=what, error=RobotError, tol=_SINGULAR)
        if rank < len(group):
            names = ", ".join(joints[index] for index in group)
            raise RobotError(
                f"the drives of {names} do not move these joints independently: their "
                f"transmission matrix {block.tolist()} is singular; it needs as many independent "
                "rows as there are coupled joints"
            )


def coupled_groups(matrix: Array) -> tuple[list[int], ...]:
    """Return the groups of coupled joints; a joint moved by its own drive alone is in none."""
    if np.array_equal(matrix, np.eye(len(matrix))):  # the usual case, and called often
        return ()
    groups = connected_groups(matrix != 0)
    return tuple(group for group in groups if len(group) > 1 or matrix[group[0], group[0]] != 1)


def group_of(matrix: Array, index: int) -> list[int]:
    """Return the group of coupled joints that contains a joint, or the joint alone."""
    return next((group for group in coupled_groups(matrix) if index in group), [index])


def coupled_names(joints: Sequence[str], matrix: Array) -> tuple[str, ...]:
    """Return the names of all coupled joints."""
    coupled = {index for group in coupled_groups(matrix) for index in group}
    return tuple(joint for index, joint in enumerate(joints) if index in coupled)


def at_drives(matrix: Array, states: Array) -> Array:
    """Return phi = C q of joint positions, velocities or accelerations (..., n)."""
    return _mapped(matrix, states, lambda block: block.T)


def at_joints(matrix: Array, states: Array) -> Array:
    """Return q = C^-1 phi of drive positions, velocities or accelerations (..., n)."""
    return _mapped(matrix, states, lambda block: _inverse(block).T)


def completed(matrix: Array, drives: Array, joints: Array) -> Array:
    """Return joint positions (T, n) whose unknown ones, NaN, follow from those of their drives."""
    unknown, q = np.isnan(joints[0]), np.nan_to_num(joints)
    # C q = phi, solved for the unknown joints; a drive without an encoder turns none of them.
    rest = np.nan_to_num(drives - at_drives(matrix, q))[:, unknown]
    q[:, unknown] = rest @ safely(np.linalg.inv, matrix[np.ix_(unknown, unknown)], what="joints").T
    return q


def torques_at_drives(matrix: Array, torques: Array) -> Array:
    """Return tau_phi = C^-T tau of joint torques (..., n)."""
    return _mapped(matrix, torques, _inverse)


def torques_at_joints(matrix: Array, torques: Array) -> Array:
    """Return tau = C^T tau_phi of drive torques (..., n)."""
    return _mapped(matrix, torques, lambda block: block)


def rows_at_drives(matrix: Array, rows: Array) -> Array:
    """Return the rows (T, n, ...) of a regressor of joint torques for the drive torques."""
    flipped = torques_at_drives(matrix, np.moveaxis(rows, 1, -1))
    return np.moveaxis(flipped, -1, 1)


def _inverse(block: Array) -> Array:
    inverse: Array = safely(np.linalg.inv, block, what="a transmission", error=RobotError)
    return inverse


def _mapped(matrix: Array, values: Array, factor: Callable[[Array], Array]) -> Array:
    """Multiply each coupled group of values (..., n) by `factor` of its block of the matrix."""
    groups = coupled_groups(matrix)
    if not groups:
        return values
    mapped = np.array(values)
    for group in groups:
        # Row vectors: values @ A is A^T times each of them.
        mapped[..., group] = values[..., group] @ factor(matrix[np.ix_(group, group)])
    return mapped
