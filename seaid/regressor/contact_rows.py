"""Rows of a floating base whose columns are changes of contacts: forces, wrenches, radii, flags.

They are the rows of `load_regression` at the same instants, without the same contact forces, with
the columns of what a contact or a sensor may have in addition.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.regressor.floating import (
    accelerated_base,
    contact_equations,
    contact_map,
    floating_regressor,
    floating_rows,
    measured_contact,
    measured_wrenches,
    row_scale,
    without_contact_forces,
)
from seaid.regressor.load import (
    BLOCK_NUMBERS,
    LoadModel,
    below_base,
    drive_parameters,
    drive_torques,
    load_signals,
    piece_samples,
    rows_of_piece,
    thinned,
    unknown_frictions,
)
from seaid.regressor.regression import Regression, rows_by_pieces

if TYPE_CHECKING:
    from seaid.log import Motion
    from seaid.robot import Robot


def measured_contact_torques(robot: Robot, motion: Motion, model: LoadModel) -> Array:
    """Return what measured wrenches contribute to the torque (T, rows) of `load_columns`."""
    base, q = motion.base, motion.joint_position
    assert base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    unknown = unknown_frictions(robot, motion, model.torque_joints)
    rows = measured_wrenches(robot, q, base.wrenches, joints, base.up)[:, :, None]
    rows = without_contact_forces(robot, q, base.contacts, joints, rows, unknown, base.up)
    return np.asarray(rows[:, :, 0] * base.used[:, None])


def contact_force_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    theta: Array,
    bodies: Array,
) -> tuple[Array, BoolArray]:
    """Return what contact forces must hold in the rows (T, 6 + k), and unknown rows (T, k).

    That is Y `bodies` less the torques of the drives by a fit `theta` of the load side.
    """
    base, q = motion.base, motion.joint_position
    assert base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    rows = -below_base(drive_torques(robot, motion, model, springs, theta))
    step = max(BLOCK_NUMBERS // (rows.shape[1] * len(bodies)), 1)
    for start in range(0, len(q), step):
        part = slice(start, start + step)
        states = (q[part], motion.joint_velocity[part], motion.joint_acceleration[part])
        Y = floating_regressor(robot, *states, base.samples(part).states) @ bodies
        rows[part] += floating_rows(robot, Y[:, :, None], joints)[:, :, 0]
    return rows, unknown_frictions(robot, motion, model.torque_joints)


def contact_force_columns(
    robot: Robot, motion: Motion, model: LoadModel, samples: IndexArray
) -> tuple[Array, Array]:
    """Return the columns (S, 6 + k, m) of contact forces by all parameters, and a grouping (f, m).

    The m parameters are those of all bodies, of the identified drives, and the absorbed ones. What
    they do is that of the f identified ones if it is a combination of the rows of the grouping.
    """
    base, p = motion.base, len(model.base.columns)
    assert base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    q, v, a, w, e, f = (values[samples] for values in (*motion.joint_states, *base.states))
    Y = floating_rows(robot, floating_regressor(robot, q, v, a, (w, e, f)), joints)
    signals_of = partial(load_signals, robot, motion)
    columns, drives = drive_parameters(robot, model.torque_joints, signals_of)
    wanted = [drives.index(drive) for drive in (*model.drives, *model.absorbed)]
    grouping = np.zeros((len(model.names), Y.shape[2] + len(wanted)))
    grouping[:p, : Y.shape[2]] = model.base.grouping
    grouping[p:, Y.shape[2] : Y.shape[2] + len(model.drives)] = np.eye(len(model.drives))
    grouping[:, Y.shape[2] + len(model.drives) :] = model.absorption
    force_columns = np.concatenate([Y, below_base(columns[samples][:, :, wanted])], axis=2)
    is_unknown = ~np.concatenate([robot.is_known, np.zeros(len(wanted), bool)])
    return force_columns * is_unknown, grouping * is_unknown


def accelerometer_rows(robot: Robot, motion: Motion, model: LoadModel) -> Regression:
    """Return the rows of `load_regression` with the change of y by a bias of the accelerometer.

    The three columns [N or N m per m/s^2] are in the axes of the base; `robot` has all bodies.
    """

    def columns(piece: Motion) -> Array:
        return accelerated_base(robot, piece.joint_position)

    return _further_rows(robot, motion, model, columns, ("x", "y", "z"), "kg")


def wrench_rows(robot: Robot, motion: Motion, model: LoadModel) -> Regression:
    """Return the rows of `load_regression` with the change of y by zeros of measured wrenches.

    The columns are those of each sensor in turn, in the frame of its link.
    """
    assert motion.base is not None
    widths = {link: values.shape[1] for link, values in motion.base.wrenches.items()}

    def columns(piece: Motion) -> Array:
        assert piece.base is not None
        contacts = [measured_contact(robot, link, width) for link, width in widths.items()]
        # the zeros are in y, where those of an accelerometer are in H
        return -contact_map(robot, piece.joint_position, contacts, piece.base.up, own_frame=True)

    names = tuple(f"{axis} of {link}" for link, n in widths.items() for axis in range(n))
    return _further_rows(robot, motion, model, columns, names, "")


def late_flag_rows(robot: Robot, motion: Motion, model: LoadModel, reach_s: float) -> Regression:
    """Return the rows of `load_regression` with the change of y by forces on feet in the air.

    The two columns are those of a vertical force of 1 N before each landing, and after each time
    that a foot leaves the ground, which fades to zero in `reach_s`; the base needs its orientation.
    """
    assert robot.floating_base is not None
    contacts = [replace(contact, is_flat=False) for contact in robot.floating_base.contacts]

    def columns(piece: Motion) -> Array:
        base = piece.base
        assert base is not None
        assert base.up is not None
        feet = [contact for contact in contacts if contact.link in base.contacts]
        fades = np.array([_fading(base.contacts[x.link], reach_s * piece.rate_hz) for x in feet])
        A = contact_map(robot, piece.joint_position, feet, base.up)
        # (T, 6 + n, 3 k) -> (T, 6 + n, k): the columns of vertical forces of 1 N.
        vertical = A.reshape(*A.shape[:2], len(feet), 3) @ base.up[:, None, :, None]
        return np.asarray(np.einsum("trk,kit->tri", vertical[..., 0], fades))

    return _further_rows(robot, motion, model, columns, ("landing", "leaving"), "")


def _fading(touches: BoolArray, reach: float) -> Array:
    """Return weights (2, T) before and after a contact, from 1 next to it to 0 at `reach`."""
    at, count = np.flatnonzero(touches), len(touches)
    if not len(at):
        return np.zeros((2, count))
    samples = np.arange(count)
    place = np.searchsorted(at, samples)
    until = np.where(place < len(at), at[np.minimum(place, len(at) - 1)] - samples, np.inf)
    since = np.where(place > 0, samples - at[np.maximum(place - 1, 0)], np.inf)
    return np.maximum(1 - np.array([until, since]) / reach, 0.0) * ~touches


def radius_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    theta: Array,
    bodies: Array,
) -> Regression:
    """Return the rows of `load_regression` with the change of y by the radius of balls and points.

    It is that of the moments of the contact forces by a fit `theta`, about lower places; the base
    needs its orientation. The other arguments are those of `contact_force_rows`.
    """
    assert robot.floating_base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    places = [contact for contact in robot.floating_base.contacts if not contact.is_flat]

    def columns(piece: Motion) -> Array:
        base, q = piece.base, piece.joint_position
        assert base is not None
        contacts = [contact for contact in places if contact.link in base.contacts]
        rows, unknown = contact_force_rows(robot, piece, model, springs, theta, bodies)
        # `contact_equations` are of scaled rows, in which unknown ones are zero.
        rows = rows * row_scale(robot, rows.shape[1])[:, 0]
        rows[:, 6:] *= ~unknown
        _, inverse = contact_equations(robot, q, contacts, base.contacts, joints, unknown, base.up)
        # The map is linear in the radius: its derivative is that at 1 m less that at 0.
        lower, centre = (
            contact_map(robot, q, [replace(contact, radius_m=x) for contact in contacts], base.up)
            for x in (1.0, 0.0)
        )
        return np.asarray((lower - centre) @ (inverse @ rows[:, :, None]))

    return _further_rows(robot, motion, model, columns, ("radius",), "N")


def _further_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    columns_of: Callable[[Motion], Array],
    names: tuple[str, ...],
    unit: str,
) -> Regression:
    """Return the rows of `load_regression` with other columns (T, 6 + n, m) of a piece."""
    motion = thinned(motion)
    known = [robot.index(joint) for joint in model.torque_joints]

    def regress(piece: Motion) -> Regression:
        base, q = piece.base, piece.joint_position
        assert base is not None
        unknown = unknown_frictions(robot, piece, model.torque_joints)
        A = floating_rows(robot, columns_of(piece), known)
        # in the place of y: zero in rows without an equation only, so that the rows are the same
        any_y = np.broadcast_to(np.cos(np.arange(A.shape[1])), A.shape[:2])
        A = np.concatenate([A, any_y[:, :, None]], axis=2)
        A = without_contact_forces(robot, q, base.contacts, known, A, unknown, base.up)
        A *= base.used[:, None, None]
        columns = (A[:, :, -1], A[:, :, -1] * 0.0, A[:, :, :-1], A[:, :, :0])
        return rows_of_piece(robot, piece, model, columns, (names, (unit,) * len(names)))

    return rows_by_pieces(motion, regress, piece_samples(model))
